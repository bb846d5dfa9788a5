//! What a segment costs in curves of 10 to 10 000 of them, along a helix that never comes near itself, in one run:
//! `cargo bench --bench long`.
//!
//! Everything should be about flat: set-up in microseconds a segment, evaluation in nanoseconds a voxel inside the tube, of
//! processor time.

#![allow(clippy::print_stdout, reason = "a bench prints its figures")]

mod discard;

use std::time::Duration;

use cpu_time::ProcessTime;
use vdbake::field::{Field, Lattice};
use vdbake::num::Level;
use vdbake::scene::Scene;
use vdbake::volume::{Plan, bake};

use discard::Discard;

fn main() {
    println!(
        "{:<12} {:>8} {:>12} {:>12} {:>12} {:>10} {:>12} {:>11}",
        "kind", "segments", "parse, us", "compile, us", "plan, us", "bricks", "bake, us", "ns a voxel"
    );
    for kind in ["catmull-rom", "b-spline"] {
        for segments in [10_u32, 100, 1000, 10_000] {
            row(kind, segments);
        }
    }
}

fn row(kind: &str, segments: u32) {
    let point = |i: u32| {
        let angle = 0.5 * f64::from(i);
        format!("[{}, {}, {}]", libm::cos(angle), libm::sin(angle), 0.024 * f64::from(i))
    };
    let points: Vec<String> = (0..=segments).map(point).collect();
    let text = format!(
        "[[tube]]\ncurve = {{ kind = \"{kind}\", points = [{}] }}\nradius = 0.1\nstretch = false\n[[tube.layer]]\n",
        points.join(", ")
    );
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("one thread");
    let lattice = Lattice { voxel_size: 0.0125 };
    let started = ProcessTime::now();
    let scene = Scene::parse(&text, "long.toml").expect("a valid scene");
    let parsed = started.elapsed();
    let field = Field::compile(&scene);
    let compiled = started.elapsed();
    let (tally, planned, bricks) = pool.install(|| {
        let plan = Plan::new(&field, lattice, u64::MAX).expect("a plan");
        let planned = started.elapsed();
        let Ok((tally, _)) = bake(&field, &plan, 0.0, Level::best(), &mut Discard, |_| ());
        (tally, planned, plan.bricks())
    });
    let baked = started.elapsed();
    let each = |time: Duration| time.as_secs_f64() * 1e6 / f64::from(segments);
    println!(
        "{kind:<12} {segments:>8} {:>12.1} {:>12.1} {:>12.1} {bricks:>10} {:>12.1} {:>11.2}",
        each(parsed),
        each(compiled - parsed),
        each(planned - compiled),
        each(baked - planned),
        (baked - planned).as_secs_f64() * 1e9 / tally.inside_voxels as f64,
    );
}
