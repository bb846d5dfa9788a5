//! Where rays are inside of tubes.
//!
//! The density of a scene lies in truncated cones along the tubes' axes, and in balls at round ends and corners. Where a ray
//! enters and leaves these has a closed form, whatever the radius does along a tube; marching up to a tube by its distance
//! does not need one, but takes many steps along a tube that grows thicker.

use glam::{DVec2, DVec3};

use super::bvh::{Bvh, Corners};
use super::camera::Ray;
use crate::field::{Ball, Cone, Field, Hull, Lattice};

/// A piece of a ray, from where it enters something to where it leaves it, in metres from its origin.
pub type Interval = [f64; 2];

/// Bodies that hold all of a field's density and little else.
///
/// Around an axis that does not bend and a radius that is linear along it, they are thicker than the tube by a hundredth of a
/// voxel; else by 0.6 % of the radius, or a twentieth of a voxel, at most.
#[derive(Debug, Clone)]
pub struct TubeBounds {
    hulls: Vec<Hull>,
    bvh: Bvh,
}

impl TubeBounds {
    /// Of a field as it is evaluated for blocks of a lattice.
    pub fn new(field: &Field, lattice: Lattice) -> TubeBounds {
        TubeBounds::of(field.hulls(lattice))
    }

    /// Where a ray is inside of the box around all of them, from its origin on.
    pub(super) fn around(&self, ray: &Ray) -> Option<Interval> {
        self.bvh.corners()?.interval(ray.origin, ray.direction.recip())
    }

    fn of(hulls: Vec<Hull>) -> TubeBounds {
        let boxes: Vec<Corners> = hulls.iter().map(Hull::corners).collect();
        TubeBounds { bvh: Bvh::new(&boxes), hulls }
    }

    /// Number of bodies.
    pub fn bodies(&self) -> usize {
        self.hulls.len()
    }

    /// Corners of the box around all of them, in metres.
    pub fn corners(&self) -> Option<[DVec3; 2]> {
        self.bvh.corners().map(|corners| [corners.low, corners.high])
    }

    /// Where a ray is inside of any of them: in order, apart from each other, and none before its origin. What `found`
    /// held before is forgotten.
    pub fn intervals(&self, ray: &Ray, found: &mut Vec<Interval>) {
        found.clear();
        let inverse = ray.direction.recip();
        self.bvh.visit(
            found,
            |_, corners| corners.is_met(ray.origin, inverse),
            |found, body| {
                if let Some([enters, leaves]) = self.hulls[body].interval(ray)
                    && leaves >= 0.0
                {
                    found.push([enters.max(0.0), leaves]);
                }
            },
        );
        join(found);
    }

    /// Whether a point is inside of any of them.
    pub fn contains(&self, point: DVec3) -> bool {
        let mut found = false;
        self.bvh.visit(
            &mut found,
            |found, corners| !*found && corners.distance(point) == 0.0,
            |found, body| *found |= self.hulls[body].distance(point) <= 0.0,
        );
        found
    }

    /// How far a point is from the nearest of them at least; negative inside, where it is no farther from the surface of
    /// the body that it is deepest in than that. Infinite where there is none.
    pub fn distance(&self, point: DVec3) -> f64 {
        let mut nearest = f64::INFINITY;
        self.bvh.visit(
            &mut nearest,
            // Inside of one body others may still be deeper around the point.
            |nearest, corners| corners.distance(point) <= nearest.max(0.0),
            |nearest, body| *nearest = nearest.min(self.hulls[body].distance(point)),
        );
        nearest
    }

    /// Hands over the bodies that come within `reach` of a point.
    pub(super) fn near(&self, point: DVec3, reach: f64, mut visit: impl FnMut(&Hull)) {
        let around = Corners { low: point - reach, high: point + reach };
        self.bvh.visit(
            &mut (),
            |(), corners| corners.meets(&around),
            |(), body| {
                let hull = &self.hulls[body];
                if hull.distance(point) <= reach {
                    visit(hull);
                }
            },
        );
    }
}

/// Puts intervals in order, and makes one of those that touch.
pub(super) fn join(found: &mut Vec<Interval>) {
    found.sort_unstable_by(|a, b| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])));
    let mut kept = 0;
    for at in 1..found.len() {
        let next = found[at];
        if next[0] <= found[kept][1] {
            found[kept][1] = found[kept][1].max(next[1]);
        } else {
            kept += 1;
            found[kept] = next;
        }
    }
    found.truncate(kept + 1);
}

/// The box of every segment of a curve with its radius, and of every end and corner, along the world's axes.
pub(super) fn segment_boxes(field: &Field, lattice: Lattice) -> Vec<Corners> {
    let boxes = field
        .hulls_by_segment(lattice)
        .map(|hulls| hulls.iter().map(Hull::corners).fold(Corners::NONE, Corners::with));
    boxes.collect()
}

impl Hull {
    /// The box around it.
    fn corners(&self) -> Corners {
        match self {
            Hull::Cone(cone) => {
                // Discs reach so far along each of the coordinates' axes.
                let across = (DVec3::ONE - cone.axis * cone.axis).max(DVec3::ZERO);
                let across = DVec3::new(across.x.sqrt(), across.y.sqrt(), across.z.sqrt());
                let ends = cone.along.map(|x| cone.origin + cone.axis * x);
                let reach = cone.radius.map(|radius| across * (radius * (1.0 + 1e-12)));
                Corners {
                    low: (ends[0] - reach[0]).min(ends[1] - reach[1]),
                    high: (ends[0] + reach[0]).max(ends[1] + reach[1]),
                }
            }
            Hull::Ball(ball) => Corners { low: ball.centre - ball.radius, high: ball.centre + ball.radius },
        }
    }

    /// How far a point is away at least, exactly but for cut balls; negative inside.
    pub(super) fn distance(&self, point: DVec3) -> f64 {
        match self {
            Hull::Cone(cone) => cone.distance(point),
            Hull::Ball(ball) => ball.distance(point),
        }
    }

    /// Where the line of a ray is inside.
    pub(super) fn interval(&self, ray: &Ray) -> Option<Interval> {
        // From the place next to the body, so that nothing is lost far away from it.
        let middle = match self {
            Hull::Cone(cone) => cone.origin + cone.axis * (0.5 * (cone.along[0] + cone.along[1])),
            Hull::Ball(ball) => ball.centre,
        };
        let ahead = (middle - ray.origin).dot(ray.direction) / ray.direction.length_squared();
        let near = ray.at(ahead);
        let inside = match self {
            Hull::Cone(cone) => cone.interval(near, ray.direction),
            Hull::Ball(ball) => ball.interval(near, ray.direction),
        };
        inside.map(|[enters, leaves]| [enters + ahead, leaves + ahead])
    }
}

/// The part of an interval where `value + slope t <= 0`.
fn cut([from, to]: Interval, value: f64, slope: f64) -> Option<Interval> {
    let cut = if slope > 0.0 {
        [from, to.min(-value / slope)]
    } else if slope < 0.0 {
        [from.max(-value / slope), to]
    } else if value <= 0.0 {
        [from, to]
    } else {
        return None;
    };
    (cut[0] <= cut[1]).then_some(cut)
}

impl Cone {
    fn slope(&self) -> f64 {
        (self.radius[1] - self.radius[0]) / (self.along[1] - self.along[0])
    }

    fn distance(&self, point: DVec3) -> f64 {
        let from = point - self.origin;
        let x = from.dot(self.axis);
        let place = DVec2::new(x, (from - self.axis * x).length());
        let corners = [0, 1].map(|end| DVec2::new(self.along[end], self.radius[end]));
        let side = corners[1] - corners[0];
        let normal = DVec2::new(-side.y, side.x).normalize_or_zero();
        let before = self.along[0] - place.x;
        let behind = place.x - self.along[1];
        let beside = (place - corners[0]).dot(normal);
        if before <= 0.0 && behind <= 0.0 && beside <= 0.0 {
            return before.max(behind).max(beside);
        }
        let part = ((place - corners[0]).dot(side) / side.length_squared()).clamp(0.0, 1.0);
        let to_side = place.distance(corners[0] + side * part);
        let to_end = |end: usize| {
            DVec2::new(place.x - self.along[end], (place.y - self.radius[end]).max(0.0)).length()
        };
        to_side.min(to_end(0)).min(to_end(1))
    }

    /// Where a line through `near` is inside.
    fn interval(&self, near: DVec3, direction: DVec3) -> Option<Interval> {
        let from = near - self.origin;
        let (x, pace) = (from.dot(self.axis), direction.dot(self.axis));
        let slab = cut([f64::NEG_INFINITY, f64::INFINITY], self.along[0] - x, -pace)?;
        let slab = cut(slab, x - self.along[1], pace)?;
        // |y + t v|^2 <= (s + t g)^2
        let (y, v) = (from - self.axis * x, direction - self.axis * pace);
        let slope = self.slope();
        let (s, g) = (self.radius[0] + slope * (x - self.along[0]), slope * pace);
        let a = v.length_squared() - g * g;
        let b = y.dot(v) - s * g;
        let c = y.length_squared() - s * s;
        let rooted = b * b - a * c;
        if rooted < 0.0 {
            // With a negative everything is inside, of this cone or of its other half, which the slab does not reach.
            return if a < 0.0 { cut(slab, -s, -g) } else { None };
        }
        let root = rooted.sqrt();
        // Roots without cancellation: q / a, and c / q.
        let q = if b > 0.0 { -b - root } else { root - b };
        if q == 0.0 {
            // b = 0 and a c = 0: it keeps its distance, or touches in one place.
            return if a > 0.0 {
                cut(cut(slab, 0.0, 1.0)?, 0.0, -1.0)
            } else if c <= 0.0 {
                Some(slab)
            } else {
                None
            };
        }
        let (one, other) = (q / a, c / q);
        let (low, high) = (one.min(other), one.max(other));
        let found = if a > 0.0 {
            [slab[0].max(low), slab[1].min(high)]
        } else if a < 0.0 {
            // On the side of the roots where the cone is.
            if g > 0.0 { [slab[0].max(high), slab[1]] } else { [slab[0], slab[1].min(low)] }
        } else if b > 0.0 {
            [slab[0], slab[1].min(other)]
        } else {
            [slab[0].max(other), slab[1]]
        };
        (found[0] <= found[1]).then_some(found)
    }
}

impl Ball {
    fn distance(&self, point: DVec3) -> f64 {
        let from = point - self.centre;
        let cut = |v: DVec3| if v == DVec3::ZERO { f64::NEG_INFINITY } else { from.dot(v) - self.slack };
        (from.length() - self.radius).max(cut(self.cuts[0])).max(cut(self.cuts[1]))
    }

    fn interval(&self, near: DVec3, direction: DVec3) -> Option<Interval> {
        let from = near - self.centre;
        let along = direction.length();
        // `near` is where the line is nearest to the centre, but for rounding.
        let ahead = -from.dot(direction) / (along * along);
        let away = from + direction * ahead;
        let room = (self.radius - away.length()) * (self.radius + away.length());
        if room < 0.0 {
            return None;
        }
        let half = room.sqrt() / along;
        let mut found = [ahead - half, ahead + half];
        for v in self.cuts {
            if v != DVec3::ZERO {
                found = cut(found, from.dot(v) - self.slack, direction.dot(v))?;
            }
        }
        Some(found)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Scene;
    use crate::volume::testing::unit;

    fn field(tube: &str) -> Field {
        let text = format!("[bake]\nwiden = false\n[[tube]]\n{tube}");
        Field::compile(&Scene::parse(&text, "scene.toml").expect("valid"))
    }

    fn bounds(tube: &str, h: f64) -> TubeBounds {
        TubeBounds::new(&field(tube), Lattice { voxel_size: h })
    }

    fn ray(origin: [f64; 3], direction: [f64; 3]) -> Ray {
        Ray { origin: origin.into(), direction: DVec3::from(direction).normalize() }
    }

    fn found(bounds: &TubeBounds, ray: &Ray) -> Vec<Interval> {
        let mut found = vec![[7.0, 7.0]];
        bounds.intervals(ray, &mut found);
        found
    }

    fn direction(state: &mut u64) -> DVec3 {
        loop {
            let v = DVec3::new(unit(state), unit(state), unit(state)) * 2.0 - 1.0;
            if v.length() > 0.1 && v.length() < 1.0 {
                return v.normalize();
            }
        }
    }

    /// Tubes of every kind: bent, growing, closed, with corners, cusps, jumps, tips and round ends.
    const TUBES: [&str; 9] = [
        "curve = { points = [[0, 0, 0], [0.3, 0.1, 1.2], [0, 0, 2.5]] }\nradius = [[0, 0.1], [0.35, 0.17], [1, 0.6]]",
        "curve = { kind = 'cubic', points = [[0,0,0],[3,0,1],[-2,1,2],[1,1,0]] }\nradius = [[0,0.1],[0.4,0.3],[1,0]]",
        "curve = { points = [[0,0,0],[1,0,2],[2,0,0]] }\nradius = { kind = 'sinusoidal', mean = 0.2, amplitude = 0.1, waves = 9 }\ncaps = 'flat'",
        "curve = { points = [[0,0,0],[1,0,2],[2,0,0]] }\nradius = [[0, 0.1], [0.5, 0.1], [0.5, 0.4], [1, 0.1]]\ncaps = 'round'",
        "curve = { points = [[0,0,0],[0.5,0,0],[1,0,0],[1,0.5,0],[1,1,0]] }\nradius = 0.3\ncaps = 'round'",
        "curve = { kind = 'cubic', points = [[0,0,0],[1,1,0],[0,1,0],[1,0,0]] }\nradius = 0.2",
        "curve = { points = [[0,0,0],[1.5,0,0],[1,0,0]] }\nradius = 0.2\ncaps = 'flat'",
        "curve = { kind = 'catmull-rom', points = [[1,0,0],[0,1,0.3],[-1,0,0],[0,-1,0.5]], closed = true }\nradius = 0.25",
        "curve = { points = [[0,0,0],[0,0,1e-3],[0,0,0.3]] }\nradius = [[0, 0], [0.1, 0.5], [1, 0]]\ncaps = 'round'",
    ];

    #[test]
    fn they_hold_every_point_with_density() {
        let mut state = 11;
        for (tube, h) in TUBES.iter().flat_map(|tube| [(tube, 0.1), (tube, 0.01), (tube, 1e-3)]) {
            let text = format!("[bake]\nwiden = false\n[[tube]]\nenvelope = {{ radial = 'hard' }}\n{tube}");
            let scene = Scene::parse(&text, "scene.toml").expect("valid");
            let field = Field::compile(&scene);
            let lattice = Lattice { voxel_size: h };
            let bounds = TubeBounds::new(&field, lattice);
            let [low, high] = field.bounds().expect("density");
            let reach = (high - low) * 0.05;
            let mut point = || DVec3::new(unit(&mut state), unit(&mut state), unit(&mut state));
            let points: Vec<DVec3> =
                (0..20_000).map(|_| low - reach + point() * (high - low + 2.0 * reach)).collect();
            let reference = crate::reference::Reference::new(&scene, None);
            let mut inside = 0;
            for point in points.iter().take(4000) {
                let truth = reference.density((*point).into());
                assert!(truth == 0.0 || bounds.contains(*point), "{tube}, {h}: {point}");
                inside += usize::from(truth > 0.0);
            }
            assert!(inside > 20, "{tube}: {inside}");
            // As it is evaluated in single precision, too.
            if h > 5e-3 {
                let level = crate::num::Level::best();
                let densities =
                    crate::volume::density_at(&field, lattice, &points, level, 1 << 30).expect("small");
                for (point, density) in points.iter().zip(densities) {
                    assert!(density == 0.0 || bounds.contains(*point), "{tube}, {h}: {point}");
                }
            }
        }
    }

    #[test]
    fn intervals_are_those_of_dense_samples() {
        let mut state = 12;
        for tube in TUBES {
            let bounds = bounds(tube, 0.01);
            let [low, high] = bounds.corners().expect("bodies");
            let size = (high - low).length();
            let mut met = 0;
            for _ in 0..300 {
                let mut point = || DVec3::new(unit(&mut state), unit(&mut state), unit(&mut state));
                let at = low + point() * (high - low);
                let way = direction(&mut state);
                let back = size * (2.0 * unit(&mut state) - 0.5);
                let ray = Ray { origin: at - way * back, direction: way };
                let found = found(&bounds, &ray);
                assert!(found.iter().all(|[from, to]| 0.0 <= *from && from <= to));
                assert!(found.windows(2).all(|pair| pair[0][1] < pair[1][0]));
                met += usize::from(!found.is_empty());
                for step in 0..500 {
                    let t = 3.0 * size * (f64::from(step) + 0.37) / 500.0;
                    let point = ray.at(t);
                    let inside = found.iter().any(|[from, to]| *from <= t && t <= *to);
                    // Within rounding of a surface it may be either.
                    let is_near = bounds.distance(point).abs() < 1e-9
                        || found.iter().flatten().any(|end| (end - t).abs() < 1e-7);
                    assert!(is_near || bounds.contains(point) == inside, "{tube}: {ray:?} at {t}, {found:?}");
                }
            }
            assert!(met > 100, "{tube}: {met} rays met something");
        }
    }

    #[test]
    fn chords_have_their_closed_forms() {
        // Slack is a hundredth of a voxel, on both sides, over the sine of the angle at which surfaces are met.
        let h = 1e-6;
        let cylinder =
            bounds("curve = { points = [[0,0,0],[0,0,1],[0,0,2]] }\nradius = 0.5\ncaps = 'flat'", h);
        let close = |found: Vec<Interval>, truth: &[Interval]| {
            assert_eq!(found.len(), truth.len(), "{found:?}, not {truth:?}");
            for (found, truth) in found.iter().flatten().zip(truth.iter().flatten()) {
                assert!((found - truth).abs() < 2e-5, "{found}, not {truth}");
            }
        };
        // Along the axis, across it, from inside, beside it, and a chord at 0.3 of the radius's 0.5: half of it 0.4.
        close(found(&cylinder, &ray([0.0, 0.0, -1.0], [0.0, 0.0, 1.0])), &[[1.0, 3.0]]);
        close(found(&cylinder, &ray([0.2, 0.1, -1.0], [0.0, 0.0, 1.0])), &[[1.0, 3.0]]);
        close(found(&cylinder, &ray([-3.0, 0.0, 1.0], [1.0, 0.0, 0.0])), &[[2.5, 3.5]]);
        close(found(&cylinder, &ray([0.0, 0.0, 1.0], [1.0, 0.0, 0.0])), &[[0.0, 0.5]]);
        close(found(&cylinder, &ray([-3.0, 0.3, 1.0], [1.0, 0.0, 0.0])), &[[2.6, 3.4]]);
        close(found(&cylinder, &ray([-3.0, 0.51, 1.0], [1.0, 0.0, 0.0])), &[]);
        close(found(&cylinder, &ray([-3.0, 0.0, 2.1], [1.0, 0.0, 0.0])), &[]);
        close(found(&cylinder, &ray([3.0, 0.0, 1.0], [1.0, 0.0, 0.0])), &[]);
        let slanted = found(&cylinder, &ray([-1.0, 0.0, 0.0], [1.0, 0.0, 1.0]));
        close(slanted, &[[0.5 * 2.0_f64.sqrt(), 1.5 * 2.0_f64.sqrt()]]);
        // The grazing ray.
        let graze = found(&cylinder, &ray([-3.0, 0.5, 1.0], [1.0, 0.0, 0.0]));
        assert!(graze.len() == 1 && graze[0][1] - graze[0][0] < 1e-2);
        // A cone whose radius is z / 2, from z = 0.2 to 2: across it at z = 1; and along its side's direction, inside it.
        let tip = bounds(
            "curve = { points = [[0,0,0.2],[0,0,1.1],[0,0,2]] }\nradius = [[0, 0.1], [1, 1]]\ncaps = 'flat'",
            h,
        );
        close(found(&tip, &ray([-3.0, 0.0, 1.0], [1.0, 0.0, 0.0])), &[[2.5, 3.5]]);
        close(found(&tip, &ray([-3.0, 0.3, 1.0], [1.0, 0.0, 0.0])), &[[2.6, 3.4]]);
        // At 45 degrees from (-1, 0, 0) the side -x = z / 2 is met at 2 / 3, the end z = 2 at x = 1.
        close(
            found(&tip, &ray([-1.0, 0.0, 0.0], [1.0, 0.0, 1.0])),
            &[[2.0 / 3.0 * 2.0_f64.sqrt(), 2.0 * 2.0_f64.sqrt()]],
        );
        // Parallel to the side x = z / 2, a quarter to its left: inside until the end.
        let unit = 1.25_f64.sqrt();
        let side = found(&tip, &ray([-0.25, 0.0, 0.0], [0.5, 0.0, 1.0]));
        close(side, &[[0.25 * unit, 2.0 * unit]]);
        // Steeper than 45 degrees, so that a ray along the axis enters through the side.
        let wide = bounds(
            "curve = { points = [[0,0,0],[0,0,0.5],[0,0,1]] }\nradius = [[0, 0.5], [1, 3.5]]\ncaps = 'flat'",
            h,
        );
        close(found(&wide, &ray([2.0, 0.0, -1.0], [0.0, 0.0, 1.0])), &[[1.5, 2.0]]);
        close(found(&wide, &ray([2.0, 0.0, 4.0], [0.0, 0.0, -1.0])), &[[3.0, 3.5]]);
        // A ball's half: the chord at 0.3 of the radius 0.5, beyond the end at z = 2.
        let round = bounds("curve = { points = [[0,0,0],[0,0,1],[0,0,2]] }\nradius = 0.5\ncaps = 'round'", h);
        close(found(&round, &ray([-3.0, 0.0, 2.3], [1.0, 0.0, 0.0])), &[[2.6, 3.4]]);
        close(found(&round, &ray([0.0, 0.0, -3.0], [0.0, 0.0, 1.0])), &[[2.5, 5.5]]);
    }

    #[test]
    fn scale_and_place_change_nothing() {
        // A chord at 0.6 of the radius, of half length 0.8 radii, seen from 10 and from 1e6 radii away.
        for scale in [1e-6, 1.0, 1e8] {
            for away in [10.0, 1e6] {
                let tube = format!(
                    "curve = {{ points = [[0,0,0],[0,0,{scale}],[0,0,{}]] }}\nradius = {scale}\ncaps = 'flat'",
                    2.0 * scale
                );
                let bounds = bounds(&tube, 1e-4 * scale);
                let ray = ray([-away * scale, 0.6 * scale, scale], [1.0, 0.0, 0.0]);
                let found = found(&bounds, &ray);
                let truth = [(away - 0.8) * scale, (away + 0.8) * scale];
                assert_eq!(found.len(), 1);
                for (found, truth) in found[0].iter().zip(truth) {
                    // The slack of a hundredth of a voxel, over the sine of the angle, and rounding of the distance.
                    assert!((found - truth).abs() < (2e-5 + 1e-15 * away) * scale, "{found}, not {truth}");
                }
            }
        }
    }

    #[test]
    fn they_hold_little_else() {
        // Against the points with density, hard and flat so that all of the tube counts.
        let mut state = 13;
        for (tube, most) in [(TUBES[0], 1.03), (TUBES[2], 1.05), (TUBES[4], 1.03), (TUBES[7], 1.03)] {
            let text = format!("[bake]\nwiden = false\n[[tube]]\nenvelope = {{ radial = 'hard' }}\n{tube}");
            let scene = Scene::parse(&text, "scene.toml").expect("valid");
            let field = Field::compile(&scene);
            let lattice = Lattice { voxel_size: 0.01 };
            let bounds = TubeBounds::new(&field, lattice);
            let [low, high] = field.bounds().expect("density");
            let mut point = || DVec3::new(unit(&mut state), unit(&mut state), unit(&mut state));
            let points: Vec<DVec3> = (0..200_000).map(|_| low + point() * (high - low)).collect();
            let level = crate::num::Level::best();
            let densities =
                crate::volume::density_at(&field, lattice, &points, level, 1 << 30).expect("small");
            let dense = densities.iter().filter(|density| **density > 0.0).count();
            let held = points.iter().filter(|point| bounds.contains(**point)).count();
            #[allow(clippy::cast_precision_loss, reason = "counts")]
            let ratio = held as f64 / dense as f64;
            assert!((1.0..most).contains(&ratio), "{tube}: {ratio} of it, {} bodies", bounds.bodies());
        }
    }

    #[test]
    fn distances_are_never_too_long() {
        let mut state = 14;
        for tube in TUBES {
            let bounds = bounds(tube, 0.01);
            let [low, high] = bounds.corners().expect("bodies");
            for _ in 0..500 {
                let mut point =
                    || DVec3::new(unit(&mut state), unit(&mut state), unit(&mut state)) * 3.0 - 1.0;
                let at = low + point() * (high - low);
                let distance = bounds.distance(at);
                assert_eq!(distance <= 0.0, bounds.contains(at));
                let brute = bounds.hulls.iter().map(|hull| hull.distance(at)).fold(f64::INFINITY, f64::min);
                assert_eq!(distance, brute);
                if distance > 0.0 {
                    for _ in 0..20 {
                        let found = found(&bounds, &Ray { origin: at, direction: direction(&mut state) });
                        assert!(found.iter().all(|[from, _]| *from >= distance * (1.0 - 1e-9)));
                    }
                }
            }
        }
    }

    #[test]
    fn the_tree_finds_what_all_bodies_are() {
        let mut state = 15;
        for tube in TUBES {
            let bounds = bounds(tube, 0.003);
            let [low, high] = bounds.corners().expect("bodies");
            for _ in 0..200 {
                let mut point = || DVec3::new(unit(&mut state), unit(&mut state), unit(&mut state));
                let origin = low + (point() * 2.0 - 0.5) * (high - low);
                let ray = Ray { origin, direction: direction(&mut state) };
                let found = found(&bounds, &ray);
                let length: f64 = found.iter().map(|[from, to]| to - from).sum();
                let mut all: Vec<Interval> = bounds
                    .hulls
                    .iter()
                    .filter_map(|hull| hull.interval(&ray))
                    .filter(|i| i[1] >= 0.0)
                    .collect();
                all.sort_by(|a, b| a[0].total_cmp(&b[0]));
                let (mut end, mut sum) = (0.0_f64, 0.0);
                for [from, to] in all {
                    sum += (to - from.max(end)).max(0.0);
                    end = end.max(to);
                }
                assert!((sum - length).abs() < 1e-12, "{sum}, not {length}");
            }
        }
    }

    #[test]
    fn nothing_is_met_where_there_is_nothing() {
        let bounds = TubeBounds::of(Vec::new());
        assert!(found(&bounds, &ray([0.0; 3], [1.0, 0.0, 0.0])).is_empty());
        assert!(!bounds.contains(DVec3::ZERO) && bounds.distance(DVec3::ZERO) == f64::INFINITY);
    }
}
