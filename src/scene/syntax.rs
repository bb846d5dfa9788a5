//! What the TOML parser found wrong, and which of the faults found after it are only its echo.

#![cfg_attr(not(test), deny(clippy::arithmetic_side_effects))]

use std::ops::Range;

use toml::Spanned;
use toml::de::{DeTable, DeValue, Error};

use super::error::{Fault, Faults};

/// Errors that are looked at, the first by position; each takes a pass over its line and the document.
const MOST: usize = 200;

/// Reports the parser's errors, one a line, and removes the faults that they may have caused: those on the same
/// lines, those under a broken table header, those after an array or table that does not close, and everything that
/// is said to be missing.
pub(super) fn report(text: &str, document: &DeTable<'_>, errors: &[Error], faults: &Faults) {
    if errors.is_empty() {
        return;
    }
    let mut errors: Vec<_> = errors
        .iter()
        .map(|error| (error.span().unwrap_or(text.len()..text.len()), error.message()))
        .collect();
    errors.sort_by_key(|(span, _)| (span.start, span.end));
    faults.omit(errors.len().saturating_sub(MOST));
    errors.truncate(MOST);

    // An array or table without its end swallows what follows: every line of it is an error, and keys land elsewhere.
    let open =
        errors.iter().find_map(|(span, _)| Some((unclosed(text, document, span.start)?, span.clone())));
    let trusted = open.as_ref().map_or(text.len(), |(bracket, _)| *bracket);
    errors.retain(|(span, _)| span.start <= trusted);

    let echoes: Vec<_> = errors.iter().map(|(span, _)| reach(text, span)).collect();
    faults.retain(|fault| {
        let at = fault.span().start;
        !fault.is_absence()
            && at < trusted
            && !echoes.iter().any(|range| range.start <= at && at <= range.end)
    });

    let mut reported = None;
    for (span, message) in errors {
        let line = line_of(text, span.start).start;
        if reported.replace(line) != Some(line) {
            faults.report(fault(message, span, text));
        }
    }
    if let Some((bracket, first)) = open {
        faults.report(never_closed(text, bracket, first));
    }
}

/// The parser's message: what is wrong, and after a comma what was expected.
fn fault(message: &str, span: Range<usize>, text: &str) -> Fault {
    if message == "duplicate key" {
        let key = text.get(span.clone()).unwrap_or_default();
        return Fault::at(span, format!("`{key}` is given twice"));
    }
    match message.split_once(", expected ") {
        Some(("string values must be quoted", _)) if text.get(span.clone()).is_some_and(are_numbers) => {
            Fault::at(span, "several numbers as one value").label("expected a `,` between them")
        }
        Some(("string values must be quoted", _)) => Fault::at(span, "a string must be in quotes"),
        Some(("invalid boolean", _)) => {
            Fault::at(span, "a word without quotes").label("expected `true`, `false`, or a string in quotes")
        }
        Some((title, "nothing")) => Fault::at(span, title),
        Some((title, expected)) => Fault::at(span, title).label(format!("expected {expected}")),
        None => Fault::at(span, message),
    }
}

fn are_numbers(text: &str) -> bool {
    !text.is_empty() && text.split_whitespace().all(|word| word.parse::<f64>().is_ok())
}

fn never_closed(text: &str, bracket: usize, first: Range<usize>) -> Fault {
    let is_table = text.as_bytes().get(bracket) == Some(&b'{');
    let (noun, end) = if is_table { ("table", '}') } else { ("array", ']') };
    let fault = Fault::at(bracket..bracket.saturating_add(1), format!("this {noun} is not closed"))
        .label(format!("expected a `{end}` after its last element"));
    if line_of(text, bracket) == line_of(text, first.start) {
        return fault;
    }
    fault.related(first, "this does not fit into it")
}

fn line_of(text: &str, at: usize) -> Range<usize> {
    let bytes = text.as_bytes();
    let (before, after) = bytes.split_at_checked(at).unwrap_or((bytes, &[]));
    let newline = |byte: &u8| *byte == b'\n';
    let start = before.iter().rposition(newline).map_or(0, |newline| newline.saturating_add(1));
    let length = after.iter().position(newline).unwrap_or(after.len());
    start..before.len().saturating_add(length)
}

fn first_byte(text: &str, line: &Range<usize>) -> Option<usize> {
    let bytes = text.as_bytes().get(line.clone()).unwrap_or_default();
    line.clone().zip(bytes).find(|(_, byte)| !byte.is_ascii_whitespace()).map(|(at, _)| at)
}

/// The bytes that may be misread because of a syntax error: its line; after a broken table header, all up to the next.
fn reach(text: &str, span: &Range<usize>) -> Range<usize> {
    let is_header = |line: &Range<usize>| {
        first_byte(text, line).is_some_and(|first| text.as_bytes().get(first) == Some(&b'['))
    };
    let mut line = line_of(text, span.start);
    let start = line.start;
    if is_header(&line) {
        while line.end < text.len() {
            let next = line_of(text, line.end.saturating_add(1));
            if is_header(&next) {
                break;
            }
            line = next;
        }
    }
    start..line.end
}

/// The bracket that opens the array or inline table around byte `at`, where it does not end as it should.
fn unclosed(text: &str, document: &DeTable<'_>, at: usize) -> Option<usize> {
    let value = outermost(text, document, at)?;
    let open = open_brackets(text.get(value.clone())?);
    // Brackets after the error are of what follows the value.
    open.into_iter().map(|bracket| value.start.saturating_add(bracket)).rfind(|bracket| *bracket < at)
}

/// The outermost array or inline table that holds byte `at`.
fn outermost(text: &str, table: &DeTable<'_>, at: usize) -> Option<Range<usize>> {
    table.values().find_map(|value| around(text, value, at))
}

fn around(text: &str, value: &Spanned<DeValue<'_>>, at: usize) -> Option<Range<usize>> {
    let span = value.span();
    let is_container = matches!(text.as_bytes().get(span.start), Some(b'[' | b'{'));
    // A table header stands first in its line, an outermost value never does.
    let is_value = is_container && first_byte(text, &line_of(text, span.start)) != Some(span.start);
    if is_value && span.start < at && at <= span.end {
        return Some(span);
    }
    match value.get_ref() {
        DeValue::Table(table) => outermost(text, table, at),
        DeValue::Array(array) if !is_value => array.iter().find_map(|value| around(text, value, at)),
        _ => None,
    }
}

/// The brackets, outside of strings and comments, that are open at the end or where a wrong one closes.
fn open_brackets(value: &str) -> Vec<usize> {
    let mut open = Vec::new();
    let mut bytes = value.bytes().enumerate();
    while let Some((at, byte)) = bytes.next() {
        match byte {
            b'[' | b'{' => open.push((at, byte)),
            // The two closing brackets follow the opening ones at the same distance in ASCII.
            b']' | b'}' if open.last().is_some_and(|(_, opened)| byte.checked_sub(2) == Some(*opened)) => {
                open.pop();
            }
            b']' | b'}' => break,
            b'#' => {
                bytes.find(|(_, byte)| *byte == b'\n');
            }
            b'\'' => {
                bytes.find(|(_, byte)| *byte == b'\'');
            }
            b'"' => {
                while let Some((_, byte)) = bytes.find(|(_, byte)| matches!(byte, b'"' | b'\\'))
                    && byte == b'\\'
                {
                    bytes.next();
                }
            }
            _ => {}
        }
    }
    open.into_iter().map(|(at, _)| at).collect()
}
