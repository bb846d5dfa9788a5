use vdbake::{field::*, num::Level, scene::Scene, volume::*};
fn main() {
    let args: Vec<String> = std::env::args().collect();
    for name in args[2..].iter() {
        for res in args[1].split(',').map(|x| x.parse::<f64>().unwrap()) {
            let s =
                Scene::parse(&std::fs::read_to_string(format!("scenes/{name}.toml")).unwrap(), name).unwrap();
            let t = std::time::Instant::now();
            let f = Field::compile(&s, 0.0);
            let [lo, hi] = f.bounds().unwrap();
            let h = (hi - lo).max_element() / res;
            let lat = Lattice { voxel_size: h };
            let tc = t.elapsed();
            let t = std::time::Instant::now();
            let p = Plan::new(&f, lat, 1 << 34).unwrap();
            let tp = t.elapsed();
            let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
            let mut st = Store::default();
            let (tally, ph) = pool.install(|| bake(&f, &p, 0.0, Level::best(), &mut st, |_| ()).unwrap());
            println!(
                "{name} {res} h {h:.5} compile {tc:?} plan {tp:?} bricks {} kept {} active {} searched {} eval {:.3}s enc {:.3}s  ns/active {:.2} ns/searched {:.2} ns/inside {:.2} searched/inside {:.2}",
                p.bricks(),
                tally.bricks,
                tally.active_voxels,
                tally.searched_voxels,
                ph.evaluate,
                ph.encode,
                ph.evaluate * 1e9 / tally.active_voxels as f64,
                ph.evaluate * 1e9 / tally.searched_voxels as f64,
                ph.evaluate * 1e9 / tally.inside_voxels as f64,
                tally.searched_voxels as f64 / tally.inside_voxels as f64
            );
            std::hint::black_box(&st);
        }
    }
}
