//! What a scene holds.

use serde::Serialize;

use crate::cli::job::{bounds, dimensions, voxel_size};
use crate::cli::text;
use crate::field::Field;
use crate::scene::{Caps, Layer, Op, Pattern, Scene, SceneErrors, Tube};

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
    fps: f64,
    start: i64,
    end: Option<i64>,
    tubes: Vec<TubeReport>,
    lights: usize,
}

#[derive(Debug, Serialize)]
struct TubeReport {
    name: String,
    segments: usize,
    /// Metres.
    length: f64,
    /// Smallest and largest, in metres.
    radius: [f64; 2],
    /// Turns from end to end.
    twist: f64,
    /// Turns a second at the start frame.
    spin: f64,
    caps: &'static str,
    layers: Vec<String>,
}

/// Describes.
pub(super) fn describe(scene: &Scene) -> Result<Report, SceneErrors> {
    let bounds = bounds(&Field::compile(scene));
    let (bake, time) = (scene.bake(), scene.time());
    let voxel_size = voxel_size(bake.step, scene)?;
    Ok(Report {
        kind: "scene",
        name: scene.name().to_owned(),
        bounds,
        voxel_size,
        dimensions: dimensions(bounds, voxel_size),
        cutoff: bake.cutoff,
        octave_fade: bake.octave_fade,
        fps: time.fps,
        start: time.start,
        end: time.end,
        tubes: scene.tubes().iter().map(tube).collect(),
        lights: scene.lights().len(),
    })
}

fn tube(tube: &Tube) -> TubeReport {
    let (least, largest) = tube.radius.range(0.0, 1.0);
    TubeReport {
        name: tube.name.clone(),
        segments: tube.curve.segments().len(),
        length: tube.curve.length(),
        radius: [least, largest],
        twist: tube.twist,
        spin: tube.spin,
        caps: match tube.caps {
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
        table.row(
            "axis",
            format!("{} m in {}", text::short(tube.length), text::number(tube.segments as u64, "segment")),
        );
        table.row("radius", format!("{radius} m"));
        table.row(
            "twist",
            format!("{} turns, and {} a second", text::short(tube.twist), text::short(tube.spin)),
        );
        table.row("caps", tube.caps);
        table.rows("layers", &tube.layers, "none");
    }
    table.finish()
}
