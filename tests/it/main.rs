//! Everything that is tested from outside, linked once.

mod cli;
mod layers;
