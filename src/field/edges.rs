//! Where the density has edges, which the voxels' centres alone cannot show: found block by block, in double precision.

use std::f64::consts::TAU;

use glam::DVec3;

use super::cover::{Capsule, Reach, support};
use super::region::{Layer, LayerKind, Region};
use super::tube::{self, Tube};
use super::{Extent, Field, Lattice};
use crate::curve::FrameRule;
use crate::num::Scalar;
use crate::scene::{Antialias, Caps, Op, Overlap, Radial};

/// What goes from full density to none by a smoothstep is an edge if it is narrower than this, in voxels: its slope, 3/2
/// over its width, is then more than three quarters of the full density a voxel.
const NARROW: f64 = 2.0;
/// A radius that changes by more than this part of itself at one place is an edge.
const STEP: f64 = 0.05;
/// As is one that changes by more than this part of itself within a voxel.
const FLARE: f64 = 0.5;
/// Both sides of a jump are this near to it, as a fraction of the curve's length.
const BESIDE: f64 = 1e-9;
/// Tubes thinner than this, in voxels, may pass through a cell between its corners and its centre.
const THIN: f64 = 0.9;

/// The edges of one capsule's part of a tube.
#[derive(Debug)]
pub(crate) struct Edges<'a> {
    reach: Reach,
    half_edge: f64,
    /// There may be one in every block that the capsule reaches.
    everywhere: bool,
    /// Around the axis, there is none nearer to it than this, in metres; `None` where there is none at all.
    inner: Option<f64>,
    /// Points of planes across the axis, and their normals.
    planes: Vec<[DVec3; 2]>,
    /// The axes of the cross-section in the middle of the capsule, where sectors meet along them.
    sectors: Option<[DVec3; 2]>,
    /// Largest radius in metres.
    radius: f64,
    /// Radians by which those axes turn at most from the middle to the ends.
    turn: f64,
    capsule: &'a Capsule,
}

impl Field {
    /// Whether edges matter: else all voxels store the density at their centres.
    pub(crate) fn is_antialiased(&self) -> bool {
        self.antialias == Antialias::Adaptive
    }

    /// The edges of a capsule, if it has any.
    pub(crate) fn edges<'a>(&'a self, capsule: &'a Capsule, lattice: Lattice) -> Option<Edges<'a>> {
        let tube = &self.tubes[capsule.tube as usize];
        let h = lattice.voxel_size;
        let half_edge = Extent::Whole.half_edge() * h;
        let has_sectors = shows_sectors(tube);
        if capsule.is_point {
            let section = &tube.points[capsule.part as usize].section;
            let inner = inner(tube, section.radius, h);
            return (has_sectors || inner.is_some()).then(|| Edges {
                reach: Reach::still(section.centre),
                half_edge,
                everywhere: has_sectors,
                inner,
                planes: vec![],
                sectors: None,
                radius: section.radius,
                turn: 0.0,
                capsule,
            });
        }
        let segment_index = capsule.part as usize;
        let segment = &tube.curve.segments()[segment_index];
        let reach = Reach::new(segment, capsule.t);
        let length = tube.curve.length();
        let arc = capsule.t.map(|t| tube.curve.arc_length(segment_index, t));
        let x = arc.map(|s| s / length);
        let radii = tube.radius.range(x);
        let mut edges = Edges {
            reach,
            half_edge,
            everywhere: is_fade(tube, h, arc) || flares(tube, h, arc),
            inner: inner(tube, radii[0], h),
            planes: vec![],
            sectors: None,
            radius: radii[1],
            turn: 0.0,
            capsule,
        };
        let is_cut = tube.caps == Caps::Flat && !tube.curve.is_closed();
        let ends = [
            is_cut && segment_index == 0 && capsule.t[0] <= 0.0,
            is_cut && segment_index + 1 == tube.curve.segments().len() && capsule.t[1] >= 1.0,
        ];
        for side in [0, 1] {
            if ends[side] || steps(tube, x[side]) {
                let t = capsule.t[side];
                edges.planes.push([segment.at(t), segment.tangent(t)]);
            }
        }
        if has_sectors {
            match bend(&reach).filter(|_| tube.curve.rule() == FrameRule::RotationMinimising) {
                Some([_, turn]) => {
                    let middle = 0.5 * (capsule.t[0] + capsule.t[1]);
                    edges.sectors = Some(sectors(tube, segment_index, middle));
                    let s = tube.curve.arc_length(segment_index, middle);
                    let away = (s - arc[0]).max(arc[1] - s);
                    let twist = away * tube.twist_rate;
                    let holonomy = away / length * tube.curve.holonomy();
                    edges.turn = turn + twist.abs() + holonomy.abs();
                }
                None => edges.everywhere = true,
            }
        }
        let any =
            edges.everywhere || edges.inner.is_some() || !edges.planes.is_empty() || edges.sectors.is_some();
        any.then_some(edges)
    }
}

impl Edges<'_> {
    /// Whether one may pass through the block centred at `o`, which the capsule reaches.
    pub(crate) fn may_cross(&self, o: DVec3) -> bool {
        self.everywhere || self.surface(o) || self.plane(o) || self.sectors(o)
    }

    /// The tube's surface, or where its soft edge begins.
    fn surface(&self, o: DVec3) -> bool {
        self.inner.is_some_and(|inner| self.farthest(o).is_none_or(|far| far >= inner * (1.0 - 1e-9)))
    }

    /// Bound of the distance from places of the block to their feet in the capsule; `None` where the axis bends too much
    /// to tell.
    ///
    /// The largest distance from a line is found at a corner of the block. A place's arm to its foot stands on the tangent
    /// there, and so is longer than its part across the middle's tangent by no more than the tangents' angle allows.
    fn farthest(&self, o: DVec3) -> Option<f64> {
        let to_block = o - self.reach.centre;
        let along = if self.capsule.is_point { DVec3::ZERO } else { self.reach.d1.normalize_or_zero() };
        let mut most = 0.0_f64;
        for corner in 0..8 {
            let side = |bit: u32| if corner >> bit & 1 == 0 { -self.half_edge } else { self.half_edge };
            let arm = to_block + DVec3::new(side(0), side(1), side(2));
            most = most.max((arm - along * arm.dot(along)).length());
        }
        if self.capsule.is_point {
            return Some(most);
        }
        let [angle, _] = bend(&self.reach)?;
        Some((most + self.sagitta()) / libm::cos(angle))
    }

    /// How far the axis may be from its tangent in the middle.
    fn sagitta(&self) -> f64 {
        0.5 * self.reach.half * self.reach.half * self.reach.bend
    }

    fn plane(&self, o: DVec3) -> bool {
        self.planes.iter().any(|[point, normal]| {
            (o - point).dot(*normal).abs() <= self.half_edge * support(*normal) * (1.0 + 1e-9)
        })
    }

    /// The planes between sectors, which hold the axis and one of the cross-section's axes.
    ///
    /// With the axes as in the middle, and the foot there, a coordinate is linear over the block; from there to a place's own
    /// foot it changes by no more than the axis is off its tangent and the axes turn.
    fn sectors(&self, o: DVec3) -> bool {
        let Some(axes) = self.sectors else { return false };
        let slack = self.sagitta() + self.turn * self.radius * (1.0 + 1e-9);
        axes.iter()
            .any(|axis| (o - self.reach.centre).dot(*axis).abs() <= self.half_edge * support(*axis) + slack)
    }
}

/// Bounds of the angle between the tangent in the middle and elsewhere, and of all that it turns on the way; `None` where
/// they are large.
fn bend(reach: &Reach) -> Option<[f64; 2]> {
    let sine = reach.half * reach.bend / reach.d1.length();
    (sine < 0.7).then(|| [libm::asin(sine), sine / (1.0 - sine)])
}

/// The axes of the cross-section at a place, twisted.
fn sectors(tube: &Tube, segment: usize, t: f64) -> [DVec3; 2] {
    let frame = tube.curve.frame(segment, t);
    let [start, rate] = tube.turns.unwrap_or([0.0; 2]);
    let turns = start + rate * tube.curve.arc_length(segment, t);
    let (sin, cos) = libm::sincos(TAU * (turns - turns.floor()));
    [frame.normal * cos + frame.binormal * sin, frame.binormal * cos - frame.normal * sin]
}

/// Of a tube whose least radius is this: the distance to the axis from where on the envelope may fall steeply.
fn inner(tube: &Tube, least: f64, h: f64) -> Option<f64> {
    match tube.radial {
        Radial::Smooth | Radial::Linear => None,
        Radial::Hard => Some(least),
        Radial::Edge(width) => (width * least < NARROW * h).then_some((1.0 - width) * least),
    }
}

fn shows_sectors(tube: &Tube) -> bool {
    tube.layers.iter().any(|layer| matches!(layer.kind, tube::LayerKind::Sectors) && layer.multiplier != 0.0)
}

/// Whether a steep fade at an end of the tube overlaps these arc lengths.
fn is_fade(tube: &Tube, h: f64, arc: [f64; 2]) -> bool {
    let Caps::Fade(fraction) = tube.caps else { return false };
    let (length, width) = (tube.curve.length(), fraction * tube.curve.length());
    !tube.curve.is_closed() && width < NARROW * h && (arc[0] <= width || arc[1] >= length - width)
}

/// Whether the radius changes fast somewhere about these arc lengths.
fn flares(tube: &Tube, h: f64, arc: [f64; 2]) -> bool {
    if tube.radius.is_constant() {
        return false;
    }
    let length = tube.curve.length();
    // Capsules are about ten voxels long, unless voxels are too small to be told apart; much shorter where the radius is
    // steep, so that windows a voxel wide, half a voxel apart, reach past their ends.
    let count = (2.0 * (arc[1] - arc[0]) / h).ceil().clamp(1.0, 64.0);
    let mut number = 0.0;
    while number <= count {
        let middle = arc[0] + (arc[1] - arc[0]) * (number / count);
        let ends = [middle - 0.5 * h, middle + 0.5 * h].map(|s| (s / length).clamp(0.0, 1.0));
        let [least, most] = tube.radius.range(ends);
        if most - least > FLARE * most {
            return true;
        }
        number += 1.0;
    }
    false
}

/// Whether the radius jumps at the fraction x of the length.
fn steps(tube: &Tube, x: f64) -> bool {
    if tube.radius.is_constant() {
        return false;
    }
    let near = if tube.curve.is_closed() && (x <= BESIDE || x >= 1.0 - BESIDE) {
        let [a, b] = [tube.radius.at(0.0), tube.radius.at(1.0)];
        [a.min(b), a.max(b)]
    } else {
        tube.radius.range([(x - BESIDE).max(0.0), (x + BESIDE).min(1.0)])
    };
    near[1] - near[0] > STEP * near[1]
}

impl<T: Scalar> Region<T> {
    /// Makes `outline` the same region with a density that shows nothing but edges: noise is left out, and everything is
    /// joined by sum, so that nothing hides behind anything else. Where all layers are factors so are sectors; else they
    /// are added to 1, whatever the scene does with them.
    pub(crate) fn outline(&self, outline: &mut Region<T>) {
        outline.tubes.clone_from(&self.tubes);
        outline.pieces.clone_from(&self.pieces);
        outline.join = self.join;
        outline.layers.clear();
        outline.octaves.clear();
        for piece in &mut outline.pieces {
            let first = outline.layers.len();
            let layers = &self.layers[piece.layers[0]..piece.layers[1]];
            let are_factors = layers.iter().all(|layer| layer.op == Op::Multiply);
            for layer in layers.iter().filter(|layer| matches!(layer.kind, LayerKind::Sectors)) {
                outline.layers.push(if are_factors {
                    layer.clone()
                } else {
                    let multiplier = T::from_f64(1.0);
                    Layer { op: Op::Add, threshold: None, multiplier, ..layer.clone() }
                });
            }
            piece.layers = [first, outline.layers.len()];
            piece.fades = false;
            piece.in_world = false;
            if piece.layers[0] == piece.layers[1] {
                piece.twist = None;
            }
        }
        if outline.join.is_some() || outline.tubes.len() > 1 {
            outline.join = Some(Overlap::Sum);
            for tube in &mut outline.tubes {
                tube.overlap = Overlap::Sum;
            }
        }
    }

    /// Whether a tube may be too thin to be seen at the corners of cells.
    pub(crate) fn is_thin(&self) -> bool {
        self.pieces.iter().any(|piece| {
            let swing: f64 = piece.radius[1..].iter().map(|term| term.to_f64().abs()).sum();
            piece.radius[0].to_f64() - swing < THIN
        })
    }
}
