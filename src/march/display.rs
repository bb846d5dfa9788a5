//! From radiance to what a screen shows.

use glam::DVec3;

use super::picture::Film;

/// Luminance of linear red, green and blue with the primaries of sRGB (ITU-R BT.709).
pub(super) const LUMINANCE: DVec3 = DVec3::new(0.2126, 0.7152, 0.0722);
/// Up to here the picture is shown as it is; from here on towards 1, which it never passes.
const SHOULDER: f64 = 0.7;
/// Where nobody chooses the exposure, this part of what is to be seen is darker than `BRIGHT` then.
const PART: f64 = 0.99;
const BRIGHT: f64 = 0.7;
/// What lets more light through than this is not looked at for that.
const CLEAR: f64 = 0.98;

/// A picture with its background.
#[derive(Debug, Clone, PartialEq)]
pub struct Developed {
    /// Pixels from left to right and from top to bottom.
    pub size: [usize; 2],
    /// Linear red, green and blue, in rows from the top; where the background is transparent, as seen before black.
    pub colour: Vec<DVec3>,
    /// 1 where nothing is seen through the picture.
    pub alpha: Vec<f64>,
}

impl Film {
    /// The mean of the samples before a background, or before nothing.
    pub fn develop(&self, background: Option<DVec3>) -> Developed {
        let samples = f64::from(self.samples.max(1));
        let mean = |pixel: usize| {
            let through = self.transmittance[pixel] / samples;
            let radiance = DVec3::from(self.radiance[pixel]) / samples;
            match background {
                Some(background) => (radiance + background * through, 1.0),
                None => (radiance, 1.0 - through),
            }
        };
        let (colour, alpha) = (0..self.radiance.len()).map(mean).unzip();
        Developed { size: self.size, colour, alpha }
    }

    /// Stops by which the medium, where there is any, is brightened to be well seen.
    pub fn exposure(&self) -> f64 {
        let samples = f64::from(self.samples.max(1));
        let mut seen: Vec<f64> = (0..self.radiance.len())
            .filter(|pixel| self.transmittance[*pixel] / samples < CLEAR)
            .map(|pixel| {
                // As if it were opaque: what is thin is not brightened for that.
                let opacity = 1.0 - self.transmittance[pixel] / samples;
                DVec3::from(self.radiance[pixel]).dot(LUMINANCE) / samples / opacity
            })
            .collect();
        if seen.is_empty() {
            return 0.0;
        }
        #[allow(
            clippy::cast_precision_loss,
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "at least 0"
        )]
        let at = ((seen.len() - 1) as f64 * PART) as usize;
        let (_, bright, _) = seen.select_nth_unstable_by(at, f64::total_cmp);
        if *bright > 0.0 { libm::log2(BRIGHT / *bright).clamp(-64.0, 64.0) } else { 0.0 }
    }
}

impl Developed {
    /// Red, green, blue (sRGB) and alpha, not multiplied with each other, of eight bits: exposed by so many stops, and what is
    /// bright compressed.
    pub fn show(&self, exposure: f64) -> Vec<[u8; 4]> {
        let factor = libm::exp2(exposure);
        let shown = |(colour, alpha): (&DVec3, &f64)| {
            let own = if *alpha > 0.0 { *colour / *alpha } else { DVec3::ZERO };
            let [red, green, blue] = (own * factor).to_array().map(|light| byte(encode(compress(light))));
            [red, green, blue, byte(*alpha)]
        };
        self.colour.iter().zip(&self.alpha).map(shown).collect()
    }
}

/// Towards 1 beyond the shoulder, with the same slope there.
fn compress(light: f64) -> f64 {
    if light > SHOULDER {
        let room = 1.0 - SHOULDER;
        1.0 - room * libm::exp(-(light - SHOULDER) / room)
    } else {
        light
    }
}

/// The transfer function of sRGB (IEC 61966-2-1).
fn encode(light: f64) -> f64 {
    if light <= 0.003_130_8 { 12.92 * light } else { 1.055 * libm::pow(light, 1.0 / 2.4) - 0.055 }
}

fn byte(part: f64) -> u8 {
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "saturating")]
    let byte = (part * 255.0).round() as u8;
    byte
}
