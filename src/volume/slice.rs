//! Slices: planes of voxels across an axis, as pictures.

use std::ops::Range;

use super::part::{NotRead, PartialTree};
use super::value::Value;
use super::{Brick, Part};
use crate::field::EDGE;

/// An axis of index space.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Axis {
    /// The first.
    X,
    /// The second.
    Y,
    /// The third.
    Z,
}

impl Axis {
    /// 0, 1 or 2.
    pub fn number(self) -> usize {
        match self {
            Axis::X => 0,
            Axis::Y => 1,
            Axis::Z => 2,
        }
    }

    /// The axes that point to the right and up in a picture of a plane across this one: y and z, x and z, or x and y. So a
    /// slice across y is seen along +y; those across x and z are seen against these.
    pub fn across(self) -> [usize; 2] {
        match self {
            Axis::X => [1, 2],
            Axis::Y => [0, 2],
            Axis::Z => [0, 1],
        }
    }
}

/// The planes of voxels of a box across an axis. They are numbered from 0 at the box's low side; a picture has a pixel for
/// each voxel, in rows from the top.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Slicing {
    axis: Axis,
    first: [i32; 3],
    size: [usize; 3],
}

impl Slicing {
    /// Of the box from one voxel to another, both included; `None` where `last` is below `first` along an axis.
    pub fn new(axis: Axis, [first, last]: [[i32; 3]; 2]) -> Option<Slicing> {
        let mut size = [0; 3];
        for i in 0..3 {
            let edge = i64::from(last[i]) - i64::from(first[i]) + 1;
            size[i] = usize::try_from(edge).ok().filter(|edge| *edge > 0)?;
        }
        Some(Slicing { axis, first, size })
    }

    /// Of one voxel.
    pub fn of_voxel(axis: Axis, voxel: [i32; 3]) -> Slicing {
        Slicing { axis, first: voxel, size: [1; 3] }
    }

    /// The axis.
    pub fn axis(&self) -> Axis {
        self.axis
    }

    /// Number of planes.
    pub fn count(&self) -> usize {
        self.size[self.axis.number()]
    }

    /// Pixels from left to right, and from top to bottom.
    pub fn pixels(&self) -> [usize; 2] {
        self.axis.across().map(|axis| self.size[axis])
    }

    /// Index of a plane along the axis.
    pub fn index(&self, plane: usize) -> i32 {
        offset(self.first[self.axis.number()], plane)
    }

    /// The plane at an index along the axis, if there is one.
    pub fn plane(&self, index: i64) -> Option<usize> {
        let plane = usize::try_from(index - i64::from(self.first[self.axis.number()])).ok()?;
        (plane < self.count()).then_some(plane)
    }

    /// The voxel of a plane's pixel.
    pub fn voxel(&self, plane: usize, [column, row]: [usize; 2]) -> [i32; 3] {
        let [right, up] = self.axis.across();
        let mut voxel = self.first;
        voxel[self.axis.number()] = self.index(plane);
        voxel[right] = offset(self.first[right], column);
        voxel[up] = offset(self.first[up], self.size[up] - 1 - row);
        voxel
    }

    /// Planes that lie in one layer of leaves with this one: from it to behind the last.
    pub fn layer(&self, plane: usize) -> Range<usize> {
        let past = i64::from(self.index(plane)).div_euclid(8) * 8 + 8;
        plane..self.plane(past).unwrap_or_else(|| self.count())
    }

    /// The leaves that planes lie in.
    pub fn part(&self, planes: &Range<usize>) -> Part {
        let [mut first, mut last] = [self.first, [0, 1, 2].map(|i| offset(self.first[i], self.size[i] - 1))];
        first[self.axis.number()] = self.index(planes.start);
        last[self.axis.number()] = self.index(planes.end.saturating_sub(1).max(planes.start));
        Part::within(first, last)
    }

    /// A plane of a tree.
    ///
    /// # Errors
    ///
    /// [`NotRead`] where the tree lacks a leaf of it.
    pub fn of_tree<T: Value>(&self, tree: &PartialTree<T>, plane: usize) -> Result<Vec<T>, NotRead> {
        let [width, height] = self.pixels();
        let mut values = Vec::with_capacity(width * height);
        for row in 0..height {
            for column in 0..width {
                values.push(tree.value(self.voxel(plane, [column, row]))?.0);
            }
        }
        Ok(values)
    }

    /// A plane of bricks, 0 where there is none. Voxels outside of the box are left out.
    pub fn of_bricks(&self, bricks: &[Brick], plane: usize) -> Vec<f32> {
        let [width, height] = self.pixels();
        let mut values = vec![0.0; width * height];
        let axis = self.axis.number();
        let [right, up] = self.axis.across();
        let index = i64::from(self.index(plane));
        for brick in bricks {
            let inside = usize::try_from(index - i64::from(brick.origin[axis]));
            let Ok(inside) = inside else { continue };
            if inside >= EDGE {
                continue;
            }
            for across in 0..EDGE * EDGE {
                let mut at = [0; 3];
                (at[axis], at[right], at[up]) = (inside, across % EDGE, across / EDGE);
                let place = |i: usize| {
                    let from_low = i64::from(brick.origin[i]) - i64::from(self.first[i]);
                    usize::try_from(from_low).map_or_else(
                        |_| at[i].checked_sub(usize::try_from(-from_low).unwrap_or(usize::MAX)),
                        |from_low| Some(from_low + at[i]),
                    )
                };
                if let (Some(column), Some(height_at)) = (place(right), place(up))
                    && column < width
                    && height_at < height
                {
                    values[(height - 1 - height_at) * width + column] =
                        brick.values[(at[0] * EDGE + at[1]) * EDGE + at[2]];
                }
            }
        }
        values
    }
}

#[allow(clippy::cast_possible_truncation, clippy::cast_possible_wrap, reason = "inside of a box of i32")]
fn offset(first: i32, by: usize) -> i32 {
    (i64::from(first) + by as i64) as i32
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "what is not there fails the test")]

    use super::*;
    use crate::field::VOXELS;

    fn value([x, y, z]: [i32; 3]) -> f32 {
        #[allow(clippy::cast_precision_loss, reason = "small")]
        let value = (10_000 * x + 100 * y + z) as f32;
        value
    }

    fn brick(origin: [i32; 3]) -> Brick {
        let mut brick = Brick { origin, mask: [u64::MAX; 8], values: [0.0; VOXELS] };
        for (i, at) in (0..).zip(&mut brick.values) {
            *at = value([origin[0] + i / 64, origin[1] + i / 8 % 8, origin[2] + i % 8]);
        }
        brick
    }

    #[test]
    fn pixels_are_the_voxels_they_stand_for() {
        let bricks: Vec<Brick> =
            (0..8).map(|i: i32| brick([8 * (i / 4) - 8, 8 * (i / 2 % 2) - 8, 8 * (i % 2) - 8])).collect();
        for axis in [Axis::X, Axis::Y, Axis::Z] {
            // Cuts through bricks on all sides.
            let slicing = Slicing::new(axis, [[-5, -3, -7], [2, 6, 4]]).unwrap();
            assert_eq!(slicing.count(), [8, 10, 12][axis.number()]);
            let [width, height] = slicing.pixels();
            for plane in 0..slicing.count() {
                assert_eq!(slicing.plane(slicing.index(plane).into()), Some(plane));
                let values = slicing.of_bricks(&bricks, plane);
                assert_eq!(values.len(), width * height);
                for (pixel, found) in values.into_iter().enumerate() {
                    let voxel = slicing.voxel(plane, [pixel % width, pixel / width]);
                    assert_eq!(found, value(voxel), "{axis:?} {voxel:?}");
                }
            }
            // To the right and up the other two axes grow.
            let corner = slicing.voxel(0, [0, height - 1]);
            assert_eq!(corner, [-5, -3, -7]);
            let [right, up] = axis.across();
            assert_eq!(slicing.voxel(0, [1, height - 1])[right], corner[right] + 1);
            assert_eq!(slicing.voxel(0, [0, height - 2])[up], corner[up] + 1);
        }
    }

    #[test]
    fn layers_of_leaves_part_the_planes() {
        let slicing = Slicing::new(Axis::Z, [[0, 0, -11], [0, 0, 9]]).unwrap();
        let mut layers = Vec::new();
        let mut plane = 0;
        while plane < slicing.count() {
            layers.push(slicing.layer(plane));
            plane = slicing.layer(plane).end;
        }
        assert_eq!(layers, [0..3, 3..11, 11..19, 19..21]);
        assert_eq!(slicing.plane(-12), None);
        assert_eq!(slicing.plane(10), None);
        assert!(Slicing::new(Axis::X, [[0; 3], [0, -1, 0]]).is_none());
    }
}
