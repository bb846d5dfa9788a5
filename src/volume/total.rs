//! The sum of a grid's values.

use crate::field::{EDGE, VOXELS};

/// A sum of values, kept apart for the eight lattices of twice the voxel size that the voxels fall into: by whether their
/// x, y and z are even or odd.
///
/// Each of the eight, times eight, is a coarser sum over the same field; how far they are from each other tells how well the
/// whole is known as an integral.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Total {
    classes: [f64; 8],
}

impl Total {
    /// Of the values of a brick, in their order.
    pub(super) fn of(values: &[f32; VOXELS]) -> Total {
        let mut classes = [0.0; 8];
        for (row, values) in values.chunks_exact(EDGE).enumerate() {
            let class = 4 * (row / EDGE % 2) + 2 * (row % 2);
            for pair in values.chunks_exact(2) {
                classes[class] += f64::from(pair[0]);
                classes[class + 1] += f64::from(pair[1]);
            }
        }
        Total { classes }
    }

    pub(super) fn add(&mut self, other: &Total) {
        for (sum, term) in self.classes.iter_mut().zip(other.classes) {
            *sum += term;
        }
    }

    /// The sum.
    pub fn sum(&self) -> f64 {
        self.classes.iter().sum()
    }

    /// Relative error of the sum as an integral: two standard deviations if the errors of the eight coarser sums are independent, as
    /// they are where a density ends in a jump. Of smooth densities they are not, and cancel: the error is then smaller.
    pub fn error(&self) -> f64 {
        let mean = self.sum() / 8.0;
        let squares: f64 = self.classes.iter().map(|class| (class - mean) * (class - mean)).sum();
        if mean > 0.0 { 2.0 * (squares / 7.0 / 8.0).sqrt() / mean } else { 0.0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_wave_that_only_finer_voxels_see_is_in_the_error() {
        let mut values = [1.0; VOXELS];
        assert_eq!((Total::of(&values).sum(), Total::of(&values).error()), (512.0, 0.0));
        for (i, value) in values.iter_mut().enumerate() {
            *value = if i / 64 % 2 == 0 { 1.5 } else { 0.5 };
        }
        let total = Total::of(&values);
        // Four classes have half as much more, four as much less: a deviation of 0.5 * sqrt(8 / 7).
        let expected = 2.0 * 0.5 * (1.0_f64 / 7.0).sqrt();
        assert!(total.sum() == 512.0 && (total.error() - expected).abs() < 1e-15);
        let one = (0..VOXELS).map(|i| {
            let mut values = [0.0; VOXELS];
            values[i] = 2.0;
            Total::of(&values).classes
        });
        for (i, classes) in one.enumerate() {
            let class = 4 * (i / 64 % 2) + 2 * (i / 8 % 2) + i % 2;
            assert!(classes.iter().enumerate().all(|(k, sum)| *sum == if k == class { 2.0 } else { 0.0 }));
        }
    }
}
