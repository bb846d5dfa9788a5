//! The radius over the fraction of the arc length.

use crate::curve::{Profile, Shape};
use std::f64::consts::TAU;

/// The radius, by the formula of its kind.
#[derive(Debug, Clone)]
pub(super) enum Radius {
    Keyed(Keys),
    Sinusoidal { mean: f64, amplitude: f64, waves: f64, phase: f64 },
    Growing { from: f64, to: f64, power: f64 },
}

/// A monotone cubic between keys, constant outside them.
#[derive(Debug, Clone)]
pub(super) struct Keys {
    keys: Vec<(f64, f64)>,
    /// Slope at each key; at a jump there are two keys.
    slopes: Vec<f64>,
    /// Where keys go around, what lies before the first is looked up one period on.
    closed: bool,
}

impl Radius {
    pub(super) fn new(profile: &Profile) -> Radius {
        match *profile.shape() {
            Shape::Keyed { ref keys, closed: false } => Radius::Keyed(Keys::through(keys)),
            Shape::Keyed { ref keys, closed: true } => Radius::Keyed(Keys::around(keys)),
            Shape::Sinusoidal { mean, amplitude, waves, phase } => {
                Radius::Sinusoidal { mean, amplitude, waves, phase }
            }
            Shape::Growing { from, to, power } => Radius::Growing { from, to, power },
        }
    }

    pub(super) fn largest(&self) -> f64 {
        match self {
            Radius::Keyed(keys) => keys.keys.iter().map(|key| key.1).fold(0.0, f64::max),
            Radius::Sinusoidal { waves, phase, .. } => {
                // Ends, and the first crest behind x = 0 if it comes before x = 1.
                let crest = (1.25 - phase - (1.25 - phase).floor()) / waves;
                let places = [0.0, 1.0, if crest < 1.0 { crest } else { 1.0 }];
                places.into_iter().map(|x| self.at(x)).fold(0.0, f64::max)
            }
            Radius::Growing { from, to, .. } => from.max(*to),
        }
    }

    /// The radius at the fraction x of the arc length; at a jump the one after it.
    pub(super) fn at(&self, x: f64) -> f64 {
        match self {
            Radius::Keyed(keys) => keys.at(x),
            Radius::Sinusoidal { mean, amplitude, waves, phase } => {
                mean - amplitude * libm::cos(TAU * (waves * x + phase + 0.25))
            }
            Radius::Growing { from, to, power } => {
                let part = libm::exp(power * libm::log(x));
                (1.0 - part) * from + part * to
            }
        }
    }
}

impl Keys {
    /// Keys that go around. Those at 0 and 1 are one where they agree, and a jump where they do not.
    fn around(keys: &[(f64, f64)]) -> Keys {
        let (first, last) = (keys[0], keys[keys.len() - 1]);
        let whole = last.0 - first.0 == 1.0;
        if whole && first.1 != last.1 {
            return Keys::through(keys);
        }
        let mut keys = keys.to_vec();
        if !whole {
            keys.push((first.0 + 1.0, first.1));
        }
        let n = keys.len() - 1;
        let chord = |i: usize| {
            let ((x0, v0), (x1, v1)) = (keys[i % n], keys[i % n + 1]);
            if x1 > x0 { Some((v1 - v0) / (x1 - x0)) } else { None }
        };
        let mut slopes: Vec<f64> = (0..n)
            .map(|i| match [chord(i + n - 1), chord(i)] {
                [Some(left), Some(right)] if left * right > 0.0 => 0.5 * (left + right),
                [Some(_), Some(_)] | [None, None] => 0.0,
                [only, other] => only.or(other).unwrap_or(0.0),
            })
            .collect();
        for i in 0..n {
            let Some(chord) = chord(i) else { continue };
            let length = libm::hypot(slopes[i], slopes[(i + 1) % n]);
            let factor = if chord == 0.0 { 0.0 } else { (3.0 * chord.abs() / length).min(1.0) };
            slopes[i] *= factor;
            // With a single interval both ends are one.
            if n > 1 {
                slopes[(i + 1) % n] *= factor;
            }
        }
        slopes.push(slopes[0]);
        Keys { keys, slopes, closed: true }
    }

    /// Slopes by Fritsch and Carlson, "Monotone piecewise cubic interpolation" (1980), on each run of keys
    /// between jumps.
    ///
    /// The slope at a key is the mean of the two chords' slopes, 0 where either is 0 or they differ in sign,
    /// and at the ends of a run the one chord's. Then, interval by interval along x: where the chord is level
    /// both slopes become 0; where slopes over the chord's, as a vector, are longer than 3, they are
    /// shortened to 3.
    fn through(keys: &[(f64, f64)]) -> Keys {
        let chord = |i: usize| {
            let ((x0, v0), (x1, v1)) = (*keys.get(i)?, *keys.get(i + 1)?);
            (x1 > x0).then(|| (v1 - v0) / (x1 - x0))
        };
        let mut slopes: Vec<f64> = (0..keys.len())
            .map(|i| match (i.checked_sub(1).and_then(chord), chord(i)) {
                (Some(left), Some(right)) if left * right > 0.0 => 0.5 * (left + right),
                (Some(_), Some(_)) | (None, None) => 0.0,
                (Some(only), None) | (None, Some(only)) => only,
            })
            .collect();
        for i in 0..keys.len() {
            let Some(chord) = chord(i) else { continue };
            let length = (slopes[i] * slopes[i] + slopes[i + 1] * slopes[i + 1]).sqrt();
            let factor = if chord == 0.0 { 0.0 } else { (3.0 * chord.abs() / length).min(1.0) };
            slopes[i] *= factor;
            slopes[i + 1] *= factor;
        }
        Keys { keys: keys.to_vec(), slopes, closed: false }
    }

    /// The value at x; at a jump the one after it.
    fn at(&self, x: f64) -> f64 {
        let x = if self.closed && x < self.keys[0].0 { x + 1.0 } else { x };
        let after = self.keys.partition_point(|key| key.0 <= x);
        let (Some(right), Some(left)) = (self.keys.get(after), after.checked_sub(1)) else {
            let end = if after == 0 { self.keys.first() } else { self.keys.last() };
            return end.map_or(0.0, |key| key.1);
        };
        let (x0, v0) = self.keys[left];
        let (x1, v1) = *right;
        let width = x1 - x0;
        // Control points of the cubic in Bezier form, by de Casteljau's scheme.
        let mut b = [v0, v0 + width * self.slopes[left] / 3.0, v1 - width * self.slopes[after] / 3.0, v1];
        let t = (x - x0) / width;
        for last in (0..3).rev() {
            for i in 0..=last {
                b[i] += t * (b[i + 1] - b[i]);
            }
        }
        b[0]
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "what is not there fails the test")]
mod tests {
    use super::*;

    fn assert_at(keys: &[(f64, f64)], x: f64, wanted: f64) {
        let found = Keys::through(keys).at(x);
        // A few roundings of numbers near 1.
        assert!((found - wanted).abs() < 1e-15, "{keys:?} at {x}: {found} against {wanted}");
    }

    #[test]
    fn has_values_worked_by_hand() {
        assert_at(&[(0.4, 0.7)], 0.9, 0.7);
        assert_at(&[(0.0, 1.0), (1.0, 3.0)], 0.25, 1.5);
        // Slopes 2, 0, 0: half way, (0 + 1) / 2 + 0.5 (2 - 0) / 8.
        assert_at(&[(0.0, 0.0), (0.5, 1.0), (1.0, 1.0)], 0.25, 0.625);
        assert_at(&[(0.0, 0.0), (0.5, 1.0), (1.0, 1.0)], 0.75, 1.0);
        // A peak is level: slopes 2, 0, -2.
        assert_at(&[(0.0, 0.0), (0.5, 1.0), (1.0, 0.0)], 0.75, 0.625);
        // Chords 1 and 2, slopes 1, 1.5, 2: 0.25 + 0.5 (1 - 1.5) / 8 and 1 + 0.5 (1.5 - 2) / 8.
        assert_at(&[(0.0, 0.0), (0.5, 0.5), (1.0, 1.5)], 0.25, 0.218_75);
        assert_at(&[(0.0, 0.0), (0.5, 0.5), (1.0, 1.5)], 0.75, 0.968_75);
        // Chords 1 and 7, mean 4: (1, 4) is longer than 3 and becomes 3 / sqrt(17) of it.
        let short = 3.0 / 17.0_f64.sqrt();
        assert_at(&[(0.0, 0.0), (0.5, 0.5), (1.0, 4.0)], 0.25, 0.25 + short * (1.0 - 4.0) / 16.0);
        assert_at(&[(0.0, 0.0), (0.5, 0.5), (1.0, 4.0)], 0.75, 2.25 + (4.0 * short - 7.0) / 16.0);
    }

    #[test]
    fn is_constant_outside_the_keys_and_jumps_where_told() {
        let keys = [(0.2, 1.0), (0.5, 2.0), (0.5, 4.0), (0.8, 3.0)];
        for (x, wanted) in
            [(0.0, 1.0), (0.2, 1.0), (0.35, 1.5), (0.5, 4.0), (0.65, 3.5), (0.8, 3.0), (1.0, 3.0)]
        {
            assert_at(&keys, x, wanted);
        }
        assert!((Keys::through(&keys).at(0.5 - 1e-12) - 2.0).abs() < 1e-11);
    }

    #[test]
    fn agrees_with_the_profile_it_was_read_from() {
        let keys = [(0.05, 0.2), (0.1, 0.9), (0.3, 1.0), (0.31, 0.2), (0.31, 0.7), (0.6, 0.7), (0.9, 0.1)];
        let agreeing = [(0.0, 0.5), (0.2, 0.9), (0.7, 0.1), (1.0, 0.5)];
        let apart = [(0.0, 0.5), (0.2, 0.9), (0.7, 0.1), (1.0, 0.6)];
        let profiles = [
            Profile::keyed(&keys),
            Profile::keyed_closed(&keys),
            Profile::keyed_closed(&agreeing),
            Profile::keyed_closed(&apart),
            Profile::keyed_closed(&[(0.3, 0.4)]),
            Profile::keyed_closed(&[(0.3, 0.4), (0.3, 0.8)]),
            Profile::keyed_closed(&[(0.1, 0.4), (0.2, 0.8)]),
            Profile::sinusoidal(0.5, 0.4, 3.0, 0.2),
            Profile::sinusoidal(0.5, 0.5, 0.3, 0.9),
            Profile::sinusoidal(0.5, 0.5, 0.2, 0.4),
            Profile::growing(0.1, 0.9, 0.5),
            Profile::growing(0.9, 0.0, 3.0),
        ];
        for profile in profiles {
            let profile = profile.unwrap();
            let radius = Radius::new(&profile);
            assert!((radius.largest() - profile.max()).abs() < 1e-15, "{profile:?}");
            for i in 0..=1000 {
                let x = f64::from(i) / 1000.0;
                // Roundings of numbers near 1, and of a phase near 20 radians.
                assert!(
                    (radius.at(x) - profile.at(x)).abs() < 2e-14,
                    "{profile:?} at {x}: {} against {}",
                    radius.at(x),
                    profile.at(x)
                );
            }
        }
    }
}
