//! The box around a field's density.

use glam::DVec3;

use super::Field;
use super::span::Span;
use super::tube::{PointKind, Tube};
use crate::num::poly::evaluate;

/// Steps along a span between the places that are looked at first.
const STEPS: u32 = 16;
/// Shortenings, by 0.618 each, of the two steps around the farthest of these: to 1e-4 of them.
const SHORTENINGS: u32 = 19;

/// Corners of a box, empty at first.
#[derive(Debug, Clone, Copy)]
struct Corners([DVec3; 2]);

impl Corners {
    const NONE: Corners = Corners([DVec3::INFINITY, DVec3::NEG_INFINITY]);

    fn include(&mut self, lo: DVec3, hi: DVec3) {
        self.0 = [self.0[0].min(lo), self.0[1].max(hi)];
    }
}

impl Field {
    /// Corners of the box around the density, in metres; `None` where there is none.
    ///
    /// It is the box of the discs of radius r across the axis, and of the balls at round ends: found by search along the
    /// spans, within 1e-6 of a radius of the exact one.
    pub fn bounds(&self) -> Option<[DVec3; 2]> {
        let mut corners = Corners::NONE;
        for tube in &self.tubes {
            for span in tube.spans.iter().flatten() {
                discs(span, &mut corners);
            }
            ends(tube, &mut corners);
        }
        corners.0[0].cmple(corners.0[1]).all().then_some(corners.0)
    }
}

/// Includes the discs along a span.
fn discs(span: &Span, corners: &mut Corners) {
    let [first, last] = span.core.map(|t| (t - span.middle) / span.half);
    let step = (last - first) / f64::from(STEPS);
    let discs: Vec<[DVec3; 2]> = (0..=STEPS).map(|k| disc(span, first + step * f64::from(k))).collect();
    for [lo, hi] in &discs {
        corners.include(*lo, *hi);
    }
    for axis in 0..3 {
        for (side, sign) in [(0, -1.0), (1, 1.0)] {
            let reach = |disc: &[DVec3; 2]| sign * disc[side][axis];
            let far = |k: usize| reach(&discs[k]);
            let farthest = (1..discs.len()).fold(0, |best, k| if far(k) > far(best) { k } else { best });
            let around = [farthest.saturating_sub(1), (farthest + 1).min(discs.len() - 1)];
            // Beyond its highest sample, what is smooth rises by less than it falls to the next ones.
            let most = 2.0 * far(farthest) - far(around[0]).min(far(around[1]));
            if most <= sign * corners.0[side][axis] {
                continue;
            }
            #[allow(clippy::cast_precision_loss, reason = "below 16")]
            let interval = around.map(|k| first + step * k as f64);
            let tau = summit(interval, |tau| reach(&disc(span, tau)));
            let [lo, hi] = disc(span, tau);
            corners.include(lo, hi);
        }
    }
}

/// Corners of the box of a span's disc at tau.
fn disc(span: &Span, tau: f64) -> [DVec3; 2] {
    let [a, b, c, d] = span.position;
    let centre = a + (b + (c + d * tau) * tau) * tau;
    let tangent = (b + (2.0 * c + 3.0 * d * tau) * tau).normalize_or_zero();
    let across = (DVec3::ONE - tangent * tangent).max(DVec3::ZERO);
    let reach =
        DVec3::new(across.x.sqrt(), across.y.sqrt(), across.z.sqrt()) * evaluate(&span.radius, tau).max(0.0);
    [centre - reach, centre + reach]
}

/// Where a function that rises and then falls is highest, by golden section (Kiefer, "Sequential minimax search for a
/// maximum", 1953).
fn summit([mut low, mut high]: [f64; 2], height: impl Fn(f64) -> f64) -> f64 {
    const PART: f64 = 0.618_033_988_749_894_9;
    let mut inner = [high - PART * (high - low), low + PART * (high - low)];
    let mut heights = inner.map(&height);
    for _ in 0..SHORTENINGS {
        if heights[0] > heights[1] {
            high = inner[1];
            inner = [high - PART * (high - low), inner[0]];
            heights = [height(inner[0]), heights[0]];
        } else {
            low = inner[0];
            inner = [inner[1], low + PART * (high - low)];
            heights = [heights[1], height(inner[1])];
        }
    }
    0.5 * (low + high)
}

/// Includes the half balls at round ends, and the balls around corners.
fn ends(tube: &Tube, corners: &mut Corners) {
    for point in &tube.points {
        let (centre, radius) = (point.section.centre, point.section.radius);
        if let PointKind::End(outward) = point.kind {
            // The half ball: its disc, and the ball where it bulges outward.
            let bulge = |axis: DVec3| if outward.dot(axis) > 0.0 { radius } else { 0.0 };
            let reach = DVec3::new(bulge(DVec3::X), bulge(DVec3::Y), bulge(DVec3::Z));
            let back = DVec3::new(bulge(-DVec3::X), bulge(-DVec3::Y), bulge(-DVec3::Z));
            corners.include(centre - back, centre + reach);
        } else {
            corners.include(centre - DVec3::splat(radius), centre + DVec3::splat(radius));
        }
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "what is not there fails the test")]

    use super::*;
    use crate::scene::Scene;

    fn bounds(tube: &str) -> [DVec3; 2] {
        let text = format!("[[tube]]\n{tube}");
        Field::compile(&Scene::parse(&text, "scene.toml").unwrap()).bounds().unwrap()
    }

    /// The largest reach of thousands of discs in each direction.
    fn sampled(tube: &str) -> [DVec3; 2] {
        let text = format!("[[tube]]\n{tube}");
        let field = Field::compile(&Scene::parse(&text, "scene.toml").unwrap());
        let tube = &field.tubes[0];
        let mut corners = Corners::NONE;
        for (index, segment) in tube.curve.segments().iter().enumerate() {
            for step in 0..=200_000 {
                let t = f64::from(step) / 200_000.0;
                let x = tube.curve.arc_length(index, t) / tube.curve.length();
                let tangent = segment.tangent(t);
                let across = (DVec3::ONE - tangent * tangent).max(DVec3::ZERO);
                let reach = DVec3::new(across.x.sqrt(), across.y.sqrt(), across.z.sqrt()) * tube.radius.at(x);
                corners.include(segment.at(t) - reach, segment.at(t) + reach);
            }
        }
        corners.0
    }

    #[test]
    fn they_are_those_of_dense_samples() {
        for tube in [
            "curve = { points = [[0, 0, 0], [0.3, 0.1, 1.2], [0, 0, 2.5]] }\nradius = [[0, 0.1], [1, 0.6]]",
            "curve = { kind = 'cubic', points = [[0,0,0],[3,0,1],[-2,1,2],[1,1,0]] }\nradius = [[0,0.1],[0.4,0.3],[1,0]]",
            "curve = { points = [[0,0,0],[1,0,2],[2,0,0]] }\nradius = { kind = 'sinusoidal', mean = 0.2, amplitude = 0.1, waves = 9 }",
            "curve = { points = [[0,0,0],[1,0,2],[2,0,0]] }\nradius = [[0, 0.1], [0.5, 0.1], [0.5, 0.4], [1, 0.1]]",
        ] {
            let ([lo, hi], [low, high]) = (bounds(tube), sampled(tube));
            let error = (lo - low).abs().max((hi - high).abs()).max_element();
            // The largest radius is 0.6. A jump's second side is a step of 1e-5 away from its sample.
            let tolerance = if tube.contains("0.5, 0.4") { 1e-5 } else { 6e-7 };
            assert!(error < tolerance, "{tube}: {error:e}");
        }
    }

    #[test]
    fn a_field_without_tubes_has_none() {
        let scene = Scene::parse("name = 'nothing'", "scene.toml").unwrap();
        assert!(Field::compile(&scene).bounds().is_none());
    }
}
