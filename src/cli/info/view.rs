//! What another renderer needs to show a scene, with nothing left to choose.

use std::str::FromStr;

use glam::DVec3;
use serde::Serialize;

use crate::field::Field;
use crate::march::{Camera, black_body};
use crate::scene::{Light, Scene};

/// Pixels of a picture: width and height.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::cli) struct Size {
    pub(in crate::cli) width: u32,
    pub(in crate::cli) height: u32,
}

impl Size {
    /// Of a picture, where none is given.
    pub(in crate::cli) const DEFAULT: &'static str = "960x540";
    /// The widest and the highest.
    const MOST: u32 = 65536;

    pub(in crate::cli) fn aspect(self) -> f64 {
        f64::from(self.width) / f64::from(self.height)
    }
}

impl FromStr for Size {
    type Err = String;

    fn from_str(text: &str) -> Result<Size, String> {
        let side = |text: &str| text.parse().ok().filter(|side| (1..=Size::MOST).contains(side));
        text.split_once('x')
            .and_then(|(width, height)| Some(Size { width: side(width)?, height: side(height)? }))
            .ok_or_else(|| format!("expected pixels, such as {}, 1 to {} a side", Size::DEFAULT, Size::MOST))
    }
}

/// As `--json` prints it. Colours are linear sRGB, lengths metres.
#[derive(Debug, Serialize)]
pub(super) struct View {
    /// Pixels of the picture that the camera is framed to.
    size: [u32; 2],
    medium: Medium,
    camera: Eye,
    lights: Vec<Lamp>,
}

#[derive(Debug, Serialize)]
struct Medium {
    /// Per metre at density 1.
    extinction: f64,
    albedo: [f64; 3],
    /// Henyey-Greenstein mean cosine.
    anisotropy: f64,
    /// Radiance per metre at density 1.
    emission: [f64; 3],
}

/// A [`Camera`].
#[derive(Debug, Serialize)]
struct Eye {
    eye: [f64; 3],
    forward: [f64; 3],
    right: [f64; 3],
    up: [f64; 3],
    /// Half the picture's width and height: at distance 1, or in metres for an orthographic camera.
    half: [f64; 2],
    is_orthographic: bool,
    /// Radiance; null where there is none, and the picture is transparent.
    background: Option<[f64; 3]>,
    /// Stops; null where the picture chooses.
    exposure: Option<f64>,
}

#[derive(Debug, Serialize)]
#[serde(tag = "kind", rename_all = "kebab-case")]
enum Lamp {
    Sun { direction: [f64; 3], irradiance: [f64; 3] },
    Point { position: [f64; 3], intensity: [f64; 3] },
    Ambient { radiance: [f64; 3] },
}

/// The view of a scene at its time. Where it holds no density the camera is framed to `other`, corners in metres.
pub(super) fn view(scene: &Scene, other: Option<[DVec3; 2]>, size: Size) -> View {
    let (medium, camera) = (scene.medium(), scene.camera());
    let bounds = Field::compile(scene).bounds().or(other);
    let glow = medium.temperature.map_or([1.0; 3], black_body);
    let Camera { eye, forward, right, up, half, is_orthographic } =
        Camera::new(&camera, bounds, size.aspect());
    View {
        size: [size.width, size.height],
        medium: Medium {
            extinction: medium.extinction,
            albedo: medium.albedo,
            anisotropy: medium.anisotropy,
            emission: [0, 1, 2].map(|part| medium.emission[part] * glow[part]),
        },
        camera: Eye {
            eye: eye.to_array(),
            forward: forward.to_array(),
            right: right.to_array(),
            up: up.to_array(),
            half: half.to_array(),
            is_orthographic,
            background: camera.background,
            exposure: camera.exposure,
        },
        lights: scene.lights().iter().map(lamp).collect(),
    }
}

fn lamp(light: &Light) -> Lamp {
    match *light {
        Light::Sun { direction, irradiance } => Lamp::Sun { direction, irradiance },
        Light::Point { position, intensity } => Lamp::Point { position, intensity },
        Light::Ambient { radiance } => Lamp::Ambient { radiance },
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_are_width_and_height() {
        assert_eq!("16x9".parse(), Ok(Size { width: 16, height: 9 }));
        for text in ["", "16", "16x", "x9", "0x9", "16x-9", "16x9x2", "65537x1", "1e3x1"] {
            assert!(text.parse::<Size>().is_err(), "{text}");
        }
        assert!(Size::DEFAULT.parse::<Size>().is_ok());
    }

    #[test]
    fn emission_has_the_colour_of_its_temperature() {
        let text = "[medium]\nemission = [2, 1, 1]\ntemperature = 3000\n[[light]]\nkind = \"point\"\nposition = [1, 2, 3]";
        let scene = Scene::parse(text, "").expect("valid");
        let size = Size { width: 2, height: 1 };
        let json = serde_json::to_value(view(&scene, None, size)).expect("JSON");
        let [red, green, blue] = black_body(3000.0);
        assert_eq!(json["medium"]["emission"], serde_json::json!([2.0 * red, green, blue]));
        assert_eq!(json["lights"][0]["kind"], "point");
        assert_eq!(json["lights"][0]["intensity"], serde_json::json!([1.0, 1.0, 1.0]));
        assert_eq!(json["camera"]["is_orthographic"], false);
        assert_eq!(json["camera"]["background"], serde_json::Value::Null);
    }

    #[test]
    fn what_holds_nothing_is_framed_to_the_file() {
        let scene = Scene::parse("", "").expect("valid");
        let size = Size { width: 2, height: 2 };
        let corners = [DVec3::splat(99.0), DVec3::splat(101.0)];
        let camera = view(&scene, Some(corners), size).camera;
        let ahead = DVec3::splat(100.0) - DVec3::from(camera.eye);
        assert!(ahead.normalize().dot(DVec3::from(camera.forward)) > 1.0 - 1e-12);
    }
}
