//! What a scene does not need and so is not evaluated, in words.

use super::detail::{Rates, is_placed, square_in_world};
use super::pattern::{Fractal, Octave};
use super::tube::{LayerKind, Tube};
use super::{Field, Lattice};
use crate::noise::BAND;
use crate::scene::{Antialias, Caps, Conserve, Radial, Space};

impl Field {
    /// The stages left out of the evaluation at a lattice, each with the reason, tube by tube and then of the whole.
    /// `has_edges` is whether the plan found any.
    ///
    /// Besides these, every block leaves out what cannot matter to it: far axes, octaves that have faded there, the fade
    /// of far ends, and the fade at the focal set where it is certainly 1.
    pub fn left_out(&self, lattice: Lattice, has_edges: bool) -> Vec<String> {
        let mut out: Vec<String> =
            self.tubes.iter().flat_map(|tube| self.left_out_of(tube, lattice)).collect();
        match self.antialias {
            Antialias::Off => out.push("anti-aliasing: it is off".into()),
            Antialias::Adaptive if !has_edges => out.push("anti-aliasing: nothing has an edge".into()),
            Antialias::Adaptive => {}
        }
        out
    }

    fn left_out_of(&self, tube: &Tube, lattice: Lattice) -> Vec<String> {
        let mut out = Vec::new();
        let mut say = |text: String| out.push(format!("tube \"{}\": {text}", tube.name));
        if tube.curve.segments().iter().all(|segment| segment.degree() < 3) {
            say("cubic terms of the axis: no segment has any".into());
        }
        if tube.twist_rate == 0.0 {
            say("twist: 0 turns".into());
        }
        if tube.radius.is_constant() {
            say("change of the radius: it is constant".into());
        }
        if !tube.radius.is_widened() {
            say("widening: it is off, or no part is thinner than three voxels".into());
        }
        if tube.conserve == Conserve::Off {
            say("conservation: not asked for".into());
        }
        if tube.curve.is_closed() {
            say("fade and half balls at the ends: the curve is closed".into());
        } else {
            if !matches!(tube.caps, Caps::Fade(_)) {
                say("fade at the ends: caps do not ask for it".into());
            }
            if !matches!(tube.caps, Caps::Round) {
                say("half balls at the ends: caps are not round".into());
            }
        }
        if tube.radial == Radial::Hard {
            say("envelope: it is hard".into());
        }
        for (key, is_given) in tube.unused {
            if is_given {
                say(format!("{key}: a bake of density does not use it"));
            }
        }
        if tube.layers.is_empty() {
            say("layers: there are none, the tube is filled with 1".into());
        }
        for (number, layer) in (1..).zip(&tube.layers) {
            if layer.threshold.is_none() {
                say(format!("threshold of layer {number}: none is given"));
            }
            let LayerKind::Perlin(perlin) = &layer.kind else { continue };
            if !self.octave_fade {
                say(format!("fading of octaves in layer {number}: switched off"));
            }
            let sums = [("layer", &perlin.sum)];
            let warp = perlin.warp.as_ref().map(|warp| ("the warp of layer", &warp.sums[0]));
            for (whose, sum) in sums.into_iter().chain(warp) {
                let [unplaced, faded] = self.left_out_octaves(tube, perlin.space, sum, lattice);
                if unplaced > 0 {
                    say(format!(
                        "{unplaced} octaves of {whose} {number}: without amplitude, or finer than 2^22 cells"
                    ));
                }
                if faded > 0 {
                    say(format!("{faded} octaves of {whose} {number}: above 1.6 cells a voxel everywhere"));
                }
            }
        }
        out
    }

    /// Octaves that are never evaluated at a lattice, and those that have faded everywhere.
    fn left_out_octaves(&self, tube: &Tube, space: Space, sum: &Fractal, lattice: Lattice) -> [usize; 2] {
        let h = lattice.voxel_size;
        let is_placed = |octave: &&Octave| is_placed(octave, tube, space, h);
        let placed = sum.octaves.iter().filter(is_placed).count();
        let unplaced = sum.skipped as usize + sum.octaves.len() - placed;
        if !self.octave_fade {
            return [unplaced, 0];
        }
        let coarsest = match space {
            Space::Cylinder => {
                Rates::new(tube, sum, h).band(tube.radius.range([0.0, 1.0]), [0.0, f64::INFINITY], h)[0]
            }
            Space::World => square_in_world(sum, h),
        };
        let is_faded = |octave: &&Octave| coarsest * octave.finer >= BAND[1];
        [unplaced, sum.octaves.iter().filter(is_placed).filter(is_faded).count()]
    }
}
