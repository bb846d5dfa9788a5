//! Our reader beside OpenVDB: files that OpenVDB made, and files from Houdini where `VDBAKE_REAL_VDB` names their folder,
//! give the same values to the bit, the same states, bounds, transforms and metadata.

use std::collections::BTreeSet;
use std::fs::{self, File};
use std::path::{Path, PathBuf};

use serde_json::{Value, json};
use tempfile::tempdir;
use vdbake::formats::vdb::{
    AnyPartialTree, AnyTree, Compression, FileHeader, Grid, GridClass, GridHeader, GridInfo, Map, Meta,
    Metadata, NotRead, Part, PartialTree, Tree, VdbFile, VdbGridBuilder, VdbReadError, VectorType, write,
};

use crate::oracle::{Probed, openvdb, openvdb_make, openvdb_probe, vdb_tool};
use crate::support::{assert_same, random, stdout, vdbake};

/// A value of any type as OpenVDB's module gives it, its state, and how many numbers it has.
type Sample = ([f64; 3], bool);

#[test]
fn files_of_openvdb_read_as_openvdb_reads_them() {
    let folder = tempdir().expect("a temporary folder");
    let made = openvdb_make(folder.path());
    assert!(made.len() > 8, "{made:?}");
    let mut files = made.clone();
    for file in &made {
        for (codec, bits) in [("none", "16"), ("none", "32"), ("zip", "16"), ("zip", "32"), ("active", "16")]
            .into_iter()
            .chain([("active", "32"), ("blosc", "16"), ("blosc", "32")])
        {
            let stem = file.file_stem().expect("a name").to_string_lossy();
            let copy = folder.path().join(format!("{stem}_{codec}_{bits}.vdb"));
            vdb_tool(&[
                "-read",
                "delayed=0",
                &text(file),
                "-write",
                &format!("codec={codec}"),
                &format!("bits={bits}"),
                &text(&copy),
            ]);
            files.push(copy);
        }
    }
    let several = made.iter().find(|file| file.ends_with("several.vdb")).expect("one of those made");
    assert!(open(several).info().grids.iter().any(|grid| !grid.instance_of.is_empty()), "a shared tree");
    assert_same_as_openvdb(&files);
}

#[test]
fn files_of_vdb_tool_read_as_openvdb_reads_them() {
    let folder = tempdir().expect("a temporary folder");
    let path = |name: &str| text(&folder.path().join(name));
    let (sphere, ball, shape, gradient, half) =
        (path("sphere.vdb"), path("ball.vdb"), path("shape.vdb"), path("gradient.vdb"), path("half.vdb"));
    vdb_tool(&["-sphere", "dim=40", "center=(-1,0.2,0.3)", "-write", &sphere]);
    vdb_tool(&["-sphere", "dim=40", "-ls2fog", "-write", "codec=zip", &ball]);
    vdb_tool(&["-platonic", "faces=12", "dim=50", "-sphere", "dim=20", "-write", "codec=none", &shape]);
    vdb_tool(&["-sphere", "dim=40", "-grad", "-write", &gradient]);
    vdb_tool(&["-sphere", "dim=40", "-grad", "-write", "bits=16", "codec=active", &half]);
    assert_same_as_openvdb(&[sphere, ball, shape, gradient, half].map(PathBuf::from));
}

#[test]
fn files_of_houdini_read_as_openvdb_reads_them() {
    let Some(folder) = std::env::var_os("VDBAKE_REAL_VDB") else { return };
    let folder = Path::new(&folder);
    let working = tempdir().expect("a temporary folder");
    let names = ["houdini_smoke_half.vdb", "houdini_sphere_level_set.vdb"];
    let files = names.map(|name| {
        fs::copy(folder.join(name), working.path().join(name)).expect("a readable file");
        working.path().join(name)
    });
    assert_same_as_openvdb(&files);

    // Every active voxel of the larger one.
    let AnyTree::Float(tree) = open(&files[0]).grid("density").expect("the grid").tree else {
        panic!("float")
    };
    let verdict = openvdb(&files[0]).expect("OpenVDB reads it");
    let mut voxels: Vec<_> = tree.active_voxels().collect();
    voxels.sort_by_key(|voxel| voxel.0);
    assert_eq!(tree.active_tiles().count(), 0);
    assert_same(&voxels, &verdict.voxels, "smoke");

    let mut points = open(&folder.join("houdini_points.vdb"));
    let name = points.info().grids[0].name.clone();
    match points.grid(&name) {
        Err(error @ VdbReadError::Type { .. }) => {
            assert!(error.to_string().contains("Tree_ptdataidx32_5_4_3"), "{error}");
        }
        other => panic!("{other:?}"),
    }
}

#[test]
fn metadata_of_every_type_is_what_openvdb_reads() {
    let rows = [[1.0, 2.0, 3.0, 4.0], [0.1, 0.2, 0.3, 0.4], [-1.0, 1e10, 1e-10, 0.0], [5.0, 6.0, 7.0, 8.5]];
    #[allow(clippy::cast_possible_truncation, reason = "rounded")]
    let single = rows.map(|row| row.map(|x| x as f32));
    let metadata = Metadata::from([
        ("a".into(), "text \u{e9}".into()),
        ("b".into(), Meta::Bool(true)),
        ("c".into(), Meta::Int32(i32::MIN)),
        ("d".into(), Meta::Int64(1 << 40)),
        ("e".into(), Meta::Float(0.1)),
        ("f".into(), Meta::Double(0.1)),
        ("g".into(), Meta::Vec2i([1, -2])),
        ("h".into(), Meta::Vec2s([0.1, -2.5])),
        ("i".into(), Meta::Vec2d([0.1, -2.5])),
        ("j".into(), Meta::Vec3i([1, -2, 3])),
        ("k".into(), Meta::Vec3s([0.1, -2.5, 3.0])),
        ("l".into(), Meta::Vec3d([0.1, -2.5, 3.0])),
        ("m".into(), Meta::Vec4i([1, -2, 3, i32::MAX])),
        ("n".into(), Meta::Vec4s(single[1])),
        ("o".into(), Meta::Vec4d(rows[1])),
        ("p".into(), Meta::Mat4s(single)),
        ("q".into(), Meta::Mat4d(rows)),
    ]);
    let folder = tempdir().expect("a temporary folder");
    let path = folder.path().join("metadata.vdb");
    let header = FileHeader { uuid: uuid::Uuid::nil(), metadata: metadata.clone() };
    let grid_header = GridHeader {
        name: "density".into(),
        voxel_size: 0.5,
        translation: [0.0; 3],
        class: GridClass::FogVolume,
        vector_type: VectorType::Invariant,
        metadata: metadata.clone(),
    };
    let mut file = File::create(&path).expect("a writable folder");
    write(&mut file, &header, &[(&grid_header, &VdbGridBuilder::new(Compression::None))]).expect("a file");
    let read = open(&path);
    assert_eq!(read.info().metadata, metadata);
    assert!(metadata.iter().all(|(name, value)| read.info().grids[0].metadata.get(name) == Some(value)));
    // Not Blender's module, which does not know vectors of single precision.
    let verdict = openvdb(&path).expect("OpenVDB reads it").report;
    assert_eq!(verdict["metadata"], described(&metadata));
    assert_eq!(verdict["grids"][0]["metadata"], described(&read.info().grids[0].metadata));

    let output = vdbake().args(["info", "--json"]).arg(&path).output().expect("the program starts");
    let report: Value = serde_json::from_slice(&output.stdout).expect("one JSON object");
    assert_eq!(report["metadata"], described(&metadata));
    assert_eq!(report["grids"][0]["metadata"]["q"], json!(rows));
    let output = vdbake().arg("info").arg(&path).output().expect("the program starts");
    let (told, row) = (stdout(&output), "(5, 6, 7, 8.5)");
    assert!(told.matches(row).count() == 4 && told.matches("(1, -2, 3, 2147483647)").count() == 2, "{told}");
}

fn text(path: &Path) -> String {
    path.to_str().expect("UTF-8").to_owned()
}

fn open(path: &Path) -> VdbFile<File> {
    let file = File::open(path).expect("a readable file");
    VdbFile::open(file).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

/// That OpenVDB and we find the same in these files.
fn assert_same_as_openvdb(files: &[PathBuf]) {
    let read: Vec<(PathBuf, Metadata, Vec<Grid>)> = files
        .iter()
        .map(|path| {
            let mut file = open(path);
            let context = |error| panic!("{}: {error}", path.display());
            let count = file.info().grids.len();
            let mut grids: Vec<_> =
                (0..count).map(|number| file.grid_at(number).unwrap_or_else(context)).collect();
            for (number, grid) in grids.iter().enumerate() {
                assert_parts(&mut file, number, &grid.tree);
            }
            // OpenVDB sorts them.
            grids.sort_by(|a, b| a.info.name.cmp(&b.info.name));
            (path.clone(), file.info().metadata.clone(), grids)
        })
        .collect();
    let points: Vec<Vec<[i32; 3]>> = read
        .iter()
        .map(|(_, _, grids)| {
            let points: BTreeSet<[i32; 3]> = grids.iter().flat_map(|grid| points(&grid.tree)).collect();
            points.into_iter().collect()
        })
        .collect();
    let paths: Vec<&Path> = files.iter().map(PathBuf::as_path).collect();
    for (((path, metadata, grids), points), found) in
        read.iter().zip(&points).zip(openvdb_probe(&paths, &points))
    {
        let Probed { report, grids: samples } = found;
        assert_eq!(described(metadata), *without_hints(&report["metadata"]), "{}", path.display());
        assert_eq!(report["grids"].as_array().map(Vec::len), Some(grids.len()));
        for (number, (grid, samples)) in grids.iter().zip(samples).enumerate() {
            let context = format!("{}, grid {}", path.display(), grid.info.name);
            assert_described(grid, &report["grids"][number], &context);
            assert_eq!(samples.len(), points.len(), "{context}");
            for (point, expected) in points.iter().zip(samples) {
                let found = sample(&grid.tree, *point);
                assert!(same(found, expected), "{context}: {found:?}, not {expected:?} at {point:?}");
            }
        }
    }
}

fn same(a: Sample, b: Sample) -> bool {
    a.0.map(f64::to_bits) == b.0.map(f64::to_bits) && a.1 == b.1
}

/// Runs an expression with the tree of whatever type.
macro_rules! with_tree {
    ($tree:expr, $name:ident => $body:expr) => {
        match $tree {
            AnyTree::Bool($name) => $body,
            AnyTree::Int32($name) => $body,
            AnyTree::Int64($name) => $body,
            AnyTree::Float($name) => $body,
            AnyTree::Double($name) => $body,
            AnyTree::Vec3i($name) => $body,
            AnyTree::Vec3s($name) => $body,
            AnyTree::Vec3d($name) => $body,
        }
    };
}

/// That parts of a grid, read alone, are as in the whole.
fn assert_parts(file: &mut VdbFile<File>, number: usize, whole: &AnyTree) {
    let points = points(whole);
    for part in [Part::within([-70, -40, -9], [9, 30, 60]), Part::around(points.iter().step_by(700).copied())]
    {
        let found = file.grid_part_at(number, &part).expect("a part of a grid").tree;
        macro_rules! compare {
            ($($kind:ident),*) => {
                match (whole, &found) {
                    $((AnyTree::$kind(whole), AnyPartialTree::$kind(found)) => assert_part(whole, found, &points),)*
                    _ => panic!("other types"),
                }
            };
        }
        compare!(Bool, Int32, Int64, Float, Double, Vec3i, Vec3s, Vec3d);
    }
}

fn assert_part<T: vdbake::formats::vdb::Value>(whole: &Tree<T>, part: &PartialTree<T>, points: &[[i32; 3]]) {
    assert_eq!(part.stats(), whole.stats());
    for point in points {
        let (expected, active) = whole.value(*point);
        match part.value(*point) {
            Ok(found) => assert!(found.0.same(expected) && found.1 == active, "{found:?} at {point:?}"),
            Err(NotRead { index }) => assert!(index == *point && whole.leaf_at(index).is_some()),
        }
    }
    for leaf in part.leaves() {
        let other = whole.leaf_at(leaf.origin).and_then(|number| whole.leaf(number)).expect("the same leaf");
        assert!(leaf.mask == other.mask && leaf.values.iter().zip(other.values).all(|(a, b)| a.same(*b)));
    }
}

#[allow(clippy::cast_precision_loss, reason = "the integers in these files are below 2^53")]
fn sample(tree: &AnyTree, at: [i32; 3]) -> Sample {
    let scalar = |(value, active): (f64, bool)| ([value, 0.0, 0.0], active);
    match tree {
        AnyTree::Bool(tree) => scalar((f64::from(u8::from(tree.value(at).0)), tree.value(at).1)),
        AnyTree::Int32(tree) => scalar((tree.value(at).0.into(), tree.value(at).1)),
        AnyTree::Int64(tree) => scalar((tree.value(at).0 as f64, tree.value(at).1)),
        AnyTree::Float(tree) => scalar((tree.value(at).0.into(), tree.value(at).1)),
        AnyTree::Double(tree) => scalar(tree.value(at)),
        AnyTree::Vec3i(tree) => (tree.value(at).0.map(f64::from), tree.value(at).1),
        AnyTree::Vec3s(tree) => (tree.value(at).0.map(f64::from), tree.value(at).1),
        AnyTree::Vec3d(tree) => tree.value(at),
    }
}

/// Where to compare: all voxels of a few hundred leaves and some of every other, corners of tiles, and places in and
/// around all that.
fn points(tree: &AnyTree) -> Vec<[i32; 3]> {
    with_tree!(tree, tree => points_of(tree))
}

fn points_of<T: vdbake::formats::vdb::Value>(tree: &Tree<T>) -> Vec<[i32; 3]> {
    let mut points = vec![[0; 3], [i32::MIN; 3], [i32::MAX; 3]];
    let mut state = 1;
    let whole = tree.leaf_count().div_ceil(100);
    for (number, leaf) in tree.leaves().enumerate() {
        let step = if number % whole == 0 { 1 } else { 101 };
        points.extend((0..512).step_by(step).map(|index| {
            let [x, y, z] = leaf.origin;
            [x + index / 64, y + index / 8 % 8, z + index % 8]
        }));
    }
    let tiles = tree.active_tiles().count().div_ceil(500).max(1);
    for tile in tree.active_tiles().step_by(tiles) {
        let last = (1 << tile.log2_edge) - 1;
        points.extend([tile.origin, tile.origin.map(|c| c + last), tile.origin.map(|c| c.wrapping_sub(1))]);
    }
    for leaf in tree.leaves().step_by(tree.leaf_count().div_ceil(300).max(1)) {
        points.extend((0..10).map(|_| {
            // Near, at the scale of lower nodes, and at that of upper nodes.
            let spread = [32, 512, 16384][usize::try_from(random(&mut state) % 3).expect("below 3")];
            leaf.origin.map(|c| {
                let moved =
                    i64::try_from(random(&mut state) % spread).expect("small") - spread.cast_signed() / 2;
                i32::try_from(i64::from(c) + moved).unwrap_or(c)
            })
        }));
    }
    points
}

/// That OpenVDB's description of a grid fits.
fn assert_described(grid: &Grid, report: &Value, context: &str) {
    let GridInfo { name, type_name, map, metadata, .. } = &grid.info;
    assert_eq!(report["name"], json!(name), "{context}");
    assert_eq!(format!("Tree_{}_5_4_3", report["type"].as_str().expect("text")), *type_name, "{context}");
    assert_eq!(described(metadata), *without_hints(&report["metadata"]), "{context}");
    assert_map(map, report, context);
    let stats = with_tree!(&grid.tree, tree => tree.stats());
    assert_eq!(report["active_voxels"], json!(stats.active_voxels), "{context}");
    assert_eq!(report["leaves"], json!(stats.leaves), "{context}");
    assert_eq!(report["bbox"], json!(stats.bounds), "{context}");
    let tiles = [9, 21, 36].iter().zip(stats.tiles).map(|(log2, count)| count << log2).sum::<u64>();
    assert_eq!(report["tile_voxels"], json!(tiles), "{context}");
    let background = match &grid.tree {
        AnyTree::Bool(tree) => json!(tree.background()),
        AnyTree::Int32(tree) => json!(tree.background()),
        AnyTree::Int64(tree) => json!(tree.background()),
        AnyTree::Float(tree) => json!(f64::from(tree.background())),
        AnyTree::Double(tree) => json!(tree.background()),
        AnyTree::Vec3i(tree) => json!(tree.background()),
        AnyTree::Vec3s(tree) => json!(tree.background().map(f64::from)),
        AnyTree::Vec3d(tree) => json!(tree.background()),
    };
    assert_eq!(report["background"], background, "{context}");
}

/// Frustums have no matrix. OpenVDB's comes from mapping points, so it is off by the rounding of sums with the translation.
fn assert_map(map: &Map, report: &Value, context: &str) {
    assert_eq!(report["map"], json!(map.type_name), "{context}");
    let Some(matrix) = map.matrix else {
        assert_eq!(map.type_name, "NonlinearFrustumMap", "{context}");
        return;
    };
    for (row, expected) in matrix.iter().zip(report["index_to_world"].as_array().expect("rows")) {
        let largest = row.iter().map(|x| x.abs()).fold(0.0, f64::max);
        for (found, expected) in row.iter().zip(expected.as_array().expect("numbers")) {
            let expected = expected.as_f64().expect("a number");
            assert!((found - expected).abs() <= 4.0 * f64::EPSILON * largest, "{context}: {map:?}");
        }
    }
}

/// OpenVDB's metadata without the hints for delayed loading, which are no information about the grid.
fn without_hints(metadata: &Value) -> Box<Value> {
    let mut metadata = metadata.clone();
    metadata.as_object_mut().expect("an object").remove("file_delayed_load");
    Box::new(metadata)
}

/// Metadata as OpenVDB's module gives it.
fn described(metadata: &Metadata) -> Value {
    let value = |meta: &Meta| match meta {
        Meta::String(text) => json!(text),
        Meta::Bool(flag) => json!(flag),
        Meta::Int32(number) => json!(number),
        Meta::Int64(number) => json!(number),
        Meta::Float(number) => json!(f64::from(*number)),
        Meta::Double(number) => json!(number),
        Meta::Vec2i(numbers) => json!(numbers),
        Meta::Vec2s(numbers) => json!(numbers.map(f64::from)),
        Meta::Vec2d(numbers) => json!(numbers),
        Meta::Vec3i(numbers) => json!(numbers),
        Meta::Vec3s(numbers) => json!(numbers.map(f64::from)),
        Meta::Vec3d(numbers) => json!(numbers),
        Meta::Vec4i(numbers) => json!(numbers),
        Meta::Vec4s(numbers) => json!(numbers.map(f64::from)),
        Meta::Vec4d(numbers) => json!(numbers),
        Meta::Mat4s(rows) => json!(rows.map(|row| row.map(f64::from))),
        Meta::Mat4d(rows) => json!(rows),
        Meta::Other { type_name, .. } => json!(type_name),
    };
    metadata.iter().map(|(name, meta)| (name.clone(), value(meta))).collect::<serde_json::Map<_, _>>().into()
}
