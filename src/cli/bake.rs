//! `vdbake bake`: a scene into an OpenVDB file.

use std::io;
use std::path::{Path, PathBuf};
use std::time::Instant;

use clap::Args;
use cpu_time::ProcessTime;
use serde::Serialize;

use super::interrupt::{Interrupt, Stopped, Watched};
use super::job::{self, Job, Options, SamplingError, sampling_errors};
use super::mass::Mass;
use super::output::Output;
use super::progress::{Planning, Progress};
use super::{Failure, Global, machine, text};
use crate::formats::vdb::{self, FileHeader, VdbGridBuilder, VdbWriteError};
use crate::num::Level;
use crate::volume::{self, LARGEST_F16, Phases, Plan, RestMass, Tally};

#[derive(Debug, Args)]
pub(super) struct Arguments {
    /// The scene to bake
    scene: PathBuf,
    /// Where to write, a name that ends in .vdb [default: the scene's name, in the current folder]
    #[arg(short, long, value_name = "OUT")]
    output: Option<PathBuf>,
    #[command(flatten)]
    options: Options,
}

/// What a bake did, as `--json` prints it.
#[derive(Debug, Serialize)]
struct Report {
    output: String,
    scene: String,
    time: f64,
    voxel_size: f64,
    /// Corners of the box around the density, in metres.
    bounds: Option<[[f64; 3]; 2]>,
    precision: &'static str,
    compression: &'static str,
    planned_bricks: u64,
    searched_voxels: u64,
    bisected_voxels: u64,
    inside_voxels: u64,
    several_feet_voxels: u64,
    beyond_focal_voxels: u64,
    active_voxels: u64,
    /// Of these, whose density was beyond the range of the precision, and was clamped.
    clamped_voxels: u64,
    leaves: u64,
    tiles: u64,
    bytes: u64,
    seconds: Times,
    cpu_seconds: Times,
    peak_rss_bytes: Option<u64>,
    threads: usize,
    simd: String,
    /// Mass of the bake over that at rest; null where there is none at rest.
    mass_ratio: Option<f64>,
    /// Relative error of it.
    mass_ratio_error: Option<f64>,
    /// Part of the mass at rest that has no image.
    lost_mass: Option<f64>,
    mass: Mass,
    /// What makes the ratio other than 1: for people.
    #[serde(skip)]
    mass_notes: Vec<String>,
    left_out: Vec<String>,
    /// What in the scene is hardly meant, each with its line and column.
    warnings: Vec<String>,
    /// How far radii that are read from files may be off between their samples.
    sampling_errors: Vec<SamplingError>,
    content_sha256: String,
    uuid: String,
}

/// Seconds of each phase: by the clock, or of all processors together.
///
/// Evaluation and encoding run at the same time; their time by the clock is shared out as their processor time is.
#[derive(Debug, Clone, Copy, Default, Serialize)]
struct Times {
    plan: f64,
    evaluate: f64,
    encode: f64,
    write: f64,
    total: f64,
}

/// Bakes.
pub(super) fn run(arguments: &Arguments, global: &Global) -> Result<(), Failure> {
    let clock = Clock::start();
    check_name(arguments.output.as_deref())?;
    let interrupt = Interrupt::listen()?;
    let pool = global.pool()?;
    let planning = Planning::new(global.quiet);
    let job = Job::new(&arguments.scene, &arguments.options)?;
    let path = job::output_path(arguments.output.as_deref(), &job.scene);
    let plan = pool.install(|| job.plan())?;
    drop(planning);
    global.warn_of(job.scene.warnings());
    if plan.bricks() == 0 {
        global.note(match job.bounds {
            None => "the scene holds no density; its grid is empty",
            Some(_) => "the density lies between the centres of all voxels; the grid is empty",
        });
    }
    let planned = clock.read();

    interrupt.hold();
    let mut output = Output::create(&path)?;
    let mut progress = Progress::new(plan.bricks(), global.quiet);
    let (grid, tally, mut phases) = pool.install(|| evaluate(&job, &plan, &interrupt, &mut progress))?;
    drop(progress);
    let baked = clock.read();
    let rest = pool.install(|| RestMass::beside(&job.field, &job.scene, job.lattice, &tally, Level::best()));
    phases.evaluate += clock.read()[1] - baked[1];
    let mass = Mass::new(&tally, &rest, job.lattice);
    let evaluated = clock.read();
    if plan.bricks() > 0 && tally.active_voxels == 0 {
        global.note(
            "no voxel is active: the density is at or below the cutoff, or between the centres of all voxels; the grid is empty",
        );
    }

    if tally.clamped_voxels > 0 {
        global.note(&format!(
            "{} of a density beyond {LARGEST_F16}, the largest 16-bit float, got that value; --precision f32 keeps them",
            text::number(tally.clamped_voxels, "voxel"),
        ));
    }

    let content = text::hexadecimal(&tally.content_hash);
    let header = job.file_header(&content)?;
    let bytes = write(&mut output, &job, &header, &grid, &interrupt)
        .map_err(|error| Failure::failed(format!("cannot write {}", path.display())).because(error))
        .or_else(|failure| interrupt.check().and(Err(failure)))?;
    interrupt.check()?;
    output
        .publish()
        .map_err(|error| Failure::failed(format!("cannot write {}", path.display())).because(error))?;
    let written = clock.read();

    let stats = grid.stats();
    let [seconds, cpu_seconds] = times([planned, evaluated, written], phases);
    let report = Report {
        output: path.display().to_string(),
        scene: job.scene.name().to_owned(),
        time: job.settings.time,
        voxel_size: job.lattice.voxel_size,
        bounds: job.bounds,
        precision: job.settings.precision,
        compression: job.settings.compression,
        planned_bricks: plan.bricks() as u64,
        searched_voxels: tally.searched_voxels,
        bisected_voxels: tally.bisected_voxels,
        inside_voxels: tally.inside_voxels,
        several_feet_voxels: tally.several_feet_voxels,
        beyond_focal_voxels: tally.beyond_focal_voxels,
        active_voxels: tally.active_voxels,
        clamped_voxels: tally.clamped_voxels,
        leaves: stats.leaves,
        tiles: stats.tiles.iter().sum(),
        bytes,
        seconds,
        cpu_seconds,
        peak_rss_bytes: machine::peak_memory(),
        threads: pool.current_num_threads(),
        simd: Level::best().name(),
        mass_ratio: mass.ratio(),
        mass_ratio_error: mass.ratio_error(),
        lost_mass: mass.lost(),
        mass_notes: mass.notes(&job.scene),
        mass,
        left_out: job.field.left_out(job.lattice),
        warnings: text::warnings(job.scene.warnings()),
        sampling_errors: sampling_errors(&job.scene),
        content_sha256: content,
        uuid: header.uuid.to_string(),
    };
    global.show(&report, |report| human(report, job.dimensions(), arguments.options.explain))
}

/// Evaluates and encodes all bricks.
fn evaluate(
    job: &Job,
    plan: &Plan,
    interrupt: &Interrupt,
    progress: &mut Progress,
) -> Result<(VdbGridBuilder, Tally, Phases), Failure> {
    let mut sink = Watched { inner: VdbGridBuilder::with_encoder(job.encoder), interrupt };
    let cutoff = job.scene.bake().cutoff;
    let advance = |bricks| progress.advance(bricks);
    let (tally, phases) =
        volume::bake(&job.field, plan, cutoff, Level::best(), &mut sink, advance).map_err(|stopped| {
            match stopped {
                Stopped::Interrupted => Failure::interrupted(),
                Stopped::Sink(error) => Failure::failed("cannot encode the grid").because(error),
            }
        })?;
    Ok((sink.inner, tally, phases))
}

/// Writes the file and makes sure of it; returns its length in bytes.
fn write(
    output: &mut Output,
    job: &Job,
    header: &FileHeader,
    grid: &VdbGridBuilder,
    interrupt: &Interrupt,
) -> Result<u64, VdbWriteError> {
    let file = Watched { inner: output.file(), interrupt };
    let bytes = vdb::write(file, header, &[(&job.grid_header(), grid)])?;
    output.sync().map_err(io::Error::into).map(|()| bytes)
}

/// A name of another kind is refused before any work is done.
fn check_name(path: Option<&Path>) -> Result<(), Failure> {
    let Some(path) = path else { return Ok(()) };
    if path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("vdb")) {
        return Ok(());
    }
    Err(Failure::usage(format!("the output {} does not end in .vdb", path.display())))
}

/// Time by the clock and of all processors, since a start.
struct Clock {
    started: Instant,
    cpu: ProcessTime,
}

/// Seconds by the clock, and of all processors.
type Reading = [f64; 2];

impl Clock {
    fn start() -> Clock {
        Clock { started: Instant::now(), cpu: ProcessTime::now() }
    }

    fn read(&self) -> Reading {
        [self.started.elapsed().as_secs_f64(), self.cpu.elapsed().as_secs_f64()]
    }
}

/// Times by the clock and of all processors, from readings at the end of planning, of evaluation and of all.
fn times([planned, evaluated, written]: [Reading; 3], phases: Phases) -> [Times; 2] {
    let encode = phases.encode + phases.append;
    let both = phases.evaluate + encode;
    let share = if both > 0.0 { phases.evaluate / both } else { 1.0 };
    let baking = evaluated[0] - planned[0];
    let times = |which: usize, evaluate, encode| Times {
        plan: planned[which],
        evaluate,
        encode,
        write: written[which] - evaluated[which],
        total: written[which],
    };
    [times(0, share * baking, (1.0 - share) * baking), times(1, phases.evaluate, encode)]
}

fn human(report: &Report, dimensions: [u64; 3], explain: bool) -> String {
    let mut table = text::Table::default();
    let times = report.seconds;
    table.heading(format!("{}  {}", report.output, text::bytes(report.bytes)));
    table.row("voxel size", text::voxels(report.voxel_size, dimensions));
    table.row(
        "active voxels",
        format!(
            "{} in {} and {}, of {} searched",
            text::count(report.active_voxels),
            if report.leaves == 1 {
                "1 leaf".to_owned()
            } else {
                format!("{} leaves", text::count(report.leaves))
            },
            text::number(report.tiles, "tile"),
            text::number(report.planned_bricks, "brick"),
        ),
    );
    table.row(
        "time",
        format!(
            "{} on {}: plan {}, evaluate {}, encode {}, write {}",
            text::seconds(times.total),
            text::number(report.threads as u64, "thread"),
            text::seconds(times.plan),
            text::seconds(times.evaluate),
            text::seconds(times.encode),
            text::seconds(times.write),
        ),
    );
    table.row("mass", report.mass.line());
    if let Some(peak) = report.peak_rss_bytes {
        table.row("peak memory", text::bytes(peak));
    }
    if explain {
        table.rows("mass", &report.mass_notes, "none at rest");
        table.rows("left out", &report.left_out, "nothing");
        SamplingError::show(&report.sampling_errors, &mut table);
    }
    table.finish()
}
