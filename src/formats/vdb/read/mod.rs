//! Reading files of any program.
//!
//! A [`VdbFile`] lists its grids from their headers; each grid is read when it is asked for, its leaves decoded on all
//! threads of the current `rayon` pool. What is read: versions 222 to 225, with and without offsets; trees of truth values,
//! of numbers (`int32`, `int64`, `float`, `double`) and of vectors of three (`vec3i`, `vec3s`, `vec3d`); values stored in
//! full or as binary16, plain, as zlib streams, or as Blosc frames with LZ4, all of them or active ones only; trees that
//! grids share. Other grids, such as points, are listed and refused by name.
//!
//! [`VdbFile::grid_part`] decodes only those leaves that lie in a part of index space, [`VdbFile::paged`] those that are asked
//! for, again and again.
//!
//! Any input gives a result or an error. Nothing is allocated that the file cannot hold: what can be decoded from its
//! bytes bounds every buffer, and [`VdbFile::with_memory_limit`] a grid as a whole.

#![cfg_attr(
    not(test),
    deny(
        clippy::arithmetic_side_effects,
        clippy::expect_used,
        clippy::indexing_slicing,
        clippy::panic,
        clippy::string_slice,
        clippy::unreachable,
        clippy::unwrap_used
    )
)]

mod block;
mod blosc;
mod cursor;
mod error;
mod header;
mod leaves;
mod paged;
mod topology;
mod value;

#[cfg(test)]
mod tests;

use std::io::{Read, Seek};

use cursor::Cursor;
pub use error::VdbReadError;
use header::Record;
pub use header::{FileInfo, GridInfo, Map};
use leaves::{Bits, Buffers};
pub use paged::PagedGrid;
use topology::Allowance;
use value::Stored;

use crate::volume::{Part, PartialTree, Tree};

/// Lists a file's grids.
///
/// # Errors
/// As [`VdbFile::open`].
pub fn read_info(input: &mut (impl Read + Seek)) -> Result<FileInfo, VdbReadError> {
    Ok(VdbFile::open(input)?.info)
}

/// What the headers of a file say that may be damaged.
#[derive(Debug)]
pub struct Listing {
    /// What was read of them.
    pub info: FileInfo,
    /// How many of the grids, from the first, have their whole extent in the file. At most one more is listed.
    pub whole: usize,
    /// Why the others do not, or could not be found.
    pub error: Option<VdbReadError>,
}

/// Lists a file's grids as far as it can be read. What a grid without offsets takes in memory, to be passed over, is limited.
///
/// # Errors
/// Where the file's own header cannot be read.
pub fn list_grids(input: impl Read + Seek, memory_limit: u64) -> Result<Listing, VdbReadError> {
    let (file, error) = VdbFile::open_broken(input, memory_limit)?;
    Ok(Listing { info: file.info, whole: file.records.len(), error })
}

/// A file whose headers have been read.
pub struct VdbFile<R> {
    cursor: Cursor<R>,
    info: FileInfo,
    records: Vec<Record>,
    memory_limit: u64,
}

/// A grid: what the file says of it, and its tree.
#[derive(Debug, Clone)]
pub struct Grid {
    /// What the file says of it.
    pub info: GridInfo,
    /// Its values.
    pub tree: AnyTree,
}

/// A grid of which a part was read.
#[derive(Debug, Clone)]
pub struct PartialGrid {
    /// What the file says of it.
    pub info: GridInfo,
    /// The values that were read.
    pub tree: AnyPartialTree,
}

impl From<Grid> for PartialGrid {
    fn from(Grid { info, tree }: Grid) -> Self {
        Self { info, tree: tree.into() }
    }
}

macro_rules! any_tree {
    ($($kind:ident($type:ty) $name:literal;)*) => {
        /// A tree of any of the types that are read.
        #[derive(Debug, Clone)]
        pub enum AnyTree {$(
            #[doc = concat!("`", $name, "`.")]
            $kind(Tree<$type>),
        )*}

        /// A part of a tree of any of the types that are read.
        #[derive(Debug, Clone)]
        pub enum AnyPartialTree {$(
            #[doc = concat!("`", $name, "`.")]
            $kind(PartialTree<$type>),
        )*}

        impl From<AnyTree> for AnyPartialTree {
            fn from(tree: AnyTree) -> Self {
                match tree {
                    $(AnyTree::$kind(tree) => Self::$kind(tree.into()),)*
                }
            }
        }
    };
}
any_tree! {
    Bool(bool) "Tree_bool_5_4_3";
    Int32(i32) "Tree_int32_5_4_3";
    Int64(i64) "Tree_int64_5_4_3";
    Float(f32) "Tree_float_5_4_3";
    Double(f64) "Tree_double_5_4_3";
    Vec3i([i32; 3]) "Tree_vec3i_5_4_3";
    Vec3s([f32; 3]) "Tree_vec3s_5_4_3";
    Vec3d([f64; 3]) "Tree_vec3d_5_4_3";
}

impl<R: Read + Seek> VdbFile<R> {
    /// Reads the headers of a file and its grids, by jumping from one grid to the next. A file without offsets is read
    /// through, but not decoded.
    ///
    /// Metadata entries of types that begin with `__`, which only serve loading, are left out.
    ///
    /// # Errors
    /// See [`VdbReadError`].
    pub fn open(input: R) -> Result<Self, VdbReadError> {
        Self::open_within(input, u64::MAX)
    }

    /// As [`VdbFile::open`] and [`VdbFile::with_memory_limit`]; the limit holds from the start, also while a file without
    /// offsets is read through.
    ///
    /// # Errors
    /// See [`VdbReadError`].
    pub fn open_within(input: R, memory_limit: u64) -> Result<Self, VdbReadError> {
        let (file, error) = Self::open_broken(input, memory_limit)?;
        error.map_or(Ok(file), Err)
    }

    /// What can be said of a file whose headers cannot be read to its end, and why not.
    fn open_broken(input: R, memory_limit: u64) -> Result<(Self, Option<VdbReadError>), VdbReadError> {
        let mut cursor = Cursor::new(input)?;
        let (info, has_offsets, count) = header::file_header(&mut cursor)?;
        let mut file = Self { cursor, info, records: vec![], memory_limit };
        let mut error = None;
        for _ in 0..count {
            match file.list_next(has_offsets) {
                Ok(true) => (),
                Ok(false) => break,
                Err(reason) => {
                    error = Some(reason);
                    break;
                }
            }
        }
        file.info.out_of_reach = usize::try_from(count).unwrap_or(0).saturating_sub(file.info.grids.len());
        Ok((file, error))
    }

    /// Lists the grid whose descriptor is at the cursor, and moves behind it; false where that cannot be done. A grid that is
    /// cut short has no record.
    fn list_next(&mut self, has_offsets: bool) -> Result<bool, VdbReadError> {
        let (info, mut record) = header::grid_header(&mut self.cursor, has_offsets)?;
        self.info.grids.push(info.clone());
        let mut readable = true;
        if has_offsets {
            self.cursor.jump(i64::try_from(record.end).map_err(|_| self.cursor.invalid("offset"))?)?;
        } else {
            let passed = self.pass(&info, &record);
            record.end = if passed.is_ok() { self.cursor.position() } else { self.cursor.end() };
            if let Some(listed) = self.info.grids.last_mut() {
                listed.bytes = record.end.saturating_sub(info.bytes);
            }
            readable = passed?;
        }
        self.records.push(record);
        Ok(readable)
    }

    /// Limits the bytes that a grid may take in memory. The limit is checked node by node, and before values
    /// are decoded.
    #[must_use]
    pub fn with_memory_limit(mut self, bytes: u64) -> Self {
        self.memory_limit = bytes;
        self
    }

    /// What the file says of itself and its grids.
    pub fn info(&self) -> &FileInfo {
        &self.info
    }

    /// Reads the first grid of this name.
    ///
    /// # Errors
    /// See [`VdbReadError`]. After an error other grids can still be read.
    pub fn grid(&mut self, name: &str) -> Result<Grid, VdbReadError> {
        self.grid_at(self.number(name)?)
    }

    /// Reads the first grid of this name, but of its leaves only those in a part of index space. What lies beyond is not
    /// decoded, nor checked, and takes no memory but for its topology.
    ///
    /// # Errors
    /// As [`VdbFile::grid`].
    pub fn grid_part(&mut self, name: &str, part: &Part) -> Result<PartialGrid, VdbReadError> {
        self.grid_part_at(self.number(name)?, part)
    }

    fn number(&self, name: &str) -> Result<usize, VdbReadError> {
        let number = self.info.grids.iter().position(|grid| grid.name == name);
        let missing = || match self.info.out_of_reach {
            0 => VdbReadError::NoGrid(name.to_owned()),
            _ => VdbReadError::OutOfReach(name.to_owned()),
        };
        number.ok_or_else(missing)
    }

    /// Reads the grid of this number in [`FileInfo::grids`].
    ///
    /// # Errors
    /// As [`VdbFile::grid`].
    pub fn grid_at(&mut self, number: usize) -> Result<Grid, VdbReadError> {
        self.read(number, None)
    }

    /// Reads a part of the grid of this number, as [`VdbFile::grid_part`] does.
    ///
    /// # Errors
    /// As [`VdbFile::grid`].
    pub fn grid_part_at(&mut self, number: usize, part: &Part) -> Result<PartialGrid, VdbReadError> {
        self.read(number, Some(part)).map(PartialGrid::from)
    }

    fn read(&mut self, number: usize, part: Option<&Part>) -> Result<Grid, VdbReadError> {
        let whole = self.cursor.end();
        let (source, record) = self.seek(number)?;
        let tree = self.tree(&source.name, &source.type_name, &record, part);
        self.cursor.set_end(whole);
        let missing = || VdbReadError::NoGrid(format!("number {number}"));
        Ok(Grid { info: self.info.grids.get(number).cloned().ok_or_else(missing)?, tree: tree? })
    }

    /// Moves to the topology of a grid, or of that which shares its tree with it; gives what the file says of that one. What
    /// is read then has to end where the grid does.
    fn seek(&mut self, number: usize) -> Result<(GridInfo, Record), VdbReadError> {
        let missing = || VdbReadError::NoGrid(format!("number {number}"));
        let shared = self.info.grids.get(number).map(|info| info.instance_of.clone()).ok_or_else(missing)?;
        let owner = if shared.is_empty() { number } else { self.owner(&shared)? };
        let (Some(source), Some(record)) = (self.info.grids.get(owner), self.records.get(owner)) else {
            return Err(missing());
        };
        if !record.known_map {
            return Err(VdbReadError::Map {
                grid: source.name.clone(),
                type_name: source.map.type_name.clone(),
            });
        }
        let (source, record) = (source.clone(), record.clone());
        self.cursor.back_to(record.topology)?;
        self.cursor.set_end(record.end);
        Ok((source, record))
    }

    /// The grid whose tree others share.
    fn owner(&self, unique_name: &str) -> Result<usize, VdbReadError> {
        let of_name = |record: &Record| record.unique_name == unique_name;
        let owners = self.records.iter().zip(&self.info.grids).enumerate();
        owners
            .filter(|(_, (record, info))| of_name(record) && info.instance_of.is_empty())
            .map(|(number, _)| number)
            .next()
            .ok_or_else(|| VdbReadError::NoGrid(unique_name.to_owned()))
    }

    /// Reads the tree at the cursor.
    fn tree(
        &mut self,
        grid: &str,
        type_name: &str,
        record: &Record,
        part: Option<&Part>,
    ) -> Result<AnyTree, VdbReadError> {
        Ok(match type_name {
            "Tree_bool_5_4_3" => {
                let allowance = Allowance { grid, limit: self.memory_limit };
                let most = part.map_or(usize::MAX, Part::most_leaves);
                let (tree, _) = topology::read(&mut self.cursor, record.flags, record.half, allowance, most)?;
                AnyTree::Bool(self.values(grid, tree, &Bits, part)?)
            }
            "Tree_int32_5_4_3" => AnyTree::Int32(self.tree_of(grid, record, part)?),
            "Tree_int64_5_4_3" => AnyTree::Int64(self.tree_of(grid, record, part)?),
            "Tree_float_5_4_3" => AnyTree::Float(self.tree_of(grid, record, part)?),
            "Tree_double_5_4_3" => AnyTree::Double(self.tree_of(grid, record, part)?),
            "Tree_vec3i_5_4_3" => AnyTree::Vec3i(self.tree_of(grid, record, part)?),
            "Tree_vec3s_5_4_3" => AnyTree::Vec3s(self.tree_of(grid, record, part)?),
            "Tree_vec3d_5_4_3" => AnyTree::Vec3d(self.tree_of(grid, record, part)?),
            _ => return Err(VdbReadError::Type { grid: grid.to_owned(), type_name: type_name.to_owned() }),
        })
    }

    fn tree_of<T: Stored>(
        &mut self,
        grid: &str,
        record: &Record,
        part: Option<&Part>,
    ) -> Result<Tree<T>, VdbReadError> {
        let allowance = Allowance { grid, limit: self.memory_limit };
        let most = part.map_or(usize::MAX, Part::most_leaves);
        let (tree, layout) = topology::read(&mut self.cursor, record.flags, record.half, allowance, most)?;
        self.values(grid, tree, &layout, part)
    }

    fn values<T: Stored>(
        &mut self,
        grid: &str,
        mut tree: Tree<T>,
        buffers: &impl Buffers<T>,
        part: Option<&Part>,
    ) -> Result<Tree<T>, VdbReadError> {
        let taken = part.map(|part| part.leaves_of(&tree)).filter(|taken| taken.contains(&false));
        let count =
            taken.as_ref().map_or(tree.leaf_count(), |taken| taken.iter().filter(|taken| **taken).count());
        Allowance { grid, limit: self.memory_limit }.check(tree.memory_bytes_with(count))?;
        if let Some(taken) = taken {
            let (pages, slots) = leaves::read_some(&mut self.cursor, buffers, &tree.leaves, &taken)?;
            (tree.pages, tree.slots) = (pages, Some(slots));
        } else {
            tree.pages = leaves::read(&mut self.cursor, buffers, &tree.leaves)?;
        }
        Ok(tree)
    }

    /// Moves behind the grid whose topology is at the cursor, which takes reading it; false where its type is unknown.
    fn pass(&mut self, info: &GridInfo, record: &Record) -> Result<bool, VdbReadError> {
        if !info.instance_of.is_empty() {
            return Ok(record.known_map);
        }
        if !record.known_map {
            return Ok(false);
        }
        match info.type_name.as_str() {
            "Tree_bool_5_4_3" => {
                let allowance = Allowance { grid: &info.name, limit: self.memory_limit };
                let (tree, _) =
                    topology::read::<bool, R>(&mut self.cursor, record.flags, record.half, allowance, 0)?;
                leaves::skip(&mut self.cursor, &Bits, &tree.leaves)?;
            }
            "Tree_int32_5_4_3" => self.pass_of::<i32>(&info.name, record)?,
            "Tree_int64_5_4_3" => self.pass_of::<i64>(&info.name, record)?,
            "Tree_float_5_4_3" => self.pass_of::<f32>(&info.name, record)?,
            "Tree_double_5_4_3" => self.pass_of::<f64>(&info.name, record)?,
            "Tree_vec3i_5_4_3" => self.pass_of::<[i32; 3]>(&info.name, record)?,
            "Tree_vec3s_5_4_3" => self.pass_of::<[f32; 3]>(&info.name, record)?,
            "Tree_vec3d_5_4_3" => self.pass_of::<[f64; 3]>(&info.name, record)?,
            _ => return Ok(false),
        }
        Ok(true)
    }

    fn pass_of<T: Stored>(&mut self, grid: &str, record: &Record) -> Result<(), VdbReadError> {
        let allowance = Allowance { grid, limit: self.memory_limit };
        let (tree, layout) =
            topology::read::<T, R>(&mut self.cursor, record.flags, record.half, allowance, 0)?;
        leaves::skip(&mut self.cursor, &layout, &tree.leaves)
    }
}
