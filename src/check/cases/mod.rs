//! The cases, by what they are about.

mod curves;
mod frames;
mod input;
mod light;
mod noise;
mod order;
mod radii;
mod space;
mod storage;
mod time;

use super::case::Case;
pub(super) use curves::FOCAL;
pub(super) use light::stiffness;

/// All cases, in the order in which they are shown.
pub(super) fn all() -> Vec<Case> {
    let groups = [
        curves::cases(),
        frames::cases(),
        order::cases(),
        radii::cases(),
        space::cases(),
        noise::cases(),
        time::cases(),
        light::cases(),
        storage::cases(),
        input::cases(),
    ];
    groups.into_iter().flatten().collect()
}

/// A tube along quadratic segments, and what else is said of it.
pub(super) fn quadratic(points: &[[f64; 3]], rest: &str) -> String {
    of_kind("quadratic", points, rest)
}

/// A tube along a curve of a kind.
pub(super) fn of_kind(kind: &str, points: &[[f64; 3]], rest: &str) -> String {
    format!("[[tube]]\ncurve = {{ kind = \"{kind}\", points = {points:?} }}\n{rest}\n")
}

/// Noise that leaves density everywhere.
pub(super) const NOISE: &str = "[[tube.layer]]\nop = \"multiply\"\noctaves = 3\nthreshold = -0.8";

/// A straight tube of 2 m along z.
pub(super) const STRAIGHT: [[f64; 3]; 3] = [[0.0, 0.0, -1.0], [0.0, 0.0, 0.0], [0.0, 0.0, 1.0]];

/// A bent one.
pub(super) const BENT: [[f64; 3]; 3] = [[0.0, 0.0, -1.0], [0.7, 0.2, 0.0], [0.0, 0.0, 1.0]];
