//! What anti-aliasing gains and costs, beside point samples at the voxels' centres:
//! `cargo bench --bench antialias`.
//!
//! - *flicker*: the scene is baked, and baked again moved by half a voxel along every axis; both are filtered trilinearly at
//!   the same points of the scene. Root mean square difference over root mean square density.
//! - *cells*: root mean square error of stored values against the mean of the density over 12^3 places of each cell, over
//!   the same density, of voxels in planned bricks.
//! - *points*: that of the filtered bake against the density at points.
//! - *mass*: root mean square of the relative error over eight places of the lattice, against the closed form.
//! - *voxels*: those that store a mean, as a part of the active.
//! - *lanes*: places evaluated, anti-aliased over not.
//! - *time*: processor time of the evaluation, anti-aliased over not.

#![allow(clippy::print_stdout, reason = "a bench prints its figures")]
#![allow(clippy::cast_possible_truncation, clippy::cast_precision_loss, reason = "small numbers")]

use std::collections::HashMap;
use std::f64::consts::PI;

use glam::DVec3;
use vdbake::field::{Field, Lattice};
use vdbake::num::Level;
use vdbake::scene::Scene;
use vdbake::volume::{Phases, Plan, Store, Tally, bake, density_at};

const RADIUS: f64 = 0.25;
const POINTS: usize = 40_000;
const CELLS: usize = 1500;
const FINE: usize = 12;
/// `max(0, noise + 0.15) * 2`, as in `scenes/tornado.toml`.
const NOISE: &str = "[[tube.layer]]\nfrequency = [2.5, 2.5, 1.2]\nthreshold = -0.15\nmultiplier = 2.0\n";

/// A kind of scene: its name, keys of the tube, and the part of its cylinder's volume that its mass is, where known.
type Kind = (&'static str, String, Option<f64>);

fn kinds() -> Vec<Kind> {
    let hard = "caps = \"flat\"\nenvelope = { radial = \"hard\" }\n";
    // The mean over a disc of 1 - smoothstep(0.9, 1, x): 2 times the integral of x (1 - t^2 (3 - 2 t)), t = 10 x - 9.
    let edge = 0.81 + 2.0 * 0.1 * (0.9 * 0.5 + 0.1 * 0.15);
    vec![
        ("hard", hard.into(), Some(1.0)),
        ("hard, noise", format!("{hard}{NOISE}"), None),
        ("edge 0.1", "caps = \"flat\"\nenvelope = { radial = 0.1 }\n".into(), Some(edge)),
        ("sectors", format!("{hard}twist = 0.5\n[[tube.layer]]\nnoise = \"sectors\"\n"), Some(0.5)),
        ("flat caps", "caps = \"flat\"\n".into(), Some(1.0 / 3.0)),
        ("smooth", String::new(), None),
        ("smooth, noise", NOISE.into(), None),
    ]
}

/// A bent tube, moved.
fn scene(keys: &str, moved: DVec3, antialias: &str) -> Scene {
    let points = [[0.013, 0.021, 0.007], [0.61, 0.17, 0.8], [0.03, -0.05, 1.57]]
        .map(|point| format!("{:?}", (DVec3::from(point) + moved).to_array()))
        .join(", ");
    let text = format!(
        "[bake]\nantialias = \"{antialias}\"\n[[tube]]\ncurve = {{ points = [{points}] }}\nradius = {RADIUS}\n{keys}"
    );
    Scene::parse(&text, "bench.toml").unwrap_or_else(|errors| panic!("{errors}"))
}

struct Baked {
    values: HashMap<[i32; 3], [f32; 512]>,
    tally: Tally,
    phases: Phases,
}

impl Baked {
    fn new(scene: &Scene, h: f64) -> Baked {
        let field = Field::compile(scene);
        let plan = Plan::new(&field, Lattice { voxel_size: h }, 1 << 32).expect("a plan");
        let mut store = Store::default();
        let Ok((tally, phases)) = bake(&field, &plan, 0.0, Level::best(), &mut store, |_| ());
        let values = store.bricks().iter().map(|brick| (brick.origin, brick.values)).collect();
        Baked { values, tally, phases }
    }

    fn at(&self, voxel: [i32; 3]) -> f64 {
        let [x, y, z] = voxel.map(|i| (i & 7) as usize);
        self.values.get(&voxel.map(|i| i & !7)).map_or(0.0, |values| f64::from(values[64 * x + 8 * y + z]))
    }

    /// Filtered trilinearly.
    fn between(&self, point: DVec3, h: f64) -> f64 {
        let at = point / h - DVec3::splat(0.5);
        let (first, t) = (at.floor(), at - at.floor());
        let mut sum = 0.0;
        for corner in 0..8 {
            let side = [corner >> 2, corner >> 1 & 1, corner & 1];
            let mut weight = 1.0;
            for axis in 0..3 {
                weight *= if side[axis] == 1 { t[axis] } else { 1.0 - t[axis] };
            }
            sum += weight * self.at([0, 1, 2].map(|axis| first[axis] as i32 + side[axis]));
        }
        sum
    }

    fn mass(&self, h: f64) -> f64 {
        self.tally.total.sum() * h * h * h
    }
}

/// splitmix64 (Steele, Lea, Flood 2014), uniform in [0, 1).
fn random(state: &mut u64) -> f64 {
    *state = state.wrapping_add(0x9E37_79B9_7F4A_7C15);
    let z = (*state ^ (*state >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    let z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
}

/// Root mean square of `a - b` over that of `b`.
fn difference(a: &[f64], b: &[f64]) -> f64 {
    let square = |sum: f64, (a, b): (&f64, &f64)| sum + (a - b) * (a - b);
    let differences = a.iter().zip(b).fold(0.0, square);
    (differences / b.iter().map(|b| b * b).sum::<f64>()).sqrt()
}

fn main() {
    println!(
        "{:<14} {:>4}  flicker        cells          points         mass               voxels  lanes   time",
        "", "r/h"
    );
    for (name, keys, share) in kinds() {
        for ratio in [4.0, 8.0, 16.0] {
            let h = RADIUS / ratio;
            let lattice = Lattice { voxel_size: h };
            let plain = Field::compile(&scene(&keys, DVec3::ZERO, "off"));
            let [lo, hi] = plain.bounds().expect("density");
            let mut state = 1;
            let mut unit = || DVec3::new(random(&mut state), random(&mut state), random(&mut state));
            let points: Vec<DVec3> = (0..POINTS).map(|_| lo + (hi - lo) * unit()).collect();
            let exact = |points: &[DVec3]| -> Vec<f64> {
                let found = density_at(&plain, lattice, points, Level::best(), 1 << 32).expect("a plan");
                found.into_iter().map(f64::from).collect()
            };
            let truth = exact(&points);
            let cells: Vec<DVec3> = (0..CELLS).map(|_| ((lo + (hi - lo) * unit()) / h).floor()).collect();
            let fine: Vec<DVec3> = cells
                .iter()
                .flat_map(|cell| {
                    (0..FINE * FINE * FINE).map(move |i| {
                        let place = [i / FINE / FINE, i / FINE % FINE, i % FINE];
                        (*cell + DVec3::from(place.map(|i| (i as f64 + 0.5) / FINE as f64))) * h
                    })
                })
                .collect();
            let means: Vec<f64> = exact(&fine)
                .chunks(FINE * FINE * FINE)
                .map(|cell| cell.iter().sum::<f64>() / cell.len() as f64)
                .collect();
            let mass =
                share.map(|share| share * PI * RADIUS * RADIUS * length(&scene(&keys, DVec3::ZERO, "off")));
            let found = ["off", "adaptive"].map(|antialias| {
                let bake = |moved: f64| Baked::new(&scene(&keys, DVec3::splat(moved * h), antialias), h);
                let here = bake(0.0);
                let moved = bake(0.5);
                let filtered: Vec<f64> = points.iter().map(|p| here.between(*p, h)).collect();
                let again: Vec<f64> =
                    points.iter().map(|p| moved.between(*p + DVec3::splat(0.5 * h), h)).collect();
                let stored: Vec<f64> =
                    cells.iter().map(|cell| here.at(cell.to_array().map(|x| x as i32))).collect();
                let masses: Vec<f64> = (0..8)
                    .map(|i| {
                        let at = DVec3::from([1.0, 0.618, 0.414].map(|x| (x * f64::from(i)) % 1.0 * h));
                        Baked::new(&scene(&keys, at, antialias), h).mass(h)
                    })
                    .collect();
                let mean = masses.iter().sum::<f64>() / 8.0;
                let error = difference(&masses, &[mass.unwrap_or(mean); 8]);
                let mut times: Vec<f64> = (0..5).map(|_| bake(0.0).phases.evaluate).collect();
                times.sort_by(f64::total_cmp);
                (
                    [
                        difference(&again, &filtered),
                        difference(&stored, &means),
                        difference(&filtered, &truth),
                        error,
                    ],
                    here.tally,
                    times[2],
                )
            });
            let [off, adaptive] = &found;
            let pair = |i: usize| format!("{:.4} {:.4}", off.0[i], adaptive.0[i]);
            println!(
                "{name:<14} {ratio:>4}  {}  {}  {}  {:.1e} {:.1e}{}  {:>5.1}%  {:>5.2}  {:>5.2}",
                pair(0),
                pair(1),
                pair(2),
                off.0[3],
                adaptive.0[3],
                if mass.is_some() { " " } else { "*" },
                100.0 * adaptive.1.antialiased_voxels as f64 / adaptive.1.active_voxels as f64,
                adaptive.1.searched_voxels as f64 / off.1.searched_voxels as f64,
                adaptive.2 / off.2,
            );
        }
    }
    println!("* spread of the mass: no closed form");
}

fn length(scene: &Scene) -> f64 {
    scene.tubes()[0].curve.length()
}
