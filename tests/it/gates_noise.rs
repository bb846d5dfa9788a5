//! Noise: its bounds are suprema, its precision does not depend on the place, its hash has no preferences.

use vdbake::field::{Field, Lattice};
use vdbake::noise::{BOUND, Octave, perlin};
use vdbake::num::{Level, Real, WithLevel, with_level};
use vdbake::reference::{self, Reference};
use vdbake::volume::{Plan, Store, bake};

use crate::gates_bake::{centre, parse, tube_text};
use crate::gates_oracle::{Random, show};

/// The quintic fade, and its first and second derivative.
fn fade(t: f64) -> [f64; 3] {
    [
        t * t * t * (10.0 + t * (6.0 * t - 15.0)),
        30.0 * t * t * (1.0 - t) * (1.0 - t),
        60.0 * t * (1.0 - t) * (1.0 - 2.0 * t),
    ]
}

/// Of the noise at a point of the unit cell, or of its derivative of the given order along the unit vector `e`: the
/// largest value that any choice of the corners' gradients gives.
///
/// The noise is linear in each gradient, so each adds the larger two components of what it is multiplied by.
fn largest(order: usize, p: [f64; 3], e: [f64; 3]) -> f64 {
    let mut sum = 0.0;
    for corner in 0..8 {
        let mut d = [0.0; 3];
        // Weight of the corner along each axis, and its derivatives.
        let mut w = [[0.0; 3]; 3];
        for axis in 0..3 {
            let up = corner >> axis & 1 == 1;
            d[axis] = p[axis] - f64::from(up);
            let f = fade(p[axis]);
            w[axis] = if up { f } else { [1.0 - f[0], -f[1], -f[2]] };
        }
        let product = |n: [usize; 3]| w[0][n[0]] * w[1][n[1]] * w[2][n[2]];
        let (mut first, mut second) = (0.0, 0.0);
        for i in 0..3 {
            let mut n = [0; 3];
            n[i] += 1;
            first += e[i] * product(n);
            for j in 0..3 {
                let mut n = n;
                n[j] += 1;
                second += e[i] * e[j] * product(n);
            }
        }
        let mut form = [0, 1, 2].map(|i| match order {
            0 => product([0; 3]) * d[i],
            1 => first * d[i] + product([0; 3]) * e[i],
            _ => second * d[i] + 2.0 * first * e[i],
        });
        form = form.map(f64::abs);
        form.sort_by(f64::total_cmp);
        sum += form[1] + form[2];
    }
    sum
}

/// Climbs from random places, in the cell and if `turning` in direction too, by ever shorter steps.
fn supremum(order: usize, turning: bool) -> (f64, [f64; 3], [f64; 3]) {
    let mut random = Random(21);
    let mut best = (0.0, [0.5; 3], [1.0, 0.0, 0.0]);
    for start in 0..60 {
        let mut p = [random.unit(), random.unit(), random.unit()];
        let mut e = [1.0, 0.0, 0.0];
        if turning {
            e = random.point().normalize().to_array();
        }
        if start == 0 {
            p = [0.5; 3];
        }
        let (mut value, mut step) = (largest(order, p, e), 0.25);
        while step > 1e-9 {
            let mut better = false;
            for _ in 0..30 {
                let q = [0, 1, 2].map(|i| (p[i] + step * random.within(-1.0, 1.0)).clamp(0.0, 1.0));
                let turned = (glam::DVec3::from(e) + step * random.point()).normalize().to_array();
                let f = if turning { turned } else { e };
                let there = largest(order, q, f);
                if there > value {
                    (p, e, value, better) = (q, f, there, true);
                }
            }
            step *= if better { 1.0 } else { 0.6 };
        }
        if value > best.0 {
            best = (value, p, e);
        }
    }
    best
}

#[test]
fn bounds_are_the_suprema_over_all_gradients() {
    let value = supremum(0, false);
    let slope = supremum(1, true);
    let bend = supremum(2, false);
    let any_bend = supremum(2, true);
    show(&format!(
        "|n| {value:?}\n|grad n| {slope:?}\nalong an axis {bend:?}\nalong any direction {any_bend:?}"
    ));
    // The climb ends within rounding of the maximum.
    assert!(value.0 <= BOUND && value.0 > BOUND - 2e-8);
    assert!((slope.0 - 3.75).abs() < 1e-6);
    assert!((bend.0 - 12.04).abs() < 5e-3);
    assert!((any_bend.0 - 14.4).abs() < 0.1);
}

fn noise(cell: [u32; 3], p: [f64; 3], seed: u32) -> f64 {
    perlin::<f64>((), cell, p, seed)
}

#[test]
fn the_real_noise_stays_below_its_bounds() {
    let mut random = Random(22);
    let worst = supremum(0, false).1;
    let (mut value, mut slope, mut bend) = (0.0_f64, 0.0_f64, 0.0_f64);
    let h = 1e-4;
    for i in 0..400_000 {
        let bits = random.bits();
        #[allow(clippy::cast_possible_truncation, reason = "bits")]
        let cell = [bits as u32, (bits >> 21) as u32, (bits >> 42) as u32];
        // Half of them where the bounds are reached, in cells with every choice of gradients.
        let p = match i % 4 {
            0 => worst,
            1 => [0.5; 3],
            _ => [random.unit(), random.unit(), random.unit()],
        };
        let e = if i % 2 == 0 { glam::DVec3::X } else { random.point().normalize() };
        let at = |k: f64| noise(cell, [p[0] + k * h * e.x, p[1] + k * h * e.y, p[2] + k * h * e.z], 5);
        let [before, here, after] = [at(-1.0), at(0.0), at(1.0)];
        value = value.max(here.abs());
        slope = slope.max((after - before).abs() / (2.0 * h));
        if i % 2 == 0 {
            bend = bend.max((after - 2.0 * here + before).abs() / (h * h));
        }
    }
    show(&format!("largest of 400 000: {value}, slope {slope}, second derivative along x {bend}"));
    // Differences are means of the derivative, so no larger, but for rounding 1e-16 / h^2.
    assert!(value <= BOUND && slope <= 3.75 + 1e-9 && bend <= 12.05);
    // And they would not be low for long if the bounds were for another noise.
    assert!(value > 0.85 && slope > 2.4 && bend > 8.0);
}

/// Five octaves: frequencies and amplitudes.
fn octaves(gain: f64, lacunarity: f64) -> Vec<(f64, f64)> {
    let (mut frequency, mut amplitude) = (1.0, 1.0);
    (0..5)
        .map(|_| {
            let octave = (frequency, amplitude);
            frequency *= lacunarity;
            amplitude *= gain;
            octave
        })
        .collect()
}

#[test]
fn sums_of_octaves_stay_below_theirs() {
    let mut random = Random(23);
    for (gain, lacunarity) in [(0.5, 2.0), (0.7, 2.3), (1.2, 1.5)] {
        let octaves = octaves(gain, lacunarity);
        let made: Vec<Octave<f64>> = octaves
            .iter()
            .zip(0_u32..)
            .map(|(&(f, a), k)| Octave::new([0.3, 0.7, f64::from(k)], [f; 3], 77 + k, a))
            .collect();
        let sum = |p: [f64; 3]| made.iter().map(|octave| octave.value::<f64>((), p)).sum::<f64>();
        let most: f64 = octaves.iter().map(|(_, a)| a).sum::<f64>() * BOUND;
        let steepest: f64 = octaves.iter().map(|(f, a)| 3.75 * f * a).sum();
        for _ in 0..50_000 {
            let (p, e) = (random.point() * 50.0, random.point().normalize() * 1e-4);
            let (a, b) = (sum(p.to_array()), sum((p + e).to_array()));
            assert!(a.abs() <= most, "{a}");
            assert!((b - a).abs() <= steepest * 1e-4, "{a} {b}");
        }
    }
}

/// A sum of octaves at points, in the product's lanes.
struct Lanes<'a> {
    octaves: &'a [Octave<f32>],
    points: &'a [[f32; 3]],
    out: &'a mut Vec<f32>,
}

impl WithLevel for Lanes<'_> {
    type Output = ();
    #[inline(always)]
    fn run<R: Real<Scalar = f32>>(self, token: R::Token) {
        for sixteen in self.points.chunks_exact(16) {
            let mut axes = [[0.0; 16]; 3];
            for (i, point) in sixteen.iter().enumerate() {
                for axis in 0..3 {
                    axes[axis][i] = point[axis];
                }
            }
            let p = [R::load(token, &axes[0]), R::load(token, &axes[1]), R::load(token, &axes[2])];
            let mut sum = R::constant(token, 0.0);
            for octave in self.octaves {
                sum = sum + octave.value(token, p);
            }
            let mut values = [0.0; 16];
            sum.store(&mut values);
            self.out.extend(values);
        }
    }
}

pub(crate) fn lanes(octaves: &[Octave<f32>], points: &[[f32; 3]]) -> Vec<f32> {
    let mut out = Vec::new();
    with_level(Level::best(), Lanes { octaves, points, out: &mut out });
    out
}

/// Multiples of 2^-14 in [-2, 2): with whole numbers up to 1e7 before them, every coordinate is exact in `f64`.
#[allow(clippy::cast_possible_truncation, reason = "exact in single precision")]
fn grid_points(count: usize) -> Vec<[f32; 3]> {
    let mut random = Random(24);
    let mut next = || ((random.within(-2.0, 2.0) * 16384.0).floor() / 16384.0) as f32;
    (0..count).map(|_| [next(), next(), next()]).collect()
}

#[test]
fn five_octaves_are_as_precise_at_ten_million_as_at_the_origin() {
    let points = grid_points(16 * 400);
    let sum = octaves(0.5, 2.0);
    let mut split = Vec::new();
    for far in [0.0, 1e3, 1e4, 1e5, 1e6, 1e7] {
        let truth: Vec<f64> = points
            .iter()
            .map(|p| {
                sum.iter()
                    .zip(0_u32..)
                    .map(|(&(f, a), k)| {
                        let at = p.map(|x| (far + f64::from(x)) * f);
                        #[allow(clippy::cast_possible_truncation, reason = "whole numbers below 2^53")]
                        let cell = at.map(|x| x.floor() as i64);
                        a * reference::perlin(cell, at.map(|x| x - x.floor()), k)
                    })
                    .sum()
            })
            .collect();
        let errors = |octaves: &[Octave<f32>], points: &[[f32; 3]]| {
            let found = lanes(octaves, points);
            truth.iter().zip(found).map(|(a, b)| (a - f64::from(b)).abs()).fold(0.0, f64::max)
        };
        let octaves = |from: f64| -> Vec<Octave<f32>> {
            sum.iter().zip(0_u32..).map(|(&(f, a), k)| Octave::new([from * f; 3], [f; 3], k, a)).collect()
        };
        #[allow(clippy::cast_possible_truncation, reason = "the loss is what is measured")]
        let global: Vec<[f32; 3]> = points.iter().map(|p| p.map(|x| (far + f64::from(x)) as f32)).collect();
        let (apart, whole) = (errors(&octaves(far), &points), errors(&octaves(0.0), &global));
        show(&format!(
            "at {far:e}: cells and fractions apart {apart:.1e}, one single-precision number {whole:.1e}"
        ));
        // Rounding of the five octaves' corners: 1e-6 for each of amplitude 1.
        assert!(apart < 2e-6, "{apart:e} at {far}");
        assert!(far < 1e4 || whole > 1e-3, "the measure is blind at {far}: {whole:e}");
        split.push(apart);
    }
    assert!(split.iter().all(|error| *error < 1.5 * split[0]), "{split:?}");
}

/// Scrolled by ten million cells, a tube's pattern is as precise as at rest.
#[test]
fn a_pattern_scrolled_by_ten_million_cells_is_as_precise() {
    let o = glam::DVec3::ZERO;
    let segment = vec![o, glam::DVec3::new(0.3, 0.2, 0.5), glam::DVec3::new(0.0, 0.4, 1.0)];
    let layer = "envelope = { radial = \"hard\" }\n[[tube.layer]]\nop = \"add\"\nnoise = \"perlin\"\n\
                 frequency = [2.0, 3.0, 5.0]\noctaves = 5\nscroll = [1.0, -2.0, 10.0]\n";
    let scene = parse(&tube_text(&[segment], "0.2", layer));
    let h = 0.2 / 9.3;
    let mut worst = Vec::new();
    for time in [0.0, 1e3, 1e5, 1e6] {
        let scene = scene.at(time).expect("nothing moves");
        let field = Field::compile(&scene);
        let plan = Plan::new(&field, Lattice { voxel_size: h }, 1 << 30).expect("a small plan");
        let mut store = Store::default();
        let Ok(_) = bake(&field, &plan, 0.0, Level::best(), &mut store, |_| ());
        let truth = Reference::new(&scene, Some(h));
        let mut error = 0.0_f64;
        for (voxel, value) in store.active().step_by(7) {
            let p = centre(voxel, h);
            let at = truth.cylinder(0, p.to_array());
            // Where the hard envelope ends, rounding decides.
            if at.iter().all(|at| (at.q() - 1.0).abs() > 1e-4) {
                error = error.max((truth.density(p.to_array()) - f64::from(value)).abs());
            }
        }
        worst.push(error);
    }
    show(&format!("after 0, 1e3, 1e5 and 1e6 seconds: {worst:?}"));
    // The largest slopes, 3.75 * 5 * 5, times 5e-7 of (u, v, l).
    assert!(worst.iter().all(|error| *error > 0.0 && *error < 5e-5), "{worst:?}");
}
