//! Plots: one description, drawn as SVG or as PNG.

use std::ops::Range;
use std::sync::Once;

use plotters::backend::BitMapBackend;
use plotters::chart::{ChartBuilder, ChartContext};
use plotters::coord::Shift;
use plotters::coord::cartesian::Cartesian2d;
use plotters::coord::ranged1d::{KeyPointHint, NoDefaultFormatting, Ranged, ValueFormatter};
use plotters::element::{Circle, EmptyElement, ErrorBar, PathElement, Polygon, Rectangle, Text};
use plotters::prelude::{DrawingArea, DrawingBackend, IntoDrawingArea, SVGBackend};
use plotters::series::{DashedLineSeries, LineSeries};
use plotters::style::text_anchor::{HPos, Pos, VPos};
use plotters::style::{Color, FontStyle, IntoFont, RGBColor, ShapeStyle, TextStyle, register_font};

/// Pixels of a plot; a PNG has twice as many.
pub(crate) const SIZE: [u32; 2] = [480, 360];
/// Height of letters, in pixels.
const LETTERS: f64 = 15.0;

/// From a mark to its name.
const BESIDE: f64 = 9.0;

/// Ink, and lines that only help the eye.
pub(crate) static INK: RGBColor = RGBColor(0x20, 0x21, 0x24);
pub(crate) static FAINT: RGBColor = RGBColor(0xd4, 0xd6, 0xda);
/// Colours that people with any sight of colours tell apart (Okabe and Ito 2008).
pub(crate) static COLOURS: [RGBColor; 6] = [
    RGBColor(0x00, 0x72, 0xb2),
    RGBColor(0xd5, 0x5e, 0x00),
    RGBColor(0x00, 0x9e, 0x73),
    RGBColor(0xcc, 0x79, 0xa7),
    RGBColor(0xe6, 0x9f, 0x00),
    RGBColor(0x56, 0xb4, 0xe9),
];

/// What can go wrong while a plot is drawn: nothing that its figures bring about.
#[derive(Debug, thiserror::Error)]
#[error("cannot draw a plot: {0}")]
pub struct PlotError(String);

/// A plot of logarithmic axes.
#[derive(Debug, Clone)]
pub(crate) struct Plot {
    /// A word for file names.
    pub(crate) name: &'static str,
    pub(crate) title: String,
    /// Along x and y.
    pub(crate) axes: [Axis; 2],
    pub(crate) series: Vec<Series>,
}

#[derive(Debug, Clone)]
pub(crate) struct Axis {
    pub(crate) label: &'static str,
    /// A number on the axis in words.
    pub(crate) format: fn(f64) -> String,
}

/// Points of one kind.
#[derive(Debug, Clone)]
pub(crate) struct Series {
    pub(crate) name: String,
    pub(crate) look: Look,
    pub(crate) points: Vec<Point>,
}

/// How a series looks.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Look {
    /// Marks of kind and colour number n.
    Marks(usize),
    /// The same, joined by a line.
    Line(usize),
    /// A dashed line: theory, or a limit.
    Dashes,
}

#[derive(Debug, Clone)]
pub(crate) struct Point {
    pub(crate) at: [f64; 2],
    /// Of y.
    pub(crate) interval: Option<[f64; 2]>,
    pub(crate) label: Option<String>,
}

/// A logarithmic axis whose marks are at 1, 2 and 5 times powers of ten.
#[derive(Debug, Clone)]
struct Log {
    range: Range<f64>,
    format: fn(f64) -> String,
}

impl Log {
    /// Around values, with some room; any where there are none.
    fn around(values: impl Iterator<Item = f64>, room: [f64; 2], format: fn(f64) -> String) -> Log {
        let (mut low, mut high) = (f64::INFINITY, 0.0_f64);
        for value in values.filter(|value| *value > 0.0 && value.is_finite()) {
            (low, high) = (low.min(value), high.max(value));
        }
        if low > high {
            (low, high) = (0.1, 10.0);
        }
        // A range of less than a factor of 3 has too few marks.
        let widen = (3.0 / (high / low)).max(1.0).sqrt();
        let span = libm::log(high / low).max(libm::log(3.0));
        let out = room.map(|part| libm::exp(part * span));
        Log { range: low / widen / out[0]..high * widen * out[1], format }
    }
}

impl Ranged for Log {
    type FormatOption = NoDefaultFormatting;
    type ValueType = f64;

    fn map(&self, value: &f64, limit: (i32, i32)) -> i32 {
        let part =
            libm::log(value.max(1e-300) / self.range.start) / libm::log(self.range.end / self.range.start);
        let length = f64::from(limit.1 - limit.0);
        #[allow(clippy::cast_possible_truncation, reason = "pixels")]
        let shift = (part.clamp(-10.0, 10.0) * length).round() as i32;
        limit.0 + shift
    }

    fn key_points<H: KeyPointHint>(&self, hint: H) -> Vec<f64> {
        // At parts of every so many powers of ten.
        let marks = |(steps, stride): (&[f64], f64)| -> Vec<f64> {
            let mut exponent = (libm::log10(self.range.start) / stride).floor() * stride;
            let mut found = Vec::new();
            while exponent <= libm::log10(self.range.end) && found.len() < 100 {
                let power = libm::exp10(exponent);
                found.extend(steps.iter().map(|step| step * power).filter(|mark| self.range.contains(mark)));
                exponent += stride;
            }
            found
        };
        let most = hint.max_num_points();
        let coarse = [1.0, 2.0, 3.0, 6.0, 12.0, 24.0].map(|stride| (&[1.0][..], stride));
        [(&[1.0, 2.0, 5.0][..], 1.0), (&[1.0, 3.0], 1.0)]
            .into_iter()
            .chain(coarse)
            .map(marks)
            .find(|found| found.len() <= most)
            .unwrap_or_default()
    }

    fn range(&self) -> Range<f64> {
        self.range.clone()
    }
}

impl ValueFormatter<f64> for Log {
    fn format_ext(&self, value: &f64) -> String {
        (self.format)(*value)
    }
}

type Chart<'a, 'b, B> = ChartContext<'a, B, Cartesian2d<Log, Log>>;

impl Plot {
    /// As SVG; `background` is for where it stands alone.
    ///
    /// # Errors
    ///
    /// [`PlotError`].
    pub(crate) fn svg(&self, background: bool) -> Result<String, PlotError> {
        let mut text = String::new();
        {
            let root = SVGBackend::with_string(&mut text, (SIZE[0], SIZE[1])).into_drawing_area();
            self.draw(&root, 1.0, background)?;
            root.present().map_err(failed)?;
        }
        Ok(text)
    }

    /// As a part of a page, with its title for those who do not see it.
    ///
    /// # Errors
    ///
    /// [`PlotError`].
    pub(crate) fn figure(&self) -> Result<String, PlotError> {
        let opening = format!("<svg role=\"img\" aria-label=\"{}\" ", self.title);
        Ok(self.svg(false)?.replacen("<svg ", &opening, 1))
    }

    /// As rows of red, green and blue, twice as large.
    ///
    /// # Errors
    ///
    /// [`PlotError`].
    pub(crate) fn pixels(&self) -> Result<([u32; 2], Vec<u8>), PlotError> {
        let size = SIZE.map(|edge| 2 * edge);
        let mut pixels = vec![0; size[0] as usize * size[1] as usize * 3];
        {
            let root = BitMapBackend::with_buffer(&mut pixels, (size[0], size[1])).into_drawing_area();
            self.draw(&root, 2.0, true)?;
            root.present().map_err(failed)?;
        }
        Ok((size, pixels))
    }

    fn draw<B: DrawingBackend>(
        &self,
        root: &DrawingArea<B, Shift>,
        scale: f64,
        background: bool,
    ) -> Result<(), PlotError> {
        static FONT: Once = Once::new();
        FONT.call_once(|| {
            // It is a font.
            let _ = register_font("sans-serif", FontStyle::Normal, dejavu::sans::regular());
        });
        if background {
            root.fill(&RGBColor(255, 255, 255)).map_err(failed)?;
        }
        let pen = Pen { scale };
        let all = || self.series.iter().flat_map(|series| &series.points);
        let [x, y] = &self.axes;
        let xs = Log::around(all().map(|point| point.at[0]), [0.06, self.room()], x.format);
        let heights = all().flat_map(|point| {
            [Some(point.at[1]), point.interval.map(|i| i[0]), point.interval.map(|i| i[1])]
        });
        let ys = Log::around(heights.flatten(), [0.08, 0.08], y.format);
        let mut chart = ChartBuilder::on(root)
            .margin(pen.pixels(8.0))
            .margin_right(pen.pixels(24.0))
            .caption(&self.title, pen.text(LETTERS + 2.0, &INK))
            .x_label_area_size(pen.pixels(44.0))
            .y_label_area_size(pen.pixels(66.0))
            .build_cartesian_2d(xs, ys)
            .map_err(failed)?;
        chart
            .configure_mesh()
            .light_line_style(RGBColor(0, 0, 0).mix(0.0))
            .bold_line_style(pen.line(&FAINT, 1.0))
            .axis_style(pen.line(&INK, 1.0))
            .label_style(pen.text(LETTERS - 1.0, &INK))
            .axis_desc_style(pen.text(LETTERS, &INK))
            .x_desc(x.label)
            .y_desc(y.label)
            .x_labels(6)
            .y_labels(8)
            .draw()
            .map_err(failed)?;
        for series in &self.series {
            series.draw(&mut chart, pen)?;
        }
        self.label_points(&mut chart, pen)?;
        self.name_series(&mut chart, pen)
    }

    /// Writes the points' labels beside them, each where it is on nothing else, or on the least.
    fn label_points<B: DrawingBackend>(
        &self,
        chart: &mut Chart<'_, '_, B>,
        pen: Pen,
    ) -> Result<(), PlotError> {
        /// Directions from a mark, the best first.
        const AROUND: [[f64; 2]; 8] = [
            [0.0, 1.0],
            [0.0, -1.0],
            [1.0, 0.0],
            [-1.0, 0.0],
            [0.8, 0.8],
            [-0.8, 0.8],
            [0.8, -0.8],
            [-0.8, -0.8],
        ];
        const HEIGHT: f64 = LETTERS - 3.0;
        let area = chart.plotting_area();
        let place = |at: [f64; 2]| {
            let (x, y) = area.map_coordinate(&(at[0], at[1]));
            [f64::from(x), f64::from(y)]
        };
        let (columns, rows) = area.get_pixel_range();
        let [columns, rows] = [columns, rows].map(|range| f64::from(range.start)..f64::from(range.end));
        let scale = pen.scale;
        let mut taken: Vec<Label> = Vec::new();
        for series in &self.series {
            let places: Vec<[f64; 2]> = series.points.iter().map(|point| place(point.at)).collect();
            taken.extend(places.iter().map(|at| Label { at: *at, half: [6.0 * scale; 2] }));
            // A line is as good as a row of dots on it.
            if !matches!(series.look, Look::Marks(_)) {
                for pair in places.windows(2) {
                    let on =
                        |part: f64| [0, 1].map(|axis| pair[0][axis] + part * (pair[1][axis] - pair[0][axis]));
                    taken.extend((1..32).map(|n| Label { at: on(f64::from(n) / 32.0), half: [scale; 2] }));
                }
            }
            for point in &series.points {
                if let Some([low, high]) = point.interval {
                    let [a, b] = [low, high].map(|y| place([point.at[0], y]));
                    let half = [3.0 * scale, 0.5 * (a[1] - b[1]).abs()];
                    taken.push(Label { at: [a[0], 0.5 * (a[1] + b[1])], half });
                }
            }
            if let Some(last) =
                places.iter().max_by(|a, b| a[0].total_cmp(&b[0])).filter(|_| !series.name.is_empty())
            {
                let half = [0.5 * width(&series.name) * scale, 0.5 * LETTERS * scale];
                taken.push(Label { at: [last[0] + BESIDE * scale + half[0], last[1]], half });
            }
        }
        let mut labels = Vec::new();
        for point in self.series.iter().flat_map(|series| &series.points) {
            let Some(text) = &point.label else { continue };
            let at = place(point.at);
            let half = [0.5 * width(text) * scale * HEIGHT / LETTERS, 0.5 * HEIGHT * scale];
            let beside = |[x, y]: [f64; 2], far: f64| {
                let from = [half[0] + far, half[1] + far];
                Label { at: [at[0] + x * from[0], at[1] + y * from[1]], half }
            };
            let all = [7.0, 16.0, 26.0].into_iter().flat_map(|far| AROUND.map(|to| beside(to, far * scale)));
            let is_inside = |label: &Label| {
                (0..2).all(|axis| {
                    let range = if axis == 0 { &columns } else { &rows };
                    label.at[axis] - label.half[axis] >= range.start
                        && label.at[axis] + label.half[axis] <= range.end
                })
            };
            let covered = |label: &Label| taken.iter().map(|other| label.shared(other)).sum::<f64>();
            let best = all
                .filter(is_inside)
                .map(|label| (covered(&label), label))
                // The first of those that are alike.
                .reduce(|best, other| if other.0 < best.0 { other } else { best });
            if let Some((_, label)) = best {
                taken.push(label);
                labels.push((label, text));
            }
        }
        let area = area.strip_coord_spec();
        let (left, top) = area.get_base_pixel();
        for (label, text) in labels {
            let style = pen.text(HEIGHT, &INK).pos(Pos::new(HPos::Center, VPos::Center));
            #[allow(clippy::cast_possible_truncation, reason = "pixels")]
            let [x, y] = label.at.map(|c| c.round() as i32);
            area.draw(&Text::new(text.clone(), (x - left, y - top), style)).map_err(failed)?;
        }
        Ok(())
    }

    /// Room for the longest name beside the last of all points, over the length of the axis without it.
    fn room(&self) -> f64 {
        /// Pixels of the axis, and its length over that of the points' range without the names.
        const AXIS: f64 = 378.0;
        const LEFT: f64 = 1.06;
        let longest = self.series.iter().map(|series| width(&series.name)).fold(0.0, f64::max) + 2.0 * BESIDE;
        LEFT * longest / (AXIS - longest).max(1.0)
    }

    /// Each series' name beside its last point, none over another.
    fn name_series<B: DrawingBackend>(
        &self,
        chart: &mut Chart<'_, '_, B>,
        pen: Pen,
    ) -> Result<(), PlotError> {
        let area = chart.plotting_area();
        let place = |point: &Point| area.map_coordinate(&(point.at[0], point.at[1]));
        let mut names: Vec<(i32, i32, &Series)> = Vec::new();
        for series in self.series.iter().filter(|series| !series.name.is_empty()) {
            if let Some((x, y)) = series.points.iter().map(place).max_by_key(|(x, _)| *x) {
                names.push((x, y, series));
            }
        }
        names.sort_by_key(|(_, y, _)| *y);
        let (columns, rows) = area.get_pixel_range();
        let height = pen.length(LETTERS + 3.0);
        let mut free = rows.start + height / 2;
        for (x, y, _) in &mut names {
            *y = (*y).max(free);
            free = *y + height;
            *x += pen.length(BESIDE);
        }
        // Those pushed out below move up again.
        let mut last = rows.end - height / 2;
        for (_, y, _) in names.iter_mut().rev() {
            *y = (*y).min(last);
            last = *y - height;
        }
        let area = area.strip_coord_spec();
        let (left, top) = area.get_base_pixel();
        for (x, y, series) in names {
            let is_left = x + pen.length(width(&series.name)) > columns.end;
            let horizontal = if is_left { HPos::Right } else { HPos::Left };
            let style = pen.text(LETTERS - 1.0, series.look.colour()).pos(Pos::new(horizontal, VPos::Center));
            let x = if is_left { x - 2 * pen.length(BESIDE) } else { x };
            area.draw(&Text::new(series.name.clone(), (x - left, y - top), style)).map_err(failed)?;
        }
        Ok(())
    }
}

impl Series {
    fn draw<B: DrawingBackend>(&self, chart: &mut Chart<'_, '_, B>, pen: Pen) -> Result<(), PlotError> {
        let colour = self.look.colour();
        let places = || self.points.iter().map(|point| (point.at[0], point.at[1]));
        match self.look {
            Look::Dashes => {
                let gap = pen.length(4.0);
                let line = DashedLineSeries::new(places(), gap, gap, pen.line(colour, 1.2));
                chart.draw_series(line).map_err(failed)?;
                return Ok(());
            }
            Look::Line(_) => {
                chart.draw_series(LineSeries::new(places(), pen.line(colour, 1.5))).map_err(failed)?;
            }
            Look::Marks(_) => {}
        }
        let bars = self.points.iter().filter_map(|point| {
            let [low, high] = point.interval?;
            Some(ErrorBar::new_vertical(
                point.at[0],
                low,
                point.at[1],
                high,
                pen.line(colour, 1.0),
                pen.pixels(5.0),
            ))
        });
        chart.draw_series(bars).map_err(failed)?;
        let shape = self.look.shape();
        for point in &self.points {
            let at = (point.at[0], point.at[1]);
            let r = pen.length(4.0);
            let fill = ShapeStyle::from(colour).filled();
            let line = pen.line(colour, 2.0);
            match shape {
                0 => chart.draw_series([EmptyElement::at(at) + Circle::new((0, 0), r, fill)]).map(drop),
                1 => chart
                    .draw_series([EmptyElement::at(at) + Rectangle::new([(-r, -r), (r, r)], fill)])
                    .map(drop),
                2 => chart
                    .draw_series([
                        EmptyElement::at(at) + Polygon::new(vec![(-r - 1, r), (r + 1, r), (0, -r - 1)], fill)
                    ])
                    .map(drop),
                3 => chart
                    .draw_series([EmptyElement::at(at)
                        + PathElement::new(vec![(-r, -r), (r, r)], line)
                        + PathElement::new(vec![(-r, r), (r, -r)], line)])
                    .map(drop),
                4 => chart
                    .draw_series([EmptyElement::at(at)
                        + Polygon::new(vec![(0, -r - 1), (r + 1, 0), (0, r + 1), (-r - 1, 0)], fill)])
                    .map(drop),
                _ => chart
                    .draw_series([EmptyElement::at(at) + Circle::new((0, 0), r, pen.line(colour, 1.5))])
                    .map(drop),
            }
            .map_err(failed)?;
        }
        Ok(())
    }
}

impl Look {
    fn shape(self) -> usize {
        match self {
            Look::Marks(n) | Look::Line(n) => n % COLOURS.len(),
            Look::Dashes => 0,
        }
    }

    fn colour(self) -> &'static RGBColor {
        match self {
            Look::Marks(n) | Look::Line(n) => &COLOURS[n % COLOURS.len()],
            Look::Dashes => &INK,
        }
    }
}

/// A box that letters or marks take, in pixels.
#[derive(Debug, Clone, Copy)]
struct Label {
    /// Its middle.
    at: [f64; 2],
    /// Half of its edges.
    half: [f64; 2],
}

impl Label {
    /// Pixels that two boxes share.
    fn shared(&self, other: &Label) -> f64 {
        let along = |axis: usize| {
            let reach = self.half[axis] + other.half[axis] - (self.at[axis] - other.at[axis]).abs();
            reach.clamp(0.0, 2.0 * self.half[axis].min(other.half[axis]))
        };
        along(0) * along(1)
    }
}

/// Sizes on paper.
#[derive(Debug, Clone, Copy)]
struct Pen {
    scale: f64,
}

impl Pen {
    #[allow(clippy::cast_possible_truncation, reason = "small")]
    fn length(self, pixels: f64) -> i32 {
        (pixels * self.scale).round() as i32
    }

    fn pixels(self, pixels: f64) -> u32 {
        self.length(pixels).unsigned_abs()
    }

    fn line(self, colour: &RGBColor, width: f64) -> ShapeStyle {
        ShapeStyle::from(colour).stroke_width(self.pixels(width).max(1))
    }

    fn text(self, height: f64, colour: &'static RGBColor) -> TextStyle<'static> {
        TextStyle::from(("sans-serif", height * self.scale).into_font()).color(colour)
    }
}

/// Pixels of a line of letters, about.
#[allow(clippy::cast_precision_loss, reason = "few letters")]
fn width(text: &str) -> f64 {
    0.55 * LETTERS * text.chars().count() as f64
}

fn failed(error: impl std::fmt::Display) -> PlotError {
    PlotError(error.to_string())
}
