//! The density kernel against the reference, which shares no formula with it.

use glam::DVec3;
use rayon::prelude::*;
use vdbake::field::kernel::{Places, Scratch, evaluate};
use vdbake::field::{Extent, Field, Lattice, Region, VOXELS};
use vdbake::num::Level;
use vdbake::reference::Reference;
use vdbake::scene::Scene;
use vdbake::volume::{Plan, Store, bake, density_at};

use crate::support::scenes;

/// A scene of the `scenes` folder.
pub(crate) fn shipped(name: &str) -> Scene {
    let path = format!("{}/scenes/{name}.toml", env!("CARGO_MANIFEST_DIR"));
    let text = std::fs::read_to_string(&path).unwrap_or_else(|error| panic!("{path}: {error}"));
    let load = |file: &str| std::fs::read(format!("{}/scenes/{file}", env!("CARGO_MANIFEST_DIR")));
    Scene::load(&text, &path, &load).unwrap_or_else(|errors| panic!("{errors}"))
}

pub(crate) fn scene(text: &str) -> Scene {
    Scene::parse(text, "test.toml").unwrap_or_else(|errors| panic!("{errors}"))
}

pub(crate) fn lattice(field: &Field, resolution: f64) -> Lattice {
    let [lo, hi] = field.bounds().expect("the scene has density");
    Lattice { voxel_size: (hi - lo).max_element() / resolution }
}

fn centre(lattice: Lattice, index: [i32; 3]) -> [f64; 3] {
    index.map(|i| (f64::from(i) + 0.5) * lattice.voxel_size)
}

/// Fixed pseudo-random numbers (Steele, Lea and Flood's SplitMix64, 2014).
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }
}

struct Errors {
    largest: f64,
    rms: f64,
    peak: f64,
    at: [i32; 3],
}

/// Kernel minus reference over about `count` voxels of planned bricks. Voxels within `edge` of a place where the density
/// jumps are passed over: there a rounding decides.
fn errors(scene: &Scene, resolution: f64, count: usize, edge: f64) -> Errors {
    let mut field = Field::compile(scene);
    let lattice = lattice(&field, resolution);
    field.widen(lattice);
    // Point samples, at edges too.
    let plan = Plan::for_extent(&field, lattice, Extent::Centres, 1 << 32).expect("a small plan");
    let mut store = Store::default();
    let Ok(_) = bake(&field, &plan, 0.0, Level::best(), &mut store, |_| ());
    let found: std::collections::BTreeMap<[i32; 3], usize> =
        store.bricks().iter().enumerate().map(|(i, brick)| (brick.origin, i)).collect();
    let reference = Reference::new(scene, Some(lattice.voxel_size));
    let mut random = Random(1);
    let voxels: Vec<[i32; 3]> = (0..count)
        .map(|_| {
            let brick = usize::try_from(random.next() % plan.bricks() as u64).expect("an index");
            let origin = plan.origin(brick);
            let bits = random.next();
            [0, 1, 2].map(|axis| origin[axis] + i32::try_from(bits >> (8 * axis) & 7).expect("three bits"))
        })
        .collect();
    let differences: Vec<([i32; 3], f64, f64)> = voxels
        .par_iter()
        .filter(|&&voxel| edge == 0.0 || !near_jump(scene, &reference, centre(lattice, voxel), edge))
        .map(|&voxel| {
            let truth = reference.density(centre(lattice, voxel));
            let origin = voxel.map(|i| i & !7);
            let value = found.get(&origin).map_or(0.0, |&i| {
                let at = [0, 1, 2].map(|axis| usize::try_from(voxel[axis] & 7).expect("three bits"));
                store.bricks()[i].values[at[0] * 64 + at[1] * 8 + at[2]]
            });
            (voxel, f64::from(value) - truth, truth)
        })
        .collect();
    let mut errors = Errors { largest: 0.0, rms: 0.0, peak: 0.0, at: [0; 3] };
    for &(voxel, difference, truth) in &differences {
        if difference.abs() > errors.largest {
            (errors.largest, errors.at) = (difference.abs(), voxel);
        }
        errors.rms += difference * difference;
        errors.peak = errors.peak.max(truth);
    }
    errors.rms = (errors.rms / differences.len() as f64).sqrt();
    errors
}

/// Within `edge` of the surface of a hard envelope, of an end plane, or of the planes between sectors.
fn near_jump(scene: &Scene, reference: &Reference, p: [f64; 3], edge: f64) -> bool {
    (0..scene.tubes().len()).any(|tube| {
        reference.cylinder(tube, p).iter().any(|at| {
            (at.q() - 1.0).abs() < edge
                || at.u.abs() < edge
                || at.v.abs() < edge
                || at.fraction < edge
                || at.fraction > 1.0 - edge
        })
    })
}

/// Largest and root mean square error allowed, over the density's peak.
///
/// Single precision resolves (u, v, l) to about 3e-7 (the spans' truncation) plus 2e-7 (rounding of polynomials of
/// degree 5). An octave of frequency f and amplitude a turns that into at most 3.75 a f times as much; five octaves that
/// start at 4 cells into at most 5 * 3.75 * 4 * 5e-7 = 4e-5 of the noise's amplitude. The root mean square slope is a
/// fifth of the largest, octaves add up in squares, and the error's own mean is a third of its largest.
const LARGEST: f64 = 4e-5;
const RMS: f64 = LARGEST / 30.0;

pub(crate) fn assert_close(name: &str, scene: &Scene, resolution: f64, edge: f64) {
    let errors = errors(scene, resolution, 20_000, edge);
    assert!(errors.peak > 0.0, "{name}: nothing was compared");
    assert!(
        errors.largest <= LARGEST * errors.peak,
        "{name} at {resolution}: {:e} at {:?}",
        errors.largest,
        errors.at
    );
    assert!(errors.rms <= RMS * errors.peak, "{name} at {resolution}: rms {:e}", errors.rms);
}

#[test]
fn shipped_scenes_agree_with_the_reference() {
    for path in scenes() {
        let name = path.file_stem().and_then(|name| name.to_str()).expect("a name in UTF-8");
        match name {
            // Density jumps from quarter to quarter.
            "sectors" => assert_close(name, &shipped(name), 200.0, 1e-4),
            "tornado" | "solar_flare" | "galaxy" | "figure2" => {
                for resolution in [40.0, 200.0, 640.0] {
                    assert_close(name, &shipped(name), resolution, 0.0);
                }
            }
            _ => assert_close(name, &shipped(name), 200.0, 0.0),
        }
    }
}

#[test]
fn every_kind_of_tube_agrees_with_the_reference() {
    let layer = "[[tube.layer]]\nfrequency = [2.0, 2.0, 4.0]\noctaves = 4\nthreshold = -0.2\n";
    let smooth = "envelope = { radial = \"smooth\" }\n";
    let cases = [
        ("straight", "curve = { kind = \"quadratic\", points = [[0,0,0],[0,0,1],[0,0,2]] }\nradius = 0.3\n"),
        (
            "nearly straight",
            "curve = { kind = \"quadratic\", points = [[0,0,0],[0,1e-7,1],[0,0,2]] }\nradius = 0.3\n",
        ),
        (
            "slow start",
            "curve = { kind = \"quadratic\", points = [[0,0,0],[0,0,0],[0,0.2,2]] }\nradius = 0.3\n",
        ),
        (
            "round",
            "curve = { kind = \"cubic\", points = [[0,0,0],[1,0,0.3],[1,1,0.6],[0,1,1]] }\nradius = 0.2\ncaps = \"round\"\ntwist = 2.0\n",
        ),
        (
            "corner",
            "curve = { kind = \"quadratic\", points = [[0,0,0],[0,0,0.5],[0,0,1],[0,0.5,1.2],[0,1,1.4]] }\nradius = 0.25\n",
        ),
        (
            "sharp corner",
            "curve = { points = [[0,0,0],[0.5,0,0],[1,0,0],[0.66,0.37,0.02],[0.32,0.74,0.04]] }\nradius = 0.2\n",
        ),
        (
            "turning back",
            "curve = { points = [[0,0,0],[0.5,0,0],[1.013,0,0],[0.75,0,0],[0.5,0,0]] }\nradius = 0.2\n",
        ),
        ("fold", "curve = { points = [[0,0,0],[2.03,0,0],[1,0,0]] }\nradius = 0.1\n"),
        ("cusp", "curve = { kind = \"cubic\", points = [[0,0,0],[1,1,0],[0,1,0],[1,0,0]] }\nradius = 0.1\n"),
        (
            "lens",
            "curve = { closed = true, points = [[0,0,0],[0.5,0.31,0],[1.01,0,0],[0.5,0.8,0]] }\nradius = 0.2\n",
        ),
        (
            "keyed",
            "curve = { kind = \"cubic\", points = [[0,0,0],[1,0,0.3],[1,1,0.6],[0,1,1]] }\nradius = [[0, 0.05], [0.3, 0.25], [0.6, 0.1], [1, 0.3]]\n",
        ),
        (
            "cone",
            "curve = { kind = \"quadratic\", points = [[0,0,0],[0.2,0,1],[0,0,2]] }\nradius = [[0, 0.0], [1, 0.4]]\n",
        ),
        (
            "metres",
            "curve = { kind = \"quadratic\", points = [[0,0,0],[0.5,0,1],[0,0,2]] }\nradius = 0.3\nstretch = false\n",
        ),
        (
            "frenet",
            "curve = { kind = \"cubic\", points = [[0,0,0],[1,0,0.3],[1,1,0.6],[0,1,1]] }\nradius = 0.2\nframe = \"frenet\"\n",
        ),
        (
            "two tubes",
            "curve = { kind = \"quadratic\", points = [[0,0,0],[0.5,0,1],[0,0,2]] }\nradius = 0.3\n[[tube]]\ncurve = { kind = \"quadratic\", points = [[0.5,0,0],[-0.5,0,1],[0.5,0,2]] }\nradius = 0.3\n",
        ),
        (
            "tight",
            "curve = { kind = \"quadratic\", points = [[0,0,0],[0.6,0,0.5],[0,0,1]] }\nradius = 0.45\n",
        ),
    ];
    for (name, tube) in cases {
        let text = format!("[[tube]]\n{tube}{smooth}{layer}");
        let text = text.replace(
            "[[tube]]\ncurve = { kind = \"quadratic\", points = [[0.5",
            &format!("{smooth}{layer}[[tube]]\ncurve = {{ kind = \"quadratic\", points = [[0.5"),
        );
        for resolution in [30.0, 150.0] {
            assert_close(name, &scene(&text), resolution, 0.0);
        }
    }
}

#[test]
fn no_density_lies_outside_the_planned_bricks() {
    for name in
        ["tornado", "solar_flare", "galaxy", "figure2", "sectors", "dna", "growing", "trefoil", "braid"]
    {
        let scene = shipped(name);
        let field = Field::compile(&scene);
        let lattice = lattice(&field, 40.0);
        let plan = Plan::new(&field, lattice, 1 << 30).expect("a small plan");
        let planned: std::collections::BTreeSet<[i32; 3]> =
            (0..plan.bricks()).map(|i| plan.origin(i)).collect();
        let [lo, hi] = field.bounds().expect("the scene has density");
        #[allow(clippy::cast_possible_truncation, reason = "some dozens of bricks")]
        let block = |x: f64| (x / lattice.voxel_size / 8.0).floor() as i32;
        let reference = Reference::new(&scene, Some(lattice.voxel_size));
        let mut outside = Vec::new();
        for x in block(lo.x) - 1..=block(hi.x) + 1 {
            for y in block(lo.y) - 1..=block(hi.y) + 1 {
                for z in block(lo.z) - 1..=block(hi.z) + 1 {
                    if !planned.contains(&[8 * x, 8 * y, 8 * z]) {
                        outside.push([8 * x, 8 * y, 8 * z]);
                    }
                }
            }
        }
        assert!(!outside.is_empty(), "{name}: the box holds bricks that are not planned");
        outside.par_iter().for_each(|origin| {
            for i in 0..512 {
                let voxel = [origin[0] + i / 64, origin[1] + i / 8 % 8, origin[2] + i % 8];
                assert_eq!(reference.density(centre(lattice, voxel)), 0.0, "{name} at voxel {voxel:?}");
            }
        });
    }
}

#[test]
fn single_precision_agrees_with_double() {
    for name in ["tornado", "solar_flare", "galaxy"] {
        let scene = shipped(name);
        let field = Field::compile(&scene);
        let lattice = lattice(&field, 300.0);
        let plan = Plan::new(&field, lattice, 1 << 32).expect("a small plan");
        let mut store = Store::default();
        let Ok(_) = bake(&field, &plan, 0.0, Level::best(), &mut store, |_| ());
        let found: std::collections::BTreeMap<[i32; 3], usize> =
            store.bricks().iter().enumerate().map(|(i, brick)| (brick.origin, i)).collect();
        let (mut region, mut scratch) = (Region::<f64>::default(), Scratch::<f64>::default());
        let (mut largest, mut peak) = (0.0_f64, 0.0_f64);
        for index in (0..plan.bricks()).step_by(17) {
            let mut values = [0.0; VOXELS];
            plan.narrow(&field, index, &mut region);
            evaluate::<f64>((), &region, Places::Centres, &mut scratch, &mut values);
            let zeros = [0.0_f32; VOXELS];
            let single = found.get(&plan.origin(index)).map_or(&zeros, |&i| &store.bricks()[i].values);
            for (&a, &b) in single.iter().zip(&values) {
                largest = largest.max((f64::from(a) - b).abs());
                peak = peak.max(b);
            }
        }
        assert!(largest <= LARGEST * peak, "{name}: {largest:e} of {peak}");
    }
}

#[test]
fn points_between_voxels_agree_with_the_reference() {
    for name in ["tornado", "solar_flare", "galaxy"] {
        let scene = shipped(name);
        let field = Field::compile(&scene);
        let lattice = lattice(&field, 150.0);
        let [lo, hi] = field.bounds().expect("the scene has density");
        let mut random = Random(5);
        let mut unit = || f64::from(u32::try_from(random.next() >> 32).expect("32 bits")) / 4_294_967_296.0;
        let mut points: Vec<DVec3> =
            (0..20_000).map(|_| lo + (hi - lo) * DVec3::new(unit(), unit(), unit())).collect();
        points.extend([DVec3::NAN, DVec3::splat(1e300), DVec3::splat(-1e9)]);
        let found = density_at(&field, lattice, &points, Level::best(), 1 << 32).expect("a small plan");
        let reference = Reference::new(&scene, Some(lattice.voxel_size));
        let truth: Vec<f64> = points[..20_000].par_iter().map(|p| reference.density(p.to_array())).collect();
        let peak = truth.iter().fold(0.0_f64, |most, &value| most.max(value));
        assert!(peak > 0.0);
        for ((point, value), truth) in points.iter().zip(&found).zip(&truth) {
            let error = (f64::from(*value) - truth).abs();
            assert!(error <= LARGEST * peak, "{name}: {error:e} at {point}");
        }
        assert_eq!(found[20_000..], [0.0; 3]);
    }
}

/// Points on the planes that end a curve, and on those of its corners: a rounding must not put them on neither side.
#[test]
fn nothing_is_lost_on_planes_of_ends_and_corners() {
    let mut random = Random(71);
    let mut unit = || (random.next() >> 40) as f64 / f64::from(1 << 24);
    for (curve, radius) in [
        // A root's slope at its start is infinite.
        (
            "kind = \"cubic\", points = [[0, 0, 0.3], [1, 1, 0.3], [0, 1, 0.3], [1, 0, 0]]",
            "{ kind = \"growing\", to = 0.25, from = 0.2, power = 0.5 }",
        ),
        ("points = [[0, 0.5, 0.5], [-0.5, 0.75, 1.5], [-0.08, 1, 1.4]]", "[[0, 0.2], [0.3, 0.3], [1, 0.2]]"),
        ("points = [[0, 0, 0], [0.5, 0.25, 0.5], [1, 0.5, 1], [1.5, 0, 1], [2, -0.5, 1.5]]", "0.2"),
    ] {
        let scene = scene(&format!(
            "[[tube]]\ncurve = {{ {curve} }}\nradius = {radius}\ncaps = \"round\"\nenvelope = {{ radial = \"linear\" }}\n"
        ));
        let mut field = Field::compile(&scene);
        let lattice = Lattice { voxel_size: 0.05 };
        field.widen(lattice);
        let axis = &scene.tubes()[0].curve;
        let last = axis.segments().len() - 1;
        let mut points = Vec::new();
        for (segment, t) in (0..=last).flat_map(|segment| [(segment, 0.0), (segment, 1.0)]) {
            let (at, tangent) = (axis.segments()[segment].at(t), axis.segments()[segment].tangent(t));
            for _ in 0..200 {
                let arm = 0.2 * DVec3::new(unit() - 0.5, unit() - 0.5, unit() - 0.5);
                // To the last bits on the plane, and a little to each side.
                let aside = [0.0, 1e-9, -1e-9, 1e-7, -1e-7][points.len() % 5];
                points.push(at + arm - tangent * (arm.dot(tangent) - aside));
            }
        }
        let found = density_at(&field, lattice, &points, Level::best(), 1 << 30).expect("a small plan");
        let reference = Reference::new(&scene, Some(lattice.voxel_size));
        for (point, found) in points.iter().zip(found) {
            let expected = reference.density(point.to_array());
            assert!(expected > 0.1, "{point}: {expected} in the reference");
            // The radius, where it is a root's, changes by 1e-4 over what an end takes from before its plane.
            assert!((f64::from(found) - expected).abs() < 3e-4, "{point}: {found}, not {expected}");
        }
    }
}
