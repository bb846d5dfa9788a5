//! Bricks encoded on many threads, collected in file order.

use std::io::Write;

use super::codec::{Compression, Encoder};
use super::file::{FileHeader, FileWriter, GridHeader, VdbWriteError};
use super::topology::Topology;
use crate::volume::{Leaf, Stats, Tile};

/// Encoded bytes are kept in pieces of this size, so that growing never copies what is there.
const PIECE: usize = 4 << 20;

/// A run of bricks encoded by one thread. Cleared and filled again, it allocates nothing.
#[derive(Debug, Clone, Default)]
pub struct EncodedBricks {
    bricks: Vec<Brick>,
    bytes: Vec<u8>,
}

#[derive(Debug, Clone, Copy)]
enum Brick {
    Leaf(Leaf),
    Tile(Tile),
}

impl EncodedBricks {
    /// Forgets all bricks and keeps the memory.
    pub fn clear(&mut self) {
        self.bricks.clear();
        self.bytes.clear();
    }

    /// Encodes a brick of 8^3 voxels behind those of the run.
    ///
    /// `origin` is the index of its first voxel. Voxel (x, y, z) has the index `64 x + 8 y + z` in `values` and is active
    /// where bit `8 y + z` of `mask[x]` is set. A brick without an active voxel adds nothing; one that is active
    /// throughout with one value becomes a tile; values of inactive voxels are not kept.
    pub fn push(&mut self, encoder: Encoder, origin: [i32; 3], mask: &[u64; 8], values: &[f32; 512]) {
        if mask.iter().all(|word| *word == 0) {
            return;
        }
        let value = values[0];
        if mask.iter().all(|word| *word == u64::MAX) && values.iter().all(|v| v.to_bits() == value.to_bits())
        {
            self.bricks.push(Brick::Tile(Tile { origin, log2_edge: 3, value }));
        } else {
            self.bricks.push(Brick::Leaf(Leaf { origin, mask: *mask }));
            encoder.encode_leaf(mask, values, &mut self.bytes);
        }
    }
}

/// A float grid in the making: topology and encoded leaves, in memory.
///
/// Memory is about 80 bytes a leaf and 16 a tile, besides the encoded bytes.
#[derive(Debug, Clone)]
pub struct VdbGridBuilder {
    encoder: Encoder,
    topology: Topology,
    pieces: Vec<Vec<u8>>,
}

impl VdbGridBuilder {
    /// A grid with no voxels.
    pub fn new(compression: Compression) -> Self {
        Self { encoder: Encoder::new(compression), topology: Topology::default(), pieces: vec![] }
    }

    /// The encoder that this grid's bricks must be encoded with.
    pub fn encoder(&self) -> Encoder {
        self.encoder
    }

    /// Adds a run of bricks behind all added so far.
    ///
    /// # Errors
    /// [`VdbWriteError::Misaligned`] and [`VdbWriteError::Order`], see [`Topology::push_leaf`]; the grid is then of no
    /// further use.
    pub fn append(&mut self, run: &EncodedBricks) -> Result<(), VdbWriteError> {
        for brick in &run.bricks {
            match brick {
                Brick::Leaf(leaf) => self.topology.push_leaf(*leaf)?,
                Brick::Tile(tile) => self.topology.push_tile(*tile)?,
            }
        }
        let mut rest = &run.bytes[..];
        while !rest.is_empty() {
            match self.pieces.last_mut() {
                Some(piece) if piece.len() < PIECE => {
                    let (head, tail) = rest.split_at(rest.len().min(PIECE - piece.len()));
                    piece.extend(head);
                    rest = tail;
                }
                _ => self.pieces.push(Vec::with_capacity(PIECE)),
            }
        }
        Ok(())
    }

    /// What the grid holds so far.
    pub fn stats(&self) -> Stats {
        self.topology.stats()
    }

    /// Bytes of the encoded leaves so far.
    pub fn encoded_bytes(&self) -> u64 {
        self.pieces.iter().map(|piece| piece.len() as u64).sum()
    }
}

/// Writes a file with these grids; returns its length in bytes.
///
/// # Errors
/// Those of [`FileWriter`].
pub fn write(
    out: impl Write,
    header: &FileHeader,
    grids: &[(&GridHeader, &VdbGridBuilder)],
) -> Result<u64, VdbWriteError> {
    let mut file = FileWriter::new(out, header, grids.len())?;
    for (header, grid) in grids {
        file.grid(header, &grid.topology, grid.encoder, grid.encoded_bytes(), &grid.pieces)?;
    }
    file.finish()
}
