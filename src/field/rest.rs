//! The tubes' cylinders at rest, laid out in slices for the quadrature of their mass.
//!
//! Along a cylinder: composite Gauss-Legendre quadrature, on panels that end where the faded ends do, at the radius's
//! keys and at the curve's joints. Across it: rings at Gauss-Legendre nodes of the distance to the axis, each of
//! evenly spaced points (the trapezoidal rule, which converges like Gauss's for what is smooth around the axis). Every
//! slice is turned against the one before it by the golden angle, so that where noise is finer than the points, its
//! samples do not repeat.

use std::f64::consts::{PI, TAU};

use glam::DVec3;

use super::detail::Place;
use super::kernel::{self, Scratch};
use super::layers;
use super::narrow::Block;
use super::region::Region;
use super::span::MOST_GAIN;
use super::tube::{LayerKind, Tube};
use super::{Field, Lattice, VOXELS};
use crate::num::quadrature::gauss_legendre;
use crate::num::{Real, Scalar};
use crate::scene::{self, Caps, Conserve, Overlap, Radial, Scene, Space};

/// The golden angle in turns.
const GOLDEN: f64 = 0.381_966_011_250_105_15;
/// Slices of a panel between breaks, at least, and of one Gauss rule, at most.
const LEAST_SLICES: f64 = 4.0;
const MOST_SLICES: f64 = 8.0;
/// Rings of a disc.
const RINGS: [f64; 2] = [4.0, 64.0];
/// Points across the axis of a half ball.
const BALL: u32 = 16;

/// The cylinders of all tubes in slices.
#[derive(Debug, Clone, Default)]
pub struct Cylinders {
    /// For each tube its two discs, and a third for round ends.
    discs: Vec<[Disc; 3]>,
    slices: Vec<Slice>,
    panels: usize,
}

/// Points of the unit disc.
#[derive(Debug, Clone, Default)]
struct Disc {
    /// u, v, and the weight times the radial envelope.
    points: Vec<[f64; 3]>,
    /// Distance between rings, and between the points of each.
    spacing: f64,
}

/// A cross-section of a cylinder at rest, or of its tube's round end.
#[derive(Debug, Clone)]
pub struct Slice {
    tube: usize,
    /// Which of the tube's discs: both are laid over the whole of the cylinder, to tell the error.
    disc: usize,
    panel: usize,
    /// Arc length along the tube, metres.
    arc: f64,
    /// Volume at rest over the disc's area, times the axial envelope.
    weight: f64,
    /// Cosine and sine by which the disc is turned.
    turn: [f64; 2],
    /// Where the disc is in the world, and where u and v point there.
    centre: DVec3,
    axes: [DVec3; 2],
    /// Radius in metres, which octaves fade by.
    radius: f64,
    is_deformed: bool,
    /// `kappa rho cos` is the product of this with (u, v).
    bend: [f64; 2],
    /// Mass on the deformed axis over that at rest.
    swell: f64,
    conserve: Conserve,
    fades_at_focus: bool,
}

/// What a slice, or a sum of them, holds.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Masses {
    /// At rest, metres^3.
    pub rest: f64,
    /// The part of it that has no image.
    pub lost: f64,
    /// The part of it that is faded out beside the focal set.
    pub faded: f64,
    /// What the rest becomes, metres^3.
    pub image: f64,
    /// In half balls at round ends, metres^3.
    pub caps: f64,
}

impl Masses {
    /// Adds to each.
    pub fn add(&mut self, other: &Masses) {
        self.rest += other.rest;
        self.lost += other.lost;
        self.faded += other.faded;
        self.image += other.image;
        self.caps += other.caps;
    }
}

impl Cylinders {
    /// The slices, in the order of the tubes.
    pub fn slices(&self) -> &[Slice] {
        &self.slices
    }

    /// Number of panels.
    pub fn panels(&self) -> usize {
        self.panels
    }

    /// Points of a slice.
    pub fn points(&self, slice: &Slice) -> usize {
        self.disc(slice).points.len()
    }

    fn disc(&self, slice: &Slice) -> &Disc {
        &self.discs[slice.tube][slice.disc]
    }

    /// Places the points of a slice from number `first` on, at most 512 of them, for [`evaluate`]; returns how many.
    pub fn place<T: Scalar>(
        &self,
        slice: &Slice,
        lattice: Lattice,
        first: usize,
        scratch: &mut Scratch<T>,
    ) -> usize {
        let points = &self.disc(slice).points[first..];
        let count = points.len().min(VOXELS);
        let radius = T::from_f64(slice.radius / lattice.voxel_size);
        let axes = slice.axes.map(|axis| axis * (slice.radius / lattice.voxel_size));
        for (i, &[u, v, _]) in points[..count].iter().enumerate() {
            let [u, v] = slice.turned([u, v]);
            let place = axes[0] * u + axes[1] * v;
            scratch.u.part_mut(i)[0] = T::from_f64(u);
            scratch.v.part_mut(i)[0] = T::from_f64(v);
            scratch.height.part_mut(i)[0] = T::from_f64(0.0);
            scratch.weight.part_mut(i)[0] = T::from_f64(1.0);
            scratch.radius.part_mut(i)[0] = radius;
            scratch.q.part_mut(i)[0] = T::from_f64(u * u + v * v);
            for axis in 0..3 {
                scratch.place[axis].part_mut(i)[0] = T::from_f64(place[axis]);
            }
        }
        count
    }

    /// Adds up the masses at the points that were placed last, `count` of them from number `first` on.
    pub fn gather<T: Scalar>(
        &self,
        slice: &Slice,
        first: usize,
        count: usize,
        scratch: &Scratch<T>,
    ) -> Masses {
        let mut masses = Masses::default();
        let disc = self.disc(slice);
        let points = &disc.points[first..first + count];
        // A line across the disc parts the points' own shares of it, too: `1 - kappa rho cos` over one of them.
        let bend = (slice.bend[0] * slice.bend[0] + slice.bend[1] * slice.bend[1]).sqrt();
        let share = if bend > 1.0 { bend * disc.spacing } else { 0.0 };
        for (&[u, v, weight], &layers) in points.iter().zip(scratch.weight.all()) {
            let mass = slice.weight * weight * layers.to_f64().max(0.0);
            if slice.is_cap() {
                masses.caps += mass;
                continue;
            }
            masses.rest += mass;
            let [u, v] = slice.turned([u, v]);
            let focal = 1.0 - (u * slice.bend[0] + v * slice.bend[1]);
            if !slice.is_deformed {
                masses.lost += mass;
                continue;
            }
            let lost = if share > 0.0 { mass * (0.5 - focal / share).clamp(0.0, 1.0) } else { 0.0 };
            masses.lost += lost;
            if focal > 0.0 {
                masses.faded += (mass * (1.0 - slice.kept(focal)) - lost).max(0.0);
                masses.image += mass * slice.image(focal);
            } else {
                masses.faded += mass - lost;
            }
        }
        masses
    }
}

impl Slice {
    /// Its panel, and whether it belongs to the second of the two rules laid over that; `None` for round ends.
    pub fn place_in_sum(&self) -> Option<(usize, usize)> {
        (!self.is_cap()).then_some((self.panel, self.disc))
    }

    fn is_cap(&self) -> bool {
        self.disc == 2
    }

    fn turned(&self, [u, v]: [f64; 2]) -> [f64; 2] {
        let [cos, sin] = self.turn;
        [u * cos - v * sin, u * sin + v * cos]
    }

    /// What the fade at the focal set, and the limit on what is gained there, leave where `1 - kappa rho cos` is `focal`.
    fn kept(&self, focal: f64) -> f64 {
        let fade = if self.fades_at_focus { smoothstep(focal / 0.2) } else { 1.0 };
        if self.conserve == Conserve::Full { fade * focal / focal.max(kernel::LEAST_NARROWING) } else { fade }
    }

    /// Mass of the image over that at rest there.
    fn image(&self, focal: f64) -> f64 {
        let volume = if self.conserve == Conserve::Full { 1.0 } else { focal };
        self.kept(focal) * volume * self.swell
    }
}

impl Field {
    /// The cylinders at rest of the scene that the field was compiled from, in slices of about `points` points in all:
    /// more where there are very many tubes.
    pub fn at_rest(&self, scene: &Scene, points: u64) -> Cylinders {
        let mut cylinders = Cylinders::default();
        let volume =
            |(tube, rest): (&Tube, &scene::Tube)| rest.rest.radius * rest.rest.radius * length(tube, rest);
        let pairs = || self.tubes.iter().zip(scene.tubes());
        let whole: f64 = pairs().map(volume).sum();
        for (index, (tube, rest)) in pairs().enumerate() {
            #[allow(clippy::cast_precision_loss, reason = "a share")]
            let share = points as f64 * (volume((tube, rest)) / whole);
            let layout = Layout { tube, rest, index };
            layout.lay(share.max(LEAST_POINTS), &mut cylinders);
        }
        cylinders
    }

    /// Narrows the field to the layers of a slice, whose points have height 0, with patterns in the world as the
    /// disc's image has them. `region` is overwritten.
    pub fn narrow_to_slice<T: Scalar>(&self, lattice: Lattice, slice: &Slice, region: &mut Region<T>) {
        region.pieces.clear();
        region.layers.clear();
        region.sums.clear();
        region.octaves.clear();
        let block = Block { centre: slice.centre, h: lattice.voxel_size, half_edge: 0.0 };
        let tube = &self.tubes[slice.tube];
        let place = Place {
            radius: tube.radius.range([slice.arc / tube.curve.length(); 2]),
            origin: slice.arc,
            away: [0.0, f64::INFINITY],
            block,
            octave_fade: self.octave_fade,
        };
        place.layers(tube, region);
    }
}

/// What the layers make at `count` places of a slice that the region was narrowed to.
#[inline(always)]
pub fn evaluate<R: Real>(
    token: R::Token,
    region: &Region<R::Scalar>,
    scratch: &mut Scratch<R::Scalar>,
    count: usize,
) {
    layers::layers::<R>(token, region, [0, region.layers.len()], scratch, count);
}

/// Points of a tube, at least.
const LEAST_POINTS: f64 = 256.0;

/// Length of the cylinder at rest, metres.
fn length(tube: &Tube, rest: &scene::Tube) -> f64 {
    if tube.stretch { rest.rest.length } else { tube.curve.length() }
}

/// One tube being laid out.
struct Layout<'a> {
    tube: &'a Tube,
    rest: &'a scene::Tube,
    index: usize,
}

impl Layout<'_> {
    fn lay(&self, points: f64, cylinders: &mut Cylinders) {
        let breaks = self.breaks(points);
        // Points are as far apart along the tube as across it, in cells of its noise, and no farther than if all of it
        // were one cell.
        let [across, along] = self.cells().map(|cells| cells.clamp(1.0, 1e4));
        let density = libm::cbrt(0.5 * points / (PI * across * across * along));
        #[allow(clippy::cast_precision_loss, reason = "at most hundreds")]
        let least = LEAST_SLICES * (breaks.len() - 1) as f64;
        let slices = (density * along).max(least);
        let rings = (0.5 * points / (PI * slices)).sqrt().clamp(RINGS[0], RINGS[1]).round();
        let discs = [rings, rings + 1.0].map(|rings| Disc::new(self.tube.radial, rings, radial));
        // A rule has half of the points.
        #[allow(clippy::cast_precision_loss, reason = "at most some thousands")]
        let slices = 0.5 * points / discs[0].points.len() as f64;
        for disc in [0, 1] {
            let (mut panel, mut number) = (cylinders.panels, 0.0);
            for ends in breaks.windows(2) {
                let wanted = (slices * (ends[1] - ends[0])).max(LEAST_SLICES);
                let panels = whole((wanted / MOST_SLICES).ceil());
                let width = (ends[1] - ends[0]) / f64::from(panels);
                let nodes = gauss_legendre(whole((wanted / f64::from(panels)).ceil()) + u32::from(disc == 1));
                for start in 0..panels {
                    for &[node, weight] in &nodes {
                        let x = ends[0] + (f64::from(start) + node) * width;
                        cylinders.slices.push(self.slice(x, weight * width, disc, panel, GOLDEN * number));
                        number += 1.0;
                    }
                    panel += 1;
                }
            }
            if disc == 1 {
                cylinders.panels = panel;
            }
        }
        let [first, second] = discs;
        let mut discs = [first, second, Disc::default()];
        if self.rest.caps == Caps::Round {
            discs[2] = Disc::new(self.tube.radial, rings, half_ball);
            cylinders.slices.extend([0.0, 1.0].into_iter().filter_map(|x| self.cap(x)));
        }
        cylinders.discs.push(discs);
    }

    /// Where panels end, over the fraction of the length. Those that matter least are given up where there are many.
    fn breaks(&self, points: f64) -> Vec<f64> {
        let (curve, radius) = (&self.tube.curve, &self.tube.radius);
        let mut breaks = vec![0.0, 1.0];
        if let Caps::Fade(fraction) = self.tube.caps {
            breaks.extend([fraction, 1.0 - fraction]);
        }
        let joints =
            (1..curve.segments().len()).map(|segment| curve.arc_length(segment, 0.0) / curve.length());
        let more: Vec<f64> = radius.knots().iter().copied().chain(joints).collect();
        #[allow(clippy::cast_precision_loss, reason = "compared with some hundreds")]
        if more.len() as f64 <= points / 256.0 {
            breaks.extend(more);
        }
        breaks.sort_by(f64::total_cmp);
        breaks.dedup_by(|b, a| *b - *a < 1e-9);
        let mut fine = vec![0.0];
        let mut left = points / 512.0;
        for ends in breaks.windows(2) {
            self.halve([ends[0], ends[1]], &mut left, &mut fine);
        }
        fine
    }

    /// Appends the ends of parts of an interval along which, where the focal set is near, bending changes by little;
    /// no more than `left` of them.
    fn halve(&self, [start, end]: [f64; 2], left: &mut f64, ends: &mut Vec<f64>) {
        /// The focal fade begins at 0.8.
        const BENT: f64 = 0.75;
        const CHANGE: f64 = 0.2;
        const SHORTEST: f64 = 1e-4;
        let [mut least, mut most] = [f64::INFINITY, 0.0_f64];
        for part in [0.001, 0.25, 0.5, 0.75, 0.999] {
            let bend = self.bend(start + part * (end - start));
            least = least.min(bend);
            most = most.max(bend);
        }
        if most < BENT || most - least < CHANGE * most || end - start < SHORTEST || *left < 1.0 {
            ends.push(end);
            return;
        }
        *left -= 1.0;
        let middle = 0.5 * (start + end);
        self.halve([start, middle], left, ends);
        self.halve([middle, end], left, ends);
    }

    /// Curvature times radius.
    fn bend(&self, x: f64) -> f64 {
        let curve = &self.tube.curve;
        let (segment, t) = curve.locate(x * curve.length());
        let (d1, d2) = (curve.segments()[segment].d1(t), curve.segments()[segment].d2(t));
        let speed = d1.length();
        let bend = d1.cross(d2).length() / (speed * speed * speed) * self.tube.radius.at(x);
        if bend.is_finite() { bend } else { 0.0 }
    }

    /// Cells of noise in the first octave over the radius, and along the tube.
    fn cells(&self) -> [f64; 2] {
        let mut cells = [0.0_f64; 2];
        for layer in &self.tube.layers {
            let LayerKind::Perlin(perlin) = &layer.kind else { continue };
            if perlin.sum.octaves.is_empty() {
                continue;
            }
            let [u, v, l] = perlin.sum.frequency;
            let (across, along) = match perlin.space {
                Space::Cylinder => (u.max(v), l * self.tube.height_rate()),
                Space::World => (u.max(v).max(l) * self.tube.radius.range([0.0, 1.0])[1], u.max(v).max(l)),
            };
            cells[0] = cells[0].max(across);
            cells[1] = cells[1].max(along * self.tube.curve.length());
        }
        cells
    }

    /// The slice at the fraction x of the length, with so much of the length around it.
    fn slice(&self, x: f64, width: f64, disc: usize, panel: usize, turns: f64) -> Slice {
        let (tube, rest) = (self.tube, &self.rest.rest);
        let (curve, own) = (&tube.curve, tube.radius.own(x));
        let arc = x * curve.length();
        let radius = tube.radius.divisor(tube.radius.at(x));
        let (segment, t) = curve.locate(arc);
        let (d1, d2) = (curve.segments()[segment].d1(t), curve.segments()[segment].d2(t));
        let speed2 = d1.length_squared();
        let frame = curve.frame(segment, t);
        let turned = tube.turns.map_or(0.0, |[start, rate]| start + rate * arc);
        let phi = TAU * (turned - turned.floor());
        // Radius times the curvature's vector, along U and V.
        let [n, b] = [frame.normal, frame.binormal].map(|axis| {
            let along = d2.dot(axis) / speed2 * radius;
            if along.is_finite() { along } else { 0.0 }
        });
        let (sin, cos) = (libm::sin(phi), libm::cos(phi));
        let axes = [frame.normal * cos + frame.binormal * sin, frame.binormal * cos - frame.normal * sin];
        let axial = match tube.caps {
            Caps::Fade(fraction) => smoothstep(x / fraction) * smoothstep((1.0 - x) / fraction),
            Caps::Flat | Caps::Round => 1.0,
        };
        let volume = rest.radius * rest.radius * length(tube, self.rest);
        let turn = TAU * (turns - turns.floor());
        Slice {
            tube: self.index,
            disc,
            panel,
            arc,
            weight: volume * width * axial,
            turn: [libm::cos(turn), libm::sin(turn)],
            centre: curve.segments()[segment].at(t),
            axes,
            radius,
            is_deformed: !tube.radius.vanishes_at(x),
            bend: [n * cos + b * sin, b * cos - n * sin],
            swell: match self.rest.conserve {
                Conserve::Off => own * own * curve.length() / volume,
                // The gain has its limit.
                Conserve::Radius | Conserve::Full => {
                    let grown = radius * radius * curve.length() / volume;
                    (MOST_GAIN * grown).min(1.0)
                }
            },
            conserve: self.rest.conserve,
            fades_at_focus: self.rest.overlap != Overlap::Closest,
        }
    }

    /// The round end at 0 or 1, if the tube has a radius there.
    fn cap(&self, x: f64) -> Option<Slice> {
        let mut slice = self.slice(x, 1.0, 2, 0, 0.0);
        let own = self.tube.radius.own(x);
        // The half ball's volume over its disc's is a radius; and where nothing is conserved, a widened ball is
        // thinner.
        let gain = match self.rest.conserve {
            Conserve::Off => own * own / (slice.radius * slice.radius),
            Conserve::Radius | Conserve::Full => {
                (slice.weight / (slice.radius * slice.radius * self.tube.curve.length())).min(MOST_GAIN)
            }
        };
        slice.weight = gain * slice.radius * slice.radius * slice.radius;
        slice.is_deformed.then_some(slice)
    }
}

impl Disc {
    /// Points on about `rings` rings, as far apart on each as the rings are.
    fn new(envelope: Radial, rings: f64, weight_at: impl Fn(Radial, f64) -> f64) -> Disc {
        // The soft edge is another polynomial than what is inside of it.
        let breaks = match envelope {
            Radial::Edge(width) if width < 1.0 => vec![0.0, 1.0 - width, 1.0],
            _ => vec![0.0, 1.0],
        };
        let mut points = Vec::new();
        let mut number = 0.0;
        for ends in breaks.windows(2) {
            let width = ends[1] - ends[0];
            for [node, weight] in gauss_legendre(whole((rings * width).max(RINGS[0]).ceil())) {
                let x = ends[0] + node * width;
                // A multiple of four, so that the four sectors have as many points each.
                let count = 4 * whole((0.25 * TAU * x * rings).ceil());
                let weight = weight * width * x * TAU / f64::from(count) * weight_at(envelope, x);
                for k in 0..count {
                    let turns = f64::from(k) / f64::from(count) + GOLDEN * number;
                    let angle = TAU * (turns - turns.floor());
                    points.push([x * libm::cos(angle), x * libm::sin(angle), weight]);
                }
                number += 1.0;
            }
        }
        Disc { points, spacing: 1.0 / rings }
    }
}

/// The radial envelope at the fraction x of the radius.
fn radial(envelope: Radial, x: f64) -> f64 {
    match envelope {
        Radial::Smooth => (1.0 - x * x) * (1.0 - x * x),
        Radial::Linear => 1.0 - x,
        Radial::Hard => 1.0,
        Radial::Edge(width) => smoothstep((1.0 - x) / width),
    }
}

/// Its integral over a half ball's height at the fraction x of the radius.
fn half_ball(envelope: Radial, x: f64) -> f64 {
    let height = (1.0 - x * x).sqrt();
    let mut sum = 0.0;
    for [node, weight] in gauss_legendre(BALL) {
        let w = node * height;
        sum += weight * height * radial(envelope, (x * x + w * w).sqrt());
    }
    sum
}

/// `t^2 (3 - 2 t)` with t clamped to [0, 1].
fn smoothstep(t: f64) -> f64 {
    let t = t.clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// A whole number at least 1, within the range.
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "whole, and a cast saturates")]
fn whole(x: f64) -> u32 {
    x.max(1.0) as u32
}
