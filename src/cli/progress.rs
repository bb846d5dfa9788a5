//! How far the work is: a bar on a terminal, else now and then a line.

use std::io::{self, IsTerminal, Write};
use std::sync::mpsc::{self, RecvTimeoutError};
use std::thread;
use std::time::Duration;

use indicatif::{ProgressBar, ProgressStyle};

/// Percent between two lines.
const STRIDE: f64 = 5.0;

/// Work of unknown length that takes longer than this is mentioned.
const PATIENCE: Duration = Duration::from_secs(1);

/// Says on standard error that a plan is being made, if that lasts; ends when dropped.
pub(super) struct Planning {
    /// Closed at the end.
    end: Option<mpsc::Sender<()>>,
    waiter: Option<thread::JoinHandle<()>>,
}

impl Planning {
    pub(super) fn new(quiet: bool) -> Planning {
        if quiet {
            return Planning { end: None, waiter: None };
        }
        let (end, ended) = mpsc::channel::<()>();
        let wait = move || {
            if ended.recv_timeout(PATIENCE) == Err(RecvTimeoutError::Timeout) {
                // Where standard error is closed there is nobody to tell.
                let _ = writeln!(io::stderr(), "Planning ...");
            }
        };
        // Without a thread to wait on, nothing is said.
        Planning { end: Some(end), waiter: thread::Builder::new().spawn(wait).ok() }
    }
}

impl Drop for Planning {
    fn drop(&mut self) {
        self.end = None;
        if let Some(waiter) = self.waiter.take() {
            // It only waits and prints.
            let _ = waiter.join();
        }
    }
}

/// Shown on standard error.
pub(super) struct Progress {
    total: usize,
    done: usize,
    display: Display,
}

enum Display {
    Nothing,
    Bar(ProgressBar),
    Lines { next: f64 },
}

impl Progress {
    /// Of `total` steps.
    pub(super) fn new(total: usize, quiet: bool) -> Progress {
        let display = if quiet || total == 0 {
            Display::Nothing
        } else if io::stderr().is_terminal() {
            let style = ProgressStyle::with_template("{wide_bar} {percent:>3}%  {eta} left");
            let bar = ProgressBar::new(total as u64);
            Display::Bar(style.map_or_else(|_| bar.clone(), |style| bar.clone().with_style(style)))
        } else {
            Display::Lines { next: STRIDE }
        };
        Progress { total, done: 0, display }
    }

    /// Some more steps are done.
    pub(super) fn advance(&mut self, steps: usize) {
        self.done += steps;
        match &mut self.display {
            Display::Nothing => {}
            Display::Bar(bar) => bar.inc(steps as u64),
            Display::Lines { next } => {
                #[allow(clippy::cast_precision_loss, reason = "for show")]
                let percent = 100.0 * self.done as f64 / self.total as f64;
                if percent >= *next {
                    *next = STRIDE * (percent / STRIDE).floor() + STRIDE;
                    // Where standard error is closed there is nobody to tell.
                    let _ = writeln!(io::stderr(), "Progress: {percent:.1}%");
                }
            }
        }
    }
}

impl Drop for Progress {
    fn drop(&mut self) {
        if let Display::Bar(bar) = &self.display {
            bar.finish_and_clear();
        }
    }
}
