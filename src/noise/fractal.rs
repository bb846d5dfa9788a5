//! Sums of octaves.

use super::Form;
use super::perlin::{Cell, Period, third_hash};
use crate::num::{Real, Scalar};

/// One octave, ready for a block: the lattice coordinate is `cell + shift + steps p`.
#[derive(Debug, Clone, Copy)]
pub struct Octave<T> {
    cell: [u32; 3],
    shift: [T; 3],
    steps: [[T; 3]; 3],
    /// Neither turned nor periodic, and fBm.
    is_plain: bool,
    period: Option<Period<T>>,
    form: Form,
    seed: u32,
    amplitude: T,
    /// Amplitude times the form's mean.
    mean: T,
}

impl<T: Scalar> Octave<T> {
    /// The octave whose lattice coordinate at p = 0 is `origin`, and which changes by `scale` per unit of p.
    ///
    /// The whole part of `origin` is taken modulo 2^32; its remainder keeps the precision that `origin` has.
    pub fn new(origin: [f64; 3], scale: [f64; 3], seed: u32, amplitude: f64) -> Octave<T> {
        let [x, y, z] = scale;
        let steps = [[x, 0.0, 0.0], [0.0, y, 0.0], [0.0, 0.0, z]];
        Octave::turned(origin, steps, None, Form::Fbm, seed, amplitude)
    }

    /// The same of any form, with lattice coordinate i changing by `steps[i][j]` per unit of `p[j]`, on a lattice that
    /// repeats after `period` cells, a whole number from 1 to 2^22, along its third axis.
    pub fn turned(
        origin: [f64; 3],
        steps: [[f64; 3]; 3],
        period: Option<f64>,
        form: Form,
        seed: u32,
        amplitude: f64,
    ) -> Octave<T> {
        let floor = origin.map(f64::floor);
        let period = period.map(|cells| Period {
            cells: T::from_f64(cells),
            first: T::from_f64(floor[2].rem_euclid(cells)),
        });
        let across = [steps[0][1], steps[0][2], steps[1][0], steps[1][2], steps[2][0], steps[2][1]];
        Octave {
            cell: floor.map(Real::lattice),
            shift: [0, 1, 2].map(|i| T::from_f64(origin[i] - floor[i])),
            steps: steps.map(|row| row.map(T::from_f64)),
            is_plain: across == [0.0; 6] && period.is_none() && form == Form::Fbm,
            period,
            form,
            seed,
            amplitude: T::from_f64(amplitude),
            mean: T::from_f64(amplitude * form.mean()),
        }
    }

    /// Neither turned nor periodic, and fBm: [`Octave::cell`] and [`Octave::at`] are in less time what they are of any.
    pub fn is_plain(&self) -> bool {
        self.is_plain
    }

    /// Its value at p, amplitude included.
    #[inline(always)]
    pub fn value<R: Real<Scalar = T>>(&self, token: R::Token, p: [R; 3]) -> R {
        self.at::<R, false>(token, &self.cell::<R, false>(token, p))
    }

    /// Where p lies in its lattice. `PLAIN` only where it is known to be.
    #[inline(always)]
    pub fn cell<R: Real<Scalar = T>, const PLAIN: bool>(&self, token: R::Token, p: [R; 3]) -> Cell<R> {
        let (steps, shift) = (&self.steps, &self.shift);
        let mut at = [
            p[0] * R::splat(token, steps[0][0]) + R::splat(token, shift[0]),
            p[1] * R::splat(token, steps[1][1]) + R::splat(token, shift[1]),
            p[2] * R::splat(token, steps[2][2]) + R::splat(token, shift[2]),
        ];
        let mut period = None;
        if !(PLAIN || self.is_plain) {
            at[0] = at[0] + p[1] * R::splat(token, steps[0][1]) + p[2] * R::splat(token, steps[0][2]);
            at[1] = at[1] + p[0] * R::splat(token, steps[1][0]) + p[2] * R::splat(token, steps[1][2]);
            at[2] = at[2] + p[0] * R::splat(token, steps[2][0]) + p[1] * R::splat(token, steps[2][1]);
            period = self.period;
        }
        let zs = third_hash(token, self.cell[2], at[2], period);
        Cell::new(token, [self.cell[0], self.cell[1]], at, zs, self.seed)
    }

    /// Its value in a place of its lattice, amplitude included.
    #[inline(always)]
    pub fn at<R: Real<Scalar = T>, const PLAIN: bool>(&self, token: R::Token, cell: &Cell<R>) -> R {
        let mut n = cell.noise(token);
        if !(PLAIN || self.is_plain) {
            n = self.form.of(token, n);
        }
        n * R::splat(token, self.amplitude)
    }

    /// Least and greatest values, faded or not.
    pub fn range(&self) -> [f64; 2] {
        self.form.range().map(|value| value * self.amplitude.to_f64())
    }

    /// What is left of a value that has faded to `weight`.
    #[inline(always)]
    pub fn faded<R: Real<Scalar = T>>(&self, token: R::Token, value: R, weight: R) -> R {
        match self.form {
            Form::Fbm => value * weight,
            Form::Billow | Form::Ridged => {
                let mean = R::splat(token, self.mean);
                mean + weight * (value - mean)
            }
        }
    }
}

impl Octave<f64> {
    /// The same octave with the third lattice coordinate `origin` at p = 0: what [`Octave::turned`] makes of that, in less time.
    pub fn moved<T: Scalar>(&self, origin: f64) -> Octave<T> {
        let floor = origin.floor();
        let period = self.period.map(|period| Period {
            cells: T::from_f64(period.cells),
            first: T::from_f64(floor.rem_euclid(period.cells)),
        });
        Octave {
            cell: [self.cell[0], self.cell[1], floor.lattice()],
            shift: [self.shift[0], self.shift[1], origin - floor].map(T::from_f64),
            steps: self.steps.map(|row| row.map(T::from_f64)),
            is_plain: self.is_plain,
            period,
            form: self.form,
            seed: self.seed,
            amplitude: T::from_f64(self.amplitude),
            mean: T::from_f64(self.mean),
        }
    }
}

/// Seed of octave `k` of a sum with the seed `s`.
pub fn octave_seed(s: u32, k: u32) -> u32 {
    scramble(s.wrapping_mul(0x9E37_79B9).wrapping_add(4 * k))
}

/// Offset of octave `k` in cells, each in [0, 1): without it all octaves would vanish together at the origin.
pub fn octave_offset(s: u32, k: u32) -> [f64; 3] {
    let start = s.wrapping_mul(0x9E37_79B9).wrapping_add(4 * k + 1);
    [0, 1, 2].map(|axis| f64::from(scramble(start.wrapping_add(axis))) / 4_294_967_296.0)
}

/// Seed of the displacement along `axis` by a warp with the seed `s`.
pub fn warp_seed(s: u32, axis: u32) -> u32 {
    scramble(s ^ (0x68E3_1DA4 + axis))
}

/// A bijective mix of 32 bits (the constants are those of Wellons' `lowbias32`, 2018).
pub(super) fn scramble(mut x: u32) -> u32 {
    x ^= x >> 16;
    x = x.wrapping_mul(0x7FEB_352D);
    x ^= x >> 15;
    x = x.wrapping_mul(0x846C_A68B);
    x ^ (x >> 16)
}

/// Squares of the cells per voxel from which an octave fades, and of those at which it is gone.
///
/// Between one and one and a half cells per voxel an octave does as much harm as good against the field filtered to
/// the voxel; the fade is centred there.
pub const BAND: [f64; 2] = [0.7 * 0.7, 1.6 * 1.6];

/// Weight of an octave where the square of its cells per voxel is `a / b`, with a at least 0 and b above: 1 below the band,
/// 0 above it, and between them a smoothstep of the logarithm, to an absolute error below 1e-6.
///
/// With c the square in the band's middle, `log (b c / a) = 2 artanh t` where `t = (b c - a) / (b c + a)`. So the weight is a
/// half and an odd function of t, whose singularities at 1 and -1 lie far from the band, which ends at -0.39 and 0.39.
#[inline(always)]
pub fn band_weight<R: Real>(token: R::Token, a: R, b: R) -> R {
    const MIDDLE: f64 = 0.7 * 1.6;
    const END: f64 = (BAND[1] - MIDDLE) / (BAND[1] + MIDDLE);
    // Interpolates at five Chebyshev points of t^2, to 3e-7, and is 4e-7 too steep: it reaches 0 and 1 before the ends.
    const SERIES: [f64; 5] = [1.814_490_074, -2.935_096_472, -3.188_083_469, -2.853_204_031, -4.189_266_612];
    let middle = b * R::constant(token, MIDDLE);
    // Where `a` overflowed this is not a number, which becomes the band's upper end.
    let t = (middle - a) / (middle + a);
    let t = t.within(R::constant(token, -END), R::constant(token, END));
    let t2 = t * t;
    let mut sum = R::constant(token, SERIES[4]);
    for k in (0..4).rev() {
        sum = sum * t2 + R::constant(token, SERIES[k]);
    }
    (R::constant(token, 0.5) + t * sum).within(R::constant(token, 0.0), R::constant(token, 1.0))
}
