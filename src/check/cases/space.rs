//! Where a scene is, how large it is, and how large its voxels are.

use super::{BENT, NOISE, STRAIGHT, quadratic};
use crate::check::case::{Case, Look, Verdict, evaluates, probe, refuses, scene};
use crate::check::probe::worst;
use crate::field::{Field, Lattice};
use crate::num::Level;
use crate::volume::{Plan, Store, bake};

const GROUP: &str = "space";
const MOVED: &str =
    "the same values within 1e-6 of the peak: places in a brick are differences of exact ones";

pub(super) fn cases() -> Vec<Case> {
    let case = |name: &str, expected: &str, text: String, look: Look| {
        Case::new(GROUP, name, expected, move || evaluates(&text, look))
    };
    let bent = |scale: f64, shift: f64| {
        let points = BENT.map(|point| point.map(|x| x * scale + shift));
        quadratic(&points, &format!("radius = {:?}\n{NOISE}", 0.25 * scale))
    };
    let mut cases = vec![
        Case::new(GROUP, "moved by 2^20 m, whole bricks of voxels", MOVED, || moved(20)),
        Case::new(GROUP, "moved by 2^25 m, whole bricks of voxels", MOVED, || moved(25)),
        Case::new(GROUP, "scaled by 2^20 and 2^-20", "the same values to the bit", scaled),
        case(
            "moved by 1e6 m",
            "the definition within 4e-6 of the peak: double precision places it to 1e-10 m",
            bent(1.0, 1e6),
            Look::at(0.02),
        ),
        case(
            "moved by 9e8 m",
            "the definition within 4e-6 of the peak: double precision places it to 1e-7 m, and its radius is 25 m",
            bent(100.0, 9e8),
            Look::at(2.0),
        ),
        case("of 1e-6 m", "the definition within 4e-6 of the peak", bent(1e-6, 0.0), Look::at(2e-8)),
        case("of 1e8 m", "the definition within 4e-6 of the peak", bent(1e8, 0.0), Look::at(2e6)),
        Case::new(GROUP, "a radius of 1e-18 m", "refused: below 1e-9", || {
            refuses(&quadratic(&BENT, "radius = 1e-18"), "1e-9")
        }),
        Case::new(GROUP, "points at 1e18 m", "refused: beyond 1e9", || {
            refuses(&quadratic(&BENT.map(|p| p.map(|x| x * 1e18)), "radius = 0.1"), "1e9")
        }),
        Case::new(GROUP, "voxels of 1e-9 of the extent", "refused before memory is taken", || {
            Verdict::refused(probe(&quadratic(&STRAIGHT, "radius = 1"), 2e-9), "2^24")
        }),
        Case::new(GROUP, "voxel indices beyond 2^31", "refused before memory is taken", || {
            let text = quadratic(&STRAIGHT.map(|p| p.map(|x| x + 9e8)), "radius = 0.01");
            Verdict::refused(probe(&text, 1e-3), "2^31")
        }),
        Case::new(GROUP, "a density at the last voxel indices", "planned, no overflow", last_indices),
        Case::new(GROUP, "voxels larger than the scene", "at most 8 bricks, finite", || {
            probe(&bent_text(), 50.0).map_or_else(Verdict::failed, |probe| {
                let bricks = probe.plan.bricks();
                let deviation = probe.deviation(500, 0.0);
                let is_fine = deviation.is_ok_and(|deviation| deviation.largest <= 4e-6);
                Verdict::is(bricks <= 8 && is_fine, format!("{bricks} bricks"))
            })
        }),
        Case::new(GROUP, "no tube at all", "a plan without bricks", || {
            probe("name = \"empty\"\n", 0.1).map_or_else(Verdict::failed, |probe| {
                Verdict::is(probe.plan.bricks() == 0, format!("{} bricks", probe.plan.bricks()))
            })
        }),
    ];
    for (size, words) in [("0", "above 0"), ("-1", "above 0"), ("nan", "above 0"), ("inf", "above 0")] {
        cases.push(Case::new(GROUP, format!("a voxel size of {size}"), "refused", move || {
            refuses(&format!("[bake]\nvoxel_size = {size}\n"), words)
        }));
    }
    cases
}

fn bent_text() -> String {
    quadratic(&BENT, &format!("radius = 0.25\n{NOISE}"))
}

/// Values of a scene's voxels in file order, and the first brick's origin.
fn values(text: &str, voxel_size: f64) -> Result<(Vec<u32>, [i32; 3]), String> {
    let probe = probe(text, voxel_size)?;
    let mut store = Store::default();
    let Ok(_) = bake(&probe.field, &probe.plan, 0.0, Level::best(), &mut store, |_| ());
    let mut bricks = store.bricks().to_vec();
    // File order begins anew at nodes' borders, which a shift crosses.
    bricks.sort_by_key(|brick| brick.origin);
    let origin = bricks.first().map(|brick| brick.origin).ok_or("nothing was baked")?;
    Ok((bricks.iter().flat_map(|brick| brick.values).map(f32::to_bits).collect(), origin))
}

/// Voxels of 2^-5 m, and a shift of a power of two: every coordinate is exact in both places.
fn moved(power: i32) -> Verdict {
    let h = 0.031_25;
    let shift = libm::exp2(f64::from(power));
    let points = [[0.0, 0.0, -1.0], [0.75, 0.25, 0.0], [0.0, 0.0, 1.0]];
    let rest = format!("radius = 0.25\n{NOISE}");
    let here = values(&quadratic(&points, &rest), h);
    let there = values(&quadratic(&points.map(|p| p.map(|x| x + shift)), &rest), h);
    match (here, there) {
        (Ok((here, _)), Ok((there, _))) if here.len() == there.len() => {
            let pairs =
                || here.iter().zip(&there).map(|(a, b)| [a, b].map(|bits| f64::from(f32::from_bits(*bits))));
            let peak = pairs().map(|[a, _]| a).fold(0.0, worst);
            Verdict::at_most(1e-6, pairs().map(|[a, b]| (a - b).abs()).fold(0.0, worst) / peak)
        }
        (Ok((here, _)), Ok((there, _))) => differing(&here, &there),
        (Err(error), _) | (_, Err(error)) => Verdict::failed(error),
    }
}

fn scaled() -> Verdict {
    let points = [[0.0, 0.0, -1.0], [0.75, 0.25, 0.0], [0.0, 0.0, 1.0]];
    let at = |scale: f64| {
        let points = points.map(|p| p.map(|x| x * scale));
        values(&quadratic(&points, &format!("radius = {:?}\n{NOISE}", 0.25 * scale)), 0.031_25 * scale)
    };
    match (at(1.0), at(1_048_576.0), at(1.0 / 1_048_576.0)) {
        (Ok((a, _)), Ok((b, _)), Ok((c, _))) => Verdict::all([differing(&a, &b), differing(&a, &c)]),
        (a, b, c) => Verdict::failed([a, b, c].into_iter().find_map(Result::err).unwrap_or_default()),
    }
}

fn differing(a: &[u32], b: &[u32]) -> Verdict {
    if a.len() != b.len() {
        return Verdict::is(false, format!("{} and {} values", a.len(), b.len()));
    }
    let differ = a.iter().zip(b).filter(|(a, b)| a != b).count();
    Verdict::is(differ == 0, format!("{differ} of {} values differ", a.len()))
}

/// A tube that ends 64 m, 256 voxels, before indices do.
fn last_indices() -> Verdict {
    let end = f64::from(i32::MAX) * 0.25 - 64.0;
    let points = [[end - 9.0, 0.0, 0.0], [end - 6.0, 0.0, 0.0], [end - 3.0, 0.0, 0.0]];
    let text = quadratic(&points, "radius = 1");
    let found = scene(&text).map(|scene| {
        let mut field = Field::compile(&scene);
        let lattice = Lattice { voxel_size: 0.25 };
        field.widen(lattice);
        Plan::new(&field, lattice, 1 << 30).map(|plan| plan.bricks())
    });
    match found {
        Ok(Ok(bricks)) => Verdict::is(bricks > 0, format!("{bricks} bricks")),
        Ok(Err(error)) => Verdict::failed(error),
        Err(error) => Verdict::failed(error),
    }
}
