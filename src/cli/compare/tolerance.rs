//! Whether a difference is small enough.

use clap::ValueEnum;
use serde::Serialize;

use super::figure;
use crate::cli::{Failure, text};
use crate::report::{ChannelDifference, FieldDifference, ImageDifference, Scaled};

/// What a tolerance is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, ValueEnum)]
pub(super) enum MetricName {
    /// Root mean square of the difference; of fields over that of A
    #[default]
    L2,
    /// Mean of the difference's magnitude; of fields over the root mean square of A
    L1,
    /// The largest difference; of fields over the peak of A
    Max,
    /// The mean difference, whatever its sign; of fields over the root mean square of A
    Bias,
    /// What one difference in a thousand exceeds; of fields over the peak of A
    P999,
    /// The mean of FLIP, of images
    Flip,
    /// How far the ratio of both masses is from 1, of fields
    Mass,
    /// Root mean square of the difference of optical depths over that of A's, of fields
    OpticalDepth,
}

pub(super) fn limit(text: &str) -> Result<f64, String> {
    let limit = text.parse().ok().filter(|limit: &f64| *limit >= 0.0 && limit.is_finite());
    limit.ok_or_else(|| "expected a number, at least 0".to_owned())
}

/// A metric and its limit, as `--json` prints it.
#[derive(Debug, Clone, Serialize)]
pub(super) struct Tolerance {
    metric: &'static str,
    /// Null where it is relative to 0.
    value: Option<f64>,
    limit: f64,
    /// Values that are NaN or infinite, of A and of B: with any the check does not hold.
    not_finite: u64,
    holds: bool,
}

impl Tolerance {
    fn new(metric: &'static str, value: Option<f64>, limit: f64, not_finite: u64) -> Tolerance {
        let holds = not_finite == 0 && value.is_some_and(|value| value <= limit);
        Tolerance { metric, value, limit, not_finite, holds }
    }

    /// Of fields; the metric is one of theirs.
    pub(super) fn of_fields(metric: MetricName, limit: f64, found: &FieldDifference) -> Tolerance {
        let (errors, depth) = (&found.errors, &found.optical_depth);
        let mass = || match (found.mass.ratio, found.mass.of) {
            (Some(ratio), _) => Some((ratio - 1.0).abs()),
            // Of nothing nothing was lost.
            (None, of) => (of == [0.0; 2]).then_some(0.0),
        };
        let (name, value) = match metric {
            MetricName::L2 => ("relative L2", errors.l2.of_rms),
            MetricName::L1 => ("relative L1", errors.l1.of_rms),
            MetricName::Max => ("the largest difference over A's peak", errors.max.of_peak),
            MetricName::Bias => ("relative bias", errors.bias.of_rms.map(f64::abs)),
            MetricName::P999 => ("the 99.9 percentile over A's peak", errors.p999.of_peak),
            MetricName::Mass => ("the masses' ratio less 1", mass()),
            MetricName::OpticalDepth => ("relative L2 of optical depths", depth.l2.of_rms),
            MetricName::Flip => ("FLIP", None),
        };
        let voxels = found.voxels.map_or(0, |voxels| voxels.not_finite);
        let not_finite = errors.not_finite.iter().chain(&depth.not_finite).sum::<u64>() + voxels;
        Tolerance::new(name, value, limit, not_finite)
    }

    /// Of images; likewise.
    pub(super) fn of_images(
        metric: MetricName,
        limit: f64,
        found: &ImageDifference,
    ) -> Result<Tolerance, Failure> {
        let ChannelDifference { errors, .. } = &found.all;
        let absolute = |scaled: Scaled| Some(scaled.absolute);
        let (name, value) = match metric {
            MetricName::L2 => ("RMSE", absolute(errors.l2)),
            MetricName::L1 => ("L1", absolute(errors.l1)),
            MetricName::Max => ("the largest difference", absolute(errors.max)),
            MetricName::Bias => ("bias", Some(errors.bias.absolute.abs())),
            MetricName::P999 => ("the 99.9 percentile", absolute(errors.p999)),
            MetricName::Flip => match &found.flip {
                Some(flip) => ("FLIP", Some(flip.mean)),
                None => {
                    return Err(Failure::usage(
                        "--metric flip needs images with red, green and blue, or luminance",
                    ));
                }
            },
            MetricName::Mass | MetricName::OpticalDepth => ("mass", None),
        };
        Ok(Tolerance::new(name, value, limit, errors.not_finite.iter().sum()))
    }

    /// In one line.
    pub(super) fn line(&self) -> String {
        let holds = if self.holds { "holds" } else { "does not hold" };
        format!("{} of {}, {} allowed: {holds}", self.metric, self.shown(), figure(self.limit))
    }

    fn shown(&self) -> String {
        self.value.map_or_else(|| "infinity".to_owned(), figure)
    }

    /// Whether it holds.
    pub(super) fn result(&self) -> Result<(), Failure> {
        if self.holds {
            return Ok(());
        }
        Err(Failure::check(if self.not_finite > 0 {
            format!("{} of A and B, NaN or infinite", text::number(self.not_finite, "value"))
        } else {
            format!("{} is {}, above the tolerance of {}", self.metric, self.shown(), figure(self.limit))
        }))
    }
}

/// Refuses a metric that has no meaning for what is compared.
pub(super) fn check(metric: Option<MetricName>, images: bool) -> Result<(), Failure> {
    let refuse = |metric: &str, what: &str| {
        Err(Failure::usage(format!("--metric {metric} has no meaning for {what}")))
    };
    match (metric, images) {
        (Some(MetricName::Flip), false) => refuse("flip", "scenes and files, only for images"),
        (Some(MetricName::Mass), true) => refuse("mass", "images, only for scenes and files"),
        (Some(MetricName::OpticalDepth), true) => {
            refuse("optical-depth", "images, only for scenes and files")
        }
        _ => Ok(()),
    }
}
