//! The noise in lanes against the reference's.

use vdbake::noise::{BAND, BOUND, Octave, band_weight};
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

#[test]
fn octaves_have_full_weight_below_the_band_and_none_above_it() {
    assert_eq!(band_weight((), BAND[0] - 1e-9), 1.0);
    assert_eq!(band_weight((), BAND[1]), 0.0);
    assert_eq!(band_weight((), f64::INFINITY), 0.0);
    assert_eq!(band_weight((), f64::NEG_INFINITY), 1.0);
    assert!((band_weight((), 0.5 * (BAND[0] + BAND[1])) - 0.5).abs() < 1e-15);
    for log2 in [-0.4, 0.0, 0.3, 0.6] {
        let truth = reference::octave_weight(libm::exp2(log2));
        assert!((band_weight((), log2) - truth).abs() < 1e-12, "{log2}");
    }
}
