//! Grids whose leaves are read as they are asked for, each time within the same memory.

use std::io::{Read, Seek};

use rayon::prelude::*;

use super::VdbFile;
use super::block::{Layout, Length, Scratch};
use super::cursor::Cursor;
use super::error::{Fault, VdbReadError, no_memory};
use super::leaves::{ABSENT, Buffers, places};
use super::topology::{self, Allowance};
use crate::volume::Tree;
use crate::volume::tree::PAGE;

/// Bytes that are read before they are decoded.
const BATCH: usize = 1 << 20;

/// A grid of single precision of which some leaves' values are in memory, those that were asked for last.
///
/// Its tree's nodes and tiles are all there, and where its leaves are. To sample it where a leaf is not in memory gives the
/// background's value.
pub struct PagedGrid<R> {
    cursor: Cursor<R>,
    layout: Layout<f32>,
    tree: Tree<f32>,
    /// Where in the file the leaves 0, `PAGE`, 2 `PAGE` and so on begin, and where the last ends.
    starts: Vec<u64>,
    /// Leaves that are in memory.
    held: Vec<usize>,
}

impl<R: Read + Seek> VdbFile<R> {
    /// The first grid of this name, which must be of single precision, without its leaves' values: these are found, but none is
    /// decoded. What [`PagedGrid::hold`] takes, and a MiB to read in, comes to the memory limit.
    ///
    /// # Errors
    /// As [`VdbFile::grid`].
    pub fn paged(mut self, name: &str) -> Result<PagedGrid<R>, VdbReadError> {
        let number = self.number(name)?;
        let (info, record) = self.seek(number)?;
        if info.type_name != "Tree_float_5_4_3" {
            let (grid, type_name) = (info.name, info.type_name);
            return Err(VdbReadError::Type { grid, type_name });
        }
        let allowance = Allowance { grid: &info.name, limit: self.memory_limit };
        let (mut tree, layout): (Tree<f32>, Layout<f32>) =
            topology::read(&mut self.cursor, record.flags, record.half, allowance, 0)?;
        let slots = tree.leaf_count().saturating_mul(size_of::<u32>()) as u64;
        allowance.check(tree.memory_bytes_with(0).saturating_add(slots))?;
        let starts = places(&mut self.cursor, &layout, &tree.leaves, BATCH)?;
        let mut absent = Vec::new();
        absent.try_reserve_exact(tree.leaf_count()).map_err(|_| no_memory())?;
        absent.resize(tree.leaf_count(), ABSENT);
        tree.slots = Some(absent);
        Ok(PagedGrid { cursor: self.cursor, layout, tree, starts, held: vec![] })
    }
}

impl<R: Read + Seek> PagedGrid<R> {
    /// The tree, with the leaves that were asked for last.
    pub fn tree(&self) -> &Tree<f32> {
        &self.tree
    }

    /// Bytes of memory without any leaf's values.
    pub fn memory(&self) -> u64 {
        let slots = self.tree.leaf_count().saturating_mul(size_of::<u32>());
        self.tree.memory_bytes_with(0).saturating_add(slots.saturating_add(size_of_val(&*self.starts)) as u64)
    }

    /// Reads leaves, by their numbers in rising order, in place of those that are in memory; decoded on the current `rayon`
    /// pool. Memory that was taken for leaves once is kept.
    ///
    /// # Errors
    /// See [`VdbReadError`]. The tree has no leaves then.
    pub fn hold(&mut self, leaves: &[usize]) -> Result<(), VdbReadError> {
        let slots = self.tree.slots.get_or_insert_default();
        for leaf in self.held.drain(..) {
            if let Some(slot) = slots.get_mut(leaf) {
                *slot = ABSENT;
            }
        }
        while self.tree.pages.len().saturating_mul(PAGE) < leaves.len() {
            // All of it is taken on one thread, which is of use to it again, as allocators have it.
            let mut page = Vec::new();
            page.try_reserve_exact(PAGE).map_err(|_| no_memory())?;
            page.resize(PAGE, [0.0; 512]);
            self.tree.pages.push(page.into_boxed_slice());
        }
        self.read(leaves)?;
        let slots = self.tree.slots.get_or_insert_default();
        for (place, leaf) in leaves.iter().enumerate() {
            if let Some(slot) = slots.get_mut(*leaf) {
                *slot = u32::try_from(place).unwrap_or(ABSENT);
            }
        }
        self.held.extend_from_slice(leaves);
        Ok(())
    }

    /// Reads leaves into the first places of the pages.
    fn read(&mut self, leaves: &[usize]) -> Result<(), VdbReadError> {
        let mut places = self.tree.pages.iter_mut().flat_map(|page| page.iter_mut());
        let mut bytes = Vec::with_capacity(BATCH);
        let mut wanted = vec![];
        let mut rest = leaves.chunk_by(|a, b| a / PAGE == b / PAGE).peekable();
        while let Some(of_page) = rest.next() {
            let Some(page) = of_page.first().map(|leaf| leaf / PAGE) else { continue };
            let (Some(from), Some(to)) = (self.starts.get(page), self.starts.get(page.saturating_add(1)))
            else {
                continue;
            };
            let (mut at, length) = (bytes.len(), to.saturating_sub(*from));
            if self.cursor.position() != *from {
                self.cursor.back_to(*from)?;
            }
            let length = usize::try_from(length).map_err(|_| self.cursor.invalid("length"))?;
            self.cursor.append(length, &mut bytes)?;
            // Nothing but their own sizes tells where leaves are.
            let mut next = of_page.iter().peekable();
            let first = page.saturating_mul(PAGE);
            for number in first..first.saturating_add(PAGE) {
                let (Some(leaf), Some(asked)) = (self.tree.leaves.get(number), next.peek()) else { break };
                let offset = from.saturating_add(at as u64);
                let buffer = bytes.get(at..).unwrap_or_default();
                let length =
                    Buffers::measure(&self.layout, buffer, leaf).map_err(|fault| fault.at(offset))?;
                let Length::Whole(length) = length else {
                    return Err(Fault::Invalid("leaf").at(offset));
                };
                let end = at.saturating_add(length);
                if **asked == number {
                    next.next();
                    if let Some(place) = places.next() {
                        wanted.push((leaf, at..end, offset, place));
                    }
                }
                at = end;
            }
            if bytes.len() < BATCH && rest.peek().is_some() {
                continue;
            }
            let layout = &self.layout;
            wanted.par_iter_mut().try_for_each_init(
                Scratch::default,
                |scratch, (leaf, range, offset, place)| {
                    let buffer = bytes.get(range.clone()).unwrap_or_default();
                    Buffers::decode(layout, buffer, leaf, scratch, place).map_err(|fault| fault.at(*offset))
                },
            )?;
            wanted.clear();
            bytes.clear();
        }
        Ok(())
    }
}
