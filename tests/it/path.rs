//! Pictures by random paths, and by exact shadows, from the command line.

use std::fs;
use std::path::Path;

use serde_json::Value;
use tempfile::tempdir;

use crate::support::{SOLID, stderr, vdbake, write};

/// Draws a small picture of the solid tube; what the program says of it, or its exit code.
fn render(folder: &Path, name: &str, options: &[&str]) -> Result<Value, Option<i32>> {
    let scene = write(
        &folder.join("solid.toml"),
        &format!(
            "{SOLID}[medium]\nextinction = 4.0\nalbedo = 0.8\n[[light]]\nkind = \"sun\"\ndirection = [1, 1, -1]\n"
        ),
    );
    let output = vdbake()
        .arg("render")
        .arg(scene)
        .arg("-o")
        .arg(folder.join(name))
        .args(["--json", "--quiet", "--resolution", "24", "--size", "40x40"])
        .args(options)
        .output()
        .expect("the program starts");
    if output.status.success() {
        return Ok(serde_json::from_slice(&output.stdout).expect("one JSON object on stdout"));
    }
    assert!(!stderr(&output).is_empty());
    Err(output.status.code())
}

#[test]
fn a_picture_by_paths_is_the_same_file_by_any_number_of_threads() {
    let folder = tempdir().expect("a temporary folder");
    let path = ["--integrator", "path", "--samples", "3"];
    let options = |more: &[&'static str]| [&path[..], more].concat();
    let report = render(folder.path(), "a.exr", &options(&["--threads", "1"])).expect("a picture");
    assert_eq!(report["samples"], 3);
    assert!(report["noise"].as_f64().expect("a number") > 0.0);
    render(folder.path(), "b.exr", &options(&["--threads", "3"])).expect("a picture");
    render(folder.path(), "c.exr", &options(&["--seed", "1"])).expect("a picture");
    let read = |name: &str| fs::read(folder.path().join(name)).expect("a file");
    assert_eq!(read("a.exr"), read("b.exr"));
    assert_ne!(read("a.exr"), read("c.exr"));
    let layer = b"noise.Y";
    assert!(read("a.exr").windows(layer.len()).any(|bytes| bytes == layer));
}

#[test]
fn pictures_stop_where_they_are_told_to() {
    let folder = tempdir().expect("a temporary folder");
    let path = ["--integrator", "path"];
    let options = |more: &[&'static str]| [&path[..], more].concat();
    let report = render(folder.path(), "a.exr", &options(&["--noise-limit", "0.2"])).expect("a picture");
    let samples = report["samples"].as_u64().expect("a count");
    assert!(report["noise"].as_f64().expect("a number") <= 0.2 && samples >= 8);
    let again = render(folder.path(), "a.exr", &options(&["--noise-limit", "0.2", "--threads", "1"]));
    assert_eq!(again.expect("a picture")["samples"], samples);
    // The first pass is made in any case.
    let report = render(folder.path(), "a.exr", &options(&["--time-limit", "0"])).expect("a picture");
    assert_eq!((&report["samples"], report["noise"].is_null()), (&Value::from(1), true));
}

#[test]
fn options_without_meaning_are_refused() {
    let folder = tempdir().expect("a temporary folder");
    for options in [
        &["--seed", "1"][..],
        &["--noise-limit", "0.1"],
        &["--integrator", "path", "--shadow", "exact"],
        &["--integrator", "path", "--shadow-step", "1"],
        &["--shadow", "exact", "--shadow-step", "1"],
        &["--integrator", "bidirectional"],
        &["--time-limit", "-1"],
        &["--integrator", "path", "--noise-limit", "0"],
    ] {
        assert_eq!(render(folder.path(), "a.exr", options), Err(Some(2)), "{options:?}");
    }
    let exact = render(folder.path(), "a.exr", &["--shadow", "exact"]).expect("a picture");
    assert!(exact["noise"].is_null());
}
