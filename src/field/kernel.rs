//! The density of a block of voxels: the one kernel, written over [`Real`].
//!
//! Each piece of a [`Region`] is worked through in three passes over those batches of the block's voxels that may have feet on
//! it, so that the first pass's chains of dependent operations overlap, and so that the last and dearest pass runs over
//! full lanes only:
//!
//! 1. *feet*: the parameter of every voxel's foot;
//! 2. *coordinates*: (u, v, l) and the envelope there; voxels outside the tube drop out, the rest are packed;
//! 3. *layers*: the pattern over the packed voxels; of a pattern with a threshold the last octaves only where they may reach it.

use super::VOXELS;
use super::batch::{self, Batches};
use super::feet::{Equation, Rows, across, bracket, newton};
use super::join::{self, Joint};
use super::layers::{Rest, layers, pack_places};
use super::near;
use super::region::{FOOT, Piece, ROWS, Region, SECOND, Search, Turn, U, V};
use crate::num::poly::TERMS;
use crate::num::{Real, Scalar};
use crate::scene::Radial;

/// Density is divided by no less than this where space narrows towards the focal set.
pub(super) const LEAST_NARROWING: f64 = 0.05;
/// Scratch arrays are this long: packed stores write whole lanes.
const ROOM: usize = VOXELS + 16;

/// Where the density of a block is evaluated.
#[derive(Debug, Clone, Copy)]
pub enum Places<'a, T> {
    /// The centres of the block's voxels; their densities lie z fastest.
    Centres,
    /// Points of the block: x, y and z in voxels from its centre. They are as many as there are voxels, or fewer, a whole
    /// number of batches of 16: the density at others is 0.
    Points([&'a [T]; 3]),
}

/// A number for every voxel of a block, and room for the rest of a batch.
#[derive(Debug, Clone)]
pub(super) struct Lanes<T>(Box<[T; ROOM]>);

impl<T: Scalar> Default for Lanes<T> {
    fn default() -> Lanes<T> {
        Lanes(Box::new([T::default(); ROOM]))
    }
}

impl<T> Lanes<T> {
    /// From voxel number `first`, below 512, on: the compiler sees that a batch fits.
    #[inline(always)]
    pub(super) fn part(&self, first: usize) -> &[T] {
        &self.0[first % VOXELS..]
    }

    #[inline(always)]
    pub(super) fn part_mut(&mut self, first: usize) -> &mut [T] {
        &mut self.0[first % VOXELS..]
    }

    /// All of them.
    #[inline(always)]
    pub(super) fn all(&self) -> &[T; VOXELS] {
        self.0.first_chunk().expect("room for a block")
    }
}

impl<T: Scalar> Lanes<T> {
    #[inline(always)]
    pub(super) fn clear(&mut self) {
        self.0.fill(T::default());
    }
}

/// Memory for one thread's evaluation.
#[derive(Debug, Clone)]
pub struct Scratch<T> {
    pub(super) eta: Lanes<T>,
    pub(super) u: Lanes<T>,
    pub(super) v: Lanes<T>,
    pub(super) height: Lanes<T>,
    pub(super) weight: Lanes<T>,
    /// Voxels inside, a word for each batch of lanes.
    pub(super) inside: Box<[u32; VOXELS]>,
    /// Radius and squared distance to the axis over it: only where octaves fade or feet are told apart.
    pub(super) radius: Lanes<T>,
    pub(super) q: Lanes<T>,
    /// Weights of a sum's octaves that fade.
    pub(super) weights: Vec<Lanes<T>>,
    /// The voxels where a sum is carried on past its first octaves.
    pub(super) rest: Rest<T>,
    /// The focal fade: only where feet are told apart.
    pub(super) focal: Lanes<T>,
    pub(super) joint: Joint<T>,
    /// The densities found so far, in the order of the places.
    pub(super) block: Lanes<T>,
    /// Place in voxels from the block's centre: only where layers ask for it.
    pub(super) place: [Lanes<T>; 3],
    /// The layers' joint value, and the pattern of one.
    pub(super) value: Lanes<T>,
    pub(super) pattern: Lanes<T>,
    /// The coordinates of a layer where its warp displaces them.
    pub(super) displaced: [Lanes<T>; 3],
    /// 0, 1, ... 15.
    pub(super) numbers: Vec<T>,
}

impl<T: Scalar> Default for Scratch<T> {
    fn default() -> Scratch<T> {
        let room = Lanes::default;
        Scratch {
            eta: room(),
            u: room(),
            v: room(),
            height: room(),
            weight: room(),
            inside: Box::new([0; VOXELS]),
            radius: room(),
            q: room(),
            weights: Vec::new(),
            rest: Rest::default(),
            focal: room(),
            joint: Joint::default(),
            block: room(),
            place: [room(), room(), room()],
            value: room(),
            pattern: room(),
            displaced: [room(), room(), room()],
            numbers: (0..16_u8).map(|i| T::from_f64(f64::from(i))).collect(),
        }
    }
}

/// How many voxels, counted once for every piece, went how far.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Counts {
    /// Entered the search for feet.
    pub searched: u64,
    /// Went through bisection: pieces not certified to hold one foot at most, or where Newton's method did not settle.
    pub bisected: u64,
    /// Have a foot and lie inside the tube.
    pub inside: u64,
    /// Have several feet on one axis; counted once.
    pub several: u64,
    /// Lie inside a tube but beyond its focal set, where its distance to the axis has a local maximum; counted once.
    pub beyond: u64,
}

impl Counts {
    /// Adds those of another block.
    pub fn add(&mut self, other: Counts) {
        self.searched += other.searched;
        self.bisected += other.bisected;
        self.inside += other.inside;
        self.several += other.several;
        self.beyond += other.beyond;
    }
}

/// Writes the density at 512 places of the block that the region was narrowed to.
///
/// Every value is at least 0; it is exactly 0 outside all tubes.
#[inline(always)]
pub fn evaluate<R: Real>(
    token: R::Token,
    region: &Region<R::Scalar>,
    places: Places<R::Scalar>,
    scratch: &mut Scratch<R::Scalar>,
    values: &mut [R::Scalar; VOXELS],
) -> Counts {
    let mut counts = Counts::default();
    scratch.block.clear();
    let apart = region.join.is_some();
    if apart {
        join::begin(&mut scratch.joint);
    }
    for tube in &region.tubes {
        if apart {
            join::open(&mut scratch.joint);
        }
        let mut rest = &region.pieces[tube.pieces[0]..tube.pieces[1]];
        while let [piece, ..] = rest {
            // Those that share their feet.
            let mut count = 1;
            while count < rest.len() && rest[count].shares_with(piece) {
                count += 1;
            }
            let pieces = &rest[..count];
            rest = &rest[count..];
            let near = match places {
                Places::Centres => near::any::<R>(token, pieces, &scratch.numbers),
                Places::Points([x, ..]) => Batches::first(x.len()),
            };
            if near.are_none() {
                continue;
            }
            find::<R>(token, piece, places, near, scratch, &mut counts);
            for piece in pieces {
                let packed = map::<R>(token, piece, places, near, apart, scratch);
                if piece.in_world {
                    pack_places::<R>(token, places, scratch);
                }
                layers::<R>(token, region, piece.layers, scratch, packed);
                if apart {
                    join::feet::<R>(token, tube, piece.arc, scratch);
                } else {
                    join::larger::<R>(token, scratch);
                }
                counts.inside += packed as u64;
            }
        }
        if let Some(rule) = region.join {
            join::close::<R>(token, tube.overlap, rule, &mut scratch.joint, &mut scratch.block);
        }
    }
    if let Some(rule) = region.join {
        [counts.several, counts.beyond] = join::finish::<R>(token, rule, &scratch.joint, &mut scratch.block);
    }
    match places {
        Places::Centres => batch::in_order::<R>(token, &scratch.block, values),
        Places::Points(_) => *values = *scratch.block.all(),
    }
    counts
}

/// The first pass: feet, if they are to be found. Of the batches `near` only.
#[inline(always)]
pub(super) fn find<R: Real>(
    token: R::Token,
    piece: &Piece<R::Scalar>,
    places: Places<R::Scalar>,
    near: Batches,
    scratch: &mut Scratch<R::Scalar>,
    counts: &mut Counts,
) {
    counts.searched += near.voxels();
    let settled = match piece.search {
        Search::Point { .. } => return,
        Search::Newton { cubic: false } => newton::<R, false>(token, piece, places, near, scratch),
        Search::Newton { cubic: true } => newton::<R, true>(token, piece, places, near, scratch),
        Search::Bracket => false,
    };
    if !settled {
        counts.bisected += near.voxels();
        bracket::<R>(token, piece, places, near, scratch);
    }
}

/// The second pass: coordinates and envelope of the voxels inside, packed; returns their number. Of the batches `near` only.
#[inline(always)]
pub(super) fn map<R: Real>(
    token: R::Token,
    piece: &Piece<R::Scalar>,
    places: Places<R::Scalar>,
    near: Batches,
    apart: bool,
    scratch: &mut Scratch<R::Scalar>,
) -> usize {
    if let Search::Point { is_corner } = piece.search {
        at_point::<R>(token, piece, places, near, is_corner, apart, scratch)
    } else if piece.is_cubic {
        coordinates::<R, 4>(token, piece, places, near, apart, scratch)
    } else {
        coordinates::<R, TERMS>(token, piece, places, near, apart, scratch)
    }
}

/// Cylinder coordinates and envelope at the feet; packs the voxels inside and returns their number. Of the batches `near` only.
/// The piece's polynomials have `N` terms.
#[inline(always)]
fn coordinates<R: Real, const N: usize>(
    token: R::Token,
    piece: &Piece<R::Scalar>,
    places: Places<R::Scalar>,
    mut near: Batches,
    apart: bool,
    scratch: &mut Scratch<R::Scalar>,
) -> usize {
    let mut rows = Rows::<R>::new(token, piece, places, &scratch.numbers);
    let (lo, hi) = (R::splat(token, piece.range[0]), R::splat(token, piece.range[1]));
    let one = R::constant(token, 1.0);
    let mut packed = 0;
    scratch.inside[..VOXELS / R::LANES].fill(0);
    while let Some([start, end]) = near.take() {
        for index in (start..end).step_by(R::LANES) {
            let found = R::load(token, scratch.eta.part(index));
            let eta = own(token, piece, found);
            let in_range = R::and(lo.le(eta), eta.le(hi));
            if R::bitmask(in_range) == 0 {
                continue;
            }
            rows.go::<U, ROWS>(token, index);
            let u = across::<R, N>(token, &rows, U, eta);
            let v = across::<R, N>(token, &rows, V, eta);
            let q = u * u + v * v;
            let inside = R::and(in_range, q.le(one));
            let bits = R::bitmask(inside);
            scratch.inside[index / R::LANES] = bits;
            if bits == 0 {
                continue;
            }
            let height = along::<R, N>(token, &piece.height, eta);
            let mut weight = envelope(token, piece, q, height);
            if let Some(gain) = &piece.gain {
                weight = weight * along::<R, N>(token, gain, eta);
            }
            let mut fade = one;
            if let Some(speed) = &piece.speed {
                let narrowing = narrowing(token, &rows, speed, found);
                fade = smoothstep(token, narrowing * R::constant(token, 5.0));
                if piece.is_faded {
                    weight = weight * fade;
                }
                if piece.is_full {
                    weight = weight / narrowing.most(R::constant(token, LEAST_NARROWING));
                }
            }
            if piece.fades || apart {
                let radius = along::<R, N>(token, &piece.radius, eta);
                packed_lanes(radius, inside, bits).store(scratch.radius.part_mut(packed));
                packed_lanes(q, inside, bits).store(scratch.q.part_mut(packed));
            }
            if apart {
                packed_lanes(fade, inside, bits).store(scratch.focal.part_mut(packed));
            }
            let [u, v] = turned(token, piece, [u, v], height);
            pack(scratch, packed, inside, bits, [u, v, height, weight]);
            packed += bits.count_ones() as usize;
        }
    }
    packed
}

/// The parameter in a piece of a foot on the interval that its pieces share.
#[inline(always)]
pub(super) fn own<R: Real>(token: R::Token, piece: &Piece<R::Scalar>, eta: R) -> R {
    match &piece.shared {
        Some(shared) => R::splat(token, shared.own[0]) + R::splat(token, shared.own[1]) * eta,
        None => eta,
    }
}

/// The same where the foot is the end of a curve, or a corner.
#[inline(always)]
fn at_point<R: Real>(
    token: R::Token,
    piece: &Piece<R::Scalar>,
    places: Places<R::Scalar>,
    mut near: Batches,
    is_corner: bool,
    apart: bool,
    scratch: &mut Scratch<R::Scalar>,
) -> usize {
    let mut rows = Rows::<R>::new(token, piece, places, &scratch.numbers);
    let (zero, one) = (R::constant(token, 0.0), R::constant(token, 1.0));
    let least = R::splat(token, piece.range[0]);
    let turn = [1, 2, 3, 4].map(|k| R::splat(token, piece.base[U + k]));
    let radius = R::splat(token, piece.radius[0]);
    let mut packed = 0;
    scratch.inside[..VOXELS / R::LANES].fill(0);
    while let Some([start, end]) = near.take() {
        for index in (start..end).step_by(R::LANES) {
            rows.go::<U, ROWS>(token, index);
            let (mut u, mut v) = (rows.row(token, U), rows.row(token, V));
            let beyond = rows.row(token, FOOT);
            let q = u * u + v * v + beyond * beyond;
            let mut inside = R::and(least.lt(beyond), q.le(one));
            if is_corner {
                inside = R::and(inside, rows.row(token, SECOND).lt(zero));
                // Turned into the first plane, on the side that the axis turns away from.
                let across = -(v * v + beyond * beyond).sqrt();
                (u, v) = (turn[0] * u + turn[1] * across, turn[2] * u + turn[3] * across);
            }
            let bits = R::bitmask(inside);
            scratch.inside[index / R::LANES] = bits;
            if bits == 0 {
                continue;
            }
            let mut weight = envelope(token, piece, q, zero);
            if let Some(gain) = &piece.gain {
                weight = weight * R::splat(token, gain[0]);
            }
            if piece.fades || apart {
                radius.store(scratch.radius.part_mut(packed));
                packed_lanes(q, inside, bits).store(scratch.q.part_mut(packed));
            }
            if apart {
                one.store(scratch.focal.part_mut(packed));
            }
            pack(scratch, packed, inside, bits, [u, v, zero, weight]);
            packed += bits.count_ones() as usize;
        }
    }
    packed
}

#[inline(always)]
pub(super) fn pack<R: Real>(
    scratch: &mut Scratch<R::Scalar>,
    packed: usize,
    inside: R::Mask,
    bits: u32,
    lanes: [R; 4],
) {
    packed_lanes(lanes[0], inside, bits).store(scratch.u.part_mut(packed));
    packed_lanes(lanes[1], inside, bits).store(scratch.v.part_mut(packed));
    packed_lanes(lanes[2], inside, bits).store(scratch.height.part_mut(packed));
    packed_lanes(lanes[3], inside, bits).store(scratch.weight.part_mut(packed));
}

/// The lanes of a mask, whose bits are also given, moved to the front: in most batches all are there.
#[inline(always)]
fn packed_lanes<R: Real>(lanes: R, mask: R::Mask, bits: u32) -> R {
    if bits.count_ones() as usize == R::LANES { lanes } else { lanes.compress(mask) }
}

#[inline(always)]
pub(super) fn along<R: Real, const N: usize>(token: R::Token, c: &[R::Scalar], eta: R) -> R {
    let mut sum = R::splat(token, c[N - 1]);
    for k in (0..N - 1).rev() {
        sum = sum * eta + R::splat(token, c[k]);
    }
    sum
}

/// (u, v) in the cross-section turned by what it twists from the piece's middle.
#[inline(always)]
pub(super) fn turned<R: Real>(
    token: R::Token,
    piece: &Piece<R::Scalar>,
    [u, v]: [R; 2],
    height: R,
) -> [R; 2] {
    let Some(twist) = &piece.twist else { return [u, v] };
    let turns = R::splat(token, twist.rate) * height;
    let (sin, cos) = match twist.most {
        Turn::Slight => turns.sin_cos_slight(token),
        Turn::Gentle => turns.sin_cos_eighth(token),
        Turn::Any => turns.sin_cos_turns(token),
    };
    [u * cos + v * sin, v * cos - u * sin]
}

/// `1 - kappa rho cos`.
#[inline(always)]
fn narrowing<R: Real>(token: R::Token, rows: &Rows<R>, speed: &[R::Scalar; 5], eta: R) -> R {
    let (_, slope) = Equation::new(token, rows).at::<true>(eta);
    slope / along::<R, 5>(token, speed, eta)
}

/// `t^2 (3 - 2 t)` with t clamped to [0, 1].
#[inline(always)]
fn smoothstep<R: Real>(token: R::Token, t: R) -> R {
    let t = t.within(R::constant(token, 0.0), R::constant(token, 1.0));
    t * t * (R::constant(token, 3.0) - (t + t))
}

#[inline(always)]
pub(super) fn envelope<R: Real>(token: R::Token, piece: &Piece<R::Scalar>, q: R, height: R) -> R {
    let one = R::constant(token, 1.0);
    let mut weight = match piece.radial {
        Radial::Smooth => (one - q) * (one - q),
        Radial::Linear => one - q.sqrt(),
        Radial::Hard => one,
        Radial::Edge(width) => smoothstep(token, (one - q.sqrt()) * R::constant(token, 1.0 / width)),
    };
    if let Some([here, rate]) = piece.axial[0] {
        weight = weight * smoothstep(token, R::splat(token, here) + R::splat(token, rate) * height);
    }
    if let Some([here, rate]) = piece.axial[1] {
        weight = weight * smoothstep(token, R::splat(token, here) + R::splat(token, rate) * height);
    }
    weight
}
