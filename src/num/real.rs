//! One arithmetic trait, two implementations: sixteen `f32` lanes, or one `f64`.
//!
//! Kernels are written once over [`Real`]. With [`F32x16`] they are the product; with `f64` they check its rounding.
//! Sixteen lanes at every instruction set give every processor the same order of work, so the same bits. For the same
//! reason there is no fused multiply-add, no approximate reciprocal, and minimum and maximum are selections, since processors
//! disagree about NaN and signed zero: x86 has them as instructions, others may not.
//!
//! Generic code gets an instruction set only by being inlined into the function that enables it: every function that
//! takes a [`Real`] must be `#[inline(always)]`, and kernels hold no closures and no iterator adaptors.

use std::ops::{Add, Div, Mul, Neg, Sub};

use fearless_simd::{
    Bytes, Select, Simd, SimdBase, SimdCombine, SimdFloat, SimdInt, SimdMask, SimdSplit, f32x4, f32x8,
    f32x16, i32x16, mask32x16, u32x16,
};

/// The product's arithmetic: sixteen `f32` lanes at the instruction set of `S`.
pub type F32x16<S> = f32x16<S>;

/// An instruction set that this processor has.
#[derive(Debug, Clone, Copy)]
pub struct Level(fearless_simd::Level);

impl Level {
    /// The best that this processor has.
    pub fn best() -> Level {
        Level(fearless_simd::Level::new())
    }

    /// All that this processor has and the program is compiled for, from the least to the best: bits do not depend on
    /// which of them does the work.
    pub fn all() -> Vec<Level> {
        let best = Level::best();
        #[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
        let levels = [
            best.0.as_sse2().map(fearless_simd::Level::Sse2),
            best.0.as_sse4_2().map(fearless_simd::Level::Sse4_2),
            best.0.as_avx2().map(fearless_simd::Level::Avx2),
            best.0.as_avx512().map(fearless_simd::Level::Avx512),
        ];
        #[cfg(not(any(target_arch = "x86", target_arch = "x86_64")))]
        let levels = [Some(best.0)];
        levels.into_iter().flatten().map(Level).collect()
    }

    /// A short name such as `avx2`.
    pub fn name(self) -> String {
        let debug = format!("{:?}", self.0);
        debug.split('(').next().unwrap_or_default().to_lowercase()
    }
}

/// Code to be compiled once for every instruction set.
pub trait WithLevel {
    /// What it returns.
    type Output;
    /// Runs it with sixteen-lane arithmetic `R`; must be `#[inline(always)]`.
    fn run<R: Real<Scalar = f32>>(self, token: R::Token) -> Self::Output;
}

/// Runs `code` compiled for the instruction set `level`.
#[inline(always)]
pub fn with_level<W: WithLevel>(level: Level, code: W) -> W::Output {
    fearless_simd::dispatch!(level.0, simd => run_with(simd, code))
}

#[inline(always)]
fn run_with<S: Simd, W: WithLevel>(simd: S, code: W) -> W::Output {
    code.run::<f32x16<S>>(simd)
}

/// Part of a turn within which a few terms are enough for sine and cosine.
pub const SLIGHT: f64 = 1.0 / 24.0;

/// A number as it lies in memory: `f32` or `f64`.
pub trait Scalar:
    Copy + Default + PartialOrd + Add<Output = Self> + Mul<Output = Self> + Send + Sync + 'static
{
    /// Rounds to the nearest.
    fn from_f64(x: f64) -> Self;
    /// Exact.
    fn to_f64(self) -> f64;
}

impl Scalar for f32 {
    #[inline(always)]
    #[allow(
        clippy::cast_possible_truncation,
        reason = "the one place where double becomes single: rounding is meant"
    )]
    fn from_f64(x: f64) -> f32 {
        x as f32
    }
    #[inline(always)]
    fn to_f64(self) -> f64 {
        f64::from(self)
    }
}

impl Scalar for f64 {
    #[inline(always)]
    fn from_f64(x: f64) -> f64 {
        x
    }
    #[inline(always)]
    fn to_f64(self) -> f64 {
        self
    }
}

/// Lanes of floating-point numbers.
///
/// `Token` proves that the instruction set is there; it is handed to whatever makes lanes out of nothing.
pub trait Real:
    Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Div<Output = Self> + Neg<Output = Self>
{
    /// One lane in memory.
    type Scalar: Scalar;
    /// Proof of the instruction set.
    type Token: Copy;
    /// As many `u32`, wrapping.
    type Bits: Copy;
    /// As many booleans.
    type Mask: Copy;
    /// Number of lanes.
    const LANES: usize;

    /// `x` in every lane.
    fn splat(token: Self::Token, x: Self::Scalar) -> Self;
    /// A literal, rounded once, in every lane.
    #[inline(always)]
    fn constant(token: Self::Token, x: f64) -> Self {
        Self::splat(token, Self::Scalar::from_f64(x))
    }
    /// The first `LANES` elements of `from`, which has as many.
    fn load(token: Self::Token, from: &[Self::Scalar]) -> Self;
    /// Writes the lanes to the first `LANES` elements of `to`, which has as many.
    fn store(self, to: &mut [Self::Scalar]);
    /// The lanes of `mask` moved to the front, in order; what follows them is unspecified.
    fn compress(self, mask: Self::Mask) -> Self;

    /// The opposite of [`Real::compress`]: the first lanes, in order, moved to where `mask` is set; 0 elsewhere.
    fn expand(self, mask: Self::Mask) -> Self;

    /// The first quarters of both, then their second quarters; and the same of the third and the fourth. (A single lane has none:
    /// both are returned as they are.)
    fn zip_quarters(self, other: Self) -> [Self; 2];

    /// The four numbers from each lane's place in `from` on: the first of every lane, the second, and so on. Places too near to
    /// its end are taken to be the last from which there are four.
    fn runs<const N: usize>(token: Self::Token, from: &[Self::Scalar; N], places: Self::Bits) -> [Self; 4];

    /// Largest whole number not above each lane.
    fn floor(self) -> Self;
    /// Correctly rounded square root.
    fn sqrt(self) -> Self;
    /// Magnitude.
    fn abs(self) -> Self;
    /// Logarithm to base 2 of positive normal numbers, absolute error below 1e-6 (`f32`) or correctly rounded within
    /// one unit (`f64`); finite garbage at 0.
    fn log2(self) -> Self;

    /// Two to the power of each lane, taken within -126 to 126: relative error below 2e-7 (`f32`), or of the `libm` crate
    /// (`f64`).
    fn exp2(self, token: Self::Token) -> Self;

    /// Sine and cosine of so many turns: absolute error below 3e-7 (`f32`) plus 2 pi times the
    /// rounding of the turns, or of the `libm` crate (`f64`).
    fn sin_cos_turns(self, token: Self::Token) -> (Self, Self);
    /// The same of no more than an eighth of a turn either way: absolute error below 1.5e-7 (`f32`).
    fn sin_cos_eighth(self, token: Self::Token) -> (Self, Self);
    /// The same of no more than [`SLIGHT`] either way: absolute error below 1e-7 (`f32`).
    fn sin_cos_slight(self, token: Self::Token) -> (Self, Self);

    /// Lane-wise `self < other`; false with NaN.
    fn lt(self, other: Self) -> Self::Mask;
    /// Lane-wise `self <= other`; false with NaN.
    fn le(self, other: Self) -> Self::Mask;
    /// `a` where the mask is set, else `b`.
    fn select(mask: Self::Mask, a: Self, b: Self) -> Self;
    /// Both.
    fn and(a: Self::Mask, b: Self::Mask) -> Self::Mask;
    /// Either.
    fn or(a: Self::Mask, b: Self::Mask) -> Self::Mask;
    /// The opposite.
    fn not(a: Self::Mask) -> Self::Mask;
    /// Lane i as bit i.
    fn bitmask(mask: Self::Mask) -> u32;
    /// Bit i as lane i.
    fn from_bitmask(token: Self::Token, bits: u32) -> Self::Mask;

    /// A floored value, magnitude below 2^31, as a two's complement integer.
    fn lattice(self) -> Self::Bits;
    /// `x` in every lane.
    fn bits_splat(token: Self::Token, x: u32) -> Self::Bits;
    /// Wrapping sum.
    fn bits_add(a: Self::Bits, b: Self::Bits) -> Self::Bits;
    /// Wrapping product.
    fn bits_mul(a: Self::Bits, b: Self::Bits) -> Self::Bits;
    /// Exclusive or.
    fn bits_xor(a: Self::Bits, b: Self::Bits) -> Self::Bits;
    /// Logical shift right by sixteen.
    fn bits_shr16(a: Self::Bits) -> Self::Bits;
    /// `a < b` as signed numbers.
    fn bits_lt_signed(a: Self::Bits, b: Self::Bits) -> Self::Mask;
    /// Changes sign where bit `31 - SHIFT` of `bits` is set.
    fn flip<const SHIFT: u32>(self, bits: Self::Bits) -> Self;

    /// The smaller; `other` where they do not compare.
    #[inline(always)]
    fn least(self, other: Self) -> Self {
        Self::select(self.lt(other), self, other)
    }
    /// The larger; `other` where they do not compare.
    #[inline(always)]
    fn most(self, other: Self) -> Self {
        Self::select(other.lt(self), self, other)
    }
    /// Between `lo` and `hi`; `lo` for NaN.
    #[inline(always)]
    fn within(self, lo: Self, hi: Self) -> Self {
        self.most(lo).least(hi)
    }
}

/// The first halves of both, then their second halves.
#[inline(always)]
fn zip_halves<S: Simd>(a: f32x8<S>, b: f32x8<S>) -> f32x16<S> {
    let (a, b) = (a.split(), b.split());
    a.0.combine(b.0).combine(a.1.combine(b.1))
}

/// Four numbers from a place on.
#[inline(always)]
fn four<S: Simd, const N: usize>(token: S, from: &[f32; N], place: u32) -> f32x4<S> {
    let place = (place as usize).min(N - 4);
    f32x4::from_slice(token, &from[place..place + 4])
}

/// The first of the four numbers from each of four places on, the second, and so on.
#[inline(always)]
fn turned<S: Simd, const N: usize>(token: S, from: &[f32; N], places: [u32; 4]) -> [f32x4<S>; 4] {
    let (a, b) = (four(token, from, places[0]), four(token, from, places[1]));
    let (c, d) = (four(token, from, places[2]), four(token, from, places[3]));
    let (even, odd) = (a.zip_low(c), b.zip_low(d));
    let (even_high, odd_high) = (a.zip_high(c), b.zip_high(d));
    [even.zip_low(odd), even.zip_high(odd), even_high.zip_low(odd_high), even_high.zip_high(odd_high)]
}

/// Whether the instructions for minimum and maximum are those selections: the second operand where neither is smaller.
const SELECTS: bool = cfg!(target_arch = "x86_64");

impl<S: Simd> Real for f32x16<S> {
    type Scalar = f32;
    type Token = S;
    type Bits = u32x16<S>;
    type Mask = mask32x16<S>;
    const LANES: usize = 16;

    #[inline(always)]
    fn splat(token: S, x: f32) -> Self {
        <Self as SimdBase<S>>::splat(token, x)
    }
    #[inline(always)]
    fn load(token: S, from: &[f32]) -> Self {
        Self::from_slice(token, &from[..16])
    }
    #[inline(always)]
    fn store(self, to: &mut [f32]) {
        self.store_slice(&mut to[..16]);
    }
    #[inline(always)]
    fn compress(self, mask: Self::Mask) -> Self {
        <Self as SimdBase<S>>::compress(self, mask)
    }
    #[inline(always)]
    fn expand(self, mask: Self::Mask) -> Self {
        <Self as SimdBase<S>>::expand(self, mask)
    }
    #[inline(always)]
    fn zip_quarters(self, other: Self) -> [Self; 2] {
        let (a, b) = (self.split(), other.split());
        [zip_halves(a.0, b.0), zip_halves(a.1, b.1)]
    }
    #[inline(always)]
    fn runs<const N: usize>(token: S, from: &[f32; N], places: u32x16<S>) -> [Self; 4] {
        let mut lanes = [0_u32; 16];
        places.store_slice(&mut lanes);
        let a = turned(token, from, [lanes[0], lanes[1], lanes[2], lanes[3]]);
        let b = turned(token, from, [lanes[4], lanes[5], lanes[6], lanes[7]]);
        let c = turned(token, from, [lanes[8], lanes[9], lanes[10], lanes[11]]);
        let d = turned(token, from, [lanes[12], lanes[13], lanes[14], lanes[15]]);
        [
            a[0].combine(b[0]).combine(c[0].combine(d[0])),
            a[1].combine(b[1]).combine(c[1].combine(d[1])),
            a[2].combine(b[2]).combine(c[2].combine(d[2])),
            a[3].combine(b[3]).combine(c[3].combine(d[3])),
        ]
    }
    #[inline(always)]
    fn floor(self) -> Self {
        <Self as SimdFloat<S>>::floor(self)
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        <Self as SimdFloat<S>>::sqrt(self)
    }
    #[inline(always)]
    fn abs(self) -> Self {
        <Self as SimdBase<S>>::abs(self)
    }
    #[inline(always)]
    fn log2(self) -> Self {
        // x = 2^e m with m in [sqrt(1/2), sqrt(2)), log2 m = (2 / ln 2) artanh((m - 1) / (m + 1)), five terms: the
        // sixth is below 1e-9.
        let bits: u32x16<S> = self.to_bits();
        let shifted = bits - 0x3f35_04f3;
        let exponent: i32x16<S> = shifted.bitcast::<i32x16<S>>() >> 23;
        let mantissa: Self = ((shifted & 0x007f_ffff) + 0x3f35_04f3).bitcast();
        let t = (mantissa - 1.0) / (mantissa + 1.0);
        let t2 = t * t;
        let series =
            ((((t2 * (1.0 / 9.0) + (1.0 / 7.0)) * t2 + (1.0 / 5.0)) * t2 + (1.0 / 3.0)) * t2 + 1.0) * t;
        exponent.to_float::<Self>() + series * (2.0 * std::f32::consts::LOG2_E)
    }
    #[inline(always)]
    fn exp2(self, token: S) -> Self {
        // Taylor's series around the nearest whole number: the first term left out is (ln 2 / 2)^8 / 8! < 6e-9.
        let splat = |x: f32| <Self as SimdBase<S>>::splat(token, x);
        let x = self.within(splat(-126.0), splat(126.0));
        let whole = SimdFloat::floor(x + 0.5);
        let t = (x - whole) * std::f32::consts::LN_2;
        let series = ((((((t * (1.0 / 5040.0) + (1.0 / 720.0)) * t + (1.0 / 120.0)) * t + (1.0 / 24.0))
            * t
            + (1.0 / 6.0))
            * t
            + 0.5)
            * t
            + 1.0)
            * t
            + 1.0;
        let exponent: u32x16<S> = whole.to_int::<i32x16<S>>().bitcast();
        let power: Self = ((exponent + 127) << 23).bitcast();
        series * power
    }
    #[inline(always)]
    fn sin_cos_turns(self, token: S) -> (Self, Self) {
        // From the nearest quarter.
        let quarters = SimdFloat::floor(self * 4.0 + 0.5);
        let (sin, cos) = (self - quarters * 0.25).sin_cos_eighth(token);
        // Taken modulo 4 before it becomes an integer: conversions out of range differ between processors.
        let quarters = quarters - SimdFloat::floor(quarters * 0.25) * 4.0;
        let quarter: u32x16<S> = quarters.to_int::<i32x16<S>>().bitcast();
        let odd = (quarter & 1).simd_eq(u32x16::splat(token, 1));
        let (a, b) = (odd.select(cos, sin), odd.select(sin, cos));
        // Sine is negative in quarters 2 and 3, cosine in 1 and 2.
        (a.flip::<30>(quarter), b.flip::<30>(quarter + 1))
    }
    #[inline(always)]
    fn sin_cos_eighth(self, token: S) -> (Self, Self) {
        // Taylor's series in radians on [-pi/4, pi/4]: the first terms left out are x^11 / 11! < 2e-9 and
        // x^10 / 10! < 3e-8.
        let one = <Self as SimdBase<S>>::splat(token, 1.0);
        let x = self * std::f32::consts::TAU;
        let x2 = x * x;
        let sin = ((((x2 * (1.0 / 362_880.0) - (1.0 / 5_040.0)) * x2 + (1.0 / 120.0)) * x2 - (1.0 / 6.0))
            * x2
            + one)
            * x;
        let cos = (((x2 * (1.0 / 40_320.0) - (1.0 / 720.0)) * x2 + (1.0 / 24.0)) * x2 - 0.5) * x2 + one;
        (sin, cos)
    }
    #[inline(always)]
    fn sin_cos_slight(self, token: S) -> (Self, Self) {
        // Taylor's series in radians: the first term left out of the sine is x^7 / 7! < 2e-8; that of the cosine, y^3 / 6! where
        // y = x^2 <= Y, is replaced by its best quadratic, 3/2 Y y^2 - 9/16 Y^2 y, to 3e-8.
        const Y: f64 = SLIGHT * SLIGHT * std::f64::consts::TAU * std::f64::consts::TAU;
        let constant = |x: f64| <Self as Real>::constant(token, x);
        let x = self * std::f32::consts::TAU;
        let y = x * x;
        let one = constant(1.0);
        let sin = ((y * constant(1.0 / 120.0) - constant(1.0 / 6.0)) * y + one) * x;
        let square = constant(1.0 / 24.0 - 1.5 * Y / 720.0);
        let cos = (y * square - constant(0.5 - 0.5625 * Y * Y / 720.0)) * y + one;
        (sin, cos)
    }
    #[inline(always)]
    fn lt(self, other: Self) -> Self::Mask {
        self.simd_lt(other)
    }
    #[inline(always)]
    fn le(self, other: Self) -> Self::Mask {
        self.simd_le(other)
    }
    #[inline(always)]
    fn select(mask: Self::Mask, a: Self, b: Self) -> Self {
        mask.select(a, b)
    }
    #[inline(always)]
    fn and(a: Self::Mask, b: Self::Mask) -> Self::Mask {
        a & b
    }
    #[inline(always)]
    fn or(a: Self::Mask, b: Self::Mask) -> Self::Mask {
        a | b
    }
    #[inline(always)]
    fn not(a: Self::Mask) -> Self::Mask {
        !a
    }
    #[inline(always)]
    #[allow(clippy::cast_possible_truncation, reason = "sixteen lanes fill sixteen bits")]
    fn bitmask(mask: Self::Mask) -> u32 {
        mask.to_bitmask() as u32
    }
    #[inline(always)]
    fn from_bitmask(token: S, bits: u32) -> Self::Mask {
        mask32x16::from_bitmask(token, u64::from(bits))
    }
    #[inline(always)]
    fn lattice(self) -> Self::Bits {
        self.to_int::<i32x16<S>>().bitcast()
    }
    #[inline(always)]
    fn bits_splat(token: S, x: u32) -> Self::Bits {
        u32x16::splat(token, x)
    }
    #[inline(always)]
    fn bits_add(a: Self::Bits, b: Self::Bits) -> Self::Bits {
        a + b
    }
    #[inline(always)]
    fn bits_mul(a: Self::Bits, b: Self::Bits) -> Self::Bits {
        a * b
    }
    #[inline(always)]
    fn bits_xor(a: Self::Bits, b: Self::Bits) -> Self::Bits {
        a ^ b
    }
    #[inline(always)]
    fn bits_shr16(a: Self::Bits) -> Self::Bits {
        a >> 16
    }
    #[inline(always)]
    fn bits_lt_signed(a: Self::Bits, b: Self::Bits) -> Self::Mask {
        a.bitcast::<i32x16<S>>().simd_lt(b.bitcast::<i32x16<S>>())
    }
    #[inline(always)]
    fn flip<const SHIFT: u32>(self, bits: Self::Bits) -> Self {
        (self.to_bits() ^ ((bits << SHIFT) & 0x8000_0000)).bitcast()
    }
    #[inline(always)]
    #[allow(clippy::disallowed_methods, reason = "where the instruction is the selection")]
    fn least(self, other: Self) -> Self {
        if SELECTS {
            <Self as SimdBase<S>>::min(self, other)
        } else {
            Self::select(self.lt(other), self, other)
        }
    }
    #[inline(always)]
    #[allow(clippy::disallowed_methods, reason = "where the instruction is the selection")]
    fn most(self, other: Self) -> Self {
        if SELECTS {
            <Self as SimdBase<S>>::max(self, other)
        } else {
            Self::select(other.lt(self), self, other)
        }
    }
}

impl Real for f64 {
    type Scalar = f64;
    type Token = ();
    type Bits = u32;
    type Mask = bool;
    const LANES: usize = 1;

    #[inline(always)]
    fn splat((): (), x: f64) -> f64 {
        x
    }
    #[inline(always)]
    fn load((): (), from: &[f64]) -> f64 {
        from[0]
    }
    #[inline(always)]
    fn store(self, to: &mut [f64]) {
        to[0] = self;
    }
    #[inline(always)]
    fn compress(self, _: bool) -> f64 {
        self
    }
    #[inline(always)]
    fn expand(self, mask: bool) -> f64 {
        if mask { self } else { 0.0 }
    }
    #[inline(always)]
    fn zip_quarters(self, other: f64) -> [f64; 2] {
        [self, other]
    }
    #[inline(always)]
    fn runs<const N: usize>((): (), from: &[f64; N], place: u32) -> [f64; 4] {
        let place = (place as usize).min(N - 4);
        [from[place], from[place + 1], from[place + 2], from[place + 3]]
    }
    #[inline(always)]
    fn floor(self) -> f64 {
        f64::floor(self)
    }
    #[inline(always)]
    fn sqrt(self) -> f64 {
        f64::sqrt(self)
    }
    #[inline(always)]
    fn abs(self) -> f64 {
        f64::abs(self)
    }
    #[inline(always)]
    fn log2(self) -> f64 {
        libm::log2(self)
    }
    #[inline(always)]
    fn exp2(self, (): ()) -> f64 {
        libm::exp2(self.within(-126.0, 126.0))
    }
    #[inline(always)]
    fn sin_cos_turns(self, (): ()) -> (f64, f64) {
        libm::sincos(std::f64::consts::TAU * (self - f64::floor(self)))
    }
    #[inline(always)]
    fn sin_cos_eighth(self, (): ()) -> (f64, f64) {
        libm::sincos(std::f64::consts::TAU * self)
    }
    #[inline(always)]
    fn sin_cos_slight(self, (): ()) -> (f64, f64) {
        libm::sincos(std::f64::consts::TAU * self)
    }
    #[inline(always)]
    fn lt(self, other: f64) -> bool {
        self < other
    }
    #[inline(always)]
    fn le(self, other: f64) -> bool {
        self <= other
    }
    #[inline(always)]
    fn select(mask: bool, a: f64, b: f64) -> f64 {
        if mask { a } else { b }
    }
    #[inline(always)]
    fn and(a: bool, b: bool) -> bool {
        a && b
    }
    #[inline(always)]
    fn or(a: bool, b: bool) -> bool {
        a || b
    }
    #[inline(always)]
    fn not(a: bool) -> bool {
        !a
    }
    #[inline(always)]
    fn bitmask(mask: bool) -> u32 {
        u32::from(mask)
    }
    #[inline(always)]
    fn from_bitmask((): (), bits: u32) -> bool {
        bits & 1 == 1
    }
    #[inline(always)]
    #[allow(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "the lattice is taken modulo 2^32"
    )]
    fn lattice(self) -> u32 {
        self as i64 as u32
    }
    #[inline(always)]
    fn bits_splat((): (), x: u32) -> u32 {
        x
    }
    #[inline(always)]
    fn bits_add(a: u32, b: u32) -> u32 {
        a.wrapping_add(b)
    }
    #[inline(always)]
    fn bits_mul(a: u32, b: u32) -> u32 {
        a.wrapping_mul(b)
    }
    #[inline(always)]
    fn bits_xor(a: u32, b: u32) -> u32 {
        a ^ b
    }
    #[inline(always)]
    fn bits_shr16(a: u32) -> u32 {
        a >> 16
    }
    #[inline(always)]
    fn bits_lt_signed(a: u32, b: u32) -> bool {
        a.cast_signed() < b.cast_signed()
    }
    #[inline(always)]
    fn flip<const SHIFT: u32>(self, bits: u32) -> f64 {
        if (bits << SHIFT) & 0x8000_0000 != 0 { -self } else { self }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Logarithm<'a>(&'a [f32; 16]);

    impl WithLevel for Logarithm<'_> {
        type Output = [f32; 16];
        #[inline(always)]
        fn run<R: Real<Scalar = f32>>(self, token: R::Token) -> [f32; 16] {
            let mut out = [0.0; 16];
            R::load(token, self.0).log2().store(&mut out);
            out
        }
    }

    #[test]
    fn lane_logarithms_keep_their_bound() {
        let mut x = 1e-30_f32;
        while x < 1e30 {
            let mut lanes = [0.0; 16];
            for lane in &mut lanes {
                *lane = x;
                x *= 1.0137;
            }
            for (&x, found) in lanes.iter().zip(with_level(Level::best(), Logarithm(&lanes))) {
                let truth = libm::log2(f64::from(x));
                // The bound, and the rounding of a result of this size.
                let bound = 1e-6 + truth.abs() * f64::from(f32::EPSILON) / 2.0;
                assert!((f64::from(found) - truth).abs() < bound, "log2 {x}: {found}, not {truth}");
            }
        }
    }

    struct Turns<'a> {
        of: &'a [f32; 16],
        within: f64,
    }

    impl WithLevel for Turns<'_> {
        type Output = [[f32; 16]; 2];
        #[inline(always)]
        fn run<R: Real<Scalar = f32>>(self, token: R::Token) -> [[f32; 16]; 2] {
            let mut out = [[0.0; 16]; 2];
            let turns = R::load(token, self.of);
            let (sin, cos) = match self.within {
                SLIGHT => turns.sin_cos_slight(token),
                0.125 => turns.sin_cos_eighth(token),
                _ => turns.sin_cos_turns(token),
            };
            sin.store(&mut out[0]);
            cos.store(&mut out[1]);
            out
        }
    }

    fn assert_sines(within: f64, bound: f64, lanes: [f32; 16]) {
        let [sines, cosines] = with_level(Level::best(), Turns { of: &lanes, within });
        for (turns, [sine, cosine]) in
            lanes.into_iter().zip(sines.into_iter().zip(cosines).map(|(s, c)| [s, c]))
        {
            let (sin, cos) = f64::from(turns).sin_cos_turns(());
            assert!((f64::from(sine) - sin).abs() < bound, "sine of {turns}: {sine}, not {sin}");
            assert!((f64::from(cosine) - cos).abs() < bound, "cosine of {turns}: {cosine}, not {cos}");
        }
    }

    #[test]
    fn lane_sines_keep_their_bounds() {
        for step in -2000..2000_i16 {
            let first = f32::from(step) * 0.0137;
            assert_sines(
                f64::INFINITY,
                3e-7,
                std::array::from_fn(|i| first * [1.0, 1.0, 17.0, 1e3][i % 4] + 0.125 * i as f32),
            );
            for (within, bound) in [(0.125, 1.5e-7), (SLIGHT, 1e-7)] {
                let part = f64::from(step) / 2000.0;
                let lanes = std::array::from_fn(|i| f32::from_f64(within * (part + i as f64 / 32_000.0)));
                assert_sines(within, bound, lanes);
            }
        }
    }

    #[test]
    fn selections_treat_not_a_number_as_stated() {
        assert_eq!(f64::NAN.within(-1.0, 1.0), -1.0);
        assert_eq!(3.0.within(-1.0, 1.0), 1.0);
        assert_eq!(0.25.within(-1.0, 1.0), 0.25);
    }
}
