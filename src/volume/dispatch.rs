//! The one place where the instruction set is chosen.
//!
//! The functions are neither generic nor inlined, so that the kernel is compiled once for each instruction set.

use super::Brick;
use crate::field::kernel::{Counts, Places, Scratch, evaluate};
use crate::field::{Region, VOXELS, every, rest};
use crate::num::{Level, Real, WithLevel, with_level};

/// The density at 512 places of a block.
#[inline(never)]
pub(crate) fn evaluate_block(
    level: Level,
    region: &Region<f32>,
    places: Places<f32>,
    scratch: &mut Scratch<f32>,
    values: &mut [f32; VOXELS],
) -> Counts {
    with_level(level, Evaluate { region, places, scratch, values })
}

/// The density at the first `count` places of a block, whose coordinates are found at some only.
#[inline(never)]
pub(crate) fn evaluate_every(
    level: Level,
    region: &Region<f32>,
    points: [&[f32; VOXELS]; 3],
    (count, nodes): (usize, u32),
    scratch: &mut Scratch<f32>,
    values: &mut [f32; VOXELS],
) -> Counts {
    with_level(level, Every { region, points, count, nodes, scratch, values })
}

/// Marks voxels above `cutoff` active and sets the others to 0.
#[inline(never)]
pub(super) fn activate(level: Level, cutoff: f32, brick: &mut Brick) {
    with_level(level, Activate { cutoff, brick });
}

/// What the layers make at `count` places of a slice at rest.
#[inline(never)]
pub(super) fn evaluate_slice(level: Level, region: &Region<f32>, scratch: &mut Scratch<f32>, count: usize) {
    with_level(level, Slice { region, scratch, count });
}

struct Slice<'a> {
    region: &'a Region<f32>,
    scratch: &'a mut Scratch<f32>,
    count: usize,
}

impl WithLevel for Slice<'_> {
    type Output = ();
    #[inline(always)]
    fn run<R: Real<Scalar = f32>>(self, token: R::Token) {
        rest::evaluate::<R>(token, self.region, self.scratch, self.count);
    }
}

struct Evaluate<'a> {
    region: &'a Region<f32>,
    places: Places<'a, f32>,
    scratch: &'a mut Scratch<f32>,
    values: &'a mut [f32; VOXELS],
}

impl WithLevel for Evaluate<'_> {
    type Output = Counts;
    #[inline(always)]
    fn run<R: Real<Scalar = f32>>(self, token: R::Token) -> Counts {
        evaluate::<R>(token, self.region, self.places, self.scratch, self.values)
    }
}

struct Every<'a> {
    region: &'a Region<f32>,
    points: [&'a [f32; VOXELS]; 3],
    count: usize,
    nodes: u32,
    scratch: &'a mut Scratch<f32>,
    values: &'a mut [f32; VOXELS],
}

impl WithLevel for Every<'_> {
    type Output = Counts;
    #[inline(always)]
    fn run<R: Real<Scalar = f32>>(self, token: R::Token) -> Counts {
        let Every { region, points, count, nodes, scratch, values } = self;
        every::evaluate::<R>(token, region, points, count, nodes, scratch, values)
    }
}

struct Activate<'a> {
    cutoff: f32,
    brick: &'a mut Brick,
}

impl WithLevel for Activate<'_> {
    type Output = ();
    #[inline(always)]
    fn run<R: Real<Scalar = f32>>(self, token: R::Token) {
        let (cutoff, zero) = (R::splat(token, self.cutoff), R::splat(token, 0.0));
        for (word, values) in self.brick.mask.iter_mut().zip(self.brick.values.chunks_exact_mut(64)) {
            *word = 0;
            for first in (0..64).step_by(R::LANES) {
                let value = R::load(token, &values[first..]);
                let active = cutoff.lt(value);
                *word |= u64::from(R::bitmask(active)) << first;
                R::select(active, value, zero).store(&mut values[first..]);
            }
        }
    }
}
