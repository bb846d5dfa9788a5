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

/// Shown on standard error: how much is done of parts that count the same, one after the other.
pub(super) struct Progress {
    parts: usize,
    /// Parts that were begun.
    begun: usize,
    /// Steps of the present part, and those of them that are done.
    total: usize,
    done: usize,
    display: Display,
}

enum Display {
    Nothing,
    Bar(ProgressBar),
    Lines { next: f64 },
}

/// Steps of a bar.
const FINENESS: u32 = 100_000;

impl Progress {
    /// Of so many parts.
    pub(super) fn new(parts: usize, quiet: bool) -> Progress {
        let display = if quiet {
            Display::Nothing
        } else if io::stderr().is_terminal() {
            let style = ProgressStyle::with_template("{wide_bar} {percent:>3}%  {eta} left");
            let bar = ProgressBar::new(FINENESS.into());
            Display::Bar(style.map_or_else(|_| bar.clone(), |style| bar.clone().with_style(style)))
        } else {
            Display::Lines { next: STRIDE }
        };
        Progress { parts, begun: 0, total: 0, done: 0, display }
    }

    /// The next part begins, of `total` steps.
    pub(super) fn begin(&mut self, total: usize) {
        (self.begun, self.total, self.done) = (self.begun + 1, total, 0);
        if total == 0 && self.parts > 1 {
            self.update();
        }
    }

    /// What was done of the present part is to be done again.
    pub(super) fn again(&mut self) {
        self.begun = self.begun.saturating_sub(1);
    }

    /// Some more steps are done.
    pub(super) fn advance(&mut self, steps: usize) {
        self.done += steps;
        self.update();
    }

    /// Prints something else, without damage to a bar.
    pub(super) fn aside<T>(&self, print: impl FnOnce() -> T) -> T {
        match &self.display {
            Display::Bar(bar) => bar.suspend(print),
            Display::Nothing | Display::Lines { .. } => print(),
        }
    }

    fn update(&mut self) {
        #[allow(clippy::cast_precision_loss, reason = "for show")]
        let part = if self.total == 0 { 1.0 } else { self.done as f64 / self.total as f64 };
        #[allow(clippy::cast_precision_loss, reason = "for show")]
        let all = ((self.begun - 1) as f64 + part) / self.parts as f64;
        match &mut self.display {
            Display::Nothing => {}
            #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "from 0 to 1")]
            Display::Bar(bar) => bar.set_position((all * f64::from(FINENESS)) as u64),
            Display::Lines { next } => {
                let percent = 100.0 * all;
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
