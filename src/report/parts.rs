//! An error taken apart: what each step from the definition to a file's values adds to it.

use serde::{Deserialize, Serialize};

/// A part of an error, or the whole.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Part {
    /// Root mean square.
    pub rms: f64,
    /// The same over the root mean square of the truth; null where that is 0.
    pub of_truth: Option<f64>,
    /// Largest magnitude.
    pub max: f64,
}

/// The parts of a bake's error at points. Each is what changes when one step is switched off: their sum is the whole at every
/// point, and where they do not depend on each other their squares add up.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Parts {
    /// Points.
    pub points: u64,
    /// A file's values less the definition.
    pub whole: Part,
    /// Octaves that fade and parts that are widened for the voxel size: the reference at it, less the reference without.
    pub model: Part,
    /// Single precision: the kernel less the reference.
    pub rounding: Part,
    /// Voxels and filter, anti-aliasing with them: voxels in single precision, filtered, less the kernel.
    pub interpolation: Part,
    /// The file's precision: its values less those in single precision. Codecs lose nothing.
    pub quantisation: Part,
    /// Root of the sum of the parts' squares.
    pub root_sum_square: f64,
    /// That over the whole; null where the whole is 0.
    pub of_whole: Option<f64>,
    /// Why these are more than a fifth apart, where they are.
    pub reason: Option<String>,
}

/// What parts are told by: values at the same points, from the definition to the file.
#[derive(Debug, Clone, Copy)]
pub struct Chain<'a> {
    /// The definition.
    pub truth: &'a [f64],
    /// The reference at the voxel size.
    pub limited: &'a [f64],
    /// The kernel there.
    pub kernel: &'a [f64],
    /// Voxels in single precision, filtered.
    pub voxels: &'a [f64],
    /// The file's.
    pub stored: &'a [f64],
}

/// More or less than this, and the parts do not add up.
const APART: f64 = 0.2;

/// Why the squares of parts do not add up to the whole's, where the root of their sum is more than a fifth more or less: the
/// two that depend most on each other. `steps` lead from the truth to what is measured, each by the part of its name.
pub(super) fn why<const PARTS: usize>(
    steps: &[&[f64]],
    names: [&str; PARTS],
    of_whole: Option<f64>,
) -> Option<String> {
    of_whole.filter(|ratio| (ratio - 1.0).abs() > APART)?;
    let count = steps.iter().map(|step| step.len()).min().unwrap_or(0);
    let product = |a: usize, b: usize| -> f64 {
        let step = |part: usize, n: usize| steps[part + 1][n] - steps[part][n];
        (0..count).map(|n| step(a, n) * step(b, n)).sum()
    };
    let pairs = (0..PARTS).flat_map(|a| (a + 1..PARTS).map(move |b| [a, b]));
    let all = pairs.map(|[a, b]| (product(a, b), [a, b]));
    let (most, [a, b]) = all.max_by(|x, y| x.0.abs().total_cmp(&y.0.abs()))?;
    let scale = (product(a, a) * product(b, b)).sqrt();
    Some(format!(
        "{} and {} are not independent: their correlation is {:.2}",
        names[a],
        names[b],
        if scale > 0.0 { most / scale } else { 0.0 }
    ))
}

impl Parts {
    /// Takes an error apart.
    pub fn new(chain: &Chain<'_>) -> Parts {
        let steps = [chain.truth, chain.limited, chain.kernel, chain.voxels, chain.stored];
        let count = steps.iter().map(|step| step.len()).min().unwrap_or(0);
        #[allow(clippy::cast_precision_loss, reason = "a mean")]
        let weight = 1.0 / count.max(1) as f64;
        let mean = |of: &dyn Fn(usize) -> f64| weight * (0..count).map(of).sum::<f64>();
        let truth = mean(&|n| steps[0][n] * steps[0][n]).sqrt();
        let part = |from: usize, to: usize| {
            let difference = |n: usize| steps[to][n] - steps[from][n];
            let rms = mean(&|n| difference(n) * difference(n)).sqrt();
            let max = (0..count).map(|n| difference(n).abs()).fold(0.0, f64::max);
            Part { rms, of_truth: (truth > 0.0).then_some(rms / truth), max }
        };
        let whole = part(0, 4);
        let [model, rounding, interpolation, quantisation] = [part(0, 1), part(1, 2), part(2, 3), part(3, 4)];
        let squares: f64 =
            [model, rounding, interpolation, quantisation].iter().map(|part| part.rms * part.rms).sum();
        let root_sum_square = squares.sqrt();
        let of_whole = (whole.rms > 0.0).then(|| root_sum_square / whole.rms);
        let names = ["model", "rounding", "interpolation", "quantisation"];
        let reason = why(&steps, names, of_whole);
        Parts {
            points: count as u64,
            whole,
            model,
            rounding,
            interpolation,
            quantisation,
            root_sum_square,
            of_whole,
            reason,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::random::unit;

    const COUNT: usize = 20_000;

    fn noise(stream: u64, size: f64) -> Vec<f64> {
        (0..COUNT).map(|n| size * (unit(stream, n as u64) - 0.5)).collect()
    }

    fn sum(a: &[f64], b: &[f64]) -> Vec<f64> {
        a.iter().zip(b).map(|(a, b)| a + b).collect()
    }

    #[test]
    fn independent_parts_add_up_in_squares() {
        let truth = noise(1, 2.0);
        let limited = sum(&truth, &noise(2, 0.3));
        let kernel = sum(&limited, &noise(3, 1e-5));
        let voxels = sum(&kernel, &noise(4, 0.4));
        let stored = sum(&voxels, &noise(5, 0.1));
        let found = Parts::new(&Chain {
            truth: &truth,
            limited: &limited,
            kernel: &kernel,
            voxels: &voxels,
            stored: &stored,
        });
        // A uniform number's root mean square is its width over the root of 12; 1 % is three deviations of 20 000.
        for (part, width) in [
            (found.model, 0.3),
            (found.rounding, 1e-5),
            (found.interpolation, 0.4),
            (found.quantisation, 0.1),
        ] {
            assert!((part.rms / (width / 12.0_f64.sqrt()) - 1.0).abs() < 0.01, "{part:?}");
        }
        assert!((found.whole.rms - (0.26_f64 / 12.0).sqrt()).abs() < 2e-3 && found.reason.is_none());
        assert!((found.of_whole.expect("not 0") - 1.0).abs() < 0.02);
    }

    #[test]
    fn parts_that_cancel_are_named() {
        let (truth, error) = (noise(1, 1.0), noise(2, 0.5));
        let limited = sum(&truth, &error);
        let back: Vec<f64> = error.iter().map(|e| -0.9 * e).collect();
        let voxels = sum(&limited, &back);
        let found = Parts::new(&Chain {
            truth: &truth,
            limited: &limited,
            kernel: &limited,
            voxels: &voxels,
            stored: &voxels,
        });
        assert!(found.of_whole.is_some_and(|ratio| ratio > 10.0));
        let reason = found.reason.expect("far apart");
        assert_eq!(reason, "model and interpolation are not independent: their correlation is -1.00");
    }
}
