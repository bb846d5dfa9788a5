//! Which rows of a block's voxels may have feet on a piece of an axis: the others are not searched.

use glam::DVec3;

use super::EDGE;
use super::region::round;
use crate::num::poly::{TERMS, evaluate};
use crate::num::{Real, Scalar};

/// Half the distance between the ends of a row of voxels' centres.
const HALF_ROW: f64 = 3.5;
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
    /// At the row (x, y), `start[0] + start[1] x + start[2] y` is at most 0 where the foot of one of its voxels may lie
    /// past the piece's start, and the same of `end` at least 0 where before its end.
    start: [T; 3],
    end: [T; 3],
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
                [at.dot(d1) + side * (HALF_ROW * d1.z.abs() + slack), -d1.x, -d1.y]
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
                let ahead = largest * lean / pace + (first + most * second) * most + HALF_ROW * along.z.abs();
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
            end: round([plane + HALF_ROW * normal.z.abs() + slack, normal.x, normal.y]),
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
            start: round([-1.0, 0.0, 0.0]),
            end: round([1.0, 0.0, 0.0]),
        }
    }
}

/// A radius, with what single precision may make of a distance to a line through `centre`.
fn slacked(radius: f64, centre: DVec3) -> f64 {
    radius + SLACK + RELATIVE * (radius + centre.length())
}

/// The rows that may hold such voxels: bit `8 x + y` of the row at (x, y).
#[inline(always)]
#[allow(clippy::cast_precision_loss, reason = "indices below 64")]
pub(super) fn rows<R: Real>(token: R::Token, near: &Near<R::Scalar>, numbers: &[R::Scalar]) -> u64 {
    let (zero, half) = (R::constant(token, 0.0), R::constant(token, HALF_ROW));
    let number = R::load(token, numbers);
    let lane_x = (number * R::constant(token, 0.125)).floor();
    let lane_y = number - lane_x * R::constant(token, 8.0);
    let [along_x, along_y, along_z] = near.along.map(|a| R::splat(token, a));
    let from_z = -R::splat(token, near.centre[2]);
    let mut rows = 0;
    for first in (0..EDGE * EDGE).step_by(R::LANES) {
        let x = lane_x + R::constant(token, (first / EDGE) as f64 - 3.5);
        let y = lane_y + R::constant(token, (first % EDGE) as f64 - 3.5);
        // From the line, across it, to the middle of the row, and on to the nearest of the row's places.
        let (from_x, from_y) = (x - R::splat(token, near.centre[0]), y - R::splat(token, near.centre[1]));
        let past = from_x * along_x + from_y * along_y + from_z * along_z;
        let (x_off, y_off, z_off) =
            (from_x - past * along_x, from_y - past * along_y, from_z - past * along_z);
        let z = (zero - z_off * R::splat(token, near.away[0])).within(-half, half);
        let distance = x_off * x_off
            + y_off * y_off
            + z_off * z_off
            + z * (z_off + z_off + z * R::splat(token, near.away[1]));
        let start = plane(token, &near.start, x, y);
        let end = plane(token, &near.end, x, y);
        let reach = R::splat(token, near.reach[0]) + R::splat(token, near.reach[1]) * past;
        let reach = reach.within(zero, R::splat(token, near.reach[2]));
        let outside = R::or((reach * reach).lt(distance), R::or(zero.lt(start), end.lt(zero)));
        rows |= u64::from(R::bitmask(R::not(outside))) << first;
    }
    rows
}

#[inline(always)]
fn plane<R: Real>(token: R::Token, plane: &[R::Scalar; 3], x: R, y: R) -> R {
    R::splat(token, plane[0]) + x * R::splat(token, plane[1]) + y * R::splat(token, plane[2])
}

/// The batches that have voxels of some rows, or where batches are shorter than a row, the rows: bit r for one that begins at
/// row r.
///
/// Loops go from one set bit to the next, and do not ask about each batch: the answers follow no pattern that a processor could
/// guess.
#[derive(Debug, Clone, Copy)]
pub(super) struct Batches(u64);

impl Batches {
    #[inline(always)]
    pub(super) fn of<R: Real>(rows: u64) -> Batches {
        // A batch of sixteen lanes is a pair of rows.
        Batches(if R::LANES > EDGE { (rows | rows >> 1) & 0x5555_5555_5555_5555 } else { rows })
    }

    /// How many lanes they have.
    #[inline(always)]
    pub(super) fn lanes<R: Real>(self) -> u64 {
        u64::from(self.0.count_ones()) * Batches::size::<R>() as u64
    }

    /// Takes the first of them: the voxels from one to another.
    #[inline(always)]
    pub(super) fn take<R: Real>(&mut self) -> Option<[usize; 2]> {
        if self.0 == 0 {
            return None;
        }
        let first = self.0.trailing_zeros() as usize * EDGE;
        self.0 &= self.0 - 1;
        Some([first, first + Batches::size::<R>()])
    }

    const fn size<R: Real>() -> usize {
        if R::LANES > EDGE { R::LANES } else { EDGE }
    }
}
