//! Bezier chains: position, exact arc length, frames that do not twist, and the radius that goes along them.

mod chain;
mod frame;
mod length;
mod polynomial;
mod profile;
mod segment;
#[cfg(test)]
mod testing;
mod transport;

pub use chain::{Curve, CurveError};
pub use frame::{Frame, FrameRule};
pub use profile::{Profile, ProfileError};
pub use segment::Segment;
