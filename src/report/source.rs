//! What can be compared: densities that are evaluated, and grids that are sampled.

use glam::DVec3;
use rayon::prelude::*;

use super::ray::{Chord, Walk, within};
use super::support::{Rows, Support};
use crate::field::{Extent, Field, Lattice};
use crate::num::Level;
use crate::num::quadrature::gauss_legendre;
use crate::volume::{
    Accessor, Filter, Plan, PlanError, Sampled, Sampler, Tree, planned_density_at, sample_at,
};

/// A field of numbers over space: two implementations, evaluated and sampled.
pub trait Source: Sync {
    /// Where it can be other than its background.
    fn support(&self) -> &Support;

    /// Its values at points of the world, in metres. Works on the current `rayon` pool.
    fn values(&self, points: &[DVec3]) -> Vec<f64>;

    /// Its integrals along chords, value times metres. Works on the current `rayon` pool.
    fn depths(&self, chords: &[Chord]) -> Vec<f64>;

    /// Its voxels, where it has any.
    fn voxels(&self) -> Option<&dyn Voxels>;
}

/// Voxels and tiles of a grid, in double precision. (Integers beyond 2^53 are rounded.)
pub trait Voxels: Sync {
    /// The state and the value that the voxels of a cube share, of which the first voxel and the log2 of the edge are given;
    /// `None` where they need not.
    fn uniform(&self, origin: [i32; 3], log2_edge: u32) -> Option<(f64, bool)>;

    /// State and value of a voxel.
    fn voxel(&self, index: [i32; 3]) -> (f64, bool);

    /// First voxels of all cubes of 4096^3 voxels in which any is active.
    fn roots(&self) -> Vec<[i32; 3]>;
}

/// The density of a scene, by the kernel.
#[derive(Debug)]
pub struct Procedural {
    field: Field,
    plan: Plan,
    support: Support,
}

impl Procedural {
    /// The density as a bake at this lattice has it at its voxels' centres, at any points.
    ///
    /// # Errors
    ///
    /// As [`Plan::new`].
    pub fn new(field: Field, lattice: Lattice, budget: u64) -> Result<Procedural, PlanError> {
        let plan = Plan::for_extent(&field, lattice, Extent::Whole, budget)?;
        let h = lattice.voxel_size;
        let rows: Rows = [[h, 0.0, 0.0, 0.5 * h], [0.0, h, 0.0, 0.5 * h], [0.0, 0.0, h, 0.5 * h]];
        let cubes = plan.origins().map(|origin| (origin, 3));
        // A voxel size is above 0.
        let support = Support::new(rows, cubes).ok_or(PlanError::TooWide)?;
        Ok(Procedural { field, plan, support })
    }

    /// Bytes that the plan holds.
    pub fn memory(&self) -> u64 {
        self.plan.memory() as u64
    }
}

/// Points of the quadrature in a stretch of at most a voxel.
const NODES: u32 = 4;
/// Points of the quadrature of chords that are evaluated together, about.
const BATCH: f64 = 131_072.0;
/// Points that are evaluated at once: each may lie in a brick of its own, which takes 2 KiB.
const TOGETHER: usize = 8192;

impl Source for Procedural {
    fn support(&self) -> &Support {
        &self.support
    }

    fn values(&self, points: &[DVec3]) -> Vec<f64> {
        let mut values = Vec::with_capacity(points.len());
        for points in points.chunks(TOGETHER) {
            let found = planned_density_at(&self.field, &self.plan, points, Level::best());
            values.extend(found.into_iter().map(f64::from));
        }
        values
    }

    /// By the Gauss-Legendre rule of four points in every stretch of at most a voxel within a brick: of smooth densities far
    /// more exact than what is compared with them, at an edge within a part of a voxel.
    fn depths(&self, chords: &[Chord]) -> Vec<f64> {
        let rule = gauss_legendre(NODES);
        let h = self.plan.lattice().voxel_size;
        let longest = chords.iter().map(|chord| chord.range[1] - chord.range[0]).fold(0.0, f64::max);
        // Every brick's stretch may begin with a shorter one.
        let most = f64::from(NODES) * (1.5 * longest / h + 8.0);
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "from 1 to 4096")]
        let together = (BATCH / most).clamp(1.0, 4096.0) as usize;
        let mut depths = vec![0.0; chords.len()];
        let mut nodes = Vec::with_capacity(TOGETHER);
        let mut take = |nodes: &mut Vec<(usize, DVec3, f64)>| {
            let points: Vec<DVec3> = nodes.iter().map(|(_, point, _)| *point).collect();
            for ((number, _, weight), value) in nodes.iter().zip(self.values(&points)) {
                depths[*number] += weight * value;
            }
            nodes.clear();
        };
        for (batch, chords) in chords.chunks(together).enumerate() {
            for (number, chord) in chords.iter().enumerate() {
                self.nodes(chord, &rule, |point, weight| {
                    nodes.push((together * batch + number, point, weight));
                    if nodes.len() == TOGETHER {
                        take(&mut nodes);
                    }
                });
            }
            take(&mut nodes);
        }
        depths
    }

    fn voxels(&self) -> Option<&dyn Voxels> {
        None
    }
}

impl Procedural {
    /// Calls `visit` with the places and weights of a chord's quadrature.
    fn nodes(&self, chord: &Chord, rule: &[[f64; 2]], mut visit: impl FnMut(DVec3, f64)) {
        let Some(([origin, step], range)) = within(&self.support, chord, 0.0) else { return };
        let h = self.plan.lattice().voxel_size;
        let mut walk = Walk::new([(origin + 0.5) / 8.0, step / 8.0], range);
        while let Some(brick) = walk.cell() {
            let [from, to] = walk.leave([brick, brick.map(|b| b + 1)]);
            if self.plan.find(brick).is_some() {
                chord.stretches([from, to], h, rule).for_each(|(point, weight)| visit(point, weight));
            }
        }
    }
}

/// A grid's values, filtered.
#[derive(Debug)]
pub struct Gridded<T> {
    tree: Tree<T>,
    filter: Filter,
    support: Support,
}

impl<T: Sampled<Wide = f64>> Gridded<T> {
    /// A tree and its map to the world; `None` where the map has no inverse.
    pub fn new(tree: Tree<T>, rows: Rows, filter: Filter) -> Option<Gridded<T>> {
        let leaves = tree.leaves().map(|leaf| (leaf.origin, 3));
        let tiles = tree.active_tiles().map(|tile| (tile.origin, tile.log2_edge));
        let support = Support::new(rows, leaves.chain(tiles))?;
        Some(Gridded { tree, filter, support })
    }
}

/// The integral along a chord through a grid's filtered values, as far as it has come: exact for the nearest voxel's value and
/// for trilinear ones, and for cubic ones where nothing is clamped.
#[derive(Debug)]
pub(super) struct Line {
    /// The rest of the way; `None` where there is none through the grid. Shifted so that each cell has one filter.
    walk: Option<Walk>,
    sum: f64,
}

/// Where a filter's cells lie to its voxels: what is added to a place in index space to be in a cell of whole coordinates, and
/// the voxels before and behind those of a cell that the filter takes. A cell lies between voxels, or is one.
pub(super) fn cells(filter: Filter) -> (f64, i64, i64) {
    match filter {
        Filter::Nearest => (0.5, 0, 0),
        Filter::Trilinear => (0.0, 0, 1),
        Filter::Cubic => (0.0, 1, 2),
    }
}

impl Line {
    /// At the beginning of a chord through what has this support.
    pub(super) fn new(chord: &Chord, support: &Support, filter: Filter, background: f64) -> Line {
        let whole = chord.range[1] - chord.range[0];
        // Beyond two voxels from the outermost all is background.
        let Some(([origin, step], range)) = within(support, chord, 2.0) else {
            return Line { walk: None, sum: if background == 0.0 { 0.0 } else { whole * background } };
        };
        let sum = if background == 0.0 { 0.0 } else { (whole - (range[1] - range[0])) * background };
        Line { walk: Some(Walk::new([origin + cells(filter).0, step], range)), sum }
    }

    /// The integral so far.
    pub(super) fn sum(&self) -> f64 {
        self.sum
    }

    /// The rest of the way, as it is at its beginning, in blocks of 8^3 cells.
    pub(super) fn blocks(&self) -> Option<Walk> {
        self.walk.as_ref().map(|walk| walk.scaled(0.125))
    }

    /// Goes on to the last cell that begins before a place on the chord.
    pub(super) fn advance<T: Sampled<Wide = f64>>(
        &mut self,
        tree: &Tree<T>,
        filter: Filter,
        rule: &[[f64; 2]],
        until: f64,
    ) {
        let Line { walk: Some(walk), sum } = self else { return };
        let (shift, before, behind) = cells(filter);
        let mut sampler = Sampler::new(tree, filter);
        let mut accessor = Accessor::new(tree);
        while let Some(cell) = walk.cell().filter(|_| walk.t() < until) {
            if let Some((cells, value)) = uniform(&mut accessor, cell, before, behind) {
                let [from, to] = walk.leave(cells);
                if value.wide() != 0.0 {
                    *sum += (to - from) * value.wide();
                }
                continue;
            }
            let [from, to] = walk.leave([cell, cell.map(|c| c + 1)]);
            let length = to - from;
            // No length times an infinite value is nothing.
            if length > 0.0 {
                for [place, weight] in rule {
                    let at = walk.at(from + place * length) - shift;
                    *sum += weight * length * sampler.sample(at);
                }
            }
        }
    }
}

/// The rule that is exact along a line through a cell: a voxel's value is constant there, a trilinear one of degree 3, a
/// tricubic one of degree 9.
pub(super) fn rule(filter: Filter) -> Vec<[f64; 2]> {
    gauss_legendre(match filter {
        Filter::Nearest => 1,
        Filter::Trilinear => 2,
        Filter::Cubic => 5,
    })
}

/// Cells, from the first to before the end.
type Cells = [[i64; 3]; 2];

/// The cells around one for which a filter takes voxels of one cube only, and the value that they share.
fn uniform<T: Sampled>(
    accessor: &mut Accessor<'_, T>,
    cell: [i64; 3],
    before: i64,
    behind: i64,
) -> Option<(Cells, T)> {
    let [Ok(x), Ok(y), Ok(z)] = cell.map(i32::try_from) else { return None };
    let (origin, log2, value) = accessor.uniform([x, y, z])?;
    let first = origin.map(|c| i64::from(c) + before);
    let end = origin.map(|c| i64::from(c) + (1 << log2) - behind);
    let inside = (0..3).all(|axis| first[axis] <= cell[axis] && cell[axis] < end[axis]);
    inside.then_some(([first, end], value))
}

impl<T: Sampled<Wide = f64>> Source for Gridded<T> {
    fn support(&self) -> &Support {
        &self.support
    }

    fn values(&self, points: &[DVec3]) -> Vec<f64> {
        let map = self.support.to_index();
        let indices: Vec<DVec3> = points.par_iter().map(|point| map.index(*point)).collect();
        sample_at(&self.tree, self.filter, &indices)
    }

    fn depths(&self, chords: &[Chord]) -> Vec<f64> {
        let (rule, background) = (rule(self.filter), self.tree.background().wide());
        let depth = |chord: &Chord| {
            let mut line = Line::new(chord, &self.support, self.filter, background);
            line.advance(&self.tree, self.filter, &rule, f64::INFINITY);
            line.sum()
        };
        chords.par_iter().map(depth).collect()
    }

    fn voxels(&self) -> Option<&dyn Voxels> {
        Some(self)
    }
}

impl<T: Sampled<Wide = f64>> Voxels for Gridded<T> {
    fn uniform(&self, origin: [i32; 3], log2_edge: u32) -> Option<(f64, bool)> {
        let (_, log2, value) = Accessor::new(&self.tree).uniform(origin)?;
        (log2 >= log2_edge).then(|| (value.wide(), self.tree.value(origin).1))
    }

    fn voxel(&self, index: [i32; 3]) -> (f64, bool) {
        let (value, active) = self.tree.value(index);
        (value.wide(), active)
    }

    fn roots(&self) -> Vec<[i32; 3]> {
        let leaves = self.tree.leaves().map(|leaf| leaf.origin);
        let tiles = self.tree.active_tiles().map(|tile| tile.origin);
        let mut roots: Vec<_> = leaves.chain(tiles).map(|origin| origin.map(|c| c >> 12 << 12)).collect();
        roots.sort_unstable();
        roots.dedup();
        roots
    }
}
