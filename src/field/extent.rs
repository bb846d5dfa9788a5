//! The room that a scene takes over all of its frames.

use glam::DVec3;
use rayon::prelude::*;

use super::Field;
use crate::scene::{Scene, SceneErrors};

/// Frames that are looked at, at most.
const FRAMES: i64 = 32;

/// Corners of the box around the density of a scene's own frames, from its start to its end, in metres; `None` where there
/// is no density in any.
///
/// It is the union of [`Field::bounds`] over all of these frames or, of more than 32, over 32 evenly spaced ones, the first
/// and the last among them; of a scene without an end it is that of the start frame. It depends on the scene's text alone,
/// so that voxels counted along it are the same at every time.
///
/// # Errors
///
/// What does not fit in the scene at one of these frames.
pub fn extent(scene: &Scene) -> Result<Option<[DVec3; 2]>, SceneErrors> {
    let time = scene.time();
    let last = last(scene);
    let steps = last.min(FRAMES - 1);
    let frames = (0..=steps).into_par_iter().map(|step| {
        let frame = time.start + if steps > 0 { (step * last + steps / 2) / steps } else { 0 };
        Ok(Field::compile(&scene.at(time.seconds(frame))?).bounds())
    });
    let boxes: Vec<Result<_, SceneErrors>> = frames.collect();
    let mut extent: Option<[DVec3; 2]> = None;
    for found in boxes {
        if let Some([lo, hi]) = found? {
            extent = Some(extent.map_or([lo, hi], |[a, b]| [a.min(lo), b.max(hi)]));
        }
    }
    Ok(extent)
}

/// The same of a scene whose field is this.
///
/// # Errors
///
/// As of [`extent`].
pub fn extent_around(scene: &Scene, field: &Field) -> Result<Option<[DVec3; 2]>, SceneErrors> {
    if last(scene) <= 0 && scene.seconds() == 0.0 { Ok(field.bounds()) } else { extent(scene) }
}

/// The scene's last frame, after its start, at which it may take other room.
fn last(scene: &Scene) -> i64 {
    let time = scene.time();
    if scene.is_moving() { time.end.unwrap_or(time.start) - time.start } else { 0 }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "what is not there fails the test")]

    use super::*;

    fn boxes(text: &str) -> [DVec3; 2] {
        extent(&Scene::parse(text, "scene.toml").unwrap()).unwrap().unwrap()
    }

    /// A straight tube that falls from z = 0 by 1 m a second, whatever the frames.
    fn falling(time: &str) -> String {
        let z = |z: f64| {
            format!("[0, 0, {{ keys = [[0, {z}], [100, {}]], interpolation = 'linear' }}]", z - 100.0)
        };
        format!(
            "[time]\nfps = 10\n{time}\n[[tube]]\nradius = 0.25\ncurve = {{ points = [{}, {}, {}] }}\n",
            z(0.0),
            z(1.0),
            z(2.0)
        )
    }

    #[test]
    fn all_own_frames_count_and_no_others() {
        for (time, lowest) in
            [("", 0.0), ("end = 1", 0.0), ("end = 11", -1.0), ("start = -99\nend = 1", -10.0)]
        {
            let [lo, hi] = boxes(&falling(time));
            // To the rounding of numbers up to 100.
            assert!((lo - DVec3::new(-0.25, -0.25, lowest)).abs().max_element() < 1e-12, "{time}: {lo}");
            assert!((hi - DVec3::new(0.25, 0.25, 2.0)).abs().max_element() < 1e-12, "{time}: {hi}");
        }
    }

    #[test]
    fn it_does_not_depend_on_the_time_that_the_scene_is_at() {
        let scene = Scene::parse(&falling("end = 300"), "scene.toml").unwrap();
        assert_eq!(extent(&scene).unwrap(), extent(&scene.at(7.7).unwrap()).unwrap());
    }

    #[test]
    fn a_fault_at_one_of_the_frames_is_told() {
        let text = falling("end = 11").replace("[100, -99]", "[1, 0]").replace("[100, -98]", "[1, -1]");
        let text = text.replace("[100, -100]", "[1, -1]").replace("[1, 0]", "[1, -1]");
        let errors = extent(&Scene::parse(&text, "scene.toml").unwrap()).unwrap_err();
        assert!(errors.to_string().contains("this is 1 s after the start frame"), "{errors}");
    }
}
