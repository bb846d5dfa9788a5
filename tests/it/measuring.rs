//! `--memory` is a cap where files are read, too: of `--certify`, `--max-error`, `--max-bytes`, `verify` and `render`. What they
//! find is the same with any.

use serde_json::Value;

use crate::accuracy::{shipped, windowed};
use crate::cli::{Folder, code, errors, number};

/// Runs a command with a cap: what it prints, or the cap that it asks for.
fn run(folder: &Folder, arguments: &[&str], memory: &str) -> Result<Value, String> {
    let output =
        folder.run(&[arguments, &["--threads", "2", "--json", "--quiet", "--memory", memory]].concat());
    let told = errors(&output);
    if code(&output) == 0 {
        return Ok(serde_json::from_slice(&output.stdout).expect("one JSON object"));
    }
    assert_eq!(code(&output), 1, "{arguments:?} {memory}: {told}");
    let named = told.split("--memory ").nth(1).and_then(|rest| rest.split_whitespace().next());
    Err(named.unwrap_or_else(|| panic!("{arguments:?} {memory}: {told}")).to_owned())
}

/// Bytes of an amount such as 20MiB.
pub(crate) fn mebibytes(amount: &str) -> u64 {
    amount.strip_suffix("MiB").and_then(|number| number.parse().ok()).expect("whole MiB")
}

/// Runs a command with a little memory, with what it then asks for, and with more: its peak stays below each, and `made` is the
/// same after all. Gives the least.
fn assert_capped(folder: &Folder, arguments: &[&str], made: impl Fn() -> Vec<u8>) -> u64 {
    let mut least = "14MiB".to_owned();
    // What is asked for may be about enough, and only for what comes next.
    for _ in 0..6 {
        match run(folder, arguments, &least) {
            Ok(_) => break,
            Err(named) => least = named,
        }
    }
    let least = mebibytes(&least);
    let mut first = None;
    for more in [0, 5, 30, 4000] {
        let cap = least + more;
        let report = run(folder, arguments, &format!("{cap}MiB")).expect("more than is enough");
        if cfg!(target_os = "linux") {
            let peak = number(&report["peak_rss_bytes"]);
            assert!(peak <= cap << 20, "{arguments:?}: {peak} bytes within {cap} MiB");
        }
        let found = made();
        assert!(
            *first.get_or_insert_with(|| found.clone()) == found,
            "{arguments:?}: other bytes within {cap} MiB"
        );
    }
    least
}

#[test]
fn certifying_and_verifying_stay_below_the_cap() {
    let folder = Folder::new();
    folder.put("galaxy.toml", shipped("galaxy.toml", &[]));
    folder.put("tornado.toml", shipped("tornado.toml", &[]));
    for (scene, resolution, precision) in [("galaxy.toml", "600", "f32"), ("tornado.toml", "120", "f16")] {
        let bake =
            ["bake", scene, "-o", "a.vdb", "--certify", "--resolution", resolution, "--precision", precision];
        let made = || [folder.get("a.vdb"), folder.get("a.certificate.json")].concat();
        assert_capped(&folder, &bake, made);
        assert_capped(&folder, &["verify", "a.vdb"], Vec::new);
    }
}

#[test]
fn voxel_sizes_are_found_below_the_cap() {
    let folder = Folder::new();
    folder.put("asked.toml", windowed(3));
    for arguments in [
        ["--max-error", "1.5e-3"].as_slice(),
        &["--max-error", "1e-2", "--error-metric", "optical-depth"],
        &["--max-bytes", "6MB"],
    ] {
        let bake = [&["bake", "asked.toml", "-o", "a.vdb"], arguments].concat();
        assert_capped(&folder, &bake, || folder.get("a.vdb"));
    }
}

#[test]
fn pictures_of_files_stay_below_the_cap() {
    let folder = Folder::new();
    folder.put("trefoil.toml", shipped("trefoil.toml", &[]));
    let bake = ["bake", "trefoil.toml", "-o", "a.vdb", "--resolution", "400", "--quiet"];
    assert_eq!(code(&folder.run(&bake)), 0);
    let sun = |n: usize| format!("\n[[light]]\nkind = \"sun\"\ndirection = [{n}, 1, -1]\n");
    let many: String = (1..8).map(sun).collect();
    folder.put("many.toml", shipped("trefoil.toml", &[]) + &many);
    for (scene, options) in [
        ("trefoil.toml", &[][..]),
        ("trefoil.toml", &["--shadow-step", "1"]),
        ("many.toml", &[]),
        ("many.toml", &["--method", "cells"]),
        ("many.toml", &["--step", "2"]),
    ] {
        let render = ["render", "a.vdb", "--scene", scene, "-o", "a.exr", "--size", "64x48"];
        assert_capped(&folder, &[&render[..], options].concat(), || folder.get("a.exr"));
    }
}
