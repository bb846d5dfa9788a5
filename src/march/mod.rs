//! Pictures of a medium.

mod blackbody;
mod camera;

pub use blackbody::black_body;
pub use camera::{Camera, Ray};
