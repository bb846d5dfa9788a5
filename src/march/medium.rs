//! What light goes through.

use glam::DVec3;

use super::baked::Baked;
use super::bins::Bins;
use super::grid::{Bricks, Grid};
use super::planes::Planes;
use super::procedural::{Procedural, Worker};
use super::rays::{Hits, Rays};
use super::shade::{Lit, Wanted};
use super::tiles::Seen;
use crate::num::Level;

/// A brick on the rays' way.
#[derive(Clone, Copy)]
pub(super) struct Brick<'a> {
    pub(super) block: [i32; 3],
    pub(super) seen: &'a Seen,
    pub(super) wanted: &'a Wanted,
    pub(super) lit: &'a Lit<'a>,
}

/// A tile's rays, and memory for those that meet a brick.
#[derive(Default)]
pub(super) struct Way {
    pub(super) rays: Rays,
    pub(super) hits: Hits,
    pub(super) planes: Planes,
}

/// What light goes through: density in bricks of 8^3 cells of a grid, each with one of two kinds of density.
#[derive(Debug)]
#[allow(clippy::large_enum_variant, reason = "there is one of them")]
pub enum Medium<'a> {
    /// Voxels, and what is linear between them.
    Baked(Baked),
    /// A scene's density itself.
    Procedural(Procedural<'a>),
}

impl Medium<'_> {
    /// Where its cells are.
    pub fn grid(&self) -> &Grid {
        match self {
            Medium::Baked(baked) => baked.grid(),
            Medium::Procedural(procedural) => procedural.grid(),
        }
    }

    /// Bricks that may have density.
    pub(super) fn bricks(&self) -> &Bricks {
        match self {
            Medium::Baked(baked) => baked.bricks(),
            Medium::Procedural(procedural) => procedural.bricks(),
        }
    }

    /// Of voxels: the same with those of twice the size, so many times over.
    #[must_use]
    pub fn coarser(&self, times: u32) -> Option<Medium<'static>> {
        let Medium::Baked(baked) = self else { return None };
        (times > 0).then(|| Medium::Baked(baked.coarser(times)))
    }

    /// Of a scene: [`Procedural::places`].
    pub fn places(&self) -> Option<[u64; 2]> {
        match self {
            Medium::Baked(_) => None,
            Medium::Procedural(procedural) => Some(procedural.places()),
        }
    }

    /// Cells between two samples of a scene's density along a ray.
    pub(super) fn step(&self) -> f64 {
        match self {
            Medium::Baked(_) => 1.0,
            Medium::Procedural(procedural) => procedural.step(),
        }
    }

    /// Number of bricks that may have density.
    pub fn brick_count(&self) -> usize {
        self.bricks().blocks.len()
    }

    /// Gets ready to carry a tile's new rays.
    pub(super) fn begin(&self, way: &mut Way, wanted: &Wanted, worker: &mut Worker) {
        match self {
            Medium::Baked(baked) => baked.begin(way, wanted),
            Medium::Procedural(procedural) => procedural.begin(&way.rays, worker),
        }
    }

    /// Carries the rays of a tile through a brick.
    pub(super) fn carry(&self, level: Level, brick: Brick<'_>, way: &mut Way, worker: &mut Worker) {
        match self {
            Medium::Baked(baked) => baked.carry(level, brick, way),
            Medium::Procedural(procedural) => procedural.carry(level, brick, way, worker),
        }
    }

    /// Records the optical depth of pieces of a tile's rays within a brick.
    pub(super) fn record(
        &self,
        level: Level,
        brick: Brick<'_>,
        way: &mut Way,
        bins: &mut Bins,
        worker: &mut Worker,
    ) {
        match self {
            Medium::Baked(baked) => baked.record(level, brick, way, bins),
            Medium::Procedural(procedural) => procedural.record(level, brick, way, bins, worker),
        }
    }

    /// Adds the densities at places of a brick, in cells from its corner, to `out`.
    pub(super) fn densities(
        &self,
        brick: usize,
        places: &[DVec3],
        level: Level,
        worker: &mut Worker,
        out: &mut Vec<f32>,
    ) {
        match self {
            Medium::Baked(baked) => baked.densities(brick, places, out),
            Medium::Procedural(procedural) => procedural.densities(brick, places, level, worker, out),
        }
    }

    /// A density that no place of a brick is above.
    pub(super) fn majorant(&self, brick: usize, worker: &mut Worker) -> f32 {
        match self {
            Medium::Baked(baked) => baked.majorant(brick),
            Medium::Procedural(procedural) => procedural.majorant(brick, worker),
        }
    }
}
