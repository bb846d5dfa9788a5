//! A tube's feet by dense bracketing, and what the density's definition makes of them: slow and plain, from control
//! points alone.

use glam::DVec3;

/// Fixed pseudo-random numbers (Steele, Lea and Flood's SplitMix64, 2014).
#[derive(Debug, Clone)]
pub(crate) struct Random(pub(crate) u64);

impl Random {
    pub(crate) fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    /// Uniform in [0, 1).
    pub(crate) fn unit(&mut self) -> f64 {
        (self.bits() >> 11) as f64 / 9_007_199_254_740_992.0
    }

    pub(crate) fn within(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }

    /// Uniform in the cube from -1 to 1.
    pub(crate) fn point(&mut self) -> DVec3 {
        DVec3::new(self.within(-1.0, 1.0), self.within(-1.0, 1.0), self.within(-1.0, 1.0))
    }
}

/// What a test measured, for whoever runs it with `--nocapture`.
#[allow(clippy::print_stdout, reason = "asked for with --nocapture")]
pub(crate) fn show(line: &str) {
    println!("{line}");
}

/// A place of an axis that is nearest to a point among its neighbours.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Foot {
    /// Arc length from the start of the axis.
    pub(crate) arc: f64,
    pub(crate) distance: f64,
    /// `1 - kappa rho cos`; 1 at corners and ends.
    pub(crate) focal: f64,
}

impl Foot {
    /// `smoothstep(0, 0.2, 1 - kappa rho cos)`.
    pub(crate) fn fade(&self) -> f64 {
        smoothstep(self.focal / 0.2)
    }
}

/// `t^2 (3 - 2 t)` with t clamped to [0, 1].
pub(crate) fn smoothstep(t: f64) -> f64 {
    let t = t.clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// A chain of Bezier segments of degree 2 or 3, sampled densely.
#[derive(Debug, Clone)]
pub(crate) struct Axis {
    pub(crate) segments: Vec<Bezier>,
    /// Arc length at the start of every segment, and at the end of the last.
    starts: Vec<f64>,
}

/// One segment, with samples that are dense where it is slow.
#[derive(Debug, Clone)]
pub(crate) struct Bezier {
    /// Control points; of a quadratic three.
    pub(crate) points: Vec<DVec3>,
    /// Those of the first two derivatives.
    first: Vec<DVec3>,
    second: Vec<DVec3>,
    samples: Vec<Sample>,
    /// Boxes around the curve, from every `BOX`th sample to the next.
    boxes: Vec<[DVec3; 2]>,
}

#[derive(Debug, Clone, Copy)]
struct Sample {
    t: f64,
    at: DVec3,
    d1: DVec3,
    /// Arc length from the segment's start.
    arc: f64,
}

/// Even samples of a segment.
const SAMPLES: u32 = 192;

/// Samples in a box.
const BOX: usize = 16;

/// De Casteljau's value.
fn casteljau(points: &[DVec3], t: f64) -> DVec3 {
    let mut row = [DVec3::ZERO; 4];
    row[..points.len()].copy_from_slice(points);
    for last in (1..points.len()).rev() {
        for i in 0..last {
            row[i] = row[i] * (1.0 - t) + row[i + 1] * t;
        }
    }
    row[0]
}

/// Control points of the derivative.
fn hodograph(points: &[DVec3]) -> Vec<DVec3> {
    let degree = points.len() as f64 - 1.0;
    points.windows(2).map(|pair| (pair[1] - pair[0]) * degree).collect()
}

impl Bezier {
    pub(crate) fn new(points: &[DVec3]) -> Bezier {
        let even = || (0..=SAMPLES).map(|i| f64::from(i) / f64::from(SAMPLES));
        let first = hodograph(points);
        let speed = |t: f64| casteljau(&first, t).length();
        let mut grid: Vec<f64> = even().collect();
        for window in even().collect::<Vec<_>>().windows(3) {
            let [a, b, c] = [speed(window[0]), speed(window[1]), speed(window[2])];
            if b <= a && b <= c {
                // Towards the slowest place by halves: arc length has its kinks, and feet crowd, where speed vanishes.
                let slowest = least(window[0], window[2], speed);
                grid.push(slowest);
                for k in 8..48 {
                    let aside = libm::exp2(-f64::from(k));
                    grid.extend([slowest - aside, slowest + aside].iter().filter(|t| **t > 0.0 && **t < 1.0));
                }
            }
        }
        for (end, toward) in [(0.0, 1.0), (1.0, -1.0)] {
            if speed(end) == 0.0 {
                grid.extend((8..48).map(|k| end + toward * libm::exp2(-f64::from(k))));
            }
        }
        grid.sort_by(f64::total_cmp);
        grid.dedup();
        let mut arc = 0.0;
        let mut samples: Vec<Sample> = Vec::with_capacity(grid.len());
        for &t in &grid {
            if let Some(before) = samples.last() {
                arc += gauss(before.t, t, speed);
            }
            samples.push(Sample { t, at: casteljau(points, t), d1: casteljau(&first, t), arc });
        }
        let boxes = (0..samples.len() - 1).step_by(BOX).map(|start| {
            let part = &samples[start..samples.len().min(start + BOX + 1)];
            // No point is farther than a step from a sample.
            let step = part.windows(2).map(|pair| pair[1].arc - pair[0].arc).fold(0.0, f64::max);
            let low = part.iter().fold(DVec3::INFINITY, |low, sample| low.min(sample.at));
            let high = part.iter().fold(DVec3::NEG_INFINITY, |high, sample| high.max(sample.at));
            [low - step, high + step]
        });
        let boxes = boxes.collect();
        let second = hodograph(&first);
        Bezier { points: points.to_vec(), first, second, samples, boxes }
    }

    pub(crate) fn at(&self, t: f64) -> DVec3 {
        casteljau(&self.points, t)
    }

    pub(crate) fn d1(&self, t: f64) -> DVec3 {
        casteljau(&self.first, t)
    }

    pub(crate) fn d2(&self, t: f64) -> DVec3 {
        casteljau(&self.second, t)
    }

    pub(crate) fn length(&self) -> f64 {
        self.samples[self.samples.len() - 1].arc
    }

    /// Largest curvature over the samples.
    pub(crate) fn curvature(&self) -> f64 {
        let curvature = |sample: &Sample| {
            let speed = sample.d1.length();
            sample.d1.cross(self.d2(sample.t)).length() / (speed * speed * speed)
        };
        self.samples.iter().map(curvature).fold(0.0, f64::max)
    }

    /// Unit tangent at an end, where C' may vanish.
    fn end_tangent(&self, last: bool) -> DVec3 {
        let (end, inner): (DVec3, Vec<DVec3>) = if last {
            (self.points[self.points.len() - 1], self.points.iter().rev().skip(1).copied().collect())
        } else {
            (self.points[0], self.points[1..].to_vec())
        };
        let other = inner.into_iter().find(|p| *p != end).expect("a segment with a length");
        (if last { end - other } else { other - end }).normalize()
    }

    /// Adds every t in [0, 1] where `(C - p) . C'` changes from negative to positive within `reach` of p, and some beyond.
    fn brackets(&self, p: DVec3, reach: f64, out: &mut Vec<f64>) {
        let shifted: Vec<DVec3> = self.points.iter().map(|q| *q - p).collect();
        let g = |t: f64| casteljau(&shifted, t).dot(casteljau(&self.first, t));
        let sampled = |i: usize| (self.samples[i].at - p).dot(self.samples[i].d1);
        let last = self.samples.len() - 1;
        for (number, [low, high]) in self.boxes.iter().enumerate() {
            let outside = (*low - p).max(p - *high).max(DVec3::ZERO);
            if outside.length_squared() > reach * reach {
                continue;
            }
            let end = ((number + 1) * BOX).min(last);
            for i in number * BOX..end {
                let (here, after) = (sampled(i), sampled(i + 1));
                let (to, end) = (self.samples[i].t, self.samples[i + 1].t);
                if here < 0.0 && after >= 0.0 {
                    out.push(root(to, end, g));
                }
                // Between samples of one sign, the function may dip to the other and back.
                if i == 0 || (here < 0.0) != (after < 0.0) {
                    continue;
                }
                let (from, before) = (self.samples[i - 1].t, sampled(i - 1));
                if here > 0.0 && here <= before && here <= after {
                    let bottom = least(from, end, g);
                    if g(bottom) < 0.0 {
                        out.push(root(bottom, end, g));
                    }
                } else if here < 0.0 && here >= before && here >= after {
                    let top = least(from, end, |t| -g(t));
                    if g(top) > 0.0 {
                        out.push(root(from, top, g));
                    }
                }
            }
        }
    }

    fn foot(&self, t: f64, p: DVec3) -> Foot {
        let (arm, d1) = (p - self.at(t), self.d1(t));
        let next = self.samples.partition_point(|sample| sample.t <= t).max(1);
        let before = self.samples[next - 1];
        let square = d1.length_squared();
        let focal = if square > 1e-20 * self.length() * self.length() {
            1.0 - arm.dot(self.d2(t)) / square
        } else {
            1.0
        };
        let arc = before.arc + gauss(before.t, t, |t| self.d1(t).length());
        Foot { arc, distance: arm.length(), focal }
    }
}

impl Axis {
    pub(crate) fn new(segments: &[Vec<DVec3>]) -> Axis {
        let segments: Vec<Bezier> = segments.iter().map(|points| Bezier::new(points)).collect();
        let mut starts = vec![0.0];
        for segment in &segments {
            starts.push(starts[starts.len() - 1] + segment.length());
        }
        Axis { segments, starts }
    }

    pub(crate) fn length(&self) -> f64 {
        self.starts[self.segments.len()]
    }

    /// The two ends, with unit tangents that point out of the curve.
    pub(crate) fn ends(&self) -> [(DVec3, DVec3); 2] {
        let (first, last) = (&self.segments[0], &self.segments[self.segments.len() - 1]);
        [
            (first.points[0], -first.end_tangent(false)),
            (last.points[last.points.len() - 1], last.end_tangent(true)),
        ]
    }

    /// Every foot within `reach` of p inside the curve, and with round caps those on its ends.
    pub(crate) fn feet(&self, p: DVec3, reach: f64, round: bool) -> Vec<Foot> {
        let mut feet = Vec::new();
        let mut roots = Vec::new();
        for (i, segment) in self.segments.iter().enumerate() {
            roots.clear();
            segment.brackets(p, reach, &mut roots);
            // Where the curve stands at an end, the equation holds there for every p.
            let stands = [0.0, 1.0].map(|t| segment.d1(t).length() == 0.0);
            roots.retain(|t| !(stands[0] && *t < 1e-9 || stands[1] && *t > 1.0 - 1e-9));
            for &t in &roots {
                let foot = segment.foot(t, p);
                feet.push(Foot { arc: self.starts[i] + foot.arc, ..foot });
            }
            let Some(next) = self.segments.get(i + 1) else { continue };
            let arm = p - next.points[0];
            let (before, after) = (segment.end_tangent(true), next.end_tangent(false));
            if arm.dot(before) >= 0.0 && arm.dot(after) <= 0.0 {
                let focal = if before.distance(after) < 1e-9 { segment.foot(1.0, p).focal } else { 1.0 };
                feet.push(Foot { arc: self.starts[i + 1], distance: arm.length(), focal });
            }
        }
        if round {
            for ((end, outward), arc) in self.ends().into_iter().zip([0.0, self.length()]) {
                let arm = p - end;
                if arm.dot(outward) > 0.0 {
                    feet.push(Foot { arc, distance: arm.length(), focal: 1.0 });
                }
            }
        }
        feet.retain(|foot| foot.distance <= reach);
        feet
    }
}

/// A root by bisection, of a function negative at `low` and at least 0 at `high`.
fn root(mut low: f64, mut high: f64, value: impl Fn(f64) -> f64) -> f64 {
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if value(middle) < 0.0 {
            low = middle;
        } else {
            high = middle;
        }
    }
    high
}

/// The least place of a function that falls and rises.
fn least(mut low: f64, mut high: f64, value: impl Fn(f64) -> f64) -> f64 {
    for _ in 0..80 {
        let third = (high - low) / 3.0;
        if value(low + third) <= value(high - third) {
            high -= third;
        } else {
            low += third;
        }
    }
    0.5 * (low + high)
}

/// Five-point Gauss-Legendre.
pub(crate) fn gauss(a: f64, b: f64, value: impl Fn(f64) -> f64) -> f64 {
    const NODES: [(f64, f64); 5] = [
        (-0.906_179_845_938_664, 0.236_926_885_056_189_1),
        (-0.538_469_310_105_683_1, 0.478_628_670_499_366_5),
        (0.0, 0.568_888_888_888_888_9),
        (0.538_469_310_105_683_1, 0.478_628_670_499_366_5),
        (0.906_179_845_938_664, 0.236_926_885_056_189_1),
    ];
    let (middle, half) = (0.5 * (a + b), 0.5 * (b - a));
    NODES.iter().map(|(x, w)| w * value(middle + half * x)).sum::<f64>() * half
}
