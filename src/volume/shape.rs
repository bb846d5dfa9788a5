//! What a tree is made of: leaves and tiles, their edges and boxes.

/// log2 of the edge in voxels of a leaf, of a lower node and of an upper node.
pub(crate) const LOG2_EDGE: [u32; 3] = [3, 7, 12];

/// A brick of 8^3 voxels with values of its own.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Leaf {
    /// Index of its first voxel, multiples of 8.
    pub origin: [i32; 3],
    /// Its active voxels: (x, y, z) is bit `8 y + z` of word x.
    pub mask: [u64; 8],
}

/// A cube of active voxels that share one value.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tile<T = f32> {
    /// Index of its first voxel, multiples of its edge.
    pub origin: [i32; 3],
    /// log2 of its edge in voxels: 3, 7 or 12.
    pub log2_edge: u32,
    /// The value of all its voxels.
    pub value: T,
}

/// What a grid holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Stats {
    /// Leaves, of 8^3 voxels.
    pub leaves: u64,
    /// Lower nodes, of 128^3 voxels.
    pub lower_nodes: u64,
    /// Upper nodes, of 4096^3 voxels.
    pub upper_nodes: u64,
    /// Active tiles of 8^3, 128^3 and 4096^3 voxels.
    pub tiles: [u64; 3],
    /// Active voxels, those in tiles included.
    pub active_voxels: u64,
    /// Smallest and largest index of an active voxel, inclusive; `None` for an empty grid.
    pub bounds: Option<[[i32; 3]; 2]>,
    /// Bytes that the tree's values, masks and pointers take in a program that has loaded it.
    pub memory_bytes: u64,
}

/// The first voxel of the cube of this edge that holds an index.
pub(crate) fn align(origin: [i32; 3], log2_edge: u32) -> [i32; 3] {
    origin.map(|c| (c >> log2_edge) << log2_edge)
}

/// The last voxel of a cube.
pub(crate) fn last_voxel(origin: [i32; 3], log2_edge: u32) -> [i32; 3] {
    origin.map(|c| c + ((1 << log2_edge) - 1))
}

/// Widens an inclusive box to hold another.
pub(crate) fn grow(bounds: &mut [[i32; 3]; 2], low: [i32; 3], high: [i32; 3]) {
    for axis in 0..3 {
        bounds[0][axis] = bounds[0][axis].min(low[axis]);
        bounds[1][axis] = bounds[1][axis].max(high[axis]);
    }
}

/// Smallest and largest index of an active voxel of a leaf.
pub(crate) fn active_box(leaf: &Leaf) -> Option<[[i32; 3]; 2]> {
    let x0 = leaf.mask.iter().zip(0..8).find(|(word, _)| **word != 0)?.1;
    let x1 = leaf.mask.iter().zip(0..8).rfind(|(word, _)| **word != 0)?.1;
    let rows = leaf.mask.iter().fold(0, |all, word| all | word);
    let (y0, y1) = (rows.trailing_zeros() / 8, 7 - rows.leading_zeros() / 8);
    let column = rows.to_le_bytes().iter().fold(0, |all, row| all | row);
    let (z0, z1) = (column.trailing_zeros(), 7 - column.leading_zeros());
    let at = |x: i32, y: u32, z: u32| {
        let [ox, oy, oz] = leaf.origin;
        [ox + x, oy + y.cast_signed(), oz + z.cast_signed()]
    };
    Some([at(x0, y0, z0), at(x1, y1, z1)])
}
