//! What a file is certified to be.

use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::around::around;
use super::errors::{Errors, Intervals, intervals};
use super::exact::Exact;
use super::field::{Depth, FieldDifference, Mass, Residuals, chords_of};
use super::goal::Goal;
use super::paged::{Leaves, Paged, SUPPORT};
use super::parts::Parts;
use super::search::Step;
use super::source::Source;
use super::support::Spread;
use super::survey::{Look, MARGIN, MORE, Survey, is_vague};
use super::trial::{Pilot, TrialError, rows};
use crate::field::Lattice;
use crate::formats::vdb::VdbReadError;
use crate::num::Level;
use crate::scene::Scene;
use crate::volume::{PlanError, planned_density_at};

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

/// Bytes of a point and what is known of it: its place, the truth, the file's value, those between, and the error.
const POINT: u64 = 64;
/// Bytes besides, for those that are evaluated at once.
const WORK: u64 = 4 << 20;
/// Bytes of each thread.
const THREAD: u64 = 384 << 10;
/// Bytes that a file's leaves are read in at least, and those of one.
const READING: u64 = 3 << 20;
const LEAF: u64 = 2048;
/// The part of what is left that stays free, for what allocators keep to themselves.
const SPARE: u64 = 8;
/// Bytes of a leaf that is not in memory: its place and mask, and what finds it.
const PLACE: u64 = 112;

/// The memory that there is to measure in. One thing after the other is held in it beside the points: the bricks of a plan, or
/// the leaves of a file.
#[derive(Debug, Clone, Copy)]
struct Room(u64);

impl Room {
    /// What is left beside so many points.
    fn beside(self, points: usize) -> Result<u64, TrialError> {
        let held = Room::held(points);
        self.0.checked_sub(held).ok_or(TrialError::Memory { needed: held.saturating_add(READING) })
    }

    fn held(points: usize) -> u64 {
        let threads = THREAD * rayon::current_num_threads() as u64;
        // There may be some more than were asked for.
        (points as u64 + points as u64 / 16) * POINT + WORK + threads
    }

    /// What is made in the memory beside so many points.
    fn make<T>(self, points: usize, make: impl FnOnce(u64) -> Result<T, PlanError>) -> Result<T, TrialError> {
        // What the last one took is still the process's where the allocator keeps it.
        vdbake_heap::give_back();
        make(self.beside(points)?).map_err(|error| Room::refusal(points, error))
    }

    /// Of what has no room beside so many points.
    fn refusal(points: usize, error: PlanError) -> TrialError {
        match error.enough() {
            Some(enough) => TrialError::Memory { needed: enough.saturating_add(Room::held(points)) },
            None => error.into(),
        }
    }
}

/// Points where there is density, or voxels have it.
fn seen([truth, values]: &[Vec<f64>; 2]) -> usize {
    truth.iter().zip(values).filter(|(truth, value)| **truth != 0.0 || **value != 0.0).count()
}

/// Measures a file's values against the definition of its scene's density, at points over all that the bake shows and along
/// rays through them: the same figures at every run, in any memory. On the current `rayon` pool. `open` gives the values, within
/// so many bytes, and is called several times, since nothing that large is kept beside another.
///
/// # Errors
///
/// Where `budget` bytes are too few, and those of `open`.
pub fn measure<L: Leaves>(
    scene: &Scene,
    lattice: Lattice,
    open: impl Fn(u64) -> Result<L, TrialError>,
    look: Look,
    budget: u64,
) -> Result<(Measured, FieldDifference, Residuals), TrialError> {
    let room = Room(budget);

    let mut points = look.points;
    let (spread, kernel, values, bounds) = loop {
        let (spread, kernel) = room.make(points, |bytes| {
            let (field, whole) = Pilot::new(scene, bytes).whole(lattice)?;
            let spread = around(&whole, MARGIN, points, look.stream);
            let kernel = planned_density_at(&field, &whole, &spread.points, Level::best());
            Ok((spread, kernel))
        })?;
        let exact = room.make(points, |bytes| Exact::new(scene, lattice, bytes))?;
        let truth = exact.values(&spread.points);
        let mut bounds = [exact.support().bounds(), None];
        drop(exact);
        let mut file = opened(&open, room, points, lattice, look)?;
        bounds[1] = file.support().bounds();
        let values = [truth, file.values(&spread.points)?];
        drop(file);
        let held = intervals(&values[0], &values[1]);
        let tells = !is_vague(held.as_ref()) && seen(&values) >= SEEN;
        if tells || points >= MOST * look.points {
            break (spread, kernel, values, bounds);
        }
        points *= MORE;
    };
    let Spread { points: places, volume } = spread;
    let chords = chords_of(bounds, &places, look.rays);
    let of_truth = room.make(points, |bytes| Exact::new(scene, lattice, bytes))?.depths(&chords);
    let of_file = opened(&open, room, points, lattice, look)?.depths(&chords)?;
    let residuals = Residuals { points: places, values, chords, depths: [of_truth, of_file] };
    let found = residuals.difference(volume);
    let [truth, stored] = &residuals.values;
    vdbake_heap::give_back();
    let survey = Survey::new(scene, look, room.beside(points)?);
    let kernel: Vec<f64> = kernel.into_iter().map(f64::from).collect();
    let parts = survey.parts_at(lattice, &residuals.points, [truth, stored], &kernel);
    let parts = parts.map_err(|error| match error {
        TrialError::Plan(error) => Room::refusal(points, error),
        error => error,
    })?;
    Ok((Measured::new(found.clone(), parts), found, residuals))
}

/// Bytes that [`measure`] takes at most of a file that was baked of so many bricks, of which the plan took `making` bytes to
/// make, unless more points are needed than it begins with.
pub fn measuring(look: Look, making: u64, bricks: u64) -> u64 {
    /// Parts of the memory of the bake's plan that one with its surroundings takes more.
    const AROUND: u64 = 2;
    let file = READING.saturating_add(PLACE.saturating_mul(bricks));
    Room::held(look.points).saturating_add(file.max(making.saturating_add(making / AROUND)))
}

/// A file beside so many points.
fn opened<L: Leaves>(
    open: &impl Fn(u64) -> Result<L, TrialError>,
    room: Room,
    points: usize,
    lattice: Lattice,
    look: Look,
) -> Result<Paged<L>, TrialError> {
    vdbake_heap::give_back();
    let bytes = room.beside(points)?;
    let beside = |needed: u64| TrialError::Memory {
        needed: Room::held(points).saturating_add(needed).saturating_add(READING),
    };
    let Some(within) = bytes.checked_sub(READING) else { return Err(beside(0)) };
    let leaves = open(within).map_err(|error| match error {
        TrialError::Read(VdbReadError::Memory { needed, .. }) => beside(needed),
        error => error,
    })?;
    // Its support lists all leaves.
    let taken = leaves.memory().saturating_add(SUPPORT * leaves.tree().leaf_count() as u64);
    let left = within.checked_sub(taken).ok_or(beside(taken))?;
    #[allow(clippy::cast_possible_truncation, reason = "saturates")]
    let most = ((left - left / SPARE + READING / 2) / LEAF).min(usize::MAX as u64) as usize;
    // A voxel size is above 0, so its map has an inverse.
    Ok(Paged::new(leaves, rows(lattice), look.filter, most).ok_or(PlanError::TooWide)?)
}
