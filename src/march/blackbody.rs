//! The colour of what glows.

use glam::DVec3;

/// hc/k in nanometre kelvin, exact by the definition of the SI.
const SECOND_RADIATION: f64 = 1.438_776_877e7;
/// Visible wavelengths in nanometres: first, last, step. Steps of half the size change no colour by 1e-6.
const WAVELENGTHS: [u32; 3] = [360, 830, 1];
/// Peaks of the CIE 1931 colour matching functions x, y and z: height, middle, and widths below and above it in nanometres.
/// The multi-lobe fit of Wyman, Sloan and Shirley, "Simple analytic approximations to the CIE XYZ color matching
/// functions", JCGT 2(2), 2013.
const LOBES: [&[[f64; 4]]; 3] = [
    &[[1.056, 599.8, 37.9, 31.0], [0.362, 442.0, 16.0, 26.7], [-0.065, 501.1, 20.4, 26.2]],
    &[[0.821, 568.8, 46.9, 40.5], [0.286, 530.9, 16.3, 31.1]],
    &[[1.217, 437.0, 11.8, 36.0], [0.681, 459.0, 26.0, 13.8]],
];
/// Rows: linear sRGB from CIE XYZ (IEC 61966-2-1).
const FROM_XYZ: [DVec3; 3] = [
    DVec3::new(3.240_454_2, -1.537_138_5, -0.498_531_4),
    DVec3::new(-0.969_266_0, 1.876_010_8, 0.041_556_0),
    DVec3::new(0.055_643_4, -0.204_025_9, 1.057_225_2),
];
/// Luminance of linear sRGB.
const LUMINANCE: DVec3 = DVec3::new(0.212_672_9, 0.715_152_2, 0.072_175_0);

/// Linear sRGB of a black body at `kelvin`, 500 to 1e5, scaled to luminance 1. Colours outside of what sRGB can show
/// (below about 1900 K) have their negative parts set to 0.
///
/// By Planck's law and an analytic fit of the CIE 1931 colour matching functions, whose chromaticities of black bodies are
/// within 0.005 of those of the tables.
pub fn black_body(kelvin: f64) -> [f64; 3] {
    let [first, last, step] = WAVELENGTHS;
    let mut xyz = DVec3::ZERO;
    let mut nanometres = first;
    while nanometres <= last {
        let wavelength = f64::from(nanometres);
        let radiance =
            libm::pow(500.0 / wavelength, 5.0) / libm::expm1(SECOND_RADIATION / (wavelength * kelvin));
        xyz += radiance * DVec3::from(LOBES.map(|lobes| sum(lobes, wavelength)));
        nanometres += step;
    }
    // At 500 K and below next to nothing of it is visible.
    let rgb = DVec3::from(FROM_XYZ.map(|row| row.dot(xyz / xyz.y)));
    let shown = rgb.max(DVec3::ZERO);
    (shown / shown.dot(LUMINANCE)).to_array()
}

fn sum(lobes: &[[f64; 4]], wavelength: f64) -> f64 {
    let lobe = |[height, middle, below, above]: &[f64; 4]| {
        let t = (wavelength - middle) / if wavelength < *middle { below } else { above };
        height * libm::exp(-0.5 * t * t)
    };
    lobes.iter().map(lobe).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// CIE 1931 chromaticities of black bodies: x and y (Wyszecki and Stiles, Color Science, table 1(3.3.4) and the points of
    /// CIE 15; four digits).
    const LOCUS: [(f64, [f64; 2]); 5] = [
        (2000.0, [0.5267, 0.4133]),
        (2856.0, [0.4476, 0.4074]),
        (4000.0, [0.3805, 0.3768]),
        (6500.0, [0.3135, 0.3237]),
        (10000.0, [0.2807, 0.2884]),
    ];

    #[test]
    fn colours_lie_on_the_planckian_locus() {
        for (kelvin, [x, y]) in LOCUS {
            let rgb = DVec3::from(black_body(kelvin));
            // XYZ from linear sRGB, the inverse of the other.
            let to = glam::DMat3::from_cols(FROM_XYZ[0], FROM_XYZ[1], FROM_XYZ[2]).transpose().inverse();
            let xyz = to * rgb;
            let sum = xyz.element_sum();
            // What the fit is off by.
            assert!(
                (xyz.x / sum - x).abs() < 0.005 && (xyz.y / sum - y).abs() < 0.005,
                "{kelvin}: {}",
                xyz / sum
            );
        }
    }

    #[test]
    fn all_have_luminance_1_and_heat_makes_them_bluer() {
        let mut last = -1.0;
        for step in 0..=100 {
            let kelvin = 500.0 * libm::pow(200.0, f64::from(step) / 100.0);
            let rgb = DVec3::from(black_body(kelvin));
            assert!(rgb.is_finite() && rgb.min_element() >= 0.0);
            assert!((rgb.dot(LUMINANCE) - 1.0).abs() < 1e-12);
            assert!(rgb.z / rgb.x >= last, "{kelvin}");
            last = rgb.z / rgb.x;
        }
    }
}
