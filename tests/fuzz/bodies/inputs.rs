//! Files that a scene names: a curve's points, or the keys of a radius.

use vdbake::scene::Scene;

use super::within;

/// A scene whose curve is a file, and one whose radius is.
const SCENES: [&str; 2] = [
    "[[tube]]\ncurve = { kind = \"catmull-rom\", file = \"x.csv\" }\n",
    "[[tube]]\ncurve = { points = [[0, 0, 0], [1, 0, 0], [2, 0, 1]] }\nradius = { file = \"x.csv\" }\n",
];

pub(crate) fn run(data: &[u8]) -> bool {
    let Some((which, file)) = data.split_first() else { return false };
    let text = SCENES[usize::from(which % 2)];
    let most = (4 << 20) + 400 * data.len() as u64;
    match within(most, || Scene::load(text, "scene.toml", &|_| Ok(file.to_vec()))) {
        Ok(scene) => {
            assert_eq!(scene.inputs().len(), 1);
            true
        }
        Err(errors) => {
            super::scene::check(&errors, text);
            assert!(errors.to_string().len() < 4000);
            false
        }
    }
}
