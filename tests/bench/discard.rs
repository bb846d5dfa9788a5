//! A sink that keeps nothing, so that evaluation alone is timed.

use std::convert::Infallible;

use vdbake::volume::{Brick, Sink};

pub(crate) struct Discard;

impl Sink for Discard {
    type Run = ();
    type Error = Infallible;
    fn encode(&self, brick: &Brick, (): &mut ()) {
        std::hint::black_box(brick);
    }
    fn append(&mut self, (): ()) -> Result<(), Infallible> {
        Ok(())
    }
}
