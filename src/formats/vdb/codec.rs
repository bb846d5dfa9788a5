//! Value blocks: which entries of a node are stored, and how their bytes are compressed.

use std::cell::RefCell;

use flate2::{Compress, FlushCompress, Status};
use lz4_flex::block::{CompressTable, compress_into_with_table, get_maximum_output_size};

/// How a grid's values are stored. All three are lossless.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Compression {
    /// Every voxel of every leaf, inactive ones too, as plain numbers.
    None,
    /// Active voxels, one zlib stream per node. Smallest for smooth data, slow.
    Zip,
    /// Active voxels, one Blosc frame (byte shuffle, LZ4) per node. What OpenVDB writes by default.
    #[default]
    Blosc,
}

const FLAG_ZIP: u32 = 1;
const FLAG_ACTIVE_MASK: u32 = 2;
const FLAG_BLOSC: u32 = 4;

impl Compression {
    /// The flags in a grid's record.
    pub(super) fn flags(self) -> u32 {
        match self {
            Self::None => 0,
            Self::Zip => FLAG_ZIP | FLAG_ACTIVE_MASK,
            Self::Blosc => FLAG_BLOSC | FLAG_ACTIVE_MASK,
        }
    }
}

/// The words that OpenVDB uses for compression flags, such as `blosc + active values`.
pub(super) fn flags_text(flags: u32) -> String {
    let parts: Vec<&str> = [(FLAG_ZIP, "zip"), (FLAG_BLOSC, "blosc"), (FLAG_ACTIVE_MASK, "active values")]
        .into_iter()
        .filter(|(flag, _)| flags & flag != 0)
        .map(|(_, name)| name)
        .collect();
    if parts.is_empty() { "none".to_owned() } else { parts.join(" + ") }
}

/// The code before a value block: the payload holds active entries only, all others are background.
const CODE_ACTIVE_ONLY: u8 = 0;
/// The code before a value block: the payload holds all entries.
const CODE_ALL: u8 = 6;

/// Level 1 compresses voxel values as well as the default does, within a percent, in half the time.
const ZLIB_LEVEL: u32 = 1;

/// Bytes per Blosc block. Above 64 KiB lz4_flex changes to a hash that depends on the width of pointers.
const BLOSC_BLOCK: usize = 32 << 10;
const BLOSC_HEADER: usize = 16;
/// Byte shuffle, blocks not split into streams, LZ4.
const BLOSC_LZ4: u8 = 0x31;
const BLOSC_STORED: u8 = 0x02;

/// Encodes leaves. It is a small value to copy to every thread; working memory belongs to the thread.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Encoder {
    compression: Compression,
}

impl Encoder {
    /// An encoder for grids of this compression.
    pub fn new(compression: Compression) -> Self {
        Self { compression }
    }

    /// The compression it encodes for.
    pub fn compression(self) -> Compression {
        self.compression
    }

    /// Appends one leaf's buffer to `out`: mask, code and values.
    ///
    /// Voxel (x, y, z) of the leaf has the index `64 x + 8 y + z`; bit i of the mask is bit `i % 64` of word `i / 64`.
    /// Values of inactive voxels are not kept: they read as the background, 0.
    pub fn encode_leaf(&self, mask: &[u64; 8], values: &[f32; 512], out: &mut Vec<u8>) {
        out.extend(mask.iter().flat_map(|word| word.to_le_bytes()));
        self.encode_block(mask, values, out);
    }

    /// Appends the value block of a node. `active` has one bit per value.
    pub(super) fn encode_block(&self, active: &[u64], values: &[f32], out: &mut Vec<u8>) {
        // Readers disagree on the framing of an empty payload, so a node with no active entry stores all of them.
        let only_active = self.compression != Compression::None && active.iter().any(|word| *word != 0);
        out.push(if only_active { CODE_ACTIVE_ONLY } else { CODE_ALL });
        SCRATCH.with_borrow_mut(|scratch| {
            gather(active, values, only_active, &mut scratch.raw);
            match self.compression {
                Compression::None => out.extend(&scratch.raw),
                Compression::Zip => scratch.zip(out),
                Compression::Blosc => scratch.blosc(out),
            }
        });
    }
}

/// Replaces `raw` by the bytes of the active values, or of all of them with zeros at inactive ones.
fn gather(active: &[u64], values: &[f32], only_active: bool, raw: &mut Vec<u8>) {
    raw.resize(values.len() * 4, 0);
    let mut used = 0;
    for (word, run) in active.iter().zip(values.chunks(64)) {
        for (bit, value) in run.iter().enumerate() {
            let on = (word >> bit) & 1 == 1;
            // The write is unconditional and only the position depends on the mask: masks of noise defeat branch
            // prediction.
            let stored = if on { *value } else { 0.0 };
            raw[used..used + 4].copy_from_slice(&stored.to_le_bytes());
            used += if on || !only_active { 4 } else { 0 };
        }
    }
    raw.truncate(used);
}

thread_local! {
    static SCRATCH: RefCell<Scratch> = RefCell::new(Scratch::default());
}

/// What encoding needs besides its output, kept by each thread from block to block.
#[derive(Default)]
struct Scratch {
    raw: Vec<u8>,
    shuffled: Vec<u8>,
    packed: Vec<u8>,
    // It would be upgraded for good by an input of 64 KiB, and later bytes would depend on that: blocks are smaller.
    lz4: CompressTable,
    // flate2's default backend, miniz_oxide, has one code path. Those that choose hash functions by the processor's
    // features (zlib-rs, zlib-ng) give different bytes on different machines.
    zlib: Option<Compress>,
}

impl Scratch {
    /// Appends `raw` as a zlib stream behind its length, or as it is behind the negative length if that is not longer.
    fn zip(&mut self, out: &mut Vec<u8>) {
        let room = self.raw.len().saturating_sub(1);
        self.packed.resize(self.packed.len().max(room), 0);
        let zlib = self.zlib.get_or_insert_with(|| Compress::new(flate2::Compression::new(ZLIB_LEVEL), true));
        zlib.reset();
        let status = zlib.compress(&self.raw, &mut self.packed[..room], FlushCompress::Finish);
        let (size, payload) = match (status, usize::try_from(zlib.total_out())) {
            (Ok(Status::StreamEnd), Ok(len)) => (chunk_size(len), &self.packed[..len]),
            _ => (-chunk_size(self.raw.len()), &self.raw[..]),
        };
        out.extend(size.to_le_bytes());
        out.extend(payload);
    }

    /// Appends `raw` as a Blosc-1 frame behind its length.
    fn blosc(&mut self, out: &mut Vec<u8>) {
        let start = out.len();
        let stored_len = BLOSC_HEADER + self.raw.len();
        let block_len = self.raw.len().min(BLOSC_BLOCK);
        out.extend([0; 8 + BLOSC_HEADER]);
        let frame = start + 8;
        out.resize(out.len() + 4 * self.raw.len().div_ceil(BLOSC_BLOCK), 0);
        for (index, block) in self.raw.chunks(BLOSC_BLOCK).enumerate() {
            let offset = out.len() - frame;
            put_u32(out, frame + BLOSC_HEADER + 4 * index, offset);
            shuffle(block, &mut self.shuffled);
            self.packed.resize(self.packed.len().max(get_maximum_output_size(block.len())), 0);
            let packed = compress_into_with_table(&self.shuffled, &mut self.packed, &mut self.lz4);
            // A stream as long as the block it stands for is that block, not compressed.
            let stream = match packed {
                Ok(len) if len < block.len() => &self.packed[..len],
                _ => &self.shuffled[..],
            };
            out.extend([0; 4]);
            let at = out.len() - 4;
            put_u32(out, at, stream.len());
            out.extend(stream);
        }
        let mut flags = BLOSC_LZ4;
        if out.len() - frame >= stored_len {
            flags = BLOSC_STORED;
            out.truncate(frame + BLOSC_HEADER);
            out.extend(&self.raw);
        }
        let frame_len = out.len() - frame;
        out[start..frame].copy_from_slice(&chunk_size(frame_len).to_le_bytes());
        out[frame..frame + 4].copy_from_slice(&[2, 1, flags, 4]);
        put_u32(out, frame + 4, self.raw.len());
        put_u32(out, frame + 8, block_len);
        put_u32(out, frame + 12, frame_len);
    }
}

/// Groups the bytes of 4-byte numbers by significance.
fn shuffle(block: &[u8], shuffled: &mut Vec<u8>) {
    shuffled.resize(block.len(), 0);
    let numbers = block.as_chunks::<4>().0;
    for (significance, plane) in shuffled.chunks_exact_mut(numbers.len().max(1)).enumerate() {
        for (byte, number) in plane.iter_mut().zip(numbers) {
            *byte = number[significance];
        }
    }
}

#[allow(clippy::cast_possible_wrap, reason = "a block is at most 128 KiB")]
fn chunk_size(len: usize) -> i64 {
    len as i64
}

#[allow(clippy::cast_possible_truncation, reason = "a block is at most 128 KiB")]
fn put_u32(out: &mut [u8], at: usize, value: usize) {
    out[at..at + 4].copy_from_slice(&(value as u32).to_le_bytes());
}
