//! A chain of segments with one arc length and one frame along all of it.

use super::frame::Frames;
use super::length::ArcLength;
use super::{Frame, FrameRule, Segment};

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
}

/// A chain of segments, each beginning where the one before it ends, in metres.
///
/// Parameters are a segment's index and its t in [0, 1]. No index that [`Curve::segments`] has makes a method panic.
#[derive(Debug, Clone)]
pub struct Curve {
    segments: Vec<Segment>,
    rule: FrameRule,
    lengths: Vec<ArcLength>,
    /// Arc length at each segment's start, and at the end of the last.
    starts: Vec<f64>,
    frames: Vec<Frames>,
}

impl Curve {
    /// A curve through these segments.
    ///
    /// # Errors
    ///
    /// No segment; one that is not finite, has no length, or is smaller than 1e-60 or larger than 1e60; a gap between two of more
    /// than 1e-6 of the smaller one's size (and more than rounding of the coordinates).
    pub fn new(segments: Vec<Segment>, rule: FrameRule) -> Result<Curve, CurveError> {
        check(&segments)?;
        let lengths: Vec<ArcLength> = segments.iter().map(ArcLength::new).collect();
        let mut starts = vec![0.0];
        let mut s = 0.0;
        for (segment, length) in segments.iter().zip(&lengths) {
            s += length.at(segment, 1.0);
            starts.push(s);
        }
        let mut frames: Vec<Frames> = Vec::with_capacity(segments.len());
        let mut arriving: Option<Frame> = None;
        for segment in &segments {
            let tangent = segment.tangent(0.0);
            let start = arriving.map_or_else(|| Frame::on(tangent), |frame| frame.bent(tangent));
            let along = Frames::new(segment, rule, &start);
            arriving = Some(along.at(segment, 1.0));
            frames.push(along);
        }
        Ok(Curve { segments, rule, lengths, starts, frames })
    }

    /// The segments, in order; at least one.
    pub fn segments(&self) -> &[Segment] {
        &self.segments
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
    /// Continuous at joints to the last bit. A quadratic is measured in closed form from its vertex, or where it is nearly straight, like a
    /// cubic, by Gauss-Legendre quadrature on intervals that are known to suffice.
    pub fn arc_length(&self, segment: usize, t: f64) -> f64 {
        self.starts[segment] + self.lengths[segment].at(&self.segments[segment], t)
    }

    /// Segment and t at arc length `s` in metres, clamped to the curve; at a joint the later segment.
    pub fn locate(&self, s: f64) -> (usize, f64) {
        let last = self.segments.len() - 1;
        let segment = self.starts[1..=last].partition_point(|start| *start <= s);
        let total = self.starts[segment + 1] - self.starts[segment];
        let t = self.lengths[segment].inverse(&self.segments[segment], s - self.starts[segment], total);
        (segment, t)
    }

    /// The frame at a point of the curve, orthonormal to 1e-14.
    ///
    /// At the start of the curve it is [`Frame::on`] the tangent. The rotation-minimising frame has errors below 1e-11 radians and is analytic
    /// in t between [`Curve::breaks`]. At a corner it is turned by the rotation that takes one tangent to the other, and
    /// where the curve doubles back at a joint or a fold, about its normal; at a cusp within a plane curve it
    /// turns in that plane. The Frenet frame's normal is the principal normal; where the curvature is below 1e-6 over the
    /// segment's size the frame is carried on as a rotation-minimising one.
    pub fn frame(&self, segment: usize, t: f64) -> Frame {
        self.frames[segment].at(&self.segments[segment], t)
    }

    /// Every t strictly inside a segment where its frame jumps, ascending: cusps, folds, flips of the Frenet frame.
    ///
    /// A turn too sharp to be told from a cusp (speed below 1e-9 of the segment's) counts as one.
    pub fn breaks(&self, segment: usize) -> &[f64] {
        self.frames[segment].breaks()
    }

    /// Angle in radians, 0 to pi, by which the tangent turns from the end of segment `joint` to the start of the next.
    ///
    /// 0 after the last segment.
    pub fn turn(&self, joint: usize) -> f64 {
        let Some(next) = self.segments.get(joint + 1) else { return 0.0 };
        let (a, b) = (self.segments[joint].tangent(1.0), next.tangent(0.0));
        libm::atan2(a.cross(b).length(), a.dot(b))
    }
}

fn check(segments: &[Segment]) -> Result<(), CurveError> {
    if segments.is_empty() {
        return Err(CurveError::Empty);
    }
    let mut before: Option<(usize, &Segment, f64)> = None;
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
        if let Some((segment, other, other_size)) = before {
            let gap = other.at(1.0).distance(*start);
            let rounding = 16.0 * f64::EPSILON * start.abs().max_element();
            if gap > 1e-6 * size.min(other_size) + rounding {
                return Err(CurveError::Gap { segment, size: gap });
            }
        }
        before = Some((i, segment, size));
    }
    Ok(())
}
