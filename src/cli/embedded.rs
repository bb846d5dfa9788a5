//! The scene that a file carries.
//!
//! Whoever made the file chose what that scene names, and may mean harm: of other files none is read that lies elsewhere than
//! beside or below the file, or in a folder that the user names, and none whose hash the recipe does not hold, so that no
//! message can tell what is in them.

use std::cell::RefCell;
use std::io;
use std::path::{Component, Path, PathBuf};

use serde::Deserialize;
use sha2::{Digest, Sha256};

use super::job::{has_room, read_input};
use super::memory::Amount;
use super::{Failure, text};
use crate::formats::vdb::{Meta, Metadata};
use crate::scene::Scene;
use crate::scene::limit::ANY;

/// A file that the scene names.
#[derive(Debug, Deserialize)]
struct Named {
    path: String,
    sha256: String,
}

/// The scene of the file at `path`, of which this is the metadata, as it is at its start frame; `None` where it carries none. The files that it
/// names are sought beside that file, or in the `inputs` that the user gives; there those of paths that would leave the folder by their last
/// name.
pub(super) fn scene(
    metadata: &Metadata,
    path: &Path,
    inputs: Option<&Path>,
    budget: Amount,
) -> Result<Option<Scene>, Failure> {
    let text = |name: &str| match metadata.get(name) {
        Some(Meta::String(text)) => Some(text.as_str()),
        _ => None,
    };
    let Some(scene) = text("vdbake_scene") else { return Ok(None) };
    let named: Vec<Named> = match text("vdbake_inputs") {
        None => vec![],
        Some(inputs) => serde_json::from_str(inputs)
            .map_err(|error| Failure::input("the list of the scene's files makes no sense").because(error))?,
    };
    let folder = inputs.unwrap_or_else(|| path.parent().unwrap_or(Path::new("")));
    let other = RefCell::new(None);
    let load = |file: &str| {
        let place = place(folder, file, inputs.is_some()).ok_or_else(|| {
            io::Error::other(
                "the scene within a file may only name what lies beside or below that file: \
                 `vdbake verify` with --inputs FOLDER looks in that folder for a file of this name",
            )
        })?;
        let known = named.iter().find(|named| named.path == file);
        let known = known.ok_or_else(|| io::Error::other("the recipe has no hash of this file"))?;
        let bytes = read_input(&place)?;
        let hash: [u8; 32] = Sha256::digest(&bytes).into();
        if text::hexadecimal(&hash) == known.sha256 {
            return Ok(bytes);
        }
        let told = "it is not the file that the scene was baked with";
        other.borrow_mut().get_or_insert(place);
        Err(io::Error::other(told))
    };
    // Named as the file, in the folder where what it names is.
    let origin = folder.join(path.file_name().unwrap_or_default());
    let scene = Scene::load(scene, &origin.display().to_string(), &load);
    match (scene, other.into_inner()) {
        (_, Some(other)) => {
            Err(Failure::check(format!("{} is not the file that the scene was baked with", other.display()))
                .hint("`vdbake verify` with --inputs names the folder of the right one"))
        }
        (scene, None) => {
            let scene = scene?;
            has_room(&scene, budget)?;
            Ok(Some(scene))
        }
    }
}

/// Seconds after the start frame that the settings in a file's metadata tell; 0 where they make no sense.
pub(super) fn time(settings: &str) -> f64 {
    let settings: serde_json::Value = serde_json::from_str(settings).unwrap_or_default();
    settings.get("time").and_then(serde_json::Value::as_f64).filter(|time| ANY.admits(*time)).unwrap_or(0.0)
}

/// Where a file of this path is looked for; `None` where that is not in the folder or below.
fn place(folder: &Path, file: &str, is_given: bool) -> Option<PathBuf> {
    let path = Path::new(file);
    let stays = |part| matches!(part, Component::Normal(_) | Component::CurDir);
    if path.components().all(stays) {
        return Some(folder.join(path));
    }
    path.file_name().filter(|_| is_given).map(|name| folder.join(name))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_are_looked_for_below_the_folder_alone() {
        let place = |file, is_given| place(Path::new("here"), file, is_given);
        for (file, beside, given) in [
            ("a.csv", Some("here/a.csv"), Some("here/a.csv")),
            ("./data/a.csv", Some("here/data/a.csv"), Some("here/data/a.csv")),
            ("../a.csv", None, Some("here/a.csv")),
            ("data/../../a.csv", None, Some("here/a.csv")),
            ("/etc/a.csv", None, Some("here/a.csv")),
            ("data/..", None, None),
            ("..", None, None),
            ("/", None, None),
        ] {
            assert_eq!(place(file, false).as_deref(), beside.map(Path::new), "{file}");
            assert_eq!(place(file, true).as_deref(), given.map(Path::new), "{file}");
        }
    }

    #[test]
    fn times_that_no_scene_has_are_none() {
        assert_eq!(
            [r#"{"time":2.5}"#, r#"{"time":1e10}"#, r#"{"time":"1"}"#, "{", ""].map(time),
            [2.5, 0.0, 0.0, 0.0, 0.0]
        );
    }
}
