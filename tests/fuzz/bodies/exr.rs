//! Images: what is read is written and read again, the same, in no more memory than is allowed.

use std::io::Cursor;

use vdbake::formats::exr::{self, ExrReadError, Samples};

use super::within;

/// Bytes that an image may take.
const LIMIT: u64 = 8 << 20;

pub(crate) fn run(data: &[u8]) -> bool {
    let most = 2 * LIMIT + (4 << 20) + 16 * data.len() as u64;
    let parts = match within(most, || exr::read(Cursor::new(data), LIMIT)) {
        Ok(parts) => parts,
        Err(error) => {
            if let ExrReadError::Memory { needed, .. } = error {
                assert!(needed > LIMIT);
            }
            return false;
        }
    };
    for part in &parts {
        let [width, height] = part.pixels;
        for (name, samples) in &part.channels {
            let count = match samples {
                Samples::F32(values) => values.len(),
                Samples::F16(values) => values.len(),
            };
            assert_eq!(count, width * height, "{name}");
        }
    }
    // Parts of one size are what is written.
    if parts.windows(2).all(|pair| pair[0].pixels == pair[1].pixels) {
        let mut out = Cursor::new(vec![]);
        if exr::write(parts.clone(), &mut out).is_ok() {
            let again = exr::read(Cursor::new(out.into_inner()), u64::MAX).expect("what was written");
            // As text, because NaN is not equal to itself.
            assert_eq!(format!("{again:?}"), format!("{parts:?}"));
        }
    }
    true
}
