//! What becomes of several densities at one voxel: of the feet on one axis, and of the tubes.
//!
//! Pieces hold feet a little past their borders, so a foot on a border is found twice. Where the larger density counts that
//! does no harm, and [`larger`] joins all pieces as they come. Elsewhere feet are told apart by their arc lengths: the
//! pieces of a tube come in order along its axis, so a foot that is found again follows its first finding.

use super::VOXELS;
use super::kernel::{Lanes, Scratch};
use super::region::Tube;
use crate::num::{Real, Scalar};
use crate::scene::Overlap;

/// Feet of a voxel whose arc lengths differ by no more than this, in voxels, are one foot: pieces reach 1e-3 voxels past
/// their borders, and two feet so close to each other have nearly faded.
const SAME: f64 = 0.01;
/// An arc length, or a squared distance, that no foot has.
const NONE: f64 = 1e30;

/// What the voxels of a block have so far.
#[derive(Debug, Clone)]
pub(super) struct Joint<T> {
    /// Of the tube that is being worked through.
    tube: Sum<T>,
    /// Arc lengths of the last foot and of the first.
    last: Vec<T>,
    first: Vec<T>,
    /// Of all tubes; their values are the block's.
    all: Sum<T>,
    /// Voxels with several feet on one axis, a word for each batch of lanes.
    several: Vec<u32>,
    /// Voxels beyond the focal set.
    pub(super) beyond: Vec<u32>,
}

#[derive(Debug, Clone)]
struct Sum<T> {
    value: Vec<T>,
    weight: Vec<T>,
    /// Least squared distance to an axis, in voxels.
    nearest: Vec<T>,
    /// Voxels that have any, a word for each batch of lanes.
    any: Vec<u32>,
}

impl<T: Scalar> Default for Sum<T> {
    fn default() -> Sum<T> {
        let room = || vec![T::default(); VOXELS];
        Sum { value: room(), weight: room(), nearest: room(), any: vec![0; VOXELS] }
    }
}

impl<T: Scalar> Sum<T> {
    fn clear(&mut self) {
        self.value.fill(T::default());
        self.weight.fill(T::default());
        self.nearest.fill(T::from_f64(NONE));
        self.any.fill(0);
    }
}

impl<T: Scalar> Default for Joint<T> {
    fn default() -> Joint<T> {
        let room = || vec![T::default(); VOXELS];
        Joint {
            tube: Sum::default(),
            last: room(),
            first: room(),
            all: Sum::default(),
            several: vec![0; VOXELS],
            beyond: vec![0; VOXELS],
        }
    }
}

/// Begins a block.
pub(super) fn begin<T: Scalar>(joint: &mut Joint<T>) {
    joint.all.clear();
    joint.several.fill(0);
    joint.beyond.fill(0);
}

/// Begins a tube.
pub(super) fn open<T: Scalar>(joint: &mut Joint<T>) {
    joint.tube.clear();
    joint.last.fill(T::from_f64(NONE));
    joint.first.fill(T::from_f64(NONE));
}

/// Unpacks the densities of a piece and keeps the larger of them and what the block holds.
#[inline(always)]
pub(super) fn larger<R: Real>(token: R::Token, scratch: &mut Scratch<R::Scalar>) {
    let values = &mut scratch.block;
    let mut first = 0;
    for index in (0..VOXELS).step_by(R::LANES) {
        let bits = scratch.inside[index / R::LANES];
        if bits != 0 {
            let mut density = R::load(token, scratch.weight.part(first));
            if bits.count_ones() as usize != R::LANES {
                density = density.expand(R::from_bitmask(token, bits));
            }
            let held = R::load(token, values.part(index));
            density.most(held).store(values.part_mut(index));
            first += bits.count_ones() as usize;
        }
    }
}

/// Unpacks the densities of a piece and joins them to those of the tube's other feet. `arc` is the arc length at height 0
/// and per unit of height.
#[inline(always)]
pub(super) fn feet<R: Real>(
    token: R::Token,
    tube: &Tube<R::Scalar>,
    arc: [R::Scalar; 2],
    scratch: &mut Scratch<R::Scalar>,
) {
    let joint = &mut scratch.joint;
    let (zero, one) = (R::constant(token, 0.0), R::constant(token, 1.0));
    let (start, rate) = (R::splat(token, arc[0]), R::splat(token, arc[1]));
    let same = R::constant(token, SAME);
    let mut packed = 0;
    for index in (0..VOXELS).step_by(R::LANES) {
        let batch = index / R::LANES;
        let bits = scratch.inside[batch];
        if bits == 0 {
            continue;
        }
        let mask = R::from_bitmask(token, bits);
        let density = R::load(token, scratch.weight.part(packed)).expand(mask);
        let height = R::load(token, scratch.height.part(packed)).expand(mask);
        let q = R::load(token, scratch.q.part(packed)).expand(mask);
        let radius = R::load(token, scratch.radius.part(packed)).expand(mask);
        let focal = R::load(token, scratch.focal.part(packed)).expand(mask);
        packed += bits.count_ones() as usize;

        let arc = start + rate * height;
        let (last, first) = (R::load(token, &joint.last[index..]), R::load(token, &joint.first[index..]));
        let mut again = (arc - last).abs().le(same);
        if let Some(lap) = tube.lap {
            // Along a closed axis the last foot may be the first.
            again = R::or(again, (arc - first - R::splat(token, lap)).abs().le(same));
        }
        let fresh = R::and(mask, R::not(again));
        let had = joint.tube.any[batch];
        joint.several[batch] |= had & R::bitmask(fresh);
        joint.tube.any[batch] = had | bits;
        R::select(mask, arc, last).store(&mut joint.last[index..]);
        R::select(R::and(mask, R::not(R::from_bitmask(token, had))), arc, first)
            .store(&mut joint.first[index..]);

        let rim = one - q.sqrt();
        let weight = R::select(fresh, focal * rim * rim, zero);
        let held = R::load(token, &joint.tube.value[index..]);
        let nearest = R::load(token, &joint.tube.nearest[index..]);
        let distance = q * radius * radius;
        let closer = R::and(mask, distance.lt(nearest));
        let value = match tube.overlap {
            Overlap::Max => {
                let larger = R::and(mask, R::or(held.lt(density), R::not(R::from_bitmask(token, had))));
                R::select(larger, density, held)
            }
            Overlap::Sum => held + R::select(fresh, density, zero),
            Overlap::Closest => R::select(closer, density, held),
            Overlap::Blend => held + weight * density,
        };
        value.store(&mut joint.tube.value[index..]);
        R::select(closer, distance, nearest).store(&mut joint.tube.nearest[index..]);
        (R::load(token, &joint.tube.weight[index..]) + weight).store(&mut joint.tube.weight[index..]);
    }
}

/// Joins the tube that was worked through, by its own rule, to those before it.
#[inline(always)]
pub(super) fn close<R: Real>(
    token: R::Token,
    own: Overlap,
    rule: Overlap,
    joint: &mut Joint<R::Scalar>,
    values: &mut Lanes<R::Scalar>,
) {
    let zero = R::constant(token, 0.0);
    for index in (0..VOXELS).step_by(R::LANES) {
        let batch = index / R::LANES;
        let bits = joint.tube.any[batch];
        if bits == 0 {
            continue;
        }
        let mask = R::from_bitmask(token, bits);
        let weight = R::load(token, &joint.tube.weight[index..]);
        let mut value = R::load(token, &joint.tube.value[index..]);
        if own == Overlap::Blend {
            value = mean(token, value, weight);
        }
        let held = R::load(token, values.part(index));
        let joined = match rule {
            Overlap::Max => held.most(R::select(mask, value, zero)),
            Overlap::Sum => held + R::select(mask, value, zero),
            Overlap::Closest => {
                let distance = R::load(token, &joint.tube.nearest[index..]);
                let nearest = R::load(token, &joint.all.nearest[index..]);
                let closer = R::and(mask, distance.lt(nearest));
                R::select(closer, distance, nearest).store(&mut joint.all.nearest[index..]);
                R::select(closer, value, held)
            }
            Overlap::Blend => {
                let total = R::load(token, &joint.all.weight[index..]);
                (total + weight).store(&mut joint.all.weight[index..]);
                held + weight * value
            }
        };
        joined.store(values.part_mut(index));
    }
}

/// The densities of all tubes; counts of voxels with several feet on one axis, and beyond the focal set.
#[inline(always)]
pub(super) fn finish<R: Real>(
    token: R::Token,
    rule: Overlap,
    joint: &Joint<R::Scalar>,
    values: &mut Lanes<R::Scalar>,
) -> [u64; 2] {
    let zero = R::constant(token, 0.0);
    let mut counts = [0; 2];
    for index in (0..VOXELS).step_by(R::LANES) {
        let batch = index / R::LANES;
        let mut value = R::load(token, values.part(index));
        if rule == Overlap::Blend {
            value = mean(token, value, R::load(token, &joint.all.weight[index..]));
        }
        value.most(zero).store(values.part_mut(index));
        counts[0] += u64::from(joint.several[batch].count_ones());
        counts[1] += u64::from(joint.beyond[batch].count_ones());
    }
    counts
}

/// 0 where there is no weight.
#[inline(always)]
fn mean<R: Real>(token: R::Token, sum: R, weight: R) -> R {
    let zero = R::constant(token, 0.0);
    R::select(zero.lt(weight), sum / weight, zero)
}
