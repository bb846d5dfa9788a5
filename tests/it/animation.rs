//! Scenes that move: at any time the density is right, and from time to time it is the same one.

use std::f64::consts::TAU;

use glam::DVec3;
use rayon::prelude::*;
use vdbake::field::{Field, extent};
use vdbake::reference::Reference;
use vdbake::scene::Scene;

use crate::kernel::{assert_close, shipped};

/// Everything that a tube has moves here.
const RESTLESS: &str = r#"
[time]
fps = 10
end = 31
[[tube]]
radius = [[0, { keys = [[0, 0.2], [1, 0.3]] }], [{ mean = 0.5, amplitude = 0.2, period = 2 }, 0.35], [1, 0.2]]
twist = { keys = [[0, 0], [3, 2]], interpolation = "linear" }
spin = { keys = [[0, 0], [1, 0.8], [2, -0.4]], interpolation = "step", repeat = true }
envelope = { radial = { mean = 0.6, amplitude = 0.3, period = 1.7 }, axial = { keys = [[0, 0.1], [3, 0.3]] } }
[tube.curve]
kind = "cubic"
points = [
  { centre = [0, 0, 0], arm = [0.1, 0, 0], period = 1.3 },
  { centre = [0.3, 0, 0.6], arm = [0, 0.2, 0], period = 1.9, axis = [1, 0, 1] },
  [{ mean = -0.1, amplitude = 0.3, period = 2.3, phase = 0.4 }, 0, 1.2],
  { centre = [0, { keys = [[0, 0], [3, 0.5]] }, 2], arm = [0.1, 0.1, 0], period = 0.9, axis = [0, 0, -1] },
]
[[tube.layer]]
frequency = { keys = [[0, 2], [3, 3]] }
octaves = 4
lacunarity = { mean = 2, amplitude = 0.1, period = 5 }
gain = { keys = [[0, 0.4], [2, 0.5]] }
threshold = { mean = -0.2, amplitude = 0.1, period = 1 }
multiplier = { keys = [[0, 1], [3, 2]] }
scroll = [0, { mean = 0.1, amplitude = 2, period = 1.1 }, { keys = [[0.5, 0], [1.5, -2]] }]
"#;

fn restless() -> Scene {
    Scene::parse(RESTLESS, "restless.toml").unwrap_or_else(|errors| panic!("{errors}"))
}

fn at(scene: &Scene, seconds: f64) -> Scene {
    scene.at(seconds).unwrap_or_else(|errors| panic!("{errors}"))
}

/// The scene's control points.
fn points(scene: &Scene) -> Vec<[DVec3; 3]> {
    let segments = scene.tubes()[0].curve.segments();
    segments
        .iter()
        .map(|segment| [segment.at(0.0), segment.at(0.0) + segment.d1(0.0) / 2.0, segment.at(1.0)])
        .collect()
}

#[test]
fn the_kernel_agrees_with_the_reference_at_any_time() {
    for (name, scene) in
        [("tornado", shipped("tornado")), ("solar_flare", shipped("solar_flare")), ("restless", restless())]
    {
        for seconds in [-0.7, 0.9, 2.45, 1000.0] {
            assert_close(&format!("{name} after {seconds} s"), &at(&scene, seconds), 120.0, 0.0);
        }
    }
}

/// In a microsecond nothing moves by more than some micrometres, and nothing turns or flows by more than some millionths of
/// a turn or a cell: rates may jump, what they have added up to may not.
#[test]
fn density_is_continuous_in_time() {
    for scene in [shipped("tornado"), shipped("solar_flare"), restless()] {
        let [lo, hi] = extent(&scene).expect("valid").expect("there is density");
        let points: Vec<DVec3> = (0..4000)
            .map(|i| {
                // The additive sequence of the plastic number (Roberts, 2018).
                let unit = [0.819_172_513_396_164_4, 0.671_043_606_703_789_3, 0.549_700_477_901_970_3];
                lo + (hi - lo) * DVec3::from(unit.map(|step| (0.5 + step * f64::from(i)).fract()))
            })
            .collect();
        // Keys are at some of these times, frames at others.
        for seconds in [0.0, 0.5, 0.75, 1.0, 1.3, 2.0, 2.5, 3.0] {
            let [before, after] = [-5e-7, 5e-7].map(|step| Reference::new(&at(&scene, seconds + step), None));
            let change: f64 = points
                .par_iter()
                .map(|p| (after.density(p.to_array()) - before.density(p.to_array())).abs())
                .reduce(|| 0.0, f64::max);
            // Speeds are below 5 m/s and 20 cells/s, slopes below 200 a metre or cell. A jump would be of the order of 0.1.
            assert!(change < 1e-6 * 20.0 * 200.0, "{} at {seconds}: {change:e}", scene.name());
        }
    }
}

#[test]
fn shipped_scenes_start_where_they_stood_still() {
    let tornado = shipped("tornado");
    let expected = [DVec3::ZERO, DVec3::new(0.35, 0.1, 1.2), DVec3::new(0.0, 0.0, 2.5)];
    for (found, expected) in points(&tornado)[0].iter().zip(expected) {
        // The middle point is derived here from a polynomial.
        assert!((*found - expected).length() < 1e-15, "{found}");
    }
    let corners = points(&shipped("solar_flare")).into_iter().map(|[_, corner, _]| corner);
    let expected = [(1.0, 0.0), (1.0, 2.0), (-1.0, 2.0), (-1.0, 0.0)];
    for (found, (x, z)) in corners.zip(expected) {
        assert!((found - DVec3::new(x, 0.0, z)).length() < 1e-15, "{found}");
    }
}

/// Moinet, section 5.1: each point moves in a circle about the middle of the scene, each with a different frequency.
#[test]
fn the_tornados_points_circle_each_in_its_own_time() {
    let scene = shipped("tornado");
    let centres = [[-0.06, 0.0, 0.0], [0.0, 0.0, 1.2], [0.0, 0.11, 2.5]].map(DVec3::from);
    let start = points(&scene)[0];
    for step in 1..40 {
        let seconds = 0.0625 * f64::from(step);
        let now = points(&at(&scene, seconds))[0];
        for (which, period) in [3.1, 4.3, 5.9].into_iter().enumerate() {
            let (a, b) = (start[which] - centres[which], now[which] - centres[which]);
            let (sin, cos) = libm::sincos(TAU * seconds / period);
            let expected = DVec3::new(cos * a.x - sin * a.y, sin * a.x + cos * a.y, a.z);
            // Rounding of metres.
            assert!((b - expected).length() < 1e-14, "point {which} after {seconds} s");
        }
    }
}

/// Moinet, section 5.1: the circle grows with time before slowly shrinking back.
#[test]
fn the_flare_grows_and_slowly_shrinks_back() {
    let scene = shipped("solar_flare");
    let length = |frame| at(&scene, scene.time().seconds(frame)).tubes()[0].curve.length();
    let lengths: Vec<f64> = (1..=61).map(length).collect();
    let largest = lengths.iter().copied().fold(0.0, f64::max);
    let peak = lengths.iter().position(|length| *length == largest).expect("one of them");
    assert_eq!(peak, 18, "three quarters of a second");
    assert!((largest / lengths[0] - 1.3).abs() < 1e-9 && (lengths[60] / lengths[0] - 1.0).abs() < 1e-9);
    assert!(lengths[..=peak].is_sorted() && lengths[peak..].iter().rev().is_sorted());
    assert!(60 - peak > 2 * peak, "slower back than out");
    // It scales as a whole, so no joint ever shows.
    for frame in [1, 10, 19, 40, 60] {
        let now = at(&scene, scene.time().seconds(frame));
        let curve = &now.tubes()[0].curve;
        assert!((0..3).all(|joint| curve.turn(joint) < 1e-12));
    }
}

#[test]
fn the_own_frames_of_a_scene_hold_each_of_them() {
    for scene in [shipped("tornado"), shipped("solar_flare"), restless()] {
        let [lo, hi] = extent(&scene).expect("valid").expect("there is density");
        let end = scene.time().end.expect("an end");
        for frame in scene.time().start..=end {
            let now = at(&scene, scene.time().seconds(frame));
            let [a, b] = Field::compile(&now).bounds().expect("there is density");
            // Between the 32 frames that are looked at the density may reach a little farther.
            let margin = 0.01 * (hi - lo).max_element();
            assert!((lo - a).max(b - hi).max_element() < margin, "{} in frame {frame}", scene.name());
        }
    }
}
