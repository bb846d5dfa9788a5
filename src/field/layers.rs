//! Layers in the kernel.

use super::kernel::{Lanes, Places, Scratch};
use super::region::{Layer, LayerKind, Octave, Region, Sum};
use super::{EDGE, VOXELS};
use crate::noise::{Cell, band_weight};
use crate::num::{Real, Scalar};
use crate::scene::Op;

/// Packs the places, in voxels from the block's centre, of the voxels inside.
#[inline(always)]
#[allow(clippy::cast_precision_loss, reason = "indices below 512")]
pub(super) fn pack_places<R: Real>(
    token: R::Token,
    places: Places<R::Scalar>,
    scratch: &mut Scratch<R::Scalar>,
) {
    let number = R::load(token, &scratch.numbers);
    let y = (number * R::constant(token, 0.125)).floor();
    let z = number - y * R::constant(token, 8.0);
    let mut packed = 0;
    for index in (0..VOXELS).step_by(R::LANES) {
        let bits = scratch.inside[index / R::LANES];
        if bits == 0 {
            continue;
        }
        let place = match places {
            Places::Centres => {
                let x = R::Scalar::from_f64((index / (EDGE * EDGE)) as f64 - 3.5);
                let first_y = R::Scalar::from_f64((index / EDGE % EDGE) as f64 - 3.5);
                let first_z = R::Scalar::from_f64((index % EDGE) as f64 - 3.5);
                [R::splat(token, x), R::splat(token, first_y) + y, R::splat(token, first_z) + z]
            }
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

/// The weights of octaves that fade at the packed voxels, for [`layers`]. Apart from the noise, since each is a long chain of
/// dependent operations: so those of one batch overlap those of the next.
#[inline(always)]
fn fade<R: Real>(
    token: R::Token,
    region: &Region<R::Scalar>,
    layers: &[Layer<R::Scalar>],
    scratch: &mut Scratch<R::Scalar>,
    packed: usize,
) {
    for layer in layers {
        let LayerKind::Perlin { sums, .. } = layer.kind else { continue };
        for sum in &region.sums[sums[0]..sums[1]] {
            let fading = &region.octaves[sum.fading[0]..sum.fading[1]];
            let Some(last) = fading.last() else { continue };
            if scratch.weights.len() <= last.number {
                scratch.weights.resize_with(last.number + 1, Lanes::default);
            }
            let mut first = 0;
            while first < packed {
                let radius = R::load(token, scratch.radius.part(first));
                let r2 = radius * radius;
                let larger = larger_square(token, &sum.rates, r2, R::load(token, scratch.q.part(first)));
                for octave in fading {
                    let weight = band_weight(token, larger * R::splat(token, octave.finer), r2);
                    weight.store(scratch.weights[octave.number].part_mut(first));
                }
                first += R::LANES;
            }
        }
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
    fade::<R>(token, region, layers, scratch, packed);
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
/// Each octave's cell is found before the octave before it is blended: the one is a chain of operations that wait for each
/// other, so the other's fill its gaps, which the processor would not find so far ahead.
#[inline(always)]
fn fractal<R: Real, const PLAIN: bool>(
    token: R::Token,
    sum: &Sum<R::Scalar>,
    octaves: &[Octave<R::Scalar>],
    in_world: bool,
    scratch: &mut Scratch<R::Scalar>,
    packed: usize,
) {
    let mean = R::splat(token, sum.mean);
    let [start, ..] = octaves else {
        fill::<R>(mean, &mut scratch.pattern, packed);
        return;
    };
    let Scratch { u, v, height, weights, place, displaced, pattern, .. } = scratch;
    let own = if in_world { [&place[0], &place[1], &place[2]] } else { [&*u, &*v, &*height] };
    let x = if sum.displaced[0] { &displaced[0] } else { own[0] };
    let y = if sum.displaced[1] { &displaced[1] } else { own[1] };
    let z = if sum.displaced[2] { &displaced[2] } else { own[2] };
    let last = octaves.len() - 1;
    let mut first = 0;
    'batches: while first < packed {
        let at =
            [R::load(token, x.part(first)), R::load(token, y.part(first)), R::load(token, z.part(first))];
        let mut total = mean;
        let mut cell = start.octave.cell::<R, PLAIN>(token, at);
        for k in 0..last {
            let octave = &octaves[k];
            let ahead = octaves[k + 1].octave.cell::<R, PLAIN>(token, at);
            total = total + weighted::<R, PLAIN>(token, octave, &cell, weights, first);
            if let Some(hopeless) = octave.hopeless
                && R::bitmask(R::splat(token, hopeless).le(total)) == 0
            {
                total.store(pattern.part_mut(first));
                first += R::LANES;
                continue 'batches;
            }
            cell = ahead;
        }
        total = total + weighted::<R, PLAIN>(token, &octaves[last], &cell, weights, first);
        total.store(pattern.part_mut(first));
        first += R::LANES;
    }
}

/// An octave's value at the packed voxels from `first`, as much of it as has not faded.
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

/// The larger square of the singular values of the first octave's cells per voxel, times `r2`, the square of the radius.
#[inline(always)]
fn larger_square<R: Real>(token: R::Token, rates: &[R::Scalar; 3], r2: R, q: R) -> R {
    let both = R::splat(token, rates[0]) + (R::splat(token, rates[1]) + R::splat(token, rates[2]) * q) * r2;
    let product = R::splat(token, rates[0] * rates[1]) * r2;
    let root = (both * both - R::constant(token, 4.0) * product).most(R::constant(token, 0.0)).sqrt();
    (both + root) * R::constant(token, 0.5)
}
