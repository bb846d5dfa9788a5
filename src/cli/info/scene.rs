//! What a scene holds.

use serde::Serialize;

use super::view::View;
use crate::cli::job::{bounds, dimensions, voxel_size};
use crate::cli::recipe::antialias_name;
use crate::cli::text;
use crate::field::Field;
use crate::scene::{Caps, Input, Layer, Op, Pattern, Scene, SceneErrors, Tube};

/// As `--json` prints it.
#[derive(Debug, Serialize)]
pub(super) struct Report {
    kind: &'static str,
    name: String,
    /// Corners of the box around the density at the start frame, in metres.
    bounds: Option<[[f64; 3]; 2]>,
    voxel_size: f64,
    /// Voxels along each side of that box.
    dimensions: [u64; 3],
    cutoff: f64,
    octave_fade: bool,
    antialias: &'static str,
    fps: f64,
    start: i64,
    end: Option<i64>,
    tubes: Vec<TubeReport>,
    lights: usize,
    /// Files that the scene names.
    inputs: Vec<InputReport>,
    /// What is hardly meant, each with its line and column.
    warnings: Vec<String>,
    /// What another renderer needs.
    pub(super) view: Option<View>,
}

#[derive(Debug, Serialize)]
struct InputReport {
    path: String,
    sha256: String,
}

#[derive(Debug, Serialize)]
struct TubeReport {
    name: String,
    segments: usize,
    /// Metres.
    length: f64,
    closed: bool,
    /// Angle in radians by which a closed curve's frame would arrive turned, and is turned back over the length.
    holonomy: f64,
    /// Joints where the tangent turns by more than a degree.
    corners: usize,
    /// Smallest and largest, in metres.
    radius: [f64; 2],
    /// Where the radius is read from a file: metres that it may be off between its samples.
    radius_sampling_error: Option<f64>,
    /// Turns from end to end.
    twist: f64,
    /// Turns a second at the start frame.
    spin: f64,
    caps: &'static str,
    layers: Vec<String>,
}

/// Describes.
pub(super) fn describe(scene: &Scene) -> Result<Report, SceneErrors> {
    let field = Field::compile(scene);
    let bounds = bounds(&field);
    let (bake, time) = (scene.bake(), scene.time());
    let voxel_size = voxel_size(bake.step, scene, &field)?;
    Ok(Report {
        kind: "scene",
        name: scene.name().to_owned(),
        bounds,
        voxel_size,
        dimensions: dimensions(bounds, voxel_size),
        cutoff: bake.cutoff,
        octave_fade: bake.octave_fade,
        antialias: antialias_name(bake.antialias),
        fps: time.fps,
        start: time.start,
        end: time.end,
        tubes: scene.tubes().iter().map(tube).collect(),
        lights: scene.lights().len(),
        inputs: scene.inputs().iter().map(input).collect(),
        warnings: text::warnings(scene.warnings()),
        view: None,
    })
}

fn input(input: &Input) -> InputReport {
    InputReport { path: input.path.clone(), sha256: text::hexadecimal(&input.sha256) }
}

fn tube(tube: &Tube) -> TubeReport {
    /// Radians.
    const CORNER: f64 = 1.0 / 180.0 * std::f64::consts::PI;
    let (least, largest) = tube.radius.range(0.0, 1.0);
    let segments = tube.curve.segments().len();
    TubeReport {
        name: tube.name.clone(),
        segments,
        length: tube.curve.length(),
        closed: tube.curve.is_closed(),
        holonomy: tube.curve.holonomy(),
        corners: (0..segments).filter(|joint| tube.curve.turn(*joint) > CORNER).count(),
        radius: [least, largest],
        radius_sampling_error: tube.sampling_error,
        twist: tube.twist,
        spin: tube.spin,
        caps: match tube.caps {
            _ if tube.curve.is_closed() => "none",
            Caps::Flat => "flat",
            Caps::Fade(_) => "fade",
            Caps::Round => "round",
        },
        layers: tube.layers.iter().map(layer).collect(),
    }
}

fn layer(layer: &Layer) -> String {
    let op = match layer.op {
        Op::Multiply => "multiply",
        Op::Add => "add",
        Op::Max => "max",
        Op::Min => "min",
    };
    match &layer.pattern {
        Pattern::Constant(value) => format!("{op} constant {value}"),
        Pattern::Sectors => format!("{op} sectors"),
        Pattern::Perlin(fbm) => format!("{op} perlin of {}", text::number(u64::from(fbm.octaves), "octave")),
    }
}

/// For people.
pub(super) fn human(report: &Report) -> String {
    let mut table = text::Table::default();
    table.heading(format!("{}: a scene of {}", report.name, text::number(report.tubes.len() as u64, "tube")));
    table.row("bounds", text::bounds(report.bounds));
    table.row("voxel size", text::voxels(report.voxel_size, report.dimensions));
    if let Some(end) = report.end {
        let (start, fps) = (report.start, text::short(report.fps));
        table.row("frames", format!("{start} to {end}, {fps} a second"));
    }
    for tube in &report.tubes {
        let [least, largest] = tube.radius.map(text::short);
        let radius = if least == largest { least } else { format!("{least} to {largest}") };
        table.heading(format!("tube \"{}\"", text::tidy(&tube.name)));
        let segments = text::number(tube.segments as u64, "segment");
        let closed = if tube.closed { ", closed" } else { "" };
        table.row("axis", format!("{} m in {segments}{closed}", text::short(tube.length)));
        if tube.corners > 0 {
            let joints = text::number(tube.corners as u64, "joint");
            table.row("corners", format!("{joints} of more than a degree"));
        }
        if tube.closed {
            let degrees = text::short(tube.holonomy.to_degrees());
            table.row("holonomy", format!("{degrees} degrees"));
        }
        table.row("radius", format!("{radius} m"));
        if let Some(error) = tube.radius_sampling_error {
            table.row("", format!("about {} m off between its samples", text::short(error)));
        }
        table.row(
            "twist",
            format!("{} turns, and {} a second", text::short(tube.twist), text::short(tube.spin)),
        );
        table.row("caps", tube.caps);
        table.rows("layers", &tube.layers, "none");
    }
    if !report.inputs.is_empty() {
        table.heading("files");
        for input in &report.inputs {
            table.row("sha256", format!("{} {}", input.sha256, text::tidy(&input.path)));
        }
    }
    table.finish()
}
