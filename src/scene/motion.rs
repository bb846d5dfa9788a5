//! Numbers and points that move: how they are written, and where they are at the scene's time.

use std::cell::Cell;

use glam::DVec3;

use super::error::Fault;
use super::keys::{ORBIT, TRACK};
use super::limit::{self, Limit};
use super::reader::{Item, Reader, Words};
use super::track::{Interpolation, Keyed, Track, Wave, sin_cos_turns};

/// The time that moving numbers are read at.
#[derive(Debug)]
pub(super) struct Clock {
    /// Since the start frame.
    pub(super) seconds: f64,
    /// Whether anything was read that moves.
    pub(super) moving: Cell<bool>,
}

/// A number that is a rate, and what it has added up to since time 0.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Rate {
    /// A second.
    pub(super) now: f64,
    pub(super) sum: f64,
}

static INTERPOLATIONS: Words<Interpolation> = Words {
    known: &[
        ("smooth", Interpolation::Smooth),
        ("linear", Interpolation::Linear),
        ("step", Interpolation::Step),
    ],
    later: &[],
    instead: "",
};

/// Keys of tables that are something else, though some of their keys are those of a number over time.
const OTHERS: [&str; 2] = ["kind", "file"];

/// Whether a table is meant as a number over time.
pub(super) fn is_track(item: &Item<'_>) -> bool {
    TRACK.keys.iter().any(|key| item.has(key)) && !OTHERS.iter().any(|key| item.has(key))
}

/// A number over time, every value of which is within `limit`.
pub(super) fn track(item: &Item<'_>, limit: &Limit) -> Option<Track> {
    let table = item.fixed().table(&TRACK)?;
    let given = |keys: &[&'static str]| keys.iter().find_map(|key| Some((*key, table.key_span(key)?)));
    let wave = given(&["amplitude", "mean", "period", "phase"]);
    match (given(&["keys", "interpolation", "repeat"]), wave) {
        (Some((keyed, span)), Some((waved, other))) => {
            let fault = Fault::at(other, format!("`{waved}` and `{keyed}` contradict each other"));
            let fault = fault.label("a number over time is either given by keys or a wave");
            table.report(fault.related(span, format!("`{keyed}` is given here")));
            None
        }
        (None, Some(_)) => wave_track(item, &table, limit).map(Track::Wave),
        _ => keyed_track(item, &table, limit).map(Track::Keyed),
    }
}

fn keyed_track(item: &Item<'_>, table: &Reader<'_>, limit: &Limit) -> Option<Keyed> {
    let interpolation = table.word("interpolation", &INTERPOLATIONS).unwrap_or(Interpolation::Smooth);
    let repeat = table.boolean("repeat").unwrap_or(false);
    let Some(list) = table.get("keys") else {
        let fault = Fault::at(table.span(), format!("`{}` is a number over time without `keys`", item.key()));
        table.report(
            fault
                .label("expected a key such as: keys = [[0, 1], [2.5, 3]]")
                .note("a wave takes `mean`, `amplitude`, `period` and `phase` instead")
                .absence(),
        );
        return None;
    };
    let items = list.array("an array of keys [seconds, value]")?;
    // Every key is read, so that each fault among them is found.
    let keys: Vec<_> = items.iter().map(|key| key_of(item, key, limit)).collect();
    let keys: Vec<_> = keys.into_iter().collect::<Option<_>>()?;
    if keys.is_empty() {
        list.report(Fault::at(list.span(), "`keys` is empty").label("expected keys [[seconds, value], ...]"));
    }
    let misplaced = |key: usize, label: &str| {
        let span = items.get(key).map_or(list.span(), Item::span);
        list.report(Fault::at(span, format!("misplaced key of `{}`", item.key())).label(label));
    };
    for (key, ((before, _), (after, _))) in keys.iter().zip(keys.iter().skip(1)).enumerate() {
        let apart = after - before;
        if apart < 0.0 {
            misplaced(key + 1, "expected a time not before that of the key before");
            return None;
        }
        if apart > 0.0 && !limit::POSITIVE.admits(apart) {
            misplaced(key + 1, "expected a time 1e-9 s or more after that of the key before, or the same");
            return None;
        }
    }
    if let Some(key) = keys.iter().zip(keys.iter().skip(2)).position(|(first, third)| first.0 == third.0) {
        misplaced(key + 2, "expected at most two keys at one time");
        return None;
    }
    if repeat && keys.first().zip(keys.last()).is_some_and(|(first, last)| first.0 == last.0) {
        let span = table.get("repeat").map_or(list.span(), |item| item.span());
        table.report(
            Fault::at(span, "`repeat` without a period").label("expected keys at two times at least"),
        );
        return None;
    }
    Keyed::new(&keys, interpolation, repeat)
}

/// A key, the value of which has the limits and the name of the number.
fn key_of(number: &Item<'_>, item: &Item<'_>, limit: &Limit) -> Option<(f64, f64)> {
    const EXPECTED: &str = "a key [seconds, value]";
    let pair = item.array(EXPECTED)?;
    let [time, value] = pair.as_slice() else {
        item.report(
            Fault::at(item.span(), format!("wrong length for a key of `{}`", number.key()))
                .label(format!("expected {EXPECTED}, found {}", pair.len())),
        );
        return None;
    };
    // Both are read before either is given up, so that the faults of both are found.
    let (time, value) = (time.number(&limit::ANY), value.named(number.key()).number(limit));
    Some((time?, value?))
}

fn wave_track(item: &Item<'_>, table: &Reader<'_>, limit: &Limit) -> Option<Wave> {
    let required = |key: &'static str, limit: &Limit| {
        if table.get(key).is_none() {
            let fault = Fault::at(table.span(), format!("`{}` is a wave without `{key}`", item.key()));
            let example = "expected keys such as: mean = 1, amplitude = 0.5, period = 4";
            table.report(fault.label(example).absence());
        }
        table.number(key, limit)
    };
    let (amplitude, period) = (required("amplitude", &limit::ANY), required("period", &limit::POSITIVE));
    let (mean, phase) = (table.number("mean", &limit::ANY), table.number("phase", &limit::ANY));
    let wave = Wave {
        mean: mean.unwrap_or(0.0),
        amplitude: amplitude?,
        period: period?,
        phase: phase.unwrap_or(0.0),
    };
    let [low, high] = wave.range();
    if !limit.admits(low) || !limit.admits(high) {
        item.report(Fault::at(item.span(), format!("`{}` swings out of range", item.key())).label(format!(
            "from {} to {}; expected {}",
            short(low),
            short(high),
            limit.range
        )));
        return None;
    }
    Some(wave)
}

/// Four significant digits.
fn short(x: f64) -> String {
    format!("{x:.3e}").parse::<f64>().unwrap_or(x).to_string()
}

/// A point: three numbers, or a motion about an axis. Its place is that at the clock's time.
pub(super) fn point(item: &Item<'_>) -> Option<DVec3> {
    match item.clock().filter(|_| item.is_table()) {
        Some(clock) => orbit(item, clock),
        None => item.numbers(&limit::ANY, "a point [x, y, z]").map(DVec3::from_array),
    }
}

fn orbit(item: &Item<'_>, clock: &Clock) -> Option<DVec3> {
    clock.moving.set(true);
    let table = item.table(&ORBIT)?;
    let vector = |key: &'static str| {
        if table.get(key).is_none() {
            let fault = Fault::at(table.span(), format!("a point that moves in a circle, without `{key}`"));
            let example = "expected keys such as: centre = [0, 0, 1], arm = [0.2, 0, 0], period = 5";
            table.report(fault.label(example).absence());
        }
        table.vector(key, &limit::ANY)
    };
    let (centre, arm) = (vector("centre"), vector("arm"));
    let period = match table.get("period") {
        Some(period) => period.fixed().number(&limit::POSITIVE),
        None => {
            let fault = Fault::at(table.span(), "a point that moves in a circle, without `period`");
            table.report(fault.label("expected a key such as: period = 5").absence());
            None
        }
    };
    let axis = match table.get("axis") {
        Some(axis) => direction(&axis),
        None => Some(DVec3::Z),
    };
    let (centre, arm, axis) = (DVec3::from(centre?), DVec3::from(arm?), axis?);
    let (sin, cos) = sin_cos_turns(clock.seconds / period?);
    let point = centre + arm * cos + axis.cross(arm) * sin + axis * (axis.dot(arm) * (1.0 - cos));
    if !point.to_array().iter().all(|x| limit::ANY.admits(*x)) {
        item.report(
            Fault::at(item.span(), "a point too far away").label("expected each coordinate from -1e9 to 1e9"),
        );
        return None;
    }
    Some(point)
}

fn direction(item: &Item<'_>) -> Option<DVec3> {
    let axis = DVec3::from(item.fixed().vector(&limit::ANY)?);
    // Scaled first, so that no square vanishes or overflows.
    let unit = (axis / axis.abs().max_element()).try_normalize();
    if unit.is_none() {
        item.report(Fault::at(item.span(), "`axis` has no length").label("expected a vector other than 0"));
    }
    unit
}
