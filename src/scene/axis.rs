//! `curve`: the points of a chain of Bezier segments or of a spline.

use std::ops::Range;

use glam::DVec3;

use super::error::Fault;
use super::input::Inputs;
use super::keys::CURVE;
use super::limit;
use super::motion;
use super::reader::{Item, Reader, Words};
use super::rows::rows;
use crate::curve::{Curve, CurveError, FrameRule, Segment, SplineError, b_spline, catmull_rom, coincide};

/// Points that a file may hold.
const MOST_POINTS: usize = 1_000_000;
/// Exponent of the knots' distances of a Catmull-Rom spline: centripetal.
const ALPHA: f64 = 0.5;

#[derive(Debug, Clone, Copy, PartialEq)]
enum Kind {
    Quadratic,
    Cubic,
    CatmullRom,
    BSpline,
}

impl Kind {
    fn name(self) -> &'static str {
        KINDS.known.iter().find(|(_, kind)| *kind == self).map_or("", |(name, _)| name)
    }

    /// Points from the start of one segment to the start of the next, of a chain.
    fn step(self) -> Option<usize> {
        match self {
            Kind::Quadratic => Some(2),
            Kind::Cubic => Some(3),
            Kind::CatmullRom | Kind::BSpline => None,
        }
    }
}

static KINDS: Words<Kind> = Words {
    known: &[
        ("quadratic", Kind::Quadratic),
        ("cubic", Kind::Cubic),
        ("catmull-rom", Kind::CatmullRom),
        ("b-spline", Kind::BSpline),
    ],
    later: &[],
    instead: "",
};

/// A tube's curve, and what is known of it even where it is none.
#[derive(Debug, Default)]
pub(super) struct Axis<'a> {
    pub(super) curve: Option<Curve>,
    /// The key that closes it, where it is closed.
    pub(super) closed: Option<Item<'a>>,
}

/// The curve of a tube, where its points make one.
pub(super) fn axis<'a>(tube: &Reader<'a>, frame: FrameRule, inputs: &Inputs<'_>) -> Axis<'a> {
    if tube.get("curve").is_none() {
        tube.report(
            Fault::at(tube.span(), "a tube without a `curve`")
                .label("expected a key such as: curve = { kind = \"quadratic\", points = [...] }")
                .absence(),
        );
    }
    let Some(table) = tube.table("curve", &CURVE) else { return Axis::default() };
    let closed = table.get("closed").filter(|closed| closed.boolean() == Some(true));
    Axis { curve: curve(&table, closed.is_some(), frame, inputs), closed }
}

fn curve(table: &Reader<'_>, closed: bool, frame: FrameRule, inputs: &Inputs<'_>) -> Option<Curve> {
    // A kind that is given and not understood must not be held against the number of points.
    let kind = match table.get("kind") {
        None => Some(Kind::Quadratic),
        Some(kind) => kind.word(&KINDS),
    };
    let alpha = alpha(table, kind);
    let points = points(table, kind.is_some(), inputs);
    let scale = scale(table);
    let (kind, points) = (kind?, scaled(points?, scale?)?);
    let segments = match kind.step() {
        Some(step) => links(&points, kind, step, closed)?,
        None => spline(&points, kind, alpha, closed)?,
    };
    let curve = if closed { Curve::closed(segments, frame) } else { Curve::new(segments, frame) };
    curve.map_err(|error| points.item.report(unusable(error, &points, kind))).ok()
}

/// The spline's knots, for the one kind that has a choice of them.
fn alpha(table: &Reader<'_>, kind: Option<Kind>) -> f64 {
    let Some(item) = table.get("alpha") else { return ALPHA };
    let alpha = item.number(&limit::FRACTION);
    if let (Some(kind), Some(span)) = (kind.filter(|kind| *kind != Kind::CatmullRom), table.key_span("alpha"))
    {
        table.report(
            Fault::at(span, format!("key `alpha` does not belong to a {} curve", kind.name()))
                .label("only to a catmull-rom one"),
        );
    }
    alpha.unwrap_or(ALPHA)
}

/// Points, and where they stand.
struct Points<'a> {
    points: Vec<DVec3>,
    item: Item<'a>,
    /// Where they are in the scene.
    items: Vec<Item<'a>>,
    /// Where they are in a file: its path, and the line of each.
    file: Option<(&'a str, Vec<usize>)>,
}

impl Points<'_> {
    /// A fault of some of the points.
    fn fault(&self, points: Range<usize>, title: &str, label: impl AsRef<str>) -> Fault {
        let (first, last) = (points.start, points.end.max(points.start + 1) - 1);
        let label = label.as_ref();
        if let Some((path, lines)) = &self.file {
            let place = match (lines.get(first), lines.get(last)) {
                (Some(first), Some(last)) if first < last => format!("{path}, lines {first} to {last}: "),
                (Some(line), _) => format!("{path}, line {line}: "),
                _ => format!("{path}: "),
            };
            return Fault::at(self.item.span(), title).label(place + label);
        }
        let span = match (self.items.get(first), self.items.get(last)) {
            (Some(first), Some(last)) => first.span().start..last.span().end,
            (Some(first), None) => first.span(),
            _ => self.item.span(),
        };
        Fault::at(span, title).label(label)
    }

    /// A fault of their number.
    fn miscounted(&self, title: String, found: usize, expected: &str) -> Fault {
        let label = match &self.file {
            Some((path, _)) => format!("expected {expected}, found {found} in {path}"),
            None => format!("expected {expected}, found {found}"),
        };
        Fault::at(self.item.span(), title).label(label)
    }
}

/// The points, from the scene or from a file. Where nothing is read yet that could say where they are, their absence is
/// reported.
fn points<'a>(table: &Reader<'a>, expected: bool, inputs: &Inputs<'_>) -> Option<Points<'a>> {
    match (table.get("points"), table.get("file")) {
        (Some(item), None) => inline(item),
        (None, Some(item)) => from_file(item, inputs),
        (Some(item), Some(file)) => {
            inline(item);
            if file.text().is_some() {
                table.report(
                    Fault::at(file.span(), "`points` and `file` contradict each other")
                        .label("give one of the two")
                        .related(item.span(), "`points` is given here"),
                );
            }
            None
        }
        (None, None) => {
            // Without a kind that is read the points may be elsewhere, which has been said.
            if expected {
                table.report(
                    Fault::at(table.span(), "a curve without `points`")
                        .label("expected a key such as: points = [[0, 0, 0], [0, 0, 1], [0, 1, 1]]")
                        .absence(),
                );
            }
            None
        }
    }
}

fn inline(item: Item<'_>) -> Option<Points<'_>> {
    let items = item.array("an array of points [x, y, z]")?;
    // Every point is read, so that each fault among them is found.
    let points: Vec<_> = items.iter().map(motion::point).collect();
    let points = points.into_iter().collect::<Option<_>>()?;
    Some(Points { points, item, items, file: None })
}

fn from_file<'a>(item: Item<'a>, inputs: &Inputs<'_>) -> Option<Points<'a>> {
    let (path, bytes) = inputs.read(&item)?;
    match rows(&bytes, "x,y,z", [&limit::ANY; 3], MOST_POINTS) {
        Ok(rows) => {
            let (lines, points) = rows.into_iter().map(|(line, row)| (line, DVec3::from_array(row))).unzip();
            Some(Points { points, item, items: vec![], file: Some((path, lines)) })
        }
        Err(error) => {
            item.report(Fault::at(item.span(), "malformed `file`").label(format!("{path}, {error}")));
            None
        }
    }
}

/// A factor, and the point about which points are scaled.
struct Scale<'a> {
    item: Item<'a>,
    factor: f64,
    centre: DVec3,
}

/// The scale; the outer `None` is a fault.
#[allow(clippy::option_option, reason = "a fault is not the absence of a scale")]
fn scale<'a>(table: &Reader<'a>) -> Option<Option<Scale<'a>>> {
    let (item, about) = (table.get("scale"), table.get("about"));
    let factor = item.map(|item| item.number(&limit::POSITIVE));
    let centre = about.map_or(Some([0.0; 3]), |about| about.vector(&limit::ANY));
    if let (None, Some(about), true) = (item, about, centre.is_some()) {
        table.report(
            Fault::at(about.span(), "`about` without `scale`")
                .label("nothing is scaled about it: give `scale` too"),
        );
        return None;
    }
    let centre = DVec3::from_array(centre?);
    let Some(item) = item else { return Some(None) };
    Some(Some(Scale { item, factor: factor??, centre }))
}

/// The points after scaling.
fn scaled<'a>(mut points: Points<'a>, scale: Option<Scale<'_>>) -> Option<Points<'a>> {
    let Some(Scale { item, factor, centre }) = scale.filter(|scale| scale.factor != 1.0) else {
        return Some(points);
    };
    for point in &mut points.points {
        *point = centre + factor * (*point - centre);
    }
    let inside = |point: &DVec3| point.to_array().into_iter().all(|x| limit::ANY.admits(x));
    if !points.points.iter().all(inside) {
        item.report(
            Fault::at(item.span(), "`scale` leads out of range")
                .label(format!("expected points with every coordinate {}", limit::ANY.range)),
        );
        return None;
    }
    Some(points)
}

/// The segments of a chain.
fn links(points: &Points<'_>, kind: Kind, step: usize, closed: bool) -> Option<Vec<Segment>> {
    check_count(points, kind, step, closed)?;
    let mut all = points.points.clone();
    if closed && all.len().is_multiple_of(step) {
        all.extend(all.first().copied());
    }
    Some(match kind {
        Kind::Quadratic => chain(&all, Segment::quadratic),
        _ => chain(&all, Segment::cubic),
    })
}

/// Segments of N points, each starting at the last point of the one before.
fn chain<const N: usize>(points: &[DVec3], segment: fn([DVec3; N]) -> Segment) -> Vec<Segment> {
    points.windows(N).step_by(N - 1).filter_map(|points| points.try_into().ok()).map(segment).collect()
}

/// Reports a number of points that no chain has.
fn check_count(points: &Points<'_>, kind: Kind, step: usize, closed: bool) -> Option<()> {
    let (count, name) = (points.points.len(), kind.name());
    let least = if closed { step } else { step + 1 };
    if count >= least && (count % step == 1 || closed && count.is_multiple_of(step)) {
        return Some(());
    }
    let below = count.saturating_sub(1) / step * step + 1;
    let needed =
        if count < least { format!("at least {least}") } else { format!("{below} or {}", below + step) };
    let (needed, note) = if closed {
        // Only a number between step n + 1 and step (n + 1) is wrong.
        let needed = if count < least { needed } else { format!("{below} or {}", below + step - 1) };
        let note = format!(
            "a closed {name} chain of n segments has {step} n points, the first of which closes it, or {step} n + 1"
        );
        (needed, note)
    } else {
        let note =
            format!("a {name} chain of n segments has {step} n + 1 points: each starts where the last ended");
        (needed, note)
    };
    points.item.report(
        points.miscounted(format!("wrong number of points for a {name} curve"), count, &needed).note(note),
    );
    None
}

/// The segments of a spline.
fn spline(points: &Points<'_>, kind: Kind, alpha: f64, closed: bool) -> Option<Vec<Segment>> {
    let mut all = points.points.as_slice();
    // The first point may be given again to close the curve, as for chains.
    let mut given_again = false;
    if let (true, [others @ .., last]) = (closed, all)
        && let Some(first) = others.first()
        && coincide(*first, *last)
    {
        given_again = true;
        all = others;
    }
    let segments = match kind {
        Kind::CatmullRom => catmull_rom(all, alpha, closed),
        _ => b_spline(all, closed),
    };
    let name = kind.name();
    let report = |error| match error {
        SplineError::TooFew { least, .. } => {
            let closed = if closed { "closed " } else { "" };
            let title = format!("wrong number of points for a {closed}{name} curve");
            let fault = points.miscounted(title, all.len(), &format!("at least {least}"));
            if given_again {
                fault.note("the last point is the first again, which counts once: leave it out")
            } else {
                fault
            }
        }
        SplineError::Coincident { point } => points.fault(
            point..point + 1,
            &format!("two points of a {name} curve in one place"),
            format!("point {} lies on the one before it", point + 1),
        ),
    };
    segments.map_err(|error| points.item.report(report(error))).ok()
}

/// The fault of points that are each sound, but make no curve, at the segment they fail to make.
fn unusable(error: CurveError, points: &Points<'_>, kind: Kind) -> Fault {
    let (segment, title, label) = match error {
        CurveError::ZeroLength { segment } => {
            (segment, "a segment without length", "expected points that do not all coincide".to_owned())
        }
        CurveError::Scale { segment, size } => (
            segment,
            "a segment of no usable size",
            format!("expected 1e-60 m to 1e60 m, found {size:.0e} m"),
        ),
        CurveError::Open { size } => {
            let last = points.points.len().saturating_sub(1);
            let label = format!("the last point is {size:.3e} m away from the first");
            return points
                .fault(last..last + 1, "a gap in a closed curve", label)
                .note("a closed curve ends in its first point: repeat that, or leave the last point off");
        }
        other => return Fault::at(points.item.span(), "unusable `points`").label(other.to_string()),
    };
    let step = kind.step().unwrap_or(1);
    points.fault(segment * step..(segment + 1) * step + 1, title, label)
}
