//! Media and pictures that tests share.
#![allow(clippy::unwrap_used, reason = "what is not there fails the test")]

use glam::{DVec2, DVec3};

use super::{
    Baked, Camera, Film, Grid, Integrator, Lamp, Meaning, Medium, Optics, Picture, Procedural, Quality,
    Shadow,
};
use crate::field::{Field, Lattice};
use crate::num::Level;
use crate::scene::Scene;
use crate::volume::Tree;
use crate::volume::testing::{random, tree};

/// Edge of a cell in metres.
pub(super) const H: f64 = 0.05;

/// Leaves in a cube around the origin, some of them missing, and one in another node.
pub(super) fn patchy() -> Vec<[i32; 3]> {
    let near = (0..64).map(|n| [n / 16 * 8 - 16, n / 4 % 4 * 8 - 16, n % 4 * 8 - 16]);
    let mut leaves: Vec<[i32; 3]> = near.filter(|&[x, y, z]| (x + 2 * y + z) % 24 != 0).collect();
    leaves.push([160, 8, 0]);
    leaves
}

/// Leaves that fill a cube around the origin.
pub(super) fn solid() -> Vec<[i32; 3]> {
    (0..8).map(|n| [n / 4 * 8 - 8, n / 2 % 2 * 8 - 8, n % 2 * 8 - 8]).collect()
}

/// A tree with a density of its own, up to `most`, at every voxel of leaves.
pub(super) fn rough(leaves: &[[i32; 3]], most: f32) -> Tree<f32> {
    let mut state = 3;
    tree(0.0, leaves, &[], |_| {
        // Some of them empty.
        let value = f32::from(u16::try_from(random(&mut state) >> 48).unwrap()) / 65536.0;
        if value < 0.3 { 0.0 } else { value * most }
    })
}

pub(super) fn baked(tree: &Tree<f32>) -> Medium<'static> {
    Medium::Baked(Baked::new(tree, Grid::cubic(H), Meaning::Density, u64::MAX).unwrap())
}

/// A bent tube of noise, half a metre wide and two long.
pub(super) fn noisy() -> Field {
    let text = "[[tube]]\ncurve = { kind = \"quadratic\", points = [[0, 0, -1], [0.5, 0, 0], [0, 0, 1]] }\nradius = 0.5\n\
                [[tube.layer]]\nop = \"multiply\"\nnoise = \"perlin\"\noctaves = 3\nfrequency = [2, 2, 5]\nthreshold = -0.3\n";
    Field::compile(&Scene::parse(text, "scene.toml").unwrap())
}

pub(super) fn procedural(field: &Field, step: f64) -> Medium<'_> {
    Medium::Procedural(Procedural::new(field, Lattice { voxel_size: H }, step, u64::MAX).unwrap())
}

/// Only extinction.
pub(super) fn grey(extinction: f64) -> Optics {
    Optics {
        extinction,
        is_clear: false,
        albedo: DVec3::ZERO,
        anisotropy: 0.0,
        emission: DVec3::ZERO,
        lamps: Vec::new(),
        ambient: DVec3::ZERO,
    }
}

pub(super) fn sun(direction: DVec3) -> Lamp {
    Lamp::Sun { direction: direction.normalize(), irradiance: DVec3::new(3.0, 2.0, 1.0) }
}

/// A camera that looks from one place to another, and sees so much to each side: at distance 1, or in metres.
pub(super) fn looking(eye: DVec3, at: DVec3, half: f64, is_orthographic: bool) -> Camera {
    let forward = (at - eye).normalize();
    let right = forward.any_orthonormal_vector();
    Camera { eye, forward, right, up: right.cross(forward), half: DVec2::splat(half), is_orthographic }
}

/// A camera of parallel rays along `forward`, on the origin, that sees a square of `width` metres.
pub(super) fn camera(forward: DVec3, width: f64) -> Camera {
    looking(forward.normalize() * -4.0, DVec3::ZERO, 0.5 * width, true)
}

/// All samples of a picture.
pub(super) fn shoot(medium: &Medium<'_>, camera: Camera, optics: &Optics, quality: Quality) -> Film {
    let mut picture = Picture::new(medium, camera, optics, quality, Level::best());
    for _ in 0..quality.samples {
        picture.sample(|_| true);
    }
    picture.film().clone()
}

/// A picture of 24 x 24 pixels.
pub(super) fn film(
    medium: &Medium<'_>,
    camera: Camera,
    optics: &Optics,
    [shadow, integrator]: [How; 2],
    samples: u32,
) -> Film {
    let shadow = if shadow == How::Exact { Shadow::Exact } else { Shadow::Cached(1.0) };
    let integrator = match integrator {
        How::Paths(seed) => Integrator::Path { seed },
        _ => Integrator::Single,
    };
    shoot(medium, camera, optics, Quality { size: [24; 2], samples, cutoff: 1e-7, shadow, integrator })
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum How {
    Plain,
    Exact,
    Paths(u64),
}

/// The mean over pixels of a film's luminance, and its standard error.
pub(super) fn mean(film: &Film) -> [f64; 2] {
    #[allow(clippy::cast_precision_loss, reason = "small")]
    let (pixels, samples) = (film.depth.len() as f64, f64::from(film.samples));
    let light = |radiance: &[f64; 3]| DVec3::from(*radiance).dot(super::display::LUMINANCE) / samples;
    let sum: f64 = film.radiance.iter().map(light).sum();
    let errors = film.errors().unwrap_or_default();
    let variance: f64 = errors.iter().map(|error| error * error).sum();
    [sum / pixels, variance.sqrt() / pixels]
}

/// The mean transmittance.
pub(super) fn through(film: &Film) -> f64 {
    #[allow(clippy::cast_precision_loss, reason = "small")]
    let pixels = film.depth.len() as f64;
    film.transmittance.iter().sum::<f64>() / pixels / f64::from(film.samples)
}
