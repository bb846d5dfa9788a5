//! `radius`: a number, keys, a named profile, or a file of keys.

use super::error::Fault;
use super::input::Inputs;
use super::keys::RADIUS;
use super::limit::{self, Limit};
use super::reader::{Item, Reader, Words};
use super::rows::rows;
use crate::curve::{Profile, ProfileError, sampling_error};

const EXPECTED: &str = "a number above 0, or keys [[l, radius], ...]";
/// Keys that a file may hold.
const MOST_KEYS: usize = 100_000;

#[derive(Debug, Clone, Copy, PartialEq)]
enum Kind {
    Sinusoidal,
    Growing,
}

static KINDS: Words<Kind> =
    Words { known: &[("sinusoidal", Kind::Sinusoidal), ("growing", Kind::Growing)], later: &[], instead: "" };

/// The keys of each kind, besides its name.
const OWN: [(Kind, &[&str]); 2] =
    [(Kind::Sinusoidal, &["mean", "amplitude", "waves", "phase"]), (Kind::Growing, &["from", "to", "power"])];

/// A radius, and where it is through samples of a file, the estimate of its error in metres.
#[derive(Debug)]
pub(super) struct Radius {
    pub(super) profile: Profile,
    pub(super) sampling_error: Option<f64>,
}

impl From<Profile> for Radius {
    fn from(profile: Profile) -> Radius {
        Radius { profile, sampling_error: None }
    }
}

/// The radius of a tube; on a closed curve keys go around.
pub(super) fn radius(item: Item<'_>, closed: bool, inputs: &Inputs<'_>) -> Option<Radius> {
    // A table may also be a number over time.
    let moves = item.has("keys") || item.has("period");
    if item.is_number() && (moves || !item.is_table()) {
        return Some(Profile::constant(item.number(&limit::POSITIVE)?).ok()?.into());
    }
    if item.is_table() {
        return table(&item, &item.table(&RADIUS)?, closed, inputs);
    }
    let items = item.array(EXPECTED)?;
    // Every key is read, so that each fault among them is found.
    let keys: Vec<_> = items.iter().map(key).collect();
    let keys: Vec<_> = keys.into_iter().collect::<Option<_>>()?;
    let place = |key: usize| (items.get(key).unwrap_or(&item).span(), String::new());
    Some(keyed(&keys, closed, &item, None, place)?.into())
}

/// A profile through keys, the place of each of which is a span and what comes before its message; `file` is where they are
/// from, if not from the scene.
fn keyed(
    keys: &[(f64, f64)],
    closed: bool,
    item: &Item<'_>,
    file: Option<&str>,
    place: impl Fn(usize) -> (std::ops::Range<usize>, String),
) -> Option<Profile> {
    if !keys.iter().any(|(_, r)| limit::POSITIVE.admits(*r)) {
        let title = if keys.is_empty() { "`radius` has no keys" } else { "`radius` is 0 everywhere" };
        let label = match file {
            None => format!("expected {EXPECTED}"),
            Some(path) if keys.is_empty() => format!("expected keys, l,radius a line, found none in {path}"),
            Some(path) => format!("expected a radius above 0 in {path}"),
        };
        item.report(Fault::at(item.span(), title).label(label));
        return None;
    }
    let profile = if closed { Profile::keyed_closed(keys) } else { Profile::keyed(keys) };
    let report = |error| {
        let (key, label) = match error {
            ProfileError::Order { key, .. } => (key, "expected an l not below that of the key before"),
            ProfileError::Close { key } => {
                (key, "expected an l 1e-9 or more above that of the key before, or the same")
            }
            ProfileError::Repeat { key, .. } => {
                (key, "expected at most two keys at one l, and one at 0 and at 1")
            }
            other => return Fault::at(item.span(), "unusable `radius`").label(other.to_string()),
        };
        let (span, before) = place(key);
        Fault::at(span, "misplaced key of `radius`").label(before + label)
    };
    profile.map_err(|error| item.report(report(error))).ok()
}

fn key(item: &Item<'_>) -> Option<(f64, f64)> {
    const EXPECTED: &str = "a key [l, radius]";
    let pair = item.array(EXPECTED)?;
    let [l, r] = pair.as_slice() else {
        item.report(
            Fault::at(item.span(), "wrong length for a key of `radius`")
                .label(format!("expected {EXPECTED}, found {}", pair.len())),
        );
        return None;
    };
    // Both are read before either is given up, so that the faults of both are found.
    let (l, r) = (l.number(&limit::PLACE), r.number(&limit::NOT_NEGATIVE));
    Some((l?, r?))
}

/// A named profile, or one from a file.
fn table(item: &Item<'_>, table: &Reader<'_>, closed: bool, inputs: &Inputs<'_>) -> Option<Radius> {
    let kind = table.get("kind").map(|kind| kind.word(&KINDS));
    let file = table.get("file");
    let mut sound = true;
    // Every key is read, so that each fault among them is found.
    let mut read = |key: &'static str, limit: &Limit| {
        let found = table.get(key).map(|item| item.number(limit));
        sound &= found != Some(None);
        found.flatten()
    };
    let [mean, amplitude, phase] =
        [("mean", &limit::POSITIVE), ("amplitude", &limit::NOT_NEGATIVE), ("phase", &limit::ANY)]
            .map(|(key, limit)| read(key, limit));
    let waves = read("waves", &limit::WAVES);
    let [from, to] = ["from", "to"].map(|key| read(key, &limit::NOT_NEGATIVE));
    let power = read("power", &limit::POWER);
    let profile = match (kind, file) {
        (Some(_), Some(file)) => {
            if file.text().is_some() {
                let fault = Fault::at(file.span(), "`file` contradicts `kind`").label("give one of the two");
                let kind = table.get("kind").map_or(item.span(), |kind| kind.span());
                item.report(fault.related(kind, "the kind is given here"));
            }
            return None;
        }
        (None, Some(file)) => {
            strange(table, None, "a radius from a file")?;
            return from_file(&file, closed, inputs);
        }
        (None, None) => {
            item.report(
                Fault::at(item.span(), "a `radius` without `kind` or `file`")
                    .label(format!("expected {EXPECTED}, or a key `kind`: {}", KINDS.choice()))
                    .absence(),
            );
            return None;
        }
        (Some(kind), None) => {
            let kind = kind?;
            strange(table, Some(kind), &format!("a {} radius", name(kind)))?;
            if !sound {
                return None;
            }
            match kind {
                Kind::Sinusoidal => {
                    let mean = required(item, "mean", mean, "{ kind = \"sinusoidal\", mean = 0.2 }")?;
                    if let (Some(found), Some(given)) = (amplitude, table.get("amplitude"))
                        && found > mean
                    {
                        given.report(
                            Fault::at(given.span(), "`amplitude` is larger than `mean`")
                                .label(format!("expected at most {mean}, so that no radius is below 0")),
                        );
                        return None;
                    }
                    let amplitude = amplitude.unwrap_or(0.5 * mean);
                    Profile::sinusoidal(mean, amplitude, waves.unwrap_or(4.0), phase.unwrap_or(0.0))
                }
                Kind::Growing => {
                    let to = required(item, "to", to, "{ kind = \"growing\", to = 0.5 }")?;
                    let from = from.unwrap_or(0.0);
                    if !limit::POSITIVE.admits(from.max(to)) {
                        item.report(
                            Fault::at(item.span(), "`radius` is 0 everywhere")
                                .label("expected `from` or `to` above 0"),
                        );
                        return None;
                    }
                    Profile::growing(from, to, power.unwrap_or(1.0))
                }
            }
        }
    };
    let profile = profile.map_err(|error| {
        item.report(Fault::at(item.span(), "unusable `radius`").label(error.to_string()));
    });
    profile.ok().map(Radius::from)
}

fn required(item: &Item<'_>, key: &str, value: Option<f64>, example: &str) -> Option<f64> {
    if value.is_none() {
        item.report(
            Fault::at(item.span(), format!("a `radius` without `{key}`"))
                .label(format!("expected such as: radius = {example}"))
                .absence(),
        );
    }
    value
}

/// Reports keys that belong to another kind of radius than `own`; `what` names that.
fn strange(table: &Reader<'_>, own: Option<Kind>, what: &str) -> Option<()> {
    let mut sound = true;
    for (kind, keys) in OWN.iter().filter(|(kind, _)| Some(*kind) != own) {
        let name = name(*kind);
        for (key, span) in keys.iter().filter_map(|key| Some((key, table.key_span(key)?))) {
            sound = false;
            table.report(
                Fault::at(span, format!("key `{key}` does not belong to {what}"))
                    .label(format!("only to kind \"{name}\"")),
            );
        }
    }
    sound.then_some(())
}

fn name(kind: Kind) -> &'static str {
    KINDS.known.iter().find(|(_, known)| *known == kind).map_or("", |(name, _)| name)
}

fn from_file(item: &Item<'_>, closed: bool, inputs: &Inputs<'_>) -> Option<Radius> {
    let (path, bytes) = inputs.read(item)?;
    let rows = rows(&bytes, "l,radius", [&limit::PLACE, &limit::NOT_NEGATIVE], MOST_KEYS);
    let refuse = |error: String| {
        item.report(Fault::at(item.span(), "malformed `file`").label(format!("{path}, {error}")));
    };
    let rows = rows.map_err(refuse).ok()?;
    let keys: Vec<(f64, f64)> = rows.iter().map(|(_, [l, r])| (*l, *r)).collect();
    let place = |key: usize| {
        let line = rows.get(key).map_or(1, |(line, _)| *line);
        (item.span(), format!("{path}, line {line}: "))
    };
    let profile = keyed(&keys, closed, item, Some(path), place)?;
    Some(Radius { profile, sampling_error: sampling_error(&keys, closed) })
}
