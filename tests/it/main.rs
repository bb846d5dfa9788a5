//! What is tested from outside the library: the program, its files in other programs, the shape of the source.
//! One binary, so that it is linked once.

mod cli;
mod consumers;
mod files;
mod hostile;
mod kernel;
mod layers;
mod noise;
mod oracle;
mod reader;
mod same_bytes;
mod support;
