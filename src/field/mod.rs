//! A scene compiled for evaluation: spans of polynomials, narrowed to a block of voxels, and the one density kernel.
//!
//! # What the density is
//!
//! A tube maps a world point p to cylinder coordinates (u, v, l) by way of its *feet*: the points C(t) of the axis where
//! the distance |C(t) - p| has a local minimum inside a segment, so `(C - p) . C' = 0`. For each foot, with T, N, B the
//! frame there (curve module), s its arc length, L the length of the whole curve and r the radius at s / L:
//!
//! ```text
//! phi = 2 pi (twist s / L + turned)       turned: spin, added up from the start frame to the scene's time
//! U   =  N cos(phi) + B sin(phi)          V = -N sin(phi) + B cos(phi)
//! u   = (p - C) . U / r                   v = (p - C) . V / r
//! l   = s / L where the scene says stretch, else s
//! q   = u^2 + v^2 + w^2                   w = 0 at a foot inside the curve
//! ```
//!
//! The foot counts where q <= 1. Where the radius is below 1e-6 of the tube's largest there is no tube. Beyond an end of
//! the curve a foot exists only with round caps: every point beyond the plane normal to the curve there has the end E as
//! a foot, with its tangent T, U, V and r; u and v are as above with C = E, and `w = (p - E) . T / r`. At a corner, where
//! the tangent changes from T1 to T2 at a joint or in a cusp, the points beyond the plane of T1 and before that of T2
//! have the corner E as a foot: p - E is turned about `T1 x T2` into the plane normal to T1, and u and v are taken there
//! with the first side's frame, so w = 0. A rotation-minimising frame is turned likewise, which makes the coordinates
//! continuous on both sides. (Where the tangent reverses, the axis of that turn is in a cusp
//! the limit of `T1 x T2` beside it, a normal of the plane that the cusp lies in, and in a fold the frame's U.)
//!
//! A closed curve has no ends, and no fade there: its last segment is followed by its first, at a joint like any other. Its
//! frame closes too (`Curve::frame`), so that u and v go on across that joint where the twist is a number of whole turns;
//! l falls from its largest value to 0 there.
//!
//! ```text
//! f_i     = gain * focal(1 - kappa rho cos) * radial(sqrt(q)) * axial(s / L) * layers(u, v, l)      for each foot i
//! tube    = join of f_i over its feet, by the tube's overlap rule
//! density = max(0, join over the tubes, by the scene's)
//! ```
//!
//! - `1 - kappa rho cos = ((C - p) . C'' + |C'|^2) / |C'|^2` is 1 on the axis and 0 where feet meet and vanish;
//!   `focal(x) = smoothstep(0, 0.2, x)` removes the jump there. At ends and corners it is 1.
//! - The joins: *max*, the largest of f_i; *sum*; *closest*, the f_i whose foot is nearest (least rho, the distance to the
//!   axis), with `focal` left out: Moinet's rule, which jumps where two feet are equally far; *blend*, the mean of f_i
//!   with the weights `focal (1 - sqrt(q))^2`. For the join over tubes, a tube's rho is its least and its weight the sum of
//!   its feet's weights. Nothing joined is 0, and so is a mean of no weight.
//! - `gain` is 1 where a tube conserves nothing. With V0 the square of the rest cylinder's radius times its length, and L1
//!   the length of the curve (where the tube is not stretched, both lengths are 1), it is `V0 / (r^2 L1)` where the tube
//!   conserves by radius, and that over `max(1 - kappa rho cos, 0.05)` where it conserves fully. So `gain` is the rest volume over the
//!   deformed one, `dV / dV0 = (1 - kappa rho cos) r^2 ds/dl` (neither twist nor the slope of the radius changes volume).
//! - A tube of a radius r below three voxels of edge h, where the scene widens it: r in all of the above is
//!   `1.5 h + r^2 / (6 h)`, which meets r with its slope at 3 h, with r the tube's own radius, and
//!   where nothing is conserved `gain` is the square of the own radius over the widened one. (Where 1e-6 of the largest
//!   radius is asked about, the own radius is meant.)
//! - `radial(x)`: smooth `(1 - x^2)^2`, linear `1 - x`, hard 1, edge(w) `1 - smoothstep(1 - w, 1, x)`.
//! - `axial(x)` with faded caps over the fraction f: `smoothstep(0, f, x) * smoothstep(0, f, 1 - x)`; else 1.
//! - `layers`: from the value 1, each layer in order joins `multiplier * pattern`, or with a threshold
//!   `multiplier * max(0, pattern - threshold)`, by product, sum, max or min.
//! - `smoothstep(a, b, x)` is `t^2 (3 - 2 t)` with t = (x - a) / (b - a) clamped to [0, 1].
//!
//! A noise layer's pattern is a fractal sum (noise module) over (u, v, l), which runs around a loop where the curve is
//! closed (T is 1 where stretched, else L), or over p in metres where its space is the world. Octave k fades to the weight
//! `1 - smoothstep(log2 0.7, log2 1.6, log2 x_k)` when octaves fade, where `x_k = h lac^k sigma` is in lattice cells per
//! voxel of edge h. In the world sigma is the largest of the layer's frequencies; in the cylinder it is the larger singular
//! value of
//!
//! ```text
//! [ F / r   2 pi twist F sqrt(q) / L ]        F = max(f_u, f_v)
//! [ 0       f_l dl/ds                ]        dl/ds = 1 / L where stretched, else 1
//! ```
//!
//! the rate at which the pattern's coordinates change across and along the tube; bending, the slope of the radius and the
//! layer's warp are left out of it. A warp's octaves fade by the same rule with the warp's own frequency. A normalised
//! sum is divided by the sum of all gain^k, faded or not.
//!
//! The evaluation below leaves out octaves that single precision cannot place: of more than 2^22 cells per unit across
//! the tube or around a loop, of more than 2^19 cells per voxel along the tube or in the world, and those that a warp's
//! sum of 1 moves by more than 2^22 of their cells. Like one that has faded, such an octave adds its mean. The reference
//! has them.
//!
//! # Mass
//!
//! Before it is deformed, a tube is a straight cylinder of the rest radius and of the rest length (where it is not
//! stretched, of the curve's), with the density `max(0, radial(sqrt(q)) * axial(s / L) * layers(u, v, l))`. Octaves fade as
//! they do after it, and a pattern over the world is the one at the place where a point comes to lie. The integral of that,
//! in metres^3 since density has no unit, is the tube's *mass at rest*; those of all tubes add up. What lies at
//! `kappa rho cos >= 1`, or where there is no tube because of its radius, has no image and is *lost*. A volume elsewhere
//! becomes `(1 - kappa rho cos) r^2 L / V0` of itself (V0 with the cylinder's true length), its density `gain * focal` of
//! itself: the integral of both over the cylinder is the mass to *expect* of a tube without round ends or corners whose
//! feet meet neither each other nor those of another tube.
//!
//! # Edges
//!
//! Where the density jumps, or falls so steeply that a voxel's centre cannot stand for its cell, there is an *edge*:
//!
//! - the surface of a hard envelope, and the outer part of a soft one that is narrower than two voxels;
//! - a flat end; a faded one shorter than two voxels;
//! - the planes between sectors;
//! - where the radius jumps by more than a twentieth of itself, or changes by more than half within a voxel.
//!
//! Noise has none, nor have the places where one foot takes over from another. What a voxel of a bake stores beside an edge
//! is defined with [`bake`](crate::volume::bake()); the density at a point is that above.
//!
//! # How it is evaluated
//!
//! [`Field::compile`] cuts every axis into *spans* on which the frame over the radius, and the arc length, are
//! polynomials of degree 5 to within 3e-7. [`Field::cover`] lists short capsules that hold all of the density, for the
//! plan; `hulls` holds it more closely, for rays. [`Field::narrow`] takes the parts of the axis whose capsules reach a block of voxels, proves in f64 which of
//! them can hold feet of its voxels and whether they hold at most one for each, and leaves a [`Region`]: polynomials
//! re-centred on the block, so that single precision suffices wherever the block lies and however large the scene is.
//! [`kernel`] then works through all voxels of the block.

mod batch;
mod bound;
mod bounds;
mod cover;
mod detail;
mod edges;
pub mod every;
mod explain;
mod extent;
mod feet;
mod hulls;
mod join;
pub mod kernel;
mod layers;
mod narrow;
mod near;
mod pattern;
mod radius;
mod region;
pub mod rest;
mod span;
mod tube;

pub use cover::Capsule;
pub use extent::{extent, extent_around};
pub(crate) use hulls::{Ball, Cone, Hull};
pub use narrow::Candidate;
pub use region::Region;

use crate::scene::{Antialias, Overlap, Scene};
use tube::Tube;

/// The cubic arrangement of voxels: voxel i along an axis is the cell from `i h` to `(i + 1) h` and its sample is the
/// cell's centre. The lattice hangs from the world's origin, so that two bakes of one voxel size line up.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lattice {
    /// Edge of a voxel in metres.
    pub voxel_size: f64,
}

/// The part of a block that feet are sought for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Extent {
    /// The box of its voxels' centres.
    Centres,
    /// All of it.
    Whole,
}

impl Extent {
    /// Half its edge, in voxels.
    pub(crate) fn half_edge(self) -> f64 {
        match self {
            Extent::Centres => 3.5,
            Extent::Whole => 4.0,
        }
    }
}

/// Voxels along an edge of a block.
pub const EDGE: usize = 8;
/// Voxels in a block.
pub const VOXELS: usize = EDGE * EDGE * EDGE;

/// A scene at one time, compiled for evaluation.
#[derive(Debug, Clone)]
pub struct Field {
    tubes: Vec<Tube>,
    overlap: Overlap,
    octave_fade: bool,
    widen: bool,
    antialias: Antialias,
}

impl Field {
    /// Compiles the scene as it is at its time. Stages that it does not use are left out.
    pub fn compile(scene: &Scene) -> Field {
        let bake = scene.bake();
        let tubes = scene.tubes().iter().map(|tube| Tube::compile(tube, bake.octave_fade)).collect();
        Field {
            tubes,
            overlap: scene.overlap(),
            octave_fade: bake.octave_fade,
            widen: bake.widen,
            antialias: bake.antialias,
        }
    }

    /// About how many bytes the field of a scene takes, and the scene's curves with it, found without compiling all of it.
    pub fn estimate_memory(scene: &Scene) -> usize {
        scene.tubes().iter().map(|tube| tube.curve.memory() + Tube::estimate_memory(tube)).sum()
    }

    /// Widens what is too thin for a lattice, where the scene says so. Without this the field is that of an endlessly fine
    /// lattice, octaves apart.
    pub fn widen(&mut self, lattice: Lattice) {
        if self.widen {
            for tube in &mut self.tubes {
                tube.widen(lattice.voxel_size);
            }
        }
    }
}
