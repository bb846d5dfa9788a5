//! What a scene does not need and so is not evaluated, in words.

use super::narrow::Rates;
use super::tube::{LayerKind, Tube};
use super::{Field, Lattice};
use crate::noise::BAND;
use crate::scene::{Caps, Conserve, Radial};

impl Field {
    /// The stages left out of the evaluation at a lattice, each with the reason, tube by tube.
    ///
    /// Besides these, every block leaves out what cannot matter to it: far axes, octaves that have faded there, the fade
    /// of far ends, and the fade at the focal set where it is certainly 1.
    pub fn left_out(&self, lattice: Lattice) -> Vec<String> {
        self.tubes.iter().flat_map(|tube| self.left_out_of(tube, lattice)).collect()
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
            say("widening: it is off, or no part is thinner than two voxels".into());
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
        if tube.layers.is_empty() {
            say("layers: there are none, the tube is filled with 1".into());
        }
        for (number, layer) in (1..).zip(&tube.layers) {
            if layer.threshold.is_none() {
                say(format!("threshold of layer {number}: none is given"));
            }
            let LayerKind::Fractal(fractal) = &layer.kind else { continue };
            if !self.octave_fade {
                say(format!("fading of octaves in layer {number}: switched off"));
            }
            let skipped = fractal.skipped;
            if skipped > 0 {
                say(format!(
                    "{skipped} octaves of layer {number}: without amplitude, or finer than 2^22 cells"
                ));
            }
            if self.octave_fade {
                let rates = Rates::new(tube, fractal, lattice.voxel_size);
                let coarsest = rates.band(tube, [0.0, tube.curve.length()], lattice.voxel_size)[0];
                let faded = fractal
                    .octaves
                    .iter()
                    .filter(|octave| coarsest + f64::from(octave.index) * fractal.log2_lacunarity >= BAND[1])
                    .count();
                if faded > 0 {
                    say(format!("{faded} octaves of layer {number}: above 1.6 cells a voxel everywhere"));
                }
            }
        }
        out
    }
}
