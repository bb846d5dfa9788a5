//! What goes wrong around the program: disks that are full or take nothing, signals at any moment, too little memory, somebody
//! who removes its files, pipes that nobody reads, and another that makes the same file. After each of them there is no partial
//! file under a final name, an earlier file of that name is as it was, temporary files are gone or are cleared away by the next
//! run, and the exit code and the message tell what happened.
#![cfg(target_os = "linux")]

use std::fs;
use std::os::unix::process::ExitStatusExt;
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

use serde_json::Value;

use crate::cli::{Folder, code, errors, number, text, wait_for};
use crate::memory::{NONE, limited, on_small_disk};
use crate::support::{random, stdout};

/// A command that writes files, with the first of them.
struct Writer {
    arguments: &'static [&'static str],
    output: &'static str,
}

const fn writer(arguments: &'static [&'static str], output: &'static str) -> Writer {
    Writer { arguments, output }
}

/// Every command that writes files, and every kind of them. They go to the folder `small`.
const WRITERS: [Writer; 13] = [
    writer(&["bake", "bent.toml", "-o", "small/b.vdb"], "b.vdb"),
    writer(&["bake", "bent.toml", "-o", "small/c.vdb", "--certify", "--resolution", "24"], "c.vdb"),
    writer(&["bake", "bent.toml", "-o", "small/f.#.vdb", "--frames", "1-3"], "f.1.vdb"),
    writer(
        &["slice", "bent.toml", "-o", "small/s.##.exr", "--resolution", "300", "--planes", "80-160x40"],
        "s.80.exr",
    ),
    writer(&["slice", "bent.toml", "-o", "small/parts.exr"], "parts.exr"),
    writer(&["slice", "bent.toml", "-o", "small/atlas.png"], "atlas.png"),
    writer(&["render", "bent.toml", "-o", "small/r.exr", "--size", "64x64"], "r.exr"),
    writer(&["render", "bent.toml", "-o", "small/r.png", "--size", "256x256"], "r.png"),
    writer(&["convert", "in.vdb", "small/v.vol"], "v.vol"),
    writer(&["sample", "bent.toml", "--points", "points.csv", "-o", "small/v.csv"], "v.csv"),
    writer(&["sample", "bent.toml", "--points", "points.csv", "-o", "small/v.npy"], "v.npy"),
    writer(&["compare", "a.exr", "b.exr", "--difference", "small/d.exr"], "d.exr"),
    writer(
        &[
            "report",
            "bent.toml",
            "-o",
            "small/r.json",
            "--resolution",
            "16",
            "--time-limit",
            "1",
            "--repeats",
            "1",
            "--points",
            "1000",
            "--size",
            "16x16",
        ],
        "r.json",
    ),
];

/// A folder with all that these read.
fn folder() -> Folder {
    let folder = Folder::new();
    fs::create_dir(folder.path("small")).expect("a folder");
    folder.json(&["bake", "bent.toml", "-o", "in.vdb"]);
    for (name, size) in [("a.exr", "1"), ("b.exr", "2")] {
        folder.json(&["render", "in.vdb", "-o", name, "--size", "64x64", "--samples", size]);
    }
    let points: String = (0..1000).map(|i| format!("0.{i:03},0.1,1.{i:03}\n")).collect();
    folder.put("points.csv", points);
    folder
}

fn within(folder: &Folder) -> Vec<String> {
    let entries = fs::read_dir(folder.path("small")).expect("a folder");
    let mut names: Vec<String> =
        entries.map(|entry| entry.expect("an entry").file_name().into_string().expect("UTF-8")).collect();
    names.sort();
    names
}

/// That a command failed with an error for people, and did not abort or panic.
fn assert_failed(output: &Output, of: &[&str]) -> String {
    let message = errors(output);
    assert_eq!(output.status.code(), Some(1), "{of:?}: {:?} {message}", output.status);
    assert!(message.starts_with("error: ") || message.contains("\nerror: "), "{of:?}: {message}");
    assert!(!message.contains("panic"), "{of:?}: {message}");
    message
}

/// On a disk with room for 4 kB, and on one that is only to be read.
#[test]
fn disks_that_take_no_file_leave_the_older_one() {
    let folder = folder();
    let after = "{ \"$@\"; code=$?; ls -A small; cat small/*; exit $code; }";
    let read_only = format!("mount -o remount,ro small && {after}");
    for (disk, script, reason) in [("full", after, "room"), ("read-only", &read_only, "another folder")] {
        for Writer { arguments, output } in &WRITERS {
            let program = folder.command(&[*arguments, &["--quiet"]].concat());
            let found = on_small_disk(&folder, "8k", output, script)
                .arg(program.get_program())
                .args(program.get_args())
                .output()
                .expect("unshare starts");
            let message = assert_failed(&found, arguments);
            assert!(message.contains(reason), "{disk}, {arguments:?}: {message}");
            let left = stdout(&found);
            assert!(left.ends_with(&format!("{output}\nolder\n")), "{disk}, {arguments:?}: {left}");
        }
    }
}

/// A disk that is full in the midst of a file: none may grow beyond 4 kB.
#[test]
fn files_that_cannot_grow_leave_the_older_one() {
    let folder = folder();
    for Writer { arguments, output } in &WRITERS {
        folder.put(&format!("small/{output}"), "older");
        let found = limited("ulimit -f 4", &folder.command(&[*arguments, &["--quiet"]].concat()));
        let found = { found }.output().expect("bash starts");
        let message = assert_failed(&found, arguments);
        assert!(message.contains("make room on the disk"), "{arguments:?}: {message}");
        assert_eq!(within(&folder), [*output], "{arguments:?}");
        assert_eq!(folder.get(&format!("small/{output}")), b"older");
        fs::remove_file(folder.path(&format!("small/{output}"))).expect("a file");
    }
}

/// What is missing after a failure is told, and baked by the command that is told.
#[test]
fn a_sequence_goes_on_where_the_disk_became_full() {
    let folder = folder();
    let frames = |frames| ["bake", "bent.toml", "--frames", frames, "-o", "small/f.#.vdb", "--quiet"];
    let whole = folder.run(&frames("1-4"));
    assert_eq!(code(&whole), 0, "{}", errors(&whole));
    let file = |frame| folder.get(&format!("small/f.{frame}.vdb"));
    let expected = [1, 2, 3, 4].map(file);
    let room = (expected[0].len() + expected[1].len() + expected[2].len() / 2) / 1024;
    // The rest runs on the same small disk after it has been made larger.
    let script = "{ \"$@\"; echo $? >&2; mount -o remount,size=64m small; }";
    let program = folder.command(&frames("1-4"));
    let command = |rest: &str| {
        let mut command = on_small_disk(&folder, &format!("{room}k"), "other", &format!("{script}; {rest}"));
        command.arg(program.get_program()).args(program.get_args());
        command
    };
    let failed = command("ls -A small").output().expect("unshare starts");
    let message = errors(&failed);
    assert!(message.contains("frames 3,4 are missing") && message.ends_with("\n5\n"), "{message}");
    assert_eq!(text(&failed).lines().skip(2).collect::<Vec<_>>(), ["f.1.vdb", "f.2.vdb", "other"]);
    let option = message.split_whitespace().find(|word| word.starts_with("--frames=")).expect("a hint");
    let rest = format!(
        "{} bake bent.toml {option} -o 'small/f.#.vdb' --quiet > rest.txt; cat small/f.*",
        env!("CARGO_BIN_EXE_vdbake")
    );
    let resumed = command(&rest).output().expect("unshare starts");
    // What the frames of the first run say comes before.
    assert!(resumed.status.success() && resumed.stdout.ends_with(&expected.concat()), "{}", errors(&resumed));
}

/// A temporary name of a file.
fn is_temporary(name: &str, output: &str) -> bool {
    let random = name.strip_prefix(&format!(".{output}-")).and_then(|name| name.strip_suffix(".vdbake-tmp"));
    random.is_some_and(|random| random.len() == 8)
}

fn start(folder: &Folder, arguments: &[&str]) -> Child {
    let mut command = folder.command(&[arguments, &["--quiet"]].concat());
    command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().expect("starts")
}

fn signal(child: &Child, name: &str) {
    // It may be over by now.
    let _ = Command::new("kill").args([name, &child.id().to_string()]).stderr(Stdio::null()).status();
}

/// At moments that are spread over each command's time.
#[test]
fn signals_at_any_moment_leave_whole_files_only() {
    let folder = Folder::new();
    fs::create_dir(folder.path("small")).expect("a folder");
    let cap = ["--memory", "64MiB", NONE, "--threads", "2"];
    let jobs: [(Vec<&str>, &[&str]); 4] = [
        ([&["bake", "bent.toml", "--resolution", "360", "-o", "small/b.vdb"], &cap[..]].concat(), &["b.vdb"]),
        (
            vec!["bake", "bent.toml", "--resolution", "120", "--frames", "1-4", "-o", "small/f.#.vdb"],
            &["f.1.vdb", "f.2.vdb", "f.3.vdb", "f.4.vdb"],
        ),
        (
            vec![
                "slice",
                "bent.toml",
                "--resolution",
                "200",
                "--planes",
                "20-120x50",
                "-o",
                "small/s.##.exr",
            ],
            &["s.120.exr", "s.20.exr", "s.70.exr"],
        ),
        (vec!["render", "bent.toml", "--size", "160x160", "-o", "small/r.exr"], &["r.exr"]),
    ];
    let mut state = 8;
    let (mut killed, mut left, mut interrupted) = (0, 0, 0);
    for (arguments, outputs) in &jobs {
        let started = Instant::now();
        let output = folder.run(&[&arguments[..], &["--quiet"]].concat());
        let took = started.elapsed();
        assert_eq!(code(&output), 0, "{}", errors(&output));
        assert_eq!(within(&folder), *outputs);
        let path = |name: &str| format!("small/{name}");
        let expected: Vec<Vec<u8>> = outputs.iter().map(|name| folder.get(&path(name))).collect();
        for name in ["-KILL", "-INT", "-TERM", "-KILL", "-INT", "-TERM", "-KILL", "-KILL"] {
            for output in *outputs {
                folder.put(&path(output), "older");
            }
            let child = start(&folder, arguments);
            let part = u32::try_from(random(&mut state) % 1000).expect("small");
            std::thread::sleep(took * part / 1000);
            signal(&child, name);
            let output = child.wait_with_output().expect("ends");
            let context = format!("{arguments:?} {name} after {part}/1000: {:?}", output.status);
            for (name, expected) in outputs.iter().zip(&expected) {
                let found = folder.get(&path(name));
                assert!(found == b"older" || found == *expected, "{context}: {name}");
            }
            let names = within(&folder);
            let others: Vec<&String> =
                names.iter().filter(|name| !outputs.contains(&name.as_str())).collect();
            if name == "-KILL" {
                killed += u32::from(output.status.signal() == Some(9));
                left += others.len();
                let known = |other: &&String| outputs.iter().any(|output| is_temporary(other, output));
                assert!(others.iter().all(known), "{context}: {others:?}");
                continue;
            }
            // What earlier kills left of files that this one did not come to may be there still.
            let message = errors(&output);
            match output.status.code() {
                Some(0) => {}
                Some(130) => {
                    interrupted += 1;
                    assert!(message.is_empty() || message.starts_with("error: interrupted"), "{message}");
                }
                // Before the program could listen.
                _ => assert!(matches!(output.status.signal(), Some(2 | 15)), "{context} {message}"),
            }
        }
        let output = folder.run(&[&arguments[..], &["--quiet"]].concat());
        assert_eq!(code(&output), 0, "{}", errors(&output));
        assert_eq!(within(&folder), *outputs, "{arguments:?} cleared away");
        for (name, expected) in outputs.iter().zip(&expected) {
            assert!(folder.get(&path(name)) == *expected, "{name}");
            fs::remove_file(folder.path(&path(name))).expect("a file");
        }
    }
    // Else the moments were not of the work.
    assert!(killed >= 8 && interrupted >= 8 && left > 0, "{killed} {left} {interrupted}");
}

/// Signals alone, so that what they leave is theirs.
#[test]
fn signals_leave_no_temporary_file() {
    let folder = Folder::new();
    fs::create_dir(folder.path("small")).expect("a folder");
    let mut state = 21;
    for arguments in [
        &["bake", "bent.toml", "--resolution", "300", "--memory", "64MiB", NONE, "-o", "small/b.vdb"][..],
        &["slice", "bent.toml", "--resolution", "200", "-o", "small/s.##.exr"],
        &["sample", "bent.toml", "--points", "points.csv", "-o", "small/v.csv"],
    ] {
        let points: String = (0..100_000).map(|i| format!("0.{i:05},0.1,1.{i:05}\n")).collect();
        folder.put("points.csv", points);
        let started = Instant::now();
        assert_eq!(code(&folder.run(&[arguments, &["--quiet"]].concat())), 0);
        let took = started.elapsed();
        for name in ["-INT", "-TERM", "-INT", "-TERM"] {
            let child = start(&folder, arguments);
            std::thread::sleep(took * u32::try_from(random(&mut state) % 1000).expect("small") / 1000);
            signal(&child, name);
            let output = child.wait_with_output().expect("ends");
            let hidden: Vec<String> =
                within(&folder).into_iter().filter(|name| name.starts_with('.')).collect();
            assert!(hidden.is_empty(), "{arguments:?} {name} {:?}: {hidden:?}", output.status);
        }
    }
}

/// Frames that were there before a kill are as they were, and the others can be baked.
#[test]
fn a_killed_sequence_can_be_gone_on_with() {
    let folder = Folder::new();
    let frames = |frames| ["bake", "bent.toml", "--resolution", "100", "--frames", frames];
    assert_eq!(code(&folder.run(&frames("1-4"))), 0);
    let name = |frame: usize| format!("bent.000{frame}.vdb");
    let expected: Vec<Vec<u8>> = (1..=4).map(|frame| folder.get(&name(frame))).collect();
    (1..=4).for_each(|frame| fs::remove_file(folder.path(&name(frame))).expect("a file"));
    let mut child = start(&folder, &frames("1-400"));
    wait_for(|| folder.path(&name(2)).exists());
    child.kill().expect("still running");
    child.wait().expect("ends");
    let made = folder.made();
    let whole: Vec<&String> = made.iter().filter(|name| !name.starts_with('.')).collect();
    assert!(made.len() - whole.len() <= 1, "{made:?}");
    let next = whole.len() + 1;
    for frame in 1..next.min(5) {
        assert!(folder.get(&name(frame)) == expected[frame - 1], "frame {frame}");
    }
    assert_eq!(code(&folder.run(&frames(&format!("{next}-{}", next + 1)))), 0);
    let made = folder.made();
    assert!(made.len() == next + 1 && made.iter().all(|name| !name.starts_with('.')), "{made:?}");
}

/// The error that tells of memory, and what to do.
fn assert_tells_of_memory(output: &Output, context: &str) {
    let message = errors(output);
    assert_eq!(output.status.code(), Some(1), "{context}: {:?} {message}", output.status);
    assert!(!message.contains("panic") && !message.contains("overflow"), "{context}: {message}");
    let told = message.contains("memory") || message.contains("threads");
    assert!(told && text(output).is_empty(), "{context}: {message}");
}

/// Under every limit of the address space and of data the program does what it should, or ends with an error.
#[test]
fn too_little_memory_is_an_error() {
    let folder = folder();
    let commands: [(&[&str], &str); 7] = [
        (&["bake", "bent.toml", "--resolution", "250", NONE, "-o", "small/o.vdb"], "o.vdb"),
        (
            &["bake", "bent.toml", "--resolution", "250", NONE, "--memory", "64GiB", "-o", "small/o.vdb"],
            "o.vdb",
        ),
        (&["bake", "bent.toml", "--resolution", "48", "--certify", "-o", "small/o.vdb"], "o.vdb"),
        (&["slice", "bent.toml", "--resolution", "200", "-o", "small/o.exr"], "o.exr"),
        (&["render", "bent.toml", "--size", "400x400", "-o", "small/o.exr"], "o.exr"),
        (&["convert", "in.vdb", "small/o.vol"], "o.vol"),
        (&["sample", "bent.toml", "--points", "points.csv", "-o", "small/o.csv"], "o.csv"),
    ];
    // With less the system cannot even load the program.
    let version = folder.command(&["--version"]);
    let loads = |limit: &u32| {
        let output = limited(&format!("ulimit -v {limit}"), &version).output().expect("bash starts");
        output.status.success()
    };
    let least = (10_000..100_000).step_by(500).find(loads).expect("some limit");
    for (arguments, output) in commands {
        let path = format!("small/{output}");
        let whole = folder.run(&[arguments, &["--quiet"]].concat());
        assert_eq!(code(&whole), 0, "{}", errors(&whole));
        let expected = folder.get(&path);
        let (mut done, mut refused) = (0, 0);
        for (kind, threads) in [("-v", "1"), ("-v", "2"), ("-v", "6"), ("-d", "2")] {
            let first = if kind == "-d" { 1000 } else { least };
            let limits = std::iter::successors(Some(first), |limit: &u32| Some(limit * 8 / 5));
            for limit in limits.take_while(|limit| *limit < 1_000_000) {
                let context = format!("{arguments:?} --threads {threads}, ulimit {kind} {limit}");
                folder.put(&path, "older");
                let command = folder.command(&[arguments, &["--quiet", "--threads", threads]].concat());
                let found =
                    limited(&format!("ulimit {kind} {limit}"), &command).output().expect("bash starts");
                if found.status.success() {
                    done += 1;
                    assert!(folder.get(&path) == expected, "{context}");
                } else {
                    refused += 1;
                    assert_tells_of_memory(&found, &context);
                    assert_eq!(folder.get(&path), b"older", "{context}");
                }
            }
        }
        assert!(done > 3 && refused > 2, "{arguments:?}: {done} {refused}");
        assert_eq!(code(&folder.run(&[arguments, &["--quiet"]].concat())), 0);
        assert!(within(&folder).iter().all(|name| !name.starts_with('.')), "cleared away");
        fs::remove_file(folder.path(&path)).expect("a file");
    }
}

/// What a report takes is not known beforehand; with far too little it does not begin.
#[test]
fn reports_do_not_begin_with_far_too_little_memory() {
    let folder = folder();
    let command = folder.command(&["report", "bent.toml", "-o", "o.html", "--quiet", "--threads", "2"]);
    for limit in ["60000", "75000"] {
        let output = limited(&format!("ulimit -v {limit}"), &command).output().expect("bash starts");
        assert_tells_of_memory(&output, limit);
        assert!(errors(&output).contains("raise that limit"), "{}", errors(&output));
    }
}

/// A limit is taken for the machine's memory: values that have no room in it go to the spool.
#[test]
fn a_limit_is_a_cap() {
    let folder = Folder::new();
    let arguments = ["bake", "bent.toml", "--resolution", "500", NONE, "--threads", "1", "--json", "--quiet"];
    let free: Value = serde_json::from_slice(&folder.run(&arguments).stdout).expect("JSON");
    let expected = folder.get("bent.vdb");
    // With room for the program and half of the values.
    let limit = 30_000 + number(&free["bytes"]) / 2048;
    for memory in [&[][..], &["--memory", "64GiB"]] {
        let command = folder.command(&[&arguments[..], memory].concat());
        let output = limited(&format!("ulimit -v {limit}"), &command).output().expect("bash starts");
        assert_eq!(code(&output), 0, "{}", errors(&output));
        let capped: Value = serde_json::from_slice(&output.stdout).expect("JSON");
        assert!(number(&capped["spooled_bytes"]) > 0, "{capped}");
        assert!(folder.get("bent.vdb") == expected, "{memory:?}");
    }
    let command = folder.command(&["bake", "bent.toml", "--resolution", "2000", "--quiet", "--threads", "2"]);
    let output = limited("ulimit -v 200000", &command).output().expect("bash starts");
    let message = errors(&output);
    assert_eq!(code(&output), 1, "{message}");
    assert!(message.contains("too many bricks") && message.contains("(ulimit -v"), "{message}");
    assert!(message.contains("raise that limit") && message.contains("--voxel-size"), "{message}");
}

/// Some moments into a bake of some seconds.
fn long(folder: &Folder) -> Child {
    folder.put("bent.vdb", "older");
    let child = start(folder, &["bake", "bent.toml", "--resolution", "500", "--threads", "1"]);
    wait_for(|| folder.made().len() == 2);
    child
}

#[test]
fn a_temporary_file_that_somebody_removes_is_an_error() {
    let folder = Folder::new();
    let child = long(&folder);
    let made = folder.made();
    let temporary = made.iter().find(|name| is_temporary(name, "bent.vdb")).expect("a temporary file");
    fs::remove_file(folder.path(temporary)).expect("a file");
    let output = child.wait_with_output().expect("ends");
    let message = assert_failed(&output, &["bake"]);
    assert!(message.contains("somebody removed the temporary file"), "{message}");
    assert_eq!((folder.made(), folder.get("bent.vdb")), (vec!["bent.vdb".to_owned()], b"older".to_vec()));
}

#[test]
fn pipes_that_nobody_reads_are_no_failure() {
    let folder = folder();
    let without_files = [
        &["info", "bent.toml"][..],
        &["info", "in.vdb", "--json"],
        &["plan", "bent.toml"],
        &["plan", "bent.toml", "--frames", "1-3", "--json"],
        &["sample", "bent.toml", "--points", "points.csv"],
        &["verify", "in.vdb"],
        &["--help"],
    ];
    let all = WRITERS.iter().map(|writer| writer.arguments).chain(without_files);
    for arguments in all {
        let mut child =
            folder.command(arguments).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().expect("starts");
        drop(child.stdout.take());
        let output = child.wait_with_output().expect("ends");
        assert_eq!(output.status.code(), Some(0), "{arguments:?}: {}", errors(&output));
    }
    let made = within(&folder);
    for name in WRITERS.iter().map(|writer| writer.output).chain(["f.2.vdb", "f.3.vdb"]) {
        assert!(made.iter().any(|made| made == name), "{name}");
    }
    // Where it is not a pipe that was closed, what is missing is told.
    for (arguments, expected) in
        [(&["info", "bent.toml"][..], 1), (WRITERS[0].arguments, 1), (WRITERS[2].arguments, 5)]
    {
        let full = fs::File::options().write(true).open("/dev/full").expect("a device");
        let output = folder.command(arguments).stdout(full).output().expect("starts");
        let message = errors(&output);
        assert_eq!(code(&output), expected, "{arguments:?}: {message}");
        let told = message.contains("cannot write to standard output") && message.contains("No space left");
        assert!(told, "{message}");
    }
}

/// Standard output and error closed from the beginning.
#[test]
fn nobody_to_tell_is_no_failure() {
    let folder = Folder::new();
    for closed in ["exec >&-", "exec 2>&-", "exec >&- 2>&- <&-"] {
        let command = folder.command(&["bake", "bent.toml"]);
        let output = limited(closed, &command).output().expect("bash starts");
        assert_eq!(output.status.code(), Some(0), "{closed}: {}", errors(&output));
        assert_eq!(folder.made(), ["bent.vdb"]);
        fs::remove_file(folder.path("bent.vdb")).expect("a file");
    }
}

#[test]
fn two_bakes_to_one_output_make_one_of_both() {
    let folder = Folder::new();
    let arguments = |resolution| ["bake", "bent.toml", "--resolution", resolution, "--threads", "1"];
    let expected = ["96", "100"].map(|resolution| {
        assert_eq!(code(&folder.run(&arguments(resolution))), 0);
        folder.get("bent.vdb")
    });
    for _ in 0..3 {
        let children = ["96", "100", "96", "100"].map(|resolution| start(&folder, &arguments(resolution)));
        for child in children {
            let output = child.wait_with_output().expect("ends");
            assert_eq!(code(&output), 0, "{}", errors(&output));
        }
        assert!(expected.contains(&folder.get("bent.vdb")));
        assert_eq!(folder.made(), ["bent.vdb"]);
    }
}

/// One that stands still is not taken for dead.
#[test]
fn a_bake_that_waits_keeps_its_temporary_file() {
    let folder = Folder::new();
    let child = long(&folder);
    signal(&child, "-STOP");
    assert_eq!(code(&folder.run(&["bake", "bent.toml", "--resolution", "24"])), 0);
    let quick = folder.get("bent.vdb");
    let temporary = folder.made().into_iter().filter(|name| is_temporary(name, "bent.vdb")).count();
    signal(&child, "-CONT");
    std::thread::sleep(Duration::from_millis(1));
    let output = child.wait_with_output().expect("ends");
    assert_eq!((code(&output), temporary), (0, 1), "{}", errors(&output));
    assert!(quick.starts_with(b" BDV") && folder.get("bent.vdb").len() > quick.len());
    assert_eq!(folder.made(), ["bent.vdb"]);
}
