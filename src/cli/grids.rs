//! Which of a file's grids is meant.

use crate::cli::{Failure, text};
use crate::formats::vdb::{FileInfo, VdbReadError};

/// A grid of a file.
pub(super) struct Choice {
    /// In the order of the file.
    pub(super) number: usize,
    /// Its name, with its number among those of the same name, where there are several.
    pub(super) label: String,
}

/// Finds the grid that is asked for: by its name where no other has it, else, as OpenVDB writes it, by its name and the
/// number among those, from 0 in the order of the file, in brackets. Without a name, the only grid or that named density.
pub(super) fn choose(
    info: &FileInfo,
    name: Option<&str>,
    failed: impl Fn(VdbReadError) -> Failure,
) -> Result<Choice, Failure> {
    let labels = labels(info);
    let chosen = |number: usize| Choice { number, label: labels.get(number).cloned().unwrap_or_default() };
    let several = || Failure::usage("the file has several grids; choose one with --grid");
    let hint = || {
        let labels: Vec<String> = labels.iter().map(|label| text::tidy(label)).collect();
        format!("the file holds: {}", labels.join(", "))
    };
    let wanted = match (name, info.grids.len()) {
        (_, 0) => return Err(Failure::input("the file holds no grid")),
        (None, 1) => return Ok(chosen(0)),
        (name, _) => name.unwrap_or("density"),
    };
    let of_name = numbers(info, wanted);
    match of_name[..] {
        [number] => Ok(chosen(number)),
        [] => numbered(info, wanted).map(chosen).ok_or_else(|| {
            let missing = match (name, info.out_of_reach) {
                (None, _) => several(),
                (Some(name), 0) => Failure::usage(format!("the file has no grid {name:?}")),
                (Some(name), _) => failed(VdbReadError::OutOfReach(name.to_owned())),
            };
            missing.hint(hint())
        }),
        _ => {
            let choices: Vec<String> = of_name
                .iter()
                .filter_map(|number| labels.get(*number))
                .map(|label| text::tidy(label))
                .collect();
            let wanted = text::tidy(wanted);
            Err(Failure::usage(format!("the file has several grids named {wanted}"))
                .hint(format!("choose one of {} with --grid", choices.join(", "))))
        }
    }
}

/// The grids of a name.
fn numbers(info: &FileInfo, name: &str) -> Vec<usize> {
    (0..).zip(&info.grids).filter(|(_, grid)| grid.name == name).map(|(number, _)| number).collect()
}

/// The grid that `name[n]` stands for.
fn numbered(info: &FileInfo, label: &str) -> Option<usize> {
    let (name, number) = label.strip_suffix(']')?.rsplit_once('[')?;
    numbers(info, name).get(number.parse::<usize>().ok()?).copied()
}

/// What each grid is asked for by.
fn labels(info: &FileInfo) -> Vec<String> {
    // The number of grids of each name so far, and in all.
    let mut counts = std::collections::BTreeMap::<&str, [usize; 2]>::new();
    for grid in &info.grids {
        counts.entry(&grid.name).or_default()[1] += 1;
    }
    let label = |name: &str, [before, all]: &mut [usize; 2]| {
        *before += 1;
        if *all == 1 { name.to_owned() } else { format!("{name}[{}]", *before - 1) }
    };
    info.grids
        .iter()
        .map(|grid| counts.get_mut(&*grid.name).map_or_else(String::new, |counts| label(&grid.name, counts)))
        .collect()
}
