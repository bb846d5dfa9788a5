//! The ranges that numbers of a scene lie in.

/// Largest magnitude of any number, so that no later sum or product of a few of them overflows.
const LARGEST: f64 = 1e9;
/// Smallest of the numbers that must be above 0, so that no quotient overflows.
const SMALLEST: f64 = 1e-9;

/// Frames are counted this far to either side of 0.
pub(crate) const LARGEST_FRAME: i64 = 1_000_000;

/// A closed range, and how a message names it.
#[derive(Debug)]
pub(crate) struct Limit {
    low: f64,
    high: f64,
    /// What was expected, where something else than a number was found.
    pub(crate) noun: &'static str,
    /// What was expected, where the number found lies outside.
    pub(crate) range: &'static str,
}

impl Limit {
    /// Whether x lies inside; false for NaN.
    pub(crate) fn admits(&self, x: f64) -> bool {
        self.low <= x && x <= self.high
    }
}

pub(crate) static ANY: Limit =
    Limit { low: -LARGEST, high: LARGEST, noun: "a number", range: "a number from -1e9 to 1e9" };

pub(crate) static POSITIVE: Limit =
    Limit { low: SMALLEST, high: LARGEST, noun: "a number above 0", range: "a number above 0 (1e-9 to 1e9)" };

pub(crate) static NOT_NEGATIVE: Limit = Limit {
    low: 0.0,
    high: LARGEST,
    noun: "a number, at least 0",
    range: "a number, at least 0 (and at most 1e9)",
};

pub(crate) static FRACTION: Limit =
    Limit { low: 0.0, high: 1.0, noun: "a number from 0 to 1", range: "a number from 0 to 1" };

/// A place along a curve, as a fraction of its length.
pub(crate) static PLACE: Limit =
    Limit { low: 0.0, high: 1.0, noun: "a number l from 0 to 1", range: "l from 0 to 1" };

/// A part of a whole.
pub(crate) static SHARE: Limit = Limit {
    low: SMALLEST,
    high: 1.0,
    noun: "a number above 0, at most 1",
    range: "a number above 0, at most 1",
};

/// A part at either end of a whole.
pub(crate) static HALF_SHARE: Limit = Limit {
    low: SMALLEST,
    high: 0.5,
    noun: "a number above 0, at most 0.5",
    range: "a number above 0, at most 0.5",
};

/// Waves along a whole. Each is cut into spans of its own, so that a thousand take some ten seconds to set up.
pub(crate) static WAVES: Limit =
    Limit { low: 0.0, high: 1e3, noun: "a number from 0 to 1000", range: "a number from 0 to 1000" };

/// An exponent.
pub(crate) static POWER: Limit =
    Limit { low: 0.01, high: 100.0, noun: "a number from 0.01 to 100", range: "a number from 0.01 to 100" };

/// A mean cosine short of the ends, where the phase function is a spike.
pub(crate) static MEAN_COSINE: Limit = Limit {
    low: -0.999,
    high: 0.999,
    noun: "a number from -0.999 to 0.999",
    range: "a number from -0.999 to 0.999",
};

/// An angle of view.
pub(crate) static DEGREES: Limit = Limit {
    low: 0.001,
    high: 179.999,
    noun: "degrees above 0 and below 180",
    range: "degrees above 0 and below 180 (0.001 to 179.999)",
};

/// Cells of noise that a warp displaces by.
pub(crate) static CELLS: Limit =
    Limit { low: 0.0, high: 1000.0, noun: "a number, at least 0", range: "a number of cells from 0 to 1000" };

/// A temperature.
pub(crate) static KELVIN: Limit = Limit {
    low: 0.0,
    high: LARGEST,
    noun: "a temperature in kelvin, at least 0",
    range: "kelvin, at least 0 (and at most 1e9)",
};

/// Kelvin of a black body that glows in a colour: below this nothing is seen, above this the colour changes no more.
pub(crate) static FLAME: Limit = Limit {
    low: 500.0,
    high: 1e5,
    noun: "a temperature in kelvin, 500 to 1e5",
    range: "a temperature in kelvin, 500 to 1e5",
};

/// Factors of 2 of brightness.
pub(crate) static STOPS: Limit = Limit {
    low: -100.0,
    high: 100.0,
    noun: "a number of stops, -100 to 100",
    range: "a number of stops, -100 to 100",
};
