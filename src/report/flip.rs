//! FLIP: how an observer sees the difference of two images when they alternate in one place.
//!
//! Andersson, Nilsson, Akenine-Moller, Oskarsson, Astrom and Fairchild, "FLIP: A Difference Evaluator for Alternating Images",
//! Proc. ACM Comput. Graph. Interact. Tech. 3(2), 2020, for low dynamic range:
//!
//! - Colours are filtered by the eye's contrast sensitivity in YCxCz, at so many pixels per degree of the field of view, and
//!   compared in L*a*b* with Hunt's effect by the HyAB distance d. With d' = d^0.7, and m that of pure green and blue,
//!   `e_c = 0.95 d' / (0.4 m)` below 0.4 m, and above it linear up to 1 at m.
//! - Edges and points are found by first and second derivatives of Gaussians on Y, and
//!   `e_f = sqrt(max(|edges a - edges b|, |points a - points b|) / sqrt(2))`, of their lengths over both axes.
//! - `FLIP = e_c^(1 - e_f)`, 0 for equal images and 1 at most.
//!
//! Beyond their borders images go on with their outermost pixels.

use std::f64::consts::PI;

use glam::{DVec2, DVec3};
use rayon::prelude::*;

use super::colour::Observer;

/// Pixels per degree of a screen 0.7 m wide, of 3840 pixels, seen from 0.7 m.
pub const PIXELS_PER_DEGREE: f64 = 67.0;

/// Rows that are worked on at once.
const ROWS: usize = 32;

/// A Gaussian of the contrast sensitivity, `a sqrt(pi / b) exp(-(pi x)^2 / b)` at x degrees: a and b.
type Gaussian = [f64; 2];
const Y: Gaussian = [1.0, 0.0047];
const CX: Gaussian = [1.0, 0.0053];
const CZ: [Gaussian; 2] = [[34.1, 0.04], [13.5, 0.025]];
/// Width of the features that are sought, in degrees.
const FEATURE: f64 = 0.082;

/// FLIP of two images of linear sRGB in [0, 1], for each pixel, in rows of `width`, on the current `rayon` pool.
///
/// Works in strips: beside the images and the result only some rows for each thread are held.
pub fn flip(width: usize, a: &[[f32; 3]], b: &[[f32; 3]], pixels_per_degree: f64) -> Vec<f32> {
    let height = a.len().min(b.len()).checked_div(width).unwrap_or(0);
    let eye = Eye::new(pixels_per_degree);
    let mut map = vec![0.0; width * height];
    map.par_chunks_mut((ROWS * width).max(1)).enumerate().for_each(|(strip, out)| {
        let first = strip * ROWS;
        let [a, b] = [a, b].map(|image| eye.look(image, [width, height], [first, out.len() / width]));
        for (out, (a, b)) in out.iter_mut().zip(a.iter().zip(&b)) {
            #[allow(clippy::cast_possible_truncation, reason = "from 0 to 1")]
            let difference = eye.difference(a, b) as f32;
            *out = difference;
        }
    });
    map
}

/// What is seen at a pixel.
struct Seen {
    /// L*a*b* with Hunt's effect, of the filtered colour.
    colour: DVec3,
    edge: f64,
    point: f64,
}

/// The filters for a number of pixels per degree.
struct Eye {
    observer: Observer,
    /// Rows that the widest filter reaches to either side.
    reach: usize,
    y: Vec<f64>,
    cx: Vec<f64>,
    /// Each with its part of the sum.
    cz: [(Vec<f64>, f64); 2],
    smooth: Vec<f64>,
    first: Vec<f64>,
    second: Vec<f64>,
    /// The largest distance of colours, raised.
    largest: f64,
}

impl Eye {
    fn new(pixels_per_degree: f64) -> Eye {
        let observer = Observer::new();
        // Three standard deviations of the widest.
        let sensitive = radius(3.0 * (CZ[0][1] / (2.0 * PI * PI)).sqrt() * pixels_per_degree);
        let sigma = 0.5 * FEATURE * pixels_per_degree;
        let featured = radius(3.0 * sigma);
        let gaussian = |[_, b]: Gaussian| {
            sampled(sensitive, |x| {
                libm::exp(-(PI * x / pixels_per_degree) * (PI * x / pixels_per_degree) / b)
            })
        };
        let [wide, narrow] = CZ.map(|gaussian_of| {
            let filter = gaussian(gaussian_of);
            let sum: f64 = filter.iter().sum();
            let [a, b] = gaussian_of;
            (filter, a * (PI / b).sqrt() * sum * sum)
        });
        let whole = wide.1 + narrow.1;
        let cz = [wide, narrow].map(|(filter, weight)| (normalised(filter), weight / whole));
        let bell = |x: f64| libm::exp(-x * x / (2.0 * sigma * sigma));
        let mut eye = Eye {
            observer,
            reach: sensitive.max(featured),
            y: normalised(gaussian(Y)),
            cx: normalised(gaussian(CX)),
            cz,
            smooth: normalised(sampled(featured, bell)),
            first: normalised(sampled(featured, |x| -x * bell(x))),
            second: normalised(sampled(featured, |x| (x * x / (sigma * sigma) - 1.0) * bell(x))),
            largest: 0.0,
        };
        eye.largest = raised(distance(eye.hunt(DVec3::Y), eye.hunt(DVec3::Z)));
        eye
    }

    /// L*a*b* of a linear colour, with Hunt's effect: colours are fuller where there is more light.
    fn hunt(&self, rgb: DVec3) -> DVec3 {
        let lab = self.observer.lab(rgb);
        DVec3::new(lab.x, 0.01 * lab.x * lab.y, 0.01 * lab.x * lab.z)
    }

    /// What is seen of some rows of an image.
    fn look(&self, image: &[[f32; 3]], [width, height]: [usize; 2], [first, rows]: [usize; 2]) -> Vec<Seen> {
        // With those around them; beyond the image the outermost again.
        let halo = (0..rows + 2 * self.reach)
            .map(|row| (first + row).saturating_sub(self.reach).min(height - 1))
            .flat_map(|row| &image[row * width..][..width]);
        let opponent: Vec<DVec3> =
            halo.map(|pixel| self.observer.opponent(DVec3::from(pixel.map(f64::from)))).collect();
        let plane = |of: &dyn Fn(&DVec3) -> f64| Plane {
            width,
            reach: self.reach,
            values: opponent.iter().map(of).collect(),
        };
        let [y, cx, cz] = [0, 1, 2].map(|part| plane(&move |pixel| pixel[part]));
        let light = plane(&|pixel| (pixel.x + 16.0) / 116.0);
        let [y, cx] = [y.filter(&self.y, &self.y), cx.filter(&self.cx, &self.cx)];
        let cz = self.cz.each_ref().map(|(filter, weight)| (cz.filter(filter, filter), *weight));
        let along = |filter| [light.filter(filter, &self.smooth), light.filter(&self.smooth, filter)];
        let [edges, points] = [along(&self.first), along(&self.second)];
        let length = |[x, y]: &[Vec<f64>; 2], at: usize| DVec2::new(x[at], y[at]).length();
        let seen = |at: usize| {
            let blue = cz.iter().map(|(filtered, weight)| filtered[at] * weight).sum();
            let rgb = self.observer.rgb_of(DVec3::new(y[at], cx[at], blue));
            Seen {
                colour: self.hunt(rgb.clamp(DVec3::ZERO, DVec3::ONE)),
                edge: length(&edges, at),
                point: length(&points, at),
            }
        };
        (0..rows * width).map(seen).collect()
    }

    fn difference(&self, a: &Seen, b: &Seen) -> f64 {
        const KNEE: [f64; 2] = [0.4, 0.95];
        let colour = raised(distance(a.colour, b.colour));
        let knee = KNEE[0] * self.largest;
        let colour = if colour < knee {
            KNEE[1] / knee * colour
        } else {
            KNEE[1] + (colour - knee) / (self.largest - knee) * (1.0 - KNEE[1])
        };
        let feature = (a.edge - b.edge).abs().max((a.point - b.point).abs());
        let feature = (feature / 2.0_f64.sqrt()).sqrt();
        // Neither can be above 1 but by rounding.
        libm::pow(colour.min(1.0), 1.0 - feature.min(1.0))
    }
}

/// HyAB (Abasi, Amani Tehran and Fairchild 2020).
fn distance(a: DVec3, b: DVec3) -> f64 {
    let d = a - b;
    d.x.abs() + DVec2::new(d.y, d.z).length()
}

fn raised(distance: f64) -> f64 {
    libm::pow(distance, 0.7)
}

#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "saturating")]
fn radius(reach: f64) -> usize {
    reach.ceil() as usize
}

/// Weights from `-radius` to `radius`.
fn sampled(radius: usize, weight: impl Fn(f64) -> f64) -> Vec<f64> {
    #[allow(clippy::cast_precision_loss, reason = "small")]
    let at = |n: usize| n as f64 - radius as f64;
    (0..=2 * radius).map(|n| weight(at(n))).collect()
}

/// So that weights above 0 add up to 1, and those below to -1.
fn normalised(mut filter: Vec<f64>) -> Vec<f64> {
    let above: f64 = filter.iter().filter(|weight| **weight > 0.0).sum();
    let below: f64 = filter.iter().filter(|weight| **weight < 0.0).map(|weight| weight.abs()).sum();
    for weight in &mut filter {
        *weight /= if *weight < 0.0 { below } else { above };
    }
    filter
}

/// Rows of numbers, of which `reach` at either end are there for filters.
struct Plane {
    width: usize,
    reach: usize,
    values: Vec<f64>,
}

impl Plane {
    /// The rows between the ends, filtered along rows and along columns.
    fn filter(&self, along: &[f64], across: &[f64]) -> Vec<f64> {
        let width = self.width;
        let (side, reach) = (along.len() / 2, across.len() / 2);
        let mut padded = vec![0.0; width + 2 * side];
        let mut filtered = Vec::with_capacity(self.values.len());
        for row in self.values.chunks_exact(width) {
            padded[..side].fill(row[0]);
            padded[side..side + width].copy_from_slice(row);
            padded[side + width..].fill(row[width - 1]);
            filtered.extend(
                padded
                    .windows(along.len())
                    .map(|near| near.iter().zip(along).map(|(v, w)| v * w).sum::<f64>()),
            );
        }
        let rows = self.values.len() / width - 2 * self.reach;
        let mut out = vec![0.0; rows * width];
        for (row, out) in out.chunks_exact_mut(width).enumerate() {
            for (n, weight) in across.iter().enumerate() {
                let from = (row + self.reach - reach + n) * width;
                for (sum, value) in out.iter_mut().zip(&filtered[from..from + width]) {
                    *sum += weight * value;
                }
            }
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::random::unit;

    fn noise(width: usize, height: usize, seed: u64) -> Vec<[f32; 3]> {
        #[allow(clippy::cast_possible_truncation, reason = "a random number")]
        let number = |n: usize, part: u64| unit(seed, 3 * n as u64 + part) as f32;
        (0..width * height).map(|n| [0, 1, 2].map(|part| number(n, part))).collect()
    }

    #[test]
    fn equal_images_show_no_difference_and_order_does_not_matter() {
        let [a, b] = [1, 2].map(|seed| noise(37, 41, seed));
        assert!(flip(37, &a, &a, PIXELS_PER_DEGREE).iter().all(|value| *value == 0.0));
        let [there, back] = [flip(37, &a, &b, PIXELS_PER_DEGREE), flip(37, &b, &a, PIXELS_PER_DEGREE)];
        assert_eq!(there, back);
        assert!(there.iter().all(|value| *value > 0.0 && *value <= 1.0));
    }

    #[test]
    fn pure_colours_differ_as_the_remapping_says() {
        let plain = |colour: [f32; 3]| vec![colour; 40 * 40];
        let between = |a, b| flip(40, &plain(a), &plain(b), PIXELS_PER_DEGREE)[820];
        // The pair that the remapping sends to 1.
        assert!((between([0.0, 1.0, 0.0], [0.0, 0.0, 1.0]) - 1.0).abs() < 1e-6);
        // Black and white are 100 of L* apart; green and blue, from their L*a*b* with Hunt's effect, 203.305 by HyAB.
        let [apart, most] = [100.0, 203.305].map(|distance| libm::pow(distance, 0.7));
        let expected = 0.95 + (apart - 0.4 * most) / (0.6 * most) * 0.05;
        let found = f64::from(between([0.0; 3], [1.0; 3]));
        assert!((found - expected).abs() < 1e-6, "{found} {expected}");
    }

    #[test]
    fn strips_do_not_show() {
        // The same image below itself, away from the seam: rows 80 to 99 are as rows 0 to 19 of the middle copy.
        let tile = noise(16, 80, 5);
        let other = noise(16, 80, 6);
        let repeat = |tile: &[[f32; 3]]| [tile, tile, tile].concat();
        let map = flip(16, &repeat(&tile), &repeat(&other), PIXELS_PER_DEGREE);
        assert_eq!(map[30 * 16..60 * 16], map[110 * 16..140 * 16]);
        assert!(flip(16, &[], &[], PIXELS_PER_DEGREE).is_empty());
    }
}
