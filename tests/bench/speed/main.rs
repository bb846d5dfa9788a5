//! How fast is a bake, beside something whose speed is known, in one run?
//!
//!     cargo bench --bench speed [-- [--json] [SECTION...] [RESOLUTION...]]
//!
//! Sections, each a table:
//!
//! - *kernel*: the evaluation of three scenes, beside the bare noise of as many octaves over as many points;
//! - *segments*: what a segment costs in curves of 1 to 10 000 of them;
//! - *pipeline*: what planning, encoding and writing take beside evaluation, and what a second thread gains.
//!
//! Without names all of them; the resolutions, 128 to 2048 without any (for the pipeline 512, or the first given), are
//! those of the scenes. `--json` prints one object instead, of the same figures. Times are processor time on one thread
//! unless a section says otherwise, medians of rounds that take turns. Machines
//! differ and drift, so ratios are the figures to keep: columns in ns and us are there to read them by.

#![allow(clippy::print_stdout, reason = "a bench prints its figures")]
#![allow(clippy::cast_precision_loss, reason = "counts")]

mod bare;
#[path = "../discard.rs"]
mod discard;
mod kernel;
mod pipeline;
mod segments;
#[path = "../table.rs"]
mod table;

use table::{Section, show};

const SECTIONS: [Section<Options>; 3] =
    [("kernel", kernel::run), ("segments", segments::run), ("pipeline", pipeline::run)];

/// What the command line asks for.
struct Options {
    /// Those asked for.
    given: Vec<f64>,
    /// Those, or the usual ones.
    resolutions: Vec<f64>,
}

fn main() {
    let (mut options, mut json, mut asked) = (Options { given: vec![], resolutions: vec![] }, false, vec![]);
    for argument in std::env::args().skip(1) {
        match argument.as_str() {
            "--json" => json = true,
            // What cargo says to every bench.
            "--bench" => {}
            other => match other.parse() {
                Ok(resolution) => options.given.push(resolution),
                Err(_) => asked.push(argument),
            },
        }
    }
    if let Some(unknown) = asked.iter().find(|name| SECTIONS.iter().all(|(known, _)| known != name)) {
        panic!("no section `{unknown}`");
    }
    let usual = vec![128.0, 256.0, 512.0, 1024.0, 2048.0];
    options.resolutions = if options.given.is_empty() { usual } else { options.given.clone() };
    show(&SECTIONS, &asked, &options, json);
}
