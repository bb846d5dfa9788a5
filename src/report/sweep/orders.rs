//! With which powers of the voxel size errors fall.

use super::OrderOf;
use super::bakes::{FILTERS, filter_name};
use super::rows::Row;
use crate::report::order::Order;
use crate::volume::Filter;

/// Voxels that miss more of the density than this do not follow it yet: errors end at all of it, whatever the size.
const RESOLVED: f64 = 0.25;
/// Times the finest voxel that still are of its range.
const FAR: f64 = 4.0;
/// Fewer sizes tell nothing of how well they follow a power.
const FEWEST: usize = 3;
/// Times the error of single precision that an error by the voxels is at least.
const CLEAR: f64 = 10.0;
/// Errors that fall with less than this fall with no power.
const LEAST: f64 = 0.05;

/// Orders for each filter and metric; `rounding` is the relative error of single precision, which no voxel size mends.
pub(super) fn orders(rows: &[Row], rounding: f64) -> Vec<OrderOf> {
    let mut found = Vec::new();
    for filter in FILTERS {
        let name = filter_name(filter);
        let of: Vec<&Row> = (rows.iter())
            .filter(|row| row.group == "voxel size and filter" && row.settings.filter == Some(name))
            .collect();
        let theory = match filter {
            Filter::Nearest => 1.0,
            Filter::Trilinear => 2.0,
            Filter::Cubic => 3.0,
        };
        for metric in ["l1", "l2", "max", "optical-depth"] {
            let error = |row: &Row| {
                let field = row.field.as_ref()?;
                match metric {
                    "l1" => field.errors.l1.of_rms,
                    "l2" => field.errors.l2.of_rms,
                    "max" => field.errors.max.of_peak,
                    _ => field.optical_depth,
                }
            };
            let points: Vec<[f64; 2]> =
                of.iter().filter_map(|row| Some([row.settings.voxel_size, error(row)?])).collect();
            if !points.is_empty() {
                let (measured, voxel_sizes, why) = fit(points, CLEAR * rounding);
                found.push(OrderOf { filter: name, metric, measured, voxel_sizes, why, theory });
            }
        }
    }
    found
}

/// The order over the sizes where errors follow a power, these sizes from the finest, and why these or none.
fn fit(mut points: Vec<[f64; 2]>, floor: f64) -> (Option<Order>, Vec<f64>, String) {
    points.sort_unstable_by(|a, b| a[0].total_cmp(&b[0]));
    let none = |why: String| (None, vec![], why);
    let all = points.len();
    points.retain(|[_, error]| *error <= RESOLVED);
    let resolved = points.len();
    points.retain(|[_, error]| *error > floor);
    if resolved > points.len() && points.len() < FEWEST {
        return none("errors are no larger than those of single precision".to_owned());
    }
    let finest = points.first().map_or(0.0, |point| point[0]);
    points.retain(|[size, _]| *size <= FAR * finest * (1.0 + 1e-9));
    if points.len() < FEWEST {
        return none(format!(
            "of {all} voxel sizes {} the density to {:.0} %, and {FEWEST} are needed: smaller voxels would tell",
            match points.len() {
                0 => "none shows".to_owned(),
                1 => "one shows".to_owned(),
                some => format!("{some} show"),
            },
            100.0 * RESOLVED
        ));
    }
    let order = Order::fit(&points);
    match order.filter(|order| order.order >= LEAST) {
        Some(order) => {
            let sizes = points.iter().map(|point| point[0]).collect();
            let why =
                format!("all up to {FAR} times the finest that are off by {:.0} % or less", 100.0 * RESOLVED);
            (Some(order), sizes, why)
        }
        None => none("the error does not fall with the voxel size".to_owned()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZES: [f64; 6] = [0.04, 0.01, 0.014, 0.02, 0.08, 0.028];

    #[test]
    fn orders_are_those_of_the_range_that_follows_a_power() {
        // Of second order below a tenth, and ends at all of the density.
        let error = |h: f64| (400.0 * h * h).min(0.9);
        let (order, sizes, why) = fit(SIZES.map(|h| [h, error(h)]).to_vec(), 0.0);
        assert!(order.is_some_and(|order| (order.order - 2.0).abs() < 1e-9), "{order:?}");
        assert_eq!(sizes, [0.01, 0.014, 0.02]);
        assert_eq!(why, "all up to 4 times the finest that are off by 25 % or less");
        // No farther than four times the finest.
        let (order, sizes, _) = fit(SIZES.map(|h| [h, 2.0 * h]).to_vec(), 0.0);
        assert!(order.is_some_and(|order| (order.order - 1.0).abs() < 1e-9));
        assert_eq!(sizes, [0.01, 0.014, 0.02, 0.028, 0.04]);
    }

    #[test]
    fn orders_that_cannot_be_told_have_a_reason() {
        let why = |error: fn(f64) -> f64, floor: f64| {
            let (order, sizes, why) = fit(SIZES.map(|h| [h, error(h)]).to_vec(), floor);
            assert!(order.is_none() && sizes.is_empty(), "{order:?}");
            why
        };
        assert_eq!(
            why(|h| (1500.0 * h * h).min(1.0), 0.0),
            "of 6 voxel sizes one shows the density to 25 %, and 3 are needed: smaller voxels would tell"
        );
        assert!(why(|_| 0.95, 0.0).starts_with("of 6 voxel sizes none shows"));
        assert_eq!(why(|_| 0.2, 0.0), "the error does not fall with the voxel size");
        assert_eq!(why(|h| 1e-3 * h * h, 1e-5), "errors are no larger than those of single precision");
    }
}
