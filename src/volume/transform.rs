//! From the world to a lattice.

use glam::{DMat3, DVec3};

/// Points of the world in the index space of a lattice, where voxel (i, j, k) is at (i, j, k).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WorldToIndex {
    linear: DMat3,
    origin: DVec3,
}

impl WorldToIndex {
    /// The inverse of `world = A (i, j, k, 1)`, from the rows of A; `None` where A has none.
    ///
    /// Scales from 1e-150 to 1e150 are safe.
    pub fn new(rows: &[[f64; 4]; 3]) -> Option<WorldToIndex> {
        let [x, y, z] = rows.map(|[a, b, c, _]| DVec3::new(a, b, c));
        // Of scale 1, so that its determinant does not leave the range of numbers.
        let scale = [x, y, z].iter().map(|row| row.abs().max_element()).fold(0.0, f64::max);
        let unit = DMat3::from_cols(x / scale, y / scale, z / scale).transpose();
        let origin = DVec3::from(rows.map(|row| row[3]));
        if unit.determinant() == 0.0 || !unit.is_finite() || !origin.is_finite() {
            return None;
        }
        let linear = unit.inverse() * (1.0 / scale);
        linear.is_finite().then_some(WorldToIndex { linear, origin })
    }

    /// A point of the world in index space.
    pub fn index(&self, world: DVec3) -> DVec3 {
        self.linear * (world - self.origin)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn undoes_affine_maps() {
        let shear = [[0.5, -0.2, 0.0, 3.0], [0.1, 0.25, 0.4, -4.0], [0.0, 0.3, 2.0, 5.0]];
        let small = [[1e-140, 0.0, 0.0, 0.0], [0.0, 2e-140, 0.0, 0.0], [0.0, 0.0, -1e-140, 0.0]];
        for rows in [shear, small] {
            let inverse = WorldToIndex::new(&rows).expect("a regular matrix");
            for index in [[0.0, 0.0, 0.0], [1.0, -2.0, 3.5], [-1000.0, 7.25, 800.0]] {
                let world = rows.map(|[a, b, c, d]| a * index[0] + b * index[1] + c * index[2] + d);
                let found = inverse.index(world.into());
                // Some roundings of the largest coordinate, times the condition of the shear, which is about 10.
                assert!(found.distance(index.into()) < 1e-11, "{index:?} became {found}");
            }
        }
    }

    #[test]
    fn maps_without_an_inverse_have_none() {
        let flat = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [1.0, 1.0, 0.0, 0.0]];
        let nan = [[f64::NAN; 4]; 3];
        let infinite = [[1.0, 0.0, 0.0, f64::INFINITY], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]];
        for rows in [flat, nan, infinite, [[0.0; 4]; 3]] {
            assert_eq!(WorldToIndex::new(&rows), None);
        }
    }
}
