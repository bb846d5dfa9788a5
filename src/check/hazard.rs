//! What of a scene is hazardous, before it is baked.

use std::f64::consts::TAU;

use serde::Serialize;

use crate::field::{Field, Lattice};
use crate::num::Level;
use crate::report::page::words::{figure, part};
use crate::report::{Look, Survey, TrialError};
use crate::scene::{Key, Pattern, Remark, Scene, Space, Tube, Weight};
use crate::volume::{Filter, LARGEST_F16, Precision, RestMass, Store, bake};

/// Places along a segment that are looked at, where there are few.
const PLACES: usize = 64;
/// Places along a curve, at most, but for one a segment.
const MOST_PLACES: usize = 1 << 14;
/// Bricks that are baked to see what a scene is like.
const SAMPLE: usize = 512;
/// Root mean square of the slope of Perlin noise along any direction, per cell: that its square has the mean 1/2 was found by
/// averaging over places and gradients.
const SLOPE: f64 = std::f64::consts::FRAC_1_SQRT_2;
/// Octaves of more cells a voxel have faded by half.
const HALF_FADED: f64 = 1.06;
/// Above this many cells of noise a voxel, noise between voxels is lost.
const NYQUIST: f64 = 0.5;

/// A hazard of a scene, at its place in the text.
#[derive(Debug, Clone, PartialEq)]
pub struct Hazard {
    kind: &'static str,
    /// How bad it is, among those of its kind.
    size: f64,
    remark: Remark,
}

impl Hazard {
    pub(super) fn new(kind: &'static str, size: f64, remark: Remark) -> Hazard {
        Hazard { kind, size, remark }
    }

    /// A word for what it is.
    pub fn kind(&self) -> &'static str {
        self.kind
    }

    /// What is the matter, where, and what to change.
    pub fn remark(&self) -> &Remark {
        &self.remark
    }

    /// How much it matters.
    pub fn weight(&self) -> Weight {
        self.remark.weight()
    }

    /// Whether it is worse than the same one at another time.
    pub fn is_worse(&self, other: &Hazard) -> bool {
        (self.weight(), self.size) > (other.weight(), other.size)
    }

    /// Whether it is the same, though perhaps worse, as at another time of the scene.
    pub fn is_same(&self, other: &Hazard) -> bool {
        let place = |hazard: &Hazard| (hazard.remark.fault().line(), hazard.remark.fault().column());
        self.kind == other.kind && place(self) == place(other)
    }
}

/// What is expected of a bake.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Expectation {
    /// Relative L2 error of trilinear values; null where no point met any density.
    pub relative_l2: Option<f64>,
    /// 95 % interval of it.
    pub interval: Option<[f64; 2]>,
    /// The largest density among bricks that were tried.
    pub peak: f64,
    /// Part of the voxels inside tubes that see a tube's axis from several sides.
    pub several_feet: f64,
    /// Part of the mass at rest that has no image.
    pub lost_mass: f64,
    /// Part of it that is faded beside focal sets.
    pub faded_mass: f64,
}

/// What a scene says that hardly comes out as it says it, found without baking: sharp bends, corners, steep, thin and jumping radii,
/// twist and octaves finer than voxels, light that ends within a voxel. The most serious first.
pub fn hazards(scene: &Scene, lattice: Lattice) -> Vec<Hazard> {
    let h = lattice.voxel_size;
    let mut found = Vec::new();
    for (number, tube) in scene.tubes().iter().enumerate() {
        let on = On { scene, tube, number, h };
        found.extend(on.bends());
        found.extend(on.corners());
        found.extend(on.radii());
        found.extend(on.slopes());
        found.extend(on.sectors());
        for layer in 0..tube.layers.len() {
            found.extend(on.octaves(layer));
            found.extend(on.warp(layer));
        }
    }
    found.extend(extinction(scene, h));
    sorted(found)
}

/// Tries a bake of a scene's field: some bricks, and the error at points.
///
/// # Errors
///
/// Where the bricks cannot be planned in `budget` bytes.
pub fn expectation(
    scene: &Scene,
    field: &Field,
    lattice: Lattice,
    precision: Precision,
    points: usize,
    budget: u64,
) -> Result<Expectation, TrialError> {
    let look = Look { points, rays: 0, stream: 0x6865_636b, filter: Filter::Trilinear, precision };
    let survey = Survey::with(scene, field.clone(), look, budget);
    let lot = survey.pilot().at(lattice)?;
    let mut store = Store::default();
    let Ok((tally, _)) =
        bake(&lot.field, &lot.plan.sample(SAMPLE), scene.bake().cutoff, Level::best(), &mut store, |_| ());
    let peak = store.active().map(|(_, value)| f64::from(value)).fold(0.0, f64::max);
    let rest = RestMass::new(&lot.field, scene, lattice, 1 << 15, Level::best());
    let (errors, intervals) = survey.errors(&lot)?;
    let share = |x: f64, of: f64| if of > 0.0 { x / of } else { 0.0 };
    #[allow(clippy::cast_precision_loss, reason = "a share")]
    Ok(Expectation {
        // Where no point met density, an error of 0 would be none.
        relative_l2: errors.l2.of_rms.filter(|_| errors.peak > 0.0),
        interval: intervals.and_then(|held| held.relative_l2).filter(|_| errors.peak > 0.0),
        peak: peak.max(errors.peak),
        several_feet: share(tally.several_feet_voxels as f64, tally.inside_voxels as f64),
        lost_mass: share(rest.lost, rest.rest),
        faded_mass: share(rest.faded, rest.rest),
    })
}

/// What of an expectation is hazardous.
pub fn hazards_expected(
    scene: &Scene,
    lattice: Lattice,
    precision: Precision,
    expected: &Expectation,
) -> Vec<Hazard> {
    let tubes = [Key::Name("tube")];
    let mut found = Vec::new();
    let mut say = |(kind, weight, size): (_, Weight, f64), keys: &[Key<'_>], title: String, help: &str| {
        let remark = scene.remark(weight, keys, title, String::new(), help.to_owned());
        found.push(Hazard { kind, size, remark });
    };
    let in_half = |weight| if precision == Precision::F16 { weight } else { Weight::Note };
    if expected.lost_mass > 1e-4 {
        let weight = if expected.lost_mass > 0.01 { Weight::Serious } else { Weight::Warning };
        say(
            ("lost mass", weight, expected.lost_mass),
            &tubes,
            format!("{} of the mass at rest is lost", part(expected.lost_mass)),
            "it lies past the focal set of a bend (bend less, or make the tube thinner there), or where a radius is 0",
        );
    }
    if expected.faded_mass > 0.01 {
        say(
            ("faded mass", Weight::Warning, expected.faded_mass),
            &tubes,
            format!("{} of the mass at rest is faded out beside a focal set", part(expected.faded_mass)),
            "bend less, or make the tube thinner there",
        );
    }
    if expected.several_feet > 0.01 {
        say(
            ("overlap", Weight::Note, expected.several_feet),
            &tubes,
            format!("{} of the voxels are reached by a tube from several sides", part(expected.several_feet)),
            "`overlap` says what they store: \"max\", \"sum\", \"closest\" or \"blend\"",
        );
    }
    if expected.peak > f64::from(LARGEST_F16) {
        say(
            ("half range", in_half(Weight::Serious), expected.peak),
            &tubes,
            format!("densities of {} and more", figure(expected.peak)),
            "half precision ends at 65504: use --precision f32, or smaller values and more `extinction`",
        );
    } else if expected.peak > 0.0 && expected.peak < 6.1e-5 {
        say(
            ("half range", in_half(Weight::Serious), -expected.peak),
            &tubes,
            format!("no density above {}", figure(expected.peak)),
            "half precision is off by 3e-8: use --precision f32, or larger values and less `extinction`",
        );
    } else if expected.peak <= 0.0 && !scene.tubes().is_empty() {
        say(
            ("no density", Weight::Serious, 0.0),
            &tubes,
            "no density was found in the bricks that were tried".to_owned(),
            "what is thinner than a voxel may lie between centres, and layers may leave nothing: see `widen`, `threshold`, `multiplier`, `octaves`",
        );
    }
    if let Some(error) = expected.relative_l2.filter(|error| *error > 0.2) {
        say(
            ("error", Weight::Warning, error),
            &[Key::Name("bake")],
            format!(
                "voxels of {} m miss {} of the density (relative L2)",
                figure(lattice.voxel_size),
                part(error)
            ),
            "smaller voxels miss less (`bake --max-error` finds them), fewer octaves need fewer; hard edges keep some of it however small they are",
        );
    }
    let depth = scene.medium().extinction * expected.peak * lattice.voxel_size;
    if depth > 1.5 {
        say(
            ("stiff shadows", if depth > 10.0 { Weight::Warning } else { Weight::Note }, depth),
            &[Key::Name("medium"), Key::Name("extinction")],
            format!("an optical depth of up to {} in a voxel", figure(depth)),
            "tabled shadows are off by some 10 % at 2 a voxel and 30 to 40 % at 10: draw it with --shadow exact, or with smaller voxels",
        );
    }
    sorted(found)
}

/// The most serious first, otherwise in the order of the text.
pub fn sorted(mut hazards: Vec<Hazard>) -> Vec<Hazard> {
    hazards.sort_by_key(|hazard| (std::cmp::Reverse(hazard.weight()), hazard.remark.fault().line()));
    hazards
}

/// A tube of a scene.
struct On<'a> {
    scene: &'a Scene,
    tube: &'a Tube,
    number: usize,
    /// Edge of a voxel in metres.
    h: f64,
}

/// A place along an axis.
#[derive(Debug, Clone, Copy)]
struct Place {
    /// Arc length, metres.
    s: f64,
    /// Curvature, 1 over metres.
    curvature: f64,
    radius: f64,
}

impl On<'_> {
    fn say(
        &self,
        (kind, weight, size): (&'static str, Weight, f64),
        keys: &[Key<'_>],
        title: String,
        label: String,
        help: impl Into<String>,
    ) -> Hazard {
        let tube = [Key::Name("tube"), Key::Number(self.number)];
        let keys = [tube.as_slice(), keys].concat();
        let title = format!("tube \"{}\": {title}", self.tube.name);
        Hazard { kind, size, remark: self.scene.remark(weight, &keys, title, label, help.into()) }
    }

    /// Places along the axis, evenly in each segment's parameter.
    fn places(&self) -> impl Iterator<Item = Place> + '_ {
        let curve = &self.tube.curve;
        let each = (MOST_PLACES / curve.segments().len().max(1)).clamp(1, PLACES);
        (0..curve.segments().len()).flat_map(move |number| {
            #[allow(clippy::cast_precision_loss, reason = "small")]
            let places =
                (0..=each).map(move |k| (k as f64 + 0.5 * f64::from(u8::from(each == 1))) / each as f64);
            places.filter(|t| *t <= 1.0).map(move |t| self.place(number, t))
        })
    }

    fn place(&self, number: usize, t: f64) -> Place {
        let curve = &self.tube.curve;
        let segment = &curve.segments()[number];
        let (d1, d2) = (segment.d1(t), segment.d2(t));
        let speed = d1.length();
        let s = curve.arc_length(number, t);
        let radius = self.tube.radius.at((s / curve.length()).clamp(0.0, 1.0));
        Place { s, curvature: d1.cross(d2).length() / (speed * speed * speed), radius }
    }

    /// Where the axis bends more sharply than the tube is thick.
    fn bends(&self) -> Option<Hazard> {
        let curve = &self.tube.curve;
        let product = |place: &Place| place.curvature * place.radius;
        let slowest = (0..curve.segments().len()).map(|number| {
            let segment = &curve.segments()[number];
            // A sharp bend is where the curve is slow, and how sharp it is shows nowhere else.
            let t = least(|t| segment.d1(t).length_squared());
            let speed = segment.d1(t).length();
            let most =
                [0.0, 0.25, 0.5, 0.75, 1.0].map(|t| segment.d1(t).length()).into_iter().fold(0.0, f64::max);
            let is_cusp = speed < 1e-6 * most && t > 1e-6 && t < 1.0 - 1e-6;
            (self.place(number, t), is_cusp)
        });
        let slowest: Vec<(Place, bool)> = slowest.collect();
        if let Some((cusp, _)) = slowest.iter().find(|(_, is_cusp)| *is_cusp) {
            return Some(self.say(
                ("cusp", Weight::Warning, 1.0),
                &[Key::Name("curve")],
                "the curve stops and turns back".to_owned(),
                format!("at {} m along the curve of {} m", figure(cusp.s), figure(curve.length())),
                "there it has a corner of half a turn, and the tube a round end; move the point beside it",
            ));
        }
        let worst = self
            .places()
            .chain(slowest.into_iter().map(|(place, _)| place))
            .filter(|place| product(place).is_finite())
            .max_by(|a, b| product(a).total_cmp(&product(b)))?;
        let most = product(&worst);
        let weight = match most {
            most if most >= 1.0 => Weight::Warning,
            most if most >= 0.8 => Weight::Note,
            _ => return None,
        };
        Some(self.say(
            ("curvature", weight, most),
            &[Key::Name("curve")],
            format!("curvature times radius is up to {}", figure(most)),
            format!("at {} m along the curve of {} m", figure(worst.s), figure(curve.length())),
            if most >= 1.0 {
                format!(
                    "above 1 the inner side folds over itself and is lost; a radius below {} m there keeps it",
                    figure(0.8 / worst.curvature)
                )
            } else {
                "above 0.8 density fades beside the focal set".to_owned()
            },
        ))
    }

    /// Joints that are not smooth.
    fn corners(&self) -> Option<Hazard> {
        let curve = &self.tube.curve;
        let turns = (0..curve.segments().len()).map(|joint| (joint, curve.turn(joint)));
        let sharp: Vec<(usize, f64)> = turns.filter(|(_, turn)| *turn > 0.2).collect();
        let (joint, turn) = sharp.iter().copied().max_by(|a, b| a.1.total_cmp(&b.1))?;
        Some(self.say(
            ("corners", if turn > 3.0 { Weight::Warning } else { Weight::Note }, turn),
            &[Key::Name("curve")],
            format!("{} of {} joints are corners", sharp.len(), curve.segments().len()),
            format!(
                "the sharpest, of {} degrees, at {} m",
                figure(turn.to_degrees()),
                figure(curve.arc_length(joint, 1.0))
            ),
            "`kind = \"catmull-rom\"` goes through the same points without",
        ))
    }

    /// Radii below what voxels can show.
    fn radii(&self) -> Option<Hazard> {
        let most = self.tube.radius.max();
        let thin = self.places().filter(|place| place.radius > 1e-6 * most && place.radius < 1.5 * self.h);
        let thinnest = thin.min_by(|a, b| a.radius.total_cmp(&b.radius))?;
        let voxels = thinnest.radius / self.h;
        let is_widened = self.scene.bake().widen;
        let weight = match (is_widened, most < 1.5 * self.h) {
            (true, true) => Weight::Warning,
            (true, false) => Weight::Note,
            (false, _) if voxels < 0.75 => Weight::Serious,
            (false, _) => Weight::Warning,
        };
        Some(self.say(
            ("thin", weight, -voxels),
            &[Key::Name("radius")],
            format!("a radius of {} voxels", figure(voxels)),
            format!("at {} m along the curve", figure(thinnest.s)),
            if is_widened {
                format!(
                    "parts thinner than three voxels are widened, and keep their mass; voxels of {} m show them as they are",
                    figure(thinnest.radius / 3.0)
                )
            } else {
                "parts between voxels are lost: `widen = true` keeps their mass".to_owned()
            },
        ))
    }

    /// Radii that change by more than two metres a metre, or jump.
    fn slopes(&self) -> Option<Hazard> {
        /// As near to a place as two radii are looked at, in lengths of the curve.
        const BESIDE: f64 = 1e-9;
        let (length, radius) = (self.tube.curve.length(), &self.tube.radius);
        let jump = |knot: &f64| radius.at((knot + BESIDE).min(1.0)) - radius.at((knot - BESIDE).max(0.0));
        let jumps = radius.knots().iter().filter(|knot| (BESIDE..1.0 - BESIDE).contains(*knot));
        let knot = jumps.max_by(|a, b| jump(a).abs().total_cmp(&jump(b).abs()));
        if let Some(knot) = knot.filter(|knot| jump(knot).abs() > 0.05 * radius.max()) {
            return Some(self.say(
                ("jump", Weight::Note, jump(knot).abs()),
                &[Key::Name("radius")],
                format!("the radius jumps by {} m", figure(jump(knot))),
                format!("at {} m along the curve", figure(knot * length)),
                "the tube ends in a plate there; two keys at different places make a slope",
            ));
        }
        let mut places: Vec<f64> = self.places().map(|place| place.s / length).collect();
        places.extend(radius.knots());
        places.sort_by(f64::total_cmp);
        places.dedup_by(|a, b| *a - *b <= BESIDE);
        let slope =
            |pair: &[f64]| ((radius.at(pair[1]) - radius.at(pair[0])) / ((pair[1] - pair[0]) * length)).abs();
        let pair = places.windows(2).max_by(|a, b| slope(a).total_cmp(&slope(b)))?;
        let most = slope(pair);
        (most > 2.0).then(|| {
            self.say(
                ("steep", Weight::Note, most),
                &[Key::Name("radius")],
                format!("the radius changes by {} m a metre", figure(most)),
                format!("at {} m along the curve", figure(pair[0] * length)),
                "a disc across the axis is the tube there, however steep: it looks like a plate, not like a bulge",
            )
        })
    }

    /// Sectors that wind faster than voxels can show.
    fn sectors(&self) -> Option<Hazard> {
        let is_cut = self.tube.layers.iter().any(|layer| layer.pattern == Pattern::Sectors);
        let turns = self.tube.twist.abs() * self.h / self.tube.curve.length();
        (is_cut && turns > 0.125).then(|| {
            self.say(
                ("twist", if turns > 0.25 { Weight::Serious } else { Weight::Warning }, turns),
                &[Key::Name("twist")],
                format!("{} turns in a voxel", figure(turns)),
                "sectors have two planes a turn".to_owned(),
                format!("voxels of {} m show them", figure(0.125 * self.h / turns)),
            )
        })
    }

    /// Octaves that are finer than the voxels.
    fn octaves(&self, number: usize) -> Option<Hazard> {
        let Pattern::Perlin(sum) = &self.tube.layers[number].pattern else { return None };
        let key = |name| [Key::Name("layer"), Key::Number(number), Key::Name(name)];
        let cells =
            |octave: u32| self.cells(sum.space, sum.frequency) * libm::pow(sum.lacunarity, f64::from(octave));
        let fine = |limit: f64| (0..sum.octaves).filter(|octave| cells(*octave) > limit).count();
        let last = (0..sum.octaves).map(cells).fold(0.0, f64::max);
        if !self.scene.bake().octave_fade {
            let aliased = fine(NYQUIST);
            return (aliased > 0).then(|| {
                self.say(
                    ("aliasing", Weight::Serious, last),
                    &key("octaves"),
                    format!("{aliased} of {} octaves alias", sum.octaves),
                    format!("up to {} cells a voxel", figure(last)),
                    format!(
                        "`octave_fade = true` fades them; voxels of {} m show them",
                        figure(NYQUIST * self.h / last)
                    ),
                )
            });
        }
        let faded = fine(1.6);
        (faded > 0).then(|| {
            self.say(
                ("octaves", if faded == sum.octaves as usize { Weight::Serious } else { Weight::Note }, last),
                &key("octaves"),
                format!("{faded} of {} octaves fade out", sum.octaves),
                format!("up to {} cells a voxel", figure(last)),
                format!("voxels of {} m show them all", figure(0.7 * self.h / last)),
            )
        })
    }

    /// Warps that crowd octaves which a voxel could show without.
    fn warp(&self, number: usize) -> Option<Hazard> {
        let Pattern::Perlin(sum) = &self.tube.layers[number].pattern else { return None };
        let warp = sum.warp.as_ref()?;
        let fades = self.scene.bake().octave_fade;
        let cells = |frequency: [f64; 3], lacunarity: f64, octaves: u32| {
            let first = self.cells(sum.space, frequency);
            let all =
                (0..octaves).map(move |octave| (octave, first * libm::pow(lacunarity, f64::from(octave))));
            all.filter(move |(_, cells)| !fades || *cells <= HALF_FADED)
        };
        let finest =
            cells(sum.frequency, sum.lacunarity, sum.octaves).map(|(_, cells)| cells).fold(0.0, f64::max);
        // By how many cells of the first octave the warp moves what is a voxel apart: root mean square, as octaves are independent.
        let whole: f64 = (0..warp.octaves).map(|octave| libm::pow(warp.gain, f64::from(octave))).sum();
        let slopes = cells(warp.frequency, warp.lacunarity, warp.octaves)
            .map(|(octave, cells)| SLOPE * libm::pow(warp.gain, f64::from(octave)) * cells / whole);
        let slope = slopes.map(|slope| slope * slope).sum::<f64>().sqrt();
        let first = self.cells(sum.space, sum.frequency);
        let crowded = finest * (1.0 + warp.amplitude * slope / first);
        let is_crowded = first > 0.0 && finest > 0.0 && crowded > 2.0 * HALF_FADED.max(finest);
        is_crowded.then(|| {
            let keys = [Key::Name("layer"), Key::Number(number), Key::Name("warp")];
            self.say(
                ("warp", Weight::Warning, crowded),
                &keys,
                format!("the warp crowds noise to some {} cells a voxel", figure(crowded)),
                format!("{} without it; octaves fade as if there were none", figure(finest)),
                format!(
                    "a smaller `amplitude` or `frequency` of the warp, fewer octaves, or voxels of {} m",
                    figure(self.h * HALF_FADED / crowded)
                ),
            )
        })
    }

    /// Cells of a pattern's first octave a voxel where the tube is widest, half a radius from its axis or, in the world, anywhere:
    /// the larger singular value of how fast the pattern's coordinates change across the tube, around it by twist, and along it.
    fn cells(&self, space: Space, frequency: [f64; 3]) -> f64 {
        let [u, v, l] = frequency;
        match space {
            Space::World => self.h * u.max(v).max(l),
            Space::Cylinder => {
                let length = self.tube.curve.length();
                let across = u.max(v) / self.tube.radius.max();
                let along = if self.tube.stretch { l / length } else { l };
                let around = 0.5 * TAU * self.tube.twist * u.max(v) / length;
                // Of [[across, around], [0, along]].
                let sum = across * across + around * around + along * along;
                let product = across * along;
                let root = (sum * sum - 4.0 * product * product).max(0.0).sqrt();
                self.h * (0.5 * (sum + root)).sqrt()
            }
        }
    }
}

/// Of a layer all of whose octaves have faded, so that nothing may be left of it above a threshold: which it is, in words.
pub fn faded_layer(scene: &Scene, lattice: Lattice) -> Option<String> {
    let h = lattice.voxel_size;
    let tubes = scene.tubes().iter().enumerate();
    let layers = tubes.flat_map(|(number, tube)| {
        let on = On { scene, tube, number, h };
        (0..tube.layers.len()).filter_map(move |layer| Some((number, layer, on.octaves(layer)?)))
    });
    let faded = |(number, layer, hazard): (usize, usize, Hazard)| {
        let is_faded = hazard.kind == "octaves" && hazard.weight() == Weight::Serious;
        let size = figure(0.7 * h / hazard.size);
        is_faded.then(|| {
            format!(
                "all octaves of layer {} of tube \"{}\" are finer than the voxels and fade out; voxels of {size} m show them",
                layer + 1,
                scene.tubes()[number].name
            )
        })
    };
    layers.filter_map(faded).next()
}

/// Where a function of t from 0 to 1 is least: by 64 places, and golden sections around the least of them.
fn least(f: impl Fn(f64) -> f64) -> f64 {
    const GOLDEN: f64 = 0.618_033_988_749_894_9;
    let places = (0..=64).map(|k| f64::from(k) / 64.0);
    let best = places.min_by(|a, b| f(*a).total_cmp(&f(*b))).unwrap_or_default();
    let (mut low, mut high) = ((best - 1.0 / 64.0).max(0.0), (best + 1.0 / 64.0).min(1.0));
    for _ in 0..80 {
        let (a, b) = (high - GOLDEN * (high - low), low + GOLDEN * (high - low));
        if f(a) < f(b) { high = b } else { low = a }
    }
    0.5 * (low + high)
}

/// Light that ends within a voxel, whatever the density.
fn extinction(scene: &Scene, h: f64) -> Option<Hazard> {
    let depth = scene.medium().extinction * h;
    (depth > 100.0).then(|| {
        let title = format!("an optical depth of {} in a voxel of density 1", figure(depth));
        let help = "pictures show a surface of voxels: smaller ones, or less extinction, show a volume";
        let keys = [Key::Name("medium"), Key::Name("extinction")];
        let remark = scene.remark(Weight::Warning, &keys, title, String::new(), help.to_owned());
        Hazard { kind: "stiff", size: depth, remark }
    })
}
