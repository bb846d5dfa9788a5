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
/// At points by the reference in double precision. Along chords by the kernel, whose rounding is measured as a part of a
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
        Exact::at(&self.reference, points)
    }

    fn depths(&self, chords: &[Chord]) -> Vec<f64> {
        self.kernel.depths(chords)
    }

    fn voxels(&self) -> Option<&dyn Voxels> {
        None
    }
}
