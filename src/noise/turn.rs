//! Rotations of the octaves' lattices.

use super::fractal::scramble;

/// Squared length of the quaternions that are taken: evenly spread directions need a ball, and short ones are coarse.
const LENGTHS: std::ops::RangeInclusive<i64> = 128 * 128..=255 * 255;

/// The matrix, row by row, that turns octave `k`; orthogonal to rounding, with no entry above 0.9 in magnitude.
pub fn turn(k: u32) -> [[f64; 3]; 3] {
    first(k, |q| q, 3)
}

/// The same about the third axis alone.
pub fn turn_around(k: u32) -> [[f64; 3]; 3] {
    first(k, |[w, _, _, z]| [w, 0, 0, z], 2)
}

/// The first rotation by a quaternion, made of the octave's by `part`, that turns the first `axes` axes far enough.
fn first(k: u32, part: fn([i64; 4]) -> [i64; 4], axes: usize) -> [[f64; 3]; 3] {
    let mut number = 256_u32.wrapping_mul(k).wrapping_add(0x51ED_270B);
    loop {
        let [w, x, y, z] = part(scramble(number).to_le_bytes().map(|byte| 2 * i64::from(byte) - 255));
        number = number.wrapping_add(1);
        let length = w * w + x * x + y * y + z * z;
        let matrix = [
            [w * w + x * x - y * y - z * z, 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), w * w - x * x + y * y - z * z, 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z],
        ];
        let is_far = matrix[..axes].iter().all(|row| row[..axes].iter().all(|m| 10 * m.abs() <= 9 * length));
        if LENGTHS.contains(&length) && is_far {
            #[allow(clippy::cast_precision_loss, reason = "below 2^18")]
            return matrix.map(|row| row.map(|m| m as f64 / length as f64));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn turns_are_rotations_away_from_the_axes() {
        for k in 0..32 {
            for (m, axes) in [(turn(k), 3), (turn_around(k), 2)] {
                for i in 0..3 {
                    for j in 0..3 {
                        let dot: f64 = (0..3).map(|n| m[i][n] * m[j][n]).sum();
                        // Each entry is rounded once: three products of two.
                        assert!((dot - f64::from(u8::from(i == j))).abs() < 4e-16, "octave {k}: {m:?}");
                        assert!(i >= axes || j >= axes || m[i][j].abs() <= 0.9);
                    }
                }
                let [a, b, c] = m.map(glam::DVec3::from);
                assert!((a.cross(b).dot(c) - 1.0).abs() < 1e-15, "no reflection");
                assert!(axes == 3 || (m[2] == [0.0, 0.0, 1.0] && m[0][2] == 0.0 && m[1][2] == 0.0));
            }
        }
    }

    /// Neighbouring octaves have cells of most alike size: their lattices must not line up either.
    #[test]
    fn turns_differ_from_octave_to_octave() {
        for k in 0..31 {
            for other in k + 1..32 {
                let (a, b) = (turn(k), turn(other));
                assert!(a != b, "octaves {k} and {other}");
            }
        }
    }
}
