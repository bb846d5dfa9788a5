//! The program: arguments in, exit code out.

use std::io;
use std::process::ExitCode;

use clap::Parser;
use vdbake::cli::Cli;

fn main() -> ExitCode {
    match Cli::parse().run() {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            // Where standard error is closed there is nobody to tell.
            let _ = failure.report(&mut io::stderr().lock());
            ExitCode::from(failure.exit_code())
        }
    }
}
