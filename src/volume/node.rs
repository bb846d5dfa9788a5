//! Inner nodes of a tree, kept about as small as their contents.

use super::value::Value;

/// An upper or lower node: 32^3 or 16^3 entries, each a child or a tile.
#[derive(Debug, Clone)]
pub(crate) struct Node<T> {
    pub(crate) origin: [i32; 3],
    pub(crate) children: Ranked,
    /// Number of the first child; the others follow it.
    pub(crate) first_child: usize,
    /// Tiles with values of their own: those that are active, or differ from `rest`.
    own: Ranked,
    values: Box<[T]>,
    active: Box<[u64]>,
    /// The value of all other tiles, which are inactive.
    rest: T,
}

/// What is at an entry of a node.
pub(crate) enum Entry<T> {
    /// The child of this number.
    Child(usize),
    /// A value, and whether it is active.
    Tile(T, bool),
}

impl<T: Value> Node<T> {
    /// A node all of whose tiles are inactive and have this value.
    pub(crate) fn uniform(origin: [i32; 3], children: Vec<u64>, first_child: usize, rest: T) -> Self {
        let children = Ranked::new(children);
        Self {
            origin,
            children,
            first_child,
            own: Ranked::new(vec![]),
            values: [].into(),
            active: [].into(),
            rest,
        }
    }

    /// A node from one value for each entry; those at children mean nothing.
    pub(crate) fn new(
        origin: [i32; 3],
        children: Vec<u64>,
        first_child: usize,
        mut active: Vec<u64>,
        values: &[T],
    ) -> Self {
        for (active, children) in active.iter_mut().zip(&children) {
            *active &= !children;
        }
        // Most inactive tiles are alike: the first is a good guess at what they are.
        let inactive = active.iter().zip(&children).enumerate().find_map(|(at, (active, children))| {
            let bit = (!(active | children)).trailing_zeros() as usize;
            (bit < 64).then(|| values.get(64 * at + bit)).flatten()
        });
        let rest = inactive.copied().unwrap_or(T::ZERO);
        let mut own = active.clone();
        let mut kept = vec![];
        for (((own, children), values), active) in
            own.iter_mut().zip(&children).zip(values.chunks(64)).zip(&active)
        {
            for (bit, value) in values.iter().enumerate() {
                if (children >> bit) & 1 == 0 && ((active >> bit) & 1 == 1 || !value.same(rest)) {
                    *own |= 1 << bit;
                    kept.push(*value);
                }
            }
        }
        let mut node = Self::uniform(origin, children, first_child, rest);
        if !kept.is_empty() {
            (node.own, node.values, node.active) = (Ranked::new(own), kept.into(), active.into());
        }
        node
    }

    pub(crate) fn entry(&self, at: usize) -> Entry<T> {
        if let Some(rank) = self.children.rank(at) {
            return Entry::Child(self.first_child + rank);
        }
        let own = self.own.rank(at).and_then(|rank| self.values.get(rank));
        own.map_or(Entry::Tile(self.rest, false), |value| Entry::Tile(*value, is_on(&self.active, at)))
    }

    pub(crate) fn memory_bytes(&self) -> u64 {
        let masks = self.children.words.len() + self.own.words.len();
        (size_of::<Self>() + masks * 10 + self.active.len() * 8 + size_of_val(&*self.values)) as u64
    }

    /// Tiles with values of their own: place, value, and whether they are active.
    pub(crate) fn tiles(&self) -> impl Iterator<Item = (usize, T, bool)> {
        self.own.ones().zip(&self.values).map(|(at, value)| (at, *value, is_on(&self.active, at)))
    }
}

fn is_on(mask: &[u64], at: usize) -> bool {
    mask.get(at / 64).is_some_and(|word| (word >> (at % 64)) & 1 == 1)
}

/// A mask that knows how many bits are set before each word.
#[derive(Debug, Clone)]
pub(crate) struct Ranked {
    words: Box<[u64]>,
    before: Box<[u16]>,
}

impl Ranked {
    fn new(words: Vec<u64>) -> Self {
        let before = words
            .iter()
            .scan(0_u16, |count, word| {
                let before = *count;
                // At most 32768 bits in all.
                *count = count.wrapping_add(u16::try_from(word.count_ones()).unwrap_or(0));
                Some(before)
            })
            .collect();
        Self { words: words.into(), before }
    }

    /// How many bits are set before this one, if it is set.
    fn rank(&self, at: usize) -> Option<usize> {
        let word = self.words.get(at / 64)?;
        if (word >> (at % 64)) & 1 == 0 {
            return None;
        }
        let below = word & ((1 << (at % 64)) - 1);
        Some(usize::from(*self.before.get(at / 64)?) + below.count_ones() as usize)
    }

    /// The places of set bits, ascending.
    pub(crate) fn ones(&self) -> impl Iterator<Item = usize> {
        self.words.iter().enumerate().flat_map(|(at, word)| {
            let mut bits = *word;
            std::iter::from_fn(move || {
                let bit = bits.trailing_zeros() as usize;
                bits &= bits.checked_sub(1)?;
                Some(64 * at + bit)
            })
        })
    }

    pub(crate) fn count(&self) -> usize {
        self.words.iter().map(|word| word.count_ones() as usize).sum()
    }
}
