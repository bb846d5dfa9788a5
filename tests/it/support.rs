//! Running the program, and what its files should hold.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use serde_json::Value;
use vdbake::field::{Field, Lattice};
use vdbake::num::Level;
use vdbake::scene::Scene;
use vdbake::volume::{self, Plan, Store};

/// Index and value of a voxel.
pub(crate) type Voxel = ([i32; 3], f32);

/// Voxels along the longest side in these tests: several leaves along every axis of every scene.
pub(crate) const RESOLUTION: &str = "64";

/// Every form in which values are stored.
pub(crate) const COMPRESSIONS: [&str; 3] = ["blosc", "zip", "none"];

/// Every precision and compression together, as options of the program.
pub(crate) const FORMS: [[&str; 4]; 6] = [
    ["--compression", "blosc", "--precision", "f32"],
    ["--compression", "zip", "--precision", "f32"],
    ["--compression", "none", "--precision", "f32"],
    ["--compression", "blosc", "--precision", "f16"],
    ["--compression", "zip", "--precision", "f16"],
    ["--compression", "none", "--precision", "f16"],
];

/// A straight solid tube: whole bricks inside it have one value, so they are stored as tiles.
pub(crate) const SOLID: &str = r#"
name = "solid"
[[tube]]
curve = { kind = "quadratic", points = [[0, 0, -1], [0, 0, 0], [0, 0, 1]] }
radius = 1
caps = "flat"
envelope = { radial = "hard" }
"#;

/// A baked file.
pub(crate) struct Baked {
    pub(crate) path: PathBuf,
    /// What the program said of it.
    pub(crate) report: Value,
    pub(crate) voxel_size: f64,
}

pub(crate) fn vdbake() -> Command {
    Command::new(env!("CARGO_BIN_EXE_vdbake"))
}

/// What a command of the program says in JSON, or its exit code and message.
pub(crate) fn json(command: &str, arguments: &[&str]) -> Result<Value, String> {
    let output =
        vdbake().arg(command).args(arguments).args(["--json", "--quiet"]).output().expect("it starts");
    if output.status.success() {
        Ok(serde_json::from_str(&stdout(&output)).expect("one JSON object"))
    } else {
        Err(format!("{} {}", output.status.code().unwrap_or(-1), stderr(&output)))
    }
}

/// A path as an argument.
pub(crate) fn text(path: &Path) -> &str {
    path.to_str().expect("a plain path")
}

/// The scenes that come with the project.
pub(crate) fn scenes() -> Vec<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes");
    let mut scenes: Vec<_> = fs::read_dir(folder)
        .expect("the folder of scenes")
        .map(|entry| entry.expect("a readable entry").path())
        .filter(|path| path.extension().is_some_and(|extension| extension == "toml"))
        .collect();
    scenes.sort();
    assert!(!scenes.is_empty());
    scenes
}

/// Some of those, each with leaves of another look, and the solid tube, which is written to `folder` and has tiles: for
/// programs that judge files, whatever scene they are of.
pub(crate) fn scenes_with_tiles(folder: &Path) -> Vec<PathBuf> {
    let few = ["galaxy", "sectors", "tornado", "trefoil"];
    let is_among = |path: &PathBuf| path.file_stem().is_some_and(|name| few.iter().any(|few| *few == name));
    let mut scenes: Vec<_> = scenes().into_iter().filter(is_among).collect();
    assert_eq!(scenes.len(), few.len());
    scenes.push(write(&folder.join("solid.toml"), SOLID));
    scenes
}

pub(crate) fn write(path: &Path, text: &str) -> PathBuf {
    fs::write(path, text).expect("a writable folder");
    path.to_owned()
}

/// Bakes a scene to a file in `folder`.
pub(crate) fn bake(scene: &Path, folder: &Path, options: &[&str]) -> Baked {
    let path = folder.join("baked.vdb");
    let output = vdbake()
        .arg("bake")
        .arg(scene)
        .arg("-o")
        .arg(&path)
        .args(["--json", "--quiet", "--resolution", RESOLUTION])
        .args(options)
        .output()
        .expect("the program starts");
    assert!(output.status.success(), "{}: {}", scene.display(), stderr(&output));
    let report: Value = serde_json::from_slice(&output.stdout).expect("one JSON object on stdout");
    let voxel_size = report["voxel_size"].as_f64().expect("voxel_size is a number");
    Baked { path, report, voxel_size }
}

/// The active voxels that the library finds in a scene, rounded as one of [`FORMS`] says, sorted by index.
pub(crate) fn rounded(scene: &Path, voxel_size: f64, form: [&str; 4]) -> Vec<Voxel> {
    let mut voxels = evaluated(scene, voxel_size);
    if form[3] == "f16" {
        voxels.iter_mut().for_each(|voxel| voxel.1 = half::f16::from_f32(voxel.1).to_f32());
    }
    voxels
}

/// The active voxels that the library finds in a scene, sorted by index.
pub(crate) fn evaluated(scene: &Path, voxel_size: f64) -> Vec<Voxel> {
    let text = fs::read_to_string(scene).expect("a readable scene");
    let scene = Scene::parse(&text, &scene.to_string_lossy()).expect("a valid scene");
    let lattice = Lattice { voxel_size };
    let mut field = Field::compile(&scene);
    field.widen(lattice);
    let plan = Plan::new(&field, lattice, 1 << 30).expect("a small bake");
    let mut store = Store::default();
    volume::bake(&field, &plan, scene.bake().cutoff, Level::best(), &mut store, |_| ())
        .expect("memory takes every brick");
    let mut voxels: Vec<_> = store.active().collect();
    voxels.sort_by_key(|voxel| voxel.0);
    assert!(!voxels.is_empty());
    voxels
}

/// That two lists of voxels are equal to the bit.
pub(crate) fn assert_same(found: &[Voxel], expected: &[Voxel], context: &str) {
    for (found, expected) in found.iter().zip(expected) {
        assert_eq!((found.0, found.1.to_bits()), (expected.0, expected.1.to_bits()), "{context}");
    }
    assert_eq!(found.len(), expected.len(), "{context}");
}

/// splitmix64 (Steele, Lea, Flood 2014).
pub(crate) fn random(state: &mut u64) -> u64 {
    *state = state.wrapping_add(0x9E37_79B9_7F4A_7C15);
    let z = (*state ^ (*state >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    let z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    z ^ (z >> 31)
}

pub(crate) fn stdout(output: &Output) -> String {
    String::from_utf8_lossy(&output.stdout).into_owned()
}

pub(crate) fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}
