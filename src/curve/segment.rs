//! One Bezier segment.

use super::polynomial::quadratic_roots;
use glam::DVec3;

/// A quadratic or cubic Bezier segment, t in [0, 1], held in power form.
///
/// Coefficients that are mere rounding of the control points (below 8 ulp of the largest coordinate) are exactly zero: an elevated
/// quadratic is a quadratic again, and evenly spaced points on a line make a segment of degree 1.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Segment {
    /// `C(t) = c[0] + c[1] t + c[2] t^2 + c[3] t^3`, metres.
    c: [DVec3; 4],
}

impl Segment {
    /// The quadratic with these control points, in metres.
    pub fn quadratic(p: [DVec3; 3]) -> Segment {
        let noise = rounding(&p);
        let c2 = (p[2] - p[1]) - (p[1] - p[0]);
        Segment { c: [p[0], 2.0 * (p[1] - p[0]), unless_below(c2, noise), DVec3::ZERO] }
    }

    /// The cubic with these control points, in metres.
    pub fn cubic(p: [DVec3; 4]) -> Segment {
        let noise = rounding(&p);
        let [d0, d1, d2] = [p[1] - p[0], p[2] - p[1], p[3] - p[2]];
        let c2 = unless_below(3.0 * (d1 - d0), 3.0 * noise);
        Segment { c: [p[0], 3.0 * d0, c2, unless_below((d2 - d1) - (d1 - d0), 2.0 * noise)] }
    }

    /// Coefficients of the powers of t, constant first, in metres.
    pub fn power(&self) -> &[DVec3; 4] {
        &self.c
    }

    /// The highest power of t with a coefficient other than zero, 0 to 3.
    pub fn degree(&self) -> usize {
        (1..4).rev().find(|&k| self.c[k] != DVec3::ZERO).unwrap_or(0)
    }

    /// The point C(t), in metres.
    #[inline]
    pub fn at(&self, t: f64) -> DVec3 {
        ((self.c[3] * t + self.c[2]) * t + self.c[1]) * t + self.c[0]
    }

    /// The first derivative C'(t).
    #[inline]
    pub fn d1(&self, t: f64) -> DVec3 {
        (3.0 * self.c[3] * t + 2.0 * self.c[2]) * t + self.c[1]
    }

    /// The second derivative C''(t).
    #[inline]
    pub fn d2(&self, t: f64) -> DVec3 {
        6.0 * self.c[3] * t + 2.0 * self.c[2]
    }

    /// The third derivative, the same for all t.
    #[inline]
    pub fn d3(&self) -> DVec3 {
        6.0 * self.c[3]
    }

    /// The unit tangent; the zero vector where the segment has no length.
    ///
    /// Where C' vanishes to rounding it is the limit of the tangent: from below at t = 1, from above elsewhere, so at a cusp
    /// inside the segment the tangent after it.
    #[inline]
    pub fn tangent(&self, t: f64) -> DVec3 {
        let d = self.d1(t);
        let square = d.length_squared();
        // Below 1e-14 of the coefficients the direction of C' is that of rounding errors.
        let noise = 1e-28
            * (self.c[1].length_squared()
                + 4.0 * self.c[2].length_squared()
                + 9.0 * self.c[3].length_squared());
        if square > noise { d / square.sqrt() } else { self.limit_tangent(t) }
    }

    #[cold]
    fn limit_tangent(&self, t: f64) -> DVec3 {
        let d = self.d2(t);
        let noise = 1e-28 * (4.0 * self.c[2].length_squared() + 36.0 * self.c[3].length_squared());
        if d.length_squared() > noise {
            // C'(t + h) = h C''(t) + ...: before the end h is negative.
            let from_below = t > 1.0 - 1e-9;
            (if from_below { -d } else { d }).normalize_or_zero()
        } else {
            self.c[3].normalize_or_zero()
        }
    }

    /// The corners of the curve's own axis-aligned box, exact to rounding, in metres.
    pub fn bounds(&self) -> (DVec3, DVec3) {
        let (a, b) = (self.c[0], self.at(1.0));
        let (mut low, mut high) = (a.min(b), a.max(b));
        for axis in 0..3 {
            let slope = [self.c[1][axis], 2.0 * self.c[2][axis], 3.0 * self.c[3][axis]];
            for t in quadratic_roots(slope).into_iter().flatten().filter(|t| *t > 0.0 && *t < 1.0) {
                let x = self.at(t)[axis];
                low[axis] = low[axis].min(x);
                high[axis] = high[axis].max(x);
            }
        }
        (low, high)
    }

    /// Coefficients of `|C'(t)|^2 / 2` differentiated, `C' . C''`: its sign is that of the change of speed.
    pub(super) fn acceleration(&self) -> [f64; 4] {
        let [_, e, d, f] = self.c;
        let (a, b, c) = (e, 2.0 * d, 3.0 * f);
        [a.dot(b), b.dot(b) + 2.0 * a.dot(c), 3.0 * b.dot(c), 2.0 * c.dot(c)]
    }

    /// `C'(t) x C''(t)`, a quadratic in t, by its coefficients.
    pub(super) fn turning(&self) -> [DVec3; 3] {
        let [_, a, b, c] = self.c;
        [2.0 * a.cross(b), 6.0 * a.cross(c), 6.0 * b.cross(c)]
    }
}

/// What rounding can leave of a difference of these points.
fn rounding(p: &[DVec3]) -> f64 {
    8.0 * f64::EPSILON * p.iter().fold(0.0, |m: f64, q| m.max(q.abs().max_element()))
}

fn unless_below(v: DVec3, noise: f64) -> DVec3 {
    if v.abs().max_element() <= noise { DVec3::ZERO } else { v }
}
