//! Sums of octaves.

use super::perlin;
use crate::num::{Real, Scalar};

/// One octave, ready for a block: the lattice coordinate is `cell + shift + scale * p`.
#[derive(Debug, Clone, Copy)]
pub struct Octave<T> {
    cell: [u32; 3],
    shift: [T; 3],
    scale: [T; 3],
    seed: u32,
    amplitude: T,
}

impl<T: Scalar> Octave<T> {
    /// The octave whose lattice coordinate at p = 0 is `origin`, and which changes by `scale` per unit of p.
    ///
    /// The whole part of `origin` is taken modulo 2^32; its remainder keeps the precision that `origin` has.
    pub fn new(origin: [f64; 3], scale: [f64; 3], seed: u32, amplitude: f64) -> Octave<T> {
        let floor = origin.map(f64::floor);
        Octave {
            cell: floor.map(Real::lattice),
            shift: [0, 1, 2].map(|i| T::from_f64(origin[i] - floor[i])),
            scale: scale.map(T::from_f64),
            seed,
            amplitude: T::from_f64(amplitude),
        }
    }

    /// Its value at p, amplitude included.
    #[inline(always)]
    pub fn value<R: Real<Scalar = T>>(&self, token: R::Token, p: [R; 3]) -> R {
        let at = [
            p[0] * R::splat(token, self.scale[0]) + R::splat(token, self.shift[0]),
            p[1] * R::splat(token, self.scale[1]) + R::splat(token, self.shift[1]),
            p[2] * R::splat(token, self.scale[2]) + R::splat(token, self.shift[2]),
        ];
        perlin(token, self.cell, at, self.seed) * R::splat(token, self.amplitude)
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

/// A bijective mix of 32 bits (the constants are those of Wellons' `lowbias32`, 2018).
fn scramble(mut x: u32) -> u32 {
    x ^= x >> 16;
    x = x.wrapping_mul(0x7FEB_352D);
    x ^= x >> 15;
    x = x.wrapping_mul(0x846C_A68B);
    x ^ (x >> 16)
}

/// log2 of the cells per voxel from which an octave fades, and of those at which it is gone.
///
/// Between one and one and a half cells per voxel an octave does as much harm as good against the field filtered to
/// the voxel; the fade is centred there.
pub const BAND: [f64; 2] = [-0.514_573_172_829_758_2, 0.678_071_905_112_637_6];

/// Weight of an octave at `log2` of its cells per voxel: 1 below the band, 0 above it, a smoothstep between.
#[inline(always)]
pub fn band_weight<R: Real>(token: R::Token, log2: R) -> R {
    let one = R::constant(token, 1.0);
    let t = (log2 - R::constant(token, BAND[0])) * R::constant(token, 1.0 / (BAND[1] - BAND[0]));
    let t = t.within(R::constant(token, 0.0), one);
    one - t * t * (R::constant(token, 3.0) - (t + t))
}
