//! Single rays on their way through a medium: nodes of 16^3 bricks, in them bricks, in these cells.
//!
//! On each level a ray goes from one cube to the next by whichever face it crosses first (Amanatides and Woo, "A fast voxel
//! traversal algorithm for ray tracing", 1987). Crossings are found from the cubes' whole coordinates anew each time, so
//! rounding does not add up. A cube holds its lower faces and not its upper ones: a ray in a face is in one cube.

use glam::DVec3;

use super::grid::{EDGE, GridRay};
use super::nodes::{NODE, Nodes};

/// Cells along an edge of a node.
const NODE_CELLS: i32 = NODE * EDGE;

/// A straight line in a grid's space; places along it are in metres.
#[derive(Debug, Clone, Copy)]
pub(super) struct Line {
    pub(super) origin: DVec3,
    /// Cells a metre.
    pub(super) rate: DVec3,
    /// Metres a cell along each axis, with its sign; infinite along an axis that the line is at right angles to.
    inverse: DVec3,
}

impl Line {
    pub(super) fn new(ray: &GridRay) -> Line {
        let rate = ray.direction / ray.metres;
        // Less than a cell in 1e30 m is nothing, and its inverse might be no number.
        let inverse = rate.to_array().map(|rate| if rate.abs() < 1e-30 { f64::INFINITY } else { 1.0 / rate });
        Line { origin: ray.origin, rate, inverse: inverse.into() }
    }

    pub(super) fn at(&self, t: f64) -> DVec3 {
        self.origin + self.rate * t
    }

    /// The same line from another cell's corner.
    fn from(&self, corner: DVec3) -> Line {
        Line { origin: self.origin - corner, ..*self }
    }

    /// The part of `range` that lies between two corners, the upper faces left out; `None` where that is nothing.
    fn clip(&self, range: [f64; 2], low: DVec3, high: DVec3) -> Option<[f64; 2]> {
        let [mut begin, mut end] = range;
        for axis in 0..3 {
            if self.inverse[axis].is_infinite() {
                if self.origin[axis] < low[axis] || self.origin[axis] >= high[axis] {
                    return None;
                }
                continue;
            }
            let near = (low[axis] - self.origin[axis]) * self.inverse[axis];
            let far = (high[axis] - self.origin[axis]) * self.inverse[axis];
            begin = begin.max(near.min(far));
            end = end.min(near.max(far));
        }
        (begin < end).then_some([begin, end])
    }
}

/// Cubes of `E` cells' edge along a line, one after the other.
#[derive(Debug, Clone, Copy)]
struct Cubes<const E: i32> {
    /// The next one, in units of its edge.
    at: [i32; 3],
    begin: f64,
    end: f64,
}

impl<const E: i32> Cubes<E> {
    /// Those between `low` and `high`, in units of their edges, where the line is from one place to another.
    fn new(line: &Line, [begin, end]: [f64; 2], low: [i32; 3], high: [i32; 3]) -> Cubes<E> {
        let place = line.at(begin) / f64::from(E);
        let mut at = low;
        for axis in 0..3 {
            #[allow(
                clippy::cast_possible_truncation,
                reason = "saturates, and is brought back to the bounds"
            )]
            let cube = place[axis].floor() as i32;
            at[axis] = cube.clamp(low[axis], high[axis]);
        }
        Cubes { at, begin, end }
    }

    fn next(&mut self, line: &Line) -> Option<([i32; 3], [f64; 2])> {
        while self.begin < self.end {
            let (mut crossing, mut across) = (self.end, None);
            for axis in 0..3 {
                let step = i32::from(line.rate[axis] > 0.0);
                if line.inverse[axis].is_finite() {
                    let face = (f64::from(self.at[axis]) + f64::from(step)) * f64::from(E);
                    let place = (face - line.origin[axis]) * line.inverse[axis];
                    if place < crossing {
                        (crossing, across) = (place, Some((axis, 2 * step - 1)));
                    }
                }
            }
            let (at, begin) = (self.at, self.begin);
            self.begin = crossing.max(begin);
            if let Some((axis, step)) = across {
                self.at[axis] = self.at[axis].saturating_add(step);
            }
            if self.begin > begin {
                return Some((at, [begin, self.begin]));
            }
        }
        None
    }
}

/// A brick on a ray's way.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Step {
    pub(super) brick: usize,
    pub(super) block: [i32; 3],
    /// Where the ray is in it, metres.
    pub(super) begin: f64,
    pub(super) end: f64,
}

impl Step {
    /// A place along a line, in cells from the brick's corner.
    pub(super) fn local(&self, line: &Line, t: f64) -> DVec3 {
        (line.at(t) - corner(self.block)).clamp(DVec3::ZERO, DVec3::splat(f64::from(EDGE)))
    }
}

fn corner(block: [i32; 3]) -> DVec3 {
    DVec3::from(block.map(|c| f64::from(c) * f64::from(EDGE)))
}

/// A ray's bricks, in order.
#[derive(Debug, Clone, Copy)]
pub(super) struct Walk {
    pub(super) line: Line,
    nodes: Cubes<NODE_CELLS>,
    /// The node that the ray is in: its number and where it is.
    node: usize,
    at: [i32; 3],
    bricks: Cubes<EDGE>,
}

impl Walk {
    /// From one place along a ray to another, in metres, both at least 0; the second may be infinite.
    pub(super) fn new(nodes: &Nodes, ray: &GridRay, range: [f64; 2]) -> Walk {
        let line = Line::new(ray);
        let nothing = [0.0; 2];
        let none = [0; 3];
        let mut walk = Walk {
            line,
            nodes: Cubes::new(&line, nothing, none, none),
            node: 0,
            at: none,
            bricks: Cubes::new(&line, nothing, none, none),
        };
        let Some([low, high]) = nodes.bounds() else { return walk };
        let edge = f64::from(NODE_CELLS);
        let corners = [low, high.map(|c| c + 1)].map(|at| DVec3::from(at.map(|c| f64::from(c) * edge)));
        if let Some(range) = line.clip(range, corners[0], corners[1]) {
            walk.nodes = Cubes::new(&line, range, low, high);
        }
        walk
    }

    pub(super) fn next(&mut self, nodes: &Nodes) -> Option<Step> {
        loop {
            while let Some((block, [begin, end])) = self.bricks.next(&self.line) {
                // Rounding may let a ray leave the node a little early.
                if block.map(|c| c.div_euclid(NODE)) == self.at
                    && let Some(brick) = nodes.brick(self.node, block)
                {
                    return Some(Step { brick, block, begin, end });
                }
            }
            let (at, range) = self.nodes.next(&self.line)?;
            if let Some(node) = nodes.node(at) {
                (self.node, self.at) = (node, at);
                let first = at.map(|c| c * NODE);
                self.bricks = Cubes::new(&self.line, range, first, first.map(|c| c + NODE - 1));
            }
        }
    }
}

/// The cells of a brick's part of a line.
#[derive(Debug, Clone, Copy)]
pub(super) struct Cells {
    local: Line,
    cells: Cubes<1>,
}

impl Cells {
    pub(super) fn new(line: &Line, step: &Step) -> Cells {
        let local = line.from(corner(step.block));
        let cells = Cubes::new(&local, [step.begin, step.end], [0; 3], [EDGE - 1; 3]);
        Cells { local, cells }
    }

    /// The next one, from 0 to 7 along each axis, and where the line is in it.
    pub(super) fn next(&mut self) -> Option<([usize; 3], [f64; 2])> {
        let (cell, range) = self.cells.next(&self.local)?;
        Some((cell.map(|c| c.clamp(0, EDGE - 1).unsigned_abs() as usize), range))
    }

    /// The same as [`integral`] over a part of the line in one of them.
    pub(super) fn integral(
        &self,
        cell: [usize; 3],
        [begin, end]: [f64; 2],
        value: impl Fn([usize; 3], DVec3) -> f64,
    ) -> f64 {
        let length = end - begin;
        #[allow(clippy::cast_precision_loss, reason = "0 to 7")]
        let from = DVec3::from(cell.map(|c| c as f64));
        let sample = |gauss: f64| {
            let place = (self.local.at(begin + gauss * length) - from).clamp(DVec3::ZERO, DVec3::ONE);
            0.5 * length * value(cell, place)
        };
        super::segment::GAUSS.map(sample).iter().sum()
    }
}

/// The integral over a brick's part of a line of what is linear along each axis in every cell: cell by cell, where it is a
/// polynomial of degree 3, by Gauss's rule with two samples, which is exact for that. `value` gives it for a cell, from 0
/// to 7 along each axis, and a place in it from 0 to 1. `enough` ends the sum early.
pub(super) fn integral(
    line: &Line,
    step: &Step,
    enough: f64,
    value: impl Fn([usize; 3], DVec3) -> f64,
) -> f64 {
    let mut cells = Cells::new(line, step);
    let mut sum = 0.0;
    while sum < enough
        && let Some((cell, range)) = cells.next()
    {
        sum += cells.integral(cell, range, &value);
    }
    sum
}
