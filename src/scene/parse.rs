//! A whole scene: its top level, `[bake]` and `[time]`.

use std::cell::Cell;
use std::io;
use std::path::Path;
use std::sync::OnceLock;

use toml::de::DeTable;

use super::error::{Fault, Faults, SceneErrors, Warnings};
use super::input::{Inputs, Load};
use super::keys::{BAKE, MEDIUM, ROOT, TIME, TUBE};
use super::limit::LARGEST_FRAME;
use super::motion::Clock;
use super::reader::{Item, Reader, Words};
use super::{Antialias, Bake, Overlap, Scene, Step, TimeBase, limit, syntax, tube, view};

/// Voxels along the longest side.
const RESOLUTION: u32 = 256;
/// No resolution is above this.
const LARGEST: i64 = 1_000_000;

static GRIDS: Words<()> = Words {
    known: &[("density", ())],
    later: &["temperature", "color", "velocity", "rest", "sdf"],
    instead: "this version bakes density only",
};

static ANTIALIAS: Words<Antialias> =
    Words { known: &[("off", Antialias::Off), ("adaptive", Antialias::Adaptive)], later: &[], instead: "" };

impl Scene {
    /// Reads a scene from TOML text that names no files, as it is at time 0. `origin` is the name of its file: messages show it, and its stem names a scene
    /// that does not name itself. A byte order mark is passed over.
    ///
    /// # Errors
    ///
    /// All faults of the text at once, each with its line and column.
    pub fn parse(text: &str, origin: &str) -> Result<Scene, SceneErrors> {
        let unread = "this text is read without its files";
        Scene::load(text, origin, &|_| Err(io::Error::new(io::ErrorKind::Unsupported, unread)))
    }

    /// Reads a scene from TOML text, and the files that it names by `load`, each once. The rest is as for
    /// [`Scene::parse`].
    ///
    /// # Errors
    ///
    /// All faults of the text at once; those of a file, of which only the first is told, at the place of its name.
    pub fn load(text: &str, origin: &str, load: &Load<'_>) -> Result<Scene, SceneErrors> {
        read(text, origin, 0.0, load, None)
    }

    /// Reads a scene as it is `seconds` after its start frame.
    ///
    /// # Errors
    ///
    /// Those of [`parse`](Scene::parse), or where there are none, those of [`at`](Scene::at).
    ///
    /// # Panics
    ///
    /// As `at` does.
    pub fn parse_at(text: &str, origin: &str, seconds: f64) -> Result<Scene, SceneErrors> {
        Scene::parse(text, origin)?.at(seconds)
    }

    /// The same scene at another time, `seconds` after its start frame.
    ///
    /// # Errors
    ///
    /// What does not fit in the scene at that time, such as a curve that has no length then.
    ///
    /// # Panics
    ///
    /// If the time is not within 1e9 seconds of the start frame.
    pub fn at(&self, seconds: f64) -> Result<Scene, SceneErrors> {
        assert!(limit::ANY.admits(seconds), "{seconds} seconds are no time of a scene");
        if seconds == self.seconds {
            return Ok(self.clone());
        }
        let load = |path: &str| {
            let known = self.inputs.iter().find(|input| input.path == path);
            known.map(|input| input.bytes.to_vec()).ok_or_else(|| io::ErrorKind::NotFound.into())
        };
        read(&self.text, &self.origin, seconds, &load, Some(self))
    }
}

/// Reads a scene at a time. `known` is the same one at any time, if it has been read before.
fn read(
    text: &str,
    origin: &str,
    seconds: f64,
    load: &Load<'_>,
    known: Option<&Scene>,
) -> Result<Scene, SceneErrors> {
    let inputs = Inputs::new(load);
    let body = text.strip_prefix('\u{feff}').unwrap_or(text);
    let (document, errors) = DeTable::parse_recoverable(body);
    let faults = Faults::default();
    let clock = Clock { seconds, moving: Cell::new(false) };
    let root = Reader::new(document.get_ref(), document.span(), &ROOT, &faults);
    let mut scene = Scene {
        name: root.get("name").and_then(name).unwrap_or_else(|| stem(origin)),
        bake: bake(&root),
        time: time(&root),
        overlap: root.word("overlap", &tube::OVERLAP).unwrap_or(Overlap::Max),
        tubes: tube::tubes(&root.timed(&clock).tables("tube", &TUBE), &inputs, known.map(Scene::tubes)),
        medium: view::medium(root.table("medium", &MEDIUM)),
        camera: view::camera(&root),
        lights: view::lights(&root),
        text: text.to_owned(),
        origin: origin.to_owned(),
        places: known.map_or_else(OnceLock::new, |known| known.places.clone()),
        seconds,
        moving: clock.moving.get(),
        inputs: vec![],
        warnings: Warnings::default(),
    };
    scene.inputs = inputs.into_list();
    scene.warnings = faults.take_warnings(origin, body);
    syntax::report(body, document.get_ref(), &errors, &faults);
    if let Some(known) = known {
        // What is wrong now was not when the scene was first read.
        faults.note(&format!(
            "this is {seconds} s after the start frame; nothing is wrong at {} s",
            known.seconds
        ));
    }
    faults.into_errors(origin, body).map_or(Ok(scene), Err)
}

fn bake(root: &Reader<'_>) -> Bake {
    let default = Bake {
        step: Step::Resolution(RESOLUTION),
        cutoff: 0.0,
        octave_fade: true,
        widen: true,
        antialias: Antialias::Adaptive,
    };
    let Some(table) = root.table("bake", &BAKE) else { return default };
    let resolution = table.integer("resolution", 1..=LARGEST).and_then(|n| u32::try_from(n).ok());
    let voxel_size = table.number("voxel_size", &limit::POSITIVE);
    if let (Some(resolution), Some(size)) = (table.key_span("resolution"), table.key_span("voxel_size")) {
        let fault = Fault::at(size, "`resolution` and `voxel_size` contradict each other")
            .label("give one of the two");
        table.report(fault.related(resolution, "`resolution` is given here"));
    }
    if let Some(grids) = table.get("grids") {
        check_grids(&grids);
    }
    Bake {
        step: match (voxel_size, resolution) {
            (Some(size), _) => Step::VoxelSize(size),
            (None, Some(resolution)) => Step::Resolution(resolution),
            (None, None) => default.step,
        },
        cutoff: table.number("cutoff", &limit::NOT_NEGATIVE).unwrap_or(default.cutoff),
        octave_fade: table.boolean("octave_fade").unwrap_or(default.octave_fade),
        widen: table.boolean("widen").unwrap_or(default.widen),
        antialias: table.word("antialias", &ANTIALIAS).unwrap_or(default.antialias),
    }
}

fn check_grids(item: &Item<'_>) {
    let Some(grids) = item.array("an array of grid names") else { return };
    if grids.is_empty() {
        item.report(Fault::at(item.span(), "`grids` is empty").label("expected [\"density\"]"));
    }
    let mut first = None;
    for grid in &grids {
        if grid.word(&GRIDS).is_none() {
            continue;
        }
        if let Some(first) = first.replace(grid.span()) {
            grid.report(
                Fault::at(grid.span(), "`grids` names \"density\" twice")
                    .related(first, "it is already named here"),
            );
        }
    }
}

fn time(root: &Reader<'_>) -> TimeBase {
    let default = TimeBase { fps: 24.0, start: 1, end: None };
    let Some(table) = root.table("time", &TIME) else { return default };
    let frame = |key| table.integer(key, -LARGEST_FRAME..=LARGEST_FRAME);
    let (start, end) = (frame("start"), frame("end"));
    let time = TimeBase {
        fps: table.number("fps", &limit::POSITIVE).unwrap_or(default.fps),
        start: start.unwrap_or(default.start),
        end,
    };
    // A start that is given and not understood must not be held against the end.
    let start_fits = start.is_some() || table.get("start").is_none();
    if let (Some(item), Some(end), true) = (table.get("end"), end, start_fits) {
        if end < time.start {
            let fault = Fault::at(item.span(), "`end` is before `start`")
                .label(format!("expected frame {} or one after it", time.start));
            table.report(match table.get("start") {
                Some(start) => fault.related(start.span(), "`start` is given here"),
                None => fault,
            });
        } else if !limit::ANY.admits(time.seconds(end)) {
            table.report(
                Fault::at(item.span(), "`end` is too late")
                    .label("expected a frame at most 1e9 seconds after `start`"),
            );
        }
    }
    time
}

/// The scene's name. It names a file, so it must be a file's name on every system.
fn name(item: Item<'_>) -> Option<String> {
    let name = item.text()?;
    if is_file_name(name) {
        return Some(name.to_owned());
    }
    item.report(
        Fault::at(item.span(), "`name` cannot name a file")
            .label("expected up to 100 characters without / \\ : * ? \" < > | and not only dots or spaces"),
    );
    None
}

fn is_file_name(name: &str) -> bool {
    let forbidden = |c: char| c.is_control() || "/\\:*?\"<>|".contains(c);
    !name.chars().any(forbidden)
        && !name.chars().all(|c| c == '.' || c.is_whitespace())
        && name.chars().count() <= 100
}

fn stem(origin: &str) -> String {
    let stem = Path::new(origin).file_stem().and_then(|stem| stem.to_str()).filter(|stem| is_file_name(stem));
    stem.unwrap_or("scene").to_owned()
}
