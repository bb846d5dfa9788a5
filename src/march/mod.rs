//! Pictures of a medium, a scene's density itself or voxels, through the same camera and lights.
//!
//! # What a picture shows
//!
//! With the density d along a ray from the eye, the extinction `x d`, and the optical depth `t` from the eye to a point, the
//! eye sees
//!
//! ```text
//! L = integral of e^-t x d S ds + e^-T B
//! ```
//!
//! over the whole ray, where T is the optical depth of all of it and B the background. The source S of *single scattering* is
//!
//! ```text
//! S = albedo (sum over lamps of p E e^-t' + ambient) + emission / x
//! ```
//!
//! with p the phase function of Henyey and Greenstein (1941), E a sun's irradiance or a point's intensity over the squared
//! distance, and t' the optical depth from the lamp. Everything is in metres and in linear red, green and blue. The density of
//! voxels is linear along each axis between their centres, and 0 beside them.
//!
//! # How it is found
//!
//! Space is cut into *bricks*, cubes of 8^3 cells of the medium's grid. [`Picture`] finds the bricks that each part of a
//! picture, of 32^2 pixels, sees, in an order in which every ray meets them (`tiles`), and carries all rays of the part through
//! brick after brick, sixteen at once (`rays`, `shade`). So a scene's density is narrowed to a brick once for all of them, and the
//! values of a brick are in the cache while they are used. Rays end when nothing more than the cutoff is left of the light.
//!
//! - Voxels (`baked`): a ray goes from cell to cell. There the density along it is a polynomial of degree 3, which Gauss's rule
//!   of two samples integrates exactly; so the optical depth of voxels has no error but rounding. Or it takes one sample in every
//!   layer of cells (`planes`), which is several times as quick. Voxels of twice, four times or eight times the size (`coarse`)
//!   are there for pictures that are wanted soon.
//! - Scenes (`procedural`): the same rule over equal segments no longer than a step, shorter where it is dense (`steps`). They
//!   begin and end where a ray enters and leaves the tubes (`clip`), by the closed forms of truncated cones along them
//!   (`cones`, and a tree of them in `bvh`). So the error is of order 4 in the step where the density is smooth inside tubes,
//!   and nothing is evaluated outside of them. Other programs' rules are there to be compared with (`methods`, `strides`).
//! - Within a segment the source is linear in the optical depth (`segment`): a uniform source is integrated exactly.
//! - Shadows (`shadow`) are kept as optical depths along rays from the lamps, those of suns on voxels that are sampled in planes
//!   by one sweep through all bricks (`sweep`), or found by a ray from every sample (`exact`), or left out.
//! - Single rays (`walk`, `points`) go through nodes of 16^3 bricks, bricks and cells.
//! - Random paths (`path`), with all light that is scattered, by null collisions below each brick's largest density
//!   (`majorant`).

mod baked;
mod bins;
mod blackbody;
mod bvh;
mod camera;
mod clip;
mod coarse;
mod cones;
mod display;
mod exact;
mod grid;
mod majorant;
mod medium;
#[cfg(test)]
mod memory_tests;
mod methods;
mod nodes;
mod optics;
mod path;
mod picture;
#[cfg(test)]
mod plane_tests;
mod planes;
mod points;
mod procedural;
mod random;
mod rays;
mod segment;
mod shade;
mod shadow;
mod steps;
mod strides;
mod sweep;
mod table;
#[cfg(test)]
mod testing;
#[cfg(test)]
mod tests;
mod tiles;
mod track;
mod walk;

pub use baked::{Baked, BakedError, Meaning, Sampling};
pub use blackbody::black_body;
pub use camera::{Camera, Ray};
pub use cones::{Interval, TubeBounds};
pub use display::Developed;
pub use grid::Grid;
pub use medium::Medium;
pub use methods::{Entry, Intervals, Marching, Method};
pub(crate) use optics::phase;
pub use optics::{Lamp, Optics};
pub use picture::{Film, Integrator, Picture, Quality, Shadow};
pub use procedural::Procedural;
