//! Why a command ended without success, and the exit code for it.

use std::error::Error;
use std::fmt;
use std::io::{self, IsTerminal, Write};
use std::path::Path;

use crate::scene::SceneErrors;

/// Why a command ended without success.
#[derive(Debug)]
pub struct Failure {
    kind: Kind,
    message: String,
    source: Option<Box<dyn Error + Send + Sync>>,
    hints: Vec<String>,
}

#[derive(Debug)]
enum Kind {
    Failed,
    Usage,
    Input,
    Scene(Box<SceneErrors>),
    Check,
    Partial,
    Interrupted,
}

impl Failure {
    fn new(kind: Kind, message: impl Into<String>) -> Failure {
        Failure { kind, message: message.into(), source: None, hints: Vec::new() }
    }

    /// The work could not be done.
    pub(super) fn failed(message: impl Into<String>) -> Failure {
        Failure::new(Kind::Failed, message)
    }

    /// The arguments make no sense together.
    pub(super) fn usage(message: impl Into<String>) -> Failure {
        Failure::new(Kind::Usage, message)
    }

    /// A scene or input file is not there, not readable or not valid.
    pub(super) fn input(message: impl Into<String>) -> Failure {
        Failure::new(Kind::Input, message)
    }

    /// A file that cannot be opened; where there is none, with what may be meant.
    pub(super) fn unreadable(path: &Path, error: io::Error) -> Failure {
        let is_missing = error.kind() == io::ErrorKind::NotFound;
        let failure = Failure::input(format!("cannot read {}", path.display())).because(error);
        if is_missing { failure.hint(missing(path)) } else { failure }
    }

    /// What was to be checked does not hold.
    pub(super) fn check(message: impl Into<String>) -> Failure {
        Failure::new(Kind::Check, message)
    }

    /// A signal asked to stop.
    pub(super) fn interrupted() -> Failure {
        Failure::new(Kind::Interrupted, "interrupted")
    }

    /// Of a sequence of files, some of which are done and stay; the frames that are left are named as `--frames` takes them.
    pub(super) fn leaving(mut self, frames: &str) -> Failure {
        if !matches!(self.kind, Kind::Interrupted) {
            self.kind = Kind::Partial;
        }
        self.message = format!("{}; frames {frames} are missing", self.message);
        self.hint(format!("--frames={frames} bakes those that are missing"))
    }

    /// With what lies behind it.
    pub(super) fn because(mut self, source: impl Into<Box<dyn Error + Send + Sync>>) -> Failure {
        self.source = Some(source.into());
        self
    }

    /// With what may help.
    pub(super) fn hint(mut self, hint: impl Into<String>) -> Failure {
        self.hints.push(hint.into());
        self
    }

    /// Whether a hint holds a word.
    pub(super) fn hints_at(&self, word: &str) -> bool {
        self.hints.iter().any(|hint| hint.contains(word))
    }

    /// 1: failed; 2: usage; 3: the scene or input file cannot be read or is invalid; 4: a check did not hold; 5: some files of a sequence are done,
    /// the others can be made by another run; 130: interrupted.
    pub fn exit_code(&self) -> u8 {
        match self.kind {
            Kind::Failed => 1,
            Kind::Usage => 2,
            Kind::Input | Kind::Scene(_) => 3,
            Kind::Check => 4,
            Kind::Partial => 5,
            Kind::Interrupted => 130,
        }
    }

    /// Writes the error with its causes, and hints where there are any. Errors of a scene are coloured where standard
    /// error is a terminal.
    ///
    /// # Errors
    ///
    /// Those of `out`.
    pub fn report(&self, out: &mut impl Write) -> io::Result<()> {
        match &self.kind {
            Kind::Scene(errors) if colours() => writeln!(out, "{}", errors.to_coloured()),
            _ => writeln!(out, "{self}"),
        }
    }
}

/// As it is reported, without colour or final newline.
impl fmt::Display for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Kind::Scene(errors) = &self.kind {
            return errors.fmt(f);
        }
        write!(f, "error: {}", self.message)?;
        let mut source = self.source.as_deref().map(|source| source as &dyn Error);
        while let Some(error) = source {
            write!(f, ": {error}")?;
            source = error.source();
        }
        self.hints.iter().try_for_each(|hint| write!(f, "\nhint: {hint}"))
    }
}

/// What may be meant by the name of a file that is not there.
fn missing(path: &Path) -> String {
    /// Names that are less alike than this are other names.
    const ALIKE: f64 = 0.8;
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let Ok(entries) = std::fs::read_dir(folder) else {
        return format!("there is no folder {}", folder.display());
    };
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let names = entries.filter_map(|entry| Some(entry.ok()?.file_name().to_string_lossy().into_owned()));
    let like = names.map(|other| (strsim::jaro_winkler(&name, &other), other));
    let nearest = like
        .filter(|(alike, _)| *alike >= ALIKE)
        .max_by(|a, b| a.0.total_cmp(&b.0).then_with(|| b.1.cmp(&a.1)));
    match nearest {
        Some((_, other)) => format!("there is a file {}", path.with_file_name(other).display()),
        None => "names are relative to the current folder".to_owned(),
    }
}

impl From<SceneErrors> for Failure {
    fn from(errors: SceneErrors) -> Failure {
        Failure::new(Kind::Scene(Box::new(errors)), "invalid scene")
    }
}

/// Whether standard error takes colours.
pub(super) fn colours() -> bool {
    coloured(io::stderr().is_terminal())
}

/// Whether standard output does.
pub(super) fn colours_out() -> bool {
    coloured(io::stdout().is_terminal())
}

fn coloured(is_terminal: bool) -> bool {
    let unset = |name| std::env::var_os(name).is_none_or(|value| value.is_empty());
    let dumb = std::env::var_os("TERM").is_some_and(|term| term == "dumb");
    is_terminal && unset("NO_COLOR") && !dumb
}
