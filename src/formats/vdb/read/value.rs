//! Voxel values, as a file stores them.

use crate::volume::Value;

/// A value and its bytes in a file.
pub(super) trait Stored: Value {
    /// Bytes of a value in a file.
    const SIZE: usize;
    /// Bytes of a value where a grid is stored as binary16; `None` for types that never are.
    const HALF_SIZE: Option<usize>;

    /// Values from as many times [`Stored::SIZE`] bytes.
    fn decode(bytes: &[u8], out: &mut [Self]);

    /// Values from as many times [`Stored::HALF_SIZE`] bytes.
    fn decode_half(bytes: &[u8], out: &mut [Self]) {
        Self::decode(bytes, out);
    }

    /// The value with its sign turned; true and false exchanged.
    #[must_use]
    fn negative(self) -> Self;
}

impl Stored for bool {
    const SIZE: usize = 1;
    const HALF_SIZE: Option<usize> = None;

    fn decode(bytes: &[u8], out: &mut [bool]) {
        for (value, byte) in out.iter_mut().zip(bytes) {
            *value = *byte != 0;
        }
    }

    fn negative(self) -> bool {
        !self
    }
}

macro_rules! integer {
    ($type:ident, $size:literal) => {
        impl Stored for $type {
            const SIZE: usize = $size;
            const HALF_SIZE: Option<usize> = None;

            fn decode(bytes: &[u8], out: &mut [$type]) {
                for (value, bytes) in out.iter_mut().zip(bytes.as_chunks().0) {
                    *value = $type::from_le_bytes(*bytes);
                }
            }

            fn negative(self) -> $type {
                self.wrapping_neg()
            }
        }
    };
}
integer!(i32, 4);
integer!(i64, 8);

macro_rules! float {
    ($type:ident, $size:literal) => {
        impl Stored for $type {
            const SIZE: usize = $size;
            const HALF_SIZE: Option<usize> = Some(2);

            fn decode(bytes: &[u8], out: &mut [$type]) {
                for (value, bytes) in out.iter_mut().zip(bytes.as_chunks().0) {
                    *value = $type::from_le_bytes(*bytes);
                }
            }

            fn decode_half(bytes: &[u8], out: &mut [$type]) {
                for (value, bytes) in out.iter_mut().zip(bytes.as_chunks().0) {
                    *value = from_half(u16::from_le_bytes(*bytes)).into();
                }
            }

            fn negative(self) -> $type {
                -self
            }
        }
    };
}
float!(f32, 4);
float!(f64, 8);

impl<S: Stored> Stored for [S; 3] {
    const SIZE: usize = 3 * S::SIZE;
    const HALF_SIZE: Option<usize> = match S::HALF_SIZE {
        Some(size) => Some(3 * size),
        None => None,
    };

    fn decode(bytes: &[u8], out: &mut [[S; 3]]) {
        S::decode(bytes, out.as_flattened_mut());
    }

    fn decode_half(bytes: &[u8], out: &mut [[S; 3]]) {
        S::decode_half(bytes, out.as_flattened_mut());
    }

    fn negative(self) -> [S; 3] {
        self.map(S::negative)
    }
}

/// The number that IEEE 754's binary16 has for these bits. Exact.
fn from_half(half: u16) -> f32 {
    let sign = u32::from(half & 0x8000) << 16;
    let magnitude = u32::from(half & 0x7fff) << 13;
    let bits = if magnitude >= 0x0f80_0000 {
        // Infinity and NaN.
        magnitude | 0x7f80_0000
    } else {
        // Exponents are biased by 127 and by 15; the product by 2^112 is exact, for subnormal numbers too.
        (f32::from_bits(magnitude) * f32::from_bits((127 + 112) << 23)).to_bits()
    };
    f32::from_bits(sign | bits)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn halves_are_their_definition() {
        for half in 0..=u16::MAX {
            let (exponent, fraction) = (i32::from(half >> 10 & 31), f64::from(half & 1023));
            let sign = if half & 0x8000 == 0 { 1.0 } else { -1.0 };
            let power = |n: i32| (0..n.abs()).fold(1.0, |p, _| if n < 0 { p / 2.0 } else { p * 2.0 });
            let expected = match exponent {
                0 => sign * fraction * power(-24),
                31 if fraction == 0.0 => sign * f64::INFINITY,
                31 => f64::NAN,
                _ => sign * (1.0 + fraction / 1024.0) * power(exponent - 15),
            };
            let found = from_half(half);
            assert!(f64::from(found) == expected || (found.is_nan() && expected.is_nan()), "{half:#x}");
            assert_eq!(found.is_sign_negative(), half & 0x8000 != 0);
        }
    }

    #[test]
    fn sizes_and_signs() {
        assert_eq!([bool::SIZE, i32::SIZE, i64::SIZE, f32::SIZE, f64::SIZE], [1, 4, 8, 4, 8]);
        assert_eq!((<[f32; 3]>::SIZE, <[f32; 3]>::HALF_SIZE), (12, Some(6)));
        assert_eq!((<[i32; 3]>::SIZE, <[i32; 3]>::HALF_SIZE), (12, None));
        assert_eq!([1.0_f32, -2.0, 0.0].negative(), [-1.0, 2.0, 0.0]);
        assert_eq!((i32::MIN.negative(), true.negative()), (i32::MIN, false));
    }
}
