//! Splines through or near points, as cubic Bezier segments.

use super::Segment;
use glam::DVec3;

/// Why points make no spline.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum SplineError {
    /// Fewer than two points, or than three for a closed curve.
    #[error("{found} points where at least {least} are needed")]
    TooFew {
        /// Number of points.
        found: usize,
        /// Number needed.
        least: usize,
    },
    /// A point lies where the one before it does, to rounding of the coordinates; before the first is the last of a
    /// closed curve.
    #[error("point {point} coincides with the one before it")]
    Coincident {
        /// Counted from 0.
        point: usize,
    },
}

/// The Catmull-Rom spline through all `points`, in metres: a cubic from each to the next, with a continuous tangent.
///
/// Knots lie `|p_(i+1) - p_i|^alpha` apart: uniform for 0, centripetal for 0.5, chordal for 1. The derivative at a point
/// is that of the parabola through it and its two neighbours (Catmull and Rom, "A class of local interpolating splines",
/// 1974; Barry and Goldman, "A recursive evaluation algorithm for a class of Catmull-Rom splines", 1988). Centripetal ones
/// have neither cusps nor loops between two points (Yuksel, Schaefer and Keyser, "Parameterization and applications of
/// Catmull-Rom curves", 2011).
///
/// An open curve goes on beyond its ends as if by its outermost points reflected in the end points, so it starts and ends
/// along the chord to the neighbour. A closed one goes on from the last point to the first.
///
/// # Errors
///
/// Fewer than two points (closed: three); a point on the one before it.
pub fn catmull_rom(points: &[DVec3], alpha: f64, closed: bool) -> Result<Vec<Segment>, SplineError> {
    check(points, closed)?;
    let at = Neighbours { points, closed };
    let knots = |i: isize| libm::pow(at.point(i).distance(at.point(i + 1)), alpha);
    let derivative = |i: isize| {
        let (before, after) = (knots(i - 1), knots(i));
        let chord = |i: isize| at.point(i + 1) - at.point(i);
        (chord(i - 1) * (after / before) + chord(i) * (before / after)) / (before + after)
    };
    let segment = |i: isize| {
        let third = knots(i) / 3.0;
        let (p, q) = (at.point(i), at.point(i + 1));
        Segment::cubic([p, p + third * derivative(i), q - third * derivative(i + 1), q])
    };
    Ok(at.starts().map(segment).collect())
}

/// The uniform cubic B-spline of these control points, in metres: with continuous curvature, near the points rather than
/// through them.
///
/// An open curve has two further control points, the outermost but one reflected in the end points, so that it starts and
/// ends in the end points, without curvature there. A closed one goes on from the last point to the first.
///
/// # Errors
///
/// Fewer than two points (closed: three); a point on the one before it.
pub fn b_spline(points: &[DVec3], closed: bool) -> Result<Vec<Segment>, SplineError> {
    check(points, closed)?;
    let at = Neighbours { points, closed };
    // Where segments meet.
    let joint = |i: isize| {
        let (a, b, c) = (at.point(i - 1), at.point(i), at.point(i + 1));
        b + ((a - b) + (c - b)) / 6.0
    };
    let segment = |i: isize| {
        let (p, q) = (at.point(i), at.point(i + 1));
        let third = (q - p) / 3.0;
        Segment::cubic([joint(i), p + third, q - third, joint(i + 1)])
    };
    Ok(at.starts().map(segment).collect())
}

/// Points with those that follow from them beyond the ends.
struct Neighbours<'a> {
    points: &'a [DVec3],
    closed: bool,
}

impl Neighbours<'_> {
    /// Point number `i`, of which an open curve has -1 to n and a closed one any.
    fn point(&self, i: isize) -> DVec3 {
        let n = self.points.len().cast_signed();
        let at = |i: isize| self.points[i.rem_euclid(n).cast_unsigned()];
        if self.closed || (0..n).contains(&i) {
            at(i)
        } else if i < 0 {
            2.0 * at(0) - at(-i)
        } else {
            2.0 * at(n - 1) - at(2 * n - 2 - i)
        }
    }

    /// The points that segments start at.
    fn starts(&self) -> std::ops::Range<isize> {
        let n = self.points.len().cast_signed();
        0..if self.closed { n } else { n - 1 }
    }
}

fn check(points: &[DVec3], closed: bool) -> Result<(), SplineError> {
    let least = if closed { 3 } else { 2 };
    if points.len() < least {
        return Err(SplineError::TooFew { found: points.len(), least });
    }
    let before = if closed { points.last() } else { None }.into_iter().chain(points);
    let pairs = before.zip(points.iter().skip(usize::from(!closed)));
    for (i, (a, b)) in pairs.enumerate() {
        if coincide(*a, *b) {
            return Err(SplineError::Coincident { point: i + usize::from(!closed) });
        }
    }
    Ok(())
}

/// Whether two points are one to rounding of their coordinates.
pub(crate) fn coincide(a: DVec3, b: DVec3) -> bool {
    a.distance(b) <= 8.0 * f64::EPSILON * a.abs().max(b.abs()).max_element()
}

#[cfg(test)]
mod tests {
    use super::super::testing::Random;
    use super::super::{Curve, FrameRule};
    use super::*;
    use glam::dvec3;

    fn random_points(random: &mut Random, n: usize) -> Vec<DVec3> {
        (0..n).map(|_| random.point()).collect()
    }

    /// Barry and Goldman's pyramid of linear interpolations over four points and their knots.
    fn pyramid(p: [DVec3; 4], alpha: f64, x: f64) -> DVec3 {
        let mut knots = [0.0; 4];
        for i in 1..4 {
            knots[i] = knots[i - 1] + libm::pow(p[i].distance(p[i - 1]), alpha);
        }
        let t = knots[1] + x * (knots[2] - knots[1]);
        let between = |a: DVec3, b: DVec3, from: usize, to: usize| {
            let y = (t - knots[from]) / (knots[to] - knots[from]);
            a * (1.0 - y) + b * y
        };
        let [a, b, c] = [0, 1, 2].map(|i| between(p[i], p[i + 1], i, i + 1));
        let [d, e] = [between(a, b, 0, 2), between(b, c, 1, 3)];
        between(d, e, 1, 2)
    }

    /// de Boor's recursion over the knots -3 to 4, for the piece from 0 to 1.
    fn de_boor(p: [DVec3; 4], x: f64) -> DVec3 {
        let mut d = p;
        for r in 1..4_u8 {
            for j in (usize::from(r)..4).rev() {
                let knot = f64::from(u8::try_from(j).expect("small")) - 3.0;
                let share = (x - knot) / (4.0 - f64::from(r));
                d[j] = d[j - 1] * (1.0 - share) + d[j] * share;
            }
        }
        d[3]
    }

    /// The four points around each segment, the outer ones of an open curve reflected.
    fn windows(points: &[DVec3], closed: bool) -> Vec<[DVec3; 4]> {
        let n = points.len();
        let mut all = points.to_vec();
        if closed {
            all.insert(0, points[n - 1]);
            all.extend([points[0], points[1]]);
        } else {
            all.insert(0, 2.0 * points[0] - points[1]);
            all.push(2.0 * points[n - 1] - points[n - 2]);
        }
        all.windows(4).map(|w| [w[0], w[1], w[2], w[3]]).collect()
    }

    #[test]
    fn agree_with_the_recursions_of_their_inventors() {
        let mut random = Random(50);
        for round in 0..100 {
            let closed = round % 2 == 0;
            let points = random_points(&mut random, 3 + round % 5);
            let alpha = [0.0, 0.5, 1.0, random.unit()][round % 4];
            let spline = catmull_rom(&points, alpha, closed).expect("points apart");
            let near = b_spline(&points, closed).expect("points apart");
            let around = windows(&points, closed);
            assert_eq!((spline.len(), near.len()), (around.len(), around.len()));
            for ((through, near), p) in spline.iter().zip(&near).zip(around) {
                for k in 0..=10 {
                    let x = f64::from(k) / 10.0;
                    // Roundings of points below 2; quotients of near knots magnify them for the pyramid.
                    assert!(through.at(x).distance(pyramid(p, alpha, x)) < 1e-12);
                    assert!(near.at(x).distance(de_boor(p, x)) < 1e-14);
                }
            }
        }
    }

    #[test]
    fn pass_through_their_points_and_end_as_stated() {
        let mut random = Random(51);
        let points = random_points(&mut random, 7);
        let chord = |i: usize| (points[i + 1] - points[i]).normalize();
        let spline = catmull_rom(&points, 0.5, false).expect("points apart");
        for (i, segment) in spline.iter().enumerate() {
            assert!(segment.at(0.0) == points[i] && segment.at(1.0).distance(points[i + 1]) < 1e-15);
        }
        assert!(spline[0].tangent(0.0).distance(chord(0)) < 1e-14);
        assert!(spline[5].tangent(1.0).distance(chord(5)) < 1e-14);
        let near = b_spline(&points, false).expect("points apart");
        assert!(near[0].at(0.0).distance(points[0]) < 1e-15 && near[5].at(1.0).distance(points[6]) < 1e-15);
        assert!(near[0].tangent(0.0).distance(chord(0)) < 1e-14);
        // Without curvature at the ends.
        assert!(near[0].d2(0.0).length() < 1e-14 && near[5].d2(1.0).length() < 1e-13);
    }

    #[test]
    fn closed_curves_have_no_joint_to_see() {
        let mut random = Random(52);
        let points = random_points(&mut random, 6);
        for (segments, smooth) in [(catmull_rom(&points, 0.5, true), false), (b_spline(&points, true), true)]
        {
            let segments = segments.expect("points apart");
            for (i, segment) in segments.iter().enumerate() {
                let next = &segments[(i + 1) % 6];
                assert!(segment.at(1.0).distance(next.at(0.0)) < 1e-15);
                assert!(segment.tangent(1.0).distance(next.tangent(0.0)) < 1e-13);
                if smooth {
                    assert!(segment.d2(1.0).distance(next.d2(0.0)) < 1e-13);
                }
            }
            assert!(Curve::closed(segments, FrameRule::RotationMinimising).is_ok());
        }
    }

    #[test]
    fn two_points_and_even_ones_on_a_line_make_straight_lines() {
        let line = [DVec3::ZERO, dvec3(1.0, 2.0, 3.0)];
        for segments in [catmull_rom(&line, 0.5, false), b_spline(&line, false)] {
            let segments = segments.expect("points apart");
            assert_eq!((segments.len(), segments[0].degree()), (1, 1));
        }
        let even = [DVec3::ZERO, DVec3::X, 2.0 * DVec3::X, 3.0 * DVec3::X];
        let segments = catmull_rom(&even, 0.3, false).expect("points apart");
        assert!(segments.iter().all(|segment| segment.degree() == 1));
    }

    #[test]
    fn points_that_make_no_spline_are_named() {
        let (o, x, y) = (DVec3::ZERO, DVec3::X, DVec3::Y);
        let error = |points: &[DVec3], closed| {
            let error = catmull_rom(points, 0.5, closed).expect_err("no spline");
            assert_eq!(b_spline(points, closed).expect_err("no spline"), error);
            error
        };
        assert_eq!(error(&[], false), SplineError::TooFew { found: 0, least: 2 });
        assert_eq!(error(&[o], false), SplineError::TooFew { found: 1, least: 2 });
        assert_eq!(error(&[o, x], true), SplineError::TooFew { found: 2, least: 3 });
        assert_eq!(error(&[o, x, x, y], false), SplineError::Coincident { point: 2 });
        assert_eq!(error(&[o, x, x * (1.0 + f64::EPSILON), y], true), SplineError::Coincident { point: 2 });
        assert_eq!(error(&[o, x, y, o], true), SplineError::Coincident { point: 0 });
        assert!(catmull_rom(&[o, x, y, o], 0.5, false).is_ok());
    }

    #[test]
    fn uneven_points_stay_smooth_at_any_spacing() {
        // Neighbours 1e-6 and 1 apart: tangents still agree.
        let points =
            [DVec3::ZERO, DVec3::X, dvec3(1.0, 1e-6, 0.0), dvec3(1.0, 1.0, 1.0), dvec3(0.0, 1.0, 2.0)];
        for alpha in [0.0, 0.5, 1.0] {
            let segments = catmull_rom(&points, alpha, false).expect("points apart");
            let curve = Curve::new(segments, FrameRule::RotationMinimising).expect("a curve");
            // Control points are rounded to 1e-16, over the 1e-6 that the second segment's are apart.
            assert!((0..3).all(|joint| curve.turn(joint) < 1e-8));
        }
    }
}
