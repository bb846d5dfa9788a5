//! Polynomials of degree 5 in f64: interpolation at Chebyshev points, and change of variable.

use std::ops::{Add, Mul, Sub};

/// Degree of the polynomials that stand for frames, arc length and radius along a span.
pub const DEGREE: usize = 5;
/// Number of coefficients, and of interpolation points.
pub const TERMS: usize = DEGREE + 1;

/// The Chebyshev points of the first kind, `cos((2 i + 1) pi / 12)`, where [`interpolate`] wants its values.
pub const NODES: [f64; TERMS] = [
    0.965_925_826_289_068_3,
    std::f64::consts::FRAC_1_SQRT_2,
    0.258_819_045_102_520_74,
    -0.258_819_045_102_520_74,
    -std::f64::consts::FRAC_1_SQRT_2,
    -0.965_925_826_289_068_3,
];

/// The polynomial through `values` at [`NODES`], in powers of x, lowest first.
///
/// For a function analytic on [-1, 1] the error there is below `sup |f^(6)| / (2^5 6!)`.
pub fn interpolate<V>(values: &[V; TERMS]) -> [V; TERMS]
where
    V: Copy + Add<Output = V> + Sub<Output = V> + Mul<f64, Output = V>,
{
    // Newton's divided differences, then expansion: backward stable enough at degree 5 (errors of a few ulp).
    let mut d = *values;
    for order in 1..TERMS {
        for i in (order..TERMS).rev() {
            d[i] = (d[i] - d[i - 1]) * (1.0 / (NODES[i] - NODES[i - order]));
        }
    }
    let mut c = [values[0] * 0.0; TERMS];
    for i in (0..TERMS).rev() {
        // c <- c (x - NODES[i]) + d[i]
        for k in (1..TERMS).rev() {
            c[k] = c[k - 1] - c[k] * NODES[i];
        }
        c[0] = d[i] - c[0] * NODES[i];
    }
    c
}

/// The same polynomial in y, where x = centre + scale y.
pub fn substitute<V, const N: usize>(c: &[V; N], centre: f64, scale: f64) -> [V; N]
where
    V: Copy + Add<Output = V> + Mul<f64, Output = V>,
{
    let mut out = *c;
    for i in 0..N {
        for k in (i..N - 1).rev() {
            out[k] = out[k] + out[k + 1] * centre;
        }
    }
    let mut power = 1.0;
    for term in &mut out {
        *term = *term * power;
        power *= scale;
    }
    out
}

/// Takes the two highest powers out of a polynomial, leaving the cubic that is nearest to it on [-1, 1], nearly: off by no
/// more than [`beyond_cubic`]. (Lanczos' economization: `x^4` and `x^5` less their Chebyshev polynomials.)
pub fn to_cubic(c: &mut [f64; TERMS]) {
    c[0] -= c[4] / 8.0;
    c[1] -= c[5] * (5.0 / 16.0);
    c[2] += c[4];
    c[3] += c[5] * (20.0 / 16.0);
    (c[4], c[5]) = (0.0, 0.0);
}

/// The largest change by [`to_cubic`] on [-1, 1].
pub fn beyond_cubic(c: &[f64; TERMS]) -> f64 {
    c[4].abs() / 8.0 + c[5].abs() / 16.0
}

/// Value at x.
pub fn evaluate<V, const N: usize>(c: &[V; N], x: f64) -> V
where
    V: Copy + Add<Output = V> + Mul<f64, Output = V>,
{
    let mut sum = c[N - 1];
    for k in (0..N - 1).rev() {
        sum = sum * x + c[k];
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cubics_differ_by_what_is_said() {
        let c = [0.3, -1.7, 0.25, 2.0, -0.5, 0.125];
        let mut cubic = c;
        to_cubic(&mut cubic);
        assert_eq!(cubic[4..], [0.0; 2]);
        let differs = |x: f64| (evaluate(&c, x) - evaluate(&cubic, x)).abs();
        let largest = (-1000..=1000).map(|i| differs(f64::from(i) / 1000.0)).fold(0.0, f64::max);
        // Both terms are largest at 1 or at -1, where one adds to the other.
        assert!((largest - beyond_cubic(&c)).abs() < 1e-12, "{largest}");
    }

    #[test]
    fn interpolation_reproduces_polynomials_of_its_degree() {
        let c = [0.3, -1.7, 0.25, 2.0, -0.5, 0.125];
        let found = interpolate(&NODES.map(|x| evaluate(&c, x)));
        for (a, b) in c.iter().zip(found) {
            // Six operations on numbers of size 2 at 1.1e-16 each, amplified by the nodes' conditioning of about 20.
            assert!((a - b).abs() < 1e-14, "{c:?} {found:?}");
        }
    }

    #[test]
    fn substitution_is_change_of_variable() {
        let c = [0.3, -1.7, 0.25, 2.0, -0.5, 0.125];
        let moved = substitute(&c, -0.4, 0.3);
        for i in 0..=20 {
            let y = f64::from(i) / 10.0 - 1.0;
            assert!((evaluate(&moved, y) - evaluate(&c, 0.3 * y - 0.4)).abs() < 1e-15 * 10.0);
        }
    }

    #[test]
    fn interpolation_error_of_a_turn_is_within_the_stated_bound() {
        // f = cos(a x): sup |f^(6)| = a^6.
        let a: f64 = 0.4;
        let c = interpolate(&NODES.map(|x| libm::cos(a * x)));
        let bound = a * a * a * a * a * a / (32.0 * 720.0);
        for i in 0..=1000 {
            let x = f64::from(i) / 500.0 - 1.0;
            assert!((evaluate(&c, x) - libm::cos(a * x)).abs() <= bound * 1.000_001 + 1e-15);
        }
    }
}
