//! The parts of rays that are inside of tubes, brick by brick.

use glam::DVec3;

use super::cones::TubeBounds;
use super::grid::EDGE;
use super::rays::{Hits, LANES, single};
use crate::field::Hull;
use crate::num::Real;

/// What single precision may make of where a body's surface is, in cells, and relative to the numbers that meet there.
const SLACK: f64 = 1e-3;
const RELATIVE: f64 = 1e-6;

/// The bodies near a brick. A ray that meets none of them meets no density there.
#[derive(Default)]
pub(super) struct Near {
    bodies: Vec<Body>,
    /// One of them holds all of the brick.
    is_full: bool,
}

/// Points p with `|y| <= radius + slope x`, where x is how far p - base is along `axis`, and y is the rest of it; in cells
/// from the brick's corner. Without an axis a ball.
struct Body {
    base: [f32; 3],
    axis: [f32; 3],
    radius: f32,
    slope: f32,
    /// And with `v . (p - base) <= w` for each (v, w) of these.
    cuts: [([f32; 3], f32); 2],
}

impl Body {
    fn new(hull: &Hull, corner: DVec3, h: f64) -> Body {
        let middle = corner + 0.5 * f64::from(EDGE) * h;
        let round = |v: DVec3| v.to_array().map(single);
        let (base, axis, radius, slope, cuts) = match hull {
            Hull::Cone(cone) => {
                let slope = (cone.radius[1] - cone.radius[0]) / (cone.along[1] - cone.along[0]);
                // From the place on the axis that is next to the brick.
                let x = (middle - cone.origin).dot(cone.axis);
                let radius = cone.radius[0] + slope * (x - cone.along[0]);
                let cuts = [(cone.axis, cone.along[1] - x), (-cone.axis, x - cone.along[0])];
                (cone.origin + cone.axis * x, cone.axis, radius, slope, cuts)
            }
            Hull::Ball(ball) => {
                (ball.centre, DVec3::ZERO, ball.radius, 0.0, ball.cuts.map(|v| (v, ball.slack)))
            }
        };
        let away = (base - middle).length() / h;
        let radius = radius / h;
        let slack = SLACK + RELATIVE * (away + radius.abs());
        Body {
            base: round((base - corner) / h),
            axis: round(axis),
            radius: single(radius + slack),
            slope: single(slope),
            cuts: cuts.map(|(v, w)| (round(v), single(w / h + slack))),
        }
    }

    /// Where rays are inside, beginning behind its end where they are not. Positions and directions as those of hits.
    #[inline(always)]
    fn interval<R: Real<Scalar = f32>>(
        &self,
        token: R::Token,
        position: &[R; 3],
        direction: &[R; 3],
    ) -> [R; 2] {
        let zero = R::constant(token, 0.0);
        let (mut x, mut pace) = (zero, zero);
        let mut from = *position;
        for axis in 0..3 {
            let along = R::splat(token, self.axis[axis]);
            from[axis] = from[axis] - R::splat(token, self.base[axis]);
            x = x + from[axis] * along;
            pace = pace + direction[axis] * along;
        }
        let slope = R::splat(token, self.slope);
        let (s, g) = (R::splat(token, self.radius) + slope * x, slope * pace);
        // |y + t v|^2 <= (s + t g)^2
        let (mut vv, mut yv, mut yy) = (zero, zero, zero);
        for axis in 0..3 {
            let along = R::splat(token, self.axis[axis]);
            let (y, v) = (from[axis] - along * x, direction[axis] - along * pace);
            vv = vv + v * v;
            yv = yv + y * v;
            yy = yy + y * y;
        }
        let (b, c) = (yv - s * g, yy - s * s);
        let a = away_from_zero(token, vv - g * g, 1e-12);
        let rooted = b * b - a * c;
        let root = rooted.most(zero).sqrt();
        let q = away_from_zero(token, R::select(zero.lt(b), -b - root, root - b), 1e-30);
        let (one, other) = (q / a, c / q);
        let (near, far) = (one.least(other), one.most(other));
        let (least, most) = (R::constant(token, -1e30), R::constant(token, 1e30));
        // Where a is negative, what lies beyond one of the roots, or everything.
        let opens = a.lt(zero);
        let misses = rooted.lt(zero);
        let rises = zero.lt(g);
        let open_low = R::select(R::and(rises, R::not(misses)), far, least);
        let open_high = R::select(R::or(rises, misses), most, near);
        let mut low = R::select(opens, open_low, R::select(misses, most, near));
        let mut high = R::select(opens, open_high, R::select(misses, least, far));
        for (v, w) in &self.cuts {
            let (mut value, mut rise) = (-R::splat(token, *w), zero);
            for axis in 0..3 {
                let along = R::splat(token, v[axis]);
                value = value + from[axis] * along;
                rise = rise + direction[axis] * along;
            }
            let rise = away_from_zero(token, rise, 1e-12);
            let at = -value / rise;
            let falls = rise.lt(zero);
            low = R::select(falls, low.most(at), low);
            high = R::select(falls, high, high.least(at));
        }
        [low, high]
    }
}

/// A number that one may divide by.
#[inline(always)]
fn away_from_zero<R: Real<Scalar = f32>>(token: R::Token, x: R, least: f64) -> R {
    let least = R::constant(token, least);
    R::select(x.abs().lt(least), least, x)
}

impl Near {
    /// Those near the brick whose corner is at `block`, in bricks, of a grid of edge h.
    pub(super) fn gather(&mut self, bounds: &TubeBounds, block: [i32; 3], h: f64) {
        self.bodies.clear();
        self.is_full = false;
        let edge = f64::from(EDGE) * h;
        let corner = DVec3::from(block.map(|c| f64::from(c) * edge));
        let middle = corner + 0.5 * edge;
        let reach = 0.5 * 3.0_f64.sqrt() * edge + SLACK * h;
        bounds.near(middle, reach, |hull| {
            self.is_full |= hull.distance(middle) <= -reach;
            self.bodies.push(Body::new(hull, corner, h));
        });
    }

    /// Shortens hits to what is between their first entry into a body and their last exit from one within the brick; those
    /// without any are dropped.
    #[inline(always)]
    pub(super) fn clip<R: Real<Scalar = f32>>(&self, token: R::Token, hits: &mut Hits) {
        if self.is_full {
            return;
        }
        let mut kept = 0;
        for first in (0..hits.count).step_by(LANES) {
            let lanes = LANES.min(hits.count - first);
            let load = |from: &[f32]| R::load(token, &from[first..first + LANES]);
            let position =
                [load(&hits.position[0][..]), load(&hits.position[1][..]), load(&hits.position[2][..])];
            let direction =
                [load(&hits.direction[0][..]), load(&hits.direction[1][..]), load(&hits.direction[2][..])];
            let (begin, end) = (load(&hits.begin[..]), load(&hits.end[..]));
            let (mut enters, mut leaves) = (end, begin);
            for body in &self.bodies {
                let [low, high] = body.interval(token, &position, &direction);
                let (low, high) = (low.most(begin), high.least(end));
                let met = low.lt(high);
                enters = R::select(met, enters.least(low), enters);
                leaves = R::select(met, leaves.most(high), leaves);
            }
            #[allow(clippy::cast_possible_truncation, reason = "sixteen bits")]
            let there = ((1_u64 << lanes) - 1) as u32;
            let met = R::and(enters.lt(leaves), R::from_bitmask(token, there));
            let ray = load(&hits.ray[..]);
            // What is kept goes to where it was, or before that.
            ray.compress(met).store(&mut hits.ray[kept..]);
            for axis in 0..3 {
                position[axis].compress(met).store(&mut hits.position[axis][kept..]);
                direction[axis].compress(met).store(&mut hits.direction[axis][kept..]);
            }
            enters.compress(met).store(&mut hits.begin[kept..]);
            leaves.compress(met).store(&mut hits.end[kept..]);
            kept += R::bitmask(met).count_ones() as usize;
        }
        hits.count = kept;
    }
}
