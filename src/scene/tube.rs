//! `[[tube]]`: a curve, what goes along it, and what surrounds it.

use std::collections::BTreeMap;

use super::error::Fault;
use super::keys::{CURVE, ENVELOPE, LAYER, REST};
use super::reader::{Item, Reader, Words};
use super::{Caps, Conserve, Overlap, Radial, Rest, Tube, axis, layer, limit, ramp};
use crate::curve::{Curve, FrameRule, Profile, ProfileError};

/// Radius of a tube that gives none, as a part of its curve's length.
const RADIUS: f64 = 0.1;
/// Part of the length over which a faded end fades.
const AXIAL: f64 = 0.1;

#[derive(Debug, Clone, Copy, PartialEq)]
enum End {
    Flat,
    Fade,
    Round,
}

static FRAMES: Words<FrameRule> = Words {
    known: &[("rotation-minimising", FrameRule::RotationMinimising), ("frenet", FrameRule::Frenet)],
    later: &[],
    instead: "",
};

static CAPS: Words<End> = Words {
    known: &[("fade", End::Fade), ("flat", End::Flat), ("round", End::Round)],
    later: &[],
    instead: "",
};

static CONSERVE: Words<Conserve> = Words {
    known: &[("off", Conserve::Off), ("radius", Conserve::Radius), ("full", Conserve::Full)],
    later: &[],
    instead: "",
};

pub(super) static OVERLAP: Words<Overlap> = Words {
    known: &[
        ("max", Overlap::Max),
        ("sum", Overlap::Sum),
        ("closest", Overlap::Closest),
        ("blend", Overlap::Blend),
    ],
    later: &[],
    instead: "",
};

static RADIAL: Words<Radial> = Words {
    known: &[("smooth", Radial::Smooth), ("linear", Radial::Linear), ("hard", Radial::Hard)],
    later: &[],
    instead: "",
};

/// All tubes, those without a name named by their number. Those without a valid curve are left out.
pub(super) fn tubes(tables: &[Reader<'_>]) -> Vec<Tube> {
    let mut taken = BTreeMap::new();
    let names: Vec<_> = tables.iter().map(|table| name(table, &mut taken)).collect();
    let mut number = 0;
    let mut named = Vec::new();
    for (index, (table, name)) in tables.iter().zip(names).enumerate() {
        let name = name.map_or_else(
            || {
                number = number.max(index) + 1;
                while taken.contains_key(format!("tube {number}").as_str()) {
                    number += 1;
                }
                format!("tube {number}")
            },
            str::to_owned,
        );
        named.extend(tube(table, name));
    }
    named
}

/// The tube's own name, entered in `taken`.
fn name<'a>(table: &Reader<'a>, taken: &mut BTreeMap<&'a str, Item<'a>>) -> Option<&'a str> {
    let item = table.get("name")?;
    let name = item.text()?;
    if name.trim().is_empty() {
        table.report(Fault::at(item.span(), "`name` is empty").label("expected a name, or no key"));
    } else if let Some(first) = taken.insert(name, item) {
        table.report(
            Fault::at(item.span(), "two tubes have the same name")
                .label("expected a name of its own")
                .related(first.span(), "the first is here"),
        );
    }
    Some(name)
}

fn tube(table: &Reader<'_>, name: String) -> Option<Tube> {
    let conserve = table.word("conserve", &CONSERVE).unwrap_or(Conserve::Off);
    let overlap = table.word("overlap", &OVERLAP).unwrap_or(Overlap::Max);
    let rest = table.table("rest", &REST);
    let rest = ["radius", "length"].map(|key| rest.and_then(|rest| rest.number(key, &limit::POSITIVE)));
    let frame = table.word("frame", &FRAMES).unwrap_or(FrameRule::RotationMinimising);
    let curve = curve(table, frame);
    let radius = table.get("radius").and_then(radius);
    let (caps, radial) = envelope(table);
    let layers = layer::layers(&table.tables("layer", &LAYER));
    let twist = table.number("twist", &limit::ANY).unwrap_or(0.0);
    let spin = table.number("spin", &limit::ANY).unwrap_or(0.0);
    let stretch = table.boolean("stretch").unwrap_or(true);
    let color = table.get("color").and_then(ramp::color);
    let temperature = table.get("temperature").and_then(ramp::temperature);
    // Only when all keys are read may a tube without a curve be given up.
    let curve = curve?;
    let radius = radius.unwrap_or_else(|| {
        Profile::constant(RADIUS * curve.length()).expect("a part of a curve's length is a radius")
    });
    let rest = Rest {
        radius: rest[0].unwrap_or_else(|| radius.rms()),
        length: rest[1].unwrap_or_else(|| curve.length()),
    };
    Some(Tube {
        name,
        curve,
        radius,
        twist,
        spin,
        stretch,
        frame,
        caps,
        radial,
        conserve,
        rest,
        overlap,
        layers,
        color,
        temperature,
    })
}

fn curve(table: &Reader<'_>, frame: FrameRule) -> Option<Curve> {
    if table.get("curve").is_none() {
        table.report(
            Fault::at(table.span(), "a tube without a `curve`")
                .label("expected a key such as: curve = { kind = \"quadratic\", points = [...] }")
                .absence(),
        );
    }
    axis::curve(&table.table("curve", &CURVE)?, frame)
}

/// One number, or keys over the fraction of the length.
fn radius(item: Item<'_>) -> Option<Profile> {
    const EXPECTED: &str = "a number above 0, or keys [[l, radius], ...]";
    if item.is_number() {
        return Profile::constant(item.number(&limit::POSITIVE)?).ok();
    }
    let items = item.array(EXPECTED)?;
    // Every key is read, so that each fault among them is found.
    let keys: Vec<_> = items.iter().map(radius_key).collect();
    let keys: Vec<_> = keys.into_iter().collect::<Option<_>>()?;
    if !keys.iter().any(|(_, r)| limit::POSITIVE.admits(*r)) {
        let title = if keys.is_empty() { "`radius` has no keys" } else { "`radius` is 0 everywhere" };
        item.report(Fault::at(item.span(), title).label(format!("expected {EXPECTED}")));
        return None;
    }
    Profile::keyed(&keys).map_err(|error| item.report(misplaced(error, &items, &item))).ok()
}

/// The fault of keys that are each sound, but not together.
fn misplaced(error: ProfileError, items: &[Item<'_>], whole: &Item<'_>) -> Fault {
    let (key, label) = match error {
        ProfileError::Order { key, .. } => (key, "expected an l not below that of the key before"),
        ProfileError::Close { key } => {
            (key, "expected an l 1e-9 or more above that of the key before, or the same")
        }
        ProfileError::Repeat { key, .. } => {
            (key, "expected at most two keys at one l, and one at 0 and at 1")
        }
        other => return Fault::at(whole.span(), "unusable `radius`").label(other.to_string()),
    };
    Fault::at(items.get(key).unwrap_or(whole).span(), "misplaced key of `radius`").label(label)
}

fn radius_key(item: &Item<'_>) -> Option<(f64, f64)> {
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

fn envelope(table: &Reader<'_>) -> (Caps, Radial) {
    let end = table.word("caps", &CAPS);
    let envelope = table.table("envelope", &ENVELOPE);
    let radial =
        envelope.and_then(|envelope| envelope.get("radial")).and_then(radial).unwrap_or(Radial::Smooth);
    let axial = envelope.and_then(|envelope| envelope.get("axial"));
    let fade = axial.and_then(|axial| axial.number(&limit::HALF_SHARE)).unwrap_or(AXIAL);
    let caps = match end {
        None | Some(End::Fade) => Caps::Fade(fade),
        Some(End::Flat) => Caps::Flat,
        Some(End::Round) => Caps::Round,
    };
    if let (Some(axial), Some(End::Flat | End::Round), Some(end)) = (axial, end, table.get("caps")) {
        table.report(
            Fault::at(axial.span(), "`envelope.axial` contradicts `caps`")
                .label("only faded ends take it")
                .related(end.span(), "these do not fade"),
        );
    }
    (caps, radial)
}

/// A word, or the width of the edge as a part of the radius.
fn radial(item: Item<'_>) -> Option<Radial> {
    if item.is_number() {
        return item.number(&limit::SHARE).map(Radial::Edge);
    }
    if item.is_text() {
        return item.word(&RADIAL);
    }
    item.mistyped(&format!("{}, or the edge's width as a part of the radius", RADIAL.choice()));
    None
}
