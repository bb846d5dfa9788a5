//! Memory: how much may be used, and how much a bake takes at most.

use std::path::Path;
use std::str::FromStr;

use bytesize::ByteSize;

use super::{Failure, machine};
use crate::formats::vdb::{Compression, Encoder, GridBound, VdbGridBuilder, VdbReadError};
use crate::volume::{Enough, IN_FLIGHT, Plan, PlanError, Tile};

/// Bytes that the process takes without a scene: 7 to 9 MB were measured, with one brick of each scene of the project.
const PROCESS: u64 = 11 << 20;
/// Bytes that the program takes besides plans, grids and pictures, where it does not bake: 12 MB were measured.
pub(super) const PROGRAM: u64 = 16 << 20;
/// Bytes for each thread: a run of bricks, working memory of the evaluation with what it narrows ahead, and of the encoder.
const THREAD: u64 = 512 << 10;
/// Bytes besides for each thread that makes zlib streams.
const ZLIB: u64 = 256 << 10;
/// Bytes of the program itself that a bake comes to use.
const WORKING: u64 = 1408 << 10;
/// Bytes for putting the file together: an upper node, what encodes it, and what is read of a spool at once.
const WRITING: u64 = 3 << 19;
/// Times that a bake repeats the scene's text, for the file.
const COPIES: u64 = 4;
/// Bytes for each brick in flight besides its values: place, mask and hash.
const PLACE: u64 = 128;
/// Bytes of a plan for each brick, as far as that is known before it is made.
const PLANNED: u64 = 32;

/// Bytes of memory, in binary or decimal units as the user gave them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Amount {
    bytes: u64,
    decimal: bool,
}

impl Amount {
    /// Three quarters of what the machine has, or the system lets this process have of it.
    pub(super) fn installed() -> Amount {
        Amount { bytes: machine::default_budget(), decimal: false }
    }

    /// What is given, but no more than the system lets this process have; three quarters of that where nothing is.
    pub(super) fn settle(given: Option<Amount>) -> Amount {
        let Some(given) = given else { return Amount::installed() };
        Amount { bytes: given.bytes.min(machine::process_limit().unwrap_or(u64::MAX)), ..given }
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

/// An amount that is no less than so many bytes, as `--memory` takes it.
pub(super) fn enough(bytes: u64) -> String {
    format!("{}MiB", bytes.div_ceil(1 << 20))
}

/// What to do where a plan has no room in the memory of a process that takes so many bytes besides.
pub(super) fn room_for(error: PlanError, besides: u64) -> Option<String> {
    error.enough().map(|plan| format!("allow more with --memory {}", enough(plan.saturating_add(besides))))
}

/// Why what was asked for could not be planned.
pub(super) fn unplanned(error: PlanError) -> Failure {
    /// Bytes that the program takes besides, and what is planned for takes with it.
    const BESIDES: u64 = 64 << 20;
    unplanned_beside(error, BESIDES)
}

/// The same in a process that takes so many bytes besides.
pub(super) fn unplanned_beside(error: PlanError, besides: u64) -> Failure {
    let larger = "take a larger --voxel-size";
    let hint =
        room_for(error, besides).map_or_else(|| larger.to_owned(), |more| format!("{larger}, or {more}"));
    Failure::failed(error.to_string()).hint(hint)
}

/// Why a file could not be read in a process that takes so many bytes besides.
pub(super) fn unread(path: &Path, error: VdbReadError, besides: u64) -> Failure {
    let message = format!("cannot read {}", path.display());
    match error {
        VdbReadError::Memory { needed, .. } => Failure::failed(message)
            .because(error)
            .hint(format!("allow more with --memory {} or above", enough(needed.saturating_add(besides)))),
        error => Failure::input(message).because(error),
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
    let program = if resident > PROCESS { resident + WORKING } else { PROCESS };
    program + WRITING + THREAD * rayon::current_num_threads() as u64 + COPIES * text as u64
}

/// Upper bound of what one more of many bricks takes whose leaf is in the spool.
pub(super) const BRICK: u64 = VdbGridBuilder::<f32>::topology_bytes(1, 0) + PLANNED;

/// Of so many bricks, those in flight at most.
fn in_flight(bricks: u64) -> u64 {
    bricks.min((IN_FLIGHT * rayon::current_num_threads()) as u64)
}

/// Bytes of a brick in flight: lists of bytes grow by doubling.
fn held(encoder: Encoder) -> u64 {
    2 * (GridBound::leaf::<f32>(encoder) + PLACE)
}

/// What a bake takes of the memory. Encoded leaves that have no room go to a spool; all else is needed.
#[derive(Debug, Clone, Copy)]
pub(super) struct Need {
    /// Bytes for the plan while it is made, and once it is.
    making: u64,
    plan: u64,
    /// Upper bound for all but the plan, encoded leaves and topology, and for bricks in flight, a part of it.
    process: u64,
    in_flight: u64,
    /// About what all threads take.
    threads: u64,
    /// Bricks, and how many of them are in flight at most.
    bricks: u64,
    in_flight_bricks: u64,
    /// Upper bound for topology: leaves, and nodes above them.
    topology: u64,
    nodes: u64,
    /// Upper bound of encoded leaves.
    leaves: u64,
}

impl Need {
    /// Of a plan, on the current `rayon` pool, of which `process` is the part that does not depend on it.
    pub(super) fn new(plan: &Plan, bound: &GridBound, encoder: Encoder, process: u64) -> Need {
        let bricks = plan.bricks() as u64;
        let in_flight = in_flight(bricks);
        let held = held(encoder);
        let thread = THREAD + if encoder.compression() == Compression::Zip { ZLIB } else { 0 };
        Need {
            making: plan.making() as u64,
            plan: plan.memory() as u64,
            process: process + held * in_flight,
            in_flight: held * in_flight,
            threads: thread * rayon::current_num_threads() as u64,
            bricks,
            in_flight_bricks: in_flight,
            topology: VdbGridBuilder::<f32>::topology_bytes(bricks, bound.nodes),
            nodes: bound.nodes,
            leaves: bound.buffers,
        }
    }

    /// What is enough for so many bricks at most, of which it is known what is enough to plan them.
    pub(super) fn enough(bricks: u64, enough: Enough, encoder: Encoder, process: u64) -> u64 {
        let held = held(encoder) * in_flight(bricks);
        let topology = VdbGridBuilder::<f32>::topology_bytes(bricks, enough.nodes);
        let leaves = bricks.saturating_mul(GridBound::leaf::<f32>(encoder));
        (process + held + in_pieces(leaves).min(VdbGridBuilder::<f32>::LEAST_MEMORY))
            .saturating_add(enough.bytes)
            .saturating_add(topology)
    }

    /// All but encoded leaves, at most.
    fn fixed(&self) -> u64 {
        self.process + self.plan + self.topology
    }

    /// What cannot do without.
    pub(super) fn least(&self) -> u64 {
        let baking = self.fixed() + in_pieces(self.leaves).min(VdbGridBuilder::<f32>::LEAST_MEMORY);
        baking.max(self.process + self.making)
    }

    /// Upper bound of what is taken of a budget.
    pub(super) fn most(&self, budget: u64) -> u64 {
        self.least().max(self.fixed() + in_pieces(self.leaves).min(self.room(budget)))
    }

    /// What a budget leaves for encoded leaves, in whole pieces.
    pub(super) fn room(&self, budget: u64) -> u64 {
        let room = budget.saturating_sub(self.fixed());
        room - room % VdbGridBuilder::<f32>::LEAST_MEMORY
    }

    /// Upper bound of what goes to the spool.
    pub(super) fn spool(&self, budget: u64) -> u64 {
        self.spooled(budget, self.leaves)
    }

    /// About what goes to the spool of encoded leaves of so many bytes.
    pub(super) fn spooled(&self, budget: u64, encoded: u64) -> u64 {
        // Pieces go there whole.
        in_pieces(encoded.saturating_sub(self.room(budget).max(VdbGridBuilder::<f32>::LEAST_MEMORY)))
    }

    /// About what is taken of a budget for so many leaves of so many bytes, if the process takes `resident` without them.
    pub(super) fn about(&self, budget: u64, [leaves, tiles]: [u64; 2], encoded: u64, resident: u64) -> u64 {
        let topology =
            VdbGridBuilder::<f32>::topology_bytes(leaves, self.nodes) + tiles * 2 * size_of::<Tile>() as u64;
        // A quarter of those that may be in flight is, as large as bricks are on average.
        let in_flight =
            self.in_flight.min(2 * self.in_flight_bricks * (encoded / self.bricks.max(1) + PLACE)) / 4;
        let values = in_pieces(encoded - self.spooled(budget, encoded));
        let baking = WORKING + self.threads + in_flight + self.plan + topology + values;
        (resident + baking.max(self.making)).min(self.most(budget))
    }
}

/// What encoded leaves take in memory, which is taken in pieces.
fn in_pieces(leaves: u64) -> u64 {
    leaves.checked_next_multiple_of(VdbGridBuilder::<f32>::LEAST_MEMORY).unwrap_or(u64::MAX)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::field::{Field, Lattice};
    use crate::num::Level;
    use crate::scene::Scene;
    use crate::volume::bake;

    /// What a budget keeps of encoded leaves, and what goes to the spool, are what the grid does with them.
    #[test]
    fn what_is_kept_and_spooled_is_foretold() {
        const PIECE: u64 = VdbGridBuilder::<f32>::LEAST_MEMORY;
        let tube = "[[tube]]\nradius = 0.3\ncurve = { points = [[0, 0, 0], [0.4, 0, 1], [0, 0, 2]] }";
        let field = Field::compile(&Scene::parse(tube, "").expect("valid"));
        let plan = Plan::new(&field, Lattice { voxel_size: 0.005 }, 1 << 30).expect("small");
        let encoder = Encoder::new(Compression::None);
        let bound = GridBound::new::<f32>(encoder, plan.origins());
        let need = Need::new(&plan, &bound, encoder, process(0, 0));
        for pieces in 1..4 {
            for more in [0, 1, PIECE - 1] {
                let budget = need.fixed() + pieces * PIECE + more;
                let spool = tempfile::tempfile().expect("a temporary file");
                let mut grid = VdbGridBuilder::with_encoder(encoder).with_spool(need.room(budget), spool);
                let Ok(_) = bake(&field, &plan, 0.0, Level::best(), &mut grid, |_| ()) else {
                    panic!("no room");
                };
                let encoded = grid.encoded_bytes();
                assert!(encoded > 4 * PIECE, "{encoded}");
                assert_eq!(need.spooled(budget, encoded), grid.spooled_bytes());
                assert!(need.spool(budget) >= grid.spooled_bytes() && need.most(budget) <= budget);
            }
        }
    }

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
