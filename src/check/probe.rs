//! A scene's density at voxels, at every instruction set and by the reference.

use rayon::prelude::*;

use crate::field::{Extent, Field, Lattice};
use crate::num::Level;
use crate::reference::Reference;
use crate::report::random;
use crate::scene::Scene;
use crate::volume::{Brick, Plan, PlanError, Store, bake};

/// Bytes for a plan.
const BUDGET: u64 = 1 << 30;
/// Bricks that are evaluated.
const BRICKS: usize = 96;

/// A scene at a voxel size.
pub(super) struct Probe {
    pub(super) scene: Scene,
    pub(super) field: Field,
    pub(super) lattice: Lattice,
    pub(super) plan: Plan,
}

/// How far the evaluation is from the definition.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Deviation {
    /// At voxels.
    pub(super) largest: f64,
    /// Root mean square of that.
    pub(super) rms: f64,
    /// The largest density among them.
    pub(super) peak: f64,
    /// The largest density by the definition in bricks that are not planned, beside those that are.
    pub(super) lost: f64,
    /// Voxels.
    pub(super) compared: usize,
}

impl Probe {
    /// Plans a scene for point samples.
    pub(super) fn new(scene: Scene, voxel_size: f64) -> Result<Probe, PlanError> {
        let mut field = Field::compile(&scene);
        let lattice = Lattice { voxel_size };
        field.widen(lattice);
        let plan = Plan::for_extent(&field, lattice, Extent::Centres, BUDGET)?;
        Ok(Probe { scene, field, lattice, plan })
    }

    /// The centre of a voxel, in metres.
    fn centre(&self, voxel: [i32; 3]) -> [f64; 3] {
        voxel.map(|i| (f64::from(i) + 0.5) * self.lattice.voxel_size)
    }

    /// Some of the bricks, or all, at an instruction set; all where they are few.
    fn bricks(&self, level: Level) -> Vec<Brick> {
        let mut store = Store::default();
        let Ok(_) = bake(&self.field, &self.plan.sample(BRICKS), 0.0, level, &mut store, |_| ());
        store.bricks().to_vec()
    }

    /// Holds the bricks against the reference at about `count` voxels, and beside the plan at half as many.
    pub(super) fn deviation(&self, count: usize, beside_jumps: f64) -> Result<Deviation, String> {
        let best = self.bricks(Level::best());
        for level in Level::all() {
            if !same_bits(&best, &self.bricks(level)) {
                return Err(format!("{} and {} find other bits", level.name(), Level::best().name()));
            }
        }
        if let Some(value) =
            best.iter().flat_map(|brick| brick.values).find(|x| !(x.is_finite() && *x >= 0.0))
        {
            return Err(format!("{value} is stored"));
        }
        let sample = self.plan.sample(BRICKS);
        if sample.bricks() == 0 {
            return Ok(Deviation { largest: 0.0, rms: 0.0, peak: 0.0, lost: 0.0, compared: 0 });
        }
        let reference = Reference::new(&self.scene, Some(self.lattice.voxel_size));
        let stored = |voxel: [i32; 3]| {
            let origin = voxel.map(|i| i & !7);
            let at = voxel.map(|i| usize::try_from(i & 7).unwrap_or_default());
            let brick = best.iter().find(|brick| brick.origin == origin);
            brick.map_or(0.0, |brick| f64::from(brick.values[at[0] * 64 + at[1] * 8 + at[2]]))
        };
        let pairs: Vec<[f64; 2]> = (0..count as u64)
            .into_par_iter()
            .map(|number| voxel_of(sample.origin(below(number, sample.bricks())), number))
            .filter(|voxel| beside_jumps == 0.0 || !self.jumps_near(&reference, *voxel, beside_jumps))
            .map(|voxel| [stored(voxel), reference.density(self.centre(voxel))])
            .collect();
        let lost = (0..count as u64 / 2)
            .into_par_iter()
            .filter_map(|number| {
                let brick = self.plan.block(below(number, self.plan.bricks()));
                let bits = random::bits(BESIDE, number);
                let beside: [i64; 3] = std::array::from_fn(|axis| {
                    brick[axis] + [-1, 0, 1][(bits >> (8 * axis) & 0xff) as usize % 3]
                });
                self.plan.find(beside).is_none().then_some((beside, number))
            })
            .filter_map(|(brick, number)| Some((brick_origin(brick)?, number)))
            .map(|(origin, number)| voxel_of(origin, number))
            .filter(|voxel| beside_jumps == 0.0 || !self.jumps_near(&reference, *voxel, beside_jumps))
            .map(|voxel| reference.density(self.centre(voxel)))
            .reduce(|| 0.0, worst);
        let squares: f64 = pairs.iter().map(|[a, b]| (a - b) * (a - b)).sum();
        let largest = pairs.iter().map(|[a, b]| (a - b).abs());
        #[allow(clippy::cast_precision_loss, reason = "a few thousand")]
        Ok(Deviation {
            largest: largest.fold(0.0, worst),
            rms: (squares / pairs.len().max(1) as f64).sqrt(),
            peak: pairs.iter().map(|[_, truth]| *truth).fold(0.0, worst),
            lost,
            compared: pairs.len(),
        })
    }

    /// Whether the surface of a hard envelope, an end plane, a plane between sectors or a step of the radius is within a
    /// part of a radius.
    fn jumps_near(&self, reference: &Reference, voxel: [i32; 3], near: f64) -> bool {
        (0..self.scene.tubes().len()).any(|tube| {
            let knots = self.scene.tubes()[tube].radius.knots();
            reference.cylinder(tube, self.centre(voxel)).iter().any(|at| {
                let is_near = |a: f64, b: f64| (a - b).abs() < near;
                is_near(at.q(), 1.0)
                    || is_near(at.u, 0.0)
                    || is_near(at.v, 0.0)
                    || knots.iter().any(|knot| is_near(at.fraction, *knot))
            })
        })
    }
}

/// The larger; no number where one is none.
pub(super) fn worst(a: f64, b: f64) -> f64 {
    if a.is_nan() || b.is_nan() { f64::NAN } else { a.max(b) }
}

/// Streams of random numbers.
const BRICK: u64 = 0x6272_6963;
const VOXEL: u64 = 0x766f_7865;
const BESIDE: u64 = 0x6265_7369;

/// One of so many.
fn below(number: u64, count: usize) -> usize {
    usize::try_from(random::bits(BRICK, number) % count as u64).unwrap_or_default()
}

/// One of a brick's voxels.
fn voxel_of(origin: [i32; 3], number: u64) -> [i32; 3] {
    let bits = random::bits(VOXEL, number);
    std::array::from_fn(|axis| origin[axis] + i32::try_from(bits >> (8 * axis) & 7).unwrap_or_default())
}

fn brick_origin(brick: [i64; 3]) -> Option<[i32; 3]> {
    let [x, y, z] = brick.map(|b| i32::try_from(8 * b).ok().filter(|at| *at <= i32::MAX - 8));
    Some([x?, y?, z?])
}

fn same_bits(a: &[Brick], b: &[Brick]) -> bool {
    let bits = |brick: &Brick| brick.values.map(f32::to_bits);
    a.len() == b.len()
        && a.iter().zip(b).all(|(a, b)| a.origin == b.origin && a.mask == b.mask && bits(a) == bits(b))
}
