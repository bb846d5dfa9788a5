//! Files of our own writer, and files put together by hand from the description of the format.

use std::collections::BTreeMap;
use std::io::Cursor;

use super::super::tests::{ALL, Brick, bricks, build, file, grid_header, is_on, random};
use super::super::{Compression, Meta, Stats};
use super::*;

pub(super) fn open(bytes: &[u8]) -> VdbFile<Cursor<&[u8]>> {
    VdbFile::open(Cursor::new(bytes)).expect("valid headers")
}

fn float(bytes: &[u8], name: &str) -> Tree<f32> {
    match open(bytes).grid(name).expect("a grid").tree {
        AnyTree::Float(tree) => tree,
        other => panic!("{other:?}"),
    }
}

/// What a grid of bricks holds: voxels that are active, by index.
fn voxels(bricks: &[Brick]) -> BTreeMap<[i32; 3], f32> {
    let mut voxels = BTreeMap::new();
    for (origin, mask, values) in bricks {
        for (index, value) in (0..512_i32).zip(values) {
            let at = [origin[0] + index / 64, origin[1] + index / 8 % 8, origin[2] + index % 8];
            if is_on(mask, usize::try_from(index).expect("positive")) {
                voxels.insert(at, *value);
            }
        }
    }
    voxels
}

#[test]
fn own_files_hold_what_was_written() {
    let bricks = bricks();
    let expected = voxels(&bricks);
    for compression in ALL {
        let grid = build(compression, &bricks);
        let bytes = file(&[(&grid_header("density"), &grid)]);
        let tree = float(&bytes, "density");
        for (index, value) in &expected {
            assert_eq!(tree.value(*index), (*value, true), "{index:?}");
        }
        for (origin, mask, _) in &bricks {
            for index in (0..512).filter(|index| !is_on(mask, *index)) {
                let [x, y, z] =
                    [index / 64, index / 8 % 8, index % 8].map(|c| i32::try_from(c).expect("small"));
                assert_eq!(tree.value([origin[0] + x, origin[1] + y, origin[2] + z]), (0.0, false));
            }
        }
        for far in [[i32::MIN; 3], [i32::MAX; 3], [1000, 1000, 1000], [4095, -8, 0]] {
            assert_eq!(tree.value(far), (0.0, false));
        }
        assert!(Stats { memory_bytes: 0, ..tree.stats() } == Stats { memory_bytes: 0, ..grid.stats() });
        let listed: usize = tree.active_voxels().count();
        let tiles: u64 = tree.active_tiles().map(|tile| 1 << (3 * tile.log2_edge)).sum();
        assert_eq!(listed as u64 + tiles, grid.stats().active_voxels);
        for (index, value) in tree.active_voxels() {
            assert_eq!(expected.get(&index), Some(&value));
        }
        for tile in tree.active_tiles() {
            assert_eq!(expected.get(&tile.origin), Some(&tile.value));
        }
        assert!(tree.leaves().map(|leaf| leaf.origin).is_sorted_by_key(super::super::file_order));
        for (number, leaf) in tree.leaves().enumerate() {
            assert_eq!(tree.leaf_at(leaf.origin.map(|c| c + 7)), Some(number));
            assert_eq!(tree.leaf(number).map(|leaf| leaf.origin), Some(leaf.origin));
        }
    }
}
