//! Arc length and frames of curves against integrals that are taken another way.

use glam::{DMat3, DVec3};
use vdbake::curve::{Curve, FrameRule, Segment};

use crate::gates_oracle::{Bezier, Random, gauss, show};

const RULE: FrameRule = FrameRule::RotationMinimising;

fn curve(points: &[DVec3], rule: FrameRule) -> Curve {
    let segment = match *points {
        [a, b, c] => Segment::quadratic([a, b, c]),
        [a, b, c, d] => Segment::cubic([a, b, c, d]),
        _ => panic!("three or four points"),
    };
    Curve::new(vec![segment], rule).expect("a curve")
}

/// Integral over [a, b] of a function that may have any singularity at the ends (Takahasi and Mori, "Double exponential
/// formulas for numerical integration", 1974).
fn double_exponential(a: f64, b: f64, value: impl Fn(f64) -> f64) -> f64 {
    let (half, step) = (0.5 * (b - a), 1.0 / 64.0);
    let mut sum = 0.0;
    for k in -256..=256 {
        let x = step * f64::from(k);
        let inner = std::f64::consts::FRAC_PI_2 * libm::sinh(x);
        let weight = std::f64::consts::FRAC_PI_2 * libm::cosh(x) / (libm::cosh(inner) * libm::cosh(inner));
        // From the nearer end, without cancellation.
        let aside = half / (libm::cosh(inner) * libm::exp(inner.abs()));
        let t = if k < 0 { a + aside } else { b - aside };
        sum += weight * value(t);
    }
    sum * step * half
}

/// With a split where the speed is least, if that is inside.
fn length(bezier: &Bezier, split: f64) -> f64 {
    let speed = |t: f64| bezier.d1(t).length();
    if split <= 0.0 || split >= 1.0 {
        return double_exponential(0.0, 1.0, speed);
    }
    double_exponential(0.0, split, speed) + double_exponential(split, 1.0, speed)
}

#[test]
fn lengths_of_every_bend_down_to_none() {
    let mut worst = 0.0_f64;
    for k in 0..=16 {
        let bend = if k == 16 { 0.0 } else { libm::pow(0.1, f64::from(k)) };
        // In the middle, off it, at an end, and beyond: a fold but for the bend.
        for along in [0.5, 0.3, 0.0, 1.0, 1.5, -0.7] {
            let points = [DVec3::ZERO, DVec3::new(along, bend, 0.3 * bend), DVec3::X];
            let bezier = Bezier::new(&points);
            // The speed is least where C' is across C'', which is constant.
            let (e, d) = (points[1] - points[0], points[2] - 2.0 * points[1] + points[0]);
            let vertex = if d.length_squared() > 0.0 { -e.dot(d) / d.length_squared() } else { 0.0 };
            let truth = length(&bezier, vertex);
            worst = worst.max((curve(&points, RULE).length() / truth - 1.0).abs());
        }
    }
    show(&format!("lengths of quadratics are off by {worst:.1e}"));
    // A few roundings of the closed form and of the quadrature's sum.
    assert!(worst < 1e-14, "{worst:e}");
}

#[test]
fn near_circles_folds_and_parts_have_their_lengths() {
    // The usual cubic for a quarter of a circle: its radius is within 2.8e-4 of 1.
    let k = 0.552_284_749_830_793_4;
    let quarter = [DVec3::X, DVec3::new(1.0, k, 0.0), DVec3::new(k, 1.0, 0.0), DVec3::Y];
    let arc = curve(&quarter, RULE).length();
    assert!((arc / std::f64::consts::FRAC_PI_2 - 1.0).abs() < 2.8e-4);
    assert!((arc / length(&Bezier::new(&quarter), 0.0) - 1.0).abs() < 1e-13);
    let fold = curve(&[DVec3::ZERO, 1.5 * DVec3::X, DVec3::X], RULE);
    assert!((fold.length() - 1.25).abs() < 1e-15);
    let mut random = Random(41);
    for _ in 0..100 {
        let points = [random.point(), random.point(), random.point(), random.point()];
        let whole = curve(&points, RULE);
        let mut before = -1.0;
        for i in 0..=200 {
            let s = whole.arc_length(0, f64::from(i) / 200.0);
            assert!(s > before, "ds / dt > 0");
            before = s;
        }
        let bezier = Bezier::new(&points);
        let t = random.unit();
        let parts = double_exponential(0.0, t, |t| bezier.d1(t).length());
        assert!((whole.arc_length(0, t) - parts).abs() < 1e-9 * whole.length());
    }
}

/// C' x C'' and the torsion times the speed.
fn turning(bezier: &Bezier, d3: DVec3, t: f64) -> (DVec3, f64) {
    let (d1, d2) = (bezier.d1(t), bezier.d2(t));
    let across = d1.cross(d2);
    (across, across.dot(d3) / across.length_squared() * d1.length())
}

/// Against the principal normal, a rotation-minimising frame turns back by the integral of the torsion: nothing of its own
/// construction is in that.
#[test]
fn the_frame_turns_against_the_principal_normal_by_the_torsion() {
    let mut random = Random(42);
    let (mut worst, mut count) = (0.0_f64, 0);
    while count < 100 {
        let points = [random.point(), random.point(), random.point(), random.point()];
        let bezier = Bezier::new(&points);
        let d3 = 6.0 * (points[3] - 3.0 * points[2] + 3.0 * points[1] - points[0]);
        // Where the curve is nearly straight the torsion peaks.
        let straightest = (0..=400)
            .map(|i| f64::from(i) / 400.0)
            .map(|t| turning(&bezier, d3, t).0.length() / bezier.d1(t).length_squared())
            .fold(f64::MAX, f64::min);
        let slowest = (0..=400).map(|i| bezier.d1(f64::from(i) / 400.0).length()).fold(f64::MAX, f64::min);
        if straightest < 0.05 || slowest < 0.3 {
            continue;
        }
        count += 1;
        let (minimising, frenet) = (curve(&points, RULE), curve(&points, FrameRule::Frenet));
        let angle = |t: f64| {
            let (f, g) = (minimising.frame(0, t), frenet.frame(0, t));
            let (across, _) = turning(&bezier, d3, t);
            assert!(g.binormal.distance(across.normalize()) < 1e-11);
            libm::atan2(f.normal.dot(g.binormal), f.normal.dot(g.normal))
        };
        for t in [0.35, 1.0] {
            let panel = |k: u32| t * f64::from(k) / 1000.0;
            let torsion: f64 =
                (0..1000).map(|k| gauss(panel(k), panel(k + 1), |t| turning(&bezier, d3, t).1)).sum();
            let turned = angle(t) - angle(0.0) + torsion;
            let rest = turned - std::f64::consts::TAU * (turned / std::f64::consts::TAU).round();
            worst = worst.max(rest.abs());
        }
    }
    show(&format!("frames are off by {worst:.1e} radians"));
    // What the curve promises for a segment.
    assert!(worst < 1e-11, "{worst:e}");
}

#[test]
fn frames_are_orthonormal_and_flat_in_a_plane_and_flips_are_named() {
    let mut random = Random(43);
    for i in 0..200 {
        let flat = |p: DVec3| if i % 2 == 0 { p } else { DVec3::new(p.x, p.y, 0.0) };
        let points = [random.point(), random.point(), random.point(), random.point()].map(flat);
        for rule in [RULE, FrameRule::Frenet] {
            let curve = curve(&points, rule);
            for k in 0..=20 {
                let f = curve.frame(0, f64::from(k) / 20.0);
                let m = DMat3::from_cols(f.normal, f.binormal, f.tangent);
                assert!((m.transpose() * m).abs_diff_eq(DMat3::IDENTITY, 1e-13));
                assert!((m.determinant() - 1.0).abs() < 1e-13);
                if i % 2 == 1 && rule == RULE {
                    let start = curve.frame(0, 0.0).binormal;
                    // Around a cusp nothing is claimed; nearly all random cubics have none.
                    assert!(
                        curve.breaks(0).len() == 1 || f.binormal.dot(DVec3::Z) * start.dot(DVec3::Z) >= -1e-9
                    );
                    assert!((f.binormal.dot(DVec3::Z) - start.dot(DVec3::Z)).abs() < 1e-9);
                }
            }
            // In a plane, Frenet's normal flips at each inflection: where C' x C'' changes sign.
            if i % 2 == 1 && rule == FrameRule::Frenet {
                let bezier = Bezier::new(&points);
                let side = |k: u32| {
                    let t = f64::from(k) / 1000.0;
                    bezier.d1(t).cross(bezier.d2(t)).z > 0.0
                };
                let flips: Vec<u32> = (1..=1000).filter(|&k| side(k) != side(k - 1)).collect();
                assert_eq!(curve.breaks(0).len(), flips.len(), "{points:?}");
                for (t, k) in curve.breaks(0).iter().zip(flips) {
                    assert!((t * 1000.0 - f64::from(k)).abs() <= 1.01);
                }
            }
        }
    }
}
