//! Perlin noise, from the definition in the noise module, one corner at a time, and the numbers that hold its coordinates.

use super::smoothstep;
use std::ops::Add;

/// Improved Perlin noise over the integer hash at lattice point `cell + fraction`.
///
/// Every integer corner is taken modulo 2^32. `fraction` should lie in [0, 1].
pub fn perlin(cell: [i64; 3], fraction: [f64; 3], seed: u32) -> f64 {
    perlin_around(cell, fraction, seed, None)
}

/// The same on a lattice whose third index is taken modulo `period` first, a whole number from 1 to 2^32.
pub fn perlin_around(cell: [i64; 3], fraction: [f64; 3], seed: u32, period: Option<f64>) -> f64 {
    #[allow(clippy::cast_possible_truncation, reason = "a whole number up to 2^32")]
    let period = period.map(|cells| cells as i64);
    let mut sum = 0.0;
    for corner in 0..8_u32 {
        let (mut index, mut offset, mut weight) = ([0_u32; 3], [0.0; 3], 1.0);
        for axis in 0..3 {
            let up = corner >> axis & 1;
            let whole = cell[axis].wrapping_add(i64::from(up));
            index[axis] = modulo(period.filter(|_| axis == 2).map_or(whole, |cells| whole.rem_euclid(cells)));
            offset[axis] = fraction[axis] - f64::from(up);
            let t = 1.0 - offset[axis].abs();
            weight *= t * t * t * (10.0 - 15.0 * t + 6.0 * t * t);
        }
        let gradient = gradient(index, seed);
        sum += weight * (gradient[0] * offset[0] + gradient[1] * offset[1] + gradient[2] * offset[2]);
    }
    sum
}

/// What is left of an octave with this many lattice cells a voxel.
pub fn octave_weight(cells_per_voxel: f64) -> f64 {
    if cells_per_voxel <= 0.0 {
        return 1.0;
    }
    1.0 - smoothstep(libm::log2(0.7), libm::log2(1.6), libm::log2(cells_per_voxel))
}

fn modulo(i: i64) -> u32 {
    u32::try_from(i.rem_euclid(1 << 32)).expect("a remainder modulo 2^32")
}

/// One of the twelve edges of the cube.
fn gradient(corner: [u32; 3], seed: u32) -> [f64; 3] {
    let a = corner[0].wrapping_mul(0x9E37_79B1) ^ seed;
    let b = corner[1].wrapping_mul(0x85EB_CA77);
    let c = corner[2].wrapping_mul(0xC2B2_AE3D);
    let h = ((a ^ a >> 16) ^ (b ^ b >> 16) ^ (c ^ c >> 16)).wrapping_mul(0x27D4_EB2F);
    let (first, second) = match h.cast_signed() {
        i32::MIN..-715_827_882 => (0, 1),
        715_827_883.. => (1, 2),
        _ => (0, 2),
    };
    let mut gradient = [0.0; 3];
    gradient[first] = if h >> 22 & 1 == 1 { -1.0 } else { 1.0 };
    gradient[second] = if h >> 21 & 1 == 1 { -1.0 } else { 1.0 };
    gradient
}

pub(super) fn mix(mut x: u32) -> u32 {
    x ^= x >> 16;
    x = x.wrapping_mul(0x7FEB_352D);
    x ^= x >> 15;
    x = x.wrapping_mul(0x846C_A68B);
    x ^ x >> 16
}

/// The unevaluated sum of two doubles, which keeps the fraction of a lattice coordinate through products and
/// sums: relative error a few 2^-104 (Dekker, "A floating-point technique for extending the available
/// precision", 1971).
#[derive(Clone, Copy)]
pub(super) struct Exact {
    pub(super) high: f64,
    low: f64,
}

impl Exact {
    pub(super) fn new(high: f64) -> Exact {
        Exact { high, low: 0.0 }
    }

    pub(super) fn times(self, factor: f64) -> Exact {
        let product = self.high * factor;
        let ((a, b), (c, d)) = (halves(self.high), halves(factor));
        let error = (a * c - product) + a * d + b * c + b * d;
        renormalised(product, error + self.low * factor)
    }

    pub(super) fn product(self, other: Exact) -> Exact {
        self.times(other.high) + self.times(other.low)
    }

    /// The quotient by a double.
    pub(super) fn over(self, divisor: f64) -> Exact {
        let quotient = self.high / divisor;
        let rest = self + Exact::new(divisor).times(-quotient);
        renormalised(quotient, rest.high / divisor)
    }

    /// The nearest double.
    pub(super) fn value(self) -> f64 {
        self.high
    }

    /// The integer part as a number modulo `modulus`, up to 2^32, and the rest, in [0, 1].
    pub(super) fn split(self, modulus: f64) -> (i64, f64) {
        let floor = self.high.floor();
        let rest = (self.high - floor) + self.low;
        (wrapped(floor, modulus) + wrapped(rest.floor(), modulus), rest - rest.floor())
    }
}

impl Add for Exact {
    type Output = Exact;
    fn add(self, other: Exact) -> Exact {
        let sum = self.high + other.high;
        let back = sum - self.high;
        let error = (self.high - (sum - back)) + (other.high - back);
        renormalised(sum, error + (self.low + other.low))
    }
}

/// Two doubles of at most 26 bits each whose sum is x.
fn halves(x: f64) -> (f64, f64) {
    let scaled = 134_217_729.0 * x;
    let high = scaled - (scaled - x);
    (high, x - high)
}

fn renormalised(high: f64, low: f64) -> Exact {
    let sum = high + low;
    Exact { high: sum, low: low - (sum - high) }
}

/// A whole number modulo another up to 2^32, 0 where it is not finite.
#[allow(clippy::cast_possible_truncation, reason = "whole and below 2^32 in magnitude, or not a number")]
fn wrapped(x: f64, modulus: f64) -> i64 {
    libm::fmod(x, modulus) as i64
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "what is not there fails the test")]
mod tests {
    use super::super::pattern::fbm;
    use super::super::tests::Random;
    use super::*;
    use crate::scene::{Fbm, Form, Space};

    const TWO_32: f64 = 4_294_967_296.0;

    fn plain() -> Fbm {
        Fbm {
            frequency: [1.0; 3],
            octaves: 1,
            lacunarity: 2.0,
            gain: 0.5,
            normalise: false,
            seed: 3,
            scrolled: [0.0; 3],
            form: Form::Fbm,
            rotate: false,
            warp: None,
            space: Space::Cylinder,
            offset: [0.0; 3],
        }
    }

    fn any_cell(random: &mut Random) -> [i64; 3] {
        #[allow(clippy::cast_possible_truncation, reason = "below 1e6")]
        random.point(1e6).map(|x| x as i64)
    }

    #[test]
    fn is_bounded_with_mean_zero_and_the_known_spread() {
        let mut random = Random(1);
        let (count, mut sum, mut squares, mut largest) = (400_000, 0.0, 0.0, 0.0_f64);
        for _ in 0..count {
            let n = perlin(any_cell(&mut random), [0; 3].map(|_| random.unit()), 5);
            largest = largest.max(n.abs());
            sum += n;
            squares += n * n;
        }
        let (mean, rms) = (sum / f64::from(count), (squares / f64::from(count)).sqrt());
        assert!(largest <= 1.036_353_81, "{largest}");
        // The largest of that many samples: a gradient that is too short would stay below.
        assert!(largest > 0.85, "{largest}");
        // Four standard errors of the mean, and as many of a spread.
        assert!(mean.abs() < 4.0 * rms / f64::from(count).sqrt(), "{mean}");
        // Twelve edges make E g_i g_j = 2/3 where i = j, else 0, and corners are independent: with the blend
        // w, the mean square is 16 (integral of w^2 x^2) (integral of w^2)^2 = 16 (535 / 18018) (181 /
        // 462)^2. Sampling leaves 0.2 % to it.
        assert!((rms - 0.270_035).abs() < 0.002, "{rms}");
    }

    #[test]
    fn every_edge_of_the_cube_is_as_frequent() {
        let mut counts = [[[0_u32; 3]; 3]; 3];
        let mut random = Random(2);
        let count = 120_000;
        for _ in 0..count {
            let g = gradient(any_cell(&mut random).map(modulo), 9);
            #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "0, 1 or 2")]
            let [a, b, c] = g.map(|x| (x + 1.0) as usize);
            counts[a][b][c] += 1;
        }
        let found: Vec<u32> =
            counts.as_flattened().as_flattened().iter().copied().filter(|&n| n > 0).collect();
        assert_eq!(found.len(), 12);
        for n in found {
            // Expected 10 000, standard deviation 96.
            assert!(n.abs_diff(10_000) < 500, "{n}");
        }
    }

    #[test]
    fn vanishes_on_the_lattice_and_joins_across_cells() {
        let mut random = Random(3);
        for _ in 0..1000 {
            let cell = any_cell(&mut random);
            assert!(perlin(cell, [0.0; 3], 1).abs() < 1e-300);
            let (y, z) = (random.unit(), random.unit());
            let next = [cell[0] + 1, cell[1], cell[2]];
            let (left, right) = (perlin(cell, [1.0, y, z], 1), perlin(next, [0.0, y, z], 1));
            assert!((left - right).abs() < 1e-15, "{left} against {right}");
        }
        let wrapped = perlin([5 - (1 << 32), -1, 1 << 40], [0.3; 3], 1);
        assert!((wrapped - perlin([5, (1 << 32) - 1, 0], [0.3; 3], 1)).abs() < 1e-300);
    }

    /// Hashes worked out with big integers, outside of this program.
    #[test]
    fn hashes_as_defined() {
        // 0: between the thresholds, no sign bit.
        assert_eq!(gradient([0, 0, 0], 0), [1.0, 0.0, 1.0]);
        // 0x82C3839A, below the lower threshold, with bit 22.
        assert_eq!(gradient([1, 0, 0], 0), [-1.0, 1.0, 0.0]);
        // 0x4977D1A4, above the upper one, with both bits.
        assert_eq!(gradient([0, 1, 0], 0), [0.0, -1.0, -1.0]);
        // 0xE422E13B, between them, with bit 21.
        assert_eq!(gradient([3, 0, 0], 0), [1.0, 0.0, -1.0]);
        // 0x3A162AE4 and 0x6AA1C929.
        assert_eq!(gradient([u32::MAX, 2, 3], 77), [0.0, 1.0, 1.0]);
        assert_eq!(gradient([5, 6, 7], 0xDEAD_BEEF), [0.0, 1.0, -1.0]);
    }

    #[test]
    fn sums_octaves_as_defined() {
        let noise = Fbm { octaves: 3, normalise: true, gain: 0.25, scrolled: [0.375, 0.0, -0.75], ..plain() };
        let p = [0.3, -1.7, 2.2];
        let mut sum = 0.0;
        for k in 0..3_u32 {
            let base = 3_u32.wrapping_mul(0x9E37_79B9).wrapping_add(4 * k);
            let scale = f64::from(1_u32 << k);
            let (mut cell, mut fraction) = ([0; 3], [0.0; 3]);
            for axis in 0..3 {
                let salt = 1 + u32::try_from(axis).unwrap();
                let offset = f64::from(mix(base.wrapping_add(salt))) / 4_294_967_296.0;
                let x = p[axis] * scale - noise.scrolled[axis] * scale + offset;
                #[allow(clippy::cast_possible_truncation, reason = "small")]
                let floor = x.floor() as i64;
                (cell[axis], fraction[axis]) = (floor, x - x.floor());
            }
            sum += perlin(cell, fraction, mix(base)) / f64::from(1_u32 << (2 * k));
        }
        let wanted = sum / (1.0 + 0.25 + 0.0625);
        let found = fbm(&noise, p, None);
        assert!((found - wanted).abs() < 1e-14, "{found} against {wanted}");
        assert_eq!(fbm(&Fbm { octaves: 0, ..noise }, p, None), 0.0);
    }

    /// A billion cells away, a pattern moved by a whole number of cells: the fraction comes through
    /// unrounded.
    #[test]
    fn keeps_fractions_far_from_the_origin() {
        let mut coordinate = Exact::new(0.1).times(1e10) + Exact::new(0.25);
        // 0.1 as a double is 0.1 + 0.1 * 2^-54.2..., here exactly 3602879701896397 / 2^55.
        let exact = 3_602_879_701_896_397_u128 * 10_000_000_000 + (1 << 53);
        let (cell, fraction) = coordinate.split(TWO_32);
        assert_eq!(u128::try_from(cell).unwrap(), exact >> 55);
        let wanted = f64::from(u32::try_from((exact >> 23) & 0xFFFF_FFFF).unwrap()) / 4_294_967_296.0;
        assert!((fraction - wanted).abs() < 2.4e-10, "{fraction} against {wanted}");
        // The sum of a large and a small number, both ways round.
        coordinate = Exact::new(-1e9) + Exact::new(0.1);
        let (cell, fraction) = coordinate.split(TWO_32);
        assert_eq!(cell, -1_000_000_000);
        assert!((fraction - 0.1).abs() < 1e-16);
        let coordinate = Exact::new(1e-20) + Exact::new(-1e30);
        assert_eq!(coordinate.split(TWO_32).1, 1e-20);
    }

    #[test]
    fn faded_octaves_leave_the_rest() {
        let noise = Fbm { octaves: 6, ..plain() };
        let p = [0.3, 0.4, 0.9];
        // Octave k has 0.3 2^k cells a voxel: k = 0 and 1 are whole, k = 2 is on its way, the rest is gone.
        let found = fbm(&noise, p, Some(0.3));
        let [one, two, three] = [1, 2, 3].map(|octaves| fbm(&Fbm { octaves, ..noise.clone() }, p, None));
        let weight = octave_weight(1.2);
        assert!(weight > 0.0 && weight < 1.0 && one != two);
        assert!((found - (two + weight * (three - two))).abs() < 1e-15);
        let normalised = fbm(&Fbm { normalise: true, ..noise }, p, Some(0.3));
        assert!((normalised - found / (2.0 - 1.0 / 32.0)).abs() < 1e-15);
    }
}
