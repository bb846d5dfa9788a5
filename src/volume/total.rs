//! The sum of a grid's values.

use super::Brick;
use crate::field::EDGE;

/// Classes of voxels along an axis.
const PARTS: usize = 3;
const CLASSES: usize = PARTS * PARTS * PARTS;

/// A sum of values, kept apart for the 27 lattices of three times the voxel size that the voxels fall into.
///
/// Each of them, times 27, is a coarser sum over the same field; how far they are from each other tells how well the
/// whole is known as an integral. (Of the eight lattices of twice the voxel size, all have the same sum where a
/// density is symmetric about the planes between voxels, as a tube along a coordinate axis is.)
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Total {
    classes: [f64; CLASSES],
}

impl Total {
    /// Adds the values of a brick.
    pub(super) fn add_brick(&mut self, brick: &Brick) {
        let [x, y, z] = brick.origin.map(class);
        let rows = brick.values.as_chunks::<EDGE>().0;
        for across in 0..PARTS {
            // Of the voxels whose x and y, from the brick's first, are of two classes: a sum for each z.
            let mut columns = [[0.0; EDGE]; PARTS];
            for row in 0..EDGE {
                let mut sums = [0.0; EDGE];
                for plane in (across..EDGE).step_by(PARTS) {
                    for (sum, value) in sums.iter_mut().zip(rows[EDGE * plane + row]) {
                        *sum += f64::from(value);
                    }
                }
                for (column, sum) in columns[row % PARTS].iter_mut().zip(sums) {
                    *column += sum;
                }
            }
            for (n, column) in columns.iter().enumerate() {
                let first = PARTS * (PARTS * ((x + across) % PARTS) + (y + n) % PARTS);
                for (k, sum) in column.iter().enumerate() {
                    self.classes[first + (z + k) % PARTS] += sum;
                }
            }
        }
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

    /// Relative error of the sum as an integral: four standard deviations, if those of the coarser sums are
    /// independent, as they are where a density ends in a jump. Of smooth densities they are not, and cancel: the
    /// error is then much smaller. Where a density peaks, as conserved density does at a focal set, all sums miss some of
    /// the peak alike: there it was found up to 3.5 such deviations off.
    pub fn error(&self) -> f64 {
        #[allow(clippy::cast_precision_loss, reason = "27")]
        let count = CLASSES as f64;
        let mean = self.sum() / count;
        let squares: f64 = self.classes.iter().map(|class| (class - mean) * (class - mean)).sum();
        if mean > 0.0 { 4.0 * (squares / (count - 1.0) / count).sqrt() / mean } else { 0.0 }
    }
}

/// The class of a voxel's index along one axis.
fn class(index: i32) -> usize {
    usize::try_from(index.rem_euclid(3)).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::field::VOXELS;

    fn brick(origin: [i32; 3], value: impl Fn([i32; 3]) -> f32) -> Brick {
        let mut brick = Brick { origin, mask: [u64::MAX; 8], values: [0.0; VOXELS] };
        for (i, at) in (0..).zip(&mut brick.values) {
            *at = value([origin[0] + i / 64, origin[1] + i / 8 % 8, origin[2] + i % 8]);
        }
        brick
    }

    #[test]
    fn voxels_three_apart_are_of_one_class() {
        let at = |voxel: [i32; 3]| {
            let mut total = Total::default();
            let origin = voxel.map(|i| i.div_euclid(8) * 8);
            total.add_brick(&brick(origin, |place| if place == voxel { 2.0 } else { 0.0 }));
            assert_eq!(total.sum(), 2.0);
            total.classes
        };
        let mut seen = Vec::new();
        for i in 0..27 {
            let voxel = [i / 9, i / 3 % 3, i % 3];
            assert_eq!(at(voxel), at([voxel[0] - 9, voxel[1] + 12, voxel[2] - 3000]));
            assert!(!seen.contains(&at(voxel)));
            seen.push(at(voxel));
        }
    }

    #[test]
    fn a_wave_that_coarser_voxels_miss_is_in_the_error() {
        let sum = |value: &dyn Fn([i32; 3]) -> f32| {
            let mut total = Total::default();
            for x in -3..3 {
                total.add_brick(&brick([8 * x, 0, 0], value));
            }
            total
        };
        // In y and z the classes have 3, 3 and 2 of 8 voxels: a variance of 2 (1/8)^2 / 8 relative to their mean.
        let flat = sum(&|_| 1.0);
        let spread = |classes: f64| 4.0 * (classes / 26.0).sqrt();
        let of_ends = |a: f64| 1.0 + a;
        let end = 1.0 / 32.0;
        assert!((flat.error() - spread(of_ends(end) * of_ends(end) - 1.0)).abs() < 1e-12);
        let wave = sum(&|[x, ..]| if x.rem_euclid(3) == 0 { 2.0 } else { 0.5 });
        assert_eq!((flat.sum(), wave.sum()), (3072.0, 3072.0));
        // Along x the means are 2, 1/2, 1/2.
        assert!((wave.error() - spread(of_ends(end) * of_ends(end) * of_ends(0.5) - 1.0)).abs() < 1e-12);
    }
}
