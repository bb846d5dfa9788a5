//! Frames along a curve.

use super::Segment;
use super::polynomial::{bisect, cubic_roots_inside};
use super::transport::{Extent, Transport, extent, leaning, turn_between};
use glam::DVec3;

/// Which frame carries the cross-section along the curve.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FrameRule {
    /// Turns about the tangent as little as it can.
    RotationMinimising,
    /// The principal normal; carried on without turning where there is none.
    Frenet,
}

/// A right-handed orthonormal frame: `normal x binormal = tangent`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Frame {
    /// Unit tangent.
    pub tangent: DVec3,
    /// Where the cylinder's u axis points before twist.
    pub normal: DVec3,
    /// Where the cylinder's v axis points before twist.
    pub binormal: DVec3,
}

impl Frame {
    /// The frame on a unit tangent that the smallest rotation from +z to it makes of +x (normal) and +y
    /// (binormal).
    ///
    /// On -z, where no rotation is the smallest, the normal is +x and the binormal -y.
    pub fn on(tangent: DVec3) -> Frame {
        let DVec3 { x, y, z } = tangent;
        let across = x * x + y * y;
        if z < 0.0 && across < 1e-300 {
            return Frame { tangent, normal: DVec3::X, binormal: DVec3::NEG_Y };
        }
        // 1 / (1 + z), without cancellation near -z.
        let q = if z < 0.0 { (1.0 - z) / across } else { 1.0 / (1.0 + z) };
        Frame {
            tangent,
            normal: DVec3::new(1.0 - q * x * x, -q * x * y, -x),
            binormal: DVec3::new(-q * x * y, 1.0 - q * y * y, -y),
        }
        .squared()
    }

    /// The frame turned about its tangent by the angle of this cosine and sine.
    #[inline]
    pub(super) fn turned(&self, cos: f64, sin: f64) -> Frame {
        Frame {
            tangent: self.tangent,
            normal: cos * self.normal + sin * self.binormal,
            binormal: cos * self.binormal - sin * self.normal,
        }
    }

    /// The frame turned by the smallest rotation to another unit tangent, and about its normal to the
    /// opposite one.
    pub(super) fn bent(&self, tangent: DVec3) -> Frame {
        let axis = self.tangent.cross(tangent);
        let opposite = self.tangent.dot(tangent) < 0.0;
        if opposite && axis.length_squared() < 1e-18 {
            return Frame { tangent, normal: self.normal, binormal: -self.binormal }.squared();
        }
        // 1 / (1 + cos), without cancellation near the opposite tangent.
        let cos = self.tangent.dot(tangent);
        let q = if opposite { (1.0 - cos) / axis.length_squared() } else { 1.0 / (1.0 + cos) };
        let turn = |v: DVec3| v + axis.cross(v) + q * axis.cross(axis.cross(v));
        Frame { tangent, normal: turn(self.normal), binormal: turn(self.binormal) }.squared()
    }

    /// Orthonormal to rounding again, on the same tangent.
    fn squared(self) -> Frame {
        let normal = (self.normal - self.normal.dot(self.tangent) * self.tangent).normalize();
        Frame { tangent: self.tangent, normal, binormal: self.tangent.cross(normal) }
    }
}

/// The frames of one segment.
#[derive(Debug, Clone)]
pub(super) struct Frames {
    transport: Transport,
    pieces: Vec<Piece>,
    breaks: Vec<f64>,
}

/// From `start` on, how the frame lies.
#[derive(Debug, Clone, Copy)]
struct Piece {
    start: f64,
    /// Cosine and sine of a constant turn from the transported frame; none: the principal normal by its
    /// formula.
    turn: Option<(f64, f64)>,
}

impl Frames {
    /// Frames of a segment that `start`, a frame on its first tangent, arrives at.
    pub(super) fn new(segment: &Segment, rule: FrameRule, start: &Frame) -> Frames {
        let extent = extent(segment);
        let transport = Transport::new(segment, extent, start);
        let pieces = match (rule, extent) {
            (FrameRule::RotationMinimising, _) | (_, Extent::Line) => {
                vec![Piece { start: 0.0, turn: Some((1.0, 0.0)) }]
            }
            (FrameRule::Frenet, _) => frenet_pieces(segment, extent, &transport),
        };
        let mut breaks: Vec<f64> = pieces[1..].iter().map(|piece| piece.start).collect();
        breaks.extend(sharp_turns(segment));
        breaks.sort_by(f64::total_cmp);
        breaks.dedup();
        breaks.shrink_to_fit();
        Frames { transport, pieces, breaks }
    }

    /// Bytes that they hold besides themselves.
    pub(super) fn memory(&self) -> usize {
        self.transport.memory()
            + self.pieces.capacity() * size_of::<Piece>()
            + self.breaks.capacity() * size_of::<f64>()
    }

    /// The frame at t.
    pub(super) fn at(&self, segment: &Segment, t: f64) -> Frame {
        let next = self.pieces.partition_point(|piece| piece.start <= t).max(1);
        match self.pieces[next - 1].turn {
            Some((1.0, 0.0)) => self.transport.at(segment, t),
            Some((cos, sin)) => self.transport.at(segment, t).turned(cos, sin),
            None => principal(segment, t),
        }
    }

    /// Every t in (0, 1) where the frame jumps, or all but jumps, ascending.
    pub(super) fn breaks(&self) -> &[f64] {
        &self.breaks
    }
}

/// Tangent, principal normal and binormal of a curve with curvature at t.
fn principal(segment: &Segment, t: f64) -> Frame {
    let [a, b, c] = segment.turning();
    leaning(((c * t + b) * t + a).normalize(), segment.tangent(t))
}

/// Cusps and folds: minima of the speed, at most 1e-9 of what it is made of, in (0, 1).
fn sharp_turns(segment: &Segment) -> Vec<f64> {
    let [_, a, b, c] = *segment.power();
    let speed = a.length() + 2.0 * b.length() + 3.0 * c.length();
    let mut turns = cubic_roots_inside(segment.acceleration());
    turns.retain(|t| segment.d1(*t).length() <= 1e-9 * speed);
    turns
}

/// Splits [0, 1] where the curvature passes 1e-6 over the segment's size, and a planar segment's normal
/// changes side.
fn frenet_pieces(segment: &Segment, extent: Extent, transport: &Transport) -> Vec<Piece> {
    let [q0, q1, q2] = segment.turning();
    let (low, high) = segment.bounds();
    let least = 1e-6 / (high - low).length();
    let turning = |t: f64| (q2 * t + q1) * t + q0;
    // |C' x C''| - least |C'|^3: the sign of the curvature less its least value.
    let excess = |t: f64| {
        let d1 = segment.d1(t).length();
        turning(t).length() - least * d1 * d1 * d1
    };
    // The curvature is least near the least |C' x C''| and greatest near the least speed; a grid for the rest.
    let mut ends: Vec<f64> = (0..=32).map(|i| f64::from(i) / 32.0).collect();
    ends.extend(cubic_roots_inside(segment.acceleration()));
    ends.extend(cubic_roots_inside([
        q0.dot(q1),
        q1.dot(q1) + 2.0 * q0.dot(q2),
        3.0 * q1.dot(q2),
        2.0 * q2.dot(q2),
    ]));
    ends.sort_by(f64::total_cmp);
    ends.dedup();
    let mut cuts = vec![0.0];
    for pair in ends.windows(2) {
        if (excess(pair[0]) < 0.0) != (excess(pair[1]) < 0.0) {
            cuts.push(bisect(pair[0], pair[1], excess));
        }
    }
    cuts.dedup();

    let mut pieces: Vec<Piece> = Vec::new();
    let mut carried = (1.0, 0.0);
    for (i, &start) in cuts.iter().enumerate() {
        let end = cuts.get(i + 1).copied().unwrap_or(1.0);
        // The point inside the piece where the curve turns the most: never an inflection or a cusp.
        let inside = [0.25, 0.5, 0.75].map(|x| start + x * (end - start));
        let most = inside.into_iter().fold(inside[0], |m, t| {
            if turning(t).length_squared() > turning(m).length_squared() { t } else { m }
        });
        let curved = excess(most) >= 0.0;
        let turn = match extent {
            Extent::Space if curved => None,
            _ if curved => Some(turn_between(&transport.at(segment, most), &principal(segment, most))),
            _ => Some(carried),
        };
        // A planar piece's turn is the one before it to rounding, or opposite to it: rounding must not make a
        // break.
        let turn =
            turn.map(|(x, y)| if x * carried.0 + y * carried.1 > 1.0 - 1e-9 { carried } else { (x, y) });
        carried = turn.unwrap_or_else(|| turn_between(&transport.at(segment, end), &principal(segment, end)));
        if pieces.last().is_none_or(|last| last.turn != turn) {
            pieces.push(Piece { start, turn });
        }
    }
    pieces
}

#[cfg(test)]
mod tests {
    use super::super::testing::Random;
    use super::*;
    use glam::dvec3;

    fn assert_orthonormal(f: &Frame) {
        // A few roundings.
        assert!((f.tangent.length() - 1.0).abs() < 1e-14 && (f.normal.length() - 1.0).abs() < 1e-14);
        assert!(f.normal.cross(f.binormal).distance(f.tangent) < 1e-14, "{f:?}");
    }

    #[test]
    fn start_frame_is_the_smallest_rotation_of_the_axes() {
        assert_eq!(Frame::on(DVec3::Z), Frame { tangent: DVec3::Z, normal: DVec3::X, binormal: DVec3::Y });
        let down = Frame::on(-DVec3::Z);
        assert_eq!(down, Frame { tangent: -DVec3::Z, normal: DVec3::X, binormal: -DVec3::Y });
        let mut random = Random(20);
        for k in 0..300 {
            // From anywhere to ever closer to -z.
            let tangent = if k < 100 {
                random.point().normalize()
            } else {
                (-DVec3::Z + libm::pow(0.8, f64::from(k - 100)) * random.point()).normalize()
            };
            let f = Frame::on(tangent);
            assert_orthonormal(&f);
            // The axis of the rotation, z x T, stays: its shares of x and y are its shares of normal and
            // binormal.
            let axis = DVec3::Z.cross(tangent).normalize();
            assert!((axis.x * f.normal + axis.y * f.binormal).distance(axis) < 1e-13);
        }
    }

    #[test]
    fn bending_keeps_the_axis_and_is_undone() {
        let mut random = Random(21);
        for k in 0..300 {
            let f = Frame::on(random.point().normalize());
            let to = if k < 100 {
                random.point()
            } else {
                -f.tangent + libm::pow(0.9, f64::from(k - 100)) * random.point()
            };
            let g = f.bent(to.normalize());
            assert_orthonormal(&g);
            let axis = f.tangent.cross(g.tangent);
            // Rounding over the sine of the angle, and 1e-9 at which a turn counts as a half one.
            let tolerance = 1e-15 + 1e-15 / axis.length();
            if axis.length() > 1e-8 {
                let axis = axis.normalize();
                assert!((f.normal.dot(axis) - g.normal.dot(axis)).abs() < tolerance);
                assert!(g.bent(f.tangent).normal.distance(f.normal) < 10.0 * tolerance);
            }
        }
        let f = Frame::on(DVec3::Z);
        assert_eq!(f.bent(-DVec3::Z), Frame { tangent: -DVec3::Z, normal: DVec3::X, binormal: -DVec3::Y });
    }

    fn frames(segment: &Segment, rule: FrameRule) -> Frames {
        Frames::new(segment, rule, &Frame::on(segment.tangent(0.0)))
    }

    #[test]
    fn frenet_is_the_principal_normal() {
        let mut random = Random(22);
        for i in 0..100 {
            let segment = if i % 2 == 0 { random.cubic() } else { random.quadratic() };
            let frames = frames(&segment, FrameRule::Frenet);
            assert_eq!(frames.breaks().len(), 0);
            for k in 0..=20 {
                let t = f64::from(k) / 20.0;
                let f = frames.at(&segment, t);
                assert_orthonormal(&f);
                let (d1, d2) = (segment.d1(t), segment.d2(t));
                let toward = d2 - d2.dot(f.tangent) * f.tangent;
                // Rounding over the part of C'' across the curve.
                assert!(
                    f.normal.distance(toward.normalize())
                        < 1e-13 * (1.0 + d2.length() + d1.length()) / toward.length()
                );
            }
        }
    }

    #[test]
    fn frenet_flips_at_the_inflection_of_a_plane_s() {
        let s = Segment::cubic([DVec3::ZERO, dvec3(0.3, 1.0, 0.0), dvec3(0.7, -1.0, 0.0), DVec3::X]);
        let flipping = frames(&s, FrameRule::Frenet);
        // The curve bends to the right first, and is carried on for the moment that its curvature is below
        // 1e-6.
        assert_eq!(flipping.breaks().len(), 1);
        let flip = flipping.breaks()[0];
        assert!(flip > 0.5 && flip < 0.5 + 1e-6);
        assert!(flipping.at(&s, flip - 1e-12).binormal.distance(-DVec3::Z) < 1e-14);
        assert!(flipping.at(&s, flip).binormal.distance(DVec3::Z) < 1e-14);
        let smooth = frames(&s, FrameRule::RotationMinimising);
        assert!(smooth.breaks().is_empty());
        assert!(smooth.at(&s, 0.5 - 1e-9).normal.distance(smooth.at(&s, 0.5 + 1e-9).normal) < 1e-7);
    }

    #[test]
    fn frenet_carries_on_where_the_curve_is_straight() {
        // Straight to rounding, but not to 1e-9: below the least curvature everywhere.
        let nearly = Segment::cubic([DVec3::ZERO, dvec3(0.3, 1e-9, 0.0), dvec3(0.7, 0.0, 1e-9), DVec3::X]);
        let start = Frame::on(nearly.tangent(0.0)).turned(0.6, 0.8);
        let frames = Frames::new(&nearly, FrameRule::Frenet, &start);
        assert!(frames.breaks().is_empty());
        for t in [0.0, 0.4, 1.0] {
            assert!(frames.at(&nearly, t).normal.distance(start.normal) < 1e-8);
        }
    }

    #[test]
    fn out_of_plane_inflection_is_carried_and_left() {
        // The curvature passes through 1e-9 or so at the middle, without an inflection.
        let s = Segment::cubic([DVec3::ZERO, dvec3(0.3, 1.0, 0.0), dvec3(0.7, -1.0, 1e-9), DVec3::X]);
        let frames = frames(&s, FrameRule::Frenet);
        assert_eq!(frames.breaks().len(), 2);
        let [a, b] = [frames.breaks()[0], frames.breaks()[1]];
        assert!(a < b && b - a < 1e-5);
        // Continuous where it begins to be carried: C' x C'' is known there to 1e-16 / 1e-6.
        assert!(frames.at(&s, a - 1e-13).normal.distance(frames.at(&s, a).normal) < 1e-6);
        assert!(frames.at(&s, b - 1e-13).normal.distance(frames.at(&s, b).normal) > 1.0);
    }

    #[test]
    fn folds_and_cusps_turn_once_and_say_where() {
        let fold = Segment::quadratic([DVec3::ZERO, 1.5 * DVec3::X, DVec3::X]);
        let cusp = Segment::cubic([DVec3::ZERO, dvec3(1.0, 1.0, 0.0), dvec3(0.0, 1.0, 0.0), DVec3::X]);
        for rule in [FrameRule::RotationMinimising, FrameRule::Frenet] {
            let along = frames(&fold, rule);
            assert_eq!(along.breaks(), [0.75]);
            let (before, after) = (along.at(&fold, 0.5), along.at(&fold, 1.0));
            assert_eq!((after.normal, after.binormal), (before.normal, -before.binormal));

            let along = frames(&cusp, rule);
            assert_eq!(along.breaks().len(), 1);
            assert!((along.breaks()[0] - 0.5).abs() < 1e-9);
            let (before, after) = (along.at(&cusp, 0.5 - 1e-6), along.at(&cusp, 0.5 + 1e-6));
            // In its plane: the tangent is reversed but for the 4e-6 that the curve turns meanwhile.
            assert!((before.normal.z - after.normal.z).abs() < 1e-9);
            assert!(before.tangent.distance(-after.tangent) < 1e-5);
            for t in [0.0, 0.5, 1.0] {
                assert_orthonormal(&along.at(&cusp, t));
            }
        }
    }
}
