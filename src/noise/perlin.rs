//! One octave.

use std::hint::black_box;

use crate::num::Real;

/// No value of the noise is larger in magnitude: the supremum over all gradients is 1.036353811, where the corners'
/// gradients are chosen against a point near (0.355, 0.481, 0.5).
pub const BOUND: f64 = 1.036_353_82;

const X_PRIME: u32 = 0x9E37_79B1;
const Y_PRIME: u32 = 0x85EB_CA77;
const Z_PRIME: u32 = 0xC2B2_AE3D;
const FINISH: u32 = 0x27D4_EB2F;
/// A third of the range of signed integers.
const THIRD: u32 = 715_827_882;

/// Noise at the lattice coordinates `cell + p`, as the module defines it.
///
/// `|p|` must stay below 2^31; its fraction is as precise as `R` holds it.
#[inline(always)]
pub fn perlin<R: Real>(token: R::Token, cell: [u32; 3], p: [R; 3], seed: u32) -> R {
    perlin_around(token, cell, p, seed, None)
}

/// The number of cells after which a lattice repeats along its third axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Period<T> {
    /// A whole number from 1 to 2^22.
    pub cells: T,
    /// The cell that stands in the place of `cell[2]`: whole, at least 0 and below `cells`.
    pub first: T,
}

/// The same, on a lattice that repeats along its third axis if there is a period.
///
/// `|p|` along that axis must then stay below 2^23.
#[inline(always)]
pub fn perlin_around<R: Real>(
    token: R::Token,
    cell: [u32; 3],
    p: [R; 3],
    seed: u32,
    period: Option<Period<R::Scalar>>,
) -> R {
    let zs = third_hash(token, cell[2], p[2], period);
    Cell::new(token, [cell[0], cell[1]], p, zs, seed).noise(token)
}

/// Hash terms of the cell at the third coordinate `z` and of the next.
#[inline(always)]
pub(super) fn third_hash<R: Real>(
    token: R::Token,
    cell: u32,
    z: R,
    period: Option<Period<R::Scalar>>,
) -> (R::Bits, R::Bits) {
    match period {
        None => axis_hash::<R>(token, z.floor(), cell, Z_PRIME, 0),
        Some(period) => loop_hash::<R>(token, z.floor(), period, Z_PRIME),
    }
}

/// A point's place in the lattice: its offsets from the corners around it, and the corners' hashes but for the last step.
///
/// It depends on the point alone and can be made while the noise at another is blended, which is a chain of operations that
/// wait for each other.
#[derive(Debug, Clone, Copy)]
pub struct Cell<R: Real> {
    /// From the lower and the upper corners.
    offset: [[R; 3]; 2],
    /// Hash terms along the first axis, and of the other two together: of the second axis' lower and upper corners with the
    /// third's lower, then with its upper.
    x: (R::Bits, R::Bits),
    yz: [R::Bits; 4],
}

impl<R: Real> Cell<R> {
    /// With the hash terms along the third axis given.
    #[inline(always)]
    pub(super) fn new(
        token: R::Token,
        cell: [u32; 2],
        p: [R; 3],
        zs: (R::Bits, R::Bits),
        seed: u32,
    ) -> Cell<R> {
        let floor = [p[0].floor(), p[1].floor(), p[2].floor()];
        let one = R::constant(token, 1.0);
        let lower = [p[0] - floor[0], p[1] - floor[1], p[2] - floor[2]];
        let upper = [lower[0] - one, lower[1] - one, lower[2] - one];
        let x = axis_hash::<R>(token, floor[0], cell[0], X_PRIME, seed);
        let ys = axis_hash::<R>(token, floor[1], cell[1], Y_PRIME, 0);
        let yz = [
            R::bits_xor(ys.0, zs.0),
            R::bits_xor(ys.1, zs.0),
            R::bits_xor(ys.0, zs.1),
            R::bits_xor(ys.1, zs.1),
        ];
        Cell { offset: [lower, upper], x, yz }
    }

    /// The noise there.
    #[inline(always)]
    pub(super) fn noise(&self, token: R::Token) -> R {
        let [[x0, y0, z0], [x1, y1, z1]] = self.offset;
        let (x, yz) = (&self.x, &self.yz);
        // Hidden from the compiler, which would make one multiplication and two shifts three multiplications.
        let finish = R::bits_splat(token, black_box(FINISH));
        // All corners before any is blended: so in order, the processor overlaps more of their work.
        let n = [
            corner(token, finish, x.0, yz[0], [x0, y0, z0]),
            corner(token, finish, x.1, yz[0], [x1, y0, z0]),
            corner(token, finish, x.0, yz[1], [x0, y1, z0]),
            corner(token, finish, x.1, yz[1], [x1, y1, z0]),
            corner(token, finish, x.0, yz[2], [x0, y0, z1]),
            corner(token, finish, x.1, yz[2], [x1, y0, z1]),
            corner(token, finish, x.0, yz[3], [x0, y1, z1]),
            corner(token, finish, x.1, yz[3], [x1, y1, z1]),
        ];
        let (u, v, w) = (fade(token, x0), fade(token, y0), fade(token, z0));
        let (n00, n10) = (mix(n[0], n[1], u), mix(n[2], n[3], u));
        let (n01, n11) = (mix(n[4], n[5], u), mix(n[6], n[7], u));
        mix(mix(n00, n10, v), mix(n01, n11, v), w)
    }
}

/// Hash terms of a cell and of the next along one axis.
#[inline(always)]
fn axis_hash<R: Real>(token: R::Token, floor: R, cell: u32, prime: u32, seed: u32) -> (R::Bits, R::Bits) {
    let prime_lanes = R::bits_splat(token, prime);
    let low = R::bits_add(
        R::bits_mul(floor.lattice(), prime_lanes),
        R::bits_splat(token, cell.wrapping_mul(prime)),
    );
    let high = R::bits_add(low, prime_lanes);
    let seed = R::bits_splat(token, seed);
    let (low, high) = (R::bits_xor(low, seed), R::bits_xor(high, seed));
    (R::bits_xor(low, R::bits_shr16(low)), R::bits_xor(high, R::bits_shr16(high)))
}

/// The same on a lattice that repeats.
///
/// Every number here is whole and below 2^24, so exact. The quotient of one by the period rounds to a whole number only
/// where it is one: others are at least 1 / period away from it, more than half a unit in the last place.
#[inline(always)]
fn loop_hash<R: Real>(
    token: R::Token,
    floor: R,
    period: Period<R::Scalar>,
    prime: u32,
) -> (R::Bits, R::Bits) {
    let cells = R::splat(token, period.cells);
    let at = floor + R::splat(token, period.first);
    let low = at - (at / cells).floor() * cells;
    let next = low + R::constant(token, 1.0);
    let high = R::select(next.lt(cells), next, R::constant(token, 0.0));
    let prime = R::bits_splat(token, prime);
    let (low, high) = (R::bits_mul(low.lattice(), prime), R::bits_mul(high.lattice(), prime));
    (R::bits_xor(low, R::bits_shr16(low)), R::bits_xor(high, R::bits_shr16(high)))
}

/// Gradient of a corner times the offset `d` from it.
#[inline(always)]
fn corner<R: Real>(token: R::Token, finish: R::Bits, x: R::Bits, yz: R::Bits, d: [R; 3]) -> R {
    let hash = R::bits_mul(R::bits_xor(x, yz), finish);
    let xy = R::bits_lt_signed(hash, R::bits_splat(token, THIRD.wrapping_neg()));
    let yz = R::bits_lt_signed(R::bits_splat(token, THIRD), hash);
    let first = R::select(yz, d[1], d[0]);
    let second = R::select(xy, d[1], d[2]);
    first.flip::<9>(hash) + second.flip::<10>(hash)
}

/// `6 t^5 - 15 t^4 + 10 t^3`, in powers of t - 1/2: those of t lose three bits to cancellation near 1.
#[inline(always)]
fn fade<R: Real>(token: R::Token, t: R) -> R {
    let half = R::constant(token, 0.5);
    let s = t - half;
    let s2 = s * s;
    let even = (R::constant(token, 6.0) * s2 - R::constant(token, 5.0)) * s2 + R::constant(token, 1.875);
    s * even + half
}

#[inline(always)]
fn mix<R: Real>(a: R, b: R, t: R) -> R {
    a + t * (b - a)
}
