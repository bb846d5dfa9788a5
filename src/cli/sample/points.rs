//! Where to sample.

#![cfg_attr(
    not(test),
    deny(
        clippy::arithmetic_side_effects,
        clippy::expect_used,
        clippy::indexing_slicing,
        clippy::panic,
        clippy::string_slice,
        clippy::unreachable,
        clippy::unwrap_used
    )
)]

use std::fs::File;
use std::io::{self, BufRead, BufReader};
use std::path::Path;

use glam::DVec3;

use crate::cli::Failure;
use crate::formats::csv;
use crate::formats::npy::{self, Array, Values};

/// Reads points from a file, or from standard input for `-`.
pub(super) fn read(path: &Path) -> Result<Vec<DVec3>, Failure> {
    if path == Path::new("-") {
        return csv::read_points(&mut io::stdin().lock())
            .map(|points| points.into_iter().map(DVec3::from).collect())
            .map_err(|error| Failure::input("cannot read points from standard input").because(error));
    }
    let name = path.display();
    let failed = || Failure::input(format!("cannot read points from {name}"));
    let mut file = File::open(path).map(BufReader::new).map_err(|error| failed().because(error))?;
    let named = path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("npy"));
    let start = file.fill_buf().map_err(|error| failed().because(error))?;
    if named || start.starts_with(&npy::MAGIC) {
        let array = npy::read(&mut file).map_err(|error| failed().because(error))?;
        return of_array(array).ok_or_else(|| failed().because("the array's shape is not (N, 3)"));
    }
    let points = csv::read_points(&mut file).map_err(|error| failed().because(error))?;
    Ok(points.into_iter().map(DVec3::from).collect())
}

fn of_array(array: Array) -> Option<Vec<DVec3>> {
    if array.shape.len() != 2 || array.shape.last() != Some(&3) {
        return None;
    }
    let values = match array.values {
        Values::F32(values) => values.into_iter().map(f64::from).collect(),
        Values::F64(values) => values,
    };
    Some(values.as_chunks().0.iter().map(|point| DVec3::from_array(*point)).collect())
}
