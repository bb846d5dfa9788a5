//! Command lines, a word a line: they are taken or refused, and nothing is done.

use clap::Parser;
use vdbake::cli::Cli;

pub(crate) fn run(data: &[u8]) -> bool {
    let text = String::from_utf8_lossy(data);
    match Cli::try_parse_from(std::iter::once("vdbake").chain(text.split('\n'))) {
        Ok(cli) => !format!("{cli:?}").is_empty(),
        Err(error) => {
            assert!(!error.to_string().is_empty());
            false
        }
    }
}
