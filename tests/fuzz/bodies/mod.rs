//! What each target does with bytes. Both the targets and the test that replays their files run these functions.

#![allow(unreachable_pub, reason = "a library of the targets' package, and a module of the test")]

mod arguments;
mod certificate;
mod exr;
mod inputs;
mod npy;
mod png;
mod points;
mod program;
mod recipe;
mod scene;
mod values;
mod vdb;

use peak_alloc::PeakAlloc;

#[global_allocator]
static MEMORY: PeakAlloc = PeakAlloc;

/// What a target does with bytes; returns whether its reader took them.
pub type Body = fn(&[u8]) -> bool;

/// The targets, by name.
pub const BODIES: [(&str, Body); 12] = [
    ("arguments", arguments::run),
    ("certificate", certificate::run),
    ("exr", exr::run),
    ("inputs", inputs::run),
    ("npy", npy::run),
    ("png", png::run),
    ("points", points::run),
    ("program", program::run),
    ("recipe", recipe::run),
    ("scene", scene::run),
    ("values", values::run),
    ("vdb", vdb::run),
];

/// Runs a target.
pub fn run(target: &str, data: &[u8]) -> bool {
    let (_, body) = BODIES.iter().find(|(name, _)| *name == target).expect("a target");
    body(data)
}

/// What `read` returns, which must not have held more than this many bytes more than were held before it, at any time.
fn within<T>(bytes: u64, read: impl FnOnce() -> T) -> T {
    let before = MEMORY.current_usage() as u64;
    MEMORY.reset_peak_usage();
    let result = read();
    let taken = (MEMORY.peak_usage() as u64).saturating_sub(before);
    assert!(taken <= bytes, "{taken} bytes of memory were taken, and at most {bytes} are expected");
    result
}
