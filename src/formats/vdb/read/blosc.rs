//! Blosc-1 frames, as C-Blosc writes them.

use lz4_flex::block::decompress_into;

use super::error::Fault;

const HEADER: usize = 16;
const SHUFFLE: u8 = 0x01;
const STORED: u8 = 0x02;
const BIT_SHUFFLE: u8 = 0x04;
const ONE_STREAM: u8 = 0x10;

/// Types of more bytes, and blocks of fewer values, are not split whatever the flags say: frames older than the flag
/// rely on it.
const MAX_STREAMS: usize = 16;
const MIN_VALUES: usize = 128;

const CORRUPT: Fault = Fault::Invalid("Blosc frame");

/// Decodes a frame that holds exactly as many bytes as `out` has. `shuffled` is working memory.
pub(super) fn decode(frame: &[u8], shuffled: &mut Vec<u8>, out: &mut [u8]) -> Result<(), Fault> {
    let (header, _) = frame.split_first_chunk::<HEADER>().ok_or(CORRUPT)?;
    let [2, _, flags, type_size, sizes @ ..] = header else {
        return Err(Fault::Unsupported("Blosc frame of another version"));
    };
    let sizes = sizes.as_chunks::<4>().0;
    let size = |at: usize| sizes.get(at).and_then(|bytes| usize::try_from(u32::from_le_bytes(*bytes)).ok());
    let (Some(raw_len), Some(block_len), Some(frame_len)) = (size(0), size(1), size(2)) else {
        return Err(CORRUPT);
    };
    let frame = frame.get(..frame_len).ok_or(CORRUPT)?;
    if raw_len != out.len() {
        return Err(Fault::Invalid("Blosc frame of another length"));
    }
    if raw_len == 0 {
        return Ok(());
    }
    if flags & STORED != 0 {
        let stored = frame.get(HEADER..).and_then(|rest| rest.get(..raw_len));
        out.copy_from_slice(stored.ok_or(CORRUPT)?);
        return Ok(());
    }
    match flags >> 5 {
        1 => {}
        0 => return Err(Fault::Unsupported("Blosc with BloscLZ")),
        2 => return Err(Fault::Unsupported("Blosc with Snappy")),
        3 => return Err(Fault::Unsupported("Blosc with zlib")),
        4 => return Err(Fault::Unsupported("Blosc with Zstandard")),
        _ => return Err(CORRUPT),
    }
    if flags & BIT_SHUFFLE != 0 {
        return Err(Fault::Unsupported("Blosc with bit shuffle"));
    }
    let type_size = usize::from(*type_size);
    let values = block_len.checked_div(type_size).ok_or(CORRUPT)?;
    if block_len == 0 {
        return Err(CORRUPT);
    }
    let splits = flags & ONE_STREAM == 0 && type_size <= MAX_STREAMS && values >= MIN_VALUES;
    let offsets = frame.get(HEADER..).unwrap_or_default().as_chunks().0;
    for (index, block) in out.chunks_mut(block_len).enumerate() {
        let offset = number(offsets.get(index).ok_or(CORRUPT)?)?;
        let streams = if splits && block.len() == block_len { type_size } else { 1 };
        if flags & SHUFFLE != 0 && type_size > 1 {
            shuffled.resize(block.len(), 0);
            streams_into(frame, offset, streams, shuffled)?;
            unshuffle(shuffled, type_size, block);
        } else {
            streams_into(frame, offset, streams, block)?;
        }
    }
    Ok(())
}

fn number(bytes: &[u8; 4]) -> Result<usize, Fault> {
    usize::try_from(u32::from_le_bytes(*bytes)).map_err(|_| CORRUPT)
}

/// Decodes the streams of a block, which follow one another.
fn streams_into(frame: &[u8], offset: usize, streams: usize, block: &mut [u8]) -> Result<(), Fault> {
    let stream_len =
        block.len().checked_div(streams).filter(|len| len.checked_mul(streams) == Some(block.len()));
    let mut rest = frame.get(offset..).ok_or(CORRUPT)?;
    for part in block.chunks_mut(stream_len.ok_or(CORRUPT)?) {
        let (len, behind) = rest.split_first_chunk().ok_or(CORRUPT)?;
        let (stream, next) = behind.split_at_checked(number(len)?).ok_or(CORRUPT)?;
        rest = next;
        if stream.len() == part.len() {
            part.copy_from_slice(stream);
        } else if !decompress_into(stream, part).is_ok_and(|len| len == part.len()) {
            return Err(Fault::Invalid("LZ4 stream"));
        }
    }
    Ok(())
}

/// Puts the bytes of each value together again: all first bytes come first, then all second ones.
fn unshuffle(shuffled: &[u8], type_size: usize, out: &mut [u8]) {
    let count = out.len().checked_div(type_size).unwrap_or(0);
    if type_size == 4 {
        let (values, tail) = out.as_chunks_mut::<4>();
        let (a, planes) = shuffled.split_at(count);
        let (b, planes) = planes.split_at(count);
        let (c, planes) = planes.split_at(count);
        let (d, rest) = planes.split_at(count);
        for ((((value, a), b), c), d) in values.iter_mut().zip(a).zip(b).zip(c).zip(d) {
            *value = [*a, *b, *c, *d];
        }
        tail.copy_from_slice(rest);
        return;
    }
    let whole = count.saturating_mul(type_size);
    let (planes, rest) = shuffled.split_at(whole);
    let (values, tail) = out.split_at_mut(whole);
    for (place, plane) in planes.chunks_exact(count.max(1)).enumerate() {
        for (byte, value) in plane.iter().zip(values.iter_mut().skip(place).step_by(type_size)) {
            *value = *byte;
        }
    }
    tail.copy_from_slice(rest);
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A frame of these bytes, stored in one stream that is not compressed.
    fn frame(flags: u8, type_size: u8, bytes: &[u8]) -> Vec<u8> {
        let numbers = |numbers: &[usize]| -> Vec<u8> {
            numbers.iter().flat_map(|n| u32::try_from(*n).expect("small").to_le_bytes()).collect()
        };
        let len = bytes.len();
        let mut frame = vec![2, 1, flags, type_size];
        frame.extend(numbers(&[len, len, len + 24, 20, len]));
        frame.extend(bytes);
        frame
    }

    fn decoded(frame: &[u8], len: usize) -> Result<Vec<u8>, Fault> {
        let mut out = vec![0; len];
        decode(frame, &mut vec![], &mut out).map(|()| out)
    }

    #[test]
    fn codecs_that_are_not_read_are_named() {
        let bytes: Vec<u8> = (0..64).collect();
        assert_eq!(decoded(&frame(0x30, 4, &bytes), 64), Ok(bytes.clone()));
        for (codec, name) in [(0, "BloscLZ"), (2, "Snappy"), (3, "zlib"), (4, "Zstandard")] {
            let frame = frame(0x10 | codec << 5, 4, &bytes);
            let Err(Fault::Unsupported(what)) = decoded(&frame, 64) else { panic!("{name} was read") };
            assert_eq!(what, format!("Blosc with {name}"));
            // Bytes that are stored as they are have no codec.
            let mut stored = frame[..HEADER].to_vec();
            stored[2] |= STORED;
            stored.extend(&bytes);
            stored[12] = 80;
            assert_eq!(decoded(&stored, 64), Ok(bytes.clone()));
        }
        for codec in 5..8 {
            assert_eq!(decoded(&frame(0x10 | codec << 5, 4, &bytes), 64), Err(CORRUPT));
        }
        assert_eq!(
            decoded(&frame(0x30 | BIT_SHUFFLE, 4, &bytes), 64),
            Err(Fault::Unsupported("Blosc with bit shuffle"))
        );
        let mut other = frame(0x30, 4, &bytes);
        other[0] = 3;
        assert_eq!(decoded(&other, 64), Err(Fault::Unsupported("Blosc frame of another version")));
    }

    #[test]
    fn bytes_of_values_come_together_again() {
        // All first bytes, all second ones, and so on; a rest that is no value stays at the end.
        for type_size in [2_u8, 4, 8, 12] {
            let size = usize::from(type_size);
            let values: Vec<u8> = (0..10 * type_size + 1).collect();
            let mut shuffled: Vec<u8> =
                (0..size).flat_map(|byte| values.iter().skip(byte).step_by(size).take(10)).copied().collect();
            shuffled.push(10 * type_size);
            assert_eq!(decoded(&frame(0x31, type_size, &shuffled), values.len()), Ok(values));
        }
    }

    #[test]
    fn lengths_that_do_not_fit_are_refused() {
        let bytes = [7; 64];
        let good = frame(0x30, 4, &bytes);
        for len in 0..good.len() {
            assert!(decoded(&good[..len], 64).is_err());
        }
        assert!(decoded(&good, 63).is_err() && decoded(&good, 65).is_err());
        // Length, block length, frame length, offset and stream length, each of them too large or none.
        for (at, value) in [(4, 0), (7, 1), (8, 0), (15, 1), (19, 1), (20, 63), (23, 1)] {
            let mut bad = good.clone();
            bad[at] = value;
            assert!(decoded(&bad, 64).is_err(), "{at}");
        }
    }
}
