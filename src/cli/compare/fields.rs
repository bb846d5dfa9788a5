//! Scenes and grids.

use std::fs::File;
use std::path::Path;

use serde::Serialize;

use super::tolerance::Tolerance;
use super::{Arguments, Kind, figure, too_much};
use crate::cli::Failure;
use crate::cli::grids::{Choice, choose};
use crate::cli::job::{Compiled, Source as SceneSource};
use crate::cli::memory::unplanned;
use crate::cli::text::{self, Table};
use crate::formats::vdb::{AnyTree, VdbFile, VdbReadError};
use crate::report::{self, FieldDifference, Gridded, Places, Procedural, Rows, Scaled, Source};
use crate::volume::{Filter, PlanError, Sampled, Tree};

/// Points, and rays, where nobody says how many.
const PLACES: Places = Places { points: 200_000, rays: 2000 };
/// Bytes that are held for each point: itself, in the world and in index space, two values, the difference, and what the kernel
/// orders it by.
const POINT: u64 = 160;
/// Bytes for each leaf or brick, to know which points lie in it and to spread them.
const CUBE: u64 = 64;
/// Bytes for points that are evaluated at once.
const BATCH: u64 = 32 << 20;

/// How fields differ, as `--json` prints it.
#[derive(Debug, Serialize)]
pub(super) struct Report {
    kind: &'static str,
    a: Side,
    b: Side,
    #[serde(flatten)]
    found: FieldDifference,
    /// Null where none was asked for.
    pub(super) tolerance: Option<Tolerance>,
}

/// One of both, as `--json` prints it.
#[derive(Debug, Serialize)]
struct Side {
    file: String,
    grid: String,
    /// `kernel`, or a filter of a file's values.
    method: &'static str,
    /// Seconds after the scene's start frame; null for files.
    time: Option<f64>,
    /// At which octaves fade and thin parts are widened; null for files.
    voxel_size: Option<f64>,
}

/// Compares scenes and files.
pub(super) fn compare(arguments: &Arguments, kinds: [Kind; 2]) -> Result<Report, Failure> {
    let places = Places {
        points: arguments.points.map_or(PLACES.points, |points| points as usize),
        rays: arguments.rays.map_or(PLACES.rays, |rays| rays as usize),
    };
    let points = (places.points as u64).saturating_mul(POINT).saturating_add(BATCH);
    let budget = arguments.memory();
    let left = budget.saturating_sub(points);
    let a = read(arguments, &arguments.a, kinds[0], left)?;
    let b = read(arguments, &arguments.b, kinds[1], left.saturating_sub(a.bytes))?;
    let need = points.saturating_add(a.bytes).saturating_add(b.bytes);
    let (Some((a, a_source)), Some((b, b_source)), true) = (a.read, b.read, need <= budget) else {
        return Err(too_much("the comparison", need));
    };
    let found = report::compare(&*a_source, &*b_source, places);
    let metric = arguments.metric.unwrap_or_default();
    let tolerance = arguments.tolerance.map(|limit| Tolerance::of_fields(metric, limit, &found));
    Ok(Report { kind: "fields", a, b, found, tolerance })
}

/// One of both.
struct Read {
    /// Bytes that it takes, and what is known of its leaves or bricks; no fewer where there is no room.
    bytes: u64,
    /// `None` where there is no room.
    read: Option<(Side, Box<dyn Source>)>,
}

impl Read {
    fn new(side: Side, source: Box<dyn Source>, bytes: u64) -> Read {
        let cubes = CUBE * source.support().count() as u64;
        Read { bytes: bytes.saturating_add(cubes), read: Some((side, source)) }
    }

    /// Of so many bytes, as many times as many at most.
    fn without_room(bytes: u64, cubes: u64) -> Read {
        Read { bytes: bytes.saturating_add(cubes), read: None }
    }
}

/// Reads one of both within so many bytes.
fn read(arguments: &Arguments, path: &Path, kind: Kind, budget: u64) -> Result<Read, Failure> {
    if kind == Kind::Grid { grid(arguments, path, budget) } else { scene(arguments, path, budget) }
}

fn scene(arguments: &Arguments, path: &Path, budget: u64) -> Result<Read, Failure> {
    let Compiled { field, lattice, time, .. } =
        SceneSource::read(path, &arguments.scene)?.compile(arguments.scene.time())?;
    let source = match Procedural::new(field, lattice, budget) {
        Ok(source) => source,
        Err(error) => {
            let (PlanError::TooMany { bricks, .. }, Some(enough)) = (error, error.enough()) else {
                return Err(unplanned(error));
            };
            #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "saturates")]
            return Ok(Read::without_room(enough, CUBE.saturating_mul(bricks as u64)));
        }
    };
    let side = Side {
        file: path.display().to_string(),
        grid: "density".to_owned(),
        method: "kernel",
        time: Some(time),
        voxel_size: Some(lattice.voxel_size),
    };
    let taken = source.memory();
    Ok(Read::new(side, Box::new(source), taken))
}

fn grid(arguments: &Arguments, path: &Path, budget: u64) -> Result<Read, Failure> {
    /// No leaf takes less than this many times what is known of it besides.
    const LEAF: u64 = 8;
    match grid_within(arguments, path, budget) {
        Ok(read) => Ok(read),
        Err(Unread::Memory(needed)) => Ok(Read::without_room(needed, needed / LEAF)),
        Err(Unread::Other(failure)) => Err(failure),
    }
}

/// Why a grid was not read.
enum Unread {
    /// There is no room for so many bytes.
    Memory(u64),
    Other(Failure),
}

impl From<Failure> for Unread {
    fn from(failure: Failure) -> Unread {
        Unread::Other(failure)
    }
}

fn grid_within(arguments: &Arguments, path: &Path, budget: u64) -> Result<Read, Unread> {
    let name = path.display();
    let failed = |error: VdbReadError| match error {
        VdbReadError::Memory { needed, .. } => Unread::Memory(needed),
        error => Unread::Other(Failure::input(format!("cannot read {name}")).because(error)),
    };
    let file =
        File::open(path).map_err(|error| Failure::input(format!("cannot read {name}")).because(error))?;
    let mut file = VdbFile::open_within(file, budget).map_err(failed)?;
    let beyond = |error: VdbReadError| Failure::input(format!("cannot read {name}")).because(error);
    let Choice { number, label } = choose(file.info(), arguments.grid.as_deref(), beyond)?;
    let grid = file.grid_at(number).map_err(failed)?;
    let filter = arguments.filter.map_or(Filter::Trilinear, Filter::from);
    let no_inverse = || {
        let map = text::tidy(&grid.info.map.type_name);
        Failure::input(format!(
            "the map {map} of grid {} in {name} has no inverse that is known here",
            text::tidy(&label)
        ))
    };
    let rows = grid.info.map.matrix.ok_or_else(no_inverse)?;
    let (source, taken) = match grid.tree {
        AnyTree::Bool(tree) => gridded(tree, rows, filter),
        AnyTree::Int32(tree) => gridded(tree, rows, filter),
        AnyTree::Int64(tree) => gridded(tree, rows, filter),
        AnyTree::Float(tree) => gridded(tree, rows, filter),
        AnyTree::Double(tree) => gridded(tree, rows, filter),
        AnyTree::Vec3i(_) | AnyTree::Vec3s(_) | AnyTree::Vec3d(_) => {
            return Err(Failure::usage(format!(
                "grid {} of {name} holds vectors, and only grids of numbers are compared",
                text::tidy(&label)
            ))
            .into());
        }
    };
    let side = Side {
        file: name.to_string(),
        grid: label.clone(),
        method: match filter {
            Filter::Nearest => "nearest",
            Filter::Trilinear => "trilinear",
            Filter::Cubic => "cubic",
        },
        time: None,
        voxel_size: None,
    };
    Ok(Read::new(side, source.ok_or_else(no_inverse)?, taken))
}

fn gridded<T: Sampled<Wide = f64>>(
    tree: Tree<T>,
    rows: Rows,
    filter: Filter,
) -> (Option<Box<dyn Source>>, u64) {
    let taken = tree.memory_bytes();
    (Gridded::new(tree, rows, filter).map(|gridded| Box::new(gridded) as Box<dyn Source>), taken)
}

impl Side {
    fn line(&self) -> String {
        let voxels =
            self.voxel_size.map_or(String::new(), |size| format!(", at voxels of {} m", figure(size)));
        format!("{}: {} by {}{voxels}", text::plain(&self.file), text::tidy(&self.grid), self.method)
    }
}

/// In words.
pub(super) fn human(report: &Report) -> String {
    let found = &report.found;
    let mut table = Table::default();
    table.heading(format!("A  {}", report.a.line()));
    table.heading(format!("B  {}", report.b.line()));
    table.row("points", format!("{} in {} m^3", text::count(found.points), figure(found.volume)));
    errors(&mut table, found);
    if let Some([x, y, z]) = found.worst {
        table.row("largest at", text::vector([x, y, z]));
    }
    let [a, b] = found.mass.of.map(figure);
    table.row("mass", format!("{a} and {b} m^3{}", ratio(found)));
    let depth = &found.optical_depth;
    let root = depth.l2.of_rms.map_or_else(String::new, |part| format!(" ({} of A's)", figure(part)));
    table.row(
        "optical depth",
        format!(
            "L1 {}, L2 {}{root}, largest {} m, along {}",
            figure(depth.l1.absolute),
            figure(depth.l2.absolute),
            figure(depth.max.absolute),
            text::number(depth.rays, "ray")
        ),
    );
    if let Some(voxels) = &found.voxels {
        let [a, b] = voxels.active.map(text::count);
        let [only_a, only_b] = voxels.only.map(text::count);
        let topology = if voxels.topology_equal {
            "the same".to_owned()
        } else {
            format!("{only_a} in A only, {only_b} in B only")
        };
        table.row("active voxels", format!("{a} and {b}, {topology}"));
        let line = format!(
            "{}, by up to {}, root mean square {}",
            text::count(voxels.differ),
            figure(voxels.max),
            figure(voxels.rms)
        );
        table.row("that differ", line);
    }
    not_finite(&mut table, found);
    if let Some(tolerance) = &report.tolerance {
        table.row("tolerance", tolerance.line());
    }
    table.finish()
}

/// Columns of figures.
fn errors(table: &mut Table, found: &FieldDifference) {
    let errors = &found.errors;
    let column = |x: Option<f64>| x.map_or_else(|| "-".to_owned(), figure);
    let interval = |[low, high]: [f64; 2]| format!("{} to {}", figure(low), figure(high));
    let header = ["absolute", "of A's RMS", "of A's peak", "95 % interval"];
    table.row("", format!("{:<12}  {:<12}  {:<12}  {}", header[0], header[1], header[2], header[3]));
    let mut row = |name: &str, scaled: Scaled, held: Option<[f64; 2]>| {
        let [absolute, rms, peak] = [Some(scaled.absolute), scaled.of_rms, scaled.of_peak].map(column);
        let held = held.map_or_else(String::new, interval);
        table.row(name, format!("{absolute:<12}  {rms:<12}  {peak:<12}  {held}").trim_end());
    };
    let held = found.intervals.as_ref();
    row("L1", errors.l1, held.map(|held| held.l1));
    row("L2", errors.l2, held.map(|held| held.l2));
    row("bias", errors.bias, held.map(|held| held.bias));
    row("99.9 percentile", errors.p999, None);
    row("largest", errors.max, None);
    table.row("PSNR", super::images::psnr(errors));
}

fn ratio(found: &FieldDifference) -> String {
    let Some(ratio) = found.mass.ratio else { return String::new() };
    let held = found
        .mass
        .ratio_interval
        .map_or_else(String::new, |[low, high]| format!(" ({} to {})", short_ratio(low), short_ratio(high)));
    format!(", ratio {}{held}", short_ratio(ratio))
}

/// Digits enough to see how far it is from 1.
fn short_ratio(ratio: f64) -> String {
    format!("{ratio:.6}")
}

fn not_finite(table: &mut Table, found: &FieldDifference) {
    let ([a, b], [rays_a, rays_b]) = (found.errors.not_finite, found.optical_depth.not_finite);
    let voxels = found.voxels.map_or(0, |voxels| voxels.not_finite);
    if a + b + rays_a + rays_b + voxels == 0 {
        return;
    }
    let place =
        found.not_finite_at.map_or_else(String::new, |at| format!(", such as at {}", text::vector(at)));
    let [a, b, rays_a, rays_b, voxels] = [a, b, rays_a, rays_b, voxels].map(text::count);
    table.row("NaN or infinite", format!("{a} points of A, {b} of B{place}; left out above"));
    table.row("", format!("{rays_a} rays of A, {rays_b} of B; {voxels} voxels"));
}
