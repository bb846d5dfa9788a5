//! What a noise layer takes beyond its octaves: forms, turned lattices, warps, loops, world space, offsets.

use std::fmt::Write;

use glam::DVec3;
use rayon::prelude::*;
use vdbake::field::{Extent, Field, Lattice};
use vdbake::noise::{Form, MEAN_MAGNITUDE, Octave, octave_seed, turn, turn_around};
use vdbake::num::Level;
use vdbake::reference::{self, Reference};
use vdbake::scene::{Pattern, Scene};
use vdbake::volume::{Plan, Store, bake, density_at};

use crate::gates_noise::lanes;
use crate::gates_oracle::Random;
use crate::kernel::{assert_close, lattice, scene};

/// A bent tube with one layer of these further lines.
fn tube(lines: &str) -> Scene {
    scene(&text(BENT, lines))
}

const BENT: &str = "{ points = [[0,0,0],[0.5,0.2,1],[0,0.4,2]] }";

fn text(curve: &str, lines: &str) -> String {
    // What meets itself where a curve closes.
    let across = if curve.contains("closed") {
        "radius = 0.3\ntwist = 1.0"
    } else {
        "radius = [[0, 0.2], [1, 0.35]]\ntwist = 0.7"
    };
    format!(
        "[[tube]]\ncurve = {curve}\n{across}\nenvelope = {{ radial = \"smooth\" }}\n\
         [[tube.layer]]\nop = \"add\"\nfrequency = [2.0, 2.5, 4.0]\noctaves = 4\n{lines}\n"
    )
}

/// Every option, alone and with others.
const OPTIONS: [&str; 14] = [
    "form = \"billow\"",
    "form = \"ridged\"\nnormalise = true",
    "rotate = true",
    "offset = [0.3, -7.25, 1000.1]",
    "warp = { amplitude = 0.5 }",
    "warp = { amplitude = 0.3, frequency = [1.0, 1.5, 2.0], octaves = 3, gain = 0.4, lacunarity = 1.9, seed = 5 }",
    "space = \"world\"\nfrequency = [3.0, 4.0, 5.0]",
    "space = \"world\"\nrotate = true\nform = \"ridged\"\nfrequency = 4.0",
    "space = \"world\"\nwarp = { amplitude = 0.4 }\noffset = [1e3, 0.1, -5.0]\nfrequency = [4.0, 0.0, 3.0]",
    "rotate = true\nform = \"billow\"\nwarp = { amplitude = 0.3, octaves = 1 }\nthreshold = 0.1",
    "rotate = true\nform = \"ridged\"\noffset = [0.0, 0.0, 0.4]\nfrequency = [2.0, 2.0, 0.0]",
    "warp = { amplitude = 0.4 }\nfrequency = [3.0, 3.0, 0.0]\nrotate = true",
    "space = \"world\"\nfrequency = 4.0\n[[tube.layer]]\nfrequency = 3.0\nform = \"billow\"\nrotate = true",
    "frequency = 2.0\n[[tube.layer]]\nop = \"max\"\nspace = \"world\"\nform = \"ridged\"\nwarp = { frequency = 2.0 }\nfrequency = 3.0",
];

fn option(curve: &str, lines: &str, fade: bool) -> Scene {
    let text = format!("[bake]\noctave_fade = {fade}\n{}", once(&text(curve, lines)));
    Scene::parse_at(&text, "test.toml", 0.7).unwrap_or_else(|errors| panic!("{errors}"))
}

#[test]
fn every_option_agrees_with_the_reference() {
    for lines in OPTIONS {
        for (resolution, fade) in [(30.0, true), (30.0, false), (150.0, true)] {
            assert_close(lines, &option(BENT, lines, fade), resolution, 0.0);
        }
    }
}

/// Where a tube twists much, octaves fade outwards from its axis: whole ones are left out far from it, and none is where it is near.
#[test]
fn octaves_that_fade_outwards_agree_with_the_reference() {
    for (twist, radius) in [(5.0, "0.3"), (12.0, "0.3"), (12.0, "[[0, 0.05], [1, 0.35]]")] {
        let text = format!(
            "[[tube]]\ncurve = {BENT}\nradius = {radius}\ntwist = {twist}\n\
             [[tube.layer]]\nop = \"add\"\nfrequency = [2.0, 2.5, 4.0]\noctaves = 6\ngain = 0.8\nform = \"ridged\"\n"
        );
        for resolution in [40.0, 90.0, 200.0] {
            assert_close(&format!("twist {twist}"), &scene(&text), resolution, 0.0);
        }
    }
}

/// The same on closed tubes, where patterns run around.
#[test]
fn every_option_agrees_with_the_reference_around_a_loop() {
    for lines in OPTIONS {
        for (fade, scroll) in [(true, ""), (false, "\nscroll = [0.3, 0.0, -2.7]")] {
            assert_close(lines, &option(&ring(), &format!("{lines}{scroll}"), fade), 60.0, 0.0);
        }
    }
    let metres = text(&ring(), "rotate = true\nwarp = { amplitude = 0.3 }")
        .replace("twist = 1.0", "twist = 1.0\nstretch = false")
        .replace("frequency = [2.0, 2.5, 4.0]", "frequency = [2.0, 2.5, 0.7]");
    assert_close("in metres", &scene(&metres), 60.0, 0.0);
}

/// A ring about the z axis that begins and ends at (1, 0, 0).
fn ring() -> String {
    let points: Vec<String> = (0..12)
        .map(|i| {
            let (sin, cos) = libm::sincos(f64::from(i) * std::f64::consts::TAU / 12.0);
            format!("[{cos}, {sin}, 0.0]")
        })
        .collect();
    format!("{{ kind = \"catmull-rom\", closed = true, points = [{}] }}", points.join(", "))
}

/// Patterns meet themselves where a tube closes, in the kernel and in the reference, whatever the options.
#[test]
fn patterns_close_around_a_loop() {
    for lines in OPTIONS {
        for extra in ["", "stretch = false\n"] {
            let text = text(&ring(), &format!("{lines}\nscroll = [0.0, 0.0, 1.3]"))
                .replace("twist = 1.0", &format!("twist = 1.0\n{extra}"));
            let scene =
                Scene::parse_at(&once(&text), "test.toml", 0.7).unwrap_or_else(|errors| panic!("{errors}"));
            let mut random = Random(44);
            // A micrometre apart: the steepest of the layers changes by no more than 3.75 * 30 * 20 times that.
            let pairs: Vec<[DVec3; 2]> = (0..400)
                .map(|_| {
                    let (x, z) = (1.0 + random.within(-0.2, 0.2), random.within(-0.2, 0.2));
                    [-0.5e-6, 0.5e-6].map(|y| DVec3::new(x, y, z))
                })
                .collect();
            let reference = Reference::new(&scene, None);
            let [mut largest, mut spread] = [0.0_f64; 2];
            for [a, b] in &pairs {
                let [a, b] = [a, b].map(|p| reference.density(p.to_array()));
                largest = largest.max((a - b).abs());
                spread = spread.max((a - 1.0).abs());
            }
            assert!(largest < 2.5e-3 && spread > 0.05, "{lines}{extra}: {largest:e} of {spread}");
            let field = Field::compile(&scene);
            let points: Vec<DVec3> = pairs.concat();
            let lattice = Lattice { voxel_size: 0.05 };
            let found = density_at(&field, lattice, &points, Level::best(), 1 << 32).expect("a small plan");
            for (pair, values) in pairs.iter().zip(found.chunks_exact(2)) {
                assert!((values[0] - values[1]).abs() < 2.5e-3, "{lines}{extra}: {values:?} at {}", pair[0]);
            }
        }
    }
}

/// Scrolled by whole periods of the first octave, all octaves have come round.
#[test]
fn a_scroll_around_a_loop_comes_round() {
    // 7.4 cells become 7, 14.8 become 15, and the warp's 5.3 become 5.
    let lines =
        "scroll = [0.0, 0.0, 7.0]\nwarp = { amplitude = 0.4, frequency = [2.0, 2.0, 5.3] }\nrotate = true";
    let text = text(&ring(), lines).replace("frequency = [2.0, 2.5, 4.0]", "frequency = [2.0, 2.5, 7.4]");
    let [start, part, round] = [0.0, 0.4, 1.0].map(|seconds| {
        Reference::new(&Scene::parse_at(&text, "test.toml", seconds).expect("a valid scene"), None)
    });
    let mut random = Random(45);
    let mut moved = 0.0_f64;
    for _ in 0..400 {
        let angle = random.within(0.0, std::f64::consts::TAU);
        let (sin, cos) = libm::sincos(angle);
        let distance = 1.0 + random.within(-0.15, 0.15);
        let p = [distance * cos, distance * sin, random.within(-0.15, 0.15)];
        let values = [&start, &part, &round].map(|reference| reference.density(p));
        assert!((values[0] - values[2]).abs() < 1e-12, "{values:?} at {p:?}");
        moved = moved.max((values[0] - values[1]).abs());
    }
    assert!(moved > 0.1, "{moved}");
}

/// The lines without the frequency that the first layer has before one of its own.
fn once(text: &str) -> String {
    let common = "frequency = [2.0, 2.5, 4.0]\n";
    let (before, after) = text.split_once(common).expect("the common line");
    let own = after.split("[[").next().is_some_and(|layer| layer.contains("\nfrequency"));
    format!("{before}{}{after}", if own { "" } else { common })
}

/// At a thousand kilometres from the origin the lattices are as precise as beside it.
#[test]
fn the_world_is_as_precise_far_away() {
    for (far, lines) in [
        (1e6, "space = \"world\"\nrotate = true"),
        (-1e6, "space = \"world\"\nwarp = { amplitude = 0.3 }\nscroll = [0.0, 0.0, 3.0]"),
    ] {
        let curve = format!(
            "{{ points = [[{far},0,{far}],[{},0.2,{}],[{far},0.4,{}]] }}",
            far + 0.5,
            far + 1.0,
            far + 2.0
        );
        let scene = scene(&text(&curve, lines));
        assert_close(lines, &scene, 60.0, 0.0);
    }
}

fn baked(scene: &Scene, resolution: f64) -> Vec<([i32; 3], u32)> {
    let field = Field::compile(scene);
    baked_at(&field, lattice(&field, resolution))
}

fn baked_at(field: &Field, lattice: Lattice) -> Vec<([i32; 3], u32)> {
    let plan = Plan::for_extent(field, lattice, Extent::Centres, 1 << 30).expect("a small plan");
    let mut store = Store::default();
    let Ok(_) = bake(field, &plan, 0.0, Level::best(), &mut store, |_| ());
    let values: Vec<_> = store.active().map(|(voxel, value)| (voxel, value.to_bits())).collect();
    assert!(!values.is_empty());
    values
}

#[test]
fn options_that_say_nothing_change_no_bit() {
    let plain = tube("threshold = -0.2");
    let found = baked(&plain, 60.0);
    for lines in [
        "warp = { amplitude = 0.0, frequency = 9.0, seed = 4 }",
        "warp = { amplitude = 0 }\nrotate = false\nform = \"fbm\"\nspace = \"cylinder\"\noffset = [0, 0, 0]",
    ] {
        let scene = tube(&format!("threshold = -0.2\n{lines}"));
        assert!(baked(&scene, 60.0) == found, "{lines}");
        let [before, after] = [&plain, &scene].map(|scene| Reference::new(scene, None));
        let mut random = Random(41);
        for _ in 0..2000 {
            let p = [random.within(0.0, 0.4), random.within(0.0, 0.4), random.within(0.0, 2.0)];
            assert_eq!(before.density(p).to_bits(), after.density(p).to_bits(), "{lines} at {p:?}");
        }
    }
}

/// Of a pattern n without an envelope, a threshold t makes max(n - t, 0), whichever octaves are left out below it.
#[test]
fn octaves_that_cannot_reach_a_threshold_are_left_out_exactly() {
    let values = |lines: &str, resolution: f64, level: Level| {
        let field = Field::compile(&scene(&format!(
            "[bake]\nantialias = \"off\"\n[[tube]]\ncurve = {{ points = [[0,0,0],[0.1,0.1,1],[0,0.2,2]] }}\n\
             radius = [[0, 0.2], [1, 0.35]]\ntwist = 0.7\nenvelope = {{ radial = \"hard\" }}\ncaps = \"flat\"\n\
             [[tube.layer]]\n{lines}\n"
        )));
        let lattice = lattice(&field, resolution);
        let plan = Plan::for_extent(&field, lattice, Extent::Centres, 1 << 30).expect("a small plan");
        let mut store = Store::default();
        let Ok(_) = bake(&field, &plan, 0.0, level, &mut store, |_| ());
        store.active().collect::<Vec<([i32; 3], f32)>>()
    };
    for lines in [
        "frequency = [2.0, 2.5, 4.0]\noctaves = 7",
        "octaves = 5\ngain = 0.8\nlacunarity = 0.5\nfrequency = 40.0",
        "octaves = 6\nform = \"billow\"\nrotate = true",
        "octaves = 3\nform = \"ridged\"\nnormalise = true",
        "octaves = 6\nwarp = { amplitude = 0.4, octaves = 3 }",
        "frequency = 4.0\noctaves = 6\nspace = \"world\"\nwarp = { amplitude = 0.4 }",
    ] {
        for resolution in [30.0, 150.0] {
            let all = values(lines, resolution, Level::best());
            for threshold in [0.05_f32, 0.3, 0.7] {
                let right: Vec<([i32; 3], f32)> = all
                    .iter()
                    .map(|(voxel, value)| (*voxel, value - threshold))
                    .filter(|(_, value)| *value > 0.0)
                    .collect();
                for level in Level::all() {
                    let found = values(&format!("{lines}\nthreshold = {threshold}"), resolution, level);
                    assert!(found == right, "{lines} above {threshold} at {resolution}");
                }
            }
        }
    }
}

/// Places scattered over 64^3 cells.
fn places(count: usize) -> Vec<[f32; 3]> {
    let mut random = Random(42);
    #[allow(clippy::cast_possible_truncation, reason = "rounding is no matter")]
    let mut next = || random.within(-32.0, 32.0) as f32;
    (0..count).map(|_| [next(), next(), next()]).collect()
}

fn moments(values: &[f32]) -> (f64, f64) {
    let count = values.len() as f64;
    let mean = values.iter().map(|x| f64::from(*x)).sum::<f64>() / count;
    let squares = values.iter().map(|x| (f64::from(*x) - mean) * (f64::from(*x) - mean)).sum::<f64>();
    (mean, (squares / count).sqrt())
}

const UNIT: [[f64; 3]; 3] = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];

fn values(form: Form, steps: [[f64; 3]; 3], seed: u32, places: &[[f32; 3]]) -> Vec<f32> {
    lanes(&[Octave::turned([0.3, 0.1, 0.7], steps, None, form, seed, 1.0)], places)
}

#[test]
fn turned_octaves_keep_mean_and_variance() {
    let places = places(1 << 18);
    for k in 0..8 {
        for steps in [turn(k), turn_around(k)] {
            let (mean, rms) = moments(&values(Form::Fbm, steps, octave_seed(1, k), &places));
            // Values of 64^3 cells, each as good as independent: 0.27 / 512, four times; the spread likewise.
            assert!(mean.abs() < 4.0 * 0.27 / 512.0, "octave {k}: mean {mean}");
            assert!((rms - 0.270_035).abs() < 4.0 * 0.27 / 512.0, "octave {k}: rms {rms}");
        }
    }
}

/// The mean that faded octaves leave is that of the noise itself.
#[test]
fn forms_keep_their_ranges_and_means() {
    let places = places(1 << 18);
    let (mut magnitude, mut count) = (0.0, 0.0);
    for seed in 0..8 {
        for (form, low, high) in
            [(Form::Billow, 0.0, 1.036_354), (Form::Ridged, 0.0, 1.0), (Form::Fbm, -1.036_354, 1.036_354)]
        {
            let found = values(form, UNIT, seed, &places);
            assert!(found.iter().all(|x| low <= f64::from(*x) && f64::from(*x) <= high), "{form:?}");
            let (mean, spread) = moments(&found);
            assert!(
                (mean - form.mean()).abs() < 4.0 * spread / 512.0,
                "{form:?}: {mean}, not {}",
                form.mean()
            );
            if form == Form::Billow {
                magnitude += mean;
                count += 1.0;
            }
        }
    }
    // Of two million values with a spread of 0.156, standard error 1.1e-4.
    assert!((magnitude / count - MEAN_MAGNITUDE).abs() < 4.4e-4, "{}", magnitude / count);
}

/// Whatever the form, and however far octaves have faded, a sum stays within 1.04 times the sum of its amplitudes, by which
/// scenes are checked for overflow; and those forms that have no negative values have none.
#[test]
fn sums_of_any_form_stay_below_their_bound() {
    let mut random = Random(46);
    for form in ["fbm", "billow", "ridged"] {
        for gain in [0.5, 1.3] {
            for normalise in [false, true] {
                let scene =
                    tube(&format!("form = \"{form}\"\ngain = {gain}\nnormalise = {normalise}\nwarp = {{}}"));
                let Pattern::Perlin(noise) = &scene.tubes()[0].layers[0].pattern else { panic!("perlin") };
                let bound = if normalise { 1.04 } else { 1.04 * (1.0 + gain * (1.0 + gain * (1.0 + gain))) };
                for i in 0..4000 {
                    let cells = (i % 2 == 0).then(|| random.within(0.0, 2.0));
                    let p = [0; 3].map(|_| random.within(-50.0, 50.0));
                    let value = reference::fbm(noise, p, cells);
                    let least = if form == "fbm" { -bound } else { 0.0 };
                    assert!(least <= value && value <= bound, "{form}, {gain}: {value} of {bound}");
                }
            }
        }
    }
}

/// However coarse the voxels, a layer's mean stays: fading takes detail and not brightness.
#[test]
fn fading_leaves_the_mean() {
    for form in ["billow", "ridged"] {
        for space in ["cylinder", "world"] {
            let scene = scene(&format!(
                "[bake]\nantialias = \"off\"\n[[tube]]\ncurve = {{ points = [[0,0,0],[0,0,4],[0,0,8]] }}\nradius = 4.0\ncaps = \"flat\"\n\
                 envelope = {{ radial = \"hard\" }}\n[[tube.layer]]\nop = \"multiply\"\nform = \"{form}\"\nspace = \"{space}\"\n\
                 frequency = 12.0\noctaves = 3\nnormalise = true\n"
            ));
            let field = Field::compile(&scene);
            let mean = |h: f64| {
                let found = baked_at(&field, Lattice { voxel_size: h });
                found.iter().map(|(_, bits)| f64::from(f32::from_bits(*bits))).sum::<f64>()
                    / found.len() as f64
            };
            let expected = if form == "billow" { Form::Billow.mean() } else { Form::Ridged.mean() };
            // From nothing left of the noise to some octaves: 800 voxels of spread 0.3 or more of them.
            for (h, tolerance) in [(0.8, 1e-6), (0.2, 0.004), (0.1, 0.004)] {
                let found = mean(h);
                assert!(
                    (found - expected).abs() < tolerance,
                    "{form}, {space} at {h}: {found}, not {expected}"
                );
            }
        }
    }
}

/// On a lattice that repeats, any place and the same place any number of periods on are one, to the bit; and all agree with
/// the reference, which wraps whole numbers of 64 bits.
#[test]
fn loops_repeat_exactly_at_any_place() {
    let places: Vec<[f32; 3]> = places(16 * 200)
        .into_iter()
        // Multiples of 2^-10: with whole cells before them, exact.
        .map(|p| p.map(|x| (x / 16.0 * 1024.0).floor() / 1024.0))
        .collect();
    for period in [1.0, 2.0, 3.0, 7.0, 64.0, 1000.0, 4_194_303.0, 4_194_304.0] {
        let mut first: Option<Vec<f32>> = None;
        for turns in [0.0, 1.0, -1.0, 5.0, -1e6, 1e8] {
            let origin = [0.25, 0.5, 0.125 + period * turns];
            let octave = Octave::turned(origin, UNIT, Some(period), Form::Fbm, 3, 1.0);
            let found = lanes(&[octave], &places);
            for (p, value) in places.iter().zip(&found) {
                // Whole turns aside, so that sums are exact.
                let at = [0.25, 0.5, 0.125].iter().zip(p).map(|(o, p)| o + f64::from(*p));
                let at: Vec<f64> = at.collect();
                let at = [at[0], at[1], at[2]];
                #[allow(clippy::cast_possible_truncation, reason = "whole numbers below 2^53")]
                let cell = [0.0, 0.0, period * turns].map(|x| x as i64);
                #[allow(clippy::cast_possible_truncation, reason = "whole numbers below 2^53")]
                let cell = [0, 1, 2].map(|axis| cell[axis] + at[axis].floor() as i64);
                let truth = reference::perlin_around(cell, at.map(|x| x - x.floor()), 3, Some(period));
                assert!(
                    (f64::from(*value) - truth).abs() < 1e-6,
                    "{value}, not {truth}, at {at:?} of {period}"
                );
            }
            let first = first.get_or_insert_with(|| found.clone());
            assert!(first.iter().zip(&found).all(|(a, b)| a.to_bits() == b.to_bits()), "{period}, {turns}");
        }
    }
}

/// Two straight tubes of different size, place and direction with equal layers hold the same density where their
/// cylinders do; with different seeds they have nothing in common.
#[test]
fn seeds_are_patterns() {
    let pair = |seeds: [u32; 2], lines: &str| {
        let mut text = String::new();
        for (points, seed) in
            [("[[0,0,0],[0,0,1],[0,0,2]]", seeds[0]), ("[[9,0,0],[9,3,0],[9,6,0]]", seeds[1])]
        {
            let radius = if points.starts_with("[[0") { 0.5 } else { 1.5 };
            write!(
                text,
                "[[tube]]\ncurve = {{ points = {points} }}\nradius = {radius}\ncaps = \"flat\"\nenvelope = {{ radial = \"hard\" }}\n\
                 [[tube.layer]]\nop = \"multiply\"\nfrequency = 20.0\nseed = {seed}\n[[tube.layer]]\nop = \"add\"\nnoise = \"constant\"\nvalue = 3\n"
            )
            .expect("a string takes all");
            text = text.replace("octaves = 0", lines);
        }
        let reference = Reference::new(&scene(&text), None);
        let points: Vec<[f64; 3]> = {
            let mut random = Random(43);
            (0..4000)
                .map(|_| [random.within(-0.6, 0.6), random.within(-0.6, 0.6), random.within(0.05, 0.95)])
                .collect()
        };
        let values = |tube: usize| -> Vec<f64> {
            points
                .par_iter()
                .map(|&[u, v, l]| {
                    // The frame at the start, by the coordinates that the reference gives.
                    let [o, r, length, along] =
                        if tube == 0 { [0.0, 0.5, 2.0, 2.0] } else { [9.0, 1.5, 6.0, 1.0] };
                    let place = |a: f64, b: f64| {
                        let mut p = [o + r * a, r * b, r * b];
                        p[if along == 2.0 { 2 } else { 1 }] = l * length;
                        p
                    };
                    let found = reference.cylinder(tube, place(1.0, 0.0));
                    let other = reference.cylinder(tube, place(0.0, 1.0));
                    // Of the two directions across, their (u, v); then the one with the (u, v) asked for.
                    let (a, b) = ((found[0].u, found[0].v), (other[0].u, other[0].v));
                    reference.density(place(u * a.0 + v * a.1, u * b.0 + v * b.1)) - 3.0
                })
                .collect()
        };
        (values(0), values(1))
    };
    let (a, b) = pair([7, 7], "");
    for (a, b) in a.iter().zip(&b) {
        // Coordinates to 1e-15, slopes to 3.75 * 20 an octave.
        assert!((a - b).abs() < 1e-11, "{a} and {b}");
    }
    let (a, b) = pair([7, 8], "");
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let correlation = dot(&a, &b) / (dot(&a, &a) * dot(&b, &b)).sqrt();
    // Four standard errors of 4000 values, most in cells of their own.
    assert!(correlation.abs() < 4.0 / 4000_f64.sqrt(), "{correlation}");
}

#[test]
fn what_is_left_out_is_said() {
    let mut scene = scene(
        "[[tube]]\ncurve = { points = [[0,0,0],[0,0,1],[0,0,2]] }\n[[tube.layer]]\noctaves = 30\nwarp = { octaves = 25 }\n\
         [[tube.layer]]\nspace = \"world\"\noctaves = 12\n",
    );
    let said = |scene: &Scene| Field::compile(scene).left_out(Lattice { voxel_size: 0.01 }, false).join("\n");
    let text = said(&scene);
    for line in [
        // Octave k has 2 2^k cells across a radius of 0.2: few enough up to k = 21, and 0.1 2^k in a voxel.
        "8 octaves of layer 1: without amplitude, or finer than 2^22 cells",
        "17 octaves of layer 1: above 1.6 cells a voxel everywhere",
        "3 octaves of the warp of layer 1: without amplitude, or finer than 2^22 cells",
        "17 octaves of the warp of layer 1: above 1.6 cells a voxel everywhere",
        // In the world octave k has 0.03 2^k in a voxel.
        "6 octaves of layer 2: above 1.6 cells a voxel everywhere",
    ] {
        assert!(text.contains(line), "{line} in\n{text}");
    }
    assert!(!text.contains("color") && !text.contains("temperature"));
    scene = self::scene(
        "[[tube]]\ncurve = { points = [[0,0,0],[0,0,1],[0,0,2]] }\ncolor = [1, 0.5, 0.1]\ntemperature = [[0, 300], [1, 2000]]\n",
    );
    let text = said(&scene);
    assert!(text.contains("color: a bake of density does not use it"), "{text}");
    assert!(text.contains("temperature: a bake of density does not use it"), "{text}");
}
