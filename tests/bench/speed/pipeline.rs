//! What planning, encoding and writing take beside evaluation, what a second thread gains, and what a spool costs.
//!
//! *plan*, *encode*, *write* and their *sum* are processor time of one thread over that of evaluation. *two threads* is the
//! speed of whole bakes by the clock over that of one, beside what processors take in all, which tells how much of the rest
//! memory and caches that are shared cost; *spool* the speed with all leaves spooled over that with none.

use std::time::Instant;

use cpu_time::ProcessTime;
use rayon::ThreadPool;
use vdbake::field::{Field, Lattice};
use vdbake::formats::vdb::{
    self, Compression, Encoder, FileHeader, GridClass, GridHeader, Metadata, VdbGridBuilder, VectorType,
};
use vdbake::num::Level;
use vdbake::scene::Scene;
use vdbake::volume::{Plan, bake};

use crate::Options;
use crate::table::{Table, median};

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

pub(crate) fn run(options: &Options) -> Table {
    let mut table = Table::new(&[
        "scene",
        "resolution",
        "codec",
        "plan",
        "encode",
        "write",
        "sum",
        "two_threads",
        "processors",
        "spool",
    ]);
    let pool = |threads| rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
    let pools = [pool(1), pool(2)];
    let resolution = options.given.first().copied().unwrap_or(512.0);
    for name in ["tornado", "solar_flare", "galaxy"] {
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
            table.push(vec![
                name.into(),
                resolution.into(),
                codec.into(),
                figure(|[one, ..]| one.plan / one.evaluate).into(),
                figure(|[one, ..]| one.encode / one.evaluate).into(),
                figure(|[one, ..]| one.write / one.evaluate).into(),
                figure(|[one, ..]| (one.all() - one.evaluate) / one.evaluate).into(),
                figure(|[one, two, _]| one.clock / two.clock).into(),
                figure(|[one, two, _]| two.all() / one.all()).into(),
                figure(|[_, two, spooled]| two.clock / spooled.clock).into(),
            ]);
        }
    }
    table
}

impl Times {
    fn all(&self) -> f64 {
        self.plan + self.evaluate + self.encode + self.write
    }
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
    let output = file();
    fs4::FileExt::allocate(&output, grid.encoded_bytes()).expect("room on the disk");
    vdb::write(&output, &header, &[(&grid_header, &grid)]).expect("room on the disk");
    // Before the nameless file is closed: it goes then, which takes the system a good part of what writing did.
    Times {
        clock: clock.elapsed().as_secs_f64(),
        plan: planned,
        evaluate: phases.evaluate,
        encode: phases.encode + phases.append,
        write: cpu.elapsed().as_secs_f64() - baked,
    }
}
