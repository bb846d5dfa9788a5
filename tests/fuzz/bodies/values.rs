//! The values of leaves: a file whose last bytes are the target's, so that they reach the decoders of values.

use std::io::Cursor;

use vdbake::formats::vdb::VdbFile;

use super::within;

/// Types of grids, and the bytes of a value.
const TYPES: [(&str, usize); 8] = [
    ("Tree_float_5_4_3", 4),
    ("Tree_vec3s_5_4_3", 12),
    ("Tree_double_5_4_3", 8),
    ("Tree_bool_5_4_3", 1),
    ("Tree_int32_5_4_3", 4),
    ("Tree_int64_5_4_3", 8),
    ("Tree_vec3i_5_4_3", 12),
    ("Tree_vec3d_5_4_3", 24),
];
const MASKS: [u64; 4] = [0, u64::MAX, 0x8000_0000_0000_0001, 0x00ff_0102_0408_ff00];

/// `data`: the type, compression flags with one for half precision, the leaf's mask, and what follows this in the leaf's buffer.
pub(crate) fn run(data: &[u8]) -> bool {
    let [kind, flags, mask, values @ ..] = data else { return false };
    let (type_name, size) = TYPES[usize::from(kind % 8)];
    let half = flags & 8 != 0;
    let mask = MASKS[usize::from(mask % 4)];
    let bytes = file(type_name, size, u32::from(flags & 7), half, mask, values);
    let most = (16 << 20) + 128 * bytes.len() as u64;
    // The file has no offsets, so that opening it measures the leaf and reading it decodes it.
    let Ok(mut file) = within(most, || VdbFile::open(Cursor::new(&bytes))) else { return false };
    within(most, || file.grid_at(0)).is_ok_and(|grid| {
        // A grid that is a part of itself.
        let _ = format!("{:?}", grid.info);
        true
    })
}

/// A grid of one leaf without offsets.
fn file(type_name: &str, size: usize, flags: u32, half: bool, mask: u64, values: &[u8]) -> Vec<u8> {
    let mut out = vec![];
    out.extend(0x5644_4220_i64.to_le_bytes());
    out.extend([224_u32, 10, 0].map(u32::to_le_bytes).as_flattened());
    out.push(0);
    out.extend([b'-'; 36]);
    out.extend([0_u32, 1].map(u32::to_le_bytes).as_flattened());
    let text = |out: &mut Vec<u8>, text: &str| {
        out.extend(u32::try_from(text.len()).expect("short").to_le_bytes());
        out.extend(text.as_bytes());
    };
    text(&mut out, "density");
    text(&mut out, &format!("{type_name}{}", if half { "_HalfFloat" } else { "" }));
    text(&mut out, "");
    out.extend([0; 24]);
    out.extend(flags.to_le_bytes());
    out.extend([0; 4]);
    text(&mut out, "UniformScaleMap");
    out.extend([1.0_f64; 15].map(f64::to_le_bytes).as_flattened());
    // One buffer, background, no tile, one child at the origin.
    out.extend(1_i32.to_le_bytes());
    out.extend(std::iter::repeat_n(0, size));
    out.extend([0_u32, 1, 0, 0, 0].map(u32::to_le_bytes).as_flattened());
    for entries in [32768, 4096] {
        out.push(1);
        out.extend(std::iter::repeat_n(0, 2 * entries / 8 - 1));
        // All entries, stored as they are, behind their size where there may be a codec.
        let is_half =
            half && !["bool", "int32", "int64", "vec3i"].iter().any(|name| type_name.contains(name));
        let size = if !is_half {
            size
        } else if type_name.contains("vec3") {
            6
        } else {
            2
        };
        out.push(6);
        if flags & 5 != 0 {
            out.extend((-i64::try_from(entries * size).expect("small")).to_le_bytes());
        }
        out.extend(std::iter::repeat_n(0, entries * size));
    }
    for _ in 0..2 {
        out.extend([mask; 8].map(u64::to_le_bytes).as_flattened());
    }
    out.extend(values);
    out
}
