//! Where files appear, and that they appear whole or not at all.

use std::fs;
use std::path::Path;
use std::process::{Command, Output};

use tempfile::tempdir;

use crate::support::{SOLID, scenes, stderr, vdbake, write};

const DONE: i32 = 0;
const FAILED: i32 = 1;
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
    shell.args(["-c", "ulimit -f 1; exec \"$@\"", "bash"]).arg(full.get_program()).args(full.get_args());
    let output = run(&mut shell);
    assert_eq!(output.status.code(), Some(FAILED), "{}", stderr(&output));
    intact();
}
