//! Payloads of value blocks: numbers as bytes, plain or compressed.

use half::f16;
use libdeflater::{CompressionLvl, Compressor};
use lz4_flex::block::{CompressTable, compress_into_with_table, get_maximum_output_size};

use super::codec::Compression;

/// On voxel values, noisy or smooth, levels 1 to 6 come within 0.1 % of each other; level 1 takes half the time.
const ZLIB_LEVEL: i32 = 1;

/// Bytes per Blosc block. From 64 KiB on lz4_flex uses a hash that depends on the width of pointers; below, only on
/// the order of bytes.
const BLOSC_BLOCK: usize = 32 << 10;
pub(super) const BLOSC_HEADER: usize = 16;
/// Byte shuffle, blocks not split into streams, LZ4.
const BLOSC_LZ4: u8 = 0x31;
const BLOSC_STORED: u8 = 0x02;

/// A number of `B` bytes.
pub(super) trait Number<const B: usize>: Copy {
    /// Its bytes in a file.
    fn bytes(self) -> [u8; B];
}

impl Number<4> for f32 {
    fn bytes(self) -> [u8; 4] {
        self.to_le_bytes()
    }
}

impl Number<2> for f16 {
    fn bytes(self) -> [u8; 2] {
        self.to_le_bytes()
    }
}

/// Compresses payloads, in memory that it keeps from one to the next.
#[derive(Default)]
pub(super) struct Packer {
    bytes: Vec<u8>,
    packed: Vec<u8>,
    // An input of 64 KiB would change its kind for good, and later bytes would depend on that: blocks are smaller.
    lz4: CompressTable,
    // One code path for compressing, on all processors. Libraries that choose hash functions by the processor's features
    // (zlib-rs, zlib-ng) give different bytes on different machines.
    zlib: Option<Compressor>,
}

impl Packer {
    /// Appends the payload of these numbers.
    pub(super) fn pack<const B: usize>(
        &mut self,
        compression: Compression,
        numbers: &[impl Number<B>],
        out: &mut Vec<u8>,
    ) {
        match compression {
            Compression::None => put_bytes(out, numbers),
            Compression::Zip => self.zip(numbers, out),
            Compression::Blosc => self.blosc(numbers, out),
        }
    }

    /// Appends a zlib stream behind its length, or the numbers as they are behind the negative length if that is not
    /// longer.
    fn zip<const B: usize>(&mut self, numbers: &[impl Number<B>], out: &mut Vec<u8>) {
        self.bytes.clear();
        put_bytes(&mut self.bytes, numbers);
        let room = self.bytes.len().saturating_sub(1);
        self.packed.resize(self.packed.len().max(room), 0);
        let level = || CompressionLvl::new(ZLIB_LEVEL).unwrap_or_default();
        let zlib = self.zlib.get_or_insert_with(|| Compressor::new(level()));
        let (size, payload) = match zlib.zlib_compress(&self.bytes, &mut self.packed[..room]) {
            Ok(len) => (chunk_size(len), &self.packed[..len]),
            Err(_) => (-chunk_size(self.bytes.len()), &self.bytes[..]),
        };
        out.extend(size.to_le_bytes());
        out.extend(payload);
    }

    /// Appends a Blosc-1 frame behind its length. Its values are single numbers, those of vectors too.
    fn blosc<const B: usize>(&mut self, numbers: &[impl Number<B>], out: &mut Vec<u8>) {
        let start = out.len();
        let raw_len = B * numbers.len();
        out.extend([0; 8 + BLOSC_HEADER]);
        let frame = start + 8;
        out.resize(out.len() + 4 * raw_len.div_ceil(BLOSC_BLOCK), 0);
        for (index, numbers) in numbers.chunks(BLOSC_BLOCK / B).enumerate() {
            let offset = out.len() - frame;
            put_u32(out, frame + BLOSC_HEADER + 4 * index, offset);
            shuffle(numbers, &mut self.bytes);
            self.packed.resize(self.packed.len().max(get_maximum_output_size(self.bytes.len())), 0);
            let packed = compress_into_with_table(&self.bytes, &mut self.packed, &mut self.lz4);
            // A stream as long as the block it stands for is that block, not compressed.
            let stream = match packed {
                Ok(len) if len < self.bytes.len() => &self.packed[..len],
                _ => &self.bytes[..],
            };
            out.extend([0; 4]);
            let at = out.len() - 4;
            put_u32(out, at, stream.len());
            out.extend(stream);
        }
        let mut flags = BLOSC_LZ4;
        if out.len() - frame >= BLOSC_HEADER + raw_len {
            flags = BLOSC_STORED;
            out.truncate(frame + BLOSC_HEADER);
            put_bytes(out, numbers);
        }
        let frame_len = out.len() - frame;
        let [type_size, ..] = B.to_le_bytes();
        out[start..frame].copy_from_slice(&chunk_size(frame_len).to_le_bytes());
        out[frame..frame + 4].copy_from_slice(&[2, 1, flags, type_size]);
        put_u32(out, frame + 4, raw_len);
        put_u32(out, frame + 8, raw_len.min(BLOSC_BLOCK));
        put_u32(out, frame + 12, frame_len);
    }
}

/// Appends numbers as they are.
fn put_bytes<const B: usize>(out: &mut Vec<u8>, numbers: &[impl Number<B>]) {
    let start = out.len();
    out.resize(start + B * numbers.len(), 0);
    for (bytes, number) in out[start..].as_chunks_mut::<B>().0.iter_mut().zip(numbers) {
        *bytes = number.bytes();
    }
}

/// Replaces `bytes` by those of the numbers, grouped by significance.
fn shuffle<const B: usize>(numbers: &[impl Number<B>], bytes: &mut Vec<u8>) {
    bytes.resize(B * numbers.len(), 0);
    for (significance, plane) in bytes.chunks_exact_mut(numbers.len().max(1)).enumerate() {
        for (byte, number) in plane.iter_mut().zip(numbers) {
            *byte = number.bytes()[significance];
        }
    }
}

#[allow(clippy::cast_possible_wrap, reason = "a block is at most 384 KiB")]
fn chunk_size(len: usize) -> i64 {
    len as i64
}

#[allow(clippy::cast_possible_truncation, reason = "a block is at most 384 KiB")]
fn put_u32(out: &mut [u8], at: usize, value: usize) {
    out[at..at + 4].copy_from_slice(&(value as u32).to_le_bytes());
}
