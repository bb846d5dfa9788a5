//! `vdbake plan`: what a bake would take.

use std::collections::BTreeSet;
use std::io;
use std::path::PathBuf;
use std::time::Instant;

use clap::Args;
use serde::Serialize;

use super::job::{Job, Moment, Options, SamplingError, Source, sampling_errors};
use super::progress::Planning;
use super::{Failure, Global, text};
use crate::formats::vdb::{self, Compression, GridBound, VdbGridBuilder};
use crate::num::Level;
use crate::scene::Scene;
use crate::volume::{self, Plan};

/// Bricks that are baked for the estimates: one sample after the other, as long as there is time.
const SAMPLES: [usize; 4] = [4, 16, 64, 256];
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
    /// That the process takes.
    memory_bytes: u64,
}

/// What a sample of the bricks lets expect.
#[derive(Debug, Default, Serialize)]
struct Estimate {
    sampled_bricks: u64,
    active_voxels: u64,
    bytes: u64,
    seconds: f64,
    cpu_seconds: f64,
}

/// What all frames would take together, as `--json` prints it; memory is that of the frame that takes the most.
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
        most.memory_bytes = most.memory_bytes.max(frame.at_most.memory_bytes);
        estimated.sampled_bricks += frame.estimated.sampled_bricks;
        estimated.active_voxels += frame.estimated.active_voxels;
        estimated.bytes += frame.estimated.bytes;
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

/// Plans one file; gives the scene, too. `started` is when this was begun, `patience` what `estimate` has.
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
    let bound = GridBound::new::<f32>(job.encoder, plan.origins());
    let empty = empty_file(&job)?;
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
            bytes: empty + bound.bytes(),
            memory_bytes: job.memory(&plan),
        },
        estimated: estimate(&job, &plan, bound, empty, [planning, patience])?,
        threads: rayon::current_num_threads(),
        simd: Level::best().name(),
        left_out: job.field.left_out(job.lattice),
        warnings: text::warnings(job.scene.warnings()),
        sampling_errors: sampling_errors(&job.scene),
    };
    Ok((report, job.scene))
}

/// Bytes of the file if no voxel were active. All of it that depends on the density has a fixed length.
fn empty_file(job: &Job) -> Result<u64, Failure> {
    let header = job.file_header(&"0".repeat(64))?;
    let grid = VdbGridBuilder::<f32>::with_encoder(job.encoder);
    vdb::write(io::sink(), &header, &[(&job.grid_header(), &grid)])
        .map_err(|error| Failure::failed("cannot measure the file").because(error))
}

/// Bakes some of the bricks and scales up what they took. `empty` is the length of a file without voxels; planning took so
/// many seconds, and after so many of `patience` no larger sample is begun.
fn estimate(
    job: &Job,
    plan: &Plan,
    bound: GridBound,
    empty: u64,
    [planning, patience]: [f64; 2],
) -> Result<Estimate, Failure> {
    let cutoff = job.scene.bake().cutoff;
    let started = Instant::now();
    let mut sizes = SAMPLES.into_iter();
    let (sample, grid, tally, phases) = loop {
        let sample = plan.sample(sizes.next().unwrap_or(usize::MAX));
        let mut grid = VdbGridBuilder::with_encoder(job.encoder);
        let (tally, phases) = volume::bake(&job.field, &sample, cutoff, Level::best(), &mut grid, |_| {})
            .map_err(|error| Failure::failed("cannot encode a sample").because(error))?;
        let long = started.elapsed().as_secs_f64() > patience;
        if long || sizes.len() == 0 || sample.bricks() == plan.bricks() {
            break (sample, grid, tally, phases);
        }
    };
    let scale = |part: u64| {
        let (part, whole) = (u128::from(part), plan.bricks() as u128);
        u64::try_from(part * whole / (sample.bricks() as u128).max(1)).unwrap_or(u64::MAX)
    };
    // The nodes above leaves take their full size only where nothing is compressed.
    let nodes = bound.masks - 64 * plan.bricks() as u64
        + if job.encoder.compression() == Compression::None { bound.entries } else { 0 };
    #[allow(clippy::cast_precision_loss, reason = "an estimate")]
    let (factor, threads) =
        (plan.bricks() as f64 / sample.bricks().max(1) as f64, rayon::current_num_threads() as f64);
    let cpu = factor * (phases.evaluate + phases.encode + phases.append);
    Ok(Estimate {
        sampled_bricks: sample.bricks() as u64,
        active_voxels: scale(tally.active_voxels),
        bytes: empty + nodes + scale(grid.encoded_bytes() + 64 * grid.stats().leaves),
        seconds: planning + cpu / threads,
        cpu_seconds: planning + cpu,
    })
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
            "{} active voxels, {} in the file, {} of memory",
            text::count(most.active_voxels),
            text::bytes(most.bytes),
            text::bytes(most.memory_bytes),
        ),
    );
    table.row(
        "estimated",
        format!(
            "{} active voxels, {} in the file, {} on {} (from {})",
            text::count(estimated.active_voxels),
            text::bytes(estimated.bytes),
            text::seconds(estimated.seconds),
            text::number(report.threads as u64, "thread"),
            text::number(estimated.sampled_bricks, "brick"),
        ),
    );
    if explain {
        table.rows("left out", &report.left_out, "nothing");
        SamplingError::show(&report.sampling_errors, &mut table);
    }
    table.finish()
}
