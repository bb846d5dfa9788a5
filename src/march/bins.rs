//! Optical depth along rays, piece by piece.

#![allow(clippy::needless_range_loop, reason = "lanes and axes are indices into several arrays at once")]

use super::rays::{Hits, LANES, RAYS, Rays, single};
use super::shade::Group;
use crate::num::Real;

/// The optical depth of every ray of a tile in pieces of equal length in the world.
pub(super) struct Bins {
    /// Metres.
    step: f64,
    /// Pieces of a ray.
    count: usize,
    depths: Vec<f32>,
    /// Cells for a piece, along each ray.
    cells: Vec<f64>,
}

impl Default for Bins {
    fn default() -> Bins {
        Bins { step: 1.0, count: 0, depths: Vec::new(), cells: Vec::new() }
    }
}

impl Bins {
    /// New ones, from the rays' origins on.
    pub(super) fn begin(&mut self, rays: &Rays, step: f64, count: usize) {
        (self.step, self.count) = (step, count);
        self.depths.clear();
        self.depths.resize(RAYS * count, 0.0);
        self.cells.clear();
        self.cells.extend(rays.metres.iter().map(|metres| step / f64::from(*metres)));
    }

    /// Of a ray.
    pub(super) fn of(&self, ray: usize) -> &[f32] {
        &self.depths[ray * self.count..][..self.count]
    }

    /// The pieces that a group of rays passes within a brick.
    #[inline(always)]
    pub(super) fn parts<R: Real<Scalar = f32>>(
        &self,
        token: R::Token,
        hits: &Hits,
        first: usize,
        group: &Group<R>,
    ) -> Parts<R> {
        let (mut edges, mut steps, mut bins) = ([0.0; LANES], [0.0; LANES], [0; LANES]);
        for lane in 0..LANES {
            let ray = hits.ray(first + lane);
            let (middle, cells) = (hits.middle[ray], self.cells[ray]);
            let begin = middle + f64::from(hits.begin[first + lane]);
            let bin = (begin / cells).floor().max(0.0);
            #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "at least 0")]
            let number = bin as usize;
            bins[lane] = number;
            edges[lane] = single(bin * cells - middle);
            steps[lane] = single(cells);
        }
        Parts {
            edge: R::load(token, &edges),
            step: R::load(token, &steps),
            begin: group.at,
            end: group.end,
            bins,
            first,
        }
    }
}

/// Pieces, one after the other.
pub(super) struct Parts<R> {
    /// Where the next piece begins.
    edge: R,
    step: R,
    begin: R,
    end: R,
    bins: [usize; LANES],
    first: usize,
}

impl<R: Real<Scalar = f32>> Parts<R> {
    /// Where the next piece within the brick begins, and its length; that is 0 where there is none.
    #[inline(always)]
    pub(super) fn next(&mut self, token: R::Token) -> Option<[R; 2]> {
        if R::bitmask(self.edge.lt(self.end)) == 0 {
            return None;
        }
        let begin = self.edge.most(self.begin);
        self.edge = self.edge + self.step;
        let length = (self.edge.least(self.end) - begin).most(R::constant(token, 0.0));
        Some([begin, length])
    }

    /// Leaves a piece out.
    #[inline(always)]
    pub(super) fn skip(&mut self) {
        for bin in &mut self.bins {
            *bin += 1;
        }
    }

    /// The optical depth of the piece.
    #[inline(always)]
    pub(super) fn add(&mut self, bins: &mut Bins, hits: &Hits, depth: R) {
        let mut depths = [0.0; LANES];
        depth.store(&mut depths);
        for lane in 0..LANES.min(hits.count - self.first) {
            let bin = self.bins[lane].min(bins.count - 1);
            bins.depths[hits.ray(self.first + lane) * bins.count + bin] += depths[lane];
            self.bins[lane] += 1;
        }
    }
}
