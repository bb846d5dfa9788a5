//! What a file is certified to be.

use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::around::around;
use super::errors::{Errors, Intervals};
use super::exact::Exact;
use super::field::{Depth, FieldDifference, Mass, Residuals, compare_at};
use super::goal::Goal;
use super::parts::Parts;
use super::search::Step;
use super::source::{Gridded, Source};
use super::survey::{Look, MARGIN, MORE, Survey, is_vague};
use super::trial::{TrialError, rows};
use crate::field::Lattice;
use crate::scene::Scene;
use crate::volume::{PlanError, Tree};

/// A statement about one file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Certificate {
    /// Of this form.
    pub version: u32,
    /// The program that measured.
    pub creator: String,
    /// SHA-256 of the scene's text, in hexadecimal.
    pub scene_sha256: String,
    /// What the file was baked with.
    pub settings: Value,
    /// The hash of all values.
    pub content_hash: String,
    /// The file's.
    pub uuid: String,
    /// What values are held against.
    pub truth: String,
    /// How values between voxels are found.
    pub filter: String,
    /// Which of the random numbers were taken.
    pub stream: u64,
    /// What was asked for, and how it was met; null where nothing was.
    pub goal: Option<Reached>,
    /// What was measured.
    pub measured: Measured,
}

/// How a goal was met.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Reached {
    /// What was asked for.
    #[serde(flatten)]
    pub goal: Goal,
    /// What was measured in the file.
    pub achieved: f64,
    /// What it may be, as far as the points tell.
    pub at_most: f64,
    /// The power of the voxel size with which the error falls, from the two finest pilots; null where there is one.
    pub order: Option<f64>,
    /// Bakes until it was met.
    pub rounds: u32,
    /// Voxel sizes that were tried, and what points told of them.
    pub pilots: Vec<Step>,
}

/// Errors of a file's values.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Measured {
    /// Points in all that the bake shows.
    pub points: u64,
    /// The volume that these are spread over, metres^3.
    pub volume: f64,
    /// At the points.
    pub errors: Errors,
    /// Bootstrap intervals of 95 %; null without points.
    pub intervals: Option<Intervals>,
    /// The point of the largest difference, in metres.
    pub worst: Option<[f64; 3]>,
    /// Integrals over the volume.
    pub mass: Mass,
    /// Integrals along rays.
    pub optical_depth: Depth,
    /// The error taken apart.
    pub parts: Parts,
}

impl Measured {
    fn new(found: FieldDifference, parts: Parts) -> Measured {
        let FieldDifference { points, volume, errors, intervals, worst, mass, optical_depth, .. } = found;
        Measured { points, volume, errors, intervals, worst, mass, optical_depth, parts }
    }
}

/// Points that see density, at least, where that can be had with no more than so many times the points.
const SEEN: usize = 10_000;
const MOST: usize = 16;

/// Points where there is density, or voxels have it.
fn seen(residuals: &Residuals) -> usize {
    let [truth, values] = &residuals.values;
    truth.iter().zip(values).filter(|(truth, value)| **truth != 0.0 || **value != 0.0).count()
}

/// Measures a file's values against the definition of its scene's density, at points over all that the bake shows and along
/// rays through them: the same figures at every run. On the current `rayon` pool.
///
/// # Errors
///
/// Where the bricks cannot be planned in `budget` bytes.
pub fn measure(
    scene: &Scene,
    lattice: Lattice,
    tree: Tree<f32>,
    look: Look,
    budget: u64,
) -> Result<(Measured, FieldDifference, Residuals), TrialError> {
    let survey = Survey::new(scene, look, budget);
    let lot = survey.pilot().at(lattice)?;
    let whole = lot.whole()?;
    let places = |points: usize| around(&whole, MARGIN, points, look.stream);
    let exact = Exact::new(scene, lattice, budget)?;
    // A voxel size is above 0, so its map has an inverse.
    let file = Gridded::new(tree, rows(lattice), look.filter).ok_or(PlanError::TooWide)?;
    let compared = |points| compare_at(&exact, &file as &dyn Source, &places(points), look.rays);
    let (mut found, mut residuals) = compared(look.points);
    let mut points = look.points;
    while (is_vague(found.intervals.as_ref()) || seen(&residuals) < SEEN) && points < MOST * look.points {
        points *= MORE;
        (found, residuals) = compared(points);
    }
    let [truth, values] = &residuals.values;
    let parts = survey.parts_of(&lot, &residuals.points, truth, values)?;
    Ok((Measured::new(found.clone(), parts), found, residuals))
}
