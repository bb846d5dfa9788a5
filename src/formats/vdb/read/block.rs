//! Value blocks: the values of a node, of which some are stored and the rest follow from a code.

use libdeflater::Decompressor;

use super::super::codec::{FLAG_ACTIVE_MASK, FLAG_BLOSC, FLAG_ZIP};
use super::blosc;
use super::error::Fault;
use super::value::Stored;

/// A code of this size or more is none.
const CODES: u8 = 7;
/// The payload holds all entries.
const ALL_ENTRIES: u8 = 6;

/// How the value blocks of a grid are stored.
#[derive(Debug, Clone, Copy)]
pub(super) struct Layout<T> {
    pub(super) flags: u32,
    pub(super) half: bool,
    pub(super) background: T,
}

/// How far a block goes, as can be told from its beginning.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Length {
    /// As many bytes.
    Whole(usize),
    /// More bytes are needed to tell: as many as this at least.
    AtLeast(usize),
}

impl<T: Stored> Layout<T> {
    fn value_size(&self) -> usize {
        T::HALF_SIZE.filter(|_| self.half).unwrap_or(T::SIZE)
    }

    /// Number of values in the payload of a block of these entries, of which `active` are active.
    fn stored(&self, code: u8, entries: usize, active: usize) -> usize {
        if self.flags & FLAG_ACTIVE_MASK != 0 && code != ALL_ENTRIES { active } else { entries }
    }

    /// Whether the payload is framed by its size. Of binary16 there is not even a size where no value is stored.
    fn framed(&self, stored: usize) -> bool {
        self.flags & (FLAG_ZIP | FLAG_BLOSC) != 0 && (stored > 0 || !self.half || T::HALF_SIZE.is_none())
    }

    /// Whether all entries are stored, and as they are.
    pub(super) fn is_plain(&self) -> bool {
        self.flags & (FLAG_ACTIVE_MASK | FLAG_ZIP | FLAG_BLOSC) == 0
    }

    /// Bytes of a block without an active entry, the shortest there is.
    pub(super) fn least(&self, entries: usize) -> usize {
        if self.is_plain() { entries.saturating_mul(self.value_size()).saturating_add(1) } else { 1 }
    }

    /// The length of the block that begins with `bytes`.
    pub(super) fn measure(&self, bytes: &[u8], entries: usize, active: usize) -> Result<Length, Fault> {
        let Some(code) = bytes.first() else { return Ok(Length::AtLeast(1)) };
        let head = head_len::<T>(*code, entries)?;
        let stored = self.stored(*code, entries, active);
        let raw = stored.saturating_mul(self.value_size());
        if !self.framed(stored) {
            return Ok(Length::Whole(head.saturating_add(raw)));
        }
        let framed = head.saturating_add(8);
        let Some(size) = bytes.get(head..).and_then(|rest| rest.first_chunk()) else {
            return Ok(Length::AtLeast(framed));
        };
        Ok(Length::Whole(framed.saturating_add(payload_len(i64::from_le_bytes(*size), raw)?)))
    }

    /// Decodes a whole block into `out`, one value for each entry. `active` is the node's mask of active entries.
    pub(super) fn decode(
        &self,
        block: &[u8],
        active: &[u64],
        scratch: &mut Scratch<T>,
        out: &mut [T],
    ) -> Result<(), Fault> {
        let count = active.iter().map(|word| word.count_ones() as usize).sum();
        let (code, rest) = block.split_first().ok_or(Fault::Invalid("value block"))?;
        let stored = self.stored(*code, out.len(), count);
        let (head, payload) = rest
            .split_at_checked(head_len::<T>(*code, out.len())?.saturating_sub(1))
            .ok_or(Fault::Invalid("value block"))?;
        let raw = self.payload(payload, stored, &mut scratch.bytes)?;
        if stored == out.len() {
            self.values(raw, out);
            return Ok(());
        }
        self.fill_inactive(*code, head, out)?;
        scratch.values.resize(stored, self.background);
        self.values(raw, &mut scratch.values);
        scatter(&scratch.values, active, out);
        Ok(())
    }

    /// The payload's bytes as they were before compression.
    fn payload<'a>(
        &self,
        payload: &'a [u8],
        stored: usize,
        scratch: &'a mut Bytes,
    ) -> Result<&'a [u8], Fault> {
        let raw = stored.saturating_mul(self.value_size());
        if !self.framed(stored) {
            return payload.get(..raw).ok_or(Fault::Invalid("value block"));
        }
        let (size, chunk) = payload.split_first_chunk().ok_or(Fault::Invalid("value block"))?;
        let size = i64::from_le_bytes(*size);
        let chunk = chunk.get(..payload_len(size, raw)?).ok_or(Fault::Invalid("value block"))?;
        if size <= 0 {
            return Ok(chunk);
        }
        scratch.raw.resize(raw, 0);
        if self.flags & FLAG_BLOSC != 0 {
            blosc::decode(chunk, &mut scratch.shuffled, &mut scratch.raw)?;
        } else {
            scratch.unzip(chunk)?;
        }
        Ok(&scratch.raw)
    }

    fn values(&self, raw: &[u8], out: &mut [T]) {
        if self.half {
            T::decode_half(raw, out);
        } else {
            T::decode(raw, out);
        }
    }

    /// Gives each entry the value that it has where it is inactive.
    fn fill_inactive(&self, code: u8, head: &[u8], out: &mut [T]) -> Result<(), Fault> {
        let own = inactive_values(code).saturating_mul(T::SIZE).min(head.len());
        let (own, selection) = head.split_at(own);
        let mut values = [self.background; 2];
        T::decode(own, &mut values);
        let [first, second] = values;
        let (off, on) = match code {
            0 => (self.background, self.background),
            1 | 3 => (self.background.negative(), self.background),
            2 | 4 => (first, self.background),
            _ => (first, second),
        };
        if !selects(code) {
            out.fill(off);
            return Ok(());
        }
        for (values, byte) in out.chunks_mut(8).zip(selection) {
            for (bit, value) in values.iter_mut().enumerate() {
                *value = if (byte >> bit) & 1 == 1 { on } else { off };
            }
        }
        Ok(())
    }
}

/// Inactive values that stand in a block.
fn inactive_values(code: u8) -> usize {
    match code {
        2 | 4 => 1,
        5 => 2,
        _ => 0,
    }
}

/// Whether a mask in the block chooses between two inactive values.
fn selects(code: u8) -> bool {
    (3..=5).contains(&code)
}

/// Bytes before the payload.
fn head_len<T: Stored>(code: u8, entries: usize) -> Result<usize, Fault> {
    if code >= CODES {
        return Err(Fault::Invalid("code of a value block"));
    }
    let selection = if selects(code) { entries / 8 } else { 0 };
    Ok(inactive_values(code).saturating_mul(T::SIZE).saturating_add(selection).saturating_add(1))
}

/// Bytes of a payload that was `raw` bytes long, from the number before it.
fn payload_len(size: i64, raw: usize) -> Result<usize, Fault> {
    let len = usize::try_from(size.unsigned_abs()).map_err(|_| Fault::Invalid("size of a payload"))?;
    // A codec that makes its input longer by more than this is broken, and bounds keep memory bounded.
    let most = if size > 0 { raw.saturating_mul(2).saturating_add(4096) } else { raw };
    if len > most || (size <= 0 && len != raw) {
        return Err(Fault::Invalid("size of a payload"));
    }
    Ok(len)
}

/// Puts values at the entries whose bit is set.
fn scatter<T: Stored>(values: &[T], mask: &[u64], out: &mut [T]) {
    let mut rest = values;
    for (word, run) in mask.iter().zip(out.chunks_mut(64)) {
        let (here, behind) = rest.split_at((word.count_ones() as usize).min(rest.len()));
        rest = behind;
        if here.len() == run.len() {
            run.copy_from_slice(here);
            continue;
        }
        let mut bits = *word;
        for value in here {
            if let Some(slot) = run.get_mut(bits.trailing_zeros() as usize) {
                *slot = *value;
            }
            bits &= bits.wrapping_sub(1);
        }
    }
}

/// Working memory of a thread that decodes.
pub(super) struct Scratch<T> {
    bytes: Bytes,
    values: Vec<T>,
}

struct Bytes {
    shuffled: Vec<u8>,
    raw: Vec<u8>,
    zlib: Decompressor,
}

impl<T> Default for Scratch<T> {
    fn default() -> Self {
        let bytes = Bytes { shuffled: vec![], raw: vec![], zlib: Decompressor::new() };
        Self { bytes, values: vec![] }
    }
}

impl Bytes {
    /// Fills `raw` from a zlib stream that holds exactly as much.
    fn unzip(&mut self, stream: &[u8]) -> Result<(), Fault> {
        match self.zlib.zlib_decompress(stream, &mut self.raw) {
            Ok(len) if len == self.raw.len() => Ok(()),
            _ => Err(Fault::Invalid("zlib stream")),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const ACTIVE: [u64; 1] = [0b0110];

    /// Decodes a block of 64 entries of which the second and the third are active, 5 and 6.
    fn decode(flags: u32, code: u8, head: &[f32], selection: Option<u64>, payload: &[f32]) -> Vec<f32> {
        let mut block = vec![code];
        let put =
            |block: &mut Vec<u8>, values: &[f32]| block.extend(values.iter().flat_map(|v| v.to_le_bytes()));
        put(&mut block, head);
        block.extend(selection.into_iter().flat_map(u64::to_le_bytes));
        put(&mut block, payload);
        let layout = Layout { flags, half: false, background: 0.5 };
        assert_eq!(layout.measure(&block, 64, 2), Ok(Length::Whole(block.len())));
        let mut out = vec![0.0; 64];
        layout.decode(&block, &ACTIVE, &mut Scratch::default(), &mut out).expect("valid");
        out
    }

    #[test]
    fn codes_give_inactive_values() {
        let stored = [5.0, 6.0];
        let expect = |found: Vec<f32>, first: f32, fourth: f32, others: f32| {
            assert_eq!(found[..4], [first, 5.0, 6.0, fourth]);
            assert!(found[4..].iter().all(|value| *value == others));
        };
        let mask = FLAG_ACTIVE_MASK;
        expect(decode(mask, 0, &[], None, &stored), 0.5, 0.5, 0.5);
        expect(decode(mask, 1, &[], None, &stored), -0.5, -0.5, -0.5);
        expect(decode(mask, 2, &[2.0], None, &stored), 2.0, 2.0, 2.0);
        expect(decode(mask, 3, &[], Some(1), &stored), 0.5, -0.5, -0.5);
        expect(decode(mask, 4, &[2.0], Some(8), &stored), 2.0, 0.5, 2.0);
        expect(decode(mask, 5, &[2.0, 3.0], Some(8), &stored), 2.0, 3.0, 2.0);
        let mut all = [7.0; 64];
        (all[1], all[2]) = (5.0, 6.0);
        expect(decode(mask, 6, &[], None, &all), 7.0, 7.0, 7.0);
        // Without the flag all entries are stored, whatever the code.
        expect(decode(0, 0, &[], None, &all), 7.0, 7.0, 7.0);
        expect(decode(0, 2, &[2.0], None, &all), 7.0, 7.0, 7.0);
    }

    #[test]
    fn empty_payloads_are_framed_but_for_halves() {
        let length = |flags, half, bytes: &[u8]| {
            Layout { flags, half, background: 0.0_f32 }.measure(bytes, 64, 0).expect("a length")
        };
        let integers = Layout { flags: FLAG_ZIP | FLAG_ACTIVE_MASK, half: true, background: 0_i32 };
        let frame = [0; 9];
        for codec in [FLAG_ZIP, FLAG_BLOSC] {
            assert_eq!(length(codec | FLAG_ACTIVE_MASK, false, &frame), Length::Whole(9));
            assert_eq!(length(codec | FLAG_ACTIVE_MASK, true, &frame), Length::Whole(1));
        }
        assert_eq!(length(FLAG_ACTIVE_MASK, false, &frame), Length::Whole(1));
        assert_eq!(integers.measure(&frame, 64, 0), Ok(Length::Whole(9)));
    }

    #[test]
    fn sizes_beyond_reason_are_refused() {
        let layout = Layout { flags: FLAG_BLOSC | FLAG_ACTIVE_MASK, half: false, background: 0.0_f32 };
        for size in [i64::MAX, i64::MIN, 1 << 40, -1, 8000] {
            let block = [&[0][..], &size.to_le_bytes()].concat();
            assert!(layout.measure(&block, 64, 2).is_err(), "{size}");
        }
        assert!(layout.measure(&[7], 64, 2).is_err());
    }
}
