//! Which batches of a block's voxels may have feet on a piece of an axis: the others are not searched.

use glam::DVec3;

use super::batch::{BATCHES, Batches, HALF, SIDES};
use super::region::{Piece, round};
use crate::num::poly::{TERMS, evaluate};
use crate::num::{Real, Scalar};

/// From the line through a batch's middle, along z, to its voxels' centres.
const ASIDE: f64 = std::f64::consts::FRAC_1_SQRT_2;
/// How far past its bounds a voxel must be to be left out, in voxels and relative to its distance: well beyond what single
/// precision makes of a foot's place, here and in the search.
pub(super) const SLACK: f64 = 0.002;
const RELATIVE: f64 = 1e-5;

/// Bounds of the voxels that have feet on a piece, or a point. Lengths are in voxels and positions from the block's centre.
#[derive(Debug, Clone)]
pub(crate) struct Near<T> {
    /// A straight line that the piece keeps close to: a point of it, and its direction; for a point, that and 0.
    centre: [T; 3],
    along: [T; 3],
    /// A voxel with a foot on the piece is no farther from the line than `reach[0] + reach[1] t`, where it lies `t` along the
    /// line from its point, nor than `reach[2]`.
    reach: [T; 3],
    /// 1 over the square of what a step of one voxel along z takes a voxel away from the line, and that square.
    away: [T; 2],
    /// At the batch whose middle is (x, y, z), `start[0] + start[1] x + start[2] y + start[3] z` is at most 0 where the foot of one
    /// of its voxels may lie past the piece's start, and the same of `end` at least 0 where before its end.
    start: [T; 4],
    end: [T; 4],
}

impl<T: Scalar> Near<T> {
    /// Of the piece `q` of degree 3 on `range`, of the radius `radius` there.
    pub(super) fn piece(
        q: &[DVec3; 4],
        range: [f64; 2],
        radius: &[f64; TERMS],
        is_certified: bool,
    ) -> Near<T> {
        let along = q[1].normalize_or_zero();
        let most = range[0].abs().max(range[1].abs());
        let [bend, third] = [q[2], q[3]].map(|c| c - along * c.dot(along));
        // Across the line the piece lies between 0 and most^2 times `bend`, give or take most^3 `third`.
        let strays = (0.5 * most * bend.length() + most * most * third.length()) * most;
        let [level, slope] = [radius[0], radius[1]];
        // Even powers add nothing where they take away from the radius.
        let varies = radius[2].max(0.0) + radius[3].abs() + radius[4].max(0.0) + radius[5].abs();
        let varies = varies * (1.0 + 6.0 * (most - 1.0).max(0.0));
        let largest = level + slope.abs() * most + varies;
        let centre = q[0] + bend * (0.5 * most * most);
        let mut near = Near::line(centre, along, largest + strays);
        // Every voxel of the tube has at most one foot on a certified piece: g' > 0.
        if is_certified {
            let plane = |eta: f64, side: f64| {
                let at = evaluate(q, eta);
                let d1 = q[1] + (q[2] * 2.0 + q[3] * (3.0 * eta)) * eta;
                let slack = d1.length() * (SLACK + RELATIVE * (at.length() + largest));
                [at.dot(d1) + side * (spread(d1) + slack), -d1.x, -d1.y, -d1.z]
            };
            near.start = round(plane(range[0], -1.0));
            near.end = round(plane(range[1], 1.0));
            // A voxel lies as far along the line as its foot but for what the piece leans, and the foot but for how unevenly
            // the piece runs.
            let [first, second] = [q[2], q[3]].map(|c| c.dot(along).abs() * most);
            let lean = (2.0 * bend.length() + 3.0 * most * third.length()) * most;
            let pace = q[1].length() - 2.0 * first - 3.0 * most * second;
            if lean < pace {
                let slope = slope / q[1].length();
                let ahead = largest * lean / pace + (first + most * second) * most + spread(along);
                let here = level + varies + slope.abs() * ahead + strays;
                near.reach = round([slacked(here, centre), slope, slacked(largest + strays, centre)]);
            }
        }
        near
    }

    /// Of a point in whose half space the voxels with `plane[0] + plane[1..] . x > 0` are.
    pub(super) fn point(centre: DVec3, radius: f64, plane: f64, normal: DVec3) -> Near<T> {
        let slack = normal.length() * (SLACK + RELATIVE * (centre.length() + radius));
        Near {
            end: round([plane + spread(normal) + slack, normal.x, normal.y, normal.z]),
            ..Near::line(centre, DVec3::ZERO, radius)
        }
    }

    fn line(centre: DVec3, along: DVec3, radius: f64) -> Near<T> {
        let reach = slacked(radius, centre);
        let away = 1.0 - along.z * along.z;
        Near {
            centre: round(centre.into()),
            along: round(along.into()),
            reach: round([reach, 0.0, reach]),
            away: round([if away > 1e-6 { 1.0 / away } else { 0.0 }, away]),
            start: round([-1.0, 0.0, 0.0, 0.0]),
            end: round([1.0, 0.0, 0.0, 0.0]),
        }
    }
}

/// How far along a vector, times its length, a batch's voxels lie from its middle.
fn spread(vector: DVec3) -> f64 {
    DVec3::from(HALF).dot(vector.abs())
}

/// A radius around a line through `centre`, for the line through a batch's middle in place of its voxels, with what single
/// precision may make of a distance to the former.
fn slacked(radius: f64, centre: DVec3) -> f64 {
    radius + ASIDE + SLACK + RELATIVE * (radius + centre.length())
}

/// The batches that may hold voxels with feet on any of the pieces.
#[inline(always)]
pub(super) fn any<R: Real>(token: R::Token, pieces: &[Piece<R::Scalar>], numbers: &[R::Scalar]) -> Batches {
    let mut found = 0;
    for piece in pieces {
        found |= batches::<R>(token, &piece.near, numbers);
    }
    Batches(found)
}

/// The batches that may hold such voxels.
#[inline(always)]
#[allow(clippy::cast_precision_loss, reason = "below 32")]
fn batches<R: Real>(token: R::Token, near: &Near<R::Scalar>, numbers: &[R::Scalar]) -> u32 {
    let (zero, half) = (R::constant(token, 0.0), R::constant(token, HALF[2]));
    let [along_x, along_y, along_z] = near.along.map(|a| R::splat(token, a));
    let mut found = 0;
    for first in (0..BATCHES).step_by(R::LANES) {
        let [x, y, z] = middles(token, R::load(token, numbers) + R::constant(token, first as f64));
        // From the line, across it, to the batch's middle, and on along z to the nearest between its voxels.
        let from_x = x - R::splat(token, near.centre[0]);
        let from_y = y - R::splat(token, near.centre[1]);
        let from_z = z - R::splat(token, near.centre[2]);
        let past = from_x * along_x + from_y * along_y + from_z * along_z;
        let (x_off, y_off, z_off) =
            (from_x - past * along_x, from_y - past * along_y, from_z - past * along_z);
        let step = (zero - z_off * R::splat(token, near.away[0])).within(-half, half);
        let distance = x_off * x_off
            + y_off * y_off
            + z_off * z_off
            + step * (z_off + z_off + step * R::splat(token, near.away[1]));
        let start = plane(token, &near.start, [x, y, z]);
        let end = plane(token, &near.end, [x, y, z]);
        let reach = R::splat(token, near.reach[0]) + R::splat(token, near.reach[1]) * past;
        let reach = reach.within(zero, R::splat(token, near.reach[2]));
        let outside = R::or((reach * reach).lt(distance), R::or(zero.lt(start), end.lt(zero)));
        found |= R::bitmask(R::not(outside)) << first;
    }
    found
}

/// The middles of batches, in voxels from the block's centre.
#[inline(always)]
#[allow(clippy::cast_precision_loss, reason = "below 8")]
fn middles<R: Real>(token: R::Token, batch: R) -> [R; 3] {
    let plane = (batch * R::constant(token, 0.125)).floor();
    let row = (batch * R::constant(token, 0.5)).floor();
    let number = [plane, row - plane * R::constant(token, 4.0), batch - (row + row)];
    let mut middles = number;
    for axis in 0..3 {
        let step = R::constant(token, SIDES[axis] as f64);
        middles[axis] = number[axis] * step + R::constant(token, HALF[axis] - 3.5);
    }
    middles
}

#[inline(always)]
fn plane<R: Real>(token: R::Token, plane: &[R::Scalar; 4], [x, y, z]: [R; 3]) -> R {
    R::splat(token, plane[0])
        + x * R::splat(token, plane[1])
        + y * R::splat(token, plane[2])
        + z * R::splat(token, plane[3])
}
