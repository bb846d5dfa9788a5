//! Truncated cones and balls that hold all of the density, and little else.
//!
//! A point with density has its foot on some piece of an axis, so it lies no farther from there than the radius, across the
//! axis. Of a piece that hardly bends and whose radius is almost linear, these discs lie in a truncated cone around the piece's
//! chord: its radius grows by what the axis strays from the chord and by what the radius is above a line, and it is longer
//! than the chord by what the discs lean. All of these are bounded by the coefficients of the span's polynomials. What gathers
//! at round ends and at corners lies in parts of balls.

use glam::DVec3;

use super::span::Span;
use super::tube::{Point, PointKind};
use super::{Field, Lattice};
use crate::num::poly::substitute;

/// A cone may be thicker than the tube by this part of its radius,
const THICKER: f64 = 0.006;
/// or by this part of a voxel.
const THICKER_VOXELS: f64 = 0.05;
/// Discs lean against the chord by no more than this tangent.
const LEAN: f64 = 0.07;
/// Pieces shorter than this many voxels are not divided further.
const SHORTEST: f64 = 0.25;
/// No piece is a smaller part of its span.
const DEPTH: u32 = 40;
/// What evaluation in single precision may take for inside, in voxels and in radii: it finds feet a little past a piece's
/// ends, moves jumps no farther than this, and the polynomials of (u, v) are this good.
const SLACK: f64 = 1e-2;
const RELATIVE: f64 = 4e-6;

/// All points whose place along an axis is within an interval, no farther from the axis than a linear function of that place.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Cone {
    /// Where the axis is at 0, in metres, and its direction.
    pub(crate) origin: DVec3,
    pub(crate) axis: DVec3,
    /// The interval.
    pub(crate) along: [f64; 2],
    /// The distances at its ends.
    pub(crate) radius: [f64; 2],
}

/// The part of a ball where `(p - centre) . v <= slack` for each of two vectors.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Ball {
    pub(crate) centre: DVec3,
    pub(crate) radius: f64,
    /// Of length 1, or 0 where nothing is cut off.
    pub(crate) cuts: [DVec3; 2],
    pub(crate) slack: f64,
}

/// A convex body.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Hull {
    Cone(Cone),
    Ball(Ball),
}

impl Field {
    /// Bodies that hold all of the density, as it is evaluated for blocks of this lattice.
    pub(crate) fn hulls(&self, lattice: Lattice) -> Vec<Hull> {
        self.hulls_by_segment(lattice).flatten().collect()
    }

    /// The same, those of each segment of a curve together, and each end and corner for itself.
    pub(crate) fn hulls_by_segment(&self, lattice: Lattice) -> impl Iterator<Item = Vec<Hull>> {
        let h = lattice.voxel_size;
        self.tubes.iter().flat_map(move |tube| {
            let segments = tube.spans.iter().map(move |spans| {
                let mut hulls = Vec::new();
                for span in spans {
                    let ends = span.core.map(|t| (t - span.middle) / span.half);
                    divide(span, ends, h, 0, &mut hulls);
                }
                hulls
            });
            segments.chain(tube.points.iter().map(move |point| vec![Hull::Ball(ball(point, h))]))
        })
    }
}

fn ball(point: &Point, h: f64) -> Ball {
    let section = &point.section;
    let slack = SLACK * h + RELATIVE * section.radius;
    let cuts = match point.kind {
        PointKind::End(outward) => [-outward, DVec3::ZERO],
        PointKind::Corner(next) => [-section.tangent, next],
    };
    Ball { centre: section.centre, radius: section.radius + slack, cuts, slack }
}

/// Halves a part of a span until its cone fits.
fn divide(span: &Span, [from, to]: [f64; 2], h: f64, depth: u32, out: &mut Vec<Hull>) {
    let (centre, scale) = (0.5 * (from + to), 0.5 * (to - from));
    let piece = Piece {
        position: substitute(&span.position, centre, scale),
        radius: substitute(&span.radius, centre, scale),
    };
    let is_last = depth >= DEPTH || piece.length() < SHORTEST * h || !(from < centre && centre < to);
    match piece.cone(h) {
        Some((cone, fits)) if fits || is_last => out.push(Hull::Cone(cone)),
        None if is_last => out.push(Hull::Ball(piece.ball(h))),
        _ => {
            divide(span, [from, centre], h, depth + 1, out);
            divide(span, [centre, to], h, depth + 1, out);
        }
    }
}

/// A part of a span, over eta in [-1, 1].
struct Piece {
    position: [DVec3; 4],
    radius: [f64; 6],
}

impl Piece {
    /// The axis is no longer.
    fn length(&self) -> f64 {
        let [_, a, b, c] = self.position;
        2.0 * (a.length() + 2.0 * b.length() + 3.0 * c.length())
    }

    /// Least and most of the radius beyond its linear part.
    fn rest(&self) -> [f64; 2] {
        let mut rest = [0.0; 2];
        for (power, c) in self.radius.iter().enumerate().skip(2) {
            // Even powers are from 0 to 1.
            let low = if power % 2 == 0 { c.min(0.0) } else { -c.abs() };
            let high = if power % 2 == 0 { c.max(0.0) } else { c.abs() };
            rest = [rest[0] + low, rest[1] + high];
        }
        rest
    }

    /// What holds it, and whether that fits; `None` where the axis may turn back.
    fn cone(&self, h: f64) -> Option<(Cone, bool)> {
        let [q0, q1, q2, q3] = self.position;
        let chord = q1 + q3;
        let half = chord.length();
        let axis = chord.try_normalize()?;
        // Along the chord: x = a2 + half eta + a2 (eta^2 - 1) + a3 (eta^3 - eta); and |eta^3 - eta| < 0.385.
        let (a2, a3) = (q2.dot(axis), q3.dot(axis));
        let (b2, b3) = ((q2 - axis * a2), (q3 - axis * a3).length());
        let pace = half - 2.0 * (a2.abs() + a3.abs());
        if pace <= 0.25 * half {
            return None;
        }
        let uneven = a2.abs() + 0.385 * a3.abs();
        // Across it: between 0 and -b2, give or take what the cubic adds.
        let strays = 0.5 * b2.length() + 0.385 * b3;
        let lean = 2.0 * (b2.length() + b3) / pace;
        let [least, most] = self.rest();
        let largest = self.radius[0] + self.radius[1].abs() + most;
        let guard = SLACK * h + RELATIVE * largest + 1e-12 * q0.abs().max_element();
        let shift = largest * lean.min(1.0);
        let slope = self.radius[1] / half;
        let thicker = strays + slope.abs() * (uneven + shift);
        let along = [a2 - half - shift - guard, a2 + half + shift + guard];
        let radius = along.map(|x| (self.radius[0] + most + slope * (x - a2) + thicker + guard).max(guard));
        let fits = thicker + (most - least) <= (THICKER * largest).max(THICKER_VOXELS * h)
            && (lean <= LEAN || shift <= THICKER_VOXELS * h);
        Some((Cone { origin: q0 + b2 * 0.5, axis, along, radius }, fits))
    }

    fn ball(&self, h: f64) -> Ball {
        let [q0, a, b, c] = self.position;
        let largest = self.radius[0] + self.radius[1].abs() + self.rest()[1];
        let slack = SLACK * h + RELATIVE * largest + 1e-12 * q0.abs().max_element();
        let radius = largest.max(0.0) + a.length() + b.length() + c.length() + slack;
        Ball { centre: q0, radius, cuts: [DVec3::ZERO; 2], slack }
    }
}
