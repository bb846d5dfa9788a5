//! Real roots of polynomials between 0 and 1 by bisection alone.

/// The points inside (0, 1) where the polynomial `sum c[k] x^k` changes sign, in ascending order.
///
/// Between two neighbouring roots of its derivative a polynomial is monotone, so bisection there finds its
/// one root or none: the derivatives are solved from the lowest degree up. Roots closer together than
/// rounding can tell may be missed in pairs.
pub(super) fn sign_changes(c: &[f64]) -> Vec<f64> {
    let Some(degree) = c.iter().rposition(|&c| c != 0.0) else {
        return Vec::new();
    };
    if degree == 0 {
        return Vec::new();
    }
    let slope: Vec<f64> = c[1..=degree].iter().zip(1..).map(|(c, k)| c * f64::from(k)).collect();
    let value = |x: f64| c[..=degree].iter().rev().fold(0.0, |sum, c| sum * x + c);
    let mut ends = sign_changes(&slope);
    ends.push(1.0);
    let mut roots = Vec::new();
    let (mut left, mut before) = (0.0, value(0.0));
    for right in ends {
        let after = value(right);
        if after == 0.0 {
            continue;
        }
        if before != 0.0 && (before < 0.0) != (after < 0.0) {
            roots.push(bisect(left, right, |x| if after > 0.0 { value(x) } else { -value(x) }));
        }
        (left, before) = (right, after);
    }
    roots
}

/// A point between `a` and `b`, both in [0, 1], where `f` goes from negative at `a` to not negative at `b`.
///
/// Within 1e-17, or to the last bit of the root where that is coarser.
pub(super) fn bisect(mut a: f64, mut b: f64, f: impl Fn(f64) -> f64) -> f64 {
    while b - a > 1e-17 {
        let middle = 0.5 * (a + b);
        if middle <= a || middle >= b {
            break;
        }
        if f(middle) < 0.0 {
            a = middle;
        } else {
            b = middle;
        }
    }
    b
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn finds_the_roots_a_polynomial_was_made_of() {
        let wanted = [0.05, 0.3, 0.5, 0.501, 0.9];
        let mut c = vec![1.0];
        for root in wanted {
            let mut product = vec![0.0; c.len() + 1];
            for (k, c) in c.iter().enumerate() {
                product[k + 1] += c;
                product[k] -= c * root;
            }
            c = product;
        }
        let found = sign_changes(&c);
        assert_eq!(found.len(), wanted.len(), "{found:?}");
        for (found, wanted) in found.iter().zip(wanted) {
            // Coefficients near 1 round by 1e-16; the slope at the close pair is 2e-5.
            assert!((found - wanted).abs() < 1e-10, "{found} against {wanted}");
        }
    }

    #[test]
    fn leaves_out_roots_without_a_sign_change_and_at_the_ends() {
        assert!(sign_changes(&[0.25, -1.0, 1.0]).is_empty());
        assert!(sign_changes(&[0.0, 1.0]).is_empty());
        assert!(sign_changes(&[-1.0, 1.0]).is_empty());
        assert!(sign_changes(&[0.0, 0.0]).is_empty());
        assert_eq!(sign_changes(&[-0.5, 1.0, 0.0]), [0.5]);
    }
}
