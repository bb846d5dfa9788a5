//! Ctrl-C and requests to terminate, so that no partial file stays behind.

use std::io::{self, Read, Seek, SeekFrom, Write};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use signal_hook::consts::{SIGABRT, SIGINT, SIGTERM};

use super::Failure;
use crate::volume::{Encode, Sink};

/// Exit code after a signal.
const EXIT_CODE: i32 = 130;
/// Exit code where even a small piece of memory cannot be had.
const FAILED: i32 = 1;

/// Signals to stop. While nothing needs to be cleared away they end the program at once; after
/// [`hold`](Interrupt::hold) they are only noted.
#[derive(Debug, Clone)]
pub(super) struct Interrupt {
    noted: Arc<AtomicBool>,
    at_once: Arc<AtomicBool>,
}

impl Interrupt {
    /// Takes the signals over from the system.
    pub(super) fn listen() -> Result<Interrupt, Failure> {
        let interrupt =
            Interrupt { noted: Arc::new(AtomicBool::new(false)), at_once: Arc::new(AtomicBool::new(true)) };
        let register = |signal| {
            signal_hook::flag::register_conditional_shutdown(signal, EXIT_CODE, interrupt.at_once.clone())?;
            signal_hook::flag::register(signal, interrupt.noted.clone())
        };
        [SIGINT, SIGTERM]
            .into_iter()
            .try_for_each(|signal| register(signal).map(|_| ()))
            .and_then(|()| fail_beyond_size_limit())
            .map_err(|error: io::Error| Failure::failed("cannot listen for signals").because(error))?;
        Ok(interrupt)
    }

    /// From now on signals are noted, for [`check`](Interrupt::check) to find.
    pub(super) fn hold(&self) {
        self.at_once.store(false, Ordering::SeqCst);
    }

    fn is_noted(&self) -> bool {
        self.noted.load(Ordering::SeqCst)
    }

    /// An error if a signal came.
    pub(super) fn check(&self) -> Result<(), Failure> {
        if self.is_noted() { Err(Failure::interrupted()) } else { Ok(()) }
    }
}

/// Lets the process end with an exit code where it would abort: where the system refuses a small piece of memory, after
/// saying so on standard error. Large pieces are asked for in a way that can be refused.
pub(super) fn fail_without_memory() {
    // Where there is no such signal the process aborts.
    let _ =
        signal_hook::flag::register_conditional_shutdown(SIGABRT, FAILED, Arc::new(AtomicBool::new(true)));
}

/// Lets a write beyond the limit of a file's size fail with an error, like one to a full disk; unheard, the signal would
/// end the program at once and leave the partial file.
#[cfg(unix)]
fn fail_beyond_size_limit() -> io::Result<()> {
    signal_hook::flag::register(signal_hook::consts::SIGXFSZ, Arc::default()).map(|_| ())
}

#[cfg(not(unix))]
fn fail_beyond_size_limit() -> io::Result<()> {
    Ok(())
}

/// A sink or an output that fails once a signal has come.
#[derive(Debug)]
pub(super) struct Watched<'a, T> {
    pub(super) inner: T,
    pub(super) interrupt: &'a Interrupt,
}

/// Why a watched sink ended a bake.
#[derive(Debug)]
pub(super) enum Stopped<E> {
    Interrupted,
    Sink(E),
}

impl<S: Sink> Sink for Watched<'_, S> {
    type Encoder = S::Encoder;
    type Error = Stopped<S::Error>;

    fn encoder(&self) -> S::Encoder {
        self.inner.encoder()
    }

    fn append(&mut self, run: <S::Encoder as Encode>::Run) -> Result<(), Self::Error> {
        if self.interrupt.is_noted() {
            return Err(Stopped::Interrupted);
        }
        self.inner.append(run).map_err(Stopped::Sink)
    }
}

impl<R: Read> Read for Watched<'_, R> {
    fn read(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        self.inner.read(bytes)
    }
}

impl<S: Seek> Seek for Watched<'_, S> {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        self.inner.seek(to)
    }
}

impl<W: Write> Write for Watched<'_, W> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        if self.interrupt.is_noted() {
            // Not `ErrorKind::Interrupted`, after which writers try again.
            return Err(io::Error::other("interrupted"));
        }
        self.inner.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.inner.flush()
    }
}
