//! One scene gives one file: for any number of threads, on any processor, in any surroundings.

use std::fs;
use std::path::Path;
use std::process::Command;

use serde_json::Value;
use tempfile::tempdir;

use crate::support::{COMPRESSIONS, FORMS, SOLID, scenes, stderr, vdbake, write};

/// The bytes that `vdbake`, started as `command` says, bakes a scene to, and its report.
fn bytes(mut command: Command, scene: &Path, folder: &Path, options: &[&str]) -> (Vec<u8>, Value) {
    let path = folder.join("baked.vdb");
    command.arg("bake").arg(scene).arg("-o").arg(&path).args(["--resolution", "64", "--json", "--quiet"]);
    let output = command.args(options).output().expect("the program starts");
    assert!(output.status.success(), "{}: {}", scene.display(), stderr(&output));
    let report = serde_json::from_slice(&output.stdout).expect("one JSON object");
    (fs::read(path).expect("a readable file"), report)
}

#[test]
fn threads_do_not_matter() {
    let folder = tempdir().expect("a temporary folder");
    for (number, scene) in scenes().into_iter().enumerate() {
        // Every codec on the first, and each of the others with one of them.
        for compression in COMPRESSIONS.iter().skip(number % 3).take(if number == 0 { 3 } else { 1 }) {
            let with = |threads| {
                bytes(vdbake(), &scene, folder.path(), &["--compression", compression, "--threads", threads])
                    .0
            };
            let one = with("1");
            for threads in ["2", "7"] {
                assert!(with(threads) == one, "{} {compression}, {threads} threads", scene.display());
            }
        }
    }
}

/// QEMU shows the whole program, the C library and the codecs included, another processor: its features, and results by
/// QEMU's own arithmetic where this machine's processor has none such. The oldest one has no conversion to half precision.
#[test]
#[cfg(target_arch = "x86_64")]
fn processors_do_not_matter() {
    let folder = tempdir().expect("a temporary folder");
    let mut scenes = scenes();
    scenes.insert(0, write(&folder.path().join("solid.toml"), SOLID));
    for (number, scene) in scenes.into_iter().enumerate() {
        // Four forms of the first, which has tiles, and each of the others in one of them.
        for options in FORMS.iter().skip(number % 4).take(if number == 0 { 4 } else { 1 }) {
            let (here, _) = bytes(vdbake(), &scene, folder.path(), options);
            for (processor, simd) in [("Conroe", "sse2"), ("Nehalem", "sse4_2"), ("max", "avx2")] {
                let mut emulated = crate::oracle::judge("VDBAKE_QEMU");
                emulated.args(["-cpu", processor, env!("CARGO_BIN_EXE_vdbake")]);
                let (there, report) = bytes(emulated, &scene, folder.path(), options);
                assert_eq!(report["simd"], simd);
                assert!(there == here, "{} {options:?} on {processor}", scene.display());
            }
        }
    }
}

#[test]
fn surroundings_do_not_matter() {
    let folder = tempdir().expect("a temporary folder");
    let elsewhere = tempdir().expect("a temporary folder");
    let scene = &scenes()[0];
    let (here, _) = bytes(vdbake(), scene, folder.path(), &[]);
    let moved = elsewhere.path().join("renamed.toml");
    fs::copy(scene, &moved).expect("a writable folder");
    let mut other = vdbake();
    other.current_dir(elsewhere.path()).env_clear();
    other.envs([
        ("LANG", "tr_TR.UTF-8"),
        ("LC_ALL", "de_DE.UTF-8"),
        ("TZ", "Pacific/Kiritimati"),
        ("HOME", "/"),
    ]);
    let (there, _) = bytes(other, &moved, elsewhere.path(), &["--memory", "100MB"]);
    assert!(there == here);
}
