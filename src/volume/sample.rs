//! Filters: the values of a tree between its voxels.

use glam::DVec3;
use rayon::prelude::*;

use super::accessor::Accessor;
use super::tree::Tree;
use super::value::Value;

/// How values between voxels come from those of voxels. The value of voxel (i, j, k) belongs to the point (i, j, k) of
/// index space, and every filter gives it there, to the bit.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Filter {
    /// The value of the nearest voxel; halfway, that of the larger index.
    Nearest,
    /// Linear along each axis, from 2^3 voxels. Continuous; affine fields are reproduced.
    Trilinear,
    /// Catmull-Rom splines along z, then y, then x, from 4^3 voxels; after each step what leaves the range of the two
    /// values between which it lies is clamped to it.
    ///
    /// So no value leaves the range of the 2^3 voxels around it: there is no density below 0 and no ringing at edges.
    /// Since the clamp acts on one axis at a time, the result is continuous, which it would not be were the sum of 4^3
    /// voxels clamped. Where nothing is clamped quadratic fields are reproduced and the error is O(h^3); in cells with an
    /// extremum it is that of linear filtering, O(h^2).
    Cubic,
}

/// Types of values that can be filtered.
pub trait Sampled: Value {
    /// What filtering gives: an `f64`, or three.
    type Wide: Wide;

    /// The value in double precision: exact, but for integers beyond 2^53.
    fn wide(self) -> Self::Wide;
}

/// Numbers that filters work with.
pub trait Wide: Copy + Send + sealed::Sealed {
    /// Linear between two values.
    #[doc(hidden)]
    fn linear(values: [Self; 2], t: f64) -> Self;
    /// The sum of four values with weights, clamped to the range of the two in the middle.
    #[doc(hidden)]
    fn cubic(values: [Self; 4], weights: [f64; 4]) -> Self;
}

mod sealed {
    pub trait Sealed {}
    impl Sealed for f64 {}
    impl Sealed for [f64; 3] {}
}

impl Wide for f64 {
    #[inline]
    fn linear([a, b]: [f64; 2], t: f64) -> f64 {
        // Rounding may lead out of the range, by a little.
        clamp(a * (1.0 - t) + b * t, a, b)
    }

    #[inline]
    fn cubic([a, b, c, d]: [f64; 4], [u, v, w, x]: [f64; 4]) -> f64 {
        clamp((a * u + d * x) + (b * v + c * w), b, c)
    }
}

impl Wide for [f64; 3] {
    fn linear([a, b]: [[f64; 3]; 2], t: f64) -> [f64; 3] {
        std::array::from_fn(|axis| f64::linear([a[axis], b[axis]], t))
    }

    fn cubic(values: [[f64; 3]; 4], weights: [f64; 4]) -> [f64; 3] {
        std::array::from_fn(|axis| f64::cubic(values.map(|value| value[axis]), weights))
    }
}

/// NaN stays, but for that of infinite values that are equal.
#[inline]
fn clamp(value: f64, a: f64, b: f64) -> f64 {
    if a == b {
        return a;
    }
    let (low, high) = if a < b { (a, b) } else { (b, a) };
    if value < low {
        low
    } else if value > high {
        high
    } else {
        value
    }
}

macro_rules! sampled {
    ($($type:ty),*) => {$(
        impl Sampled for $type {
            type Wide = f64;

            #[inline]
            fn wide(self) -> f64 {
                self.into()
            }
        }
    )*};
}
sampled!(f32, f64, i32);

impl Sampled for bool {
    type Wide = f64;

    fn wide(self) -> f64 {
        f64::from(u8::from(self))
    }
}

impl Sampled for i64 {
    type Wide = f64;

    #[allow(clippy::cast_precision_loss, reason = "documented")]
    fn wide(self) -> f64 {
        self as f64
    }
}

impl<S: Sampled<Wide = f64>> Sampled for [S; 3] {
    type Wide = [f64; 3];

    #[inline]
    fn wide(self) -> [f64; 3] {
        self.map(S::wide)
    }
}

/// Filters the values of a tree. Quickest where each point is near the last.
#[derive(Debug, Clone)]
pub struct Sampler<'a, T> {
    accessor: Accessor<'a, T>,
    filter: Filter,
}

impl<'a, T: Sampled> Sampler<'a, T> {
    /// A sampler of this tree.
    pub fn new(tree: &'a Tree<T>, filter: Filter) -> Self {
        Self { accessor: Accessor::new(tree), filter }
    }

    /// The value at a point of index space. Space that is not stored has the background's value, and so have points
    /// that no voxel's index is near: see [`is_indexed`].
    pub fn sample(&mut self, at: DVec3) -> T::Wide {
        let Some(Place { base, t }) = Place::new(self.filter, at) else {
            return self.accessor.tree().background().wide();
        };
        match self.filter {
            Filter::Nearest => {
                let [[[value]]] = self.accessor.stencil(base);
                value.wide()
            }
            Filter::Trilinear => along_axes(self.accessor.stencil(base), t, linear),
            Filter::Cubic => along_axes(self.accessor.stencil(base), t.map(Knots::new), Knots::interpolate),
        }
    }
}

/// Where a filter finds the value at a point.
struct Place {
    /// The first of the voxels that it takes.
    base: [i64; 3],
    /// Where the point lies in the cell between two voxels.
    t: [f64; 3],
}

impl Place {
    /// `None` where no voxel's index is near.
    #[inline]
    fn new(filter: Filter, at: DVec3) -> Option<Place> {
        if !is_indexed(at) {
            return None;
        }
        let cell = at.floor();
        let t = (at - cell).to_array();
        #[allow(clippy::cast_possible_truncation, reason = "whole, and within the range of indices")]
        let cell = cell.to_array().map(|c| c as i64);
        let base = match filter {
            Filter::Nearest => std::array::from_fn(|axis| cell[axis] + i64::from(t[axis] >= 0.5)),
            Filter::Trilinear => cell,
            Filter::Cubic => cell.map(|c| c - 1),
        };
        Some(Place { base, t })
    }
}

/// The voxel whose value a filter gives at a point as it is; `None` where it mixes those of several, or where no voxel's
/// index is near.
pub(super) fn voxel(filter: Filter, at: DVec3) -> Option<[i64; 3]> {
    let place = Place::new(filter, at)?;
    match filter {
        Filter::Nearest => Some(place.base),
        _ if place.t != [0.0; 3] => None,
        Filter::Trilinear => Some(place.base),
        Filter::Cubic => Some(place.base.map(|c| c + 1)),
    }
}

/// The first voxels of the leaves that a filter looks into at a point, were there leaves everywhere.
pub(super) fn cubes(filter: Filter, at: DVec3) -> impl Iterator<Item = [i32; 3]> {
    let edge = match filter {
        Filter::Nearest => 1,
        Filter::Trilinear => 2,
        Filter::Cubic => 4,
    };
    Place::new(filter, at).into_iter().flat_map(move |place| {
        // Beyond the range of indices there is no leaf.
        let [xs, ys, zs] = place.base.map(|first| {
            let [a, b] = [first, first + edge - 1].map(|c| i32::try_from(c & !7).ok());
            [a, b.filter(|_| a != b)].into_iter().flatten()
        });
        xs.flat_map(move |x| {
            let zs = zs.clone();
            ys.clone().flat_map(move |y| zs.clone().map(move |z| [x, y, z]))
        })
    })
}

/// Whether a point of index space lies where voxels have indices of 32 bits.
pub fn is_indexed(at: DVec3) -> bool {
    let first = f64::from(i32::MIN);
    at.to_array().iter().all(|c| (first..-first).contains(c))
}

/// The values at points of index space, on all threads of the current `rayon` pool.
pub fn sample_at<T: Sampled>(tree: &Tree<T>, filter: Filter, points: &[DVec3]) -> Vec<T::Wide> {
    // Long enough that the first look-up does not count.
    const RUN: usize = 1024;
    let sampler = Sampler::new(tree, filter);
    points.par_iter().with_min_len(RUN).map_with(sampler, |sampler, point| sampler.sample(*point)).collect()
}

/// Filters along z, then y, then x. `place` says where in the middle of the values of an axis the point lies.
#[inline]
fn along_axes<T: Sampled, P: Copy, const N: usize>(
    values: [[[T; N]; N]; N],
    [x, y, z]: [P; 3],
    filter: impl Fn([T::Wide; N], P) -> T::Wide,
) -> T::Wide {
    filter(values.map(|plane| filter(plane.map(|row| filter(row.map(T::wide), z)), y)), x)
}

/// At a voxel its value is taken as it is: what lies beside it may be infinite.
#[inline]
fn linear<W: Wide>(values: [W; 2], t: f64) -> W {
    if t == 0.0 { values[0] } else { W::linear(values, t) }
}

/// Where between the second and the third of four values a point lies, and their weights.
#[derive(Debug, Clone, Copy)]
struct Knots {
    at_voxel: bool,
    weights: [f64; 4],
}

impl Knots {
    /// Catmull and Rom, "A class of local interpolating splines", 1974.
    fn new(t: f64) -> Knots {
        let weights = [
            0.5 * t * (t * (2.0 - t) - 1.0),
            0.5 * (t * t * (3.0 * t - 5.0) + 2.0),
            0.5 * t * (t * (4.0 - 3.0 * t) + 1.0),
            0.5 * t * t * (t - 1.0),
        ];
        Knots { at_voxel: t == 0.0, weights }
    }

    #[inline]
    fn interpolate<W: Wide>(values: [W; 4], knots: Knots) -> W {
        if knots.at_voxel { values[1] } else { W::cubic(values, knots.weights) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::volume::shape::Tile;
    use crate::volume::testing::{checkered, random, tree, unit};

    const FILTERS: [Filter; 3] = [Filter::Nearest, Filter::Trilinear, Filter::Cubic];

    /// Leaves on all sides of the origin.
    fn block(value: impl Fn(f64, f64, f64) -> f64) -> Tree<f32> {
        let origins: Vec<_> =
            (0..64).map(|n| [n / 16 * 8 - 16, n / 4 % 4 * 8 - 16, n % 4 * 8 - 16]).collect();
        #[allow(clippy::cast_possible_truncation, reason = "the values that the tests take are exact")]
        tree(0.0, &origins, &[], |[x, y, z]| value(x.into(), y.into(), z.into()) as f32)
    }

    /// Points around the seams of the leaves of [`checkered`], some of them on planes of voxels.
    fn points(count: usize, seed: u64) -> Vec<DVec3> {
        let mut state = seed;
        let centres =
            [[0.0; 3], [-8.0; 3], [8.0; 3], [128.0, 0.0, 0.0], [4096.0, 0.0, 0.0], [-4096.0, 4.0, 4.0]];
        (0..count)
            .map(|n| {
                let offset = [(); 3].map(|()| {
                    let offset = 24.0 * unit(&mut state) - 12.0;
                    if random(&mut state).is_multiple_of(4) { offset.round() } else { offset }
                });
                DVec3::from(centres[n % centres.len()]) + DVec3::from(offset)
            })
            .collect()
    }

    #[allow(clippy::cast_possible_truncation, reason = "whole and small")]
    fn nearest(at: DVec3) -> [i32; 3] {
        at.round().to_array().map(|c| c as i32)
    }

    /// The 4^3 voxels around a point, and where it lies in the middle.
    fn around(tree: &Tree<f32>, at: DVec3) -> ([[[f64; 4]; 4]; 4], [f64; 3]) {
        let cell = at.floor();
        let first = nearest(cell);
        let index = |axis: usize, n: usize| first[axis] - 1 + i32::try_from(n).expect("small");
        let value = |x, y, z| f64::from(tree.value([index(0, x), index(1, y), index(2, z)]).0);
        let values =
            std::array::from_fn(|x| std::array::from_fn(|y| std::array::from_fn(|z| value(x, y, z))));
        (values, [0, 1, 2].map(|axis| at[axis] - cell[axis]))
    }

    /// The range of the 2^3 voxels around a point.
    fn range(values: &[[[f64; 4]; 4]; 4]) -> (f64, f64) {
        let inner = values[1..3].iter().flat_map(|plane| &plane[1..3]).flat_map(|row| &row[1..3]);
        inner.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| (low.min(*v), high.max(*v)))
    }

    #[test]
    fn all_filters_give_voxels_their_values() {
        let tree = checkered();
        for filter in FILTERS {
            let mut sampler = Sampler::new(&tree, filter);
            for point in points(4000, 1) {
                assert_eq!(sampler.sample(point.round()), f64::from(tree.value(nearest(point)).0));
            }
        }
    }

    #[test]
    fn filters_follow_their_definitions() {
        let tree = checkered();
        let mut samplers = FILTERS.map(|filter| Sampler::new(&tree, filter));
        for at in points(20_000, 2) {
            let (values, t) = around(&tree, at);
            let [nearest, trilinear, cubic] = samplers.each_mut().map(|sampler| sampler.sample(at));

            let [i, j, k] = t.map(|t| if t < 0.5 { 1 } else { 2 });
            assert_eq!(nearest, values[i][j][k]);

            let mut sum = 0.0;
            for n in 0..8 {
                let corner = [n >> 2 & 1, n >> 1 & 1, n & 1];
                let weight: f64 =
                    corner.iter().zip(t).map(|(c, t)| if *c == 1 { t } else { 1.0 - t }).product();
                sum += weight * values[1 + corner[0]][1 + corner[1]][1 + corner[2]];
            }
            // Values are up to 65536: some roundings.
            assert!((trilinear - sum).abs() < 1e-10, "{at}: {trilinear}, not {sum}");

            let spline = |p: [f64; 4], t: f64| hermite(p, t).clamp(p[1].min(p[2]), p[1].max(p[2]));
            let lines = values.map(|plane| plane.map(|row| spline(row, t[2])));
            let expected = spline(lines.map(|line| spline(line, t[1])), t[0]);
            assert!((cubic - expected).abs() < 1e-9, "{at}: {cubic}, not {expected}");

            let (low, high) = range(&values);
            assert!((low..=high).contains(&trilinear) && (low..=high).contains(&cubic), "{at}");
        }
    }

    /// Catmull-Rom as a cubic with slopes of central differences.
    fn hermite([a, b, c, d]: [f64; 4], t: f64) -> f64 {
        let (m, n) = (0.5 * (c - a), 0.5 * (d - b));
        let (t2, t3) = (t * t, t * t * t);
        (2.0 * t3 - 3.0 * t2 + 1.0) * b + (t3 - 2.0 * t2 + t) * m + (3.0 * t2 - 2.0 * t3) * c + (t3 - t2) * n
    }

    #[test]
    fn linear_and_cubic_reproduce_what_they_promise() {
        let affine = |x: f64, y: f64, z: f64| 0.5 * x - 0.25 * y + 2.0 * z + 8.0;
        // Without an extremum along any axis in the block, so that nothing is clamped.
        let quadratic = |x: f64, y: f64, z: f64| {
            (x + 20.0) * (x + 20.0) + (y - 18.0) * (y - 18.0) * 0.5 + (x + 17.0) * (z + 17.0)
        };
        let mut state = 3;
        let (linear, curved) = (block(affine), block(quadratic));
        let [mut trilinear, mut cubic] =
            [Filter::Trilinear, Filter::Cubic].map(|filter| Sampler::new(&linear, filter));
        let mut curved = Sampler::new(&curved, Filter::Cubic);
        for _ in 0..5000 {
            let at = DVec3::from([(); 3].map(|()| 29.0 * unit(&mut state) - 15.0));
            let exact = affine(at.x, at.y, at.z);
            // The fields' values are exact in single precision and below 2^12: some roundings of double.
            assert!((trilinear.sample(at) - exact).abs() < 1e-11);
            assert!((cubic.sample(at) - exact).abs() < 1e-11);
            assert!((curved.sample(at) - quadratic(at.x, at.y, at.z)).abs() < 1e-11);
        }
    }

    #[test]
    fn cubic_is_continuous_and_not_below_zero() {
        // A step: unclamped, the splines ring on both sides.
        let tree = block(|x, y, z| if x + 0.7 * y - 0.3 * z > 1.0 { 1.0 } else { 0.0 });
        let mut sampler = Sampler::new(&tree, Filter::Cubic);
        let mut state = 4;
        for _ in 0..5000 {
            let mut at = [(); 3].map(|()| 20.0 * unit(&mut state) - 10.0);
            let axis = usize::try_from(random(&mut state) % 3).expect("small");
            at[axis] = at[axis].round();
            let here = sampler.sample(at.into());
            assert!((0.0..=1.0).contains(&here));
            for side in [-1e-9, 1e-9] {
                let mut beside = at;
                beside[axis] += side;
                // Slopes are at most about 2 a voxel.
                assert!((sampler.sample(beside.into()) - here).abs() < 1e-8, "{at:?}");
            }
        }
    }

    #[test]
    fn infinite_neighbours_leave_a_voxel_as_it_is() {
        let tree = tree(f32::INFINITY, &[[0; 3]], &[], |[x, ..]| if x == 3 { f32::NAN } else { -0.0 });
        for filter in FILTERS {
            let mut sampler = Sampler::new(&tree, filter);
            assert_eq!(sampler.sample(DVec3::ZERO).to_bits(), (-0.0_f64).to_bits());
            assert_eq!(sampler.sample(DVec3::new(7.0, 7.0, 7.0)).to_bits(), (-0.0_f64).to_bits());
            assert_eq!(sampler.sample(DVec3::splat(100.5)), f64::INFINITY);
            assert!(sampler.sample(DVec3::splat(3.0)).is_nan());
        }
    }

    #[test]
    fn points_without_an_index_are_background() {
        let tree = checkered();
        for filter in FILTERS {
            let mut sampler = Sampler::new(&tree, filter);
            for far in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 1e300, 2_147_483_648.0, -2_147_483_649.0]
            {
                let at = DVec3::new(0.0, far, 0.0);
                assert!(!is_indexed(at));
                assert_eq!(sampler.sample(at), 0.5);
            }
            for far in [-2_147_483_648.0, 2_147_483_647.75] {
                assert!(is_indexed(DVec3::splat(far)));
                assert_eq!(sampler.sample(DVec3::splat(far)), 0.5);
            }
        }
    }

    #[test]
    fn many_points_are_sampled_as_one_by_one() {
        let tree = checkered();
        let points = points(5000, 5);
        for filter in FILTERS {
            let mut sampler = Sampler::new(&tree, filter);
            let expected: Vec<f64> = points.iter().map(|point| sampler.sample(*point)).collect();
            assert_eq!(sample_at(&tree, filter, &points), expected);
        }
    }

    #[test]
    fn wide_seams_between_tiles_are_filtered() {
        let tile = |origin, log2_edge, value| Tile { origin, log2_edge, value };
        let tree = tree(0.0, &[], &[tile([-128, 0, 0], 7, 2.0), tile([0; 3], 12, 4.0)], |_| 0.0);
        let at = DVec3::new(-0.25, 50.0, 50.0);
        assert_eq!(Sampler::new(&tree, Filter::Nearest).sample(at), 4.0);
        assert_eq!(Sampler::new(&tree, Filter::Trilinear).sample(at), 3.5);
        // Of a step of 2 after three quarters: 2 + 2 (t + t^2 - t^3 + ...) by the weights of the two upper values.
        let t: f64 = 0.75;
        let upper = 0.5 * t * (1.0 + 4.0 * t - 3.0 * t * t) + 0.5 * t * t * (t - 1.0);
        assert_eq!(Sampler::new(&tree, Filter::Cubic).sample(at), 2.0 + 2.0 * upper);
    }
}
