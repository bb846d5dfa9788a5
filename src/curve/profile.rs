//! The radius along a curve.
