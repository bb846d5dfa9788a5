//! Bricks of a bake, encoded on the threads that evaluate them.

use super::{EncodedBricks, Encoder, VdbGridBuilder, VdbWriteError};
use crate::volume::{Brick, Encode, Precision, Sink};

impl Encode for Encoder {
    type Run = EncodedBricks;

    fn precision(&self) -> Precision {
        Encoder::precision(*self)
    }

    fn encode(&self, brick: &Brick, run: &mut EncodedBricks) {
        run.push(*self, brick.origin, &brick.mask, &brick.values);
    }
}

impl Sink for VdbGridBuilder {
    type Encoder = Encoder;
    type Error = VdbWriteError;

    fn encoder(&self) -> Encoder {
        VdbGridBuilder::encoder(self)
    }

    fn append(&mut self, run: EncodedBricks) -> Result<(), VdbWriteError> {
        VdbGridBuilder::append(self, &run)
    }
}
