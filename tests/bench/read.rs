//! How fast are files read, beside OpenVDB and vdb-rs?
//!
//!     eval "$(scripts/oracles)" && cargo bench --bench read -- FILE...
//!
//! Prints for each file the best of several runs in seconds: ours on one thread and on all, OpenVDB's Python module without
//! delayed loading, vdb-rs (float grids; `-` where it fails). The file has been read before, so no disk is timed.

use std::fs::File;
use std::io::BufReader;
use std::path::Path;
use std::process::Command;
use std::time::Instant;

use vdbake::formats::vdb::VdbFile;

const RUNS: usize = 5;
const VDB_RS: &str = "--vdb-rs";

/// Times reading all grids of a file.
const OPENVDB: &str = "
import sys, time
sys.path.insert(0, sys.argv[1])
from openvdb_dump import vdb
best = 1e9
for _ in range(int(sys.argv[3])):
    start = time.perf_counter()
    grids = vdb.readAll(sys.argv[2])
    best = min(best, time.perf_counter() - start)
    del grids
print(best)
";

#[allow(clippy::print_stdout, reason = "the figures go to stdout")]
fn main() {
    // Some files make vdb-rs ask for so much memory that the process is aborted, so it gets its own.
    if let [_, mode, path] = &std::env::args().collect::<Vec<_>>()[..]
        && mode == VDB_RS
    {
        println!("{}", best(|| vdb_rs(Path::new(path))).map_or(String::new(), |time| time.to_string()));
        return;
    }
    let files: Vec<String> = std::env::args().skip(1).filter(|argument| !argument.starts_with('-')).collect();
    println!("{:>10} {:>9} {:>9} {:>9} {:>9}  file", "MB", "1 thread", "all", "OpenVDB", "vdb-rs");
    for file in files {
        let path = Path::new(&file);
        let megabytes = std::fs::metadata(path).map_or(0, |metadata| metadata.len()) / 1_000_000;
        let one = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a thread");
        let figures = [
            one.install(|| best(|| ours(path))),
            best(|| ours(path)),
            openvdb(path),
            printed(Command::new(std::env::current_exe().expect("this program")).arg(VDB_RS).arg(path)),
        ];
        let [a, b, c, d] = figures.map(|time| time.map_or("-".to_owned(), |time| format!("{time:.3}")));
        println!("{megabytes:>10} {a:>9} {b:>9} {c:>9} {d:>9}  {file}");
    }
}

fn best(mut run: impl FnMut() -> Option<()>) -> Option<f64> {
    let mut best = None;
    for _ in 0..RUNS {
        let start = Instant::now();
        run()?;
        let time = start.elapsed().as_secs_f64();
        best = Some(best.map_or(time, |best: f64| best.min(time)));
    }
    best
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
    printed(command.arg(scripts).arg(path).arg(RUNS.to_string()))
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
