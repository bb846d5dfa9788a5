//! Short capsules that hold all of the density, and the blocks that each can reach.

use glam::DVec3;

use super::tube::{PointKind, Tube};
use super::{EDGE, Extent, Field, Lattice};
use crate::curve::Segment;

/// A short piece of one tube's axis, or one of its end or corner points, with the radius around it.
#[derive(Debug, Clone, Copy)]
pub struct Capsule {
    /// Index of the tube.
    pub(crate) tube: u32,
    /// Index of the segment; of the point, for points.
    pub(crate) part: u32,
    /// Index of the segment's span that the interval lies in.
    pub(crate) span: u32,
    /// Interval of t; empty for points.
    pub(crate) t: [f64; 2],
    pub(crate) radius: f64,
    pub(crate) is_point: bool,
}

/// More capsules than this are never worth having: the voxel is far too small for the scene.
const MOST_CAPSULES: usize = 1 << 24;
/// A block so little before an end's plane, relative to half its edge, is taken to be on it.
const SLIM: f64 = 3e-4;
/// While a list grows it is held with its copy of twice the length.
const GROWTH: u64 = 3;

impl Field {
    /// Capsules that hold all of the density, in the order of the tubes and along them; `None` where there would be more
    /// than 2^24 of them, or to make the list would take more than `budget` bytes.
    pub fn cover(&self, lattice: Lattice, budget: u64) -> Option<Vec<Capsule>> {
        let most = usize::try_from(budget / (GROWTH * size_of::<Capsule>() as u64)).unwrap_or(usize::MAX);
        let most = most.min(MOST_CAPSULES);
        let mut capsules = Vec::new();
        self.each_capsule(lattice, &mut |capsule| {
            (capsule.is_point || capsules.len() < most).then(|| capsules.push(capsule))
        })?;
        Some(capsules)
    }

    /// The budget with which there is room to list so many.
    pub(crate) fn cover_bytes(capsules: usize) -> u64 {
        GROWTH * (size_of::<Capsule>() * capsules) as u64
    }

    /// Calls `visit` with each of these capsules, one after the other, until it gives `None`.
    pub(crate) fn each_capsule(
        &self,
        lattice: Lattice,
        visit: &mut impl FnMut(Capsule) -> Option<()>,
    ) -> Option<()> {
        for (index, tube) in self.tubes.iter().enumerate() {
            let index = u32::try_from(index).ok()?;
            for (part, spans) in tube.spans.iter().enumerate() {
                let part = u32::try_from(part).ok()?;
                for (number, span) in spans.iter().enumerate() {
                    let place = [index, part, u32::try_from(number).ok()?];
                    cover(tube, place, span.core, lattice.voxel_size, visit)?;
                }
            }
            for (part, point) in tube.points.iter().enumerate() {
                let (part, radius) = (u32::try_from(part).ok()?, point.section.radius);
                visit(Capsule { tube: index, part, span: 0, t: [0.0; 2], radius, is_point: true })?;
            }
        }
        Some(())
    }

    /// About how many blocks the density reaches: the volume of the tubes, grown by a block's radius, over a block's.
    pub fn estimate_blocks(&self, lattice: Lattice) -> f64 {
        let h = lattice.voxel_size;
        let grow = Extent::Whole.half_edge() * 3.0_f64.sqrt();
        let mut blocks = 0.0;
        for tube in &self.tubes {
            for (index, spans) in tube.spans.iter().enumerate() {
                for span in spans {
                    let arc = span.core.map(|t| tube.curve.arc_length(index, t));
                    let x = arc.map(|s| s / tube.curve.length());
                    let [low, high] = tube.radius.range(x);
                    let radius = 0.5 * (low + high) / h + grow;
                    blocks += std::f64::consts::PI * radius * radius * ((arc[1] - arc[0]) / h) / 512.0;
                }
            }
        }
        blocks
    }
}

/// Halves the interval until a piece is one to two and a half blocks long. `place` are the indices of tube, segment and span.
fn cover(
    tube: &Tube,
    place: [u32; 3],
    t: [f64; 2],
    h: f64,
    visit: &mut impl FnMut(Capsule) -> Option<()>,
) -> Option<()> {
    let [index, part, span] = place;
    let arc = t.map(|t| tube.curve.arc_length(part as usize, t));
    let middle = 0.5 * (t[0] + t[1]);
    #[allow(clippy::cast_precision_loss, reason = "eight")]
    if arc[1] - arc[0] > 2.5 * EDGE as f64 * h && middle > t[0] && middle < t[1] {
        cover(tube, place, [t[0], middle], h, visit)?;
        return cover(tube, place, [middle, t[1]], h, visit);
    }
    let x = arc.map(|s| s / tube.curve.length());
    let [_, radius] = tube.radius.range(x);
    visit(Capsule { tube: index, part, span, t, radius, is_point: false })
}

/// Bounds of a segment's derivatives over an interval.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Reach {
    pub(crate) half: f64,
    pub(crate) centre: DVec3,
    pub(crate) d1: DVec3,
    pub(crate) d2: DVec3,
    /// Largest |C'|, |C''| and |C'''| on the interval.
    pub(crate) speed: f64,
    pub(crate) bend: f64,
    pub(crate) third: f64,
}

impl Reach {
    /// Of a point.
    pub(crate) fn still(centre: DVec3) -> Reach {
        Reach { half: 0.0, centre, d1: DVec3::ZERO, d2: DVec3::ZERO, speed: 0.0, bend: 0.0, third: 0.0 }
    }

    pub(crate) fn new(segment: &Segment, t: [f64; 2]) -> Reach {
        let (middle, half) = (0.5 * (t[0] + t[1]), 0.5 * (t[1] - t[0]));
        let (d1, d2, third) = (segment.d1(middle), segment.d2(middle), segment.d3().length());
        Reach {
            half,
            centre: segment.at(middle),
            d1,
            d2,
            speed: d1.length() + half * d2.length() + 0.5 * half * half * third,
            bend: d2.length() + half * third,
            third,
        }
    }

    /// Whether certainly no voxel centre of the block around `o` is within `radius` of the interval.
    pub(crate) fn is_far(&self, o: DVec3, half_edge: f64, radius: f64) -> bool {
        // The interval stays this close to the straight piece `centre +- half d1`.
        let reach = radius + 0.5 * self.half * self.half * self.bend;
        let (to_block, along) = (o - self.centre, self.d1 * self.half);
        let outside = (to_block.abs() - along.abs() - DVec3::splat(half_edge)).max(DVec3::ZERO);
        if outside.length_squared() > reach * reach {
            return true;
        }
        let squared = along.length_squared();
        let nearest = if squared > 0.0 { (to_block.dot(along) / squared).clamp(-1.0, 1.0) } else { 0.0 };
        let ball = reach + half_edge * 3.0_f64.sqrt();
        (to_block - along * nearest).length_squared() > ball * ball
    }

    /// Largest |g'| over the interval and the block, where `g(t) = (C(t) - p) . C'(t)`.
    pub(crate) fn slope(&self, distance: f64) -> f64 {
        self.speed * self.speed + (distance + self.half * self.speed) * self.bend
    }
}

/// Half the extent of the block along `v`, for half edges of 1.
pub(crate) fn support(v: DVec3) -> f64 {
    v.x.abs() + v.y.abs() + v.z.abs()
}

impl Capsule {
    /// Calls `visit` with the coordinates, in blocks, of every block in which a place may have its foot here.
    ///
    /// Complete: a block with a place, in its `extent`, within the radius of a foot in this interval, or of the point on
    /// its outer side, is visited. Visits no block twice.
    pub fn blocks(&self, field: &Field, lattice: Lattice, extent: Extent, mut visit: impl FnMut([i64; 3])) {
        self.near(field, lattice, extent).visit(|block, _| visit(block));
    }

    /// What decides whether a place of a block may have its foot here.
    pub(crate) fn near<'a>(&'a self, field: &'a Field, lattice: Lattice, extent: Extent) -> Near<'a> {
        let tube = &field.tubes[self.tube as usize];
        let h = lattice.voxel_size;
        let half_edge = extent.half_edge() * h;
        let (reach, normal, slack) = if self.is_point {
            let section = &tube.points[self.part as usize].section;
            (Reach::still(section.centre), DVec3::ZERO, 0.0)
        } else {
            let reach = Reach::new(&tube.curve.segments()[self.part as usize], self.t);
            // A voxel within the radius of a foot in the interval is this far from the interval's middle at most.
            let distance = self.radius + reach.half * reach.speed;
            (reach, reach.d1, reach.half * reach.slope(distance) * (1.0 + 1e-9))
        };
        let slab = Slab {
            centre: reach.centre,
            extent: self.radius + reach.half * reach.speed + half_edge,
            normal,
            slack: slack + half_edge * support(normal),
            edge: 8.0 * h,
        };
        Near { capsule: self, tube, reach, half_edge, slab }
    }

    /// For points: whether the block has voxels on the side where the point is their foot.
    pub(crate) fn faces(&self, tube: &Tube, o: DVec3, half_edge: f64) -> bool {
        if !self.is_point {
            return true;
        }
        let point = &tube.points[self.part as usize];
        let beyond =
            |v: DVec3| (o - point.section.centre).dot(v) + half_edge * support(v) >= -SLIM * half_edge;
        match point.kind {
            PointKind::End(outward) => beyond(outward),
            PointKind::Corner(next) => beyond(point.section.tangent) && beyond(-next),
        }
    }
}

/// The blocks in which a place may have its foot in one capsule.
pub(crate) struct Near<'a> {
    capsule: &'a Capsule,
    tube: &'a Tube,
    reach: Reach,
    half_edge: f64,
    slab: Slab,
}

impl Near<'_> {
    /// Calls `visit` with the coordinates, in blocks, and the centre of each.
    pub(crate) fn visit(&self, mut visit: impl FnMut([i64; 3], DVec3)) {
        self.slab.visit(|block, o| {
            if self.faces(o) {
                visit(block, o);
            }
        });
    }

    /// Whether a block, centred at `o`, is one of them.
    pub(crate) fn reaches(&self, block: [i64; 3], o: DVec3) -> bool {
        self.slab.holds(block, o) && self.faces(o)
    }

    fn faces(&self, o: DVec3) -> bool {
        !self.reach.is_far(o, self.half_edge, self.capsule.radius)
            && self.capsule.faces(self.tube, o, self.half_edge)
    }
}

/// Blocks of edge `edge` whose centre lies within `extent` of `centre` along every axis and within `slack` of the plane
/// through `centre` across `normal` (measured as `|(o - centre) . normal|`).
struct Slab {
    centre: DVec3,
    extent: f64,
    normal: DVec3,
    slack: f64,
    edge: f64,
}

#[allow(
    clippy::cast_possible_truncation,
    reason = "block coordinates are checked to fit before bricks are planned"
)]
impl Slab {
    /// Visits them row by row along the normal's largest component, so that a thin slab of a wide disc costs its own size
    /// only.
    fn visit(&self, mut visit: impl FnMut([i64; 3], DVec3)) {
        let [along, first, second] = self.axes();
        for i in self.range(first).0..=self.range(first).1 {
            for j in self.range(second).0..=self.range(second).1 {
                let mut o = DVec3::ZERO;
                o[first] = self.place(i);
                o[second] = self.place(j);
                let (low, high) = self.row(o);
                for k in low..=high {
                    o[along] = self.place(k);
                    let mut block = [0; 3];
                    (block[first], block[second], block[along]) = (i, j, k);
                    visit(block, o);
                }
            }
        }
    }

    /// Whether a block, centred at `o`, is one of them.
    fn holds(&self, block: [i64; 3], o: DVec3) -> bool {
        let [along, first, second] = self.axes();
        let within = |(low, high): (i64, i64), axis: usize| low <= block[axis] && block[axis] <= high;
        within(self.range(first), first) && within(self.range(second), second) && within(self.row(o), along)
    }

    /// The axis that rows run along, and the others.
    fn axes(&self) -> [usize; 3] {
        let along = self.normal.abs().max_position();
        [along, (along + 1) % 3, (along + 2) % 3]
    }

    /// Block b is centred at (b + 1/2) edge.
    fn place(&self, b: i64) -> f64 {
        (b as f64 + 0.5) * self.edge
    }

    fn range(&self, axis: usize) -> (i64, i64) {
        let place = self.centre[axis] / self.edge - 0.5;
        ((place - self.extent / self.edge).floor() as i64, (place + self.extent / self.edge).ceil() as i64)
    }

    /// The part of a row that lies in the slab; of `o` the coordinates across the row are read.
    fn row(&self, o: DVec3) -> (i64, i64) {
        let [along, first, second] = self.axes();
        let (centre, normal) = (self.centre, self.normal);
        let (low, high) = self.range(along);
        let steepness = normal[along];
        if steepness == 0.0 {
            return (low, high);
        }
        let rest = (o[first] - centre[first]) * normal[first] + (o[second] - centre[second]) * normal[second];
        let ends = [(-self.slack - rest) / steepness, (self.slack - rest) / steepness];
        let to_block = |x: f64| (centre[along] + x) / self.edge - 0.5;
        (
            low.max(to_block(ends[0].min(ends[1])).floor() as i64),
            high.min(to_block(ends[0].max(ends[1])).ceil() as i64),
        )
    }
}
