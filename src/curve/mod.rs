//! Bezier chains, open and closed, and splines that become such: position, exact arc length, frames that do not twist, and
//! the radius that goes along them.

mod chain;
mod frame;
mod length;
mod polynomial;
mod profile;
mod segment;
mod spline;
#[cfg(test)]
mod testing;
mod transport;

pub use chain::{Curve, CurveError};
pub use frame::{Frame, FrameRule};
pub use profile::{Profile, ProfileError, Shape, sampling_error};
pub use segment::Segment;
pub(crate) use spline::coincide;
pub use spline::{SplineError, b_spline, catmull_rom};
