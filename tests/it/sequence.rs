//! Sequences of frames: which files they make, what is the same in all, and what is left when one fails.

use std::fs;
use std::process::{Command, Output, Stdio};

use serde_json::Value;

use crate::cli::{Folder, code, errors, number, text};

/// A bent tube that sways and turns, quick to bake, and without a length in frame 31.
const SCENE: &str = r#"
name = "sway"
[bake]
resolution = 32
[time]
fps = 10
start = 1
end = 20
[[tube]]
curve = { points = [[0, 0, 0], { centre = [0, 0, 1], arm = [0.5, 0, 0], period = 1.6 }, [0, 0, 2]] }
radius = { mean = 0.3, amplitude = 0.1, period = 1 }
spin = { keys = [[0, 0], [1, 2]] }
twist = 1
[[tube.layer]]
threshold = 0.0
scroll = [0, 0, 1]
"#;

/// One whose curve has no length from frame 31 on.
const VANISHING: &str = r#"
[bake]
voxel_size = 0.1
[time]
fps = 10
[[tube]]
radius = 0.2
[tube.curve]
points = [[0, 0, 0], [0, 0, { keys = [[0, 1], [3, 0]] }], [0, 0, { keys = [[0, 2], [3, 0]] }]]
"#;

fn folder() -> Folder {
    let folder = Folder::new();
    folder.put("sway.toml", SCENE);
    fs::remove_file(folder.path("bent.toml")).expect("a file");
    folder
}

/// What a command that succeeds prints with `--json`, an object a line.
fn lines(folder: &Folder, arguments: &[&str]) -> Vec<Value> {
    let output = folder.run(&[arguments, &["--json", "--quiet"]].concat());
    assert_eq!(code(&output), 0, "{}", errors(&output));
    text(&output).lines().map(|line| serde_json::from_str(line).expect("an object a line")).collect()
}

fn made(folder: &Folder) -> Vec<String> {
    folder.made().into_iter().filter(|name| name.ends_with(".vdb")).collect()
}

fn failure(output: &Output) -> (i32, String) {
    assert!(output.status.code().is_some());
    (code(output), errors(output))
}

#[test]
fn each_frame_has_a_file_and_a_line() {
    let folder = folder();
    let reports = lines(&folder, &["bake", "sway.toml", "--frames", "3,1-2,2"]);
    assert_eq!(made(&folder), ["sway.0001.vdb", "sway.0002.vdb", "sway.0003.vdb"]);
    let frames: Vec<_> = reports.iter().map(|report| number(&report["frame"])).collect();
    assert_eq!(frames, [3, 1, 2]);
    for report in &reports {
        let frame = number(&report["frame"]);
        assert_eq!(report["output"], format!("sway.000{frame}.vdb"));
        assert_eq!(report["time"].as_f64().expect("seconds"), (frame - 1) as f64 / 10.0);
        let info = folder.json(&["info", report["output"].as_str().expect("a name")]);
        assert_eq!(info["uuid"], report["uuid"]);
        let settings = info["metadata"]["vdbake_settings"].as_str().expect("text");
        let settings: Value = serde_json::from_str(settings).expect("JSON");
        assert_eq!((&settings["frame"], &settings["time"]), (&report["frame"], &report["time"]));
    }
    assert_eq!(
        reports.iter().map(|report| report["uuid"].as_str()).collect::<std::collections::BTreeSet<_>>().len(),
        3
    );
    assert_eq!(folder.json(&["bake", "sway.toml"])["frame"], Value::Null);
}

#[test]
fn names_hold_the_frames_number() {
    let folder = folder();
    let sizes = ["--voxel-size", "0.2"];
    lines(&folder, &[&["bake", "sway.toml", "--frames", "-11--9x2", "-o", "a#.vdb"][..], &sizes].concat());
    lines(&folder, &[&["bake", "sway.toml", "--frames=-1,0", "-o", "b.###.vdb"][..], &sizes].concat());
    assert_eq!(made(&folder), ["a-11.vdb", "a-9.vdb", "b.-001.vdb", "b.000.vdb"]);
    lines(&folder, &[&["bake", "sway.toml", "--frames", "all", "-o", "c##.vdb"][..], &sizes].concat());
    assert_eq!(made(&folder).iter().filter(|name| name.starts_with('c')).count(), 20);
}

#[test]
fn a_frame_is_the_scene_at_its_time() {
    let folder = folder();
    lines(&folder, &["bake", "sway.toml", "--frames", "4", "-o", "frame.#.vdb"]);
    let still = folder.json(&["bake", "sway.toml", "--time", "0.3", "-o", "still.vdb"]);
    let [frame, single] = ["frame.4.vdb", "still.vdb"].map(|name| folder.json(&["info", name]));
    assert_eq!(frame["metadata"]["vdbake_content_hash"], still["content_hash"]);
    assert_eq!(frame["grids"], single["grids"]);
    // All that differs in the file is the frame in the settings, and the UUID, which is as long as any.
    let [frame, single] = ["frame.4.vdb", "still.vdb"].map(|name| folder.get(name).len());
    assert_eq!(frame - single, r#","frame":4"#.len());
}

#[test]
fn a_frame_does_not_depend_on_the_others() {
    let folder = folder();
    lines(&folder, &["bake", "sway.toml", "--frames", "2-6x2", "-o", "a.#.vdb", "--threads", "1"]);
    lines(&folder, &["bake", "sway.toml", "--frames", "6,4", "-o", "b.#.vdb", "--threads", "3"]);
    for frame in [4, 6] {
        assert!(folder.get(&format!("a.{frame}.vdb")) == folder.get(&format!("b.{frame}.vdb")), "{frame}");
    }
}

/// The lattice hangs from the world, so nothing swims from frame to frame.
#[test]
fn all_frames_and_times_have_one_lattice() {
    let folder = folder();
    let mut lattices = Vec::new();
    let mut reports = lines(&folder, &["bake", "sway.toml", "--frames", "1-19x6"]);
    reports.push(folder.json(&["bake", "sway.toml", "--time", "0.77"]));
    for report in &reports {
        let grid = &folder.json(&["info", report["output"].as_str().expect("a name")])["grids"][0];
        lattices.push((grid["voxel_size"].clone(), grid["translation"].clone()));
        assert_eq!(grid["translation"][0].as_f64(), report["voxel_size"].as_f64().map(|size| 0.5 * size));
    }
    assert!(lattices.windows(2).all(|pair| pair[0] == pair[1]), "{lattices:?}");
    // Not one that each frame's own bounds would give.
    let side = |report: &Value| {
        let corner = |corner: usize, axis: usize| report["bounds"][corner][axis].as_f64().expect("bounds");
        corner(1, 2) - corner(0, 2)
    };
    assert!(reports.windows(2).any(|pair| side(&pair[0]) != side(&pair[1])));
    let own = folder.json(&["info", "sway.toml"]);
    assert_eq!(own["voxel_size"], reports[0]["voxel_size"]);
    assert_eq!((&own["start"], &own["end"]), (&Value::from(1), &Value::from(20)));
    let plan = lines(&folder, &["plan", "sway.toml", "--frames", "7"]);
    assert_eq!(plan[0]["voxel_size"], reports[0]["voxel_size"]);
    assert_eq!(plan[0]["planned_bricks"], reports[1]["planned_bricks"]);
    // Without a last frame it is that of the start.
    folder.put("open.toml", SCENE.replace("end = 20\n", ""));
    let open = folder.json(&["plan", "open.toml", "--time", "0.5"]);
    assert_eq!(open["voxel_size"], folder.json(&["plan", "open.toml"])["voxel_size"]);
    assert_ne!(open["voxel_size"], own["voxel_size"]);
}

/// Mass is compared with the cylinder that the tube was at its start, so a tube that grows thins out.
#[test]
fn a_tube_that_grows_keeps_its_mass() {
    let folder = folder();
    let text = r#"
[time]
fps = 1
end = 3
[[tube]]
radius = { keys = [[0, 0.2], [2, 0.3]] }
conserve = "full"
[tube.curve]
points = [[0, 0, 0], [0.5, 0, 1], [0, 0, 2]]
scale = { keys = [[0, 1], [2, 1.5]] }
"#;
    for (conserve, growth) in [("full", 1.0), ("off", 1.5 * 1.5 * 1.5)] {
        folder.put("grow.toml", text.replace("full", conserve));
        let reports = lines(&folder, &["bake", "grow.toml", "--frames", "all", "--voxel-size", "0.03"]);
        let mass = |frame: usize| reports[frame]["mass"]["baked"].as_f64().expect("a mass");
        // The density is smooth, and 13 voxels across the tube integrate it well; the whole of it grows alike, curvature
        // included, so that gain is everywhere that of volume.
        assert!(
            (mass(2) / mass(0) - growth).abs() < 0.01 * growth,
            "{conserve}: {} then {}",
            mass(0),
            mass(2)
        );
        assert_eq!(reports[0]["mass"]["rest"], reports[2]["mass"]["rest"]);
    }
}

#[test]
fn the_command_line_is_checked_first() {
    let folder = folder();
    folder.put("open.toml", SCENE.replace("end = 20\n", ""));
    for (arguments, hint) in [
        (
            &["bake", "sway.toml", "--frames", "1-2", "-o", "out.vdb"][..],
            "in the file's name: -o out.####.vdb\n",
        ),
        (
            &["bake", "sway.toml", "--frames", "1-2", "-o", "a#/o#.#.vdb"],
            "in the file's name: -o a#/o.####.vdb\n",
        ),
        (&["bake", "sway.toml", "--frames", "1-2", "-o", "out.####.exr"], "does not end in .vdb"),
        (&["bake", "sway.toml", "--frames", "1-2", "--time", "1"], "cannot be used with"),
        (&["bake", "sway.toml", "--frames", "2-1"], "2-1 ends before it begins"),
        (&["bake", "sway.toml", "--frames", "1-2x0"], "below 1"),
        (&["bake", "sway.toml", "--frames", "1..2"], "expected frames such as 1-240,"),
        (&["bake", "sway.toml", "--frames", ""], "expected frames such as 1-240,"),
        (&["plan", "sway.toml", "--frames", "1-1000001"], "-1000000 to 1000000"),
        (&["plan", "open.toml", "--frames", "all"], "`end = 240` in [time]"),
        (&["sample", "sway.toml", "--frames", "1"], "unexpected argument"),
    ] {
        let (code, message) = failure(&folder.run(arguments));
        assert!(code == 2 && message.contains(hint), "{arguments:?}: {code}, {message}");
    }
    assert_eq!(made(&folder), [""; 0]);
}

#[test]
fn no_frame_is_baked_before_all_are_valid() {
    let folder = folder();
    folder.put("vanishing.toml", VANISHING);
    let (code, message) = failure(&folder.run(&["bake", "vanishing.toml", "--frames", "29-31"]));
    assert!(code == 3 && message.contains("a segment without length"), "{message}");
    assert!(message.contains("this is 3 s after the start frame; nothing is wrong at 0 s"), "{message}");
    let (code, _) = failure(&folder.run(&["bake", "vanishing.toml", "--time", "3"]));
    assert_eq!((code, made(&folder)), (3, vec![]));
    assert_eq!(lines(&folder, &["bake", "vanishing.toml", "--frames", "29,30"]).len(), 2);
    // Where the voxel size depends on the scene's own frames, these are looked at first.
    let text =
        VANISHING.replace("voxel_size = 0.1", "resolution = 8").replace("fps = 10", "fps = 10\nend = 31");
    folder.put("vanishing.toml", text);
    let (code, message) = failure(&folder.run(&["plan", "vanishing.toml"]));
    assert!(code == 3 && message.contains("this is 3 s after"), "{message}");
}

#[test]
fn frames_that_are_done_stay_when_one_fails() {
    let folder = folder();
    fs::create_dir(folder.path("sway.0003.vdb")).expect("a folder");
    let output = folder.run(&["bake", "sway.toml", "--frames", "1-5,9", "--quiet"]);
    let expected = "error: sway.0003.vdb is not a regular file; frames 3-5,9 are missing\n\
                    hint: --frames=3-5,9 bakes those that are missing\n";
    assert_eq!(failure(&output), (5, expected.to_owned()));
    assert_eq!(text(&output).lines().count(), 2);
    assert_eq!(made(&folder), ["sway.0001.vdb", "sway.0002.vdb", "sway.0003.vdb"]);
    // The first to fail leaves nothing to keep.
    let output = folder.run(&["bake", "sway.toml", "--frames", "3-5", "--quiet"]);
    assert_eq!(failure(&output), (1, "error: sway.0003.vdb is not a regular file\n".to_owned()));
    fs::remove_dir(folder.path("sway.0003.vdb")).expect("a folder");
    lines(&folder, &["bake", "sway.toml", "--frames=3-5,9"]);
    assert_eq!(made(&folder).len(), 6);
}

#[cfg(unix)]
#[test]
fn a_signal_leaves_the_frames_that_are_done() {
    let folder = folder();
    // Some minutes of work.
    let child = folder
        .command(&["bake", "sway.toml", "--frames", "1-500", "--resolution", "100", "--quiet"])
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .expect("starts");
    crate::cli::wait_for(|| made(&folder).iter().any(|name| name == "sway.0002.vdb"));
    let killed = Command::new("kill").args(["-INT", &child.id().to_string()]).status().expect("kill");
    assert!(killed.success(), "the bake was over too soon");
    let output = child.wait_with_output().expect("ends");
    let (code, message) = failure(&output);
    let done = made(&folder);
    assert_eq!(folder.made().len(), done.len() + 1, "only the scene and whole files: {:?}", folder.made());
    let next = done.len() + 1;
    let expected = format!(
        "error: interrupted; frames {next}-500 are missing\nhint: --frames={next}-500 bakes those that are missing\n"
    );
    assert_eq!((code, message), (130, expected));
    for name in done {
        assert_eq!(folder.json(&["info", &name])["kind"], "vdb");
    }
}

#[test]
fn progress_is_that_of_the_whole_sequence() {
    let folder = folder();
    let output = folder.run(&["bake", "sway.toml", "--frames", "1-8"]);
    let progress = errors(&output);
    assert!(progress.lines().all(|line| line.starts_with("Progress: ")), "{progress}");
    assert!(progress.ends_with("Progress: 100.0%\n") && progress.lines().count() <= 20, "{progress}");
    let report = text(&output);
    let names: Vec<_> = report.lines().filter_map(|line| line.split_whitespace().next()).collect();
    assert_eq!(names[0], "sway.0001.vdb");
    assert!(
        names.len() == 9 && report.lines().last().is_some_and(|line| line.starts_with("8 frames")),
        "{report}"
    );
}

#[test]
fn a_plan_of_frames_adds_up() {
    let folder = folder();
    let plan = lines(&folder, &["plan", "sway.toml", "--frames", "1-3"]);
    let (total, frames) = plan.split_last().expect("lines");
    assert_eq!((frames.len(), number(&total["frames"])), (3, 3));
    let sum = |path: &str| frames.iter().map(|frame| number(frame.pointer(path).expect(path))).sum::<u64>();
    for path in ["/planned_bricks", "/at_most/bytes", "/at_most/active_voxels", "/estimated/bytes"] {
        assert_eq!(number(total.pointer(path).expect(path)), sum(path), "{path}");
    }
    let bakes = lines(&folder, &["bake", "sway.toml", "--frames", "1-3"]);
    for (frame, bake) in frames.iter().zip(&bakes) {
        assert!(number(&bake["bytes"]) <= number(&frame["at_most"]["bytes"]));
    }
    if cfg!(target_os = "linux") {
        // What one frame took is given back before the next.
        let peak = number(&bakes[2]["peak_rss_bytes"]);
        assert!(peak <= number(&total["at_most"]["memory_bytes"]), "{peak}");
    }
    let output = folder.run(&["plan", "sway.toml", "--frames", "1-3", "--quiet"]);
    assert_eq!(text(&output).lines().count(), 4, "{}", text(&output));
    assert_eq!(made(&folder).len(), 3);
}
