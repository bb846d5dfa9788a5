//! `vdbake slice`: its images as OpenImageIO reads them, beside the voxels of the bake.

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::path::{Path, PathBuf};

use serde_json::Value;
use tempfile::tempdir;
use vdbake::formats::vdb::{
    self, Compression, EncodedBricks, FileHeader, GridClass, GridHeader, Metadata, VdbGridBuilder, VectorType,
};

use crate::oracle::{exr_dump, openvdb_make};
use crate::support::{RESOLUTION, bake, evaluated, scenes_with_tiles, stderr, stdout, text, vdbake, write};

/// Axes to the right and up, and the axis itself, of a slice.
const AXES: [(&str, [usize; 3]); 3] = [("x", [1, 2, 0]), ("y", [0, 2, 1]), ("z", [0, 1, 2])];

fn slice(arguments: &[&str]) -> Result<Value, String> {
    let output =
        vdbake().arg("slice").args(arguments).args(["--json", "--quiet"]).output().expect("it starts");
    if output.status.success() {
        Ok(serde_json::from_str(&stdout(&output)).expect("one JSON object"))
    } else {
        Err(format!("{} {}", output.status.code().unwrap_or(-1), stderr(&output)))
    }
}

/// A scene whose slices across every axis are many.
fn tornado() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/tornado.toml")
}

fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().expect("numbers").iter().map(|number| number.as_f64().expect("a number")).collect()
}

/// That the pixels of a part are the voxels that its attribute places them at: these, and 0 elsewhere. The number of voxels
/// other than 0.
fn compare(
    part: &Value,
    values: &[f32],
    voxels: &BTreeMap<[i32; 3], f32>,
    h: f64,
    axis: [usize; 3],
) -> usize {
    let about = &part["vdbake"];
    let [right, up, across] = axis;
    let width = i32::try_from(part["size"][0].as_i64().expect("a width")).expect("small");
    let first: Vec<i32> = serde_json::from_value(about["first_voxel"].clone()).expect("an index");
    let [pixel, to_right, down] = ["first_pixel", "right", "down"].map(|key| numbers(&about[key]));
    for i in 0..3 {
        // Rounding of a product and a sum.
        assert!((pixel[i] - (f64::from(first[i]) + 0.5) * h).abs() < 1e-12);
        assert_eq!(to_right[i], if i == right { h } else { 0.0 });
        assert_eq!(down[i], if i == up { -h } else { 0.0 });
    }
    assert_eq!(about["index"].as_i64(), Some(i64::from(first[across])));
    let mut found = 0;
    for (pixel, value) in (0..).zip(values) {
        let mut voxel = [first[0], first[1], first[2]];
        voxel[right] += pixel % width;
        voxel[up] -= pixel / width;
        let expected = voxels.get(&voxel).copied().unwrap_or(0.0);
        assert_eq!(value.to_bits(), expected.to_bits(), "{voxel:?}");
        found += usize::from(*value != 0.0);
    }
    found
}

#[test]
fn slices_of_scenes_and_of_their_files_are_the_voxels_of_the_bake() {
    let folder = tempdir().expect("a folder");
    for (number, scene) in scenes_with_tiles(folder.path()).into_iter().enumerate() {
        let baked = bake(&scene, folder.path(), &[]);
        let h = baked.voxel_size;
        let voxels: BTreeMap<[i32; 3], f32> = evaluated(&scene, h).into_iter().collect();
        let (axis, order) = AXES[number % 3];
        for (input, options) in [(&scene, &["--resolution", RESOLUTION][..]), (&baked.path, &[])] {
            let image = folder.path().join("parts.exr");
            let arguments = [&[text(input), "-o", text(&image), "--axis", axis], options].concat();
            let report = slice(&arguments).expect("slices");
            let (dump, pixels) = exr_dump(&image);
            let parts = dump["parts"].as_array().expect("parts");
            assert_eq!(
                (parts.len() as u64, dump["format"].as_str()),
                (report["slices"].as_u64().unwrap_or(0), Some("openexr"))
            );
            let mut found = 0;
            for (plane, (part, values)) in parts.iter().zip(pixels).enumerate() {
                assert_eq!(part["name"], format!("density.{plane:04}"));
                assert_eq!((&part["format"], &part["channels"][0]), (&"float".into(), &"Y".into()));
                assert_eq!(
                    (&part["compression"], &part["origin"]),
                    (&"zip".into(), &serde_json::json!([0, 0]))
                );
                assert_eq!(part["vdbake"]["plane"], plane);
                found += compare(part, &values, &voxels, h, order);
            }
            let expected = voxels.values().filter(|value| **value != 0.0).count();
            assert_eq!(found, expected, "{} across {axis}", input.display());
        }
    }
}

/// The cap is found as a user would: by what is said of those that are too small.
#[test]
fn slices_stay_below_the_cap() {
    let folder = tempdir().expect("a folder");
    let scene = tornado();
    let options = ["--resolution", "500"];
    let baked = folder.path().join("baked.vdb");
    let output =
        vdbake().arg("bake").arg(&scene).args(options).arg("-o").arg(&baked).output().expect("it starts");
    assert!(output.status.success(), "{}", stderr(&output));
    let images = folder.path().join("s.####.exr");
    for (input, options) in [(&scene, &options[..]), (&baked, &[])] {
        for axis in ["x", "z"] {
            let common = ["--axis", axis, "--planes", "90-130", "--threads", "2", "-o", text(&images)];
            let (mut cap, mut told) = ("1MiB".to_owned(), 0);
            let report = loop {
                match slice(&[&[text(input), "--memory", &cap], &common[..], options].concat()) {
                    Ok(report) => break report,
                    Err(message) => {
                        let (_, named) = message.rsplit_once("--memory").expect("a hint");
                        let named = named.split_whitespace().next().unwrap_or_default();
                        // A plan that has no room does not say how much it takes.
                        let doubled = cap.trim_end_matches("MiB").parse::<u64>().expect("MiB") * 2;
                        cap = if named.is_empty() { format!("{doubled}MiB") } else { named.to_owned() };
                    }
                }
                told += 1;
                assert!(told < 10, "{cap}");
            };
            let cap: u64 = cap.trim_end_matches("MiB").parse().expect("MiB");
            let peak = report["peak_rss_bytes"].as_u64().unwrap_or(0);
            assert!(peak <= cap << 20, "{}: {peak} bytes of {cap} MiB", input.display());
            // Values of a layer, not of all, beside the program and what is read of a file at once.
            assert!(cap < 48, "{cap} MiB");
        }
    }
}

#[test]
fn every_layout_holds_the_same_pixels() {
    let folder = tempdir().expect("a folder");
    let scene = tornado();
    let path = |name: &str| folder.path().join(name);
    let common = ["--resolution", "48", "--planes", "3-20x4"];
    let run = |name: &str, more: &[&str]| {
        slice(&[&[text(&scene), "-o", text(&path(name))], &common[..], more].concat()).expect("slices")
    };
    run("parts.exr", &[]);
    let sequence = run("one.####.exr", &[]);
    let atlas = run("atlas.exr", &["--atlas"]);
    let (_, parts) = exr_dump(&path("parts.exr"));
    let outputs = sequence["outputs"].as_array().expect("outputs");
    assert_eq!((outputs.len(), parts.len()), (5, 5));
    for (number, part) in [3, 7, 11, 15, 19].into_iter().zip(&parts) {
        let (dump, pixels) = exr_dump(&path(&format!("one.{number:04}.exr")));
        assert_eq!(pixels, std::slice::from_ref(part));
        assert_eq!(dump["parts"][0]["vdbake"]["plane"], number);
    }
    let (dump, pixels) = exr_dump(&path("atlas.exr"));
    let about = &dump["parts"][0]["vdbake"];
    assert_eq!(
        (&about["planes"], &about["columns"]),
        (&serde_json::json!([3, 7, 11, 15, 19]), &atlas["columns"])
    );
    let number = |value: &Value| usize::try_from(value.as_u64().expect("a number")).expect("small");
    let [width, height] = [0, 1].map(|i| number(&atlas["pixels"][i]));
    let columns = number(&atlas["columns"]);
    for (place, part) in parts.iter().enumerate() {
        for (row, expected) in part.chunks(width).enumerate() {
            let start = (place / columns * height + row) * columns * width + place % columns * width;
            assert_eq!(&pixels[0][start..start + width], expected);
        }
    }
    // The same bytes again.
    let first = fs::read(path("atlas.exr")).expect("a file");
    run("atlas.exr", &["--atlas", "--threads", "1"]);
    assert_eq!(fs::read(path("atlas.exr")).expect("a file"), first);
}

#[test]
fn vectors_and_halves_keep_their_values() {
    let folder = tempdir().expect("a folder");
    let path = folder.path().join("v.vdb");
    let encoder = vdb::Encoder::new(Compression::Blosc).with_precision(vdb::Precision::F16);
    let mut values = vec![[0.0_f32; 3]; 512];
    // (x, y, z) = (1, 2, 3).
    values[(8 + 2) * 8 + 3] = [0.5, -2.0, 0.333_251_95];
    let mut mask = [0; 8];
    mask[1] = 1 << (8 * 2 + 3);
    let mut grid = VdbGridBuilder::with_encoder(encoder);
    let mut run = EncodedBricks::default();
    run.push(encoder, [0; 3], &mask, values.as_slice().try_into().expect("a brick"));
    grid.append(&run).expect("a brick in order");
    let header = GridHeader {
        name: "velocity".to_owned(),
        class: GridClass::Unknown,
        vector_type: VectorType::Invariant,
        voxel_size: 0.5,
        translation: [0.25; 3],
        metadata: Metadata::default(),
    };
    let file = File::create(&path).expect("a file");
    vdb::write(
        file,
        &FileHeader { uuid: uuid::Uuid::nil(), metadata: Metadata::default() },
        &[(&header, &grid)],
    )
    .expect("a file");
    let image = folder.path().join("v.exr");
    slice(&[text(&path), "-o", text(&image)]).expect("slices");
    let (dump, pixels) = exr_dump(&image);
    assert_eq!(dump["parts"][0]["channels"], serde_json::json!(["R", "G", "B"]));
    assert_eq!(dump["parts"][0]["format"], "half");
    assert_eq!(pixels, [vec![0.5, -2.0, 0.333_251_95]]);
    let refused = slice(&[text(&path), "-o", text(&folder.path().join("v.png"))]).expect_err("vectors");
    assert!(refused.contains("a .png shows numbers, and velocity holds vectors"), "{refused}");
}

#[test]
fn pictures_are_brightest_where_the_density_is_largest() {
    let folder = tempdir().expect("a folder");
    let scene = tornado();
    let (picture, image) = (folder.path().join("p.png"), folder.path().join("p.exr"));
    let common = [text(&scene), "--resolution", "64", "--axis", "y", "--at", "0.03", "-o"];
    let report = slice(&[&common[..], &[text(&picture)]].concat()).expect("a picture");
    slice(&[&common[..], &[text(&image)]].concat()).expect("an image");
    let (dump, values) = exr_dump(&image);
    let about = &dump["parts"][0]["vdbake"];
    // 0.03 m lies in the plane's cells.
    assert!((numbers(&about["first_pixel"])[1] - 0.03).abs() <= 0.5 * numbers(&about["right"])[0]);
    let mut reader = png::Decoder::new(std::io::BufReader::new(File::open(&picture).expect("a picture")))
        .read_info()
        .expect("a PNG");
    let mut colours = vec![0; reader.output_buffer_size().expect("small")];
    reader.next_frame(&mut colours).expect("a PNG");
    assert_eq!(colours.len(), 3 * values[0].len());
    let most = values[0].iter().copied().fold(0.0, f32::max);
    let range: [f32; 2] = serde_json::from_value(report["range"].clone()).expect("a range");
    assert_eq!(range, [0.0, most]);
    let (pixels, _) = colours.as_chunks::<3>();
    let brightest = pixels[values[0].iter().position(|value| *value == most).expect("the largest")];
    let black = pixels[values[0].iter().position(|value| *value == 0.0).expect("empty space")];
    for (pixel, value) in pixels.iter().zip(&values[0]) {
        assert!(
            pixel.iter().map(|c| u32::from(*c)).sum::<u32>() <= brightest.iter().map(|c| u32::from(*c)).sum()
        );
        assert!(*value > 0.0 || *pixel == black);
    }
}

#[test]
fn files_of_other_programs_are_sliced() {
    let folder = tempdir().expect("a folder");
    let files = openvdb_make(folder.path());
    let file = |name: &str| files.iter().find(|file| file.ends_with(name)).expect("a file that is made");
    let image = folder.path().join("slice.exr");
    let run = |name: &str, grid: &str| {
        slice(&[text(file(name)), "-o", text(&image), "--planes", "0", "--memory", "1GiB", "--grid", grid])
    };
    for (name, grid, channels) in [
        ("several.vdb", "sphere", 1),
        ("several.vdb", "wave[1]", 1),
        ("several.vdb", "velocity", 3),
        ("several.vdb", "empty", 1),
        ("maps.vdb", "affine", 1),
    ] {
        run(name, grid).unwrap_or_else(|error| panic!("{name} {grid}: {error}"));
        let (dump, _) = exr_dump(&image);
        assert_eq!(dump["parts"][0]["channels"].as_array().map(Vec::len), Some(channels), "{name} {grid}");
    }
    // Voxels at both ends of the range of indices: far more pixels than there is memory.
    for kind in ["float", "bool", "int64", "vec3d"] {
        let error = run(&format!("varied_{kind}.vdb"), "other").expect_err("too large");
        assert!(error.starts_with('1') && error.contains("and less may be used"), "{kind}: {error}");
    }
}

#[test]
fn nothing_is_one_voxel_of_nothing() {
    let folder = tempdir().expect("a folder");
    let scene = write(&folder.path().join("nothing.toml"), "name = \"nothing\"\n");
    let image = folder.path().join("nothing.exr");
    let report = slice(&[text(&scene), "-o", text(&image)]).expect("slices");
    assert_eq!((&report["slices"], &report["pixels"]), (&1.into(), &serde_json::json!([1, 1])));
    assert_eq!(exr_dump(&image).1, [[0.0]]);
}

#[test]
fn what_cannot_be_sliced_is_told() {
    let folder = tempdir().expect("a folder");
    let scene = tornado();
    let path = |name: &str| text(&folder.path().join(name)).to_owned();
    for (arguments, code, expected) in [
        (vec![text(&scene), "-o", "a.tif"], 2, "ends in neither .exr nor .png"),
        (vec![text(&scene), "-o", "a.#.b#.exr"], 2, "#"),
        (vec![text(&scene), "-o", "a.#.exr", "--atlas"], 2, "--atlas puts all slices into one file"),
        (vec![text(&scene), "-o", "a.exr", "--white", "1"], 2, "--white has no meaning for .exr"),
        (vec![text(&scene), "-o", "a.exr", "--grid", "color"], 2, "a scene has no grid \"color\""),
        (
            vec![text(&scene), "-o", "a.exr", "--planes", "9000"],
            2,
            "there is no slice 9000 across z, only 0 to ",
        ),
        (vec![text(&scene), "-o", "a.exr", "--at", "99"], 2, "there is no slice at z = 99 m"),
        (vec![text(&scene), "-o", "a.exr", "--memory", "8MB"], 1, "or allow more with --memory"),
    ] {
        let output = arguments.iter().map(|a| if a.starts_with("a.") { path(a) } else { (*a).to_owned() });
        let arguments: Vec<String> = output.collect();
        let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
        let error = slice(&arguments).expect_err("a refusal");
        assert!(error.starts_with(&code.to_string()) && error.contains(expected), "{arguments:?}: {error}");
    }
    let left: Vec<PathBuf> = fs::read_dir(folder.path())
        .expect("a folder")
        .map(|entry| entry.expect("an entry").path())
        .filter(|path| path.extension().is_none_or(|extension| extension != "toml"))
        .collect();
    assert!(left.is_empty(), "{left:?}");
}
