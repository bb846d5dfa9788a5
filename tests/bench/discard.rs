//! A sink that keeps nothing, so that evaluation alone is timed.

use std::convert::Infallible;

use vdbake::volume::{Brick, Encode, Sink};

#[derive(Clone, Copy)]
pub(crate) struct Discard;

impl Encode for Discard {
    type Run = ();
    fn encode(&self, brick: &Brick, (): &mut ()) {
        std::hint::black_box(brick);
    }
}

impl Sink for Discard {
    type Encoder = Discard;
    type Error = Infallible;
    fn encoder(&self) -> Discard {
        *self
    }
    fn append(&mut self, (): ()) -> Result<(), Infallible> {
        Ok(())
    }
}
