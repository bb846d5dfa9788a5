//! The radius along a curve.

/// Why keys do not make a profile.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum ProfileError {
    /// There is no key.
    #[error("a profile needs at least one key")]
    Empty,
    /// A place is not a number from 0 to 1.
    #[error("key {key} is at {x}, outside of 0 to 1")]
    Place {
        /// Counted from 0.
        key: usize,
        /// Where the key is.
        x: f64,
    },
    /// A value is negative, not finite, or beyond 1e60.
    #[error("key {key} has the value {value}, outside of 0 to 1e60")]
    Value {
        /// Counted from 0.
        key: usize,
        /// The key's value.
        value: f64,
    },
    /// A key lies before the one before it.
    #[error("key {key} is at {x}, before the key before it")]
    Order {
        /// Counted from 0.
        key: usize,
        /// Where the key is.
        x: f64,
    },
    /// Two keys are closer than 1e-9 but not at one place.
    #[error("key {key} is less than 1e-9 after the key before it; the same place twice makes a jump")]
    Close {
        /// The second of the two, counted from 0.
        key: usize,
    },
    /// More than two keys at one place, or two at an end of the curve, where a jump has one side only.
    #[error("key {key} is one too many at {x}: two keys make a jump, and only between 0 and 1")]
    Repeat {
        /// Counted from 0.
        key: usize,
        /// Where the key is.
        x: f64,
    },
}

/// A value over x in [0, 1], at least 0: the radius over the fraction of the arc length.
///
/// Between keys a monotone cubic: never above the larger nor below the smaller of two neighbouring keys, with
/// a continuous slope (Fritsch and Carlson, "Monotone piecewise cubic interpolation", 1980: slopes at keys
/// are the mean of the two chords' slopes, zero where these differ in sign, and both ends of an interval are
/// scaled back into the circle of radius 3). Before the first key and after the last it is constant; two keys
/// at one x make a jump.
#[derive(Debug, Clone, PartialEq)]
pub struct Profile {
    keys: Vec<(f64, f64)>,
    knots: Vec<f64>,
    /// `knots.len() + 1` pieces: piece i ends at knot i.
    pieces: Vec<Piece>,
}

/// A monotone cubic on one interval.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Piece {
    x0: f64,
    x1: f64,
    v0: f64,
    v1: f64,
    /// Slopes at the ends times the interval's width.
    m0: f64,
    m1: f64,
}

impl Piece {
    fn constant(x0: f64, x1: f64, value: f64) -> Piece {
        Piece { x0, x1, v0: value, v1: value, m0: 0.0, m1: 0.0 }
    }

    fn at(&self, x: f64) -> f64 {
        let u = (x - self.x0) / (self.x1 - self.x0);
        let rise = self.v1 - self.v0;
        let value = self.v0
            + u * (self.m0
                + u * ((3.0 * rise - 2.0 * self.m0 - self.m1) + u * (self.m0 + self.m1 - 2.0 * rise)));
        // Monotone but for rounding, and outside the piece constant.
        let (low, high) = (self.v0.min(self.v1), self.v0.max(self.v1));
        if x <= self.x0 {
            self.v0
        } else if x >= self.x1 {
            self.v1
        } else {
            value.max(low).min(high)
        }
    }
}

impl Profile {
    /// The same value everywhere.
    ///
    /// # Errors
    ///
    /// A value that is negative, not finite, or beyond 1e60.
    pub fn constant(value: f64) -> Result<Profile, ProfileError> {
        Profile::keyed(&[(0.0, value)])
    }

    /// Keys (x, value) in order of x.
    ///
    /// # Errors
    ///
    /// No key; x outside [0, 1], not ascending, or closer than 1e-9 without being equal; more than two keys
    /// at one x, or two at 0 or 1; a value that is negative, not finite, or beyond 1e60.
    pub fn keyed(keys: &[(f64, f64)]) -> Result<Profile, ProfileError> {
        check(keys)?;
        let Some((&first, &last)) = keys.first().zip(keys.last()) else { return Err(ProfileError::Empty) };
        let mut pieces = Vec::with_capacity(keys.len() + 1);
        if first.0 > 0.0 {
            pieces.push(Piece::constant(0.0, first.0, first.1));
        }
        for run in keys.chunk_by(|a, b| a.0 < b.0) {
            monotone(run, &mut pieces);
        }
        if last.0 < 1.0 {
            pieces.push(Piece::constant(last.0, 1.0, last.1));
        }
        let knots = pieces[1..].iter().map(|piece| piece.x0).collect();
        Ok(Profile { keys: keys.to_vec(), knots, pieces })
    }

    /// The keys (x, value) it was made of.
    pub fn keys(&self) -> &[(f64, f64)] {
        &self.keys
    }

    /// The value at x, clamped to [0, 1]; at a jump the value after it.
    pub fn at(&self, x: f64) -> f64 {
        self.at_in(self.knots.partition_point(|knot| *knot <= x), x)
    }

    /// The value at x as piece `piece` has it, which runs from knot `piece - 1` (or 0) to knot `piece` (or
    /// 1); x is clamped to that.
    pub fn at_in(&self, piece: usize, x: f64) -> f64 {
        self.pieces[piece].at(x)
    }

    /// Least and greatest value for x in [x0, x1], exact to rounding; of a jump in it or at its ends both
    /// sides count.
    pub fn range(&self, x0: f64, x1: f64) -> (f64, f64) {
        // From the piece that ends at or after x0 to the one that starts at or before x1.
        let first = self.knots.partition_point(|knot| *knot < x0);
        let last = self.knots.partition_point(|knot| *knot <= x1).max(first);
        let (mut low, mut high) = (f64::INFINITY, 0.0_f64);
        for piece in &self.pieces[first..=last] {
            for value in [piece.at(x0), piece.at(x1)] {
                low = low.min(value);
                high = high.max(value);
            }
        }
        (low, high)
    }

    /// Every x strictly inside (0, 1) where a derivative of the profile, or the profile itself, may jump,
    /// ascending.
    pub fn knots(&self) -> &[f64] {
        &self.knots
    }

    /// The greatest value.
    pub fn max(&self) -> f64 {
        self.range(0.0, 1.0).1
    }

    /// Root mean square over [0, 1].
    pub fn rms(&self) -> f64 {
        // The square of a cubic has degree 6: four points are exact.
        const NODES: [(f64, f64); 4] = [
            (-0.861_136_311_594_052_6, 0.347_854_845_137_453_86),
            (-0.339_981_043_584_856_26, 0.652_145_154_862_546_1),
            (0.339_981_043_584_856_26, 0.652_145_154_862_546_1),
            (0.861_136_311_594_052_6, 0.347_854_845_137_453_86),
        ];
        let mut sum = 0.0;
        for piece in &self.pieces {
            let (middle, half) = (0.5 * (piece.x0 + piece.x1), 0.5 * (piece.x1 - piece.x0));
            for (node, weight) in NODES {
                let value = piece.at(middle + half * node);
                sum += half * weight * value * value;
            }
        }
        sum.sqrt()
    }

    /// The value, where it is the same everywhere.
    pub fn as_constant(&self) -> Option<f64> {
        let (low, high) = self.range(0.0, 1.0);
        (low == high).then_some(low)
    }
}

fn check(keys: &[(f64, f64)]) -> Result<(), ProfileError> {
    if keys.is_empty() {
        return Err(ProfileError::Empty);
    }
    for (key, &(x, value)) in keys.iter().enumerate() {
        if !(0.0..=1.0).contains(&x) {
            return Err(ProfileError::Place { key, x });
        }
        if !(0.0..=1e60).contains(&value) {
            return Err(ProfileError::Value { key, value });
        }
        if key == 0 {
            continue;
        }
        let before = keys[key - 1].0;
        if x < before {
            return Err(ProfileError::Order { key, x });
        }
        if x == before {
            if x == 0.0 || x == 1.0 || (key > 1 && keys[key - 2].0 == x) {
                return Err(ProfileError::Repeat { key, x });
            }
        } else if x - before < 1e-9 {
            return Err(ProfileError::Close { key });
        }
    }
    Ok(())
}

/// Appends the pieces between keys of strictly ascending x.
fn monotone(keys: &[(f64, f64)], pieces: &mut Vec<Piece>) {
    let chords: Vec<f64> = keys.windows(2).map(|w| (w[1].1 - w[0].1) / (w[1].0 - w[0].0)).collect();
    let (Some(&first), Some(&last)) = (chords.first(), chords.last()) else { return };
    let mut slopes = vec![first];
    slopes.extend(chords.windows(2).map(|d| if d[0] * d[1] > 0.0 { 0.5 * (d[0] + d[1]) } else { 0.0 }));
    slopes.push(last);
    for (i, &chord) in chords.iter().enumerate() {
        if chord == 0.0 {
            (slopes[i], slopes[i + 1]) = (0.0, 0.0);
            continue;
        }
        let (a, b) = (slopes[i] / chord, slopes[i + 1] / chord);
        let square = a * a + b * b;
        if square > 9.0 {
            let scale = 3.0 / square.sqrt();
            (slopes[i], slopes[i + 1]) = (scale * a * chord, scale * b * chord);
        }
    }
    for (pair, m) in keys.windows(2).zip(slopes.windows(2)) {
        let (x0, v0) = pair[0];
        let (x1, v1) = pair[1];
        let width = x1 - x0;
        pieces.push(Piece { x0, x1, v0, v1, m0: m[0] * width, m1: m[1] * width });
    }
}

#[cfg(test)]
mod tests {
    use super::super::testing::Random;
    use super::*;

    fn random_keys(random: &mut Random) -> Vec<(f64, f64)> {
        let mut x = if random.unit() < 0.3 { 0.0 } else { 0.2 * random.unit() };
        let mut keys = Vec::new();
        while x <= 1.0 {
            keys.push((x, random.unit()));
            if x > 0.0 && random.unit() < 0.2 {
                keys.push((x, random.unit()));
            }
            x += 0.01 + 0.3 * random.unit();
        }
        keys
    }

    #[test]
    fn what_is_no_profile_is_refused() {
        let error = |keys: &[(f64, f64)]| Profile::keyed(keys).expect_err("not a profile");
        assert_eq!(error(&[]), ProfileError::Empty);
        assert_eq!(error(&[(0.0, 1.0), (1.5, 1.0)]), ProfileError::Place { key: 1, x: 1.5 });
        assert!(matches!(error(&[(f64::NAN, 1.0)]), ProfileError::Place { key: 0, .. }));
        for bad in [-1.0, f64::NAN, f64::INFINITY] {
            assert!(matches!(error(&[(0.0, 1.0), (0.5, bad)]), ProfileError::Value { key: 1, .. }));
            assert!(Profile::constant(bad).is_err());
        }
        assert_eq!(error(&[(0.5, 1.0), (0.4, 1.0)]), ProfileError::Order { key: 1, x: 0.4 });
        assert_eq!(error(&[(0.5, 1.0), (0.5 + 1e-10, 2.0)]), ProfileError::Close { key: 1 });
        assert_eq!(error(&[(0.5, 1.0), (0.5, 2.0), (0.5, 3.0)]), ProfileError::Repeat { key: 2, x: 0.5 });
        assert_eq!(error(&[(0.0, 1.0), (0.0, 2.0)]), ProfileError::Repeat { key: 1, x: 0.0 });
        let message = error(&[(0.0, 1.0), (0.0, 2.0)]).to_string();
        assert_eq!(message, "key 1 is one too many at 0: two keys make a jump, and only between 0 and 1");
    }

    #[test]
    fn constants_and_straight_lines_are_exact() {
        let constant = Profile::constant(0.3).expect("valid");
        assert_eq!((constant.as_constant(), constant.max(), constant.at(0.7)), (Some(0.3), 0.3, 0.3));
        assert!(constant.knots().is_empty());
        assert_eq!(Profile::keyed(&[(0.2, 2.0), (0.7, 2.0)]).expect("valid").as_constant(), Some(2.0));
        assert_eq!(Profile::constant(0.0).expect("valid").as_constant(), Some(0.0));
        let cone = Profile::keyed(&[(0.0, 1.0), (0.5, 2.0), (1.0, 3.0)]).expect("valid");
        for k in 0..=100 {
            let x = f64::from(k) / 100.0;
            assert!((cone.at(x) - (1.0 + 2.0 * x)).abs() < 1e-15);
        }
        assert_eq!(cone.as_constant(), None);
    }

    #[test]
    fn a_jump_has_two_sides() {
        let profile = Profile::keyed(&[(0.25, 1.0), (0.5, 2.0), (0.5, 5.0), (0.75, 4.0)]).expect("valid");
        assert_eq!(profile.knots(), [0.25, 0.5, 0.75]);
        assert_eq!((profile.at(0.0), profile.at(0.5), profile.at(1.0)), (1.0, 5.0, 4.0));
        assert_eq!((profile.at_in(1, 0.5), profile.at_in(2, 0.5)), (2.0, 5.0));
        assert!((profile.at(0.5 - 1e-12) - 2.0).abs() < 1e-10);
        assert_eq!(profile.range(0.3, 0.5).1, 5.0);
        assert_eq!(profile.range(0.5, 0.6).0, 2.0);
        assert_eq!(profile.range(0.5, 0.5), (2.0, 5.0));
        assert_eq!((profile.range(0.0, 1.0), profile.max()), ((1.0, 5.0), 5.0));
        assert_eq!((profile.range(0.0, 0.2), profile.range(0.8, 1.0)), ((1.0, 1.0), (4.0, 4.0)));
    }

    #[test]
    fn passes_through_its_keys_between_its_neighbours_with_a_continuous_slope() {
        let mut random = Random(40);
        for _ in 0..200 {
            let keys = random_keys(&mut random);
            let profile = Profile::keyed(&keys).expect("valid");
            for pair in keys.windows(2) {
                let ((a, va), (b, vb)) = (pair[0], pair[1]);
                if a == b {
                    continue;
                }
                assert_eq!(profile.at(a), va);
                let mut before = va;
                for k in 1..=100 {
                    let value = profile.at(a + (b - a) * f64::from(k) / 101.0);
                    // Monotone to rounding.
                    assert!((value - before) * (vb - va) >= -1e-16, "{value} after {before}");
                    assert!(value >= va.min(vb) && value <= va.max(vb));
                    before = value;
                }
            }
            for (i, triple) in keys.windows(3).enumerate() {
                let x = triple[1].0;
                if triple[0].0 < x && x < triple[2].0 {
                    let h = 1e-7;
                    let (left, right) =
                        (profile.at(x) - profile.at(x - h), profile.at(x + h) - profile.at(x));
                    // Second derivatives are at most some 6 / 0.01^2 here: times h, and rounding over h.
                    assert!((left - right).abs() / h < 0.1, "key {i}");
                }
            }
        }
    }

    #[test]
    fn ranges_are_those_of_dense_samples() {
        let mut random = Random(41);
        for _ in 0..500 {
            let profile = Profile::keyed(&random_keys(&mut random)).expect("valid");
            let (a, b) = (random.unit(), random.unit());
            let (x0, x1) = (a.min(b), a.max(b));
            let (low, high) = profile.range(x0, x1);
            let (mut min, mut max) = (f64::INFINITY, 0.0_f64);
            for (piece, ends) in
                [0.0].iter().chain(profile.knots()).zip(profile.knots().iter().chain(&[1.0])).enumerate()
            {
                let (from, to) = (ends.0.max(x0), ends.1.min(x1));
                for k in 0..=200 {
                    let x = from + (to - from) * f64::from(k) / 200.0;
                    if from <= to {
                        min = min.min(profile.at_in(piece, x));
                        max = max.max(profile.at_in(piece, x));
                    }
                }
            }
            // Samples include every knot's two sides and both ends: equal to rounding.
            assert!((min - low).abs() < 1e-15 && (max - high).abs() < 1e-15);
        }
    }
}
