//! `vdbake convert`: its files byte by byte, beside the voxels of the grids that they are of.

use std::fs::{self, File};
use std::path::{Path, PathBuf};

use serde_json::Value;
use tempfile::tempdir;
use vdbake::formats::vdb::{AnyTree, VdbFile};

use crate::oracle::openvdb_make;
use crate::support::{bake, json, scenes_with_tiles, stderr, text, vdbake, write};

fn convert(arguments: &[&str]) -> Result<Value, String> {
    json("convert", arguments)
}

/// A `.vol` file.
struct Vol {
    size: [i32; 3],
    channels: i32,
    bounds: [f32; 6],
    values: Vec<f32>,
}

impl Vol {
    fn read(path: &Path) -> Vol {
        let bytes = fs::read(path).expect("a file");
        assert_eq!(bytes[..4], *b"VOL\x03");
        let word = |at: usize| bytes[4 * at..].first_chunk::<4>().copied().expect("a word");
        let integers: [i32; 5] = std::array::from_fn(|i| i32::from_le_bytes(word(1 + i)));
        let [1, x, y, z, channels] = integers else { panic!("not of 32-bit floats") };
        let count = usize::try_from(x * y * z * channels).expect("a count");
        assert_eq!(bytes.len(), 48 + 4 * count);
        Vol {
            size: [x, y, z],
            channels,
            bounds: std::array::from_fn(|i| f32::from_le_bytes(word(6 + i))),
            values: (0..count).map(|i| f32::from_le_bytes(word(12 + i))).collect(),
        }
    }

    /// The values of a cell.
    fn cell(&self, [x, y, z]: [i32; 3]) -> &[f32] {
        let cell = (z * self.size[1] + y) * self.size[0] + x;
        let first = usize::try_from(cell * self.channels).expect("within");
        &self.values[first..][..usize::try_from(self.channels).expect("few")]
    }
}

/// The numbers of a voxel.
type Lookup = dyn Fn([i32; 3]) -> Vec<f32>;

/// That a file's cells are a grid's voxels, where these are, with one more on each side.
fn compare(vdb: &Path, grid: &str, path: &Path) {
    let vol = Vol::read(path);
    let mut file = VdbFile::open(File::open(vdb).expect("a file")).expect("a VDB file");
    let grid = file.grid(grid).expect("a grid");
    let rows = grid.info.map.matrix.expect("an affine map");
    let (bounds, value): (_, Box<Lookup>) = match grid.tree {
        AnyTree::Float(tree) => (tree.stats().bounds, Box::new(move |at| vec![tree.value(at).0])),
        AnyTree::Vec3s(tree) => (tree.stats().bounds, Box::new(move |at| tree.value(at).0.to_vec())),
        other => panic!("{other:?}"),
    };
    let [low, high] = bounds.expect("active voxels");
    for i in 0..3 {
        assert_eq!(vol.size[i], high[i] - low[i] + 3);
        // The file holds single precision, of a product and a sum.
        for (index, found) in
            [(f64::from(low[i]) - 1.5, vol.bounds[i]), (f64::from(high[i]) + 1.5, vol.bounds[3 + i])]
        {
            let expected = index * rows[i][i] + rows[i][3];
            assert!((f64::from(found) - expected).abs() <= 1e-6 * expected.abs(), "{found}, not {expected}");
        }
    }
    for z in 0..vol.size[2] {
        for y in 0..vol.size[1] {
            for x in 0..vol.size[0] {
                let voxel = [low[0] + x - 1, low[1] + y - 1, low[2] + z - 1];
                assert_eq!(vol.cell([x, y, z]), value(voxel), "{voxel:?}");
            }
        }
    }
}

#[test]
fn cells_are_the_voxels_of_a_bake() {
    let folder = tempdir().expect("a folder");
    let vol = folder.path().join("out.vol");
    for scene in scenes_with_tiles(folder.path()) {
        let baked = bake(&scene, folder.path(), &[]);
        let report = convert(&[text(&baked.path), text(&vol)]).expect("converted");
        compare(&baked.path, "density", &vol);
        assert_eq!(report["bytes"].as_u64(), Some(fs::metadata(&vol).expect("a file").len()));
    }
}

#[test]
fn cells_are_the_same_where_memory_has_no_room_for_all_values() {
    let folder = tempdir().expect("a folder");
    let scene = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/tornado.toml");
    let [vdb, vol] = ["tornado.vdb", "tornado.vol"].map(|name| folder.path().join(name));
    let options = ["--resolution", "512", "--quiet", "--precision", "f16", "-o"];
    let output = vdbake().arg("bake").arg(&scene).args(options).arg(&vdb).output().expect("it starts");
    assert!(output.status.success(), "{}", stderr(&output));
    convert(&[text(&vdb), text(&vol)]).expect("converted");
    let whole = fs::read(&vol).expect("a file");
    // Its values take 22 MB in memory, more than the hint gives: they are read layer by layer.
    let mut cap = "17MB".to_owned();
    let mut refused = 0;
    while let Err(error) = convert(&[text(&vdb), text(&vol), "--memory", &cap]) {
        let hint = error.split("--memory ").nth(1).and_then(|rest| rest.split([',', ' ', '\n']).next());
        cap = hint.unwrap_or_else(|| panic!("{error}")).to_owned();
        refused += 1;
        assert!(refused < 4, "{error}");
    }
    assert!(refused > 0, "{cap} is enough");
    assert!(whole == fs::read(&vol).expect("a file"));
}

#[test]
fn cells_are_the_voxels_of_other_programs_grids() {
    let folder = tempdir().expect("a folder");
    let files = openvdb_make(folder.path());
    let file = |name: &str| files.iter().find(|file| file.ends_with(name)).expect("a file that is made");
    let vol = folder.path().join("out.vol");
    for (name, grid) in [
        ("several.vdb", "sphere"),
        ("several.vdb", "velocity"),
        ("maps.vdb", "scale_translate"),
        ("maps.vdb", "uniform_translate"),
    ] {
        convert(&[text(file(name)), text(&vol), "--grid", grid]).unwrap_or_else(|error| panic!("{error}"));
        compare(file(name), grid, &vol);
    }
}

#[test]
fn what_is_no_box_of_cells_is_refused() {
    let folder = tempdir().expect("a folder");
    let files = openvdb_make(folder.path());
    let file =
        |name: &str| text(files.iter().find(|file| file.ends_with(name)).expect("a file that is made"));
    let path = |name: &str| -> PathBuf { folder.path().join(name) };
    let (vol, scene) = (path("out.vol"), write(&path("scene.toml"), "name = \"nothing\"\n"));
    for (arguments, code, words) in [
        (&[file("maps.vdb"), text(&vol), "--grid", "affine"][..], '1', "turned or sheared"),
        (&[file("several.vdb"), text(&vol), "--grid", "nowhere"], '2', "no grid"),
        (&[file("several.vdb"), text(&path("out.exr"))], '2', "converts .vdb to .vol"),
        (&[text(&scene), text(&vol)], '2', "to be baked first"),
        (&[text(&path("nothing.vdb")), text(&vol)], '3', "cannot read"),
        (&[file("varied_float.vdb"), text(&vol), "--grid", "other"], '1', "end of all indices"),
        (&[file("several.vdb"), text(&vol), "--grid", "sphere", "--memory", "20MB"], '1', "--memory"),
    ] {
        let error = convert(arguments).expect_err("refused");
        assert!(error.starts_with(code) && error.contains(words), "{arguments:?}: {error}");
        assert!(!vol.exists(), "{arguments:?}");
    }
}

#[test]
fn nothing_is_a_few_cells_of_nothing() {
    let folder = tempdir().expect("a folder");
    let scene = write(&folder.path().join("nothing.toml"), "name = \"nothing\"\n");
    let baked = bake(&scene, folder.path(), &[]);
    let vol = folder.path().join("out.vol");
    convert(&[text(&baked.path), text(&vol)]).expect("converted");
    let vol = Vol::read(&vol);
    assert_eq!((vol.size, vol.channels), ([3; 3], 1));
    assert!(vol.values.iter().all(|value| *value == 0.0));
}
