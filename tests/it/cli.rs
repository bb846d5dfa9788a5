//! What scripts and other people's pipelines rely on: exit codes, streams, and files that appear whole or not at all.

use std::fs;
use std::path::Path;
use std::process::{Command, Output};

use serde_json::Value;
use tempfile::tempdir;

use crate::support::{SOLID, scenes, stderr, stdout, vdbake, write};

const DONE: i32 = 0;
const FAILED: i32 = 1;
const USAGE: i32 = 2;
const INVALID: i32 = 3;

fn run(command: &mut Command) -> Output {
    command.output().expect("the program starts")
}

fn bake(scene: &Path, output: &Path) -> Command {
    let mut command = vdbake();
    command.arg("bake").arg(scene).arg("-o").arg(output).args(["--resolution", "32"]);
    command
}

fn names(folder: &Path) -> Vec<String> {
    let entries = fs::read_dir(folder).expect("a readable folder");
    let mut names: Vec<_> =
        entries.map(|entry| entry.expect("an entry").file_name().to_string_lossy().into_owned()).collect();
    names.sort();
    names
}

#[test]
fn help_and_version_are_no_errors() {
    for arguments in [&["--help"][..], &["--version"], &["bake", "--help"]] {
        let output = run(vdbake().args(arguments));
        assert_eq!(output.status.code(), Some(DONE), "{arguments:?}");
        assert!(stdout(&output).contains("vdbake"), "{arguments:?}");
    }
}

#[test]
fn wrong_usage_exits_with_2() {
    let scene = scenes().remove(0);
    let scene = scene.to_str().expect("a path of plain text");
    for arguments in [
        &[][..],
        &["boke", scene],
        &["bake"],
        &["bake", scene, scene],
        &["bake", scene, "--resolution", "0"],
        &["bake", scene, "--resolution", "-3"],
        &["bake", scene, "--resolution", "many"],
        &["bake", scene, "--voxel-size", "0"],
        &["bake", scene, "--voxel-size", "-1"],
        &["bake", scene, "--voxel-size", "nan"],
        &["bake", scene, "--voxel-size", "inf"],
        &["bake", scene, "--voxel-size", "0.1", "--resolution", "10"],
        &["bake", scene, "--compression", "best"],
        &["bake", scene, "--threads", "none"],
        &["bake", scene, "--unheard-of"],
    ] {
        let folder = tempdir().expect("a temporary folder");
        let output = run(vdbake().current_dir(folder.path()).args(arguments));
        assert_eq!(output.status.code(), Some(USAGE), "{arguments:?}: {}", stderr(&output));
        assert!(!output.stderr.is_empty() && output.stdout.is_empty(), "{arguments:?}");
        assert!(names(folder.path()).is_empty(), "{arguments:?}");
    }
}

#[test]
fn an_invalid_scene_exits_with_3_and_says_where() {
    let folder = tempdir().expect("a temporary folder");
    let target = folder.path().join("out.vdb");
    for (text, place, hint) in [
        (SOLID.replace("radius", "radios"), ":5:1", "radius"),
        (SOLID.replace("radius = 1", "radius = -1"), ":5:10", "radius"),
        (SOLID.replace("radius = 1", "radius = "), ":5:", ""),
    ] {
        let scene = write(&folder.path().join("scene.toml"), &text);
        let output = run(bake(&scene, &target).arg("--json"));
        let message = stderr(&output);
        assert_eq!(output.status.code(), Some(INVALID), "{message}");
        assert!(
            message.contains(&format!("scene.toml{place}")) && message.contains(hint),
            "{place}: {message}"
        );
        assert!(output.stdout.is_empty());
        assert_eq!(names(folder.path()), ["scene.toml"]);
    }
}

#[test]
fn an_unreadable_scene_exits_with_3_and_names_it() {
    let folder = tempdir().expect("a temporary folder");
    let target = folder.path().join("out.vdb");
    let missing = folder.path().join("missing.toml");
    let binary = folder.path().join("binary.toml");
    fs::write(&binary, [0xff, 0xfe, 0x00]).expect("a writable folder");
    for (scene, name) in [(missing.as_path(), "missing.toml"), (&binary, "binary.toml"), (folder.path(), "")]
    {
        let output = run(&mut bake(scene, &target));
        assert_eq!(output.status.code(), Some(INVALID), "{name}: {}", stderr(&output));
        assert!(stderr(&output).contains(name), "{}", stderr(&output));
        assert!(!target.exists());
    }
}

#[test]
fn json_is_all_there_is_on_stdout() {
    let folder = tempdir().expect("a temporary folder");
    let target = folder.path().join("out.vdb");
    let output = run(bake(&scenes()[0], &target).args(["--json", "--quiet", "--threads", "2"]));
    assert_eq!(output.status.code(), Some(DONE));
    assert_eq!(stderr(&output), "");
    let report: Value = serde_json::from_slice(&output.stdout).expect("one JSON object");
    assert_eq!(report["output"].as_str(), target.to_str());
    assert_eq!(report["threads"], 2);
    for key in
        ["voxel_size", "active_voxels", "leaves", "tiles", "searched_voxels", "bytes", "peak_rss_bytes"]
    {
        assert!(report[key].is_number(), "{key}: {report}");
    }
    for phase in ["plan", "evaluate", "encode", "write", "total"] {
        for clock in ["seconds", "cpu_seconds"] {
            assert!(report[clock][phase].is_number(), "{clock} {phase}: {report}");
        }
    }
    assert!(report["simd"].is_string());
    assert!(report["left_out"].is_array());
    assert!(report.get("mass_ratio").is_some_and(|ratio| ratio.is_number() || ratio.is_null()));
}

#[test]
fn progress_is_plain_lines_where_there_is_no_terminal() {
    let folder = tempdir().expect("a temporary folder");
    let output = run(&mut bake(&scenes()[0], &folder.path().join("out.vdb")));
    let message = stderr(&output);
    assert_eq!(output.status.code(), Some(DONE), "{message}");
    let percentages: Vec<f64> = message
        .lines()
        .filter_map(|line| line.strip_prefix("Progress: ")?.strip_suffix('%'))
        .map(|number| number.parse().expect("a percentage"))
        .collect();
    assert_eq!(percentages.last(), Some(&100.0), "{message}");
    assert!(percentages.is_sorted(), "{message}");
    assert!(!message.contains('\u{1b}') && !message.contains('\r'), "{message}");
}

#[test]
fn without_o_the_scene_names_the_file() {
    let folder = tempdir().expect("a temporary folder");
    let scene = write(&folder.path().join("other.toml"), SOLID);
    let output =
        run(vdbake().current_dir(folder.path()).arg("bake").arg(&scene).args(["--resolution", "16"]));
    assert_eq!(output.status.code(), Some(DONE), "{}", stderr(&output));
    assert_eq!(names(folder.path()), ["other.toml", "solid.vdb"]);
}

#[test]
fn an_unwritable_target_leaves_nothing_behind() {
    let folder = tempdir().expect("a temporary folder");
    let file = write(&folder.path().join("file"), "no folder");
    let in_the_way = folder.path().join("folder.vdb");
    fs::create_dir(&in_the_way).expect("a writable folder");
    for target in [folder.path().join("missing/out.vdb"), file.join("out.vdb"), in_the_way] {
        let output = run(&mut bake(&scenes()[0], &target));
        assert_eq!(output.status.code(), Some(FAILED), "{}: {}", target.display(), stderr(&output));
        let named = target.parent().and_then(Path::to_str).expect("a path of plain text");
        assert!(stderr(&output).contains(named), "{}", stderr(&output));
        assert_eq!(names(folder.path()), ["file", "folder.vdb"]);
    }
}

#[test]
fn a_failed_bake_leaves_the_older_file() {
    let folder = tempdir().expect("a temporary folder");
    let target = write(&folder.path().join("out.vdb"), "older");
    let intact = || {
        assert_eq!(names(folder.path()), ["out.vdb"]);
        assert_eq!(fs::read(&target).expect("a readable file"), b"older");
    };

    let elsewhere = tempdir().expect("a temporary folder");
    let invalid = write(&elsewhere.path().join("scene.toml"), "tube = 3");
    assert_eq!(run(&mut bake(&invalid, &target)).status.code(), Some(INVALID));
    intact();

    // As on a full disk: no file may grow beyond one block.
    let full = bake(&scenes()[0], &target);
    let mut shell = Command::new("bash");
    shell
        .args(["-c", "trap '' XFSZ; ulimit -f 1; exec \"$@\"", "bash"])
        .arg(full.get_program())
        .args(full.get_args());
    let output = run(&mut shell);
    assert_eq!(output.status.code(), Some(FAILED), "{}", stderr(&output));
    intact();
}

#[test]
fn a_finished_bake_replaces_the_older_file() {
    let folder = tempdir().expect("a temporary folder");
    let target = write(&folder.path().join("out.vdb"), "older");
    let output = run(&mut bake(&scenes()[0], &target));
    assert_eq!(output.status.code(), Some(DONE), "{}", stderr(&output));
    assert_eq!(names(folder.path()), ["out.vdb"]);
    assert_ne!(fs::read(&target).expect("a readable file"), b"older");
}
