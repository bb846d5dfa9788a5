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
//! Octave k of a fractal sum with seed s, at coordinates c, adds `gain^k g(n(x_k; e_k))`, where
//!
//! ```text
//! x_k = R_k (f_k (c + offset) - moved_k) + o_k        f_k = f lac^k      moved_k = scrolled lac^k
//! mix(x): x ^= x >> 16; x *= 0x7FEB352D; x ^= x >> 15; x *= 0x846CA68B; x ^= x >> 16
//! e_k = mix(s * 0x9E3779B9 + 4 k)      o_k[axis] = mix(s * 0x9E3779B9 + 4 k + 1 + axis) / 2^32
//! ```
//!
//! (products axis by axis; `scrolled` is the scroll added up from the start frame to the scene's time), so that octaves
//! neither repeat each other nor share a zero at the origin.
//!
//! - *Form*: g(n) is n for fBm; |n| for billow, the octave of Perlin's turbulence ("An image synthesizer", 1985); and
//!   `(1 - |n|)^2` for ridged, the ridge of Musgrave's ridged multifractal (Ebert et al., "Texturing and modeling", 2003,
//!   chapter 16) without its feedback from octave to octave. Where an octave fades to the weight w, it adds
//!   `gain^k (m + w (g(n) - m))` instead, with m the mean of g(n) over all gradients and places, so that fading takes
//!   detail and not brightness: 0, E|n| = [`MEAN_MAGNITUDE`], and 1 - 2 E|n| + E n^2, where E n^2 = 16 (535 / 18018) (181 /
//!   462)^2.
//! - *Turns*: R_k is the unit matrix, or where the lattices are turned, so that their axes do not show, the rotation by the
//!   quaternion (w, x, y, z) whose components are 2 b - 255 for the four bytes b, from the lowest, of
//!   `mix(0x51ED270B + 256 k + j)`. There j is the first of 0, 1, ... for which
//!   `128^2 <= w^2 + x^2 + y^2 + z^2 <= 255^2` and no entry of R_k exceeds 0.9 in magnitude: no axis of an octave comes
//!   within 25 degrees of the coordinates' own. Around a loop x and y are 0, and the entries are those across.
//! - *Loops*: where the third coordinate runs once around a closed curve as it grows by T, octave k has
//!   `P_k = max(1, round(f lac^k T))` cells around (half away from zero), so `f_k = P_k / T` and `moved_k = scrolled P_k /
//!   P_0` along it, and the third index of a corner is taken modulo P_k: whatever the offset and the scroll, the pattern
//!   closes. A scroll of whole periods of the first octave is one of all octaves. Where f is 0 nothing changes around the
//!   loop, and this has nothing to do.
//! - *Warp*: before that, c is moved by `(A / f[axis]) w[axis]` along every axis with f >= 1e-9 (around a loop, `A T / P_0`), A
//!   being the warp's amplitude in cells of the first octave. `w[axis]` is an fBm of the warp's own frequency, octaves, gain
//!   and lacunarity over the same coordinates, normalised, with the seed `mix(s ^ (0x68E31DA4 + axis))` for the warp's
//!   seed s; its octaves are turned, closed and faded like the sum's. The warp moves along with the pattern: it has
//!   moved by `scrolled f_warp / f` of its cells along these axes, else not at all.
//!
//! # Precision
//!
//! A lattice coordinate is a whole cell, held modulo 2^32, and a remainder beside it. Kernels add the coordinate's
//! change across a block, which is small, to the remainder: an error of single precision then does not grow with the
//! distance from the origin. The pattern repeats after 2^32 cells.

mod form;
mod fractal;
mod perlin;
mod turn;

pub use form::{Form, MEAN_MAGNITUDE};
pub use fractal::{BAND, Octave, band_weight, octave_offset, octave_seed, warp_seed};
pub use perlin::{BOUND, Cell, Period, perlin, perlin_around};
pub use turn::{turn, turn_around};
