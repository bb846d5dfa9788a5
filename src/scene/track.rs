//! A number over time, in closed form: its value at a time, and its integral since time 0.

use std::f64::consts::TAU;

/// A number as a function of time in seconds.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Track {
    Keyed(Keyed),
    Wave(Wave),
}

impl Track {
    pub(super) fn at(&self, time: f64) -> f64 {
        match self {
            Track::Keyed(keyed) => keyed.at(time),
            Track::Wave(wave) => wave.at(time),
        }
    }

    /// From time 0 to `time`.
    pub(super) fn integral(&self, time: f64) -> f64 {
        match self {
            Track::Keyed(keyed) => keyed.since_first(time) - keyed.since_first(0.0),
            Track::Wave(wave) => wave.integral(time),
        }
    }
}

/// `mean + amplitude sin(2 pi (time / period + phase))`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Wave {
    pub(super) mean: f64,
    pub(super) amplitude: f64,
    /// Seconds, above 0.
    pub(super) period: f64,
    /// Turns.
    pub(super) phase: f64,
}

impl Wave {
    /// Least and greatest value.
    pub(super) fn range(&self) -> [f64; 2] {
        [self.mean - self.amplitude.abs(), self.mean + self.amplitude.abs()]
    }

    fn at(&self, time: f64) -> f64 {
        let [low, high] = self.range();
        let (sin, _) = sin_cos_turns(time / self.period + self.phase);
        (self.mean + self.amplitude * sin).clamp(low, high)
    }

    fn integral(&self, time: f64) -> f64 {
        // cos a - cos b = 2 sin((a + b) / 2) sin((b - a) / 2), which does not cancel at short times.
        let half = 0.5 * time / self.period;
        let (middle, change) = (sin_cos_turns(half + self.phase).0, sin_cos_turns(half).0);
        self.mean * time + 2.0 / TAU * self.amplitude * self.period * middle * change
    }
}

/// Sine and cosine of so many turns; exact at whole quarters.
pub(super) fn sin_cos_turns(turns: f64) -> (f64, f64) {
    let turns = turns - turns.floor();
    let quarter = (4.0 * turns).round();
    let (sin, cos) = libm::sincos(TAU * (turns - 0.25 * quarter));
    match quarter {
        1.0 => (cos, -sin),
        2.0 => (-sin, -cos),
        3.0 => (-cos, sin),
        _ => (sin, cos),
    }
}

/// What a number does between two keys.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Interpolation {
    /// A monotone cubic: never beyond the larger or the smaller of the two keys, with a continuous rate of change.
    Smooth,
    /// A straight line.
    Linear,
    /// The first key's value until the second.
    Step,
}

/// Keys (time, value), and between them polynomials of degree 3 at most.
///
/// Before the first key and after the last the value is theirs, or the keys repeat; two keys at one time make a jump.
/// A smooth number's rate of change at a key is the mean of the slopes to either side, but 0 where these differ in sign,
/// and at most three times the smaller of them, which makes the cubics monotone (de Boor and Swartz, "Piecewise monotone
/// interpolation", 1977). At the first and the last key it is 0, unless the keys repeat; at a jump it is that to the one side.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Keyed {
    first: (f64, f64),
    last: (f64, f64),
    pieces: Vec<Piece>,
    /// Whether the keys start anew after the last.
    repeat: bool,
}

/// A cubic in (time - start) / width.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Piece {
    start: f64,
    width: f64,
    coefficients: [f64; 4],
    /// Least and greatest value.
    range: [f64; 2],
    /// Integral from the first key to the start.
    before: f64,
}

impl Piece {
    fn fraction(&self, time: f64) -> f64 {
        ((time - self.start) / self.width).clamp(0.0, 1.0)
    }

    fn at(&self, time: f64) -> f64 {
        let (u, [a, b, c, d]) = (self.fraction(time), self.coefficients);
        // Monotone but for rounding.
        (a + u * (b + u * (c + u * d))).clamp(self.range[0], self.range[1])
    }

    /// From the first key.
    fn integral(&self, time: f64) -> f64 {
        let (u, [a, b, c, d]) = (self.fraction(time), self.coefficients);
        self.before + self.width * u * (a + u * (b / 2.0 + u * (c / 3.0 + u * d / 4.0)))
    }
}

impl Keyed {
    /// Keys in order of time; `None` where there is none. Keys that repeat are at two different times at least.
    pub(super) fn new(keys: &[(f64, f64)], interpolation: Interpolation, repeat: bool) -> Option<Keyed> {
        let (&first, &last) = keys.first().zip(keys.last())?;
        let runs: Vec<_> = keys.chunk_by(|a, b| a.0 < b.0).map(Chords::new).collect();
        let ends = Chords::ends(&runs, repeat);
        let mut pieces: Vec<Piece> = Vec::new();
        let mut before = 0.0;
        for (index, run) in runs.iter().enumerate() {
            let start = if index == 0 { ends[0] } else { run.chords.first().copied() };
            let end = if index + 1 == runs.len() { ends[1] } else { run.chords.last().copied() };
            for (i, (&(t0, v0), &(t1, v1))) in run.pairs().enumerate() {
                let (width, rise) = (t1 - t0, v1 - v0);
                let slope = |key: usize, end: Option<f64>| width * run.slope(key).or(end).unwrap_or(0.0);
                let coefficients = match interpolation {
                    Interpolation::Step => [v0, 0.0, 0.0, 0.0],
                    Interpolation::Linear => [v0, rise, 0.0, 0.0],
                    Interpolation::Smooth => {
                        let (m0, m1) = (slope(i, start), slope(i + 1, end));
                        [v0, m0, 3.0 * rise - 2.0 * m0 - m1, m0 + m1 - 2.0 * rise]
                    }
                };
                let piece = Piece { start: t0, width, coefficients, range: [v0.min(v1), v0.max(v1)], before };
                before = piece.integral(t1);
                pieces.push(piece);
            }
        }
        Some(Keyed { first, last, pieces, repeat })
    }

    fn at(&self, time: f64) -> f64 {
        let (_, time) = self.wrapped(time);
        if time < self.first.0 {
            self.first.1
        } else if time >= self.last.0 && !self.repeat {
            self.last.1
        } else {
            self.piece(time).map_or(self.last.1, |piece| piece.at(time))
        }
    }

    /// Integral from the first key to `time`, below 0 before it.
    fn since_first(&self, time: f64) -> f64 {
        let (rounds, time) = self.wrapped(time);
        let whole = self.pieces.last().map_or(0.0, |piece| piece.integral(self.last.0));
        let part = if time < self.first.0 {
            self.first.1 * (time - self.first.0)
        } else {
            let beyond = if self.repeat { 0.0 } else { (time - self.last.0).max(0.0) };
            self.piece(time).map_or(0.0, |piece| piece.integral(time)) + self.last.1 * beyond
        };
        rounds * whole + part
    }

    /// Whole rounds of keys that repeat, and the time in the present one; a round is its start's, not its end's.
    fn wrapped(&self, time: f64) -> (f64, f64) {
        let period = self.last.0 - self.first.0;
        if !self.repeat || period <= 0.0 {
            return (0.0, time);
        }
        let rounds = ((time - self.first.0) / period).floor();
        (rounds, (time - rounds * period).clamp(self.first.0, self.last.0))
    }

    /// The piece that `time`, not before the first key, lies in, or the last; `None` where all keys are at one time.
    fn piece(&self, time: f64) -> Option<&Piece> {
        let index = self.pieces.partition_point(|piece| piece.start <= time);
        self.pieces.get(index.saturating_sub(1))
    }
}

/// Keys of strictly ascending time, and the slopes between them.
#[derive(Debug)]
struct Chords<'a> {
    keys: &'a [(f64, f64)],
    chords: Vec<f64>,
}

impl Chords<'_> {
    fn new(keys: &[(f64, f64)]) -> Chords<'_> {
        let mut run = Chords { keys, chords: vec![] };
        run.chords = run.pairs().map(|((t0, v0), (t1, v1))| (v1 - v0) / (t1 - t0)).collect();
        run
    }

    /// Keys that follow each other.
    fn pairs(&self) -> impl Iterator<Item = (&(f64, f64), &(f64, f64))> {
        self.keys.iter().zip(self.keys.iter().skip(1))
    }

    /// Rate of change at a key between two others.
    fn slope(&self, key: usize) -> Option<f64> {
        let before = self.chords.get(key.checked_sub(1)?)?;
        self.chords.get(key).map(|after| monotone(*before, *after))
    }

    /// Rates of change at the first key of all and at the last.
    fn ends(runs: &[Chords<'_>], repeat: bool) -> [Option<f64>; 2] {
        let (Some(first), Some(last), true) = (runs.first(), runs.last(), repeat) else { return [None; 2] };
        let (start, end) = (first.chords.first().copied(), last.chords.last().copied());
        let value = |key: Option<&(f64, f64)>| key.map(|(_, value)| *value);
        match (start, end) {
            (Some(after), Some(before)) if value(first.keys.first()) == value(last.keys.last()) => {
                [Some(monotone(before, after)); 2]
            }
            _ => [start, end],
        }
    }
}

/// A rate of change where two slopes meet.
fn monotone(before: f64, after: f64) -> f64 {
    if before * after <= 0.0 {
        return 0.0;
    }
    let most = 3.0 * before.abs().min(after.abs());
    (0.5 * (before + after)).clamp(-most, most)
}

#[cfg(test)]
mod tests {
    use super::*;

    use Interpolation::{Linear, Smooth, Step};

    fn keyed(keys: &[(f64, f64)], interpolation: Interpolation, repeat: bool) -> Track {
        Track::Keyed(Keyed::new(keys, interpolation, repeat).expect("there are keys"))
    }

    /// splitmix64 (Steele, Lea, Flood 2014).
    struct Random(u64);

    impl Random {
        fn unit(&mut self) -> f64 {
            self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
            let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
            let z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
            (z >> 11) as f64 / 9_007_199_254_740_992.0
        }
    }

    fn random_keys(random: &mut Random, jumps: bool) -> Vec<(f64, f64)> {
        let mut time = 4.0 * random.unit() - 2.0;
        let mut keys = Vec::new();
        while keys.len() < 2 || random.unit() < 0.7 {
            keys.push((time, 2.0 * random.unit() - 1.0));
            if !jumps || keys.len() < 2 || random.unit() < 0.8 {
                time += 0.05 + random.unit();
            }
        }
        keys
    }

    #[test]
    fn sines_are_exact_at_quarters_and_close_elsewhere() {
        for (turns, expected) in [
            (0.0, (0.0, 1.0)),
            (0.25, (1.0, 0.0)),
            (0.5, (0.0, -1.0)),
            (-0.25, (-1.0, 0.0)),
            (1e6 + 0.75, (-1.0, 0.0)),
        ] {
            assert_eq!(sin_cos_turns(turns), expected, "{turns}");
        }
        for step in -400..400 {
            let turns = f64::from(step) / 97.0;
            let (sin, cos) = sin_cos_turns(turns);
            // The argument of libm's own is up to 26, so rounded by up to 2e-15.
            assert!((sin - libm::sin(TAU * turns)).abs() < 4e-15);
            assert!((cos - libm::cos(TAU * turns)).abs() < 4e-15);
        }
    }

    #[test]
    fn waves_have_their_closed_form() {
        let wave = Wave { mean: 2.0, amplitude: -0.5, period: 4.0, phase: 0.125 };
        let track = Track::Wave(wave);
        assert_eq!(wave.range(), [1.5, 2.5]);
        // An eighth of a turn on: the crest, which an amplitude below 0 turns into a trough.
        assert_eq!(track.at(0.5), 1.5);
        assert_eq!(track.at(2.5), 2.5);
        assert_eq!(track.integral(0.0), 0.0);
        // Over a period the sine adds up to nothing; 2 pi * 1e-16 rounding times a few.
        assert!((track.integral(4.0) - 8.0).abs() < 1e-15);
        assert!((track.integral(-4.0) + 8.0).abs() < 1e-15);
        assert!((track.integral(1e-9) - 1e-9 * track.at(0.0)).abs() < 1e-18);
    }

    #[test]
    fn keys_have_their_closed_forms() {
        let keys = [(1.0, 2.0), (3.0, 6.0)];
        let values = |interpolation| {
            let track = keyed(&keys, interpolation, false);
            [0.0, 1.0, 1.5, 2.0, 3.0, 9.0].map(|time| track.at(time))
        };
        assert_eq!(values(Linear), [2.0, 2.0, 3.0, 4.0, 6.0, 6.0]);
        assert_eq!(values(Step), [2.0, 2.0, 2.0, 2.0, 6.0, 6.0]);
        // A smoothstep: 1/4 of the way it has risen by 5/32.
        assert_eq!(values(Smooth), [2.0, 2.0, 2.0 + 4.0 * 5.0 / 32.0, 4.0, 6.0, 6.0]);
        for interpolation in [Linear, Smooth] {
            let track = keyed(&keys, interpolation, false);
            // The rise is symmetric about its middle.
            assert_eq!([1.0, 3.0, 5.0, -2.0].map(|time| track.integral(time)), [2.0, 10.0, 22.0, -4.0]);
        }
        assert_eq!(keyed(&keys, Step, false).integral(5.0), 6.0 + 12.0);
        let single = keyed(&[(5.0, 0.25)], Smooth, false);
        assert_eq!((single.at(-1.0), single.at(7.0), single.integral(8.0)), (0.25, 0.25, 2.0));
        assert_eq!(Keyed::new(&[], Smooth, false), None);
    }

    #[test]
    fn a_jump_belongs_to_what_follows() {
        for interpolation in [Smooth, Linear, Step] {
            let track = keyed(&[(0.0, 1.0), (1.0, 1.0), (1.0, 4.0), (2.0, 4.0)], interpolation, false);
            assert_eq!([0.5, 1.0, 1.5].map(|time| track.at(time)), [1.0, 4.0, 4.0]);
            assert_eq!(track.integral(2.0), 5.0);
            let switch = keyed(&[(1.0, 0.0), (1.0, 3.0)], interpolation, false);
            assert_eq!([0.9, 1.0, 1.1].map(|time| switch.at(time)), [0.0, 3.0, 3.0]);
            assert_eq!(switch.integral(2.0), 3.0);
        }
    }

    #[test]
    fn repeated_keys_are_periodic() {
        // A saw tooth: half a unit for each period of 2 s.
        let saw = keyed(&[(0.0, 0.0), (2.0, 0.5)], Linear, true);
        assert_eq!([0.0, 1.0, 2.0, 3.0, -1.0].map(|time| saw.at(time)), [0.0, 0.25, 0.0, 0.25, 0.25]);
        assert_eq!([2.0, 5.0, -2.0].map(|time| saw.integral(time)), [0.5, 1.0 + 0.125, -0.5]);
        let steps = keyed(&[(0.0, 1.0), (1.0, 3.0), (2.0, 1.0)], Step, true);
        assert_eq!([0.5, 1.5, 2.5, 3.5].map(|time| steps.at(time)), [1.0, 3.0, 1.0, 3.0]);
        let mut random = Random(5);
        for _ in 0..50 {
            let keys = random_keys(&mut random, true);
            let period = keys[keys.len() - 1].0 - keys[0].0;
            let track = keyed(&keys, Smooth, true);
            for _ in 0..20 {
                let time = keys[0].0 + period * random.unit();
                // Rounding of times up to 7 periods, and slopes of up to 3 * 2 / 0.05.
                let tolerance = 120.0 * 1e-14;
                assert!((track.at(time + 7.0 * period) - track.at(time)).abs() < tolerance);
                assert!((track.at(time - 3.0 * period) - track.at(time)).abs() < tolerance);
            }
        }
    }

    #[test]
    fn smooth_tracks_stay_between_their_keys_and_have_a_continuous_rate() {
        let mut random = Random(9);
        for round in 0..200 {
            let (mut keys, repeat) = (random_keys(&mut random, false), round % 2 == 1);
            if repeat {
                let last = keys.len() - 1;
                keys[last].1 = keys[0].1;
            }
            let track = keyed(&keys, Smooth, repeat);
            for pair in keys.windows(2) {
                let ((a, va), (b, vb)) = (pair[0], pair[1]);
                let mut before = va;
                for k in 0..100 {
                    let value = track.at(a + (b - a) * f64::from(k) / 100.0);
                    assert!(va.min(vb) <= value && value <= va.max(vb));
                    // Monotone to rounding.
                    assert!((value - before) * (vb - va) >= -1e-15, "{value} after {before}");
                    before = value;
                }
            }
            for &(time, value) in &keys {
                // Rounding where a repeated key is reached by way of its first.
                assert!((track.at(time) - value).abs() < 1e-13);
                let h = 1e-6;
                let (left, right) =
                    (track.at(time) - track.at(time - h), track.at(time + h) - track.at(time));
                // Second derivatives are at most 18 * 2 / 0.05^2 = 15000: times h, and rounding over h.
                assert!((left - right).abs() / h < 0.03, "{left} then {right} at {time}");
            }
        }
    }

    /// Gauss and Legendre's two points, exact for cubics, on each of so many panels.
    fn quadrature(track: &Track, from: f64, to: f64, panels: u32) -> f64 {
        let half = 0.5 * (to - from) / f64::from(panels);
        let middles = (0..panels).map(|panel| from + f64::from(2 * panel + 1) * half);
        middles
            .map(|t| {
                half * [-1.0, 1.0].map(|side| track.at(t + side * half / 3.0_f64.sqrt())).iter().sum::<f64>()
            })
            .sum()
    }

    #[test]
    fn integrals_are_those_of_quadrature() {
        let mut random = Random(3);
        for round in 0..60 {
            let keys = random_keys(&mut random, round % 2 == 1);
            let period = keys[keys.len() - 1].0 - keys[0].0;
            for (interpolation, repeat) in
                [Smooth, Linear, Step].into_iter().flat_map(|kind| [(kind, false), (kind, true)])
            {
                let track = keyed(&keys, interpolation, repeat);
                let (mut sum, start) = (0.0, keys[0].0);
                for pair in keys.windows(2).filter(|pair| pair[0].0 < pair[1].0) {
                    sum += quadrature(&track, pair[0].0, pair[1].0, 1);
                    // Times and values are of the order of 10, so a dozen sums of them are good to 1e-13.
                    let found = track.integral(pair[1].0) - track.integral(start);
                    assert!((found - sum).abs() < 1e-13, "{found}, not {sum}: {track:?}");
                }
                let end = keys[keys.len() - 1].0;
                if repeat {
                    let found = track.integral(end + 2.0 * period) - track.integral(end);
                    assert!((found - 2.0 * sum).abs() < 1e-12);
                } else {
                    let found = [
                        track.integral(end + 3.0) - track.integral(end),
                        track.integral(start - 3.0) - track.integral(start),
                    ];
                    let ends = [3.0 * track.at(end), -3.0 * track.at(start - 1.0)];
                    assert!(
                        (found[0] - ends[0]).abs().max((found[1] - ends[1]).abs()) < 1e-13,
                        "{found:?}, not {ends:?}: {track:?}"
                    );
                }
            }
            let [mean, amplitude, phase] = [random.unit(), 2.0 * random.unit() - 1.0, random.unit()];
            let wave = Track::Wave(Wave { mean, amplitude, period: 0.3 + random.unit(), phase });
            let to = 12.0 * random.unit() - 6.0;
            // (2 pi / 0.3 * 6 / 4000)^4 / 135 of the amplitude is what the two points leave.
            assert!((wave.integral(to) - quadrature(&wave, 0.0, to, 4000)).abs() < 1e-7);
        }
    }
}
