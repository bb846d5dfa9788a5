//! Scenes at other times than their start.

use glam::DVec3;

use crate::scene::{Caps, Pattern, Radial, Scene, SceneErrors, Tube};

/// The scene of `text` at a time.
fn at(text: &str, seconds: f64) -> Scene {
    Scene::parse_at(text, "scene.toml", seconds).unwrap_or_else(|errors| panic!("{errors}"))
}

/// A tube with a curve of length 2 and these further lines, at a time.
fn tube(lines: &str, seconds: f64) -> Tube {
    let text = format!("[[tube]]\ncurve = {{ points = [[0, 0, 0], [0, 0, 1], [0, 0, 2]] }}\n{lines}\n");
    at(&text, seconds).tubes()[0].clone()
}

fn points(text: &str, seconds: f64) -> [DVec3; 3] {
    let scene = at(text, seconds);
    let segment = &scene.tubes()[0].curve.segments()[0];
    let [a, b, _] = [segment.at(0.0), segment.d1(0.0), DVec3::ZERO];
    [a, a + b / 2.0, segment.at(1.0)]
}

fn errors(text: &str, seconds: f64) -> SceneErrors {
    Scene::parse_at(text, "scene.toml", seconds).expect_err("the text is faulty")
}

fn messages(text: &str, seconds: f64) -> String {
    errors(text, seconds).to_string()
}

#[test]
fn every_kind_of_number_of_a_tube_moves() {
    let ramp =
        |from: f64, to: f64| format!("{{ keys = [[0, {from}], [2, {to}]], interpolation = 'linear' }}");
    let lines = format!(
        "radius = [[0, {}], [{}, 0.2], [1, 0.1]]\ntwist = {}\nrest = {{ radius = {}, length = {} }}\n\
         envelope = {{ radial = {}, axial = {} }}\n[[tube.layer]]\nfrequency = {}\nlacunarity = {}\ngain = {}\n\
         threshold = {}\nmultiplier = {}\n[[tube.layer]]\nfrequency = [1, {}, 3]\n[[tube.layer]]\nnoise = 'constant'\n\
         value = {}",
        ramp(0.1, 0.3),
        ramp(0.4, 0.6),
        ramp(0.0, -4.0),
        ramp(1.0, 3.0),
        ramp(2.0, 1.0),
        ramp(0.2, 0.4),
        ramp(0.1, 0.2),
        ramp(1.0, 3.0),
        ramp(2.0, 3.0),
        ramp(0.0, 0.5),
        ramp(-1.0, 0.0),
        ramp(1.0, 0.0),
        ramp(2.0, 0.0),
        ramp(5.0, 7.0),
    );
    let tube = tube(&lines, 1.0);
    let close =
        |found: f64, expected: f64| assert!((found - expected).abs() < 1e-15, "{found}, not {expected}");
    close(tube.radius.at(0.0), 0.2);
    close(tube.radius.knots()[0], 0.5);
    close(tube.twist, -2.0);
    close(tube.rest.radius, 2.0);
    close(tube.rest.length, 1.5);
    let (Radial::Edge(edge), Caps::Fade(fade)) = (tube.radial, tube.caps) else { panic!("{tube:?}") };
    close(edge, 0.3);
    close(fade, 0.15);
    let [one, two, three] = tube.layers.as_slice() else { panic!("three layers") };
    let (Pattern::Perlin(first), Pattern::Perlin(second)) = (&one.pattern, &two.pattern) else {
        panic!("noise")
    };
    assert_eq!((first.frequency, first.lacunarity, first.gain), ([2.0; 3], 2.5, 0.25));
    assert_eq!((one.threshold, one.multiplier), (Some(-0.5), 0.5));
    assert_eq!(second.frequency, [1.0, 1.0, 3.0]);
    assert_eq!(three.pattern, Pattern::Constant(6.0));
    let whole = self::tube(&format!("radius = {}", ramp(0.1, 0.3)), 1.5);
    close(whole.radius.as_constant().expect("one radius"), 0.25);
}

#[test]
fn rates_add_up_from_time_0() {
    let steady = |seconds| {
        let tube = tube("spin = 0.2\n[[tube.layer]]\nscroll = [0, -1, 0.3]", seconds);
        let Pattern::Perlin(fbm) = &tube.layers[0].pattern else { panic!("noise") };
        (tube.spin, tube.turned, fbm.scrolled)
    };
    assert_eq!(steady(0.0), (0.2, 0.0, [0.0; 3]));
    assert_eq!(steady(-2.5), (0.2, -0.5, [0.0, 2.5, -0.75]));
    // The rate rises from 0 to 2 in 2 s, then stays: 2, then 2 more for each second.
    let moving = |seconds| {
        let tube = tube(
            "spin = { keys = [[0, 0], [2, 2]] }\n[[tube.layer]]\n\
             scroll = [0, 0, { mean = 1, amplitude = 0.5, period = 4 }]",
            seconds,
        );
        let Pattern::Perlin(fbm) = &tube.layers[0].pattern else { panic!("noise") };
        (tube.spin, tube.turned, fbm.scrolled[2])
    };
    assert_eq!(moving(0.0), (0.0, 0.0, 0.0));
    assert_eq!((moving(2.0).0, moving(2.0).1), (2.0, 2.0));
    assert_eq!((moving(5.0).0, moving(5.0).1), (2.0, 8.0));
    // Half a period of the wave: twice its amplitude, over 2 pi / 4.
    assert!((moving(2.0).2 - (2.0 + 2.0 / std::f64::consts::PI)).abs() < 1e-15);
    assert!((moving(4.0).2 - 4.0).abs() < 1e-15);
}

const ORBITS: &str = "[[tube]]
curve = { points = [
  { centre = [1, 2, 3], arm = [0.5, 0, 0], period = 8 },
  [0, { keys = [[0, 1], [4, 3]], interpolation = 'linear' }, 4],
  { centre = [0, 0, 5], arm = [0, 0, 2], period = 2, axis = [0, 1e-3, 0] },
] }
";

#[test]
fn points_move_in_circles_and_along_tracks() {
    let start = points(ORBITS, 0.0);
    assert_eq!(start, [DVec3::new(1.5, 2.0, 3.0), DVec3::new(0.0, 1.0, 4.0), DVec3::new(0.0, 0.0, 7.0)]);
    for step in -20..20 {
        let time = 0.37 * f64::from(step);
        let [a, b, c] = points(ORBITS, time);
        let (sin, cos) = libm::sincos(std::f64::consts::TAU * time / 8.0);
        // Sums of terms up to 7, rounded.
        assert!((a - DVec3::new(1.0 + 0.5 * cos, 2.0 + 0.5 * sin, 3.0)).length() < 1e-14);
        assert!((b.y - (1.0 + 0.5 * time).clamp(1.0, 3.0)).abs() < 1e-14);
        // About y, z turns towards x.
        let (sin, cos) = libm::sincos(std::f64::consts::TAU * time / 2.0);
        assert!((c - DVec3::new(2.0 * sin, 0.0, 5.0 + 2.0 * cos)).length() < 3e-14);
    }
    // What lies along the axis stays.
    let text = "[[tube]]\ncurve = { points = [[0, 0, 0], [0, 0, 1], { centre = [0, 0, 1], arm = [1, 1, 1], \
                period = 1, axis = [1, 1, 1] }] }\n";
    assert!((points(text, 0.3)[2] - DVec3::new(1.0, 1.0, 2.0)).length() < 1e-15);
}

#[test]
fn a_tube_rests_as_it_was_at_time_0() {
    let text = "[[tube]]\ncurve = { points = [[0, 0, 0], [0, 0, 1], [0, 0, { keys = [[0, 2], [1, 4]] }]] }\n\
                radius = { keys = [[0, 0.1], [1, 0.3]] }\n";
    let (start, later) = (at(text, 0.0), at(text, 1.0));
    let [start, later] = [start, later].map(|scene| scene.tubes()[0].clone());
    assert!((later.curve.length() - 4.0).abs() < 1e-12 && later.radius.max() == 0.3);
    assert_eq!(later.rest, start.rest);
    assert!((start.rest.length - 2.0).abs() < 1e-12 && (start.rest.radius - 0.1).abs() < 1e-12);
    let given = format!("{text}rest = {{ radius = 0.5 }}\n");
    let rest = at(&given, 1.0).tubes()[0].rest;
    assert_eq!((rest.radius, rest.length), (0.5, start.rest.length));
}

#[test]
fn a_scene_at_another_time_forgets_where_it_was() {
    let text = format!("{ORBITS}spin = {{ mean = 1, amplitude = 2, period = 3 }}\n");
    let start = Scene::parse(&text, "scene.toml").unwrap();
    let back = start.at(7.25).unwrap().at(0.0).unwrap();
    assert_eq!(format!("{start:?}"), format!("{back:?}"));
    assert_eq!(start.at(7.25).unwrap().seconds(), 7.25);
    assert!(start.is_moving());
    assert!(
        !Scene::parse("[[tube]]\ncurve = { points = [[0, 0, 0], [0, 0, 1], [0, 0, 2]] }\nspin = 1", "")
            .unwrap()
            .is_moving()
    );
}

#[test]
fn frames_are_counted_from_the_start() {
    let time = at("[time]\nfps = 25\nstart = -3\nend = 22", 0.0).time();
    assert_eq!((time.end, time.seconds(-3), time.seconds(22), time.seconds(-4)), (Some(22), 0.0, 1.0, -0.04));
}

#[test]
fn whole_numbers_words_and_conditions_do_not_move() {
    let text = "[[tube]]
curve = { points = [[0, 0, 0], [0, 0, 1], [0, 1, 2]] }
stretch = { keys = [[0, 1], [1, 0]] }
caps = { mean = 1, amplitude = 1, period = 1 }
[[tube.layer]]
octaves = { keys = [[0, 1], [5, 7]] }
[bake]
cutoff = { keys = [[0, 0.1], [5, 0.2]] }
";
    let expected = r#"
error: `stretch` cannot change over time
 --> scene.toml:3:11
  |
3 | stretch = { keys = [[0, 1], [1, 0]] }
  |           ^^^^^^^^^^^^^^^^^^^^^^^^^^^ expected true or false
  |
  = help: numbers of a [[tube]] can, except whole ones and those that describe a motion

error: `caps` cannot change over time
 --> scene.toml:4:8
  |
4 | caps = { mean = 1, amplitude = 1, period = 1 }
  |        ^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^ expected one of "fade", "flat", "round"
  |
  = help: numbers of a [[tube]] can, except whole ones and those that describe a motion

error: `octaves` cannot change over time
 --> scene.toml:6:11
  |
6 | octaves = { keys = [[0, 1], [5, 7]] }
  |           ^^^^^^^^^^^^^^^^^^^^^^^^^^^ expected a whole number from 0 to 32
  |
  = help: numbers of a [[tube]] can, except whole ones and those that describe a motion

error: `cutoff` cannot change over time
 --> scene.toml:8:10
  |
8 | cutoff = { keys = [[0, 0.1], [5, 0.2]] }
  |          ^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^ expected a number, at least 0
  |
  = help: numbers of a [[tube]] can, except whole ones and those that describe a motion"#;
    assert_eq!(messages(text, 0.0), expected.trim_start());
}

#[test]
fn every_key_is_within_the_limits_of_its_number() {
    let text = "[[tube]]
curve = { points = [[0, 0, 0], [0, 0, 1], [0, 1, 2]] }
radius = { keys = [[0, 0.1], [5, -0.2], [6, 'x']] }
envelope = { axial = { mean = 0.4, amplitude = -0.2, period = 2 } }
";
    let expected = r#"
error: `radius` is out of range
 --> scene.toml:3:34
  |
3 | radius = { keys = [[0, 0.1], [5, -0.2], [6, 'x']] }
  |                                  ^^^^ expected a number above 0 (1e-9 to 1e9)

error: wrong type for `radius`
 --> scene.toml:3:45
  |
3 | radius = { keys = [[0, 0.1], [5, -0.2], [6, 'x']] }
  |                                             ^^^ expected a number above 0, found a string

error: `axial` swings out of range
 --> scene.toml:4:22
  |
4 | envelope = { axial = { mean = 0.4, amplitude = -0.2, period = 2 } }
  |                      ^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^ from 0.2 to 0.6; expected a number above 0, at most 0.5"#;
    assert_eq!(messages(text, 0.0), expected.trim_start());
}

#[test]
fn a_number_over_time_is_keys_or_a_wave() {
    let text = "[[tube]]
curve = { points = [[0, 0, 0], [0, 0, 1], [0, 1, 2]] }
twist = { keys = [[0, 1], [1, 2]], amplitude = 3 }
spin = { repeat = true }
[[tube.layer]]
gain = { mean = 0.5, period = 0 }
threshold = { keys = [] }
multiplier = { keys = [[0, 1], [1, 2, 3]], interpolation = 'bumpy' }
lacunarity = { kays = [[0, 1]] }
";
    let expected = r#"
error: `amplitude` and `keys` contradict each other
 --> scene.toml:3:36
  |
3 | twist = { keys = [[0, 1], [1, 2]], amplitude = 3 }
  |           ----                     ^^^^^^^^^ a number over time is either given by keys or a wave
  |           |
  |           `keys` is given here

error: `spin` is a number over time without `keys`
 --> scene.toml:4:8
  |
4 | spin = { repeat = true }
  |        ^^^^^^^^^^^^^^^^^ expected a key such as: keys = [[0, 1], [2.5, 3]]
  |
  = help: a wave takes `mean`, `amplitude`, `period` and `phase` instead

error: `gain` is a wave without `amplitude`
 --> scene.toml:6:8
  |
6 | gain = { mean = 0.5, period = 0 }
  |        ^^^^^^^^^^^^^^^^^^^^^^^^^^ expected keys such as: mean = 1, amplitude = 0.5, period = 4

error: `period` is out of range
 --> scene.toml:6:31
  |
6 | gain = { mean = 0.5, period = 0 }
  |                               ^ expected a number above 0 (1e-9 to 1e9)

error: `keys` is empty
 --> scene.toml:7:22
  |
7 | threshold = { keys = [] }
  |                      ^^ expected keys [[seconds, value], ...]

error: wrong length for a key of `multiplier`
 --> scene.toml:8:32
  |
8 | multiplier = { keys = [[0, 1], [1, 2, 3]], interpolation = 'bumpy' }
  |                                ^^^^^^^^^ expected a key [seconds, value], found 3

error: unknown `interpolation` "bumpy"
 --> scene.toml:8:60
  |
8 | multiplier = { keys = [[0, 1], [1, 2, 3]], interpolation = 'bumpy' }
  |                                                            ^^^^^^^ expected one of "smooth", "linear", "step"

error: `lacunarity` is a number over time without `keys`
 --> scene.toml:9:14
  |
9 | lacunarity = { kays = [[0, 1]] }
  |              ^^^^^^^^^^^^^^^^^^^ expected a key such as: keys = [[0, 1], [2.5, 3]]
  |
  = help: a wave takes `mean`, `amplitude`, `period` and `phase` instead

error: unknown key `kays` in a number over time
 --> scene.toml:9:16
  |
9 | lacunarity = { kays = [[0, 1]] }
  |                ^^^^ did you mean `keys`?"#;
    assert_eq!(messages(text, 0.0), expected.trim_start());
}

#[test]
fn keys_are_in_order() {
    let text = "[[tube]]
curve = { points = [[0, 0, 0], [0, 0, 1], [0, 1, 2]] }
twist = { keys = [[1, 1], [0, 2]] }
spin = { keys = [[1, 1], [1, 2], [1, 3]] }
[[tube.layer]]
gain = { keys = [[1, 0.5], [1.0000000001, 0.6]] }
threshold = { keys = [[1, 0.5], [1, 0.6]], repeat = true }
multiplier = { keys = [[{ keys = [[0, 0]] }, 0.5]] }
";
    let expected = r#"
error: misplaced key of `twist`
 --> scene.toml:3:27
  |
3 | twist = { keys = [[1, 1], [0, 2]] }
  |                           ^^^^^^ expected a time not before that of the key before

error: misplaced key of `spin`
 --> scene.toml:4:34
  |
4 | spin = { keys = [[1, 1], [1, 2], [1, 3]] }
  |                                  ^^^^^^ expected at most two keys at one time

error: misplaced key of `gain`
 --> scene.toml:6:28
  |
6 | gain = { keys = [[1, 0.5], [1.0000000001, 0.6]] }
  |                            ^^^^^^^^^^^^^^^^^^^ expected a time 1e-9 s or more after that of the key before, or the same

error: `repeat` without a period
 --> scene.toml:7:53
  |
7 | threshold = { keys = [[1, 0.5], [1, 0.6]], repeat = true }
  |                                                     ^^^^ expected keys at two times at least

error: `keys` cannot change over time
 --> scene.toml:8:25
  |
8 | multiplier = { keys = [[{ keys = [[0, 0]] }, 0.5]] }
  |                         ^^^^^^^^^^^^^^^^^^^ expected a number
  |
  = help: numbers of a [[tube]] can, except whole ones and those that describe a motion"#;
    assert_eq!(messages(text, 0.0), expected.trim_start());
}

#[test]
fn a_moving_point_has_its_keys() {
    let text = "[[tube]]
curve = { points = [{ centre = [0, 0, 0] }, { centre = [0, 0, 1], arm = [1, 0, 0], period = 0, axis = [0, 0, 0] }, { center = 0 }] }
[[tube]]
curve = { points = [[0, 0, 0], [0, 0, 1], { centre = [1e9, 0, 0], arm = [1e9, 0, 0], period = 1 }] }
";
    let expected = r#"
error: a point that moves in a circle, without `arm`
 --> scene.toml:2:21
  |
2 | curve = { points = [{ centre = [0, 0, 0] }, { centre = [0, 0, 1], arm = [1, 0, 0], period = 0, axis = [0, 0, 0] }, { center = 0 }] }
  |                     ^^^^^^^^^^^^^^^^^^^^^^ expected keys such as: centre = [0, 0, 1], arm = [0.2, 0, 0], period = 5

error: a point that moves in a circle, without `period`
 --> scene.toml:2:21
  |
2 | curve = { points = [{ centre = [0, 0, 0] }, { centre = [0, 0, 1], arm = [1, 0, 0], period = 0, axis = [0, 0, 0] }, { center = 0 }] }
  |                     ^^^^^^^^^^^^^^^^^^^^^^ expected a key such as: period = 5

error: `period` is out of range
 --> scene.toml:2:93
  |
2 | curve = { points = [{ centre = [0, 0, 0] }, { centre = [0, 0, 1], arm = [1, 0, 0], period = 0, axis = [0, 0, 0] }, { center = 0 }] }
  |                                                                                             ^ expected a number above 0 (1e-9 to 1e9)

error: `axis` has no length
 --> scene.toml:2:103
  |
2 | curve = { points = [{ centre = [0, 0, 0] }, { centre = [0, 0, 1], arm = [1, 0, 0], period = 0, axis = [0, 0, 0] }, { center = 0 }] }
  |                                                                                                       ^^^^^^^^^ expected a vector other than 0

error: a point that moves in a circle, without `centre`
 --> scene.toml:2:116
  |
2 | curve = { points = [{ centre = [0, 0, 0] }, { centre = [0, 0, 1], arm = [1, 0, 0], period = 0, axis = [0, 0, 0] }, { center = 0 }] }
  |                                                                                                                    ^^^^^^^^^^^^^^ expected keys such as: centre = [0, 0, 1], arm = [0.2, 0, 0], period = 5

error: a point that moves in a circle, without `arm`
 --> scene.toml:2:116
  |
2 | curve = { points = [{ centre = [0, 0, 0] }, { centre = [0, 0, 1], arm = [1, 0, 0], period = 0, axis = [0, 0, 0] }, { center = 0 }] }
  |                                                                                                                    ^^^^^^^^^^^^^^ expected keys such as: centre = [0, 0, 1], arm = [0.2, 0, 0], period = 5

error: a point that moves in a circle, without `period`
 --> scene.toml:2:116
  |
2 | curve = { points = [{ centre = [0, 0, 0] }, { centre = [0, 0, 1], arm = [1, 0, 0], period = 0, axis = [0, 0, 0] }, { center = 0 }] }
  |                                                                                                                    ^^^^^^^^^^^^^^ expected a key such as: period = 5

error: unknown key `center` in a moving point
 --> scene.toml:2:118
  |
2 | curve = { points = [{ centre = [0, 0, 0] }, { centre = [0, 0, 1], arm = [1, 0, 0], period = 0, axis = [0, 0, 0] }, { center = 0 }] }
  |                                                                                                                      ^^^^^^ did you mean `centre`?

error: a point too far away
 --> scene.toml:4:43
  |
4 | curve = { points = [[0, 0, 0], [0, 0, 1], { centre = [1e9, 0, 0], arm = [1e9, 0, 0], period = 1 }] }
  |                                           ^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^ expected each coordinate from -1e9 to 1e9"#;
    assert_eq!(messages(text, 0.0), expected.trim_start());
}

#[test]
fn what_is_wrong_at_another_time_only_says_so() {
    let text = "[[tube]]
curve = { points = [[0, 0, 0], [0, 0, { keys = [[0, 1], [3.2, 0]] }], [0, 0, { keys = [[0, 2], [3.2, 0]] }]] }
radius = 0.1
";
    assert!(Scene::parse_at(text, "scene.toml", 3.1).is_ok());
    let expected = r#"
error: a segment without length
 --> scene.toml:2:21
  |
2 | curve = { points = [[0, 0, 0], [0, 0, { keys = [[0, 1], [3.2, 0]] }], [0, 0, { keys = [[0, 2], [3.2, 0]] }]] }
  |                     ^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^ expected points that do not all coincide
  |
  = help: this is 3.2 s after the start frame; nothing is wrong at 0 s"#;
    assert_eq!(messages(text, 3.2), expected.trim_start());
    // What is wrong at the start is told as if no other time had been asked for.
    let wrong = format!("{text}spun = 1\n");
    assert_eq!(messages(&wrong, 3.2), messages(&wrong, 0.0));
}

#[test]
fn the_last_frame_is_not_before_the_first() {
    let text = "[time]\nstart = 10\nend = 9\n";
    let expected = r#"
error: `end` is before `start`
 --> scene.toml:3:7
  |
3 | end = 9
  |       ^ expected frame 10 or one after it
  |
 ::: scene.toml:2:9
  |
2 | start = 10
  |         -- `start` is given here"#;
    assert_eq!(messages(text, 0.0), expected.trim_start());
    let expected = r#"
error: `end` is too late
 --> scene.toml:3:7
  |
3 | end = 100
  |       ^^^ expected a frame at most 1e9 seconds after `start`"#;
    assert_eq!(messages("[time]\nfps = 1e-9\nend = 100\n", 0.0), expected.trim_start());
    let expected = r#"
error: `end` is before `start`
 --> scene.toml:2:7
  |
2 | end = 0
  |       ^ expected frame 1 or one after it"#;
    assert_eq!(messages("[time]\nend = 0\n", 0.0), expected.trim_start());
    assert_eq!(errors("[time]\nstart = 'a'\nend = -5\n", 0.0).count(), 1);
}
