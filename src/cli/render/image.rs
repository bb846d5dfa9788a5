//! Pictures as files.

use std::io::Cursor;
use std::path::{Path, PathBuf};

use glam::DVec3;

use crate::cli::Failure;
use crate::cli::interrupt::Interrupt;
use crate::cli::output::{ImageForm, save};
use crate::formats::exr::{self, Part, Samples};
use crate::formats::png;
use crate::march::Film;

/// Where a picture goes.
pub(super) struct Target {
    path: PathBuf,
    form: ImageForm,
}

impl Target {
    /// Whether it holds all that is known of every pixel.
    pub(super) fn has_layers(&self) -> bool {
        self.form == ImageForm::Exr
    }

    pub(super) fn new(path: &Path) -> Result<Target, Failure> {
        let form = ImageForm::of(path, "output")?;
        Ok(Target { path: path.to_owned(), form })
    }

    /// Writes what there is of a picture, and tells the exposure of a picture to look at.
    pub(super) fn write(
        &self,
        film: &Film,
        background: Option<DVec3>,
        exposure: Option<f64>,
        interrupt: &Interrupt,
    ) -> Result<Option<f64>, Failure> {
        let developed = film.develop(background);
        let mut bytes = Cursor::new(Vec::new());
        let mut exposed = None;
        match self.form {
            ImageForm::Exr => exr::write(vec![layers(film, background)], &mut bytes).map_err(|error| {
                Failure::failed(format!("cannot write {}", self.path.display())).because(error)
            })?,
            ImageForm::Png => {
                let exposure = exposure.unwrap_or_else(|| film.exposure());
                exposed = Some(exposure);
                let pixels = developed.show(exposure);
                png::write_with_alpha(developed.size, &pixels, &mut bytes).map_err(|error| {
                    Failure::failed(format!("cannot write {}", self.path.display())).because(error)
                })?;
            }
        }
        save(&self.path, bytes.get_ref(), interrupt)?;
        Ok(exposed)
    }
}

/// All that is known of every pixel.
fn layers(film: &Film, background: Option<DVec3>) -> Part {
    #[allow(clippy::cast_possible_truncation, reason = "to the nearest that the image can hold")]
    let samples = |values: Vec<f64>| Samples::F32(values.into_iter().map(|value| value as f32).collect());
    let developed = film.develop(background);
    let colour = |axis: usize| samples(developed.colour.iter().map(|colour| colour[axis]).collect());
    let count = f64::from(film.samples.max(1));
    let mean = |sums: &[f64]| samples(sums.iter().map(|sum| sum / count).collect());
    let normal = |axis: usize| samples(film.normals.iter().map(|normal| normal[axis]).collect());
    let mut channels = vec![
        ("R", colour(0)),
        ("G", colour(1)),
        ("B", colour(2)),
        ("A", samples(developed.alpha.clone())),
        ("transmittance.Y", mean(&film.transmittance)),
        ("opticalDepth.Y", mean(&film.depth)),
        ("depth.Z", samples(film.half.clone())),
    ];
    if !film.normals.is_empty() {
        channels.extend([("normal.X", normal(0)), ("normal.Y", normal(1)), ("normal.Z", normal(2))]);
    }
    if let Some(errors) = film.errors() {
        channels.push(("noise.Y", samples(errors)));
    }
    Part { name: "picture".to_owned(), pixels: film.size, channels, attribute: "{}".to_owned() }
}
