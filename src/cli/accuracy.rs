//! A voxel size from an error, or from a file's size.

use clap::{Args, ValueEnum};

use super::compare::figure;
use super::job::{Job, Moment, Options, SEARCH, Source, bounds};
use super::memory::{Amount, BRICK, PROGRAM, enough};
use super::{Failure, text};
use crate::field::{Field, Lattice};
use crate::formats::vdb::{EncodedBricks, Encoder, Topology, VdbWriteError};
use crate::num::Level;
use crate::report::{
    Goal, Look, Metric, Order, Outcome, Search, Step, Survey, TrialError, most_octaves, with_octaves,
};
use crate::scene::{Caps, Pattern, Radial, Scene};
use crate::volume::{self, Filter, PlanError, Precision, Sink};

/// Points and rays of a pilot.
const POINTS: usize = 30_000;
const RAYS: usize = 400;
const STREAM: u64 = 0x7069_6c6f;
/// Voxels along the longest side that pilots begin with, and the fewest that are taken.
const FIRST: f64 = 64.0;
const FEWEST: f64 = 4.0;
/// Bakes, at most.
pub(super) const MOST_ROUNDS: u32 = 5;
/// Bytes that pilots take besides plans: points and what is known of them, and bricks that are baked at once.
const PILOTS: u64 = 10 << 20;
/// Plans that are held at once, at most, and along rays.
const PLANS: u64 = 2;
const PLANS_ALONG: u64 = 3;
/// Times the memory that is expected to be needed.
const SPARE: f64 = 1.05;
/// Bricks of which a file's size is foretold.
const SAMPLE: usize = 4096;
/// Bytes of a certificate with some pilots.
const CERTIFICATE: u64 = 6 << 10;
/// What is aimed at of a file's size, what is taken of one that is foretold, and what a file takes at least.
const AIM: f64 = 0.96;
const TAKEN: [f64; 2] = [0.92, 0.99];
const FILLED: f64 = 0.9;
/// The part of a limit that a pilot's error is at most where it is sure to be met.
const AIMED: f64 = 0.88;
/// Errors that fall with less than this power do not fall at all.
const NO_ORDER: f64 = 0.1;
/// Times the error of a voxel size that its file is certain to meet.
const WITHIN: f64 = 1.3;
/// What is aimed at of an error after one that was too large, with all that points do not tell.
const NEXT: f64 = 0.96;

/// How exact a file is to be.
#[derive(Debug, Args)]
pub(super) struct AccuracyOptions {
    /// The largest error that the file may have, relative, such as 0.01: finds the largest voxel that meets it, bakes, measures
    /// what was baked, and certifies it
    #[arg(long, value_name = "E", value_parser = limit, conflicts_with_all = ["voxel_size", "resolution", "frames"],
        allow_negative_numbers = true)]
    max_error: Option<f64>,
    /// What that error is [default: l2]
    #[arg(long, value_enum, value_name = "METRIC", requires = "max_error")]
    error_metric: Option<MetricName>,
    /// The most bytes that the file may take, such as 200MB: finds voxels with which it takes no more, and at least 0.9 of them,
    /// unless smaller voxels show no more, or of five bakes none lies between; with --max-error the error decides, and a bake
    /// that would take more is refused
    #[arg(long, value_name = "SIZE", conflicts_with_all = ["voxel_size", "resolution", "frames"],
        allow_negative_numbers = true)]
    max_bytes: Option<Amount>,
    /// Measure the file's error against the scene's definition, and keep it in the file's metadata, and beside it as
    /// NAME.certificate.json
    #[arg(long)]
    certify: bool,
}

/// See [`Metric`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum MetricName {
    /// Root mean square of the difference over that of the density
    L2,
    /// The largest difference over the density's peak
    Max,
    /// Root mean square of the difference of optical depths over that of the density's
    OpticalDepth,
    /// How far the mass is off, as a part of it. It does not fall with the voxels' size steadily, since what is too much in some
    /// places makes up for what is too little in others: of the voxel sizes tried, the first that meets E is taken, and may be
    /// far better
    Mass,
}

fn limit(text: &str) -> Result<f64, String> {
    let limit = text.parse().ok().filter(|limit: &f64| (1e-7..1.0).contains(limit));
    limit.ok_or_else(|| "expected a part above 0 and below 1, at least 1e-7".to_owned())
}

/// What was chosen, and how.
#[derive(Debug, Clone, Default)]
pub(super) struct Chosen {
    pub(super) goal: Option<Goal>,
    pub(super) most_bytes: Option<u64>,
    pub(super) certify: bool,
    /// With which the error falls, at the finest pilots.
    pub(super) order: Option<f64>,
    pub(super) pilots: Vec<Step>,
    /// Bytes that the file is expected to take, where it may not take more than some.
    about: Option<u64>,
    /// Whether smaller voxels make a larger file.
    grows: bool,
    /// Whether values are stored in half precision.
    is_half: bool,
}

impl Chosen {
    /// Whether the file is to be measured.
    pub(super) fn measures(&self) -> bool {
        self.certify || self.goal.is_some()
    }

    /// Why a file of so many bytes is not what was asked for. A last bake may be of few.
    pub(super) fn misses(&self, bytes: u64, round: u32) -> Option<Miss> {
        let most = self.most_bytes?;
        #[allow(clippy::cast_precision_loss, reason = "a part")]
        let part = bytes as f64 / most.max(1) as f64;
        if bytes > most {
            Some(Miss::Bytes(bytes))
        } else if self.goal.is_none() && self.grows && part < FILLED && round < MOST_ROUNDS {
            Some(Miss::Few(bytes))
        } else {
            None
        }
    }

    /// Whether other voxels are of no use: smaller ones take more bytes, and larger ones miss the error.
    pub(super) fn is_final(&self, miss: Miss) -> bool {
        matches!(miss, Miss::Bytes(_)) && self.goal.is_some()
    }
}

/// Why a file is not what was asked for.
#[derive(Debug, Clone, Copy)]
pub(super) enum Miss {
    /// The error, and what it may be.
    Error([f64; 2]),
    Bytes(u64),
    /// Too few of those that are allowed.
    Few(u64),
}

impl AccuracyOptions {
    /// Finds the voxel size, where it is asked for, and gives it to the source.
    pub(super) fn choose(
        &self,
        source: &mut Source,
        moment: Moment,
        options: &Options,
        stop: impl Fn() -> Result<(), Failure>,
    ) -> Result<Chosen, Failure> {
        let metric = match self.error_metric.unwrap_or(MetricName::L2) {
            MetricName::L2 => Metric::L2,
            MetricName::Max => Metric::Max,
            MetricName::OpticalDepth => Metric::OpticalDepth,
            MetricName::Mass => Metric::Mass,
        };
        let goal = self.max_error.map(|limit| Goal { metric, limit });
        let most_bytes = self.max_bytes.map(Amount::bytes);
        let is_half = options.stored() == Precision::F16;
        let mut chosen = Chosen { goal, most_bytes, certify: self.certify, is_half, ..Chosen::default() };
        let scene = source.start.at(moment.time)?;
        let Some(longest) = longest(&scene) else { return Ok(chosen) };
        source.settle_resident();
        if let Some(goal) = goal {
            let precision = options.stored();
            let memory = options.scene.budget().bytes();
            let survey = surveyed(&scene, goal.metric, precision, memory);
            let voxel_size = by_error(&survey, goal, longest, &mut chosen, &stop)?;
            source.set_voxel_size(voxel_size);
            if let Some(most) = most_bytes {
                let bytes = about(&Job::new(source, moment, options)?, true)?;
                chosen.about = Some(bytes);
                if bytes > most {
                    let failure = too_large(&chosen, goal, &format!("about {}", text::bytes(bytes)), most);
                    // What the bytes are enough for, where they are for anything.
                    by_bytes(source, moment, options, longest, (most, true), &stop)?;
                    let error = survey.error(source.voxel_size(), goal.metric).unwrap_or(1.0);
                    return Err(match WITHIN * error {
                        within if within < 1.0 => {
                            failure.hint(format!("--max-error {} takes no more than that", round_up(within)))
                        }
                        _ => failure,
                    });
                }
            }
        } else if let Some(most) = most_bytes {
            let (about, grows) =
                by_bytes(source, moment, options, longest, (most, chosen.measures()), &stop)?;
            (chosen.about, chosen.grows) = (Some(about), grows);
        }
        Ok(chosen)
    }
}

/// Other voxels than those of bakes that missed what was asked for: smaller ones where the error was too large, or the file too
/// small. Those are remembered whose files were small enough, and too large.
#[derive(Debug, Default)]
pub(super) struct Retry {
    fits: Option<f64>,
    exceeds: Option<f64>,
}

impl Retry {
    /// After bake number `round` missed.
    pub(super) fn next(&mut self, chosen: &Chosen, voxel_size: f64, miss: Miss, round: u32) -> f64 {
        match miss {
            Miss::Error([_, at_most]) => {
                let limit = chosen.goal.map_or(at_most, |goal| goal.limit);
                let order = chosen.order.unwrap_or(1.0).clamp(0.5, 3.0);
                return voxel_size * libm::pow(NEXT * limit / at_most, 1.0 / order).clamp(0.5, 0.98);
            }
            Miss::Bytes(_) => self.exceeds = Some(voxel_size),
            Miss::Few(_) => self.fits = Some(voxel_size),
        }
        let (Miss::Bytes(bytes) | Miss::Few(bytes)) = miss else { return voxel_size };
        #[allow(clippy::cast_precision_loss, reason = "an estimate")]
        let over = bytes as f64 / (AIM * chosen.most_bytes.unwrap_or(bytes).max(1) as f64);
        let factor = libm::cbrt(over);
        let next = match miss {
            Miss::Few(_) => voxel_size * factor.clamp(0.5, 0.99),
            _ => voxel_size * factor.max(1.01),
        };
        match (self.exceeds, self.fits) {
            // The last bake is of what is known to fit.
            (_, Some(fits)) if round + 1 == MOST_ROUNDS => fits,
            (Some(low), Some(high)) if low < high => {
                let between = |part: f64| low * libm::pow(high / low, part);
                next.clamp(between(0.2), between(0.8))
            }
            _ => next,
        }
    }
}

/// What to say where no bake was good enough.
pub(super) fn missed(chosen: &Chosen, miss: Miss) -> Failure {
    match miss {
        Miss::Error([achieved, at_most]) => {
            let goal = chosen.goal.unwrap_or(Goal { metric: Metric::L2, limit: 0.0 });
            Failure::failed(format!(
                "after {MOST_ROUNDS} bakes the {} is {}, at most {} as far as points tell, and {} is asked for",
                goal.metric.name(),
                figure(achieved),
                figure(at_most),
                figure(goal.limit)
            ))
            .hint(if chosen.is_half {
                "allow a larger --max-error, or store single precision with --precision f32"
            } else {
                "allow a larger --max-error, or choose another --error-metric"
            })
        }
        Miss::Bytes(bytes) | Miss::Few(bytes) => {
            let most = chosen.most_bytes.unwrap_or_default();
            let bytes = text::bytes(bytes);
            match chosen.goal {
                Some(goal) => too_large(chosen, goal, &bytes, most),
                None => Failure::failed(format!(
                    "the file takes {bytes}, and no more than {} are allowed",
                    text::bytes(most)
                ))
                .hint("allow more with --max-bytes"),
            }
        }
    }
}

/// Of a file that is small enough in its error alone.
fn too_large(chosen: &Chosen, goal: Goal, bytes: &str, most: u64) -> Failure {
    let failure = Failure::failed(format!(
        "--max-bytes is too small for --max-error: a {} of {} takes a file of {bytes}, and {} are allowed",
        goal.metric.name(),
        figure(goal.limit),
        text::bytes(most)
    ));
    let larger = "allow a larger --max-error or --max-bytes";
    failure.hint(if chosen.is_half {
        larger.to_owned()
    } else {
        format!("{larger}, or store half precision with --precision f16")
    })
}

/// Two digits, no less than it is.
fn round_up(x: f64) -> f64 {
    let unit = libm::pow(10.0, libm::log10(x).floor() - 1.0);
    format!("{:.1e}", (x / unit).ceil() * unit).parse().unwrap_or(x)
}

/// The longest side of a scene's density, metres; `None` where there is none.
fn longest(scene: &Scene) -> Option<f64> {
    let [lo, hi] = bounds(&Field::compile(scene))?;
    let longest = [0, 1, 2].map(|axis| hi[axis] - lo[axis]).into_iter().fold(0.0, f64::max);
    (longest > 0.0).then_some(longest)
}

/// The largest radius of a scene's tubes, metres.
fn thickest(scene: &Scene) -> f64 {
    scene.tubes().iter().map(|tube| tube.radius.max()).fold(0.0, f64::max)
}

/// What pilots look at.
fn pilot(precision: Precision) -> Look {
    Look { points: POINTS, rays: RAYS, stream: STREAM, filter: Filter::Trilinear, precision }
}

/// Times that plans as large as they may be have room in the memory that pilots have for them.
fn plans(metric: Metric) -> u64 {
    if metric == Metric::OpticalDepth { PLANS_ALONG } else { PLANS }
}

/// Pilots in so much memory, of bakes that have room in it.
fn surveyed(scene: &Scene, metric: Metric, precision: Precision, memory: u64) -> Survey<'_> {
    let plans = plans(metric);
    let budget = memory.saturating_sub(PROGRAM + PILOTS) / plans;
    Survey::new(scene, pilot(precision), budget).for_bakes(BRICK, plans)
}

fn by_error(
    survey: &Survey<'_>,
    goal: Goal,
    longest: f64,
    chosen: &mut Chosen,
    stop: &impl Fn() -> Result<(), Failure>,
) -> Result<f64, Failure> {
    let scene = survey.pilot().scene();
    let (first, largest) = (longest / FIRST, longest / FEWEST);
    // Of thinner tubes voxels show nothing but where they are.
    let thickest = thickest(scene);
    let is_local = matches!(goal.metric, Metric::L2 | Metric::Max);
    let mut search = Search::new(goal.limit, if is_local { first.min(thickest) } else { first }, largest);
    // Beside a jump a filtered value is off by half of it, whatever the voxel size.
    if goal.metric == Metric::Max && jumps(scene) {
        search = search.of_jumps();
    }
    // Voxel sizes, and about the bytes that they take.
    let mut planned: Vec<[f64; 2]> = Vec::new();
    let outcome = loop {
        stop()?;
        let error = match survey.error(search.next(), goal.metric) {
            // No point sees any density.
            Ok(error) if error.is_infinite() && search.next() > thickest => {
                search = Search::new(goal.limit, thickest, largest);
                continue;
            }
            Ok(error) => {
                #[allow(clippy::cast_precision_loss, reason = "an estimate")]
                let bytes = (plans(goal.metric) * survey.planned()) as f64;
                planned.push([search.next(), bytes]);
                error
            }
            Err(TrialError::Plan(error)) => {
                return Err(unplanned(survey, goal, &search, longest, planned, error));
            }
            Err(error) => return Err(Failure::failed("cannot try a voxel size").because(error)),
        };
        if let Some(outcome) = search.add(error) {
            break outcome;
        }
    };
    chosen.order = search.order().map(|order| order.order);
    chosen.pilots = search.steps().to_vec();
    match outcome {
        Outcome::Found(voxel_size) => Ok(voxel_size),
        Outcome::Slow { order, voxel_size } => Err(slow(survey, goal, &search, longest, order, voxel_size)),
        Outcome::Lost => Err(coarse(survey, goal, &search).unwrap_or_else(|| {
            Failure::failed(format!(
                "no voxel size was found with a {} of {}, in {}",
                goal.metric.name(),
                figure(goal.limit),
                text::number(search.steps().len() as u64, "trial")
            ))
            .hint("allow a larger --max-error, or choose another --error-metric")
        })),
    }
}

/// What to say where the precision of values keeps the error from falling; `None` where it does not.
fn coarse(survey: &Survey<'_>, goal: Goal, search: &Search) -> Option<Failure> {
    let last = search.steps().last()?;
    let parts = survey.parts(last.voxel_size).ok()?;
    let others = parts.interpolation.rms.max(parts.model.rms);
    if parts.quantisation.rms <= others {
        return None;
    }
    let share = parts.quantisation.of_truth.map_or_else(String::new, |share| {
        format!(", and of the relative L2 half precision alone makes {}", figure(share))
    });
    let failure = Failure::failed(format!(
        "values in half precision are too coarse for a {} of {}{}{share}",
        goal.metric.name(),
        figure(goal.limit),
        reached(search),
    ));
    Some(failure.hint("store them in single precision, with --precision f32, or allow a larger --max-error"))
}

/// What the finest voxels reached.
fn reached(search: &Search) -> String {
    let finest = search.steps().iter().min_by(|a, b| a.voxel_size.total_cmp(&b.voxel_size));
    finest.map_or_else(String::new, |step| {
        format!(": at {} m it is {}", figure(step.voxel_size), figure(step.error))
    })
}

/// Of voxels that there is no room for, with what to change.
fn unplanned(
    survey: &Survey<'_>,
    goal: Goal,
    search: &Search,
    longest: f64,
    mut planned: Vec<[f64; 2]>,
    error: PlanError,
) -> Failure {
    let expected = search.expected();
    let room = if error.enough().is_some() { " to bake and to measure in the memory" } else { "" };
    let failure = Failure::failed(format!(
        "a {} of {} needs voxels of about {} m, {} along the longest side, too many{room}{}",
        goal.metric.name(),
        figure(goal.limit),
        figure(expected),
        figure((longest / expected).ceil()),
        reached(search),
    ))
    .because(error);
    let Some(enough_for_one) = error.enough() else {
        return failure.hint("allow a larger --max-error, move the scene nearer to the origin, or divide it");
    };
    #[allow(clippy::cast_precision_loss, reason = "an estimate")]
    let enough_now = (plans(goal.metric).saturating_mul(enough_for_one)) as f64;
    let needed = if let PlanError::TooMany { enough: Some(_), .. } = error {
        planned.push([search.next(), enough_now]);
        bytes_at(&planned, expected).unwrap_or(enough_now).max(enough_now)
    } else {
        bytes_at(&planned, expected).unwrap_or_else(|| {
            // Bricks grow with the cube of what voxels shrink by, at most.
            let finer = search.next() / expected;
            finer * finer * finer * enough_now
        })
    };
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "saturates")]
    let bytes = ((SPARE * needed) as u64).saturating_add(PROGRAM + PILOTS).max(SEARCH);
    let failure =
        failure.hint(format!("allow a larger --max-error, or more with --memory {} or so", enough(bytes)));
    let failure = edges(survey.pilot().scene()).into_iter().fold(failure, Failure::hint);
    fewer_octaves(survey, goal, search).into_iter().fold(failure, Failure::hint)
}

/// About the bytes that a voxel size takes, from those of others: they grow as bricks do, with a power of the voxel size from 1
/// for thin tubes to 3 for thick ones.
fn bytes_at(planned: &[[f64; 2]], voxel_size: f64) -> Option<f64> {
    let mut finest: Vec<[f64; 2]> = planned.to_vec();
    finest.sort_unstable_by(|a, b| a[0].total_cmp(&b[0]));
    let [size, bytes] = *finest.first()?;
    finest.truncate(2);
    let power = Order::fit(&finest).map_or(3.0, |fit| (-fit.order).clamp(1.0, 3.0));
    Some(bytes * libm::pow(size / voxel_size, power).max(1.0))
}

/// With how many octaves the smallest voxels that there is room for would do.
fn fewer_octaves(survey: &Survey<'_>, goal: Goal, search: &Search) -> Option<String> {
    const TRIALS: usize = 4;
    let scene = survey.pilot().scene();
    let most = most_octaves(scene);
    let sizes = search.steps().iter().map(|step| step.voxel_size);
    let (mut fits, mut fails) = (sizes.reduce(f64::min).filter(|_| most > 1)?, search.next());
    for _ in 0..TRIALS {
        let middle = (fits * fails).sqrt();
        if survey.has_room(middle) { fits = middle } else { fails = middle }
    }
    let does = |octaves: u32| {
        let scene = with_octaves(scene, octaves);
        survey.of(&scene).error(fits, goal.metric).is_ok_and(|error| error <= AIMED * goal.limit)
    };
    if !does(1) {
        return None;
    }
    // The more octaves, the larger the error.
    let (mut few, mut many) = (1, most);
    while many - few > 1 {
        let middle = few.midpoint(many);
        if does(middle) { few = middle } else { many = middle }
    }
    Some(format!(
        "or leave out octaves: with octaves = {few}, at most, in every layer of noise, voxels of {} m would do, for which there is room",
        figure(fits)
    ))
}

/// Of an error that does not fall as it should, with what there is in the scene that makes it so.
fn slow(
    survey: &Survey<'_>,
    goal: Goal,
    search: &Search,
    longest: f64,
    order: f64,
    voxel_size: f64,
) -> Failure {
    if let Some(failure) = coarse(survey, goal, search) {
        return failure;
    }
    let failure = Failure::failed(if order < NO_ORDER {
        format!(
            "the {} does not fall with the voxel size{}; no voxels are small enough for {}",
            goal.metric.name(),
            reached(search),
            figure(goal.limit),
        )
    } else {
        format!(
            "the {} falls only with the power {order:.2} of the voxel size{}; {} would take voxels of about {} m, {} along the longest side",
            goal.metric.name(),
            reached(search),
            figure(goal.limit),
            figure(voxel_size),
            figure((longest / voxel_size).ceil()),
        )
    });
    let mut hints = edges(survey.pilot().scene());
    let last = search.steps().last().map_or(voxel_size, |step| step.voxel_size);
    if hints.is_empty()
        && let Ok(parts) = survey.parts(last)
        && parts.model.rms > parts.interpolation.rms
    {
        hints.push(
            "octaves are finer than the voxels: fewer octaves, or a smaller gain, take less".to_owned(),
        );
    }
    if hints.is_empty() {
        hints.push("the density has kinks or steps, where voxels are slow to follow".to_owned());
    }
    hints.push(match goal.metric {
        Metric::L2 => {
            "else allow a larger --max-error, or ask for --error-metric mass or optical-depth, which edges matter less to".to_owned()
        }
        Metric::Max => {
            "else ask for another --error-metric, such as mass or optical-depth, which edges matter less to".to_owned()
        }
        _ => "else allow a larger --max-error, or choose another --error-metric".to_owned(),
    });
    hints.into_iter().fold(failure, Failure::hint)
}

/// Whether a scene's density jumps anywhere: half of such a jump is missed at its place, however small voxels are.
fn jumps(scene: &Scene) -> bool {
    scene.tubes().iter().any(|tube| {
        matches!(tube.radial, Radial::Hard)
            || (tube.caps == Caps::Flat && !tube.curve.is_closed())
            || tube.layers.iter().any(|layer| matches!(layer.pattern, Pattern::Sectors))
    })
}

/// What in a scene makes edges, and what to change.
fn edges(scene: &Scene) -> Vec<String> {
    let mut hints = Vec::new();
    for tube in scene.tubes() {
        let name = text::tidy(&tube.name);
        match tube.radial {
            Radial::Hard => hints.push(format!(
                "tube \"{name}\" has a hard edge: envelope.radial = \"smooth\", or the width of a soft edge such as 0.3, softens it"
            )),
            Radial::Edge(width) if width < 0.2 => hints.push(format!(
                "tube \"{name}\" has a narrow edge: a larger envelope.radial than {width} softens it"
            )),
            _ => {}
        }
        if tube.caps == Caps::Flat && !tube.curve.is_closed() {
            hints.push(format!("tube \"{name}\" has flat ends: caps = \"fade\" softens them"));
        }
        if tube.layers.iter().any(|layer| matches!(layer.pattern, Pattern::Sectors)) {
            hints.push(format!("tube \"{name}\" has sectors, between which the density jumps"));
        }
    }
    hints
}

/// The bytes of a job's file, about where it has many bricks: the same at every run.
fn about(job: &Job, certified: bool) -> Result<u64, Failure> {
    let unknown = |error: VdbWriteError| Failure::failed("cannot foretell the file's size").because(error);
    let plan = job.plan()?;
    let sample = plan.sample(SAMPLE);
    let mut sized = Sized { encoder: job.encoder, topology: Topology::default(), bytes: 0 };
    volume::bake(&job.field, &sample, job.scene.bake().cutoff, Level::best(), &mut sized, |_| {})
        .map_err(unknown)?;
    let Sized { topology, bytes, .. } = sized;
    let empty = job.empty_file()? + if certified { CERTIFICATE } else { 0 };
    if sample.bricks() == plan.bricks() {
        let [all, none] = [&topology, &Topology::default()].map(|topology| topology.file_bytes(job.encoder));
        return Ok(empty + bytes + all.map_err(unknown)? - none.map_err(unknown)?);
    }
    let whole = |part: u64| {
        let scaled = u128::from(part) * plan.bricks() as u128 / (sample.bricks() as u128).max(1);
        u64::try_from(scaled).unwrap_or(u64::MAX)
    };
    // Masks of leaves that are, and of all nodes that may be: these are few where bricks are many.
    let nodes = job.bound(&plan).masks.saturating_sub(64 * plan.bricks() as u64);
    let leaves = 64 * whole(topology.stats().leaves);
    Ok((empty + nodes + leaves).saturating_add(whole(bytes)))
}

/// A sink that keeps only how large a file is.
struct Sized {
    encoder: Encoder,
    topology: Topology,
    /// Of encoded leaves.
    bytes: u64,
}

impl Sink for Sized {
    type Encoder = Encoder;
    type Error = VdbWriteError;

    fn encoder(&self) -> Encoder {
        self.encoder
    }

    fn append(&mut self, run: EncodedBricks) -> Result<(), VdbWriteError> {
        self.bytes += run.encoded_bytes() as u64;
        run.add_to(&mut self.topology)
    }
}

/// The bytes that a file of the voxels that are found takes, and whether smaller ones would show more. `certified` files hold
/// what they are measured to be.
fn by_bytes(
    source: &mut Source,
    moment: Moment,
    options: &Options,
    longest: f64,
    (most, certified): (u64, bool),
    stop: &impl Fn() -> Result<(), Failure>,
) -> Result<(u64, bool), Failure> {
    const TRIALS: usize = 12;
    let mut tried: Vec<[f64; 2]> = Vec::new();
    let mut voxel_size = longest / FIRST;
    for _ in 0..TRIALS {
        stop()?;
        source.set_voxel_size(voxel_size);
        let found = about(&Job::new(source, moment, options)?, certified)?;
        #[allow(clippy::cast_precision_loss, reason = "an estimate")]
        let [bytes, most] = [found as f64, most as f64];
        if (TAKEN[0] * most..=TAKEN[1] * most).contains(&bytes) {
            return Ok((found, true));
        }
        // Where smaller voxels show no more, the file does not grow.
        if tried
            .iter()
            .any(|[size, other]| *size >= 2.0 * voxel_size && bytes <= 1.01 * other && bytes < most)
        {
            return Ok((found, false));
        }
        tried.push([voxel_size, bytes]);
        let last: Vec<[f64; 2]> = tried.iter().rev().take(2).copied().collect();
        let order = Order::fit(&last).map_or(-3.0, |fit| fit.order).clamp(-3.5, -1.0);
        voxel_size *= libm::pow(AIM * most / bytes, 1.0 / order).clamp(0.1, 10.0);
        if voxel_size > longest {
            break;
        }
    }
    // The smallest voxel that takes no more.
    #[allow(clippy::cast_precision_loss, reason = "an estimate")]
    let fits = tried.iter().filter(|[_, bytes]| *bytes <= TAKEN[1] * most as f64);
    match fits.min_by(|a, b| a[0].total_cmp(&b[0])) {
        Some([size, bytes]) => {
            source.set_voxel_size(*size);
            #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "of bytes")]
            let bytes = *bytes as u64;
            Ok((bytes, true))
        }
        None => Err(Failure::failed(format!(
            "no file of at most {} shows anything of the scene",
            text::bytes(most)
        ))
        .hint("allow more with --max-bytes")),
    }
}

/// The lattice's voxel size, in words for notes.
pub(super) fn told(lattice: Lattice, chosen: &Chosen) -> Option<String> {
    let size = chosen.about.zip(chosen.most_bytes).map(|(about, most)| {
        format!("a file of about {} of the {} allowed", text::bytes(about), text::bytes(most))
    });
    let Some(goal) = chosen.goal else {
        return size.map(|size| format!("voxels of {} m are tried for {size}", figure(lattice.voxel_size)));
    };
    let order =
        chosen.order.map_or_else(String::new, |order| format!(", where it falls with the power {order:.2}"));
    Some(format!(
        "voxels of {} m are tried for a {} of {}, after {}{order}{}",
        figure(lattice.voxel_size),
        goal.metric.name(),
        figure(goal.limit),
        text::number(chosen.pilots.len() as u64, "pilot"),
        size.map_or_else(String::new, |size| format!("; the error decides, with {size}")),
    ))
}
