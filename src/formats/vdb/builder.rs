//! Bricks encoded on many threads, collected in file order.

use std::io::Write;

use super::codec::{Compression, Encoder};
use super::file::{FileHeader, FileWriter, VdbWriteError};
use super::grid::GridHeader;
use super::spool::{Buffers, PIECE, Spool};
use super::topology::Topology;
use super::voxel::Voxel;
use crate::volume::{Leaf, Stats, Tile};

/// A run of bricks encoded by one thread. Cleared and filled again, it allocates nothing.
#[derive(Debug, Clone)]
pub struct EncodedBricks<T = f32> {
    bricks: Vec<Brick<T>>,
    bytes: Vec<u8>,
    encoder: Encoding,
}

/// What encoded the bricks of a run.
#[derive(Debug, Clone, Copy, Default)]
enum Encoding {
    #[default]
    None,
    One(Encoder),
    Several,
}

#[derive(Debug, Clone, Copy)]
enum Brick<T> {
    Leaf(Leaf),
    Tile(Tile<T>),
}

impl<T> Default for EncodedBricks<T> {
    fn default() -> Self {
        Self { bricks: vec![], bytes: vec![], encoder: Encoding::None }
    }
}

impl<T: Voxel> EncodedBricks<T> {
    /// Bricks that did not become tiles.
    pub fn leaves(&self) -> usize {
        self.bricks.iter().filter(|brick| matches!(brick, Brick::Leaf(_))).count()
    }

    /// Bytes of all leaves.
    pub fn encoded_bytes(&self) -> usize {
        self.bytes.len()
    }

    /// Adds the bricks to a topology, behind all added so far.
    ///
    /// # Errors
    /// As of [`Topology::push_leaf`].
    pub fn add_to(&self, topology: &mut Topology<T>) -> Result<(), VdbWriteError> {
        self.bricks.iter().try_for_each(|brick| match brick {
            Brick::Leaf(leaf) => topology.push_leaf(*leaf),
            Brick::Tile(tile) => topology.push_tile(*tile),
        })
    }

    /// Forgets all bricks and keeps the memory.
    pub fn clear(&mut self) {
        self.bricks.clear();
        self.bytes.clear();
        self.encoder = Encoding::None;
    }

    /// Encodes a brick of 8^3 voxels behind those of the run.
    ///
    /// `origin` is the index of its first voxel. Voxel (x, y, z) has the index `64 x + 8 y + z` in `values` and is active
    /// where bit `8 y + z` of `mask[x]` is set. A brick without an active voxel adds nothing; one that is active
    /// throughout with one value, in the encoder's precision, becomes a tile; values of inactive voxels are not kept.
    pub fn push(&mut self, encoder: Encoder, origin: [i32; 3], mask: &[u64; 8], values: &[T; 512]) {
        if mask.iter().all(|word| *word == 0) {
            return;
        }
        self.encoder = match self.encoder {
            Encoding::None => Encoding::One(encoder),
            Encoding::One(other) if other == encoder => self.encoder,
            _ => Encoding::Several,
        };
        let value = encoder.round(values[0]);
        let alike = |v: &T| v.same(value) || encoder.round(*v).same(value);
        if mask.iter().all(|word| *word == u64::MAX) && values.iter().all(alike) {
            self.bricks.push(Brick::Tile(Tile { origin, log2_edge: 3, value }));
        } else {
            self.bricks.push(Brick::Leaf(Leaf { origin, mask: *mask }));
            encoder.encode_leaf(mask, values, &mut self.bytes);
        }
    }
}

/// A grid in the making: topology in memory, encoded leaves there or in a [`Spool`].
///
/// [`VdbGridBuilder::topology_bytes`] says what topology takes.
pub struct VdbGridBuilder<T = f32> {
    encoder: Encoder,
    topology: Topology<T>,
    buffers: Buffers,
}

impl VdbGridBuilder {
    /// A grid of numbers in single precision, with no voxels.
    pub fn new(compression: Compression) -> Self {
        Self::with_encoder(Encoder::new(compression))
    }
}

impl<T: Voxel> VdbGridBuilder<T> {
    /// Bytes of encoded leaves that stay in memory whatever the spool, where there are so many: they are kept in pieces of
    /// this size, which the last of them fills in part.
    pub const LEAST_MEMORY: u64 = PIECE as u64;

    /// A grid with no voxels, for bricks of this encoder.
    pub fn with_encoder(encoder: Encoder) -> Self {
        Self { encoder, topology: Topology::default(), buffers: Buffers::default() }
    }

    /// The same, which keeps at most `memory` bytes of encoded leaves in memory (but [`LEAST_MEMORY`](Self::LEAST_MEMORY) in any case), and puts those
    /// that come then into `spool`.
    #[must_use]
    pub fn with_spool(self, memory: u64, spool: impl Spool + 'static) -> Self {
        Self { buffers: Buffers::with_spool(memory, Box::new(spool)), ..self }
    }

    /// Makes room for so many leaves, as far as the system has it, so that memory is taken once; only what is used of it
    /// counts as resident.
    #[must_use]
    pub fn with_room(mut self, leaves: usize) -> Self {
        self.topology.reserve(leaves);
        self
    }

    /// Bytes that the topology of a grid takes at most that has room for just these leaves, and nodes above them.
    pub const fn topology_bytes(leaves: u64, nodes: u64) -> u64 {
        Topology::<T>::bytes(leaves, nodes)
    }

    /// The encoder that this grid's bricks must be encoded with.
    pub fn encoder(&self) -> Encoder {
        self.encoder
    }

    /// Adds a run of bricks behind all added so far.
    ///
    /// # Errors
    /// [`VdbWriteError::Misaligned`] and [`VdbWriteError::Order`], see [`Topology::push_leaf`]; the grid is then of no
    /// further use. [`VdbWriteError::Encoder`] where a brick of the run was encoded with another encoder than this
    /// grid's; the grid is then as it was. [`VdbWriteError::Spool`] where the spool fails, [`VdbWriteError::Memory`] where
    /// the system has no more.
    pub fn append(&mut self, run: &EncodedBricks<T>) -> Result<(), VdbWriteError> {
        match run.encoder {
            Encoding::None => {}
            Encoding::One(encoder) if encoder == self.encoder => {}
            _ => return Err(VdbWriteError::Encoder),
        }
        run.add_to(&mut self.topology)?;
        self.buffers.push(&run.bytes)
    }

    /// What the grid holds so far.
    pub fn stats(&self) -> Stats {
        self.topology.stats()
    }

    /// Bytes of the encoded leaves so far.
    pub fn encoded_bytes(&self) -> u64 {
        self.buffers.len()
    }

    /// Those of them that are in the spool.
    pub fn spooled_bytes(&self) -> u64 {
        self.buffers.spooled()
    }
}

/// A grid that can be put into a file, whatever the type of its voxels.
pub trait WriteGrid {
    /// Writes the grid behind those that the file has.
    ///
    /// # Errors
    /// Those of [`FileWriter::grid`].
    fn write(&self, header: &GridHeader, file: &mut FileWriter<&mut dyn Write>) -> Result<(), VdbWriteError>;
}

impl<T: Voxel> WriteGrid for VdbGridBuilder<T> {
    fn write(&self, header: &GridHeader, file: &mut FileWriter<&mut dyn Write>) -> Result<(), VdbWriteError> {
        file.grid_with(header, &self.topology, self.encoder, self.encoded_bytes(), |out| {
            self.buffers.write(out)
        })
    }
}

/// Writes a file with these grids, of any types; returns its length in bytes.
///
/// # Errors
/// Those of [`FileWriter`].
pub fn write(
    mut out: impl Write,
    header: &FileHeader,
    grids: &[(&GridHeader, &dyn WriteGrid)],
) -> Result<u64, VdbWriteError> {
    let out: &mut dyn Write = &mut out;
    let mut file = FileWriter::new(out, header, grids.len())?;
    for (header, grid) in grids {
        grid.write(header, &mut file)?;
    }
    file.finish()
}
