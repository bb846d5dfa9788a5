//! Voxels plane by plane: how their pictures are made unless every cell is asked for.
//!
//! Of the axes of the grid, rays that are close together go along one most: there, one sample is taken in every layer of cells, of
//! the density and of the light that arrives, as they are in the layer's middle. Along that axis nothing is between two samples
//! but a cell, and the other two axes take four values to interpolate. Sums over whole voxels are exact for what is linear, and for
//! what is smooth over more than two voxels their errors cancel along the ray, as those of the trapezoidal rule do (Trefethen and
//! Weideman, "The exponentially convergent trapezoidal rule", 2014); nothing is shifted. Of a layer that a ray is in two bricks in,
//! each takes its part of the ray, in the middle of that part, so that bricks that are too dense for one sample a layer are
//! integrated cell by cell beside others.

#![allow(clippy::needless_range_loop, reason = "lanes and axes are indices into several arrays at once")]

use super::baked::{ALL, VALUES};
use super::grid::EDGE;
use super::medium::Brick;
use super::rays::{LANES, RAYS, Rays, boxed, groups, single};
use super::shade::{Lit, Wanted};
use super::tiles::Seen;
use crate::num::{Level, Real, WithLevel, with_level};
use crate::scene::MOST_LAMPS;

/// Rays that go along the main axis by less than this part of their length are not taken along it.
const STEEPEST: f64 = 0.5;
/// The optical depth of a sample at most: above it, the source would change too much within a layer.
const DEEPEST: f32 = 0.5;
/// Layers of a brick, and places where each has values.
pub(super) const LAYERS: usize = 8;
pub(super) const PLACES: usize = VALUES * VALUES;
/// All of them, in whole groups of lanes.
pub(super) const FLAT: usize = (LAYERS * PLACES).next_multiple_of(LANES);
/// Two tables, their values in turn.
const PAIRED: usize = 2 * FLAT;
/// Pairs of tables: the density and the first lamp, the second and the third, and so on.
const PAIRS: usize = 1 + MOST_LAMPS / 2;
/// Numbers are kept with this added, so that their bits end with those of the whole number.
const OFFSET: f64 = 8_388_608.0;
/// Packed stores write whole lanes.
const ROOM: usize = RAYS + LANES;

/// The axis that a tile's rays go along most.
#[derive(Debug, Clone, Copy)]
struct Main {
    axis: usize,
    /// The others, in order.
    others: [usize; 2],
    is_upward: bool,
    /// The largest optical depth of a layer of density 1.
    thickest: f32,
}

/// The rays of a tile as lines over their main axis, and those that meet a brick.
pub(super) struct Planes {
    main: Option<Main>,
    /// Where each ray is on the other axes at 0 on the main one, how far it goes there for a cell, and one over that.
    start: [Box<[f64; RAYS]>; 2],
    slope: [Box<[f64; RAYS]>; 2],
    inverse: [Box<[f64; RAYS]>; 2],
    /// Where on the main axis each begins.
    origin: Box<[f64; RAYS]>,
    /// Of each ray in turn: how far it goes on the other axes for a layer, the optical depth of a layer of density 1, and nothing.
    forms: Box<[f32; 4 * RAYS]>,
    count: usize,
    /// Of those that meet a brick, packed: their numbers in the tile, the first layer, between which places on the main axis they
    /// are in the brick, and where they are on the others in the middle of the brick's lowest layer, from which places count.
    ray: Box<[f32; ROOM]>,
    first: Box<[f32; ROOM]>,
    range: [Box<[f32; ROOM]>; 2],
    place: [Box<[f32; ROOM]>; 2],
    tables: Box<[[f32; PAIRED]; PAIRS]>,
}

impl Default for Planes {
    fn default() -> Planes {
        let zeros = |_| boxed(0.0);
        Planes {
            main: None,
            start: std::array::from_fn(zeros),
            slope: std::array::from_fn(zeros),
            inverse: std::array::from_fn(zeros),
            origin: boxed(0.0),
            forms: boxed(0.0),
            count: 0,
            ray: boxed(0.0),
            first: boxed(0.0),
            range: std::array::from_fn(|_| boxed(0.0)),
            place: std::array::from_fn(|_| boxed(0.0)),
            tables: boxed([0.0; PAIRED]),
        }
    }
}

impl Planes {
    /// Takes a tile's new rays.
    pub(super) fn begin(&mut self, rays: &Rays, wanted: &Wanted) {
        self.main = None;
        let mut sums = [0.0; 3];
        let alive = |ray: usize| rays.alive[ray / LANES] >> (ray % LANES) & 1 == 1;
        for ray in (0..RAYS).filter(|ray| alive(*ray)) {
            for axis in 0..3 {
                sums[axis] += rays.direction[axis][ray].abs();
            }
        }
        let axis =
            if sums[0] >= sums[1] && sums[0] >= sums[2] { 0 } else { 1 + usize::from(sums[2] > sums[1]) };
        let others = [[1, 2], [0, 2], [0, 1]][axis];
        let Some(first) = (0..RAYS).find(|ray| alive(*ray)) else { return };
        let along = &rays.direction[axis];
        let is_upward = along[first] > 0.0;
        let is_along = |ray: usize| along[ray].abs() >= STEEPEST && (along[ray] > 0.0) == is_upward;
        if (0..RAYS).any(|ray| alive(ray) && !is_along(ray)) {
            return;
        }
        // Those that there are not, too: nothing asks for what comes out.
        self.origin.copy_from_slice(&rays.origin[axis][..]);
        for n in 0..2 {
            for ray in 0..RAYS {
                let slope = rays.direction[others[n]][ray] / along[ray];
                self.slope[n][ray] = slope;
                self.inverse[n][ray] = along[ray] * rays.inverse[others[n]][ray];
                self.start[n][ray] = rays.origin[others[n]][ray] - rays.origin[axis][ray] * slope;
            }
        }
        let (forms, _) = self.forms.as_chunks_mut::<4>();
        let mut thickest = 0.0_f32;
        for ray in 0..RAYS {
            let cells = rays.inverse[axis][ray].abs();
            let thickness = single(wanted.extinction * f64::from(rays.metres[ray]) * cells);
            forms[ray] = [single(self.slope[0][ray]), single(self.slope[1][ray]), thickness, 0.0];
            if alive(ray) {
                thickest = thickest.max(thickness);
            }
        }
        self.main = Some(Main { axis, others, is_upward, thickest });
    }

    /// Whether a brick that is nowhere denser than this can be taken in planes.
    pub(super) fn suits(&self, most: f32, lit: &Lit<'_>) -> bool {
        let fits = |main: Main| most * main.thickest <= DEEPEST;
        self.main.is_some_and(fits) && !lit.has_points() && lit.exact.is_none()
    }
}

/// A brick, and the rays that are carried through it.
struct Carry<'a> {
    brick: Brick<'a>,
    rays: &'a mut Rays,
    planes: &'a mut Planes,
    values: &'a [f32; ALL],
}

/// Carries a tile's rays through a brick that [suits](Planes::suits).
pub(super) fn carry(
    level: Level,
    brick: Brick<'_>,
    rays: &mut Rays,
    planes: &mut Planes,
    values: &[f32; ALL],
) {
    run(level, Carry { brick, rays, planes, values });
}

#[inline(never)]
fn run(level: Level, code: Carry<'_>) {
    with_level(level, code);
}

impl WithLevel for Carry<'_> {
    type Output = ();
    #[inline(always)]
    fn run<R: Real<Scalar = f32>>(self, token: R::Token) {
        let Brick { block, seen, wanted, lit } = self.brick;
        let Some(main) = self.planes.main else { return };
        self.planes.find::<R>(token, self.rays, block, seen, main);
        if self.planes.count == 0 {
            return;
        }
        self.planes.fill();
        prepare::<R>(token, self.values, lit, main, &mut self.planes.tables);
        for first in (0..self.planes.count).step_by(LANES) {
            through::<R>(token, self.rays, self.planes, first, block, main, wanted, lit);
        }
    }
}

impl Planes {
    /// Finds the rays that have samples in a brick.
    #[inline(always)]
    fn find<R: Real<Scalar = f32>>(
        &mut self,
        token: R::Token,
        rays: &Rays,
        block: [i32; 3],
        seen: &Seen,
        main: Main,
    ) {
        self.count = 0;
        for group in groups(seen) {
            let wanted = rays.wanted(seen, group);
            if wanted != 0 {
                self.meet::<R>(token, block, group, wanted, main);
            }
        }
    }

    #[inline(always)]
    fn meet<R: Real<Scalar = f32>>(
        &mut self,
        token: R::Token,
        block: [i32; 3],
        group: usize,
        wanted: u32,
        main: Main,
    ) {
        let first = group * LANES;
        let corner = block.map(|c| f64::from(c) * f64::from(EDGE));
        // The middle of the lowest layer.
        let base = corner[main.axis] + 0.5;
        // Between which places on the main axis a ray is in the brick: found in double precision and in the same way by bricks that
        // meet in a face, so that nothing is in both. None is before its ray's origin.
        let (mut begin, mut end) = ([f64::NEG_INFINITY; LANES], [f64::INFINITY; LANES]);
        let origin = &self.origin[first..first + LANES];
        for lane in 0..LANES {
            if main.is_upward {
                begin[lane] = origin[lane];
            } else {
                end[lane] = origin[lane];
            }
        }
        let zero = R::constant(token, 0.0);
        let mut places = [zero; 2];
        for n in 0..2 {
            let low = corner[main.others[n]];
            let high = low + f64::from(EDGE);
            let start = &self.start[n][first..first + LANES];
            let slope = &self.slope[n][first..first + LANES];
            let inverse = &self.inverse[n][first..first + LANES];
            let mut place = [0.0_f32; LANES];
            for lane in 0..LANES {
                // Not a number where a ray lies in a face's plane: it is not less and not more than anything, which keeps
                // such a ray in the brick below the plane and out of that above.
                let near = (low - start[lane]) * inverse[lane];
                let far = (high - start[lane]) * inverse[lane];
                let enters = if near < far { near } else { far };
                let leaves = if near > far { near } else { far };
                begin[lane] = if enters > begin[lane] { enters } else { begin[lane] };
                end[lane] = if leaves < end[lane] { leaves } else { end[lane] };
                place[lane] = single((start[lane] - low) + slope[lane] * base);
            }
            places[n] = R::load(token, &place);
        }
        let (mut enters, mut leaves) = ([0.0; LANES], [0.0; LANES]);
        for lane in 0..LANES {
            enters[lane] = single(begin[lane] - base);
            leaves[lane] = single(end[lane] - base);
        }
        let half = R::constant(token, 0.5);
        let (low, high) = (-half, R::constant(token, to_f64(LAYERS)) - half);
        let from = R::load(token, &enters).within(low, high);
        let to = R::load(token, &leaves).within(low, high);
        let met = R::and(from.lt(to), R::from_bitmask(token, wanted));
        let bits = R::bitmask(met);
        if bits == 0 {
            return;
        }
        let at = self.count;
        let one = R::constant(token, 1.0);
        let numbers = R::load(token, &NUMBERS) + R::constant(token, OFFSET + to_f64(first));
        numbers.compress(met).store(&mut self.ray[at..]);
        let layer = if main.is_upward { (from + half).floor() } else { -(-to - half).floor() - one };
        layer.compress(met).store(&mut self.first[at..]);
        from.compress(met).store(&mut self.range[0][at..]);
        to.compress(met).store(&mut self.range[1][at..]);
        places[0].compress(met).store(&mut self.place[0][at..]);
        places[1].compress(met).store(&mut self.place[1][at..]);
        self.count += bits.count_ones() as usize;
    }

    /// Fills the last group's unused lanes with rays that have no samples.
    #[inline(always)]
    fn fill(&mut self) {
        for lane in self.count..self.count.next_multiple_of(LANES) {
            self.ray[lane] = single(OFFSET);
            self.first[lane] = 0.0;
            self.range[0][lane] = 0.0;
            self.range[1][lane] = 0.0;
            self.place[0][lane] = 0.0;
            self.place[1][lane] = 0.0;
        }
    }

    /// The number in its tile of the ray in a lane.
    #[inline(always)]
    fn ray(&self, at: usize) -> usize {
        self.ray[at % ROOM].to_bits() as usize % RAYS
    }
}

const NUMBERS: [f32; LANES] =
    [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0, 10.0, 11.0, 12.0, 13.0, 14.0, 15.0];

/// Puts together what is sampled: in the middle of each layer, at the corners of its cells, the density and what comes through
/// from each lamp.
#[inline(always)]
fn prepare<R: Real<Scalar = f32>>(
    token: R::Token,
    values: &[f32; ALL],
    lit: &Lit<'_>,
    main: Main,
    tables: &mut [[f32; PAIRED]; PAIRS],
) {
    let mut flats = [[0.0_f32; FLAT]; 2];
    middles(values, main.axis, &mut flats[0]);
    // The density and the first, the second and the third, and so on.
    for pair in 0..=lit.lamps / 2 {
        for which in usize::from(pair == 0)..2 {
            let (lamp, flat) = (2 * pair + which - 1, &mut flats[which]);
            if lamp < lit.lamps {
                lit.middles(lamp, main.axis, flat);
                for at in (0..FLAT).step_by(LANES) {
                    let depth = R::load(token, &flat[at..at + LANES]);
                    let light = (depth * R::constant(token, -std::f64::consts::LOG2_E)).exp2(token);
                    light.store(&mut flat[at..at + LANES]);
                }
            }
        }
        let (pairs, _) = tables[pair].as_chunks_mut::<2>();
        for n in 0..FLAT {
            pairs[n] = [flats[0][n], flats[1][n]];
        }
    }
}

/// The values in the middle between those at the corners of cells, along an axis; that axis slowest, the others in order.
#[inline(always)]
pub(super) fn middles(values: &[f32; ALL], axis: usize, flat: &mut [f32; FLAT]) {
    match axis {
        0 => {
            for n in 0..LAYERS * PLACES {
                flat[n] = 0.5 * (values[n] + values[n + PLACES]);
            }
        }
        1 => {
            // Rows are written whole lanes at a time; those behind them come later.
            let mut rows = [0.0_f32; LAYERS * VALUES + LANES];
            for x in 0..VALUES {
                let plane = &values[x * PLACES..][..PLACES];
                for n in 0..LAYERS * VALUES {
                    rows[n] = 0.5 * (plane[n] + plane[n + VALUES]);
                }
                for layer in 0..LAYERS {
                    let to = (layer * VALUES + x) * VALUES;
                    let row = &rows[layer * VALUES..][..LANES];
                    if x + 1 < VALUES {
                        flat[to..to + LANES].copy_from_slice(row);
                    } else {
                        flat[to..to + VALUES].copy_from_slice(&row[..VALUES]);
                    }
                }
            }
        }
        _ => {
            for place in 0..PLACES {
                let row: &[f32; VALUES] =
                    values[place * VALUES..][..VALUES].try_into().unwrap_or(&[0.0; VALUES]);
                for layer in 0..LAYERS {
                    flat[layer * PLACES + place] = 0.5 * (row[layer] + row[layer + 1]);
                }
            }
        }
    }
}

/// The same of every second value along each axis, between which they are linear: those in the middles of all cells.
#[inline(always)]
pub(super) fn coarse_middles(values: &[f32; 125], axis: usize, flat: &mut [f32; FLAT]) {
    let strides = [[25, 5, 1], [5, 25, 1], [1, 25, 5]][axis];
    // At every second plane first, along one axis after the other.
    let mut planes = [[0.0_f32; PLACES]; 5];
    for (layer, plane) in planes.iter_mut().enumerate() {
        let mut rows = [[0.0_f32; VALUES]; 5];
        for (p, row) in rows.iter_mut().enumerate() {
            let first = layer * strides[0] + p * strides[1];
            for q in 0..5 {
                row[2 * q] = values[first + q * strides[2]];
            }
            for q in 0..4 {
                row[2 * q + 1] = 0.5 * (row[2 * q] + row[2 * q + 2]);
            }
        }
        for p in 0..5 {
            plane[2 * p * VALUES..][..VALUES].copy_from_slice(&rows[p]);
        }
        for p in 0..4 {
            for q in 0..VALUES {
                plane[(2 * p + 1) * VALUES + q] = 0.5 * (rows[p][q] + rows[p + 1][q]);
            }
        }
    }
    for layer in 0..LAYERS {
        // A quarter of the way, or three quarters.
        let far = if layer % 2 == 0 { 0.25 } else { 0.75 };
        let (near, next) = (&planes[layer / 2], &planes[layer / 2 + 1]);
        let to = &mut flat[layer * PLACES..][..PLACES];
        for n in 0..PLACES {
            to[n] = near[n] + (next[n] - near[n]) * far;
        }
    }
}

/// Takes a group of rays from layer to layer.
#[inline(always)]
#[allow(clippy::too_many_arguments, reason = "what a brick is")]
fn through<R: Real<Scalar = f32>>(
    token: R::Token,
    rays: &mut Rays,
    planes: &Planes,
    first: usize,
    block: [i32; 3],
    main: Main,
    wanted: &Wanted,
    lit: &Lit<'_>,
) {
    let (zero, one) = (R::constant(token, 0.0), R::constant(token, 1.0));
    let (mut numbers, mut before) = ([0_usize; LANES], [0.0; LANES]);
    for lane in 0..LANES {
        let ray = planes.ray(first + lane);
        numbers[lane] = ray;
        before[lane] = single(rays.depth[ray]);
    }
    let before = R::load(token, &before);
    let ray = R::load(token, &planes.ray[first..first + LANES]) - R::constant(token, OFFSET);
    let form = R::runs(token, &planes.forms, (ray * R::constant(token, 4.0)).lattice());
    let (slopes, thickness) = ([form[0], form[1]], form[2]);
    let places = [
        R::load(token, &planes.place[0][first..first + LANES]),
        R::load(token, &planes.place[1][first..first + LANES]),
    ];
    let mut layer = R::load(token, &planes.first[first..first + LANES]);
    let from = R::load(token, &planes.range[0][first..first + LANES]);
    let to = R::load(token, &planes.range[1][first..first + LANES]);
    let step = if main.is_upward { one } else { -one };
    let mut through = (before * R::constant(token, -std::f64::consts::LOG2_E)).exp2(token);
    let mut depth = zero;
    let mut light = [zero; MOST_LAMPS];
    let (half, ln_2) = (R::constant(token, 0.5), R::constant(token, std::f64::consts::LN_2));
    let may_cross = R::bitmask(before.lt(ln_2)) != 0;
    let (edge, last) = (R::constant(token, 8.0), R::constant(token, 7.0));
    let row = R::constant(token, to_f64(VALUES));
    let next_row = R::bits_splat(token, 2 * 9);
    for _ in 0..LAYERS {
        let (begin, end) = (from.most(layer - half), to.least(layer + half));
        let going = begin.lt(end);
        if R::bitmask(going) == 0 {
            break;
        }
        let middle = (begin + end) * half;
        // Rounding may take a place a little beyond the brick.
        let p = (places[0] + middle * slopes[0]).within(zero, edge);
        let q = (places[1] + middle * slopes[1]).within(zero, edge);
        let (cell_p, cell_q) = (p.floor().least(last), q.floor().least(last));
        let (p, q) = (p - cell_p, q - cell_q);
        let at = (layer * row + cell_p) * row + cell_q;
        let at = R::select(going, at + at, zero).lattice();
        let below = R::bits_add(at, next_row);
        let [density, shine] = sample::<R>(token, &planes.tables[0], [at, below], p, q);
        let thick = R::select(going, density * thickness * (end - begin), zero);
        // 1 - e^-x, whose next term is below 2e-6 of it up to the deepest sample.
        let mut opacity = R::constant(token, 1.0 / 720.0);
        for c in [-1.0 / 120.0, 1.0 / 24.0, -1.0 / 6.0, 0.5, -1.0] {
            opacity = opacity * thick + R::constant(token, c);
        }
        let lost = through * opacity * -thick;
        if lit.lamps > 0 {
            light[0] = light[0] + lost * shine;
        }
        for lamp in (1..lit.lamps).step_by(2) {
            let shine = sample::<R>(token, &planes.tables[lamp.div_ceil(2)], [at, below], p, q);
            light[lamp] = light[lamp] + lost * shine[0];
            if lamp + 1 < MOST_LAMPS {
                light[lamp + 1] = light[lamp + 1] + lost * shine[1];
            }
        }
        if may_cross {
            let seen = before + depth;
            let crosses = R::bitmask(R::and(seen.lt(ln_2), ln_2.le(seen + thick)));
            if crosses != 0 {
                let mut crossed = [0.0; LANES];
                let way = (end - begin) * (ln_2 - seen) / thick;
                (if main.is_upward { begin + way } else { end - way }).store(&mut crossed);
                for lane in (0..LANES).filter(|lane| crosses >> lane & 1 == 1) {
                    let ray = numbers[lane];
                    let within = 0.5 + f64::from(crossed[lane]);
                    let place = f64::from(block[main.axis]) * f64::from(EDGE) + within;
                    rays.half[ray] = (place - planes.origin[ray]) / rays.direction[main.axis][ray];
                }
            }
        }
        through = through - lost;
        depth = depth + thick;
        layer = layer + step;
    }
    let count = LANES.min(planes.count - first);
    let mut found = [0.0; LANES];
    depth.store(&mut found);
    for lane in 0..count {
        let ray = numbers[lane];
        rays.depth[ray] += f64::from(found[lane]);
        if rays.depth[ray] >= wanted.deepest {
            rays.alive[ray / LANES] &= !(1 << (ray % LANES));
        }
    }
    for lamp in 0..lit.lamps {
        light[lamp].store(&mut found);
        for lane in 0..count {
            rays.light[lamp][numbers[lane]] += f64::from(found[lane]);
        }
    }
}

/// Both values of a pair of tables at places of a layer.
#[inline(always)]
fn sample<R: Real<Scalar = f32>>(
    token: R::Token,
    pair: &[f32; PAIRED],
    [above, below]: [R::Bits; 2],
    p: R,
    q: R,
) -> [R; 2] {
    let [a, b, c, d] = R::runs(token, pair, above);
    let [e, f, g, h] = R::runs(token, pair, below);
    let (near, far) = (a + (c - a) * q, e + (g - e) * q);
    let (other_near, other_far) = (b + (d - b) * q, f + (h - f) * q);
    [near + (far - near) * p, other_near + (other_far - other_near) * p]
}

#[inline(always)]
#[allow(clippy::cast_precision_loss, reason = "small")]
fn to_f64(number: usize) -> f64 {
    number as f64
}
