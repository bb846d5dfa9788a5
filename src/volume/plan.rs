//! Which bricks can hold density, found before any memory for values is taken.

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
    cover: Vec<Capsule>,
    bricks: Vec<Planned>,
    candidates: Vec<Candidate>,
    /// Whether an edge may pass through each brick; empty where that does not matter.
    edges: Vec<bool>,
}

/// Why there is no plan.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
pub enum PlanError {
    /// The plan itself would not fit the memory.
    #[error("about {bricks:.3e} bricks of 8^3 voxels are too many to plan")]
    TooMany {
        /// About how many, each counted once for every piece of an axis that reaches it.
        bricks: f64,
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

/// A contact: the key of a brick, and of a capsule that reaches it the index, times four, with two flags.
type Contact = (u64, u32);
/// The capsule reaches voxels' centres of the brick, and not only other places.
const CENTRES: u32 = 1;
/// An edge of the capsule may pass through the brick.
const EDGE: u32 = 2;
/// Bytes a contact takes while the plan is made: itself, its candidate, and at most one brick.
const BYTES: usize = size_of::<Contact>() + size_of::<Candidate>() + size_of::<Planned>();
/// Capsules whose contacts are found before they are put with the others.
const BATCH: usize = 4096;
/// Bricks along an edge of a root node, as a power of two.
const ROOT: u32 = 9;

impl Plan {
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
        // Within a factor of a few of the contacts: what is far beyond the budget is not worth counting.
        let estimate = field.estimate_blocks(lattice);
        #[allow(clippy::cast_precision_loss, reason = "a rough bound")]
        if estimate * BYTES as f64 > 8.0 * budget as f64 {
            return Err(PlanError::TooMany { bricks: estimate });
        }
        let cover = field.cover(lattice).ok_or(PlanError::TooMany { bricks: estimate })?;
        let has_edges = with_edges
            && field.is_antialiased()
            && cover.par_iter().any(|capsule| field.edges(capsule, lattice).is_some());
        let reach = if has_edges { Extent::Whole } else { extent };
        let count: usize = cover
            .par_iter()
            .map(|capsule| {
                let mut count = 0;
                capsule.blocks(field, lattice, reach, |_| count += 1);
                count
            })
            .sum();
        #[allow(clippy::cast_precision_loss, reason = "for a message")]
        let too_many = PlanError::TooMany { bricks: count as f64 };
        if (count * BYTES + size_of_val(cover.as_slice())) as u64 > budget || u32::try_from(count).is_err() {
            return Err(too_many);
        }

        let mut contacts: Vec<Contact> = Vec::with_capacity(count);
        let mut capsules = 0_u32..;
        for batch in cover.chunks(BATCH) {
            let found: Vec<Vec<Contact>> = batch
                .par_iter()
                .map(|capsule| {
                    let mut found = Vec::new();
                    let edges = if has_edges { field.edges(capsule, lattice) } else { None };
                    let centres = capsule.near(field, lattice, extent);
                    capsule.near(field, lattice, reach).visit(|block, o| {
                        let mut flags = CENTRES;
                        if has_edges && !centres.reaches(block, o) {
                            flags = 0;
                        }
                        if edges.as_ref().is_some_and(|edges| edges.may_cross(o)) {
                            flags |= EDGE;
                        }
                        found.push((file_order(block, root), flags));
                    });
                    found
                })
                .collect();
            for (found, capsule) in found.into_iter().zip(&mut capsules) {
                // Covers have less than 2^30 capsules.
                contacts.extend(found.into_iter().map(|(key, flags)| (key, capsule << 2 | flags)));
            }
        }
        contacts.par_sort_unstable();

        let candidates = Vec::with_capacity(count);
        let mut plan = Plan { lattice, extent, root, cover, bricks: vec![], candidates, edges: vec![] };
        for contacts in contacts.chunk_by(|a, b| a.0 == b.0) {
            let crossed = contacts.iter().any(|contact| contact.1 & EDGE != 0);
            let first = u32::try_from(plan.candidates.len()).map_err(|_| too_many)?;
            // Elsewhere only centres matter, and what reaches them, as in a plan without edges.
            let needed = contacts.iter().filter(|contact| crossed || contact.1 & CENTRES != 0);
            plan.candidates.extend(needed.map(|contact| contact.1 >> 2));
            if plan.candidates.len() > first as usize {
                plan.bricks.push(Planned { block: block_of(contacts[0].0, root), first });
                if has_edges {
                    plan.edges.push(crossed);
                }
            }
        }
        plan.bricks.shrink_to_fit();
        plan.edges.shrink_to_fit();
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

    /// Whether an edge may pass through candidate brick `index`, so that its voxels are to be anti-aliased.
    pub fn has_edge(&self, index: usize) -> bool {
        self.edges.get(index).is_some_and(|edge| *edge)
    }

    /// A plan of `count` of these bricks, or of all if there are fewer, spread evenly over their order.
    pub fn sample(&self, count: usize) -> Plan {
        let count = count.min(self.bricks());
        // The middle of the brick's share of the order.
        self.part((0..count).map(|number| (2 * number + 1) * self.bricks() / (2 * count)))
    }

    /// These bricks of the plan.
    fn part(&self, bricks: impl Iterator<Item = usize>) -> Plan {
        let mut part =
            Plan { cover: self.cover.clone(), bricks: vec![], candidates: vec![], edges: vec![], ..*self };
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
    for (shift, bits) in [(ROOT, 12), (4, 5), (0, 4)] {
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
    for (shift, bits) in [(0, 4), (4, 5), (ROOT, 12)] {
        for axis in (0..3).rev() {
            block[axis] += (key & ((1 << bits) - 1)).cast_signed() << shift;
            key >>= bits;
        }
    }
    block.map(|b| b as i32)
}
