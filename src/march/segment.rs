//! Light along one short segment of a ray.
//!
//! With the optical depth D of a segment and a source that changes linearly *in optical depth* from S0 at its near end to S1
//! at its far end, the light that leaves at its near end is `a S0 + b S1`, where
//!
//! ```text
//! a + b = 1 - e^-D        b = (1 - (1 + D) e^-D) / D
//! ```
//!
//! So where the source is 1 everywhere, and the background too, every picture is 1, however long the segments.

use crate::num::Real;

/// Below this the closed form of `b` is a difference of almost equal numbers.
const SERIES: f64 = 0.5;

/// A segment's transmittance and the weights of its source at both ends.
#[derive(Debug, Clone, Copy)]
pub(super) struct Weights<R> {
    pub(super) transmittance: R,
    pub(super) near: R,
    pub(super) far: R,
}

impl<R: Real> Weights<R> {
    /// Of an optical depth, at least 0. In single precision each is good to 3e-6 of itself, or 1e-7.
    #[inline(always)]
    pub(super) fn new(token: R::Token, depth: R) -> Weights<R> {
        let one = R::constant(token, 1.0);
        let transmittance = (depth * R::constant(token, -std::f64::consts::LOG2_E)).exp2(token);
        // Sum over k of (-1)^(k + 1) (k - 1) / k! D^(k - 1), from k = 2.
        let mut far = R::constant(token, -1.0 / 45360.0);
        for c in [1.0 / 5760.0, -1.0 / 840.0, 1.0 / 144.0, -1.0 / 30.0, 1.0 / 8.0, -1.0 / 3.0, 0.5] {
            far = far * depth + R::constant(token, c);
        }
        far = far * depth;
        let mut opacity = R::constant(token, -1.0 / 40320.0);
        for c in [1.0 / 5040.0, -1.0 / 720.0, 1.0 / 120.0, -1.0 / 24.0, 1.0 / 6.0, -0.5, 1.0] {
            opacity = opacity * depth + R::constant(token, c);
        }
        opacity = opacity * depth;
        let is_short = depth.lt(R::constant(token, SERIES));
        let whole = R::select(is_short, one, depth);
        let closed = (one - (one + depth) * transmittance) / whole;
        far = R::select(is_short, far, closed);
        opacity = R::select(is_short, opacity, one - transmittance);
        Weights { transmittance, near: opacity - far, far }
    }
}

/// Places of the two samples of Gauss's rule on a segment, as parts of its length.
pub(super) const GAUSS: [f64; 2] = [0.211_324_865_405_187_1, 0.788_675_134_594_812_9];

#[cfg(test)]
mod tests {
    use super::*;
    use crate::num::{Level, WithLevel, with_level};

    struct Lanes<'a>(&'a [f32; 16]);

    impl WithLevel for Lanes<'_> {
        type Output = [[f32; 16]; 3];
        #[inline(always)]
        fn run<R: Real<Scalar = f32>>(self, token: R::Token) -> [[f32; 16]; 3] {
            let weights = Weights::<R>::new(token, R::load(token, self.0));
            let mut out = [[0.0; 16]; 3];
            weights.transmittance.store(&mut out[0]);
            weights.near.store(&mut out[1]);
            weights.far.store(&mut out[2]);
            out
        }
    }

    #[test]
    fn weights_are_those_of_the_closed_form() {
        let mut depth = 1e-30_f32;
        while depth < 1e30 {
            let lanes: [f32; 16] = std::array::from_fn(|lane| depth * (1.0 + lane as f32 / 16.0));
            let [transmittance, near, far] = with_level(Level::best(), Lanes(&lanes));
            for lane in 0..16 {
                let d = f64::from(lanes[lane]);
                let t = libm::exp(-d);
                // The difference loses what the series of six terms does not: D^6 / 5040 of D / 2.
                let b = if d < 1e-2 {
                    d * (0.5 - d * (1.0 / 3.0 - d * (0.125 - d / 30.0)))
                } else {
                    (-libm::expm1(-d) - d * t) / d
                };
                let a = -libm::expm1(-d) - b;
                for (found, truth) in [(transmittance[lane], t), (near[lane], a), (far[lane], b)] {
                    let error = (f64::from(found) - truth).abs();
                    assert!(error <= 3e-6 * truth.abs() + 1e-37 || error < 1e-7, "{d}: {found}, not {truth}");
                    assert!(truth < 1e-30 || d > 80.0 || error < 1e-5 * truth, "{d}: {found}, not {truth}");
                }
            }
            depth *= 1.37;
        }
    }
}
