//! Bezier chains: position, exact arc length, frames that do not twist, and the radius that goes along them.

mod chain;
mod frame;
mod length;
mod profile;
mod segment;

pub use chain::{Curve, CurveError};
pub use frame::{Frame, FrameRule};
pub use profile::Profile;
pub use segment::Segment;
