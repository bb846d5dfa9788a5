//! Batches: the sixteen voxels that are worked through together.
//!
//! A batch is a box of 2 x 2 x 4 voxels. Of all shapes that fill a block and keep z fastest within, this one's centres spread least,
//! so the fewest batches lie on a tube's surface, and the fewest lanes beside it are searched in vain.

use super::kernel::Lanes;
use super::{EDGE, VOXELS};
use crate::num::Real;

/// Voxels in a batch, whatever the lanes of the arithmetic.
pub(super) const BATCH: usize = 16;
/// Batches in a block.
pub(super) const BATCHES: usize = VOXELS / BATCH;
/// Voxels along a batch's edges.
pub(super) const SIDES: [usize; 3] = [2, 2, 4];
/// From the first voxel's centre to the middle of a batch.
pub(super) const HALF: [f64; 3] = [0.5, 0.5, 1.5];

/// The first voxel of a batch: batches lie in a block as voxels do, z fastest.
#[inline(always)]
pub(super) const fn corner(batch: usize) -> [usize; 3] {
    const Z: usize = EDGE / SIDES[2];
    const Y: usize = EDGE / SIDES[1];
    [batch / (Y * Z) * SIDES[0], batch / Z % Y * SIDES[1], batch % Z * SIDES[2]]
}

/// The voxel at place `index`.
#[inline(always)]
const fn voxel(index: usize) -> [usize; 3] {
    let ([x, y, z], lane) = (corner(index / BATCH), index % BATCH);
    let row = lane / SIDES[2];
    [x + row / SIDES[1], y + row % SIDES[1], z + lane % SIDES[2]]
}

/// How far the lanes from place `index` on lie from the first voxel of their batch, in voxels. `number` is the lane's, from 0.
#[inline(always)]
#[allow(clippy::cast_precision_loss, reason = "below 16")]
pub(super) fn within<R: Real>(token: R::Token, index: usize, number: R) -> [R; 3] {
    let number = number + R::constant(token, (index % BATCH) as f64);
    let x = (number * R::constant(token, 0.125)).floor();
    let row = (number * R::constant(token, 0.25)).floor();
    [x, row - (x + x), number - row * R::constant(token, 4.0)]
}

/// The same from the block's centre.
#[inline(always)]
#[allow(clippy::cast_precision_loss, reason = "indices below 8")]
pub(super) fn centres<R: Real>(token: R::Token, index: usize, number: R) -> [R; 3] {
    let [x, y, z] = within(token, index, number);
    let first = corner(index / BATCH);
    [
        x + R::constant(token, first[0] as f64 - 3.5),
        y + R::constant(token, first[1] as f64 - 3.5),
        z + R::constant(token, first[2] as f64 - 3.5),
    ]
}

/// Brings numbers of voxels that lie batch by batch into the block's own order, z fastest.
#[inline(always)]
pub(super) fn in_order<R: Real>(
    token: R::Token,
    batched: &Lanes<R::Scalar>,
    values: &mut [R::Scalar; VOXELS],
) {
    if R::LANES != BATCH {
        for index in 0..VOXELS {
            let [x, y, z] = voxel(index);
            values[(x * EDGE + y) * EDGE + z] = batched.all()[index];
        }
        return;
    }
    // Two batches share their rows of z, and of those two follow each other in the block.
    for pair in 0..BATCHES / 2 {
        let [x, y, _] = corner(2 * pair);
        let (low, high) = (batched.part(2 * pair * BATCH), batched.part((2 * pair + 1) * BATCH));
        let rows = R::load(token, low).zip_quarters(R::load(token, high));
        rows[0].store(&mut values[(x * EDGE + y) * EDGE..]);
        rows[1].store(&mut values[((x + 1) * EDGE + y) * EDGE..]);
    }
}

/// Some of a block's batches: bit i for batch i.
///
/// Loops go from one set bit to the next, and do not ask about each batch: the answers follow no pattern that a processor could
/// guess.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Batches(pub(super) u32);

impl Batches {
    /// Those that hold the first places of a block.
    #[inline(always)]
    pub(super) fn first(places: usize) -> Batches {
        let count = places.div_ceil(BATCH);
        Batches(if count >= BATCHES { u32::MAX } else { (1 << count) - 1 })
    }

    #[inline(always)]
    pub(super) fn are_none(self) -> bool {
        self.0 == 0
    }

    /// How many voxels they have.
    #[inline(always)]
    pub(super) fn voxels(self) -> u64 {
        u64::from(self.0.count_ones()) * BATCH as u64
    }

    #[inline(always)]
    pub(super) fn have(self, batch: usize) -> bool {
        self.0 >> batch & 1 == 1
    }

    #[inline(always)]
    pub(super) fn add(&mut self, batch: usize) {
        self.0 |= 1 << batch;
    }

    /// Takes the first of them: its places from one to another.
    #[inline(always)]
    pub(super) fn take(&mut self) -> Option<[usize; 2]> {
        if self.0 == 0 {
            return None;
        }
        let first = self.0.trailing_zeros() as usize * BATCH;
        self.0 &= self.0 - 1;
        Some([first, first + BATCH])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lanes_lie_where_their_values_are_put() {
        let mut batched = Lanes::default();
        for index in 0..VOXELS {
            let [x, y, z] = centres((), index, 0.0).map(|at| at + 3.5);
            batched.part_mut(index)[0] = (x * 8.0 + y) * 8.0 + z;
        }
        let mut values = [0.0; VOXELS];
        in_order::<f64>((), &batched, &mut values);
        assert_eq!(values, std::array::from_fn(|index| index as f64));
    }

    #[test]
    fn batches_are_taken_in_order() {
        let mut batches = Batches::first(33);
        assert_eq!(batches.voxels(), 48);
        batches.add(31);
        assert!(batches.have(31) && !batches.have(30));
        let mut taken = Vec::new();
        while let Some(places) = batches.take() {
            taken.push(places);
        }
        assert_eq!(taken, [[0, 16], [16, 32], [32, 48], [496, 512]]);
        assert!(batches.are_none() && Batches::first(VOXELS) == Batches(u32::MAX));
    }
}
