//! What is tested from outside the library: the program, its files in other programs, the shape of the source.
//! One binary, so that it is linked once.

mod animation;
mod antialias;
mod cli;
mod consumers;
mod detail;
mod files;
mod gates_bake;
mod gates_cover;
mod gates_curves;
mod gates_feet;
mod gates_hash;
mod gates_noise;
mod gates_oracle;
mod hostile;
mod inputs;
mod joins;
mod kernel;
mod large;
mod layers;
mod mass;
mod memory;
mod methods;
mod noise;
mod oracle;
mod reader;
mod rows;
mod same_bytes;
mod sample;
mod sequence;
mod shapes;
mod slice;
mod support;
mod vdb_rs;
mod writer;
