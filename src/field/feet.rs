//! Feet: where each voxel of a block has its nearest place on a piece of an axis.

use super::batch::{self, BATCH, BATCHES, Batches};
use super::kernel::{Places, Scratch, own};
use super::region::{FOOT, Piece, ROWS, U, V};
use crate::num::Real;
use crate::num::poly::TERMS;

/// Newton steps that every voxel gets, the first from the piece's middle.
const STEPS: usize = 2;
/// Steps after which a batch with a voxel that has not converged goes to bisection.
const MOST_STEPS: usize = 9;
/// Halvings of a piece: past the precision of `f32` over a piece of 32 voxels.
const HALVINGS: usize = 26;
/// How far past a piece's ends, which are at -1 and 1, Newton's method may go.
const PAST: f64 = 1.25;
/// Parameter of a voxel that has no foot in the piece.
const NO_FOOT: f64 = 1e30;

/// Batches in a layer of a block, across x.
const IN_LAYER: usize = BATCHES / 4;

/// The rows of a piece's table for one batch of lanes after another.
pub(super) struct Rows<'a, R: Real> {
    piece: &'a Piece<R::Scalar>,
    places: Places<'a, R::Scalar>,
    /// 0, 1, and so on.
    number: R,
    /// What each lane adds to the table.
    lanes: [R; ROWS],
    /// The layer of batches that a batch lies in, and the table there where y and z are 0, lane by lane.
    layer: usize,
    in_layer: [R; ROWS],
    /// What a layer's batches add, each at its first voxel, and which of them is the batch's.
    steps: [[R::Scalar; ROWS]; IN_LAYER],
    step: usize,
}

impl<'a, R: Real> Rows<'a, R> {
    #[inline(always)]
    #[allow(clippy::cast_precision_loss, reason = "indices below 8")]
    #[allow(
        clippy::needless_range_loop,
        reason = "kernels hold no iterator adaptors: they may not be inlined"
    )]
    pub(super) fn new(
        token: R::Token,
        piece: &'a Piece<R::Scalar>,
        places: Places<'a, R::Scalar>,
        numbers: &[R::Scalar],
    ) -> Rows<'a, R> {
        let zero = R::constant(token, 0.0);
        let mut rows = Rows {
            piece,
            places,
            number: R::load(token, numbers),
            lanes: [zero; ROWS],
            layer: usize::MAX,
            in_layer: [zero; ROWS],
            steps: [[R::Scalar::default(); ROWS]; IN_LAYER],
            step: 0,
        };
        if let Places::Centres = places
            && R::LANES == BATCH
        {
            let [x, y, z] = batch::within(token, 0, rows.number);
            let [along_x, along_y, along_z] = &piece.slope;
            for k in 0..ROWS {
                rows.lanes[k] = x * R::splat(token, along_x[k])
                    + y * R::splat(token, along_y[k])
                    + z * R::splat(token, along_z[k]);
            }
            for step in 0..IN_LAYER {
                let [_, y, z] = batch::corner(step);
                let y = R::constant(token, y as f64 - 3.5);
                let z = R::constant(token, z as f64 - 3.5);
                for k in (0..ROWS).step_by(R::LANES) {
                    let (by_y, by_z) = (R::load(token, &along_y[k..]), R::load(token, &along_z[k..]));
                    (by_y * y + by_z * z).store(&mut rows.steps[step][k..]);
                }
            }
        }
        rows
    }

    /// Moves rows `FROM..TO` to the batch that begins at place `index`: always the same rows.
    #[inline(always)]
    #[allow(clippy::cast_precision_loss, reason = "indices below 512")]
    #[allow(
        clippy::needless_range_loop,
        reason = "kernels hold no iterator adaptors: they may not be inlined"
    )]
    pub(super) fn go<const FROM: usize, const TO: usize>(&mut self, token: R::Token, index: usize) {
        let slope = &self.piece.slope;
        let [x, y, z] = match self.places {
            Places::Centres if R::LANES == BATCH => {
                let layer = index / (BATCH * IN_LAYER);
                if layer != self.layer {
                    let x = R::constant(token, batch::corner(layer * IN_LAYER)[0] as f64 - 3.5);
                    let mut at = [R::Scalar::default(); ROWS];
                    for k in (0..ROWS).step_by(R::LANES) {
                        let (base, by_x) = (&self.piece.base[k..], &slope[0][k..]);
                        (R::load(token, base) + R::load(token, by_x) * x).store(&mut at[k..]);
                    }
                    for k in FROM..TO {
                        self.in_layer[k] = self.lanes[k] + R::splat(token, at[k]);
                    }
                    self.layer = layer;
                }
                self.step = index / BATCH % IN_LAYER;
                return;
            }
            Places::Centres => batch::centres(token, index, self.number),
            Places::Points([x, y, z]) => {
                [R::load(token, &x[index..]), R::load(token, &y[index..]), R::load(token, &z[index..])]
            }
        };
        for k in FROM..TO {
            self.in_layer[k] = R::splat(token, self.piece.base[k])
                + (x * R::splat(token, slope[0][k])
                    + y * R::splat(token, slope[1][k])
                    + z * R::splat(token, slope[2][k]));
        }
    }

    #[inline(always)]
    pub(super) fn row(&self, token: R::Token, k: usize) -> R {
        self.in_layer[k] + R::splat(token, self.steps[self.step][k])
    }
}

/// The foot's equation for one batch: a polynomial in eta.
pub(super) struct Equation<R> {
    a: [R; 6],
}

impl<R: Real> Equation<R> {
    #[inline(always)]
    pub(super) fn new(token: R::Token, rows: &Rows<R>) -> Equation<R> {
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
    pub(super) fn at<const CUBIC: bool>(&self, eta: R) -> (R, R) {
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

/// Feet by Newton's method, where the piece holds at most one for every voxel; false where some voxel's did not settle. Of
/// the batches `near` only.
#[inline(always)]
pub(super) fn newton<R: Real, const CUBIC: bool>(
    token: R::Token,
    piece: &Piece<R::Scalar>,
    places: Places<R::Scalar>,
    mut near: Batches,
    scratch: &mut Scratch<R::Scalar>,
) -> bool {
    let mut rows = Rows::<R>::new(token, piece, places, &scratch.numbers);
    let zero = R::constant(token, 0.0);
    // Past the piece's ends the polynomial holds, but need not increase: steps are kept near.
    let (lo, hi) = (R::constant(token, -PAST), R::constant(token, PAST));
    let tolerance = R::splat(token, piece.tolerance);
    let no_foot = R::constant(token, NO_FOOT);
    while let Some([start, end]) = near.take() {
        for index in (start..end).step_by(R::LANES) {
            rows.go::<FOOT, ROWS>(token, index);
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
                    R::select(settled, eta, no_foot).store(scratch.eta.part_mut(index));
                    break;
                }
                if steps == MOST_STEPS {
                    return false;
                }
            }
        }
    }
    true
}

/// Feet by bisection, of the batches `near`: where the equation changes from negative to positive along the piece, if it does.
///
/// For certified pieces that is the one foot. Uncertified ones are so short that of two feet either stands for both.
#[inline(always)]
pub(super) fn bracket<R: Real>(
    token: R::Token,
    piece: &Piece<R::Scalar>,
    places: Places<R::Scalar>,
    mut near: Batches,
    scratch: &mut Scratch<R::Scalar>,
) {
    let mut rows = Rows::<R>::new(token, piece, places, &scratch.numbers);
    let zero = R::constant(token, 0.0);
    let range = piece.shared.as_ref().map_or(piece.range, |shared| shared.range);
    let ends = [R::splat(token, range[0]), R::splat(token, range[1])];
    let one = R::constant(token, 1.0);
    let no_foot = R::constant(token, NO_FOOT);
    while let Some([start, end]) = near.take() {
        for index in (start..end).step_by(R::LANES) {
            rows.go::<U, { FOOT + 3 }>(token, index);
            let equation = Equation::new(token, &rows);
            let (at_lo, slope_lo) = equation.at::<true>(ends[0]);
            let (at_hi, slope_hi) = equation.at::<true>(ends[1]);
            let mut changes = R::and(at_lo.le(zero), zero.le(at_hi));
            let [mut lo, mut hi] = ends;
            let falls = R::and(zero.lt(at_lo), at_hi.lt(zero));
            if R::bitmask(falls) != 0 {
                // The distance is largest there, not least.
                let farthest = zero_between(token, &equation, [hi, lo]);
                let at = own(token, piece, farthest);
                let u = across::<R, TERMS>(token, &rows, U, at);
                let v = across::<R, TERMS>(token, &rows, V, at);
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
                let at = own(token, piece, extremum);
                let u = across::<R, TERMS>(token, &rows, U, at);
                let v = across::<R, TERMS>(token, &rows, V, at);
                let pairs = R::and(R::or(dips, rises), (u * u + v * v).le(one));
                scratch.joint.beyond[index / R::LANES] |= R::bitmask(pairs);
                let (g_lo, _) = equation.at::<true>(lo);
                let (g_hi, _) = equation.at::<true>(hi);
                changes = R::and(g_lo.le(zero), zero.le(g_hi));
            }
            if R::bitmask(changes) == 0 {
                no_foot.store(scratch.eta.part_mut(index));
                continue;
            }
            let foot = zero_between(token, &equation, [lo, hi]);
            R::select(changes, foot, no_foot).store(scratch.eta.part_mut(index));
        }
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

/// `sum_k row[first + k] eta^k`, of `N` terms.
#[inline(always)]
pub(super) fn across<R: Real, const N: usize>(token: R::Token, rows: &Rows<R>, first: usize, eta: R) -> R {
    let mut sum = rows.row(token, first + N - 1);
    for k in (0..N - 1).rev() {
        sum = sum * eta + rows.row(token, first + k);
    }
    sum
}
