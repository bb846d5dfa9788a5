//! `curve`: the points of a chain of Bezier segments.

use glam::DVec3;

use super::error::Fault;
use super::motion;
use super::reader::{Item, Reader, Words};
use crate::curve::{Curve, CurveError, FrameRule, Segment};

#[derive(Debug, Clone, Copy)]
enum Kind {
    Quadratic,
    Cubic,
}

impl Kind {
    fn name(self) -> &'static str {
        match self {
            Kind::Quadratic => "quadratic",
            Kind::Cubic => "cubic",
        }
    }

    /// Points from the start of one segment to the start of the next.
    fn step(self) -> usize {
        match self {
            Kind::Quadratic => 2,
            Kind::Cubic => 3,
        }
    }
}

static KINDS: Words<Kind> = Words {
    known: &[("quadratic", Kind::Quadratic), ("cubic", Kind::Cubic)],
    later: &["catmull-rom", "b-spline"],
    instead: "this version takes \"quadratic\" and \"cubic\" chains of Bezier segments",
};

/// The curve, where its points make one.
pub(super) fn curve(table: &Reader<'_>, frame: FrameRule) -> Option<Curve> {
    // A kind that is given and not understood must not be held against the number of points.
    let kind = match table.get("kind") {
        None => Some(Kind::Quadratic),
        Some(kind) => kind.word(&KINDS),
    };
    let Some(item) = table.get("points") else {
        // Without a kind that is read the points may be elsewhere, which has been said.
        if kind.is_some() {
            table.report(
                Fault::at(table.span(), "a curve without `points`")
                    .label("expected a key such as: points = [[0, 0, 0], [0, 0, 1], [0, 1, 1]]")
                    .absence(),
            );
        }
        return None;
    };
    let points = points(&item);
    let kind = kind?;
    check_count(&item, kind)?;
    let points = points?;
    let segments = match kind {
        Kind::Quadratic => chain(&points, Segment::quadratic),
        Kind::Cubic => chain(&points, Segment::cubic),
    };
    Curve::new(segments, frame).map_err(|error| item.report(unusable(error, &item, kind.step()))).ok()
}

/// The fault of points that are each sound, but make no curve, at the segment they fail to make.
fn unusable(error: CurveError, item: &Item<'_>, step: usize) -> Fault {
    let (segment, title, label) = match error {
        CurveError::ZeroLength { segment } => {
            (segment, "a segment without length", "expected points that do not all coincide".to_owned())
        }
        CurveError::Scale { segment, size } => (
            segment,
            "a segment of no usable size",
            format!("expected 1e-60 m to 1e60 m, found {size:.0e} m"),
        ),
        other => return Fault::at(item.span(), "unusable `points`").label(other.to_string()),
    };
    let items = item.array("points").unwrap_or_default();
    let span = match (items.get(segment * step), items.get((segment + 1) * step)) {
        (Some(first), Some(last)) => first.span().start..last.span().end,
        _ => item.span(),
    };
    Fault::at(span, title).label(label)
}

fn points(item: &Item<'_>) -> Option<Vec<DVec3>> {
    let items = item.array("an array of points [x, y, z]")?;
    let points: Vec<_> = items.iter().map(motion::point).collect();
    points.into_iter().collect()
}

/// Reports a number of points that no chain has.
fn check_count(item: &Item<'_>, kind: Kind) -> Option<()> {
    let count = item.array("an array of points [x, y, z]")?.len();
    let (name, step) = (kind.name(), kind.step());
    if count > step && count % step == 1 {
        return Some(());
    }
    let below = count.saturating_sub(1) / step * step + 1;
    let needed =
        if below > step { format!("{below} or {}", below + step) } else { format!("at least {}", step + 1) };
    item.report(
        Fault::at(item.span(), format!("wrong number of points for a {name} curve"))
            .label(format!("expected {needed}, found {count}"))
            .note(format!(
                "a {name} chain of n segments has {step} n + 1 points: each starts where the last ended"
            )),
    );
    None
}

/// Segments of N points, each starting at the last point of the one before.
fn chain<const N: usize>(points: &[DVec3], segment: fn([DVec3; N]) -> Segment) -> Vec<Segment> {
    points.windows(N).step_by(N - 1).filter_map(|points| points.try_into().ok()).map(segment).collect()
}
