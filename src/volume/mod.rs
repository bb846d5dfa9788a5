//! From a compiled field to sparse bricks: the plan of candidates, their evaluation, and the sinks they go to.
//!
//! [`Plan::new`] finds every brick that can hold density, before any memory for values is taken. [`bake()`] evaluates them
//! on all threads and hands those that hold something to a [`Sink`], in file order: the same bricks in the same order
//! whatever the number of threads.

mod bake;
mod brick;
mod dispatch;
mod plan;
mod points;
mod store;

pub use bake::{Phases, Tally, bake};
pub use brick::{Brick, Sink};
pub use plan::{Plan, PlanError};
pub use points::density_at;
pub use store::Store;

pub use crate::field::Lattice;
