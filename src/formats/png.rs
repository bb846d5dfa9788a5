//! PNG pictures, by the `png` crate: written with eight bits a channel, read with any number of them.

#![cfg_attr(
    not(test),
    deny(
        clippy::arithmetic_side_effects,
        clippy::expect_used,
        clippy::indexing_slicing,
        clippy::panic,
        clippy::string_slice,
        clippy::unreachable,
        clippy::unwrap_used
    )
)]

use std::io::{self, BufRead, Seek, SeekFrom, Write};
use std::panic::{AssertUnwindSafe, catch_unwind};

use png::{BitDepth, ColorType, Limits, Transformations};

/// Writes a picture: red, green and blue (sRGB) of every pixel, in rows from the top.
///
/// # Errors
///
/// The output's; a size that is not that of the pixels, or that the format cannot hold.
pub fn write(size: [usize; 2], pixels: &[[u8; 3]], out: impl Write) -> Result<(), png::EncodingError> {
    encode(size, ColorType::Rgb, pixels.as_flattened(), out)
}

/// Writes a picture whose pixels have an alpha, that the colours are not multiplied with.
///
/// # Errors
///
/// As [`write()`].
pub fn write_with_alpha(
    size: [usize; 2],
    pixels: &[[u8; 4]],
    out: impl Write,
) -> Result<(), png::EncodingError> {
    encode(size, ColorType::Rgba, pixels.as_flattened(), out)
}

fn encode(
    size: [usize; 2],
    colour: ColorType,
    bytes: &[u8],
    out: impl Write,
) -> Result<(), png::EncodingError> {
    let [width, height] = size.map(|edge| u32::try_from(edge).unwrap_or(0));
    let mut encoder = png::Encoder::new(out, width, height);
    encoder.set_color(colour);
    encoder.set_depth(BitDepth::Eight);
    encoder.set_source_srgb(png::SrgbRenderingIntent::Perceptual);
    let mut writer = encoder.write_header()?;
    writer.write_image_data(bytes)?;
    writer.finish()
}

/// No byte of a file becomes more bytes of pixels: zlib makes at most 1032 of one, and what is stored with less than eight bits
/// a pixel, or in a palette, up to 32 of these.
const MOST: u64 = 32 * 1032;

/// A picture as it was read.
#[derive(Debug, Clone, PartialEq)]
pub struct Picture {
    /// Pixels from left to right, and from top to bottom.
    pub size: [usize; 2],
    /// Channels, of the names `Y` or `R`, `G` and `B`, and `A` where there is transparency: codes of sRGB in [0, 1], in rows from
    /// the top. (`A` is no code, but a part.)
    pub channels: Vec<(&'static str, Vec<f32>)>,
}

/// Why a picture could not be read.
#[derive(Debug, thiserror::Error)]
pub enum PngReadError {
    /// The file is damaged, or no PNG picture.
    #[error(transparent)]
    Invalid(#[from] png::DecodingError),
    /// The input failed.
    #[error(transparent)]
    Io(#[from] io::Error),
    /// The pixels that the header announces cannot all be in the file.
    #[error("a damaged PNG picture: {length} bytes cannot hold {announced} bytes of pixels")]
    Announced {
        /// Bytes of the file.
        length: u64,
        /// Bytes of pixels.
        announced: u64,
    },
    /// The pixels take more memory than they may.
    #[error("the picture takes {needed} bytes of memory, {limit} are allowed")]
    Memory {
        /// Bytes.
        needed: u64,
        /// Bytes that it may take.
        limit: u64,
    },
    /// Beyond what the decoder can do without harm.
    #[error("a damaged PNG picture")]
    Damaged,
}

/// Reads a picture of any kind of PNG; of a moving one the first. Colour profiles and gamma are not looked at: all are taken
/// for sRGB.
///
/// Before any pixel is read, what the header announces is held against the file's length and against `memory_limit` bytes for
/// all that is held at once.
///
/// # Errors
///
/// [`PngReadError`], for any input.
pub fn read(input: impl BufRead + Seek, memory_limit: u64) -> Result<Picture, PngReadError> {
    // The decoder is made to fail and not to panic on damaged files, which is not proven.
    catch_unwind(AssertUnwindSafe(|| decode(input, memory_limit))).unwrap_or(Err(PngReadError::Damaged))
}

fn decode(mut input: impl BufRead + Seek, memory_limit: u64) -> Result<Picture, PngReadError> {
    let length = input.seek(SeekFrom::End(0))?;
    input.rewind()?;
    let bytes = usize::try_from(memory_limit).unwrap_or(usize::MAX);
    let mut decoder = png::Decoder::new_with_limits(input, Limits { bytes });
    decoder.set_transformations(Transformations::EXPAND);
    decoder.set_ignore_text_chunk(true);
    decoder.set_ignore_iccp_chunk(true);
    let mut reader = decoder.read_info()?;
    // The decoder takes three bytes for the last colour, however many are left.
    if reader.info().palette.as_ref().is_some_and(|palette| !palette.len().is_multiple_of(3)) {
        return Err(PngReadError::Damaged);
    }
    let announced = reader.output_buffer_size().map_or(u64::MAX, |bytes| bytes as u64);
    if announced > length.saturating_mul(MOST) {
        return Err(PngReadError::Announced { length, announced });
    }
    // As they are stored and as 32-bit floats.
    let needed = announced.saturating_mul(5);
    if needed > memory_limit {
        return Err(PngReadError::Memory { needed, limit: memory_limit });
    }
    let mut codes = list(usize::try_from(announced).unwrap_or(usize::MAX))?;
    codes.resize(codes.capacity(), 0);
    let frame = reader.next_frame(&mut codes)?;
    codes.truncate(frame.buffer_size());
    let names: &[&'static str] = match frame.color_type {
        ColorType::Grayscale => &["Y"],
        ColorType::GrayscaleAlpha => &["Y", "A"],
        ColorType::Rgb | ColorType::Indexed => &["R", "G", "B"],
        ColorType::Rgba => &["R", "G", "B", "A"],
    };
    let count = names.len();
    let wide = frame.bit_depth == BitDepth::Sixteen;
    let channel = |(part, name): (usize, &&'static str)| {
        let mut values: Vec<f32> = list(codes.len().div_ceil(count))?;
        if wide {
            let (pairs, _) = codes.as_chunks();
            let codes = pairs.iter().skip(part).step_by(count);
            values.extend(codes.map(|pair| f32::from(u16::from_be_bytes(*pair)) / 65535.0));
        } else {
            values.extend(codes.iter().skip(part).step_by(count).map(|code| f32::from(*code) / 255.0));
        }
        Ok((*name, values))
    };
    Ok(Picture {
        size: [frame.width, frame.height].map(|edge| usize::try_from(edge).unwrap_or(0)),
        channels: names.iter().enumerate().map(channel).collect::<Result<_, io::Error>>()?,
    })
}

/// An empty list with room for so many.
fn list<T>(count: usize) -> io::Result<Vec<T>> {
    let mut list = Vec::new();
    list.try_reserve_exact(count).map_err(|_| io::ErrorKind::OutOfMemory)?;
    Ok(list)
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "what is not there fails the test")]

    use std::io::Cursor;

    use super::*;

    #[test]
    fn pictures_are_read_back() {
        let pixels: Vec<[u8; 3]> = (0..6).map(|i| [i, 10 * i, 255 - i]).collect();
        let mut out = Vec::new();
        write([3, 2], &pixels, &mut out).unwrap();
        let mut reader = png::Decoder::new(Cursor::new(out)).read_info().unwrap();
        let mut found = vec![0; reader.output_buffer_size().unwrap()];
        let info = reader.next_frame(&mut found).unwrap();
        assert_eq!((info.width, info.height), (3, 2));
        assert_eq!(found, pixels.as_flattened());
        assert!(write([3, 3], &pixels, Vec::new()).is_err());
        assert!(write([0, 0], &[], Vec::new()).is_err());
    }

    fn encoded(color: ColorType, depth: BitDepth, size: u32, data: &[u8], palette: Option<&[u8]>) -> Vec<u8> {
        let mut out = Vec::new();
        let mut encoder = png::Encoder::new(&mut out, size, 1);
        encoder.set_color(color);
        encoder.set_depth(depth);
        if let Some(palette) = palette {
            encoder.set_palette(palette);
        }
        encoder.write_header().unwrap().write_image_data(data).unwrap();
        out
    }

    #[test]
    fn every_kind_of_picture_is_read() {
        let found = |bytes: Vec<u8>| read(Cursor::new(bytes), 1 << 20).unwrap();
        let deep = found(encoded(ColorType::Rgb, BitDepth::Sixteen, 1, &[255, 255, 0, 0, 0x80, 0], None));
        assert_eq!(deep.channels, [("R", vec![1.0]), ("G", vec![0.0]), ("B", vec![32768.0 / 65535.0])]);
        let grey = found(encoded(ColorType::GrayscaleAlpha, BitDepth::Eight, 1, &[51, 255], None));
        assert_eq!(grey.channels, [("Y", vec![0.2]), ("A", vec![1.0])]);
        let bits = found(encoded(ColorType::Grayscale, BitDepth::One, 3, &[0b1010_0000], None));
        assert_eq!((bits.size, &*bits.channels), ([3, 1], &[("Y", vec![1.0, 0.0, 1.0])][..]));
        let listed = encoded(ColorType::Indexed, BitDepth::Eight, 2, &[1, 0], Some(&[0, 0, 255, 255, 0, 0]));
        assert_eq!(found(listed).channels[0], ("R", vec![1.0, 0.0]));
    }

    #[test]
    fn damaged_and_large_pictures_are_refused() {
        let bytes = encoded(ColorType::Rgb, BitDepth::Eight, 100, &[7; 300], None);
        assert!(matches!(
            read(Cursor::new(&bytes), 1000),
            Err(PngReadError::Memory { needed: 1500, limit: 1000 })
        ));
        let mut state = 5_u64;
        let mut random = |below: usize| {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            usize::try_from(state >> 33).unwrap() % below
        };
        for _ in 0..500 {
            let mut damaged = bytes.clone();
            let at = random(damaged.len());
            damaged[at] = [0, 255, 127, 128][random(4)];
            damaged.truncate(random(bytes.len()) + 1);
            // Whatever comes of it.
            let _ = read(Cursor::new(damaged), 1 << 20);
        }
        // A wide header with its check sum, as the format has it.
        let mut wide = bytes.clone();
        wide[16..20].copy_from_slice(&0x7fff_fff0_u32.to_be_bytes());
        let mut sum = crc32fast::Hasher::new();
        sum.update(&wide[12..29]);
        wide[29..33].copy_from_slice(&sum.finalize().to_be_bytes());
        assert!(matches!(read(Cursor::new(wide), u64::MAX), Err(PngReadError::Announced { .. })));
    }
}
