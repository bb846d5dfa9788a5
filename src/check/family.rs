//! Families: an error over one parameter, from harmless to hopeless.

use serde::Serialize;

use super::case::{PLAIN, probe};
use super::cases::{FOCAL, NOISE, quadratic, stiffness};
use super::probe::worst;

/// An error over one parameter.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Family {
    /// A word, for file names.
    pub name: &'static str,
    /// What changes, and in what unit.
    pub parameter: &'static str,
    /// What is off, and relative to what.
    pub error: &'static str,
    /// In rising order of the parameter.
    pub marks: Vec<Mark>,
}

/// One of its places.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Mark {
    /// The parameter.
    pub at: f64,
    /// How much is off; null where there is nothing to measure.
    pub error: Option<f64>,
    /// The most that it may be.
    pub bound: f64,
    /// Why there is not: the scene is refused before memory is taken.
    pub refused: Option<String>,
    /// What failed, where that is no refusal.
    pub failed: Option<String>,
}

/// Why there is no error.
pub(super) enum Miss {
    Refused(String),
    Failed(String),
}

impl Family {
    /// Whether no error is above its bound.
    pub fn holds(&self) -> bool {
        let holds = |mark: &Mark| match mark.error {
            Some(error) => error <= mark.bound,
            None => mark.refused.is_some() && mark.failed.is_none(),
        };
        self.marks.iter().all(holds)
    }

    /// The place of the error that is the largest part of its bound.
    pub fn worst(&self) -> Option<&Mark> {
        let error = |mark: &Mark| mark.error.map_or(f64::NEG_INFINITY, |error| error / mark.bound);
        self.marks.iter().max_by(|a, b| error(a).total_cmp(&error(b)))
    }
}

/// Largest difference from the definition at voxels.
const OF_PEAK: &str = "largest error, of the density's peak";
/// Voxels that are compared.
const VOXELS: usize = 800;

/// Measures the families whose names are wanted on the current `rayon` pool, as long as it may go on.
pub fn families(is_wanted: &dyn Fn(&str) -> bool, goes_on: &mut dyn FnMut() -> bool) -> Vec<Family> {
    let mut found = Vec::new();
    for (name, parameter, bound, mut places, measure) in list() {
        places.sort_by(f64::total_cmp);
        if !is_wanted(&format!("{name} {parameter}")) {
            continue;
        }
        let mut marks = Vec::new();
        for at in places {
            if !goes_on() {
                return found;
            }
            marks.push(Mark::new(at, bound(at), measure(at)));
        }
        let error = if name == "light" { "error of transmittance and glow" } else { OF_PEAK };
        found.push(Family { name, parameter, error, marks });
    }
    found
}

impl Mark {
    fn new(at: f64, bound: f64, error: Result<f64, Miss>) -> Mark {
        let mark = Mark { at, error: None, bound, refused: None, failed: None };
        match error {
            Ok(error) if error.is_finite() => Mark { error: Some(error), ..mark },
            Ok(error) => Mark { failed: Some(format!("an error of {error}")), ..mark },
            Err(Miss::Refused(why)) => Mark { refused: Some(why), ..mark },
            Err(Miss::Failed(why)) => Mark { failed: Some(why), ..mark },
        }
    }
}

type Measure = fn(f64) -> Result<f64, Miss>;

type Bound = fn(f64) -> f64;

/// Single precision's share, where nothing is extreme.
fn plain(_: f64) -> f64 {
    PLAIN
}

/// That, and what a place off by 1e-7 of the length, or of a radius, makes of so many turns or cells: at most that many times as much.
fn fine(count: f64) -> f64 {
    PLAIN + 1e-7 * count
}

/// Name, parameter, bound, places and measure of each.
fn list() -> Vec<(&'static str, &'static str, Bound, Vec<f64>, Measure)> {
    let powers = |from: i32, to: i32, by: usize| {
        (from..=to).step_by(by).map(|power| libm::exp10(f64::from(power))).collect::<Vec<_>>()
    };
    vec![
        ("bend", "how far a curve of 2 m is from straight, m", plain, powers(-12, 0, 1), bend),
        (
            "curvature",
            "largest curvature times radius",
            |_| FOCAL,
            vec![0.1, 0.5, 0.9, 0.99, 1.0, 1.01, 1.1, 2.0, 5.0, 20.0],
            curvature,
        ),
        // A scene's hard ends may be a hundredth of a voxel wider, of 40 voxels.
        (
            "light",
            "optical depth of a step",
            |_| 1e-3,
            powers(-12, 30, 3).into_iter().chain([0.1, 10.0]).collect(),
            stiffness,
        ),
        (
            "shift",
            "distance from the origin, m",
            plain,
            powers(0, 8, 1).into_iter().chain([9e8]).collect(),
            shift,
        ),
        ("scale", "length of the scene, m", plain, powers(-8, 8, 1), scale),
        ("twist", "turns in 2 m, by voxels of 0.02 m", fine, powers(0, 6, 1), twist),
        ("frequency", "cells of noise a radius, unfaded", fine, powers(0, 6, 1), frequency),
        ("slope", "change of the radius over the length", plain, powers(-2, 2, 1), slope),
        ("segments", "segments of a curve", plain, powers(0, 3, 1), segments),
    ]
}

fn deviation(text: &str, voxel_size: f64, beside_jumps: f64) -> Result<f64, Miss> {
    let probe = probe(text, voxel_size).map_err(Miss::Refused)?;
    let found = probe.deviation(VOXELS, beside_jumps).map_err(Miss::Failed)?;
    if found.peak > 0.0 {
        Ok(worst(found.largest, found.lost) / found.peak)
    } else {
        Err(Miss::Failed("no density was found".to_owned()))
    }
}

fn noisy(radius: f64) -> String {
    format!("radius = {radius:?}\n{NOISE}")
}

fn bend(rise: f64) -> Result<f64, Miss> {
    deviation(&quadratic(&[[0.0, 0.0, -1.0], [rise, 0.0, 0.0], [0.0, 0.0, 1.0]], &noisy(0.2)), 0.02, 0.0)
}

/// Of the parabola x -> (1 - x^2) / 2 from -1 to 1, whose curvature is 1 in the middle.
fn curvature(product: f64) -> Result<f64, Miss> {
    let points = [[-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]];
    deviation(&quadratic(&points, &noisy(product)), 0.04 * product.max(0.5), 0.0)
}

fn shift(metres: f64) -> Result<f64, Miss> {
    let points = [[0.0, 0.0, -1.0], [0.7, 0.2, 0.0], [0.0, 0.0, 1.0]].map(|point| point.map(|x| x + metres));
    deviation(&quadratic(&points, &noisy(0.25)), 0.02, 0.0)
}

fn scale(length: f64) -> Result<f64, Miss> {
    let unit = 0.5 * length;
    let points = [[0.0, 0.0, -1.0], [0.7, 0.2, 0.0], [0.0, 0.0, 1.0]].map(|point| point.map(|x| x * unit));
    deviation(&quadratic(&points, &noisy(0.25 * unit)), 0.02 * unit, 0.0)
}

fn twist(turns: f64) -> Result<f64, Miss> {
    let points = [[0.0, 0.0, -1.0], [0.7, 0.2, 0.0], [0.0, 0.0, 1.0]];
    let rest = format!("radius = 0.25\ntwist = {turns:?}\n[[tube.layer]]\nop = \"add\"\noctaves = 2");
    let text = format!("[bake]\noctave_fade = false\n{}", quadratic(&points, &rest));
    deviation(&text, 0.02, 0.0)
}

fn frequency(cells: f64) -> Result<f64, Miss> {
    let points = [[0.0, 0.0, -1.0], [0.7, 0.2, 0.0], [0.0, 0.0, 1.0]];
    let rest = format!("radius = 0.25\n[[tube.layer]]\nop = \"add\"\noctaves = 1\nfrequency = {cells:?}");
    let text = format!("[bake]\noctave_fade = false\n{}", quadratic(&points, &rest));
    deviation(&text, 0.02, 0.0)
}

fn slope(slope: f64) -> Result<f64, Miss> {
    let half = 0.2 / slope;
    let points = [[0.0, 0.0, -half], [0.0; 3], [0.0, 0.0, half]];
    let text = quadratic(&points, "radius = [[0, 0.01], [1, 0.41]]\ncaps = \"flat\"");
    deviation(&text, f64::min(0.02, 0.25 * half), 1e-3)
}

/// A helix of so many segments.
fn segments(count: f64) -> Result<f64, Miss> {
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "up to a thousand")]
    let last = 2 * count as u32;
    let points: Vec<[f64; 3]> = (0..=last)
        .map(|n| {
            let angle = f64::from(n) * 0.4;
            [0.5 * libm::cos(angle), 0.5 * libm::sin(angle), 0.02 * f64::from(n)]
        })
        .collect();
    // Joints of this polygon's segments are not smooth: the corners between them are part of the definition.
    deviation(&quadratic(&points, &noisy(0.1)), 0.02, 0.0)
}
