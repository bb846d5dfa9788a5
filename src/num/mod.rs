//! Arithmetic that the kernels are written over, and the polynomial tools that set them up.

pub mod poly;
pub mod quadrature;
mod real;

pub use real::{F32x16, Level, Real, SLIGHT, Scalar, WithLevel, with_level};
