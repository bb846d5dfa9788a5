//! Points over all that a bake shows: its bricks, and as far beside them as a filter reaches.

use glam::DVec3;
use rayon::prelude::*;

use super::random::unit;
use super::support::Spread;
use crate::volume::Plan;

/// About `count` points spread evenly over a plan's bricks and `margin` voxels (at most 8) around each, in the same places
/// at every run: one in each of as many equal parts, at a place of its own. Other numbers of `stream` give other points.
pub fn around(plan: &Plan, margin: f64, count: usize, stream: u64) -> Spread {
    const MOST: usize = 64;
    if plan.bricks() == 0 {
        return Spread { points: vec![], volume: 0.0 };
    }
    let mut draws = count.max(1);
    let mut points = draw(plan, margin, draws, stream, count);
    if points.len() < count {
        draws = (draws * count / points.len().max(1)).min(MOST * draws);
        drop(points);
        points = draw(plan, margin, draws, stream, count);
    }
    let edge = (8.0 + 2.0 * margin) * plan.lattice().voxel_size;
    #[allow(clippy::cast_precision_loss, reason = "counts")]
    let [bricks, part] = [plan.bricks() as f64, points.len() as f64 / draws as f64];
    Spread { points, volume: bricks * edge * edge * edge * part }
}

/// About `count` points.
fn draw(plan: &Plan, margin: f64, draws: usize, stream: u64, count: usize) -> Vec<DVec3> {
    /// Draws whose points are put behind those of others at once.
    const TOGETHER: usize = 1 << 14;
    let h = plan.lattice().voxel_size;
    #[allow(
        clippy::cast_precision_loss,
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "counts"
    )]
    let point = |n: usize| {
        let number = |part: u64| unit(stream, 4 * n as u64 + part);
        let place = (n as f64 + number(0)) / draws as f64 * plan.bricks() as f64;
        let brick = (place as usize).min(plan.bricks() - 1);
        let local = DVec3::new(number(1), number(2), number(3)) * (8.0 + 2.0 * margin) - margin;
        let block = plan.block(brick);
        // What lies around several bricks counts for the first of them.
        let first = beside(local, margin).all(|offset| {
            let other = [0, 1, 2].map(|axis| block[axis] + offset[axis]);
            plan.find(other).is_none_or(|other| other >= brick)
        });
        let corner = DVec3::from(block.map(|b| 8.0 * b as f64));
        first.then(|| (corner + local) * h)
    };
    let mut points = Vec::with_capacity(count + count / 16);
    for first in (0..draws).step_by(TOGETHER) {
        let together = first..draws.min(first + TOGETHER);
        points.extend(together.into_par_iter().filter_map(point).collect::<Vec<_>>());
    }
    points
}

/// The bricks around which a place of a brick lies, by their distance from it in bricks.
fn beside(local: DVec3, margin: f64) -> impl Iterator<Item = [i64; 3]> {
    let near = |c: f64| [(-1, c < margin), (0, c > -margin && c < 8.0 + margin), (1, c > 8.0 - margin)];
    let [xs, ys, zs] = local.to_array().map(near);
    let all = xs.into_iter().flat_map(move |x| {
        ys.into_iter()
            .flat_map(move |y| zs.into_iter().map(move |z| ([x, y, z].map(|part| part.0), x.1 && y.1 && z.1)))
    });
    all.filter(|(_, near)| *near).map(|(offset, _)| offset)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::field::{Field, Lattice};
    use crate::scene::Scene;

    #[test]
    fn bricks_and_what_is_around_them_are_covered_evenly() {
        // A ball within one brick of each of the eight octants: a cube of two bricks' edge.
        let text = "[bake]\nwiden = false\n[[tube]]\nradius = 0.4\ncaps = \"round\"\n\
            curve = { points = [[0, 0, -0.1], [0, 0, 0], [0, 0, 0.1]] }";
        let field = Field::compile(&Scene::parse(text, "ball").expect("valid"));
        let plan = Plan::new(&field, Lattice { voxel_size: 0.1 }, 1 << 24).expect("small");
        assert_eq!(plan.bricks(), 8);
        let Spread { points, volume } = around(&plan, 1.0, 20_000, 1);
        let whole: f64 = 1.8 * 1.8 * 1.8;
        // Five standard deviations of a count of some 60 % of the draws.
        assert!((volume / whole - 1.0).abs() < 0.03, "{volume}");
        assert!(points.len() >= 19_000);
        let inside = points.iter().filter(|p| p.abs().max_element() < 0.8).count();
        #[allow(clippy::cast_precision_loss, reason = "small")]
        let part = inside as f64 / points.len() as f64;
        let expected: f64 = 1.6 * 1.6 * 1.6 / whole;
        assert!(
            (part - expected).abs() < 5.0 * (expected * (1.0 - expected) / 20_000.0).sqrt(),
            "{part} {expected}"
        );
        assert!(points.iter().all(|p| p.abs().max_element() <= 0.9 + 1e-12));
        assert_ne!(points, around(&plan, 1.0, 20_000, 2).points);
    }
}
