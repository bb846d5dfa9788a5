//! Colour spaces.

use glam::{DMat3, DVec3};

/// A linear value of an sRGB code in [0, 1] (IEC 61966-2-1).
pub fn from_srgb(code: f64) -> f64 {
    if code <= 0.04045 { code / 12.92 } else { libm::pow((code + 0.055) / 1.055, 2.4) }
}

/// What a screen shows of a linear value: times 2^exposure, cut to [0, 1]. What is not a number is black.
pub fn tone_map(value: f64, exposure: f64) -> f64 {
    let exposed = value * libm::exp2(exposure);
    if exposed.is_nan() { 0.0 } else { exposed.clamp(0.0, 1.0) }
}

/// Linear sRGB to CIE XYZ, by columns: the primaries of Rec. 709, scaled so that (1, 1, 1) is the white D65.
fn to_xyz() -> DMat3 {
    let of = |x: f64, y: f64| DVec3::new(x / y, 1.0, (1.0 - x - y) / y);
    let primaries = DMat3::from_cols(of(0.64, 0.33), of(0.30, 0.60), of(0.15, 0.06));
    let scale = primaries.inverse() * of(0.3127, 0.3290);
    primaries * DMat3::from_diagonal(scale)
}

/// Between linear sRGB and spaces in which distances mean something to an observer.
#[derive(Debug, Clone, Copy)]
pub(super) struct Observer {
    to_xyz: DMat3,
    from_xyz: DMat3,
    white: DVec3,
}

impl Observer {
    pub(super) fn new() -> Observer {
        let to_xyz = to_xyz();
        Observer { to_xyz, from_xyz: to_xyz.inverse(), white: to_xyz * DVec3::ONE }
    }

    /// Linear sRGB to YCxCz, a linear opponent space: lightness, red to green, blue to yellow.
    pub(super) fn opponent(&self, rgb: DVec3) -> DVec3 {
        let v = self.to_xyz * rgb / self.white;
        DVec3::new(116.0 * v.y - 16.0, 500.0 * (v.x - v.y), 200.0 * (v.y - v.z))
    }

    /// And back.
    pub(super) fn rgb_of(&self, opponent: DVec3) -> DVec3 {
        let y = (opponent.x + 16.0) / 116.0;
        let v = DVec3::new(y + opponent.y / 500.0, y, y - opponent.z / 200.0);
        self.from_xyz * (v * self.white)
    }

    /// Linear sRGB to CIE 1976 L*a*b*.
    pub(super) fn lab(&self, rgb: DVec3) -> DVec3 {
        const DELTA: f64 = 6.0 / 29.0;
        let f = |t: f64| {
            if t > DELTA * DELTA * DELTA { libm::cbrt(t) } else { t / (3.0 * DELTA * DELTA) + 4.0 / 29.0 }
        };
        let v = self.to_xyz * rgb / self.white;
        let [x, y, z] = [v.x, v.y, v.z].map(f);
        DVec3::new(116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colours_are_where_the_standards_have_them() {
        // L*a*b* of the primaries, as tables of sRGB have it to two digits.
        let observer = Observer::new();
        for (rgb, lab) in [
            (DVec3::X, [53.24, 80.09, 67.20]),
            (DVec3::Y, [87.73, -86.18, 83.18]),
            (DVec3::Z, [32.30, 79.19, -107.86]),
            (DVec3::ONE, [100.0, 0.0, 0.0]),
            (DVec3::ZERO, [0.0, 0.0, 0.0]),
        ] {
            assert!(observer.lab(rgb).distance(lab.into()) < 0.03, "{rgb} {}", observer.lab(rgb));
        }
        let rgb = DVec3::new(0.2, 0.7, 0.1);
        assert!(observer.rgb_of(observer.opponent(rgb)).distance(rgb) < 1e-14);
        assert!((observer.opponent(DVec3::ONE) - DVec3::new(100.0, 0.0, 0.0)).length() < 1e-12);
    }

    #[test]
    fn codes_and_tones() {
        assert_eq!((from_srgb(0.0), from_srgb(1.0)), (0.0, 1.0));
        // Half the code is 21.4 % of the light.
        assert!((from_srgb(0.5) - 0.21404).abs() < 1e-5);
        assert!((from_srgb(0.040_45) - from_srgb(0.040_450_1)).abs() < 1e-7);
        assert_eq!((tone_map(0.5, 1.0), tone_map(3.0, -1.0), tone_map(-1.0, 0.0)), (1.0, 1.0, 0.0));
        assert_eq!((tone_map(f64::NAN, 0.0), tone_map(f64::INFINITY, 0.0)), (0.0, 1.0));
    }
}
