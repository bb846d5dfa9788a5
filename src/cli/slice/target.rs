//! Where slices go: a file of each, one file with a part for each, or one image with all of them side by side.

use std::io;
use std::path::{Path, PathBuf};

use half::f16;
use rayon::prelude::*;
use serde::Serialize;

use super::source::{Plane, Sliced};
use super::{Arguments, picture};
use crate::cli::Failure;
use crate::cli::frames::Pattern;
use crate::cli::interrupt::Interrupt;
use crate::cli::output::{ImageForm, Output, save};
use crate::formats::exr::{self, Part, Samples};
use crate::formats::png;
use crate::volume::Slicing;

/// How slices share files.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Layout {
    /// One each.
    Sequence(Pattern),
    /// All in one, each a part of its own.
    Parts,
    /// All in one image.
    Atlas,
}

pub(super) struct Target {
    path: PathBuf,
    layout: Layout,
    form: ImageForm,
    /// What is known of the slices from the beginning.
    about: Option<About>,
    /// Those that cannot be written yet.
    held: Vec<(Plane, usize)>,
    written: Vec<PathBuf>,
}

struct About {
    slicing: Slicing,
    grid: String,
    index_to_world: Option<[[f64; 4]; 3]>,
    half: bool,
    time: Option<f64>,
    count: usize,
}

/// What an image's attribute says, as JSON.
#[derive(Debug, Serialize)]
struct Attribute<'a> {
    grid: &'a str,
    axis: &'static str,
    /// Number of the slice, counted from 0, and index along the axis; of an atlas those of the first.
    plane: usize,
    index: i32,
    /// Index of the voxel of the pixel at the top left.
    first_voxel: [i32; 3],
    /// Its centre in metres, and the steps from there to the next pixels to the right and below; null where the grid's map
    /// is not affine.
    first_pixel: Option<[f64; 3]>,
    right: Option<[f64; 3]>,
    down: Option<[f64; 3]>,
    /// Seconds after the scene's start frame.
    #[serde(skip_serializing_if = "Option::is_none")]
    time: Option<f64>,
    /// Of an atlas: pictures in a row, in all, and the numbers of their slices.
    #[serde(skip_serializing_if = "Option::is_none")]
    columns: Option<usize>,
    #[serde(skip_serializing_if = "Option::is_none")]
    planes: Option<Vec<usize>>,
}

impl Target {
    pub(super) fn new(arguments: &Arguments) -> Result<Target, Failure> {
        let path = arguments.output.clone();
        let form = ImageForm::of(&path, "output")?;
        if form == ImageForm::Exr && arguments.white.is_some() {
            return Err(Failure::usage("--white has no meaning for .exr, which holds the values themselves"));
        }
        let is_sequence = path.file_name().is_some_and(|name| name.to_string_lossy().contains('#'));
        let layout = match (is_sequence, form) {
            (true, _) if arguments.atlas => {
                return Err(Failure::usage(
                    "--atlas puts all slices into one file, and the output names many",
                ));
            }
            (true, _) => Layout::Sequence(Pattern::new(&path)?),
            (false, ImageForm::Exr) if !arguments.atlas => Layout::Parts,
            (false, _) => Layout::Atlas,
        };
        // Not of files that may be many, whose folder is the same.
        let first = match &layout {
            Layout::Sequence(pattern) => pattern.path(0),
            Layout::Parts | Layout::Atlas => path.clone(),
        };
        Output::check(&first)?;
        Ok(Target { path, layout, form, about: None, held: Vec::new(), written: Vec::new() })
    }

    /// Bytes that are held at once at the end.
    pub(super) fn holds(&self, slicing: &Slicing, count: usize, sliced: &Sliced) -> u64 {
        let slices = if self.streams() { 8 } else { count };
        let [width, height] = slicing.pixels();
        // The values, and once more in the order or the form that they are written in; of one picture of all both, and the file.
        let bytes = if matches!(self.layout, Layout::Atlas) { 12 } else { 8 };
        let factors = [width, height, slices, bytes, if sliced.is_vector { 3 } else { 1 }];
        factors.iter().fold(1, |bytes: u64, factor| bytes.saturating_mul(*factor as u64))
    }

    /// Whether slices are written as they come: only a picture must know the largest value first.
    fn streams(&self) -> bool {
        matches!(self.layout, Layout::Sequence(_)) && self.form == ImageForm::Exr
    }

    pub(super) fn begin(
        &mut self,
        slicing: &Slicing,
        sliced: &Sliced,
        planes: &[usize],
    ) -> Result<(), Failure> {
        if self.form == ImageForm::Png && sliced.is_vector {
            return Err(Failure::usage(format!("a .png shows numbers, and {} holds vectors", sliced.grid))
                .hint("write .exr"));
        }
        self.about = Some(About {
            slicing: *slicing,
            grid: sliced.grid.clone(),
            index_to_world: sliced.index_to_world,
            half: sliced.half,
            time: sliced.time,
            count: planes.len(),
        });
        Ok(())
    }

    /// Takes slices, in order.
    pub(super) fn take(&mut self, planes: Vec<(Plane, usize)>, interrupt: &Interrupt) -> Result<(), Failure> {
        if !self.streams() {
            self.held.extend(planes);
            return Ok(());
        }
        self.files(planes, 0.0, interrupt)
    }

    /// Writes what was held; `white` is the value that pictures show as the brightest.
    pub(super) fn finish(&mut self, white: Option<f32>, interrupt: &Interrupt) -> Result<(), Failure> {
        let (held, white) = (std::mem::take(&mut self.held), white.unwrap_or(0.0));
        if let Layout::Sequence(_) = self.layout {
            return self.files(held, white, interrupt);
        }
        let Some(about) = &self.about else { return Ok(()) };
        let pictures = match self.layout {
            Layout::Atlas => vec![about.atlas(held)],
            _ => held.into_iter().map(|(plane, number)| about.picture(plane, number)).collect(),
        };
        self.written.push(self.path.clone());
        write(&self.path, self.form, pictures, white, interrupt)
    }

    /// Writes a file for each.
    fn files(
        &mut self,
        planes: Vec<(Plane, usize)>,
        white: f32,
        interrupt: &Interrupt,
    ) -> Result<(), Failure> {
        let (Some(about), Layout::Sequence(pattern)) = (&self.about, &self.layout) else { return Ok(()) };
        let path = |number: usize| pattern.path(i64::try_from(number).unwrap_or(i64::MAX));
        self.written.extend(planes.iter().map(|(_, number)| path(*number)));
        let form = self.form;
        planes.into_par_iter().try_for_each(|(plane, number)| {
            write(&path(number), form, vec![about.picture(plane, number)], white, interrupt)
        })
    }

    /// Pictures in a row.
    pub(super) fn columns(&self) -> Option<usize> {
        self.about.as_ref().filter(|_| self.layout == Layout::Atlas).map(About::columns)
    }

    pub(super) fn written(&self) -> Vec<String> {
        self.written.iter().map(|path| path.display().to_string()).collect()
    }
}

/// An image in the making.
struct Picture {
    name: String,
    pixels: [usize; 2],
    plane: Plane,
    attribute: String,
    half: bool,
}

impl About {
    /// One slice.
    fn picture(&self, plane: Plane, number: usize) -> Picture {
        Picture {
            name: ascii(&format!("{}.{number:04}", self.grid)),
            pixels: self.slicing.pixels(),
            plane,
            attribute: self.attribute(number, None),
            half: self.half,
        }
    }

    /// All slices side by side, in rows from the top left; what is left over is 0.
    fn atlas(&self, planes: Vec<(Plane, usize)>) -> Picture {
        let ([width, height], columns) = (self.slicing.pixels(), self.columns());
        let pixels = [width * columns, height * planes.len().div_ceil(columns)];
        let numbers: Vec<usize> = planes.iter().map(|(_, number)| *number).collect();
        let join = |part: &dyn Fn(&Plane) -> Option<&Vec<f32>>| {
            let mut joined = vec![0.0; pixels[0] * pixels[1]];
            for (place, (plane, _)) in planes.iter().enumerate() {
                let Some(values) = part(plane) else { continue };
                let corner = place / columns * height * pixels[0] + place % columns * width;
                for (row, values) in values.chunks_exact(width).enumerate() {
                    joined[corner + row * pixels[0]..][..width].copy_from_slice(values);
                }
            }
            joined
        };
        let component = |axis: usize| {
            join(&move |plane| match plane {
                Plane::Vectors(parts) => parts.get(axis),
                Plane::Numbers(_) => None,
            })
        };
        let plane = match planes.first() {
            Some((Plane::Vectors(_), _)) => Plane::Vectors([component(0), component(1), component(2)]),
            _ => Plane::Numbers(join(&|plane| match plane {
                Plane::Numbers(values) => Some(values),
                Plane::Vectors(_) => None,
            })),
        };
        let first = numbers.first().copied().unwrap_or(0);
        let attribute = self.attribute(first, Some(numbers));
        Picture { name: ascii(&self.grid), pixels, plane, attribute, half: self.half }
    }

    /// So many that the atlas is about as wide as high.
    fn columns(&self) -> usize {
        let [width, height] = self.slicing.pixels();
        let mut columns = 1;
        while columns * width < self.count.div_ceil(columns) * height && columns < self.count {
            columns += 1;
        }
        columns
    }

    fn attribute(&self, plane: usize, planes: Option<Vec<usize>>) -> String {
        let slicing = &self.slicing;
        let first_voxel = slicing.voxel(plane, [0, 0]);
        let [right, up] = slicing.axis().across();
        let world =
            |of: &dyn Fn(&[f64; 4]) -> f64| self.index_to_world.map(|rows| [0, 1, 2].map(|i| of(&rows[i])));
        let attribute = Attribute {
            grid: &self.grid,
            axis: ["x", "y", "z"][slicing.axis().number()],
            plane,
            index: slicing.index(plane),
            first_voxel,
            first_pixel: world(&|row| {
                (0..3).map(|i| row[i] * f64::from(first_voxel[i])).sum::<f64>() + row[3]
            }),
            right: world(&|row| row[right]),
            // Not minus zero.
            down: world(&|row| 0.0 - row[up]),
            time: self.time,
            columns: planes.is_some().then(|| self.columns()),
            planes,
        };
        ascii(&serde_json::to_string(&attribute).unwrap_or_default())
    }
}

/// Other letters as JSON has them, since images hold one byte for each.
fn ascii(text: &str) -> String {
    let mut out = String::new();
    for letter in text.chars() {
        if letter.is_ascii() {
            out.push(letter);
        } else {
            out.extend(letter.encode_utf16(&mut [0; 2]).iter().map(|unit| format!("\\u{unit:04x}")));
        }
    }
    out
}

/// Writes a file, whole or not at all.
fn write(
    path: &Path,
    form: ImageForm,
    pictures: Vec<Picture>,
    white: f32,
    interrupt: &Interrupt,
) -> Result<(), Failure> {
    let mut bytes = io::Cursor::new(Vec::new());
    match form {
        ImageForm::Exr => exr::write(pictures.into_iter().map(part).collect(), &mut bytes)
            .map_err(|error| Failure::failed(format!("cannot write {}", path.display())).because(error))?,
        ImageForm::Png => {
            for picture in &pictures {
                let colours = picture::colours(&picture.plane, white).unwrap_or_default();
                png::write(picture.pixels, &colours, &mut bytes).map_err(|error| {
                    Failure::failed(format!("cannot write {}", path.display())).because(error)
                })?;
            }
        }
    }
    save(path, bytes.get_ref(), interrupt)
}

/// Numbers are luminance, vectors red, green and blue.
fn part(picture: Picture) -> Part {
    let Picture { name, pixels, plane, attribute, half } = picture;
    let samples = |values: Vec<f32>| {
        if half {
            Samples::F16(values.into_iter().map(f16::from_f32).collect())
        } else {
            Samples::F32(values)
        }
    };
    let channels = match plane {
        Plane::Numbers(values) => vec![("Y", samples(values))],
        Plane::Vectors([x, y, z]) => vec![("R", samples(x)), ("G", samples(y)), ("B", samples(z))],
    };
    Part { name, pixels, channels, attribute }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn attributes_are_plain_text_and_still_json() {
        let text = serde_json::to_string("Gr\u{fc}n \u{1F300} \" \n").unwrap_or_default();
        assert!(ascii(&text).is_ascii());
        assert_eq!(serde_json::from_str::<String>(&ascii(&text)).ok(), serde_json::from_str(&text).ok());
    }
}
