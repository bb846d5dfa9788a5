//! The program as scripts and people meet it: exit codes, what is printed where, and which files are left.

use std::fs;
use std::path::PathBuf;
use std::process::{Command, Output, Stdio};

use serde_json::Value;
use tempfile::TempDir;

/// A bent tube with noise, quick to bake.
const SCENE: &str = r#"
name = "bent"
[bake]
resolution = 48
[[tube]]
curve = { points = [[0, 0, 0], [0.5, 0, 1], [0, 0, 2]] }
radius = 0.3
twist = 1.0
[[tube.layer]]
threshold = 0.0
"#;

/// A folder of its own, with `bent.toml` in it.
pub(crate) struct Folder(TempDir);

impl Folder {
    pub(crate) fn new() -> Folder {
        let folder = Folder(tempfile::tempdir().expect("a folder"));
        folder.put("bent.toml", SCENE);
        folder
    }

    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    pub(crate) fn put(&self, name: &str, content: impl AsRef<[u8]>) {
        fs::write(self.path(name), content).expect("a file");
    }

    pub(crate) fn get(&self, name: &str) -> Vec<u8> {
        fs::read(self.path(name)).expect("a file")
    }

    /// All names but that of the scene.
    pub(crate) fn made(&self) -> Vec<String> {
        let entries = fs::read_dir(self.0.path()).expect("a folder");
        let names = entries.map(|entry| entry.expect("an entry").file_name().into_string().expect("UTF-8"));
        let mut names: Vec<String> = names.filter(|name| name != "bent.toml").collect();
        names.sort();
        names
    }

    pub(crate) fn command(&self, arguments: &[&str]) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_vdbake"));
        command.args(arguments).current_dir(self.0.path()).stdin(Stdio::null()).env_remove("NO_COLOR");
        command
    }

    pub(crate) fn run(&self, arguments: &[&str]) -> Output {
        self.command(arguments).output().expect("the program starts")
    }

    /// Runs a command that succeeds, with `--json`.
    pub(crate) fn json(&self, arguments: &[&str]) -> Value {
        let output = self.run(&[arguments, &["--json"]].concat());
        assert_eq!(code(&output), 0, "{}", errors(&output));
        serde_json::from_slice(&output.stdout).expect("one JSON object and nothing else")
    }
}

pub(crate) fn code(output: &Output) -> i32 {
    output.status.code().expect("an exit code")
}

pub(crate) fn errors(output: &Output) -> String {
    String::from_utf8(output.stderr.clone()).expect("UTF-8")
}

pub(crate) fn text(output: &Output) -> String {
    String::from_utf8(output.stdout.clone()).expect("UTF-8")
}

fn real(value: &Value) -> f64 {
    value.as_f64().unwrap_or_else(|| panic!("{value} is no number"))
}

pub(crate) fn number(value: &Value) -> u64 {
    value.as_u64().unwrap_or_else(|| panic!("{value} is no whole number"))
}

#[test]
fn help_lists_the_commands_there_are() {
    let folder = Folder::new();
    let output = folder.run(&["--help"]);
    assert_eq!(code(&output), 0);
    let help = text(&output);
    let commands = help.split("Commands:").nth(1).and_then(|rest| rest.split("\n\n").next()).expect("a list");
    let names: Vec<&str> = commands.lines().filter_map(|line| line.split_whitespace().next()).collect();
    assert_eq!(
        names,
        [
            "bake", "plan", "render", "sample", "slice", "compare", "convert", "info", "report", "check",
            "verify", "help"
        ]
    );
    for name in [
        "bake", "plan", "render", "sample", "slice", "compare", "convert", "info", "report", "check",
        "verify",
    ] {
        assert_eq!(code(&folder.run(&[name, "--help"])), 0);
    }
}

#[test]
fn usage_is_2() {
    let folder = Folder::new();
    for arguments in [
        &[][..],
        &["render", "bent.toml"],
        &["bake"],
        &["bake", "bent.toml", "--frobnicate"],
        &["bake", "bent.toml", "--voxel-size", "0.1", "--resolution", "8"],
        &["bake", "bent.toml", "--voxel-size", "0"],
        &["bake", "bent.toml", "--voxel-size", "nan"],
        &["bake", "bent.toml", "--resolution", "0"],
        &["bake", "bent.toml", "--time", "inf"],
        &["bake", "bent.toml", "--memory", "much"],
        &["bake", "bent.toml", "--threads", "0"],
        &["bake", "bent.toml", "--compression", "rar"],
        &["bake", "bent.toml", "--precision", "f64"],
        &["bake", "bent.toml", "-o", "bent.exr"],
        &["bake", "bent.toml", "-o", "."],
        &["info", "bent.toml", "--size", "16"],
        &["convert", "bent.toml", "bent.vol"],
    ] {
        let output = folder.run(arguments);
        assert_eq!(code(&output), 2, "{arguments:?}: {}", errors(&output));
        assert!(output.stdout.is_empty());
    }
    assert_eq!(folder.made(), [""; 0]);
}

/// Of every option that takes one.
#[test]
fn whole_numbers_are_asked_for_in_words() {
    let folder = Folder::new();
    let render = ["render", "bent.toml", "-o", "bent.png"];
    let report = ["report", "bent.toml", "-o", "bent.html"];
    for (command, option) in [
        (&["bake", "bent.toml"][..], "--resolution"),
        (&["bake", "bent.toml"], "--threads"),
        (&render, "--samples"),
        (&render, "--seed"),
        (&render, "--map-every"),
        (&render, "--ray-steps"),
        (&report, "--repeats"),
        (&report, "--points"),
        (&["compare", "bent.toml", "bent.toml"], "--points"),
        (&["compare", "bent.toml", "bent.toml"], "--rays"),
        (&["verify", "bent.vdb"], "--bricks"),
    ] {
        for value in ["1.5", "some", "-1"] {
            let output = folder.run(&[command, &[option, value]].concat());
            let told = errors(&output);
            assert_eq!(code(&output), 2, "{option} {value}: {told}");
            assert!(told.contains("expected a whole number"), "{option} {value}: {told}");
        }
    }
    assert_eq!(folder.made(), [""; 0]);
}

#[test]
fn invalid_input_is_3() {
    let folder = Folder::new();
    folder.put("wrong.toml", "[[tube]]\nradus = 1\n");
    folder.put("bytes.toml", b"name = \"\xff\"\n");
    folder.put("wrong.vdb", "not a VDB file");
    for name in ["wrong.toml", "bytes.toml", "missing.toml", "."] {
        for command in ["bake", "plan", "info"] {
            let output = folder.run(&[command, name]);
            assert_eq!(code(&output), 3, "{command} {name}: {}", errors(&output));
            assert!(output.stdout.is_empty());
        }
    }
    folder.put("nothing.vdb", "");
    let output = folder.run(&["info", "nothing.vdb"]);
    assert_eq!((code(&output), errors(&output).as_str()), (3, "error: nothing.vdb is empty\n"));
    folder.put("volume.vdb", b" BDV\0\0\0\0");
    for command in ["bake", "plan"] {
        let output = folder.run(&[command, "volume.vdb"]);
        let expected = (3, "error: volume.vdb is a VDB file, not a scene\n");
        assert_eq!((code(&output), errors(&output).as_str()), expected);
    }
    let output = folder.run(&["info", "wrong.vdb"]);
    assert_eq!(
        (code(&output), errors(&output).as_str()),
        (3, "error: cannot read wrong.vdb: not a VDB file\n")
    );
    let output = folder.run(&["bake", "wrong.toml"]);
    let message = errors(&output);
    assert!(message.contains("wrong.toml:2:1") && message.contains("radius"), "{message}");
    assert!(!message.contains('\u{1b}'), "colours only on a terminal");
    assert_eq!(folder.made(), ["bytes.toml", "nothing.vdb", "volume.vdb", "wrong.toml", "wrong.vdb"]);
}

#[test]
fn bake_reports_what_it_did() {
    let folder = Folder::new();
    let report = folder.json(&["bake", "bent.toml", "--threads", "2"]);
    assert_eq!(report["output"], "bent.vdb");
    assert_eq!(number(&report["bytes"]), folder.get("bent.vdb").len() as u64);
    assert_eq!(report["threads"], 2);
    let (ratio, error) = (real(&report["mass_ratio"]), real(&report["mass_ratio_error"]));
    // Density is conserved by nobody here, but volume is: the rest cylinder has the tube's own radius and length.
    assert!((ratio - 1.0).abs() < 0.05 && error > 0.0 && error < 0.1, "{ratio} +- {error}");
    assert_eq!(real(&report["lost_mass"]), 0.0);
    assert_eq!(real(&report["faded_mass"]), 0.0);
    assert!((real(&report["mass"]["baked"]) / real(&report["mass"]["rest"]) - ratio).abs() < 1e-12);
    assert!(report["simd"].is_string() && report["left_out"].is_array());
    assert!(number(&report["active_voxels"]) > 1000);
    assert!(number(&report["leaves"]) + number(&report["tiles"]) <= number(&report["planned_bricks"]));
    assert!(number(&report["searched_voxels"]) >= number(&report["active_voxels"]));
    for times in ["seconds", "cpu_seconds"] {
        for phase in ["plan", "evaluate", "encode", "write", "total"] {
            assert!(report[times][phase].as_f64().is_some_and(|time| time >= 0.0), "{times} {phase}");
        }
    }
    if cfg!(target_os = "linux") {
        assert!(number(&report["peak_rss_bytes"]) > 1 << 20);
    }
    let height =
        report["bounds"][1][2].as_f64().expect("bounds") - report["bounds"][0][2].as_f64().expect("bounds");
    assert_eq!(report["voxel_size"].as_f64().expect("a size"), height / 48.0);
}

#[test]
fn an_empty_scene_has_no_mass() {
    let folder = Folder::new();
    folder.put("nothing.toml", "name = \"nothing\"\n");
    let report = folder.json(&["bake", "nothing.toml"]);
    for key in ["mass_ratio", "mass_ratio_error", "lost_mass", "faded_mass"] {
        assert_eq!(report[key], Value::Null, "{key}");
    }
    assert_eq!(real(&report["mass"]["baked"]), 0.0);
}

#[test]
fn results_and_progress_do_not_mix() {
    let folder = Folder::new();
    let output = folder.run(&["bake", "bent.toml", "--explain"]);
    assert!(text(&output).starts_with("bent.vdb"), "{}", text(&output));
    assert!(text(&output).contains("left out") && text(&output).contains("m^3 at rest"));
    let progress = errors(&output);
    assert!(progress.lines().all(|line| line.starts_with("Progress: ")), "{progress}");
    assert!(progress.ends_with("Progress: 100.0%\n") && progress.lines().count() <= 20, "{progress}");
    assert_eq!(errors(&folder.run(&["bake", "bent.toml", "--quiet"])), "");
}

#[test]
fn recipe_is_in_the_file() {
    let folder = Folder::new();
    let arguments = ["bake", "bent.toml", "--voxel-size", "0.125", "--time", "-0.5"];
    let report = folder.json(&[&arguments[..], &["--compression", "zip", "--precision", "f16"]].concat());
    let info = folder.json(&["info", "bent.vdb"]);
    assert_eq!(info["kind"], "vdb");
    assert_eq!(info["uuid"], report["uuid"]);
    assert_eq!(info["metadata"]["vdbake_scene"], SCENE);
    assert_eq!(info["metadata"]["vdbake_content_hash"], report["content_hash"]);
    assert_eq!(info["metadata"]["creator"], concat!("vdbake ", env!("CARGO_PKG_VERSION")));
    let settings = info["metadata"]["vdbake_settings"].as_str().expect("text");
    let settings: Value = serde_json::from_str(settings).expect("JSON");
    for (name, value) in [("voxel_size", 0.125), ("time", -0.5), ("cutoff", 0.0)] {
        assert_eq!(settings[name], value);
    }
    assert_eq!((&settings["compression"], &settings["precision"]), (&"zip".into(), &"f16".into()));
    let grid = &info["grids"][0];
    assert_eq!(grid["name"], "density");
    assert_eq!(grid["class"], "fog volume");
    assert_eq!((&grid["type"], &grid["half"]), (&"Tree_float_5_4_3".into(), &true.into()));
    assert_eq!(grid["compression"], "zip + active values");
    assert_eq!(grid["active_voxels"], report["active_voxels"]);
    // A voxel's value is that of its centre.
    assert_eq!(grid["voxel_size"], serde_json::json!([0.125, 0.125, 0.125]));
    assert_eq!(grid["translation"], serde_json::json!([0.0625, 0.0625, 0.0625]));
}

#[test]
fn info_shortens_the_recipe_for_people() {
    let folder = Folder::new();
    folder.json(&["bake", "bent.toml"]);
    let file = text(&folder.run(&["info", "bent.vdb"]));
    assert!(file.contains("grid \"density\"") && file.contains("name = \"bent\" ..."), "{file}");
    let scene = text(&folder.run(&["info", "bent.toml"]));
    assert!(scene.contains("1 segment") && scene.contains("multiply perlin of 5 octaves"), "{scene}");
    let scene = folder.json(&["info", "bent.toml"]);
    assert_eq!(scene["kind"], "scene");
    assert_eq!(scene["tubes"][0]["radius"], serde_json::json!([0.3, 0.3]));
}

#[test]
fn a_vdb_file_is_known_by_its_content() {
    let folder = Folder::new();
    folder.json(&["bake", "bent.toml"]);
    folder.put("volume", folder.get("bent.vdb"));
    assert_eq!(folder.json(&["info", "volume"])["kind"], "vdb");
}

#[test]
fn plan_bounds_what_the_bake_takes() {
    let folder = Folder::new();
    for form in crate::support::FORMS {
        let with = |command| folder.json(&[&[command, "bent.toml"][..], &form].concat());
        let (plan, bake) = (with("plan"), with("bake"));
        assert_eq!(plan["planned_bricks"], bake["planned_bricks"]);
        assert!(number(&bake["bytes"]) <= number(&plan["at_most"]["bytes"]), "{form:?}");
        assert!(number(&bake["active_voxels"]) <= number(&plan["at_most"]["active_voxels"]));
        // All bricks are in the sample, so nothing but the bytes of nodes is left to estimate.
        assert_eq!(plan["estimated"]["sampled_bricks"], plan["planned_bricks"]);
        assert_eq!(plan["estimated"]["active_voxels"], bake["active_voxels"]);
        assert!(number(&plan["estimated"]["bytes"]) <= number(&plan["at_most"]["bytes"]));
    }
    assert_eq!(folder.made(), ["bent.vdb"]);
}

#[test]
fn plan_knows_the_length_of_an_empty_file() {
    let folder = Folder::new();
    folder.put("empty.toml", "");
    folder.put("missed.toml", SCENE.replace("[bake]", "[bake]\nwiden = false\nantialias = \"off\""));
    // Without bricks nothing of the file depends on the density.
    for arguments in [&["empty.toml"][..], &["missed.toml", "--voxel-size", "100"]] {
        let with = |command| folder.json(&[&[command], arguments].concat());
        let (plan, bake) = (with("plan"), with("bake"));
        assert_eq!(number(&plan["planned_bricks"]), 0);
        assert_eq!(plan["at_most"]["bytes"], bake["bytes"]);
        assert_eq!(plan["estimated"]["bytes"], bake["bytes"]);
    }
}

#[test]
fn a_bake_takes_no_more_memory_than_its_plan_says() {
    if cfg!(not(target_os = "linux")) {
        // Elsewhere nothing is measured.
        return;
    }
    let folder = Folder::new();
    for scene in crate::support::scenes() {
        let scene = scene.to_str().expect("UTF-8");
        let forms = crate::support::FORMS;
        for (resolution, form) in [("48", forms[0]), ("200", forms[2]), ("200", forms[5])] {
            let settings = ["--resolution", resolution, "--threads", "3"];
            let with = |command| folder.json(&[&[command, scene][..], &settings, &form].concat());
            let most = number(&with("plan")["at_most"]["memory_bytes"]);
            let peak = number(&with("bake")["peak_rss_bytes"]);
            assert!(peak <= most, "{scene} at {resolution}: {peak} bytes, at most {most}");
        }
    }
}

#[test]
fn limits_are_those_of_the_scene_and_exact() {
    let folder = Folder::new();
    for arguments in [
        &["--time", "1e9", "--resolution", "8"][..],
        &["--time", "-1e9", "--resolution", "8"],
        &["--voxel-size", "1e9"],
    ] {
        folder.json(&[&["plan", "bent.toml"], arguments].concat());
    }
    for (option, value, range) in [
        ("--time", "1.001e9", "from -1e9 to 1e9"),
        ("--voxel-size", "1.001e9", "(1e-9 to 1e9)"),
        ("--voxel-size", "-1", "(1e-9 to 1e9)"),
        ("--resolution", "-1", "from 1 to 1000000"),
        ("--memory", "-1", "at least 0"),
        ("--threads", "-1", "from 1 to 4096"),
    ] {
        let output = folder.run(&["plan", "bent.toml", option, value]);
        assert_eq!(code(&output), 2);
        assert!(errors(&output).contains(range), "{}", errors(&output));
    }
}

#[test]
fn a_grid_without_active_voxels_is_noted() {
    let folder = Folder::new();
    folder.put("faint.toml", SCENE.replace("resolution = 48", "resolution = 48\ncutoff = 1000"));
    let output = folder.run(&["bake", "faint.toml"]);
    assert_eq!(code(&output), 0);
    assert!(errors(&output).contains("note: no voxel is active"), "{}", errors(&output));
    let faded = "[bake]\nresolution = 48\n[[tube]]\ncurve = { points = [[0, 0, 0], [1, 0, 0], [2, 0, 0]] }\n[[tube.layer]]\nfrequency = 1000\n";
    folder.put("faded.toml", faded);
    let output = folder.run(&["bake", "faded.toml"]);
    assert!(errors(&output).contains("no voxel is active: all octaves of layer 1"), "{}", errors(&output));
    let output = folder.run(&["bake", "bent.toml"]);
    assert!(!errors(&output).contains("note"), "{}", errors(&output));
}

#[test]
fn flips_of_frenet_frames_are_told() {
    let folder = Folder::new();
    let scene = |points: &str, frame: &str| {
        format!(
            "[[tube]]\nname = \"bend\"\ncurve = {{ kind = \"cubic\", points = {points} }}\nframe = {frame:?}\n"
        )
    };
    let s = "[[0, 0, 0], [1, 2, 0], [2, -2, 0], [3, 0, 0]]";
    folder.put("s.toml", scene(s, "frenet"));
    folder.put("smooth.toml", scene(s, "rotation-minimising"));
    folder.put("arc.toml", scene("[[0, 0, 0], [1, 1, 0], [2, 1, 0], [3, 0, 0]]", "frenet"));
    for command in ["bake", "plan"] {
        let arguments = [command, "s.toml", "--resolution", "32"];
        let output = folder.run(&arguments);
        let expected = "warning: the Frenet frame flips at l = 0.5000";
        let errors_of_it = errors(&output);
        let told: Vec<&str> = errors_of_it.lines().filter(|line| line.starts_with("warning")).collect();
        assert!(code(&output) == 0 && told.len() == 1 && told[0].starts_with(expected), "{errors_of_it}");
        assert!(errors_of_it.contains("and the noise with it; \"rotation-minimising\" does not"));
        let quiet = [&arguments[..], &["--quiet"]].concat();
        assert_eq!(errors(&folder.run(&quiet)), "");
        let report = folder.json(&quiet);
        let warnings = report["warnings"].as_array().expect("a list");
        let [warning] = warnings.as_slice() else { panic!("one warning") };
        assert!(warning.as_str().is_some_and(|text| text.contains("flips at l = 0.5000")), "{warning}");
        for fine in ["smooth.toml", "arc.toml"] {
            let arguments = [command, fine, "--resolution", "32"];
            assert!(!errors(&folder.run(&arguments)).contains("warning"));
            assert_eq!(folder.json(&arguments)["warnings"], Value::Array(vec![]));
        }
    }
}

#[test]
fn memory_is_told_in_the_units_it_was_given_in() {
    let folder = Folder::new();
    for (given, told) in [("10MB", "10.0 MB"), ("10MiB", "10.0 MiB")] {
        let output = folder.run(&["plan", "bent.toml", "--voxel-size", "0.004", "--memory", given]);
        assert_eq!(code(&output), 1);
        assert!(errors(&output).contains(told), "{}", errors(&output));
    }
}

#[test]
fn over_budget_names_a_voxel_size_that_fits() {
    let folder = Folder::new();
    folder.put("bent.vdb", "an earlier file");
    for size in ["0.004", "0.0001", "1e-6"] {
        let output =
            folder.run(&["bake", "bent.toml", "--memory", "18MiB", "--threads", "2", "--voxel-size", size]);
        let message = errors(&output);
        assert_eq!(code(&output), 1, "{message}");
        assert!(message.contains("bricks") && message.contains("18.0 MiB"), "{message}");
        assert_eq!(folder.get("bent.vdb"), b"an earlier file");

        let (_, rest) = message.split_once("--voxel-size ").unwrap_or_else(|| panic!("{message}"));
        let fits = rest.split_whitespace().next().expect("a size");
        let report = folder.json(&[
            "bake",
            "bent.toml",
            "--memory",
            "18MiB",
            "--threads",
            "2",
            "--voxel-size",
            fits,
            "-o",
            "fits.vdb",
        ]);
        // Not so large that it would fit many times over.
        assert!(number(&report["planned_bricks"]) > 200, "{message}");
    }
    assert_eq!(folder.made(), ["bent.vdb", "fits.vdb"]);
    // The program itself takes more.
    for memory in ["1", "4MiB"] {
        let output = folder.run(&["bake", "bent.toml", "--memory", memory]);
        assert_eq!(code(&output), 1);
        assert!(errors(&output).contains("no voxel size fits"), "{}", errors(&output));
    }
}

#[test]
fn beyond_the_range_of_indices_is_an_error() {
    let folder = Folder::new();
    let far = SCENE
        .replace("[0, 0, 0], [0.5, 0, 1]", "[1e9, 0, 0], [1e9, 0, 1]")
        .replace("[0, 0, 2]", "[1e9, 0, 2]");
    folder.put("far.toml", far);
    let output = folder.run(&["bake", "far.toml", "--voxel-size", "0.01"]);
    assert_eq!(code(&output), 1);
    assert!(errors(&output).contains("2^31"), "{}", errors(&output));
    assert_eq!(folder.made(), ["far.toml"]);

    let wide = SCENE.replace("1], [0, 0, 2]", "1e6], [0, 0, 2e6]");
    folder.put("wide.toml", wide.replace("radius = 0.3", "radius = 1e4"));
    for (name, size, limit) in [("far.toml", "0.01", "2^31"), ("wide.toml", "1e-2", "2^24")] {
        let message = errors(&folder.run(&["plan", name, "--voxel-size", size, "--memory", "20MiB"]));
        let (error, hint) = message.split_once("--voxel-size ").unwrap_or_else(|| panic!("{message}"));
        assert!(error.contains(limit), "{message}");
        let fits = hint.split_whitespace().next().expect("a size");
        let plan = folder.json(&["plan", name, "--voxel-size", fits, "--memory", "20MiB"]);
        assert!(number(&plan["planned_bricks"]) > 0, "{message}");
    }
}

#[test]
fn a_folder_that_cannot_take_the_file_is_an_error() {
    let folder = Folder::new();
    fs::create_dir(folder.path("folder.vdb")).expect("a folder");
    for path in ["missing/bent.vdb", "bent.toml/bent.vdb", "folder.vdb"] {
        let output = folder.run(&["bake", "bent.toml", "-o", path]);
        assert_eq!((code(&output), text(&output).as_str()), (1, ""), "{path}");
        assert!(!errors(&output).contains("Progress"), "found out before the work: {}", errors(&output));
    }
    assert_eq!(folder.made(), ["folder.vdb"]);
}

#[test]
fn an_empty_scene_makes_an_empty_grid() {
    let folder = Folder::new();
    folder.put("empty.toml", "");
    let output = folder.run(&["bake", "empty.toml", "--resolution", "10"]);
    assert_eq!((code(&output), errors(&output).starts_with("note: ")), (0, true));
    let info = folder.json(&["info", "empty.vdb"]);
    assert_eq!(info["grids"][0]["active_voxels"], 0);
    assert_eq!(info["grids"][0]["bbox"], Value::Null);
    assert_eq!(info["grids"][0]["voxel_size"][0], 0.1);
    let report = folder.json(&["bake", "empty.toml"]);
    assert_eq!((number(&report["active_voxels"]), &report["bounds"]), (0, &Value::Null));
    assert_eq!(number(&folder.json(&["plan", "empty.toml"])["planned_bricks"]), 0);
    assert_eq!(code(&folder.run(&["info", "empty.toml"])), 0);
}

#[cfg(unix)]
#[test]
fn an_existing_file_is_replaced_as_a_whole() {
    use std::os::unix::fs::{MetadataExt, symlink};
    let folder = Folder::new();
    fs::create_dir(folder.path("store")).expect("a folder");
    folder.put("store/real.vdb", "an earlier file");
    symlink("store/real.vdb", folder.path("bent.vdb")).expect("a link");
    folder.json(&["bake", "bent.toml"]);
    let is_link = |name: &str| fs::symlink_metadata(folder.path(name)).expect("a file").is_symlink();
    assert!(is_link("bent.vdb") && !is_link("store/real.vdb"));
    assert!(folder.get("store/real.vdb").starts_with(b" BDV"));
    // Readable to whom a file made in the ordinary way is.
    let mode = |name: &str| fs::metadata(folder.path(name)).expect("a file").mode();
    assert_eq!(mode("store/real.vdb"), mode("bent.toml"));
    assert_eq!(folder.made(), ["bent.vdb", "store"]);
}

#[cfg(unix)]
#[test]
fn a_closed_pipe_is_no_failure() {
    let folder = Folder::new();
    for arguments in [&["info", "bent.toml"][..], &["bake", "bent.toml", "--json"]] {
        let mut child =
            folder.command(arguments).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().expect("starts");
        drop(child.stdout.take());
        let output = child.wait_with_output().expect("ends");
        assert_eq!(code(&output), 0, "{}", errors(&output));
    }
}

#[cfg(unix)]
#[test]
fn a_signal_leaves_nothing_behind() {
    let folder = Folder::new();
    folder.put("bent.vdb", "an earlier file");
    for signal in ["-INT", "-TERM"] {
        // Some seconds of work.
        let child = folder
            .command(&["bake", "bent.toml", "--voxel-size", "0.0015", "--memory", "8GiB", "--quiet"])
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .expect("starts");
        wait_for(|| folder.made().len() == 2);
        let killed = Command::new("kill").args([signal, &child.id().to_string()]).status().expect("kill");
        assert!(killed.success(), "the bake was over too soon");
        let output = child.wait_with_output().expect("ends");
        assert_eq!(output.status.code(), Some(130), "{}", errors(&output));
        assert_eq!(errors(&output), "error: interrupted\n");
        assert_eq!(folder.made(), ["bent.vdb"]);
        assert_eq!(folder.get("bent.vdb"), b"an earlier file");
    }
}

#[cfg(unix)]
pub(crate) fn wait_for(condition: impl Fn() -> bool) {
    // Far beyond what a busy machine takes; only a failure waits that long.
    for _ in 0..12_000 {
        if condition() {
            return;
        }
        std::thread::sleep(std::time::Duration::from_millis(5));
    }
    panic!("waited in vain");
}

#[test]
fn scenes_of_the_project_can_be_planned() {
    let folder = Folder::new();
    for path in crate::support::scenes() {
        let plan = folder.json(&["plan", path.to_str().expect("UTF-8")]);
        assert!(number(&plan["estimated"]["active_voxels"]) > 0, "{}", path.display());
    }
}

#[test]
fn info_shows_what_comes_before_the_end_of_a_cut_file() {
    let folder = Folder::new();
    folder.json(&["bake", "bent.toml"]);
    let bytes = fs::read(folder.path("bent.vdb")).expect("the file");
    folder.put("cut.vdb", &bytes[..bytes.len() - 100]);
    let output = folder.run(&["info", "cut.vdb"]);
    assert_eq!(code(&output), 3);
    let shown = text(&output);
    assert!(shown.contains("grid \"density\", cut short") && shown.contains("voxel size"), "{shown}");
    let message = errors(&output);
    assert!(message.starts_with("error: cannot read cut.vdb to its end: truncated VDB file: "), "{message}");
    let output = folder.run(&["info", "cut.vdb", "--json"]);
    assert_eq!(code(&output), 3);
    let report: Value = serde_json::from_slice(&output.stdout).expect("one JSON object");
    assert_eq!((&report["grids"][0]["whole"], &report["out_of_reach"]), (&false.into(), &0.into()));
    assert!(report["error"].as_str().is_some_and(|error| error.contains("beyond the end")), "{report}");
    assert_eq!(folder.json(&["info", "bent.vdb"])["error"], Value::Null);
}
