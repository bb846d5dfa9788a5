//! Tubes as scenes whose density tells which foot was found, and where: baked by the product, expected of its feet.
//!
//! With the linear envelope and no layers the density is `1 - rho / r` at the nearest foot: the distance. With the hard
//! envelope and noise along l alone it is a known function of the foot's arc length, and of several feet another one
//! decides than the nearest: the foot. Both times the fade at the focal set.

use std::collections::BTreeMap;

use glam::DVec3;
use vdbake::field::{Field, Lattice};
use vdbake::num::Level;
use vdbake::reference;
use vdbake::scene::{Fbm, Scene};
use vdbake::volume::{Brick, Plan, Store, bake};

use crate::gates_oracle::{Axis, Foot};

/// A tube of one radius along a Bezier chain.
#[derive(Debug, Clone)]
pub(crate) struct Tube {
    pub(crate) segments: Vec<Vec<DVec3>>,
    pub(crate) radius: f64,
    pub(crate) round: bool,
    /// Cells of noise along the tube, for [`Reveal::Foot`].
    pub(crate) cells: f64,
}

/// What a bake is to reveal.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Reveal {
    Distance,
    Foot,
}

/// How much of the noise is added to 1.
const SWING: f64 = 0.9;

impl Tube {
    pub(crate) fn new(segments: Vec<Vec<DVec3>>, radius: f64, cells: f64) -> Tube {
        Tube { segments, radius, round: false, cells }
    }

    /// The same tube, run through from its end.
    pub(crate) fn reversed(&self) -> Tube {
        let mut segments = self.segments.clone();
        segments.reverse();
        for points in &mut segments {
            points.reverse();
        }
        Tube { segments, ..self.clone() }
    }

    pub(crate) fn mapped(&self, map: impl Fn(DVec3) -> DVec3) -> Tube {
        let segments = self.segments.iter().map(|points| points.iter().map(|p| map(*p)).collect()).collect();
        Tube { segments, ..self.clone() }
    }

    pub(crate) fn scaled(&self, scale: f64) -> Tube {
        Tube { radius: self.radius * scale, ..self.mapped(|p| p * scale) }
    }

    pub(crate) fn axis(&self) -> Axis {
        Axis::new(&self.segments)
    }

    /// The scene text of this tube.
    pub(crate) fn text(&self, reveal: Reveal) -> String {
        let radius = format!("{:?}", self.radius);
        let caps = if self.round { "round" } else { "flat" };
        let rest = match reveal {
            Reveal::Distance => "envelope = { radial = \"linear\" }\n".to_owned(),
            Reveal::Foot => format!(
                "envelope = {{ radial = \"hard\" }}\n[[tube.layer]]\nop = \"add\"\nnoise = \"perlin\"\n\
                 frequency = [0.0, 0.0, {:?}]\noctaves = 1\nmultiplier = {SWING:?}\n",
                self.cells
            ),
        };
        format!(
            "[bake]\noctave_fade = false\n{}",
            tube_text(&self.segments, &radius, &format!("caps = \"{caps}\"\n{rest}"))
        )
    }

    pub(crate) fn scene(&self, reveal: Reveal) -> Scene {
        parse(&self.text(reveal))
    }
}

/// A tube's table; `radius` is TOML, and `rest` what else the table holds.
pub(crate) fn tube_text(segments: &[Vec<DVec3>], radius: &str, rest: &str) -> String {
    let kind = if segments[0].len() == 3 { "quadratic" } else { "cubic" };
    let mut points: Vec<String> = vec![format!("{:?}", segments[0][0].to_array())];
    for segment in segments {
        points.extend(segment[1..].iter().map(|p| format!("{:?}", p.to_array())));
    }
    let points = points.join(", ");
    format!("[[tube]]\ncurve = {{ kind = \"{kind}\", points = [{points}] }}\nradius = {radius}\n{rest}")
}

pub(crate) fn parse(text: &str) -> Scene {
    Scene::parse(text, "gate.toml").unwrap_or_else(|errors| panic!("{errors}\n{text}"))
}

/// The contribution of a foot to a bake.
#[derive(Debug, Clone)]
pub(crate) struct Expect {
    reveal: Reveal,
    radius: f64,
    length: f64,
    noise: Option<Fbm>,
}

impl Expect {
    pub(crate) fn new(tube: &Tube, scene: &Scene, reveal: Reveal, length: f64) -> Expect {
        let noise = scene.tubes()[0].layers.first().map(|layer| match &layer.pattern {
            vdbake::scene::Pattern::Perlin(noise) => noise.clone(),
            other => panic!("{other:?}"),
        });
        Expect { reveal, radius: tube.radius, length, noise }
    }

    pub(crate) fn reveal(&self) -> Reveal {
        self.reveal
    }

    pub(crate) fn contribution(&self, foot: &Foot) -> f64 {
        if foot.distance > self.radius {
            return 0.0;
        }
        foot.fade()
            * match self.reveal {
                Reveal::Distance => 1.0 - foot.distance / self.radius,
                Reveal::Foot => self.along(foot.arc),
            }
    }

    /// The density at an arc length, before any fade.
    fn along(&self, arc: f64) -> f64 {
        let noise = self.noise.as_ref().expect("the layer of `Reveal::Foot`");
        (1.0 + SWING * reference::fbm(noise, [0.0, 0.0, arc / self.length], None)).max(0.0)
    }

    /// The change of the density per metre of arc length.
    pub(crate) fn slope(&self, arc: f64) -> f64 {
        let step = 1e-4 * self.length / self.noise.as_ref().map_or(1.0, |noise| noise.frequency[2]);
        (self.along(arc + step) - self.along(arc - step)) / (2.0 * step)
    }

    /// The foot whose contribution is the largest.
    pub(crate) fn best<'a>(&self, feet: &'a [Foot]) -> Option<(&'a Foot, f64)> {
        feet.iter()
            .map(|foot| (foot, self.contribution(foot)))
            .filter(|(_, value)| *value > 0.0)
            .max_by(|a, b| a.1.total_cmp(&b.1))
    }
}

/// A bake in memory.
pub(crate) struct Baked {
    pub(crate) plan: Plan,
    pub(crate) bricks: BTreeMap<[i32; 3], Brick>,
}

impl Baked {
    /// Bakes `bricks` bricks of the plan, or all.
    pub(crate) fn new(scene: &Scene, lattice: Lattice, bricks: usize) -> Baked {
        let field = Field::compile(scene);
        let plan =
            Plan::new(&field, lattice, 1 << 32).unwrap_or_else(|error| panic!("{error}")).sample(bricks);
        let mut store = Store::default();
        let Ok(_) = bake(&field, &plan, 0.0, Level::best(), &mut store, |_| ());
        let bricks = store.bricks().iter().map(|brick| (brick.origin, brick.clone())).collect();
        Baked { plan, bricks }
    }

    /// The value at a voxel, 0 where no brick is.
    pub(crate) fn at(&self, voxel: [i32; 3]) -> f32 {
        let at = voxel.map(|i| usize::try_from(i & 7).expect("three bits"));
        self.bricks
            .get(&voxel.map(|i| i & !7))
            .map_or(0.0, |brick| brick.values[at[0] * 64 + at[1] * 8 + at[2]])
    }
}

pub(crate) fn centre(voxel: [i32; 3], h: f64) -> DVec3 {
    DVec3::from(voxel.map(|i| (f64::from(i) + 0.5) * h))
}

/// The voxels of the brick whose first one is `origin`.
pub(crate) fn voxels(origin: [i32; 3]) -> impl Iterator<Item = [i32; 3]> {
    (0..512).map(move |i| [origin[0] + i / 64, origin[1] + i / 8 % 8, origin[2] + i % 8])
}
