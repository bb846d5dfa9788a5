//! The page: what a sweep found, as one HTML file without scripts that holds all it shows.

mod answers;
mod charts;
mod document;
mod gallery;
pub(crate) mod plot;
pub(crate) mod words;

use std::io::Cursor;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use maud::{Markup, PreEscaped, html};

use super::sweep::{ImageParts, Kind, OrderOf, PAPER, PaysAfter, Report, Row};
use super::{Part, Parts};
use crate::formats::png;
use answers::Answer;
pub use document::{Section, document};
pub use gallery::galleries;
pub use plot::PlotError;

/// A picture on the page.
#[derive(Debug, Clone)]
pub struct Shot {
    /// What it is of, in a few words.
    pub title: String,
    /// What is to be seen, and by what it is measured.
    pub caption: String,
    /// Pixels.
    pub size: [usize; 2],
    /// Red, green and blue, in rows from the top.
    pub pixels: Vec<[u8; 3]>,
}

/// Pictures that are looked at together.
#[derive(Debug, Clone)]
pub struct Gallery {
    /// What they are.
    pub title: &'static str,
    /// A sentence or two.
    pub text: String,
    /// In order.
    pub shots: Vec<Shot>,
}

/// A plot in both forms.
#[derive(Debug, Clone)]
pub struct Drawing {
    /// A word.
    pub name: &'static str,
    /// A file of its own.
    pub svg: String,
    /// Likewise.
    pub png: Vec<u8>,
}

/// Why a page came to nothing.
#[derive(Debug, thiserror::Error)]
pub enum PageError {
    /// A plot.
    #[error(transparent)]
    Plot(#[from] PlotError),
    /// A picture.
    #[error("cannot compress a picture: {0}")]
    Picture(#[from] ::png::EncodingError),
}

/// The plots as files.
///
/// # Errors
///
/// [`PageError`].
pub fn drawings(report: &Report) -> Result<Vec<Drawing>, PageError> {
    charts::charts(report)
        .iter()
        .map(|plot| {
            let ([width, height], pixels) = plot.pixels()?;
            let pixels = pixels.as_chunks().0;
            let size = [width as usize, height as usize];
            Ok(Drawing { name: plot.name, svg: plot.svg(true)?, png: compressed(size, pixels)? })
        })
        .collect()
}

/// The page of a scene that was read from `file`, with sections that others have for it.
///
/// # Errors
///
/// [`PageError`].
pub fn page(
    report: &Report,
    file: &str,
    galleries: &[Gallery],
    more: Vec<Section>,
) -> Result<String, PageError> {
    let mut plots = Vec::new();
    for plot in charts::charts(report) {
        plots.push(plot.figure()?);
    }
    let mut pictures = Vec::new();
    for gallery in galleries {
        pictures.push(show(gallery)?);
    }
    let mut sections = vec![
        Section::new("Which setting for which error", answer(report, file)),
        Section::new(
            "Error and cost",
            html! {
                p { "Every mark is a bake or a picture that was made; bars are 95\u{202f}% intervals. Dashed: the best that a command makes." }
                div.plots { @for plot in &plots { figure { (PreEscaped(plot)) } } }
                (fronts(report, file))
                @if !report.orders.is_empty() { (orders(&report.orders)) }
            },
        ),
        Section::new("Where the error comes from", parts(report)),
    ];
    for (gallery, shown) in galleries.iter().zip(&pictures) {
        sections.push(Section::new(gallery.title, html! { p { (gallery.text) } (shown) }));
    }
    sections.extend(paper(report));
    sections.extend(more);
    sections.push(Section::new("All figures", tables(report, file)));
    sections.push(Section::new("How it was measured", method(report)));
    let title = format!("{}: error against run time", report.scene);
    let lead = "What each accuracy costs: a bake's error against the density that the scene defines.";
    Ok(document(&title, &report.scene, lead, &sections))
}

fn answer(report: &Report, file: &str) -> Markup {
    let answers = answers::answers(report);
    let own = answers::own(report);
    let error = |row: &Row| row.field.as_ref().and_then(|field| field.errors.l2.of_rms);
    let is_empty = report.parts.whole.of_truth.is_none();
    let is_beyond =
        answers.iter().any(|answer| answer.setting.as_ref().is_some_and(|setting| setting.is_beyond));
    html! {
        @if let Some(row) = own {
            p {
                "With voxels of " (words::metres(report.voxel_size)) " the scene bakes "
                @if let Some(error) = error(row) { "with an error of " b { (words::part(error)) } " " }
                @if let Some(total) = row.cost.total { "in " b { (words::seconds(total.median)) } " " }
                @if let Some(bytes) = row.cost.bytes { "to " b { (bytes_of(bytes)) } }
                "."
            }
        }
        div.scroll {
            table.answer.most {
                thead { tr { th { "error at most" } th { "voxel" } th { "values" } th { "file" } th { "time" } th.wide { "command" } } }
                tbody { @for answer in &answers { (answer_row(answer, file, report.time)) } }
            }
        }
        p.note {
            "Errors are root mean squares over the density's support, as parts of the density's own, at the upper end of their 95\u{202f}% intervals; voxels are read trilinearly. "
            "Settings between those that were measured follow powers of the voxel size. "
            @if is_beyond { "An asterisk marks voxels smaller than all that were measured. " }
            code { "bake --max-error" } " finds a setting and checks it."
        }
        @if let Some(pays) = report.pays_after.as_ref().filter(|_| !is_empty) { (pays_after(pays)) }
    }
}

fn answer_row(answer: &Answer, file: &str, time: f64) -> Markup {
    html! {
        tr {
            th scope="row" { (words::part(answer.error)) }
            @match &answer.setting {
                Some(setting) => {
                    td { (words::metres(setting.voxel_size)) @if setting.is_beyond { "*" } }
                    td { @if setting.is_half { "f16" } @else { "f32" } }
                    td { (words::bytes(setting.bytes)) }
                    td { (words::seconds(setting.seconds)) }
                    td.wide { code {
                        "vdbake bake " (words::quoted(file)) " " span.option { "--voxel-size " (setting.voxel_size) }
                        @if time != 0.0 { " " span.option { "--time " (time) } }
                        @if setting.is_half { " " span.option { "--precision f16" } }
                    } }
                }
                None => td.wide colspan="5" { "needs voxels far smaller than those that were measured" },
            }
        }
    }
}

/// The error taken apart.
fn parts(report: &Report) -> Markup {
    let row = |name: &str, what: &str, of: fn(&Parts) -> Part| {
        let share = |parts: &Parts| {
            let (part, whole) = (of(parts).rms, parts.whole.rms);
            if whole > 0.0 { 100.0 * (part / whole) * (part / whole) } else { 0.0 }
        };
        html! {
            tr {
                th scope="row" { (name) }
                td { (relative(of(&report.parts))) }
                td.bar { div style={ "width:" (format!("{:.1}", share(&report.parts).min(100.0))) "%" } {} }
                td { (relative(of(&report.parts_f16))) }
                td.wide { (what) }
            }
        }
    };
    html! {
        div.scroll { table.parts {
            thead { tr { th {} th { "f32" } th.bar { "share of the square" } th { "f16" } th.wide { "what it is" } } }
            tbody {
                (row("interpolation", "voxels and the filter between them", |parts| parts.interpolation))
                (row("model", "octaves faded and thin parts widened for the voxel size", |parts| parts.model))
                (row("quantisation", "the precision in which values are stored", |parts| parts.quantisation))
                (row("rounding", "single precision in the evaluation", |parts| parts.rounding))
                (row("whole", "all of it, at this voxel size", |parts| parts.whole))
            }
        } }
        @if let Some(of_whole) = report.parts.of_whole {
            p.note { "Together, as the root of the sum of their squares, they are " (words::part(of_whole)) " of the whole in f32." }
        }
        (apart(report.parts.reason.as_deref(), "in f32"))
        (apart(report.parts_f16.reason.as_deref(), "in f16"))
        @if let Some(parts) = &report.image_parts { (image_parts(parts)) }
    }
}

/// Rows that none beats, with the commands that make them.
fn fronts(report: &Report, file: &str) -> Markup {
    let front = |kind: Kind| {
        let mut rows: Vec<(&Row, f64)> = (report.rows.iter())
            .filter(|row| row.on_front && row.kind == kind)
            .filter_map(|row| Some((row, row.level()?.error)))
            .collect();
        rows.sort_by(|a, b| a.1.total_cmp(&b.1));
        rows
    };
    let kinds = [(Kind::Bake, "Bakes"), (Kind::Picture, "Pictures")].map(|(kind, name)| (name, front(kind)));
    html! {
        @for (name, rows) in kinds.iter().filter(|(_, rows)| !rows.is_empty()) {
            h3 { (name) " that no other beats in both" }
            div.scroll { table.answer {
                thead { tr { th { "error" } th { "time" } th { "file" } th.label { "setting" } th.wide { "command" } } }
                tbody { @for (row, error) in rows { tr {
                    th scope="row" { (words::part(*error)) }
                    td { (row.cost.total.map_or_else(String::new, |total| words::seconds(total.median))) }
                    td { (row.cost.bytes.map_or_else(String::new, bytes_of)) }
                    td.label { (row.label) }
                    td.wide { code { (whole_options(&command(row, file).unwrap_or_default())) } }
                } } }
            } }
        }
    }
}

/// The command that makes a row, of a scene that was read from `file`.
fn command(row: &Row, file: &str) -> Option<String> {
    row.command.as_ref().map(|command| command.replacen("SCENE", &words::quoted(file), 1))
}

/// A command whose lines break between its options.
fn whole_options(command: &str) -> Markup {
    let mut parts = command.split(" --");
    html! {
        (parts.next().unwrap_or_default())
        @for part in parts { " " span.option { "--" (part) } }
    }
}

/// The powers with which errors fall, by filter and metric.
fn orders(all: &[OrderOf]) -> Markup {
    let cell = |filter: &str, metric: &str| {
        let found = all.iter().find(|order| order.filter == filter && order.metric == metric);
        let measured = found.and_then(|order| order.measured);
        let text = measured.map_or_else(
            || "\u{2013}".to_owned(),
            |order| match order.uncertainty {
                Some(off) => format!("{:.2} \u{b1} {off:.2}", order.order),
                None => format!("{:.2}", order.order),
            },
        );
        html! { td title=[found.map(|order| order.why.as_str())] { (text) } }
    };
    let metrics = [("l1", "L1"), ("l2", "L2"), ("max", "largest"), ("optical-depth", "optical depth")];
    let mut filters: Vec<(&str, f64)> = Vec::new();
    for order in all {
        if !filters.iter().any(|(filter, _)| *filter == order.filter) {
            filters.push((order.filter, order.theory));
        }
    }
    // Each reason once, with what it is of.
    let mut unknown: Vec<(&str, Vec<String>)> = Vec::new();
    for order in all.iter().filter(|order| order.measured.is_none()) {
        let what = format!("{}, {}", order.filter, order.metric);
        match unknown.iter_mut().find(|(why, _)| *why == order.why) {
            Some((_, of)) => of.push(what),
            None => unknown.push((&order.why, vec![what])),
        }
    }
    let sizes = all.iter().find(|order| order.filter == "trilinear" && order.metric == "l2");
    html! {
        h3 { "Orders of convergence" }
        div.scroll { table {
            thead { tr { th { "filter" } @for (_, name) in metrics { th { (name) } } th { "smooth densities" } } }
            tbody { @for (filter, theory) in &filters { tr {
                th scope="row" { (filter) }
                @for (metric, _) in metrics { (cell(filter, metric)) }
                td { (words::figure(*theory)) }
            } } }
        } }
        p.note {
            "With which power of the voxel size errors fall, and what theory has for densities without kinks, steps and octaves finer than the voxels."
            @if let Some(order) = sizes.filter(|order| order.measured.is_some()) {
                " Trilinear L2: from voxels of "
                (order.voxel_sizes.iter().map(|size| words::metres(*size)).collect::<Vec<_>>().join(", ")) ", " (order.why) "."
            }
            @for (why, of) in &unknown { " Not told (" (of.join("; ")) "): " (why) "." }
        }
    }
}

/// The table of a text whose integrator is among the methods.
fn paper(report: &Report) -> Option<Section> {
    let rows: Vec<&Row> = report.rows.iter().filter(|row| row.group == PAPER).collect();
    let time = |row: &Row| row.cost.total.map(|total| total.median);
    let own = time(rows.first()?)?;
    let body = html! {
        p {
            "The rows of the table in Moinet\u{2019}s \u{201c}Sculpting procedural noise\u{201d} (2022), all by its integrator, in steps of a voxel and without shadows, as it has none. "
            "Errors are against a picture in steps of a quarter of a voxel, without shadows too."
        }
        div.scroll { table {
            thead { tr { th { "setting" } th { "pictures a second" } th { "times as fast" } th { "error" } } }
            tbody { @for row in &rows { tr {
                th scope="row" { (row.label) }
                td { (time(row).map_or_else(String::new, |time| words::figure(1.0 / time))) }
                td { (time(row).map_or_else(String::new, |time| words::figure(own / time))) }
                td { (row.image.and_then(|image| image.relative).map_or_else(String::new, words::part)) }
            } } }
        } }
    };
    Some(Section::new("What simpler noise and longer steps save", body))
}

/// Why parts are not the whole.
fn apart(reason: Option<&str>, of: &str) -> Markup {
    html! { @if let Some(reason) = reason { p.note { "The parts' squares do not add up to the whole " (of) ": " (reason) "." } } }
}

fn relative(part: Part) -> String {
    part.of_truth.map_or_else(|| words::figure(part.rms), words::part)
}

fn show(gallery: &Gallery) -> Result<Markup, PageError> {
    let mut figures = Vec::new();
    for shot in &gallery.shots {
        let file = compressed(shot.size, &shot.pixels)?;
        let source = format!("data:image/png;base64,{}", STANDARD.encode(file));
        figures.push(html! {
            figure {
                img src=(source) width=(shot.size[0]) height=(shot.size[1]) alt=(shot.title);
                figcaption { b { (shot.title) } " " (shot.caption) }
            }
        });
    }
    Ok(html! { div.shots { @for figure in &figures { (figure) } } })
}

fn compressed(size: [usize; 2], pixels: &[[u8; 3]]) -> Result<Vec<u8>, PageError> {
    let mut file = Cursor::new(Vec::new());
    png::write(size, pixels, &mut file)?;
    Ok(file.into_inner())
}

/// Every row, in tables of one group each.
fn tables(report: &Report, file: &str) -> Markup {
    let mut groups: Vec<(Kind, &str)> = Vec::new();
    for row in &report.rows {
        if !groups.contains(&(row.kind, row.group)) {
            groups.push((row.kind, row.group));
        }
    }
    html! {
        @for (kind, group) in &groups {
            details open {
                summary { (group) @if *kind == Kind::Picture { " (pictures)" } }
                div.scroll { (table(*kind, &of_group(report, *kind, group), file)) }
            }
        }
    }
}

/// The rows of a group, those of voxel sizes from the smallest.
fn of_group<'a>(report: &'a Report, kind: Kind, group: &str) -> Vec<&'a Row> {
    let mut rows: Vec<&Row> =
        report.rows.iter().filter(|row| row.kind == kind && row.group == group).collect();
    if group == answers::SIZES {
        rows.sort_by(|a, b| a.settings.voxel_size.total_cmp(&b.settings.voxel_size));
    }
    rows
}

fn table(kind: Kind, rows: &[&Row], file: &str) -> Markup {
    let cell = |text: Option<String>| html! { td { (text.unwrap_or_else(|| "\u{2013}".to_owned())) } };
    let part = |x: Option<f64>| x.map(words::part);
    html! {
        table {
            @if kind == Kind::Bake {
                thead { tr {
                    th { "setting" } th { "voxel" } th { "L2" } th { "95\u{202f}%" } th { "L1" } th { "99.9\u{202f}%" } th { "largest" } th { "bias" }
                    th { "mass" } th { "optical depth" } th { "time" } th { "spread" } th { "plan" } th { "evaluate" } th { "encode" } th { "write" } th { "read" }
                    th { "ns a voxel" } th { "memory" } th { "file" }
                } }
            } @else {
                thead { tr {
                    th { "setting" } th { "voxel" } th { "step" } th { "error" } th { "95\u{202f}%" } th { "PSNR" } th { "95\u{202f}%" } th { "FLIP" } th { "95\u{202f}%" }
                    th { "transmittance" } th { "time" } th { "spread" }
                } }
            }
            tbody {
                @for row in rows {
                    tr.front[row.on_front] {
                        th scope="row" title=[command(row, file)] { (row.label) }
                        (cell(Some(words::metres(row.settings.voxel_size))))
                        @if kind == Kind::Bake {
                            @let errors = row.field.as_ref().map(|field| field.errors);
                            (cell(part(errors.and_then(|e| e.l2.of_rms))))
                            (cell(held(row).map(|ends| range(ends, words::part))))
                            (cell(part(errors.and_then(|e| e.l1.of_rms))))
                            (cell(part(errors.and_then(|e| e.p999.of_peak))))
                            (cell(part(errors.and_then(|e| e.max.of_peak))))
                            (cell(part(errors.and_then(|e| e.bias.of_rms))))
                            (cell(row.field.as_ref().and_then(|field| field.mass_ratio).map(|ratio| format!("{ratio:.5}"))))
                            (cell(part(row.field.as_ref().and_then(|field| field.optical_depth))))
                        } @else {
                            (cell(row.settings.step.map(words::figure)))
                            @let ends = row.image.and_then(|image| image.intervals);
                            (cell(part(row.image.and_then(|image| image.relative))))
                            (cell(ends.and_then(|ends| ends.relative).map(|ends| range(ends, words::part))))
                            (cell(row.image.and_then(|image| image.psnr).map(decibels)))
                            (cell(ends.and_then(|ends| ends.psnr).map(|ends| range(ends, decibels))))
                            (cell(row.image.and_then(|image| image.flip).map(words::figure)))
                            (cell(ends.and_then(|ends| ends.flip).map(|ends| range(ends, words::figure))))
                            (cell(row.image.map(|image| words::figure(image.transmittance))))
                        }
                        (cell(row.cost.total.map(|total| words::seconds(total.median))))
                        (cell(row.cost.total.map(|total| format!("{} to {}", words::seconds(total.least), words::seconds(total.most)))))
                        @if kind == Kind::Bake {
                            @for phase in [row.cost.plan, row.cost.evaluate, row.cost.encode, row.cost.write, row.cost.read] {
                                (cell(phase.map(|phase| words::seconds(phase.median))))
                            }
                            (cell(row.cost.ns_per_voxel.map(words::figure)))
                            (cell(row.cost.memory.map(bytes_of)))
                            (cell(row.cost.bytes.map(bytes_of)))
                        }
                    }
                }
            }
        }
    }
}

/// The interval of 95 % of a row's relative error.
fn held(row: &Row) -> Option<[f64; 2]> {
    match row.kind {
        Kind::Bake => row.field.as_ref()?.intervals?.relative_l2,
        Kind::Picture => row.image?.intervals?.relative,
    }
}

/// Both ends of an interval.
fn range([low, high]: [f64; 2], format: fn(f64) -> String) -> String {
    format!("{} to {}", format(low), format(high))
}

fn decibels(x: f64) -> String {
    format!("{x:.1}\u{202f}dB")
}

/// When a bake pays.
fn pays_after(pays: &PaysAfter) -> Markup {
    let [scene, voxels] = [pays.procedural_frame, pays.baked_frame].map(words::seconds);
    html! {
        p {
            "A picture of the scene itself takes " (scene) ", one of its voxels " (voxels) ": "
            @match pays.frames {
                Some(frames) => {
                    "the bake of " (words::seconds(pays.bake)) " has paid after " b { (words::figure(frames.ceil().max(1.0))) }
                    @if frames > 1.0 { " pictures." } @else { " picture." }
                }
                None => "a bake does not pay by pictures of this program alone.",
            }
        }
    }
}

/// A picture's error taken apart.
fn image_parts(parts: &ImageParts) -> Markup {
    let rows = [
        ("interpolation", parts.interpolation, "voxels and the filter between them"),
        ("model", parts.model, "octaves faded and thin parts widened for the voxel size"),
        ("quantisation", parts.quantisation, "half precision"),
        ("early exit", parts.early_exit, "rays that end where nearly nothing can be seen"),
        ("whole", parts.whole, "a picture of the voxels in half precision against the scene, marched finely"),
        ("step", parts.step, "steps of one voxel where there are no voxels: no part of the whole"),
    ];
    html! {
        h3 { "Of a picture's transmittance" }
        div.scroll { table {
            thead { tr { th {} th { "of the picture's" } th.wide { "what it is" } } }
            tbody { @for (name, part, what) in rows {
                tr { th scope="row" { (name) } td { (relative(part)) } td.wide { (what) } }
            } }
        } }
        @if let Some(of_whole) = parts.of_whole {
            p.note { "The first four together, as the root of the sum of their squares, are " (words::part(of_whole)) " of the whole." }
        }
        (apart(parts.reason.as_deref(), "of a picture"))
    }
}

#[allow(clippy::cast_precision_loss, reason = "in words")]
fn bytes_of(bytes: u64) -> String {
    words::bytes(bytes as f64)
}

fn method(report: &Report) -> Markup {
    let machine = &report.machine;
    html! {
        ul {
            li {
                "Truth: the density as the scene defines it, in double precision and with every octave, at "
                (words::count(report.truth.points)) " points of its support and of the bakes', and along "
                (words::count(report.truth.rays)) " rays. Along rays and in pictures it is evaluated in single precision, "
                "which is off by " (relative(report.truth.kernel)) " at those points."
            }
            li {
                "Times are medians of repeats after a first that is not counted, by the clock of "
                (machine.threads) " threads (" (machine.simd) (machine.processor.as_ref().map_or(String::new(), |name| format!(", {name}"))) "). "
                "Ratios of one run can be compared; times of other machines cannot."
            }
            li { "Plan, write and read are by the clock, evaluation and encoding the processor time of all threads; memory is what the plan and the file hold." }
            li { "Rows in bold are on the front: none other of their kind is both faster and more exact." }
            li { "The whole took " (words::seconds(report.seconds)) "; nothing was begun after " (words::seconds(report.time_limit)) "." }
            @if !report.left_out.is_empty() { li { "Left out, for lack of time where nothing else is said: " (report.left_out.join(", ")) "." } }
        }
    }
}
