//! `vdbake check`: numerical stability, of the program and of a scene.

use std::path::{Path, PathBuf};
use std::time::Instant;

use clap::Args;
use serde::Serialize;

use super::interrupt::Interrupt;
use super::job::{Job, Moment, Options, Source};
use super::memory::{PROGRAM, unplanned_beside};
use super::output::{Output, save};
use super::progress::Progress;
use super::{Failure, Global, failure, machine, text};
use crate::check::{
    Case, Expectation, Family, Hazard, Outcome, catalogue, expectation, families, hazards, hazards_expected,
    meetings, page,
};
use crate::field::Extent;
use crate::num::Level;
use crate::report::{Lot, TrialError};
use crate::scene::Weight;
use crate::volume::{Plan, PlanError};

/// Points at which a scene's error is tried.
const POINTS: usize = 10_000;
/// Bytes for these points, and for each brick that is baked at once to try them.
const TRYING: u64 = 3 << 20;
const BRICK: u64 = 8192;
/// Columns that the names of cases take.
const NAMES: usize = 46;

#[derive(Debug, Args)]
pub(super) struct Arguments {
    /// The scene whose hazards are sought; without one, the program itself is put through its catalogue of stiff and extreme cases
    scene: Option<PathBuf>,
    /// Of the catalogue: where to write it, by the ending: .html is a page with plots of errors over how extreme things get, .json holds
    /// all figures
    #[arg(short, long, value_name = "OUT", conflicts_with = "scene")]
    output: Option<PathBuf>,
    /// Of the catalogue: only cases and plots with this word in their group or name
    #[arg(long, value_name = "WORD", conflicts_with = "scene")]
    only: Option<String>,
    #[command(flatten)]
    options: Options,
}

/// The catalogue, as `--json` prints it.
#[derive(Debug, Serialize)]
struct Report {
    /// Whether all is as it must be.
    holds: bool,
    held: usize,
    cases: Vec<Outcome>,
    families: Vec<Family>,
    /// Instruction sets that evaluate densities.
    simd: Vec<String>,
    threads: usize,
    seconds: f64,
}

/// A scene's hazards, as `--json` prints them.
#[derive(Debug, Serialize)]
struct Hazards {
    /// The most serious first; of several frames each where it is worst.
    hazards: Vec<HazardReport>,
    /// The time, or each frame.
    moments: Vec<SceneReport>,
    peak_rss_bytes: Option<u64>,
}

#[derive(Debug, Serialize)]
struct SceneReport {
    scene: String,
    frame: Option<i64>,
    time: f64,
    voxel_size: f64,
    expected: Expectation,
    planned_bricks: u64,
    /// That a bake takes at most.
    memory_bytes: u64,
    left_out: Vec<String>,
}

#[derive(Debug, Serialize)]
struct HazardReport {
    kind: &'static str,
    /// Of a sequence, where it is worst.
    frame: Option<i64>,
    severity: &'static str,
    line: usize,
    column: usize,
    what: String,
    change: Vec<String>,
}

/// Checks.
pub(super) fn run(arguments: &Arguments, global: &Global) -> Result<(), Failure> {
    match &arguments.scene {
        Some(scene) => of_scene(scene, arguments, global),
        None => of_program(arguments, global),
    }
}

fn of_scene(path: &Path, arguments: &Arguments, global: &Global) -> Result<(), Failure> {
    let options = &arguments.options;
    let interrupt = Interrupt::listen()?;
    let pool = global.pool()?;
    let source = Source::read(path, &options.scene)?;
    global.warn_of(source.start.warnings());
    let mut progress = Progress::new(1, global.quiet);
    let moments = options.moments(&source)?;
    progress.begin(moments.len());
    let mut reports: Vec<SceneReport> = Vec::new();
    let mut hazards: Vec<(Hazard, Option<i64>)> = Vec::new();
    for moment in &moments {
        let (report, found) = pool.install(|| at(&source, *moment, options, &interrupt))?;
        reports.push(report);
        // Of all frames, each hazard where it is worst.
        for hazard in found {
            match hazards.iter_mut().find(|(known, _)| known.is_same(&hazard)) {
                Some((known, _)) if !hazard.is_worse(known) => {}
                Some(known) => *known = (hazard, moment.frame),
                None => hazards.push((hazard, moment.frame)),
            }
        }
        progress.advance(1);
    }
    drop(progress);
    hazards.sort_by_key(|(hazard, _)| std::cmp::Reverse(hazard.weight()));
    let report = Hazards {
        hazards: hazards.iter().map(HazardReport::new).collect(),
        moments: reports,
        peak_rss_bytes: machine::peak_memory(),
    };
    global.show(&report, |report| human_scene(report, &hazards, options.explain))?;
    let serious = hazards.iter().filter(|(hazard, _)| hazard.weight() == Weight::Serious).count();
    if serious == 0 {
        return Ok(());
    }
    Err(Failure::check(format!(
        "{} has {}",
        source.start.name(),
        text::number(serious as u64, "serious hazard")
    )))
}

/// What is hazardous and expected at one moment.
fn at(
    source: &Source,
    moment: Moment,
    options: &Options,
    interrupt: &Interrupt,
) -> Result<(SceneReport, Vec<Hazard>), Failure> {
    let job = Job::new(source, moment, options)?;
    let besides = PROGRAM.max(job.process()).saturating_add(TRYING + BRICK * Lot::at_once() as u64);
    // Of the bake, and with what is around its bricks.
    let trying = |plan: u64| besides.saturating_add(plan.saturating_mul(2));
    let around = || Plan::for_extent(&job.field, job.lattice, Extent::Whole, 0).err();
    let plan = job.plan_for(|| trying(around().and_then(PlanError::enough).unwrap_or(0)))?;
    interrupt.check()?;
    let memory_bytes = job.need(&plan, &job.bound(&plan)).most(job.budget());
    let left_out = job.field.left_out(job.lattice, plan.has_edges());
    let (planned_bricks, meetings) = (plan.bricks() as u64, meetings(&job.scene, &plan));
    // There is no room for three of them.
    drop(plan);
    interrupt.check()?;
    let room = job.budget().saturating_sub(besides) / 2;
    let expected = expectation(&job.scene, &job.field, job.lattice, options.stored(), POINTS, room).map_err(
        |error| match error {
            TrialError::Plan(error) => {
                unplanned_beside(error, besides.saturating_add(error.enough().unwrap_or(0)))
            }
            error => Failure::failed("cannot try the scene").because(error),
        },
    )?;
    interrupt.check()?;
    let mut hazards = hazards(&job.scene, job.lattice);
    hazards.extend(hazards_expected(&job.scene, job.lattice, options.stored(), &expected));
    hazards.extend(meetings);
    let report = SceneReport {
        scene: job.scene.name().to_owned(),
        frame: moment.frame,
        time: job.scene.seconds(),
        voxel_size: job.lattice.voxel_size,
        expected,
        planned_bricks,
        memory_bytes,
        left_out,
    };
    Ok((report, hazards))
}

impl HazardReport {
    fn new((hazard, frame): &(Hazard, Option<i64>)) -> HazardReport {
        let fault = hazard.remark().fault();
        HazardReport {
            kind: hazard.kind(),
            frame: *frame,
            severity: match hazard.weight() {
                Weight::Serious => "serious",
                Weight::Warning => "warning",
                Weight::Note => "note",
            },
            line: fault.line(),
            column: fault.column(),
            what: fault.message(),
            change: fault.notes().to_vec(),
        }
    }
}

fn human_scene(report: &Hazards, hazards: &[(Hazard, Option<i64>)], explain: bool) -> String {
    let coloured = failure::colours_out();
    let show = |(hazard, frame): &(Hazard, Option<i64>)| {
        let frame = frame.map_or_else(String::new, |frame| {
            format!(
                "
  = worst at frame {frame}"
            )
        });
        format!(
            "{}{frame}

",
            hazard.remark().show(coloured)
        )
    };
    let mut out: String = hazards.iter().map(show).collect();
    let mut table = text::Table::default();
    for moment in &report.moments {
        let frame = moment.frame.map_or_else(String::new, |frame| format!(", frame {frame}"));
        table.heading(format!("{}{frame}", text::tidy(&moment.scene)));
        table.row("voxel size", format!("{} m", text::short(moment.voxel_size)));
        table.row("expected error", error(&moment.expected));
        table.row("largest density", text::short(moment.expected.peak));
        let bricks = text::number(moment.planned_bricks, "brick");
        table.row("memory", format!("{} at most, for {bricks}", text::bytes(moment.memory_bytes)));
        if explain {
            table.rows("left out", &moment.left_out, "nothing");
        }
    }
    table.row("hazards", tally(hazards));
    out.push_str(&table.finish());
    out
}

fn error(expected: &Expectation) -> String {
    let Some(error) = expected.relative_l2 else { return "unknown: no density was met".to_owned() };
    let held = expected
        .interval
        .map_or_else(String::new, |[low, high]| format!(" ({} to {})", text::short(low), text::short(high)));
    format!("relative L2 of {}{held}, read trilinearly", text::short(error))
}

/// How many there are of each weight.
fn tally(hazards: &[(Hazard, Option<i64>)]) -> String {
    let of = |weight| hazards.iter().filter(|(hazard, _)| hazard.weight() == weight).count() as u64;
    let [serious, warnings, notes] = [Weight::Serious, Weight::Warning, Weight::Note].map(of);
    format!("{serious} serious, {}, {}", text::number(warnings, "warning"), text::number(notes, "note"))
}

fn of_program(arguments: &Arguments, global: &Global) -> Result<(), Failure> {
    let started = Instant::now();
    let form = arguments.output.as_deref().map(Form::of).transpose()?;
    if let Some(option) = arguments.options.for_scenes_only() {
        return Err(Failure::usage(format!("{option} is for scenes, and none is given")));
    }
    if let Some(output) = &arguments.output {
        Output::check(output)?;
    }
    let interrupt = Interrupt::listen()?;
    let pool = global.pool()?;
    let is_wanted = |words: &str| arguments.only.as_ref().is_none_or(|only| words.contains(only.as_str()));
    let cases: Vec<Case> =
        catalogue().into_iter().filter(|case| is_wanted(&format!("{} {}", case.group, case.name))).collect();
    let mut progress = Progress::new(1, global.quiet);
    progress.begin(cases.len());
    let mut outcomes = Vec::new();
    for case in &cases {
        interrupt.check()?;
        outcomes.push(pool.install(|| case.run()));
        progress.advance(1);
    }
    drop(progress);
    interrupt.hold();
    let found = pool.install(|| families(&is_wanted, &mut || interrupt.check().is_ok()));
    interrupt.check()?;
    if outcomes.is_empty() && found.is_empty() {
        return Err(Failure::usage("no case has that word in its group or name"));
    }
    let held = outcomes.iter().filter(|outcome| outcome.holds).count();
    let report = Report {
        holds: held == outcomes.len() && found.iter().all(Family::holds),
        held,
        cases: outcomes,
        families: found,
        simd: Level::all().into_iter().map(Level::name).collect(),
        threads: pool.current_num_threads(),
        seconds: started.elapsed().as_secs_f64(),
    };
    if let (Some(output), Some(form)) = (&arguments.output, form) {
        let written = |error: Box<dyn std::error::Error + Send + Sync>| {
            Failure::failed(format!("cannot write {}", output.display())).because(error)
        };
        let bytes = match form {
            Form::Html => {
                page(&report.cases, &report.families).map_err(|error| written(error.into()))?.into_bytes()
            }
            Form::Json => serde_json::to_vec_pretty(&report).map_err(|error| written(error.into()))?,
        };
        save(output, &bytes, &interrupt)?;
    }
    global.show(&report, human)?;
    if report.holds {
        return Ok(());
    }
    let failed = report.cases.len() - held + report.families.iter().filter(|family| !family.holds()).count();
    Err(Failure::check(format!("{} did not hold", text::number(failed as u64, "case"))))
}

#[derive(Debug, Clone, Copy)]
enum Form {
    Html,
    Json,
}

impl Form {
    fn of(path: &Path) -> Result<Form, Failure> {
        let named = |name: &str| path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case(name));
        if named("html") {
            Ok(Form::Html)
        } else if named("json") {
            Ok(Form::Json)
        } else {
            Err(Failure::usage(format!("the output {} ends in neither .html nor .json", path.display())))
        }
    }
}

fn human(report: &Report) -> String {
    let mut out = String::new();
    let mut group = "";
    for case in &report.cases {
        if case.group != group {
            group = case.group;
            out.push_str(&format!("{group}\n"));
        }
        let mark = if case.holds { "  " } else { "! " };
        let found = match (case.bound, case.margin) {
            (Some(bound), Some(margin)) => format!("{} of {bound:.0e}, {margin:.2} of it", case.found),
            _ => case.found.clone(),
        };
        out.push_str(&format!("{mark}{:<NAMES$}  {}\n", case.name, text::tidy(&found)));
        if !case.holds {
            out.push_str(&format!("  {:<NAMES$}  expected: {}\n", "", case.expected));
        }
    }
    if !report.families.is_empty() {
        out.push_str("families: the error that is the largest part of its bound, and where\n");
    }
    for family in &report.families {
        let mark = if family.holds() { "  " } else { "! " };
        let name = format!("{}: {}", family.name, family.parameter);
        let worst = family
            .worst()
            .and_then(|mark| Some(format!("{:.1e} of {:.0e} at {:e}", mark.error?, mark.bound, mark.at)));
        out.push_str(&format!(
            "{mark}{name:<NAMES$}  {}\n",
            worst.unwrap_or_else(|| "nothing measured".to_owned())
        ));
    }
    out.push_str(&format!(
        "\n{} of {} hold, at {} on {}, in {}\n",
        report.held,
        text::number(report.cases.len() as u64, "case"),
        report.simd.join(", "),
        text::number(report.threads as u64, "thread"),
        text::seconds(report.seconds),
    ));
    out
}
