//! What valid texts mean.

use crate::curve::{FrameRule, Profile};
use crate::scene::keys::{CURVE, ENVELOPE, LAYER, ORBIT, RADIUS, REST, ROOT, SECTIONS, TRACK, WARP};
use crate::scene::{
    Antialias, Camera, Caps, Conserve, Fbm, Form, Light, Op, Overlap, Pattern, Radial, Scene, Space, Step,
    TimeBase, Warp,
};

const SKETCH: &str = r#"
name = "tornado"

[bake]                                  # what the command line may override
resolution = 256                        # or voxel_size = 0.01
grids = ["density"]
antialias = "adaptive"                  # off, adaptive

[time]                                  # frame `start` is t = 0
fps = 24
start = 1
end = 240                               # the last frame, where there is one

[[tube]]
name = "funnel"
curve = { kind = "quadratic", points = [[0, 0, 0], [0.3, 0.1, 1.2], [0, 0, 2.5]] }   # chains: 2n+1 points; cubic 3n+1
radius = [[0.0, 0.10], [1.0, 0.60]]     # keys over l in [0, 1]; or one number; or a named profile
twist = 3.0                             # turns from end to end
spin = 0.2                              # turns a second
stretch = true                          # l = s/L; false: l = s
frame = "rotation-minimising"           # or "frenet"
caps = "fade"                           # flat, round, fade
conserve = "off"                        # off, radius, full
overlap = "max"                         # max, sum, closest, blend
envelope = { radial = "smooth", axial = 0.1 }
color = [[0, 1.0, 0.9, 0.8], [1, 0.4, 0.4, 0.5]]   # or [r, g, b]
temperature = 300                       # kelvin; or keys [[l, kelvin], ...]

[[tube.layer]]                          # combined in order
op = "multiply"                         # add, multiply, max, min
noise = "perlin"                        # constant, sectors, worley, ...
frequency = [2.0, 2.0, 3.0]             # cells per unit of (u, v, l)
octaves = 5
lacunarity = 2.0
gain = 0.5
threshold = 0.1                         # max(0, n - threshold) * multiplier
multiplier = 1.6
scroll = [0.0, 0.0, -0.3]               # cells a second
form = "ridged"                         # fbm, ridged, billow
rotate = true
warp = { amplitude = 0.25, frequency = 1.5, octaves = 2, lacunarity = 2.0, gain = 0.5, seed = 0 }
space = "world"                         # or "cylinder"
offset = [0.5, 0.0, 0.0]

[medium]
extinction = 12.0                       # per metre, times density
albedo = 0.9
anisotropy = 0.2

[camera]                                # all optional: framed to the bounds
[[light]]
kind = "sun"
direction = [-1.0, -0.3, -0.5]
"#;

fn scene(text: &str) -> Scene {
    Scene::parse(text, "scene.toml").expect("the text is valid")
}

/// A scene of one tube with a curve of length 2 and these further lines.
fn tube(lines: &str) -> Scene {
    scene(&format!("[[tube]]\ncurve = {{ points = [[0, 0, 0], [0, 0, 1], [0, 0, 2]] }}\n{lines}\n"))
}

#[test]
fn sketch_of_every_key() {
    let scene = scene(SKETCH);
    assert_eq!(scene.name(), "tornado");
    assert_eq!(scene.bake().step, Step::Resolution(256));
    assert_eq!(scene.time(), TimeBase { fps: 24.0, start: 1, end: Some(240) });
    assert_eq!(scene.text(), SKETCH);
    let [tube] = scene.tubes() else { panic!("one tube") };
    assert_eq!(tube.name, "funnel");
    assert_eq!(tube.curve.segments().len(), 1);
    assert_eq!(tube.radius, Profile::keyed(&[(0.0, 0.1), (1.0, 0.6)]).unwrap());
    assert_eq!((tube.twist, tube.spin, tube.stretch), (3.0, 0.2, true));
    assert_eq!(
        (tube.frame, tube.caps, tube.radial),
        (FrameRule::RotationMinimising, Caps::Fade(0.1), Radial::Smooth)
    );
    let [layer] = tube.layers.as_slice() else { panic!("one layer") };
    assert_eq!((layer.op, layer.threshold, layer.multiplier), (Op::Multiply, Some(0.1), 1.6));
    let fbm = Fbm {
        frequency: [2.0, 2.0, 3.0],
        octaves: 5,
        lacunarity: 2.0,
        gain: 0.5,
        normalise: false,
        seed: 0,
        scrolled: [0.0; 3],
        form: Form::Ridged,
        rotate: true,
        warp: Some(Warp {
            amplitude: 0.25,
            frequency: [1.5; 3],
            octaves: 2,
            lacunarity: 2.0,
            gain: 0.5,
            seed: 0,
        }),
        space: Space::World,
        offset: [0.5, 0.0, 0.0],
    };
    assert_eq!(tube.color.as_ref().map(|color| color.keys().len()), Some(2));
    assert_eq!(tube.temperature.as_ref().map(|kelvin| kelvin.at(0.5)), Some(300.0));
    assert_eq!(layer.pattern, Pattern::Perlin(fbm));
    assert_eq!(
        (scene.medium().extinction, scene.medium().albedo, scene.medium().anisotropy),
        (12.0, [0.9; 3], 0.2)
    );
    assert_eq!(scene.camera(), Camera::default());
    let [Light::Sun { direction, irradiance }] = scene.lights() else { panic!("one light") };
    // The length of (-1, -0.3, -0.5) is the root of 1.34; its quotients are good to an ulp or two.
    for (found, given) in direction.iter().zip([-1.0, -0.3, -0.5]) {
        assert!((found - given / 1.34_f64.sqrt()).abs() < 1e-15);
    }
    assert_eq!(*irradiance, [1.0; 3]);
}

#[test]
fn empty_text_is_an_empty_scene_named_after_its_file() {
    let name = |origin| Scene::parse("", origin).unwrap().name().to_owned();
    assert_eq!(name("shots/a b.v2.toml"), "a b.v2");
    assert_eq!(name("-"), "-");
    assert_eq!(name(""), "scene");
    assert_eq!(name(".."), "scene");
    let scene = scene("");
    assert!(scene.tubes().is_empty());
    assert!(matches!(scene.lights(), [Light::Sun { .. }, Light::Ambient { .. }]));
    assert_eq!(scene.bake().step, Step::Resolution(256));
    assert_eq!((scene.bake().cutoff, scene.bake().octave_fade), (0.0, true));
    assert_eq!(scene.time(), TimeBase { fps: 24.0, start: 1, end: None });
}

#[test]
fn words_for_overlap_and_conservation() {
    for (word, rule) in [
        ("max", Overlap::Max),
        ("sum", Overlap::Sum),
        ("closest", Overlap::Closest),
        ("blend", Overlap::Blend),
    ] {
        assert_eq!(scene(&format!("overlap = \"{word}\"")).overlap(), rule);
        assert_eq!(tube(&format!("overlap = \"{word}\"")).tubes()[0].overlap, rule);
    }
    for (word, conserve) in [("off", Conserve::Off), ("radius", Conserve::Radius), ("full", Conserve::Full)] {
        assert_eq!(tube(&format!("conserve = \"{word}\"")).tubes()[0].conserve, conserve);
    }
    assert!(!scene("[bake]\nwiden = false").bake().widen && scene("[bake]").bake().widen);
    for (text, antialias) in [
        ("", Antialias::Adaptive),
        ("[bake]", Antialias::Adaptive),
        ("[bake]\nantialias = \"adaptive\"", Antialias::Adaptive),
        ("[bake]\nantialias = \"off\"", Antialias::Off),
    ] {
        assert_eq!(scene(text).bake().antialias, antialias, "{text}");
    }
}

#[test]
fn the_rest_cylinder_is_as_large_as_the_tube_unless_told() {
    // The mean square of a cone from 0 to 3 is 3.
    let rest = tube("radius = [[0, 0], [1, 3]]").tubes()[0].rest;
    assert!((rest.radius - 3.0_f64.sqrt()).abs() < 1e-15 && rest.length == 2.0);
    let rest = tube("rest = { radius = 0.5 }").tubes()[0].rest;
    assert_eq!((rest.radius, rest.length), (0.5, 2.0));
}

#[test]
fn tube_of_only_a_curve() {
    let scene = tube("");
    let tube = &scene.tubes()[0];
    assert_eq!(tube.name, "tube 1");
    assert!((tube.radius.at(0.5) - 0.2).abs() < 1e-12, "a tenth of the length, whose own error is 1e-12");
    assert_eq!((tube.twist, tube.spin, tube.stretch), (0.0, 0.0, true));
    assert_eq!(
        (tube.frame, tube.caps, tube.radial),
        (FrameRule::RotationMinimising, Caps::Fade(0.1), Radial::Smooth)
    );
    assert!(tube.layers.is_empty());
}

#[test]
fn layer_without_keys() {
    let scene = tube("[[tube.layer]]");
    let layer = &scene.tubes()[0].layers[0];
    let Pattern::Perlin(fbm) = &layer.pattern else { panic!("perlin") };
    assert_eq!((layer.op, layer.threshold, layer.multiplier), (Op::Multiply, None, 1.0));
    assert_eq!((fbm.frequency, fbm.octaves, fbm.lacunarity, fbm.gain), ([2.0, 2.0, 3.0], 5, 2.0, 0.5));
    assert_eq!((fbm.normalise, fbm.seed, fbm.scrolled), (false, 0, [0.0; 3]));
}

#[test]
fn envelopes_and_caps() {
    let ends = |lines| (tube(lines).tubes()[0].caps, tube(lines).tubes()[0].radial);
    assert_eq!(ends("caps = 'flat'\nenvelope.radial = 'hard'"), (Caps::Flat, Radial::Hard));
    assert_eq!(ends("caps = 'round'\nenvelope.radial = 'linear'"), (Caps::Round, Radial::Linear));
    assert_eq!(ends("envelope = { radial = 1, axial = 0.5 }"), (Caps::Fade(0.5), Radial::Edge(1.0)));
    assert_eq!(ends("caps = 'fade'\nenvelope = { radial = 0.25 }"), (Caps::Fade(0.1), Radial::Edge(0.25)));
}

#[test]
fn patterns_and_numbers_for_vectors() {
    let scene = tube(
        "[[tube.layer]]\nnoise = 'constant'\nvalue = 0x10\nop = 'add'\n[[tube.layer]]\nnoise = 'sectors'\nop = 'max'\n\
         [[tube.layer]]\nfrequency = 1_0\nop = 'min'\n[[light]]\nirradiance = 3",
    );
    let layers = &scene.tubes()[0].layers;
    assert_eq!((layers[0].op, &layers[0].pattern), (Op::Add, &Pattern::Constant(16.0)));
    assert_eq!((layers[1].op, &layers[1].pattern), (Op::Max, &Pattern::Sectors));
    assert!(matches!(&layers[2].pattern, Pattern::Perlin(fbm) if fbm.frequency == [10.0; 3]));
    assert!(matches!(scene.lights(), [Light::Sun { irradiance: [3.0, 3.0, 3.0], .. }]));
}

#[test]
fn details_of_noise() {
    let scene = tube(
        "[[tube.layer]]\nfrequency = 4\nseed = 7\nform = 'ridged'\nrotate = true\nspace = 'world'\noffset = [1, 2, 3]\n\
         warp = { amplitude = 0.25, frequency = [1, 2, 3], octaves = 4, lacunarity = 3, gain = 0.1, seed = 9 }\n\
         [[tube.layer]]\nfrequency = 4\nseed = 7\nform = 'billow'\n[tube.layer.warp]",
    );
    let fbm = |i: usize| match &scene.tubes()[0].layers[i].pattern {
        Pattern::Perlin(fbm) => fbm.clone(),
        _ => panic!("perlin"),
    };
    let (first, second) = (fbm(0), fbm(1));
    assert_eq!(
        (first.form, first.rotate, first.space, first.offset),
        (Form::Ridged, true, Space::World, [1.0, 2.0, 3.0])
    );
    let warp =
        Warp { amplitude: 0.25, frequency: [1.0, 2.0, 3.0], octaves: 4, lacunarity: 3.0, gain: 0.1, seed: 9 };
    assert_eq!(first.warp, Some(warp));
    assert_eq!((second.form, second.rotate, second.space), (Form::Billow, false, Space::Cylinder));
    // What it does not say is the layer's.
    let warp = Warp { amplitude: 0.5, frequency: [4.0; 3], octaves: 2, lacunarity: 2.0, gain: 0.5, seed: 7 };
    assert_eq!(second.warp, Some(warp));
}

#[test]
fn colours_and_temperatures() {
    let of = |lines: &str| tube(lines).tubes()[0].clone();
    let plain = of("color = [1, 0.5, 0]\ntemperature = 900");
    assert_eq!(plain.color.map(|color| color.at(0.3).to_array()), Some([1.0, 0.5, 0.0]));
    assert_eq!(plain.temperature.map(|kelvin| kelvin.at(0.3)), Some(900.0));
    let keyed = of("color = [[0, 1, 0, 2], [1, 0, 4, 2]]\ntemperature = [[0.5, 300], [0.5, 700], [1, 500]]");
    assert_eq!(keyed.color.map(|color| color.at(0.25).to_array()), Some([0.75, 1.0, 2.0]));
    let kelvin = keyed.temperature.expect("given");
    assert_eq!([0.0, 0.4, 0.5, 0.75, 1.0].map(|l| kelvin.at(l)), [300.0, 300.0, 700.0, 600.0, 500.0]);
    let without = of("");
    assert!(without.color.is_none() && without.temperature.is_none());
}

#[test]
fn unnamed_tubes_pass_over_names_that_are_taken() {
    let curve = "curve = { points = [[0, 0, 0], [0, 0, 1], [0, 0, 2]] }\n";
    let text =
        format!("[[tube]]\n{curve}[[tube]]\n{curve}[[tube]]\nname = 'tube 2'\n{curve}[[tube]]\n{curve}");
    let scene = scene(&text);
    let names: Vec<_> = scene.tubes().iter().map(|tube| tube.name.as_str()).collect();
    assert_eq!(names, ["tube 1", "tube 3", "tube 2", "tube 4"]);
}

#[test]
fn marks_and_line_ends_of_other_systems_change_nothing() {
    let plain = format!("{:?}", scene(SKETCH)).replace("\\n", "");
    let windows = format!("\u{feff}{}", SKETCH.replace('\n', "\r\n"));
    let windows = format!("{:?}", scene(&windows)).replace("\\r\\n", "").replace("\\u{feff}", "");
    assert_eq!(plain, windows);
}

/// A key that is listed but never read would be ignored in silence.
#[test]
fn every_listed_key_is_read() {
    for section in SECTIONS {
        for key in section.keys {
            let wrong = format!("{key} = 1979-05-27\n");
            let inline = wrong.trim_end();
            let text = match section.name {
                name if name == ROOT.name => wrong,
                name if name == TRACK.name => format!("[[tube]]\ntwist = {{ {inline} }}\n"),
                name if name == ORBIT.name => format!("[[tube]]\ncurve = {{ points = [{{ {inline} }}] }}\n"),
                name if [&CURVE, &RADIUS, &ENVELOPE, &REST].iter().any(|section| section.name == name) => {
                    format!("[[tube]]\n[tube.{name}]\n{wrong}")
                }
                name if name == LAYER.name => format!("[[tube]]\n{name}\n{wrong}"),
                name if name == WARP.name => {
                    format!("[[tube]]\n[[tube.layer]]\n[tube.layer.{name}]\n{wrong}")
                }
                name => format!("{name}\n{wrong}"),
            };
            let errors = Scene::parse(&text, "scene.toml").expect_err("a date is no value of any key");
            let expected = format!("wrong type for `{key}`");
            assert!(
                errors.faults().iter().any(|fault| fault.message().starts_with(&expected)),
                "{text}\n{errors}"
            );
        }
    }
}

#[test]
fn shipped_scenes_are_valid_and_smooth() {
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes");
    let mut count = 0;
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.extension().is_none_or(|extension| extension != "toml") {
            continue;
        }
        let text = std::fs::read_to_string(&path).unwrap();
        let load = |file: &str| std::fs::read(path.with_file_name(file));
        let scene = Scene::load(&text, &path.to_string_lossy(), &load);
        let scene = scene.unwrap_or_else(|errors| panic!("{errors}"));
        assert_eq!(Some(scene.name()), path.file_stem().and_then(|stem| stem.to_str()));
        for tube in scene.tubes() {
            for joint in 0..tube.curve.segments().len() {
                // Joints are written in decimals, so tangents agree to rounding; splines have theirs from differences.
                let turn = tube.curve.turn(joint);
                assert!(turn < 1e-11, "{} has a corner of {turn} in {}", path.display(), tube.name);
            }
        }
        count += 1;
    }
    assert_eq!(count, 13);
}

#[test]
fn directions_may_be_of_any_length() {
    for length in ["1e-300", "1e-308", "1e9"] {
        let text = format!("[[light]]\ndirection = [0, 0, {length}]\n");
        let scene = Scene::parse(&text, "scene.toml").expect("valid");
        let [Light::Sun { direction, .. }] = scene.lights() else { panic!("no sun") };
        assert_eq!(direction, &[0.0, 0.0, 1.0]);
    }
}
