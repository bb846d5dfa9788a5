//! Narrowing a field to a block: which parts of the axes can hold feet of its voxels, and how many.

use std::f64::consts::TAU;

use glam::DVec3;

use super::cover::{Capsule, Reach, support};
use super::detail::Place;
use super::near::{Near, SLACK};
use super::region::{
    self, FOOT, Part, Piece, ROWS, Region, SECOND, Search, Shared, Turn, Twist, U, V, round,
};
use super::span::{LEAST_RADIUS, Span};
use super::tube::{CORNER, PointKind, Tube};
use super::{EDGE, Extent, Field, Lattice};
use crate::curve::Segment;
use crate::num::poly::{TERMS, beyond_cubic, evaluate, substitute, to_cubic};
use crate::num::{SLIGHT, Scalar};
use crate::scene::{Caps, Conserve, Overlap};

/// A part of a field that may hold feet of a block's voxels: an index into the cover.
pub type Candidate = u32;

/// Uniqueness is certified where `g'` stays above this fraction of the squared speed.
const CERTAIN: f64 = 0.02;
/// The focal fade is 1 where `1 - kappa rho cos` is at least this.
const FOCAL: f64 = 0.2;
/// Pieces shorter than this many voxels are not divided further.
const SHORTEST: f64 = 0.25;
/// Halvings after which a piece is left uncertified whatever its length.
const DEPTH: u32 = 24;
/// Neighbouring pieces both accept feet this close to their common border, in voxels, so that rounding leaves no hole.
const OVERLAP: f64 = 1e-3;
/// And no farther than this part of half the piece: where the axis turns sharply, pieces are far shorter than a voxel, and
/// their polynomials mean nothing a voxel away. What bends so much also places feet this well.
const PAST: f64 = 0.01;

/// Pieces share the feet of an interval where `g'` stays above this fraction of the largest squared speed: it is then nowhere more
/// than three times what it is elsewhere, and Newton's method, from the middle, does not leave the interval for good.
const EVEN: f64 = 0.5;

/// Pieces do not share the feet of an interval so many times as long: single precision would not place them well enough.
const LONGEST: f64 = 1e3;

/// The part of a piece, beside a place where the axis stands still, that has no feet. There `(C - p) . C' = 0` for every p,
/// and no distance need be least; as the axis moves away from there by the square of this, no foot is lost.
const STANDING: f64 = 1e-4;

/// How far an interval may reach past the feet on it, beside the interval that they were sought in.
const ENOUGH: f64 = 0.02;
/// Newton steps towards that, at most.
const CLOSER: usize = 4;

/// What cubics may change of u and v, in radii and so half of what a span's polynomials do; of the height, in tens of voxels;
/// of radius and gain, relative to them.
const CUBIC: f64 = 1.5e-7;

/// Cosine beyond which a corner is a cusp or a fold.
const STRAIGHT_BACK: f64 = 1.0 - 1e-9;

/// What single precision may lose of a distance to a plane, in radii.
const ROUNDING: f64 = 3e-7;

/// An interval of t with the largest radius on it.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Interval {
    segment: usize,
    t: [f64; 2],
    radius: f64,
    /// Index of a span that does not begin behind it.
    span: usize,
    /// Holds at most one foot of every voxel of the block.
    certified: bool,
    /// A lower bound of g' on it, of voxels within the radius.
    slope: f64,
    /// The same over the square of the speed: of `1 - kappa rho cos`.
    focal: f64,
    /// The Newton step, in voxels, after which a foot on it is found.
    settled: f64,
}

/// The block in world space.
#[derive(Debug, Clone, Copy)]
pub(super) struct Block {
    /// Its centre in metres.
    pub(super) centre: DVec3,
    /// Edge of a voxel.
    pub(super) h: f64,
    /// Half the edge of its extent.
    pub(super) half_edge: f64,
}

impl Block {
    /// Bounds of how far its voxels are from a place, metres, with what single precision may make of it.
    fn distances(&self, place: DVec3) -> [f64; 2] {
        let from = (place - self.centre).abs();
        let half = DVec3::splat(self.half_edge);
        let slack = SLACK * self.h;
        [(from - half).max(DVec3::ZERO).length() - slack, (from + half).length() + slack]
    }
}

impl Field {
    /// Narrows the field to the block of 8^3 voxels whose coordinates, in blocks, are `block`.
    ///
    /// `cover` is the field's cover for this lattice, and `candidates` the capsules of it, ascending, that reach the
    /// block's `extent`. `region` is overwritten; its memory is kept from block to block.
    pub fn narrow<T: Scalar>(
        &self,
        lattice: Lattice,
        extent: Extent,
        cover: &[Capsule],
        candidates: &[Candidate],
        block: [i64; 3],
        region: &mut Region<T>,
    ) {
        region.tubes.clear();
        region.pieces.clear();
        region.layers.clear();
        region.sums.clear();
        region.octaves.clear();
        region.shared = 0;
        let h = lattice.voxel_size;
        #[allow(clippy::cast_precision_loss, reason = "block coordinates fit 29 bits")]
        let centre = DVec3::from(block.map(|b| (b as f64 + 0.5) * 8.0 * h));
        let block = Block { centre, h, half_edge: extent.half_edge() * h };
        let mut join = false;
        let tube_of = |index: &Candidate| cover[*index as usize].tube;
        for candidates in candidates.chunk_by(|a, b| tube_of(a) == tube_of(b)) {
            let Some(tube) = candidates.first().map(|first| &self.tubes[tube_of(first) as usize]) else {
                continue;
            };
            let first = region.pieces.len();
            region.parts.clear();
            self.tube(tube, cover, candidates, block, region);
            if region.pieces.len() > first {
                order(tube, h, &region.parts, &mut region.pieces[first..]);
                let lap = tube.curve.is_closed().then(|| T::from_f64(tube.curve.length() / h));
                let pieces = [first, region.pieces.len()];
                region.tubes.push(region::Tube { pieces, overlap: tube.overlap, lap });
                join |= may_repeat(tube, &region.parts);
            }
        }
        let several = self.overlap != Overlap::Max && region.tubes.len() > 1;
        region.join = (join || several).then_some(self.overlap);
    }

    fn tube<T: Scalar>(
        &self,
        tube: &Tube,
        cover: &[Capsule],
        candidates: &[Candidate],
        block: Block,
        region: &mut Region<T>,
    ) {
        let mut rest = candidates;
        while let [first, ..] = rest {
            let capsule = cover[*first as usize];
            if capsule.is_point {
                rest = &rest[1..];
                self.point(tube, &capsule, block, region);
                continue;
            }
            // Capsules that touch are one interval.
            let mut merged = capsule;
            let mut count = 1;
            while let Some(next) = rest.get(count).map(|&i| cover[i as usize]) {
                if next.is_point || next.part != merged.part || next.t[0] > merged.t[1] {
                    break;
                }
                merged.t[1] = next.t[1];
                merged.radius = merged.radius.max(next.radius);
                count += 1;
            }
            rest = &rest[count..];
            self.interval(tube, &merged, block, region);
        }
    }

    fn interval<T: Scalar>(&self, tube: &Tube, capsule: &Capsule, block: Block, region: &mut Region<T>) {
        let segment = &tube.curve.segments()[capsule.part as usize];
        let whole = Interval {
            segment: capsule.part as usize,
            t: capsule.t,
            radius: capsule.radius,
            span: capsule.span as usize,
            certified: false,
            slope: 0.0,
            focal: 0.0,
            settled: 0.0,
        };
        let mut found = std::mem::take(&mut region.intervals);
        found.clear();
        refine(segment, whole, block, 0, &mut found);
        for &interval in &found {
            if interval.certified {
                if let Some(interval) = clip(segment, interval, block) {
                    self.spans(tube, interval, block, region);
                }
            } else {
                self.spans(tube, interval, block, region);
            }
        }
        region.intervals = found;
    }

    /// Divides the interval into as few pieces as spans hold of it.
    fn spans<T: Scalar>(&self, tube: &Tube, interval: Interval, block: Block, region: &mut Region<T>) {
        let spans = &tube.spans[interval.segment][interval.span..];
        let before = spans.iter().take_while(|span| span.core[1] <= interval.t[0]).count();
        let mut rest = &spans[before..];
        let mut shared = None;
        while let Some(first) = rest.first() {
            let [start, end] = [interval.t[0].max(first.core[0]), interval.t[1]];
            if start > end || (start == end && end > interval.t[0]) {
                break;
            }
            let (span, count) = longest(rest, [start, end]);
            let t = [start, end.min(rest[count - 1].core[1])];
            let is_part = interval.certified && t != interval.t;
            if is_part
                && shared.is_none()
                && least_focal(segment_of(tube, interval.segment), interval, block) >= EVEN
            {
                shared = Some(Feet::new(span, interval.t, block));
                region.shared += 1;
            }
            self.piece(tube, span, Interval { t, ..interval }, shared.as_ref(), block, region);
            rest = &rest[count..];
        }
    }

    /// The piece of an interval that one span holds, with the feet of a longer one if they are `shared`.
    fn piece<T: Scalar>(
        &self,
        tube: &Tube,
        span: &Span,
        interval: Interval,
        shared: Option<&Feet>,
        block: Block,
        region: &mut Region<T>,
    ) {
        let (h, segment) = (block.h, interval.segment);
        let own = Feet::new(span, interval.t, block);
        let shared = shared.filter(|feet| feet.to(interval.t)[1] < LONGEST);
        let feet = shared.unwrap_or(&own);
        let [centre, scale] = stretch(span, interval.t);
        let from_axis = block.centre - span.position[0];

        let mut base = [0.0; ROWS];
        let mut slope = [[0.0; ROWS]; 3];
        for (side, row) in [U, V].into_iter().enumerate() {
            let across = substitute(&span.across[side], centre, scale);
            let offset = substitute(&span.offset[side], centre, scale);
            for k in 0..TERMS {
                base[row + k] = from_axis.dot(across[k]) - offset[k];
                for axis in 0..3 {
                    slope[axis][row + k] = h * across[k][axis];
                }
            }
        }

        let dq = feet.slope();
        let g = feet.equation(&dq);
        for k in 0..3 {
            base[FOOT + k] = g[k];
            for axis in 0..3 {
                slope[axis][FOOT + k] = -dq[k][axis];
            }
        }
        let arc = substitute(&span.arc, centre, scale);
        let rate = tube.height_rate();
        let arc_middle = span.arc_middle + arc[0];
        let mut height = arc.map(|s| s * rate);
        height[0] = 0.0;
        let twist = turned(tube, arc_middle).map(|[cos, sin]| {
            for row in [&mut base].into_iter().chain(&mut slope) {
                for k in 0..TERMS {
                    let (u, v) = (row[U + k], row[V + k]);
                    (row[U + k], row[V + k]) = (u * cos + v * sin, v * cos - u * sin);
                }
            }
            let rate = tube.twist_rate / (TAU * rate);
            // A foot may lie a little past the piece's ends.
            let most = 1.05 * height.iter().map(|h| h.abs()).sum::<f64>();
            let most = match (rate * most).abs() {
                most if most <= SLIGHT => Turn::Slight,
                most if most <= 0.125 => Turn::Gentle,
                _ => Turn::Any,
            };
            Twist { rate: T::from_f64(rate), most }
        });

        let s = [-1.0, 1.0].map(|eta| span.arc_middle + evaluate(&arc, eta));
        let mut radius = substitute(&span.radius, centre, scale).map(|r| r / h);
        let mut gain = span.gain.map(|gain| substitute(&gain, centre, scale));
        let is_near = |c: &[f64; TERMS], size: f64| beyond_cubic(c) <= CUBIC * size;
        let is_cubic = are_cubic(&base, &slope)
            && is_near(&height, 10.0 * rate * h)
            && is_near(&radius, radius[0])
            && gain.is_none_or(|gain| is_near(&gain, gain[0]));
        if is_cubic {
            for rows in [&mut base].into_iter().chain(&mut slope) {
                rows[U..FOOT].as_chunks_mut().0.iter_mut().for_each(to_cubic);
            }
            [&mut height, &mut radius].into_iter().chain(&mut gain).for_each(to_cubic);
        }

        let is_hard =
            interval.focal < FOCAL && least_focal(segment_of(tube, segment), interval, block) < FOCAL;
        let cut = tube.caps != Caps::Round && !tube.curve.is_closed();
        let (is_first, is_last) = (segment == 0, segment + 1 == tube.spans.len());
        let [starts, ends] = stands(segment_of(tube, segment), interval.t);
        if starts && ends {
            return;
        }
        let margin = own.margin();
        let range = [
            match (starts, cut && is_first && interval.t[0] <= 0.0) {
                (true, _) => STANDING - 1.0,
                (_, true) => -1.0,
                _ => -1.0 - margin,
            },
            match (ends, cut && is_last && interval.t[1] >= 1.0) {
                (true, _) => 1.0 - STANDING,
                (_, true) => 1.0,
                _ => 1.0 + margin,
            },
        ];
        let mut away = block.distances(block.centre + own.q[0] * h);
        // How far from its middle the piece reaches, and a little past its ends.
        let strays = 1.05 * h * (own.q[1].length() + own.q[2].length() + own.q[3].length());
        away[0] -= strays;
        if !interval.certified {
            // The foot need not be the nearest place of the piece.
            away[1] += strays;
        }
        // And how the radius varies there.
        let varies = 1.05 * radius[1..].iter().map(|r| r.abs()).sum::<f64>();
        let place = Place {
            radius: [(radius[0] - varies).max(LEAST_RADIUS * radius[0]), radius[0] + varies].map(|r| r * h),
            origin: arc_middle,
            away,
            block,
            octave_fade: self.octave_fade,
        };
        let (layers, [fades, in_world]) = place.layers(tube, region);
        region.parts.push(Part {
            arc: arc_middle,
            ends: Some([(segment, interval.t[0]), (segment, interval.t[1])]),
            certified: interval.certified,
        });
        let is_full = tube.conserve == Conserve::Full;
        region.pieces.push(Piece {
            near: Near::piece(&own.q, range, &radius, interval.certified),
            search: if interval.certified {
                Search::Newton { cubic: feet.q[3] != DVec3::ZERO }
            } else {
                Search::Bracket
            },
            shared: shared.map(|feet| Shared {
                number: region.shared,
                own: round(feet.to(interval.t)),
                range: round([-1.0 - feet.margin(), 1.0 + feet.margin()]),
            }),
            base: round(base),
            slope: slope.map(round),
            foot: round([g[3], g[4], g[5]]),
            is_cubic,
            range: round(range),
            tolerance: T::from_f64(interval.settled / feet.voxels),
            height: round(height),
            twist,
            radius: round(radius),
            speed: (is_hard || is_full).then(|| round(speed(&dq))),
            is_faded: is_hard && tube.overlap != Overlap::Closest,
            is_full,
            gain: gain.map(round),
            arc: round([0.0, 1.0 / (rate * h)]),
            axial: axial(tube, s, arc_middle),
            radial: tube.radial,
            layers,
            fades,
            in_world,
        });
    }

    fn point<T: Scalar>(&self, tube: &Tube, capsule: &Capsule, block: Block, region: &mut Region<T>) {
        let still = Reach::still(tube.points[capsule.part as usize].section.centre);
        if still.is_far(block.centre, block.half_edge, capsule.radius)
            || !capsule.faces(tube, block.centre, block.half_edge)
        {
            return;
        }
        let point = &tube.points[capsule.part as usize];
        let section = &point.section;
        let [mut u, mut v] = section.axes;
        if let Some([cos, sin]) = turned(tube, section.arc) {
            (u, v) = (u * cos + v * sin, v * cos - u * sin);
        }
        let scale = 1.0 / section.radius;
        let (rows, search) = match point.kind {
            PointKind::End(outward) => {
                ([u, v, outward, DVec3::ZERO].map(|v| v * scale), Search::Point { is_corner: false })
            }
            PointKind::Corner(next) => {
                // Along the hinge, and across it in the plane normal to the first tangent.
                let hinge = section.tangent.cross(next);
                let hinge = if hinge.length() > 1e-9 { hinge.normalize() } else { section.axes[0] };
                let across = hinge.cross(section.tangent);
                // Where the axis turns back, the two planes are one.
                let second = if section.tangent.dot(next) < -STRAIGHT_BACK { -section.tangent } else { next };
                (
                    [hinge, across, section.tangent, second].map(|v| v * scale),
                    Search::Point { is_corner: true },
                )
            }
        };
        let mut base = [0.0; ROWS];
        let mut slope = [[0.0; ROWS]; 3];
        for (row, vector) in [U, V, FOOT, SECOND].into_iter().zip(rows) {
            base[row] = (block.centre - section.centre).dot(vector);
            for axis in 0..3 {
                slope[axis][row] = block.h * vector[axis];
            }
        }
        if matches!(point.kind, PointKind::Corner(next) if section.tangent.dot(next) < -STRAIGHT_BACK) {
            // No piece reaches past that plane: rounding must not open a gap.
            base[FOOT] += ROUNDING;
            base[SECOND] -= ROUNDING;
        }
        // Where the radius grows like a root, the piece at an end is too short for single precision to tell what is on it: the
        // end takes feet a little before its plane, too.
        let least = match point.kind {
            PointKind::End(_) => -OVERLAP * block.h * scale,
            PointKind::Corner(_) => 0.0,
        };
        // For corners, u = a u' + b v' with (u', v') along and across the hinge; the kernel reads a, b, c, d here.
        let turn = [
            u.dot(rows[0]) * section.radius,
            u.dot(rows[1]) * section.radius,
            v.dot(rows[0]) * section.radius,
            v.dot(rows[1]) * section.radius,
        ];
        for (k, value) in turn.into_iter().enumerate() {
            base[U + 1 + k] = value;
        }
        let away = block.distances(section.centre);
        let place = Place {
            radius: [section.radius; 2],
            origin: section.arc,
            away,
            block,
            octave_fade: self.octave_fade,
        };
        let (layers, [fades, in_world]) = place.layers(tube, region);
        region.parts.push(Part { arc: section.arc, ends: None, certified: true });
        let gain = (section.gain != 1.0).then(|| {
            let mut gain = [0.0; TERMS];
            gain[0] = section.gain;
            round(gain)
        });
        let mut radius = [0.0; TERMS];
        radius[0] = section.radius / block.h;
        let centre = (section.centre - block.centre) * (1.0 / block.h);
        region.pieces.push(Piece {
            near: Near::point(centre, section.radius / block.h, base[FOOT], rows[2] * block.h),
            search,
            shared: None,
            base: round(base),
            slope: slope.map(round),
            foot: round([0.0; 3]),
            is_cubic: true,
            range: round([least, 1.0]),
            tolerance: T::from_f64(1.0),
            height: round([0.0; TERMS]),
            twist: None,
            radius: round(radius),
            speed: None,
            is_faded: false,
            is_full: false,
            gain,
            arc: round([0.0, 1.0]),
            axial: axial(tube, [section.arc; 2], section.arc),
            radial: tube.radial,
            layers,
            fades,
            in_world,
        });
    }
}

/// What finds feet on an interval of an axis, whose parameter eta runs over [-1, 1].
struct Feet {
    t: [f64; 2],
    /// The axis from the block's centre, in voxels.
    q: [DVec3; 4],
    /// Voxels per unit of eta, in the middle or at the end.
    voxels: f64,
}

impl Feet {
    /// `span` is any of the interval's segment.
    fn new(span: &Span, t: [f64; 2], block: Block) -> Feet {
        let [centre, scale] = stretch(span, t);
        let position = substitute(&span.position, centre, scale);
        let mut q = position.map(|c| c * (1.0 / block.h));
        q[0] = (position[0] - block.centre) * (1.0 / block.h);
        let fastest = q[1].length_squared().max((q[1] + q[2] * 2.0 + q[3] * 3.0).length_squared());
        Feet { t, q, voxels: fastest.sqrt().max(f64::MIN_POSITIVE) }
    }

    /// `q'`.
    fn slope(&self) -> [DVec3; 3] {
        [self.q[1], self.q[2] * 2.0, self.q[3] * 3.0]
    }

    /// `g = q . q'`, of the block's centre.
    fn equation(&self, dq: &[DVec3; 3]) -> [f64; 6] {
        let mut g = [0.0; 6];
        for (i, a) in self.q.iter().enumerate() {
            for (j, b) in dq.iter().enumerate() {
                g[i + j] += a.dot(*b);
            }
        }
        g
    }

    /// How far past its ends feet are accepted.
    fn margin(&self) -> f64 {
        (OVERLAP / self.voxels).min(PAST)
    }

    /// From its parameter to that of a part of it: a constant and a factor.
    fn to(&self, part: [f64; 2]) -> [f64; 2] {
        let middle = |t: [f64; 2]| 0.5 * (t[0] + t[1]);
        let half = |t: [f64; 2]| (0.5 * (t[1] - t[0])).max(f64::MIN_POSITIVE);
        [(middle(self.t) - middle(part)) / half(part), half(self.t) / half(part)]
    }
}

/// From a span's parameter to one that runs over [-1, 1] on an interval: what the former is in the middle, and the factor.
fn stretch(span: &Span, t: [f64; 2]) -> [f64; 2] {
    let centre = (0.5 * (t[0] + t[1]) - span.middle) / span.half;
    [centre, (0.5 * (t[1] - t[0]) / span.half).max(f64::MIN_POSITIVE)]
}

/// `|q'|^2`.
fn speed(dq: &[DVec3; 3]) -> [f64; 5] {
    let mut speed = [0.0; 5];
    for (i, a) in dq.iter().enumerate() {
        for (j, b) in dq.iter().enumerate() {
            speed[i + j] += a.dot(*b);
        }
    }
    speed
}

/// Whether u and v are polynomials of degree 3 all over the block, nearly.
fn are_cubic(base: &[f64; ROWS], slope: &[[f64; ROWS]; 3]) -> bool {
    [U, V].into_iter().all(|first| {
        let most = |k: usize| {
            let slopes = slope[0][k].abs() + slope[1][k].abs() + slope[2][k].abs();
            base[k].abs() + 0.5 * EDGE as f64 * slopes
        };
        beyond_cubic(&[0.0, 0.0, 0.0, 0.0, most(first + 4), most(first + 5)]) <= CUBIC
    })
}

/// Of spans the one that holds most of an interval that begins on the first one's core, and how many cores it holds there; among
/// equals the one whose middle is nearest.
fn longest(spans: &[Span], t: [f64; 2]) -> (&Span, usize) {
    let mut best = (&spans[0], 0, f64::INFINITY);
    let near = spans.iter().take_while(|span| span.core[0] <= t[1]);
    for span in near.filter(|span| span.fit[0] <= t[0]) {
        let (mut end, mut count) = (spans[0].core[0], 0);
        for next in spans {
            // Where there is no tube there are no spans.
            let follows = next.core[0] == end && end <= t[1];
            if !follows || next.core[1].min(t[1]) > span.fit[1] {
                break;
            }
            (end, count) = (next.core[1], count + 1);
        }
        let distance = (span.middle - 0.5 * (t[0] + end.min(t[1]))).abs();
        if count > best.1 || (count == best.1 && distance < best.2) {
            best = (span, count, distance);
        }
    }
    (best.0, best.1)
}

/// Sorts the pieces along the axis, each with its arc length from that of the first; a closed axis is cut opposite to that.
fn order<T: Scalar>(tube: &Tube, h: f64, parts: &[Part], pieces: &mut [Piece<T>]) {
    let [first, _, ..] = parts else { return };
    let length = tube.curve.length();
    for (piece, part) in pieces.iter_mut().zip(parts) {
        let mut arc = part.arc - first.arc;
        if tube.curve.is_closed() {
            arc -= length * (arc / length + 0.5).floor();
        }
        piece.arc[0] = T::from_f64(arc / h);
    }
    pieces.sort_by(|a, b| a.arc[0].to_f64().total_cmp(&b.arc[0].to_f64()));
}

/// Whether feet on the tube must be told apart: a voxel may have several, or one that two pieces hold.
///
/// It has one at most in a certified piece, and in two of them that touch, since the foot's equation increases along both;
/// that both may hold a foot on their border does no harm where the larger density counts.
fn may_repeat(tube: &Tube, parts: &[Part]) -> bool {
    match parts {
        [part] => !part.certified,
        [a, b] if tube.overlap == Overlap::Max && a.certified && b.certified => match (a.ends, b.ends) {
            (Some([_, end]), Some([start, _])) => !touch(tube, end, start),
            _ => true,
        },
        _ => true,
    }
}

/// Whether a piece that starts at `next` goes on where one ends at `end`, without a corner between.
fn touch(tube: &Tube, end: (usize, f64), next: (usize, f64)) -> bool {
    if end.0 == next.0 {
        return next.1 <= end.1;
    }
    tube.curve.after(end.0) == Some(next.0)
        && end.1 >= 1.0
        && next.1 <= 0.0
        && tube.curve.turn(end.0) <= CORNER
}

/// Cosine and sine of the angle that the cross-section has turned by at an arc length.
fn turned(tube: &Tube, arc: f64) -> Option<[f64; 2]> {
    tube.turns.map(|[start, rate]| {
        let turns = start + rate * arc;
        let (sin, cos) = libm::sincos(TAU * (turns - (turns + 0.5).floor()));
        [cos, sin]
    })
}

/// [`Piece::axial`] of a piece between two arc lengths, with the arc length of its layers' origin.
fn axial<T: Scalar>(tube: &Tube, [first, last]: [f64; 2], origin: f64) -> [Option<[T; 2]>; 2] {
    let Caps::Fade(fraction) = tube.caps else { return [None; 2] };
    let length = tube.curve.length();
    let (faded, near) = (fraction * length, 1.001 * fraction * length);
    let rate = 1.0 / (faded * tube.height_rate());
    [
        (first < near).then(|| round([origin / faded, rate])),
        (last > length - near).then(|| round([(length - origin) / faded, -rate])),
    ]
}

/// At which of two places the axis stands still: in a cusp or fold, or at an end where control points coincide.
fn stands(segment: &Segment, t: [f64; 2]) -> [bool; 2] {
    let [_, a, b, c] = segment.power();
    let still = 1e-18 * (a.length_squared() + 4.0 * b.length_squared() + 9.0 * c.length_squared());
    t.map(|t| segment.d1(t).length_squared() <= still)
}

fn segment_of(tube: &Tube, segment: usize) -> &Segment {
    &tube.curve.segments()[segment]
}

/// Drops what cannot hold feet and certifies what it can, in order; halves the rest.
fn refine(segment: &Segment, interval: Interval, block: Block, depth: u32, found: &mut Vec<Interval>) {
    let reach = Reach::new(segment, interval.t);
    if reach.is_far(block.centre, block.half_edge, interval.radius) {
        return;
    }
    // Only voxels within the radius of the interval matter.
    let distance = interval.radius + 2.0 * reach.half * reach.speed;
    let from_block = reach.centre - block.centre;
    let g = from_block.dot(reach.d1).abs() - block.half_edge * support(reach.d1);
    if g > reach.half * reach.slope(distance) * (1.0 + 1e-9) {
        return;
    }
    let slope = least_slope(&reach, block, distance);
    let focal = slope / (reach.speed * reach.speed);
    let certified = focal > CERTAIN;
    let middle = 0.5 * (interval.t[0] + interval.t[1]);
    let is_short = reach.half * reach.speed < 0.5 * SHORTEST * block.h || depth >= DEPTH;
    if certified || is_short {
        match found.last_mut() {
            Some(last) if certified && last.certified && last.t[1] == interval.t[0] => {
                last.t[1] = interval.t[1];
                last.slope = last.slope.min(slope);
                last.focal = last.focal.min(focal);
                last.settled = last.settled.min(settled_step(&reach, slope, distance, block.h));
            }
            _ => {
                let settled = settled_step(&reach, slope, distance, block.h);
                found.push(Interval { certified, slope, focal, settled, ..interval });
            }
        }
        return;
    }
    refine(segment, Interval { t: [interval.t[0], middle], ..interval }, block, depth + 1, found);
    refine(segment, Interval { t: [middle, interval.t[1]], ..interval }, block, depth + 1, found);
}

/// A lower bound of g' over the interval and those voxels of the block that are within `distance` of its middle.
fn least_slope(reach: &Reach, block: Block, distance: f64) -> f64 {
    let from_block = reach.centre - block.centre;
    let over_block = from_block.dot(reach.d2) - block.half_edge * support(reach.d2);
    let over_disc = -distance * reach.d2.length();
    let here = reach.d1.length_squared() + over_block.max(over_disc);
    // |g''| = |3 C' . C'' + (C - p) . C'''|
    here - reach.half * (3.0 * reach.speed * reach.bend + (distance + reach.half * reach.speed) * reach.third)
}

/// A lower bound of `1 - kappa rho cos` at voxels with their foot on the interval, and of `g'` over the largest squared speed; closer
/// than [`Interval::focal`], which is of all that the interval was clipped from.
fn least_focal(segment: &Segment, interval: Interval, block: Block) -> f64 {
    if !interval.certified {
        return 0.0;
    }
    let reach = Reach::new(segment, interval.t);
    least_slope(&reach, block, interval.radius + 2.0 * reach.half * reach.speed) / (reach.speed * reach.speed)
}

/// The Newton step, in voxels of edge `h`, after which a foot is within 1e-5 voxels, of voxels no farther than `distance` from
/// the interval's middle: each step's error is at most `M / (2 G)` times the square of the last's, with M the largest |g''| and G
/// the smallest g', which is `slope`.
fn settled_step(reach: &Reach, slope: f64, distance: f64, h: f64) -> f64 {
    const ERROR: f64 = 1e-5;
    let least = slope.max(CERTAIN * reach.speed * reach.speed);
    let most = 3.0 * reach.speed * reach.bend + distance * reach.third;
    let step = (ERROR * 2.0 * least * reach.speed / (most * h).max(f64::MIN_POSITIVE)).sqrt();
    // Single precision resolves a foot to about this much.
    let floor = 2e-7 * (1.0 + distance / h);
    step.min(0.1).max(floor)
}

/// Shortens a certified interval to the feet of the block's voxels; `None` where it holds none.
///
/// Every `g_p(t) = (C(t) - p) . C'(t)` increases on the interval, and so do the largest and the smallest of them over
/// the block, `g_o(t) +- half_edge support(C'(t))`: their zeros bound the feet. Where the largest is `v` at some t, no foot
/// lies before `t - v / m`, with m the least slope of all g_p, nor before t where v is below 0; the smallest bounds them from
/// behind.
fn clip(segment: &Segment, interval: Interval, block: Block) -> Option<Interval> {
    let bounds = |t: f64| {
        let d1 = segment.d1(t);
        let (middle, spread) = ((segment.at(t) - block.centre).dot(d1), block.half_edge * support(d1));
        [middle - spread, middle + spread]
    };
    let ends = interval.t.map(bounds);
    let [least, greatest] = [0, 1].map(|side| ends.map(|bounds| bounds[side]));
    if greatest[1] < 0.0 || least[0] > 0.0 {
        return None;
    }
    let [low, high] = interval.t;
    let length = high - low;
    let nearest = |side: usize, at: [f64; 2]| {
        let pace = length / (at[1] - at[0]);
        let mut t = low - at[0] * pace;
        let mut value = bounds(t)[side];
        for _ in 1..CLOSER {
            if value.abs() <= ENOUGH * length * interval.slope {
                break;
            }
            t = (t - value * pace).clamp(low, high);
            value = bounds(t)[side];
        }
        [t, value / interval.slope]
    };
    let (mut start, mut end) = (low, high);
    if greatest[0] < 0.0 {
        let [t, ahead] = nearest(1, greatest);
        start = t - ahead.max(0.0);
    }
    if least[1] > 0.0 {
        let [t, ahead] = nearest(0, least);
        end = t - ahead.min(0.0);
    }
    // A guard against the bounds' own rounding.
    let guard = 1e-3 * (end - start) + 1e-12 * length;
    Some(Interval { t: [(start - guard).max(low), (end + guard).min(high)], ..interval })
}
