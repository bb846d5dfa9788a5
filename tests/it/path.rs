//! Pictures by random paths, and by exact shadows, from the command line.

use std::fs;
use std::path::Path;
use std::process::Command;

use serde_json::Value;
use tempfile::tempdir;

use crate::oracle::{exr_dump, judge};
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

/// A tube that scatters forwards in the light of a sun and of the sky, and one that scatters backwards, in colours of its own, in
/// that of a lamp beside it.
const LIT: [&str; 2] = [
    "extinction = 12.0\nalbedo = 0.9\nanisotropy = 0.3\n\
     [[light]]\nkind = \"sun\"\ndirection = [1, 1, -1]\n[[light]]\nkind = \"ambient\"\nradiance = 0.2\n",
    "extinction = 25.0\nalbedo = [0.97, 0.8, 0.5]\nanisotropy = -0.4\n\
     [[light]]\nkind = \"point\"\nposition = [0.6, -1.5, 0.8]\nintensity = [3.0, 5.0, 4.0]\n",
];

/// Mitsuba's `volpath` finds the same light in the same voxels: 64 x 48 pixels of some 0.2 relative noise each, of which a tenth
/// see the medium, so that both means are good to half of a part in a hundred.
#[test]
fn mitsuba_finds_the_same_light() {
    let folder = tempdir().expect("a folder");
    let path = |name: &str| folder.path().join(name);
    let run = |command: &mut Command| {
        let output = command.output().expect("the program starts");
        assert!(output.status.success(), "{}", stderr(&output));
    };
    let size = ["--size", "64x48", "--samples", "48"];
    for (number, medium) in LIT.into_iter().enumerate() {
        let scene = write(
            &path("scene.toml"),
            &format!(
                "[[tube]]\ncurve = {{ kind = \"quadratic\", points = [[0, 0, -1], [0.5, 0, 0], [0, 0, 1]] }}\nradius = 0.5\n\
                 [[tube.layer]]\nop = \"multiply\"\nnoise = \"perlin\"\nfrequency = [2, 2, 5]\nthreshold = -0.3\n\
                 [medium]\n{medium}"
            ),
        );
        let (baked, vol) = (path("a.vdb"), path("a.vol"));
        run(vdbake().arg("bake").arg(&scene).arg("-o").arg(&baked).args(["--resolution", "64", "--quiet"]));
        run(vdbake().arg("convert").arg(&baked).arg(&vol).arg("--quiet"));
        run(vdbake()
            .arg("render")
            .arg(&baked)
            .arg("-o")
            .arg(path("own.exr"))
            .arg("--scene")
            .arg(&scene)
            .args(size)
            .args(["--integrator", "path", "--quiet"]));
        let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("scripts/mitsuba_render.py");
        run(judge("VDBAKE_MITSUBA_PYTHON")
            .arg(script)
            .arg(&vol)
            .args(["--vdbake", env!("CARGO_BIN_EXE_vdbake"), "--max-depth", "200"])
            .arg("--scene")
            .arg(&scene)
            .arg("-o")
            .arg(path("other.exr"))
            .args(size));
        // The means of red, green and blue.
        let [own, other] = ["own.exr", "other.exr"].map(|name| {
            let (report, pixels) = exr_dump(&path(name));
            let names: Vec<String> =
                serde_json::from_value(report["parts"][0]["channels"].clone()).expect("names");
            ["R", "G", "B"].map(|name| {
                let at = names.iter().position(|channel| channel == name).expect("a colour");
                pixels[0].iter().skip(at).step_by(names.len()).map(|light| f64::from(*light)).sum::<f64>()
            })
        });
        for (own, other) in own.into_iter().zip(other) {
            assert!(own > 0.0 && (own - other).abs() < 0.02 * other, "{number}: {own}, not {other}");
        }
    }
}
