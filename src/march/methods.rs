//! Ways to march through a scene's density, those of others among them.
//!
//! Gauss's rule is what pictures are made with. The others are there to be compared with it: they take steps of one length all
//! along a ray, from where it enters the tubes on.

use super::camera::Ray;
use super::cones::{Interval, TubeBounds};
use super::rays::{RAYS, Rays};
use super::segment::GAUSS;

/// What a step makes of the density that it samples.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Method {
    /// Gauss's rule of two samples, over segments that end where tubes do and that are divided where it is dense.
    #[default]
    Gauss,
    /// The density in the middle of a step stands for all of it: optical depth `sigma dx`.
    Midpoint,
    /// That at its beginning does, and the transmittance is multiplied by `1 - alpha`, where alpha is `sigma dx`, at most 1
    /// (Moinet, "Sculpting procedural noise", 2022).
    Alpha,
}

impl Method {
    /// Where in a segment it is sampled, as parts of its length.
    pub(super) fn samples(self) -> &'static [f64] {
        match self {
            Method::Gauss => &GAUSS,
            Method::Midpoint => &[0.5],
            Method::Alpha => &[0.0],
        }
    }
}

/// How the place is found where a ray enters the tubes. All but the first are those of Thomann, "Procedural volumetric
/// clouds" (2020), with the tubes' bounds as the scene.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Entry {
    /// By its closed form.
    #[default]
    Cones,
    /// By steps of one length until one ends inside.
    Constant,
    /// By steps that turn back and halve when they end inside.
    Converging,
    /// By steps as long as the distance to the bounds.
    SphereTracing,
}

/// How rays go through a scene's density.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Marching {
    /// What steps do.
    pub method: Method,
    /// Of other methods than Gauss's: each step is longer than the one before by this part of that.
    pub growth: f64,
    /// Of other methods than Gauss's: how the beginning is found.
    pub entry: Entry,
    /// Of other methods than Gauss's, without growth: places are mapped to the tube's cylinder at every so many steps, and
    /// between them what they are mapped to is linear. At least 1.
    pub map_every: usize,
}

impl Default for Marching {
    fn default() -> Marching {
        Marching { method: Method::Gauss, growth: 0.0, entry: Entry::Cones, map_every: 1 }
    }
}

/// A converging search ends when its steps are shorter than this part of a voxel, and sphere tracing this close.
pub(super) const CLOSE: f64 = 1e-3;
/// Steps to a beginning, at most.
const MOST_STEPS: u32 = 1 << 20;

impl Entry {
    /// Where a ray enters the bounds by this method, and where it leaves them for the last time, in metres; with steps of
    /// `step` metres from where it enters their box. `exact` is where it is inside of them.
    pub(super) fn find(
        self,
        bounds: &TubeBounds,
        ray: &Ray,
        exact: &[Interval],
        step: f64,
        close: f64,
    ) -> Option<Interval> {
        let (first, last) = exact.first().zip(exact.last())?;
        let exit = last[1];
        if self == Entry::Cones {
            return Some([first[0], exit]);
        }
        let inside = |t: f64| bounds.contains(ray.at(t));
        let mut at = enter_box(bounds, ray)?;
        let mut size = step;
        let begins_inside = self == Entry::Converging && inside(at);
        for _ in 0..MOST_STEPS {
            if at > exit {
                return None;
            }
            match self {
                Entry::Cones => break,
                Entry::Constant if inside(at) => break,
                Entry::Constant => at += size,
                Entry::Converging if begins_inside || size < close => break,
                Entry::Converging if inside(at) => {
                    size *= 0.5;
                    at -= size;
                }
                Entry::Converging => at += size,
                Entry::SphereTracing => {
                    let distance = bounds.distance(ray.at(at));
                    if distance < close {
                        break;
                    }
                    at += distance;
                }
            }
        }
        Some([at.max(0.0), exit])
    }
}

/// Where a ray enters the box around everything.
fn enter_box(bounds: &TubeBounds, ray: &Ray) -> Option<f64> {
    let [low, high] = bounds.corners()?;
    let inverse = ray.direction.recip();
    let mut enters = 0.0_f64;
    for axis in 0..3 {
        let near = (low[axis] - ray.origin[axis]) * inverse[axis];
        let far = (high[axis] - ray.origin[axis]) * inverse[axis];
        let near = near.min(far);
        if near.is_finite() {
            enters = enters.max(near);
        }
    }
    Some(enters)
}

/// The steps of a tile's rays, from where each enters the tubes; in cells.
#[derive(Default)]
pub(super) struct Strides {
    entry: Vec<f64>,
    exit: Vec<f64>,
    /// Steps that are taken already.
    taken: Vec<f64>,
    step: f64,
    growth: f64,
    found: Vec<Interval>,
}

impl Strides {
    /// Of new rays in a cubic grid of edge h.
    pub(super) fn begin(&mut self, rays: &Rays, bounds: &TubeBounds, marching: Marching, step: f64, h: f64) {
        (self.step, self.growth) = (step, marching.growth);
        for all in [&mut self.entry, &mut self.exit, &mut self.taken] {
            all.clear();
            all.resize(RAYS, 0.0);
        }
        for number in 0..RAYS {
            let Some(ray) = rays.ray(number) else { continue };
            let ray = Ray { origin: ray.origin * h, direction: ray.direction };
            bounds.intervals(&ray, &mut self.found);
            let found = marching.entry.find(bounds, &ray, &self.found, step * h, CLOSE * h);
            let [entry, exit] = found.unwrap_or([0.0, -1.0]);
            (self.entry[number], self.exit[number]) = (entry / h, exit / h);
        }
    }

    /// Where a step begins, and how long it is.
    fn step(&self, ray: usize, number: f64) -> [f64; 2] {
        if self.growth == 0.0 {
            return [self.entry[ray] + number * self.step, self.step];
        }
        let grown = libm::pow(1.0 + self.growth, number);
        [self.entry[ray] + self.step * (grown - 1.0) / self.growth, self.step * grown]
    }

    /// The steps of a ray that are sampled between two places along it, `sample` of their length from their beginning, and
    /// that are not taken yet; takes them. Where the first begins, its length, and their number.
    pub(super) fn take(&mut self, ray: usize, from: f64, to: f64, sample: f64) -> (f64, f64, f64) {
        let to = to.min(self.exit[ray]);
        // Rounding of `from`: no step may fall between two bricks.
        let from = from - 1e-4;
        let at = |strides: &Strides, number: f64| {
            let [begin, length] = strides.step(ray, number);
            begin + sample * length
        };
        let about = |place: f64| {
            let steps = ((place - self.entry[ray]) / self.step).max(0.0);
            let steps = if self.growth == 0.0 {
                steps
            } else {
                libm::log1p(self.growth * steps) / libm::log1p(self.growth)
            };
            (steps - 1.0).floor().max(self.taken[ray])
        };
        let mut first = about(from);
        while at(self, first) < from {
            first += 1.0;
        }
        let mut next = about(to).max(first);
        while at(self, next) < to {
            next += 1.0;
        }
        if next > first {
            self.taken[ray] = next;
        }
        let [begin, length] = self.step(ray, first);
        (begin, length, next - first)
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;
    use crate::field::{Field, Lattice};
    use crate::scene::Scene;
    use crate::volume::testing::unit;

    #[test]
    fn every_method_finds_the_entry_within_its_tolerance() {
        let text = "[[tube]]\ncurve = { points = [[0,0,0],[1,0,2],[2,0,0]] }\nradius = [[0, 0.1], [0.5, 0.4], [1, 0.2]]";
        let field = Field::compile(&Scene::parse(text, "scene.toml").expect("valid"));
        let bounds = TubeBounds::new(&field, Lattice { voxel_size: 0.02 });
        let (step, close) = (0.02, 2e-5);
        let mut state = 3;
        let (mut met, mut exact) = (0, Vec::new());
        for _ in 0..400 {
            let mut about = |low: f64, high: f64| low + unit(&mut state) * (high - low);
            let target = DVec3::new(about(0.0, 2.0), about(-0.2, 0.2), about(0.0, 1.2));
            let origin = DVec3::new(about(-3.0, 5.0), -4.0, about(-3.0, 4.0));
            let ray = Ray { origin, direction: (target - origin).normalize() };
            bounds.intervals(&ray, &mut exact);
            let find = |entry: Entry| entry.find(&bounds, &ray, &exact, step, close);
            let Some([truth, exit]) = find(Entry::Cones) else {
                assert!(exact.is_empty());
                continue;
            };
            // Constant and converging steps may pass over a chord shorter than themselves.
            if exact[0][1] - truth < step {
                continue;
            }
            met += 1;
            for (entry, low, high) in [
                (Entry::Constant, 0.0, step),
                (Entry::Converging, -2.0 * close, 2.0 * close),
                // As far from the surface along the ray as `close` is from it at the angle that it is met at.
                (Entry::SphereTracing, -step, 1e-12),
            ] {
                let [found, last] = find(entry).expect("within");
                assert_eq!(last, exit);
                let error = found - truth;
                assert!((low - 1e-12..=high + 1e-12).contains(&error), "{entry:?}: {error:e}");
                if entry == Entry::SphereTracing {
                    assert!(bounds.distance(ray.at(found)) < close);
                }
            }
        }
        assert!(met > 100, "only {met} rays met the tube");
    }

    #[test]
    fn steps_go_on_from_brick_to_brick() {
        for growth in [0.0, 0.05] {
            for sample in [0.0, 0.5] {
                let mut strides = Strides {
                    entry: vec![1.3],
                    exit: vec![60.0],
                    taken: vec![0.0],
                    step: 0.37,
                    growth,
                    found: Vec::new(),
                };
                let (mut place, mut total) = (1.3, 0.0);
                let mut from = 0.0;
                // Ends of bricks that are not quite where the next one begins.
                for end in [3.0, 9.1, 9.2, 31.0, 40.0, 70.0] {
                    let (begin, length, count) = strides.take(0, from, end, sample);
                    if count > 0.0 {
                        assert!((begin - place).abs() < 1e-9, "{begin}, not {place}");
                        let mut grown = length;
                        for _ in 0..10_000 {
                            if total >= strides.taken[0] {
                                break;
                            }
                            place += grown;
                            grown *= 1.0 + growth;
                            total += 1.0;
                        }
                    }
                    from = end + 1e-6;
                }
                // The last sample is before the exit, and the next would not be.
                let [begin, length] = strides.step(0, total - 1.0);
                assert!(begin + sample * length < 60.0);
                let [begin, length] = strides.step(0, total);
                assert!(begin + sample * length >= 60.0);
            }
        }
    }
}
