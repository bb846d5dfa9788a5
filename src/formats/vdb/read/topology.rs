//! The topology stream: root, inner nodes and masks of leaves, in depth-first order.

use std::io::{Read, Seek};

use super::block::{Layout, Length, Scratch};
use super::cursor::Cursor;
use super::error::{VdbReadError, no_memory};
use super::value::Stored;
use crate::volume::node::Node;
use crate::volume::shape::{LOG2_EDGE, align};
use crate::volume::tree::{RootTile, child_origin};
use crate::volume::{Leaf, Tree};

/// The bytes of memory that a grid may take.
#[derive(Debug, Clone, Copy)]
pub(super) struct Allowance<'a> {
    pub(super) grid: &'a str,
    pub(super) limit: u64,
}

impl Allowance<'_> {
    pub(super) fn check(self, needed: u64) -> Result<(), VdbReadError> {
        let Self { grid, limit } = self;
        if needed > limit {
            return Err(VdbReadError::Memory { grid: grid.to_owned(), needed, limit });
        }
        Ok(())
    }
}

/// Reads a tree without its leaves' values, and how those are stored. Compressed nodes may take a hundred times as many
/// bytes in memory as in the file, so what they take is checked after each of them. From where they take too many on, none is
/// kept, and all are counted, so that the error can tell what is enough: with the values of so many `leaves`, if there are.
pub(super) fn read<T: Stored, R: Read + Seek>(
    cursor: &mut Cursor<R>,
    flags: u32,
    half: bool,
    allowance: Allowance<'_>,
    leaves: usize,
) -> Result<(Tree<T>, Layout<T>), VdbReadError> {
    if cursor.number(i32::from_le_bytes)? != 1 {
        return Err(cursor.invalid("number of buffers"));
    }
    let background = value(cursor)?;
    let layout = Layout { flags, half, background };
    let [tiles, children] = [(); 2].map(|()| cursor.number(u32::from_le_bytes));
    let (tiles, children) = (tiles?, children?);
    let root_tiles = vec![];
    let mut tree = Tree {
        background,
        root_tiles,
        uppers: vec![],
        lowers: vec![],
        leaves: vec![],
        pages: vec![],
        slots: None,
    };
    for _ in 0..tiles {
        let origin = root_origin(cursor)?;
        let tile = RootTile { origin, value: value(cursor)?, active: cursor.number(u8::from_le_bytes)? != 0 };
        room(&mut tree.root_tiles, 1)?.push(tile);
    }
    let mut reader = Reader { cursor, layout, scratch: Scratch::default(), block: vec![], values: vec![] };
    let (mut taken, mut count, mut has_room) = (0_u64, 0_usize, true);
    for _ in 0..children {
        let origin = root_origin(reader.cursor)?;
        let upper = reader.node(origin, 32768, tree.lowers.len())?;
        taken = taken.saturating_add(upper.memory_bytes());
        for at in upper.children.ones() {
            let lower = reader.node(child_origin(origin, at, 2), 4096, tree.leaves.len())?;
            let leaves = lower.children.count();
            reader.cursor.require_all(leaves, 64)?;
            let list = leaves.saturating_mul(size_of::<Leaf>()) as u64;
            taken = taken.saturating_add(lower.memory_bytes()).saturating_add(list);
            count = count.saturating_add(leaves);
            if taken > allowance.limit {
                has_room = false;
                (tree.uppers, tree.lowers, tree.leaves) = (vec![], vec![], vec![]);
            }
            if !has_room {
                reader.cursor.skip(leaves.saturating_mul(64) as u64)?;
                continue;
            }
            room(&mut tree.leaves, leaves)?;
            for at in lower.children.ones() {
                let mut mask = [0; 8];
                reader.cursor.mask(&mut mask)?;
                tree.leaves.push(Leaf { origin: child_origin(lower.origin, at, 1), mask });
            }
            room(&mut tree.lowers, 1)?.push(lower);
        }
        if has_room {
            room(&mut tree.uppers, 1)?.push(upper);
        }
    }
    let slots = if leaves < count { size_of::<u32>().saturating_mul(count) } else { 0 };
    let values = size_of::<[T; 512]>().saturating_mul(leaves.min(count)).saturating_add(slots);
    if !has_room || taken > allowance.limit {
        return allowance.check(taken.saturating_add(values as u64)).and(Err(no_memory()));
    }
    sort(&mut tree);
    let single = tree.uppers.is_sorted_by(|a, b| a.origin < b.origin)
        && tree.root_tiles.is_sorted_by(|a, b| a.origin < b.origin);
    if !single {
        return Err(cursor.invalid("entry of the root that is there twice"));
    }
    Ok((tree, layout))
}

/// The list, with room for more.
fn room<T>(list: &mut Vec<T>, more: usize) -> Result<&mut Vec<T>, VdbReadError> {
    list.try_reserve(more).map_err(|_| no_memory())?;
    Ok(list)
}

struct Reader<'a, T, R> {
    cursor: &'a mut Cursor<R>,
    layout: Layout<T>,
    scratch: Scratch<T>,
    block: Vec<u8>,
    values: Vec<T>,
}

impl<T: Stored, R: Read + Seek> Reader<'_, T, R> {
    fn node(
        &mut self,
        origin: [i32; 3],
        entries: usize,
        first_child: usize,
    ) -> Result<Node<T>, VdbReadError> {
        let [mut children, mut active] = [vec![0; entries / 64], vec![0; entries / 64]];
        self.cursor.mask(&mut children)?;
        self.cursor.mask(&mut active)?;
        let count = active.iter().map(|word| word.count_ones() as usize).sum();

        let start = self.cursor.position();
        self.block.clear();
        loop {
            let length = self.layout.measure(&self.block, entries, count);
            let (Length::Whole(length) | Length::AtLeast(length)) =
                length.map_err(|fault| fault.at(start))?;
            let Some(missing) = length.checked_sub(self.block.len()).filter(|missing| *missing > 0) else {
                break;
            };
            self.cursor.append(missing, &mut self.block)?;
        }
        self.values.resize(entries, self.layout.background);
        self.layout
            .decode(&self.block, &active, &mut self.scratch, &mut self.values)
            .map_err(|fault| fault.at(start))?;
        Ok(Node::new(origin, children, first_child, active, &self.values))
    }
}

fn value<T: Stored, R: Read + Seek>(cursor: &mut Cursor<R>) -> Result<T, VdbReadError> {
    let mut bytes = vec![];
    cursor.append(T::SIZE, &mut bytes)?;
    let mut value = [T::ZERO];
    T::decode(&bytes, &mut value);
    Ok(value[0])
}

fn root_origin<R: Read + Seek>(cursor: &mut Cursor<R>) -> Result<[i32; 3], VdbReadError> {
    let origin = cursor.index()?;
    if align(origin, LOG2_EDGE[2]) != origin {
        return Err(cursor.invalid("entry of the root between its places"));
    }
    Ok(origin)
}

/// Sorts the root's entries. Leaf buffers follow in the sorted order, whatever that of the topology was.
fn sort<T: Stored>(tree: &mut Tree<T>) {
    tree.root_tiles.sort_by_key(|tile| tile.origin);
    if tree.uppers.is_sorted_by_key(|upper| upper.origin) {
        return;
    }
    tree.uppers.sort_by_key(|upper| upper.origin);
    let (old_lowers, old_leaves) = (std::mem::take(&mut tree.lowers), std::mem::take(&mut tree.leaves));
    // Nodes are moved, not copied: twice their memory may be more than is allowed.
    let mut old_lowers: Vec<Option<Node<T>>> = old_lowers.into_iter().map(Some).collect();
    for upper in &mut tree.uppers {
        let lowers = old_lowers.iter_mut().skip(upper.first_child).take(upper.children.count());
        upper.first_child = tree.lowers.len();
        for mut lower in lowers.filter_map(Option::take) {
            let leaves = old_leaves.iter().skip(lower.first_child).take(lower.children.count());
            lower.first_child = tree.leaves.len();
            tree.leaves.extend(leaves);
            tree.lowers.push(lower);
        }
    }
}
