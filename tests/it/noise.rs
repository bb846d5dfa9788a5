//! The noise in lanes against the reference's.

use vdbake::noise::{BAND, BOUND, Octave, band_weight};
use vdbake::num::{Level, Real, WithLevel, with_level};
use vdbake::reference;

use crate::gates_noise::lanes;

/// Points in [-4, 4)^3, multiples of 2^-13.
fn points(count: usize) -> Vec<[f32; 3]> {
    let mut state = 7_u64;
    let mut next = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        f32::from(u16::try_from(state >> 48).expect("sixteen bits")) / 8192.0 - 4.0
    };
    (0..count).map(|_| [next(), next(), next()]).collect()
}

#[test]
fn lanes_agree_with_the_reference_as_well_at_a_billion_cells_as_at_the_origin() {
    let points = points(16 * 500);
    for far in [0.0, -1.0, 1e3, 1e6, 1e9, -1e9, 4_294_967_296.0, 1e12] {
        for seed in [0, 0xDEAD_BEEF] {
            let origin = [far + 0.25, -far + 0.125, far];
            let found = lanes(&[Octave::new(origin, [1.0; 3], seed, 1.0)], &points);
            for (p, value) in points.iter().zip(found) {
                // Whole cells and fractions apart: exact, as all are multiples of 2^-13.
                let at = [0, 1, 2].map(|axis| f64::from(p[axis]) + (origin[axis] - origin[axis].floor()));
                #[allow(clippy::cast_possible_truncation, reason = "whole numbers below 2^53")]
                let cell = [0, 1, 2].map(|axis| origin[axis].floor() as i64 + at[axis].floor() as i64);
                let truth = reference::perlin(cell, at.map(|x| x - x.floor()), seed);
                // Eight products of gradient and offset and seven blends, each within 6e-8 of terms below 1.
                assert!((f64::from(value) - truth).abs() < 1e-6, "{value} and {truth} at {at:?} + {far}");
            }
        }
    }
}

#[test]
fn no_value_exceeds_the_bound_and_the_mean_is_zero() {
    let points = points(1 << 20);
    let found = lanes(&[Octave::new([0.0; 3], [1.0; 3], 3, 1.0)], &points);
    let largest = found.iter().fold(0.0_f64, |most, &value| most.max(f64::from(value).abs()));
    assert!(largest <= BOUND, "{largest}");
    let mean = found.iter().map(|&value| f64::from(value)).sum::<f64>() / found.len() as f64;
    // 512 cells, each a sum of eight random gradients: standard error about 0.27 / sqrt(512) at most.
    assert!(mean.abs() < 3.0 * 0.27 / 512_f64.sqrt(), "{mean}");
}

/// Weights at sixteen squares of cells per voxel, times `b`.
struct Weights<'a>(&'a [f32; 16], f32);

impl WithLevel for Weights<'_> {
    type Output = [f32; 16];
    #[inline(always)]
    fn run<R: Real<Scalar = f32>>(self, token: R::Token) -> [f32; 16] {
        let mut out = [0.0; 16];
        band_weight(token, R::load(token, self.0), R::splat(token, self.1)).store(&mut out);
        out
    }
}

#[test]
fn octaves_have_full_weight_below_the_band_and_none_above_it() {
    let ends = [0.0, 1e-30, BAND[0] * 0.999, BAND[0], BAND[1], BAND[1] * 1.001, 1e30, f64::INFINITY];
    for (x, truth) in ends.into_iter().zip([1.0, 1.0, 1.0, 1.0, 0.0, 0.0, 0.0, 0.0]) {
        assert_eq!(band_weight((), x, 1.0), truth, "{x}");
        #[allow(clippy::cast_possible_truncation, reason = "single precision is what is tested")]
        let x = x as f32;
        for b in [1e-6, 1.0, 3.7, 1e6] {
            assert_eq!(f64::from(with_level(Level::best(), Weights(&[x * b; 16], b))[0]), truth, "{x}, {b}");
        }
    }
}

#[test]
fn weights_in_the_band_agree_with_the_reference() {
    for step in 0..1000_u16 {
        let x = 0.6 + 1.2 * f32::from(step) / 1000.0;
        let truth = reference::octave_weight(f64::from(x));
        let square = f64::from(x) * f64::from(x);
        // The stated bound.
        assert!((band_weight((), 2.5 * square, 2.5) - truth).abs() < 1e-6, "{x}");
        let found = with_level(Level::best(), Weights(&[x * x * 2.5; 16], 2.5))[0];
        assert!((f64::from(found) - truth).abs() < 1e-6, "{x} in lanes");
    }
}
