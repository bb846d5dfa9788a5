//! Two fields of numbers beside each other.

use glam::DVec3;
use serde::{Deserialize, Serialize};

use super::errors::{Errors, Intervals, Scaled, intervals as intervals_of};
use super::ray::{Chord, chords};
use super::source::Source;
use super::support::{Spread, spread};
use super::voxels::{VoxelDifference, voxel_by_voxel};

/// At how many places fields are compared.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Places {
    /// Points.
    pub points: usize,
    /// Rays.
    pub rays: usize,
}

/// How field b differs from field a.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct FieldDifference {
    /// Points in the union of both supports.
    pub points: u64,
    /// The union's volume in metres^3.
    pub volume: f64,
    /// At the points.
    pub errors: Errors,
    /// Bootstrap intervals of 95 %; null without points.
    pub intervals: Option<Intervals>,
    /// The point of the largest difference, in metres; null where there is none.
    pub worst: Option<[f64; 3]>,
    /// A point where a value is NaN or infinite.
    pub not_finite_at: Option<[f64; 3]>,
    /// The integrals over the union.
    pub mass: Mass,
    /// Along rays.
    pub optical_depth: Depth,
    /// Voxel by voxel; null unless both are grids of one lattice.
    pub voxels: Option<VoxelDifference>,
}

/// Integrals over the union of both supports, in the values' unit times metres^3.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Mass {
    /// Of a and of b.
    pub of: [f64; 2],
    /// Half the width of their intervals of 95 %.
    pub uncertainty: [f64; 2],
    /// Of b over that of a; null where that is 0.
    pub ratio: Option<f64>,
    /// Its interval of 95 %. Narrower than those of the masses tell, since both are taken at the same points.
    pub ratio_interval: Option<[f64; 2]>,
}

/// Integrals along rays, in the values' unit times metres.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Depth {
    /// Rays.
    pub rays: u64,
    /// Rays of a, and of b, whose integral is NaN or infinite.
    pub not_finite: [u64; 2],
    /// Root mean square and largest of a's.
    pub rms: f64,
    /// Largest magnitude of a's.
    pub peak: f64,
    /// Mean of the difference's magnitude.
    pub l1: Scaled,
    /// Root mean square of the difference.
    pub l2: Scaled,
    /// Largest difference.
    pub max: Scaled,
    /// Bootstrap interval of 95 % of the root mean square of the difference as a part of that of a's; null where there are no
    /// rays, or a's is 0.
    pub relative_l2: Option<[f64; 2]>,
}

/// Compares two fields, on the current `rayon` pool: at points spread evenly over the union of their supports, along rays
/// through every so-manieth of these points, in all directions alike, cut to the box around the union, and, where both are grids
/// of one lattice, voxel by voxel. All places are the same at every run.
pub fn compare(a: &dyn Source, b: &dyn Source, places: Places) -> FieldDifference {
    compare_at(a, b, &spread(a.support(), b.support(), places.points), places.rays).0
}

/// What two fields are at the places where they were compared.
#[derive(Debug, Clone, PartialEq)]
pub struct Residuals {
    /// Points of the world, in metres.
    pub points: Vec<DVec3>,
    /// The first field's values there, and the second's.
    pub values: [Vec<f64>; 2],
    /// Rays.
    pub chords: Vec<Chord>,
    /// Integrals along them, of the first and of the second.
    pub depths: [Vec<f64>; 2],
}

/// The same at given points, and along up to `rays` rays through them; with the values themselves.
pub fn compare_at(
    a: &dyn Source,
    b: &dyn Source,
    places: &Spread,
    rays: usize,
) -> (FieldDifference, Residuals) {
    let Spread { points, volume } = places;
    let values = [a, b].map(|source| source.values(points));
    let chords = chords_of([a.support().bounds(), b.support().bounds()], points, rays);
    let depths = [a, b].map(|source| source.depths(&chords));
    let same = a.support().shares_lattice(b.support());
    let voxels = match (a.voxels(), b.voxels()) {
        (Some(x), Some(y)) if same => Some(voxel_by_voxel(x, y, a.support().voxel_volume())),
        _ => None,
    };
    let residuals = Residuals { points: points.clone(), values, chords, depths };
    (FieldDifference { voxels, ..residuals.difference(*volume) }, residuals)
}

/// Up to `rays` rays through points, cut to the box around two others.
pub(super) fn chords_of(bounds: [Option<[DVec3; 2]>; 2], points: &[DVec3], rays: usize) -> Vec<Chord> {
    let bounds = match bounds {
        [Some([low, high]), Some([l, h])] => Some([low.min(l), high.max(h)]),
        [one, other] => one.or(other),
    };
    bounds.map_or_else(Vec::new, |bounds| chords(bounds, points, rays))
}

impl Residuals {
    /// How the second field differs from the first, over so many metres^3; not voxel by voxel.
    pub fn difference(&self, volume: f64) -> FieldDifference {
        let Residuals { points, values: [of_a, of_b], chords, depths: [along_a, along_b] } = self;
        let errors = Errors::new(of_a.iter().copied().zip(of_b.iter().copied()), None);
        let intervals = intervals_of(of_a, of_b);
        let pairs = || of_a.iter().zip(of_b).zip(points);
        let finite = |a: f64, b: f64| a.is_finite() && b.is_finite();
        let worst = pairs()
            .filter(|((a, b), _)| finite(**a, **b))
            .map(|((a, b), point)| ((b - a).abs(), point))
            .filter(|(difference, _)| *difference > 0.0)
            .max_by(|x, y| x.0.total_cmp(&y.0));
        let not_finite_at = pairs().find(|((a, b), _)| !finite(**a, **b)).map(|(_, point)| point.to_array());
        let along = Errors::new(along_a.iter().copied().zip(along_b.iter().copied()), None);
        let along_held = intervals_of(along_a, along_b);
        FieldDifference {
            points: points.len() as u64,
            volume,
            mass: mass([of_a, of_b], volume, intervals.as_ref()),
            intervals,
            worst: worst.map(|(_, point)| point.to_array()),
            not_finite_at,
            optical_depth: Depth {
                rays: chords.len() as u64,
                not_finite: along.not_finite,
                rms: along.rms,
                peak: along.peak,
                l1: along.l1,
                l2: along.l2,
                max: along.max,
                relative_l2: along_held.and_then(|held| held.relative_l2),
            },
            voxels: None,
            errors,
        }
    }
}

/// From the mean over points at which both are finite.
fn mass([a, b]: [&[f64]; 2], volume: f64, intervals: Option<&Intervals>) -> Mass {
    let (mut sums, mut count) = ([0.0; 2], 0.0_f64);
    for (a, b) in a.iter().zip(b).filter(|(a, b)| a.is_finite() && b.is_finite()) {
        sums = [sums[0] + a, sums[1] + b];
        count += 1.0;
    }
    let of = sums.map(|sum| sum / count.max(1.0) * volume);
    let width = |[low, high]: [f64; 2]| 0.5 * (high - low) * volume;
    Mass {
        of,
        uncertainty: intervals.map_or([0.0; 2], |intervals| intervals.mean.map(width)),
        ratio: (of[0] != 0.0).then(|| of[1] / of[0]),
        ratio_interval: intervals.and_then(|intervals| intervals.ratio),
    }
}
