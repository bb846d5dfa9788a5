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
use crate::formats::csv::{self, CsvError};
use crate::formats::npy::{self, Array, NpyError, Values};

/// Where to sample.
pub(super) struct Points {
    /// Empty where there are too many for the memory.
    pub(super) list: Vec<DVec3>,
    /// How many there are.
    pub(super) count: u64,
}

/// Reads points from a file, or from standard input for `-`; where there are more than so many, they are counted only.
pub(super) fn read(path: &Path, most: u64) -> Result<Points, Failure> {
    if path == Path::new("-") {
        return of_lines(&mut io::stdin().lock(), most)
            .map_err(|error| Failure::input("cannot read points from standard input").because(error));
    }
    let name = path.display();
    let failed = || Failure::input(format!("cannot read points from {name}"));
    let mut file = File::open(path).map(BufReader::new).map_err(|error| failed().because(error))?;
    let named = path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("npy"));
    let start = file.fill_buf().map_err(|error| failed().because(error))?;
    if named || start.starts_with(&npy::MAGIC) {
        let array = match npy::read_within(&mut file, most.saturating_mul(3)) {
            Err(NpyError::TooMany { count }) => return Ok(Points { list: Vec::new(), count: count / 3 }),
            array => array.map_err(|error| failed().because(error))?,
        };
        let list = of_array(array).ok_or_else(|| failed().because("the array's shape is not (N, 3)"))?;
        return Ok(Points { count: list.len() as u64, list });
    }
    of_lines(&mut file, most).map_err(|error| failed().because(error))
}

fn of_lines(input: &mut impl BufRead, most: u64) -> Result<Points, CsvError> {
    let mut points = Points { list: Vec::new(), count: 0 };
    csv::each_point(input, |point| {
        points.count = points.count.saturating_add(1);
        if points.count > most {
            points.list = Vec::new();
            return Ok(());
        }
        points.list.try_reserve(1).map_err(|_| io::Error::from(io::ErrorKind::OutOfMemory))?;
        points.list.push(DVec3::from(point));
        Ok(())
    })?;
    Ok(points)
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
