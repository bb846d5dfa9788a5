//! `vdbake plan`: what a bake would take.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::time::Instant;

use clap::Args;
use serde::Serialize;

use super::estimate::{Estimate, Planned, Way};
use super::job::{Job, Moment, Options, SamplingError, Source, sampling_errors};
use super::memory;
use super::progress::Planning;
use super::{Failure, Global, text};
use crate::num::Level;
use crate::scene::Scene;

/// Seconds after which no larger sample is begun.
const PATIENCE: f64 = 0.5;
/// The same for all frames together.
const ALL_PATIENCE: f64 = 10.0;

#[derive(Debug, Args)]
pub(super) struct Arguments {
    /// The scene to plan for
    scene: PathBuf,
    #[command(flatten)]
    options: Options,
}

/// What a bake would take, as `--json` prints it.
#[derive(Debug, Serialize)]
struct Report {
    scene: String,
    /// Null but in a sequence.
    frame: Option<i64>,
    time: f64,
    voxel_size: f64,
    /// Corners of the box around the density, in metres.
    bounds: Option<[[f64; 3]; 2]>,
    /// Voxels along each side of that box.
    dimensions: [u64; 3],
    precision: &'static str,
    compression: &'static str,
    /// All that would be searched; some may stay empty.
    planned_bricks: u64,
    at_most: Limits,
    /// The least memory that the bake can do with, most values on disk.
    least_memory_bytes: u64,
    estimated: Estimate,
    threads: usize,
    simd: String,
    left_out: Vec<String>,
    /// What in the scene is hardly meant, each with its line and column.
    warnings: Vec<String>,
    /// How far radii that are read from files may be off between their samples.
    sampling_errors: Vec<SamplingError>,
}

/// Upper bounds.
#[derive(Debug, Default, Serialize)]
struct Limits {
    active_voxels: u64,
    /// Of the file.
    bytes: u64,
    /// Of the spool beside it.
    spooled_bytes: u64,
    /// That the process takes.
    memory_bytes: u64,
}

/// What all frames would take together, as `--json` prints it; memory and spool are those of the frame that takes the most.
#[derive(Debug, Default, Serialize)]
struct Total {
    frames: u64,
    planned_bricks: u64,
    at_most: Limits,
    estimated: Estimate,
}

impl Total {
    fn add(&mut self, frame: &Report) {
        let (most, estimated) = (&mut self.at_most, &mut self.estimated);
        self.frames += 1;
        self.planned_bricks += frame.planned_bricks;
        most.active_voxels += frame.at_most.active_voxels;
        most.bytes += frame.at_most.bytes;
        most.spooled_bytes = most.spooled_bytes.max(frame.at_most.spooled_bytes);
        most.memory_bytes = most.memory_bytes.max(frame.at_most.memory_bytes);
        estimated.sampled_bricks += frame.estimated.sampled_bricks;
        estimated.active_voxels += frame.estimated.active_voxels;
        estimated.bytes += frame.estimated.bytes;
        estimated.spooled_bytes = estimated.spooled_bytes.max(frame.estimated.spooled_bytes);
        estimated.memory_bytes = estimated.memory_bytes.max(frame.estimated.memory_bytes);
        estimated.seconds += frame.estimated.seconds;
        estimated.cpu_seconds += frame.estimated.cpu_seconds;
    }
}

/// Plans.
pub(super) fn run(arguments: &Arguments, global: &Global) -> Result<(), Failure> {
    let mut started = Instant::now();
    let options = &arguments.options;
    let pool = global.pool()?;
    let mut planning = Some(Planning::new(global.quiet));
    let source = Source::read(&arguments.scene, &options.scene)?;
    let moments = options.moments(&source)?;
    if !options.is_sequence() {
        let (report, scene) = pool.install(|| plan(&source, moments[0], options, started, PATIENCE))?;
        drop(planning);
        global.warn_of(scene.warnings());
        return global.show(&report, |report| human(report, options.explain));
    }
    moments.iter().try_for_each(|moment| source.start.at(moment.time).map(drop))?;
    #[allow(clippy::cast_precision_loss, reason = "patience is not precise")]
    let patience = PATIENCE.min(ALL_PATIENCE / moments.len() as f64);
    let (mut total, mut told) = (Total::default(), BTreeSet::new());
    for moment in &moments {
        let (report, scene) = pool.install(|| plan(&source, *moment, options, started, patience))?;
        planning = None;
        if told.insert(text::warnings(scene.warnings())) {
            global.warn_of(scene.warnings());
        }
        total.add(&report);
        global.show_one(&report, |report| brief(report, options.explain))?;
        started = Instant::now();
    }
    drop(planning);
    global.show_one(&total, all)
}

/// Plans one file; gives the scene, too. `started` is when this was begun, `patience` what the estimate has.
fn plan(
    source: &Source,
    moment: Moment,
    options: &Options,
    started: Instant,
    patience: f64,
) -> Result<(Report, Scene), Failure> {
    let job = Job::new(source, moment, options)?;
    let plan = job.plan()?;
    let planning = started.elapsed().as_secs_f64();
    let bound = job.bound(&plan);
    let need = job.need(&plan, &bound);
    let planned =
        Planned { plan: &plan, bound: &bound, need: &need, empty: job.empty_file()?, seconds: planning };
    let report = Report {
        scene: job.scene.name().to_owned(),
        frame: moment.frame,
        time: job.settings.time,
        voxel_size: job.lattice.voxel_size,
        bounds: job.bounds,
        dimensions: job.dimensions(),
        precision: job.settings.precision,
        compression: job.settings.compression,
        planned_bricks: plan.bricks() as u64,
        at_most: Limits {
            active_voxels: 512 * plan.bricks() as u64,
            bytes: planned.empty + bound.bytes(),
            spooled_bytes: need.spool(job.budget()),
            memory_bytes: need.most(job.budget()),
        },
        least_memory_bytes: need.least(),
        // The folder where a bake goes that is not told otherwise.
        estimated: Estimate::new(&job, &planned, patience, Some(Path::new(".")))?,
        threads: rayon::current_num_threads(),
        simd: Level::best().name(),
        left_out: job.field.left_out(job.lattice, plan.has_edges()),
        warnings: text::warnings(job.scene.warnings()),
        sampling_errors: sampling_errors(&job.scene),
    };
    Ok((report, job.scene))
}

/// One of many.
fn brief(report: &Report, explain: bool) -> String {
    let mut table = text::Table::default();
    table.heading(format!(
        "frame {}  {} bricks, {}",
        report.frame.unwrap_or_default(),
        text::count(report.planned_bricks),
        amounts(&report.at_most, &report.estimated),
    ));
    if explain {
        table.rows("left out", &report.left_out, "nothing");
    }
    table.finish()
}

/// All together.
fn all(total: &Total) -> String {
    format!(
        "{}  {} bricks, {}",
        text::number(total.frames, "frame"),
        text::count(total.planned_bricks),
        amounts(&total.at_most, &total.estimated),
    )
}

fn amounts(most: &Limits, estimated: &Estimate) -> String {
    format!(
        "about {} of at most {} in {}, {} of memory at most",
        text::bytes(estimated.bytes),
        text::bytes(most.bytes),
        text::seconds(estimated.seconds),
        text::bytes(most.memory_bytes),
    )
}

fn way(way: &Way) -> String {
    format!(
        "{:<5}  {} in the file, {} of all threads together, {} of it to encode",
        way.compression,
        text::bytes(way.bytes),
        text::seconds(way.cpu_seconds),
        text::seconds(way.encode_cpu_seconds),
    )
}

fn human(report: &Report, explain: bool) -> String {
    let mut table = text::Table::default();
    let (most, estimated) = (&report.at_most, &report.estimated);
    table.heading(&report.scene);
    table.row("bounds", text::bounds(report.bounds));
    table.row("voxel size", text::voxels(report.voxel_size, report.dimensions));
    table.row("bricks", format!("{} of 8^3 voxels", text::count(report.planned_bricks)));
    table.row(
        "at most",
        format!(
            "{} active voxels, {} in the file, {} of memory (it can do with {})",
            text::count(most.active_voxels),
            text::bytes(most.bytes),
            text::bytes(most.memory_bytes),
            memory::enough(report.least_memory_bytes),
        ),
    );
    table.row(
        "estimated",
        format!(
            "{} active voxels, {} in the file, {} of memory, {} on {} (from {})",
            text::count(estimated.active_voxels),
            text::bytes(estimated.bytes),
            text::bytes(estimated.memory_bytes),
            text::seconds(estimated.seconds),
            text::number(report.threads as u64, "thread"),
            text::number(estimated.sampled_bricks, "brick"),
        ),
    );
    if estimated.spooled_bytes > 0 {
        let spooled = text::bytes(estimated.spooled_bytes);
        table.row(
            "on disk meanwhile",
            format!("{spooled} beside the file, for what has no room in the memory"),
        );
    }
    let ways: Vec<String> = estimated.compressions.iter().map(way).collect();
    table.rows("compression", &ways, "none");
    if let Some(advice) = &estimated.advice {
        table.row("", advice);
    }
    if explain {
        table.rows("left out", &report.left_out, "nothing");
        SamplingError::show(&report.sampling_errors, &mut table);
    }
    table.finish()
}
