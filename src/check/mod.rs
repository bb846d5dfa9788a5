//! Numerical stability: a catalogue of stiff and extreme cases, families of them, and what of a scene is hazardous.
//!
//! A [`Case`] states what must be true where something is degenerate, tiny, huge or stiff: a bound with its reason, an equality
//! to the bit, or a refusal before memory is taken. [`catalogue`] lists them; those of densities are held against the
//! [`reference`](mod@crate::reference) in double precision, those of light against closed forms, and all evaluate real scenes
//! at every instruction set that the processor has. A [`Family`] measures an error over one parameter, from harmless to
//! hopeless, to show where accuracy ends. [`hazards`] looks at one scene before it is baked.

mod case;
mod cases;
mod family;
mod hazard;
mod meeting;
mod page;
mod probe;

pub use case::{Case, Outcome};
pub use family::{Family, Mark, families};
pub use hazard::{Expectation, Hazard, expectation, faded_layer, hazards, hazards_expected, sorted};
pub use meeting::meetings;
pub use page::{page, section};

/// All cases, in the order in which they are shown.
pub fn catalogue() -> Vec<Case> {
    cases::all()
}
