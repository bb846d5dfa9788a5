//! Scenes of other shapes: what a setting of the tube costs, and how cost grows with the number of segments.

use super::Run;
use super::bakes::{UNSEEN, filter_name};
use super::rows::{Cost, FieldError, Kind, Row, Settings};
use crate::curve::{Curve, CurveError, FrameRule};
use crate::field::Lattice;
use crate::formats::vdb::{Compression, Encoder};
use crate::report::trial::{Pilot, TrialError};
use crate::scene::{Conserve, Overlap, Scene};
use crate::volume::Filter;

/// Segments of curves that are alike otherwise, and of that on which ways to find what is inside of them are compared.
const SEGMENTS: [u32; 5] = [1, 10, 100, 1000, 10_000];
const MET: u32 = 100;
/// Points at which these bakes are held against their densities, as a part of those of others, and rays. (The reference looks at
/// every segment at every point: all take no more than so many looks.)
const POINTS: usize = 4;
const RAYS: usize = 100;
const LOOKS: usize = 4_000_000;
const LEAST_POINTS: usize = 400;

impl Run<'_> {
    /// Rows of other densities than the scene's: each is held against its own.
    pub(super) fn shapes(&mut self) {
        let frames = [("rotation-minimising", FrameRule::RotationMinimising), ("frenet", FrameRule::Frenet)];
        for (name, frame) in frames {
            let label = format!("frame {name}");
            // Curves carry their frames.
            match with_frame(self.scene, frame) {
                Ok(scene) => self.shape("frame", &label, |altered| *altered = scene),
                Err(error) => self.left_out.push(format!("{label}: {error}")),
            }
        }
        for (name, conserve) in
            [("off", Conserve::Off), ("radius", Conserve::Radius), ("full", Conserve::Full)]
        {
            self.shape("conservation", &format!("conserve {name}"), |scene| {
                scene.tubes.iter_mut().for_each(|tube| tube.conserve = conserve);
            });
        }
        for (name, overlap) in [
            ("max", Overlap::Max),
            ("sum", Overlap::Sum),
            ("closest", Overlap::Closest),
            ("blend", Overlap::Blend),
        ] {
            self.shape("overlap", &format!("overlap {name}"), |scene| {
                scene.tubes.iter_mut().for_each(|tube| tube.overlap = overlap);
            });
        }
        for segments in SEGMENTS {
            let label = format!("{segments} segments");
            if !self.time_for(&label) {
                continue;
            }
            for kind in ["quadratic", "cubic"] {
                let lattice = Lattice { voxel_size: HELIX_LENGTH / 512.0 };
                if let Ok(scene) = helix(segments, kind) {
                    self.costed("segments", format!("{label}, {kind}"), &scene, lattice);
                }
            }
        }
        let lattice = Lattice { voxel_size: HELIX_LENGTH / 256.0 };
        let label = format!("a helix of {MET} segments");
        if self.time_for(&label)
            && let Ok(scene) = helix(MET, "quadratic")
            && let Err(error) = self.ways_through(&label, &scene, lattice)
        {
            self.left_out.push(format!("{label}: {error}"));
        }
    }

    fn shape(&mut self, group: &'static str, label: &str, change: impl FnOnce(&mut Scene)) {
        if self.time_for(label) {
            let mut scene = self.scene.clone();
            change(&mut scene);
            self.costed(group, label.to_owned(), &scene, self.lattice);
        }
    }

    fn costed(&mut self, group: &'static str, label: String, scene: &Scene, lattice: Lattice) {
        let (cost, field) = match self.measured(scene, lattice) {
            Ok((cost, Some(field))) => (cost, field),
            Ok((_, None)) => {
                self.left_out.push(format!("{label}: {UNSEEN}"));
                return;
            }
            Err(error) => {
                self.left_out.push(format!("{label}: {error}"));
                return;
            }
        };
        self.rows.push(Row {
            group,
            label,
            kind: Kind::Bake,
            is_own: false,
            settings: Settings {
                voxel_size: lattice.voxel_size,
                filter: Some(filter_name(Filter::Trilinear)),
                precision: Some("f32"),
                compression: Some("blosc"),
                octaves: None,
                step: None,
                method: None,
            },
            command: None,
            field: Some(field),
            image: None,
            cost,
            on_front: false,
        });
    }
}

impl Run<'_> {
    /// What a bake of a scene takes, and how far it is from the density of that scene.
    fn measured(&self, scene: &Scene, lattice: Lattice) -> Result<(Cost, Option<FieldError>), TrialError> {
        let pilot = Pilot::new(scene, self.effort.budget);
        let (cost, tree) = self.costs(&pilot, lattice, Encoder::new(Compression::Blosc))?;
        let segments: usize = scene.tubes().iter().map(|tube| tube.curve.segments().len()).sum();
        let points = (LOOKS / segments.max(1)).min(self.effort.points / POINTS).max(LEAST_POINTS);
        let mut held = self.held_against(scene, lattice, points)?;
        Ok((cost, held.error(&tree, Filter::Trilinear, self.effort.rays.min(RAYS))?))
    }
}

/// A scene whose tubes' cross-sections are carried along by another rule.
fn with_frame(scene: &Scene, rule: FrameRule) -> Result<Scene, CurveError> {
    let mut scene = scene.clone();
    for tube in &mut scene.tubes {
        let segments = tube.curve.segments().to_vec();
        tube.curve =
            if tube.curve.is_closed() { Curve::closed(segments, rule)? } else { Curve::new(segments, rule)? };
        tube.frame = rule;
    }
    Ok(scene)
}

/// Metres from end to end along the axis of the helix.
const HELIX_LENGTH: f64 = 4.0;

/// A tube along a helix of four turns, of one volume and of so many segments; of one segment, a bow.
fn helix(segments: u32, kind: &str) -> Result<Scene, crate::scene::SceneErrors> {
    let degree = if kind == "cubic" { 3 } else { 2 };
    let turns = 4.0_f64.min(f64::from(segments) / 4.0);
    let at = |t: f64| {
        let (sin, cos) = libm::sincos(std::f64::consts::TAU * turns * t);
        [0.5 * cos, 0.5 * sin, HELIX_LENGTH * t]
    };
    let derivative = |t: f64| {
        let rate = std::f64::consts::TAU * turns;
        let (sin, cos) = libm::sincos(rate * t);
        [-0.5 * rate * sin, 0.5 * rate * cos, HELIX_LENGTH]
    };
    let mut points = vec![at(0.0)];
    let step = 1.0 / f64::from(segments);
    for n in 0..segments {
        let [from, to] = [f64::from(n) * step, f64::from(n + 1) * step];
        let ahead = |t: f64, part: f64| {
            let (place, slope) = (at(t), derivative(t));
            [0, 1, 2].map(|axis| place[axis] + part * step * slope[axis])
        };
        if degree == 3 {
            points.extend([ahead(from, 1.0 / 3.0), ahead(to, -1.0 / 3.0)]);
        } else {
            // Tangents of a helix do not meet; the mean of both is as near as a parabola comes.
            let [a, b] = [ahead(from, 0.5), ahead(to, -0.5)];
            points.push([0, 1, 2].map(|axis| 0.5 * (a[axis] + b[axis])));
        }
        points.push(at(to));
    }
    let points: Vec<String> = points.iter().map(|[x, y, z]| format!("[{x:?}, {y:?}, {z:?}]")).collect();
    let text = format!(
        "[[tube]]\nradius = 0.15\ncurve = {{ kind = \"{kind}\", points = [{}] }}\n[[tube.layer]]\noctaves = 3\n",
        points.join(", ")
    );
    Scene::parse(&text, "helix")
}
