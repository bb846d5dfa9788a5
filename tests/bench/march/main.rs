//! What do pictures cost, and how good are they?
//!
//!     cargo bench --bench march [-- [--json] [SECTION...] [SCENE...] [WIDTHxHEIGHT]]
//!
//! Sections, each a table:
//!
//! - *paper*: three scenes after those of Moinet, "Sculpting procedural noise" (2022), at 960 x 540 pixels and at their own
//!   resolution: as they are, with one octave of noise, without noise, and with steps two and four times as long; beside the
//!   same ratios of that text, of the middles of the frame rates that it gives. That program marches by the step alone;
//!   this one divides steps where it is dense, so its longer steps gain less, and lose less.
//! - *methods*: the first of these rows by each method, with three steps, and with each way to find where rays enter.
//! - *baked*: voxels beside the scene itself.
//! - *viewer*: the tornado's voxels at a resolution of 512 with a sun's shadows, by this program and by OpenVDB's `vdb_render`
//!   with the same file, camera and optical thickness (`eval "$(scripts/oracles)"` first), without reading and writing. Each
//!   error is to a picture by the same program, as exact as may be, over the root mean square of that. `--step 2` draws eight
//!   voxels as one.
//!
//! Times are of the marching of one sample a pixel by the clock, on all threads, medians of rounds after a first one that
//! is not counted (shadows and what is seen where are found once for all samples, and are not in it). *error* is the root
//! mean square of the difference in radiance to a picture with steps of an eighth of a voxel, over the root mean square
//! radiance of that. *evaluated* counts places where the density was evaluated, by the thousand, and *over inside* those
//! over the ones among them that are inside a tube. Machines differ and drift: ratios of one run are the figures to keep.

#![allow(clippy::print_stdout, reason = "a bench prints its figures")]
#![allow(clippy::cast_precision_loss, reason = "counts")]

mod scenes;
#[path = "../table.rs"]
mod table;
mod viewer;

use std::time::Instant;

use glam::DVec3;
use serde_json::Value;
use vdbake::march::{
    Camera, Entry, Film, Integrator, Marching, Medium, Method, Optics, Picture, Procedural, Quality, Shadow,
};
use vdbake::num::Level;

use scenes::Drawn;
use table::{Section, Table, median, show};
use viewer::viewer;

const ROUNDS: usize = 5;
/// The step of the picture that others are compared with, in voxels.
const FINE: f64 = 0.125;
/// A scene, and how many frames a second that text has of it: as it is, with one octave, without noise, with steps of two
/// and of four.
const SCENES: [(&str, [[f64; 2]; 5]); 3] = [
    ("tornado", [[140.0, 190.0], [220.0, 230.0], [230.0, 240.0], [215.0, 230.0], [250.0, 260.0]]),
    ("solar_flare", [[60.0, 65.0], [120.0, 125.0], [140.0, 150.0], [105.0, 110.0], [160.0, 165.0]]),
    ("galaxy", [[25.0, 27.0], [85.0, 90.0], [130.0, 135.0], [45.0, 50.0], [88.0, 90.0]]),
];

const SECTIONS: [Section<Options>; 4] =
    [("paper", paper), ("methods", methods), ("baked", baked), ("viewer", viewer)];

/// What the command line asks for.
struct Options {
    scenes: Vec<String>,
    size: [usize; 2],
}

impl Options {
    fn scenes(&self) -> impl Iterator<Item = &'static (&'static str, [[f64; 2]; 5])> {
        let wanted = |name: &str| self.scenes.is_empty() || self.scenes.iter().any(|scene| scene == name);
        SCENES.iter().filter(move |(name, _)| wanted(name))
    }
}

fn main() {
    let mut options = Options { scenes: vec![], size: [960, 540] };
    let (mut json, mut asked) = (false, vec![]);
    for argument in std::env::args().skip(1) {
        let size = argument.split_once('x').map(|(width, height)| (width.parse(), height.parse()));
        match (argument.as_str(), size) {
            ("--json", _) => json = true,
            // What cargo says to every bench.
            ("--bench", _) => {}
            (_, Some((Ok(width), Ok(height)))) => options.size = [width, height],
            (name, _) if SCENES.iter().any(|(known, _)| *known == name) => options.scenes.push(argument),
            (name, _) if SECTIONS.iter().any(|(known, _)| *known == name) => asked.push(argument),
            (name, _) => panic!("no section and no scene `{name}`"),
        }
    }
    show(&SECTIONS, &asked, &options, json);
}

/// A picture's first sample, the milliseconds that one takes, and the places evaluated for the first.
struct Taken {
    film: Film,
    time: f64,
    places: Option<[u64; 2]>,
}

fn take(medium: &Medium<'_>, camera: Camera, optics: &Optics, size: [usize; 2], rounds: usize) -> Taken {
    let cutoff = if rounds == 0 { 1e-9 } else { 1e-4 };
    let (shadow, integrator) = (Shadow::Cached(2.0), Integrator::Single);
    let quality = Quality { size, samples: 1, cutoff, shadow, integrator };
    let mut picture = Picture::new(medium, camera, optics, quality, Level::best());
    picture.sample(|_| true);
    let (film, places) = (picture.film().clone(), medium.places());
    let times = (0..rounds).map(|_| {
        let started = Instant::now();
        picture.sample(|_| true);
        started.elapsed().as_secs_f64() * 1e3
    });
    let times: Vec<f64> = times.collect();
    Taken { film, time: if times.is_empty() { 0.0 } else { median(times) }, places }
}

/// Of a scene with steps of so many voxels; without rounds as exactly as may be.
fn march(drawn: &Drawn, marching: Marching, step: f64, size: [usize; 2], rounds: usize) -> Taken {
    let procedural =
        Procedural::new(&drawn.field, drawn.lattice, step, u64::MAX).expect("a plan").with(marching);
    take(&Medium::Procedural(procedural), drawn.camera(size), &drawn.optics, size, rounds)
}

/// Root mean square of the difference in radiance, over that of the truth.
fn error(film: &Film, truth: &Film) -> f64 {
    let (mut wrong, mut all) = (0.0, 0.0);
    for (found, truth) in film.radiance.iter().zip(&truth.radiance) {
        let (found, truth) = (DVec3::from(*found), DVec3::from(*truth));
        wrong += (found - truth).length_squared();
        all += truth.length_squared();
    }
    (wrong / all).sqrt()
}

/// Thousands evaluated, and those over what is inside.
fn places(taken: &Taken) -> [Value; 2] {
    let Some([evaluated, inside]) = taken.places else { return [Value::Null, Value::Null] };
    [(evaluated / 1000).into(), (evaluated as f64 / inside as f64).into()]
}

/// What is changed: its name, the scene's text, the step.
type Row = (&'static str, fn(&str) -> String, f64);

fn paper(options: &Options) -> Table {
    let mut table = Table::new(&[
        "scene",
        "what",
        "ms",
        "over_normal",
        "paper_over_normal",
        "error",
        "evaluated",
        "over_inside",
    ]);
    for (name, rates) in options.scenes() {
        let rows: [Row; 5] = [
            ("normal", str::to_owned, 1.0),
            ("simpler noise", scenes::with_one_octave, 1.0),
            ("no noise", scenes::without_noise, 1.0),
            ("double step", str::to_owned, 2.0),
            ("quadruple step", str::to_owned, 4.0),
        ];
        let middle = |[low, high]: [f64; 2]| 0.5 * (low + high);
        let mut normal = None;
        for ((what, change, step), rate) in rows.into_iter().zip(rates) {
            let drawn = Drawn::new(name, change);
            let truth = march(&drawn, Marching::default(), FINE, options.size, 0);
            let taken = march(&drawn, Marching::default(), step, options.size, ROUNDS);
            let [evaluated, over] = places(&taken);
            table.push(vec![
                (*name).into(),
                what.into(),
                taken.time.into(),
                (taken.time / *normal.get_or_insert(taken.time)).into(),
                (middle(rates[0]) / middle(*rate)).into(),
                exponent(error(&taken.film, &truth.film)),
                evaluated,
                over,
            ]);
        }
    }
    table
}

/// Small numbers, to read.
fn exponent(x: f64) -> Value {
    format!("{x:.1e}").into()
}

fn methods(options: &Options) -> Table {
    let mut table = Table::new(&[
        "scene",
        "method",
        "entry",
        "step",
        "ms",
        "over_normal",
        "error",
        "evaluated",
        "over_inside",
    ]);
    for (name, _) in options.scenes() {
        let drawn = Drawn::new(name, str::to_owned);
        let truth = march(&drawn, Marching::default(), FINE, options.size, 0);
        let mut normal = None;
        let mut row = |method: &str, how: &str, marching: Marching, step: f64| {
            let taken = march(&drawn, marching, step, options.size, ROUNDS);
            let [evaluated, over] = places(&taken);
            table.push(vec![
                (*name).into(),
                method.into(),
                how.into(),
                step.into(),
                taken.time.into(),
                (taken.time / *normal.get_or_insert(taken.time)).into(),
                exponent(error(&taken.film, &truth.film)),
                evaluated,
                over,
            ]);
        };
        let of = |method: Method, entry: Entry, growth: f64| Marching {
            method,
            growth,
            entry,
            ..Marching::default()
        };
        for (text, method) in
            [("gauss", Method::Gauss), ("midpoint", Method::Midpoint), ("alpha", Method::Alpha)]
        {
            for step in [1.0, 2.0, 4.0] {
                row(text, "cones", of(method, Entry::Cones, 0.0), step);
            }
        }
        for (text, entry) in [
            ("constant", Entry::Constant),
            ("converging", Entry::Converging),
            ("sphere tracing", Entry::SphereTracing),
        ] {
            row("alpha", text, of(Method::Alpha, entry, 0.0), 1.0);
        }
        for (text, map_every) in [("midpoint, map every 2", 2), ("midpoint, map every 4", 4)] {
            let marching = Marching { method: Method::Midpoint, map_every, ..Marching::default() };
            row(text, "cones", marching, 1.0);
        }
        row("alpha, growing by 1 %", "cones", of(Method::Alpha, Entry::Cones, 0.01), 1.0);
    }
    table
}

fn baked(options: &Options) -> Table {
    let mut table =
        Table::new(&["scene", "bake_ms", "procedural_ms", "baked_ms", "baked_over_procedural", "error"]);
    for (name, _) in options.scenes() {
        let drawn = Drawn::new(name, str::to_owned);
        let truth = march(&drawn, Marching::default(), FINE, options.size, 0);
        let procedural = march(&drawn, Marching::default(), 1.0, options.size, ROUNDS);
        let (voxels, time) = drawn.bake();
        let medium = Medium::Baked(voxels);
        let baked = take(&medium, drawn.camera(options.size), &drawn.optics, options.size, ROUNDS);
        table.push(vec![
            (*name).into(),
            time.into(),
            procedural.time.into(),
            baked.time.into(),
            (baked.time / procedural.time).into(),
            exponent(error(&baked.film, &truth.film)),
        ]);
    }
    table
}
