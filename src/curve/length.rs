//! Arc length along one segment.

use super::Segment;
use super::polynomial::{GAUSS_8, GAUSS_16, bisect, cubic_roots_inside, gauss};

/// Arc length of one segment from its start, as a function of t.
#[derive(Debug, Clone)]
pub(super) enum ArcLength {
    /// Constant speed.
    Line(f64),
    /// Nearly constant speed: the singularities of |C'| are at least 98 from [0, 1], and eight points give
    /// all digits.
    Even,
    /// A quadratic measured from the vertex of its parabola.
    Vertex(Vertex),
    /// Intervals that 16 points measure to 1e-14 of the segment's length: their starts in t and in s.
    Table(Vec<(f64, f64)>),
}

/// The parabola `C'(t) = d (t - vertex) + k |d| n` with unit n normal to d.
#[derive(Debug, Clone)]
pub(super) struct Vertex {
    /// `|d|`.
    rate: f64,
    /// t at the vertex.
    vertex: f64,
    /// Speed at the vertex over `rate`.
    k: f64,
    /// The primitive at t = 0.
    start: f64,
}

impl ArcLength {
    pub(super) fn new(segment: &Segment) -> ArcLength {
        let [_, e, c2, _] = *segment.power();
        match segment.degree() {
            0 | 1 => ArcLength::Line(e.length()),
            2 => {
                let d = 2.0 * c2;
                let a = d.length_squared();
                if a <= 1e-4 * e.length_squared().max((e + d).length_squared()) {
                    return ArcLength::Even;
                }
                let vertex = -e.dot(d) / a;
                let k = ((e + vertex * d).length_squared() / a).sqrt();
                ArcLength::Vertex(Vertex { rate: a.sqrt(), vertex, k, start: primitive(-vertex, k) })
            }
            _ => ArcLength::Table(table(segment)),
        }
    }

    /// Bytes that it holds besides itself.
    pub(super) fn memory(&self) -> usize {
        match self {
            ArcLength::Table(starts) => starts.capacity() * size_of::<(f64, f64)>(),
            ArcLength::Line(_) | ArcLength::Even | ArcLength::Vertex(_) => 0,
        }
    }

    /// Arc length from t = 0.
    pub(super) fn at(&self, segment: &Segment, t: f64) -> f64 {
        match self {
            ArcLength::Line(speed) => speed * t,
            ArcLength::Even => gauss(&GAUSS_8, 0.0, t, |t| segment.d1(t).length()),
            ArcLength::Vertex(v) => v.rate * (primitive(t - v.vertex, v.k) - v.start),
            ArcLength::Table(starts) => {
                let next = starts.partition_point(|start| start.0 <= t).max(1);
                let (from, s) = starts[next - 1];
                s + gauss(&GAUSS_16, from, t, |t| segment.d1(t).length())
            }
        }
    }

    /// The t in [0, 1] at arc length `s`, by Newton's method inside a bracket.
    pub(super) fn inverse(&self, segment: &Segment, s: f64, total: f64) -> f64 {
        if s <= 0.0 {
            return 0.0;
        }
        if s >= total {
            return 1.0;
        }
        let (mut lo, mut hi, mut t) = (0.0, 1.0, s / total);
        for _ in 0..40 {
            let excess = self.at(segment, t) - s;
            if excess.abs() <= 2e-16 * total {
                return t;
            }
            if excess > 0.0 {
                hi = t;
            } else {
                lo = t;
            }
            let newton = t - excess / segment.d1(t).length();
            // Where the speed vanishes Newton's steps are wild or too short to leave the bracket's end.
            t = if newton > lo && newton < hi { newton } else { 0.5 * (lo + hi) };
            if hi - lo <= f64::EPSILON {
                return t;
            }
        }
        bisect(lo, hi, |t| self.at(segment, t) - s)
    }
}

/// Integral of `sqrt(u^2 + k^2)` from 0.
fn primitive(u: f64, k: f64) -> f64 {
    let logarithm = if k < 1e-9 * u.abs() || k == 0.0 { 0.0 } else { k * k * libm::asinh(u / k) };
    0.5 * (u * (u * u + k * k).sqrt() + logarithm)
}

/// Splits at the minima of the speed, where a cusp or a fold has its kink, then halves until 16 points suffice.
fn table(segment: &Segment) -> Vec<(f64, f64)> {
    let speed = |t: f64| segment.d1(t).length();
    let mut ends = vec![0.0];
    ends.extend(cubic_roots_inside(segment.acceleration()));
    ends.push(1.0);
    let rough: f64 = ends.windows(2).map(|w| gauss(&GAUSS_16, w[0], w[1], speed)).sum();
    let mut starts = Vec::new();
    let mut s = 0.0;
    let mut pending: Vec<(f64, f64)> = ends.windows(2).rev().map(|w| (w[0], w[1])).collect();
    while let Some((a, b)) = pending.pop() {
        let mid = 0.5 * (a + b);
        let whole = gauss(&GAUSS_16, a, b, speed);
        let halves = gauss(&GAUSS_16, a, mid, speed) + gauss(&GAUSS_16, mid, b, speed);
        if (whole - halves).abs() <= 1e-14 * rough || b - a < 1e-12 {
            starts.push((a, s));
            s += whole;
        } else {
            pending.push((mid, b));
            pending.push((a, mid));
        }
    }
    starts.shrink_to_fit();
    starts
}

#[cfg(test)]
mod tests {
    use super::super::testing::{Random, part, reversed};
    use super::*;
    use glam::{DVec3, dvec3};

    fn length(segment: &Segment) -> f64 {
        ArcLength::new(segment).at(segment, 1.0)
    }

    /// 16 points on 44 intervals that halve towards the least speed from both sides.
    fn graded(segment: &Segment) -> f64 {
        let mut ends = cubic_roots_inside(segment.acceleration());
        ends.extend([0.0, 1.0]);
        ends.sort_by(f64::total_cmp);
        let speed = |t: f64| segment.d1(t).length();
        let mut sum = 0.0;
        for pair in ends.windows(2) {
            let half = 0.5 * (pair[1] - pair[0]);
            for (end, toward) in [(pair[0], half), (pair[1], -half)] {
                for k in 0..44 {
                    let outer = libm::pow(0.5, f64::from(k));
                    let inner = if k == 43 { 0.0 } else { 0.5 * outer };
                    sum += gauss(&GAUSS_16, end + toward * inner, end + toward * outer, speed).abs();
                }
            }
        }
        sum
    }

    #[track_caller]
    fn close(found: f64, expected: f64, tolerance: f64) {
        assert!((found / expected - 1.0).abs() <= tolerance, "{found} instead of {expected}");
    }

    #[test]
    fn lines_and_folds_in_closed_form() {
        let x = DVec3::X;
        close(
            length(&Segment::quadratic([DVec3::ZERO, dvec3(1.5, 2.0, 0.0), dvec3(3.0, 4.0, 0.0)])),
            5.0,
            4e-16,
        );
        // Unevenly run through, and with a vanishing speed at an end.
        close(length(&Segment::quadratic([DVec3::ZERO, 0.9 * x, x])), 1.0, 4e-16);
        close(length(&Segment::quadratic([DVec3::ZERO, DVec3::ZERO, x])), 1.0, 4e-16);
        close(length(&Segment::cubic([DVec3::ZERO, x, x, x])), 1.0, 1e-15);
        // Out to 9/8 and back to 1.
        close(length(&Segment::quadratic([DVec3::ZERO, 1.5 * x, x])), 1.25, 4e-16);
        // x = 6 t - 15 t^2 + 10 t^3 on a line, with turns at (1 -+ sqrt(1/5)) / 2.
        let zigzag = Segment::cubic([DVec3::ZERO, 2.0 * x, -x, x]);
        let turn = |t: f64| zigzag.at(t).x;
        let (t0, t1) = (0.5 - 0.05_f64.sqrt(), 0.5 + 0.05_f64.sqrt());
        close(length(&zigzag), turn(t0) + (turn(t0) - turn(t1)) + 1.0 - turn(t1), 1e-14);
    }

    #[test]
    fn parabola_in_closed_form() {
        // y = x^2 for x in [0, 1]: (2 sqrt(5) + asinh 2) / 4.
        let parabola = Segment::quadratic([DVec3::ZERO, dvec3(0.5, 0.0, 0.0), dvec3(1.0, 1.0, 0.0)]);
        close(length(&parabola), 1.478_942_857_544_597_4, 1e-15);
    }

    #[test]
    fn every_bend_against_graded_quadrature() {
        for k in 0..=13 {
            let bend = if k == 13 { 0.0 } else { libm::pow(0.1, f64::from(k)) };
            // B at the middle, off it, and beyond the end: a near cusp.
            for along in [0.5, 0.3, 1.5] {
                let points = [DVec3::ZERO, dvec3(along, bend, 0.3 * bend), DVec3::X];
                let quadratic = Segment::quadratic(points);
                // The method's own bound.
                close(length(&quadratic), graded(&quadratic), 1e-12);
                // And as a cubic that is not quite one: the difference in length is below 1e-13 + 1e-13.
                let [a, b, c] = points;
                let (p, q) = (a + (b - a) * (2.0 / 3.0), c + (b - c) * (2.0 / 3.0));
                let cubic = Segment::cubic([a, p + dvec3(0.0, 0.0, 1e-13), q, c]);
                assert_eq!(cubic.degree(), 3);
                close(length(&cubic), length(&quadratic), 1e-12);
            }
        }
    }

    #[test]
    fn random_segments_against_graded_quadrature() {
        let mut random = Random(4);
        for i in 0..200 {
            let segment = if i % 2 == 0 { random.cubic() } else { random.quadratic() };
            close(length(&segment), graded(&segment), 1e-12);
            close(length(&reversed(&segment)), length(&segment), 1e-12);
        }
    }

    #[test]
    fn sums_over_parts_and_grows_by_the_speed() {
        let mut random = Random(5);
        for i in 0..100 {
            let segment = if i % 2 == 0 { random.cubic() } else { random.quadratic() };
            let arc = ArcLength::new(&segment);
            let total = arc.at(&segment, 1.0);
            let t = random.unit();
            close(length(&part(&segment, 0.0, t)) + length(&part(&segment, t, 1.0)), total, 1e-12);
            assert!((length(&part(&segment, 0.0, t)) - arc.at(&segment, t)).abs() <= 1e-12 * total);
            // Five-point difference: rounding 1e-15 / h and h^4 times the fifth derivative.
            let h = 1e-3;
            let d = |x: f64| arc.at(&segment, t + x * h) - arc.at(&segment, t - x * h);
            let slope = (8.0 * d(1.0) - d(2.0)) / (12.0 * h);
            if segment.d1(t).length() > 1.0 && t > 0.01 && t < 0.99 {
                close(slope, segment.d1(t).length(), 1e-7);
            }
        }
    }

    #[test]
    fn continuous_at_the_table_s_intervals() {
        let mut random = Random(6);
        for _ in 0..50 {
            let segment = random.cubic();
            let arc = ArcLength::new(&segment);
            let ArcLength::Table(starts) = &arc else { unreachable!("a cubic has a table") };
            for (t, s) in starts {
                let before = t - t * f64::EPSILON;
                // Rounding of t times the speed, and the intervals' tolerance of 1e-14.
                assert!((arc.at(&segment, before) - s).abs() < 1e-14 * arc.at(&segment, 1.0) + 1e-14);
            }
        }
    }
}
