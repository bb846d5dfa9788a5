//! What an octave's noise is made into.

use super::BOUND;
use crate::num::Real;

/// Mean of |n| over all gradients and places: measured over 6e8 of them, standard error 6e-6.
pub const MEAN_MAGNITUDE: f64 = 0.220_170;
/// Mean of n^2: a product of integrals of the blend (module reference, tests).
const MEAN_SQUARE: f64 = 16.0 * (535.0 / 18018.0) * (181.0 / 462.0) * (181.0 / 462.0);

/// What each octave of a fractal sum makes of its noise n.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Form {
    /// n: fractional Brownian motion.
    #[default]
    Fbm,
    /// |n|: rounded lumps between creases, at least 0.
    Billow,
    /// `(1 - |n|)^2`: sharp ridges, from 0 to 1.
    Ridged,
}

impl Form {
    /// Mean over all gradients and places.
    pub fn mean(self) -> f64 {
        match self {
            Form::Fbm => 0.0,
            Form::Billow => MEAN_MAGNITUDE,
            Form::Ridged => 1.0 - 2.0 * MEAN_MAGNITUDE + MEAN_SQUARE,
        }
    }

    /// Least and greatest values, for noise within [`BOUND`].
    pub fn range(self) -> [f64; 2] {
        match self {
            Form::Fbm => [-BOUND, BOUND],
            Form::Billow => [0.0, BOUND],
            Form::Ridged => [0.0, 1.0],
        }
    }

    /// The form of a value of noise.
    #[inline(always)]
    pub fn of<R: Real>(self, token: R::Token, n: R) -> R {
        match self {
            Form::Fbm => n,
            Form::Billow => n.abs(),
            Form::Ridged => {
                let ridge = R::constant(token, 1.0) - n.abs();
                ridge * ridge
            }
        }
    }
}
