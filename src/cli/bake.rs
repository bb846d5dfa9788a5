//! `vdbake bake`: a scene into an OpenVDB file.

use std::collections::BTreeSet;
use std::io;
use std::path::{Path, PathBuf};
use std::time::Instant;

use clap::Args;
use cpu_time::ProcessTime;
use serde::Serialize;

use super::accuracy::{self, AccuracyOptions, Chosen, Miss};
use super::certify;
use super::estimate::Planned;
use super::frames::{self, Pattern};
use super::interrupt::{Interrupt, Stopped, Watched};
use super::job::{self, Job, Moment, Options, SamplingError, Source, sampling_errors};
use super::mass::Mass;
use super::output::{Output, save};
use super::progress::{Planning, Progress};
use super::{Failure, Global, disk, machine, print, text};
use crate::check::{faded_layer, hazards};
use crate::formats::vdb::{self, FileHeader, Meta, VdbGridBuilder, VdbWriteError};
use crate::num::Level;
use crate::report::Certificate;
use crate::scene::Scene;
use crate::volume::{self, LARGEST_F16, Phases, Plan, RestMass, Tally};

#[derive(Debug, Args)]
pub(super) struct Arguments {
    /// The scene to bake
    scene: PathBuf,
    /// Where to write, a name that ends in .vdb; for frames with a run of # for the number, such as out.####.vdb [default: the
    /// scene's name, in the current folder]
    #[arg(short, long, value_name = "OUT")]
    output: Option<PathBuf>,
    #[command(flatten)]
    options: Options,
    #[command(flatten)]
    accuracy: AccuracyOptions,
}

/// What a bake did, as `--json` prints it.
#[derive(Debug, Serialize)]
struct Report {
    output: String,
    scene: String,
    /// Null but in a sequence.
    frame: Option<i64>,
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
    /// That store a mean over their cell, since an edge passes through it.
    antialiased_voxels: u64,
    /// Of the active, whose density was beyond the range of the precision, and was clamped.
    clamped_voxels: u64,
    /// Of the active, whose density became 0 in the precision.
    vanished_voxels: u64,
    leaves: u64,
    tiles: u64,
    bytes: u64,
    /// Of encoded leaves that had no room in the memory, and were kept beside the file meanwhile.
    spooled_bytes: u64,
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
    /// Part of it that is faded out beside the focal set.
    faded_mass: Option<f64>,
    mass: Mass,
    /// What makes the ratio other than 1: for people.
    #[serde(skip)]
    mass_notes: Vec<String>,
    left_out: Vec<String>,
    /// What in the scene is hardly meant, each with its line and column.
    warnings: Vec<String>,
    /// How far radii that are read from files may be off between their samples.
    sampling_errors: Vec<SamplingError>,
    content_hash: String,
    uuid: String,
    /// Bakes until the file was what was asked for.
    rounds: u32,
    /// Where the certificate is beside the file.
    certificate_file: Option<String>,
    /// What was measured; null where nothing was.
    certificate: Option<Certificate>,
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
    /// Measuring the file, where that is asked for.
    measure: f64,
    total: f64,
}

/// Bakes.
pub(super) fn run(arguments: &Arguments, global: &Global) -> Result<(), Failure> {
    let mut clock = Clock::start();
    let options = &arguments.options;
    let names = Names::new(arguments.output.as_deref(), options.is_sequence())?;
    let interrupt = Interrupt::listen()?;
    let pool = global.pool()?;
    let mut planning = Some(Planning::new(global.quiet));
    let mut source = Source::read(&arguments.scene, &options.scene)?;
    let moments = options.moments(&source)?;
    if options.is_sequence() {
        // No frame is begun before the scene is known to be valid in all.
        moments.iter().try_for_each(|moment| source.start.at(moment.time).map(drop))?;
    }
    let chosen =
        pool.install(|| arguments.accuracy.choose(&mut source, moments[0], options, || interrupt.check()))?;
    if chosen.measures() {
        for moment in &moments {
            Output::check(&certify::beside(&names.path(&source.start, moment.frame)))?;
        }
    }
    let mut progress = Progress::new(moments.len(), global.quiet);
    let (mut bytes, started) = (0, Instant::now());
    let mut told = BTreeSet::new();
    for (index, moment) in moments.iter().enumerate() {
        let mut one = |source: &Source, progress: &mut Progress, round: u32| {
            interrupt.check()?;
            let job = Job::new(source, *moment, options)?;
            if let Some(text) = accuracy::told(job.lattice, &chosen).filter(|_| round == 1) {
                progress.aside(|| global.note(&text));
            }
            let measuring = || certify::enough_unplanned(&job).filter(|_| chosen.measures()).unwrap_or(0);
            let plan = pool.install(|| job.plan_for(measuring))?;
            // What it took to make does not serve a bake, and would count for it.
            vdbake_heap::give_back();
            planning = None;
            if told.insert(text::warnings(job.scene.warnings())) {
                progress.aside(|| global.warn_of(job.scene.warnings()));
            }
            // What moves may be hazardous at other times, too; `check` looks at all of them.
            if index == 0 && round == 1 {
                progress.aside(|| global.warn_of_hazards(&hazards(&job.scene, job.lattice)));
            }
            let baked = bake(
                &job,
                plan,
                &names.path(&source.start, moment.frame),
                &Surroundings { global, interrupt: &interrupt, pool: &pool, clock: &clock },
                (&chosen, round),
                progress,
            )?;
            Ok(baked.map(|report| (report, job.dimensions())))
        };
        let left = |moments: &[Moment], failure: Failure| match moments {
            [] => failure,
            moments => {
                let frames: Vec<i64> = moments.iter().filter_map(|moment| moment.frame).collect();
                failure.leaving(&frames::ranges(&frames))
            }
        };
        let not_this = |failure| left(if index == 0 { &[] } else { &moments[index..] }, failure);
        let (mut round, mut retry) = (1, accuracy::Retry::default());
        let (report, dimensions) = loop {
            match one(&source, &mut progress, round).map_err(not_this)? {
                Ok(done) => break done,
                Err(miss) if round == accuracy::MOST_ROUNDS || chosen.is_final(miss) => {
                    return Err(not_this(accuracy::missed(&chosen, miss)));
                }
                Err(miss) => {
                    let voxel_size = retry.next(&chosen, source.voxel_size(), miss, round);
                    source.set_voxel_size(voxel_size);
                    progress.again();
                    round += 1;
                }
            }
        };
        bytes += report.bytes;
        progress
            .aside(|| {
                if options.is_sequence() {
                    global.show_one(&report, |report| brief(report, options.explain))
                } else {
                    global.show(&report, |report| human(report, dimensions, options.explain))
                }
            })
            .map_err(|failure| left(&moments[index + 1..], failure))?;
        clock = Clock::start();
    }
    drop(progress);
    if options.is_sequence() && !global.json {
        let (frames, seconds) = (moments.len() as u64, started.elapsed().as_secs_f64());
        let total = format!(
            "{}  {} in {}",
            text::number(frames, "frame"),
            text::bytes(bytes),
            text::seconds(seconds)
        );
        print(|out| writeln!(out, "{total}"))?;
    }
    Ok(())
}

/// Where files go.
enum Names {
    /// All to one path, or under the scene's name.
    One(Option<PathBuf>),
    /// Each frame to its own.
    Each(Option<Pattern>),
}

impl Names {
    /// Names of another kind are refused before any work is done.
    fn new(given: Option<&Path>, sequence: bool) -> Result<Names, Failure> {
        check_name(given)?;
        Ok(if sequence {
            Names::Each(given.map(Pattern::new).transpose()?)
        } else {
            Names::One(given.map(Path::to_owned))
        })
    }

    fn path(&self, scene: &Scene, frame: Option<i64>) -> PathBuf {
        match (self, frame) {
            (Names::Each(Some(pattern)), Some(frame)) => pattern.path(frame),
            (Names::Each(None), Some(frame)) => Pattern::of_scene(scene.name()).path(frame),
            (Names::One(path), _) => job::output_path(path.as_deref(), scene),
            (Names::Each(_), None) => job::output_path(None, scene),
        }
    }
}

/// What the files of a sequence are baked with.
struct Surroundings<'a> {
    global: &'a Global,
    interrupt: &'a Interrupt,
    pool: &'a rayon::ThreadPool,
    /// Since this file was begun.
    clock: &'a Clock,
}

/// Bakes one file, unless it misses what is asked for.
fn bake(
    job: &Job,
    plan: Plan,
    path: &Path,
    surroundings: &Surroundings<'_>,
    (chosen, round): (&Chosen, u32),
    progress: &mut Progress,
) -> Result<Result<Box<Report>, Miss>, Failure> {
    let Surroundings { global, interrupt, pool, clock } = surroundings;
    let note = |progress: &Progress, text: &str| {
        let frame = job.settings.frame.map_or_else(String::new, |frame| format!("frame {frame}: "));
        progress.aside(|| global.note(&format!("{frame}{text}")));
    };
    if plan.bricks() == 0 {
        note(
            progress,
            match job.bounds {
                None => "the scene holds no density; its grid is empty",
                Some(_) => "the density lies between the centres of all voxels; the grid is empty",
            },
        );
    }
    if chosen.measures() {
        certify::check(&plan, job.encoder.precision(), [job.budget(), job.process()])?;
    }
    let planned = clock.read();

    let mut output = Output::create(path, interrupt)?;
    let grid = pool.install(|| empty_grid(job, &plan, planned[0], chosen.measures(), &output))?;
    progress.begin(plan.bricks());
    let (grid, tally, mut phases) = pool
        .install(|| evaluate(job, &plan, grid, interrupt, progress))
        .map_err(|stopped| match stopped {
            Stopped::Interrupted => Failure::interrupted(),
            Stopped::Sink(error) => disk::failure(path, error),
        })?;
    let baked = clock.read();
    let rest = pool.install(|| RestMass::beside(&job.field, &job.scene, job.lattice, &tally, Level::best()));
    phases.evaluate += clock.read()[1] - baked[1];
    let mass = Mass::new(&tally, &rest, job.lattice);
    let evaluated = clock.read();
    if plan.bricks() > 0 && tally.active_voxels == 0 {
        let why = faded_layer(&job.scene, job.lattice).unwrap_or_else(|| {
            "the density is at or below the cutoff, or between the centres of all voxels".to_owned()
        });
        note(progress, &format!("no voxel is active: {why}; the grid is empty"));
    }

    if tally.clamped_voxels > 0 {
        let text = format!(
            "{} of a density beyond {LARGEST_F16}, the largest 16-bit float, got that value; --precision f32 keeps them",
            text::number(tally.clamped_voxels, "voxel"),
        );
        note(progress, &text);
    }
    if tally.vanished_voxels > 0 {
        let text = format!(
            "{} of a density nearer to 0 than to the least 16-bit float got the value 0 and stay active; --precision f32 keeps them",
            text::number(tally.vanished_voxels, "voxel"),
        );
        note(progress, &text);
    }

    let content = text::hexadecimal(&tally.content_hash);
    let mut header = job.file_header(&content)?;
    let broken = |error| interrupt.check().and(Err(disk::failure(path, error)));
    let mut bytes = write(&mut output, job, &header, &grid, interrupt).or_else(broken)?;
    interrupt.check()?;
    let (stats, spooled_bytes) = (grid.stats(), grid.spooled_bytes());
    let left_out = job.field.left_out(job.lattice, plan.has_edges());
    let planned_bricks = plan.bricks() as u64;
    // What is in the file is read from there, and there is no room for it twice.
    drop((grid, plan));

    let (mut certificate, mut measuring) = (None, [0.0; 2]);
    if chosen.measures() {
        let begun = clock.read();
        let made = certify::Made { job, output: &output, path, header: &header, content: &content };
        let found = pool.install(|| certify::certified(&made, chosen, round))?;
        let ended = clock.read();
        measuring = [0, 1].map(|which| ended[which] - begun[which]);
        let found = match found {
            Ok(found) => found,
            Err(miss) => {
                if let (Miss::Error(value), Some(goal)) = (miss, chosen.goal) {
                    progress.aside(|| certify::note_of(global, round, goal.metric.name(), value, goal.limit));
                }
                return Ok(Err(miss));
            }
        };
        let before = header.clone();
        header.metadata.insert(certify::CERTIFICATE.to_owned(), Meta::from(&*certify::entry(&found)?));
        bytes = change_header(&output, [&before, &header], interrupt).or_else(broken)?;
        interrupt.check()?;
        certificate = Some(found);
    }
    if let Some(miss) = chosen.misses(bytes, round) {
        return Ok(Err(miss));
    }
    // Of what was there before: the new file is never beside it.
    certify::forget(path)?;
    output.publish().map_err(|error| disk::unwritten(path, error))?;
    let mut certificate_file = None;
    if let Some(certificate) = &certificate {
        let beside = certify::beside(path);
        save(&beside, &certify::document(certificate, job.scene.text())?, interrupt)?;
        certificate_file = Some(beside.display().to_string());
    }
    let written = clock.read();

    let [seconds, cpu_seconds] = times([planned, evaluated, written], measuring, phases);
    Ok(Ok(Box::new(Report {
        output: path.display().to_string(),
        scene: job.scene.name().to_owned(),
        frame: job.settings.frame,
        time: job.settings.time,
        voxel_size: job.lattice.voxel_size,
        bounds: job.bounds,
        precision: job.settings.precision,
        compression: job.settings.compression,
        planned_bricks,
        searched_voxels: tally.searched_voxels,
        bisected_voxels: tally.bisected_voxels,
        inside_voxels: tally.inside_voxels,
        several_feet_voxels: tally.several_feet_voxels,
        beyond_focal_voxels: tally.beyond_focal_voxels,
        active_voxels: tally.active_voxels,
        antialiased_voxels: tally.antialiased_voxels,
        clamped_voxels: tally.clamped_voxels,
        vanished_voxels: tally.vanished_voxels,
        leaves: stats.leaves,
        tiles: stats.tiles.iter().sum(),
        bytes,
        spooled_bytes,
        seconds,
        cpu_seconds,
        peak_rss_bytes: machine::peak_memory(),
        threads: pool.current_num_threads(),
        simd: Level::best().name(),
        mass_ratio: mass.ratio(),
        mass_ratio_error: mass.ratio_error(),
        lost_mass: mass.lost(),
        faded_mass: mass.faded(),
        mass_notes: mass.notes(&job.scene),
        mass,
        left_out,
        warnings: text::warnings(job.scene.warnings()),
        sampling_errors: sampling_errors(&job.scene),
        content_hash: content,
        uuid: header.uuid.to_string(),
        rounds: round,
        certificate_file,
        certificate,
    })))
}

/// A grid for the plan's bricks within the memory, if there is room for it on the disk. Planning took so many seconds.
/// It may be `measured` later.
fn empty_grid(
    job: &Job,
    plan: &Plan,
    planning: f64,
    measured: bool,
    output: &Output,
) -> Result<VdbGridBuilder, Failure> {
    let bound = job.bound(plan);
    let need = job.need(plan, &bound);
    let empty = job.empty_file()?;
    disk::check(job, &Planned { plan, bound: &bound, need: &need, empty, seconds: planning }, output)?;
    // Of one that is searched for.
    let budget = if measured { job.budget().saturating_sub(job.kept()) } else { job.budget() };
    let grid = VdbGridBuilder::with_encoder(job.encoder).with_room(plan.bricks());
    if need.spool(budget) == 0 {
        return Ok(grid);
    }
    let failed = |error| {
        let folder = output.folder().display();
        Failure::failed(format!("cannot make a temporary file in {folder}")).because(io::Error::from(error))
    };
    let spool = output.spool().map_err(|error| failed(error.kind()))?;
    Ok(grid.with_spool(need.room(budget), spool))
}

/// Evaluates and encodes all bricks.
fn evaluate(
    job: &Job,
    plan: &Plan,
    grid: VdbGridBuilder,
    interrupt: &Interrupt,
    progress: &mut Progress,
) -> Result<(VdbGridBuilder, Tally, Phases), Stopped<VdbWriteError>> {
    let mut sink = Watched { inner: grid, interrupt };
    let cutoff = job.scene.bake().cutoff;
    let advance = |bricks| progress.advance(bricks);
    let (tally, phases) = volume::bake(&job.field, plan, cutoff, Level::best(), &mut sink, advance)?;
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
    output.allocate(grid.encoded_bytes());
    let file = Watched { inner: output.file(), interrupt };
    let bytes = vdb::write(file, header, &[(&job.grid_header(), grid)])?;
    output.sync().map_err(io::Error::into).map(|()| bytes)
}

/// Puts another header before the grid, and makes sure of the file; returns its length in bytes.
fn change_header(
    output: &Output,
    [before, header]: [&FileHeader; 2],
    interrupt: &Interrupt,
) -> Result<u64, VdbWriteError> {
    let bytes = vdb::rehead(Watched { inner: output.file(), interrupt }, before, header, 1)?;
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
fn times([planned, evaluated, written]: [Reading; 3], measuring: Reading, phases: Phases) -> [Times; 2] {
    let encode = phases.encode + phases.append;
    let both = phases.evaluate + encode;
    let share = if both > 0.0 { phases.evaluate / both } else { 1.0 };
    let baking = evaluated[0] - planned[0];
    let times = |which: usize, evaluate, encode| Times {
        plan: planned[which],
        evaluate,
        encode,
        write: written[which] - evaluated[which] - measuring[which],
        measure: measuring[which],
        total: written[which],
    };
    [times(0, share * baking, (1.0 - share) * baking), times(1, phases.evaluate, encode)]
}

/// One of many.
fn brief(report: &Report, explain: bool) -> String {
    let mut table = text::Table::default();
    table.heading(format!(
        "{}  {}  {} active voxels in {}",
        report.output,
        text::bytes(report.bytes),
        text::count(report.active_voxels),
        text::seconds(report.seconds.total),
    ));
    if let Some(certificate) = &report.certificate {
        certify::show(certificate, &mut table);
    }
    if explain {
        table.rows("left out", &report.left_out, "nothing");
    }
    table.finish()
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
    if let Some(certificate) = &report.certificate {
        certify::show(certificate, &mut table);
    }
    if let Some(peak) = report.peak_rss_bytes {
        let spooled = match report.spooled_bytes {
            0 => String::new(),
            bytes => format!(", and {} on disk meanwhile", text::bytes(bytes)),
        };
        table.row("peak memory", format!("{}{spooled}", text::bytes(peak)));
    }
    if explain {
        table.rows("mass", &report.mass_notes, "none at rest");
        table.rows("left out", &report.left_out, "nothing");
        SamplingError::show(&report.sampling_errors, &mut table);
    }
    table.finish()
}
