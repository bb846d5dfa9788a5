//! `vdbake sample`: values at points.

mod points;
mod values;

use std::fs::File;
use std::path::{Path, PathBuf};

use clap::{Args, ValueEnum};
use glam::DVec3;
use serde::Serialize;

use super::grids::{Choice, choose};
use super::interrupt::Interrupt;
use super::job::{Compiled, SceneOptions, Source};
use super::memory::{self, PROGRAM, enough, resident, unplanned_beside};
use super::output::{Output, save_with};
use super::{Failure, Global, info, machine, print, text};
use crate::field::Extent;
use crate::formats::npy;
use crate::formats::vdb::{PartialGrid, VdbFile, VdbReadError};
use crate::num::Level;
use crate::reference::Reference;
use crate::volume::{self, Filter, Part, Plan, WorldToIndex, planned_density_at};
use points::Points;
use values::Samples;

/// Bytes of a grid that are read in the time that it takes to find out where a point's voxels are, about.
const BYTES_A_POINT: u64 = 512;
/// Bytes that a point takes: with its value in a scene, with a value of any type of a file's grid, and to know beforehand which
/// of the grid's leaves are looked into.
const OF_SCENE: u64 = 56;
const OF_FILE: u64 = 96;
const SOUGHT: u64 = 208;

#[derive(Debug, Args)]
pub(super) struct Arguments {
    /// A scene, or an OpenVDB file
    #[arg(value_name = "SCENE|FILE")]
    file: PathBuf,
    /// Where to sample: CSV of x,y,z a line, or .npy of N x 3; - for CSV on standard input
    #[arg(long, value_name = "FILE|-")]
    points: PathBuf,
    /// How values between the voxels of a file are found [default: trilinear]
    #[arg(long, value_enum)]
    filter: Option<FilterName>,
    /// The grid to sample, with its number in brackets behind the name where several have it, as in `density[1]` [default: the only one, else density]
    #[arg(long, value_name = "NAME")]
    grid: Option<String>,
    /// Take points as indices of the file's own lattice: whole numbers give stored values, to the bit
    #[arg(long)]
    index: bool,
    /// Evaluate a scene by the slow reference, in double precision
    #[arg(long)]
    exact: bool,
    /// Where to write, a name that ends in .csv or .npy [default: CSV to standard output]
    #[arg(short, long, value_name = "OUT")]
    output: Option<PathBuf>,
    #[command(flatten)]
    scene: SceneOptions,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
pub(super) enum FilterName {
    /// The nearest voxel's value
    Nearest,
    /// Linear between 2^3 voxels
    Trilinear,
    /// Catmull-Rom over 4^3 voxels, clamped to the range of the inner 2^3
    Cubic,
}

impl From<FilterName> for Filter {
    fn from(name: FilterName) -> Filter {
        match name {
            FilterName::Nearest => Filter::Nearest,
            FilterName::Trilinear => Filter::Trilinear,
            FilterName::Cubic => Filter::Cubic,
        }
    }
}

/// What was sampled, as `--json` prints it.
#[derive(Debug, Serialize)]
struct Report<'a> {
    file: String,
    grid: String,
    /// `kernel`, `reference`, or a filter of a file's values.
    method: &'static str,
    /// Seconds after the scene's start frame; null for files.
    time: Option<f64>,
    /// At which octaves fade; null for files.
    voxel_size: Option<f64>,
    points: usize,
    /// Points that are not finite, or lie where there are no indices: they have the background's value.
    out_of_range: usize,
    /// Where the values were written.
    output: Option<String>,
    peak_rss_bytes: Option<u64>,
    /// Null where they were written to a file.
    values: Option<&'a Samples>,
}

/// Where values go.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Form {
    Csv,
    Npy,
}

/// Values at points, and how they were found.
struct Found {
    samples: Samples,
    grid: String,
    method: &'static str,
    time: Option<f64>,
    voxel_size: Option<f64>,
    out_of_range: usize,
}

/// Samples.
pub(super) fn run(arguments: &Arguments, global: &Global) -> Result<(), Failure> {
    let form = arguments.output.as_deref().map(form).transpose()?;
    let is_file = info::is_vdb(&arguments.file)?;
    check(arguments, is_file)?;
    let interrupt = Interrupt::listen()?;
    let pool = global.pool()?;
    if let Some(path) = &arguments.output {
        Output::check(path)?;
    }
    let (points, found) = pool.install(|| if is_file { of_file(arguments) } else { of_scene(arguments) })?;
    if found.out_of_range > 0 {
        global.note(&format!(
            "{} of {} points are not finite or too far away; they have the background's value",
            text::count(found.out_of_range as u64),
            text::count(points.len() as u64),
        ));
    }
    if let (Some(path), Some(form)) = (&arguments.output, form) {
        write(path, form, &points, &found.samples, &interrupt)?;
    }
    let report = Report {
        file: arguments.file.display().to_string(),
        grid: found.grid,
        method: found.method,
        time: found.time,
        voxel_size: found.voxel_size,
        points: points.len(),
        out_of_range: found.out_of_range,
        output: arguments.output.as_ref().map(|path| path.display().to_string()),
        peak_rss_bytes: machine::peak_memory(),
        values: arguments.output.is_none().then_some(&found.samples),
    };
    match &report.output {
        None if !global.json => print(|out| found.samples.write_csv(&points, out)),
        output => {
            let output = output.clone().unwrap_or_default();
            global.show(&report, |report| {
                format!("{output}  {} values by {}", text::count(report.points as u64), report.method)
            })
        }
    }
}

/// Refuses options that have no meaning for what is sampled.
fn check(arguments: &Arguments, is_file: bool) -> Result<(), Failure> {
    let refuse =
        |option: &str, what: &str| Err(Failure::usage(format!("{option} has no meaning for {what}")));
    if is_file {
        let of_scenes = arguments.exact.then_some("--exact").or(arguments.scene.for_scenes_only());
        return of_scenes.map_or(Ok(()), |option| refuse(option, "a file, only for a scene"));
    }
    if arguments.index {
        return refuse("--index", "a scene, only for a file");
    }
    if arguments.filter.is_some() {
        return refuse("--filter", "a scene, which is evaluated at the points themselves");
    }
    match arguments.grid.as_deref() {
        None | Some("density") => Ok(()),
        Some(other) => Err(Failure::usage(format!("a scene has no grid {other:?}, only density"))),
    }
}

fn form(path: &Path) -> Result<Form, Failure> {
    let extension = path.extension().map(|extension| extension.to_string_lossy().to_ascii_lowercase());
    match extension.as_deref() {
        Some("csv") => Ok(Form::Csv),
        Some("npy") => Ok(Form::Npy),
        _ => Err(Failure::usage(format!("the output {} ends in neither .csv nor .npy", path.display()))),
    }
}

fn of_scene(arguments: &Arguments) -> Result<(Vec<DVec3>, Found), Failure> {
    let Compiled { scene, field, lattice, time, .. } =
        Source::read(&arguments.file, &arguments.scene)?.compile(arguments.scene.time())?;
    let budget = arguments.scene.budget().bytes();
    let program = PROGRAM.max(resident());
    let Points { list: points, count } =
        points::read(&arguments.points, budget.saturating_sub(program) / OF_SCENE)?;
    let besides = program.saturating_add(count.saturating_mul(OF_SCENE));
    let fits = || if besides > budget { Err(too_many(count, besides)) } else { Ok(()) };
    let (samples, method) = if arguments.exact {
        fits()?;
        let reference = Reference::new(&scene, Some(lattice.voxel_size));
        (Samples::by_reference(&reference, &points), "reference")
    } else {
        let plan = Plan::for_extent(&field, lattice, Extent::Whole, budget.saturating_sub(besides))
            .map_err(|error| unplanned_beside(error, besides))?;
        fits()?;
        let values = planned_density_at(&field, &plan, &points, Level::best());
        (Samples::numbers(npy::Values::F32(values)), "kernel")
    };
    let found = Found {
        samples,
        grid: "density".to_owned(),
        method,
        time: Some(time),
        voxel_size: Some(lattice.voxel_size),
        out_of_range: points.iter().filter(|point| !point.is_finite()).count(),
    };
    Ok((points, found))
}

/// Of points that take so many bytes with the program.
fn too_many(count: u64, bytes: u64) -> Failure {
    let (points, bytes_shown) = (text::number(count, "point"), text::bytes(bytes));
    Failure::failed(format!("sampling {points} takes {bytes_shown} of memory, and less may be used"))
        .hint(format!("allow more with --memory {}", enough(bytes)))
}

fn of_file(arguments: &Arguments) -> Result<(Vec<DVec3>, Found), Failure> {
    /// So many points have room in any case, so that it is known what they take of the file.
    const ALWAYS: u64 = 1 << 13;
    let name = arguments.file.display();
    let budget = arguments.scene.budget().bytes();
    let room = budget.saturating_sub(PROGRAM) / OF_FILE;
    let Points { list: points, count } = points::read(&arguments.points, room.max(ALWAYS))?;
    // Where few points are sought, they take more, each.
    let besides = |each: u64| PROGRAM.saturating_add(count.saturating_mul(each));
    let unread = |error: VdbReadError| memory::unread(&arguments.file, error, besides(OF_FILE + SOUGHT));
    let file = File::open(&arguments.file)
        .map_err(|error| Failure::input(format!("cannot read {name}")).because(error))?;
    let mut file = VdbFile::open_within(file, budget.saturating_sub(besides(OF_FILE))).map_err(unread)?;
    let Choice { number, label } = choose(file.info(), arguments.grid.as_deref(), unread)?;
    let info = file.info().grids.get(number).ok_or_else(|| Failure::input("the file holds no grid"))?;
    let indices: Vec<DVec3> = if arguments.index {
        points.clone()
    } else {
        let map = info.map.matrix.as_ref().and_then(WorldToIndex::new).ok_or_else(|| {
            let map = text::tidy(&info.map.type_name);
            Failure::input(format!("the grid's {map} has no inverse that is known here"))
                .hint("--index samples in index space")
        })?;
        points.iter().map(|point| map.index(*point)).collect()
    };
    let filter = arguments.filter.map_or(Filter::Trilinear, Filter::from);
    // Points are sought before the values are read, one by one; where they are many, to read all values takes less.
    let few = count.saturating_mul(BYTES_A_POINT) < info.bytes;
    let besides = besides(if few { OF_FILE + SOUGHT } else { OF_FILE });
    file = file.with_memory_limit(budget.saturating_sub(besides));
    let grid = if few && count == points.len() as u64 {
        file.grid_part_at(number, &Part::of_points(filter, &indices))
    } else {
        file.grid_at(number).map(PartialGrid::from)
    };
    let grid = grid.map_err(|error| memory::unread(&arguments.file, error, besides))?;
    if besides > budget {
        return Err(too_many(count, besides));
    }
    let found = Found {
        samples: Samples::of_tree(&grid.tree, filter, &indices)
            .map_err(|error| Failure::failed("cannot sample the grid").because(error))?,
        grid: label,
        method: match filter {
            Filter::Nearest => "nearest",
            Filter::Trilinear => "trilinear",
            Filter::Cubic => "cubic",
        },
        time: None,
        voxel_size: None,
        out_of_range: indices.iter().filter(|index| !volume::is_indexed(**index)).count(),
    };
    Ok((points, found))
}

/// Writes a file of values, whole or not at all.
fn write(
    path: &Path,
    form: Form,
    points: &[DVec3],
    samples: &Samples,
    interrupt: &Interrupt,
) -> Result<(), Failure> {
    save_with(path, interrupt, |mut out| match form {
        Form::Csv => samples.write_csv(points, &mut out),
        Form::Npy => npy::write(&mut out, samples.array()),
    })
}
