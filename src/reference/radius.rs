//! The radius over the fraction of the arc length.

use crate::curve::Profile;

/// A monotone cubic between keys, constant outside them.
#[derive(Debug, Clone)]
pub(super) struct Radius {
    keys: Vec<(f64, f64)>,
    /// Slope at each key; at a jump there are two keys.
    slopes: Vec<f64>,
}

impl Radius {
    pub(super) fn new(profile: &Profile) -> Radius {
        Radius::through(profile.keys())
    }

    /// Slopes by Fritsch and Carlson, "Monotone piecewise cubic interpolation" (1980), on each run of keys
    /// between jumps.
    ///
    /// The slope at a key is the mean of the two chords' slopes, 0 where either is 0 or they differ in sign,
    /// and at the ends of a run the one chord's. Then, interval by interval along x: where the chord is level
    /// both slopes become 0; where slopes over the chord's, as a vector, are longer than 3, they are
    /// shortened to 3.
    fn through(keys: &[(f64, f64)]) -> Radius {
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
        Radius { keys: keys.to_vec(), slopes }
    }

    pub(super) fn largest(&self) -> f64 {
        self.keys.iter().map(|key| key.1).fold(0.0, f64::max)
    }

    /// The radius at the fraction x of the arc length; at a jump the one after it.
    pub(super) fn at(&self, x: f64) -> f64 {
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
        let found = Radius::through(keys).at(x);
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
        assert!((Radius::through(&keys).at(0.5 - 1e-12) - 2.0).abs() < 1e-11);
    }

    #[test]
    fn agrees_with_the_profile_it_was_read_from() {
        let keys = [(0.05, 0.2), (0.1, 0.9), (0.3, 1.0), (0.31, 0.2), (0.31, 0.7), (0.6, 0.7), (0.9, 0.1)];
        let profile = Profile::keyed(&keys).unwrap();
        let radius = Radius::new(&profile);
        assert_eq!(radius.largest(), 1.0);
        for i in 0..=1000 {
            let x = f64::from(i) / 1000.0;
            assert!(
                (radius.at(x) - profile.at(x)).abs() < 1e-14,
                "{x}: {} against {}",
                radius.at(x),
                profile.at(x)
            );
        }
    }
}
