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
/// What rounding did to numbers, besides taking their nearest.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Rounded {
    /// Finite numbers beyond the range that became its end, those that are nearer to it than to infinity too.
    pub clamped: usize,
    /// Numbers other than 0 that became 0.
    pub vanished: usize,
}

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

    /// Replaces numbers by those that are kept in their place.
    pub fn round(self, numbers: &mut [f32]) -> Rounded {
        let mut rounded = Rounded::default();
        if self == Precision::F32 {
            return rounded;
        }
        let mut halves = [f16::ZERO; PIECE];
        for piece in numbers.chunks_mut(PIECE) {
            let before = other_than_0(piece);
            rounded.clamped += clamp(piece);
            let halves = &mut halves[..piece.len()];
            halves.convert_from_f32_slice(piece);
            halves.convert_to_f32_slice(piece);
            rounded.vanished += before - other_than_0(piece);
        }
        rounded
    }
}

/// Replaces `halves` by the numbers in half precision; `numbers` are left clamped.
pub(crate) fn to_halves(numbers: &mut [f32], halves: &mut Vec<f16>) {
    clamp(numbers);
    halves.resize(numbers.len(), f16::ZERO);
    halves.convert_from_f32_slice(numbers);
}

fn other_than_0(numbers: &[f32]) -> usize {
    numbers.iter().map(|x| usize::from(*x != 0.0)).sum()
}

fn clamp(numbers: &mut [f32]) -> usize {
    let mut clamped = 0;
    for x in numbers {
        let beyond = x.abs() > LARGEST_F16 && x.is_finite();
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
        let mut numbers = [65504.0, 65519.99, 65520.0, -65520.0, f32::MAX, f32::INFINITY, f32::NAN, -0.0];
        assert_eq!(Precision::F16.round(&mut numbers), Rounded { clamped: 4, vanished: 0 });
        assert_eq!(numbers[..6], [65504.0, 65504.0, 65504.0, -65504.0, 65504.0, f32::INFINITY]);
        assert_eq!(Precision::F32.round(&mut [f32::MAX; 3]), Rounded::default());
    }

    #[test]
    fn what_becomes_0_is_counted() {
        // Half of the least number, which goes to the even one, and the next.
        let half = 1.0 / 33_554_432.0_f32;
        let mut numbers = [0.0, -0.0, half, -half, half.next_up(), f32::MIN_POSITIVE, f32::from_bits(1), 1.0];
        assert_eq!(Precision::F32.round(&mut numbers.clone()), Rounded::default());
        assert_eq!(Precision::F16.round(&mut numbers), Rounded { clamped: 0, vanished: 4 });
        assert_eq!(numbers, [0.0, 0.0, 0.0, 0.0, 2.0 * half, 0.0, 0.0, 1.0]);
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
