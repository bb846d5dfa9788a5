//! What a thread remembers of a tile does not reach the next one: which tiles it did before is a matter of chance.

use std::num::NonZeroU32;

use glam::{DVec2, DVec3};

use super::bins::Bins;
use super::medium::{Brick, Way};
use super::procedural::Worker;
use super::shade::{COARSE, Lit, Wanted};
use super::testing::{H, grey, looking, sun};
use super::tiles::Tiles;
use super::{Integrator, Marching, Medium, Method, Optics, Picture, Procedural, Quality, Shadow};
use crate::field::{Field, Lattice};
use crate::num::Level;
use crate::scene::Scene;
use crate::volume::testing::unit;

/// Pixels along an edge of a picture, and rays of a lamp.
const SIZE: [usize; 2] = [96; 2];

/// A tube that turns sharply for its width: there Newton's method takes more steps at some places than at others.
fn bent() -> Field {
    let text = "[[tube]]\n\
                curve = { kind = \"cubic\", points = [[0, 0, -0.8], [1.1, 0.3, 0.1], [1.1, -0.4, 0.2], [0, 0, 0.8]] }\n\
                radius = 0.45\n\
                [[tube.layer]]\nop = \"multiply\"\nnoise = \"perlin\"\noctaves = 3\nfrequency = [2, 2, 5]\n";
    Field::compile(&Scene::parse(text, "scene.toml").expect("valid"))
}

/// Leaves in memory what other tiles may: places of theirs; and what none would, far from everything or no place at all.
fn soil(worker: &mut Worker, way: &mut Way, kind: u64) {
    let mut state = kind;
    let mut of = |scale: f64| match kind % 4 {
        0 => f64::NAN,
        1 => (unit(&mut state) - 0.5) * 1e9,
        _ => (unit(&mut state) - 0.5) * scale,
    };
    #[allow(clippy::cast_possible_truncation, reason = "any numbers")]
    worker.soil(|| of(16.0) as f32);
    way.hits.middle.fill_with(|| of(200.0));
}

fn memory() -> (Way, Worker) {
    (Way::default(), Worker::default())
}

#[test]
fn what_a_tile_sees_does_not_depend_on_those_before_it() {
    let field = bent();
    let marchings = [
        Marching::default(),
        Marching { method: Method::Midpoint, growth: 0.05, ..Marching::default() },
        Marching { method: Method::Midpoint, map_every: 4, ..Marching::default() },
        Marching { method: Method::Alpha, count: NonZeroU32::new(60), ..Marching::default() },
    ];
    let optics = Optics { albedo: DVec3::ONE, lamps: vec![sun(DVec3::new(1.0, 2.0, 0.5))], ..grey(6.0) };
    let at = DVec2::splat(0.5);
    for marching in marchings {
        let procedural = Procedural::new(&field, Lattice { voxel_size: H }, 1.0, u64::MAX).expect("small");
        let medium = Medium::Procedural(procedural.with(marching));
        let quality = Quality {
            size: SIZE,
            samples: 1,
            cutoff: 1e-4,
            shadow: Shadow::None,
            integrator: Integrator::Single,
        };
        let camera = looking(DVec3::new(0.4, -3.0, 0.3), DVec3::new(0.4, 0.0, 0.0), 0.4, false);
        let picture = Picture::new(&medium, camera, &optics, quality, Level::best());
        let wanted = Wanted { deepest: 9.0, extinction: optics.extinction };
        let mut seen = 0;
        for tile in 0..picture.tiles() {
            let (mut way, mut worker) = memory();
            let alone = picture.tile(tile, at, &wanted, &mut way, &mut worker);
            seen += alone.iter().filter(|pixel| **pixel != Default::default()).count();
            for kind in 0..16 {
                soil(&mut worker, &mut way, kind);
                let after = picture.tile(tile, at, &wanted, &mut way, &mut worker);
                assert!(alone == after, "{marching:?}: tile {tile} after memory {kind}");
            }
        }
        assert!(seen > 3000, "{seen} pixels");
    }
}

#[test]
fn what_a_lamps_rays_find_does_not_depend_on_those_before_them() {
    let field = bent();
    let procedural = Procedural::new(&field, Lattice { voxel_size: H }, 1.0, u64::MAX).expect("small");
    let medium = Medium::Procedural(procedural);
    let camera = looking(DVec3::new(0.4, -3.0, 0.3), DVec3::new(0.4, 0.0, 0.0), 1.2, true);
    let tiles = Tiles::new(&camera, SIZE, medium.grid(), medium.bricks());
    let optics = grey(6.0);
    let wanted = Wanted { deepest: 80.0, extinction: 6.0 };
    let pieces = 120;
    let mut met = 0;
    let record = |tile: usize, way: &mut Way, worker: &mut Worker| {
        let mut bins = Bins::default();
        way.rays.begin(medium.grid(), 0, tiles.rays(tile, &camera, DVec2::splat(0.5)));
        bins.begin(&way.rays, H, pieces);
        for seen in tiles.seen(tile) {
            let block = medium.bricks().blocks[seen.brick as usize];
            let lit = Lit::new(&optics, medium.grid(), block, &[], COARSE);
            let brick = Brick { block, seen, wanted: &wanted, lit: &lit };
            medium.record(Level::best(), brick, way, &mut bins, worker);
        }
        (0..super::rays::RAYS).flat_map(|ray| bins.of(ray).to_vec()).collect::<Vec<f32>>()
    };
    for tile in 0..tiles.count() {
        let (mut way, mut worker) = memory();
        let alone = record(tile, &mut way, &mut worker);
        met += alone.iter().filter(|depth| **depth > 0.0).count();
        for kind in 0..16 {
            soil(&mut worker, &mut way, kind);
            let after = record(tile, &mut way, &mut worker);
            assert!(alone == after, "tile {tile} after memory {kind}");
        }
    }
    assert!(met > 3000, "{met} pieces");
}
