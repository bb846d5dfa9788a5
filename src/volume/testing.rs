//! What the tests of trees share.

use std::collections::BTreeMap;

use super::node::Node;
use super::shape::{Leaf, Tile, align};
use super::tree::{PAGE, RootTile, Tree, offset};

/// splitmix64 (Steele, Lea, Flood 2014).
pub(crate) fn random(state: &mut u64) -> u64 {
    *state = state.wrapping_add(0x9E37_79B9_7F4A_7C15);
    let z = (*state ^ (*state >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    let z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    z ^ (z >> 31)
}

/// Uniform in [0, 1).
pub(crate) fn unit(state: &mut u64) -> f64 {
    f64::from(u32::try_from(random(state) >> 32).expect("32 bits")) / 4_294_967_296.0
}

/// Leaves around the origin, some of them missing, tiles of each size beside them, and a leaf in another upper node.
/// Every voxel of a leaf has a value of its own.
pub(super) fn checkered() -> Tree<f32> {
    let near = (0..64).map(|n| [n / 16 * 8 - 16, n / 4 % 4 * 8 - 16, n % 4 * 8 - 16]);
    let mut leaves: Vec<[i32; 3]> =
        near.filter(|&[x, y, z]| (x + 2 * y + z) % 24 != 0 && [x, y, z] != [8; 3]).collect();
    leaves.extend([[-4096, 0, 0], [-4096, 8, 0], [-4104, 0, 8], [120, 0, 0]]);
    let tile = |origin, log2_edge, value| Tile { origin, log2_edge, value };
    let tiles = [
        tile([8; 3], 3, 2.0),
        tile([-8, -8, 16], 3, -1.0),
        tile([128, 0, 0], 7, 3.0),
        tile([4096, 0, 0], 12, 4.0),
    ];
    let mut state = 7;
    tree(0.5, &leaves, &tiles, |_| f32::from(u16::try_from(random(&mut state) >> 48).expect("16 bits")))
}

/// A tree of active leaves and tiles. Values are asked for leaf by leaf, in the order of the tree.
pub(crate) fn tree(
    background: f32,
    leaves: &[[i32; 3]],
    tiles: &[Tile],
    mut value: impl FnMut([i32; 3]) -> f32,
) -> Tree<f32> {
    let key = |origin| (align(origin, 12), offset(origin, 2), offset(origin, 1));
    let leaf = leaves.iter().map(|&origin| (key(origin), None));
    let small = tiles.iter().filter(|tile| tile.log2_edge < 12).map(|tile| (key(tile.origin), Some(*tile)));
    let parts: BTreeMap<_, _> = leaf.chain(small).collect();
    let parts: Vec<_> = parts.into_iter().collect();
    let root_tiles = tiles.iter().filter(|tile| tile.log2_edge == 12);
    let mut tree = Tree {
        background,
        root_tiles: root_tiles
            .map(|tile| RootTile { origin: tile.origin, value: tile.value, active: true })
            .collect(),
        uppers: vec![],
        lowers: vec![],
        leaves: vec![],
        pages: vec![],
        slots: None,
    };
    for upper in parts.chunk_by(|a, b| a.0.0 == b.0.0) {
        let first_lower = tree.lowers.len();
        let mut entries = Entries::new(32768, background);
        for lower in upper.chunk_by(|a, b| a.0.1 == b.0.1) {
            let ((origin, at, _), tile) = lower[0];
            if let Some(tile) = tile.filter(|tile| tile.log2_edge == 7) {
                entries.tile(at, tile.value);
                continue;
            }
            entries.child(at);
            let first_leaf = tree.leaves.len();
            let mut inner = Entries::new(4096, background);
            let place = [at >> 10, at >> 5 & 31, at & 31].map(|c| i32::try_from(c).expect("small") << 7);
            let origin = [0, 1, 2].map(|axis| origin[axis] + place[axis]);
            for ((_, _, at), tile) in lower {
                let Some(tile) = tile else {
                    inner.child(*at);
                    let place =
                        [at >> 8, at >> 4 & 15, at & 15].map(|c| i32::try_from(c).expect("small") << 3);
                    let origin = [0, 1, 2].map(|axis| origin[axis] + place[axis]);
                    tree.leaves.push(Leaf { origin, mask: [u64::MAX; 8] });
                    continue;
                };
                inner.tile(*at, tile.value);
            }
            tree.lowers.push(Node::new(origin, inner.children, first_leaf, inner.active, &inner.values));
        }
        tree.uppers.push(Node::new(
            upper[0].0.0,
            entries.children,
            first_lower,
            entries.active,
            &entries.values,
        ));
    }
    let values = |leaf: &Leaf| {
        let mut values = [0.0; 512];
        for (out, n) in values.iter_mut().zip(0..512) {
            let [x, y, z] = leaf.origin;
            *out = value([x + n / 64, y + n / 8 % 8, z + n % 8]);
        }
        values
    };
    let values: Vec<[f32; 512]> = tree.leaves.iter().map(values).collect();
    tree.pages = values.chunks(PAGE).map(Into::into).collect();
    tree
}

/// What a node is made from.
struct Entries {
    children: Vec<u64>,
    active: Vec<u64>,
    values: Vec<f32>,
}

impl Entries {
    fn new(count: usize, background: f32) -> Entries {
        Entries {
            children: vec![0; count / 64],
            active: vec![0; count / 64],
            values: vec![background; count],
        }
    }

    fn child(&mut self, at: usize) {
        self.children[at / 64] |= 1 << (at % 64);
    }

    fn tile(&mut self, at: usize, value: f32) {
        self.active[at / 64] |= 1 << (at % 64);
        self.values[at] = value;
    }
}
