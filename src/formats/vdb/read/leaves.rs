//! Leaf buffers: read from front to back, because nothing but their own sizes tells where they are, and decoded on all
//! threads.

use std::io::{Read, Seek};

use rayon::prelude::*;

use super::block::{Layout, Length, Scratch};
use super::cursor::Cursor;
use super::error::{Fault, VdbReadError};
use super::value::Stored;
use crate::volume::Leaf;
use crate::volume::tree::{PAGE, Page};

/// Bytes that are read before they are decoded; what is decoded is then still in the processor's caches.
const BATCH: usize = 4 << 20;
const MASK: usize = 64;

/// How the buffers of a grid's leaves are stored.
pub(super) trait Buffers<T>: Sync {
    /// Bytes of the shortest buffer there can be.
    fn least(&self) -> usize;
    /// The length of the buffer that begins with `bytes`.
    fn measure(&self, bytes: &[u8], leaf: &Leaf) -> Result<Length, Fault>;
    /// The values in a buffer.
    fn decode(
        &self,
        bytes: &[u8],
        leaf: &Leaf,
        scratch: &mut Scratch<T>,
        out: &mut [T; 512],
    ) -> Result<(), Fault>;
}

impl<T: Stored> Buffers<T> for Layout<T> {
    fn least(&self) -> usize {
        MASK + Layout::least(self, 512)
    }

    fn measure(&self, bytes: &[u8], leaf: &Leaf) -> Result<Length, Fault> {
        let Some((_, block)) = bytes.split_at_checked(MASK) else { return Ok(Length::AtLeast(MASK + 1)) };
        let count = leaf.mask.iter().map(|word| word.count_ones() as usize).sum();
        Ok(match Layout::measure(self, block, 512, count)? {
            Length::Whole(length) => Length::Whole(MASK + length),
            Length::AtLeast(length) => Length::AtLeast(MASK + length),
        })
    }

    fn decode(
        &self,
        bytes: &[u8],
        leaf: &Leaf,
        scratch: &mut Scratch<T>,
        out: &mut [T; 512],
    ) -> Result<(), Fault> {
        let (mask, block) = bytes.split_at_checked(MASK).ok_or(Fault::Invalid("leaf"))?;
        check_mask(mask, leaf)?;
        Layout::decode(self, block, &leaf.mask, scratch, out)
    }
}

/// The layout of leaves of truth values: mask, origin, one bit a voxel.
pub(super) struct Bits;

impl Buffers<bool> for Bits {
    fn least(&self) -> usize {
        MASK + 12 + 64
    }

    fn measure(&self, _: &[u8], _: &Leaf) -> Result<Length, Fault> {
        Ok(Length::Whole(self.least()))
    }

    fn decode(
        &self,
        bytes: &[u8],
        leaf: &Leaf,
        _: &mut Scratch<bool>,
        out: &mut [bool; 512],
    ) -> Result<(), Fault> {
        let (mask, rest) = bytes.split_at_checked(MASK).ok_or(Fault::Invalid("leaf"))?;
        check_mask(mask, leaf)?;
        for (values, byte) in out.chunks_mut(8).zip(rest.iter().skip(12)) {
            for (bit, value) in values.iter_mut().enumerate() {
                *value = (byte >> bit) & 1 == 1;
            }
        }
        Ok(())
    }
}

fn check_mask(mask: &[u8], leaf: &Leaf) -> Result<(), Fault> {
    if mask == leaf.mask.map(u64::to_le_bytes).as_flattened() {
        Ok(())
    } else {
        Err(Fault::Invalid("leaf whose mask is not that of the topology"))
    }
}

/// Reads the values of all leaves.
pub(super) fn read<T: Stored, R: Read + Seek>(
    cursor: &mut Cursor<R>,
    buffers: &impl Buffers<T>,
    leaves: &[Leaf],
) -> Result<Vec<Page<T>>, VdbReadError> {
    let mut pages = vec![];
    walk(cursor, buffers, leaves, |batch| {
        let decoded: Result<Vec<Page<T>>, VdbReadError> = batch
            .leaves
            .par_chunks(PAGE)
            .zip(batch.ends.par_chunks(PAGE))
            .enumerate()
            .map_init(Scratch::default, |scratch, (number, (leaves, ends))| {
                let mut page = Vec::new();
                page.try_reserve_exact(leaves.len())
                    .map_err(|_| std::io::Error::from(std::io::ErrorKind::OutOfMemory))?;
                page.resize(leaves.len(), [T::ZERO; 512]);
                let before = (number * PAGE).checked_sub(1).and_then(|at| batch.ends.get(at));
                let mut start = before.copied().unwrap_or(0);
                for ((leaf, end), out) in leaves.iter().zip(ends).zip(&mut page) {
                    let bytes = batch.bytes.get(start..*end).unwrap_or_default();
                    let fault = |fault: Fault| fault.at(batch.offset + start as u64);
                    buffers.decode(bytes, leaf, scratch, out).map_err(fault)?;
                    start = *end;
                }
                Ok(page.into_boxed_slice())
            })
            .collect();
        pages.extend(decoded?);
        Ok(())
    })?;
    Ok(pages)
}

/// Moves behind the values of all leaves.
pub(super) fn skip<T: Stored, R: Read + Seek>(
    cursor: &mut Cursor<R>,
    buffers: &impl Buffers<T>,
    leaves: &[Leaf],
) -> Result<(), VdbReadError> {
    walk(cursor, buffers, leaves, |_| Ok(()))
}

/// Buffers that were read together: leaves of whole pages, except at the end.
struct Batch<'a> {
    leaves: &'a [Leaf],
    /// Where in `bytes` each leaf's buffer ends, and the next begins.
    ends: &'a [usize],
    bytes: &'a [u8],
    /// Where in the file `bytes` begin.
    offset: u64,
}

fn walk<T: Stored, R: Read + Seek>(
    cursor: &mut Cursor<R>,
    buffers: &impl Buffers<T>,
    leaves: &[Leaf],
    mut each: impl FnMut(Batch<'_>) -> Result<(), VdbReadError>,
) -> Result<(), VdbReadError> {
    cursor.require_all(leaves.len(), buffers.least())?;
    let start = cursor.position();
    let (mut bytes, mut ends) = (vec![], vec![]);
    let mut rest = leaves;
    while !rest.is_empty() {
        let offset = cursor.position() - bytes.len() as u64;
        let room = BATCH.saturating_sub(bytes.len()) as u64;
        let more = usize::try_from(room.min(cursor.remaining())).unwrap_or(BATCH);
        cursor.append(more, &mut bytes)?;
        ends.clear();
        let mut end = 0;
        let mut missing = 0;
        for leaf in rest {
            let buffer = bytes.get(end..).unwrap_or_default();
            let fault = |fault: Fault| fault.at(offset + end as u64);
            match buffers.measure(buffer, leaf).map_err(fault)? {
                Length::Whole(length) if length <= buffer.len() => {
                    end += length;
                    ends.push(end);
                }
                Length::Whole(length) | Length::AtLeast(length) => {
                    missing = length.saturating_sub(buffer.len());
                    break;
                }
            }
        }
        let whole = if ends.len() == rest.len() { ends.len() } else { ends.len() / PAGE * PAGE };
        if whole == 0 {
            // A batch has room for a page of the longest buffers that are not refused: the grid ends here.
            return Err(VdbReadError::Truncated { offset: cursor.position(), length: missing as u64 });
        }
        let (now, later) = rest.split_at(whole);
        ends.truncate(whole);
        each(Batch { leaves: now, ends: &ends, bytes: &bytes, offset })?;
        bytes.drain(..ends.last().copied().unwrap_or(0));
        rest = later;
    }
    // What was read beyond the last leaf belongs to others.
    let behind = cursor.position() - bytes.len() as u64;
    cursor.back_to(behind.max(start))
}
