//! Which voxels are active: leaves and tiles in file order, the nodes above them, and the topology stream.

use std::io::{self, Write};
use std::ops::Range;

use super::codec::Encoder;
use super::file::{Counted, VdbWriteError};
use super::voxel::Voxel;
use crate::volume::shape::{LOG2_EDGE, active_box, align, grow, last_voxel};
use crate::volume::{Leaf, Stats, Tile};

/// A key whose order is the order of bricks in a file.
///
/// Bricks are grouped by upper node (4096^3 voxels; these by signed x, then y, then z), within it by lower node (128^3),
/// within it by position, x slowest and z fastest each time. Sort by this key before encoding: a file's leaves can then
/// be written as they come.
pub fn file_order(origin: [i32; 3]) -> u128 {
    let mut key = 0;
    for (shift, bits) in [(LOG2_EDGE[2], 20), (LOG2_EDGE[1], 5), (LOG2_EDGE[0], 4)] {
        for c in origin {
            // Flipping the sign bit makes the unsigned order that of signed coordinates.
            let biased = c.cast_unsigned() ^ (1 << 31);
            key = (key << bits) | u128::from((biased >> shift) & ((1 << bits) - 1));
        }
    }
    key
}

/// Makes room for one more.
fn room<T>(list: &mut Vec<T>) -> Result<(), VdbWriteError> {
    let bytes = (list.len() * size_of::<T>()) as u64;
    list.try_reserve(1).map_err(|_| VdbWriteError::Memory { bytes })
}

/// Leaves and tiles in file order.
#[derive(Debug, Clone)]
pub struct Topology<T = f32> {
    leaves: Vec<Leaf>,
    tiles: Vec<Tile<T>>,
    last: Option<u128>,
}

impl<T> Default for Topology<T> {
    fn default() -> Self {
        Self { leaves: vec![], tiles: vec![], last: None }
    }
}

impl<T: Voxel> Topology<T> {
    /// Adds a leaf behind all leaves and tiles added so far.
    ///
    /// # Errors
    /// [`VdbWriteError::Misaligned`] where the origin is not a multiple of the edge, [`VdbWriteError::Order`] where it
    /// does not come after what was added last, [`VdbWriteError::Memory`] where the system has none for it.
    pub fn push_leaf(&mut self, leaf: Leaf) -> Result<(), VdbWriteError> {
        self.advance(leaf.origin, LOG2_EDGE[0])?;
        room(&mut self.leaves)?;
        self.leaves.push(leaf);
        Ok(())
    }

    /// Adds an active tile behind all leaves and tiles added so far. Tiles that fill a node with one value become one
    /// tile, of the next size.
    ///
    /// # Errors
    /// As [`Topology::push_leaf`]; an edge that no tile has counts as misaligned.
    pub fn push_tile(&mut self, tile: Tile<T>) -> Result<(), VdbWriteError> {
        if !LOG2_EDGE.contains(&tile.log2_edge) {
            return Err(VdbWriteError::Misaligned { origin: tile.origin });
        }
        self.advance(tile.origin, tile.log2_edge)?;
        room(&mut self.tiles)?;
        self.tiles.push(tile);
        for [child, parent] in [[LOG2_EDGE[0], LOG2_EDGE[1]], [LOG2_EDGE[1], LOG2_EDGE[2]]] {
            let Some(first) = self.tiles.len().checked_sub(1 << (3 * (parent - child))) else { break };
            let origin = align(tile.origin, parent);
            let alike = |other: &Tile<T>| {
                other.log2_edge == child
                    && align(other.origin, parent) == origin
                    && other.value.same(tile.value)
            };
            // As many different tiles as the node has entries, all inside it. From the front, because only a full
            // node passes the first comparison.
            if self.tiles[first..].iter().all(alike) {
                self.tiles.truncate(first);
                self.tiles.push(Tile { origin, log2_edge: parent, value: tile.value });
            }
        }
        Ok(())
    }

    fn advance(&mut self, origin: [i32; 3], log2_edge: u32) -> Result<(), VdbWriteError> {
        if align(origin, log2_edge) != origin {
            return Err(VdbWriteError::Misaligned { origin });
        }
        if self.last.is_some_and(|last| file_order(origin) <= last) {
            return Err(VdbWriteError::Order { origin });
        }
        self.last = Some(file_order(last_voxel(origin, log2_edge)));
        Ok(())
    }

    /// Makes room for so many more leaves, and no more; none where the system has not so much memory.
    pub fn reserve(&mut self, leaves: usize) {
        // Whether it is missed will show: room is made again for each leaf that has none.
        let _ = self.leaves.try_reserve_exact(leaves);
    }

    /// Bytes that leaves take, in lists that have room for just these, and nodes above them while a file is written.
    pub(super) const fn bytes(leaves: u64, nodes: u64) -> u64 {
        // Lists of nodes grow by doubling. Of tiles there are the fewer leaves, but their list doubles, too.
        let leaf = if size_of::<Leaf>() > 2 * size_of::<Tile<T>>() {
            size_of::<Leaf>()
        } else {
            2 * size_of::<Tile<T>>()
        };
        leaves * leaf as u64 + nodes * 2 * size_of::<Lower>() as u64
    }

    /// What was added so far.
    pub fn stats(&self) -> Stats {
        self.nodes().stats()
    }

    /// Bytes that leaves' masks, tiles and the nodes above them take in a file, where values are stored as this encoder does.
    ///
    /// # Errors
    /// [`VdbWriteError::TooLarge`] as when a file is written.
    pub fn file_bytes(&self, encoder: Encoder) -> Result<u64, VdbWriteError> {
        self.nodes().file_bytes(encoder)
    }

    /// Groups leaves and tiles into nodes.
    pub(super) fn nodes(&self) -> Nodes<'_, T> {
        let mut nodes = Nodes { leaves: &self.leaves, tiles: &self.tiles, lowers: vec![], uppers: vec![] };
        let (mut leaf, mut tile) = (0, 0);
        while let Some((origin, log2_edge)) = first_in_file(self.leaves.get(leaf), self.tiles.get(tile)) {
            if log2_edge == LOG2_EDGE[2] {
                tile += 1;
                continue;
            }
            let upper_origin = align(origin, LOG2_EDGE[2]);
            if nodes.uppers.last().is_none_or(|upper| upper.origin != upper_origin) {
                let (lowers, tiles) = (nodes.lowers.len()..nodes.lowers.len(), tile..tile);
                nodes.uppers.push(Upper { origin: upper_origin, lowers, tiles });
            }
            if log2_edge == LOG2_EDGE[1] {
                tile += 1;
            } else {
                let origin = align(origin, LOG2_EDGE[1]);
                let inside = |other: [i32; 3]| align(other, LOG2_EDGE[1]) == origin;
                let leaves = self.leaves[leaf..].iter().take_while(|l| inside(l.origin)).count();
                let tiles = self.tiles[tile..].iter().take_while(|t| inside(t.origin)).count();
                nodes.lowers.push(Lower { origin, leaves: leaf..leaf + leaves, tiles: tile..tile + tiles });
                leaf += leaves;
                tile += tiles;
            }
            if let Some(upper) = nodes.uppers.last_mut() {
                upper.lowers.end = nodes.lowers.len();
                upper.tiles.end = tile;
            }
        }
        nodes
    }
}

/// The origin and edge of what comes first in a file.
fn first_in_file<T>(leaf: Option<&Leaf>, tile: Option<&Tile<T>>) -> Option<([i32; 3], u32)> {
    let leaf = leaf.map(|leaf| (leaf.origin, LOG2_EDGE[0]));
    let tile = tile.map(|tile| (tile.origin, tile.log2_edge));
    leaf.into_iter().chain(tile).min_by_key(|(origin, _)| file_order(*origin))
}

struct Lower {
    origin: [i32; 3],
    leaves: Range<usize>,
    tiles: Range<usize>,
}

struct Upper {
    origin: [i32; 3],
    lowers: Range<usize>,
    /// Its tiles, and those of its lower nodes.
    tiles: Range<usize>,
}

/// The tree above leaves and tiles, sorted as a file has it.
pub(super) struct Nodes<'a, T> {
    leaves: &'a [Leaf],
    tiles: &'a [Tile<T>],
    lowers: Vec<Lower>,
    uppers: Vec<Upper>,
}

/// The tiles of this edge.
fn of_edge<T>(tiles: &[Tile<T>], log2_edge: u32) -> impl Iterator<Item = &Tile<T>> {
    tiles.iter().filter(move |tile| tile.log2_edge == log2_edge)
}

impl<T: Voxel> Nodes<'_, T> {
    pub(super) fn stats(&self) -> Stats {
        let mut stats = Stats {
            leaves: self.leaves.len() as u64,
            lower_nodes: self.lowers.len() as u64,
            upper_nodes: self.uppers.len() as u64,
            tiles: LOG2_EDGE.map(|log2_edge| of_edge(self.tiles, log2_edge).count() as u64),
            active_voxels: 0,
            bounds: None,
            memory_bytes: 0,
        };
        // A value or a pointer an entry and two masks in a node; a value a voxel and one mask in a leaf.
        let value = size_of::<T>() as u64;
        let entry = value.max(8);
        stats.memory_bytes = stats.upper_nodes * (32768 * entry + 8192)
            + stats.lower_nodes * (4096 * entry + 1024)
            + stats.leaves * (512 * value + 64);
        let mut bounds = [[i32::MAX; 3], [i32::MIN; 3]];
        for tile in self.tiles {
            stats.active_voxels += 1 << (3 * tile.log2_edge);
            grow(&mut bounds, tile.origin, last_voxel(tile.origin, tile.log2_edge));
        }
        for leaf in self.leaves {
            stats.active_voxels += leaf.mask.iter().map(|word| u64::from(word.count_ones())).sum::<u64>();
            if let Some([low, high]) = active_box(leaf) {
                grow(&mut bounds, low, high);
            }
        }
        stats.bounds = (bounds[0][0] <= bounds[1][0]).then_some(bounds);
        stats
    }

    /// Bytes of the topology stream.
    pub(super) fn file_bytes(&self, encoder: Encoder) -> Result<u64, VdbWriteError> {
        let mut measured = Counted { inner: io::sink(), bytes: 0 };
        self.write(encoder, &mut measured)?;
        Ok(measured.bytes)
    }

    /// Writes the topology stream: what comes between a grid's transform and its leaf buffers.
    pub(super) fn write(&self, encoder: Encoder, out: &mut impl Write) -> Result<(), VdbWriteError> {
        let count = |len| u32::try_from(len).map_err(|_| VdbWriteError::TooLarge("the root node"));
        out.write_all(&1_u32.to_le_bytes())?;
        // Single values have their full width whatever the precision.
        write_value(out, T::ZERO)?;
        out.write_all(&count(of_edge(self.tiles, LOG2_EDGE[2]).count())?.to_le_bytes())?;
        out.write_all(&count(self.uppers.len())?.to_le_bytes())?;
        for tile in of_edge(self.tiles, LOG2_EDGE[2]) {
            write_origin(out, tile.origin)?;
            write_value(out, encoder.round(tile.value))?;
            out.write_all(&[1])?;
        }
        let mut node =
            Node { children: vec![], active: vec![], values: vec![], block: vec![], blank: [vec![], vec![]] };
        for upper in &self.uppers {
            let lowers = &self.lowers[upper.lowers.clone()];
            write_origin(out, upper.origin)?;
            node.set(
                2,
                lowers.iter().map(|lower| lower.origin),
                of_edge(&self.tiles[upper.tiles.clone()], LOG2_EDGE[1]),
            );
            node.write(2, encoder, out)?;
            for lower in lowers {
                let leaves = &self.leaves[lower.leaves.clone()];
                node.set(1, leaves.iter().map(|leaf| leaf.origin), self.tiles[lower.tiles.clone()].iter());
                node.write(1, encoder, out)?;
                for leaf in leaves {
                    out.write_all(leaf.mask.map(u64::to_le_bytes).as_flattened())?;
                }
            }
        }
        Ok(())
    }
}

/// Entries of one internal node.
struct Node<T> {
    children: Vec<u64>,
    active: Vec<u64>,
    values: Vec<T>,
    block: Vec<u8>,
    /// The blocks of lower and of upper nodes without tiles, once one was encoded: they are all alike, and most nodes have none.
    blank: [Vec<u8>; 2],
}

impl<T: Voxel> Node<T> {
    /// Replaces the entries by those of a lower (`level` 1) or upper (2) node with these children and tiles.
    fn set<'a>(
        &mut self,
        level: usize,
        children: impl Iterator<Item = [i32; 3]>,
        tiles: impl Iterator<Item = &'a Tile<T>>,
    ) {
        let child_log2 = LOG2_EDGE[level - 1];
        let log2 = LOG2_EDGE[level] - child_log2;
        let entries = 1 << (3 * log2);
        for mask in [&mut self.children, &mut self.active] {
            mask.clear();
            mask.resize(entries / 64, 0);
        }
        self.values.clear();
        self.values.resize(entries, T::ZERO);
        let offset = |origin: [i32; 3]| {
            origin.iter().fold(0, |at, c| {
                (at << log2) | ((c >> child_log2) & ((1 << log2) - 1)).cast_unsigned() as usize
            })
        };
        for origin in children {
            let at = offset(origin);
            self.children[at / 64] |= 1 << (at % 64);
        }
        for tile in tiles {
            let at = offset(tile.origin);
            self.active[at / 64] |= 1 << (at % 64);
            self.values[at] = tile.value;
        }
    }

    fn write(&mut self, level: usize, encoder: Encoder, out: &mut impl Write) -> io::Result<()> {
        write_mask(out, &self.children)?;
        write_mask(out, &self.active)?;
        let is_blank = self.active.iter().all(|word| *word == 0);
        let block = if is_blank { &mut self.blank[level - 1] } else { &mut self.block };
        if !is_blank || block.is_empty() {
            block.clear();
            encoder.encode_block(&self.active, &self.values, block);
        }
        out.write_all(block)
    }
}

fn write_value<T: Voxel>(out: &mut impl Write, mut value: T) -> io::Result<()> {
    let numbers = T::numbers_mut(std::slice::from_mut(&mut value));
    numbers.iter().try_for_each(|x| out.write_all(&x.to_le_bytes()))
}

fn write_origin(out: &mut impl Write, origin: [i32; 3]) -> io::Result<()> {
    origin.iter().try_for_each(|c| out.write_all(&c.to_le_bytes()))
}

fn write_mask(out: &mut impl Write, mask: &[u64]) -> io::Result<()> {
    mask.iter().try_for_each(|word| out.write_all(&word.to_le_bytes()))
}

#[cfg(test)]
mod tests {
    use super::super::tests::random;
    use super::*;

    fn leaf(origin: [i32; 3]) -> Leaf {
        Leaf { origin, mask: [1; 8] }
    }

    /// The order written out: root entries by signed coordinates, then offsets in the upper and in the lower node.
    fn path(origin: [i32; 3]) -> ([i32; 3], i32, i32) {
        let [x, y, z] = origin.map(|c| c & 4095);
        let upper = (x / 128) * 1024 + (y / 128) * 32 + z / 128;
        let lower = (x % 128 / 8) * 256 + (y % 128 / 8) * 16 + z % 128 / 8;
        (align(origin, 12), upper, lower)
    }

    #[test]
    fn key_orders_as_a_file_does() {
        let mut state = 4;
        let mut coordinate = || {
            let bits = random(&mut state);
            let wide = i32::from_le_bytes(bits.to_le_bytes()[..4].first_chunk().copied().unwrap_or_default());
            // Some far apart, most near the borders of nodes.
            if bits >> 62 == 0 { wide & !7 } else { (wide >> 18) & !7 }
        };
        let mut origins: Vec<[i32; 3]> = (0..20_000).map(|_| [(); 3].map(|()| coordinate())).collect();
        origins.extend([[i32::MIN; 3], [i32::MAX - 7; 3], [0; 3], [-8; 3]]);
        origins.sort_by_key(|origin| file_order(*origin));
        assert!(origins.is_sorted_by_key(|origin| path(*origin)));
    }

    #[test]
    fn order_and_alignment_are_checked() {
        let mut topology = Topology::<f32>::default();
        topology.push_leaf(leaf([-8, 0, 0])).expect("first");
        let order = |result| matches!(result, Err(VdbWriteError::Order { .. }));
        let misaligned = |result| matches!(result, Err(VdbWriteError::Misaligned { .. }));
        assert!(order(topology.push_leaf(leaf([-8, 0, 0]))));
        assert!(order(topology.push_leaf(leaf([-16, 0, 0]))));
        assert!(misaligned(topology.push_leaf(leaf([4, 0, 0]))));
        let tile = |origin, log2_edge| Tile { origin, log2_edge, value: 1.0 };
        assert!(misaligned(topology.push_tile(tile([0; 3], 4))));
        assert!(misaligned(topology.push_tile(tile([8; 3], 7))));
        topology.push_tile(tile([0; 3], 7)).expect("after the leaf");
        assert!(order(topology.push_leaf(leaf([120; 3]))));
        topology.push_leaf(leaf([0, 0, 128])).expect("after the tile");
    }

    #[test]
    fn tiles_of_different_values_stay() {
        let mut topology = Topology::default();
        for index in 0..4096 {
            let origin = [index / 256 * 8, index / 16 % 16 * 8, index % 16 * 8];
            let value = if index == 77 { 2.0 } else { 1.0 };
            topology.push_tile(Tile { origin, log2_edge: 3, value }).expect("sorted");
        }
        assert_eq!(topology.stats().tiles, [4096, 0, 0]);
    }

    #[test]
    fn bounds_reach_the_ends_of_the_lattice() {
        let mut topology = Topology::<f32>::default();
        topology.push_leaf(Leaf { origin: [i32::MIN; 3], mask: [1, 0, 0, 0, 0, 0, 0, 0] }).expect("first");
        let mask = [0, 0, 0, 0, 0, 0, 0, 1 << 63];
        topology.push_leaf(Leaf { origin: [i32::MAX - 7; 3], mask }).expect("last");
        assert_eq!(topology.stats().bounds, Some([[i32::MIN; 3], [i32::MAX; 3]]));
    }
}
