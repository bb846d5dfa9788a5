//! Pictures of a medium.

mod camera;

pub use camera::{Camera, Ray};
