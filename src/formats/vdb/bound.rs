//! How large a grid can get, before it is made.

use super::codec::Compression;
use super::topology::file_order;

/// Bytes of a grid's parts in a file if every brick becomes a leaf. No grid of these bricks takes more in sum, besides
/// its name, metadata and transform.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct GridBound {
    /// Masks of all nodes, those of leaves included: exact.
    pub masks: u64,
    /// Values of the nodes above leaves, none of them compressible.
    pub entries: u64,
    /// Buffers of leaves, all voxels active and none of them compressible.
    pub buffers: u64,
}

impl GridBound {
    /// Of bricks with these origins, in file order.
    pub fn new(compression: Compression, origins: impl Iterator<Item = [i32; 3]>) -> GridBound {
        let mut bound = GridBound::default();
        let mut last = None;
        for origin in origins {
            let key = file_order(origin);
            // The twelve lowest bits number a leaf in its lower node, the fifteen above them that in its upper node.
            let [lower, upper] = [12, 27].map(|bits| last.is_none_or(|last| last >> bits != key >> bits));
            last = Some(key);
            bound.masks += 64;
            bound.buffers += GridBound::leaf(compression);
            if lower {
                bound.masks += 2 * 512;
                bound.entries += compression.largest_block(4096);
            }
            if upper {
                // With the origin in the root.
                bound.masks += 2 * 4096 + 12;
                bound.entries += compression.largest_block(32768);
            }
        }
        bound
    }

    /// Bytes of one leaf's buffer, all voxels active and none of them compressible.
    pub fn leaf(compression: Compression) -> u64 {
        // A leaf's buffer repeats its mask.
        64 + compression.largest_block(512)
    }

    /// The sum of all parts.
    pub fn bytes(&self) -> u64 {
        self.masks + self.entries + self.buffers
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::{ALL, bricks, build, file, grid_header};
    use super::*;

    #[test]
    fn no_grid_is_larger_than_its_bound() {
        for compression in ALL {
            let bricks = bricks();
            let bound = GridBound::new(compression, bricks.iter().map(|brick| brick.0));
            let grid = build(compression, &bricks);
            let empty = file(&[(&grid_header("a"), &build(compression, &[]))]).len() as u64;
            let bytes = file(&[(&grid_header("a"), &grid)]).len() as u64 - empty;
            // An empty grid's metadata is as long: all of it that depends on the content is binary.
            assert!(bytes <= bound.bytes(), "{compression:?}: {bytes} bytes, bound {bound:?}");
            assert!(grid.encoded_bytes() <= bound.buffers);
        }
    }
}
