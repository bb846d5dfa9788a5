//! Errors that are asked for, measured and certified.

use std::fs;
use std::path::Path;

use serde_json::Value;
use vdbake::formats::npy::{self, Values};
use vdbake::report::{Look, Metric, Order, Survey};
use vdbake::scene::Scene;
use vdbake::volume::{Filter, Precision};

use crate::cli::{Folder, code, errors, number, text};
use crate::measuring::mebibytes;
use crate::oracle::{judge, script};
use crate::support::stderr;

/// A straight tube, smooth at its side and its ends, with so many octaves of noise and no density below 0.
pub(crate) fn windowed(octaves: u32) -> String {
    format!(
        "[[tube]]\nradius = 0.5\ncurve = {{ points = [[0, 0, -1], [0, 0, 0], [0, 0, 1]] }}\n\
         [[tube.layer]]\nnoise = \"perlin\"\nfrequency = [2, 2, 4]\noctaves = {octaves}\n\
         [[tube.layer]]\nop = \"add\"\nnoise = \"constant\"\n"
    )
}

/// The scene of this name, with other words in some places.
pub(crate) fn shipped(name: &str, changes: &[(&str, &str)]) -> String {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes").join(name);
    let text = fs::read_to_string(path).expect("a scene");
    changes.iter().fold(text, |text, (from, to)| {
        assert!(text.contains(from), "{name} has no {from}");
        text.replace(from, to)
    })
}

/// The same scene, of which no octave fades and nothing is widened.
fn unlimited(scene: &str) -> String {
    const LIMITS: &str = "octave_fade = false\nwiden = false\n";
    match scene.split_once("[bake]\n") {
        Some((before, after)) => format!("{before}[bake]\n{LIMITS}{after}"),
        None => format!("[bake]\n{LIMITS}{scene}"),
    }
}

pub(crate) fn real(value: &Value) -> f64 {
    value.as_f64().unwrap_or_else(|| panic!("{value} is no number"))
}

fn look(filter: Filter) -> Look {
    Look { points: 20_000, rays: 100, stream: 5, filter, precision: Precision::F32 }
}

#[test]
fn orders_of_convergence_are_those_of_the_filters() {
    let scene = Scene::parse(&windowed(1), "windowed").expect("valid");
    // Interpolation theory: h for the nearest value, h^2 for linear ones; cubic ones reach 3 where nothing is clamped, and the
    // clamp at extrema and the window's second derivative keep them below.
    for (filter, expected, tolerance) in
        [(Filter::Nearest, 1.0, 0.15), (Filter::Trilinear, 2.0, 0.15), (Filter::Cubic, 2.6, 0.5)]
    {
        let survey = Survey::new(&scene, look(filter), 1 << 28);
        let errors = [0.04, 0.02, 0.01].map(|h| [h, survey.error(h, Metric::L2).expect("a plan")]);
        let order = Order::fit(&errors).expect("three errors");
        assert!((order.order - expected).abs() < tolerance, "{filter:?}: {order:?}");
    }
}

#[test]
fn parts_of_an_error_add_up_or_say_why_not() {
    for name in
        ["tornado.toml", "galaxy.toml", "figure2.toml", "ring.toml", "sectors.toml", "stretching.toml"]
    {
        let scene = Scene::parse(&shipped(name, &[]), name).expect("valid");
        for (precision, h) in [(Precision::F32, 0.02), (Precision::F16, 0.01)] {
            let survey = Survey::new(&scene, Look { precision, ..look(Filter::Trilinear) }, 1 << 28);
            let parts = survey.parts(h).expect("a plan");
            let apart = (parts.of_whole.expect("an error") - 1.0).abs();
            assert!(apart <= 0.2 || parts.reason.is_some(), "{name} {parts:?}");
            // What the second evaluator finds: 1.4e-6 of the peak, which is a few root mean squares, but where the density jumps.
            let jumps = name == "sectors.toml";
            assert!(jumps || parts.rounding.of_truth.expect("density") < 1e-5, "{name} {parts:?}");
            let quantised = parts.quantisation.of_truth.expect("density");
            match precision {
                Precision::F32 => assert_eq!(quantised, 0.0),
                // Half a unit in the last of eleven digits is 2^-12 to 2^-11 of a value, evenly spread.
                // Sectors are 0, 1 and whole parts of 32 between.
                Precision::F16 => assert!(jumps || (2e-5..2.5e-4).contains(&quantised), "{name} {parts:?}"),
            }
        }
    }
}

/// Bakes to an error, and measures at other points with another command: gives the voxel size.
fn bake_to(folder: &Folder, scene: &str, error: f64, memory: Option<&str>) -> String {
    folder.put("asked.toml", scene);
    folder.put("truth.toml", unlimited(scene));
    let asked = error.to_string();
    let memory = memory.unwrap_or("16384MiB");
    let bake =
        ["bake", "asked.toml", "-o", "asked.vdb", "--max-error", &asked, "--memory", memory, "--quiet"];
    let report = folder.json(&bake);
    assert_below(&report, memory);
    let reached = &report["certificate"]["goal"];
    let (achieved, at_most) = (real(&reached["achieved"]), real(&reached["at_most"]));
    assert!(at_most <= error && achieved >= 0.7 * error, "{error}: {reached}");
    assert!(number(&report["rounds"]) <= 5 && reached["metric"] == "l2");
    // The kernel at 200 000 points of its own: rounding apart the same truth.
    let size = report["voxel_size"].to_string();
    let found = folder.json(&["compare", "truth.toml", "asked.vdb", "--voxel-size", &size, "--rays", "0"]);
    let [low, high] = [0, 1].map(|end| real(&found["intervals"]["relative_l2"][end]));
    let measured = &report["certificate"]["measured"]["intervals"]["relative_l2"];
    assert!(low <= real(&measured[1]) && real(&measured[0]) <= high, "{measured} and {low} to {high}");
    size
}

/// The process took no more than it was allowed.
fn assert_below(report: &Value, memory: &str) {
    if cfg!(target_os = "linux") {
        let peak = number(&report["peak_rss_bytes"]);
        assert!(peak <= mebibytes(memory) << 20, "{peak} bytes within {memory}");
    }
}

#[test]
fn errors_that_are_asked_for_are_met() {
    let folder = Folder::new();
    for scene in [windowed(1), windowed(3)] {
        bake_to(&folder, &scene, 2e-2, None);
        bake_to(&folder, &scene, 5e-3, None);
    }
    bake_to(&folder, &shipped("galaxy.toml", &[("octaves = 7", "octaves = 1")]), 2e-2, None);
}

#[test]
fn a_refusal_says_with_how_many_octaves_an_error_is_met() {
    let folder = Folder::new();
    let galaxy = shipped("galaxy.toml", &[]);
    folder.put("galaxy.toml", &galaxy);
    let memory = "128MiB";
    let arguments = ["bake", "galaxy.toml", "-o", "galaxy.vdb", "--max-error", "5e-3", "--memory", memory];
    let output = folder.run(&arguments);
    let told = errors(&output);
    assert_eq!((code(&output), folder.made()), (1, vec!["galaxy.toml".to_owned()]), "{told}");
    assert!(told.contains("too many to bake and to measure in the memory"), "{told}");
    let octaves = told.split("with octaves = ").nth(1).and_then(|rest| rest.split(',').next());
    let octaves = octaves.unwrap_or_else(|| panic!("{told}"));
    let fewer = galaxy.replace("octaves = 7", &format!("octaves = {octaves}"));
    let size = bake_to(&folder, &fewer, 5e-3, Some(memory));
    // The same bricks and the same file, measured without a search before.
    let bake = ["bake", "asked.toml", "-o", "again.vdb", "--voxel-size", &size, "--certify"];
    assert_below(&folder.json(&[&bake[..], &["--memory", memory]].concat()), memory);
    assert_below(&folder.json(&["verify", "asked.vdb", "--memory", memory]), memory);
}

#[test]
fn the_memory_that_a_refusal_names_is_enough() {
    let folder = Folder::new();
    folder.put("asked.toml", windowed(3));
    let bake = |memory: &str| {
        folder.run(&[
            "bake",
            "asked.toml",
            "-o",
            "asked.vdb",
            "--max-error",
            "1.5e-3",
            "--memory",
            memory,
            "--quiet",
        ])
    };
    // Too little to plan pilots in, and to read the file.
    for little in ["18MiB", "24MiB", "28MiB"] {
        let told = errors(&bake(little));
        let named = told.split("more with --memory ").nth(1).and_then(|rest| rest.split(' ').next());
        let named = named.unwrap_or_else(|| panic!("{little}: {told}"));
        assert!(!told.contains("no voxel size fits"), "{told}");
        let output = bake(named);
        assert_eq!(code(&output), 0, "{named} after {little}: {}", errors(&output));
    }
}

#[test]
#[ignore = "writes half a gigabyte"]
fn errors_of_fine_noise_are_met() {
    let folder = Folder::new();
    let galaxy = shipped("galaxy.toml", &[("octaves = 7", "octaves = 2")]);
    bake_to(&folder, &galaxy, 2e-2, None);
    bake_to(&folder, &galaxy, 5e-3, None);
    bake_to(&folder, &shipped("galaxy.toml", &[]), 5e-2, None);
}

#[test]
fn other_metrics_are_met() {
    let folder = Folder::new();
    folder.put("asked.toml", windowed(2));
    for (metric, error) in [("max", "0.05"), ("optical-depth", "0.01"), ("mass", "0.002")] {
        let arguments = [
            "bake",
            "asked.toml",
            "-o",
            "asked.vdb",
            "--max-error",
            error,
            "--error-metric",
            metric,
            "--quiet",
        ];
        let report = folder.json(&arguments);
        let reached = &report["certificate"]["goal"];
        assert_eq!(reached["metric"], metric);
        assert!(real(&reached["at_most"]) <= error.parse().expect("a number"), "{reached}");
    }
}

#[test]
fn hard_edges_are_refused_with_a_reason() {
    let folder = Folder::new();
    let hard = "[[tube]]\nname = \"pipe\"\nradius = 0.3\nenvelope = { radial = \"hard\" }\n\
        curve = { points = [[0, 0, -1], [0.3, 0, 0], [0, 0, 1]] }\n";
    folder.put("hard.toml", hard);
    let output = folder.run(&["bake", "hard.toml", "-o", "hard.vdb", "--max-error", "5e-3"]);
    let told = errors(&output);
    assert_eq!(code(&output), 1, "{told}");
    for part in [
        "falls only with the power 0.",
        "tube \"pipe\" has a hard edge",
        "envelope.radial",
        "--error-metric mass",
    ] {
        assert!(told.contains(part), "{part}: {told}");
    }
    assert_eq!(folder.made(), ["hard.toml"]);
    // The largest error stays, and that is why, whatever the memory.
    for (radius, limit, memory) in
        [("0.3", "0.05", "200MiB"), ("0.05", "0.2", "64MiB"), ("0.3", "0.02", "2GiB")]
    {
        folder.put("hard.toml", hard.replace("0.3\nenv", &format!("{radius}\nenv")));
        let arguments = ["--max-error", limit, "--error-metric", "max", "--memory", memory];
        let output = folder.run(&[&["bake", "hard.toml", "-o", "hard.vdb"][..], &arguments].concat());
        let told = errors(&output);
        assert_eq!(code(&output), 1, "{told}");
        for part in
            ["the largest error over the peak ", "fall", "tube \"pipe\" has a hard edge", "--error-metric"]
        {
            assert!(told.contains(part), "{part}: {told}");
        }
        assert!(!told.contains("--memory") && !told.contains("-0.0"), "{told}");
    }
    folder.put("hard.toml", hard);
    assert_eq!(folder.made(), ["hard.toml"]);
    // What it can do: mass, for which edges are anti-aliased, and a soft edge.
    let mass =
        ["bake", "hard.toml", "-o", "hard.vdb", "--max-error", "0.01", "--error-metric", "mass", "--quiet"];
    assert_eq!(code(&folder.run(&mass)), 0);
    folder.put("soft.toml", hard.replace("\"hard\"", "\"smooth\""));
    assert_eq!(code(&folder.run(&["bake", "soft.toml", "--max-error", "5e-3", "--quiet"])), 0);
}

fn bake_with<'a>(arguments: &[&'a str]) -> Vec<&'a str> {
    [&["bake", "asked.toml", "-o", "asked.vdb", "--quiet"][..], arguments].concat()
}

#[test]
fn files_are_as_small_as_asked_for() {
    let folder = Folder::new();
    folder.put("asked.toml", windowed(3));
    for (most, options) in
        [(2_000_000, &[][..]), (300_000, &[]), (100_000, &["--certify"]), (700_000, &["--precision", "f16"])]
    {
        let asked = most.to_string();
        let report = folder.json(&[&bake_with(&["--max-bytes", &asked])[..], options].concat());
        let bytes = number(&report["bytes"]);
        assert!((most * 9 / 10..=most).contains(&bytes), "{bytes} of {most}");
        assert_eq!(report["certificate"].is_null(), options != ["--certify"]);
    }
    // More bricks than are sampled, of which some are empty.
    folder.put("tornado.toml", shipped("tornado.toml", &[]));
    let report = folder.json(&["bake", "tornado.toml", "-o", "tornado.vdb", "--max-bytes", "8MB", "--quiet"]);
    assert!((7_200_000..=8_000_000).contains(&number(&report["bytes"])), "{}", report["bytes"]);
    let output = folder.run(&bake_with(&["--max-bytes", "100kB", "--max-error", "0.005"]));
    assert_eq!(code(&output), 1);
    assert!(errors(&output).contains("takes a file of about"), "{}", errors(&output));
    for arguments in [
        &["--max-error", "0.1", "--resolution", "10"][..],
        &["--max-error", "0.1", "--voxel-size", "10"],
        &["--max-bytes", "1MB", "--resolution", "10"],
        &["--max-error", "0.1", "--frames", "1-2"],
        &["--max-error", "0"],
        &["--max-error", "2"],
        &["--max-error", "nan"],
        &["--error-metric", "mass"],
    ] {
        assert_eq!(code(&folder.run(&bake_with(arguments))), 2, "{arguments:?}");
    }
}

#[test]
fn a_certificate_is_in_the_file_and_beside_it() {
    let folder = Folder::new();
    let plain = folder.json(&["bake", "bent.toml", "-o", "plain.vdb", "--quiet"]);
    let report = folder.json(&["bake", "bent.toml", "-o", "bent.vdb", "--certify", "--quiet"]);
    assert_eq!((&report["uuid"], &report["content_hash"]), (&plain["uuid"], &plain["content_hash"]));
    assert_eq!(
        (&plain["certificate"], &report["certificate_file"]),
        (&Value::Null, &"bent.certificate.json".into())
    );
    let beside: Value = serde_json::from_slice(&folder.get("bent.certificate.json")).expect("JSON");
    let info = folder.json(&["info", "bent.vdb"]);
    let inside = info["metadata"]["vdbake_certificate"].as_str().expect("a certificate");
    let inside: Value = serde_json::from_str(inside).expect("JSON");
    for key in ["measured", "scene_sha256", "settings", "content_hash", "uuid", "goal", "truth"] {
        assert_eq!(inside[key], beside[key], "{key}");
        assert_eq!(inside[key], report["certificate"][key], "{key}");
    }
    assert_eq!(beside["scene"].as_str().map(str::as_bytes), Some(folder.get("bent.toml").as_slice()));
    assert_eq!(beside["settings"]["precision"], "f32");
    // The same bytes on any number of threads, with all that was measured.
    let first = folder.get("bent.vdb");
    for threads in ["1", "3"] {
        let arguments = ["bake", "bent.toml", "-o", "bent.vdb", "--certify", "--quiet", "--threads", threads];
        assert_eq!(code(&folder.run(&arguments)), 0);
        assert!(folder.get("bent.vdb") == first, "{threads} threads");
    }
}

#[test]
fn verify_finds_one_voxel() {
    let folder = Folder::new();
    let bake = ["bake", "bent.toml", "-o", "bent.vdb", "--certify", "--compression", "none", "--quiet"];
    assert_eq!(code(&folder.run(&bake)), 0);
    let good = folder.json(&["verify", "bent.vdb", "--bricks", "all"]);
    assert_eq!((&good["holds"], &good["bricks_that_differ"]), (&true.into(), &0.into()));
    assert_eq!((&good["certificate"]["holds"], number(&good["bricks"]) > 20), (&true.into(), true));
    let told = text(&folder.run(&["verify", "bent.vdb"]));
    assert!(told.contains("bent.vdb  holds") && told.contains("certificate"), "{told}");

    // The last bit of one voxel in the middle of what is stored.
    let mut bytes = folder.get("bent.vdb");
    let at = bytes.len() - 2048 * 5 / 2;
    let at = (at..).find(|at| bytes[*at..*at + 4] != [0; 4] && bytes[*at + 3] == 0x3e).expect("a density");
    bytes[at] ^= 1;
    folder.put("altered.vdb", &bytes);
    let output = folder.run(&["verify", "altered.vdb", "--bricks", "all", "--json"]);
    assert_eq!(code(&output), 4);
    let bad: Value = serde_json::from_slice(&output.stdout).expect("JSON");
    assert_eq!((&bad["holds"], &bad["content_hash"]["holds"]), (&false.into(), &false.into()));
    assert_eq!((&bad["bricks_that_differ"], &bad["certificate"]["holds"]), (&1.into(), &false.into()));
    assert!(errors(&output).contains("is not what its recipe makes"), "{}", errors(&output));
    // In a few lines, of the many figures that more than the last bit changes.
    bytes[at + 2] ^= 0x40;
    folder.put("altered.vdb", &bytes);
    let output = folder.run(&["verify", "altered.vdb", "--json"]);
    let bad: Value = serde_json::from_slice(&output.stdout).expect("JSON");
    let faults = bad["certificate"]["faults"].as_array().expect("a list").len();
    let told = text(&folder.run(&["verify", "altered.vdb"]));
    assert!(faults > 5 && told.lines().count() < 20, "{faults}: {told}");
    assert!(told.contains(&format!("and {} more, which --json lists", faults - 5)), "{told}");

    // A certificate that promises more than there is, in any figure.
    let bytes = folder.get("bent.vdb");
    for (figure, place) in [
        (&b"\"max\":{\"absolute\":"[..], "errors max absolute"),
        (b"\"relative_l2\":[", "intervals relative_l2"),
        (b"\"whole\":{\"rms\":", "parts whole rms"),
        (b"\"ratio\":", "ratio"),
    ] {
        let found = bytes.windows(figure.len()).position(|part| part == figure).expect("a figure");
        let mut better = bytes.clone();
        let digit =
            (found + figure.len()..).find(|at| (b'1'..=b'9').contains(&better[*at])).expect("a digit");
        better[digit] = if better[digit] == b'1' { b'2' } else { b'1' };
        folder.put("better.vdb", &better);
        let output = folder.run(&["verify", "better.vdb", "--json"]);
        let bad: Value = serde_json::from_slice(&output.stdout).expect("JSON");
        assert_eq!((code(&output), &bad["content_hash"]["holds"]), (4, &true.into()), "{place}");
        let fault = bad["certificate"]["faults"][0].as_str().expect("a fault");
        assert!(fault.contains(place), "{fault}");
    }

    // The same values in voxels of another size: the map holds the size as a double, more than once.
    let size = real(&folder.json(&["info", "bent.vdb"])["grids"][0]["voxel_size"][0]).to_le_bytes();
    let places: Vec<usize> = (0..bytes.len() - 8).filter(|at| bytes[*at..*at + 8] == size).collect();
    assert!(!places.is_empty());
    let mut larger = bytes.clone();
    for at in places {
        larger[at..at + 8].copy_from_slice(&(2.0 * f64::from_le_bytes(size)).to_le_bytes());
    }
    folder.put("larger.vdb", &larger);
    let output = folder.run(&["verify", "larger.vdb", "--json"]);
    let bad: Value = serde_json::from_slice(&output.stdout).expect("JSON");
    assert_eq!(
        (code(&output), &bad["placed"], &bad["content_hash"]["holds"]),
        (4, &false.into(), &true.into())
    );

    // What carries no recipe cannot be verified.
    assert_eq!(code(&folder.run(&["verify", "bent.toml"])), 3);
}

#[test]
fn files_that_scenes_name_are_looked_for() {
    let folder = Folder::new();
    folder.put("path.csv", "0,0,0\n0.5,0,1\n0,0,2\n");
    folder.put("named.toml", "[bake]\nresolution = 32\n[[tube]]\nradius = 0.2\ncurve = { kind = \"catmull-rom\", file = \"path.csv\" }\n");
    assert_eq!(code(&folder.run(&["bake", "named.toml", "--quiet"])), 0);
    assert_eq!(code(&folder.run(&["verify", "named.vdb"])), 0);
    fs::create_dir(folder.path("other")).expect("a folder");
    fs::rename(folder.path("named.vdb"), folder.path("other/named.vdb")).expect("moved");
    assert_eq!(code(&folder.run(&["verify", "other/named.vdb"])), 3);
    assert_eq!(code(&folder.run(&["verify", "other/named.vdb", "--inputs", "."])), 0);
    folder.put("other/path.csv", "0,0,0\n0.5,0,1\n0,0,3\n");
    assert_eq!(code(&folder.run(&["verify", "other/named.vdb"])), 4);
}

fn doubles(path: &Path) -> (Vec<usize>, Vec<f64>) {
    let array = npy::read(&mut fs::File::open(path).expect("a file")).expect("an array");
    let Values::F64(values) = array.values else { panic!("single precision") };
    (array.shape, values)
}

#[test]
fn residuals_are_those_of_the_certificate() {
    let folder = Folder::new();
    folder.put("asked.toml", windowed(1));
    let bake = ["bake", "asked.toml", "--resolution", "40", "-o", "asked.vdb", "--certify", "--quiet"];
    let report = folder.json(&bake);
    let measured = &report["certificate"]["measured"];
    assert_eq!(code(&folder.run(&["verify", "asked.vdb", "--export", "out"])), 0);
    let array = |name: &str| doubles(&folder.path("out").join(name));
    let (shape, points) = array("points.npy");
    assert_eq!(shape, [usize::try_from(number(&measured["points"])).expect("small"), 3]);
    assert_eq!(
        array("rays.npy").0,
        [usize::try_from(number(&measured["optical_depth"]["rays"])).expect("small"), 8]
    );
    let square = |values: &[f64]| values.iter().map(|x| x * x).sum::<f64>();
    let relative = |a: &str, b: &str| (square(&array(a).1) / square(&array(b).1)).sqrt();
    for (found, stated) in [
        (relative("residuals.npy", "truth.npy"), &measured["errors"]["l2"]["of_rms"]),
        (relative("depths_residuals.npy", "depths_truth.npy"), &measured["optical_depth"]["l2"]["of_rms"]),
    ] {
        // Sums in another order.
        assert!((found / real(stated) - 1.0).abs() < 1e-12, "{found} {stated}");
    }
    // Of all that trilinear values show: two voxels around the tube's surface at most.
    let far = points.chunks(3).filter(|p| p[0].abs().max(p[1].abs()) > 0.5 + 10.0 * 0.05).count();
    assert_eq!(far, 0);
}

#[test]
fn openvdb_and_python_find_the_same_error() {
    let folder = Folder::new();
    for octaves in [1, 3] {
        folder.put("asked.toml", windowed(octaves));
        folder.put("truth.toml", unlimited(&windowed(octaves)));
        let bake = ["bake", "asked.toml", "--resolution", "48", "-o", "asked.vdb", "--certify", "--quiet"];
        let report = folder.json(&bake);
        let stated = &report["certificate"]["measured"]["intervals"]["relative_l2"];
        let python = |arguments: &[&str]| {
            let mut command = judge("VDBAKE_OPENVDB_PYTHON");
            let command = script(&mut command, "openvdb_l2.py").current_dir(folder.path(""));
            let output = command.args(arguments).output().expect("Python starts");
            assert!(output.status.success(), "{}", stderr(&output));
            output.stdout
        };
        python(&["asked.vdb", "points.npy"]);
        let exact = ["sample", "truth.toml", "--exact", "--points", "points.npy", "-o", "truth.npy"];
        assert_eq!(code(&folder.run(&exact)), 0);
        let found: Value =
            serde_json::from_slice(&python(&["asked.vdb", "points.npy", "truth.npy"])).expect("JSON");
        let [low, high] = [0, 1].map(|end| real(&found["interval"][end]));
        // Two intervals of 95 %, of other points.
        assert!(low <= real(&stated[1]) && real(&stated[0]) <= high, "{found} {stated}");
        assert!((high - low) / real(&found["l2"]) < 0.05, "{found}");
    }
}
