//! File formats, over `Write` and `Read` (with `Seek` where a format needs it), never a path.

pub mod csv;
pub mod exr;
pub mod npy;
pub mod png;
pub mod vdb;
pub mod vol;
