use vdbake::{noise::*, num::*};
struct Bare<'a> {
    o: &'a [Octave<f32>],
    x: &'a [f32],
    y: &'a [f32],
    z: &'a [f32],
    out: &'a mut [f32],
    faded: bool,
}
impl WithLevel for Bare<'_> {
    type Output = ();
    #[inline(always)]
    fn run<R: Real<Scalar = f32>>(self, t: R::Token) {
        let mut i = 0;
        while i < self.x.len() {
            let p = [R::load(t, &self.x[i..]), R::load(t, &self.y[i..]), R::load(t, &self.z[i..])];
            let mut s = R::constant(t, 0.0);
            for o in self.o {
                let mut v = o.value(t, p);
                if self.faded {
                    v = v * band_weight(t, p[0]);
                }
                s = s + v;
            }
            s.store(&mut self.out[i..]);
            i += 16;
        }
    }
}
#[inline(never)]
fn bare(l: Level, b: Bare) {
    with_level(l, b)
}
fn main() {
    let n = 2048;
    let mut r = 1u64;
    let mut f = || {
        r = r.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        ((r >> 40) as f32 / 16777216.0 - 0.5) * 40.0
    };
    let (x, y, z): (Vec<f32>, Vec<f32>, Vec<f32>) =
        ((0..n).map(|_| f()).collect(), (0..n).map(|_| f()).collect(), (0..n).map(|_| f()).collect());
    let o: Vec<Octave<f32>> =
        (0..5).map(|k| Octave::new([0.3, 0.2, 0.1], [(1 << k) as f64; 3], k, 0.5)).collect();
    let mut out = vec![0.0; n];
    for _ in 0..5 {
        for faded in [false, true] {
            let t = cpu_time::ThreadTime::now();
            for _ in 0..500 {
                bare(Level::best(), Bare { o: &o, x: &x, y: &y, z: &z, out: &mut out, faded });
                std::hint::black_box(&out);
            }
            println!(
                "faded {faded} {:.2} ns per octave-sample",
                t.elapsed().as_secs_f64() * 1e9 / 500.0 / n as f64 / 5.0
            );
        }
    }
}
