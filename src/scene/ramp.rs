//! `color` and `temperature`: values along a tube.

use std::ops::{Add, Mul};

use glam::DVec3;

use super::error::Fault;
use super::limit::{self, Limit};
use super::reader::Item;

/// Linear red, green and blue along a tube.
pub type ColorRamp = Ramp<DVec3>;
/// Kelvin along a tube.
pub type TemperatureRamp = Ramp<f64>;

/// A value over the fraction of a tube's length: linear between keys, constant before the first and after the last. Two
/// keys at one place make a step.
#[derive(Debug, Clone, PartialEq)]
pub struct Ramp<T> {
    /// At least one, by ascending place; no more than two at one.
    keys: Vec<(f64, T)>,
}

impl<T: Copy + Add<Output = T> + Mul<f64, Output = T>> Ramp<T> {
    /// The value at l, a fraction of the arc length; at a step, that after it.
    #[allow(clippy::unreachable, reason = "a ramp has a key")]
    pub fn at(&self, l: f64) -> T {
        let next = self.keys.partition_point(|(place, _)| *place <= l);
        match (next.checked_sub(1).and_then(|last| self.keys.get(last)), self.keys.get(next)) {
            (Some(&(a, before)), Some(&(b, after))) => {
                let t = (l - a) / (b - a);
                before * (1.0 - t) + after * t
            }
            (Some(&(_, value)), None) | (None, Some(&(_, value))) => value,
            (None, None) => unreachable!("a ramp has a key"),
        }
    }

    /// Its keys: place and value.
    pub fn keys(&self) -> &[(f64, T)] {
        &self.keys
    }
}

/// One colour, or keys.
pub(super) fn color(item: Item<'_>) -> Option<ColorRamp> {
    const EXPECTED: &str = "a colour [r, g, b], or keys [[l, r, g, b], ...]";
    let items = item.array(EXPECTED)?;
    if items.first().is_some_and(Item::is_number) {
        let color = item.numbers(&limit::NOT_NEGATIVE, EXPECTED)?;
        return Some(Ramp { keys: vec![(0.0, DVec3::from_array(color))] });
    }
    keys(&item, &items, "a key [l, r, g, b]", EXPECTED, &limit::NOT_NEGATIVE, DVec3::from_array)
}

/// One number, or keys.
pub(super) fn temperature(item: Item<'_>) -> Option<TemperatureRamp> {
    const EXPECTED: &str = "a temperature in kelvin, or keys [[l, kelvin], ...]";
    if item.is_number() {
        return Some(Ramp { keys: vec![(0.0, item.number(&limit::KELVIN)?)] });
    }
    let items = item.array(EXPECTED)?;
    keys(&item, &items, "a key [l, kelvin]", EXPECTED, &limit::KELVIN, |[kelvin]: [f64; 1]| kelvin)
}

/// Keys of a place and N numbers.
fn keys<T, const N: usize>(
    whole: &Item<'_>,
    items: &[Item<'_>],
    key: &str,
    expected: &str,
    limit: &Limit,
    value: fn([f64; N]) -> T,
) -> Option<Ramp<T>> {
    if items.is_empty() {
        let fault = Fault::at(whole.span(), format!("`{}` has no keys", whole.key()));
        whole.report(fault.label(format!("expected {expected}")));
        return None;
    }
    // Every key is read, so that each fault among them is found.
    let keys: Vec<_> = items.iter().map(|item| read(item, key, limit)).collect();
    let keys: Vec<(f64, [f64; N])> = keys.into_iter().collect::<Option<_>>()?;
    let mut before = None;
    for (((l, _), (next, _)), item) in keys.iter().zip(keys.iter().skip(1)).zip(items.iter().skip(1)) {
        let repeats = before.replace(*l) == Some(*next);
        let label = if next < l {
            "expected an l not below that of the key before"
        } else if repeats {
            "expected at most two keys at one l"
        } else {
            continue;
        };
        let title = format!("misplaced key of `{}`", whole.key());
        whole.report(Fault::at(item.span(), title).label(label));
        return None;
    }
    Some(Ramp { keys: keys.into_iter().map(|(l, numbers)| (l, value(numbers))).collect() })
}

fn read<const N: usize>(item: &Item<'_>, expected: &str, limit: &Limit) -> Option<(f64, [f64; N])> {
    let numbers = item.array(expected)?;
    let Some((l, values)) = numbers.split_first().filter(|(_, values)| values.len() == N) else {
        let fault = Fault::at(item.span(), format!("wrong length for a key of `{}`", item.key()));
        item.report(fault.label(format!("expected {expected}, found {}", numbers.len())));
        return None;
    };
    // All are read before any is given up, so that the faults of each are found.
    let l = l.number(&limit::PLACE);
    let values: Vec<_> = values.iter().map(|number| number.number(limit)).collect();
    let mut out = [0.0; N];
    for (out, value) in out.iter_mut().zip(values) {
        *out = value?;
    }
    Some((l?, out))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ramps_are_linear_between_keys_and_constant_outside() {
        let ramp = Ramp { keys: vec![(0.25, 1.0), (0.5, 3.0), (0.5, 8.0), (0.75, 0.0)] };
        for (l, value) in
            [(0.0, 1.0), (0.25, 1.0), (0.375, 2.0), (0.5, 8.0), (0.625, 4.0), (0.75, 0.0), (1.0, 0.0)]
        {
            assert_eq!(ramp.at(l), value, "at {l}");
        }
        assert!((ramp.at(0.5 - 1e-12) - 3.0).abs() < 1e-10, "before the step");
        let color = Ramp { keys: vec![(0.0, DVec3::new(1.0, 0.0, 2.0)), (1.0, DVec3::new(0.0, 4.0, 2.0))] };
        assert_eq!(color.at(0.25), DVec3::new(0.75, 1.0, 2.0));
    }
}
