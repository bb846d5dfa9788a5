//! Why a file could not be read.

use std::io;

/// Why a file, or a grid of it, could not be read.
#[derive(Debug, thiserror::Error)]
pub enum VdbReadError {
    /// The input failed.
    #[error(transparent)]
    Io(#[from] io::Error),
    /// The first bytes are not those of a VDB file.
    #[error("not a VDB file")]
    Magic,
    /// The file's version is not among those understood.
    #[error("VDB file version {0} is not supported (versions 222 to 225 are)")]
    Version(u32),
    /// The file ends inside something it announces, or a grid does.
    #[error("truncated VDB file: {length} bytes at byte {offset} reach beyond the end")]
    Truncated {
        /// Where reading was.
        offset: u64,
        /// How many bytes were to follow.
        length: u64,
    },
    /// Something makes no sense.
    #[error("invalid VDB file: {what} at byte {offset}")]
    Invalid {
        /// What is wrong.
        what: &'static str,
        /// Where reading was.
        offset: u64,
    },
    /// Something legal that is not read.
    #[error("{what} at byte {offset} is not supported")]
    Unsupported {
        /// What it is.
        what: &'static str,
        /// Where it is.
        offset: u64,
    },
    /// The file has no grid of this name.
    #[error("there is no grid {0:?} in the file")]
    NoGrid(String),
    /// The file has no offsets and a grid that cannot be read; where those behind it begin is not known.
    #[error("grid {0:?} comes after a grid that is not supported, in a file without offsets")]
    OutOfReach(String),
    /// A grid's values are of a type that is not read.
    #[error("grid {grid:?} has the type {type_name}, which is not supported")]
    Type {
        /// The grid's name.
        grid: String,
        /// The type in the file.
        type_name: String,
    },
    /// A grid's transform is of a type that is not known, so that what follows it cannot be found.
    #[error("grid {grid:?} has the map {type_name:?}, which is not supported")]
    Map {
        /// The grid's name.
        grid: String,
        /// The map's type in the file.
        type_name: String,
    },
    /// A grid takes more memory than it may.
    #[error("grid {grid:?} takes {needed} bytes of memory, {limit} are allowed")]
    Memory {
        /// The grid's name.
        grid: String,
        /// Bytes of its tree, of which its leaves' values are those that were asked for.
        needed: u64,
        /// Bytes that it may take.
        limit: u64,
    },
}

/// There is no room for a list that grows.
pub(super) fn no_memory() -> VdbReadError {
    io::Error::from(io::ErrorKind::OutOfMemory).into()
}

/// What is wrong with bytes whose place in the file the code at hand does not know.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Fault {
    Invalid(&'static str),
    Unsupported(&'static str),
}

impl Fault {
    pub(super) fn at(self, offset: u64) -> VdbReadError {
        match self {
            Self::Invalid(what) => VdbReadError::Invalid { what, offset },
            Self::Unsupported(what) => VdbReadError::Unsupported { what, offset },
        }
    }
}
