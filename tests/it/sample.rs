//! `vdbake sample`: the program beside closed forms, its own files, and OpenVDB's values.

use std::fs::{self, File};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Output, Stdio};

use serde_json::Value;
use tempfile::tempdir;
use vdbake::formats::npy::{self, Array, Values};
use vdbake::formats::vdb::{
    self, Compression, EncodedBricks, FileHeader, GridClass, GridHeader, Metadata, VdbFile, VdbGridBuilder,
    VectorType, WriteGrid,
};

use crate::oracle::{judge, openvdb_make, openvdb_probe, vdb_tool};
use crate::support::{bake, evaluated, random, scenes_with_tiles, stderr, stdout, vdbake, write};

/// A straight tube whose density falls linearly from 1 on the axis to 0 at the radius of 1.
const CONE: &str = r#"
name = "cone"
[[tube]]
curve = { points = [[0.1, 0.2, -2], [0.1, 0.2, 0], [0.1, 0.2, 2]] }
radius = 1
caps = "flat"
envelope = { radial = "linear" }
"#;

/// Saves two points in every form that NumPy has for them, and in two that are refused.
const SAVE: &str = r#"
import numpy as np
points = np.array([[0.25, 0.5, 0.125], [-0.5, 0.25, 1.5]])
for kind in "<f4", "<f8", ">f4", ">f8":
    order = "big" if kind[0] == ">" else "little"
    for version in 1, 2, 3:
        with open(f"{kind[1:]}_{order}_{version}.npy", "wb") as file:
            np.lib.format.write_array(file, points.astype(kind), (version, 0))
np.save("fortran.npy", np.asfortranarray(points))
np.save("whole.npy", points.astype(int))
"#;

/// Prints the type, the shape and the elements of two arrays.
const LOAD: &str = r#"
import numpy as np
for name in "single.npy", "double.npy":
    array = np.load(name)
    print(array.dtype.str, *array.shape, *array.tolist())
"#;

fn cone(p: [f64; 3]) -> f64 {
    1.0 - radius(p)
}

fn radius([x, y, _]: [f64; 3]) -> f64 {
    ((x - 0.1) * (x - 0.1) + (y - 0.2) * (y - 0.2)).sqrt()
}

/// Points inside the cone's tube, away from its axis, its surface and its ends.
fn inside(count: usize) -> Vec<[f64; 3]> {
    let mut state = 11;
    let mut unit = || f64::from(u32::try_from(random(&mut state) >> 32).expect("32 bits")) / 4_294_967_296.0;
    let mut points = vec![];
    while points.len() < count {
        let p = [2.0 * unit() - 0.9, 2.0 * unit() - 0.8, 3.6 * unit() - 1.8];
        if (0.2..0.9).contains(&radius(p)) {
            points.push(p);
        }
    }
    points
}

fn csv(points: &[[f64; 3]]) -> String {
    points.iter().map(|[x, y, z]| format!("{x},{y},{z}\n")).collect()
}

fn put_npy(path: &Path, values: Values) -> PathBuf {
    let count = match &values {
        Values::F32(values) => values.len(),
        Values::F64(values) => values.len(),
    };
    let mut file = File::create(path).expect("a writable folder");
    npy::write(&mut file, &Array { shape: vec![count / 3, 3], values }).expect("a writable file");
    path.to_owned()
}

fn get_npy(path: &Path) -> Array {
    npy::read(&mut File::open(path).expect("a file")).expect("an array")
}

fn singles(array: Array) -> Vec<f32> {
    match array.values {
        Values::F32(values) => values,
        Values::F64(_) => panic!("double precision"),
    }
}

/// Runs `vdbake sample`, in this folder, with these points on standard input.
fn run(folder: &Path, arguments: &[&str], input: &str) -> Output {
    let mut child = vdbake()
        .current_dir(folder)
        .arg("sample")
        .args(arguments)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .expect("the program starts");
    // One that has failed already does not read it.
    let _ = child.stdin.take().expect("a pipe").write_all(input.as_bytes());
    child.wait_with_output().expect("an end")
}

fn succeed(folder: &Path, arguments: &[&str], input: &str) -> Output {
    let output = run(folder, arguments, input);
    assert!(output.status.success(), "{arguments:?}: {}", stderr(&output));
    output
}

/// The array that `vdbake sample` writes.
fn sampled(folder: &Path, arguments: &[&str]) -> Array {
    succeed(folder, &[arguments, &["-o", "found.npy", "--quiet"]].concat(), "");
    get_npy(&folder.join("found.npy"))
}

/// The points and values of a table.
fn table(text: &str) -> Vec<([f64; 3], f64)> {
    let mut lines = text.lines();
    assert_eq!(lines.next(), Some("x,y,z,value"));
    lines
        .map(|line| {
            let numbers: Vec<f64> = line.split(',').map(|field| field.parse().expect("a number")).collect();
            let [x, y, z, value] = numbers[..] else { panic!("{line}") };
            ([x, y, z], value)
        })
        .collect()
}

#[test]
fn a_scene_has_its_closed_form() {
    let folder = tempdir().expect("a temporary folder");
    write(&folder.path().join("cone.toml"), CONE);
    let points = inside(500);
    let kernel = table(&stdout(&succeed(folder.path(), &["cone.toml", "--points", "-"], &csv(&points))));
    let exact =
        table(&stdout(&succeed(folder.path(), &["cone.toml", "--points", "-", "--exact"], &csv(&points))));
    assert_eq!((kernel.len(), exact.len()), (500, 500));
    for ((point, kernel), exact) in points.iter().zip(&kernel).zip(&exact) {
        assert_eq!((kernel.0, exact.0), (*point, *point), "digits give the same numbers back");
        // Single precision, in the reference double.
        assert!((kernel.1 - cone(*point)).abs() < 1e-6, "{point:?}: {kernel:?}");
        assert!((exact.1 - cone(*point)).abs() < 1e-12, "{point:?}: {exact:?}");
    }
}

#[test]
fn a_file_has_the_closed_form_up_to_its_filter() {
    let folder = tempdir().expect("a temporary folder");
    let scene = write(&folder.path().join("cone.toml"), CONE);
    let baked = bake(&scene, folder.path(), &[]);
    let h = baked.voxel_size;
    let points = inside(2000);
    let text = csv(&points);
    let mut squares = vec![];
    for filter in ["nearest", "trilinear", "cubic"] {
        let found = table(&stdout(&succeed(
            folder.path(),
            &["baked.vdb", "--points", "-", "--filter", filter],
            &text,
        )));
        let mut sum = 0.0;
        for (point, (at, value)) in points.iter().zip(found) {
            assert_eq!(at, *point);
            let error = value - cone(*point);
            let nearest_axis = radius(*point) - 2.0 * h;
            let bound = match filter {
                // Slope 1, half a voxel along each of the two axes that matter.
                "nearest" => h * 0.5_f64.sqrt(),
                // h^2 / 8 times the second derivatives along x and y, each at most 1 / r; cubic is clamped to the same cell, so it
                // is no worse than linear, twice.
                "trilinear" => h * h / (4.0 * nearest_axis),
                _ => h * h / (2.0 * nearest_axis),
            };
            assert!(error.abs() < bound + 1e-6, "{filter} at {point:?}: {error}, bound {bound}");
            sum += error * error;
        }
        squares.push(sum);
    }
    let default = succeed(folder.path(), &["baked.vdb", "--points", "-"], &text);
    let trilinear = succeed(folder.path(), &["baked.vdb", "--points", "-", "--filter", "trilinear"], &text);
    assert_eq!(stdout(&default), stdout(&trilinear));
    // Where density is smooth a higher order is more accurate, on the whole.
    assert!(squares[2] < 0.5 * squares[1] && squares[1] < 0.1 * squares[0], "{squares:?}");
}

#[test]
fn centres_of_voxels_have_stored_values() {
    let folder = tempdir().expect("a temporary folder");
    for scene in scenes_with_tiles(folder.path()) {
        let baked = bake(&scene, folder.path(), &[]);
        let voxels: Vec<_> = evaluated(&scene, baked.voxel_size).into_iter().step_by(7).collect();
        let indices = voxels.iter().flat_map(|voxel| voxel.0.map(f64::from)).collect();
        // Indices are small and exact in single precision.
        let centres =
            voxels.iter().flat_map(|v| v.0.map(|c| (f64::from(c) + 0.5) * baked.voxel_size)).collect();
        put_npy(&folder.path().join("indices.npy"), Values::F64(indices));
        put_npy(&folder.path().join("centres.npy"), Values::F64(centres));
        for filter in ["nearest", "trilinear", "cubic"] {
            let found = singles(sampled(
                folder.path(),
                &["baked.vdb", "--points", "indices.npy", "--index", "--filter", filter],
            ));
            assert_eq!(found.len(), voxels.len());
            for (found, (index, expected)) in found.iter().zip(&voxels) {
                assert_eq!(
                    found.to_bits(),
                    expected.to_bits(),
                    "{filter} at {index:?} of {}",
                    scene.display()
                );
            }
        }
        let found =
            singles(sampled(folder.path(), &["baked.vdb", "--points", "centres.npy", "--filter", "nearest"]));
        assert!(found.iter().zip(&voxels).all(|(found, voxel)| found.to_bits() == voxel.1.to_bits()));
    }
}

#[test]
fn stored_values_are_those_that_openvdb_finds() {
    let folder = tempdir().expect("a temporary folder");
    let path = |name: &str| folder.path().join(name);
    let text = |name: &str| path(name).to_str().expect("UTF-8").to_owned();
    vdb_tool(&["-sphere", "dim=40", "center=(-1,0.2,0.3)", "-write", &text("sphere.vdb")]);
    vdb_tool(&["-sphere", "dim=40", "-ls2fog", "-write", "bits=16", "codec=zip", &text("ball.vdb")]);
    vdb_tool(&["-sphere", "dim=40", "-grad", "-write", "codec=active", &text("gradient.vdb")]);
    let mut files = vec![path("sphere.vdb"), path("ball.vdb"), path("gradient.vdb")];
    for (number, scene) in scenes_with_tiles(folder.path()).into_iter().enumerate() {
        let baked = bake(&scene, folder.path(), &[]);
        files.push(path(&format!("own{number}.vdb")));
        fs::rename(baked.path, &files[files.len() - 1]).expect("the same folder");
    }
    files.extend(openvdb_make(folder.path()));

    let points: Vec<Vec<[i32; 3]>> = files.iter().map(|file| indices(file)).collect();
    let paths: Vec<&Path> = files.iter().map(PathBuf::as_path).collect();
    for ((file, points), probed) in files.iter().zip(&points).zip(openvdb_probe(&paths, &points)) {
        let values = points.as_flattened().iter().map(|c| f64::from(*c)).collect();
        let list = put_npy(&file.with_extension("npy"), Values::F64(values));
        let list = list.to_str().expect("UTF-8");
        let grids = probed.report["grids"].as_array().expect("grids");
        for (number, (grid, expected)) in grids.iter().zip(probed.grids).enumerate() {
            let of_name =
                |grids: &[Value]| grids.iter().filter(|other| other["name"] == grid["name"]).count();
            let mut name = grid["name"].as_str().expect("a name").to_owned();
            if of_name(grids) > 1 {
                name += &format!("[{}]", of_name(&grids[..number]));
            }
            let (name, file) = (name.as_str(), file.to_str().expect("UTF-8"));
            for filter in ["nearest", "trilinear", "cubic"] {
                let array = sampled(
                    folder.path(),
                    &[file, "--grid", name, "--points", list, "--index", "--filter", filter],
                );
                let channels = if array.shape.len() == 2 { 3 } else { 1 };
                let found: Vec<f64> = match array.values {
                    Values::F32(values) => values.into_iter().map(f64::from).collect(),
                    Values::F64(values) => values,
                };
                assert_eq!(found.len(), channels * points.len());
                for ((found, (expected, _)), point) in found.chunks(channels).zip(&expected).zip(points) {
                    let same = found.iter().zip(expected).all(|(a, b)| a.to_bits() == b.to_bits());
                    assert!(same, "{file}, {name}, {filter} at {point:?}: {found:?}, not {expected:?}");
                }
            }
        }
    }
}

/// Where to compare: in and around leaves of every grid, and at random near and far.
fn indices(file: &Path) -> Vec<[i32; 3]> {
    let mut file = VdbFile::open(File::open(file).expect("a file")).expect("headers");
    let mut points =
        vec![[0; 3], [i32::MIN; 3], [i32::MAX; 3], [i32::MIN, 0, 0], [5000, 10, 10], [-1, -1, 5000]];
    let mut state = 5;
    for number in 0..file.info().grids.len() {
        let tree = file.grid_at(number).expect("a grid").tree;
        macro_rules! corners {
            ($($kind:ident),*) => {
                match &tree {
                    $(vdbake::formats::vdb::AnyTree::$kind(tree) => {
                        let step = tree.leaf_count().div_ceil(60).max(1);
                        tree.leaves().step_by(step).map(|leaf| leaf.origin).collect::<Vec<_>>()
                    })*
                }
            };
        }
        for origin in corners!(Bool, Int32, Int64, Float, Double, Vec3i, Vec3s, Vec3d) {
            for _ in 0..8 {
                points.push(origin.map(|c| {
                    let moved = i64::from(c) + i64::try_from(random(&mut state) % 14).expect("small") - 3;
                    i32::try_from(moved).unwrap_or(c)
                }));
            }
        }
    }
    points
}

#[test]
fn points_and_values_come_in_all_forms() {
    let folder = tempdir().expect("a temporary folder");
    let path = |name: &str| folder.path().join(name);
    write(&path("cone.toml"), CONE);
    let points = [[0.25, 0.5, 0.125], [-0.5, 0.25, 1.5], [9.0, 0.0, 0.0]];
    write(&path("points.csv"), &format!("x,y,z\n# three of them\n\n{}", csv(&points)));
    write(&path("unnamed"), &csv(&points));
    put_npy(&path("double.npy"), Values::F64(points.as_flattened().to_vec()));
    #[allow(clippy::cast_possible_truncation, reason = "exact")]
    put_npy(&path("single.npy"), Values::F32(points.as_flattened().iter().map(|c| *c as f32).collect()));
    fs::copy(path("double.npy"), path("array")).expect("the same folder");

    let expected = stdout(&succeed(folder.path(), &["cone.toml", "--points", "-"], &csv(&points)));
    assert!(expected.ends_with("9.0,0.0,0.0,0.0\n"), "{expected}");
    for name in ["points.csv", "unnamed", "double.npy", "single.npy", "array"] {
        assert_eq!(stdout(&succeed(folder.path(), &["cone.toml", "--points", name], "")), expected, "{name}");
    }

    let values: Vec<f64> = table(&expected).into_iter().map(|(_, value)| value).collect();
    let report = |arguments: &[&str]| -> Value {
        let output = succeed(folder.path(), &[&["cone.toml", "--json"], arguments].concat(), "");
        serde_json::from_slice(&output.stdout).expect("one JSON object and nothing else")
    };
    let json = report(&["--points", "array"]);
    assert_eq!(json["method"], "kernel");
    assert_eq!((&json["points"], &json["out_of_range"]), (&3.into(), &0.into()));
    let found: Vec<f64> =
        json["values"].as_array().expect("values").iter().filter_map(Value::as_f64).collect();
    assert_eq!(found, values);

    succeed(folder.path(), &["cone.toml", "--points", "array", "-o", "out.csv"], "");
    assert_eq!(fs::read_to_string(path("out.csv")).expect("a file"), expected);
    let json = report(&["--points", "array", "-o", "out.npy", "--time", "-0.5"]);
    assert_eq!((&json["output"], &json["values"]), (&"out.npy".into(), &Value::Null));
    assert_eq!(json["time"], -0.5);
    let array = get_npy(&path("out.npy"));
    assert_eq!(array.shape, [3]);
    assert!(
        singles(array).iter().map(|value| f64::from(*value)).zip(&values).all(|(a, b)| (a - b).abs() < 1e-7)
    );
    assert_eq!(report(&["--points", "array", "-o", "exact.npy", "--exact"])["method"], "reference");
    assert!(matches!(get_npy(&path("exact.npy")).values, Values::F64(_)));

    let none = succeed(folder.path(), &["cone.toml", "--points", "-"], "# nothing\n");
    assert_eq!(stdout(&none), "x,y,z,value\n");
}

#[test]
fn numpy_reads_and_writes_the_same_arrays() {
    let folder = tempdir().expect("a temporary folder");
    write(&folder.path().join("cone.toml"), CONE);
    let python = |script: &str| {
        let output = judge("VDBAKE_BPY_PYTHON").current_dir(folder.path()).args(["-c", script]).output();
        let output = output.expect("Python starts");
        assert!(output.status.success(), "{}", stderr(&output));
        stdout(&output)
    };
    python(SAVE);
    let expected = succeed(folder.path(), &["cone.toml", "--points", "f8_little_1.npy"], "").stdout;
    for kind in ["f4", "f8"] {
        for (order, version) in ["little", "big"].into_iter().flat_map(|order| [1, 2, 3].map(|v| (order, v)))
        {
            let name = format!("{kind}_{order}_{version}.npy");
            assert_eq!(
                succeed(folder.path(), &["cone.toml", "--points", &name], "").stdout,
                expected,
                "{name}"
            );
        }
    }
    for (name, part) in [("fortran.npy", "Fortran"), ("whole.npy", "i8")] {
        let output = run(folder.path(), &["cone.toml", "--points", name], "");
        assert_eq!(output.status.code(), Some(3));
        assert!(stderr(&output).contains(part), "{}", stderr(&output));
    }
    succeed(folder.path(), &["cone.toml", "--points", "f8_little_1.npy", "-o", "single.npy", "--quiet"], "");
    succeed(folder.path(), &["cone.toml", "--points", "f8_little_1.npy", "-o", "double.npy", "--exact"], "");
    let found = python(LOAD);
    let lines: Vec<Vec<&str>> = found.lines().map(|line| line.split(' ').collect()).collect();
    assert_eq!([&lines[0][..2], &lines[1][..2]], [["<f4", "2"], ["<f8", "2"]]);
    let expected = [[0.25, 0.5, 0.125], [-0.5, 0.25, 1.5]].map(cone);
    for (line, tolerance) in lines.iter().zip([1e-6, 1e-12]) {
        for (value, expected) in line[2..].iter().zip(expected) {
            assert!((value.parse::<f64>().expect("a number") - expected).abs() < tolerance, "{found}");
        }
    }
}

#[test]
fn vectors_have_three_columns() {
    let folder = tempdir().expect("a temporary folder");
    let file = folder.path().join("gradient.vdb");
    vdb_tool(&["-sphere", "dim=40", "-grad", "-write", file.to_str().expect("UTF-8")]);
    let arguments = ["gradient.vdb", "--points", "-"];
    let output = stdout(&succeed(folder.path(), &arguments, "1,0,0\n0,-1,0\n"));
    let lines: Vec<&str> = output.lines().collect();
    assert_eq!((lines.len(), lines[0]), (3, "x,y,z,value_x,value_y,value_z"));
    // The gradient of the distance to the unit sphere points outward, with length 1; differences of voxels of 0.05.
    for (line, direction) in lines[1..].iter().zip([[1.0, 0.0, 0.0], [0.0, -1.0, 0.0]]) {
        let numbers: Vec<f64> = line.split(',').map(|field| field.parse().expect("a number")).collect();
        assert!(numbers[3..].iter().zip(direction).all(|(a, b): (&f64, f64)| (a - b).abs() < 0.02), "{line}");
    }
    let json = succeed(folder.path(), &["gradient.vdb", "--points", "-", "--json"], "1,0,0\n");
    let json: Value = serde_json::from_slice(&json.stdout).expect("one JSON object");
    assert_eq!(json["values"][0].as_array().map(Vec::len), Some(3));
}

#[test]
fn points_that_are_nowhere_have_the_background_and_are_counted() {
    let folder = tempdir().expect("a temporary folder");
    let scene = write(&folder.path().join("cone.toml"), CONE);
    bake(&scene, folder.path(), &[]);
    let points = "nan,0,0\n0,inf,0\n0.1,0.2,0\n1e300,0,0\n";
    for (arguments, count) in [
        (&["baked.vdb"][..], 3),
        (&["baked.vdb", "--index"], 3),
        (&["cone.toml"], 2),
        (&["cone.toml", "--exact"], 2),
    ] {
        let arguments = [arguments, &["--points", "-"]].concat();
        let output = succeed(folder.path(), &arguments, points);
        let values: Vec<f64> = stdout(&output)
            .lines()
            .skip(1)
            .map(|line| line.rsplit(',').next().and_then(|value| value.parse().ok()).expect("a number"))
            .collect();
        assert_eq!(values.len(), 4);
        assert_eq!([values[0], values[1], values[3]], [0.0; 3], "{arguments:?}");
        assert!(stderr(&output).starts_with(&format!("note: {count} of 4 points")), "{}", stderr(&output));
        assert_eq!(stderr(&succeed(folder.path(), &[&arguments[..], &["--quiet"]].concat(), points)), "");
    }
}

#[test]
fn wrong_arguments_are_2_and_wrong_input_is_3() {
    let folder = tempdir().expect("a temporary folder");
    let scene = write(&folder.path().join("cone.toml"), CONE);
    bake(&scene, folder.path(), &[]);
    write(&folder.path().join("wrong.csv"), "x,y,z\n1,2,3\n1,2\n");
    write(&folder.path().join("wrong.npy"), "\u{93}NUMPY");
    put_npy(&folder.path().join("pairs.npy"), Values::F64(vec![0.0; 6]));
    let mut pairs = fs::read(folder.path().join("pairs.npy")).expect("a file");
    let at = pairs.windows(6).position(|window| window == b"(2, 3)").expect("the shape");
    pairs[at..at + 6].copy_from_slice(b"(3, 2)");
    fs::write(folder.path().join("pairs.npy"), pairs).expect("a writable folder");

    for (code, arguments, part) in [
        (2, &["cone.toml"][..], "--points"),
        (2, &["cone.toml", "--points", "-", "--index"], "--index"),
        (2, &["cone.toml", "--points", "-", "--filter", "cubic"], "--filter"),
        (2, &["cone.toml", "--points", "-", "--filter", "quintic"], "quintic"),
        (2, &["cone.toml", "--points", "-", "--grid", "velocity"], "velocity"),
        (2, &["cone.toml", "--points", "-", "--voxel-size", "0"], "--voxel-size"),
        (2, &["cone.toml", "--points", "-", "-o", "out.txt"], ".npy"),
        (2, &["baked.vdb", "--points", "-", "--exact"], "--exact"),
        (2, &["baked.vdb", "--points", "-", "--time", "1"], "--time"),
        (2, &["baked.vdb", "--points", "-", "--resolution", "64"], "--resolution"),
        (2, &["baked.vdb", "--points", "-", "--grid", "velocity"], "density"),
        (3, &["missing.toml", "--points", "-"], "missing.toml"),
        (3, &["cone.toml", "--points", "missing.csv"], "missing.csv"),
        (3, &["cone.toml", "--points", "."], "points from ."),
        (3, &["cone.toml", "--points", "wrong.csv", "-o", "out.csv"], "wrong.csv: line 3: "),
        (3, &["cone.toml", "--points", "wrong.npy", "-o", "out.npy"], "not an .npy file"),
        (3, &["cone.toml", "--points", "pairs.npy"], "(N, 3)"),
        (1, &["baked.vdb", "--points", "-", "--memory", "1kB"], "memory"),
        (1, &["cone.toml", "--points", "-", "--memory", "1kB"], "voxel"),
        (1, &["cone.toml", "--points", "-", "-o", "nowhere/out.npy"], "nowhere"),
    ] {
        let output = run(folder.path(), arguments, "0,0,0\n");
        assert_eq!(output.status.code(), Some(code), "{arguments:?}: {}", stderr(&output));
        assert!(stderr(&output).contains(part), "{arguments:?}: {}", stderr(&output));
        assert!(output.stdout.is_empty());
    }
    let output = run(folder.path(), &["cone.toml", "--points", "-"], "0,0\n");
    assert_eq!(output.status.code(), Some(3));
    assert!(stderr(&output).contains("standard input: line 1: "), "{}", stderr(&output));
    let mut names: Vec<_> = fs::read_dir(folder.path())
        .expect("a folder")
        .map(|entry| entry.expect("an entry").file_name())
        .collect();
    names.sort();
    assert_eq!(names, ["baked.vdb", "cone.toml", "pairs.npy", "wrong.csv", "wrong.npy"]);
}

/// A file with a grid of each of these names, of one voxel at the origin with the grid's number.
fn named(path: &Path, names: &[&str]) -> Vec<u8> {
    let grids: Vec<_> = (0_u8..)
        .zip(names)
        .map(|(number, name)| {
            let mut grid = VdbGridBuilder::new(Compression::Zip);
            let mut run = EncodedBricks::default();
            run.push(grid.encoder(), [0; 3], &[1, 0, 0, 0, 0, 0, 0, 0], &[f32::from(number); 512]);
            grid.append(&run).expect("sorted");
            let header = GridHeader {
                name: (*name).to_owned(),
                class: GridClass::FogVolume,
                vector_type: VectorType::Invariant,
                voxel_size: 0.5,
                translation: [0.0; 3],
                metadata: Metadata::new(),
            };
            (header, grid)
        })
        .collect();
    let header = FileHeader { uuid: uuid::Uuid::nil(), metadata: Metadata::new() };
    let grids: Vec<(&GridHeader, &dyn WriteGrid)> =
        grids.iter().map(|(header, grid)| (header, grid as &dyn WriteGrid)).collect();
    let mut bytes = vec![];
    vdb::write(&mut bytes, &header, &grids).expect("valid grids");
    fs::write(path, &bytes).expect("a writable folder");
    bytes
}

fn find(bytes: &[u8], text: &[u8]) -> Vec<usize> {
    (0..bytes.len()).filter(|at| bytes[*at..].starts_with(text)).collect()
}

#[test]
fn grids_behind_an_unknown_one_are_told_to_be_out_of_reach() {
    let folder = tempdir().expect("a temporary folder");
    let path = folder.path().join("file.vdb");
    let mut bytes = named(&path, &["before", "unknown", "after", "last"]);
    let grids = find(&bytes, b"Tree_float_5_4_3");
    bytes[20] = 0;
    for at in &grids {
        bytes[at + 20..at + 44].fill(0);
    }
    let info = |arguments: &[&str]| {
        let output = vdbake().arg("info").arg(&path).args(arguments).output().expect("the program starts");
        assert!(output.status.success(), "{}", stderr(&output));
        stdout(&output)
    };
    let json = || serde_json::from_str::<Value>(&info(&["--json"])).expect("one JSON object");
    fs::write(&path, &bytes).expect("a writable folder");
    assert!(json()["out_of_reach"] == 0 && !info(&[]).contains("out of reach"));
    let sample = |grid: &str| run(folder.path(), &["file.vdb", "--points", "-", "--grid", grid], "0,0,0\n");
    assert_eq!(stdout(&sample("after")), "x,y,z,value\n0.0,0.0,0.0,2.0\n");

    bytes[grids[1] + 5..grids[1] + 10].copy_from_slice(b"point");
    fs::write(&path, &bytes).expect("a writable folder");
    assert_eq!(json()["out_of_reach"], 2);
    assert!(info(&[]).contains("out of reach: 2 grids, behind one"), "{}", info(&[]));
    assert_eq!(stdout(&sample("before")), "x,y,z,value\n0.0,0.0,0.0,0.0\n");
    let output = sample("after");
    assert_eq!(output.status.code(), Some(3));
    let part = "grid \"after\" comes after a grid that is not supported";
    assert!(stderr(&output).contains(part), "{}", stderr(&output));
}

#[test]
fn grids_of_one_name_are_told_apart_by_their_number() {
    let folder = tempdir().expect("a temporary folder");
    let path = folder.path().join("file.vdb");
    let mut bytes = named(&path, &["xx", "yy", "xy"]);
    // Other programs may write what ours does not: grids of one name.
    for at in find(&bytes, b"\x02\0\0\0xy") {
        bytes[at + 5] = b'x';
    }
    fs::write(&path, &bytes).expect("a writable folder");
    let sample = |grid: &[&str]| {
        let arguments = [&["file.vdb", "--points", "-", "--json"], grid].concat();
        run(folder.path(), &arguments, "0,0,0\n")
    };
    for (grid, label, value) in
        [("xx[0]", "xx[0]", 0.0), ("xx[1]", "xx[1]", 2.0), ("yy", "yy", 1.0), ("yy[0]", "yy", 1.0)]
    {
        let output = sample(&["--grid", grid]);
        assert!(output.status.success(), "{grid}: {}", stderr(&output));
        let json: Value = serde_json::from_slice(&output.stdout).expect("one JSON object");
        assert_eq!((&json["grid"], &json["values"][0]), (&label.into(), &value.into()));
    }
    for (grid, part) in [
        (&["--grid", "xx"][..], "xx[0], xx[1]"),
        (&["--grid", "xx[2]"], "xx[0], yy, xx[1]"),
        (&["--grid", "xx[-1]"], "xx[0], yy, xx[1]"),
        (&[], "xx[0], yy, xx[1]"),
    ] {
        let output = sample(grid);
        assert_eq!(output.status.code(), Some(2), "{grid:?}");
        assert!(stderr(&output).contains(part), "{grid:?}: {}", stderr(&output));
    }
}
