//! Densities of a medium at many places, brick by brick, and along single rays.

use glam::DVec3;
use rayon::prelude::*;

use super::camera::Ray;
use super::grid::EDGE;
use super::medium::Medium;
use super::procedural::Worker;
use super::segment::GAUSS;
use super::walk::{Step, Walk};
use crate::num::Level;

/// A place in a brick.
#[derive(Debug, Clone, Copy)]
pub(super) struct Spot {
    pub(super) brick: usize,
    /// In cells from the brick's corner.
    pub(super) local: DVec3,
}

/// Places of a brick that are evaluated together at most.
const TOGETHER: usize = 512;

impl Medium<'_> {
    /// The densities at spots, in their order. Works on the current `rayon` pool; which spots are evaluated together does
    /// not depend on it.
    pub(super) fn densities_at(&self, spots: &[Spot], level: Level) -> Vec<f32> {
        if let Medium::Baked(baked) = self {
            return spots.par_iter().with_min_len(256).map(|spot| baked.density(spot)).collect();
        }
        let mut order: Vec<(usize, usize)> =
            spots.iter().enumerate().map(|(number, spot)| (spot.brick, number)).collect();
        order.par_sort_unstable();
        let groups: Vec<&[(usize, usize)]> =
            order.chunk_by(|a, b| a.0 == b.0).flat_map(|group| group.chunks(TOGETHER)).collect();
        let found: Vec<Vec<f32>> = groups
            .par_iter()
            .map_init(
                || (Worker::default(), Vec::new()),
                |(worker, places), group| {
                    places.clear();
                    places.extend(group.iter().map(|(_, number)| spots[*number].local));
                    let mut out = Vec::with_capacity(group.len());
                    if let Some((brick, _)) = group.first() {
                        self.densities(*brick, places, level, worker, &mut out);
                    }
                    out
                },
            )
            .collect();
        let mut densities = vec![0.0; spots.len()];
        for (group, found) in groups.iter().zip(found) {
            for ((_, number), density) in group.iter().zip(found) {
                densities[*number] = density;
            }
        }
        densities
    }

    /// The densities at points of the world, in metres; 0 where the medium has no bricks, and at points that are not
    /// finite. Those of one brick are evaluated together, on the current `rayon` pool.
    pub fn density_at(&self, points: &[DVec3], level: Level) -> Vec<f32> {
        let mut spots = Vec::new();
        let mut numbers = Vec::new();
        for (number, point) in points.iter().enumerate() {
            if let Some(spot) = self.spot(*point) {
                spots.push(spot);
                numbers.push(number);
            }
        }
        let mut densities = vec![0.0; points.len()];
        for (number, density) in numbers.into_iter().zip(self.densities_at(&spots, level)) {
            densities[number] = density;
        }
        densities
    }

    fn spot(&self, point: DVec3) -> Option<Spot> {
        let place = self.grid().to_grid(point);
        let edge = f64::from(EDGE);
        let block = (place / edge).floor();
        let most = f64::from(i32::MAX);
        if !block.is_finite() || block.abs().max_element() > most {
            return None;
        }
        #[allow(clippy::cast_possible_truncation, reason = "within the range")]
        let at = block.to_array().map(|c| c as i32);
        let brick = self.bricks().nodes().find(at)?;
        Some(Spot { brick, local: place - block * edge })
    }

    /// The optical depth along a ray from one place to another, both in metres and at least 0, of the extinction at
    /// density 1 per metre. The second place may be infinite.
    ///
    /// Of voxels it is exact, in double precision: two samples of Gauss's rule in every cell. A scene's density is sampled
    /// by the same rule in steps of the medium's length.
    pub fn optical_depth(&self, ray: &Ray, range: [f64; 2], extinction: f64, level: Level) -> f64 {
        self.optical_depths(&[(*ray, range)], extinction, f64::INFINITY, level)[0]
    }

    /// The same of many rays. Those deeper than `enough` may be told to be anything beyond it.
    pub(super) fn optical_depths(
        &self,
        rays: &[(Ray, [f64; 2])],
        extinction: f64,
        enough: f64,
        level: Level,
    ) -> Vec<f64> {
        match self {
            Medium::Baked(baked) => {
                let depth = |(ray, range): &(Ray, [f64; 2])| baked.depth(ray, *range, extinction, enough);
                rays.iter().map(depth).collect()
            }
            Medium::Procedural(procedural) => {
                let (mut spots, mut weights) = (Vec::new(), Vec::new());
                for (number, (ray, range)) in rays.iter().enumerate() {
                    let ray = self.grid().ray(ray);
                    let mut walk = Walk::new(self.bricks().nodes(), &ray, *range);
                    while let Some(step) = walk.next(self.bricks().nodes()) {
                        samples(&walk, &step, procedural.step() * ray.metres, |local, length| {
                            spots.push(Spot { brick: step.brick, local });
                            weights.push((number, length));
                        });
                    }
                }
                let mut depths = vec![0.0; rays.len()];
                for ((number, length), density) in weights.into_iter().zip(self.densities_at(&spots, level)) {
                    depths[number] += length * f64::from(density) * extinction;
                }
                depths
            }
        }
    }
}

/// Gauss's samples of a brick's part of a ray in segments no longer than `longest`, each with the length it stands for.
fn samples(walk: &Walk, step: &Step, longest: f64, mut sample: impl FnMut(DVec3, f64)) {
    let way = step.end - step.begin;
    // As many there and back again, whatever rounding does to whole numbers of steps.
    let count = (way / longest * (1.0 - 1e-9)).ceil().max(1.0);
    let length = way / count;
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a brick has few")]
    for segment in 0..count as u32 {
        for gauss in GAUSS {
            let at = step.begin + (f64::from(segment) + gauss) * length;
            sample(step.local(&walk.line, at), 0.5 * length);
        }
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "what is not there fails the test")]

    use super::super::testing::{H, baked, noisy, patchy, procedural, rough};
    use super::*;
    use crate::field::Lattice;
    use crate::volume::testing::unit;
    use crate::volume::{Tree, density_at};

    /// Linear along each axis between voxels, by their indices.
    fn naive(tree: &Tree<f32>, place: DVec3) -> f64 {
        let cell = place.floor();
        let t = place - cell;
        #[allow(clippy::cast_possible_truncation, reason = "small")]
        let first = cell.to_array().map(|c| c as i32);
        let mut sum = 0.0;
        for n in 0..8 {
            let far = [n >> 2 & 1, n >> 1 & 1, n & 1];
            let weight: f64 =
                (0..3).map(|axis| if far[axis] == 1 { t[axis] } else { 1.0 - t[axis] }).product();
            sum += weight * f64::from(tree.value([0, 1, 2].map(|axis| first[axis] + far[axis])).0);
        }
        sum
    }

    /// Rays through the leaves of `patchy`: any, along axes, in faces between cells and between bricks, along edges and
    /// diagonals, from inside, with components that are -0.
    fn rays() -> Vec<Ray> {
        let mut state = 5;
        let mut any = |scale: f64| DVec3::from([0; 3].map(|_| (unit(&mut state) - 0.5) * scale));
        let mut rays = Vec::new();
        for _ in 0..20 {
            let (to, from) = (any(20.0 * H), any(3.0).normalize() * 3.0);
            rays.push(Ray { origin: from, direction: (to - from).normalize() });
            rays.push(Ray { origin: to, direction: any(1.0).normalize() });
        }
        for axis in 0..3 {
            for place in [0.0, 8.0, -8.0, 3.0, 2.5, 16.0, 15.999_999] {
                let mut direction = DVec3::splat(-0.0);
                direction[axis] = 1.0;
                let mut origin = DVec3::splat(place * H) + DVec3::new(0.0, 2.0 * H, -3.3 * H);
                origin[axis] = -30.0 * H;
                rays.push(Ray { origin, direction });
                rays.push(Ray { origin: origin + direction * 60.0 * H, direction: -direction });
            }
        }
        rays.push(Ray { origin: DVec3::splat(-2.0), direction: DVec3::ONE.normalize() });
        rays.push(Ray { origin: DVec3::new(0.0, 0.5, 0.2), direction: DVec3::X });
        rays
    }

    #[test]
    fn the_depth_through_voxels_is_the_integral_of_their_density() {
        let tree = rough(&patchy(), 5.0);
        let medium = baked(&tree);
        let mut most: f64 = 0.0;
        for ray in rays() {
            let depth = medium.optical_depth(&ray, [0.0, f64::INFINITY], 2.0, Level::best());
            let far = 12.0;
            // The midpoint rule: kinks at faces cost it some 5 * 2 * dx^2 each.
            let n = 40_000;
            let dx = far / f64::from(n);
            let sum: f64 =
                (0..n).map(|i| naive(&tree, ray.at((f64::from(i) + 0.5) * dx) / H)).sum::<f64>() * 2.0 * dx;
            assert!((depth - sum).abs() < 3e-4, "{ray:?}: {depth}, not {sum}");
            let back = Ray { origin: ray.at(far), direction: -ray.direction };
            let again = medium.optical_depth(&back, [0.0, far], 2.0, Level::best());
            assert!((depth - again).abs() < 1e-9, "{ray:?}: {depth}, backwards {again}");
            let parts = [[0.0, 1.7], [1.7, 3.1], [3.1, f64::INFINITY]];
            let parts: f64 =
                parts.map(|range| medium.optical_depth(&ray, range, 2.0, Level::best())).iter().sum();
            assert!((depth - parts).abs() < 1e-9, "{ray:?}: {depth}, in parts {parts}");
            most = most.max(depth);
        }
        assert!(most > 5.0);
    }

    #[test]
    fn densities_at_points_are_those_of_the_medium() {
        let tree = rough(&patchy(), 5.0);
        let field = noisy();
        let mut state = 9;
        let mut points: Vec<DVec3> =
            (0..3000).map(|_| DVec3::from([0; 3].map(|_| (unit(&mut state) - 0.5) * 2.4))).collect();
        points.push(DVec3::NAN);
        points.push(DVec3::splat(1e300));
        let found = baked(&tree).density_at(&points, Level::best());
        for (point, found) in points.iter().zip(&found).take(3000) {
            // One rounding to single precision.
            assert!((f64::from(*found) - naive(&tree, *point / H)).abs() < 1e-6);
        }
        assert_eq!(found[3000..], [0.0; 2]);
        let found = procedural(&field, 1.0).density_at(&points, Level::best());
        let other = density_at(&field, Lattice { voxel_size: H }, &points, Level::best(), u64::MAX).unwrap();
        assert!(found.iter().filter(|density| **density > 0.0).count() > 100);
        for (found, other) in found.into_iter().zip(other) {
            // Where a search for a foot ends may depend on who is searched for beside it: 1e-5 voxels.
            assert!((found - other).abs() < 1e-4, "{found}, not {other}");
        }
    }

    #[test]
    fn the_depth_through_a_scene_is_the_integral_of_its_density() {
        let field = noisy();
        let medium = procedural(&field, 0.5);
        let mut most: f64 = 0.0;
        for ray in rays() {
            let depth = medium.optical_depth(&ray, [0.0, f64::INFINITY], 2.0, Level::best());
            let n = 8000;
            let dx = 8.0 / f64::from(n);
            let points: Vec<DVec3> = (0..n).map(|i| ray.at((f64::from(i) + 0.5) * dx)).collect();
            let densities = medium.density_at(&points, Level::best());
            let sum = densities.iter().map(|density| f64::from(*density)).sum::<f64>() * 2.0 * dx;
            // Kinks where the threshold is, in steps of half a voxel.
            assert!((depth - sum).abs() < 2e-3, "{ray:?}: {depth}, not {sum}");
            let back = Ray { origin: ray.at(8.0), direction: -ray.direction };
            let again = medium.optical_depth(&back, [0.0, 8.0], 2.0, Level::best());
            assert!((depth - again).abs() < 1e-4, "{ray:?}: {depth}, backwards {again}");
            most = most.max(depth);
        }
        assert!(most > 0.3);
    }
}
