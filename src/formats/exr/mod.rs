//! OpenEXR images of exact values, with one or several parts, by the `exr` crate.
//!
//! The same images give the same bytes: whatever else is to be said of an image goes into one attribute of text, since the
//! crate keeps attributes in an order that changes from run to run.
//!
//! Images of any program are read by [`read()`].

mod read;

use std::io::{Seek, Write};

use exr::image::{AnyChannel, AnyChannels, Blocks, Encoding, FlatSamples, Image, Layer};
use exr::meta::attribute::{AttributeValue, IntegerBounds, LineOrder, Text};
use exr::meta::header::{ImageAttributes, LayerAttributes};
use exr::prelude::{Compression, SmallVec, WritableImage};
use half::f16;
pub use read::{ExrReadError, read};

/// The attribute that holds what is said of a part.
const ATTRIBUTE: &str = "vdbake";

/// Pixels of one channel, in rows from the top.
#[derive(Debug, Clone, PartialEq)]
pub enum Samples {
    /// 32-bit floats.
    F32(Vec<f32>),
    /// 16-bit floats.
    F16(Vec<f16>),
}

/// An image, or one of several in a file.
#[derive(Debug, Clone, PartialEq)]
pub struct Part<N = &'static str> {
    /// Its name, unlike that of any other in the file.
    pub name: String,
    /// Pixels from left to right, and from top to bottom.
    pub pixels: [usize; 2],
    /// Channels with their names.
    pub channels: Vec<(N, Samples)>,
    /// Text of its attribute `vdbake`.
    pub attribute: String,
}

/// Why there is no image.
#[derive(Debug, thiserror::Error)]
pub enum ExrError {
    /// Its size, or the number of its pixels, is not that of an image.
    #[error("an image of {0} x {1} pixels cannot be written")]
    Size(usize, usize),
    /// A name or an attribute that the format cannot hold.
    #[error("the name or the attribute of a part is not plain text")]
    Text,
    /// Nothing to write.
    #[error("an image needs a part")]
    Empty,
    /// The output's.
    #[error(transparent)]
    Write(#[from] exr::error::Error),
}

/// Writes the parts of an image, of one size, in order: zip-compressed scan lines.
///
/// # Errors
///
/// [`ExrError`].
pub fn write<N: AsRef<str>>(parts: Vec<Part<N>>, out: impl Write + Seek) -> Result<(), ExrError> {
    let [width, height] = parts.first().ok_or(ExrError::Empty)?.pixels;
    let layers = parts.into_iter().map(layer).collect::<Result<Vec<_>, _>>()?;
    let attributes = ImageAttributes::new(IntegerBounds::from_dimensions((width, height)));
    Image::from_layers(attributes, layers).write().non_parallel().to_buffered(out)?;
    Ok(())
}

fn layer<N: AsRef<str>>(part: Part<N>) -> Result<Layer<AnyChannels<FlatSamples>>, ExrError> {
    let [width, height] = part.pixels;
    let count = width.checked_mul(height).filter(|count| *count > 0 && *count < 1 << 31);
    let fits = |samples: &Samples| match samples {
        Samples::F32(values) => Some(values.len()) == count,
        Samples::F16(values) => Some(values.len()) == count,
    };
    if !part.channels.iter().all(|(_, samples)| fits(samples)) {
        return Err(ExrError::Size(width, height));
    }
    let text = |text: &str| Text::new_or_none(text).ok_or(ExrError::Text);
    let mut attributes = LayerAttributes::named(text(&part.name)?);
    attributes.other.insert(text(ATTRIBUTE)?, AttributeValue::Text(text(&part.attribute)?));
    let mut channels: SmallVec<[AnyChannel<FlatSamples>; 4]> = SmallVec::new();
    for (name, samples) in part.channels {
        let samples = match samples {
            Samples::F32(values) => FlatSamples::F32(values),
            Samples::F16(values) => FlatSamples::F16(values),
        };
        channels.push(AnyChannel::new(text(name.as_ref())?, samples));
    }
    let encoding = Encoding {
        compression: Compression::ZIP16,
        blocks: Blocks::ScanLines,
        line_order: LineOrder::Increasing,
    };
    Ok(Layer::new((width, height), attributes, encoding, AnyChannels::sort(channels)))
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "what is not there fails the test")]

    use std::io::Cursor;

    use super::*;

    fn part(name: &str, values: Vec<f32>) -> Part {
        Part {
            name: name.to_owned(),
            pixels: [3, 2],
            channels: vec![("Y", Samples::F32(values))],
            attribute: "{\"plane\": 1}".to_owned(),
        }
    }

    fn bytes(parts: Vec<Part>) -> Result<Vec<u8>, ExrError> {
        let mut out = Cursor::new(Vec::new());
        write(parts, &mut out).map(|()| out.into_inner())
    }

    #[test]
    fn the_same_parts_give_the_same_bytes() {
        let parts = || vec![part("a", vec![0.5; 6]), part("b", vec![-1.0, 0.0, 1e-40, 2.0, f32::MAX, 4.0])];
        let first = bytes(parts()).unwrap();
        assert_eq!(first[..4], [0x76, 0x2f, 0x31, 0x01]);
        for _ in 0..20 {
            assert_eq!(bytes(parts()).unwrap(), first);
        }
    }

    #[test]
    fn what_is_no_image_is_refused() {
        assert!(matches!(bytes(vec![]), Err(ExrError::Empty)));
        assert!(matches!(bytes(vec![part("a", vec![0.0; 5])]), Err(ExrError::Size(3, 2))));
        assert!(matches!(bytes(vec![part("\u{1F300}", vec![0.0; 6])]), Err(ExrError::Text)));
    }
}
