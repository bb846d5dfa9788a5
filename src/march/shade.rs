//! The light that rays gather within a brick, segment by segment, in lanes.

#![allow(clippy::needless_range_loop, reason = "lanes and axes are indices into several arrays at once")]

use glam::DVec3;

use super::exact::{Towards, first_half};
use super::grid::{EDGE, Grid};
use super::optics::{Lamp, Optics};
use super::planes::{FLAT, coarse_middles, middles};
use super::rays::{Hits, LANES, Rays, single};
use super::segment::Weights;
use super::table::{Table, trilinear};
use crate::num::Real;
use crate::scene::MOST_LAMPS;

/// Points of a brick's shadow table along an edge: the corners of all cells, or of cubes of 2^3 cells.
pub(super) const FINE: usize = 9;
/// See [`FINE`].
pub(super) const COARSE: usize = 5;
/// Where the source changes, segments are divided until their optical depth is about this.
pub(super) const LONGEST: f64 = 0.7;

/// What a picture asks of every ray.
#[derive(Debug, Clone, Copy)]
pub(super) struct Wanted {
    /// Rays of this optical depth have seen everything.
    pub(super) deepest: f64,
    /// Extinction per metre at density 1.
    pub(super) extinction: f64,
}

/// The lamps as a brick sees them.
#[derive(Clone)]
pub(super) struct Lit<'a> {
    pub(super) lamps: usize,
    /// The optical depth towards each lamp, at the points of the brick's table.
    shadows: [&'a [f32]; MOST_LAMPS],
    /// Points of these tables along an edge.
    edge: usize,
    /// From a point to the brick's corner, in metres; `None` for suns.
    points: [Option<[f32; 3]>; MOST_LAMPS],
    /// Columns: metres in the world for a cell along each axis.
    cell: [[f32; 3]; 3],
    anisotropy: f32,
    /// Where no table is to be read.
    pub(super) exact: Option<&'a Towards<'a>>,
}

impl<'a> Lit<'a> {
    /// With the tables of all lamps, one after the other, of so many points along an edge.
    pub(super) fn new(
        optics: &Optics,
        grid: &Grid,
        block: [i32; 3],
        shadows: &'a [f32],
        edge: usize,
    ) -> Lit<'a> {
        let corner = grid.to_world(DVec3::from(block.map(|c| f64::from(c) * f64::from(EDGE))));
        let zero = grid.to_world(DVec3::ZERO);
        let mut lit = Lit {
            lamps: optics.lamps.len().min(MOST_LAMPS),
            shadows: [&[]; MOST_LAMPS],
            edge,
            points: [None; MOST_LAMPS],
            cell: DVec3::AXES.map(|axis| (grid.to_world(axis) - zero).to_array().map(single)),
            anisotropy: single(optics.anisotropy),
            exact: None,
        };
        let tables = shadows.chunks_exact(edge * edge * edge).map(Some).chain(std::iter::repeat(None));
        for ((lamp, table), (shadow, point)) in
            optics.lamps.iter().zip(tables).zip(lit.shadows.iter_mut().zip(&mut lit.points))
        {
            *shadow = table.unwrap_or(&[]);
            if let Lamp::Point { position, .. } = lamp {
                *point = Some((corner - *position).to_array().map(single));
            }
        }
        lit
    }
}

impl Lit<'_> {
    /// Whether a lamp is near, so that its light changes with the distance.
    pub(super) fn has_points(&self) -> bool {
        self.points.iter().any(Option::is_some)
    }

    /// The optical depth towards a lamp in the middles of cells along an axis: see [`middles`].
    #[inline(always)]
    pub(super) fn middles(&self, lamp: usize, axis: usize, flat: &mut [f32; FLAT]) {
        let table = self.shadows[lamp];
        if let Ok(table) = table.try_into() {
            middles(table, axis, flat);
        } else if let Ok(table) = table.try_into() {
            coarse_middles(table, axis, flat);
        } else {
            flat.fill(0.0);
        }
    }

    /// Whether shadows are kept for every cell.
    #[inline(always)]
    pub(super) fn is_fine(&self) -> bool {
        self.edge == FINE
    }
}

/// A group of rays on their way through a brick. Lengths are in cells.
pub(super) struct Group<R> {
    pub(super) position: [R; 3],
    pub(super) direction: [R; 3],
    pub(super) end: R,
    /// How far the rays have come.
    pub(super) at: R,
    /// Optical depth of a cell of density 1.
    pub(super) extinction: R,
    /// Optical depth, and transmittance, from where they began to see to the brick.
    pub(super) before: R,
    dimmed: R,
    /// From there to where they are.
    pub(super) depth: R,
    pub(super) transmittance: R,
    /// What lamps add, dimmed from the brick's edge.
    pub(super) light: [R; MOST_LAMPS],
    /// How far the lamps' light is gathered, and the optical depth up to there.
    gathered: R,
    gathered_depth: R,
    /// The lamps' light there, if `is_known`; with exact shadows, the optical depths towards them.
    pub(super) source: [R; MOST_LAMPS],
    pub(super) is_known: bool,
    /// With exact shadows: the part of the next segment's optical depth that its first half has.
    pub(super) first: R,
    half: R,
    /// Metres for a cell, along each ray.
    metres: R,
}

impl<R: Real<Scalar = f32>> Group<R> {
    #[inline(always)]
    pub(super) fn new(token: R::Token, rays: &Rays, hits: &Hits, first: usize, wanted: &Wanted) -> Group<R> {
        let (zero, one) = (R::constant(token, 0.0), R::constant(token, 1.0));
        let (mut before, mut metres) = ([0.0; LANES], [0.0; LANES]);
        for lane in 0..LANES {
            let ray = hits.ray(first + lane);
            before[lane] = single(rays.depth[ray]);
            metres[lane] = rays.metres[ray];
        }
        let metres = R::load(token, &metres);
        let before = R::load(token, &before);
        let load = |from: &[f32]| R::load(token, &from[first..first + LANES]);
        let begin = load(&hits.begin[..]);
        Group {
            position: [load(&hits.position[0][..]), load(&hits.position[1][..]), load(&hits.position[2][..])],
            direction: [
                load(&hits.direction[0][..]),
                load(&hits.direction[1][..]),
                load(&hits.direction[2][..]),
            ],
            end: load(&hits.end[..]),
            at: begin,
            extinction: metres * R::constant(token, wanted.extinction),
            before,
            dimmed: (before * R::constant(token, -std::f64::consts::LOG2_E)).exp2(token),
            depth: zero,
            transmittance: one,
            light: [zero; MOST_LAMPS],
            gathered: begin,
            gathered_depth: zero,
            source: [zero; MOST_LAMPS],
            is_known: false,
            first: R::constant(token, 0.5),
            half: R::constant(token, 1e30),
            metres,
        }
    }

    /// Begins farther on.
    #[inline(always)]
    pub(super) fn start(&mut self, at: R) {
        self.at = at;
        self.gathered = at;
    }

    /// Goes on by `length` through a segment with the optical depth `depth`; both are 0 in lanes that have arrived.
    #[inline(always)]
    pub(super) fn go(&mut self, token: R::Token, length: R, depth: R) {
        // Nothing is seen behind so much, and what follows stays finite.
        let depth = depth.least(R::constant(token, 1e30));
        // Where half of the light is left; within a segment the depth is taken to grow evenly.
        let half = R::constant(token, std::f64::consts::LN_2);
        let seen = self.before + self.depth;
        let crosses = R::and(seen.lt(half), half.le(seen + depth));
        if R::bitmask(crosses) != 0 {
            let part = (half - seen) / depth;
            self.half = R::select(crosses, self.at + part * length, self.half);
        }
        self.depth = self.depth + depth;
        self.at = self.at + length;
    }

    /// As [`Group::go`], with the densities at Gauss's places; where shadows are exact, the lamps' light is gathered.
    #[inline(always)]
    pub(super) fn pass(&mut self, token: R::Token, lit: &Lit<'_>, length: R, depth: R, densities: [R; 2]) {
        if let Some(towards) = lit.exact {
            let zero = R::constant(token, 0.0);
            if R::bitmask(zero.lt(depth)) == 0 {
                self.is_known = false;
            } else {
                self.first = first_half(token, densities[0], densities[1]);
                self.gather_exactly(token, lit, towards, length, depth.least(R::constant(token, 1e30)));
            }
        }
        self.go(token, length, depth);
    }

    /// Adds the lamps' light from all segments since this was last done, as one.
    #[inline(always)]
    pub(super) fn gather(&mut self, token: R::Token, lit: &Lit<'_>) {
        if lit.lamps == 0 || lit.exact.is_some() {
            return;
        }
        let zero = R::constant(token, 0.0);
        let depth = self.depth - self.gathered_depth;
        if R::bitmask(zero.lt(depth)) == 0 {
            self.gathered = self.at;
            self.is_known = false;
            return;
        }
        let weights = Weights::new(token, depth);
        for lamp in 0..lit.lamps {
            let near =
                if self.is_known { self.source[lamp] } else { self.lamp(token, lit, lamp, self.gathered) };
            let far = self.lamp(token, lit, lamp, self.at);
            let gathered = near * weights.near + far * weights.far;
            self.light[lamp] = self.light[lamp] + self.transmittance * gathered;
            self.source[lamp] = far;
        }
        self.is_known = true;
        self.transmittance = self.transmittance * weights.transmittance;
        self.gathered = self.at;
        self.gathered_depth = self.depth;
    }

    /// The light of a lamp that arrives at a place along the rays and leaves towards the eye; of suns without the phase
    /// function.
    #[inline(always)]
    pub(super) fn lamp(&self, token: R::Token, lit: &Lit<'_>, lamp: usize, at: R) -> R {
        let mut place = self.position;
        for axis in 0..3 {
            place[axis] = place[axis] + at * self.direction[axis];
        }
        let mut light = R::constant(token, 1.0);
        if !lit.shadows[lamp].is_empty() {
            let depth = if lit.edge == FINE {
                trilinear(token, &Table::<FINE>(lit.shadows[lamp]), place)
            } else {
                let half = R::constant(token, 0.5);
                let place = [place[0] * half, place[1] * half, place[2] * half];
                trilinear(token, &Table::<COARSE>(lit.shadows[lamp]), place)
            };
            // A place that rounding takes past a cell may be past the end of a steep slope, too.
            let depth = depth.most(R::constant(token, 0.0));
            light = (depth * R::constant(token, -std::f64::consts::LOG2_E)).exp2(token);
        }
        let Some(corner) = lit.points[lamp] else { return light };
        // From the lamp, and along the ray, in metres.
        let zero = R::constant(token, 0.0);
        let (mut from, mut along) = ([zero; 3], [zero; 3]);
        for axis in 0..3 {
            from[axis] = R::splat(token, corner[axis]);
            for column in 0..3 {
                let metres = R::splat(token, lit.cell[column][axis]);
                from[axis] = from[axis] + metres * place[column];
                along[axis] = along[axis] + metres * self.direction[column];
            }
        }
        let squared = from[0] * from[0] + from[1] * from[1] + from[2] * from[2];
        let squared = squared.most(R::constant(token, 1e-30));
        let distance = squared.sqrt();
        // The sum of both, of length 1, since light leaves against the ray.
        let mut apart = zero;
        for axis in 0..3 {
            let sum = from[axis] / distance + along[axis] / self.metres;
            apart = apart + sum * sum;
        }
        let g = lit.anisotropy;
        let narrow = R::splat(token, (1.0 - g) * (1.0 - g)) + apart * R::splat(token, g);
        let phase = R::splat(token, (1.0 - g * g) / (4.0 * std::f32::consts::PI)) / (narrow * narrow.sqrt());
        light * phase / squared
    }

    /// Lanes that are not through, and still see something.
    #[inline(always)]
    pub(super) fn going(&self, token: R::Token, wanted: &Wanted) -> R::Mask {
        let deepest = R::constant(token, wanted.deepest);
        R::and(self.at.lt(self.end), (self.before + self.depth).lt(deepest))
    }

    /// Hands what was found over to the tile.
    #[inline(always)]
    pub(super) fn finish(&self, rays: &mut Rays, hits: &Hits, first: usize, wanted: &Wanted, lamps: usize) {
        let mut depth = [0.0; LANES];
        self.depth.store(&mut depth);
        let count = LANES.min(hits.count - first);
        for lane in 0..count {
            let ray = hits.ray(first + lane);
            rays.depth[ray] += f64::from(depth[lane]);
            if rays.depth[ray] >= wanted.deepest {
                rays.alive[ray / LANES] &= !(1 << (ray % LANES));
            }
        }
        let mut half = [0.0; LANES];
        self.half.store(&mut half);
        for lane in 0..count {
            let ray = hits.ray(first + lane);
            if half[lane] < 1e29 {
                rays.half[ray] = hits.middle[ray] + f64::from(half[lane]);
            }
        }
        for lamp in 0..lamps {
            let mut light = [0.0; LANES];
            (self.light[lamp] * self.dimmed).store(&mut light);
            for lane in 0..count {
                rays.light[lamp][hits.ray(first + lane)] += f64::from(light[lane]);
            }
        }
    }
}
