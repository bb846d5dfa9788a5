//! A file that appears whole or not at all.

use std::fs::{self, File};
use std::io::{self, BufWriter, Seek, Write};
use std::path::{Path, PathBuf};

use tempfile::NamedTempFile;

use super::Failure;
use super::interrupt::{Interrupt, Watched};

/// Characters of the file's name that the temporary name repeats: all of a long name would be too long.
const REPEATED: usize = 100;

/// What kind of image a file is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum ImageForm {
    Exr,
    Png,
}

impl ImageForm {
    /// By the end of its name; `what` it is, for the message where that is neither.
    pub(super) fn of(path: &Path, what: &str) -> Result<ImageForm, Failure> {
        let extension = path.extension().map(|extension| extension.to_string_lossy().to_ascii_lowercase());
        match extension.as_deref() {
            Some("exr") => Ok(ImageForm::Exr),
            Some("png") => Ok(ImageForm::Png),
            _ => Err(Failure::usage(format!("the {what} {} ends in neither .exr nor .png", path.display()))),
        }
    }
}

/// A file in the making, under a temporary name in the folder where it will be. Dropped, it leaves nothing behind.
#[derive(Debug)]
pub(super) struct Output {
    path: PathBuf,
    temporary: NamedTempFile,
}

/// The file that is to be made or replaced under a name.
fn target(path: &Path) -> Result<PathBuf, Failure> {
    // A link is kept, and what it points to replaced.
    let target = fs::canonicalize(path).unwrap_or_else(|_| path.to_owned());
    if fs::metadata(&target).is_ok_and(|existing| !existing.is_file()) {
        return Err(Failure::failed(format!("{} is not a regular file", path.display())));
    }
    let folder = folder(&target);
    if !folder.is_dir() {
        return Err(Failure::failed(format!("there is no folder {}", folder.display())));
    }
    Ok(target)
}

impl Output {
    /// Refuses places where no file can be made, before long work for it.
    pub(super) fn check(path: &Path) -> Result<(), Failure> {
        target(path).map(|_| ())
    }

    /// Makes the temporary file; `path` itself is left as it is.
    pub(super) fn create(path: &Path) -> Result<Output, Failure> {
        let target = target(path)?;
        let name = target.file_name().unwrap_or_default().to_string_lossy();
        let prefix = format!(".{}-", name.chars().take(REPEATED).collect::<String>());
        let mut builder = tempfile::Builder::new();
        builder.prefix(&prefix).suffix(".tmp");
        // Without this only the owner could read the file; the process's mask still applies.
        #[cfg(unix)]
        builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
        let folder = folder(&target);
        // Not the error itself, which tells of a temporary name that nobody gave.
        let temporary = builder.tempfile_in(folder).map_err(|error| {
            Failure::failed(format!("cannot make a file in {}", folder.display()))
                .because(io::Error::from(error.kind()))
        })?;
        Ok(Output { path: target, temporary })
    }

    /// The folder where the file will be.
    pub(super) fn folder(&self) -> &Path {
        folder(&self.path)
    }

    /// A nameless file beside it, where the system has such: it is gone when it is closed, and when the process ends in any
    /// way.
    pub(super) fn spool(&self) -> io::Result<File> {
        tempfile::tempfile_in(self.folder())
    }

    /// What to write to.
    pub(super) fn file(&self) -> &File {
        self.temporary.as_file()
    }

    /// Forgets what was written.
    pub(super) fn restart(&self) -> io::Result<()> {
        self.file().set_len(0)?;
        self.file().rewind()
    }

    /// Makes sure of what was written.
    pub(super) fn sync(&self) -> io::Result<()> {
        self.file().sync_all()
    }

    /// Gives the file its name, replacing a file that had it.
    pub(super) fn publish(self) -> io::Result<()> {
        self.temporary.persist(&self.path)?;
        // The file is complete whatever comes of this, and not every file system can do it.
        if let Ok(folder) = File::open(folder(&self.path)) {
            let _ = folder.sync_all();
        }
        Ok(())
    }
}

/// Writes a file of these bytes, whole or not at all.
pub(super) fn save(path: &Path, bytes: &[u8], interrupt: &Interrupt) -> Result<(), Failure> {
    interrupt.check()?;
    let output = Output::create(path)?;
    let failed =
        |error: io::Error| Failure::failed(format!("cannot write {}", path.display())).because(error);
    let write = || {
        let mut out = BufWriter::new(Watched { inner: output.file(), interrupt });
        out.write_all(bytes)?;
        out.flush()?;
        output.sync()
    };
    write().map_err(failed).or_else(|failure| interrupt.check().and(Err(failure)))?;
    interrupt.check()?;
    output.publish().map_err(failed)
}

fn folder(path: &Path) -> &Path {
    path.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."))
}
