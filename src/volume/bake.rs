//! Evaluation of a plan.
//!
//! # What a voxel stores
//!
//! A voxel stores the density at the centre of its cell, for which [`field`](crate::field) has the definition. Where an
//! edge passes through the cell and the scene has `antialias = "adaptive"`, it stores the mean density over the cell
//! instead: over 32 places, the rank-1 lattice of [`place`](super::antialias::place).
//!
//! Which cells those are is found in two steps. An edge may pass through a brick if a bound in double precision cannot
//! exclude it (`field::edges`); bricks without are evaluated as if nothing were anti-aliased. In the others the field's
//! *outline* is evaluated at the corners and centres of all cells: the density without its layers, sectors apart, and with
//! feet and tubes joined by sum. A cell counts if the outline at its centre differs from the mean of those at its corners by
//! more than 1/15 of the largest in the brick, or its corners from each other by more than 3/4 of that, or if a tube thinner
//! than 0.9 voxels comes near the brick. (Where the density is smooth the first difference is three times what the mean over
//! the cell differs by from the value at its centre, and both stay below for tubes of four voxels or more.)
//!
//! So a mean is kept where the density ends, and mass with it; a voxel may be active whose centre is outside. A cell from
//! which the edge takes less than its corners can show, the segment of a circle, is left to its centre: beside a tube with a
//! radius of four voxels that is 1/48 of the cell.

use std::ops::Range;

use cpu_time::ThreadTime;

use super::antialias::Antialias;
use super::dispatch::{activate, evaluate_block};
use super::hash::{BrickHash, ContentHash};
use super::pipeline::{AHEAD, in_order};
use super::{Brick, Encode, Plan, Sink, Total};
use crate::field::kernel::{Counts, Places, Scratch};
use crate::field::{Field, Region, VOXELS};
use crate::num::Level;

/// Bricks that one task evaluates and encodes as a run.
const RUN: usize = 32;
/// Bricks that are narrowed before any of them is evaluated: this is 2 to 3 % faster than one after the other, since each of the
/// two is much code, which changes places with the other's in the processor's nearest caches less often.
const NARROWED: usize = 8;
/// Bricks a thread that are encoded and not yet in the sink, at most: those waiting, and those worked on.
pub const IN_FLIGHT: usize = (AHEAD + 1) * RUN;

/// Processor seconds of all threads together.
#[derive(Debug, Clone, Copy, Default)]
pub struct Phases {
    /// Narrowing and evaluation.
    pub evaluate: f64,
    /// Encoding, and hashing of values.
    pub encode: f64,
    /// Handing runs to the sink.
    pub append: f64,
}

/// What a bake did.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Tally {
    /// Bricks with at least one active voxel.
    pub bricks: u64,
    /// Active voxels.
    pub active_voxels: u64,
    /// Voxels that store a mean over their cell.
    pub antialiased_voxels: u64,
    /// Lanes that entered the search for feet: voxels' centres, and other places of cells that may hold an edge.
    pub searched_voxels: u64,
    /// Lanes of these that went through bisection: near cusps and folds, and where axes meet.
    pub bisected_voxels: u64,
    /// Active voxels whose density was beyond the range of the sink's [`Precision`](super::Precision), and was clamped.
    pub clamped_voxels: u64,
    /// Active voxels whose density became 0 in that precision.
    pub vanished_voxels: u64,
    /// Voxels whose centres are inside a tube, counted for every piece of an axis that holds a foot of theirs.
    pub inside_voxels: u64,
    /// Voxels with several feet on one axis.
    pub several_feet_voxels: u64,
    /// Voxels inside a tube but beyond its focal set: there the distance to its axis has a local maximum.
    pub beyond_focal_voxels: u64,
    /// Sum of all stored values: the same for any number of threads, since runs are, and are added in file order.
    pub total: Total,
    /// Over all active bricks in file order: a [`ContentHash`].
    pub content_hash: [u8; 32],
}

/// Evaluates the plan's bricks on the current `rayon` pool and hands those with active voxels to `sink` in file order.
///
/// A voxel is active where its density is above `cutoff`; others are 0. Values are then rounded to the sink's precision,
/// which may leave an active voxel with a value at or below the cutoff. `progress` is called with the number of bricks
/// done since the last call. The content hash is a [`ContentHash`].
///
/// What is held at once is bounded: at most [`IN_FLIGHT`] bricks a thread are encoded and not yet in the sink.
///
/// # Errors
///
/// The sink's first error ends the bake.
pub fn bake<S: Sink>(
    field: &Field,
    plan: &Plan,
    cutoff: f64,
    level: Level,
    sink: &mut S,
    mut progress: impl FnMut(usize) + Send,
) -> Result<(Tally, Phases), S::Error> {
    let (mut tally, mut phases, mut hash) = (Tally::default(), Phases::default(), ContentHash::default());
    let (cutoff, encoder) = (single(cutoff), sink.encoder());
    let bricks = |run: usize| run * RUN..plan.bricks().min((run + 1) * RUN);
    in_order(
        plan.bricks().div_ceil(RUN),
        |worker: &mut Worker, run| worker.run(field, plan, bricks(run), cutoff, level, &encoder),
        |done: Done<_>| {
            let appending = ThreadTime::now();
            tally.bricks += done.digests.len() as u64;
            tally.active_voxels += done.active;
            tally.clamped_voxels += done.clamped;
            tally.vanished_voxels += done.vanished;
            tally.antialiased_voxels += done.antialiased;
            tally.searched_voxels += done.counts.searched;
            tally.bisected_voxels += done.counts.bisected;
            tally.inside_voxels += done.counts.inside;
            tally.several_feet_voxels += done.counts.several;
            tally.beyond_focal_voxels += done.counts.beyond;
            phases.evaluate += done.evaluate;
            phases.encode += done.encode;
            for digest in &done.digests {
                hash.push(digest);
            }
            tally.total.add(&done.total);
            sink.append(done.run)?;
            phases.append += appending.elapsed().as_secs_f64();
            progress(done.bricks);
            Ok(())
        },
    )?;
    tally.content_hash = hash.finish();
    Ok((tally, phases))
}

#[allow(clippy::cast_possible_truncation, reason = "values are single precision, so their threshold is")]
fn single(x: f64) -> f32 {
    x as f32
}

/// What a task gives back.
struct Done<Run> {
    /// Bricks that were evaluated.
    bricks: usize,
    run: Run,
    digests: Vec<BrickHash>,
    total: Total,
    active: u64,
    antialiased: u64,
    clamped: u64,
    vanished: u64,
    counts: Counts,
    evaluate: f64,
    encode: f64,
}

/// One thread's memory.
#[derive(Default)]
struct Worker {
    regions: [Region<f32>; NARROWED],
    scratch: Scratch<f32>,
    antialias: Antialias,
    /// The run's active bricks, and after them what may become one.
    bricks: Vec<Brick>,
}

impl Worker {
    fn run<E: Encode>(
        &mut self,
        field: &Field,
        plan: &Plan,
        bricks: Range<usize>,
        cutoff: f32,
        level: Level,
        encoder: &E,
    ) -> Done<E::Run> {
        let mut done = Done {
            bricks: bricks.len(),
            run: E::Run::default(),
            digests: Vec::new(),
            total: Total::default(),
            active: 0,
            antialiased: 0,
            clamped: 0,
            vanished: 0,
            counts: Counts::default(),
            evaluate: 0.0,
            encode: 0.0,
        };
        let started = ThreadTime::now();
        let empty = Brick { origin: [0; 3], mask: [0; 8], values: [0.0; VOXELS] };
        self.bricks.resize(RUN, empty);
        let mut held = 0;
        for first in bricks.clone().step_by(NARROWED) {
            let group = first..bricks.end.min(first + NARROWED);
            for (index, region) in group.clone().zip(&mut self.regions) {
                plan.narrow(field, index, region);
            }
            for (index, region) in group.zip(&self.regions) {
                if region.is_empty() {
                    continue;
                }
                let brick = &mut self.bricks[held];
                brick.origin = plan.origin(index);
                let mut counts =
                    evaluate_block(level, region, Places::Centres, &mut self.scratch, &mut brick.values);
                if plan.has_edge(index) {
                    let (cells, taken) =
                        self.antialias.smooth(level, region, &mut self.scratch, &mut brick.values);
                    done.antialiased += cells;
                    counts.searched += taken.searched;
                    counts.bisected += taken.bisected;
                }
                activate(level, cutoff, brick);
                done.counts.add(counts);
                let active = brick.active();
                if active > 0 {
                    done.active += u64::from(active);
                    let rounded = encoder.precision().round(&mut brick.values);
                    done.clamped += rounded.clamped as u64;
                    done.vanished += rounded.vanished as u64;
                    held += 1;
                }
            }
        }
        done.evaluate = started.elapsed().as_secs_f64();
        let evaluated = ThreadTime::now();
        for brick in &self.bricks[..held] {
            done.digests.push(BrickHash::new(brick));
            done.total.add_brick(brick);
            encoder.encode(brick, &mut done.run);
        }
        done.encode = evaluated.elapsed().as_secs_f64();
        done
    }
}
