//! Scene text to a [`Scene`], which cannot be invalid.
//!
//! [`Scene::parse`], and [`Scene::load`] for texts that name files, are the only ways to make one. Everything after it can rely on what is stated here: every number is
//! finite and inside the range written beside it, every curve has a length, every name is unique. Beyond that no number
//! exceeds 1e9, none that must be above 0 falls below 1e-9, no octave has more than 1e18 cells per unit, and no tube's layers
//! reach 1e30, so that what is computed from a scene stays finite.
//!
//! # Time
//!
//! A [`Scene`] is one at one time: [`Scene::parse`] gives it as it is at its start frame, [`Scene::at`] at another time.
//! Numbers and points of the text that move have their values at that time, and are checked there; rates are added up
//! from the start frame to that time, in closed form.

#![cfg_attr(
    not(test),
    deny(
        clippy::expect_used,
        clippy::indexing_slicing,
        clippy::panic,
        clippy::string_slice,
        clippy::unreachable,
        clippy::unwrap_used
    )
)]

mod axis;
mod error;
mod input;
mod keys;
mod layer;
pub(crate) mod limit;
mod motion;
mod parse;
mod profile;
mod ramp;
mod reader;
mod remark;
mod rows;
mod seams;
mod syntax;
#[cfg(test)]
mod tests;
mod track;
mod tube;
mod view;

pub use crate::noise::Form;
pub use error::{Fault, SceneErrors, Warnings};
pub use input::{Input, Load, MOST_INPUT};
pub use ramp::{ColorRamp, Ramp, TemperatureRamp};
pub use remark::{Key, Remark, Weight};

use std::sync::{Arc, OnceLock};

use remark::Places;

use crate::curve::{Curve, FrameRule, Profile};

/// A valid scene, as it is at one time.
#[derive(Debug, Clone)]
pub struct Scene {
    pub(crate) name: String,
    pub(crate) bake: Bake,
    pub(crate) time: TimeBase,
    pub(crate) overlap: Overlap,
    pub(crate) tubes: Vec<Tube>,
    pub(crate) medium: Medium,
    pub(crate) camera: Camera,
    pub(crate) lights: Vec<Light>,
    pub(crate) text: String,
    pub(crate) inputs: Vec<Input>,
    pub(crate) warnings: Warnings,
    /// Name of the file that the text is from.
    pub(crate) origin: String,
    /// Where in the text its values are; found when that is first asked for.
    pub(crate) places: OnceLock<Arc<Places>>,
    /// Since the start frame.
    pub(crate) seconds: f64,
    /// Whether anything moves other than at a constant rate.
    pub(crate) moving: bool,
}

/// What the command line may override.
#[derive(Debug, Clone, PartialEq)]
pub struct Bake {
    /// How the voxel size is chosen.
    pub step: Step,
    /// Voxels whose density is at or below this are left inactive, at least 0.
    pub cutoff: f64,
    /// Whether octaves too fine for the voxel fade out.
    pub octave_fade: bool,
    /// Whether tubes thinner than the voxel are widened to it, and thinned out, so that their mass is kept.
    pub widen: bool,
    /// What is stored for voxels that an edge of the density passes through.
    pub antialias: Antialias,
}

/// What is stored for voxels that an edge of the density passes through.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Antialias {
    /// The density at the centre, as for any other voxel.
    Off,
    /// The mean density of the voxel's cell.
    Adaptive,
}

/// How the voxel size is chosen.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Step {
    /// Voxels along the longest side of the density's bounds, at least 1.
    Resolution(u32),
    /// Edge of a voxel in metres, above 0.
    VoxelSize(f64),
}

/// Frames and seconds: frame `start` is time 0.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TimeBase {
    /// Frames a second, above 0.
    pub fps: f64,
    /// The frame at time 0.
    pub start: i64,
    /// The last frame, not before the first, where the scene has one.
    pub end: Option<i64>,
}

impl TimeBase {
    /// Seconds from the start frame to `frame`.
    pub fn seconds(&self, frame: i64) -> f64 {
        // Both are far below 2^53.
        (frame - self.start) as f64 / self.fps
    }
}

/// A cylinder of radius 1 bent along a curve.
#[derive(Debug, Clone)]
pub struct Tube {
    /// Unique among the scene's tubes.
    pub name: String,
    /// The axis.
    pub curve: Curve,
    /// Radius in metres over the fraction of the arc length.
    pub radius: Profile,
    /// Where the radius is through samples of a file: an estimate of its error between them, in metres
    /// ([`sampling_error`](crate::curve::sampling_error)).
    pub sampling_error: Option<f64>,
    /// Turns from end to end, right-handed about the tangent.
    pub twist: f64,
    /// Turns a second at the scene's time.
    pub spin: f64,
    /// Turns since time 0, right-handed about the tangent.
    pub turned: f64,
    /// Whether the height l in the cylinder is s/L (true) or the arc length s in metres (false).
    pub stretch: bool,
    /// The frame that carries the cylinder's cross-section along the curve.
    pub frame: FrameRule,
    /// What happens at the two ends; flat for a closed curve, which has none.
    pub caps: Caps,
    /// Density against the distance to the axis.
    pub radial: Radial,
    /// What the density owes to the deformation.
    pub conserve: Conserve,
    /// The cylinder at rest that mass is conserved against.
    pub rest: Rest,
    /// How the contributions of several feet on this tube's axis become one density.
    pub overlap: Overlap,
    /// Layers, combined in order.
    pub layers: Vec<Layer>,
    /// Linear red, green and blue over the fraction of the arc length, each at least 0. Densities do not read it.
    pub color: Option<ColorRamp>,
    /// Kelvin over the fraction of the arc length, at least 0. Densities do not read it.
    pub temperature: Option<TemperatureRamp>,
}

/// What happens at the ends of a tube.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Caps {
    /// Cut by the plane normal to the curve.
    Flat,
    /// Cut likewise, and faded by a smoothstep over this fraction of the length at each end, in (0, 0.5].
    Fade(f64),
    /// Half a ball at each end.
    Round,
}

/// What the density owes to the deformation.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Conserve {
    /// Nothing: it is the rest cylinder's density.
    Off,
    /// It falls as the tube's cross-section and length grow.
    Radius,
    /// It falls as volume grows, bending included: mass is kept.
    Full,
}

/// The cylinder that a tube is made of, before it is bent, stretched and twisted.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rest {
    /// Radius in metres, above 0.
    pub radius: f64,
    /// Length in metres, above 0. Where the tube is not stretched the cylinder is as long as the curve instead.
    pub length: f64,
}

/// How several densities at one point become one.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Overlap {
    /// The largest.
    Max,
    /// Their sum.
    Sum,
    /// That of the nearest axis.
    Closest,
    /// Their mean, weighted by how far inside of the tube the point is.
    Blend,
}

/// Density against the distance to the axis as a fraction x of the radius.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Radial {
    /// `(1 - x^2)^2`: smooth in the middle, and to first order at the surface.
    Smooth,
    /// `1 - x`.
    Linear,
    /// 1 up to the surface.
    Hard,
    /// 1, falling to 0 by a smoothstep over this outermost fraction of the radius, in (0, 1].
    Edge(f64),
}

/// One term of a tube's density.
#[derive(Debug, Clone, PartialEq)]
pub struct Layer {
    /// How the term joins what the layers before it gave.
    pub op: Op,
    /// The pattern.
    pub pattern: Pattern,
    /// Where given, a pattern value n becomes `max(0, n - threshold)`.
    pub threshold: Option<f64>,
    /// Factor on the pattern's value after the threshold.
    pub multiplier: f64,
}

/// How a layer joins what came before it; before the first layer stands the value 1.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Op {
    /// Product.
    Multiply,
    /// Sum.
    Add,
    /// The larger.
    Max,
    /// The smaller.
    Min,
}

/// A pattern over cylinder coordinates (u, v, l), or over the world's where it says so.
#[derive(Debug, Clone, PartialEq)]
pub enum Pattern {
    /// The same value everywhere.
    Constant(f64),
    /// The four quarters of the cross-section: 1 where u v > 0, else 0.
    Sectors,
    /// A fractal sum of improved Perlin noise.
    Perlin(Fbm),
}

/// Parameters of a fractal sum of noise.
#[derive(Debug, Clone, PartialEq)]
pub struct Fbm {
    /// Lattice cells per unit of the coordinates in the first octave, each at least 0.
    pub frequency: [f64; 3],
    /// Number of octaves, 0 to 32.
    pub octaves: u32,
    /// Ratio of frequency from octave to octave, above 0.
    pub lacunarity: f64,
    /// Ratio of amplitude from octave to octave, at least 0.
    pub gain: f64,
    /// Whether the sum is divided by the sum of the amplitudes.
    pub normalise: bool,
    /// Chooses the lattice's gradients.
    pub seed: u32,
    /// How far the pattern has moved along (u, v, l) since time 0, in first-octave cells.
    pub scrolled: [f64; 3],
    /// What each octave makes of its noise.
    pub form: Form,
    /// Whether each octave's lattice is turned, so that their axes do not show.
    pub rotate: bool,
    /// Displaces the coordinates beforehand.
    pub warp: Option<Warp>,
    /// The coordinates that it is a pattern over.
    pub space: Space,
    /// Added to the coordinates, in their units.
    pub offset: [f64; 3],
}

/// The coordinates of a pattern.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Space {
    /// (u, v, l) of the cylinder.
    Cylinder,
    /// The world's (x, y, z) in metres.
    World,
}

/// Displacement of a pattern's coordinates by three normalised fractal sums.
#[derive(Debug, Clone, PartialEq)]
pub struct Warp {
    /// Cells of the pattern's first octave that a sum of 1 displaces by, 0 to 1000.
    pub amplitude: f64,
    /// Lattice cells per unit of the coordinates in the first octave, each at least 0.
    pub frequency: [f64; 3],
    /// Number of octaves, 1 to 32.
    pub octaves: u32,
    /// Ratio of frequency from octave to octave, above 0.
    pub lacunarity: f64,
    /// Ratio of amplitude from octave to octave, at least 0.
    pub gain: f64,
    /// Chooses the lattices' gradients.
    pub seed: u32,
}

/// What the density means to light. Baking does not read it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Medium {
    /// Extinction per metre at density 1, at least 0.
    pub extinction: f64,
    /// Scattered fraction of the extinction, 0 to 1: linear red, green and blue.
    pub albedo: [f64; 3],
    /// Henyey-Greenstein mean cosine, within -0.999 to 0.999.
    pub anisotropy: f64,
    /// Radiance emitted per metre at density 1, at least 0: linear red, green and blue; times the colour of `temperature`
    /// where that is given.
    pub emission: [f64; 3],
    /// Kelvin of the black body whose colour, scaled to luminance 1, the emission has.
    pub temperature: Option<f64>,
}

/// A view of the scene; absent parts are framed to the bounds. Baking does not read it.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Camera {
    /// How space becomes a picture.
    pub projection: Projection,
    /// Where the eye is, in metres.
    pub position: Option<[f64; 3]>,
    /// The point it looks at, in metres.
    pub look_at: Option<[f64; 3]>,
    /// What is up in the picture; z where absent.
    pub up: Option<[f64; 3]>,
    /// What is seen where there is nothing: linear red, green and blue; `None` where it is transparent.
    pub background: Option<[f64; 3]>,
    /// By how many stops (factors of 2) tone-mapped pictures are brightened; chosen by the picture where absent.
    pub exposure: Option<f64>,
}

/// How space becomes a picture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Projection {
    /// From one point.
    Perspective {
        /// Full horizontal angle of view in degrees, above 0 and below 180.
        fov: Option<f64>,
    },
    /// Along parallel rays.
    Orthographic {
        /// Width of the picture in metres, above 0; framed to the bounds where absent.
        width: Option<f64>,
    },
}

impl Default for Projection {
    fn default() -> Projection {
        Projection::Perspective { fov: None }
    }
}

/// As many suns and points as a scene may have.
pub const MOST_LAMPS: usize = 8;

/// A light. Baking does not read it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Light {
    /// Parallel light that travels along `direction`, of length 1.
    Sun {
        /// The way the light travels.
        direction: [f64; 3],
        /// Irradiance on a plane across the beam, linear red, green and blue, each at least 0.
        irradiance: [f64; 3],
    },
    /// Light from a point, alike to all sides.
    Point {
        /// Where it is, in metres.
        position: [f64; 3],
        /// Radiant intensity (irradiance at one metre), linear red, green and blue, each at least 0.
        intensity: [f64; 3],
    },
    /// Light from everywhere, that nothing shadows.
    Ambient {
        /// Radiance, linear red, green and blue, each at least 0.
        radiance: [f64; 3],
    },
}

impl Scene {
    /// The scene's name, which names the file it is baked to.
    pub fn name(&self) -> &str {
        &self.name
    }
    /// What the command line may override.
    pub fn bake(&self) -> &Bake {
        &self.bake
    }
    /// Frames and seconds.
    pub fn time(&self) -> TimeBase {
        self.time
    }
    /// The scene's time: seconds since its start frame.
    pub fn seconds(&self) -> f64 {
        self.seconds
    }
    /// Whether the text holds numbers or points that change over time. Constant rates, which only move noise within a
    /// tube, are not among them.
    pub fn is_moving(&self) -> bool {
        self.moving
    }
    /// How the densities of several tubes become one.
    pub fn overlap(&self) -> Overlap {
        self.overlap
    }
    /// The tubes, in the order of the text.
    pub fn tubes(&self) -> &[Tube] {
        &self.tubes
    }
    /// What the density means to light.
    pub fn medium(&self) -> Medium {
        self.medium
    }
    /// A view of the scene.
    pub fn camera(&self) -> Camera {
        self.camera
    }
    /// The lights, in the order of the text.
    pub fn lights(&self) -> &[Light] {
        &self.lights
    }
    /// The text that the scene was read from.
    pub fn text(&self) -> &str {
        &self.text
    }
    /// The files that the text names, each once.
    pub fn inputs(&self) -> &[Input] {
        &self.inputs
    }
    /// What in the text is valid, but hardly meant.
    pub fn warnings(&self) -> &Warnings {
        &self.warnings
    }
}
