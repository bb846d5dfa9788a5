//! Splines, closed curves, named radii and long curves: kernel against reference, and closed forms.

use std::f64::consts::{PI, TAU};

use glam::DVec3;
use rayon::prelude::*;
use vdbake::curve::{Curve, FrameRule, Segment, b_spline, catmull_rom};
use vdbake::field::{Field, Lattice};
use vdbake::num::Level;
use vdbake::reference::Reference;
use vdbake::scene::Scene;
use vdbake::volume::density_at;

use crate::gates_oracle::{Random, show};
use crate::kernel::assert_close;

const RULE: FrameRule = FrameRule::RotationMinimising;

/// Noise that does not change along the tube, so that it has no seam of its own.
const ALONG: &str = "[[tube.layer]]\nfrequency = [2.0, 2.0, 0.0]\noctaves = 4\nthreshold = -0.2\n";
/// Noise in all directions.
const LAYER: &str = "[[tube.layer]]\nfrequency = [2.0, 2.0, 4.0]\noctaves = 4\nthreshold = -0.2\n";

fn scene(text: &str) -> Scene {
    Scene::parse(text, "test.toml").unwrap_or_else(|errors| panic!("{errors}\n{text}"))
}

fn points(points: &[DVec3]) -> String {
    let points: Vec<String> = points.iter().map(|p| format!("[{:?}, {:?}, {:?}]", p.x, p.y, p.z)).collect();
    format!("points = [{}]", points.join(", "))
}

/// A circle of radius 1 around the origin, across z, by `n` cubic segments.
fn ring(n: u32) -> Vec<DVec3> {
    let angle = TAU / f64::from(n);
    let handle = 4.0 / 3.0 * libm::tan(0.25 * angle);
    let at = |i: u32| DVec3::new(libm::cos(angle * f64::from(i)), libm::sin(angle * f64::from(i)), 0.0);
    let ahead = |p: DVec3| handle * DVec3::Z.cross(p);
    (0..n).flat_map(|i| [at(i), at(i) + ahead(at(i)), at(i + 1) - ahead(at(i + 1))]).collect()
}

fn ring_of(n: u32) -> String {
    format!("kind = \"cubic\", closed = true, {}", points(&ring(n)))
}

const BENT: &str = "closed = true, points = [[0.5,0,0],[1,0,0.4],[1,1,0.2],[0.2,1.1,-0.4],[-0.3,0.5,0.3]]";
const SQUARE: &str =
    "closed = true, points = [[0.5,0,0],[1,0,0],[1,0.5,0],[1,1,0],[0.5,1,0],[0,1,0],[0,0.5,0],[0,0,0]]";
const CORNERED: &str =
    "closed = true, points = [[0,0,0],[0.5,0,0],[1,0,0],[1,0.5,0],[1,1,0],[0.5,1,0.5],[0,1,0.4],[0,0.5,0.3]]";

#[test]
fn every_shape_agrees_with_the_reference() {
    let open = "points = [[0,0,0],[0.6,0,0.4],[0.7,0.7,0.5],[0,1,1],[-0.2,0.6,1.4]]";
    let tubes = [
        format!("curve = {{ kind = \"catmull-rom\", {open} }}\nradius = 0.15\ntwist = 1.3\n{LAYER}"),
        format!("curve = {{ kind = \"catmull-rom\", alpha = 1, {open} }}\nradius = 0.15\n{LAYER}"),
        format!(
            "curve = {{ kind = \"b-spline\", scale = 0.5, about = [1, 0, 0], {open} }}\nradius = 0.08\n{LAYER}"
        ),
        format!("curve = {{ {} }}\nradius = 0.3\ntwist = 2\n{ALONG}", ring_of(4)),
        format!("curve = {{ kind = \"b-spline\", {BENT} }}\nradius = 0.15\n{ALONG}"),
        format!("curve = {{ kind = \"catmull-rom\", {BENT} }}\nradius = 0.15\ntwist = -1\n{ALONG}"),
        // Its curvature is continuous, so that the principal normal is.
        format!("curve = {{ kind = \"b-spline\", {BENT} }}\nradius = 0.1\nframe = \"frenet\"\n{ALONG}"),
        format!("curve = {{ {SQUARE} }}\nradius = 0.3\n{ALONG}"),
        format!("curve = {{ {CORNERED} }}\nradius = 0.2\ntwist = 1\n{ALONG}"),
        format!(
            "curve = {{ kind = \"b-spline\", {BENT} }}\nradius = [[0.1, 0.05], [0.4, 0.2], [0.7, 0.1]]\n{ALONG}"
        ),
        format!(
            "curve = {{ {} }}\nradius = {{ kind = \"sinusoidal\", mean = 0.2, amplitude = 0.08, waves = 6 }}\n{ALONG}",
            ring_of(8)
        ),
        format!(
            "curve = {{ kind = \"b-spline\", {open} }}\nradius = {{ kind = \"sinusoidal\", mean = 0.1, amplitude = 0.1, waves = 3.3, phase = 0.4 }}\n{LAYER}"
        ),
        format!(
            "curve = {{ kind = \"b-spline\", {open} }}\nradius = {{ kind = \"growing\", from = 0.02, to = 0.3, power = 0.5 }}\n{LAYER}"
        ),
        format!(
            "curve = {{ kind = \"b-spline\", {open} }}\nradius = {{ kind = \"growing\", from = 0.3, to = 0, power = 3 }}\n{LAYER}"
        ),
    ];
    for tube in tubes {
        let scene = scene(&format!("[[tube]]\n{tube}"));
        for resolution in [30.0, 120.0] {
            assert_close(&tube, &scene, resolution, 0.0);
        }
    }
}

/// Densities at points, by the kernel.
fn kernel(scene: &Scene, points: &[DVec3]) -> Vec<f64> {
    let field = Field::compile(scene);
    let [lo, hi] = field.bounds().expect("density");
    let lattice = Lattice { voxel_size: (hi - lo).max_element() / 100.0 };
    let found = density_at(&field, lattice, points, Level::best(), 1 << 32).expect("a small plan");
    found.into_iter().map(f64::from).collect()
}

/// By the reference, with the octaves fading as for [`kernel`].
fn reference(scene: &Scene, points: &[DVec3]) -> Vec<f64> {
    let [lo, hi] = Field::compile(scene).bounds().expect("density");
    let reference = Reference::new(scene, Some((hi - lo).max_element() / 100.0));
    points.par_iter().map(|p| reference.density(p.to_array())).collect()
}

/// The largest difference between places, and the largest value.
fn difference(a: &[f64], b: &[f64]) -> (f64, f64) {
    let largest = a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    (largest, a.iter().fold(0.0, |m: f64, v| m.max(*v)))
}

#[test]
fn closed_tubes_have_no_seam() {
    let twelve: Vec<DVec3> = ring(12).into_iter().step_by(3).collect();
    let round = |kind: &str| format!("kind = \"{kind}\", closed = true, {}", points(&twelve));
    let curves = [
        ring_of(4),
        ring_of(8),
        round("b-spline"),
        round("catmull-rom"),
        format!("kind = \"b-spline\", {BENT}"),
        format!("kind = \"catmull-rom\", {BENT}"),
    ];
    // Thin enough that no foot comes near the focal set, which a jump of the curvature moves.
    let radii = [
        "0.12",
        "[[0.1, 0.12], [0.6, 0.06]]",
        "{ kind = \"sinusoidal\", mean = 0.1, amplitude = 0.03, waves = 3 }",
    ];
    let mut random = Random(61);
    let mut worst = [0.0_f64; 3];
    for (curve, radius) in curves.iter().flat_map(|curve| radii.map(|radius| (curve, radius))) {
        for frame in [RULE, FrameRule::Frenet] {
            // The curvature of Catmull-Rom splines jumps at joints, and the principal normal with it.
            if frame == FrameRule::Frenet && curve.contains("catmull-rom") {
                continue;
            }
            let name = if frame == RULE { "rotation-minimising" } else { "frenet" };
            let scene = scene(&format!(
                "[[tube]]\ncurve = {{ {curve} }}\nradius = {radius}\ntwist = 2\nframe = \"{name}\"\n{ALONG}"
            ));
            let axis = &scene.tubes()[0].curve;
            let (start, around) = (axis.segments()[0].at(0.0), axis.frame(0, 0.0));
            let aside: Vec<DVec3> = (0..200)
                .map(|_| {
                    start
                        + 0.12
                            * ((random.unit() * 2.0 - 1.0) * around.normal
                                + (random.unit() * 2.0 - 1.0) * around.binormal)
                })
                .collect();
            let step = 1e-7 * around.tangent;
            let [before, after] =
                [-step, step].map(|step| aside.iter().map(|p| *p + step).collect::<Vec<_>>());
            for (i, find) in [kernel, reference].into_iter().enumerate() {
                let (jump, peak) = difference(&find(&scene, &before), &find(&scene, &after));
                assert!(peak > 0.1, "{curve}: {peak}");
                worst[i] = worst[i].max(jump);
            }
            // Farther apart than the kernel's pieces overlap.
            for step in [-1e-4, 1e-4] {
                let places: Vec<DVec3> = aside.iter().map(|p| *p + step * around.tangent).collect();
                let (off, _) = difference(&kernel(&scene, &places), &reference(&scene, &places));
                worst[2] = worst[2].max(off);
            }
        }
    }
    show(&format!(
        "across the closing joint: kernel {:.1e}, reference {:.1e}; beside it {:.1e} apart",
        worst[0], worst[1], worst[2]
    ));
    // The density changes by some 1e-6 over 2e-7 where it is steepest; the kernel rounds to a few times 1e-6 besides.
    assert!(worst.into_iter().all(|jump| jump < 1e-5), "{worst:?}");
}

/// The corners of a square are alike, though one of them is where the curve closes: so is the tube around them, inside and
/// outside, and between any places on both sides of a wedge's borders.
#[test]
fn the_corner_where_a_curve_closes_is_like_any_other() {
    let scene = scene(
        &format!("[[tube]]\ncurve = {{ {CORNERED} }}\nradius = 0.3\n")
            .replace("0.5,1,0.5", "0.5,1,0")
            .replace("0,1,0.4", "0,1,0")
            .replace("0,0.5,0.3", "0,0.5,0"),
    );
    let mut random = Random(62);
    let around: Vec<DVec3> = (0..2000).map(|_| 0.35 * random.point()).collect();
    let turned =
        |p: DVec3, quarter: u32| (0..quarter).fold(p, |p, _| DVec3::Z.cross(p) + DVec3::new(0.0, 0.0, p.z));
    let corners = [DVec3::ZERO, DVec3::X, DVec3::X + DVec3::Y, DVec3::Y];
    let places: Vec<Vec<DVec3>> = (0..4)
        .zip(corners)
        .map(|(i, corner)| around.iter().map(|p| corner + turned(*p, i)).collect())
        .collect();
    for (find, tolerance) in [(kernel as fn(&Scene, &[DVec3]) -> Vec<f64>, 5e-6), (reference, 1e-12)] {
        let first = find(&scene, &places[0]);
        for other in &places[1..] {
            let (off, peak) = difference(&first, &find(&scene, other));
            assert!(peak > 0.9 && off < tolerance, "{off:e}");
        }
    }
    // Rounded by a wedge: at the distance d outside of the corner the density is that at d beside a side.
    let d = 0.1;
    let outside: Vec<DVec3> = (0..=90)
        .map(|k| PI + PI / 180.0 * f64::from(k))
        .map(|angle| d * DVec3::new(libm::cos(angle), libm::sin(angle), 0.0))
        .collect();
    let radial = (1.0 - (d / 0.3) * (d / 0.3)) * (1.0 - (d / 0.3) * (d / 0.3));
    for find in [kernel, reference] {
        assert!(find(&scene, &outside).iter().all(|value| (value - radial).abs() < 5e-6));
    }
}

/// Noise that turns with the frame is continuous around the outside of a corner where a curve in space closes.
#[test]
fn a_corner_in_space_closes_without_a_seam() {
    let scene = scene(&format!("[[tube]]\ncurve = {{ {CORNERED} }}\nradius = 0.25\ntwist = 1\n{ALONG}"));
    let curve = &scene.tubes()[0].curve;
    assert!(curve.holonomy().abs() > 0.1, "{}", curve.holonomy());
    let last = curve.segments().len() - 1;
    let (arriving, leaving) = (curve.frame(last, 1.0).tangent, curve.frame(0, 0.0).tangent);
    let mut random = Random(63);
    for border in [arriving, leaving] {
        // On the outer side: beyond the one plane and before the other.
        let aside: Vec<DVec3> = (0..2000)
            .map(|_| 0.2 * random.point())
            .map(|p| p - p.dot(border) * border)
            .filter(|p| p.dot(arriving) > -1e-9 && p.dot(leaving) < 1e-9)
            .collect();
        let [before, after] =
            [-1e-7, 1e-7].map(|step| aside.iter().map(|p| *p + step * border).collect::<Vec<_>>());
        for find in [kernel, reference] {
            let (jump, peak) = difference(&find(&scene, &before), &find(&scene, &after));
            assert!(peak > 0.1 && jump < 1e-5, "{jump:e} of {peak}");
        }
    }
}

/// A closed curve by its harmonics: frequency, and the vectors of its cosine and its sine.
type Harmonics = [(f64, DVec3, DVec3)];

/// The point, and the first three derivatives.
fn derivatives(harmonics: &Harmonics, t: f64) -> [DVec3; 4] {
    let mut out = [DVec3::ZERO; 4];
    for &(frequency, of_cos, of_sin) in harmonics {
        let (sin, cos) = libm::sincos(frequency * t);
        let (mut a, mut b) = (of_cos, of_sin);
        for out in &mut out {
            *out += cos * a + sin * b;
            (a, b) = (frequency * b, -frequency * a);
        }
    }
    out
}

/// The same by `n` cubic Hermite segments.
fn hermite(harmonics: &Harmonics, n: u32) -> Vec<Segment> {
    let step = TAU / f64::from(n);
    let at = |i: u32| derivatives(harmonics, step * f64::from(i % n));
    (0..n)
        .map(|i| {
            let ([p, v, ..], [q, w, ..]) = (at(i), at(i + 1));
            Segment::cubic([p, p + step / 3.0 * v, q - step / 3.0 * w, q])
        })
        .collect()
}

/// Against the principal normal, which closes, the rotation-minimising frame turns back by the integral of the torsion.
#[test]
fn holonomy_of_trefoils_is_their_total_torsion() {
    let v = DVec3::new;
    let round = [
        (1.0, v(0.5, 0.0, 0.0), v(0.0, -0.5, 0.0)),
        (2.0, v(2.0, 0.0, 0.0), v(0.0, 2.0, 0.0)),
        (3.0, DVec3::ZERO, DVec3::Z),
        (5.0, v(0.5, 0.0, 0.0), v(0.0, 0.5, 0.0)),
    ];
    let flat = [
        (1.0, DVec3::Y, DVec3::X),
        (2.0, v(0.0, -2.0, 0.0), v(2.0, 0.0, 0.0)),
        (3.0, DVec3::ZERO, DVec3::NEG_Z),
    ];
    // ((2 + cos 3t) cos 2t, (2 + cos 3t) sin 2t, sin 3t) and (sin t + 2 sin 2t, cos t - 2 cos 2t, -sin 3t): degrees by
    // double reflection over 2048 steps.
    for (harmonics, known) in [(&round[..], 173.4339), (&flat[..], -127.4854)] {
        // The trapezoidal rule, which on a period converges faster than any power.
        let steps = 4000;
        let total: f64 = (0..steps)
            .map(|i| {
                let [_, d1, d2, d3] = derivatives(harmonics, TAU * f64::from(i) / f64::from(steps));
                let across = d1.cross(d2);
                across.dot(d3) / across.length_squared() * d1.length()
            })
            .sum::<f64>()
            * TAU
            / f64::from(steps);
        let torsion = -total - TAU * (-total / TAU).round();
        let holonomy = |n| Curve::closed(hermite(harmonics, n), RULE).expect("closed").holonomy();
        let error = |n| (holonomy(n) - torsion).abs();
        show(&format!(
            "trefoil: {:.4} degrees, by torsion {:.4}; off by {:.1e}, {:.1e}, {:.1e} radians at 64, 128, 256 segments",
            holonomy(256).to_degrees(),
            torsion.to_degrees(),
            error(64),
            error(128),
            error(256)
        ));
        // Hermite segments have the curve's tangents at their ends; in between these are off by the third power of the
        // step, to both sides, so the area that they enclose on the sphere by the fourth.
        assert!(error(64) < 1e-3 && error(128) < error(64) / 11.0 && error(256) < error(128) / 11.0);
        // The figure's last digit, and what is left at 256 segments.
        assert!((holonomy(256).to_degrees() - known).abs() < 1.5e-4, "{}", holonomy(256).to_degrees());
    }
}

#[test]
fn frames_of_closed_curves_close() {
    let mut random = Random(64);
    for round in 0..40 {
        let control: Vec<DVec3> = (0..7).map(|_| random.point()).collect();
        let segments =
            if round % 2 == 0 { b_spline(&control, true) } else { catmull_rom(&control, 0.5, true) }
                .expect("apart");
        for rule in [RULE, FrameRule::Frenet] {
            let curve = Curve::closed(segments.clone(), rule).expect("closed");
            let (start, end) = (curve.frame(0, 0.0), curve.frame(segments.len() - 1, 1.0));
            // A Catmull-Rom curve's curvature jumps at joints, and the principal normal with it.
            if rule == RULE || round % 2 == 0 {
                assert!(start.normal.distance(end.normal) < 1e-10, "{rule:?}");
            }
            if rule == RULE {
                // The frame turns about the tangent at one rate.
                let open = Curve::new(segments.clone(), rule).expect("a chain");
                let (segment, t) = curve.locate(0.37 * curve.length());
                let (a, b) = (open.frame(segment, t), curve.frame(segment, t));
                let turned = libm::atan2(b.normal.dot(a.binormal), b.normal.dot(a.normal));
                let off = turned + 0.37 * curve.holonomy();
                assert!((off - TAU * (off / TAU).round()).abs() < 1e-10);
            }
        }
    }
    // A straight start takes the normal that arrives there.
    let d = |x: f64, y: f64| DVec3::new(x, y, 0.0);
    let quadratic = |a: DVec3, b: DVec3, c: DVec3| Segment::quadratic([a, b, c]);
    let stadium = vec![
        quadratic(d(0.0, 0.0), d(1.0, 0.0), d(2.0, 0.0)),
        quadratic(d(2.0, 0.0), d(4.0, 0.0), d(3.0, 1.0)),
        quadratic(d(3.0, 1.0), d(2.0, 2.0), d(0.0, 1.0)),
        quadratic(d(0.0, 1.0), d(-2.0, 0.0), d(0.0, 0.0)),
    ];
    let curve = Curve::closed(stadium, FrameRule::Frenet).expect("closed");
    assert!(curve.holonomy().abs() < 1e-12);
    assert!(curve.frame(0, 0.5).binormal.distance(DVec3::Z) < 1e-12);
}

/// Where a closed curve starts, and which way it runs, changes where l and the angle begin, and the way they run; nothing
/// else.
#[test]
fn start_and_direction_of_a_closed_curve_change_only_where_coordinates_begin() {
    let mut random = Random(65);
    let control: Vec<DVec3> = (0..7)
        .map(|i| {
            let angle = TAU * f64::from(i) / 7.0;
            DVec3::new(libm::cos(angle), libm::sin(angle), 0.0) + 0.25 * random.point()
        })
        .collect();
    let scene_of = |control: &[DVec3], lines: &str| {
        scene(&format!(
            "[[tube]]\ncurve = {{ kind = \"catmull-rom\", closed = true, {} }}\nradius = 0.15\n{lines}",
            points(control)
        ))
    };
    let mut later = control.clone();
    later.rotate_left(3);
    let back: Vec<DVec3> = control.iter().rev().copied().collect();
    let places: Vec<DVec3> =
        (0..2000).map(|_| 1.4 * random.point()).map(|p| DVec3::new(p.x, p.y, 0.3 * p.z)).collect();
    let original = scene_of(&control, "");
    for other in [&later, &back] {
        let other = scene_of(other, "");
        for (find, tolerance) in [(kernel as fn(&Scene, &[DVec3]) -> Vec<f64>, 3e-6), (reference, 1e-10)] {
            let (off, peak) = difference(&find(&original, &places), &find(&other, &places));
            assert!(peak > 0.5 && off < tolerance, "{off:e}");
        }
    }
    // Coordinates: l from the new origin, the angle from another zero but turning alike.
    let coordinates = |control: &[DVec3]| Reference::new(&scene_of(control, "twist = 2\n"), None);
    let [first, other, backwards] = [&control, &later, &back].map(|control| coordinates(control));
    let (mut shifts, mut zeros) = (vec![], vec![]);
    for p in &places {
        let mut found = first.cylinder(0, p.to_array());
        found.retain(|at| at.q() <= 1.0);
        for at in found {
            let same = |reference: &Reference| {
                let all = reference.cylinder(0, p.to_array());
                all.into_iter()
                    .min_by(|a, b| (a.q() - at.q()).abs().total_cmp(&(b.q() - at.q()).abs()))
                    .expect("a foot")
            };
            let angle = libm::atan2(at.v, at.u);
            for (direction, moved) in [(1.0, same(&other)), (-1.0, same(&backwards))] {
                assert!((moved.q() - at.q()).abs() < 1e-9 && (moved.focal - at.focal).abs() < 1e-9);
                let shift = moved.fraction - direction * at.fraction;
                let zero = libm::atan2(moved.v, moved.u) - direction * angle;
                shifts.push((direction, shift - shift.floor()));
                zeros.push((direction, zero));
            }
        }
    }
    assert!(shifts.len() > 200, "{}", shifts.len());
    for direction in [1.0, -1.0] {
        for (list, period) in [(&shifts, 1.0), (&zeros, TAU)] {
            let mut list = list.iter().filter(|(d, _)| *d == direction).map(|(_, x)| *x);
            let one = list.next().expect("some");
            for x in list {
                let off = x - one;
                // Beside the axis the angle loses digits: rounding of 1e-15 over a q of 1e-8 at the least here.
                assert!((off - period * (off / period).round()).abs() < 1e-8, "{direction}: {x} and {one}");
            }
        }
    }
}
