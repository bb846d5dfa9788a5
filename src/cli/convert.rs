//! `vdbake convert`: from one format of volumes to another.

use std::io::BufWriter;
use std::path::{Path, PathBuf};

use clap::Args;
use serde::Serialize;

use super::interrupt::{Interrupt, Watched};
use super::memory::{Amount, enough};
use super::output::Output;
use super::progress::Progress;
use super::slice::source::{Plane, Sliced};
use super::{Failure, Global, disk, info, machine, text};
use crate::formats::vol::{VolError, VolHeader, VolWriter};
use crate::volume::{Axis, Slicing};

/// Bytes that the program takes without values: 12 MB were measured.
const PROCESS: u64 = 16 << 20;
/// Bytes for each number of a plane: as it is stored and as it is written, for the planes of a layer of leaves, and once more
/// in the order that it is written in.
const NUMBER: u64 = 8 * (8 + 4) + 4;

/// What can be converted.
const KNOWN: &str = "this version converts .vdb to .vol";

#[derive(Debug, Args)]
pub(super) struct Arguments {
    /// An OpenVDB file
    #[arg(value_name = "IN")]
    input: PathBuf,
    /// Where to write; the ending says what: `.vol`, which Mitsuba reads
    #[arg(value_name = "OUT")]
    output: PathBuf,
    /// The grid to convert, with its number in brackets behind the name where several have it [default: the only one, else density]
    #[arg(long, value_name = "NAME")]
    grid: Option<String>,
    /// Memory to work in, such as 500MB or 2GiB [default: three quarters of the machine's]
    #[arg(long, value_name = "SIZE", allow_negative_numbers = true)]
    memory: Option<Amount>,
}

/// What was converted, as `--json` prints it.
#[derive(Debug, Serialize)]
struct Report {
    output: String,
    grid: String,
    /// Cells along x, y and z: the voxels of the active ones' box, and one more on each side.
    size: [usize; 3],
    channels: usize,
    /// Corners of the box of all cells, in metres.
    bounds: [[f64; 3]; 2],
    bytes: u64,
    /// Smallest and largest number.
    range: Option<[f32; 2]>,
}

/// Converts.
pub(super) fn run(arguments: &Arguments, global: &Global) -> Result<(), Failure> {
    let Arguments { input, output, grid, .. } = arguments;
    if !has_ending(output, "vol") {
        let message = format!("cannot convert to {}: its name does not end in .vol", output.display());
        return Err(Failure::usage(message).hint(KNOWN));
    }
    if !info::is_vdb(input)? {
        let failure = if has_ending(input, "toml") {
            Failure::usage(format!("{} is a scene, which is to be baked first", input.display()))
        } else {
            Failure::usage(format!("cannot convert from {}: it is no OpenVDB file", input.display()))
        };
        return Err(failure.hint(KNOWN));
    }
    let interrupt = Interrupt::listen()?;
    let pool = global.pool()?;
    let budget = Amount::settle(arguments.memory).bytes();
    Output::check(output)?;
    let report = pool.install(|| {
        let mut grid = Sliced::of_file(input, grid.as_deref(), Axis::Z, budget)?;
        if grid.is_empty {
            global.note(&format!("{} holds nothing: the .vol file holds zeros", input.display()));
        }
        let slicing = with_border(&grid)?;
        let header = header(&grid, &slicing)?;
        let numbers = PROCESS.saturating_add((header.plane() as u64).saturating_mul(NUMBER));
        let planes: Vec<usize> = (0..grid.slicing.count()).collect();
        let values = grid.settle(&planes, budget.saturating_sub(numbers), input)?;
        let need = numbers.saturating_add(values);
        if need > budget {
            return Err(too_large(&header, need));
        }
        write(arguments, &mut grid, &slicing, header, &interrupt, global.quiet)
    })?;
    global.show(&report, human)
}

fn has_ending(path: &Path, ending: &str) -> bool {
    path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case(ending))
}

/// The grid's planes, and one more voxel on each side: Mitsuba lets the outermost values go on to the box's faces, and from
/// there ends them at once.
fn with_border(grid: &Sliced) -> Result<Slicing, Failure> {
    let beyond = || Failure::failed(format!("the grid {} reaches to the end of all indices", grid.grid));
    let [width, height] = grid.slicing.pixels();
    let first = grid.slicing.voxel(0, [0, height - 1]);
    let last = grid.slicing.voxel(grid.slicing.count() - 1, [width - 1, 0]);
    let grown = |index: [i32; 3], by: i32| -> Option<[i32; 3]> {
        let [x, y, z] = index.map(|i| i.checked_add(by));
        Some([x?, y?, z?])
    };
    let ends = grown(first, -1).zip(grown(last, 1)).ok_or_else(beyond)?;
    Slicing::new(Axis::Z, ends.into()).ok_or_else(beyond)
}

/// What the file says of the values; refuses grids that no box holds along the axes.
fn header(grid: &Sliced, slicing: &Slicing) -> Result<VolHeader, Failure> {
    let refused = |what: &str| {
        Failure::failed(format!("the grid {} cannot be a .vol file: {what}", text::tidy(&grid.grid)))
            .hint("a .vol file holds a box of cells along the axes of the world: resample the grid to such a lattice first")
    };
    let Some(rows) = grid.index_to_world else { return Err(refused("its map is not affine")) };
    let is_straight = |row: usize| (0..3).all(|column| (row == column) || rows[row][column] == 0.0);
    if !(0..3).all(is_straight) {
        return Err(refused("its lattice is turned or sheared"));
    }
    if !(0..3).all(|row| rows[row][row] > 0.0) {
        return Err(refused("its lattice is mirrored, or has no volume"));
    }
    let [width, height] = slicing.pixels();
    let first = slicing.voxel(0, [0, height - 1]);
    let size = [width, height, slicing.count()];
    // Cells around voxels, whose centres are at whole indices.
    let face = |axis: usize, cells: usize| {
        #[allow(clippy::cast_precision_loss, reason = "fewer than 2^53")]
        let index = f64::from(first[axis]) + cells as f64 - 0.5;
        index * rows[axis][axis] + rows[axis][3]
    };
    let bounds = [[0; 3], size].map(|cells| [0, 1, 2].map(|axis| face(axis, cells[axis])));
    Ok(VolHeader { size, channels: if grid.is_vector { 3 } else { 1 }, bounds })
}

fn too_large(header: &VolHeader, need: u64) -> Failure {
    let [x, y, z] = header.size.map(|side| text::count(side as u64));
    Failure::failed(format!(
        "the box of {x} x {y} x {z} cells takes {} of memory plane by plane, and less may be used",
        text::bytes(need)
    ))
    .hint(format!("allow more with --memory {}, or bake with a larger --voxel-size", enough(need)))
}

fn write(
    arguments: &Arguments,
    grid: &mut Sliced,
    slicing: &Slicing,
    header: VolHeader,
    interrupt: &Interrupt,
    quiet: bool,
) -> Result<Report, Failure> {
    let path = &arguments.output;
    let output = Output::create(path, interrupt)?;
    let bytes = header.bytes();
    if let Some(free) = machine::free_space(output.folder()).filter(|free| *free < bytes) {
        let room = format!("{} free in {}", text::bytes(free), output.folder().display());
        let message =
            format!("too little room on the disk: the file takes {}, and {room}", text::bytes(bytes));
        return Err(Failure::failed(message)
            .hint("a .vol file holds every cell of its box: bake with a larger --voxel-size"));
    }
    let failed = |error: VolError| match error {
        VolError::Io(error) => disk::unwritten(path, error),
        error => Failure::failed(format!("cannot write {}", path.display())).because(error),
    };
    // A signal ends the writing, and is what there is to tell then.
    let stopped = |error: VolError| interrupt.check().err().unwrap_or_else(|| failed(error));
    let mut progress = Progress::new(1, quiet);
    progress.begin(slicing.count());
    let out = BufWriter::new(Watched { inner: output.file(), interrupt });
    let mut writer = VolWriter::new(out, header).map_err(stopped)?;
    let mut range: Option<[f32; 2]> = None;
    let (mut next, mut values) = (0, Vec::with_capacity(header.plane()));
    while next < slicing.count() {
        let layer = slicing.layer(next);
        for plane in grid.planes(slicing, &layer, &arguments.input)? {
            upwards(&plane, header.size[0], &mut values);
            range = values.iter().filter(|value| !value.is_nan()).fold(range, |range, &value| {
                Some(range.map_or([value; 2], |[low, high]| [low.min(value), high.max(value)]))
            });
            writer.plane(&values).map_err(stopped)?;
        }
        interrupt.check()?;
        progress.advance(layer.len());
        next = layer.end;
    }
    writer.finish().map_err(stopped)?;
    let failed = |error| disk::unwritten(path, error);
    output.sync().map_err(failed)?;
    interrupt.check()?;
    output.publish().map_err(failed)?;
    let VolHeader { size, channels, bounds } = header;
    let output = path.display().to_string();
    Ok(Report { output, grid: grid.grid.clone(), size, channels, bounds, bytes, range })
}

/// A plane's rows from the lowest up, channels next to each other.
fn upwards(plane: &Plane, width: usize, values: &mut Vec<f32>) {
    values.clear();
    match plane {
        Plane::Numbers(numbers) => {
            for row in numbers.chunks_exact(width).rev() {
                values.extend_from_slice(row);
            }
        }
        Plane::Vectors([x, y, z]) => {
            let rows = x.chunks_exact(width).zip(y.chunks_exact(width)).zip(z.chunks_exact(width));
            for ((x, y), z) in rows.rev() {
                values.extend(x.iter().zip(y).zip(z).flat_map(|((x, y), z)| [*x, *y, *z]));
            }
        }
    }
}

fn human(report: &Report) -> String {
    let [x, y, z] = report.size.map(|side| text::count(side as u64));
    let vectors = if report.channels > 1 { " of vectors" } else { "" };
    format!("{}  {x} x {y} x {z} cells{vectors}, {}", report.output, text::bytes(report.bytes))
}
