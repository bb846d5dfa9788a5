//! What a scene's density is, whatever the voxel size.

use glam::DVec3;
use rayon::prelude::*;

use super::ray::Chord;
use super::source::{Procedural, Source, Voxels};
use super::support::Support;
use crate::field::{Field, Lattice};
use crate::reference::Reference;
use crate::scene::Scene;
use crate::volume::PlanError;

/// The density as the definition has it, with every octave and at every radius: what a bake comes near as its voxels
/// become small.
///
/// At points by the reference in double precision: where the kernel has density at less than a quarter of them, at these and at
/// every sixteenth of the others, and at all if any of those has density after all. Along chords by the kernel, whose rounding is measured as a part of a
/// bake's error, at four points in every stretch of at most a voxel.
#[derive(Debug)]
pub struct Exact {
    reference: Reference,
    kernel: Procedural,
}

impl Exact {
    /// Of a scene at its time. The lattice is that of the chords' steps.
    ///
    /// # Errors
    ///
    /// As [`Procedural::new`].
    pub fn new(scene: &Scene, lattice: Lattice, budget: u64) -> Result<Exact, PlanError> {
        let unlimited = unlimited(scene);
        let kernel = Procedural::new(Field::compile(&unlimited), lattice, budget)?;
        Ok(Exact { reference: Reference::new(scene, None), kernel })
    }

    /// The density at points alone.
    pub fn at(reference: &Reference, points: &[DVec3]) -> Vec<f64> {
        points.par_iter().map(|point| reference.density(point.to_array())).collect()
    }

    /// The same, where the kernel has these values: the reference takes a hundred times as long, and most points may see nothing.
    pub(super) fn guided(reference: &Reference, points: &[DVec3], kernel: &[f64]) -> Vec<f64> {
        /// Parts of the points.
        const FEW: usize = 4;
        const CHECKED: usize = 16;
        /// Of the largest density: what single precision may take for none.
        const NOTHING: f64 = 1e-4;
        let seen = kernel.iter().filter(|density| **density != 0.0).count();
        if FEW * seen >= points.len() {
            return Exact::at(reference, points);
        }
        let is_asked =
            |n: usize| n.is_multiple_of(CHECKED) || kernel.get(n).is_none_or(|density| *density != 0.0);
        let found: Vec<f64> = (points.par_iter().enumerate())
            .map(|(n, point)| if is_asked(n) { reference.density(point.to_array()) } else { 0.0 })
            .collect();
        let peak = kernel.iter().chain(&found).fold(0.0_f64, |peak, density| peak.max(density.abs()));
        let mut pairs = kernel.iter().zip(&found);
        if pairs.any(|(kernel, density)| *kernel == 0.0 && density.abs() > NOTHING * peak) {
            return Exact::at(reference, points);
        }
        found
    }
}

/// The scene with no octave faded and nothing widened.
pub fn unlimited(scene: &Scene) -> Scene {
    let mut scene = scene.clone();
    (scene.bake.octave_fade, scene.bake.widen) = (false, false);
    scene
}

impl Source for Exact {
    fn support(&self) -> &Support {
        self.kernel.support()
    }

    fn values(&self, points: &[DVec3]) -> Vec<f64> {
        Exact::guided(&self.reference, points, &self.kernel.values(points))
    }

    fn depths(&self, chords: &[Chord]) -> Vec<f64> {
        self.kernel.depths(chords)
    }

    fn voxels(&self) -> Option<&dyn Voxels> {
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::random::unit;

    /// A ball of radius 0.3, in a cube of edge 2.
    fn sparse() -> (Exact, Vec<DVec3>) {
        let text = "[[tube]]\nradius = 0.3\ncaps = \"round\"\n\
            curve = { points = [[0, 0, -0.1], [0, 0, 0], [0, 0, 0.1]] }";
        let scene = Scene::parse(text, "ball").expect("valid");
        let exact = Exact::new(&scene, Lattice { voxel_size: 0.05 }, 1 << 28).expect("small");
        let number = |n: u64| 2.0 * unit(11, n) - 1.0;
        (exact, (0..2000).map(|n| DVec3::new(number(3 * n), number(3 * n + 1), number(3 * n + 2))).collect())
    }

    #[test]
    fn nearly_nothing_is_as_the_reference_has_it() {
        let (exact, points) = sparse();
        let all = Exact::at(&exact.reference, &points);
        assert!(all.iter().filter(|density| **density > 0.0).count() < 500);
        let found = exact.values(&points);
        // Densities that single precision takes for none are below its rounding.
        assert!(all.iter().zip(&found).all(|(a, b)| (a - b).abs() < 1e-5));
        assert!(all.iter().zip(&found).filter(|(a, b)| a != b).count() < 10);
    }

    #[test]
    fn a_kernel_that_misses_density_is_noticed() {
        let (exact, points) = sparse();
        let all = Exact::at(&exact.reference, &points);
        // It sees one point of the ball.
        let mut blind = vec![0.0; points.len()];
        let seen = all.iter().position(|density| *density > 0.0).expect("a point in the ball");
        blind[seen] = all[seen];
        assert_eq!(Exact::guided(&exact.reference, &points, &blind), all);
    }
}
