//! Two grids of one lattice, voxel by voxel.

use rayon::prelude::*;
use serde::Serialize;

use super::source::Voxels;
use crate::volume::shape::LOG2_EDGE;

/// What differs among the voxels that are active in either of two grids of one lattice. An inactive voxel counts with the
/// value that it has.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct VoxelDifference {
    /// Active voxels of the first grid, and of the second.
    pub active: [u64; 2],
    /// Those that are active in the first only, and in the second only.
    pub only: [u64; 2],
    /// Whether the same voxels are active.
    pub topology_equal: bool,
    /// Voxels with other values.
    pub differ: u64,
    /// Voxels of which one value or both are NaN or infinite: left out below, and counted above where they are not the same.
    pub not_finite: u64,
    /// Largest difference.
    pub max: f64,
    /// Root mean square of the differences.
    pub rms: f64,
    /// Sum of the active voxels' values times a voxel's volume.
    pub mass: [f64; 2],
    /// Of the second over that of the first; null where that is 0.
    pub mass_ratio: Option<f64>,
}

/// Sums over voxels.
#[derive(Debug, Clone, Copy, Default)]
struct Sums {
    active: [u64; 2],
    only: [u64; 2],
    differ: u64,
    not_finite: u64,
    max: f64,
    squares: f64,
    values: [f64; 2],
}

impl Sums {
    /// `count` voxels that are alike.
    fn add(&mut self, a: (f64, bool), b: (f64, bool), count: u64) {
        if !(a.1 || b.1) {
            return;
        }
        #[allow(clippy::cast_precision_loss, reason = "a weight")]
        let weight = count as f64;
        for (side, (value, active)) in [a, b].into_iter().enumerate() {
            self.active[side] += if active { count } else { 0 };
            self.only[side] += if active && !(a.1 && b.1) { count } else { 0 };
            self.values[side] += if active && value.is_finite() { weight * value } else { 0.0 };
        }
        let same = a.0 == b.0 || (a.0.is_nan() && b.0.is_nan());
        self.differ += if same { 0 } else { count };
        if !(a.0.is_finite() && b.0.is_finite()) {
            self.not_finite += count;
            return;
        }
        let difference = b.0 - a.0;
        self.max = self.max.max(difference.abs());
        self.squares += weight * difference * difference;
    }

    fn join(mut self, other: Sums) -> Sums {
        for side in 0..2 {
            self.active[side] += other.active[side];
            self.only[side] += other.only[side];
            self.values[side] += other.values[side];
        }
        self.differ += other.differ;
        self.not_finite += other.not_finite;
        self.max = self.max.max(other.max);
        self.squares += other.squares;
        self
    }
}

/// Compares all voxels that are active in either of two grids, whose voxels have this volume.
pub fn voxel_by_voxel(a: &dyn Voxels, b: &dyn Voxels, volume: f64) -> VoxelDifference {
    let mut roots = a.roots();
    roots.extend(b.roots());
    roots.sort_unstable();
    roots.dedup();
    let sums = roots.into_iter().map(|root| cube(a, b, root, 2)).fold(Sums::default(), Sums::join);
    let either = sums.active[0] + sums.only[1];
    #[allow(clippy::cast_precision_loss, reason = "a mean")]
    let compared = (either - sums.not_finite).max(1) as f64;
    let mass = sums.values.map(|sum| sum * volume);
    VoxelDifference {
        active: sums.active,
        only: sums.only,
        topology_equal: sums.only == [0; 2],
        differ: sums.differ,
        not_finite: sums.not_finite,
        max: sums.max,
        rms: (sums.squares / compared).sqrt(),
        mass,
        mass_ratio: (mass[0] != 0.0).then(|| mass[1] / mass[0]),
    }
}

/// The voxels of a cube, whose edge is that of `LOG2_EDGE[level]`.
fn cube(a: &dyn Voxels, b: &dyn Voxels, origin: [i32; 3], level: usize) -> Sums {
    let log2 = LOG2_EDGE[level];
    let mut sums = Sums::default();
    if let (Some(a), Some(b)) = (a.uniform(origin, log2), b.uniform(origin, log2)) {
        sums.add(a, b, 1 << (3 * log2));
        return sums;
    }
    let (log2_inner, edge) =
        if level == 0 { (0, 8) } else { (LOG2_EDGE[level - 1], 1 << (log2 - LOG2_EDGE[level - 1])) };
    let child = |n: i32| {
        let place = [n / edge / edge, n / edge % edge, n % edge];
        [0, 1, 2].map(|axis| origin[axis] + (place[axis] << log2_inner))
    };
    let count = edge * edge * edge;
    if level == 0 {
        for n in 0..count {
            let index = child(n);
            sums.add(a.voxel(index), b.voxel(index), 1);
        }
        return sums;
    }
    // In order, so that sums do not depend on threads.
    let parts: Vec<Sums> = (0..count).into_par_iter().map(|n| cube(a, b, child(n), level - 1)).collect();
    parts.into_iter().fold(sums, Sums::join)
}
