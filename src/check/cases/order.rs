//! What must not matter: the order of tubes, the direction of a curve, and where it is cut.

use glam::DVec3;

use super::{BENT, NOISE, STRAIGHT, quadratic};
use crate::check::case::{Case, Look, Verdict, evaluates, scene};
use crate::check::probe::worst;
use crate::reference::Reference;
use crate::report::random;

const GROUP: &str = "order";

pub(super) fn cases() -> Vec<Case> {
    let mut cases = Vec::new();
    for overlap in ["max", "sum", "blend", "closest"] {
        cases.push(Case::new(
            GROUP,
            format!("three tubes in another order, joined by {overlap}"),
            "the same density within 1e-12 (sums are rounded in order), and by the kernel within 2e-5 of the peak",
            move || permuted(overlap),
        ));
    }
    cases.push(Case::new(
        GROUP,
        "a curve the other way around",
        "the same density without a pattern within 1e-9, and by the kernel within 2e-5 of the peak",
        || {
            let rest = "radius = [[0.0, 0.1], [0.5, 0.3], [1.0, 0.1]]";
            let mut back = BENT;
            back.reverse();
            same([quadratic(&BENT, rest), quadratic(&back, rest)], 1e-9)
        },
    ));
    for t in [0.5, 0.3, 1e-3, 1e-6] {
        cases.push(Case::new(
            GROUP,
            format!("a segment cut at {t:?}"),
            "the density of the uncut one within 1e-9, and by the kernel within 2e-5 of the peak",
            move || {
                let rest = format!("radius = 0.2\ntwist = 1\n{NOISE}");
                same([quadratic(&BENT, &rest), quadratic(&cut(BENT, t), &rest)], 1e-9)
            },
        ));
    }
    cases
}

/// The same quadratic as two, by de Casteljau's scheme.
fn cut(points: [[f64; 3]; 3], t: f64) -> [[f64; 3]; 5] {
    let [a, b, c] = points.map(DVec3::from);
    let [ab, bc] = [a.lerp(b, t), b.lerp(c, t)];
    [a, ab, ab.lerp(bc, t), bc, c].map(|p| p.to_array())
}

fn permuted(overlap: &str) -> Verdict {
    let across = [[-1.0, 0.1, 0.0], [0.0, 0.0, 0.1], [1.0, -0.1, 0.0]];
    // None shares an end with another, where all of them were equally near.
    let beside = STRAIGHT.map(|[x, y, z]| [x + 0.31, y + 0.17, 0.9 * z + 0.013]);
    let tubes = [&BENT, &beside, &across].map(|points| quadratic(points, &format!("radius = 0.3\n{NOISE}")));
    let [a, b, c] = &tubes;
    let text = |tubes: [&String; 3]| format!("overlap = \"{overlap}\"\n{}{}{}", tubes[0], tubes[1], tubes[2]);
    same([text([a, b, c]), text([c, a, b])], 1e-12)
}

/// That two scenes have one density, and that the second is evaluated as it is defined.
fn same(texts: [String; 2], bound: f64) -> Verdict {
    let [Ok(one), Ok(other)] =
        texts.each_ref().map(|text| scene(text).map(|scene| Reference::new(&scene, Some(0.02))))
    else {
        return Verdict::failed("one of them is refused");
    };
    let apart = (0..2000).map(|n| {
        let place = |axis| random::unit(axis, n);
        let p = [1.6 * place(0) - 0.8, 0.9 * place(1) - 0.4, 2.4 * place(2) - 1.2];
        (one.density(p) - other.density(p)).abs()
    });
    let definition = Verdict::at_most(bound, apart.fold(0.0, worst)).of("the definitions");
    let look = Look::at(0.02).within(super::curves::FOCAL);
    Verdict::all([definition, evaluates(&texts[1], look)])
}
