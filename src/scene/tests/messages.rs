//! Messages word for word.

use crate::scene::Scene;

/// The messages for `text`, which must be faulty.
fn messages(text: &str) -> String {
    Scene::parse(text, "scene.toml").expect_err("the text is faulty").to_string()
}

#[test]
fn unknown_key_is_likened_to_a_known_one() {
    let text = r#"[[tube]]
radus = 0.1
curve = { points = [[0, 0, 0], [0, 0, 1], [0, 1, 2]] }
"#;
    let expected = r#"
error: unknown key `radus` in [[tube]]
 --> scene.toml:2:1
  |
2 | radus = 0.1
  | ^^^^^ did you mean `radius`?"#;
    assert_eq!(messages(text), expected.trim_start());
}

#[test]
fn unknown_key_of_another_table_is_sent_there() {
    let text = r#"[[tube]]
curve = { points = [[0, 0, 0], [0, 0, 1], [0, 1, 2]] }
[[tube.layer]]
noise = "perlin"
radius = 0.2
[time]
resolution = 64
"#;
    let expected = r#"
error: unknown key `radius` in [[tube.layer]]
 --> scene.toml:5:1
  |
5 | radius = 0.2
  | ^^^^^^ a key of [[tube]], rest
  |
  = help: keys below a [[tube.layer]] line belong to that layer: put the tube's own above it

error: unknown key `resolution` in [time]
 --> scene.toml:7:1
  |
7 | resolution = 64
  | ^^^^^^^^^^ a key of [bake]"#;
    assert_eq!(messages(text), expected.trim_start());
}

#[test]
fn unknown_key_like_no_other_lists_the_known_ones() {
    let text = r#"[time]
shutter = 0.5
"#;
    let expected = r#"
error: unknown key `shutter` in [time]
 --> scene.toml:2:1
  |
2 | shutter = 0.5
  | ^^^^^^^ expected one of fps, start, end"#;
    assert_eq!(messages(text), expected.trim_start());
}

#[test]
fn number_in_quotes() {
    let text = r#"[[tube]]
curve = { points = [[0, 0, 0], [0, 0, 1], [0, 1, 2]] }
radius = "0.1"
"#;
    let expected = r#"
error: wrong type for `radius`
 --> scene.toml:3:10
  |
3 | radius = "0.1"
  |          ^^^^^ expected a number above 0, or keys [[l, radius], ...], found a string
  |
  = help: remove the quotes"#;
    assert_eq!(messages(text), expected.trim_start());
}

#[test]
fn wrong_number_of_points() {
    let text = r#"[[tube]]
curve = { kind = "cubic", points = [[0, 0, 0], [0, 0, 1], [0, 1, 2], [1, 1, 1], [2, 2, 2]] }
"#;
    let expected = r#"
error: wrong number of points for a cubic curve
 --> scene.toml:2:36
  |
2 | curve = { kind = "cubic", points = [[0, 0, 0], [0, 0, 1], [0, 1, 2], [1, 1, 1], [2, 2, 2]] }
  |                                    ^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^ expected 4 or 7, found 5
  |
  = help: a cubic chain of n segments has 3 n + 1 points: each starts where the last ended"#;
    assert_eq!(messages(text), expected.trim_start());
}

#[test]
fn segment_without_length() {
    let text = r#"[[tube]]
curve = { points = [[0, 0, 0], [0, 0, 1], [0, 1, 2], [0, 1, 2], [0, 1, 2]] }
"#;
    let expected = r#"
error: a segment without length
 --> scene.toml:2:43
  |
2 | curve = { points = [[0, 0, 0], [0, 0, 1], [0, 1, 2], [0, 1, 2], [0, 1, 2]] }
  |                                           ^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^ expected points that do not all coincide"#;
    assert_eq!(messages(text), expected.trim_start());
}

#[test]
fn tube_without_a_curve() {
    let text = r#"[[tube]]
name = "funnel"
"#;
    let expected = r#"
error: a tube without a `curve`
 --> scene.toml:1:1
  |
1 | [[tube]]
  | ^^^^^^^^ expected a key such as: curve = { kind = "quadratic", points = [...] }"#;
    assert_eq!(messages(text), expected.trim_start());
}

#[test]
fn single_table_for_tubes() {
    let text = r#"[tube]
curve = { points = [[0, 0, 0], [0, 0, 1], [0, 1, 2]] }
"#;
    let expected = r#"
error: `tube` is given as a single table
 --> scene.toml:1:1
  |
1 | [tube]
  | ^^^^^^ expected [[tube]], which may be repeated"#;
    assert_eq!(messages(text), expected.trim_start());
}

#[test]
fn key_of_another_noise() {
    let text = r#"[[tube]]
curve = { points = [[0, 0, 0], [0, 0, 1], [0, 1, 2]] }
[[tube.layer]]
noise = "sectors"
octaves = 3
"#;
    let expected = r#"
error: key `octaves` does not belong to noise "sectors"
 --> scene.toml:5:1
  |
5 | octaves = 3
  | ^^^^^^^ only to "perlin""#;
    assert_eq!(messages(text), expected.trim_start());
}

#[test]
fn words_of_later_versions() {
    let text = r#"[[tube]]
curve = { points = [[0, 0, 0], [0, 0, 1], [0, 1, 2]] }

[[tube.layer]]
noise = "worley"
"#;
    let expected = r#"
error: `noise` "worley" is not in this version
 --> scene.toml:5:9
  |
5 | noise = "worley"
  |         ^^^^^^^^ this version has "perlin", "constant" and "sectors""#;
    assert_eq!(messages(text), expected.trim_start());
}

#[test]
fn faded_end_against_round_caps() {
    let text = r#"[[tube]]
curve = { points = [[0, 0, 0], [0, 0, 1], [0, 1, 2]] }
caps = "round"
spin = 1
envelope = { axial = 0.2 }
"#;
    let expected = r#"
error: `envelope.axial` contradicts `caps`
 --> scene.toml:5:22
  |
5 | envelope = { axial = 0.2 }
  |                      ^^^ only faded ends take it
  |
 ::: scene.toml:3:8
  |
3 | caps = "round"
  |        ------- these do not fade"#;
    assert_eq!(messages(text), expected.trim_start());
}

#[test]
fn resolution_against_voxel_size() {
    let text = r#"[bake]
resolution = 128
voxel_size = 0.01
"#;
    let expected = r#"
error: `resolution` and `voxel_size` contradict each other
 --> scene.toml:3:1
  |
3 | voxel_size = 0.01
  | ^^^^^^^^^^ give one of the two
  |
 ::: scene.toml:2:1
  |
2 | resolution = 128
  | ---------- `resolution` is given here"#;
    assert_eq!(messages(text), expected.trim_start());
}

#[test]
fn grids_of_later_versions_and_doubled() {
    let text = r#"[bake]
grids = ["density", "velocity", "density"]
"#;
    let expected = r#"
error: `grids` "velocity" is not in this version
 --> scene.toml:2:21
  |
2 | grids = ["density", "velocity", "density"]
  |                     ^^^^^^^^^^ this version bakes density only

error: `grids` names "density" twice
 --> scene.toml:2:33
  |
2 | grids = ["density", "velocity", "density"]
  |          ---------              ^^^^^^^^^
  |          |
  |          it is already named here"#;
    assert_eq!(messages(text), expected.trim_start());
}

#[test]
fn numbers_out_of_range() {
    let text = r#"[medium]
extinction = -1
albedo = 1.5
anisotropy = nan
[camera]
fov = 1e400
"#;
    let expected = r#"
error: `extinction` is out of range
 --> scene.toml:2:14
  |
2 | extinction = -1
  |              ^^ expected a number, at least 0 (and at most 1e9)

error: `albedo` is out of range
 --> scene.toml:3:10
  |
3 | albedo = 1.5
  |          ^^^ expected a number from 0 to 1

error: `anisotropy` is not finite
 --> scene.toml:4:14
  |
4 | anisotropy = nan
  |              ^^^ expected a number from -0.999 to 0.999

error: `fov` is not finite
 --> scene.toml:6:7
  |
6 | fov = 1e400
  |       ^^^^^ expected degrees above 0 and below 180 (0.001 to 179.999)"#;
    assert_eq!(messages(text), expected.trim_start());
}

#[test]
fn radius_keys_that_are_no_keys() {
    let text = r#"[[tube]]
curve = { points = [[0, 0, 0], [0, 0, 1], [0, 1, 2]] }
radius = [0.1, [0.2], [2, -1]]
[[tube]]
radius = [[0.5, 1], [0.2, 2]]
curve = { points = [[0, 0, 0], [0, 0, 1], [0, 1, 2]] }
"#;
    let expected = r#"
error: wrong type for `radius`
 --> scene.toml:3:11
  |
3 | radius = [0.1, [0.2], [2, -1]]
  |           ^^^ expected a key [l, radius], found a decimal number

error: wrong length for a key of `radius`
 --> scene.toml:3:16
  |
3 | radius = [0.1, [0.2], [2, -1]]
  |                ^^^^^ expected a key [l, radius], found 1

error: `radius` is out of range
 --> scene.toml:3:24
  |
3 | radius = [0.1, [0.2], [2, -1]]
  |                        ^ expected l from 0 to 1

error: `radius` is out of range
 --> scene.toml:3:27
  |
3 | radius = [0.1, [0.2], [2, -1]]
  |                           ^^ expected a number, at least 0 (and at most 1e9)

error: misplaced key of `radius`
 --> scene.toml:5:21
  |
5 | radius = [[0.5, 1], [0.2, 2]]
  |                     ^^^^^^^^ expected an l not below that of the key before"#;
    assert_eq!(messages(text), expected.trim_start());
}

#[test]
fn two_tubes_of_one_name() {
    let text = r#"[[tube]]
name = "arm"
curve = { points = [[0, 0, 0], [0, 0, 1], [0, 1, 2]] }
[[tube]]
name = "arm"
curve = { points = [[0, 0, 0], [0, 0, 1], [0, 1, 2]] }
"#;
    let expected = r#"
error: two tubes have the same name
 --> scene.toml:5:8
  |
5 | name = "arm"
  |        ^^^^^ expected a name of its own
  |
 ::: scene.toml:2:8
  |
2 | name = "arm"
  |        ----- the first is here"#;
    assert_eq!(messages(text), expected.trim_start());
}

#[test]
fn array_that_is_not_closed_over_several_lines() {
    let text = r#"[[tube]]
[tube.curve]
points = [
  [0, 0, 0],  # base ]
  [0, 0, 1],
kind = "cubic"
[medium]
albedo = 3
"#;
    let expected = r#"
error: this array is not closed
 --> scene.toml:3:10
  |
3 | points = [
  |          ^ expected a `]` after its last element
  |
 ::: scene.toml:6:1
  |
6 | kind = "cubic"
  | ---- this does not fit into it"#;
    assert_eq!(messages(text), expected.trim_start());
}

#[test]
fn layers_beyond_measure() {
    let text = r#"[[tube]]
curve = { points = [[0, 0, 0], [0, 0, 1], [0, 1, 2]] }
[[tube.layer]]
gain = 100
octaves = 32
lacunarity = 1000
"#;
    let expected = r#"
error: the density can grow too large
 --> scene.toml:3:1
  |
3 | [[tube.layer]]
  | ^^^^^^^^^^^^^^ up to this layer it can reach 1e62; expected at most 1e30

error: the finest octave is finer than numbers can tell
 --> scene.toml:6:14
  |
6 | lacunarity = 1000
  |              ^^^^ it has 3e93 cells per unit; expected at most 1e18"#;
    assert_eq!(messages(text), expected.trim_start());
}

#[test]
fn name_that_is_a_path() {
    let text = r#"name = "../tornado"
"#;
    let expected = r#"
error: `name` cannot name a file
 --> scene.toml:1:8
  |
1 | name = "../tornado"
  |        ^^^^^^^^^^^^ expected up to 100 characters without / \ : * ? " < > | and not only dots or spaces"#;
    assert_eq!(messages(text), expected.trim_start());
}

#[test]
fn camera_and_light_without_direction() {
    let text = r#"[camera]
position = [0, 0, 1]
look_at = [0, 0, 1]
[[light]]
kind = "moon"
direction = [0, 0, 0]
irradiance = [1, 2]
"#;
    let expected = r#"
error: the camera looks at the point where it is
 --> scene.toml:3:11
  |
3 | look_at = [0, 0, 1]
  |           ^^^^^^^^^ expected another point
  |
 ::: scene.toml:2:12
  |
2 | position = [0, 0, 1]
  |            --------- it is here

error: unknown `kind` "moon"
 --> scene.toml:5:8
  |
5 | kind = "moon"
  |        ^^^^^^ expected one of "sun", "point", "ambient"

error: `direction` has no length
 --> scene.toml:6:13
  |
6 | direction = [0, 0, 0]
  |             ^^^^^^^^^ expected a vector other than 0

error: wrong length for `irradiance`
 --> scene.toml:7:14
  |
7 | irradiance = [1, 2]
  |              ^^^^^^ expected a number, or three numbers, found 2"#;
    assert_eq!(messages(text), expected.trim_start());
}

#[test]
fn syntax_errors_and_others_at_once() {
    let text = r#"name = tornado
[bake]
resolution = 1 2
cutoff = -1
[time]
fps = "fast"
fps = 25
"#;
    let expected = r#"
error: a word without quotes
 --> scene.toml:1:8
  |
1 | name = tornado
  |        ^^^^^^^ expected `true`, `false`, or a string in quotes

error: several numbers as one value
 --> scene.toml:3:14
  |
3 | resolution = 1 2
  |              ^^^ expected a `,` between them

error: `cutoff` is out of range
 --> scene.toml:4:10
  |
4 | cutoff = -1
  |          ^^ expected a number, at least 0 (and at most 1e9)

error: wrong type for `fps`
 --> scene.toml:6:7
  |
6 | fps = "fast"
  |       ^^^^^^ expected a number above 0, found a string

error: `fps` is given twice
 --> scene.toml:7:1
  |
7 | fps = 25
  | ^^^"#;
    assert_eq!(messages(text), expected.trim_start());
}

#[test]
fn broken_header_hides_what_is_under_it() {
    let text = r#"[bake
resolution = "high"
[time]
fps = 0
"#;
    let expected = r#"
error: unclosed table
 --> scene.toml:1:6
  |
1 | [bake
  |      ^ expected `]`

error: `fps` is out of range
 --> scene.toml:4:7
  |
4 | fps = 0
  |       ^ expected a number above 0 (1e-9 to 1e9)"#;
    assert_eq!(messages(text), expected.trim_start());
}

#[test]
fn array_that_is_not_closed() {
    let text = r#"[bake]
cutoff = -1
[[tube]]
curve = { points = [[0, 0, 0], [0, 0, 1], [0, 1, 2] }
radius = "wide"
[medium]
albedo = 3
"#;
    let expected = r#"
error: `cutoff` is out of range
 --> scene.toml:2:10
  |
2 | cutoff = -1
  |          ^^ expected a number, at least 0 (and at most 1e9)

error: this array is not closed
 --> scene.toml:4:20
  |
4 | curve = { points = [[0, 0, 0], [0, 0, 1], [0, 1, 2] }
  |                    ^ expected a `]` after its last element"#;
    assert_eq!(messages(text), expected.trim_start());
}

#[test]
fn tabs_and_other_alphabets() {
    let text = "\u{feff}name = \"Wirbel\"\t# größer, 大きい\r\n\t\"größe\" = 3\r\n[bake]\r\n\tgrids = [\"dichte\", \"大\"]\t# 2\r\n";
    let expected = r#"
error: unknown key `größe` in the top level
 --> scene.toml:2:2
  |
2 |     "größe" = 3
  |     ^^^^^^^ expected one of name, bake, time, overlap, tube, medium, camera, light

error: unknown `grids` "dichte"
 --> scene.toml:4:11
  |
4 |     grids = ["dichte", "大"]    # 2
  |              ^^^^^^^^ expected "density"

error: unknown `grids` "大"
 --> scene.toml:4:21
  |
4 |     grids = ["dichte", "大"]    # 2
  |                        ^^^^ expected "density""#;
    assert_eq!(messages(text), expected.trim_start());
}

#[test]
fn anti_aliasing_is_a_word() {
    let text = r#"[bake]
antialias = "adaptiv"
"#;
    let expected = r#"
error: unknown `antialias` "adaptiv"
 --> scene.toml:2:13
  |
2 | antialias = "adaptiv"
  |             ^^^^^^^^^ did you mean "adaptive"?"#;
    assert_eq!(messages(text), expected.trim_start());
    let text = r#"[bake]
antialias = true
"#;
    let expected = r#"
error: wrong type for `antialias`
 --> scene.toml:2:13
  |
2 | antialias = true
  |             ^^^^ expected one of "off", "adaptive", found `true`"#;
    assert_eq!(messages(text), expected.trim_start());
    let text = r#"[bake]
anti_alias = "off"
antialias = "always"
"#;
    let expected = r#"
error: unknown key `anti_alias` in [bake]
 --> scene.toml:2:1
  |
2 | anti_alias = "off"
  | ^^^^^^^^^^ did you mean `antialias`?

error: unknown `antialias` "always"
 --> scene.toml:3:13
  |
3 | antialias = "always"
  |             ^^^^^^^^ expected one of "off", "adaptive""#;
    assert_eq!(messages(text), expected.trim_start());
}

#[test]
fn keys_of_other_cameras_and_lights() {
    let text = r#"[camera]
kind = "orthographic"
fov = 40
up = [0, 0, 0]
[[light]]
kind = "ambient"
irradiance = 2
[[light]]
kind = "point"
"#;
    let expected = r#"
error: `fov` means nothing to this camera
 --> scene.toml:3:7
  |
3 | fov = 40
  |       ^^ only a perspective one has it

error: `up` has no length
 --> scene.toml:4:6
  |
4 | up = [0, 0, 0]
  |      ^^^^^^^^^ expected a vector other than 0

error: `irradiance` means nothing to this light
 --> scene.toml:7:14
  |
7 | irradiance = 2
  |              ^ only `kind = "sun"` has it

error: a point light needs a `position`
 --> scene.toml:8:1
  |
8 | [[light]]
  | ^^^^^^^^^ expected `position = [x, y, z]`"#;
    assert_eq!(messages(text), expected.trim_start());
}

#[test]
fn more_lamps_than_pictures_take() {
    let lamps = "[[light]]\n[[light]]\nkind = \"ambient\"\n".repeat(8);
    Scene::parse(&lamps, "scene.toml").expect("eight suns");
    let expected = r#"
error: a scene has no more than 8 suns and points
  --> scene.toml:25:1
   |
25 | [[light]]
   | ^^^^^^^^^ this one is too many, of 9"#;
    assert_eq!(messages(&format!("{lamps}[[light]]\n")), expected.trim_start());
}
