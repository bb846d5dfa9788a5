//! Our reader beside vdb-rs 0.6.0, another reader in Rust: it finds the same in every file of ours, and in those of
//! `vdb_tool` that it can read. Which these are is listed, because what it cannot read it may take for something else.

use std::fs::File;
use std::path::Path;
use std::process::Command;

use tempfile::tempdir;
use vdbake::formats::vdb::{AnyTree, VdbFile};

use crate::oracle::{indices, vdb_rs, vdb_tool};
use crate::support::{COMPRESSIONS, Voxel, assert_same, bake, scenes_with_tiles};

const CHILD: &str = "VDBAKE_TEST_CHILD";

/// What it reads of `vdb_tool`: all but Blosc's frames of binary16, where it looks for a size before an empty payload.
/// OpenVDB writes no zlib streams for grids of these classes.
const READ: [&str; 10] = [
    "level set none 32",
    "level set none 16",
    "level set active 32",
    "level set active 16",
    "level set blosc 32",
    "fog none 32",
    "fog none 16",
    "fog active 32",
    "fog active 16",
    "fog blosc 32",
];

/// The active voxels of a file's only grid, and its name.
fn ours(path: &Path) -> (String, Vec<Voxel>) {
    let mut file = VdbFile::open(File::open(path).expect("a readable file")).expect("valid headers");
    let grid = file.grid_at(0).expect("a grid");
    let AnyTree::Float(tree) = grid.tree else { panic!("not of floats") };
    let mut voxels: Vec<Voxel> = tree.active_voxels().collect();
    for tile in tree.active_tiles() {
        let inside = indices(1 << tile.log2_edge);
        voxels.extend(inside.map(|at| ([0, 1, 2].map(|axis| tile.origin[axis] + at[axis]), tile.value)));
    }
    voxels.sort_by_key(|voxel| voxel.0);
    (grid.info.name, voxels)
}

#[test]
fn files_of_ours_are_read_alike() {
    let folder = tempdir().expect("a temporary folder");
    for scene in scenes_with_tiles(folder.path()) {
        for compression in COMPRESSIONS {
            let baked = bake(&scene, folder.path(), &["--compression", compression]);
            let (name, voxels) = ours(&baked.path);
            assert!(!voxels.is_empty());
            assert_same(&vdb_rs(&baked.path, &name), &voxels, &format!("{} {compression}", scene.display()));
        }
    }
}

/// Compares in a process of its own: some files make vdb-rs ask for so much memory that the process is aborted.
#[test]
fn files_of_vdb_tool_are_read_alike_where_vdb_rs_can() {
    if let Some(path) = std::env::var_os(CHILD) {
        let (name, voxels) = ours(Path::new(&path));
        return assert_same(&vdb_rs(Path::new(&path), &name), &voxels, &name);
    }
    let folder = tempdir().expect("a temporary folder");
    let mut same = vec![];
    for (shape, fog) in [("level set", false), ("fog", true)] {
        for codec in ["none", "active", "blosc"] {
            for bits in ["32", "16"] {
                let path = folder.path().join("ball.vdb");
                let (codec_option, bits_option) = (format!("codec={codec}"), format!("bits={bits}"));
                let mut arguments = vec!["-sphere", "dim=40"];
                arguments.extend(fog.then_some("-ls2fog"));
                arguments.extend(["-write", &codec_option, &bits_option, path.to_str().expect("UTF-8")]);
                vdb_tool(&arguments);
                assert!(ours(&path).1.len() > 1000);
                let name = "vdb_rs::files_of_vdb_tool_are_read_alike_where_vdb_rs_can";
                let output = Command::new(std::env::current_exe().expect("this program"))
                    .args(["--exact", name, "--nocapture"])
                    .env(CHILD, &path)
                    .output()
                    .expect("this program starts");
                same.extend(output.status.success().then(|| format!("{shape} {codec} {bits}")));
            }
        }
    }
    assert_eq!(same, READ);
}
