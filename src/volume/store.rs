//! A sink in memory.

use std::convert::Infallible;

use super::{Brick, Encode, Precision, Sink};

/// Bricks in memory, in file order.
#[derive(Debug, Clone, Default)]
pub struct Store {
    precision: Precision,
    bricks: Vec<Brick>,
}

impl Store {
    /// No bricks. Those that come are rounded to this precision.
    pub fn new(precision: Precision) -> Store {
        Store { precision, bricks: Vec::new() }
    }

    /// The bricks, in file order.
    pub fn bricks(&self) -> &[Brick] {
        &self.bricks
    }

    /// Index and value of every active voxel, brick by brick in file order and z fastest within a brick.
    pub fn active(&self) -> impl Iterator<Item = ([i32; 3], f32)> {
        self.bricks.iter().flat_map(|brick| {
            brick.values.iter().zip(0_i32..).filter_map(move |(&value, i)| {
                let word = brick.mask[usize::try_from(i / 64).unwrap_or_default()];
                let at = [brick.origin[0] + i / 64, brick.origin[1] + i / 8 % 8, brick.origin[2] + i % 8];
                (word >> (i % 64) & 1 == 1).then_some((at, value))
            })
        })
    }
}

/// Bricks as they are, in this precision.
impl Encode for Precision {
    type Run = Vec<Brick>;

    fn precision(&self) -> Precision {
        *self
    }

    fn encode(&self, brick: &Brick, run: &mut Vec<Brick>) {
        run.push(brick.clone());
    }
}

impl Sink for Store {
    type Encoder = Precision;
    type Error = Infallible;

    fn encoder(&self) -> Precision {
        self.precision
    }

    fn append(&mut self, run: Vec<Brick>) -> Result<(), Infallible> {
        self.bricks.extend(run);
        Ok(())
    }
}
