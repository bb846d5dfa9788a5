//! A file's values at points and along rays, of which only some are in memory at a time.

use std::io::{Read, Seek};

use glam::DVec3;
use rayon::prelude::*;

use super::ray::Chord;
use super::source::{Line, cells, rule};
use super::support::{Rows, Support};
use crate::formats::vdb::{PagedGrid, VdbReadError};
use crate::volume::{Accessor, Filter, Tree, sample_at};

/// A tree of whose leaves as many are in memory as were asked for, or more.
pub trait Leaves {
    /// The tree, with those.
    fn tree(&self) -> &Tree<f32>;

    /// Sees to it that these leaves' values are there, by their numbers in rising order; others may go.
    ///
    /// # Errors
    ///
    /// Where they cannot be read.
    fn hold(&mut self, leaves: &[usize]) -> Result<(), VdbReadError>;

    /// Bytes of memory without any leaf's values.
    fn memory(&self) -> u64;
}

/// All are.
impl Leaves for Tree<f32> {
    fn tree(&self) -> &Tree<f32> {
        self
    }

    fn hold(&mut self, _: &[usize]) -> Result<(), VdbReadError> {
        Ok(())
    }

    fn memory(&self) -> u64 {
        0
    }
}

impl<R: Read + Seek> Leaves for PagedGrid<R> {
    fn tree(&self) -> &Tree<f32> {
        PagedGrid::tree(self)
    }

    fn hold(&mut self, leaves: &[usize]) -> Result<(), VdbReadError> {
        PagedGrid::hold(self, leaves)
    }

    fn memory(&self) -> u64 {
        PagedGrid::memory(self)
    }
}

/// Bytes of a leaf in a support.
pub(super) const SUPPORT: u64 = size_of::<[i32; 3]>() as u64;

/// How far beside a ray voxels count as met, in voxels: far more than rounding moves it, far less than a voxel.
const BESIDE: f64 = 1e-3;
/// Points that are looked at together.
const TOGETHER: usize = 1 << 14;

/// A grid's values, filtered.
#[derive(Debug)]
pub(super) struct Paged<L> {
    leaves: L,
    filter: Filter,
    support: Support,
    /// Leaves that are asked for at once.
    most: usize,
}

impl<L: Leaves> Paged<L> {
    /// A tree and its map to the world, of which up to `most` leaves are asked for at once, but always as many as one place
    /// takes; `None` where the map has no inverse.
    pub(super) fn new(leaves: L, rows: Rows, filter: Filter, most: usize) -> Option<Paged<L>> {
        /// A cubic filter looks into eight, a ray passes from some into others.
        const LEAST: usize = 64;
        let tree = leaves.tree();
        let small = tree.leaves.iter().map(|leaf| (leaf.origin, 3));
        let tiles = tree.active_tiles().map(|tile| (tile.origin, tile.log2_edge));
        let support = Support::new(rows, small.chain(tiles))?;
        Some(Paged { leaves, filter, support, most: most.max(LEAST) })
    }

    /// Where it can be other than its background.
    pub(super) fn support(&self) -> &Support {
        &self.support
    }

    /// Its values at points of the world, in metres.
    pub(super) fn values(&mut self, points: &[DVec3]) -> Result<Vec<f64>, VdbReadError> {
        let mut values = Vec::with_capacity(points.len());
        let mut wanted = Wanted::new(self.leaves.tree().leaf_count(), self.most);
        for points in points.chunks(TOGETHER) {
            let map = self.support.to_index();
            let indices: Vec<DVec3> = points.iter().map(|point| map.index(*point)).collect();
            let mut done = 0;
            for (number, at) in indices.iter().enumerate() {
                let found = around(self.leaves.tree(), self.filter, [*at; 2]);
                if !wanted.takes(&found) {
                    self.leaves.hold(&wanted.list())?;
                    values.extend(sample_at(self.leaves.tree(), self.filter, &indices[done..number]));
                    done = number;
                    wanted.clear();
                }
                wanted.add(&found);
            }
            self.leaves.hold(&wanted.list())?;
            values.extend(sample_at(self.leaves.tree(), self.filter, &indices[done..]));
            wanted.clear();
        }
        Ok(values)
    }

    /// Its integrals along chords, value times metres.
    pub(super) fn depths(&mut self, chords: &[Chord]) -> Result<Vec<f64>, VdbReadError> {
        let background = f64::from(self.leaves.tree().background());
        let mut lines: Vec<Line> =
            chords.iter().map(|chord| Line::new(chord, &self.support, self.filter, background)).collect();
        let (shift, _, _) = cells(self.filter);
        let mut wanted = Wanted::new(self.leaves.tree().leaf_count(), self.most);
        // Lines that were begun and not ended when leaves were last read.
        let mut begun = 0;
        for number in 0..lines.len() {
            let Some(mut blocks) = lines[number].blocks() else { continue };
            while let Some(block) = blocks.cell() {
                let tree = self.leaves.tree();
                let (jumped, wide) = passed(tree, block);
                let [from, to] = blocks.leave(jumped);
                if wide {
                    continue;
                }
                let ends = [from, to].map(|t| 8.0 * blocks.at(t) - shift);
                let found = around(tree, self.filter, ends);
                if !wanted.takes(&found) {
                    self.advance(&mut lines[begun..=number], &wanted, from)?;
                    begun = number;
                    wanted.clear();
                }
                wanted.add(&found);
            }
        }
        self.advance(&mut lines[begun..], &wanted, f64::INFINITY)?;
        Ok(lines.iter().map(Line::sum).collect())
    }

    /// Reads leaves and goes on along lines: the last of them up to a place, the others to their ends.
    fn advance(&mut self, lines: &mut [Line], wanted: &Wanted, until: f64) -> Result<(), VdbReadError> {
        self.leaves.hold(&wanted.list())?;
        let (tree, filter, rule) = (self.leaves.tree(), self.filter, rule(self.filter));
        let last = lines.len().saturating_sub(1);
        lines.par_iter_mut().enumerate().for_each(|(number, line)| {
            line.advance(tree, filter, &rule, if number == last { until } else { f64::INFINITY });
        });
        Ok(())
    }
}

/// Leaves that are to be read together, one bit each.
struct Wanted {
    bits: Vec<u64>,
    count: usize,
    most: usize,
}

impl Wanted {
    fn new(leaves: usize, most: usize) -> Wanted {
        Wanted { bits: vec![0; leaves.div_ceil(64)], count: 0, most }
    }

    fn has(&self, leaf: usize) -> bool {
        self.bits.get(leaf / 64).is_some_and(|word| word >> (leaf % 64) & 1 == 1)
    }

    /// Whether there is room for all of these.
    fn takes(&self, leaves: &[usize]) -> bool {
        self.count + leaves.iter().filter(|leaf| !self.has(**leaf)).count() <= self.most
    }

    fn add(&mut self, leaves: &[usize]) {
        for leaf in leaves {
            if !self.has(*leaf)
                && let Some(word) = self.bits.get_mut(leaf / 64)
            {
                *word |= 1 << (leaf % 64);
                self.count += 1;
            }
        }
    }

    /// In rising order.
    fn list(&self) -> Vec<usize> {
        let mut list = Vec::with_capacity(self.count);
        for (place, word) in self.bits.iter().enumerate() {
            let mut bits = *word;
            while bits != 0 {
                list.push(64 * place + bits.trailing_zeros() as usize);
                bits &= bits - 1;
            }
        }
        list
    }

    fn clear(&mut self) {
        self.bits.fill(0);
        self.count = 0;
    }
}

/// The leaves that a filter looks into on the way between two points of index space within a block of 8^3 voxels.
fn around(tree: &Tree<f32>, filter: Filter, ends: [DVec3; 2]) -> Vec<usize> {
    let (shift, before, behind) = cells(filter);
    #[allow(clippy::cast_precision_loss, reason = "at most 2")]
    let [before, behind] = [before, behind].map(|voxels| voxels as f64 + BESIDE);
    let [low, high] = [ends[0].min(ends[1]) + shift - before, ends[0].max(ends[1]) + shift + behind];
    #[allow(clippy::cast_possible_truncation, reason = "saturates, and no leaf lies there")]
    let [low, high] = [low, high].map(|end| (end / 8.0).floor().to_array().map(|c| c as i32));
    let mut found = Vec::new();
    // No more than a few: what is not finite is at one place.
    for x in low[0]..=high[0] {
        for y in low[1]..=high[1] {
            for z in low[2]..=high[2] {
                let index = [x, y, z].map(|block| block.checked_mul(8));
                if let [Some(x), Some(y), Some(z)] = index {
                    found.extend(tree.leaf_at([x, y, z]));
                }
            }
        }
    }
    found
}

/// The blocks from the first to before the end around a block of 8^3 cells, where no filter looks into a leaf from any of them;
/// else that block alone.
fn passed(tree: &Tree<f32>, block: [i64; 3]) -> ([[i64; 3]; 2], bool) {
    let one = ([block, block.map(|b| b + 1)], false);
    let [Ok(x), Ok(y), Ok(z)] = block.map(|b| i32::try_from(8 * b)) else { return one };
    let Some((origin, log2_edge, _)) = Accessor::new(tree).uniform([x, y, z]) else { return one };
    let first = origin.map(|c| i64::from(c >> 3) + 1);
    let end = first.map(|c| c + (1 << (log2_edge - 3)) - 2);
    let inside = (0..3).all(|axis| first[axis] <= block[axis] && block[axis] < end[axis]);
    if inside { ([first, end], true) } else { one }
}

#[cfg(test)]
mod tests {
    use std::io::Cursor;

    use super::super::random::unit;
    use super::super::source::{Gridded, Source};
    use super::super::trial::{Pilot, rows};
    use super::*;
    use crate::field::Lattice;
    use crate::formats::vdb::{
        Compression, Encoder, FileHeader, GridClass, GridHeader, Metadata, VdbFile, VdbGridBuilder,
        VectorType, write,
    };
    use crate::num::Level;
    use crate::scene::Scene;
    use crate::volume;

    /// A file of a scene's density.
    fn file(text: &str, lattice: Lattice, encoder: Encoder) -> Vec<u8> {
        let scene = Scene::parse(text, "scene").expect("valid");
        let lot = Pilot::new(&scene, 1 << 28).at(lattice).expect("small");
        let mut grid = VdbGridBuilder::with_encoder(encoder);
        volume::bake(&lot.field, &lot.plan, 0.0, Level::best(), &mut grid, |_| {}).expect("memory");
        let header = GridHeader {
            name: "density".to_owned(),
            class: GridClass::FogVolume,
            vector_type: VectorType::Invariant,
            voxel_size: lattice.voxel_size,
            translation: [0.5 * lattice.voxel_size; 3],
            metadata: Metadata::new(),
        };
        let around = FileHeader { uuid: uuid::Uuid::nil(), metadata: Metadata::new() };
        let mut file = vec![];
        write(&mut file, &around, &[(&header, &grid)]).expect("memory");
        file
    }

    fn bits(values: &[f64]) -> Vec<u64> {
        values.iter().map(|value| value.to_bits()).collect()
    }

    /// Leaves far from each other, and tiles within one of which rays pass many blocks.
    const NOISE: &str = "[[tube]]\nradius = 0.3\ncurve = { points = [[0, 0, 0], [0.5, 0, 0.5], [0, 0, 1]] }\n\
        [[tube.layer]]\nnoise = \"perlin\"\n\
        [[tube]]\nradius = 0.1\ncurve = { points = [[-9, 5, 2], [-9, 5.2, 2.2], [-9, 5, 2.4]] }";
    const FAT: &str = "[[tube]]\nradius = 200\nenvelope = { radial = \"hard\" }\ncaps = \"flat\"\n\
        curve = { points = [[0, 0, -100], [0, 0, 0], [0, 0, 300]] }";

    #[test]
    fn values_and_depths_are_those_of_the_whole_tree_however_few_leaves_are_held() {
        for (text, voxel_size, compression) in [
            (NOISE, 0.012, Compression::Blosc),
            (NOISE, 0.012, Compression::None),
            (FAT, 2.0, Compression::Zip),
        ] {
            let lattice = Lattice { voxel_size };
            let bytes = file(text, lattice, Encoder::new(compression));
            let open = || VdbFile::open(Cursor::new(&bytes[..])).expect("a file");
            for filter in [Filter::Nearest, Filter::Trilinear, Filter::Cubic] {
                let whole = open().paged("density").expect("a grid");
                let all: Vec<usize> = (0..whole.tree().leaf_count()).collect();
                assert!(all.len() > 256);
                let mut whole = whole;
                whole.hold(&all).expect("a grid");
                let whole = Gridded::new(whole.tree().clone(), rows(lattice), filter).expect("a size");
                let [low, high] = whole.support().bounds().expect("leaves");
                let point = |n: u64| {
                    let at = DVec3::new(unit(5, 3 * n), unit(5, 3 * n + 1), unit(5, 3 * n + 2));
                    low + (high - low) * at
                };
                // Half of them in the first tube's middle, some on faces of voxels and leaves.
                let middle =
                    |at: DVec3| if text == NOISE { at.clamp(DVec3::splat(-0.3), DVec3::ONE) } else { at };
                let on_face = |at: DVec3| (at / (4.0 * voxel_size)).round() * 4.0 * voxel_size;
                let points: Vec<DVec3> = (0..4000)
                    .map(|n| match n % 4 {
                        0 => point(n),
                        1 => on_face(middle(point(n))),
                        _ => middle(point(n)),
                    })
                    .collect();
                let mut chords = super::super::ray::chords([low, high], &points, 200);
                for (n, point) in points.iter().take(60).enumerate() {
                    let mut direction = DVec3::ZERO;
                    direction[n % 3] = 1.0;
                    direction[(n + 1) % 3] = if n % 2 == 0 { 0.0 } else { 1.0 };
                    let range = [-(high - low).length(), (high - low).length()];
                    chords.push(Chord { origin: *point, direction: direction.normalize(), range });
                }
                let expected = [whole.values(&points), whole.depths(&chords)];
                assert!(expected.iter().all(|values| values.iter().any(|value| *value > 0.0)));
                for most in [1, 100, 1000, usize::MAX] {
                    let grid = open().paged("density").expect("a grid");
                    let mut paged = Paged::new(grid, rows(lattice), filter, most).expect("a size");
                    let found = [paged.values(&points).expect("read"), paged.depths(&chords).expect("read")];
                    for (found, expected) in found.iter().zip(&expected) {
                        assert_eq!(bits(found), bits(expected), "{filter:?}, {most} leaves at once");
                    }
                }
            }
        }
    }
}
