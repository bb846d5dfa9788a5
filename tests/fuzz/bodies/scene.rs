//! A scene's text, from the bytes of its file to its first bricks.

use vdbake::field::{Field, Lattice};
use vdbake::num::Level;
use vdbake::scene::{Scene, SceneErrors, Step};
use vdbake::volume::{self, Plan, Store};

use super::within;

const NAME: &str = "scene.toml";
/// Bytes that a plan may take.
const PLAN: u64 = 4 << 20;
/// Bricks that are baked.
const BRICKS: usize = 4;

pub(crate) fn run(data: &[u8]) -> bool {
    let most = (4 << 20) + 400 * data.len() as u64;
    let text = match (SceneErrors::not_utf8(NAME, data), std::str::from_utf8(data)) {
        (None, Ok(text)) => text,
        (Some(errors), Err(_)) => {
            check(&errors, &String::from_utf8_lossy(data));
            return false;
        }
        (errors, text) => panic!("{text:?} is text, or is not: {errors:?}"),
    };
    let scene = match within(most, || Scene::parse(text, NAME)) {
        Ok(scene) => scene,
        Err(errors) => {
            check(&errors, text);
            return false;
        }
    };
    let again = Scene::parse(scene.text(), NAME).expect("the same text");
    assert_eq!(format!("{scene:?}"), format!("{again:?}"));
    bake(&scene);
    match scene.at(0.75) {
        Ok(later) => bake(&later),
        Err(errors) => check(&errors, text),
    }
    true
}

/// That every fault lies in the text, and that all of them can be shown.
pub(crate) fn check(errors: &SceneErrors, text: &str) {
    let body = text.strip_prefix('\u{feff}').unwrap_or(text);
    let lines: Vec<_> = body.split('\n').collect();
    assert!(!errors.faults().is_empty() && errors.count() >= errors.faults().len());
    for fault in errors.faults() {
        // One past the last character is the place of what is missing at the end of a line.
        let line = lines.get(fault.line() - 1).expect("the line is in the text");
        assert!((1..=line.chars().count() + 1).contains(&fault.column()), "{fault:?}");
        assert!(!fault.message().is_empty());
    }
    assert!(errors.to_string().len() < errors.to_coloured().len());
}

/// Plans the scene's density, and bakes a few bricks of it.
fn bake(scene: &Scene) {
    let mut field = Field::compile(scene);
    let edge = field.bounds().map_or(0.0, |[low, high]| (high - low).max_element());
    let voxel_size = match scene.bake().step {
        Step::VoxelSize(size) => size,
        Step::Resolution(count) => edge / f64::from(count),
    };
    if voxel_size.is_nan() || voxel_size < 1e-9 {
        return;
    }
    let lattice = Lattice { voxel_size };
    field.widen(lattice);
    let Ok(plan) = Plan::new(&field, lattice, PLAN) else { return };
    let mut store = Store::default();
    let done =
        volume::bake(&field, &plan.sample(BRICKS), scene.bake().cutoff, Level::best(), &mut store, |_| ());
    assert!(done.is_ok());
    assert!(store.active().all(|(_, value)| !value.is_nan()));
}
