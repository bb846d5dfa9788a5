//! Numbers as comma-separated text, a row a line.

#![cfg_attr(not(test), deny(clippy::arithmetic_side_effects))]

use super::limit::Limit;

/// Lines that are longer hold no numbers.
const LONGEST_LINE: usize = 1 << 16;
/// Characters of a wrong field that are shown.
const SHOWN: usize = 40;

/// A row, and the number of its line, from 1.
pub(super) type Row<const N: usize> = (usize, [f64; N]);

/// The rows of a file, each number within its limit; `names` are those of its columns, as `x,y,z`.
///
/// Blank lines, and what follows a `#`, are passed over, and so is a header: a first line of as many fields, none of which
/// is a number.
///
/// # Errors
///
/// The first fault, with its line and column: `line 3, column 5: expected a number, found "x"`.
pub(super) fn rows<const N: usize>(
    bytes: &[u8],
    names: &str,
    limits: [&Limit; N],
    most: usize,
) -> Result<Vec<Row<N>>, String> {
    let mut rows = Vec::new();
    let mut header_may_follow = true;
    let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    for (line, bytes) in (1..).zip(bytes.split(|byte| *byte == b'\n')) {
        if bytes.len() > LONGEST_LINE {
            return Err(format!("line {line}: a line of more than 64 KiB"));
        }
        let text = String::from_utf8_lossy(bytes);
        let text = text.split('#').next().unwrap_or_default();
        if text.trim().is_empty() {
            continue;
        }
        let may_be_header = std::mem::take(&mut header_may_follow);
        let fields: Vec<&str> = text.split(',').collect();
        if may_be_header && fields.len() == N && fields.iter().all(|field| number(field).is_none()) {
            continue;
        }
        if fields.len() != N {
            return Err(format!("line {line}: expected {N} numbers, {names}, found {}", fields.len()));
        }
        let mut row = [0.0; N];
        let mut column = 1_usize;
        for ((out, field), limit) in row.iter_mut().zip(&fields).zip(limits) {
            let start = column.saturating_add(field.chars().take_while(|c| c.is_whitespace()).count());
            column = column.saturating_add(field.chars().count()).saturating_add(1);
            let place = format!("line {line}, column {start}");
            *out = match number(field) {
                None => return Err(format!("{place}: expected {}, found {}", limit.noun, shown(field))),
                Some(x) if !limit.admits(x) => {
                    return Err(format!("{place}: expected {}, found {}", limit.range, shown(field)));
                }
                Some(x) => x,
            };
        }
        if rows.len() == most {
            return Err(format!("line {line}: more than {most} rows"));
        }
        rows.push((line, row));
    }
    Ok(rows)
}

fn number(field: &str) -> Option<f64> {
    field.trim().parse().ok()
}

/// A field in quotes, without characters that could steer a terminal.
fn shown(field: &str) -> String {
    let field = field.trim();
    let part: String = field.chars().take(SHOWN).collect();
    let more = if part.len() < field.len() { " ..." } else { "" };
    format!("{part:?}{more}")
}

#[cfg(test)]
mod tests {
    use super::super::limit;
    use super::*;

    fn pairs(text: &str) -> Result<Vec<Row<2>>, String> {
        rows(text.as_bytes(), "l,radius", [&limit::PLACE, &limit::NOT_NEGATIVE], 4)
    }

    #[test]
    fn rows_are_read_with_their_lines() {
        assert_eq!(
            pairs("0,1\n0.5, 2e-1\r\n\n1,0"),
            Ok(vec![(1, [0.0, 1.0]), (2, [0.5, 0.2]), (4, [1.0, 0.0])])
        );
        assert_eq!(pairs("\u{feff}l,radius # metres\n# none\n1,2 # one\n"), Ok(vec![(3, [1.0, 2.0])]));
        assert_eq!(pairs(""), Ok(vec![]));
    }

    #[test]
    fn faults_are_named_by_line_and_column() {
        for (text, expected) in [
            ("0,1\n0.5,  x\n", "line 2, column 7: expected a number, at least 0, found \"x\""),
            ("0,1\n1.5,1\n", "line 2, column 1: expected l from 0 to 1, found \"1.5\""),
            ("0,nan\n", "line 1, column 3: expected a number, at least 0 (and at most 1e9), found \"nan\""),
            ("0,1,2\n", "line 1: expected 2 numbers, l,radius, found 3"),
            ("l,radius\nl,radius\n", "line 2, column 1: expected a number l from 0 to 1, found \"l\""),
            ("0,1\n0,1\n0,1\n0,1\n0,1\n", "line 5: more than 4 rows"),
            ("0,\u{1b}[2J\n", "line 1, column 3: expected a number, at least 0, found \"\\u{1b}[2J\""),
        ] {
            assert_eq!(pairs(text).expect_err(text), expected);
        }
        assert!(
            pairs(&"1".repeat(1 << 17)).is_err() && rows::<1>(b"\xff\n\xff", "x", [&limit::ANY], 9).is_err()
        );
    }
}
