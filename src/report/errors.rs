//! Differences of paired values.

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::random::below;

/// A difference, as it is and as a part of what it is a difference of.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Scaled {
    /// In the values' own unit.
    pub absolute: f64,
    /// Over the root mean square of the first values; null where that is 0 and the difference is not.
    pub of_rms: Option<f64>,
    /// Over the largest of the first values' magnitudes; likewise.
    pub of_peak: Option<f64>,
}

impl Scaled {
    fn new(absolute: f64, rms: f64, peak: f64) -> Scaled {
        let over = |scale: f64| match absolute {
            0.0 => Some(0.0),
            _ => (scale > 0.0).then(|| absolute / scale),
        };
        Scaled { absolute, of_rms: over(rms), of_peak: over(peak) }
    }
}

/// How values b differ from values a.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Errors {
    /// Pairs that were compared.
    pub pairs: u64,
    /// Values of a, and of b, that are NaN or infinite: their pairs are left out of everything below.
    pub not_finite: [u64; 2],
    /// Root mean square of a.
    pub rms: f64,
    /// Largest magnitude of a.
    pub peak: f64,
    /// Mean of |b - a|.
    pub l1: Scaled,
    /// Root mean square of b - a.
    pub l2: Scaled,
    /// Largest |b - a|.
    pub max: Scaled,
    /// What |b - a| exceeds in one of a thousand pairs.
    pub p999: Scaled,
    /// Mean of b - a.
    pub bias: Scaled,
    /// 20 log10(peak / l2) in decibels; null where l2 or the peak is 0.
    pub psnr: Option<f64>,
}

impl Errors {
    /// Of pairs (a, b), at least 8 bytes for each of which are held; `peak` is that of a where it is not given.
    pub fn new(pairs: impl Iterator<Item = (f64, f64)>, peak: Option<f64>) -> Errors {
        let mut not_finite = [0; 2];
        let (mut squares, mut largest) = (0.0, 0.0_f64);
        let (mut sum, mut error, mut error_squares) = (0.0, 0.0, 0.0);
        let mut magnitudes = Vec::with_capacity(pairs.size_hint().0);
        for (a, b) in pairs {
            let finite = [a.is_finite(), b.is_finite()];
            if finite != [true; 2] {
                for side in 0..2 {
                    not_finite[side] += u64::from(!finite[side]);
                }
                continue;
            }
            let difference = b - a;
            squares += a * a;
            largest = largest.max(a.abs());
            sum += difference;
            error += difference.abs();
            error_squares += difference * difference;
            magnitudes.push(difference.abs());
        }
        #[allow(clippy::cast_precision_loss, reason = "a mean")]
        let count = magnitudes.len().max(1) as f64;
        let (rms, l2) = ((squares / count).sqrt(), (error_squares / count).sqrt());
        let max = magnitudes.iter().fold(0.0, |max: f64, magnitude| max.max(*magnitude));
        let peak = peak.unwrap_or(largest);
        let scaled = |absolute| Scaled::new(absolute, rms, peak);
        Errors {
            pairs: magnitudes.len() as u64,
            not_finite,
            rms,
            peak,
            l1: scaled(error / count),
            l2: scaled(l2),
            max: scaled(max),
            bias: scaled(sum / count),
            psnr: (l2 > 0.0 && peak > 0.0).then(|| 20.0 * libm::log10(peak / l2)),
            p999: scaled(percentile(&mut magnitudes)),
        }
    }

    /// Whether any pair had to be left out.
    pub fn is_partial(&self) -> bool {
        self.not_finite != [0; 2]
    }

    /// Whether all numbers are 0, on both sides: then nothing relative is wrong either.
    pub fn is_of_nothing(&self) -> bool {
        self.peak == 0.0 && self.max.absolute == 0.0
    }
}

/// The smallest value that at most one in a thousand exceeds.
fn percentile(values: &mut [f64]) -> f64 {
    let Some(last) = values.len().checked_sub(1) else { return 0.0 };
    let place = last - values.len() / 1000;
    *values.select_nth_unstable_by(place, f64::total_cmp).1
}

/// Intervals that hold a mean over space with a probability of 95 %, as far as the points tell.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Intervals {
    /// Of the mean of |b - a|.
    pub l1: [f64; 2],
    /// Of the root mean square of b - a.
    pub l2: [f64; 2],
    /// Of that over the root mean square of a; null where a is 0 all over.
    pub relative_l2: Option<[f64; 2]>,
    /// Of the mean of b - a.
    pub bias: [f64; 2],
    /// Of the mean of a, and of b.
    pub mean: [[f64; 2]; 2],
    /// Of the mean of b over that of a; null where that of a is not surely other than 0.
    pub ratio: Option<[f64; 2]>,
}

/// Groups that are drawn from.
const GROUPS: usize = 1000;
/// Draws.
const DRAWS: usize = 1000;
/// Of these the lowest and the highest that are left out, each.
const TAIL: usize = DRAWS / 40;

/// What a thousand draws give, each of as many groups as there are, with repetition, of which every sum is taken (the
/// bootstrap, Efron 1979); the first sum is how many of something a group holds, and groups of none are left out. `None`
/// without any other.
pub(super) fn drawn<const SUMS: usize, const FIGURES: usize>(
    mut groups: Vec<[f64; SUMS]>,
    stream: u64,
    figures: impl Fn(&[f64; SUMS]) -> [f64; FIGURES] + Sync,
) -> Option<Vec<[f64; FIGURES]>> {
    groups.retain(|group| group[0] > 0.0);
    if groups.is_empty() {
        return None;
    }
    let stride = groups.len().max(GROUPS);
    let draw = |draw: usize| {
        let mut sums = [0.0; SUMS];
        for n in 0..groups.len() {
            let group = &groups[below(stream, (draw * stride + n) as u64, groups.len())];
            for (sum, term) in sums.iter_mut().zip(group) {
                *sum += term;
            }
        }
        figures(&sums)
    };
    Some((0..DRAWS).into_par_iter().map(draw).collect())
}

/// The interval that holds 95 % of a figure's draws.
pub(super) fn between<const FIGURES: usize>(draws: &[[f64; FIGURES]], figure: usize) -> [f64; 2] {
    let mut values: Vec<f64> = draws.iter().map(|draw| draw[figure]).collect();
    values.sort_unstable_by(f64::total_cmp);
    let place = |place: usize| values.get(place).copied().unwrap_or(f64::NAN);
    [place(TAIL), place(DRAWS - 1 - TAIL)]
}

/// By the bootstrap (Efron 1979) over groups: point i is of group i modulo 1000, so that each group is spread over all of
/// space as the whole is; as many groups are drawn, with repetition, a thousand times, and the percentiles of what the draws
/// give taken. `None` without any finite pair.
pub fn intervals(a: &[f64], b: &[f64]) -> Option<Intervals> {
    const STREAM: u64 = 0x626f_6f74;
    let mut groups = vec![[0.0_f64; 7]; GROUPS.min(a.len())];
    for (n, (a, b)) in a.iter().zip(b).enumerate() {
        if a.is_finite() && b.is_finite() {
            let (place, difference) = (n % GROUPS, b - a);
            let terms = [1.0, difference.abs(), difference * difference, difference, *a, *b, a * a];
            for (sum, term) in groups[place].iter_mut().zip(terms) {
                *sum += term;
            }
        }
    }
    let draws = drawn(groups, STREAM, |sums| {
        let [count, rest @ ..] = *sums;
        let [l1, square, bias, a, b, own] = rest.map(|sum| sum / count);
        [l1, square.sqrt(), bias, a, b, b / a, (square / own).sqrt()]
    })?;
    let interval = |of: usize| between(&draws, of);
    let relative = interval(6);
    let mean = [interval(3), interval(4)];
    let certain = mean[0][0] > 0.0 || mean[0][1] < 0.0;
    Some(Intervals {
        l1: interval(0),
        l2: interval(1),
        relative_l2: relative.iter().all(|end| end.is_finite()).then_some(relative),
        bias: interval(2),
        mean,
        ratio: certain.then(|| interval(5)),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::random::unit;

    #[test]
    fn norms_follow_their_definitions() {
        let a = [3.0, -4.0, 0.0, 5.0];
        let b = [3.0, -2.0, -1.0, 6.0];
        let errors = Errors::new(a.into_iter().zip(b), None);
        assert_eq!((errors.pairs, errors.rms, errors.peak), (4, 12.5_f64.sqrt(), 5.0));
        assert_eq!((errors.l1.absolute, errors.l2.absolute), (1.0, 1.5_f64.sqrt()));
        assert_eq!((errors.max.absolute, errors.bias.absolute), (2.0, 0.5));
        assert_eq!(
            (errors.max.of_peak, errors.l2.of_rms),
            (Some(0.4), Some(1.5_f64.sqrt() / 12.5_f64.sqrt()))
        );
        // 20 log10(10) dB.
        let tenth = Errors::new([(1.0, 1.1), (0.0, 0.1)].into_iter(), Some(1.0));
        assert!((tenth.psnr.expect("a difference") - 20.0).abs() < 1e-12);
    }

    #[test]
    fn one_in_a_thousand_exceeds_the_percentile() {
        let pairs = |count: u32| (0..count).rev().map(|n| (0.0, f64::from(n)));
        assert_eq!(Errors::new(pairs(10_000), None).p999.absolute, 9989.0);
        assert_eq!(Errors::new(pairs(500), None).p999.absolute, 499.0);
    }

    #[test]
    fn what_is_not_finite_is_counted() {
        let pairs = [(1.0, 2.0), (f64::NAN, 1.0), (f64::INFINITY, f64::NAN), (0.0, f64::NEG_INFINITY)];
        let errors = Errors::new(pairs.into_iter(), None);
        assert_eq!((errors.pairs, errors.not_finite, errors.l1.absolute), (1, [2, 2], 1.0));
        assert!(errors.is_partial());
        assert_eq!(intervals(&[f64::NAN], &[1.0]), None);
    }

    #[test]
    fn nothing_has_no_relative_error_but_of_nothing() {
        let zero = Errors::new([(0.0, 0.0)].into_iter(), None);
        assert_eq!((zero.l2.of_rms, zero.psnr), (Some(0.0), None));
        let some = Errors::new([(0.0, 1.0)].into_iter(), None);
        assert_eq!((some.l2.of_rms, some.max.of_peak, some.psnr), (None, None, None));
        assert!(zero.is_of_nothing() && !some.is_of_nothing());
        let none = Errors::new(std::iter::empty(), None);
        assert_eq!((none.pairs, none.l2.absolute), (0, 0.0));
    }

    #[test]
    fn intervals_hold_the_mean_nineteen_times_in_twenty() {
        let mut held = 0;
        for trial in 0..200 {
            let b: Vec<f64> = (0..5000).map(|n| unit(trial, n)).collect();
            let found = intervals(&vec![1.0; b.len()], &b).expect("finite");
            let [low, high] = found.mean[1];
            held += u32::from(low <= 0.5 && 0.5 <= high);
            // 1.96 standard deviations to either side.
            let expected = 2.0 * 1.96 * (1.0 / 12.0_f64).sqrt() / 5000.0_f64.sqrt();
            assert!((high - low) / expected > 0.8 && (high - low) / expected < 1.2, "{}", high - low);
            assert_eq!(found.ratio, Some(found.mean[1]));
        }
        // Within three standard deviations of 190.
        assert!((181..=199).contains(&held), "{held}");
    }
}
