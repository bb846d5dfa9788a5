//! Fractal sums, from the definition in the noise module: coordinates of twice double precision throughout, loops in whole
//! numbers, turns by quaternions.

use super::noise::{Exact, mix, octave_weight, perlin_around};
use crate::scene::{Fbm, Form};

/// Mean of |n|: measured with another generator of gradients, 6e8 places, standard error 6e-6.
const MEAN_MAGNITUDE: f64 = 0.220_17;
/// Mean of n^2: 16 (535 / 18018) (181 / 462)^2.
const MEAN_SQUARE: f64 = 35054270.0 / 480729249.0;
/// Along axes of lower frequency a warp does nothing.
const LEAST_FREQUENCY: f64 = 1e-9;

/// Where a pattern is asked for.
pub(super) struct Ground<'a> {
    /// The pattern's coordinates.
    pub(super) position: [f64; 3],
    /// What the third coordinate grows by around a closed tube.
    pub(super) around: Option<f64>,
    /// `h sigma` of the field module's definition for a frequency; `None` where octaves do not fade.
    pub(super) cells_per_voxel: &'a dyn Fn([f64; 3]) -> Option<f64>,
}

/// A fractal sum at coordinates that are not closed.
///
/// `cells_per_voxel`, where given, is `h sigma` of the field module's definition, for the warp too: octave k is weighted
/// by what is left of it at `lac^k` times as many cells a voxel.
pub fn fbm(noise: &Fbm, position: [f64; 3], cells_per_voxel: Option<f64>) -> f64 {
    let cells_per_voxel = |_: [f64; 3]| cells_per_voxel;
    pattern(noise, &Ground { position, around: None, cells_per_voxel: &cells_per_voxel })
}

/// A layer's pattern.
pub(super) fn pattern(noise: &Fbm, ground: &Ground) -> f64 {
    let mut place = [0, 1, 2].map(|axis| Exact::new(ground.position[axis]) + Exact::new(noise.offset[axis]));
    let first = rates(noise.frequency, Exact::new(1.0), ground.around);
    if let Some(warp) = &noise.warp {
        let still = place;
        for (axis, salt) in (0..3).zip(0x68E3_1DA4..) {
            if noise.frequency[axis] < LEAST_FREQUENCY {
                continue;
            }
            let sum = Fbm {
                frequency: warp.frequency,
                octaves: warp.octaves,
                lacunarity: warp.lacunarity,
                gain: warp.gain,
                normalise: true,
                seed: mix(warp.seed ^ salt),
                form: Form::Fbm,
                ..noise.clone()
            };
            let pace = |axis: usize, _: Exact, rate: Rate| {
                if noise.frequency[axis] < LEAST_FREQUENCY {
                    return Exact::new(0.0);
                }
                rate.cells.over(rate.units).times(first[axis].units).over(first[axis].cells.high)
            };
            let cells = sum_at(&sum, still, &pace, ground) * warp.amplitude;
            let moved = Exact::new(cells).times(first[axis].units).over(first[axis].cells.high);
            place[axis] = place[axis] + moved;
        }
    }
    let pace = |axis: usize, power: Exact, rate: Rate| match ground.around {
        Some(_) if axis == 2 && noise.frequency[2] > 0.0 => rate.cells.over(first[2].cells.high),
        _ => power,
    };
    sum_at(noise, place, &pace, ground)
}

/// So many cells in so many units.
#[derive(Clone, Copy)]
struct Rate {
    cells: Exact,
    units: f64,
}

/// The rates of an octave of `power` times the first one's frequency.
fn rates(frequency: [f64; 3], power: Exact, around: Option<f64>) -> [Rate; 3] {
    let mut rates = frequency.map(|f| Rate { cells: power.times(f), units: 1.0 });
    if let (Some(around), true) = (around, frequency[2] > 0.0) {
        let cells = rates[2].cells.times(around).high.round().max(1.0);
        rates[2] = Rate { cells: Exact::new(cells), units: around };
    }
    rates
}

/// A sum at a place. `pace` says how many cells an octave moves along an axis while the first moves one, given the power of
/// the lacunarity and the octave's rate.
fn sum_at(
    noise: &Fbm,
    place: [Exact; 3],
    pace: &dyn Fn(usize, Exact, Rate) -> Exact,
    ground: &Ground,
) -> f64 {
    let cells_per_voxel = (ground.cells_per_voxel)(noise.frequency);
    let (mut power, mut amplitude) = (Exact::new(1.0), 1.0);
    let (mut sum, mut total) = (0.0, 0.0);
    for k in 0..noise.octaves {
        let weight = cells_per_voxel.map_or(1.0, |cells| octave_weight(cells * power.high));
        let mean = formed(noise.form, None);
        let mut value = mean;
        if weight > 0.0 {
            let base = noise.seed.wrapping_mul(0x9E37_79B9).wrapping_add(4 * k);
            let rates = rates(noise.frequency, power, ground.around);
            let mut at = [0, 1, 2].map(|axis| {
                let still = place[axis].product(rates[axis].cells).over(rates[axis].units);
                let moved = Exact::new(-noise.scrolled[axis]);
                still + moved.product(pace(axis, power, rates[axis]))
            });
            if noise.rotate {
                at = turned(at, quaternion(k, ground.around.is_some()));
            }
            let is_loop = ground.around.is_some() && noise.frequency[2] > 0.0;
            let period = is_loop.then_some(rates[2].cells.high);
            let (mut cell, mut fraction) = ([0; 3], [0.0; 3]);
            for (axis, salt) in (0..3).zip(1..) {
                let offset = f64::from(mix(base.wrapping_add(salt))) / 4_294_967_296.0;
                let modulus = period.filter(|_| axis == 2).unwrap_or(4_294_967_296.0);
                (cell[axis], fraction[axis]) = (at[axis] + Exact::new(offset)).split(modulus);
            }
            // Past the largest double every point is a corner of the lattice, where the noise is 0.
            let n = if fraction.iter().all(|t| t.is_finite()) {
                perlin_around(cell, fraction, mix(base), period)
            } else {
                0.0
            };
            value = mean + weight * (formed(noise.form, Some(n)) - mean);
        }
        sum += amplitude * value;
        total += amplitude;
        amplitude *= noise.gain;
        power = power.times(noise.lacunarity);
    }
    if noise.normalise && total > 0.0 { sum / total } else { sum }
}

/// What the form makes of n; without one, the mean.
fn formed(form: Form, n: Option<f64>) -> f64 {
    let magnitude = n.map_or(MEAN_MAGNITUDE, f64::abs);
    match (form, n) {
        (Form::Fbm, n) => n.unwrap_or(0.0),
        (Form::Billow, _) => magnitude,
        (Form::Ridged, Some(_)) => (1.0 - magnitude) * (1.0 - magnitude),
        (Form::Ridged, None) => 1.0 - 2.0 * magnitude + MEAN_SQUARE,
    }
}

/// The quaternion that turns octave `k`, not of length 1: whole numbers (w, x, y, z).
fn quaternion(k: u32, about_third: bool) -> [f64; 4] {
    let candidate = |j: u32| {
        let bits = mix(0x51ED_270B_u32.wrapping_add(256 * k).wrapping_add(j));
        let part = |i: u32| 2.0 * f64::from(bits >> (8 * i) & 255) - 255.0;
        if about_third { [part(0), 0.0, 0.0, part(3)] } else { [part(0), part(1), part(2), part(3)] }
    };
    let is_fit = |q: &[f64; 4]| {
        let axes = if about_third { 2 } else { 3 };
        let length = squared_length(*q);
        let unit = |axis: usize| [0, 1, 2].map(|i| Exact::new(f64::from(u8::from(i == axis))));
        let entries = (0..axes).flat_map(|axis| conjugated(unit(axis), *q).into_iter().take(axes));
        (16384.0..=65025.0).contains(&length)
            && entries.map(Exact::value).all(|m| 10.0 * m.abs() <= 9.0 * length)
    };
    (0..).map(candidate).find(is_fit).expect("many quaternions will do")
}

fn squared_length(q: [f64; 4]) -> f64 {
    q.iter().map(|x| x * x).sum()
}

fn turned(v: [Exact; 3], q: [f64; 4]) -> [Exact; 3] {
    conjugated(v, q).map(|x| x.over(squared_length(q)))
}

/// `q v q*` by two of Hamilton's products.
fn conjugated(v: [Exact; 3], [w, x, y, z]: [f64; 4]) -> [Exact; 3] {
    let sum = |terms: [(Exact, f64); 4]| {
        terms.into_iter().fold(Exact::new(0.0), |sum, (part, factor)| sum + part.times(factor))
    };
    let [i, j, k] = v;
    let none = Exact::new(0.0);
    let real = sum([(none, w), (i, -x), (j, -y), (k, -z)]);
    let first = sum([(none, x), (i, w), (k, y), (j, -z)]);
    let second = sum([(none, y), (j, w), (i, z), (k, -x)]);
    let third = sum([(none, z), (k, w), (j, x), (i, -y)]);
    [
        sum([(real, -x), (first, w), (second, -z), (third, y)]),
        sum([(real, -y), (second, w), (third, -x), (first, z)]),
        sum([(real, -z), (third, w), (first, -y), (second, x)]),
    ]
}
