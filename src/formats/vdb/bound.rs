//! How large a grid can get, before it is made.

use super::codec::Encoder;
use super::topology::file_order;
use super::voxel::Voxel;

/// Bytes of a grid's parts in a file if every brick becomes a leaf. No grid of these bricks takes more in sum, besides
/// its name, metadata and transform.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct GridBound {
    /// Masks of all nodes, those of leaves included: exact.
    pub masks: u64,
    /// Values of the nodes above leaves, none of them compressible.
    pub entries: u64,
    /// Nodes above leaves: exact.
    pub nodes: u64,
    /// Buffers of leaves, all voxels active and none of them compressible.
    pub buffers: u64,
}

impl GridBound {
    /// Of bricks of voxels of type `T` with these origins, in file order.
    pub fn new<T: Voxel>(encoder: Encoder, origins: impl Iterator<Item = [i32; 3]>) -> GridBound {
        let mut bound = GridBound::default();
        let mut last = None;
        for origin in origins {
            let key = file_order(origin);
            // The twelve lowest bits number a leaf in its lower node, the fifteen above them that in its upper node.
            let [lower, upper] = [12, 27].map(|bits| last.is_none_or(|last| last >> bits != key >> bits));
            last = Some(key);
            bound.masks += 64;
            bound.buffers += GridBound::leaf::<T>(encoder);
            bound.nodes += u64::from(lower) + u64::from(upper);
            if lower {
                bound.masks += 2 * 512;
                bound.entries += encoder.largest_block::<T>(4096);
            }
            if upper {
                // With the origin in the root.
                bound.masks += 2 * 4096 + 12;
                bound.entries += encoder.largest_block::<T>(32768);
            }
        }
        bound
    }

    /// Bytes of one leaf's buffer, all voxels active and none of them compressible.
    pub fn leaf<T: Voxel>(encoder: Encoder) -> u64 {
        // A leaf's buffer repeats its mask.
        64 + encoder.largest_block::<T>(512)
    }

    /// The sum of all parts.
    pub fn bytes(&self) -> u64 {
        self.masks + self.entries + self.buffers
    }
}

#[cfg(test)]
mod tests {
    use super::super::VdbGridBuilder;
    use super::super::tests::{ENCODERS, bricks, build_with, file, grid_header, vectors};
    use super::*;

    fn assert_bounded<T: Voxel>(encoder: Encoder, origins: &[[i32; 3]], grid: &VdbGridBuilder<T>) {
        let bound = GridBound::new::<T>(encoder, origins.iter().copied());
        let empty = file(&[(&grid_header("a"), &VdbGridBuilder::<T>::with_encoder(encoder))]).len() as u64;
        let bytes = file(&[(&grid_header("a"), grid)]).len() as u64 - empty;
        // An empty grid's metadata is as long: all of it that depends on the content is binary.
        assert!(bytes <= bound.bytes(), "{encoder:?}: {bytes} bytes, bound {bound:?}");
        assert!(grid.encoded_bytes() <= bound.buffers);
    }

    #[test]
    fn no_grid_is_larger_than_its_bound() {
        let bricks = bricks();
        let origins: Vec<[i32; 3]> = bricks.iter().map(|brick| brick.0).collect();
        for encoder in ENCODERS {
            assert_bounded(encoder, &origins, &build_with(encoder, &bricks));
            assert_bounded(encoder, &origins, &build_with(encoder, &vectors(&bricks)));
        }
    }
}
