//! Numbers in words.

use bytesize::ByteSize;

/// Three significant digits, without a tail of zeros.
pub(crate) fn figure(x: f64) -> String {
    if x == 0.0 {
        return "0".to_owned();
    }
    if !x.is_finite() {
        return format!("{x}");
    }
    let magnitude = x.abs();
    if !(1e-3..1e5).contains(&magnitude) {
        return format!("{x:.2e}");
    }
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "from 0 to 5")]
    let decimals = (2.0 - libm::log10(magnitude).floor()).clamp(0.0, 5.0) as usize;
    let text = format!("{x:.decimals$}");
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_owned() } else { text }
}

/// A part of something, in per cent.
pub(crate) fn part(x: f64) -> String {
    format!("{} %", figure(100.0 * x))
}

pub(crate) fn seconds(x: f64) -> String {
    if x < 1e-3 {
        format!("{} µs", figure(1e6 * x))
    } else if x < 1.0 {
        format!("{} ms", figure(1e3 * x))
    } else {
        format!("{} s", figure(x))
    }
}

pub(crate) fn metres(x: f64) -> String {
    if (1e-3..0.1).contains(&x) { format!("{} mm", figure(1e3 * x)) } else { format!("{} m", figure(x)) }
}

pub(crate) fn bytes(x: f64) -> String {
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "saturates")]
    let whole = x.max(0.0).round() as u64;
    ByteSize::b(whole).display().iec().to_string()
}

/// A word of a command line, so that a shell takes it as it is.
pub(crate) fn quoted(word: &str) -> String {
    let is_plain = |c: char| c.is_ascii_alphanumeric() || "_./-+=:,@%".contains(c);
    if !word.is_empty() && word.chars().all(is_plain) {
        return word.to_owned();
    }
    format!("'{}'", word.replace('\'', "'\\''"))
}

/// A number of which only whole ones are of interest.
pub(super) fn whole(x: f64) -> String {
    if !(1.0..1e15).contains(&x) {
        return figure(x);
    }
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "from 1 to 1e15")]
    let n = x.round() as u64;
    count(n)
}

/// With spaces between thousands.
pub(crate) fn count(n: u64) -> String {
    let digits = n.to_string();
    let mut text = String::new();
    for (place, digit) in digits.chars().enumerate() {
        if place > 0 && (digits.len() - place).is_multiple_of(3) {
            text.push('\u{202f}');
        }
        text.push(digit);
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shells_take_words_as_they_are() {
        let words = ["scenes/a-1.toml", "a b", "<b>\"x\"&y", "it's", ""].map(quoted);
        assert_eq!(words, ["scenes/a-1.toml", "'a b'", "'<b>\"x\"&y'", "'it'\\''s'", "''"]);
        assert_eq!(figure(-0.0), "0");
    }

    #[test]
    fn three_digits_are_shown() {
        let shown = [0.0, 0.012_345, 1.0, 12.345, 99_950.0, 123_456.0, 1e-5, -0.5].map(figure);
        assert_eq!(shown, ["0", "0.0123", "1", "12.3", "99950", "1.23e5", "1.00e-5", "-0.5"]);
        assert_eq!(
            [part(0.02), seconds(0.0123), metres(0.01), count(1_234_567)],
            ["2 %", "12.3 ms", "10 mm", "1\u{202f}234\u{202f}567"]
        );
        assert_eq!([whole(1e4), whole(0.1)], ["10\u{202f}000", "0.1"]);
        // As on a terminal.
        assert_eq!([bytes(512.0), bytes(1e5)], ["512 B", "97.7 KiB"]);
    }
}
