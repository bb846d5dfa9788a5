//! `vdbake render`: a picture of a scene, or of what is in a file.

mod image;
mod light;
mod source;

use std::num::NonZeroU32;
use std::path::PathBuf;
use std::sync::Mutex;
use std::time::Instant;

use clap::{Args, ValueEnum};
use serde::Serialize;

use super::interrupt::Interrupt;
use super::job::SceneOptions;
use super::memory::{enough, resident};
use super::output::Output;
use super::progress::Progress;
use super::{Failure, Global, info, machine, text};
use crate::march::{
    Camera, Entry, Film, Integrator, Intervals, Lamp, Marching, Medium, Method, Optics, Picture, Quality,
    Sampling, Shadow,
};
use crate::num::Level;
use image::Target;
use light::LightOptions;
use source::Drawn;

#[derive(Debug, Args)]
pub(super) struct Arguments {
    /// A scene, drawn without voxels, or a VDB file
    file: PathBuf,
    /// Where to write: .exr holds linear radiance and what else is known of every pixel, .png a picture to look at
    #[arg(short, long, value_name = "IMG")]
    output: PathBuf,
    /// Pixels
    #[arg(long, value_name = "WxH", value_parser = size, default_value = "960x540")]
    size: [usize; 2],
    #[command(flatten)]
    light: LightOptions,
    /// Of a file: the scene that camera, lights and medium are taken from [default: that which the file was baked from]
    #[arg(long, value_name = "SCENE")]
    scene: Option<PathBuf>,
    /// Of a file: the grid [default: its only one, or that named density]
    #[arg(long, value_name = "NAME")]
    grid: Option<String>,
    /// What is behind: `transparent`, a number or three with commas between them, linear [default: what the scene says, else
    /// transparent]
    #[arg(long, value_name = "COLOUR", value_parser = background, allow_hyphen_values = true)]
    background: Option<Background>,
    /// Stops (factors of 2) by which a .png is brightened [default: what the scene says, else chosen by the picture]
    #[arg(long, value_name = "STOPS", value_parser = stops, allow_hyphen_values = true)]
    exposure: Option<f64>,
    /// Extinguish light only: no light is scattered or emitted
    #[arg(long)]
    absorption_only: bool,
    /// Of a scene: voxels between two steps along a ray, at most. Of a file: 1, 2, 4 or 8, so many voxels along each axis are drawn
    /// as one, and what is smaller is smeared over them; it saves time where voxels are no larger than pixels [default: 1]
    #[arg(long, value_name = "VOXELS", value_parser = step, allow_hyphen_values = true)]
    step: Option<f64>,
    /// Of a scene: what steps do. `gauss` takes two samples a step and divides it where it is dense; `midpoint` one, in its
    /// middle; `alpha` one at its beginning, and multiplies the transmittance by 1 - density times step [default: gauss].
    /// Of a file: `planes` takes one sample in every layer of voxels, `cells` integrates each exactly [default: planes, with
    /// exact shadows and paths cells]
    #[arg(long, value_name = "METHOD")]
    method: Option<MethodName>,
    /// Of `midpoint` and `alpha`: each step is longer than the one before by this part of it [default: 0]
    #[arg(long, value_name = "PART", value_parser = growth, allow_hyphen_values = true)]
    growth: Option<f64>,
    /// Of `midpoint` and `alpha`: how the place is found where a ray enters the tubes [default: cones]
    #[arg(long, value_name = "HOW")]
    entry: Option<EntryName>,
    /// Of `midpoint` and `alpha`, without growth: places are mapped to the tubes' cylinders at every so many steps, and what they
    /// are mapped to is interpolated between [default: 1]
    #[arg(long, value_name = "N", value_parser = text::whole::<u8>(1, 16), allow_negative_numbers = true)]
    map_every: Option<u8>,
    /// Of `midpoint` and `alpha`: which steps are evaluated. With `ray-boxes` and `sample-boxes` the first begins where a ray
    /// enters the first box, or that around all of them [default: bricks]
    #[arg(long, value_name = "HOW")]
    intervals: Option<IntervalsName>,
    /// Of `midpoint` and `alpha`, in place of --step: every ray takes so many steps of one length, from where it enters the box
    /// around everything to where it leaves it
    #[arg(long, value_name = "N", value_parser = text::whole::<u32>(1, 1_000_000), allow_negative_numbers = true)]
    ray_steps: Option<u32>,
    /// Part of the light that may be left where a ray ends
    #[arg(long, value_name = "PART", value_parser = part, default_value_t = 1e-4, allow_hyphen_values = true)]
    cutoff: f64,
    /// Write a coarse picture first, and better ones in its place until all samples are taken
    #[arg(long)]
    progressive: bool,
    #[command(flatten)]
    options: SceneOptions,
}

/// See [`Method`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum MethodName {
    Gauss,
    Midpoint,
    Alpha,
    Planes,
    Cells,
}

impl MethodName {
    fn name(self) -> String {
        self.to_possible_value().map(|value| value.get_name().to_owned()).unwrap_or_default()
    }
}

/// See [`Entry`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum EntryName {
    /// By the closed form
    Cones,
    /// By steps of one length
    Constant,
    /// By steps that turn back and halve
    Converging,
    /// By steps as long as the distance
    SphereTracing,
}

/// See [`Intervals`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum IntervalsName {
    /// Those in bricks that hold a tube
    Bricks,
    /// Those inside of cones along the tubes, by their closed form
    Cones,
    /// Those inside the boxes of curves' segments that a ray meets, which is asked once a ray
    RayBoxes,
    /// Those inside the boxes of segments, which is asked of every box at every step
    SampleBoxes,
}

impl Arguments {
    /// How rays go through a scene.
    fn marching(&self) -> Result<Marching, Failure> {
        let method = match self.method {
            Some(method @ (MethodName::Planes | MethodName::Cells)) => {
                let message =
                    format!("--method {} has no meaning for a scene, only for a file", method.name());
                return Err(Failure::usage(message).hint("choose gauss, midpoint or alpha"));
            }
            None | Some(MethodName::Gauss) => Method::Gauss,
            Some(MethodName::Midpoint) => Method::Midpoint,
            Some(MethodName::Alpha) => Method::Alpha,
        };
        let entry = match self.entry {
            None | Some(EntryName::Cones) => Entry::Cones,
            Some(EntryName::Constant) => Entry::Constant,
            Some(EntryName::Converging) => Entry::Converging,
            Some(EntryName::SphereTracing) => Entry::SphereTracing,
        };
        let asked = [
            (self.growth.is_some(), "--growth"),
            (self.entry.is_some(), "--entry"),
            (self.map_every.is_some(), "--map-every"),
            (self.intervals.is_some(), "--intervals"),
            (self.ray_steps.is_some(), "--ray-steps"),
        ];
        for (given, option) in asked {
            if given && method == Method::Gauss {
                let message = format!("{option} has no meaning for the method `gauss`");
                return Err(Failure::usage(message).hint("choose --method midpoint or --method alpha"));
            }
        }
        let (growth, map_every) = (self.growth.unwrap_or(0.0), self.map_every.unwrap_or(1));
        if growth > 0.0 && map_every > 1 {
            return Err(Failure::usage(
                "--map-every needs steps of one length, and --growth makes them longer",
            ));
        }
        let intervals = match self.intervals {
            None | Some(IntervalsName::Bricks) => Intervals::Bricks,
            Some(IntervalsName::Cones) => Intervals::Cones,
            Some(IntervalsName::RayBoxes) => Intervals::RayBoxes,
            Some(IntervalsName::SampleBoxes) => Intervals::SampleBoxes,
        };
        let count = self.ray_steps.and_then(NonZeroU32::new);
        let has_boxes = matches!(intervals, Intervals::RayBoxes | Intervals::SampleBoxes);
        for (given, against, option) in [
            (self.step.is_some() && count.is_some(), "--ray-steps", "--step"),
            (growth > 0.0 && count.is_some(), "--ray-steps", "--growth"),
            (self.entry.is_some() && count.is_some(), "--ray-steps", "--entry"),
            (self.entry.is_some() && has_boxes, "boxes of --intervals", "--entry"),
        ] {
            if given {
                return Err(Failure::usage(format!("{option} has no meaning with {against}")));
            }
        }
        Ok(Marching { method, growth, entry, map_every: map_every.into(), intervals, count })
    }

    /// How rays go through the voxels of a file.
    fn sampling(&self) -> Result<Sampling, Failure> {
        match self.method {
            Some(MethodName::Planes) => Ok(Sampling::Planes),
            Some(MethodName::Cells) => Ok(Sampling::Cells),
            Some(method @ (MethodName::Gauss | MethodName::Midpoint | MethodName::Alpha)) => {
                let message =
                    format!("--method {} has no meaning for a file, only for a scene", method.name());
                Err(Failure::usage(message).hint("choose planes or cells"))
            }
            None => {
                let is_plain =
                    self.light.integrator() == Integrator::Single && self.light.shadow() != Shadow::Exact;
                Ok(if is_plain { Sampling::Planes } else { Sampling::Cells })
            }
        }
    }

    /// How often the voxels of a file are drawn as one with those beside them.
    fn halvings(&self) -> Result<u32, Failure> {
        let step = self.step.unwrap_or(1.0);
        (0..=3).find(|times| step == f64::from(1 << times)).ok_or_else(|| {
            Failure::usage(format!("--step {step} has no meaning for a file")).hint("choose 1, 2, 4 or 8")
        })
    }

    /// The first option that is given and says how rays go through a scene only.
    fn marching_option(&self) -> Option<&'static str> {
        [
            (self.growth.is_some(), "--growth"),
            (self.entry.is_some(), "--entry"),
            (self.map_every.is_some(), "--map-every"),
            (self.intervals.is_some(), "--intervals"),
            (self.ray_steps.is_some(), "--ray-steps"),
        ]
        .into_iter()
        .find_map(|(given, option)| given.then_some(option))
    }
}

/// Pixels along an edge that a coarse picture has one for.
const COARSE: usize = 4;

/// Beyond this optical depth of a voxel of density 1 a table of shadows is off by a tenth of the light or more.
const DENSE: f64 = 1.5;

/// Bytes that the program takes besides pixels and what is drawn, and for each pixel while it is found and written.
const PROCESS: u64 = 16 << 20;
const PIXEL: u64 = 200;

/// What is behind.
#[derive(Debug, Clone, Copy)]
struct Background(Option<[f64; 3]>);

/// What was done, as `--json` prints it.
#[derive(Debug, Serialize)]
struct Report {
    output: String,
    /// What was drawn: `scene`, or `file`.
    kind: &'static str,
    size: [usize; 2],
    samples: u32,
    /// Of paths: the mean standard error of the luminance over its mean; null before the second sample.
    noise: Option<f64>,
    bricks: usize,
    /// Of a scene: places that the density was evaluated at along rays from the eye, and those of them inside a tube.
    evaluated_places: Option<[u64; 2]>,
    /// Mean over all pixels.
    mean_transmittance: f64,
    /// Of a .png.
    exposure: Option<f64>,
    seconds: Times,
    /// Until a coarse picture was written, where that was asked for.
    first_picture_seconds: Option<f64>,
    peak_rss_bytes: Option<u64>,
    threads: usize,
    simd: String,
}

/// Seconds that each part took by the clock.
#[derive(Debug, Serialize)]
struct Times {
    /// Reading or planning.
    load: f64,
    /// All of the coarse picture but writing it, where that was asked for.
    coarse: Option<f64>,
    /// What each part of the picture sees, and shadows.
    prepare: f64,
    march: f64,
    write: f64,
    total: f64,
}

/// Draws.
pub(super) fn run(arguments: &Arguments, global: &Global) -> Result<(), Failure> {
    let target = Target::new(&arguments.output)?;
    arguments.light.check()?;
    Output::check(&arguments.output)?;
    let is_file = info::is_vdb(&arguments.file)?;
    let interrupt = Interrupt::listen()?;
    let pool = global.pool()?;
    let report = pool.install(|| draw(arguments, target, is_file, &interrupt, global))?;
    global.show(&report, human)
}

fn draw(
    arguments: &Arguments,
    target: Target,
    is_file: bool,
    interrupt: &Interrupt,
    global: &Global,
) -> Result<Report, Failure> {
    let level = Level::best();
    let budget = budget(arguments)?;
    let mut clock = Clock { last: Instant::now(), first: Instant::now() };
    let (mut field, mut scene) = (None, 0);
    let drawn = if is_file {
        Drawn::of_file(arguments, budget, global)?
    } else {
        let (compiled, view) = source::scene(arguments)?;
        // Scenes of many segments take more than the program itself.
        scene = resident().saturating_sub(PROCESS);
        let field = field.insert(compiled);
        Drawn::of_scene(arguments, field, view, budget.saturating_sub(scene))?
    };
    let load = clock.lap();
    let view = &drawn.view;
    if drawn.medium.brick_count() == 0 {
        global.note(&format!("{} holds no density: the picture is empty", arguments.file.display()));
    }
    let quality = Quality {
        size: arguments.size,
        samples: arguments.light.samples(),
        cutoff: arguments.cutoff,
        shadow: arguments.light.shadow(),
        integrator: arguments.light.integrator(),
    };
    #[allow(clippy::cast_precision_loss, reason = "pictures are far smaller")]
    let aspect = arguments.size[0] as f64 / arguments.size[1] as f64;
    let camera = Camera::new(&view.camera, view.bounds, aspect);
    let optics =
        if arguments.absorption_only { view.optics.clone().absorbing() } else { view.optics.clone() };
    let is_lit = quality.integrator == Integrator::Single && !optics.lamps.is_empty();
    if is_lit && !arguments.light.has_shadow() && optics.extinction * drawn.medium.grid().cell() > DENSE {
        global.note(
            "light is lost within less than the voxels between which shadows are known: see --shadow exact",
        );
    }
    let background = match arguments.background {
        Some(Background(colour)) => colour,
        None => view.camera.background,
    };
    has_room(arguments, &drawn.medium, &camera, &optics, quality, budget.saturating_sub(scene))?;
    let exposure = arguments.exposure.or(view.camera.exposure);
    let write = |film: &Film| target.write(film, background.map(Into::into), exposure, interrupt);
    let (mut coarse_time, mut first_picture) = (None, None);
    if arguments.progressive {
        let coarse = Quality {
            size: quality.size.map(|edge| edge.div_ceil(COARSE)),
            // Voxels are as coarse then; a scene's are not.
            shadow: match (quality.shadow, is_file) {
                (Shadow::None, _) => Shadow::None,
                (Shadow::Cached(pitch), true) => Shadow::Cached(pitch),
                (Shadow::Cached(pitch), false) => Shadow::Cached(8.0_f64.min(pitch * 4.0)),
                (Shadow::Exact, is_file) => Shadow::Cached(if is_file { 2.0 } else { 8.0 }),
            },
            integrator: Integrator::Single,
            ..quality
        };
        let medium = drawn.medium.coarser(COARSE.ilog2());
        let mut picture =
            Picture::new(medium.as_ref().unwrap_or(&drawn.medium), camera, &optics, coarse, level);
        picture.sample(|_| true);
        coarse_time = Some(clock.lap());
        interrupt.hold();
        write(&picture.film().enlarged(quality.size))?;
        first_picture = Some(clock.first.elapsed().as_secs_f64());
        interrupt.check()?;
        clock.lap();
    }
    let mut picture = Picture::new(&drawn.medium, camera, &optics, quality, level);
    let prepare = clock.lap();
    interrupt.hold();
    let mut progress = Progress::new(1, global.quiet);
    progress.begin(picture.tiles() * quality.samples as usize);
    let progress = Mutex::new(progress);
    for sample in 1..=quality.samples {
        let is_whole = picture.sample(|tiles| {
            if tiles > 0
                && let Ok(mut progress) = progress.lock()
            {
                progress.advance(tiles);
            }
            interrupt.check().is_ok() && (sample == 1 || !arguments.light.is_late(clock.first.elapsed()))
        });
        interrupt.check()?;
        if !is_whole {
            break;
        }
        if arguments.light.is_enough(picture.film(), clock.first.elapsed()) {
            break;
        }
        if arguments.progressive && sample.is_power_of_two() && sample < quality.samples {
            write(picture.film())?;
        }
    }
    drop(progress);
    if target.has_layers() {
        picture.find_normals();
    }
    let march = clock.lap();
    let film = picture.film();
    if drawn.medium.brick_count() > 0 && !optics.is_clear && film.depth.iter().all(|depth| *depth <= 0.0) {
        global.note(&format!("nothing of {} is seen from where the camera is", arguments.file.display()));
    }
    if target.has_layers() && film.squares.is_some() && film.samples == 1 {
        global.note("one sample of each pixel tells nothing of its noise: there is no layer noise.Y");
    }
    let exposure = write(film)?;
    let write = clock.lap();
    #[allow(clippy::cast_precision_loss, reason = "pictures are far smaller")]
    let pixels = film.transmittance.len() as f64 * f64::from(film.samples);
    Ok(Report {
        output: arguments.output.display().to_string(),
        kind: if is_file { "file" } else { "scene" },
        size: arguments.size,
        samples: film.samples,
        noise: film.noise(),
        bricks: drawn.medium.brick_count(),
        evaluated_places: drawn.medium.places(),
        mean_transmittance: film.transmittance.iter().sum::<f64>() / pixels,
        exposure,
        seconds: Times {
            load,
            coarse: coarse_time,
            prepare,
            march,
            write,
            total: clock.first.elapsed().as_secs_f64(),
        },
        first_picture_seconds: first_picture,
        peak_rss_bytes: machine::peak_memory(),
        threads: rayon::current_num_threads(),
        simd: level.name(),
    })
}

/// What pixels and the program leave of the memory, in bytes.
fn budget(arguments: &Arguments) -> Result<u64, Failure> {
    let need = PROCESS + PIXEL * (arguments.size[0] * arguments.size[1]) as u64;
    arguments.options.budget().bytes().checked_sub(need).ok_or_else(|| {
        let [width, height] = arguments.size;
        let taken = text::bytes(need);
        let message =
            format!("a picture of {width} x {height} pixels takes {taken} of memory, and less may be used");
        Failure::failed(message)
            .hint(format!("choose a smaller --size, or allow more with --memory {}", enough(need)))
    })
}

/// Refuses a picture of a scene, or of voxels with lamps among them, for which so many bytes are too few. Those of voxels that
/// suns light are counted before.
fn has_room(
    arguments: &Arguments,
    medium: &Medium<'_>,
    camera: &Camera,
    optics: &Optics,
    quality: Quality,
    budget: u64,
) -> Result<(), Failure> {
    let is_counted = optics.lamps.iter().all(|lamp| matches!(lamp, Lamp::Sun { .. }));
    let held = match medium {
        Medium::Procedural(scene) => scene.memory(),
        Medium::Baked(_) if is_counted => return Ok(()),
        Medium::Baked(voxels) => voxels.memory(),
    };
    let need = held.saturating_add(Picture::memory(medium, camera, optics, quality));
    if need <= budget {
        return Ok(());
    }
    let all = need.saturating_add(arguments.options.budget().bytes().saturating_sub(budget));
    let taken = text::bytes(all);
    let failure = Failure::failed(format!("the picture takes {taken} of memory, and less may be used"))
        .hint(format!("allow more with --memory {}", enough(all)));
    Err(match (quality.integrator, quality.shadow) {
        (Integrator::Single, Shadow::Cached(_)) if !optics.lamps.is_empty() => failure
            .hint("shadows take most of it: a larger --shadow-step takes less, and --shadow exact takes time instead"),
        _ => failure,
    })
}

struct Clock {
    first: Instant,
    last: Instant,
}

impl Clock {
    /// Seconds since the last call.
    fn lap(&mut self) -> f64 {
        let now = Instant::now();
        let seconds = (now - self.last).as_secs_f64();
        self.last = now;
        seconds
    }
}

fn human(report: &Report) -> String {
    format!(
        "{}  {} x {} pixels, {} each, in {}",
        report.output,
        report.size[0],
        report.size[1],
        text::number(report.samples.into(), "sample"),
        text::seconds(report.seconds.total),
    )
}

fn size(text: &str) -> Result<[usize; 2], String> {
    let edge = |text: &str| text.parse().ok().filter(|edge| (1..=32768).contains(edge));
    let (width, height) = text.split_once('x').unwrap_or((text, ""));
    match (edge(width), edge(height)) {
        (Some(width), Some(height)) => Ok([width, height]),
        _ => Err("expected a width and a height from 1 to 32768, such as 960x540".to_owned()),
    }
}

fn background(text: &str) -> Result<Background, String> {
    if text == "transparent" {
        return Ok(Background(None));
    }
    let parts: Option<Vec<f64>> = text
        .split(',')
        .map(|part| part.trim().parse().ok().filter(|part| (0.0..=1e9).contains(part)))
        .collect();
    match parts.as_deref() {
        Some([grey]) => Ok(Background(Some([*grey; 3]))),
        Some([red, green, blue]) => Ok(Background(Some([*red, *green, *blue]))),
        _ => Err("expected `transparent`, a number, or red,green,blue, each at least 0".to_owned()),
    }
}

fn stops(text: &str) -> Result<f64, String> {
    let stops = text.parse().ok().filter(|stops| (-100.0..=100.0).contains(stops));
    stops.ok_or_else(|| "expected a number of stops from -100 to 100".to_owned())
}

fn step(text: &str) -> Result<f64, String> {
    voxels(text).map_err(|expected| format!("{expected}, and of a file 1, 2, 4 or 8"))
}

fn voxels(text: &str) -> Result<f64, String> {
    let voxels = text.parse().ok().filter(|voxels| (0.01..=8.0).contains(voxels));
    voxels.ok_or_else(|| "expected a number of voxels from 0.01 to 8".to_owned())
}

fn growth(text: &str) -> Result<f64, String> {
    let growth = text.parse().ok().filter(|growth| (0.0..=1.0).contains(growth));
    growth.ok_or_else(|| "expected a part from 0 to 1".to_owned())
}

fn part(text: &str) -> Result<f64, String> {
    let part = text.parse().ok().filter(|part| (1e-30..=0.5).contains(part));
    part.ok_or_else(|| "expected a part from 1e-30 to 0.5".to_owned())
}
