//! How much light of a lamp arrives where: optical depths along rays from it, kept in steps.
//!
//! Rays leave a lamp as if it were a camera, two cells apart, and keep their optical depth at every two cells' length; in
//! between it is linear, along the rays and from ray to ray.

use std::sync::OnceLock;

use glam::{DVec2, DVec3};
use rayon::prelude::*;

use super::baked::{Baked, Sampling};
use super::bins::Bins;
use super::camera::Camera;
use super::grid::{EDGE, Grid};
use super::medium::{Brick, Medium, Way};
use super::optics::{Lamp, Optics};
use super::procedural::Worker;
use super::rays::{RAYS, single};
use super::shade::{COARSE, FINE, Lit, Wanted};
use super::sweep::{Swept, sweep};
use super::tiles::{TILE, Tiles};
use crate::num::{Level, Real, WithLevel, with_level};

/// Cells between rays where shadows of suns can be swept.
const SECOND: f64 = 2.0;
/// Rays along an edge of a map at most.
const MOST_RAYS: f64 = 4096.0;
/// Depths that a map keeps, about, at most.
const MOST_DEPTHS: f64 = 6e7;
/// Pieces of a ray at most.
const MOST_PIECES: f64 = 8192.0;
/// Beyond this nothing is lit.
const DEEPEST: f64 = 80.0;

/// The optical depths along the rays of one camera that is a lamp.
#[derive(Debug)]
struct Map {
    camera: Camera,
    size: [usize; 2],
    /// Metres for a piece, and from the camera to the first of a tile.
    step: f64,
    /// Of each ray: where its depths begin, the number of its first piece that has any, and their number.
    rays: Vec<(usize, u32, u32)>,
    /// After each piece, from the lamp on.
    depths: Vec<f32>,
}

/// What is kept of a lamp.
#[derive(Debug)]
enum Shadow {
    /// One map of a sun, up to six of a point.
    Maps(Vec<Map>),
    /// What a sun's rays leave in every brick.
    Swept(Swept),
}

/// The shadows of all lamps.
#[derive(Debug)]
pub(super) struct Shadows {
    lamps: Vec<Shadow>,
    /// Points of a brick's table along an edge.
    pub(super) edge: usize,
}

impl Shadows {
    /// Along rays that are `pitch` cells apart.
    pub(super) fn new(medium: &Medium<'_>, optics: &Optics, pitch: f64, level: Level) -> Shadows {
        let (asked, pitch) = (pitch, spread(medium, pitch));
        let lamps = optics
            .lamps
            .iter()
            .map(|lamp| {
                if let Some((baked, direction)) = may_be_swept(medium, lamp, asked)
                    && let Some(swept) = sweep(baked, direction, optics.extinction, level)
                {
                    return Shadow::Swept(swept);
                }
                let cameras = cameras(lamp, medium.grid(), medium.bricks().bounds(), pitch);
                let map = |(camera, rays, step, pieces)| {
                    Map::new(medium, camera, rays, step, pieces, optics.extinction, level)
                };
                Shadow::Maps(cameras.into_iter().map(map).collect())
            })
            .collect();
        Shadows { lamps, edge: if pitch < 2.0 { FINE } else { COARSE } }
    }

    /// Bytes that these take at most, while they are found, and then with the tables of all bricks; but for those of suns that
    /// are swept.
    pub(super) fn bytes(medium: &Medium<'_>, optics: &Optics, pitch: f64) -> [u64; 2] {
        let (step, edge) = (spread(medium, pitch), if spread(medium, pitch) < 2.0 { FINE } else { COARSE });
        let (mut making, mut kept) = (0, 0);
        for lamp in &optics.lamps {
            if may_be_swept(medium, lamp, pitch).is_some() {
                continue;
            }
            for (camera, size, step, pieces) in cameras(lamp, medium.grid(), medium.bricks().bounds(), step) {
                let [found, map] = Map::bytes(medium, &camera, size, step);
                let bins = size_of::<f32>() * RAYS * pieces * rayon::current_num_threads();
                making = making.max(kept + found + bins as u64);
                kept += map;
            }
        }
        /// Beside the values of a table: where it is, and what allocators keep to themselves.
        const TABLE: usize = size_of::<OnceLock<Box<[f32]>>>() + 16;
        let tables = size_of::<f32>() * edge * edge * edge * optics.lamps.len() + TABLE;
        [making, kept + (tables * medium.brick_count()) as u64]
    }

    /// The optical depths towards each lamp at the points of a brick's table.
    pub(super) fn table(&self, grid: &Grid, number: usize, block: [i32; 3], level: Level) -> Box<[f32]> {
        let edge = 8.0;
        let corner = DVec3::from(block.map(|c| f64::from(c) * edge));
        let first = grid.to_world(corner);
        #[allow(clippy::cast_precision_loss, reason = "small")]
        let step = edge / (self.edge - 1) as f64;
        let steps = DVec3::AXES.map(|axis| grid.to_world(corner + axis * step) - first);
        let points = self.edge * self.edge * self.edge;
        let mut table = vec![0.0; points * self.lamps.len()];
        for (lamp, table) in self.lamps.iter().zip(table.chunks_exact_mut(points)) {
            match lamp {
                Shadow::Maps(maps) => fill(level, Fill { maps, first, steps, edge: self.edge, table }),
                Shadow::Swept(swept) => {
                    if let Ok(table) = table.try_into() {
                        swept.table(number, block, table);
                    }
                }
            }
        }
        table.into()
    }
}

/// Cells between rays for which so many are asked for: more where there would be too many depths.
fn spread(medium: &Medium<'_>, pitch: f64) -> f64 {
    // Rays pass all cells, and what is between them and some beside them counts too.
    #[allow(clippy::cast_precision_loss, reason = "a bound")]
    let depths = 1.5 * 512.0 * medium.brick_count() as f64 / (pitch * pitch * pitch);
    pitch * libm::cbrt((depths / MOST_DEPTHS).max(1.0))
}

/// Voxels, and the direction of a sun whose rays may be swept through them.
fn may_be_swept<'a>(medium: &'a Medium<'_>, lamp: &Lamp, pitch: f64) -> Option<(&'a Baked, DVec3)> {
    match (medium, lamp) {
        (Medium::Baked(baked), Lamp::Sun { direction, .. })
            if baked.sampling == Sampling::Planes && pitch == SECOND =>
        {
            Some((baked, *direction))
        }
        _ => None,
    }
}

/// The optical depths from a lamp to the points of a table.
struct Fill<'a> {
    maps: &'a [Map],
    first: DVec3,
    steps: [DVec3; 3],
    edge: usize,
    table: &'a mut [f32],
}

#[inline(never)]
fn fill(level: Level, code: Fill<'_>) {
    with_level(level, code);
}

impl WithLevel for Fill<'_> {
    type Output = ();
    // No lanes, but instructions for rounding that not every processor has.
    #[inline(always)]
    fn run<R: Real<Scalar = f32>>(self, _: R::Token) {
        let mut row = self.first;
        let mut at = 0;
        for _ in 0..self.edge {
            let mut column = row;
            for _ in 0..self.edge {
                let mut point = column;
                for _ in 0..self.edge {
                    self.table[at] = depth(self.maps, point);
                    point += self.steps[2];
                    at += 1;
                }
                column += self.steps[1];
            }
            row += self.steps[0];
        }
    }
}

/// The cameras of a lamp, with the rays of each, the length of a piece in metres and the number of pieces.
fn cameras(
    lamp: &Lamp,
    grid: &Grid,
    bounds: Option<[DVec3; 2]>,
    pitch: f64,
) -> Vec<(Camera, [usize; 2], f64, usize)> {
    let Some([low, high]) = bounds else { return Vec::new() };
    let corners: [DVec3; 8] = std::array::from_fn(|n| {
        let pick = |axis: usize| if n >> axis & 1 == 1 { high[axis] } else { low[axis] };
        grid.to_world(DVec3::new(pick(0), pick(1), pick(2)))
    });
    let centre = corners.iter().sum::<DVec3>() / 8.0;
    let pitch = pitch * grid.cell();
    match lamp {
        Lamp::Sun { direction, .. } => {
            let right = direction.any_orthonormal_vector();
            let up = right.cross(*direction);
            let reach =
                |axis: DVec3| corners.iter().map(|c| (*c - centre).dot(axis).abs()).fold(0.0, f64::max);
            let [across, above, deep] = [right, up, *direction].map(reach);
            let pitch = pitch.max(2.0 * across.max(above) / MOST_RAYS);
            let rays = |reach: f64| (2.0 * reach / pitch).ceil() + 3.0;
            let [columns, rows] = [rays(across), rays(above)];
            let camera = Camera {
                eye: centre - *direction * deep,
                forward: *direction,
                right,
                up,
                half: DVec2::new(columns, rows) * 0.5 * pitch,
                is_orthographic: true,
            };
            let step = pitch.max(2.0 * deep / MOST_PIECES);
            vec![(camera, [whole(columns), whole(rows)], step, whole((2.0 * deep / step).ceil()) + 1)]
        }
        Lamp::Point { position, .. } => {
            let farthest = corners.iter().map(|c| c.distance(*position)).fold(0.0, f64::max);
            let across = corners.iter().map(|c| c.distance(centre)).fold(0.0, f64::max);
            // Rays are as far apart as asked for at the middle of what they light.
            let middle = centre.distance(*position).max(0.5 * across);
            let rays = (2.0 * middle / pitch).ceil().clamp(16.0, 0.25 * MOST_RAYS);
            let step = pitch.max(farthest / MOST_PIECES);
            let pieces = whole((farthest / step).ceil()) + 1;
            let sides = DVec3::AXES.into_iter().flat_map(|axis| [axis, -axis]);
            sides
                .map(|forward| {
                    let right = forward.any_orthonormal_vector();
                    let camera = Camera {
                        eye: *position,
                        forward,
                        right,
                        up: right.cross(forward),
                        // Beyond the border by a ray, so that there are rays on both sides of it.
                        half: DVec2::splat(rays / (rays - 2.0)),
                        is_orthographic: false,
                    };
                    (camera, [whole(rays); 2], step, pieces)
                })
                .collect()
        }
    }
}

/// How far from a camera a brick begins and ends, in metres along rays.
fn extent(camera: &Camera, grid: &Grid, block: [i32; 3]) -> [f64; 2] {
    let half = 0.5 * f64::from(EDGE);
    let middle =
        grid.to_world(DVec3::from(block.map(|c| f64::from(EDGE) * f64::from(c) + half))) - camera.eye;
    let steps = DVec3::AXES.map(|axis| grid.step_to_world(half * axis));
    let (middle, reach): (f64, f64) = if camera.is_orthographic {
        (middle.dot(camera.forward), steps.iter().map(|step| step.dot(camera.forward).abs()).sum())
    } else {
        (middle.length(), steps.iter().map(|step| step.length()).sum())
    };
    [middle - reach, middle + reach]
}

#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "whole and small")]
fn whole(x: f64) -> usize {
    x as usize
}

impl Map {
    /// Bytes that it takes at most while it is found, and then.
    fn bytes(medium: &Medium<'_>, camera: &Camera, size: [usize; 2], step: f64) -> [u64; 2] {
        /// Of a ray with depths, beside them: in a tile, with what allocators keep to themselves.
        const FOUND: u64 = size_of::<(u32, Vec<f32>)>() as u64 + 16;
        let (grid, bricks) = (medium.grid(), medium.bricks());
        let tiles = Tiles::new(camera, size, grid, bricks);
        let pieces: u64 = (0..tiles.count())
            .into_par_iter()
            .map_init(
                || vec![[f64::INFINITY, f64::NEG_INFINITY]; RAYS],
                |ends, tile| {
                    ends.fill([f64::INFINITY, f64::NEG_INFINITY]);
                    for seen in tiles.seen(tile) {
                        let [near, far] = extent(camera, grid, bricks.blocks[seen.brick as usize]);
                        for row in seen.rows[0]..=seen.rows[1] {
                            let row = &mut ends[usize::from(row) * TILE..][..TILE];
                            for ends in &mut row[usize::from(seen.columns[0])..=usize::from(seen.columns[1])]
                            {
                                *ends = [ends[0].min(near), ends[1].max(far)];
                            }
                        }
                    }
                    let pieces =
                        |[near, far]: &[f64; 2]| if near < far { whole((far - near) / step) + 2 } else { 0 };
                    ends.iter().map(pieces).sum::<usize>() as u64
                },
            )
            .sum();
        let rays = (tiles.count() * RAYS) as u64;
        let [finding, held] = tiles.bytes(bricks.blocks.len());
        let depths = size_of::<f32>() as u64 * pieces;
        let kept = size_of::<(usize, u32, u32)>() as u64 * rays + depths;
        // Of every ray, and then of all.
        [finding.max(held + FOUND * rays + depths + kept), kept]
    }

    fn new(
        medium: &Medium<'_>,
        camera: Camera,
        size: [usize; 2],
        step: f64,
        pieces: usize,
        extinction: f64,
        level: Level,
    ) -> Map {
        let tiles = Tiles::new(&camera, size, medium.grid(), medium.bricks());
        let wanted = Wanted { deepest: DEEPEST, extinction };
        let dark = Optics {
            extinction,
            is_clear: false,
            albedo: DVec3::ZERO,
            anisotropy: 0.0,
            emission: DVec3::ZERO,
            lamps: Vec::new(),
            ambient: DVec3::ZERO,
        };
        let found: Vec<Vec<(u32, Vec<f32>)>> = (0..tiles.count())
            .into_par_iter()
            .with_max_len(1)
            .map_init(
                || (Way::default(), Bins::default(), Worker::default()),
                |(way, bins, worker), tile| {
                    let seen = tiles.seen(tile);
                    if seen.is_empty() {
                        return Vec::new();
                    }
                    way.rays.begin(medium.grid(), 0, tiles.rays(tile, &camera, DVec2::splat(0.5)));
                    bins.begin(&way.rays, step, pieces);
                    for seen in seen {
                        let block = medium.bricks().blocks[seen.brick as usize];
                        let lit = Lit::new(&dark, medium.grid(), block, &[], COARSE);
                        let brick = Brick { block, seen, wanted: &wanted, lit: &lit };
                        medium.record(level, brick, way, bins, worker);
                    }
                    (0..RAYS).map(|ray| running(bins.of(ray))).collect()
                },
            )
            .collect();
        let count = found.iter().flatten().map(|(_, depths)| depths.len()).sum();
        let mut map = Map {
            camera,
            size,
            step,
            rays: vec![(0, 0, 0); size[0] * size[1]],
            depths: Vec::with_capacity(count),
        };
        for (tile, rays) in found.into_iter().enumerate() {
            let corner = tiles.corner(tile);
            for (number, (first, depths)) in rays.into_iter().enumerate() {
                let [x, y] = [corner[0] + number % TILE, corner[1] + number / TILE];
                if x < size[0] && y < size[1] && !depths.is_empty() {
                    let count = u32::try_from(depths.len()).unwrap_or(0);
                    map.rays[y * size[0] + x] = (map.depths.len(), first, count);
                    map.depths.extend(depths);
                }
            }
        }
        map
    }

    /// The optical depth from the lamp to a point, if it is in the map's part of space.
    #[inline(always)]
    fn depth(&self, point: DVec3) -> Option<f32> {
        let to = point - self.camera.eye;
        let forward = to.dot(self.camera.forward);
        let mut across = to.dot(self.camera.right) / self.camera.half.x;
        let mut above = to.dot(self.camera.up) / self.camera.half.y;
        let mut distance = forward;
        if !self.camera.is_orthographic {
            // A little beyond the right angle: which of two maps is taken on their border does not matter.
            if to.abs().max_element() > forward * (1.0 + 1e-9) {
                return None;
            }
            (across, above) = (across / forward, above / forward);
            distance = to.length();
        }
        #[allow(clippy::cast_precision_loss, reason = "small")]
        let rays = [self.size[0] as f64, self.size[1] as f64];
        let x = (0.5 * (across + 1.0) * rays[0] - 0.5).clamp(0.0, rays[0] - 1.0);
        let y = (0.5 * (1.0 - above) * rays[1] - 0.5).clamp(0.0, rays[1] - 1.0);
        let [left, top] = [whole(x).min(self.size[0] - 2), whole(y).min(self.size[1] - 2)];
        #[allow(clippy::cast_precision_loss, reason = "small")]
        let [s, t] = [x - left as f64, y - top as f64];
        let pieces = distance / self.step;
        let first = top * self.size[0] + left;
        let above = self.along(first, pieces) * (1.0 - s) + self.along(first + 1, pieces) * s;
        let first = first + self.size[0];
        let below = self.along(first, pieces) * (1.0 - s) + self.along(first + 1, pieces) * s;
        Some(single(above * (1.0 - t) + below * t))
    }

    /// The optical depth along a ray, so many pieces from its origin.
    #[inline(always)]
    fn along(&self, ray: usize, pieces: f64) -> f64 {
        let (start, first, count) = self.rays[ray];
        let local = pieces - f64::from(first);
        if count == 0 || local <= 0.0 {
            return 0.0;
        }
        let depths = &self.depths[start..start + count as usize];
        let piece = whole(local).min(depths.len());
        let before = if piece == 0 { 0.0 } else { f64::from(depths[piece - 1]) };
        if piece == depths.len() {
            return before;
        }
        #[allow(clippy::cast_precision_loss, reason = "small")]
        let part = local - piece as f64;
        before + (f64::from(depths[piece]) - before) * part
    }
}

/// The sums of pieces from the first on that is not 0 to the last.
fn running(depths: &[f32]) -> (u32, Vec<f32>) {
    let Some(first) = depths.iter().position(|depth| *depth > 0.0) else { return (0, Vec::new()) };
    let last = depths.iter().rposition(|depth| *depth > 0.0).unwrap_or(first);
    let mut sum = 0.0_f64;
    let sums = depths[first..=last]
        .iter()
        .map(|depth| {
            sum += f64::from(*depth);
            single(sum)
        })
        .collect();
    (u32::try_from(first).unwrap_or(0), sums)
}

/// The optical depth from a lamp to a point.
#[inline(always)]
fn depth(maps: &[Map], point: DVec3) -> f32 {
    for map in maps {
        if let Some(depth) = map.depth(point) {
            return depth;
        }
    }
    0.0
}
