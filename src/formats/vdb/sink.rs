//! Bricks of a bake, encoded on the threads that evaluate them.

use super::{EncodedBricks, VdbGridBuilder, VdbWriteError};
use crate::volume::{Brick, Precision, Sink};

impl Sink for VdbGridBuilder {
    type Run = EncodedBricks;
    type Error = VdbWriteError;

    fn precision(&self) -> Precision {
        self.encoder().precision()
    }

    fn encode(&self, brick: &Brick, run: &mut EncodedBricks) {
        run.push(self.encoder(), brick.origin, &brick.mask, &brick.values);
    }

    fn append(&mut self, run: EncodedBricks) -> Result<(), VdbWriteError> {
        VdbGridBuilder::append(self, &run)
    }
}
