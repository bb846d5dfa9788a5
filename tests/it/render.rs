//! `vdbake render`: its pictures as OpenImageIO reads them, of scenes and of files, ours and others'.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use serde_json::Value;
use tempfile::tempdir;

use crate::oracle::exr_dump;
use crate::support::{json, stderr, text, vdbake, write};

const SIZE: [&str; 2] = ["--size", "120x80"];

fn render(arguments: &[&str]) -> Result<Value, String> {
    json("render", arguments)
}

fn tornado() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/tornado.toml")
}

fn bake(folder: &Path, resolution: &str) -> PathBuf {
    let path = folder.join("baked.vdb");
    let mut command = vdbake();
    command.arg("bake").arg(tornado()).arg("-o").arg(&path).args(["--quiet", "--resolution", resolution]);
    let output = command.output().expect("it starts");
    assert!(output.status.success(), "{}", stderr(&output));
    path
}

/// The channels of a picture by their names.
fn channels(image: &Path) -> BTreeMap<String, Vec<f32>> {
    let (dump, pixels) = exr_dump(image);
    let names: Vec<String> = serde_json::from_value(dump["parts"][0]["channels"].clone()).expect("names");
    let count = names.len();
    let channel = |at: usize| pixels[0].iter().skip(at).step_by(count).copied().collect();
    names.iter().enumerate().map(|(at, name)| (name.clone(), channel(at))).collect()
}

fn mean(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) = values.fold((0.0, 0.0), |(sum, count), value| (sum + value, count + 1.0));
    sum / count
}

#[test]
fn a_file_and_its_scene_look_alike() {
    let folder = tempdir().expect("a folder");
    let scene = tornado();
    let baked = bake(folder.path(), "200");
    let report = json("plan", &[text(&scene), "--resolution", "200"]).expect("a plan");
    let voxel_size = report["voxel_size"].as_f64().expect("a number");
    let (of_scene, of_file) = (folder.path().join("scene.exr"), folder.path().join("file.exr"));
    let report = render(&[&[text(&scene), "-o", text(&of_scene), "--resolution", "200"][..], &SIZE].concat())
        .expect("a picture");
    assert_eq!((report["kind"].as_str(), report["samples"].as_u64()), (Some("scene"), Some(1)));
    // With the camera and lights of the scene that the file carries, and shadows as of the scene.
    let cells = ["--method", "cells"];
    let report =
        render(&[&[text(&baked), "-o", text(&of_file)][..], &SIZE, &cells].concat()).expect("a picture");
    assert_eq!(report["kind"].as_str(), Some("file"));
    let [scene, file] = [&of_scene, &of_file].map(|image| channels(image));
    let expected = [
        "A",
        "B",
        "G",
        "R",
        "depth.Z",
        "normal.X",
        "normal.Y",
        "normal.Z",
        "opticalDepth.Y",
        "transmittance.Y",
    ];
    assert_eq!(scene.keys().collect::<Vec<_>>(), expected);
    let peak = f64::from(scene["G"].iter().copied().fold(0.0, f32::max));
    let apart = |file: &BTreeMap<String, Vec<f32>>, name: &str| {
        let squares = scene[name].iter().zip(&file[name]).map(|(a, b)| f64::from(a - b) * f64::from(a - b));
        mean(squares).sqrt() / if name == "G" { peak } else { 1.0 }
    };
    // There is no closed form of what linear interpolation between voxels changes. The bound lies between that and what half a
    // voxel does: a camera that is shifted by so much sees too little of a likeness.
    let half = 0.5 * voxel_size;
    let shifted = write(
        &folder.path().join("shifted.toml"),
        &fs::read_to_string(tornado())
            .expect("a scene")
            .replace("[0, -5.2, 1.5]", &format!("[{half}, {}, {}]", -5.2 + half, 1.5 + half))
            .replace("look_at = [0, 0, 1.25]", &format!("look_at = [{half}, {half}, {}]", 1.25 + half)),
    );
    let beside = folder.path().join("beside.exr");
    render(&[&[text(&baked), "-o", text(&beside), "--scene", text(&shifted)][..], &SIZE, &cells].concat())
        .expect("a picture");
    let beside = channels(&beside);
    for name in ["G", "transmittance.Y"] {
        let rms = apart(&file, name);
        assert!(rms < 1.2e-2, "{name}: {rms}");
        assert!(rms > 1e-6, "the two are not the same field");
        assert!(apart(&beside, name) > 1.5 * rms, "{name}");
    }
    let rms = apart(&beside, "transmittance.Y");
    assert!(rms > 1.5 * 1.2e-2, "{rms}");
    // By planes, too: what is hidden of the scene, and the colours of shadows that are exact, nearer than those of cells.
    let draw = |name: &str, options: &[&str]| {
        let image = folder.path().join(name);
        render(&[&[text(&baked), "-o", text(&image)][..], &SIZE, options].concat()).expect("a picture");
        channels(&image)
    };
    let (planes, exact) = (draw("planes.exr", &[]), draw("exact.exr", &["--shadow", "exact"]));
    let rms = apart(&planes, "transmittance.Y");
    assert!(rms < 1.2e-2 && apart(&beside, "transmittance.Y") > 1.5 * rms, "{rms}");
    let [planes, cells] = [&planes, &file].map(|image| {
        let squares = exact["G"].iter().zip(&image["G"]).map(|(a, b)| f64::from(a - b) * f64::from(a - b));
        mean(squares).sqrt()
    });
    assert!(planes < cells, "{planes} and {cells} off the colours of exact shadows");
    for (channel, values) in &scene {
        assert!(values.iter().all(|value| channel == "depth.Z" || value.is_finite()), "{channel}");
    }
    // Alpha is what the medium hides, and the normals of what is seen are of length 1.
    let hidden = scene["A"].iter().zip(&scene["transmittance.Y"]);
    assert!(hidden.clone().all(|(alpha, through)| (alpha + through - 1.0).abs() < 1e-6));
    let normals = ["normal.X", "normal.Y", "normal.Z"].map(|name| &scene[name]);
    let mut seen = 0;
    for pixel in 0..scene["A"].len() {
        let length = normals.iter().map(|part| part[pixel] * part[pixel]).sum::<f32>().sqrt();
        if scene["depth.Z"][pixel].is_finite() {
            assert!((length - 1.0).abs() < 1e-5 || length == 0.0);
            seen += usize::from(length > 0.0);
        } else {
            assert!(length.abs() < 1e-6);
        }
    }
    assert!(seen > 100, "{seen} pixels have a normal");
}

#[test]
fn coarser_voxels_hold_as_much() {
    let folder = tempdir().expect("a folder");
    let baked = bake(folder.path(), "200");
    let image = folder.path().join("picture.exr");
    let depths = |step: &str| {
        // Rays that go through everything.
        let options = ["-o", text(&image), "--step", step, "--absorption-only", "--cutoff", "1e-30"];
        render(&[&[text(&baked)][..], &options, &SIZE].concat()).expect("a picture");
        channels(&image)["opticalDepth.Y"].clone()
    };
    let fine = depths("1");
    for (step, apart) in [("2", 1.0), ("4", 2.0), ("8", 4.0)] {
        let coarse = depths(step);
        // All of it is seen, but near places weigh more: an error of order 2 in the edge of a cell, of which a third of this was
        // found.
        let [all, found] = [&fine, &coarse].map(|depths| depths.iter().map(|x| f64::from(*x)).sum::<f64>());
        assert!((found / all - 1.0).abs() < 2e-3 * apart * apart, "{step}: {found}, not {all}");
        // Where it is, from left to right: half of a coarse voxel is `apart` fine ones, each about half of a pixel.
        let middle = |depths: &[f32], all: f64| {
            let columns = depths.iter().enumerate().map(|(at, x)| f64::from(*x) * (at % 120) as f64);
            columns.sum::<f64>() / all
        };
        let shift = middle(&coarse, found) - middle(&fine, all);
        assert!(shift.abs() < 0.1 * apart, "{step}: {shift} pixels");
    }
}

#[test]
fn pictures_are_the_same_bytes_on_any_number_of_threads() {
    let folder = tempdir().expect("a folder");
    let baked = bake(folder.path(), "100");
    for input in [&tornado(), &baked] {
        let mut first = None;
        for threads in ["1", "2", "5"] {
            let image = folder.path().join("same.exr");
            let options = ["-o", text(&image), "--threads", threads, "--samples", "3"];
            render(&[&[text(input)][..], &options, &SIZE].concat()).expect("a picture");
            let bytes = fs::read(&image).expect("a file");
            assert!(*first.get_or_insert_with(|| bytes.clone()) == bytes, "{threads} threads");
        }
    }
}

#[test]
fn pictures_to_look_at_have_their_background() {
    let folder = tempdir().expect("a folder");
    let baked = bake(folder.path(), "64");
    let image = folder.path().join("picture.png");
    let pixels = |options: &[&str]| {
        let arguments = [&[text(&baked), "-o", text(&image)][..], &SIZE, options].concat();
        let report = render(&arguments).expect("a picture");
        let mut reader = png::Decoder::new(std::io::BufReader::new(fs::File::open(&image).expect("a file")))
            .read_info()
            .expect("a PNG");
        let mut bytes = vec![0; reader.output_buffer_size().expect("small")];
        reader.next_frame(&mut bytes).expect("pixels");
        assert_eq!(bytes.len(), 120 * 80 * 4);
        (report, bytes)
    };
    let (_, clear) = pixels(&[]);
    assert_eq!(clear[3], 0, "the corner is transparent");
    assert!(clear.iter().skip(3).step_by(4).any(|alpha| *alpha > 200));
    let (report, opaque) = pixels(&["--background", "0.5,0.25,1", "--exposure", "-1"]);
    assert!(opaque.iter().skip(3).step_by(4).all(|alpha| *alpha == 255));
    assert_eq!(report["exposure"].as_f64(), Some(-1.0));
    // Half a stop less than these, as sRGB has them: 0.25, 0.125 and 0.5.
    assert_eq!(opaque[..3], [137, 99, 188]);
    let (report, _) = pixels(&["--progressive", "--samples", "2"]);
    assert!(report["first_picture_seconds"].as_f64().is_some_and(|seconds| seconds > 0.0));
}

#[test]
fn volumes_of_other_programs_are_drawn() {
    let folder = tempdir().expect("a folder");
    // A ball of radius 1 m: OpenVDB's own fog volume, whose density grows from 0 at its surface to 1 inside, over the half
    // width of the level set; and the level set itself.
    for (name, options, radius) in [
        ("fog", &["-sphere", "dim=128", "radius=1", "-ls2fog"][..], 1.0 - 1.5 * 2.0 / 128.0),
        ("surface", &["-sphere", "dim=128", "radius=1"][..], 1.0),
    ] {
        let file = folder.path().join(format!("{name}.vdb"));
        let output =
            Command::new("vdb_tool").args(options).arg("-write").arg(&file).output().expect("vdb_tool");
        assert!(output.status.success(), "{}", stderr(&output));
        let scene = write(
            &folder.path().join("view.toml"),
            "[medium]\nextinction = 1.0\n[camera]\nkind = 'orthographic'\nposition = [0, -5, 0]\nlook_at = [0, 0, 0]\nwidth = 2.4\n",
        );
        let image = folder.path().join("picture.exr");
        let options = ["-o", text(&image), "--scene", text(&scene), "--size", "48x48", "--cutoff", "1e-6"];
        render(&[&[text(&file)][..], &options].concat()).expect("a picture");
        let depths = &channels(&image)["opticalDepth.Y"];
        let mut compared = 0;
        for (pixel, depth) in depths.iter().enumerate() {
            let [x, y] = [pixel % 48, pixel / 48].map(|c| f64::from(u8::try_from(c).expect("small")));
            let [x, y] = [x, y].map(|c| ((c + 0.5) / 48.0 * 2.0 - 1.0) * 1.2);
            let b2 = x * x + y * y;
            let chord = 2.0 * (radius * radius - b2).max(0.0).sqrt();
            // Beside the rim the soft surface tells; a cell is 0.016 m.
            if b2 < 0.8 {
                assert!((f64::from(*depth) - chord).abs() < 0.012, "{name} {pixel}: {depth}, not {chord}");
                compared += 1;
            } else if b2 > 1.1 {
                assert!(*depth == 0.0);
            }
        }
        assert!(compared > 500);
    }
}

/// A scene with one tube, drawn in white light that nothing absorbs.
fn draw_tube(folder: &Path, more: &str, options: &[&str]) -> BTreeMap<String, Vec<f32>> {
    let tube = "[[tube]]\ncurve = { points = [[0, 0, -1], [0.1, 0, 0], [0, 0, 1]] }\nradius = 0.5\n";
    let scene = write(&folder.join("tube.toml"), &format!("{tube}{more}"));
    let image = folder.join("tube.exr");
    let arguments =
        [&[text(&scene), "-o", text(&image), "--resolution", "24", "--size", "24x24"][..], options];
    render(&arguments.concat()).expect("a picture");
    channels(&image)
}

/// What does not extinguish is not there but for what glows in it, by either integrator: its radiance is the emission times the
/// density's integral, which a thin medium shows as its optical depth.
#[test]
fn what_only_glows_extinguishes_nothing() {
    let folder = tempdir().expect("a folder");
    let thin = draw_tube(folder.path(), "[medium]\nextinction = 1.0\n", &["--cutoff", "1e-9"]);
    let glow = "[medium]\nextinction = 0\nemission = 2.0\n[[light]]\nirradiance = 1e6\n";
    for integrator in ["single", "path"] {
        let found = draw_tube(folder.path(), glow, &["--integrator", integrator]);
        assert!(found["opticalDepth.Y"].iter().chain(&found["A"]).all(|value| *value == 0.0));
        assert!(found["transmittance.Y"].iter().all(|value| *value == 1.0));
        for (radiance, depth) in found["G"].iter().zip(&thin["opticalDepth.Y"]) {
            // Steps are divided where it is dense only.
            assert!((radiance - 2.0 * depth).abs() < 1e-3, "{integrator}: {radiance}, not 2 x {depth}");
        }
        assert!(found["G"].iter().any(|radiance| *radiance > 0.5));
    }
}

/// A step that is opaque lets nothing through, and has a depth that a number holds.
#[test]
fn opaque_steps_have_a_depth() {
    let folder = tempdir().expect("a folder");
    let found = draw_tube(folder.path(), "[medium]\nextinction = 1e6\n", &["--method", "alpha"]);
    let deepest = found["opticalDepth.Y"].iter().copied().fold(0.0, f32::max);
    assert!((90.0..200.0).contains(&deepest), "{deepest}");
    assert!(found["transmittance.Y"].contains(&0.0));
}

#[test]
fn noise_needs_two_samples() {
    let folder = tempdir().expect("a folder");
    for (samples, has_noise) in [("1", false), ("2", true)] {
        let found = draw_tube(folder.path(), "", &["--integrator", "path", "--samples", samples]);
        assert_eq!(found.contains_key("noise.Y"), has_noise);
        assert!(found.iter().all(|(name, values)| name == "depth.Z" || values.iter().all(|v| v.is_finite())));
    }
}

/// From a thousand million metres away a tube fills the picture as it does in parallel light.
#[test]
fn cameras_far_away_are_framed() {
    let folder = tempdir().expect("a folder");
    let camera =
        |kind: &str| format!("[camera]\nkind = \"{kind}\"\nposition = [0, -1e9, 0]\nlook_at = [0, 0, 0]\n");
    let [far, flat] = ["perspective", "orthographic"]
        .map(|kind| draw_tube(folder.path(), &camera(kind), &["--cutoff", "1e-9"]));
    assert!(flat["opticalDepth.Y"].iter().filter(|depth| **depth > 0.1).count() > 50);
    for (far, flat) in far["opticalDepth.Y"].iter().zip(&flat["opticalDepth.Y"]) {
        // Rays are good to 1e-16 of the distance, 1e-7 m.
        assert!((far - flat).abs() < 1e-3 * (1.0 + flat), "{far}, not {flat}");
    }
}

/// A camera that sees nothing is told of: a picture without anything in it may have been meant otherwise.
#[test]
fn who_looks_elsewhere_is_told() {
    let folder = tempdir().expect("a folder");
    let baked = bake(folder.path(), "32");
    let look = |camera: &str| {
        let scene = write(&folder.path().join("view.toml"), camera);
        let mut command = vdbake();
        command.arg("render").arg(&baked).arg("--scene").arg(scene).args(SIZE);
        let output = command.arg("-o").arg(folder.path().join("a.png")).output().expect("it starts");
        assert!(output.status.success());
        stderr(&output).contains("nothing of")
    };
    assert!(look("[camera]\nposition = [0, -9, 0]\nlook_at = [0, -20, 0]\n"));
    assert!(!look("[camera]\nposition = [0, -9, 1]\nlook_at = [0, 0, 1]\n"));
}

/// Pictures of a medium that no light enters come to an end, and at once where they are told to.
#[test]
fn dense_media_end() {
    let folder = tempdir().expect("a folder");
    let dense =
        "[medium]\nextinction = 1e9\n[[light]]\ndirection = [0, 1, 0]\n[camera]\nposition = [0, -9, 0]\n";
    let started = std::time::Instant::now();
    let by_path = draw_tube(folder.path(), dense, &["--integrator", "path", "--samples", "4"]);
    let limited = ["--integrator", "path", "--time-limit", "0.5"];
    draw_tube(folder.path(), dense, &limited);
    // Ten minutes did not do before; no figure of speed, but a bound that no slow machine comes near.
    assert!(started.elapsed().as_secs() < 120);
    assert!(by_path["G"].iter().any(|light| *light > 0.05));
}

#[test]
fn a_picture_does_not_differ_from_itself_where_there_is_nothing() {
    let folder = tempdir().expect("a folder");
    let image = folder.path().join("same.exr");
    let baked = bake(folder.path(), "32");
    render(&[&[text(&baked), "-o", text(&image)][..], &SIZE].concat()).expect("a picture");
    assert!(channels(&image)["depth.Z"].iter().any(|depth| depth.is_infinite()));
    let mut command = vdbake();
    let output = command
        .args(["compare", text(&image), text(&image), "--tolerance", "0"])
        .output()
        .expect("it starts");
    assert!(output.status.success(), "{}", stderr(&output));
}

#[test]
fn wrong_arguments_are_2_and_wrong_input_is_3() {
    let folder = tempdir().expect("a folder");
    let baked = bake(folder.path(), "32");
    let scene = tornado();
    let image = folder.path().join("a.exr");
    let [file, scene, image] = [&baked, &scene, &image].map(|path| text(path));
    let jpeg = folder.path().join("a.jpeg");
    for (arguments, expected) in [
        (&[scene, "-o", text(&jpeg)][..], "2 error: the output"),
        (&[scene, "-o", image, "--size", "0x5"], "2 error: invalid value '0x5'"),
        (&[scene, "-o", image, "--grid", "density"], "2 error: --grid has no meaning for a scene"),
        (&[scene, "-o", image, "--scene", scene], "2 error: --scene has no meaning for a scene"),
        (&[file, "-o", image, "--resolution", "9"], "2 error: --resolution has no meaning for a file"),
        (&[file, "-o", image, "--grid", "smoke"], "2 error: the file has no grid"),
        (&[file, "-o", image, "--background", "1,2"], "2 error: invalid value '1,2'"),
        (&[file, "-o", text(&folder.path().join("none/a.exr"))], "1 error: there is no folder"),
        (
            &[file, "-o", image, "--step", "3"],
            "2 error: --step 3 has no meaning for a file\nhint: choose 1, 2, 4 or 8",
        ),
        (
            &[file, "-o", image, "--step", "16"],
            "2 error: invalid value '16' for '--step <VOXELS>': expected a number of voxels from 0.01 to 8, and of a file 1, 2, 4 or 8",
        ),
        (&[file, "-o", image, "--map-every", "2"], "2 error: --map-every has no meaning for a file"),
        (&[file, "-o", image, "--memory", "10kB"], "1 error: a picture of"),
        (&[file, "-o", image, "--size", "9x5", "--memory", "16MiB"], "1 error: a picture of"),
        // What the pixels leave is too little for the file.
        (&[file, "-o", image, "--size", "9x5", "--memory", "16800kB"], "1 error: cannot read"),
        (&[file, "-o", image, "--size", "32768x32768", "--memory", "300MB"], "1 error: a picture of"),
    ] {
        let message = render(arguments).expect_err("a failure");
        assert!(message.starts_with(expected), "{arguments:?}: {message}");
        assert!(!Path::new(image).exists());
    }
    let empty = write(&folder.path().join("empty.toml"), "");
    render(&[text(&empty), "-o", image, "--size", "9x5"]).expect("a picture of nothing");
    assert!(channels(Path::new(image))["A"].iter().all(|alpha| *alpha == 0.0));
}
