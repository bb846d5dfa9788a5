//! The rotation-minimising frame along one segment.
//!
//! A frame that leans on a fixed unit vector n, `B = normalise(n - (n.T) T)`, `N = B x T`, turns about the
//! tangent at the rate
//!
//! ```text
//! N' . B = (n . C') (n . C' x C'') / (|C'| |n x C'|^2)
//! ```
//!
//! so the rotation-minimising frame is that frame turned back by the rate's integral. In a plane with normal
//! n the rate is zero and the frame is closed form, through cusps and folds too. A cubic that leaves every
//! plane has no cusp (C' = 0 would put all its derivatives in one plane); it is cut into spans along which T
//! stays within 60 degrees, n is the normal of the span's end tangents, and eight Gauss points integrate the
//! small rate that is left. There is no step error, and nothing to see at the ends of spans.
//!
//! The frame itself: Bishop, "There is more than one way to frame a curve" (1975). The usual discretisation,
//! double reflection (Wang, Juettler, Zheng, Liu, "Computation of rotation minimizing frames", 2008),
//! converges to this at fourth order.

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
        carried.spans.shrink_to_fit();
        carried
    }

    /// Bytes that it holds besides itself.
    pub(super) fn memory(&self) -> usize {
        self.spans.capacity() * size_of::<Span>()
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

/// Whether the whole and the two halves agree to 1e-13 radians, or as well as rounding of C' lets them.
fn converged(segment: &Segment, normal: DVec3, a: f64, b: f64) -> bool {
    let turn = |a: f64, b: f64| gauss(&GAUSS_8, a, b, |t| rate(segment, normal, t));
    let mid = 0.5 * (a + b);
    let [_, c1, c2, c3] = segment.power();
    let noise = f64::EPSILON * (c1.length() + c2.length() + c3.length()) / segment.d1(mid).length();
    (turn(a, b) - turn(a, mid) - turn(mid, b)).abs() <= 1e-13 + noise
}

#[cfg(test)]
mod tests {
    use super::super::testing::{Random, part, reversed};
    use super::*;
    use glam::dvec3;

    fn carried(segment: &Segment, start: &Frame) -> Frame {
        Transport::new(segment, extent(segment), start).at(segment, 1.0)
    }

    /// Double reflection over these parameters: Wang et al. 2008, table I.
    fn double_reflection(segment: &Segment, start: &Frame, knots: impl Iterator<Item = f64>) -> Frame {
        let reflect = |v: DVec3, mirror: DVec3| {
            let square = mirror.length_squared();
            if square > 0.0 { v - 2.0 * v.dot(mirror) / square * mirror } else { v }
        };
        let (mut x, mut tangent, mut normal) = (segment.at(0.0), start.tangent, start.normal);
        for t in knots {
            let (next_x, next_tangent) = (segment.at(t), segment.tangent(t));
            let step = next_x - x;
            let mirror = next_tangent - reflect(tangent, step);
            normal = reflect(reflect(normal, step), mirror);
            (x, tangent) = (next_x, next_tangent);
        }
        Frame { tangent, normal, binormal: tangent.cross(normal) }
    }

    fn uniform(n: u32) -> impl Iterator<Item = f64> {
        (1..=n).map(move |i| f64::from(i) / f64::from(n))
    }

    fn regular_cubic(random: &mut Random) -> Segment {
        loop {
            let cubic = random.cubic();
            let slowest = (0..=100).map(|i| cubic.d1(f64::from(i) / 100.0).length()).fold(9.0, f64::min);
            if slowest > 1.0 {
                return cubic;
            }
        }
    }

    #[test]
    fn double_reflection_converges_to_it_at_fourth_order() {
        let mut random = Random(7);
        for _ in 0..10 {
            let cubic = regular_cubic(&mut random);
            let start = Frame::on(cubic.tangent(0.0));
            let exact = carried(&cubic, &start);
            let error = |n| double_reflection(&cubic, &start, uniform(n)).normal.distance(exact.normal);
            // Asymptotic at 128 steps: order 4, of which 3.8 is asked.
            assert!(error(512) < 1e-7 && error(128) / error(256) > libm::exp2(3.8));
            // Rounding of 20 000 steps; their own error is far below.
            assert!(error(20_000) < 1e-11, "{:e}", error(20_000));
        }
    }

    #[test]
    fn agrees_with_double_reflection_along_a_helix() {
        // Four turns by quarter-turn cubics of radius 1 and pitch 0.8.
        let handle = 0.552_284_749_831;
        let quarter = |i: u32| {
            let at = |k: u32| [DVec3::X, DVec3::Y, -DVec3::X, -DVec3::Y][usize::try_from(k % 4).unwrap_or(0)];
            let rise = |x: f64| 0.2 * (f64::from(i) + x) * DVec3::Z;
            let (p, q) = (at(i), at(i + 1));
            Segment::cubic([
                p + rise(0.0),
                p + handle * q + rise(1.0 / 3.0),
                q + handle * p + rise(2.0 / 3.0),
                q + rise(1.0),
            ])
        };
        let mut frame = Frame::on(quarter(0).tangent(0.0));
        let mut reference = frame;
        for i in 0..16 {
            frame = carried(&quarter(i), &frame);
            reference = double_reflection(&quarter(i), &reference, uniform(1000));
            // Steps of 1.6e-3 radians: 16 000 fifth-order errors are below 1e-10.
            assert!(frame.normal.distance(reference.normal) < 1e-9);
        }
    }

    #[test]
    fn parts_chain_and_reversal_returns() {
        let mut random = Random(8);
        let mut most_spans = 0;
        for _ in 0..300 {
            let cubic = random.cubic();
            let start = Frame::on(cubic.tangent(0.0));
            let end = carried(&cubic, &start);
            let t = random.unit();
            let chained = carried(&part(&cubic, t, 1.0), &carried(&part(&cubic, 0.0, t), &start));
            // 1e-13 a span, and rounding of the parts' control points against the speed.
            assert!(chained.normal.distance(end.normal) < 1e-11, "{:e}", chained.normal.distance(end.normal));
            let turned = Frame { tangent: -end.tangent, normal: end.normal, binormal: -end.binormal };
            let back = carried(&reversed(&cubic), &turned);
            assert!(back.normal.distance(start.normal) < 1e-11);
            most_spans = most_spans.max(Transport::new(&cubic, extent(&cubic), &start).spans.len());
        }
        // Halving towards the tightest turn: a few spans for each of some ten levels.
        assert!(most_spans < 100, "{most_spans}");
    }

    #[test]
    fn nothing_shows_where_spans_meet() {
        let mut random = Random(9);
        for _ in 0..100 {
            let cubic = random.cubic();
            let transport = Transport::new(&cubic, extent(&cubic), &Frame::on(cubic.tangent(0.0)));
            for span in &transport.spans[1..] {
                let (before, after) =
                    (transport.at(&cubic, span.start * (1.0 - 1e-15)), transport.at(&cubic, span.start));
                // The curve itself turns by 1e-15 kappa |C'|, at most some 1e-13 here.
                assert!(before.normal.distance(after.normal) < 5e-13);
            }
        }
    }

    #[test]
    fn orthonormal_and_without_turn_about_the_tangent() {
        let mut random = Random(10);
        for _ in 0..50 {
            let cubic = regular_cubic(&mut random);
            let transport = Transport::new(&cubic, extent(&cubic), &Frame::on(cubic.tangent(0.0)));
            for i in 1..50 {
                let t = f64::from(i) / 50.0;
                let f = transport.at(&cubic, t);
                // Rounding.
                assert!(f.normal.cross(f.binormal).distance(f.tangent) < 1e-14);
                assert!((f.normal.length() - 1.0).abs() < 1e-14 && f.normal.dot(f.tangent).abs() < 1e-14);
                // N' . B by a central difference: h^2 times a third derivative, and rounding 1e-16 / h.
                let h = 1e-5;
                let turn =
                    (transport.at(&cubic, t + h).normal - transport.at(&cubic, t - h).normal) / (2.0 * h);
                assert!(turn.dot(f.binormal).abs() < 1e-6);
            }
        }
    }

    #[test]
    fn in_a_plane_the_binormal_stays() {
        let mut random = Random(11);
        for i in 0..200 {
            let (e, f) = (random.point(), random.point());
            let mut point = || (random.unit() - 0.5) * e + (random.unit() - 0.5) * f;
            let p = [point(), point(), point(), point()];
            let segment = if i % 2 == 0 { Segment::cubic(p) } else { Segment::quadratic([p[0], p[1], p[2]]) };
            let normal = e.cross(f).normalize();
            let transport =
                Transport::new(&segment, extent(&segment), &leaning(normal, segment.tangent(0.0)));
            assert!(transport.planar);
            for k in 0..=20 {
                let t = f64::from(k) / 20.0;
                // Rounding of points in the plane over the speed, rarely below 1e-2 of the size; near a cusp
                // more.
                let tolerance = 1e-14 / (segment.tangent(t).length() * segment.d1(t).length()).min(1.0);
                assert!(
                    transport.at(&segment, t).binormal.distance(normal)
                        < 20.0 * tolerance / e.cross(f).length()
                );
            }
        }
    }

    #[test]
    fn a_nearly_plane_cubic_is_near_the_plane_one() {
        // S-shaped: the Frenet frame would flip here, and its torsion has a peak of height 1 / out.
        let s = |out: f64| {
            Segment::cubic([DVec3::ZERO, dvec3(0.3, 1.0, 0.0), dvec3(0.7, -1.0, out), dvec3(1.0, 0.0, 0.0)])
        };
        let start = |segment: &Segment| leaning(DVec3::Z, segment.tangent(0.0));
        let flat = carried(&s(0.0), &start(&s(0.0)));
        for k in 2..16 {
            let out = libm::pow(0.1, f64::from(k));
            let end = carried(&s(out), &start(&s(out)));
            // The tangent leaves the plane by about out, the turn is of that order; then rounding.
            assert!(end.binormal.distance(flat.binormal) < 20.0 * out + 1e-11, "{k}");
        }
    }

    #[test]
    fn near_cusps_out_of_the_plane() {
        for k in 1..12 {
            // C' = (2 t - 1, (2 t - 1)^2, out): at the middle the tangent swings from -x over z to +x.
            let out = libm::pow(0.1, f64::from(k));
            let cubic = Segment::cubic([
                DVec3::ZERO,
                dvec3(-1.0, 1.0, out) / 3.0,
                dvec3(-1.0, 0.0, 2.0 * out) / 3.0,
                dvec3(0.0, 1.0, 3.0 * out) / 3.0,
            ]);
            let start = Frame::on(cubic.tangent(0.0));
            let transport = Transport::new(&cubic, extent(&cubic), &start);
            // The frame is carried parallel along the tangents, by smallest rotations from one to the next:
            // second order in steps of v with 2 t - 1 = out sinh v, so once extrapolated fourth. No
            // difference of positions is taken.
            let span = libm::asinh(1.0 / out);
            let chain = |n: u32| {
                (1..=n).fold(start, |frame, i| {
                    let u = out * libm::sinh(span * (2.0 * f64::from(i) / f64::from(n) - 1.0));
                    frame.bent(dvec3(u, u * u, out).normalize())
                })
            };
            let (coarse, fine) = (chain(5_000).normal, chain(10_000).normal);
            let reference = fine + (fine - coarse) / 3.0;
            // Rounding of C' over its least length, and the chain's own error.
            let tolerance = 1e-10 + 1e-15 / out;
            let found = transport.at(&cubic, 1.0).normal;
            assert!(found.distance(reference) < tolerance, "{k}: {:e}", found.distance(reference));
            assert!(transport.spans.len() < 150);
        }
    }
}
