//! Light that is scattered again and again, without bias: paths of particles from the eye.
//!
//! A particle flies through the medium as if it were as dense as its bricks' majorants; where it would collide, it does so
//! with the chance that the true density has there (Woodcock et al., 1965). At a collision it gathers what is emitted there
//! and, from one of the lamps, what arrives there and is scattered towards where it came from; it goes on in a direction by
//! the phase function. Ambient light is what a scattered particle sees that leaves the medium.

use glam::{DVec2, DVec3};
use rayon::prelude::*;

use super::camera::{Camera, Ray};
use super::majorant::{Event, Flight, Guided, Majorants, Piece};
use super::medium::Medium;
use super::optics::{Lamp, Optics, phase};
use super::points::Spot;
use super::random::Random;
use super::tiles::{TILE, Tiles};
use super::track;
use crate::num::Level;

/// Paths that are on their way at once where a scene's density is evaluated: enough for many of them to be in each brick.
const AT_ONCE: usize = 1 << 16;
/// A path is ended by chance only after so many collisions.
const SURE: u64 = 3;
/// From so many collisions on, a power of two, every other path is ended each time that their number has doubled, and the
/// others count twice: so the mean number grows with the logarithm of what it would be, however dense and white the medium.
const MANY: u64 = 256;
/// Beyond this optical depth no lamp is seen.
const DEEPEST: f64 = 90.0;

/// What follows paths.
#[derive(Debug)]
pub(super) struct Tracer<'a> {
    medium: &'a Medium<'a>,
    optics: &'a Optics,
    majorants: Majorants,
    seed: u64,
    level: Level,
}

/// What a particle is doing.
#[derive(Debug, Clone, Copy)]
enum Doing {
    /// It flies to its next collision.
    Fly,
    /// From its last collision it asks how much of this light of a lamp comes through.
    Light { light: DVec3, transmittance: f64, from: DVec3 },
    /// Its path has ended.
    Rest,
}

#[derive(Debug, Clone, Copy)]
struct Path {
    pixel: usize,
    random: Random,
    /// Where it flies, and its flight: to the lamp if it asks for its light.
    ray: Ray,
    flight: Flight,
    doing: Doing,
    throughput: DVec3,
    radiance: DVec3,
    collisions: u64,
    /// The place whose density it waits for, and that.
    waits: Option<Event>,
    density: f64,
}

impl<'a> Tracer<'a> {
    pub(super) fn new(medium: &'a Medium<'a>, optics: &'a Optics, seed: u64, level: Level) -> Tracer<'a> {
        Tracer { medium, optics, majorants: Majorants::new(medium), seed, level }
    }

    fn guided(&self) -> Guided<'_> {
        let extinction = self.optics.extinction;
        Guided { medium: self.medium, majorants: &self.majorants, extinction, is_regular: true }
    }

    /// One path for every pixel of a picture: the radiance that each finds, in rows from the top. `at` is where in their pixels
    /// the paths of this sample begin. `done` is told of tiles, and says whether to go on; `None` where it did not.
    pub(super) fn sample(
        &self,
        tiles: &Tiles,
        camera: &Camera,
        at: DVec2,
        sample: u32,
        done: &(impl Fn(usize) -> bool + Sync),
    ) -> Option<Vec<DVec3>> {
        let mut radiance = vec![DVec3::ZERO; tiles.size[0] * tiles.size[1]];
        let start = |tile: usize| -> Vec<Path> {
            if tiles.seen(tile).is_empty() {
                return Vec::new();
            }
            let corner = tiles.corner(tile);
            let rays = tiles.rays(tile, camera, at).enumerate();
            rays.filter_map(|(number, ray)| {
                let [x, y] = [corner[0] + number % TILE, corner[1] + number / TILE];
                Some(self.start(y * tiles.size[0] + x, sample, ray?))
            })
            .collect()
        };
        if matches!(self.medium, Medium::Baked(_)) {
            let found: Option<Vec<Vec<(usize, DVec3)>>> = (0..tiles.count())
                .into_par_iter()
                .with_max_len(1)
                .map(|tile| {
                    let mut paths = start(tile);
                    for path in &mut paths {
                        self.follow(path, done)?;
                    }
                    let found = paths.iter().map(|path| (path.pixel, path.radiance)).collect();
                    done(1).then_some(found)
                })
                .collect();
            for (pixel, found) in found?.into_iter().flatten() {
                radiance[pixel] = found;
            }
            return Some(radiance);
        }
        let mut paths: Vec<Path> = Vec::new();
        let mut tile = 0;
        loop {
            let first = tile;
            while tile < tiles.count() && paths.len() < AT_ONCE {
                paths.extend(start(tile));
                tile += 1;
            }
            if !done(tile - first) {
                return None;
            }
            if paths.is_empty() {
                return Some(radiance);
            }
            paths.par_iter_mut().with_min_len(64).for_each(|path| self.advance(path));
            paths.retain(|path| {
                if path.waits.is_none() {
                    radiance[path.pixel] = path.radiance;
                }
                path.waits.is_some()
            });
            let spots: Vec<Spot> = paths.iter().filter_map(Path::spot).collect();
            for (path, density) in paths.iter_mut().zip(self.medium.densities_at(&spots, self.level)) {
                path.density = f64::from(density);
            }
        }
    }

    fn start(&self, pixel: usize, sample: u32, ray: Ray) -> Path {
        Path {
            pixel,
            random: Random::new(self.seed, pixel as u64, u64::from(sample)),
            ray,
            flight: self.flight(&ray, [0.0, f64::INFINITY]),
            doing: Doing::Fly,
            throughput: DVec3::ONE,
            radiance: DVec3::ZERO,
            collisions: 0,
            waits: None,
            density: 0.0,
        }
    }

    fn flight(&self, ray: &Ray, range: [f64; 2]) -> Flight {
        Flight::new(&self.guided(), &self.medium.grid().ray(ray), range)
    }

    /// To its end, through voxels; `None` where that is not asked for any more.
    fn follow(&self, path: &mut Path, done: &impl Fn(usize) -> bool) -> Option<()> {
        loop {
            self.advance(path);
            let Some(spot) = path.spot() else { return done(0).then_some(()) };
            if let Medium::Baked(baked) = self.medium {
                path.density = f64::from(baked.density(&spot));
            }
        }
    }

    /// On to the next place where it waits for a density; it waits for none where it has ended.
    fn advance(&self, path: &mut Path) {
        match path.waits.take() {
            Some(Event::Tentative(at)) => match &mut path.doing {
                Doing::Fly => {
                    if path.random.next() * at.majorant < path.density {
                        self.collide(path, at.at);
                    }
                }
                Doing::Light { transmittance, .. } => {
                    if !track::pass(transmittance, &at, path.density, &mut path.random) {
                        self.arrive(path);
                    }
                }
                Doing::Rest => {}
            },
            Some(Event::Sample(..)) => {
                if let Some(piece) = path.flight.tell(path.density, &self.guided()) {
                    self.pass(path, &piece);
                }
            }
            Some(Event::Collision(_)) | None => {}
        }
        while !matches!(path.doing, Doing::Rest) {
            match path.flight.next(&self.guided(), &mut path.random) {
                Some(Event::Collision(at)) => self.collide(path, at),
                Some(event) => {
                    path.waits = Some(event);
                    return;
                }
                None => self.arrive(path),
            }
        }
    }

    /// Through a piece of its way whose density is known, or into a collision in it.
    fn pass(&self, path: &mut Path, piece: &Piece) {
        let depth = self.optics.extinction * piece.depth();
        match &mut path.doing {
            Doing::Fly => {
                let left = path.random.exponential();
                if left < depth {
                    self.collide(path, piece.place(left / depth * piece.depth()));
                }
            }
            Doing::Light { transmittance, .. } => {
                *transmittance *= libm::exp(-depth);
                if !track::survives(transmittance, &mut path.random) {
                    self.arrive(path);
                }
            }
            Doing::Rest => {}
        }
    }

    /// At the end of its way.
    fn arrive(&self, path: &mut Path) {
        match path.doing {
            Doing::Fly => {
                if path.collisions > 0 {
                    path.radiance += path.throughput * self.optics.ambient;
                }
                path.doing = Doing::Rest;
            }
            Doing::Light { light, transmittance, from } => {
                path.radiance += light * transmittance;
                self.scatter(path, from);
            }
            Doing::Rest => {}
        }
    }

    fn collide(&self, path: &mut Path, at: f64) {
        let optics = self.optics;
        let place = path.ray.at(at);
        path.radiance += path.throughput * optics.emission / optics.extinction;
        path.throughput *= optics.albedo;
        path.collisions += 1;
        let left = path.throughput.max_element();
        if left <= 0.0 {
            path.doing = Doing::Rest;
            return;
        }
        if path.collisions > SURE && left < 1.0 {
            if path.random.next() >= left {
                path.doing = Doing::Rest;
                return;
            }
            path.throughput /= left;
        }
        if path.collisions >= MANY && path.collisions.is_power_of_two() {
            if path.random.next() < 0.5 {
                path.doing = Doing::Rest;
                return;
            }
            path.throughput *= 2.0;
        }
        if optics.lamps.is_empty() {
            self.scatter(path, place);
            return;
        }
        #[allow(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            clippy::cast_precision_loss,
            reason = "there are few lamps"
        )]
        let (lamp, count) = {
            let count = optics.lamps.len() as f64;
            let number = if optics.lamps.len() > 1 { (path.random.next() * count) as usize } else { 0 };
            (&optics.lamps[number.min(optics.lamps.len() - 1)], count)
        };
        let (ray, range) = lamp.from(place);
        let falloff = match lamp {
            Lamp::Sun { .. } => 1.0,
            Lamp::Point { .. } => 1.0 / (range[1] * range[1]).max(1e-30),
        };
        let towards = phase(optics.anisotropy, path.ray.direction, ray.direction);
        let light = path.throughput * lamp.colour() * (towards * falloff * count);
        if let Medium::Baked(baked) = self.medium {
            let depth = baked.depth(&ray, range, optics.extinction, DEEPEST);
            path.radiance += light * libm::exp(-depth);
            self.scatter(path, place);
        } else {
            path.doing = Doing::Light { light, transmittance: 1.0, from: place };
            path.flight = self.flight(&ray, range);
        }
    }

    /// Goes on in another direction.
    fn scatter(&self, path: &mut Path, from: DVec3) {
        let direction = scattered(self.optics.anisotropy, path.ray.direction, &mut path.random);
        path.ray = Ray { origin: from, direction };
        path.flight = self.flight(&path.ray, [0.0, f64::INFINITY]);
        path.doing = Doing::Fly;
    }
}

impl Path {
    /// The place that it waits for the density of.
    fn spot(&self) -> Option<Spot> {
        self.waits?.spot(&self.flight.walk)
    }
}

/// A direction by Henyey and Greenstein's phase function of mean cosine g around another: of length 1 both.
fn scattered(g: f64, along: DVec3, random: &mut Random) -> DVec3 {
    let (x, turn) = (random.next(), random.next());
    // 1 - cos, by the inverse of the distribution, without differences of almost equal numbers.
    let narrow = 1.0 - g + 2.0 * g * x;
    let away = (1.0 - g) * (1.0 - g) * (1.0 - x) * ((1.0 + g) / narrow + 1.0) / narrow;
    let (cos, sin) = (1.0 - away, (away * (2.0 - away)).max(0.0).sqrt());
    let (sine, cosine) = libm::sincos(std::f64::consts::TAU * turn);
    let (u, v) = along.any_orthonormal_pair();
    (along * cos + (u * cosine + v * sine) * sin).normalize()
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "what is not there fails the test")]

    use super::super::testing::{
        How, baked, camera, film, grey, mean, noisy, patchy, procedural, rough, solid, sun, through,
    };
    use super::super::{Integrator, Picture, Quality, Shadow};
    use super::*;
    use crate::volume::testing::tree;

    fn paths(seed: u64) -> [How; 2] {
        [How::Plain, How::Paths(seed)]
    }

    /// Directions have the phase function's mean cosine, and the mean of its square.
    #[test]
    fn directions_follow_the_phase_function() {
        for g in [-0.9, -1e-6, 0.0, 0.3, 0.99] {
            let along = DVec3::new(0.3, -0.5, 0.2).normalize();
            let n = 20_000;
            let mut random = Random::new(1, 2, 3);
            let mut sums = [DVec3::ZERO; 2];
            for _ in 0..n {
                let direction = scattered(g, along, &mut random);
                assert!((direction.length() - 1.0).abs() < 1e-12);
                let cos = direction.dot(along);
                sums[0] += direction;
                sums[1].x += cos * cos;
            }
            let [mean, square] = sums.map(|sum| sum / f64::from(n));
            // Both are at most 1, so their standard errors at most 1 / sqrt n.
            let error = 4.0 / f64::from(n).sqrt();
            assert!((mean - along * g).length() < error, "{g}: {mean}");
            assert!((square.x - (1.0 + 2.0 * g * g) / 3.0).abs() < error, "{g}: {}", square.x);
        }
    }

    /// What scatters or emits as much as it extinguishes, in light that is 1 from everywhere, cannot be seen.
    #[test]
    fn furnaces_are_even() {
        let tree = rough(&patchy(), 5.0);
        let field = noisy();
        for medium in [baked(&tree), procedural(&field, 1.0)] {
            for (extinction, albedo) in
                [(2.0, DVec3::ONE), (20.0, DVec3::ONE), (5.0, DVec3::new(0.9, 0.5, 0.0))]
            {
                let optics = Optics {
                    albedo,
                    emission: (DVec3::ONE - albedo) * extinction,
                    anisotropy: 0.4,
                    ambient: DVec3::ONE,
                    ..grey(extinction)
                };
                let film = film(&medium, camera(DVec3::new(0.2, 1.0, -0.3), 1.2), &optics, paths(3), 16);
                let [light, error] = mean(&film);
                let through = through(&film);
                assert!(through < 0.9 && error < 0.01, "{through}, +- {error}");
                assert!((light + through - 1.0).abs() < 3.0 * error + 1e-6, "{light} + {through} +- {error}");
            }
        }
    }

    /// Where next to nothing is scattered twice, paths find what the other integrator does.
    #[test]
    fn single_scattering_is_that_of_the_other_integrator() {
        // Voxels so smooth that the other integrator's segments do for them.
        let tree = tree(0.0, &solid(), &[], |at| {
            let place = DVec3::from(at.map(f64::from)) - DVec3::new(1.0, -0.5, 0.3);
            crate::march::rays::single(5.0 * libm::exp(-place.length_squared() / 18.0))
        });
        let field = noisy();
        let point =
            Lamp::Point { position: DVec3::new(1.0, -1.5, 0.6), intensity: DVec3::new(1.0, 4.0, 2.0) };
        for medium in [baked(&tree), procedural(&field, 0.5)] {
            for lamps in [vec![sun(DVec3::new(1.0, 0.5, -0.7))], vec![sun(DVec3::NEG_Z), point]] {
                let optics = Optics { albedo: DVec3::splat(1e-4), anisotropy: 0.3, lamps, ..grey(4.0) };
                let camera = camera(DVec3::Y, 0.9);
                let single = mean(&film(&medium, camera, &optics, [How::Exact, How::Plain], 8))[0];
                let [light, error] = mean(&film(&medium, camera, &optics, paths(1), 32));
                // The other integrator's segments, beside the noise.
                let tolerance = 3.0 * error + 5e-3 * single;
                assert!(error < 0.02 * single, "{light} +- {error}");
                assert!((light - single).abs() < tolerance, "{light} +- {error}, not {single}");
            }
        }
    }

    /// The bits do not depend on threads; the noise does on the seed.
    #[test]
    fn pictures_are_the_same_by_any_number_of_threads() {
        let tree = rough(&solid(), 5.0);
        let field = noisy();
        for medium in [baked(&tree), procedural(&field, 1.0)] {
            let optics = Optics { albedo: DVec3::splat(0.9), lamps: vec![sun(DVec3::NEG_Z)], ..grey(8.0) };
            let picture = |threads: usize, seed: u64| {
                let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
                pool.install(|| film(&medium, camera(DVec3::Y, 0.9), &optics, paths(seed), 2))
            };
            let one = picture(1, 7);
            assert_eq!(picture(3, 7), one);
            assert_ne!(picture(1, 8).radiance, one.radiance);
        }
    }

    /// However dense a medium is, paths come to an end, and none of the light is lost: in light that is 1 from everywhere, what
    /// scatters or emits all of it cannot be seen.
    #[test]
    fn stiff_media_are_even_too() {
        let tree = rough(&solid(), 5.0);
        let field = noisy();
        for medium in [baked(&tree), procedural(&field, 1.0)] {
            for extinction in [1e3, 1e6, 1e9] {
                // White voxels alone: in a scene the few paths that are scattered a hundred thousand times take long.
                let albedos = if matches!(medium, Medium::Baked(_)) { &[0.9, 1.0][..] } else { &[0.9] };
                for &albedo in albedos {
                    let optics = Optics {
                        albedo: DVec3::splat(albedo),
                        emission: DVec3::splat(1.0 - albedo) * extinction,
                        ambient: DVec3::ONE,
                        anisotropy: 0.4,
                        ..grey(extinction)
                    };
                    let film = film(&medium, camera(DVec3::new(0.2, 1.0, -0.3), 1.2), &optics, paths(3), 4);
                    let ([light, error], through) = (mean(&film), through(&film));
                    // Of what nothing absorbs, a few parts in a hundred are scattered hundreds of times, and some of the paths that
                    // stand for many of these may be missing.
                    let missing = if albedo < 1.0 { 0.0 } else { 0.05 };
                    assert!(through < 0.8 && error < 0.1, "{extinction}: {through}, +- {error}");
                    assert!(
                        (light + through - 1.0).abs() < 3.5 * error + missing,
                        "{extinction}, {albedo}: {light} + {through} +- {error}"
                    );
                }
            }
        }
    }

    /// What is scattered once by a stiff medium is what the other integrator finds with a ray for every shadow: of voxels
    /// exactly, of a scene but for what changes within a step.
    #[test]
    fn stiff_media_are_lit_as_by_the_other_integrator() {
        let tree = rough(&solid(), 5.0);
        let field = noisy();
        for (medium, within) in [(baked(&tree), 0.02), (procedural(&field, 0.5), 0.02)] {
            for extinction in [3e3, 1e5] {
                let lamps = vec![sun(DVec3::new(1.0, 0.5, -0.7))];
                let optics = Optics { albedo: DVec3::splat(1e-3), lamps, ..grey(extinction) };
                let camera = camera(DVec3::Y, 0.9);
                let single = mean(&film(&medium, camera, &optics, [How::Exact, How::Plain], 8))[0];
                let [light, error] = mean(&film(&medium, camera, &optics, paths(1), 32));
                assert!(error < 0.02 * single, "{extinction}: {light} +- {error}");
                assert!(
                    (light - single).abs() < 3.0 * error + within * single,
                    "{extinction}: {light} +- {error}, not {single}"
                );
            }
        }
    }

    /// A pass that is given up leaves the picture as it was.
    #[test]
    fn a_pass_may_be_given_up() {
        let tree = rough(&solid(), 5.0);
        let field = noisy();
        for medium in [baked(&tree), procedural(&field, 1.0)] {
            let optics = Optics { albedo: DVec3::splat(0.9), lamps: vec![sun(DVec3::NEG_Z)], ..grey(8.0) };
            let quality = Quality {
                size: [80; 2],
                samples: 2,
                cutoff: 1e-4,
                shadow: Shadow::Exact,
                integrator: Integrator::Path { seed: 1 },
            };
            let mut picture = Picture::new(&medium, camera(DVec3::Y, 0.9), &optics, quality, Level::best());
            assert!(picture.sample(|_| true));
            let film = picture.film().clone();
            for limit in [0, 2, 12] {
                let asked = std::sync::atomic::AtomicUsize::new(0);
                let goes_on = |_| asked.fetch_add(1, std::sync::atomic::Ordering::SeqCst) < limit;
                assert!(!picture.sample(goes_on));
                assert_eq!(picture.film(), &film);
            }
            assert!(picture.sample(|_| true));
        }
    }

    /// Of light from everywhere no more comes back than arrives, and the less the more is absorbed.
    #[test]
    fn energy_is_not_made() {
        let medium = baked(&rough(&solid(), 5.0));
        let mut last = 1.0;
        for albedo in [0.99, 0.8, 0.3] {
            let optics = Optics { albedo: DVec3::splat(albedo), ambient: DVec3::ONE, ..grey(10.0) };
            let film = film(&medium, camera(DVec3::Y, 0.7), &optics, paths(1), 16);
            let light = mean(&film)[0] + through(&film);
            assert!(light < last);
            last = light;
        }
    }
}
