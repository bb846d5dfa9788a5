//! `vdbake info`: what is in a scene or an OpenVDB file.

mod scene;
mod vdb;
mod view;

use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

use clap::Args;

use super::{Failure, Global, job};
use view::Size;

#[derive(Debug, Args)]
pub(super) struct Arguments {
    /// A scene, or an OpenVDB file
    #[arg(value_name = "SCENE|FILE")]
    file: PathBuf,
    /// Pixels of the picture that the camera of `view` is framed to, with --json
    #[arg(long, value_name = "WxH", default_value = Size::DEFAULT)]
    size: Size,
    /// Seconds after the scene's start frame, for `view` [default: 0]
    #[arg(long, value_name = "T", value_parser = job::time, allow_negative_numbers = true)]
    time: Option<f64>,
}

/// Tells.
pub(super) fn run(arguments: &Arguments, global: &Global) -> Result<(), Failure> {
    let path = &arguments.file;
    if is_vdb(path)? {
        if arguments.time.is_some() {
            return Err(Failure::usage("--time has no meaning for a file, only for a scene"));
        }
        let (mut report, failure) = vdb::read(path)?;
        if global.json {
            match vdb::view(&report, path, arguments.size) {
                Ok(view) => report.view = Some(view),
                Err(failure) => global.note(&format!(
                    "no view, since the scene in {} cannot be read:\n{failure}",
                    path.display()
                )),
            }
        }
        global.show(&report, vdb::human)?;
        return failure.map_or(Ok(()), Err);
    }
    let scene = job::read_scene(path)?;
    global.warn_of(scene.warnings());
    let mut report = scene::describe(&scene)?;
    if global.json {
        report.view = Some(view::view(&scene.at(arguments.time.unwrap_or(0.0))?, None, arguments.size));
    }
    global.show(&report, scene::human)
}

/// Whether a file is one of OpenVDB, by its first bytes or its name.
pub(super) fn is_vdb(path: &Path) -> Result<bool, Failure> {
    let failed = |error| Failure::unreadable(path, error);
    let mut start = Vec::new();
    File::open(path)
        .and_then(|file| file.take(job::VDB_MAGIC.len() as u64).read_to_end(&mut start))
        .map_err(failed)?;
    let named = path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("vdb"));
    Ok(named || start == job::VDB_MAGIC)
}
