//! A file that appears whole or not at all.
//!
//! It is written under a temporary name in the folder where it will be, and locked as long as it is. Nobody can clear away
//! after a process that is killed outright: its file stays, but the lock goes with it. So the next to make the same file finds
//! by the name what was meant to become it, by the lock that nobody is at it any more, and removes it.

use std::fs::{self, File, TryLockError};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

use tempfile::NamedTempFile;

use super::interrupt::{Interrupt, Watched};
use super::{Failure, disk};

/// Bytes of the file's name that the temporary name repeats: all of a long name would be too long.
const REPEATED: usize = 100;
/// Letters and digits behind those, at random.
const RANDOM: usize = 8;
/// How temporary names end.
const ENDING: &str = ".vdbake-tmp";
/// Files that are made in vain, each removed by another process before it could be locked, until that is given up.
const TRIALS: usize = 100;

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
    /// Refuses places where no file can be made, before long work for it: makes a nameless one.
    pub(super) fn check(path: &Path) -> Result<(), Failure> {
        let path = target(path)?;
        tempfile::tempfile_in(folder(&path)).map(drop).map_err(|error| unmade(&path, &error))
    }

    /// Makes the temporary file; `path` itself is left as it is. Signals are noted from then on. What processes that were
    /// killed left of the same file is removed.
    pub(super) fn create(path: &Path, interrupt: &Interrupt) -> Result<Output, Failure> {
        interrupt.hold();
        let path = target(path)?;
        let temporary = make(&path)?;
        Ok(Output { path, temporary })
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

    /// Asks for room for so many bytes, and no more than will be written, at once, which takes the system a good part less than
    /// finding it page by page.
    pub(super) fn allocate(&self, bytes: u64) {
        // Not every file system can do it, and where there is no room, writing tells.
        let _ = fs4::FileExt::allocate(self.file(), bytes);
    }

    /// Makes sure of what was written.
    pub(super) fn sync(&self) -> io::Result<()> {
        self.file().sync_all()
    }

    /// Gives the file its name, replacing a file that had it.
    pub(super) fn publish(self) -> io::Result<()> {
        self.temporary.persist(&self.path).map_err(|error| match error.error.kind() {
            // Not the error itself, which does not say which file was not found.
            io::ErrorKind::NotFound => {
                io::Error::other("somebody removed the temporary file that it was written to")
            }
            _ => error.error,
        })?;
        // The file is complete whatever comes of this, and not every file system can do it.
        if let Ok(folder) = File::open(folder(&self.path)) {
            let _ = folder.sync_all();
        }
        Ok(())
    }
}

/// A locked file under a temporary name beside `target`, in place of those that others were killed over.
fn make(target: &Path) -> Result<NamedTempFile, Failure> {
    let folder = folder(target);
    let prefix = prefix(target);
    reclaim(folder, &prefix);
    let mut builder = tempfile::Builder::new();
    builder.prefix(&prefix).suffix(ENDING).rand_bytes(RANDOM);
    // Without this only the owner could read the file; the process's mask still applies.
    #[cfg(unix)]
    builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
    for _ in 0..TRIALS {
        let temporary = builder.tempfile_in(folder).map_err(|error| unmade(target, &error))?;
        match temporary.as_file().try_lock() {
            // In the moment before the lock another process may have taken it for one of the dead, and removed it.
            Ok(()) if !is_at(temporary.as_file(), temporary.path()) => {}
            Err(TryLockError::WouldBlock) => {}
            // Where the system has no locks no file can be locked by others either, so none is removed.
            Ok(()) | Err(TryLockError::Error(_)) => return Ok(temporary),
        }
    }
    Err(unmade(target, &io::ErrorKind::AlreadyExists.into()))
}

/// Why no file can be made beside another.
fn unmade(target: &Path, error: &io::Error) -> Failure {
    let failure = Failure::failed(format!("cannot make a file in {}", folder(target).display()));
    // Not the error itself, which tells of a temporary name that nobody gave.
    disk::hint(failure, error.kind()).because(io::Error::from(error.kind()))
}

/// How the temporary names of a file begin.
fn prefix(target: &Path) -> String {
    let name = target.file_name().unwrap_or_default().to_string_lossy();
    let end = name.char_indices().map(|(at, c)| at + c.len_utf8()).take_while(|end| *end <= REPEATED).last();
    format!(".{}-", &name[..end.unwrap_or(0)])
}

/// Removes temporary files that nobody is at. One that cannot be removed stays.
fn reclaim(folder: &Path, prefix: &str) {
    let Ok(entries) = fs::read_dir(folder) else { return };
    for entry in entries.filter_map(Result::ok) {
        let name = entry.file_name();
        let random = name.to_str().and_then(|name| name.strip_prefix(prefix)?.strip_suffix(ENDING));
        let is_temporary = random.is_some_and(|random| {
            random.len() == RANDOM && random.bytes().all(|c| c.is_ascii_alphanumeric())
        });
        if !is_temporary || !entry.file_type().is_ok_and(|kind| kind.is_file()) {
            continue;
        }
        let path = entry.path();
        // Some systems lock only what is opened for writing.
        let Ok(file) = File::options().read(true).write(true).open(&path) else { continue };
        if file.try_lock().is_ok() && is_at(&file, &path) {
            let _ = fs::remove_file(&path);
        }
    }
}

/// Whether a file still has its name.
#[cfg(unix)]
fn is_at(file: &File, path: &Path) -> bool {
    use std::os::unix::fs::MetadataExt;
    let id = |found: io::Result<fs::Metadata>| found.ok().map(|found| (found.dev(), found.ino()));
    let found = id(file.metadata());
    found.is_some() && found == id(fs::symlink_metadata(path))
}

/// Elsewhere open files keep their names, as a rule.
#[cfg(not(unix))]
fn is_at(_: &File, path: &Path) -> bool {
    path.exists()
}

/// Writes a file of these bytes, whole or not at all.
pub(super) fn save(path: &Path, bytes: &[u8], interrupt: &Interrupt) -> Result<(), Failure> {
    save_with(path, interrupt, |out| out.write_all(bytes))
}

/// Writes a file, whole or not at all.
pub(super) fn save_with(
    path: &Path,
    interrupt: &Interrupt,
    write: impl FnOnce(&mut dyn Write) -> io::Result<()>,
) -> Result<(), Failure> {
    interrupt.check()?;
    let output = Output::create(path, interrupt)?;
    let written = (|| {
        let mut out = BufWriter::new(Watched { inner: output.file(), interrupt });
        write(&mut out)?;
        out.flush()?;
        output.sync()
    })();
    // A signal ends the writing, and is what there is to tell then.
    interrupt.check()?;
    written.and_then(|()| output.publish()).map_err(|error| disk::unwritten(path, error))
}

fn folder(path: &Path) -> &Path {
    path.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(folder: &Path) -> Vec<String> {
        let entries = fs::read_dir(folder).expect("a folder");
        let mut names: Vec<String> = entries
            .map(|entry| entry.expect("an entry").file_name().to_string_lossy().into_owned())
            .collect();
        names.sort();
        names
    }

    #[test]
    fn files_of_the_dead_are_removed_and_no_others() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("a.vdb");
        let live = make(&path).expect("a file");
        let dead = ".a.vdb-AbCd0123.vdbake-tmp";
        // Such as another file's, a copy that somebody keeps, or one that is too long or too short.
        let others = [
            ".a.vdb-AbCd012.vdbake-tmp",
            ".a.vdb-AbCd01234.vdbake-tmp",
            ".a.vdb-AbCd 123.vdbake-tmp",
            ".a.vdb-AbCd0123.tmp",
            ".a.vdb-b.vdb-AbCd0123.vdbake-tmp",
            ".b.vdb-AbCd0123.vdbake-tmp",
            "a.vdb-AbCd0123.vdbake-tmp",
        ];
        for name in others.iter().chain([&dead]) {
            fs::write(folder.path().join(name), "").expect("a file");
        }
        fs::create_dir(folder.path().join(".a.vdb-AFolder0.vdbake-tmp")).expect("a folder");
        let before = names(folder.path());
        let other = make(&path).expect("a file");
        let mut expected: Vec<String> = before.into_iter().filter(|name| name != dead).collect();
        expected.push(other.path().file_name().expect("a name").to_string_lossy().into_owned());
        expected.sort();
        assert_eq!(names(folder.path()), expected);
        drop((live, other));
        assert_eq!(names(folder.path()).len(), others.len() + 1);
    }

    /// Many that come and go at once: none loses its file to another.
    #[test]
    fn no_live_file_is_removed() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("a.vdb");
        std::thread::scope(|scope| {
            for _ in 0..8 {
                scope.spawn(|| {
                    for _ in 0..100 {
                        let file = make(&path).expect("a file");
                        assert!(is_at(file.as_file(), file.path()));
                    }
                });
            }
        });
        assert_eq!(names(folder.path()), [""; 0]);
    }

    /// A name may be 255 bytes long, also of letters of several bytes each.
    #[test]
    fn long_names_have_temporary_ones() {
        let folder = tempfile::tempdir().expect("a folder");
        for letter in ["x", "\u{e9}", "\u{706b}", "\u{1f32a}"] {
            let path = folder.path().join(letter.repeat(251 / letter.len()) + ".vdb");
            fs::write(&path, "").expect("a name that the system takes");
            make(&path).expect("a file");
        }
    }
}
