//! OpenVDB files: trees of shape 5-4-3 (leaves of 8^3 voxels, nodes of 16^3 leaves, nodes of 32^3 of those).
//!
//! Writing runs in three steps, so that encoding can be spread over threads and nothing is buffered twice:
//!
//! 1. An [`Encoder`] turns a brick of 8^3 voxels into the bytes of a leaf, or finds that it is uniform or empty.
//!    It is `Copy` and each thread fills its own [`EncodedBricks`].
//! 2. A [`VdbGridBuilder`] takes the batches in file order ([`file_order`]), and keeps topology and encoded bytes: these up
//!    to a limit in memory, the others in a [`Spool`].
//! 3. [`write()`] puts the file together with exact offsets, over nothing but `Write`. A [`FileWriter`] does the same
//!    for leaf bytes that lie elsewhere, in a spool file for instance.
//!
//! Reading: a [`VdbFile`], of any program, lists its grids and gives each as a [`Tree`], or a [`Part`] of it as a
//! [`PartialTree`]; [`read_info`] lists only, [`list_grids`] also what a damaged file still tells.
//!
//! # What is written
//!
//! Version 224 with offsets; grids of numbers (`float`) and of vectors of three (`vec3s`), any mix of them, each in full or
//! as binary16 ([`Precision`]), under names of their own; background 0. The value with index (i, j, k) belongs to the
//! world point `voxel_size * (i, j, k) + translation`, always by a `UniformScaleTranslateMap`, one of the few maps that
//! simple readers know. A brick that is active throughout with one value becomes a tile;
//! so do nodes made of such bricks only. Root entries are sorted by signed (x, y, z), entries of nodes by offset, because
//! simple readers attach leaf buffers in that order. With compression, inactive voxels are not stored, and nodes without
//! an active entry of their own store all entries: readers disagree about the shorter form.
//! Bytes depend on nothing but the arguments, on every little-endian processor.

mod bound;
mod builder;
mod chunk;
mod codec;
mod file;
mod grid;
mod meta;
mod read;
mod rehead;
mod sink;
mod spool;
mod topology;
mod voxel;

#[cfg(test)]
mod tests;

pub use bound::GridBound;
pub use builder::{EncodedBricks, VdbGridBuilder, WriteGrid, write};
pub use codec::{Compression, Encoder};
pub use file::{FileHeader, FileWriter, VdbWriteError};
pub use grid::{GridClass, GridHeader, VectorType};
pub use meta::{Meta, Metadata};
pub use read::{
    AnyPartialTree, AnyTree, FileInfo, Grid, GridInfo, Listing, Map, PagedGrid, PartialGrid, VdbFile,
    VdbReadError, list_grids, read_info,
};
pub use rehead::rehead;
pub use spool::Spool;
pub use topology::{Topology, file_order};
pub use voxel::Voxel;

pub use crate::volume::{Leaf, LeafView, NotRead, Part, PartialTree, Precision, Stats, Tile, Tree, Value};

/// First eight bytes of a file, as a little-endian number.
const MAGIC: i64 = 0x5644_4220;
/// File version written: version 225 only adds native half grids, and older libraries warn about it.
const VERSION: u32 = 224;
/// Library version written; readers only ask whether it is above 6.1.
const LIBRARY: [u32; 2] = [10, 0];
/// Ends the part of a descriptor's name that is the grid's name.
const NAME_SUFFIX: char = '\u{1e}';
/// Ends the type of a grid whose values are stored as binary16.
const HALF_SUFFIX: &str = "_HalfFloat";
