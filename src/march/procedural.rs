//! A medium that is a scene's density itself.

use std::sync::atomic::{AtomicU64, Ordering};

use glam::DVec3;

use super::bins::Bins;
use super::bvh::Corners;
use super::clip::Near;
use super::cones::{TubeBounds, segment_boxes};
use super::grid::{Bricks, EDGE, Grid};
use super::medium::{Brick, Way};
use super::methods::{Intervals, Marching, Method};
use super::rays::{LANES, Rays, single};
use super::segment::GAUSS;
use super::shade::Group;
use super::steps::{Place, Room, Rule, Through, Walk, place, through};
use super::strides::{Bounds, Strides};
use crate::field::kernel::{Places, Scratch};
use crate::field::{Extent, Field, Lattice, Region, VOXELS};
use crate::num::{Level, Real, WithLevel, with_level};
use crate::volume::{Plan, PlanError, evaluate_block, evaluate_every};

/// Pieces of a group of rays that are evaluated at once: two places each.
const AT_ONCE: usize = VOXELS / (2 * LANES);

/// The density of a scene, as a bake with this lattice would sample it, everywhere.
#[derive(Debug)]
pub struct Procedural<'a> {
    field: &'a Field,
    plan: Plan,
    grid: Grid,
    bricks: Bricks,
    bounds: TubeBounds,
    /// Of every segment, where they are asked for.
    boxes: Vec<Corners>,
    step: f64,
    marching: Marching,
    /// Places that the density was evaluated at, and those of them that were inside a tube.
    places: [AtomicU64; 2],
}

/// A thread's memory.
#[derive(Default)]
pub(super) struct Worker {
    region: Region<f32>,
    scratch: Scratch<f32>,
    near: Near,
    strides: Strides,
    /// Walks that go on, and those among them whose next segments are evaluated.
    walks: Vec<Walk>,
    batch: Vec<Walk>,
    places: [Box<Room>; 3],
    values: Box<Room>,
    /// As [`Procedural::places`].
    counts: [u64; 2],
}

#[cfg(test)]
impl Worker {
    /// Leaves something in all places, as tiles do.
    pub(super) fn soil(&mut self, mut of: impl FnMut() -> f32) {
        for room in self.places.iter_mut().chain([&mut self.values]) {
            room.0.fill_with(&mut of);
        }
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
        Ok(Procedural {
            field,
            plan,
            grid: Grid::cubic(lattice.voxel_size),
            bricks: Bricks::new(blocks),
            bounds: TubeBounds::new(field, lattice),
            boxes: Vec::new(),
            step,
            marching: Marching::default(),
            places: [AtomicU64::new(0), AtomicU64::new(0)],
        })
    }

    /// The same, marched through in another way. (Shadows are found by Gauss's rule always.)
    pub fn with(self, marching: Marching) -> Procedural<'a> {
        let boxes = match marching.intervals {
            Intervals::Bricks | Intervals::Cones => Vec::new(),
            Intervals::RayBoxes | Intervals::SampleBoxes => segment_boxes(self.field, self.plan.lattice()),
        };
        Procedural { marching, boxes, ..self }
    }

    /// Bytes that it takes.
    pub fn memory(&self) -> u64 {
        (self.plan.memory() + self.bricks.memory()) as u64
    }

    /// Places that the density was evaluated at so far, and how many of them were inside a tube (of several pieces of tubes
    /// at one place each counts, and so do the repetitions of a place that fill lanes).
    pub fn places(&self) -> [u64; 2] {
        self.places.each_ref().map(|count| count.load(Ordering::Relaxed))
    }
}

impl Procedural<'_> {
    pub(super) fn grid(&self) -> &Grid {
        &self.grid
    }

    pub(super) fn bricks(&self) -> &Bricks {
        &self.bricks
    }

    /// Gets ready for new rays that are to be carried.
    pub(super) fn begin(&self, rays: &Rays, worker: &mut Worker) {
        if self.marching.method != Method::Gauss {
            worker.strides.begin(rays, self.held_against(), self.marching, self.step, self.voxel());
        }
    }

    fn held_against(&self) -> Bounds<'_> {
        Bounds { tubes: &self.bounds, boxes: &self.boxes }
    }

    fn voxel(&self) -> f64 {
        self.plan.lattice().voxel_size
    }

    /// Finds the rays that meet a tube in a brick, or with `is_whole` those that meet the brick, and narrows the field to it;
    /// `false` where there is nothing.
    fn meet(
        &self,
        level: Level,
        brick: Brick<'_>,
        way: &mut Way,
        worker: &mut Worker,
        is_whole: bool,
    ) -> bool {
        if !is_whole {
            worker.near.gather(&self.bounds, brick.block, self.voxel());
        }
        find(level, Find { brick, way, near: (!is_whole).then_some(&worker.near) });
        if way.hits.count == 0 {
            return false;
        }
        self.plan.narrow(self.field, brick.seen.brick as usize, &mut worker.region);
        !worker.region.is_empty()
    }

    pub(super) fn carry(&self, level: Level, brick: Brick<'_>, way: &mut Way, worker: &mut Worker) {
        let Marching { method, growth, map_every, intervals, .. } = self.marching;
        // Steps of other methods are taken wherever they lead.
        if !self.meet(level, brick, way, worker, method != Method::Gauss) {
            return;
        }
        let rule = Rule { method, step: single(self.step), factor: single(1.0 + growth), map_every };
        let mut walks = std::mem::take(&mut worker.walks);
        walks.clear();
        // The last is taken first.
        for first in (0..way.hits.count).step_by(LANES).rev() {
            walks.push(match method {
                Method::Gauss => Walk::even(&way.hits, first, rule),
                _ => Walk::strides(&way.hits, first, rule, &mut worker.strides, self.held_against()),
            });
        }
        self.go_through(level, brick, way, worker, rule, &mut walks);
        // Steps that follow after others outside, until there are no more.
        let mut is_cut = intervals != Intervals::Bricks;
        while is_cut {
            for first in (0..way.hits.count).step_by(LANES).rev() {
                let walk = Walk::strides(&way.hits, first, rule, &mut worker.strides, self.held_against());
                if walk.is_going() {
                    walks.push(walk);
                }
            }
            is_cut = !walks.is_empty();
            self.go_through(level, brick, way, worker, rule, &mut walks);
        }
        worker.walks = walks;
        self.count(worker);
    }

    /// Takes groups of rays through all their segments; the last is taken first.
    fn go_through(
        &self,
        level: Level,
        brick: Brick<'_>,
        way: &mut Way,
        worker: &mut Worker,
        rule: Rule,
        walks: &mut Vec<Walk>,
    ) {
        let mut batch = std::mem::take(&mut worker.batch);
        loop {
            let (mut count, mut nodes) = (0, 0);
            while count + 2 * LANES <= VOXELS
                && let Some(mut walk) = walks.pop()
            {
                if walk.is_going() {
                    let (places, count, nodes) = (&mut worker.places, &mut count, &mut nodes);
                    place(level, Place { walk: &mut walk, hits: &way.hits, rule, places, count, nodes });
                    batch.push(walk);
                }
            }
            if batch.is_empty() {
                break;
            }
            self.evaluate(level, worker, count, (rule.map_every > 1).then_some(nodes));
            for mut walk in batch.drain(..) {
                through(level, Through { walk: &mut walk, rule, brick, way, values: &worker.values });
                if walk.is_going() {
                    walks.push(walk);
                }
            }
        }
        worker.batch = batch;
    }

    pub(super) fn record(
        &self,
        level: Level,
        brick: Brick<'_>,
        way: &mut Way,
        bins: &mut Bins,
        worker: &mut Worker,
    ) {
        if !self.meet(level, brick, way, worker, false) {
            return;
        }
        for first in (0..way.hits.count).step_by(LANES) {
            let mut done = 0;
            while done < usize::MAX {
                let pieces = Pieces { brick, way, bins, worker, first, done };
                let Some(next) = pieces_of(level, pieces) else { break };
                self.evaluate(level, worker, (next - done) * 2 * LANES, None);
                add(level, Pieces { brick, way, bins, worker, first, done });
                done = next;
            }
        }
        worker.counts = [0; 2];
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
            for axis in 0..3 {
                let room = &mut worker.places[axis].0;
                for (to, place) in room.iter_mut().zip(places) {
                    *to = single(place[axis] - middle);
                }
            }
            self.evaluate(level, worker, places.len(), None);
            out.extend_from_slice(&worker.values.0[..places.len()]);
        }
        worker.counts = [0; 2];
    }

    /// Cells between two steps along a ray.
    pub(super) fn step(&self) -> f64 {
        self.step
    }

    /// A density that no place of a brick is above.
    pub(super) fn majorant(&self, brick: usize, worker: &mut Worker) -> f32 {
        self.plan.narrow(self.field, brick, &mut worker.region);
        single(self.field.bound_in(&worker.region)).next_up()
    }

    /// The densities at the first places of a worker, mapped where they are nodes only, if there are such.
    fn evaluate(&self, level: Level, worker: &mut Worker, count: usize, nodes: Option<u32>) {
        let whole = count.next_multiple_of(LANES).min(VOXELS);
        // The last one repeats to the end of its batch, in which all go on until each has found its foot: what is evaluated
        // together must follow from the rays alone.
        if count > 0 {
            for room in &mut worker.places {
                let last = room.0[count - 1];
                room.0[count..whole].fill(last);
            }
        }
        let [x, y, z] = &worker.places;
        if let Some(values) = worker.values.all_mut()
            && let (Some(x), Some(y), Some(z)) = (x.all(), y.all(), z.all())
        {
            let (region, scratch) = (&worker.region, &mut worker.scratch);
            let counts = match nodes {
                Some(nodes) => evaluate_every(level, region, [x, y, z], (count, nodes), scratch, values),
                None => {
                    let places = Places::Points([&x[..whole], &y[..whole], &z[..whole]]);
                    evaluate_block(level, region, places, scratch, values)
                }
            };
            worker.counts[0] += count as u64;
            worker.counts[1] += counts.inside;
        }
    }

    fn count(&self, worker: &mut Worker) {
        for (all, count) in self.places.iter().zip(&mut worker.counts) {
            all.fetch_add(std::mem::take(count), Ordering::Relaxed);
        }
    }
}

struct Find<'a> {
    brick: Brick<'a>,
    way: &'a mut Way,
    near: Option<&'a Near>,
}

#[inline(never)]
fn find(level: Level, code: Find<'_>) {
    with_level(level, code);
}

impl WithLevel for Find<'_> {
    type Output = ();
    #[inline(always)]
    fn run<R: Real<Scalar = f32>>(self, token: R::Token) {
        let Way { rays, hits, .. } = self.way;
        hits.find::<R>(token, rays, self.brick.block, self.brick.seen);
        if let Some(near) = self.near {
            near.clip::<R>(token, hits);
        }
        hits.fill();
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
        let Pieces { brick, way: Way { rays, hits, .. }, bins, worker, first, done } = self.0;
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
        let Pieces { brick, way: Way { rays, hits, .. }, bins, worker, first, done } = self.0;
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
