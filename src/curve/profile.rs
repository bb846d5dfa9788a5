//! The radius along a curve.

use super::polynomial::{GAUSS_16, gauss};
use std::f64::consts::TAU;

/// Why there is no such profile.
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
    /// Waves larger than their mean, or so many that they are none, or what is not finite or negative.
    #[error("waves need a mean from 0 to 1e60, an amplitude up to the mean, and a number from 0 to 10000")]
    Waves,
    /// A power below 0.01 or above 100, or an end that is negative, not finite, or beyond 1e60.
    #[error("growth needs ends from 0 to 1e60, and a power from 0.01 to 100")]
    Growth,
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
/// Keyed: between keys a monotone cubic, never above the larger nor below the smaller of two neighbouring keys, with
/// a continuous slope (Fritsch and Carlson, "Monotone piecewise cubic interpolation", 1980: slopes at keys
/// are the mean of the two chords' slopes, zero where these differ in sign, and both ends of an interval are
/// scaled back into the circle of radius 3, interval by interval along x). Before the first key and after the last it is
/// constant; two keys at one x make a jump.
///
/// Keyed and closed, for a closed curve: x = 1 is x = 0 again, and the keys go around. From the last key to the first, one
/// period on, the curve goes on as between any two, with continuous slopes; keys at 0 and at 1 are one key where their
/// values agree, and a jump where they differ. Scaling back begins behind the first key.
///
/// The other kinds are the formulas of [`Shape`].
#[derive(Debug, Clone, PartialEq)]
pub struct Profile {
    shape: Shape,
    knots: Vec<f64>,
    /// Of a keyed profile, `knots.len() + 1` pieces: piece i ends at knot i.
    pieces: Vec<Piece>,
    range: (f64, f64),
}

/// What a profile is made of.
#[derive(Debug, Clone, PartialEq)]
pub enum Shape {
    /// Interpolated.
    Keyed {
        /// Keys (x, value) in order of x.
        keys: Vec<(f64, f64)>,
        /// Whether the keys go around.
        closed: bool,
    },
    /// `mean + amplitude sin(2 pi (waves x + phase))`.
    Sinusoidal {
        /// At least the amplitude.
        mean: f64,
        /// At least 0.
        amplitude: f64,
        /// Waves from 0 to 1, 0 to 10000.
        waves: f64,
        /// In waves.
        phase: f64,
    },
    /// `from + (to - from) x^power`.
    Growing {
        /// Value at 0.
        from: f64,
        /// Value at 1.
        to: f64,
        /// 0.01 to 100.
        power: f64,
    },
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
        Ok(Profile::of_pieces(Shape::Keyed { keys: keys.to_vec(), closed: false }, pieces))
    }

    /// Keys (x, value) in order of x, going around.
    ///
    /// # Errors
    ///
    /// Those of [`Profile::keyed`], where the first key comes after the last.
    pub fn keyed_closed(keys: &[(f64, f64)]) -> Result<Profile, ProfileError> {
        check(keys)?;
        let Some((&first, &last)) = keys.first().zip(keys.last()) else { return Err(ProfileError::Empty) };
        let around = first.0 + 1.0 - last.0;
        if around > 0.0 && around < 1e-9 {
            return Err(ProfileError::Close { key: keys.len() - 1 });
        }
        let one = around == 0.0 && first.1 == last.1;
        let pieces = circular(&keys[..keys.len() - usize::from(one)]);
        Ok(Profile::of_pieces(Shape::Keyed { keys: keys.to_vec(), closed: true }, pieces))
    }

    /// `mean + amplitude sin(2 pi (waves x + phase))`, the phase in waves.
    ///
    /// # Errors
    ///
    /// An amplitude that is negative or above the mean; a mean beyond 1e60; waves outside of 0 to 10000; what is not
    /// finite.
    pub fn sinusoidal(mean: f64, amplitude: f64, waves: f64, phase: f64) -> Result<Profile, ProfileError> {
        let sound = (0.0..=1e60).contains(&mean)
            && (0.0..=mean).contains(&amplitude)
            && (0.0..=1e4).contains(&waves)
            && phase.is_finite();
        if !sound {
            return Err(ProfileError::Waves);
        }
        let phase = phase - phase.floor();
        // Knots at crests and troughs, so that nothing between two of them can be missed by sampling.
        let turning = |k: u32| (0.25 + 0.5 * f64::from(k) - phase) / waves;
        let knots = (0..).map(turning).take_while(|x| *x < 1.0).filter(|x| *x > 0.0).collect();
        let shape = Shape::Sinusoidal { mean, amplitude, waves, phase };
        let mut profile = Profile { shape, knots, pieces: vec![], range: (0.0, 0.0) };
        profile.range = profile.range(0.0, 1.0);
        Ok(profile)
    }

    /// `from + (to - from) x^power`.
    ///
    /// # Errors
    ///
    /// Ends that are negative, not finite, or beyond 1e60; a power outside of 0.01 to 100.
    pub fn growing(from: f64, to: f64, power: f64) -> Result<Profile, ProfileError> {
        let ends = 0.0..=1e60;
        if !ends.contains(&from) || !ends.contains(&to) || !(0.01..=100.0).contains(&power) {
            return Err(ProfileError::Growth);
        }
        let shape = Shape::Growing { from, to, power };
        Ok(Profile { shape, knots: vec![], pieces: vec![], range: (from.min(to), from.max(to)) })
    }

    fn of_pieces(shape: Shape, pieces: Vec<Piece>) -> Profile {
        let knots = pieces[1..].iter().map(|piece| piece.x0).collect();
        let mut profile = Profile { shape, knots, pieces, range: (0.0, 0.0) };
        profile.range = profile.range(0.0, 1.0);
        profile
    }

    /// What it is made of.
    pub fn shape(&self) -> &Shape {
        &self.shape
    }

    /// The value at x, clamped to [0, 1]; at a jump the value after it.
    pub fn at(&self, x: f64) -> f64 {
        self.at_in(self.knots.partition_point(|knot| *knot <= x), x)
    }

    /// The value at x as piece `piece` has it, which runs from knot `piece - 1` (or 0) to knot `piece` (or
    /// 1); x is clamped to that.
    fn at_in(&self, piece: usize, x: f64) -> f64 {
        let x = x.clamp(0.0, 1.0);
        match self.shape {
            Shape::Keyed { .. } => self.pieces[piece].at(x),
            Shape::Sinusoidal { mean, amplitude, waves, phase } => {
                let turns = waves * x + phase;
                let value = mean + amplitude * libm::sin(TAU * (turns - turns.floor()));
                value.max(mean - amplitude).min(mean + amplitude)
            }
            Shape::Growing { from, to, power } => {
                let value = from + (to - from) * libm::pow(x, power);
                value.max(from.min(to)).min(from.max(to))
            }
        }
    }

    /// Least and greatest value for x in [x0, x1], exact to rounding; of a jump in it or at its ends both
    /// sides count.
    pub fn range(&self, x0: f64, x1: f64) -> (f64, f64) {
        // From the piece that ends at or after x0 to the one that starts at or before x1.
        let first = self.knots.partition_point(|knot| *knot < x0);
        let last = self.knots.partition_point(|knot| *knot <= x1).max(first);
        let (mut low, mut high) = (f64::INFINITY, 0.0_f64);
        let mut include = |value: f64| {
            low = low.min(value);
            high = high.max(value);
        };
        match self.shape {
            Shape::Keyed { .. } => {
                for piece in first..=last {
                    include(self.at_in(piece, x0));
                    include(self.at_in(piece, x1));
                }
            }
            // Monotone between the ends and its turning points, which are its knots and all of two values.
            _ => {
                include(self.at(x0));
                include(self.at(x1));
                self.knots[first..last].iter().take(2).for_each(|knot| include(self.at(*knot)));
            }
        }
        (low, high)
    }

    /// Every x strictly inside (0, 1) where a derivative of the profile, or the profile itself, may jump, and where
    /// waves turn, ascending.
    pub fn knots(&self) -> &[f64] {
        &self.knots
    }

    /// The greatest value.
    pub fn max(&self) -> f64 {
        self.range.1
    }

    /// Root mean square over [0, 1], relative error at most 1e-12.
    pub fn rms(&self) -> f64 {
        if let Shape::Growing { from, to, power } = self.shape {
            let rise = to - from;
            let square = from * from + 2.0 * from * rise / (power + 1.0) + rise * rise / (2.0 * power + 1.0);
            return square.max(0.0).sqrt();
        }
        // The square of a cubic has degree 6; on half a wave sixteen points leave nothing either.
        let mut sum = 0.0;
        let ends = self.knots.iter().chain(&[1.0]);
        for (piece, (start, end)) in [0.0].iter().chain(&self.knots).zip(ends).enumerate() {
            sum += gauss(&GAUSS_16, *start, *end, |x| {
                let value = self.at_in(piece, x);
                value * value
            });
        }
        sum.sqrt()
    }

    /// The value, where it is the same everywhere.
    pub fn as_constant(&self) -> Option<f64> {
        (self.range.0 == self.range.1).then_some(self.range.0)
    }

    /// How far the value at x = 1 is from that at x = 0.
    pub fn step_around(&self) -> f64 {
        self.at(1.0) - self.at(0.0)
    }
}

/// An estimate of how far a profile through samples is from what was sampled: every second key is left out, where that
/// leaves no jump's side alone, and the largest difference to the keys that are left out is taken. That is the error of
/// half as many samples, and so more than that of all of them. `None` for fewer than three keys.
pub fn sampling_error(keys: &[(f64, f64)], closed: bool) -> Option<f64> {
    let inner = keys.len().checked_sub(2).filter(|inner| *inner > 0)?;
    let left_out =
        |i: usize| i % 2 == 1 && i <= inner && keys[i - 1].0 < keys[i].0 && keys[i].0 < keys[i + 1].0;
    let kept: Vec<_> = (0..keys.len()).filter(|&i| !left_out(i)).map(|i| keys[i]).collect();
    let coarse = if closed { Profile::keyed_closed(&kept) } else { Profile::keyed(&kept) }.ok()?;
    let errors = (0..keys.len()).filter(|&i| left_out(i)).map(|i| (coarse.at(keys[i].0) - keys[i].1).abs());
    errors.fold(None, |most: Option<f64>, error| Some(most.map_or(error, |most| most.max(error))))
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
        [slopes[i], slopes[i + 1]] = limit(chord, [slopes[i], slopes[i + 1]]);
    }
    for (pair, m) in keys.windows(2).zip(slopes.windows(2)) {
        let (x0, v0) = pair[0];
        let (x1, v1) = pair[1];
        let width = x1 - x0;
        pieces.push(Piece { x0, x1, v0, v1, m0: m[0] * width, m1: m[1] * width });
    }
}

/// The pieces on [0, 1] of keys that go around: of ascending x, the first not one with the last.
fn circular(keys: &[(f64, f64)]) -> Vec<Piece> {
    let n = keys.len();
    // Interval i goes from key i to the next, around the end.
    let next = |i: usize| (i + 1) % n;
    let width = |i: usize| keys[next(i)].0 - keys[i].0 + if next(i) == 0 { 1.0 } else { 0.0 };
    let chord = |i: usize| (width(i) > 0.0).then(|| (keys[next(i)].1 - keys[i].1) / width(i));
    let mut slopes: Vec<f64> = (0..n)
        .map(|i| match (chord((i + n - 1) % n), chord(i)) {
            (Some(left), Some(right)) if left * right > 0.0 => 0.5 * (left + right),
            (Some(_), Some(_)) | (None, None) => 0.0,
            (Some(only), None) | (None, Some(only)) => only,
        })
        .collect();
    for i in 0..n {
        let Some(chord) = chord(i) else { continue };
        let limited = limit(chord, [slopes[i], slopes[next(i)]]);
        (slopes[i], slopes[next(i)]) = (limited[0], limited[1]);
    }
    let piece = |i: usize, shift: f64| {
        let (x0, v0) = keys[i];
        let width = width(i);
        let x0 = x0 + shift;
        Piece {
            x0,
            x1: x0 + width,
            v0,
            v1: keys[next(i)].1,
            m0: slopes[i] * width,
            m1: slopes[next(i)] * width,
        }
    };
    let mut pieces = Vec::with_capacity(n + 1);
    if keys[0].0 > 0.0 {
        pieces.push(Piece { x1: keys[0].0, ..piece(n - 1, -1.0) });
    }
    pieces
        .extend((0..n - 1).filter(|&i| width(i) > 0.0).map(|i| Piece { x1: keys[i + 1].0, ..piece(i, 0.0) }));
    if keys[n - 1].0 < 1.0 {
        pieces.push(piece(n - 1, 0.0));
    }
    pieces
}

/// The slopes at an interval's ends, scaled back so that it is monotone along its chord.
fn limit(chord: f64, slopes: [f64; 2]) -> [f64; 2] {
    if chord == 0.0 {
        return [0.0; 2];
    }
    let ratios = slopes.map(|slope| slope / chord);
    let square = ratios[0] * ratios[0] + ratios[1] * ratios[1];
    if square <= 9.0 {
        return slopes;
    }
    let scale = 3.0 / square.sqrt();
    ratios.map(|ratio| scale * ratio * chord)
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

    #[test]
    fn keys_that_go_around_are_smooth_where_they_meet() {
        let mut random = Random(42);
        for round in 0..200 {
            let mut keys = random_keys(&mut random);
            if round % 2 == 0 {
                keys.retain(|key| key.0 > 0.05 && key.0 < 0.95);
                keys.insert(0, (0.0, 0.5));
                keys.push((1.0, 0.5));
            }
            let Ok(profile) = Profile::keyed_closed(&keys) else { continue };
            let h = 1e-7;
            assert!((profile.at(1.0) - profile.at(0.0)).abs() < 1e-12);
            let slopes = [profile.at(h) - profile.at(0.0), profile.at(1.0) - profile.at(1.0 - h)];
            // Second derivatives are at most some 6 / 0.01^2: times h, and rounding over h.
            let jumps = keys.windows(2).any(|w| w[0].0 == w[1].0 && !(0.001..0.999).contains(&w[0].0));
            assert!(jumps || (slopes[0] - slopes[1]).abs() / h < 0.1, "{keys:?}");
            // Monotone between neighbours, around the end too.
            let (first, last) = (keys[0], keys[keys.len() - 1]);
            let (low, high) = (first.1.min(last.1), first.1.max(last.1));
            for x in [0.25, 0.5, 0.75].map(|part| last.0 + part * (first.0 + 1.0 - last.0)) {
                assert!((low..=high).contains(&profile.at(x - if x > 1.0 { 1.0 } else { 0.0 })));
            }
        }
        // A period later the same keys make the same profile.
        let one = Profile::keyed_closed(&[(0.1, 1.0), (0.4, 2.0), (0.8, 0.5)]).expect("valid");
        let other = Profile::keyed_closed(&[(0.0, 2.0), (0.4, 0.5), (0.7, 1.0)]).expect("valid");
        for k in 0..100 {
            let x = f64::from(k) / 100.0;
            let shifted = if x < 0.4 { x + 0.6 } else { x - 0.4 };
            assert!((one.at(x) - other.at(shifted)).abs() < 1e-14);
        }
        assert_eq!(one.knots(), [0.1, 0.4, 0.8]);
    }

    #[test]
    fn waves_and_growth_have_their_formulas_and_ranges() {
        let mut random = Random(43);
        for _ in 0..300 {
            let mean = random.unit();
            let (amplitude, waves, phase) =
                (mean * random.unit(), 5.0 * random.unit(), 4.0 * random.unit() - 2.0);
            let (from, to, power) = (random.unit(), random.unit(), 0.05 + 4.0 * random.unit());
            let waving = Profile::sinusoidal(mean, amplitude, waves, phase).expect("valid");
            let growing = Profile::growing(from, to, power).expect("valid");
            let (a, b) = (random.unit(), random.unit());
            let (x0, x1) = (a.min(b), a.max(b));
            for (profile, rate) in [(&waving, TAU * waves * amplitude), (&growing, 0.0)] {
                let samples = (0..=2000).map(|k| profile.at(x0 + (x1 - x0) * f64::from(k) / 2000.0));
                let (least, most) = samples.fold((9.0, 0.0), |(l, m): (f64, f64), v| (l.min(v), m.max(v)));
                let (low, high) = profile.range(x0, x1);
                // Half a step from an extremum of this slope; ends are among the samples.
                let missed = rate * (x1 - x0) / 4000.0 + 1e-15;
                assert!(low <= least && least <= low + missed && high >= most && most >= high - missed);
                let mean_square: f64 =
                    (0..20_000).map(|k| profile.at((f64::from(k) + 0.5) / 20_000.0)).map(|v| v * v).sum();
                // The midpoint rule, first order where the slope is infinite at 0.
                assert!((profile.rms() - (mean_square / 20_000.0).sqrt()).abs() < 1e-4);
            }
            let turns = waves * x0 + phase;
            assert!((waving.at(x0) - mean - amplitude * libm::sin(TAU * turns)).abs() < 1e-13);
            assert!((growing.at(x0) - from - (to - from) * libm::pow(x0, power)).abs() < 1e-14);
            assert_eq!((growing.at(0.0), growing.at(1.0)), (from, to));
        }
        let full = Profile::sinusoidal(0.2, 0.2, 6.0, 0.0).expect("valid");
        assert_eq!((full.range(0.0, 1.0), full.max(), full.knots().len()), ((0.0, 0.4), 0.4, 12));
        assert_eq!(Profile::sinusoidal(0.2, 0.0, 6.0, 0.0).expect("valid").as_constant(), Some(0.2));
        assert_eq!(Profile::sinusoidal(0.2, 0.1, 0.0, 0.0).expect("valid").as_constant(), Some(0.2));
        assert_eq!(Profile::growing(0.2, 0.2, 2.0).expect("valid").as_constant(), Some(0.2));
        assert_eq!(Profile::sinusoidal(0.2, 0.3, 1.0, 0.0), Err(ProfileError::Waves));
        assert_eq!(Profile::sinusoidal(0.2, f64::NAN, 1.0, 0.0), Err(ProfileError::Waves));
        assert_eq!(Profile::growing(0.2, -1.0, 1.0), Err(ProfileError::Growth));
        assert_eq!(Profile::growing(0.2, 1.0, 0.0), Err(ProfileError::Growth));
    }

    #[test]
    fn sampling_errors_bound_those_of_smooth_profiles() {
        for n in [8_u32, 16, 32, 64] {
            let truth = |x: f64| 0.5 + 0.3 * libm::sin(TAU * 1.3 * x);
            let keys: Vec<_> = (0..=n).map(|k| f64::from(k) / f64::from(n)).map(|x| (x, truth(x))).collect();
            let estimate = sampling_error(&keys, false).expect("enough keys");
            let profile = Profile::keyed(&keys).expect("valid");
            let error = (0..=1000).map(|k| f64::from(k) / 1000.0).map(|x| (profile.at(x) - truth(x)).abs());
            let error = error.fold(0.0, f64::max);
            // Second order at least, so a quarter of it; and not without measure.
            assert!(error < 0.6 * estimate && estimate < 30.0 * error, "{n}: {error:e}, {estimate:e}");
        }
        assert_eq!(sampling_error(&[(0.0, 1.0), (1.0, 2.0)], false), None);
        assert_eq!(sampling_error(&[(0.0, 1.0), (0.5, 1.0), (0.5, 2.0), (1.0, 2.0)], true), None);
        assert_eq!(sampling_error(&[(0.0, 1.0), (0.5, 2.0), (1.0, 1.0)], true), Some(1.0));
    }
}
