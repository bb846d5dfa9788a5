//! The search for the largest voxel that is small enough.

use serde::{Deserialize, Serialize};

use super::order::Order;

/// A voxel size that was tried.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Step {
    /// Metres.
    pub voxel_size: f64,
    /// What was found.
    pub error: f64,
}

/// Where a search ends.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Outcome {
    /// The voxel size is expected to meet the limit, not much too well.
    Found(f64),
    /// The error falls too slowly: with this order, which would need this voxel size.
    Slow {
        /// From the last two steps.
        order: f64,
        /// Metres.
        voxel_size: f64,
    },
    /// Nothing of the kind was found in as many steps as are allowed.
    Lost,
}

/// A search for a voxel size, step by step.
#[derive(Debug, Clone)]
pub struct Search {
    limit: f64,
    /// No voxel is larger than this.
    largest: f64,
    steps: Vec<Step>,
    next: f64,
    slow: u32,
    rough: f64,
}

/// What is aimed at, as a part of the limit: room for what points do not tell.
const AIM: f64 = 0.88;
/// What is taken.
const TAKEN: [f64; 2] = [0.82, 0.93];
/// Errors that fall more slowly than with this power are slow, but for those above `ROUGH`, where voxels show nothing yet.
const SLOW: f64 = 0.75;
const ROUGH: f64 = 0.6;
/// A slow error is followed as far as this many times smaller voxels.
const PATIENCE: f64 = 4.0;
/// Times the finest voxel that an order is fitted over.
const FAR: f64 = 4.0;
const MOST_STEPS: usize = 16;
/// The power with which errors fall where nothing is known.
const USUAL: f64 = 2.0;

impl Search {
    /// For an error of at most `limit`, from a first voxel size, up to the largest, both in metres.
    pub fn new(limit: f64, first: f64, largest: f64) -> Search {
        Search { limit, largest, steps: vec![], next: first.min(largest), slow: 0, rough: ROUGH }
    }

    /// The same for an error that is as large as the largest jump of what is searched for, however small voxels are: that it does
    /// not fall shows from the first voxels on.
    pub fn of_jumps(self) -> Search {
        Search { rough: f64::INFINITY, ..self }
    }

    /// What to try next.
    pub fn next(&self) -> f64 {
        self.next
    }

    /// All that was tried.
    pub fn steps(&self) -> &[Step] {
        &self.steps
    }

    /// The order from the voxel sizes that were tried and show the density, up to four times the finest.
    pub fn order(&self) -> Option<Order> {
        let finest = self.steps.iter().map(|step| step.voxel_size).fold(f64::INFINITY, f64::min);
        let near = self.steps.iter().filter(|step| step.error < ROUGH && step.voxel_size <= FAR * finest);
        Order::fit(&near.map(|step| [step.voxel_size, step.error]).collect::<Vec<_>>())
    }

    /// The voxel size that is needed as far as the steps so far tell; before the first, the next.
    pub fn expected(&self) -> f64 {
        let finest = self.steps.iter().min_by(|a, b| a.voxel_size.total_cmp(&b.voxel_size));
        let Some(Step { voxel_size, error }) = finest.filter(|step| step.error > 0.0) else {
            return self.next;
        };
        let power = self.order().map_or(USUAL, |order| order.order.clamp(SLOW, 3.0));
        (voxel_size * libm::pow(AIM * self.limit / error, 1.0 / power)).min(self.next)
    }

    /// Takes in the error at [`Search::next`]; `None` where the search goes on.
    pub fn add(&mut self, error: f64) -> Option<Outcome> {
        let voxel_size = self.next;
        let last = self.steps.last().copied();
        self.steps.push(Step { voxel_size, error });
        let is_largest = voxel_size >= self.largest;
        if (TAKEN[0] * self.limit..=TAKEN[1] * self.limit).contains(&error)
            || (is_largest && error <= TAKEN[1] * self.limit)
        {
            return Some(Outcome::Found(voxel_size));
        }
        if self.steps.len() >= MOST_STEPS {
            return Some(self.best().map_or(Outcome::Lost, Outcome::Found));
        }
        let order = last.and_then(|last| Order::fit(&[[last.voxel_size, last.error], [voxel_size, error]]));
        let finer = last.is_some_and(|last| voxel_size < last.voxel_size);
        let power = order.map(|order| order.order);
        self.slow = match power {
            Some(power) if finer && error < self.rough && error > self.limit && power < SLOW => self.slow + 1,
            _ => 0,
        };
        if let Some(power) = power.filter(|_| self.slow >= 2) {
            let needed = voxel_size * libm::pow(AIM * self.limit / error, 1.0 / power.max(0.1));
            if needed * PATIENCE < voxel_size {
                if let Some(best) = self.best() {
                    return Some(Outcome::Found(best));
                }
                return Some(Outcome::Slow { order: power, voxel_size: needed });
            }
        }
        self.next = self.following(voxel_size, error, power).min(self.largest);
        None
    }

    /// The largest voxel that met the limit.
    fn best(&self) -> Option<f64> {
        let good = self.steps.iter().filter(|step| step.error <= TAKEN[1] * self.limit);
        good.map(|step| step.voxel_size).max_by(f64::total_cmp)
    }

    /// The next voxel size: between one that is too coarse and one that is too fine where both are known, else beyond.
    fn following(&self, voxel_size: f64, error: f64, power: Option<f64>) -> f64 {
        let aim = AIM * self.limit;
        let coarse = self.steps.iter().filter(|step| step.error > aim);
        let fine = self.steps.iter().filter(|step| step.error <= aim);
        let coarse = coarse.min_by(|a, b| a.voxel_size.total_cmp(&b.voxel_size));
        let fine = fine.max_by(|a, b| a.voxel_size.total_cmp(&b.voxel_size));
        if let (Some(coarse), Some(fine)) = (coarse, fine) {
            if fine.voxel_size < coarse.voxel_size && fine.error > 0.0 {
                let [low, high] = [fine, coarse].map(|step| libm::log(step.voxel_size));
                let part = libm::log(aim / fine.error) / libm::log(coarse.error / fine.error);
                return libm::exp(low + part.clamp(0.1, 0.9) * (high - low));
            }
            // Not in order: points tell no more.
            return fine.voxel_size.min(coarse.voxel_size) * 0.9;
        }
        // Without any error a larger voxel does.
        let ratio = if error > 0.0 { aim / error } else { f64::INFINITY };
        let power = power.map_or(USUAL, |power| power.clamp(0.5, 3.0));
        voxel_size * libm::pow(ratio, 1.0 / power).clamp(1.0 / 3.0, 3.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn run(limit: f64, first: f64, largest: f64, error: impl Fn(f64) -> f64) -> (Outcome, usize) {
        let mut search = Search::new(limit, first, largest);
        loop {
            if let Some(outcome) = search.add(error(search.next())) {
                return (outcome, search.steps().len());
            }
        }
    }

    #[test]
    fn powers_are_met_in_few_steps() {
        for order in [0.9, 1.0, 1.5, 2.0, 3.0] {
            for limit in [0.1, 2e-2, 5e-3] {
                let error = |h: f64| 3.0 * libm::pow(h, order);
                let (outcome, steps) = run(limit, 0.1, 1.0, error);
                let Outcome::Found(h) = outcome else { panic!("{order} {limit}: {outcome:?}") };
                assert!(error(h) <= 0.93 * limit && error(h) >= 0.82 * limit, "{order} {limit}");
                assert!(steps <= 9, "{order} {limit}: {steps} steps");
            }
        }
    }

    #[test]
    fn what_is_needed_is_foretold() {
        let mut search = Search::new(1e-4, 0.1, 1.0);
        assert_eq!(search.expected(), 0.1);
        let error = |h: f64| 0.5 * h * h;
        for _ in 0..2 {
            assert_eq!(search.add(error(search.next())), None);
        }
        let expected = search.expected();
        assert!((error(expected) / 0.88e-4 - 1.0).abs() < 1e-6, "{expected}");
    }

    #[test]
    fn a_rough_beginning_is_no_reason_to_give_up() {
        // Nothing is seen of it with voxels above 0.02.
        let error = |h: f64| 1.0 / (1.0 + libm::pow(h / 0.02, -2.0));
        let (outcome, _) = run(5e-3, 0.5, 1.0, error);
        assert!(matches!(outcome, Outcome::Found(h) if error(h) < 5e-3), "{outcome:?}");
    }

    #[test]
    fn slow_errors_are_told() {
        let (outcome, steps) = run(5e-3, 0.05, 1.0, |h| h.sqrt());
        let Outcome::Slow { order, voxel_size } = outcome else { panic!("{outcome:?}") };
        assert!((order - 0.5).abs() < 1e-9 && steps <= 4);
        // What it would take: the square of the error aimed at.
        assert!((voxel_size / libm::pow(0.88 * 5e-3, 2.0) - 1.0).abs() < 1e-6);
        // A limit that is near is met all the same.
        let (outcome, _) = run(0.12, 0.05, 1.0, |h| h.sqrt());
        assert!(matches!(outcome, Outcome::Found(_)), "{outcome:?}");
    }

    #[test]
    fn errors_of_jumps_are_told_however_large_they_are() {
        let mut search = Search::new(0.05, 0.05, 1.0).of_jumps();
        let outcome = loop {
            if let Some(outcome) = search.add(0.99) {
                break outcome;
            }
        };
        assert!(matches!(outcome, Outcome::Slow { order, .. } if order.abs() < 1e-9), "{outcome:?}");
        assert_eq!(search.steps().len(), 3);
    }

    #[test]
    fn what_met_the_limit_is_taken_though_finer_voxels_did_not() {
        // As along few rays: 0.014 at first, more with smaller voxels.
        let (outcome, _) =
            run(
                0.05,
                0.05,
                1.0,
                |h| if h < 0.04 { 0.06 * libm::pow(h / 0.04, -0.9) } else { 0.02 * h / 0.05 },
            );
        assert!(matches!(outcome, Outcome::Found(h) if h >= 0.04), "{outcome:?}");
    }

    #[test]
    fn the_largest_voxel_does_where_there_is_nothing_to_see() {
        assert_eq!(run(0.01, 0.1, 0.7, |_| 0.0).0, Outcome::Found(0.7));
        assert_eq!(run(0.01, 0.1, 0.7, |_| 0.002).0, Outcome::Found(0.7));
    }
}
