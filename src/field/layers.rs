//! Layers in the kernel.

use super::VOXELS;
use super::batch::centres;
use super::kernel::{Lanes, Places, Scratch};
use super::region::{Layer, LayerKind, Octave, Region, Sum};
use crate::noise::{Cell, band_weight};
use crate::num::{Real, Scalar};
use crate::scene::Op;

/// Packs the places, in voxels from the block's centre, of the voxels inside.
#[inline(always)]
pub(super) fn pack_places<R: Real>(
    token: R::Token,
    places: Places<R::Scalar>,
    scratch: &mut Scratch<R::Scalar>,
) {
    let number = R::load(token, &scratch.numbers);
    let mut packed = 0;
    for index in (0..VOXELS).step_by(R::LANES) {
        let bits = scratch.inside[index / R::LANES];
        if bits == 0 {
            continue;
        }
        let place = match places {
            Places::Centres => centres(token, index, number),
            Places::Points([x, y, z]) => {
                [R::load(token, &x[index..]), R::load(token, &y[index..]), R::load(token, &z[index..])]
            }
        };
        let inside = R::from_bitmask(token, bits);
        place[0].compress(inside).store(scratch.place[0].part_mut(packed));
        place[1].compress(inside).store(scratch.place[1].part_mut(packed));
        place[2].compress(inside).store(scratch.place[2].part_mut(packed));
        packed += bits.count_ones() as usize;
    }
}

/// The density of the packed voxels: envelope times layers. It takes the place of the weights.
///
/// One layer after another, and one sum of noise after another, each over all voxels: what differs from layer to layer is
/// then asked once, and the noise alone is in the innermost loops.
#[inline(always)]
pub(super) fn layers<R: Real>(
    token: R::Token,
    region: &Region<R::Scalar>,
    [start, end]: [usize; 2],
    scratch: &mut Scratch<R::Scalar>,
    packed: usize,
) {
    let layers = &region.layers[start..end];
    for (index, layer) in layers.iter().enumerate() {
        match &layer.kind {
            LayerKind::Constant(constant) => {
                fill::<R>(R::splat(token, *constant), &mut scratch.pattern, packed);
            }
            LayerKind::Sectors => sectors::<R>(token, scratch, packed),
            LayerKind::Perlin { sums, in_world } => {
                for sum in &region.sums[sums[0]..sums[1]] {
                    let octaves = &region.octaves[sum.octaves[0]..sum.octaves[1]];
                    if sum.is_plain {
                        fractal::<R, true>(token, sum, octaves, *in_world, scratch, packed);
                    } else {
                        fractal::<R, false>(token, sum, octaves, *in_world, scratch, packed);
                    }
                    displace::<R>(token, sum, *in_world, scratch, packed);
                }
            }
        }
        join::<R>(token, layer, [index == 0, index + 1 == layers.len()], scratch, packed);
    }
}

#[inline(always)]
fn fill<R: Real>(value: R, lanes: &mut Lanes<R::Scalar>, packed: usize) {
    let mut first = 0;
    while first < packed {
        value.store(lanes.part_mut(first));
        first += R::LANES;
    }
}

/// The pattern of sectors at the packed voxels.
#[inline(always)]
fn sectors<R: Real>(token: R::Token, scratch: &mut Scratch<R::Scalar>, packed: usize) {
    let (zero, one) = (R::constant(token, 0.0), R::constant(token, 1.0));
    let mut first = 0;
    while first < packed {
        let (u, v) = (R::load(token, scratch.u.part(first)), R::load(token, scratch.v.part(first)));
        R::select(zero.lt(u * v), one, zero).store(scratch.pattern.part_mut(first));
        first += R::LANES;
    }
}

/// Joins a layer's pattern to the value of the layers before it, which is 1 before the first; the last meets the envelope.
#[inline(always)]
fn join<R: Real>(
    token: R::Token,
    layer: &Layer<R::Scalar>,
    [is_first, is_last]: [bool; 2],
    scratch: &mut Scratch<R::Scalar>,
    packed: usize,
) {
    let mut first = 0;
    while first < packed {
        let value =
            if is_first { R::constant(token, 1.0) } else { R::load(token, scratch.value.part(first)) };
        let mut term = R::load(token, scratch.pattern.part(first));
        if let Some(threshold) = layer.threshold {
            term = (term - R::splat(token, threshold)).most(R::constant(token, 0.0));
        }
        term = term * R::splat(token, layer.multiplier);
        let joined = match layer.op {
            Op::Multiply => value * term,
            Op::Add => value + term,
            Op::Max => value.most(term),
            Op::Min => value.least(term),
        };
        if is_last {
            let weight = R::load(token, scratch.weight.part(first));
            (joined * weight).store(scratch.weight.part_mut(first));
        } else {
            joined.store(scratch.value.part_mut(first));
        }
        first += R::LANES;
    }
}

/// A sum of noise at the packed voxels.
///
/// Where it is compared with a threshold, voxels that no octave to come can lift above it are left as they are after the first
/// few octaves, and the others are packed for those to come.
#[inline(always)]
fn fractal<R: Real, const PLAIN: bool>(
    token: R::Token,
    sum: &Sum<R::Scalar>,
    octaves: &[Octave<R::Scalar>],
    in_world: bool,
    scratch: &mut Scratch<R::Scalar>,
    packed: usize,
) {
    let Scratch { u, v, height, radius, q, place, displaced, weights, pattern, rest, .. } = scratch;
    let own = if in_world { [&place[0], &place[1], &place[2]] } else { [&*u, &*v, &*height] };
    let x = if sum.displaced[0] { &displaced[0] } else { own[0] };
    let y = if sum.displaced[1] { &displaced[1] } else { own[1] };
    let z = if sum.displaced[2] { &displaced[2] } else { own[2] };
    fill::<R>(R::splat(token, sum.mean), pattern, packed);
    let all = [x, y, z, radius, q];
    let early = Stage::new(sum, octaves, [0, sum.first]);
    add_octaves::<R, PLAIN>(token, &early, all, weights, pattern, packed);
    if sum.first == octaves.len() {
        return;
    }
    let late = Stage::new(sum, octaves, [sum.first, octaves.len()]);
    let fades = !late.fading.is_empty();
    let count = rest.take::<R>(token, sum.least, all, fades, pattern, packed);
    let Rest { at: [x, y, z, radius, q], sum: carried, .. } = rest;
    add_octaves::<R, PLAIN>(token, &late, [x, y, z, radius, q], weights, carried, count);
    rest.give_back::<R>(token, pattern, packed);
}

/// Octaves of a sum that are worked through together.
#[derive(Debug, Clone, Copy)]
struct Stage<'a, T> {
    octaves: &'a [Octave<T>],
    /// Those of them that fade.
    fading: &'a [Octave<T>],
    /// [`Sum::rates`].
    rates: &'a [T; 3],
}

impl<'a, T> Stage<'a, T> {
    /// Those from `start` to `end`.
    fn new(sum: &'a Sum<T>, octaves: &'a [Octave<T>], [start, end]: [usize; 2]) -> Stage<'a, T> {
        let [first, last] = sum.fading.map(|place| place.clamp(start, end));
        Stage { octaves: &octaves[start..end], fading: &octaves[first..last], rates: &sum.rates }
    }
}

/// Adds a stage's octaves to a sum at `count` voxels, given their coordinates, and where octaves fade the radius
/// and the squared distance to the axis over it.
///
/// Each octave's cell, and that of the next batch's first octave, is found before the octave before it is blended: the one is a
/// chain of operations that wait for each other, so the other's fill its gaps, which the processor would not find so far ahead.
#[inline(always)]
fn add_octaves<R: Real, const PLAIN: bool>(
    token: R::Token,
    stage: &Stage<R::Scalar>,
    [x, y, z, radius, q]: [&Lanes<R::Scalar>; 5],
    weights: &mut Vec<Lanes<R::Scalar>>,
    totals: &mut Lanes<R::Scalar>,
    count: usize,
) {
    weigh::<R>(token, stage, [radius, q], weights, count);
    let octaves = stage.octaves;
    let Some(last) = octaves.len().checked_sub(1) else { return };
    let mut here = batch(token, [x, y, z], 0);
    let mut cell = octaves[0].octave.cell::<R, PLAIN>(token, here);
    let mut first = 0;
    while first < count {
        let mut total = R::load(token, totals.part(first));
        for k in 0..last {
            let ahead = octaves[k + 1].octave.cell::<R, PLAIN>(token, here);
            total = total + weighted::<R, PLAIN>(token, &octaves[k], &cell, weights, first);
            cell = ahead;
        }
        // After the last batch this is of no use, and of places that there are, whatever they hold.
        here = batch(token, [x, y, z], first + R::LANES);
        let ahead = octaves[0].octave.cell::<R, PLAIN>(token, here);
        total = total + weighted::<R, PLAIN>(token, &octaves[last], &cell, weights, first);
        total.store(totals.part_mut(first));
        cell = ahead;
        first += R::LANES;
    }
}

/// The coordinates of the batch of voxels from `first`.
#[inline(always)]
fn batch<R: Real>(token: R::Token, [x, y, z]: [&Lanes<R::Scalar>; 3], first: usize) -> [R; 3] {
    [R::load(token, x.part(first)), R::load(token, y.part(first)), R::load(token, z.part(first))]
}

/// The weights of the octaves that fade. Apart from the noise, since each is a long chain of dependent operations: so those of one
/// batch overlap those of the next.
#[inline(always)]
fn weigh<R: Real>(
    token: R::Token,
    stage: &Stage<R::Scalar>,
    [radius, q]: [&Lanes<R::Scalar>; 2],
    weights: &mut Vec<Lanes<R::Scalar>>,
    count: usize,
) {
    let Some(last) = stage.fading.last() else { return };
    if weights.len() <= last.number {
        weights.resize_with(last.number + 1, Lanes::default);
    }
    let mut first = 0;
    while first < count {
        let radius = R::load(token, radius.part(first));
        let r2 = radius * radius;
        let twice_larger = twice_larger_square(token, stage.rates, r2, R::load(token, q.part(first)));
        for octave in stage.fading {
            let weight = band_weight(token, twice_larger * R::splat(token, octave.finer), r2);
            weight.store(weights[octave.number].part_mut(first));
        }
        first += R::LANES;
    }
}

/// An octave's value at the voxels from `first`, as much of it as has not faded.
#[inline(always)]
fn weighted<R: Real, const PLAIN: bool>(
    token: R::Token,
    octave: &Octave<R::Scalar>,
    cell: &Cell<R>,
    weights: &[Lanes<R::Scalar>],
    first: usize,
) -> R {
    let value = octave.octave.at::<R, PLAIN>(token, cell);
    if !octave.fades {
        return value;
    }
    octave.octave.faded(token, value, R::load(token, weights[octave.number].part(first)))
}

/// The voxels whose sum is carried on.
#[derive(Debug, Clone)]
pub(super) struct Rest<T> {
    /// Coordinates, radius, and squared distance to the axis over it.
    at: [Lanes<T>; 5],
    sum: Lanes<T>,
    /// Which of the packed voxels they are, a word for each batch of lanes.
    which: Box<[u32; VOXELS]>,
}

impl<T: Scalar> Default for Rest<T> {
    fn default() -> Rest<T> {
        Rest {
            at: std::array::from_fn(|_| Lanes::default()),
            sum: Lanes::default(),
            which: Box::new([0; VOXELS]),
        }
    }
}

impl<T: Scalar> Rest<T> {
    /// Packs those of the packed voxels whose sum is at least `least`; returns their number.
    #[inline(always)]
    #[allow(
        clippy::needless_range_loop,
        reason = "kernels hold no iterator adaptors: they may not be inlined"
    )]
    fn take<R: Real<Scalar = T>>(
        &mut self,
        token: R::Token,
        least: T,
        from: [&Lanes<T>; 5],
        fades: bool,
        sums: &Lanes<T>,
        packed: usize,
    ) -> usize {
        let least = R::splat(token, least);
        let mut left = 0;
        let mut first = 0;
        while first < packed {
            let sum = R::load(token, sums.part(first));
            let among = if packed - first < R::LANES { (1 << (packed - first)) - 1 } else { u32::MAX };
            let bits = R::bitmask(least.le(sum)) & among;
            self.which[first / R::LANES] = bits;
            let mask = R::from_bitmask(token, bits);
            sum.compress(mask).store(self.sum.part_mut(left));
            for k in 0..if fades { 5 } else { 3 } {
                R::load(token, from[k].part(first)).compress(mask).store(self.at[k].part_mut(left));
            }
            left += bits.count_ones() as usize;
            first += R::LANES;
        }
        left
    }

    /// Writes their sums to where they came from.
    #[inline(always)]
    fn give_back<R: Real<Scalar = T>>(&self, token: R::Token, sums: &mut Lanes<T>, packed: usize) {
        let mut left = 0;
        let mut first = 0;
        while first < packed {
            let bits = self.which[first / R::LANES];
            let mask = R::from_bitmask(token, bits);
            let carried = R::load(token, self.sum.part(left)).expand(mask);
            let sum = R::load(token, sums.part(first));
            R::select(mask, carried, sum).store(sums.part_mut(first));
            left += bits.count_ones() as usize;
            first += R::LANES;
        }
    }
}

/// Displaces the coordinate that a sum is for, if any.
#[inline(always)]
fn displace<R: Real>(
    token: R::Token,
    sum: &Sum<R::Scalar>,
    in_world: bool,
    scratch: &mut Scratch<R::Scalar>,
    packed: usize,
) {
    let Some((axis, reach)) = sum.displaces else { return };
    let Scratch { u, v, height, place, displaced, pattern, .. } = scratch;
    let own = if in_world { &place[axis] } else { [&*u, &*v, &*height][axis] };
    let mut first = 0;
    while first < packed {
        let total = R::load(token, pattern.part(first));
        let moved = R::load(token, own.part(first)) + total * R::splat(token, reach);
        moved.store(displaced[axis].part_mut(first));
        first += R::LANES;
    }
}

/// Twice the larger square of the singular values of the first octave's cells per voxel, times `r2`, the square of the radius.
#[inline(always)]
fn twice_larger_square<R: Real>(token: R::Token, rates: &[R::Scalar; 3], r2: R, q: R) -> R {
    let both = R::splat(token, rates[0]) + (R::splat(token, rates[1]) + R::splat(token, rates[2]) * q) * r2;
    let four = R::Scalar::from_f64(4.0);
    let four_products = R::splat(token, four * (rates[0] * rates[1])) * r2;
    both + (both * both - four_products).most(R::constant(token, 0.0)).sqrt()
}
