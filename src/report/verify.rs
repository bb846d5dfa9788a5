//! Whether a grid is what its recipe makes.

use std::convert::Infallible;

use rayon::prelude::*;

use super::paged::Leaves;
use super::random::below;
use crate::field::{Field, VOXELS};
use crate::formats::vdb::{VdbReadError, file_order};
use crate::num::Level;
use crate::volume::{self, Brick, BrickHash, ContentHash, LeafView, Plan, Precision, Store, Tile, Tree};

/// Leaves that are looked at together, at most.
const TOGETHER: usize = 1 << 10;

/// The hash of all values of a tree, as a bake states it.
///
/// # Errors
///
/// Where its leaves cannot be read.
pub fn content_hash(leaves: &mut impl Leaves) -> Result<[u8; 32], VdbReadError> {
    /// A leaf's number, or a tile.
    #[derive(Clone, Copy)]
    enum Cube {
        Leaf(usize),
        Tile(Tile),
    }
    let tree = leaves.tree();
    let mut tiles: Vec<Tile> = tree.active_tiles().collect();
    tiles.sort_unstable_by_key(|tile| file_order(tile.origin));
    let (count, mut tiles) = (tree.leaf_count(), tiles.into_iter().peekable());
    let mut hash = ContentHash::default();
    for first in (0..count.max(1)).step_by(TOGETHER) {
        let numbers: Vec<usize> = (first..count.min(first + TOGETHER)).collect();
        leaves.hold(&numbers)?;
        let tree = leaves.tree();
        let mut cubes = Vec::new();
        for number in numbers {
            let key = file_order(tree.leaves[number].origin);
            while let Some(tile) = tiles.next_if(|tile| file_order(tile.origin) < key) {
                cubes.push(Cube::Tile(tile));
            }
            cubes.push(Cube::Leaf(number));
        }
        if first + TOGETHER >= count {
            cubes.extend(tiles.by_ref().map(Cube::Tile));
        }
        for cubes in cubes.chunk_by(|a, b| matches!((a, b), (Cube::Leaf(_), Cube::Leaf(_)))) {
            let found: Vec<BrickHash> = match cubes {
                [Cube::Tile(tile)] => {
                    push_tile(tile, &mut hash);
                    continue;
                }
                leaves => (leaves.par_iter())
                    .filter_map(|cube| match cube {
                        Cube::Leaf(number) => tree.leaf(*number),
                        Cube::Tile(_) => None,
                    })
                    .map(|LeafView { origin, mask, values }| {
                        BrickHash::new(&Brick { origin, mask: *mask, values: *values })
                    })
                    .collect(),
            };
            found.iter().for_each(|brick| hash.push(brick));
        }
    }
    Ok(hash.finish())
}

/// Takes in a tile, which may be of very many bricks.
fn push_tile(tile: &Tile, hash: &mut ContentHash) {
    let mut origins = bricks(tile.origin, tile.log2_edge);
    loop {
        let some: Vec<[i32; 3]> = origins.by_ref().take(TOGETHER).collect();
        if some.is_empty() {
            return;
        }
        let brick = |origin| Brick { origin, mask: [u64::MAX; 8], values: [tile.value; VOXELS] };
        let found: Vec<BrickHash> =
            some.into_par_iter().map(|origin| BrickHash::new(&brick(origin))).collect();
        found.iter().for_each(|brick| hash.push(brick));
    }
}

/// The bricks of a tile in file order: nodes of 16^3 of them, x before y before z in both.
fn bricks(origin: [i32; 3], log2_edge: u32) -> impl Iterator<Item = [i32; 3]> {
    let cubes = |count: i32, edge: i32| {
        (0..count).flat_map(move |x| {
            (0..count).flat_map(move |y| (0..count).map(move |z| [x * edge, y * edge, z * edge]))
        })
    };
    let (nodes, inner) = match log2_edge {
        12 => (32, 16),
        7 => (1, 16),
        _ => (1, 1),
    };
    cubes(nodes, 128).flat_map(move |node| {
        cubes(inner, 8).map(move |brick| [0, 1, 2].map(|axis| origin[axis] + node[axis] + brick[axis]))
    })
}

/// What was found of bricks that were baked again.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Rederived {
    /// Bricks that were.
    pub bricks: u64,
    /// Those of them whose values differ in any bit, or which voxels are active.
    pub differ: u64,
    /// The first voxel of one of these.
    pub first: Option<[i32; 3]>,
    /// The first voxel of a leaf where the scene can have no density.
    pub outside: Option<[i32; 3]>,
}

/// Bakes `count` of a plan's bricks again, in the same random places at every run, and holds the tree against them, bit by bit.
/// On the current `rayon` pool.
///
/// # Errors
///
/// Where leaves cannot be read.
pub fn rederive(
    leaves: &mut impl Leaves,
    field: &Field,
    plan: &Plan,
    cutoff: f64,
    precision: Precision,
    count: usize,
) -> Result<Rederived, VdbReadError> {
    const STREAM: u64 = 0x7665_7269;
    let mut chosen: Vec<usize> = if count >= plan.bricks() {
        (0..plan.bricks()).collect()
    } else {
        (0..count as u64).map(|n| below(STREAM, n, plan.bricks())).collect()
    };
    chosen.sort_unstable();
    chosen.dedup();
    let outside = (leaves.tree().leaves.iter().map(|leaf| leaf.origin))
        .find(|origin| plan.find(origin.map(|c| i64::from(c >> 3))).is_none());
    let mut found = Rederived { bricks: chosen.len() as u64, outside, ..Rederived::default() };
    for chosen in chosen.chunks(TOGETHER) {
        let tree = leaves.tree();
        let mut numbers: Vec<usize> =
            chosen.iter().filter_map(|brick| tree.leaf_at(plan.origin(*brick))).collect();
        numbers.sort_unstable();
        leaves.hold(&numbers)?;
        let tree = leaves.tree();
        let mut store = Store::new(precision);
        let part = plan.part(chosen.iter().copied());
        let Ok(_) =
            volume::bake(field, &part, cutoff, Level::best(), &mut store, |_| {}) as Result<_, Infallible>;
        let mut baked = store.bricks().iter().peekable();
        for origin in part.origins() {
            let empty = Brick { origin, mask: [0; 8], values: [0.0; VOXELS] };
            let brick = baked.next_if(|brick| brick.origin == origin).unwrap_or(&empty);
            if !same(tree, brick) {
                found.differ += 1;
                found.first = found.first.or(Some(origin));
            }
        }
    }
    Ok(found)
}

/// Whether a tree has a brick's values, to the bit, in active voxels, and no other active ones.
fn same(tree: &Tree<f32>, brick: &Brick) -> bool {
    if let Some(leaf) = tree.leaf_at(brick.origin).and_then(|leaf| tree.leaf(leaf)) {
        let bits = |values: &[f32; VOXELS]| values.map(f32::to_bits);
        return *leaf.mask == brick.mask && bits(leaf.values) == bits(&brick.values);
    }
    let (value, active) = tree.value(brick.origin);
    if active {
        brick.uniform().is_some_and(|own| own.to_bits() == value.to_bits())
    } else {
        brick.active() == 0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::field::Lattice;
    use crate::formats::vdb::{Compression, Encoder};
    use crate::report::Trial;
    use crate::scene::Scene;

    fn baked(text: &str, voxel_size: f64, precision: Precision) -> (Field, Plan, Trial) {
        let scene = Scene::parse(text, "scene").expect("valid");
        let lattice = Lattice { voxel_size };
        let mut field = Field::compile(&scene);
        field.widen(lattice);
        let plan = Plan::new(&field, lattice, 1 << 28).expect("small");
        let encoder = Encoder::new(Compression::Blosc).with_precision(precision);
        let trial = Trial::new(&field, &plan, 0.0, encoder).expect("memory");
        (field, plan, trial)
    }

    fn hash_of(tree: &Tree<f32>) -> [u8; 32] {
        content_hash(&mut tree.clone()).expect("in memory")
    }

    /// Leaves, tiles, and with constant density nodes that are tiles.
    const FAT: &str = "[[tube]]\nradius = 200\nenvelope = { radial = \"hard\" }\ncaps = \"flat\"\n\
        curve = { points = [[0, 0, -100], [0, 0, 0], [0, 0, 300]] }";
    const NOISE: &str = "[[tube]]\nradius = 0.3\ncurve = { points = [[0, 0, 0], [0.5, 0, 0.5], [0, 0, 1]] }\n\
        [[tube.layer]]\nnoise = \"perlin\"";

    #[test]
    fn trees_have_the_hash_that_their_bake_states() {
        for (text, h, precision) in
            [(NOISE, 0.02, Precision::F32), (NOISE, 0.02, Precision::F16), (FAT, 1.0, Precision::F32)]
        {
            let (_, _, trial) = baked(text, h, precision);
            assert_eq!(hash_of(&trial.tree), trial.tally.content_hash);
        }
        let (_, _, trial) = baked(FAT, 1.0, Precision::F32);
        assert!(trial.tree.active_tiles().any(|tile| tile.log2_edge == 7));
    }

    #[test]
    fn bricks_are_baked_again() {
        for precision in [Precision::F32, Precision::F16] {
            let (field, plan, mut trial) = baked(NOISE, 0.02, precision);
            let again = |tree: &Tree<f32>, count| {
                rederive(&mut tree.clone(), &field, &plan, 0.0, precision, count).expect("in memory")
            };
            let all = plan.bricks() as u64;
            let right = Rederived { bricks: all, ..Rederived::default() };
            assert_eq!(again(&trial.tree, usize::MAX), right);
            assert!(again(&trial.tree, 20).bricks <= 20);
            // One voxel, by the least that a number can differ.
            let hash = hash_of(&trial.tree);
            let value = &mut trial.tree.pages[0][3][100];
            *value = f32::from_bits(value.to_bits() ^ 1);
            let origin = trial.tree.leaves[3].origin;
            assert_eq!(again(&trial.tree, usize::MAX), Rederived { differ: 1, first: Some(origin), ..right });
            assert_ne!(hash_of(&trial.tree), hash);
        }
    }

    #[test]
    fn leaves_where_nothing_can_be_are_found() {
        let (_, _, mut trial) = baked(NOISE, 0.02, Precision::F32);
        let (field, plan, _) = baked(&NOISE.replace("0.3", "0.1"), 0.02, Precision::F32);
        let found = rederive(&mut trial.tree, &field, &plan, 0.0, Precision::F32, 1).expect("in memory");
        assert!(found.outside.is_some());
    }
}
