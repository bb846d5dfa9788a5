//! One Bezier segment.

use super::polynomial::quadratic_roots;
use glam::DVec3;

/// A quadratic or cubic Bezier segment, t in [0, 1], held in power form.
///
/// Coefficients that are mere rounding of the control points (below 8 ulp of the largest coordinate) are
/// exactly zero: an elevated quadratic is a quadratic again, and evenly spaced points on a line make a
/// segment of degree 1.
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
    /// Where C' vanishes to rounding it is the limit of the tangent: from below at t = 1, from above
    /// elsewhere, so at a cusp inside the segment the tangent after it.
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
    // What is not finite must stay to be seen.
    if v.is_finite() && v.abs().max_element() <= noise { DVec3::ZERO } else { v }
}

#[cfg(test)]
mod tests {
    use super::super::testing::Random;
    use super::*;
    use glam::dvec3;

    #[test]
    fn passes_through_its_ends_along_its_legs() {
        let mut random = Random(1);
        for _ in 0..200 {
            let p = [random.point(), random.point(), random.point(), random.point()];
            let cubic = Segment::cubic(p);
            // A few sums of numbers below 20: 1e-14.
            assert!(cubic.at(0.0).distance(p[0]) < 1e-14 && cubic.at(1.0).distance(p[3]) < 1e-14);
            assert!(cubic.d1(1.0).distance(3.0 * (p[3] - p[2])) < 1e-13);
            assert!(cubic.d2(0.0).distance(6.0 * (p[2] - 2.0 * p[1] + p[0])) < 1e-13);
            assert!(cubic.d3().distance(cubic.d2(1.0) - cubic.d2(0.0)) < 1e-13);
            assert!(cubic.tangent(0.3).distance(cubic.d1(0.3).normalize()) < 1e-15);
        }
    }

    #[test]
    fn degree_sees_through_rounding() {
        let mut random = Random(2);
        for _ in 0..200 {
            let [a, b, c] = [random.point(), random.point(), random.point()];
            let quadratic = Segment::quadratic([a, b, c]);
            let elevated = Segment::cubic([a, a + (b - a) * (2.0 / 3.0), c + (b - c) * (2.0 / 3.0), c]);
            assert_eq!((quadratic.degree(), elevated.degree()), (2, 2));
            assert!(quadratic.at(0.37).distance(elevated.at(0.37)) < 1e-14);
            assert_eq!(Segment::quadratic([a, 0.5 * (a + c), c]).degree(), 1);
            assert_eq!(Segment::cubic([a, a, a, a]).degree(), 0);
        }
        // A real bend of 1e-12 of the size is kept.
        assert_eq!(Segment::quadratic([DVec3::ZERO, dvec3(0.5, 1e-12, 0.0), DVec3::X]).degree(), 2);
    }

    #[test]
    fn tangent_at_a_vanishing_derivative_continues_the_motion() {
        let (o, x, xy) = (DVec3::ZERO, DVec3::X, dvec3(1.0, 1.0, 0.0));
        assert_eq!(Segment::quadratic([o, o, x]).tangent(0.0), DVec3::X);
        assert_eq!(Segment::quadratic([o, x, x]).tangent(1.0), DVec3::X);
        assert_eq!(Segment::cubic([o, o, x, xy]).tangent(0.0), DVec3::X);
        assert_eq!(Segment::cubic([o, x, xy, xy]).tangent(1.0), DVec3::Y);
        assert_eq!(Segment::cubic([o, o, o, x]).tangent(0.0), DVec3::X);
        assert_eq!(Segment::cubic([o, x, x, x]).tangent(1.0), DVec3::X);
        // Fold: C' = 3 - 4 t along x. Cusp: C' = (6 t - 3)(1, ..) at t = 1/2.
        assert_eq!(Segment::quadratic([o, 1.5 * x, x]).tangent(0.75), -DVec3::X);
        let cusp = Segment::cubic([o, dvec3(1.0, 1.0, 0.0), dvec3(0.0, 1.0, 0.0), x]);
        assert_eq!(cusp.d1(0.5), DVec3::ZERO);
        let (before, at, after) = (cusp.tangent(0.5 - 1e-9), cusp.tangent(0.5), cusp.tangent(0.5 + 1e-9));
        // The tangent turns by 1e-9 in that time, and d1 is rounding / 1e-9.
        assert!(at.distance(after) < 1e-6 && at.distance(-before) < 1e-6);
    }

    #[test]
    fn bounds_are_those_of_dense_samples() {
        let mut random = Random(3);
        for i in 0..100 {
            let segment = if i % 2 == 0 { random.cubic() } else { random.quadratic() };
            let (low, high) = segment.bounds();
            let (mut min, mut max) = (segment.at(0.0), segment.at(0.0));
            for k in 0..=2000 {
                let p = segment.at(f64::from(k) / 2000.0);
                (min, max) = (min.min(p), max.max(p));
            }
            // Rounding outwards; inwards an extremum between samples, |C''| / 8 / 2000^2 < 3e-6.
            assert!((min - low).min_element() > -1e-15 && (high - max).min_element() > -1e-15);
            assert!((min - low).max_element() < 3e-6 && (high - max).max_element() < 3e-6);
        }
    }
}
