//! What each accuracy costs: bakes and pictures of a scene at many settings, with their errors and times.
//!
//! [`sweep`] measures rows, each one setting, in groups that change one thing: voxel size and filter, octaves, precision and
//! codec, what a tube owes to its deformation and what carries its cross-section, how long its curve is; and pictures: the
//! scene itself by several methods and steps, and baked. Errors of bakes are those of [`measure`](super::measure): values at
//! points against the definition in double precision; errors of pictures are held against the scene's own picture in steps
//! of a quarter of a voxel, with no octave faded. A bake of a scene that is altered, and a picture of another or without
//! shadows, is held against the density or the picture of that one, and is on no front. Rows that a command makes, and that
//! no other such row of their kind beats in both time and error, are on the *front*. What there was no time for is listed and
//! left out.

mod bakes;
mod orders;
mod pictures;
mod rows;
mod shapes;

use std::time::{Duration, Instant};

use serde::Serialize;

pub(crate) use pictures::PAPER;
pub use pictures::{ImageParts, PaysAfter};
pub use rows::{
    Cost, FieldError, ImageError, Kind, LevelOf, Machine, Report, Row, Settings, Spread as TimeSpread, Truth,
};

use super::order::Order;
use super::survey::{Look, Survey};
use super::trial::TrialError;
use crate::field::Lattice;
use crate::num::Level;
use crate::scene::Scene;
use crate::volume::{Filter, Precision};
use rows::mark_fronts;

/// How much a sweep does.
#[derive(Debug, Clone, Copy)]
pub struct Effort {
    /// After so long no other row is begun.
    pub time: Duration,
    /// Times that each is repeated, after a first that is not counted.
    pub repeats: usize,
    /// Points at which bakes are looked at.
    pub points: usize,
    /// Rays along which they are.
    pub rays: usize,
    /// Pixels of pictures.
    pub size: [usize; 2],
    /// Bytes for each plan.
    pub budget: u64,
}

/// Measures a scene, at and around a lattice, on the current `rayon` pool. `done` is told the part of the work that is done, and
/// what comes next; where it says no, the sweep ends with what it has.
///
/// # Errors
///
/// Where the scene cannot be planned at its own lattice.
pub fn sweep(
    scene: &Scene,
    lattice: Lattice,
    effort: Effort,
    done: &mut dyn FnMut(f64, &str) -> bool,
) -> Result<Report, TrialError> {
    let mut run = Run { scene, lattice, effort, begun: Instant::now(), rows: vec![], left_out: vec![], done };
    let look = run.look(Precision::F32, Filter::Trilinear);
    let survey = Survey::new(scene, look, effort.budget);
    let parts = survey.parts(lattice.voxel_size)?;
    let halves = Survey::new(scene, Look { precision: Precision::F16, ..look }, effort.budget);
    let parts_f16 = halves.parts(lattice.voxel_size)?;
    run.bakes()?;
    let image_parts = run.pictures()?;
    run.more_bakes()?;
    run.more_pictures()?;
    run.shapes();
    let mut rows = run.rows;
    mark_fronts(&mut rows);
    let orders = orders::orders(&rows, parts.rounding.of_truth.unwrap_or(0.0));
    let pays_after = pictures::pays_after(&rows, lattice);
    Ok(Report {
        version: 1,
        scene: scene.name().to_owned(),
        time: scene.seconds(),
        voxel_size: lattice.voxel_size,
        machine: Machine::here(),
        truth: Truth { points: parts.points, rays: effort.rays as u64, kernel: parts.rounding },
        parts,
        parts_f16,
        image_parts,
        orders,
        pays_after,
        seconds: run.begun.elapsed().as_secs_f64(),
        time_limit: effort.time.as_secs_f64(),
        left_out: run.left_out,
        rows,
    })
}

/// A sweep under way.
struct Run<'a> {
    scene: &'a Scene,
    lattice: Lattice,
    effort: Effort,
    begun: Instant,
    rows: Vec<Row>,
    left_out: Vec<String>,
    done: &'a mut dyn FnMut(f64, &str) -> bool,
}

impl Run<'_> {
    /// The options of the scene's time, and of a picture's size.
    fn at_time(&self) -> String {
        let seconds = self.scene.seconds();
        if seconds == 0.0 { String::new() } else { format!(" --time {seconds:?}") }
    }

    fn of_size(&self) -> String {
        format!(" --size {}x{}", self.effort.size[0], self.effort.size[1])
    }

    /// What bakes are looked at by.
    fn look(&self, precision: Precision, filter: Filter) -> Look {
        Look { points: self.effort.points, rays: self.effort.rays, stream: 0x7377_6565, filter, precision }
    }

    /// Whether there is time for something; notes it where there is none.
    fn time_for(&mut self, what: &str) -> bool {
        let part = self.begun.elapsed().as_secs_f64() / self.effort.time.as_secs_f64().max(1e-9);
        if part >= 1.0 || !(self.done)(part.min(1.0), what) {
            self.left_out.push(what.to_owned());
            return false;
        }
        true
    }
}

/// Of errors that fall with the voxel size.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct OrderOf {
    /// How values between voxels are found.
    pub filter: &'static str,
    /// What the error is.
    pub metric: &'static str,
    /// Over the voxel sizes where errors follow a power; null where too few do.
    pub measured: Option<Order>,
    /// These sizes, in metres.
    pub voxel_sizes: Vec<f64>,
    /// Why these, or why the order cannot be told.
    pub why: String,
    /// What is to be expected of a smooth density; less where it has kinks, steps, or octaves finer than the voxels.
    pub theory: f64,
}

impl Machine {
    /// The one that this runs on.
    fn here() -> Machine {
        let processor = std::fs::read_to_string("/proc/cpuinfo").ok().and_then(|text| {
            let line = text.lines().find(|line| line.starts_with("model name"))?;
            Some(line.split_once(':')?.1.trim().to_owned())
        });
        Machine { threads: rayon::current_num_threads(), simd: Level::best().name(), processor }
    }
}
