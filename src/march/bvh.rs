//! A tree of boxes around bodies in space.

use glam::DVec3;

/// Bodies of a leaf at most.
const LEAF: usize = 4;
/// Nodes on the way down at most: halves of what fits into memory.
const DEEPEST: usize = 64;

/// A box, by its corners.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Corners {
    pub(super) low: DVec3,
    pub(super) high: DVec3,
}

impl Corners {
    pub(super) const NONE: Corners = Corners { low: DVec3::INFINITY, high: DVec3::NEG_INFINITY };

    pub(super) fn with(self, other: Corners) -> Corners {
        Corners { low: self.low.min(other.low), high: self.high.max(other.high) }
    }

    /// Distance of a point, 0 within.
    pub(super) fn distance(&self, point: DVec3) -> f64 {
        (self.low - point).max(point - self.high).max(DVec3::ZERO).length()
    }

    pub(super) fn meets(&self, other: &Corners) -> bool {
        self.low.cmple(other.high).all() && other.low.cmple(self.high).all()
    }

    pub(super) fn holds(&self, point: DVec3) -> bool {
        self.low.cmple(point).all() && point.cmple(self.high).all()
    }

    /// Whether the line through `origin`, with `inverse` the reciprocal of its direction, may be within, from `t = 0` on.
    #[inline]
    pub(super) fn is_met(&self, origin: DVec3, inverse: DVec3) -> bool {
        self.interval(origin, inverse).is_some()
    }

    /// From where to where it is.
    #[inline]
    pub(super) fn interval(&self, origin: DVec3, inverse: DVec3) -> Option<[f64; 2]> {
        let (mut enters, mut leaves) = (0.0_f64, f64::INFINITY);
        for axis in 0..3 {
            let near = (self.low[axis] - origin[axis]) * inverse[axis];
            let far = (self.high[axis] - origin[axis]) * inverse[axis];
            // Not a number where a parallel ray lies in a face's plane: that face then cuts nothing off.
            if near <= far {
                (enters, leaves) = (enters.max(near), leaves.min(far));
            } else if far < near {
                (enters, leaves) = (enters.max(far), leaves.min(near));
            }
        }
        // Rounding of these three products and differences.
        (enters <= leaves * (1.0 + 1e-14) + f64::MIN_POSITIVE).then_some([enters, leaves.max(enters)])
    }
}

#[derive(Debug, Clone, Copy)]
struct Node {
    corners: Corners,
    /// Of a leaf, the bodies `from..to` of the order; else the nodes `from` and `to`.
    from: u32,
    to: u32,
    is_leaf: bool,
}

/// The tree: each node's bodies are halved where their middles' median is along the longest side of the box of these.
#[derive(Debug, Clone, Default)]
pub(super) struct Bvh {
    nodes: Vec<Node>,
    /// Numbers of bodies.
    order: Vec<u32>,
}

impl Bvh {
    pub(super) fn new(boxes: &[Corners]) -> Bvh {
        let order: Vec<u32> = (0..).take(boxes.len()).collect();
        let mut bvh = Bvh { nodes: Vec::with_capacity(boxes.len()), order };
        if !boxes.is_empty() {
            bvh.divide(boxes, 0, boxes.len());
        }
        bvh
    }

    /// Makes the node of a part of the order, and those below it; returns its number.
    fn divide(&mut self, boxes: &[Corners], from: usize, to: usize) -> u32 {
        let of = |body: u32| boxes[body as usize];
        let part = &mut self.order[from..to];
        let corners = part.iter().fold(Corners::NONE, |all, body| all.with(of(*body)));
        let number = self.nodes.len();
        let [first, last] = [from, to].map(|n| u32::try_from(n).unwrap_or(u32::MAX));
        self.nodes.push(Node { corners, from: first, to: last, is_leaf: true });
        if to - from > LEAF {
            let middle = |body: u32| of(body).low + of(body).high;
            let around = part.iter().fold(Corners::NONE, |all, body| {
                all.with(Corners { low: middle(*body), high: middle(*body) })
            });
            let axis = (around.high - around.low).max_position();
            let half = from + (to - from) / 2;
            // Bodies at one place are told apart by their numbers, so that there is one tree only.
            part.select_nth_unstable_by(half - from, |a, b| {
                middle(*a)[axis].total_cmp(&middle(*b)[axis]).then(a.cmp(b))
            });
            let children = [self.divide(boxes, from, half), self.divide(boxes, half, to)];
            let node = &mut self.nodes[number];
            [node.from, node.to] = children;
            node.is_leaf = false;
        }
        u32::try_from(number).unwrap_or(u32::MAX)
    }

    /// The box around everything.
    pub(super) fn corners(&self) -> Option<Corners> {
        self.nodes.first().map(|root| root.corners)
    }

    /// Calls `visit` with every body in whose leaf's box, and in all boxes around it, `enters` finds something. What it
    /// finds may depend on earlier visits.
    pub(super) fn visit<S>(
        &self,
        state: &mut S,
        enters: impl Fn(&S, &Corners) -> bool,
        mut visit: impl FnMut(&mut S, usize),
    ) {
        let mut stack = [0_u32; DEEPEST];
        let mut height = usize::from(!self.nodes.is_empty());
        while height > 0 {
            height -= 1;
            let node = &self.nodes[stack[height] as usize];
            if !enters(state, &node.corners) {
                continue;
            }
            if node.is_leaf {
                for body in &self.order[node.from as usize..node.to as usize] {
                    visit(state, *body as usize);
                }
            } else {
                // Halves are halved: the tree is never as deep as the stack.
                (stack[height], stack[height + 1]) = (node.to, node.from);
                height += 2;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::volume::testing::unit;

    fn boxes(count: usize, state: &mut u64) -> Vec<Corners> {
        let mut point = || DVec3::new(unit(state), unit(state), unit(state)) * 2.0 - 1.0;
        (0..count)
            .map(|_| {
                let (low, size) = (point() * 10.0, point().abs());
                Corners { low, high: low + size }
            })
            .collect()
    }

    #[test]
    fn it_finds_what_looking_at_every_box_finds() {
        let mut state = 5;
        for count in [0, 1, 4, 5, 17, 300] {
            let boxes = boxes(count, &mut state);
            let bvh = Bvh::new(&boxes);
            for _ in 0..200 {
                let mut coordinate = || (unit(&mut state) * 2.0 - 1.0) * 12.0;
                let origin = DVec3::new(coordinate(), coordinate(), coordinate());
                let direction = DVec3::new(coordinate(), coordinate(), coordinate()).normalize();
                let inverse = direction.recip();
                let mut found = Vec::new();
                bvh.visit(
                    &mut found,
                    |_, corners| corners.is_met(origin, inverse),
                    |found, body| {
                        if boxes[body].is_met(origin, inverse) {
                            found.push(body);
                        }
                    },
                );
                found.sort_unstable();
                let all: Vec<usize> = (0..count).filter(|n| boxes[*n].is_met(origin, inverse)).collect();
                assert_eq!(found, all);
            }
        }
    }

    #[test]
    fn rays_along_axes_and_in_faces_meet_boxes() {
        let corners = Corners { low: DVec3::ZERO, high: DVec3::ONE };
        for (origin, direction, met) in [
            (DVec3::new(-1.0, 0.5, 0.5), DVec3::X, true),
            (DVec3::new(-1.0, 0.0, 0.5), DVec3::X, true),
            (DVec3::new(-1.0, 1.0, 1.0), DVec3::X, true),
            (DVec3::new(-1.0, 1.1, 0.5), DVec3::X, false),
            (DVec3::new(2.0, 0.5, 0.5), DVec3::X, false),
            (DVec3::new(2.0, 0.5, 0.5), DVec3::NEG_X, true),
            (DVec3::splat(0.5), DVec3::Y, true),
        ] {
            assert_eq!(corners.is_met(origin, direction.recip()), met, "{origin}, {direction}");
        }
    }
}
