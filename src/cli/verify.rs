//! `vdbake verify`: whether a file is what its recipe makes.

use std::fs::File;
use std::path::{Path, PathBuf};

use clap::Args;
use glam::DVec3;
use serde::{Deserialize, Serialize};

use super::compare::figure;
use super::interrupt::Interrupt;
use super::memory::{Amount, PROGRAM, enough, resident};
use super::output::save;
use super::recipe::{CREATOR, antialias_name};
use super::{Failure, Global, certify, embedded, machine, text};
use crate::field::{Field, Lattice};
use crate::formats::npy::{self, Array, Values};
use crate::formats::vdb::{FileInfo, GridInfo, Meta, Metadata, VdbFile, VdbReadError};
use crate::report::{
    Certificate, FieldDifference, Measured, Rederived, Residuals, TrialError, content_hash, rederive, rows,
};
use crate::scene::Scene;
use crate::scene::limit::ANY;
use crate::volume::{Plan, PlanError, Precision};

/// Figures of a certificate are the same on every run, but for what JSON keeps of them.
const SAME: f64 = 1e-9;
/// Bytes for bricks that are baked again, and the leaves that they are held against.
const BAKING: u64 = 8 << 20;
/// Bytes for each leaf of the file without its values.
const LEAF: u64 = 128;
/// Faults of a certificate that are shown: one altered voxel changes most of its figures.
const SHOWN: usize = 5;

#[derive(Debug, Args)]
pub(super) struct Arguments {
    /// An OpenVDB file that was baked
    file: PathBuf,
    /// Bricks that are baked again, at random places that are the same on every run; `all` of them
    #[arg(long, value_name = "N", value_parser = bricks, default_value = "256", allow_negative_numbers = true)]
    bricks: usize,
    /// Where the files are that the scene names [default: the file's folder]
    #[arg(long, value_name = "FOLDER")]
    inputs: Option<PathBuf>,
    /// Write the points, rays and residuals that a certificate rests on into this folder, as .npy
    #[arg(long, value_name = "FOLDER")]
    export: Option<PathBuf>,
    /// Memory for the grid and the plan, such as 500MB or 2GiB [default: three quarters of the machine's]
    #[arg(long, value_name = "SIZE", allow_negative_numbers = true)]
    memory: Option<Amount>,
}

fn bricks(text: &str) -> Result<usize, String> {
    if text == "all" {
        return Ok(usize::MAX);
    }
    let bricks = text.parse().ok().filter(|bricks| *bricks > 0);
    bricks.ok_or_else(|| "expected a whole number of bricks of at least 1, or `all`".to_owned())
}

/// What a file's metadata say that it was baked with.
#[derive(Debug, Clone, Deserialize)]
struct Recipe {
    voxel_size: f64,
    time: f64,
    precision: String,
    cutoff: f64,
    octave_fade: bool,
    widen: bool,
    antialias: String,
}

/// What was found, as `--json` prints it.
#[derive(Debug, Serialize)]
struct Report {
    file: String,
    creator: String,
    content_hash: Check,
    /// Of bricks that were baked again.
    bricks: u64,
    bricks_that_differ: u64,
    /// The first voxel of one of these.
    first_brick: Option<[i32; 3]>,
    /// The first voxel of a leaf where the scene can have no density.
    outside: Option<[i32; 3]>,
    /// Whether its voxels are as large as the recipe has them, and where.
    placed: bool,
    /// Grids of the density's name: one is as it should be.
    densities: usize,
    /// Grids beside it, which are not looked at.
    other_grids: usize,
    /// Null where there is none.
    certificate: Option<Certified>,
    /// That which lies beside the file; null where there is none.
    certificate_beside: Option<Beside>,
    /// Files that were written.
    exported: Vec<String>,
    peak_rss_bytes: Option<u64>,
    holds: bool,
}

#[derive(Debug, Serialize)]
struct Check {
    stated: String,
    found: String,
    holds: bool,
}

#[derive(Debug, Serialize)]
struct Certified {
    /// What is wrong with it.
    faults: Vec<String>,
    /// Measured again.
    measured: Measured,
    holds: bool,
}

/// A certificate in a file of its own.
#[derive(Debug, Serialize)]
struct Beside {
    file: String,
    /// Why it is none of the file that it lies beside; null where it is.
    fault: Option<String>,
}

/// Verifies.
pub(super) fn run(arguments: &Arguments, global: &Global) -> Result<(), Failure> {
    let interrupt = Interrupt::listen()?;
    let pool = global.pool()?;
    let report = pool.install(|| verify(arguments, global, &interrupt))?;
    global.show(&report, human)?;
    if report.holds {
        return Ok(());
    }
    Err(Failure::check(format!(
        "{} is not what its recipe makes, or its certificate does not hold",
        report.file
    )))
}

fn verify(arguments: &Arguments, global: &Global, interrupt: &Interrupt) -> Result<Report, Failure> {
    let path = &arguments.file;
    let memory = Amount::settle(arguments.memory);
    let budget = memory.bytes().saturating_sub(PROGRAM);
    let FileInfo { metadata, grids, .. } = info(path, budget)?;
    let creator = match metadata.get("creator") {
        Some(Meta::String(creator)) => creator.clone(),
        _ => String::new(),
    };
    let optional = |name: &str| match metadata.get(name) {
        None => Ok(None),
        Some(Meta::String(text)) => Ok(Some(text.as_str())),
        Some(_) => Err(Failure::input(format!("{name} in {} is not a text", path.display()))),
    };
    let text = |name: &str| optional(name)?.ok_or_else(|| foreign(path, name, &creator));
    text("vdbake_settings")?;
    if creator != CREATOR && !creator.is_empty() {
        global.note(&format!("the file is by {}, and this is {CREATOR}", text::tidy(&creator)));
    }
    let damaged = |what: &str| Failure::input(format!("the {what} in {} make no sense", path.display()));
    let recipe: Recipe =
        serde_json::from_str(text("vdbake_settings")?).map_err(|error| damaged("settings").because(error))?;
    let precision = match recipe.precision.as_str() {
        "f32" => Precision::F32,
        "f16" => Precision::F16,
        _ => return Err(damaged("settings")),
    };
    // A search for an error may take voxels smaller than a scene can ask for.
    let is_size = recipe.voxel_size.is_normal() && recipe.voxel_size > 0.0;
    if !is_size || !ANY.admits(recipe.time) {
        return Err(damaged("settings"));
    }
    text("vdbake_scene")?;
    optional("vdbake_inputs")?;
    let scene = embedded::scene(&metadata, path, arguments.inputs.as_deref(), memory)?;
    let scene = scene.ok_or_else(|| foreign(path, "vdbake_scene", &creator))?.at(recipe.time)?;
    let own = optional(certify::CERTIFICATE)?;
    let lattice = Lattice { voxel_size: recipe.voxel_size };
    let mut field = Field::compile(&scene);
    field.widen(lattice);
    let process = PROGRAM.max(resident());
    let besides = process.saturating_add(BAKING);
    let is_measured = own.is_some() || arguments.export.is_some();
    let plan = Plan::new(&field, lattice, memory.bytes().saturating_sub(besides)).map_err(|error| {
        let measured = certify::enough_for(error, precision, process).filter(|_| is_measured);
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "saturates")]
        let leaves = if let PlanError::TooMany { bricks, .. } = error { bricks as u64 } else { 0 };
        let planned = error.enough().map(|plan| plan.saturating_add(besides));
        let planned = planned.map(|bytes| bytes.saturating_add(LEAF.saturating_mul(leaves)));
        let failure = Failure::failed("the bricks cannot be planned").because(error);
        let hint = planned.max(measured).map(|bytes| format!("allow more with --memory {}", enough(bytes)));
        hint.into_iter().fold(failure, Failure::hint)
    })?;
    if is_measured {
        certify::check(&plan, precision, [memory.bytes(), process])?;
    }
    let held = besides.saturating_add(plan.memory() as u64);
    let unread = |error: TrialError| match error {
        TrialError::Read(VdbReadError::Memory { needed, .. }) => {
            certify::unmeasured(path, TrialError::Memory { needed }, held)
        }
        error => certify::unmeasured(path, error, held),
    };
    let mut leaves = certify::paged(open(path)?, memory.bytes().saturating_sub(held)).map_err(unread)?;

    let stated = text("vdbake_content_hash")?.to_owned();
    let found = text::hexadecimal(&content_hash(&mut leaves).map_err(|error| unread(error.into()))?);
    let content = Check { holds: stated == found, stated, found };
    interrupt.check()?;

    let rederived = rederive(&mut leaves, &field, &plan, scene.bake().cutoff, precision, arguments.bricks);
    let Rederived { bricks, differ, first, outside } = rederived.map_err(|error| unread(error.into()))?;
    drop((leaves, plan));
    interrupt.check()?;

    let (beside, other) = beside(path, own, &content).unzip();
    // One that lies beside it alone is held against the file as if it were in it.
    let certificate = own.map(str::to_owned).or(other.flatten());
    let mut exported = Vec::new();
    let certified = if certificate.is_some() || arguments.export.is_some() {
        let memory = [memory.bytes(), process];
        let open = || File::open(path);
        let (measured, found, residuals) =
            certify::measured(&scene, lattice, (path, &open), precision, memory)?;
        if let Some(folder) = &arguments.export {
            exported = export(folder, &residuals, interrupt)?;
        }
        certificate.map(|text| certified(&text, measured, &found, &scene, &content, &metadata))
    } else {
        None
    };
    let placed = grids.iter().any(|grid| grid.name == "density" && is_placed(grid, lattice));
    let other_grids = grids.iter().filter(|grid| grid.name != "density").count();
    if other_grids > 0 {
        let others = text::number(other_grids as u64, "other grid");
        global.note(&format!("{others} in the file: the recipe says nothing of what they hold"));
    }
    let densities = grids.len() - other_grids;
    let holds = content.holds
        && placed
        && densities == 1
        && differ == 0
        && outside.is_none()
        && same_settings(&recipe, &scene)
        && certified.as_ref().is_none_or(|certified| certified.holds)
        && beside.as_ref().is_none_or(|beside| beside.fault.is_none());
    Ok(Report {
        file: path.display().to_string(),
        creator,
        content_hash: content,
        bricks,
        bricks_that_differ: differ,
        first_brick: first,
        outside,
        placed,
        densities,
        other_grids,
        certificate: certified,
        certificate_beside: beside,
        exported,
        peak_rss_bytes: machine::peak_memory(),
        holds,
    })
}

/// Of a file that says nothing of how it was made.
fn foreign(path: &Path, name: &str, creator: &str) -> Failure {
    let by = if creator.is_empty() { String::new() } else { format!(", but by {}", text::tidy(creator)) };
    Failure::input(format!("{} carries no {name}: it was not baked by this program{by}", path.display()))
        .hint("`vdbake info` tells what is in it, and `vdbake compare` holds it against a scene")
}

/// The certificate beside a file, which may be of values that it held before, or may have been altered; and its text, where
/// it is of the file's values.
fn beside(path: &Path, own: Option<&str>, content: &Check) -> Option<(Beside, Option<String>)> {
    let beside = certify::beside(path);
    let found = match certify::read_beside(&beside)? {
        Err(error) => Err(format!("it makes no sense: {error}")),
        Ok(found) if found.content_hash != content.found => Err("it is of other values".to_owned()),
        Ok(found) => serde_json::to_value(found).map_err(|error| error.to_string()),
    };
    let value = |text| serde_json::from_str::<serde_json::Value>(text).ok();
    let is_other = |found: &_| own.is_some_and(|own| value(own).is_none_or(|own| !same_numbers(&own, found)));
    let found = found.and_then(|found| match is_other(&found) {
        true => Err("it says something else than that in the file".to_owned()),
        false => Ok(found.to_string()),
    });
    let file = beside.display().to_string();
    Some(match found {
        Ok(text) => (Beside { file, fault: None }, Some(text)),
        Err(fault) => (Beside { file, fault: Some(fault) }, None),
    })
}

/// Whether a grid's voxels are where those of a lattice are.
fn is_placed(grid: &GridInfo, lattice: Lattice) -> bool {
    let Some(matrix) = grid.map.matrix else { return false };
    let h = lattice.voxel_size;
    let close = |(a, b): (&f64, &f64)| (a - b).abs() <= SAME * h;
    matrix.iter().flatten().zip(rows(lattice).iter().flatten()).all(close)
}

/// Whether the settings are those of the scene's text.
fn same_settings(recipe: &Recipe, scene: &Scene) -> bool {
    let bake = scene.bake();
    recipe.cutoff == bake.cutoff
        && recipe.octave_fade == bake.octave_fade
        && recipe.widen == bake.widen
        && recipe.antialias == antialias_name(bake.antialias)
}

fn open(path: &Path) -> Result<File, Failure> {
    File::open(path).map_err(|error| Failure::unreadable(path, error))
}

fn info(path: &Path, budget: u64) -> Result<FileInfo, Failure> {
    let failed =
        |error: VdbReadError| Failure::input(format!("cannot read {}", path.display())).because(error);
    Ok(VdbFile::open_within(open(path)?, budget).map_err(failed)?.info().clone())
}

/// What there is to say of a certificate.
fn certified(
    text: &str,
    measured: Measured,
    found: &FieldDifference,
    scene: &Scene,
    content: &Check,
    metadata: &Metadata,
) -> Certified {
    let mut faults = Vec::new();
    match serde_json::from_str::<Certificate>(text) {
        Err(error) => faults.push(format!("it makes no sense: {error}")),
        Ok(certificate) => {
            if certificate.version != certify::VERSION {
                faults.push(format!(
                    "it is of version {}, and this is {}",
                    certificate.version,
                    certify::VERSION
                ));
            }
            if certificate.content_hash != content.found {
                faults.push("it is of other values".to_owned());
            }
            if certificate.scene_sha256 != certify::scene_hash(scene.text()) {
                faults.push("it is of another scene".to_owned());
            }
            let settings = match metadata.get("vdbake_settings") {
                Some(Meta::String(text)) => serde_json::from_str::<serde_json::Value>(text).ok(),
                _ => None,
            };
            if settings.is_none_or(|settings| !same_numbers(&settings, &certificate.settings)) {
                faults.push("it is of other settings".to_owned());
            }
            faults.extend(differences(&certificate.measured, &measured));
            faults.extend(unmet(&certificate, found));
            if !certify::is_of_this_kind(&certificate) {
                faults.push("its truth, filter or random numbers are not those of this program".to_owned());
            }
        }
    }
    Certified { holds: faults.is_empty(), faults, measured }
}

/// Whether JSON values are equal but for the last digits of numbers.
fn same_numbers(a: &serde_json::Value, b: &serde_json::Value) -> bool {
    use serde_json::Value;
    match (a, b) {
        (Value::Number(a), Value::Number(b)) => near(a.as_f64().unwrap_or(0.0), b.as_f64().unwrap_or(0.0)),
        (Value::Array(a), Value::Array(b)) => {
            a.len() == b.len() && a.iter().zip(b).all(|(a, b)| same_numbers(a, b))
        }
        (Value::Object(a), Value::Object(b)) => {
            a.len() == b.len() && a.iter().all(|(key, a)| b.get(key).is_some_and(|b| same_numbers(a, b)))
        }
        (a, b) => a == b,
    }
}

fn near(a: f64, b: f64) -> bool {
    a == b || (a - b).abs() <= SAME * a.abs().max(b.abs())
}

/// What is stated of a goal, and is not so. The pilots, and what was baked before, are not tried again.
fn unmet(certificate: &Certificate, found: &FieldDifference) -> Option<String> {
    let reached = certificate.goal.as_ref()?;
    let [achieved, at_most] = reached.goal.metric.of(found)?;
    let is_so = near(reached.achieved, achieved)
        && near(reached.at_most, at_most)
        && at_most <= reached.goal.limit * (1.0 + SAME);
    (!is_so).then(|| {
        let limit = reached.goal.limit;
        format!(
            "its goal of {}: {} was measured, at most {}",
            figure(limit),
            figure(achieved),
            figure(at_most)
        )
    })
}

/// Figures that are not as certified, by their places.
fn differences(stated: &Measured, found: &Measured) -> Vec<String> {
    let mut faults = Vec::new();
    match (serde_json::to_value(stated), serde_json::to_value(found)) {
        (Ok(stated), Ok(found)) => compare("", &stated, &found, &mut faults),
        _ => faults.push("it makes no sense".to_owned()),
    }
    faults
}

fn compare(place: &str, stated: &serde_json::Value, found: &serde_json::Value, faults: &mut Vec<String>) {
    use serde_json::Value;
    match (stated, found) {
        (Value::Object(a), Value::Object(b)) => {
            for (key, b) in b {
                compare(&format!("{place} {key}"), a.get(key).unwrap_or(&Value::Null), b, faults);
            }
        }
        (a, b) if same_numbers(a, b) => {}
        (a, b) => {
            let [a, b] = told_apart(a, b);
            faults.push(format!("{}: {a} is stated, and {b} was measured", place.trim_start()));
        }
    }
}

/// Two values in as few digits, from four, as show that they differ.
fn told_apart(a: &serde_json::Value, b: &serde_json::Value) -> [String; 2] {
    if let (Some(x), Some(y)) = (a.as_f64(), b.as_f64()) {
        let shown = [figure(x), figure(y)];
        if shown[0] != shown[1] {
            return shown;
        }
        for digits in 4..17 {
            let shown = [x, y].map(|x| format!("{x:.digits$e}"));
            if shown[0] != shown[1] {
                return shown;
            }
        }
    }
    [a, b].map(serde_json::Value::to_string)
}

/// Writes what statistics are made from.
fn export(folder: &Path, residuals: &Residuals, interrupt: &Interrupt) -> Result<Vec<String>, Failure> {
    std::fs::create_dir_all(folder)
        .map_err(|error| Failure::failed(format!("cannot make {}", folder.display())).because(error))?;
    let Residuals { points, values: [truth, values], chords, depths: [true_depths, depths] } = residuals;
    let vectors = |points: &[DVec3]| points.iter().flat_map(DVec3::to_array).collect::<Vec<f64>>();
    let difference = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| b - a).collect::<Vec<f64>>();
    let rays = (chords.iter())
        .flat_map(|chord| {
            [chord.origin.to_array(), chord.direction.to_array()].concat().into_iter().chain(chord.range)
        })
        .collect();
    let arrays = [
        ("points", vec![points.len(), 3], vectors(points)),
        ("truth", vec![truth.len()], truth.clone()),
        ("values", vec![values.len()], values.clone()),
        ("residuals", vec![values.len()], difference(truth, values)),
        ("rays", vec![chords.len(), 8], rays),
        ("depths_truth", vec![true_depths.len()], true_depths.clone()),
        ("depths", vec![depths.len()], depths.clone()),
        ("depths_residuals", vec![depths.len()], difference(true_depths, depths)),
    ];
    let mut written = Vec::new();
    for (name, shape, numbers) in arrays {
        let path = folder.join(format!("{name}.npy"));
        let mut bytes = Vec::new();
        npy::write(&mut bytes, &Array { shape, values: Values::F64(numbers) })
            .map_err(|error| Failure::failed(format!("cannot write {}", path.display())).because(error))?;
        save(&path, &bytes, interrupt)?;
        written.push(path.display().to_string());
    }
    Ok(written)
}

fn human(report: &Report) -> String {
    let mut table = text::Table::default();
    let holds = |holds: bool| if holds { "holds" } else { "does not hold" };
    table.heading(format!("{}  {}", report.file, holds(report.holds)));
    table.row("content hash", holds(report.content_hash.holds));
    let place = report.first_brick.map_or_else(String::new, |at| format!(", such as that at {at:?}"));
    table.row(
        "baked again",
        format!(
            "{}, of which {} differ{place}",
            text::number(report.bricks, "brick"),
            text::count(report.bricks_that_differ)
        ),
    );
    if report.densities > 1 {
        table.row("grids", format!("{} are named density, and a bake has one", report.densities));
    }
    if !report.placed {
        table.row("voxels", "are of another size than the recipe's, or elsewhere");
    }
    if let Some(at) = report.outside {
        table.row("", format!("the leaf at {at:?} lies where the scene can have no density"));
    }
    match &report.certificate {
        None => table.row("certificate", "none"),
        Some(certified) => {
            table.row("certificate", holds(certified.holds));
            for fault in certified.faults.iter().take(SHOWN) {
                table.row("", fault);
            }
            if let Some(more) = certified.faults.len().checked_sub(SHOWN).filter(|more| *more > 0) {
                table.row("", format!("and {} more, which --json lists", text::count(more as u64)));
            }
        }
    }
    if let Some(Beside { file, fault: Some(fault) }) = &report.certificate_beside {
        table.row("beside it", format!("the certificate {file} does not belong to the file: {fault}"));
    }
    if !report.exported.is_empty() {
        table.rows("written", &report.exported, "");
    }
    table.finish()
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn figures_have_as_many_digits_as_tell_them_apart() {
        for (a, b, shown) in [
            (json!(0.123_456_789), json!(0.25), ["0.1235", "0.25"]),
            (json!(0.123_456_789_1), json!(0.123_456_789_2), ["1.234567891e-1", "1.234567892e-1"]),
            (json!(null), json!(1.5), ["null", "1.5"]),
        ] {
            assert_eq!(told_apart(&a, &b), shown);
        }
    }
}
