//! Seeds, and every input that ever brought a target down, through what the targets do with them.
//!
//! A test binary of its own, which counts what is allocated.

#[path = "bodies/mod.rs"]
mod bodies;

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::{env, fs};

use bodies::{BODIES, run};

/// Folders of each target's inputs: those to begin with, and those that it failed on.
const INPUTS: [&str; 2] = ["seeds", "crashes"];

/// Tells a process that it is to do the work itself.
const CHILD: &str = "VDBAKE_TEST_CHILD";

/// Does the work of a test in a process of its own: what others allocate is not counted, what the program prints is kept, and
/// a stack that overflows fails the test alone.
fn apart(test: &str, work: fn()) {
    if env::var_os(CHILD).is_some() {
        return work();
    }
    let output = Command::new(env::current_exe().expect("this program"))
        .args(["--exact", test, "--nocapture"])
        .env(CHILD, "1")
        // A backtrace takes more memory than all that is read.
        .env("RUST_BACKTRACE", "0")
        .output()
        .expect("this program starts");
    assert!(output.status.success(), "{}: {}", output.status, String::from_utf8_lossy(&output.stderr));
}

fn folder(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fuzz").join(name)
}

/// Paths in a folder, in order; none where it is not there.
fn paths(folder: &Path) -> Vec<PathBuf> {
    let Ok(entries) = fs::read_dir(folder) else { return vec![] };
    let mut paths: Vec<_> = entries.map(|entry| entry.expect("a readable folder").path()).collect();
    paths.sort();
    paths
}

fn name(path: &Path) -> String {
    path.file_name().expect("a file").to_string_lossy().into_owned()
}

/// Seeds are read, but for those named `bad-...`, which are refused. Crashes only have to come to an end.
#[test]
fn seeds_and_crashes_come_to_an_end() {
    apart("seeds_and_crashes_come_to_an_end", replay);
}

fn replay() {
    let mut faults = vec![];
    for (target, _) in BODIES {
        let seeds = paths(&folder("seeds").join(target));
        assert!(!seeds.is_empty(), "{target} has no seeds");
        for seed in seeds {
            let is_read = run(target, &fs::read(&seed).expect("readable"));
            if is_read == name(&seed).starts_with("bad-") {
                faults.push(format!("{} {}", seed.display(), if is_read { "is read" } else { "is refused" }));
            }
        }
        for crash in paths(&folder("crashes").join(target)) {
            run(target, &fs::read(&crash).expect("readable"));
        }
    }
    assert!(faults.is_empty(), "\n{}", faults.join("\n"));
}

/// What is named somewhere and not elsewhere would never be run.
#[test]
fn every_target_is_everywhere() {
    let known: BTreeSet<String> = BODIES.iter().map(|(name, _)| (*name).to_owned()).collect();
    for inputs in INPUTS {
        let found: BTreeSet<_> = paths(&folder(inputs)).iter().map(|path| name(path)).collect();
        assert!(found.is_subset(&known), "{inputs}: {found:?}");
    }
    let sources: BTreeSet<_> = paths(&folder("targets")).iter().map(|path| name(path)).collect();
    assert_eq!(sources, known.iter().map(|name| format!("{name}.rs")).collect());
    let manifest = fs::read_to_string(folder("Cargo.toml")).expect("a manifest");
    let named: BTreeSet<_> =
        manifest.lines().filter_map(|line| line.strip_prefix("path = \"targets/")).collect();
    assert_eq!(
        named,
        known
            .iter()
            .map(|name| format!("{name}.rs\""))
            .collect::<Vec<_>>()
            .iter()
            .map(String::as_str)
            .collect()
    );
    for target in known {
        let text = fs::read_to_string(folder("targets").join(format!("{target}.rs"))).expect("readable");
        assert!(text.contains(&format!("vdbake_fuzz::run(\"{target}\", data)")), "{target}");
    }
}

/// The stack of a test is a quarter of the program's.
#[test]
fn deep_nesting_does_not_overflow_the_stack() {
    apart("deep_nesting_does_not_overflow_the_stack", deep_nesting);
}

fn deep_nesting() {
    const DEEP: usize = 100_000;
    let nested = |open: &str, inside: &str, close: &str| {
        format!("{}{inside}{}", open.repeat(DEEP), close.repeat(DEEP))
    };
    for text in [
        format!("a = {}\n", nested("[", "", "]")),
        format!("a = {}\n", nested("{a=", "1", "}")),
        format!("a = {}\n", nested("[{a=", "1", "}]")),
        format!("a = {}\n", nested("[", "", "")),
        format!("a = {}\n", nested("{a=[", "", "")),
        format!("{} = 1\n", nested("a.", "a", "")),
        format!("[{}]\n", nested("a.", "a", "")),
        format!("[[{}]]\n", nested("a.", "a", "")),
        format!("[[tube]]\ncurve.{} = 1\n", nested("a.", "a", "")),
        format!("a = {{ {} = 1 }}\n", nested("a.", "a", "")),
    ] {
        assert!(!run("scene", text.as_bytes()), "{}", &text[..20]);
        assert!(!run("recipe", &[b"{}\xff", text.as_bytes()].concat()));
    }
    // Just below what the parser goes down to, through everything that is done with the document afterwards.
    for depth in [40, 60, 79] {
        run("scene", format!("a = {}{}\n", "[".repeat(depth), "]".repeat(depth)).as_bytes());
        run("scene", format!("a = {}\n", "[".repeat(depth)).as_bytes());
        run("scene", format!("{}a = 1\n", "a.".repeat(depth)).as_bytes());
    }
    for (open, close) in [("[", "]"), ("{\"a\":", "}"), ("[{\"a\":", "}]")] {
        let deep = nested(open, "1", close);
        assert!(!run("certificate", deep.as_bytes()));
        assert!(!run("certificate", format!("{{\"version\":1,\"settings\":{deep}}}").as_bytes()));
    }
}

/// Each is an error or a scene, in memory that its length bounds, and in time, too: the test would not come to an end.
#[test]
fn long_scenes_take_as_much_as_is_in_them() {
    apart("long_scenes_take_as_much_as_is_in_them", long_scenes);
}

fn long_scenes() {
    const MANY: usize = 100_000;
    let tube = "[[tube]]\ncurve = { points = [[0, 0, 0], [1, 0, 0], [2, 0, 1]] }\n";
    for (text, is_valid) in [
        ("[[tube]]\n".repeat(MANY), false),
        ("[[tube]]\n[[tube.layer]]\n".repeat(MANY / 2), false),
        (tube.repeat(1000), true),
        ((0..MANY).map(|key| format!("k{key} = 1\n")).collect(), false),
        ("a = 1\n".repeat(MANY), false),
        ("a = [\n".repeat(MANY), false),
        ("a = \"\n".repeat(MANY), false),
        (format!("[bake]\ngrids = [{}]\n", "1, ".repeat(MANY)), false),
        ("#\n".repeat(MANY), true),
        ("] ".repeat(MANY), false),
    ] {
        assert_eq!(run("scene", text.as_bytes()), is_valid, "{}", &text[..30]);
    }
}

/// What a few bytes announce is held against how many there are.
#[test]
fn announcements_take_no_memory() {
    apart("announcements_take_no_memory", announcements);
}

fn announcements() {
    for shape in
        ["1099511627776, 3", "18446744073709551615, 18446744073709551615", "4294967296, 4294967296, 3"]
    {
        let header = format!("{{'descr': '<f8', 'fortran_order': False, 'shape': ({shape}), }}\n");
        let length = u16::try_from(header.len()).expect("short").to_le_bytes();
        let bytes = [b"\x93NUMPY\x01\x00", &length[..], header.as_bytes(), &[0; 48]].concat();
        assert!(!run("npy", &bytes), "{shape}");
    }
    let seed = |name: &str| fs::read(folder("seeds").join(name)).expect("a seed");
    // The data window's right edge, and the lower: xMin, yMin, xMax, yMax after "box2i" and a length.
    let original = seed("exr/zip");
    let name = b"dataWindow\0box2i\0";
    let at =
        original.windows(name.len()).position(|window| window == name).expect("it is there") + name.len() + 4;
    for edges in [&[8][..], &[12], &[8, 12]] {
        let mut wide = original.clone();
        for edge in edges {
            wide[at + edge..at + edge + 4].copy_from_slice(&2_000_000_000_i32.to_le_bytes());
        }
        assert!(!run("exr", &wide));
    }
    assert!(!run("png", &seed("png/bad-giant")));
    // Counts of a file's metadata, of its grids, and of the root's tiles and children; lengths of texts.
    let original = seed("vdb/float-blosc");
    let metadata = 8 + 3 * 4 + 1 + 36;
    let tree = original.windows(5).position(|window| window == b"Tree_").expect("a grid");
    // One buffer, the background, no tile and one child.
    let start = [1_u32, 0.25_f32.to_bits(), 0, 1].map(u32::to_le_bytes);
    let root = original.windows(16).position(|window| window == start.as_flattened()).expect("a root");
    for at in [metadata, metadata + 4, tree - 4, root + 8, root + 12] {
        for count in [u32::MAX, 0x7fff_ffff, 0x0100_0000] {
            let mut bytes = original.clone();
            bytes[at..at + 4].copy_from_slice(&count.to_le_bytes());
            assert!(!run("vdb", &bytes), "{count} at {at}");
        }
    }
}
