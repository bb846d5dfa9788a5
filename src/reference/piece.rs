//! A stretch of a segment that is slow nowhere but, perhaps, at its start.

use super::roots;
use nalgebra::Vector3;

/// Below this fraction of the segment's size a speed is worth a cut.
const SLOW: f64 = 0.1;

/// Below this fraction of the segment's size a derivative counts as zero: rounding in the power form reaches
/// 1e-15.
const ZERO: f64 = 1e-13;

/// Curvature times the diagonal of the segment's axis-aligned box below which there is no principal normal.
const STRAIGHT: f64 = 1e-6;

/// `P(x) = C(t)` at `t = t0 + dt x`, x in [0, 1]; `dt < 0` runs against the curve.
///
/// Where the curve all but stands still it does so at x = 0: near it C' keeps its digits there, and however
/// sharply it turns the tangent has no noise. Where it does stand still, at a cusp, `P'(x) = x^m D(x)` with D
/// not 0, so the tangent is D's direction.
#[derive(Debug, Clone)]
pub(super) struct Piece {
    pub(super) segment: usize,
    pub(super) t0: f64,
    pub(super) dt: f64,
    m: i32,
    point: [Vector3<f64>; 4],
    direction: [Vector3<f64>; 3],
    straight: bool,
    /// Whether the frame is Frenet's.
    frenet: bool,
}

/// How the curve runs at one x of a piece.
pub(super) struct Local {
    /// Unit tangent towards larger x.
    pub(super) tangent: Vector3<f64>,
    /// Derivative of the unit tangent by x.
    pub(super) turn: Vector3<f64>,
    /// `|P'|`, metres.
    pub(super) speed: f64,
}

impl Piece {
    /// The pieces of segment number `segment` with power coefficients `c`, along the curve.
    ///
    /// With `frenet` they are cut, too, where the curvature passes [`STRAIGHT`]. None where all control
    /// points coincide.
    pub(super) fn cut(segment: usize, c: &[Vector3<f64>; 4], frenet: bool) -> Vec<Piece> {
        let size = c[1..].iter().map(|c| c.norm()).fold(0.0, f64::max);
        if size == 0.0 {
            return Vec::new();
        }
        let speed = |t: f64| (c[1] + 2.0 * t * c[2] + 3.0 * t * t * c[3]).norm();
        let slow = |t: f64| speed(t) <= SLOW * size;
        let (v, a, j) = (c[1], 2.0 * c[2], 6.0 * c[3]);
        // |C'|^2 has its minima where C' . C'' = 0.
        let slowing = [v.dot(&a), a.dot(&a) + v.dot(&j), 1.5 * a.dot(&j), 0.5 * j.dot(&j)];
        let mut cuts: Vec<f64> = roots::sign_changes(&slowing).into_iter().filter(|&t| slow(t)).collect();
        if frenet {
            let unit = c.map(|c| c / size);
            cuts.extend(roots::sign_changes(&excess_curvature(&unit, STRAIGHT / diagonal(&unit))));
        }
        cuts.extend([0.0, 1.0]);
        cuts.sort_by(f64::total_cmp);
        cuts.dedup();
        let mut pieces = Vec::new();
        for end in cuts.windows(2) {
            let middle = 0.5 * (end[0] + end[1]);
            let mut add = |t0, t1| pieces.push(Piece::between(segment, c, size, t0, t1));
            match (slow(end[0]), slow(end[1])) {
                (_, false) => add(end[0], end[1]),
                (false, true) => add(end[1], end[0]),
                (true, true) => {
                    add(end[0], middle);
                    add(end[1], middle);
                }
            }
        }
        for piece in &mut pieces {
            let local = piece.local(0.5);
            piece.frenet =
                frenet && !piece.straight && local.turn.norm() * diagonal(c) >= STRAIGHT * local.speed;
        }
        pieces
    }

    fn between(segment: usize, c: &[Vector3<f64>; 4], size: f64, t0: f64, t1: f64) -> Piece {
        let dt = t1 - t0;
        let mut point = [
            c[0] + t0 * (c[1] + t0 * (c[2] + t0 * c[3])),
            dt * (c[1] + t0 * (2.0 * c[2] + 3.0 * t0 * c[3])),
            dt * dt * (c[2] + 3.0 * t0 * c[3]),
            dt * dt * dt * c[3],
        ];
        let mut m = 0;
        if point[1].norm() <= ZERO * size * dt.abs() {
            point[1] = Vector3::zeros();
            m = 1;
            if point[2].norm() <= ZERO * size * dt * dt {
                point[2] = Vector3::zeros();
                m = 2;
            }
        }
        let slope = [point[1], 2.0 * point[2], 3.0 * point[3], Vector3::zeros(), Vector3::zeros()];
        let mut direction = match m {
            0 => [slope[0], slope[1], slope[2]],
            1 => [slope[1], slope[2], slope[3]],
            _ => [slope[2], slope[3], slope[4]],
        };
        // On a straight line the tangent is taken from its longest vector: rounding must not turn it where D
        // is small.
        let longest = *direction.iter().max_by(|a, b| a.norm().total_cmp(&b.norm())).expect("three of them");
        let line = longest.normalize();
        let straight = direction.iter().all(|d| d.cross(&line).norm() <= ZERO * longest.norm());
        if straight {
            direction = direction.map(|d| line * d.dot(&line));
        }
        Piece { segment, t0, dt, m, point, direction, straight, frenet: false }
    }

    pub(super) fn t(&self, x: f64) -> f64 {
        self.t0 + self.dt * x
    }

    /// Whether x grows against the curve.
    pub(super) fn reversed(&self) -> bool {
        self.dt < 0.0
    }

    /// The x where the curve leaves the piece.
    pub(super) fn exit(&self) -> f64 {
        if self.reversed() { 0.0 } else { 1.0 }
    }

    /// Whether it lies on a line.
    pub(super) fn straight(&self) -> bool {
        self.straight
    }

    /// Bound of `|P'|` on the piece.
    pub(super) fn top_speed(&self) -> f64 {
        self.point[1].norm() + 2.0 * self.point[2].norm() + 3.0 * self.point[3].norm()
    }

    pub(super) fn point(&self, x: f64) -> Vector3<f64> {
        self.point[0] + x * (self.point[1] + x * (self.point[2] + x * self.point[3]))
    }

    pub(super) fn direction(&self, x: f64) -> Vector3<f64> {
        self.direction[0] + x * (self.direction[1] + x * self.direction[2])
    }

    fn direction_slope(&self, x: f64) -> Vector3<f64> {
        self.direction[1] + 2.0 * x * self.direction[2]
    }

    pub(super) fn local(&self, x: f64) -> Local {
        let d = self.direction(x);
        let length = d.norm();
        let tangent = d / length;
        let slope = self.direction_slope(x);
        let turn = (slope - slope.dot(&tangent) * tangent) / length;
        Local { tangent, turn, speed: length * self.power(x) }
    }

    /// `x^m`.
    pub(super) fn power(&self, x: f64) -> f64 {
        (0..self.m).fold(1.0, |power, _| power * x)
    }

    /// Unit tangent along the curve.
    pub(super) fn tangent_along(&self, x: f64) -> Vector3<f64> {
        let tangent = self.direction(x).normalize();
        if self.reversed() { -tangent } else { tangent }
    }

    /// The principal normal, where the piece is one that takes its frame from it.
    pub(super) fn principal(&self, x: f64) -> Option<Vector3<f64>> {
        if self.frenet { self.local(x).turn.try_normalize(0.0) } else { None }
    }

    /// A unit normal of the plane that the piece lies in at its start.
    pub(super) fn plane_normal(&self) -> Vector3<f64> {
        let flat = self.direction[0].cross(&self.direction[1]);
        let normal = if flat.norm() > 0.0 { flat } else { self.direction[0].cross(&self.direction[2]) };
        normal.normalize()
    }

    /// Every x where the distance from p to the piece has a local minimum, the ends included only where the
    /// normal plane there goes through p exactly.
    pub(super) fn feet(&self, p: &Vector3<f64>) -> Vec<f64> {
        let arm = [self.point[0] - p, self.point[1], self.point[2], self.point[3]];
        // (P - p) . D; its sign is that of the distance's slope.
        let mut product = [0.0; 6];
        for (i, arm) in arm.iter().enumerate() {
            for (j, direction) in self.direction.iter().enumerate() {
                product[i + j] += arm.dot(direction);
            }
        }
        let slope: Vec<f64> = product[1..].iter().zip(1..).map(|(c, k)| c * f64::from(k)).collect();
        let mut ends = vec![0.0];
        ends.extend(roots::sign_changes(&slope));
        ends.push(1.0);
        let value = |x: f64| (self.point(x) - p).dot(&self.direction(x));
        let mut feet = Vec::new();
        for (i, end) in ends.windows(2).enumerate() {
            let (left, right) = (value(end[0]), value(end[1]));
            if left < 0.0 && right >= 0.0 {
                feet.push(roots::bisect(end[0], end[1], value));
            } else if i == 0 && left == 0.0 && right > 0.0 {
                feet.push(end[0]);
            }
        }
        feet
    }
}

/// The diagonal of the segment's axis-aligned box.
fn diagonal(c: &[Vector3<f64>; 4]) -> f64 {
    let sides = Vector3::from_fn(|axis, _| {
        let mut ends = roots::sign_changes(&[c[1][axis], 2.0 * c[2][axis], 3.0 * c[3][axis]]);
        ends.extend([0.0, 1.0]);
        let values = ends.iter().map(|t| t * (c[1][axis] + t * (c[2][axis] + t * c[3][axis])));
        let (low, high) = values.fold((0.0_f64, 0.0_f64), |(low, high), x| (low.min(x), high.max(x)));
        high - low
    });
    sides.norm()
}

/// `|C' x C''|^2 - least^2 |C'|^6`, by powers of t: positive where the curvature is above `least`.
fn excess_curvature(c: &[Vector3<f64>; 4], least: f64) -> Vec<f64> {
    let velocity = [c[1], 2.0 * c[2], 3.0 * c[3]];
    let cross = [2.0 * c[1].cross(&c[2]), 6.0 * c[1].cross(&c[3]), 6.0 * c[2].cross(&c[3])];
    let square = |a: &[Vector3<f64>; 3]| {
        let mut square = vec![0.0; 5];
        for (i, a_i) in a.iter().enumerate() {
            for (j, a_j) in a.iter().enumerate() {
                square[i + j] += a_i.dot(a_j);
            }
        }
        square
    };
    let times = |a: &[f64], b: &[f64]| {
        let mut product = vec![0.0; a.len() + b.len() - 1];
        for (i, a) in a.iter().enumerate() {
            for (j, b) in b.iter().enumerate() {
                product[i + j] += a * b;
            }
        }
        product
    };
    let speed = square(&velocity);
    let mut excess = times(&times(&speed, &speed), &speed);
    excess.iter_mut().for_each(|e| *e *= -least * least);
    excess.iter_mut().zip(square(&cross)).for_each(|(e, cross)| *e += cross);
    excess
}
