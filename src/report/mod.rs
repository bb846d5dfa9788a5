//! Metrics: how two fields, or two images, differ.
//!
//! [`compare`] holds two [`Source`]s of numbers over space against each other, densities that are evaluated or grids that are
//! sampled, at points spread evenly over the union of their supports, along rays, and voxel by voxel. [`compare_images`] does
//! so for two images, pixel by pixel and as an observer sees them ([`flip`]). The first of a pair is the truth that the second
//! is measured by: relative differences are parts of it.
//!
//! A bake is held against the definition itself ([`Exact`]): [`Survey`] finds its error at a voxel size from the few bricks
//! around points, before it is made, and takes it apart ([`Parts`]); [`Search`] finds the voxel size of an error; [`measure`]
//! measures a file, for its [`Certificate`]; [`content_hash`] and [`rederive`] tell whether a file is what its recipe makes.
//!
//! All places are fixed and all sums are taken in one order, so the same two inputs give the same figures at every run.

mod around;
mod blocks;
mod certificate;
mod colour;
mod errors;
mod exact;
mod field;
pub mod flip;
mod goal;
mod image;
mod octaves;
mod order;
pub mod page;
mod paged;
mod parts;
pub(crate) mod random;
mod ray;
mod search;
mod source;
mod support;
mod survey;
pub mod sweep;
#[cfg(test)]
mod tests;
mod trial;
mod verify;
mod voxels;

pub use around::around;
pub use blocks::ImageIntervals;
pub use certificate::{Certificate, Measured, Reached, measure, measuring};
pub use colour::{from_srgb, tone_map};
pub use errors::{Errors, Intervals, Scaled, intervals};
pub use exact::{Exact, unlimited};
pub use field::{Depth, FieldDifference, Mass, Places, Residuals, compare, compare_at};
pub use goal::{Goal, Metric};
pub use image::{ChannelDifference, ImageDifference, Picture, compare_images};
pub use octaves::{most_octaves, with_octaves};
pub use order::Order;
pub use paged::Leaves;
pub use parts::{Chain, Part, Parts};
pub use ray::{Chord, chords};
pub use search::{Outcome, Search, Step};
pub use source::{Gridded, Procedural, Source, Voxels};
pub use support::{Rows, Spread, Support, spread};
pub use survey::{Look, MARGIN, Survey};
pub use trial::{Lot, Pilot, Trial, TrialError, rows};
pub use verify::{Rederived, content_hash, rederive};
pub use voxels::{VoxelDifference, voxel_by_voxel};
