//! Value blocks: which entries of a node are stored, and in which bytes.

use std::cell::RefCell;

use half::f16;

use super::chunk::{BLOSC_HEADER, Packer};
use super::voxel::Voxel;
use crate::volume::{Precision, to_halves};

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

pub(super) const FLAG_ZIP: u32 = 1;
pub(super) const FLAG_ACTIVE_MASK: u32 = 2;
pub(super) const FLAG_BLOSC: u32 = 4;

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

/// Encodes leaves. It is a small value to copy to every thread; working memory belongs to the thread.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Encoder {
    compression: Compression,
    precision: Precision,
}

impl Encoder {
    /// An encoder for grids of this compression, in single precision.
    pub const fn new(compression: Compression) -> Self {
        Self { compression, precision: Precision::F32 }
    }

    /// An encoder that rounds values to this precision. They are read as they were rounded.
    #[must_use]
    pub const fn with_precision(self, precision: Precision) -> Self {
        Self { precision, ..self }
    }

    /// The compression it encodes for.
    pub fn compression(self) -> Compression {
        self.compression
    }

    /// The precision it encodes for.
    pub fn precision(self) -> Precision {
        self.precision
    }

    /// Appends one leaf's buffer to `out`: mask, code and values.
    ///
    /// Voxel (x, y, z) of the leaf has the index `64 x + 8 y + z`; bit i of the mask is bit `i % 64` of word `i / 64`.
    /// Values of inactive voxels are not kept: they read as the background, 0.
    pub fn encode_leaf<T: Voxel>(&self, mask: &[u64; 8], values: &[T; 512], out: &mut Vec<u8>) {
        out.extend(mask.iter().flat_map(|word| word.to_le_bytes()));
        self.encode_block(mask, values, out);
    }

    /// Appends the value block of a node. `active` has one bit per value.
    pub(super) fn encode_block<T: Voxel>(&self, active: &[u64], values: &[T], out: &mut Vec<u8>) {
        // Readers disagree on the framing of an empty payload, and differently for each precision, so a node with no
        // active entry stores all of them.
        let only_active = self.compression != Compression::None && active.iter().any(|word| *word != 0);
        out.push(if only_active { CODE_ACTIVE_ONLY } else { CODE_ALL });
        SCRATCH.with_borrow_mut(|Scratch { kept, halves, packer }| {
            let kept = T::gather(active, values, only_active, kept);
            match self.precision {
                Precision::F32 => packer.pack(self.compression, kept, out),
                Precision::F16 => {
                    to_halves(kept, halves);
                    packer.pack(self.compression, halves, out);
                }
            }
        });
    }

    /// The value that is read where this one was written.
    pub(super) fn round<T: Voxel>(&self, mut value: T) -> T {
        self.precision.round(T::numbers_mut(std::slice::from_mut(&mut value)));
        value
    }

    /// No value block of this many entries takes more bytes.
    pub(super) fn largest_block<T: Voxel>(self, entries: u64) -> u64 {
        let framing = match self.compression {
            Compression::None => 0,
            Compression::Zip => 8,
            Compression::Blosc => 8 + BLOSC_HEADER as u64,
        };
        1 + framing + (T::NUMBERS * self.precision.bytes()) as u64 * entries
    }
}

/// The numbers of active values, or of all of them with zeros at inactive ones. `kept` is where they are put.
pub(super) fn gather<'a, const N: usize>(
    active: &[u64],
    values: &[[f32; N]],
    only_active: bool,
    kept: &'a mut Vec<f32>,
) -> &'a mut [f32] {
    kept.resize(N * values.len(), 0.0);
    let slots = kept.as_chunks_mut::<N>().0;
    let mut used = 0;
    let bytes = active.iter().flat_map(|word| word.to_le_bytes());
    for (byte, row) in bytes.zip(values.as_chunks::<8>().0) {
        let Some((slots, _)) = slots[used..].split_first_chunk_mut::<8>() else { break };
        if byte == 0xff {
            *slots = *row;
            used += 8;
        } else if only_active {
            let mut next = 0;
            for (bit, value) in row.iter().enumerate() {
                // Written in any case; only the position depends on the mask, because masks of noise defeat branch
                // prediction.
                slots[next] = *value;
                next += usize::from(byte >> bit & 1);
            }
            used += next;
        } else {
            let keep = &KEEP[usize::from(byte)];
            *slots = std::array::from_fn(|i| row[i].map(|x| f32::from_bits(x.to_bits() & keep[i])));
            used += 8;
        }
    }
    &mut kept[..N * used]
}

/// All bits of a number for each bit of a row's mask. From a table it is a vector operation, where a choice would become eight
/// branches.
static KEEP: [[u32; 8]; 256] = {
    let mut table = [[0; 8]; 256];
    let mut byte = 0;
    while byte < 256 {
        let mut bit = 0;
        while bit < 8 {
            table[byte][bit] = if byte >> bit & 1 == 1 { u32::MAX } else { 0 };
            bit += 1;
        }
        byte += 1;
    }
    table
};

thread_local! {
    static SCRATCH: RefCell<Scratch> = RefCell::new(Scratch::default());
}

/// What encoding needs besides its output, kept by each thread from block to block.
#[derive(Default)]
struct Scratch {
    kept: Vec<f32>,
    halves: Vec<f16>,
    packer: Packer,
}

#[cfg(test)]
mod tests {
    use std::io::Read;

    use super::super::tests::{ALL, random, random_value};
    use super::*;

    const FULL: [u64; 8] = [u64::MAX; 8];

    fn leaf(compression: Compression, mask: &[u64; 8], values: &[f32; 512]) -> Vec<u8> {
        let mut out = vec![];
        Encoder::new(compression).encode_leaf(mask, values, &mut out);
        out
    }

    fn noise(state: &mut u64) -> [f32; 512] {
        [(); 512].map(|()| random_value(state))
    }

    fn bytes_of(values: &[f32]) -> Vec<u8> {
        values.iter().flat_map(|v| v.to_le_bytes()).collect()
    }

    /// Decodes a Blosc-1 frame from the description of the format alone.
    fn unblosc(frame: &[u8]) -> Vec<u8> {
        let u32_at = |at: usize| {
            usize::try_from(u32::from_le_bytes(frame[at..at + 4].try_into().expect("4"))).expect("32 bits")
        };
        let (flags, nbytes, block_len) = (frame[2], u32_at(4), u32_at(8));
        assert_eq!((frame[0], frame[1], frame[3], u32_at(12)), (2, 1, 4, frame.len()));
        if flags & 2 != 0 {
            return frame[16..].to_vec();
        }
        assert_eq!(flags, 0x31);
        let mut raw = vec![];
        for block in 0..nbytes.div_ceil(block_len) {
            let len = block_len.min(nbytes - block * block_len);
            let at = u32_at(16 + 4 * block);
            let stream = &frame[at + 4..at + 4 + u32_at(at)];
            let shuffled = if stream.len() == len {
                stream.to_vec()
            } else {
                lz4_flex::block::decompress(stream, len).expect("valid LZ4")
            };
            raw.extend((0..len).map(|i| shuffled[i % 4 * (len / 4) + i / 4]));
        }
        raw
    }

    #[test]
    fn leaf_begins_with_its_mask_lowest_bit_first() {
        for compression in ALL {
            let out = leaf(compression, &[0x0102_0304_0506_0708, 0, 0, 0, 0, 0, 0, 1 << 63], &[0.5; 512]);
            assert_eq!(out[..9], [8, 7, 6, 5, 4, 3, 2, 1, 0]);
            assert_eq!(out[56..64], [0, 0, 0, 0, 0, 0, 0, 0x80]);
        }
    }

    #[test]
    fn payload_holds_active_values_in_order() {
        let mut state = 2;
        let values = noise(&mut state);
        let mask = [(); 8].map(|()| random(&mut state) & random(&mut state));
        let on = |index: &usize| (mask[index / 64] >> (index % 64)) & 1 == 1;
        let active: Vec<f32> = (0..512).filter(on).map(|index| values[index]).collect();
        let all: Vec<f32> = (0..512).map(|index| if on(&index) { values[index] } else { 0.0 }).collect();

        let none = leaf(Compression::None, &mask, &values);
        assert_eq!((none[64], &none[65..]), (6, &bytes_of(&all)[..]));

        let zip = leaf(Compression::Zip, &mask, &values);
        let size = i64::from_le_bytes(zip[65..73].try_into().expect("8"));
        let mut unzipped = vec![];
        if size > 0 {
            flate2::read::ZlibDecoder::new(&zip[73..]).read_to_end(&mut unzipped).expect("zlib stream");
        } else {
            unzipped.extend(&zip[73..]);
        }
        assert_eq!((zip[64], usize::try_from(size.abs()).ok()), (0, Some(zip.len() - 73)));
        assert_eq!(unzipped, bytes_of(&active));

        let blosc = leaf(Compression::Blosc, &mask, &values);
        let size = i64::from_le_bytes(blosc[65..73].try_into().expect("8"));
        assert_eq!((blosc[64], usize::try_from(size).ok()), (0, Some(blosc.len() - 73)));
        assert_eq!(unblosc(&blosc[73..]), bytes_of(&active));
    }

    #[test]
    fn what_does_not_shrink_is_stored() {
        let mut mask = [0; 8];
        mask[3] = 1 << 40;
        let mut values = [0.0; 512];
        values[3 * 64 + 40] = 0.1;
        let zip = leaf(Compression::Zip, &mask, &values);
        assert_eq!(zip[64..], [&[0][..], &(-4_i64).to_le_bytes(), &0.1_f32.to_le_bytes()].concat());
        let frame = [2, 1, 2, 4, 4, 0, 0, 0, 4, 0, 0, 0, 20, 0, 0, 0];
        let blosc = leaf(Compression::Blosc, &mask, &values);
        assert_eq!(blosc[64..], [&[0][..], &20_i64.to_le_bytes(), &frame, &0.1_f32.to_le_bytes()].concat());
    }

    #[test]
    fn halves_and_vectors_are_stored_number_by_number() {
        let mut mask = [0; 8];
        mask[0] = 0b101;
        let mut values = [[9.0; 3]; 512];
        (values[0], values[2]) = ([1.0, -0.0, 1e9], [0.1, 2049.0, -6e-8]);
        let encoder = Encoder::new(Compression::Zip);
        let stored = |encoder: Encoder| {
            let mut out = vec![];
            encoder.encode_leaf(&mask, &values, &mut out);
            out.split_off(64)
        };
        let full = [1.0, -0.0, 1e9, 0.1, 2049.0, -6e-8];
        assert_eq!(stored(encoder), [&[0][..], &(-24_i64).to_le_bytes(), &bytes_of(&full)].concat());
        let halves: [u16; 6] = [0x3c00, 0x8000, 0x7bff, 0x2e66, 0x6800, 0x8001];
        let halves: Vec<u8> = halves.iter().flat_map(|half| half.to_le_bytes()).collect();
        let half = encoder.with_precision(Precision::F16);
        assert_eq!(stored(half), [&[0][..], &(-12_i64).to_le_bytes(), &halves].concat());
        let plain = Encoder::new(Compression::None).with_precision(Precision::F16);
        assert_eq!(stored(plain)[..7], [&[6], &halves[..6]].concat());
        assert_eq!((stored(plain).len(), &stored(plain)[7..13]), (1 + 6 * 512, &[0; 6][..]));
    }

    #[test]
    fn a_block_with_no_active_entry_stores_all() {
        for compression in ALL {
            let mut out = vec![];
            Encoder::new(compression).encode_block(&[0; 512], &[1.0; 32768], &mut out);
            assert_eq!(out[0], 6);
            let payload = match compression {
                Compression::None => out[1..].to_vec(),
                Compression::Zip => {
                    let mut all = vec![];
                    flate2::read::ZlibDecoder::new(&out[9..]).read_to_end(&mut all).expect("zlib stream");
                    all
                }
                Compression::Blosc => unblosc(&out[9..]),
            };
            assert!(payload == vec![0; 4 * 32768], "{compression:?}");
            assert!(compression == Compression::None || out.len() < 1000, "{compression:?} {}", out.len());
        }
    }

    #[test]
    fn large_blocks_survive_and_leave_no_trace() {
        let mut state = 3;
        let values = noise(&mut state);
        let mut large = vec![0.5; 32768];
        large[..20000].iter_mut().for_each(|v| *v = random_value(&mut state));
        for compression in ALL {
            let before = leaf(compression, &FULL, &values);
            let mut block = vec![];
            Encoder::new(compression).encode_block(&[u64::MAX; 512], &large, &mut block);
            if compression == Compression::Blosc {
                assert!(unblosc(&block[9..]) == bytes_of(&large));
            }
            assert!(before == leaf(compression, &FULL, &values), "{compression:?}");
        }
    }

    #[test]
    fn compression_in_words() {
        assert_eq!(
            [0, 1, 2, 3, 4, 6].map(flags_text),
            ["none", "zip", "active values", "zip + active values", "blosc", "blosc + active values"]
        );
    }
}
