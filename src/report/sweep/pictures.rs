//! Pictures by many ways.

use std::num::NonZeroU32;

use glam::DVec3;
use serde::Serialize;

use super::Run;
use super::rows::{Cost, ImageError, Kind, Row, Settings, Spread};
use crate::field::{Field, Lattice};
use crate::formats::vdb::{Compression, Encoder};
use crate::march::{
    Baked, Camera, Entry, Film, Grid, Integrator, Intervals, Marching, Meaning, Medium, Method, Optics,
    Picture, Procedural, Quality, Shadow,
};
use crate::num::Level;
use crate::report::exact::unlimited;
use crate::report::flip::PIXELS_PER_DEGREE;
use crate::report::image::{Picture as Image, compare_images};
use crate::report::octaves::{most_octaves, with_octaves};
use crate::report::parts::{Part, why};
use crate::report::trial::{Pilot, TrialError, rows};
use crate::scene::Scene;
use crate::volume::{PlanError, Precision};

/// Of the picture that others are held against: voxels between steps, and the part of the light that may be left.
const FINE: f64 = 0.25;
const NONE_LEFT: f64 = 1e-9;
/// The same where nothing else is said.
const STEP: f64 = 1.0;
const CUTOFF: f64 = 1e-4;

/// The error of a baked picture's transmittance taken apart, each part by switching one thing off.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ImageParts {
    /// The picture of a bake in half precision, as it is drawn by default, less the scene's own.
    pub whole: Part,
    /// Octaves that fade and parts that are widened.
    pub model: Part,
    /// Voxels in single precision.
    pub interpolation: Part,
    /// Half precision.
    pub quantisation: Part,
    /// Rays that end where no more than 1e-4 of the light is left. (Through voxels steps have no error.)
    pub early_exit: Part,
    /// Steps of a voxel through the scene itself, which is no part of the whole: a bake's rays take none.
    pub step: Part,
    /// Root of the sum of the squares of model, interpolation, quantisation and early exit.
    pub root_sum_square: f64,
    /// That over the whole; null where the whole is 0.
    pub of_whole: Option<f64>,
    /// Why these are more than a fifth apart, where they are.
    pub reason: Option<String>,
}

/// When a bake pays.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct PaysAfter {
    /// Seconds to bake at the scene's own voxel size.
    pub bake: f64,
    /// Seconds for a frame through the scene itself.
    pub procedural_frame: f64,
    /// Seconds for one through its voxels.
    pub baked_frame: f64,
    /// Frames of one bake after which it has paid; null where a frame through voxels is no faster.
    pub frames: Option<f64>,
}

/// How a picture is made.
#[derive(Clone, Copy)]
struct Way {
    step: f64,
    cutoff: f64,
    marching: Marching,
    shadow: Shadow,
}

const DEFAULT: Way = Way {
    step: STEP,
    cutoff: CUTOFF,
    marching: Marching {
        method: Method::Gauss,
        growth: 0.0,
        entry: Entry::Cones,
        map_every: 1,
        intervals: Intervals::Bricks,
        count: None,
    },
    shadow: Shadow::Cached(2.0),
};

/// The group that is the table of a text.
pub(crate) const PAPER: &str = "paper";

/// Samples of a ray whose densities are summed.
const SUMMED: [u32; 4] = [5, 16, 64, 256];
/// Where samples are held against every segment's box there are no more of these.
const MOST_SEGMENTS: usize = 1000;

/// The ways to know which steps are inside of tubes, and what they are called.
const INTERVALS: [(&str, Intervals); 3] = [
    ("a box of each segment tested at every step", Intervals::SampleBoxes),
    ("a box of each segment tested once a ray", Intervals::RayBoxes),
    ("cones found in a tree once a ray", Intervals::Cones),
];

fn in_the_middle(change: impl FnOnce(&mut Marching)) -> Way {
    let mut marching = Marching { method: Method::Midpoint, ..Marching::default() };
    change(&mut marching);
    Way { marching, ..DEFAULT }
}

/// What all pictures of a scene share.
struct View {
    camera: Camera,
    optics: Optics,
    level: Level,
}

impl View {
    fn new(scene: &Scene, size: [usize; 2]) -> View {
        #[allow(clippy::cast_precision_loss, reason = "pictures are far smaller")]
        let aspect = size[0] as f64 / size[1] as f64;
        let bounds = Field::compile(scene).bounds();
        View {
            camera: Camera::new(&scene.camera(), bounds, aspect),
            optics: Optics::new(&scene.medium(), scene.lights()),
            level: Level::best(),
        }
    }
}

/// The picture that others are held against, and what it is of.
struct Best<'a> {
    scene: &'a Scene,
    lattice: Lattice,
    film: Film,
    view: View,
    /// Whether by the light of the scene, shadows and all.
    is_lit: bool,
}

impl Run<'_> {
    /// The scene itself by its default way, and its bake; and the error of that taken apart.
    pub(super) fn pictures(&mut self) -> Result<Option<ImageParts>, TrialError> {
        if !self.time_for("pictures of the scene and of its bake") {
            return Ok(None);
        }
        let view = View::new(self.scene, self.effort.size);
        let fine = Way { step: FINE, cutoff: NONE_LEFT, ..DEFAULT };
        let all = unlimited(self.scene);
        let film = self.procedural(&all, self.lattice, fine, &view, 0)?.0;
        let best = Best { scene: self.scene, lattice: self.lattice, film, view, is_lit: true };
        let limited = self.procedural(self.scene, self.lattice, fine, &best.view, 0)?.0;
        let coarse =
            self.procedural(self.scene, self.lattice, Way { cutoff: NONE_LEFT, ..DEFAULT }, &best.view, 0)?.0;
        let [single, half] = [Precision::F32, Precision::F16].map(|precision| {
            self.baked(self.lattice, precision, Way { cutoff: NONE_LEFT, ..DEFAULT }, &best.view, 0)
        });
        let ended = self.baked(self.lattice, Precision::F16, DEFAULT, &best.view, 0)?.0;
        let parts = image_parts(&best.film, &limited, &single?.0, &half?.0, &ended, &coarse);
        for factor in [1.0, 2.0, 4.0] {
            let label = format!("baked, {factor} times the voxel");
            if self.time_for(&label) {
                let lattice = Lattice { voxel_size: factor * self.lattice.voxel_size };
                let (film, cost) =
                    self.baked(lattice, Precision::F32, DEFAULT, &best.view, self.effort.repeats)?;
                let command = format!(
                    "vdbake bake SCENE --voxel-size {:?}{} -o BAKED.vdb && vdbake render BAKED.vdb -o IMG{}",
                    lattice.voxel_size,
                    self.at_time(),
                    self.of_size()
                );
                self.row("baked", label, (lattice, None, None), Some(command), &best, &film, cost);
            }
        }
        for step in [STEP, 2.0, 4.0, 0.5] {
            let way = Way { step, ..DEFAULT };
            self.way("steps", &format!("gauss, {step} voxels a step"), way, &best)?;
        }
        Ok(Some(parts))
    }

    /// Other methods, and simpler noise.
    pub(super) fn more_pictures(&mut self) -> Result<(), TrialError> {
        self.paper()?;
        if !self.time_for("the picture that others are held against") {
            return Ok(());
        }
        let best = self.best(self.scene, self.lattice)?;
        let with = |method, growth, entry, map_every, step| Way {
            step,
            marching: Marching { method, growth, entry, map_every, ..Marching::default() },
            ..DEFAULT
        };
        let (cones, alpha, midpoint) = (Entry::Cones, Method::Alpha, Method::Midpoint);
        let ways = [
            ("steps", "alpha", with(alpha, 0.0, cones, 1, 1.0)),
            ("steps", "midpoint", with(midpoint, 0.0, cones, 1, 1.0)),
            ("steps", "midpoint, double step", with(midpoint, 0.0, cones, 1, 2.0)),
            ("steps", "midpoint, quadruple step", with(midpoint, 0.0, cones, 1, 4.0)),
            ("growing step", "midpoint, steps grow by 1 %", with(midpoint, 0.01, cones, 1, 1.0)),
            ("growing step", "midpoint, steps grow by 5 %", with(midpoint, 0.05, cones, 1, 1.0)),
            ("mapping", "midpoint, mapped every 2nd step", with(midpoint, 0.0, cones, 2, 1.0)),
            ("mapping", "midpoint, mapped every 4th step", with(midpoint, 0.0, cones, 4, 1.0)),
            ("mapping", "midpoint, mapped every 8th step", with(midpoint, 0.0, cones, 8, 1.0)),
            ("entry", "midpoint, entered by constant steps", with(midpoint, 0.0, Entry::Constant, 1, 1.0)),
            (
                "entry",
                "midpoint, entered by converging steps",
                with(midpoint, 0.0, Entry::Converging, 1, 1.0),
            ),
            (
                "entry",
                "midpoint, entered by sphere tracing",
                with(midpoint, 0.0, Entry::SphereTracing, 1, 1.0),
            ),
            ("early exit", "gauss, ended at 1e-2 of the light", Way { cutoff: 1e-2, ..DEFAULT }),
            ("early exit", "gauss, ended at 1e-6 of the light", Way { cutoff: 1e-6, ..DEFAULT }),
        ];
        for (group, label, way) in ways {
            self.way(group, label, way, &best)?;
        }
        for samples in SUMMED {
            let summed = in_the_middle(|marching| marching.count = NonZeroU32::new(samples));
            let label = format!("{samples} samples a ray, no shadows");
            self.way("density sum", &label, Way { shadow: Shadow::None, ..summed }, &best)?;
        }
        let summed = in_the_middle(|marching| marching.count = NonZeroU32::new(64));
        self.way("density sum", "64 samples a ray, with shadows", summed, &best)?;
        self.ways_inside("", &best)
    }

    /// The table of Moinet's text (2022, section 5.2): all by its integrator, without shadows, as it has none, and held against a
    /// picture without them.
    fn paper(&mut self) -> Result<(), TrialError> {
        if !self.time_for("the paper's table") {
            return Ok(());
        }
        let way = |step: f64| {
            let marching = Marching { method: Method::Alpha, ..Marching::default() };
            Way { step, marching, shadow: Shadow::None, ..DEFAULT }
        };
        let best = self.best_with(self.scene, self.lattice, Shadow::None)?;
        self.way(PAPER, "as it is", way(1.0), &best)?;
        for (octaves, label) in [(1, "simpler noise, of one octave"), (0, "no noise")] {
            // As it is where it has no more.
            if most_octaves(self.scene) > octaves && self.time_for(label) {
                let scene = with_octaves(self.scene, octaves);
                let (film, cost) =
                    self.procedural(&scene, self.lattice, way(1.0), &best.view, self.effort.repeats)?;
                let settings = (self.lattice, Some(octaves), Some(way(1.0)));
                self.row(PAPER, label.to_owned(), settings, None, &best, &film, cost);
            }
        }
        self.way(PAPER, "double step", way(2.0), &best)?;
        self.way(PAPER, "quadruple step", way(4.0), &best)
    }

    /// What the ways to know what is inside cost in a scene that is not the report's own.
    pub(super) fn ways_through(
        &mut self,
        what: &str,
        scene: &Scene,
        lattice: Lattice,
    ) -> Result<(), TrialError> {
        let best = self.best(scene, lattice)?;
        self.ways_inside(&format!("{what}: "), &best)
    }

    /// A row for each way to know which steps are inside.
    fn ways_inside(&mut self, what: &str, best: &Best<'_>) -> Result<(), TrialError> {
        let segments: usize = best.scene.tubes().iter().map(|tube| tube.curve.segments().len()).sum();
        for (label, intervals) in INTERVALS {
            let label = format!("{what}{label}");
            if intervals == Intervals::SampleBoxes && segments > MOST_SEGMENTS {
                self.left_out.push(format!("{label}: there are {segments} segments"));
                continue;
            }
            self.way("intervals", &label, in_the_middle(|marching| marching.intervals = intervals), best)?;
        }
        Ok(())
    }

    fn best<'b>(&self, scene: &'b Scene, lattice: Lattice) -> Result<Best<'b>, TrialError> {
        self.best_with(scene, lattice, DEFAULT.shadow)
    }

    fn best_with<'b>(
        &self,
        scene: &'b Scene,
        lattice: Lattice,
        shadow: Shadow,
    ) -> Result<Best<'b>, TrialError> {
        let view = View::new(scene, self.effort.size);
        let fine = Way { step: FINE, cutoff: NONE_LEFT, shadow, ..DEFAULT };
        let film = self.procedural(&unlimited(scene), lattice, fine, &view, 0)?.0;
        Ok(Best { scene, lattice, film, view, is_lit: shadow != Shadow::None })
    }

    /// A row for a way through a scene itself.
    fn way(&mut self, group: &'static str, label: &str, way: Way, best: &Best<'_>) -> Result<(), TrialError> {
        if self.time_for(label) {
            let (film, cost) =
                self.procedural(best.scene, best.lattice, way, &best.view, self.effort.repeats)?;
            let command = std::ptr::eq(best.scene, self.scene).then(|| self.command(way));
            let settings = (best.lattice, None, Some(way));
            self.row(group, label.to_owned(), settings, command, best, &film, cost);
        }
        Ok(())
    }

    /// Whether a picture is of the report's own scene, by its light.
    fn is_own(&self, best: &Best<'_>) -> bool {
        best.is_lit && std::ptr::eq(best.scene, self.scene)
    }

    fn command(&self, way: Way) -> String {
        let Marching { method, growth, entry, map_every, intervals, count } = way.marching;
        let mut command = format!(
            "vdbake render SCENE -o IMG --voxel-size {:?} --cutoff {:?} --method {}{}{}",
            self.lattice.voxel_size,
            way.cutoff,
            method_name(method),
            self.at_time(),
            self.of_size()
        );
        match count {
            None => command += &format!(" --step {}", way.step),
            Some(count) => command += &format!(" --ray-steps {count}"),
        }
        if way.shadow == Shadow::None {
            command += " --shadow none";
        }
        if method == Method::Gauss {
            return command;
        }
        if count.is_none() {
            command += &format!(" --growth {growth:?}");
        }
        let has_boxes = matches!(intervals, Intervals::RayBoxes | Intervals::SampleBoxes);
        if count.is_none() && !has_boxes {
            let entry = match entry {
                Entry::Cones => "cones",
                Entry::Constant => "constant",
                Entry::Converging => "converging",
                Entry::SphereTracing => "sphere-tracing",
            };
            command += &format!(" --entry {entry}");
        }
        let intervals = match intervals {
            Intervals::Bricks => "bricks",
            Intervals::Cones => "cones",
            Intervals::RayBoxes => "ray-boxes",
            Intervals::SampleBoxes => "sample-boxes",
        };
        command + &format!(" --map-every {map_every} --intervals {intervals}")
    }

    #[allow(clippy::too_many_arguments, reason = "a row")]
    fn row(
        &mut self,
        group: &'static str,
        label: String,
        (lattice, octaves, way): (Lattice, Option<u32>, Option<Way>),
        command: Option<String>,
        best: &Best<'_>,
        film: &Film,
        cost: Cost,
    ) {
        let is_baked = way.is_none();
        let is_own = self.is_own(best);
        self.rows.push(Row {
            is_own,
            group,
            label,
            kind: Kind::Picture,
            settings: Settings {
                voxel_size: lattice.voxel_size,
                filter: is_baked.then_some("trilinear"),
                precision: is_baked.then_some("f32"),
                compression: None,
                octaves,
                step: way.filter(|way| way.marching.count.is_none()).map(|way| way.step),
                method: way.map(|way| method_name(way.marching.method)),
            },
            command,
            field: None,
            image: Some(image_error(&best.film, film)),
            cost,
            on_front: false,
        });
    }

    /// The scene itself.
    fn procedural(
        &self,
        scene: &Scene,
        lattice: Lattice,
        way: Way,
        view: &View,
        repeats: usize,
    ) -> Result<(Film, Cost), TrialError> {
        let mut field = Field::compile(scene);
        field.widen(lattice);
        let medium = Procedural::new(&field, lattice, way.step, self.effort.budget)?.with(way.marching);
        Ok(self.film(&Medium::Procedural(medium), way, view, repeats))
    }

    /// Its bake.
    fn baked(
        &self,
        lattice: Lattice,
        precision: Precision,
        way: Way,
        view: &View,
        repeats: usize,
    ) -> Result<(Film, Cost), TrialError> {
        let lot = Pilot::new(self.scene, self.effort.budget).at(lattice)?;
        let encoder = Encoder::new(Compression::None).with_precision(precision);
        let tree = lot.bake(encoder)?.tree;
        let grid = Grid::from_rows(&rows(lattice)).ok_or(PlanError::TooWide)?;
        #[allow(clippy::cast_precision_loss, reason = "for a message")]
        let bricks = lot.plan.bricks() as f64;
        let baked = Baked::new(&tree, grid, Meaning::Density, self.effort.budget)
            .map_err(|_| PlanError::TooMany { bricks, enough: None })?;
        Ok(self.film(&Medium::Baked(baked), way, view, repeats))
    }

    /// One sample a pixel, and what that takes.
    fn film(&self, medium: &Medium<'_>, way: Way, view: &View, repeats: usize) -> (Film, Cost) {
        let quality = Quality {
            size: self.effort.size,
            samples: 1,
            cutoff: way.cutoff,
            shadow: way.shadow,
            integrator: Integrator::Single,
        };
        let mut picture = Picture::new(medium, view.camera, &view.optics, quality, view.level);
        picture.sample(|_| true);
        let film = picture.film().clone();
        let mut cost =
            Cost { evaluated_places: medium.places().map(|[places, _]| places), ..Cost::default() };
        let mut seconds = Vec::new();
        for _ in 0..repeats {
            // Later samples are in other places of their pixels, and take as long.
            let started = std::time::Instant::now();
            picture.sample(|_| true);
            seconds.push(started.elapsed().as_secs_f64());
            if self.begun.elapsed() > self.effort.time {
                break;
            }
        }
        cost.march = Spread::of(seconds);
        cost.total = cost.march;
        (film, cost)
    }
}

fn method_name(method: Method) -> &'static str {
    match method {
        Method::Gauss => "gauss",
        Method::Midpoint => "midpoint",
        Method::Alpha => "alpha",
    }
}

/// The difference of transmittances.
fn part(from: &Film, to: &Film) -> Part {
    let pairs = from.transmittance.iter().zip(&to.transmittance);
    #[allow(clippy::cast_precision_loss, reason = "a mean")]
    let weight = 1.0 / from.transmittance.len().max(1) as f64;
    let (mut squares, mut own, mut max) = (0.0, 0.0, 0.0_f64);
    for (a, b) in pairs {
        squares += (b - a) * (b - a);
        // What is taken of the light is what there is to see.
        own += (1.0 - a) * (1.0 - a);
        max = max.max((b - a).abs());
    }
    let rms = (weight * squares).sqrt();
    Part { rms, of_truth: (own > 0.0).then(|| rms / (weight * own).sqrt()), max }
}

fn image_parts(
    best: &Film,
    limited: &Film,
    single: &Film,
    half: &Film,
    ended: &Film,
    coarse: &Film,
) -> ImageParts {
    let whole = part(best, ended);
    let [model, interpolation, quantisation, early_exit] =
        [part(best, limited), part(limited, single), part(single, half), part(half, ended)];
    let squares: f64 =
        [model, interpolation, quantisation, early_exit].iter().map(|part| part.rms * part.rms).sum();
    let root_sum_square = squares.sqrt();
    let of_whole = (whole.rms > 0.0).then(|| root_sum_square / whole.rms);
    let steps = [best, limited, single, half, ended].map(|film| &*film.transmittance);
    ImageParts {
        whole,
        model,
        interpolation,
        quantisation,
        early_exit,
        step: part(limited, coarse),
        root_sum_square,
        of_whole,
        reason: why(&steps, ["model", "interpolation", "quantisation", "early exit"], of_whole),
    }
}

fn image_error(best: &Film, film: &Film) -> ImageError {
    let exposure = best.exposure();
    let picture = |film: &Film| {
        let developed = film.develop(None);
        let channel = |axis: usize| -> Vec<f32> {
            #[allow(clippy::cast_possible_truncation, reason = "to single precision, as images have it")]
            let values = developed.colour.iter().map(|colour: &DVec3| colour[axis] as f32).collect();
            values
        };
        let channels =
            ["R", "G", "B"].into_iter().enumerate().map(|(axis, name)| (name.to_owned(), channel(axis)));
        Image { size: film.size, channels: channels.collect(), srgb: false }
    };
    let found = compare_images(&picture(best), &picture(film), exposure, PIXELS_PER_DEGREE);
    let transmittance = part(best, film).rms;
    let Some(found) = found else {
        return ImageError {
            rmse: 0.0,
            relative: None,
            psnr: None,
            flip: None,
            transmittance,
            intervals: None,
        };
    };
    let errors = found.all.errors;
    ImageError {
        rmse: errors.l2.absolute,
        relative: errors.l2.of_rms,
        psnr: errors.psnr,
        flip: found.flip.map(|flip| flip.mean),
        transmittance,
        intervals: found.intervals,
    }
}

/// From rows of a bake and of pictures at the scene's own voxel size.
pub(super) fn pays_after(rows: &[Row], lattice: Lattice) -> Option<PaysAfter> {
    let own = |row: &&Row| row.settings.voxel_size == lattice.voxel_size;
    let of = |group: &str, method: Option<&str>| {
        let mut rows =
            rows.iter().filter(own).filter(|row| row.group == group && row.settings.method == method);
        Some(rows.next()?.cost.total?.median)
    };
    let bake = of("voxel size and filter", None)?;
    let (procedural_frame, baked_frame) = (of("steps", Some("gauss"))?, of("baked", None)?);
    let gain = procedural_frame - baked_frame;
    Some(PaysAfter { bake, procedural_frame, baked_frame, frames: (gain > 0.0).then(|| bake / gain) })
}
