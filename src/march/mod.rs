//! Pictures of a medium.

mod baked;
mod bins;
mod camera;
mod display;
mod exact;
mod grid;
mod majorant;
mod medium;
mod nodes;
mod optics;
mod path;
mod picture;
mod points;
mod procedural;
mod random;
mod rays;
mod segment;
mod shade;
mod shadow;
mod table;
#[cfg(test)]
mod testing;
mod tiles;
mod track;
mod walk;

pub use baked::{Baked, BakedError, Meaning};
pub use camera::{Camera, Ray};
pub use display::Developed;
pub use grid::Grid;
pub use medium::Medium;
pub use optics::{Lamp, MOST_LAMPS, Optics};
pub use picture::{Film, Integrator, Picture, Quality, Shadow};
pub use procedural::Procedural;
