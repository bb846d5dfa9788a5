//! Reading files of any program.
//!
//! A [`VdbFile`] lists its grids from their headers; each grid is read when it is asked for, its leaves decoded on all
//! threads of the current `rayon` pool. What is read: versions 222 to 225, with and without offsets; trees of truth values,
//! of numbers (`int32`, `int64`, `float`, `double`) and of vectors of three (`vec3i`, `vec3s`, `vec3d`); values stored in
//! full or as binary16, plain, as zlib streams, or as Blosc frames with LZ4, all of them or active ones only; trees that
//! grids share. Other grids, such as points, are listed and refused by name.
//!
//! Any input gives a result or an error. Nothing is allocated that the file cannot hold: what can be decoded from its
//! bytes bounds every buffer, and [`VdbFile::with_memory_limit`] a grid as a whole.

mod block;
mod blosc;
mod cursor;
mod error;
mod header;
mod leaves;
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
use value::Stored;

use crate::volume::Tree;

/// Lists a file's grids.
///
/// # Errors
/// As [`VdbFile::open`].
pub fn read_info(input: &mut (impl Read + Seek)) -> Result<FileInfo, VdbReadError> {
    Ok(VdbFile::open(input)?.info)
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

/// A tree of any of the types that are read.
#[derive(Debug, Clone)]
pub enum AnyTree {
    /// `Tree_bool_5_4_3`.
    Bool(Tree<bool>),
    /// `Tree_int32_5_4_3`.
    Int32(Tree<i32>),
    /// `Tree_int64_5_4_3`.
    Int64(Tree<i64>),
    /// `Tree_float_5_4_3`.
    Float(Tree<f32>),
    /// `Tree_double_5_4_3`.
    Double(Tree<f64>),
    /// `Tree_vec3i_5_4_3`.
    Vec3i(Tree<[i32; 3]>),
    /// `Tree_vec3s_5_4_3`.
    Vec3s(Tree<[f32; 3]>),
    /// `Tree_vec3d_5_4_3`.
    Vec3d(Tree<[f64; 3]>),
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
        let mut cursor = Cursor::new(input)?;
        let (info, has_offsets, count) = header::file_header(&mut cursor)?;
        let mut file = Self { cursor, info, records: vec![], memory_limit: u64::MAX };
        for number in 0..count {
            let (mut info, mut record) = header::grid_header(&mut file.cursor, has_offsets)?;
            let mut readable = true;
            if has_offsets {
                file.cursor.jump(i64::try_from(record.end).map_err(|_| file.cursor.invalid("offset"))?)?;
            } else {
                readable = file.pass(&info, &record)?;
                record.end = file.cursor.position();
                info.bytes = record.end - info.bytes;
            }
            file.info.grids.push(info);
            file.records.push(record);
            if !readable {
                file.info.out_of_reach = usize::try_from(count - number - 1).unwrap_or(0);
                break;
            }
        }
        Ok(file)
    }

    /// Limits the bytes that a grid may take in memory. The limit is checked before values are decoded.
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
        let number = self.info.grids.iter().position(|grid| grid.name == name);
        let missing = || match self.info.out_of_reach {
            0 => VdbReadError::NoGrid(name.to_owned()),
            _ => VdbReadError::OutOfReach(name.to_owned()),
        };
        self.grid_at(number.ok_or_else(missing)?)
    }

    /// Reads the grid of this number in [`FileInfo::grids`].
    ///
    /// # Errors
    /// As [`VdbFile::grid`].
    pub fn grid_at(&mut self, number: usize) -> Result<Grid, VdbReadError> {
        let missing = || VdbReadError::NoGrid(format!("number {number}"));
        let info = self.info.grids.get(number).cloned().ok_or_else(missing)?;
        let owner = if info.instance_of.is_empty() { number } else { self.owner(&info.instance_of)? };
        let (Some(source), Some(record)) = (self.info.grids.get(owner), self.records.get(owner)) else {
            return Err(missing());
        };
        let (name, type_name) = (source.name.clone(), source.type_name.clone());
        if !record.known_map {
            return Err(VdbReadError::Map { grid: name, type_name: source.map.type_name.clone() });
        }
        let record = record.clone();
        self.cursor.back_to(record.topology)?;
        let whole = self.cursor.end();
        self.cursor.set_end(record.end);
        let tree = self.tree(&name, &type_name, &record);
        self.cursor.set_end(whole);
        Ok(Grid { info, tree: tree? })
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
    fn tree(&mut self, grid: &str, type_name: &str, record: &Record) -> Result<AnyTree, VdbReadError> {
        Ok(match type_name {
            "Tree_bool_5_4_3" => {
                let (tree, _) = topology::read(&mut self.cursor, record.flags, record.half)?;
                AnyTree::Bool(self.values(grid, tree, &Bits)?)
            }
            "Tree_int32_5_4_3" => AnyTree::Int32(self.tree_of(grid, record)?),
            "Tree_int64_5_4_3" => AnyTree::Int64(self.tree_of(grid, record)?),
            "Tree_float_5_4_3" => AnyTree::Float(self.tree_of(grid, record)?),
            "Tree_double_5_4_3" => AnyTree::Double(self.tree_of(grid, record)?),
            "Tree_vec3i_5_4_3" => AnyTree::Vec3i(self.tree_of(grid, record)?),
            "Tree_vec3s_5_4_3" => AnyTree::Vec3s(self.tree_of(grid, record)?),
            "Tree_vec3d_5_4_3" => AnyTree::Vec3d(self.tree_of(grid, record)?),
            _ => return Err(VdbReadError::Type { grid: grid.to_owned(), type_name: type_name.to_owned() }),
        })
    }

    fn tree_of<T: Stored>(&mut self, grid: &str, record: &Record) -> Result<Tree<T>, VdbReadError> {
        let (tree, layout) = topology::read(&mut self.cursor, record.flags, record.half)?;
        self.values(grid, tree, &layout)
    }

    fn values<T: Stored>(
        &mut self,
        grid: &str,
        mut tree: Tree<T>,
        buffers: &impl Buffers<T>,
    ) -> Result<Tree<T>, VdbReadError> {
        let (needed, limit) = (tree.memory_bytes(), self.memory_limit);
        if needed > limit {
            return Err(VdbReadError::Memory { grid: grid.to_owned(), needed, limit });
        }
        tree.pages = leaves::read(&mut self.cursor, buffers, &tree.leaves)?;
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
                let (tree, _) = topology::read::<bool, R>(&mut self.cursor, record.flags, record.half)?;
                leaves::skip(&mut self.cursor, &Bits, &tree.leaves)?;
            }
            "Tree_int32_5_4_3" => self.pass_of::<i32>(record)?,
            "Tree_int64_5_4_3" => self.pass_of::<i64>(record)?,
            "Tree_float_5_4_3" => self.pass_of::<f32>(record)?,
            "Tree_double_5_4_3" => self.pass_of::<f64>(record)?,
            "Tree_vec3i_5_4_3" => self.pass_of::<[i32; 3]>(record)?,
            "Tree_vec3s_5_4_3" => self.pass_of::<[f32; 3]>(record)?,
            "Tree_vec3d_5_4_3" => self.pass_of::<[f64; 3]>(record)?,
            _ => return Ok(false),
        }
        Ok(true)
    }

    fn pass_of<T: Stored>(&mut self, record: &Record) -> Result<(), VdbReadError> {
        let (tree, layout) = topology::read::<T, R>(&mut self.cursor, record.flags, record.half)?;
        leaves::skip(&mut self.cursor, &layout, &tree.leaves)
    }
}
