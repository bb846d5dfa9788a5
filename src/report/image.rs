//! Two images beside each other.

use serde::Serialize;

use super::blocks::{ImageIntervals, intervals};
use super::colour::{from_srgb, tone_map};
use super::errors::Errors;
use super::flip::flip;

/// What keeps relMSE finite where the first image is black.
const DARK: f64 = 0.01;

/// An image: channels of numbers in rows from the top.
#[derive(Debug, Clone, PartialEq)]
pub struct Picture {
    /// Pixels from left to right, and from top to bottom.
    pub size: [usize; 2],
    /// Channels with their names, each with a number for every pixel.
    pub channels: Vec<(String, Vec<f32>)>,
    /// Whether numbers are codes of sRGB in [0, 1], and not linear.
    pub srgb: bool,
}

impl Picture {
    fn channel(&self, name: &str) -> Option<&[f32]> {
        self.channels.iter().find(|channel| channel.0 == name).map(|channel| &*channel.1)
    }
}

/// How image b differs from image a.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ImageDifference {
    /// Pixels from left to right, and from top to bottom.
    pub pixels: [usize; 2],
    /// Over all channels that both have.
    pub all: ChannelDifference,
    /// Each of them.
    pub channels: Vec<ChannelDifference>,
    /// Channels that only a has, and that only b has.
    pub only: [Vec<String>; 2],
    /// As an observer sees it; null where there is no colour or luminance.
    pub flip: Option<Flip>,
    /// Bootstrap intervals of 95 % of the figures over all channels, and of FLIP's mean; null for a single pixel.
    pub intervals: Option<ImageIntervals>,
}

/// How a channel differs.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ChannelDifference {
    /// Its name.
    pub name: String,
    /// The values' differences; the peak of codes of sRGB is 1.
    #[serde(flatten)]
    pub errors: Errors,
    /// Mean of `(b - a)^2 / (a^2 + 0.01)`.
    pub rel_mse: f64,
}

/// What FLIP gives.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Flip {
    /// Mean over all pixels.
    pub mean: f64,
    /// Largest.
    pub max: f64,
    /// The channels that were looked at.
    pub channels: Vec<String>,
    /// Pixels for each degree of the field of view.
    pub pixels_per_degree: f64,
    /// Stops by which linear values were brightened.
    pub exposure: f64,
    /// Pixels of a, and of b, of which a channel was brighter than white and cut.
    pub beyond_white: [u64; 2],
    /// For each pixel, in rows.
    #[serde(skip)]
    pub map: Vec<f32>,
}

/// Compares the channels of equal names of two images of one size; `None` where the sizes differ, or there are no such channels.
///
/// FLIP takes red, green and blue (of the first layer that has them, where names have the form `layer.R`), else `Y`, brightens
/// linear values by `exposure` stops and cuts them to [0, 1]. Of other layers (`depth.Z`, `transmittance.Y`) it says nothing.
pub fn compare_images(
    a: &Picture,
    b: &Picture,
    exposure: f64,
    pixels_per_degree: f64,
) -> Option<ImageDifference> {
    let mut shared = Vec::new();
    let mut only = [Vec::new(), Vec::new()];
    for (name, values) in &a.channels {
        match b.channel(name) {
            Some(other) => shared.push((name, values.as_slice(), other)),
            None => only[0].push(name.clone()),
        }
    }
    only[1].extend(b.channels.iter().map(|(name, _)| name).filter(|name| a.channel(name).is_none()).cloned());
    if shared.is_empty() || a.size != b.size || a.srgb != b.srgb {
        return None;
    }
    let peak = a.srgb.then_some(1.0);
    let channels: Vec<ChannelDifference> =
        shared.iter().map(|(name, a, b)| difference((*name).clone(), || pairs(a, b), peak)).collect();
    let all = match &channels[..] {
        [only] => ChannelDifference { name: "all".to_owned(), ..only.clone() },
        _ => difference("all".to_owned(), || shared.iter().flat_map(|(_, a, b)| pairs(a, b)), peak),
    };
    let names: Vec<&str> = shared.iter().map(|(name, ..)| name.as_str()).collect();
    let flip = colours(&names).map(|names| seen(a, b, &names, exposure, pixels_per_degree));
    let values: Vec<(&[f32], &[f32])> = shared.iter().map(|(_, a, b)| (*a, *b)).collect();
    let intervals = intervals(a.size, &values, all.errors.peak, flip.as_ref().map(|flip| &*flip.map));
    Some(ImageDifference { pixels: a.size, all, channels, only, flip, intervals })
}

/// Without those that are infinite alike, as the depth is where there is nothing: they do not differ.
fn pairs<'a>(a: &'a [f32], b: &'a [f32]) -> impl Iterator<Item = (f64, f64)> + 'a {
    let alike = |a: f32, b: f32| a.is_infinite() && a.to_bits() == b.to_bits();
    a.iter().zip(b).filter(move |(a, b)| !alike(**a, **b)).map(|(a, b)| (f64::from(*a), f64::from(*b)))
}

fn difference<I: Iterator<Item = (f64, f64)>>(
    name: String,
    pairs: impl Fn() -> I,
    peak: Option<f64>,
) -> ChannelDifference {
    let (mut sum, mut count) = (0.0, 0.0_f64);
    for (a, b) in pairs().filter(|(a, b)| a.is_finite() && b.is_finite()) {
        sum += (b - a) * (b - a) / (a * a + DARK);
        count += 1.0;
    }
    ChannelDifference { name, errors: Errors::new(pairs(), peak), rel_mse: sum / count.max(1.0) }
}

/// The names of the channels that show colours: three, or one of luminance.
fn colours(names: &[&str]) -> Option<Vec<String>> {
    let layer = |name: &str| name.strip_suffix('R').map(str::to_owned);
    let has = |name: &str| names.contains(&name);
    let is_whole = |layer: &String| layer.is_empty() || layer.ends_with('.');
    let mut layers: Vec<String> = names.iter().filter_map(|name| layer(name)).filter(is_whole).collect();
    // The one without a name comes first.
    layers.sort_by_key(|layer| !layer.is_empty());
    let of = |layer: &String| ["R", "G", "B"].map(|part| format!("{layer}{part}")).to_vec();
    let coloured = layers.iter().map(of).find(|channels| channels.iter().all(|name| has(name)));
    // Not the part of a vector.
    let luminous = has("Y") && !has("X") && !has("Z");
    coloured.or_else(|| luminous.then(|| vec!["Y".to_owned()]))
}

/// By FLIP.
fn seen(a: &Picture, b: &Picture, names: &[String], exposure: f64, pixels_per_degree: f64) -> Flip {
    let [(a_shown, a_beyond), (b_shown, b_beyond)] = [a, b].map(|image| shown(image, names, exposure));
    let map = flip(a.size[0], &a_shown, &b_shown, pixels_per_degree);
    #[allow(clippy::cast_precision_loss, reason = "a mean")]
    let count = map.len().max(1) as f64;
    Flip {
        mean: map.iter().map(|value| f64::from(*value)).sum::<f64>() / count,
        max: f64::from(map.iter().fold(0.0_f32, |max, value| max.max(*value))),
        channels: names.to_vec(),
        pixels_per_degree,
        exposure,
        beyond_white: [a_beyond, b_beyond],
        map,
    }
}

/// Linear colours in [0, 1], and how many pixels were cut to it from above.
fn shown(image: &Picture, names: &[String], exposure: f64) -> (Vec<[f32; 3]>, u64) {
    let channels: Vec<&[f32]> = names.iter().filter_map(|name| image.channel(name)).collect();
    let mut beyond = 0;
    let count = channels.iter().map(|channel| channel.len()).min().unwrap_or(0);
    let pixel = |at: usize| {
        let mut cut = false;
        let colour = [0, 1, 2].map(|part| {
            let value = channels.get(part).or(channels.first()).map_or(0.0, |channel| f64::from(channel[at]));
            let linear = if image.srgb { from_srgb(value) } else { value };
            let exposure = if image.srgb { 0.0 } else { exposure };
            cut |= linear * libm::exp2(exposure) > 1.0;
            #[allow(clippy::cast_possible_truncation, reason = "from 0 to 1")]
            let shown = tone_map(linear, exposure) as f32;
            shown
        });
        beyond += u64::from(cut);
        colour
    };
    let shown = (0..count).map(pixel).collect();
    (shown, beyond)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn picture(channels: &[(&str, &[f32])], srgb: bool) -> Picture {
        let channels = channels.iter().map(|(name, values)| ((*name).to_owned(), values.to_vec())).collect();
        Picture { size: [2, 2], channels, srgb }
    }

    #[test]
    fn known_differences_have_their_figures() {
        let a = picture(&[("R", &[0.0, 1.0, 2.0, 4.0]), ("Z", &[1.0; 4]), ("A", &[1.0; 4])], false);
        let b = picture(&[("R", &[0.1, 1.0, 2.0, 3.0]), ("Z", &[1.0; 4]), ("N", &[0.0; 4])], false);
        let found = compare_images(&a, &b, 0.0, 67.0).expect("of one size");
        assert_eq!(found.only, [vec!["A".to_owned()], vec!["N".to_owned()]]);
        let red = &found.channels[0];
        // 0.1 is not exact in single precision.
        assert!((red.errors.l1.absolute - 1.1 / 4.0).abs() < 1e-8);
        assert!((red.errors.l2.absolute - (1.01_f64 / 4.0).sqrt()).abs() < 1e-8);
        assert!((red.errors.bias.absolute + 0.9 / 4.0).abs() < 1e-8);
        assert!((red.rel_mse - (0.01 / 0.01 + 1.0 / 16.01) / 4.0).abs() < 1e-6);
        assert_eq!((red.errors.peak, red.errors.max.absolute), (4.0, 1.0));
        assert!((found.all.errors.l1.absolute - 1.1 / 8.0).abs() < 1e-8);
        // Neither a colour nor the only channel.
        assert_eq!(found.flip, None);
        assert_eq!(compare_images(&a, &Picture { size: [4, 1], ..b }, 0.0, 67.0), None);
    }

    #[test]
    fn colours_are_looked_at_by_layer() {
        let of = |names: &[&str]| colours(names).map(|names| names.join(" "));
        assert_eq!(of(&["A", "B", "G", "R"]).as_deref(), Some("R G B"));
        assert_eq!(of(&["z.B", "z.G", "z.R", "B", "G", "R"]).as_deref(), Some("R G B"));
        assert_eq!(of(&["a.Z", "z.B", "z.G", "z.R"]).as_deref(), Some("z.R z.G z.B"));
        assert_eq!(of(&["A", "Y"]).as_deref(), Some("Y"));
        assert_eq!((of(&["N", "Z"]), of(&["BAR", "BAG", "BAB"])), (None, None));
        // Distances, vectors and depths are no colours.
        assert_eq!(
            (of(&["Z"]), of(&["depth.Z"]), of(&["normal.X", "normal.Y", "normal.Z"])),
            (None, None, None)
        );
        assert_eq!((of(&["X", "Y", "Z"]), of(&["opticalDepth.Y"])), (None, None));
    }

    #[test]
    fn codes_are_not_exposed_and_bright_values_are_counted() {
        let bright = picture(&[("Y", &[0.0, 0.5, 1.5, 8.0])], false);
        let flip = compare_images(&bright, &bright, 0.0, 67.0).and_then(|found| found.flip).expect("grey");
        assert_eq!((flip.mean, flip.beyond_white), (0.0, [2, 2]));
        let flip = compare_images(&bright, &bright, -3.0, 67.0).and_then(|found| found.flip).expect("grey");
        assert_eq!(flip.beyond_white, [0, 0]);
        let codes = picture(&[("Y", &[0.0, 0.5, 0.9, 1.0])], true);
        let found = compare_images(&codes, &codes, 9.0, 67.0).expect("of one size");
        assert_eq!((found.all.errors.peak, found.flip.expect("grey").beyond_white), (1.0, [0, 0]));
    }
}
