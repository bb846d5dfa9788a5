//! A medium of voxels, linear along each axis between them.

#![allow(clippy::needless_range_loop, reason = "lanes and axes are indices into several arrays at once")]

use glam::DVec3;
use rayon::prelude::*;

use super::bins::Bins;
use super::camera::Ray;
use super::grid::{Bricks, EDGE, Grid};
use super::medium::{Brick, Way};
use super::picture::Shadow;
use super::planes;
use super::points::Spot;
use super::rays::{Hits, LANES, Rays, single};
use super::segment::GAUSS;
use super::shade::{FINE, Group, LONGEST, Lit, Wanted};
use super::sweep;
use super::table::Table;
use super::walk::{self, Cells, Walk};
use crate::num::{Level, Real, WithLevel, with_level};
use crate::volume::{Accessor, Sampled, Tree};

/// Values of a brick along an edge: those of its cells' corners.
pub(super) const VALUES: usize = 9;
/// Values of a brick.
pub(super) const ALL: usize = VALUES * VALUES * VALUES;
/// A ray crosses no more faces between the cells of a brick, divided or not.
const MOST_STEPS: usize = 4096;

/// What the values of a grid mean.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Meaning {
    /// They are densities; negative ones, and those that are no numbers, count as 0.
    Density,
    /// They are distances to a surface, negative inside: the density is 1 inside and 0 outside, and changes linearly over
    /// this distance around the surface.
    Distance(f64),
}

impl Meaning {
    fn density(self, value: f64) -> f32 {
        let density = match self {
            Meaning::Density => value,
            Meaning::Distance(width) => (0.5 - value / width).min(1.0),
        };
        // Also for NaN.
        if density > 0.0 { single(density.min(f64::from(f32::MAX))) } else { 0.0 }
    }
}

/// The densities of a tree's voxels, each at the point of its index, and linear between them; beside them the background's.
#[derive(Debug, Clone)]
pub struct Baked {
    pub(super) grid: Grid,
    pub(super) bricks: Bricks,
    pub(super) values: Vec<[f32; ALL]>,
    /// The largest of each brick.
    pub(super) most: Vec<f32>,
    pub(super) sampling: Sampling,
}

/// Where voxels are sampled along rays.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Sampling {
    /// In every cell, so that optical depths are exact but for rounding.
    #[default]
    Cells,
    /// In the middle of every layer of cells across the axis that rays go along most, one sample of four values in each; cell by
    /// cell where voxels are so dense that this would not do, where points light them, where shadows are exact, and where rays
    /// that are close together have no such axis. Optical depths of smooth voxels have errors of a thousandth or so.
    Planes,
}

/// Why a tree cannot be rendered.
#[derive(Debug, thiserror::Error)]
pub enum BakedError {
    /// Its bricks take too much memory.
    #[error("{bricks} bricks of 8^3 voxels take {bytes} bytes, and less may be used")]
    TooLarge {
        /// Bricks.
        bricks: u64,
        /// What they take.
        bytes: u64,
    },
    /// Density without end.
    #[error("the grid's background, {0}, is a density everywhere")]
    Background(f64),
}

impl Baked {
    /// Of a tree whose voxels are placed in the world by `grid`, in no more than `budget` bytes.
    ///
    /// # Errors
    ///
    /// [`BakedError`].
    pub fn new<T: Sampled<Wide = f64>>(
        tree: &Tree<T>,
        grid: Grid,
        meaning: Meaning,
        budget: u64,
    ) -> Result<Baked, BakedError> {
        if meaning.density(tree.background().wide()) > 0.0 {
            return Err(BakedError::Background(tree.background().wide()));
        }
        let blocks = candidates(tree, meaning, budget)?;
        check(blocks.len() as u64, BRICK, budget)?;
        let mut kept = Vec::new();
        blocks
            .par_iter()
            .with_min_len(64)
            .map_init(|| Accessor::new(tree), |accessor, block| values(accessor, *block, meaning))
            .collect_into_vec(&mut kept);
        Ok(Baked {
            grid,
            bricks: Bricks::new(blocks),
            most: most(&kept),
            values: kept,
            sampling: Sampling::default(),
        })
    }
}

/// The largest value of every brick.
pub(super) fn most(values: &[[f32; ALL]]) -> Vec<f32> {
    let mut most = Vec::new();
    values.par_iter().with_min_len(64).map(largest).collect_into_vec(&mut most);
    most
}

fn largest(values: &[f32; ALL]) -> f32 {
    let (chunks, rest) = values.as_chunks::<LANES>();
    let mut most = [0.0_f32; LANES];
    for chunk in chunks {
        for lane in 0..LANES {
            most[lane] = if chunk[lane] > most[lane] { chunk[lane] } else { most[lane] };
        }
    }
    most.iter().chain(rest).fold(0.0, |most, value| value.max(most))
}

/// Bytes of a brick: its values, and what finds it.
const BRICK: u64 = size_of::<[f32; ALL]>() as u64 + 128;

fn check(bricks: u64, each: u64, budget: u64) -> Result<(), BakedError> {
    let bytes = bricks.saturating_mul(each);
    if bytes > budget { Err(BakedError::TooLarge { bricks, bytes }) } else { Ok(()) }
}

/// The blocks of cells that may hold density: those of leaves and tiles, and those before them that end on their voxels.
fn candidates<T: Sampled<Wide = f64>>(
    tree: &Tree<T>,
    meaning: Meaning,
    budget: u64,
) -> Result<Vec<[i32; 3]>, BakedError> {
    let has = |value: T| meaning.density(value.wide()) > 0.0;
    let mut blocks: Vec<[i32; 3]> = tree
        .leaves()
        .collect::<Vec<_>>()
        .par_iter()
        .flat_map_iter(|leaf| {
            // Whether the leaf has density, and on which of its lower faces, edges and corner.
            let mut on = [false; 8];
            for (at, value) in leaf.values.iter().enumerate() {
                if has(*value) {
                    on[0] = true;
                    let face = |shift: usize| at >> shift & 7 == 0;
                    let faces = usize::from(face(6)) << 2 | usize::from(face(3)) << 1 | usize::from(face(0));
                    on[faces] = true;
                }
            }
            let block = leaf.origin.map(|c| c >> 3);
            (0..8_usize).filter(move |before| (0..8).any(|n| on[n] && n & before == *before)).map(
                move |before| {
                    let mut block = block;
                    for (axis, c) in block.iter_mut().enumerate() {
                        *c -= i32::from(before >> (2 - axis) & 1 == 1);
                    }
                    block
                },
            )
        })
        .collect();
    for tile in tree.tiles() {
        if has(tile.value) {
            let edge = 1_i64 << (tile.log2_edge - 3);
            let count = (edge + 1) * (edge + 1) * (edge + 1);
            check(blocks.len() as u64 + count.unsigned_abs(), BRICK, budget)?;
            let first = tile.origin.map(|c| i64::from(c >> 3) - 1);
            for n in 0..count {
                let place = [n / (edge + 1) / (edge + 1), n / (edge + 1) % (edge + 1), n % (edge + 1)];
                let at = |axis: usize| i32::try_from(first[axis] + place[axis]).ok();
                if let (Some(x), Some(y), Some(z)) = (at(0), at(1), at(2)) {
                    blocks.push([x, y, z]);
                }
            }
        }
    }
    blocks.par_sort_unstable();
    blocks.dedup();
    Ok(blocks)
}

/// The densities at the corners of a block's cells.
fn values<T: Sampled<Wide = f64>>(
    accessor: &mut Accessor<'_, T>,
    block: [i32; 3],
    meaning: Meaning,
) -> [f32; ALL] {
    let mut values = [0.0; ALL];
    let first = block.map(|c| i64::from(c) * i64::from(EDGE));
    let own = accessor.stencil::<8>(first);
    for (x, plane) in own.iter().enumerate() {
        for (y, row) in plane.iter().enumerate() {
            for (z, value) in row.iter().enumerate() {
                values[(x * VALUES + y) * VALUES + z] = meaning.density(value.wide());
            }
        }
    }
    let background = accessor.tree().background();
    for x in 0..VALUES {
        for y in 0..VALUES {
            let border = x == VALUES - 1 || y == VALUES - 1;
            for z in if border { 0 } else { VALUES - 1 }..VALUES {
                let at = |axis: usize, n: usize| i32::try_from(first[axis] + i64::try_from(n).ok()?).ok();
                let value = match (at(0, x), at(1, y), at(2, z)) {
                    (Some(x), Some(y), Some(z)) => accessor.value([x, y, z]),
                    _ => background,
                };
                values[(x * VALUES + y) * VALUES + z] = meaning.density(value.wide());
            }
        }
    }
    values
}

impl Baked {
    /// Sampled otherwise.
    #[must_use]
    pub fn with(self, sampling: Sampling) -> Baked {
        Baked { sampling, ..self }
    }

    /// Bytes that it takes.
    pub fn memory(&self) -> u64 {
        BRICK.saturating_mul(self.values.len() as u64)
    }

    /// Whether there is room in `budget` bytes for it with the shadows of so many lamps.
    ///
    /// # Errors
    ///
    /// [`BakedError::TooLarge`].
    pub fn check_shadows(&self, lamps: usize, shadow: Shadow, budget: u64) -> Result<(), BakedError> {
        /// The part that fronts take, and what allocators keep to themselves.
        const BESIDES: u64 = 4;
        let shadows = match shadow {
            Shadow::Cached(pitch) if lamps > 0 => {
                let table = size_of::<f32>() * if pitch < 2.0 { FINE * FINE * FINE } else { sweep::POINTS };
                sweep::ADDED + (sweep::KEPT + table as u64).saturating_mul(lamps as u64)
            }
            _ => 0,
        };
        let each = BRICK.saturating_add(shadows);
        let besides = if shadows > 0 { each / BESIDES } else { 0 };
        check(self.values.len() as u64, each.saturating_add(besides), budget)
    }

    /// Gets ready to carry a tile's new rays.
    pub(super) fn begin(&self, way: &mut Way, wanted: &Wanted) {
        if self.sampling == Sampling::Planes {
            way.planes.begin(&way.rays, wanted);
        }
    }

    pub(super) fn grid(&self) -> &Grid {
        &self.grid
    }

    pub(super) fn bricks(&self) -> &Bricks {
        &self.bricks
    }

    pub(super) fn carry(&self, level: Level, brick: Brick<'_>, way: &mut Way) {
        let number = brick.seen.brick as usize;
        let values = &self.values[number];
        if self.sampling == Sampling::Planes && way.planes.suits(self.most[number], brick.lit) {
            planes::carry(level, brick, &mut way.rays, &mut way.planes, values);
        } else {
            carry(level, Carry { brick, way, values });
        }
    }

    pub(super) fn record(&self, level: Level, brick: Brick<'_>, way: &mut Way, bins: &mut Bins) {
        record(level, Record { brick, way, bins, values: &self.values[brick.seen.brick as usize] });
    }

    pub(super) fn densities(&self, brick: usize, places: &[DVec3], out: &mut Vec<f32>) {
        let values = &self.values[brick];
        out.extend(places.iter().map(|place| single(at(values, *place))));
    }
}

impl Baked {
    /// The largest density of a brick.
    pub(super) fn majorant(&self, brick: usize) -> f32 {
        self.most[brick]
    }

    /// The largest density of a cell of a brick.
    pub(super) fn majorant_of_cell(&self, brick: usize, [x, y, z]: [usize; 3]) -> f32 {
        let values = &self.values[brick];
        let corner = |n: usize| values[((x + (n >> 2)) * VALUES + y + (n >> 1 & 1)) * VALUES + z + (n & 1)];
        (0..8).fold(0.0, |most, n| corner(n).max(most))
    }

    /// Density times metres over a part of a line in a cell of a brick, exact but for rounding.
    pub(super) fn depth_of_cell(
        &self,
        brick: usize,
        cells: &Cells,
        cell: [usize; 3],
        range: [f64; 2],
    ) -> f64 {
        cells.integral(cell, range, |cell, place| within(&self.values[brick], cell, place))
    }

    pub(super) fn density(&self, spot: &Spot) -> f32 {
        single(at(&self.values[spot.brick], spot.local))
    }

    /// See [`Medium::optical_depth`](super::Medium::optical_depth); it may end once it is `enough`.
    pub(super) fn depth(&self, ray: &Ray, range: [f64; 2], extinction: f64, enough: f64) -> f64 {
        let nodes = self.bricks.nodes();
        let mut walk = Walk::new(nodes, &self.grid.ray(ray), range);
        // Density times metres.
        let (mut sum, enough) = (0.0, enough / extinction);
        while sum < enough
            && let Some(step) = walk.next(nodes)
        {
            let values = &self.values[step.brick];
            let value = |cell, place| within(values, cell, place);
            sum += walk::integral(&walk.line, &step, enough - sum, value);
        }
        sum * extinction
    }
}

/// The density at a place of a brick, in cells from its corner.
fn at(values: &[f32; ALL], place: DVec3) -> f64 {
    let cell = place.floor().clamp(DVec3::ZERO, DVec3::splat(7.0));
    let t = place - cell;
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "whole, 0 to 7")]
    let cell = cell.to_array().map(|c| c as usize);
    within(values, cell, t)
}

/// The density at a place of a cell.
fn within(values: &[f32; ALL], [x, y, z]: [usize; 3], t: DVec3) -> f64 {
    let value = |i: usize, j: usize, k: usize| f64::from(values[((x + i) * VALUES + y + j) * VALUES + z + k]);
    let row = |i, j| value(i, j, 0) + (value(i, j, 1) - value(i, j, 0)) * t.z;
    let plane = |i| row(i, 0) + (row(i, 1) - row(i, 0)) * t.y;
    plane(0) + (plane(1) - plane(0)) * t.x
}

struct Carry<'a> {
    brick: Brick<'a>,
    way: &'a mut Way,
    values: &'a [f32; ALL],
}

#[inline(never)]
fn carry(level: Level, code: Carry<'_>) {
    with_level(level, code);
}

impl WithLevel for Carry<'_> {
    type Output = ();
    #[inline(always)]
    fn run<R: Real<Scalar = f32>>(self, token: R::Token) {
        let Brick { block, seen, wanted, lit } = self.brick;
        let Way { rays, hits, .. } = self.way;
        hits.find::<R>(token, rays, block, seen);
        hits.fill();
        for first in (0..hits.count).step_by(LANES) {
            let group = through_cells::<R>(token, self.values, rays, hits, first, wanted, lit);
            group.finish(rays, hits, first, wanted, lit.lamps);
        }
    }
}

/// Takes a group of rays from cell to cell. Along a ray the density of a cell is a polynomial of degree 3, whose integral
/// Gauss's two samples give.
#[inline(always)]
fn through_cells<R: Real<Scalar = f32>>(
    token: R::Token,
    values: &[f32; ALL],
    rays: &Rays,
    hits: &Hits,
    first: usize,
    wanted: &Wanted,
    lit: &Lit<'_>,
) -> Group<R> {
    let table = Table::<VALUES>(values);
    let mut group = Group::<R>::new(token, rays, hits, first, wanted);
    let (zero, one) = (R::constant(token, 0.0), R::constant(token, 1.0));
    let half = R::constant(token, 0.5);
    // Where the rays cross the next face across each axis, and from there the one after.
    let (mut crossing, mut spacing) = ([zero; 3], [zero; 3]);
    for axis in 0..3 {
        let along = group.direction[axis];
        let place = group.position[axis] + group.at * along;
        let upward = place.floor() + one;
        let downward = -((-place).floor() + one);
        let face = R::select(zero.lt(along), upward, downward);
        let never = R::constant(token, 1e30);
        let stands = along.abs().lt(R::constant(token, 1e-12));
        crossing[axis] = R::select(stands, never, (face - group.position[axis]) / along);
        spacing[axis] = R::select(stands, never, one / along.abs());
    }
    // Shadows are kept for every second cell, about: light is gathered as often.
    let mut is_second = false;
    for _ in 0..MOST_STEPS {
        let going = group.going(token, wanted);
        if R::bitmask(going) == 0 {
            break;
        }
        let next = crossing[0].least(crossing[1]).least(crossing[2]).least(group.end);
        let mut length = R::select(going, next - group.at, zero).most(zero);
        let middle = group.at + length * half;
        let mut place = [zero; 3];
        for axis in 0..3 {
            place[axis] = group.position[axis] + middle * group.direction[axis];
        }
        let cell = Table::<VALUES>::cell(token, place);
        let corners = table.corners(token, cell);
        let mut from = [zero; 3];
        for axis in 0..3 {
            from[axis] = group.position[axis] - cell[axis];
        }
        let mut arrives = going;
        let mut is_dense = false;
        if lit.lamps > 0 {
            let c = &corners.0;
            let most = c[0].most(c[1]).most(c[2].most(c[3])).most(c[4].most(c[5]).most(c[6].most(c[7])));
            let longest = R::constant(token, LONGEST);
            let dense = R::constant(token, 1.5 * LONGEST).lt(most * group.extinction * length);
            is_dense = R::bitmask(dense) != 0;
            if is_dense {
                // From here the density grows by no more than this for a cell's length.
                let slope = most * R::constant(token, 3.0_f64.sqrt()) * group.extinction;
                let here = corners.at(along(&group, &from, group.at)).most(zero) * group.extinction;
                let root = (here * here + (slope + slope) * longest).sqrt();
                let short = (longest + longest) / (here + root);
                // A little at least, or rounding would keep the ray where it is.
                let short = short.most(R::constant(token, 1e-6));
                let divided = R::and(dense, short.lt(length));
                length = R::select(divided, short, length);
                arrives = R::and(going, R::not(divided));
            }
        }
        let near = corners.at(along(&group, &from, group.at + length * R::constant(token, GAUSS[0])));
        let far = corners.at(along(&group, &from, group.at + length * R::constant(token, GAUSS[1])));
        let depth = ((near + far) * length * half * group.extinction).most(zero);
        let depth = R::select(going, depth, zero);
        if is_dense && is_second {
            // What is longer than that already.
            group.gather(token, lit);
        }
        group.pass(token, lit, length, depth, [near, far]);
        // Rays that have reached the face: exactly there, so that rounding does not add up.
        group.at = R::select(arrives, next.most(group.at), group.at);
        for axis in 0..3 {
            let crossed = R::and(arrives, crossing[axis].le(next));
            crossing[axis] = R::select(crossed, crossing[axis] + spacing[axis], crossing[axis]);
        }
        if is_second || is_dense || lit.is_fine() {
            group.gather(token, lit);
        }
        is_second = !(is_second || is_dense);
    }
    group.gather(token, lit);
    group
}

/// Places along the rays, from corners of cells.
#[inline(always)]
fn along<R: Real>(group: &Group<R>, from: &[R; 3], at: R) -> [R; 3] {
    [from[0] + at * group.direction[0], from[1] + at * group.direction[1], from[2] + at * group.direction[2]]
}

struct Record<'a> {
    brick: Brick<'a>,
    way: &'a mut Way,
    bins: &'a mut Bins,
    values: &'a [f32; ALL],
}

#[inline(never)]
fn record(level: Level, code: Record<'_>) {
    with_level(level, code);
}

impl WithLevel for Record<'_> {
    type Output = ();
    #[inline(always)]
    fn run<R: Real<Scalar = f32>>(self, token: R::Token) {
        let Brick { block, seen, wanted, .. } = self.brick;
        let Way { rays, hits, .. } = self.way;
        hits.find::<R>(token, rays, block, seen);
        hits.fill();
        let table = Table::<VALUES>(self.values);
        for first in (0..hits.count).step_by(LANES) {
            let group = Group::<R>::new(token, rays, hits, first, wanted);
            let mut parts = self.bins.parts::<R>(token, hits, first, &group);
            while let Some([begin, length]) = parts.next(token) {
                let mut sum = R::constant(token, 0.0);
                for place in GAUSS {
                    let at = begin + length * R::constant(token, place);
                    let place = along(&group, &group.position, at);
                    let cell = Table::<VALUES>::cell(token, place);
                    let corners = table.corners(token, cell);
                    sum = sum + corners.at([place[0] - cell[0], place[1] - cell[1], place[2] - cell[2]]);
                }
                let depth = sum * length * R::constant(token, 0.5) * group.extinction;
                parts.add(self.bins, hits, depth);
            }
        }
    }
}
