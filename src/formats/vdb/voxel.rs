//! Types of voxels that are written.

use super::codec::gather;
use crate::volume::Value;

/// A type of voxels that grids are written of: `f32`, or `[f32; 3]`.
///
/// Sealed: no others are written.
pub trait Voxel: Value + parts::Parts {}

impl Voxel for f32 {}
impl Voxel for [f32; 3] {}

mod parts {
    /// A value as numbers.
    pub trait Parts: Sized {
        /// The type's name in a file.
        const NAME: &'static str;
        /// How many numbers make a value.
        const NUMBERS: usize;

        /// The numbers of values, one value after the other.
        fn numbers_mut(values: &mut [Self]) -> &mut [f32];

        /// The numbers of active values, or of all of them with zeros at inactive ones, in `kept`.
        fn gather<'a>(
            active: &[u64],
            values: &[Self],
            only_active: bool,
            kept: &'a mut Vec<f32>,
        ) -> &'a mut [f32];
    }
}

impl parts::Parts for f32 {
    const NAME: &'static str = "float";
    const NUMBERS: usize = 1;

    fn numbers_mut(values: &mut [f32]) -> &mut [f32] {
        values
    }

    fn gather<'a>(
        active: &[u64],
        values: &[f32],
        only_active: bool,
        kept: &'a mut Vec<f32>,
    ) -> &'a mut [f32] {
        gather::<1>(active, values.as_chunks().0, only_active, kept)
    }
}

impl parts::Parts for [f32; 3] {
    const NAME: &'static str = "vec3s";
    const NUMBERS: usize = 3;

    fn numbers_mut(values: &mut [[f32; 3]]) -> &mut [f32] {
        values.as_flattened_mut()
    }

    fn gather<'a>(
        active: &[u64],
        values: &[[f32; 3]],
        only_active: bool,
        kept: &'a mut Vec<f32>,
    ) -> &'a mut [f32] {
        gather(active, values, only_active, kept)
    }
}
