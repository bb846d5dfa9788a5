//! The cylinder at rest, and the map that deforms it: the other way round from what the density needs.

use super::{Cylindrical, Reference};
use crate::scene::{Layer, Pattern, Space};
use std::f64::consts::TAU;

impl Reference {
    /// The density at rest at (u, v, l) of the cylinder of tube number `tube`, before anything below 0 is cut off; l
    /// is 0 to 1 from end to end, whether or not the tube is stretched.
    ///
    /// # Panics
    ///
    /// If there is no such tube.
    pub fn at_rest(&self, tube: usize, [u, v, l]: [f64; 3]) -> f64 {
        let bent = &self.tubes[tube];
        let at = Cylindrical {
            u,
            v,
            w: 0.0,
            l: if bent.tube.stretch { l } else { l * bent.axis.length() },
            fraction: l,
            radius: bent.wide(bent.radius.at(l)),
            focal: 1.0,
        };
        // A pattern over the world is the one that the point's image has. To find that takes long.
        let in_world =
            |layer: &Layer| matches!(&layer.pattern, Pattern::Perlin(noise) if noise.space == Space::World);
        let p = if bent.tube.layers.iter().any(in_world) { self.world(tube, [u, v, l]) } else { [0.0; 3] };
        if at.q() <= 1.0 { bent.contribution(p, &at, self.voxel_size) } else { 0.0 }
    }

    /// The world point, metres, that (u, v, l) of that cylinder is mapped to.
    ///
    /// # Panics
    ///
    /// If there is no such tube.
    pub fn world(&self, tube: usize, [u, v, l]: [f64; 3]) -> [f64; 3] {
        let bent = &self.tubes[tube];
        let (centre, frame) = bent.axis.section(l * bent.axis.length());
        let turns = bent.tube.twist * l + bent.tube.turned;
        let phi = TAU * (turns - turns.floor());
        let (sin, cos) = (libm::sin(phi), libm::cos(phi));
        let across = frame.normal * (u * cos - v * sin) + frame.binormal * (u * sin + v * cos);
        (centre + bent.wide(bent.radius.at(l)) * across).into()
    }
}
