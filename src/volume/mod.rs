//! From a compiled field to sparse bricks: the plan of candidates, their evaluation, and the sinks they go to.
//!
//! [`Plan::new`] finds every brick that can hold density, before any memory for values is taken. [`bake()`] evaluates them
//! on all threads and hands those that hold something to a [`Sink`], in file order: the same bricks in the same order
//! whatever the number of threads.
//!
//! A [`Tree`] holds sparse values in memory; a [`Sampler`] filters them at any point, and [`density_at`] evaluates the
//! field itself there. Of a tree in a file a [`Part`] can be read: a [`PartialTree`].

mod accessor;
mod antialias;
mod bake;
mod brick;
mod dispatch;
mod hash;
pub(crate) mod node;
mod part;
mod pipeline;
mod plan;
mod points;
mod precision;
mod rest;
mod sample;
pub(crate) mod shape;
mod slice;
mod store;
#[cfg(test)]
pub(crate) mod testing;
mod total;
mod transform;
pub(crate) mod tree;
mod value;

pub use accessor::Accessor;
pub use bake::{IN_FLIGHT, Phases, Tally, bake};
pub use brick::{Brick, Encode, Sink};
pub(crate) use dispatch::{evaluate_block, evaluate_every};
pub use hash::{BrickHash, ContentHash};
pub use part::{NotRead, Part, PartialTree};
pub use plan::{Enough, Plan, PlanError};
pub use points::{density_at, planned_density_at};
pub(crate) use precision::to_halves;
pub use precision::{LARGEST_F16, Precision, Rounded};
pub use rest::RestMass;
pub use sample::{Filter, Sampled, Sampler, Wide, is_indexed, sample_at};
pub use shape::{Leaf, Stats, Tile};
pub use slice::{Axis, Slicing};
pub use store::Store;
pub use total::Total;
pub use transform::WorldToIndex;
pub use tree::{LeafView, Tree};
pub use value::Value;

pub use crate::field::Lattice;
