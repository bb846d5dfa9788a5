//! Reading images of any program.

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

use std::io::{ErrorKind, Read, Seek, SeekFrom};
use std::panic::{AssertUnwindSafe, catch_unwind};

use exr::block::chunk::CompressedBlock;
use exr::compression::Compression;
use exr::image::{AnyChannels, FlatSamples, Layer};
use exr::meta::attribute::AttributeValue;
use exr::meta::{BlockDescription, MetaData};
use exr::prelude::{ReadChannels, ReadLayers};

use super::{ATTRIBUTE, Part, Samples};

/// No byte of a file becomes more pixels than this many bytes of them: zlib makes at most 1032 of one, and none of the other
/// compressions makes as many of what is not all alike.
const MOST: u64 = 2048;

/// Numbers at the head of a chunk of DWA compression: its version, then sizes and counts, and a way to compress.
const DWA_COUNTERS: usize = 11;

/// Why an image could not be read.
#[derive(Debug, thiserror::Error)]
pub enum ExrReadError {
    /// The file is damaged, or no EXR image, or of a kind that is not read.
    #[error("{0}")]
    Invalid(exr::error::Error),
    /// The input failed.
    #[error(transparent)]
    Io(#[from] std::io::Error),
    /// The pixels that the headers announce cannot all be in the file.
    #[error("a damaged EXR image: {length} bytes cannot hold {announced} bytes of pixels")]
    Announced {
        /// Bytes of the file.
        length: u64,
        /// Bytes of pixels.
        announced: u64,
    },
    /// The pixels take more memory than they may.
    #[error("the image takes {needed} bytes of memory, {limit} are allowed")]
    Memory {
        /// Bytes.
        needed: u64,
        /// Bytes that it may take.
        limit: u64,
    },
    /// A channel has fewer samples than there are pixels.
    #[error("channel {0:?} is subsampled, which is not read")]
    Subsampled(String),
    /// Beyond what the decoder can do without harm.
    #[error("a damaged EXR image")]
    Damaged,
}

impl From<exr::error::Error> for ExrReadError {
    fn from(error: exr::error::Error) -> ExrReadError {
        ExrReadError::Invalid(error)
    }
}

/// Reads all parts of an image that are not deep, each at its full resolution: tiled or not, of any compression. Channels are
/// in the file's order; 32-bit integers become the nearest 32-bit floats.
///
/// Before any pixel is read, what the headers announce is held against the file's length and against `memory_limit` bytes for
/// all that is held at once.
///
/// # Errors
///
/// [`ExrReadError`], for any input.
pub fn read(mut input: impl Read + Seek, memory_limit: u64) -> Result<Vec<Part<String>>, ExrReadError> {
    let length = input.seek(SeekFrom::End(0))?;
    input.rewind()?;
    // The decoder is made to fail and not to panic on damaged files, which is not proven.
    let decode = AssertUnwindSafe(move || {
        let meta = MetaData::read_from_buffered(&mut input, false)?;
        check(&meta, length, memory_limit)?;
        check_chunks(&meta, &mut input, length)?;
        input.rewind()?;
        if meta.headers.iter().any(|header| is_dwa(header.compression)) {
            check_dwa(&mut input)?;
            input.rewind()?;
        }
        let image = exr::prelude::read()
            .no_deep_data()
            .largest_resolution_level()
            .all_channels()
            .all_layers()
            .all_attributes()
            .non_parallel()
            .from_buffered(input)?;
        image.layer_data.into_iter().map(part).collect()
    });
    catch_unwind(decode).unwrap_or(Err(ExrReadError::Damaged))
}

/// Refuses what the file cannot hold, and what would take too much memory.
fn check(meta: &MetaData, length: u64, limit: u64) -> Result<(), ExrReadError> {
    let (mut announced, mut needed) = (0_u64, 0_u64);
    for header in &meta.headers {
        if header.deep {
            return Err(exr::error::Error::NotSupported("deep data".into()).into());
        }
        let [width, height] = [header.layer_size.width(), header.layer_size.height()];
        let pixels = (width as u64).saturating_mul(height as u64);
        announced = announced.saturating_add(pixels.saturating_mul(header.channels.bytes_per_pixel as u64));
        // As they are stored and as 32-bit floats.
        let floats = header.channels.list.len().saturating_mul(4);
        let held = header.channels.bytes_per_pixel.saturating_add(floats);
        needed = needed.saturating_add(pixels.saturating_mul(held as u64));
        if let Some(channel) = header.channels.list.iter().find(|channel| channel.sampling.area() != 1) {
            return Err(ExrReadError::Subsampled(channel.name.to_string()));
        }
        // Each part's place is listed with eight bytes.
        announced = announced.max((header.chunk_count as u64).saturating_mul(8 * MOST));
    }
    if announced > length.saturating_mul(MOST) {
        return Err(ExrReadError::Announced { length, announced });
    }
    if needed > limit {
        return Err(ExrReadError::Memory { needed, limit });
    }
    Ok(())
}

/// Refuses chunks that say they are longer than what follows them in the file: the decoder takes memory for them as they say,
/// up to the size of a tile, which may be far larger than the image. The input stands behind the headers.
fn check_chunks(meta: &MetaData, input: &mut (impl Read + Seek), length: u64) -> Result<(), ExrReadError> {
    let mut offsets = Vec::new();
    for header in &meta.headers {
        for _ in 0..header.chunk_count {
            offsets.push(u64::from_le_bytes(array(input)?));
        }
    }
    for offset in offsets {
        input.seek(SeekFrom::Start(offset))?;
        let part = if meta.requirements.is_multilayer() { u32::from_le_bytes(array(input)?) } else { 0 };
        let header = usize::try_from(part).ok().and_then(|part| meta.headers.get(part));
        // Where it is: a row, or the place of a tile and its level.
        match header.ok_or(ExrReadError::Damaged)?.blocks {
            BlockDescription::ScanLines => drop(array::<4>(input)?),
            BlockDescription::Tiles(_) => drop(array::<16>(input)?),
        }
        let told = u64::from(u32::from_le_bytes(array(input)?));
        if told > length.saturating_sub(input.stream_position()?) {
            return Err(ExrReadError::Damaged);
        }
    }
    Ok(())
}

fn array<const N: usize>(input: &mut impl Read) -> Result<[u8; N], ExrReadError> {
    let mut bytes = [0; N];
    match input.read_exact(&mut bytes) {
        Err(error) if error.kind() == ErrorKind::UnexpectedEof => Err(ExrReadError::Damaged),
        result => result.map(|()| bytes).map_err(ExrReadError::from),
    }
}

fn is_dwa(compression: Compression) -> bool {
    matches!(compression, Compression::DWAA(_) | Compression::DWAB(_))
}

/// Refuses chunks of DWA compression whose counters say that they hold more than the image does: the decoder takes memory for them
/// as they say.
fn check_dwa(input: &mut (impl Read + Seek)) -> Result<(), ExrReadError> {
    let reader = exr::block::read(input, false)?;
    let headers = reader.headers().to_vec();
    // Those that the table of offsets names, as they are decoded.
    for chunk in reader.filter_chunks(false, |_, _, _| true)? {
        let chunk = chunk?;
        let Some(header) = headers.get(chunk.layer_index) else { return Err(ExrReadError::Damaged) };
        let bytes = match &chunk.compressed_block {
            CompressedBlock::ScanLine(block) => &block.compressed_pixels_le,
            CompressedBlock::Tile(block) => &block.compressed_pixels_le,
            CompressedBlock::DeepScanLine(_) | CompressedBlock::DeepTile(_) => continue,
        };
        if !is_dwa(header.compression) {
            continue;
        }
        let at = header.get_block_data_indices(&chunk.compressed_block)?;
        let size = header.get_absolute_block_pixel_coordinates(at)?.size;
        let pixel = header.channels.bytes_per_pixel as u64;
        // What does not shrink is stored as it is.
        if bytes.len() as u64 == (size.area() as u64).saturating_mul(pixel) {
            continue;
        }
        // Blocks of 8^2 pixels reach beyond the sides; compressed bytes may be a few more than they are of.
        let [width, height] = [size.width(), size.height()].map(|edge| (edge as u64).saturating_add(8));
        let most = width.saturating_mul(height).saturating_mul(pixel.max(2)).saturating_mul(2);
        let (counters, _) = bytes.as_chunks::<8>();
        if counters.iter().take(DWA_COUNTERS).any(|told| u64::from_le_bytes(*told) > most) {
            return Err(ExrReadError::Damaged);
        }
    }
    Ok(())
}

fn part(layer: Layer<AnyChannels<FlatSamples>>) -> Result<Part<String>, ExrReadError> {
    let channels = layer.channel_data.list.into_iter().map(|channel| {
        let samples = match channel.sample_data {
            FlatSamples::F32(values) => Samples::F32(values),
            FlatSamples::F16(values) => Samples::F16(values),
            #[allow(clippy::cast_precision_loss, reason = "documented")]
            FlatSamples::U32(values) => Samples::F32(values.into_iter().map(|value| value as f32).collect()),
        };
        (channel.name.to_string(), samples)
    });
    let attributes = layer.attributes;
    let said = attributes.other.iter().find(|(name, _)| **name == *ATTRIBUTE);
    Ok(Part {
        name: attributes.layer_name.map(|name| name.to_string()).unwrap_or_default(),
        pixels: [layer.size.width(), layer.size.height()],
        channels: channels.collect(),
        attribute: match said {
            Some((_, AttributeValue::Text(text))) => text.to_string(),
            _ => String::new(),
        },
    })
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "what is not there fails the test")]

    use std::io::Cursor;

    use exr::image::{AnyChannel, Blocks, Encoding, Image};
    use exr::meta::header::LayerAttributes;
    use exr::prelude::{Compression, LineOrder, Vec2, WritableImage};
    use half::f16;

    use super::super::write;
    use super::*;

    const LIMIT: u64 = 1 << 26;

    fn parts() -> Vec<Part<String>> {
        let values = |n: u16| (0..n).map(|i| f32::from(i) * 0.25 - 3.0).collect::<Vec<_>>();
        let part = |name: &str, channels| Part {
            name: name.to_owned(),
            pixels: [5, 4],
            channels,
            attribute: format!("{{\"name\": \"{name}\"}}"),
        };
        let half = |n| Samples::F16(values(n).into_iter().map(f16::from_f32).collect());
        vec![
            part("a", vec![("Y".to_owned(), Samples::F32(values(20)))]),
            part(
                "b",
                vec![("B".to_owned(), half(20)), ("Z.depth".to_owned(), Samples::F32(vec![f32::NAN; 20]))],
            ),
        ]
    }

    fn bytes() -> Vec<u8> {
        let mut out = Cursor::new(Vec::new());
        write(parts(), &mut out).unwrap();
        out.into_inner()
    }

    #[test]
    fn what_was_written_is_read() {
        // NaN is not equal to itself.
        let found = read(Cursor::new(bytes()), LIMIT).unwrap();
        assert_eq!(format!("{found:?}"), format!("{:?}", parts()));
    }

    /// A picture with smooth parts, as the `exr` crate writes it.
    fn compressed(compression: Compression, blocks: Blocks) -> Vec<u8> {
        let values: Vec<f32> =
            (0..64_u16 * 40).map(|i| f32::from(i % 64) * 0.01 + f32::from(i / 64)).collect();
        let encoding = Encoding { compression, blocks, line_order: LineOrder::Increasing };
        let channels = AnyChannels::sort(
            ["G", "R"]
                .map(|name| AnyChannel::new(name, FlatSamples::F32(values.clone())))
                .into_iter()
                .collect(),
        );
        let layer = Layer::new((64, 40), LayerAttributes::default(), encoding, channels);
        let mut out = Cursor::new(Vec::new());
        Image::from_layer(layer).write().non_parallel().to_buffered(&mut out).unwrap();
        out.into_inner()
    }

    #[test]
    fn damaged_images_give_errors_or_pixels() {
        let tiles = Blocks::Tiles(Vec2(16, 16));
        let mut originals = vec![bytes()];
        for compression in [
            Compression::Uncompressed,
            Compression::RLE,
            Compression::ZIP1,
            Compression::PIZ,
            Compression::PXR24,
            Compression::B44,
            Compression::DWAA(None),
            Compression::DWAB(None),
        ] {
            originals.push(compressed(compression, Blocks::ScanLines));
            originals.push(compressed(compression, tiles));
        }
        let mut state = 11_u64;
        let mut random = |below: usize| {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            usize::try_from(state >> 33).unwrap() % below
        };
        for original in originals {
            assert!(read(Cursor::new(&original), LIMIT).is_ok());
            for _ in 0..60 {
                let mut damaged = original.clone();
                let reach = if random(2) == 0 { damaged.len() } else { damaged.len().min(400) };
                for _ in 0..=random(4) {
                    let at = random(reach);
                    damaged[at] = [0, 255, 127, 1, 128][random(5)];
                }
                if random(4) == 0 {
                    damaged.truncate(random(original.len()));
                }
                if let Ok(parts) = read(Cursor::new(damaged), LIMIT) {
                    let bytes: usize =
                        parts.iter().map(|part| part.pixels[0] * part.pixels[1] * part.channels.len()).sum();
                    assert!(bytes as u64 * 4 <= LIMIT);
                }
            }
        }
    }

    #[test]
    fn announcements_are_held_against_the_file_and_the_limit() {
        let original = bytes();
        assert!(matches!(read(Cursor::new(&original), 100), Err(ExrReadError::Memory { limit: 100, .. })));
        // The data window's right edge, in the first header: xMin, yMin, xMax, yMax after "box2i" and a length.
        let name = b"dataWindow\0box2i\0";
        let at = original.windows(name.len()).position(|window| window == name).unwrap() + name.len() + 4 + 8;
        let mut wide = original.clone();
        wide[at..at + 4].copy_from_slice(&1_000_000_000_i32.to_le_bytes());
        assert!(matches!(read(Cursor::new(&wide), u64::MAX), Err(ExrReadError::Announced { .. })));
        for input in [&b""[..], b"v/1\x01", b"not an image at all"] {
            assert!(read(Cursor::new(input), LIMIT).is_err());
        }
    }
}
