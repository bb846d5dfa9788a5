//! What an error is asked to be.

use serde::{Deserialize, Serialize};

use super::field::FieldDifference;

/// What an error is measured by.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Metric {
    /// Root mean square of the difference over that of the truth.
    L2,
    /// Largest difference over the truth's peak.
    Max,
    /// Root mean square of the difference of optical depths over that of the truth's.
    OpticalDepth,
    /// How far the mass is from the truth's, as a part of that.
    Mass,
}

impl Metric {
    /// In words.
    pub fn name(self) -> &'static str {
        match self {
            Metric::L2 => "relative L2",
            Metric::Max => "largest error over the peak",
            Metric::OpticalDepth => "relative L2 of optical depths",
            Metric::Mass => "relative error of the mass",
        }
    }

    /// What was measured, and what it may be as far as the points tell (with a probability of 97.5 % where that is known).
    /// `None` where it is relative to 0.
    pub fn of(self, found: &FieldDifference) -> Option<[f64; 2]> {
        let held = found.intervals.as_ref();
        match self {
            Metric::L2 => {
                let value = found.errors.l2.of_rms?;
                Some([value, held.and_then(|held| held.relative_l2).map_or(value, |[_, high]| high)])
            }
            Metric::Max => found.errors.max.of_peak.map(|value| [value; 2]),
            Metric::OpticalDepth => {
                let value = found.optical_depth.l2.of_rms?;
                Some([value, found.optical_depth.relative_l2.map_or(value, |[_, high]| high)])
            }
            Metric::Mass => {
                if found.mass.of == [0.0; 2] {
                    return Some([0.0; 2]);
                }
                let off = |ratio: f64| (ratio - 1.0).abs();
                let value = off(found.mass.ratio?);
                Some([value, found.mass.ratio_interval.map_or(value, |[low, high]| off(low).max(off(high)))])
            }
        }
    }
}

/// A metric and what it may be at most.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Goal {
    /// The metric.
    pub metric: Metric,
    /// Above 0.
    pub limit: f64,
}
