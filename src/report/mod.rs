//! Metrics: how two fields, or two images, differ.
//!
//! [`compare`] holds two [`Source`]s of numbers over space against each other, densities that are evaluated or grids that are
//! sampled, at points spread evenly over the union of their supports, along rays, and voxel by voxel. [`compare_images`] does
//! so for two images, pixel by pixel and as an observer sees them ([`flip`]). The first of a pair is the truth that the second
//! is measured by: relative differences are parts of it.
//!
//! All places are fixed and all sums are taken in one order, so the same two inputs give the same figures at every run.

mod colour;
mod errors;
mod field;
pub mod flip;
mod image;
mod random;
mod ray;
mod source;
mod support;
#[cfg(test)]
mod tests;
mod voxels;

pub use colour::{from_srgb, tone_map};
pub use errors::{Errors, Intervals, Scaled, intervals};
pub use field::{Depth, FieldDifference, Mass, Places, compare};
pub use image::{ChannelDifference, ImageDifference, Picture, compare_images};
pub use ray::{Chord, chords};
pub use source::{Gridded, Procedural, Source, Voxels};
pub use support::{Rows, Spread, Support, spread};
pub use voxels::{VoxelDifference, voxel_by_voxel};
