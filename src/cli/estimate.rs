//! What a bake will take, from a sample of its bricks.

use std::path::Path;
use std::time::Instant;

use cpu_time::ThreadTime;
use serde::Serialize;

use super::job::Job;
use super::memory::Need;
use super::recipe::compression_name;
use super::{Failure, machine};
use crate::formats::vdb::{Compression, EncodedBricks, Encoder, GridBound, Topology, VdbWriteError};
use crate::num::Level;
use crate::volume::{self, Brick, Encode, Plan, Precision, Sink};

/// Bricks that are baked: one sample after the other, as long as there is time. The largest is within 2 % of the whole
/// even where half of the bricks are empty.
const SAMPLES: [usize; 6] = [16, 64, 256, 1024, 4096, 16384];
/// Samples of fewer bricks do not show how much of the processors there is to be had.
const ENOUGH: usize = 1024;
/// Every so many bricks are encoded in all ways.
const TRIED: usize = 8;
const WAYS: [Compression; 3] = [Compression::Blosc, Compression::Zip, Compression::None];
/// Files that are smaller do not show how fast a disk is.
const LARGE: u64 = 256 << 20;

/// What a sample of the bricks lets expect.
#[derive(Debug, Default, Serialize)]
pub(super) struct Estimate {
    pub(super) sampled_bricks: u64,
    pub(super) active_voxels: u64,
    /// Of the file.
    pub(super) bytes: u64,
    /// Of the spool, which is gone at the end.
    pub(super) spooled_bytes: u64,
    /// That the process takes.
    pub(super) memory_bytes: u64,
    pub(super) seconds: f64,
    pub(super) cpu_seconds: f64,
    /// The same with every compression.
    pub(super) compressions: Vec<Way>,
    /// What is known that speaks against the chosen one.
    pub(super) advice: Option<String>,
}

/// What a compression makes of the grid.
#[derive(Debug, Clone, Serialize)]
pub(super) struct Way {
    pub(super) compression: &'static str,
    /// Of the file.
    pub(super) bytes: u64,
    /// Of all processors together: for all, and for encoding alone.
    pub(super) cpu_seconds: f64,
    pub(super) encode_cpu_seconds: f64,
}

/// A plan and what it takes at most.
pub(super) struct Planned<'a> {
    pub(super) plan: &'a Plan,
    pub(super) bound: &'a GridBound,
    pub(super) need: &'a Need,
    /// Bytes of a file without voxels.
    pub(super) empty: u64,
    /// Seconds that planning took.
    pub(super) seconds: f64,
}

impl Estimate {
    /// Bakes some of the bricks on the current `rayon` pool and scales up what they took. After so many seconds of
    /// `patience` no larger sample is begun. `folder` is where the file will be, if its disk is to be timed.
    ///
    /// # Errors
    /// As of a bake.
    pub(super) fn new(
        job: &Job,
        planned: &Planned<'_>,
        patience: f64,
        folder: Option<&Path>,
    ) -> Result<Estimate, Failure> {
        Estimate::of_samples(job, planned, patience, folder)
            .map_err(|error| Failure::failed("cannot foretell what the bake takes").because(error))
    }

    fn of_samples(
        job: &Job,
        planned: &Planned<'_>,
        patience: f64,
        folder: Option<&Path>,
    ) -> Result<Estimate, VdbWriteError> {
        let Planned { plan, need, .. } = *planned;
        let cutoff = job.scene.bake().cutoff;
        let started = Instant::now();
        let mut sizes = SAMPLES.into_iter();
        let (sample, sink, tally, phases, clock) = loop {
            let begun = Instant::now();
            let sample = plan.sample(sizes.next().unwrap_or(usize::MAX));
            let mut topology = Topology::default();
            topology.reserve(sample.bricks());
            let mut sink = Trial { encoder: job.encoder, topology, found: Tried::default() };
            let (tally, phases) =
                volume::bake(&job.field, &sample, cutoff, Level::best(), &mut sink, |_| {})?;
            let long = started.elapsed().as_secs_f64() > patience;
            if long || sizes.len() == 0 || sample.bricks() == plan.bricks() {
                break (sample, sink, tally, phases, begun.elapsed().as_secs_f64());
            }
        };
        let Trial { topology, found: Tried { bytes, ways, bricks, .. }, .. } = sink;
        let nodes = Nodes::new(planned, &job.bound(&sample), &sample, &topology);
        let whole = |part: u64| {
            let part = u128::from(part) * plan.bricks() as u128 / (sample.bricks() as u128).max(1);
            u64::try_from(part).unwrap_or(u64::MAX)
        };
        #[allow(clippy::cast_precision_loss, reason = "an estimate")]
        let [factor, tried, threads] = [
            plan.bricks() as f64 / sample.bricks().max(1) as f64,
            tally.bricks as f64 / bricks.max(1) as f64,
            rayon::current_num_threads() as f64,
        ];
        let stats = topology.stats();
        let (leaves, encoded) = (whole(stats.leaves), whole(bytes));
        let chosen = ways[place(job.encoder.compression())];
        let trials: f64 = ways.iter().map(|way| way.seconds).sum();
        let cpu = factor * (phases.evaluate + phases.encode - trials + phases.append);
        let compressions: Vec<Way> = (WAYS.into_iter().zip(ways))
            .map(|(compression, way)| {
                #[allow(clippy::cast_precision_loss, reason = "an estimate")]
                let share = if chosen.bytes > 0 { way.bytes as f64 / chosen.bytes as f64 } else { 1.0 };
                #[allow(
                    clippy::cast_possible_truncation,
                    clippy::cast_sign_loss,
                    clippy::cast_precision_loss,
                    reason = "an estimate; exact for the compression that was chosen"
                )]
                let encoded = if share == 1.0 { encoded } else { (share * encoded as f64) as u64 };
                let encoder = Encoder::new(compression).with_precision(job.encoder.precision());
                Ok(Way {
                    compression: compression_name(compression),
                    bytes: planned.empty + nodes.bytes(encoder)? + 64 * leaves + encoded,
                    cpu_seconds: planned.seconds + cpu + factor * tried * (way.seconds - chosen.seconds),
                    encode_cpu_seconds: factor * tried * way.seconds,
                })
            })
            .collect::<Result<_, VdbWriteError>>()?;
        let bytes = planned.empty + nodes.bytes(job.encoder)? + 64 * leaves + encoded;
        let spooled_bytes = need.spooled(job.budget(), encoded);
        // By the clock, for each second of a processor: other programs want processors, too.
        let used = phases.evaluate + phases.encode + phases.append;
        let share = if sample.bricks() < ENOUGH { 1.0 / threads } else { (clock / used).max(1.0 / threads) };
        let [waiting, copying] = on_disk(bytes, spooled_bytes, folder);
        Ok(Estimate {
            sampled_bricks: sample.bricks() as u64,
            active_voxels: whole(tally.active_voxels),
            bytes,
            spooled_bytes,
            memory_bytes: need.about(job.budget(), [leaves, whole(stats.tiles[0])], encoded, job.resident()),
            seconds: planned.seconds + waiting[1] + waiting[0].max((cpu + copying[0]) * share),
            cpu_seconds: planned.seconds + cpu + copying[0] + copying[1],
            advice: advice(&compressions, compression_name(job.encoder.compression())),
            compressions,
        })
    }
}

/// Nodes above leaves, from those of a sample.
struct Nodes<'a> {
    /// What the sample holds.
    found: &'a Topology,
    /// Bytes at most of those of which nothing was sampled: masks, and values.
    unseen: [u64; 2],
}

impl<'a> Nodes<'a> {
    fn new(planned: &Planned<'_>, seen: &GridBound, sample: &Plan, found: &'a Topology) -> Nodes<'a> {
        let masks = |bound: &GridBound, bricks: usize| bound.masks - 64 * bricks as u64;
        let all = planned.bound;
        let masks = masks(all, planned.plan.bricks()) - masks(seen, sample.bricks());
        Nodes { found, unseen: [masks, all.entries - seen.entries] }
    }

    /// What they take in a file. A node is left out where all that was sampled of it is empty.
    fn bytes(&self, encoder: Encoder) -> Result<u64, VdbWriteError> {
        let none = Topology::<f32>::default().file_bytes(encoder)?;
        let found = self.found.file_bytes(encoder)? - none - 64 * self.found.stats().leaves;
        let [masks, values] = self.unseen;
        // Values take their full size only where nothing is compressed.
        Ok(found + masks + if encoder.compression() == Compression::None { values } else { 0 })
    }
}

/// Seconds that the spool takes, and then the file, by the clock and of processors. Small ones are not worth a trial.
fn on_disk(file: u64, spool: u64, folder: Option<&Path>) -> [[f64; 2]; 2] {
    let bytes = file + spool;
    let speed = folder.filter(|_| bytes >= LARGE).and_then(|folder| machine::disk_speed(folder, bytes));
    #[allow(clippy::cast_precision_loss, reason = "an estimate")]
    let [file, spool] = [file as f64, spool as f64];
    let [clock, cpu] = speed.unwrap_or_default();
    // What is in the spool is read again, and hardly from the disk.
    [[clock * spool, clock * file], [cpu * spool, cpu * (file + spool)]]
}

/// What speaks against the compression that was chosen: another one that takes a tenth off all work, and hardly a larger
/// file.
fn advice(ways: &[Way], chosen: &str) -> Option<String> {
    /// How much larger.
    const LARGER: f64 = 1.05;
    const FASTER: f64 = 0.9;
    let own = ways.iter().find(|way| way.compression == chosen)?;
    #[allow(clippy::cast_precision_loss, reason = "an estimate")]
    let share = |way: &Way| way.bytes as f64 / own.bytes as f64;
    let better = |way: &&Way| share(way) <= LARGER && way.cpu_seconds <= FASTER * own.cpu_seconds;
    let other = ways.iter().filter(better).min_by(|a, b| a.cpu_seconds.total_cmp(&b.cpu_seconds))?;
    let percent = |x: f64| format!("{:.1} %", 100.0 * x);
    let size = share(other) - 1.0;
    Some(format!(
        "{chosen} is hardly worth its time here: --compression {} takes {} less, for a file that is {} {}",
        other.compression,
        percent(1.0 - other.cpu_seconds / own.cpu_seconds),
        percent(size.abs()),
        if size > 0.0 { "larger" } else { "smaller" },
    ))
}

/// Where a compression stands in `WAYS`.
fn place(compression: Compression) -> usize {
    WAYS.iter().position(|way| *way == compression).unwrap_or_default()
}

/// A sink that only measures.
struct Trial {
    encoder: Encoder,
    topology: Topology,
    found: Tried,
}

/// What was measured.
#[derive(Default)]
struct Tried {
    /// Of encoded leaves.
    bytes: u64,
    /// Bricks that were encoded in all ways.
    bricks: u64,
    ways: [Cost; 3],
    count: usize,
    /// What a bake would hold of a run.
    encoded: EncodedBricks,
    trial: EncodedBricks,
}

#[derive(Debug, Clone, Copy, Default)]
struct Cost {
    bytes: u64,
    /// Of a processor.
    seconds: f64,
}

/// Encodes bricks to learn what that takes.
#[derive(Clone, Copy)]
struct Trying(Encoder);

impl Encode for Trying {
    type Run = Tried;

    fn precision(&self) -> Precision {
        self.0.precision()
    }

    fn encode(&self, brick: &Brick, run: &mut Tried) {
        run.encoded.push(self.0, brick.origin, &brick.mask, &brick.values);
        if run.count.is_multiple_of(TRIED) {
            run.bricks += 1;
            for (compression, cost) in WAYS.into_iter().zip(&mut run.ways) {
                let encoder = Encoder::new(compression).with_precision(self.0.precision());
                let started = ThreadTime::now();
                run.trial.clear();
                run.trial.push(encoder, brick.origin, &brick.mask, &brick.values);
                cost.bytes += run.trial.encoded_bytes() as u64;
                cost.seconds += started.elapsed().as_secs_f64();
            }
        }
        run.count += 1;
    }
}

impl Sink for Trial {
    type Encoder = Trying;
    type Error = VdbWriteError;

    fn encoder(&self) -> Trying {
        Trying(self.encoder)
    }

    fn append(&mut self, run: Tried) -> Result<(), VdbWriteError> {
        run.encoded.add_to(&mut self.topology)?;
        self.found.bytes += run.encoded.encoded_bytes() as u64;
        self.found.bricks += run.bricks;
        for (sum, cost) in self.found.ways.iter_mut().zip(run.ways) {
            sum.bytes += cost.bytes;
            sum.seconds += cost.seconds;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_compression_that_takes_long_for_little_is_advised_against() {
        let way = |compression, bytes, cpu_seconds| Way {
            compression,
            bytes,
            cpu_seconds,
            encode_cpu_seconds: 0.0,
        };
        let ways = [way("blosc", 1030, 11.0), way("zip", 1000, 20.0), way("none", 2000, 10.0)];
        let text = advice(&ways, "zip").expect("slow");
        assert!(
            text.contains("--compression blosc takes 45.0 % less, for a file that is 3.0 % larger"),
            "{text}"
        );
        assert_eq!((advice(&ways, "blosc"), advice(&ways, "none")), (None, None));
        let noise = [way("blosc", 1000, 12.0), way("zip", 990, 20.0), way("none", 1010, 10.0)];
        assert!(advice(&noise, "blosc").is_some_and(|text| text.contains("--compression none")));
    }
}
