//! Steps along rays, for methods that take them wherever they lead.

use super::bvh::Corners;
use super::camera::Ray;
use super::cones::{Interval, TubeBounds, join};
use super::methods::{CLOSE, Intervals, Marching};
use super::rays::{RAYS, Rays};

/// No step is shorter than this part of a cell.
const SHORTEST: f64 = 1e-6;

/// What rays are held against.
#[derive(Clone, Copy)]
pub(super) struct Bounds<'a> {
    pub(super) tubes: &'a TubeBounds,
    /// Of every segment, where they are asked for.
    pub(super) boxes: &'a [Corners],
}

/// The steps of a tile's rays, from where each enters the tubes; in cells.
#[derive(Default)]
pub(super) struct Strides {
    entry: Vec<f64>,
    exit: Vec<f64>,
    /// Steps that are taken already.
    taken: Vec<f64>,
    /// The first step of each ray.
    step: Vec<f64>,
    growth: f64,
    intervals: Intervals,
    /// Metres of a cell.
    h: f64,
    /// In metres, where samples are held against boxes.
    lines: Vec<Option<Ray>>,
    /// Where rays are inside, all in one list, and where in it each ray is and where its intervals end.
    inside: Vec<Interval>,
    of: Vec<[usize; 2]>,
    found: Vec<Interval>,
}

impl Strides {
    /// Of new rays in a cubic grid of edge h.
    pub(super) fn begin(&mut self, rays: &Rays, bounds: Bounds<'_>, marching: Marching, step: f64, h: f64) {
        (self.growth, self.intervals, self.h) = (marching.growth, marching.intervals, h);
        for all in [&mut self.entry, &mut self.exit, &mut self.taken, &mut self.step] {
            all.clear();
            all.resize(RAYS, 0.0);
        }
        self.lines.clear();
        self.lines.resize(RAYS, None);
        self.of.clear();
        self.of.resize(RAYS, [0; 2]);
        self.inside.clear();
        for number in 0..RAYS {
            (self.exit[number], self.step[number]) = (-1.0, step);
            let Some(ray) = rays.ray(number) else { continue };
            let ray = Ray { origin: ray.origin * h, direction: ray.direction };
            let Some([entry, exit]) = self.ends(&ray, bounds, marching, step * h) else { continue };
            (self.entry[number], self.exit[number]) = (entry / h, exit / h);
            if let Some(count) = marching.count {
                // Above 0 where a ray touches a corner of the box, too.
                self.step[number] = ((exit - entry) / h / f64::from(count.get())).max(SHORTEST);
            }
            match self.intervals {
                Intervals::Bricks => {}
                Intervals::Cones | Intervals::RayBoxes => {
                    let first = self.inside.len();
                    self.inside.extend(self.found.iter().map(|inside| inside.map(|at| at / h)));
                    self.of[number] = [first, self.inside.len()];
                }
                Intervals::SampleBoxes => self.lines[number] = Some(ray),
            }
        }
    }

    /// Where a ray's first step begins, and where none is sampled any more, in metres. `found` is where it is inside.
    fn ends(&mut self, ray: &Ray, bounds: Bounds<'_>, marching: Marching, step: f64) -> Option<Interval> {
        let found = &mut self.found;
        match marching.intervals {
            Intervals::Bricks | Intervals::Cones => bounds.tubes.intervals(ray, found),
            Intervals::RayBoxes => {
                let inverse = ray.direction.recip();
                found.clear();
                found.extend(bounds.boxes.iter().filter_map(|corners| corners.interval(ray.origin, inverse)));
                join(found);
            }
            Intervals::SampleBoxes => found.clear(),
        }
        if marching.count.is_some() || marching.intervals == Intervals::SampleBoxes {
            return bounds.tubes.around(ray);
        }
        match marching.intervals {
            Intervals::RayBoxes => Some([found.first()?[0], found.last()?[1]]),
            _ => marching.entry.find(bounds.tubes, ray, found, step, CLOSE * self.h),
        }
    }

    /// Where a step begins, and how long it is.
    fn step(&self, ray: usize, number: f64) -> [f64; 2] {
        let first = self.step[ray];
        if self.growth == 0.0 {
            return [self.entry[ray] + number * first, first];
        }
        let grown = libm::pow(1.0 + self.growth, number);
        [self.entry[ray] + first * (grown - 1.0) / self.growth, first * grown]
    }

    /// The next steps of a ray that follow each other, are sampled inside and between two places along it, `sample` of their
    /// length from their beginning, and are not taken yet; takes them. Where the first begins, its length, and their number:
    /// with 0 there are no more.
    pub(super) fn take(
        &mut self,
        bounds: Bounds<'_>,
        ray: usize,
        [from, to]: Interval,
        sample: f64,
    ) -> (f64, f64, f64) {
        let to = to.min(self.exit[ray]);
        match self.intervals {
            Intervals::Bricks => self.run(ray, [from, to], sample),
            Intervals::Cones | Intervals::RayBoxes => {
                while let [at, end] = self.of[ray]
                    && at < end
                    && self.inside[at][0] <= to
                {
                    let [enters, leaves] = self.inside[at];
                    let run = self.run(ray, [from.max(enters), to.min(leaves)], sample);
                    if run.2 > 0.0 {
                        return run;
                    }
                    if leaves > to {
                        break;
                    }
                    self.of[ray][0] += 1;
                }
                (from, 0.0, 0.0)
            }
            Intervals::SampleBoxes => {
                let Some(line) = self.lines[ray] else { return (from, 0.0, 0.0) };
                let (_, _, count) = self.run(ray, [from, to], sample);
                if count == 0.0 {
                    return (from, 0.0, 0.0);
                }
                let next = self.taken[ray];
                let is_inside = |strides: &Strides, number: f64| {
                    let [begin, length] = strides.step(ray, number);
                    let place = line.at((begin + sample * length) * strides.h);
                    // All of them, as that text has it: no tree, and no end at the first that holds it.
                    bounds.boxes.iter().filter(|corners| corners.holds(place)).count() > 0
                };
                let mut first = next - count;
                while first < next && !is_inside(self, first) {
                    first += 1.0;
                }
                let mut end = first;
                while end < next && is_inside(self, end) {
                    end += 1.0;
                }
                // The one after the last is outside, and known to be.
                self.taken[ray] = (end + 1.0).min(next).max(end);
                let [begin, length] = self.step(ray, first);
                (begin, length, end - first)
            }
        }
    }

    /// The steps of a ray that are sampled between two places along it, and not taken yet; takes them.
    fn run(&mut self, ray: usize, [from, to]: Interval, sample: f64) -> (f64, f64, f64) {
        // Rounding of `from`: no step may fall between two bricks.
        let from = from - 1e-4;
        let at = |strides: &Strides, number: f64| {
            let [begin, length] = strides.step(ray, number);
            begin + sample * length
        };
        let about = |place: f64| {
            let steps = ((place - self.entry[ray]) / self.step[ray]).max(0.0);
            let steps = if self.growth == 0.0 {
                steps
            } else {
                libm::log1p(self.growth * steps) / libm::log1p(self.growth)
            };
            (steps - 1.0).floor().max(self.taken[ray])
        };
        let mut first = about(from);
        while at(self, first) < from {
            first += 1.0;
        }
        let mut next = about(to).max(first);
        while at(self, next) < to {
            next += 1.0;
        }
        if next > first {
            self.taken[ray] = next;
        }
        let [begin, length] = self.step(ray, first);
        (begin, length, next - first)
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;

    /// Ends of bricks that are not quite where the next one begins.
    const ENDS: [f64; 6] = [3.0, 9.1, 9.2, 31.0, 40.0, 70.0];

    fn nothing() -> TubeBounds {
        let scene = crate::scene::Scene::parse("", "scene.toml").expect("valid");
        TubeBounds::new(&crate::field::Field::compile(&scene), crate::field::Lattice { voxel_size: 1.0 })
    }

    fn one(growth: f64, intervals: Intervals) -> Strides {
        Strides {
            entry: vec![1.3],
            exit: vec![60.0],
            taken: vec![0.0],
            step: vec![0.37],
            growth,
            intervals,
            h: 0.5,
            lines: vec![Some(Ray { origin: DVec3::ZERO, direction: DVec3::X })],
            inside: vec![],
            of: vec![[0; 2]],
            found: vec![],
        }
    }

    #[test]
    fn steps_go_on_from_brick_to_brick() {
        let tubes = nothing();
        let bounds = Bounds { tubes: &tubes, boxes: &[] };
        for growth in [0.0, 0.05] {
            for sample in [0.0, 0.5] {
                let mut strides = one(growth, Intervals::Bricks);
                let (mut place, mut total) = (1.3, 0.0);
                let mut from = 0.0;
                for end in ENDS {
                    let (begin, length, count) = strides.take(bounds, 0, [from, end], sample);
                    if count > 0.0 {
                        assert!((begin - place).abs() < 1e-9, "{begin}, not {place}");
                        let mut grown = length;
                        for _ in 0..10_000 {
                            if total >= strides.taken[0] {
                                break;
                            }
                            place += grown;
                            grown *= 1.0 + growth;
                            total += 1.0;
                        }
                    }
                    from = end + 1e-6;
                }
                // The last sample is before the exit, and the next would not be.
                let [begin, length] = strides.step(0, total - 1.0);
                assert!(begin + sample * length < 60.0);
                let [begin, length] = strides.step(0, total);
                assert!(begin + sample * length >= 60.0);
            }
        }
    }

    #[test]
    fn all_steps_inside_are_taken_once_and_no_others() {
        let tubes = nothing();
        // Across ends of bricks, several within one, one shorter than a step, and one that overlaps another.
        let inside = [[2.0, 4.5], [9.15, 9.6], [10.0, 10.05], [20.0, 21.0], [20.5, 22.0], [25.0, 65.0]];
        let boxes = inside.map(|[low, high]| Corners {
            low: DVec3::new(0.5 * low, -1.0, -1.0),
            high: DVec3::new(0.5 * high, 1.0, 1.0),
        });
        let bounds = Bounds { tubes: &tubes, boxes: &boxes };
        for growth in [0.0, 0.05] {
            let sample = 0.5;
            for intervals in [Intervals::RayBoxes, Intervals::SampleBoxes] {
                let mut strides = one(growth, intervals);
                strides.inside = inside.to_vec();
                join(&mut strides.inside);
                strides.of = vec![[0, strides.inside.len()]];
                let (mut taken, mut from) = (vec![], 0.0);
                for end in ENDS {
                    loop {
                        let (begin, mut length, count) = strides.take(bounds, 0, [from, end], sample);
                        let mut at = begin;
                        let mut left = count;
                        while left > 0.0 {
                            taken.push(at + sample * length);
                            at += length;
                            length *= 1.0 + growth;
                            left -= 1.0;
                        }
                        if count == 0.0 {
                            break;
                        }
                    }
                    from = end + 1e-6;
                }
                let all = (0..1000_u32).map(|number| {
                    let [begin, length] = strides.step(0, f64::from(number));
                    begin + sample * length
                });
                let wanted: Vec<f64> = all
                    .filter(|at| *at < 60.0 && inside.iter().any(|[low, high]| low <= at && at <= high))
                    .collect();
                assert_eq!(taken.len(), wanted.len(), "{intervals:?}, {growth}");
                assert!(taken.iter().zip(&wanted).all(|(a, b)| (a - b).abs() < 1e-9));
            }
        }
    }
}
