//! Pictures: as many values as there are pixels, codes of sRGB, in no more memory than is allowed.

use std::io::Cursor;

use vdbake::formats::png::{self, PngReadError};

use super::within;

/// Bytes that a picture may take.
const LIMIT: u64 = 8 << 20;

pub(crate) fn run(data: &[u8]) -> bool {
    // Besides the pixels: a line of them, twice, and what the decoder has not given out yet.
    let most = 2 * LIMIT + (1 << 20) + 2 * data.len() as u64;
    let picture = match within(most, || png::read(Cursor::new(data), LIMIT)) {
        Ok(picture) => picture,
        Err(error) => {
            if let PngReadError::Memory { needed, .. } = error {
                assert!(needed > LIMIT);
            }
            return false;
        }
    };
    let [width, height] = picture.size;
    assert!(width > 0 && height > 0 && !picture.channels.is_empty());
    for (name, values) in &picture.channels {
        assert_eq!(values.len(), width * height, "{name}");
        assert!(values.iter().all(|code| (0.0..=1.0).contains(code)), "{name}");
    }
    true
}
