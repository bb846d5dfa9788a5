//! `vdbake report`: what each accuracy of a scene costs.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use clap::Args;

use super::compare::figure;
use super::interrupt::Interrupt;
use super::job::{Compiled, SceneOptions, Source};
use super::memory::{PROGRAM, enough, unplanned};
use super::output::{Output, save};
use super::progress::Progress;
use super::{Failure, Global, text};
use crate::check::{families, section};
use crate::field::Lattice;
use crate::report::TrialError;
use crate::report::page::{PageError, drawings, galleries, page};
use crate::report::sweep::{Effort, Kind, Report, Row, sweep};
use crate::scene::Scene;
use crate::volume::PlanError;

/// Steps of progress.
const FINENESS: f64 = 1000.0;

#[derive(Debug, Args)]
pub(super) struct Arguments {
    /// The scene to report on
    scene: PathBuf,
    /// Where to write, by the ending: .html is a page with plots and pictures, with all of the others beside it; .json holds
    /// all figures, .csv a line for each setting
    #[arg(short, long, value_name = "OUT")]
    output: PathBuf,
    /// Seconds after which nothing more is begun; what there was no time for is listed
    #[arg(long, value_name = "SECONDS", value_parser = seconds, default_value_t = 60.0, allow_negative_numbers = true)]
    time_limit: f64,
    /// Times that each is repeated, after a first that does not count
    #[arg(long, value_name = "N", value_parser = text::whole::<u8>(1, 100), default_value = "5",
        allow_negative_numbers = true)]
    repeats: u8,
    /// Points at which bakes are held against the scene's definition
    #[arg(long, value_name = "N", value_parser = text::whole::<u32>(1000, 10_000_000),
        default_value = "40000", allow_negative_numbers = true)]
    points: u32,
    /// Pixels of pictures
    #[arg(long, value_name = "WxH", value_parser = size, default_value = "320x320")]
    size: [usize; 2],
    #[command(flatten)]
    options: SceneOptions,
}

fn seconds(text: &str) -> Result<f64, String> {
    let seconds = text.parse().ok().filter(|seconds| (1.0..=1e6).contains(seconds));
    seconds.ok_or_else(|| "expected seconds from 1 to 1e6".to_owned())
}

fn size(text: &str) -> Result<[usize; 2], String> {
    let edge = |text: &str| text.parse().ok().filter(|edge| (8..=4096).contains(edge));
    let (width, height) = text.split_once('x').unwrap_or((text, ""));
    match (edge(width), edge(height)) {
        (Some(width), Some(height)) => Ok([width, height]),
        _ => Err("expected a width and a height from 8 to 4096, such as 320x320".to_owned()),
    }
}

/// What is written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Form {
    Html,
    Json,
    Csv,
}

impl Form {
    fn of(path: &Path) -> Result<Form, Failure> {
        let named =
            |name: &str| path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case(name));
        let known = [("html", Form::Html), ("json", Form::Json), ("csv", Form::Csv)];
        let form = known.into_iter().find(|(name, _)| named(name)).map(|(_, form)| form);
        form.ok_or_else(|| {
            Failure::usage(format!("the output {} ends in none of .html, .json and .csv", path.display()))
        })
    }
}

/// Reports.
pub(super) fn run(arguments: &Arguments, global: &Global) -> Result<(), Failure> {
    let begun = Instant::now();
    let form = Form::of(&arguments.output)?;
    let interrupt = Interrupt::listen()?;
    check(form, &arguments.output)?;
    let pool = global.pool()?;
    has_room(arguments)?;
    let files = pool.install(|| {
        let Compiled { scene, lattice, .. } =
            Source::read(&arguments.scene, &arguments.options)?.compile(arguments.options.time())?;
        global.warn_of(scene.warnings());
        let report = measure(arguments, &scene, lattice, global, &interrupt)?;
        interrupt.check()?;
        let files = files(form, &report, arguments, &scene, lattice, &interrupt, begun)?;
        Ok::<_, Failure>((report, files))
    });
    let (report, files) = files?;
    for (path, bytes) in &files {
        save(path, bytes, &interrupt)?;
    }
    global.show(&report, |report| human(report, &arguments.output))
}

/// Bytes that a report takes at least, whatever its pictures: 77 to 83 MiB were measured.
const LEAST: u64 = 88 << 20;
/// Bytes that it takes besides pictures, and for each of their pixels: 190 MiB of 960 x 540 pixels were measured, and 712 MiB of
/// 1920 x 1080.
const BESIDES: u64 = 52 << 20;
const PIXEL: u64 = 340;
/// And the same of points: 148 MiB of 2 million.
const BESIDES_POINTS: u64 = 40 << 20;
const POINT: u64 = 64;

/// Refuses to begin where the process may have less than pictures, plots and the page take.
fn has_room(arguments: &Arguments) -> Result<(), Failure> {
    let [width, height] = arguments.size.map(|edge| edge as u64);
    let pictures = BESIDES + PIXEL * width * height;
    let points = BESIDES_POINTS + POINT * u64::from(arguments.points);
    let least = LEAST.max(pictures).max(points);
    match arguments.options.limit() {
        Some(limit) if limit < least => {
            let failure = Failure::failed("a report takes more memory than this process may have");
            Err(failure.hint(format!("allow more with --memory {}", enough(least))))
        }
        _ => Ok(()),
    }
}

/// Refuses places where nothing can be written, before anything is measured.
fn check(form: Form, output: &Path) -> Result<(), Failure> {
    Output::check(output)?;
    if form == Form::Html {
        Output::check(&output.with_extension("json"))?;
        Output::check(&output.with_extension("csv"))?;
    }
    Ok(())
}

/// What is written, and where: the page last, so that who finds it finds all of it.
fn files(
    form: Form,
    report: &Report,
    arguments: &Arguments,
    scene: &Scene,
    lattice: Lattice,
    interrupt: &Interrupt,
    begun: Instant,
) -> Result<Vec<(PathBuf, Vec<u8>)>, Failure> {
    let output = &arguments.output;
    let json = || {
        serde_json::to_vec_pretty(report)
            .map_err(|error| Failure::failed("cannot write the report").because(error))
    };
    let csv = || report.to_csv().map_err(|error| Failure::failed("cannot write the report").because(error));
    match form {
        Form::Csv => Ok(vec![(output.clone(), csv()?)]),
        Form::Json => Ok(vec![(output.clone(), json()?)]),
        Form::Html => {
            let drawn = |error: PageError| {
                Failure::failed(format!("cannot draw {}", output.display())).because(error)
            };
            let mut goes_on = || interrupt.check().is_ok();
            let budget = arguments.budget();
            let shots = galleries(scene, lattice, arguments.size, budget, &mut goes_on).map_err(cannot)?;
            interrupt.check()?;
            let mut files =
                vec![(output.with_extension("json"), json()?), (output.with_extension("csv"), csv()?)];
            for plot in drawings(report).map_err(drawn)? {
                files.push((beside(output, plot.name, "svg"), plot.svg.into_bytes()));
                files.push((beside(output, plot.name, "png"), plot.png));
            }
            // What there is no time for is left out, as it is of the sweep.
            let mut in_time =
                || interrupt.check().is_ok() && begun.elapsed().as_secs_f64() < arguments.time_limit;
            let stability = families(&|_| true, &mut in_time);
            interrupt.check()?;
            let more = if stability.is_empty() { vec![] } else { vec![section(&stability).map_err(drawn)?] };
            let page = page(report, &arguments.scene.display().to_string(), &shots, more).map_err(drawn)?;
            files.push((output.clone(), page.into_bytes()));
            Ok(files)
        }
    }
}

/// `name-plot.ending` for `name.html`.
fn beside(page: &Path, plot: &str, ending: &str) -> PathBuf {
    let stem = page.file_stem().unwrap_or_default().to_string_lossy();
    page.with_file_name(format!("{stem}-{plot}.{ending}"))
}

fn cannot(error: TrialError) -> Failure {
    /// Bytes for each brick, with room to spare: it is planned, baked, written, read and drawn.
    const BRICK: f64 = 32768.0;
    match error {
        TrialError::Plan(error @ PlanError::TooMany { bricks, .. }) => {
            #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "saturates")]
            let bytes = PROGRAM.saturating_add((BRICK * bricks) as u64).max(LEAST);
            Failure::failed(error.to_string())
                .hint(format!("take a larger --voxel-size, or allow more with --memory {}", enough(bytes)))
        }
        TrialError::Plan(error) => unplanned(error),
        error => Failure::failed("cannot measure the scene").because(error),
    }
}

impl Arguments {
    /// Bytes for each plan, and for the voxels of each picture.
    fn budget(&self) -> u64 {
        self.options.budget().bytes().saturating_sub(PROGRAM)
    }
}

fn measure(
    arguments: &Arguments,
    scene: &Scene,
    lattice: Lattice,
    global: &Global,
    interrupt: &Interrupt,
) -> Result<Report, Failure> {
    let effort = Effort {
        time: Duration::from_secs_f64(arguments.time_limit),
        repeats: arguments.repeats.into(),
        points: arguments.points as usize,
        rays: 500,
        size: arguments.size,
        budget: arguments.budget(),
    };
    let mut progress = Progress::new(1, global.quiet);
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a constant")]
    progress.begin(FINENESS as usize);
    let mut shown = 0;
    interrupt.hold();
    let mut done = |part: f64, _: &str| {
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "from 0 to 1")]
        let steps = (part * FINENESS) as usize;
        progress.advance(steps.saturating_sub(shown));
        shown = shown.max(steps);
        interrupt.check().is_ok()
    };
    sweep(scene, lattice, effort, &mut done).map_err(cannot)
}

fn human(report: &Report, output: &Path) -> String {
    let mut table = text::Table::default();
    table.heading(format!(
        "{}  {} of {} in {}",
        output.display(),
        text::number(report.rows.len() as u64, "row"),
        text::tidy(&report.scene),
        text::seconds(report.seconds)
    ));
    let processor = report.machine.processor.as_deref().unwrap_or("an unknown processor");
    table.row(
        "on",
        format!(
            "{}, {}, {}",
            text::tidy(processor),
            text::number(report.machine.threads as u64, "thread"),
            report.machine.simd
        ),
    );
    let orders: Vec<String> = (report.orders.iter())
        .map(|order| {
            let [name, power] = [order.metric, order.filter];
            let Some(measured) = order.measured else {
                return format!("{power} {name}: unknown, {}", order.why);
            };
            let off = measured.uncertainty.map_or_else(String::new, |off| format!(" +- {off:.2}"));
            format!("{power} {name}: {:.2}{off}, {} if all were smooth", measured.order, order.theory)
        })
        .collect();
    table.rows("orders", &orders, "unknown");
    for (name, kind) in [("bakes", Kind::Bake), ("pictures", Kind::Picture)] {
        let mut front: Vec<&Row> =
            report.rows.iter().filter(|row| row.on_front && row.kind == kind).collect();
        front.sort_by(|a, b| error(a).total_cmp(&error(b)));
        let lines: Vec<String> = front.into_iter().map(line).collect();
        table.rows(name, &lines, "none");
    }
    if let Some(pays) = &report.pays_after {
        let frames = pays.frames.map_or_else(
            || "a frame through voxels is no faster than through the scene itself".to_owned(),
            |frames| format!("after {}", frame_count(frames)),
        );
        table.row("a bake pays", frames);
    }
    if !report.left_out.is_empty() {
        table.rows("left out", &report.left_out, "");
    }
    table.finish()
}

/// Whole frames.
fn frame_count(frames: f64) -> String {
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "above 0, and saturating")]
    let frames = frames.ceil().max(1.0) as u64;
    text::number(frames, "frame")
}

fn error(row: &Row) -> f64 {
    row.level().map_or(f64::INFINITY, |level| level.error)
}

/// A row of a front.
fn line(row: &Row) -> String {
    let time = row.cost.total.map_or_else(String::new, |total| text::seconds(total.median));
    let bytes = row.cost.bytes.map_or_else(String::new, |bytes| format!(", {}", text::bytes(bytes)));
    format!("{}  {time}{bytes}  {}", figure(error(row)), row.label)
}
