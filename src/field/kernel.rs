//! The density of a block of voxels: the one kernel, written over [`Real`].
//!
//! Each piece of a [`Region`] is worked through in three passes over the block, so that the first pass's chains of
//! dependent operations overlap, and so that the last and dearest pass runs over full lanes only:
//!
//! 1. *feet*: the parameter of every voxel's foot;
//! 2. *coordinates*: (u, v, l) and the envelope there; voxels outside the tube drop out, the rest are packed;
//! 3. *layers*: the pattern over the packed voxels.

use super::fractal::{fractal, pack_places};
use super::join::{self, Joint};
use super::region::{FOOT, LayerKind, Piece, ROWS, Region, SECOND, Search, U, V};
use super::{EDGE, VOXELS};
use crate::num::poly::TERMS;
use crate::num::{Real, Scalar};
use crate::scene::{Op, Radial};

/// Newton steps that every voxel gets.
const STEPS: usize = 3;
/// Steps after which a batch with a voxel that has not converged goes to bisection.
const MOST_STEPS: usize = 9;
/// Halvings of a piece: past the precision of `f32` over a piece of 32 voxels.
const HALVINGS: usize = 26;
/// How far past a piece's ends, which are at -1 and 1, Newton's method may go.
const PAST: f64 = 1.25;
/// Density is divided by no less than this where space narrows towards the focal set.
pub(super) const LEAST_NARROWING: f64 = 0.05;
/// Parameter of a voxel that has no foot in the piece.
const NO_FOOT: f64 = 1e30;
/// Scratch arrays are this long: packed stores write whole lanes.
const ROOM: usize = VOXELS + 16;

/// Where the density of a block is evaluated.
#[derive(Debug, Clone, Copy)]
pub enum Places<'a, T> {
    /// The centres of the block's voxels, z fastest.
    Centres,
    /// Points of the block: x, y and z in voxels from its centre.
    Points([&'a [T; VOXELS]; 3]),
}

/// Memory for one thread's evaluation.
#[derive(Debug, Clone)]
pub struct Scratch<T> {
    eta: Vec<T>,
    pub(super) u: Vec<T>,
    pub(super) v: Vec<T>,
    pub(super) height: Vec<T>,
    pub(super) weight: Vec<T>,
    /// Voxels inside, a word for each batch of lanes.
    pub(super) inside: Vec<u32>,
    /// Radius and squared distance to the axis over it: only where octaves fade or feet are told apart.
    pub(super) radius: Vec<T>,
    pub(super) q: Vec<T>,
    /// The focal fade: only where feet are told apart.
    pub(super) focal: Vec<T>,
    pub(super) joint: Joint<T>,
    /// Place in voxels from the block's centre: only where layers ask for it.
    pub(super) place: [Vec<T>; 3],
    /// The coordinates of a layer where its warp displaces them.
    pub(super) displaced: [Vec<T>; 3],
    /// 0, 1, ... 15.
    pub(super) numbers: Vec<T>,
}

impl<T: Scalar> Default for Scratch<T> {
    fn default() -> Scratch<T> {
        let room = || vec![T::default(); ROOM];
        Scratch {
            eta: room(),
            u: room(),
            v: room(),
            height: room(),
            weight: room(),
            inside: vec![0; VOXELS],
            radius: room(),
            q: room(),
            focal: room(),
            joint: Joint::default(),
            place: [room(), room(), room()],
            displaced: [room(), room(), room()],
            numbers: (0..16_u8).map(|i| T::from_f64(f64::from(i))).collect(),
        }
    }
}

/// How many voxels, counted once for every piece, went how far.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Counts {
    /// Entered the search for feet.
    pub searched: u64,
    /// Went through bisection: pieces not certified to hold one foot at most, or where Newton's method did not settle.
    pub bisected: u64,
    /// Have a foot and lie inside the tube.
    pub inside: u64,
    /// Have several feet on one axis; counted once.
    pub several: u64,
    /// Lie inside a tube but beyond its focal set, where its distance to the axis has a local maximum; counted once.
    pub beyond: u64,
}

impl Counts {
    /// Adds those of another block.
    pub fn add(&mut self, other: Counts) {
        self.searched += other.searched;
        self.bisected += other.bisected;
        self.inside += other.inside;
        self.several += other.several;
        self.beyond += other.beyond;
    }
}

/// Writes the density at 512 places of the block that the region was narrowed to.
///
/// Every value is at least 0; it is exactly 0 outside all tubes.
#[inline(always)]
pub fn evaluate<R: Real>(
    token: R::Token,
    region: &Region<R::Scalar>,
    places: Places<R::Scalar>,
    scratch: &mut Scratch<R::Scalar>,
    values: &mut [R::Scalar; VOXELS],
) -> Counts {
    let mut counts = Counts::default();
    let zero = R::Scalar::default();
    for value in values.iter_mut() {
        *value = zero;
    }
    let apart = region.join.is_some();
    if apart {
        join::begin(&mut scratch.joint);
    }
    for tube in &region.tubes {
        if apart {
            join::open(&mut scratch.joint);
        }
        for piece in &region.pieces[tube.pieces[0]..tube.pieces[1]] {
            let packed = match piece.search {
                Search::Point { is_corner } => at_point::<R>(token, piece, places, is_corner, apart, scratch),
                Search::Newton { .. } | Search::Bracket => {
                    let settled = match piece.search {
                        Search::Newton { cubic: false } => newton::<R, false>(token, piece, places, scratch),
                        Search::Newton { cubic: true } => newton::<R, true>(token, piece, places, scratch),
                        _ => false,
                    };
                    if !settled {
                        counts.bisected += VOXELS as u64;
                        bracket::<R>(token, piece, places, scratch);
                    }
                    coordinates::<R>(token, piece, places, apart, scratch)
                }
            };
            if piece.in_world {
                pack_places::<R>(token, places, scratch);
            }
            layers::<R>(token, region, piece.layers, scratch, packed);
            if apart {
                join::feet::<R>(token, tube, piece.arc, scratch);
            } else {
                join::larger::<R>(token, scratch, values);
            }
            counts.searched += VOXELS as u64;
            counts.inside += packed as u64;
        }
        if let Some(rule) = region.join {
            join::close::<R>(token, tube.overlap, rule, &mut scratch.joint, values);
        }
    }
    if let Some(rule) = region.join {
        [counts.several, counts.beyond] = join::finish::<R>(token, rule, &scratch.joint, values);
    }
    counts
}

/// The rows of a piece's table for one batch of lanes after another.
struct Rows<'a, R: Real> {
    piece: &'a Piece<R::Scalar>,
    places: Places<'a, R::Scalar>,
    /// Voxel centres of a batch from its first, in y and z: batches are whole rows of z, or parts of one.
    y: R,
    z: R,
    /// The table at the batch's first voxel.
    first: [R::Scalar; ROWS],
    /// What each lane adds to it.
    lanes: [R; ROWS],
}

impl<'a, R: Real> Rows<'a, R> {
    #[inline(always)]
    fn new(
        token: R::Token,
        piece: &'a Piece<R::Scalar>,
        places: Places<'a, R::Scalar>,
        numbers: &[R::Scalar],
    ) -> Rows<'a, R> {
        let zero = R::constant(token, 0.0);
        let number = R::load(token, numbers);
        let y = (number * R::constant(token, 0.125)).floor();
        let z = number - y * R::constant(token, 8.0);
        let mut rows = Rows { piece, places, y, z, first: piece.base, lanes: [zero; ROWS] };
        for k in 0..ROWS {
            let (along_y, along_z) = (R::splat(token, piece.slope[1][k]), R::splat(token, piece.slope[2][k]));
            rows.lanes[k] = rows.y * along_y + rows.z * along_z;
        }
        rows
    }

    /// Moves to the batch that begins at place `index`.
    #[inline(always)]
    #[allow(clippy::cast_precision_loss, reason = "indices below 512")]
    #[allow(
        clippy::needless_range_loop,
        reason = "kernels hold no iterator adaptors: they may not be inlined"
    )]
    fn go(&mut self, token: R::Token, index: usize) {
        let slope = &self.piece.slope;
        match self.places {
            Places::Centres => {
                let x = R::Scalar::from_f64((index / (EDGE * EDGE)) as f64 - 3.5);
                let y = R::Scalar::from_f64((index / EDGE % EDGE) as f64 - 3.5);
                let z = R::Scalar::from_f64((index % EDGE) as f64 - 3.5);
                for k in 0..ROWS {
                    self.first[k] = self.piece.base[k] + slope[0][k] * x + slope[1][k] * y + slope[2][k] * z;
                }
            }
            Places::Points([x, y, z]) => {
                let x = R::load(token, &x[index..]);
                let y = R::load(token, &y[index..]);
                let z = R::load(token, &z[index..]);
                for k in 0..ROWS {
                    self.lanes[k] = x * R::splat(token, slope[0][k])
                        + y * R::splat(token, slope[1][k])
                        + z * R::splat(token, slope[2][k]);
                }
            }
        }
    }

    #[inline(always)]
    fn row(&self, token: R::Token, k: usize) -> R {
        R::splat(token, self.first[k]) + self.lanes[k]
    }
}

/// The foot's equation for one batch: a polynomial in eta.
struct Equation<R> {
    a: [R; 6],
}

impl<R: Real> Equation<R> {
    #[inline(always)]
    fn new(token: R::Token, rows: &Rows<R>) -> Equation<R> {
        let high = rows.piece.foot;
        Equation {
            a: [
                rows.row(token, FOOT),
                rows.row(token, FOOT + 1),
                rows.row(token, FOOT + 2),
                R::splat(token, high[0]),
                R::splat(token, high[1]),
                R::splat(token, high[2]),
            ],
        }
    }

    /// Value and derivative.
    #[inline(always)]
    fn at<const CUBIC: bool>(&self, eta: R) -> (R, R) {
        let a = &self.a;
        if CUBIC {
            let b4 = a[5] * eta + a[4];
            let b3 = b4 * eta + a[3];
            let b2 = b3 * eta + a[2];
            let b1 = b2 * eta + a[1];
            let c3 = a[5] * eta + b4;
            let c2 = c3 * eta + b3;
            let c1 = c2 * eta + b2;
            (b1 * eta + a[0], c1 * eta + b1)
        } else {
            let b2 = a[3] * eta + a[2];
            let b1 = b2 * eta + a[1];
            let c1 = (a[3] * eta + b2) * eta + b1;
            (b1 * eta + a[0], c1)
        }
    }
}

/// Feet by Newton's method, where the piece holds at most one for every voxel; false where some voxel's did not settle.
#[inline(always)]
fn newton<R: Real, const CUBIC: bool>(
    token: R::Token,
    piece: &Piece<R::Scalar>,
    places: Places<R::Scalar>,
    scratch: &mut Scratch<R::Scalar>,
) -> bool {
    let mut rows = Rows::<R>::new(token, piece, places, &scratch.numbers);
    let zero = R::constant(token, 0.0);
    // Past the piece's ends the polynomial holds, but need not increase: steps are kept near.
    let (lo, hi) = (R::constant(token, -PAST), R::constant(token, PAST));
    let tolerance = R::splat(token, piece.tolerance);
    let no_foot = R::constant(token, NO_FOOT);
    for index in (0..VOXELS).step_by(R::LANES) {
        rows.go(token, index);
        let equation = Equation::new(token, &rows);
        let mut eta = (zero - equation.a[0] / equation.a[1]).within(lo, hi);
        let mut steps = 1;
        loop {
            let (g, slope) = equation.at::<CUBIC>(eta);
            let step = g / slope;
            eta = (eta - step).within(lo, hi);
            steps += 1;
            if steps < STEPS {
                continue;
            }
            let settled = R::and(step.abs().le(tolerance), zero.lt(slope));
            // A voxel whose foot lies elsewhere is pushed against an end, where it need not settle.
            let open = R::and(R::not(settled), R::and(lo.lt(eta), eta.lt(hi)));
            if R::bitmask(open) == 0 {
                R::select(settled, eta, no_foot).store(&mut scratch.eta[index..]);
                break;
            }
            if steps == MOST_STEPS {
                return false;
            }
        }
    }
    true
}

/// Feet by bisection: where the equation changes from negative to positive along the piece, if it does.
///
/// For certified pieces that is the one foot. Uncertified ones are so short that of two feet either stands for both.
#[inline(always)]
fn bracket<R: Real>(
    token: R::Token,
    piece: &Piece<R::Scalar>,
    places: Places<R::Scalar>,
    scratch: &mut Scratch<R::Scalar>,
) {
    let mut rows = Rows::<R>::new(token, piece, places, &scratch.numbers);
    let zero = R::constant(token, 0.0);
    let ends = [R::splat(token, piece.range[0]), R::splat(token, piece.range[1])];
    let one = R::constant(token, 1.0);
    let no_foot = R::constant(token, NO_FOOT);
    for index in (0..VOXELS).step_by(R::LANES) {
        rows.go(token, index);
        let equation = Equation::new(token, &rows);
        let (at_lo, slope_lo) = equation.at::<true>(ends[0]);
        let (at_hi, slope_hi) = equation.at::<true>(ends[1]);
        let mut changes = R::and(at_lo.le(zero), zero.le(at_hi));
        let [mut lo, mut hi] = ends;
        let falls = R::and(zero.lt(at_lo), at_hi.lt(zero));
        if R::bitmask(falls) != 0 {
            // The distance is largest there, not least.
            let farthest = zero_between(token, &equation, [hi, lo]);
            let (u, v) = (across(token, &rows, U, farthest), across(token, &rows, V, farthest));
            scratch.joint.beyond[index / R::LANES] |= R::bitmask(R::and(falls, (u * u + v * v).le(one)));
        }
        // Near the focal set the equation may dip below zero and come back, or rise above it, between ends of one sign.
        let valley =
            R::and(R::and(zero.lt(at_lo), zero.lt(at_hi)), R::and(slope_lo.lt(zero), zero.lt(slope_hi)));
        let peak =
            R::and(R::and(at_lo.lt(zero), at_hi.lt(zero)), R::and(zero.lt(slope_lo), slope_hi.lt(zero)));
        if (R::bitmask(valley) | R::bitmask(peak)) != 0 {
            let extremum = turning_point(token, &equation, ends, peak);
            let (g, _) = equation.at::<true>(extremum);
            let (dips, rises) = (R::and(valley, g.le(zero)), R::and(peak, zero.le(g)));
            lo = R::select(dips, extremum, lo);
            hi = R::select(rises, extremum, hi);
            // A foot and a place where the distance is largest lie side by side.
            let (u, v) = (across(token, &rows, U, extremum), across(token, &rows, V, extremum));
            let pairs = R::and(R::or(dips, rises), (u * u + v * v).le(one));
            scratch.joint.beyond[index / R::LANES] |= R::bitmask(pairs);
            let (g_lo, _) = equation.at::<true>(lo);
            let (g_hi, _) = equation.at::<true>(hi);
            changes = R::and(g_lo.le(zero), zero.le(g_hi));
        }
        if R::bitmask(changes) == 0 {
            no_foot.store(&mut scratch.eta[index..]);
            continue;
        }
        let foot = zero_between(token, &equation, [lo, hi]);
        R::select(changes, foot, no_foot).store(&mut scratch.eta[index..]);
    }
}

/// Where the equation is zero between a place where it is negative and one where it is positive.
#[inline(always)]
fn zero_between<R: Real>(token: R::Token, equation: &Equation<R>, ends: [R; 2]) -> R {
    let (zero, half) = (R::constant(token, 0.0), R::constant(token, 0.5));
    let [mut negative, mut positive] = ends;
    for _ in 0..HALVINGS {
        let middle = (negative + positive) * half;
        let (g, _) = equation.at::<true>(middle);
        let below = g.lt(zero);
        negative = R::select(below, middle, negative);
        positive = R::select(below, positive, middle);
    }
    (negative + positive) * half
}

/// Where the equation is least between `ends`, or where it is greatest if `peak`, of lanes that have such a place.
#[inline(always)]
fn turning_point<R: Real>(token: R::Token, equation: &Equation<R>, ends: [R; 2], peak: R::Mask) -> R {
    let (zero, half) = (R::constant(token, 0.0), R::constant(token, 0.5));
    let [mut lo, mut hi] = ends;
    for _ in 0..HALVINGS {
        let middle = (lo + hi) * half;
        let (_, slope) = equation.at::<true>(middle);
        let before = R::select(peak, -slope, slope).lt(zero);
        lo = R::select(before, middle, lo);
        hi = R::select(before, hi, middle);
    }
    (lo + hi) * half
}

/// Cylinder coordinates and envelope at the feet; packs the voxels inside and returns their number.
#[inline(always)]
fn coordinates<R: Real>(
    token: R::Token,
    piece: &Piece<R::Scalar>,
    places: Places<R::Scalar>,
    apart: bool,
    scratch: &mut Scratch<R::Scalar>,
) -> usize {
    let mut rows = Rows::<R>::new(token, piece, places, &scratch.numbers);
    let (lo, hi) = (R::splat(token, piece.range[0]), R::splat(token, piece.range[1]));
    let one = R::constant(token, 1.0);
    let mut packed = 0;
    for index in (0..VOXELS).step_by(R::LANES) {
        let eta = R::load(token, &scratch.eta[index..]);
        let in_range = R::and(lo.le(eta), eta.le(hi));
        scratch.inside[index / R::LANES] = 0;
        if R::bitmask(in_range) == 0 {
            continue;
        }
        rows.go(token, index);
        let u = across(token, &rows, U, eta);
        let v = across(token, &rows, V, eta);
        let q = u * u + v * v;
        let inside = R::and(in_range, q.le(one));
        let bits = R::bitmask(inside);
        scratch.inside[index / R::LANES] = bits;
        if bits == 0 {
            continue;
        }
        let height = along(token, &piece.height, eta);
        let mut weight = envelope(token, piece, q, height);
        if let Some(gain) = &piece.gain {
            weight = weight * along(token, gain, eta);
        }
        let mut fade = one;
        if let Some(speed) = &piece.speed {
            let narrowing = narrowing(token, &rows, speed, eta);
            fade = smoothstep(token, narrowing * R::constant(token, 5.0));
            if piece.is_faded {
                weight = weight * fade;
            }
            if piece.is_full {
                weight = weight / narrowing.most(R::constant(token, LEAST_NARROWING));
            }
        }
        if piece.fades || apart {
            along(token, &piece.radius, eta).compress(inside).store(&mut scratch.radius[packed..]);
            q.compress(inside).store(&mut scratch.q[packed..]);
        }
        if apart {
            fade.compress(inside).store(&mut scratch.focal[packed..]);
        }
        let [u, v] = turned(token, piece, [u, v], height);
        pack(scratch, packed, inside, [u, v, height, weight]);
        packed += bits.count_ones() as usize;
    }
    packed
}

/// The same where the foot is the end of a curve, or a corner.
#[inline(always)]
fn at_point<R: Real>(
    token: R::Token,
    piece: &Piece<R::Scalar>,
    places: Places<R::Scalar>,
    is_corner: bool,
    apart: bool,
    scratch: &mut Scratch<R::Scalar>,
) -> usize {
    let mut rows = Rows::<R>::new(token, piece, places, &scratch.numbers);
    let (zero, one) = (R::constant(token, 0.0), R::constant(token, 1.0));
    let turn = [1, 2, 3, 4].map(|k| R::splat(token, piece.base[U + k]));
    let radius = R::splat(token, piece.radius[0]);
    let mut packed = 0;
    for index in (0..VOXELS).step_by(R::LANES) {
        rows.go(token, index);
        let (mut u, mut v) = (rows.row(token, U), rows.row(token, V));
        let beyond = rows.row(token, FOOT);
        let q = u * u + v * v + beyond * beyond;
        let mut inside = R::and(zero.lt(beyond), q.le(one));
        if is_corner {
            inside = R::and(inside, rows.row(token, SECOND).lt(zero));
            // Turned into the first plane: the part across the hinge keeps its side and takes all of the length.
            let length = (v * v + beyond * beyond).sqrt();
            let across = R::select(v.lt(zero), -length, length);
            (u, v) = (turn[0] * u + turn[1] * across, turn[2] * u + turn[3] * across);
        }
        let bits = R::bitmask(inside);
        scratch.inside[index / R::LANES] = bits;
        if bits == 0 {
            continue;
        }
        let mut weight = envelope(token, piece, q, zero);
        if let Some(gain) = &piece.gain {
            weight = weight * R::splat(token, gain[0]);
        }
        if piece.fades || apart {
            radius.store(&mut scratch.radius[packed..]);
            q.compress(inside).store(&mut scratch.q[packed..]);
        }
        if apart {
            one.store(&mut scratch.focal[packed..]);
        }
        let [u, v] = turned(token, piece, [u, v], zero);
        pack(scratch, packed, inside, [u, v, zero, weight]);
        packed += bits.count_ones() as usize;
    }
    packed
}

#[inline(always)]
fn pack<R: Real>(scratch: &mut Scratch<R::Scalar>, packed: usize, inside: R::Mask, lanes: [R; 4]) {
    lanes[0].compress(inside).store(&mut scratch.u[packed..]);
    lanes[1].compress(inside).store(&mut scratch.v[packed..]);
    lanes[2].compress(inside).store(&mut scratch.height[packed..]);
    lanes[3].compress(inside).store(&mut scratch.weight[packed..]);
}

/// `sum_k row[first + k] eta^k`.
#[inline(always)]
fn across<R: Real>(token: R::Token, rows: &Rows<R>, first: usize, eta: R) -> R {
    let mut sum = rows.row(token, first + TERMS - 1);
    for k in (0..TERMS - 1).rev() {
        sum = sum * eta + rows.row(token, first + k);
    }
    sum
}

#[inline(always)]
fn along<R: Real, const N: usize>(token: R::Token, c: &[R::Scalar; N], eta: R) -> R {
    let mut sum = R::splat(token, c[N - 1]);
    for k in (0..N - 1).rev() {
        sum = sum * eta + R::splat(token, c[k]);
    }
    sum
}

/// (u, v) in the cross-section turned by twist and spin.
#[inline(always)]
fn turned<R: Real>(token: R::Token, piece: &Piece<R::Scalar>, [u, v]: [R; 2], height: R) -> [R; 2] {
    let Some([start, rate]) = piece.turns else { return [u, v] };
    let (sin, cos) = (R::splat(token, start) + R::splat(token, rate) * height).sin_cos_turns(token);
    [u * cos + v * sin, v * cos - u * sin]
}

/// `1 - kappa rho cos`.
#[inline(always)]
fn narrowing<R: Real>(token: R::Token, rows: &Rows<R>, speed: &[R::Scalar; 5], eta: R) -> R {
    let (_, slope) = Equation::new(token, rows).at::<true>(eta);
    slope / along(token, speed, eta)
}

/// `t^2 (3 - 2 t)` with t clamped to [0, 1].
#[inline(always)]
fn smoothstep<R: Real>(token: R::Token, t: R) -> R {
    let t = t.within(R::constant(token, 0.0), R::constant(token, 1.0));
    t * t * (R::constant(token, 3.0) - (t + t))
}

#[inline(always)]
fn envelope<R: Real>(token: R::Token, piece: &Piece<R::Scalar>, q: R, height: R) -> R {
    let one = R::constant(token, 1.0);
    let mut weight = match piece.radial {
        Radial::Smooth => (one - q) * (one - q),
        Radial::Linear => one - q.sqrt(),
        Radial::Hard => one,
        Radial::Edge(width) => smoothstep(token, (one - q.sqrt()) * R::constant(token, 1.0 / width)),
    };
    if let Some([start, rate, fraction]) = piece.axial {
        let x = R::splat(token, start) + R::splat(token, rate) * height;
        let fraction = R::splat(token, fraction);
        weight = weight * smoothstep(token, x / fraction) * smoothstep(token, (one - x) / fraction);
    }
    weight
}

/// The density of the packed voxels: envelope times layers. It takes the place of the weights.
#[inline(always)]
pub(super) fn layers<R: Real>(
    token: R::Token,
    region: &Region<R::Scalar>,
    [start, end]: [usize; 2],
    scratch: &mut Scratch<R::Scalar>,
    packed: usize,
) {
    let mut first = 0;
    while first < packed {
        let mut value = R::constant(token, 1.0);
        for layer in &region.layers[start..end] {
            let mut term = match &layer.kind {
                LayerKind::Constant(constant) => R::splat(token, *constant),
                LayerKind::Sectors => {
                    let (zero, one) = (R::constant(token, 0.0), R::constant(token, 1.0));
                    let (u, v) = (R::load(token, &scratch.u[first..]), R::load(token, &scratch.v[first..]));
                    R::select(zero.lt(u * v), one, zero)
                }
                LayerKind::Perlin { sums, in_world } => {
                    let sums = &region.sums[sums[0]..sums[1]];
                    fractal(token, region, sums, *in_world, scratch, first)
                }
            };
            if let Some(threshold) = layer.threshold {
                term = (term - R::splat(token, threshold)).most(R::constant(token, 0.0));
            }
            term = term * R::splat(token, layer.multiplier);
            value = match layer.op {
                Op::Multiply => value * term,
                Op::Add => value + term,
                Op::Max => value.most(term),
                Op::Min => value.least(term),
            };
        }
        let weight = R::load(token, &scratch.weight[first..]);
        (value * weight).store(&mut scratch.weight[first..]);
        first += R::LANES;
    }
}
