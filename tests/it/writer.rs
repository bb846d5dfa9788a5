//! What the library writes, as others read it: trees of random shape and of extreme values, in every type, precision and
//! compression, one or several in a file.

use std::fs::{self, File};
use std::path::{Path, PathBuf};

use half::f16;
use serde_json::{Value, json};
use sha2::{Digest, Sha256};
use tempfile::tempdir;
use vdbake::formats::npy::{self, Array, Values};
use vdbake::formats::vdb::{
    AnyTree, Compression, EncodedBricks, Encoder, FileHeader, FileWriter, GridClass, GridHeader, Leaf,
    Metadata, Precision, Stats, Tile, Topology, VdbFile, VdbGridBuilder, VectorType, Voxel, WriteGrid,
    file_order, write,
};

use crate::oracle::{OPENVDBS, openvdb_probe, openvdb_probe_by, vdb_rs, vdb_tool};
use crate::support::{self, FORMS, assert_same, bake, random, scenes_with_tiles, stderr, vdbake};

/// An index, the value there (a number stands in the first place), and whether it is active.
type Sample = ([i32; 3], [f32; 3], bool);

/// What a grid should hold.
struct Expected {
    name: &'static str,
    kind: &'static str,
    class: &'static str,
    vector_type: &'static str,
    precision: Precision,
    stats: Stats,
    samples: Vec<Sample>,
}

/// A written file.
struct Written {
    path: PathBuf,
    /// In the order of their names.
    grids: Vec<Expected>,
}

const COMPRESSIONS: [Compression; 3] = [Compression::None, Compression::Zip, Compression::Blosc];

fn encoders() -> Vec<Encoder> {
    let precisions = [Precision::F32, Precision::F16];
    precisions
        .iter()
        .flat_map(|precision| {
            COMPRESSIONS.map(|compression| Encoder::new(compression).with_precision(*precision))
        })
        .collect()
}

/// What is read where this number was written.
fn kept(x: f32, precision: Precision) -> f32 {
    match precision {
        Precision::F32 => x,
        Precision::F16 => f16::from_f32(x.clamp(-65504.0, 65504.0)).to_f32(),
    }
}

/// A type of voxel, as these tests make and compare it.
trait Tested: Voxel {
    const KIND: &'static str;
    const VECTOR: bool;
    fn of(numbers: [f32; 3]) -> Self;
    fn kept(self, precision: Precision) -> [f32; 3];
}

impl Tested for f32 {
    const KIND: &'static str = "float";
    const VECTOR: bool = false;
    fn of([x, _, _]: [f32; 3]) -> f32 {
        x
    }
    fn kept(self, precision: Precision) -> [f32; 3] {
        [kept(self, precision), 0.0, 0.0]
    }
}

impl Tested for [f32; 3] {
    const KIND: &'static str = "vec3s";
    const VECTOR: bool = true;
    fn of(numbers: [f32; 3]) -> [f32; 3] {
        numbers
    }
    fn kept(self, precision: Precision) -> [f32; 3] {
        self.map(|x| kept(x, precision))
    }
}

/// A number of one of several kinds: common, or at the ends of what binary16 holds.
fn number(kind: u64, state: &mut u64) -> f32 {
    let bits = random(state);
    let unit = f32::from(u16::try_from(bits >> 48).expect("16 bits")) / 65536.0 + 0.1 / 65536.0;
    let sign = if bits & 1 == 0 { 1.0 } else { -1.0 };
    match kind {
        0 => unit,
        1 => sign * unit,
        // Subnormal in binary16, some of them below all it has.
        2 => sign * unit * 6.2e-5,
        3 => sign * unit * 1e-7,
        // Around its largest number, and far beyond.
        4 => sign * (65400.0 + 200.0 * unit),
        5 => sign * unit * 1e30,
        6 => 0.0 * sign,
        // Subnormal in single precision.
        7 => f32::from_bits(u32::try_from(bits >> 48).expect("16 bits")),
        _ => [1.0, 0.5, 0.25, 2049.0, 2051.0][usize::try_from(bits % 5).expect("small")],
    }
}

type Brick<T> = ([i32; 3], [u64; 8], [T; 512]);

/// Bricks in file order: dense and sparse ones, uniform ones alone and filling a node, near the origin in all octants and
/// far from it, at the ends of the lattice too.
fn bricks<T: Tested>(seed: u64, extreme: bool) -> Vec<Brick<T>> {
    let mut state = seed;
    let near = (0..64).map(|n| [n / 16 * 8 - 16, n / 4 % 4 * 8 - 16, n % 4 * 8 - 16]);
    let mut origins: Vec<[i32; 3]> = near.filter(|_| !random(&mut state).is_multiple_of(3)).collect();
    origins.extend((0..12).map(|_| {
        let shift = 14 + random(&mut state) % 18;
        [(); 3].map(|()| {
            (i32::from_le_bytes(random(&mut state).to_le_bytes()[..4].try_into().expect("4"))
                >> (31 - shift.min(31)))
                & !7
        })
    }));
    origins.extend([[i32::MIN; 3], [i32::MAX - 7; 3]]);
    let mut bricks: Vec<Brick<T>> = vec![];
    for origin in origins {
        let kind = if extreme { random(&mut state) % 9 } else { random(&mut state) % 4 };
        let mut value = || T::of([(); 3].map(|()| number(kind, &mut state)));
        let first = value();
        let mut values = [first; 512];
        values.iter_mut().for_each(|v| *v = value());
        let mask = match random(&mut state) % 5 {
            0 => [u64::MAX; 8],
            1 => {
                values = [first; 512];
                [u64::MAX; 8]
            }
            2 => [(); 8]
                .map(|()| random(&mut state) & random(&mut state) & random(&mut state) & random(&mut state)),
            3 => {
                let mut mask = [0; 8];
                mask[usize::try_from(random(&mut state) % 8).expect("small")] =
                    1 << (random(&mut state) % 64);
                mask
            }
            _ => [(); 8].map(|()| random(&mut state)),
        };
        bricks.push((origin, mask, values));
    }
    // A lower node that becomes one tile, and one that does not because of one brick.
    for (corner, odd) in [([128, -256, 0], None), ([256, -256, 0], Some(77))] {
        bricks.extend((0..4096).map(|n| {
            let place = [n / 256 * 8, n / 16 % 16 * 8, n % 16 * 8];
            let value = T::of(if odd == Some(n) { [0.75; 3] } else { [1.0 / 3.0, -0.1, 7.0] });
            ([0, 1, 2].map(|axis| corner[axis] + place[axis]), [u64::MAX; 8], [value; 512])
        }));
    }
    bricks.sort_by_key(|brick| file_order(brick.0));
    bricks.dedup_by_key(|brick| brick.0);
    bricks
}

fn build<T: Tested>(encoder: Encoder, bricks: &[Brick<T>]) -> VdbGridBuilder<T> {
    let mut grid = VdbGridBuilder::with_encoder(encoder);
    let mut run = EncodedBricks::default();
    for (origin, mask, values) in bricks {
        run.push(encoder, *origin, mask, values);
    }
    grid.append(&run).expect("sorted");
    grid
}

/// All voxels of bricks with values of their own, and the ends of the others.
fn samples<T: Tested>(bricks: &[Brick<T>], precision: Precision) -> Vec<Sample> {
    let mut samples = vec![];
    for (origin, mask, values) in bricks {
        let uniform = *mask == [u64::MAX; 8] && values.iter().all(|value| value.same(values[0]));
        let step = if uniform { 511 } else { 1 };
        for index in (0..512_usize).step_by(step) {
            let active = (mask[index / 64] >> (index % 64)) & 1 == 1;
            let [x, y, z] = [index / 64, index / 8 % 8, index % 8].map(|c| i32::try_from(c).expect("small"));
            let value = if active { values[index].kept(precision) } else { [0.0; 3] };
            samples.push(([origin[0] + x, origin[1] + y, origin[2] + z], value, active));
        }
    }
    samples
}

fn file_header() -> FileHeader {
    FileHeader {
        uuid: uuid::Uuid::from_u128(7),
        metadata: Metadata::from([("creator".into(), "test".into())]),
    }
}

fn grid_header(name: &str, class: GridClass, vector_type: VectorType) -> GridHeader {
    let translation = [0.125, -2.0, 0.0];
    GridHeader {
        name: name.to_owned(),
        class,
        vector_type,
        voxel_size: 0.25,
        translation,
        metadata: Metadata::new(),
    }
}

fn put(path: PathBuf, grids: &[(&GridHeader, &dyn WriteGrid)], expected: Vec<Expected>) -> Written {
    let file = File::create(&path).expect("a writable folder");
    let length = write(file, &file_header(), grids).expect("valid grids");
    assert_eq!(fs::metadata(&path).expect("a file").len(), length);
    Written { path, grids: expected }
}

/// Files of one form: numbers, vectors, and several grids of both.
fn written(folder: &Path, encoder: Encoder) -> [Written; 3] {
    let precision = encoder.precision();
    let path = |kind: &str| {
        let (compression, precision) = (encoder.compression(), encoder.precision());
        folder.join(format!("{kind}_{compression:?}_{precision:?}.vdb"))
    };
    let (numbers, vectors) = (bricks::<f32>(1, true), bricks::<[f32; 3]>(2, true));
    let (float, vec3s) = (build(encoder, &numbers), build(encoder, &vectors));
    let other = Encoder::new(Compression::Zip);
    let (nothing, no_vectors) =
        (VdbGridBuilder::<f32>::with_encoder(encoder), VdbGridBuilder::with_encoder(encoder));
    let single = build(other, &vectors);

    let density = grid_header("density", GridClass::FogVolume, VectorType::Invariant);
    let velocity = grid_header("velocity", GridClass::Staggered, VectorType::ContravariantRelative);
    let color = grid_header("color", GridClass::Unknown, VectorType::Invariant);
    let empty = grid_header("empty", GridClass::LevelSet, VectorType::Invariant);
    let no_colors = grid_header("no colors", GridClass::Unknown, VectorType::CovariantNormalize);
    let expect_float = |name, class, bricks: &[Brick<f32>], grid: &VdbGridBuilder| Expected {
        name,
        kind: "float",
        class,
        vector_type: "invariant",
        precision,
        stats: grid.stats(),
        samples: samples(bricks, precision),
    };
    let expect_vec3s =
        |name, class, vector_type, precision, bricks: &[Brick<[f32; 3]>], grid: &VdbGridBuilder<[f32; 3]>| {
            Expected {
                name,
                kind: "vec3s",
                class,
                vector_type,
                precision,
                stats: grid.stats(),
                samples: samples(bricks, precision),
            }
        };
    let of_density = || expect_float("density", "fog volume", &numbers, &float);
    let of_velocity =
        || expect_vec3s("velocity", "staggered", "contravariant relative", precision, &vectors, &vec3s);
    let single_precision = other.precision();
    [
        put(path("float"), &[(&density, &float)], vec![of_density()]),
        put(path("vec3s"), &[(&velocity, &vec3s)], vec![of_velocity()]),
        put(
            path("several"),
            &[
                (&color, &single),
                (&density, &float),
                (&empty, &nothing),
                (&no_colors, &no_vectors),
                (&velocity, &vec3s),
            ],
            vec![
                expect_vec3s("color", "unknown", "invariant", single_precision, &vectors, &single),
                of_density(),
                expect_float("empty", "level set", &[], &nothing),
                expect_vec3s("no colors", "unknown", "covariant normalize", precision, &[], &no_vectors),
                of_velocity(),
            ],
        ),
    ]
}

/// What no bake makes: root tiles, leaves without an active voxel, and nodes with nothing but those.
fn odd<T: Tested>(folder: &Path, encoder: Encoder) -> Written {
    let precision = encoder.precision();
    let value = T::of([0.1, -60000.3, 1e-6]);
    let mut mask = [0; 8];
    mask[3] = 1 << 42;
    let leaf = |origin, mask| (Leaf { origin, mask }, [value; 512]);
    let parts = [
        Err(Tile { origin: [-8192, 0, 0], log2_edge: 12, value }),
        Err(Tile { origin: [-4096, -4096, -128], log2_edge: 7, value }),
        Ok(leaf([-8, -8, -8], [0; 8])),
        Ok(leaf([0, 0, 0], mask)),
        Ok(leaf([0, 0, 8], [0; 8])),
        Err(Tile { origin: [0, 0, 16], log2_edge: 3, value }),
        Ok(leaf([0, 4096, 0], [0; 8])),
        Ok(leaf([0, 4096, 8], [0; 8])),
        Err(Tile { origin: [4096, 0, 0], log2_edge: 12, value: T::of([1e30; 3]) }),
    ];
    let mut topology = Topology::default();
    let mut buffers = vec![];
    let mut samples = vec![];
    for part in &parts {
        match part {
            Ok((leaf, values)) => {
                topology.push_leaf(*leaf).expect("sorted");
                encoder.encode_leaf(&leaf.mask, values, &mut buffers);
                samples.extend(self::samples(&[(leaf.origin, leaf.mask, *values)], precision));
            }
            Err(tile) => {
                topology.push_tile(*tile).expect("sorted");
                let last = (1 << tile.log2_edge) - 1;
                let [x, y, z] = tile.origin;
                let value = tile.value.kept(precision);
                samples.extend([([x, y, z], value, true), ([x + last, y, z + last], value, true)]);
            }
        }
    }
    let vector_type = VectorType::Covariant;
    let header = grid_header("odd", GridClass::Unknown, vector_type);
    let path = folder.join(format!("odd_{}_{:?}_{precision:?}.vdb", T::KIND, encoder.compression()));
    let mut file = FileWriter::new(File::create(&path).expect("a writable folder"), &file_header(), 1)
        .expect("a header");
    file.grid(&header, &topology, encoder, buffers.len() as u64, [&buffers]).expect("a grid");
    file.finish().expect("complete");
    let expected = Expected {
        name: "odd",
        kind: T::KIND,
        class: "unknown",
        vector_type: if T::VECTOR { "covariant" } else { "invariant" },
        precision,
        stats: topology.stats(),
        samples,
    };
    Written { path, grids: vec![expected] }
}

/// Where to look in a file: wherever something is expected of any of its grids.
fn points(file: &Written) -> Vec<[i32; 3]> {
    let mut points: Vec<[i32; 3]> =
        file.grids.iter().flat_map(|grid| grid.samples.iter().map(|sample| sample.0)).collect();
    points.sort_unstable();
    points.dedup();
    points
}

fn assert_found(found: [f64; 3], active: bool, expected: &Sample, context: &str) {
    let bits = |value: [f64; 3]| value.map(f64::to_bits);
    assert_eq!(
        (bits(found), active),
        (bits(expected.1.map(f64::from)), expected.2),
        "{context} {:?}",
        expected.0
    );
}

fn assert_read_by_openvdb(files: &[Written]) {
    let points: Vec<_> = files.iter().map(points).collect();
    let paths: Vec<&Path> = files.iter().map(|file| file.path.as_path()).collect();
    for python in OPENVDBS {
        for ((file, points), probed) in
            files.iter().zip(&points).zip(openvdb_probe_by(python, &paths, &points))
        {
            assert_eq!(probed.grids.len(), file.grids.len());
            for (number, (grid, found)) in file.grids.iter().zip(&probed.grids).enumerate() {
                let context = format!("{python} {} {}", file.path.display(), grid.name);
                assert_described(&probed.report["grids"][number], grid, &context);
                for sample in &grid.samples {
                    let at = points.binary_search(&sample.0).expect("a point");
                    let (value, active) = found[at];
                    assert_found(value, active, sample, &context);
                }
            }
        }
    }
}

fn assert_described(report: &Value, grid: &Expected, context: &str) {
    let tiles = [9, 21, 36].iter().zip(grid.stats.tiles).map(|(log2, count)| count << log2).sum::<u64>();
    let zero = if grid.kind == "vec3s" { json!([0.0, 0.0, 0.0]) } else { json!(0.0) };
    for (key, expected) in [
        ("name", json!(grid.name)),
        ("type", json!(grid.kind)),
        ("class", json!(grid.class)),
        ("vector_type", json!(grid.vector_type)),
        ("half", json!(grid.precision == Precision::F16)),
        ("background", zero),
        ("map", json!("UniformScaleTranslateMap")),
        ("voxel_size", json!([0.25, 0.25, 0.25])),
        ("origin", json!([0.125, -2.0, 0.0])),
        ("active_voxels", json!(grid.stats.active_voxels)),
        ("leaves", json!(grid.stats.leaves)),
        ("tile_voxels", json!(tiles)),
        ("bbox", json!(grid.stats.bounds)),
    ] {
        assert_eq!(report[key], expected, "{context} {key}");
    }
}

/// That the program gives what is expected of a grid.
fn assert_sampled(file: &Path, grid: &Expected) {
    let list = file.with_extension("points.npy");
    let found = file.with_extension("found.npy");
    let points: Vec<f64> = grid.samples.iter().flat_map(|sample| sample.0.map(f64::from)).collect();
    let array = Array { shape: vec![grid.samples.len(), 3], values: Values::F64(points) };
    npy::write(&mut File::create(&list).expect("a writable folder"), &array).expect("a writable file");
    let mut command = vdbake();
    command.arg("sample").arg(file).args(["--quiet", "--index", "--grid", grid.name, "--points"]);
    let output = command.arg(&list).arg("-o").arg(&found).output().expect("the program starts");
    assert!(output.status.success(), "{}", stderr(&output));
    let Values::F32(found) = npy::read(&mut File::open(&found).expect("a file")).expect("an array").values
    else {
        panic!("single precision")
    };
    let width = if grid.kind == "vec3s" { 3 } else { 1 };
    assert_eq!(found.len(), width * grid.samples.len());
    for (found, (at, expected, _)) in found.chunks(width).zip(&grid.samples) {
        let same = found.iter().zip(expected).all(|(a, b)| a.to_bits() == b.to_bits());
        assert!(same, "{} {}: {found:?}, not {expected:?} at {at:?}", file.display(), grid.name);
    }
}

#[test]
fn openvdb_reads_every_form_of_random_trees() {
    let folder = tempdir().expect("a temporary folder");
    let files: Vec<Written> =
        encoders().into_iter().flat_map(|encoder| written(folder.path(), encoder)).collect();
    assert_eq!(files.len(), 18);
    let seen = |what: &dyn Fn(f32) -> bool| {
        let samples = files[9..].iter().flat_map(|file| &file.grids).flat_map(|grid| &grid.samples);
        assert!(samples.flat_map(|sample| sample.1).any(what));
    };
    seen(&|x| x.to_bits() == (-0.0_f32).to_bits());
    seen(&|x| x != 0.0 && x.abs() < 6.1e-5);
    seen(&|x| x == -65504.0);
    seen(&|x| (65400.0..65504.0).contains(&x));
    assert!(files[0].grids[0].stats.tiles.iter().take(2).all(|count| *count > 0));
    assert_read_by_openvdb(&files);
    for file in &files {
        file.grids
            .iter()
            .filter(|grid| !grid.samples.is_empty())
            .for_each(|grid| assert_sampled(&file.path, grid));
    }
}

#[test]
fn openvdb_reads_what_no_bake_makes() {
    let folder = tempdir().expect("a temporary folder");
    let files: Vec<Written> = encoders()
        .into_iter()
        .flat_map(|encoder| [odd::<f32>(folder.path(), encoder), odd::<[f32; 3]>(folder.path(), encoder)])
        .collect();
    assert_read_by_openvdb(&files);
    for file in &files {
        file.grids.iter().for_each(|grid| assert_sampled(&file.path, grid));
    }
}

#[test]
fn vdb_rs_reads_the_grids_of_numbers() {
    let folder = tempdir().expect("a temporary folder");
    for encoder in encoders() {
        let bricks: Vec<_> = bricks::<f32>(3, true)
            .into_iter()
            .filter(|brick| brick.0.iter().all(|c| c.unsigned_abs() < 1 << 20))
            .collect();
        let grid = build(encoder, &bricks);
        let vectors = build(encoder, &self::bricks::<[f32; 3]>(4, true));
        let header = grid_header("density", GridClass::FogVolume, VectorType::Invariant);
        let other = grid_header("velocity", GridClass::Unknown, VectorType::Invariant);
        let path = folder.path().join("both.vdb");
        put(path.clone(), &[(&other, &vectors), (&header, &grid)], vec![]);
        let mut expected: Vec<_> = bricks
            .iter()
            .flat_map(|(origin, mask, values)| {
                (0..512_usize).filter(|i| (mask[i / 64] >> (i % 64)) & 1 == 1).map(|i| {
                    let [x, y, z] = [i / 64, i / 8 % 8, i % 8].map(|c| i32::try_from(c).expect("small"));
                    ([origin[0] + x, origin[1] + y, origin[2] + z], kept(values[i], encoder.precision()))
                })
            })
            .collect();
        expected.sort_by_key(|voxel| voxel.0);
        assert_same(&vdb_rs(&path, "density"), &expected, &format!("{encoder:?}"));
    }
}

/// The nearest number of binary16 is what OpenVDB takes when it stores the same grid so, but it lets large ones overflow.
#[test]
fn openvdb_rounds_to_the_same_halves() {
    let folder = tempdir().expect("a temporary folder");
    let path = |name: &str| folder.path().join(name);
    let text = |path: &Path| path.to_str().expect("UTF-8").to_owned();
    let bricks = bricks::<[f32; 3]>(5, true);
    let header = grid_header("velocity", GridClass::Unknown, VectorType::Invariant);
    let (full, ours, theirs) = (path("full.vdb"), path("ours.vdb"), path("theirs.vdb"));
    let encoder = Encoder::new(Compression::Blosc);
    put(full.clone(), &[(&header, &build(encoder, &bricks))], vec![]);
    let grid = build(encoder.with_precision(Precision::F16), &bricks);
    put(ours.clone(), &[(&header, &grid)], vec![]);
    vdb_tool(&["-read", "delayed=0", &text(&full), "-write", "codec=blosc", "bits=16", &text(&theirs)]);
    let points: Vec<[i32; 3]> = samples(&bricks, Precision::F16).iter().map(|sample| sample.0).collect();
    let probed = openvdb_probe(&[&ours, &theirs], &[points.clone(), points]);
    let [ours, theirs] = [&probed[0], &probed[1]];
    assert_eq!(theirs.report["grids"][0]["half"], true);
    let (mut finite, mut beyond) = (0, 0);
    for (ours, theirs) in ours.grids[0].iter().zip(&theirs.grids[0]) {
        assert_eq!(ours.1, theirs.1);
        for (ours, theirs) in ours.0.iter().zip(theirs.0) {
            let expected = if theirs.is_infinite() { 65504.0_f64.copysign(theirs) } else { theirs };
            assert_eq!(ours.to_bits(), expected.to_bits());
            finite += usize::from(theirs.is_finite());
            beyond += usize::from(theirs.is_infinite());
        }
    }
    assert!(finite > 10_000 && beyond > 100, "{finite} {beyond}");
}

/// The hash that a file carries is that of the values in it, by its definition.
#[test]
fn the_content_hash_is_over_what_is_read() {
    let folder = tempdir().expect("a temporary folder");
    for scene in scenes_with_tiles(folder.path()) {
        for form in [FORMS[0], FORMS[3]] {
            let baked = bake(&scene, folder.path(), &form);
            let mut file = VdbFile::open(File::open(&baked.path).expect("a file")).expect("a VDB file");
            let AnyTree::Float(tree) = file.grid("density").expect("the grid").tree else { panic!("float") };
            let leaves = tree.leaves().map(|leaf| (leaf.origin, *leaf.mask, *leaf.values));
            let mut bricks: Vec<Brick<f32>> = leaves.collect();
            for tile in tree.active_tiles() {
                assert_eq!(tile.log2_edge, 3, "small scenes have no others");
                bricks.push((tile.origin, [u64::MAX; 8], [tile.value; 512]));
            }
            bricks.sort_by_key(|brick| file_order(brick.0));
            let mut hash = Sha256::new();
            for (origin, mask, values) in &bricks {
                let mut bytes: Vec<u8> = origin.iter().flat_map(|c| c.to_le_bytes()).collect();
                bytes.extend(mask.iter().flat_map(|word| word.to_le_bytes()));
                bytes.extend(values.iter().flat_map(|x| x.to_le_bytes()));
                hash.update(twox_hash::XxHash3_128::oneshot(&bytes).to_be_bytes());
            }
            let digest: String = hash.finalize().iter().map(|byte| format!("{byte:02x}")).collect();
            assert_eq!(baked.report["content_hash"], digest, "{} {form:?}", scene.display());
        }
    }
}

/// A tube of one density, far beyond binary16 and around its end.
#[test]
fn densities_beyond_the_range_are_clamped_and_told() {
    let folder = tempdir().expect("a temporary folder");
    let scene = |density: &str| {
        let layer = format!("[[tube.layer]]\nnoise = \"constant\"\nvalue = {density}\n");
        // Without means of cells, which are of any density.
        let solid = support::SOLID.replacen("[[tube]]", "[bake]\nantialias = \"off\"\n[[tube]]", 1);
        support::write(&folder.path().join("dense.toml"), &[solid, layer].concat())
    };
    for (density, stored, clamped) in [
        ("1e6", 65504.0, true),
        ("65520", 65504.0, true),
        ("65519", 65504.0, true),
        ("65504", 65504.0, false),
        ("3e4", 30000.0, false),
    ] {
        let scene = scene(density);
        let baked = bake(&scene, folder.path(), &FORMS[3]);
        let voxels = baked.report["active_voxels"].as_u64().expect("a count");
        let expected = if clamped { voxels } else { 0 };
        assert_eq!(baked.report["clamped_voxels"], expected, "{density}");
        let found = vdb_rs(&baked.path, "density");
        assert!(found.iter().all(|voxel| voxel.1 == stored), "{density}");
        assert_eq!(bake(&scene, folder.path(), &FORMS[0]).report["clamped_voxels"], 0);

        let mut command = vdbake();
        command.arg("bake").arg(&scene).arg("-o").arg(folder.path().join("told.vdb"));
        let output = command.args(["--resolution", "16", "--precision", "f16"]).output().expect("starts");
        assert_eq!(stderr(&output).contains("note: ") && stderr(&output).contains("65504"), clamped);
    }
    // 2^-25 lies halfway between 0 and the least number.
    for (density, vanishes) in [("2.9e-8", true), ("3.0e-8", false), ("1e-12", true)] {
        let scene = scene(density);
        let baked = bake(&scene, folder.path(), &FORMS[3]);
        let voxels = baked.report["active_voxels"].as_u64().expect("a count");
        assert!(voxels > 0);
        assert_eq!(baked.report["vanished_voxels"], if vanishes { voxels } else { 0 }, "{density}");
        assert_eq!(baked.report["clamped_voxels"], 0);
        assert_eq!(bake(&scene, folder.path(), &FORMS[0]).report["vanished_voxels"], 0);
        let mut command = vdbake();
        command.arg("bake").arg(&scene).arg("-o").arg(folder.path().join("told.vdb"));
        let output = command.args(["--resolution", "16", "--precision", "f16"]).output().expect("starts");
        assert_eq!(stderr(&output).contains("got the value 0"), vanishes, "{}", stderr(&output));
    }
}
