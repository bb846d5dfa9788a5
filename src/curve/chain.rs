//! A chain of segments with one arc length and one frame along all of it.

use super::{Frame, FrameRule, Segment};
