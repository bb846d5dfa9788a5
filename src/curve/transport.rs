//! The rotation-minimising frame along one segment.
//!
//! A frame that leans on a fixed unit vector n, `B = normalise(n - (n.T) T)`, `N = B x T`, turns about the tangent at the rate
//!
//! ```text
//! N' . B = (n . C') (n . C' x C'') / (|C'| |n x C'|^2)
//! ```
//!
//! so the rotation-minimising frame is that frame turned back by the rate's integral. In a plane with normal n the rate is zero and
//! the frame is closed form, through cusps and folds too. A cubic that leaves every plane has no cusp (C' = 0 would put
//! all its derivatives in one plane); it is cut into spans along which T stays within 60 degrees, n is the
//! normal of the span's end tangents, and eight Gauss points integrate the small rate that is left. There is no step error, and nothing to see
//! at the ends of spans.
//!
//! The frame itself: Bishop, "There is more than one way to frame a curve" (1975). The usual discretisation, double reflection (Wang,
//! Juettler, Zheng, Liu, "Computation of rotation minimizing frames", 2008), converges to this at fourth order.

use super::polynomial::{GAUSS_8, gauss};
use super::{Frame, Segment};
use glam::DVec3;

/// Unit vector that a span's reference frame leans on, and how the wanted frame lies to it.
#[derive(Debug, Clone, Copy)]
struct Span {
    /// t at its start.
    start: f64,
    normal: DVec3,
    /// Cosine and sine of the turn about the tangent from the reference frame to the wanted one at the start.
    turn: (f64, f64),
}

/// The rotation-minimising frame of one segment, fixed by its frame at t = 0.
#[derive(Debug, Clone)]
pub(super) struct Transport {
    spans: Vec<Span>,
    /// Whether the segment lies in the plane normal to its only span's normal.
    planar: bool,
}

/// How a segment lies in space.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Extent {
    /// On one line, perhaps to and fro.
    Line,
    /// In the plane with this unit normal.
    Plane(DVec3),
    /// In no plane.
    Space,
}

/// How the segment lies in space, to 1e-12 of its size out of a plane and 1e-15 off a line.
pub(super) fn extent(segment: &Segment) -> Extent {
    let [_, a, b, c] = *segment.power();
    // Products of unit vectors, weighed by the shorter length, so that no small coefficient decides.
    let pairs = [(a, b), (a, c), (b, c)];
    let size = a.length() + b.length() + c.length();
    let mut best = (0.0, DVec3::ZERO, DVec3::ZERO);
    for (p, q) in pairs {
        let (p, q) = if p.length_squared() >= q.length_squared() { (p, q) } else { (q, p) };
        let across = p.normalize_or_zero().cross(q);
        if across.length() > best.0 {
            best = (across.length(), across, p.normalize_or_zero());
        }
    }
    let (height, across, along) = best;
    if height <= 1e-15 * size {
        return Extent::Line;
    }
    let mut normal = across / height;
    // The product of nearly parallel vectors is far from normal to them: repair it against the longer one.
    normal = (normal - normal.dot(along) * along).normalize();
    let out = [a, b, c].iter().fold(0.0, |m: f64, v| m.max(normal.dot(*v).abs()));
    if segment.degree() < 3 || out <= 1e-12 * size { Extent::Plane(normal) } else { Extent::Space }
}

impl Transport {
    /// Carries `start`, a frame on the tangent at t = 0, along the segment.
    pub(super) fn new(segment: &Segment, extent: Extent, start: &Frame) -> Transport {
        match extent {
            // Any normal will do; with the frame's own a fold turns the frame about its normal.
            Extent::Line => Transport::planar(segment, start.normal, start),
            Extent::Plane(normal) => Transport::planar(segment, normal, start),
            Extent::Space => Transport::spatial(segment, start),
        }
    }

    fn planar(segment: &Segment, normal: DVec3, start: &Frame) -> Transport {
        let turn = turn_between(&leaning(normal, segment.tangent(0.0)), start);
        Transport { spans: vec![Span { start: 0.0, normal, turn }], planar: true }
    }

    fn spatial(segment: &Segment, start: &Frame) -> Transport {
        let mut carried = Transport { spans: Vec::new(), planar: false };
        let mut frame = *start;
        let mut pending = vec![(0.0, 1.0)];
        while let Some((a, b)) = pending.pop() {
            let mid = 0.5 * (a + b);
            let normal = span_normal(segment, a, b);
            if b - a < 1e-12 || (within_cone(segment, a, b) && converged(segment, normal, a, b)) {
                let turn = turn_between(&leaning(normal, segment.tangent(a)), &frame);
                carried.spans.push(Span { start: a, normal, turn });
                frame = carried.at(segment, b);
            } else {
                pending.push((mid, b));
                pending.push((a, mid));
            }
        }
        carried
    }

    /// The frame at t.
    #[inline]
    pub(super) fn at(&self, segment: &Segment, t: f64) -> Frame {
        let next = self.spans.partition_point(|span| span.start <= t).max(1);
        let span = &self.spans[next - 1];
        let reference = leaning(span.normal, segment.tangent(t));
        let (cos, sin) = span.turn;
        if self.planar {
            return reference.turned(cos, sin);
        }
        let (s, c) = libm::sincos(-gauss(&GAUSS_8, span.start, t, |t| rate(segment, span.normal, t)));
        reference.turned(cos * c - sin * s, sin * c + cos * s)
    }

    #[cfg(test)]
    pub(super) fn span_count(&self) -> usize {
        self.spans.len()
    }
}

/// The frame whose binormal leans on `normal`.
#[inline]
pub(super) fn leaning(normal: DVec3, tangent: DVec3) -> Frame {
    let binormal = (normal - normal.dot(tangent) * tangent).normalize();
    Frame { tangent, normal: binormal.cross(tangent), binormal }
}

/// Cosine and sine of the turn about the tangent that takes one frame to another on the same tangent.
pub(super) fn turn_between(from: &Frame, to: &Frame) -> (f64, f64) {
    let (x, y) = (to.normal.dot(from.normal), to.normal.dot(from.binormal));
    let length = (x * x + y * y).sqrt();
    if length > 0.0 { (x / length, y / length) } else { (1.0, 0.0) }
}

/// How fast the frame that leans on `normal` turns about the tangent, in radians per unit of t.
#[inline]
fn rate(segment: &Segment, normal: DVec3, t: f64) -> f64 {
    let (d1, d2) = (segment.d1(t), segment.d2(t));
    let out = normal.dot(d1);
    let square = d1.length_squared();
    out * normal.dot(d1.cross(d2)) / (square.sqrt() * (square - out * out))
}

/// A unit vector about which the tangent turns from a to b, at right angles to it at both ends.
fn span_normal(segment: &Segment, a: f64, b: f64) -> DVec3 {
    let (ta, tb) = (segment.tangent(a), segment.tangent(b));
    let across = ta.cross(tb);
    // Nearly parallel tangents define no plane to rounding; any normal of theirs leaves a small rate.
    if across.length_squared() > 1e-16 { across.normalize() } else { ta.any_orthonormal_vector() }
}

/// Whether the control points of C' on [a, b], and so all its tangents, lie within 60 degrees of each other.
fn within_cone(segment: &Segment, a: f64, b: f64) -> bool {
    let p = [segment.d1(a), segment.d1(a) + 0.5 * (b - a) * segment.d2(a), segment.d1(b)];
    let near = |u: DVec3, v: DVec3| u.dot(v) > 0.5 * (u.length_squared() * v.length_squared()).sqrt();
    near(p[0], p[1]) && near(p[1], p[2]) && near(p[0], p[2])
}

/// Whether the whole and the two halves agree to 1e-13 radians.
fn converged(segment: &Segment, normal: DVec3, a: f64, b: f64) -> bool {
    let turn = |a: f64, b: f64| gauss(&GAUSS_8, a, b, |t| rate(segment, normal, t));
    let mid = 0.5 * (a + b);
    (turn(a, b) - turn(a, mid) - turn(mid, b)).abs() <= 1e-13
}
