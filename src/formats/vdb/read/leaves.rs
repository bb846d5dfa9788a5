//! Leaf buffers: read from front to back, because nothing but their own sizes tells where they are, and decoded on all
//! threads. Where all have one size, those that are not asked for are jumped over. Others are read, to find the next, but
//! not decoded: they are mostly smaller than what a disk gives at once, so to jump from each to the next would be slower.

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
/// Stands for a leaf that was not read; no tree has so many.
pub(super) const ABSENT: u32 = u32::MAX;

/// How the buffers of a grid's leaves are stored.
pub(super) trait Buffers<T>: Sync {
    /// Bytes of the shortest buffer there can be.
    fn least(&self) -> usize;
    /// The length of every buffer, where all are equally long.
    fn fixed(&self) -> Option<usize>;
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
        MASK.saturating_add(Layout::least(self, 512))
    }

    fn fixed(&self) -> Option<usize> {
        self.is_plain().then(|| Buffers::least(self))
    }

    fn measure(&self, bytes: &[u8], leaf: &Leaf) -> Result<Length, Fault> {
        let Some((_, block)) = bytes.split_at_checked(MASK) else { return Ok(Length::AtLeast(MASK + 1)) };
        let count = leaf.mask.iter().map(|word| word.count_ones() as usize).sum();
        Ok(match Layout::measure(self, block, 512, count)? {
            Length::Whole(length) => Length::Whole(MASK.saturating_add(length)),
            Length::AtLeast(length) => Length::AtLeast(MASK.saturating_add(length)),
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

    fn fixed(&self) -> Option<usize> {
        Some(self.least())
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
    walk(cursor, buffers, leaves, BATCH, |batch| {
        let all: Vec<usize> = (0..batch.leaves.len()).collect();
        pages.extend(decode(buffers, &batch, &all)?);
        Ok(())
    })?;
    Ok(pages)
}

/// The values of some leaves, and for each leaf where in the pages they are.
pub(super) type Selected<T> = (Vec<Page<T>>, Vec<u32>);

/// Reads the values of those leaves that are `taken`.
pub(super) fn read_some<T: Stored, R: Read + Seek>(
    cursor: &mut Cursor<R>,
    buffers: &impl Buffers<T>,
    leaves: &[Leaf],
    taken: &[bool],
) -> Result<Selected<T>, VdbReadError> {
    let (mut pages, mut slots) = (vec![], vec![]);
    let bytes = |count: usize, size: usize| (count as u64).saturating_mul(size as u64);
    let fixed = buffers.fixed().filter(|size| bytes(leaves.len(), *size) == cursor.remaining());
    // Runs of leaves that are all read, those that are not taken among them only where it takes reading to pass them.
    let runs: Vec<(usize, usize)> = if fixed.is_some() {
        let mut next = 0_usize;
        let chunks = taken.chunk_by(|a, b| a == b).map(|run| {
            let first = next;
            next = first.saturating_add(run.len());
            (first, next)
        });
        chunks.filter(|(start, _)| taken.get(*start) == Some(&true)).collect()
    } else {
        taken.iter().rposition(|taken| *taken).map(|last| (0, last.saturating_add(1))).into_iter().collect()
    };
    let start = cursor.position();
    let whole = cursor.end();
    for (first, end) in runs {
        if let Some(size) = fixed {
            cursor.skip(start.saturating_add(bytes(first, size)).saturating_sub(cursor.position()))?;
            cursor.set_end(start.saturating_add(bytes(end, size)));
        }
        slots.resize(first, ABSENT);
        let run = leaves.get(first..end).unwrap_or_default();
        let done = walk(cursor, buffers, run, BATCH, |batch| {
            let taken = taken.get(slots.len()..).unwrap_or_default();
            let mut next = pages.len().saturating_mul(PAGE);
            let here: Vec<usize> =
                (0..batch.leaves.len()).filter(|at| taken.get(*at) == Some(&true)).collect();
            slots.extend(taken.iter().take(batch.leaves.len()).map(|taken| {
                let slot = if *taken { u32::try_from(next).unwrap_or(ABSENT) } else { ABSENT };
                next = next.saturating_add(usize::from(*taken));
                slot
            }));
            pages.extend(decode(buffers, &batch, &here)?);
            Ok(())
        });
        cursor.set_end(whole);
        done?;
    }
    slots.resize(leaves.len(), ABSENT);
    Ok((pages, slots))
}

/// Decodes leaves of a batch, by their numbers in it.
fn decode<T: Stored>(
    buffers: &impl Buffers<T>,
    batch: &Batch<'_>,
    leaves: &[usize],
) -> Result<Vec<Page<T>>, VdbReadError> {
    leaves
        .par_chunks(PAGE)
        .map_init(Scratch::default, |scratch, leaves| {
            let mut page = Vec::new();
            page.try_reserve_exact(leaves.len())
                .map_err(|_| std::io::Error::from(std::io::ErrorKind::OutOfMemory))?;
            page.resize(leaves.len(), [T::ZERO; 512]);
            for (number, out) in leaves.iter().zip(&mut page) {
                let Some((leaf, bytes, offset)) = batch.leaf(*number) else { continue };
                buffers.decode(bytes, leaf, scratch, out).map_err(|fault| fault.at(offset))?;
            }
            Ok(page.into_boxed_slice())
        })
        .collect()
}

/// Moves behind the values of all leaves.
pub(super) fn skip<T: Stored, R: Read + Seek>(
    cursor: &mut Cursor<R>,
    buffers: &impl Buffers<T>,
    leaves: &[Leaf],
) -> Result<(), VdbReadError> {
    walk(cursor, buffers, leaves, BATCH, |_| Ok(()))
}

/// Where in the file the buffers of every [`PAGE`] leaves begin, and where the last of them ends. Reads `batch` bytes at once.
pub(super) fn places<T: Stored, R: Read + Seek>(
    cursor: &mut Cursor<R>,
    buffers: &impl Buffers<T>,
    leaves: &[Leaf],
    batch: usize,
) -> Result<Vec<u64>, VdbReadError> {
    let mut places = vec![cursor.position()];
    walk(cursor, buffers, leaves, batch, |batch| {
        let ends = batch.ends.chunks(PAGE).filter_map(<[usize]>::last);
        places.extend(ends.map(|end| batch.offset.saturating_add(*end as u64)));
        Ok(())
    })?;
    Ok(places)
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

impl<'a> Batch<'a> {
    /// A leaf, its bytes, and where they begin in the file.
    fn leaf(&self, number: usize) -> Option<(&'a Leaf, &'a [u8], u64)> {
        let start = match number.checked_sub(1) {
            Some(before) => *self.ends.get(before)?,
            None => 0,
        };
        let bytes = self.bytes.get(start..*self.ends.get(number)?)?;
        Some((self.leaves.get(number)?, bytes, self.offset.saturating_add(start as u64)))
    }
}

/// Reads buffers up to `batch` bytes at once, which must be more than those of a page may take.
fn walk<T: Stored, R: Read + Seek>(
    cursor: &mut Cursor<R>,
    buffers: &impl Buffers<T>,
    leaves: &[Leaf],
    batch: usize,
    mut each: impl FnMut(Batch<'_>) -> Result<(), VdbReadError>,
) -> Result<(), VdbReadError> {
    cursor.require_all(leaves.len(), buffers.least())?;
    let start = cursor.position();
    let (mut bytes, mut ends) = (vec![], vec![]);
    let mut rest = leaves;
    while !rest.is_empty() {
        let offset = cursor.position().saturating_sub(bytes.len() as u64);
        let room = batch.saturating_sub(bytes.len()) as u64;
        let more = usize::try_from(room.min(cursor.remaining())).unwrap_or(batch);
        cursor.append(more, &mut bytes)?;
        ends.clear();
        let mut end = 0_usize;
        let mut missing = 0;
        for leaf in rest {
            let buffer = bytes.get(end..).unwrap_or_default();
            let fault = |fault: Fault| fault.at(offset.saturating_add(end as u64));
            match buffers.measure(buffer, leaf).map_err(fault)? {
                Length::Whole(length) if length <= buffer.len() => {
                    end = end.saturating_add(length);
                    ends.push(end);
                }
                Length::Whole(length) | Length::AtLeast(length) => {
                    missing = length.saturating_sub(buffer.len());
                    break;
                }
            }
        }
        let whole = if ends.len() == rest.len() {
            ends.len()
        } else {
            ends.as_chunks::<PAGE>().0.as_flattened().len()
        };
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
    let behind = cursor.position().saturating_sub(bytes.len() as u64);
    if bytes.is_empty() { Ok(()) } else { cursor.back_to(behind.max(start)) }
}
