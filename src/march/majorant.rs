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
