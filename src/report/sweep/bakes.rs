//! Bakes at many settings.

use std::time::Instant;

use super::Run;
use super::rows::{Cost, FieldError, Kind, Row, Settings, Spread};
use crate::field::Lattice;
use crate::formats::vdb::{Compression, Encoder};
use crate::report::around::around;
use crate::report::exact::Exact;
use crate::report::field::compare_at;
use crate::report::octaves::{most_octaves, with_octaves};
use crate::report::source::Gridded;
use crate::report::survey::MARGIN;
use crate::report::trial::{Lot, Pilot, Trial, TrialError, rows};
use crate::scene::Scene;
use crate::volume::{Filter, Plan, PlanError, Precision, Tree};

/// Times the scene's own voxel size.
const SIZES: [f64; 6] = [1.0, 2.0, 4.0, std::f64::consts::SQRT_2, 2.0 * std::f64::consts::SQRT_2, 8.0];
/// Smaller ones, which take longer: only where all their repeats are likely to take no more than a part of the time.
const SMALLER: [f64; 4] = [std::f64::consts::FRAC_1_SQRT_2, 0.5, 0.5 * std::f64::consts::FRAC_1_SQRT_2, 0.25];
const DEAR: f64 = 0.1;
pub(super) const FILTERS: [Filter; 3] = [Filter::Trilinear, Filter::Nearest, Filter::Cubic];

/// A filter's word on the command line.
pub(super) fn filter_name(filter: Filter) -> &'static str {
    match filter {
        Filter::Nearest => "nearest",
        Filter::Trilinear => "trilinear",
        Filter::Cubic => "cubic",
    }
}

fn compression_name(compression: Compression) -> &'static str {
    match compression {
        Compression::Blosc => "blosc",
        Compression::Zip => "zip",
        Compression::None => "none",
    }
}

fn precision_name(precision: Precision) -> &'static str {
    match precision {
        Precision::F32 => "f32",
        Precision::F16 => "f16",
    }
}

/// What a bake is made with.
#[derive(Clone, Copy)]
struct Making<'a> {
    /// May be another than the one that it is held against.
    scene: &'a Scene,
    lattice: Lattice,
    encoder: Encoder,
    octaves: Option<u32>,
}

/// A scene's exact density, and places to look at it.
pub(super) struct Held {
    lattice: Lattice,
    whole: Plan,
    stream: u64,
    places: crate::report::support::Spread,
    exact: Exact,
    /// Points that were asked for, and that may be at most.
    points: usize,
    most: usize,
}

/// Times as many points that may be taken where these met too little density for an interval.
const MORE: usize = 4;
const MOST: usize = 64;
/// Why a bake has no row.
pub(super) const UNSEEN: &str = "points met almost no density";

impl Held {
    /// How far a bake is off, at more points where these do not tell within which bounds; `None` where those do not either.
    pub(super) fn error(
        &mut self,
        tree: &Tree<f32>,
        filter: Filter,
        rays: usize,
    ) -> Result<Option<FieldError>, TrialError> {
        let file = Gridded::new(tree.clone(), rows(self.lattice), filter).ok_or(PlanError::TooWide)?;
        loop {
            let (found, _) = compare_at(&self.exact, &file, &self.places, rays);
            // Where there are no bricks, there is nothing to be met.
            let is_told = found.intervals.is_none_or(|held| held.relative_l2.is_some());
            if is_told {
                return Ok(Some(FieldError {
                    errors: found.errors,
                    intervals: found.intervals,
                    optical_depth: found.optical_depth.l2.of_rms,
                    mass_ratio: found.mass.ratio,
                }));
            }
            if self.points >= self.most {
                return Ok(None);
            }
            self.points *= MORE;
            self.places = around(&self.whole, MARGIN, self.points, self.stream);
        }
    }
}

impl Run<'_> {
    /// Those that matter most: voxel size and filter, precision and codec.
    pub(super) fn bakes(&mut self) -> Result<(), TrialError> {
        self.sizes(&SIZES)?;
        let (scene, lattice) = (self.scene, self.lattice);
        for (precision, compression) in [
            (Precision::F16, Compression::Blosc),
            (Precision::F32, Compression::None),
            (Precision::F32, Compression::Zip),
            (Precision::F16, Compression::None),
            (Precision::F16, Compression::Zip),
        ] {
            let label = format!("{} {}", precision_name(precision), compression_name(compression));
            if self.time_for(&label) {
                let encoder = Encoder::new(compression).with_precision(precision);
                let making = Making { scene, lattice, encoder, octaves: None };
                self.bake("precision and codec", &label, making, &[Filter::Trilinear])?;
            }
        }
        Ok(())
    }

    /// Fewer octaves, and smaller voxels.
    pub(super) fn more_bakes(&mut self) -> Result<(), TrialError> {
        let most = most_octaves(self.scene);
        for octaves in (0..most).rev() {
            let label = match octaves {
                0 => "no noise".to_owned(),
                1 => "1 octave".to_owned(),
                octaves => format!("{octaves} octaves"),
            };
            if self.time_for(&label) {
                let (scene, lattice) = (with_octaves(self.scene, octaves), self.lattice);
                let encoder = Encoder::new(Compression::Blosc);
                let making = Making { scene: &scene, lattice, encoder, octaves: Some(octaves) };
                self.bake("octaves", &label, making, &[Filter::Trilinear])?;
            }
        }
        self.sizes(&SMALLER)
    }

    fn sizes(&mut self, factors: &[f64]) -> Result<(), TrialError> {
        for factor in factors {
            let label = format!("{factor:.3} times the voxel");
            if *factor < 1.0 && self.is_dear(*factor) {
                self.left_out.push(label);
                continue;
            }
            if self.time_for(&label) {
                let lattice = Lattice { voxel_size: factor * self.lattice.voxel_size };
                let making = Making {
                    scene: self.scene,
                    lattice,
                    encoder: Encoder::new(Compression::Blosc),
                    octaves: None,
                };
                match self.bake("voxel size and filter", &label, making, &FILTERS) {
                    Err(TrialError::Plan(PlanError::TooMany { .. })) if *factor < 1.0 => {
                        self.left_out.push(format!("{label}: no room for the plan"));
                    }
                    other => other?,
                }
            }
        }
        Ok(())
    }

    /// Whether bakes at a voxel size, over the scene's own, are likely to take much of the time: they take as long as they
    /// have voxels.
    fn is_dear(&self, factor: f64) -> bool {
        let sizes = self.rows.iter().filter(|row| row.group == "voxel size and filter");
        let finest = sizes.min_by(|a, b| a.settings.voxel_size.total_cmp(&b.settings.voxel_size));
        let Some((size, total)) = finest.and_then(|row| Some((row.settings.voxel_size, row.cost.total?)))
        else {
            return false;
        };
        let finer = size / (factor * self.lattice.voxel_size);
        #[allow(clippy::cast_precision_loss, reason = "few")]
        let runs = (self.effort.repeats + 1) as f64;
        runs * total.median * finer * finer * finer > DEAR * self.effort.time.as_secs_f64()
    }

    /// A row for each filter.
    fn bake(
        &mut self,
        group: &'static str,
        label: &str,
        making: Making<'_>,
        filters: &[Filter],
    ) -> Result<(), TrialError> {
        let Making { scene, lattice, encoder, octaves } = making;
        let pilot = Pilot::new(scene, self.effort.budget);
        let (cost, tree) = self.costs(&pilot, lattice, encoder)?;
        let mut held = self.held_against(self.scene, lattice, self.effort.points)?;
        for filter in filters {
            let name = if filters.len() > 1 {
                format!("{label}, {}", filter_name(*filter))
            } else {
                label.to_owned()
            };
            let Some(field) = held.error(&tree, *filter, self.effort.rays)? else {
                self.left_out.push(format!("{name}: {UNSEEN}"));
                continue;
            };
            let (precision, compression) =
                (precision_name(encoder.precision()), compression_name(encoder.compression()));
            let command = octaves.is_none().then(|| {
                format!(
                    "vdbake bake SCENE --voxel-size {:?} --precision {precision} --compression {compression}{}",
                    lattice.voxel_size,
                    self.at_time()
                )
            });
            self.rows.push(Row {
                group,
                label: name,
                kind: Kind::Bake,
                is_own: true,
                settings: Settings {
                    voxel_size: lattice.voxel_size,
                    filter: Some(filter_name(*filter)),
                    precision: Some(precision),
                    compression: Some(compression),
                    octaves,
                    step: None,
                    method: None,
                },
                command,
                field: Some(field),
                image: None,
                cost: cost.clone(),
                on_front: false,
            });
        }
        Ok(())
    }

    /// What bakes of a scene at a lattice are held against.
    pub(super) fn held_against(
        &self,
        scene: &Scene,
        lattice: Lattice,
        points: usize,
    ) -> Result<Held, TrialError> {
        let whole = Pilot::new(scene, self.effort.budget).at(lattice)?.whole()?;
        let stream = self.look(Precision::F32, Filter::Trilinear).stream;
        let places = around(&whole, MARGIN, points, stream);
        let exact = Exact::new(scene, lattice, self.effort.budget)?;
        Ok(Held { lattice, whole, stream, places, exact, points, most: MOST * points })
    }

    /// What a bake takes, and its values.
    pub(super) fn costs(
        &self,
        pilot: &Pilot<'_>,
        lattice: Lattice,
        encoder: Encoder,
    ) -> Result<(Cost, Tree<f32>), TrialError> {
        let mut times: [Vec<f64>; 6] = Default::default();
        let cutoff = pilot.scene().bake().cutoff;
        let once = || -> Result<(Trial, usize, f64), TrialError> {
            let started = Instant::now();
            let lot = pilot.at(lattice)?;
            lot.fits()?;
            let Lot { field, plan, .. } = lot;
            let planned = started.elapsed().as_secs_f64();
            Ok((Trial::new(&field, &plan, cutoff, encoder)?, Plan::memory(&plan), planned))
        };
        let (mut last, mut memory, _) = once()?;
        for _ in 0..self.effort.repeats {
            let planned;
            (last, memory, planned) = once()?;
            let [baking, writing, reading] = last.seconds;
            let all = [
                planned,
                last.phases.evaluate,
                last.phases.encode + last.phases.append,
                writing,
                reading,
                planned + baking + writing,
            ];
            for (times, seconds) in times.iter_mut().zip(all) {
                times.push(seconds);
            }
            if self.begun.elapsed() > self.effort.time {
                break;
            }
        }
        let [plan, evaluate, encode, write, read, total] = times.map(Spread::of);
        let voxels = last.tally.active_voxels;
        #[allow(clippy::cast_precision_loss, reason = "a ratio")]
        let ns = evaluate.filter(|_| voxels > 0).map(|evaluate| 1e9 * evaluate.median / voxels as f64);
        let cost = Cost {
            plan,
            evaluate,
            encode,
            write,
            read,
            march: None,
            total,
            bytes: Some(last.bytes),
            memory: Some(memory as u64 + last.bytes),
            active_voxels: Some(voxels),
            ns_per_voxel: ns,
            evaluated_places: None,
        };
        Ok((cost, last.tree))
    }
}
