//! Frames: what a lap around a closed curve turns, and curves that all but stand still.

use std::f64::consts::{PI, TAU};

use glam::DVec3;

use super::{NOISE, quadratic};
use crate::check::case::{Case, Look, Verdict, evaluates, scene};
use crate::curve::{Curve, FrameRule, Segment};
use crate::reference::Reference;
use crate::report::random;

const GROUP: &str = "frames";

pub(super) fn cases() -> Vec<Case> {
    let mut cases = vec![
        Case::new(
            GROUP,
            "a lap in a plane",
            "no turn within 1e-11: tangents on a great circle enclose half a sphere, a whole turn",
            || turned(&plane(), 0.0, 1e-11),
        ),
        Case::new(
            GROUP,
            "a lap around three edges of a cube and its diagonal",
            "-pi/3 within 1e-11: the tangents enclose 5 pi/3 of the sphere (Gauss and Bonnet)",
            || turned(&polygon(&edges()), -PI / 3.0, 1e-11),
        ),
        Case::new(
            GROUP,
            "the same lap the other way, and in a mirror",
            "-pi/3 and pi/3 within 1e-11: the turn belongs to the curve and not to its direction, and a mirror changes its side",
            || {
                let mut back = edges();
                back.reverse();
                let mirrored: Vec<DVec3> = edges().iter().map(|p| DVec3::new(-p.x, p.y, p.z)).collect();
                Verdict::all([
                    turned(&polygon(&back), -PI / 3.0, 1e-11),
                    turned(&polygon(&mirrored), PI / 3.0, 1e-11),
                ])
            },
        ),
        Case::new(
            GROUP,
            "a lap around a quadrilateral in space",
            "the area of its four tangents, two spherical triangles by their solid angles, within 1e-11",
            || {
                let points =
                    [[0.0, 0.0, 0.0], [1.0, 0.1, 0.2], [1.3, 1.0, 0.9], [0.1, 0.8, -0.3]].map(DVec3::from);
                turned(&polygon(&points), enclosed(&points), 1e-11)
            },
        ),
        Case::new(
            GROUP,
            "a lap on a sphere",
            "no turn: the radius is carried without turning; 512 cubics are off by less than 1e-6, and 8 times less than 256 are (it is 16 times in the end)",
            on_a_sphere,
        ),
        Case::new(
            GROUP,
            "noise around a lap that turns",
            "the definition within 2e-5 of the peak, beside corners",
            || {
                let points = edges();
                let chain: Vec<[f64; 3]> = (0..4)
                    .flat_map(|i| [points[i], 0.5 * (points[i] + points[(i + 1) % 4])])
                    .chain([points[0]])
                    .map(|p| p.to_array())
                    .collect();
                let text = format!(
                    "[[tube]]\ncurve = {{ closed = true, points = {chain:?} }}\nradius = 0.1\ntwist = 2\n{NOISE}\n"
                );
                evaluates(&text, Look::at(0.01).within(super::curves::FOCAL))
            },
        ),
    ];
    for speed in [1e-300, 1e-310, 5e-324] {
        cases.push(Case::new(
            GROUP,
            format!("a curve that starts at {speed:e} m a unit"),
            "the density where it starts at rest, within 1e-9, and by the kernel within 4e-6 of the peak",
            move || slow_start(speed),
        ));
    }
    cases
}

/// Corners of a cube: along three of its edges, and back across it.
fn edges() -> Vec<DVec3> {
    vec![DVec3::ZERO, DVec3::X, DVec3::X + DVec3::Y, DVec3::ONE]
}

/// A closed chain of straight lines.
fn polygon(points: &[DVec3]) -> Vec<Segment> {
    let next = points.iter().cycle().skip(1);
    points.iter().zip(next).map(|(a, b)| Segment::quadratic([*a, 0.5 * (*a + *b), *b])).collect()
}

/// A closed chain of cubics through a wavy ring in a plane that no axis lies in.
fn plane() -> Vec<Segment> {
    let [u, v] = [DVec3::new(0.6, 0.0, 0.8), DVec3::new(0.48, 0.8, -0.36)];
    hermite(64, |t| {
        let (sin, cos) = libm::sincos(t);
        let (wave, slope) = (1.0 + 0.3 * libm::cos(3.0 * t), -0.9 * libm::sin(3.0 * t));
        [(u * cos + v * sin) * wave, (v * cos - u * sin) * wave + (u * cos + v * sin) * slope]
    })
}

/// A closed chain of `count` cubics with a function's places and rates of change.
fn hermite(count: u32, at: impl Fn(f64) -> [DVec3; 2]) -> Vec<Segment> {
    let width = TAU / f64::from(count);
    let knots: Vec<[DVec3; 2]> = (0..count).map(|i| at(width * f64::from(i))).collect();
    let next = knots.iter().cycle().skip(1);
    let third = width / 3.0;
    let cubic = |([p, dp], [q, dq]): (&[DVec3; 2], &[DVec3; 2])| {
        Segment::cubic([*p, *p + *dp * third, *q - *dq * third, *q])
    };
    knots.iter().zip(next).map(cubic).collect()
}

/// What is left of an angle after whole turns, at most half of one.
fn left(angle: f64) -> f64 {
    (angle - TAU * (angle / TAU).round()).abs()
}

fn lap(segments: &[Segment]) -> Result<f64, String> {
    let curve = Curve::closed(segments.to_vec(), FrameRule::RotationMinimising);
    Ok(curve.map_err(|error| error.to_string())?.holonomy())
}

fn turned(segments: &[Segment], expected: f64, bound: f64) -> Verdict {
    let found = lap(segments);
    found.map_or_else(Verdict::failed, |found| Verdict::at_most(bound, left(found - expected)))
}

/// The signed area of the sphere that the tangents of a closed quadrilateral enclose: of two triangles, by Van Oosterom and
/// Strackee, "The solid angle of a plane triangle" (1983).
fn enclosed(points: &[DVec3; 4]) -> f64 {
    let [a, b, c, d] = [0, 1, 2, 3].map(|i| (points[(i + 1) % 4] - points[i]).normalize());
    let triangle = |a: DVec3, b: DVec3, c: DVec3| {
        2.0 * libm::atan2(a.dot(b.cross(c)), 1.0 + a.dot(b) + b.dot(c) + c.dot(a))
    };
    triangle(a, b, c) + triangle(a, c, d)
}

fn on_a_sphere() -> Verdict {
    // Like the seam of a ball, but without its symmetries.
    let at = |t: f64| {
        let place = |t: f64| {
            let (sin, cos) = libm::sincos(t);
            let (side, rise) = (0.3 * libm::cos(2.0 * t + 1.0), 0.4 * libm::sin(3.0 * t));
            DVec3::new(cos + side, sin, 0.7 * libm::cos(2.0 * t) + rise).normalize()
        };
        let step = 1e-5;
        [place(t), (place(t + step) - place(t - step)) / (2.0 * step)]
    };
    let turns = [256, 512].map(|count| lap(&hermite(count, at)).map(left));
    let [Ok(coarse), Ok(fine)] = turns else { return Verdict::failed("it is refused") };
    // Rates of change by differences are good to 1e-10.
    Verdict::all([Verdict::at_most(1e-6, fine), Verdict::at_most(coarse / 8.0 + 1e-8, fine)])
}

fn slow_start(speed: f64) -> Verdict {
    let text =
        |x: f64| quadratic(&[[0.0; 3], [x, 0.0, 0.0], [1.0, 0.3, 0.5]], &format!("radius = 0.2\n{NOISE}"));
    let [Ok(slow), Ok(still)] =
        [speed, 0.0].map(|x| scene(&text(x)).map(|scene| Reference::new(&scene, None)))
    else {
        return Verdict::failed("it is refused");
    };
    let apart = (0..1000).map(|n| {
        let p = [1.2, 0.7, 0.9].map(|edge| edge - 0.2);
        let p = std::array::from_fn(|axis| (p[axis] + 0.2) * random::unit(axis as u64, n) - 0.2);
        (slow.density(p) - still.density(p)).abs()
    });
    let definition =
        Verdict::at_most(1e-9, apart.fold(0.0, crate::check::probe::worst)).of("the definitions");
    Verdict::all([definition, evaluates(&text(speed), Look::at(0.02))])
}
