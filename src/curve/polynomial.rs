//! Real roots of quadratics and cubics, and Gauss-Legendre quadrature.

/// Value at `t` of the polynomial with coefficients `a`, lowest degree first.
pub(super) fn eval<const N: usize>(a: &[f64; N], t: f64) -> f64 {
    a.iter().rev().fold(0.0, |value, c| value * t + c)
}

/// Real roots of `a[0] + a[1] t + a[2] t^2`, ascending where there are two; none for a constant.
///
/// The larger root in magnitude comes from a sum without cancellation, the other from the product of the roots.
pub(super) fn quadratic_roots(a: [f64; 3]) -> [Option<f64>; 2] {
    let finite = |t: f64| t.is_finite().then_some(t);
    if a[2] == 0.0 {
        return [finite(-a[0] / a[1]), None];
    }
    let discriminant = a[1] * a[1] - 4.0 * a[2] * a[0];
    if discriminant < 0.0 || discriminant.is_nan() {
        return [None, None];
    }
    let q = -0.5 * (a[1] + discriminant.sqrt().copysign(a[1]));
    let (r, s) = (q / a[2], if q == 0.0 { 0.0 } else { a[0] / q });
    [finite(r.min(s)), finite(r.max(s))]
}

/// Roots of `a[0] + a[1] t + a[2] t^2 + a[3] t^3` strictly inside (0, 1), ascending, to rounding of the value.
///
/// Bisection between the extrema: a root that the polynomial touches without crossing may be left out.
pub(super) fn cubic_roots_inside(a: [f64; 4]) -> Vec<f64> {
    let mut ends = vec![0.0];
    let extrema = quadratic_roots([a[1], 2.0 * a[2], 3.0 * a[3]]);
    ends.extend(extrema.into_iter().flatten().filter(|t| *t > 0.0 && *t < 1.0));
    ends.push(1.0);
    let mut roots = Vec::new();
    for pair in ends.windows(2) {
        let (lo, hi) = (pair[0], pair[1]);
        let (at_lo, at_hi) = (eval(&a, lo), eval(&a, hi));
        if at_lo == 0.0 && lo > 0.0 {
            roots.push(lo);
        } else if (at_lo < 0.0 && at_hi > 0.0) || (at_lo > 0.0 && at_hi < 0.0) {
            let root = bisect(lo, hi, |t| eval(&a, t));
            if root > 0.0 && root < 1.0 {
                roots.push(root);
            }
        }
    }
    roots
}

/// Where `f` changes sign between `lo` and `hi`, to neighbouring numbers.
pub(super) fn bisect(mut lo: f64, mut hi: f64, f: impl Fn(f64) -> f64) -> f64 {
    let rising = f(hi) > 0.0;
    loop {
        let mid = 0.5 * (lo + hi);
        let between = lo < mid && mid < hi;
        if !between {
            return mid;
        }
        let value = f(mid);
        if value == 0.0 {
            return mid;
        }
        if (value > 0.0) == rising {
            hi = mid;
        } else {
            lo = mid;
        }
    }
}

/// Positive nodes and their weights on [-1, 1] of the rule with 8 points.
pub(super) const GAUSS_8: [(f64, f64); 4] = [
    (0.1834346424956498, 0.362683783378362),
    (0.525532409916329, 0.31370664587788727),
    (0.7966664774136267, 0.22238103445337448),
    (0.9602898564975363, 0.10122853629037626),
];

/// Positive nodes and their weights on [-1, 1] of the rule with 16 points.
pub(super) const GAUSS_16: [(f64, f64); 8] = [
    (0.09501250983763744, 0.1894506104550685),
    (0.2816035507792589, 0.18260341504492358),
    (0.45801677765722737, 0.16915651939500254),
    (0.6178762444026438, 0.14959598881657674),
    (0.755404408355003, 0.12462897125553388),
    (0.8656312023878318, 0.09515851168249279),
    (0.9445750230732326, 0.062253523938647894),
    (0.9894009349916499, 0.027152459411754096),
];

/// Integral of `f` from `a` to `b` by a symmetric rule.
#[inline]
pub(super) fn gauss<const N: usize>(rule: &[(f64, f64); N], a: f64, b: f64, f: impl Fn(f64) -> f64) -> f64 {
    let (mid, half) = (0.5 * (a + b), 0.5 * (b - a));
    let mut sum = 0.0;
    for (x, weight) in rule {
        sum += weight * (f(mid - half * x) + f(mid + half * x));
    }
    sum * half
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rules_are_exact_to_their_degree() {
        for k in [0, 2, 8, 14] {
            let exact = 1.0 / (f64::from(k) + 1.0);
            assert!((gauss(&GAUSS_8, 0.0, 1.0, |t| libm::pow(t, f64::from(k))) - exact).abs() < 2e-16);
        }
        for k in [0, 2, 17, 30] {
            let exact = 1.0 / (f64::from(k) + 1.0);
            assert!((gauss(&GAUSS_16, 0.0, 1.0, |t| libm::pow(t, f64::from(k))) - exact).abs() < 4e-16);
        }
    }

    #[test]
    fn roots_of_known_products() {
        // (t - 0.25)(t - 0.5)(t - 2)
        let roots = cubic_roots_inside([-0.25, 1.625, -2.75, 1.0]);
        assert_eq!(roots.len(), 2);
        assert!((roots[0] - 0.25).abs() < 1e-15 && (roots[1] - 0.5).abs() < 1e-15);
        assert_eq!(cubic_roots_inside([0.0; 4]), Vec::<f64>::new());
        assert_eq!(cubic_roots_inside([-0.5, 1.0, 0.0, 0.0]), vec![0.5]);
        // 1e-20 - t + t^2: the small root keeps its digits
        let [small, large] = quadratic_roots([1e-20, -1.0, 1.0]).map(Option::unwrap_or_default);
        assert!((small - 1e-20).abs() < 1e-35 && large == 1.0);
        assert_eq!(quadratic_roots([1.0, 0.0, 1.0]), [None, None]);
        assert_eq!(quadratic_roots([1.0, 0.0, 0.0]), [None, None]);
    }
}
