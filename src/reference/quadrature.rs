//! Gauss-Legendre quadrature with nodes found here.

use std::f64::consts::PI;

/// A Gauss-Legendre rule on [-1, 1], exact for polynomials of degree `2 n - 1`.
#[derive(Debug, Clone)]
pub(super) struct Rule {
    nodes: Vec<f64>,
    weights: Vec<f64>,
}

impl Rule {
    /// The rule with `n >= 1` nodes: Newton's method on the Legendre polynomial from the Chebyshev-like guess
    /// `cos(pi (i + 3/4) / (n + 1/2))` (Abramowitz and Stegun 25.4.29; the guess is Tricomi's leading term).
    pub(super) fn new(n: u32) -> Rule {
        let (mut nodes, mut weights) = (Vec::new(), Vec::new());
        for i in 0..n {
            let mut x = libm::cos(PI * (f64::from(i) + 0.75) / (f64::from(n) + 0.5));
            // Convergence is quadratic: eight steps are far more than the four that any n here needs.
            for _ in 0..8 {
                let (p, slope) = legendre(n, x);
                x -= p / slope;
            }
            let (_, slope) = legendre(n, x);
            nodes.push(x);
            weights.push(2.0 / ((1.0 - x * x) * slope * slope));
        }
        Rule { nodes, weights }
    }

    /// The integral of `f` from `a` to `b`.
    pub(super) fn integrate(&self, a: f64, b: f64, f: impl Fn(f64) -> f64) -> f64 {
        let (middle, half) = (0.5 * (a + b), 0.5 * (b - a));
        let terms =
            self.nodes.iter().zip(&self.weights).map(|(node, weight)| weight * f(middle + half * node));
        half * terms.sum::<f64>()
    }
}

/// The Legendre polynomial of degree `n` at `x` and its slope there.
fn legendre(n: u32, x: f64) -> (f64, f64) {
    let (mut before, mut p) = (0.0, 1.0);
    for k in 1..=n {
        let k = f64::from(k);
        (before, p) = (p, ((2.0 * k - 1.0) * x * p - (k - 1.0) * before) / k);
    }
    (p, f64::from(n) * (x * p - before) / (x * x - 1.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn integrates_monomials_up_to_degree_2n_minus_1() {
        for n in [2, 5, 16] {
            let rule = Rule::new(n);
            for degree in 0..2 * n {
                let power = |x: f64| (0..degree).fold(1.0, |y, _| y * x);
                let exact = 1.0 / f64::from(degree + 1);
                let found = rule.integrate(0.0, 1.0, power);
                // Rounding of at most 16 terms of order 1.
                assert!((found - exact).abs() < 1e-14, "n {n} degree {degree}: {found} against {exact}");
            }
        }
    }
}
