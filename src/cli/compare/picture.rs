//! Reading images.

use std::fs::File;
use std::io::BufReader;
use std::path::Path;

use crate::cli::{Failure, text};
use crate::formats::exr::{self, Part, Samples};
use crate::formats::png;
use crate::report::{Picture, from_srgb};

use super::Kind;

/// Reads an image, and of an EXR the layer that is asked for, within so many bytes.
pub(super) fn read(path: &Path, kind: Kind, layer: Option<&str>, budget: u64) -> Result<Picture, Failure> {
    let cannot = || Failure::input(format!("cannot read {}", path.display()));
    let file = BufReader::new(File::open(path).map_err(|error| cannot().because(error))?);
    if kind == Kind::Png {
        let png::Picture { size, channels } = png::read(file, budget).map_err(|error| {
            let memory = matches!(error, png::PngReadError::Memory { .. });
            hinted(cannot().because(error), memory)
        })?;
        let channels = channels.into_iter().map(|(name, values)| (name.to_owned(), values)).collect();
        return Ok(Picture { size, channels, srgb: true });
    }
    let parts = exr::read(file, budget).map_err(|error| {
        let memory = matches!(error, exr::ExrReadError::Memory { .. });
        hinted(cannot().because(error), memory)
    })?;
    of_parts(parts, layer, path)
}

fn hinted(failure: Failure, memory: bool) -> Failure {
    if memory { failure.hint("allow more with --memory") } else { failure }
}

/// Bytes that an image takes.
pub(super) fn bytes(picture: &Picture) -> u64 {
    picture.channels.iter().map(|(_, values)| 4 * values.len() as u64).sum()
}

/// All channels of all parts, or those of one layer, by their whole names. Where there are several parts, their names come
/// before the channels'.
fn of_parts(parts: Vec<Part<String>>, layer: Option<&str>, path: &Path) -> Result<Picture, Failure> {
    let several = parts.len() > 1;
    let mut size = None;
    let (mut channels, mut all): (Vec<(String, Vec<f32>)>, Vec<String>) = (Vec::new(), Vec::new());
    for Part { name: part, pixels, channels: found, .. } in parts {
        for (channel, samples) in found {
            let name = if several && !part.is_empty() && !channel.starts_with(&format!("{part}.")) {
                format!("{part}.{channel}")
            } else {
                channel.clone()
            };
            all.push(name.clone());
            // Of the part, or of a layer within it.
            let is_of =
                |layer: &str| part == layer || [&name, &channel].iter().any(|name| is_within(name, layer));
            if layer.is_some_and(|layer| !is_of(layer)) {
                continue;
            }
            if *size.get_or_insert(pixels) != pixels {
                return Err(Failure::usage(format!("the parts of {} are not of one size", path.display()))
                    .hint("choose one of them with --layer"));
            }
            channels.push((name, floats(samples)));
        }
    }
    let Some(size) = size else {
        let Some(layer) = layer.filter(|_| !all.is_empty()) else {
            return Err(Failure::input(format!("{} holds no channel", path.display())));
        };
        let name = path.display();
        return Err(if all.iter().any(|channel| channel == layer) {
            Failure::usage(format!("{layer} is a channel of {name}, and no layer"))
                .hint("without --layer all channels are compared, each by itself too")
        } else {
            Failure::usage(format!("{name} has no layer {layer:?}")).hint(choice(&all))
        });
    };
    Ok(Picture { size, channels, srgb: false })
}

/// Whether a channel is one of a layer's.
pub(super) fn is_within(channel: &str, layer: &str) -> bool {
    channel.strip_prefix(layer).is_some_and(|rest| rest.starts_with('.'))
}

/// The layers that channels are of, each once.
pub(super) fn layers<'a>(channels: impl Iterator<Item = &'a str>) -> Vec<String> {
    let mut layers: Vec<String> = Vec::new();
    for (layer, _) in channels.filter_map(|channel| channel.rsplit_once('.')) {
        if !layers.iter().any(|known| known == layer) {
            layers.push(layer.to_owned());
        }
    }
    layers
}

/// The layers there are, for people.
fn choice(channels: &[String]) -> String {
    let layers = layers(channels.iter().map(String::as_str));
    if layers.is_empty() {
        return listed("it has no layers, only the channels", channels);
    }
    listed("its layers are", &layers)
}

/// Names for people, those of many cut short.
pub(super) fn listed(what: &str, names: &[String]) -> String {
    const MOST: usize = 16;
    let shown: Vec<String> = names.iter().take(MOST).map(|name| text::tidy(name)).collect();
    let more = if names.len() > MOST { ", ..." } else { "" };
    format!("{what} {}{more}", shown.join(", "))
}

fn floats(samples: Samples) -> Vec<f32> {
    match samples {
        Samples::F32(values) => values,
        Samples::F16(values) => values.into_iter().map(half::f16::to_f32).collect(),
    }
}

/// Makes two images alike in kind: where one is a picture and the other is not, codes become linear light; where one is grey
/// and the other coloured, grey becomes a colour.
pub(super) fn align(a: &mut Picture, b: &mut Picture) {
    if a.srgb != b.srgb {
        for picture in [&mut *a, &mut *b].into_iter().filter(|picture| picture.srgb) {
            for (_, values) in picture.channels.iter_mut().filter(|(name, _)| name != "A") {
                for value in values {
                    #[allow(clippy::cast_possible_truncation, reason = "to single precision")]
                    let linear = from_srgb(f64::from(*value)) as f32;
                    *value = linear;
                }
            }
            picture.srgb = false;
        }
    }
    let has = |picture: &Picture, name: &str| picture.channels.iter().any(|channel| channel.0 == name);
    if has(a, "Y") && has(b, "R") {
        colour(a);
    } else if has(b, "Y") && has(a, "R") {
        colour(b);
    }
}

/// Three channels of what is grey.
fn colour(picture: &mut Picture) {
    if let Some(at) = picture.channels.iter().position(|channel| channel.0 == "Y") {
        let (_, values) = picture.channels.remove(at);
        picture.channels.extend(["R", "G", "B"].map(|name| (name.to_owned(), values.clone())));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn part(name: &str, channels: &[&str], pixels: [usize; 2]) -> Part<String> {
        let samples = || Samples::F32(vec![0.5; pixels[0] * pixels[1]]);
        Part {
            name: name.to_owned(),
            pixels,
            channels: channels.iter().map(|name| ((*name).to_owned(), samples())).collect(),
            attribute: String::new(),
        }
    }

    fn names(parts: Vec<Part<String>>, layer: Option<&str>) -> Result<String, String> {
        let picture = of_parts(parts, layer, Path::new("a.exr"));
        let joined = |picture: Picture| {
            picture.channels.into_iter().map(|(name, _)| name).collect::<Vec<_>>().join(" ")
        };
        picture.map(joined).map_err(|failure| {
            let mut message = Vec::new();
            failure.report(&mut message).expect("memory");
            String::from_utf8(message).expect("text")
        })
    }

    #[test]
    fn channels_go_by_part_and_layer() {
        let one = || vec![part("main", &["B", "G", "R", "z.Y"], [2, 2])];
        assert_eq!(names(one(), None).as_deref(), Ok("B G R z.Y"));
        assert_eq!(names(one(), Some("z")).as_deref(), Ok("z.Y"));
        assert_eq!(names(one(), Some("main")).as_deref(), Ok("B G R z.Y"));
        let two = || vec![part("a", &["R", "a.G"], [2, 2]), part("b", &["R"], [3, 2])];
        assert_eq!(names(two(), Some("a")).as_deref(), Ok("a.R a.G"));
        let unlike = names(two(), None).expect_err("two sizes");
        assert!(unlike.contains("not of one size") && unlike.contains("--layer"), "{unlike}");
        let missing = names(two(), Some("c")).expect_err("no such layer");
        assert!(missing.contains("no layer \"c\"") && missing.contains("its layers are a, b\n"), "{missing}");
        let channel = names(one(), Some("R")).expect_err("no layer");
        assert!(channel.contains("R is a channel of a.exr, and no layer"), "{channel}");
        let prefix = names(one(), Some("albedo")).expect_err("no layer");
        assert!(prefix.contains("its layers are z\n"), "{prefix}");
    }

    #[test]
    fn grey_becomes_a_colour_and_codes_light() {
        let picture =
            |name: &str, srgb| Picture { size: [1, 1], channels: vec![(name.to_owned(), vec![0.5])], srgb };
        let (mut grey, mut coloured) = (picture("Y", true), picture("R", false));
        align(&mut grey, &mut coloured);
        assert_eq!((grey.channels.len(), grey.srgb), (3, false));
        assert!((grey.channels[2].1[0] - 0.214_04).abs() < 1e-5);
        assert_eq!(coloured, picture("R", false));
        let (mut one, mut other) = (picture("Y", true), picture("Y", true));
        align(&mut one, &mut other);
        assert_eq!((&one, &other), (&picture("Y", true), &picture("Y", true)));
    }
}
