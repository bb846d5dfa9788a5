//! Curves and radii: what they mean, and the messages of those that do not fit.

use std::io;

use glam::DVec3;

use crate::curve::{Curve, FrameRule, Profile, b_spline, catmull_rom};
use crate::scene::{Caps, Scene, SceneErrors};

/// Files by their names.
fn load(text: &str) -> Result<Scene, SceneErrors> {
    Scene::load(text, "scene.toml", &|path| match path {
        "arm.csv" => Ok(b"x,y,z\n0,0,0\n1,0,0\n1,1,0\n\n0,1,0 # the last\n".to_vec()),
        "bad.csv" => Ok(b"0,0,0\n1,0,zero\n".to_vec()),
        "twice.csv" => Ok(b"# made by hand\n0,0,0\n1,0,0\n1,0,0\n".to_vec()),
        "empty.csv" => Ok(vec![]),
        "nothing.csv" => Ok(b"0,0\n1,0\n".to_vec()),
        "radius.csv" => Ok(b"l,radius\n0,0.1\n0.25,0.3\n0.5,0.1\n0.75,0.3\n1,0.1\n".to_vec()),
        "back.csv" => Ok(b"0,0.1\n0.5,0.2\n0.4,0.2\n".to_vec()),
        _ => Err(io::Error::new(io::ErrorKind::NotFound, "no such file")),
    })
}

/// The scene of one tube with these lines.
fn tube(lines: &str) -> Scene {
    load(&format!("[[tube]]\n{lines}\n")).unwrap_or_else(|errors| panic!("{errors}"))
}

/// The messages for a tube of these lines, which must be faulty.
fn messages(lines: &str) -> String {
    load(&format!("[[tube]]\n{lines}\n")).expect_err("the text is faulty").to_string()
}

fn assert_messages(lines: &str, expected: &str) {
    assert_eq!(messages(lines), expected.trim_start());
}

fn curve(lines: &str) -> Curve {
    tube(&format!("curve = {{ {lines} }}")).tubes()[0].curve.clone()
}

const SQUARE: &str = "points = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]";

fn square() -> [DVec3; 4] {
    [DVec3::ZERO, DVec3::X, DVec3::X + DVec3::Y, DVec3::Y]
}

#[test]
fn splines_are_those_of_the_curve_module() {
    let points = square();
    for (alpha, text) in [(0.5, ""), (0.0, ", alpha = 0"), (1.0, ", alpha = 1.0")] {
        let found = curve(&format!("kind = 'catmull-rom', {SQUARE}{text}"));
        assert_eq!(found.segments(), catmull_rom(&points, alpha, false).unwrap());
    }
    assert_eq!(curve(&format!("kind = 'b-spline', {SQUARE}")).segments(), b_spline(&points, false).unwrap());
    assert_eq!(curve("kind = 'b-spline', points = [[0, 0, 0], [0, 0, 1]]").length(), 1.0);
}

#[test]
fn closed_curves_return_to_their_first_point() {
    let points = square();
    for kind in ["catmull-rom", "b-spline"] {
        let found = curve(&format!("kind = '{kind}', closed = true, {SQUARE}"));
        assert!(found.is_closed());
        assert_eq!(found.segments().len(), 4);
        // The first point may be repeated.
        let again = format!("{}, [0, 0, 0]]", SQUARE.strip_suffix(']').unwrap());
        assert_eq!(curve(&format!("kind = '{kind}', closed = true, {again}")).segments(), found.segments());
    }
    let whole = catmull_rom(&points, 0.5, true).unwrap();
    assert_eq!(curve(&format!("kind = 'catmull-rom', closed = true, {SQUARE}")).segments(), whole);
    // Two parabolas, of 2 n points and of 2 n + 1.
    let two = curve(&format!("closed = true, {SQUARE}"));
    assert_eq!(two.segments().len(), 2);
    assert_eq!(two.segments()[1].at(1.0), points[0]);
    let again = format!("{}, [0, 0, 0]]", SQUARE.strip_suffix(']').unwrap());
    assert_eq!(curve(&format!("closed = true, {again}")).segments(), two.segments());
    let loop_of_three = curve("kind = 'cubic', closed = true, points = [[0, 0, 0], [1, 0, 0], [0, 1, 0]]");
    assert_eq!(loop_of_three.segments().len(), 1);
    assert!(!curve(&format!("closed = false, kind = 'b-spline', {SQUARE}")).is_closed());
    assert_eq!(tube(&format!("curve = {{ closed = true, {SQUARE} }}")).tubes()[0].caps, Caps::Flat);
}

#[test]
fn points_are_scaled_about_a_point() {
    let plain = curve(&format!("kind = 'b-spline', {SQUARE}"));
    let half = curve(&format!("kind = 'b-spline', scale = 0.5, about = [1, 1, 0], {SQUARE}"));
    assert!((half.length() - 0.5 * plain.length()).abs() < 1e-15);
    assert_eq!(half.segments()[0].at(0.0), DVec3::new(0.5, 0.5, 0.0));
    let same = curve(&format!("kind = 'b-spline', scale = 1, about = [0.1, 0.7, 0.3], {SQUARE}"));
    assert_eq!(same.segments(), plain.segments());
    assert_messages(
        &format!("curve = {{ kind = 'b-spline', about = [0, 0, 1], {SQUARE} }}"),
        r#"
error: `about` without `scale`
 --> scene.toml:2:38
  |
2 | curve = { kind = 'b-spline', about = [0, 0, 1], points = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]] }
  |                                      ^^^^^^^^^ nothing is scaled about it: give `scale` too"#,
    );
    assert_messages(
        "curve = { scale = 1e6, points = [[0, 0, 0], [1, 0, 0], [0, 1e4, 0]] }",
        r#"
error: `scale` leads out of range
 --> scene.toml:2:19
  |
2 | curve = { scale = 1e6, points = [[0, 0, 0], [1, 0, 0], [0, 1e4, 0]] }
  |                   ^^^ expected points with every coordinate a number from -1e9 to 1e9"#,
    );
}

#[test]
fn points_come_from_files() {
    let scene = tube("curve = { kind = 'catmull-rom', closed = true, file = 'arm.csv' }");
    assert_eq!(scene.tubes()[0].curve.segments(), catmull_rom(&square(), 0.5, true).unwrap());
    let [input] = scene.inputs() else { panic!("one file") };
    assert_eq!(input.path, "arm.csv");
    // sha256sum of the same bytes.
    assert_eq!(input.sha256[..4], [0xd7, 0x63, 0x03, 0x86]);
    let twice = load(
        "[[tube]]\ncurve = { kind = 'b-spline', file = 'arm.csv' }\nradius = { file = 'radius.csv' }\n\
         [[tube]]\ncurve = { kind = 'b-spline', file = 'arm.csv' }",
    );
    let paths: Vec<_> = twice.unwrap().inputs().iter().map(|input| input.path.clone()).collect();
    assert_eq!(paths, ["arm.csv", "radius.csv"]);
    let unread = Scene::parse("[[tube]]\ncurve = { file = 'arm.csv' }", "scene.toml").unwrap_err();
    assert!(unread.to_string().contains("this text is read without its files"), "{unread}");
}

#[test]
fn files_that_do_not_fit() {
    assert_messages(
        "curve = { file = \"none.csv\" }",
        r#"
error: unreadable `file`
 --> scene.toml:2:18
  |
2 | curve = { file = "none.csv" }
  |                  ^^^^^^^^^^ no such file"#,
    );
    assert_messages(
        "curve = { file = \"bad.csv\" }",
        r#"
error: malformed `file`
 --> scene.toml:2:18
  |
2 | curve = { file = "bad.csv" }
  |                  ^^^^^^^^^ bad.csv, line 2, column 5: expected a number, found "zero""#,
    );
    assert_messages(
        "curve = { kind = \"b-spline\", file = \"twice.csv\" }",
        r#"
error: two points of a b-spline curve in one place
 --> scene.toml:2:37
  |
2 | curve = { kind = "b-spline", file = "twice.csv" }
  |                                     ^^^^^^^^^^^ twice.csv, line 4: point 3 lies on the one before it"#,
    );
    assert_messages(
        "curve = { file = \"arm.csv\" }",
        r#"
error: wrong number of points for a quadratic curve
 --> scene.toml:2:18
  |
2 | curve = { file = "arm.csv" }
  |                  ^^^^^^^^^ expected 3 or 5, found 4 in arm.csv
  |
  = help: a quadratic chain of n segments has 2 n + 1 points: each starts where the last ended"#,
    );
    assert_messages(
        "curve = { file = \"arm.csv\", points = [[0, 0, 0]] }",
        r#"
error: `points` and `file` contradict each other
 --> scene.toml:2:18
  |
2 | curve = { file = "arm.csv", points = [[0, 0, 0]] }
  |                  ^^^^^^^^^           ----------- `points` is given here
  |                  |
  |                  give one of the two"#,
    );
    assert_messages(
        "curve = { kind = \"b-spline\", file = \"arm.csv\" }\nradius = { file = \"back.csv\" }",
        r#"
error: misplaced key of `radius`
 --> scene.toml:3:19
  |
3 | radius = { file = "back.csv" }
  |                   ^^^^^^^^^^ back.csv, line 3: expected an l not below that of the key before"#,
    );
    assert_messages(
        "curve = { kind = \"b-spline\", file = \"empty.csv\" }\nradius = { file = \"empty.csv\" }",
        r#"
error: wrong number of points for a b-spline curve
 --> scene.toml:2:37
  |
2 | curve = { kind = "b-spline", file = "empty.csv" }
  |                                     ^^^^^^^^^^^ expected at least 2, found 0 in empty.csv

error: `radius` has no keys
 --> scene.toml:3:19
  |
3 | radius = { file = "empty.csv" }
  |                   ^^^^^^^^^^^ expected keys, l,radius a line, found none in empty.csv"#,
    );
    let nothing = messages(&format!("curve = {{ {SQUARE} }}\nradius = {{ file = \"nothing.csv\" }}"));
    assert!(nothing.ends_with("^^^^^^^^^^^^^ expected a radius above 0 in nothing.csv"), "{nothing}");
    assert!(messages("curve = { file = \"\" }").contains("expected a path"));
}

#[test]
fn points_that_make_no_spline_and_no_closed_curve() {
    assert_messages(
        "curve = { kind = \"catmull-rom\", points = [[0, 0, 0], [0, 0, 1], [0, 0, 1], [0, 1, 1]] }",
        r#"
error: two points of a catmull-rom curve in one place
 --> scene.toml:2:65
  |
2 | curve = { kind = "catmull-rom", points = [[0, 0, 0], [0, 0, 1], [0, 0, 1], [0, 1, 1]] }
  |                                                                 ^^^^^^^^^ point 3 lies on the one before it"#,
    );
    assert_messages(
        "curve = { kind = \"catmull-rom\", closed = true, points = [[0, 0, 0], [0, 0, 1]] }",
        r#"
error: wrong number of points for a closed catmull-rom curve
 --> scene.toml:2:57
  |
2 | curve = { kind = "catmull-rom", closed = true, points = [[0, 0, 0], [0, 0, 1]] }
  |                                                         ^^^^^^^^^^^^^^^^^^^^^^ expected at least 3, found 2"#,
    );
    assert_messages(
        "curve = { kind = \"b-spline\", closed = true, points = [[0, 0, 0], [0, 0, 1], [0, 0, 0]] }",
        r#"
error: wrong number of points for a closed b-spline curve
 --> scene.toml:2:54
  |
2 | curve = { kind = "b-spline", closed = true, points = [[0, 0, 0], [0, 0, 1], [0, 0, 0]] }
  |                                                      ^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^ expected at least 3, found 2
  |
  = help: the last point is the first again, which counts once: leave it out"#,
    );
    assert_messages(
        "curve = { closed = true, points = [[0, 0, 0], [0, 0, 1], [0, 0.25, 0]] }",
        r#"
error: a gap in a closed curve
 --> scene.toml:2:58
  |
2 | curve = { closed = true, points = [[0, 0, 0], [0, 0, 1], [0, 0.25, 0]] }
  |                                                          ^^^^^^^^^^^^ the last point is 2.500e-1 m away from the first
  |
  = help: a closed curve ends in its first point: repeat that, or leave the last point off"#,
    );
    assert_messages(
        "curve = { kind = \"cubic\", closed = true, points = [[0, 0, 0], [0, 0, 1], [0, 1, 1], [1, 1, 1], [2, 2, 2]] }",
        r#"
error: wrong number of points for a cubic curve
 --> scene.toml:2:51
  |
2 | curve = { kind = "cubic", closed = true, points = [[0, 0, 0], [0, 0, 1], [0, 1, 1], [1, 1, 1], [2, 2, 2]] }
  |                                                   ^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^ expected 4 or 6, found 5
  |
  = help: a closed cubic chain of n segments has 3 n points, the first of which closes it, or 3 n + 1"#,
    );
    assert_messages(
        "curve = { kind = \"cubic\", alpha = 0.5, points = [[0, 0, 0], [0, 0, 1], [0, 1, 1], [1, 1, 1]] }",
        r#"
error: key `alpha` does not belong to a cubic curve
 --> scene.toml:2:27
  |
2 | curve = { kind = "cubic", alpha = 0.5, points = [[0, 0, 0], [0, 0, 1], [0, 1, 1], [1, 1, 1]] }
  |                           ^^^^^ only to a catmull-rom one"#,
    );
}

#[test]
fn closed_curves_have_no_ends() {
    assert_messages(
        "curve = { closed = true, points = [[0, 0, 0], [0, 0, 1], [0, 1, 1], [0, 1, 0]] }\ncaps = \"round\"\n\
         envelope = { axial = 0.2 }",
        r#"
error: `caps` contradicts `closed`
 --> scene.toml:3:8
  |
3 | caps = "round"
  |        ^^^^^^^ a closed curve has no ends: leave this off
  |
 ::: scene.toml:2:20
  |
2 | curve = { closed = true, points = [[0, 0, 0], [0, 0, 1], [0, 1, 1], [0, 1, 0]] }
  |                    ---- the curve is closed here

error: `envelope.axial` contradicts `closed`
 --> scene.toml:4:22
  |
4 | envelope = { axial = 0.2 }
  |                      ^^^ a closed curve has no ends: leave this off
  |
 ::: scene.toml:2:20
  |
2 | curve = { closed = true, points = [[0, 0, 0], [0, 0, 1], [0, 1, 1], [0, 1, 0]] }
  |                    ---- the curve is closed here"#,
    );
}

#[test]
fn named_radii_have_their_formulas() {
    let of = |radius: &str| {
        let scene = tube(&format!("curve = {{ {SQUARE}, kind = 'b-spline' }}\nradius = {radius}"));
        scene.tubes()[0].radius.clone()
    };
    let waves = "{ kind = 'sinusoidal', mean = 0.2, amplitude = 0.08, waves = 6, phase = 0.25 }";
    assert_eq!(of(waves), Profile::sinusoidal(0.2, 0.08, 6.0, 0.25).unwrap());
    let default = Profile::sinusoidal(0.2, 0.1, 4.0, 0.0).unwrap();
    assert_eq!(of("{ kind = 'sinusoidal', mean = 0.2 }"), default);
    let growth = "{ kind = 'growing', from = 0.02, to = 0.5, power = 2 }";
    assert_eq!(of(growth), Profile::growing(0.02, 0.5, 2.0).unwrap());
    assert_eq!(of("{ kind = 'growing', to = 0.5 }"), Profile::growing(0.0, 0.5, 1.0).unwrap());
    let keys = [(0.0, 0.1), (0.25, 0.3), (0.5, 0.1), (0.75, 0.3), (1.0, 0.1)];
    assert_eq!(of("{ file = 'radius.csv' }"), Profile::keyed(&keys).unwrap());
    let scene = tube(&format!("curve = {{ {SQUARE}, closed = true }}\nradius = {{ file = 'radius.csv' }}"));
    assert_eq!(scene.tubes()[0].radius, Profile::keyed_closed(&keys).unwrap());
    // Without every second key it is 0.1 everywhere.
    assert!((scene.tubes()[0].sampling_error.unwrap() - 0.2).abs() < 1e-15);
}

#[test]
fn radii_that_do_not_fit() {
    let curve = "curve = { kind = \"b-spline\", points = [[0, 0, 0], [0, 0, 1]] }\n";
    let assert_radius = |radius: &str, expected: &str| {
        assert_messages(&format!("{curve}radius = {radius}"), expected);
    };
    assert_radius(
        "{ kind = \"sinusoidal\", mean = 0.1, amplitude = 0.2 }",
        r#"
error: `amplitude` is larger than `mean`
 --> scene.toml:3:57
  |
3 | radius = { kind = "sinusoidal", mean = 0.1, amplitude = 0.2 }
  |                                                         ^^^ expected at most 0.1, so that no radius is below 0"#,
    );
    assert_radius(
        "{ kind = \"sinusoidal\", mean = 0.1, waves = 1001 }",
        r#"
error: `waves` is out of range
 --> scene.toml:3:53
  |
3 | radius = { kind = "sinusoidal", mean = 0.1, waves = 1001 }
  |                                                     ^^^^ expected a number from 0 to 1000"#,
    );
    assert_radius(
        "{ kind = \"growing\", to = 0.1, waves = 2 }",
        r#"
error: key `waves` does not belong to a growing radius
 --> scene.toml:3:40
  |
3 | radius = { kind = "growing", to = 0.1, waves = 2 }
  |                                        ^^^^^ only to kind "sinusoidal""#,
    );
    assert_radius(
        "{ kind = \"growing\" }",
        r#"
error: a `radius` without `to`
 --> scene.toml:3:10
  |
3 | radius = { kind = "growing" }
  |          ^^^^^^^^^^^^^^^^^^^^ expected such as: radius = { kind = "growing", to = 0.5 }"#,
    );
    assert_radius(
        "{ mean = 0.1 }",
        r#"
error: a `radius` without `kind` or `file`
 --> scene.toml:3:10
  |
3 | radius = { mean = 0.1 }
  |          ^^^^^^^^^^^^^^ expected a number above 0, or keys [[l, radius], ...], or a key `kind`: one of "sinusoidal", "growing""#,
    );
    assert_radius(
        "{ kind = \"waves\", mean = 0.1 }",
        r#"
error: unknown `kind` "waves"
 --> scene.toml:3:19
  |
3 | radius = { kind = "waves", mean = 0.1 }
  |                   ^^^^^^^ expected one of "sinusoidal", "growing""#,
    );
    assert_radius(
        "{ kind = \"growing\", from = 0, to = 0 }",
        r#"
error: `radius` is 0 everywhere
 --> scene.toml:3:10
  |
3 | radius = { kind = "growing", from = 0, to = 0 }
  |          ^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^ expected `from` or `to` above 0"#,
    );
    assert_radius(
        "{ kind = \"growing\", to = 1, file = \"radius.csv\" }",
        r#"
error: `file` contradicts `kind`
 --> scene.toml:3:45
  |
3 | radius = { kind = "growing", to = 1, file = "radius.csv" }
  |                   ---------                 ^^^^^^^^^^^^ give one of the two
  |                   |
  |                   the kind is given here"#,
    );
}

#[test]
fn seams_of_closed_curves_are_warned_of() {
    let warnings = |lines: &str| {
        tube(&format!("curve = {{ kind = 'b-spline', closed = true, {SQUARE} }}\n{lines}"))
            .warnings()
            .to_string()
    };
    let expected = r#"
warning: a seam where the curve closes
 --> scene.toml:3:9
  |
3 | twist = 1.5
  |         ^^^ after 1.5 turns the layers do not meet themselves; whole numbers of turns close
  |
 ::: scene.toml:2:39
  |
2 | curve = { kind = 'b-spline', closed = true, points = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]] }
  |                                       ---- the curve is closed here"#;
    assert_eq!(warnings("twist = 1.5\n[[tube.layer]]"), expected.trim_start());
    // Where nothing shows it, nothing is said.
    for lines in [
        "",
        "twist = 1.5",
        "twist = 2\n[[tube.layer]]",
        "twist = 1.5\n[[tube.layer]]\nnoise = 'sectors'",
        "radius = [[0.2, 0.1], [0.8, 0.3]]",
        "radius = [[0, 0.1], [0.8, 0.3], [1, 0.1]]",
        "radius = { kind = 'sinusoidal', mean = 0.1, waves = 3, phase = 0.2 }",
        "frame = 'frenet'\n[[tube.layer]]",
    ] {
        assert_eq!(warnings(lines), "", "{lines}");
    }
    for (lines, part) in [
        ("twist = 0.75\n[[tube.layer]]\nnoise = 'sectors'", "whole numbers of half turns close"),
        ("radius = [[0, 0.1], [1, 0.3]]", "the radius is +2.000e-1 m off where it comes round"),
        ("radius = { kind = 'sinusoidal', mean = 0.1, waves = 2.25 }", "the radius is +5.000e-2 m off"),
        ("radius = { kind = 'growing', to = 0.1 }", "the radius is +1.000e-1 m off"),
    ] {
        let found = warnings(lines);
        assert!(found.contains(part), "{found}");
    }
    // Sides of a quadrilateral in space: no principal normal anywhere, and the frame arrives turned.
    let bent = "curve = { closed = true, points = [[0,0,0],[1,0,0],[2,0,0],[2,1,0],[2,2,0],[1,2.5,1],[0,3,2],[0,1.5,1]] }\n\
                frame = 'frenet'\n[[tube.layer]]";
    let scene = tube(bent);
    assert!(scene.tubes()[0].frame == FrameRule::Frenet && scene.warnings().list().len() == 1);
    assert!(scene.warnings().to_string().contains("the Frenet frame arrives turned by"));
    assert!(tube(&bent.replace("frenet", "rotation-minimising")).warnings().is_empty());
}
