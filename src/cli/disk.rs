//! Room on the disk: checked before a bake, and what to say when it runs out.

use std::io;
use std::path::Path;

use super::estimate::{Estimate, Planned};
use super::job::Job;
use super::output::Output;
use super::{Failure, machine, text};
use crate::formats::vdb::VdbWriteError;

/// Seconds for a sample of the bricks, where the bound alone does not decide.
const PATIENCE: f64 = 0.5;

/// Fails where the file and its spool will not fit the disk.
pub(super) fn check(job: &Job, planned: &Planned<'_>, output: &Output) -> Result<(), Failure> {
    let Some(free) = machine::free_space(output.folder()) else { return Ok(()) };
    let most = planned.empty + planned.bound.bytes() + planned.need.spool(job.budget());
    if most <= free {
        return Ok(());
    }
    let estimate = Estimate::new(job, planned, PATIENCE, None)?;
    let (file, spool) = (estimate.bytes, estimate.spooled_bytes);
    if file + spool <= free {
        return Ok(());
    }
    let room = format!("{} free in {}", text::bytes(free), output.folder().display());
    let smaller = "write to another disk with -o, or choose a larger --voxel-size or --precision f16";
    // No memory makes room for the file itself.
    Err(if file > free {
        Failure::failed(format!("too little room on the disk: the file takes about {}, and {room}", text::bytes(file)))
    } else {
        Failure::failed(format!(
            "too little room on the disk: the file takes about {}, {} more meanwhile for what has no room in the memory, and {room}",
            text::bytes(file),
            text::bytes(spool),
        ))
        .hint("allow more with --memory, so that less of it goes to the disk")
    }
    .hint(smaller))
}

/// Why a file could not be written, and what to do.
pub(super) fn failure(path: &Path, error: VdbWriteError) -> Failure {
    let failure = Failure::failed(format!("cannot write {}", path.display()));
    match error {
        VdbWriteError::Io(error) => unwritten(path, error),
        VdbWriteError::Spool(error) => {
            let failure = if is_full(error.kind()) {
                failure.hint("make room on the disk, write to another one with -o, or allow more with --memory, so that less goes to the spool")
            } else {
                failure.hint("the spool is a temporary file in the output's folder: bake again, to another disk with -o, or with more --memory, so that it is not needed")
            };
            failure.because(VdbWriteError::Spool(error))
        }
        VdbWriteError::Memory { .. } => failure
            .hint("with less --memory values wait on the disk; fewer --threads take less, too")
            .because(error),
        error => failure.because(error),
    }
}

/// The same of any file.
pub(super) fn unwritten(path: &Path, error: io::Error) -> Failure {
    hint(Failure::failed(format!("cannot write {}", path.display())), error.kind()).because(error)
}

/// With what may help after an error of a disk.
pub(super) fn hint(failure: Failure, kind: io::ErrorKind) -> Failure {
    match kind {
        _ if is_full(kind) => failure.hint("make room on the disk, or choose another one for the output"),
        io::ErrorKind::ReadOnlyFilesystem | io::ErrorKind::PermissionDenied => {
            failure.hint("choose another folder for the output")
        }
        _ => failure,
    }
}

fn is_full(kind: io::ErrorKind) -> bool {
    use io::ErrorKind::{FileTooLarge, QuotaExceeded, StorageFull};
    matches!(kind, StorageFull | QuotaExceeded | FileTooLarge)
}
