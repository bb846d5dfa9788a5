//! What commands share that take a scene: the scene, the settings after defaults and overrides, and the memory they may take.

use std::borrow::Cow;
use std::fs::File;
use std::io::{self, Read};
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use clap::{Args, ValueEnum};
use serde::Serialize;

use super::frames::Frames;
use super::memory::{self, Amount, Need};
use super::recipe::{Recipe, Settings, antialias_name, compression_name, precision_name};
use super::{Failure, machine, text};
use crate::field::{self, Field};
use crate::formats::vdb::{
    self, Compression, Encoder, FileHeader, GridBound, GridClass, GridHeader, Precision, VdbGridBuilder,
    VectorType,
};
use crate::scene::limit::{ANY, POSITIVE};
use crate::scene::{MOST_INPUT, Scene, SceneErrors, Step, Tube};
use crate::volume::{Lattice, Plan, PlanError};

/// The first bytes of every VDB file.
pub(super) const VDB_MAGIC: [u8; 8] = *b" BDV\0\0\0\0";
/// Files that are larger are no scenes.
const LARGEST_SCENE: u64 = 256 << 20;
/// A brick is reached by about so many pieces of axes.
const CONTACTS: f64 = 4.0;
/// Bytes beside the plan and the leaves' places with which a bake of any size can do.
const LEAST: u64 = 16 << 20;

/// What a scene is compiled with.
#[derive(Debug, Args)]
pub(super) struct SceneOptions {
    /// Edge of a voxel in metres [default: what the scene says]
    #[arg(long, value_name = "H", value_parser = size, conflicts_with = "resolution", allow_negative_numbers = true)]
    voxel_size: Option<f64>,
    /// Voxels along the longest side of the density's bounds over the scene's own frames, from its start to its end (or at
    /// its start frame, where it has no end): the voxel size is the same at every time [default: what the scene says, else 256]
    #[arg(long, value_name = "N", value_parser = text::whole::<u32>(1, 1_000_000),
        allow_negative_numbers = true)]
    resolution: Option<u32>,
    /// Seconds after the scene's start frame [default: 0]
    #[arg(long, value_name = "T", value_parser = time, allow_negative_numbers = true)]
    time: Option<f64>,
    /// Memory to work in, such as 500MB or 2GiB: a bake that needs more keeps values in a temporary file beside the output, other
    /// commands refuse what needs more [default: three quarters of the machine's]
    #[arg(long, value_name = "SIZE", allow_negative_numbers = true)]
    memory: Option<Amount>,
}

/// What a bake is made with.
#[derive(Debug, Args)]
pub(super) struct Options {
    #[command(flatten)]
    pub(super) scene: SceneOptions,
    /// Frames instead of one time, each with a file of its own, in this order: `1-240`, every second one of them `1-240x2`,
    /// `1,5,9-12`, or `all` of the scene's own
    #[arg(long, value_name = "RANGES", conflicts_with = "time", allow_hyphen_values = true)]
    frames: Option<Frames>,
    /// How precisely values are stored: single or half precision, as 32-bit or 16-bit floats [default: f32]
    #[arg(long, value_enum)]
    precision: Option<Width>,
    /// How values are compressed, always without loss [default: blosc]
    #[arg(long, value_enum)]
    compression: Option<Codec>,
    /// Tell what was left out of the evaluation, and why
    #[arg(long)]
    pub(super) explain: bool,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum Width {
    F32,
    F16,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum Codec {
    Blosc,
    Zip,
    None,
}

fn size(text: &str) -> Result<f64, String> {
    let size = text.parse().ok().filter(|size| POSITIVE.admits(*size));
    size.ok_or_else(|| format!("expected metres, {}", POSITIVE.range))
}

pub(super) fn time(text: &str) -> Result<f64, String> {
    let time = text.parse().ok().filter(|time| ANY.admits(*time));
    // Adding 0 makes a negative zero positive, so that the two are one setting.
    time.map(|time: f64| time + 0.0).ok_or_else(|| format!("expected seconds, {}", ANY.range))
}

impl SceneOptions {
    /// Seconds after the start frame.
    pub(super) fn time(&self) -> f64 {
        self.time.unwrap_or(0.0)
    }

    /// The first of these options that only a scene has a use for, if one is given.
    pub(super) fn for_scenes_only(&self) -> Option<&'static str> {
        let given = [
            (self.voxel_size.is_some(), "--voxel-size"),
            (self.resolution.is_some(), "--resolution"),
            (self.time.is_some(), "--time"),
        ];
        given.into_iter().find(|(given, _)| *given).map(|(_, name)| name)
    }

    /// Bytes that this process is let have by the user, or the system.
    pub(super) fn limit(&self) -> Option<u64> {
        self.memory.map(Amount::bytes).into_iter().chain(machine::process_limit()).min()
    }

    /// Memory to work in.
    pub(super) fn budget(&self) -> Amount {
        Amount::settle(self.memory)
    }
}

impl Options {
    /// The first of these options, if one is given: each is for scenes.
    pub(super) fn for_scenes_only(&self) -> Option<&'static str> {
        let given = [
            (self.scene.memory.is_some(), "--memory"),
            (self.frames.is_some(), "--frames"),
            (self.precision.is_some(), "--precision"),
            (self.compression.is_some(), "--compression"),
            (self.explain, "--explain"),
        ];
        let own = given.into_iter().find(|(given, _)| *given).map(|(_, name)| name);
        self.scene.for_scenes_only().or(own)
    }

    /// Whether frames are asked for.
    pub(super) fn is_sequence(&self) -> bool {
        self.frames.is_some()
    }

    /// How values are stored.
    pub(super) fn stored(&self) -> Precision {
        match self.precision.unwrap_or(Width::F32) {
            Width::F32 => Precision::F32,
            Width::F16 => Precision::F16,
        }
    }

    /// The moments of a scene that are asked for: its frames, or one time.
    pub(super) fn moments(&self, source: &Source) -> Result<Vec<Moment>, Failure> {
        let time = source.start.time();
        match &self.frames {
            None => Ok(vec![Moment { time: self.scene.time(), frame: None }]),
            Some(frames) => {
                let moment = |frame| Moment { time: time.seconds(frame), frame: Some(frame) };
                Ok(frames.of(time)?.into_iter().map(moment).collect())
            }
        }
    }
}

/// A time of a scene.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Moment {
    /// Seconds after the start frame.
    pub(super) time: f64,
    /// The frame of a sequence that it is.
    pub(super) frame: Option<i64>,
}

/// A scene file, and the lattice that it has at every time.
#[derive(Debug)]
pub(super) struct Source {
    /// At its start frame.
    pub(super) start: Scene,
    /// Its field, for no lattice.
    field: Field,
    lattice: Lattice,
    /// Bytes that the process took at most until the first job was compiled.
    resident: OnceLock<u64>,
    /// Whether the voxel size was found by a search, and is not the user's.
    searched: bool,
}

impl Source {
    /// Reads the scene, and settles the voxel size.
    pub(super) fn read(path: &Path, options: &SceneOptions) -> Result<Source, Failure> {
        let start = read_scene(path)?;
        has_room(&start, options.budget())?;
        let step = match (options.voxel_size, options.resolution) {
            (Some(size), _) => Step::VoxelSize(size),
            (None, Some(resolution)) => Step::Resolution(resolution),
            (None, None) => start.bake().step,
        };
        let field = Field::compile(&start);
        let lattice = Lattice { voxel_size: voxel_size(step, &start, &field)? };
        Ok(Source { start, field, lattice, resident: OnceLock::new(), searched: false })
    }

    /// Metres.
    pub(super) fn voxel_size(&self) -> f64 {
        self.lattice.voxel_size
    }

    /// Takes what the process took so far for what it takes without bricks, whatever searches take and give back.
    pub(super) fn settle_resident(&self) {
        self.resident.get_or_init(memory::resident);
    }

    /// Settles another voxel size, in metres.
    pub(super) fn set_voxel_size(&mut self, voxel_size: f64) {
        self.lattice = Lattice { voxel_size };
        self.searched = true;
    }

    /// Compiles the scene for a time.
    pub(super) fn compile(&self, time: f64) -> Result<Compiled, Failure> {
        let scene = self.start.at(time)?;
        let mut field =
            if time == self.start.seconds() { self.field.clone() } else { Field::compile(&scene) };
        let bounds = bounds(&field);
        field.widen(self.lattice);
        Ok(Compiled { scene, field, lattice: self.lattice, time, bounds })
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

/// A scene ready to be planned.
#[derive(Debug)]
pub(super) struct Job {
    pub(super) scene: Scene,
    pub(super) field: Field,
    pub(super) lattice: Lattice,
    pub(super) encoder: Encoder,
    pub(super) settings: Settings,
    /// Corners of the box around the density, in metres; `None` where there is none.
    pub(super) bounds: Option<[[f64; 3]; 2]>,
    /// Memory to work in.
    budget: Amount,
    /// Bytes that the process took at most until the scene was compiled.
    resident: u64,
    /// Whether the voxel size was found by a search, and is not the user's.
    searched: bool,
}

impl Job {
    /// Compiles the scene for a moment, and settles what the options leave open.
    pub(super) fn new(source: &Source, moment: Moment, options: &Options) -> Result<Job, Failure> {
        let Compiled { scene, field, lattice, time, bounds } = source.compile(moment.time)?;
        let compression = match options.compression.unwrap_or(Codec::Blosc) {
            Codec::Blosc => Compression::Blosc,
            Codec::Zip => Compression::Zip,
            Codec::None => Compression::None,
        };
        let precision = options.stored();
        let encoder = Encoder::new(compression).with_precision(precision);
        let settings = Settings {
            grids: ["density"],
            voxel_size: lattice.voxel_size,
            time,
            frame: moment.frame,
            precision: precision_name(precision),
            compression: compression_name(compression),
            cutoff: scene.bake().cutoff,
            octave_fade: scene.bake().octave_fade,
            widen: scene.bake().widen,
            antialias: antialias_name(scene.bake().antialias),
        };
        let budget = options.scene.budget();
        // What earlier frames took is given back, and must not count for this one.
        let mut resident = *source.resident.get_or_init(memory::resident);
        if moment.frame.is_some() {
            // Other frames leave gaps as large as what they were compiled to.
            resident += Field::estimate_memory(&scene) as u64;
        }
        let searched = source.searched;
        Ok(Job { scene, field, lattice, encoder, settings, bounds, budget, resident, searched })
    }

    /// Voxels along each side of the density's bounds.
    pub(super) fn dimensions(&self) -> [u64; 3] {
        dimensions(self.bounds, self.lattice.voxel_size)
    }

    /// The candidate bricks, if baking them on the current `rayon` pool cannot exceed the memory.
    pub(super) fn plan(&self) -> Result<Plan, Failure> {
        self.plan_for(|| 0)
    }

    /// The same for what takes so many bytes besides a bake, which are told where there are too few for the bake.
    pub(super) fn plan_for(&self, other: impl Fn() -> u64) -> Result<Plan, Failure> {
        match self.try_plan(self.lattice) {
            Ok(plan) => Ok(plan),
            Err(Misfit::Memory { bricks, need, enough }) => {
                Err(self.over_budget(bricks, need, enough.max(other())))
            }
            Err(Misfit::Range(error)) => Err(self.out_of_range(error)),
        }
    }

    /// What baking a plan on the current `rayon` pool takes of the memory.
    pub(super) fn need(&self, plan: &Plan, bound: &GridBound) -> Need {
        Need::new(plan, bound, self.encoder, self.process())
    }

    /// How large the plan's grid can get.
    pub(super) fn bound(&self, plan: &Plan) -> GridBound {
        GridBound::new::<f32>(self.encoder, plan.origins())
    }

    /// Bytes that the process took at most until the scene was compiled.
    pub(super) fn resident(&self) -> u64 {
        self.resident
    }

    /// Bytes that the process has now beyond those: what a search took, and the allocator keeps for what comes, though not all
    /// of that may find room in it.
    pub(super) fn kept(&self) -> u64 {
        machine::memory().unwrap_or(0).saturating_sub(self.resident)
    }

    /// Bytes to work in.
    pub(super) fn budget(&self) -> u64 {
        self.budget.bytes()
    }

    /// The part of the memory that does not depend on the plan.
    pub(super) fn process(&self) -> u64 {
        memory::process(self.resident, self.scene.text().len())
    }

    /// The field as a lattice has it.
    fn widened(&self, lattice: Lattice) -> Cow<'_, Field> {
        let mut field = Cow::Borrowed(&self.field);
        if lattice != self.lattice {
            field.to_mut().widen(lattice);
        }
        field
    }

    /// The plan at a lattice, or why there is none.
    fn try_plan(&self, lattice: Lattice) -> Result<Plan, Misfit> {
        let process = self.process();
        match Plan::new(&self.widened(lattice), lattice, self.budget().saturating_sub(process)) {
            Ok(plan) => {
                let least = self.need(&plan, &self.bound(&plan)).least();
                #[allow(clippy::cast_precision_loss, reason = "a search tried out at every step")]
                let misfit =
                    Misfit::Memory { bricks: Some(plan.bricks() as u64), need: least as f64, enough: least };
                if least <= self.budget() { Ok(plan) } else { Err(misfit) }
            }
            #[allow(clippy::cast_precision_loss, reason = "as above")]
            #[allow(
                clippy::cast_possible_truncation,
                clippy::cast_sign_loss,
                reason = "bytes, and saturating"
            )]
            Err(error @ PlanError::TooMany { bricks, enough }) => Err(Misfit::Memory {
                bricks: None,
                need: process as f64 + bricks / CONTACTS * memory::BRICK as f64,
                enough: match enough {
                    Some(enough) => Need::enough(bricks as u64, enough, self.encoder, process),
                    // Planned, and then baked: no brick counts less than once.
                    None => (process + LEAST)
                        .saturating_add(error.enough().unwrap_or(0))
                        .saturating_add((bricks * memory::BRICK as f64) as u64),
                },
            }),
            Err(error @ (PlanError::IndexRange { .. } | PlanError::TooWide)) => Err(Misfit::Range(error)),
        }
    }

    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "bytes, and saturating")]
    fn over_budget(&self, bricks: Option<u64>, need: f64, enough: u64) -> Failure {
        #[allow(clippy::cast_precision_loss, reason = "for show")]
        let budget = self.budget.show(self.budget.bytes() as f64);
        let failure = Failure::failed(match bricks {
            Some(bricks) => format!(
                "too many bricks for the memory: a bake of {} of 8^3 voxels takes up to {} even with all values on disk, and {budget} may be used",
                text::number(bricks, "brick"),
                memory::enough(need as u64),
            ),
            None => format!(
                "too many bricks for the memory: to plan them takes more than the {budget} that may be used"
            ),
        });
        // Other voxels would be no answer to what they were searched for.
        if self.searched {
            // What the search takes is not the same in every run, and before bricks are found their number is known within a
            // factor of a few only.
            let enough = memory::enough(enough.saturating_add(enough / 8).max(SEARCH));
            return failure.hint(format!(
                "allow more with --memory {enough} or so, or ask for a larger --max-error or a smaller --max-bytes"
            ));
        }
        let more = format!("allow more with --memory {}", memory::enough(enough));
        match self.fitting(self.coarser(self.lattice.voxel_size, need)) {
            Some(size) => failure.hint(format!("--voxel-size {size} fits, or {more}")),
            None => failure.hint(format!("no voxel size fits that leaves any of the density: {more}")),
        }
    }

    fn out_of_range(&self, error: PlanError) -> Failure {
        let failure = Failure::failed(error.to_string());
        match self.bounds.and_then(|bounds| self.fitting(Some(smallest_in_range(bounds)))) {
            Some(size) => failure.hint(format!("--voxel-size {size} fits")),
            None => failure.hint(
                "no voxel size fits that leaves any of the density: move the scene nearer to the origin, or divide it",
            ),
        }
    }

    /// A voxel size from `first` upwards that can be baked and leaves some of the density, tried out.
    ///
    /// Where there are too many bricks to try them out in no time, a size is taken that fits for certain.
    fn fitting(&self, first: Option<f64>) -> Option<f64> {
        const TRIALS: usize = 40;
        /// More bricks are not tried out.
        const MANY: f64 = 2e5;
        /// As many bricks as there are estimated to be, times this, there are never.
        const CERTAIN: f64 = 2.0;
        /// Where a size may fit, but not for certain, the next is this many times as large.
        const FINER: f64 = 1.1;
        let [lo, hi] = self.bounds?;
        let longest = [0, 1, 2].map(|axis| hi[axis] - lo[axis]).into_iter().fold(0.0, f64::max);
        let mut next = first;
        for _ in 0..TRIALS {
            // Larger voxels than the whole show nothing of it.
            let voxel_size = round_up(next?);
            if voxel_size > longest || !POSITIVE.admits(voxel_size) {
                return None;
            }
            let lattice = Lattice { voxel_size };
            let bricks = self.widened(lattice).estimate_blocks(lattice);
            if bricks > MANY {
                #[allow(clippy::cast_precision_loss, reason = "an estimate")]
                let [process, least, budget, brick, contact] =
                    [self.process(), LEAST, self.budget(), memory::BRICK, Plan::CONTACT as u64]
                        .map(|n| n as f64);
                if process + least + CERTAIN * bricks * (brick + CONTACTS * contact) <= budget {
                    return Some(voxel_size);
                }
                let likely = process + bricks / CONTACTS * brick;
                next =
                    if likely > budget { self.coarser(voxel_size, likely) } else { Some(FINER * voxel_size) };
                continue;
            }
            next = match self.try_plan(lattice) {
                Ok(plan) => return (plan.bricks() > 0).then_some(voxel_size),
                Err(Misfit::Memory { need, .. }) => self.coarser(voxel_size, need),
                Err(Misfit::Range(_)) => Some(2.0 * voxel_size),
            };
        }
        None
    }

    /// A voxel size that may fit the memory where `voxel_size` needs so many bytes.
    fn coarser(&self, voxel_size: f64, need: f64) -> Option<f64> {
        let fixed = self.process() + VdbGridBuilder::<f32>::LEAST_MEMORY;
        let left = self.budget.bytes().checked_sub(fixed).filter(|&left| left > 0)?;
        // Bricks grow with the voxel's inverse cube at most, so the cube root never goes far beyond what fits.
        #[allow(clippy::cast_precision_loss, reason = "a search tried out at every step")]
        Some(voxel_size * libm::cbrt((need - fixed as f64) / left as f64).max(1.04))
    }

    /// The file around the grid. `content` is the hash of all values, in hexadecimal.
    pub(super) fn file_header(&self, content: &str) -> Result<FileHeader, Failure> {
        let recipe = Recipe::new(self.scene.text(), self.scene.inputs(), &self.settings)
            .map_err(|error| Failure::failed("cannot describe the settings").because(error))?;
        Ok(FileHeader { uuid: recipe.uuid(), metadata: recipe.metadata(content) })
    }

    /// Bytes of the file if no voxel were active. All of it that depends on the density has a fixed length.
    pub(super) fn empty_file(&self) -> Result<u64, Failure> {
        let header = self.file_header(&"0".repeat(64))?;
        let grid = VdbGridBuilder::<f32>::with_encoder(self.encoder);
        vdb::write(io::sink(), &header, &[(&self.grid_header(), &grid)])
            .map_err(|error| Failure::failed("cannot measure the file").because(error))
    }

    /// The grid's name and place.
    pub(super) fn grid_header(&self) -> GridHeader {
        let voxel_size = self.lattice.voxel_size;
        GridHeader {
            name: "density".to_owned(),
            class: GridClass::FogVolume,
            vector_type: VectorType::Invariant,
            voxel_size,
            // Voxel i is the cell from i h to (i + 1) h, and the file places its centre.
            translation: [0.5 * voxel_size; 3],
            metadata: vdb::Metadata::new(),
        }
    }
}

/// Bytes that searches for a voxel size and small bakes can do with.
pub(super) const SEARCH: u64 = 32 << 20;

/// Why a voxel size cannot be baked.
#[derive(Debug)]
enum Misfit {
    /// The process with so many bricks needs more bytes than it may use. Where even the plan does, the bricks are not
    /// known, and the bytes are a guess; but so many are enough.
    Memory { bricks: Option<u64>, need: f64, enough: u64 },
    /// Beyond what voxels can be numbered.
    Range(PlanError),
}

/// About the smallest voxel size in metres at which bounds can be planned: 2^31 voxels to either side of the origin, and
/// 2^24 from end to end, each less a margin of two nodes of 4096 voxels.
fn smallest_in_range([lo, hi]: [[f64; 3]; 2]) -> f64 {
    let largest = |of: fn(f64, f64) -> f64| (0..3).map(|axis| of(lo[axis], hi[axis])).fold(0.0, f64::max);
    let farthest = largest(|lo, hi| lo.abs().max(hi.abs())) / f64::from(i32::MAX - 8192);
    let widest = largest(|lo, hi| hi - lo) / f64::from((1 << 24) - 8192);
    farthest.max(widest)
}

/// The voxel size in metres that a step means for a scene, of which this is the field, whatever its time.
pub(super) fn voxel_size(step: Step, scene: &Scene, field: &Field) -> Result<f64, SceneErrors> {
    Ok(match step {
        Step::VoxelSize(size) => size,
        Step::Resolution(resolution) => {
            let longest = field::extent_around(scene, field)?.map_or(1.0, |[lo, hi]| (hi - lo).max_element());
            longest / f64::from(resolution)
        }
    })
}

/// Corners of the box around the density, in metres; `None` where there is none.
pub(super) fn bounds(field: &Field) -> Option<[[f64; 3]; 2]> {
    field.bounds().map(|corners| corners.map(|corner| corner.to_array()))
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

/// Refuses scenes whose tubes alone, compiled, take more memory than there may be.
pub(super) fn has_room(scene: &Scene, budget: Amount) -> Result<(), Failure> {
    /// Times that the curves are held: at the start frame, and at the time that is asked for, with what is made of them.
    const HELD: u64 = 2;
    let need = HELD * Field::estimate_memory(scene) as u64;
    // Where not even the program has room, that is told of what is to be done.
    if need <= budget.bytes().max(memory::PROGRAM) {
        return Ok(());
    }
    let segments: usize = scene.tubes().iter().map(|tube| tube.curve.segments().len()).sum();
    #[allow(clippy::cast_precision_loss, reason = "for show")]
    let [need_shown, budget_shown] = [need, budget.bytes()].map(|bytes| budget.show(bytes as f64));
    let failure = Failure::failed(format!(
        "too long for the memory: the curves' {} take about {need_shown}, and {budget_shown} may be used",
        text::number(segments as u64, "segment"),
    ));
    let enough = memory::enough(need.saturating_mul(2).saturating_add(memory::PROGRAM));
    Err(failure.hint(format!("allow more with --memory {enough}, or give the curves fewer points")))
}

/// Reads a scene file.
pub(super) fn read_scene(path: &Path) -> Result<Scene, Failure> {
    let origin = path.display().to_string();
    let failed = |error| Failure::unreadable(path, error);
    let mut bytes = Vec::new();
    File::open(path).and_then(|file| file.take(LARGEST_SCENE + 1).read_to_end(&mut bytes)).map_err(failed)?;
    if bytes.len() as u64 > LARGEST_SCENE {
        return Err(Failure::input(format!("{origin} is too large for a scene")));
    }
    if bytes.starts_with(&VDB_MAGIC) {
        return Err(Failure::input(format!("{origin} is a VDB file, not a scene")));
    }
    if let Some(errors) = SceneErrors::not_utf8(&origin, &bytes) {
        return Err(errors.into());
    }
    // The user's own text may name any file.
    let folder = path.parent().unwrap_or(Path::new(""));
    let load = |file: &str| read_input(&folder.join(file));
    let scene = Scene::load(&String::from_utf8_lossy(&bytes), &origin, &load)?;
    has_room(&scene, Amount::installed())?;
    Ok(scene)
}

/// An estimate for a radius that is read from a file.
#[derive(Debug, Serialize)]
pub(super) struct SamplingError {
    tube: String,
    /// Metres that the radius may be off between its samples.
    radius: f64,
}

impl SamplingError {
    /// In words, where there are any.
    pub(super) fn show(errors: &[SamplingError], table: &mut text::Table) {
        let words = |SamplingError { tube, radius }: &SamplingError| {
            format!(
                "radius of tube \"{}\": about {} m between its samples",
                text::tidy(tube),
                text::short(*radius)
            )
        };
        if !errors.is_empty() {
            table.rows("estimated error", &errors.iter().map(words).collect::<Vec<_>>(), "");
        }
    }
}

/// Those of a scene.
pub(super) fn sampling_errors(scene: &Scene) -> Vec<SamplingError> {
    let of = |tube: &Tube| Some(SamplingError { tube: tube.name.clone(), radius: tube.sampling_error? });
    scene.tubes().iter().filter_map(of).collect()
}

/// Reads a file that a scene names.
pub(super) fn read_input(path: &Path) -> io::Result<Vec<u8>> {
    // Devices and the like have no end, and a pipe may never begin.
    if !std::fs::metadata(path)?.is_file() {
        return Err(io::Error::other("it is no file"));
    }
    let file = File::open(path)?;
    let mut bytes = Vec::new();
    file.take(MOST_INPUT + 1).read_to_end(&mut bytes)?;
    Ok(bytes)
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
        assert_eq!(dimensions(bounds, 0.5), [2, 4, 8]);
        let size = |text| {
            let scene = Scene::parse(text, "").expect("valid");
            voxel_size(Step::Resolution(8), &scene, &Field::compile(&scene))
        };
        let tube = "[[tube]]\nradius = 0.5\ncurve = { points = [[0, 0, -1], [0, 0, 1], [0, 0, 3]] }";
        assert_eq!((size(tube), size("")), (Ok(0.5), Ok(0.125)));
    }

    #[test]
    fn sizes_and_times_outside_of_their_ranges_are_refused() {
        for text in ["0", "-1", "nan", "inf", "1e-10", "1.001e9", "x", ""] {
            assert!(size(text).is_err(), "{text}");
        }
        assert_eq!(size("1e-3"), Ok(0.001));
        assert_eq!((size("1e-9"), size("1e9")), (Ok(1e-9), Ok(1e9)));
        assert_eq!((time("-1e9"), time("1e9")), (Ok(-1e9), Ok(1e9)));
        assert!(time("-0").is_ok_and(f64::is_sign_positive) && time("nan").is_err() && time("1e10").is_err());
    }
}
