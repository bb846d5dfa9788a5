//! Pictures with a closed form.

use std::f64::consts::PI;

use glam::{DVec2, DVec3};

use super::testing::{grey, looking, shoot};
use super::{
    Baked, Camera, Entry, Film, Grid, Integrator, Intervals, Lamp, Marching, Meaning, Medium, Method, Optics,
    Procedural, Quality, Shadow,
};
use crate::field::{Field, Lattice};
use crate::scene::Scene;
use crate::volume::testing::{tree, unit};
use crate::volume::{Filter, Sampler, Tree};

/// Metres.
const CELL: f64 = 0.1;

fn grid() -> Grid {
    Grid::from_rows(&[[CELL, 0.0, 0.0, 0.3], [0.0, CELL, 0.0, -0.2], [0.0, 0.0, CELL, 0.7]]).expect("regular")
}

fn medium(tree: &Tree<f32>) -> Medium<'static> {
    Medium::Baked(Baked::new(tree, grid(), Meaning::Density, 1 << 30).expect("small"))
}

/// Leaves around the origin.
fn leaves() -> Vec<[i32; 3]> {
    (0..64).map(|n| [n / 16 * 8 - 16, n / 4 % 4 * 8 - 16, n % 4 * 8 - 16]).collect()
}

/// As from [`leaves`], with the density of every voxel.
fn voxels(density: impl Fn([i32; 3]) -> f64) -> Tree<f32> {
    tree(0.0, &leaves(), &[], |at| {
        #[allow(clippy::cast_possible_truncation, reason = "of single precision")]
        let density = density(at) as f32;
        density
    })
}

fn take(medium: &Medium<'_>, camera: Camera, optics: &Optics, edge: usize, pitch: f64) -> Film {
    let (shadow, integrator) = (Shadow::Cached(pitch), Integrator::Single);
    shoot(medium, camera, optics, Quality { size: [edge; 2], samples: 1, cutoff: 1e-12, shadow, integrator })
}

/// The optical depth of voxels from a place on, by many samples.
fn naive(tree: &Tree<f32>, origin: DVec3, direction: DVec3, length: f64, extinction: f64) -> f64 {
    let grid = grid();
    let mut sampler = Sampler::new(tree, Filter::Trilinear);
    let steps = 40_000;
    let step = length / f64::from(steps);
    let sum: f64 = (0..steps)
        .map(|n| sampler.sample(grid.to_grid(origin + direction * (f64::from(n) + 0.5) * step)))
        .map(|density| density.max(0.0))
        .sum();
    sum * step * extinction
}

#[test]
fn optical_depth_of_voxels_is_exact() {
    let mut state = 3;
    let mut values = vec![0.0; 32 * 32 * 32];
    for value in &mut values {
        *value = (unit(&mut state) - 0.3).max(0.0) * 4.0;
    }
    let tree = voxels(|at| {
        let [x, y, z] = at.map(|c| usize::try_from(c + 16).expect("within"));
        values[(x * 32 + y) * 32 + z]
    });
    let medium = medium(&tree);
    let centre = grid().to_world(DVec3::ZERO);
    // From outside, from inside, along axes (also on the planes between cells and bricks), and nearly along them.
    let eyes = [
        DVec3::new(6.0, 4.0, 5.0),
        DVec3::new(0.31, -0.12, 0.05),
        DVec3::new(0.0, 0.0, 9.0),
        DVec3::new(1e-9, 7.0, -1e-9),
        DVec3::new(-5.0, 0.4, 0.0),
    ];
    let mut compared = 0;
    for (number, eye) in eyes.into_iter().enumerate() {
        for is_orthographic in [false, true] {
            let camera =
                looking(centre + eye, centre, if is_orthographic { 1.5 } else { 0.3 }, is_orthographic);
            let film = take(&medium, camera, &grey(2.0), 9, 2.0);
            for pixel in (0..81).step_by(if number == 1 { 5 } else { 7 }) {
                let [x, y] = [pixel % 9, pixel / 9].map(|c| f64::from(u8::try_from(c).expect("small")));
                let place = DVec2::new(2.0 * (x + 0.5) / 9.0 - 1.0, 1.0 - 2.0 * (y + 0.5) / 9.0);
                let ray = camera.ray(place);
                let truth = naive(&tree, ray.origin, ray.direction, 16.0, 2.0);
                let found = film.depth[pixel];
                // The midpoint rule's error at 250 samples a cell whose density is a polynomial between kinks, and what
                // single precision makes of places and sums.
                assert!(
                    (found - truth).abs() < 2e-5 * truth.max(1.0),
                    "{eye}, {pixel}: {found}, not {truth}"
                );
                compared += usize::from(truth > 1.0);
            }
        }
    }
    assert!(compared > 60, "only {compared} rays met something");
}

#[test]
fn a_slab_has_its_transmittance_and_from_both_sides() {
    // 32 voxels of density 1 and nothing beside them: the linear flanks have half a cell's density each.
    let medium = medium(&voxels(|_| 1.0));
    let centre = grid().to_world(DVec3::splat(-0.5));
    let expected = 0.7 * 32.0 * CELL;
    let mut found = Vec::new();
    for side in [-4.0, 4.0] {
        let camera = looking(centre + DVec3::new(side, 0.0, 0.0), centre, 0.5, true);
        let film = take(&medium, camera, &grey(0.7), 8, 2.0);
        for pixel in 0..64 {
            assert!((film.depth[pixel] - expected).abs() < 1e-6 * expected);
            assert!((film.transmittance[pixel] - libm::exp(-expected)).abs() < 1e-6);
            // Half of the light is left where the optical depth is ln 2.
            let half = 4.0 - 16.0 * CELL + std::f64::consts::LN_2 / 0.7;
            assert!((film.half[pixel] - half).abs() < 2e-5, "{}, not {half}", film.half[pixel]);
        }
        found.push(film.depth[0]);
    }
    assert!((found[0] - found[1]).abs() < 1e-6 * expected);
}

#[test]
fn a_gaussian_has_its_optical_depth() {
    // A Gaussian of deviation 3 cells, centred between voxels; its line integral is sqrt(2 pi) s e^(-b^2 / 2 s^2).
    let centre = DVec3::new(0.3, -0.2, 0.1);
    let deviation = 3.0;
    let density = |at: [i32; 3]| {
        let away = DVec3::from(at.map(f64::from)) - centre;
        libm::exp(-away.length_squared() / (2.0 * deviation * deviation))
    };
    let medium = medium(&voxels(density));
    let middle = grid().to_world(centre);
    let camera = looking(middle + DVec3::new(3.0, 5.0, 4.0), middle, 0.6, true);
    let film = take(&medium, camera, &grey(1.0), 16, 2.0);
    for pixel in 0..256 {
        let [x, y] = [pixel % 16, pixel / 16].map(|c| f64::from(u8::try_from(c).expect("small")));
        let b = DVec2::new(2.0 * (x + 0.5) / 16.0 - 1.0, 2.0 * (y + 0.5) / 16.0 - 1.0) * 0.6 / CELL;
        let truth = CELL
            * deviation
            * (2.0 * PI).sqrt()
            * libm::exp(-b.length_squared() / (2.0 * deviation * deviation));
        // Linear filtering adds h^2 / 12 to the variance along each axis, between 0 and that in the mean of the three.
        let bound = CELL * deviation * (2.0 * PI).sqrt() * 1.1 / (6.0 * deviation * deviation);
        assert!((film.depth[pixel] - truth).abs() < bound, "{}, not {truth}", film.depth[pixel]);
    }
}

#[test]
fn in_a_furnace_everything_is_one() {
    let mut state = 9;
    let tree = voxels(|_| 1.0);
    let noisy = {
        let value = unit(&mut state);
        voxels(move |[x, y, z]| value * f64::from((x * 7 + y * 3 + z).rem_euclid(5)) * 1e3)
    };
    for tree in [tree, noisy] {
        let medium = medium(&tree);
        let centre = grid().to_world(DVec3::ZERO);
        let bright = Optics { albedo: DVec3::ONE, ambient: DVec3::ONE, ..grey(3.0) };
        let camera = looking(centre + DVec3::new(3.0, 2.0, 4.0), centre, 0.4, false);
        let film = take(&medium, camera, &bright, 32, 2.0);
        for colour in film.develop(Some(DVec3::ONE)).colour {
            // To rounding: the part that is lost behind the cutoff is 1e-12.
            assert!((colour - DVec3::ONE).abs().max_element() < 1e-11, "{colour}");
        }
    }
}

#[test]
fn light_along_the_view_has_its_closed_forms() {
    // Whatever the density: where sun and eye look the same way, light has the same way in as out.
    let tree = voxels(|at| {
        let away = DVec3::from(at.map(f64::from)).length();
        0.6 + 0.4 * libm::cos(0.4 * away)
    });
    let medium = medium(&tree);
    let centre = grid().to_world(DVec3::ZERO);
    let forward = DVec3::new(-0.3, 0.8, -0.52).normalize();
    let camera = looking(centre - forward * 4.0, centre, 1.2, true);
    for (anisotropy, extinction) in [(0.0, 0.5), (0.6, 1.2)] {
        for towards in [false, true] {
            let direction = if towards { -forward } else { forward };
            let sun = Lamp::Sun { direction, irradiance: DVec3::new(2.0, 1.0, 0.5) };
            let lit = Optics { albedo: DVec3::splat(0.8), anisotropy, lamps: vec![sun], ..grey(extinction) };
            let film = take(&medium, camera, &lit, 24, 1.0);
            let cos: f64 = if towards { 1.0 } else { -1.0 };
            let narrow = 1.0 + anisotropy * anisotropy - 2.0 * anisotropy * cos;
            let phase = (1.0 - anisotropy * anisotropy) / (4.0 * PI * narrow * narrow.sqrt());
            for pixel in 0..24 * 24 {
                let depth = film.depth[pixel];
                let gathered =
                    if towards { depth * libm::exp(-depth) } else { -libm::expm1(-2.0 * depth) / 2.0 };
                let truth = 0.8 * phase * 2.0 * gathered;
                let found = film.radiance[pixel][0];
                // What shadows that are kept for every cell miss where the density begins within one.
                assert!((found - truth).abs() < 0.03 * 0.8 * phase, "{pixel}: {found}, not {truth}");
                assert!((film.radiance[pixel][2] * 4.0 - found).abs() < 1e-12);
            }
        }
    }
}

#[test]
fn a_point_lights_as_its_distance_says() {
    // Thin enough that nothing is in the shadow: L = albedo p I integral of x d / r^2.
    let medium = medium(&voxels(|_| 1.0));
    let centre = grid().to_world(DVec3::splat(-0.5));
    let camera = looking(centre - DVec3::X * 4.0, centre, 0.3, true);
    let lamp = centre + DVec3::new(0.4, 0.2, 5.0);
    let point = Lamp::Point { position: lamp, intensity: DVec3::ONE };
    let lit = Optics { albedo: DVec3::ONE, lamps: vec![point], ..grey(1e-4) };
    let film = take(&medium, camera, &lit, 5, 2.0);
    for pixel in 0..25 {
        let [x, y] = [pixel % 5, pixel / 5].map(|c| f64::from(u8::try_from(c).expect("small")));
        let ray = camera.ray(DVec2::new(2.0 * (x + 0.5) / 5.0 - 1.0, 1.0 - 2.0 * (y + 0.5) / 5.0));
        let steps = 2000;
        let step = 32.0 * CELL / f64::from(steps);
        let sum: f64 = (0..steps)
            .map(|n| ray.at(4.0 - 16.0 * CELL + (f64::from(n) + 0.5) * step))
            .map(|place| step / place.distance_squared(lamp))
            .sum();
        let truth = 1e-4 * sum / (4.0 * PI);
        // The shadow, of 1e-4 an optical metre, and the linear flanks.
        assert!((film.radiance[pixel][0] - truth).abs() < 2e-3 * truth);
    }
}

#[test]
fn two_slabs_cover_each_other_in_order() {
    // Where the density changes from voxel to voxel, its integral beyond is as if it changed at once halfway between them.
    let near = voxels(|[x, _, _]| if x < 0 { 3.0 } else { 0.2 });
    let far = voxels(|[x, _, _]| if x >= 0 { 3.0 } else { 0.2 });
    let centre = grid().to_world(DVec3::splat(-0.5));
    let sun = Lamp::Sun { direction: DVec3::X, irradiance: DVec3::ONE };
    let lit = Optics { albedo: DVec3::ONE, lamps: vec![sun], ..grey(1.0) };
    let camera = looking(centre - DVec3::X * 4.0, centre, 0.5, true);
    let [first, second] = [near, far].map(|tree| take(&medium(&tree), camera, &lit, 4, 2.0).half[0]);
    // Half of the light is lost in the near slab: after ln 2 / 3 m; or the thin one takes 0.32 first.
    let thick = 4.0 - 16.0 * CELL;
    assert!((first - (thick + std::f64::consts::LN_2 / 3.0)).abs() < 2e-5, "{first}");
    let behind = 4.0 + (std::f64::consts::LN_2 - 0.2 * 16.0 * CELL) / 3.0;
    assert!((second - behind).abs() < 2e-5, "{second}, not {behind}");
}

const TUBE: &str = "
[bake]
voxel_size = 0.05
antialias = 'off'
octave_fade = false
[[tube]]
curve = { points = [[-2, 0, 0], [0, 0, 0], [2, 0, 0]] }
radius = 1.0
caps = 'flat'
envelope = { radial = 'smooth' }
";

#[test]
fn a_scenes_optical_depth_is_of_order_four_in_the_step() {
    let scene = Scene::parse(TUBE, "tube").expect("valid");
    let field = Field::compile(&scene);
    let camera = looking(DVec3::new(0.1, -4.0, 1.0), DVec3::new(0.1, 0.0, 0.1), 0.2, false);
    // Across a straight tube at the distance b from its axis: the integral of (1 - (b^2 + s^2))^2.
    let truth = |ray: super::Ray| {
        let across = DVec3::new(0.0, ray.direction.y, ray.direction.z);
        let from = DVec3::new(0.0, ray.origin.y, ray.origin.z);
        let nearest = -from.dot(across) / across.length_squared();
        let b = (from + across * nearest).length_squared();
        let room = (1.0 - b).max(0.0);
        // With c^2 = room: the integral of (c^2 - s^2)^2 from -c to c is 16 c^5 / 15.
        16.0 / 15.0 * room * room * room.sqrt() / across.length()
    };
    let mut errors = Vec::new();
    for step in [4.0, 2.0, 1.0] {
        let lattice = Lattice { voxel_size: 0.05 };
        let medium = Medium::Procedural(Procedural::new(&field, lattice, step, 1 << 30).expect("small"));
        let film = take(&medium, camera, &grey(1.0), 16, 2.0);
        let mut squares = 0.0;
        for pixel in 0..256 {
            let [x, y] = [pixel % 16, pixel / 16].map(|c| f64::from(u8::try_from(c).expect("small")));
            let place = DVec2::new(2.0 * (x + 0.5) / 16.0 - 1.0, 1.0 - 2.0 * (y + 0.5) / 16.0);
            let error = film.depth[pixel] - truth(camera.ray(place));
            squares += error * error / 256.0;
        }
        errors.push(squares.sqrt());
    }
    // Inside the tube the density is a polynomial of degree 4; where a segment leaves it, the second derivative jumps,
    // which leaves an error of order 3 there. Single precision ends it at some 1e-7.
    assert!(errors[0] < 1e-3 && errors[1] < errors[0] / 5.0 && errors[2] < 2e-5, "{errors:?}");
}

#[test]
fn a_dense_scene_ends_and_is_as_bright_as_it_should_be() {
    // The light of a sun that shines along the view is scattered back whatever the density: albedo p E / 2. The shadow is
    // kept every second voxel, so it is right where the medium is not too dense for that.
    let scene = Scene::parse(TUBE, "tube").expect("valid");
    let field = Field::compile(&scene);
    let lattice = Lattice { voxel_size: 0.05 };
    let medium = Medium::Procedural(Procedural::new(&field, lattice, 1.0, 1 << 30).expect("small"));
    let camera = looking(DVec3::new(0.0, -4.0, 0.0), DVec3::ZERO, 0.1, true);
    for extinction in [1.0, 10.0, 1e6, 1e12, 1e30] {
        let furnace = Optics { albedo: DVec3::ONE, ambient: DVec3::ONE, ..grey(extinction) };
        let film = take(&medium, camera, &furnace, 4, 2.0);
        for colour in film.develop(Some(DVec3::ONE)).colour {
            assert!((colour - DVec3::ONE).abs().max_element() < 1e-11, "{colour}");
        }
        let sun = Lamp::Sun { direction: DVec3::Y, irradiance: DVec3::ONE };
        let lit = Optics { albedo: DVec3::ONE, lamps: vec![sun], ..grey(extinction) };
        let film = take(&medium, camera, &lit, 4, 1.0);
        for pixel in 0..16 {
            let truth = -libm::expm1(-2.0 * film.depth[pixel]) / (8.0 * PI);
            let found = film.radiance[pixel][0];
            assert!(found.is_finite() && found >= 0.0);
            assert!(extinction > 10.0 || (found - truth).abs() < 0.02 * truth, "{found}, not {truth}");
        }
    }
}

/// A straight tube around the x axis whose density falls linearly from it, seen at a right angle in parallel rays.
fn linear_tube(marching: Marching, step: f64) -> (f64, [u64; 2]) {
    let scene = Scene::parse(&TUBE.replace("smooth", "linear"), "tube").expect("valid");
    let field = Field::compile(&scene);
    let camera = looking(DVec3::new(0.1, -4.0, 0.55), DVec3::new(0.3, 0.0, 0.55), 0.2, true);
    let lattice = Lattice { voxel_size: 0.05 };
    let procedural = Procedural::new(&field, lattice, step, 1 << 30).expect("small").with(marching);
    let medium = Medium::Procedural(procedural);
    let film = take(&medium, camera, &grey(1.0), 16, 2.0);
    let mut squares = 0.0;
    for pixel in 0..256 {
        let [x, y] = [pixel % 16, pixel / 16].map(|c| f64::from(u8::try_from(c).expect("small")));
        let ray = camera.ray(DVec2::new(2.0 * (x + 0.5) / 16.0 - 1.0, 1.0 - 2.0 * (y + 0.5) / 16.0));
        // At the distance b from the axis: the integral of 1 - sqrt(b^2 + s^2) from -c to c, where that is 0.
        let b = ray.origin.z.abs();
        assert!(b > 0.3 && b < 0.8 && ray.direction.z.abs() < 1e-12);
        let c = (1.0 - b * b).sqrt();
        let truth = (c - b * b * libm::asinh(c / b)) / ray.direction.y;
        squares += (film.depth[pixel] - truth) * (film.depth[pixel] - truth) / 256.0;
    }
    (squares.sqrt(), medium.places().expect("of a scene"))
}

#[test]
fn methods_have_their_orders() {
    // Of Gauss's rule 4, since its segments end where the tube does; of the others 2 and 1, by the rules themselves and by
    // the density's kink at the tube's surface, in the middle of a step. Errors of steps of 4, 2 and 1 voxels.
    for (method, low, high) in
        [(Method::Gauss, 10.0, 24.0), (Method::Midpoint, 2.8, 6.0), (Method::Alpha, 1.7, 2.4)]
    {
        let marching = Marching { method, ..Marching::default() };
        let errors = [4.0, 2.0, 1.0].map(|step| linear_tube(marching, step).0);
        for pair in errors.windows(2) {
            let ratio = pair[0] / pair[1];
            // Where single precision does not end it.
            assert!(pair[1] < 2e-6 || (low..high).contains(&ratio), "{method:?}: {errors:?}");
        }
        assert!(errors[2] < 0.02, "{method:?}: {errors:?}");
    }
}

#[test]
fn wherever_marching_begins_the_picture_is_the_same() {
    for entry in [Entry::Cones, Entry::Constant, Entry::Converging, Entry::SphereTracing] {
        for growth in [0.0, 0.02] {
            let marching = Marching { method: Method::Midpoint, growth, entry, ..Marching::default() };
            let (error, [evaluated, inside]) = linear_tube(marching, 0.5);
            // The error of order 2, of steps that become half as long again as the first; and what is lost in front of a
            // beginning that is found a step late.
            assert!(error < 4e-4, "{marching:?}: {error:e}");
            assert!(inside / 2 < evaluated && evaluated < inside * 5 / 4, "{evaluated}, {inside}");
        }
    }
}

#[test]
fn whatever_tells_what_is_inside_the_picture_is_the_same() {
    // Two tubes behind each other with nothing between them, so that rays leave and enter.
    let text = "
[[tube]]
curve = { points = [[-2, 0, 0], [0, 0, 1.5], [2, 0, 0], [4, 0, -1.5], [5, 1, 0]] }
radius = [[0, 0.4], [1, 0.8]]
[[tube]]
curve = { points = [[-2, 3, 0], [1, 4, 1.5], [5, 3, 0]] }
radius = 0.5
";
    let field = Field::compile(&Scene::parse(text, "tubes").expect("valid"));
    let camera = looking(DVec3::new(1.0, -6.0, 1.5), DVec3::new(1.0, 0.0, 0.3), 0.5, false);
    let film = |marching: Marching| {
        let procedural = Procedural::new(&field, Lattice { voxel_size: 0.03 }, 0.5, 1 << 30).expect("small");
        let medium = Medium::Procedural(procedural.with(marching));
        (take(&medium, camera, &grey(1.0), 40, 2.0), medium.places().expect("of a scene"))
    };
    let of = |change: fn(&mut Marching)| {
        let mut marching = Marching { method: Method::Midpoint, ..Marching::default() };
        change(&mut marching);
        film(marching)
    };
    let difference = |a: &[f64], b: &[f64]| {
        let squares: f64 = a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum();
        (squares / a.iter().map(|a| a * a).sum::<f64>()).sqrt()
    };
    let (bricks, [evaluated, inside]) = of(|_| {});
    // The same steps, but for those that are known to be outside.
    let (cones, [fewer, same]) = of(|marching| marching.intervals = Intervals::Cones);
    assert!(difference(&bricks.depth, &cones.depth) < 1e-6);
    // Lanes that fill a last batch count as what they held before: some of a thousand.
    assert!(inside.abs_diff(same) * 50 < inside, "{inside}, {same}");
    assert!(fewer < evaluated, "{fewer} of {evaluated}");
    // Steps that begin elsewhere: errors of order 2 in half a voxel, of tubes of more than 26.
    let (truth, _) = film(Marching::default());
    let (once, [met, _]) = of(|marching| marching.intervals = Intervals::RayBoxes);
    let (every, [held, _]) = of(|marching| marching.intervals = Intervals::SampleBoxes);
    for film in [&bricks, &once, &every] {
        let error = difference(&truth.depth, &film.depth);
        assert!(error < 2e-3, "{error:e}");
    }
    // Boxes around whole segments hold more than bricks that reach a tube, and these more than cones do.
    let least = evaluated.max(fewer);
    assert!(met > least && held > least, "{met}, {held}, {evaluated}, {fewer}");
    let (mapped, _) = of(|marching| (marching.intervals, marching.map_every) = (Intervals::Cones, 2));
    assert!(difference(&cones.depth, &mapped.depth) < 1e-3);
}

#[test]
fn a_sum_of_samples_becomes_the_integral() {
    let errors = [16, 64, 256].map(|count| {
        let count = std::num::NonZeroU32::new(count);
        let marching = Marching { method: Method::Midpoint, count, ..Marching::default() };
        linear_tube(marching, 1.0)
    });
    // Rays through a tube of 40 voxels: steps of 3, 0.7 and 0.2 of these, by a rule of order 2 with kinks at both ends.
    for pair in errors.windows(2) {
        assert!(pair[1].0 < 0.25 * pair[0].0, "{errors:?}");
    }
    assert!(errors[2].0 < 1e-4, "{errors:?}");
    // Each takes as many samples of all 256 rays as it says, and none that lies in bricks without a tube.
    for ((_, [evaluated, _]), count) in errors.iter().zip([16, 64, 256]) {
        assert!(*evaluated <= 256 * count && *evaluated > 256 * count / 4, "{errors:?}");
    }
}

#[test]
fn without_shadows_light_comes_everywhere() {
    let scene = Scene::parse(TUBE, "tube").expect("valid");
    let field = Field::compile(&scene);
    let lattice = Lattice { voxel_size: 0.05 };
    let medium = Medium::Procedural(Procedural::new(&field, lattice, 1.0, 1 << 30).expect("small"));
    let camera = looking(DVec3::new(0.1, -4.0, 0.55), DVec3::new(0.3, 0.0, 0.55), 0.2, true);
    let mut optics = grey(3.0);
    optics.albedo = DVec3::splat(0.8);
    let colour = DVec3::new(1.0, 2.0, 0.5);
    optics.lamps = vec![Lamp::Sun { direction: DVec3::NEG_Z, irradiance: colour }];
    let (size, samples, cutoff) = ([16, 16], 1, 1e-9);
    let (shadow, integrator) = (Shadow::None, Integrator::Single);
    let quality = Quality { size, samples, cutoff, shadow, integrator };
    let film = shoot(&medium, camera, &optics, quality);
    // A uniform source: what is lost of the light behind, times the albedo and the phase function of no direction.
    let source = colour * optics.albedo / (4.0 * PI) + optics.uniform_source();
    for (radiance, depth) in film.radiance.iter().zip(&film.depth) {
        let expected = source * -libm::expm1(-depth);
        assert!((DVec3::from(*radiance) - expected).length() < 1e-5 * source.length(), "{radiance:?}");
    }
    assert!(film.depth.iter().any(|depth| *depth > 1.0));
}

#[test]
fn nothing_is_evaluated_outside_of_tubes() {
    let (error, [evaluated, inside]) = linear_tube(Marching::default(), 1.0);
    assert!(error < 2e-6, "{error:e}");
    // Bounds are thicker by hundredths of a voxel, and no sample is at a segment's end. (Where pieces of the axis touch, what
    // is inside counts for both.)
    assert!(inside / 2 < evaluated && evaluated <= inside, "{evaluated}, {inside}");
}

#[test]
fn interpolated_maps_are_of_order_two_in_their_distance() {
    // A bent and twisted tube with noise, whose pieces change along rays.
    let text = "
[bake]
voxel_size = 0.03
[[tube]]
curve = { points = [[-2, 0, 0], [0, 0, 1.5], [2, 0, 0], [4, 0, -1.5], [5, 1, 0]] }
radius = [[0, 0.4], [1, 0.8]]
twist = 0.7
[[tube.layer]]
frequency = [2, 2, 3]
octaves = 2
";
    let scene = Scene::parse(text, "tube").expect("valid");
    let field = Field::compile(&scene);
    let camera = looking(DVec3::new(1.0, -6.0, 1.5), DVec3::new(1.0, 0.0, 0.3), 0.4, false);
    let film = |map_every: usize| {
        let marching = Marching { method: Method::Midpoint, map_every, ..Marching::default() };
        let procedural = Procedural::new(&field, Lattice { voxel_size: 0.03 }, 0.5, 1 << 30).expect("small");
        take(&Medium::Procedural(procedural.with(marching)), camera, &grey(1.0), 40, 2.0).depth
    };
    let truth = film(1);
    let size = (truth.iter().map(|depth| depth * depth).sum::<f64>()).sqrt();
    let errors = [2, 4, 8].map(|every| {
        let found = film(every);
        let squares: f64 = found.iter().zip(&truth).map(|(a, b)| (a - b) * (a - b)).sum();
        squares.sqrt() / size
    });
    // Places mapped one voxel apart, of a tube of 13 to 27 voxels: (1 / 20)^2 / 8 of a radius at most, and noise of 2 cells a
    // radius.
    assert!(errors[0] < 3e-4 && errors[0] > 1e-9, "{errors:?}");
    for pair in errors.windows(2) {
        assert!(pair[1] > 2.5 * pair[0] && pair[1] < 6.0 * pair[0], "{errors:?}");
    }
}
