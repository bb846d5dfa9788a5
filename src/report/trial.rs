//! Bakes that are only measured: in memory, of as many bricks as are looked at.

use std::collections::BTreeSet;
use std::io::Cursor;
use std::time::Instant;

use glam::DVec3;
use thiserror::Error;
use uuid::Uuid;

use super::support::Rows;
use crate::field::{Extent, Field, Lattice};
use crate::formats::vdb::{
    self, AnyTree, Encoder, FileHeader, GridClass, GridHeader, Metadata, VdbFile, VdbGridBuilder,
    VdbReadError, VdbWriteError, VectorType,
};
use crate::num::Level;
use crate::scene::Scene;
use crate::volume::{self, Filter, Phases, Plan, PlanError, Tally, Tree, planned_density_at, sample_at};

/// Why a trial came to nothing.
#[derive(Debug, Error)]
pub enum TrialError {
    /// The bricks cannot be planned.
    #[error(transparent)]
    Plan(#[from] PlanError),
    /// The bake failed.
    #[error(transparent)]
    Write(#[from] VdbWriteError),
    /// What was baked cannot be read.
    #[error(transparent)]
    Read(#[from] VdbReadError),
    /// There is too little memory.
    #[error("{needed} bytes of memory are needed")]
    Memory {
        /// Bytes that are about enough.
        needed: u64,
    },
}

/// A grid that was baked into a file in memory and read from there, and what that took.
#[derive(Debug)]
pub struct Trial {
    /// The values as a reader has them.
    pub tree: Tree<f32>,
    /// What the bake did.
    pub tally: Tally,
    /// Processor seconds of evaluation and encoding.
    pub phases: Phases,
    /// Seconds by the clock: evaluating and encoding, putting the file together, reading it.
    pub seconds: [f64; 3],
    /// Bytes of the file.
    pub bytes: u64,
}

impl Trial {
    /// Bakes a plan of a field on the current `rayon` pool.
    ///
    /// # Errors
    ///
    /// [`TrialError::Write`], [`TrialError::Read`].
    pub fn new(field: &Field, plan: &Plan, cutoff: f64, encoder: Encoder) -> Result<Trial, TrialError> {
        let started = Instant::now();
        let mut grid = VdbGridBuilder::with_encoder(encoder).with_room(plan.bricks());
        let (tally, phases) = volume::bake(field, plan, cutoff, Level::best(), &mut grid, |_| {})?;
        let baked = started.elapsed().as_secs_f64();
        let voxel_size = plan.lattice().voxel_size;
        let header = GridHeader {
            name: "density".to_owned(),
            class: GridClass::FogVolume,
            vector_type: VectorType::Invariant,
            voxel_size,
            translation: [0.5 * voxel_size; 3],
            metadata: Metadata::new(),
        };
        let mut file = Vec::new();
        let around = FileHeader { uuid: Uuid::nil(), metadata: Metadata::new() };
        let bytes = vdb::write(&mut file, &around, &[(&header, &grid)])?;
        drop(grid);
        let written = started.elapsed().as_secs_f64();
        let AnyTree::Float(tree) = VdbFile::open(Cursor::new(file))?.grid("density")?.tree else {
            return Err(VdbReadError::NoGrid("density".to_owned()).into());
        };
        let read = started.elapsed().as_secs_f64();
        Ok(Trial { tree, tally, phases, seconds: [baked, written - baked, read - written], bytes })
    }
}

/// The map from a lattice to the world: voxel i is the cell from i h to (i + 1) h.
pub fn rows(lattice: Lattice) -> Rows {
    let h = lattice.voxel_size;
    [[h, 0.0, 0.0, 0.5 * h], [0.0, h, 0.0, 0.5 * h], [0.0, 0.0, h, 0.5 * h]]
}

/// A scene that is tried at one voxel size after another.
#[derive(Debug)]
pub struct Pilot<'a> {
    scene: &'a Scene,
    /// At no voxel size.
    field: Field,
    budget: u64,
}

/// A pilot at one voxel size.
#[derive(Debug)]
pub struct Lot {
    /// The field, widened for it.
    pub field: Field,
    /// The bricks of a bake.
    pub plan: Plan,
    cutoff: f64,
    budget: u64,
}

impl<'a> Pilot<'a> {
    /// Of a scene at its time; each plan takes up to `budget` bytes.
    pub fn new(scene: &'a Scene, budget: u64) -> Pilot<'a> {
        Pilot { scene, field: Field::compile(scene), budget }
    }

    /// Of a scene that has been compiled.
    pub fn with(scene: &'a Scene, field: Field, budget: u64) -> Pilot<'a> {
        Pilot { scene, field, budget }
    }

    /// The scene.
    pub fn scene(&self) -> &Scene {
        self.scene
    }

    /// At a voxel size.
    ///
    /// # Errors
    ///
    /// As [`Plan::new`].
    pub fn at(&self, lattice: Lattice) -> Result<Lot, PlanError> {
        let field = self.widened(lattice);
        let plan = Plan::new(&field, lattice, self.budget)?;
        Ok(Lot { field, plan, cutoff: self.scene.bake().cutoff, budget: self.budget })
    }

    /// The field at a voxel size, with all bricks and some of their surroundings: what [`Lot::whole`] has, without the bake's.
    ///
    /// # Errors
    ///
    /// As [`Plan::new`].
    pub fn whole(&self, lattice: Lattice) -> Result<(Field, Plan), PlanError> {
        let field = self.widened(lattice);
        let plan = Plan::for_extent(&field, lattice, Extent::Whole, self.budget)?;
        Ok((field, plan))
    }

    fn widened(&self, lattice: Lattice) -> Field {
        let mut field = self.field.clone();
        field.widen(lattice);
        field
    }
}

impl Lot {
    /// Bricks that are baked at once on the current `rayon` pool: some KiB each.
    pub fn at_once() -> usize {
        const LEAST: usize = 1 << 9;
        /// For each thread, where these are many.
        const PER_THREAD: usize = 32;
        LEAST.max(PER_THREAD * rayon::current_num_threads())
    }

    /// The whole bake.
    ///
    /// # Errors
    ///
    /// As of [`Trial::new`].
    pub fn bake(&self, encoder: Encoder) -> Result<Trial, TrialError> {
        Trial::new(&self.field, &self.plan, self.cutoff, encoder)
    }

    /// That all of it can be baked at once, in memory.
    ///
    /// # Errors
    ///
    /// [`PlanError::TooMany`].
    pub fn fits(&self) -> Result<(), PlanError> {
        /// Bytes for a brick: its leaf as it is encoded, in the file, and as it is read.
        const BRICK: u64 = 8192;
        let bricks = self.plan.bricks();
        #[allow(clippy::cast_precision_loss, reason = "for a message")]
        let too_many = PlanError::TooMany { bricks: bricks as f64, enough: None };
        if (bricks as u64).saturating_mul(BRICK) > self.budget { Err(too_many) } else { Ok(()) }
    }

    /// All bricks with some of their surroundings, to spread points over.
    ///
    /// # Errors
    ///
    /// As [`Plan::new`].
    pub fn whole(&self) -> Result<Plan, PlanError> {
        Plan::for_extent(&self.field, self.plan.lattice(), Extent::Whole, self.budget)
    }

    /// What a file of this lattice has at points, by a filter: only bricks that are looked into are baked.
    ///
    /// # Errors
    ///
    /// As [`Trial::new`].
    pub fn values(&self, points: &[DVec3], filter: Filter, encoder: Encoder) -> Result<Vec<f64>, TrialError> {
        let h = self.plan.lattice().voxel_size;
        let most = Lot::at_once();
        if self.plan.bricks() <= most {
            let trial = Trial::new(&self.field, &self.plan, self.cutoff, encoder)?;
            let index: Vec<DVec3> = points.iter().map(|point| *point / h - 0.5).collect();
            return Ok(sample_at(&trial.tree, filter, &index));
        }
        let mut values = Vec::with_capacity(points.len());
        let (mut bricks, mut index) = (BTreeSet::new(), Vec::new());
        let mut take = |bricks: &mut BTreeSet<usize>, index: &mut Vec<DVec3>| {
            let part = self.plan.part(bricks.iter().copied());
            let trial = Trial::new(&self.field, &part, self.cutoff, encoder)?;
            values.extend(sample_at(&trial.tree, filter, index));
            bricks.clear();
            index.clear();
            Ok::<_, TrialError>(())
        };
        for point in points {
            let at = *point / h - 0.5;
            if bricks.len() + 8 > most {
                take(&mut bricks, &mut index)?;
            }
            bricks.extend(corners(at, filter).filter_map(|block| self.plan.find(block)));
            index.push(at);
        }
        take(&mut bricks, &mut index)?;
        Ok(values)
    }

    /// The density at points as voxels of this lattice would have it there, by the kernel.
    ///
    /// # Errors
    ///
    /// As [`Plan::new`].
    pub fn kernel(&self, points: &[DVec3]) -> Result<Vec<f64>, PlanError> {
        let plan = self.whole()?;
        Ok(planned_density_at(&self.field, &plan, points, Level::best()).into_iter().map(f64::from).collect())
    }
}

/// The bricks that a filter looks into at a point of index space, some more than once.
fn corners(at: DVec3, filter: Filter) -> impl Iterator<Item = [i64; 3]> {
    let [before, behind] = match filter {
        Filter::Nearest => [0.5; 2],
        Filter::Trilinear => [0.0, 1.0],
        Filter::Cubic => [-1.0, 2.0],
    };
    #[allow(clippy::cast_possible_truncation, reason = "saturates, and no brick lies there")]
    let ends =
        [before, behind].map(|shift| ((at + shift).floor() / 8.0).floor().to_array().map(|c| c as i64));
    (0..8).map(move |n: usize| [0, 1, 2].map(|axis| ends[n >> axis & 1][axis]))
}
