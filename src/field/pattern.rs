//! Noise layers at one time, compiled: octaves on their lattices, and the displacement before them.

use crate::noise::{self, Form, octave_offset, octave_seed, turn, turn_around, warp_seed};
use crate::scene::{Fbm, Space};

/// More cells than this, across the tube, around a loop, or in a warp's way, leave an octave out: single precision cannot
/// place a voxel in them.
const FINEST: f64 = 4_194_304.0;

/// Along axes of lower frequency a warp does nothing.
const LEAST_FREQUENCY: f64 = 1e-9;

/// A noise layer's pattern.
#[derive(Debug, Clone)]
pub(crate) struct Perlin {
    pub(crate) space: Space,
    pub(crate) warp: Option<Warp>,
    pub(crate) sum: Fractal,
    /// Of so many octaves that matter somewhere, as many as are worth summing there before it is asked whether the sum can still
    /// reach the layer's threshold: all, where that is not worth asking.
    pub(crate) first: Vec<usize>,
}

/// Displacement of a pattern's coordinates.
#[derive(Debug, Clone)]
pub(crate) struct Warp {
    /// The sum for each axis.
    pub(crate) sums: [Fractal; 3],
    /// What a sum of 1 adds to each coordinate.
    pub(crate) reach: [f64; 3],
}

/// A fractal sum.
#[derive(Debug, Clone)]
pub(crate) struct Fractal {
    pub(crate) octaves: Vec<Octave>,
    pub(crate) form: Form,
    /// Cells per unit of the coordinates in the first octave, as the scene has them.
    pub(crate) frequency: [f64; 3],
    /// Octaves of the scene that are never evaluated, and what they add.
    pub(crate) skipped: u32,
    pub(crate) mean: f64,
}

#[derive(Debug, Clone)]
pub(crate) struct Octave {
    /// Square of its frequency over the first octave's.
    pub(crate) finer: f64,
    pub(crate) frequency: [f64; 3],
    /// Change of each lattice coordinate per unit of each coordinate.
    pub(crate) steps: [[f64; 3]; 3],
    /// Lattice coordinate at (0, 0, 0).
    pub(crate) origin: [f64; 3],
    /// Cells around a loop.
    pub(crate) period: Option<f64>,
    pub(crate) seed: u32,
    pub(crate) amplitude: f64,
    /// As it is at (0, 0, 0); `None` where its first two lattice coordinates change along the third axis, too.
    pub(crate) template: Option<noise::Octave<f64>>,
}

/// What all sums of a pattern share.
struct Ground {
    /// Growth of the third coordinate around a closed tube.
    around: Option<f64>,
    /// Frequency of the pattern's first octave, and cells that it has moved.
    first: [f64; 3],
    moved: [f64; 3],
    /// The axes along which a warp does something.
    warps: [bool; 3],
    offset: [f64; 3],
    space: Space,
    rotate: bool,
}

/// One sum.
struct Sum {
    frequency: [f64; 3],
    octaves: u32,
    lacunarity: f64,
    gain: f64,
    normalise: bool,
    seed: u32,
    form: Form,
    /// Cells of the first octave by which its coordinates are displaced.
    displaced: f64,
    /// Whether it also moves along axes that it does not change along.
    drifts: bool,
}

impl Perlin {
    /// On a closed tube l grows by `around`; only what is above the threshold counts, if there is one.
    pub(crate) fn compile(fbm: &Fbm, around: Option<f64>, threshold: Option<f64>) -> Perlin {
        let around = around.filter(|_| fbm.space == Space::Cylinder);
        let ground = Ground {
            around,
            first: frequency(fbm.frequency, around),
            moved: fbm.scrolled,
            warps: fbm.frequency.map(|f| f >= LEAST_FREQUENCY),
            offset: fbm.offset,
            space: fbm.space,
            rotate: fbm.rotate,
        };
        let warp = fbm.warp.as_ref().filter(|warp| warp.amplitude > 0.0 && fbm.octaves > 0);
        let sum = Sum {
            frequency: fbm.frequency,
            octaves: fbm.octaves,
            lacunarity: fbm.lacunarity,
            gain: fbm.gain,
            normalise: fbm.normalise,
            seed: fbm.seed,
            form: fbm.form,
            displaced: warp.map_or(0.0, |warp| warp.amplitude),
            drifts: true,
        };
        let warp = warp.map(|warp| Warp {
            sums: [0, 1, 2].map(|axis| {
                ground.compile(&Sum {
                    frequency: warp.frequency,
                    octaves: warp.octaves,
                    lacunarity: warp.lacunarity,
                    gain: warp.gain,
                    normalise: true,
                    seed: warp_seed(warp.seed, axis),
                    form: Form::Fbm,
                    displaced: 0.0,
                    drifts: false,
                })
            }),
            reach: [0, 1, 2]
                .map(|axis| if ground.warps[axis] { warp.amplitude / ground.first[axis] } else { 0.0 }),
        });
        let sum = ground.compile(&sum);
        let first =
            (0..=sum.octaves.len()).map(|count| threshold.map_or(count, |t| sum.first(count, t))).collect();
        Perlin { space: fbm.space, warp, sum, first }
    }
}

impl Ground {
    fn compile(&self, sum: &Sum) -> Fractal {
        let mut octaves = Vec::new();
        let mut skipped = Vec::new();
        let (mut scale, mut amplitude, mut total) = (1.0, 1.0, 0.0);
        for index in 0..sum.octaves {
            let octave = self.octave(sum, index, scale, amplitude);
            if amplitude > 0.0 && self.is_placed(&octave, sum.displaced) {
                octaves.push(octave);
            } else {
                skipped.push(amplitude);
            }
            total += amplitude;
            scale *= sum.lacunarity;
            amplitude *= sum.gain;
        }
        let mut mean = skipped.iter().sum::<f64>() * sum.form.mean();
        if sum.normalise && total > 0.0 {
            for octave in &mut octaves {
                octave.amplitude /= total;
            }
            mean /= total;
        }
        for octave in &mut octaves {
            octave.template = octave.template(sum.form);
        }
        Fractal {
            octaves,
            form: sum.form,
            frequency: sum.frequency,
            skipped: u32::try_from(skipped.len()).expect("32 octaves at most"),
            mean,
        }
    }

    fn octave(&self, sum: &Sum, index: u32, scale: f64, amplitude: f64) -> Octave {
        let frequency = frequency(sum.frequency.map(|f| f * scale), self.around);
        let rows = match (self.rotate, self.around) {
            (false, _) => [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
            (true, None) => turn(index),
            (true, Some(_)) => turn_around(index),
        };
        let offset = octave_offset(sum.seed, index);
        // Cells at the origin, before the turn.
        let start = [0, 1, 2].map(|axis| {
            let pace = match sum.drifts {
                true if self.first[axis] > 0.0 => frequency[axis] / self.first[axis],
                true => scale,
                false if self.warps[axis] => frequency[axis] / self.first[axis],
                false => 0.0,
            };
            frequency[axis] * self.offset[axis] - self.moved[axis] * pace
        });
        let turned = rows.map(|row| row[0] * start[0] + row[1] * start[1] + row[2] * start[2]);
        Octave {
            finer: scale * scale,
            frequency,
            steps: rows.map(|row| [0, 1, 2].map(|axis| row[axis] * frequency[axis])),
            origin: [0, 1, 2].map(|axis| turned[axis] + offset[axis]),
            period: self.around.filter(|_| frequency[2] > 0.0).map(|around| (frequency[2] * around).round()),
            seed: octave_seed(sum.seed, index),
            amplitude,
            template: None,
        }
    }

    /// Whether single precision can place a voxel in it, where a warp displaces by so many cells of the first octave.
    fn is_placed(&self, octave: &Octave, displaced: f64) -> bool {
        let across = octave.frequency[0].max(octave.frequency[1]);
        let displaced = [0, 1, 2].map(|axis| {
            if self.warps[axis] { displaced / self.first[axis] * octave.frequency[axis] } else { 0.0 }
        });
        (self.space == Space::World || across <= FINEST)
            && octave.period.is_none_or(|cells| cells <= FINEST)
            && displaced.iter().all(|cells| *cells <= FINEST)
            && octave.origin.iter().all(|x| x.is_finite())
    }
}

impl Fractal {
    /// Of the first `count` octaves, those worth summing before it is asked which sums can still reach the threshold: where the
    /// most octaves are then saved, if sums are distributed normally.
    fn first(&self, count: usize, threshold: f64) -> usize {
        /// Octaves a voxel that asking takes the time of.
        const ASKING: f64 = 0.35;
        /// Standard deviations in the range of an octave.
        const DEVIATIONS: f64 = 8.0;
        let [low, high] = self.form.range();
        let (kept, left_out) = self.octaves.split_at(count);
        let mut mean =
            self.mean + left_out.iter().map(|octave| octave.amplitude * self.form.mean()).sum::<f64>();
        let mut rise: f64 = kept.iter().map(|octave| octave.amplitude * high).sum();
        let (mut variance, mut best, mut most) = (0.0, count, ASKING);
        for (octave, summed) in kept.iter().zip(1..) {
            mean += octave.amplitude * self.form.mean();
            rise -= octave.amplitude * high;
            let deviation = octave.amplitude * (high - low) / DEVIATIONS;
            variance += deviation * deviation;
            let below = (threshold - rise - mean) / f64::sqrt(variance);
            let hopeless = 0.5 * libm::erfc(-below * std::f64::consts::FRAC_1_SQRT_2);
            #[allow(clippy::cast_precision_loss, reason = "32 octaves at most")]
            let saved = hopeless * (count - summed) as f64;
            if saved > most {
                (best, most) = (summed, saved);
            }
        }
        best
    }
}

impl Octave {
    fn template(&self, form: Form) -> Option<noise::Octave<f64>> {
        let Octave { origin, steps, period, seed, amplitude, .. } = *self;
        let is_along = steps[0][2] == 0.0 && steps[1][2] == 0.0;
        is_along.then(|| noise::Octave::turned(origin, steps, period, form, seed, amplitude))
    }
}

/// Cells per unit; around a loop, as near to those as closes the pattern.
fn frequency([u, v, l]: [f64; 3], around: Option<f64>) -> [f64; 3] {
    match around {
        Some(around) if l > 0.0 => [u, v, (l * around).round().max(1.0) / around],
        _ => [u, v, l],
    }
}
