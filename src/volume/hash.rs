//! One number for all values of a grid.

use sha2::{Digest, Sha256};
use twox_hash::XxHash3_128;

use super::Brick;
use crate::field::VOXELS;

/// The hash of all values of a grid: SHA-256 over, brick by brick in file order, the XXH3 of 128 bits (in its canonical
/// form) of the brick's origin (three `i32`), mask (eight `u64`) and all 512 values (`f32`), little-endian. A tile counts as
/// the bricks that it stands for. It takes a tenth of what SHA-256 of the values would, and tells damage, not forgery.
#[derive(Debug, Clone, Default)]
pub struct ContentHash(Sha256);

impl ContentHash {
    /// Takes in the next brick that has active voxels.
    pub fn push(&mut self, brick: &BrickHash) {
        self.0.update(brick.0);
    }

    /// The hash of all that was taken in.
    pub fn finish(self) -> [u8; 32] {
        self.0.finalize().into()
    }
}

/// What a brick adds to the hash of its grid.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct BrickHash([u8; 16]);

impl BrickHash {
    /// Of a brick's place, mask and values.
    pub fn new(brick: &Brick) -> BrickHash {
        let mut bytes = [0_u8; 12 + 64 + 4 * VOXELS];
        let numbers = brick.origin.iter().map(|i| i.to_le_bytes());
        for (to, from) in bytes.chunks_exact_mut(4).zip(numbers) {
            to.copy_from_slice(&from);
        }
        for (to, from) in bytes[12..76].chunks_exact_mut(8).zip(brick.mask) {
            to.copy_from_slice(&from.to_le_bytes());
        }
        for (to, from) in bytes[76..].chunks_exact_mut(4).zip(brick.values) {
            to.copy_from_slice(&from.to_le_bytes());
        }
        BrickHash(XxHash3_128::oneshot(&bytes).to_be_bytes())
    }
}
