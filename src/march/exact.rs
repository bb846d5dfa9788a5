//! Shadows without a table: a ray from every sample to every lamp.
//!
//! Along a segment of the optical depth D the lamp's own optical depth is taken to change linearly with it, from D0 to D1,
//! and what else dims the lamp, G, likewise. With x = D + D1 - D0 the segment sends
//!
//! ```text
//! D e^-D0 (a G0 + b G1) / x           a, b: the weights of a segment of the optical depth x (module segment)
//! ```
//!
//! to the eye; where x is negative the ends change places. So light that comes from the eye's side or from the opposite one
//! is gathered exactly, however long the segments. Each is taken in two halves, since elsewhere the shadow changes with the
//! way rather than with the depth.

use super::camera::Ray;
use super::grid::{EDGE, Grid};
use super::medium::Medium;
use super::optics::{Lamp, Optics};
use super::rays::{LANES, single};
use super::segment::Weights;
use super::shade::{Group, Lit};
use crate::num::{Level, Real};
use glam::DVec3;

/// Beyond this optical depth nothing is lit.
const DEEPEST: f64 = 90.0;

/// The optical depths between a lamp, by its number, and places of a brick, in cells from its corner: a bit for each lane
/// that asks.
pub(super) type Towards<'a> = dyn Fn(usize, &[[f32; LANES]; 3], u32) -> [f32; LANES] + 'a;

/// What casts exact shadows.
#[derive(Debug, Clone, Copy)]
pub(super) struct Caster<'a> {
    pub(super) medium: &'a Medium<'a>,
    pub(super) optics: &'a Optics,
    pub(super) level: Level,
}

impl Caster<'_> {
    /// See [`Towards`].
    pub(super) fn depths(
        &self,
        block: [i32; 3],
        lamp: usize,
        places: &[[f32; LANES]; 3],
        wanted: u32,
    ) -> [f32; LANES] {
        let grid: &Grid = self.medium.grid();
        let corner = DVec3::from(block.map(|c| f64::from(c) * f64::from(EDGE)));
        let mut depths = [0.0; LANES];
        let Some(lamp) = self.optics.lamps.get(lamp) else { return depths };
        let (mut rays, mut lanes) = (Vec::with_capacity(LANES), Vec::with_capacity(LANES));
        for lane in (0..LANES).filter(|lane| wanted >> lane & 1 == 1) {
            let local = DVec3::from([0, 1, 2].map(|axis: usize| f64::from(places[axis][lane])));
            rays.push(lamp.from(grid.to_world(corner + local)));
            lanes.push(lane);
        }
        let found = self.medium.optical_depths(&rays, self.optics.extinction, DEEPEST, self.level);
        for (lane, depth) in lanes.into_iter().zip(found) {
            depths[lane] = single(depth);
        }
        depths
    }
}

impl Lamp {
    /// The ray from a point to the lamp, and the part of it on the way.
    pub(super) fn from(&self, point: DVec3) -> (Ray, [f64; 2]) {
        match self {
            Lamp::Sun { direction, .. } => {
                (Ray { origin: point, direction: -*direction }, [0.0, f64::INFINITY])
            }
            Lamp::Point { position, .. } => {
                let away = *position - point;
                let distance = away.length();
                let direction = away.try_normalize().unwrap_or(DVec3::X);
                (Ray { origin: point, direction }, [0.0, distance])
            }
        }
    }
}

/// The part of a segment's optical depth that its first half has, from the densities at Gauss's two places in it: as if the
/// density changed linearly.
#[inline(always)]
pub(super) fn first_half<R: Real<Scalar = f32>>(token: R::Token, near: R, far: R) -> R {
    let sum = (near + far).most(R::constant(token, 1e-30));
    let half = R::constant(token, 0.5);
    let lean = (far - near) / sum * R::constant(token, 0.25 * 3.0_f64.sqrt());
    (half - lean).within(R::constant(token, 0.0), R::constant(token, 1.0))
}

impl<R: Real<Scalar = f32>> Group<R> {
    /// What a segment that begins where the rays are, and the lamps with exact shadows, add.
    #[inline(always)]
    pub(super) fn gather_exactly(
        &mut self,
        token: R::Token,
        lit: &Lit<'_>,
        towards: &Towards<'_>,
        length: R,
        depth: R,
    ) {
        let middle = self.at + length * R::constant(token, 0.5);
        let first = depth * self.first;
        self.gather_half(token, lit, towards, [self.at, middle], first);
        self.gather_half(token, lit, towards, [middle, self.at + length], depth - first);
    }

    #[inline(always)]
    fn gather_half(
        &mut self,
        token: R::Token,
        lit: &Lit<'_>,
        towards: &Towards<'_>,
        [at, next]: [R; 2],
        depth: R,
    ) {
        let zero = R::constant(token, 0.0);
        let going = R::bitmask(self.at.lt(self.end));
        for lamp in 0..lit.lamps {
            let near =
                if self.is_known { self.source[lamp] } else { self.towards(token, towards, lamp, at, going) };
            let far = self.towards(token, towards, lamp, next, going);
            let (dimmed_near, dimmed_far) =
                (self.lamp(token, lit, lamp, at), self.lamp(token, lit, lamp, next));
            let more = depth + (far - near);
            let turns = more.lt(zero);
            let whole = more.abs().most(R::constant(token, 1e-6));
            let weights = Weights::new(token, whole);
            let least = R::select(turns, far + depth, near);
            let light = (least * R::constant(token, -std::f64::consts::LOG2_E)).exp2(token);
            let [first, last] =
                [R::select(turns, dimmed_far, dimmed_near), R::select(turns, dimmed_near, dimmed_far)];
            let gathered = light * (depth / whole) * (first * weights.near + last * weights.far);
            self.light[lamp] = self.light[lamp] + self.transmittance * gathered;
            self.source[lamp] = far;
        }
        self.is_known = true;
        let through = (depth * R::constant(token, -std::f64::consts::LOG2_E)).exp2(token);
        self.transmittance = self.transmittance * through;
    }

    #[inline(always)]
    fn towards(&self, token: R::Token, towards: &Towards<'_>, lamp: usize, at: R, going: u32) -> R {
        let mut places = [[0.0; LANES]; 3];
        let [x, y, z] = &mut places;
        (self.position[0] + at * self.direction[0]).store(x);
        (self.position[1] + at * self.direction[1]).store(y);
        (self.position[2] + at * self.direction[2]).store(z);
        R::load(token, &towards(lamp, &places, going))
    }
}

#[cfg(test)]
mod tests {
    use super::super::testing::{How, baked, camera, film, grey, mean, noisy, procedural, rough, solid, sun};
    use super::super::{Film, Optics};
    use super::*;
    use crate::march::optics::phase;

    const EXACT: [How; 2] = [How::Exact, How::Plain];

    fn lit(extinction: f64, lamps: Vec<Lamp>) -> Optics {
        Optics { albedo: DVec3::new(0.9, 0.5, 0.1), anisotropy: 0.3, lamps, ..grey(extinction) }
    }

    /// That every pixel's radiance is what `closed` makes of its optical depth, times albedo, irradiance and phase function.
    fn assert_closed(
        film: &Film,
        optics: &Optics,
        towards: f64,
        closed: impl Fn(f64) -> f64,
        tolerance: f64,
    ) {
        let scale = optics.albedo * optics.lamps[0].colour() * towards;
        for (radiance, depth) in film.radiance.iter().zip(&film.depth) {
            for axis in 0..3 {
                let truth = scale[axis] * closed(*depth);
                let error = (radiance[axis] - truth).abs();
                assert!(error < tolerance * truth + 1e-6, "depth {depth}: {}, not {truth}", radiance[axis]);
            }
        }
        assert!(film.depth.iter().any(|depth| *depth > 1.0));
    }

    /// Whatever lies along a ray, the sun from behind the eye gives (1 - e^-2 tau) / 2, and from the other side tau e^-tau.
    #[test]
    fn the_sun_along_the_view_gives_closed_forms() {
        let tree = rough(&solid(), 5.0);
        let field = noisy();
        for medium in [baked(&tree), procedural(&field, 1.0)] {
            // What single precision makes of the segments; a scene's steps are not the same ones along both rays.
            let tolerance = if matches!(medium, Medium::Baked(_)) { 1e-3 } else { 2e-2 };
            for forward in [DVec3::Y, DVec3::new(0.3, 1.0, -0.4), DVec3::new(-1.0, -0.0, 0.0)] {
                let camera = camera(forward, 0.9);
                let phases = [1.0, -1.0].map(|side| phase(0.3, camera.forward * side, -camera.forward));
                let optics = lit(4.0, vec![sun(camera.forward)]);
                let behind = film(&medium, camera, &optics, EXACT, 1);
                assert_closed(&behind, &optics, phases[0], |tau| 0.5 * -libm::expm1(-2.0 * tau), tolerance);
                let optics = lit(4.0, vec![sun(-camera.forward)]);
                let ahead = film(&medium, camera, &optics, EXACT, 1);
                assert_closed(&ahead, &optics, phases[1], |tau| tau * libm::exp(-tau), tolerance);
            }
        }
    }

    /// An optical depth of 1e4 in a cell: the same closed form. Of 1e6: within what single precision knows of a place in a
    /// brick, 5e-7 cells or half an optical depth.
    #[test]
    fn dense_cells_are_shadowed_exactly() {
        let medium = baked(&rough(&solid(), 1.0));
        let camera = camera(DVec3::new(0.3, 1.0, -0.4), 0.6);
        let towards = phase(0.3, camera.forward, -camera.forward);
        for (depth, tolerance) in [(1e4, 0.05), (1e6, 0.9)] {
            let optics = lit(depth / super::super::testing::H, vec![sun(camera.forward)]);
            let film = film(&medium, camera, &optics, EXACT, 1);
            let scale = optics.albedo * optics.lamps[0].colour() * towards;
            for radiance in film.radiance.iter().filter(|radiance| radiance[0] > 0.0) {
                let part = radiance[0] / scale[0];
                assert!((part - 0.5).abs() < 0.5 * tolerance, "{depth}: {part}");
            }
        }
    }

    /// Tables of shadows are interpolated: of a soft medium within a few parts in a hundred.
    #[test]
    fn tables_are_near_exact_shadows() {
        let field = noisy();
        let medium = procedural(&field, 1.0);
        let point = Lamp::Point { position: DVec3::new(0.5, -1.0, 1.0), intensity: DVec3::ONE };
        for lamp in [sun(DVec3::new(1.0, 0.5, -0.7)), point] {
            let optics = lit(3.0, vec![lamp]);
            let camera = camera(DVec3::Y, 1.6);
            let [exact, cached] = [EXACT, [How::Plain; 2]].map(|how| film(&medium, camera, &optics, how, 1));
            let scale = mean(&exact)[0];
            assert!((mean(&cached)[0] - scale).abs() < 0.02 * scale);
            for (a, b) in exact.radiance.iter().zip(&cached.radiance) {
                assert!((a[0] - b[0]).abs() < 0.1 * a[0] + 0.05 * scale, "{a:?}, cached {b:?}");
            }
        }
    }
}
