//! Messages about the details of noise, and about colours and temperatures, word for word.

use crate::scene::Scene;

/// The messages for a tube with these further lines, from line 3 on.
fn messages(lines: &str) -> String {
    let text = format!("[[tube]]\ncurve = {{ points = [[0, 0, 0], [0, 0, 1], [0, 1, 2]] }}\n{lines}");
    Scene::parse(&text, "scene.toml").expect_err("the text is faulty").to_string()
}

#[test]
fn words_that_are_none() {
    let found = messages("[[tube.layer]]\nform = \"riged\"\nspace = \"object\"\nrotate = 1\n");
    let expected = r#"
error: unknown `form` "riged"
 --> scene.toml:4:8
  |
4 | form = "riged"
  |        ^^^^^^^ did you mean "ridged"?

error: unknown `space` "object"
 --> scene.toml:5:9
  |
5 | space = "object"
  |         ^^^^^^^^ expected one of "cylinder", "world"

error: wrong type for `rotate`
 --> scene.toml:6:10
  |
6 | rotate = 1
  |          ^ expected true or false, found a whole number"#;
    assert_eq!(found, expected.trim_start());
}

#[test]
fn details_of_what_has_none() {
    let found = messages("[[tube.layer]]\nnoise = \"sectors\"\nspace = \"world\"\noffset = [0, 0, 1]\n");
    let expected = r#"
error: key `space` does not belong to noise "sectors"
 --> scene.toml:5:1
  |
5 | space = "world"
  | ^^^^^ only to "perlin"

error: key `offset` does not belong to noise "sectors"
 --> scene.toml:6:1
  |
6 | offset = [0, 0, 1]
  | ^^^^^^ only to "perlin""#;
    assert_eq!(found, expected.trim_start());
}

#[test]
fn warps_out_of_bounds() {
    let found = messages(
        "[[tube.layer]]\nwarp = { amplitude = 2000, octaves = 0, lacunarity = 1e9, sead = 1 }\n\
         [[tube.layer]]\nwarp = 0.5\n[[tube.layer]]\nwarp = { lacunarity = 1e9, octaves = 3 }\n",
    );
    let expected = r#"
error: `amplitude` is out of range
 --> scene.toml:4:22
  |
4 | warp = { amplitude = 2000, octaves = 0, lacunarity = 1e9, sead = 1 }
  |                      ^^^^ expected a number of cells from 0 to 1000

error: `octaves` is out of range
 --> scene.toml:4:38
  |
4 | warp = { amplitude = 2000, octaves = 0, lacunarity = 1e9, sead = 1 }
  |                                      ^ expected a whole number from 1 to 32

error: unknown key `sead` in warp
 --> scene.toml:4:59
  |
4 | warp = { amplitude = 2000, octaves = 0, lacunarity = 1e9, sead = 1 }
  |                                                           ^^^^ did you mean `seed`?

error: wrong type for `warp`
 --> scene.toml:6:8
  |
6 | warp = 0.5
  |        ^^^ expected a table, found a decimal number

error: the finest octave is finer than numbers can tell
 --> scene.toml:8:23
  |
8 | warp = { lacunarity = 1e9, octaves = 3 }
  |                       ^^^ it has 3e18 cells per unit; expected at most 1e18"#;
    assert_eq!(found, expected.trim_start());
}

#[test]
fn colours_and_temperatures_that_are_none() {
    let found = messages(
        "color = [[0.5, 1, 1, 1], [0, 1, 1, 1], [1, 1, 1]]\ntemperature = -1\n\
         [[tube]]\ncurve = { points = [[0, 0, 0], [0, 0, 1], [0, 1, 2]] }\ncolor = [[0.5, 1, 1, 1], [0, 1, -1, 1]]\ntemperature = []\n\
         [[tube]]\ncurve = { points = [[0, 0, 0], [0, 0, 1], [0, 1, 2]] }\ncolor = \"red\"\n\
         temperature = [[0, 300], [0.5, 1], [0.5, 2], [0.5, 3]]\n\
         [[tube]]\ncurve = { points = [[0, 0, 0], [0, 0, 1], [0, 1, 2]] }\ncolor = [1, 2]\ntemperature = [[0.5, 300], [0.2, 1]]\n",
    );
    let expected = r#"
error: wrong length for a key of `color`
 --> scene.toml:3:40
  |
3 | color = [[0.5, 1, 1, 1], [0, 1, 1, 1], [1, 1, 1]]
  |                                        ^^^^^^^^^ expected a key [l, r, g, b], found 3

error: `temperature` is out of range
 --> scene.toml:4:15
  |
4 | temperature = -1
  |               ^^ expected kelvin, at least 0 (and at most 1e9)

error: `color` is out of range
 --> scene.toml:7:33
  |
7 | color = [[0.5, 1, 1, 1], [0, 1, -1, 1]]
  |                                 ^^ expected a number, at least 0 (and at most 1e9)

error: `temperature` has no keys
 --> scene.toml:8:15
  |
8 | temperature = []
  |               ^^ expected a temperature in kelvin, or keys [[l, kelvin], ...]

error: wrong type for `color`
  --> scene.toml:11:9
   |
11 | color = "red"
   |         ^^^^^ expected a colour [r, g, b], or keys [[l, r, g, b], ...], found a string

error: misplaced key of `temperature`
  --> scene.toml:12:46
   |
12 | temperature = [[0, 300], [0.5, 1], [0.5, 2], [0.5, 3]]
   |                                              ^^^^^^^^ expected at most two keys at one l

error: wrong length for `color`
  --> scene.toml:15:9
   |
15 | color = [1, 2]
   |         ^^^^^^ expected a colour [r, g, b], or keys [[l, r, g, b], ...], found 2

error: misplaced key of `temperature`
  --> scene.toml:16:28
   |
16 | temperature = [[0.5, 300], [0.2, 1]]
   |                            ^^^^^^^^ expected an l not below that of the key before"#;
    assert_eq!(found, expected.trim_start());
}
