//! PNG pictures of eight bits a channel, by the `png` crate.

use std::io::Write;

/// Writes a picture: red, green and blue (sRGB) of every pixel, in rows from the top.
///
/// # Errors
///
/// The output's; a size that is not that of the pixels, or that the format cannot hold.
pub fn write(size: [usize; 2], pixels: &[[u8; 3]], out: impl Write) -> Result<(), png::EncodingError> {
    encode(size, png::ColorType::Rgb, pixels.as_flattened(), out)
}

/// Writes a picture whose pixels have an alpha, that the colours are not multiplied with.
///
/// # Errors
///
/// As [`write`].
pub fn write_with_alpha(
    size: [usize; 2],
    pixels: &[[u8; 4]],
    out: impl Write,
) -> Result<(), png::EncodingError> {
    encode(size, png::ColorType::Rgba, pixels.as_flattened(), out)
}

fn encode(
    size: [usize; 2],
    colour: png::ColorType,
    bytes: &[u8],
    out: impl Write,
) -> Result<(), png::EncodingError> {
    let [width, height] = size.map(|edge| u32::try_from(edge).unwrap_or(0));
    let mut encoder = png::Encoder::new(out, width, height);
    encoder.set_color(colour);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_source_srgb(png::SrgbRenderingIntent::Perceptual);
    let mut writer = encoder.write_header()?;
    writer.write_image_data(bytes)?;
    writer.finish()
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
}
