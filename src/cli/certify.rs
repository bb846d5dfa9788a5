//! What a file is measured to be, in it and beside it.

use std::fs::File;
use std::io::{self, Read, Seek};
use std::path::{Path, PathBuf};

use serde::Serialize;
use sha2::{Digest, Sha256};

use super::accuracy::{Chosen, Miss};
use super::compare::figure;
use super::job::Job;
use super::memory::enough;
use super::output::Output;
use super::recipe::CREATOR;
use super::text::{self, Table};
use super::{Failure, Global};
use crate::field::Lattice;
use crate::formats::vdb::{FileHeader, PagedGrid, VdbFile, VdbReadError};
use crate::report::{
    Certificate, FieldDifference, Look, Measured, Reached, Residuals, TrialError, measure, measuring,
};
use crate::scene::Scene;
use crate::volume::{Filter, Plan, PlanError, Precision};

/// Metadata that holds the certificate.
pub(super) const CERTIFICATE: &str = "vdbake_certificate";
/// Of its form.
pub(super) const VERSION: u32 = 1;
/// Other points than those that a voxel size is chosen by.
pub(super) const STREAM: u64 = 0x6365_7274;
const POINTS: usize = 60_000;
const RAYS: usize = 2000;
const TRUTH: &str = "the scene's definition in double precision: no octave faded, nothing widened";

/// What a certificate looks at.
pub(super) fn look(precision: Precision) -> Look {
    Look { points: POINTS, rays: RAYS, stream: STREAM, filter: Filter::Trilinear, precision }
}

/// The file beside another that holds its certificate.
pub(super) fn beside(path: &Path) -> PathBuf {
    path.with_extension("certificate.json")
}

/// What is written beside a file.
#[derive(Debug, Serialize)]
struct Beside<'a> {
    #[serde(flatten)]
    certificate: &'a Certificate,
    /// The scene's text.
    scene: &'a str,
}

/// The certificate as a file of its own.
pub(super) fn document(certificate: &Certificate, scene: &str) -> Result<Vec<u8>, Failure> {
    let mut bytes = serde_json::to_vec_pretty(&Beside { certificate, scene })
        .map_err(|error| Failure::failed("cannot write the certificate").because(error))?;
    bytes.push(b'\n');
    Ok(bytes)
}

/// As it is in the file itself.
pub(super) fn entry(certificate: &Certificate) -> Result<String, Failure> {
    serde_json::to_string(certificate)
        .map_err(|error| Failure::failed("cannot write the certificate").because(error))
}

/// Takes away the certificate of a file that is no more, if one lies there.
pub(super) fn forget(path: &Path) -> Result<(), Failure> {
    let beside = beside(path);
    let Some(Ok(_)) = read_beside(&beside) else { return Ok(()) };
    std::fs::remove_file(&beside).map_err(|error| {
        Failure::failed(format!("cannot remove {}, which is of an older file", beside.display()))
            .because(error)
    })
}

/// What lies under a certificate's name: `None` where there is nothing, and an error where that is no certificate.
pub(super) fn read_beside(beside: &Path) -> Option<Result<Certificate, String>> {
    /// Bytes of a certificate with its scene's text: more are none.
    const MOST: u64 = 1 << 28;
    let file = File::open(beside).ok()?;
    let mut text = String::new();
    let read = file.take(MOST).read_to_string(&mut text).map_err(|error| error.to_string());
    Some(read.and_then(|_| serde_json::from_str(&text).map_err(|error| error.to_string())))
}

/// The density of a file, leaf by leaf, within so many bytes.
pub(super) fn paged<R: Read + Seek>(input: R, budget: u64) -> Result<PagedGrid<R>, TrialError> {
    Ok(VdbFile::open_within(input, budget)?.paged("density")?)
}

/// Measures a file that `open` opens against the scene that it was baked from, in a process that may take so many bytes, and
/// takes some without.
pub(super) fn measured<R: Read + Seek>(
    scene: &Scene,
    lattice: Lattice,
    (path, open): (&Path, &dyn Fn() -> io::Result<R>),
    precision: Precision,
    [budget, besides]: [u64; 2],
) -> Result<(Measured, FieldDifference, Residuals), Failure> {
    let open = |bytes: u64| paged(open().map_err(VdbReadError::from)?, bytes);
    let found = measure(scene, lattice, open, look(precision), budget.saturating_sub(besides));
    found.map_err(|error| unmeasured(path, error, besides))
}

/// Refuses where there is no memory to measure what is baked of a plan, in a process that takes some besides.
pub(super) fn check(plan: &Plan, precision: Precision, [budget, besides]: [u64; 2]) -> Result<(), Failure> {
    let needed = measuring(look(precision), plan.making() as u64, plan.bricks() as u64);
    if budget >= besides.saturating_add(needed) {
        return Ok(());
    }
    Err(large(needed, besides))
}

/// Bytes that are enough for a process to measure a file of which the bricks found no room to be planned; `None` where it is
/// not memory that this wants.
pub(super) fn enough_for(error: PlanError, precision: Precision, besides: u64) -> Option<u64> {
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "saturates")]
    let bricks = if let PlanError::TooMany { bricks, .. } = error { bricks as u64 } else { 0 };
    error.enough().map(|making| besides.saturating_add(measuring(look(precision), making, bricks)))
}

/// The same of a job, whatever room there is.
pub(super) fn enough_unplanned(job: &Job) -> Option<u64> {
    let error = Plan::new(&job.field, job.lattice, 0).err()?;
    enough_for(error, job.encoder.precision(), job.process())
}

/// Of a file that takes so many bytes to be measured, in a process that takes some besides.
fn large(needed: u64, besides: u64) -> Failure {
    Failure::failed("the file takes too much memory to be measured")
        .hint(format!("allow more with --memory {}", enough(besides.saturating_add(needed))))
}

/// Why a file could not be measured in a process that takes so many bytes besides.
pub(super) fn unmeasured(path: &Path, error: TrialError, besides: u64) -> Failure {
    match error {
        // What is found out later may take a little more.
        TrialError::Memory { needed } => large(needed.saturating_add(needed / 16), besides),
        TrialError::Read(error) => Failure::input(format!("cannot read {}", path.display())).because(error),
        error => Failure::failed("cannot measure the file").because(error),
    }
}

/// A file that was written and has no name yet.
pub(super) struct Made<'a> {
    pub(super) job: &'a Job,
    pub(super) output: &'a Output,
    /// The name that it will have.
    pub(super) path: &'a Path,
    pub(super) header: &'a FileHeader,
    /// The hash of all values.
    pub(super) content: &'a str,
}

/// What it is certified to be, unless it misses what is asked for.
pub(super) fn certified(
    made: &Made<'_>,
    chosen: &Chosen,
    round: u32,
) -> Result<Result<Certificate, Miss>, Failure> {
    let Made { job, output, path, header, content } = made;
    let open = || {
        let mut file = output.file();
        file.rewind().map(|()| file)
    };
    let memory = [job.budget(), job.process()];
    let (measured, found, _) =
        measured(&job.scene, job.lattice, (path, &open), job.encoder.precision(), memory)?;
    let mut goal = None;
    if let Some(asked) = chosen.goal {
        // Of nothing nothing is missed.
        let nothing = if found.errors.is_of_nothing() { [0.0; 2] } else { [f64::INFINITY; 2] };
        let value = asked.metric.of(&found).unwrap_or(nothing);
        if value[1] > asked.limit {
            return Ok(Err(Miss::Error(value)));
        }
        goal = reached(chosen, value, round);
    }
    certificate(job, header, content, measured, goal).map(Ok)
}

/// The certificate of a file with this header and these values.
fn certificate(
    job: &Job,
    header: &FileHeader,
    content: &str,
    measured: Measured,
    goal: Option<Reached>,
) -> Result<Certificate, Failure> {
    let settings = serde_json::to_value(&job.settings)
        .map_err(|error| Failure::failed("cannot describe the settings").because(error))?;
    Ok(Certificate {
        version: VERSION,
        creator: CREATOR.to_owned(),
        scene_sha256: scene_hash(job.scene.text()),
        settings,
        content_hash: content.to_owned(),
        uuid: header.uuid.to_string(),
        truth: TRUTH.to_owned(),
        filter: "trilinear".to_owned(),
        stream: STREAM,
        goal,
        measured,
    })
}

/// Whether a certificate was measured as those of this program are.
pub(super) fn is_of_this_kind(certificate: &Certificate) -> bool {
    certificate.truth == TRUTH && certificate.filter == "trilinear" && certificate.stream == STREAM
}

/// SHA-256 of a text, in hexadecimal.
pub(super) fn scene_hash(text: &str) -> String {
    text::hexadecimal(&Sha256::digest(text.as_bytes()))
}

/// How a goal was met by a file.
fn reached(chosen: &Chosen, [achieved, at_most]: [f64; 2], rounds: u32) -> Option<Reached> {
    chosen.goal.map(|goal| Reached {
        goal,
        achieved,
        at_most,
        order: chosen.order,
        rounds,
        pilots: chosen.pilots.clone(),
    })
}

/// In a few lines.
pub(super) fn show(certificate: &Certificate, table: &mut Table) {
    let Certificate { goal, measured, .. } = certificate;
    if let Some(reached) = goal {
        let bakes = text::number(reached.rounds.into(), "bake");
        table.row(
            "error",
            format!(
                "{} of {}, at most {} asked for, in {bakes}",
                reached.goal.metric.name(),
                figure(reached.achieved),
                figure(reached.goal.limit)
            ),
        );
    }
    let part = |part: Option<f64>| part.map_or_else(|| "-".to_owned(), figure);
    let errors = &measured.errors;
    let held = measured
        .intervals
        .as_ref()
        .and_then(|held| held.relative_l2)
        .map_or_else(String::new, |[low, high]| format!(" ({} to {})", figure(low), figure(high)));
    table.row(
        "measured",
        format!(
            "relative L2 {}{held}, largest {} of the peak, optical depth {}, mass {}",
            part(errors.l2.of_rms),
            part(errors.max.of_peak),
            part(measured.optical_depth.l2.of_rms),
            part(measured.mass.ratio.map(|ratio| ratio - 1.0)),
        ),
    );
    let parts = &measured.parts;
    table.row(
        "of that",
        format!(
            "{} interpolation, {} model, {} quantisation, {} rounding",
            part(parts.interpolation.of_truth),
            part(parts.model.of_truth),
            part(parts.quantisation.of_truth),
            part(parts.rounding.of_truth),
        ),
    );
    if let Some(reason) = &parts.reason {
        table.row("", reason);
    }
}

/// Tells that a certificate's own error does not matter less than it should.
pub(super) fn note_of(global: &Global, round: u32, metric: &str, [_, at_most]: [f64; 2], limit: f64) {
    global.note(&format!(
        "bake {round} may have a {metric} of {}, more than {}: once more with smaller voxels",
        figure(at_most),
        figure(limit)
    ));
}
