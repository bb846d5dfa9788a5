//! Parts of trees: which leaves they take, and trees of which only a part is there.

use std::collections::BTreeMap;

use glam::DVec3;
use rayon::prelude::*;

use super::sample::{Filter, Sampled, cubes, is_indexed, sample_at, voxel};
use super::shape::{LOG2_EDGE, Stats, align, last_voxel};
use super::tree::{LeafView, Tree};
use super::value::Value;

/// A part of index space, made of the cubes of 8^3 voxels that leaves take.
#[derive(Debug, Clone)]
pub struct Part(Cubes);

#[derive(Debug, Clone)]
enum Cubes {
    /// Those that meet a box: its first and its last voxel.
    Box([[i32; 3]; 2]),
    /// Those that begin at these voxels, some perhaps more than once.
    At(Vec<[i32; 3]>),
}

impl Part {
    /// The cubes that meet the box from one voxel to another, both included. Empty where `last` is below `first` along
    /// an axis.
    pub fn within(first: [i32; 3], last: [i32; 3]) -> Part {
        Part(Cubes::Box([first, last]))
    }

    /// The cubes that hold these voxels.
    pub fn around(voxels: impl IntoIterator<Item = [i32; 3]>) -> Part {
        let mut cubes: Vec<_> = voxels.into_iter().map(|index| align(index, LOG2_EDGE[0])).collect();
        cubes.dedup();
        Part(Cubes::At(cubes))
    }

    /// The cubes that a filter looks into at these points of index space.
    pub fn of_points(filter: Filter, points: &[DVec3]) -> Part {
        let mut cubes: Vec<_> = points.par_iter().flat_map_iter(|point| cubes(filter, *point)).collect();
        cubes.dedup();
        Part(Cubes::At(cubes))
    }

    /// No tree has more leaves in it.
    pub(crate) fn most_leaves(&self) -> usize {
        match &self.0 {
            Cubes::Box(_) => usize::MAX,
            Cubes::At(cubes) => cubes.len(),
        }
    }

    /// The leaves of a tree that lie in it, in the order of the tree.
    pub(crate) fn leaves_of<T: Value>(&self, tree: &Tree<T>) -> Vec<bool> {
        match &self.0 {
            Cubes::Box([first, last]) => {
                let meets = |origin: [i32; 3]| {
                    let end = last_voxel(origin, LOG2_EDGE[0]);
                    (0..3).all(|axis| {
                        first[axis] <= last[axis] && first[axis] <= end[axis] && origin[axis] <= last[axis]
                    })
                };
                tree.leaves.iter().map(|leaf| meets(leaf.origin)).collect()
            }
            Cubes::At(cubes) => {
                let mut taken = vec![false; tree.leaf_count()];
                for leaf in cubes.iter().filter_map(|cube| tree.leaf_at(*cube)) {
                    taken[leaf] = true;
                }
                taken
            }
        }
    }
}

/// A voxel whose leaf was not read.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("voxel {index:?} lies in a leaf that was not read")]
pub struct NotRead {
    /// The voxel.
    pub index: [i32; 3],
}

/// A tree of which only some leaves' values are there. Everything else is as in the whole [`Tree`]: its nodes and tiles,
/// and where its leaves are and which of their voxels are active. To ask for a value that was not read is an error.
#[derive(Debug, Clone)]
pub struct PartialTree<T>(Tree<T>);

/// All of a tree.
impl<T> From<Tree<T>> for PartialTree<T> {
    fn from(tree: Tree<T>) -> Self {
        Self(tree)
    }
}

impl<T: Value> PartialTree<T> {
    /// The value of all space that is not stored.
    pub fn background(&self) -> T {
        self.0.background()
    }

    /// The value at an index, and whether it is active.
    ///
    /// # Errors
    /// [`NotRead`] in a leaf that was not read.
    pub fn value(&self, index: [i32; 3]) -> Result<(T, bool), NotRead> {
        if self.holds(index) { Ok(self.0.value(index)) } else { Err(NotRead { index }) }
    }

    /// Whether the value at an index is known: everywhere but in leaves that were not read.
    pub fn holds(&self, index: [i32; 3]) -> bool {
        self.0.leaf_at(index).is_none_or(|leaf| self.0.leaf(leaf).is_some())
    }

    /// The leaves that were read, in the order of the file.
    pub fn leaves(&self) -> impl Iterator<Item = LeafView<'_, T>> {
        self.0.leaves()
    }

    /// Number of leaves that there are, read or not.
    pub fn leaf_count(&self) -> usize {
        self.0.leaf_count()
    }

    /// Number of leaves at each place along an axis, 0, 1 or 2: from voxel 8 p on for place p.
    pub fn layers(&self, axis: usize) -> BTreeMap<i32, usize> {
        let mut layers = BTreeMap::new();
        for leaf in &self.0.leaves {
            *layers.entry(leaf.origin[axis] >> LOG2_EDGE[0]).or_default() += 1;
        }
        layers
    }

    /// Bytes that the tree takes with the values of so many leaves.
    pub fn memory_bytes_with(&self, leaves: usize) -> u64 {
        self.0.memory_bytes_with(leaves)
    }

    /// What the whole tree holds: the states of all voxels are known.
    pub fn stats(&self) -> Stats {
        self.0.stats()
    }

    /// The tree, if all of its leaves were read.
    pub fn into_whole(self) -> Option<Tree<T>> {
        let whole = (0..self.leaf_count()).all(|leaf| self.0.leaf(leaf).is_some());
        whole.then_some(self.0)
    }
}

impl<T: Sampled> PartialTree<T> {
    /// The values at points of index space, as [`sample_at`] has them.
    ///
    /// # Errors
    /// [`NotRead`] for the first point that takes a leaf that was not read; [`Part::of_points`] has all that are taken.
    pub fn sample_at(&self, filter: Filter, points: &[DVec3]) -> Result<Vec<T::Wide>, NotRead> {
        let missing = |point: &DVec3| cubes(filter, *point).find(|cube| !self.holds(*cube));
        // Of a whole tree none is missing.
        let missing = self.0.slots.as_ref().and_then(|_| points.par_iter().find_map_first(missing));
        match missing {
            Some(index) => Err(NotRead { index }),
            None => Ok(sample_at(&self.0, filter, points)),
        }
    }

    /// The stored value that a filter gives at a point as it is: at voxels, and everywhere with [`Filter::Nearest`].
    /// `None` where it mixes several, or takes a leaf that was not read.
    pub fn stored_at(&self, filter: Filter, point: DVec3) -> Option<T> {
        if !is_indexed(point) {
            return Some(self.background());
        }
        let voxel = voxel(filter, point)?;
        // Halfway beyond the last index there are no voxels.
        let [Ok(x), Ok(y), Ok(z)] = voxel.map(i32::try_from) else { return Some(self.background()) };
        self.value([x, y, z]).ok().map(|(value, _)| value)
    }
}

#[cfg(test)]
mod tests {
    use super::super::testing::{checkered, random, unit};
    use super::super::tree::PAGE;
    use super::*;

    /// A tree with only the leaves of a part, in ragged pages as a file's batches give them.
    fn part_of(tree: &Tree<f32>, part: &Part) -> PartialTree<f32> {
        let taken = part.leaves_of(tree);
        let mut rest = Tree { pages: vec![], slots: Some(vec![]), ..tree.clone() };
        let slots = rest.slots.as_mut().expect("just made");
        for (leaf, taken) in taken.iter().enumerate() {
            slots.push(if *taken { u32::try_from(PAGE * rest.pages.len()).expect("few") } else { u32::MAX });
            if *taken {
                rest.pages.push([*tree.leaf(leaf).expect("a leaf").values].into());
            }
        }
        rest.into()
    }

    #[test]
    fn a_part_holds_what_it_says_and_the_rest_is_an_error() {
        let tree = checkered();
        let boxed = Part::within([-9, -8, 7], [3, 0, 8]);
        let listed = Part::around([[-1, -1, -1], [-2, -1, -1], [120, 7, 7], [5000, 0, 0], [8, 8, 8]]);
        for (part, expected) in [(&boxed, None), (&listed, Some(2))] {
            let partial = part_of(&tree, part);
            assert_eq!(partial.stats(), tree.stats());
            assert_eq!((partial.leaf_count(), partial.background()), (tree.leaf_count(), tree.background()));
            let mut held = 0;
            for leaf in tree.leaves() {
                let [x, y, z] = leaf.origin;
                let inside = match part.0 {
                    Cubes::Box(_) => (-16..=3).contains(&x) && (-8..=0).contains(&y) && (0..=8).contains(&z),
                    Cubes::At(_) => [[-8; 3], [120, 0, 0]].contains(&leaf.origin),
                };
                held += usize::from(inside);
                for index in [leaf.origin, [x + 7, y + 3, z + 1]] {
                    assert_eq!(partial.holds(index), inside, "{index:?}");
                    let expected = if inside { Ok(tree.value(index)) } else { Err(NotRead { index }) };
                    assert_eq!(partial.value(index), expected);
                }
            }
            assert!(held > 0 && expected.is_none_or(|count| held == count), "{held}");
            assert!(
                partial.leaves().count() == held
                    && partial.leaves().all(|a| {
                        tree.leaf_at(a.origin)
                            .and_then(|at| tree.leaf(at))
                            .is_some_and(|b| a.values == b.values)
                    })
            );
            // Tiles and background are known everywhere.
            for index in [[8; 3], [130, 2, 3], [4096, 5, 5], [9000, 0, 0], [i32::MIN; 3]] {
                assert_eq!(partial.value(index), Ok(tree.value(index)));
            }
            assert!(partial.into_whole().is_none());
        }
        let none = part_of(&tree, &Part::within([0; 3], [-1; 3]));
        assert_eq!(none.leaves().count(), 0);
        let all = part_of(&tree, &Part::within([i32::MIN; 3], [i32::MAX; 3])).into_whole().expect("all");
        assert!(all.leaves().zip(tree.leaves()).all(|(a, b)| a.values == b.values));
    }

    #[test]
    fn points_take_what_their_filter_looks_into_and_no_more() {
        let tree = checkered();
        let mut state = 6;
        for filter in [Filter::Nearest, Filter::Trilinear, Filter::Cubic] {
            for _ in 0..300 {
                let far = random(&mut state).is_multiple_of(8);
                let at = DVec3::from([(); 3].map(|()| 34.0 * unit(&mut state) - 17.0));
                let at = if far { at + DVec3::X * 2_147_483_640.0 } else { at };
                let points = [at, at.round(), at.floor() + 0.5];
                let partial = part_of(&tree, &Part::of_points(filter, &points));
                assert_eq!(partial.sample_at(filter, &points), Ok(sample_at(&tree, filter, &points)));
                // No leaf without which it would go as well.
                for leaf in partial.leaves() {
                    let centre = DVec3::from(leaf.origin.map(|c| f64::from(c) + 3.5));
                    let reach = if filter == Filter::Cubic { 5.5 } else { 4.5 };
                    assert!(points.iter().any(|p| (*p - centre).abs().max_element() <= reach));
                    let others: Vec<_> =
                        partial.leaves().map(|l| l.origin).filter(|o| *o != leaf.origin).collect();
                    assert!(part_of(&tree, &Part::around(others)).sample_at(filter, &points).is_err());
                }
            }
        }
        let nowhere = [DVec3::NAN, DVec3::splat(1e300)];
        let none = part_of(&tree, &Part::of_points(Filter::Cubic, &nowhere));
        assert_eq!(none.leaves().count(), 0);
        assert_eq!(none.sample_at(Filter::Cubic, &nowhere), Ok(vec![0.5; 2]));
    }
}
