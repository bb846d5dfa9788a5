//! Access to a tree at places that lie together.

use std::ops::Range;

use super::shape::{LOG2_EDGE, align};
use super::tree::Tree;
use super::value::Value;

/// A cube of a tree that is one leaf, or has one value.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Cube<'a, T> {
    origin: [i32; 3],
    log2_edge: u32,
    content: Content<'a, T>,
}

#[derive(Debug, Clone, Copy)]
pub(crate) enum Content<'a, T> {
    /// The values of a leaf: (x, y, z) at `64 x + 8 y + z`.
    Leaf(&'a [T; 512]),
    /// The one value of a tile, or of space that is not stored.
    Uniform(T),
}

impl<'a, T: Value> Cube<'a, T> {
    /// The cube of this edge around an index.
    pub(crate) fn new(index: [i32; 3], log2_edge: u32, content: Content<'a, T>) -> Self {
        Self { origin: align(index, log2_edge), log2_edge, content }
    }

    fn holds(&self, index: [i32; 3]) -> bool {
        align(index, self.log2_edge) == self.origin
    }
}

/// Looks values of a tree up, and remembers where it found them.
///
/// It keeps the leaves and tiles found last, one for each of the eight parities that a leaf's coordinates can have: no
/// two leaves that touch are remembered at one place, so that neither a walk to and fro across a seam nor stencils that
/// reach into eight leaves search the tree again.
#[derive(Debug, Clone)]
pub struct Accessor<'a, T> {
    tree: &'a Tree<T>,
    cubes: [Cube<'a, T>; 8],
}

impl<'a, T: Value> Accessor<'a, T> {
    /// Access to a tree.
    pub fn new(tree: &'a Tree<T>) -> Self {
        Self { tree, cubes: [tree.cube([0; 3]); 8] }
    }

    /// The tree.
    pub fn tree(&self) -> &'a Tree<T> {
        self.tree
    }

    fn cube(&mut self, index: [i32; 3]) -> &Cube<'a, T> {
        let parity =
            index.iter().fold(0, |slot, c| (slot << 1) | ((c >> LOG2_EDGE[0]) & 1).cast_unsigned() as usize);
        let cube = &mut self.cubes[parity & 7];
        if !cube.holds(index) {
            *cube = self.tree.cube(index);
        }
        cube
    }

    /// The value at an index, as [`Tree::value`] has it.
    pub fn value(&mut self, index: [i32; 3]) -> T {
        match self.cube(index).content {
            Content::Leaf(values) => values[place(index)],
            Content::Uniform(value) => value,
        }
    }

    /// The first voxel, the log2 of the edge and the value of the cube around an index, where it is a tile or not stored.
    pub(crate) fn uniform(&mut self, index: [i32; 3]) -> Option<([i32; 3], u32, T)> {
        let cube = self.cube(index);
        match cube.content {
            Content::Leaf(_) => None,
            Content::Uniform(value) => Some((cube.origin, cube.log2_edge, value)),
        }
    }

    /// The values of N^3 voxels from `base` on, by x, y and z, where N is at most 8. What lies beyond the range of
    /// indices has the background's value.
    pub(crate) fn stencil<const N: usize>(&mut self, base: [i64; 3]) -> [[[T; N]; N]; N] {
        const { assert!(N >= 1 && N <= 8) };
        let mut stencil = [[[self.tree.background(); N]; N]; N];
        let last = base.map(|c| c.saturating_add(small(N - 1).into()));
        let (Some(first), Some(_)) = (narrow(base), narrow(last)) else {
            self.edge_stencil(base, &mut stencil);
            return stencil;
        };
        if first.iter().all(|c| c & 7 <= small(8 - N)) {
            copy(self.cube(first), first, [0..N, 0..N, 0..N], &mut stencil);
            return stencil;
        }
        let [xs, ys, zs] = first.map(parts::<N>);
        for x in xs {
            for y in ys.clone() {
                for z in zs.clone() {
                    let [i, j, k] = [&x, &y, &z].map(|part| small(part.start));
                    let index = [first[0] + i, first[1] + j, first[2] + k];
                    copy(self.cube(index), index, [x.clone(), y.clone(), z], &mut stencil);
                }
            }
        }
        stencil
    }

    /// A stencil that leaves the range of indices.
    #[cold]
    fn edge_stencil<const N: usize>(&mut self, base: [i64; 3], stencil: &mut [[[T; N]; N]; N]) {
        let at = |axis: usize, n: usize| base[axis].saturating_add(small(n).into());
        for (i, plane) in stencil.iter_mut().enumerate() {
            for (j, row) in plane.iter_mut().enumerate() {
                for (k, value) in row.iter_mut().enumerate() {
                    if let Some(index) = narrow([at(0, i), at(1, j), at(2, k)]) {
                        *value = self.value(index);
                    }
                }
            }
        }
    }
}

/// An index of 32 bits, if it is one.
fn narrow(index: [i64; 3]) -> Option<[i32; 3]> {
    let [x, y, z] = index.map(i32::try_from);
    Some([x.ok()?, y.ok()?, z.ok()?])
}

/// The place of an index among the values of its leaf.
fn place(index: [i32; 3]) -> usize {
    index.iter().fold(0, |at, c| (at << 3) | (c & 7).cast_unsigned() as usize)
}

/// The parts of N voxels from a coordinate on that lie in one leaf and, if any do, in the next.
fn parts<const N: usize>(first: i32) -> impl Iterator<Item = Range<usize>> + Clone {
    let here = (8 - (first & 7).cast_unsigned() as usize).min(N);
    [0..here, here..N].into_iter().filter(|part| !part.is_empty())
}

/// A place in a stencil as a difference of indices.
#[allow(clippy::cast_possible_truncation, clippy::cast_possible_wrap, reason = "at most 8")]
const fn small(n: usize) -> i32 {
    n as i32
}

/// Copies a part of a stencil from the cube that holds it, and whose voxel `index` comes first.
fn copy<T: Value, const N: usize>(
    cube: &Cube<'_, T>,
    index: [i32; 3],
    [xs, ys, zs]: [Range<usize>; 3],
    stencil: &mut [[[T; N]; N]; N],
) {
    let first = place(index);
    for (x, plane) in stencil[xs].iter_mut().enumerate() {
        for (y, row) in plane[ys.clone()].iter_mut().enumerate() {
            let row = &mut row[zs.clone()];
            match cube.content {
                Content::Leaf(values) => {
                    let at = first + 64 * x + 8 * y;
                    row.copy_from_slice(&values[at..at + row.len()]);
                }
                Content::Uniform(value) => row.fill(value),
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::volume::testing::{checkered, random};

    #[test]
    fn values_and_stencils_are_those_of_single_look_ups() {
        let tree = checkered();
        let mut accessor = Accessor::new(&tree);
        let mut state = 1;
        // Around leaves, tiles of each size, and what is not stored.
        for centre in [[0, 0, 0], [-8, -8, -8], [128, 0, 0], [4096, 0, 0], [-4096, 4, 4], [8, 8, 8]] {
            for _ in 0..3000 {
                let index = centre.map(|c| c + i32::try_from(random(&mut state) % 29).expect("small") - 14);
                assert_eq!(accessor.value(index), tree.value(index).0);
                check::<2>(&mut accessor, index.map(i64::from));
                check::<4>(&mut accessor, index.map(i64::from));
            }
        }
    }

    #[test]
    fn beyond_the_range_of_indices_is_background() {
        let tree = checkered();
        let mut accessor = Accessor::new(&tree);
        for end in [i64::from(i32::MIN), i64::from(i32::MAX), i64::MIN, i64::MAX - 4] {
            for shift in 0..4 {
                check::<4>(&mut accessor, [end.saturating_add(shift).saturating_sub(2), 0, 0]);
                check::<2>(&mut accessor, [3, end.saturating_add(shift).saturating_sub(2), 0]);
            }
        }
    }

    fn check<const N: usize>(accessor: &mut Accessor<'_, f32>, base: [i64; 3]) {
        let found: [[[f32; N]; N]; N] = accessor.stencil(base);
        let tree = accessor.tree();
        for n in 0..N * N * N {
            let place = [n / (N * N), n / N % N, n % N];
            let index = [0, 1, 2].map(|axis| base[axis].saturating_add(small(place[axis]).into()));
            let expected = narrow(index).map_or(tree.background(), |index| tree.value(index).0);
            assert_eq!(found[place[0]][place[1]][place[2]], expected, "{N}^3 from {base:?}: {index:?}");
        }
    }
}
