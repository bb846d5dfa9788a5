//! Which bricks can hold density, found before any memory for values is taken.

use std::collections::BTreeSet;
use std::sync::Arc;

use rayon::prelude::*;
use thiserror::Error;

use crate::field::{Candidate, Capsule, Extent, Field, Lattice, Region};
use crate::num::Scalar;

/// A brick that can hold density.
#[derive(Debug, Clone, Copy)]
struct Planned {
    /// Its coordinates in bricks.
    block: [i32; 3],
    /// Its first candidate in `Plan::candidates`.
    first: u32,
}

/// Every brick that can hold density, in file order, with the pieces of axes that reach it.
///
/// Complete: a voxel outside of these bricks has density 0. Found by scattering the axes' pieces over the bricks, so the
/// cost follows the bricks and not the space around them.
#[derive(Debug, Clone)]
pub struct Plan {
    lattice: Lattice,
    extent: Extent,
    root: [i64; 3],
    cover: Arc<Vec<Capsule>>,
    bricks: Vec<Planned>,
    candidates: Vec<Candidate>,
    /// Whether an edge may pass through each brick; empty where that does not matter.
    edges: Vec<bool>,
    /// Bytes that were held at once to make it, at most.
    making: usize,
}

/// Why there is no plan.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
pub enum PlanError {
    /// The plan itself would not fit the memory, or the system has less to give.
    #[error("about {bricks:.3e} bricks of 8^3 voxels are too many to plan")]
    TooMany {
        /// About how many; no fewer than there are where what is enough is known.
        bricks: f64,
        /// What is enough to plan them; `None` where the number is known within a factor of a few only.
        enough: Option<Enough>,
    },
    /// The density lies beyond the range of voxel indices.
    #[error(
        "the density lies up to {extent:.3e} voxels from the origin, beyond the 2^31 that a grid can number"
    )]
    IndexRange {
        /// Largest distance along an axis, in voxels.
        extent: f64,
    },
    /// The density is too wide for its distance in nodes to be ordered.
    #[error("the density is more than 2^24 voxels wide")]
    TooWide,
}

/// What bricks take that were counted without being kept.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Enough {
    /// Bytes that are enough to plan them.
    pub bytes: u64,
    /// Nodes above them in a grid.
    pub nodes: u64,
}

impl PlanError {
    /// Bytes in which there is room for the plan that there was none for; `None` where it is not memory that it wants.
    pub fn enough(self) -> Option<u64> {
        /// Times what bricks take while they are found: their number is known within a factor of a few only.
        const ROOM: f64 = 4.0;
        const LEAST: u64 = 1 << 20;
        #[allow(clippy::cast_precision_loss, reason = "small")]
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "saturates")]
        match self {
            PlanError::TooMany { enough: Some(enough), .. } => Some(enough.bytes),
            PlanError::TooMany { bricks, enough: None } => {
                Some(LEAST.saturating_add((ROOM * bricks * BYTES as f64) as u64))
            }
            PlanError::IndexRange { .. } | PlanError::TooWide => None,
        }
    }
}

/// A brick and a capsule that reaches it, as a number that sorts in file order: from the highest bits the number of the
/// lower node, the brick in it, the capsule, and two flags. Half of what the brick's whole key and the capsule would take.
type Contact = u64;
/// The capsule reaches voxels' centres of the brick, and not only other places.
const CENTRES: Contact = 1;
/// An edge of the capsule may pass through the brick.
const EDGE: Contact = 2;
/// More capsules than this cannot be numbered.
const MOST_CAPSULES: usize = 1 << 24;
/// Where the brick begins, in a contact.
const BRICK: u32 = 26;
/// Bricks along an edge of a lower node, as a power of two.
const NODE: u32 = 4;
/// Bits that number a brick in its lower node.
const IN_NODE: u32 = 3 * NODE;
/// Bits that number a lower node in its upper node, of 32^3.
const IN_UPPER: u32 = 15;
/// More lower nodes than this cannot be numbered.
const MOST_NODES: usize = 1 << (64 - BRICK - IN_NODE);
/// Bytes that a brick takes at least until it is planned, where one capsule reaches it.
const BYTES: usize = size_of::<Contact>() + size_of::<Candidate>() + size_of::<Planned>();
/// Bytes for the place of a capsule's contacts, and their number.
const PLACE: usize = size_of::<usize>() + size_of::<&mut [Contact]>();
/// Bricks are sought where as many as are expected take no more than this many times the budget.
const LET_PASS: f64 = 2.0;
/// Capsules that one task looks at, at most, and tasks that there are at least where there are capsules for them: wide capsules
/// reach many times the bricks of thin ones.
const CAPSULES: usize = 16;
const TASKS: usize = 64;
/// Bricks along an edge of a root node, as a power of two.
const ROOT: u32 = 9;

impl Plan {
    /// Bytes that a piece of an axis takes for each brick that it reaches, at most.
    pub const CONTACT: usize = size_of::<Contact>() + size_of::<Candidate>();

    /// Plans the bake of `field` at a lattice, within `budget` bytes for the plan itself: of bricks that can hold density at
    /// their voxels' centres and, where the field is to be anti-aliased, of those that an edge may pass through.
    ///
    /// # Errors
    ///
    /// Before the memory is taken: when the plan would not fit the budget, or voxel indices would overflow.
    pub fn new(field: &Field, lattice: Lattice, budget: u64) -> Result<Plan, PlanError> {
        Plan::make(field, lattice, Extent::Centres, true, budget)
    }

    /// The same for bricks that can hold density anywhere in their extent. It is for points: edges are as they are.
    ///
    /// # Errors
    ///
    /// As of [`Plan::new`].
    pub fn for_extent(
        field: &Field,
        lattice: Lattice,
        extent: Extent,
        budget: u64,
    ) -> Result<Plan, PlanError> {
        Plan::make(field, lattice, extent, false, budget)
    }

    fn make(
        field: &Field,
        lattice: Lattice,
        extent: Extent,
        with_edges: bool,
        budget: u64,
    ) -> Result<Plan, PlanError> {
        let root = index_range(field, lattice)?;
        // Within a factor of a few of the contacts: what is far beyond the budget is not worth planning.
        let estimate = field.estimate_blocks(lattice);
        let uncounted = || Count::new(field, lattice, extent, with_edges, root).error(estimate);
        #[allow(clippy::cast_precision_loss, reason = "a rough bound")]
        if estimate * BYTES as f64 > LET_PASS * budget as f64 {
            return Err(uncounted());
        }
        let cover = field.cover(lattice, budget).ok_or_else(uncounted)?;
        let has_edges = with_edges
            && field.is_antialiased()
            && cover.par_iter().any(|capsule| field.edges(capsule, lattice).is_some());
        let reach = if has_edges { Extent::Whole } else { extent };
        let Census { counts, nodes } = Census::new(field, lattice, &cover, reach, root);
        let count: usize = counts.iter().sum();
        let places = cover.len() * PLACE;
        let finding =
            size_of_val(cover.as_slice()) + size_of_val(nodes.as_slice()) + count * size_of::<Contact>();
        let capsules = cover.len();
        // Counted anew, since contacts do not tell how many bricks they are of.
        let too_many = || match uncounted() {
            PlanError::TooMany { enough: None, .. } => {
                let nodes = uppers(&nodes) + nodes.len();
                Count { capsules, contacts: count, bricks: count, nodes }.error(estimate)
            }
            error => error,
        };
        let fits = |bytes: usize| bytes as u64 <= budget;
        let countable =
            u32::try_from(count).is_ok() && nodes.len() <= MOST_NODES && cover.len() <= MOST_CAPSULES;
        if !fits(finding + places) || !countable {
            return Err(too_many());
        }
        // Less than the budget may be left of what the system lets the process have.
        let mut contacts = Vec::new();
        contacts.try_reserve_exact(count).map_err(|_| too_many())?;
        contacts.resize(count, 0);
        let parts = split(&mut contacts, &counts);
        find_contacts(
            field,
            lattice,
            &cover,
            [extent, reach],
            has_edges,
            parts,
            &Nodes { keys: &nodes, root },
        );
        drop(counts);
        contacts.par_sort_unstable();

        let (mut bricks, mut candidates) = (0, 0);
        each_brick(&contacts, |_, _, needed| {
            (bricks, candidates) = (bricks + 1, candidates + needed.capsules().count());
        });
        let held =
            bricks * (size_of::<Planned>() + usize::from(has_edges)) + candidates * size_of::<Candidate>();
        if !fits(finding + held) {
            let counted = Count { capsules, contacts: count, bricks, nodes: 0 };
            let enough = Enough {
                bytes: counted.at_least(estimate, finding + held),
                nodes: (uppers(&nodes) + nodes.len()) as u64,
            };
            #[allow(clippy::cast_precision_loss, reason = "for a message")]
            return Err(PlanError::TooMany { bricks: bricks as f64, enough: Some(enough) });
        }
        let mut plan = Plan {
            lattice,
            extent,
            root,
            cover: Arc::new(cover),
            bricks: Vec::new(),
            candidates: Vec::new(),
            edges: Vec::new(),
            making: finding + places.max(held),
        };
        let room = plan.bricks.try_reserve_exact(bricks);
        let room = room.and_then(|()| plan.candidates.try_reserve_exact(candidates));
        let room = room.and_then(|()| plan.edges.try_reserve_exact(if has_edges { bricks } else { 0 }));
        room.map_err(|_| too_many())?;
        each_brick(&contacts, |brick, crossed, needed| {
            let [node, low] = [brick >> IN_NODE, brick & ((1 << IN_NODE) - 1)];
            #[allow(clippy::cast_possible_truncation, reason = "less than 2^26 nodes, and 2^32 candidates")]
            let (node, first) = (node as usize, plan.candidates.len() as u32);
            plan.candidates.extend(needed.capsules());
            plan.bricks.push(Planned { block: block_of(nodes[node] << IN_NODE | low, root), first });
            if has_edges {
                plan.edges.push(crossed);
            }
        });
        Ok(plan)
    }

    /// The arrangement of voxels.
    pub fn lattice(&self) -> Lattice {
        self.lattice
    }

    /// The part of the bricks that it was made for, but for those that an edge may pass through: of these it is the whole.
    pub fn extent(&self) -> Extent {
        self.extent
    }

    /// The number of the candidate brick with these coordinates in bricks, if it is one.
    pub fn find(&self, block: [i64; 3]) -> Option<usize> {
        // No voxel has an index beyond 32 bits.
        if block.iter().any(|b| b.unsigned_abs() > 1 << 28) {
            return None;
        }
        let key = file_order(block, self.root);
        let found =
            self.bricks.binary_search_by_key(&key, |brick| file_order(brick.block.map(i64::from), self.root));
        found.ok().filter(|&index| self.block(index) == block)
    }

    /// Number of candidate bricks, exact: no other brick is touched.
    pub fn bricks(&self) -> usize {
        self.bricks.len()
    }

    /// Index of the first voxel of candidate brick `index`, in file order.
    pub fn origin(&self, index: usize) -> [i32; 3] {
        self.bricks[index].block.map(|b| b * 8)
    }

    /// Index of the first voxel of every candidate brick, in file order.
    pub fn origins(&self) -> impl Iterator<Item = [i32; 3]> {
        (0..self.bricks()).map(|index| self.origin(index))
    }

    /// Coordinates of brick `index`, in bricks.
    pub fn block(&self, index: usize) -> [i64; 3] {
        self.bricks[index].block.map(i64::from)
    }

    /// The pieces of axes that reach brick `index`.
    fn candidates(&self, index: usize) -> &[Candidate] {
        let first = self.bricks[index].first as usize;
        let end = self.bricks.get(index + 1).map_or(self.candidates.len(), |next| next.first as usize);
        &self.candidates[first..end]
    }

    /// Narrows the field that the plan was made for to candidate brick `index`. `region` is overwritten; its memory is
    /// kept from brick to brick.
    pub fn narrow<T: Scalar>(&self, field: &Field, index: usize, region: &mut Region<T>) {
        let candidates = self.candidates(index);
        let extent = if self.has_edge(index) { Extent::Whole } else { self.extent };
        field.narrow(self.lattice, extent, &self.cover, candidates, self.block(index), region);
    }

    /// Whether an edge may pass through any of the bricks.
    pub fn has_edges(&self) -> bool {
        self.edges.contains(&true)
    }

    /// Whether an edge may pass through candidate brick `index`, so that its voxels are to be anti-aliased.
    pub fn has_edge(&self, index: usize) -> bool {
        self.edges.get(index).is_some_and(|edge| *edge)
    }

    /// A plan of `count` of these bricks, or of all if there are fewer: one from each of as many equal parts of their order, at
    /// places in these parts that are spread evenly, too, and keep no step with rows of bricks.
    pub fn sample(&self, count: usize) -> Plan {
        let count = count.min(self.bricks());
        let mut next = 0;
        self.part((0..count).map(|number| {
            // Multiples of the golden ratio, modulo 1.
            let place = (number as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 32;
            let at = ((number as u128) << 32 | u128::from(place)) * self.bricks() as u128
                / ((count as u128) << 32);
            // Two parts may share a brick, which counts once. A part is no shorter than a brick, so there is one left.
            let at = usize::try_from(at).expect("less than the number of bricks").max(next);
            next = at + 1;
            at
        }))
    }

    /// A plan of some of these bricks, by their numbers in rising order.
    ///
    /// # Panics
    ///
    /// Where there is no brick of a number.
    pub fn part(&self, bricks: impl Iterator<Item = usize>) -> Plan {
        let cover = self.cover.clone();
        let mut part = Plan { cover, bricks: vec![], candidates: vec![], edges: vec![], ..*self };
        for index in bricks {
            let first =
                u32::try_from(part.candidates.len()).expect("no more candidates than in the whole plan");
            part.bricks.push(Planned { block: self.bricks[index].block, first });
            part.candidates.extend_from_slice(self.candidates(index));
            part.edges.extend(self.edges.get(index));
        }
        part
    }

    /// The part of the plan whose bricks lie between two voxels along an axis, both included.
    pub fn slab(&self, axis: usize, voxels: [i32; 2]) -> Plan {
        let [first, last] = voxels.map(|voxel| voxel.div_euclid(8));
        self.part(
            (0..self.bricks()).filter(|index| (first..=last).contains(&self.bricks[*index].block[axis])),
        )
    }

    /// Bytes that the plan holds.
    pub fn memory(&self) -> usize {
        size_of_val(self.cover.as_slice())
            + size_of_val(self.bricks.as_slice())
            + self.candidates.capacity() * size_of::<Candidate>()
            + size_of_val(self.edges.as_slice())
    }

    /// Bytes that were held at once to make the plan, at most; [`Plan::memory`] of them stay.
    pub fn making(&self) -> usize {
        self.making
    }
}

/// How much there is to plan.
#[derive(Debug, Clone, Copy, Default)]
struct Count {
    capsules: usize,
    contacts: usize,
    /// Bricks at most, but for bad luck.
    bricks: usize,
    /// Nodes above the bricks.
    nodes: usize,
}

impl Count {
    /// Of a plan that there is no room for: piece by piece, so that only the nodes are kept, which are few, and some of many
    /// bricks. All 0 where that takes long.
    fn new(field: &Field, lattice: Lattice, extent: Extent, with_edges: bool, root: [i64; 3]) -> Count {
        /// Bricks that are counted within some tenths of a second.
        const FEW: f64 = 1e6;
        /// Where there are more than so many, one in so many is kept, whose numbers are a matter of chance.
        const ALL: f64 = 8192.0;
        const ONE_IN: usize = 64;
        let estimate = field.estimate_blocks(lattice);
        if estimate > FEW {
            return Count::default();
        }
        let one_in = if estimate > ALL { ONE_IN } else { 1 };
        // `None` from a visit ends the search.
        let has_edges = with_edges
            && field.is_antialiased()
            && field
                .each_capsule(lattice, &mut |capsule| field.edges(&capsule, lattice).is_none().then_some(()))
                .is_none();
        let reach = if has_edges { Extent::Whole } else { extent };
        let (mut count, mut nodes, mut last) = (Count::default(), BTreeSet::new(), None);
        let mut kept = BTreeSet::new();
        let counted = field.each_capsule(lattice, &mut |capsule| {
            count.capsules += 1;
            capsule.blocks(field, lattice, reach, |block| {
                count.contacts += 1;
                let key = file_order(block, root);
                let node = key >> IN_NODE;
                if last != Some(node) {
                    nodes.insert(node);
                    last = Some(node);
                }
                // Multiples of the golden ratio, modulo 1.
                if key.wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 32 & (one_in as u64 - 1) == 0 {
                    kept.insert(key);
                }
            });
            (count.capsules < MOST_CAPSULES).then_some(())
        });
        let nodes: Vec<u64> = nodes.into_iter().collect();
        count.nodes = uppers(&nodes) + nodes.len();
        // Four standard deviations more, if they are a matter of chance.
        let more = if one_in > 1 { 4 * kept.len().isqrt() } else { 0 };
        count.bricks = count.contacts.min(one_in * (kept.len() + more));
        if counted.is_some() { count } else { Count::default() }
    }

    /// No fewer bytes than let the search for bricks begin.
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "saturates")]
    fn at_least(self, estimate: f64, bytes: usize) -> u64 {
        (bytes as u64)
            .max((estimate * BYTES as f64 / LET_PASS) as u64 + 1)
            .max(Field::cover_bytes(self.capsules))
    }

    /// What is enough for it.
    fn enough(self, estimate: f64) -> Enough {
        let Count { capsules, contacts, bricks, nodes } = self;
        let finding =
            capsules * size_of::<Capsule>() + nodes * size_of::<u64>() + contacts * size_of::<Contact>();
        let held = bricks * (size_of::<Planned>() + size_of::<bool>()) + contacts * size_of::<Candidate>();
        let bytes = self.at_least(estimate, finding + held.max(capsules * PLACE));
        Enough { bytes, nodes: nodes as u64 }
    }

    /// Why there is no plan, where about so many bricks were expected.
    fn error(self, estimate: f64) -> PlanError {
        if self.capsules == 0 {
            return PlanError::TooMany { bricks: estimate, enough: None };
        }
        #[allow(clippy::cast_precision_loss, reason = "for a message")]
        let bricks = self.bricks as f64;
        PlanError::TooMany { bricks, enough: Some(self.enough(estimate)) }
    }
}

/// Upper nodes over lower ones with these keys, sorted.
fn uppers(nodes: &[u64]) -> usize {
    nodes.chunk_by(|a, b| a >> IN_UPPER == b >> IN_UPPER).count()
}

/// What is known of contacts before they are found.
struct Census {
    /// Of each capsule.
    counts: Vec<usize>,
    /// The keys of the lower nodes that have any, sorted.
    nodes: Vec<u64>,
}

impl Census {
    fn new(field: &Field, lattice: Lattice, cover: &[Capsule], reach: Extent, root: [i64; 3]) -> Census {
        let parts: Vec<(Vec<usize>, Vec<u64>)> = cover
            .par_chunks((cover.len() / TASKS).clamp(1, CAPSULES))
            .map(|capsules| {
                let (mut counts, mut nodes) = (Vec::with_capacity(CAPSULES), Vec::new());
                for capsule in capsules {
                    let (mut count, mut last) = (0, None);
                    capsule.blocks(field, lattice, reach, |block| {
                        count += 1;
                        // Those of a row are mostly in one node.
                        let node = Some(block.map(|b| b >> NODE));
                        if node != last {
                            nodes.push(file_order(block, root) >> IN_NODE);
                            last = node;
                        }
                    });
                    counts.push(count);
                    nodes.sort_unstable();
                    nodes.dedup();
                }
                nodes.shrink_to_fit();
                (counts, nodes)
            })
            .collect();
        let counts = parts.iter().flat_map(|(counts, _)| counts).copied().collect();
        let mut nodes: Vec<u64> = parts.into_iter().flat_map(|(_, nodes)| nodes).collect();
        nodes.par_sort_unstable();
        nodes.dedup();
        nodes.shrink_to_fit();
        Census { counts, nodes }
    }
}

/// The part of each capsule, which has so many contacts.
fn split<'a>(mut rest: &'a mut [Contact], counts: &[usize]) -> Vec<&'a mut [Contact]> {
    let mut places = Vec::with_capacity(counts.len());
    for &count in counts {
        let (place, behind) = rest.split_at_mut(count);
        places.push(place);
        rest = behind;
    }
    places
}

/// Puts the contacts of all capsules into their places.
fn find_contacts(
    field: &Field,
    lattice: Lattice,
    cover: &[Capsule],
    [extent, reach]: [Extent; 2],
    has_edges: bool,
    places: Vec<&mut [Contact]>,
    nodes: &Nodes,
) {
    places.into_par_iter().zip(cover).enumerate().for_each(|(number, (place, capsule))| {
        let number = number as u64;
        let edges = if has_edges { field.edges(capsule, lattice) } else { None };
        let centres = capsule.near(field, lattice, extent);
        let (mut place, mut node) = (place.iter_mut(), None);
        capsule.near(field, lattice, reach).visit(|block, o| {
            let mut flags = CENTRES;
            if has_edges && !centres.reaches(block, o) {
                flags = 0;
            }
            if edges.as_ref().is_some_and(|edges| edges.may_cross(o)) {
                flags |= EDGE;
            }
            if let Some(place) = place.next() {
                *place = nodes.contact(block, &mut node) | number << 2 | flags;
            }
        });
    });
}

/// The lower nodes that have bricks.
struct Nodes<'a> {
    /// Their keys, sorted.
    keys: &'a [u64],
    root: [i64; 3],
}

impl Nodes<'_> {
    /// The brick's part of a contact. `last` are the coordinates and the number of the node that was asked for last: those of a
    /// row are mostly in one.
    fn contact(&self, block: [i64; 3], last: &mut Option<([i64; 3], u64)>) -> Contact {
        let node = block.map(|b| b >> NODE);
        let number = match *last {
            Some((of, number)) if of == node => number,
            _ => {
                let key = file_order(block, self.root) >> IN_NODE;
                self.keys.partition_point(|other| *other < key) as u64
            }
        };
        *last = Some((node, number));
        let brick = block.iter().fold(number, |key, b| key << NODE | (b.cast_unsigned() & ((1 << NODE) - 1)));
        brick << BRICK
    }
}

/// Calls `visit` for every brick that is to be evaluated, with its part of its contacts, whether an edge may pass through
/// it, and the capsules that it needs. `contacts` are sorted.
fn each_brick<'a>(contacts: &'a [Contact], mut visit: impl FnMut(u64, bool, Needed<'a>)) {
    for contacts in contacts.chunk_by(|a, b| a >> BRICK == b >> BRICK) {
        let crossed = contacts.iter().any(|contact| contact & EDGE != 0);
        let needed = Needed { contacts, crossed };
        if needed.capsules().next().is_some() {
            visit(contacts[0] >> BRICK, crossed, needed);
        }
    }
}

/// The capsules that a brick needs, of its contacts.
#[derive(Clone, Copy)]
struct Needed<'a> {
    contacts: &'a [Contact],
    /// Whether an edge may pass through it. Elsewhere only centres matter, and what reaches them, as in a plan without edges.
    crossed: bool,
}

impl<'a> Needed<'a> {
    #[allow(clippy::cast_possible_truncation, reason = "24 bits")]
    fn capsules(self) -> impl Iterator<Item = Candidate> + 'a {
        let needed = move |contact: &&Contact| self.crossed || **contact & CENTRES != 0;
        let capsule = |contact: &Contact| (contact << (64 - BRICK) >> (64 - BRICK + 2)) as Candidate;
        self.contacts.iter().filter(needed).map(capsule)
    }
}

/// Coordinates of the first root node, after checking that voxel indices and the width in root nodes fit.
#[allow(clippy::cast_possible_truncation, reason = "checked before the cast")]
fn index_range(field: &Field, lattice: Lattice) -> Result<[i64; 3], PlanError> {
    let Some([lo, hi]) = field.bounds() else { return Ok([0; 3]) };
    let (lo, hi) = (lo / lattice.voxel_size, hi / lattice.voxel_size);
    let extent = lo.abs().max(hi.abs()).max_element();
    // A margin of some bricks for those that are planned and stay empty.
    if extent.is_nan() || extent >= 2_147_483_648.0 - 64.0 {
        return Err(PlanError::IndexRange { extent });
    }
    // The sort key has twelve bits for each axis.
    if (hi - lo).max_element() > f64::from((1 << 12) - 2) * 4096.0 {
        return Err(PlanError::TooWide);
    }
    let first = |x: f64| ((x - 64.0) / 4096.0).floor() as i64;
    Ok([first(lo.x), first(lo.y), first(lo.z)])
}

/// Order of bricks in a file: by root node, then by node of 128^3 voxels, then by brick, x before y before z in each.
fn file_order(block: [i64; 3], root: [i64; 3]) -> u64 {
    let mut key = 0;
    for (shift, bits) in [(ROOT, 12), (NODE, 5), (0, NODE)] {
        for axis in 0..3 {
            let relative = block[axis] - (root[axis] << ROOT);
            key = key << bits | ((relative >> shift).cast_unsigned() & ((1 << bits) - 1));
        }
    }
    key
}

/// The brick that has a key.
#[allow(clippy::cast_possible_truncation, reason = "indices were checked to fit 32 bits")]
fn block_of(mut key: u64, root: [i64; 3]) -> [i32; 3] {
    let mut block = root.map(|r| r << ROOT);
    for (shift, bits) in [(0, NODE), (NODE, 5), (ROOT, 12)] {
        for axis in (0..3).rev() {
            block[axis] += (key & ((1 << bits) - 1)).cast_signed() << shift;
            key >>= bits;
        }
    }
    block.map(|b| b as i32)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Scene;

    #[test]
    fn samples_hold_no_brick_twice() {
        let text = "[[tube]]\nradius = 0.3\ncurve = { points = [[0, 0, 0], [0.4, 0, 1], [0, 0, 2]] }";
        let scene = Scene::parse(text, "").expect("valid");
        let plan = Plan::new(&Field::compile(&scene), Lattice { voxel_size: 0.02 }, 1 << 30).expect("small");
        for count in
            [1, 2, plan.bricks() / 2, plan.bricks() * 5 / 7, plan.bricks() - 1, plan.bricks(), 1 << 20]
        {
            let sample = plan.sample(count);
            let keys: Vec<u64> =
                (0..sample.bricks()).map(|i| file_order(sample.block(i), plan.root)).collect();
            assert!(keys.is_sorted_by(|a, b| a < b), "{count}");
            assert_eq!(keys.len(), count.min(plan.bricks()));
        }
    }
}
