//! `[[tube.layer]]`: the terms of a tube's density.

use super::error::Fault;
use super::keys::{LAYER, WARP};
use super::reader::{Reader, Words};
use super::{Fbm, Form, Layer, Op, Pattern, Space, Warp, limit};

/// No lattice of noise has more cells than this per unit, so that a cell's number fits a 64-bit integer.
const FINEST: f64 = 1e18;
/// No value of a tube's layers exceeds this, so that it fits a 32-bit float with room for further steps.
const LARGEST: f64 = 1e30;
/// No Perlin noise of one octave exceeds this in magnitude, nor does any form of it.
const PERLIN_BOUND: f64 = 1.04;

#[derive(Debug, Clone, Copy, PartialEq)]
enum Noise {
    Perlin,
    Constant,
    Sectors,
}

impl Noise {
    fn name(self) -> &'static str {
        match self {
            Noise::Perlin => "perlin",
            Noise::Constant => "constant",
            Noise::Sectors => "sectors",
        }
    }

    /// The only noise that takes a key of a layer; `None` where all take it.
    fn owner(key: &str) -> Option<Noise> {
        match key {
            "op" | "noise" | "threshold" | "multiplier" => None,
            "value" => Some(Noise::Constant),
            _ => Some(Noise::Perlin),
        }
    }
}

static OPS: Words<Op> = Words {
    known: &[("multiply", Op::Multiply), ("add", Op::Add), ("max", Op::Max), ("min", Op::Min)],
    later: &[],
    instead: "",
};

static NOISES: Words<Noise> = Words {
    known: &[("perlin", Noise::Perlin), ("constant", Noise::Constant), ("sectors", Noise::Sectors)],
    later: &["worley"],
    instead: "this version has \"perlin\", \"constant\" and \"sectors\"",
};

static FORMS: Words<Form> = Words {
    known: &[("fbm", Form::Fbm), ("ridged", Form::Ridged), ("billow", Form::Billow)],
    later: &[],
    instead: "",
};

static SPACES: Words<Space> =
    Words { known: &[("cylinder", Space::Cylinder), ("world", Space::World)], later: &[], instead: "" };

/// The layers of one tube.
pub(super) fn layers(tables: &[Reader<'_>]) -> Vec<Layer> {
    let layers: Vec<_> = tables.iter().map(layer).collect();
    let mut bound = 1.0_f64;
    for (table, layer) in tables.iter().zip(&layers) {
        bound = joined_bound(bound, layer);
        if bound > LARGEST {
            table.report(
                Fault::at(table.span(), "the density can grow too large").label(format!(
                    "up to this layer it can reach {bound:.0e}; expected at most {LARGEST:.0e}"
                )),
            );
            break;
        }
    }
    layers
}

fn layer(table: &Reader<'_>) -> Layer {
    // A noise that is given and not understood must not be held against the other keys.
    let noise = match table.get("noise") {
        None => Some(Noise::Perlin),
        Some(noise) => noise.word(&NOISES),
    };
    if let Some(noise) = noise {
        report_strangers(table, noise);
    }
    let fbm = fbm(table);
    let value = table.number("value", &limit::ANY).unwrap_or(1.0);
    Layer {
        op: table.word("op", &OPS).unwrap_or(Op::Multiply),
        pattern: match noise {
            None | Some(Noise::Perlin) => Pattern::Perlin(fbm),
            Some(Noise::Constant) => Pattern::Constant(value),
            Some(Noise::Sectors) => Pattern::Sectors,
        },
        threshold: table.number("threshold", &limit::ANY),
        multiplier: table.number("multiplier", &limit::ANY).unwrap_or(1.0),
    }
}

/// Reports the keys that belong to other noises.
fn report_strangers(table: &Reader<'_>, noise: Noise) {
    for key in LAYER.keys {
        let (Some(owner), Some(span)) = (Noise::owner(key), table.key_span(key)) else { continue };
        if owner != noise {
            let title = format!("key `{key}` does not belong to noise \"{}\"", noise.name());
            table.report(Fault::at(span, title).label(format!("only to \"{}\"", owner.name())));
        }
    }
}

fn fbm(table: &Reader<'_>) -> Fbm {
    let octaves = table.integer("octaves", 0..=32).and_then(|n| u32::try_from(n).ok());
    let frequency = frequency(table).unwrap_or([2.0, 2.0, 3.0]);
    let seed = seed(table).unwrap_or(0);
    let fbm = Fbm {
        frequency,
        octaves: octaves.unwrap_or(5),
        lacunarity: table.number("lacunarity", &limit::POSITIVE).unwrap_or(2.0),
        gain: table.number("gain", &limit::NOT_NEGATIVE).unwrap_or(0.5),
        normalise: table.boolean("normalise").unwrap_or(false),
        seed,
        scrolled: table.rates("scroll", &limit::ANY).map_or([0.0; 3], |rates| rates.map(|rate| rate.sum)),
        form: table.word("form", &FORMS).unwrap_or_default(),
        rotate: table.boolean("rotate").unwrap_or(false),
        warp: table.table("warp", &WARP).map(|warp| self::warp(&warp, frequency, seed)),
        space: table.word("space", &SPACES).unwrap_or(Space::Cylinder),
        offset: table.vector("offset", &limit::ANY).unwrap_or([0.0; 3]),
    };
    if let (Some(octaves), true, 0) = (table.get("octaves"), fbm.normalise, fbm.octaves) {
        table.report(Fault::at(octaves.span(), "`normalise` without octaves").label("expected at least 1"));
    }
    report_finest(table, fbm.frequency, fbm.lacunarity, fbm.octaves);
    fbm
}

/// The displacement of a layer of this frequency and seed.
fn warp(table: &Reader<'_>, layer: [f64; 3], layer_seed: u32) -> Warp {
    let octaves = table.integer("octaves", 1..=32).and_then(|n| u32::try_from(n).ok());
    let warp = Warp {
        amplitude: table.number("amplitude", &limit::CELLS).unwrap_or(0.5),
        frequency: frequency(table).unwrap_or(layer),
        octaves: octaves.unwrap_or(2),
        lacunarity: table.number("lacunarity", &limit::POSITIVE).unwrap_or(2.0),
        gain: table.number("gain", &limit::NOT_NEGATIVE).unwrap_or(0.5),
        seed: seed(table).unwrap_or(layer_seed),
    };
    report_finest(table, warp.frequency, warp.lacunarity, warp.octaves);
    warp
}

fn frequency(table: &Reader<'_>) -> Option<[f64; 3]> {
    table.get("frequency")?.vector_or_number(&limit::NOT_NEGATIVE)
}

fn seed(table: &Reader<'_>) -> Option<u32> {
    table.integer("seed", 0..=i64::from(u32::MAX)).and_then(|n| u32::try_from(n).ok())
}

/// Reports a last octave whose cells have no number.
fn report_finest(table: &Reader<'_>, [u, v, l]: [f64; 3], lacunarity: f64, octaves: u32) {
    let finest = u.max(v).max(l) * powers(lacunarity, octaves).last().unwrap_or(1.0);
    if finest > FINEST {
        let culprit =
            table.get("lacunarity").or_else(|| table.get("frequency")).map_or(table.span(), |key| key.span());
        table.report(
            Fault::at(culprit, "the finest octave is finer than numbers can tell")
                .label(format!("it has {finest:.0e} cells per unit; expected at most {FINEST:.0e}")),
        );
    }
}

/// 1, x, x^2, ...: `count` of them.
fn powers(x: f64, count: u32) -> impl Iterator<Item = f64> {
    (0..count).scan(1.0, move |power, _| Some(std::mem::replace(power, *power * x)))
}

/// What the magnitude of the layers' value cannot exceed once `layer` has joined one of at most `bound`.
fn joined_bound(bound: f64, layer: &Layer) -> f64 {
    let pattern = match &layer.pattern {
        Pattern::Constant(value) => value.abs(),
        Pattern::Sectors => 1.0,
        Pattern::Perlin(fbm) if fbm.normalise => PERLIN_BOUND,
        Pattern::Perlin(fbm) => PERLIN_BOUND * powers(fbm.gain, fbm.octaves).sum::<f64>(),
    };
    let term = layer.multiplier.abs() * (pattern + layer.threshold.map_or(0.0, f64::abs));
    match layer.op {
        Op::Multiply => bound * term,
        Op::Add => bound + term,
        Op::Max | Op::Min => bound.max(term),
    }
}
