//! How precisely numbers are kept.

use half::f16;
use half::slice::HalfFloatSliceExt;

/// How precisely a sink keeps numbers.
///
/// With [`Precision::F16`] a number becomes the nearest of IEEE 754's binary16, that with an even last bit where two are
/// as near: 11 significant bits from 2^-14 to 65504, the largest; multiples of 2^-24 below that, so that what is at most
/// 2^-25 becomes 0. Finite numbers that would round to infinity become +-65504. Infinities and NaN stay what they are.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Precision {
    /// Single precision: numbers stay as they are.
    #[default]
    F32,
    /// Half precision, binary16.
    F16,
}

/// The largest finite number of binary16.
pub const LARGEST_F16: f32 = 65504.0;
/// From here on binary16 would round to infinity: halfway to what would be the next number.
const BEYOND: f32 = 65520.0;
/// Numbers that are converted at once.
const PIECE: usize = 64;

impl Precision {
    /// Bytes that a number takes.
    pub const fn bytes(self) -> usize {
        match self {
            Precision::F32 => 4,
            Precision::F16 => 2,
        }
    }

    /// Replaces numbers by those that are kept in their place; returns how many of them were beyond the range and clamped.
    pub fn round(self, numbers: &mut [f32]) -> usize {
        if self == Precision::F32 {
            return 0;
        }
        let mut clamped = 0;
        let mut halves = [f16::ZERO; PIECE];
        for piece in numbers.chunks_mut(PIECE) {
            clamped += clamp(piece);
            let halves = &mut halves[..piece.len()];
            halves.convert_from_f32_slice(piece);
            halves.convert_to_f32_slice(piece);
        }
        clamped
    }
}

/// Replaces `halves` by the numbers in half precision; `numbers` are left clamped.
pub(crate) fn to_halves(numbers: &mut [f32], halves: &mut Vec<f16>) {
    clamp(numbers);
    halves.resize(numbers.len(), f16::ZERO);
    halves.convert_from_f32_slice(numbers);
}

fn clamp(numbers: &mut [f32]) -> usize {
    let mut clamped = 0;
    for x in numbers {
        let beyond = x.abs() >= BEYOND && x.is_finite();
        *x = if beyond { LARGEST_F16.copysign(*x) } else { *x };
        clamped += usize::from(beyond);
    }
    clamped
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rounded(x: f32) -> f32 {
        let mut x = [x];
        Precision::F16.round(&mut x);
        x[0]
    }

    /// The number of binary16 with these bits, from the definition.
    fn number(half: u16) -> f32 {
        let (exponent, fraction) = (half >> 10 & 31, f32::from(half & 1023));
        let power = |n: u16| (0..n).fold(1.0_f32, |p, _| 2.0 * p);
        let magnitude = match exponent {
            0 => fraction / power(24),
            _ => (1024.0 + fraction) * power(exponent) / power(25),
        };
        if half & 0x8000 == 0 { magnitude } else { -magnitude }
    }

    /// Rounding never decreases, so what it does follows from what it does at numbers and around the middles between them.
    #[test]
    fn the_nearest_number_of_binary16_is_taken() {
        let infinity = 0x7c00;
        for half in 0..infinity {
            let (this, next) = (number(half), number(half + 1));
            // Exact: both have 11 significant bits, or are multiples of 2^-24 below 2^-13.
            let middle = f32::midpoint(this, next);
            let last = half + 1 == infinity;
            let even = if half % 2 == 0 || last { this } else { next };
            let above = if last { this } else { next };
            for (x, expected) in
                [(this, this), (middle.next_down(), this), (middle, even), (middle.next_up(), above)]
            {
                assert_eq!(rounded(x).to_bits(), expected.to_bits(), "{x}");
                assert_eq!(rounded(-x).to_bits(), (-expected).to_bits(), "{x}");
            }
        }
        assert_eq!(number(infinity - 1), LARGEST_F16);
        assert!(rounded(f32::MIN_POSITIVE) == 0.0 && rounded(f32::from_bits(1)) == 0.0);
        assert!(rounded(f32::NAN).is_nan() && rounded(f32::NEG_INFINITY) == f32::NEG_INFINITY);
    }

    #[test]
    fn what_is_beyond_the_range_is_clamped_and_counted() {
        let mut numbers = [1.0, 65519.99, 65520.0, -65520.0, f32::MAX, f32::INFINITY, f32::NAN, -0.0];
        assert_eq!(Precision::F16.round(&mut numbers), 3);
        assert_eq!(numbers[..6], [1.0, 65504.0, 65504.0, -65504.0, 65504.0, f32::INFINITY]);
        assert_eq!(Precision::F32.round(&mut [f32::MAX; 3]), 0);
    }

    #[test]
    fn both_ways_to_round_agree() {
        let mut state = 3;
        let mut numbers: Vec<f32> = (0..10_000)
            .map(|_| {
                f32::from_bits(
                    u32::try_from(super::super::testing::random(&mut state) >> 32).expect("32 bits"),
                )
            })
            .filter(|x| !x.is_nan())
            .collect();
        let mut halves = vec![];
        to_halves(&mut numbers.clone(), &mut halves);
        Precision::F16.round(&mut numbers);
        assert!(numbers.iter().zip(&halves).all(|(x, half)| x.to_bits() == half.to_f32().to_bits()));
    }
}
