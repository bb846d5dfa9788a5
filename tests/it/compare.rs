//! `vdbake compare`: scenes, files and images whose differences are known.

use std::io::Cursor;

use serde_json::Value;
use vdbake::formats::exr::{self, Part, Samples};
use vdbake::formats::png;

use crate::cli::{Folder, code, errors, text};

/// A straight tube whose density is smooth and without octaves, so that it is the same at every voxel size.
const SMOOTH: &str = "[bake]\nwiden = false\n[[tube]]\nradius = 0.5\n\
    curve = { points = [[0, 0, -1], [0.4, 0, 0], [0, 0, 1]] }\n";

fn real(value: &Value) -> f64 {
    value.as_f64().unwrap_or_else(|| panic!("{value} is no number"))
}

/// A folder with the smooth tube and its bakes at these resolutions, `NUMBER.vdb`.
fn baked(resolutions: &[u32]) -> Folder {
    let folder = Folder::new();
    folder.put("smooth.toml", SMOOTH);
    for resolution in resolutions {
        let (resolution, file) = (resolution.to_string(), format!("{resolution}.vdb"));
        let output = folder.run(&["bake", "smooth.toml", "-o", &file, "--resolution", &resolution]);
        assert!(output.status.success(), "{}", errors(&output));
    }
    folder
}

#[test]
fn a_file_is_itself() {
    let folder = baked(&[32]);
    for filter in ["nearest", "trilinear", "cubic"] {
        let found = folder.json(&["compare", "32.vdb", "32.vdb", "--filter", filter, "--tolerance", "0"]);
        for part in ["l1", "l2", "max", "p999", "bias"] {
            assert_eq!(real(&found["errors"][part]["absolute"]), 0.0);
            assert_eq!(real(&found["errors"][part]["of_rms"]), 0.0);
        }
        assert_eq!((real(&found["mass"]["ratio"]), &found["errors"]["psnr"]), (1.0, &Value::Null));
        assert_eq!(real(&found["optical_depth"]["max"]["absolute"]), 0.0);
        assert_eq!(
            (&found["voxels"]["differ"], &found["voxels"]["topology_equal"]),
            (&0.into(), &true.into())
        );
        assert_eq!((&found["tolerance"]["holds"], &found["a"]["method"]), (&true.into(), &filter.into()));
        assert_eq!(found["points"], 200_000);
    }
    let found = folder.json(&["compare", "smooth.toml", "smooth.toml", "--points", "5000"]);
    assert_eq!((real(&found["errors"]["max"]["absolute"]), &found["voxels"]), (0.0, &Value::Null));
}

#[test]
fn a_bake_comes_nearer_with_the_square_of_the_voxel_size() {
    let folder = baked(&[32, 64, 128]);
    let found = ["32.vdb", "64.vdb", "128.vdb"].map(|file| {
        let found = folder.json(&["compare", "smooth.toml", file, "--resolution", "128"]);
        // Mass is kept: a midpoint rule for a smooth density. It is known as well as the points tell.
        let ratio = &found["mass"]["ratio_interval"];
        assert!(real(&ratio[0]) < 1.003 && real(&ratio[1]) > 0.997, "{file} {ratio}");
        ["l1", "l2"]
            .map(|part| {
                let scaled = &found["errors"][part];
                let held = &found["intervals"][part];
                let absolute = real(&scaled["absolute"]);
                assert!(real(&held[0]) <= absolute && absolute <= real(&held[1]));
                real(&scaled["of_rms"])
            })
            .map(f64::abs)
            .into_iter()
            .chain([real(&found["optical_depth"]["l2"]["of_rms"])])
            .collect::<Vec<f64>>()
    });
    for (coarse, fine) in [(&found[0], &found[1]), (&found[1], &found[2])] {
        for (coarse, fine) in coarse.iter().zip(fine) {
            // Linear interpolation is of order 2 where the density is smooth; at the surface its second derivative jumps, and the
            // bricks around it are of another size at each voxel size.
            let order = libm::log2(coarse / fine);
            assert!((1.7..2.4).contains(&order), "{found:?}");
        }
    }
    assert!(found[2][1] < 2e-3, "{found:?}");
}

#[test]
fn precision_and_a_shift_are_noticed() {
    let folder = baked(&[48]);
    let output =
        folder.run(&["bake", "smooth.toml", "-o", "half.vdb", "--resolution", "48", "--precision", "f16"]);
    assert!(output.status.success());
    let found = folder.json(&["compare", "48.vdb", "half.vdb"]);
    let voxels = &found["voxels"];
    assert_eq!((&voxels["topology_equal"], &voxels["not_finite"]), (&true.into(), &0.into()));
    // Half a unit in the last of eleven digits, of a density of at most 1.
    let max = real(&voxels["max"]);
    assert!(max > 0.0 && max <= 1.0 / 4096.0 && real(&found["errors"]["max"]["absolute"]) <= max, "{max}");
    assert!((real(&voxels["mass_ratio"]) - 1.0).abs() < 1e-4);

    // Half a voxel to the side, on the same lattice: 2 m are 48 voxels and a little.
    let h = real(&folder.json(&["plan", "smooth.toml", "--resolution", "48"])["voxel_size"]);
    let shift = 0.5 * h;
    let moved = SMOOTH.replace(
        "[[0, 0, -1], [0.4, 0, 0], [0, 0, 1]]",
        &format!("[[{shift}, 0, -1], [{}, 0, 0], [{shift}, 0, 1]]", 0.4 + shift),
    );
    folder.put("moved.toml", moved);
    let size = h.to_string();
    let output = folder.run(&["bake", "moved.toml", "-o", "moved.vdb", "--voxel-size", &size]);
    assert!(output.status.success(), "{}", errors(&output));
    let found = folder.json(&["compare", "48.vdb", "moved.vdb"]);
    // The slope over the density's root mean square is some 3 a radius, which is 12 voxels.
    let relative = real(&found["errors"]["l2"]["of_rms"]);
    assert!((0.05..0.2).contains(&relative), "{relative}");
    assert_eq!(found["voxels"]["topology_equal"], false);
    assert!((real(&found["mass"]["ratio"]) - 1.0).abs() < 0.01);
}

#[test]
fn figures_are_the_same_with_any_number_of_threads() {
    let folder = baked(&[40]);
    let run = |threads: &str| {
        let arguments = [
            "compare",
            "smooth.toml",
            "40.vdb",
            "--points",
            "20000",
            "--rays",
            "100",
            "--json",
            "--threads",
            threads,
        ];
        text(&folder.run(&arguments))
    };
    assert!(!run("1").is_empty());
    assert_eq!(run("1"), run("3"));
}

#[test]
fn a_tolerance_decides_the_exit_code() {
    let folder = baked(&[24]);
    let common = ["compare", "smooth.toml", "24.vdb", "--points", "20000"];
    let run = |more: &[&str]| folder.run(&[&common[..], more].concat());
    assert_eq!(code(&run(&["--tolerance", "0.5"])), 0);
    for metric in ["l1", "l2", "max", "bias", "p999", "mass", "optical-depth"] {
        assert_eq!(code(&run(&["--tolerance", "0.5", "--metric", metric])), 0, "{metric}");
        let failed = run(&["--tolerance", "0", "--metric", metric]);
        assert_eq!(code(&failed), 4, "{metric}");
        assert!(errors(&failed).contains("above the tolerance of 0"), "{}", errors(&failed));
        // The figures are told all the same.
        assert!(text(&failed).contains("does not hold") && text(&failed).contains("optical depth"));
    }
    let json = run(&["--tolerance", "1e-9", "--json"]);
    let report: Value = serde_json::from_slice(&json.stdout).expect("one JSON object");
    assert_eq!((code(&json), &report["tolerance"]["holds"]), (4, &false.into()));
    assert_eq!(report["tolerance"]["metric"], "relative L2");
}

#[test]
fn what_makes_no_sense_is_refused() {
    let folder = baked(&[16]);
    folder.put("image.exr", image(&[("Y", vec![0.0; 4])], [2, 2]));
    folder.put("wide.exr", image(&[("Y", vec![0.0; 4])], [4, 1]));
    folder.put("depth.exr", image(&[("Z", vec![0.0; 4])], [2, 2]));
    folder.put("broken.exr", "v/1\u{1}nothing");
    folder.put("broken.png", "nothing");
    for (arguments, expected, message) in [
        (&["16.vdb", "image.exr"][..], 2, "only be compared with an image"),
        (&["16.vdb", "16.vdb", "--layer", "a"], 2, "--layer has no meaning for scenes and files"),
        (&["16.vdb", "16.vdb", "--time", "1"], 2, "--time has no meaning for files"),
        (&["16.vdb", "16.vdb", "--grid", "x"], 2, "no grid \"x\""),
        (&["smooth.toml", "smooth.toml", "--filter", "cubic"], 2, "--filter has no meaning for scenes"),
        (&["smooth.toml", "smooth.toml", "--grid", "x"], 2, "a scene has no grid \"x\""),
        (&["image.exr", "image.exr", "--points", "9"], 2, "--points has no meaning for images"),
        (&["image.exr", "image.exr", "--layer", "x"], 2, "has no layer \"x\""),
        (&["image.exr", "wide.exr"], 1, "image.exr has 2 x 2 pixels\nhint: wide.exr has 4 x 1 pixels"),
        (&["image.exr", "depth.exr"], 1, "without a channel of one name"),
        (&["image.exr", "image.exr", "--difference", "x.jpg"], 2, "neither .exr nor .png"),
        (&["image.exr", "image.exr", "--difference", "x.exr", "--map", "flip"], 2, "--map has no meaning"),
        (&["depth.exr", "16.vdb"], 2, "only be compared with an image"),
        (
            &["image.exr", "image.exr", "--tolerance", "1", "--metric", "mass"],
            2,
            "--metric mass has no meaning",
        ),
        (&["16.vdb", "16.vdb", "--tolerance", "1", "--metric", "flip"], 2, "--metric flip has no meaning"),
        (&["16.vdb", "16.vdb", "--metric", "l1"], 2, "--tolerance"),
        (&["16.vdb", "16.vdb", "--tolerance", "-1"], 2, "at least 0"),
        (&["16.vdb", "16.vdb", "--points", "0"], 2, "from 1 to 100000000"),
        (&["broken.exr", "image.exr"], 3, "cannot read broken.exr"),
        (&["image.exr", "broken.png"], 3, "cannot read broken.png"),
        (&["none.vdb", "16.vdb"], 3, "cannot read none.vdb"),
        (&["16.vdb", "16.vdb", "--memory", "20MiB"], 1, "--memory"),
        (&["image.exr", "image.exr", "--memory", "16MiB"], 3, "--memory"),
    ] {
        let output = folder.run(&[&["compare"], arguments].concat());
        assert_eq!(code(&output), expected, "{arguments:?}: {}", errors(&output));
        assert!(errors(&output).contains(message), "{arguments:?}: {}", errors(&output));
        assert!(output.stdout.is_empty());
    }
    assert!(!folder.path("x.exr").exists());
}

/// An EXR image of one part.
fn image(channels: &[(&str, Vec<f32>)], pixels: [usize; 2]) -> Vec<u8> {
    let channels = channels.iter().map(|(name, values)| (*name, Samples::F32(values.clone()))).collect();
    let part = Part { name: "image".to_owned(), pixels, channels, attribute: String::new() };
    let mut out = Cursor::new(Vec::new());
    exr::write(vec![part], &mut out).expect("an image");
    out.into_inner()
}

#[test]
fn images_with_known_differences() {
    let folder = Folder::new();
    let ramp = |add: f32| (0..64_u8).map(|n| f32::from(n) / 64.0 + add).collect::<Vec<f32>>();
    let channels = |add: f32| [("B", ramp(0.0)), ("G", ramp(0.0)), ("R", ramp(add)), ("albedo.R", ramp(add))];
    folder.put("a.exr", image(&channels(0.0), [8, 8]));
    // A multiple of the ramp's step, so that all of it is exact.
    folder.put("b.exr", image(&channels(0.125), [8, 8]));
    let found = folder.json(&["compare", "a.exr", "b.exr", "--difference", "d.exr"]);
    assert_eq!((&found["kind"], &found["pixels"]), (&"images".into(), &serde_json::json!([8, 8])));
    let red = &found["channels"][2];
    assert_eq!((&red["name"], real(&red["l2"]["absolute"])), (&"R".into(), 0.125));
    assert_eq!((real(&red["bias"]["absolute"]), real(&red["p999"]["absolute"])), (0.125, 0.125));
    // Two of four channels differ.
    assert_eq!(real(&found["all"]["l1"]["absolute"]), 0.0625);
    let flip = real(&found["flip"]["mean"]);
    assert!(
        flip > 0.05 && flip < 0.5 && found["flip"]["channels"] == serde_json::json!(["R", "G", "B"]),
        "{flip}"
    );
    let parts = exr::read(Cursor::new(folder.get("d.exr")), 1 << 20).expect("an image");
    assert_eq!(parts[0].channels[0], ("B".to_owned(), Samples::F32(vec![0.0; 64])));
    assert_eq!(parts[0].channels[2], ("R".to_owned(), Samples::F32(vec![0.125; 64])));

    let layer = folder.json(&["compare", "a.exr", "b.exr", "--layer", "albedo"]);
    assert_eq!(layer["channels"].as_array().map(Vec::len), Some(1));
    assert_eq!(real(&layer["all"]["l2"]["absolute"]), 0.125);
    let same = folder.json(&["compare", "b.exr", "b.exr", "--tolerance", "0", "--metric", "flip"]);
    assert_eq!((real(&same["flip"]["max"]), real(&same["all"]["rel_mse"])), (0.0, 0.0));
    assert_eq!(code(&folder.run(&["compare", "a.exr", "b.exr", "--tolerance", "0.0884"])), 0);
    // The root mean square of all is 0.125 / sqrt(2) = 0.08839.
    assert_eq!(code(&folder.run(&["compare", "a.exr", "b.exr", "--tolerance", "0.0883"])), 4);
}

#[test]
fn pictures_and_maps_of_their_difference() {
    let folder = Folder::new();
    let put = |name: &str, pixels: &[[u8; 3]]| {
        let mut out = Vec::new();
        png::write([16, 16], pixels, &mut out).expect("a picture");
        folder.put(name, out);
    };
    put("black.png", &[[0; 3]; 256]);
    put("white.png", &[[255; 3]; 256]);
    let found = folder.json(&["compare", "black.png", "white.png", "--difference", "map.png"]);
    assert_eq!((real(&found["all"]["l2"]["absolute"]), real(&found["all"]["psnr"])), (1.0, 0.0));
    // As the paper's remapping has it: see the tests of the metric.
    assert!((real(&found["flip"]["mean"]) - 0.9674).abs() < 1e-4);
    let map = png::read(Cursor::new(folder.get("map.png")), 1 << 20).expect("a picture");
    // Bright.
    assert!(
        map.size == [16, 16]
            && map.channels.iter().take(2).all(|(_, values)| values.iter().all(|v| *v > 0.8))
    );
    let back = folder.json(&["compare", "white.png", "black.png"]);
    assert_eq!(back["flip"], found["flip"]);
    folder.json(&["compare", "black.png", "white.png", "--difference", "map.png", "--map", "absolute"]);

    // A picture beside the linear image that it shows.
    let grey = (0..=255).map(|n| [n; 3]).collect::<Vec<[u8; 3]>>();
    put("grey.png", &grey);
    let linear = |code: u8| {
        let code = f64::from(code) / 255.0;
        if code <= 0.04045 { code / 12.92 } else { libm::pow((code + 0.055) / 1.055, 2.4) }
    };
    #[allow(clippy::cast_possible_truncation, reason = "to single precision")]
    let values = (0..=255).map(|code| linear(code) as f32).collect::<Vec<f32>>();
    folder.put("grey.exr", image(&[("Y", values)], [16, 16]));
    let found = folder.json(&["compare", "grey.exr", "grey.png", "--tolerance", "1e-6"]);
    assert_eq!((&found["a"]["values"], &found["b"]["values"]), (&"linear".into(), &"linear".into()));
}

/// What `flip-evaluator` 1.7, the implementation of the paper's authors, finds in the same pictures.
#[test]
fn flip_is_that_of_its_authors() {
    let folder = Folder::new();
    let put = |name: &str, pixel: fn(usize, usize) -> [usize; 3]| {
        let pixels: Vec<[u8; 3]> = (0..24 * 32)
            .map(|n| pixel(n % 32, n / 32).map(|code| u8::try_from(code % 256).expect("a byte")))
            .collect();
        let mut out = Vec::new();
        png::write([32, 24], &pixels, &mut out).expect("a picture");
        folder.put(name, out);
    };
    put("a.png", |x, y| [x * 8, y * 10, (x + y) * 4]);
    put("b.png", |x, y| [x * 8 + x / 4 % 2 * 24, y * 10, (x * 3 + y) * 4]);
    for (per_degree, mean, max) in [("67", 0.500_867, 0.966_517), ("20", 0.551_646, 0.972_024)] {
        let found = folder.json(&["compare", "a.png", "b.png", "--pixels-per-degree", per_degree]);
        // It works in single precision, of which differences of features, where they are small, are the square root.
        assert!((real(&found["flip"]["mean"]) - mean).abs() < 5e-5, "{}", found["flip"]);
        assert!((real(&found["flip"]["max"]) - max).abs() < 5e-6, "{}", found["flip"]);
    }
}

#[test]
fn values_that_are_no_numbers_fail_a_tolerance() {
    let folder = Folder::new();
    folder.put("a.exr", image(&[("Y", vec![1.0, 2.0, f32::NAN, 4.0])], [2, 2]));
    folder.put("b.exr", image(&[("Y", vec![1.0, 2.0, 3.0, f32::INFINITY])], [2, 2]));
    let output = folder.run(&["compare", "a.exr", "b.exr", "--tolerance", "1"]);
    assert_eq!(code(&output), 4);
    assert!(errors(&output).contains("2 values of A and B, NaN or infinite"), "{}", errors(&output));
    assert!(text(&output).contains("1 values of A, 1 of B"), "{}", text(&output));
}

#[test]
fn channels_without_numbers_are_named_beside_layers_to_choose() {
    let folder = Folder::new();
    let of = |depth: f32| {
        let finite = vec![0.5; 4];
        image(
            &[
                ("R", finite.clone()),
                ("depth.Z", vec![1.0, 2.0, 3.0, depth]),
                ("opticalDepth.Y", finite.clone()),
                ("transmittance.Y", finite),
            ],
            [2, 2],
        )
    };
    folder.put("a.exr", of(4.0));
    folder.put("b.exr", of(f32::INFINITY));
    let run =
        |layer: &[&str]| folder.run(&[&["compare", "a.exr", "b.exr", "--tolerance", "0"], layer].concat());
    let all = run(&[]);
    assert_eq!(code(&all), 4);
    let told = errors(&all);
    assert!(told.contains("1 value of A and B, NaN or infinite\nhint: they are in depth.Z\n"), "{told}");
    assert!(told.contains("--layer") && told.ends_with("finite in opticalDepth, transmittance\n"), "{told}");
    assert_eq!(code(&run(&["--layer", "transmittance"])), 0);
    // There is nothing else to choose.
    let depth = run(&["--layer", "depth"]);
    assert!(code(&depth) == 4 && !errors(&depth).contains("--layer"), "{}", errors(&depth));
    // What is a number but too far off is no matter of layers.
    folder.put("b.exr", of(5.0));
    let far = run(&[]);
    assert!(code(&far) == 4 && !errors(&far).contains("hint"), "{}", errors(&far));
}
