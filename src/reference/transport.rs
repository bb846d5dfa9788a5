//! Orthonormal frames, and the differential equation of the one that turns least.

use super::piece::Piece;
use nalgebra::Vector3;

/// A right-handed orthonormal frame, `normal x binormal = tangent`.
#[derive(Debug, Clone, Copy)]
pub(super) struct Frame {
    pub(super) tangent: Vector3<f64>,
    pub(super) normal: Vector3<f64>,
    pub(super) binormal: Vector3<f64>,
}

impl Frame {
    /// On a unit tangent, with the part of `normal` across it.
    pub(super) fn new(tangent: Vector3<f64>, normal: Vector3<f64>) -> Frame {
        let normal = (normal - normal.dot(&tangent) * tangent).normalize();
        Frame { tangent, normal, binormal: tangent.cross(&normal) }
    }

    /// The smallest rotation that takes +z to the tangent, applied to +x and +y; at -z, +x and -y.
    pub(super) fn at_start(tangent: Vector3<f64>) -> Frame {
        let (x, y, z) = (tangent.x, tangent.y, tangent.z);
        // 1 + z loses its digits near -z.
        let above = if z > 0.0 { 1.0 + z } else { (x * x + y * y) / (1.0 - z) };
        if above == 0.0 {
            return Frame::new(tangent, Vector3::x());
        }
        Frame::new(tangent, Vector3::new(1.0 - x * x / above, -x * y / above, -x))
    }

    /// Turned about the unit vector `axis` by the angle between the tangents, to another tangent.
    pub(super) fn turned(&self, axis: &Vector3<f64>, tangent: Vector3<f64>) -> Frame {
        let (cos, sin) = (self.tangent.dot(&tangent), self.tangent.cross(&tangent).norm());
        let along = self.normal.dot(axis) * axis;
        let across = self.normal - along;
        Frame::new(tangent, along + cos * across + sin * axis.cross(&across))
    }
}

/// A unit vector at right angles to a unit vector.
pub(super) fn any_across(tangent: &Vector3<f64>) -> Vector3<f64> {
    tangent.cross(&Vector3::ith(tangent.iamin(), 1.0)).normalize()
}

/// The rotation-minimising normal at `b`, given as `normal` at `a`: the solution of `N' = -(N . T') T`.
///
/// One step of the Gragg-Bulirsch-Stoer method, of order 16: modified midpoint rules of 2, 4, .. 16 substeps,
/// extrapolated to none (Stoer and Bulirsch, "Introduction to numerical analysis", 7.2.14).
pub(super) fn step(piece: &Piece, a: f64, b: f64, normal: Vector3<f64>) -> Vector3<f64> {
    let mut row: Vec<Vector3<f64>> = Vec::new();
    for substeps in (2..=16).step_by(2) {
        let mut next = vec![midpoint(piece, a, b, normal, substeps)];
        for (k, above) in row.iter().enumerate() {
            let coarse = substeps - 2 * u32::try_from(k + 1).expect("at most eight columns");
            let ratio = f64::from(substeps) / f64::from(coarse);
            let difference = next[k] - above;
            next.push(next[k] + difference / (ratio * ratio - 1.0));
        }
        row = next;
    }
    row.last().map_or(normal, |best| best.normalize())
}

fn midpoint(piece: &Piece, a: f64, b: f64, normal: Vector3<f64>, substeps: u32) -> Vector3<f64> {
    let h = (b - a) / f64::from(substeps);
    let slope = |x: f64, n: &Vector3<f64>| {
        let local = piece.local(x);
        -n.dot(&local.turn) * local.tangent
    };
    let (mut before, mut now) = (normal, normal + h * slope(a, &normal));
    for i in 1..substeps {
        (before, now) = (now, before + 2.0 * h * slope(a + f64::from(i) * h, &now));
    }
    0.5 * (now + before + h * slope(b, &now))
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "what is not there fails the test")]
mod tests {
    use super::super::axis::Axis;
    use super::super::tests::Random;
    use super::*;
    use crate::curve::{Curve, FrameRule, Segment};
    use std::f64::consts::TAU;

    fn power(segment: &Segment) -> [Vector3<f64>; 4] {
        segment.power().map(|c| Vector3::new(c.x, c.y, c.z))
    }

    fn random_cubic(random: &mut Random) -> Segment {
        Segment::cubic([0; 4].map(|_| random.point(1.0).into()))
    }

    #[test]
    fn starts_by_the_smallest_rotation() {
        let mut random = Random(1);
        for _ in 0..100 {
            let tangent = Vector3::from(random.point(1.0)).normalize();
            let frame = Frame::at_start(tangent);
            // The rotation about z x T by the angle between them, by nalgebra.
            let turn = nalgebra::Rotation3::rotation_between(&Vector3::z(), &tangent).unwrap();
            assert!((frame.normal - turn * Vector3::x()).norm() < 1e-14);
            assert!((frame.binormal - turn * Vector3::y()).norm() < 1e-14);
        }
        let down = Frame::at_start(-Vector3::z());
        assert_eq!((down.normal, down.binormal), (Vector3::x(), -Vector3::y()));
    }

    /// Classical Runge-Kutta in the segment's own t, 20 000 steps: error near (1 / 20 000)^4 of large
    /// derivatives.
    #[test]
    fn solves_the_frames_equation() {
        let mut random = Random(2);
        for _ in 0..8 {
            let segment = random_cubic(&mut random);
            let axis = Axis::new(&[power(&segment)], FrameRule::RotationMinimising, false);
            let c = power(&segment);
            let slope = |t: f64, n: &Vector3<f64>| {
                let (d1, d2) = (c[1] + 2.0 * t * c[2] + 3.0 * t * t * c[3], 2.0 * c[2] + 6.0 * t * c[3]);
                let tangent = d1.normalize();
                let turn = (d2 - d2.dot(&tangent) * tangent) / d1.norm();
                -n.dot(&turn) * tangent
            };
            let steps = 20_000;
            let h = 1.0 / f64::from(steps);
            let mut n = axis.at(0, 0.0).1.normal;
            for i in 0..steps {
                let t = f64::from(i) * h;
                let k1 = slope(t, &n);
                let k2 = slope(t + 0.5 * h, &(n + 0.5 * h * k1));
                let k3 = slope(t + 0.5 * h, &(n + 0.5 * h * k2));
                let k4 = slope(t + h, &(n + h * k3));
                n += h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4);
                if i % 1999 == 0 {
                    let found = axis.at(0, t + h).1.normal;
                    assert!((found - n).norm() < 1e-10, "t {t}: off by {}", (found - n).norm());
                }
            }
        }
    }

    /// On a helix of radius a and slope b the rotation-minimising frame turns back against Frenet's by the
    /// torsion b / (a^2 + b^2) times the arc length.
    #[test]
    fn turns_on_a_helix_by_the_torsion() {
        let (a, b, turns, n) = (1.0, 0.5, 2.0, 400);
        let point = |w: f64| Vector3::new(a * libm::cos(w), a * libm::sin(w), b * w);
        let velocity = |w: f64| Vector3::new(-a * libm::sin(w), a * libm::cos(w), b);
        let step = turns * TAU / f64::from(n);
        let segments: Vec<[Vector3<f64>; 4]> = (0..n)
            .map(|i| {
                let (w0, w1) = (step * f64::from(i), step * f64::from(i + 1));
                let (p, q, v, w) = (point(w0), point(w1), step * velocity(w0), step * velocity(w1));
                [p, v, 3.0 * (q - p) - 2.0 * v - w, 2.0 * (p - q) + v + w]
            })
            .collect();
        let axis = Axis::new(&segments, FrameRule::RotationMinimising, false);
        // Hermite pieces: position off by step^4 / 384, tangents by step^3, from side to side.
        let length = turns * TAU * (a * a + b * b).sqrt();
        assert!((axis.length() - length).abs() < 1e-6);
        let frenet = |w: f64| -> [Vector3<f64>; 2] {
            let normal = Vector3::new(-libm::cos(w), -libm::sin(w), 0.0);
            [normal, velocity(w).normalize().cross(&normal)]
        };
        let angle = |frame: &Frame, w: f64| {
            let [n, b] = frenet(w);
            libm::atan2(frame.normal.dot(&b), frame.normal.dot(&n))
        };
        let start = angle(&axis.at(0, 0.0).1, 0.0);
        let end = angle(&axis.at(segments.len() - 1, 1.0).1, turns * TAU);
        let turned = end - start + b / (a * a + b * b) * length;
        assert!((turned - TAU * (turned / TAU).round()).abs() < 1e-6, "{turned}");
    }

    /// Two ways to the same frame and arc length: this module's, and the curve module's.
    #[test]
    fn agrees_with_the_curve_module() {
        let mut random = Random(3);
        let p = |x: f64, y: f64, z: f64| glam::DVec3::new(x, y, z);
        let mut chains: Vec<Vec<Segment>> = Vec::new();
        for _ in 0..20 {
            let one = random_cubic(&mut random);
            let [b, c, d, e] = [0; 4].map(|_| glam::DVec3::from(random.point(1.0)));
            let two = Segment::quadratic([one.at(1.0), b, c]);
            chains.push(vec![one, two, Segment::cubic([c, d, e, d])]);
        }
        // A fold on a line, a plane cusp, straight on after each; an S in a plane; a line before a bend; half
        // a turn.
        chains.push(vec![
            Segment::quadratic([p(0.0, 0.0, 0.0), p(3.0, 0.0, 1.5), p(2.0, 0.0, 1.0)]),
            Segment::quadratic([p(2.0, 0.0, 1.0), p(2.0, 1.0, 1.0), p(3.0, 1.0, 1.0)]),
        ]);
        chains.push(vec![Segment::cubic([
            p(0.0, 0.0, 0.0),
            p(1.0, 1.0, 0.0),
            p(0.0, 1.0, 0.0),
            p(1.0, 0.0, 0.0),
        ])]);
        chains.push(vec![Segment::cubic([
            p(0.0, 0.0, 0.0),
            p(1.0, 1.0, 0.0),
            p(2.0, -1.0, 0.0),
            p(3.0, 0.0, 0.0),
        ])]);
        chains.push(vec![
            Segment::quadratic([p(0.0, 0.0, 0.0), p(0.0, 0.0, 1.0), p(0.0, 0.0, 2.0)]),
            Segment::quadratic([p(0.0, 0.0, 2.0), p(1.0, 0.5, 3.0), p(2.0, 0.0, 3.0)]),
            Segment::quadratic([p(2.0, 0.0, 3.0), p(2.5, -0.25, 3.0), p(3.0, -0.5, 3.0)]),
            Segment::quadratic([p(3.0, -0.5, 3.0), p(2.5, -0.25, 3.0), p(2.0, 0.0, 3.0)]),
        ]);
        // Turns as sharp as eps: all but cusps in space and in a plane, and all but a fold.
        for eps in [1e-2, 1e-4, 1e-6] {
            let near = |a: f64, z: f64| {
                let points = [p(0.0, 0.0, 0.0), p(1.0 - a, 1.0, z), p(a, 1.0, -z), p(1.0, 0.0, 0.3 * z)];
                vec![Segment::cubic(points)]
            };
            chains.extend([near(0.0, eps), near(eps, 0.0), near(-eps, 0.0)]);
            chains.push(vec![Segment::quadratic([p(0.0, 0.0, 0.0), p(3.0, eps, 0.0), p(2.0, 0.0, eps)])]);
        }
        for (chain, segments) in chains.iter().enumerate() {
            for rule in [FrameRule::RotationMinimising, FrameRule::Frenet] {
                let curve = Curve::new(segments.clone(), rule).unwrap();
                let powers: Vec<_> = curve.segments().iter().map(power).collect();
                let axis = Axis::new(&powers, rule, false);
                assert!((axis.length() - curve.length()).abs() < 1e-12 * axis.length());
                for segment in 0..segments.len() {
                    for i in 1..40 {
                        // Not on the breaks, which are at simple fractions here.
                        let t = f64::from(i) / 40.0 + 0.003;
                        let (arc, ours) = axis.at(segment, t);
                        let theirs = curve.frame(segment, t);
                        let off = |a: Vector3<f64>, b: glam::DVec3| (a - Vector3::new(b.x, b.y, b.z)).norm();
                        let off = off(ours.tangent, theirs.tangent)
                            .max(off(ours.normal, theirs.normal))
                            .max(off(ours.binormal, theirs.binormal));
                        // The curve module's stated error is 1e-11 and ours adds up to 1e-12.
                        assert!(off < 3e-11, "chain {chain} {rule:?} segment {segment} t {t}: off by {off}");
                        assert!((arc - curve.arc_length(segment, t)).abs() < 2e-12 * axis.length());
                    }
                }
            }
        }
    }
}
