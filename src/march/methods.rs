//! Ways to march through a scene's density, those of others among them.
//!
//! Gauss's rule is what pictures are made with. The others are there to be compared with it: they take steps of one length all
//! along a ray, from where it enters the tubes on.

use std::num::NonZeroU32;

use super::camera::Ray;
use super::cones::{Interval, TubeBounds};
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

/// How it is known which steps are inside of tubes. What is outside has no density, and is not evaluated.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Intervals {
    /// It is not: steps are evaluated in all bricks that hold a tube.
    #[default]
    Bricks,
    /// By the closed form of each ray's intervals inside of cones along the tubes, which are found in a tree.
    Cones,
    /// By the box of each segment of a curve with its radius, which every ray is held against once (Moinet 2022, section 4).
    RayBoxes,
    /// By the same boxes, all of which every sample is held against: what that text found too slow.
    SampleBoxes,
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
    /// Of other methods than Gauss's: which steps are evaluated. With boxes, the first step begins where a ray enters the
    /// first of them (`RayBoxes`), or that around them all (`SampleBoxes`), whatever the entry.
    pub intervals: Intervals,
    /// Of other methods than Gauss's, without growth: every ray takes so many steps of one length, from where it enters the
    /// box around everything to where it leaves it, whatever the step and the entry. With samples in the middle and without
    /// shadows that is the sum of N densities of Thomann's text (2020, section 6.2.1), each weighed by the distance to the next.
    pub count: Option<NonZeroU32>,
}

impl Default for Marching {
    fn default() -> Marching {
        Marching {
            method: Method::Gauss,
            growth: 0.0,
            entry: Entry::Cones,
            map_every: 1,
            intervals: Intervals::Bricks,
            count: None,
        }
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
        let mut at = bounds.around(ray)?[0];
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
}
