//! Files that are not what they claim: an error or a result, never a panic, in memory that the file's length bounds.

use std::fs;
use std::io::Cursor;
use std::process::Command;

use tempfile::tempdir;
use vdbake::formats::vdb::{
    Compression, EncodedBricks, FileHeader, GridClass, GridHeader, Metadata, Part, VdbFile, VdbGridBuilder,
    VectorType, write,
};

use crate::oracle::{openvdb_make, vdb_tool};
use crate::support::{random, stderr, stdout, vdbake};

/// Mutated files in all.
const MUTATIONS: usize = 5000;
/// Bytes that all of them may take at most, one after the other, everything else in the process included: the originals
/// are below 500 KB each and below 10 MB together.
const MEMORY: u64 = 192 << 20;
const CHILD: &str = "VDBAKE_TEST_CHILD";

/// Runs in a process of its own, so that its peak of memory is that of reading.
#[test]
fn mutated_files_give_errors_in_bounded_memory() {
    if std::env::var_os(CHILD).is_some() {
        return mutations();
    }
    let folder = tempdir().expect("a temporary folder");
    let made = openvdb_make(folder.path());
    for (index, (file, codec, bits)) in made
        .iter()
        .flat_map(|file| {
            [("zip", "32"), ("zip", "16"), ("blosc", "16"), ("blosc", "32")].map(|(c, b)| (file, c, b))
        })
        .enumerate()
    {
        let copy = folder.path().join(format!("original_{index:02}.vdb"));
        let [file, copy] = [file, &copy].map(|path| path.to_str().expect("UTF-8").to_owned());
        let [codec, bits] = [format!("codec={codec}"), format!("bits={bits}")];
        vdb_tool(&["-read", "delayed=0", &file, "-write", &codec, &bits, &copy]);
    }
    let output = Command::new(std::env::current_exe().expect("this program"))
        .args(["--exact", "hostile::mutated_files_give_errors_in_bounded_memory", "--nocapture"])
        .env(CHILD, folder.path())
        .env("RAYON_NUM_THREADS", "2")
        .output()
        .expect("this program starts");
    assert!(output.status.success(), "{}{}", stdout(&output), stderr(&output));
}

fn mutations() {
    let folder = std::env::var_os(CHILD).expect("the folder of originals");
    let mut paths: Vec<_> = fs::read_dir(folder)
        .expect("a readable folder")
        .map(|entry| entry.expect("an entry").path())
        .collect();
    paths.retain(|path| path.file_name().is_some_and(|name| name.to_string_lossy().starts_with("original")));
    paths.sort();
    let mut originals: Vec<Vec<u8>> = paths.iter().map(|path| fs::read(path).expect("readable")).collect();
    originals.retain(|bytes| bytes.len() < 500_000);
    originals.extend([Compression::Zip, Compression::Blosc, Compression::None].map(own));
    assert!(originals.len() > 30);
    let (mut failures, mut grids) = (0, 0);
    let mut state = 7;
    let mut below = |bound: usize| usize::try_from(random(&mut state) % bound as u64).expect("in range");
    for number in 0..MUTATIONS {
        let original = &originals[number % originals.len()];
        let mut bytes = original.clone();
        let marks: Vec<usize> =
            (0..bytes.len().min(4000)).filter(|at| bytes[*at..].starts_with(b"Tree_")).collect();
        for _ in 0..=below(4) {
            // Where structure is: the file's header, the grids' descriptors and metadata, the beginning of the topology;
            // or anywhere.
            let start = match below(4) {
                0 => 0,
                1 => marks[below(marks.len())],
                2 => marks[below(marks.len())] + 600,
                _ => below(bytes.len()),
            };
            let at = (start + below(400)).min(bytes.len() - 1);
            bytes[at] = [0, 1, 0x7f, 0x80, 0xff, bytes[at] ^ (1 << below(8))][below(6)];
        }
        match below(8) {
            0 => bytes.truncate(below(bytes.len())),
            1 => bytes[20] = 0,
            _ => {}
        }
        let mut file = match VdbFile::open(Cursor::new(&bytes)) {
            Ok(file) => file,
            Err(_) => {
                failures += 1;
                continue;
            }
        };
        for grid in 0..file.info().grids.len() {
            grids += 1;
            failures += usize::from(file.grid_at(grid).is_err());
            // Alone it may be without fault.
            let _ = file.grid_part_at(grid, &Part::within([-16; 3], [120; 3]));
        }
    }
    // Most mutations hit something that is checked; those of values cannot be noticed.
    assert!(failures > 1000 && grids > 2000, "{failures} failures in {grids} grids");
    let status = fs::read_to_string("/proc/self/status").unwrap_or_default();
    let peak = status.lines().find_map(|line| line.strip_prefix("VmHWM:"));
    let peak = peak.and_then(|text| text.trim().trim_end_matches(" kB").parse::<u64>().ok());
    assert!(peak.is_none_or(|peak| peak << 10 < MEMORY), "{peak:?} kB");
}

/// A file of our own: a few leaves in two upper nodes.
fn own(compression: Compression) -> Vec<u8> {
    named("density", compression)
}

/// The same, of this name.
fn named(name: &str, compression: Compression) -> Vec<u8> {
    let mut grid = VdbGridBuilder::new(compression);
    let mut run = EncodedBricks::default();
    let mut state = 3;
    for origin in [[-8, 0, 0], [0, 0, 0], [0, 0, 8], [128, 8, 0]] {
        let mask = [(); 8].map(|()| random(&mut state) & random(&mut state));
        let values = [(); 512].map(|()| f32::from(u16::try_from(random(&mut state) >> 48).expect("16 bits")));
        run.push(grid.encoder(), origin, &mask, &values);
    }
    grid.append(&run).expect("sorted");
    let header = FileHeader { uuid: uuid::Uuid::nil(), metadata: Metadata::new() };
    let grid_header = GridHeader {
        name: name.to_owned(),
        class: GridClass::FogVolume,
        vector_type: VectorType::Invariant,
        voxel_size: 0.5,
        translation: [0.25; 3],
        metadata: Metadata::new(),
    };
    let mut bytes = vec![];
    write(&mut bytes, &header, &[(&grid_header, &grid)]).expect("a valid grid");
    bytes
}

/// Nothing that a few bytes can claim is allocated.
#[test]
fn claims_beyond_the_file_are_refused() {
    let bytes = own(Compression::None);
    let open = |bytes: &[u8]| VdbFile::open(Cursor::new(bytes.to_vec()));
    assert!(open(&bytes).expect("valid").grid("density").is_ok());
    for end in (0..bytes.len()).step_by(977) {
        assert!(open(&bytes[..end]).is_err());
    }
    // The root's counts of tiles and children stand before the first child's origin, (-4096, 0, 0).
    let child = [-4096_i32, 0, 0].map(i32::to_le_bytes);
    let at = bytes.windows(12).position(|window| window == child.as_flattened()).expect("a child");
    for count in [at - 8, at - 4] {
        let mut bytes = bytes.clone();
        bytes[count..count + 4].copy_from_slice(&u32::MAX.to_le_bytes());
        assert!(open(&bytes).expect("the headers are valid").grid("density").is_err());
    }
}

/// What a file says of itself is never a path: files are made where the user says, and nowhere else.
#[test]
fn names_in_a_file_are_no_paths() {
    let root = tempdir().expect("a temporary folder");
    let folder = root.path().join("a/b/c");
    fs::create_dir_all(&folder).expect("new folders");
    for name in ["../../x", "/tmp/vdbake_x", "..", "c:\\x", "a/b", "x\0y", "-o", "%s"] {
        let input = folder.join("in.vdb");
        fs::write(&input, named(name, Compression::Zip)).expect("room");
        fs::write(folder.join("points.csv"), "0,0,0\n").expect("room");
        for arguments in [
            &["convert", "in.vdb", "out.vol"][..],
            &["slice", "in.vdb", "--axis", "x", "--planes", "0-1", "-o", "s.####.exr"],
            &["slice", "in.vdb", "--axis", "y", "--planes", "0-1", "-o", "parts.exr"],
            &["slice", "in.vdb", "--axis", "z", "--planes", "0-1", "-o", "atlas.png"],
            &["render", "in.vdb", "--size", "4x4", "-o", "out.png"],
            &["sample", "in.vdb", "--points", "points.csv", "-o", "out.csv"],
            &["compare", "in.vdb", "in.vdb", "--points", "10", "--rays", "2"],
            &["info", "in.vdb"],
        ] {
            let output =
                vdbake().args(arguments).arg("--quiet").current_dir(&folder).output().expect("it starts");
            assert!(output.status.success(), "{name:?} {arguments:?}: {}", stderr(&output));
            assert!(!stdout(&output).contains('\0'), "{name:?} {arguments:?}");
        }
    }
    let mut found = vec![];
    let mut folders = vec![root.path().to_owned()];
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(folder).expect("a folder") {
            let path = entry.expect("an entry").path();
            let name = path.strip_prefix(root.path()).expect("below it").to_string_lossy().into_owned();
            if path.is_dir() { folders.push(path) } else { found.push(name) }
        }
    }
    found.sort();
    let expected = [
        "atlas.png",
        "in.vdb",
        "out.csv",
        "out.png",
        "out.vol",
        "parts.exr",
        "points.csv",
        "s.0000.exr",
        "s.0001.exr",
    ];
    assert_eq!(found, expected.map(|name| format!("a/b/c/{name}")));
    assert!(!std::path::Path::new("/tmp/vdbake_x").exists());
}
