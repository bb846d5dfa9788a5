//! Typed reading of a spanned TOML document: every method reports what does not fit and goes on.
//!
//! A method that finds a fault has reported it and returns `None`. The caller then puts the default in its place: what
//! is built from it is thrown away, but all other faults are still found.

use std::ops::{Range, RangeInclusive};

use toml::Spanned;
use toml::de::{DeTable, DeValue};

use super::error::{Fault, Faults};
use super::keys::{LAYER, SECTIONS, Section, TUBE};
use super::limit::Limit;
use super::motion::{self, Clock, Rate};
use super::track::Track;

/// A table whose keys are all known.
#[derive(Debug, Clone, Copy)]
pub(super) struct Reader<'a> {
    table: &'a DeTable<'a>,
    start: usize,
    end: usize,
    faults: &'a Faults,
    /// Where numbers may move.
    clock: Option<&'a Clock>,
}

impl<'a> Reader<'a> {
    /// Reports the keys that `section` does not have.
    pub(super) fn new(
        table: &'a DeTable<'a>,
        span: Range<usize>,
        section: &Section,
        faults: &'a Faults,
    ) -> Reader<'a> {
        for key in table.keys() {
            if !section.keys.contains(&key.get_ref().as_ref()) {
                faults.report(unknown_key(key.get_ref(), key.span(), section));
            }
        }
        Reader { table, start: span.start, end: span.end, faults, clock: None }
    }

    /// The same table, whose numbers may move.
    pub(super) fn timed(self, clock: &'a Clock) -> Reader<'a> {
        Reader { clock: Some(clock), ..self }
    }

    /// The table, or the line that opens it.
    pub(super) fn span(&self) -> Range<usize> {
        self.start..self.end
    }

    pub(super) fn report(&self, fault: Fault) {
        self.faults.report(fault);
    }

    /// Keeps what is no fault, but hardly meant.
    pub(super) fn warn(&self, warning: Fault) {
        self.faults.warn(warning);
    }

    /// The value of a key, where it is given.
    pub(super) fn get(&self, key: &'static str) -> Option<Item<'a>> {
        self.table.get(key).map(|value| Item { key, value, faults: self.faults, clock: self.clock })
    }

    /// Where a key itself stands.
    pub(super) fn key_span(&self, key: &str) -> Option<Range<usize>> {
        self.table.get_key_value(key).map(|(key, _)| key.span())
    }

    pub(super) fn number(&self, key: &'static str, limit: &Limit) -> Option<f64> {
        self.get(key)?.number(limit)
    }

    pub(super) fn integer(&self, key: &'static str, range: RangeInclusive<i64>) -> Option<i64> {
        self.get(key)?.integer(range)
    }

    pub(super) fn boolean(&self, key: &'static str) -> Option<bool> {
        self.get(key)?.boolean()
    }

    pub(super) fn vector(&self, key: &'static str, limit: &Limit) -> Option<[f64; 3]> {
        self.get(key)?.vector(limit)
    }

    pub(super) fn rate(&self, key: &'static str, limit: &Limit) -> Option<Rate> {
        self.get(key)?.rate(limit)
    }

    pub(super) fn rates(&self, key: &'static str, limit: &Limit) -> Option<[Rate; 3]> {
        self.get(key)?.rates(limit)
    }

    pub(super) fn word<T: Copy>(&self, key: &'static str, words: &Words<T>) -> Option<T> {
        self.get(key)?.word(words)
    }

    pub(super) fn table(&self, key: &'static str, section: &Section) -> Option<Reader<'a>> {
        self.get(key)?.table(section)
    }

    /// The tables of an array of tables, `[[key]]`; none where it is not given.
    pub(super) fn tables(&self, key: &'static str, section: &Section) -> Vec<Reader<'a>> {
        let Some(item) = self.get(key) else { return Vec::new() };
        if let DeValue::Table(table) = item.value.get_ref() {
            self.report(
                Fault::at(item.span(), format!("`{key}` is given as a single table"))
                    .label(format!("expected {}, which may be repeated", section.name)),
            );
            return vec![Reader {
                clock: self.clock,
                ..Reader::new(table, item.span(), section, self.faults)
            }];
        }
        let expected = format!("tables, each under its own {}", section.name);
        item.array(&expected).into_iter().flatten().filter_map(|item| item.table(section)).collect()
    }
}

/// A value, and the key it belongs to.
#[derive(Debug, Clone, Copy)]
pub(super) struct Item<'a> {
    key: &'static str,
    value: &'a Spanned<DeValue<'a>>,
    faults: &'a Faults,
    clock: Option<&'a Clock>,
}

impl<'a> Item<'a> {
    pub(super) fn span(&self) -> Range<usize> {
        self.value.span()
    }

    /// The key it belongs to.
    pub(super) fn key(&self) -> &'static str {
        self.key
    }

    /// The same value under another name.
    pub(super) fn named(self, key: &'static str) -> Item<'a> {
        Item { key, ..self }
    }

    /// The time that numbers are read at, where they may move.
    pub(super) fn clock(&self) -> Option<&'a Clock> {
        self.clock
    }

    /// The same value, whose numbers may not move.
    pub(super) fn fixed(self) -> Item<'a> {
        Item { clock: None, ..self }
    }

    pub(super) fn is_text(&self) -> bool {
        self.value.get_ref().is_str()
    }

    pub(super) fn is_table(&self) -> bool {
        self.value.get_ref().is_table()
    }

    /// Whether it is a table with this key.
    pub(super) fn has(&self, key: &str) -> bool {
        self.value.get_ref().as_table().is_some_and(|table| table.contains_key(key))
    }

    /// Whether it is a number, or one over time where that may be.
    pub(super) fn is_number(&self) -> bool {
        matches!(self.value.get_ref(), DeValue::Integer(_) | DeValue::Float(_))
            || self.clock.is_some() && motion::is_track(self)
    }

    pub(super) fn report(&self, fault: Fault) {
        self.faults.report(fault);
    }

    /// Reports a value of the wrong type.
    pub(super) fn mistyped(&self, expected: &str) {
        if motion::is_track(self) {
            return self.report(
                Fault::at(self.span(), format!("`{}` cannot change over time", self.key))
                    .label(format!("expected {expected}"))
                    .note("numbers of a [[tube]] can, except whole ones and those that describe a motion"),
            );
        }
        let mut fault = Fault::at(self.span(), format!("wrong type for `{}`", self.key))
            .label(format!("expected {expected}, found {}", kind(self.value.get_ref())));
        let looks_right = |text: &str| {
            text.parse::<f64>().is_ok() && expected.contains("number") || matches!(text, "true" | "false")
        };
        if self.value.get_ref().as_str().is_some_and(looks_right) {
            fault = fault.note("remove the quotes");
        }
        self.report(fault);
    }

    /// Reports a number outside its range.
    fn misfit(&self, how: &str, expected: &str) {
        self.report(
            Fault::at(self.span(), format!("`{}` is {how}", self.key)).label(format!("expected {expected}")),
        );
    }

    /// A number, at the clock's time where it may move.
    pub(super) fn number(&self, limit: &Limit) -> Option<f64> {
        if let Some(clock) = self.clock.filter(|_| self.is_table()) {
            return self.track(clock, limit).map(|track| track.at(clock.seconds));
        }
        let Some(x) = float(self.value.get_ref()) else {
            self.mistyped(limit.noun);
            return None;
        };
        if !limit.admits(x) {
            self.misfit(if x.is_finite() { "out of range" } else { "not finite" }, limit.range);
            return None;
        }
        Some(x)
    }

    /// A number that is a rate; where nothing moves it has added up to nothing.
    pub(super) fn rate(&self, limit: &Limit) -> Option<Rate> {
        let seconds = self.clock.map_or(0.0, |clock| clock.seconds);
        if let Some(clock) = self.clock.filter(|_| self.is_table()) {
            let track = self.track(clock, limit)?;
            return Some(Rate { now: track.at(seconds), sum: track.integral(seconds) });
        }
        self.number(limit).map(|now| Rate { now, sum: now * seconds })
    }

    /// Three of them.
    pub(super) fn rates(&self, limit: &Limit) -> Option<[Rate; 3]> {
        self.elements("three numbers", |item| item.rate(limit))
    }

    fn track(&self, clock: &Clock, limit: &Limit) -> Option<Track> {
        clock.moving.set(true);
        motion::track(self, limit)
    }

    pub(super) fn integer(&self, range: RangeInclusive<i64>) -> Option<i64> {
        let expected = format!("a whole number from {} to {}", range.start(), range.end());
        let DeValue::Integer(digits) = self.value.get_ref() else {
            self.mistyped(&expected);
            return None;
        };
        match i64::from_str_radix(digits.as_str(), digits.radix()) {
            Ok(n) if range.contains(&n) => Some(n),
            _ => {
                self.misfit("out of range", &expected);
                None
            }
        }
    }

    pub(super) fn boolean(&self) -> Option<bool> {
        let found = self.value.get_ref().as_bool();
        if found.is_none() {
            self.mistyped("true or false");
        }
        found
    }

    pub(super) fn text(&self) -> Option<&'a str> {
        let found = self.value.get_ref().as_str();
        if found.is_none() {
            self.mistyped("a string");
        }
        found
    }

    pub(super) fn array(&self, expected: &str) -> Option<Vec<Item<'a>>> {
        let Some(array) = self.value.get_ref().as_array() else {
            self.mistyped(expected);
            return None;
        };
        Some(array.iter().map(|value| Item { value, ..*self }).collect())
    }

    /// An array of `N` numbers, each within `limit`.
    pub(super) fn numbers<const N: usize>(&self, limit: &Limit, expected: &str) -> Option<[f64; N]> {
        self.elements(expected, |item| item.number(limit))
    }

    /// An array of N values, each read by `read`.
    fn elements<T: Copy, const N: usize>(
        &self,
        expected: &str,
        read: impl Fn(&Item<'a>) -> Option<T>,
    ) -> Option<[T; N]> {
        let items = self.array(expected)?;
        // Every element is read, so that each fault among them is found.
        let elements: Vec<Option<T>> = items.iter().map(read).collect();
        let Ok(elements) = <[Option<T>; N]>::try_from(elements) else {
            self.report(
                Fault::at(self.span(), format!("wrong length for `{}`", self.key))
                    .label(format!("expected {expected}, found {}", items.len())),
            );
            return None;
        };
        let elements: Option<Vec<T>> = elements.into_iter().collect();
        elements.and_then(|elements| elements.try_into().ok())
    }

    /// An array of three numbers, each within `limit`.
    pub(super) fn vector(&self, limit: &Limit) -> Option<[f64; 3]> {
        self.numbers(limit, "three numbers")
    }

    /// Three numbers, or one that stands for all three.
    pub(super) fn vector_or_number(&self, limit: &Limit) -> Option<[f64; 3]> {
        if self.is_number() {
            return self.number(limit).map(|x| [x; 3]);
        }
        self.numbers(limit, "a number, or three numbers")
    }

    pub(super) fn table(&self, section: &Section) -> Option<Reader<'a>> {
        let DeValue::Table(table) = self.value.get_ref() else {
            self.mistyped("a table");
            return None;
        };
        Some(Reader { clock: self.clock, ..Reader::new(table, self.span(), section, self.faults) })
    }

    pub(super) fn word<T: Copy>(&self, words: &Words<T>) -> Option<T> {
        let Some(found) = self.value.get_ref().as_str() else {
            self.mistyped(&words.choice());
            return None;
        };
        if let Some((_, meaning)) = words.known.iter().find(|(word, _)| *word == found) {
            return Some(*meaning);
        }
        let fault = Fault::at(self.span(), format!("unknown `{}` \"{}\"", self.key, shorten(found)));
        self.report(if words.later.contains(&found) {
            Fault::at(self.span(), format!("`{}` \"{found}\" is not in this version", self.key))
                .label(words.instead)
        } else if let Some(word) = nearest(found, words.known.iter().map(|(word, _)| *word)) {
            fault.label(format!("did you mean \"{word}\"?"))
        } else {
            fault.label(format!("expected {}", words.choice()))
        });
        None
    }
}

/// The words that a key takes, with their meanings.
#[derive(Debug)]
pub(super) struct Words<T: 'static> {
    /// The words of this version.
    pub(super) known: &'static [(&'static str, T)],
    /// Words that the format has but this version does not take.
    pub(super) later: &'static [&'static str],
    /// What this version does instead of those.
    pub(super) instead: &'static str,
}

impl<T> Words<T> {
    /// What to expect: one of the words.
    pub(super) fn choice(&self) -> String {
        let words: Vec<_> = self.known.iter().map(|(word, _)| format!("\"{word}\"")).collect();
        match words.as_slice() {
            [word] => word.clone(),
            words => format!("one of {}", words.join(", ")),
        }
    }
}

fn unknown_key(key: &str, span: Range<usize>, section: &Section) -> Fault {
    if let Some((_, instead)) = section.later.iter().find(|(later, _)| *later == key) {
        return Fault::at(span, format!("key `{key}` of {} is not in this version", section.name))
            .label(*instead);
    }
    let fault = Fault::at(span, format!("unknown key `{}` in {}", shorten(key), section.name));
    let homes: Vec<_> =
        SECTIONS.iter().filter(|other| other.keys.contains(&key)).map(|other| other.name).collect();
    if !homes.is_empty() {
        let fault = fault.label(format!("a key of {}", homes.join(", ")));
        return if section.name == LAYER.name && TUBE.keys.contains(&key) {
            fault.note("keys below a [[tube.layer]] line belong to that layer: put the tube's own above it")
        } else {
            fault
        };
    }
    match nearest(key, section.keys.iter().copied()) {
        Some(known) => fault.label(format!("did you mean `{known}`?")),
        None => fault.label(format!("expected one of {}", section.keys.join(", "))),
    }
}

/// The candidate that `found` is most likely a slip of, if any is near: at most one edit in three letters.
fn nearest<'a>(found: &str, candidates: impl Iterator<Item = &'a str>) -> Option<&'a str> {
    const LONGEST: usize = 40;
    let plain = |text: &str| text.to_lowercase().replace('_', "-");
    if found.len() > LONGEST {
        return None;
    }
    let found = plain(found);
    candidates
        .map(|word| (strsim::damerau_levenshtein(&found, &plain(word)), word))
        .filter(|(edits, word)| *edits <= (word.len() / 3).max(1) && *edits < found.len())
        .min_by_key(|(edits, _)| *edits)
        .map(|(_, word)| word)
}

/// The beginning of a text that may be long.
fn shorten(text: &str) -> String {
    const LONGEST: usize = 40;
    match text.char_indices().nth(LONGEST) {
        Some((end, _)) => format!("{}...", text.split_at(end).0),
        None => text.to_owned(),
    }
}

fn float(value: &DeValue<'_>) -> Option<f64> {
    match value {
        DeValue::Float(text) => text.as_str().parse().ok(),
        DeValue::Integer(digits) if digits.radix() == 10 => digits.as_str().parse().ok(),
        // Digits fail here only where there are too many of them, or none after a syntax error.
        DeValue::Integer(digits) => {
            Some(i64::from_str_radix(digits.as_str(), digits.radix()).map_or(f64::INFINITY, |n| n as f64))
        }
        _ => None,
    }
}

fn kind(value: &DeValue<'_>) -> &'static str {
    match value {
        DeValue::String(_) => "a string",
        DeValue::Integer(_) => "a whole number",
        DeValue::Float(_) => "a decimal number",
        DeValue::Boolean(true) => "`true`",
        DeValue::Boolean(false) => "`false`",
        DeValue::Datetime(_) => "a date or time",
        DeValue::Array(_) => "an array",
        DeValue::Table(_) => "a table",
    }
}
