//! Pictures: rays through all pixels, tile by tile.

use std::sync::{Mutex, OnceLock};

use glam::{DVec2, DVec3};
use rayon::prelude::*;

use super::camera::{Camera, Ray};
use super::display::LUMINANCE;
use super::exact::Caster;
use super::medium::{Brick, Medium, Way};
use super::optics::{Lamp, Optics, phase};
use super::path::Tracer;
use super::procedural::Worker;
use super::rays::RAYS;
use super::shade::{COARSE, FINE, Lit, Wanted};
use super::shadow::Shadows;
use super::tiles::{TILE, Tiles};
use crate::num::Level;

/// An optical depth behind which nothing is left of the light, in single precision: e^-104 is half of the smallest number.
const DARK: f64 = 104.0;

/// How a picture is made.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Quality {
    /// Pixels from left to right and from top to bottom.
    pub size: [usize; 2],
    /// Rays of a pixel.
    pub samples: u32,
    /// Rays end where no more than this part of the light is left: so much of what is behind is not seen.
    pub cutoff: f64,
    /// How shadows are found.
    pub shadow: Shadow,
    /// What light is followed.
    pub integrator: Integrator,
}

/// How shadows are found where light is scattered once.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Shadow {
    /// From optical depths that are kept along rays from the lamps, so many cells apart.
    Cached(f64),
    /// By a ray from every sample to every lamp.
    Exact,
    /// There are none: light comes to every place as if nothing were on its way.
    None,
}

/// What light is followed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Integrator {
    /// What is scattered once, and ambient light as if nothing shadowed it.
    Single,
    /// All of it, by random paths: equal seeds give equal pictures.
    Path {
        /// Another seed gives other noise.
        seed: u64,
    },
}

/// What a picture's pixels hold, in rows from the top: sums over the samples so far.
#[derive(Debug, Clone, PartialEq)]
pub struct Film {
    /// Pixels from left to right and from top to bottom.
    pub size: [usize; 2],
    /// Samples of each pixel.
    pub samples: u32,
    /// Radiance that the medium sends to the eye: linear red, green and blue.
    pub radiance: Vec<[f64; 3]>,
    /// Part of the light from behind that comes through.
    pub transmittance: Vec<f64>,
    /// Optical depth.
    pub depth: Vec<f64>,
    /// Of the first sample: the distance from the eye, in metres, at which half of the light from there is lost;
    /// infinite where more comes through.
    pub half: Vec<f64>,
    /// Of the first sample, where there is such a distance: the direction from there in which the density falls fastest, of
    /// length 1; else 0. Empty before [`Picture::find_normals`].
    pub normals: Vec<[f64; 3]>,
    /// Of random paths: squares of the luminance that each found.
    pub squares: Option<Vec<f64>>,
}

impl Film {
    fn new(size: [usize; 2]) -> Film {
        let pixels = size[0] * size[1];
        Film {
            size,
            samples: 0,
            radiance: vec![[0.0; 3]; pixels],
            transmittance: vec![0.0; pixels],
            depth: vec![0.0; pixels],
            half: vec![f64::INFINITY; pixels],
            normals: Vec::new(),
            squares: None,
        }
    }

    /// Each pixel as large as it must be for another size.
    pub fn enlarged(&self, size: [usize; 2]) -> Film {
        let mut film = Film { samples: self.samples, ..Film::new(size) };
        for y in 0..size[1] {
            for x in 0..size[0] {
                let from = y * self.size[1] / size[1] * self.size[0] + x * self.size[0] / size[0];
                let to = y * size[0] + x;
                film.radiance[to] = self.radiance[from];
                film.transmittance[to] = self.transmittance[from];
                film.depth[to] = self.depth[from];
                film.half[to] = self.half[from];
            }
        }
        film
    }
}

impl Film {
    /// Adds what a sample's tiles found, of which those without pixels saw nothing; squares only if they are `whole`.
    fn add(&mut self, found: &[Vec<Pixel>], columns: usize, is_clear: bool, whole: bool) {
        let width = self.size[0];
        let band = TILE * width;
        let is_first = self.samples == 0;
        let light = self.radiance.par_chunks_mut(band).zip(self.transmittance.par_chunks_mut(band));
        let way = self.depth.par_chunks_mut(band).zip(self.half.par_chunks_mut(band));
        let bands = light.zip(way).zip(found.par_chunks(columns));
        bands.for_each(|(((radiance, transmittance), (depth, half)), tiles)| {
            for (tile, pixels) in tiles.iter().enumerate() {
                let left = tile * TILE;
                for row in 0..radiance.len() / width {
                    let places = row * width + left..row * width + width.min(left + TILE);
                    if pixels.is_empty() {
                        transmittance[places].iter_mut().for_each(|sum| *sum += 1.0);
                        continue;
                    }
                    for (at, pixel) in places.zip(&pixels[row * TILE..]) {
                        for (sum, colour) in radiance[at].iter_mut().zip(pixel.radiance.to_array()) {
                            *sum += colour;
                        }
                        let seen = if is_clear { 0.0 } else { pixel.depth };
                        transmittance[at] += libm::exp(-seen);
                        depth[at] += seen;
                        if is_first {
                            half[at] = pixel.half;
                        }
                    }
                }
            }
        });
        let Some(squares) = self.squares.as_mut().filter(|_| whole) else { return };
        for (tile, pixels) in found.iter().enumerate() {
            for (number, pixel) in pixels.iter().enumerate() {
                let x = tile % columns * TILE + number % TILE;
                let y = tile / columns * TILE + number / TILE;
                if x < width && y < self.size[1] {
                    squares[y * width + x] += pixel.radiance.dot(LUMINANCE) * pixel.radiance.dot(LUMINANCE);
                }
            }
        }
    }

    /// Of random paths: the standard error of each pixel's luminance, by the spread of its samples; `None` too before the second,
    /// since one has no spread.
    pub fn errors(&self) -> Option<Vec<f64>> {
        if self.samples < 2 {
            return None;
        }
        let count = f64::from(self.samples);
        let error = |(square, radiance): (&f64, &[f64; 3])| {
            let mean = DVec3::from(*radiance).dot(LUMINANCE) / count;
            let variance = (square / count - mean * mean).max(0.0);
            (variance / (count - 1.0)).sqrt()
        };
        Some(self.squares.as_ref()?.iter().zip(&self.radiance).map(error).collect())
    }

    /// The mean of those over the mean luminance; `None` too where that is 0, and before the second sample.
    pub fn noise(&self) -> Option<f64> {
        let errors: f64 = self.errors()?.iter().sum();
        let light: f64 =
            self.radiance.iter().map(|radiance| DVec3::from(*radiance).dot(LUMINANCE)).sum::<f64>()
                / f64::from(self.samples);
        (errors / light).is_finite().then_some(errors / light)
    }
}

/// A picture in the making.
pub struct Picture<'a> {
    medium: &'a Medium<'a>,
    camera: Camera,
    optics: &'a Optics,
    quality: Quality,
    level: Level,
    tiles: Tiles,
    shadows: Option<Shadows>,
    /// A brick's table where there are no shadows.
    unshadowed: Vec<f32>,
    /// Of random paths, beside which rays see extinction alone.
    tracer: Option<Tracer<'a>>,
    dark: Optics,
    tables: Vec<OnceLock<Box<[f32]>>>,
    film: Film,
}

/// Where in its pixel a sample is: x to the right and y down, each from 0 to 1. The first is in the middle; the others are
/// Roberts' sequence R2 (2018), which fills the square evenly.
fn jitter(sample: u32) -> DVec2 {
    // The reciprocals of the plastic number and of its square.
    let place =
        DVec2::splat(0.5) + f64::from(sample) * DVec2::new(0.754_877_666_246_692_8, 0.569_840_290_998_053_3);
    place - place.floor()
}

impl<'a> Picture<'a> {
    /// Finds what each part of the picture sees, and the shadows.
    pub fn new(
        medium: &'a Medium<'a>,
        camera: Camera,
        optics: &'a Optics,
        quality: Quality,
        level: Level,
    ) -> Picture<'a> {
        let tiles = Tiles::new(&camera, quality.size, medium.grid(), medium.bricks());
        let mut film = Film::new(quality.size);
        let (mut shadows, mut tracer, mut unshadowed) = (None, None, Vec::new());
        match (quality.integrator, quality.shadow) {
            (Integrator::Path { seed }, _) => {
                film.squares = Some(vec![0.0; film.depth.len()]);
                // Nothing collides in what is clear: what glows there is found along the rays.
                tracer = (!optics.is_clear).then(|| Tracer::new(medium, optics, seed, level));
            }
            (Integrator::Single, Shadow::Cached(pitch)) => {
                shadows = Some(Shadows::new(medium, optics, pitch, level));
            }
            (Integrator::Single, Shadow::Exact) => {}
            (Integrator::Single, Shadow::None) => {
                unshadowed = vec![0.0; optics.lamps.len() * COARSE.pow(3)];
            }
        }
        let dark = optics.clone().absorbing();
        let tables = (0..medium.bricks().blocks.len()).map(|_| OnceLock::new()).collect();
        Picture {
            medium,
            camera,
            optics,
            quality,
            level,
            tiles,
            shadows,
            unshadowed,
            tracer,
            dark,
            tables,
            film,
        }
    }

    /// Bytes that [`Picture::new`] and its samples take at most beside the medium and the film, but for shadows of suns that are
    /// swept through voxels, and for what random paths take.
    pub fn memory(medium: &Medium<'_>, camera: &Camera, optics: &Optics, quality: Quality) -> u64 {
        let bricks = medium.bricks();
        let [finding, kept] =
            Tiles::new(camera, quality.size, medium.grid(), bricks).bytes(bricks.blocks.len());
        let [making, shadows] = match (quality.integrator, quality.shadow) {
            (Integrator::Single, Shadow::Cached(pitch)) if !optics.lamps.is_empty() => {
                Shadows::bytes(medium, optics, pitch)
            }
            _ => [0, size_of_val(bricks.blocks.as_slice()) as u64 * 2],
        };
        finding.max(kept + making.max(shadows))
    }

    /// What rays see.
    fn seen_by_rays(&self) -> &Optics {
        if self.tracer.is_some() { &self.dark } else { self.optics }
    }

    /// What there is so far.
    pub fn film(&self) -> &Film {
        &self.film
    }

    /// Takes one more sample of every pixel. `done` is told of every tile, or of none where much has been done since, and says
    /// whether to go on. Where it does not, the sample is given up, and the result is `false`.
    pub fn sample(&mut self, done: impl Fn(usize) -> bool + Sync) -> bool {
        let at = jitter(self.film.samples);
        let deepest = (-libm::log(self.quality.cutoff)).min(DARK);
        let wanted = Wanted { deepest, extinction: self.optics.extinction };
        let idle: Mutex<Vec<Box<(Way, Worker)>>> = Mutex::default();
        let found: Option<Vec<Vec<Pixel>>> = (0..self.tiles.count())
            .into_par_iter()
            .with_max_len(1)
            .map(|tile| {
                let pixels = if self.tiles.seen(tile).is_empty() {
                    Vec::new()
                } else {
                    let mut memory = idle.lock().ok().and_then(|mut idle| idle.pop()).unwrap_or_default();
                    let (way, worker) = &mut *memory;
                    let pixels = self.tile(tile, at, &wanted, way, worker);
                    if let Ok(mut idle) = idle.lock() {
                        idle.push(memory);
                    }
                    pixels
                };
                done(usize::from(self.tracer.is_none())).then_some(pixels)
            })
            .collect();
        let Some(found) = found else { return false };
        let traced = match &self.tracer {
            Some(tracer) => {
                let found = tracer.sample(&self.tiles, &self.camera, at, self.film.samples, &done);
                if found.is_none() {
                    return false;
                }
                found
            }
            None => None,
        };
        self.film.add(&found, self.tiles.columns, self.optics.is_clear, traced.is_none());
        if let Some(found) = traced {
            for (sum, found) in self.film.radiance.iter_mut().zip(&found) {
                *sum = (DVec3::from(*sum) + *found).to_array();
            }
            for (sum, found) in self.film.squares.iter_mut().flatten().zip(&found) {
                *sum += found.dot(LUMINANCE) * found.dot(LUMINANCE);
            }
        }
        self.film.samples += 1;
        true
    }

    /// Finds the normals of what the first sample saw.
    pub fn find_normals(&mut self) {
        let grid = self.medium.grid();
        let size = self.film.size;
        let place = |pixel: usize| {
            let half = self.film.half[pixel];
            let ray = self.camera.ray(self.tiles.place([pixel % size[0], pixel / size[0]], jitter(0)));
            half.is_finite().then(|| grid.to_grid(ray.at(half)))
        };
        let pixels = 0..size[0] * size[1];
        let found: Vec<(usize, DVec3)> =
            pixels.clone().filter_map(|pixel| Some((pixel, place(pixel)?))).collect();
        // Differences over a cell: of voxels, the slope between those on both sides.
        let places: Vec<DVec3> = found
            .iter()
            .flat_map(|(_, place)| {
                DVec3::AXES.into_iter().flat_map(|axis| {
                    [*place - 0.5 * axis, *place + 0.5 * axis].map(|place| grid.to_world(place))
                })
            })
            .collect();
        let densities = self.medium.density_at(&places, self.level);
        self.film.normals = vec![[0.0; 3]; pixels.len()];
        for ((pixel, _), around) in found.iter().zip(densities.chunks_exact(6)) {
            let slope = |axis: usize| f64::from(around[2 * axis + 1]) - f64::from(around[2 * axis]);
            let gradient = grid.gradient(DVec3::new(slope(0), slope(1), slope(2)));
            self.film.normals[*pixel] = (-gradient).normalize_or_zero().to_array();
        }
    }

    /// Number of tiles.
    pub fn tiles(&self) -> usize {
        self.tiles.count()
    }

    /// What the rays of a tile see, of the sample at a place in each pixel.
    pub(super) fn tile(
        &self,
        tile: usize,
        at: DVec2,
        wanted: &Wanted,
        way: &mut Way,
        worker: &mut Worker,
    ) -> Vec<Pixel> {
        let seen = self.tiles.seen(tile);
        let grid = self.medium.grid();
        let optics = self.seen_by_rays();
        let caster = Caster { medium: self.medium, optics, level: self.level };
        way.rays.begin(grid, optics.lamps.len(), self.tiles.rays(tile, &self.camera, at));
        self.medium.begin(way, wanted, worker);
        for seen in seen {
            if way.rays.is_done() {
                break;
            }
            let number = seen.brick as usize;
            let block = self.medium.bricks().blocks[number];
            let table: &[f32] = match &self.shadows {
                Some(shadows) if !optics.lamps.is_empty() => {
                    self.tables[number].get_or_init(|| shadows.table(grid, number, block, self.level))
                }
                _ => &self.unshadowed,
            };
            let plain = if self.unshadowed.is_empty() { FINE } else { COARSE };
            let edge = self.shadows.as_ref().map_or(plain, |shadows| shadows.edge);
            let mut lit = Lit::new(optics, grid, block, table, edge);
            let towards = |lamp: usize, places: &_, wanted| caster.depths(block, lamp, places, wanted);
            if self.quality.shadow == Shadow::Exact && !optics.lamps.is_empty() {
                lit.exact = Some(&towards);
            }
            let brick = Brick { block, seen, wanted, lit: &lit };
            self.medium.carry(self.level, brick, way, worker);
        }
        let uniform = optics.uniform_source();
        let rays = &way.rays;
        (0..RAYS)
            .map(|ray| {
                let depth = rays.depth[ray];
                let of = if depth > 0.0 { self.tiles.ray(tile, ray, &self.camera, at) } else { None };
                let Some(of) = of else { return Pixel::default() };
                let mut radiance = uniform * -libm::expm1(-depth);
                for (lamp, light) in optics.lamps.iter().zip(&rays.light) {
                    let towards = match lamp {
                        Lamp::Sun { direction, .. } => phase(optics.anisotropy, *direction, -of.direction),
                        Lamp::Point { .. } => 1.0,
                    };
                    radiance += optics.albedo * lamp.colour() * (towards * light[ray]);
                }
                Pixel { radiance, depth, half: rays.half[ray] * f64::from(rays.metres[ray]) }
            })
            .collect()
    }
}

/// What a ray saw.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Pixel {
    radiance: DVec3,
    depth: f64,
    half: f64,
}

impl Default for Pixel {
    fn default() -> Pixel {
        Pixel { radiance: DVec3::ZERO, depth: 0.0, half: f64::INFINITY }
    }
}

impl Tiles {
    /// A place in a pixel as cameras have it.
    fn place(&self, pixel: [usize; 2], at: DVec2) -> DVec2 {
        #[allow(clippy::cast_precision_loss, reason = "pictures are far smaller")]
        let part = |axis: usize| 2.0 * (pixel[axis] as f64 + at[axis]) / self.size[axis] as f64 - 1.0;
        DVec2::new(part(0), -part(1))
    }

    /// The rays of a tile's pixels, in rows; of those beyond the picture's border there are none.
    pub(super) fn rays(&self, tile: usize, camera: &Camera, at: DVec2) -> impl Iterator<Item = Option<Ray>> {
        (0..RAYS).map(move |number| self.ray(tile, number, camera, at))
    }

    fn ray(&self, tile: usize, number: usize, camera: &Camera, at: DVec2) -> Option<Ray> {
        let corner = self.corner(tile);
        let pixel = [corner[0] + number % TILE, corner[1] + number / TILE];
        let is_inside = pixel[0] < self.size[0] && pixel[1] < self.size[1];
        is_inside.then(|| camera.ray(self.place(pixel, at)))
    }
}
