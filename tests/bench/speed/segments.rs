//! What a segment costs in curves of many, along a helix that never comes near itself.
//!
//! Everything should be about flat: set-up for each segment, and evaluation for each lane. *lane* is the time for each
//! searched lane, beside bare noise, over that of the fewest segments; *setup* that of reading, compiling and planning a
//! segment over the evaluation of its voxels.
//!
//! Of a long curve, runs of neighbouring bricks are baked: a bake goes through them in this order too, so a segment's
//! tables are met many times before they leave the caches. Bricks strewn one by one would meet each of them cold.

use std::time::Duration;

use cpu_time::ProcessTime;
use vdbake::field::{Field, Lattice};
use vdbake::num::Level;
use vdbake::scene::Scene;
use vdbake::volume::{Plan, bake};

use crate::Options;
use crate::bare::bare_noise;
use crate::discard::Discard;
use crate::table::{Table, median};

const ROUNDS: usize = 5;
const BRICKS: usize = 8192;
/// Neighbouring bricks, in the order of the file.
const RUN: usize = 1024;

pub(crate) fn run(_: &Options) -> Table {
    let mut table = Table::new(&[
        "kind",
        "segments",
        "parse_us",
        "compile_us",
        "plan_us",
        "bricks",
        "ns_a_lane",
        "searched",
        "lane",
        "setup",
    ]);
    for kind in ["catmull-rom", "b-spline"] {
        let mut first_lane = None;
        for segments in [1, 10, 100, 1000, 10_000] {
            let row = measure(kind, segments);
            let first = *first_lane.get_or_insert(row.lane_over_bare);
            let each = |time: Duration| time.as_secs_f64() * 1e6 / f64::from(segments);
            table.push(vec![
                kind.into(),
                segments.into(),
                each(row.setup[0]).into(),
                each(row.setup[1]).into(),
                each(row.setup[2]).into(),
                row.bricks.into(),
                row.lane.into(),
                row.searched.into(),
                (row.lane_over_bare / first).into(),
                (row.setup.iter().sum::<Duration>().as_secs_f64() / row.evaluate).into(),
            ]);
        }
    }
    table
}

struct Row {
    /// Reading the scene, compiling, and planning.
    setup: [Duration; 3],
    bricks: usize,
    /// Seconds that all bricks take.
    evaluate: f64,
    /// Nanoseconds a searched lane.
    lane: f64,
    lane_over_bare: f64,
    searched: f64,
}

fn measure(kind: &str, segments: u32) -> Row {
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
    pool.install(|| {
        let started = ProcessTime::now();
        let scene = Scene::parse(&text, "long.toml").expect("a valid scene");
        let parsed = started.elapsed();
        let field = Field::compile(&scene);
        let compiled = started.elapsed();
        let mut plan = Plan::new(&field, lattice, u64::MAX).expect("a plan");
        let planned = started.elapsed();
        let bricks = plan.bricks();
        if bricks > BRICKS {
            plan = plan.part((0..BRICKS).map(|number| {
                let run = number / RUN;
                run * (bricks - RUN) / (BRICKS / RUN - 1) + number % RUN
            }));
        }
        let (mut evaluate, mut lane, mut lane_over_bare, mut searched) = (vec![], vec![], vec![], 0.0);
        for _ in 0..ROUNDS {
            // A few bricks are soon done.
            let repeats = (BRICKS / plan.bricks()).clamp(1, 100);
            let (mut seconds, mut lanes) = (0.0, 0.0);
            for _ in 0..repeats {
                let Ok((tally, phases)) = bake(&field, &plan, 0.0, Level::best(), &mut Discard, |_| ());
                seconds += phases.evaluate;
                lanes += tally.searched_voxels as f64;
                searched = tally.searched_voxels as f64 / tally.inside_voxels as f64;
            }
            evaluate.push(seconds / (repeats * plan.bricks()) as f64 * bricks as f64);
            lane.push(seconds * 1e9 / lanes);
            lane_over_bare.push(seconds * 1e9 / lanes / bare_noise(5));
        }
        Row {
            setup: [parsed, compiled - parsed, planned - compiled],
            bricks,
            evaluate: median(evaluate),
            lane: median(lane),
            lane_over_bare: median(lane_over_bare),
            searched,
        }
    })
}
