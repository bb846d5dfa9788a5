//! `[medium]`, `[camera]` and `[[light]]`: what a picture of the scene needs, and baking does not.

use glam::DVec3;

use super::error::Fault;
use super::keys::CAMERA;
use super::reader::{Reader, Words};
use super::{Camera, Light, Medium, limit};

/// From the upper right, before the scene.
const DIRECTION: [f64; 3] = [-1.0, 0.6, -0.8];

static KINDS: Words<()> = Words { known: &[("sun", ())], later: &[], instead: "" };

pub(super) fn medium(table: Option<Reader<'_>>) -> Medium {
    let number = |key, limit| table.and_then(|table| table.number(key, limit));
    Medium {
        extinction: number("extinction", &limit::NOT_NEGATIVE).unwrap_or(10.0),
        albedo: number("albedo", &limit::FRACTION).unwrap_or(0.9),
        anisotropy: number("anisotropy", &limit::MEAN_COSINE).unwrap_or(0.0),
    }
}

pub(super) fn camera(root: &Reader<'_>) -> Camera {
    let Some(table) = root.table("camera", &CAMERA) else { return Camera::default() };
    let camera = Camera {
        position: table.vector("position", &limit::ANY),
        look_at: table.vector("look_at", &limit::ANY),
        fov: table.number("fov", &limit::DEGREES),
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
    camera
}

pub(super) fn light(table: &Reader<'_>) -> Light {
    table.word("kind", &KINDS);
    let direction = table.vector("direction", &limit::ANY).unwrap_or(DIRECTION);
    let irradiance = table.get("irradiance").and_then(|item| item.vector_or_number(&limit::NOT_NEGATIVE));
    let unit = DVec3::from_array(direction).try_normalize();
    if let (None, Some(item)) = (unit, table.get("direction")) {
        table.report(
            Fault::at(item.span(), "`direction` has no length").label("expected a vector other than 0"),
        );
    }
    Light::Sun {
        direction: unit.unwrap_or(DVec3::NEG_Z).to_array(),
        irradiance: irradiance.unwrap_or([1.0; 3]),
    }
}
