//! Upper bounds of a medium's density, brick by brick.

use rayon::prelude::*;

use super::grid::GridRay;
use super::medium::Medium;
use super::procedural::Worker;
use super::random::Random;
use super::walk::{Step, Walk};

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
#[derive(Debug, Clone, Copy)]
pub(super) struct Flight {
    pub(super) walk: Walk,
    /// The rest of the brick that it is in.
    step: Option<Step>,
}

impl Flight {
    /// From one place along a ray to another, in metres.
    pub(super) fn new(guided: &Guided<'_>, ray: &GridRay, range: [f64; 2]) -> Flight {
        Flight { walk: Walk::new(guided.medium.bricks().nodes(), ray, range), step: None }
    }

    /// The next tentative collision; `None` where it leaves the medium, or comes to the end of its way, before.
    pub(super) fn next(&mut self, guided: &Guided<'_>, random: &mut Random) -> Option<Tentative> {
        // In optical depth of the majorants.
        let mut left = random.exponential();
        loop {
            let step = match self.step.take() {
                Some(step) => step,
                None => self.walk.next(guided.medium.bricks().nodes())?,
            };
            let majorant = guided.majorants.of(step.brick);
            let rate = guided.extinction * majorant;
            let depth = rate * (step.end - step.begin);
            if left < depth {
                let at = (step.begin + left / rate).min(step.end);
                self.step = Some(Step { begin: at, ..step });
                return Some(Tentative { step, at, majorant });
            }
            left -= depth;
        }
    }
}
