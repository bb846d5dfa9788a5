//! A brick of values and where it goes.

use super::Precision;
use crate::field::VOXELS;

/// The values of 8^3 voxels, z fastest, as OpenVDB orders a leaf: voxel (x, y, z) of the brick is element
/// `64 x + 8 y + z`.
#[derive(Debug, Clone, PartialEq)]
pub struct Brick {
    /// Index of its first voxel, a multiple of 8 along each axis.
    pub origin: [i32; 3],
    /// Active voxels: element i is bit `i % 64` of word `i / 64`.
    pub mask: [u64; 8],
    /// Density, in the precision of where it goes; 0 where inactive.
    pub values: [f32; VOXELS],
}

impl Brick {
    /// Number of active voxels.
    pub fn active(&self) -> u32 {
        self.mask.iter().map(|word| word.count_ones()).sum()
    }

    /// The one value of all voxels, if all are active and equal to the bit.
    pub fn uniform(&self) -> Option<f32> {
        let first = self.values[0];
        let all = self.mask.iter().all(|&word| word == u64::MAX);
        (all && self.values.iter().all(|value| value.to_bits() == first.to_bits())).then_some(first)
    }
}

/// What encodes bricks for a sink, on many threads at once.
pub trait Encode: Sync {
    /// A run of encoded bricks.
    type Run: Default + Send;

    /// The precision that it keeps. Bricks come with values that it keeps as they are.
    fn precision(&self) -> Precision {
        Precision::F32
    }

    /// Adds a brick with at least one active voxel to a run.
    fn encode(&self, brick: &Brick, run: &mut Self::Run);
}

/// Where bricks go: a file being written, or memory.
pub trait Sink: Send {
    /// What encodes its bricks.
    type Encoder: Encode;
    /// What may go wrong when a run is taken in.
    type Error: Send;

    /// What encodes its bricks, while others are taken in.
    fn encoder(&self) -> Self::Encoder;

    /// Takes in a run, on any thread. Runs come in file order: by the first voxel of the enclosing 4096^3 block (x, then y, then z),
    /// within it of the 128^3 block, within that of the brick.
    ///
    /// # Errors
    ///
    /// When the sink cannot hold or write the run; the bake then ends.
    fn append(&mut self, run: <Self::Encoder as Encode>::Run) -> Result<(), Self::Error>;
}
