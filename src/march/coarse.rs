//! Voxels of twice, four times or eight times the size, for pictures that are wanted soon.

#![allow(clippy::needless_range_loop, reason = "axes are indices into several arrays at once")]

use rayon::prelude::*;

use super::baked::{ALL, Baked, VALUES, most};
use super::grid::{Bricks, EDGE};

impl Baked {
    /// The density at every second, fourth or eighth voxel along each axis, after `times` halvings from 1 to 3: the mean of those
    /// around it, with weights that fall along every axis linearly to 0 at the next (full weighting, as multigrid methods
    /// restrict: Brandt, "Multi-level adaptive solutions to boundary-value problems", 1977). It is linear between these. Mass
    /// stays what it was but for rounding, and nothing is shifted.
    #[must_use]
    pub fn coarser(&self, times: u32) -> Baked {
        match times {
            1 => self.restricted::<2, 5>(),
            2 => self.restricted::<4, 3>(),
            _ => self.restricted::<8, 2>(),
        }
    }

    /// Voxels of `N` times the edge, of which a brick's own voxels add to `P` along an edge, from its first one to that behind it.
    fn restricted<const N: usize, const P: usize>(&self) -> Baked {
        let mut parts: Vec<[[[f32; P]; P]; P]> = Vec::new();
        self.values.par_iter().with_min_len(64).map(restrict::<N, P>).collect_into_vec(&mut parts);
        let log2 = N.ilog2();
        // Those with bricks of their own, and those next to them that these may end or begin.
        let mut blocks: Vec<[i32; 3]> =
            self.bricks.blocks.iter().map(|block| block.map(|c| c >> log2)).collect();
        blocks.dedup();
        blocks.sort_unstable();
        blocks.dedup();
        let around = |block: &[i32; 3]| {
            let block = *block;
            (0..27).map(move |n| [block[0] + n / 9 - 1, block[1] + n / 3 % 3 - 1, block[2] + n % 3 - 1])
        };
        blocks = blocks.iter().flat_map(around).collect();
        blocks.par_sort_unstable();
        blocks.dedup();
        let (blocks, values): (_, Vec<_>) = blocks
            .into_par_iter()
            .filter_map(|block| {
                let values = self.gathered::<N, P>(block, &parts);
                values.iter().any(|value| *value > 0.0).then_some((block, values))
            })
            .unzip();
        let grid = (0..log2).fold(self.grid, |grid, _| grid.coarser());
        Baked { grid, bricks: Bricks::new(blocks), most: most(&values), values, sampling: self.sampling }
    }

    /// The values of a coarse block, from what the blocks in it and around it add to it.
    fn gathered<const N: usize, const P: usize>(
        &self,
        block: [i32; 3],
        parts: &[[[[f32; P]; P]; P]],
    ) -> [f32; ALL] {
        let mut values = [0.0; ALL];
        let nodes = self.bricks.nodes();
        // From the one before the block to the one behind it.
        let fine = |axis: usize, offset: usize| {
            let offset = i32::try_from(offset).unwrap_or(0) - 1;
            block[axis].checked_mul(i32::try_from(N).unwrap_or(1)).and_then(|c| c.checked_add(offset))
        };
        for x in 0..N + 2 {
            for y in 0..N + 2 {
                for z in 0..N + 2 {
                    let (Some(i), Some(j), Some(k)) = (fine(0, x), fine(1, y), fine(2, z)) else { continue };
                    let Some(part) = nodes.find([i, j, k]).map(|number| &parts[number]) else { continue };
                    let [x, y, z] = [x, y, z].map(shared::<N, P>);
                    for i in 0..x.count {
                        for j in 0..y.count {
                            let to = ((x.to + i) * VALUES + y.to + j) * VALUES + z.to;
                            let terms = &part[x.from + i][y.from + j][z.from..z.from + z.count];
                            for (value, term) in values[to..to + z.count].iter_mut().zip(terms) {
                                *value += term;
                            }
                        }
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

/// Those of the block before a coarse block, of those in it and of that behind it.
fn shared<const N: usize, const P: usize>(offset: usize) -> Shared {
    if offset == 0 {
        Shared { from: P - 1, to: 0, count: 1 }
    } else if offset <= N {
        Shared { from: 0, to: (offset - 1) * (P - 1), count: P }
    } else {
        Shared { from: 0, to: VALUES - 1, count: 1 }
    }
}

/// What a brick's own voxels add to the coarse points from its first voxel to the one behind it.
fn restrict<const N: usize, const P: usize>(values: &[f32; ALL]) -> [[[f32; P]; P]; P] {
    const OWN: usize = EDGE as usize;
    let mut weights = [[0.0_f32; OWN]; P];
    for (point, weights) in weights.iter_mut().enumerate() {
        for (voxel, weight) in weights.iter_mut().enumerate() {
            // Powers of two divide exactly.
            *weight = small(N.saturating_sub(voxel.abs_diff(point * N))) / small(N * N);
        }
    }
    // Along x and y whole rows at once.
    let mut along_x = [[0.0_f32; VALUES * VALUES]; P];
    for point in 0..P {
        for voxel in 0..OWN {
            let weight = weights[point][voxel];
            if weight > 0.0 {
                let plane = &values[voxel * VALUES * VALUES..][..VALUES * VALUES];
                for n in 0..VALUES * VALUES {
                    along_x[point][n] += weight * plane[n];
                }
            }
        }
    }
    let mut all = [[[0.0; P]; P]; P];
    for (plane, to) in along_x.iter().zip(&mut all) {
        for (y, to) in to.iter_mut().enumerate() {
            let mut row = [0.0_f32; VALUES];
            for voxel in 0..OWN {
                let weight = weights[y][voxel];
                if weight > 0.0 {
                    for n in 0..VALUES {
                        row[n] += weight * plane[voxel * VALUES + n];
                    }
                }
            }
            for (z, to) in to.iter_mut().enumerate() {
                for voxel in 0..OWN {
                    *to += weights[z][voxel] * row[voxel];
                }
            }
        }
    }
    all
}

#[allow(clippy::cast_precision_loss, reason = "at most 64")]
fn small(n: usize) -> f32 {
    n as f32
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
        let Medium::Baked(whole) = baked(&rough(&patchy(), 1.0)) else { unreachable!() };
        let fine = moments(&whole, 1.0);
        for times in 1..=3 {
            let coarse = whole.coarser(times);
            let found = moments(&coarse, f64::from(1_u32 << times));
            for (fine, found) in fine.iter().zip(found) {
                // Sums of nonnegative densities in single precision, each over 27 at most; moments over 160 cells.
                assert!(
                    (found - fine).abs() < 1e-6 * fine.abs().max(160.0 * f64::from(times)),
                    "{found}, not {fine}"
                );
            }
            // Powers of two are exact.
            assert_eq!(coarse.grid.cell(), H * f64::from(1_u32 << times));
        }
    }

    #[test]
    fn bricks_agree_where_they_meet() {
        let Medium::Baked(fine) = baked(&rough(&patchy(), 1.0)) else { unreachable!() };
        for times in 1..=3 {
            // There are fewer bricks, the coarser they are.
            assert!(agree(&fine.coarser(times)) > if times == 1 { 500 } else { 100 });
        }
    }

    /// How many values two bricks share.
    fn agree(coarse: &Baked) -> usize {
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
        met
    }
}
