//! Upper bounds of a medium's density, brick by brick.

use rayon::prelude::*;

use super::grid::GridRay;
use super::medium::Medium;
use super::procedural::Worker;
use super::random::Random;
use super::walk::{Cells, Step, Walk};

/// The largest density of every brick of a medium, or a bound of it.
#[derive(Debug)]
pub(super) struct Majorants {
    /// Densities, each above 0 or, where a brick holds nothing, 0.
    most: Vec<f32>,
}

impl Majorants {
    pub(super) fn new(medium: &Medium<'_>) -> Majorants {
        let most = (0..medium.brick_count())
            .into_par_iter()
            .with_min_len(16)
            .map_init(Worker::default, |worker, brick| medium.majorant(brick, worker))
            .collect();
        Majorants { most }
    }

    pub(super) fn of(&self, brick: usize) -> f64 {
        f64::from(self.most[brick])
    }
}

/// A medium with its majorants, and what light loses in it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Guided<'a> {
    pub(super) medium: &'a Medium<'a>,
    pub(super) majorants: &'a Majorants,
    /// Extinction per metre at density 1.
    pub(super) extinction: f64,
}

/// A place where a particle would collide if the medium were as dense as its majorants.
#[derive(Debug, Clone, Copy)]
pub(super) struct Tentative {
    pub(super) step: Step,
    /// How far along the ray, metres.
    pub(super) at: f64,
    /// The density that is taken for the true one.
    pub(super) majorant: f64,
}

/// A particle on its way through the majorants.
///
/// Where voxels are so dense that it would collide again and again within a cell, each cell's own majorant takes the place of
/// its brick's.
#[derive(Debug, Clone, Copy)]
pub(super) struct Flight {
    pub(super) walk: Walk,
    /// The rest of the part of a brick that it is in, with its majorant.
    part: Option<(Step, f64)>,
    /// The brick whose cells it goes through, and the rest of them.
    cells: Option<(Step, Cells)>,
}

/// Bricks are taken cell by cell where their majorant makes a cell deeper than this.
const DENSE: f64 = 0.5;

impl Flight {
    /// From one place along a ray to another, in metres.
    pub(super) fn new(guided: &Guided<'_>, ray: &GridRay, range: [f64; 2]) -> Flight {
        let walk = Walk::new(guided.medium.bricks().nodes(), ray, range);
        Flight { walk, part: None, cells: None }
    }

    /// The next tentative collision; `None` where it leaves the medium, or comes to the end of its way, before.
    pub(super) fn next(&mut self, guided: &Guided<'_>, random: &mut Random) -> Option<Tentative> {
        // In optical depth of the majorants.
        let mut left = random.exponential();
        loop {
            let (step, majorant) = match self.part.take() {
                Some(part) => part,
                None => self.enter(guided)?,
            };
            let rate = guided.extinction * majorant;
            let depth = rate * (step.end - step.begin);
            if left < depth {
                let at = (step.begin + left / rate).min(step.end);
                self.part = Some((Step { begin: at, ..step }, majorant));
                return Some(Tentative { step, at, majorant });
            }
            left -= depth;
        }
    }

    /// The next part of a brick.
    fn enter(&mut self, guided: &Guided<'_>) -> Option<(Step, f64)> {
        loop {
            if let (Some((step, cells)), Medium::Baked(baked)) = (&mut self.cells, guided.medium) {
                if let Some((cell, [begin, end])) = cells.next() {
                    let majorant = f64::from(baked.majorant_of_cell(step.brick, cell));
                    return Some((Step { begin, end, ..*step }, majorant));
                }
                self.cells = None;
            }
            let step = self.walk.next(guided.medium.bricks().nodes())?;
            let majorant = guided.majorants.of(step.brick);
            let metres = 1.0 / self.walk.line.rate.length();
            if guided.extinction * majorant * metres > DENSE && matches!(guided.medium, Medium::Baked(_)) {
                self.cells = Some((step, Cells::new(&self.walk.line, &step)));
            } else {
                return Some((step, majorant));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "what is not there fails the test")]

    use crate::field::kernel::{Places, Scratch, evaluate};
    use crate::field::{Extent, Field, Lattice, Region, VOXELS};
    use crate::scene::Scene;
    use crate::volume::Plan;

    const BENT: &str =
        "[[tube]]\ncurve = { kind = \"quadratic\", points = [[0, 0, 0], [0.9, 0.2, 1], [0, 0, 2]] }\n";
    const LAYER: &str = "[[tube.layer]]\nop = \"multiply\"\n";

    /// Nothing is denser than the field's bound, nor in a brick than that brick's; and the bounds are not empty words.
    #[test]
    fn bounds_hold() {
        let noise = format!("{LAYER}noise = \"perlin\"\noctaves = 4\nfrequency = [3, 3, 4]\n");
        let scenes = [
            (format!("{BENT}radius = 0.4\n"), 1.2),
            (format!("{BENT}radius = 0.4\n{noise}"), 4.0),
            (format!("{BENT}radius = 0.4\n{noise}threshold = 0.1\nmultiplier = 3.0\n"), 4.0),
            (
                format!("{BENT}radius = 0.4\n{noise}form = \"ridged\"\nop = \"add\"\n")
                    .replace("op = \"multiply\"\n", ""),
                3.0,
            ),
            (format!("{BENT}radius = [[0, 0.5], [1, 0.1]]\nconserve = \"full\"\n"), 20.0),
            (format!("{BENT}radius = [[0, 0.5], [1, 0.1]]\nconserve = \"radius\"\n"), 3.0),
            (format!("{BENT}radius = 0.7\noverlap = \"sum\"\nconserve = \"full\"\n"), 100.0),
            (format!("{BENT}radius = 0.7\noverlap = \"blend\"\n{noise}"), 8.0),
            (format!("overlap = \"sum\"\n{BENT}radius = 0.3\n{BENT}radius = 0.2\n"), 1.2),
        ];
        let lattice = Lattice { voxel_size: 0.03 };
        for (text, loose) in &scenes {
            let scene = Scene::parse(text, "scene.toml").unwrap_or_else(|errors| panic!("{text}: {errors}"));
            let field = Field::compile(&scene);
            let bound = field.bound();
            let plan = Plan::for_extent(&field, lattice, Extent::Whole, u64::MAX).unwrap();
            let mut region = Region::<f64>::default();
            let mut scratch = Scratch::default();
            let mut largest: f64 = 0.0;
            for brick in 0..plan.bricks() {
                plan.narrow(&field, brick, &mut region);
                let mut values = [0.0; VOXELS];
                evaluate::<f64>((), &region, Places::Centres, &mut scratch, &mut values);
                let most = values.into_iter().fold(0.0, f64::max);
                let local = field.bound_in(&region);
                assert!(most <= local, "{text}: {most} > {local} in {brick}");
                largest = largest.max(most);
            }
            assert!(largest > 0.0 && largest <= bound, "{text}: {largest} > {bound}");
            assert!(bound < loose * largest, "{text}: {largest}, at most {bound}");
        }
    }
}
