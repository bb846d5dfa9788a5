//! Feet: the product's against dense bracketing.

use glam::DVec3;
use rayon::prelude::*;
use vdbake::field::Lattice;

use crate::gates_bake::{Baked, Expect, Reveal, Tube, centre, voxels};
use crate::gates_oracle::{Bezier, Foot, Random, show};

/// A foot that differs by more than this in density was missed, or is none.
const MISSED: f64 = 1e-3;

/// Closer to the surface, or to an end plane, than this in radii, rounding decides whether a voxel is inside.
const EDGE: f64 = 1e-5;

/// What the voxels of some bakes showed.
#[derive(Debug, Clone, Default)]
struct Tally {
    /// In voxels.
    distance: Vec<f64>,
    foot: Vec<f64>,
    /// Of densities where the best foot fades at the focal set.
    faded: Vec<f64>,
    inside: usize,
    missed: Vec<(DVec3, f64, f64)>,
}

impl Tally {
    fn add(mut self, other: Tally) -> Tally {
        self.distance.extend(other.distance);
        self.foot.extend(other.foot);
        self.faded.extend(other.faded);
        self.missed.extend(other.missed);
        self.inside += other.inside;
        self
    }

    fn row(&mut self, name: &str) -> String {
        let foot = [0.99, 0.999, 1.0].map(|part| quantile(&mut self.foot, part));
        let distance = [0.999, 1.0].map(|part| quantile(&mut self.distance, part));
        let faded = quantile(&mut self.faded, 1.0);
        format!(
            "{name:38} | {:7} | {:7.1e}, {:7.1e} | {:7.1e}, {:7.1e}, {:7.1e} | {:6}, {faded:7.1e} | {}",
            self.inside,
            distance[0],
            distance[1],
            foot[0],
            foot[1],
            foot[2],
            self.faded.len(),
            self.missed.len()
        )
    }
}

fn quantile(values: &mut [f64], part: f64) -> f64 {
    values.sort_by(f64::total_cmp);
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "an index")]
    let at = (part * values.len().saturating_sub(1) as f64).ceil() as usize;
    values.get(at).copied().unwrap_or(0.0)
}

/// Compares `bricks` bricks of a tube.
fn compare(tube: &Tube, h: f64, bricks: usize) -> Tally {
    let axis = tube.axis();
    let made = [Reveal::Distance, Reveal::Foot].map(|reveal| {
        let scene = tube.scene(reveal);
        let expect = Expect::new(tube, &scene, reveal, axis.length());
        (Baked::new(&scene, Lattice { voxel_size: h }, bricks), expect)
    });
    let ends = axis.ends();
    let origins: Vec<[i32; 3]> = made[0].0.plan.origins().collect();
    let tallies = origins.into_par_iter().map(|origin| {
        let mut tally = Tally::default();
        for voxel in voxels(origin) {
            let p = centre(voxel, h);
            let near_end = ends.iter().any(|(end, outward)| {
                (p - *end).dot(*outward).abs() < EDGE * tube.radius && p.distance(*end) < 1.001 * tube.radius
            });
            let feet = axis.feet(p, 1.001 * tube.radius, tube.round);
            let at_surface = feet.iter().any(|foot| (foot.distance / tube.radius - 1.0).abs() < EDGE);
            if near_end || at_surface {
                continue;
            }
            for (baked, expect) in &made {
                tally.enter(tube, h, p, f64::from(baked.at(voxel)), &feet, expect);
            }
        }
        tally
    });
    tallies.reduce(Tally::default, Tally::add)
}

impl Tally {
    fn enter(&mut self, tube: &Tube, h: f64, p: DVec3, value: f64, feet: &[Foot], expect: &Expect) {
        let best = expect.best(feet);
        let truth = best.map_or(0.0, |best| best.1);
        let error = (value - truth).abs();
        if error > MISSED {
            self.missed.push((p, value, truth));
        }
        let Some((foot, _)) = best else { return };
        if foot.focal < 0.2 {
            self.faded.push(error);
        } else if matches!(expect.reveal(), Reveal::Distance) {
            self.inside += 1;
            self.distance.push(error * tube.radius / h);
        } else {
            let slope = expect.slope(foot.arc).abs() * h;
            // Flatter, the density does not tell the foot.
            if slope > 0.05 {
                self.foot.push(error / slope);
            }
        }
    }
}

/// What a tally may hold at most: errors of distance in radii, of feet in voxels, of densities that fade.
#[derive(Debug, Clone, Copy)]
struct Most {
    distance: f64,
    foot: f64,
    faded: f64,
}

/// The spans reproduce u and v to 3e-7 radii each, and single precision loses about 2e-7 more in polynomials of degree 5.
/// Newton's steps end 1e-5 voxels from a foot or closer. The fade's slope is 7.5 per `1 - kappa rho cos`, which moves with
/// the foot by less than 1 a voxel.
const MOST: Most = Most { distance: 7e-7, foot: 1.5e-5, faded: 1e-4 };

impl Tally {
    /// That nothing was missed, and that errors stay below `most`, at so many voxels a radius.
    fn hold(mut self, name: &str, ratio: f64, most: Most) {
        show(&self.row(name));
        for missed in self.missed.iter().take(4) {
            show(&format!("    {missed:?}"));
        }
        let worst = [&self.distance, &self.foot, &self.faded]
            .map(|errors| errors.iter().fold(0.0_f64, |worst, error| worst.max(*error)));
        assert!(self.inside > 100, "{name}: {} voxels", self.inside);
        assert_eq!(self.missed.len(), 0, "{name}: at, found, expected: {:?}", self.missed[0]);
        assert!(worst[0] <= most.distance * ratio, "{name}: distances are off by {:e} voxels", worst[0]);
        assert!(worst[1] <= most.foot, "{name}: feet are off by {:e} voxels", worst[1]);
        assert!(worst[2] <= most.faded, "{name}: faded densities are off by {:e}", worst[2]);
    }
}

/// A random segment, and the radius for a largest kappa r of `bend`; no longer than `longest` radii.
fn random_segment(random: &mut Random, degree: usize, bend: f64, longest: f64) -> (Vec<DVec3>, f64) {
    loop {
        let points: Vec<DVec3> = (0..=degree).map(|_| random.point()).collect();
        let segment = Bezier::new(&points);
        let radius = bend / segment.curvature();
        if segment.length() < longest * radius && radius < segment.length() {
            return (points, radius);
        }
    }
}

/// Random segments of both degrees with kappa r in `bend`, at `ratio` voxels a radius, scaled and shifted.
fn random_segments(ratio: f64, bend: [f64; 2], scale: f64, shift: f64) -> Tally {
    let mut random = Random(1);
    let mut tally = Tally::default();
    let (longest, bricks) = (if bend[1] > 1.0 { 8.0 } else { 100.0 }, if ratio < 8.0 { 24 } else { 8 });
    for i in 0..10 {
        let kappa_r = random.within(bend[0], bend[1]);
        let (points, radius) = random_segment(&mut random, 2 + i % 2, kappa_r, longest);
        let tube = Tube::new(vec![points], radius, 1.0).scaled(scale).mapped(|p| p + DVec3::splat(shift));
        tally = tally.add(at_ratio(tube, ratio, bricks));
    }
    tally
}

/// A tube at `ratio` voxels a radius, with noise of four voxels a cell.
fn at_ratio(mut tube: Tube, ratio: f64, bricks: usize) -> Tally {
    let h = tube.radius / ratio;
    tube.cells = tube.axis().length() / (4.0 * h);
    compare(&tube, h, bricks)
}

#[test]
fn random_segments_have_the_feet_that_dense_bracketing_finds() {
    show("r/h, kappa r | voxels | distance p99.9, max | foot p99, p99.9, max | faded, max | missed");
    let (mild, beyond) = ([0.05, 0.9], [0.9, 3.0]);
    for ratio in [2.0, 4.0, 8.0, 16.0, 32.0] {
        for bend in [mild, beyond] {
            random_segments(ratio, bend, 1.0, 0.0).hold(&format!("{ratio}, {bend:?}"), ratio, MOST);
        }
    }
    for (scale, shift) in [(1e-6, 0.0), (1e6, 0.0), (1.0, 1e6)] {
        let tally = random_segments(16.0, mild, scale, shift);
        tally.hold(&format!("16, {mild:?}, x {scale:?} + {shift:?}"), 16.0, MOST);
    }
}

fn points(coordinates: &[[f64; 3]]) -> Vec<DVec3> {
    coordinates.iter().map(|p| DVec3::from(*p)).collect()
}

#[test]
fn every_bend_down_to_none() {
    for k in 0..=13 {
        let bend = if k == 13 { 0.0 } else { libm::pow(0.1, f64::from(k)) };
        let turn = |p: DVec3| DVec3::new(0.8 * p.x - 0.6 * p.y, 0.6 * p.x + 0.8 * p.y, p.z + 0.3 * p.x);
        for along in [0.5, 0.3] {
            let quadratic = points(&[[0.0; 3], [along, bend, 0.3 * bend], [1.0, 0.0, 0.0]]);
            let cubic = points(&[[0.0; 3], [along, bend, 0.0], [0.6, 0.0, bend], [1.0, 0.0, 0.0]]);
            for segment in [quadratic, cubic] {
                let tube = Tube::new(vec![segment], 0.2, 1.0).mapped(turn);
                at_ratio(tube, 7.3, 12).hold(&format!("bend {bend:e} at {along}"), 7.3, MOST);
            }
        }
    }
}

#[test]
fn folds_cusps_and_standing_starts() {
    let (o, x) = ([0.0; 3], [1.0, 0.0, 0.0]);
    let mut cases = vec![
        ("straight and uneven".to_owned(), points(&[o, [0.9, 0.0, 0.0], x])),
        ("fold".to_owned(), points(&[o, [1.5, 0.0, 0.0], x])),
        ("zigzag".to_owned(), points(&[o, [2.0, 0.0, 0.0], [-1.0, 0.0, 0.0], x])),
        ("standing start".to_owned(), points(&[o, o, x])),
        ("standing end".to_owned(), points(&[o, x, x])),
        ("bent standing start".to_owned(), points(&[o, o, x, [1.0, 1.0, 0.3]])),
        ("standing ends".to_owned(), points(&[o, o, x, x])),
        ("cusp".to_owned(), points(&[o, [1.0, 1.0, 0.0], [0.0, 1.0, 0.0], x])),
    ];
    for k in [2, 3, 4, 5, 6, 8, 10, 12] {
        let off = libm::pow(0.1, f64::from(k));
        cases.push((format!("fold but for {off:e}"), points(&[o, [1.5, off, 0.0], x])));
        cases.push((format!("cusp but for {off:e}"), points(&[o, [1.0, 1.0, 0.0], [off, 1.0, 0.0], x])));
        cases.push((format!("cusp left by {off:e}"), points(&[o, [1.0, 1.0, off], [0.0, 1.0, 0.0], x])));
    }
    // No tip's plane on a plane of voxel centres: there rounding decides between the tip and a foot beside it.
    let turn = |p: DVec3| DVec3::new(0.8 * p.x - 0.6 * p.y + 0.012_345_6, 0.6 * p.x + 0.8 * p.y, p.z);
    for (name, segment) in cases {
        for radius in [0.03, 0.2] {
            let tube = Tube::new(vec![segment.clone()], radius, 1.0).mapped(turn);
            at_ratio(tube, 5.7, 64).hold(&format!("{name}, {radius}"), 5.7, MOST);
        }
    }
}

/// The joints of a straight line cut into many lie on planes of voxel centres; those of a wave lie anywhere, some closer
/// than a voxel.
#[test]
fn no_hole_or_seam_at_joints() {
    let cut = |points: &[DVec3], ends: &[f64]| -> Vec<Vec<DVec3>> {
        let whole = Bezier::new(points);
        let part = |a: f64, b: f64| {
            let (p, q) = (whole.at(a), whole.at(b));
            vec![p, p + whole.d1(a) * ((b - a) / 3.0), q - whole.d1(b) * ((b - a) / 3.0), q]
        };
        ends.windows(2).map(|pair| part(pair[0], pair[1])).collect()
    };
    let sixteenths: Vec<f64> = (0..=32).map(|i| f64::from(i) / 32.0).collect();
    let line = points(&[[0.0; 3], [0.0, 0.0, 1.0 / 3.0], [0.0, 0.0, 2.0 / 3.0], [0.0, 0.0, 1.0]]);
    // Voxels of 1/32, moved by half of one.
    let half = DVec3::splat(1.0 / 64.0);
    let tube = Tube::new(cut(&line, &sixteenths), 6.0 / 32.0, 1.0).mapped(|p| p + half);
    at_ratio(tube, 6.0, 16).hold("line in 32", 6.0, MOST);

    let fold = Tube::new(vec![points(&[[0.0; 3], [1.5, 0.0, 0.0], [1.0, 0.0, 0.0]])], 6.0 / 32.0, 1.0);
    at_ratio(fold.mapped(|p| p + half), 6.0, 64).hold("fold with its tip in such a plane", 6.0, MOST);

    let wave = points(&[[0.0; 3], [1.0, 1.0, 0.2], [0.2, -1.0, 0.7], [1.0, 0.3, 1.0]]);
    let mut random = Random(3);
    for (name, count, ratio) in [("wave in 5", 5, 6.3), ("wave in 60", 60, 3.1)] {
        let mut ends: Vec<f64> = (1..count).map(|_| random.unit()).collect();
        ends.extend([0.0, 1.0]);
        ends.sort_by(f64::total_cmp);
        let tube = Tube::new(cut(&wave, &ends), 0.15, 1.0);
        at_ratio(tube, ratio, 24).hold(name, ratio, MOST);
    }
    for degrees in [1e-5, 1.0, 90.0, 179.0, 180.0] {
        let angle = degrees / 180.0 * std::f64::consts::PI;
        let (o, x) = (DVec3::ZERO, DVec3::X);
        let away = x + DVec3::new(libm::cos(angle), 0.8 * libm::sin(angle), 0.6 * libm::sin(angle));
        let away = if degrees == 180.0 { o } else { away };
        // No joint's plane, where on a corner's inside the density jumps, on a plane of voxel centres.
        let tube = Tube::new(vec![vec![o, 0.5 * x, x], vec![x, 0.5 * (x + away), away]], 0.2, 1.0)
            .mapped(|p| p + DVec3::splat(0.012_345_6));
        at_ratio(tube, 5.3, 32).hold(&format!("corner of {degrees} degrees"), 5.3, MOST);
    }
}

/// Densities of all voxels, by index.
fn densities(tube: &Tube, reveal: Reveal, h: f64) -> Vec<([i32; 3], f32)> {
    let baked = Baked::new(&tube.scene(reveal), Lattice { voxel_size: h }, usize::MAX);
    let origins: Vec<_> = baked.bricks.keys().copied().collect();
    origins.into_iter().flat_map(voxels).map(|voxel| (voxel, baked.at(voxel))).collect()
}

/// A bent tube without an axis of symmetry.
fn bent(random: &mut Random) -> Tube {
    let (points, radius) = random_segment(random, 3, 0.7, 12.0);
    // On a coarse lattice of numbers, so that moves below are exact.
    let grid = |p: DVec3| (p * 4096.0).round() / 4096.0;
    Tube::new(vec![points.into_iter().map(grid).collect()], radius, 20.0)
}

#[test]
fn moved_turned_reversed_and_split_tubes_have_the_same_density() {
    let mut random = Random(4);
    for _ in 0..4 {
        let tube = bent(&mut random);
        // A power of two: shifts by whole bricks are exact.
        let h = libm::exp2(libm::floor(libm::log2(tube.radius / 5.0)));
        let shift = DVec3::new(8.0, -16.0, 24.0) * h * 1024.0;
        let [a, b, c, d] = [0, 1, 2, 3].map(|i| tube.segments[0][i]);
        let (ab, bc, cd) = (0.5 * (a + b), 0.5 * (b + c), 0.5 * (c + d));
        let (abc, bcd) = (0.5 * (ab + bc), 0.5 * (bc + cd));
        let middle = 0.5 * (abc + bcd);
        let split =
            Tube { segments: vec![vec![a, ab, abc, middle], vec![middle, bcd, cd, d]], ..tube.clone() };
        let moved = tube.mapped(|p| p + shift);
        let turned = tube.mapped(|p| DVec3::new(p.y, p.z, p.x));
        let quarter = tube.mapped(|p| DVec3::new(-p.y, p.x, p.z));
        #[allow(clippy::cast_possible_truncation, reason = "whole and small")]
        let by = (shift / h).to_array().map(|x| x as i32);
        type Map<'a> = &'a dyn Fn([i32; 3]) -> [i32; 3];
        let cases: [(&str, &Tube, Map<'_>, Option<Reveal>); 5] = [
            ("reversed", &tube.reversed(), &|v| v, Some(Reveal::Distance)),
            ("split", &split, &|v| v, None),
            ("moved", &moved, &|v| [v[0] + by[0], v[1] + by[1], v[2] + by[2]], None),
            ("turned", &turned, &|v| [v[1], v[2], v[0]], None),
            ("quarter", &quarter, &|v| [-1 - v[1], v[0], v[2]], None),
        ];
        for reveal in [Reveal::Distance, Reveal::Foot] {
            let plain = densities(&tube, reveal, h);
            for (name, other, map, only) in &cases {
                if only.is_some_and(|only| only != reveal) {
                    continue;
                }
                let scene = other.scene(reveal);
                let baked = Baked::new(&scene, Lattice { voxel_size: h }, usize::MAX);
                let mut apart = 0;
                for &(voxel, value) in &plain {
                    let error = (f64::from(baked.at(map(voxel))) - f64::from(value)).abs();
                    // Twice the error of one bake: distances to 7e-7 radii; slopes of the noise are at most 3.75 * 0.9 * 20
                    // a length of 12 radii, feet to 1.5e-5 of a fifth of a radius. A voxel on the surface may differ.
                    apart += usize::from(error > 1e-4);
                }
                assert!(apart <= 2, "{name}: {apart} of {}", plain.len());
            }
        }
    }
}

#[test]
fn scaling_by_powers_of_two_changes_no_bit() {
    let mut random = Random(5);
    for _ in 0..2 {
        let tube = bent(&mut random);
        let h = tube.radius / 6.0;
        for reveal in [Reveal::Distance, Reveal::Foot] {
            let plain = densities(&tube, reveal, h);
            for exponent in [-20.0, -1.0, 10.0, 20.0] {
                let scale = libm::exp2(exponent);
                let scaled = densities(&tube.scaled(scale), reveal, h * scale);
                assert_eq!(plain.len(), scaled.len());
                for (a, b) in plain.iter().zip(&scaled) {
                    assert_eq!((a.0, a.1.to_bits()), (b.0, b.1.to_bits()), "x 2^{exponent}");
                }
            }
        }
    }
}
