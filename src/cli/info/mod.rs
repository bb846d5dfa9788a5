//! `vdbake info`: what is in a scene or an OpenVDB file.

mod scene;
mod vdb;

use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

use clap::Args;

use super::{Failure, Global, job};

#[derive(Debug, Args)]
pub(super) struct Arguments {
    /// A scene, or an OpenVDB file
    #[arg(value_name = "SCENE|FILE")]
    file: PathBuf,
}

/// Tells.
pub(super) fn run(arguments: &Arguments, global: &Global) -> Result<(), Failure> {
    let path = &arguments.file;
    if is_vdb(path)? {
        let (report, failure) = vdb::read(path)?;
        global.show(&report, vdb::human)?;
        return failure.map_or(Ok(()), Err);
    }
    let scene = job::read_scene(path)?;
    global.warn_of(scene.warnings());
    global.show(&scene::describe(&scene)?, scene::human)
}

/// Whether a file is one of OpenVDB, by its first bytes or its name.
pub(super) fn is_vdb(path: &Path) -> Result<bool, Failure> {
    let failed = |error| Failure::input(format!("cannot read {}", path.display())).because(error);
    let mut start = Vec::new();
    File::open(path)
        .and_then(|file| file.take(job::VDB_MAGIC.len() as u64).read_to_end(&mut start))
        .map_err(failed)?;
    let named = path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("vdb"));
    Ok(named || start == job::VDB_MAGIC)
}
