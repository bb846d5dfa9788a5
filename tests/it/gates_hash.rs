//! The lattice's hash: its gradients are even, neighbours and octaves independent, axes alike. Each statistic is also
//! taken of a hash that is known to be bad.

use vdbake::noise::{octave_seed, perlin};

use crate::gates_oracle::{Random, show};

/// The gradient at a lattice corner.
type Gradients<'a> = &'a dyn Fn([u32; 3], u32) -> [i8; 3];

/// How the three axes' terms are joined.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Hash {
    Defined,
    /// Each axis mixed fully, and only then joined: a square's four corners then cancel.
    MixedFirst,
    /// z added to a hash of x and y.
    PairFirst,
}

fn gradient(hash: Hash, corner: [u32; 3], seed: u32) -> [i8; 3] {
    const FINISH: u32 = 0x27D4_EB2F;
    let shifted = |x: u32| x ^ (x >> 16);
    let mixed = |x: u32| shifted(shifted(x).wrapping_mul(0x7FEB_352D)).wrapping_mul(FINISH);
    let a = corner[0].wrapping_mul(0x9E37_79B1) ^ seed;
    let b = corner[1].wrapping_mul(0x85EB_CA77);
    let c = corner[2].wrapping_mul(0xC2B2_AE3D);
    let h = match hash {
        Hash::Defined => (shifted(a) ^ shifted(b) ^ shifted(c)).wrapping_mul(FINISH),
        Hash::MixedFirst => mixed(a) ^ mixed(b) ^ mixed(c),
        Hash::PairFirst => (shifted(a) ^ shifted(b)).wrapping_mul(FINISH).wrapping_add(c),
    };
    let signed = h.cast_signed();
    let (first, second) = if signed < -715_827_882 {
        (0, 1)
    } else if signed > 715_827_882 {
        (1, 2)
    } else {
        (0, 2)
    };
    let sign = |bit: u32| if h >> bit & 1 == 1 { -1 } else { 1 };
    let mut gradient = [0; 3];
    gradient[first] = sign(22);
    gradient[second] = sign(21);
    gradient
}

fn good(corner: [u32; 3], seed: u32) -> [i8; 3] {
    gradient(Hash::Defined, corner, seed)
}

/// 0 to 11.
fn index(gradient: [i8; 3]) -> usize {
    let (pair, signs) = match gradient {
        [x, y, 0] => (0, [x, y]),
        [0, y, z] => (1, [y, z]),
        [x, _, z] => (2, [x, z]),
    };
    4 * pair + 2 * usize::from(signs[0] < 0) + usize::from(signs[1] < 0)
}

/// The product's gradient, felt out beside the corner, where the noise is the gradient times the way.
#[test]
fn the_product_has_the_gradients_of_the_definition() {
    let mut random = Random(31);
    let step = 1e-3;
    for _ in 0..20_000 {
        let bits = random.bits();
        #[allow(clippy::cast_possible_truncation, reason = "bits")]
        let (cell, seed) = ([bits as u32, (bits >> 20) as u32, (bits >> 40) as u32], (bits >> 13) as u32);
        let felt = [0, 1, 2].map(|axis| {
            let mut p = [0.0; 3];
            p[axis] = step;
            // Next corners have weights below 10 step^3.
            #[allow(clippy::cast_possible_truncation, reason = "-1, 0 or 1")]
            let whole = (perlin::<f64>((), cell, p, seed) / step).round() as i8;
            whole
        });
        assert_eq!(felt, good(cell, seed), "{cell:?}");
    }
}

const EDGE: u32 = 48;
/// Corners around the lattice that are only neighbours.
const RIM: u32 = 2;
const WIDE: u32 = EDGE + 2 * RIM;
const ORIGINS: [u32; 4] = [0, 100_000, 10_000_000, 1_000_003_u32.wrapping_neg()];
/// One of each two opposite neighbours, and one farther.
const OFFSETS: [[i32; 3]; 14] = [
    [1, 0, 0],
    [0, 1, 0],
    [0, 0, 1],
    [1, 1, 0],
    [1, -1, 0],
    [0, 1, 1],
    [0, 1, -1],
    [1, 0, 1],
    [1, 0, -1],
    [1, 1, 1],
    [1, 1, -1],
    [1, -1, 1],
    [-1, 1, 1],
    [2, 0, 0],
];

/// Indices of the gradients on a lattice and its rim.
fn lattice(gradients: Gradients<'_>, origin: u32) -> Vec<u8> {
    let corner = |i: u32| [i / WIDE / WIDE, i / WIDE % WIDE, i % WIDE].map(|x| origin.wrapping_add(x));
    let at = |i| u8::try_from(index(gradients(corner(i), 1))).expect("below 12");
    (0..WIDE * WIDE * WIDE).map(at).collect()
}

fn at(lattice: &[u8], x: [u32; 3]) -> usize {
    usize::from(lattice[((x[0] * WIDE + x[1]) * WIDE + x[2]) as usize])
}

fn corners() -> impl Iterator<Item = [u32; 3]> {
    (0..EDGE * EDGE * EDGE).map(|i| [i / EDGE / EDGE, i / EDGE % EDGE, i % EDGE].map(|x| x + RIM))
}

/// Chi squared over its degrees of freedom, against equal counts.
fn chi_squared(counts: &[u32]) -> f64 {
    let expected = counts.iter().map(|n| f64::from(*n)).sum::<f64>() / counts.len() as f64;
    let sum: f64 = counts.iter().map(|n| (f64::from(*n) - expected) * (f64::from(*n) - expected)).sum();
    sum / expected / (counts.len() as f64 - 1.0)
}

/// Pairs of neighbours: the worst offset at the worst place.
fn pairs(gradients: Gradients<'_>) -> f64 {
    let mut worst = 0.0_f64;
    for origin in ORIGINS {
        let lattice = lattice(gradients, origin);
        for offset in OFFSETS {
            let mut counts = [0; 144];
            for x in corners() {
                let other = [0, 1, 2].map(|axis| x[axis].wrapping_add_signed(offset[axis]));
                counts[12 * at(&lattice, x) + at(&lattice, other)] += 1;
            }
            worst = worst.max(chi_squared(&counts));
        }
    }
    worst
}

/// Sums, modulo 12, of the four corners of lattice squares in three planes, the worst.
fn parallelograms(gradients: Gradients<'_>) -> f64 {
    let mut worst = 0.0_f64;
    for origin in ORIGINS {
        let lattice = lattice(gradients, origin);
        for axes in [[0, 1], [1, 2], [0, 2]] {
            let mut counts = [0; 12];
            for x in corners() {
                let corner = |a: u32, b: u32| {
                    let mut y = x;
                    y[axes[0]] += a;
                    y[axes[1]] += b;
                    at(&lattice, y)
                };
                counts[(corner(0, 0) + corner(1, 1) + corner(0, 1) + corner(1, 0)) % 12] += 1;
            }
            worst = worst.max(chi_squared(&counts));
        }
    }
    worst
}

/// The noise of these gradients at `cell + t`, and its gradient.
fn noise(gradients: Gradients<'_>, cell: [u32; 3], t: [f64; 3], seed: u32) -> (f64, [f64; 3]) {
    let mut sum = (0.0, [0.0; 3]);
    for corner in 0..8_u32 {
        let up = [0, 1, 2].map(|axis| corner >> axis & 1);
        let g = gradients([0, 1, 2].map(|axis| cell[axis].wrapping_add(up[axis])), seed).map(f64::from);
        let d = [0, 1, 2].map(|axis| t[axis] - f64::from(up[axis]));
        let weight = [0, 1, 2].map(|axis| {
            let (t, sign) = (t[axis], 2.0 * f64::from(up[axis]) - 1.0);
            let fade = t * t * t * (10.0 + t * (6.0 * t - 15.0));
            [if up[axis] == 1 { fade } else { 1.0 - fade }, sign * 30.0 * t * t * (1.0 - t) * (1.0 - t)]
        });
        let dot = g[0] * d[0] + g[1] * d[1] + g[2] * d[2];
        let all = weight[0][0] * weight[1][0] * weight[2][0];
        sum.0 += all * dot;
        for axis in 0..3 {
            let (b, c) = ((axis + 1) % 3, (axis + 2) % 3);
            sum.1[axis] += weight[axis][1] * weight[b][0] * weight[c][0] * dot + all * g[axis];
        }
    }
    sum
}

/// The largest correlation of two of five octaves, and the ratio of the largest to the least variance of the derivatives.
fn octaves_and_slopes(gradients: Gradients<'_>) -> (f64, f64) {
    let mut random = Random(32);
    let mut products = [[0.0; 5]; 5];
    let mut squares = [0.0; 3];
    for _ in 0..60_000 {
        let p = (random.point() * 500.0).to_array();
        let mut values = [0.0; 5];
        for (k, value) in (0..5_u32).zip(&mut values) {
            let at = p.map(|x| x * f64::from(1_u32 << k));
            #[allow(clippy::cast_possible_truncation, reason = "small")]
            let cell = at.map(|x| (x.floor() as i32).cast_unsigned());
            let (here, slope) = noise(gradients, cell, at.map(|x| x - x.floor()), octave_seed(0, k));
            *value = here;
            for axis in 0..3 {
                squares[axis] += slope[axis] * slope[axis];
            }
        }
        for a in 0..5 {
            for b in 0..5 {
                products[a][b] += values[a] * values[b];
            }
        }
    }
    let mut most = 0.0_f64;
    for a in 0..5 {
        for b in 0..a {
            most = most.max((products[a][b] / (products[a][a] * products[b][b]).sqrt()).abs());
        }
    }
    (most, ratio(squares))
}

/// The variance of means over lines of 48 cells along each axis: the largest over the least.
fn line_means(gradients: Gradients<'_>) -> f64 {
    let mut random = Random(33);
    let mut squares = [0.0; 3];
    for _ in 0..3000 {
        let start = random.bits();
        #[allow(clippy::cast_possible_truncation, reason = "bits")]
        let start = [start as u32, (start >> 16) as u32, (start >> 32) as u32];
        let t = [random.unit(), random.unit(), random.unit()];
        for axis in 0..3 {
            let mut sum = 0.0;
            for k in 0..EDGE {
                let mut cell = start;
                cell[axis] = cell[axis].wrapping_add(k);
                sum += noise(gradients, cell, t, 1).0;
            }
            squares[axis] += sum * sum;
        }
    }
    ratio(squares)
}

fn ratio(values: [f64; 3]) -> f64 {
    values.iter().fold(0.0_f64, |most, x| most.max(*x))
        / values.iter().fold(f64::MAX, |least, x| least.min(*x))
}

#[test]
fn neighbours_are_independent_and_other_hashes_are_told_apart() {
    let all = [Hash::Defined, Hash::MixedFirst, Hash::PairFirst];
    let [sound, rest @ ..] = all.map(|hash| {
        let gradients = |corner: [u32; 3], seed: u32| gradient(hash, corner, seed);
        let found = [pairs(&gradients), parallelograms(&gradients)];
        show(&format!("{hash:?}: pairs {:.2}, parallelograms {:.2}", found[0], found[1]));
        found
    });
    // Of 56 draws with 143 degrees of freedom the worst is near 1.3; of 12 with 11 degrees near 2.3.
    assert!(sound[0] < 1.7 && sound[1] < 4.0, "{sound:?}");
    for worse in rest {
        assert!(worse[0] > 100.0 && worse[1] > 20.0, "{worse:?}");
    }
}

#[test]
fn octaves_are_independent_and_axes_alike() {
    let (correlation, slopes) = octaves_and_slopes(&good);
    let lines = line_means(&good);
    show(&format!(
        "octave correlation {correlation:.4}, derivative variance {slopes:.4}, line means {lines:.3}"
    ));
    // Four standard errors of 60 000 points, 1 / sqrt(60 000) each.
    assert!(correlation < 0.0165, "{correlation}");
    // Variances over 300 000 values of kurtosis near 3: 0.3 %; a table of sixteen gives 1.09.
    assert!(slopes < 1.015, "{slopes}");
    // Over 3000 lines, 2.6 % each: the extremes of three lie within 4 of those.
    assert!(lines < 1.11, "{lines}");
    // A set of sixteen, which repeats four edges, prefers an axis: the measure sees it.
    let sixteen = |corner: [u32; 3], seed: u32| {
        let gradient = good(corner, seed);
        let pick = corner[0].wrapping_mul(0x2545_F491) ^ corner[1].wrapping_mul(0x9E37_79B1);
        let pick = (pick ^ corner[2].wrapping_mul(0x85EB_CA77) ^ seed).wrapping_mul(0xC2B2_AE3D) >> 30;
        if pick == 0 {
            [[1, 1, 0], [-1, 1, 0], [0, -1, 1], [0, -1, -1]][index(gradient) % 4]
        } else {
            gradient
        }
    };
    let (_, uneven) = octaves_and_slopes(&sixteen);
    show(&format!("derivative variance of sixteen gradients {uneven:.4}"));
    assert!(uneven > 1.05, "{uneven}");
}
