//! The command line: arguments, files, progress and exit codes. No numerics.
//!
//! Results go to standard output, as text or with `--json` as one object; progress, notes and errors go to standard
//! error. [`Failure::exit_code`] lists the exit codes.

mod accuracy;
mod bake;
mod certify;
mod check;
mod compare;
mod convert;
mod disk;
mod embedded;
mod estimate;
mod failure;
mod frames;
mod grids;
mod info;
mod interrupt;
mod job;
mod machine;
mod mass;
mod memory;
mod output;
mod plan;
mod progress;
mod recipe;
mod render;
mod report;
mod sample;
mod slice;
mod text;
mod verify;

use std::io::{self, BufWriter, Write};
use std::num::NonZeroUsize;

use clap::{Args, Parser, Subcommand};
use serde::Serialize;

pub use failure::Failure;

use crate::check::Hazard;
use crate::scene::{Warnings, Weight};

/// Bakes procedural density, sculpted along spline tubes, into sparse OpenVDB grids
#[derive(Debug, Parser)]
#[command(version, arg_required_else_help = true)]
pub struct Cli {
    #[command(flatten)]
    global: Global,
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Args)]
struct Global {
    /// Print one JSON object on standard output, or one a line for each frame of a sequence, and nothing else there
    #[arg(long, global = true)]
    json: bool,
    /// Threads to work with [default: one for each processor]
    #[arg(long, global = true, value_name = "N", value_parser = threads, allow_negative_numbers = true)]
    threads: Option<NonZeroUsize>,
    /// Print neither progress nor notes
    #[arg(long, global = true)]
    quiet: bool,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Bake a scene into an OpenVDB file
    Bake(bake::Arguments),
    /// Tell what a bake would take, without baking
    Plan(plan::Arguments),
    /// Draw a scene or an OpenVDB file
    Render(render::Arguments),
    /// Tell the values of a scene or an OpenVDB file at given points
    Sample(sample::Arguments),
    /// Write slices of a scene or an OpenVDB file as EXR or PNG images
    Slice(slice::Arguments),
    /// Tell how a scene, an OpenVDB file or an image differs from another
    Compare(compare::Arguments),
    /// Convert between formats of volumes: an OpenVDB file to a .vol file for Mitsuba
    Convert(convert::Arguments),
    /// Tell what is in a scene or an OpenVDB file
    Info(info::Arguments),
    /// Measure what each accuracy of a scene costs
    Report(report::Arguments),
    /// Check numerical stability: of the program in stiff and extreme cases, or of a scene
    Check(check::Arguments),
    /// Check that an OpenVDB file is what its recipe makes, and its certificate
    Verify(verify::Arguments),
}

impl Cli {
    /// Does what the arguments ask for.
    ///
    /// # Errors
    ///
    /// What went wrong, to be reported; where it is returned, no output file was made or changed but those of a sequence's
    /// first frames.
    pub fn run(self) -> Result<(), Failure> {
        interrupt::fail_without_memory();
        let done = match &self.command {
            Command::Bake(arguments) => bake::run(arguments, &self.global),
            Command::Plan(arguments) => plan::run(arguments, &self.global),
            Command::Render(arguments) => render::run(arguments, &self.global),
            Command::Sample(arguments) => sample::run(arguments, &self.global),
            Command::Slice(arguments) => slice::run(arguments, &self.global),
            Command::Compare(arguments) => compare::run(arguments, &self.global),
            Command::Convert(arguments) => convert::run(arguments, &self.global),
            Command::Info(arguments) => info::run(arguments, &self.global),
            Command::Report(arguments) => report::run(arguments, &self.global),
            Command::Check(arguments) => check::run(arguments, &self.global),
            Command::Verify(arguments) => verify::run(arguments, &self.global),
        };
        done.map_err(|failure| match machine::process_limit() {
            Some(limit) if failure.hints_at("--memory") => failure.hint(format!(
                "the system lets this process have no more than {}: raise that limit (ulimit -v, ulimit -d), too, or take fewer --threads, each of which reserves some of it",
                text::bytes(limit)
            )),
            _ => failure,
        })
    }
}

impl Global {
    /// Shows a result on standard output, in the form asked for.
    fn show<T: Serialize>(&self, result: &T, human: impl FnOnce(&T) -> String) -> Result<(), Failure> {
        let text = if self.json {
            serde_json::to_string_pretty(result)
                .map_err(|error| Failure::failed("cannot print the result").because(error))?
        } else {
            human(result)
        };
        print(|out| writeln!(out, "{}", text.trim_end()))
    }

    /// Shows one of many results on standard output: as one line of JSON, or as text.
    fn show_one<T: Serialize>(&self, result: &T, human: impl FnOnce(&T) -> String) -> Result<(), Failure> {
        let text = if self.json {
            serde_json::to_string(result)
                .map_err(|error| Failure::failed("cannot print the result").because(error))?
        } else {
            human(result)
        };
        print(|out| writeln!(out, "{}", text.trim_end()))
    }

    /// Tells something that is neither result nor error.
    fn note(&self, text: &str) {
        self.tell("note", text);
    }

    fn tell(&self, kind: &str, text: &str) {
        if !self.quiet {
            // Where standard error is closed there is nobody to tell.
            let _ = writeln!(io::stderr(), "{kind}: {text}");
        }
    }

    /// Tells what in a scene is hardly meant, each at its place.
    fn warn_of(&self, warnings: &Warnings) {
        if self.quiet || warnings.is_empty() {
            return;
        }
        let text = if failure::colours() { warnings.to_coloured() } else { warnings.to_string() };
        let _ = writeln!(io::stderr(), "{text}\n");
    }

    /// Tells what of a scene will not come out as it says, each at its place.
    fn warn_of_hazards(&self, hazards: &[Hazard]) {
        for hazard in hazards.iter().filter(|hazard| !self.quiet && hazard.weight() == Weight::Serious) {
            // Where standard error is closed there is nobody to tell.
            let _ = writeln!(io::stderr(), "{}\n", hazard.remark().show(failure::colours()));
        }
    }

    /// The threads to work with, of which this is one: what is handed to them is begun here. So all frames of a sequence take
    /// their large pieces of memory on one thread, and what one of them gives back is of use to the next; allocators keep
    /// what other threads gave back for these.
    fn pool(&self) -> Result<rayon::ThreadPool, Failure> {
        let threads = match self.threads {
            Some(threads) => threads.get(),
            None => machine::threads(),
        };
        let failed = |error: String| {
            Failure::failed(format!("cannot start {}", text::number(threads as u64, "thread")))
                .because(error)
                .hint("fewer --threads take less memory")
        };
        // One that finds no memory in its first moments cannot tell of it.
        if !machine::is_room_for(threads) {
            return Err(failed("the system lets this process have too little memory".to_owned()));
        }
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .use_current_thread()
            .build()
            .map_err(|error| failed(error.to_string()))?;
        // Each reserves memory when it takes the first. After that what is left is known.
        pool.broadcast(|_| drop(std::hint::black_box(vec![0_u8; 1 << 10])));
        machine::process_limit();
        Ok(pool)
    }
}

/// Writes to standard output.
fn print(write: impl FnOnce(&mut dyn Write) -> io::Result<()>) -> Result<(), Failure> {
    let mut out = BufWriter::new(io::stdout().lock());
    match write(&mut out).and_then(|()| out.flush()) {
        // Who closes the pipe has read enough.
        Err(error) if error.kind() != io::ErrorKind::BrokenPipe => {
            Err(Failure::failed("cannot write to standard output").because(error))
        }
        _ => Ok(()),
    }
}

fn threads(text: &str) -> Result<NonZeroUsize, String> {
    const MOST: usize = 4096;
    text.parse()
        .ok()
        .filter(|threads: &NonZeroUsize| threads.get() <= MOST)
        .ok_or_else(|| format!("expected a whole number from 1 to {MOST}"))
}
