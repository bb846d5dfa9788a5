//! What planning, encoding and writing take beside evaluation, what a second thread gains, and what a spool costs.

use std::time::Instant;

use cpu_time::ProcessTime;
use rayon::ThreadPool;
use serde_json::{Value, json};
use vdbake::field::{Field, Lattice};
use vdbake::formats::vdb::{
    self, Compression, Encoder, FileHeader, GridClass, GridHeader, Metadata, VdbGridBuilder, VectorType,
};
use vdbake::num::Level;
use vdbake::scene::Scene;
use vdbake::volume::{Plan, bake};

const ROUNDS: usize = 5;
const WAYS: [(&str, Compression); 3] =
    [("none", Compression::None), ("blosc", Compression::Blosc), ("zip", Compression::Zip)];

/// Seconds of one bake: by the clock, and of processors for each part.
#[derive(Debug, Clone, Copy)]
struct Times {
    clock: f64,
    plan: f64,
    evaluate: f64,
    encode: f64,
    write: f64,
}

/// Prints the figures for scenes at a resolution, each a ratio within the run, and gives the same as JSON.
pub(crate) fn run(scenes: &[&str], resolution: f64) -> Value {
    println!(
        "plan, encode and write over evaluation, processor time of one thread, medians of {ROUNDS} rounds"
    );
    println!("two threads over one, and a spool for all leaves over none: by the clock, of whole bakes");
    println!(
        "{:<12} {:<6} {:>7} {:>7} {:>7} {:>7} {:>12} {:>12} {:>7}",
        "scene", "codec", "plan", "encode", "write", "sum", "two threads", "processors", "spool"
    );
    let pool = |threads| rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
    let pools = [pool(1), pool(2)];
    let mut rows = vec![];
    for name in scenes {
        let path = format!("{}/scenes/{name}.toml", env!("CARGO_MANIFEST_DIR"));
        let text = std::fs::read_to_string(&path).expect("a scene of the project");
        let scene = Scene::parse(&text, &path).expect("a valid scene");
        for (codec, compression) in WAYS {
            let once =
                |pool: &ThreadPool, spool| pool.install(|| once(&scene, resolution, compression, spool));
            // In turn, so that a machine that drifts does so for all.
            let rounds: Vec<[Times; 3]> = (0..ROUNDS)
                .map(|_| [once(&pools[0], false), once(&pools[1], false), once(&pools[1], true)])
                .collect();
            let figure = |of: fn(&[Times; 3]) -> f64| median(rounds.iter().map(of).collect());
            let plan = figure(|[one, ..]| one.plan / one.evaluate);
            let encode = figure(|[one, ..]| one.encode / one.evaluate);
            let write = figure(|[one, ..]| one.write / one.evaluate);
            let sum = figure(|[one, ..]| (one.plan + one.encode + one.write) / one.evaluate);
            let threads = figure(|[one, two, _]| one.clock / two.clock);
            // What the second thread would gain were it not for memory and caches that are shared.
            let processors = figure(|[one, two, _]| {
                let all = |times: &Times| times.plan + times.evaluate + times.encode + times.write;
                all(two) / all(one)
            });
            let spool = figure(|[_, two, spooled]| two.clock / spooled.clock);
            println!(
                "{name:<12} {codec:<6} {plan:>7.3} {encode:>7.3} {write:>7.3} {sum:>7.3} {threads:>12.2} {processors:>12.2} {spool:>7.2}"
            );
            rows.push(json!({
                "scene": name, "resolution": resolution, "compression": codec,
                "plan_over_evaluate": plan, "encode_over_evaluate": encode, "write_over_evaluate": write,
                "sum_over_evaluate": sum, "two_threads_speedup": threads,
                "two_threads_processor_time": processors, "spooled_speed": spool,
            }));
        }
    }
    Value::Array(rows)
}

/// Bakes to a nameless file, as the program does but for the last step, waiting for the disk.
fn once(scene: &Scene, resolution: f64, compression: Compression, spool: bool) -> Times {
    let (clock, cpu) = (Instant::now(), ProcessTime::now());
    let field = Field::compile(scene);
    let [lo, hi] = field.bounds().expect("density");
    let lattice = Lattice { voxel_size: (hi - lo).max_element() / resolution };
    let plan = Plan::new(&field, lattice, u64::MAX).expect("a plan");
    let planned = cpu.elapsed().as_secs_f64();
    let file = || tempfile::tempfile().expect("a temporary file");
    let mut grid = VdbGridBuilder::with_encoder(Encoder::new(compression)).with_room(plan.bricks());
    if spool {
        grid = grid.with_spool(0, file());
    }
    let (_, phases) = bake(&field, &plan, 0.0, Level::best(), &mut grid, |_| ()).expect("in order");
    let baked = cpu.elapsed().as_secs_f64();
    let header = FileHeader { uuid: uuid::Uuid::nil(), metadata: Metadata::new() };
    let grid_header = GridHeader {
        name: "density".to_owned(),
        class: GridClass::FogVolume,
        vector_type: VectorType::Invariant,
        voxel_size: lattice.voxel_size,
        translation: [0.0; 3],
        metadata: Metadata::new(),
    };
    vdb::write(file(), &header, &[(&grid_header, &grid)]).expect("room on the disk");
    Times {
        clock: clock.elapsed().as_secs_f64(),
        plan: planned,
        evaluate: phases.evaluate,
        encode: phases.encode + phases.append,
        write: cpu.elapsed().as_secs_f64() - baked,
    }
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}
