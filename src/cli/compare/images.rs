//! Images.

use serde::Serialize;

use super::tolerance::Tolerance;
use super::{Arguments, Kind, difference, figure, picture, too_much};
use crate::cli::interrupt::Interrupt;
use crate::cli::text::{self, Table};
use crate::cli::{Failure, Global};
use crate::report::flip::PIXELS_PER_DEGREE;
use crate::report::{ChannelDifference, Errors, ImageDifference, Picture, compare_images};

/// Bytes that are held for each pixel by FLIP, in strips and as a whole: two images of colours, the map, and a picture of it.
const PIXEL: u64 = 32;
/// Rows of double precision that each thread holds for FLIP, at most, at the usual distance.
const ROWS: u64 = 1500;

/// How images differ, as `--json` prints it.
#[derive(Debug, Serialize)]
pub(super) struct Report {
    kind: &'static str,
    a: Side,
    b: Side,
    #[serde(flatten)]
    found: ImageDifference,
    /// Where the difference was written.
    difference: Option<String>,
    /// Null where none was asked for.
    tolerance: Option<Tolerance>,
}

/// One of both, as `--json` prints it.
#[derive(Debug, Serialize)]
struct Side {
    file: String,
    /// What was compared of it: `linear`, or codes of `srgb`.
    values: &'static str,
}

impl Report {
    /// Whether the tolerance holds that was asked for. Where values that are NaN or infinite fail it, hints name their channels,
    /// and the layers without any.
    pub(super) fn result(&self) -> Result<(), Failure> {
        let held = self.tolerance.as_ref().map_or(Ok(()), Tolerance::result);
        held.map_err(|failure| {
            let channels = &self.found.channels;
            let name = |channel: &ChannelDifference| channel.name.clone();
            let partial: Vec<String> =
                channels.iter().filter(|channel| channel.errors.is_partial()).map(name).collect();
            if partial.is_empty() {
                return failure;
            }
            let failure = failure.hint(picture::listed("they are in", &partial));
            let is_whole = |layer: &String| !partial.iter().any(|name| picture::is_within(name, layer));
            let mut whole = picture::layers(channels.iter().map(|channel| channel.name.as_str()));
            whole.retain(is_whole);
            if whole.is_empty() {
                return failure;
            }
            failure.hint(picture::listed("--layer takes one layer only; all values are finite in", &whole))
        })
    }
}

/// Compares images.
pub(super) fn compare(
    arguments: &Arguments,
    kinds: [Kind; 2],
    global: &Global,
    interrupt: &Interrupt,
) -> Result<Report, Failure> {
    let budget = arguments.memory();
    let layer = arguments.layer.as_deref();
    let mut a = picture::read(&arguments.a, kinds[0], layer, budget)?;
    let left = budget.saturating_sub(picture::bytes(&a));
    let mut b = picture::read(&arguments.b, kinds[1], layer, left)?;
    if kinds[0] != kinds[1] {
        global.note("the PNG's codes of sRGB were turned into linear light");
    }
    picture::align(&mut a, &mut b);
    let held = picture::bytes(&a) + picture::bytes(&b);
    let [width, height] = a.size.map(|edge| edge as u64);
    let values = 2 * held.max(1);
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "from 1 to 15")]
    let reach = (arguments.pixels_per_degree() / PIXELS_PER_DEGREE).ceil() as u64;
    let threads = reach * rayon::current_num_threads() as u64;
    let need = [values, width * height * PIXEL, width * ROWS * 8 * threads]
        .iter()
        .fold(held, |sum, part| sum.saturating_add(*part));
    if need > budget {
        return Err(too_much("comparing the images", need));
    }
    let found = compare_images(&a, &b, arguments.exposure.unwrap_or(0.0), arguments.pixels_per_degree())
        .ok_or_else(|| unlike(arguments, &a, &b))?;
    let metric = arguments.metric.unwrap_or_default();
    let tolerance =
        arguments.tolerance.map(|limit| Tolerance::of_images(metric, limit, &found)).transpose()?;
    if let Some(path) = &arguments.difference {
        interrupt.hold();
        difference::write(path, arguments, [&a, &b], &found, interrupt)?;
    }
    let side = |path: &std::path::Path, picture: &Picture| Side {
        file: path.display().to_string(),
        values: if picture.srgb { "srgb" } else { "linear" },
    };
    Ok(Report {
        kind: "images",
        a: side(&arguments.a, &a),
        b: side(&arguments.b, &b),
        found,
        difference: arguments.difference.as_ref().map(|path| path.display().to_string()),
        tolerance,
    })
}

/// Why two images cannot be compared.
fn unlike(arguments: &Arguments, a: &Picture, b: &Picture) -> Failure {
    if a.size != b.size {
        let [a, b] = [a, b].map(|picture| format!("{} x {} pixels", picture.size[0], picture.size[1]));
        return Failure::failed("images of different sizes cannot be compared")
            .hint(format!("{} has {a}", arguments.a.display()))
            .hint(format!("{} has {b}", arguments.b.display()));
    }
    let of = |picture: &Picture, path: &std::path::Path| {
        let names: Vec<String> = picture.channels.iter().map(|(name, _)| name.clone()).collect();
        picture::listed(&format!("{} has", path.display()), &names)
    };
    Failure::failed("images without a channel of one name cannot be compared")
        .hint(of(a, &arguments.a))
        .hint(of(b, &arguments.b))
}

/// In words.
pub(super) fn human(report: &Report) -> String {
    let found = &report.found;
    let mut table = Table::default();
    for (name, side) in [("A", &report.a), ("B", &report.b)] {
        table.heading(format!("{name}  {}: {} values", text::plain(&side.file), side.values));
    }
    let [width, height] = found.pixels;
    table.row("pixels", format!("{width} x {height}"));
    columns(&mut table, ["", "RMSE", "L1", "bias", "99.9 %", "largest", "relMSE"].map(str::to_owned));
    let rows = if found.channels.len() > 1 { &found.channels[..] } else { &[] };
    for channel in rows.iter().chain([&found.all]) {
        let errors = &channel.errors;
        let [rmse, l1, bias, p999, max] = [errors.l2, errors.l1, errors.bias, errors.p999, errors.max]
            .map(|scaled| figure(scaled.absolute));
        columns(&mut table, [text::tidy(&channel.name), rmse, l1, bias, p999, max, figure(channel.rel_mse)]);
    }
    table.row("PSNR", psnr(&found.all.errors));
    match &found.flip {
        Some(flip) => table.row(
            "FLIP",
            format!(
                "mean {}, largest {}, of {} at {} pixels per degree",
                figure(flip.mean),
                figure(flip.max),
                flip.channels.iter().map(|name| text::tidy(name)).collect::<Vec<_>>().join(", "),
                figure(flip.pixels_per_degree)
            ),
        ),
        None => table.row("FLIP", "of colours and luminance only, which these are not"),
    }
    if let Some([a, b]) = found.flip.as_ref().map(|flip| flip.beyond_white).filter(|beyond| *beyond != [0; 2])
    {
        let [a, b] = [a, b].map(text::count);
        table.row("", format!("brighter than white, and cut: {a} pixels of A, {b} of B (see --exposure)"));
    }
    for (name, only) in ["only in A", "only in B"].into_iter().zip(&found.only) {
        if !only.is_empty() {
            table.row(name, picture::listed("", only).trim());
        }
    }
    if found.all.errors.is_partial() {
        let [a, b] = found.all.errors.not_finite.map(text::count);
        table.row("NaN or infinite", format!("{a} values of A, {b} of B; left out above, black in FLIP"));
    }
    if let Some(path) = &report.difference {
        table.row("difference", path);
    }
    if let Some(tolerance) = &report.tolerance {
        table.row("tolerance", tolerance.line());
    }
    table.finish()
}

fn columns(table: &mut Table, [name, rest @ ..]: [String; 7]) {
    let line: Vec<String> = rest.iter().map(|figure| format!("{figure:<10}")).collect();
    table.row(&name, line.join("  ").trim_end());
}

/// With its peak.
pub(super) fn psnr(errors: &Errors) -> String {
    match errors.psnr {
        Some(psnr) => format!("{psnr:.2} dB of the peak {}", figure(errors.peak)),
        None if errors.l2.absolute == 0.0 => "infinite: there is no difference".to_owned(),
        None => "none: A is 0 throughout".to_owned(),
    }
}
