//! Scenes that no density can be made of: each is refused, and told where.

use crate::check::case::{Case, Verdict};
use crate::scene::Scene;

const GROUP: &str = "input";

/// A key of a scene, and the text around its value.
const NUMBERS: [(&str, &str, &str); 20] = [
    ("bake.voxel_size", "[bake]\nvoxel_size = ", ""),
    ("bake.cutoff", "[bake]\ncutoff = ", ""),
    ("time.fps", "[time]\nfps = ", ""),
    ("a point", "[[tube]]\ncurve = { points = [[0, 0, 0], [", ", 0, 0], [2, 0, 0]] }"),
    ("curve.scale", "[[tube]]\ncurve = { points = [[0, 0, 0], [1, 0, 0], [2, 0, 0]], scale = ", " }"),
    ("radius", "[[tube]]\ncurve = { points = [[0, 0, 0], [1, 0, 0], [2, 0, 0]] }\nradius = ", ""),
    (
        "a radius key",
        "[[tube]]\ncurve = { points = [[0, 0, 0], [1, 0, 0], [2, 0, 0]] }\nradius = [[0, 1], [1, ",
        "]]",
    ),
    ("twist", "[[tube]]\ncurve = { points = [[0, 0, 0], [1, 0, 0], [2, 0, 0]] }\ntwist = ", ""),
    ("spin", "[[tube]]\ncurve = { points = [[0, 0, 0], [1, 0, 0], [2, 0, 0]] }\nspin = ", ""),
    ("a layer's frequency", LAYER_FREQUENCY, ""),
    (
        "a layer's gain",
        "[[tube]]\ncurve = { points = [[0, 0, 0], [1, 0, 0], [2, 0, 0]] }\n[[tube.layer]]\ngain = ",
        "",
    ),
    (
        "a layer's offset",
        "[[tube]]\ncurve = { points = [[0, 0, 0], [1, 0, 0], [2, 0, 0]] }\n[[tube.layer]]\noffset = [0, 0, ",
        "]",
    ),
    ("medium.extinction", "[medium]\nextinction = ", ""),
    ("medium.albedo", "[medium]\nalbedo = ", ""),
    ("medium.anisotropy", "[medium]\nanisotropy = ", ""),
    ("camera.fov", "[camera]\nfov = ", ""),
    ("camera.position", "[camera]\nposition = [0, 0, ", "]"),
    ("a sun's direction", "[[light]]\ndirection = [0, 0, ", "]"),
    ("a sun's irradiance", "[[light]]\nirradiance = ", ""),
    ("a point's intensity", "[[light]]\nkind = \"point\"\nposition = [0, 0, 0]\nintensity = ", ""),
];

const LAYER_FREQUENCY: &str =
    "[[tube]]\ncurve = { points = [[0, 0, 0], [1, 0, 0], [2, 0, 0]] }\n[[tube.layer]]\nfrequency = ";

pub(super) fn cases() -> Vec<Case> {
    let mut cases: Vec<Case> = ["nan", "inf", "-inf", "1e300"]
        .into_iter()
        .map(|value| {
            Case::new(
                GROUP,
                format!("{value} for any of {} numbers", NUMBERS.len()),
                "refused, with line and column of each",
                move || numbers(value),
            )
        })
        .collect();
    let refused = [
        ("a sun without direction", "[[light]]\ndirection = [0, 0, 0]\n"),
        ("a field of view of 0", "[camera]\nfov = 0\n"),
        ("a field of view of 180 degrees", "[camera]\nfov = 180\n"),
        ("a camera that looks at itself", "[camera]\nposition = [1, 1, 1]\nlook_at = [1, 1, 1]\n"),
        ("a resolution of 0", "[bake]\nresolution = 0\n"),
        ("a mean cosine of 1", "[medium]\nanisotropy = 1\n"),
        ("a mean cosine of -1", "[medium]\nanisotropy = -1\n"),
        ("frames that end before they begin", "[time]\nstart = 2\nend = 1\n"),
        ("no frames a second", "[time]\nfps = 0\n"),
        ("a curve of one point", "[[tube]]\ncurve = { kind = \"catmull-rom\", points = [[0, 0, 0]] }\n"),
        (
            "a period of 0",
            "[[tube]]\ncurve = { points = [[0,0,0],[1,0,0],[2,0,0]] }\ntwist = { mean = 1, amplitude = 1, period = 0 }\n",
        ),
    ];
    for (name, text) in refused {
        cases.push(Case::new(GROUP, name, "refused, with line and column", move || placed(text)));
    }
    cases.push(Case::new(GROUP, "arrays a hundred thousand deep", "refused, without a deep stack", || {
        placed(&format!("name = {}", "[".repeat(100_000)))
    }));
    cases
}

fn placed(text: &str) -> Verdict {
    match Scene::parse(text, "case.toml") {
        Ok(_) => Verdict::is(false, "it is accepted"),
        Err(errors) => {
            let fault = &errors.faults()[0];
            Verdict::is(fault.line() > 0, format!("{}:{}: {}", fault.line(), fault.column(), fault.message()))
        }
    }
}

fn numbers(value: &str) -> Verdict {
    for (name, before, after) in NUMBERS {
        if Scene::parse(&format!("{before}{value}{after}\n"), "case.toml").is_ok() {
            return Verdict::is(false, format!("{name} may be {value}"));
        }
    }
    Verdict::is(true, format!("all {} refused", NUMBERS.len()))
}
