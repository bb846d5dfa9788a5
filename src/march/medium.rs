//! What light goes through.

use glam::DVec3;
use rayon::prelude::*;

use super::baked::Baked;
use super::bins::Bins;
use super::grid::{Bricks, EDGE, Grid};
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

    /// Of a scene: [`Procedural::places`].
    pub fn places(&self) -> Option<[u64; 2]> {
        match self {
            Medium::Baked(_) => None,
            Medium::Procedural(procedural) => Some(procedural.places()),
        }
    }

    /// Number of bricks that may have density.
    pub fn brick_count(&self) -> usize {
        self.bricks().blocks.len()
    }

    /// Gets ready to carry a tile's new rays.
    pub(super) fn begin(&self, rays: &Rays, worker: &mut Worker) {
        if let Medium::Procedural(procedural) = self {
            procedural.begin(rays, worker);
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

    /// The densities at points of the grid's space, on all threads.
    pub(super) fn densities_at(&self, points: &[DVec3], level: Level) -> Vec<f32> {
        let bricks = self.bricks();
        let edge = f64::from(EDGE);
        let mut order: Vec<(usize, usize)> = points
            .par_iter()
            .enumerate()
            .filter_map(|(number, point)| {
                let block = (*point / edge).floor();
                if !block.is_finite() || block.abs().max_element() > f64::from(i32::MAX / EDGE) {
                    return None;
                }
                #[allow(clippy::cast_possible_truncation, reason = "whole, and small enough")]
                let block = block.to_array().map(|c| c as i32);
                Some((bricks.find(block)?, number))
            })
            .collect();
        order.par_sort_unstable();
        let groups: Vec<&[(usize, usize)]> = order.chunk_by(|a, b| a.0 == b.0).collect();
        let found: Vec<Vec<f32>> = groups
            .par_iter()
            .map_init(Worker::default, |worker, group| {
                let mut found = Vec::with_capacity(group.len());
                let Some((brick, _)) = group.first() else { return found };
                let corner = DVec3::from(bricks.blocks[*brick].map(|c| f64::from(c) * edge));
                let places: Vec<DVec3> = group.iter().map(|(_, number)| points[*number] - corner).collect();
                self.densities(*brick, &places, level, worker, &mut found);
                found
            })
            .collect();
        let mut densities = vec![0.0; points.len()];
        for (group, found) in groups.into_iter().zip(found) {
            for ((_, number), density) in group.iter().zip(found) {
                densities[*number] = density;
            }
        }
        densities
    }
}
