//! Files that a scene names: found beside it, kept in the recipe, and refused where they do not fit.

use std::fs;
use std::path::Path;
use std::process::Output;

use serde_json::Value;
use tempfile::tempdir;

use crate::support::{stderr, vdbake, write};

const SCENE: &str = r#"
name = "loop"
[[tube]]
curve = { kind = "b-spline", closed = true, file = "data/points.csv" }
radius = { file = "data/radius.csv" }
twist = 0.5
[[tube.layer]]
"#;
const POINTS: &str = "x,y,z\n1,0,0\n0,1,0.2\n-1,0,0\n0,-1,0.2\n";
const RADIUS: &str = "l,radius\n0,0.2\n0.25,0.3\n0.5,0.2\n0.75,0.1\n1,0.2\n";

/// The scene with its files in `folder`.
fn scene(folder: &Path) -> std::path::PathBuf {
    fs::create_dir_all(folder.join("data")).expect("a folder");
    write(&folder.join("data/points.csv"), POINTS);
    write(&folder.join("data/radius.csv"), RADIUS);
    write(&folder.join("loop.toml"), SCENE)
}

/// Runs in a folder other than the scene's.
fn run(command: &str, scene: &Path, options: &[&str]) -> Output {
    let mut run = vdbake();
    run.current_dir(std::env::temp_dir()).arg(command).arg(scene).args(options);
    run.output().expect("the program starts")
}

fn json(output: &Output) -> Value {
    assert!(output.status.success(), "{}", stderr(output));
    serde_json::from_slice(&output.stdout).expect("one JSON object on stdout")
}

#[test]
fn files_are_found_beside_the_scene_and_kept_in_the_recipe() {
    let folder = tempdir().expect("a temporary folder");
    let scene = scene(folder.path());
    let file = folder.path().join("out.vdb");
    let bake = || {
        let options = ["-o", file.to_str().expect("plain"), "--resolution", "24", "--json"];
        json(&run("bake", &scene, &options))
    };
    let first = bake();
    let metadata = json(&run("info", &file, &["--json"]))["metadata"].to_string();
    // By sha256sum, of the points above.
    for part in ["a78e2bb679f3311b8432c522099bc3aa56f50d0d5877e3a373ae8614d748e027", "data/radius.csv"] {
        assert!(metadata.contains(part), "{part} is not in {metadata}");
    }
    assert_eq!(bake()["uuid"], first["uuid"]);
    write(&folder.path().join("data/points.csv"), &POINTS.replace("0.2", "0.3"));
    let other = bake();
    assert_ne!(other["uuid"], first["uuid"]);
    assert_ne!(other["content_hash"], first["content_hash"]);
    // Every second radius is 0.2; those between are off by 0.1.
    let error = &first["sampling_errors"][0];
    assert_eq!(error["tube"], "tube 1");
    assert!((error["radius"].as_f64().expect("a number") - 0.1).abs() < 1e-12, "{error}");
}

#[test]
fn what_is_hardly_meant_is_told_at_its_place() {
    let folder = tempdir().expect("a temporary folder");
    let scene = scene(folder.path());
    for command in ["info", "plan"] {
        let output = run(command, &scene, &[]);
        assert!(output.status.success(), "{}", stderr(&output));
        let text = stderr(&output);
        assert!(
            text.contains("warning: a seam where the curve closes") && text.contains("loop.toml:6:9"),
            "{text}"
        );
        assert!(!stderr(&run(command, &scene, &["--quiet"])).contains("warning"));
        let warnings = json(&run(command, &scene, &["--json"]))["warnings"].clone();
        assert!(
            warnings[0].as_str().is_some_and(|text| text.starts_with("line 6, column 9: a seam")),
            "{warnings}"
        );
    }
    let info = json(&run("info", &scene, &["--json"]));
    assert_eq!((&info["tubes"][0]["closed"], &info["tubes"][0]["caps"]), (&true.into(), &"none".into()));
    assert_eq!(info["inputs"][1]["path"], "data/radius.csv");
}

#[test]
fn files_that_cannot_be_read_are_faults_of_the_scene() {
    let folder = tempdir().expect("a temporary folder");
    let scene = scene(folder.path());
    let told = |part: &str| {
        let output = run("plan", &scene, &[]);
        assert_eq!(output.status.code(), Some(3), "{}", stderr(&output));
        let text = stderr(&output);
        assert!(text.contains("loop.toml:4:52") && text.contains(part), "{text}");
    };
    let points = folder.path().join("data/points.csv");
    write(&points, "x,y,z\n1,0\n");
    told("data/points.csv, line 2: expected 3 numbers, x,y,z, found 2");
    fs::remove_file(&points).expect("a file");
    told("unreadable `file`");
    fs::create_dir(&points).expect("a folder");
    told("it is no file");
}

/// Whoever sends a file chose the names in it.
#[test]
fn recipes_name_files_beside_or_below_theirs() {
    let folder = tempdir().expect("a temporary folder");
    let scene = scene(&folder.path().join("one"));
    let absolute = folder.path().join("one/data/points.csv");
    let absolute = absolute.to_str().expect("plain");
    let text = SCENE.replace("data/radius", "../one/data/radius");
    for (name, points) in [("climbing", "../one/data/points.csv"), ("absolute", absolute)] {
        let scene = scene.with_file_name(format!("{name}.toml"));
        write(&scene, &text.replace("data/points.csv", points));
        let file = folder.path().join("one/out.vdb");
        let to = ["-o", file.to_str().expect("plain"), "--resolution", "16", "--quiet"];
        assert!(run("bake", &scene, &to).status.success());
        let told = run("verify", &file, &[]);
        assert_eq!(told.status.code(), Some(3), "{}", stderr(&told));
        assert!(stderr(&told).contains("--inputs"), "{}", stderr(&told));
        let output = run("info", &file, &["--json"]);
        assert!(json(&output)["view"].is_null() && stderr(&output).contains("beside or below"));
        let picture = folder.path().join("out.png");
        let options = ["-o", picture.to_str().expect("plain"), "--size", "8x8"];
        let output = run("render", &file, &options);
        assert!(output.status.success() && stderr(&output).contains("are made up"), "{}", stderr(&output));
        let data = scene.with_file_name("data");
        let verify = || run("verify", &file, &["--inputs", data.to_str().expect("plain")]);
        let output = verify();
        assert!(output.status.success(), "{}", stderr(&output));
        // Of a file that the recipe does not know, nothing is told.
        write(&data.join("points.csv"), "root:x:0:0\n");
        let output = verify();
        assert_eq!(output.status.code(), Some(4), "{}", stderr(&output));
        assert!(!stderr(&output).contains("root"), "{}", stderr(&output));
        write(&data.join("points.csv"), POINTS);
    }
}
