//! Pictures and slices of a scene and of its bakes, beside each other.

use colorous::INFERNO;
use glam::DVec3;

use super::{Gallery, Shot, words};
use crate::field::{Extent, Field, Lattice};
use crate::formats::vdb::{Compression, Encoder};
use crate::march::{
    Baked, Camera, Developed, Grid, Integrator, Meaning, Medium, Optics, Picture, Procedural, Quality, Shadow,
};
use crate::num::Level;
use crate::report::flip::{PIXELS_PER_DEGREE, flip};
use crate::report::trial::{Pilot, Trial, TrialError, rows};
use crate::report::{Errors, exact, from_srgb};
use crate::scene::Scene;
use crate::volume::{Filter, Plan, planned_density_at, sample_at};

/// Voxels of the bakes that are shown, over the scene's own.
const TIMES: [f64; 3] = [1.0, 2.0, 4.0];
/// Samples of a pixel.
const SAMPLES: u32 = 4;
/// Pixels along the longer side of a slice.
const SLICE: usize = 480;
/// What differs by this part of the peak, or more, is brightest in a slice's difference.
const BRIGHTEST: f64 = 0.1;
/// Behind pictures.
const BEHIND: DVec3 = DVec3::splat(0.05);

/// What is shown of a scene at and around a lattice, in pictures of so many pixels; each plan takes up to `budget` bytes. Where
/// `goes_on` says no, there are fewer.
///
/// # Errors
///
/// Where the scene cannot be planned at its own lattice.
pub fn galleries(
    scene: &Scene,
    lattice: Lattice,
    size: [usize; 2],
    budget: u64,
    goes_on: &mut dyn FnMut() -> bool,
) -> Result<Vec<Gallery>, TrialError> {
    let pilot = Pilot::new(scene, budget);
    let field = Field::compile(&exact::unlimited(scene));
    if field.bounds().is_none() {
        return Ok(vec![]);
    }
    let studio = Studio::new(scene, &field, size);
    let procedural = Procedural::new(&field, lattice, 0.5, budget)?;
    let truth = studio.take(&Medium::Procedural(procedural), None);
    let exposure = truth.exposure;
    let mut pictures = vec![Shot {
        title: "The scene itself".to_owned(),
        caption: "marched without voxels, in steps of half a voxel".to_owned(),
        size,
        pixels: truth.shown(exposure),
    }];
    let plane = Plane::across(&field);
    let plan = Plan::for_extent(&field, lattice, Extent::Whole, budget)?;
    let exact: Vec<f64> =
        planned_density_at(&field, &plan, &plane.points, Level::best()).into_iter().map(f64::from).collect();
    let peak = exact.iter().fold(0.0_f64, |most, value| most.max(*value));
    let mut slices = vec![Shot {
        title: "The density itself".to_owned(),
        caption: format!("{}, from 0, dark, to {}, bright", plane.words, words::figure(peak)),
        size: plane.size,
        pixels: exact.iter().map(|value| heat(value / peak)).collect(),
    }];
    for times in TIMES {
        if !goes_on() {
            break;
        }
        let lattice = Lattice { voxel_size: times * lattice.voxel_size };
        let lot = pilot.at(lattice)?;
        lot.fits()?;
        let trial = Trial::new(&lot.field, &lot.plan, scene.bake().cutoff, Encoder::new(Compression::None))?;
        let voxels = words::metres(lattice.voxel_size);

        let index: Vec<DVec3> = plane.points.iter().map(|point| *point / lattice.voxel_size - 0.5).collect();
        let values = sample_at(&trial.tree, Filter::Trilinear, &index);
        let off = Errors::new(exact.iter().copied().zip(values.iter().copied()), None);
        slices.push(Shot {
            title: format!("Voxels of {voxels}"),
            caption: "read trilinearly".to_owned(),
            size: plane.size,
            pixels: values.iter().map(|value| heat(value / peak)).collect(),
        });
        slices.push(Shot {
            title: "Difference".to_owned(),
            caption: format!(
                "brightest at {} of the peak; root mean square {} of the density's, largest {} of the peak",
                words::part(BRIGHTEST),
                off.l2.of_rms.map_or_else(|| "-".to_owned(), words::part),
                off.max.of_peak.map_or_else(|| "-".to_owned(), words::part)
            ),
            size: plane.size,
            pixels: values
                .iter()
                .zip(&exact)
                .map(|(a, b)| heat((a - b).abs() / (BRIGHTEST * peak)))
                .collect(),
        });

        let Some(grid) = Grid::from_rows(&rows(lattice)) else { break };
        let Ok(baked) = Baked::new(&trial.tree, grid, Meaning::Density, budget) else { break };
        let shot = studio.take(&Medium::Baked(baked), Some(exposure));
        let seen = flip(size[0], &truth.colours(exposure), &shot.colours(exposure), PIXELS_PER_DEGREE);
        #[allow(clippy::cast_precision_loss, reason = "a mean")]
        let mean = seen.iter().map(|part| f64::from(*part)).sum::<f64>() / seen.len().max(1) as f64;
        pictures.push(Shot {
            title: format!("Voxels of {voxels}"),
            caption: format!("{} of file, uncompressed", words::bytes(bytes(trial.bytes))),
            size,
            pixels: shot.shown(exposure),
        });
        pictures.push(Shot {
            title: "Difference".to_owned(),
            caption: format!(
                "as an observer sees it: FLIP, from 0, dark, to 1, bright; mean {}",
                words::figure(mean)
            ),
            size,
            pixels: seen.iter().map(|part| heat(f64::from(*part))).collect(),
        });
    }
    Ok(vec![
        Gallery {
            title: "Pictures",
            text: "The scene and its bakes through the same camera, lights and march, so that only the field differs.".to_owned(),
            shots: pictures,
        },
        Gallery {
            title: "Slices",
            text: "The density in a plane through the middle of the scene.".to_owned(),
            shots: slices,
        },
    ])
}

#[allow(clippy::cast_precision_loss, reason = "in words")]
fn bytes(bytes: u64) -> f64 {
    bytes as f64
}

/// Inferno of Smith and van der Walt (2015), whose lightness grows evenly.
fn heat(part: f64) -> [u8; 3] {
    let colour = INFERNO.eval_continuous(if part.is_nan() { 0.0 } else { part.clamp(0.0, 1.0) });
    [colour.r, colour.g, colour.b]
}

/// Takes pictures that can be compared.
struct Studio {
    camera: Camera,
    optics: Optics,
    quality: Quality,
}

struct Taken {
    developed: Developed,
    exposure: f64,
}

impl Studio {
    fn new(scene: &Scene, field: &Field, size: [usize; 2]) -> Studio {
        #[allow(clippy::cast_precision_loss, reason = "pixels")]
        let aspect = size[0] as f64 / size[1] as f64;
        Studio {
            camera: Camera::new(&scene.camera(), field.bounds(), aspect),
            optics: Optics::new(&scene.medium(), scene.lights()),
            quality: Quality {
                size,
                samples: SAMPLES,
                cutoff: 1e-4,
                shadow: Shadow::Cached(2.0),
                integrator: Integrator::Single,
            },
        }
    }

    /// With the exposure of another, or its own.
    fn take(&self, medium: &Medium<'_>, exposure: Option<f64>) -> Taken {
        let mut picture = Picture::new(medium, self.camera, &self.optics, self.quality, Level::best());
        for _ in 0..SAMPLES {
            picture.sample(|_| true);
        }
        let film = picture.film();
        let exposure = exposure.unwrap_or_else(|| film.exposure());
        Taken { exposure, developed: film.develop(Some(BEHIND * libm::exp2(-exposure))) }
    }
}

impl Taken {
    fn shown(&self, exposure: f64) -> Vec<[u8; 3]> {
        self.developed.show(exposure).into_iter().map(|[red, green, blue, _]| [red, green, blue]).collect()
    }

    /// Linear, as shown.
    fn colours(&self, exposure: f64) -> Vec<[f32; 3]> {
        #[allow(clippy::cast_possible_truncation, reason = "from eight bits")]
        let linear = |byte: u8| from_srgb(f64::from(byte) / 255.0) as f32;
        self.shown(exposure).into_iter().map(|pixel| pixel.map(linear)).collect()
    }
}

/// A plane through the middle of a field, across the shortest side of its bounds.
struct Plane {
    size: [usize; 2],
    /// Of the pixels' centres, in rows from the top.
    points: Vec<DVec3>,
    words: String,
}

impl Plane {
    fn across(field: &Field) -> Plane {
        let [low, high] = field.bounds().unwrap_or([DVec3::ZERO, DVec3::ONE]);
        let sides = high - low;
        let normal = (0..3).min_by(|a, b| sides[*a].total_cmp(&sides[*b])).unwrap_or(1);
        // What is upright stays so.
        let [across, up] = match normal {
            0 => [1, 2],
            1 => [0, 2],
            _ => [0, 1],
        };
        let longest = sides[across].max(sides[up]);
        #[allow(
            clippy::cast_precision_loss,
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "pixels"
        )]
        let pixels = |side: f64| ((side / longest * SLICE as f64).ceil() as usize).clamp(1, SLICE);
        let size = [pixels(sides[across]), pixels(sides[up])];
        let middle = 0.5 * (low + high);
        let mut points = Vec::with_capacity(size[0] * size[1]);
        for row in 0..size[1] {
            for column in 0..size[0] {
                let mut point = middle;
                #[allow(clippy::cast_precision_loss, reason = "pixels")]
                let part = |n: usize, of: usize| (n as f64 + 0.5) / of as f64;
                point[across] = low[across] + sides[across] * part(column, size[0]);
                point[up] = high[up] - sides[up] * part(row, size[1]);
                points.push(point);
            }
        }
        let names = ["x", "y", "z"];
        let words = format!(
            "{} = {} m, {} to the right, {} up",
            names[normal],
            words::figure(middle[normal]),
            names[across],
            names[up]
        );
        Plane { size, points, words }
    }
}
