//! Pictures of a medium.

mod baked;
mod bins;
mod camera;
mod display;
mod grid;
mod medium;
mod optics;
mod picture;
mod procedural;
mod rays;
mod segment;
mod shade;
mod shadow;
mod table;
mod tiles;

pub use baked::{Baked, BakedError, Meaning};
pub use camera::{Camera, Ray};
pub use display::Developed;
pub use grid::Grid;
pub use medium::Medium;
pub use optics::{Lamp, MOST_LAMPS, Optics};
pub use picture::{Film, Picture, Quality};
pub use procedural::Procedural;
