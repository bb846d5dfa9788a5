//! File formats, over `Write` and `Read` (with `Seek` where a format needs it), never a path.

pub mod vdb;
