//! Bakes procedural density, sculpted along spline tubes, into sparse volume grids.
//!
//! The modules are the stages that data passes through, in this order; each imports only from those before it:
//!
//! | module | stage |
//! |---|---|
//! | [`num`] | sixteen `f32` lanes or one `f64` behind one trait, and the elementary functions whose bits reach a file |
//! | [`curve`] | Bezier chains: arc length, frames |
//! | [`noise`] | Perlin noise and fractal sums of it |
//! | [`scene`] | text to a [`scene::Scene`], which cannot be invalid |
//! | [`field`] | a scene compiled to spans of polynomials; narrowed to a block; the density kernel |
//! | [`mod@reference`] | a second, slow evaluator that shares no formula code with `field` |
//! | [`volume`] | the plan of candidate bricks, their evaluation, the sinks they go to; sparse trees and their sampling |
//! | [`march`] | cameras, lights, and how light goes through a medium: pictures |
//! | [`formats`] | file formats, over `Write` and `Read`, never a path |
//! | [`report`] | metrics: how fields, and images, differ |
//! | [`check`] | stiff and extreme cases, and what of a scene is hazardous |
//! | [`cli`] | arguments, files, progress and exit codes; no numerics |
//!
//! Space is right-handed, z up, in metres and seconds. Vectors are columns.

pub mod check;
pub mod cli;
pub mod curve;
pub mod field;
pub mod formats;
pub mod march;
pub mod noise;
pub mod num;
pub mod reference;
pub mod report;
pub mod scene;
pub mod volume;
