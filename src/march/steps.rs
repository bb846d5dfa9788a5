//! Segments of rays within a brick of a scene's density: where they are sampled, and what becomes of the samples.
//!
//! Only what rays still ask for is sampled: the samples of many rays are packed, so that evaluation has full lanes.

use super::medium::{Brick, Way};
use super::methods::Method;
use super::rays::{Hits, LANES, single};
use super::shade::{Group, LONGEST};
use super::strides::{Bounds, Strides};
use crate::field::{EDGE, VOXELS};
use crate::num::{Level, Real, WithLevel, with_level};

/// Segments of a ray that are sampled before it goes through any of them, at most.
const AHEAD: usize = 16;
/// A segment is divided no more often than into so many.
const MOST_SEGMENTS: f32 = 65536.0;

/// The optical depth that stands for no transmittance: in single precision there is none beyond it.
const OPAQUE: f64 = 104.0;

/// A number for each sample; packed stores write whole lanes.
pub(super) struct Room(pub(super) [f32; VOXELS + LANES]);

impl Default for Room {
    fn default() -> Room {
        Room([0.0; VOXELS + LANES])
    }
}

impl Room {
    /// Those that there are samples for.
    pub(super) fn all(&self) -> Option<&[f32; VOXELS]> {
        self.0.first_chunk()
    }

    pub(super) fn all_mut(&mut self) -> Option<&mut [f32; VOXELS]> {
        self.0.first_chunk_mut()
    }
}

/// How segments are laid along rays.
#[derive(Debug, Clone, Copy)]
pub(super) struct Rule {
    pub(super) method: Method,
    /// The length of a segment that nothing divides, in cells.
    pub(super) step: f32,
    /// Each is longer than the one before by this factor.
    pub(super) factor: f32,
    /// See [`Marching`](super::Marching): with more than 1, samples are not packed, and segments are of one length.
    pub(super) map_every: usize,
}

/// How a group of rays goes on through a brick.
pub(super) struct Walk {
    first: usize,
    /// Where each ray is, the length of its next segment, and the number of those to come.
    at: [f32; LANES],
    length: [f32; LANES],
    left: [f32; LANES],
    end: [f32; LANES],
    /// The samples of the next segments: the first one's number, and of each segment the rays that it is sampled of.
    sample: usize,
    segments: usize,
    lanes: [u32; AHEAD],
}

impl Walk {
    fn new(hits: &Hits, first: usize) -> Walk {
        let mut walk = Walk {
            first,
            at: [0.0; LANES],
            length: [0.0; LANES],
            left: [0.0; LANES],
            end: [0.0; LANES],
            sample: 0,
            segments: 0,
            lanes: [0; AHEAD],
        };
        walk.at.copy_from_slice(&hits.begin[first..first + LANES]);
        walk.end.copy_from_slice(&hits.end[first..first + LANES]);
        walk
    }

    /// In equal segments.
    pub(super) fn even(hits: &Hits, first: usize, rule: Rule) -> Walk {
        let mut walk = Walk::new(hits, first);
        for lane in 0..LANES {
            walk.divide(lane, rule.step);
        }
        walk
    }

    /// By the next steps that are sampled within the brick.
    pub(super) fn strides(
        hits: &Hits,
        first: usize,
        rule: Rule,
        strides: &mut Strides,
        bounds: Bounds<'_>,
    ) -> Walk {
        let mut walk = Walk::new(hits, first);
        let sample = rule.method.samples().first().copied().unwrap_or(0.0);
        for lane in 0..LANES.min(hits.count - first) {
            let ray = hits.ray(first + lane);
            let middle = hits.middle[ray];
            let [begin, end] = [walk.at[lane], walk.end[lane]].map(|at| middle + f64::from(at));
            let (begin, length, count) = strides.take(bounds, ray, [begin, end], sample);
            walk.at[lane] = single(begin - middle);
            walk.length[lane] = single(length);
            walk.left[lane] = single(count);
            // Steps may be longer than what is left of the brick.
            walk.end[lane] = f32::MAX;
        }
        walk
    }

    /// Divides what is left of a ray into equal segments that are no longer than `longest`.
    #[inline(always)]
    fn divide(&mut self, lane: usize, longest: f32) {
        let way = self.end[lane] - self.at[lane];
        if way > 0.0 {
            self.left[lane] = (way / longest).ceil().max(1.0);
            self.length[lane] = way / self.left[lane];
        } else {
            (self.left[lane], self.length[lane]) = (0.0, 0.0);
        }
    }

    pub(super) fn is_going(&self) -> bool {
        self.left.iter().any(|left| *left > 0.0)
    }
}

/// Sets the places of the next samples of a walk, from sample number `count` on, as far as there is room; `count` becomes
/// that of all of them.
pub(super) struct Place<'a> {
    pub(super) walk: &'a mut Walk,
    pub(super) hits: &'a Hits,
    pub(super) rule: Rule,
    pub(super) places: &'a mut [Box<Room>; 3],
    pub(super) count: &'a mut usize,
    /// Of samples that are not packed: batches that are mapped, a bit each.
    pub(super) nodes: &'a mut u32,
}

#[inline(never)]
pub(super) fn place(level: Level, code: Place<'_>) {
    with_level(level, code);
}

impl WithLevel for Place<'_> {
    type Output = ();
    #[inline(always)]
    #[allow(clippy::cast_precision_loss, reason = "small")]
    #[allow(
        clippy::needless_range_loop,
        reason = "kernels hold no iterator adaptors: they may not be inlined"
    )]
    fn run<R: Real<Scalar = f32>>(self, token: R::Token) {
        let Place { walk, hits, rule, places, count, nodes } = self;
        let first = walk.first;
        let middle = R::constant(token, 0.5 * EDGE as f64);
        let factor = R::splat(token, rule.factor);
        let (mut at, mut length) = (R::load(token, &walk.at), R::load(token, &walk.length));
        let (left, end) = (R::load(token, &walk.left), R::load(token, &walk.end));
        walk.sample = *count;
        walk.segments = 0;
        let samples = rule.method.samples();
        // Samples that are not packed are interpolated up to the node after a ray's last; there it stays.
        let (zero, one) = (R::constant(token, 0.0), R::constant(token, 1.0));
        let every = R::constant(token, rule.map_every as f64);
        let stop = (zero - ((one - left) / every).floor()) * every;
        for segment in 0..AHEAD {
            let wanted = R::constant(token, segment as f64).lt(left);
            let lanes = R::bitmask(wanted);
            let is_packed = rule.map_every == 1;
            let sampled = if is_packed { lanes.count_ones() as usize } else { LANES };
            if lanes == 0 || *count + samples.len() * sampled > VOXELS {
                break;
            }
            walk.lanes[segment] = lanes;
            walk.segments = segment + 1;
            let stored = if is_packed { wanted } else { R::from_bitmask(token, 0xffff) };
            if segment % rule.map_every == 0 {
                *nodes |= 1 << (*count / LANES % 32);
            }
            for sample in samples {
                let place = (at + R::constant(token, *sample) * length).least(end);
                for axis in 0..3 {
                    let position = R::load(token, &hits.position[axis][first..first + LANES]);
                    let direction = R::load(token, &hits.direction[axis][first..first + LANES]);
                    let place = position + place * direction - middle;
                    place.compress(stored).store(&mut places[axis].0[*count % (VOXELS + 1)..]);
                }
                *count += sampled;
            }
            let goes_on = R::constant(token, segment as f64).lt(stop);
            at = if is_packed { at + length } else { R::select(goes_on, at + length, at) };
            length = length * factor;
        }
        if walk.segments > 0 {
            *nodes |= 1 << ((*count / LANES).wrapping_sub(1) % 32);
        }
    }
}

/// Takes a group of rays through segments whose densities are known.
pub(super) struct Through<'a> {
    pub(super) walk: &'a mut Walk,
    pub(super) rule: Rule,
    pub(super) brick: Brick<'a>,
    pub(super) way: &'a mut Way,
    pub(super) values: &'a Room,
}

#[inline(never)]
pub(super) fn through(level: Level, code: Through<'_>) {
    with_level(level, code);
}

impl WithLevel for Through<'_> {
    type Output = ();
    #[inline(always)]
    #[allow(clippy::cast_precision_loss, reason = "small")]
    fn run<R: Real<Scalar = f32>>(self, token: R::Token) {
        let Through { walk, rule, brick, way: Way { rays, hits, .. }, values } = self;
        let (wanted, lit) = (brick.wanted, brick.lit);
        let first = walk.first;
        let mut group = Group::<R>::new(token, rays, hits, first, wanted);
        let zero = R::constant(token, 0.0);
        group.start(R::load(token, &walk.at));
        group.end = R::load(token, &walk.end);
        let mut length = R::load(token, &walk.length);
        let factor = R::splat(token, rule.factor);
        let half = R::constant(token, 0.5);
        // A ray that has come to segments too dense for their length waits there.
        let mut waits = R::from_bitmask(token, 0);
        let longest = R::constant(token, 1.5 * LONGEST);
        let shortest = R::constant(token, f64::from(rule.step) / f64::from(MOST_SEGMENTS));
        let (mut densest, mut gone) = (zero, zero);
        let mut sample = walk.sample;
        for segment in 0..walk.segments {
            let sampled = R::from_bitmask(token, walk.lanes[segment]);
            // Those that are not packed are at their own lanes already.
            let is_packed = rule.map_every == 1;
            let samples = if is_packed { walk.lanes[segment].count_ones() as usize } else { LANES };
            let packed = if is_packed { sampled } else { R::from_bitmask(token, 0xffff) };
            let near = R::load(token, &values.0[sample % (VOXELS + 1)..]).expand(packed);
            sample += samples;
            let mut far = near;
            if rule.method == Method::Gauss {
                far = R::load(token, &values.0[sample % (VOXELS + 1)..]).expand(packed);
                sample += samples;
            }
            let seeing = group.going(token, wanted);
            let going = R::and(R::and(seeing, R::not(waits)), sampled);
            if R::bitmask(going) == 0 {
                break;
            }
            let mut depth = (near + far) * half * length * group.extinction;
            let mut goes = going;
            match rule.method {
                Method::Gauss => {
                    let dense = R::and(longest.lt(depth), shortest.lt(length));
                    let dense = R::and(going, dense);
                    if R::bitmask(dense) != 0 {
                        waits = R::or(waits, dense);
                        goes = R::and(going, R::not(dense));
                        densest = R::select(dense, near.most(far) * group.extinction, densest);
                    }
                }
                Method::Midpoint => {}
                Method::Alpha => depth = blocked(token, depth),
            }
            depth = R::select(goes, depth, zero);
            gone = gone + R::select(goes, R::constant(token, 1.0), zero);
            group.pass(token, lit, R::select(goes, length, zero), depth, [near, far]);
            group.gather(token, lit);
            length = length * factor;
        }
        let seeing = (group.before + group.depth).lt(R::constant(token, wanted.deepest));
        let (mut at, mut dense, mut passed) = ([0.0; LANES], [0.0; LANES], [0.0; LANES]);
        group.at.store(&mut at);
        densest.store(&mut dense);
        gone.store(&mut passed);
        let (seeing, waiting) = (R::bitmask(seeing), R::bitmask(waits));
        group.finish(rays, hits, first, wanted, lit.lamps);
        for lane in 0..LANES {
            if seeing >> lane & 1 == 0 {
                walk.left[lane] = 0.0;
                continue;
            }
            walk.at[lane] = at[lane];
            walk.left[lane] -= passed[lane];
            if rule.method != Method::Gauss {
                // What is gone was as long as each of these, or grew as they did.
                for _ in 0..(if rule.factor == 1.0 { 0 } else { walk.segments }) {
                    walk.length[lane] *= rule.factor;
                }
            } else if waiting >> lane & 1 == 1 {
                // As long as would do if it were as dense as here everywhere; shorter than before in any case.
                let wished = single(LONGEST) / dense[lane];
                walk.divide(lane, wished.clamp(walk.length[lane] / 64.0, walk.length[lane] / 2.0));
            } else if walk.left[lane] > 0.0 {
                walk.divide(lane, rule.step);
            }
        }
    }
}

/// The optical depth at which the transmittance is 1 less alpha.
#[inline(always)]
fn blocked<R: Real<Scalar = f32>>(token: R::Token, alpha: R) -> R {
    let one = R::constant(token, 1.0);
    // Logarithms are good to 1e-6, which is too little of what is small: alpha + alpha^2 / 2 + ...
    let mut series = R::constant(token, 1.0 / 6.0);
    for c in [0.2, 0.25, 1.0 / 3.0, 0.5, 1.0] {
        series = series * alpha + R::constant(token, c);
    }
    let left = (one - alpha).most(R::constant(token, 1e-30));
    let closed = left.log2() * R::constant(token, -std::f64::consts::LN_2);
    let closed = R::select(alpha.lt(one), closed, R::constant(token, OPAQUE));
    R::select(alpha.lt(R::constant(token, 0.1)), series * alpha, closed)
}
