//! Bare noise: what everything is measured beside.

use cpu_time::ThreadTime;
use vdbake::noise::Octave;
use vdbake::num::{Level, Real, WithLevel, with_level};

const POINTS: usize = 2048;
const REPEATS: usize = 400;

struct Bare<'a> {
    octaves: &'a [Octave<f32>],
    points: &'a [Vec<f32>; 3],
    out: &'a mut [f32],
}

impl WithLevel for Bare<'_> {
    type Output = ();
    #[inline(always)]
    fn run<R: Real<Scalar = f32>>(self, token: R::Token) {
        for first in (0..POINTS).step_by(R::LANES) {
            let p = [
                R::load(token, &self.points[0][first..]),
                R::load(token, &self.points[1][first..]),
                R::load(token, &self.points[2][first..]),
            ];
            // In the order in which kernels sum: each octave's cell before the octave before it is blended.
            let last = self.octaves.len() - 1;
            let mut sum = R::constant(token, 0.0);
            let mut cell = self.octaves[0].cell::<R, true>(token, p);
            for k in 0..last {
                let ahead = self.octaves[k + 1].cell::<R, true>(token, p);
                sum = sum + self.octaves[k].at::<R, true>(token, &cell);
                cell = ahead;
            }
            sum = sum + self.octaves[last].at::<R, true>(token, &cell);
            sum.store(&mut self.out[first..]);
        }
    }
}

#[inline(never)]
fn sum(bare: Bare) {
    with_level(Level::best(), bare);
}

/// Nanoseconds a point of a fractal sum over points scattered in [-20, 20)^3.
pub(crate) fn bare_noise(octaves: u32) -> f64 {
    let mut state = 1_u64;
    let mut next = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (f32::from(u16::try_from(state >> 48).expect("sixteen bits")) / 65_536.0 - 0.5) * 40.0
    };
    let points = [0, 1, 2].map(|_| (0..POINTS).map(|_| next()).collect::<Vec<f32>>());
    let octaves: Vec<Octave<f32>> =
        (0..octaves).map(|k| Octave::new([0.3, 0.2, 0.1], [f64::from(1 << k); 3], k, 0.5)).collect();
    let mut out = vec![0.0; POINTS];
    let started = ThreadTime::now();
    for _ in 0..REPEATS {
        sum(Bare { octaves: &octaves, points: &points, out: &mut out });
        std::hint::black_box(&out);
    }
    started.elapsed().as_secs_f64() * 1e9 / (REPEATS * POINTS) as f64
}
