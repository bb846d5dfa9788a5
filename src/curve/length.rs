//! Arc length along one segment.

use super::Segment;
use super::polynomial::{GAUSS_8, GAUSS_16, bisect, cubic_roots_inside, gauss};

/// Arc length of one segment from its start, as a function of t.
#[derive(Debug, Clone)]
pub(super) enum ArcLength {
    /// Constant speed.
    Line(f64),
    /// Nearly constant speed: the singularities of |C'| are at least 98 from [0, 1], and eight points give all digits.
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
    starts
}
