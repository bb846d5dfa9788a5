//! `--memory` is a cap: what a bake takes stays below it, its file stays the same, and what has no room in it goes to a
//! temporary file beside the output that nobody sees.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use serde_json::Value;

use crate::cli::{Folder, code, errors, number};
use crate::support::FORMS;

/// Voxels along the longest side: enough for encoded leaves to be several times what all else takes.
const RESOLUTION: &str = "800";
pub(crate) const NONE: &str = "--compression=none";

fn galaxy() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/galaxy.toml")
}

/// `vdbake`, for the galaxy in a folder of its own.
fn command(folder: &Folder, command: &str, options: &[&str]) -> Command {
    command_at(RESOLUTION, folder, command, options)
}

pub(crate) fn command_at(resolution: &str, folder: &Folder, command: &str, options: &[&str]) -> Command {
    let mut vdbake = folder.command(&[command]);
    vdbake.arg(galaxy()).args(["--resolution", resolution, "--json", "--quiet"]).args(options);
    vdbake
}

fn report(folder: &Folder, name: &str, options: &[&str]) -> Value {
    let output = command(folder, name, options).output().expect("the program starts");
    assert_eq!(code(&output), 0, "{options:?}: {}", errors(&output));
    serde_json::from_slice(&output.stdout).expect("one JSON object")
}

/// As small a cap as a bake with these options takes.
fn least(folder: &Folder, options: &[&str]) -> u64 {
    number(&report(folder, "plan", options)["least_memory_bytes"])
}

/// Peaks are measured on Linux alone.
fn assert_below(report: &Value, cap: u64) {
    if cfg!(target_os = "linux") {
        let peak = number(&report["peak_rss_bytes"]);
        assert!(peak <= cap, "{peak} bytes of {cap}");
    }
}

#[test]
fn the_file_is_the_same_with_and_without_a_spool() {
    let folder = Folder::new();
    for form in FORMS {
        let options = |threads| [&form[..], &["--threads", threads]].concat();
        let free = report(&folder, "bake", &options("2"));
        let whole = folder.get("galaxy.vdb");
        assert_eq!((number(&free["spooled_bytes"]), number(&free["bytes"])), (0, whole.len() as u64));
        for threads in ["1", "2", "7"] {
            let options = options(threads);
            let cap = least(&folder, &options);
            let capped = report(&folder, "bake", &[&options[..], &["--memory", &cap.to_string()]].concat());
            assert!(number(&capped["spooled_bytes"]) > number(&capped["bytes"]) / 2, "{form:?}: {capped}");
            assert_eq!(capped["content_hash"], free["content_hash"]);
            assert!(folder.get("galaxy.vdb") == whole, "{form:?} on {threads} threads");
            assert_below(&capped, cap);
        }
    }
    assert_eq!(folder.made(), ["galaxy.vdb"]);
}

#[test]
fn a_scene_larger_than_the_cap_stays_below_it() {
    let folder = Folder::new();
    let least = least(&folder, &[NONE, "--threads=2"]);
    // The least there is, and some that leave room for a part of the leaves.
    for more in [0, 1 << 20, 8 << 20] {
        let cap = least + more;
        let baked = report(&folder, "bake", &[NONE, "--threads=2", "--memory", &cap.to_string()]);
        assert!(more > 0 || 2 * number(&baked["bytes"]) > 3 * cap, "{baked}");
        assert!(number(&baked["spooled_bytes"]) > 0);
        assert_below(&baked, cap);
    }
    let cap = (least - 1).to_string();
    let output = command(&folder, "bake", &[NONE, "--threads=2", "--memory", &cap]).output().expect("starts");
    assert_eq!(code(&output), 1);
    let message = errors(&output);
    assert!(message.contains("even with all values on disk"), "{message}");
    assert!(message.contains("--voxel-size ") && message.contains("--memory"), "{message}");
}

/// With a cap and without, for scenes of which it bakes a sample only.
/// Of each there is something to say, at its place in a long text.
#[test]
fn scenes_of_many_tubes_stay_below_the_cap() {
    let folder = Folder::new();
    let tube = |n: i32| {
        let [x, y, z] = [n % 11, n / 11 % 11, n / 121];
        format!(
            "[[tube]]\nradius = 0.02\ncurve = {{ points = [[{x}, {y}, {z}.00], [{x}.01, {y}.02, {z}.00], [{x}, {y}, {z}.1]] }}\n"
        )
    };
    folder.put("many.toml", (0..1500).map(tube).collect::<String>());
    let cap = 100;
    let bake = ["bake", "many.toml", "--resolution", "1200", "--json", "--quiet", "--threads", "2"];
    let output = folder.run(&[&bake[..], &["--memory", &format!("{cap}MiB")]].concat());
    assert_eq!(code(&output), 0, "{}", errors(&output));
    let report = serde_json::from_slice(&output.stdout).expect("one JSON object");
    assert_below(&report, cap << 20);
}

#[test]
fn a_plan_foretells_what_the_bake_takes() {
    let folder = Folder::new();
    for (scene, resolution) in [("galaxy", "1400"), ("tornado", "700"), ("trefoil", "1000")] {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("scenes/{scene}.toml"));
        let with = |name, options: &[&str]| {
            let path = path.to_str().expect("UTF-8");
            folder.json(&[&[name, path, "--resolution", resolution, "--threads", "2"], options].concat())
        };
        let least = number(&with("plan", &[])["least_memory_bytes"]);
        for options in [&[][..], &["--memory", &(least + (16 << 20)).to_string()]] {
            let (plan, bake) = (with("plan", options), with("bake", options));
            let estimated = &plan["estimated"];
            assert!(
                number(&estimated["sampled_bricks"]) < number(&plan["planned_bricks"]),
                "{scene}: a sample"
            );
            let within = |name: &str, found: &Value, part: f64| {
                #[allow(clippy::cast_precision_loss, reason = "far below 2^53")]
                let [foretold, found] = [&estimated[name], found].map(|n| number(n) as f64);
                assert!(
                    (foretold - found).abs() <= part * found,
                    "{scene} {options:?}: {name} {foretold}, and {found} in fact"
                );
            };
            within("bytes", &bake["bytes"], 0.05);
            within("active_voxels", &bake["active_voxels"], 0.05);
            if cfg!(target_os = "linux") {
                within("memory_bytes", &bake["peak_rss_bytes"], 0.1);
            }
            assert!(number(&bake["spooled_bytes"]) <= number(&plan["at_most"]["spooled_bytes"]));
            assert_eq!(number(&bake["spooled_bytes"]) > 0, !options.is_empty());
        }
    }
}

/// Where all bricks are sampled nothing is left to guess but the memory. What takes little of that besides the process is the
/// hardest to foretell.
#[test]
fn a_plan_foretells_small_bakes_to_the_byte() {
    let folder = Folder::new();
    let scenes = crate::support::scenes_with_tiles(&folder.path(""));
    for scene in &scenes {
        let with = |name, options: &[&str]| {
            let path = scene.to_str().expect("UTF-8");
            folder.json(&[&[name, path, "--resolution", "128", "--threads", "2"], options].concat())
        };
        let name = scene.display();
        for options in [&[][..], &["--precision", "f16", "--compression", "none"], &["--compression", "zip"]]
        {
            let (plan, bake) = (with("plan", options), with("bake", options));
            let estimated = &plan["estimated"];
            // A slow machine may not come to all of them.
            if estimated["sampled_bricks"] == plan["planned_bricks"] {
                assert_eq!(estimated["bytes"], bake["bytes"], "{name} {options:?}");
                assert_eq!(estimated["active_voxels"], bake["active_voxels"], "{name}");
            }
            let [foretold, found] = [&estimated["bytes"], &bake["bytes"]].map(number);
            assert!(
                foretold.abs_diff(found) <= found / 20,
                "{name} {options:?}: {foretold} bytes, and {found} in fact"
            );
            if cfg!(target_os = "linux") {
                // How much is in flight at once is up to how the system runs the threads, and how much of the program's own file
                // is in memory to what else is: mostly some hundred kB either way, of 10 MB; of three runs not in all more.
                let is_close = |plan: &Value, bake: &Value| {
                    let [foretold, found] =
                        [&plan["estimated"]["memory_bytes"], &bake["peak_rss_bytes"]].map(number);
                    foretold.abs_diff(found) <= (found / 10).max(1 << 20)
                };
                let again = || is_close(&with("plan", options), &with("bake", options));
                assert!(is_close(&plan, &bake) || again() || again(), "{name} {options:?}: {plan} {bake}");
            }
        }
    }
}

/// Frame after frame, each larger than the one before, on the threads of one process: what one frame gives back must be of use
/// to the next, whichever thread had it.
#[test]
fn sequences_stay_below_the_cap() {
    let folder = Folder::new();
    let scene = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/tornado.toml");
    let scene = scene.to_str().expect("UTF-8");
    for threads in ["2", "7"] {
        let options = [scene, "--resolution", "700", "--threads", threads];
        let least = number(&folder.json(&[&["plan"], &options[..]].concat())["least_memory_bytes"]);
        let cap = least + (1 << 20);
        let capped =
            ["--json", "--quiet", "--frames", "1-13", "--memory", &cap.to_string(), "-o", "f.##.vdb"];
        let mut vdbake = folder.command(&["bake"]);
        let output = vdbake.args(options).args(capped).output().expect("the program starts");
        assert_eq!(code(&output), 0, "{}", errors(&output));
        let frames: Vec<Value> = serde_json::Deserializer::from_slice(&output.stdout)
            .into_iter()
            .collect::<Result<_, _>>()
            .expect("one JSON object for each frame");
        assert_eq!(frames.len(), 13);
        for frame in &frames {
            assert!(number(&frame["spooled_bytes"]) > 10 << 20);
            assert_below(frame, cap);
        }
    }
}

#[test]
fn a_plan_tells_what_each_compression_costs() {
    let folder = Folder::new();
    let plan = report(&folder, "plan", &["--compression=zip"]);
    let ways = plan["estimated"]["compressions"].as_array().expect("a list");
    let names: Vec<&str> = ways.iter().filter_map(|way| way["compression"].as_str()).collect();
    assert_eq!(names, ["blosc", "zip", "none"]);
    assert_eq!(ways[1]["bytes"], plan["estimated"]["bytes"]);
    for (name, way) in names.iter().zip(ways) {
        let baked = report(&folder, "bake", &["--compression", name]);
        let [foretold, found] = [&way["bytes"], &baked["bytes"]].map(number);
        // Of one brick in eight.
        assert!(foretold.abs_diff(found) <= found / 10, "{name}: {foretold}, and {found} in fact");
    }
}

/// What a failed bake leaves: the older file.
fn assert_intact(folder: &Folder) {
    assert_eq!(folder.made(), ["galaxy.vdb"]);
    assert_eq!(folder.get("galaxy.vdb"), b"an earlier file");
}

/// A command as it is, after a shell has set a limit.
#[cfg(unix)]
pub(crate) fn limited(limit: &str, command: &Command) -> Command {
    let mut shell = Command::new("bash");
    shell.args(["-c", &format!("{limit}; exec \"$@\""), "bash"]);
    shell.arg(command.get_program()).args(command.get_args()).stdin(Stdio::null());
    if let Some(folder) = command.get_current_dir() {
        shell.current_dir(folder);
    }
    shell
}

/// As on a full disk: no file may grow beyond a few MiB.
#[cfg(unix)]
#[test]
fn a_full_spool_leaves_the_older_file() {
    let folder = Folder::new();
    folder.put("galaxy.vdb", "an earlier file");
    let cap = least(&folder, &[NONE]).to_string();
    let bake = command(&folder, "bake", &[NONE, "--memory", &cap]);
    let output = limited("ulimit -f 4096", &bake).output().expect("bash starts");
    let message = errors(&output);
    assert_eq!(code(&output), 1, "{message}");
    assert!(message.contains("spool") && message.contains("-o") && message.contains("--memory"), "{message}");
    assert_intact(&folder);
}

/// A spool that somebody else cuts short while it is used, through the system's list of open files.
#[cfg(target_os = "linux")]
#[test]
fn a_spool_that_is_cut_short_leaves_the_older_file() {
    let folder = Folder::new();
    folder.put("galaxy.vdb", "an earlier file");
    let cap = least(&folder, &[NONE, "--threads=1"]).to_string();
    let child = command(&folder, "bake", &[NONE, "--threads=1", "--memory", &cap])
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .expect("starts");
    let files = PathBuf::from(format!("/proc/{}/fd", child.id()));
    let cut = || {
        let entries = fs::read_dir(&files).expect("a running process");
        let mut open = entries.filter_map(|entry| Some(entry.ok()?.path()));
        let spool = open.find(|file| {
            let nameless =
                fs::read_link(file).is_ok_and(|link| link.to_string_lossy().ends_with(" (deleted)"));
            nameless && fs::metadata(file).is_ok_and(|found| found.is_file() && found.len() > 1 << 20)
        });
        spool.is_some_and(|spool| fs::File::create(spool).is_ok())
    };
    crate::cli::wait_for(cut);
    let output = child.wait_with_output().expect("ends");
    let message = errors(&output);
    assert_eq!(code(&output), 1, "{message}");
    assert!(message.contains("spool") && message.contains("bake again"), "{message}");
    assert_intact(&folder);
}

/// Nothing can be cleared away then, but there is no partial file under the final name, and no spool.
#[cfg(target_os = "linux")]
#[test]
fn a_kill_leaves_the_older_file() {
    let folder = Folder::new();
    folder.put("galaxy.vdb", "an earlier file");
    let cap = least(&folder, &[NONE, "--threads=1"]).to_string();
    let mut child = command(&folder, "bake", &[NONE, "--threads=1", "--memory", &cap])
        .stdout(Stdio::null())
        .spawn()
        .expect("starts");
    crate::cli::wait_for(|| folder.made().len() == 2);
    child.kill().expect("still running");
    child.wait().expect("ends");
    assert_eq!(folder.get("galaxy.vdb"), b"an earlier file");
    let made = folder.made();
    let others: Vec<&String> = made.iter().filter(|name| *name != "galaxy.vdb").collect();
    assert!(matches!(others[..], [other] if other.starts_with(".galaxy.vdb-")), "{others:?}");
    assert_eq!(folder.get(others[0]), b"", "the file is put together at the end");
    // The next bake clears it away.
    let output = command_at("32", &folder, "bake", &[]).output().expect("the program starts");
    assert_eq!((code(&output), folder.made()), (0, vec!["galaxy.vdb".to_owned()]), "{}", errors(&output));
}

/// More than a billion active voxels within 1 GiB.
#[test]
#[ignore = "takes some minutes and 8 GB of disk"]
fn a_billion_voxels_within_a_gibibyte() {
    let folder = Folder::new();
    let with = |name, options: &[&str]| {
        let path = galaxy();
        let settings = [name, path.to_str().expect("UTF-8"), "--resolution", "5020"];
        folder.json(&[&settings[..], options].concat())
    };
    let cap = ["--memory", "1GiB"];
    let (plan, capped) = (with("plan", &cap), with("bake", &cap));
    assert!(number(&capped["active_voxels"]) > 1_000_000_000);
    assert!(number(&capped["spooled_bytes"]) > 1 << 30);
    assert_below(&capped, 1 << 30);
    for (name, found, percent) in [("bytes", "bytes", 5), ("memory_bytes", "peak_rss_bytes", 10)] {
        let [foretold, found] = [&plan["estimated"][name], &capped[found]].map(number);
        assert!(foretold.abs_diff(found) <= found * percent / 100, "{name}: {foretold}, and {found} in fact");
    }
}

/// Runs a shell's script where the folder `small` is a disk of its own of this size, on which an earlier file has this name.
/// Arguments of the command are the script's. It takes leave to mount.
#[cfg(target_os = "linux")]
pub(crate) fn on_small_disk(folder: &Folder, size: &str, older: &str, script: &str) -> Command {
    let small = folder.path("small");
    if !small.exists() {
        fs::create_dir(small).expect("a folder");
    }
    let script =
        format!("mount -t tmpfs -o size={size} tmpfs small && echo older > small/{older} && {script}");
    let mut unshare = Command::new("unshare");
    unshare.current_dir(folder.path("")).args(["--map-root-user", "--mount", "sh", "-c", &script, "sh"]);
    unshare
}

#[cfg(target_os = "linux")]
#[test]
fn a_bake_without_room_on_the_disk_is_not_begun() {
    let folder = Folder::new();
    let within = |script: &str| on_small_disk(&folder, "16m", "out.vdb", script);
    let mounted = within("true").output().expect("unshare starts");
    assert!(mounted.status.success(), "no leave to mount a small disk: {}", errors(&mounted));
    // The file alone has no room, with a spool and without; the file alone has, but not beside the spool.
    for (resolution, options, more_memory_helps) in [
        (RESOLUTION, &[NONE][..], false),
        (RESOLUTION, &[NONE, "--memory=40MiB"], false),
        ("550", &[NONE, "--threads=2", "--memory=20MiB"], true),
    ] {
        let bake = command_at(resolution, &folder, "bake", &[options, &["-o", "small/out.vdb"]].concat());
        let mut limited = within("{ \"$@\"; code=$?; cat small/out.vdb; ls -A small; exit $code; }");
        let output = limited.arg(bake.get_program()).args(bake.get_args()).output().expect("starts");
        let message = errors(&output);
        assert_eq!((code(&output), crate::cli::text(&output).as_str()), (1, "older\nout.vdb\n"), "{message}");
        assert!(message.contains("too little room on the disk") && message.contains("-o"), "{message}");
        assert_eq!(message.contains("--memory"), more_memory_helps, "{message}");
        assert_eq!(message.contains("meanwhile"), more_memory_helps, "{message}");
    }
}
