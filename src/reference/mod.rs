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
//! - noise: the sum over eight corners with products of weights, at coordinates of twice double precision.
//!
//! Nothing is narrowed or left out but by `q <= 1`. Where the prose leaves a case open, it is read thus:
//!
//! - a point in the common normal plane of two smoothly joined segments (to 1e-9 radians) has a foot on
//!   either;
//! - a cusp or fold inside a segment is a corner of half a turn. There, and where a segment comes straight
//!   back on the one before it, `T1 x T2` has no direction; instead it is the normal of a cusp's plane, else
//!   the frame's normal;
//! - the corner's frame is that at the end of the first segment, Frenet's too;
//! - with round caps the end is a foot of every point beyond its normal plane, whatever else is nearer.

mod axis;
mod noise;
mod pattern;
mod piece;
mod quadrature;
mod radius;
mod roots;
#[cfg(test)]
mod tests;
mod transport;

pub use noise::{octave_weight, perlin, perlin_around};
pub use pattern::fbm;

use crate::scene::{Caps, Layer, Op, Pattern, Radial, Scene, Space, Tube};
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
    time: f64,
    /// Edge of a voxel in metres, where octaves fade.
    voxel_size: Option<f64>,
}

/// A tube with its axis worked out.
#[derive(Debug, Clone)]
struct Bent {
    tube: Tube,
    axis: Axis,
    radius: Radius,
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
    /// Radius of the tube there, metres.
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
    /// The scene at `time` in seconds.
    ///
    /// With a voxel size in metres, octaves fade as the scene's settings say; without one, none does.
    pub fn new(scene: &Scene, time: f64, voxel_size: Option<f64>) -> Reference {
        let tubes = scene.tubes.iter().map(Bent::new).collect();
        Reference { tubes, time, voxel_size: voxel_size.filter(|_| scene.bake.octave_fade) }
    }

    /// The density at a world point, metres.
    pub fn density(&self, p: [f64; 3]) -> f64 {
        let mut density = 0.0_f64;
        for bent in &self.tubes {
            for place in bent.places(p, Some(SLACK * bent.radius.largest())) {
                if let Some(at) = bent.cylindrical(&place, self.time)
                    && at.q() <= 1.0
                {
                    density = density.max(bent.contribution(p, &at, self.time, self.voxel_size));
                }
            }
        }
        density
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
        bent.places(p, None).iter().filter_map(|place| bent.cylindrical(place, self.time)).collect()
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
    fn new(tube: &Tube) -> Bent {
        let vector = |v: &glam::DVec3| Vector3::new(v.x, v.y, v.z);
        let segments: Vec<_> =
            tube.curve.segments().iter().map(|segment| segment.power().each_ref().map(vector)).collect();
        let axis = Axis::new(&segments, tube.frame);
        Bent { tube: tube.clone(), axis, radius: Radius::new(&tube.radius) }
    }

    fn places(&self, p: [f64; 3], reach: Option<f64>) -> Vec<Place> {
        self.axis.places(&Vector3::from(p), reach, self.tube.caps == Caps::Round)
    }

    /// None where the tube has no radius.
    fn cylindrical(&self, place: &Place, time: f64) -> Option<Cylindrical> {
        let fraction = place.arc / self.axis.length();
        let radius = self.radius.at(fraction);
        if radius <= 0.0 || radius < VANISHED * self.radius.largest() {
            return None;
        }
        let turns = self.tube.twist * fraction + self.tube.spin * time;
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

    fn contribution(&self, p: [f64; 3], at: &Cylindrical, time: f64, voxel_size: Option<f64>) -> f64 {
        let distance = at.q().sqrt();
        let focal = smoothstep(0.0, 0.2, at.focal);
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
            let term = self.term(layer, p, at, time, voxel_size);
            value = match layer.op {
                Op::Multiply => value * term,
                Op::Add => value + term,
                Op::Max => term.max(value),
                Op::Min => term.min(value),
            };
        }
        focal * radial * axial * value
    }

    fn term(&self, layer: &Layer, p: [f64; 3], at: &Cylindrical, time: f64, voxel_size: Option<f64>) -> f64 {
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
                        time,
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

/// `t^2 (3 - 2 t)` with `t = (x - a) / (b - a)` clamped to [0, 1].
fn smoothstep(a: f64, b: f64, x: f64) -> f64 {
    let t = ((x - a) / (b - a)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}
