//! A second evaluator of the density: slow, plain, in `f64`, and the truth that everything else is held
//! against.
//!
//! It follows the definitions in the prose of the [`field`](crate::field), [`noise`](crate::noise) and
//! [`curve`](crate::curve) modules and shares no formula code with them: of a curve it reads only the
//! coefficients, of a profile only the keys. Where there was a choice, it takes another road than the fast
//! code:
//!
//! - feet: the roots of `(C - p) . C'` between the roots of its derivative, found by bisection alone, with no
//!   starting point to be wrong;
//! - arc length: Gauss-Legendre quadrature on panels halved until both halves agree with the whole;
//! - rotation-minimising frame: its differential equation, by extrapolation of order 16;
//! - cusps: the segment is cut there and the zero divided out of C', so that the tangent has no noise;
//! - noise: the sum over eight corners with products of weights, at coordinates of twice double precision, turned by
//!   quaternions, around loops in whole numbers.
//!
//! Nothing is narrowed or left out but by `q <= 1`. Where the prose leaves a case open, it is read thus:
//!
//! - a point in the common normal plane of two smoothly joined segments (to 1e-9 radians) has a foot on
//!   either;
//! - a cusp or fold inside a segment is a corner of half a turn. There, and where a segment comes straight
//!   back on the one before it, `T1 x T2` has no direction; instead it is the normal of a cusp's plane, else
//!   the frame's normal;
//! - on a closed curve the last stretch is before the first in all of this;
//! - the corner's frame is that at the end of the first segment, Frenet's too;
//! - with round caps the end is a foot of every point beyond its normal plane, whatever else is nearer.

mod axis;
mod noise;
mod pattern;
mod piece;
mod quadrature;
mod radius;
mod rest;
mod roots;
#[cfg(test)]
mod tests;
mod transport;

pub use noise::{octave_weight, perlin, perlin_around};
pub use pattern::fbm;

use crate::scene::{Caps, Conserve, Layer, Op, Overlap, Pattern, Radial, Scene, Space, Tube};
use axis::{Axis, Place};
use nalgebra::{Matrix2, Vector3};
use pattern::{Ground, pattern};
use radius::Radius;
use std::f64::consts::TAU;

/// Feet are looked for as far as the largest radius, and this much farther for rounding.
const SLACK: f64 = 1.0 + 1e-9;

/// Below this fraction of the largest radius there is no tube.
const VANISHED: f64 = 1e-6;

/// A scene at one time, ready to be asked for its density.
#[derive(Debug, Clone)]
pub struct Reference {
    tubes: Vec<Bent>,
    /// Edge of a voxel in metres, where octaves fade.
    voxel_size: Option<f64>,
    overlap: Overlap,
}

/// A tube with its axis worked out.
#[derive(Debug, Clone)]
struct Bent {
    tube: Tube,
    axis: Axis,
    radius: Radius,
    /// Edge of the voxel in metres that thin parts are widened to.
    widened: Option<f64>,
}

/// What one foot, or one tube, has to say of the density at a point.
#[derive(Debug, Clone, Copy)]
struct Voice {
    density: f64,
    weight: f64,
    /// Distance from the point to the axis, metres.
    distance: f64,
}

/// Where a point's distance to an axis has a local minimum.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Foot {
    /// Index of the segment in the curve.
    pub segment: usize,
    /// Parameter in the segment, 0 to 1.
    pub t: f64,
    /// Distance from the point, metres.
    pub distance: f64,
}

/// A point in the coordinates of a tube, by one of its feet.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cylindrical {
    /// Across the tube, in radii, along the twisted normal.
    pub u: f64,
    /// Across the tube, in radii, along the twisted binormal.
    pub v: f64,
    /// Beyond an end of the curve: along the tangent, in radii. Otherwise 0.
    pub w: f64,
    /// Along the tube: s / L where stretched, else s in metres.
    pub l: f64,
    /// s / L.
    pub fraction: f64,
    /// Radius of the tube there, metres; where the tube is widened, widened.
    pub radius: f64,
    /// `1 - kappa rho cos`.
    pub focal: f64,
}

impl Cylindrical {
    /// `u^2 + v^2 + w^2`; the foot counts where it is at most 1.
    pub fn q(&self) -> f64 {
        self.u * self.u + self.v * self.v + self.w * self.w
    }
}

impl Reference {
    /// The scene as it is at its time.
    ///
    /// With a voxel size in metres, octaves fade and thin tubes are widened as the scene's settings say; without one,
    /// none.
    pub fn new(scene: &Scene, voxel_size: Option<f64>) -> Reference {
        let widened = voxel_size.filter(|_| scene.bake.widen);
        let tubes = scene.tubes.iter().map(|tube| Bent::new(tube, widened)).collect();
        let voxel_size = voxel_size.filter(|_| scene.bake.octave_fade);
        Reference { tubes, voxel_size, overlap: scene.overlap }
    }

    /// The density at a world point, metres.
    pub fn density(&self, p: [f64; 3]) -> f64 {
        let voices: Vec<Voice> =
            self.tubes.iter().filter_map(|bent| bent.voice(p, self.voxel_size)).collect();
        join(self.overlap, &voices).map_or(0.0, |voice| voice.density.max(0.0))
    }

    /// Every foot of a world point on the axis of tube number `tube`, at any distance.
    ///
    /// One on the joint of two smoothly joined segments may be listed from both sides. Ends of the curve that
    /// round caps make feet of, corners and cusps are among them.
    ///
    /// # Panics
    ///
    /// If there is no such tube.
    pub fn feet(&self, tube: usize, p: [f64; 3]) -> Vec<Foot> {
        let foot = |place: Place| Foot { segment: place.segment, t: place.t, distance: place.arm.norm() };
        self.tubes[tube].places(p, None).into_iter().map(foot).collect()
    }

    /// The cylinder coordinates of a world point by each foot on tube number `tube` where the tube has a
    /// radius, whether or not the foot counts.
    ///
    /// # Panics
    ///
    /// If there is no such tube.
    pub fn cylinder(&self, tube: usize, p: [f64; 3]) -> Vec<Cylindrical> {
        let bent = &self.tubes[tube];
        bent.places(p, None).iter().filter_map(|place| bent.cylindrical(place)).collect()
    }

    /// The cylinder coordinates of a world point by each foot on tube number `tube` that counts: none outside of the tube.
    ///
    /// # Panics
    ///
    /// If there is no such tube.
    pub fn inside(&self, tube: usize, p: [f64; 3]) -> Vec<Cylindrical> {
        let bent = &self.tubes[tube];
        let reach = SLACK * bent.wide(bent.radius.largest());
        let places = bent.places(p, Some(reach));
        places.iter().filter_map(|place| bent.cylindrical(place)).filter(|at| at.q() <= 1.0).collect()
    }

    /// Arc length of the axis of tube number `tube`, metres.
    ///
    /// # Panics
    ///
    /// If there is no such tube.
    pub fn length(&self, tube: usize) -> f64 {
        self.tubes[tube].axis.length()
    }
}

impl Bent {
    fn new(tube: &Tube, widened: Option<f64>) -> Bent {
        let vector = |v: &glam::DVec3| Vector3::new(v.x, v.y, v.z);
        let segments: Vec<_> =
            tube.curve.segments().iter().map(|segment| segment.power().each_ref().map(vector)).collect();
        let axis = Axis::new(&segments, tube.frame, tube.curve.is_closed());
        Bent { tube: tube.clone(), axis, radius: Radius::new(&tube.radius), widened }
    }

    /// All feet of a point together; none where no foot counts.
    fn voice(&self, p: [f64; 3], voxel_size: Option<f64>) -> Option<Voice> {
        let mut voices: Vec<(f64, Voice)> = Vec::new();
        let reach = SLACK * self.wide(self.radius.largest());
        for place in self.places(p, Some(reach)) {
            let Some(at) = self.cylindrical(&place).filter(|at| at.q() <= 1.0) else { continue };
            // A foot on a joint is listed from both sides.
            let length = self.axis.length();
            let apart = |arc: f64| {
                let apart = (arc - place.arc).abs();
                if self.tube.curve.is_closed() { apart.min(length - apart) } else { apart }
            };
            if voices.iter().any(|(arc, _)| apart(*arc) < 1e-9 * length) {
                continue;
            }
            let fade = smoothstep(0.0, 0.2, at.focal);
            let unfaded = self.gain(&at) * self.contribution(p, &at, voxel_size);
            let density = if self.tube.overlap == Overlap::Closest { unfaded } else { fade * unfaded };
            let rim = 1.0 - at.q().sqrt();
            voices.push((
                place.arc,
                Voice { density, weight: fade * rim * rim, distance: at.q().sqrt() * at.radius },
            ));
        }
        let voices: Vec<Voice> = voices.into_iter().map(|(_, voice)| voice).collect();
        join(self.tube.overlap, &voices)
    }

    /// The radius that the tube shows.
    fn wide(&self, own: f64) -> f64 {
        self.widened.map_or(own, |h| {
            // The parabola through (0, 3/2) and (3, 3), level at its start, in voxels.
            let voxels = own / h;
            if voxels < 3.0 { h * (1.5 + 1.5 * (voxels / 3.0) * (voxels / 3.0)) } else { own }
        })
    }

    /// The rest volume over the deformed one.
    fn gain(&self, at: &Cylindrical) -> f64 {
        let own = self.radius.at(at.fraction);
        let squared = |x: f64| x * x;
        let thinning = squared(own / at.radius);
        if self.tube.conserve == Conserve::Off {
            return thinning;
        }
        let rest = self.tube.rest;
        let stretch = if self.tube.stretch { self.axis.length() / rest.length } else { 1.0 };
        let across = (thinning * squared(rest.radius / own) / stretch).min(1e6);
        if self.tube.conserve == Conserve::Full { across / at.focal.max(0.05) } else { across }
    }

    fn places(&self, p: [f64; 3], reach: Option<f64>) -> Vec<Place> {
        self.axis.places(&Vector3::from(p), reach, self.tube.caps == Caps::Round)
    }

    /// None where the tube has no radius.
    fn cylindrical(&self, place: &Place) -> Option<Cylindrical> {
        let fraction = place.arc / self.axis.length();
        let own = self.radius.at(fraction);
        if own <= 0.0 || own < VANISHED * self.radius.largest() {
            return None;
        }
        let radius = self.wide(own);
        let turns = self.tube.twist * fraction + self.tube.turned;
        let phi = TAU * (turns - turns.floor());
        let (sin, cos) = (libm::sin(phi), libm::cos(phi));
        let (n, b) = (place.arm.dot(&place.frame.normal), place.arm.dot(&place.frame.binormal));
        let beyond = if place.beyond { place.arm.dot(&place.frame.tangent) } else { 0.0 };
        Some(Cylindrical {
            u: (cos * n + sin * b) / radius,
            v: (cos * b - sin * n) / radius,
            w: beyond / radius,
            l: if self.tube.stretch { fraction } else { place.arc },
            fraction,
            radius,
            focal: place.focal,
        })
    }

    /// The density of the tube before it is deformed.
    fn contribution(&self, p: [f64; 3], at: &Cylindrical, voxel_size: Option<f64>) -> f64 {
        let distance = at.q().sqrt();
        let radial = match self.tube.radial {
            Radial::Smooth => (1.0 - distance * distance) * (1.0 - distance * distance),
            Radial::Linear => 1.0 - distance,
            Radial::Hard => 1.0,
            Radial::Edge(width) => 1.0 - smoothstep(1.0 - width, 1.0, distance),
        };
        let axial = match self.tube.caps {
            Caps::Fade(part) => smoothstep(0.0, part, at.fraction) * smoothstep(0.0, part, 1.0 - at.fraction),
            Caps::Flat | Caps::Round => 1.0,
        };
        let mut value = 1.0;
        for layer in &self.tube.layers {
            let term = self.term(layer, p, at, voxel_size);
            value = match layer.op {
                Op::Multiply => value * term,
                Op::Add => value + term,
                Op::Max => term.max(value),
                Op::Min => term.min(value),
            };
        }
        radial * axial * value
    }

    fn term(&self, layer: &Layer, p: [f64; 3], at: &Cylindrical, voxel_size: Option<f64>) -> f64 {
        let pattern = match &layer.pattern {
            Pattern::Constant(value) => *value,
            Pattern::Sectors => f64::from(at.u * at.v > 0.0),
            Pattern::Perlin(noise) => {
                let rate = |frequency: [f64; 3]| match noise.space {
                    Space::Cylinder => self.rate(frequency, at),
                    Space::World => Vector3::from(frequency).max(),
                };
                let cells_per_voxel = |frequency| voxel_size.map(|h| h * rate(frequency));
                let is_loop = self.tube.curve.is_closed() && noise.space == Space::Cylinder;
                pattern(
                    noise,
                    &Ground {
                        position: if noise.space == Space::World { p } else { [at.u, at.v, at.l] },
                        around: is_loop.then(|| if self.tube.stretch { 1.0 } else { self.axis.length() }),
                        cells_per_voxel: &cells_per_voxel,
                    },
                )
            }
        };
        layer.multiplier * layer.threshold.map_or(pattern, |threshold| (pattern - threshold).max(0.0))
    }

    /// The fastest rate, per metre, at which a first octave's lattice coordinates change at a point.
    fn rate(&self, frequency: [f64; 3], at: &Cylindrical) -> f64 {
        let across = frequency[0].max(frequency[1]);
        let along = if self.tube.stretch { frequency[2] / self.axis.length() } else { frequency[2] };
        let swirl = TAU * self.tube.twist * across * at.q().sqrt() / self.axis.length();
        Matrix2::new(across / at.radius, swirl, 0.0, along).singular_values().max()
    }
}

/// Several densities as one; none of none.
fn join(rule: Overlap, voices: &[Voice]) -> Option<Voice> {
    let first = voices.first()?;
    let weight: f64 = voices.iter().map(|voice| voice.weight).sum();
    let nearest = voices.iter().fold(first, |a, b| if b.distance < a.distance { b } else { a });
    let density = match rule {
        Overlap::Max => voices.iter().fold(f64::NEG_INFINITY, |most, voice| most.max(voice.density)),
        Overlap::Sum => voices.iter().map(|voice| voice.density).sum(),
        Overlap::Closest => nearest.density,
        Overlap::Blend if weight > 0.0 => {
            voices.iter().map(|voice| voice.weight * voice.density).sum::<f64>() / weight
        }
        Overlap::Blend => 0.0,
    };
    Some(Voice { density, weight, distance: nearest.distance })
}

/// `t^2 (3 - 2 t)` with `t = (x - a) / (b - a)` clamped to [0, 1].
fn smoothstep(a: f64, b: f64, x: f64) -> f64 {
    let t = ((x - a) / (b - a)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}
