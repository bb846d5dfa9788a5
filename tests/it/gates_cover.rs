//! The plan: every voxel with density lies in a planned brick, and every foot of it among the brick's candidates.

use std::collections::BTreeSet;

use glam::DVec3;
use rayon::prelude::*;
use vdbake::field::{Field, Lattice};
use vdbake::scene::Scene;
use vdbake::volume::Plan;

use crate::gates_bake::{Baked, centre, parse, tube_text, voxels};
use crate::gates_oracle::{Axis, Foot, Random, show, smoothstep};

/// A radius along the tube: levels joined by smoothsteps between the places x0 and x1 in s / L; jumps where these agree.
#[derive(Debug, Clone)]
struct Radius {
    first: f64,
    /// x0, x1 and the next level.
    steps: Vec<[f64; 3]>,
}

impl Radius {
    fn constant(radius: f64) -> Radius {
        Radius { first: radius, steps: Vec::new() }
    }

    fn at(&self, x: f64) -> f64 {
        let mut radius = self.first;
        for &[from, to, next] in &self.steps {
            let part = if to > from { smoothstep((x - from) / (to - from)) } else { f64::from(x >= from) };
            radius += (next - radius) * part;
        }
        radius
    }

    fn most(&self) -> f64 {
        self.steps.iter().fold(self.first, |most, step| most.max(step[2]))
    }

    /// Keys with a level on both sides of every change: between them the profile is the smoothstep.
    fn toml(&self) -> String {
        let mut keys = vec![[0.0, self.first]];
        let mut level = self.first;
        for &[from, to, next] in &self.steps {
            keys.extend([[from, level], [to, next]]);
            level = next;
        }
        keys.push([1.0, level]);
        format!("{keys:?}")
    }
}

/// A chain with its radius, caps and voxel.
#[derive(Debug)]
struct Shape {
    name: String,
    segments: Vec<Vec<DVec3>>,
    radius: Radius,
    round: bool,
    h: f64,
}

impl Shape {
    /// With the hard envelope: the density is the fade at the focal set of the best foot, 1 where that is whole.
    fn scene(&self) -> Scene {
        let caps = if self.round { "round" } else { "flat" };
        let rest = format!("caps = \"{caps}\"\nenvelope = {{ radial = \"hard\" }}\n");
        parse(&tube_text(&self.segments, &self.radius.toml(), &rest))
    }

    fn reversed(&self) -> Shape {
        let mut segments = self.segments.clone();
        segments.reverse();
        for points in &mut segments {
            points.reverse();
        }
        let mut level = self.radius.first;
        let mut steps: Vec<[f64; 3]> = Vec::new();
        for &[from, to, next] in &self.radius.steps {
            steps.push([1.0 - to, 1.0 - from, level]);
            level = next;
        }
        steps.reverse();
        let name = format!("{}, reversed", self.name);
        Shape { name, segments, radius: Radius { first: level, steps }, ..*self }
    }
}

/// What brute force makes of a voxel: the density, or none where rounding may decide.
fn density(shape: &Shape, axis: &Axis, ends: &[(DVec3, DVec3); 2], p: DVec3) -> Option<f64> {
    const EDGE: f64 = 2e-5;
    let most = shape.radius.most();
    let feet: Vec<Foot> = axis.feet(p, 1.001 * most, shape.round);
    if !shape.round {
        let near = |&(end, out): &(DVec3, DVec3)| {
            (p - end).dot(out).abs() < EDGE * most && p.distance(end) < 1.001 * most
        };
        if ends.iter().any(near) {
            return None;
        }
    }
    let mut density = 0.0_f64;
    for foot in &feet {
        let x = foot.arc / axis.length();
        // Pieces overlap by 1e-3 voxels: at a jump both sides count there.
        let aside = 2e-3 * shape.h / axis.length();
        let aside = [x - aside, x + aside].map(|x| shape.radius.at(x.clamp(0.0, 1.0)));
        let (low, high) = (aside[0].min(aside[1]), aside[0].max(aside[1]));
        if foot.distance > low * (1.0 - EDGE) && foot.distance < high * (1.0 + EDGE) {
            return None;
        }
        if foot.distance <= low {
            density = density.max(foot.fade());
        }
    }
    Some(density)
}

/// Compares every voxel of the box around a shape with brute force; how many have density.
fn check(shape: &Shape) -> usize {
    let axis = Axis::new(&shape.segments);
    let ends = axis.ends();
    let baked = Baked::new(&shape.scene(), Lattice { voxel_size: shape.h }, usize::MAX);
    let planned: BTreeSet<[i32; 3]> = baked.plan.origins().collect();
    let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    for point in shape.segments.iter().flatten() {
        (low, high) = (low.min(*point), high.max(*point));
    }
    let reach = DVec3::splat(shape.radius.most() + 2.0 * shape.h);
    #[allow(clippy::cast_possible_truncation, reason = "some dozens of bricks")]
    let brick = |p: DVec3| (p / (8.0 * shape.h)).floor().to_array().map(|x| x as i32);
    let (low, high) = (brick(low - reach), brick(high + reach));
    let mut inside = 0;
    for x in low[0]..=high[0] {
        for y in low[1]..=high[1] {
            for z in low[2]..=high[2] {
                let origin = [8 * x, 8 * y, 8 * z];
                for voxel in voxels(origin) {
                    let Some(truth) = density(shape, &axis, &ends, centre(voxel, shape.h)) else { continue };
                    let found = f64::from(baked.at(voxel));
                    assert!(
                        truth < 1e-6 || planned.contains(&origin),
                        "{}: no brick at {voxel:?} with {truth}",
                        shape.name
                    );
                    // A foot that no candidate holds would be missing whole.
                    assert!(
                        (found - truth).abs() < 1e-3,
                        "{} at {voxel:?}: {found}, not {truth}",
                        shape.name
                    );
                    inside += usize::from(truth > 0.0);
                }
            }
        }
    }
    inside
}

/// A chain of quadratics or cubics through random points: smooth, or with corners.
fn chain(random: &mut Random, count: usize, degree: usize, corners: bool) -> Vec<Vec<DVec3>> {
    let mut segments: Vec<Vec<DVec3>> = Vec::new();
    let mut at = random.point() * 0.5;
    for _ in 0..count {
        let mut points = vec![at];
        for k in 1..=degree {
            let before = points[k - 1];
            let smooth = segments.last().filter(|_| k == 1 && !corners);
            points.push(match smooth {
                Some(last) => before + (before - last[degree - 1]) * random.within(0.6, 1.2),
                None => before + random.point() * 0.5,
            });
        }
        at = points[degree];
        segments.push(points);
    }
    segments
}

fn shapes() -> Vec<Shape> {
    let mut random = Random(11);
    let mut shapes: Vec<Shape> = Vec::new();
    for i in 0..100 {
        let (count, degree, corners) = (1 + i % 3, 2 + i / 3 % 2, i % 5 == 0);
        let segments = chain(&mut random, count, degree, corners);
        let length = Axis::new(&segments).length();
        let r = length * random.within(0.03, 0.2);
        let (a, b) = (random.within(0.1, 0.4), random.within(0.5, 0.9));
        let radius = match i % 6 {
            0 | 1 => Radius::constant(r),
            2 => Radius { first: r, steps: vec![[a, a, 0.3 * r]] },
            3 => Radius { first: 0.2 * r, steps: vec![[a, a, r], [b, b, 0.4 * r]] },
            // A smoothstep's largest slope is 1.5 of its mean one: r' = +-100 over this part of the length.
            4 => {
                let width = 1.5 * 0.8 * r / (100.0 * length);
                Radius { first: 0.2 * r, steps: vec![[a, a + width, r], [b, b + width, 0.2 * r]] }
            }
            _ => Radius { first: 0.5 * r, steps: vec![[a, b, r]] },
        };
        let h = radius.most() / random.within(1.5, 6.0);
        shapes.push(Shape { name: format!("chain {i}"), segments, radius, round: i % 4 == 1, h });
    }
    let x = DVec3::X;
    for (name, radius, h, round) in [
        ("dot in a brick", 0.02, 0.5, true),
        ("wire", 0.05, 0.1, false),
        ("ball, all but", 2.0, 0.3, true),
        ("disc, all but", 2.0, 0.3, false),
    ] {
        let segments = vec![vec![DVec3::splat(0.1), DVec3::splat(0.1) + 0.5 * x, DVec3::splat(0.1) + x]];
        let name = name.to_owned();
        shapes.push(Shape { name, segments, radius: Radius::constant(radius), round, h });
    }
    shapes
}

#[test]
fn no_candidate_is_missed_and_no_density_lies_outside_planned_bricks() {
    let shapes = shapes();
    let inside: Vec<usize> = shapes.par_iter().map(check).collect();
    show(&format!("{} voxels inside {} shapes", inside.iter().sum::<usize>(), shapes.len()));
    assert!(inside.iter().filter(|count| **count > 20).count() > 95);
}

fn planned(shape: &Shape) -> BTreeSet<[i32; 3]> {
    let field = Field::compile(&shape.scene());
    Plan::new(&field, Lattice { voxel_size: shape.h }, 1 << 30).expect("a small plan").origins().collect()
}

#[test]
fn the_way_a_curve_is_run_through_hardly_changes_the_plan() {
    let (mut all, mut apart) = (0, 0);
    for shape in shapes() {
        let (one, other) = (planned(&shape), planned(&shape.reversed()));
        all += one.len();
        apart += one.symmetric_difference(&other).count();
        let baked = [&shape, &shape.reversed()].map(|shape| {
            let baked = Baked::new(&shape.scene(), Lattice { voxel_size: shape.h }, usize::MAX);
            baked.bricks.values().map(|brick| u64::from(brick.active())).sum::<u64>()
        });
        // What density there is, is planned both ways; voxels on the surface may differ.
        assert!(baked[0].abs_diff(baked[1]) <= 2 + baked[0] / 1000, "{}: {baked:?}", shape.name);
    }
    show(&format!("{apart} of {all} bricks are planned one way only"));
    assert!(apart * 50 <= all, "{apart} of {all}");
}

#[test]
fn plan_and_bits_are_those_of_any_number_of_threads() {
    for shape in shapes().iter().step_by(9) {
        let made = [1, 2, 7].map(|threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
            pool.install(|| Baked::new(&shape.scene(), Lattice { voxel_size: shape.h }, usize::MAX))
        });
        for other in &made[1..] {
            assert!(made[0].plan.origins().eq(other.plan.origins()), "{}", shape.name);
            assert_eq!(made[0].bricks.len(), other.bricks.len());
            for (a, b) in made[0].bricks.values().zip(other.bricks.values()) {
                assert_eq!(a.values.map(f32::to_bits), b.values.map(f32::to_bits), "{}", shape.name);
            }
        }
    }
}
