//! A medium that is a scene's density itself.

use glam::DVec3;

use super::bins::Bins;
use super::grid::{Bricks, EDGE, Grid};
use super::medium::{Brick, Way};
use super::rays::{Hits, LANES, single};
use super::segment::GAUSS;
use super::shade::{Group, LONGEST, Lit, Wanted};
use crate::field::kernel::{Places, Scratch};
use crate::field::{Extent, Field, Lattice, Region, VOXELS};
use crate::num::{Level, Real, WithLevel, with_level};
use crate::volume::{Plan, PlanError, evaluate_block};

/// Segments of a group of rays that are evaluated at once: two places each.
const AT_ONCE: usize = VOXELS / (2 * LANES);
/// A segment is divided no more often than into so many.
const MOST_SEGMENTS: f32 = 65536.0;

/// The density of a scene, as a bake with this lattice would sample it, everywhere.
#[derive(Debug)]
pub struct Procedural<'a> {
    field: &'a Field,
    plan: Plan,
    grid: Grid,
    bricks: Bricks,
    step: f32,
}

/// A thread's memory.
#[derive(Default)]
pub(super) struct Worker {
    region: Region<f32>,
    scratch: Scratch<f32>,
    places: [Box<Room>; 3],
    values: Box<Room>,
}

struct Room([f32; VOXELS]);

impl Default for Room {
    fn default() -> Room {
        Room([0.0; VOXELS])
    }
}

impl<'a> Procedural<'a> {
    /// The field's density, its octaves fading as they do for the lattice. Rays take steps of `step` voxels, and shorter
    /// ones where it is dense. Planned in no more than `budget` bytes.
    ///
    /// # Errors
    ///
    /// As [`Plan::new`].
    pub fn new(
        field: &'a Field,
        lattice: Lattice,
        step: f64,
        budget: u64,
    ) -> Result<Procedural<'a>, PlanError> {
        let plan = Plan::for_extent(field, lattice, Extent::Whole, budget)?;
        let blocks = (0..plan.bricks()).map(|brick| plan.origin(brick).map(|c| c >> 3)).collect();
        let grid = Grid::cubic(lattice.voxel_size);
        Ok(Procedural { field, plan, grid, bricks: Bricks::new(blocks), step: single(step) })
    }
}

impl Procedural<'_> {
    pub(super) fn grid(&self) -> &Grid {
        &self.grid
    }

    pub(super) fn bricks(&self) -> &Bricks {
        &self.bricks
    }

    pub(super) fn carry(&self, level: Level, brick: Brick<'_>, way: &mut Way, worker: &mut Worker) {
        find(level, Find { brick, way });
        if way.hits.count == 0 {
            return;
        }
        self.plan.narrow(self.field, brick.seen.brick as usize, &mut worker.region);
        if worker.region.is_empty() {
            return;
        }
        for first in (0..way.hits.count).step_by(LANES) {
            let mut walk = Walk::new(&way.hits, first, self.step);
            while walk.is_going() {
                place(level, Place { walk: &walk, hits: &way.hits, worker });
                self.evaluate(level, worker);
                through(level, Through { walk: &mut walk, brick, way, values: &worker.values.0 });
            }
        }
    }

    pub(super) fn record(
        &self,
        level: Level,
        brick: Brick<'_>,
        way: &mut Way,
        bins: &mut Bins,
        worker: &mut Worker,
    ) {
        find(level, Find { brick, way });
        if way.hits.count == 0 {
            return;
        }
        self.plan.narrow(self.field, brick.seen.brick as usize, &mut worker.region);
        if worker.region.is_empty() {
            return;
        }
        for first in (0..way.hits.count).step_by(LANES) {
            let mut done = 0;
            while done < usize::MAX {
                let pieces = Pieces { brick, way, bins, worker, first, done };
                let Some(next) = pieces_of(level, pieces) else { break };
                self.evaluate(level, worker);
                add(level, Pieces { brick, way, bins, worker, first, done });
                done = next;
            }
        }
    }

    pub(super) fn densities(
        &self,
        brick: usize,
        places: &[DVec3],
        level: Level,
        worker: &mut Worker,
        out: &mut Vec<f32>,
    ) {
        self.plan.narrow(self.field, brick, &mut worker.region);
        for places in places.chunks(VOXELS) {
            let middle = 0.5 * f64::from(EDGE);
            let count = places.len().next_multiple_of(LANES);
            for axis in 0..3 {
                let room = &mut worker.places[axis].0;
                // The rest of the last lanes is taken to where the last place is.
                let last = places.last().map_or(0.0, |place| single(place[axis] - middle));
                room[..count].fill(last);
                for (to, place) in room.iter_mut().zip(places) {
                    *to = single(place[axis] - middle);
                }
            }
            self.evaluate_first(count, level, worker);
            out.extend_from_slice(&worker.values.0[..places.len()]);
        }
    }
}

impl Procedural<'_> {
    /// Cells between two steps along a ray.
    pub(super) fn step(&self) -> f64 {
        f64::from(self.step)
    }

    /// A density that no place of a brick is above.
    pub(super) fn majorant(&self, brick: usize, worker: &mut Worker) -> f32 {
        self.plan.narrow(self.field, brick, &mut worker.region);
        single(self.field.bound_in(&worker.region)).next_up()
    }

    fn evaluate(&self, level: Level, worker: &mut Worker) {
        self.evaluate_first(VOXELS, level, worker);
    }

    fn evaluate_first(&self, count: usize, level: Level, worker: &mut Worker) {
        let [x, y, z] = &worker.places;
        let places = Places::Points([&x.0[..count], &y.0[..count], &z.0[..count]]);
        evaluate_block(level, &worker.region, places, &mut worker.scratch, &mut worker.values.0);
    }
}

struct Find<'a> {
    brick: Brick<'a>,
    way: &'a mut Way,
}

#[inline(never)]
fn find(level: Level, code: Find<'_>) {
    with_level(level, code);
}

impl WithLevel for Find<'_> {
    type Output = ();
    #[inline(always)]
    fn run<R: Real<Scalar = f32>>(self, token: R::Token) {
        self.way.hits.find::<R>(token, &self.way.rays, self.brick.block, self.brick.seen);
        self.way.hits.fill();
    }
}

/// How a group of rays goes on through a brick.
struct Walk {
    first: usize,
    /// Where each ray is, and the length of its segments.
    at: [f32; LANES],
    length: [f32; LANES],
    end: [f32; LANES],
    /// The length of a segment that nothing divides.
    step: f32,
}

impl Walk {
    fn new(hits: &Hits, first: usize, step: f32) -> Walk {
        let mut walk = Walk { first, at: [0.0; LANES], length: [0.0; LANES], end: [0.0; LANES], step };
        walk.at.copy_from_slice(&hits.begin[first..first + LANES]);
        walk.end.copy_from_slice(&hits.end[first..first + LANES]);
        for lane in 0..LANES {
            walk.length[lane] = even(walk.end[lane] - walk.at[lane], step);
        }
        walk
    }

    fn is_going(&self) -> bool {
        (0..LANES).any(|lane| self.at[lane] < self.end[lane])
    }
}

/// The length of equal segments, no longer than `step`, that fill a way.
#[inline(always)]
fn even(way: f32, step: f32) -> f32 {
    if way > 0.0 { way / (way / step).ceil().clamp(1.0, MOST_SEGMENTS) } else { 0.0 }
}

/// Places of the next segments' samples.
struct Place<'a> {
    walk: &'a Walk,
    hits: &'a Hits,
    worker: &'a mut Worker,
}

#[inline(never)]
fn place(level: Level, code: Place<'_>) {
    with_level(level, code);
}

impl WithLevel for Place<'_> {
    type Output = ();
    #[inline(always)]
    fn run<R: Real<Scalar = f32>>(self, token: R::Token) {
        let Place { walk, hits, worker } = self;
        let first = walk.first;
        let middle = R::constant(token, 0.5 * f64::from(EDGE));
        let (at, length) = (R::load(token, &walk.at), R::load(token, &walk.length));
        let end = R::load(token, &walk.end);
        for segment in 0..AT_ONCE {
            for (sample, gauss) in GAUSS.into_iter().enumerate() {
                #[allow(clippy::cast_precision_loss, reason = "small")]
                let by = R::constant(token, segment as f64 + gauss);
                // Beyond the end, where nobody asks, still within the brick.
                let place = (at + by * length).least(end);
                let to = (2 * segment + sample) * LANES;
                for axis in 0..3 {
                    let position = R::load(token, &hits.position[axis][first..first + LANES]);
                    let direction = R::load(token, &hits.direction[axis][first..first + LANES]);
                    (position + place * direction - middle).store(&mut worker.places[axis].0[to..]);
                }
            }
        }
    }
}

/// Takes a group of rays through segments whose densities are known.
struct Through<'a> {
    walk: &'a mut Walk,
    brick: Brick<'a>,
    way: &'a mut Way,
    values: &'a [f32; VOXELS],
}

#[inline(never)]
fn through(level: Level, code: Through<'_>) {
    with_level(level, code);
}

impl WithLevel for Through<'_> {
    type Output = ();
    #[inline(always)]
    fn run<R: Real<Scalar = f32>>(self, token: R::Token) {
        let Through { walk, brick, way: Way { rays, hits }, values } = self;
        let (wanted, lit): (&Wanted, &Lit<'_>) = (brick.wanted, brick.lit);
        let first = walk.first;
        let mut group = Group::<R>::new(token, rays, hits, first, wanted);
        let zero = R::constant(token, 0.0);
        group.start(R::load(token, &walk.at));
        let end = R::load(token, &walk.end);
        let length = R::load(token, &walk.length);
        // A ray that has come to segments too dense for their length waits there.
        let mut waits = R::from_bitmask(token, 0);
        let longest = R::constant(token, 1.5 * LONGEST);
        let shortest = R::constant(token, f64::from(walk.step) / f64::from(MOST_SEGMENTS));
        let slack = R::constant(token, 0.5);
        let mut densest = zero;
        for segment in 0..AT_ONCE {
            let near = R::load(token, &values[2 * segment * LANES..]);
            let far = R::load(token, &values[(2 * segment + 1) * LANES..]);
            let going = R::and(group.going(token, wanted), R::not(waits));
            // Half a segment at least is left, or rounding has made one too many.
            let going = R::and(going, (slack * length).lt(end - group.at));
            if R::bitmask(going) == 0 {
                break;
            }
            let density = (near + far) * R::constant(token, 0.5);
            let mut depth = density * length * group.extinction;
            let mut goes = going;
            let dense = R::and(longest.lt(depth), shortest.lt(length));
            let dense = R::and(going, dense);
            if R::bitmask(dense) != 0 {
                waits = R::or(waits, dense);
                goes = R::and(going, R::not(dense));
                densest = R::select(dense, near.most(far) * group.extinction, densest);
            }
            depth = R::select(goes, depth, zero);
            group.pass(token, lit, R::select(goes, length, zero), depth, [near, far]);
            group.gather(token, lit);
        }
        let seeing = (group.before + group.depth).lt(R::constant(token, wanted.deepest));
        let (mut at, mut dense, mut waiting) = ([0.0; LANES], [0.0; LANES], [0.0; LANES]);
        group.at.store(&mut at);
        densest.store(&mut dense);
        R::select(waits, R::constant(token, 1.0), zero).store(&mut waiting);
        let seeing = R::bitmask(seeing);
        group.finish(rays, hits, first, wanted, lit.lamps);
        for lane in 0..LANES {
            let left = walk.end[lane] - at[lane];
            if seeing >> lane & 1 == 0 || left <= 0.5 * walk.length[lane] {
                walk.at[lane] = walk.end[lane];
                walk.length[lane] = 0.0;
            } else if waiting[lane] > 0.0 {
                walk.at[lane] = at[lane];
                // As long as would do if it were as dense as here everywhere; shorter than before in any case.
                let wished = single(LONGEST) / dense[lane];
                walk.length[lane] = wished.clamp(walk.length[lane] / 64.0, walk.length[lane] / 2.0);
            } else {
                walk.at[lane] = at[lane];
                walk.length[lane] = even(left, walk.step);
            }
        }
    }
}

/// Samples of the pieces that are recorded of a group of rays.
struct Pieces<'a> {
    brick: Brick<'a>,
    way: &'a mut Way,
    bins: &'a mut Bins,
    worker: &'a mut Worker,
    first: usize,
    /// Pieces that are recorded already.
    done: usize,
}

#[inline(never)]
fn pieces_of(level: Level, code: Pieces<'_>) -> Option<usize> {
    with_level(level, SetPieces(code))
}

#[inline(never)]
fn add(level: Level, code: Pieces<'_>) {
    with_level(level, AddPieces(code));
}

struct SetPieces<'a>(Pieces<'a>);
struct AddPieces<'a>(Pieces<'a>);

impl WithLevel for SetPieces<'_> {
    /// How many pieces are set, with those before them; `None` where there are no more.
    type Output = Option<usize>;
    #[inline(always)]
    fn run<R: Real<Scalar = f32>>(self, token: R::Token) -> Option<usize> {
        let Pieces { brick, way: Way { rays, hits }, bins, worker, first, done } = self.0;
        let group = Group::<R>::new(token, rays, hits, first, brick.wanted);
        let mut parts = bins.parts::<R>(token, hits, first, &group);
        let middle = R::constant(token, 0.5 * f64::from(EDGE));
        let mut set = 0;
        for piece in 0..done + AT_ONCE {
            let Some([begin, length]) = parts.next(token) else { break };
            set = piece + 1;
            if piece < done {
                continue;
            }
            for (sample, gauss) in GAUSS.into_iter().enumerate() {
                let at = begin + length * R::constant(token, gauss);
                let to = (2 * (piece - done) + sample) * LANES;
                for axis in 0..3 {
                    let place = group.position[axis] + at * group.direction[axis] - middle;
                    place.store(&mut worker.places[axis].0[to..]);
                }
            }
        }
        (set > done).then_some(set)
    }
}

impl WithLevel for AddPieces<'_> {
    type Output = ();
    #[inline(always)]
    fn run<R: Real<Scalar = f32>>(self, token: R::Token) {
        let Pieces { brick, way: Way { rays, hits }, bins, worker, first, done } = self.0;
        let group = Group::<R>::new(token, rays, hits, first, brick.wanted);
        let mut parts = bins.parts::<R>(token, hits, first, &group);
        let half = R::constant(token, 0.5);
        for piece in 0..done + AT_ONCE {
            let Some([_, length]) = parts.next(token) else { break };
            if piece < done {
                parts.skip();
                continue;
            }
            let values = &worker.values.0[2 * (piece - done) * LANES..];
            let sum = R::load(token, values) + R::load(token, &values[LANES..]);
            parts.add(bins, hits, sum * length * half * group.extinction);
        }
    }
}
