//! OpenVDB files: all grids, whole and in part, in no more memory than they may take and than the file can hold.

use std::fmt::Debug;
use std::io::Cursor;

use vdbake::formats::vdb::{
    AnyPartialTree, AnyTree, Part, PartialTree, Tree, Value, VdbFile, list_grids, read_info,
};

use super::within;

/// Bytes that a grid may take.
const LIMIT: u64 = 16 << 20;
/// Bytes that are taken besides the grid, whatever the file: those that are read at once, and buffers of a node.
const BESIDE: u64 = 16 << 20;
/// Bytes that one byte of a file can become: a leaf of 129 without a value of its own has 512 vectors of doubles.
const MOST: u64 = 128;
/// Grids that are read; others may share their trees, so that what there is to do is not bounded by the file.
const GRIDS: usize = 4;
/// Leaves that are looked at.
const LEAVES: usize = 64;

pub(crate) fn run(data: &[u8]) -> bool {
    let most = (1 << 20) + 64 * data.len() as u64;
    let input = || Cursor::new(data);
    // A file without offsets is read through, with the topologies of its grids.
    let open = within(LIMIT + BESIDE, || VdbFile::open_within(input(), LIMIT));
    let listing = list_grids(input(), LIMIT);
    let mut file = match open {
        Ok(file) => file,
        Err(error) => {
            assert!(!error.to_string().is_empty());
            if let Ok(listing) = listing {
                assert!(listing.error.is_some() && listing.whole <= listing.info.grids.len());
            }
            return false;
        }
    };
    if data.get(20) == Some(&1) {
        let info = within(most, || read_info(&mut input())).expect("it was opened");
        assert_eq!(format!("{info:?}"), format!("{:?}", file.info()));
    }
    let listing = listing.expect("it was opened");
    assert!(listing.error.is_none() && listing.whole == listing.info.grids.len());
    let mut all = true;
    for number in 0..file.info().grids.len().min(GRIDS) {
        let most = (LIMIT + BESIDE).min(BESIDE + MOST * data.len() as u64);
        let grid = within(most, || file.grid_at(number));
        let part = Part::within([-16, -16, -4000], [120, 9000, 7]);
        let piece = within(most, || file.grid_part_at(number, &part));
        match (grid, piece) {
            (Ok(grid), Ok(piece)) => {
                macro_rules! same {
                    ($($kind:ident)*) => {
                        match (&grid.tree, &piece.tree) {
                            $((AnyTree::$kind(tree), AnyPartialTree::$kind(piece)) => check(tree, piece),)*
                            _ => panic!("a part of another type"),
                        }
                    };
                }
                same!(Bool Int32 Int64 Float Double Vec3i Vec3s Vec3d);
            }
            // What lies beyond the part is not looked at.
            (Err(_), _) => all = false,
            (Ok(_), Err(error)) => panic!("a part cannot be read: {error}"),
        }
    }
    all
}

/// That the ways to look at a tree agree.
pub(crate) fn check<T: Value + Debug>(tree: &Tree<T>, piece: &PartialTree<T>) {
    let same = |a: T, b: T| format!("{a:?}") == format!("{b:?}");
    let stats = tree.stats();
    assert_eq!((stats.leaves, stats.tiles), (piece.stats().leaves, piece.stats().tiles));
    assert!(same(tree.background(), piece.background()));
    assert_eq!(tree.leaves().count(), tree.leaf_count());
    let mut active = 0_u64;
    for leaf in tree.leaves() {
        active += leaf.mask.iter().map(|word| u64::from(word.count_ones())).sum::<u64>();
    }
    let tiles = stats.tiles.iter().zip([9, 21, 36]).map(|(count, log2)| count << log2).sum::<u64>();
    assert_eq!(stats.active_voxels, active + tiles);
    for leaf in tree.leaves().take(LEAVES) {
        for (at, value) in (0..).zip(leaf.values) {
            let offset = [at >> 6, (at >> 3) & 7, at & 7];
            let index = [0, 1, 2].map(|axis| leaf.origin[axis] + offset[axis]);
            let (found, is_active) = tree.value(index);
            assert!(same(found, *value), "{index:?}");
            let word = leaf.mask[usize::try_from(offset[0]).expect("below 8")];
            assert_eq!(is_active, (word >> (at & 63)) & 1 == 1, "{index:?}");
            if let Ok((partial, is_active)) = piece.value(index) {
                assert!(same(partial, *value) && is_active == tree.value(index).1, "{index:?}");
            }
        }
        if let Some([low, high]) = stats.bounds {
            assert!((0..3).all(|axis| leaf.mask == &[0; 8]
                || leaf.origin[axis] <= high[axis] && low[axis] <= leaf.origin[axis] + 7));
        }
    }
    for tile in tree.active_tiles().take(LEAVES) {
        let (found, is_active) = tree.value(tile.origin);
        assert!(same(found, tile.value) && is_active, "{tile:?}");
    }
    for index in [[0; 3], [i32::MAX; 3], [i32::MIN; 3], [-1, 8, 4096]] {
        let _ = tree.value(index);
    }
}
