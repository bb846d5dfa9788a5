//! The program itself on an OpenVDB file: it ends with a result or an error, and makes no file but the one it is told to.

use std::fs;
use std::path::Path;

use clap::Parser;
use vdbake::cli::Cli;

/// What is done with the file. It lies in `folder/in.vdb`, and `folder/points.csv` beside it.
const COMMANDS: [&[&str]; 10] = [
    &["info", "in.vdb"],
    &["info", "in.vdb", "--json"],
    &["convert", "in.vdb", "out.vol"],
    &["slice", "in.vdb", "--axis", "x", "-o", "out.exr", "--planes", "0"],
    &["slice", "in.vdb", "--axis", "z", "-o", "out.png", "--at", "0"],
    &["sample", "in.vdb", "--points", "points.csv", "--json"],
    &["sample", "in.vdb", "--points", "points.csv", "--index", "--filter", "nearest"],
    &["render", "in.vdb", "-o", "out.png", "--size", "4x4"],
    &["compare", "in.vdb", "in.vdb", "--points", "16", "--rays", "2"],
    &["verify", "in.vdb", "--bricks", "2"],
];
/// Memory that each may take.
const MEMORY: &str = "64MiB";
const POINTS: &str = "0,0,0\n-1e9,1e9,0\n0.5,0.25,1e-9\n2147483647,-2147483648,7.5\n";

pub(crate) fn run(data: &[u8]) -> bool {
    let Some((command, file)) = data.split_first() else { return false };
    let Some(words) = COMMANDS.get(usize::from(*command)) else { return false };
    done(words, file) == 0
}

/// The exit code with which the program ends that does this with a file.
pub(super) fn done(words: &[&str], file: &[u8]) -> u8 {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let inner = folder.path().join("inner");
    fs::create_dir(&inner).expect("a new folder");
    fs::write(inner.join("in.vdb"), file).expect("room");
    fs::write(inner.join("points.csv"), POINTS).expect("room");
    let path = |word: &str| match word.contains('.') && !word.starts_with(|c: char| c.is_ascii_digit()) {
        true => inner.join(word).to_str().expect("UTF-8").to_owned(),
        false => word.to_owned(),
    };
    let mut arguments = vec!["vdbake".to_owned()];
    arguments.extend(words.iter().map(|word| path(word)));
    arguments.extend(["--quiet", "--threads", "1"].map(str::to_owned));
    if words[0] != "info" {
        arguments.extend(["--memory", MEMORY].map(str::to_owned));
    }
    let cli = Cli::try_parse_from(arguments).unwrap_or_else(|error| panic!("{error}"));
    // A thread of its own, because the program takes the current one into its pool for good.
    let result = std::thread::scope(|scope| scope.spawn(|| cli.run()).join());
    let result = result.expect("no panic");
    if let Err(failure) = &result {
        let mut text = vec![];
        failure.report(&mut text).expect("room");
        assert!(!text.is_empty());
    }
    let names = |folder: &Path| {
        let entries = fs::read_dir(folder).expect("a folder");
        let mut names: Vec<_> = entries
            .map(|entry| entry.expect("an entry").file_name().to_string_lossy().into_owned())
            .collect();
        names.sort();
        names
    };
    let output = words.iter().find(|word| word.starts_with("out."));
    let mut expected = vec!["in.vdb".to_owned()];
    expected.extend(output.filter(|_| result.is_ok()).map(|name| (*name).to_owned()));
    expected.push("points.csv".to_owned());
    assert_eq!(names(&inner), expected);
    assert_eq!(names(folder.path()), ["inner"]);
    result.map_or_else(|failure| failure.exit_code(), |()| 0)
}
