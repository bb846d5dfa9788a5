//! Points as text: `x,y,z` a line.

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

use std::io::{self, BufRead, Read};

use thiserror::Error;

/// Lines that are longer are no points.
const LONGEST_LINE: u64 = 1 << 16;
/// Characters of a wrong line that are shown.
const SHOWN: usize = 60;

/// Why points could not be read.
#[derive(Debug, Error)]
pub enum CsvError {
    /// The input failed.
    #[error(transparent)]
    Io(#[from] io::Error),
    /// A line is no point.
    #[error("line {line}: expected three numbers, x,y,z, and found {found}")]
    Line {
        /// Its number, from 1.
        line: u64,
        /// What stands there, or is wrong with it.
        found: String,
    },
}

/// Reads points, a line each: three numbers separated by commas.
///
/// Blank lines, and what follows a `#`, are passed over, and so is a header: a first line of three fields none of which is
/// a number.
///
/// # Errors
/// See [`CsvError`].
pub fn read_points(input: &mut impl BufRead) -> Result<Vec<[f64; 3]>, CsvError> {
    let mut points = Vec::new();
    each_point(input, |point| {
        points.try_reserve(1).map_err(|_| io::Error::from(io::ErrorKind::OutOfMemory))?;
        points.push(point);
        Ok(())
    })?;
    Ok(points)
}

/// The same, one by one.
///
/// # Errors
/// See [`CsvError`]; and those of `visit`.
pub fn each_point(
    input: &mut impl BufRead,
    mut visit: impl FnMut([f64; 3]) -> io::Result<()>,
) -> Result<(), CsvError> {
    let mut bytes = Vec::new();
    let mut header_may_follow = true;
    for line in 1.. {
        bytes.clear();
        let length = input.by_ref().take(LONGEST_LINE).read_until(b'\n', &mut bytes)?;
        if length == 0 {
            break;
        }
        let fault = |found: String| CsvError::Line { line, found };
        if length as u64 == LONGEST_LINE && bytes.last() != Some(&b'\n') {
            return Err(fault("a line of more than 64 KiB".to_owned()));
        }
        let text = String::from_utf8_lossy(&bytes);
        // Spreadsheets put a byte order mark before the first line.
        let text = if line == 1 { text.trim_start_matches('\u{feff}') } else { &text };
        let text = text.split('#').next().unwrap_or_default().trim();
        if text.is_empty() {
            continue;
        }
        let may_be_header = std::mem::take(&mut header_may_follow);
        let fields: Vec<Option<f64>> = text.split(',').map(|field| field.trim().parse().ok()).collect();
        match fields.as_slice() {
            [Some(x), Some(y), Some(z)] => visit([*x, *y, *z])?,
            [None, None, None] if may_be_header => {}
            _ => return Err(fault(shown(text))),
        }
    }
    Ok(())
}

/// A line in quotes, without characters that could steer a terminal.
fn shown(text: &str) -> String {
    let part: String = text.chars().take(SHOWN).collect();
    let more = if part.len() < text.len() { " ..." } else { "" };
    format!("{part:?}{more}")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<Vec<[f64; 3]>, String> {
        read_points(&mut text.as_bytes()).map_err(|error| error.to_string())
    }

    #[test]
    fn points_are_read() {
        let expected = Ok(vec![[1.0, -2.5, 3e-3], [0.0, 0.0, 7.0]]);
        for text in [
            "1,-2.5,3e-3\n0,0,7\n",
            "x,y,z\n1,-2.5,3e-3\n0,0,7",
            "\u{feff}\"x\", \"y\", \"z\"\r\n1.0 ,\t-2.5, 0.003\r\n\r\n+0,0,7\r\n",
            "# made by hand\n\nx,y,z # metres\n1,-2.5,.003 # one\n   \n0,0,7.\n\n",
        ] {
            assert_eq!(read(text), expected, "{text:?}");
        }
        assert_eq!(read(""), Ok(vec![]));
        assert_eq!(read("x,y,z\n"), Ok(vec![]));
        let odd = read("nan,inf,-inf\n").expect("numbers, though not finite");
        assert!(odd[0][0].is_nan() && odd[0][1..] == [f64::INFINITY, f64::NEG_INFINITY]);
    }

    #[test]
    fn faults_are_named_by_their_line() {
        for (text, line) in [
            ("1,2\n", 1),
            ("1,2,3,4\n", 1),
            ("x,y,z\nx,y,z\n", 2),
            ("x,y,z,density\n1,2,3\n", 1),
            ("# comment\n\n1,2,3\n1 2 3\n", 4),
            ("1,2,three\n", 1),
            ("hello\n", 1),
            ("1,2,3\n1,,3\n", 2),
            ("1,2,3\n\u{1b}[2J,1,2\n", 2),
        ] {
            let error = read(text).expect_err(text);
            assert!(error.starts_with(&format!("line {line}: ")) && !error.contains('\u{1b}'), "{error}");
        }
        let long = format!("1,2,3\n{}", "1".repeat(1 << 17));
        assert!(read(&long).expect_err("too long").starts_with("line 2: "));
        assert!(read_points(&mut &b"\xff\xfe,1,2\n"[..]).is_err());
    }
}
