//! The project's scenes, changed, as they are drawn and as they are baked.

use std::io::Cursor;
use std::time::Instant;

use vdbake::field::{Field, Lattice, extent};
use vdbake::formats::vdb::{
    self, AnyTree, Compression, Encoder, FileHeader, GridClass, GridHeader, Metadata, VdbFile,
    VdbGridBuilder, VectorType,
};
use vdbake::march::{Baked, Camera, Grid, Meaning, Optics};
use vdbake::num::Level;
use vdbake::scene::{Scene, Step};
use vdbake::volume::{Plan, bake};

/// A scene, ready to be drawn.
pub(crate) struct Drawn {
    scene: Scene,
    pub(crate) field: Field,
    pub(crate) lattice: Lattice,
    pub(crate) optics: Optics,
}

/// One octave in every layer.
pub(crate) fn with_one_octave(text: &str) -> String {
    let changed = |line: &str| {
        let is_octaves = line.trim_start().starts_with("octaves");
        if is_octaves { "octaves = 1".to_owned() } else { line.to_owned() }
    };
    text.lines().map(changed).collect::<Vec<_>>().join("\n")
}

/// No layers.
pub(crate) fn without_noise(text: &str) -> String {
    let mut is_layer = false;
    let kept = text.lines().filter(|line| {
        if line.starts_with('[') {
            is_layer = line.starts_with("[[tube.layer]]");
        }
        !is_layer
    });
    kept.collect::<Vec<_>>().join("\n")
}

impl Drawn {
    /// A scene of the project, with its text changed, at its start.
    pub(crate) fn new(name: &str, change: impl Fn(&str) -> String) -> Drawn {
        let path = format!("{}/scenes/{name}.toml", env!("CARGO_MANIFEST_DIR"));
        let text = std::fs::read_to_string(&path).expect("a scene of the project");
        let scene = Scene::parse(&change(&text), &path).unwrap_or_else(|errors| panic!("{errors}"));
        let voxel_size = match scene.bake().step {
            Step::VoxelSize(size) => size,
            Step::Resolution(resolution) => {
                let [low, high] = extent(&scene).expect("valid").expect("density");
                (high - low).max_element() / f64::from(resolution)
            }
        };
        let lattice = Lattice { voxel_size };
        let mut field = Field::compile(&scene);
        field.widen(lattice);
        let optics = Optics::new(&scene.medium(), scene.lights());
        Drawn { scene, field, lattice, optics }
    }

    pub(crate) fn camera(&self, size: [usize; 2]) -> Camera {
        Camera::new(&self.scene.camera(), self.field.bounds(), size[0] as f64 / size[1] as f64)
    }

    /// The voxels of a bake, and how many milliseconds it took without writing and reading.
    pub(crate) fn bake(&self) -> (Baked, f64) {
        let started = Instant::now();
        let plan = Plan::new(&self.field, self.lattice, u64::MAX).expect("a plan");
        let mut grid = VdbGridBuilder::with_encoder(Encoder::new(Compression::None)).with_room(plan.bricks());
        let cutoff = self.scene.bake().cutoff;
        bake(&self.field, &plan, cutoff, Level::best(), &mut grid, |_| ()).expect("in order");
        let time = started.elapsed().as_secs_f64() * 1e3;
        let h = self.lattice.voxel_size;
        let header = FileHeader { uuid: uuid::Uuid::nil(), metadata: Metadata::new() };
        let grid_header = GridHeader {
            name: "density".to_owned(),
            class: GridClass::FogVolume,
            vector_type: VectorType::Invariant,
            voxel_size: h,
            translation: [0.5 * h; 3],
            metadata: Metadata::new(),
        };
        let mut bytes = Cursor::new(Vec::new());
        vdb::write(&mut bytes, &header, &[(&grid_header, &grid)]).expect("in memory");
        let mut file = VdbFile::open(bytes).expect("its own file");
        let read = file.grid_at(0).expect("its own grid");
        let rows = read.info.map.matrix.expect("affine");
        let place = Grid::from_rows(&rows).expect("regular");
        let AnyTree::Float(tree) = &read.tree else { panic!("floats are written") };
        (Baked::new(tree, place, Meaning::Density, u64::MAX).expect("room"), time)
    }
}
