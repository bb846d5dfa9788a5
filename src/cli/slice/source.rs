//! Where slices come from: a scene, baked layer by layer of bricks, or a file's grid.

use std::collections::BTreeMap;
use std::fs::File;
use std::ops::Range;
use std::path::Path;

use rayon::prelude::*;

use super::{Arguments, PROCESS};
use crate::cli::grids::{Choice, choose};
use crate::cli::job::{Compiled, Source};
use crate::cli::memory::{enough, unplanned_beside, unread};
use crate::cli::{Failure, text};
use crate::field::Field;
use crate::formats::vdb::{AnyPartialTree, AnyTree, PartialGrid, VdbFile, VdbReadError};
use crate::num::Level;
use crate::volume::{
    self, Axis, Brick, IN_FLIGHT, Leaf, Part, PartialTree, Plan, PlanError, Sampled, Slicing, Store, Value,
};

/// Bytes for reading leaves: what is read of a file at once, in a list that grows by doubling.
const READING: u64 = 8 << 20;

/// The values of a plane, in rows from the top.
pub(in crate::cli) enum Plane {
    Numbers(Vec<f32>),
    Vectors([Vec<f32>; 3]),
}

/// What is sliced.
pub(in crate::cli) struct Sliced {
    pub(in crate::cli) slicing: Slicing,
    /// Whether there is nothing; then it is of one voxel, since no image is of none.
    pub(in crate::cli) is_empty: bool,
    pub(in crate::cli) grid: String,
    /// Rows of A in `world = A (i, j, k, 1)`, where the integer point (i, j, k) is a voxel's centre.
    pub(in crate::cli) index_to_world: Option<[[f64; 4]; 3]>,
    /// Whether values are stored as 16-bit floats.
    pub(super) half: bool,
    /// Whether values are vectors.
    pub(in crate::cli) is_vector: bool,
    /// Seconds after the start frame, of scenes.
    pub(super) time: Option<f64>,
    values: Values,
    cost: Cost,
}

enum Values {
    /// The plan is `None` where there is no room for it.
    Scene {
        field: Box<Field>,
        plan: Option<Box<Plan>>,
        cutoff: f64,
    },
    Whole(AnyPartialTree),
    File {
        file: Box<VdbFile<File>>,
        number: usize,
    },
}

/// Bytes that values take of the memory before they are pixels.
struct Cost {
    /// Without any values: a plan, or the nodes of a tree.
    bare: u64,
    /// All values at once, where they can be held so.
    whole: Option<u64>,
    /// The values of each layer of leaves that has any, by its place along the axis.
    layers: BTreeMap<i32, u64>,
    /// What it takes to make or to read values.
    working: u64,
    /// A pixel while its plane is made: a value as it is stored, and the numbers that it becomes.
    pixel: u64,
}

impl Cost {
    /// Of planes that are made layer by layer.
    fn by_layers(&self, slicing: &Slicing, planes: &[usize]) -> u64 {
        let place = |plane: &usize| slicing.index(*plane).div_euclid(8);
        let layer =
            planes.iter().filter_map(|plane| self.layers.get(&place(plane))).max().copied().unwrap_or(0);
        self.bare.saturating_add(layer).saturating_add(self.working).saturating_add(self.planes(slicing))
    }

    /// Of all values at once.
    fn whole(&self, slicing: &Slicing) -> Option<u64> {
        Some(self.whole?.saturating_add(self.working).saturating_add(self.planes(slicing)))
    }

    /// Of the planes of one layer.
    fn planes(&self, slicing: &Slicing) -> u64 {
        let [width, height] = slicing.pixels().map(|edge| edge as u64);
        (8 * self.pixel).saturating_mul(width).saturating_mul(height)
    }
}

impl Sliced {
    /// A scene.
    pub(super) fn of_scene(arguments: &Arguments) -> Result<Sliced, Failure> {
        let options = &arguments.scene;
        let Compiled { scene, field, lattice, time, .. } =
            Source::read(&arguments.file, options)?.compile(options.time())?;
        let h = lattice.voxel_size;
        let budget = options.budget().bytes().saturating_sub(PROCESS);
        #[allow(
            clippy::cast_possible_truncation,
            reason = "saturates where the plan finds that indices do not fit"
        )]
        let bounds = field.bounds().map(|[lo, hi]| {
            let (first, last) = ((lo / h).floor(), (hi / h).ceil() - 1.0);
            [first, last.max(first)].map(|corner| corner.to_array().map(|i| i as i32))
        });
        let slicing = slicing(arguments.axis.into(), bounds);
        let axis = Axis::from(arguments.axis).number();
        // Lists of bricks grow by doubling.
        const LISTED: u64 = 2 * size_of::<Brick>() as u64;
        let in_flight = |bricks: u64| LISTED * bricks.min((IN_FLIGHT * rayon::current_num_threads()) as u64);
        let pixel = size_of::<f32>() as u64;
        let (plan, cost) = match Plan::new(&field, lattice, budget) {
            Ok(plan) => {
                let mut layers = BTreeMap::new();
                for origin in plan.origins() {
                    *layers.entry(origin[axis].div_euclid(8)).or_default() += LISTED;
                }
                // A layer has a plan of its own.
                let bare = 2 * plan.memory() as u64;
                let working = in_flight(plan.bricks() as u64);
                (Some(Box::new(plan)), Cost { bare, whole: None, layers, working, pixel })
            }
            // There is none to be sliced, but it can be told what all of it takes at most.
            Err(PlanError::TooMany { bricks, enough: Some(enough) }) => {
                #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "saturates")]
                let bricks = bricks as u64;
                let [across, above] = slicing.pixels().map(|edge| edge as u64 / 8 + 2);
                let layer = LISTED.saturating_mul(bricks.min(across.saturating_mul(above)));
                // To make a plan takes half as much again as it does.
                let bare = (enough.bytes / 2).saturating_add(enough.bytes).max(budget.saturating_add(1));
                let working = layer.saturating_add(in_flight(bricks));
                (None, Cost { bare, whole: None, layers: BTreeMap::new(), working, pixel })
            }
            Err(error) => return Err(unplanned_beside(error, PROCESS)),
        };
        Ok(Sliced {
            slicing,
            is_empty: bounds.is_none(),
            grid: "density".to_owned(),
            index_to_world: Some([[h, 0.0, 0.0, 0.5 * h], [0.0, h, 0.0, 0.5 * h], [0.0, 0.0, h, 0.5 * h]]),
            half: false,
            is_vector: false,
            time: Some(time),
            values: Values::Scene { field: Box::new(field), plan, cutoff: scene.bake().cutoff },
            cost,
        })
    }

    /// A grid of a file: the one of this name, if one is given. Of its values none is read yet.
    pub(in crate::cli) fn of_file(
        path: &Path,
        grid: Option<&str>,
        axis: Axis,
        budget: u64,
    ) -> Result<Sliced, Failure> {
        let failed = |error: VdbReadError| unread(path, error, PROCESS);
        let file = File::open(path).map_err(|error| Failure::unreadable(path, error))?;
        let mut file = VdbFile::open_within(file, budget.saturating_sub(PROCESS)).map_err(failed)?;
        let Choice { number, label } = choose(file.info(), grid, failed)?;
        // Its nodes alone, to know its box.
        let PartialGrid { info, tree } = file.grid_part_at(number, &Part::around([])).map_err(failed)?;
        let (stats, is_vector) = (stats(&tree), is_vector(&tree));
        let cost = cost(&tree, axis.number());
        Ok(Sliced {
            slicing: slicing(axis, stats.bounds),
            is_empty: stats.bounds.is_none(),
            grid: label,
            index_to_world: info.map.matrix,
            half: info.half,
            is_vector,
            time: None,
            values: Values::File { file: Box::new(file), number },
            cost,
        })
    }

    /// Settles how values of these planes are held within a budget: all of them where there is room, else layer by layer. Gives
    /// the bytes that they take at most, which may be more than the budget.
    pub(in crate::cli) fn settle(
        &mut self,
        planes: &[usize],
        budget: u64,
        path: &Path,
    ) -> Result<u64, Failure> {
        if let (Values::File { file, number }, Some(whole)) =
            (&mut self.values, self.cost.whole(&self.slicing))
            && whole <= budget
        {
            let tree: AnyTree = file.grid_at(*number).map_err(|error| unread(path, error, PROCESS))?.tree;
            self.values = Values::Whole(tree.into());
            return Ok(whole);
        }
        Ok(self.cost.by_layers(&self.slicing, planes))
    }

    /// Planes of one layer of leaves.
    pub(in crate::cli) fn planes(
        &mut self,
        slicing: &Slicing,
        planes: &Range<usize>,
        path: &Path,
    ) -> Result<Vec<Plane>, Failure> {
        match &mut self.values {
            Values::Scene { field, plan, cutoff } => {
                let Some(plan) = plan else { return Err(too_much(self.cost.bare)) };
                let ends = [slicing.index(planes.start), slicing.index(planes.end - 1)];
                let slab = plan.slab(slicing.axis().number(), ends);
                let mut store = Store::default();
                let Ok(_) = volume::bake(field, &slab, *cutoff, Level::best(), &mut store, |_| {});
                let plane = |plane| Plane::Numbers(slicing.of_bricks(store.bricks(), plane));
                Ok(planes.clone().into_par_iter().map(plane).collect())
            }
            Values::Whole(tree) => of_tree(tree, slicing, planes),
            Values::File { file, number } => {
                let part = file.grid_part_at(*number, &slicing.part(planes));
                of_tree(&part.map_err(|error| unread(path, error, PROCESS))?.tree, slicing, planes)
            }
        }
    }
}

/// Of a box, or of one voxel where there is none.
fn slicing(axis: Axis, bounds: Option<[[i32; 3]; 2]>) -> Slicing {
    bounds.and_then(|bounds| Slicing::new(axis, bounds)).unwrap_or_else(|| Slicing::of_voxel(axis, [0; 3]))
}

/// Evaluates an expression for a tree of any type.
macro_rules! any {
    ($any:expr, $tree:ident => $numbers:expr, $vectors:expr) => {
        match $any {
            AnyPartialTree::Bool($tree) => $numbers,
            AnyPartialTree::Int32($tree) => $numbers,
            AnyPartialTree::Int64($tree) => $numbers,
            AnyPartialTree::Float($tree) => $numbers,
            AnyPartialTree::Double($tree) => $numbers,
            AnyPartialTree::Vec3i($tree) => $vectors,
            AnyPartialTree::Vec3s($tree) => $vectors,
            AnyPartialTree::Vec3d($tree) => $vectors,
        }
    };
}

/// Of a tree whose nodes alone are known, sliced across an axis.
fn cost(tree: &AnyPartialTree, axis: usize) -> Cost {
    any!(tree, tree => cost_of(tree, axis, 1), cost_of(tree, axis, 3))
}

fn cost_of<T: Value>(tree: &PartialTree<T>, axis: usize, numbers: usize) -> Cost {
    let leaf = size_of::<[T; 512]>() as u64;
    // The list of leaves grows by doubling.
    let list = (tree.leaf_count() * size_of::<Leaf>()) as u64;
    Cost {
        bare: tree.memory_bytes_with(0) + list,
        whole: Some(tree.memory_bytes_with(tree.leaf_count()) + list),
        layers: tree.layers(axis).into_iter().map(|(place, count)| (place, count as u64 * leaf)).collect(),
        working: READING,
        pixel: (size_of::<T>() + numbers * size_of::<f32>()) as u64,
    }
}

fn stats(tree: &AnyPartialTree) -> volume::Stats {
    any!(tree, tree => tree.stats(), tree.stats())
}

fn is_vector(tree: &AnyPartialTree) -> bool {
    any!(tree, _tree => false, true)
}

fn of_tree(tree: &AnyPartialTree, slicing: &Slicing, planes: &Range<usize>) -> Result<Vec<Plane>, Failure> {
    let plane = |plane| any!(tree, tree => numbers(tree, slicing, plane), vectors(tree, slicing, plane));
    let planes: Result<Vec<Plane>, volume::NotRead> = planes.clone().into_par_iter().map(plane).collect();
    planes.map_err(|error| Failure::failed("cannot slice the grid").because(error))
}

fn numbers<T: Sampled<Wide = f64>>(
    tree: &PartialTree<T>,
    slicing: &Slicing,
    plane: usize,
) -> Result<Plane, volume::NotRead> {
    let values = slicing.of_tree(tree, plane)?;
    Ok(Plane::Numbers(values.into_iter().map(|value| single(value.wide())).collect()))
}

fn vectors<T: Sampled<Wide = [f64; 3]>>(
    tree: &PartialTree<T>,
    slicing: &Slicing,
    plane: usize,
) -> Result<Plane, volume::NotRead> {
    let values = slicing.of_tree(tree, plane)?;
    let part = |axis: usize| values.iter().map(|value| single(value.wide()[axis])).collect();
    Ok(Plane::Vectors([part(0), part(1), part(2)]))
}

#[allow(clippy::cast_possible_truncation, reason = "to the nearest that the image can hold")]
fn single(value: f64) -> f32 {
    value as f32
}

/// Axes as they are named on the command line.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub(super) enum AxisName {
    /// Planes of y and z
    X,
    /// Planes of x and z, as seen along +y
    Y,
    /// Planes of x and y, as seen from above
    Z,
}

impl From<AxisName> for Axis {
    fn from(name: AxisName) -> Axis {
        match name {
            AxisName::X => Axis::X,
            AxisName::Y => Axis::Y,
            AxisName::Z => Axis::Z,
        }
    }
}

impl AxisName {
    pub(super) fn name(self) -> &'static str {
        ["x", "y", "z"][Axis::from(self).number()]
    }
}

/// In words, for messages.
pub(super) fn too_much(bytes: u64) -> Failure {
    Failure::failed(format!("the slices take {} of memory, and less may be used", text::bytes(bytes))).hint(format!(
        "write one file for each slice, -o NAME.####.exr, fewer with --planes, or allow more with --memory {}",
        enough(bytes)
    ))
}
