//! What a bake says of mass.

use serde::Serialize;

use super::text;
use crate::scene::{Conserve, Scene};
use crate::volume::{Lattice, RestMass, Tally};

/// Mass in metres^3 (density has no unit), as `--json` prints it.
#[derive(Debug, Serialize)]
pub(super) struct Mass {
    /// Sum of all stored values times the voxel's volume.
    pub(super) baked: f64,
    /// Relative error of that sum as an integral: an estimate that is too large where the density is smooth.
    baked_error: f64,
    /// Of the cylinders at rest.
    rest: f64,
    /// Relative error of its quadrature.
    rest_error: f64,
    /// What the definition leaves of that when the cylinders are deformed, if no two feet meet and ends are flat.
    expected: f64,
    /// Relative error of its quadrature.
    expected_error: f64,
    /// In half balls at round ends, which no cylinder has.
    round_caps: f64,
    /// Part of the mass at rest that has no image.
    #[serde(skip)]
    lost: f64,
    /// Part of it that is faded out beside the focal set.
    #[serde(skip)]
    faded: f64,
    /// Points of the quadrature.
    points: u64,
}

impl Mass {
    pub(super) fn new(tally: &Tally, rest: &RestMass, lattice: Lattice) -> Mass {
        let h = lattice.voxel_size;
        let part = |error: f64, of: f64| if of > 0.0 { error / of } else { 0.0 };
        Mass {
            baked: tally.total.sum() * (h * h * h),
            baked_error: tally.total.error(),
            rest: rest.rest,
            rest_error: part(rest.error, rest.rest),
            expected: rest.image,
            expected_error: part(rest.image_error, rest.image),
            round_caps: rest.caps,
            lost: part(rest.lost, rest.rest),
            faded: part(rest.faded, rest.rest),
            points: rest.points,
        }
    }

    /// Of the bake over that at rest; `None` where there is none at rest.
    pub(super) fn ratio(&self) -> Option<f64> {
        (self.rest > 0.0).then_some(self.baked / self.rest)
    }

    /// Relative error of the ratio.
    pub(super) fn ratio_error(&self) -> Option<f64> {
        (self.rest > 0.0).then_some(self.rest_error + self.baked_error)
    }

    /// Part of the mass at rest that has no image; `None` where there is none at rest.
    pub(super) fn lost(&self) -> Option<f64> {
        (self.rest > 0.0).then_some(self.lost)
    }

    /// Part of the mass at rest that is faded out beside the focal set; `None` where there is none at rest.
    pub(super) fn faded(&self) -> Option<f64> {
        (self.rest > 0.0).then_some(self.faded)
    }

    /// In one line.
    pub(super) fn line(&self) -> String {
        let (Some(ratio), Some(error)) = (self.ratio(), self.ratio_error()) else {
            return "none at rest".to_owned();
        };
        let lost =
            if self.lost > 0.0 { format!("; {} of that lost", percent(self.lost)) } else { String::new() };
        format!(
            "{} m^3, {} +- {} of the {} m^3 at rest{lost}",
            text::short(self.baked),
            text::short(ratio),
            percent(error),
            text::short(self.rest),
        )
    }

    /// What makes the ratio other than 1, in words.
    pub(super) fn notes(&self, scene: &Scene) -> Vec<String> {
        let mut notes = Vec::new();
        if self.ratio().is_none() {
            return notes;
        }
        let of = |conserve| scene.tubes().iter().any(|tube| tube.conserve == conserve);
        if of(Conserve::Off) {
            notes.push(
                "a tube with conserve = \"off\" has the density of its cylinder at rest, however it grows"
                    .into(),
            );
        }
        if of(Conserve::Radius) {
            notes.push("conserve = \"radius\" leaves bending out: what it makes of a pattern's sides".into());
        }
        notes.push(format!(
            "{} m^3 expected, if no tube overlaps itself or another",
            text::short(self.expected + self.round_caps)
        ));
        if self.round_caps > 0.0 {
            notes.push(format!(
                "{} m^3 of it in the half balls of round caps, which cylinders at rest do not have",
                text::short(self.round_caps)
            ));
        }
        if self.lost > 0.0 {
            notes.push(format!(
                "{} of the mass at rest has no image: it lies past the focal set of a bend, or where a radius is 0",
                percent(self.lost)
            ));
        }
        if self.faded > 0.0 {
            notes.push(format!(
                "{} of the mass at rest is faded out beside that set, where space is squeezed to a fifth or less",
                percent(self.faded)
            ));
        }
        notes
    }
}

/// Two significant digits.
fn percent(part: f64) -> String {
    let rounded = format!("{:.1e}", 100.0 * part);
    format!("{}%", rounded.parse::<f64>().unwrap_or(100.0 * part))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn percentages_have_two_digits() {
        for (part, expected) in [(0.123_45, "12%"), (0.001_234, "0.12%"), (0.0, "0%"), (1.5, "150%")] {
            assert_eq!(percent(part), expected);
        }
    }
}
