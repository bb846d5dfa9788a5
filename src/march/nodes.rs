//! Where a medium's bricks are: cubes of 16^3 of them, and which of these each holds.

/// Bricks along an edge of a node, and the binary logarithm of that.
pub(super) const NODE: i32 = 16;
const LOG2: i32 = 4;
/// Bits of a node's mask, one for each of its bricks, in words.
const WORDS: usize = 64;
/// A box of no more nodes than this has a table with an entry for each.
const MOST_DENSE: i64 = 1 << 18;
/// What a table holds where there is no node.
const NONE: u32 = u32::MAX;

/// Bricks by their place.
#[derive(Debug, Clone, Default)]
pub(super) struct Nodes {
    /// Lowest and highest coordinates of nodes, in units of their edges; `None` where there are no bricks.
    bounds: Option<[[i32; 3]; 2]>,
    /// Numbers of the nodes of the whole box, the last coordinate fastest; empty where the box is too large for that.
    table: Vec<u32>,
    /// In the order of their coordinates.
    nodes: Vec<Node>,
    /// Numbers of all bricks, node by node.
    order: Vec<u32>,
}

#[derive(Debug, Clone)]
struct Node {
    at: [i32; 3],
    /// A bit for each brick that there is, the last coordinate fastest.
    mask: [u64; WORDS],
    /// Where in `order` each word's bricks begin.
    first: [u32; WORDS],
}

impl Nodes {
    /// Bytes that they take, in lists that grow by doubling.
    pub(super) fn memory(&self) -> usize {
        size_of_val(self.table.as_slice())
            + self.nodes.capacity() * size_of::<Node>()
            + size_of_val(self.order.as_slice())
    }

    /// Of bricks, none of them twice.
    pub(super) fn new(blocks: &[[i32; 3]]) -> Nodes {
        let node_of = |block: [i32; 3]| block.map(|c| c >> LOG2);
        let mut order: Vec<u32> = (0..).take(blocks.len()).collect();
        let key = |number: &u32| {
            let block = blocks[*number as usize];
            (node_of(block), place(block))
        };
        order.sort_unstable_by_key(key);
        let mut nodes: Vec<Node> = Vec::new();
        let mut bounds: Option<[[i32; 3]; 2]> = None;
        for (rank, number) in (0_u32..).zip(&order) {
            let block = blocks[*number as usize];
            let at = node_of(block);
            if nodes.last().is_none_or(|node| node.at != at) {
                nodes.push(Node { at, mask: [0; WORDS], first: [0; WORDS] });
                let [low, high] = bounds.get_or_insert([at; 2]);
                for axis in 0..3 {
                    low[axis] = low[axis].min(at[axis]);
                    high[axis] = high[axis].max(at[axis]);
                }
            }
            if let Some(node) = nodes.last_mut() {
                let place = place(block);
                let word = place / 64;
                if node.mask[word] == 0 {
                    node.first[word] = rank;
                }
                node.mask[word] |= 1 << (place % 64);
            }
        }
        let mut made = Nodes { bounds, table: Vec::new(), nodes, order };
        let size = made.size();
        if let Some(count) = size.filter(|count| *count <= MOST_DENSE) {
            made.table = vec![NONE; usize::try_from(count).unwrap_or(0)];
            for (number, node) in (0_u32..).zip(&made.nodes) {
                if let Some(entry) = entry(made.bounds, node.at) {
                    made.table[entry] = number;
                }
            }
        }
        made
    }

    /// Nodes of the whole box.
    fn size(&self) -> Option<i64> {
        let [low, high] = self.bounds?;
        let edge = |axis: usize| i64::from(high[axis]) - i64::from(low[axis]) + 1;
        edge(0).checked_mul(edge(1))?.checked_mul(edge(2))
    }

    /// Lowest and highest coordinates of nodes, in units of their edges.
    pub(super) fn bounds(&self) -> Option<[[i32; 3]; 2]> {
        self.bounds
    }

    /// The node at a place, by its number.
    pub(super) fn node(&self, at: [i32; 3]) -> Option<usize> {
        if self.table.is_empty() {
            return self.nodes.binary_search_by_key(&at, |node| node.at).ok();
        }
        let number = self.table[entry(self.bounds, at)?];
        (number != NONE).then_some(number as usize)
    }

    /// The brick at a place of a node, by its number; places are counted from the world's origin.
    pub(super) fn brick(&self, node: usize, block: [i32; 3]) -> Option<usize> {
        let node = &self.nodes[node];
        let place = place(block);
        let (word, bit) = (place / 64, place % 64);
        let mask = node.mask[word];
        if mask >> bit & 1 == 0 {
            return None;
        }
        let before = (mask & ((1 << bit) - 1)).count_ones();
        Some(self.order[(node.first[word] + before) as usize] as usize)
    }

    /// The brick at a place, by its number.
    pub(super) fn find(&self, block: [i32; 3]) -> Option<usize> {
        self.brick(self.node(block.map(|c| c >> LOG2))?, block)
    }
}

/// Of a brick in its node.
fn place(block: [i32; 3]) -> usize {
    let part = |axis: usize| (block[axis] & (NODE - 1)).unsigned_abs() as usize;
    (part(0) * 16 + part(1)) * 16 + part(2)
}

/// Of a node in the table of its box.
fn entry(bounds: Option<[[i32; 3]; 2]>, at: [i32; 3]) -> Option<usize> {
    let [low, high] = bounds?;
    let mut entry = 0_usize;
    for axis in 0..3 {
        if at[axis] < low[axis] || at[axis] > high[axis] {
            return None;
        }
        let edge = high[axis].abs_diff(low[axis]) as usize + 1;
        entry = entry * edge + at[axis].abs_diff(low[axis]) as usize;
    }
    Some(entry)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_brick_is_found_and_no_other() {
        // Close together, and so far apart that there is no table.
        for spread in [1, 40_000] {
            let mut state = 7_u32;
            let mut coordinate = || {
                state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                let near = i32::try_from(state >> 27).unwrap_or(0) - 16;
                let far = i32::try_from(state >> 24 & 3).unwrap_or(0) - 2;
                near + far * 16 * spread
            };
            let mut blocks: Vec<[i32; 3]> =
                (0..3000).map(|_| [coordinate(), coordinate(), coordinate()]).collect();
            blocks.sort_unstable();
            blocks.dedup();
            blocks.reverse();
            let nodes = Nodes::new(&blocks);
            assert_eq!(nodes.table.is_empty(), spread > 1);
            let mut others = 0;
            for (number, block) in blocks.iter().enumerate() {
                assert_eq!(nodes.find(*block), Some(number));
                for axis in 0..3 {
                    let mut beside = *block;
                    beside[axis] += 1;
                    let expected = blocks.iter().position(|other| *other == beside);
                    assert_eq!(nodes.find(beside), expected);
                    others += usize::from(expected.is_none());
                }
            }
            assert!(others > 1000);
        }
        assert_eq!(Nodes::new(&[]).find([0; 3]), None);
    }
}
