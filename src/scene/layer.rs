//! `[[tube.layer]]`: the terms of a tube's density.

use super::error::Fault;
use super::reader::{Reader, Words};
use super::{Fbm, Layer, Op, Pattern, limit};

/// No lattice of noise has more cells than this per unit, so that a cell's number fits a 64-bit integer.
const FINEST: f64 = 1e18;
/// No value of a tube's layers exceeds this, so that it fits a 32-bit float with room for further steps.
const LARGEST: f64 = 1e30;
/// No Perlin noise of one octave exceeds this.
const PERLIN_BOUND: f64 = 1.04;

#[derive(Debug, Clone, Copy)]
enum Noise {
    Perlin,
    Constant,
    Sectors,
}

impl Noise {
    /// Name, and the keys that this noise takes besides those of every layer.
    fn keys(self) -> (&'static str, &'static [&'static str]) {
        match self {
            Noise::Perlin => {
                ("perlin", &["frequency", "octaves", "lacunarity", "gain", "normalise", "seed", "scroll"])
            }
            Noise::Constant => ("constant", &["value"]),
            Noise::Sectors => ("sectors", &[]),
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
    let (name, own) = noise.keys();
    for (owner, keys) in [Noise::Perlin, Noise::Constant, Noise::Sectors].map(Noise::keys) {
        for key in keys.iter().filter(|key| !own.contains(key)) {
            if let Some(span) = table.key_span(key) {
                let fault = Fault::at(span, format!("key `{key}` does not belong to noise \"{name}\""));
                table.report(fault.label(format!("only to \"{owner}\"")));
            }
        }
    }
}

fn fbm(table: &Reader<'_>) -> Fbm {
    let frequency = table.get("frequency").and_then(|item| item.vector_or_number(&limit::NOT_NEGATIVE));
    let octaves = table.integer("octaves", 0..=32).and_then(|n| u32::try_from(n).ok());
    let seed = table.integer("seed", 0..=i64::from(u32::MAX)).and_then(|n| u32::try_from(n).ok());
    let fbm = Fbm {
        frequency: frequency.unwrap_or([2.0, 2.0, 3.0]),
        octaves: octaves.unwrap_or(5),
        lacunarity: table.number("lacunarity", &limit::POSITIVE).unwrap_or(2.0),
        gain: table.number("gain", &limit::NOT_NEGATIVE).unwrap_or(0.5),
        normalise: table.boolean("normalise").unwrap_or(false),
        seed: seed.unwrap_or(0),
        scrolled: table.rates("scroll", &limit::ANY).map_or([0.0; 3], |rates| rates.map(|rate| rate.sum)),
    };
    if let (Some(octaves), true, 0) = (table.get("octaves"), fbm.normalise, fbm.octaves) {
        table.report(Fault::at(octaves.span(), "`normalise` without octaves").label("expected at least 1"));
    }
    let [u, v, l] = fbm.frequency;
    let finest = u.max(v).max(l) * powers(fbm.lacunarity, fbm.octaves).last().unwrap_or(1.0);
    if finest > FINEST {
        let culprit =
            table.get("lacunarity").or_else(|| table.get("frequency")).map_or(table.span(), |key| key.span());
        table.report(
            Fault::at(culprit, "the finest octave is finer than numbers can tell")
                .label(format!("it has {finest:.0e} cells per unit; expected at most {FINEST:.0e}")),
        );
    }
    fbm
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
