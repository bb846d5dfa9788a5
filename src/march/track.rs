//! Ratio tracking: transmittance estimated without bias.

use super::camera::Ray;
use super::majorant::{Event, Flight, Guided, Majorants, Tentative};
use super::medium::Medium;
use super::points::Spot;
use super::random::Random;
use crate::num::Level;

/// An estimate below this is, with the chance to make up for it, set to this or to 0: so the work is bounded by the logarithm
/// of it, however dense the medium.
const LEAST: f64 = 0.05;

/// Goes on through a tentative collision where the density is known. Whether something is left.
pub(super) fn pass(transmittance: &mut f64, at: &Tentative, density: f64, random: &mut Random) -> bool {
    *transmittance *= 1.0 - (density / at.majorant).min(1.0);
    survives(transmittance, random)
}

/// Ends what is next to nothing, or makes up for that. Whether something is left.
pub(super) fn survives(transmittance: &mut f64, random: &mut Random) -> bool {
    if *transmittance < LEAST {
        let survives = random.next() * LEAST < *transmittance;
        *transmittance = if survives { LEAST } else { 0.0 };
    }
    *transmittance > 0.0
}

impl Medium<'_> {
    /// `count` independent estimates of the transmittance along a ray from one place to another, in metres: each has the true
    /// one, of the extinction at density 1 per metre, for its mean. Equal seeds give equal estimates.
    ///
    /// By ratio tracking (Novák, Selle and Jarosz, "Residual ratio tracking for estimating attenuation in participating
    /// media", 2014), over the bricks' majorants. Their spread grows with the optical depth, so that beyond some 4 many are
    /// needed.
    pub fn ratio_transmittances(
        &self,
        ray: &Ray,
        range: [f64; 2],
        extinction: f64,
        [seed, count]: [u64; 2],
        level: Level,
    ) -> Vec<f64> {
        let majorants = Majorants::new(self);
        let guided = Guided { medium: self, majorants: &majorants, extinction, is_regular: false };
        let along = self.grid().ray(ray);
        let start = |number| Estimate {
            flight: Flight::new(&guided, &along, range),
            random: Random::new(seed, number, 0),
            transmittance: 1.0,
        };
        let mut estimates: Vec<Estimate> = (0..count).map(start).collect();
        loop {
            let (mut spots, mut asking) = (Vec::new(), Vec::new());
            for (number, estimate) in estimates.iter_mut().enumerate() {
                if let Some(at) = estimate.next(&guided) {
                    let local = at.step.local(&estimate.flight.walk.line, at.at);
                    spots.push(Spot { brick: at.step.brick, local });
                    asking.push((number, at));
                }
            }
            if spots.is_empty() {
                return estimates.into_iter().map(|estimate| estimate.transmittance).collect();
            }
            for ((number, at), density) in asking.into_iter().zip(self.densities_at(&spots, level)) {
                let estimate = &mut estimates[number];
                pass(&mut estimate.transmittance, &at, f64::from(density), &mut estimate.random);
            }
        }
    }
}

struct Estimate {
    flight: Flight,
    random: Random,
    transmittance: f64,
}

impl Estimate {
    fn next(&mut self, guided: &Guided<'_>) -> Option<Tentative> {
        if self.transmittance <= 0.0 {
            return None;
        }
        match self.flight.next(guided, &mut self.random) {
            Some(Event::Tentative(at)) => Some(at),
            _ => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::super::testing::{baked, noisy, patchy, procedural, rough, solid};
    use super::*;

    /// The mean of estimates and its standard error.
    fn mean(estimates: &[f64]) -> [f64; 2] {
        #[allow(clippy::cast_precision_loss, reason = "thousands")]
        let count = estimates.len() as f64;
        let mean = estimates.iter().sum::<f64>() / count;
        let square = estimates.iter().map(|x| x * x).sum::<f64>() / count;
        [mean, ((square - mean * mean) / (count - 1.0)).sqrt()]
    }

    #[test]
    fn estimates_mean_the_transmittance() {
        let level = Level::best();
        let tree = rough(&patchy(), 4.0);
        let field = noisy();
        for medium in [baked(&tree), procedural(&field, 0.25)] {
            let rays = [
                Ray { origin: DVec3::new(-3.0, 0.02, 0.01), direction: DVec3::X },
                Ray { origin: DVec3::ZERO, direction: DVec3::new(0.3, 0.2, 0.9).normalize() },
                Ray { origin: DVec3::new(0.2, -0.1, 3.0), direction: DVec3::NEG_Z },
            ];
            for (seed, ray) in (0..).zip(rays) {
                for (range, extinction) in [([0.0, f64::INFINITY], 1.0), ([0.1, 3.1], 3.0)] {
                    let depth = medium.optical_depth(&ray, range, extinction, level);
                    let found = medium.ratio_transmittances(&ray, range, extinction, [seed, 4000], level);
                    let [mean, error] = mean(&found);
                    let truth = libm::exp(-depth);
                    assert!((mean - truth).abs() < 3.0 * error + 1e-6, "{mean} +- {error}, not {truth}");
                    assert!(depth > 0.1 && error < 0.02, "{depth}: {error}");
                }
            }
        }
    }

    /// However dense a medium is, estimates come to an end, and are next to nothing.
    #[test]
    fn the_work_is_bounded() {
        let medium = baked(&rough(&solid(), 1e6));
        let ray = Ray { origin: DVec3::new(-3.0, 0.02, 0.01), direction: DVec3::X };
        let found = medium.ratio_transmittances(&ray, [0.0, f64::INFINITY], 1e3, [1, 1000], Level::best());
        assert!(mean(&found)[0] < 1e-3);
    }
}
