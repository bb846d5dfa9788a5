//! Intervals of figures of images.

use serde::Serialize;

use super::errors::{between, drawn};

/// Intervals that hold a figure with a probability of 95 %, as far as other pixels like these would tell.
///
/// By the bootstrap over blocks: the image is cut into squares, as many are drawn, with repetition, a thousand times, and the
/// percentiles of what the draws give are taken. Neighbouring pixels see the same voxels, and FLIP's filters make each of
/// its values out of some ten pixels around it, so single pixels that were drawn would promise far too much. A square's edge
/// is the fourth root of the number of pixels, rounded up: in the plane the error of such an interval is least for an edge
/// of this order (Hall, Horowitz and Jing, "On blocking rules for the bootstrap with dependent data", 1995; Lahiri,
/// "Resampling methods for dependent data", 2003, chapter 12). It is 18 of 320 x 320 pixels, which is past FLIP's reach,
/// and leaves more than three hundred squares to draw from.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct ImageIntervals {
    /// Pixels along a square's edge.
    pub block: u64,
    /// Of the root mean square of the difference.
    pub rmse: [f64; 2],
    /// Of that over the root mean square of the first image; null where that may be 0.
    pub relative: Option<[f64; 2]>,
    /// Decibels, of the first image's largest value; null where that is 0, or the images may not differ.
    pub psnr: Option<[f64; 2]>,
    /// Of the mean of FLIP; null where there is no colour.
    pub flip: Option<[f64; 2]>,
}

/// Of channels of an image so many pixels wide, with those that they are held against, whose largest value is `peak`; and of
/// FLIP's map. What is not finite is left out. `None` without two squares to draw from.
pub(super) fn intervals(
    size: [usize; 2],
    channels: &[(&[f32], &[f32])],
    peak: f64,
    flip: Option<&[f32]>,
) -> Option<ImageIntervals> {
    const STREAM: u64 = 0x626c_6f63;
    let edge = edge(size[0] * size[1]);
    let across = size[0].div_ceil(edge);
    let mut groups = vec![[0.0_f64; 5]; across * size[1].div_ceil(edge)];
    let place = |pixel: usize| pixel / size[0] / edge * across + pixel % size[0] / edge;
    for (a, b) in channels {
        for (pixel, (a, b)) in a.iter().zip(*b).enumerate() {
            if a.is_finite() && b.is_finite() {
                let (a, b) = (f64::from(*a), f64::from(*b));
                let group = &mut groups[place(pixel)];
                group[0] += 1.0;
                group[1] += (b - a) * (b - a);
                group[2] += a * a;
            }
        }
    }
    for (pixel, value) in flip.into_iter().flatten().enumerate() {
        let group = &mut groups[place(pixel)];
        group[3] += 1.0;
        group[4] += f64::from(*value);
    }
    if groups.iter().filter(|group| group[0] > 0.0).count() < 2 {
        return None;
    }
    let draws = drawn(groups, STREAM, |[count, square, own, pixels, seen]| {
        [(square / count).sqrt(), (square / own).sqrt(), seen / pixels]
    })?;
    let rmse = between(&draws, 0);
    let finite = |ends: [f64; 2]| ends.iter().all(|end| end.is_finite()).then_some(ends);
    let decibels = |rmse: f64| 20.0 * libm::log10(peak / rmse);
    Some(ImageIntervals {
        block: edge as u64,
        rmse,
        relative: finite(between(&draws, 1)),
        psnr: (peak > 0.0 && rmse[0] > 0.0).then(|| [decibels(rmse[1]), decibels(rmse[0])]),
        flip: flip.and_then(|_| finite(between(&draws, 2))),
    })
}

/// Pixels along the edge of a square, of so many pixels in all.
fn edge(pixels: usize) -> usize {
    let mut edge = 1_usize;
    while edge.saturating_pow(4) < pixels {
        edge += 1;
    }
    edge
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::random::unit;

    const SIZE: [usize; 2] = [96, 80];

    /// Differences that are alike in patches of this many pixels.
    fn patchy(seed: u64, patch: usize) -> Vec<f32> {
        (0..SIZE[0] * SIZE[1])
            .map(|pixel| {
                let place = pixel / SIZE[0] / patch * SIZE[0] + pixel % SIZE[0] / patch;
                #[allow(clippy::cast_possible_truncation, reason = "a random number")]
                let value = unit(seed, place as u64) as f32;
                value
            })
            .collect()
    }

    #[test]
    fn edges_are_fourth_roots_rounded_up() {
        assert_eq!([1, 16, 17, 1296, 320 * 320].map(edge), [1, 2, 3, 6, 18]);
    }

    #[test]
    fn intervals_hold_the_figures_nineteen_times_in_twenty() {
        let zero = vec![0.0; SIZE[0] * SIZE[1]];
        // Root mean square of a uniform number in [0, 1), and its mean.
        let truth = [1.0 / 3.0_f64.sqrt(), 0.5];
        for patch in [1, 4] {
            let mut held = [0; 2];
            for seed in 0..100 {
                let b = patchy(seed, patch);
                let found = intervals(SIZE, &[(&zero, &b)], 1.0, Some(&b)).expect("many squares");
                assert_eq!((found.block, found.relative), (10, None));
                for (held, (ends, truth)) in
                    held.iter_mut().zip([found.rmse, found.flip.expect("a map")].into_iter().zip(truth))
                {
                    *held += u32::from(ends[0] <= truth && truth <= ends[1]);
                }
            }
            // 95 of 100, to three standard deviations below; and squares of 10 pixels cut patches of 4, which makes intervals a
            // little narrow: 90 of 100, to the same.
            assert!(held.iter().all(|held| *held >= if patch == 1 { 87 } else { 80 }), "{patch}: {held:?}");
        }
    }

    #[test]
    fn patches_make_wider_intervals_than_pixels() {
        let zero = vec![0.0; SIZE[0] * SIZE[1]];
        let width = |patch: usize| {
            let [low, high] =
                intervals(SIZE, &[(&zero, &patchy(7, patch))], 1.0, None).expect("many squares").rmse;
            high - low
        };
        // As many numbers as there are patches: 16 times fewer.
        assert!((2.0..6.0).contains(&(width(4) / width(1))), "{}", width(4) / width(1));
    }

    #[test]
    fn figures_without_a_scale_have_no_interval() {
        let (dark, bright) = (vec![0.0_f32; 64], vec![2.0_f32; 64]);
        let found = intervals([8, 8], &[(&bright, &bright)], 2.0, None).expect("squares");
        assert_eq!((found.rmse, found.relative, found.psnr), ([0.0; 2], Some([0.0; 2]), None));
        let found = intervals([8, 8], &[(&dark, &bright)], 0.0, Some(&dark)).expect("squares");
        assert_eq!((found.rmse, found.relative, found.psnr), ([2.0; 2], None, None));
        assert_eq!(found.flip, Some([0.0; 2]));
        // 20 log10(2 / 2).
        let found = intervals([8, 8], &[(&bright, &dark)], 2.0, None).expect("squares");
        assert_eq!((found.relative, found.psnr), (Some([1.0; 2]), Some([0.0; 2])));
        assert_eq!(intervals([1, 1], &[(&dark[..1], &bright[..1])], 1.0, None), None);
        assert_eq!(intervals([0, 0], &[], 1.0, None), None);
    }
}
