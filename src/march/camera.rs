//! Where pictures are taken from.

use glam::{DVec2, DVec3};

use crate::scene::{self, Projection};

/// The way from the scene to the eye, where the scene does not say: from the front, a little to the right and above.
const FROM: DVec3 = DVec3::new(0.35, -1.0, 0.3);
/// Horizontal angle of view in degrees, where neither it nor the eye's place is given.
const FOV: f64 = 40.0;
/// The narrowest and the widest angle of view in degrees that framing chooses.
const FRAMED: [f64; 2] = [1e-9, 120.0];
/// The scene's box takes no more than this part of the picture.
const PART: f64 = 0.94;

/// A half line.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ray {
    /// Where it begins, in metres.
    pub origin: DVec3,
    /// Where it goes, of length 1.
    pub direction: DVec3,
}

impl Ray {
    /// The point at a distance in metres.
    pub fn at(&self, t: f64) -> DVec3 {
        self.origin + self.direction * t
    }
}

/// A camera with nothing left to choose.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Camera {
    /// The eye, in metres; of an orthographic camera the middle of the plane that its rays begin on.
    pub eye: DVec3,
    /// Where it looks, and what is right and up in the picture: of length 1 and at right angles.
    pub forward: DVec3,
    /// See `forward`.
    pub right: DVec3,
    /// See `forward`.
    pub up: DVec3,
    /// How far the picture reaches to the right of its middle and above it: at distance 1 from the eye, or in metres for
    /// an orthographic camera.
    pub half: DVec2,
    /// Whether all rays are parallel.
    pub is_orthographic: bool,
}

impl Camera {
    /// The scene's camera for a picture whose width over height is `aspect`. What the scene leaves open is chosen so that
    /// the box (two corners, in metres) fills the picture; without a box, a cube of 2 m around the origin stands for it.
    pub fn new(camera: &scene::Camera, bounds: Option<[DVec3; 2]>, aspect: f64) -> Camera {
        let [low, high] = bounds.unwrap_or([DVec3::NEG_ONE, DVec3::ONE]);
        // A box without extent would be framed by a picture without.
        let least = DVec3::splat(1e-6 * (1.0 + low.abs().max(high.abs()).max_element()));
        let (centre, size) = (0.5 * (low + high), (0.5 * (high - low)).max(least));
        let corners: [DVec3; 8] = std::array::from_fn(|corner| {
            let sign = |axis: usize| if corner >> axis & 1 == 1 { 1.0 } else { -1.0 };
            centre + size * DVec3::new(sign(0), sign(1), sign(2))
        });
        let position = camera.position.map(DVec3::from);
        let target = camera.look_at.map_or(centre, DVec3::from);
        let away = position.map_or(FROM, |position| position - target);
        let away = away.try_normalize().unwrap_or(FROM.normalize());
        let [right, up] = across(-away, camera.up.map_or(DVec3::Z, DVec3::from));
        let mut found = Camera {
            eye: position.unwrap_or(target),
            forward: -away,
            right,
            up,
            half: DVec2::ONE,
            is_orthographic: matches!(camera.projection, Projection::Orthographic { .. }),
        };
        let width = match camera.projection {
            Projection::Orthographic { width } => {
                if position.is_none() {
                    found.eye += away * 2.0 * size.length();
                }
                let framed = || 2.0 * found.reach(&corners, aspect) / PART;
                width.unwrap_or_else(framed)
            }
            Projection::Perspective { fov } => {
                let tangent = |degrees: f64| libm::tan(0.5 * degrees.to_radians());
                let half = match (fov, position) {
                    (Some(fov), _) => tangent(fov),
                    (None, None) => tangent(FOV),
                    (None, Some(_)) => {
                        (found.reach(&corners, aspect) / PART).clamp(tangent(FRAMED[0]), tangent(FRAMED[1]))
                    }
                };
                if position.is_none() {
                    found.eye += away * found.distance(&corners, half * PART, aspect);
                }
                2.0 * half
            }
        };
        found.half = 0.5 * width * DVec2::new(1.0, 1.0 / aspect);
        found
    }

    /// How far to the side the points are seen, heights counted as so many widths: at distance 1, or in metres. Infinite
    /// where one is behind the eye.
    fn reach(&self, points: &[DVec3], aspect: f64) -> f64 {
        points.iter().fold(0.0, |reach, point| {
            let to = *point - self.eye;
            let side = to.dot(self.right).abs().max(to.dot(self.up).abs() * aspect);
            let depth = if self.is_orthographic { 1.0 } else { to.dot(self.forward) };
            f64::max(reach, if depth > 0.0 { side / depth } else { f64::INFINITY })
        })
    }

    /// The least distance by which the eye must go back to see the points within `half`.
    fn distance(&self, points: &[DVec3], half: f64, aspect: f64) -> f64 {
        points.iter().fold(0.0, |distance, point| {
            let to = *point - self.eye;
            let side = to.dot(self.right).abs().max(to.dot(self.up).abs() * aspect);
            f64::max(distance, side / half - to.dot(self.forward))
        })
    }

    /// The ray through a place of the picture: x from -1 at its left edge to 1, y from -1 at its lower edge to 1.
    pub fn ray(&self, place: DVec2) -> Ray {
        let side = self.right * (place.x * self.half.x) + self.up * (place.y * self.half.y);
        if self.is_orthographic {
            Ray { origin: self.eye + side, direction: self.forward }
        } else {
            Ray { origin: self.eye, direction: (self.forward + side).normalize() }
        }
    }
}

/// What is right and up for who looks along `forward`, with `up` as near to upwards as can be.
fn across(forward: DVec3, up: DVec3) -> [DVec3; 2] {
    let side = |up: DVec3| {
        // However short it is.
        let up = up / up.abs().max_element().max(f64::MIN_POSITIVE);
        let side = forward.cross(up.normalize_or_zero());
        (side.length() > 1e-6).then(|| side.normalize())
    };
    let right = side(up).or_else(|| side(DVec3::Y)).or_else(|| side(DVec3::X)).unwrap_or(DVec3::X);
    [right, right.cross(forward)]
}

#[cfg(test)]
mod tests {
    use super::*;

    const BOX: [DVec3; 2] = [DVec3::new(1.0, -2.0, 0.0), DVec3::new(3.0, -1.0, 4.0)];

    /// The largest |x| and |y| at which the box's corners are seen.
    fn seen(camera: &Camera) -> DVec2 {
        let mut most = DVec2::ZERO;
        for corner in 0..8 {
            let pick = |axis: usize| BOX[corner >> axis & 1][axis];
            let to = DVec3::new(pick(0), pick(1), pick(2)) - camera.eye;
            let depth = if camera.is_orthographic { 1.0 } else { to.dot(camera.forward) };
            assert!(depth > 0.0);
            most =
                most.max((DVec2::new(to.dot(camera.right), to.dot(camera.up)) / depth / camera.half).abs());
        }
        most
    }

    #[test]
    fn the_box_fills_the_picture() {
        let projections = [
            Projection::Perspective { fov: None },
            Projection::Perspective { fov: Some(80.0) },
            Projection::Orthographic { width: None },
        ];
        for projection in projections {
            for position in [None, Some([10.0, -10.0, 8.0])] {
                for aspect in [0.4, 1.0, 16.0 / 9.0] {
                    let view = scene::Camera { projection, position, ..scene::Camera::default() };
                    let camera = Camera::new(&view, Some(BOX), aspect);
                    let most = seen(&camera).max_element();
                    // What is given is not framed.
                    let given = projection == projections[1] && position.is_some();
                    assert!(given || (most - PART).abs() < 1e-9, "{projection:?} {position:?}: {most}");
                    assert!((camera.half.x / camera.half.y - aspect).abs() < 1e-12);
                }
            }
        }
    }

    #[test]
    fn axes_are_right_handed_and_up_is_up() {
        for position in [[0.0, -5.0, 0.0], [0.0, 0.0, 5.0], [0.0, 0.0, -5.0], [3.0, 2.0, 1.0]] {
            let view = scene::Camera { position: Some(position), ..scene::Camera::default() };
            let camera = Camera::new(&view, None, 1.5);
            assert!((camera.right.cross(camera.up) + camera.forward).length() < 1e-12);
            assert!(camera.up.z > -1e-12);
            let middle = camera.ray(DVec2::ZERO);
            assert!(middle.at(DVec3::from(position).length()).length() < 1e-12);
        }
        // Seen from the front, x is to the right.
        let view = scene::Camera { position: Some([0.0, -5.0, 0.0]), ..scene::Camera::default() };
        assert!((Camera::new(&view, None, 1.0).right - DVec3::X).length() < 1e-12);
    }

    #[test]
    fn rays_go_through_their_place() {
        let view = scene::Camera {
            projection: Projection::Perspective { fov: Some(90.0) },
            position: Some([0.0, -1.0, 0.0]),
            ..scene::Camera::default()
        };
        let camera = Camera::new(&view, None, 2.0);
        let corner = camera.ray(DVec2::ONE);
        assert!((corner.direction - DVec3::new(1.0, 1.0, 0.5).normalize()).length() < 1e-12);
    }
}
