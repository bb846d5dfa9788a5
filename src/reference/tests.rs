//! Whole scenes against closed forms.
#![allow(clippy::unwrap_used, reason = "what is not there fails the test")]

use super::*;
use crate::curve::{Curve, FrameRule, Profile, Segment};
use crate::scene::{
    Antialias, Bake, Camera, Conserve, Fbm, Form, Medium, Overlap, Rest, Space, Step, TimeBase, Warnings,
};
use glam::DVec3;

/// Uniform numbers in [0, 1) (Steele, Lea and Flood, "Fast splittable pseudorandom number generators", 2014).
pub(super) struct Random(pub(super) u64);

impl Random {
    pub(super) fn unit(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ z >> 30).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ z >> 27).wrapping_mul(0x94D0_49BB_1331_11EB);
        f64::from(u32::try_from((z ^ z >> 31) >> 32).unwrap()) / 4_294_967_296.0
    }

    pub(super) fn within(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }

    pub(super) fn point(&mut self, reach: f64) -> [f64; 3] {
        [0; 3].map(|_| self.within(-reach, reach))
    }
}

fn tube(segments: Vec<Segment>) -> Tube {
    Tube {
        name: "tube".into(),
        curve: Curve::new(segments, FrameRule::RotationMinimising).unwrap(),
        radius: Profile::constant(0.5).unwrap(),
        sampling_error: None,
        twist: 0.0,
        spin: 0.0,
        turned: 0.0,
        stretch: true,
        frame: FrameRule::RotationMinimising,
        caps: Caps::Flat,
        radial: Radial::Smooth,
        conserve: Conserve::Off,
        rest: Rest { radius: 1.0, length: 1.0 },
        overlap: Overlap::Max,
        layers: Vec::new(),
        color: None,
        temperature: None,
    }
}

fn scene(tubes: Vec<Tube>) -> Scene {
    Scene {
        name: "scene".into(),
        bake: Bake {
            step: Step::VoxelSize(0.1),
            cutoff: 0.0,
            octave_fade: true,
            widen: true,
            antialias: Antialias::Off,
        },
        time: TimeBase { fps: 24.0, start: 1, end: None },
        overlap: Overlap::Max,
        tubes,
        medium: Medium {
            extinction: 1.0,
            albedo: [0.5; 3],
            anisotropy: 0.0,
            emission: [0.0; 3],
            temperature: None,
        },
        camera: Camera::default(),
        lights: Vec::new(),
        text: String::new(),
        inputs: Vec::new(),
        warnings: Warnings::default(),
        origin: String::new(),
        places: std::sync::OnceLock::new(),
        seconds: 0.0,
        moving: false,
    }
}

/// A tube after it has spun for `time` seconds.
fn reference(tube: &Tube, time: f64) -> Reference {
    let tube = Tube { turned: tube.spin * time, ..tube.clone() };
    Reference::new(&scene(vec![tube]), None)
}

fn quadratic(a: [f64; 3], b: [f64; 3], c: [f64; 3]) -> Segment {
    Segment::quadratic([a, b, c].map(DVec3::from))
}

fn cubic(a: [f64; 3], b: [f64; 3], c: [f64; 3], d: [f64; 3]) -> Segment {
    Segment::cubic([a, b, c, d].map(DVec3::from))
}

fn line(a: [f64; 3], b: [f64; 3]) -> Segment {
    let middle = (DVec3::from(a) + DVec3::from(b)) / 2.0;
    Segment::quadratic([a.into(), middle, b.into()])
}

fn random_cubic(random: &mut Random) -> Segment {
    cubic(random.point(1.0), random.point(1.0), random.point(1.0), random.point(1.0))
}

fn layer(op: Op, pattern: Pattern, threshold: Option<f64>, multiplier: f64) -> Layer {
    Layer { op, pattern, threshold, multiplier }
}

fn noise() -> Fbm {
    Fbm {
        frequency: [2.0, 3.0, 4.0],
        octaves: 5,
        lacunarity: 2.0,
        gain: 0.5,
        normalise: true,
        seed: 7,
        scrolled: [0.0, 0.05, -0.15],
        form: Form::Fbm,
        rotate: false,
        warp: None,
        space: Space::Cylinder,
        offset: [0.0; 3],
    }
}

fn assert_close(found: f64, wanted: f64, tolerance: f64, what: &str) {
    assert!((found - wanted).abs() <= tolerance, "{what}: {found} against {wanted}");
}

/// Along +x the smallest rotation from +z takes +x to -z and leaves +y.
#[test]
fn a_straight_tube_has_explicit_coordinates() {
    let mut tube = tube(vec![line([1.0, 2.0, 3.0], [5.0, 2.0, 3.0])]);
    (tube.twist, tube.spin, tube.stretch) = (1.25, 0.5, false);
    let reference = reference(&tube, 3.3);
    let mut random = Random(1);
    for _ in 0..100 {
        let [s, y, z] = [random.within(0.01, 3.99), random.within(-2.0, 2.0), random.within(-2.0, 2.0)];
        let found = reference.cylinder(0, [1.0 + s, 2.0 + y, 3.0 + z]);
        assert_eq!(found.len(), 1);
        let phi = TAU * (1.25 * s / 4.0 + 0.5 * 3.3);
        let (sin, cos) = (libm::sin(phi), libm::cos(phi));
        // Rounding of phi near 18 and of coordinates near 7, over a radius of 0.5.
        assert_close(found[0].u, (-z * cos + y * sin) / 0.5, 5e-14, "u");
        assert_close(found[0].v, (z * sin + y * cos) / 0.5, 5e-14, "v");
        assert_close(found[0].l, s, 1e-14, "l");
        assert_close(found[0].w, 0.0, 0.0, "w");
        assert_close(found[0].focal, 1.0, 0.0, "focal");
    }
}

#[test]
fn radial_envelopes_have_their_formulas() {
    let mut tube = tube(vec![line([0.0; 3], [0.0, 0.0, 1.0])]);
    for x in [0.0, 0.3, 0.8, 0.95] {
        let cases = [
            (Radial::Smooth, (1.0 - x * x) * (1.0 - x * x)),
            (Radial::Linear, 1.0 - x),
            (Radial::Hard, 1.0),
            (Radial::Edge(0.4), if x < 0.6 { 1.0 } else { 1.0 - smoothstep(0.6, 1.0, x) }),
        ];
        for (radial, wanted) in cases {
            tube.radial = radial;
            let reference = reference(&tube, 0.0);
            assert_close(reference.density([0.5 * x, 0.0, 0.4]), wanted, 1e-14, "inside");
            assert_close(reference.density([0.0, 0.51, 0.4]), 0.0, 0.0, "outside");
        }
    }
}

#[test]
fn caps_end_the_tube_as_they_say() {
    let mut tube = tube(vec![line([0.0; 3], [0.0, 0.0, 2.0])]);
    tube.radial = Radial::Linear;
    let density = |tube: &Tube, z: f64| reference(tube, 0.0).density([0.25, 0.0, z]);
    assert_close(density(&tube, -1e-9), 0.0, 0.0, "flat, below");
    assert_close(density(&tube, 1e-9), 0.5, 1e-14, "flat, above");
    tube.caps = Caps::Round;
    for z in [-0.4, -0.2, 2.3] {
        let beyond = if z < 0.0 { z } else { z - 2.0 };
        let wanted = 1.0 - (0.25_f64 * 0.25 + beyond * beyond).sqrt() / 0.5;
        assert_close(density(&tube, z), wanted.max(0.0), 1e-14, "round");
    }
    let at = reference(&tube, 0.0).cylinder(0, [0.1, 0.2, 2.3]);
    assert_eq!(at.len(), 1);
    for (found, wanted) in [at[0].u, at[0].v, at[0].w, at[0].l].into_iter().zip([0.2, 0.4, 0.6, 1.0]) {
        assert_close(found, wanted, 1e-14, "beyond the end");
    }
    tube.caps = Caps::Fade(0.25);
    for (z, wanted) in [(0.0, 0.0), (0.25, 0.25), (0.5, 0.5), (1.0, 0.5), (1.75, 0.25)] {
        // Half way up a smoothstep it is one half.
        assert_close(density(&tube, z), wanted, 1e-14, "fade");
    }
}

/// A ring of 64 parabolas: the largest distance to the circle is about R (2 pi / 64)^4 / 128, near 7e-7 R.
#[test]
fn a_ring_is_a_torus() {
    let n = 64;
    let angle = |i: f64| TAU * i / f64::from(n);
    let at = |i: f64, r: f64| [r * libm::cos(angle(i)), r * libm::sin(angle(i)), 0.0];
    let outer = 2.0 / libm::cos(angle(0.5));
    let arcs = (0..n).map(f64::from).map(|i| quadratic(at(i, 2.0), at(i + 0.5, outer), at(i + 1.0, 2.0)));
    let mut tube = tube(arcs.collect());
    tube.radial = Radial::Linear;
    tube.radius = Profile::constant(1.9).unwrap();
    let reference = reference(&tube, 0.0);
    // The tangents' turn is not even along the parabolas: the curvature is off by up to (2 pi / 64)^2 / 4,
    // twice 1e-3.
    assert_close(reference.length(0), 2.0 * TAU, 1e-5, "length");
    let mut random = Random(2);
    for _ in 0..200 {
        let (theta, phi, rho) = (random.within(0.0, TAU), random.within(0.0, TAU), random.within(0.0, 1.8));
        let ring = 2.0 + rho * libm::cos(phi);
        let p = [ring * libm::cos(theta), ring * libm::sin(theta), rho * libm::sin(phi)];
        // The far side of the ring is a second foot only where the distance has a second minimum: on a
        // circle, never.
        let feet = reference.feet(0, p);
        let near = feet.iter().map(|foot| foot.distance).fold(f64::MAX, f64::min);
        assert_close(near, rho, 1e-5, "distance");
        let wanted = (1.0 - rho / 1.9) * smoothstep(0.0, 0.2, ring / 2.0);
        if ring > 0.3 {
            assert_close(reference.density(p), wanted, 0.02, "density");
        }
    }
}

/// Feet on the parabola (x, x^2) from x = -1 to 1 solve `2 x^3 + (1 - 2 y0) x - x0 = 0`.
#[test]
fn feet_on_a_parabola_solve_its_cubic() {
    let tube = tube(vec![quadratic([-1.0, 1.0, 0.0], [0.0, -1.0, 0.0], [1.0, 1.0, 0.0])]);
    let reference = reference(&tube, 0.0);
    let mut random = Random(3);
    let mut several = 0;
    for _ in 0..500 {
        let p = random.point(1.5);
        // Cardano for x^3 + a x + b = 0; of three real roots the middle one is a local maximum of the
        // distance.
        let (a, b) = (0.5 - p[1], -0.5 * p[0]);
        let discriminant = b * b / 4.0 + a * a * a / 27.0;
        let mut roots = if discriminant >= 0.0 {
            let d = discriminant.sqrt();
            vec![libm::cbrt(-b / 2.0 + d) + libm::cbrt(-b / 2.0 - d)]
        } else {
            let size = 2.0 * (-a / 3.0).sqrt();
            let angle = libm::acos((3.0 * b / (a * size)).clamp(-1.0, 1.0)) / 3.0;
            vec![size * libm::cos(angle), size * libm::cos(angle - 2.0 * TAU / 3.0)]
        };
        roots.retain(|x| x.abs() < 1.0);
        roots.sort_by(f64::total_cmp);
        let mut feet: Vec<f64> = reference.feet(0, p).iter().map(|foot| 2.0 * foot.t - 1.0).collect();
        feet.sort_by(f64::total_cmp);
        assert_eq!(feet.len(), roots.len(), "{p:?}: {feet:?} against {roots:?}");
        several += usize::from(feet.len() > 1);
        for (foot, root) in feet.iter().zip(&roots) {
            // Cardano's formula cancels: it keeps about half of the digits where the roots are close.
            assert_close(*foot, *root, 1e-7, "foot");
            let g = 2.0 * foot * foot * foot + 2.0 * a * foot + 2.0 * b;
            assert_close(g, 0.0, 1e-14, "residual");
        }
    }
    assert!(several > 20, "{several} points with two feet");
}

#[test]
fn no_foot_escapes_that_dense_sampling_finds() {
    let mut random = Random(4);
    for _ in 0..40 {
        let segment = random_cubic(&mut random);
        let reference = reference(&tube(vec![segment]), 0.0);
        for _ in 0..10 {
            let p = random.point(1.2);
            let distance = |i: i32| (segment.at(f64::from(i) / 4000.0) - DVec3::from(p)).length();
            let least =
                (1..4000).filter(|&i| distance(i) < distance(i - 1) && distance(i) <= distance(i + 1));
            let sampled: Vec<f64> = least.map(|i| f64::from(i) / 4000.0).collect();
            let feet = reference.feet(0, p);
            // The least of the samples lies within one step of the minimum, and the points have no two that
            // close.
            let near = |a: f64, b: f64| (a - b).abs() <= 1.0 / 4000.0;
            for &t in &sampled {
                assert!(feet.iter().any(|foot| near(foot.t, t)), "{p:?}: none at {t}");
            }
            for foot in feet {
                let found =
                    sampled.iter().any(|&t| near(foot.t, t)) || near(foot.t, 0.0) || near(foot.t, 1.0);
                assert!(found, "{p:?}: one at {}", foot.t);
            }
        }
    }
}

/// With C' = 0 on the way, the curve turns back, and the density beyond is that of a ball, not of an endless
/// cylinder.
#[test]
fn folds_and_cusps_end_in_balls() {
    let fold = quadratic([0.0, 0.0, 0.0], [3.0, 0.0, 0.0], [2.0, 0.0, 0.0]);
    let cusp = cubic([0.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]);
    let joint = [line([0.0; 3], [2.0, 0.0, 0.0]), line([2.0, 0.0, 0.0], [0.5, 0.0, 0.0])];
    for (segments, tip, out) in [
        (vec![fold], [2.25, 0.0, 0.0], [1.0, 0.0, 0.0]),
        (vec![cusp], [0.5, 0.75, 0.0], [0.0, 1.0, 0.0]),
        (joint.to_vec(), [2.0, 0.0, 0.0], [1.0, 0.0, 0.0]),
    ] {
        let mut tube = tube(segments);
        tube.radial = Radial::Linear;
        for rule in [FrameRule::RotationMinimising, FrameRule::Frenet] {
            tube.frame = rule;
            let reference = reference(&tube, 0.0);
            for step in [1e-6, 0.1, 0.3, 0.49, 0.51, 2.0] {
                let p = [0, 1, 2].map(|axis| tip[axis] + step * out[axis]);
                let wanted = (1.0_f64 - step / 0.5).max(0.0);
                assert_close(reference.density(p), wanted, 1e-12, "beyond the tip");
            }
        }
    }
    // 2.25 out and 0.25 back.
    assert_close(reference(&tube(vec![fold]), 0.0).length(0), 2.5, 1e-14, "length");
}

/// Control points that coincide at an end leave C' = 0 there; the line is the same line.
#[test]
fn a_standing_start_changes_nothing_on_a_line() {
    let (a, b) = ([1.0, 0.0, 0.0], [3.0, 1.0, 2.0]);
    let plain = reference(&tube(vec![line(a, b)]), 0.0);
    let mut random = Random(5);
    for still in
        [quadratic(a, a, b), quadratic(a, b, b), cubic(a, a, b, b), cubic(a, a, a, b), cubic(a, b, b, b)]
    {
        let still = reference(&tube(vec![still]), 0.0);
        assert_close(still.length(0), 3.0, 1e-14, "length");
        for _ in 0..50 {
            let p = [0, 1, 2].map(|axis| random.within(a[axis] - 0.5, b[axis] + 0.5));
            let (one, other) = (plain.cylinder(0, p), still.cylinder(0, p));
            assert_eq!(one.is_empty(), other.is_empty(), "{p:?}");
            for (one, other) in one.iter().zip(&other) {
                for (x, y) in [(one.u, other.u), (one.v, other.v), (one.l, other.l), (one.focal, other.focal)]
                {
                    assert_close(x, y, 1e-13, "coordinates");
                }
            }
        }
    }
}

/// On both sides of the planes that bound a corner's wedge the coordinates agree, and so do densities.
#[test]
fn coordinates_are_continuous_around_a_corner() {
    let mut tube = tube(vec![line([0.0; 3], [0.0, 0.0, 2.0]), line([0.0, 0.0, 2.0], [1.2, 0.5, 2.8])]);
    tube.twist = 0.7;
    tube.layers = vec![layer(Op::Multiply, Pattern::Perlin(noise()), None, 1.0)];
    let reference = reference(&tube, 0.0);
    let corner = Vector3::new(0.0, 0.0, 2.0);
    let (t1, t2) = (Vector3::z(), Vector3::new(1.2, 0.5, 0.8).normalize());
    let axis = t1.cross(&t2).normalize();
    let mut random = Random(6);
    let step = 1e-9;
    for _ in 0..200 {
        let (along, out) = (random.within(-0.3, 0.3), random.within(0.05, 0.3));
        for (tangent, side) in [(t1, t1.cross(&axis)), (t2, t2.cross(&axis))] {
            let p = corner + along * axis + out * side;
            let values = [-step, step].map(|step| reference.cylinder(0, (p + step * tangent).into()));
            assert_eq!([values[0].len(), values[1].len()], [1, 1], "{p}");
            let (a, b) = (values[0][0], values[1][0]);
            // A step across moves u and v by at most 2 step / r and the turn of 1.2 radians over 0.05 m.
            for (x, y) in [(a.u, b.u), (a.v, b.v), (a.l, b.l)] {
                assert_close(x, y, 30.0 * step, "coordinates");
            }
            let densities = [-step, step].map(|step| reference.density((p + step * tangent).into()));
            // Slopes: 3.75 a lattice cell and octave, 4 cells a unit, 5 octaves of equal slope, 30 units a
            // metre.
            assert_close(densities[0], densities[1], 3.75 * 4.0 * 5.0 * 30.0 * step, "density");
        }
        // In the middle of the wedge the distance is kept.
        let p = corner + along * axis + out * (t1.cross(&axis) + t2.cross(&axis)).normalize();
        let at = reference.cylinder(0, p.into());
        assert_eq!(at.len(), 1);
        assert_close(at[0].q().sqrt() * 0.5, (along * along + out * out).sqrt(), 1e-14, "distance");
    }
}

/// The map from cylinder to world, with the curve module's own frames and arc length, is undone.
#[test]
fn coordinates_invert_the_map_to_the_world() {
    let mut random = Random(7);
    for rule in [FrameRule::RotationMinimising, FrameRule::Frenet] {
        for _ in 0..20 {
            let segments: Vec<Segment> = {
                let (one, two) = (random_cubic(&mut random), random_cubic(&mut random));
                let end = one.at(1.0);
                vec![one, quadratic(end.into(), two.at(0.4).into(), two.at(1.0).into())]
            };
            let mut tube = tube(segments);
            (tube.frame, tube.twist, tube.spin) = (rule, 2.2, 0.4);
            tube.curve = Curve::new(tube.curve.segments().to_vec(), rule).unwrap();
            tube.radius = Profile::keyed(&[(0.0, 0.1), (0.3, 0.4), (0.6, 0.35), (1.0, 0.8)]).unwrap();
            let reference = reference(&tube, 1.7);
            let length = tube.curve.length();
            assert_close(reference.length(0), length, 1e-12 * length, "length");
            for _ in 0..50 {
                let (segment, t) = (usize::from(random.unit() < 0.5), random.unit());
                let (u, v) = (random.within(-0.2, 0.2), random.within(-0.2, 0.2));
                let frame = tube.curve.frame(segment, t);
                let l = tube.curve.arc_length(segment, t) / length;
                let r = tube.radius.at(l);
                let phi = TAU * (2.2 * l + 0.4 * 1.7);
                let (sin, cos) = (libm::sin(phi), libm::cos(phi));
                let across = frame.normal * (u * cos - v * sin) + frame.binormal * (u * sin + v * cos);
                let p = tube.curve.segments()[segment].at(t) + across * r;
                let error = |at: &Cylindrical| {
                    ((at.u - u).abs() + (at.v - v).abs() + (at.l - l).abs()) * at.focal.abs().min(1.0)
                };
                // Not a foot where the normal planes have crossed; else it is found, to rounding over the
                // focal term.
                let found = reference.cylinder(0, p.into());
                let best = found.iter().map(error).fold(f64::MAX, f64::min);
                let bend = tube.curve.segments()[segment];
                let (d1, d2) = (bend.d1(t), bend.d2(t));
                let focal = 1.0 - (across * r).dot(d2) / d1.length_squared();
                if focal > 1e-3 {
                    assert!(best < 1e-10, "{rule:?} segment {segment} t {t}: off by {best}");
                }
            }
        }
    }
}

#[test]
fn layers_join_in_order() {
    let mut tube = tube(vec![line([0.0; 3], [0.0, 0.0, 1.0])]);
    tube.radial = Radial::Hard;
    let density = |tube: &Tube| reference(tube, 0.0).density([0.1, 0.2, 0.5]);
    let constant = |op, value| layer(op, Pattern::Constant(value), None, 1.0);
    let cases = [
        (vec![], 1.0),
        (vec![constant(Op::Multiply, 3.0), constant(Op::Add, 0.5)], 3.5),
        (vec![constant(Op::Add, 0.5), constant(Op::Multiply, 3.0)], 4.5),
        (vec![constant(Op::Max, 2.0), constant(Op::Min, 1.5)], 1.5),
        (vec![constant(Op::Multiply, -1.0)], 0.0),
        (vec![layer(Op::Multiply, Pattern::Constant(0.7), Some(0.2), 4.0)], 2.0),
        (vec![layer(Op::Multiply, Pattern::Constant(0.1), Some(0.2), 4.0)], 0.0),
        (vec![layer(Op::Add, Pattern::Sectors, None, 2.0)], 3.0),
    ];
    for (layers, wanted) in cases {
        tube.layers = layers;
        assert_close(density(&tube), wanted, 1e-14, "layers");
    }
    tube.twist = 0.5;
    // Half way up, a quarter of a turn: u and v have opposite signs now.
    assert_close(density(&tube), 1.0, 0.0, "turned sectors");
}

#[test]
fn the_largest_contribution_of_all_tubes_counts() {
    let mut low = tube(vec![line([0.0; 3], [0.0, 0.0, 1.0])]);
    low.radial = Radial::Linear;
    let mut high = tube(vec![line([0.3, 0.0, 0.0], [0.3, 0.0, 1.0])]);
    high.radial = Radial::Linear;
    let both = Reference::new(&scene(vec![low.clone(), high.clone()]), None);
    for x in [0.0, 0.1, 0.2, 0.3] {
        let p = [x, 0.05, 0.5];
        let wanted = reference(&low, 0.0).density(p).max(reference(&high, 0.0).density(p));
        assert_close(both.density(p), wanted, 0.0, "maximum");
    }
}

#[test]
fn there_is_no_tube_where_the_radius_has_vanished() {
    let mut tube = tube(vec![line([0.0; 3], [0.0, 0.0, 1.0])]);
    tube.radial = Radial::Hard;
    tube.radius = Profile::keyed(&[(0.0, 0.0), (0.5, 0.0), (1.0, 1.0)]).unwrap();
    let reference = reference(&tube, 0.0);
    assert_close(reference.density([0.0, 0.0, 0.25]), 0.0, 0.0, "no radius");
    assert_close(reference.density([0.0, 0.0, 0.75]), 1.0, 0.0, "some radius");
    tube.radius = Profile::constant(0.0).unwrap();
    assert_close(self::reference(&tube, 0.0).density([0.0, 0.0, 0.5]), 0.0, 0.0, "none at all");
}

/// Without twist the two rates are F / r across and f_l / L along.
#[test]
fn octaves_fade_by_cells_per_voxel() {
    let mut tube = tube(vec![line([0.0; 3], [0.0, 0.0, 2.0])]);
    tube.radial = Radial::Hard;
    let noise = Fbm { octaves: 1, frequency: [1.0, 3.0, 4.0], normalise: false, ..noise() };
    tube.layers = vec![layer(Op::Multiply, Pattern::Constant(2.0), None, 1.0)];
    tube.layers.push(layer(Op::Add, Pattern::Perlin(noise), None, 1.0));
    let mut scene = scene(vec![tube]);
    scene.bake.widen = false;
    let p = [0.1, 0.2, 0.7];
    let density = |scene: &Scene, h| Reference::new(scene, h).density(p);
    let full = density(&scene, None) - 2.0;
    assert!(full.abs() > 0.01);
    // 3 cells a radius of 0.5 are 6 a metre: faded wholly at h = 1.6 / 6, not at all at 0.7 / 6.
    assert_close(density(&scene, Some(0.116)) - 2.0, full, 0.0, "coarse enough");
    assert_close(density(&scene, Some(0.267)), 2.0, 0.0, "too fine");
    let half = (0.7_f64 * 1.6).sqrt() / 6.0;
    assert_close(density(&scene, Some(half)) - 2.0, 0.5 * full, 1e-14, "half way");
    scene.tubes[0].twist = 1.0;
    // One turn in 2 m at q = 0.2: the matrix [6, 3 pi sqrt(0.2)], [0, 2] has singular values whose squares
    // sum to that of its entries and whose product is 12.
    let squares = 36.0 + 9.0 * (TAU / 2.0) * (TAU / 2.0) * 0.2 + 4.0;
    let sigma = ((squares + (squares * squares - 4.0 * 144.0).sqrt()) / 2.0).sqrt();
    let turned = density(&scene, None) - 2.0;
    let half = (0.7_f64 * 1.6).sqrt() / sigma;
    assert_close(density(&scene, Some(half)) - 2.0, 0.5 * turned, 1e-14, "twisted");
    scene.bake.octave_fade = false;
    assert_close(density(&scene, Some(1.0)) - 2.0, turned, 0.0, "switched off");
}

#[test]
fn far_from_the_origin_the_pattern_is_the_same() {
    let at = |shift: f64| {
        let mut tube =
            tube(vec![quadratic([shift, 0.0, 0.0], [shift + 1.0, 0.5, 0.0], [shift + 2.0, 0.25, 1.0])]);
        tube.layers = vec![layer(Op::Add, Pattern::Perlin(noise()), None, 1.0)];
        reference(&tube, 0.5)
    };
    let shift = 1_048_576.0;
    let (near, far) = (at(0.0), at(shift));
    let mut random = Random(8);
    for _ in 0..50 {
        // Multiples of 2^-20 keep their bits after the shift.
        let grid = |x: f64| (x * 1_048_576.0).round() / 1_048_576.0;
        let p =
            [grid(random.within(0.0, 2.0)), grid(random.within(-0.3, 0.7)), grid(random.within(-0.3, 1.0))];
        let moved = [p[0] + shift, p[1], p[2]];
        // The foot's coordinates round to 1e-10 there; slopes are below 75 / 0.5.
        assert_close(far.density(moved), near.density(p), 150.0 * 2.4e-10, "density");
    }
}

/// Powers of four scale every intermediate result exactly, square roots too.
#[test]
fn scale_does_not_matter() {
    let mut random = Random(9);
    let points = [0; 4].map(|_| random.point(1.0));
    let at = |scale: f64| {
        let [a, b, c, d] = points.map(|p| p.map(|x| x * scale));
        let mut tube = tube(vec![cubic(a, b, c, d)]);
        tube.radius = Profile::constant(0.4 * scale).unwrap();
        tube.caps = Caps::Round;
        tube.layers = vec![layer(Op::Add, Pattern::Perlin(noise()), None, 1.0)];
        reference(&tube, 0.0)
    };
    let plain = at(1.0);
    let large = 4_611_686_018_427_387_904.0;
    for scale in [1.0 / large, large] {
        let scaled = at(scale);
        for _ in 0..100 {
            let p = random.point(1.2);
            assert_close(scaled.density(p.map(|x| x * scale)), plain.density(p), 1e-13, "scaled");
        }
    }
}

#[test]
fn extreme_numbers_give_finite_densities() {
    let mut random = Random(10);
    let wild = Fbm { octaves: 32, lacunarity: 1e12, gain: 1.5, scrolled: [1e18; 3], ..noise() };
    let still = Fbm { frequency: [0.0; 3], octaves: 4, gain: 0.0, ..noise() };
    for sharpness in [0.0, 1e-15, 1e-12, 1e-9, 1e-3] {
        let cusp = cubic([0.0; 3], [1.0, 1.0, sharpness], [0.0, 1.0, 0.0], [1.0 + sharpness, 0.0, 0.0]);
        let fold = quadratic([1.0, 0.0, 0.0], [4.0, sharpness, 0.0], [3.0, 0.0, 0.0]);
        let mut tube = tube(vec![cusp, quadratic([1.0 + sharpness, 0.0, 0.0], [1.0; 3], [1.0; 3])]);
        (tube.twist, tube.turned) = (1e4, 1e18);
        tube.layers = vec![layer(Op::Multiply, Pattern::Perlin(wild.clone()), Some(-5.0), 1.0)];
        tube.layers.push(layer(Op::Add, Pattern::Perlin(still.clone()), None, 1.0));
        let mut folded = tube.clone();
        folded.curve = Curve::new(vec![fold], FrameRule::RotationMinimising).unwrap();
        folded.caps = Caps::Round;
        for rule in [FrameRule::RotationMinimising, FrameRule::Frenet] {
            (tube.frame, folded.frame) = (rule, rule);
            let scene = scene(vec![tube.clone(), folded.clone()]);
            for voxel in [None, Some(1e-3)] {
                let reference = Reference::new(&scene, voxel);
                for _ in 0..50 {
                    let density = reference.density(random.point(1.5));
                    assert!(density.is_finite() && density >= 0.0, "{density}");
                }
                // On the axis, at the tips and at the ends, where products vanish.
                for p in [[0.5, 0.75, 0.0], [0.0; 3], [1.0; 3], [3.25, 0.0, 0.0], [3.0, 0.0, 0.0]] {
                    assert!(reference.density(p).is_finite());
                }
            }
        }
    }
}
