//! One Bezier segment.

use glam::DVec3;

/// A quadratic or cubic Bezier segment, t in [0, 1], held in power form.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Segment {
    /// `C(t) = c[0] + c[1] t + c[2] t^2 + c[3] t^3`, metres.
    c: [DVec3; 4],
}
