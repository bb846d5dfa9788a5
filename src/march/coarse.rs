//! Voxels of twice the size, for pictures that are wanted soon.

use rayon::prelude::*;

use super::baked::{ALL, Baked, VALUES};
use super::grid::Bricks;

/// Coarse points along an edge that the voxels of a brick add to.
const POINTS: usize = 5;

impl Baked {
    /// The density at every second voxel along each axis: the mean of those around it, weighted 1/4, 1/2 and 1/4 along every axis
    /// (full weighting, as multigrid methods restrict: Brandt, "Multi-level adaptive solutions to boundary-value problems",
    /// 1977). It is linear between these. Mass stays what it was but for rounding, and nothing is shifted.
    #[must_use]
    pub fn halved(&self) -> Baked {
        let parts: Vec<[f32; POINTS * POINTS * POINTS]> = self.values.par_iter().map(restricted).collect();
        let mut blocks: Vec<[i32; 3]> = self.bricks.blocks.iter().flat_map(|block| reached(*block)).collect();
        blocks.par_sort_unstable();
        blocks.dedup();
        let (blocks, values) = blocks
            .into_par_iter()
            .filter_map(|block| {
                let values = self.gathered(block, &parts);
                values.iter().any(|value| *value > 0.0).then_some((block, values))
            })
            .unzip();
        Baked { grid: self.grid.coarser(), bricks: Bricks::new(blocks), values }
    }

    /// The values of a coarse block, from what the blocks in it and around it add to it.
    fn gathered(&self, block: [i32; 3], parts: &[[f32; POINTS * POINTS * POINTS]]) -> [f32; ALL] {
        let mut values = [0.0; ALL];
        for n in 0..64_u8 {
            // From the one before the block to the one behind it.
            let offset = [n >> 4, n >> 2 & 3, n & 3];
            let fine: [i32; 3] = std::array::from_fn(|axis| 2 * block[axis] - 1 + i32::from(offset[axis]));
            let Some(part) = self.bricks.nodes().find(fine).map(|number| &parts[number]) else { continue };
            let [x, y, z] = offset.map(shared);
            for i in 0..x.count {
                for j in 0..y.count {
                    let from = ((x.from + i) * POINTS + y.from + j) * POINTS + z.from;
                    let to = ((x.to + i) * VALUES + y.to + j) * VALUES + z.to;
                    let terms = &part[from..from + z.count];
                    for (value, term) in values[to..to + z.count].iter_mut().zip(terms) {
                        *value += term;
                    }
                }
            }
        }
        values
    }
}

/// Points along an axis that a block adds to and a coarse block has.
struct Shared {
    /// The first of them, of the block's and of the coarse block's.
    from: usize,
    to: usize,
    count: usize,
}

/// Those of the block before a coarse block, of the two in it and of that behind it.
fn shared(offset: u8) -> Shared {
    let [from, to, count] = [[4, 0, 1], [0, 0, POINTS], [0, 4, POINTS], [0, 8, 1]][usize::from(offset & 3)];
    Shared { from, to, count }
}

/// The coarse blocks that a block adds to.
fn reached(block: [i32; 3]) -> impl Iterator<Item = [i32; 3]> {
    // The first half of a coarse block ends the one before it, too, and the second half begins the one behind it.
    let both = block.map(|c| [c >> 1, if c & 1 == 0 { (c >> 1) - 1 } else { (c >> 1) + 1 }]);
    (0..8_usize).map(move |n| [both[0][n >> 2], both[1][n >> 1 & 1], both[2][n & 1]])
}

/// What a brick's own voxels add to the coarse points from its first voxel to the one behind it.
fn restricted(values: &[f32; ALL]) -> [f32; POINTS * POINTS * POINTS] {
    let mut along_z = [[[0.0; POINTS]; 8]; 8];
    for (x, plane) in along_z.iter_mut().enumerate() {
        for (y, row) in plane.iter_mut().enumerate() {
            let first = (x * VALUES + y) * VALUES;
            *row = restrict(std::array::from_fn(|z| values[first + z]));
        }
    }
    let mut along_y = [[[0.0; POINTS]; POINTS]; 8];
    for (plane, to) in along_z.iter().zip(&mut along_y) {
        for z in 0..POINTS {
            for (row, value) in to.iter_mut().zip(restrict(std::array::from_fn(|y| plane[y][z]))) {
                row[z] = value;
            }
        }
    }
    let mut all = [0.0; POINTS * POINTS * POINTS];
    for y in 0..POINTS {
        for z in 0..POINTS {
            for (x, value) in restrict(std::array::from_fn(|x| along_y[x][y][z])).into_iter().enumerate() {
                all[(x * POINTS + y) * POINTS + z] = value;
            }
        }
    }
    all
}

/// Along one axis.
fn restrict(v: [f32; 8]) -> [f32; POINTS] {
    let inner = |k: usize| 0.25 * v[2 * k - 1] + 0.5 * v[2 * k] + 0.25 * v[2 * k + 1];
    [0.5 * v[0] + 0.25 * v[1], inner(1), inner(2), inner(3), 0.25 * v[7]]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::march::Medium;
    use crate::march::testing::{H, baked, patchy, rough};

    /// Mass, and mass times place along each axis in cells of the edge `cell`.
    fn moments(baked: &Baked, cell: f64) -> [f64; 4] {
        let mut sums = [0.0; 4];
        for (block, values) in baked.bricks.blocks.iter().zip(&baked.values) {
            // A brick's last values belong to the bricks behind it.
            for n in 0..512_usize {
                let place = [n >> 6, n >> 3 & 7, n & 7];
                let value = f64::from(values[(place[0] * VALUES + place[1]) * VALUES + place[2]]);
                let mass = value * cell * cell * cell;
                sums[0] += mass;
                for (axis, at) in place.into_iter().enumerate() {
                    let at = f64::from(block[axis]) * 8.0 + f64::from(u8::try_from(at).unwrap_or(0));
                    sums[axis + 1] += mass * at * cell;
                }
            }
        }
        sums
    }

    #[test]
    fn mass_and_its_centre_stay() {
        let Medium::Baked(mut coarse) = baked(&rough(&patchy(), 1.0)) else { unreachable!() };
        let fine = moments(&coarse, 1.0);
        for times in 1..=3 {
            coarse = coarse.halved();
            let found = moments(&coarse, f64::from(1 << times));
            for (fine, found) in fine.iter().zip(found) {
                // Sums of nonnegative densities in single precision, each over 27 at most; moments over 160 cells.
                assert!(
                    (found - fine).abs() < 1e-6 * fine.abs().max(160.0 * times as f64),
                    "{found}, not {fine}"
                );
            }
            // Powers of two are exact.
            assert_eq!(coarse.grid.cell(), H * f64::from(1 << times));
        }
    }

    #[test]
    fn bricks_agree_where_they_meet() {
        let Medium::Baked(fine) = baked(&rough(&patchy(), 1.0)) else { unreachable!() };
        let coarse = fine.halved();
        let value = |values: &[f32; ALL], [x, y, z]: [usize; 3]| values[(x * VALUES + y) * VALUES + z];
        let mut met = 0;
        for (block, values) in coarse.bricks.blocks.iter().zip(&coarse.values) {
            for axis in 0..3 {
                let mut behind = *block;
                behind[axis] += 1;
                let other = coarse.bricks.nodes().find(behind).map(|number| &coarse.values[number]);
                for n in 0..81_usize {
                    let mut here = [n / 9, n / 9, n / 9];
                    here[(axis + 1) % 3] = n % 9;
                    here[axis] = 8;
                    let mut there = here;
                    there[axis] = 0;
                    // No brick is left out that has density.
                    assert_eq!(value(values, here), other.map_or(0.0, |other| value(other, there)));
                    met += usize::from(other.is_some());
                }
            }
        }
        assert!(met > 500);
    }
}
