//! The evaluation of scenes beside bare noise.
//!
//! - *searched*: lanes that enter the search for feet, over voxels inside the tube (counted once for every piece);
//! - *whole over bare*: time of narrowing and evaluation for each voxel inside, over that of bare noise of all the scene's
//!   octaves at a point;
//! - *narrow*: narrowing's part of that time;
//! - *lane*: time for each searched lane, over the same at the first resolution;
//! - *kept*: bricks with active voxels, over those planned;
//! - *mass*: time of the mass at rest, over the evaluation's; only where all bricks are evaluated.
//!
//! Where another program runs on the same core, bare noise slows down more than the rest does, and *whole over bare* falls: compare
//! figures of like `bare_ns_an_octave`.

use cpu_time::ThreadTime;
use serde_json::Value;
use vdbake::field::{Field, Lattice, Region};
use vdbake::num::Level;
use vdbake::scene::Scene;
use vdbake::volume::{Plan, RestMass, bake};

use crate::Options;
use crate::bare::bare_noise;
use crate::discard::Discard;
use crate::table::{Table, median};

const ROUNDS: usize = 7;
/// Bricks that stand for all where there are more.
const BRICKS: usize = 16_384;
/// Fewer bricks are evaluated several times in a round: caches are cold at first, and the clock's steps count.
const ENOUGH: usize = 4096;
const SCENES: [(&str, u32); 3] = [("tornado", 5), ("solar_flare", 5), ("galaxy", 7)];

pub(crate) fn run(options: &Options) -> Table {
    let mut table = Table::new(&[
        "scene",
        "resolution",
        "ns_a_voxel",
        "bare_ns_an_octave",
        "searched",
        "whole_over_bare",
        "narrow",
        "lane",
        "kept",
        "mass",
    ]);
    for (name, octaves) in SCENES {
        let path = format!("{}/scenes/{name}.toml", env!("CARGO_MANIFEST_DIR"));
        let text = std::fs::read_to_string(&path).expect("a scene of the project");
        let scene = Scene::parse(&text, &path).expect("a valid scene");
        let mut first_lane = None;
        for &resolution in &options.resolutions {
            let row = measure(&scene, resolution, octaves);
            // Beside noise, so that a machine that slows down meanwhile does not show.
            let lane = row.ratio / row.searched;
            let first = *first_lane.get_or_insert(lane);
            table.push(vec![
                name.into(),
                resolution.into(),
                row.whole.into(),
                (row.bare / f64::from(octaves)).into(),
                row.searched.into(),
                row.ratio.into(),
                row.narrow.into(),
                (lane / first).into(),
                row.kept.into(),
                row.mass.map_or(Value::Null, Value::from),
            ]);
        }
    }
    table
}

struct Row {
    /// Nanoseconds a voxel.
    whole: f64,
    bare: f64,
    /// Of the two in one round.
    ratio: f64,
    searched: f64,
    narrow: f64,
    kept: f64,
    /// Where all bricks were evaluated.
    mass: Option<f64>,
}

fn measure(scene: &Scene, resolution: f64, octaves: u32) -> Row {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("one thread");
    let field = Field::compile(scene);
    let [lo, hi] = field.bounds().expect("density");
    let lattice = Lattice { voxel_size: (hi - lo).max_element() / resolution };
    let mut plan = Plan::new(&field, lattice, u64::MAX).expect("a plan");
    let is_sample = plan.bricks() > BRICKS;
    if is_sample {
        plan = plan.sample(BRICKS);
    }
    let repeats = (ENOUGH / plan.bricks()).max(1);
    let (mut whole, mut bare, mut narrow, mut mass) = (vec![], vec![], vec![], vec![]);
    let (mut searched, mut kept) = (0.0, 0.0);
    let mut region = Region::<f32>::default();
    for _ in 0..ROUNDS {
        let before = bare_noise(octaves);
        let bakes: Vec<_> = (0..repeats)
            .map(|_| {
                let Ok(bake) = pool.install(|| bake(&field, &plan, 0.0, Level::best(), &mut Discard, |_| ()));
                bake
            })
            .collect();
        let evaluate = bakes.iter().map(|(_, phases)| phases.evaluate).sum::<f64>() / repeats as f64;
        let found = &bakes[0].0;
        whole.push(evaluate * 1e9 / found.inside_voxels as f64);
        bare.push(0.5 * (before + bare_noise(octaves)));
        let started = ThreadTime::now();
        for brick in (0..repeats).flat_map(|_| 0..plan.bricks()) {
            plan.narrow(&field, brick, &mut region);
        }
        narrow.push(started.elapsed().as_secs_f64() / repeats as f64 / evaluate);
        if !is_sample {
            mass.push(pool.install(|| {
                let started = ThreadTime::now();
                std::hint::black_box(RestMass::beside(&field, scene, lattice, found, Level::best()));
                started.elapsed().as_secs_f64() / evaluate
            }));
        }
        searched = found.searched_voxels as f64 / found.inside_voxels as f64;
        kept = found.bricks as f64 / plan.bricks() as f64;
    }
    Row {
        ratio: median(whole.iter().zip(&bare).map(|(whole, bare)| whole / bare).collect()),
        whole: median(whole),
        bare: median(bare),
        searched,
        narrow: median(narrow),
        kept,
        mass: (!is_sample).then(|| median(mass)),
    }
}
