//! Whole files, judged by vdb-rs, a reader that shares no code with this writer.

use std::collections::BTreeMap;
use std::io::Cursor;

use sha2::{Digest, Sha256};
use uuid::Uuid;
use vdb_rs::{VdbLevel, VdbReader};

use super::*;

pub(super) const ALL: [Compression; 3] = [Compression::None, Compression::Zip, Compression::Blosc];

/// All ways to encode.
pub(super) const ENCODERS: [Encoder; 6] = {
    let [a, b, c] = [Encoder::new(ALL[0]), Encoder::new(ALL[1]), Encoder::new(ALL[2])];
    let half = Precision::F16;
    [a, b, c, a.with_precision(half), b.with_precision(half), c.with_precision(half)]
};

/// A brick to encode: origin, mask, values.
pub(super) type Brick<T = f32> = ([i32; 3], [u64; 8], [T; 512]);

/// splitmix64 (Steele, Lea, Flood 2014).
pub(super) fn random(state: &mut u64) -> u64 {
    *state = state.wrapping_add(0x9E37_79B9_7F4A_7C15);
    let z = (*state ^ (*state >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    let z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    z ^ (z >> 31)
}

/// A number in [0, 1) with 24 random bits, as noisy as a mantissa can be.
pub(super) fn random_value(state: &mut u64) -> f32 {
    u16::try_from(random(state) >> 48).map_or(0.0, |high| f32::from(high) / 65536.0)
        + u8::try_from(random(state) >> 56).map_or(0.0, |low| f32::from(low) / 16_777_216.0)
}

pub(super) fn is_on(mask: &[u64; 8], index: usize) -> bool {
    (mask[index / 64] >> (index % 64)) & 1 == 1
}

/// A shell of random density around index (0, 0, 0), so that all eight octants have leaves; inside it tiles; besides, a
/// lower node made of tiles, a leaf that is active throughout, a smooth one, and single voxels in far upper nodes.
/// Inactive voxels hold values, too, which must not be stored.
pub(super) fn bricks() -> Vec<Brick> {
    let mut state = 1;
    let mut bricks = vec![];
    let range = || (-48..48).step_by(8);
    for (x, y, z) in range().flat_map(|x| range().flat_map(move |y| range().map(move |z| (x, y, z)))) {
        let mut mask = [0; 8];
        let mut values = [0.75; 512];
        for (index, value) in (0..).zip(&mut values) {
            let [i, j, k] = [x + index / 64, y + index / 8 % 8, z + index % 8];
            let squared = i * i + j * j + k * k;
            if squared <= 44 * 44 {
                let word: &mut u64 = &mut mask[usize::try_from(index / 64).expect("below 8")];
                *word |= 1 << (index % 64);
            }
            if squared >= 24 * 24 {
                *value = random_value(&mut state);
            }
        }
        bricks.push(([x, y, z], mask, values));
    }
    let node = || (0..128).step_by(8);
    for (x, y, z) in node().flat_map(|x| node().flat_map(move |y| node().map(move |z| (x, y, z)))) {
        bricks.push(([x - 256, y + 128, z - 4096], [u64::MAX; 8], [0.25; 512]));
    }
    let mut ramp = [0.0; 512];
    ramp.iter_mut().zip(0_u16..).for_each(|(value, index)| *value = f32::from(index) / 512.0);
    bricks.push(([4096, -8, 0], [u64::MAX; 8], ramp));
    bricks.push(([4104, -8, 0], [u64::MAX; 8], ramp.map(|v| 1.0 - (v * 64.0).floor() / 64.0)));
    for (origin, index) in [([-81920, 40960, 8], 511), ([123_456, -65_536, -8], 0), ([-8, -8, 5000], 257)] {
        let mut mask = [0; 8];
        mask[index / 64] = 1 << (index % 64);
        bricks.push((origin, mask, [1.5; 512]));
    }
    bricks.sort_by_key(|(origin, ..)| file_order(*origin));
    bricks
}

/// The bricks with vectors in place of numbers, no two components alike.
pub(super) fn vectors(bricks: &[Brick]) -> Vec<Brick<[f32; 3]>> {
    bricks.iter().map(|(origin, mask, values)| (*origin, *mask, values.map(|x| [x, -3.0 * x, 0.1]))).collect()
}

pub(super) fn build(compression: Compression, bricks: &[Brick]) -> VdbGridBuilder {
    build_with(Encoder::new(compression), bricks)
}

pub(super) fn build_with<T: Voxel>(encoder: Encoder, bricks: &[Brick<T>]) -> VdbGridBuilder<T> {
    let mut grid = VdbGridBuilder::with_encoder(encoder);
    let run = encode(grid.encoder(), bricks);
    grid.append(&run).expect("bricks are sorted");
    grid
}

fn encode<T: Voxel>(encoder: Encoder, bricks: &[Brick<T>]) -> EncodedBricks<T> {
    let mut run = EncodedBricks::default();
    for (origin, mask, values) in bricks {
        run.push(encoder, *origin, mask, values);
    }
    run
}

pub(super) fn file_header() -> FileHeader {
    let metadata = Metadata::from([("creator".into(), "test".into()), ("answer".into(), Meta::Int32(42))]);
    FileHeader { uuid: Uuid::from_u128(0x0123_4567_89ab_cdef_0011_2233_4455_6677), metadata }
}

pub(super) fn grid_header(name: &str) -> GridHeader {
    let metadata = Metadata::from([("content_hash".into(), "abc".into())]);
    GridHeader {
        name: name.to_owned(),
        class: GridClass::FogVolume,
        vector_type: VectorType::ContravariantRelative,
        voxel_size: 0.1,
        translation: [1.0, -2.0, 0.05],
        metadata,
    }
}

pub(super) fn file(grids: &[(&GridHeader, &dyn WriteGrid)]) -> Vec<u8> {
    let mut bytes = vec![];
    let length = write(&mut bytes, &file_header(), grids).expect("valid grids");
    assert_eq!(length, bytes.len() as u64);
    bytes
}

fn read(bytes: &[u8], name: &str) -> vdb_rs::Grid<f32> {
    VdbReader::new(Cursor::new(bytes)).expect("header").read_grid::<f32>(name).expect("grid")
}

/// Active voxels and tiles by index and edge; values as bits.
type Content = BTreeMap<([i32; 3], i32), u32>;

#[allow(clippy::cast_possible_truncation, reason = "vdb-rs gives whole numbers as floats")]
fn content(grid: &vdb_rs::Grid<f32>) -> Content {
    let entry = |(at, value, level): (_, f32, VdbLevel)| {
        // The type is that of another version of glam.
        let at: [f32; 3] = <[f32; 3]>::from(at);
        ((at.map(|c| c as i32), level.scale() as i32), value.to_bits())
    };
    grid.iter().map(entry).collect()
}

fn expected(bricks: &[Brick]) -> Content {
    let mut content = Content::new();
    for (origin, mask, values) in bricks {
        if mask == &[u64::MAX; 8] && values.iter().all(|v| *v == values[0]) {
            content.insert((*origin, 8), values[0].to_bits());
            continue;
        }
        for (index, value) in (0..).zip(values).filter(|(index, _)| is_on(mask, *index)) {
            let [x, y, z] =
                [index / 64, index / 8 % 8, index % 8].map(|c| i32::try_from(c).expect("below 8"));
            content.insert(([origin[0] + x, origin[1] + y, origin[2] + z], 1), value.to_bits());
        }
    }
    // The lower node that is made of tiles.
    let node = [-256, 128, -4096];
    let before = content.len();
    content.retain(|(at, edge), _| *edge != 8 || at.map(|c| c >> 7) != node.map(|c: i32| c >> 7));
    if before - content.len() == 4096 {
        content.insert((node, 128), 0.25_f32.to_bits());
    }
    content
}

#[test]
fn other_reader_finds_every_value() {
    let bricks = bricks();
    let expected = expected(&bricks);
    for compression in ALL {
        let grid = build(compression, &bricks);
        let bytes = file(&[(&grid_header("density"), &grid)]);
        let found = read(&bytes, "density");
        assert!(content(&found) == expected, "{compression:?}");

        let stats = grid.stats();
        let edges = |edge| expected.keys().filter(|(_, e)| *e == edge).count() as u64;
        assert_eq!(stats.tiles, [edges(8), edges(128), 0]);
        assert!(stats.tiles[0] > 0 && stats.tiles[1] == 1);
        assert_eq!(stats.active_voxels, edges(1) + 512 * edges(8) + 128 * 128 * 128 * edges(128));
        assert_eq!(i64::try_from(stats.active_voxels).ok(), found.descriptor.voxel_count().ok());
        let [low, high] = stats.bounds.expect("not empty");
        let low_of = |axis: usize| expected.keys().map(|(at, _)| at[axis]).min();
        let high_of = |axis: usize| expected.keys().map(|(at, edge)| at[axis] + edge - 1).max();
        assert_eq!([0, 1, 2].map(low_of), low.map(Some));
        assert_eq!([0, 1, 2].map(high_of), high.map(Some));
        assert_eq!(<[i32; 3]>::from(found.descriptor.aabb_min().expect("bounds")), low);
        assert_eq!(<[i32; 3]>::from(found.descriptor.aabb_max().expect("bounds")), high);
    }
}

#[test]
fn inactive_voxels_are_background() {
    for compression in ALL {
        let bytes = file(&[(&grid_header("density"), &build(compression, &bricks()))]);
        for root in read(&bytes, "density").tree.root_nodes {
            for leaf in root.nodes.values().flat_map(|node| node.nodes.values()) {
                assert_eq!(leaf.buffer.len(), 512);
                let off = leaf.buffer.iter().zip(&leaf.value_mask).filter(|(_, on)| !**on);
                assert!(off.into_iter().all(|(value, _)| value.to_bits() == 0));
            }
        }
    }
}

#[test]
fn empty_grids_single_voxels_and_several_grids() {
    let mut mask = [0; 8];
    mask[5] = 1 << 13;
    let single = [([-8, 16, 0], mask, [0.5; 512])];
    for compression in ALL {
        let (empty, one) = (build(compression, &[([0; 3], [0; 8], [9.0; 512])]), build(compression, &single));
        let bytes = file(&[(&grid_header("empty"), &empty), (&grid_header("one"), &one)]);
        assert_eq!(content(&read(&bytes, "empty")), Content::new());
        assert_eq!(content(&read(&bytes, "one")), Content::from([(([-3, 17, 5], 1), 0.5_f32.to_bits())]));
        assert_eq!(empty.stats().bounds, None);
        assert_eq!(one.stats().bounds, Some([[-3, 17, 5]; 2]));
        let no_grids = file(&[]);
        assert!(VdbReader::new(Cursor::new(&no_grids)).expect("header").available_grids().is_empty());
    }
}

#[test]
fn a_root_tile_fills_an_upper_node() {
    let tile = |log2_edge, x: i32, y: i32, z: i32| Tile { origin: [x, y, z], log2_edge, value: 2.0 };
    let mut topology = Topology::default();
    let range = || (-4096..0).step_by(128);
    for (x, y, z) in range().flat_map(|x| range().flat_map(move |y| range().map(move |z| (x, y, z)))) {
        topology.push_tile(tile(7, x, y, z)).expect("sorted");
    }
    topology.push_tile(tile(3, 0, 0, 0)).expect("sorted");
    let stats = topology.stats();
    assert_eq!((stats.tiles, stats.upper_nodes, stats.lower_nodes), ([1, 0, 1], 1, 1));
    assert_eq!(stats.active_voxels, (1 << 36) + 512);
    assert_eq!(stats.bounds, Some([[-4096; 3], [7; 3]]));

    let mut bytes = vec![];
    let mut writer = FileWriter::new(&mut bytes, &file_header(), 1).expect("header");
    let encoder = Encoder::new(Compression::Blosc);
    writer.grid(&grid_header("density"), &topology, encoder, 0, [[]; 0]).expect("grid");
    writer.finish().expect("complete");
    // vdb-rs skips root tiles; that it finds the other tile shows that they have the right length.
    assert_eq!(content(&read(&bytes, "density")), Content::from([(([0; 3], 8), 2.0_f32.to_bits())]));
}

#[test]
fn bytes_do_not_depend_on_batches_or_threads() {
    let bricks = bricks();
    for compression in ALL {
        let whole = file(&[(&grid_header("density"), &build(compression, &bricks))]);
        let mut grid = VdbGridBuilder::new(compression);
        let encoder = grid.encoder();
        let runs: Vec<EncodedBricks> = std::thread::scope(|scope| {
            let threads: Vec<_> =
                bricks.chunks(997).map(|part| scope.spawn(move || encode(encoder, part))).collect();
            threads.into_iter().map(|thread| thread.join().expect("no panic")).collect()
        });
        for run in &runs {
            grid.append(run).expect("sorted");
        }
        assert!(whole == file(&[(&grid_header("density"), &grid)]), "{compression:?}");
    }
}

/// Both codecs are other people's: an update that changes their output changes every file, and must be noticed.
#[test]
fn bytes_are_known() {
    let known = [
        "4280a24de147d0f1f1938f0745f7c5ad5d632793c19710004c40db7612d76914",
        "14220fb95b44158ad7160f8b7efda363afa10b08fd8b91d14738ae80f7511296",
        "2898b403b73eb74468947a7de38ffae5dcf02caf857faabf26354376513599cd",
    ];
    for (compression, known) in ALL.into_iter().zip(known) {
        let bytes = file(&[(&grid_header("density"), &build(compression, &bricks()))]);
        let digest: String = Sha256::digest(&bytes).iter().map(|byte| format!("{byte:02x}")).collect();
        assert_eq!(digest, known, "{compression:?}");
    }
}

#[test]
fn bricks_of_another_encoder_are_refused() {
    let bricks = &bricks()[..3];
    for of_grid in &ENCODERS {
        for of_run in &ENCODERS {
            let mut grid = VdbGridBuilder::with_encoder(*of_grid);
            let mut run = encode(*of_run, bricks);
            let appended = grid.append(&run);
            if of_grid == of_run {
                assert!(appended.is_ok());
                continue;
            }
            assert!(matches!(appended, Err(VdbWriteError::Encoder)));
            assert_eq!((grid.stats().leaves, grid.encoded_bytes()), (0, 0));
            // Nor a run of which some are of this encoder; cleared, it is of any.
            let (origin, mask, values) = &bricks[0];
            run.push(*of_grid, *origin, mask, values);
            assert!(matches!(grid.append(&run), Err(VdbWriteError::Encoder)));
            run.clear();
            run.push(*of_grid, *origin, mask, values);
            assert!(grid.append(&run).is_ok());
        }
    }
    assert!(VdbGridBuilder::new(Compression::Zip).append(&EncodedBricks::default()).is_ok());
}
