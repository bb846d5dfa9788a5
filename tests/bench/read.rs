//! How fast are files read, beside OpenVDB and vdb-rs?
//!
//!     eval "$(scripts/oracles)" && cargo bench --bench read -- FILE...
//!
//! Prints for each file the medians of several runs in seconds, the programs taking turns: ours on one thread and on all,
//! OpenVDB's Python module without delayed loading, vdb-rs (float grids; `-` where it fails); and how many times as long as
//! ours OpenVDB takes. The files have been read before, so no disk is timed.

use std::fs::File;
use std::io::BufReader;
use std::path::Path;
use std::process::Command;
use std::time::Instant;

use vdbake::formats::vdb::VdbFile;

const RUNS: usize = 9;
const VDB_RS: &str = "--vdb-rs";

/// Times reading all grids of a file, after a first time that is not counted.
const OPENVDB: &str = "
import sys, time
sys.path.insert(0, sys.argv[1])
from openvdb_dump import vdb
for _ in range(2):
    start = time.perf_counter()
    grids = vdb.readAll(sys.argv[2])
    seconds = time.perf_counter() - start
    del grids
print(seconds)
";

#[allow(clippy::print_stdout, reason = "the figures go to stdout")]
fn main() {
    // Some files make vdb-rs ask for so much memory that the process is aborted, so it gets its own.
    if let [_, mode, path] = &std::env::args().collect::<Vec<_>>()[..]
        && mode == VDB_RS
    {
        let path = Path::new(path);
        println!(
            "{}",
            vdb_rs(path).and_then(|()| seconds(|| vdb_rs(path))).map_or(String::new(), |s| s.to_string())
        );
        return;
    }
    let files: Vec<String> = std::env::args().skip(1).filter(|argument| !argument.starts_with('-')).collect();
    println!(
        "{:>6} {:>8} {:>8} {:>8} {:>8} {:>9} {:>9}  file",
        "MB", "1 thread", "all", "OpenVDB", "vdb-rs", "1 thread", "all"
    );
    let one = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a thread");
    for file in files {
        let path = Path::new(&file);
        let megabytes = std::fs::metadata(path).map_or(0, |metadata| metadata.len()) / 1_000_000;
        let mut times = [const { vec![] }; 4];
        for _ in 0..RUNS {
            let run = [
                one.install(|| seconds(|| ours(path))),
                seconds(|| ours(path)),
                openvdb(path),
                printed(Command::new(std::env::current_exe().expect("this program")).arg(VDB_RS).arg(path)),
            ];
            times.iter_mut().zip(run).for_each(|(times, time)| times.extend(time));
        }
        let medians = times.map(median);
        let [a, b, c, d] = medians.map(|time| time.map_or("-".to_owned(), |time| format!("{time:.3}")));
        let ratio = |ours: Option<f64>| {
            ours.zip(medians[2]).map_or("-".to_owned(), |(ours, openvdb)| format!("{:.2}", openvdb / ours))
        };
        let [e, f] = [ratio(medians[0]), ratio(medians[1])];
        println!("{megabytes:>6} {a:>8} {b:>8} {c:>8} {d:>8} {e:>9} {f:>9}  {file}");
    }
}

fn seconds(mut run: impl FnMut() -> Option<()>) -> Option<f64> {
    let start = Instant::now();
    run()?;
    Some(start.elapsed().as_secs_f64())
}

fn median(mut times: Vec<f64>) -> Option<f64> {
    times.sort_by(f64::total_cmp);
    times.get(times.len() / 2).copied()
}

fn ours(path: &Path) -> Option<()> {
    let mut file = VdbFile::open(File::open(path).ok()?).ok()?;
    for number in 0..file.info().grids.len() {
        std::hint::black_box(file.grid_at(number).ok()?);
    }
    Some(())
}

fn openvdb(path: &Path) -> Option<f64> {
    let scripts = Path::new(env!("CARGO_MANIFEST_DIR")).join("scripts/oracle");
    let python = std::env::var_os("VDBAKE_OPENVDB_PYTHON")?;
    let mut command = Command::new(python);
    command.env("OPENVDB_DISABLE_DELAYED_LOAD", "1").arg("-c").arg(OPENVDB);
    printed(command.arg(scripts).arg(path))
}

/// The number that a program prints.
fn printed(command: &mut Command) -> Option<f64> {
    String::from_utf8(command.output().ok()?.stdout).ok()?.trim().parse().ok()
}

fn vdb_rs(path: &Path) -> Option<()> {
    let mut reader = vdb_rs::VdbReader::new(BufReader::new(File::open(path).ok()?)).ok()?;
    for name in reader.available_grids() {
        std::hint::black_box(reader.read_grid::<f32>(&name).ok()?);
    }
    Some(())
}
