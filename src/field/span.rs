//! Spans: intervals of a segment on which everything but the position is a polynomial of degree 5.

use glam::DVec3;

use super::radius::Radius;
use crate::curve::Curve;
use crate::num::poly::{NODES, TERMS, evaluate, interpolate, substitute};

/// Where the error of (u, v), and of the arc length in units of radius plus span, must stay below this.
const TOLERANCE: f64 = 3e-7;
/// How far past its core, in its lengths, a span is fitted.
const PAST: f64 = 0.5;
/// And on to these where long fits are asked for, as far as they hold.
const LONGER: [f64; 4] = [0.7, 0.85, 1.0, 1.25];
/// A span is not halved more often than this: what is then left of a segment is too short to matter.
const DEPTH: u32 = 40;
/// Below this fraction of the largest radius there is no tube.
pub(crate) const LEAST_RADIUS: f64 = 1e-6;
/// Nothing gains more density than this, so that no value leaves the range of single precision.
pub(super) const MOST_GAIN: f64 = 1e6;

/// An interval of a segment, with polynomials in tau, where t = middle + half tau.
///
/// The polynomials hold on `fit`, which reaches past `core` on both sides, so that a block rarely needs two spans; the
/// cores of a segment's spans touch without overlap.
#[derive(Debug, Clone)]
pub(crate) struct Span {
    pub(crate) core: [f64; 2],
    pub(crate) fit: [f64; 2],
    pub(crate) middle: f64,
    pub(crate) half: f64,
    /// Position of the axis, exact.
    pub(crate) position: [DVec3; 4],
    /// The frame's two axes across the tube, before twist, over the radius, per metre.
    pub(crate) across: [[DVec3; TERMS]; 2],
    /// Their products with `C - C(middle)`.
    pub(crate) offset: [[f64; TERMS]; 2],
    /// Arc length from `arc_middle`, metres.
    pub(crate) arc: [f64; TERMS],
    pub(crate) arc_middle: f64,
    /// Radius, metres.
    pub(crate) radius: [f64; TERMS],
    /// What the density gains by the deformation, bending apart; `None` where that is nothing.
    pub(crate) gain: Option<[f64; TERMS]>,
}

/// How far the axis is from its place at tau = 0.
fn along(position: &[DVec3; 4], tau: f64) -> DVec3 {
    ((position[3] * tau + position[2]) * tau + position[1]) * tau
}

/// What a span is fitted to: the axis of one tube with its radius.
pub(crate) struct Axis<'a> {
    pub(crate) curve: &'a Curve,
    pub(crate) radius: &'a Radius,
    /// Where density is conserved: the square of the radius at which it is as at rest.
    pub(crate) conserved: Option<f64>,
    /// Whether spans are fitted as far as they hold, so that even blocks that are long beside them rarely need two: they err more
    /// then, if within the tolerance.
    pub(crate) is_long: bool,
}

/// The tube's cross-section at one place.
#[derive(Debug, Clone)]
pub(crate) struct Section {
    pub(crate) centre: DVec3,
    pub(crate) tangent: DVec3,
    /// Unit vectors along the cylinder's u and v, before twist.
    pub(crate) axes: [DVec3; 2],
    pub(crate) radius: f64,
    pub(crate) arc: f64,
    /// What the density gains by the deformation, bending apart.
    pub(crate) gain: f64,
}

impl Axis<'_> {
    pub(crate) fn section(&self, segment: usize, t: f64) -> Section {
        let arc = self.curve.arc_length(segment, t);
        let frame = self.curve.frame(segment, t);
        let x = arc / self.curve.length();
        Section {
            centre: self.curve.segments()[segment].at(t),
            tangent: frame.tangent,
            axes: [frame.normal, frame.binormal],
            radius: self.radius.at(x),
            arc,
            gain: self.gain(x),
        }
    }

    /// What the density gains by the deformation at the fraction x of the length, bending apart.
    fn gain(&self, x: f64) -> f64 {
        let radius = self.radius.at(x);
        match self.conserved {
            Some(square) => (square / (radius * radius)).min(MOST_GAIN),
            None if self.radius.is_widened() => {
                let ratio = self.radius.own(x) / radius;
                ratio * ratio
            }
            None => 1.0,
        }
    }

    /// The spans of one segment, in order. `breaks` are the places inside (0, 1) that no span may reach across.
    pub(crate) fn spans(&self, segment: usize, breaks: &[f64]) -> Vec<Span> {
        let mut spans = Vec::new();
        let mut start = 0.0;
        for &end in breaks.iter().chain([&1.0]) {
            if end > start {
                self.divide(segment, [start, end], [start, end], 0, &mut spans);
            }
            start = end;
        }
        spans
    }

    fn divide(&self, segment: usize, core: [f64; 2], limit: [f64; 2], depth: u32, spans: &mut Vec<Span>) {
        let fit = |past: f64| {
            let reach = past * (core[1] - core[0]);
            [(core[0] - reach).max(limit[0]), (core[1] + reach).min(limit[1])]
        };
        let places = |t: [f64; 2]| t.map(|t| self.curve.arc_length(segment, t) / self.curve.length());
        if self.radius.vanishes(places(core)) {
            return;
        }
        let mut span = self.fit(segment, core, fit(PAST));
        let holds = |span: &Span| self.radius.lasts(places(span.fit)) && self.holds(segment, span);
        if depth >= DEPTH || holds(&span) {
            let longer = if self.is_long { &LONGER[..] } else { &[] };
            for fit in longer.iter().map(|past| fit(*past)) {
                if fit == span.fit {
                    break;
                }
                let longer = self.fit(segment, core, fit);
                if !holds(&longer) {
                    break;
                }
                span = longer;
            }
            spans.push(span);
            return;
        }
        let middle = 0.5 * (core[0] + core[1]);
        self.divide(segment, [core[0], middle], limit, depth + 1, spans);
        self.divide(segment, [middle, core[1]], limit, depth + 1, spans);
    }

    fn fit(&self, segment: usize, core: [f64; 2], fit: [f64; 2]) -> Span {
        let (middle, half) = (0.5 * (fit[0] + fit[1]), 0.5 * (fit[1] - fit[0]));
        let position = substitute(self.curve.segments()[segment].power(), middle, half);
        let arc_middle = self.curve.arc_length(segment, middle);
        let sections = NODES.map(|tau| self.section(segment, middle + half * tau));
        let across = [0, 1].map(|i| {
            interpolate(&sections.each_ref().map(|s| s.axes[i] * (1.0 / self.radius.divisor(s.radius))))
        });
        // From the middle and not as a difference of places, which far from the origin are rounded to more than a tolerance.
        let from_middle = NODES.map(|tau| along(&position, tau));
        let offset = [0, 1].map(|i| {
            interpolate(&std::array::from_fn(|node| {
                let section: &Section = &sections[node];
                from_middle[node].dot(section.axes[i]) / self.radius.divisor(section.radius)
            }))
        });
        Span {
            core,
            fit,
            middle,
            half,
            position,
            across,
            offset,
            arc: interpolate(&sections.each_ref().map(|s| s.arc - arc_middle)),
            arc_middle,
            radius: interpolate(&sections.each_ref().map(|s| s.radius)),
            gain: (self.conserved.is_some() || self.radius.is_widened())
                .then(|| interpolate(&sections.each_ref().map(|s| s.gain))),
        }
    }

    /// Whether the polynomials reproduce four points of the tube's surface, and the arc length, between the nodes.
    fn holds(&self, segment: usize, span: &Span) -> bool {
        // The interpolation error's extrema lie at the ends and near the middles between nodes.
        const PLACES: [f64; 7] = [-1.0, -0.86, -0.5, 0.0, 0.5, 0.86, 1.0];
        let length =
            self.curve.arc_length(segment, span.fit[1]) - self.curve.arc_length(segment, span.fit[0]);
        PLACES.iter().all(|&tau| {
            // One-sided at the ends, where the radius may jump.
            let tau_inside = tau * (1.0 - 1e-9);
            let s = self.section(segment, span.middle + span.half * tau_inside);
            let arc = evaluate(&span.arc, tau_inside) + span.arc_middle;
            let arc_error = (arc - s.arc).abs() / (s.radius + length);
            let corners = [[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]];
            let across_error = corners.iter().fold(0.0_f64, |worst, &uv| {
                let p =
                    along(&span.position, tau_inside) + (s.axes[0] * uv[0] + s.axes[1] * uv[1]) * s.radius;
                let found = [0, 1].map(|i| {
                    p.dot(evaluate(&span.across[i], tau_inside)) - evaluate(&span.offset[i], tau_inside)
                });
                worst.max((found[0] - uv[0]).abs()).max((found[1] - uv[1]).abs())
            });
            let gain_error = span.gain.map_or(0.0, |gain| {
                // Widening thins the density out, to nothing where the tube's own radius is 0.
                let scale = if self.conserved.is_some() { s.gain } else { 1.0 };
                (evaluate(&gain, tau_inside) - s.gain).abs() / scale
            });
            arc_error < TOLERANCE && across_error < TOLERANCE && gain_error < TOLERANCE
        })
    }
}
