//! What the density means to light.

use glam::DVec3;

use super::blackbody::black_body;
use crate::scene::{self, Light};

/// A medium that only glows is marched through as if it extinguished so little, per metre at density 1.
const LEAST: f64 = 1e-12;

/// A light that something can be in the shadow of.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Lamp {
    /// Parallel light.
    Sun {
        /// The way it travels, of length 1.
        direction: DVec3,
        /// Irradiance across the beam, linear red, green and blue.
        irradiance: DVec3,
    },
    /// Light from a point.
    Point {
        /// Where it is, in metres.
        position: DVec3,
        /// Radiant intensity, linear red, green and blue.
        intensity: DVec3,
    },
}

impl Lamp {
    /// Its colour: irradiance of a sun, intensity of a point.
    pub(super) fn colour(&self) -> DVec3 {
        match self {
            Lamp::Sun { irradiance, .. } => *irradiance,
            Lamp::Point { intensity, .. } => *intensity,
        }
    }
}

/// A medium's optical properties and the lights around it.
#[derive(Debug, Clone, PartialEq)]
pub struct Optics {
    /// Extinction per metre at density 1, above 0.
    pub extinction: f64,
    /// Whether it does not extinguish light at all, and its extinction only stands for none.
    pub is_clear: bool,
    /// Scattered part of it: linear red, green and blue.
    pub albedo: DVec3,
    /// Henyey-Greenstein mean cosine.
    pub anisotropy: f64,
    /// Radiance emitted per metre at density 1.
    pub emission: DVec3,
    /// Suns and points.
    pub lamps: Vec<Lamp>,
    /// Radiance that comes from everywhere.
    pub ambient: DVec3,
}

impl Optics {
    /// Of a scene's medium and lights.
    pub fn new(medium: &scene::Medium, lights: &[Light]) -> Optics {
        let is_clear = medium.extinction <= 0.0;
        let mut lamps = Vec::new();
        let mut ambient = DVec3::ZERO;
        for light in lights {
            match *light {
                Light::Sun { direction, irradiance } => {
                    lamps.push(Lamp::Sun { direction: direction.into(), irradiance: irradiance.into() });
                }
                Light::Point { position, intensity } => {
                    lamps.push(Lamp::Point { position: position.into(), intensity: intensity.into() });
                }
                Light::Ambient { radiance } => ambient += DVec3::from(radiance),
            }
        }
        Optics {
            extinction: if is_clear { LEAST } else { medium.extinction },
            is_clear,
            albedo: if is_clear { DVec3::ZERO } else { medium.albedo.into() },
            anisotropy: medium.anisotropy,
            emission: DVec3::from(medium.emission)
                * medium.temperature.map_or(DVec3::ONE, |kelvin| black_body(kelvin).into()),
            lamps: if is_clear { Vec::new() } else { lamps },
            ambient,
        }
    }

    /// The medium without light: it only extinguishes.
    pub fn absorbing(mut self) -> Optics {
        self.albedo = DVec3::ZERO;
        self.emission = DVec3::ZERO;
        self.lamps.clear();
        self.ambient = DVec3::ZERO;
        self
    }

    /// The source that is alike everywhere: ambient light that is scattered, and what is emitted.
    pub(super) fn uniform_source(&self) -> DVec3 {
        self.albedo * self.ambient + self.emission / self.extinction
    }
}

/// Henyey and Greenstein's phase function (1941) of mean cosine g, whose integral over the sphere is 1, between two
/// directions of propagation of length 1. Stable towards |g| = 1: with `1 - cos = |a - b|^2 / 2`, or where it peaks backwards, that of
/// the opposite mean cosine and direction.
pub(crate) fn phase(g: f64, a: DVec3, b: DVec3) -> f64 {
    let (g, b) = if g < 0.0 { (-g, -b) } else { (g, b) };
    let away = 0.5 * (a - b).length_squared();
    let narrow = (1.0 - g) * (1.0 - g) + 2.0 * g * away;
    (1.0 - g) * (1.0 + g) / (4.0 * std::f64::consts::PI * narrow * narrow.sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn phase_functions_integrate_to_one_and_keep_their_mean_cosine() {
        for g in [-0.9, -0.3, 0.0, 0.5, 0.95] {
            // In 1 - cos = 2 x^2, which evens a forward peak out; the midpoint rule is of second order.
            let n = 20_000;
            let (mut sum, mut mean) = (0.0, 0.0);
            for i in 0..n {
                let x = (f64::from(i) + 0.5) / f64::from(n);
                let cos = 1.0 - 2.0 * x * x;
                let to = DVec3::new((1.0 - cos * cos).sqrt(), 0.0, cos);
                let part = phase(g, DVec3::Z, to) * 2.0 * std::f64::consts::PI * 4.0 * x / f64::from(n);
                sum += part;
                mean += part * cos;
            }
            // Where the peak is backwards it is steep in x as well.
            assert!((sum - 1.0).abs() < 1e-4 && (mean - g).abs() < 1e-4, "{g}: {sum}, {mean}");
        }
    }
}
