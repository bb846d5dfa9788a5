//! Frames along a curve.

use glam::DVec3;

/// Which frame carries the cross-section along the curve.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FrameRule {
    /// Turns about the tangent as little as it can.
    RotationMinimising,
    /// The principal normal; carried on without turning where there is none.
    Frenet,
}

/// A right-handed orthonormal frame: `normal x binormal = tangent`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Frame {
    /// Unit tangent.
    pub tangent: DVec3,
    /// Where the cylinder's u axis points before twist.
    pub normal: DVec3,
    /// Where the cylinder's v axis points before twist.
    pub binormal: DVec3,
}
