//! Fields with known differences.

use std::f64::consts::PI;

use glam::DVec3;

use super::*;
use crate::field::{Field, Lattice};
use crate::scene::Scene;
use crate::volume::testing::tree;
use crate::volume::{Filter, Tile};

const PLACES: Places = Places { points: 20_000, rays: 400 };

/// A cube of 4^3 leaves around the origin, with voxels of edge h at (i + 1/2) h.
fn grid(h: f64, value: impl Fn(DVec3) -> f64, filter: Filter) -> Gridded<f32> {
    let origins: Vec<_> = (0..64).map(|n| [n / 16 * 8 - 16, n / 4 % 4 * 8 - 16, n % 4 * 8 - 16]).collect();
    #[allow(clippy::cast_possible_truncation, reason = "to single precision")]
    let tree = tree(0.0, &origins, &[], |index| value((DVec3::from(index.map(f64::from)) + 0.5) * h) as f32);
    Gridded::new(tree, rows(h), filter).expect("a regular map")
}

fn rows(h: f64) -> Rows {
    [[h, 0.0, 0.0, 0.5 * h], [0.0, h, 0.0, 0.5 * h], [0.0, 0.0, h, 0.5 * h]]
}

fn near(found: f64, expected: f64, tolerance: f64) -> bool {
    (found - expected).abs() <= tolerance
}

#[test]
fn a_constant_offset_is_found_as_it_is() {
    // Nearest: the fields are constant up to the faces of their leaves.
    let [a, b] = [2.0, 2.5].map(|value| grid(0.25, |_| value, Filter::Nearest));
    let found = compare(&a, &b, PLACES);
    assert_eq!((found.points, found.volume), (20_000, 512.0));
    for scaled in [found.errors.l1, found.errors.l2, found.errors.max, found.errors.p999, found.errors.bias] {
        assert!(near(scaled.absolute, 0.5, 1e-12) && near(scaled.of_rms.expect("not 0"), 0.25, 1e-12));
    }
    let intervals = found.intervals.expect("points");
    assert!(
        [intervals.l1, intervals.l2, intervals.bias].as_flattened().iter().all(|end| near(*end, 0.5, 1e-12))
    );
    assert!(near(found.errors.psnr.expect("a difference"), 20.0 * libm::log10(4.0), 1e-9));
    assert!(near(found.mass.of[0], 1024.0, 1e-9) && near(found.mass.ratio.expect("not 0"), 1.25, 1e-12));
    // Every ray's depth grows by a quarter.
    let depth = found.optical_depth;
    assert!(
        depth.rays == 400
            && near(depth.l2.of_rms.expect("not 0"), 0.25, 1e-12)
            && depth.peak <= 2.0 * 192.0_f64.sqrt()
    );
    let voxels = found.voxels.expect("one lattice");
    assert_eq!((voxels.active, voxels.differ, voxels.max, voxels.rms), ([32_768; 2], 32_768, 0.5, 0.5));
    assert!(voxels.topology_equal && voxels.mass == [1024.0, 1280.0]);
}

#[test]
fn equal_fields_differ_by_nothing() {
    for filter in [Filter::Nearest, Filter::Trilinear, Filter::Cubic] {
        let [a, b] = [0; 2].map(|_| grid(0.1, |p| (p.x * 3.0).abs() + p.y * p.z, filter));
        let found = compare(&a, &b, PLACES);
        assert_eq!((found.errors.max.absolute, found.optical_depth.max.absolute), (0.0, 0.0));
        assert_eq!((found.mass.ratio, found.worst, found.errors.psnr), (Some(1.0), None, None));
        assert_eq!(found, compare(&b, &a, PLACES));
    }
}

#[test]
fn linear_ramps_are_integrated_exactly() {
    // Linear between its voxels' centres, and along rays within them: the difference of ramps a x and b x + c is linear.
    let h = 0.125;
    let a = grid(h, |p| 3.0 * p.x + 8.0, Filter::Trilinear);
    let rule = |chord: &Chord, of: &dyn Fn(f64) -> f64| {
        let [from, to] = chord.range;
        (to - from) * of(chord.origin.x + chord.direction.x * 0.5 * (from + to))
    };
    let inner = [DVec3::splat(-15.5 * h), DVec3::splat(15.5 * h)];
    let points: Vec<_> = spread(a.support(), a.support(), 500).points;
    let within: Vec<_> =
        points.into_iter().map(|point| point.clamp(inner[0] * 0.99, inner[1] * 0.99)).collect();
    let chords = chords(inner, &within, 300);
    for (depth, chord) in a.depths(&chords).into_iter().zip(&chords) {
        // Values are exact in single precision; rounding of some dozens of cells.
        assert!(near(depth, rule(chord, &|x| 3.0 * x + 8.0), 1e-11), "{chord:?} {depth}");
    }
    assert_eq!(chords.len(), 300);
    for (value, point) in a.values(&within).iter().zip(&within) {
        assert!(near(*value, 3.0 * point.x + 8.0, 1e-12));
    }
}

#[test]
fn trilinear_depths_are_those_of_fine_sums() {
    // Random values: cubic within every cell along a line.
    let a =
        grid(0.5, |p| random::unit(7, (p.x * 4096.0 + p.y * 64.0 + p.z + 1e6).to_bits()), Filter::Trilinear);
    for filter in [Filter::Nearest, Filter::Trilinear, Filter::Cubic] {
        let a = Gridded::new(tree_of(&a), rows(0.5), filter).expect("regular");
        let points = spread(a.support(), a.support(), 64).points;
        let bounds = [DVec3::splat(-12.0), DVec3::splat(12.0)];
        let chords = chords(bounds, &points, 20);
        for (depth, chord) in a.depths(&chords).into_iter().zip(&chords) {
            const STEPS: u32 = 40_000;
            let [from, to] = chord.range;
            let length = (to - from) / f64::from(STEPS);
            let middles: Vec<DVec3> = (0..STEPS)
                .map(|n| chord.origin + chord.direction * (from + (f64::from(n) + 0.5) * length))
                .collect();
            let sum: f64 = a.values(&middles).iter().sum::<f64>() * length;
            // Midpoints are off by h^2 where values are smooth, by some h at the jumps of nearest ones; the clamp of cubic ones
            // leaves kinks inside cells, which five points see to some 1e-3 of a cell.
            let tolerance = if filter == Filter::Cubic { 0.02 } else { 2e-3 };
            assert!(near(depth, sum, tolerance), "{filter:?} {depth} {sum}");
        }
    }
}

/// The grid's values once more.
fn tree_of(grid: &Gridded<f32>) -> crate::volume::Tree<f32> {
    let origins: Vec<_> = (0..64).map(|n| [n / 16 * 8 - 16, n / 4 % 4 * 8 - 16, n % 4 * 8 - 16]).collect();
    #[allow(clippy::cast_possible_truncation, reason = "from single precision")]
    let value = |index| grid.voxels().map_or(0.0, |voxels| voxels.voxel(index).0 as f32);
    tree(0.0, &origins, &[], value)
}

#[test]
fn a_gaussian_ball_has_its_mass_and_its_depths() {
    // sigma = 4 voxels of 0.1; the cube ends at 4 sigma.
    let sigma = 0.4;
    let ball = |p: DVec3| libm::exp(-p.length_squared() / (2.0 * sigma * sigma));
    let a = grid(0.1, ball, Filter::Trilinear);
    let found = compare(&a, &a, Places { points: 200_000, rays: 10 });
    let mass = libm::pow(2.0 * PI, 1.5) * sigma * sigma * sigma;
    // Linear filtering widens the ball by h^2 / 6 a side, and not its mass; beyond 4 sigma lie 1e-4 of it.
    assert!(near(found.mass.of[0], mass, 2e-4 * mass + found.mass.uncertainty[0]), "{:?} {mass}", found.mass);
    // Two standard deviations of the mean: the ball fills little of the cube.
    assert!(found.mass.uncertainty[0] < 0.02 * mass);
    assert!(near(found.voxels.expect("one lattice").mass[0], mass, 3e-4 * mass));
    for offset in [0.0, 0.3, 0.7] {
        let chord = Chord { origin: DVec3::new(0.0, offset, 0.0), direction: DVec3::X, range: [-3.0, 3.0] };
        let expected = sigma * (2.0 * PI).sqrt() * libm::exp(-offset * offset / (2.0 * sigma * sigma));
        // Halfway between voxels linear filtering is off by h^2 / 8 times the second derivative: h^2 / (8 sigma^2) of the peak
        // along each of the two axes across the ray.
        let tolerance = 2.0 * 0.01 / (8.0 * sigma * sigma) * sigma * (2.0 * PI).sqrt();
        assert!(near(a.depths(&[chord])[0], expected, tolerance), "{offset}");
    }
}

#[test]
fn half_a_voxel_is_noticed() {
    let h = 0.1;
    let ball = |p: DVec3| libm::exp(-p.length_squared() / 0.32);
    let [a, b] = [0.0, 0.5 * h].map(|shift| grid(h, move |p| ball(p - DVec3::X * shift), Filter::Trilinear));
    let found = compare(&a, &b, PLACES);
    // Over sigma = 0.4 the shift is 1/8 sigma: relative L2 of a Gaussian is shift / (sqrt(2) sigma).
    let expected = 0.125 / 2.0_f64.sqrt();
    assert!(near(found.errors.l2.of_rms.expect("not 0"), expected, 0.05 * expected), "{:?}", found.errors.l2);
    // The same values on a shifted lattice are as far off, and no voxels to compare.
    let a = grid(h, ball, Filter::Trilinear);
    let mut map = rows(h);
    map[0][3] += 0.5 * h;
    let b = Gridded::new(tree_of(&a), map, Filter::Trilinear).expect("regular");
    let shifted = compare(&a, &b, PLACES);
    assert!(shifted.voxels.is_none());
    assert!(near(shifted.errors.l2.of_rms.expect("not 0"), expected, 0.05 * expected));
}

#[test]
fn tiles_are_compared_as_the_voxels_they_stand_for() {
    let tile = |log2_edge, value| Tile { origin: [0; 3], log2_edge, value };
    let of = |leaves: &[[i32; 3]], tiles: &[Tile], value: f32| {
        Gridded::new(tree(0.0, leaves, tiles, |_| value), rows(1.0), Filter::Nearest).expect("regular")
    };
    let (leaf, small) = (of(&[[0; 3]], &[], 2.0), of(&[], &[tile(3, 2.0)], 0.0));
    let same = compare(&leaf, &small, PLACES).voxels.expect("one lattice");
    assert_eq!((same.active, same.differ, same.topology_equal), ([512; 2], 0, true));
    let large = of(&[], &[tile(12, 2.5)], 0.0);
    let found = compare(&leaf, &large, PLACES).voxels.expect("one lattice");
    let all = 1 << 36;
    assert_eq!((found.active, found.only, found.differ), ([512, all], [0, all - 512], all));
    assert_eq!((found.max, found.mass_ratio), (2.5, Some(2.5 * 68_719_476_736.0 / 1024.0)));
}

#[test]
fn values_that_are_no_numbers_are_named() {
    let a = grid(1.0, |_| 1.0, Filter::Nearest);
    let b = grid(1.0, |p| if p.x > 15.0 { f64::NAN } else { 1.0 }, Filter::Nearest);
    let found = compare(&a, &b, PLACES);
    let [of_a, of_b] = found.errors.not_finite;
    // One of 32 layers, to five standard deviations.
    assert!(of_a == 0 && of_b.abs_diff(625) < 125, "{of_b}");
    assert!(found.not_finite_at.is_some_and(|[x, ..]| x > 15.0) && found.errors.max.absolute == 0.0);
    assert!(found.optical_depth.not_finite[1] > 0);
    assert_eq!(found.voxels.expect("one lattice").not_finite, 1024);
}

#[test]
fn nothing_compared_with_nothing_is_equal() {
    let nothing = Gridded::new(tree(0.0, &[], &[], |_| 0.0), rows(1.0), Filter::Trilinear).expect("regular");
    let found = compare(&nothing, &nothing, PLACES);
    assert_eq!(
        (found.points, found.volume, found.mass.ratio, found.errors.l2.of_rms),
        (0, 0.0, None, Some(0.0))
    );
}

/// A straight tube of radius 1 and length 2 with a smooth envelope, on a lattice of edge h.
fn tube(h: f64) -> (Field, Lattice) {
    let text = "[bake]\nwiden = false\n[[tube]]\nradius = 1\ncaps = \"flat\"\n\
        curve = { points = [[0, 0, -1], [0, 0, 0], [0, 0, 1]] }";
    let scene = Scene::parse(text, "tube").expect("valid");
    (Field::compile(&scene), Lattice { voxel_size: h })
}

#[test]
fn a_tube_has_its_mass_and_its_depths() {
    let (field, lattice) = tube(0.05);
    let a = Procedural::new(field, lattice, 1 << 30).expect("small");
    // Integral of (1 - q)^2 over the cross-section, times the length: 2 pi / 3.
    let found = compare(&a, &a, Places { points: 200_000, rays: 50 });
    let mass = 2.0 * PI / 3.0;
    assert!(near(found.mass.of[0], mass, 2.0 * found.mass.uncertainty[0]), "{:?}", found.mass);
    for offset in [0.0, 0.3, 0.8] {
        let across = Chord { origin: DVec3::new(-5.0, offset, 0.3), direction: DVec3::X, range: [0.0, 10.0] };
        // (1 - b^2 - x^2)^2 over |x| <= sqrt(1 - b^2).
        let expected = 16.0 / 15.0 * libm::pow(1.0 - offset * offset, 2.5);
        // The kernel is of single precision; the density has a kink of its slope's slope at the surface.
        assert!(near(a.depths(&[across])[0], expected, 1e-5), "{offset} {}", a.depths(&[across])[0]);
    }
    let along = Chord { origin: DVec3::new(0.5, 0.0, 0.0), direction: DVec3::Z, range: [-2.0, 2.0] };
    // Flat ends on a face between voxels.
    assert!(near(a.depths(&[along])[0], 2.0 * 0.75 * 0.75, 1e-5));
}
