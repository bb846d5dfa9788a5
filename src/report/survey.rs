//! The error at a voxel size, from points alone.

use std::sync::atomic::{AtomicU64, Ordering};

use glam::DVec3;

use super::around::around;
use super::errors::{Errors, Intervals, intervals};
use super::exact::{Exact, unlimited};
use super::goal::Metric;
use super::parts::{Chain, Parts};
use super::ray::{Chord, chords};
use super::trial::{Lot, Pilot, TrialError};
use crate::field::{Extent, Field, Lattice};
use crate::formats::vdb::{Compression, Encoder};
use crate::num::Level;
use crate::num::quadrature::gauss_legendre;
use crate::reference::Reference;
use crate::scene::Scene;
use crate::volume::{Enough, Filter, Plan, PlanError, Precision, planned_density_at};

/// How far beside its bricks a bake is looked at, in voxels: as far as a filter may reach and more.
pub const MARGIN: f64 = 1.0;

/// Times as many points are taken where these leave an error vague.
pub(super) const MORE: usize = 4;
/// Half the width of a 95 % interval of the error, as a part of it, that is vague.
const VAGUE: f64 = 0.03;

/// Whether so many points do not tell the error well.
pub(super) fn is_vague(held: Option<&Intervals>) -> bool {
    held.and_then(|held| held.relative_l2).is_some_and(|[low, high]| high - low > VAGUE * (low + high))
}

/// What a survey looks at.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Look {
    /// Points; four times as many where these tell the error to no more than 3 %.
    pub points: usize,
    /// Rays.
    pub rays: usize,
    /// Other numbers give other points.
    pub stream: u64,
    /// How values between voxels are found.
    pub filter: Filter,
    /// How values are stored.
    pub precision: Precision,
}

/// Errors of bakes that are not made: only bricks around points are evaluated.
#[derive(Debug)]
pub struct Survey<'a> {
    pilot: Pilot<'a>,
    exact: Reference,
    look: Look,
    budget: u64,
    /// Bytes of each brick of a bake, and how many times the budget they may take together with the bake's plan.
    baked: Option<[u64; 2]>,
    /// Bytes that the last plans took, or a part of what their bake does.
    planned: AtomicU64,
}

impl<'a> Survey<'a> {
    /// Of a scene at its time; plans take up to `budget` bytes.
    pub fn new(scene: &'a Scene, look: Look, budget: u64) -> Survey<'a> {
        Survey::with(scene, Field::compile(scene), look, budget)
    }

    /// Of a scene that has been compiled.
    pub fn with(scene: &'a Scene, field: Field, look: Look, budget: u64) -> Survey<'a> {
        let (pilot, exact) = (Pilot::with(scene, field, budget), Reference::new(scene, None));
        Survey { pilot, exact, look, budget, baked: None, planned: AtomicU64::new(0) }
    }

    /// The same where also the bake must fit: of the plan's own bytes, and so many for each brick, there may be `times` the
    /// budget.
    #[must_use]
    pub fn for_bakes(self, brick: u64, times: u64) -> Survey<'a> {
        Survey { baked: Some([brick, times]), ..self }
    }

    /// The same look at another scene, held against that one's definition.
    pub fn of<'b>(&self, scene: &'b Scene) -> Survey<'b> {
        Survey { baked: self.baked, ..Survey::new(scene, self.look, self.budget) }
    }

    /// Whether the bricks of a voxel size can be planned.
    pub fn has_room(&self, voxel_size: f64) -> bool {
        self.lot(voxel_size).and_then(|lot| lot.whole()).is_ok()
    }

    /// A bake that has room.
    fn lot(&self, voxel_size: f64) -> Result<Lot, PlanError> {
        let lot = self.pilot.at(Lattice { voxel_size })?;
        let bytes = self.share_of(&lot);
        #[allow(clippy::cast_precision_loss, reason = "for a message")]
        let too_many =
            PlanError::TooMany { bricks: lot.plan.bricks() as f64, enough: Some(Enough { bytes, nodes: 0 }) };
        if bytes <= self.budget { Ok(lot) } else { Err(too_many) }
    }

    /// The budget that is enough for the bake.
    fn share_of(&self, lot: &Lot) -> u64 {
        let Some([brick, times]) = self.baked else { return 0 };
        (lot.plan.memory() as u64 + brick * lot.plan.bricks() as u64).div_ceil(times)
    }

    /// Bytes of the budget that the last error took.
    pub fn planned(&self) -> u64 {
        self.planned.load(Ordering::Relaxed)
    }

    /// The error at a voxel size in metres by a metric; 0 where there is no density.
    ///
    /// # Errors
    ///
    /// Where the bricks cannot be planned.
    pub fn error(&self, voxel_size: f64, metric: Metric) -> Result<f64, TrialError> {
        let lot = self.lot(voxel_size)?;
        let spread = |points: usize| -> Result<Vec<DVec3>, PlanError> {
            let whole = lot.whole()?;
            let planned = whole.making().max(lot.plan.making()) as u64;
            self.planned.store(planned.max(self.share_of(&lot)), Ordering::Relaxed);
            Ok(around(&whole, MARGIN, points, self.look.stream).points)
        };
        let points = spread(self.look.points)?;
        if metric == Metric::OpticalDepth {
            return self.along_rays(&lot, &points);
        }
        let found = |points: &[DVec3]| -> Result<[Vec<f64>; 2], TrialError> {
            Ok([Exact::at(&self.exact, points), lot.values(points, self.look.filter, self.encoder())?])
        };
        let [mut truth, mut stored] = found(&points)?;
        drop(points);
        if metric == Metric::L2 && is_vague(intervals(&truth, &stored).as_ref()) {
            drop((truth, stored));
            [truth, stored] = found(&spread(MORE * self.look.points)?)?;
        }
        let errors = Errors::new(truth.iter().copied().zip(stored.iter().copied()), None);
        let relative = |part: Option<f64>| part.unwrap_or(f64::INFINITY);
        Ok(match metric {
            Metric::L2 => relative(errors.l2.of_rms),
            Metric::Max => relative(errors.max.of_peak),
            Metric::Mass | Metric::OpticalDepth => {
                let Some(held) = intervals(&truth, &stored) else { return Ok(0.0) };
                let off = |ratio: f64| (ratio - 1.0).abs();
                let unknown = if errors.is_of_nothing() { 0.0 } else { f64::INFINITY };
                held.ratio.map_or(unknown, |[low, high]| off(low).max(off(high)))
            }
        })
    }

    /// All errors of a pilot at points, and their intervals.
    ///
    /// # Errors
    ///
    /// Where the bricks cannot be planned.
    pub fn errors(&self, lot: &Lot) -> Result<(Errors, Option<Intervals>), TrialError> {
        let points = around(&lot.whole()?, MARGIN, self.look.points, self.look.stream).points;
        let truth = Exact::at(&self.exact, &points);
        let stored = lot.values(&points, self.look.filter, self.encoder())?;
        let errors = Errors::new(truth.iter().copied().zip(stored.iter().copied()), None);
        Ok((errors, intervals(&truth, &stored)))
    }

    /// The error at a voxel size in metres taken apart.
    ///
    /// # Errors
    ///
    /// Where the bricks cannot be planned.
    pub fn parts(&self, voxel_size: f64) -> Result<Parts, TrialError> {
        let lot = self.pilot.at(Lattice { voxel_size })?;
        let points = around(&lot.whole()?, MARGIN, self.look.points, self.look.stream).points;
        let stored = lot.values(&points, self.look.filter, self.encoder())?;
        self.parts_of(&lot, &points, &Exact::at(&self.exact, &points), &stored)
    }

    /// The error of stored values at points, where the truth is known, taken apart.
    ///
    /// # Errors
    ///
    /// Where the bricks cannot be planned.
    pub fn parts_of(
        &self,
        lot: &Lot,
        points: &[DVec3],
        truth: &[f64],
        stored: &[f64],
    ) -> Result<Parts, TrialError> {
        let single = || lot.values(points, self.look.filter, Encoder::new(Compression::None));
        let single = (self.look.precision == Precision::F16).then(single).transpose()?;
        let kernel = lot.kernel(points)?;
        Ok(self.chained(lot.plan.lattice(), points, [truth, stored], single.as_deref(), &kernel))
    }

    /// The same at a lattice where the kernel's values are known, too; bricks are only planned where it takes them.
    ///
    /// # Errors
    ///
    /// Where the bricks cannot be planned.
    pub fn parts_at(
        &self,
        lattice: Lattice,
        points: &[DVec3],
        [truth, stored]: [&[f64]; 2],
        kernel: &[f64],
    ) -> Result<Parts, TrialError> {
        let single = || {
            let lot = self.pilot.at(lattice)?;
            lot.values(points, self.look.filter, Encoder::new(Compression::None))
        };
        let single = (self.look.precision == Precision::F16).then(single).transpose()?;
        Ok(self.chained(lattice, points, [truth, stored], single.as_deref(), kernel))
    }

    /// `single` are voxels in single precision, where those of the file are not.
    fn chained(
        &self,
        lattice: Lattice,
        points: &[DVec3],
        [truth, stored]: [&[f64]; 2],
        single: Option<&[f64]>,
        kernel: &[f64],
    ) -> Parts {
        let limited = Reference::new(self.pilot.scene(), Some(lattice.voxel_size));
        let limited = Exact::guided(&limited, points, kernel);
        let voxels = single.unwrap_or(stored);
        Parts::new(&Chain { truth, limited: &limited, kernel, voxels, stored })
    }

    /// The scene at voxel sizes.
    pub fn pilot(&self) -> &Pilot<'a> {
        &self.pilot
    }

    fn encoder(&self) -> Encoder {
        Encoder::new(Compression::None).with_precision(self.look.precision)
    }

    /// The relative error of optical depths, by Gauss's rule of two points in every stretch of at most a voxel.
    fn along_rays(&self, lot: &Lot, points: &[DVec3]) -> Result<f64, TrialError> {
        /// Places on rays that are looked at together.
        const TOGETHER: usize = 1 << 14;
        let lattice = lot.plan.lattice();
        let plan = lot.whole()?;
        let Some(bounds) = corners(&plan) else { return Ok(0.0) };
        let field = Field::compile(&unlimited(self.pilot.scene()));
        let exact = Plan::for_extent(&field, lattice, Extent::Whole, self.budget)?;
        let rule = gauss_legendre(2);
        let chords = chords(bounds, points, self.look.rays);
        let mut depths = vec![(0.0, 0.0); chords.len()];
        let mut nodes = Vec::with_capacity(TOGETHER);
        let mut take = |nodes: &mut Vec<(usize, DVec3, f64)>| {
            let places: Vec<DVec3> = nodes.iter().map(|(_, at, _)| *at).collect();
            let stored = lot.values(&places, self.look.filter, self.encoder())?;
            let truth = planned_density_at(&field, &exact, &places, Level::best());
            for (((number, _, weight), truth), stored) in nodes.iter().zip(truth).zip(stored) {
                depths[*number].0 += weight * f64::from(truth);
                depths[*number].1 += weight * stored;
            }
            nodes.clear();
            Ok::<_, TrialError>(())
        };
        for (number, chord) in chords.iter().enumerate() {
            for (at, weight) in along(chord, lattice.voxel_size, &rule) {
                if near(&plan, at) {
                    nodes.push((number, at, weight));
                }
                if nodes.len() == TOGETHER {
                    take(&mut nodes)?;
                }
            }
        }
        take(&mut nodes)?;
        let pairs = depths;
        Ok(Errors::new(pairs.into_iter(), None).l2.of_rms.unwrap_or(f64::INFINITY))
    }
}

/// Corners of the box around a plan's bricks, in metres.
fn corners(plan: &Plan) -> Option<[DVec3; 2]> {
    let h = plan.lattice().voxel_size;
    let corners = plan.origins().map(|origin| {
        let low = DVec3::from(origin.map(f64::from)) * h;
        [low, low + 8.0 * h]
    });
    corners.reduce(|[low, high], [l, h]| [low.min(l), high.max(h)])
}

/// Whether a point lies in a brick or within a voxel of one.
fn near(plan: &Plan, point: DVec3) -> bool {
    let at = point / plan.lattice().voxel_size;
    (0..27).any(|n: i32| {
        let shift = DVec3::new(f64::from(n / 9 - 1), f64::from(n / 3 % 3 - 1), f64::from(n % 3 - 1));
        #[allow(clippy::cast_possible_truncation, reason = "saturates, and no brick lies there")]
        let block = ((at + MARGIN * shift) / 8.0).floor().to_array().map(|c| c as i64);
        plan.find(block).is_some()
    })
}

/// Places and weights along a chord.
fn along(chord: &Chord, step: f64, rule: &[[f64; 2]]) -> impl Iterator<Item = (DVec3, f64)> {
    let [from, to] = chord.range;
    // No more than a million stretches of each.
    chord.stretches([from, to], step.max((to - from) * 1e-6), rule)
}
