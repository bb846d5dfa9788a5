//! What a scene does not need and so is not evaluated, in words.

use super::{Field, Lattice};

impl Field {
    /// The stages left out of the evaluation at this voxel size, each with the reason.
    pub fn left_out(&self, _lattice: Lattice) -> Vec<String> {
        Vec::new()
    }
}
