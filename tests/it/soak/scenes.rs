//! Random valid scenes: every key of a tube and of its layers, with every other.

use std::fmt::Write;

use vdbake::formats::vdb::Compression;
use vdbake::scene::Scene;
use vdbake::volume::Precision;

use crate::support::random;

/// A scene, and what it is baked with.
pub(super) struct Case {
    pub(super) text: String,
    /// Files that the scene names.
    files: Vec<(String, String)>,
    /// The time at which it is baked.
    seconds: f64,
    /// Voxels along the longest side.
    pub(super) resolution: f64,
    /// Whether it is to be large enough for a spool, whatever the resolution.
    pub(super) is_large: bool,
    pub(super) precision: Precision,
    pub(super) compression: Compression,
}

impl Case {
    /// The scene at the case's time.
    pub(super) fn scene(&self) -> Result<Scene, String> {
        let load = |name: &str| {
            let found = self.files.iter().find(|(file, _)| file == name);
            found.map(|(_, text)| text.clone().into_bytes()).ok_or(std::io::ErrorKind::NotFound.into())
        };
        let scene = Scene::load(&self.text, "soak.toml", &load).map_err(|errors| errors.to_string())?;
        scene.at(self.seconds).map_err(|errors| errors.to_string())
    }
}

/// The case of a seed.
pub(super) fn case(seed: u64) -> Case {
    // Seeds that follow one another begin sequences that are far apart.
    let mut dice = Dice { state: random(&mut (seed ^ 0x50a_c0de)), moves: false };
    dice.moves = dice.chance(0.3);
    let mut files = Vec::new();
    let mut text = String::new();
    if dice.chance(0.5) {
        let rule = dice.overlap();
        let _ = writeln!(text, "overlap = {rule:?}");
    }
    bake(&mut dice, &mut text);
    let seconds = if dice.moves { dice.within(-1.0, 5.0) } else { 0.0 };
    if dice.moves {
        let fps = dice.within(1.0, 60.0);
        let _ = writeln!(text, "[time]\nfps = {fps:?}\nstart = {}", dice.below(10));
    }
    // One scale and place for all tubes, so that they meet.
    let scale = libm::pow(10.0, dice.within(-2.0, 2.0));
    let far = if dice.chance(0.2) { scale * libm::pow(10.0, dice.within(0.0, 4.0)) } else { 0.0 };
    let origin = [0, 1, 2].map(|_| far * dice.within(-1.0, 1.0));
    for number in 0..*dice.pick(&[1, 1, 1, 1, 2, 2, 3]) {
        tube(&mut dice, &mut text, &mut files, number, scale, origin);
    }
    let is_large = seed.is_multiple_of(40);
    let resolution = match seed % 10 {
        1 => dice.within(3.0, 12.0),
        _ => dice.within(12.0, 44.0),
    };
    let mut precision = *dice.pick(&[Precision::F32, Precision::F32, Precision::F16]);
    let mut compression = *dice.pick(&[Compression::Blosc, Compression::Zip, Compression::None]);
    if is_large {
        (precision, compression) = (Precision::F32, Compression::None);
    }
    Case { text, files, seconds, resolution, is_large, precision, compression }
}

struct Dice {
    state: u64,
    /// Whether numbers may change over time.
    moves: bool,
}

impl Dice {
    fn below(&mut self, end: u64) -> u64 {
        random(&mut self.state) % end
    }

    fn unit(&mut self) -> f64 {
        (random(&mut self.state) >> 11) as f64 / 9_007_199_254_740_992.0
    }

    fn chance(&mut self, part: f64) -> bool {
        self.unit() < part
    }

    fn within(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }

    fn pick<'a, T>(&mut self, all: &'a [T]) -> &'a T {
        let index = self.below(all.len() as u64);
        &all[usize::try_from(index).expect("an index")]
    }

    fn overlap(&mut self) -> &'static str {
        self.pick::<&str>(&["max", "sum", "closest", "blend"])
    }

    /// A number of a tube, which may change over time.
    fn number(&mut self, low: f64, high: f64) -> String {
        if !self.moves || self.chance(0.8) {
            return format!("{:?}", self.within(low, high));
        }
        if self.chance(0.5) {
            let (mean, period) = (self.within(low, high), self.within(0.5, 5.0));
            let amplitude = (mean - low).min(high - mean) * self.unit();
            let phase = self.unit();
            return format!(
                "{{ mean = {mean:?}, amplitude = {amplitude:?}, period = {period:?}, phase = {phase:?} }}"
            );
        }
        let (mut time, mut keys) = (self.within(-2.0, 2.0), Vec::new());
        for _ in 0..2 + self.below(3) {
            keys.push(format!("[{time:?}, {:?}]", self.within(low, high)));
            time += self.within(0.2, 2.0);
        }
        let interpolation = *self.pick(&["smooth", "linear", "step"]);
        let repeat = self.chance(0.3);
        format!("{{ keys = [{}], interpolation = {interpolation:?}, repeat = {repeat} }}", keys.join(", "))
    }

    fn numbers(&mut self, low: f64, high: f64) -> String {
        format!("[{}, {}, {}]", self.number(low, high), self.number(low, high), self.number(low, high))
    }

    /// Cells of a noise: one number, or three.
    fn frequency(&mut self, high: f64) -> String {
        if self.chance(0.2) {
            return self.number(0.0, high);
        }
        let mut one = || if self.chance(0.1) { "0".to_owned() } else { self.number(0.2, high) };
        format!("[{}, {}, {}]", one(), one(), one())
    }
}

fn bake(dice: &mut Dice, text: &mut String) {
    text.push_str("[bake]\n");
    if dice.chance(0.15) {
        let _ = writeln!(text, "cutoff = {:?}", libm::pow(10.0, dice.within(-6.0, -1.0)));
    }
    for key in ["octave_fade", "widen"] {
        if dice.chance(0.3) {
            let _ = writeln!(text, "{key} = {}", dice.chance(0.5));
        }
    }
    if dice.chance(0.3) {
        text.push_str("antialias = \"off\"\n");
    }
}

fn tube(
    dice: &mut Dice,
    text: &mut String,
    files: &mut Vec<(String, String)>,
    number: u64,
    scale: f64,
    origin: [f64; 3],
) {
    text.push_str("[[tube]]\n");
    let closed = dice.chance(0.2);
    curve(dice, text, files, number, closed, scale, origin);
    radius(dice, text, files, number, closed, scale);
    if dice.chance(0.6) {
        let twist =
            if closed && dice.chance(0.5) { format!("{}", dice.below(7)) } else { dice.number(-3.0, 3.0) };
        let _ = writeln!(text, "twist = {twist}");
    }
    if dice.chance(0.3) {
        let _ = writeln!(text, "spin = {}", dice.number(-2.0, 2.0));
    }
    if dice.chance(0.2) {
        text.push_str("stretch = false\n");
    }
    if dice.chance(0.2) {
        text.push_str("frame = \"frenet\"\n");
    }
    let caps = if closed { "none" } else { *dice.pick(&["", "fade", "flat", "round"]) };
    if !caps.is_empty() && !closed {
        let _ = writeln!(text, "caps = {caps:?}");
    }
    if dice.chance(0.4) {
        let _ = writeln!(text, "conserve = {:?}", *dice.pick(&["off", "radius", "full"]));
    }
    if dice.chance(0.2) {
        let (radius, length) = (dice.number(0.1 * scale, scale), dice.number(0.3 * scale, 3.0 * scale));
        let rest = *dice.pick(&["radius", "length", "both"]);
        let _ = match rest {
            "radius" => writeln!(text, "rest = {{ radius = {radius} }}"),
            "length" => writeln!(text, "rest = {{ length = {length} }}"),
            _ => writeln!(text, "rest = {{ radius = {radius}, length = {length} }}"),
        };
    }
    if dice.chance(0.5) {
        let rule = dice.overlap();
        let _ = writeln!(text, "overlap = {rule:?}");
    }
    if dice.chance(0.7) {
        let radial = match dice.below(4) {
            0 => "\"hard\"".to_owned(),
            1 => "\"linear\"".to_owned(),
            2 => "\"smooth\"".to_owned(),
            _ => dice.number(0.02, 1.0),
        };
        let fades = matches!(caps, "" | "fade");
        let axial = if fades && dice.chance(0.5) {
            format!(", axial = {}", dice.number(0.01, 0.5))
        } else {
            String::new()
        };
        let _ = writeln!(text, "envelope = {{ radial = {radial}{axial} }}");
    }
    if dice.chance(0.1) {
        text.push_str("color = [[0.0, 1.0, 0.5, 0.2], [1.0, 0.2, 0.5, 1.0]]\ntemperature = 1500\n");
    }
    for _ in 0..*dice.pick(&[0, 1, 1, 1, 2, 2, 3, 4]) {
        layer(dice, text);
    }
}

fn curve(
    dice: &mut Dice,
    text: &mut String,
    files: &mut Vec<(String, String)>,
    number: u64,
    closed: bool,
    scale: f64,
    origin: [f64; 3],
) {
    let kind = *dice.pick(&["quadratic", "quadratic", "cubic", "catmull-rom", "b-spline"]);
    let segments = 1 + dice.below(4);
    let count = match (kind, closed) {
        ("quadratic", false) => 2 * segments + 1,
        ("cubic", false) => 3 * segments + 1,
        ("quadratic", true) => 2 * segments + 2,
        ("cubic", true) => 3 * segments + 3,
        (_, false) => 2 + dice.below(7),
        _ => 3 + dice.below(6),
    };
    // Wound around an axis as a rule, else anywhere; drawn out along a line sometimes, so that it is almost straight.
    let wound = dice.chance(0.6);
    let across = if dice.chance(0.1) { 1e-6 } else { 1.0 };
    let (turn, rise) = (dice.within(0.2, 1.2), if closed { 0.1 } else { dice.within(0.1, 0.5) });
    let mut points: Vec<[f64; 3]> = Vec::new();
    for index in 0..count {
        let index = index as f64;
        let [x, y, z] = [0, 1, 2].map(|_| dice.within(-1.0, 1.0));
        let angle = if closed { index * std::f64::consts::TAU / count as f64 } else { turn * index };
        let at = if wound {
            let (sin, cos) = libm::sincos(angle);
            [cos + 0.2 * x, across * (sin + 0.2 * y), rise * (index + 0.5 * z)]
        } else {
            [x, across * y, z]
        };
        let smooth = !closed && kind == "quadratic" && points.len() >= 3 && points.len() % 2 == 1;
        let at = match points.as_slice() {
            // The tangent goes on as it came.
            [.., before, last] if smooth && wound => {
                [0, 1, 2].map(|axis| last[axis] + 0.8 * (last[axis] - before[axis]))
            }
            _ => [0, 1, 2].map(|axis| origin[axis] + scale * at[axis]),
        };
        points.push(at);
    }
    // A segment that sets out slowly.
    if matches!(kind, "quadratic" | "cubic") && dice.chance(0.05) {
        points[1] = points[0];
    }
    let mut keys = format!("kind = {kind:?}");
    if closed {
        keys += ", closed = true";
    }
    if kind == "catmull-rom" && dice.chance(0.5) {
        let _ = write!(keys, ", alpha = {:?}", *dice.pick(&[0.0, 0.3, 0.5, 1.0]));
    }
    if dice.chance(0.1) {
        let _ = write!(keys, ", scale = {}, about = {origin:?}", dice.number(0.5, 2.0));
    }
    if dice.chance(0.1) {
        let name = format!("curve{number}.csv");
        let rows: Vec<String> = points.iter().map(|[x, y, z]| format!("{x:?},{y:?},{z:?}\n")).collect();
        let _ = write!(keys, ", file = {name:?}");
        files.push((name, rows.concat()));
    } else {
        let points: Vec<String> = points.into_iter().map(|at| point(dice, at, scale)).collect();
        let _ = write!(keys, ", points = [{}]", points.join(", "));
    }
    let _ = writeln!(text, "curve = {{ {keys} }}");
}

/// A point, which may move.
fn point(dice: &mut Dice, at: [f64; 3], scale: f64) -> String {
    if !dice.moves || dice.chance(0.7) {
        return format!("{at:?}");
    }
    if dice.chance(0.5) {
        let arm = [0, 1, 2].map(|_| scale * dice.within(-0.2, 0.2));
        let axis = [0, 1, 2].map(|_| dice.within(-1.0, 1.0));
        let period = dice.within(0.5, 5.0);
        return format!("{{ centre = {at:?}, arm = {arm:?}, period = {period:?}, axis = {axis:?} }}");
    }
    let [x, y, z] = at.map(|x| dice.number(x - 0.1 * scale, x + 0.1 * scale));
    format!("[{x}, {y}, {z}]")
}

fn radius(
    dice: &mut Dice,
    text: &mut String,
    files: &mut Vec<(String, String)>,
    number: u64,
    closed: bool,
    scale: f64,
) {
    let most = scale * if dice.chance(0.1) { dice.within(0.002, 0.03) } else { dice.within(0.05, 0.5) };
    let radius = match dice.below(8) {
        0 => return,
        1 | 2 => dice.number(0.3 * most, most),
        3 => {
            let mean = dice.within(0.3, 0.8) * most;
            let (amplitude, waves) = (mean * dice.unit(), 1 + dice.below(6));
            let phase = dice.unit();
            format!(
                "{{ kind = \"sinusoidal\", mean = {mean:?}, amplitude = {amplitude:?}, waves = {waves}, phase = {phase:?} }}"
            )
        }
        4 if !closed => {
            // Lower powers have no stable slope at the very start.
            let (from, power) = (dice.number(0.0, most), dice.within(0.5, 3.0));
            format!(
                "{{ kind = \"growing\", from = {from}, to = {}, power = {power:?} }}",
                dice.number(0.3 * most, most)
            )
        }
        kind => {
            let count = 1 + dice.below(4);
            let (mut places, mut keys) = (vec![0.0], Vec::new());
            for i in 1..=count {
                let place = (i as f64 - 0.5 * dice.unit()) / count as f64;
                places.push(place);
                // A step.
                if dice.chance(0.15) {
                    places.push(place);
                }
            }
            for place in places {
                let low = if dice.chance(0.15) { 0.0 } else { 0.2 * most };
                keys.push((place, dice.within(low, most)));
            }
            // Some part of it is thick.
            keys[0].1 = most;
            if kind == 7 {
                let name = format!("radius{number}.csv");
                let rows: Vec<String> = keys.iter().map(|(l, r)| format!("{l:?},{r:?}\n")).collect();
                files.push((name.clone(), rows.concat()));
                format!("{{ file = {name:?} }}")
            } else {
                let keys: Vec<String> = keys.iter().map(|(l, r)| format!("[{l:?}, {r:?}]")).collect();
                format!("[{}]", keys.join(", "))
            }
        }
    };
    let _ = writeln!(text, "radius = {radius}");
}

fn layer(dice: &mut Dice, text: &mut String) {
    text.push_str("[[tube.layer]]\n");
    if dice.chance(0.6) {
        let _ = writeln!(text, "op = {:?}", *dice.pick(&["multiply", "add", "max", "min"]));
    }
    let noise = *dice.pick(&["perlin", "perlin", "perlin", "perlin", "constant", "sectors"]);
    let _ = writeln!(text, "noise = {noise:?}");
    if dice.chance(0.5) {
        let _ = writeln!(text, "threshold = {}", dice.number(-0.6, 0.15));
    }
    if dice.chance(0.4) {
        let _ = writeln!(text, "multiplier = {}", dice.number(0.2, 4.0));
    }
    match noise {
        "constant" => {
            let _ = writeln!(text, "value = {}", dice.number(0.1, 3.0));
        }
        "perlin" => perlin(dice, text),
        _ => {}
    }
}

fn perlin(dice: &mut Dice, text: &mut String) {
    let world = dice.chance(0.15);
    if world {
        text.push_str("space = \"world\"\n");
    }
    let _ = writeln!(text, "frequency = {}", dice.frequency(6.0));
    let octaves = *dice.pick(&[0, 1, 1, 2, 3, 4, 5, 6]);
    let _ = writeln!(text, "octaves = {octaves}");
    if dice.chance(0.4) {
        let _ = writeln!(text, "lacunarity = {}", dice.number(0.6, 2.6));
    }
    if dice.chance(0.4) {
        let _ = writeln!(text, "gain = {}", dice.number(0.0, 1.1));
    }
    for key in ["normalise", "rotate"] {
        // No sum of amplitudes is there to divide by without octaves.
        if dice.chance(0.25) && (key == "rotate" || octaves > 0) {
            let _ = writeln!(text, "{key} = true");
        }
    }
    if dice.chance(0.5) {
        let _ = writeln!(text, "seed = {}", dice.below(1 << 32));
    }
    if dice.chance(0.3) {
        let _ = writeln!(text, "scroll = {}", dice.numbers(-3.0, 3.0));
    }
    if dice.chance(0.5) {
        let _ = writeln!(text, "form = {:?}", *dice.pick(&["fbm", "billow", "ridged"]));
    }
    if dice.chance(0.2) {
        let _ = writeln!(text, "offset = {}", dice.numbers(-10.0, 10.0));
    }
    if dice.chance(0.25) {
        let mut keys = vec![format!("amplitude = {}", dice.number(0.0, 1.0))];
        if dice.chance(0.5) {
            keys.push(format!("frequency = {}", dice.frequency(4.0)));
        }
        if dice.chance(0.5) {
            keys.push(format!("octaves = {}", 1 + dice.below(3)));
        }
        if dice.chance(0.3) {
            keys.push(format!("lacunarity = {}", dice.number(0.8, 2.4)));
            keys.push(format!("gain = {}", dice.number(0.1, 0.9)));
        }
        if dice.chance(0.3) {
            keys.push(format!("seed = {}", dice.below(100)));
        }
        let _ = writeln!(text, "warp = {{ {} }}", keys.join(", "));
    }
}
