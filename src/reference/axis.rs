//! A tube's axis: arc length, frames and feet of a chain of Bezier segments.

use super::piece::Piece;
use super::quadrature::Rule;
use super::transport::{self, Frame};
use crate::curve::FrameRule;
use nalgebra::Vector3;
use std::f64::consts::{PI, TAU};

/// Two tangents closer than this, in radians, make no corner: data that is smooth but for rounding stays
/// below it.
const SMOOTH: f64 = 1e-9;

/// Panels are not cut below this width in x.
const THINNEST: f64 = 1e-14;

/// The axis of a tube with everything that does not depend on the point asked for.
#[derive(Debug, Clone)]
pub(super) struct Axis {
    quadrature: Rule,
    stretches: Vec<Stretch>,
    /// A ball around each stretch: middle and radius.
    balls: Vec<(Vector3<f64>, f64)>,
    length: f64,
    closed: bool,
    /// Radians per metre by which the frame is turned about the tangent, so that a lap ends as it began.
    unwind: f64,
}

/// A piece laid along the axis.
#[derive(Debug, Clone)]
struct Stretch {
    piece: Piece,
    panels: Vec<Panel>,
    /// Arc length at x = 0, metres.
    arc: f64,
    /// Unit axis about which the tangent turns from the stretch before to this one.
    hinge: Vector3<f64>,
    /// Frames along the curve where it enters and leaves the piece.
    entry: Frame,
    exit: Frame,
}

/// A part of a piece over which one step of quadrature and of the frame's equation is enough.
#[derive(Debug, Clone, Copy)]
struct Panel {
    x: f64,
    end: f64,
    /// Arc length from x = 0 of the piece to the panel's start.
    arc: f64,
    /// Arc length of the panel.
    length: f64,
    /// The transported normal at the panel's start.
    normal: Vector3<f64>,
}

/// Where a point's distance to the axis has a local minimum.
#[derive(Debug, Clone, Copy)]
pub(super) struct Place {
    pub(super) segment: usize,
    pub(super) t: f64,
    /// Arc length from the start of the curve, metres.
    pub(super) arc: f64,
    pub(super) frame: Frame,
    /// From the axis to the point, at a corner turned into the plane normal to the frame's tangent.
    pub(super) arm: Vector3<f64>,
    /// `1 - kappa rho cos`.
    pub(super) focal: f64,
    /// Whether the point lies beyond an end of the curve.
    pub(super) beyond: bool,
}

impl Axis {
    /// The axis of the chain of segments with these power coefficients, at least one of them not a single
    /// point; `closed` where it goes on from the last to the first.
    pub(super) fn new(segments: &[[Vector3<f64>; 4]], rule: FrameRule, closed: bool) -> Axis {
        let axis = Axis::laid(segments, rule, closed, None);
        if !closed {
            return axis;
        }
        let frenet = axis.stretches.iter().any(|stretch| stretch.piece.principal(0.5).is_some());
        if rule == FrameRule::RotationMinimising || !frenet {
            return axis.unwound(rule);
        }
        // Round once more from the frame that arrives, which some curved part has determined.
        let arriving = axis.arriving().0;
        Axis::laid(segments, rule, closed, Some(arriving)).unwound(rule)
    }

    /// The axis whose first frame is `start`, or where there is a principal normal has that.
    fn laid(segments: &[[Vector3<f64>; 4]], rule: FrameRule, closed: bool, start: Option<Frame>) -> Axis {
        let mut axis = Axis {
            quadrature: Rule::new(16),
            stretches: Vec::new(),
            balls: Vec::new(),
            length: 0.0,
            closed,
            unwind: 0.0,
        };
        for (number, c) in segments.iter().enumerate() {
            for piece in Piece::cut(number, c, rule == FrameRule::Frenet) {
                axis.lay(piece, start);
            }
        }
        axis
    }

    /// The frame that arrives at the start after a lap, and the axis about which the tangent turns there.
    fn arriving(&self) -> (Frame, Vector3<f64>) {
        let (last, first) = (&self.stretches[self.stretches.len() - 1], &self.stretches[0]);
        let tangent = first.entry.tangent;
        let hinge = hinge(last, &first.piece, &tangent);
        (last.exit.turned(&hinge, tangent), hinge)
    }

    /// Closes the joint from the last stretch to the first; with a frame that turns least, turns that back over the
    /// length by as much as it has turned after a lap.
    fn unwound(mut self, rule: FrameRule) -> Axis {
        let (arriving, hinge) = self.arriving();
        let entry = self.stretches[0].entry;
        self.stretches[0].hinge = hinge;
        if rule == FrameRule::RotationMinimising {
            let turned = entry.normal.cross(&arriving.normal).dot(&entry.tangent);
            let angle = libm::atan2(turned, entry.normal.dot(&arriving.normal));
            // Half a turn has two signs, of which rounding must not choose.
            let angle = if angle < 1e-9 - PI { angle + TAU } else { angle };
            self.unwind = -angle / self.length;
            for i in 0..self.stretches.len() {
                let [enter, leave] = [false, true].map(|leaves| {
                    let piece = &self.stretches[i].piece;
                    let x = if leaves { piece.exit() } else { 1.0 - piece.exit() };
                    self.frame(&self.stretches[i], x).1
                });
                (self.stretches[i].entry, self.stretches[i].exit) = (enter, leave);
            }
        }
        self
    }

    /// Arc length of the whole curve, metres.
    pub(super) fn length(&self) -> f64 {
        self.length
    }

    /// Arc length and frame at t of a segment.
    #[cfg(test)]
    pub(super) fn at(&self, segment: usize, t: f64) -> (f64, Frame) {
        let inside = |stretch: &&Stretch| {
            let x = (t - stretch.piece.t(0.0)) / (stretch.piece.t(1.0) - stretch.piece.t(0.0));
            stretch.piece.segment == segment && (0.0..=1.0).contains(&x)
        };
        let stretch = self.stretches.iter().find(inside).expect("a t in [0, 1]");
        let piece = &stretch.piece;
        self.frame(stretch, (t - piece.t(0.0)) / (piece.t(1.0) - piece.t(0.0)))
    }

    fn lay(&mut self, piece: Piece, start: Option<Frame>) {
        let mut panels = Vec::new();
        self.cut(&piece, 0.0, 1.0, &mut panels);
        let (first, last) = (1.0 - piece.exit(), piece.exit());
        let tangent = piece.tangent_along(first);
        let (hinge, mut entry) = match self.stretches.last() {
            Some(before) => {
                let hinge = hinge(before, &piece, &tangent);
                (hinge, before.exit.turned(&hinge, tangent))
            }
            None => (Vector3::zeros(), start.unwrap_or_else(|| Frame::at_start(tangent))),
        };
        if let Some(normal) = piece.principal(first) {
            entry = Frame::new(tangent, normal);
        }
        let length: f64 = panels.iter().map(|panel| panel.length).sum();
        carry(&piece, &mut panels, entry.normal);
        let mut stretch = Stretch {
            arc: if piece.reversed() { self.length + length } else { self.length },
            hinge,
            entry,
            exit: entry,
            piece,
            panels,
        };
        stretch.exit = self.frame(&stretch, last).1;
        self.length += length;
        self.balls.push(ball(&stretch.piece));
        self.stretches.push(stretch);
    }

    /// Appends panels from `a` to `b`.
    fn cut(&self, piece: &Piece, a: f64, b: f64, panels: &mut Vec<Panel>) {
        let middle = 0.5 * (a + b);
        let [start, local, end] = [a, middle, b].map(|x| piece.local(x));
        let arc = |a, b| self.quadrature.integrate(a, b, |x| piece.local(x).speed);
        let length = arc(a, middle) + arc(middle, b);
        let across = transport::any_across(&start.tangent);
        let transports = [across, start.tangent.cross(&across)].iter().all(|&normal| {
            let half = transport::step(piece, a, middle, normal);
            (transport::step(piece, a, b, normal) - transport::step(piece, middle, b, half)).norm() <= 1e-13
        });
        let agrees = (arc(a, b) - length).abs() <= 1e-15 * piece.top_speed();
        let bent = start.tangent.dot(&local.tangent) < 0.7 || end.tangent.dot(&local.tangent) < 0.7;
        if (agrees && transports && !bent) || b - a < THINNEST {
            panels.push(Panel { x: a, end: b, arc: 0.0, length, normal: across });
        } else {
            self.cut(piece, a, middle, panels);
            self.cut(piece, middle, b, panels);
        }
    }

    /// Point and frame at an arc length from the start of the curve, metres.
    pub(super) fn section(&self, arc: f64) -> (Vector3<f64>, Frame) {
        let starts = |stretch: &&Stretch| self.arc(stretch, 1.0 - stretch.piece.exit()) <= arc;
        let after = self.stretches.iter().skip(1).take_while(starts);
        let stretch = &self.stretches[after.count()];
        let rising = !stretch.piece.reversed();
        let (mut low, mut high) = (0.0, 1.0);
        for _ in 0..60 {
            let middle = 0.5 * (low + high);
            if (self.arc(stretch, middle) < arc) == rising {
                low = middle;
            } else {
                high = middle;
            }
        }
        let x = 0.5 * (low + high);
        (stretch.piece.point(x), self.frame(stretch, x).1)
    }

    /// Arc length at x, from the start of the curve.
    fn arc(&self, stretch: &Stretch, x: f64) -> f64 {
        let piece = &stretch.piece;
        let panel = &stretch.panels[stretch.panels.partition_point(|panel| panel.x <= x).max(1) - 1];
        let length = panel.arc + self.quadrature.integrate(panel.x, x, |x| piece.local(x).speed);
        if piece.reversed() { stretch.arc - length } else { stretch.arc + length }
    }

    /// Arc length and frame at x.
    fn frame(&self, stretch: &Stretch, x: f64) -> (f64, Frame) {
        let piece = &stretch.piece;
        let panel = &stretch.panels[stretch.panels.partition_point(|panel| panel.x <= x).max(1) - 1];
        let arc = self.arc(stretch, x);
        let normal = piece.principal(x).unwrap_or_else(|| transport::step(piece, panel.x, x, panel.normal));
        let frame = Frame::new(piece.tangent_along(x), normal);
        let back = self.unwind * arc;
        (arc, Frame::new(frame.tangent, libm::cos(back) * frame.normal + libm::sin(back) * frame.binormal))
    }

    /// Every place where the distance from p has a local minimum; beyond the ends of the curve only with
    /// `round`.
    ///
    /// With `reach` given, those farther than it from p may be left out. A place on a joint may come twice.
    pub(super) fn places(&self, p: &Vector3<f64>, reach: Option<f64>, round: bool) -> Vec<Place> {
        let mut places = Vec::new();
        for (i, (middle, radius)) in self.balls.iter().enumerate() {
            if reach.is_some_and(|reach| (middle - p).norm() > radius + reach) {
                continue;
            }
            let stretch = &self.stretches[i];
            places.extend(stretch.piece.feet(p).into_iter().map(|x| self.place(stretch, x, p)));
            let wrap = if self.closed { self.stretches.first() } else { None };
            if let Some(after) = self.stretches.get(i + 1).or(wrap) {
                self.join(stretch, after, p, &mut places);
            }
        }
        if let (true, Some(first), Some(last)) =
            (round && !self.closed, self.stretches.first(), self.stretches.last())
        {
            let arm = p - first.piece.point(1.0 - first.piece.exit());
            if arm.dot(&first.entry.tangent) < rounding(p, &arm) {
                places.push(first.end(false, 0.0, arm, true));
            }
            let arm = p - last.piece.point(last.piece.exit());
            if arm.dot(&last.exit.tangent) > -rounding(p, &arm) {
                places.push(last.end(true, self.length, arm, true));
            }
        }
        places
    }

    /// Adds the places on the joint of two stretches, for a point that lies beyond the first and before the
    /// second.
    fn join(&self, before: &Stretch, after: &Stretch, p: &Vector3<f64>, places: &mut Vec<Place>) {
        let arm = p - before.piece.point(before.piece.exit());
        let (t1, t2) = (before.exit.tangent, after.entry.tangent);
        let rounding = rounding(p, &arm);
        if arm.dot(&t1) < -rounding || arm.dot(&t2) > rounding {
            return;
        }
        if t1.cross(&t2).norm() <= SMOOTH && t1.dot(&t2) > 0.0 {
            places.push(self.place(before, before.piece.exit(), p));
            places.push(self.place(after, 1.0 - after.piece.exit(), p));
            return;
        }
        // Turning about the hinge keeps the part along it and the length of the part across it.
        let along = arm.dot(&after.hinge) * after.hinge;
        let turned = along + t1.cross(&after.hinge) * (arm - along).norm();
        let arc = self.frame(before, before.piece.exit()).0;
        places.push(before.end(true, arc, turned, false));
    }

    fn place(&self, stretch: &Stretch, x: f64, p: &Vector3<f64>) -> Place {
        let (arc, frame) = self.frame(stretch, x);
        let piece = &stretch.piece;
        let (local, arm) = (piece.local(x), p - piece.point(x));
        // kappa times its normal is dT/ds; at the start after a cusp, where the speed is 0, its product is 0
        // or infinite.
        let bend = local.turn.dot(&arm);
        let focal = if bend == 0.0 { 1.0 } else { 1.0 - bend / local.speed };
        Place { segment: piece.segment, t: piece.t(x), arc, frame, arm, focal, beyond: false }
    }
}

impl Stretch {
    /// The place where the curve enters or leaves the stretch.
    fn end(&self, leaves: bool, arc: f64, arm: Vector3<f64>, beyond: bool) -> Place {
        let piece = &self.piece;
        let (x, frame) = if leaves { (piece.exit(), self.exit) } else { (1.0 - piece.exit(), self.entry) };
        Place { segment: piece.segment, t: piece.t(x), arc, frame, arm, focal: 1.0, beyond }
    }
}

/// What rounding may make of a point's distance from a plane. Planes of ends and joints count to both sides by this much: a
/// point on one must not fall between.
fn rounding(p: &Vector3<f64>, arm: &Vector3<f64>) -> f64 {
    1e-14 * (p.norm() + arm.norm())
}

/// Sets arc length and normal at the start of every panel, from the normal where the curve enters the piece.
fn carry(piece: &Piece, panels: &mut [Panel], mut normal: Vector3<f64>) {
    let mut arc = 0.0;
    for panel in panels.iter_mut() {
        panel.arc = arc;
        arc += panel.length;
    }
    if piece.reversed() {
        for panel in panels.iter_mut().rev() {
            normal = transport::step(piece, panel.end, panel.x, normal);
            panel.normal = normal;
        }
    } else {
        for panel in panels {
            panel.normal = normal;
            normal = transport::step(piece, panel.x, panel.end, normal);
        }
    }
}

/// The unit axis about which the tangent turns to `tangent`, with which `piece` begins.
///
/// Where the curve turns back on itself: at a cusp the normal of the plane it lies in there, to the side of T1 x T2 just
/// beside it, else the frame's normal.
fn hinge(before: &Stretch, piece: &Piece, tangent: &Vector3<f64>) -> Vector3<f64> {
    let axis = before.exit.tangent.cross(tangent);
    let sin = axis.norm();
    if sin > SMOOTH || (sin > 0.0 && before.exit.tangent.dot(tangent) > 0.0) {
        axis / sin
    } else if before.piece.segment == piece.segment && !piece.straight() {
        -piece.plane_normal()
    } else {
        before.exit.normal
    }
}

/// Middle and radius of a ball that holds the piece.
fn ball(piece: &Piece) -> (Vector3<f64>, f64) {
    let steps = 64;
    let middle = piece.point(0.5);
    let sampled = (0..=steps)
        .map(|i| (piece.point(f64::from(i) / f64::from(steps)) - middle).norm())
        .fold(0.0, f64::max);
    // No point is farther than half a step from a sample; a whole one leaves room for rounding.
    (middle, sampled + piece.top_speed() / f64::from(steps))
}
