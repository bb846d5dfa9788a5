//! Points as text: what is read is written and read again, the same.

use std::fmt::Write;

use vdbake::formats::csv;

use super::within;

pub(crate) fn run(data: &[u8]) -> bool {
    // A point of 24 bytes takes six at least, "1,2,3\n", and lists double; a line of 64 KiB has as many fields of 16 bytes.
    let most = (2 << 20) + 12 * data.len() as u64;
    let points = match within(most, || csv::read_points(&mut &data[..])) {
        Ok(points) => points,
        Err(error) => {
            let text = error.to_string();
            assert!(text.len() < 1000 && !text.contains(|c: char| c.is_control()), "{text:?}");
            return false;
        }
    };
    let mut text = String::new();
    for [x, y, z] in &points {
        writeln!(text, "{x:e},{y:e},{z:e}").expect("a string");
    }
    let again = csv::read_points(&mut text.as_bytes()).expect("numbers");
    assert_eq!(again.len(), points.len());
    for (a, b) in again.iter().flatten().zip(points.iter().flatten()) {
        assert!(a.to_bits() == b.to_bits() || (a.is_nan() && b.is_nan()), "{a} is not {b}");
    }
    true
}
