//! Other people's programs, as judges of our files. `scripts/test` installs them and says where they are.

use std::fs::{self, File};
use std::io::BufReader;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use serde_json::Value;
use vdb_rs::{VdbLevel, VdbReader};

use crate::support::{Voxel, stderr, stdout};

/// What a judge found in a file.
pub(crate) struct Verdict {
    /// What its script in `scripts/oracle` printed.
    pub(crate) report: Value,
    /// Active voxels of the grid `density`, tiles expanded, sorted by index.
    pub(crate) voxels: Vec<Voxel>,
}

/// OpenVDB's own library, by way of its Python module.
pub(crate) fn openvdb(file: &Path) -> Result<Verdict, String> {
    let mut command = judge("VDBAKE_OPENVDB_PYTHON");
    verdict(script(&mut command, "openvdb_dump.py"), file)
}

/// OpenVDB's own library, of many files.
pub(crate) fn openvdb_all(files: &[PathBuf]) -> Result<Vec<Verdict>, String> {
    let mut command = judge("VDBAKE_OPENVDB_PYTHON");
    let output = run(script(&mut command, "openvdb_values.py").args(files))?;
    let reports: Vec<Value> =
        serde_json::from_slice(&output.stdout).map_err(|error| format!("{error}: {}", stdout(&output)))?;
    let values = |file: &PathBuf| voxels(Path::new(&format!("{}.values", file.display())));
    Ok(files.iter().zip(reports).map(|(file, report)| Verdict { report, voxels: values(file) }).collect())
}

/// Blender, and the OpenVDB that it carries. `samples` of the report holds its values at `points` of the world.
pub(crate) fn blender(file: &Path, points: &[[f64; 3]]) -> Result<Verdict, String> {
    let list = file.with_extension("points.json");
    fs::write(&list, serde_json::to_string(points).expect("finite numbers")).expect("a writable folder");
    let mut command = judge("VDBAKE_BPY_PYTHON");
    verdict(script(&mut command, "blender_check.py").arg("--points").arg(list), file)
}

/// What OpenVDB finds in a file at given indices.
pub(crate) struct Probed {
    /// What it says of the file and its grids.
    pub(crate) report: Value,
    /// For each grid, for each index: the value (a number stands in the first place) and whether it is active.
    pub(crate) grids: Vec<Vec<([f64; 3], bool)>>,
}

/// The variables that name the Pythons with OpenVDB's module: of version 10, and of version 12, which knows all types.
pub(crate) const OPENVDBS: [&str; 2] = ["VDBAKE_OPENVDB_PYTHON", "VDBAKE_BPY_PYTHON"];

/// What OpenVDB, of the version that knows all types, finds in files, each at its own indices.
pub(crate) fn openvdb_probe(files: &[&Path], points: &[Vec<[i32; 3]>]) -> Vec<Probed> {
    openvdb_probe_by(OPENVDBS[1], files, points)
}

/// The same, by either of [`OPENVDBS`].
pub(crate) fn openvdb_probe_by(python: &str, files: &[&Path], points: &[Vec<[i32; 3]>]) -> Vec<Probed> {
    let mut command = judge(python);
    let command = script(&mut command, "openvdb_probe.py");
    for (file, points) in files.iter().zip(points) {
        let list = file.with_extension("points");
        let bytes: Vec<u8> = points.as_flattened().iter().flat_map(|c| c.to_le_bytes()).collect();
        fs::write(&list, bytes).expect("a writable folder");
        command.arg(file).arg(list).arg(file.with_extension("probed"));
    }
    let output = run(command).unwrap_or_else(|error| panic!("{error}"));
    let reports: Vec<Value> =
        serde_json::from_slice(&output.stdout).unwrap_or_else(|error| panic!("{error}: {}", stdout(&output)));
    assert_eq!(reports.len(), files.len());
    let probed = files.iter().zip(points).zip(reports).map(|((file, points), report)| {
        let bytes = fs::read(file.with_extension("probed")).expect("what the script wrote");
        let (records, rest) = bytes.as_chunks::<25>();
        assert!(rest.is_empty());
        let samples: Vec<_> = records.iter().map(sample).collect();
        Probed { report, grids: samples.chunks(points.len()).map(<[_]>::to_vec).collect() }
    });
    probed.collect()
}

fn sample(record: &[u8; 25]) -> ([f64; 3], bool) {
    let [x, y, z] = [0, 1, 2].map(|at| f64::from_le_bytes(record.as_chunks().0[at]));
    ([x, y, z], record[24] != 0)
}

/// The files that OpenVDB's module makes for tests of reading, in `folder`.
pub(crate) fn openvdb_make(folder: &Path) -> Vec<PathBuf> {
    let mut command = judge("VDBAKE_BPY_PYTHON");
    let output =
        run(script(&mut command, "openvdb_make.py").arg(folder)).unwrap_or_else(|error| panic!("{error}"));
    stdout(&output).lines().map(|name| folder.join(name)).collect()
}

/// Runs OpenVDB's tool that makes and converts files.
pub(crate) fn vdb_tool(arguments: &[&str]) {
    run(judge("VDBAKE_VDB_TOOL").arg("-quiet").args(arguments)).unwrap_or_else(|error| panic!("{error}"));
}

/// What OpenVDB's own tool prints of a file, having read all of it.
pub(crate) fn vdb_print(file: &Path) -> Result<String, String> {
    let text = stdout(&run(judge("VDBAKE_VDB_PRINT").arg("-l").arg(file))?);
    // It exits with 0 whatever happens.
    if text.contains("ERROR") { Err(text) } else { Ok(text) }
}

/// The voxels that `vdb-rs` finds in a grid of numbers, sorted by index.
pub(crate) fn vdb_rs(file: &Path, grid: &str) -> Vec<Voxel> {
    let file = BufReader::new(File::open(file).expect("a readable file"));
    let grid = VdbReader::new(file).and_then(|mut reader| reader.read_grid::<f32>(grid)).expect("a grid");
    let mut voxels = Vec::new();
    for (corner, value, level) in grid.iter() {
        let edge = match level {
            VdbLevel::Voxel => 1,
            VdbLevel::Node3 => 8,
            VdbLevel::Node4 => 128,
        };
        let corner = corner.as_ivec3().to_array();
        voxels.extend(indices(edge).map(|at| ([0, 1, 2].map(|axis| corner[axis] + at[axis]), value)));
    }
    voxels.sort_by_key(|voxel| voxel.0);
    voxels
}

/// The indices in a cube at the origin.
pub(crate) fn indices(edge: i32) -> impl Iterator<Item = [i32; 3]> {
    (0..edge).flat_map(move |x| (0..edge).flat_map(move |y| (0..edge).map(move |z| [x, y, z])))
}

pub(crate) fn judge(variable: &str) -> Command {
    let program = std::env::var_os(variable)
        .unwrap_or_else(|| panic!("{variable} is not set: run scripts/test, which installs the oracles"));
    Command::new(program)
}

pub(crate) fn script<'a>(python: &'a mut Command, name: &str) -> &'a mut Command {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("scripts/oracle").join(name);
    python.env("PYTHONDONTWRITEBYTECODE", "1").arg(path)
}

fn run(command: &mut Command) -> Result<Output, String> {
    let output = command.output().unwrap_or_else(|error| panic!("{command:?}: {error}"));
    if output.status.success() { Ok(output) } else { Err(stderr(&output)) }
}

/// What OpenImageIO finds in an image: its parts, and the pixels of each.
pub(crate) fn exr_dump(file: &Path) -> (Value, Vec<Vec<f32>>) {
    let values = file.with_extension("values");
    let mut command = judge("VDBAKE_BPY_PYTHON");
    let command = script(&mut command, "exr_dump.py").arg(file).arg("--values").arg(&values);
    let output = run(command).unwrap_or_else(|error| panic!("{error}"));
    let report: Value =
        serde_json::from_slice(&output.stdout).unwrap_or_else(|error| panic!("{error}: {}", stdout(&output)));
    let bytes = fs::read(values).expect("the pixels that the script wrote");
    let (words, rest) = bytes.as_chunks::<4>();
    assert!(rest.is_empty());
    let mut words = words.iter().map(|word| f32::from_le_bytes(*word));
    let mut pixels = Vec::new();
    for part in report["parts"].as_array().expect("parts") {
        let size =
            |axis: usize| usize::try_from(part["size"][axis].as_u64().expect("a size")).expect("small");
        let channels = part["channels"].as_array().expect("channels").len();
        pixels.push(words.by_ref().take(size(0) * size(1) * channels).collect());
    }
    assert_eq!(words.next(), None);
    (report, pixels)
}

fn verdict(command: &mut Command, file: &Path) -> Result<Verdict, String> {
    let values = file.with_extension("values");
    let output = run(command.arg(file).arg("--values").arg(&values))?;
    let report =
        serde_json::from_slice(&output.stdout).map_err(|error| format!("{error}: {}", stdout(&output)))?;
    Ok(Verdict { report, voxels: voxels(&values) })
}

/// The voxels that a script wrote.
fn voxels(path: &Path) -> Vec<Voxel> {
    let bytes = fs::read(path).expect("the values that the script wrote");
    let (records, rest) = bytes.as_chunks::<16>();
    assert!(rest.is_empty());
    records.iter().map(|record| voxel(record.as_chunks::<4>().0)).collect()
}

fn voxel(words: &[[u8; 4]]) -> Voxel {
    ([0, 1, 2].map(|axis| i32::from_le_bytes(words[axis])), f32::from_le_bytes(words[3]))
}
