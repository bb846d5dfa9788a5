//! Types that voxels can have.

use std::fmt::Debug;

/// A type that voxels can have.
///
/// Sealed: files know no others.
pub trait Value: Copy + Debug + PartialEq + Send + Sync + sealed::Sealed + 'static {
    /// Zero, or false.
    const ZERO: Self;

    /// Whether all bits are equal: of zeros of both signs they are not, of NaN they may be.
    fn same(self, other: Self) -> bool;
}

mod sealed {
    pub trait Sealed {}
    impl Sealed for bool {}
    impl Sealed for i32 {}
    impl Sealed for i64 {}
    impl Sealed for f32 {}
    impl Sealed for f64 {}
    impl<S: Sealed> Sealed for [S; 3] {}
}

macro_rules! discrete {
    ($type:ident, $zero:literal) => {
        impl Value for $type {
            const ZERO: $type = $zero;

            fn same(self, other: $type) -> bool {
                self == other
            }
        }
    };
}
discrete!(bool, false);
discrete!(i32, 0);
discrete!(i64, 0);

macro_rules! float {
    ($type:ident) => {
        impl Value for $type {
            const ZERO: $type = 0.0;

            fn same(self, other: $type) -> bool {
                self.to_bits() == other.to_bits()
            }
        }
    };
}
float!(f32);
float!(f64);

impl<S: Value> Value for [S; 3] {
    const ZERO: [S; 3] = [S::ZERO; 3];

    fn same(self, other: [S; 3]) -> bool {
        self.iter().zip(other).all(|(a, b)| a.same(b))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bits_decide() {
        assert!(!0.0_f32.same(-0.0) && f64::NAN.same(f64::NAN));
        assert!([0.0_f32; 3].same([0.0; 3]) && ![0.0_f32; 3].same([0.0, -0.0, 0.0]));
    }
}
