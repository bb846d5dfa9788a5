//! The mass of a field's cylinders at rest, which that of a bake is held against.

use rayon::prelude::*;

use super::Tally;
use super::dispatch::evaluate_slice;
use crate::field::kernel::Scratch;
use crate::field::rest::{Cylinders, Masses, Slice};
use crate::field::{Field, Lattice, Region, VOXELS};
use crate::num::Level;
use crate::scene::Scene;

/// A point of the quadrature for so many voxels inside a tube: 7 % of the bake's own work.
const VOXELS_A_POINT: u64 = 16;
/// Points, at least and at most: a millisecond's, and so many that their errors no longer matter.
const POINTS: [u64; 2] = [1 << 15, 1 << 20];

/// The mass at rest of the tubes of a field, in metres^3: the integral of the density at rest, as the field module
/// defines it.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct RestMass {
    /// The integral.
    pub rest: f64,
    /// Its error, about two standard deviations where noise is finer than the points of the quadrature.
    pub error: f64,
    /// The part of it that has no image, because it is past the focal set or because the tube has no radius.
    pub lost: f64,
    /// The part of it that is faded out beside the focal set.
    pub faded: f64,
    /// What the rest of it becomes when it is deformed, if no two feet meet.
    pub image: f64,
    /// Error of that.
    pub image_error: f64,
    /// In half balls at round ends, which the cylinders do not have.
    pub caps: f64,
    /// Points of the quadrature.
    pub points: u64,
}

impl RestMass {
    /// The mass at rest of the scene that `field` was compiled from, with octaves faded as at a lattice, by about
    /// `points` points.
    ///
    /// Works on the current `rayon` pool; the result does not depend on its number of threads.
    pub fn new(field: &Field, scene: &Scene, lattice: Lattice, points: u64, level: Level) -> RestMass {
        let cylinders = field.at_rest(scene, points);
        let found: Vec<Masses> = cylinders
            .slices()
            .par_iter()
            .map_init(Worker::default, |worker, slice| worker.slice(field, &cylinders, slice, lattice, level))
            .collect();
        let mut total = RestMass::default();
        // Two independent values for every panel.
        let mut panels = vec![[Masses::default(); 2]; cylinders.panels()];
        for (slice, masses) in cylinders.slices().iter().zip(&found) {
            total.points += cylinders.points(slice) as u64;
            match slice.place_in_sum() {
                Some((panel, rule)) => panels[panel][rule].add(masses),
                None => total.caps += masses.caps,
            }
        }
        let mut errors = [Error::default(); 2];
        for [first, second] in &panels {
            total.rest += 0.5 * (first.rest + second.rest);
            total.lost += 0.5 * (first.lost + second.lost);
            total.faded += 0.5 * (first.faded + second.faded);
            total.image += 0.5 * (first.image + second.image);
            errors[0].add(first.rest - second.rest);
            errors[1].add(first.image - second.image);
        }
        // Single precision, in which the density is evaluated.
        total.error = errors[0].of_mean() + ROUNDING * total.rest;
        total.image_error = errors[1].of_mean() + ROUNDING * total.image;
        total
    }

    /// The same with as many points as are worth it beside a bake.
    pub fn beside(field: &Field, scene: &Scene, lattice: Lattice, tally: &Tally, level: Level) -> RestMass {
        let points = (tally.inside_voxels / VOXELS_A_POINT).clamp(POINTS[0], POINTS[1]);
        RestMass::new(field, scene, lattice, points, level)
    }
}

/// Relative error of the mean of densities in single precision: its errors of some 1e-6 hardly add up.
const ROUNDING: f64 = 1e-7;

/// Differences between the two values of every panel.
#[derive(Debug, Clone, Copy, Default)]
struct Error {
    sum: f64,
    squares: f64,
}

impl Error {
    fn add(&mut self, difference: f64) {
        self.sum += difference;
        self.squares += difference * difference;
    }

    /// Two standard deviations of the sum of the pairs' means, where they are independent, and no less than half of
    /// what the two whole rules differ by, where they are not.
    fn of_mean(&self) -> f64 {
        self.squares.sqrt().max(0.5 * self.sum.abs())
    }
}

/// One thread's memory.
#[derive(Default)]
struct Worker {
    region: Region<f32>,
    scratch: Scratch<f32>,
}

impl Worker {
    fn slice(
        &mut self,
        field: &Field,
        cylinders: &Cylinders,
        slice: &Slice,
        lattice: Lattice,
        level: Level,
    ) -> Masses {
        field.narrow_to_slice(lattice, slice, &mut self.region);
        let mut masses = Masses::default();
        for first in (0..cylinders.points(slice)).step_by(VOXELS) {
            let count = cylinders.place(slice, lattice, first, &mut self.scratch);
            evaluate_slice(level, &self.region, &mut self.scratch, count);
            masses.add(&cylinders.gather(slice, first, count, &self.scratch));
        }
        masses
    }
}
