//! Upper bounds of the density, by interval arithmetic on the layers.
//!
//! Envelopes are at most 1, octaves of noise stay within the exact bounds of their form, and so do they where they fade,
//! which takes them towards their mean. What density gains by the deformation is bounded by its polynomial's coefficients,
//! and the focal fade over what space narrows to, `smoothstep(0, 0.2, x) / max(x, 0.05)`, by 45 / 8.

use super::Field;
use super::kernel::LEAST_NARROWING;
use super::pattern::Fractal;
use super::region::{self, Region};
use super::span::MOST_GAIN;
use super::tube::{LayerKind, Tube};
use crate::num::Scalar;
use crate::num::poly::TERMS;
use crate::scene::{Conserve, Op, Overlap};

/// The largest of `smoothstep(0, 0.2, x) / x`, at x = 0.15.
const FADED: f64 = 45.0 / 8.0;
/// What single precision may make of a bound, relative to the largest numbers that lead to it.
const ROUNDING: f64 = 1e-4;
/// Local minima of the distance from a point to a segment of degree 3 at most.
const FEET: f64 = 3.0;
/// Feet may lie this far past the ends of a piece's parameter, -1 and 1, or a span's.
const PAST: f64 = 1.25;

type Interval = [f64; 2];

/// A layer's part in the density so far.
fn join(op: Op, a: Interval, b: Interval) -> Interval {
    match op {
        Op::Add => [a[0] + b[0], a[1] + b[1]],
        Op::Max => [a[0].max(b[0]), a[1].max(b[1])],
        Op::Min => [a[0].min(b[0]), a[1].min(b[1])],
        Op::Multiply => {
            let products = [a[0] * b[0], a[0] * b[1], a[1] * b[0], a[1] * b[1]];
            products.into_iter().fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], product| {
                [low.min(product), high.max(product)]
            })
        }
    }
}

/// A layer's term, of its pattern.
fn term(pattern: Interval, threshold: Option<f64>, multiplier: f64) -> Interval {
    let above = match threshold {
        Some(threshold) => pattern.map(|value| (value - threshold).max(0.0)),
        None => pattern,
    };
    join(Op::Multiply, above, [multiplier; 2])
}

/// Grown by what rounding may do.
fn rounded([low, high]: Interval) -> Interval {
    let slack = ROUNDING * low.abs().max(high.abs());
    [low - slack, high + slack]
}

fn fractal(sum: &Fractal) -> Interval {
    sum.octaves.iter().fold([sum.mean; 2], |range, octave| {
        let values = sum.form.range().map(|value| value * octave.amplitude);
        join(Op::Add, range, [values[0].min(values[1]), values[0].max(values[1])])
    })
}

/// Of a polynomial for parameters from -1 to 1, a little further, too.
fn polynomial(coefficients: impl IntoIterator<Item = f64>) -> f64 {
    let mut power = 1.0;
    let mut sum = 0.0;
    for coefficient in coefficients.into_iter().take(TERMS) {
        sum += coefficient.abs() * power;
        power *= PAST;
    }
    sum
}

/// What bending may add to a density that is conserved fully.
fn bending(is_full: bool, overlap: Overlap) -> f64 {
    match (is_full, overlap) {
        (false, _) => 1.0,
        (true, Overlap::Closest) => 1.0 / LEAST_NARROWING,
        (true, _) => FADED,
    }
}

/// Of what is joined: parts of which each is at most `most`.
fn joined(overlap: Overlap, parts: f64, most: f64) -> f64 {
    if overlap == Overlap::Sum { parts * most } else { most }
}

/// Of tubes.
fn all(overlap: Overlap, tubes: impl Iterator<Item = f64>) -> f64 {
    let most = if overlap == Overlap::Sum { tubes.sum() } else { tubes.fold(0.0, f64::max) };
    most * (1.0 + ROUNDING)
}

impl Tube {
    fn bound(&self) -> f64 {
        let layers = self.layers.iter().fold([1.0; 2], |value, layer| {
            let pattern = match &layer.kind {
                LayerKind::Constant(constant) => [*constant; 2],
                LayerKind::Sectors => [0.0, 1.0],
                LayerKind::Perlin(perlin) => fractal(&perlin.sum),
            };
            join(layer.op, value, term(rounded(pattern), layer.threshold, layer.multiplier))
        });
        let spans = self.spans.iter().flatten();
        let gains = spans.map(|span| span.gain.map_or(1.0, polynomial));
        let points = self.points.iter().map(|point| point.section.gain);
        let gain = gains.chain(points).fold(0.0, f64::max).min(MOST_GAIN * (1.0 + ROUNDING));
        #[allow(clippy::cast_precision_loss, reason = "counts")]
        let feet = self.curve.segments().len() as f64 * FEET + self.points.len() as f64;
        let most = layers[1].max(0.0) * gain * bending(self.conserve == Conserve::Full, self.overlap);
        joined(self.overlap, feet, most)
    }
}

impl Field {
    /// A number that the density is nowhere above; single precision's rounding is allowed for.
    pub fn bound(&self) -> f64 {
        all(self.overlap, self.tubes.iter().map(Tube::bound))
    }

    /// A number that the density is nowhere above in the block that the region is narrowed to.
    pub fn bound_in<T: Scalar>(&self, region: &Region<T>) -> f64 {
        all(self.overlap, region.tubes.iter().map(|tube| region.bound(tube)))
    }
}

impl<T: Scalar> Region<T> {
    fn bound(&self, tube: &region::Tube<T>) -> f64 {
        let pieces = &self.pieces[tube.pieces[0]..tube.pieces[1]];
        let most = pieces.iter().map(|piece| {
            let [first, last] = piece.layers;
            let layers = self.layers[first..last].iter().fold([1.0; 2], |value, layer| {
                let pattern = match &layer.kind {
                    region::LayerKind::Constant(constant) => [constant.to_f64(); 2],
                    region::LayerKind::Sectors => [0.0, 1.0],
                    region::LayerKind::Perlin { sums, .. } => self.pattern(sums[1] - 1),
                };
                let threshold = layer.threshold.map(Scalar::to_f64);
                join(layer.op, value, term(rounded(pattern), threshold, layer.multiplier.to_f64()))
            });
            let gain = piece.gain.map_or(1.0, |gain| polynomial(gain.map(Scalar::to_f64)));
            layers[1].max(0.0) * gain * bending(piece.is_full, tube.overlap)
        });
        #[allow(clippy::cast_precision_loss, reason = "a count")]
        let parts = pieces.len() as f64;
        joined(tube.overlap, parts, most.fold(0.0, f64::max))
    }

    fn pattern(&self, sum: usize) -> Interval {
        let sum = &self.sums[sum];
        self.octaves[sum.octaves[0]..sum.octaves[1]]
            .iter()
            .fold([sum.mean.to_f64(); 2], |range, octave| join(Op::Add, range, octave.octave.range()))
    }
}
