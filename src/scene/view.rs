//! `[medium]`, `[camera]` and `[[light]]`: what a picture of the scene needs, and baking does not.

use glam::DVec3;

use super::error::Fault;
use super::keys::{CAMERA, LIGHT};
use super::reader::{Reader, Words};
use super::{Camera, Light, MOST_LAMPS, Medium, Projection, limit};

/// From the upper right, before the scene.
const DIRECTION: [f64; 3] = [-1.0, 0.6, -0.8];

#[derive(Debug, Clone, Copy, PartialEq)]
enum Kind {
    Sun,
    Point,
    Ambient,
}

static KINDS: Words<Kind> = Words {
    known: &[("sun", Kind::Sun), ("point", Kind::Point), ("ambient", Kind::Ambient)],
    later: &[],
    instead: "",
};

static PROJECTIONS: Words<bool> =
    Words { known: &[("perspective", false), ("orthographic", true)], later: &[], instead: "" };

/// The keys of lights that mean something to one kind only.
const OWN: [(&str, Kind, &str); 5] = [
    ("direction", Kind::Sun, "sun"),
    ("irradiance", Kind::Sun, "sun"),
    ("position", Kind::Point, "point"),
    ("intensity", Kind::Point, "point"),
    ("radiance", Kind::Ambient, "ambient"),
];

pub(super) fn medium(table: Option<Reader<'_>>) -> Medium {
    let number = |key, limit| table.and_then(|table| table.number(key, limit));
    let colour = |key, limit| table.and_then(|table| table.get(key)?.vector_or_number(limit));
    let temperature = number("temperature", &limit::FLAME);
    Medium {
        extinction: number("extinction", &limit::NOT_NEGATIVE).unwrap_or(10.0),
        albedo: colour("albedo", &limit::FRACTION).unwrap_or([0.9; 3]),
        anisotropy: number("anisotropy", &limit::MEAN_COSINE).unwrap_or(0.0),
        emission: colour("emission", &limit::NOT_NEGATIVE)
            .unwrap_or([if temperature.is_some() { 1.0 } else { 0.0 }; 3]),
        temperature,
    }
}

pub(super) fn camera(root: &Reader<'_>) -> Camera {
    let Some(table) = root.table("camera", &CAMERA) else { return Camera::default() };
    let orthographic = table.word("kind", &PROJECTIONS).unwrap_or(false);
    let [fov, width] =
        [("fov", &limit::DEGREES), ("width", &limit::POSITIVE)].map(|(key, limit)| table.number(key, limit));
    let (other, kind) = if orthographic { ("fov", "a perspective") } else { ("width", "an orthographic") };
    if let Some(item) = table.get(other) {
        table.report(
            Fault::at(item.span(), format!("`{other}` means nothing to this camera"))
                .label(format!("only {kind} one has it")),
        );
    }
    let camera = Camera {
        projection: if orthographic {
            Projection::Orthographic { width }
        } else {
            Projection::Perspective { fov }
        },
        position: table.vector("position", &limit::ANY),
        look_at: table.vector("look_at", &limit::ANY),
        up: table.vector("up", &limit::ANY),
        background: table.get("background").and_then(|item| item.vector_or_number(&limit::NOT_NEGATIVE)),
        exposure: table.number("exposure", &limit::STOPS),
    };
    if let (Some(position), Some(look_at)) = (table.get("position"), table.get("look_at"))
        && camera.position.is_some()
        && camera.position == camera.look_at
    {
        table.report(
            Fault::at(look_at.span(), "the camera looks at the point where it is")
                .label("expected another point")
                .related(position.span(), "it is here"),
        );
    }
    if let (Some(item), Some([0.0, 0.0, 0.0])) = (table.get("up"), camera.up) {
        table.report(Fault::at(item.span(), "`up` has no length").label("expected a vector other than 0"));
    }
    camera
}

/// The scene's lights; a sun and a little light from everywhere where it has none.
pub(super) fn lights(root: &Reader<'_>) -> Vec<Light> {
    let tables = root.tables("light", &LIGHT);
    let lights: Vec<Light> = tables.iter().map(light).collect();
    let lamps = tables.iter().zip(&lights).filter(|(_, light)| !matches!(light, Light::Ambient { .. }));
    if let Some((table, _)) = lamps.clone().nth(MOST_LAMPS) {
        let count = lamps.count();
        table.report(
            Fault::at(table.span(), format!("a scene has no more than {MOST_LAMPS} suns and points"))
                .label(format!("this one is too many, of {count}")),
        );
    }
    if !lights.is_empty() {
        return lights;
    }
    let direction = DVec3::from_array(DIRECTION).normalize().to_array();
    vec![Light::Sun { direction, irradiance: [1.0; 3] }, Light::Ambient { radiance: [0.01; 3] }]
}

/// The same direction with length 1, however short the vector; `None` without a direction.
fn unit(vector: DVec3) -> Option<DVec3> {
    let most = vector.abs().max_element();
    if most > 0.0 { (vector / most).try_normalize() } else { None }
}

fn light(table: &Reader<'_>) -> Light {
    let kind = table.word("kind", &KINDS).unwrap_or(Kind::Sun);
    for (key, of, name) in OWN {
        if let (true, Some(item)) = (of != kind, table.get(key)) {
            table.report(
                Fault::at(item.span(), format!("`{key}` means nothing to this light"))
                    .label(format!("only `kind = \"{name}\"` has it")),
            );
        }
    }
    let colour = |key| {
        let item = table.get(key);
        item.and_then(|item| item.vector_or_number(&limit::NOT_NEGATIVE)).unwrap_or([1.0; 3])
    };
    let place = |key| table.vector(key, &limit::ANY);
    // All of them, so that what is wrong with one is told even where it means nothing.
    let [irradiance, intensity, radiance] = ["irradiance", "intensity", "radiance"].map(colour);
    let [direction, position] = ["direction", "position"].map(place);
    match kind {
        Kind::Ambient => Light::Ambient { radiance },
        Kind::Point => {
            if table.get("position").is_none() {
                table.report(
                    Fault::at(table.span(), "a point light needs a `position`")
                        .label("expected `position = [x, y, z]`"),
                );
            }
            Light::Point { position: position.unwrap_or([0.0; 3]), intensity }
        }
        Kind::Sun => {
            let unit = unit(DVec3::from_array(direction.unwrap_or(DIRECTION)));
            if let (None, Some(item)) = (unit, table.get("direction")) {
                table.report(
                    Fault::at(item.span(), "`direction` has no length")
                        .label("expected a vector other than 0"),
                );
            }
            Light::Sun { direction: unit.unwrap_or(DVec3::NEG_Z).to_array(), irradiance }
        }
    }
}
