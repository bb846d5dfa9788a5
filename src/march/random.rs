//! Random numbers that depend on what they are for alone.

/// The weyl sequence's step: 2^64 over the golden ratio.
const STEP: u64 = 0x9E37_79B9_7F4A_7C15;

/// The numbers of one path, by their count: the counter-based generator of Steele, Lea and Flood ("Fast splittable
/// pseudorandom number generators", 2014), keyed by what the path is.
#[derive(Debug, Clone, Copy)]
pub(super) struct Random {
    key: u64,
    count: u64,
}

impl Random {
    /// Of a sample of a pixel.
    pub(super) fn new(seed: u64, pixel: u64, sample: u64) -> Random {
        let key = mix(mix(mix(seed ^ STEP).wrapping_add(pixel)).wrapping_add(sample));
        Random { key, count: 0 }
    }

    /// In [0, 1).
    pub(super) fn next(&mut self) -> f64 {
        self.count += 1;
        let bits = mix(self.key.wrapping_add(self.count.wrapping_mul(STEP)));
        #[allow(clippy::cast_precision_loss, reason = "53 bits")]
        let number = (bits >> 11) as f64;
        number * (1.0 / 9_007_199_254_740_992.0)
    }

    /// Of the exponential distribution with the mean 1.
    pub(super) fn exponential(&mut self) -> f64 {
        -libm::log1p(-self.next())
    }
}

fn mix(x: u64) -> u64 {
    let x = (x ^ (x >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    let x = (x ^ (x >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    x ^ (x >> 31)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Means, and the correlation of neighbours in every dimension, within four standard errors.
    #[test]
    fn numbers_are_even_and_strangers() {
        let n = 20_000;
        let (mut sum, mut square, mut log) = (0.0, 0.0, 0.0);
        let mut products = [0.0; 3];
        for i in 0..n {
            let mut random = Random::new(1, i, 5);
            let x = random.next() - 0.5;
            let others = [random.next(), Random::new(1, i + 1, 5).next(), Random::new(1, i, 6).next()];
            for (product, other) in products.iter_mut().zip(others) {
                *product += x * (other - 0.5);
            }
            (sum, square, log) = (sum + x, square + x * x, log + random.exponential());
        }
        #[allow(clippy::cast_precision_loss, reason = "small")]
        let n = n as f64;
        assert!((sum / n).abs() < 4.0 / (12.0 * n).sqrt());
        assert!((square / n - 1.0 / 12.0).abs() < 4.0 / (180.0 * n).sqrt());
        assert!((log / n - 1.0).abs() < 4.0 / n.sqrt());
        for product in products {
            assert!((product / n).abs() < 4.0 / (12.0 * n.sqrt()), "{product}");
        }
    }
}
