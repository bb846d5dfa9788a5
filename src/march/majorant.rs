//! Upper bounds of a medium's density, brick by brick, and particles on their way through them.
//!
//! Where a medium is so dense that a particle would collide in vain again and again within a cell, the optical depth tells
//! where it collides instead (regular tracking): of voxels exactly, since it is a polynomial in every cell; of a scene as if
//! the density were linear between places along the way. So the work is bounded by the number of cells.

use rayon::prelude::*;

use super::grid::GridRay;
use super::medium::Medium;
use super::points::Spot;
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
    /// Whether the depth may tell where particles collide; else they collide tentatively only.
    pub(super) is_regular: bool,
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

/// What a particle comes to.
#[derive(Debug, Clone, Copy)]
pub(super) enum Event {
    /// Whether it collides here is to be found out by the density.
    Tentative(Tentative),
    /// The density here is to be [told](Flight::tell).
    Sample(Step, f64),
    /// It collides so far along the ray, metres.
    Collision(f64),
}

impl Event {
    /// The place of a brick whose density is asked for.
    pub(super) fn spot(&self, walk: &Walk) -> Option<Spot> {
        let (step, at) = match self {
            Event::Tentative(at) => (&at.step, at.at),
            Event::Sample(step, at) => (step, *at),
            Event::Collision(_) => return None,
        };
        Some(Spot { brick: step.brick, local: step.local(&walk.line, at) })
    }
}

/// A part of a way along which the density is taken to be linear.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Piece {
    begin: f64,
    /// Metres.
    length: f64,
    /// The densities at its ends.
    ends: [f64; 2],
}

impl Piece {
    /// Its density times metres.
    pub(super) fn depth(&self) -> f64 {
        0.5 * (self.ends[0] + self.ends[1]) * self.length
    }

    /// How far along the ray so much of its depth is passed.
    pub(super) fn place(&self, depth: f64) -> f64 {
        let [near, far] = self.ends;
        let root = (near * near + 2.0 * (far - near) / self.length * depth).max(0.0).sqrt();
        let way = 2.0 * depth / (near + root);
        // Also where it is no number.
        self.begin + if way < self.length { way } else { self.length }
    }
}

/// Places along a part of a brick at which the density is asked for, each as far from the one before as the depth between
/// them allows.
#[derive(Debug, Clone, Copy)]
struct Samples {
    step: Step,
    /// How far the way is known, and the density there; nothing is before the first sample.
    at: f64,
    last: Option<f64>,
    /// To the next sample, and at most, metres.
    length: f64,
    longest: f64,
}

impl Samples {
    fn next(&self) -> f64 {
        let next = self.at + self.length;
        if self.last.is_none() {
            self.step.begin
        } else if next > self.at {
            next.min(self.step.end)
        } else {
            // Too short a way for numbers as large as these.
            self.step.end
        }
    }
}

/// A particle on its way through the majorants.
///
/// Where voxels are so dense that it would collide again and again within a cell, each cell's own majorant takes the place of
/// its brick's, or even its depth.
#[derive(Debug, Clone, Copy)]
pub(super) struct Flight {
    pub(super) walk: Walk,
    /// The rest of the part of a brick that it is in, with its majorant.
    part: Option<(Step, f64)>,
    /// The brick whose cells it goes through, and the rest of them.
    cells: Option<(Step, Cells)>,
    samples: Option<Samples>,
    /// Tentative collisions in this brick so far.
    vain: u32,
}

/// How a part of a brick is gone through.
enum By {
    Majorant(f64),
    /// So deep, density times metres, is this cell.
    Depth(f64, [usize; 3]),
}

/// Bricks are taken cell by cell where their majorant makes a cell deeper than this.
const DENSE: f64 = 0.5;
/// Where its majorant makes a cell deeper than this, the depth tells where particles collide.
const STIFF: f64 = 32.0;
/// After so many tentative collisions in a brick of a scene, samples tell.
const MOST_VAIN: u32 = 64;
/// A piece along which a scene's density is taken to be linear is no deeper than this, where it may be divided; it is divided
/// no more often than into so many.
const DEEP: f64 = 0.1;
const MOST_PIECES: f64 = 65536.0;

impl Flight {
    /// From one place along a ray to another, in metres.
    pub(super) fn new(guided: &Guided<'_>, ray: &GridRay, range: [f64; 2]) -> Flight {
        let walk = Walk::new(guided.medium.bricks().nodes(), ray, range);
        Flight { walk, part: None, cells: None, samples: None, vain: 0 }
    }

    /// Whether it goes on by samples after many tentative collisions.
    fn is_to_give_up(&self, guided: &Guided<'_>) -> bool {
        guided.is_regular && matches!(guided.medium, Medium::Procedural(_))
    }

    /// What it comes to next; `None` where it leaves the medium, or comes to the end of its way, before.
    pub(super) fn next(&mut self, guided: &Guided<'_>, random: &mut Random) -> Option<Event> {
        if let Some(samples) = &self.samples {
            return Some(Event::Sample(samples.step, samples.next()));
        }
        // In optical depth of the majorants.
        let mut left = random.exponential();
        loop {
            let (step, by) = match self.part.take() {
                Some((step, majorant)) => (step, By::Majorant(majorant)),
                None => self.enter(guided)?,
            };
            match by {
                By::Majorant(majorant) if self.vain < MOST_VAIN => {
                    let rate = guided.extinction * majorant;
                    let depth = rate * (step.end - step.begin);
                    if left < depth {
                        let at = (step.begin + left / rate).min(step.end);
                        self.vain += u32::from(self.is_to_give_up(guided));
                        self.part = Some((Step { begin: at, ..step }, majorant));
                        return Some(Event::Tentative(Tentative { step, at, majorant }));
                    }
                    left -= depth;
                }
                By::Depth(whole, cell) => {
                    let depth = guided.extinction * whole;
                    if left < depth {
                        return Some(Event::Collision(self.within(
                            guided,
                            &step,
                            cell,
                            left / depth * whole,
                        )));
                    }
                    left -= depth;
                }
                By::Majorant(_) => {
                    // Where it did not collide does not matter for where it will.
                    let metres = 1.0 / self.walk.line.rate.length();
                    let longest = guided.medium.step() * metres;
                    let at = step.begin;
                    self.samples = Some(Samples { step, at, last: None, length: longest, longest });
                    return Some(Event::Sample(step, step.begin));
                }
            }
        }
    }

    /// Takes the density where a sample was asked for, and gives the piece of the way that ends there, unless that is too deep
    /// and asked for again in shorter ones.
    pub(super) fn tell(&mut self, density: f64, guided: &Guided<'_>) -> Option<Piece> {
        let samples = self.samples.as_mut()?;
        let next = samples.next();
        let Some(last) = samples.last else {
            samples.last = Some(density);
            return None;
        };
        let length = next - samples.at;
        let piece = Piece { begin: samples.at, length, ends: [last, density] };
        let depth = guided.extinction * piece.depth();
        let shorter = length / (depth / DEEP).clamp(2.0, 64.0);
        if depth > DEEP && length > samples.longest / MOST_PIECES && samples.at + shorter > samples.at {
            samples.length = shorter;
            return None;
        }
        (samples.at, samples.last) = (next, Some(density));
        samples.length = (2.0 * length).min(samples.longest);
        if next >= samples.step.end {
            self.samples = None;
        }
        Some(piece)
    }

    /// The next part of a brick.
    fn enter(&mut self, guided: &Guided<'_>) -> Option<(Step, By)> {
        let metres = 1.0 / self.walk.line.rate.length();
        let is_stiff = |majorant: f64| guided.is_regular && guided.extinction * majorant * metres > STIFF;
        loop {
            if let (Some((step, cells)), Medium::Baked(baked)) = (&mut self.cells, guided.medium) {
                if let Some((cell, range)) = cells.next() {
                    let majorant = f64::from(baked.majorant_of_cell(step.brick, cell));
                    let by = if is_stiff(majorant) {
                        By::Depth(baked.depth_of_cell(step.brick, cells, cell, range), cell)
                    } else {
                        By::Majorant(majorant)
                    };
                    return Some((Step { begin: range[0], end: range[1], ..*step }, by));
                }
                self.cells = None;
            }
            let step = self.walk.next(guided.medium.bricks().nodes())?;
            let majorant = guided.majorants.of(step.brick);
            self.vain = 0;
            if guided.extinction * majorant * metres > DENSE && matches!(guided.medium, Medium::Baked(_)) {
                self.cells = Some((step, Cells::new(&self.walk.line, &step)));
            } else {
                return Some((step, By::Majorant(majorant)));
            }
        }
    }

    /// How far along the ray so much of a cell's density times metres is passed: by Newton's method between bounds.
    fn within(&self, guided: &Guided<'_>, step: &Step, cell: [usize; 3], wanted: f64) -> f64 {
        let (Medium::Baked(baked), Some((_, cells))) = (guided.medium, &self.cells) else {
            return step.begin;
        };
        let [mut low, mut high] = [step.begin, step.end];
        let mut at = 0.5 * (low + high);
        for _ in 0..64 {
            let off = baked.depth_of_cell(step.brick, cells, cell, [step.begin, at]) - wanted;
            if off.abs() <= 1e-9 * wanted {
                break;
            }
            if off > 0.0 {
                high = at;
            } else {
                low = at;
            }
            let spot = Spot { brick: step.brick, local: step.local(&self.walk.line, at) };
            let next = at - off / f64::from(baked.density(&spot));
            at = if next > low && next < high { next } else { 0.5 * (low + high) };
        }
        at
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
