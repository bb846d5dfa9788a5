//! Where there is anything to compare: the cubes of two lattices, and points spread over them.

use glam::DVec3;
use rayon::prelude::*;

use super::random::unit;
use crate::volume::WorldToIndex;
use crate::volume::shape::{LOG2_EDGE, align};

/// Rows of A in `world = A (i, j, k, 1)`, where voxel (i, j, k) has its centre.
pub type Rows = [[f64; 4]; 3];

/// Cubes of a lattice's voxels: of 8^3 where there are leaves or bricks, and active tiles. None overlaps another.
#[derive(Debug, Clone)]
pub struct Support {
    rows: Rows,
    to_index: WorldToIndex,
    /// First voxels of cubes of 8^3, 128^3 and 4096^3, each list sorted.
    cubes: [Vec<[i32; 3]>; 3],
    /// Of the box around them, in index space.
    bounds: Option<[DVec3; 2]>,
}

/// A cube of a lattice.
type Cube = ([i32; 3], u32);

impl Support {
    /// Of cubes with the log2 of their edge, 3, 7 or 12; `None` where the map has no inverse.
    pub fn new(rows: Rows, cubes: impl IntoIterator<Item = Cube>) -> Option<Support> {
        let to_index = WorldToIndex::new(&rows)?;
        let mut lists: [Vec<[i32; 3]>; 3] = Default::default();
        let cubes = cubes.into_iter();
        // Mostly they are small.
        lists[0].reserve_exact(cubes.size_hint().0);
        for (origin, log2_edge) in cubes {
            if let Some(level) = LOG2_EDGE.iter().position(|log2| *log2 == log2_edge) {
                lists[level].push(origin);
            }
        }
        for list in &mut lists {
            list.sort_unstable();
            list.dedup();
        }
        let mut support = Support { rows, to_index, cubes: lists, bounds: None };
        let corners = support.all().map(|(origin, log2)| {
            let low = DVec3::from(origin.map(f64::from)) - 0.5;
            [low, low + edge(log2)]
        });
        support.bounds = corners.reduce(|[low, high], [l, h]| [low.min(l), high.max(h)]);
        Some(support)
    }

    /// The map from the lattice to the world.
    pub fn rows(&self) -> &Rows {
        &self.rows
    }

    /// From the world to the lattice.
    pub fn to_index(&self) -> &WorldToIndex {
        &self.to_index
    }

    /// Number of cubes.
    pub fn count(&self) -> usize {
        self.cubes.iter().map(Vec::len).sum()
    }

    /// The volume of a voxel, metres^3.
    pub fn voxel_volume(&self) -> f64 {
        let [x, y, z] = self.rows.map(|[a, b, c, _]| DVec3::new(a, b, c));
        x.dot(y.cross(z)).abs()
    }

    fn all(&self) -> impl Iterator<Item = Cube> {
        self.cubes
            .iter()
            .zip(LOG2_EDGE)
            .flat_map(|(list, log2)| list.iter().map(move |origin| (*origin, log2)))
    }

    /// Whether a voxel lies in one of the cubes.
    pub fn holds(&self, voxel: [i32; 3]) -> bool {
        let lists = self.cubes.iter().zip(LOG2_EDGE);
        lists.into_iter().any(|(list, log2)| list.binary_search(&align(voxel, log2)).is_ok())
    }

    /// Whether a point of the world does.
    pub fn contains(&self, point: DVec3) -> bool {
        let at = (self.to_index.index(point) + 0.5).floor();
        let first = f64::from(i32::MIN);
        #[allow(clippy::cast_possible_truncation, reason = "whole, and within the range of indices")]
        let voxel = at.to_array().map(|c| (first..-first).contains(&c).then_some(c as i32));
        let [Some(x), Some(y), Some(z)] = voxel else { return false };
        self.holds([x, y, z])
    }

    /// Whether voxels of both have the same places: to a millionth of a voxel's edge, over a million voxels.
    pub fn shares_lattice(&self, other: &Support) -> bool {
        let edge = self.rows.iter().flat_map(|row| &row[..3]).fold(0.0_f64, |edge, c| edge.max(c.abs()));
        self.rows.as_flattened().iter().zip(other.rows.as_flattened()).enumerate().all(|(at, (a, b))| {
            let tolerance = if at % 4 == 3 { 1e-6 * edge + 1e-12 * a.abs() } else { 1e-12 * edge };
            (a - b).abs() <= tolerance
        })
    }

    /// The box around all cubes in index space, their voxels' outer faces; `None` where there are none.
    pub fn index_bounds(&self) -> Option<[DVec3; 2]> {
        self.bounds
    }

    /// The box around all cubes in the world.
    pub fn bounds(&self) -> Option<[DVec3; 2]> {
        let [low, high] = self.index_bounds()?;
        let corner = |n: u32| {
            DVec3::new(
                if n & 1 == 0 { low.x } else { high.x },
                if n & 2 == 0 { low.y } else { high.y },
                if n & 4 == 0 { low.z } else { high.z },
            )
        };
        let corners = (0..8).map(|n| self.world(corner(n)));
        corners.map(|corner| [corner; 2]).reduce(|[low, high], [l, h]| [low.min(l), high.max(h)])
    }

    /// A point of index space in the world.
    pub fn world(&self, at: DVec3) -> DVec3 {
        DVec3::from(self.rows.map(|[a, b, c, d]| a * at.x + b * at.y + c * at.z + d))
    }
}

/// Voxels along an edge.
fn edge(log2: u32) -> f64 {
    f64::from(1_u32 << log2)
}

/// Points spread evenly over the union of two supports.
#[derive(Debug, Clone)]
pub struct Spread {
    /// The points, in the world.
    pub points: Vec<DVec3>,
    /// The volume of the union in metres^3: exact where both have one lattice or do not meet, else within what as many
    /// points tell.
    pub volume: f64,
}

/// About `count` points of the union of two supports, in the same places at every run: one in each of as many equal parts of
/// its volume, at a place of its own.
///
/// A cube of `b` counts only where it is outside of `a`, which makes the points even over the union however the two lattices
/// lie to each other.
pub fn spread(a: &Support, b: &Support, count: usize) -> Spread {
    const MOST: usize = 64;
    let same = a.shares_lattice(b);
    // On one lattice cubes lie one in the other or apart.
    let outside = b.all().filter(|(origin, log2)| !(same && within(a, *origin, *log2)));
    let cubes: Vec<(&Support, Cube, bool)> =
        a.all().map(|cube| (a, cube, false)).chain(outside.map(|cube| (b, cube, true))).collect();
    let volumes = [a.voxel_volume(), b.voxel_volume()];
    let ends: Vec<f64> = cubes
        .iter()
        .scan(0.0, |sum, (_, (_, log2), second)| {
            let edge = edge(*log2);
            *sum += edge * edge * edge * volumes[usize::from(*second)];
            Some(*sum)
        })
        .collect();
    let Some(&whole) = ends.last() else { return Spread { points: vec![], volume: 0.0 } };
    #[allow(clippy::cast_precision_loss, reason = "counts of points")]
    let draw = |draws: usize| -> Vec<DVec3> {
        let point = |n: usize| {
            let number = |part: u64| unit(draws as u64, 4 * n as u64 + part);
            let place = (n as f64 + number(0)) / draws as f64 * whole;
            let at = ends.partition_point(|end| *end <= place).min(cubes.len() - 1);
            let (support, (origin, log2), second) = cubes[at];
            let within = DVec3::new(number(1), number(2), number(3)) * edge(log2);
            let point = support.world(DVec3::from(origin.map(f64::from)) - 0.5 + within);
            (!(second && a.contains(point))).then_some(point)
        };
        (0..draws).into_par_iter().filter_map(point).collect()
    };
    let mut draws = count.max(1);
    let mut points = draw(draws);
    if points.len() < draws && points.len() < count {
        draws = (draws * count / points.len().max(1)).min(MOST * count);
        points = draw(draws);
    }
    #[allow(clippy::cast_precision_loss, reason = "counts of points")]
    let volume = whole * (points.len() as f64 / draws as f64);
    Spread { points, volume }
}

/// Whether a cube lies in one of the support's of this size or larger.
fn within(support: &Support, origin: [i32; 3], log2: u32) -> bool {
    let lists = support.cubes.iter().zip(LOG2_EDGE).filter(|(_, edge)| *edge >= log2);
    lists.into_iter().any(|(list, edge)| list.binary_search(&align(origin, edge)).is_ok())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lattice(h: f64, shift: f64) -> Rows {
        [[h, 0.0, 0.0, shift], [0.0, h, 0.0, shift], [0.0, 0.0, h, shift]]
    }

    #[test]
    fn a_union_is_covered_evenly_whatever_the_lattices() {
        let a = Support::new(lattice(0.125, 0.0625), [([0; 3], 3), ([8, 0, 0], 3)]).expect("regular");
        // Cubes of edge 1: [0, 2] x [0, 1]^2, and [1.5, 2.5] x [0, 1]^2 on a lattice of its own.
        let mut rows = lattice(0.125, 0.0625);
        rows[0][3] += 1.5;
        let b = Support::new(rows, [([0; 3], 3)]).expect("regular");
        let Spread { points, volume } = spread(&a, &b, 20_000);
        assert!((volume - 2.5).abs() < 0.01, "{volume}");
        assert!(points.len() > 19_000 && points.len() < 21_000);
        let part = |low: f64, high: f64| {
            let inside = points.iter().filter(|point| (low..high).contains(&point.x)).count();
            f64::from(u32::try_from(inside).expect("small")) / 20_000.0
        };
        // Five standard deviations of counts of some 4000 of 20 000.
        for (low, high, expected) in [(0.0, 0.5, 0.2), (1.0, 1.5, 0.2), (1.5, 2.0, 0.2), (2.0, 2.5, 0.2)] {
            assert!((part(low, high) - expected).abs() < 0.015, "{low} {}", part(low, high));
        }
        assert!(points.iter().all(|point| a.contains(*point) || b.contains(*point)));
    }

    #[test]
    fn cubes_of_one_lattice_count_once() {
        let leaf = Support::new(lattice(0.5, 0.0), [([0; 3], 3), ([256, 0, 0], 3)]).expect("regular");
        let tile = Support::new(lattice(0.5, 0.0), [([0; 3], 7)]).expect("regular");
        let same = spread(&leaf, &leaf, 1000);
        assert_eq!((same.points.len(), same.volume), (1000, 2.0 * 64.0));
        // The first leaf lies in the tile.
        let both = spread(&tile, &leaf, 1000);
        assert_eq!((both.points.len(), both.volume), (1000, 262_144.0 + 64.0));
        // The other way the tile is cut.
        let cut = spread(&leaf, &tile, 100_000);
        assert!((cut.volume / both.volume - 1.0).abs() < 1e-3, "{}", cut.volume);
        assert!(leaf.holds([7, 0, 3]) && !leaf.holds([8, 0, 0]) && tile.holds([127; 3]));
        assert_eq!(spread(&leaf, &tile, 1000).points, spread(&leaf, &tile, 1000).points);
    }

    #[test]
    fn lattices_that_are_shifted_or_scaled_differ() {
        let support = |rows| Support::new(rows, []).expect("regular");
        let a = support(lattice(0.01, 0.005));
        assert!(a.shares_lattice(&support(lattice(0.01, 0.005 + 1e-10))));
        assert!(!a.shares_lattice(&support(lattice(0.01, 0.0))));
        assert!(!a.shares_lattice(&support(lattice(0.010_001, 0.005))));
        assert_eq!(a.bounds(), None);
        assert!(spread(&a, &a, 10).points.is_empty());
    }
}
