//! Rays through what is compared, and their way through the cells of a lattice.

use std::f64::consts::PI;

use glam::DVec3;

use super::random::unit;
use super::support::Support;

/// A stretch of a straight line in the world.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Chord {
    /// A point of the line, in metres.
    pub origin: DVec3,
    /// Its direction, of length 1.
    pub direction: DVec3,
    /// Where the stretch begins and ends, in metres from the origin along the direction.
    pub range: [f64; 2],
}

impl Chord {
    /// Places and weights of a rule over equal stretches of a range, none longer than `step`, in metres.
    pub(super) fn stretches(
        &self,
        [from, to]: [f64; 2],
        step: f64,
        rule: &[[f64; 2]],
    ) -> impl Iterator<Item = (DVec3, f64)> {
        let pieces = ((to - from) / step).ceil().max(1.0);
        let length = (to - from) / pieces;
        let place = move |(piece, place): (f64, f64)| {
            self.origin + self.direction * (from + (piece + place) * length)
        };
        let numbers = std::iter::successors(Some(0.0), move |piece| Some(piece + 1.0));
        numbers.take_while(move |piece| *piece < pieces).flat_map(move |piece| {
            rule.iter().map(move |[at, weight]| (place((piece, *at)), weight * length))
        })
    }
}

/// Chords of a box, each through one of `points` in a direction of its own, all directions alike: `count` of them, or as many
/// as there are points.
pub fn chords(bounds: [DVec3; 2], points: &[DVec3], count: usize) -> Vec<Chord> {
    const STREAM: u64 = 0x7261_7973;
    let count = count.min(points.len());
    let chord = |n: usize| {
        let origin = points[n * points.len() / count];
        let [height, turn] = [0, 1].map(|part| unit(STREAM, 2 * n as u64 + part));
        let z = 2.0 * height - 1.0;
        let radius = (1.0 - z * z).sqrt();
        let (sin, cos) = libm::sincos(2.0 * PI * turn);
        let direction = DVec3::new(radius * cos, radius * sin, z);
        let range = clip(origin, direction, bounds, [f64::NEG_INFINITY, f64::INFINITY])?;
        range.iter().all(|t| t.is_finite()).then_some(Chord { origin, direction, range })
    };
    (0..count).filter_map(chord).collect()
}

/// The part of a range of `origin + t step` that lies in a box.
pub(super) fn clip(
    origin: DVec3,
    step: DVec3,
    [low, high]: [DVec3; 2],
    mut range: [f64; 2],
) -> Option<[f64; 2]> {
    for axis in 0..3 {
        if step[axis] == 0.0 {
            if origin[axis] < low[axis] || origin[axis] > high[axis] {
                return None;
            }
            continue;
        }
        let ends = [low, high].map(|face| (face[axis] - origin[axis]) / step[axis]);
        range = [range[0].max(ends[0].min(ends[1])), range[1].min(ends[0].max(ends[1]))];
    }
    (range[0] < range[1]).then_some(range)
}

/// The box around a support as a chord meets it, in a lattice's coordinates.
pub(super) fn within(support: &Support, chord: &Chord, margin: f64) -> Option<([DVec3; 2], [f64; 2])> {
    let [low, high] = support.index_bounds()?;
    let origin = support.to_index().index(chord.origin);
    // The map is affine.
    let step = support.to_index().index(chord.origin + chord.direction) - origin;
    let range = clip(origin, step, [low - margin, high + margin], chord.range)?;
    Some(([origin, step], range))
}

/// The way of `origin + t step` through cells of edge 1, of which several may be passed at once.
#[derive(Debug)]
pub(super) struct Walk {
    origin: DVec3,
    step: DVec3,
    t: f64,
    end: f64,
    cell: [i64; 3],
    /// Boxes that may still be left: no more than faces are crossed, but where double precision does not hold the places.
    left: f64,
}

impl Walk {
    pub(super) fn new([origin, step]: [DVec3; 2], [t, end]: [f64; 2]) -> Walk {
        let cell = whole((origin + step * t).floor());
        let left = (step * (end - t)).abs().element_sum() + 8.0;
        Walk { origin, step, t, end, cell, left }
    }

    /// The cell from whose near face the walk goes on; `None` at the end.
    pub(super) fn cell(&self) -> Option<[i64; 3]> {
        (self.t < self.end && self.left > 0.0).then_some(self.cell)
    }

    /// The same way through a lattice this many times as fine.
    pub(super) fn scaled(&self, finer: f64) -> Walk {
        Walk::new([self.origin * finer, self.step * finer], [self.t, self.end])
    }

    /// How far it has come.
    pub(super) fn t(&self) -> f64 {
        self.t
    }

    pub(super) fn at(&self, t: f64) -> DVec3 {
        self.origin + self.step * t
    }

    /// Leaves a box that holds the cell, from its first cell to before the others: the range of t in it.
    #[allow(clippy::cast_precision_loss, reason = "indices of voxels, below 2^33")]
    pub(super) fn leave(&mut self, [first, end]: [[i64; 3]; 2]) -> [f64; 2] {
        self.left -= 1.0;
        let (mut exit, mut across) = (f64::INFINITY, None);
        for axis in 0..3 {
            let face = match self.step[axis] {
                step if step > 0.0 => end[axis],
                step if step < 0.0 => first[axis],
                _ => continue,
            };
            let t = (face as f64 - self.origin[axis]) / self.step[axis];
            if t < exit {
                (exit, across) = (t, Some(axis));
            }
        }
        // Rounding may put a face before the place where the walk is.
        let range = [self.t, exit.clamp(self.t, self.end.max(self.t))];
        self.t = if exit < self.end { range[1] } else { self.end };
        let at = whole(self.at(self.t).floor());
        for axis in 0..3 {
            self.cell[axis] = if across == Some(axis) {
                if self.step[axis] > 0.0 { end[axis] } else { first[axis] - 1 }
            } else {
                at[axis].clamp(first[axis], (end[axis] - 1).max(first[axis]))
            };
        }
        range
    }
}

/// Far beyond all indices the nearest that leave room to count on.
#[allow(clippy::cast_possible_truncation, reason = "limited before")]
fn whole(v: DVec3) -> [i64; 3] {
    const FAR: f64 = 1e12;
    v.to_array().map(|c| c.clamp(-FAR, FAR) as i64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn walks_pass_every_cell_once() {
        for n in 0..200 {
            let number = |part: u64| unit(n, part);
            let origin = DVec3::new(number(0), number(1), number(2)) * 4.0 - 2.0;
            let mut step = DVec3::new(number(3), number(4), number(5)) * 2.0 - 1.0;
            if n % 7 == 0 {
                step.x = 0.0;
            }
            let range = [-30.0, 30.0];
            let mut walk = Walk::new([origin, step], range);
            let mut last = range[0];
            let mut steps = 0;
            while let Some(cell) = walk.cell() {
                // Cells beyond x = 8 are passed eight at a time along x.
                let wide = cell[0] >= 8;
                let first = [if wide { cell[0] & !7 } else { cell[0] }, cell[1], cell[2]];
                let end = [first[0] + if wide { 8 } else { 1 }, first[1] + 1, first[2] + 1];
                let [from, to] = walk.leave([first, end]);
                assert_eq!(from, last);
                let middle = walk.at(0.5 * (from + to));
                for axis in 0..3 {
                    #[allow(clippy::cast_precision_loss, reason = "small")]
                    let [low, high] = [first[axis] as f64 - 1e-9, end[axis] as f64 + 1e-9];
                    assert!(middle[axis] >= low && middle[axis] <= high, "{n} {middle} {first:?}");
                }
                last = to;
                steps += 1;
            }
            assert_eq!(last, range[1]);
            assert!(steps > 5 && steps < 300, "{steps}");
        }
    }

    #[test]
    fn chords_cross_the_box_through_the_points() {
        let bounds = [DVec3::ZERO, DVec3::new(1.0, 2.0, 3.0)];
        let points: Vec<_> = (0..100).map(|n| bounds[1] * unit(9, n)).collect();
        let chords = chords(bounds, &points, 50);
        assert_eq!(chords.len(), 50);
        let mut sum = DVec3::ZERO;
        for Chord { origin, direction, range: [from, to] } in &chords {
            assert!((direction.length() - 1.0).abs() < 1e-15 && *from <= 0.0 && *to >= 0.0);
            for end in [from, to].map(|t| *origin + *direction * *t) {
                let face = |axis: usize| end[axis].abs().min((end[axis] - bounds[1][axis]).abs()) < 1e-12;
                assert!((0..3).any(face), "{end}");
            }
            sum += *direction;
        }
        // Five standard deviations of a mean of 50 directions.
        assert!((sum / 50.0).abs().max_element() < 5.0 * 0.577 / 7.07, "{sum}");
    }
}
