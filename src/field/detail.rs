//! Narrowing a noise layer to a piece of a tube in a block: which octaves matter there, and where they are.

use super::narrow::Block;
use super::pattern::{Fractal, Octave, Perlin};
use super::region::{self, Layer, LayerKind, Region, Sum, round};
use super::tube::{self, Tube};
use crate::noise::{self, BAND, band_weight};
use crate::num::Scalar;
use crate::scene::Space;

/// Octaves of more cells than this per voxel, along the tube or in the world, are left out: single precision cannot place
/// a voxel in them.
const FINEST: f64 = 524_288.0;

/// What rounding to single precision may add to a sum of octaves, relative to its size: 32 octaves and their own errors.
const ROUNDING: f64 = 1e-5;

/// Relative margin of squared cells per voxel by which the kernel's rounding cannot change a weight that is 0 or 1.
const SURE: f64 = 2e-4;

/// A piece of a tube's axis in a block.
#[derive(Debug, Clone, Copy)]
pub(super) struct Place {
    /// Bounds of the tube's radius, metres, both above 0.
    pub(super) radius: [f64; 2],
    /// The arc length that heights are taken from.
    pub(super) origin: f64,
    /// Bounds of how far its voxels are from the axis, metres: the lower may be negative.
    pub(super) away: [f64; 2],
    pub(super) block: Block,
    pub(super) octave_fade: bool,
}

impl Place {
    /// The tube's layers there, and whether octaves fade and world coordinates are needed.
    pub(super) fn layers<T: Scalar>(&self, tube: &Tube, region: &mut Region<T>) -> ([usize; 2], [bool; 2]) {
        let first = region.layers.len();
        let (mut fades, mut in_world) = (false, false);
        for layer in &tube.layers {
            let kind = match &layer.kind {
                tube::LayerKind::Constant(value) => LayerKind::Constant(T::from_f64(*value)),
                tube::LayerKind::Sectors => LayerKind::Sectors,
                tube::LayerKind::Perlin(perlin) => {
                    let kind = self.perlin(tube, perlin, region, &mut fades);
                    in_world |= matches!(kind, LayerKind::Perlin { in_world: true, .. });
                    if let (Some(threshold), Some(sum)) = (layer.threshold, region.sums.last_mut()) {
                        give_up(threshold, &perlin.first, sum, &region.octaves);
                    }
                    kind
                }
            };
            let threshold = layer.threshold.map(T::from_f64);
            let multiplier = T::from_f64(layer.multiplier);
            region.layers.push(Layer { op: layer.op, kind, threshold, multiplier });
        }
        ([first, region.layers.len()], [fades, in_world])
    }

    /// The layer there; `fades` becomes true where octaves fade from voxel to voxel.
    fn perlin<T: Scalar>(
        &self,
        tube: &Tube,
        perlin: &Perlin,
        region: &mut Region<T>,
        fades: &mut bool,
    ) -> LayerKind<T> {
        let first = region.sums.len();
        let in_world = perlin.space == Space::World;
        let mut displaced = [false; 3];
        if let Some(warp) = &perlin.warp {
            // In the world the kernel's unit is the voxel.
            let unit = if in_world { self.block.h } else { 1.0 };
            for (axis, sum) in warp.sums.iter().enumerate() {
                displaced[axis] = warp.reach[axis] > 0.0;
                if displaced[axis] {
                    let reach = T::from_f64(warp.reach[axis] / unit);
                    let sum = self.sum(tube, perlin.space, sum, region);
                    region.sums.push(Sum { displaces: Some((axis, reach)), ..sum });
                }
            }
        }
        let sum = self.sum(tube, perlin.space, &perlin.sum, region);
        region.sums.push(Sum { displaced, ..sum });
        *fades |= region.sums[first..].iter().any(|sum| sum.fading[0] < sum.fading[1]);
        LayerKind::Perlin { sums: [first, region.sums.len()], in_world }
    }

    fn sum<T: Scalar>(&self, tube: &Tube, space: Space, sum: &Fractal, region: &mut Region<T>) -> Sum<T> {
        let h = self.block.h;
        let rates = Rates::new(tube, sum, h);
        let band = match (self.octave_fade, space) {
            (false, _) => [0.0; 2],
            (true, Space::Cylinder) => rates.band(self.radius, self.away, h),
            (true, Space::World) => [square_in_world(sum, h); 2],
        };
        let start = region.octaves.len();
        let mut mean = sum.mean;
        let mut fading = [0; 2];
        for octave in &sum.octaves {
            let octave_mean = sum.form.mean() * octave.amplitude;
            let finer = octave.finer;
            if band[0] * finer > BAND[1] * (1.0 + SURE) || !is_placed(octave, tube, space, h) {
                mean += octave_mean;
                continue;
            }
            let is_faded = band[1] * finer > BAND[0] * (1.0 - SURE);
            let (mut steps, mut at, mut amplitude) = (octave.steps, octave.origin, octave.amplitude);
            let (placed, fades) = match space {
                Space::Cylinder => {
                    for axis in 0..3 {
                        at[axis] += steps[axis][2] * self.origin * tube.height_rate();
                    }
                    (octave.template.as_ref().map(|octave| octave.moved(at[2])), is_faded)
                }
                Space::World => {
                    // The rate is the same everywhere, so the fade is but a smaller amplitude.
                    let weight = band_weight((), band[0] * finer, 1.0);
                    amplitude *= weight;
                    mean += octave_mean * (1.0 - weight);
                    for axis in 0..3 {
                        let [x, y, z] = steps[axis];
                        let centre = self.block.centre;
                        at[axis] += x * centre.x + y * centre.y + z * centre.z;
                        steps[axis] = [x * h, y * h, z * h];
                    }
                    (None, false)
                }
            };
            let octave = placed.unwrap_or_else(|| {
                noise::Octave::turned(at, steps, octave.period, sum.form, octave.seed, amplitude)
            });
            let number = fading[1] - fading[0];
            if fades {
                let index = region.octaves.len() - start;
                fading = if number == 0 { [index, index + 1] } else { [fading[0], index + 1] };
            }
            region.octaves.push(region::Octave { octave, fades, finer: T::from_f64(0.5 * finer), number });
        }
        Sum {
            octaves: [start, region.octaves.len()],
            fading,
            first: region.octaves.len() - start,
            least: T::default(),
            rates: round([rates.across, rates.along, rates.twist].map(|rate| rate * rate)),
            mean: T::from_f64(mean),
            is_plain: region.octaves[start..].iter().all(|octave| octave.octave.is_plain()),
            displaces: None,
            displaced: [false; 3],
        }
    }
}

/// Finds after which octave, and below which value of the sum so far, a sum that is compared with a threshold is not carried on:
/// `after[n]` is how many of n octaves are summed first.
fn give_up<T: Scalar>(threshold: f64, after: &[usize], sum: &mut Sum<T>, octaves: &[region::Octave<T>]) {
    let octaves = &octaves[sum.octaves[0]..sum.octaves[1]];
    let first = after[octaves.len()];
    let (mut size, mut rise) = (sum.mean.to_f64().abs() + threshold.abs(), 0.0);
    for (index, octave) in octaves.iter().enumerate() {
        let [low, high] = octave.octave.range();
        size += high.max(-low);
        if index >= first {
            rise += high;
        }
    }
    sum.first = first;
    sum.least = T::from_f64(threshold - ROUNDING * size - rise);
}

/// Whether single precision can place a voxel of edge `h` in the octave, along the tube or in the world.
pub(super) fn is_placed(octave: &Octave, tube: &Tube, space: Space, h: f64) -> bool {
    match space {
        Space::Cylinder => octave.frequency[2] * tube.height_rate() * h <= FINEST,
        Space::World => octave.frequency.iter().all(|f| f * h <= FINEST),
    }
}

/// Square of the first octave's cells per voxel of a pattern over the world's coordinates.
pub(super) fn square_in_world(sum: &Fractal, h: f64) -> f64 {
    let rate = sum.frequency.iter().fold(0.0, |most: f64, f| most.max(*f)) * h;
    rate * rate
}

/// First-octave cells per voxel.
pub(super) struct Rates {
    /// Across the tube, at a radius of one voxel.
    across: f64,
    /// Along it.
    along: f64,
    /// Along it, by twist, at the surface.
    twist: f64,
}

impl Rates {
    pub(super) fn new(tube: &Tube, fractal: &Fractal, h: f64) -> Rates {
        let across = fractal.frequency[0].max(fractal.frequency[1]);
        Rates {
            across,
            along: fractal.frequency[2] * tube.height_rate() * h,
            twist: across * tube.twist_rate * h,
        }
    }

    /// Bounds of the square of cells per voxel where the radius is from `least` to `most`, at the distances `away` from the axis.
    pub(super) fn band(&self, [least, most]: [f64; 2], away: [f64; 2], h: f64) -> [f64; 2] {
        // Of the radius at most, where the tube ends.
        let out = [(away[0] / most).clamp(0.0, 1.0), (away[1] / least).min(1.0)];
        [
            larger_square(self.across * h / most, self.twist * out[0], self.along),
            larger_square(self.across * h / least, self.twist * out[1], self.along),
        ]
    }
}

/// Of the singular values of `[a c; 0 b]`.
fn larger_square(a: f64, c: f64, b: f64) -> f64 {
    let sum = a * a + b * b + c * c;
    0.5 * (sum + (sum * sum - 4.0 * a * a * b * b).max(0.0).sqrt())
}
