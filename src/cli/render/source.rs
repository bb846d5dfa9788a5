//! What is drawn: a scene's density, or a file's grid.

use std::fs::File;
use std::path::Path;

use glam::DVec3;

use super::Arguments;
use crate::cli::grids::{Choice, choose};
use crate::cli::job::{Compiled, Source, read_scene};
use crate::cli::memory::{Amount, enough, unplanned_beside, unread};
use crate::cli::{Failure, Global, embedded};
use crate::field::{Field, Lattice};
use crate::formats::vdb::{AnyTree, GridInfo, Meta, Metadata, VdbFile, VdbReadError};
use crate::march::{Baked, BakedError, Grid, Meaning, Medium, Optics, Procedural};
use crate::scene::{self, Scene};
use crate::volume::{PlanError, Sampled, Tree};

/// Bytes that a scene's brick takes in a picture besides its plan, about, and its shadows.
const BRICK: u64 = 256;
/// Times what a file's grid takes that its bricks and their shadows do, about.
const DRAWN: u64 = 2;
const SHADOW: u64 = 1200;
/// A level set's density changes over so many voxels.
const SURFACE: f64 = 2.0;

/// What is drawn, and how it is looked at.
pub(super) struct Drawn<'a> {
    pub(super) medium: Medium<'a>,
    pub(super) view: View,
}

/// How something is looked at.
pub(super) struct View {
    pub(super) camera: scene::Camera,
    pub(super) optics: Optics,
    /// Corners of the box that it is framed by, in metres.
    pub(super) bounds: Option<[DVec3; 2]>,
    lattice: Option<Lattice>,
}

impl View {
    fn of_scene(scene: &Scene, bounds: Option<[DVec3; 2]>) -> View {
        View {
            camera: scene.camera(),
            optics: Optics::new(&scene.medium(), scene.lights()),
            bounds,
            lattice: None,
        }
    }
}

/// The field of a scene, and how it is looked at.
pub(super) fn scene(arguments: &Arguments) -> Result<(Field, View), Failure> {
    for (given, option) in [(arguments.scene.is_some(), "--scene"), (arguments.grid.is_some(), "--grid")] {
        if given {
            return Err(Failure::usage(format!("{option} has no meaning for a scene, only for a file")));
        }
    }
    let options = &arguments.options;
    let compiled = Source::read(&arguments.file, options)?.compile(options.time())?;
    let mut view = view_of(&compiled);
    view.lattice = Some(compiled.lattice);
    Ok((compiled.field, view))
}

fn view_of(compiled: &Compiled) -> View {
    View::of_scene(&compiled.scene, compiled.bounds.map(|corners| corners.map(DVec3::from)))
}

impl<'a> Drawn<'a> {
    /// A scene, evaluated wherever a ray asks; what it keeps takes no more than `budget` bytes.
    pub(super) fn of_scene(
        arguments: &Arguments,
        field: &'a Field,
        view: View,
        budget: u64,
    ) -> Result<Drawn<'a>, Failure> {
        let lattice = view.lattice.unwrap_or(Lattice { voxel_size: 1.0 });
        let marching = arguments.marching()?;
        let procedural = Procedural::new(field, lattice, arguments.step.unwrap_or(1.0), budget);
        let procedural = procedural.map_err(|error| {
            let besides = arguments.options.budget().bytes().saturating_sub(budget);
            let lamps = if arguments.light.keeps_shadows() { view.optics.lamps.len() as u64 } else { 0 };
            #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "saturates")]
            let bricks = if let PlanError::TooMany { bricks, .. } = error { bricks as u64 } else { 0 };
            unplanned_beside(error, besides.saturating_add(bricks.saturating_mul(BRICK + SHADOW * lamps)))
        })?;
        Ok(Drawn { medium: Medium::Procedural(procedural.with(marching)), view })
    }

    /// A file's grid, in no more than `budget` bytes.
    pub(super) fn of_file(arguments: &Arguments, budget: u64, global: &Global) -> Result<Drawn<'a>, Failure> {
        let options = &arguments.options;
        if let Some(option) = options.for_scenes_only().or(arguments.marching_option()) {
            return Err(Failure::usage(format!("{option} has no meaning for a file, only for a scene")));
        }
        let (halvings, sampling) = (arguments.halvings()?, arguments.sampling()?);
        let path = &arguments.file;
        let besides = options.budget().bytes().saturating_sub(budget);
        // Where there is no room to read it, it is told what drawing takes, too, about: most leaves become a brick, beside them.
        let failed = |error: VdbReadError| match &error {
            VdbReadError::Memory { needed, .. } => {
                let drawn = needed.saturating_mul(DRAWN);
                unread(path, error, besides.saturating_add(drawn))
            }
            _ => unread(path, error, besides),
        };
        let file = File::open(path).map_err(|error| Failure::unreadable(path, error))?;
        let mut file = VdbFile::open_within(file, budget).map_err(failed)?;
        let Choice { number, label } = choose(file.info(), arguments.grid.as_deref(), failed)?;
        let grid = file.grid_at(number).map_err(failed)?;
        let place = grid.info.map.matrix.and_then(|rows| Grid::from_rows(&rows)).ok_or_else(|| {
            Failure::input(format!("{label} is placed by a map that is not affine, or has no inverse"))
        })?;
        let meaning = meaning(&grid.info, &place);
        let bounds = bounds(&grid.tree, &place);
        let memory = Memory { budget, besides, shared: halvings > 0 || arguments.progressive };
        let baked = match &grid.tree {
            AnyTree::Bool(tree) => baked(tree, place, meaning, memory),
            AnyTree::Int32(tree) => baked(tree, place, meaning, memory),
            AnyTree::Int64(tree) => baked(tree, place, meaning, memory),
            AnyTree::Float(tree) => baked(tree, place, meaning, memory),
            AnyTree::Double(tree) => baked(tree, place, meaning, memory),
            AnyTree::Vec3i(_) | AnyTree::Vec3s(_) | AnyTree::Vec3d(_) => {
                return Err(Failure::usage(format!("{label} holds vectors, and only densities are drawn"))
                    .hint("choose another grid with --grid"));
            }
        };
        let view = match &arguments.scene {
            Some(scene) => scene_view(scene, bounds)?,
            None => own_view(&file.info().metadata, path, bounds, options.budget(), global)?,
        };
        let medium = Medium::Baked(baked?.with(sampling));
        drop(grid);
        let medium = medium.coarser(halvings).unwrap_or(medium);
        if let Medium::Baked(baked) = &medium {
            let memory = Memory { shared: arguments.progressive, ..memory };
            let lamps = view.optics.lamps.len();
            let found = baked.check_shadows(lamps, arguments.light.shadow(), memory.room());
            found.map_err(|error| memory.refusal(error, 0))?;
        }
        Ok(Drawn { medium, view })
    }
}

/// The memory that there is for voxels.
#[derive(Debug, Clone, Copy)]
struct Memory {
    budget: u64,
    /// Bytes that the process takes besides.
    besides: u64,
    /// A quarter is for coarser voxels, which are made of others.
    shared: bool,
}

impl Memory {
    fn room(self) -> u64 {
        if self.shared { self.budget - self.budget / 4 } else { self.budget }
    }

    /// Of what would take more beside so many bytes that are held.
    fn refusal(self, error: BakedError, held: u64) -> Failure {
        match error {
            BakedError::TooLarge { bytes, .. } => {
                let voxels = bytes.saturating_add(held);
                let all = if self.shared { voxels.saturating_add(voxels / 3 + 2) } else { voxels };
                let failure = Failure::failed("the grid takes too much memory").because(error);
                let needed = enough(self.besides.saturating_add(all));
                failure.hint(format!("allow more with --memory {needed} or so"))
            }
            BakedError::Background(_) => Failure::input("the grid has no end").because(error),
        }
    }
}

/// What is drawn of a tree, beside which it is made.
fn baked<T: Sampled<Wide = f64>>(
    tree: &Tree<T>,
    grid: Grid,
    meaning: Meaning,
    memory: Memory,
) -> Result<Baked, Failure> {
    let held = tree.memory_bytes();
    let room = memory.room().saturating_sub(held);
    Baked::new(tree, grid, meaning, room).map_err(|error| memory.refusal(error, held))
}

/// Level sets hold distances.
fn meaning(info: &GridInfo, place: &Grid) -> Meaning {
    match info.metadata.get("class") {
        Some(Meta::String(class)) if class == "level set" => Meaning::Distance(SURFACE * place.cell()),
        _ => Meaning::Density,
    }
}

/// The box of the active voxels.
fn bounds(tree: &AnyTree, place: &Grid) -> Option<[DVec3; 2]> {
    let stats = match tree {
        AnyTree::Bool(tree) => tree.stats(),
        AnyTree::Int32(tree) => tree.stats(),
        AnyTree::Int64(tree) => tree.stats(),
        AnyTree::Float(tree) => tree.stats(),
        AnyTree::Double(tree) => tree.stats(),
        AnyTree::Vec3i(tree) => tree.stats(),
        AnyTree::Vec3s(tree) => tree.stats(),
        AnyTree::Vec3d(tree) => tree.stats(),
    };
    let [low, high] = stats.bounds?.map(|corner| DVec3::from(corner.map(f64::from)));
    let mut bounds = [DVec3::INFINITY, DVec3::NEG_INFINITY];
    for corner in 0..8 {
        let pick = |axis: usize| if corner >> axis & 1 == 1 { high[axis] } else { low[axis] };
        let world = place.to_world(DVec3::new(pick(0), pick(1), pick(2)));
        bounds = [bounds[0].min(world), bounds[1].max(world)];
    }
    Some(bounds)
}

/// Through a scene's camera, which is framed to the scene.
fn scene_view(path: &Path, of_file: Option<[DVec3; 2]>) -> Result<View, Failure> {
    let scene = read_scene(path)?;
    let bounds = Field::compile(&scene).bounds();
    Ok(View::of_scene(&scene, bounds.or(of_file)))
}

/// As the scene says that the file was baked from; with a camera and lights of its own where there is none.
fn own_view(
    metadata: &Metadata,
    path: &Path,
    of_file: Option<[DVec3; 2]>,
    budget: Amount,
    global: &Global,
) -> Result<View, Failure> {
    let time = match metadata.get("vdbake_settings") {
        Some(Meta::String(settings)) => embedded::time(settings),
        _ => 0.0,
    };
    let own = embedded::scene(metadata, path, None, budget)
        .and_then(|scene| Ok(scene.map(|scene| scene.at(time)).transpose()?))
        .unwrap_or_else(|failure| {
            let path = path.display();
            global.note(&format!(
                "a camera and a light are made up, since the scene in {path} cannot be read:\n{failure}"
            ));
            None
        });
    match own {
        Some(scene) => Ok(View::of_scene(&scene, Field::compile(&scene).bounds().or(of_file))),
        // All that a scene leaves open.
        None => Ok(View::of_scene(&Scene::parse("", "no scene")?, of_file)),
    }
}
