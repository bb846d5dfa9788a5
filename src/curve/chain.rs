//! A chain of segments with one arc length and one frame along all of it.

use super::frame::Frames;
use super::length::ArcLength;
use super::{Frame, FrameRule, Segment};
use glam::DVec3;
use std::f64::consts::{PI, TAU};
use std::sync::Arc;

/// Why segments do not make a curve.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum CurveError {
    /// There is no segment.
    #[error("a curve needs at least one segment")]
    Empty,
    /// A control point is not finite, or so large that differences of control points are not.
    #[error("segment {segment} is not finite")]
    NotFinite {
        /// Counted from 0.
        segment: usize,
    },
    /// All control points of the segment coincide.
    #[error("zero-length curve: the points of segment {segment} coincide")]
    ZeroLength {
        /// Counted from 0.
        segment: usize,
    },
    /// The segment is too small or too large for its squares and cubes to be numbers.
    #[error("segment {segment} has a size of {size:e} m, outside of 1e-60 to 1e60")]
    Scale {
        /// Counted from 0.
        segment: usize,
        /// Longest of the coefficients of its powers, in metres.
        size: f64,
    },
    /// A segment does not begin where the one before it ends.
    #[error("gap of {size:e} m between segments {segment} and {}", segment + 1)]
    Gap {
        /// The segment before the gap, counted from 0.
        segment: usize,
        /// Distance in metres.
        size: f64,
    },
    /// The last segment of a closed curve does not end where the first begins.
    #[error("gap of {size:e} m where the curve closes")]
    Open {
        /// Distance in metres.
        size: f64,
    },
}

/// A jump of the frame about its tangent by less than this many radians is not one.
const FLIP: f64 = 1e-3;

/// Holonomy below this many radians is rounding.
const TURNED: f64 = 1e-12;

/// A chain of segments, each beginning where the one before it ends, in metres; closed where the first begins where the
/// last ends.
///
/// Parameters are a segment's index and its t in [0, 1]. No index that [`Curve::segments`] has makes a method
/// panic.
#[derive(Debug, Clone)]
pub struct Curve {
    // Long curves are large, and copied along with what holds them.
    segments: Arc<[Segment]>,
    rule: FrameRule,
    lengths: Arc<[ArcLength]>,
    /// Arc length at each segment's start, and at the end of the last.
    starts: Arc<[f64]>,
    frames: Arc<[Frames]>,
    closed: bool,
    holonomy: f64,
}

impl Curve {
    /// A curve through these segments.
    ///
    /// # Errors
    ///
    /// No segment; one that is not finite, has no length, or is smaller than 1e-60 or larger than 1e60; a gap
    /// between two of more than 1e-6 of the smaller one's size (and more than rounding of the coordinates).
    pub fn new(segments: Vec<Segment>, rule: FrameRule) -> Result<Curve, CurveError> {
        Curve::chain(segments, rule, false)
    }

    /// A closed curve through these segments: it goes on from the last to the first, and has no ends.
    ///
    /// # Errors
    ///
    /// Those of [`Curve::new`], and a gap from the last segment to the first.
    pub fn closed(segments: Vec<Segment>, rule: FrameRule) -> Result<Curve, CurveError> {
        Curve::chain(segments, rule, true)
    }

    fn chain(segments: Vec<Segment>, rule: FrameRule, closed: bool) -> Result<Curve, CurveError> {
        check(&segments, closed)?;
        let lengths: Vec<ArcLength> = segments.iter().map(ArcLength::new).collect();
        let mut starts = vec![0.0];
        let mut s = 0.0;
        for (segment, length) in segments.iter().zip(&lengths) {
            s += length.at(segment, 1.0);
            starts.push(s);
        }
        let first = Frame::on(segments[0].tangent(0.0));
        let (mut frames, arriving) = along(&segments, rule, first);
        let mut holonomy = 0.0;
        if closed {
            holonomy = lap(&frames[0].at(&segments[0], 0.0), &arriving);
            if rule == FrameRule::Frenet && holonomy.abs() > TURNED {
                // A straight start has no principal normal of its own: what arrives there is carried on.
                let (again, arriving) = along(&segments, rule, arriving);
                let left = lap(&again[0].at(&segments[0], 0.0), &arriving);
                if left.abs() < holonomy.abs() {
                    (frames, holonomy) = (again, left);
                }
            }
        }
        Ok(Curve {
            segments: segments.into(),
            rule,
            lengths: lengths.into(),
            starts: starts.into(),
            frames: frames.into(),
            closed,
            holonomy,
        })
    }

    /// The segments, in order; at least one.
    pub fn segments(&self) -> &[Segment] {
        &self.segments
    }

    /// Bytes that the curve holds; copies of it hold the same.
    pub fn memory(&self) -> usize {
        let each = size_of::<Segment>() + size_of::<ArcLength>() + size_of::<f64>() + size_of::<Frames>();
        self.segments.len() * each
            + self.lengths.iter().map(ArcLength::memory).sum::<usize>()
            + self.frames.iter().map(Frames::memory).sum::<usize>()
    }

    /// Whether the curve ends where it starts, and goes on there as if it had no ends.
    pub fn is_closed(&self) -> bool {
        self.closed
    }

    /// Angle in radians, above -pi and at most pi, about the tangent from the frame that a closed curve starts with to the
    /// one that arrives there after a lap, right-handed; 0 for open curves.
    ///
    /// For a rotation-minimising frame it is what [`Curve::frame`] takes back over the length, a property of the curve
    /// that no choice of a start or direction changes (but for whole turns, the area on the unit sphere that the
    /// tangents enclose); 0 in a plane. For a Frenet frame it is a jump where the curve closes.
    pub fn holonomy(&self) -> f64 {
        self.holonomy
    }

    /// Which frame goes along the curve.
    pub fn rule(&self) -> FrameRule {
        self.rule
    }

    /// Length of the whole curve in metres, relative error at most 1e-12.
    pub fn length(&self) -> f64 {
        self.starts[self.segments.len()]
    }

    /// Arc length in metres from the start of the curve, error at most 1e-12 of its length.
    ///
    /// Continuous at joints to the last bit. A quadratic is measured in closed form from its vertex, or where
    /// it is nearly straight, like a cubic, by Gauss-Legendre quadrature on intervals that are known to
    /// suffice.
    pub fn arc_length(&self, segment: usize, t: f64) -> f64 {
        self.starts[segment] + self.lengths[segment].at(&self.segments[segment], t)
    }

    /// Segment and t at arc length `s` in metres, clamped to the curve; at a joint the later segment, but at the end of
    /// a closed curve the last one.
    pub fn locate(&self, s: f64) -> (usize, f64) {
        // What is no number becomes 0 here.
        let s = s.max(0.0);
        let last = self.segments.len() - 1;
        let segment = self.starts[1..=last].partition_point(|start| *start <= s);
        let total = self.starts[segment + 1] - self.starts[segment];
        let t = self.lengths[segment].inverse(&self.segments[segment], s - self.starts[segment], total);
        (segment, t)
    }

    /// The frame at a point of the curve, orthonormal to 1e-14.
    ///
    /// At the start of the curve it is [`Frame::on`] the tangent. The rotation-minimising frame is analytic in t
    /// between [`Curve::breaks`], with errors of 1e-13 radians a span, below 1e-11 a segment; beside a near
    /// cusp, where the speed falls to a fraction x of its usual size, 1e-15 / x. At a corner it is turned by the
    /// rotation that takes one tangent to the other, and where the curve doubles back at a joint or a fold,
    /// about its normal; at a cusp within a plane curve it turns in that plane. The Frenet frame's normal is
    /// the principal normal; where the curvature is below 1e-6 over the segment's size the frame is carried
    /// on as a rotation-minimising one.
    ///
    /// On a closed curve the rotation-minimising frame is turned about the tangent, besides, by minus
    /// [`Curve::holonomy`] times the part of the length that lies behind, so that the lap ends as it began; and a
    /// Frenet frame that starts without curvature starts as the one that arrives there.
    pub fn frame(&self, segment: usize, t: f64) -> Frame {
        let frame = self.frames[segment].at(&self.segments[segment], t);
        if self.rule != FrameRule::RotationMinimising || self.holonomy.abs() <= TURNED {
            return frame;
        }
        let (sin, cos) = libm::sincos(-self.holonomy * (self.arc_length(segment, t) / self.length()));
        frame.turned(cos, sin)
    }

    /// Every t strictly inside a segment where its frame jumps, ascending: cusps, folds, flips of the Frenet
    /// frame.
    ///
    /// A turn too sharp to be told from a cusp (speed below 1e-9 of the segment's) counts as one.
    pub fn breaks(&self, segment: usize) -> &[f64] {
        self.frames[segment].breaks()
    }

    /// Arc lengths in metres at which a Frenet frame jumps about its tangent by more than 1e-3 radians, ascending: at
    /// inflections, behind straight parts, and at joints where the principal normal changes.
    ///
    /// Empty for a rotation-minimising frame.
    pub fn flips(&self) -> Vec<f64> {
        if self.rule != FrameRule::Frenet {
            return vec![];
        }
        let mut flips = vec![];
        for (segment, frames) in self.frames.iter().enumerate() {
            for &t in frames.breaks() {
                if jumps(&self.frame(segment, t.next_down()), &self.frame(segment, t)) {
                    flips.push(self.arc_length(segment, t));
                }
            }
            if segment + 1 < self.segments.len()
                && jumps(&self.frame(segment, 1.0), &self.frame(segment + 1, 0.0))
            {
                flips.push(self.starts[segment + 1]);
            }
        }
        flips
    }

    /// Angle in radians, 0 to pi, by which the tangent turns from the end of segment `joint` to the start of
    /// the next.
    ///
    /// After the last segment comes the first where the curve is closed; otherwise it is 0 there.
    pub fn turn(&self, joint: usize) -> f64 {
        let Some(next) = self.after(joint) else { return 0.0 };
        let (a, b) = (self.segments[joint].tangent(1.0), self.segments[next].tangent(0.0));
        libm::atan2(a.cross(b).length(), a.dot(b))
    }

    /// The segment that begins where `segment` ends; none at the end of an open curve.
    pub fn after(&self, segment: usize) -> Option<usize> {
        match segment + 1 {
            next if next < self.segments.len() => Some(next),
            _ => self.closed.then_some(0),
        }
    }
}

/// Whether a frame turns about its tangent from one to the next, besides following the tangent.
fn jumps(before: &Frame, after: &Frame) -> bool {
    let carried = before.bent(after.tangent);
    let (x, y) = (after.normal.dot(carried.normal), after.normal.dot(carried.binormal));
    libm::atan2(y, x).abs() > FLIP
}

/// The frames of every segment, from one on the first tangent, and the one that arrives behind the last on the first
/// tangent again.
fn along(segments: &[Segment], rule: FrameRule, first: Frame) -> (Vec<Frames>, Frame) {
    let mut frames: Vec<Frames> = Vec::with_capacity(segments.len());
    let mut arriving = first;
    for (i, segment) in segments.iter().enumerate() {
        let along = Frames::new(segment, rule, &arriving);
        let next = segments.get(i + 1).unwrap_or(&segments[0]);
        arriving = along.at(segment, 1.0).bent(next.tangent(0.0));
        frames.push(along);
    }
    (frames, arriving)
}

/// Angle about the tangent from one frame to another, within 1e-9 of minus half a turn as plus half a turn.
fn lap(from: &Frame, to: &Frame) -> f64 {
    let angle = libm::atan2(to.normal.dot(from.binormal), to.normal.dot(from.normal));
    if angle < 1e-9 - PI { angle + TAU } else { angle }
}

fn check(segments: &[Segment], closed: bool) -> Result<(), CurveError> {
    if segments.is_empty() {
        return Err(CurveError::Empty);
    }
    let mut before: Option<(usize, DVec3, f64)> = None;
    let mut first: Option<(DVec3, f64)> = None;
    for (i, segment) in segments.iter().enumerate() {
        let [start, powers @ ..] = segment.power();
        if !segment.power().iter().all(|c| c.is_finite()) {
            return Err(CurveError::NotFinite { segment: i });
        }
        let size = powers.iter().fold(0.0, |m: f64, c| m.max(c.abs().max_element()));
        if size == 0.0 {
            return Err(CurveError::ZeroLength { segment: i });
        }
        if !(1e-60..=1e60).contains(&size.max(start.abs().max_element())) || size < 1e-60 {
            return Err(CurveError::Scale { segment: i, size });
        }
        if let Some((segment, end, other_size)) = before
            && let Some(size) = gap(end, *start, size.min(other_size))
        {
            return Err(CurveError::Gap { segment, size });
        }
        before = Some((i, segment.at(1.0), size));
        first = first.or(Some((*start, size)));
    }
    if let (true, Some((start, size)), Some((_, end, other_size))) = (closed, first, before)
        && let Some(size) = gap(end, start, size.min(other_size))
    {
        return Err(CurveError::Open { size });
    }
    Ok(())
}

/// The distance between two points that should be one, where it is more than 1e-6 of `size` and rounding.
fn gap(a: DVec3, b: DVec3, size: f64) -> Option<f64> {
    let distance = a.distance(b);
    let rounding = 16.0 * f64::EPSILON * b.abs().max_element();
    (distance > 1e-6 * size + rounding).then_some(distance)
}

#[cfg(test)]
mod tests {
    use super::super::testing::{Random, part};
    use super::*;
    use glam::dvec3;
    use std::f64::consts::FRAC_PI_2;

    const RULE: FrameRule = FrameRule::RotationMinimising;

    fn line(a: DVec3, b: DVec3) -> Segment {
        Segment::quadratic([a, 0.5 * (a + b), b])
    }

    fn wavy(random: &mut Random) -> Curve {
        let (whole, other) = (random.cubic(), random.quadratic());
        let shift = whole.at(1.0) - other.at(0.0);
        let [a, b, c] = [0.0, 0.5, 1.0].map(|t| other.at(t) + shift);
        let middle = 2.0 * b - 0.5 * (a + c);
        let segments =
            vec![part(&whole, 0.0, 0.3), part(&whole, 0.3, 1.0), Segment::quadratic([a, middle, c])];
        Curve::new(segments, RULE).expect("no gap")
    }

    #[test]
    fn what_is_no_curve_is_refused() {
        let x = DVec3::X;
        let good = line(DVec3::ZERO, x);
        let error = |segments: &[Segment]| Curve::new(segments.to_vec(), RULE).expect_err("not a curve");
        assert_eq!(error(&[]), CurveError::Empty);
        assert_eq!(error(&[good, line(x, x)]), CurveError::ZeroLength { segment: 1 });
        let cubic = Segment::cubic([x / 3.0, x / 3.0, x / 3.0, x / 3.0]);
        assert_eq!(error(&[cubic]), CurveError::ZeroLength { segment: 0 });
        for bad in [f64::NAN, f64::INFINITY, -f64::INFINITY] {
            let bad = dvec3(0.0, bad, 0.0);
            for points in [[bad, x, x], [x, bad, x], [x, x, bad]] {
                assert_eq!(error(&[good, Segment::quadratic(points)]), CurveError::NotFinite { segment: 1 });
                let [a, b, c] = points;
                for points in [[a, b, c, x], [x, a, b, c]] {
                    assert_eq!(error(&[good, Segment::cubic(points)]), CurveError::NotFinite { segment: 1 });
                }
            }
        }
        for size in [1e-61, 1e61, 1e308] {
            assert!(matches!(error(&[line(DVec3::ZERO, size * x)]), CurveError::Scale { segment: 0, .. }));
        }
        let CurveError::Gap { segment: 0, size } = error(&[good, line(1.00001 * x, 2.0 * x)]) else {
            panic!("the gap is 1e-5 of the size")
        };
        assert!((size - 1e-5).abs() < 1e-15);
        assert!(Curve::new(vec![good, line(1.000_000_1 * x, 2.0 * x)], RULE).is_ok());
        // Far away the same gap is a few ulp.
        let far = 1e12 * DVec3::Y;
        assert!(
            Curve::new(vec![line(far, far + x), line(far + dvec3(1.0, 2e-4, 0.0), far + 2.0 * x)], RULE)
                .is_ok()
        );
        let message = error(&[good, line(2.0 * x, 3.0 * x)]).to_string();
        assert_eq!(message, "gap of 1e0 m between segments 0 and 1");
    }

    #[test]
    fn locate_inverts_arc_length() {
        let mut random = Random(30);
        for _ in 0..100 {
            let curve = wavy(&mut random);
            for k in 0..=50 {
                let s = curve.length() * f64::from(k) / 50.0;
                let (segment, t) = curve.locate(s);
                // The inversion stops at 2e-16 of the length, the lengths are sums of some roundings.
                assert!((curve.arc_length(segment, t) - s).abs() < 4e-15 * curve.length());
            }
            assert_eq!(curve.locate(-1.0), (0, 0.0));
            assert_eq!(curve.locate(2.0 * curve.length()), (2, 1.0));
            assert_eq!(curve.locate(f64::NAN).0, 0);
            assert_eq!(curve.locate(curve.arc_length(0, 1.0)), (1, 0.0));
            assert_eq!(curve.arc_length(1, 1.0), curve.arc_length(2, 0.0));
        }
    }

    #[test]
    fn locate_at_folds_and_vanishing_speeds() {
        let fold = Curve::new(vec![Segment::quadratic([DVec3::ZERO, 1.5 * DVec3::X, DVec3::X])], RULE);
        let fold = fold.expect("a curve");
        let slow = Curve::new(vec![Segment::cubic([DVec3::ZERO, DVec3::ZERO, DVec3::ZERO, DVec3::X])], RULE);
        let slow = slow.expect("a curve");
        for k in 0..=1000 {
            let x = f64::from(k) / 1000.0;
            let (_, t) = fold.locate(1.25 * x);
            assert!((fold.arc_length(0, t) - 1.25 * x).abs() < 1e-15);
            // s = t^3
            assert!(
                (slow.locate(x * x * x).1 - x).abs() < 1e-5
                    && (slow.arc_length(0, x) - x * x * x).abs() < 1e-15
            );
        }
        // Out by 9/8: the point is at 1 again for s = 1 and s = 1.25.
        assert!((fold.segments()[0].at(fold.locate(1.0).1).x - 1.0).abs() < 1e-14);
    }

    #[test]
    fn frames_do_not_jump_at_smooth_joints() {
        let mut random = Random(31);
        for _ in 0..100 {
            let curve = wavy(&mut random);
            assert!(curve.turn(0) < 1e-11);
            let (before, after) = (curve.frame(0, 1.0), curve.frame(1, 0.0));
            assert!(before.normal.distance(after.normal) < 1e-11);
            // At the corner the frame turns about T1 x T2 by the angle between them.
            let (before, after) = (curve.frame(1, 1.0), curve.frame(2, 0.0));
            assert!(after.normal.distance(before.bent(after.tangent).normal) < 1e-13);
        }
    }

    #[test]
    fn flips_are_those_of_frenet_frames_only() {
        let s = [DVec3::ZERO, dvec3(0.3, 1.0, 0.0), dvec3(0.7, -1.0, 0.0), DVec3::X];
        let arc = [DVec3::ZERO, dvec3(0.5, 1.0, 0.0), DVec3::X];
        let cusp = [DVec3::ZERO, dvec3(1.0, 1.0, 0.0), dvec3(0.0, 1.0, 0.0), DVec3::X];
        let flips =
            |segments: &[Segment], rule| Curve::new(segments.to_vec(), rule).expect("a curve").flips();
        let frenet = |segments: &[Segment]| flips(segments, FrameRule::Frenet);
        assert!(flips(&[Segment::cubic(s)], RULE).is_empty());
        assert!(frenet(&[Segment::quadratic(arc)]).is_empty());
        // The tangent turns back there, but the binormal stays.
        assert!(frenet(&[Segment::cubic(cusp)]).is_empty());
        let length = Curve::new(vec![Segment::cubic(s)], RULE).expect("a curve").length();
        let found = frenet(&[Segment::cubic(s)]);
        // The inflection of the S is its middle; the flip comes where the curvature is 1e-6 again.
        assert!(found.len() == 1 && (found[0] / length - 0.5).abs() < 1e-5, "{found:?}");
        // The same turned out of its plane by a little: the frame is carried on through the middle.
        let [a, b, c, d] = s;
        assert_eq!(frenet(&[Segment::cubic([a, b, c + 1e-9 * DVec3::Z, d])]).len(), 1);

        // Two arcs that make an S have it at the joint, two that make one arc have none.
        let other = |side: f64| [DVec3::X, dvec3(1.5, side, 0.0), 2.0 * DVec3::X];
        let [same, opposite] = [1.0, -1.0].map(other).map(Segment::quadratic);
        let arc = Segment::quadratic(arc);
        assert!(frenet(&[arc, same]).is_empty());
        let found = frenet(&[arc, opposite]);
        assert!(found.len() == 1 && (found[0] - arc_length(&arc)).abs() < 1e-12, "{found:?}");
    }

    fn arc_length(segment: &Segment) -> f64 {
        Curve::new(vec![*segment], RULE).expect("a curve").length()
    }

    #[test]
    fn corners_of_all_angles() {
        for (degrees, tolerance) in
            [(0.0_f64, 1e-15), (1.0, 1e-15), (90.0, 1e-15), (179.0, 1e-14), (180.0, 0.0)]
        {
            let angle = degrees / 180.0 * PI;
            let away =
                if degrees == 180.0 { -DVec3::X } else { dvec3(libm::cos(angle), libm::sin(angle), 0.0) };
            let curve = Curve::new(vec![line(DVec3::ZERO, DVec3::X), line(DVec3::X, DVec3::X + away)], RULE);
            let curve = curve.expect("a curve");
            assert!((curve.turn(0) - angle).abs() < 1e-15 && curve.turn(1) == 0.0);
            let (f, g) = (curve.frame(0, 1.0), curve.frame(1, 0.5));
            // On +x the start frame is -z, y.
            assert!(f.normal.distance(-DVec3::Z) < 1e-15);
            assert!(g.normal.distance(-DVec3::Z) <= tolerance, "{degrees}");
            assert!(g.normal.cross(g.binormal).distance(g.tangent) < 1e-14);
        }
        let right = Curve::new(vec![line(DVec3::ZERO, DVec3::Z), line(DVec3::Z, dvec3(1.0, 0.0, 1.0))], RULE);
        let right = right.expect("a curve");
        assert!((right.turn(0) - FRAC_PI_2).abs() < 1e-15);
        assert!(right.frame(1, 0.0).normal.distance(-DVec3::Z) < 1e-15);
    }

    #[test]
    fn a_vertical_tube_has_the_scene_s_axes() {
        let curve = Curve::new(vec![line(DVec3::ZERO, 2.0 * DVec3::Z)], RULE).expect("a curve");
        let expected = Frame { tangent: DVec3::Z, normal: DVec3::X, binormal: DVec3::Y };
        assert_eq!(curve.frame(0, 0.7), expected);
        assert_eq!((curve.length(), curve.arc_length(0, 0.25), curve.locate(1.0)), (2.0, 0.5, (0, 0.5)));
    }

    #[test]
    fn powers_of_two_change_no_bit_and_other_scales_hardly_any() {
        let mut random = Random(32);
        for _ in 0..20 {
            let points = [random.point(), random.point(), random.point(), random.point()];
            let make = |scale: f64, rule| {
                Curve::new(vec![Segment::cubic(points.map(|p| scale * p))], rule).expect("a curve")
            };
            for rule in [FrameRule::RotationMinimising, FrameRule::Frenet] {
                let one = make(1.0, rule);
                for exponent in [-150, -60, 20, 150] {
                    let other = make(libm::pow(2.0, f64::from(exponent)), rule);
                    assert_eq!(other.length(), one.length() * libm::pow(2.0, f64::from(exponent)));
                    assert_eq!(other.frame(0, 0.7), one.frame(0, 0.7));
                }
                for scale in [1e-55, 1e-18, 1e18, 1e55] {
                    let other = make(scale, rule);
                    assert!((other.length() / scale / one.length() - 1.0).abs() < 1e-13);
                    assert!(other.frame(0, 0.7).normal.distance(one.frame(0, 0.7).normal) < 1e-11);
                }
            }
        }
    }

    #[test]
    fn coinciding_and_nearly_coinciding_points() {
        let mut random = Random(33);
        let mut curves = 0;
        for i in 0..4000 {
            // Points of a small lattice, each off it by 10^-k or not at all: coincidences, folds, cusps,
            // planes, inflections, nearly.
            let off = libm::pow(0.1, f64::from(i % 18));
            let mut point = || {
                let corner = (1.5 * random.point()).round();
                if random.unit() < 0.5 { corner } else { corner + off * random.point() }
            };
            let p = [point(), point(), point(), point()];
            let segment = if i % 3 == 0 { Segment::quadratic([p[0], p[1], p[2]]) } else { Segment::cubic(p) };
            for rule in [FrameRule::RotationMinimising, FrameRule::Frenet] {
                let curve = match Curve::new(vec![segment], rule) {
                    Ok(curve) => curve,
                    Err(error) => {
                        assert_eq!(error, CurveError::ZeroLength { segment: 0 });
                        continue;
                    }
                };
                curves += 1;
                let mut before = 0.0;
                for k in 0..=60 {
                    let t = if k <= 40 { f64::from(k) / 40.0 } else { libm::pow(0.5, f64::from(k - 40)) };
                    let f = curve.frame(0, t);
                    // A few roundings.
                    assert!(
                        (f.tangent.length() - 1.0).abs() < 1e-14 && (f.normal.length() - 1.0).abs() < 1e-14
                    );
                    assert!(f.normal.cross(f.binormal).distance(f.tangent) < 1e-14, "{p:?} at {t}");
                    if k <= 40 {
                        let s = curve.arc_length(0, t);
                        assert!(s >= before - 1e-15 * curve.length());
                        // Between the chord and the sum of the legs, but for rounding of the points.
                        let legs = p[0].distance(p[1]) + p[1].distance(p[2]) + p[2].distance(p[3]);
                        assert!(s <= legs + 1e-14 && s >= segment.at(0.0).distance(segment.at(t)) - 1e-14);
                        let back = curve.locate(s);
                        assert!((curve.arc_length(0, back.1) - s).abs() <= 4e-15 * curve.length());
                        before = s;
                    }
                }
                assert!(curve.breaks(0).iter().all(|t| *t > 0.0 && *t < 1.0));
            }
        }
        assert!(curves > 7000);
    }
}
