//! One tube, compiled: spans along its axis, its ends and corners, its envelope and layers.

use std::f64::consts::TAU;
use std::sync::Arc;

use glam::DVec3;
use rayon::prelude::*;

use super::pattern::Perlin;
use super::radius::Radius;
use super::span::{Axis, Section, Span};
use crate::curve::Curve;
use crate::scene::{self, Caps, Conserve, Op, Overlap, Pattern, Radial, Space};

/// A corner turns by more than this many radians; below it the wedge outside of it is thinner than single precision.
pub(crate) const CORNER: f64 = 1e-7;
/// As many segments are worth several threads.
const MANY: usize = 256;
/// Where the tangents of a cusp are taken, in t.
const ASIDE: f64 = 1e-6;

#[derive(Debug, Clone)]
pub(crate) struct Tube {
    pub(crate) name: String,
    pub(crate) curve: Curve,
    pub(crate) radius: Radius,
    /// Whether spans are fitted as far as they hold.
    pub(crate) is_long: bool,
    /// Spans of each segment; copies share them.
    pub(crate) spans: Arc<[Box<[Span]>]>,
    /// The ends and corners where feet gather: `None` where there are none.
    pub(crate) points: Vec<Point>,
    pub(crate) caps: Caps,
    pub(crate) radial: Radial,
    pub(crate) conserve: Conserve,
    /// Where density is conserved: the square of the radius at which it is as at rest.
    conserved: Option<f64>,
    pub(crate) overlap: Overlap,
    pub(crate) layers: Vec<Layer>,
    pub(crate) stretch: bool,
    /// Turns at the start, within half a turn of 0, and per metre; `None` where nothing turns or no layer would show it.
    pub(crate) turns: Option<[f64; 2]>,
    /// Radians of twist per metre.
    pub(crate) twist_rate: f64,
    /// Keys that densities do not read, and whether they are given.
    pub(crate) unused: [(&'static str, bool); 2],
}

/// A place where all points of a half ball or of a wedge have their foot.
#[derive(Debug, Clone)]
pub(crate) struct Point {
    pub(crate) section: Section,
    pub(crate) kind: PointKind,
}

#[derive(Debug, Clone, Copy)]
pub(crate) enum PointKind {
    /// The half ball on the side that this unit vector points to.
    End(DVec3),
    /// The wedge beyond the plane of the first tangent, which is the section's, and before that of this second.
    Corner(DVec3),
}

#[derive(Debug, Clone)]
pub(crate) struct Layer {
    pub(crate) op: Op,
    pub(crate) kind: LayerKind,
    pub(crate) threshold: Option<f64>,
    pub(crate) multiplier: f64,
}

#[derive(Debug, Clone)]
pub(crate) enum LayerKind {
    Constant(f64),
    Sectors,
    Perlin(Box<Perlin>),
}

impl Tube {
    /// Where octaves fade that voxels do not resolve, no noise is fine beside a block: spans may then be as long as they hold.
    pub(crate) fn compile(tube: &scene::Tube, octave_fade: bool) -> Tube {
        let turns = [tube.turned - (tube.turned + 0.5).floor(), tube.twist / tube.curve.length()];
        let is_turned = turns != [0.0; 2] && tube.layers.iter().any(|layer| !is_round(&layer.pattern));
        let around = tube.curve.is_closed().then(|| if tube.stretch { 1.0 } else { tube.curve.length() });
        let lengthened = if tube.stretch { tube.rest.length / tube.curve.length() } else { 1.0 };
        let mut tube = Tube {
            name: tube.name.clone(),
            curve: tube.curve.clone(),
            radius: Radius::new(&tube.radius),
            is_long: octave_fade,
            spans: Arc::new([]),
            points: Vec::new(),
            caps: tube.caps,
            radial: tube.radial,
            conserve: tube.conserve,
            conserved: (tube.conserve != Conserve::Off)
                .then_some(tube.rest.radius * tube.rest.radius * lengthened),
            overlap: tube.overlap,
            layers: tube.layers.iter().map(|layer| compile_layer(layer, around)).collect(),
            stretch: tube.stretch,
            turns: is_turned.then_some(turns),
            twist_rate: TAU * turns[1],
            unused: [("color", tube.color.is_some()), ("temperature", tube.temperature.is_some())],
        };
        tube.lay();
        tube
    }

    /// Widens what is too thin for voxels of edge `h`.
    pub(crate) fn widen(&mut self, h: f64) {
        if self.radius.widen(h) {
            self.lay();
        }
    }

    /// Lays spans and points along the curve.
    fn lay(&mut self) {
        let axis = Axis {
            curve: &self.curve,
            radius: &self.radius,
            conserved: self.conserved,
            is_long: self.is_long,
        };
        let breaks = breaks(&self.curve, &self.radius);
        // What was laid before is not held beside it.
        self.spans = Arc::new([]);
        let segments = self.curve.segments().len();
        let spans = |i: usize| axis.spans(i, &breaks[i]).into_boxed_slice();
        self.spans = if segments < MANY {
            (0..segments).map(spans).collect()
        } else {
            (0..segments).into_par_iter().map(spans).collect()
        };
        self.points = points(&axis, self.caps);
    }

    /// About how many bytes the spans of a scene's tube take: those of some segments, taken for all.
    pub(super) fn estimate_memory(tube: &scene::Tube) -> usize {
        const SAMPLE: usize = 256;
        let (curve, radius) = (&tube.curve, Radius::new(&tube.radius));
        let axis = Axis { curve, radius: &radius, conserved: None, is_long: false };
        let breaks = breaks(curve, &radius);
        let segments = curve.segments().len();
        let step = segments.div_ceil(SAMPLE);
        let tried = (0..segments).step_by(step);
        let count = tried.clone().count();
        let spans: usize = tried.map(|i| axis.spans(i, &breaks[i]).len()).sum();
        segments * (size_of::<Box<[Span]>>() + spans * size_of::<Span>() / count.max(1))
    }

    /// Change of the cylinder's height per metre of arc.
    pub(crate) fn height_rate(&self) -> f64 {
        if self.stretch { 1.0 / self.curve.length() } else { 1.0 }
    }
}

/// Whether the pattern looks the same from all sides of the axis.
fn is_round(pattern: &Pattern) -> bool {
    match pattern {
        Pattern::Constant(_) => true,
        Pattern::Sectors => false,
        Pattern::Perlin(fbm) => fbm.octaves == 0 || fbm.space == Space::World,
    }
}

/// Per segment, the t where the radius is not smooth or the frame jumps, in order.
fn breaks(curve: &Curve, radius: &Radius) -> Vec<Vec<f64>> {
    let mut breaks = vec![Vec::new(); curve.segments().len()];
    for &x in radius.knots() {
        let (segment, t) = curve.locate(x * curve.length());
        if t > 0.0 && t < 1.0 {
            breaks[segment].push(t);
        }
    }
    for (segment, breaks) in breaks.iter_mut().enumerate() {
        breaks.extend_from_slice(curve.breaks(segment));
        breaks.sort_by(f64::total_cmp);
    }
    breaks
}

fn points(axis: &Axis, caps: Caps) -> Vec<Point> {
    let last = axis.curve.segments().len() - 1;
    let mut points = Vec::new();
    if caps == Caps::Round {
        for (segment, t, side) in [(0, 0.0, -1.0), (last, 1.0, 1.0)] {
            let section = axis.section(segment, t);
            let outward = section.tangent * side;
            points.push(Point { section, kind: PointKind::End(outward) });
        }
    }
    for joint in 0..=last {
        if let Some(after) = axis.curve.after(joint)
            && axis.curve.turn(joint) > CORNER
        {
            let section = axis.section(joint, 1.0);
            let next = axis.section(after, 0.0).tangent;
            points.push(Point { section, kind: PointKind::Corner(next) });
        }
    }
    for segment in 0..=last {
        for &t in axis.curve.breaks(segment) {
            // Cusps and folds; elsewhere the frame breaks and the tangent does not.
            let (mut section, next) =
                (axis.section(segment, t - ASIDE), axis.section(segment, t + ASIDE).tangent);
            if section.tangent.dot(next) < 0.0 {
                // C' = (t - cusp) C'' there: the limit of the tangent, free of what the axis bends in between.
                let bend = axis.curve.segments()[segment].d2(t);
                section.tangent = (-bend).normalize_or(section.tangent);
                section.axes[0] = section.axes[0].reject_from_normalized(section.tangent).normalize();
                section.axes[1] = section.tangent.cross(section.axes[0]);
                points.push(Point { section, kind: PointKind::Corner(next) });
            }
        }
    }
    points.retain(|point| !axis.radius.vanishes_at(point.section.arc / axis.curve.length()));
    points
}

fn compile_layer(layer: &scene::Layer, around: Option<f64>) -> Layer {
    let kind = match &layer.pattern {
        Pattern::Constant(value) => LayerKind::Constant(*value),
        Pattern::Sectors => LayerKind::Sectors,
        Pattern::Perlin(fbm) => LayerKind::Perlin(Box::new(Perlin::compile(fbm, around, layer.threshold))),
    };
    Layer { op: layer.op, kind, threshold: layer.threshold, multiplier: layer.multiplier }
}
