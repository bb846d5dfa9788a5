//! The faults of a scene text, gathered while it is read and shown with the lines they are in.

#![cfg_attr(not(test), deny(clippy::arithmetic_side_effects))]

use std::cell::{Cell, RefCell};
use std::fmt;
use std::ops::Range;
use std::sync::Arc;

use annotate_snippets::{Annotation, AnnotationKind, Group, Level, Renderer, Snippet};

/// Faults kept while reading, so that hostile text cannot fill the memory with them; the rest are only counted.
const KEPT: usize = 1000;
/// Faults kept in the end, the first by position; the rest are only counted.
const SHOWN: usize = 100;

/// One fault of a scene text.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Fault {
    span: Range<usize>,
    title: String,
    label: String,
    notes: Vec<String>,
    related: Option<(Range<usize>, String)>,
    absence: bool,
    line: usize,
    column: usize,
}

impl Fault {
    /// A fault of the bytes `span` of the text.
    pub(super) fn at(span: Range<usize>, title: impl Into<String>) -> Fault {
        Fault {
            span,
            title: title.into(),
            label: String::new(),
            notes: Vec::new(),
            related: None,
            absence: false,
            line: 0,
            column: 0,
        }
    }

    /// What stands beside the underline.
    pub(super) fn label(mut self, label: impl Into<String>) -> Fault {
        self.label = label.into();
        self
    }

    /// A line below the snippet.
    pub(super) fn note(mut self, note: impl Into<String>) -> Fault {
        self.notes.push(note.into());
        self
    }

    /// Another place that the fault concerns.
    pub(super) fn related(mut self, span: Range<usize>, label: impl Into<String>) -> Fault {
        self.related = Some((span, label.into()));
        self
    }

    /// Marks a fault that says something is missing, which a syntax error may be the cause of.
    pub(super) fn absence(mut self) -> Fault {
        self.absence = true;
        self
    }

    pub(super) fn is_absence(&self) -> bool {
        self.absence
    }

    pub(super) fn span(&self) -> &Range<usize> {
        &self.span
    }

    /// What may help.
    pub fn notes(&self) -> &[String] {
        &self.notes
    }

    /// Line of the fault, the first is 1.
    pub fn line(&self) -> usize {
        self.line
    }

    /// Column of the fault in characters, the first is 1.
    pub fn column(&self) -> usize {
        self.column
    }

    /// What is wrong, then what was expected where that is known.
    pub fn message(&self) -> String {
        if self.label.is_empty() { self.title.clone() } else { format!("{}: {}", self.title, self.label) }
    }
}

/// Collects faults while a text is read.
#[derive(Debug, Default)]
pub(super) struct Faults {
    list: RefCell<Vec<Fault>>,
    more: Cell<usize>,
    warnings: RefCell<Vec<Fault>>,
}

impl Faults {
    pub(super) fn report(&self, fault: Fault) {
        let mut list = self.list.borrow_mut();
        if list.len() < KEPT {
            list.push(fault);
        } else {
            self.omit(1);
        }
    }

    /// Keeps what is no fault, but hardly meant.
    pub(super) fn warn(&self, warning: Fault) {
        let mut warnings = self.warnings.borrow_mut();
        if warnings.len() < SHOWN {
            warnings.push(warning);
        }
    }

    /// The warnings, in the order of `text`; of many the first hundred.
    pub(super) fn take_warnings(&self, origin: &str, text: &str) -> Warnings {
        let list = self.warnings.take();
        Warnings((!list.is_empty()).then(|| SceneErrors::new(origin, text, list, 0)).map(Box::new))
    }

    /// Counts faults that are not shown.
    pub(super) fn omit(&self, count: usize) {
        self.more.set(self.more.get().saturating_add(count));
    }

    /// Adds a note to every fault.
    pub(super) fn note(&self, note: &str) {
        for fault in self.list.borrow_mut().iter_mut() {
            fault.notes.push(note.to_owned());
        }
    }

    /// Removes the faults for which `keep` is false.
    pub(super) fn retain(&self, keep: impl FnMut(&Fault) -> bool) {
        self.list.borrow_mut().retain(keep);
    }

    /// The errors of `text`, or none.
    pub(super) fn into_errors(self, origin: &str, text: &str) -> Option<SceneErrors> {
        let list = self.list.into_inner();
        (!list.is_empty()).then(|| SceneErrors::new(origin, text, list, self.more.get()))
    }
}

/// Every fault that was found in a scene text, in the order of the text; at least one.
///
/// `Display` renders each with its file, line, column and source line, without colour or final newline.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SceneErrors {
    origin: String,
    text: Arc<str>,
    faults: Vec<Fault>,
    more: usize,
}

impl SceneErrors {
    pub(super) fn new(
        origin: &str,
        text: impl Into<Arc<str>>,
        mut faults: Vec<Fault>,
        more: usize,
    ) -> SceneErrors {
        let text = text.into();
        faults.sort_by_key(|fault| (fault.span.start, fault.span.end));
        let more = more.saturating_add(faults.len().saturating_sub(SHOWN));
        faults.truncate(SHOWN);
        let starts = line_starts(&text);
        for fault in &mut faults {
            let (line, column) = place(&text, &starts, fault.span.start);
            let before = line_text(&text, &starts, line).get(..column).unwrap_or_default();
            fault.line = line.saturating_add(1);
            fault.column = before.chars().count().saturating_add(1);
        }
        SceneErrors { origin: origin.to_owned(), text, faults, more }
    }

    /// The error of a file that is not UTF-8 text, at the first byte that is not. `None` where all of `bytes` is.
    pub fn not_utf8(origin: &str, bytes: &[u8]) -> Option<SceneErrors> {
        let at = std::str::from_utf8(bytes).err()?.valid_up_to();
        let text = String::from_utf8_lossy(bytes);
        let span = at..at.saturating_add(char::REPLACEMENT_CHARACTER.len_utf8());
        let fault = Fault::at(span, "this file is not UTF-8 text")
            .label(format!("byte {} of the file", at.saturating_add(1)))
            .note("a scene is a TOML file, saved as UTF-8");
        Some(SceneErrors::new(origin, text.as_ref(), vec![fault], 0))
    }

    /// The faults, in the order of the text; of more than a hundred the first.
    pub fn faults(&self) -> &[Fault] {
        &self.faults
    }

    /// Number of faults, those included that [`faults`](Self::faults) leaves off.
    pub fn count(&self) -> usize {
        self.faults.len().saturating_add(self.more)
    }

    /// As `Display` shows it, in colours for a terminal.
    pub fn to_coloured(&self) -> String {
        self.render(&Renderer::styled(), Level::ERROR)
    }

    /// As `Display` shows it, but of another level than an error.
    pub(super) fn show(&self, level: Level<'static>, coloured: bool) -> String {
        let renderer = if coloured { Renderer::styled() } else { Renderer::plain() };
        self.render(&renderer, level)
    }

    fn render(&self, renderer: &Renderer, level: Level<'static>) -> String {
        let starts = line_starts(&self.text);
        let mut out = String::new();
        for fault in &self.faults {
            if !out.is_empty() {
                out.push_str("\n\n");
            }
            out.push_str(&renderer.render(&[self.group(fault, &starts, level.clone())]));
        }
        match self.more {
            0 => {}
            1 => out.push_str("\n\nand 1 more error"),
            more => out.push_str(&format!("\n\nand {more} more errors")),
        }
        out
    }

    fn group<'a>(&'a self, fault: &'a Fault, starts: &[usize], level: Level<'a>) -> Group<'a> {
        let (line, primary) = self.mark(AnnotationKind::Primary, &fault.span, &fault.label, starts);
        let mut first = self.line(line, starts).annotation(primary);
        let mut second = None;
        if let Some((span, label)) = &fault.related {
            let (other, context) = self.mark(AnnotationKind::Context, span, label, starts);
            if other == line {
                first = first.annotation(context);
            } else {
                second = Some(self.line(other, starts).annotation(context));
            }
        }
        level
            .primary_title(fault.title.as_str())
            .element(first)
            .elements(second)
            .elements(fault.notes.iter().map(|note| Level::HELP.message(note.as_str())))
    }

    /// One line of the text: the whole of it would be laid out anew for each fault.
    fn line<'a>(&'a self, line: usize, starts: &[usize]) -> Snippet<'a, Annotation<'a>> {
        let text = line_text(&self.text, starts, line);
        Snippet::source(text).line_start(line.saturating_add(1)).path(self.origin.as_str())
    }

    /// The line of `span` and a mark over as much of it as that line holds.
    fn mark<'a>(
        &self,
        kind: AnnotationKind,
        span: &Range<usize>,
        label: &'a str,
        starts: &[usize],
    ) -> (usize, Annotation<'a>) {
        let (line, start) = place(&self.text, starts, span.start);
        let (last, end) = place(&self.text, starts, span.end);
        let end = if last == line { end } else { line_text(&self.text, starts, line).len() };
        (line, kind.span(start..end).label((!label.is_empty()).then_some(label)))
    }
}

impl fmt::Display for SceneErrors {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.render(&Renderer::plain(), Level::ERROR))
    }
}

impl std::error::Error for SceneErrors {}

/// What in a scene is valid, but hardly meant; mostly nothing.
///
/// `Display` renders each with its place, as [`SceneErrors`] does, and nothing where there is none.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Warnings(Option<Box<SceneErrors>>);

impl Warnings {
    /// The warnings, in the order of the text.
    pub fn list(&self) -> &[Fault] {
        self.0.as_ref().map_or(&[], |errors| errors.faults())
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.0.is_none()
    }

    /// As `Display` shows them, in colours for a terminal.
    pub fn to_coloured(&self) -> String {
        self.0.as_ref().map_or_else(String::new, |errors| errors.render(&Renderer::styled(), Level::WARNING))
    }
}

impl fmt::Display for Warnings {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0
            .as_ref()
            .map_or(Ok(()), |errors| f.write_str(&errors.render(&Renderer::plain(), Level::WARNING)))
    }
}

/// Byte offsets at which the lines begin; the first is 0.
fn line_starts(text: &str) -> Vec<usize> {
    std::iter::once(0).chain(text.match_indices('\n').map(|(at, _)| at.saturating_add(1))).collect()
}

/// A line, counted from 0, without what ends it.
fn line_text<'a>(text: &'a str, starts: &[usize], line: usize) -> &'a str {
    let start = starts.get(line).copied().unwrap_or(text.len());
    let end = starts.get(line.saturating_add(1)).map_or(text.len(), |next| next.saturating_sub(1));
    text.get(start..end).unwrap_or_default().trim_end_matches('\r')
}

/// The line, counted from 0, and the byte in its text where byte `at` is, or the character that holds it.
fn place(text: &str, starts: &[usize], at: usize) -> (usize, usize) {
    let line = starts.partition_point(|&start| start <= at.min(text.len())).saturating_sub(1);
    let content = line_text(text, starts, line);
    let start = starts.get(line).copied().unwrap_or(0);
    let column = at.saturating_sub(start).min(content.len());
    (line, (0..=column).rfind(|at| content.is_char_boundary(*at)).unwrap_or(0))
}
