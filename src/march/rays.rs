//! A tile's rays, and those of them that meet a brick.

#![allow(clippy::needless_range_loop, reason = "lanes and axes are indices into several arrays at once")]

use std::ops::Range;

use glam::DVec3;

use super::camera::Ray;
use super::grid::{EDGE, Grid};
use super::tiles::{Seen, TILE};
use crate::num::Real;
use crate::scene::MOST_LAMPS;

/// Lanes that a group of rays fills.
pub(super) const LANES: usize = 16;
/// Rays of a tile.
pub(super) const RAYS: usize = TILE * TILE;
const GROUPS: usize = RAYS / LANES;
/// Groups of a row.
const ROW: usize = TILE / LANES;
/// Packed stores write whole lanes.
const ROOM: usize = RAYS + LANES;

/// The rays of a tile, in rows of pixels from the top, and what was found along them so far. Lengths are in cells.
pub(super) struct Rays {
    pub(super) origin: [Box<[f64; RAYS]>; 3],
    pub(super) direction: [Box<[f64; RAYS]>; 3],
    /// One over each coordinate of the direction.
    pub(super) inverse: [Box<[f64; RAYS]>; 3],
    /// Metres for a unit of length.
    pub(super) metres: Box<[f32; RAYS]>,
    /// Those that still see something, a bit each.
    pub(super) alive: [u32; GROUPS],
    /// Optical depth.
    pub(super) depth: Box<[f64; RAYS]>,
    /// The distance at which half of the light is left; infinite where more is left.
    pub(super) half: Box<[f64; RAYS]>,
    /// What each lamp's light, were it of colour 1 and the albedo 1, adds.
    pub(super) light: [Box<[f64; RAYS]>; MOST_LAMPS],
}

pub(super) fn boxed<T: Copy, const N: usize>(value: T) -> Box<[T; N]> {
    Box::new([value; N])
}

impl Default for Rays {
    fn default() -> Rays {
        let zeros = |_| boxed(0.0);
        Rays {
            origin: std::array::from_fn(zeros),
            direction: std::array::from_fn(zeros),
            inverse: std::array::from_fn(zeros),
            metres: boxed(0.0),
            alive: [0; GROUPS],
            depth: boxed(0.0),
            half: boxed(f64::INFINITY),
            light: std::array::from_fn(zeros),
        }
    }
}

impl Rays {
    /// New rays, lit by so many lamps; a pixel without is `None`.
    pub(super) fn begin(&mut self, grid: &Grid, lamps: usize, rays: impl Iterator<Item = Option<Ray>>) {
        self.alive = [0; GROUPS];
        self.depth.fill(0.0);
        self.half.fill(f64::INFINITY);
        for light in self.light.iter_mut().take(lamps) {
            light.fill(0.0);
        }
        for (number, ray) in rays.enumerate().take(RAYS) {
            let Some(ray) = ray else { continue };
            let ray = grid.ray(&ray);
            for axis in 0..3 {
                self.origin[axis][number] = ray.origin[axis];
                self.direction[axis][number] = ray.direction[axis];
                self.inverse[axis][number] = 1.0 / ray.direction[axis];
            }
            #[allow(clippy::cast_possible_truncation, reason = "a factor of single precision")]
            let metres = ray.metres as f32;
            self.metres[number] = metres;
            self.alive[number / LANES] |= 1 << (number % LANES);
        }
    }

    /// A ray, in cells; `None` where there is none, or where it sees nothing more.
    pub(super) fn ray(&self, number: usize) -> Option<Ray> {
        let is_alive = self.alive[number / LANES] >> (number % LANES) & 1 == 1;
        let of = |all: &[Box<[f64; RAYS]>; 3]| DVec3::from([0, 1, 2].map(|axis| all[axis][number]));
        is_alive.then(|| Ray { origin: of(&self.origin), direction: of(&self.direction) })
    }

    /// Of a group of rays those that still see something, in the columns in which a brick is seen, a bit each.
    #[inline(always)]
    pub(super) fn wanted(&self, seen: &Seen, group: usize) -> u32 {
        let [left, right] = seen.columns.map(u32::from);
        let columns = (1_u64 << (right + 1)) - (1_u64 << left);
        #[allow(clippy::cast_possible_truncation, reason = "sixteen bits")]
        let columns = (columns >> (LANES * (group % ROW))) as u32 & 0xffff;
        columns & self.alive[group % GROUPS]
    }

    pub(super) fn is_done(&self) -> bool {
        self.alive.iter().all(|alive| *alive == 0)
    }
}

/// The groups of rays in the rows in which a brick is seen.
#[inline(always)]
pub(super) fn groups(seen: &Seen) -> Range<usize> {
    let [top, bottom] = seen.rows.map(usize::from);
    ROW * top..(ROW * (bottom + 1)).min(GROUPS)
}

/// The rays that meet a brick, packed. Positions and lengths are in cells, from the brick's corner, and along a ray from
/// the place where it is nearest to the brick's centre.
pub(super) struct Hits {
    pub(super) count: usize,
    /// Numbers of rays in their tile.
    pub(super) ray: Box<[f32; ROOM]>,
    pub(super) position: [Box<[f32; ROOM]>; 3],
    pub(super) direction: [Box<[f32; ROOM]>; 3],
    pub(super) begin: Box<[f32; ROOM]>,
    pub(super) end: Box<[f32; ROOM]>,
    /// Where along each ray of the tile that place is.
    pub(super) middle: Box<[f64; RAYS]>,
    /// 0, 1, ... 15.
    numbers: [f32; LANES],
}

impl Default for Hits {
    fn default() -> Hits {
        let zeros = |_| boxed(0.0);
        let mut numbers = [0.0; LANES];
        for (number, value) in (0_u8..).zip(&mut numbers) {
            *value = f32::from(number);
        }
        Hits {
            count: 0,
            ray: boxed(0.0),
            position: std::array::from_fn(zeros),
            direction: std::array::from_fn(zeros),
            begin: boxed(0.0),
            end: boxed(0.0),
            middle: boxed(0.0),
            numbers,
        }
    }
}

impl Hits {
    /// The number in its tile of the ray in a lane.
    #[inline(always)]
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "whole and below 1024")]
    pub(super) fn ray(&self, at: usize) -> usize {
        self.ray[at % ROOM] as usize % RAYS
    }

    /// Finds them.
    #[inline(always)]
    pub(super) fn find<R: Real<Scalar = f32>>(
        &mut self,
        token: R::Token,
        rays: &Rays,
        block: [i32; 3],
        seen: &Seen,
    ) {
        self.count = 0;
        for group in groups(seen) {
            let wanted = rays.wanted(seen, group);
            if wanted != 0 {
                self.meet::<R>(token, rays, block, group, wanted);
            }
        }
    }

    #[inline(always)]
    fn meet<R: Real<Scalar = f32>>(
        &mut self,
        token: R::Token,
        rays: &Rays,
        block: [i32; 3],
        group: usize,
        wanted: u32,
    ) {
        let first = group * LANES;
        let centre = block.map(|c| (f64::from(c) + 0.5) * f64::from(EDGE));
        let mut middle = [0.0; LANES];
        for axis in 0..3 {
            let origin = &rays.origin[axis][first..first + LANES];
            let direction = &rays.direction[axis][first..first + LANES];
            for lane in 0..LANES {
                middle[lane] += (centre[axis] - origin[lane]) * direction[lane];
            }
        }
        self.middle[first..first + LANES].copy_from_slice(&middle);
        // Between the brick's faces, in double precision: a ray that hardly leaves a face's plane may be on either side.
        // None begins before its origin.
        let (mut begin, mut end) = ([0.0; LANES], [f64::INFINITY; LANES]);
        let zero = R::constant(token, 0.0);
        let mut positions = [zero; 3];
        let mut directions = [zero; 3];
        for axis in 0..3 {
            let origin = &rays.origin[axis][first..first + LANES];
            let direction = &rays.direction[axis][first..first + LANES];
            let inverse = &rays.inverse[axis][first..first + LANES];
            let [low, high] = [-0.5, 0.5].map(|side| centre[axis] + side * f64::from(EDGE));
            let mut position = [0.0_f32; LANES];
            let mut along = [0.0_f32; LANES];
            for lane in 0..LANES {
                // Not a number where a ray lies in a face's plane: it is not less and not more than anything, which keeps
                // such a ray in the brick below the plane and out of that above.
                let near = (low - origin[lane]) * inverse[lane];
                let far = (high - origin[lane]) * inverse[lane];
                let enters = if near < far { near } else { far };
                let leaves = if near > far { near } else { far };
                begin[lane] = if enters > begin[lane] { enters } else { begin[lane] };
                end[lane] = if leaves < end[lane] { leaves } else { end[lane] };
                position[lane] = single((origin[lane] - low) + middle[lane] * direction[lane]);
                along[lane] = single(direction[lane]);
            }
            positions[axis] = R::load(token, &position);
            directions[axis] = R::load(token, &along);
        }
        let (mut enters, mut leaves) = ([0.0; LANES], [0.0; LANES]);
        for lane in 0..LANES {
            enters[lane] = single(begin[lane] - middle[lane]);
            leaves[lane] = single(end[lane] - middle[lane]);
        }
        let (begin, end) = (R::load(token, &enters), R::load(token, &leaves));
        let met = R::and(begin.lt(end), R::from_bitmask(token, wanted));
        let bits = R::bitmask(met);
        if bits == 0 {
            return;
        }
        let to = self.count;
        let numbers = R::load(token, &self.numbers) + R::constant(token, 16.0 * to_f64(group));
        numbers.compress(met).store(&mut self.ray[to..]);
        for axis in 0..3 {
            positions[axis].compress(met).store(&mut self.position[axis][to..]);
            directions[axis].compress(met).store(&mut self.direction[axis][to..]);
        }
        begin.compress(met).store(&mut self.begin[to..]);
        end.compress(met).store(&mut self.end[to..]);
        self.count += bits.count_ones() as usize;
    }

    /// Fills the last group's unused lanes with its last ray, cut down to nothing: what is worked out together must follow
    /// from the rays that meet the brick alone.
    #[inline(always)]
    pub(super) fn fill(&mut self) {
        let Some(last) = self.count.checked_sub(1) else { return };
        for lane in self.count..self.count.next_multiple_of(LANES) {
            self.ray[lane] = self.ray[last];
            for axis in 0..3 {
                self.position[axis][lane] = self.position[axis][last];
                self.direction[axis][lane] = self.direction[axis][last];
            }
            self.begin[lane] = self.begin[last];
            self.end[lane] = self.begin[last];
        }
    }
}

#[inline(always)]
fn to_f64(number: usize) -> f64 {
    #[allow(clippy::cast_precision_loss, reason = "small")]
    let number = number as f64;
    number
}

#[inline(always)]
#[allow(clippy::cast_possible_truncation, reason = "rounding is meant")]
pub(super) fn single(x: f64) -> f32 {
    x as f32
}
