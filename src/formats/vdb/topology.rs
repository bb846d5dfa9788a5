//! Which voxels are active: leaves and tiles in file order, the nodes above them, and the topology stream.

use std::io::{self, Write};
use std::ops::Range;

use super::codec::Encoder;
use super::file::VdbWriteError;

/// log2 of the edge in voxels of a leaf, of a lower node and of an upper node.
const LOG2_EDGE: [u32; 3] = [3, 7, 12];

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

/// A brick of 8^3 voxels with values of its own.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Leaf {
    /// Index of its first voxel, multiples of 8.
    pub origin: [i32; 3],
    /// Its active voxels: (x, y, z) is bit `8 y + z` of word x.
    pub mask: [u64; 8],
}

/// A cube of active voxels that share one value.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tile {
    /// Index of its first voxel, multiples of its edge.
    pub origin: [i32; 3],
    /// The value of all its voxels.
    pub value: f32,
}

/// Leaves and tiles of 8^3 voxels, in file order.
#[derive(Debug, Clone, Default)]
pub struct Topology {
    leaves: Vec<Leaf>,
    tiles: Vec<Tile>,
    last: Option<u128>,
}

/// What a grid holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Stats {
    /// Leaves, of 8^3 voxels.
    pub leaves: u64,
    /// Lower nodes, of 128^3 voxels.
    pub lower_nodes: u64,
    /// Upper nodes, of 4096^3 voxels.
    pub upper_nodes: u64,
    /// Active tiles of 8^3, 128^3 and 4096^3 voxels.
    pub tiles: [u64; 3],
    /// Active voxels, those in tiles included.
    pub active_voxels: u64,
    /// Smallest and largest index of an active voxel, inclusive; `None` for an empty grid.
    pub bounds: Option<[[i32; 3]; 2]>,
    /// Bytes that the tree's values, masks and pointers take in a program that has loaded it.
    pub memory_bytes: u64,
}

impl Topology {
    /// Adds a leaf behind all bricks added so far.
    ///
    /// # Errors
    /// [`VdbWriteError::Misaligned`] where the origin is not a multiple of 8, [`VdbWriteError::Order`] where it does not
    /// come after the brick added last.
    pub fn push_leaf(&mut self, leaf: Leaf) -> Result<(), VdbWriteError> {
        self.advance(leaf.origin)?;
        self.leaves.push(leaf);
        Ok(())
    }

    /// Adds an active tile of 8^3 voxels behind all bricks added so far.
    ///
    /// # Errors
    /// As [`Topology::push_leaf`].
    pub fn push_tile(&mut self, tile: Tile) -> Result<(), VdbWriteError> {
        self.advance(tile.origin)?;
        self.tiles.push(tile);
        Ok(())
    }

    fn advance(&mut self, origin: [i32; 3]) -> Result<(), VdbWriteError> {
        if origin.iter().any(|c| c & 7 != 0) {
            return Err(VdbWriteError::Misaligned { origin });
        }
        let key = file_order(origin);
        if self.last.is_some_and(|last| key <= last) {
            return Err(VdbWriteError::Order { origin });
        }
        self.last = Some(key);
        Ok(())
    }

    /// Groups leaves and tiles into nodes; nodes that are one value throughout become tiles.
    pub(super) fn nodes(&self) -> Nodes<'_> {
        let mut nodes = Nodes {
            leaves: &self.leaves,
            small_tiles: &self.tiles,
            lowers: vec![],
            uppers: vec![],
            root_tiles: vec![],
        };
        let (mut leaf, mut tile) = (0, 0);
        while let Some(first) = first_in_file(self.leaves.get(leaf), self.tiles.get(tile)) {
            let upper_origin = align(first, LOG2_EDGE[2]);
            let mut upper = Upper { origin: upper_origin, lowers: nodes.lowers.len()..0, tiles: vec![] };
            while let Some(origin) = first_in_file(self.leaves.get(leaf), self.tiles.get(tile))
                && align(origin, LOG2_EDGE[2]) == upper_origin
            {
                let origin = align(origin, LOG2_EDGE[1]);
                let inside = |other: [i32; 3]| align(other, LOG2_EDGE[1]) == origin;
                let leaves = self.leaves[leaf..].iter().take_while(|l| inside(l.origin)).count();
                let tiles = self.tiles[tile..].iter().take_while(|t| inside(t.origin)).count();
                let lower = Lower { origin, leaves: leaf..leaf + leaves, tiles: tile..tile + tiles };
                leaf = lower.leaves.end;
                tile = lower.tiles.end;
                match uniform(&self.tiles[lower.tiles.clone()], 4096) {
                    Some(value) => upper.tiles.push(Tile { origin, value }),
                    None => nodes.lowers.push(lower),
                }
            }
            upper.lowers.end = nodes.lowers.len();
            match uniform(&upper.tiles, 32768) {
                Some(value) => nodes.root_tiles.push(Tile { origin: upper_origin, value }),
                None => nodes.uppers.push(upper),
            }
        }
        nodes
    }
}

/// The origin that comes first in a file.
fn first_in_file(leaf: Option<&Leaf>, tile: Option<&Tile>) -> Option<[i32; 3]> {
    leaf.map(|l| l.origin).into_iter().chain(tile.map(|t| t.origin)).min_by_key(|origin| file_order(*origin))
}

fn align(origin: [i32; 3], log2_edge: u32) -> [i32; 3] {
    origin.map(|c| (c >> log2_edge) << log2_edge)
}

/// The value of `tiles` if they are `count` of the same bits.
fn uniform(tiles: &[Tile], count: usize) -> Option<f32> {
    let first = tiles.first()?.value;
    (tiles.len() == count && tiles.iter().all(|t| t.value.to_bits() == first.to_bits())).then_some(first)
}

struct Lower {
    origin: [i32; 3],
    leaves: Range<usize>,
    tiles: Range<usize>,
}

struct Upper {
    origin: [i32; 3],
    lowers: Range<usize>,
    tiles: Vec<Tile>,
}

/// The tree above leaves and tiles, sorted as a file has it.
pub(super) struct Nodes<'a> {
    leaves: &'a [Leaf],
    small_tiles: &'a [Tile],
    lowers: Vec<Lower>,
    uppers: Vec<Upper>,
    root_tiles: Vec<Tile>,
}

impl Nodes<'_> {
    pub(super) fn stats(&self) -> Stats {
        let small = self.lowers.iter().map(|lower| lower.tiles.len() as u64).sum::<u64>();
        let middle = self.uppers.iter().map(|upper| upper.tiles.len() as u64).sum::<u64>();
        let tiles = [small, middle, self.root_tiles.len() as u64];
        let mut stats = Stats {
            leaves: self.leaves.len() as u64,
            lower_nodes: self.lowers.len() as u64,
            upper_nodes: self.uppers.len() as u64,
            tiles,
            // A tile of any size stands for tiles of 8^3 voxels that were pushed one by one.
            active_voxels: 512 * self.small_tiles.len() as u64,
            bounds: None,
            memory_bytes: 0,
        };
        // 8 bytes an entry and two masks in a node; 4 bytes a voxel and one mask in a leaf.
        stats.memory_bytes = stats.upper_nodes * (32768 * 8 + 8192)
            + stats.lower_nodes * (4096 * 8 + 1024)
            + stats.leaves * (512 * 4 + 64);
        let mut bounds = [[i32::MAX; 3], [i32::MIN; 3]];
        for tile in self.small_tiles {
            grow(&mut bounds, tile.origin, tile.origin.map(|c| c + 7));
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

    /// Writes the topology stream: what comes between a grid's transform and its leaf buffers.
    pub(super) fn write(&self, encoder: Encoder, out: &mut impl Write) -> Result<(), VdbWriteError> {
        let count = |len| u32::try_from(len).map_err(|_| VdbWriteError::TooLarge("the root node"));
        out.write_all(&1_u32.to_le_bytes())?;
        out.write_all(&0_f32.to_le_bytes())?;
        out.write_all(&count(self.root_tiles.len())?.to_le_bytes())?;
        out.write_all(&count(self.uppers.len())?.to_le_bytes())?;
        for tile in &self.root_tiles {
            write_origin(out, tile.origin)?;
            out.write_all(&tile.value.to_le_bytes())?;
            out.write_all(&[1])?;
        }
        let mut node = Node::default();
        for upper in &self.uppers {
            let lowers = &self.lowers[upper.lowers.clone()];
            write_origin(out, upper.origin)?;
            node.set(2, lowers.iter().map(|lower| lower.origin), &upper.tiles);
            node.write(encoder, out)?;
            for lower in lowers {
                let leaves = &self.leaves[lower.leaves.clone()];
                node.set(1, leaves.iter().map(|leaf| leaf.origin), &self.small_tiles[lower.tiles.clone()]);
                node.write(encoder, out)?;
                for leaf in leaves {
                    write_mask(out, &leaf.mask)?;
                }
            }
        }
        Ok(())
    }
}

/// Entries of one internal node.
#[derive(Default)]
struct Node {
    children: Vec<u64>,
    active: Vec<u64>,
    values: Vec<f32>,
    block: Vec<u8>,
}

impl Node {
    /// Replaces the entries by those of a lower (`level` 1) or upper (2) node with these children and tiles.
    fn set(&mut self, level: usize, children: impl Iterator<Item = [i32; 3]>, tiles: &[Tile]) {
        let child_log2 = LOG2_EDGE[level - 1];
        let log2 = LOG2_EDGE[level] - child_log2;
        let entries = 1 << (3 * log2);
        for mask in [&mut self.children, &mut self.active] {
            mask.clear();
            mask.resize(entries / 64, 0);
        }
        self.values.clear();
        self.values.resize(entries, 0.0);
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

    fn write(&mut self, encoder: Encoder, out: &mut impl Write) -> io::Result<()> {
        write_mask(out, &self.children)?;
        write_mask(out, &self.active)?;
        self.block.clear();
        encoder.encode_block(&self.active, &self.values, &mut self.block);
        out.write_all(&self.block)
    }
}

fn write_origin(out: &mut impl Write, origin: [i32; 3]) -> io::Result<()> {
    origin.iter().try_for_each(|c| out.write_all(&c.to_le_bytes()))
}

fn write_mask(out: &mut impl Write, mask: &[u64]) -> io::Result<()> {
    mask.iter().try_for_each(|word| out.write_all(&word.to_le_bytes()))
}

fn grow(bounds: &mut [[i32; 3]; 2], low: [i32; 3], high: [i32; 3]) {
    for axis in 0..3 {
        bounds[0][axis] = bounds[0][axis].min(low[axis]);
        bounds[1][axis] = bounds[1][axis].max(high[axis]);
    }
}

/// Smallest and largest index of an active voxel of a leaf.
fn active_box(leaf: &Leaf) -> Option<[[i32; 3]; 2]> {
    let x0 = leaf.mask.iter().zip(0..8).find(|(word, _)| **word != 0)?.1;
    let x1 = leaf.mask.iter().zip(0..8).rfind(|(word, _)| **word != 0)?.1;
    let rows = leaf.mask.iter().fold(0, |all, word| all | word);
    let (y0, y1) = (rows.trailing_zeros() / 8, 7 - rows.leading_zeros() / 8);
    let column = rows.to_le_bytes().iter().fold(0, |all, row| all | row);
    let (z0, z1) = (column.trailing_zeros(), 7 - column.leading_zeros());
    let at = |x: i32, y: u32, z: u32| {
        let [ox, oy, oz] = leaf.origin;
        [ox + x, oy + y.cast_signed(), oz + z.cast_signed()]
    };
    Some([at(x0, y0, z0), at(x1, y1, z1)])
}
