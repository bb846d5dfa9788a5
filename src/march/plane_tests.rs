//! Voxels sampled in planes beside the same in every cell, and swept shadows beside exact ones.

use glam::DVec3;

use super::sweep::sweep;
use super::testing::{H, baked, grey, looking, patchy, rough, shoot};
use super::{Film, Integrator, Lamp, Medium, Optics, Quality, Sampling, Shadow};
use crate::num::Level;
use crate::volume::Tree;
use crate::volume::testing::tree;

/// Leaves in a cube around the origin, with the density of every voxel.
fn voxels(density: impl Fn([i32; 3]) -> f64) -> Tree<f32> {
    let leaves: Vec<[i32; 3]> =
        (0..64).map(|n| [n / 16 * 8 - 16, n / 4 % 4 * 8 - 16, n % 4 * 8 - 16]).collect();
    tree(0.0, &leaves, &[], |at| {
        #[allow(clippy::cast_possible_truncation, reason = "of single precision")]
        let density = density(at) as f32;
        density
    })
}

fn gaussian() -> Tree<f32> {
    let centre = DVec3::new(0.3, -0.2, 0.1);
    voxels(|at| libm::exp((DVec3::from(at.map(f64::from)) - centre).length_squared() / -32.0))
}

/// From all around, along axes on the planes between cells and bricks, nearly along them, and from inside.
const EYES: [DVec3; 7] = [
    DVec3::new(3.0, 2.0, 2.5),
    DVec3::new(-1.0, 3.0, -0.5),
    DVec3::new(0.7, -1.4, 3.1),
    DVec3::new(0.0, 0.0, 4.0),
    DVec3::new(1e-9, -4.0, -1e-9),
    DVec3::new(-4.0, 0.4, 0.0),
    DVec3::new(0.11, 0.12, 0.05),
];

fn take(tree: &Tree<f32>, sampling: Sampling, eye: DVec3, optics: &Optics, shadow: Shadow) -> Film {
    let Medium::Baked(whole) = baked(tree) else { unreachable!() };
    let medium = Medium::Baked(whole.with(sampling));
    let quality =
        Quality { size: [24; 2], samples: 1, cutoff: 1e-12, shadow, integrator: Integrator::Single };
    let half = if eye.length() > 1.0 { 0.2 } else { 0.6 };
    shoot(&medium, looking(eye, DVec3::ZERO, half, false), optics, quality)
}

/// Root mean square of what is different, over that of the truth, and the difference of the means likewise.
fn difference<'a>(found: impl Iterator<Item = &'a f64>, truth: &[f64]) -> [f64; 2] {
    let (mut squares, mut sum, mut all, mut whole) = (0.0, 0.0, 0.0, 0.0);
    for (found, truth) in found.zip(truth) {
        squares += (found - truth) * (found - truth);
        sum += found - truth;
        all += truth * truth;
        whole += truth;
    }
    [(squares / all).sqrt(), (sum / whole).abs()]
}

#[test]
fn optical_depths_of_planes_are_those_of_cells() {
    let [solid, smooth, noise] = [voxels(|_| 1.0), gaussian(), rough(&patchy(), 1.0)];
    // Of what is smooth the errors cancel but for the kinks of linear interpolation. Of noise from voxel to voxel a sample is off by
    // a third, of some 25 a ray. Where a solid ends, layers are off by half of one at most, and by less in the mean.
    for (tree, rms, mean) in [(&smooth, 1.5e-3, 2e-4), (&noise, 0.03, 5e-3), (&solid, 8e-3, 1e-3)] {
        for eye in EYES {
            let optics = grey(1.0);
            let [found, truth] = [Sampling::Planes, Sampling::Cells]
                .map(|sampling| take(tree, sampling, eye, &optics, Shadow::None).depth);
            let [square, bias] = difference(found.iter(), &truth);
            assert!(square < rms && bias < mean, "{eye}: {square:e}, {bias:e}");
            // No layer is missing, and none is counted twice.
            let most = found.iter().zip(&truth).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            assert!(most < 0.6 * H * 1.7, "{eye}: {most}");
        }
    }
}

#[test]
fn what_is_too_dense_for_planes_is_taken_in_cells() {
    // One voxel of 64 is a thousand times as dense as the others: their bricks are in cells, and end where others' layers do.
    let tree = voxels(|[x, y, z]| if x % 16 == 3 && y % 16 == 5 && z % 16 == 9 { 60.0 } else { 0.06 });
    for eye in EYES.into_iter().take(6) {
        let [found, truth] = [Sampling::Planes, Sampling::Cells]
            .map(|sampling| take(&tree, sampling, eye, &grey(4.0), Shadow::None).depth);
        let [square, bias] = difference(found.iter(), &truth);
        // Flanks of single voxels that reach into bricks in planes: some of a third of a layer's depth.
        assert!(square < 8e-3 && bias < 2e-3, "{eye}: {square:e}, {bias:e}");
    }
}

#[test]
fn half_of_the_light_is_lost_where_cells_have_it() {
    for eye in EYES.into_iter().take(6) {
        let [found, truth] = [Sampling::Planes, Sampling::Cells]
            .map(|sampling| take(&gaussian(), sampling, eye, &grey(3.0), Shadow::None).half);
        let (mut lost, mut near) = (0, 0);
        for (found, truth) in found.iter().zip(&truth) {
            if truth.is_finite() && found.is_finite() {
                lost += 1;
                // Within a layer the density is taken to be one number, and rays that just lose half may do so late.
                near += usize::from((found - truth).abs() < 0.25 * H);
                assert!((found - truth).abs() < 2.0 * H, "{eye}: {found}, not {truth}");
            }
        }
        assert!(lost > 20 && 10 * near > 9 * lost, "{eye}: {near} of {lost}");
    }
}

#[test]
fn swept_shadows_are_as_good_as_those_along_rays() {
    let smooth = gaussian();
    for direction in [
        DVec3::X,
        DVec3::NEG_Y,
        DVec3::new(0.3, -0.2, 1.0),
        DVec3::new(-1.0, 0.9, -0.8),
        DVec3::new(0.5, -1.0, 0.7),
        DVec3::new(-0.1, 0.7, -1.0),
    ] {
        let lamp = |direction: DVec3| Lamp::Sun { direction: direction.normalize(), irradiance: DVec3::ONE };
        // Two that are alike but for their places in tables, and one that shines the other way.
        let lamps = vec![lamp(-direction), lamp(direction), lamp(direction)];
        let lit = Optics { albedo: DVec3::ONE, lamps, ..grey(2.0) };
        let light = |sampling, shadow| -> Vec<f64> {
            take(&smooth, sampling, EYES[0], &lit, shadow).radiance.iter().map(|colour| colour[0]).collect()
        };
        let truth = light(Sampling::Cells, Shadow::Exact);
        let [along, swept] = [Sampling::Cells, Sampling::Planes]
            .map(|sampling| difference(light(sampling, Shadow::Cached(2.0)).iter(), &truth));
        // Depths of a tenth between the places that are kept, whose square's eighth is seen.
        assert!(
            swept[0] < 2e-3 + along[0] && swept[1] < 1e-3 + along[1],
            "{direction}: {swept:?}, {along:?}"
        );
        assert!(swept[0] < 0.02, "{direction}: {swept:?}");
    }
}

#[test]
fn what_is_extreme_has_shadows_too() {
    // Bricks so far apart that no front lies between them, along either axis.
    let leaves = [[0, 0, 0], [1 << 30, 8, 0], [8, 1 << 30, 0], [0, 8, 1 << 30]];
    let apart = tree(0.0, &leaves, &[], |_| 1.0);
    let Medium::Baked(far) = baked(&apart) else { unreachable!() };
    for direction in [DVec3::X, DVec3::Y] {
        assert!(sweep(&far, direction, 1.0, Level::best()).is_none());
    }
    let lamps = vec![Lamp::Sun { direction: DVec3::X, irradiance: DVec3::ONE }];
    let lit = Optics { albedo: DVec3::ONE, lamps, ..grey(2.0) };
    for tree in [apart, voxels(|_| f64::from(f32::MAX))] {
        let film = take(&tree, Sampling::Planes, EYES[0], &lit, Shadow::Cached(2.0));
        assert!(film.radiance.iter().flatten().all(|value| value.is_finite()));
        assert!(film.radiance.iter().any(|colour| colour[0] > 0.0));
    }
}

#[test]
fn planes_and_cells_meet_in_faces() {
    // So dense that a few bricks are in cells, beside others in planes: a ray that passes between them within a layer loses none
    // of it.
    let smooth = gaussian();
    for eye in EYES.into_iter().take(6) {
        let [thin, thick] = [6.0, 9.0].map(|extinction| {
            let [found, truth] = [Sampling::Planes, Sampling::Cells]
                .map(|sampling| take(&smooth, sampling, eye, &grey(extinction), Shadow::None).depth);
            difference(found.iter(), &truth)
        });
        assert!(thick[0] < 2.0 * thin[0].max(1e-3), "{eye}: {thick:?}, {thin:?}");
    }
}

#[test]
fn nothing_is_lit_by_more_than_there_is() {
    // One voxel is so dense that depths beside it grow by more than single precision can place in a cell.
    let optics = Optics {
        albedo: DVec3::ONE,
        lamps: vec![Lamp::Sun { direction: DVec3::new(0.3, -0.2, -1.0).normalize(), irradiance: DVec3::ONE }],
        ..grey(3.0)
    };
    for most in [1e10, 1e12, f64::from(f32::MAX)] {
        let tree = voxels(|at| if at == [1, 2, 3] { most } else { 0.1 });
        for sampling in [Sampling::Planes, Sampling::Cells] {
            let film = take(&tree, sampling, EYES[0], &optics, Shadow::Cached(2.0));
            // Isotropic: at most all of it, from all sides.
            let bound = 1.0 / (4.0 * std::f64::consts::PI);
            assert!(film.radiance.iter().all(|colour| colour[0] <= bound * (1.0 + 1e-6)), "{most:e}");
        }
    }
}
