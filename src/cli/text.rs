//! Numbers and names for people.

use std::fmt::Display;
use std::str::FromStr;

use bytesize::ByteSize;

use crate::scene::{Fault, Warnings};

/// Columns that the names of values take.
const NAMES: usize = 21;

/// Lines of names and values, aligned.
#[derive(Debug, Default)]
pub(super) struct Table {
    text: String,
}

impl Table {
    /// A line without a name.
    pub(super) fn heading(&mut self, text: impl Display) {
        self.text.push_str(&format!("{text}\n"));
    }

    /// A value with its name.
    pub(super) fn row(&mut self, name: &str, value: impl Display) {
        self.text.push_str(&format!("  {name:<NAMES$}  {value}\n"));
    }

    /// Several values under one name, a line each; `none` where there are none.
    pub(super) fn rows(&mut self, name: &str, values: &[String], none: &str) {
        self.row(name, values.first().map_or(none, String::as_str));
        for value in values.iter().skip(1) {
            self.row("", value);
        }
    }

    pub(super) fn finish(self) -> String {
        self.text
    }
}

/// A count with its thousands set apart.
pub(super) fn count(n: u64) -> String {
    let digits = n.to_string();
    let mut out = String::new();
    for (index, digit) in digits.chars().enumerate() {
        if index > 0 && (digits.len() - index).is_multiple_of(3) {
            out.push(',');
        }
        out.push(digit);
    }
    out
}

/// A count of things, whose plural takes an s.
pub(super) fn number(n: u64, thing: &str) -> String {
    format!("{} {thing}{}", count(n), if n == 1 { "" } else { "s" })
}

/// Such as `1.5 GiB`.
pub(super) fn bytes(n: u64) -> String {
    ByteSize(n).display().iec().to_string()
}

/// Four significant digits.
pub(super) fn short(x: f64) -> String {
    // Beyond that zeros are hard to count.
    if x.is_finite() && x.abs() >= 1e12 {
        return format!("{x:.3e}");
    }
    format!("{x:.3e}").parse::<f64>().map_or_else(|_| x.to_string(), |x| x.to_string())
}

/// Three numbers of four significant digits.
pub(super) fn vector(v: [f64; 3]) -> String {
    let [x, y, z] = v.map(short);
    format!("({x}, {y}, {z})")
}

/// A box by two of its corners.
pub(super) fn bounds(bounds: Option<[[f64; 3]; 2]>) -> String {
    bounds.map_or_else(|| "none".to_owned(), |[lo, hi]| format!("{} to {} m", vector(lo), vector(hi)))
}

/// Three counts.
fn dimensions([x, y, z]: [u64; 3]) -> String {
    format!("{} x {} x {}", count(x), count(y), count(z))
}

/// A voxel size in metres, with the voxels along each side of the density.
pub(super) fn voxels(size: f64, sides: [u64; 3]) -> String {
    format!("{} m ({} voxels)", short(size), dimensions(sides))
}

/// Warnings of a scene, each with its line and column.
pub(super) fn warnings(warnings: &Warnings) -> Vec<String> {
    let show =
        |fault: &Fault| format!("line {}, column {}: {}", fault.line(), fault.column(), fault.message());
    warnings.list().iter().map(show).collect()
}

/// What an option takes that is a whole number, from `least` to `most`.
pub(super) fn whole<T>(least: T, most: T) -> impl Fn(&str) -> Result<T, String> + Clone
where
    T: FromStr + PartialOrd + Display + Copy,
{
    move |text| {
        let number = text.parse().ok().filter(|number| (least..=most).contains(number));
        number.ok_or_else(|| format!("expected a whole number from {least} to {most}"))
    }
}

/// Seconds to the millisecond.
pub(super) fn seconds(x: f64) -> String {
    format!("{x:.3} s")
}

/// Without characters that could steer a terminal.
pub(super) fn plain(text: &str) -> String {
    text.chars().map(|c| if c.is_control() { '\u{fffd}' } else { c }).collect()
}

/// On one line and not too long, without characters that could steer a terminal.
pub(super) fn tidy(text: &str) -> String {
    const MOST: usize = 160;
    let line = text.lines().find(|line| !line.trim().is_empty()).unwrap_or_default();
    let mut out: String = plain(line).chars().take(MOST).collect();
    if out.len() < text.trim_end().len() {
        out.push_str(&format!(" ... ({} bytes in all)", text.len()));
    }
    out
}

/// Bytes in hexadecimal.
pub(super) fn hexadecimal(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counts_are_grouped_by_thousands() {
        for (n, expected) in [(0, "0"), (999, "999"), (1000, "1,000"), (1_234_567, "1,234,567")] {
            assert_eq!(count(n), expected);
        }
    }

    #[test]
    fn numbers_keep_four_digits() {
        for (x, expected) in [(0.0097656, "0.009766"), (2.5, "2.5"), (-12346.0, "-12350"), (0.0, "0")] {
            assert_eq!(short(x), expected);
        }
    }

    #[test]
    fn whole_numbers_are_asked_for_in_words() {
        let from_one_to_ten = whole::<u8>(1, 10);
        assert_eq!(["1", "10"].map(&from_one_to_ten), [Ok(1), Ok(10)]);
        for text in ["0", "11", "-1", "300", "1.5", "2.0", "1e1", "ten", "", " 1"] {
            assert_eq!(
                from_one_to_ten(text),
                Err("expected a whole number from 1 to 10".to_owned()),
                "{text:?}"
            );
        }
    }

    #[test]
    fn long_and_hostile_text_is_tamed() {
        assert_eq!(tidy("density"), "density");
        assert_eq!(tidy("a\u{1b}[2J"), "a\u{fffd}[2J");
        assert_eq!(tidy("# one\ntwo\n"), "# one ... (10 bytes in all)");
    }
}
