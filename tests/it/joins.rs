//! How feet and tubes join, what density owes to the deformation, and tubes thinner than a voxel: the kernel against the
//! reference.

use glam::DVec3;
use rayon::prelude::*;
use vdbake::field::{Field, Lattice};
use vdbake::num::Level;
use vdbake::reference::Reference;
use vdbake::scene::Scene;
use vdbake::volume::{Plan, Store, bake, density_at};

use crate::kernel::{assert_close, scene};

const LAYER: &str = "[[tube.layer]]\nfrequency = [2.0, 2.0, 4.0]\noctaves = 3\nthreshold = -0.3\n";
const RULES: [&str; 4] = ["max", "sum", "closest", "blend"];

/// A cubic that crosses itself, bent more sharply than its radius, and two more tubes that cross it.
const TANGLE: [&str; 3] = [
    "curve = { kind = \"cubic\", points = [[0,0,0],[2.2,0.2,1.4],[-1.2,0.1,1.4],[1,0.3,0]] }\nradius = 0.3\ntwist = 1.0\n",
    "curve = { kind = \"quadratic\", points = [[-0.5,0.2,0.4],[0.5,0.2,0.9],[1.5,0,0.4]] }\nradius = [[0, 0.1], [1, 0.35]]\n",
    "curve = { kind = \"quadratic\", points = [[0.5,-0.6,0.3],[0.5,0,0.3],[0.5,0,0.3],[0.5,0.1,0.9],[0.4,0.9,0.8]] }\nradius = 0.25\ncaps = \"round\"\n",
];

#[test]
fn every_rule_agrees_with_the_reference() {
    for between in RULES {
        for within in RULES {
            let mut text = format!("overlap = \"{between}\"\n");
            for tube in TANGLE {
                text += &format!("[[tube]]\noverlap = \"{within}\"\n{tube}{LAYER}");
            }
            // The nearest of two axes jumps where they are equally far, and a rounding decides: sampled voxels may meet
            // that surface, and then the two differ by as much as their densities do.
            if between != "closest" && within != "closest" {
                for resolution in [24.0, 90.0] {
                    assert_close(&format!("{between} of {within}"), &scene(&text), resolution, 0.0);
                }
            }
        }
    }
}

const SHAPES: [(&str, &str); 6] = [
    ("straight", "curve = { points = [[0,0,0],[0,0,1],[0,0,2]] }\nradius = 0.3\n"),
    (
        "keyed",
        "curve = { kind = \"cubic\", points = [[0,0,0],[1,0,0.3],[1,1,0.6],[0,1,1]] }\nradius = [[0, 0.05], [0.3, 0.25], [0.6, 0.1], [1, 0.3]]\n",
    ),
    ("tight", "curve = { points = [[0,0,0],[0.6,0,0.5],[0,0,1]] }\nradius = 0.45\ntwist = 0.5\n"),
    ("metres", "curve = { points = [[0,0,0],[0.5,0,1],[0,0,2]] }\nradius = 0.3\nstretch = false\n"),
    (
        "round",
        "curve = { points = [[0,0,0],[0.5,0,1],[0,0,2]] }\nradius = [[0, 0.1], [1, 0.4]]\ncaps = \"round\"\n",
    ),
    (
        "corner",
        "curve = { points = [[0,0,0],[0,0,0.5],[0,0,1],[0,0.5,1.2],[0,1,1.4]] }\nradius = 0.25\nrest = { radius = 0.5, length = 3 }\n",
    ),
];

#[test]
fn conserved_density_agrees_with_the_reference() {
    for (name, tube) in SHAPES {
        for conserve in ["radius", "full"] {
            let text = format!("[[tube]]\n{tube}conserve = \"{conserve}\"\n{LAYER}");
            for resolution in [30.0, 120.0] {
                assert_close(&format!("{name}, {conserve}"), &scene(&text), resolution, 0.0);
            }
        }
    }
}

#[test]
fn thin_tubes_agree_with_the_reference() {
    let shapes = [
        ("thread", "curve = { points = [[0,0,0],[0.6,0,0.5],[0,0,1]] }\nradius = 0.001\n"),
        ("tapering", "curve = { points = [[0,0,0],[0.6,0,0.5],[0,0,1]] }\nradius = [[0, 0.0], [1, 0.1]]\n"),
        (
            "thin in the middle",
            "curve = { points = [[0,0,0],[0.6,0,0.5],[0,0,1]] }\nradius = [[0, 0.1], [0.5, 0.01], [1, 0.1]]\n",
        ),
        (
            "stepped",
            "curve = { points = [[0,0,0],[0.6,0,0.5],[0,0,1]] }\nradius = [[0.4, 0.1], [0.4, 0.02], [0.6, 0.02], [0.6, 0.1]]\n",
        ),
    ];
    for (name, tube) in shapes {
        for conserve in ["off", "full"] {
            let text = format!("[[tube]]\n{tube}conserve = \"{conserve}\"\n{LAYER}");
            for resolution in [20.0, 60.0] {
                assert_close(&format!("{name}, {conserve}"), &scene(&text), resolution, 0.0);
            }
        }
    }
}

/// The centres of all voxels of the box around the density.
fn centres(field: &Field, lattice: Lattice) -> Vec<DVec3> {
    let [lo, hi] = field.bounds().expect("the scene has density");
    let h = lattice.voxel_size;
    #[allow(clippy::cast_possible_truncation, reason = "some dozens of voxels")]
    let range = |axis: usize| (lo[axis] / h).floor() as i32..=(hi[axis] / h).ceil() as i32;
    let mut centres = Vec::new();
    for x in range(0) {
        for y in range(1) {
            centres.extend(range(2).map(|z| (DVec3::new(x.into(), y.into(), z.into()) + 0.5) * h));
        }
    }
    centres
}

/// Distances, in order, to the feet that count.
fn distances(scene: &Scene, reference: &Reference, p: DVec3) -> Vec<f64> {
    let tubes = 0..scene.tubes().len();
    let feet = tubes.flat_map(|tube| reference.cylinder(tube, p.to_array()));
    let mut distances: Vec<f64> =
        feet.filter(|at| at.q() <= 1.0).map(|at| at.q().sqrt() * at.radius).collect();
    distances.sort_by(f64::total_cmp);
    distances
}

#[test]
fn the_closest_foot_agrees_with_the_reference_but_where_two_are_equally_far() {
    for (between, within) in
        [("closest", "closest"), ("closest", "max"), ("sum", "closest"), ("blend", "closest")]
    {
        let mut text = format!("overlap = \"{between}\"\n[bake]\nwiden = false\n");
        for tube in TANGLE {
            text += &format!("[[tube]]\noverlap = \"{within}\"\n{tube}{LAYER}");
        }
        let scene = scene(&text);
        let field = Field::compile(&scene);
        let lattice = Lattice { voxel_size: 0.04 };
        let points = centres(&field, lattice);
        let found = density_at(&field, lattice, &points, Level::best(), 1 << 30).expect("a small plan");
        let reference = Reference::new(&scene, Some(lattice.voxel_size));
        let compared: Vec<(f64, f64)> = points
            .par_iter()
            .zip(&found)
            .step_by(3)
            .filter(|(point, _)| {
                // A tie within 1e-4 of a radius: single precision places feet to 1e-5 of it.
                let distances = distances(&scene, &reference, **point);
                distances.windows(2).all(|pair| pair[1] - pair[0] > 3e-5)
            })
            .map(|(point, found)| (reference.density(point.to_array()), f64::from(*found)))
            .collect();
        let peak = compared.iter().fold(0.0_f64, |most, pair| most.max(pair.0));
        let worst = compared.iter().fold(0.0_f64, |most, pair| most.max((pair.0 - pair.1).abs()));
        assert!(compared.len() > 5_000 && peak > 0.1, "{}", compared.len());
        // As in the kernel's tests: 3.75 a f over three octaves, times the error of a foot.
        assert!(worst <= 4e-5 * peak, "{between} of {within}: {worst:e} of {peak}");
    }
}

/// Whether the distance from p to the curve of a single segment has a local maximum within the tube: by dense samples.
fn is_beyond(segment: &vdbake::curve::Segment, p: DVec3, radius: f64) -> bool {
    const STEPS: u32 = 500;
    let distance = |i: u32| segment.at(f64::from(i) / f64::from(STEPS)).distance(p);
    (1..STEPS).any(|i| {
        let here = distance(i);
        here <= radius && here > distance(i - 1) && here >= distance(i + 1)
    })
}

#[test]
fn voxels_with_several_feet_and_beyond_the_focal_set_are_counted() {
    // A parabola whose curvature exceeds 1 / radius at its vertex, and a loop.
    for (name, tube, radius) in [
        ("parabola", "curve = { points = [[0,0,0],[1.2,0.02,0.5],[0,0,1]] }", 0.45),
        (
            "loop",
            "curve = { kind = \"cubic\", points = [[0,0,0],[2.2,0.2,1.4],[-1.2,0.1,1.4],[1,0.3,0]] }",
            0.3,
        ),
    ] {
        let mut truth = None;
        for overlap in RULES {
            let text =
                format!("[[tube]]\n{tube}\nradius = {radius}\ncaps = \"flat\"\noverlap = \"{overlap}\"\n");
            let scene = scene(&text);
            let field = Field::compile(&scene);
            let lattice = Lattice { voxel_size: 0.03 };
            let plan = Plan::new(&field, lattice, 1 << 30).expect("a small plan");
            let Ok((tally, _)) = bake(&field, &plan, 0.0, Level::best(), &mut Store::default(), |_| ());
            // The rule has no say in where feet are.
            let (several, beyond) = *truth.get_or_insert_with(|| {
                let reference = Reference::new(&scene, None);
                let segment = &scene.tubes()[0].curve.segments()[0];
                let points = centres(&field, lattice);
                let several =
                    points.par_iter().filter(|p| distances(&scene, &reference, **p).len() > 1).count();
                (several, points.par_iter().filter(|p| is_beyond(segment, **p, radius)).count())
            });
            assert!(several > 500 && beyond > 50, "{name}: {several} and {beyond}");
            // Voxels whose two feet nearly meet, or that lie on the tube's surface, may fall to either side.
            let near = |found: u64, truth: usize| found.abs_diff(truth as u64) <= 2 + truth as u64 / 250;
            assert!(
                near(tally.several_feet_voxels, several),
                "{name}: {} of {several}",
                tally.several_feet_voxels
            );
            assert!(
                near(tally.beyond_focal_voxels, beyond),
                "{name}: {} of {beyond}",
                tally.beyond_focal_voxels
            );
        }
    }
}
