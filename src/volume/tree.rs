//! Sparse values in memory.

use super::accessor::{Content, Cube};
use super::node::{Entry, Node};
use super::shape::{LOG2_EDGE, Leaf, Stats, Tile, active_box, align, grow, last_voxel};
use super::value::Value;

/// Leaves whose values are kept in one piece of memory.
pub(crate) const PAGE: usize = 64;

/// The values of up to [`PAGE`] leaves.
pub(crate) type Page<T> = Box<[[T; 512]]>;

/// A sparse grid of values over all indices (x, y, z) of 32 bits, as OpenVDB has it: a root of cubes of 4096^3 voxels,
/// each of them a tile with one value, or a node of 32^3 cubes of 128^3 voxels, those in turn tiles or nodes of 16^3 cubes
/// of 8^3 voxels, and those tiles or leaves. Each tile and each voxel has a value and is active or inactive; all space
/// beside them is inactive and has the background's value.
///
/// All values are those of the file, to the bit, those of inactive voxels and tiles included.
#[derive(Debug, Clone)]
pub struct Tree<T> {
    pub(crate) background: T,
    /// Sorted by origin, as are the upper nodes; the lower nodes and the leaves are in the order of their parents' entries.
    pub(crate) root_tiles: Vec<RootTile<T>>,
    pub(crate) uppers: Vec<Node<T>>,
    pub(crate) lowers: Vec<Node<T>>,
    pub(crate) leaves: Vec<Leaf>,
    pub(crate) pages: Vec<Page<T>>,
    /// Where each leaf's values are in `pages`, as if all were full; beyond the last for those that are not there.
    /// `None`: all are there, in order. A tree is whole wherever it is not that of a [`PartialTree`](super::PartialTree).
    pub(crate) slots: Option<Vec<u32>>,
}

#[derive(Debug, Clone, Copy)]
pub(crate) struct RootTile<T> {
    pub(crate) origin: [i32; 3],
    pub(crate) value: T,
    pub(crate) active: bool,
}

/// A leaf of a [`Tree`]: 8^3 voxels.
#[derive(Debug, Clone, Copy)]
pub struct LeafView<'a, T> {
    /// Index of its first voxel, multiples of 8.
    pub origin: [i32; 3],
    /// Its active voxels: (x, y, z) is bit `8 y + z` of word x.
    pub mask: &'a [u64; 8],
    /// The values of all its voxels: (x, y, z) at `64 x + 8 y + z`.
    pub values: &'a [T; 512],
}

impl<T: Value> Tree<T> {
    /// The value of all space that is not stored.
    pub fn background(&self) -> T {
        self.background
    }

    /// The value at an index, and whether it is active.
    pub fn value(&self, index: [i32; 3]) -> (T, bool) {
        let origin = align(index, LOG2_EDGE[2]);
        if let Ok(at) = self.uppers.binary_search_by_key(&origin, |upper| upper.origin) {
            return self.value_in(at, index).unwrap_or((self.background, false));
        }
        let tile = self.root_tiles.binary_search_by_key(&origin, |tile| tile.origin);
        let tile = tile.ok().and_then(|at| self.root_tiles.get(at));
        tile.map_or((self.background, false), |tile| (tile.value, tile.active))
    }

    fn value_in(&self, upper: usize, index: [i32; 3]) -> Option<(T, bool)> {
        let lower = match self.uppers.get(upper)?.entry(offset(index, 2)) {
            Entry::Tile(value, active) => return Some((value, active)),
            Entry::Child(lower) => lower,
        };
        match self.lowers.get(lower)?.entry(offset(index, 1)) {
            Entry::Tile(value, active) => Some((value, active)),
            Entry::Child(leaf) => {
                let leaf = self.leaf(leaf)?;
                let at = offset(index, 0);
                Some((*leaf.values.get(at)?, (leaf.mask.get(at / 64)? >> (at % 64)) & 1 == 1))
            }
        }
    }

    /// The largest cube around an index that is a leaf, a tile or background throughout.
    pub(crate) fn cube(&self, index: [i32; 3]) -> Cube<'_, T> {
        let uniform = |level: usize, value| {
            Cube::new(index, LOG2_EDGE.get(level).copied().unwrap_or(0), Content::Uniform(value))
        };
        let origin = align(index, LOG2_EDGE[2]);
        let Ok(upper) = self.uppers.binary_search_by_key(&origin, |upper| upper.origin) else {
            return uniform(2, self.value(index).0);
        };
        let entry =
            |nodes: &[Node<T>], at: usize, level| nodes.get(at).map(|node| node.entry(offset(index, level)));
        let lower = match entry(&self.uppers, upper, 2) {
            Some(Entry::Child(lower)) => lower,
            Some(Entry::Tile(value, _)) => return uniform(1, value),
            None => return uniform(1, self.background),
        };
        match entry(&self.lowers, lower, 1) {
            Some(Entry::Child(leaf)) => self.leaf(leaf).map_or_else(
                || uniform(0, self.background),
                |leaf| Cube::new(index, LOG2_EDGE[0], Content::Leaf(leaf.values)),
            ),
            Some(Entry::Tile(value, _)) => uniform(0, value),
            None => uniform(0, self.background),
        }
    }

    /// The leaf that holds an index, by its number.
    pub fn leaf_at(&self, index: [i32; 3]) -> Option<usize> {
        let origin = align(index, LOG2_EDGE[2]);
        let upper = self.uppers.binary_search_by_key(&origin, |upper| upper.origin).ok()?;
        let Entry::Child(lower) = self.uppers.get(upper)?.entry(offset(index, 2)) else { return None };
        let Entry::Child(leaf) = self.lowers.get(lower)?.entry(offset(index, 1)) else { return None };
        Some(leaf)
    }

    /// Number of leaves.
    pub fn leaf_count(&self) -> usize {
        self.leaves.len()
    }

    /// A leaf, by its number in the order of the file.
    pub fn leaf(&self, number: usize) -> Option<LeafView<'_, T>> {
        let Leaf { origin, mask } = self.leaves.get(number)?;
        let slot = match &self.slots {
            None => number,
            Some(slots) => usize::try_from(*slots.get(number)?).ok()?,
        };
        let values = self.pages.get(slot / PAGE)?.get(slot % PAGE)?;
        Some(LeafView { origin: *origin, mask, values })
    }

    /// All leaves in the order of the file.
    pub fn leaves(&self) -> impl Iterator<Item = LeafView<'_, T>> {
        (0..self.leaves.len()).filter_map(|number| self.leaf(number))
    }

    /// Active voxels of leaves with their values, in the order of the file. Those in tiles are not among them.
    pub fn active_voxels(&self) -> impl Iterator<Item = ([i32; 3], T)> {
        self.leaves().flat_map(|leaf| {
            (0..8_i32).zip(leaf.mask).zip(leaf.values.as_chunks::<64>().0).flat_map(
                move |((x, word), values)| {
                    (0..64_i32).zip(values).filter(move |(bit, _)| (word >> bit) & 1 == 1).map(
                        move |(bit, value)| {
                            let [ox, oy, oz] = leaf.origin;
                            ([ox + x, oy + bit / 8, oz + bit % 8], *value)
                        },
                    )
                },
            )
        })
    }

    /// Active tiles: those of the root, those of each upper node, those of each lower node, in the order of the file.
    pub fn active_tiles(&self) -> impl Iterator<Item = Tile<T>> {
        let root = self.root_tiles.iter().filter(|tile| tile.active).map(|tile| Tile {
            origin: tile.origin,
            log2_edge: LOG2_EDGE[2],
            value: tile.value,
        });
        let inner = |nodes, level| tiles_of(nodes, level).filter(|(_, active)| *active).map(|(tile, _)| tile);
        root.chain(inner(&self.uppers, 2)).chain(inner(&self.lowers, 1))
    }

    /// All tiles, active or not, whose value is not the background's: those of the root, those of each upper node, those of
    /// each lower node.
    pub fn tiles(&self) -> impl Iterator<Item = Tile<T>> {
        let root = self.root_tiles.iter().map(|tile| Tile {
            origin: tile.origin,
            log2_edge: LOG2_EDGE[2],
            value: tile.value,
        });
        let inner = |nodes, level| entries_of(nodes, level);
        let all = root.chain(inner(&self.uppers, 2)).chain(inner(&self.lowers, 1));
        all.filter(|tile| !tile.value.same(self.background))
    }

    /// Bytes that the tree takes, those of its leaves' values included.
    pub fn memory_bytes(&self) -> u64 {
        self.memory_bytes_with(self.leaves.len())
    }

    /// Bytes that the tree takes with so many leaves' values.
    pub(crate) fn memory_bytes_with(&self, leaves: usize) -> u64 {
        let nodes = self.uppers.iter().chain(&self.lowers).map(Node::memory_bytes).sum::<u64>();
        let slots = if leaves < self.leaves.len() { 4 * self.leaves.len() } else { 0 };
        let leaves = (size_of::<[T; 512]>() as u64).saturating_mul(leaves as u64);
        nodes.saturating_add(leaves).saturating_add((size_of_val(&*self.leaves) + slots) as u64)
    }

    /// What the tree holds; `memory_bytes` as OpenVDB would hold it.
    pub fn stats(&self) -> Stats {
        let mut stats = Stats {
            leaves: self.leaves.len() as u64,
            lower_nodes: self.lowers.len() as u64,
            upper_nodes: self.uppers.len() as u64,
            tiles: [0; 3],
            active_voxels: 0,
            bounds: None,
            memory_bytes: 0,
        };
        let size = size_of::<T>().max(8) as u64;
        stats.memory_bytes = stats.upper_nodes * (32768 * size + 8192)
            + stats.lower_nodes * (4096 * size + 1024)
            + stats.leaves * (512 * size_of::<T>() as u64 + 64);
        let mut bounds = [[i32::MAX; 3], [i32::MIN; 3]];
        for tile in self.active_tiles() {
            for (count, log2_edge) in stats.tiles.iter_mut().zip(LOG2_EDGE) {
                *count += u64::from(tile.log2_edge == log2_edge);
            }
            stats.active_voxels = stats.active_voxels.saturating_add(1 << (3 * tile.log2_edge));
            grow(&mut bounds, tile.origin, last_voxel(tile.origin, tile.log2_edge));
        }
        for leaf in &self.leaves {
            let count: u32 = leaf.mask.iter().map(|word| word.count_ones()).sum();
            stats.active_voxels = stats.active_voxels.saturating_add(count.into());
            if let Some([low, high]) = active_box(leaf) {
                grow(&mut bounds, low, high);
            }
        }
        stats.bounds = (bounds[0][0] <= bounds[1][0]).then_some(bounds);
        stats
    }
}

/// All tiles of nodes.
fn entries_of<T: Value>(nodes: &[Node<T>], level: usize) -> impl Iterator<Item = Tile<T>> {
    let log2_edge = LOG2_EDGE.get(level - 1).copied().unwrap_or_default();
    let entries = if level == 1 { 16 * 16 * 16 } else { 32 * 32 * 32 };
    nodes.iter().flat_map(move |node| {
        (0..entries).filter_map(move |at| match node.entry(at) {
            Entry::Tile(value, _) => {
                Some(Tile { origin: child_origin(node.origin, at, level), log2_edge, value })
            }
            Entry::Child(_) => None,
        })
    })
}

/// The tiles of nodes that are active or differ from the commonest, with their state.
fn tiles_of<T: Value>(nodes: &[Node<T>], level: usize) -> impl Iterator<Item = (Tile<T>, bool)> {
    let log2_edge = LOG2_EDGE.get(level - 1).copied().unwrap_or_default();
    nodes.iter().flat_map(move |node| {
        node.tiles().map(move |(at, value, active)| {
            (Tile { origin: child_origin(node.origin, at, level), log2_edge, value }, active)
        })
    })
}

/// The place of an index among the entries of its lower node (`level` 1), upper node (2), or leaf (0).
pub(super) fn offset(index: [i32; 3], level: usize) -> usize {
    let (shift, log2) = match level {
        0 => (0, 3),
        1 => (3, 4),
        _ => (7, 5),
    };
    index.iter().fold(0, |at, c| (at << log2) | ((c >> shift) & ((1 << log2) - 1)).cast_unsigned() as usize)
}

/// The first voxel of an entry of a lower (`level` 1) or upper (2) node.
pub(crate) fn child_origin(origin: [i32; 3], at: usize, level: usize) -> [i32; 3] {
    let (shift, log2) = if level == 1 { (3, 4) } else { (7, 5) };
    let mut place = [0; 3];
    for (axis, part) in (0..3).rev().zip(&mut place) {
        *part = origin.get(2 - axis).copied().unwrap_or_default()
            | ((i32::try_from(at >> (axis * log2)).unwrap_or_default() & ((1 << log2) - 1)) << shift);
    }
    place
}
