//! What the tests of curves share.

use super::Segment;
use glam::{DVec3, dvec3};

/// The splitmix64 generator.
pub(super) struct Random(pub u64);

impl Random {
    /// Uniform in [0, 1).
    pub(super) fn unit(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        // The upper half of the bits is enough for a test.
        f64::from(u32::try_from((z ^ (z >> 31)) >> 32).unwrap_or(0)) / 4_294_967_296.0
    }

    /// Uniform in the cube from -1 to 1.
    pub(super) fn point(&mut self) -> DVec3 {
        dvec3(self.unit(), self.unit(), self.unit()) * 2.0 - DVec3::ONE
    }

    pub(super) fn quadratic(&mut self) -> Segment {
        Segment::quadratic([self.point(), self.point(), self.point()])
    }

    pub(super) fn cubic(&mut self) -> Segment {
        Segment::cubic([self.point(), self.point(), self.point(), self.point()])
    }
}

/// The part of a segment from t = a to t = b, as a cubic.
pub(super) fn part(segment: &Segment, a: f64, b: f64) -> Segment {
    let third = (b - a) / 3.0;
    let (p, q) = (segment.at(a), segment.at(b));
    Segment::cubic([p, p + third * segment.d1(a), q - third * segment.d1(b), q])
}

/// The segment run through from its end to its start.
pub(super) fn reversed(segment: &Segment) -> Segment {
    part(segment, 1.0, 0.0)
}
