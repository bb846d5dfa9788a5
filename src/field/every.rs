//! The density along rows of places whose coordinates are found at some only.
//!
//! Moinet, "Sculpting procedural noise" (2022), asks whether it would do to map every n-th place of a ray to the cylinder, and
//! to interpolate between. Here (u, v, l) and the foot are linear between such *nodes* where both have a foot on the same piece
//! of an axis, so the error is of order 2 in their distance; elsewhere every place is mapped.

use super::VOXELS;
use super::batch::{BATCH, BATCHES, Batches};
use super::feet::{Rows, across, newton};
use super::join;
use super::kernel::{self, Counts, Places, Scratch, along, envelope, find, map, own, pack, turned};
use super::layers::{layers, pack_places};
use super::region::{FOOT, Piece, Region, Search, U, V};
use crate::num::Real;
use crate::num::poly::TERMS;

/// As [`kernel::evaluate`], at so many places of a block, where the places of each lane go on from a batch of 16 to the next along
/// a line. Bit i of `nodes` says whether batch i is mapped; the first and the last of each line are.
#[inline(always)]
pub fn evaluate<R: Real>(
    token: R::Token,
    region: &Region<R::Scalar>,
    points: [&[R::Scalar; VOXELS]; 3],
    count: usize,
    nodes: u32,
    scratch: &mut Scratch<R::Scalar>,
    values: &mut [R::Scalar; VOXELS],
) -> Counts {
    let count = count.next_multiple_of(BATCH).min(VOXELS);
    let [x, y, z] = points;
    let places = Places::Points([&x[..count], &y[..count], &z[..count]]);
    if region.join.is_some() || R::LANES != BATCH {
        return kernel::evaluate::<R>(token, region, places, scratch, values);
    }
    let mut counts = Counts::default();
    scratch.block.clear();
    let batches = count.div_ceil(BATCH).min(BATCHES);
    for piece in &region.pieces {
        let found = match piece.search {
            Search::Newton { .. } if piece.speed.is_none() => {
                between::<R>(token, piece, places, batches, nodes, scratch, &mut counts)
            }
            _ => None,
        };
        let packed = match found {
            Some(packed) => packed,
            None => {
                let near = Batches::first(count);
                find::<R>(token, piece, places, near, scratch, &mut counts);
                map::<R>(token, piece, places, near, false, scratch)
            }
        };
        if piece.in_world {
            pack_places::<R>(token, places, scratch);
        }
        layers::<R>(token, region, piece.layers, scratch, packed);
        join::larger::<R>(token, scratch);
        counts.inside += packed as u64;
    }
    *values = *scratch.block.all();
    counts
}

/// Coordinates and envelope at all places of a piece, packed; `None` where some foot is not found.
#[inline(always)]
fn between<R: Real>(
    token: R::Token,
    piece: &Piece<R::Scalar>,
    places: Places<R::Scalar>,
    batches: usize,
    nodes: u32,
    scratch: &mut Scratch<R::Scalar>,
    counts: &mut Counts,
) -> Option<usize> {
    let mapped = Batches(nodes & Batches::first(batches * BATCH).0);
    let all = !0_u32 >> (32 - BATCH);
    let mut valid = [0_u32; BATCHES];
    exactly::<R>(token, piece, places, mapped, scratch, counts, &mut valid)?;
    // What is not between two feet of this piece.
    let mut rest = Batches::first(0);
    let mut first = 0;
    for batch in 0..batches {
        if nodes >> batch & 1 == 1 {
            first = batch;
        } else if valid[first] & valid[next(nodes, batch)] != all {
            rest.add(batch);
        }
    }
    if !rest.are_none() {
        exactly::<R>(token, piece, places, rest, scratch, counts, &mut valid)?;
    }
    let (one, mut packed, mut first) = (R::constant(token, 1.0), 0, 0);
    for inside in scratch.inside.iter_mut() {
        *inside = 0;
    }
    for batch in 0..batches {
        let index = batch * BATCH;
        let is_node = nodes >> batch & 1 == 1;
        if is_node {
            first = batch;
        }
        let is_exact = is_node || rest.have(batch);
        let (from, to) = if is_exact { (batch, batch) } else { (first, next(nodes, batch)) };
        let lanes = valid[from] & valid[to];
        if lanes == 0 {
            continue;
        }
        #[allow(clippy::cast_precision_loss, reason = "below 32")]
        let part = if is_exact { 0.0 } else { (batch - from) as f64 / (to - from) as f64 };
        let part = R::constant(token, part);
        let (from, to) = (from * BATCH, to * BATCH);
        let found = mix(R::load(token, scratch.eta.part(from)), R::load(token, scratch.eta.part(to)), part);
        let eta = own(token, piece, found);
        let mut coordinates = [one; 3];
        for (coordinate, stored) in coordinates.iter_mut().zip(&scratch.displaced) {
            *coordinate = mix(R::load(token, stored.part(from)), R::load(token, stored.part(to)), part);
        }
        let [u, v, height] = coordinates;
        let q = u * u + v * v;
        let inside = R::and(R::from_bitmask(token, lanes), q.le(one));
        let bits = R::bitmask(inside);
        scratch.inside[index / R::LANES] = bits;
        if bits == 0 {
            continue;
        }
        let mut weight = envelope(token, piece, q, height);
        if let Some(gain) = &piece.gain {
            weight = weight * along::<R, TERMS>(token, gain, eta);
        }
        if piece.fades {
            along::<R, TERMS>(token, &piece.radius, eta)
                .compress(inside)
                .store(scratch.radius.part_mut(packed));
            q.compress(inside).store(scratch.q.part_mut(packed));
        }
        pack(scratch, packed, inside, bits, [u, v, height, weight]);
        packed += bits.count_ones() as usize;
    }
    Some(packed)
}

/// The first node after a batch.
#[inline(always)]
fn next(nodes: u32, batch: usize) -> usize {
    let after = nodes >> batch;
    if after == 0 { batch } else { batch + after.trailing_zeros() as usize }
}

#[inline(always)]
fn mix<R: Real>(a: R, b: R, part: R) -> R {
    a + (b - a) * part
}

/// Coordinates at the places of some batches, and which of them have a foot.
#[inline(always)]
fn exactly<R: Real>(
    token: R::Token,
    piece: &Piece<R::Scalar>,
    places: Places<R::Scalar>,
    near: Batches,
    scratch: &mut Scratch<R::Scalar>,
    counts: &mut Counts,
    valid: &mut [u32; BATCHES],
) -> Option<()> {
    counts.searched += near.voxels();
    let settled = match piece.search {
        Search::Newton { cubic: true } => newton::<R, true>(token, piece, places, near, scratch),
        _ => newton::<R, false>(token, piece, places, near, scratch),
    };
    if !settled {
        return None;
    }
    let mut rows = Rows::<R>::new(token, piece, places, &scratch.numbers);
    let (lo, hi) = (R::splat(token, piece.range[0]), R::splat(token, piece.range[1]));
    for (batch, valid) in valid.iter_mut().enumerate() {
        let index = batch * BATCH;
        if !near.have(batch) {
            continue;
        }
        let eta = own(token, piece, R::load(token, scratch.eta.part(index)));
        *valid = R::bitmask(R::and(lo.le(eta), eta.le(hi)));
        if *valid == 0 {
            continue;
        }
        rows.go::<U, { FOOT + 3 }>(token, index);
        let height = along::<R, TERMS>(token, &piece.height, eta);
        let across = [across::<R, TERMS>(token, &rows, U, eta), across::<R, TERMS>(token, &rows, V, eta)];
        let [u, v] = turned(token, piece, across, height);
        u.store(scratch.displaced[0].part_mut(index));
        v.store(scratch.displaced[1].part_mut(index));
        height.store(scratch.displaced[2].part_mut(index));
    }
    Some(())
}
