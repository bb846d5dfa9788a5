//! Memory: how much may be used, and how much a bake takes at most.

use std::str::FromStr;

use bytesize::ByteSize;

use super::machine;
use crate::formats::vdb::{Encoder, GridBound};
use crate::volume::Plan;

/// Bytes that the process takes without a scene: 5 MB were measured, and 0.6 MB more for one brick of each scene of the
/// project.
const PROCESS: u64 = 7 << 20;
/// Bytes for each thread: a run of 64 bricks, working memory of the evaluation, and of the encoder.
const THREAD: u64 = 384 << 10;
/// Times that a bake repeats the scene's text, for the file.
const COPIES: u64 = 4;
/// Bytes for each brick besides its encoded values: place and mask, in a list that grows by doubling.
const PLACE: u64 = 160;
/// Bricks that are handed on together. Until then each is held once more, in lists that grow by doubling.
const IN_FLIGHT: u64 = 8192;
/// While a plan is made, a contact of a brick and a piece of an axis takes 36 bytes, of which at least 4 are kept.
const PLANNING: u64 = 9;

/// Bytes of memory, in binary or decimal units as the user gave them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Amount {
    bytes: u64,
    decimal: bool,
}

impl Amount {
    /// Three quarters of what the machine has.
    pub(super) fn installed() -> Amount {
        Amount { bytes: machine::default_budget(), decimal: false }
    }

    pub(super) fn bytes(self) -> u64 {
        self.bytes
    }

    /// So many bytes for people, in units of this amount's family. What no 64-bit number holds is as good as infinite.
    pub(super) fn show(self, bytes: f64) -> String {
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "saturating")]
        let shown = ByteSize(bytes as u64).display();
        if self.decimal { shown.si() } else { shown.iec() }.to_string()
    }
}

impl FromStr for Amount {
    type Err = String;

    fn from_str(text: &str) -> Result<Amount, String> {
        let size: ByteSize =
            text.parse().map_err(|_| "expected bytes, at least 0, such as 500MB or 2GiB".to_owned())?;
        let unit = text.trim_start_matches(|c: char| !c.is_alphabetic()).to_ascii_lowercase();
        Ok(Amount { bytes: size.0, decimal: unit.len() > 1 && !unit.contains('i') })
    }
}

/// Bytes that the process took so far at most, as far as the system tells.
pub(super) fn resident() -> u64 {
    machine::peak_memory().unwrap_or(0)
}

/// Upper bound of what the process takes besides bricks, on the current `rayon` pool, when it took `resident` bytes to
/// compile a scene of `text` bytes.
pub(super) fn process(resident: u64, text: usize) -> u64 {
    // Only large scenes take more than the process itself, so that the bound is the same on every run for all others.
    PROCESS.max(resident) + THREAD * rayon::current_num_threads() as u64 + COPIES * text as u64
}

/// Upper bound of what a plan and its bricks take.
pub(super) fn bricks(plan: &Plan, encoder: Encoder) -> u64 {
    let (held, bricks) = (plan.memory() as u64, plan.bricks() as u64);
    let baking = held + brick(encoder) * bricks + 2 * GridBound::leaf::<f32>(encoder) * bricks.min(IN_FLIGHT);
    baking.max(PLANNING * held)
}

/// Upper bound of what one more of many bricks takes.
pub(super) fn brick(encoder: Encoder) -> u64 {
    GridBound::leaf::<f32>(encoder) + PLACE
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn amounts_are_shown_in_the_units_they_were_given_in() {
        for (text, expected) in
            [("10MB", "10.0 MB"), ("10 MiB", "10.0 MiB"), ("2G", "1.9 GiB"), ("512", "512 B")]
        {
            let amount: Amount = text.parse().expect("an amount");
            #[allow(clippy::cast_precision_loss, reason = "small")]
            let shown = amount.show(amount.bytes() as f64);
            assert_eq!(shown, expected);
        }
        for text in ["-1", "", "much", "nan", "1 parsec"] {
            assert!(text.parse::<Amount>().is_err(), "{text}");
        }
    }
}
