//! The catalogue on a page: where accuracy ends.

use maud::{Markup, PreEscaped, html};

use super::case::Outcome;
use super::family::{Family, Mark};
use crate::report::page::plot::{Axis, Look, Plot, PlotError, Point, Series};
use crate::report::page::{PageError, Section, document, words};

/// Errors below this are drawn here: a logarithmic axis has no 0.
const LEAST: f64 = 1e-9;

/// Plots of the families.
///
/// # Errors
///
/// Where a plot cannot be drawn.
pub fn section(families: &[Family]) -> Result<Section, PageError> {
    let plots: Vec<String> = families.iter().map(figure).collect::<Result<_, PlotError>>()?;
    Ok(Section::new(
        "Where accuracy ends",
        html! {
            p {
                "Largest errors of single precision against double, of small scenes that get ever more extreme, and of light in ever deeper steps "
                "against its closed form. Dashed: the most that " code { "vdbake check" } " allows. Marks at the bottom are errors of 1e-9 or less."
            }
            div.plots { @for plot in &plots { figure { (PreEscaped(plot)) } } }
            (refusals(families))
        },
    ))
}

/// A page of cases and families.
///
/// # Errors
///
/// Where a plot cannot be drawn.
pub fn page(cases: &[Outcome], families: &[Family]) -> Result<String, PageError> {
    let held = cases.iter().filter(|case| case.holds).count();
    let mut sections = Vec::new();
    if !families.is_empty() {
        sections.push(section(families)?);
    }
    if !cases.is_empty() {
        sections.push(Section::new(format!("{held} of {} cases hold", cases.len()), table(cases)));
    }
    let lead = "Stiff and extreme cases: what must be true of each, and what was found.";
    Ok(document("Numerical stability", "Numerical stability", lead, &sections))
}

fn figure(family: &Family) -> Result<String, PlotError> {
    let points = |height: fn(&Mark) -> Option<f64>| -> Vec<Point> {
        let place = |at: f64, error: f64| Point { at: [at, error.max(LEAST)], interval: None, label: None };
        family.marks.iter().filter_map(|mark| Some(place(mark.at, height(mark)?))).collect()
    };
    let plot = Plot {
        name: family.name,
        title: capital(family.name),
        axes: [Axis { label: family.parameter, format: power }, Axis { label: family.error, format: power }],
        series: vec![
            Series {
                name: String::new(),
                look: Look::Dashes,
                points: points(|mark| mark.error.and(Some(mark.bound))),
            },
            Series { name: String::new(), look: Look::Line(0), points: points(|mark| mark.error) },
        ],
    };
    plot.figure()
}

/// A word as it begins a line.
fn capital(word: &str) -> String {
    let mut letters = word.chars();
    letters.next().map(|first| first.to_uppercase().chain(letters).collect()).unwrap_or_default()
}

/// A number on an axis of many powers of ten.
fn power(x: f64) -> String {
    if (0.01..1000.0).contains(&x) { words::figure(x) } else { format!("{x:.0e}") }
}

/// What was refused, and why.
fn refusals(families: &[Family]) -> Markup {
    let refused: Vec<String> = families
        .iter()
        .flat_map(|family| {
            family.marks.iter().filter_map(|mark| {
                let why = mark.failed.as_ref().or(mark.refused.as_ref())?;
                Some(format!("{} at {}: {why}", family.name, power(mark.at)))
            })
        })
        .collect();
    html! { @if !refused.is_empty() { p.note { "Refused before memory is taken:" } ul.note { @for line in &refused { li { (line) } } } } }
}

fn table(cases: &[Outcome]) -> Markup {
    html! {
        div.scroll { table {
            thead { tr { th { "case" } th.wide { "found" } th { "at most" } th { "part of it" } th.wide { "expected" } } }
            tbody { @for case in cases {
                tr.front[!case.holds] {
                    th.wide scope="row" { (case.group) ": " @if !case.holds { "does not hold: " } (case.name) }
                    td.wide { (case.found) }
                    td { (case.bound.map(power).unwrap_or_default()) }
                    td { (case.margin.map(words::figure).unwrap_or_default()) }
                    td.wide { (case.expected) }
                }
            } }
        } }
    }
}
