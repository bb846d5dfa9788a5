//! `[[tube]]`: a curve, what goes along it, and what surrounds it.

use std::collections::BTreeMap;

use super::axis::{self, Axis};
use super::error::Fault;
use super::input::Inputs;
use super::keys::{ENVELOPE, LAYER, REST};
use super::motion::Rate;
use super::profile::{self, Radius};
use super::reader::{Item, Reader, Words};
use super::{Caps, Conserve, Overlap, Radial, Rest, Tube, layer, limit, ramp, seams};
use crate::curve::{FrameRule, Profile, ProfileError};

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
///
/// `known` are all of them at another time, where that has been read.
pub(super) fn tubes(tables: &[Reader<'_>], inputs: &Inputs<'_>, known: Option<&[Tube]>) -> Vec<Tube> {
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
        let rest = known.and_then(|tubes| tubes.get(index)).map(|tube| tube.rest);
        named.extend(tube(table, name, inputs, rest));
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

/// A tube that does not say what it is at rest is at rest as `known`, or else as it is now.
fn tube(table: &Reader<'_>, name: String, inputs: &Inputs<'_>, known: Option<Rest>) -> Option<Tube> {
    let conserve = table.word("conserve", &CONSERVE).unwrap_or(Conserve::Off);
    let overlap = table.word("overlap", &OVERLAP).unwrap_or(Overlap::Max);
    let rest = table.table("rest", &REST);
    let rest = ["radius", "length"].map(|key| rest.and_then(|rest| rest.number(key, &limit::POSITIVE)));
    let frame = table.word("frame", &FRAMES).unwrap_or(FrameRule::RotationMinimising);
    let Axis { curve, closed } = axis::axis(table, frame, inputs);
    let radius = table.get("radius").and_then(|item| profile::radius(item, closed.is_some(), inputs));
    let (caps, radial) = envelope(table, closed);
    let layers = layer::layers(&table.tables("layer", &LAYER));
    let twist = table.number("twist", &limit::ANY).unwrap_or(0.0);
    let spin = table.rate("spin", &limit::ANY).unwrap_or(Rate { now: 0.0, sum: 0.0 });
    let stretch = table.boolean("stretch").unwrap_or(true);
    let color = table.get("color").and_then(ramp::color);
    let temperature = table.get("temperature").and_then(ramp::temperature);
    // Only when all keys are read may a tube without a curve be given up.
    let curve = curve?;
    let Radius { profile: radius, sampling_error } = match radius {
        Some(radius) => radius,
        None => {
            let default = Profile::constant(RADIUS * curve.length());
            let refuse = |error: ProfileError| table.report(Fault::at(table.span(), error.to_string()));
            default.map_err(refuse).ok()?.into()
        }
    };
    let rest = Rest {
        radius: rest[0].or(known.map(|rest| rest.radius)).unwrap_or_else(|| radius.rms()),
        length: rest[1].or(known.map(|rest| rest.length)).unwrap_or_else(|| curve.length()),
    };
    let tube = Tube {
        name,
        curve,
        radius,
        sampling_error,
        twist,
        spin: spin.now,
        turned: spin.sum,
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
    };
    seams::flips(table, &tube);
    if let Some(closed) = closed {
        seams::warn(table, &tube, &closed);
    }
    Some(tube)
}

fn envelope(table: &Reader<'_>, closed: Option<Item<'_>>) -> (Caps, Radial) {
    let end = table.word("caps", &CAPS);
    let envelope = table.table("envelope", &ENVELOPE);
    let radial =
        envelope.and_then(|envelope| envelope.get("radial")).and_then(radial).unwrap_or(Radial::Smooth);
    let axial = envelope.and_then(|envelope| envelope.get("axial"));
    let fade = axial.and_then(|axial| axial.number(&limit::HALF_SHARE)).unwrap_or(AXIAL);
    if let Some(closed) = closed {
        for (key, item) in [("caps", table.get("caps")), ("envelope.axial", axial)] {
            let Some(item) = item else { continue };
            table.report(
                Fault::at(item.span(), format!("`{key}` contradicts `closed`"))
                    .label("a closed curve has no ends: leave this off")
                    .related(closed.span(), "the curve is closed here"),
            );
        }
        return (Caps::Flat, radial);
    }
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
