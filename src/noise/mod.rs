//! Improved Perlin noise (Perlin, "Improving noise", 2002) over an integer hash, and fractal sums of it.
//!
//! # Definition
//!
//! All integers are `u32` and wrap. For lattice corner (i, j, k), each taken modulo 2^32, and a seed e:
//!
//! ```text
//! a = i * 0x9E3779B1 ^ e      b = j * 0x85EBCA77      c = k * 0xC2B2AE3D
//! a ^= a >> 16                b ^= b >> 16            c ^= c >> 16
//! h = (a ^ b ^ c) * 0x27D4EB2F
//! ```
//!
//! The gradient is one of the twelve edges of the cube. With h read as a signed number, the pair of axes is
//! (x, y) below -715827882, (y, z) above 715827882, and (x, z) between; bit 22 of h set negates the pair's first
//! component, bit 21 its second. Twelve edges of equal weight leave no axis preferred, as the usual sixteen-entry table
//! does. The noise is the sum over the eight corners of gradient . (p - corner), blended by the quintic
//! `6 t^5 - 15 t^4 + 10 t^3` along each axis. It is not rescaled: |n| <= 1.03635381.
//!
//! Octave k of a fractal sum with seed s takes `n(f lac^k (u, v, l) - scrolled lac^k + o_k; e_k) * gain^k`, where f
//! is the layer's frequency, scrolled its scroll added up from the start frame to the scene's time, and
//!
//! ```text
//! mix(x): x ^= x >> 16; x *= 0x7FEB352D; x ^= x >> 15; x *= 0x846CA68B; x ^= x >> 16
//! e_k = mix(s * 0x9E3779B9 + 4 k)      o_k[axis] = mix(s * 0x9E3779B9 + 4 k + 1 + axis) / 2^32
//! ```
//!
//! so that octaves neither repeat each other nor share a zero at the origin.
//!
//! # Precision
//!
//! A lattice coordinate is a whole cell, held modulo 2^32, and a remainder beside it. Kernels add the coordinate's
//! change across a block, which is small, to the remainder: an error of single precision then does not grow with the
//! distance from the origin. The pattern repeats after 2^32 cells.

mod fractal;
mod perlin;

pub use fractal::{BAND, Octave, band_weight, octave_offset, octave_seed};
pub use perlin::{BOUND, perlin};
