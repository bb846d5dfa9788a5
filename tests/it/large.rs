//! Files of more than 4 GiB: every offset and length in them, and that what lies behind is found.

use std::fs::File;
use std::io::{self, BufReader, Read, Seek, SeekFrom, Write};

use tempfile::tempdir;
use vdbake::formats::vdb::{
    AnyTree, Compression, Encoder, FileHeader, FileWriter, GridClass, GridHeader, Leaf, Meta, Metadata, Tile,
    Topology, Tree, VdbFile, VdbReadError, VectorType, file_order,
};

use crate::oracle::{OPENVDBS, openvdb_probe_by};

/// Leaves along each edge of a cube of them.
const EDGE: i32 = 90;
const LEAVES: usize = 90 * 90 * 90;
/// Bytes of a leaf of vectors that is not compressed: mask, code, values.
const LEAF: usize = 64 + 1 + 512 * 12;
const TILE: Tile<[f32; 3]> = Tile { origin: [8192, 0, 0], log2_edge: 12, value: [0.5, 0.25, 0.125] };

/// The values of a leaf.
fn values(factor: f32) -> [[f32; 3]; 512] {
    let mut values = [[0.0; 3]; 512];
    for (value, n) in values.iter_mut().zip(0_u16..) {
        *value = [f32::from(n), -0.5, 0.1 * f32::from(n)].map(|x| factor * x);
    }
    values
}

fn leaf(factor: f32) -> Vec<u8> {
    let mut bytes = vec![];
    Encoder::new(Compression::None).encode_leaf(&[u64::MAX; 8], &values(factor), &mut bytes);
    assert_eq!(bytes.len(), LEAF);
    bytes
}

fn grid_header(name: &str) -> GridHeader {
    GridHeader {
        name: name.to_owned(),
        class: GridClass::Unknown,
        vector_type: VectorType::Invariant,
        voxel_size: 1.0,
        translation: [0.0; 3],
        metadata: Metadata::new(),
    }
}

/// Origins of the leaves in file order.
fn origins() -> Vec<[i32; 3]> {
    let edge = || (-EDGE / 2..EDGE / 2).map(|n| 8 * n);
    let mut origins: Vec<[i32; 3]> =
        edge().flat_map(|x| edge().flat_map(move |y| edge().map(move |z| [x, y, z]))).collect();
    origins.sort_by_cached_key(|origin| file_order(*origin));
    origins
}

/// Writes a grid of vectors, whose leaves are alike but for the last, and one of numbers behind it with one leaf.
fn write(out: &mut dyn Write) -> u64 {
    let header = FileHeader { uuid: uuid::Uuid::from_u128(4), metadata: Metadata::new() };
    let mut file = FileWriter::new(out, &header, 2).expect("a header");
    let mut topology = Topology::default();
    for origin in origins() {
        topology.push_leaf(Leaf { origin, mask: [u64::MAX; 8] }).expect("sorted");
    }
    topology.push_tile(TILE).expect("behind the leaves");
    let encoder = Encoder::new(Compression::None);
    let (leaf, last) = (leaf(1.0), leaf(-1.0));
    // In pieces for speed; pieces need not end where leaves do, but these do.
    let piece = leaf.repeat(100);
    let rest = leaf.repeat((LEAVES - 1) % 100);
    let buffers = std::iter::repeat_n(&piece, (LEAVES - 1) / 100).chain([&rest, &last]);
    file.grid(&grid_header("large"), &topology, encoder, (LEAVES * LEAF) as u64, buffers).expect("a grid");

    let mut topology = Topology::<f32>::default();
    topology.push_leaf(Leaf { origin: [8; 3], mask: [1; 8] }).expect("the only one");
    let mut buffer = vec![];
    encoder.encode_leaf(&[1; 8], &[0.75_f32; 512], &mut buffer);
    file.grid(&grid_header("behind"), &topology, encoder, buffer.len() as u64, [&buffer]).expect("a grid");
    file.finish().expect("complete")
}

/// The file without its many equal leaves, which are compared when written and made up when read.
#[derive(Clone, Default)]
struct Hollow {
    head: Vec<u8>,
    tail: Vec<u8>,
    leaf: Vec<u8>,
    position: u64,
}

impl Hollow {
    /// The absolute offsets in the descriptor of the grid of this type: of its data, its buffers, its end.
    fn offsets(bytes: &[u8], type_name: &str) -> [u64; 3] {
        let at =
            bytes.windows(type_name.len()).position(|text| text == type_name.as_bytes()).expect("a grid");
        let at = at + type_name.len() + 4;
        [0, 8, 16].map(|n| u64::from_le_bytes(bytes[at + n..at + n + 8].try_into().expect("8 bytes")))
    }

    /// Where the equal leaves begin and end.
    fn hole(&self) -> [u64; 2] {
        if self.head.len() < 4096 {
            return [u64::MAX; 2];
        }
        let start = Self::offsets(&self.head[..4096], "Tree_vec3s_5_4_3")[1];
        [start, start + ((LEAVES - 1) * LEAF) as u64]
    }
}

impl Write for Hollow {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let [start, end] = self.hole();
        let room = |limit: u64| usize::try_from(limit - self.position).unwrap_or(usize::MAX).min(bytes.len());
        let count = if self.position < start {
            // The beginning of the file says where the leaves begin.
            let unknown = 4096_usize.saturating_sub(self.head.len());
            let count = if unknown > 0 { unknown.min(bytes.len()) } else { room(start) };
            self.head.extend(&bytes[..count]);
            count
        } else if self.position < end {
            let at = usize::try_from((self.position - start) % LEAF as u64).expect("small");
            let count = room(end).min(LEAF - at);
            assert!(bytes[..count] == self.leaf[at..at + count], "a leaf is not what it should be");
            count
        } else {
            self.tail.extend(bytes);
            bytes.len()
        };
        self.position += count as u64;
        Ok(count)
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl Read for Hollow {
    fn read(&mut self, out: &mut [u8]) -> io::Result<usize> {
        let [start, end] = self.hole();
        let part = |bytes: &'_ [u8], at: u64| -> Vec<u8> {
            let at = usize::try_from(at).expect("small").min(bytes.len());
            bytes[at..bytes.len().min(at + out.len())].to_vec()
        };
        let found = match self.position {
            at if at < start => part(&self.head, at),
            at if at < end => part(&self.leaf, (at - start) % LEAF as u64),
            at => part(&self.tail, at - end),
        };
        out[..found.len()].copy_from_slice(&found);
        self.position += found.len() as u64;
        Ok(found.len())
    }
}

impl Seek for Hollow {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        let length = self.hole()[1] + self.tail.len() as u64;
        let moved = match to {
            SeekFrom::Start(at) => Some(at),
            SeekFrom::End(by) => length.checked_add_signed(by),
            SeekFrom::Current(by) => self.position.checked_add_signed(by),
        };
        self.position = moved.expect("a place in the file");
        Ok(self.position)
    }
}

fn assert_behind(tree: &AnyTree) {
    let AnyTree::Float(tree) = tree else { panic!("numbers") };
    assert_eq!(
        (tree.leaf_count(), tree.value([8; 3]), tree.value([8, 8, 9])),
        (1, (0.75, true), (0.0, false))
    );
}

#[test]
fn what_lies_beyond_4_gib_is_written_and_found() {
    let mut file = Hollow { leaf: leaf(1.0), ..Hollow::default() };
    let length = write(&mut file);
    assert!((LEAVES * LEAF) as u64 > 1 << 32);
    assert_eq!(length, file.position);

    let [data, buffers, end] = Hollow::offsets(&file.head[..4096], "Tree_vec3s_5_4_3");
    assert!(data < 4096 && buffers == file.head.len() as u64);
    assert_eq!(end - buffers, (LEAVES * LEAF) as u64);
    let behind = &file.tail[LEAF..];
    assert!(
        behind.starts_with(b"\x06\0\0\0behind\x10\0\0\0Tree_float_5_4_3"),
        "the next grid begins at the offset"
    );
    let offsets = Hollow::offsets(behind, "Tree_float_5_4_3");
    assert_eq!(offsets[0], end + 10 + 20 + 4 + 24);
    assert!(offsets.is_sorted() && offsets[2] == length && length - end == behind.len() as u64);

    let mut read = VdbFile::open(file.clone()).expect("a file").with_memory_limit(1 << 32);
    let metadata = &read.info().grids[0].metadata;
    // More voxels than 32 bits count, and more bytes.
    assert_eq!(metadata["file_voxel_count"], Meta::Int64((1 << 36) + 512 * i64::from(EDGE).pow(3)));
    assert!(matches!(metadata["file_mem_bytes"], Meta::Int64(bytes) if bytes > 1 << 32));
    assert_eq!(read.info().grids[0].bytes, end - data);
    assert_behind(&read.grid("behind").expect("the grid").tree);
    assert!(matches!(read.grid("large"), Err(VdbReadError::Memory { needed, .. }) if needed > 1 << 32));

    // Without offsets, the file is read through.
    file.head[20] = 0;
    file.position = 0;
    let mut read = VdbFile::open(file).expect("a file");
    assert_behind(&read.grid("behind").expect("the grid").tree);
}

/// The same file on a disk, as a whole, in OpenVDB and in our reader.
#[test]
#[ignore = "takes 5 GB of disk and twice as much memory"]
fn openvdb_reads_beyond_4_gib() {
    let folder = tempdir().expect("a temporary folder");
    let path = folder.path().join("large.vdb");
    let length = write(&mut File::create(&path).expect("a writable folder"));
    assert_eq!(std::fs::metadata(&path).expect("a file").len(), length);

    let origins = origins();
    let [first, last] = [origins[0], origins[LEAVES - 1]];
    let before = origins[LEAVES - 2];
    let inside = |origin: [i32; 3]| [origin[0] + 7, origin[1] + 6, origin[2] + 5];
    let number = 7 * 64 + 6 * 8 + 5;
    let [forward, backward] = [values(1.0)[number], values(-1.0)[number]];
    let mut file = VdbFile::open(BufReader::new(File::open(&path).expect("a file"))).expect("a file");
    let large = file.grid("large").expect("the grid").tree;
    let AnyTree::Vec3s(large) = large else { panic!("vectors") };
    let expected = [
        (inside(first), forward),
        (inside(before), forward),
        (inside(last), backward),
        (TILE.origin.map(|c| c + 4095), TILE.value),
    ];
    assert!(expected.iter().all(|(at, value)| large.value(*at) == (*value, true)));
    assert_leaves(&large);
    assert_behind(&file.grid("behind").expect("the grid").tree);
    drop(large);

    let points: Vec<[i32; 3]> = expected.iter().map(|(at, _)| *at).chain([[8; 3]]).collect();
    for python in OPENVDBS {
        let found = openvdb_probe_by(python, &[&path], std::slice::from_ref(&points)).remove(0);
        assert_eq!(found.report["grids"][1]["active_voxels"], (1_u64 << 36) + 512 * LEAVES as u64);
        for (found, (_, expected)) in found.grids[1].iter().zip(expected) {
            assert_eq!(*found, (expected.map(f64::from), true), "{python}");
        }
        // OpenVDB sorts grids by name.
        assert_eq!(found.report["grids"][0]["name"], "behind");
        assert_eq!(found.grids[0][4], ([0.75, 0.0, 0.0], true), "{python}");
    }
}

fn assert_leaves(tree: &Tree<[f32; 3]>) {
    assert_eq!(tree.leaf_count(), LEAVES);
    let (forward, backward) = (values(1.0), values(-1.0));
    for (number, leaf) in tree.leaves().enumerate() {
        assert!(*leaf.values == if number == LEAVES - 1 { backward } else { forward }, "leaf {number}");
    }
}
