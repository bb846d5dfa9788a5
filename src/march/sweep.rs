//! Shadows of voxels that a sun casts: all of its rays at once, from layer to layer.
//!
//! Along the axis of the grid that the sun shines along most, rays lie at every second voxel of each layer, so that in a layer all of
//! them are at one place of their cells: a sample is a sum of neighbours with the same weights for all. The sums so far are a
//! front that moves through the bricks; each keeps what it needs of it for the depths at every second corner of its cells. Samples are those
//! of [`planes`](super::planes).
//!
//! A sun along an axis has its rays in every second column of voxels all the way: the columns between them cast no shadow. Rays half
//! a voxel beside would see both alike, but none would pass through the points whose depths are kept: of `tornado` (resolution 192)
//! the errors of three suns along axes grew by a seventh, by three quarters and to twice, and of noise with 2.5 voxels to a cell
//! they changed by a tenth at most. Suns a little beside an axis, which see all columns, were off by more than these of `tornado`.

#![allow(clippy::needless_range_loop, reason = "axes are indices into several arrays at once")]

use glam::DVec3;
use rayon::prelude::*;

use super::baked::{ALL, Baked, VALUES};
use super::grid::EDGE;
use super::planes::{FLAT, LAYERS, PLACES, middles};
use super::rays::single;
use super::shade::COARSE;
use crate::num::{Level, Real, WithLevel, with_level};

/// Rays of a brick along an edge.
const SIDE: usize = 4;
/// Points of a brick's table.
pub(super) const POINTS: usize = COARSE * COARSE * COARSE;
/// Rays around a plane of a brick along an edge, between which all points of its table are.
const WIDE: usize = COARSE + 1;
type Window = [[f32; WIDE]; WIDE];
/// No front is larger.
const MOST_RAYS: i64 = 1 << 24;
/// Nor are there more bricks from the first layer to the last.
const MOST_LAYERS: u32 = 1 << 20;
/// Depths are finite, and so are the sums of densities of all layers.
const THICKEST: f64 = 1e30;
const DENSEST: f32 = 1e30;

/// What a brick adds to the front, layer by layer: the densities that its rays meet.
type Added = [[[f32; SIDE]; SIDE]; LAYERS];
/// Bytes of a brick while one sun's front passes, and those that it keeps of each sun's beside a table.
pub(super) const ADDED: u64 = size_of::<Added>() as u64;
pub(super) const KEPT: u64 = size_of::<[Window; COARSE]>() as u64;

/// Where rays are in a layer or in a plane between two: the number of the first that is not before 0, or that is not behind it,
/// and how far from 0 it is.
#[derive(Debug, Clone, Copy)]
struct Shift {
    ray: [i64; 2],
    /// From 0 to 2 of the first that is not before 0, in voxels; from 0 to 1 from that which is not behind it, in rays.
    rest: [f32; 2],
}

/// A sun's rays.
struct Sweep<'a> {
    baked: &'a Baked,
    /// The main axis.
    axis: usize,
    /// Voxels along the others for one along the main axis.
    slope: [f64; 2],
    /// Where rays are at whole numbers of voxels.
    origin: f64,
    level: Level,
}

/// What a sun's rays leave in bricks.
#[derive(Debug)]
pub(super) struct Swept {
    axis: usize,
    /// The optical depth of a layer of density 1.
    thickness: f32,
    /// Of each brick: sums of the rays around its planes at every second layer.
    windows: Vec<[Window; COARSE]>,
    /// How far from the first of them a brick's corner is, in rays: by its coordinate along the axis.
    rests: Vec<[[f32; 2]; COARSE]>,
    /// The lowest coordinate of a brick along the axis, of which the first of `rests` are.
    lowest: i32,
}

/// The shadows of a sun that shines along `direction`, in the world; `None` where bricks are too far from each other for a front.
pub(super) fn sweep(baked: &Baked, direction: DVec3, extinction: f64, level: Level) -> Option<Swept> {
    let grid = baked.grid();
    let along = grid.step_to_grid(direction);
    let size = along.abs();
    let axis = if size.x >= size.y && size.x >= size.z { 0 } else { 1 + usize::from(size.z > size.y) };
    let others = [[1, 2], [0, 2], [0, 1]][axis];
    // A layer's length on the way.
    let layer = along / along[axis];
    let metres = grid.step_to_world(layer).length();
    if !(layer.is_finite() && metres.is_finite()) {
        return None;
    }
    let thickness = single((extinction * metres).min(THICKEST));
    let slope = others.map(|other| layer[other]);
    let blocks = &baked.bricks.blocks;
    let first = blocks.first()?;
    let (mut low, mut high) = (*first, *first);
    for block in blocks {
        for n in 0..3 {
            low[n] = low[n].min(block[n]);
            high[n] = high[n].max(block[n]);
        }
    }
    let origin = f64::from(low[axis]) * f64::from(EDGE);
    let sweep = Sweep { baked, axis, slope, origin, level };
    // Rays of the front: those of all layers.
    let last = (f64::from(high[axis]) + 1.0) * f64::from(EDGE);
    let mut begin = [0_i64; 2];
    let mut count = [0_i64; 2];
    for n in 0..2 {
        let shifts = [origin, last].map(|at| sweep.plane(at).ray[n]);
        begin[n] = i64::from(low[others[n]]) * 4 + shifts[0].min(shifts[1]) - 2;
        count[n] = i64::from(high[others[n]]) * 4 + shifts[0].max(shifts[1]) + 8 - begin[n];
    }
    if count[0].checked_mul(count[1])? > MOST_RAYS || high[axis].abs_diff(low[axis]) > MOST_LAYERS {
        return None;
    }
    let mut order: Vec<usize> = (0..blocks.len()).collect();
    order.sort_by_key(|number| blocks[*number][axis]);
    let mut added = Vec::new();
    (0..blocks.len())
        .into_par_iter()
        .with_min_len(16)
        .map(|number| sweep.add(number))
        .collect_into_vec(&mut added);
    let mut front =
        Front { begin, columns: count[1], sums: vec![0.0; usize::try_from(count[0] * count[1]).ok()?] };
    let mut windows = vec![[[[0.0; WIDE]; WIDE]; COARSE]; blocks.len()];
    let layers = usize::try_from(high[axis].abs_diff(low[axis])).ok()?;
    let mut rests = vec![[[0.0; 2]; COARSE]; layers + 1];
    let is_upward = along[axis] > 0.0;
    let mut layers: Vec<&[usize]> = order.chunk_by(|a, b| blocks[*a][axis] == blocks[*b][axis]).collect();
    if !is_upward {
        layers.reverse();
    }
    for bricks in layers {
        let at = blocks[bricks[0]][axis];
        let corner = f64::from(at) * f64::from(EDGE);
        let rests = &mut rests[at.abs_diff(low[axis]) as usize];
        for step in 0..=LAYERS {
            let at = if is_upward { step } else { LAYERS - step };
            #[allow(clippy::cast_precision_loss, reason = "small")]
            let place = corner + at as f64;
            if at % 2 == 0 {
                let shift = sweep.plane(place);
                for number in bricks {
                    let block = blocks[*number];
                    let first = [0, 1].map(|n| 4 * i64::from(block[others[n]]) + shift.ray[n]);
                    front.copy(first, &mut windows[*number][at / 2]);
                }
                rests[at / 2] = shift.rest;
            }
            if step < LAYERS {
                let layer = if is_upward { at } else { at - 1 };
                #[allow(clippy::cast_precision_loss, reason = "small")]
                let shift = sweep.layer(corner + layer as f64 + 0.5);
                for number in bricks {
                    let block = blocks[*number];
                    let first = [0, 1].map(|n| 4 * i64::from(block[others[n]]) + shift.ray[n]);
                    front.add(first, &added[*number][layer]);
                }
            }
        }
    }
    Some(Swept { axis, thickness, windows, rests, lowest: low[axis] })
}

impl Swept {
    /// The optical depths at the points of a brick's table.
    pub(super) fn table(&self, number: usize, block: [i32; 3], table: &mut [f32; POINTS]) {
        let strides = [[25, 5, 1], [5, 25, 1], [1, 25, 5]][self.axis];
        let rests = &self.rests[block[self.axis].abs_diff(self.lowest) as usize];
        for plane in 0..COARSE {
            let (window, [p, q]) = (&self.windows[number][plane], rests[plane]);
            let mut between = [[0.0; COARSE]; WIDE];
            for i in 0..WIDE {
                for j in 0..COARSE {
                    between[i][j] = window[i][j] + (window[i][j + 1] - window[i][j]) * q;
                }
            }
            for i in 0..COARSE {
                for j in 0..COARSE {
                    let depth = between[i][j] + (between[i + 1][j] - between[i][j]) * p;
                    let to = plane * strides[0] + i * strides[1] + j * strides[2];
                    let depth = depth * self.thickness;
                    table[to] = if depth < DENSEST { depth } else { DENSEST };
                }
            }
        }
    }
}

impl Sweep<'_> {
    /// In the middle of a layer.
    fn layer(&self, at: f64) -> Shift {
        self.shift(at, |off| {
            let ray = (-0.5 * off).ceil();
            (ray, off + 2.0 * ray)
        })
    }

    /// In a plane between layers.
    fn plane(&self, at: f64) -> Shift {
        self.shift(at, |off| {
            let ray = (-0.5 * off).floor();
            (ray, -0.5 * off - ray)
        })
    }

    fn shift(&self, at: f64, of: impl Fn(f64) -> (f64, f64)) -> Shift {
        let mut shift = Shift { ray: [0; 2], rest: [0.0; 2] };
        for n in 0..2 {
            let (ray, rest) = of(self.slope[n] * (at - self.origin));
            #[allow(
                clippy::cast_possible_truncation,
                reason = "whole, and no more than voxels along an axis"
            )]
            let ray = ray as i64;
            (shift.ray[n], shift.rest[n]) = (ray, single(rest));
        }
        shift
    }

    fn add(&self, number: usize) -> Added {
        let corner = f64::from(self.baked.bricks.blocks[number][self.axis]) * f64::from(EDGE);
        let shifts = std::array::from_fn(|layer| {
            #[allow(clippy::cast_precision_loss, reason = "small")]
            let at = corner + layer as f64 + 0.5;
            self.layer(at).rest
        });
        add(self.level, Add { values: &self.baked.values[number], axis: self.axis, shifts })
    }
}

struct Add<'a> {
    values: &'a [f32; ALL],
    axis: usize,
    shifts: [[f32; 2]; LAYERS],
}

#[inline(never)]
fn add(level: Level, code: Add<'_>) -> Added {
    with_level(level, code)
}

impl WithLevel for Add<'_> {
    type Output = Added;
    // No lanes, but loops over rows.
    #[inline(always)]
    fn run<R: Real<Scalar = f32>>(self, _: R::Token) -> Added {
        let mut flat = [0.0_f32; FLAT];
        middles(self.values, self.axis, &mut flat);
        for value in &mut flat {
            *value = if *value < DENSEST { *value } else { DENSEST };
        }
        let mut added = [[[0.0; SIDE]; SIDE]; LAYERS];
        for layer in 0..LAYERS {
            // The second cell, or the first.
            let [p, q] = self.shifts[layer];
            let (row, p) = if p < 1.0 { (0, p) } else { (1, p - 1.0) };
            let (column, q) = if q < 1.0 { (0, q) } else { (1, q - 1.0) };
            for i in 0..SIDE {
                let at = layer * PLACES + (row + 2 * i) * VALUES;
                let mut between = [0.0_f32; VALUES];
                for n in 0..VALUES {
                    between[n] = flat[at + n] + (flat[at + VALUES + n] - flat[at + n]) * p;
                }
                for j in 0..SIDE {
                    let n = column + 2 * j;
                    added[layer][i][j] = between[n] + (between[n + 1] - between[n]) * q;
                }
            }
        }
        added
    }
}

/// The sums of all rays so far.
struct Front {
    /// The number of the first ray.
    begin: [i64; 2],
    columns: i64,
    sums: Vec<f32>,
}

impl Front {
    fn at(&self, [row, column]: [i64; 2]) -> usize {
        // The front holds all rays of all layers.
        usize::try_from((row - self.begin[0]) * self.columns + column - self.begin[1]).unwrap_or(0)
    }

    fn add(&mut self, [row, column]: [i64; 2], added: &[[f32; SIDE]; SIDE]) {
        for (i, terms) in (0..).zip(added) {
            let at = self.at([row + i, column]);
            for (sum, term) in self.sums[at..at + SIDE].iter_mut().zip(terms) {
                *sum += term;
            }
        }
    }

    fn copy(&self, [row, column]: [i64; 2], window: &mut Window) {
        for (i, to) in (0..).zip(window) {
            let at = self.at([row + i, column]);
            to.copy_from_slice(&self.sums[at..at + WIDE]);
        }
    }
}
