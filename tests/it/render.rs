//! `vdbake render`: its pictures as OpenImageIO reads them, of scenes and of files, ours and others'.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use serde_json::Value;
use tempfile::tempdir;

use crate::oracle::exr_dump;
use crate::support::{stderr, stdout, vdbake, write};

const SIZE: [&str; 2] = ["--size", "120x80"];

fn render(arguments: &[&str]) -> Result<Value, String> {
    let output =
        vdbake().arg("render").args(arguments).args(["--json", "--quiet"]).output().expect("it starts");
    if output.status.success() {
        Ok(serde_json::from_str(&stdout(&output)).expect("one JSON object"))
    } else {
        Err(format!("{} {}", output.status.code().unwrap_or(-1), stderr(&output)))
    }
}

fn text(path: &Path) -> &str {
    path.to_str().expect("a plain path")
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
    let (of_scene, of_file) = (folder.path().join("scene.exr"), folder.path().join("file.exr"));
    let report = render(&[&[text(&scene), "-o", text(&of_scene), "--resolution", "200"][..], &SIZE].concat())
        .expect("a picture");
    assert_eq!((report["kind"].as_str(), report["samples"].as_u64()), (Some("scene"), Some(1)));
    // With the camera and lights of the scene that the file carries.
    let report = render(&[&[text(&baked), "-o", text(&of_file)][..], &SIZE].concat()).expect("a picture");
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
    for name in ["G", "transmittance.Y"] {
        let squares = scene[name].iter().zip(&file[name]).map(|(a, b)| f64::from(a - b) * f64::from(a - b));
        let rms = mean(squares).sqrt() / if name == "G" { peak } else { 1.0 };
        // What linear interpolation between voxels changes at this resolution.
        assert!(rms < 1.2e-2, "{name}: {rms}");
        assert!(rms > 1e-6, "the two are not the same field");
    }
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
        (&[file, "-o", image, "--memory", "10kB"], "3 error: cannot read"),
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
