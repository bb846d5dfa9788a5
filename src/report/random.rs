//! Numbers that look random and depend on nothing but what they are counted by.

/// 64 bits for a place in a stream: the finaliser of splitmix64 (Steele, Lea and Flood, "Fast splittable pseudorandom number
/// generators", 2014), applied to the stream and, with the counter, once more.
pub(crate) fn bits(stream: u64, counter: u64) -> u64 {
    const STEP: u64 = 0x9E37_79B9_7F4A_7C15;
    mix(mix(stream.wrapping_add(STEP)).wrapping_add(counter.wrapping_mul(STEP)))
}

/// A number in [0, 1), a multiple of 2^-53.
pub(crate) fn unit(stream: u64, counter: u64) -> f64 {
    #[allow(clippy::cast_precision_loss, reason = "53 bits")]
    let high = (bits(stream, counter) >> 11) as f64;
    high / 9_007_199_254_740_992.0
}

/// A number below `count`, which is small beside 2^64.
pub(crate) fn below(stream: u64, counter: u64, count: usize) -> usize {
    let scaled = (u128::from(bits(stream, counter)) * count as u128) >> 64;
    usize::try_from(scaled).unwrap_or(0)
}

fn mix(mut z: u64) -> u64 {
    z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    z ^ (z >> 31)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_even_and_streams_unlike() {
        const COUNT: u32 = 100_000;
        let mut bins = [0_u32; 10];
        let (mut sum, mut product) = (0.0, 0.0);
        for i in 0..COUNT {
            let [x, y] = [3, 4].map(|stream| unit(stream, i.into()));
            bins[below(3, i.into(), 10)] += 1;
            sum += x - 0.5;
            product += (x - 0.5) * (y - 0.5);
        }
        // Five standard deviations: of a mean of uniform numbers, of a product of two, of a bin's count.
        let root = f64::from(COUNT).sqrt();
        assert!(sum.abs() < 5.0 * 0.289 * root && product.abs() < 5.0 * 0.0834 * root, "{sum} {product}");
        assert!(bins.iter().all(|bin| bin.abs_diff(10_000) < 5 * 95), "{bins:?}");
    }
}
