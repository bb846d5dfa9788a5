//! Mass: of cylinders at rest against closed forms, of bakes against that of the cylinders they are made of.

use std::f64::consts::PI;

use glam::{DMat3, DVec3};
use vdbake::field::{Field, Lattice};
use vdbake::num::Level;
use vdbake::num::quadrature::gauss_legendre;
use vdbake::reference::Reference;
use vdbake::scene::Scene;
use vdbake::volume::{Plan, RestMass, Store, Tally, bake};

use crate::gates_oracle::{Random, show};

/// A straight axis 2 m long.
const STRAIGHT: &str = "curve = { kind = \"quadratic\", points = [[0,0,0],[0.6,0,0.8],[1.2,0,1.6]] }\n";
/// One that bends and winds.
const BENT: &str = "curve = { kind = \"cubic\", points = [[0,0,0],[1,0,0.3],[1,1,0.6],[0,1,1]] }\n";
/// Positive and smooth, and different on all sides of the axis.
const LAYER: &str =
    "[[tube.layer]]\nop = \"add\"\nfrequency = [1.1, 1.3, 2.2]\noctaves = 1\nmultiplier = 0.8\n";

fn scene(text: &str) -> Scene {
    Scene::parse(text, "mass.toml").unwrap_or_else(|errors| panic!("{errors}\n{text}"))
}

fn compile(scene: &Scene, lattice: Lattice) -> Field {
    let mut field = Field::compile(scene);
    field.widen(lattice);
    field
}

fn at_rest(scene: &Scene, h: f64) -> RestMass {
    let lattice = Lattice { voxel_size: h };
    RestMass::new(&compile(scene, lattice), scene, lattice, 1 << 15, Level::best())
}

/// A bake's tally, its mass, and that at rest.
fn weigh(scene: &Scene, h: f64) -> (Tally, f64, RestMass) {
    let lattice = Lattice { voxel_size: h };
    let field = compile(scene, lattice);
    let plan = Plan::new(&field, lattice, 1 << 32).unwrap_or_else(|error| panic!("{error}"));
    let mut store = Store::default();
    let Ok((tally, _)) = bake(&field, &plan, 0.0, Level::best(), &mut store, |_| ());
    let rest = RestMass::beside(&field, scene, lattice, &tally, Level::best());
    let mass = tally.total.sum() * h * h * h;
    (tally, mass, rest)
}

/// An arc of 2 radians of a circle with the radius 1 m, its curvature within 2e-5 of 1.
fn arc() -> String {
    const PARTS: u32 = 8;
    let step = 2.0 / f64::from(PARTS);
    let handle = 4.0 / 3.0 * libm::tan(0.25 * step);
    let mut points = Vec::new();
    for i in 0..=PARTS {
        let angle = step * f64::from(i);
        let (at, along) = (
            DVec3::new(libm::cos(angle), libm::sin(angle), 0.0),
            DVec3::new(-libm::sin(angle), libm::cos(angle), 0.0) * handle,
        );
        if i > 0 {
            points.push(at - along);
        }
        points.push(at);
        if i < PARTS {
            points.push(at + along);
        }
    }
    let points: Vec<String> = points.iter().map(|p| format!("{:?}", p.to_array())).collect();
    format!("curve = {{ kind = \"cubic\", points = [{}] }}\n", points.join(", "))
}

/// Integrals over the unit disc.
const ENVELOPES: [(&str, f64); 5] = [
    ("\"smooth\"", PI / 3.0),
    ("\"linear\"", PI / 3.0),
    ("\"hard\"", PI),
    // pi (1 - w + 0.3 w^2)
    ("0.25", PI * (1.0 - 0.25 + 0.3 * 0.0625)),
    ("1.0", PI * 0.3),
];

#[test]
fn mass_at_rest_has_its_closed_form() {
    // The integral over the length.
    let caps = [
        ("caps = \"flat\"", "", 1.0),
        ("caps = \"fade\"", ", axial = 0.3", 0.7),
        ("caps = \"round\"", "", 1.0),
    ];
    let radii = [
        ("radius = 0.3", 0.09 * 2.0),
        (
            "radius = [[0, 0.2], [0.5, 0.6], [0.5, 0.1], [1, 0.1]]\nrest = { radius = 0.5, length = 3.0 }",
            0.75,
        ),
        ("radius = 0.3\nstretch = false\nrest = { radius = 0.5, length = 3.0 }", 0.25 * 2.0),
    ];
    let layers = [
        ("", 1.0),
        ("[[tube.layer]]\nnoise = \"constant\"\nvalue = 2.5\n", 2.5),
        ("[[tube.layer]]\nnoise = \"sectors\"\n", 0.5),
        // Nothing below 0 counts.
        ("[[tube.layer]]\nnoise = \"sectors\"\nop = \"add\"\nmultiplier = -2.0\n", 0.5),
    ];
    for (radial, disc) in ENVELOPES {
        for (caps, axial, length) in caps {
            for (radius, volume) in radii {
                for (layer, mean) in layers {
                    let text = format!(
                        "[[tube]]\n{STRAIGHT}{radius}\n{caps}\nenvelope = {{ radial = {radial}{axial} }}\n{layer}"
                    );
                    let found = at_rest(&scene(&text), 0.01);
                    let wanted = volume * disc * length * mean;
                    assert!((found.rest - wanted).abs() <= found.error, "{found:?} against {wanted}\n{text}");
                    // Nothing is between the points but polynomials: rounding alone is left.
                    assert!(found.error < 2e-7 * wanted, "{found:?}\n{text}");
                    assert_eq!(found.lost, 0.0);
                }
            }
        }
    }
}

#[test]
fn mass_of_half_balls_has_its_closed_form() {
    // Of a half ball of radius 1: 2 pi times the integral of radial(x) x^2.
    let balls = [2.0 * PI * 8.0 / 105.0, 2.0 * PI / 12.0, 2.0 * PI / 3.0];
    for ((radial, _), ball) in ENVELOPES.into_iter().zip(balls) {
        let text = format!(
            "[[tube]]\n{STRAIGHT}radius = [[0, 0.2], [1, 0.4]]\ncaps = \"round\"\nenvelope = {{ radial = {radial} }}\n"
        );
        let found = at_rest(&scene(&text), 0.01);
        let wanted = ball * (0.008 + 0.064);
        // The ball's height is a root at the rim.
        assert!((found.caps / wanted - 1.0).abs() < 2e-4, "{} against {wanted}\n{text}", found.caps);
    }
}

#[test]
fn masses_of_tubes_add_up_and_none_is_none() {
    let one = format!("[[tube]]\n{STRAIGHT}radius = 0.3\n{LAYER}");
    let other = format!("[[tube]]\n{BENT}radius = 0.2\n{LAYER}");
    let [a, b, both] = [&one, &other, &format!("{one}{other}")].map(|text| at_rest(&scene(text), 0.01));
    // Each with its own, smaller number of points.
    assert!((both.rest - a.rest - b.rest).abs() < both.error + a.error + b.error);
    assert_eq!(at_rest(&scene("name = \"nothing\""), 0.01).rest, 0.0);
}

/// The mass at rest by the reference: a lattice over the cylinder's box, with the error that a coarser one lets expect.
fn brute(scene: &Scene, h: f64) -> [f64; 2] {
    let reference = Reference::new(scene, Some(h));
    let rest = scene.tubes()[0].rest;
    let length = if scene.tubes()[0].stretch { rest.length } else { reference.length(0) };
    let sum = |count: u32| {
        let mut sum = 0.0;
        let place = |i: u32| (f64::from(i) + 0.5) / f64::from(count);
        for i in 0..count {
            for j in 0..count {
                for k in 0..count {
                    let (u, v) = (2.0 * place(i) - 1.0, 2.0 * place(j) - 1.0);
                    sum += reference.at_rest(0, [u, v, place(k)]).max(0.0);
                }
            }
        }
        4.0 * rest.radius * rest.radius * length * sum / f64::from(count * count * count)
    };
    let [fine, coarse] = [sum(96), sum(64)];
    [fine, (fine - coarse).abs()]
}

#[test]
fn mass_of_noise_at_rest_is_the_reference_s() {
    let noise = |more: &str| format!("[[tube.layer]]\nfrequency = [1.5, 1.5, 2.5]\noctaves = 2\n{more}");
    let cases = [
        ("smooth", format!("[[tube]]\n{STRAIGHT}radius = 0.3\n{LAYER}")),
        ("thresholded", format!("[[tube]]\n{STRAIGHT}radius = 0.3\n{}", noise("threshold = -0.1\n"))),
        (
            "twisted, in metres",
            format!(
                "[[tube]]\n{BENT}radius = 0.3\ntwist = 1.0\nstretch = false\n{}",
                noise("threshold = 0.0\n")
            ),
        ),
        (
            "fading",
            format!(
                "[[tube]]\n{BENT}radius = [[0, 0.1], [0.4, 0.5], [1, 0.2]]\ntwist = 2.0\nrest = {{ radius = 1.0, length = 1.0 }}\n{}",
                noise("threshold = 0.05\n")
            ),
        ),
    ];
    for (name, text) in cases {
        let scene = scene(&text);
        // So large a voxel that octaves fade where the tube is thin.
        for h in [0.001, 0.12] {
            let [wanted, error] = brute(&scene, h);
            let found = at_rest(&scene, h);
            let difference = (found.rest - wanted).abs();
            show(&format!(
                "{name}: {:.2e} of {:.2e} + {:.2e}",
                difference / wanted,
                found.error / wanted,
                error / wanted
            ));
            assert!(
                difference <= found.error + error,
                "{name} at {h}: {found:?} against {wanted} +- {error}"
            );
            assert!(found.error < 0.02 * wanted, "{name} at {h}: {found:?}");
        }
    }
}

/// The stated error is two standard deviations.
#[test]
fn stated_error_holds_where_points_are_coarser_than_the_noise() {
    let mut squares = 0.0;
    for seed in 0..20 {
        let scene = scene(&format!(
            "[[tube]]\n{STRAIGHT}radius = 0.3\n[[tube.layer]]\nfrequency = [4.0, 4.0, 12.0]\noctaves = 4\nthreshold = 0.0\nseed = {seed}\n"
        ));
        let lattice = Lattice { voxel_size: 1e-4 };
        let field = compile(&scene, lattice);
        let mass = |points| RestMass::new(&field, &scene, lattice, points, Level::best());
        let (found, truth) = (mass(1 << 14), mass(1 << 20));
        let part = (found.rest - truth.rest) / found.error;
        assert!(part.abs() < 2.0, "seed {seed}: {found:?} against {truth:?}");
        squares += part * part;
    }
    assert!(squares / 20.0 < 1.0, "the error is understated: {squares}");
}

#[test]
fn stated_error_holds_where_a_short_part_is_past_its_focal_set() {
    let curve = "curve = { kind = \"quadratic\", points = [[-1,0,0],[0,0,4],[1,0,0]] }\n";
    for radius in [0.1, 0.2, 0.3, 0.5] {
        for conserve in ["off", "full"] {
            let text = format!("[[tube]]\n{curve}radius = {radius}\nconserve = \"{conserve}\"\n{LAYER}");
            let scene = scene(&text);
            let lattice = Lattice { voxel_size: 0.01 };
            let field = compile(&scene, lattice);
            let mass = |points| RestMass::new(&field, &scene, lattice, points, Level::best());
            let (found, truth) = (mass(1 << 15), mass(1 << 21));
            let difference = (found.image - truth.image).abs();
            show(&format!(
                "{radius} {conserve}: lost {:.4}, off by {:.1e}, stated {:.1e}",
                truth.lost / truth.rest,
                difference / truth.image,
                found.image_error / truth.image
            ));
            assert!(difference <= 2.0 * (found.image_error + truth.image_error), "{found:?} {truth:?}");
            assert!((found.lost - truth.lost).abs() < 1e-3 * truth.rest, "{found:?} {truth:?}");
        }
    }
}

#[test]
fn mass_is_the_same_for_any_number_of_threads() {
    let scene = scene(&format!(
        "[[tube]]\n{BENT}radius = 0.3\ncaps = \"round\"\n{LAYER}[[tube]]\n{STRAIGHT}radius = 0.1\n"
    ));
    let weighed = [1, 2, 5].map(|threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
        let (tally, mass, rest) = pool.install(|| weigh(&scene, 0.02));
        (tally.total, mass.to_bits(), rest)
    });
    assert!(weighed[0] == weighed[1] && weighed[0] == weighed[2], "{weighed:?}");
}

/// A tube without layers, one whose layer changes around the axis.
fn kinds() -> [(&'static str, &'static str); 2] {
    [("axisymmetric", ""), ("theta-dependent", LAYER)]
}

fn bend(radius: f64, conserve: &str, layer: &str) -> Scene {
    scene(&format!(
        "[bake]\noctave_fade = false\n[[tube]]\n{}radius = {radius}\nconserve = \"{conserve}\"\n{layer}",
        arc()
    ))
}

#[test]
fn bakes_have_the_mass_to_expect_of_the_deformed_volume() {
    for radius in [0.2, 0.5, 0.9] {
        for (name, layer) in kinds() {
            let (tally, mass, rest) = weigh(&bend(radius, "off", layer), radius / 20.0);
            let error = mass / rest.image - 1.0;
            show(&format!(
                "{name} {radius}: {error:.1e}, stated {:.1e} {:.1e}",
                tally.total.error(),
                rest.image_error / rest.image
            ));
            assert!(error.abs() < 1e-4, "{name} {radius}: {error}");
        }
    }
    let radius = "radius = [[0, 0.1], [0.4, 0.4], [1, 0.2]]\n";
    let world = LAYER.replace("octaves", "space = \"world\"\noctaves");
    for (more, layer) in [
        ("", LAYER),
        ("twist = 1.5\nspin = 0.3\n", LAYER),
        ("stretch = false\nrest = { radius = 0.7, length = 5.0 }\n", LAYER),
        ("twist = 1.0\n", world.as_str()),
    ] {
        let (_, mass, rest) = weigh(
            &scene(&format!("[bake]\noctave_fade = false\n[[tube]]\n{BENT}{radius}{more}{layer}")),
            0.015,
        );
        let error = mass / rest.image - 1.0;
        show(&format!("{more:?}: {error:.1e}"));
        assert!(error.abs() < 1e-4, "{more}: {error}");
    }
}

#[test]
fn closed_tubes_have_no_ends_to_lose_mass_at() {
    let ring = "curve = { kind = \"catmull-rom\", points = [[1,0,0],[0,1,0.3],[-1,0,0],[0,-1,0.3]], closed = true }\n";
    for conserve in ["off", "full"] {
        let text = format!("[[tube]]\n{ring}radius = 0.15\nconserve = \"{conserve}\"\n");
        let (_, mass, rest) = weigh(&scene(&text), 0.01);
        // Pappus: the mass of a bent tube that is alike on all sides is that of the straight one.
        let errors = [mass / rest.rest - 1.0, mass / rest.image - 1.0];
        assert!(errors.iter().all(|error| error.abs() < 1e-4), "{conserve}: {errors:?}");
    }
}

#[test]
fn conserved_mass_is_that_at_rest() {
    for radius in [0.2, 0.5, 0.8, 0.9] {
        for (name, layer) in kinds() {
            for conserve in ["radius", "full"] {
                let (_, mass, rest) = weigh(&bend(radius, conserve, layer), radius / 24.0);
                let [of_rest, of_image] = [rest.rest, rest.image].map(|other| mass / other - 1.0);
                show(&format!("{name} {radius} {conserve}: {of_rest:.1e} {of_image:.1e}"));
                assert!(of_image.abs() < 1e-4, "{name} {radius} {conserve}: {of_image}");
                // By radius alone, the inside of the bend gains what the outside loses only where both are alike. The
                // fade at the focal set, which starts at 0.8, takes up to 1e-4 of the tube with 0.9.
                if conserve == "full" || layer.is_empty() {
                    let tolerance = if radius > 0.8 { 3e-4 } else { 1e-4 };
                    assert!(of_rest.abs() < tolerance, "{name} {radius} {conserve}: {of_rest}");
                }
            }
        }
    }
}

#[test]
fn lost_mass_is_that_beyond_the_focal_set() {
    for radius in [1.1, 1.5, 2.0, 3.0_f64] {
        let c = 1.0 / radius;
        // The part of the disc beyond the line at c: an area, and the integral of (16 / 15) (1 - x^2)^(5/2).
        let uniform = (libm::acos(c) - c * (1.0 - c * c).sqrt()) / PI;
        let windowed: f64 = gauss_legendre(40)
            .into_iter()
            .map(|[x, weight]| {
                let x = c + (1.0 - c) * x;
                weight * (1.0 - c) * 3.2 / PI * libm::pow(1.0 - x * x, 2.5)
            })
            .sum();
        for (envelope, wanted) in [("hard", uniform), ("smooth", windowed)] {
            let found = at_rest(
                &scene(&format!(
                    "[[tube]]\n{}radius = {radius:?}\nenvelope = {{ radial = \"{envelope}\" }}\n",
                    arc()
                )),
                0.05,
            );
            let lost = found.lost / found.rest;
            show(&format!("{radius} {envelope}: {lost:.5} of {wanted:.5}"));
            // A point more or less on the far side of the line: there are some thousands to a disc.
            assert!((lost - wanted).abs() < 1e-3, "{radius} {envelope}: {lost} of {wanted}");
        }
    }
    // Where the radius is 0 there is no tube.
    let found = at_rest(
        &scene(&format!(
            "[[tube]]\n{STRAIGHT}radius = [[0, 0.0], [0.25, 0.0], [0.25, 0.1], [1, 0.1]]\ncaps = \"flat\"\n"
        )),
        0.01,
    );
    assert!((found.lost / found.rest - 0.25).abs() < 1e-9);
}

#[test]
fn mass_at_rest_is_lost_or_faded_out_or_has_an_image() {
    for radius in [0.5, 0.9, 1.0, 1.5_f64] {
        // What smoothstep(0, 0.2, x) leaves of x / max(x, 0.05), x = 1 - radius u, over the disc's chords up to x = 0.
        let width = 1.0 + (1.0 / radius).min(1.0);
        let faded: f64 = gauss_legendre(200)
            .into_iter()
            .map(|[u, weight]| {
                let u = width * u - 1.0;
                let x = (1.0 - radius * u).max(0.0);
                let t = (x / 0.2).clamp(0.0, 1.0);
                let kept = t * t * (3.0 - 2.0 * t) * x / x.max(0.05);
                let chord = weight * width * 2.0 / PI * (1.0 - u * u).sqrt();
                chord * (1.0 - kept)
            })
            .sum();
        let found = at_rest(
            &scene(&format!(
                "[[tube]]\n{}radius = {radius:?}\nconserve = \"full\"\nenvelope = {{ radial = \"hard\" }}\n",
                arc()
            )),
            0.05,
        );
        let [lost, share, image] = [found.lost, found.faded, found.image].map(|part| part / found.rest);
        show(&format!("{radius}: lost {lost:.5}, faded {share:.5} of {faded:.5}, image {image:.5}"));
        // A point more or less on the far side of a line: there are some thousands to a disc.
        assert!((share - faded).abs() < 1e-3, "{radius}: {share} of {faded}");
        // Each point is parted among the three.
        assert!((lost + share + image - 1.0).abs() < 1e-6, "{radius}");
    }
}

#[test]
fn thin_tubes_keep_their_mass() {
    let mut random = Random(4);
    for ratio in [0.1, 0.25, 0.5, 1.0] {
        let (mut squares, mut worst) = (0.0, 0.0_f64);
        const TUBES: u32 = 40;
        for _ in 0..TUBES {
            let start = random.point() * 3.0;
            let along = random.point().normalize() * 30.0;
            let [a, b, c] =
                [start, start + 0.5 * along, start + along].map(|p| format!("{:?}", p.to_array()));
            let text = format!("[[tube]]\ncurve = {{ points = [{a}, {b}, {c}] }}\nradius = {ratio:?}\n");
            let (_, mass, rest) = weigh(&scene(&text), 1.0);
            let error = mass / rest.rest - 1.0;
            squares += error * error;
            worst = worst.max(error.abs());
        }
        // Along an axis of the lattice a tube meets the voxels alike all the way, wherever it runs among them.
        for (y, z) in [(0.0, 0.0), (0.0, 0.25), (0.0, 0.5), (0.25, 0.25), (0.25, 0.5), (0.5, 0.5), (0.1, 0.4)]
        {
            let text = format!(
                "[[tube]]\ncurve = {{ points = [[0, {y}, {z}], [15, {y}, {z}], [30, {y}, {z}]] }}\nradius = {ratio:?}\n"
            );
            let (_, mass, rest) = weigh(&scene(&text), 1.0);
            worst = worst.max((mass / rest.rest - 1.0).abs());
        }
        let rms = (squares / f64::from(TUBES)).sqrt();
        show(&format!("radius of {ratio} voxels: rms {rms:.1e}, largest {worst:.1e}"));
        assert!(worst < 0.05, "radius of {ratio} voxels: {worst}");
    }
}

#[test]
fn volume_changes_as_the_gain_says() {
    let texts = [
        format!("[[tube]]\n{BENT}radius = [[0, 0.1], [0.4, 0.4], [1, 0.2]]\ntwist = 1.5\n"),
        format!("[[tube]]\n{BENT}radius = [[0, 0.3], [1, 0.2]]\nframe = \"frenet\"\ntwist = -0.7\n"),
        format!("[[tube]]\n{}radius = [[0, 0.3], [0.5, 0.6], [1, 0.2]]\ntwist = 3.0\n", arc()),
    ];
    let mut random = Random(9);
    for text in texts {
        let scene = scene(&text);
        let reference = Reference::new(&scene, None);
        let tube = &scene.tubes()[0];
        for _ in 0..100 {
            let angle = random.within(0.0, 2.0 * PI);
            let x = random.unit().sqrt();
            let at = [x * libm::cos(angle), x * libm::sin(angle), random.within(0.01, 0.99)];
            // Central differences: an error of the step's square, 1e-8, and of rounding over the step, 1e-12.
            let step = 1e-4;
            let side = |axis: usize, step: f64| {
                let mut at = at;
                at[axis] += step;
                DVec3::from(reference.world(0, at))
            };
            let [du, dv, dl] = [0, 1, 2].map(|axis| (side(axis, step) - side(axis, -step)) / (2.0 * step));
            let found = DMat3::from_cols(du, dv, dl).determinant();
            // 1 - kappa rho cos from the foot of the point, which is where the point came from.
            let p = reference.world(0, at);
            let off = |foot: &vdbake::reference::Cylindrical| {
                (foot.u - at[0]).abs() + (foot.v - at[1]).abs() + (foot.fraction - at[2]).abs()
            };
            let feet = reference.cylinder(0, p);
            let foot = feet.iter().min_by(|a, b| off(a).total_cmp(&off(b))).expect("a foot");
            if foot.focal < 0.02 {
                continue;
            }
            assert!(off(foot) < 1e-9, "{at:?} comes back as {foot:?}");
            let radius = tube.radius.at(at[2]);
            let wanted = foot.focal * radius * radius * reference.length(0);
            assert!((found / wanted - 1.0).abs() < 1e-5, "{at:?}: {found} against {wanted}\n{text}");
        }
    }
}
