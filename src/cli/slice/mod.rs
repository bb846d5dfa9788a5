//! `vdbake slice`: planes of voxels as images.

mod picture;
pub(super) mod source;
mod target;

use std::path::PathBuf;

use clap::Args;
use serde::Serialize;

use super::frames::Frames;
use super::interrupt::Interrupt;
use super::job::SceneOptions;
use super::progress::Progress;
use super::{Failure, Global, info, machine, text};
use crate::volume::Slicing;
use source::{AxisName, Plane, Sliced, too_much};
use target::Target;

/// Bytes that the program takes without values and pixels: 12 MB were measured.
const PROCESS: u64 = 16 << 20;

/// Nobody means to write more slices than this.
const MOST: usize = 1 << 20;

fn metres(text: &str) -> Result<f64, String> {
    text.parse().ok().filter(|at: &f64| at.is_finite()).ok_or_else(|| "expected metres".to_owned())
}

fn white(text: &str) -> Result<f32, String> {
    let white = text.parse().ok().filter(|white: &f32| *white > 0.0 && white.is_finite());
    white.ok_or_else(|| "expected a number above 0".to_owned())
}

#[derive(Debug, Args)]
pub(super) struct Arguments {
    /// A scene, or an OpenVDB file
    #[arg(value_name = "SCENE|FILE")]
    file: PathBuf,
    /// Where to write: `NAME.####.exr` for a file of each slice, `NAME.exr` for one file with a part for each; or .png, where
    /// one file has all slices side by side
    #[arg(short, long, value_name = "OUT")]
    output: PathBuf,
    /// The axis that the slices lie across
    #[arg(long, value_enum, default_value_t = AxisName::Z)]
    axis: AxisName,
    /// Which slices, numbered from 0 at the low side: `7`, `0-63`, every fourth one of them `0-63x4`, or `all`
    #[arg(long, value_name = "RANGES", default_value = "all")]
    planes: Frames,
    /// The one slice that holds this coordinate, in metres along the axis
    #[arg(long, value_name = "METRES", value_parser = metres, conflicts_with = "planes", allow_negative_numbers = true)]
    at: Option<f64>,
    /// Put all slices side by side in one EXR image, as is always done in one .png
    #[arg(long)]
    atlas: bool,
    /// The value that a .png shows as white, with 0 as black [default: the largest there is]
    #[arg(long, value_name = "VALUE", value_parser = white, allow_negative_numbers = true)]
    white: Option<f32>,
    /// The grid to slice, with its number in brackets behind the name where several have it [default: the only one, else density]
    #[arg(long, value_name = "NAME")]
    grid: Option<String>,
    #[command(flatten)]
    scene: SceneOptions,
}

/// What was sliced, as `--json` prints it.
#[derive(Debug, Serialize)]
struct Report {
    file: String,
    grid: String,
    /// Seconds after the scene's start frame; null for files.
    time: Option<f64>,
    axis: &'static str,
    /// Slices that were written.
    slices: usize,
    /// Slices that there are.
    of: usize,
    /// Pixels of each from left to right, and from top to bottom.
    pixels: [usize; 2],
    /// Index along the axis of the first slice that was written.
    first_index: Option<i32>,
    /// Pictures in a row of an atlas.
    columns: Option<usize>,
    /// Largest and smallest value of numbers.
    range: Option<[f32; 2]>,
    outputs: Vec<String>,
    peak_rss_bytes: Option<u64>,
}

/// Slices.
pub(super) fn run(arguments: &Arguments, global: &Global) -> Result<(), Failure> {
    let is_file = info::is_vdb(&arguments.file)?;
    check(arguments, is_file)?;
    let mut target = Target::new(arguments)?;
    let interrupt = Interrupt::listen()?;
    let pool = global.pool()?;
    let report = pool.install(|| {
        let mut sliced = if is_file {
            let (axis, budget) = (arguments.axis.into(), arguments.scene.budget().bytes());
            Sliced::of_file(&arguments.file, arguments.grid.as_deref(), axis, budget)?
        } else {
            Sliced::of_scene(arguments)?
        };
        if sliced.is_empty {
            global.note(&format!("{} holds nothing: one voxel is shown", arguments.file.display()));
        }
        interrupt.hold();
        slice(arguments, &mut sliced, &mut target, &interrupt, global.quiet)
    })?;
    global.show(&report, human)
}

/// Refuses options that have no meaning for what is sliced.
fn check(arguments: &Arguments, is_file: bool) -> Result<(), Failure> {
    if is_file {
        let option = arguments.scene.for_scenes_only();
        return option.map_or(Ok(()), |option| {
            Err(Failure::usage(format!("{option} has no meaning for a file, only for a scene")))
        });
    }
    match arguments.grid.as_deref() {
        None | Some("density") => Ok(()),
        Some(other) => Err(Failure::usage(format!("a scene has no grid {other:?}, only density"))),
    }
}

fn slice(
    arguments: &Arguments,
    sliced: &mut Sliced,
    target: &mut Target,
    interrupt: &Interrupt,
    quiet: bool,
) -> Result<Report, Failure> {
    let slicing = sliced.slicing;
    let wanted = wanted(arguments, &slicing, sliced)?;
    let budget = arguments.scene.budget().bytes();
    let pixels = target.holds(&slicing, wanted.len(), sliced).saturating_add(PROCESS);
    let values = sliced.settle(&wanted, budget.saturating_sub(pixels), &arguments.file)?;
    let need = pixels.saturating_add(values);
    if need > budget {
        return Err(too_much(need));
    }
    let mut progress = Progress::new(1, quiet);
    progress.begin(wanted.len());
    let mut range: Option<[f32; 2]> = None;
    let mut rest = &wanted[..];
    target.begin(&slicing, sliced, &wanted)?;
    while let Some(&first) = rest.first() {
        let layer = slicing.layer(first);
        let (now, later) = rest.split_at(rest.iter().take_while(|plane| layer.contains(plane)).count());
        let end = now.last().map_or(first, |last| *last) + 1;
        let planes = sliced.planes(&slicing, &(first..end), &arguments.file)?;
        let chosen =
            planes.into_iter().zip(first..).filter(|(_, plane)| now.contains(plane)).collect::<Vec<_>>();
        for (plane, _) in &chosen {
            if let Plane::Numbers(values) = plane {
                range = values.iter().filter(|value| !value.is_nan()).fold(range, |range, &value| {
                    Some(range.map_or([value; 2], |[low, high]| [low.min(value), high.max(value)]))
                });
            }
        }
        target.take(chosen, interrupt)?;
        interrupt.check()?;
        progress.advance(now.len());
        rest = later;
    }
    target.finish(arguments.white.or(range.map(|[_, high]| high)), interrupt)?;
    Ok(Report {
        file: arguments.file.display().to_string(),
        grid: sliced.grid.clone(),
        time: sliced.time,
        axis: arguments.axis.name(),
        slices: wanted.len(),
        of: slicing.count(),
        pixels: slicing.pixels(),
        first_index: wanted.first().map(|plane| slicing.index(*plane)),
        columns: target.columns(),
        range,
        outputs: target.written(),
        peak_rss_bytes: machine::peak_memory(),
    })
}

/// The numbers of the planes to write, in order and none twice.
fn wanted(arguments: &Arguments, slicing: &Slicing, sliced: &Sliced) -> Result<Vec<usize>, Failure> {
    if let Some(at) = arguments.at {
        return Ok(vec![plane_at(at, arguments, slicing, sliced)?]);
    }
    let Frames::These(planes) = &arguments.planes else {
        if slicing.count() > MOST {
            return Err(Failure::failed(format!("there are {} slices", text::count(slicing.count() as u64)))
                .hint("choose some of them with --planes or --at"));
        }
        return Ok((0..slicing.count()).collect());
    };
    let beyond =
        |plane: &i64| usize::try_from(*plane).ok().filter(|plane| *plane < slicing.count()).is_none();
    if let Some(plane) = planes.iter().find(|plane| beyond(plane)) {
        return Err(Failure::usage(format!(
            "there is no slice {plane} across {}, only 0 to {}",
            arguments.axis.name(),
            slicing.count() - 1
        )));
    }
    let mut planes: Vec<usize> = planes.iter().filter_map(|plane| usize::try_from(*plane).ok()).collect();
    planes.sort_unstable();
    Ok(planes)
}

/// The plane whose cells hold a coordinate along the axis.
fn plane_at(at: f64, arguments: &Arguments, slicing: &Slicing, sliced: &Sliced) -> Result<usize, Failure> {
    let axis = slicing.axis().number();
    let name = arguments.axis.name();
    let row = sliced
        .index_to_world
        .map(|rows| rows[axis])
        .filter(|row| (0..3).all(|other| (other == axis) == (row[other] != 0.0)));
    let Some(row) = row else {
        return Err(Failure::usage(format!(
            "--at: no slice of this grid lies across the world's {name} axis"
        ))
        .hint("choose slices by their number with --planes"));
    };
    #[allow(clippy::cast_possible_truncation, reason = "saturating")]
    let index = ((at - row[3]) / row[axis]).round() as i64;
    slicing.plane(index).ok_or_else(|| {
        let ends = [0, slicing.count() - 1].map(|plane| f64::from(slicing.index(plane)) * row[axis] + row[3]);
        Failure::usage(format!(
            "there is no slice at {name} = {at} m: their centres lie from {} to {} m",
            text::short(ends[0]),
            text::short(ends[1])
        ))
    })
}

fn human(report: &Report) -> String {
    let outputs = match &report.outputs[..] {
        [] => String::new(),
        [only] => only.clone(),
        [first, .., last] => format!("{first} ... {last}"),
    };
    format!(
        "{outputs}  {} of {} of {} x {} pixels across {}",
        text::number(report.slices as u64, "slice"),
        text::count(report.of as u64),
        report.pixels[0],
        report.pixels[1],
        report.axis,
    )
}
