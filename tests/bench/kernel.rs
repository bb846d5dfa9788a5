//! Nanoseconds per voxel inside a tube beside the bare noise of as many octaves, in one run and on one thread:
//! `cargo bench --bench kernel [RESOLUTION]`.
//!
//! The last column is what the mass at rest takes beside that, in percent.
//!
//! Machines differ and drift, so the ratio is the figure to keep. Medians of interleaved rounds, processor time.

#![allow(clippy::print_stdout, reason = "a bench prints its figures")]

mod discard;

use cpu_time::ThreadTime;
use vdbake::field::{Field, Lattice};
use vdbake::noise::Octave;
use vdbake::num::{Level, Real, WithLevel, with_level};
use vdbake::scene::Scene;
use vdbake::volume::{Plan, RestMass, Tally, bake};

use discard::Discard;

const ROUNDS: usize = 7;
const POINTS: usize = 2048;

fn main() {
    let resolution =
        std::env::args().skip(1).find_map(|argument| argument.parse::<f64>().ok()).unwrap_or(512.0);
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("one thread");
    println!("{}, resolution {resolution}, medians of {ROUNDS} rounds", Level::best().name());
    println!(
        "{:<12} {:>12} {:>9} {:>14} {:>14} {:>8} {:>10} {:>7} {:>7}",
        "scene",
        "in the tube",
        "searched",
        "ns a voxel",
        "bare fBm, ns",
        "ratio",
        "ns/octave",
        "kept",
        "mass, %"
    );
    for (name, octaves) in [("tornado", 5), ("solar_flare", 5), ("galaxy", 7)] {
        let path = format!("{}/scenes/{name}.toml", env!("CARGO_MANIFEST_DIR"));
        let text = std::fs::read_to_string(&path).expect("a scene of the project");
        let scene = Scene::parse(&text, &path).expect("a valid scene");
        let field = Field::compile(&scene);
        let [lo, hi] = field.bounds().expect("density");
        let lattice = Lattice { voxel_size: (hi - lo).max_element() / resolution };
        let plan = Plan::new(&field, lattice, u64::MAX).expect("a plan");
        let (mut whole, mut bare, mut mass) = (Vec::new(), Vec::new(), Vec::new());
        let mut tally = Tally::default();
        for _ in 0..ROUNDS {
            let Ok((found, phases)) =
                pool.install(|| bake(&field, &plan, 0.0, Level::best(), &mut Discard, |_| ()));
            whole.push(phases.evaluate * 1e9 / found.inside_voxels as f64);
            bare.push(bare_noise(octaves));
            let at_rest = pool.install(|| {
                let started = ThreadTime::now();
                std::hint::black_box(RestMass::beside(&field, &scene, lattice, &found, Level::best()));
                started.elapsed().as_secs_f64()
            });
            mass.push(100.0 * at_rest / phases.evaluate);
            tally = found;
        }
        let (whole, bare) = (median(whole), median(bare));
        let inside = tally.inside_voxels as f64;
        println!(
            "{name:<12} {inside:>12} {:>9.2} {whole:>14.1} {bare:>14.1} {:>8.2} {:>10.2} {:>7.2} {:>7.1}",
            tally.searched_voxels as f64 / inside,
            whole / bare,
            bare / f64::from(octaves),
            tally.bricks as f64 / plan.bricks() as f64,
            median(mass),
        );
    }
}

struct Bare<'a> {
    octaves: &'a [Octave<f32>],
    points: &'a [Vec<f32>; 3],
    out: &'a mut [f32],
}

impl WithLevel for Bare<'_> {
    type Output = ();
    #[inline(always)]
    fn run<R: Real<Scalar = f32>>(self, token: R::Token) {
        for first in (0..POINTS).step_by(R::LANES) {
            let p = [
                R::load(token, &self.points[0][first..]),
                R::load(token, &self.points[1][first..]),
                R::load(token, &self.points[2][first..]),
            ];
            let mut sum = R::constant(token, 0.0);
            for octave in self.octaves {
                sum = sum + octave.value(token, p);
            }
            sum.store(&mut self.out[first..]);
        }
    }
}

#[inline(never)]
fn sum(bare: Bare) {
    with_level(Level::best(), bare);
}

/// Nanoseconds a point of a fractal sum over points scattered in [-20, 20)^3.
fn bare_noise(octaves: u32) -> f64 {
    const REPEATS: usize = 400;
    let mut state = 1_u64;
    let mut next = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (f32::from(u16::try_from(state >> 48).expect("sixteen bits")) / 65_536.0 - 0.5) * 40.0
    };
    let points = [0, 1, 2].map(|_| (0..POINTS).map(|_| next()).collect::<Vec<f32>>());
    let octaves: Vec<Octave<f32>> =
        (0..octaves).map(|k| Octave::new([0.3, 0.2, 0.1], [f64::from(1 << k); 3], k, 0.5)).collect();
    let mut out = vec![0.0; POINTS];
    let started = ThreadTime::now();
    for _ in 0..REPEATS {
        sum(Bare { octaves: &octaves, points: &points, out: &mut out });
        std::hint::black_box(&out);
    }
    started.elapsed().as_secs_f64() * 1e9 / (REPEATS * POINTS) as f64
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}
