//! Where a medium is: the space that its cells are unit cubes of, and the cubes of 8^3 cells that hold something.

use glam::{DMat3, DVec3};

use super::camera::Ray;
use super::nodes::Nodes;

/// Cells along an edge of a brick.
pub(super) const EDGE: i32 = 8;

/// An affine map from the world, in metres, to a space whose cells are unit cubes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Grid {
    /// `grid = linear (world - origin)`.
    linear: DMat3,
    origin: DVec3,
    inverse: DMat3,
}

/// A ray in a grid's space.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct GridRay {
    pub(super) origin: DVec3,
    /// Of length 1 there.
    pub(super) direction: DVec3,
    /// Metres for a unit of length.
    pub(super) metres: f64,
}

impl Grid {
    /// Cells of edge h in metres, from the world's origin.
    pub fn cubic(h: f64) -> Grid {
        Grid {
            linear: DMat3::from_diagonal(DVec3::splat(1.0 / h)),
            origin: DVec3::ZERO,
            inverse: DMat3::from_diagonal(DVec3::splat(h)),
        }
    }

    /// The inverse of `world = A (i, j, k, 1)`, from the rows of A; `None` where A has none.
    pub fn from_rows(rows: &[[f64; 4]; 3]) -> Option<Grid> {
        let [x, y, z] = rows.map(|[a, b, c, _]| DVec3::new(a, b, c));
        let inverse = DMat3::from_cols(x, y, z).transpose();
        let origin = DVec3::from(rows.map(|row| row[3]));
        // Scaled to 1, so that its determinant stays within the range of numbers.
        let scale = [x, y, z].iter().map(|row| row.abs().max_element()).fold(0.0, f64::max);
        let unit = inverse * (1.0 / scale);
        if !unit.is_finite() || !origin.is_finite() || unit.determinant() == 0.0 {
            return None;
        }
        let linear = unit.inverse() * (1.0 / scale);
        linear.is_finite().then_some(Grid { linear, origin, inverse })
    }

    /// A point of the world in the grid's space.
    pub fn to_grid(&self, world: DVec3) -> DVec3 {
        self.linear * (world - self.origin)
    }

    /// A point of the grid's space in the world.
    pub fn to_world(&self, grid: DVec3) -> DVec3 {
        self.inverse * grid + self.origin
    }

    /// A step in the world, in the grid's space.
    pub(super) fn step_to_grid(&self, world: DVec3) -> DVec3 {
        self.linear * world
    }

    /// A step in the grid's space, in the world.
    pub(super) fn step_to_world(&self, grid: DVec3) -> DVec3 {
        self.inverse * grid
    }

    /// The direction in which a function grows fastest, from its derivatives by the grid's coordinates; not of length 1.
    pub(super) fn gradient(&self, derivatives: DVec3) -> DVec3 {
        self.linear.transpose() * derivatives
    }

    pub(super) fn ray(&self, ray: &Ray) -> GridRay {
        let along = self.linear * ray.direction;
        let length = along.length();
        GridRay { origin: self.to_grid(ray.origin), direction: along / length, metres: 1.0 / length }
    }

    /// With cells of twice the edge, from the same corner.
    pub(super) fn coarser(&self) -> Grid {
        Grid { linear: self.linear * 0.5, origin: self.origin, inverse: self.inverse * 2.0 }
    }

    /// Metres along the longest edge of a cell.
    pub fn cell(&self) -> f64 {
        [0, 1, 2].map(|axis| self.inverse.col(axis).length()).into_iter().fold(0.0, f64::max)
    }
}

/// The bricks of a medium that hold something.
#[derive(Debug, Clone, Default)]
pub(super) struct Bricks {
    /// In units of their edges.
    pub(super) blocks: Vec<[i32; 3]>,
    /// Where they are.
    nodes: Nodes,
}

impl Bricks {
    pub(super) fn new(blocks: Vec<[i32; 3]>) -> Bricks {
        let nodes = Nodes::new(&blocks);
        Bricks { blocks, nodes }
    }

    /// Bytes that they take.
    pub(super) fn memory(&self) -> usize {
        size_of_val(self.blocks.as_slice()) + self.nodes.memory()
    }

    /// How to find them.
    pub(super) fn nodes(&self) -> &Nodes {
        &self.nodes
    }

    /// The corners of all of them, in cells.
    pub(super) fn bounds(&self) -> Option<[DVec3; 2]> {
        let mut bounds: Option<[[i32; 3]; 2]> = None;
        for block in &self.blocks {
            let [low, high] = bounds.get_or_insert([*block; 2]);
            for axis in 0..3 {
                low[axis] = low[axis].min(block[axis]);
                high[axis] = high[axis].max(block[axis]);
            }
        }
        let edge = f64::from(EDGE);
        bounds.map(|[low, high]| {
            [
                DVec3::from(low.map(|c| f64::from(c) * edge)),
                DVec3::from(high.map(|c| (f64::from(c) + 1.0) * edge)),
            ]
        })
    }
}
