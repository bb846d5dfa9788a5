//! A case: what must be true, and what was found.

use std::fmt::Display;

use serde::Serialize;

use super::probe::{Deviation, Probe};
use crate::scene::Scene;

/// Something that must be true of the program, however extreme.
pub struct Case {
    /// What it is about.
    pub group: &'static str,
    /// What is extreme in it.
    pub name: String,
    /// What must be true, with the reason for as much as may be off.
    pub expected: String,
    run: Box<dyn Fn() -> Verdict + Send + Sync>,
}

impl Case {
    pub(super) fn new(
        group: &'static str,
        name: impl Into<String>,
        expected: impl Into<String>,
        run: impl Fn() -> Verdict + Send + Sync + 'static,
    ) -> Case {
        Case { group, name: name.into(), expected: expected.into(), run: Box::new(run) }
    }

    /// Finds out, on the current `rayon` pool.
    pub fn run(&self) -> Outcome {
        let Verdict { found, error, bound, holds } = (self.run)();
        let margin = bound.zip(error).filter(|(bound, _)| *bound > 0.0).map(|(bound, error)| error / bound);
        Outcome {
            group: self.group,
            name: self.name.clone(),
            expected: self.expected.clone(),
            found,
            error,
            bound,
            margin,
            holds,
        }
    }
}

/// What was found of a case.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Outcome {
    /// What it is about.
    pub group: &'static str,
    /// What is extreme in it.
    pub name: String,
    /// What must be true.
    pub expected: String,
    /// What is, in words.
    pub found: String,
    /// How far off it is, where that is a number.
    pub error: Option<f64>,
    /// How far off it may be.
    pub bound: Option<f64>,
    /// The one over the other: 1 or less.
    pub margin: Option<f64>,
    /// Whether it is as it must be.
    pub holds: bool,
}

/// What a case finds.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Verdict {
    found: String,
    error: Option<f64>,
    bound: Option<f64>,
    holds: bool,
}

impl Verdict {
    /// An error, and the most that it may be; one that is no number is too large.
    pub(super) fn at_most(bound: f64, error: f64) -> Verdict {
        Verdict {
            found: format!("{error:.1e}"),
            error: error.is_finite().then_some(error),
            bound: Some(bound),
            holds: error <= bound,
        }
    }

    /// Something that is or is not.
    pub(super) fn is(holds: bool, found: impl Into<String>) -> Verdict {
        Verdict { found: found.into(), error: None, bound: None, holds }
    }

    /// What could not be found out.
    pub(super) fn failed(error: impl Display) -> Verdict {
        Verdict::is(false, error.to_string())
    }

    /// Something that must be refused, with these words.
    pub(super) fn refused<T, E: Display>(result: Result<T, E>, words: &str) -> Verdict {
        match result {
            Ok(_) => Verdict::is(false, "it is accepted"),
            Err(error) => {
                let text = error.to_string();
                Verdict::is(text.contains(words), first_line(&text))
            }
        }
    }

    /// All of them: the first that does not hold, else that with the least margin.
    pub(super) fn all(verdicts: impl IntoIterator<Item = Verdict>) -> Verdict {
        let margin = |verdict: &Verdict| match (verdict.error, verdict.bound) {
            (Some(error), Some(bound)) if bound > 0.0 => error / bound,
            _ => -1.0,
        };
        let worst = verdicts.into_iter().reduce(|worst, next| {
            if !worst.holds || next.holds && margin(&worst) >= margin(&next) { worst } else { next }
        });
        worst.unwrap_or_else(|| Verdict::is(false, "nothing was looked at"))
    }

    /// How far off it is, where that is a number.
    pub(super) fn error(&self) -> Option<f64> {
        self.error
    }

    /// What was found, in words.
    pub(super) fn found(&self) -> &str {
        &self.found
    }

    /// The same, with what it is of before what was found.
    pub(super) fn of(mut self, what: impl Display) -> Verdict {
        self.found = format!("{what}: {}", self.found);
        self
    }
}

/// An error message without the picture of the text.
fn first_line(text: &str) -> String {
    let line = text.lines().find(|line| !line.trim().is_empty()).unwrap_or_default();
    line.trim_start_matches("error: ").to_owned()
}

/// A scene from its text.
pub(super) fn scene(text: &str) -> Result<Scene, String> {
    Scene::parse(text, "case.toml").map_err(|errors| errors.to_string())
}

/// That a scene cannot be read, and its error has these words.
pub(super) fn refuses(text: &str, words: &str) -> Verdict {
    Verdict::refused(Scene::parse(text, "case.toml"), words)
}

/// A scene at a voxel size, to be looked at.
pub(super) fn probe(text: &str, voxel_size: f64) -> Result<Probe, String> {
    Probe::new(scene(text)?, voxel_size).map_err(|error| error.to_string())
}

/// How a scene is looked at.
#[derive(Debug, Clone, Copy)]
pub(super) struct Look {
    /// Metres.
    pub(super) voxel_size: f64,
    /// Voxels within this distance in radii of a place where the density jumps are passed over: a rounding decides there.
    pub(super) beside_jumps: f64,
    /// Voxels that are looked at.
    pub(super) voxels: usize,
    /// Largest error, over the density's peak.
    pub(super) bound: f64,
}

impl Look {
    pub(super) fn at(voxel_size: f64) -> Look {
        Look { voxel_size, beside_jumps: 0.0, voxels: 1500, bound: PLAIN }
    }

    pub(super) fn within(self, bound: f64) -> Look {
        Look { bound, ..self }
    }

    pub(super) fn beside_jumps(self, beside_jumps: f64) -> Look {
        Look { beside_jumps, ..self }
    }
}

/// Largest error over the peak where nothing is extreme. Single precision resolves (u, v, l) to 3e-7 (truncation of the axis)
/// plus 2e-7 (rounding). Three octaves of noise, of 2 or 3 cells and amplitudes 1, 1/2, 1/4, have a slope of 3.75 x 3 each where they
/// are steepest, and of a fifth of that in the root mean square; their sum is 3 x 2.25, and 5e-7 of that 3.4e-6. All at their steepest in one
/// place would be 1.7e-5, which no voxel comes near.
pub(super) const PLAIN: f64 = 4e-6;

/// That a scene's density is the definition's, at voxels and beside them, in equal bits at every instruction set.
pub(super) fn evaluates(text: &str, look: Look) -> Verdict {
    let found = probe(text, look.voxel_size).and_then(|probe| {
        let Deviation { largest, peak, lost, compared, .. } =
            probe.deviation(look.voxels, look.beside_jumps)?;
        if compared == 0 || peak <= 0.0 {
            return Err("no density was found to compare".to_owned());
        }
        if lost > look.bound * peak {
            return Err(format!("a density of {lost:.1e} lies outside of the planned bricks"));
        }
        Ok(Verdict::at_most(look.bound, largest / peak))
    });
    found.unwrap_or_else(Verdict::failed)
}
