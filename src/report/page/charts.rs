//! The plots of a report.

use super::answers::{ladder, own};
use super::plot::{Axis, Look, Plot, Point, Series};
use super::{held, words};
use crate::report::sweep::{Kind, Report, Row};

const ERROR: Axis = Axis { label: "relative L2 error", format: words::part };

/// All plots that there are figures for.
pub(super) fn charts(report: &Report) -> Vec<Plot> {
    [
        front(report, "time", "Error of a bake against its time", SECONDS, |row| {
            Some(row.cost.total?.median)
        }),
        front(report, "bytes", "Error of a bake against its size", KIBIBYTES, |row| {
            #[allow(clippy::cast_precision_loss, reason = "a plot")]
            row.cost.bytes.map(|bytes| bytes as f64 / 1024.0)
        }),
        convergence(report),
        octaves(report),
        pictures(report),
    ]
    .into_iter()
    .filter(|plot| plot.series.iter().any(|series| !series.points.is_empty()))
    .collect()
}

const SECONDS: Axis = Axis { label: "seconds to bake", format: words::seconds };
const KIBIBYTES: Axis = Axis { label: "KiB of the file", format: words::whole };

/// Bakes: groups of rows as marks, and a line through those that none other beats.
fn front(report: &Report, name: &'static str, title: &str, x: Axis, cost: fn(&Row) -> Option<f64>) -> Plot {
    let bakes: Vec<&Row> = report.rows.iter().filter(|row| row.kind == Kind::Bake && row.is_own).collect();
    let mut groups: Vec<&str> = Vec::new();
    for row in &bakes {
        if !groups.contains(&row.group) {
            groups.push(row.group);
        }
    }
    let point = |row: &&&Row| {
        let error = row.field.as_ref()?.errors.l2.of_rms?;
        let at = [cost(row)?, error];
        at.iter().all(|x| *x > 0.0).then_some(Point { at, interval: held(row), label: None })
    };
    let mut series: Vec<Series> = Vec::new();
    // A line through what one could choose.
    let can = bakes.iter().filter(|row| row.can_be_chosen());
    let mut best: Vec<[f64; 2]> = can.filter_map(|row| point(&row)).map(|point| point.at).collect();
    best.sort_by(|a, b| a[0].total_cmp(&b[0]));
    let mut least = f64::INFINITY;
    best.retain(|[_, error]| {
        let is_better = *error < least && *error > 0.0;
        least = least.min(*error);
        is_better
    });
    let best = best.into_iter().map(|at| Point { at, interval: None, label: None }).collect();
    series.push(Series { name: "best".to_owned(), look: Look::Dashes, points: best });
    for (number, group) in groups.into_iter().enumerate() {
        let points: Vec<Point> =
            bakes.iter().filter(|row| row.group == group).filter_map(|row| point(&row)).collect();
        if !points.is_empty() {
            let name = group.split(" and ").next().unwrap_or(group).to_owned();
            series.push(Series { name, look: Look::Marks(number), points });
        }
    }
    Plot { name, title: title.to_owned(), axes: [x, ERROR], series }
}

/// Error over voxel size by filter, with what theory has for smooth densities.
fn convergence(report: &Report) -> Plot {
    let mut series = Vec::new();
    for (number, filter) in ["nearest", "trilinear", "cubic"].into_iter().enumerate() {
        let points: Vec<Point> = ladder(&report.rows, filter)
            .into_iter()
            .filter_map(|row| {
                let error = row.field.as_ref()?.errors.l2.of_rms?;
                Some(Point { at: [row.settings.voxel_size, error], interval: held(row), label: None })
            })
            .collect();
        let order = report.orders.iter().find(|order| order.filter == filter && order.metric == "l2");
        let measured = order.and_then(|order| Some((order, order.measured?.order)));
        if let (Some((order, power)), Some(finest), Some(coarsest)) =
            (measured, points.first(), points.last())
        {
            let name = format!("{filter}, {power:.2}");
            // From the finest, as steep as theory has it.
            let theory = [finest.at[0], coarsest.at[0].min(3.0 * finest.at[0])].map(|size| Point {
                at: [size, finest.at[1] * libm::pow(size / finest.at[0], order.theory)],
                interval: None,
                label: None,
            });
            series.push(Series { name: String::new(), look: Look::Dashes, points: theory.to_vec() });
            series.push(Series { name, look: Look::Line(number), points });
        } else if !points.is_empty() {
            series.push(Series { name: filter.to_owned(), look: Look::Line(number), points });
        }
    }
    Plot {
        name: "convergence",
        title: "Error against voxel size, and its order".to_owned(),
        axes: [Axis { label: "voxel size in metres (dashed: theory)", format: words::metres }, ERROR],
        series,
    }
}

/// Error over time as octaves are left out.
fn octaves(report: &Report) -> Plot {
    let rows = report.rows.iter().filter(|row| row.kind == Kind::Bake);
    let mut rows: Vec<&Row> = rows.filter(|row| row.group == "octaves").chain(own(report)).collect();
    rows.sort_by_key(|row| row.settings.octaves.unwrap_or(u32::MAX));
    let points: Vec<Point> = rows
        .into_iter()
        .filter_map(|row| {
            let label = row.settings.octaves.map_or_else(|| "all".to_owned(), |octaves| octaves.to_string());
            let at = level(row)?;
            at.iter().all(|x| *x > 0.0).then_some(Point { at, interval: held(row), label: Some(label) })
        })
        .collect();
    // One alone tells nothing.
    let points = if points.len() > 1 { points } else { vec![] };
    Plot {
        name: "octaves",
        title: "What fewer octaves save".to_owned(),
        axes: [SECONDS, ERROR],
        series: vec![Series { name: "octaves".to_owned(), look: Look::Line(3), points }],
    }
}

/// Pictures: error over the time of a frame.
fn pictures(report: &Report) -> Plot {
    let mut series: Vec<Series> = Vec::new();
    for row in report.rows.iter().filter(|row| row.kind == Kind::Picture && row.is_own) {
        let Some(level) = level(row).filter(|level| level.iter().all(|x| *x > 0.0)) else { continue };
        let name =
            if row.settings.filter.is_some() { "baked" } else { row.settings.method.unwrap_or("other") };
        let point = Point { at: level, interval: held(row), label: None };
        match series.iter_mut().find(|series| series.name == name) {
            Some(series) => series.points.push(point),
            None => series.push(Series {
                name: name.to_owned(),
                look: Look::Marks(series.len()),
                points: vec![point],
            }),
        }
    }
    Plot {
        name: "pictures",
        title: "Error of a picture against its time".to_owned(),
        axes: [
            Axis { label: "seconds to march a picture", format: words::seconds },
            Axis { label: "relative error of the picture", format: words::part },
        ],
        series,
    }
}

/// Seconds and relative error.
fn level(row: &Row) -> Option<[f64; 2]> {
    row.level().map(|level| [level.seconds, level.error])
}
