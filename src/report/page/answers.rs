//! Which setting for which error.

use super::held;
use crate::report::sweep::{Kind, Report, Row};

/// Errors that are answered for, as parts of the density's root mean square.
const ASKED: [f64; 6] = [0.2, 0.1, 0.05, 0.02, 0.01, 0.005];
/// Voxels are answered for that are no smaller than this part of the smallest that were measured.
const BEYOND: f64 = 0.25;
/// Half precision is proposed where it adds no more than this part to the error.
const HARDLY: f64 = 5e-4;

/// The groups of bakes at other voxel sizes, and in other forms.
pub(super) const SIZES: &str = "voxel size and filter";
const STORAGE: &str = "precision and codec";

/// The setting for an error.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Answer {
    /// Relative L2 that is not to be exceeded.
    pub(super) error: f64,
    /// `None` where no voxel size near those that were measured will do.
    pub(super) setting: Option<Setting>,
}

/// A voxel size, and what it is expected to take.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Setting {
    /// Metres, to three digits.
    pub(super) voxel_size: f64,
    /// Whether half precision is good enough.
    pub(super) is_half: bool,
    /// Of the file.
    pub(super) bytes: f64,
    /// Of the bake, by the clock.
    pub(super) seconds: f64,
    /// Whether the voxels are smaller than all that were measured.
    pub(super) is_beyond: bool,
}

/// For each error in question the largest voxel that meets it, between those that were measured as powers of the voxel size.
pub(super) fn answers(report: &Report) -> Vec<Answer> {
    let rows = ladder(&report.rows, "trilinear");
    let of = |value: fn(&Row) -> Option<f64>| -> Vec<[f64; 2]> {
        rows.iter()
            .filter_map(|row| Some([row.settings.voxel_size, value(row)?]))
            .filter(|pair| pair.iter().all(|x| *x > 0.0 && x.is_finite()))
            .collect()
    };
    // What they may be, as far as the points tell.
    let errors = of(|row| Some(held(row)?[1]));
    #[allow(clippy::cast_precision_loss, reason = "an estimate")]
    let bytes = of(|row| row.cost.bytes.map(|bytes| bytes as f64));
    let seconds = of(|row| Some(row.cost.total?.median));
    let half = report.parts_f16.quantisation.of_truth.unwrap_or(f64::INFINITY);
    let finest = errors.first().map_or(f64::INFINITY, |pair| pair[0]);
    let setting = |error: f64| {
        let voxel_size = round_down(largest(&errors, error)?);
        if voxel_size < BEYOND * finest {
            return None;
        }
        let is_half = half < error * (2.0 * HARDLY).sqrt();
        Some(Setting {
            voxel_size,
            is_half,
            bytes: at(&bytes, voxel_size)? * if is_half { half_bytes(report) } else { 1.0 },
            seconds: at(&seconds, voxel_size)?,
            is_beyond: voxel_size < 0.999 * finest,
        })
    };
    ASKED.into_iter().map(|error| Answer { error, setting: setting(error) }).collect()
}

/// Bakes of the scene as it is at several voxel sizes, from the smallest, read by a filter.
pub(super) fn ladder<'a>(rows: &'a [Row], filter: &str) -> Vec<&'a Row> {
    let mut rows: Vec<&Row> = rows
        .iter()
        .filter(|row| row.kind == Kind::Bake && row.group == SIZES && row.settings.filter == Some(filter))
        .collect();
    rows.sort_by(|a, b| a.settings.voxel_size.total_cmp(&b.settings.voxel_size));
    rows
}

/// Bytes of a file in half precision over those in single.
fn half_bytes(report: &Report) -> f64 {
    let is_half = |row: &&Row| {
        row.group == STORAGE
            && row.settings.precision == Some("f16")
            && row.settings.compression == Some("blosc")
    };
    let half = report.rows.iter().find(is_half).and_then(|row| row.cost.bytes);
    let single = own(report).and_then(|row| row.cost.bytes);
    match (half, single) {
        #[allow(clippy::cast_precision_loss, reason = "an estimate")]
        (Some(half), Some(single)) if single > 0 => half as f64 / single as f64,
        _ => 1.0,
    }
}

/// The scene as it is, at its own voxel size, read trilinearly.
#[allow(clippy::float_cmp, reason = "the same number")]
pub(super) fn own(report: &Report) -> Option<&Row> {
    ladder(&report.rows, "trilinear").into_iter().find(|row| row.settings.voxel_size == report.voxel_size)
}

/// The largest size at which what grows with it is no more than `most`; beyond the smallest size as a power.
fn largest(pairs: &[[f64; 2]], most: f64) -> Option<f64> {
    let above = pairs.iter().position(|pair| pair[1] > most);
    match above {
        None => pairs.last().map(|pair| pair[0]),
        Some(index) => {
            let first = index.saturating_sub(1).min(pairs.len().checked_sub(2)?);
            let [a, b] = [pairs[first], pairs[first + 1]];
            let order = libm::log(b[1] / a[1]) / libm::log(b[0] / a[0]);
            (order > 0.2).then(|| a[0] * libm::pow(most / a[1], 1.0 / order))
        }
    }
}

/// A value at a size, as a power between its neighbours and beyond.
fn at(pairs: &[[f64; 2]], size: f64) -> Option<f64> {
    let behind = pairs.iter().position(|pair| pair[0] > size).unwrap_or(pairs.len());
    let first = behind.saturating_sub(1).min(pairs.len().checked_sub(2)?);
    let [a, b] = [pairs[first], pairs[first + 1]];
    let order = libm::log(b[1] / a[1]) / libm::log(b[0] / a[0]);
    Some(a[1] * libm::pow(size / a[0], order))
}

/// Three digits.
fn round_down(x: f64) -> f64 {
    let unit = libm::pow(10.0, libm::log10(x).floor() - 2.0);
    let digits = (x / unit + 1e-9).floor();
    format!("{digits}e{}", libm::log10(unit).round()).parse().unwrap_or(x)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn powers_are_followed_within_and_beyond() {
        let pairs = [[0.01, 0.01], [0.02, 0.04], [0.04, 0.16]];
        let close =
            |a: Option<f64>, b: f64| assert!(a.is_some_and(|a| (a / b - 1.0).abs() < 1e-12), "{a:?} {b}");
        close(largest(&pairs, 0.09), 0.03);
        close(largest(&pairs, 0.0025), 0.005);
        close(largest(&pairs, 1.0), 0.04);
        close(at(&pairs, 0.005), 0.0025);
        close(at(&pairs, 0.03), 0.09);
        close(at(&pairs, 0.08), 0.64);
        assert_eq!(largest(&[], 0.1), None);
        assert_eq!(largest(&[[0.01, 0.5], [0.02, 0.5]], 0.1), None);
    }

    #[test]
    fn sizes_keep_three_digits_and_never_grow() {
        for (x, expected) in [(0.012_39, 0.0123), (1.0, 1.0), (999.9, 999.0), (2.345e-7, 2.34e-7)] {
            assert_eq!(round_down(x), expected);
        }
    }
}
