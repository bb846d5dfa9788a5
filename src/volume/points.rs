//! The density at any points, by the kernel.

use glam::DVec3;
use rayon::prelude::*;

use super::dispatch::evaluate_block;
use super::plan::{Plan, PlanError};
use crate::field::kernel::{Places, Scratch};
use crate::field::{Extent, Field, Lattice, Region, VOXELS};
use crate::num::{Level, Scalar};

/// The density at points of the world, in metres, as a bake at this lattice would have it there: octaves fade as they do
/// for its voxels, but the points need not be their centres. Points that are not finite have density 0.
///
/// Works on the current `rayon` pool. Points that lie together are evaluated together, in whatever order they come.
///
/// # Errors
///
/// As [`Plan::new`]: when the lattice is too fine for `budget` bytes of plan.
pub fn density_at(
    field: &Field,
    lattice: Lattice,
    points: &[DVec3],
    level: Level,
    budget: u64,
) -> Result<Vec<f32>, PlanError> {
    let plan = Plan::for_extent(field, lattice, Extent::Whole, budget)?;
    Ok(planned_density_at(field, &plan, points, level))
}

/// The same with a plan of the field for [`Extent::Whole`], for many lists of points.
///
/// A value may depend on the other points of its brick in the list, by less than its rounding.
pub fn planned_density_at(field: &Field, plan: &Plan, points: &[DVec3], level: Level) -> Vec<f32> {
    /// Points that are put in order at once: their numbers have 32 bits, as those of bricks.
    const MOST: usize = 1 << 30;
    /// Points whose values wait for their places.
    const TOGETHER: usize = 1 << 14;
    let mut values = vec![0.0; points.len()];
    for (points, values) in points.chunks(MOST).zip(values.chunks_mut(MOST)) {
        let order = in_order(plan, points);
        let mut groups = order.chunk_by(|a, b| a.0 == b.0).flat_map(|group| group.chunks(VOXELS)).peekable();
        while groups.peek().is_some() {
            let mut count = 0;
            let mut some: Vec<&[Placed]> = Vec::new();
            while let Some(group) = groups.next_if(|_| count < TOGETHER) {
                count += group.len();
                some.push(group);
            }
            // A group may be of one point.
            let found: Vec<Box<[f32]>> = some
                .par_iter()
                .map_init(Worker::default, |worker, group| {
                    worker.evaluate(field, plan, group, points, level)[..group.len()].into()
                })
                .collect();
            for (group, found) in some.iter().zip(found) {
                for (&(_, index), value) in group.iter().zip(found) {
                    values[index as usize] = value;
                }
            }
        }
    }
    values
}

/// The numbers of a brick and of a point in it.
type Placed = (u32, u32);

/// The points that lie in a plan's bricks, brick by brick.
fn in_order(plan: &Plan, points: &[DVec3]) -> Vec<Placed> {
    /// Points that are looked up at once.
    const TOGETHER: usize = 1 << 16;
    let lattice = plan.lattice();
    let placed = |(index, point): (usize, &DVec3)| {
        let brick = plan.find(brick_of(*point, lattice)?)?;
        Some((u32::try_from(brick).ok()?, u32::try_from(index).ok()?))
    };
    let mut order = Vec::with_capacity(points.len());
    for (number, some) in points.chunks(TOGETHER).enumerate() {
        let numbered = some.par_iter().enumerate().map(|(at, point)| (TOGETHER * number + at, point));
        order.extend(numbered.filter_map(placed).collect::<Vec<_>>());
    }
    order.par_sort_unstable();
    order
}

#[allow(clippy::cast_possible_truncation, reason = "saturates, and no brick lies there")]
fn brick_of(point: DVec3, lattice: Lattice) -> Option<[i64; 3]> {
    let brick = point / (8.0 * lattice.voxel_size);
    brick.is_finite().then(|| brick.floor().to_array().map(|b| b as i64))
}

#[derive(Default)]
struct Worker {
    region: Region<f32>,
    scratch: Scratch<f32>,
}

impl Worker {
    /// The density at points of one brick, in order.
    fn evaluate(
        &mut self,
        field: &Field,
        plan: &Plan,
        group: &[Placed],
        points: &[DVec3],
        level: Level,
    ) -> [f32; VOXELS] {
        let Some(&(brick, _)) = group.first() else { return [0.0; VOXELS] };
        let brick = brick as usize;
        let h = plan.lattice().voxel_size;
        #[allow(clippy::cast_precision_loss, reason = "brick coordinates fit 29 bits")]
        let centre = DVec3::from(plan.block(brick).map(|b| (b as f64 + 0.5) * 8.0 * h));
        let mut axes = [[0.0; VOXELS]; 3];
        for (place, &(_, index)) in group.iter().enumerate() {
            let local = (points[index as usize] - centre) / h;
            for axis in 0..3 {
                axes[axis][place] = f32::from_f64(local[axis]);
            }
        }
        plan.narrow(field, brick, &mut self.region);
        let mut values = [0.0; VOXELS];
        let [x, y, z] = &axes;
        evaluate_block(level, &self.region, Places::Points([x, y, z]), &mut self.scratch, &mut values);
        values
    }
}
