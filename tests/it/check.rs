//! `vdbake check`: the catalogue of stiff and extreme cases, and what of a scene is hazardous.

use serde_json::Value;

use crate::cli::{Folder, code, errors, text};
use crate::kernel::shipped;
use crate::support::scenes;

#[test]
fn every_case_of_the_catalogue_holds() {
    let folder = Folder::new();
    let output = folder.run(&["check", "-o", "check.html", "--quiet"]);
    assert_eq!(code(&output), 0, "{}{}", text(&output), errors(&output));
    let page = String::from_utf8(folder.get("check.html")).expect("UTF-8");
    assert!(
        page.contains("Where accuracy ends") && !page.contains("<script") && !page.contains("does not hold")
    );
    assert_eq!(page.matches("<svg ").count(), 9);
}

#[test]
fn a_catalogue_in_json_has_errors_bounds_and_levels() {
    let folder = Folder::new();
    let report = folder.json(&["check", "--only", "twist"]);
    let cases = report["cases"].as_array().expect("cases");
    assert!(!cases.is_empty() && report["holds"] == true && report["held"] == cases.len());
    for case in cases {
        let [error, bound] = ["error", "bound"].map(|key| case[key].as_f64().expect("a number"));
        assert!(error <= bound && (case["margin"].as_f64().expect("a number") - error / bound).abs() < 1e-12);
    }
    let family = &report["families"].as_array().expect("families")[0];
    let at = |mark: &Value| mark["at"].as_f64().expect("a number");
    assert!(family["marks"].as_array().expect("marks").windows(2).all(|pair| at(&pair[0]) < at(&pair[1])));
    assert!(report["simd"].as_array().is_some_and(|simd| !simd.is_empty()));
    assert_eq!(code(&folder.run(&["check", "--only", "no such case"])), 2);
    assert_eq!(code(&folder.run(&["check", "-o", "check.txt"])), 2);
}

/// A scene with one hazard, the word for it, its severity and line.
const HAZARDS: [(&str, &str, &str, u64, &str); 14] = [
    (
        "octaves",
        "serious",
        "no density",
        7,
        "[bake]\nresolution = 64\n[[tube]]\ncurve = { points = [[0, 0, 0], [1, 0, 0], [2, 0, 0]] }\ntwist = 10000\n[[tube.layer]]\noctaves = 1\n",
    ),
    (
        "cusp",
        "warning",
        "lost mass, faded mass",
        2,
        "[[tube]]\ncurve = { kind = \"cubic\", points = [[0, 0, 0], [1, 1, 0], [0, 1, 0], [1, 0, 0]] }\nradius = 0.1\n",
    ),
    // Seven hundred times as sharp as it is thick, in a thousandth of the curve.
    (
        "curvature",
        "warning",
        "lost mass, faded mass",
        2,
        "[[tube]]\ncurve = { points = [[0, 0, 0], [0.05, 0, 2], [0, 0, 0.5]] }\nradius = 0.02\n",
    ),
    (
        "jump",
        "note",
        "",
        3,
        "[[tube]]\ncurve = { points = [[0, 0, 0], [1, 0, 0], [2, 0, 0]] }\nradius = [[0, 0.1], [0.5, 0.1], [0.5, 0.3], [1, 0.3]]\n",
    ),
    (
        "curvature",
        "warning",
        "lost mass",
        2,
        "[[tube]]\ncurve = { points = [[-1, 0, 0], [0, 1, 0], [1, 0, 0]] }\nradius = 1.5\n",
    ),
    (
        "corners",
        "note",
        "",
        2,
        "[[tube]]\ncurve = { points = [[0, 0, 0], [1, 0, 0], [2, 0, 0], [2, 1, 0], [2, 2, 0]] }\nradius = 0.2\n",
    ),
    (
        "thin",
        "serious",
        "no density",
        6,
        "[bake]\nvoxel_size = 0.1\nwiden = false\n[[tube]]\ncurve = { points = [[0, 0, 0], [1, 0, 0], [2, 0, 0]] }\nradius = 0.01\n",
    ),
    (
        "twist",
        "serious",
        "",
        4,
        "[[tube]]\ncurve = { points = [[0, 0, 0], [1, 0, 0], [2, 0, 0]] }\nradius = 0.2\ntwist = 1000\n[[tube.layer]]\nnoise = \"sectors\"\n",
    ),
    (
        "aliasing",
        "serious",
        "",
        8,
        "[bake]\nresolution = 64\noctave_fade = false\n[[tube]]\ncurve = { points = [[0, 0, 0], [1, 0, 0], [2, 0, 0]] }\nradius = 0.2\n[[tube.layer]]\noctaves = 9\n",
    ),
    (
        "octaves",
        "serious",
        "no density",
        7,
        "[bake]\nresolution = 64\n[[tube]]\ncurve = { points = [[0, 0, 0], [1, 0, 0], [2, 0, 0]] }\nradius = 0.2\n[[tube.layer]]\noctaves = 2\nfrequency = 1000\n",
    ),
    (
        "stiff",
        "warning",
        "stiff shadows",
        5,
        "[[tube]]\ncurve = { points = [[0, 0, 0], [1, 0, 0], [2, 0, 0]] }\nradius = 0.2\n[medium]\nextinction = 1e6\n",
    ),
    (
        "warp",
        "warning",
        "",
        8,
        "[bake]\nresolution = 128\n[[tube]]\ncurve = { points = [[0, 0, 0], [1, 0, 0], [2, 0, 0]] }\nradius = 0.4\n[[tube.layer]]\noctaves = 3\nwarp = { amplitude = 30, frequency = 2 }\n",
    ),
    (
        "tubes overlap",
        "warning",
        "",
        6,
        "overlap = \"closest\"\n[[tube]]\ncurve = { points = [[0, 0, 0], [1, 0, 0], [2, 0, 0]] }\nradius = 0.4\n[[tube]]\ncurve = { points = [[1, -1, 0], [1, 0, 0], [1, 1, 0]] }\nradius = 0.4\n",
    ),
    (
        "steep",
        "note",
        "",
        3,
        "[[tube]]\ncurve = { points = [[0, 0, 0], [1, 0, 0], [2, 0, 0]] }\nradius = [[0, 0.1], [0.48, 0.1], [0.52, 0.6], [1, 0.6]]\n",
    ),
];

/// Of two tubes of radius 1/2 that cross at right angles, each 4 m long: 2 pi m^3 and no more than their common volume, Steinmetz's
/// 16 r^3 / 3, of which a share of 0.119 is of the union.
#[test]
fn tubes_that_cross_are_told_of_with_where_and_how_much() {
    let folder = Folder::new();
    let tube = |name: &str, ends: [&str; 3]| {
        format!(
            "[[tube]]\nname = \"{name}\"\nradius = 0.5\ncaps = \"flat\"\ncurve = {{ points = [{}] }}\n",
            ends.join(", ")
        )
    };
    let a = tube("a", ["[-2, 0, 0]", "[0, 0, 0]", "[2, 0, 0]"]);
    let b = tube("b", ["[0, -1, 0]", "[0, 1, 0]", "[0, 3, 0]"]);
    folder.put("cross.toml", format!("[bake]\nvoxel_size = 0.04\n{a}{b}"));
    let report = folder.json(&["check", "cross.toml"]);
    let hazards = report["hazards"].as_array().expect("hazards");
    let found = hazards.iter().find(|hazard| hazard["kind"] == "tubes overlap").expect("one");
    assert_eq!(found["severity"], "note");
    let what = found["what"].as_str().expect("words");
    let share: f64 =
        what.split("share ").nth(1).and_then(|rest| rest.split(' ').next()?.parse().ok()).expect(what);
    let common = 16.0 * 0.125 / 3.0;
    let union = 2.0 * std::f64::consts::PI - common;
    // Five deviations of some 3 500 voxels.
    assert!((share / 100.0 - common / union).abs() < 0.03, "{what}");
    // The middle metre of the one, and the second of the other's four, to a voxel or so.
    let ends: Vec<f64> = what.split([' ', ',']).filter_map(|word| word.parse().ok()).skip(1).collect();
    let expected = [1.5, 2.5, 0.5, 1.5];
    assert!(
        ends.len() >= 4 && ends.iter().zip(expected).all(|(a, b)| (a - b).abs() < 0.12),
        "{what}: {ends:?}"
    );
}

#[test]
fn the_catalogue_takes_no_options_of_scenes() {
    let folder = Folder::new();
    for options in [
        &["--voxel-size", "1"][..],
        &["--frames", "1-2"],
        &["--precision", "f32"],
        &["--compression", "zip"],
        &["--memory", "1GiB"],
        &["--explain"],
    ] {
        let output = folder.run(&[&["check", "--only", "no such case"], options].concat());
        assert_eq!(code(&output), 2);
        assert!(errors(&output).contains(&format!("{} is for scenes", options[0])), "{}", errors(&output));
    }
}

/// The very lines that a bake has, of each moment, and only where they are asked for.
#[test]
fn what_a_scene_does_not_need_is_told_as_a_bake_tells_it() {
    let folder = Folder::new();
    let bake = folder.json(&["bake", "bent.toml"]);
    let left_out = bake["left_out"].as_array().expect("a list");
    assert!(!left_out.is_empty());
    let check = folder.json(&["check", "bent.toml", "--frames", "1-2"]);
    let moments = check["moments"].as_array().expect("moments");
    assert!(
        moments.len() == 2 && moments.iter().all(|moment| moment["left_out"] == bake["left_out"]),
        "{check}"
    );
    let [asked, plain] = [&["check", "bent.toml", "--explain"][..], &["check", "bent.toml"]]
        .map(|arguments| text(&folder.run(arguments)).to_owned());
    for line in left_out.iter().map(|line| line.as_str().expect("words")) {
        assert!(asked.contains(line) && !plain.contains(line), "{line}: {asked}{plain}");
    }
}

#[test]
fn each_hazard_is_found_at_its_place() {
    let folder = Folder::new();
    for (kind, severity, beside, line, scene) in HAZARDS {
        folder.put("scene.toml", scene);
        let output = folder.run(&["check", "scene.toml", "--json", "--quiet"]);
        let report: Value =
            serde_json::from_slice(&output.stdout).unwrap_or_else(|_| panic!("{kind}: {}", errors(&output)));
        let hazards = report["hazards"].as_array().expect("hazards");
        let found = hazards.iter().find(|hazard| hazard["kind"] == kind);
        let found = found.unwrap_or_else(|| panic!("{kind}: {hazards:?}"));
        assert_eq!((&found["severity"], found["line"].as_u64()), (&severity.into(), Some(line)), "{found}");
        assert!(found["change"].as_array().is_some_and(|change| !change.is_empty()));
        let others: Vec<_> =
            hazards.iter().filter(|hazard| hazard["severity"] != "note" && hazard["kind"] != kind).collect();
        let is_expected = |hazard: &Value| {
            hazard["kind"].as_str().is_some_and(|kind| kind == "error" || beside.contains(kind))
        };
        assert!(others.iter().all(|hazard| is_expected(hazard)), "{kind}: {others:?}");
        let is_serious = hazards.iter().any(|hazard| hazard["severity"] == "serious");
        assert_eq!(code(&output), if is_serious { 4 } else { 0 }, "{kind}");
    }
}

#[test]
fn curvature_is_found_where_it_is_sharpest() {
    // Of the quadratic's closed form: |C' x C''| / |C'|^3 where C' . C'' = 0.
    let folder = Folder::new();
    folder.put(
        "scene.toml",
        "[[tube]]\ncurve = { points = [[0, 0, 0], [0.05, 0, 2], [0, 0, 0.5]] }\nradius = 0.02\n",
    );
    let report = folder.json(&["check", "scene.toml"]);
    let hazards = report["hazards"].as_array().expect("hazards");
    let found = hazards.iter().find(|hazard| hazard["kind"] == "curvature").expect("a sharp bend");
    let told = found["what"]
        .as_str()
        .and_then(|what| what.split("is up to ").nth(1)?.split(':').next()?.parse().ok());
    let told: f64 = told.unwrap_or_else(|| panic!("{found}"));
    // C' = 2 (a + b t), a = (0.05, 2), b = (-0.1, -3.5); C'' = 2 b.
    let (a, b) = ([0.05, 2.0], [-0.1, -3.5]);
    let cross: f64 = a[0] * b[1] - a[1] * b[0];
    let square = b[0] * b[0] + b[1] * b[1];
    // |C'| at its least is 2 |a x b| / |b|.
    let slowest = 2.0 * cross.abs() / square.sqrt();
    let curvature = 4.0 * cross.abs() / (slowest * slowest * slowest);
    // Three digits are shown.
    assert!((told / (0.02 * curvature) - 1.0).abs() < 6e-3, "{told}, not {}", 0.02 * curvature);
}

#[test]
fn of_frames_the_worst_is_told() {
    let folder = Folder::new();
    let scene = "[bake]\nvoxel_size = 0.02\n[[tube]]\ncurve = { points = [[0, 0, 0], [1, 0, 0], [2, 0, 0]] }\nradius = { keys = [[0, 0.02], [1, 0.002]] }\n";
    folder.put("scene.toml", scene);
    let report = folder.json(&["check", "scene.toml", "--frames", "1-25x12"]);
    let hazards = report["hazards"].as_array().expect("hazards");
    let thin: Vec<&Value> = hazards.iter().filter(|hazard| hazard["kind"] == "thin").collect();
    assert!(thin.len() == 1 && thin[0]["frame"] == 25, "{hazards:?}");
    assert_eq!(report["moments"].as_array().map(Vec::len), Some(3));
}

#[test]
fn a_plain_scene_has_no_serious_hazard_and_an_expected_error() {
    let folder = Folder::new();
    let report = folder.json(&["check", "bent.toml"]);
    assert!(
        report["hazards"].as_array().expect("hazards").iter().all(|hazard| hazard["severity"] != "serious")
    );
    let moment = &report["moments"][0];
    let [error, peak] = [&moment["expected"]["relative_l2"], &moment["expected"]["peak"]].map(Value::as_f64);
    assert!(
        error.is_some_and(|error| error > 0.0 && error < 0.5) && peak.is_some_and(|peak| peak > 0.1),
        "{moment}"
    );
    assert!(moment["memory_bytes"].as_u64().is_some_and(|bytes| bytes > 1 << 20));
    // What half precision clamps, and what it leaves.
    folder.put("dense.toml", "[[tube]]\ncurve = { points = [[0, 0, 0], [1, 0, 0], [2, 0, 0]] }\n[[tube.layer]]\nnoise = \"constant\"\nvalue = 1e6\n");
    assert_eq!(code(&folder.run(&["check", "dense.toml", "--quiet", "--precision", "f16"])), 4);
    assert_eq!(code(&folder.run(&["check", "dense.toml", "--quiet"])), 0);
}

#[test]
fn bakes_tell_of_serious_hazards() {
    let folder = Folder::new();
    let (_, _, _, _, scene) = HAZARDS.into_iter().find(|hazard| hazard.0 == "aliasing").expect("one");
    folder.put("scene.toml", scene);
    let output = folder.run(&["bake", "scene.toml"]);
    assert_eq!(code(&output), 0);
    assert!(
        errors(&output).contains("serious: tube")
            && errors(&output).contains("octaves alias")
            && errors(&output).contains("scene.toml:8:11"),
        "{}",
        errors(&output)
    );
    let output = folder.run(&["bake", "bent.toml"]);
    assert!(!errors(&output).contains("serious:"), "{}", errors(&output));
}

/// What is shipped is meant as it is.
#[test]
fn no_shipped_scene_has_a_serious_hazard() {
    for path in scenes() {
        let name = path.file_stem().and_then(|stem| stem.to_str()).expect("a name");
        let scene = shipped(name);
        let field = vdbake::field::Field::compile(&scene);
        let lattice = crate::kernel::lattice(&field, 256.0);
        for hazard in vdbake::check::hazards(&scene, lattice) {
            assert!(hazard.weight() < vdbake::scene::Weight::Serious, "{}", hazard.remark().show(false));
        }
    }
}
