//! Anti-aliased bakes: voxels that an edge of the density passes through store the mean over their cell.

use std::collections::BTreeMap;
use std::f64::consts::PI;

use glam::{DVec3, Vec3Swizzles};
use serde_json::Value;
use tempfile::tempdir;
use vdbake::field::{Field, Lattice};
use vdbake::num::Level;
use vdbake::reference::Reference;
use vdbake::scene::{Antialias, Scene};
use vdbake::volume::{Plan, Store, Tally, bake, density_at};

use crate::kernel::{scene, shipped};
use crate::support::{self, SOLID, random, vdbake};

struct Baked {
    plan: Plan,
    values: BTreeMap<[i32; 3], [f32; 512]>,
    tally: Tally,
}

impl Baked {
    fn new(scene: &Scene, h: f64) -> Baked {
        let lattice = Lattice { voxel_size: h };
        let mut field = Field::compile(scene);
        field.widen(lattice);
        let plan = Plan::new(&field, lattice, 1 << 32).expect("a small plan");
        let mut store = Store::default();
        let Ok((tally, _)) = bake(&field, &plan, 0.0, Level::best(), &mut store, |_| ());
        let values = store.bricks().iter().map(|brick| (brick.origin, brick.values)).collect();
        Baked { plan, values, tally }
    }

    fn at(&self, voxel: [i32; 3]) -> f64 {
        let [x, y, z] = voxel.map(|i| usize::try_from(i & 7).expect("three bits"));
        self.values.get(&voxel.map(|i| i & !7)).map_or(0.0, |values| f64::from(values[64 * x + 8 * y + z]))
    }

    fn mass(&self) -> f64 {
        let h = self.plan.lattice().voxel_size;
        self.tally.total.sum() * h * h * h
    }

    fn active(&self) -> impl Iterator<Item = ([i32; 3], f64)> {
        self.values.iter().flat_map(|(origin, values)| {
            values.iter().zip(0_i32..).filter(|(value, _)| **value > 0.0).map(|(value, i)| {
                let at = [origin[0] + i / 64, origin[1] + i / 8 % 8, origin[2] + i % 8];
                (at, f64::from(*value))
            })
        })
    }
}

/// A scene of one tube, anti-aliased and not.
fn both(tube: &str) -> [Scene; 2] {
    ["adaptive", "off"].map(|word| scene(&format!("[bake]\nantialias = \"{word}\"\n[[tube]]\n{tube}")))
}

/// A straight tube.
fn straight(ends: [DVec3; 2], radius: f64, keys: &str) -> String {
    let points =
        [ends[0], 0.5 * (ends[0] + ends[1]), ends[1]].map(|p| format!("{:?}", p.to_array())).join(", ");
    format!("curve = {{ points = [{points}] }}\nradius = {radius:?}\n{keys}")
}

const HARD: &str = "caps = \"flat\"\nenvelope = { radial = \"hard\" }\n";

/// Point samples of a tube with a radius of four voxels find its volume to about the number of voxels that its surface cuts, to the
/// power 1/2: of 1800 cells half are counted, so 20 of 3000. Means are off by 0.025 each, a tenth of that.
#[test]
fn mass_of_a_hard_tube_is_kept() {
    let length = 15.0;
    let mut worst = [0.0_f64; 2];
    for (i, axis) in
        [DVec3::Z, DVec3::new(0.0, 0.6, 0.8), DVec3::new(0.48, 0.6, 0.64)].into_iter().enumerate()
    {
        let start = DVec3::new(0.31, 0.72, 0.17) * (1.0 + 0.37 * f64::from(u8::try_from(i).expect("few")));
        let tube = straight([start, start + axis * length], 4.0, HARD);
        let masses = both(&tube).map(|scene| Baked::new(&scene, 1.0).mass());
        for (worst, mass) in worst.iter_mut().zip(masses) {
            *worst = worst.max((mass / (PI * 16.0 * length) - 1.0).abs());
        }
    }
    assert!(worst[0] < 2e-3, "{worst:?}");
    assert!(worst[1] > 5e-3, "point samples miss this: {worst:?}");
}

/// Along an axis the places in a cell are 1/32 apart, so a plane across it is found within half of that.
#[test]
fn a_flat_end_across_an_axis_covers_its_part_of_a_cell() {
    for axis in [DVec3::X, DVec3::Y, DVec3::Z] {
        for part in [0.01, 0.37, 0.55, 0.8, 0.99] {
            let ends = [axis * -20.0, axis * (3.0 + part)];
            let [adaptive, off] = both(&straight(ends, 12.0, HARD)).map(|scene| Baked::new(&scene, 1.0));
            for side in [[0, 0], [-3, 5], [4, 4]] {
                let other = [axis.zxy(), axis.yzx()];
                let across = other[0] * f64::from(side[0]) + other[1] * f64::from(side[1]);
                #[allow(clippy::cast_possible_truncation, reason = "whole and small")]
                let voxel = (across + 3.0 * axis).to_array().map(|x| x as i32);
                let value = adaptive.at(voxel);
                assert!((value - part).abs() <= 1.0 / 64.0 + 1e-9, "{axis} {part}: {value}");
                assert_eq!(off.at(voxel), f64::from(part > 0.5), "half of it counts whole");
            }
        }
    }
}

/// The part of a unit cell below a plane: `n . x <= d` for x in the cube from 0 to 1, all of n above 0. The volume of the
/// simplex below the plane, less those that lie past the cube's faces, and so on.
fn part_below(n: DVec3, d: f64) -> f64 {
    let mut sum = 0.0;
    for corner in 0..8_u32 {
        let side = DVec3::new(f64::from(corner & 1), f64::from(corner >> 1 & 1), f64::from(corner >> 2));
        let rest = (d - n.dot(side)).max(0.0);
        let sign = if corner.count_ones() % 2 == 0 { 1.0 } else { -1.0 };
        sum += sign * rest * rest * rest;
    }
    sum / (6.0 * n.x * n.y * n.z)
}

#[test]
fn slanted_ends_cover_their_parts_of_cells() {
    let mut square = 0.0;
    let mut count = 0.0;
    for normal in [DVec3::new(1.0, 2.0, 3.0), DVec3::new(0.3, 1.0, 0.2), DVec3::new(1.0, 1.0, 1.01)] {
        let normal = normal.normalize();
        let [adaptive, _] = both(&straight([normal * -30.0, normal * 0.2], 14.0, HARD));
        let adaptive = Baked::new(&adaptive, 1.0);
        for i in -7..7 {
            for j in -7..7 {
                for k in -7..7 {
                    let first = DVec3::new(f64::from(i), f64::from(j), f64::from(k));
                    // Away from the surface of the tube.
                    let centre = first + DVec3::splat(0.5);
                    if centre.reject_from_normalized(normal).length() > 12.0 {
                        continue;
                    }
                    let expected = part_below(normal, 0.2 - first.dot(normal));
                    let error = adaptive.at([i, j, k]) - expected;
                    if expected > 0.0 && expected < 1.0 {
                        square += error * error;
                        count += 1.0;
                    }
                    // What the places of a cell are off by at most, with all of a corner that no corner of the cell shows.
                    assert!(error.abs() < 0.17, "{normal} {first}: {error}");
                }
            }
        }
    }
    // 0.025 over all planes.
    assert!(count > 500.0 && f64::sqrt(square / count) < 0.035, "{}", f64::sqrt(square / count));
}

#[test]
fn smooth_scenes_are_as_without() {
    for name in ["tornado", "solar_flare", "galaxy", "figure2"] {
        let mut smooth = shipped(name);
        let h = {
            let [lo, hi] = Field::compile(&smooth).bounds().expect("density");
            (hi - lo).max_element() / 96.0
        };
        assert_eq!(smooth.bake().antialias, Antialias::Adaptive, "it is the default");
        let adaptive = Baked::new(&smooth, h).tally;
        let text = smooth.text().replacen("[bake]\n", "[bake]\nantialias = \"off\"\n", 1);
        assert_ne!(text, smooth.text());
        smooth = scene(&text);
        let off = Baked::new(&smooth, h).tally;
        assert_eq!(adaptive, off, "{name}");
        assert!(adaptive.antialiased_voxels == 0 && adaptive.active_voxels > 0);
    }
}

/// Tubes with every kind of edge, at a voxel of 1.
fn edged() -> Vec<(&'static str, String)> {
    let bent = "curve = { points = [[0.2, 0.3, 0.1], [55, 5, 30], [3, 10, 70]] }\n";
    let noise = "[[tube.layer]]\nfrequency = [0.7, 0.7, 1.5]\noctaves = 1\nmultiplier = 0.5\nop = \"add\"\n";
    let sectors = "[[tube.layer]]\nnoise = \"sectors\"\n";
    let hard = "envelope = { radial = \"hard\" }\n";
    vec![
        ("hard", format!("{bent}radius = 12.0\n{HARD}")),
        ("hard, noise", format!("{bent}radius = 12.0\n{HARD}{noise}")),
        ("soft edge", format!("{bent}radius = 14.0\ncaps = \"flat\"\nenvelope = {{ radial = 0.1 }}\n")),
        ("flat", format!("{bent}radius = 12.0\ncaps = \"flat\"\n")),
        ("round", format!("{bent}radius = 12.0\ncaps = \"round\"\n{hard}")),
        ("short fade", format!("{bent}radius = 12.0\nenvelope = {{ axial = 0.008 }}\n")),
        ("sectors", format!("{bent}radius = 16.0\ntwist = 0.4\n{sectors}")),
        (
            "sectors added",
            format!("{bent}radius = 12.0\n[[tube.layer]]\nnoise = \"sectors\"\nop = \"add\"\n"),
        ),
        ("sectors, Frenet", format!("{bent}radius = 12.0\nframe = \"frenet\"\n{sectors}")),
        ("step", format!("{bent}radius = [[0, 6], [0.45, 6], [0.45, 13], [1, 13]]\n")),
        ("flare", format!("{bent}radius = [[0, 5], [0.5, 5], [0.504, 15], [1, 15]]\n")),
        (
            "corner",
            format!(
                "curve = {{ points = [[0, 0, 0], [0, 10, 20], [0, 20, 40], [20, 30, 40], [40, 40, 40]] }}\nradius = 9.0\n{HARD}"
            ),
        ),
        (
            "closed",
            format!(
                "curve = {{ kind = \"catmull-rom\", closed = true, points = [[0, 0, 0], [40, 3, 10], [45, 40, 0], [0, 30, -8]] }}\nradius = 9.0\n{hard}"
            ),
        ),
        ("keyed", format!("{bent}radius = [[0, 4], [0.3, 16], [0.6, 6], [1, 12]]\n{HARD}")),
        (
            "two tubes",
            format!(
                "{bent}radius = 8.0\n{HARD}\n[[tube]]\ncurve = {{ points = [[30, 0, 20], [20, 5, 40], [30, 10, 60]] }}\nradius = 9.0\n{HARD}"
            ),
        ),
    ]
}

/// Bricks that no edge passes through are as without anti-aliasing, to the bit; and there are such within tubes.
#[test]
fn other_bricks_are_as_without() {
    for (name, tube) in edged() {
        let [adaptive, off] = both(&tube).map(|scene| Baked::new(&scene, 0.5));
        let mut same = 0;
        for index in 0..adaptive.plan.bricks() {
            let origin = adaptive.plan.origin(index);
            let value = |baked: &Baked| baked.values.get(&origin).map(|values| values.map(f32::to_bits));
            if !adaptive.plan.has_edge(index) {
                assert_eq!(value(&adaptive), value(&off), "{name} at {origin:?}");
                same += usize::from(value(&off).is_some());
            }
        }
        // How fast a Frenet frame turns is not bounded.
        assert!(same > 20 || name.contains("Frenet"), "{name}: {same}");
        assert!(
            off.tally.antialiased_voxels == 0 && adaptive.tally.antialiased_voxels > 100,
            "{name}: {}",
            adaptive.tally.antialiased_voxels
        );
        assert!(adaptive.tally.searched_voxels > off.tally.searched_voxels);
        // All that the other plan has and this one has not is bricks that stay empty.
        for origin in off.values.keys() {
            assert!(adaptive.plan.origins().any(|planned| planned == *origin), "{name}");
        }
    }
}

/// Every cell in the bounds, whether its brick is planned or not, holds the mean of the density to within what 32 places and
/// the corners of cells can tell.
#[test]
fn no_edge_is_missed() {
    const FINE: usize = 5;
    for (name, tube) in edged() {
        let [adaptive, off] = both(&tube);
        let field = Field::compile(&off);
        let lattice = Lattice { voxel_size: 1.0 };
        let baked = Baked::new(&adaptive, 1.0);
        let [lo, hi] = field.bounds().expect("density").map(|corner| corner.floor());
        let mut state = 9;
        let cells: Vec<DVec3> = (0..12_000)
            .map(|_| {
                let mut unit =
                    || f64::from(u32::try_from(random(&mut state) >> 32).expect("32 bits")) / 4_294_967_296.0;
                (lo - 1.0 + (hi - lo + 3.0) * DVec3::new(unit(), unit(), unit())).floor()
            })
            .collect();
        let place = |i: usize| (DVec3::new(real(i / 25), real(i / 5 % 5), real(i % 5)) + 0.5) / 5.0;
        let points: Vec<DVec3> =
            cells.iter().flat_map(|cell| (0..FINE * FINE * FINE).map(|i| *cell + place(i))).collect();
        let found = density_at(&field, lattice, &points, Level::best(), 1 << 32).expect("a small plan");
        let (mut worst, mut square, mut cut) = (0.0_f64, 0.0, 0.0);
        for (cell, found) in cells.iter().zip(found.chunks(FINE * FINE * FINE)) {
            let mean = found.iter().copied().map(f64::from).sum::<f64>() / found.len() as f64;
            let (low, high) = found.iter().fold((f32::MAX, 0.0_f32), |(a, b), x| (a.min(*x), b.max(*x)));
            #[allow(clippy::cast_possible_truncation, reason = "small")]
            let error = baked.at(cell.to_array().map(|x| x as i32)) - mean;
            if high - low > 0.25 {
                square += error * error;
                cut += 1.0;
            }
            worst = worst.max(error.abs());
        }
        let rms = f64::sqrt(square / cut);
        assert!(cut > 20.0, "{name}: {cut}");
        // 0.15 and 0.025 for 32 places of a plane at their worst; the points that they are compared with, 125 in a regular
        // grid, are off by half a layer, 0.1, and 0.01. Where the density at the edge is below half of the brick's largest, a
        // corner that is cut off counts only if it is more than one of the cell's eight: a sixth of the cell.
        assert!(worst < 0.3 && rms < 0.05, "{name}: {worst} {rms} of {cut}");
    }
}

#[allow(clippy::cast_precision_loss, reason = "below 5")]
fn real(i: usize) -> f64 {
    i as f64
}

/// A mean by the reference, which shares no formula with the kernel, of cells across the surface of a bent tube.
#[test]
fn cells_hold_the_mean_of_the_reference() {
    for name in ["hard, noise", "sectors", "corner"] {
        let (_, tube) = edged().into_iter().find(|(other, _)| *other == name).expect("a tube of the list");
        let [adaptive, off] = both(&tube);
        let reference = Reference::new(&off, Some(1.0));
        let baked = Baked::new(&adaptive, 1.0);
        let [mut square, mut peak, mut count] = [0.0, 0.0_f64, 0.0];
        for (voxel, value) in baked.active().step_by(97).take(400) {
            let first = DVec3::from(voxel.map(f64::from));
            let densities: Vec<f64> = (0..64)
                .map(|i| DVec3::new(real(i / 16), real(i / 4 % 4), real(i % 4)))
                .map(|place| reference.density((first + (place + 0.5) / 4.0).to_array()))
                .collect();
            let mean = densities.iter().sum::<f64>() / 64.0;
            peak = densities.iter().fold(peak, |most, x| most.max(*x));
            square += (value - mean) * (value - mean);
            count += 1.0;
        }
        // Of cells cut, 0.028 (32 places and 64), a third of all at most; smooth ones hold the density at the centre, which
        // is off by a 24th of the second derivatives.
        assert!(
            count > 200.0 && f64::sqrt(square / count) < 0.025 * peak,
            "{name}: {}",
            f64::sqrt(square / count)
        );
    }
}

#[test]
fn only_cells_of_the_tube_are_active() {
    let (radius, top) = (7.3, 20.4);
    let tube = straight([DVec3::new(0.1, 0.2, -0.3), DVec3::new(0.1, 0.2, top)], radius, HARD);
    let [adaptive, off] = both(&tube).map(|scene| Baked::new(&scene, 1.0));
    let mut outside = 0;
    for (voxel, value) in adaptive.active() {
        let near = |i: usize, at: f64| {
            let first = f64::from(voxel[i]);
            (first - at).max(at - first - 1.0).max(0.0)
        };
        let distance = libm::hypot(near(0, 0.1), near(1, 0.2));
        assert!(distance <= radius && voxel[2] >= -1 && f64::from(voxel[2]) <= top, "{voxel:?}: {value}");
        assert!(value <= 1.0);
        outside += usize::from(off.at(voxel) == 0.0);
    }
    assert!(outside > 100, "some have their centre outside: {outside}");
    for (voxel, _) in off.active() {
        assert!(adaptive.at(voxel) > 0.0, "{voxel:?}");
    }
}

/// A tube that is not widened, of a tenth of a voxel's cross-section: point samples hit it by chance. Of 40 cells with 32
/// places each, 128 places are hit, in lattices that are spread evenly: about 5 %.
#[test]
fn tubes_thinner_than_a_voxel_are_found() {
    let radius = 0.18;
    let ends = [DVec3::new(0.31, 0.42, 0.53), DVec3::new(18.7, 17.1, 31.9)];
    let tube = straight(ends, radius, HARD);
    let text = format!("[bake]\nwiden = false\nantialias = \"adaptive\"\n[[tube]]\n{tube}");
    let thin = Baked::new(&scene(&text), 1.0);
    let expected = PI * radius * radius * (ends[1] - ends[0]).length();
    assert!((thin.mass() / expected - 1.0).abs() < 0.15, "{} of {expected}", thin.mass());
}

#[test]
fn points_are_not_affected() {
    let [adaptive, off] = both(&edged()[1].1).map(|scene| {
        let points: Vec<DVec3> = (0..500).map(|i| DVec3::new(0.05, 0.01, 0.13) * f64::from(i)).collect();
        density_at(&Field::compile(&scene), Lattice { voxel_size: 1.0 }, &points, Level::best(), 1 << 30)
            .expect("a small plan")
    });
    assert!(adaptive == off && off.iter().any(|value| *value > 0.0));
}

#[test]
fn threads_do_not_matter() {
    for (name, tube) in edged().into_iter().take(2) {
        let [adaptive, _] = both(&tube);
        let with = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
            pool.install(|| Baked::new(&adaptive, 1.0).tally)
        };
        let one = with(1);
        assert!(one == with(2) && one == with(7), "{name}");
    }
}

#[test]
fn the_program_counts_the_voxels_and_records_the_setting() {
    let folder = tempdir().expect("a temporary folder");
    let bake = |text: &str| {
        let baked =
            support::bake(&support::write(&folder.path().join("scene.toml"), text), folder.path(), &[]);
        let info = vdbake().arg("info").arg(&baked.path).arg("--json").output().expect("the program starts");
        (baked.report, String::from_utf8_lossy(&info.stdout).into_owned())
    };
    let number = |report: &Value, key: &str| report[key].as_u64().expect("a count");
    let (adaptive, info) = bake(SOLID);
    assert!(info.contains(r#"\"antialias\":\"adaptive\""#), "{info}");
    let (off, info) = bake(&SOLID.replacen("[[tube]]", "[bake]\nantialias = \"off\"\n[[tube]]", 1));
    assert!(info.contains(r#"\"antialias\":\"off\""#), "{info}");
    assert_ne!(adaptive["uuid"], off["uuid"]);
    assert!(number(&adaptive, "antialiased_voxels") > 1000 && number(&off, "antialiased_voxels") == 0);
    assert!(number(&adaptive, "active_voxels") > number(&off, "active_voxels"));
    assert!(number(&adaptive, "searched_voxels") > number(&off, "searched_voxels"));
    // The volume of the cylinder, 2 pi.
    let mass = |report: &Value| (report["mass"]["baked"].as_f64().expect("a mass") / (2.0 * PI) - 1.0).abs();
    assert!(mass(&adaptive) < 2e-4, "{} {}", mass(&adaptive), mass(&off));
}

/// All bricks of a small scene are in the sample that the estimates come from.
#[test]
fn plans_expect_what_is_baked() {
    let folder = tempdir().expect("a temporary folder");
    let scene = support::write(&folder.path().join("scene.toml"), SOLID);
    let options = ["--resolution", "40", "--json", "--quiet"];
    let output = vdbake().arg("plan").arg(&scene).args(options).output().expect("the program starts");
    let plan: Value = serde_json::from_slice(&output.stdout).expect("one JSON object");
    let mut bake = vdbake();
    bake.arg("bake").arg(&scene).arg("-o").arg(folder.path().join("baked.vdb")).args(options);
    let baked: Value =
        serde_json::from_slice(&bake.output().expect("the program starts").stdout).expect("one JSON object");
    assert_eq!(plan["planned_bricks"], baked["planned_bricks"]);
    assert_eq!(plan["estimated"]["sampled_bricks"], plan["planned_bricks"]);
    assert_eq!(plan["estimated"]["active_voxels"], baked["active_voxels"]);
}
