//! Files of our own writer, and files put together by hand from the description of the format.

use std::collections::BTreeMap;
use std::io::Cursor;

use super::super::tests::{ALL, Brick, bricks, build, file, grid_header, is_on};
use super::super::{Compression, Encoder, Stats, VdbGridBuilder};
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

/// Leaves and tiles in all octants.
fn few() -> Vec<Brick> {
    let near = |brick: &Brick| brick.0.iter().all(|c| (-48..48).contains(c));
    let mut few: Vec<Brick> = bricks().into_iter().filter(near).step_by(17).collect();
    // A leaf that is active throughout and compresses well.
    few.extend(bricks().into_iter().filter(|brick| brick.0 == [4104, -8, 0]));
    assert!(few.len() > 100);
    few
}

/// Three grids of a few bricks each, one of every compression.
fn three() -> Vec<u8> {
    let grids = ALL.map(|compression| build(compression, &few()));
    let [a, b, c] = ["a", "b", "c"].map(grid_header);
    file(&[(&a, &grids[0]), (&b, &grids[1]), (&c, &grids[2])])
}

fn find(bytes: &[u8], text: &[u8]) -> Vec<usize> {
    (0..bytes.len()).filter(|at| bytes[*at..].starts_with(text)).collect()
}

fn assert_equal(a: &Tree<f32>, b: &Tree<f32>) {
    assert_eq!(a.stats(), b.stats());
    assert!(a.leaves().zip(b.leaves()).all(|(a, b)| a.origin == b.origin && a.values == b.values));
    assert!(a.active_tiles().eq(b.active_tiles()));
}

#[test]
fn files_without_offsets_are_read_through() {
    let bytes = three();
    let mut plain = bytes.clone();
    plain[20] = 0;
    for at in find(&bytes, b"Tree_float_5_4_3") {
        plain[at + 20..at + 44].fill(0);
    }
    let names = ["a", "b", "c"];
    assert_eq!(open(&plain).info(), open(&bytes).info());
    for name in names {
        assert_equal(&float(&plain, name), &float(&bytes, name));
    }
    // A grid of an unknown type hides those behind it.
    let second = find(&plain, b"Tree_float_5_4_3")[1];
    plain[second + 5..second + 10].copy_from_slice(b"point");
    assert_equal(&float(&plain, "a"), &float(&bytes, "a"));
    assert_eq!((open(&plain).info().grids.len(), open(&plain).info().out_of_reach), (2, 1));
    assert!(matches!(open(&plain).grid("b"), Err(VdbReadError::Type { .. })));
    assert!(matches!(open(&plain).grid("c"), Err(VdbReadError::OutOfReach(_))));
}

#[test]
fn one_unknown_grid_spoils_no_other() {
    let original = three();
    let mut bytes = original.clone();
    let second = find(&bytes, b"Tree_float_5_4_3")[1];
    bytes[second + 5..second + 10].copy_from_slice(b"point");
    let error = open(&bytes).grid("b").expect_err("unknown").to_string();
    assert_eq!(error, "grid \"b\" has the type Tree_point_5_4_3, which is not supported");
    for name in ["a", "c"] {
        assert_equal(&float(&bytes, name), &float(&original, name));
    }
    assert!(matches!(open(&bytes).grid("d"), Err(VdbReadError::NoGrid(name)) if name == "d"));

    let maps = find(&original, b"UniformScaleTranslateMap");
    let mut bytes = original.clone();
    bytes[maps[0]..maps[0] + 7].copy_from_slice(b"Unknown");
    assert!(matches!(open(&bytes).grid("a"), Err(VdbReadError::Map { .. })));
    assert_equal(&float(&bytes, "b"), &float(&original, "b"));
}

#[test]
fn versions_of_one_layout_read_alike() {
    let bytes = three();
    for version in 222..=225 {
        let mut other = bytes.clone();
        other[8] = version;
        assert_equal(&float(&other, "c"), &float(&bytes, "c"));
    }
}

#[test]
fn memory_is_limited_before_values_are_read() {
    let bytes = three();
    let needed = float(&bytes, "a").memory_bytes();
    let grid = |limit| open(&bytes).with_memory_limit(limit).grid("a");
    assert!(grid(needed).is_ok());
    assert!(matches!(grid(needed - 1), Err(VdbReadError::Memory { needed: n, .. }) if n == needed));
}

/// A file whose nodes take some twenty times as many bytes in memory: lower nodes of one value, all of it stored.
fn nodes_that_compress_well(has_offsets: bool) -> Vec<u8> {
    const LOWERS: usize = 1000;
    let mut bytes = file(&[(&grid_header("a"), &VdbGridBuilder::new(Compression::Zip))]);
    let topology = open(&bytes).records[0].topology;
    bytes.truncate(usize::try_from(topology).expect("small"));
    let encoder = Encoder::new(Compression::Zip);
    let node = |children: &[u64], active: &[u64]| {
        let mut node: Vec<u8> = [children, active].concat().into_iter().flat_map(u64::to_le_bytes).collect();
        encoder.encode_block(active, &vec![1.0_f32; 64 * active.len()], &mut node);
        node
    };
    let mut children = [0; 512];
    children[..LOWERS / 64].fill(u64::MAX);
    children[LOWERS / 64] = (1 << (LOWERS % 64)) - 1;
    let (upper, lower) = (node(&children, &[0; 512]), node(&[0; 64], &[u64::MAX; 64]));
    // Buffers, background, tiles and children of the root, the child's origin.
    bytes.extend([1_u32, 0, 0, 1, 0, 0, 0].map(u32::to_le_bytes).as_flattened());
    bytes.extend(upper);
    bytes.extend(lower.repeat(LOWERS));
    let offsets = find(&bytes, b"Tree_float_5_4_3")[0] + 20;
    if has_offsets {
        let end = bytes.len() as u64;
        bytes[offsets + 16..offsets + 24].copy_from_slice(&end.to_le_bytes());
    } else {
        bytes[20] = 0;
        bytes[offsets..offsets + 24].fill(0);
    }
    bytes
}

#[test]
fn memory_is_limited_while_nodes_are_read() {
    const LIMIT: u64 = 1 << 20;
    let bytes = nodes_that_compress_well(true);
    // Those behind the limit are counted, and not kept.
    let all = float(&bytes, "a").memory_bytes();
    assert!(all > 10 * bytes.len() as u64 && all > 10 * LIMIT);
    let check = |error: Option<VdbReadError>| match error {
        Some(VdbReadError::Memory { grid, needed, limit: LIMIT }) => {
            assert_eq!((grid.as_str(), needed), ("a", all));
        }
        other => panic!("{other:?}"),
    };
    check(open(&bytes).with_memory_limit(LIMIT).grid("a").err());
    let nothing = Part::around([]);
    check(open(&bytes).with_memory_limit(LIMIT).grid_part("a", &nothing).err());
    let bytes = nodes_that_compress_well(false);
    assert!(VdbFile::open(Cursor::new(&bytes)).is_ok());
    check(VdbFile::open_within(Cursor::new(&bytes), LIMIT).err());
}

#[test]
fn leaves_follow_the_sorted_root() {
    let state_of = |x: i32| {
        let mut mask = [0; 8];
        mask[3] = 5;
        ([x, 0, 0], mask, [if x < 0 { 1.0 } else { 2.0 }; 512])
    };
    let bricks = [state_of(-8), state_of(0)];
    let original = file(&[(&grid_header("a"), &build(Compression::None, &bricks))]);
    // Each child of the root takes its origin, and an upper and a lower node of masks and a block that is stored whole,
    // and one leaf's mask.
    let length = 12 + (8192 + 1 + 4 * 32768) + (1024 + 1 + 4 * 4096) + 64;
    let origin = [-4096_i32, 0, 0].map(i32::to_le_bytes);
    let at = find(&original, origin.as_flattened())[0];
    let mut swapped = original.clone();
    swapped[at..at + 2 * length].rotate_left(length);
    assert!(swapped != original);
    assert_equal(&float(&swapped, "a"), &float(&original, "a"));
    assert_eq!(float(&swapped, "a").value([-5, 0, 0]), (1.0, true));
}

#[test]
fn damage_is_named() {
    let bytes = file(&[(&grid_header("a"), &build(Compression::Zip, &few()))]);
    let expected = float(&bytes, "a");
    // The mask that stands before the last leaf's values, the second time after the topology.
    let mask = expected.leaves().last().expect("leaves").mask.map(u64::to_le_bytes);
    let at = *find(&bytes, mask.as_flattened()).last().expect("the mask");
    let fails = |at: usize, value: u8| {
        let mut bytes = bytes.clone();
        bytes[at] = value;
        open(&bytes).grid("a").expect_err("damaged").to_string()
    };
    assert!(
        fails(at, bytes[at] ^ 1)
            .starts_with("invalid VDB file: leaf whose mask is not that of the topology at")
    );
    assert!(fails(at + 64, 7).starts_with("invalid VDB file: code of a value block at byte"));
    assert!(fails(at + 72, 1).starts_with("invalid VDB file: size of a payload at byte"));
    assert!(fails(at + 80, 0xff).starts_with("invalid VDB file: zlib stream at byte"));
}

/// A part of a grid, read alone.
fn part(bytes: &[u8], name: &str, part: &Part) -> PartialTree<f32> {
    match open(bytes).grid_part(name, part).expect("a grid").tree {
        AnyPartialTree::Float(tree) => tree,
        other => panic!("{other:?}"),
    }
}

#[test]
fn a_part_is_that_of_the_whole_whatever_the_compression() {
    // More than a page of leaves, in several upper nodes.
    let grids = ALL.map(|compression| build(compression, &bricks()));
    let [a, b, c] = ["a", "b", "c"].map(grid_header);
    let bytes = file(&[(&a, &grids[0]), (&b, &grids[1]), (&c, &grids[2])]);
    let mut plain = bytes.clone();
    plain[20] = 0;
    for name in ["a", "b", "c"] {
        let whole = float(&bytes, name);
        assert!(whole.leaf_count() > 500);
        let last = whole.leaves().last().expect("a leaf").origin;
        let parts = [
            Part::within([-20, -3, 1], [9, 40, 1]),
            Part::around([[1, 2, 33], [-33, 0, 0], last]),
            Part::around(whole.leaves().step_by(3).map(|leaf| leaf.origin)),
            Part::within([4096, i32::MIN, i32::MIN], [i32::MAX; 3]),
            Part::within([1000; 3], [2000; 3]),
            Part::around([]),
        ];
        let mut held = vec![];
        for area in &parts {
            for bytes in [&bytes, &plain] {
                let found = part(bytes, name, area);
                let taken = area.leaves_of(&whole);
                let expected: Vec<_> =
                    whole.leaves().zip(&taken).filter(|(_, taken)| **taken).map(|(leaf, _)| leaf).collect();
                assert_eq!(found.leaves().count(), expected.len());
                for (a, b) in found.leaves().zip(expected) {
                    assert!(a.origin == b.origin && a.mask == b.mask && a.values == b.values);
                }
                assert_eq!(found.stats(), whole.stats());
                held.push(found.leaves().count());
                for (leaf, taken) in whole.leaves().zip(taken) {
                    assert_eq!(found.value(leaf.origin).is_ok(), taken);
                }
            }
        }
        assert!(held.iter().any(|count| *count > 200) && held.ends_with(&[0, 0, 0, 0]), "{held:?}");
        let all = part(&bytes, name, &Part::within([i32::MIN; 3], [i32::MAX; 3]));
        assert_equal(&all.into_whole().expect("all"), &whole);
    }
    // After a part the cursor finds the other grids.
    let mut file = open(&bytes);
    for name in ["c", "a", "b", "c"] {
        let grid = file.grid_part(name, &Part::around([[1, 2, 33]])).expect("a grid");
        assert!(matches!(grid.tree, AnyPartialTree::Float(tree) if tree.holds([1, 2, 33])));
    }
}

#[test]
fn a_part_takes_its_own_memory() {
    let bytes = three();
    let whole = float(&bytes, "a");
    let area = Part::around(whole.leaves().take(1).map(|leaf| leaf.origin));
    let needed =
        whole.memory_bytes() - (whole.leaf_count() as u64 - 1) * 2048 + 4 * whole.leaf_count() as u64;
    assert_eq!(part(&bytes, "a", &area).leaves().count(), 1);
    let grid = |limit| open(&bytes).with_memory_limit(limit).grid_part("a", &area);
    assert!(grid(needed).is_ok());
    assert!(matches!(grid(needed - 1), Err(VdbReadError::Memory { needed: n, .. }) if n == needed));
}

#[test]
fn codecs_that_are_not_read_are_named() {
    let bytes = file(&[(&grid_header("a"), &build(Compression::Blosc, &few()))]);
    let mask = float(&bytes, "a").leaves().last().expect("leaves").mask.map(u64::to_le_bytes);
    // Behind the mask, the code, the frame's length, and the versions of the frame and of its codec.
    let flags = find(&bytes, mask.as_flattened()).last().expect("the mask") + 64 + 1 + 8 + 2;
    assert_eq!(bytes[flags], 0x31);
    for (codec, name) in [(0, "BloscLZ"), (2, "Snappy"), (3, "zlib"), (4, "Zstandard")] {
        let mut other = bytes.clone();
        other[flags] = 0x11 | codec << 5;
        let error = open(&other).grid("a").expect_err("no LZ4").to_string();
        let at = flags - 2 - 8 - 1 - 64;
        assert_eq!(error, format!("Blosc with {name} at byte {at} is not supported"));
    }
}

#[test]
fn damage_elsewhere_does_not_matter_to_a_part() {
    for compression in ALL {
        let bytes = file(&[(&grid_header("a"), &build(compression, &few()))]);
        let whole = float(&bytes, "a");
        let last = whole.leaves().last().expect("leaves");
        let mask = last.mask.map(u64::to_le_bytes);
        let at = *find(&bytes, mask.as_flattened()).last().expect("the mask");
        let mut damaged = bytes.clone();
        damaged[at] ^= 1;
        let read = |part: &Part| open(&damaged).grid_part("a", part);
        assert!(open(&damaged).grid("a").is_err() && read(&Part::around([last.origin])).is_err());
        let first = whole.leaves().next().expect("leaves").origin;
        assert!(read(&Part::around([first])).is_ok());
    }
}
