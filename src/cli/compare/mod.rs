//! `vdbake compare`: how a scene, a file or an image differs from another.

mod difference;
mod fields;
mod images;
mod picture;
mod tolerance;

use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

use clap::{Args, ValueEnum};

use super::interrupt::Interrupt;
use super::job::SceneOptions;
use super::sample::FilterName;
use super::{Failure, Global, info, text};
use crate::report::flip::PIXELS_PER_DEGREE;
use tolerance::MetricName;

/// Bytes that the program takes without what is compared: as many as for slices.
const PROCESS: u64 = 16 << 20;

/// The first bytes of every EXR image, and of every PNG picture.
const EXR_MAGIC: [u8; 4] = [0x76, 0x2f, 0x31, 0x01];
const PNG_MAGIC: [u8; 8] = *b"\x89PNG\r\n\x1a\n";

#[derive(Debug, Args)]
pub(super) struct Arguments {
    /// What is taken for the truth: a scene, an OpenVDB file, or an image (EXR or PNG)
    a: PathBuf,
    /// What is held against it: a scene or an OpenVDB file, or an image
    b: PathBuf,
    /// The grid of files, with its number in brackets behind the name where several have it [default: the only one, else density]
    #[arg(long, value_name = "NAME")]
    grid: Option<String>,
    /// How values between the voxels of files are found [default: trilinear]
    #[arg(long, value_enum)]
    filter: Option<FilterName>,
    /// Points in the bricks of both at which values are compared [default: 200000]
    #[arg(long, value_name = "N", value_parser = text::whole::<u32>(1, 100_000_000), allow_negative_numbers = true)]
    points: Option<u32>,
    /// Rays through the bricks along which optical depths are compared [default: 2000]
    #[arg(long, value_name = "N", value_parser = text::whole::<u32>(0, 1_000_000), allow_negative_numbers = true)]
    rays: Option<u32>,
    /// The layer of EXR images: the channels NAME.*, or the part of that name [default: all]
    #[arg(long, value_name = "NAME")]
    layer: Option<String>,
    /// Stops by which linear values are brightened for FLIP [default: 0]
    #[arg(long, value_name = "STOPS", value_parser = stops, allow_negative_numbers = true)]
    exposure: Option<f64>,
    /// Pixels for each degree that an observer sees, for FLIP [default: 67, a 4K screen 0.7 m wide seen from 0.7 m]
    #[arg(long, value_name = "N", value_parser = per_degree, allow_negative_numbers = true)]
    pixels_per_degree: Option<f64>,
    /// Where to write the difference of images: B - A itself as .exr, or a map in colours as .png
    #[arg(long, value_name = "OUT")]
    difference: Option<PathBuf>,
    /// What a .png of the difference shows [default: flip, where there are colours or luminance]
    #[arg(long, value_enum, requires = "difference")]
    map: Option<MapName>,
    /// End with exit code 4 where the metric is above this
    #[arg(long, value_name = "E", value_parser = tolerance::limit, allow_negative_numbers = true)]
    tolerance: Option<f64>,
    /// What the tolerance is for: of fields relative to A, of images as it is [default: l2]
    #[arg(long, value_enum, requires = "tolerance")]
    metric: Option<MetricName>,
    #[command(flatten)]
    scene: SceneOptions,
}

/// What a picture of a difference shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum MapName {
    /// FLIP, from 0 to 1
    Flip,
    /// The largest of the channels' differences, from 0 to the largest of all
    Absolute,
}

fn stops(text: &str) -> Result<f64, String> {
    let stops = text.parse().ok().filter(|stops: &f64| stops.abs() <= 100.0);
    stops.ok_or_else(|| "expected stops, from -100 to 100".to_owned())
}

fn per_degree(text: &str) -> Result<f64, String> {
    let count = text.parse().ok().filter(|count: &f64| (1.0..=1000.0).contains(count));
    count.ok_or_else(|| "expected a number from 1 to 1000".to_owned())
}

/// What a file is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    Scene,
    Grid,
    Exr,
    Png,
}

impl Kind {
    /// By the first bytes, else by the name.
    fn of(path: &Path) -> Result<Kind, Failure> {
        let failed = |error| Failure::unreadable(path, error);
        let mut start = Vec::new();
        File::open(path).and_then(|file| file.take(8).read_to_end(&mut start)).map_err(failed)?;
        let named =
            |name: &str| path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case(name));
        Ok(if start.starts_with(&EXR_MAGIC) {
            Kind::Exr
        } else if start.starts_with(&PNG_MAGIC) {
            Kind::Png
        } else if info::is_vdb(path)? {
            Kind::Grid
        } else if named("exr") {
            Kind::Exr
        } else if named("png") {
            Kind::Png
        } else {
            Kind::Scene
        })
    }

    fn is_image(self) -> bool {
        matches!(self, Kind::Exr | Kind::Png)
    }
}

/// Compares.
pub(super) fn run(arguments: &Arguments, global: &Global) -> Result<(), Failure> {
    let kinds = [Kind::of(&arguments.a)?, Kind::of(&arguments.b)?];
    check(arguments, kinds)?;
    let interrupt = Interrupt::listen()?;
    let pool = global.pool()?;
    if kinds[0].is_image() {
        let report = pool.install(|| images::compare(arguments, kinds, global, &interrupt))?;
        global.show(&report, images::human)?;
        report.result()
    } else {
        let report = pool.install(|| fields::compare(arguments, kinds))?;
        global.show(&report, fields::human)?;
        report.tolerance.map_or(Ok(()), |tolerance| tolerance.result())
    }
}

/// Refuses what cannot be compared, and options that have no meaning for what is.
fn check(arguments: &Arguments, kinds: [Kind; 2]) -> Result<(), Failure> {
    let refuse =
        |option: &str, what: &str| Err(Failure::usage(format!("{option} has no meaning for {what}")));
    let images = kinds[0].is_image();
    tolerance::check(arguments.metric, images)?;
    if images != kinds[1].is_image() {
        return Err(Failure::usage("an image can only be compared with an image")
            .hint("vdbake slice makes images of scenes and files"));
    }
    let given = |options: &[(bool, &'static str)]| {
        options.iter().find(|(given, _)| *given).map(|(_, option)| *option)
    };
    if images {
        let of_fields = given(&[
            (arguments.grid.is_some(), "--grid"),
            (arguments.filter.is_some(), "--filter"),
            (arguments.points.is_some(), "--points"),
            (arguments.rays.is_some(), "--rays"),
        ]);
        if let Some(option) = of_fields.or(arguments.scene.for_scenes_only()) {
            return refuse(option, "images, only for scenes and files");
        }
        if kinds == [Kind::Png; 2] && arguments.exposure.is_some() {
            return refuse("--exposure", "PNG pictures, whose values are not linear");
        }
        if kinds.contains(&Kind::Png) && arguments.layer.is_some() {
            return refuse("--layer", "PNG pictures, which have none");
        }
        return difference::check(arguments);
    }
    let of_images = given(&[
        (arguments.layer.is_some(), "--layer"),
        (arguments.exposure.is_some(), "--exposure"),
        (arguments.pixels_per_degree.is_some(), "--pixels-per-degree"),
        (arguments.difference.is_some(), "--difference"),
    ]);
    if let Some(option) = of_images {
        return refuse(option, "scenes and files, only for images");
    }
    if !kinds.contains(&Kind::Scene) {
        return arguments
            .scene
            .for_scenes_only()
            .map_or(Ok(()), |option| refuse(option, "files, only for scenes"));
    }
    if !kinds.contains(&Kind::Grid) {
        if arguments.filter.is_some() {
            return refuse("--filter", "scenes, which are evaluated at the points themselves");
        }
        if let Some(other) = arguments.grid.as_deref().filter(|name| *name != "density") {
            return Err(Failure::usage(format!("a scene has no grid {other:?}, only density")));
        }
    }
    Ok(())
}

impl Arguments {
    /// Bytes that may be taken beside the program itself.
    fn memory(&self) -> u64 {
        self.scene.budget().bytes().saturating_sub(PROCESS)
    }

    fn pixels_per_degree(&self) -> f64 {
        self.pixels_per_degree.unwrap_or(PIXELS_PER_DEGREE)
    }
}

/// Four significant digits, in a few letters.
pub(super) fn figure(x: f64) -> String {
    if x == 0.0 || (1e-3..1e6).contains(&x.abs()) { text::short(x) } else { format!("{x:.3e}") }
}

/// In words, for messages.
fn too_much(what: &str, bytes: u64) -> Failure {
    let bytes = bytes.saturating_add(PROCESS);
    Failure::failed(format!("{what} takes {} of memory, and less may be used", text::bytes(bytes)))
        .hint(format!("allow more with --memory {}", super::memory::enough(bytes)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn figures_are_short() {
        for (x, expected) in
            [(0.0, "0"), (0.012_345, "0.01235"), (-0.000_024_3, "-2.430e-5"), (1.5e9, "1.500e9")]
        {
            assert_eq!(figure(x), expected);
        }
    }
}
