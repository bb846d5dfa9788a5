//! What planning, encoding and writing take beside evaluation: `cargo bench --bench pipeline [RESOLUTION]`. A table, and the
//! same as one line of JSON.

#![allow(clippy::print_stdout, reason = "a bench prints its figures")]

#[path = "speed/pipeline.rs"]
mod pipeline;

fn main() {
    let given = std::env::args().skip(1).find_map(|argument| argument.parse().ok());
    let figures = pipeline::run(&["tornado", "solar_flare", "galaxy"], given.unwrap_or(512.0));
    println!("{figures}");
}
