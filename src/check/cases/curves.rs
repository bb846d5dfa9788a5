//! Curves: degenerate, cusped, folded, crossing, closed, long.

use glam::DVec3;

use super::{BENT, NOISE, of_kind, quadratic};
use crate::check::case::{Case, Look, PLAIN, Verdict, evaluates, probe, refuses, scene};
use crate::check::probe::worst;
use crate::curve::{Curve, FrameRule, Segment};
use crate::num::Level;
use crate::reference::Reference;
use crate::report::random;
use crate::volume::planned_density_at;

const GROUP: &str = "curves";
/// The same as every curve's plain bound, in words.
const SINGLE: &str = "the definition within 4e-6 of the peak: single precision under three octaves of noise";
/// Beside a focal set coordinates change without bound: 1 - kappa rho cos, a difference of numbers near 1, is off by 2e-6 and
/// the fade over 0.2 of it turns that into 1.5 / 0.2 times as much.
pub(in crate::check) const FOCAL: f64 = 2e-5;

pub(super) fn cases() -> Vec<Case> {
    let case = |name: &str, expected: &str, text: String, look: Look| {
        Case::new(GROUP, name, expected, move || evaluates(&text, look))
    };
    let noisy = |radius: f64| format!("radius = {radius}\n{NOISE}");
    let mut cases = vec![
        Case::new(GROUP, "all points in one place", "refused: a curve has a length", || {
            refuses(&quadratic(&[[1.0; 3]; 3], "radius = 0.1"), "coincide")
        }),
        case(
            "the first two points in one place",
            SINGLE,
            quadratic(&[[0.0; 3], [0.0; 3], [1.0, 0.3, 0.5]], &noisy(0.2)),
            Look::at(0.02),
        ),
        case(
            "the last two points in one place",
            SINGLE,
            quadratic(&[[0.0; 3], [1.0, 0.3, 0.5], [1.0, 0.3, 0.5]], &noisy(0.2)),
            Look::at(0.02),
        ),
        case(
            "three points of a cubic in one place",
            SINGLE,
            of_kind("cubic", &[[0.0; 3], [0.0; 3], [0.0; 3], [1.0, 0.3, 0.5]], &noisy(0.2)),
            Look::at(0.02),
        ),
        Case::new(
            GROUP,
            "collinear points",
            "a capsule's closed form within 1e-6 of the peak, by single precision",
            capsule,
        ),
        case(
            "a curve that folds back on itself",
            "the definition within 2e-5 of the peak, beside a focal set",
            quadratic(&[[0.0; 3], [2.0, 0.0, 0.0], [1.0, 0.0, 0.0]], &noisy(0.2)),
            Look::at(0.02).within(FOCAL),
        ),
        Case::new(
            GROUP,
            "the length of a fold",
            "(2^2 + 1)/(2 (2 + 1)) x 2 of both ways along x, to 1e-12",
            fold_length,
        ),
        case(
            "a cubic with a cusp",
            "the definition within 2e-5 of the peak, beside a focal set",
            of_kind("cubic", &[[0.0; 3], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]], &noisy(0.1)),
            Look::at(0.01).within(FOCAL),
        ),
        case(
            "a cubic with a loop narrower than its tube",
            "the definition within 2e-5 of the peak, beside a focal set",
            of_kind("cubic", &[[0.0; 3], [1.2, 1.0, 0.0], [-0.2, 1.0, 0.1], [1.0, 0.0, 0.0]], &noisy(0.2)),
            Look::at(0.02).within(FOCAL),
        ),
        Case::new(
            GROUP,
            "a cubic that is a quadratic",
            "the quadratic's density within 1e-6 of the peak",
            elevated,
        ),
        case(
            "a chain that crosses itself",
            SINGLE,
            quadratic(
                &[[-1.0, -0.5, 0.0], [1.0, -0.5, 0.0], [1.0, 0.5, 0.0], [1.0, 1.5, 0.0], [-0.9, -0.9, 0.05]],
                &noisy(0.2),
            ),
            Look::at(0.02).within(FOCAL),
        ),
        case("a closed ring", SINGLE, ring(), Look::at(0.02)),
        Case::new(GROUP, "the seam of a closed ring", "no jump across it: 1e-5 of the peak at 2e-7 m", seam),
        Case::new(GROUP, "a gap between segments", "refused, with the segment and the gap's size", gap),
        case("ten thousand segments", SINGLE, walk(10_000), Look { voxels: 200, ..Look::at(0.02) }),
    ];
    for bend in [1e-1, 1e-3, 1e-6, 1e-9, 1e-12] {
        let points = [[0.0, 0.0, -1.0], [bend, 0.0, 0.0], [0.0, 0.0, 1.0]];
        cases.push(case(
            &format!("a bend of {bend:e} m"),
            SINGLE,
            quadratic(&points, &noisy(0.2)),
            Look::at(0.02),
        ));
    }
    // A bend whose curvature in its middle is 2 / b^2 for a control polygon that rises by b over a width of 2.
    for product in [0.5, 0.99, 1.0, 1.01, 3.0] {
        let points = [[-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]];
        cases.push(case(
            &format!("curvature times radius of {product}"),
            "the definition within 2e-5 of the peak, beside a focal set",
            quadratic(&points, &noisy(product)),
            Look::at(0.04 * f64::max(product, 0.5)).within(FOCAL),
        ));
    }
    for degrees in [90.0, 179.0, 180.0_f64] {
        let (sin, cos) = (libm::sin(degrees.to_radians()), libm::cos(degrees.to_radians()));
        let leg = |t: f64| [1.0 + t * cos, t * sin, 0.0];
        let points = [[0.0; 3], [0.5, 0.0, 0.0], [1.0, 0.0, 0.0], leg(0.5), leg(1.0)];
        cases.push(case(
            &format!("a corner of {degrees} degrees"),
            "the definition within 2e-5 of the peak, beside a focal set",
            quadratic(&points, &noisy(0.2)),
            Look::at(0.02).within(FOCAL),
        ));
    }
    for frame in ["rotation-minimising", "frenet"] {
        cases.push(case(
            &format!("an inflection, {frame} frame"),
            SINGLE,
            of_kind(
                "cubic",
                &[[-1.0, -0.5, 0.0], [0.0, -0.5, 0.0], [0.0, 0.5, 0.0], [1.0, 0.5, 0.1]],
                &format!("frame = \"{frame}\"\n{}", noisy(0.15)),
            ),
            Look::at(0.02),
        ));
    }
    cases
}

/// Density of a straight tube with round ends, from its formula.
fn capsule() -> Verdict {
    let points = [[0.0, 0.0, -0.5], [0.0, 0.0, 0.0], [0.0, 0.0, 0.5]];
    let text = quadratic(&points, "radius = 0.25\ncaps = \"round\"");
    densities(&text, 0.02, [DVec3::new(-0.3, -0.3, -0.8), DVec3::new(0.3, 0.3, 0.8)], |p| {
        let nearest = DVec3::new(0.0, 0.0, p.z.clamp(-0.5, 0.5));
        let q = (p - nearest).length_squared() / (0.25 * 0.25);
        let inside = (1.0 - q).max(0.0);
        inside * inside
    })
    .map_or_else(Verdict::failed, |error| Verdict::at_most(1e-6, error))
}

/// The largest difference of a scene's density from a function, at points of a box. The bound of a brick's plan is part of it.
fn densities(
    text: &str,
    h: f64,
    [low, high]: [DVec3; 2],
    truth: impl Fn(DVec3) -> f64,
) -> Result<f64, String> {
    let scene = scene(text)?;
    let field = crate::field::Field::compile(&scene);
    let plan = crate::volume::Plan::for_extent(
        &field,
        crate::field::Lattice { voxel_size: h },
        crate::field::Extent::Whole,
        1 << 30,
    )
    .map_err(|error| error.to_string())?;
    let points: Vec<DVec3> = (0..4000)
        .map(|n| low + (high - low) * DVec3::from_array([0, 1, 2].map(|axis| random::unit(axis, n))))
        .collect();
    let found = planned_density_at(&field, &plan, &points, Level::best());
    let errors = points.iter().zip(found).map(|(point, found)| (truth(*point) - f64::from(found)).abs());
    Ok(errors.fold(0.0, worst))
}

/// A parabola flattened to a line: from 0 to 2 B^2 / (2 B - C) and back, here 4/3 and then 1/3.
fn fold_length() -> Verdict {
    let segment = Segment::quadratic([DVec3::ZERO, DVec3::new(2.0, 0.0, 0.0), DVec3::new(1.0, 0.0, 0.0)]);
    let exact = 4.0 / 3.0 + 1.0 / 3.0;
    let found = Curve::new(vec![segment], FrameRule::RotationMinimising).map(|curve| curve.length());
    found.map_or_else(Verdict::failed, |length| Verdict::at_most(1e-12, (length - exact).abs() / exact))
}

fn elevated() -> Verdict {
    let [a, b, c] = BENT.map(DVec3::from);
    let cubic = [a, (a + 2.0 * b) / 3.0, (2.0 * b + c) / 3.0, c].map(|p| p.to_array());
    let rest = format!("radius = 0.2\n{NOISE}");
    let [as_quadratic, as_cubic] = [quadratic(&BENT, &rest), of_kind("cubic", &cubic, &rest)]
        .map(|text| scene(&text).map(|scene| Reference::new(&scene, Some(0.02))));
    let (Ok(as_quadratic), Ok(as_cubic)) = (as_quadratic, as_cubic) else {
        return Verdict::failed("one of them is refused");
    };
    let apart = (0..2000).map(|n| {
        let place = |axis| random::unit(axis, n);
        let p = [1.0 * place(0) - 0.3, 0.8 * place(1) - 0.3, 2.4 * place(2) - 1.2];
        (as_quadratic.density(p) - as_cubic.density(p)).abs()
    });
    let definition = Verdict::at_most(1e-9, apart.fold(0.0, worst)).of("the definitions");
    Verdict::all([definition, evaluates(&of_kind("cubic", &cubic, &rest), Look::at(0.02))])
}

fn ring() -> String {
    let points: Vec<[f64; 3]> = (0..8)
        .map(|n| {
            let angle = f64::from(n) * std::f64::consts::FRAC_PI_4;
            [libm::cos(angle), libm::sin(angle), 0.0]
        })
        .collect();
    format!(
        "[[tube]]\ncurve = {{ kind = \"catmull-rom\", closed = true, points = {points:?} }}\nradius = 0.25\ntwist = 3\n{NOISE}\n"
    )
}

/// Values on both sides of where a ring begins and ends.
fn seam() -> Verdict {
    let found = probe(&ring(), 0.02).and_then(|probe| {
        let plan = crate::volume::Plan::for_extent(
            &probe.field,
            probe.lattice,
            crate::field::Extent::Whole,
            1 << 30,
        )
        .map_err(|error| error.to_string())?;
        let points: Vec<DVec3> = (0..1000_u64)
            .flat_map(|n| {
                let across = DVec3::new(0.8 + 0.4 * random::unit(0, n), 0.0, 0.4 * random::unit(1, n) - 0.2);
                [across - DVec3::Y * 1e-7, across + DVec3::Y * 1e-7]
            })
            .collect();
        let found = planned_density_at(&probe.field, &plan, &points, Level::best());
        let (pairs, _) = found.as_chunks::<2>();
        let peak = found.iter().fold(0.0_f32, |most, x| most.max(*x));
        let jump = pairs.iter().map(|[a, b]| (a - b).abs()).fold(0.0, f32::max);
        Ok(f64::from(jump) / f64::from(peak))
    });
    found.map_or_else(Verdict::failed, |error| Verdict::at_most(1e-5, error))
}

fn gap() -> Verdict {
    let line = |from: f64, to: f64| {
        Segment::quadratic([from, 0.5 * (from + to), to].map(|x| DVec3::new(x, 0.0, 0.0)))
    };
    let curve = Curve::new(vec![line(0.0, 1.0), line(1.01, 2.0)], FrameRule::RotationMinimising);
    Verdict::refused(curve, "between segments 0 and 1")
}

/// A walk at random: each point less than a radius from the last.
fn walk(segments: usize) -> String {
    let mut at = DVec3::ZERO;
    let points: Vec<[f64; 3]> = (0..=segments as u64)
        .map(|n| {
            let step = DVec3::from_array([0, 1, 2].map(|axis| random::unit(axis, n) - 0.5));
            at = at * 0.999 + 0.2 * step;
            at.to_array()
        })
        .collect();
    of_kind("catmull-rom", &points, &format!("radius = 0.05\noverlap = \"sum\"\n{NOISE}"))
}

const _: () = assert!(PLAIN == 4e-6, "what cases say in words");
