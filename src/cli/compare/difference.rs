//! Images of the difference of images.

use std::io::Cursor;
use std::path::Path;

use colorous::{Gradient, INFERNO, MAGMA};

use super::{Arguments, MapName};
use crate::cli::Failure;
use crate::cli::interrupt::Interrupt;
use crate::cli::output::{ImageForm, save};
use crate::formats::exr::{self, Part, Samples};
use crate::formats::png;
use crate::report::{ImageDifference, Picture};

/// Refuses outputs that cannot be written, and maps of those that are none.
pub(super) fn check(arguments: &Arguments) -> Result<(), Failure> {
    let Some(path) = &arguments.difference else { return Ok(()) };
    if ImageForm::of(path, "difference")? == ImageForm::Exr && arguments.map.is_some() {
        return Err(Failure::usage("--map has no meaning for .exr, which holds the differences themselves"));
    }
    Ok(())
}

/// Writes the difference B - A of every channel, or a map of it in colours.
pub(super) fn write(
    path: &Path,
    arguments: &Arguments,
    [a, b]: [&Picture; 2],
    found: &ImageDifference,
    interrupt: &Interrupt,
) -> Result<(), Failure> {
    let pairs: Vec<(&String, &[f32], &[f32])> = found
        .channels
        .iter()
        .filter_map(|channel| {
            let of =
                |picture: &'_ Picture| picture.channels.iter().position(|(name, _)| *name == channel.name);
            Some((&channel.name, &*a.channels[of(a)?].1, &*b.channels[of(b)?].1))
        })
        .collect();
    let mut bytes = Cursor::new(Vec::new());
    let cannot = || Failure::failed(format!("cannot write {}", path.display()));
    match ImageForm::of(path, "difference")? {
        ImageForm::Exr => {
            let differences =
                |a: &[f32], b: &[f32]| Samples::F32(a.iter().zip(b).map(|(a, b)| b - a).collect());
            let part = Part {
                name: "difference".to_owned(),
                pixels: found.pixels,
                channels: pairs.iter().map(|(name, a, b)| ((*name).clone(), differences(a, b))).collect(),
                attribute: "{\"difference\": \"B - A\"}".to_owned(),
            };
            exr::write(vec![part], &mut bytes).map_err(|error| cannot().because(error))?;
        }
        ImageForm::Png => {
            let pixels = match (arguments.map, &found.flip) {
                (Some(MapName::Absolute), _) | (None, None) => largest(&pairs, found),
                (_, Some(flip)) => flip.map.iter().map(|value| colour(MAGMA, *value, 1.0)).collect(),
                (Some(MapName::Flip), None) => {
                    return Err(Failure::usage(
                        "--map flip needs images with red, green and blue, or luminance",
                    ));
                }
            };
            png::write(found.pixels, &pixels, &mut bytes).map_err(|error| cannot().because(error))?;
        }
    }
    save(path, bytes.get_ref(), interrupt)
}

/// The largest of a pixel's differences, with the largest of all as the brightest.
fn largest(pairs: &[(&String, &[f32], &[f32])], found: &ImageDifference) -> Vec<[u8; 3]> {
    let mut largest = vec![0.0_f32; found.pixels[0] * found.pixels[1]];
    for (_, a, b) in pairs {
        for (largest, (a, b)) in largest.iter_mut().zip(a.iter().zip(*b)) {
            let difference = (b - a).abs();
            // What is no number stays to be seen.
            if difference > *largest || difference.is_nan() {
                *largest = difference;
            }
        }
    }
    #[allow(clippy::cast_possible_truncation, reason = "for show")]
    let white = found.all.errors.max.absolute as f32;
    largest.iter().map(|value| colour(INFERNO, *value, white)).collect()
}

/// A colour map's colour for a part of `white`; cyan, which the maps lack, for what is not a number.
fn colour(map: Gradient, value: f32, white: f32) -> [u8; 3] {
    if value.is_nan() {
        return [0, 255, 255];
    }
    let part = if white > 0.0 { (value / white).clamp(0.0, 1.0) } else { 0.0 };
    let colour = map.eval_continuous(f64::from(part));
    [colour.r, colour.g, colour.b]
}
