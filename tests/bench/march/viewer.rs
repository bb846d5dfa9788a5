//! Pictures of one file by this program and by OpenVDB's own viewer.

use std::path::Path;
use std::process::Command;

use exr::prelude::read_first_rgba_layer_from_file;
use serde_json::Value;

use crate::table::{Table, median};
use crate::{Options, ROUNDS, exponent};

/// What is drawn: its name, extinction, albedo 4/5, and the camera.
const LOOKS: [(&str, f64, [f64; 3], [f64; 3]); 2] =
    [("dense", 20.0, [1.2, -5.5, 1.5], [0.12, 0.15, 1.1]), ("thin", 2.5, [0.3, -5.0, 1.2], [0.1, 0.0, 1.2])];

pub(crate) fn viewer(options: &Options) -> Table {
    let mut table = Table::new(&["what", "by", "seconds", "over_vdb_render", "error"]);
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("tornado.vdb");
    let scene = format!("{}/scenes/tornado.toml", env!("CARGO_MANIFEST_DIR"));
    let mut bake = vdbake();
    run(bake.args(["bake", &scene, "--quiet", "--resolution", "512", "-o"]).arg(&file));
    let size = format!("{}x{}", options.size[0], options.size[1]);
    for (name, extinction, eye, at) in LOOKS {
        let look = folder.path().join("look.toml");
        std::fs::write(&look, own(extinction, eye, at)).expect("room");
        let picture = |name: &str| folder.path().join(name);
        let theirs = |image: &Path, more: &[&str]| {
            let triple = |[x, y, z]: [f64; 3]| format!("{x},{y},{z}");
            let mut command = Command::new("vdb_render");
            command
                .arg(&file)
                .arg(image)
                .args(["-res", &size, "-fov", "44.8", "-up", "0,0,1", "-cpus", "0", "-v"]);
            command.args([
                "-absorb",
                &triple([0.2 * extinction; 3]),
                "-scatter",
                &triple([0.8 * extinction; 3]),
            ]);
            command.args(["-translate", &triple(eye), "-lookat", &triple(at)]).args(more);
            let output = run(&mut command);
            let traced =
                output.split("ray-tracing").nth(1).and_then(|text| text.split("completed in").nth(1));
            let seconds = traced.and_then(|text| text.split_whitespace().next());
            seconds.and_then(|text| text.parse::<f64>().ok()).expect("it says how long it took")
        };
        let ours = |image: &Path, more: &[&str]| -> Value {
            let mut command = vdbake();
            command.arg("render").arg(&file).arg("-o").arg(image).arg("--scene").arg(&look);
            command.args(["--size", &size, "--background", "0", "--json", "--quiet"]).args(more);
            serde_json::from_str(&run(&mut command)).expect("one object")
        };
        let rows: [(&str, &[&str], &[&str]); 3] = [
            ("vdbake", &[], &["prepare", "march"]),
            ("vdbake, --step 2", &["--step", "2"], &["prepare", "march"]),
            ("vdbake, first of --progressive", &["--progressive"], &["coarse"]),
        ];
        let mut times = [const { vec![] }; 4];
        for _ in 0..ROUNDS {
            times[0].push(theirs(&picture("theirs.exr"), &[]));
            for (number, (_, more, parts)) in rows.iter().enumerate() {
                let seconds = &ours(&picture("ours.png"), more)["seconds"];
                times[number + 1].push(parts.iter().filter_map(|part| seconds[part].as_f64()).sum());
            }
        }
        let [whole, finest, coarse] = ["whole.exr", "finest.exr", "coarse.exr"].map(picture);
        theirs(&finest, &["-step", "0.1", "-shadowstep", "0.25", "-cutoff", "1e-6"]);
        let their_error = error(&picture("theirs.exr"), &finest);
        ours(&finest, &["--shadow", "exact", "--cutoff", "1e-9"]);
        ours(&whole, &[]);
        ours(&coarse, &["--step", "2"]);
        let errors = [
            exponent(their_error),
            exponent(error(&whole, &finest)),
            exponent(error(&coarse, &finest)),
            Value::Null,
        ];
        let by = ["vdb_render"].into_iter().chain(rows.map(|(by, ..)| by));
        let times = times.map(median);
        for ((by, time), error) in by.zip(times).zip(errors) {
            table.push(vec![name.into(), by.into(), time.into(), (time / times[0]).into(), error]);
        }
    }
    table
}

fn vdbake() -> Command {
    Command::new(env!("CARGO_BIN_EXE_vdbake"))
}

/// What a program prints, if it ends well.
fn run(command: &mut Command) -> String {
    let output = command.output().unwrap_or_else(|error| panic!("{command:?}: {error}: see scripts/oracles"));
    let text = [output.stdout, output.stderr].map(|text| String::from_utf8_lossy(&text).into_owned());
    assert!(output.status.success(), "{command:?}: {}", text.concat());
    text.concat()
}

/// A scene with the viewer's camera, and its lamp: light that goes along (-0.3, -0.3, 0).
fn own(extinction: f64, eye: [f64; 3], at: [f64; 3]) -> String {
    format!(
        "[medium]\nextinction = {extinction}\nalbedo = 0.8\n[camera]\nposition = {eye:?}\nlook_at = {at:?}\nfov = 44.8\n\
         [[light]]\nkind = \"sun\"\ndirection = [-0.3, -0.3, -0.0001]\n"
    )
}

/// Root mean square of the difference in red, green and blue, over that of the truth.
fn error(found: &Path, truth: &Path) -> f64 {
    let [found, truth] = [found, truth].map(colours);
    assert_eq!(found.len(), truth.len());
    let square = |x: f64| x * x;
    let wrong: f64 = found.iter().zip(&truth).map(|(a, b)| square(f64::from(a - b))).sum();
    let all: f64 = truth.iter().map(|x| square(f64::from(*x))).sum();
    (wrong / all).sqrt()
}

fn colours(image: &Path) -> Vec<f32> {
    let read = read_first_rgba_layer_from_file(
        image,
        |size, _| (size.width(), vec![0.0; 3 * size.area()]),
        |(width, pixels): &mut (usize, Vec<f32>), at, (red, green, blue, _): (f32, f32, f32, f32)| {
            let first = 3 * (at.y() * *width + at.x());
            pixels[first..first + 3].copy_from_slice(&[red, green, blue]);
        },
    );
    read.expect("a picture").layer_data.channel_data.pixels.1
}
