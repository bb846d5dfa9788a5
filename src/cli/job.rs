//! What commands share that take a scene: the scene, the settings after defaults and overrides, and the memory they may take.

use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

use bytesize::ByteSize;
use clap::{Args, ValueEnum};

use super::recipe::{Settings, compression_name};
use super::{Failure, machine, text};
use crate::field::Field;
use crate::formats::vdb::Compression;
use crate::scene::{Scene, SceneErrors, Step};
use crate::volume::{Lattice, Plan, PlanError};

/// Files that are larger are no scenes.
const LARGEST_SCENE: u64 = 256 << 20;
/// Bytes that a brick takes in memory at most: its values, not compressed, and its place in the tree.
const BRICK: u64 = 2048 + 200;
/// Bricks whose values are held twice while they are handed on.
const IN_FLIGHT: u64 = 8192;
/// Settings of a size lie between this and its inverse.
const SMALLEST: f64 = 1e-9;

/// What a scene is compiled with.
#[derive(Debug, Args)]
pub(super) struct SceneOptions {
    /// Edge of a voxel in metres [default: what the scene says]
    #[arg(long, value_name = "H", value_parser = size, conflicts_with = "resolution")]
    voxel_size: Option<f64>,
    /// Voxels along the longest side of the density's bounds [default: what the scene says, else 256]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    resolution: Option<u32>,
    /// Seconds after the scene's start frame [default: 0]
    #[arg(long, value_name = "T", value_parser = time, allow_negative_numbers = true)]
    time: Option<f64>,
    /// Memory to work in, such as 500MB or 2GiB [default: three quarters of the machine's]
    #[arg(long, value_name = "SIZE")]
    memory: Option<ByteSize>,
}

/// What a bake is made with.
#[derive(Debug, Args)]
pub(super) struct Options {
    #[command(flatten)]
    scene: SceneOptions,
    /// How values are compressed, always without loss
    #[arg(long, value_enum, default_value_t = Codec::Blosc)]
    compression: Codec,
    /// Tell what was left out of the evaluation, and why
    #[arg(long)]
    pub(super) explain: bool,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum Codec {
    Blosc,
    Zip,
    None,
}

fn size(text: &str) -> Result<f64, String> {
    let admitted = SMALLEST..=1.0 / SMALLEST;
    let size = text.parse().ok().filter(|size| admitted.contains(size));
    size.ok_or_else(|| "expected metres, a number above 0 (1e-9 to 1e9)".to_owned())
}

fn time(text: &str) -> Result<f64, String> {
    let time = text.parse().ok().filter(|time: &f64| time.abs() <= 1.0 / SMALLEST);
    // Adding 0 makes a negative zero positive, so that the two are one setting.
    time.map(|time| time + 0.0).ok_or_else(|| "expected seconds, a number from -1e9 to 1e9".to_owned())
}

impl SceneOptions {
    /// The first of these options that only a scene has a use for, if one is given.
    pub(super) fn for_scenes_only(&self) -> Option<&'static str> {
        let given = [
            (self.voxel_size.is_some(), "--voxel-size"),
            (self.resolution.is_some(), "--resolution"),
            (self.time.is_some(), "--time"),
        ];
        given.into_iter().find(|(given, _)| *given).map(|(_, name)| name)
    }

    /// Bytes of memory to work in.
    pub(super) fn budget(&self) -> u64 {
        self.memory.map_or_else(machine::default_budget, |memory| memory.0)
    }
}

/// A scene compiled for one time and voxel size.
#[derive(Debug)]
pub(super) struct Compiled {
    pub(super) scene: Scene,
    pub(super) field: Field,
    pub(super) lattice: Lattice,
    /// Seconds.
    pub(super) time: f64,
    /// Corners of the box around the density, in metres; `None` where there is none.
    pub(super) bounds: Option<[[f64; 3]; 2]>,
}

impl Compiled {
    /// Reads the scene and settles what the options leave open.
    pub(super) fn new(path: &Path, options: &SceneOptions) -> Result<Compiled, Failure> {
        let scene = read_scene(path)?;
        let time = options.time.unwrap_or(0.0);
        let field = Field::compile(&scene, time);
        let bounds = field.bounds().map(|corners| corners.map(|corner| corner.to_array()));
        let step = match (options.voxel_size, options.resolution) {
            (Some(size), _) => Step::VoxelSize(size),
            (None, Some(resolution)) => Step::Resolution(resolution),
            (None, None) => scene.bake().step,
        };
        let lattice = Lattice { voxel_size: voxel_size(step, bounds) };
        Ok(Compiled { scene, field, lattice, time, bounds })
    }
}

/// A scene ready to be planned.
#[derive(Debug)]
pub(super) struct Job {
    pub(super) scene: Scene,
    pub(super) field: Field,
    pub(super) lattice: Lattice,
    pub(super) compression: Compression,
    pub(super) settings: Settings,
    /// Corners of the box around the density, in metres; `None` where there is none.
    pub(super) bounds: Option<[[f64; 3]; 2]>,
    /// Bytes of memory to work in.
    budget: u64,
}

impl Job {
    /// Reads the scene and settles what the options leave open.
    pub(super) fn new(path: &Path, options: &Options) -> Result<Job, Failure> {
        let Compiled { scene, field, lattice, time, bounds } = Compiled::new(path, &options.scene)?;
        let compression = match options.compression {
            Codec::Blosc => Compression::Blosc,
            Codec::Zip => Compression::Zip,
            Codec::None => Compression::None,
        };
        let settings = Settings {
            grids: ["density"],
            voxel_size: lattice.voxel_size,
            time,
            compression: compression_name(compression),
            cutoff: scene.bake().cutoff,
            octave_fade: scene.bake().octave_fade,
        };
        let budget = options.scene.budget();
        Ok(Job { scene, field, lattice, compression, settings, bounds, budget })
    }

    /// Voxels along each side of the density's bounds.
    pub(super) fn dimensions(&self) -> [u64; 3] {
        dimensions(self.bounds, self.lattice.voxel_size)
    }

    /// The candidate bricks, if baking them cannot exceed the memory.
    pub(super) fn plan(&self) -> Result<Plan, Failure> {
        let plan = match Plan::new(&self.field, self.lattice, self.budget) {
            Ok(plan) => plan,
            Err(PlanError::TooMany { bricks, .. }) => return Err(self.over_budget(bricks, "about ")),
            Err(error @ (PlanError::IndexRange { .. } | PlanError::TooWide)) => {
                return Err(Failure::failed(error.to_string()).hint("take a larger --voxel-size"));
            }
        };
        if memory(&plan) > self.budget {
            #[allow(clippy::cast_precision_loss, reason = "for show")]
            return Err(self.over_budget(plan.bricks() as f64, ""));
        }
        Ok(plan)
    }

    fn over_budget(&self, bricks: f64, about: &str) -> Failure {
        #[allow(clippy::cast_precision_loss, reason = "for show")]
        let (need, budget) = (bricks * BRICK as f64, self.budget as f64);
        let failure = Failure::failed(format!(
            "too many bricks for the memory: {about}{} bricks of 8^3 voxels take up to {}, and {} may be used",
            whole(bricks),
            amount(need),
            text::bytes(self.budget),
        ));
        match self.fitting(need / budget) {
            Some(size) => failure.hint(format!("--voxel-size {size} fits, or allow more with --memory")),
            None => failure.hint("allow more with --memory"),
        }
    }

    /// A voxel size whose plan fits the memory, tried out, when this one takes `excess` times too much.
    fn fitting(&self, mut excess: f64) -> Option<f64> {
        const TRIALS: usize = 40;
        let mut lattice = self.lattice;
        for _ in 0..TRIALS {
            // Bricks grow with the voxel's inverse cube at most, so the cube root never goes far beyond what fits.
            let larger = lattice.voxel_size * libm::cbrt(excess).max(1.02);
            lattice.voxel_size = round_up(larger);
            if !lattice.voxel_size.is_finite() {
                return None;
            }
            #[allow(clippy::cast_precision_loss, reason = "a search tried out at every step")]
            match Plan::new(&self.field, lattice, self.budget) {
                Ok(plan) if memory(&plan) <= self.budget => return Some(lattice.voxel_size),
                Ok(plan) => excess = memory(&plan) as f64 / self.budget as f64,
                Err(PlanError::TooMany { bricks, .. }) => excess = bricks * BRICK as f64 / self.budget as f64,
                Err(PlanError::IndexRange { .. } | PlanError::TooWide) => excess = 8.0,
            }
        }
        None
    }
}

/// Upper bound of the memory in bytes that a bake of this plan takes for its bricks.
pub(super) fn memory(plan: &Plan) -> u64 {
    let bricks = plan.bricks() as u64;
    plan.memory() as u64 + BRICK * (bricks + bricks.min(IN_FLIGHT))
}

/// The voxel size in metres that a step means for a density of these bounds.
pub(super) fn voxel_size(step: Step, bounds: Option<[[f64; 3]; 2]>) -> f64 {
    match step {
        Step::VoxelSize(size) => size,
        Step::Resolution(resolution) => {
            let sides = |[lo, hi]: [[f64; 3]; 2]| [0, 1, 2].map(|axis| hi[axis] - lo[axis]);
            let longest = bounds.map_or(1.0, |bounds| sides(bounds).into_iter().fold(0.0, f64::max));
            longest / f64::from(resolution)
        }
    }
}

/// Voxels along each side of a box.
pub(super) fn dimensions(bounds: Option<[[f64; 3]; 2]>, voxel_size: f64) -> [u64; 3] {
    let Some([lo, hi]) = bounds else { return [0; 3] };
    #[allow(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "whole, above 0, and saturating"
    )]
    [0, 1, 2].map(|axis| ((hi[axis] / voxel_size).ceil() - (lo[axis] / voxel_size).floor()) as u64)
}

/// Three significant digits, none of them rounded down.
fn round_up(x: f64) -> f64 {
    let exponent = libm::floor(libm::log10(x)) - 2.0;
    let digits = (x / libm::pow(10.0, exponent)).ceil();
    format!("{digits}e{exponent}").parse().unwrap_or(x)
}

/// A count for people.
fn whole(bricks: f64) -> String {
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "saturating")]
    text::count(bricks as u64)
}

/// Bytes for people; what no 64-bit number holds is as good as infinite.
fn amount(bytes: f64) -> String {
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "saturating")]
    text::bytes(bytes as u64)
}

/// Reads a scene file.
pub(super) fn read_scene(path: &Path) -> Result<Scene, Failure> {
    let origin = path.display().to_string();
    let failed = |error| Failure::input(format!("cannot read {origin}")).because(error);
    let mut bytes = Vec::new();
    File::open(path).and_then(|file| file.take(LARGEST_SCENE + 1).read_to_end(&mut bytes)).map_err(failed)?;
    if bytes.len() as u64 > LARGEST_SCENE {
        return Err(Failure::input(format!("{origin} is too large for a scene")));
    }
    if let Some(errors) = SceneErrors::not_utf8(&origin, &bytes) {
        return Err(errors.into());
    }
    Ok(Scene::parse(&String::from_utf8_lossy(&bytes), &origin)?)
}

/// Where a scene's file goes: where the user says, else under the scene's name in the current folder.
pub(super) fn output_path(given: Option<&Path>, scene: &Scene) -> PathBuf {
    given.map_or_else(|| PathBuf::from(format!("{}.vdb", scene.name())), Path::to_owned)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rounding_up_keeps_three_digits_and_never_lowers() {
        for (x, expected) in [(0.012301, 0.0124), (1.0, 1.0), (999.1, 1000.0), (2.345e-7, 2.35e-7)] {
            assert_eq!(round_up(x), expected);
        }
    }

    #[test]
    fn resolution_counts_voxels_along_the_longest_side() {
        let bounds = Some([[0.0, 0.0, -1.0], [1.0, 2.0, 3.0]]);
        assert_eq!(voxel_size(Step::Resolution(8), bounds), 0.5);
        assert_eq!(dimensions(bounds, 0.5), [2, 4, 8]);
        assert_eq!(voxel_size(Step::Resolution(8), None), 0.125);
    }

    #[test]
    fn sizes_and_times_outside_of_their_ranges_are_refused() {
        for text in ["0", "-1", "nan", "inf", "1e-10", "1e10", "x", ""] {
            assert!(size(text).is_err(), "{text}");
        }
        assert_eq!(size("1e-3"), Ok(0.001));
        assert!(time("-0").is_ok_and(f64::is_sign_positive) && time("nan").is_err() && time("1e10").is_err());
    }
}
