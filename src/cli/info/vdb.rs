//! What an OpenVDB file holds.

use std::collections::BTreeMap;
use std::fs::File;
use std::path::Path;

use glam::DVec3;
use serde::Serialize;

use super::view::{self, Size, View};
use crate::cli::memory::Amount;
use crate::cli::{Failure, embedded, text};
use crate::formats::vdb::{GridInfo, Meta, Metadata, list_grids};
use crate::scene::Scene;

/// As `--json` prints it.
#[derive(Debug, Serialize)]
pub(super) struct Report {
    kind: &'static str,
    file: String,
    /// Of the file.
    bytes: u64,
    version: u32,
    library: String,
    uuid: String,
    metadata: BTreeMap<String, Value>,
    grids: Vec<Grid>,
    /// Grids that the file has besides, behind one that cannot be passed or where the file breaks off.
    out_of_reach: usize,
    /// Why the file cannot be read to its end.
    error: Option<String>,
    /// What another renderer needs; null where the scene in the file cannot be read.
    pub(super) view: Option<View>,
    /// The file's, as it is.
    #[serde(skip)]
    recipe: Metadata,
}

#[derive(Debug, Serialize)]
struct Grid {
    name: String,
    /// Whether all of it is in the file.
    whole: bool,
    #[serde(rename = "type")]
    type_name: String,
    /// Whether values are stored as binary16.
    half: bool,
    class: Option<String>,
    instance_of: Option<String>,
    compression: String,
    map: String,
    /// Edges of a voxel in metres; null for maps that are not affine.
    voxel_size: Option<[f64; 3]>,
    /// World position of index (0, 0, 0) in metres.
    translation: Option<[f64; 3]>,
    /// Rows of A in `world = A (i, j, k, 1)`; null for maps that are not affine.
    matrix: Option<[[f64; 4]; 3]>,
    active_voxels: Option<i64>,
    /// Smallest and largest index of an active voxel.
    bbox: Option<[[i32; 3]; 2]>,
    bytes: u64,
    metadata: BTreeMap<String, Value>,
}

/// A metadata value.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(untagged)]
enum Value {
    Text(String),
    Flag(bool),
    Integer(i64),
    Number(f64),
    Integers(Vec<i32>),
    Numbers(Vec<f64>),
    /// Rows.
    Matrix(Vec<[f64; 4]>),
    Other {
        r#type: String,
        bytes: usize,
    },
}

impl From<&Meta> for Value {
    fn from(meta: &Meta) -> Value {
        match meta {
            Meta::String(text) => Value::Text(text.clone()),
            Meta::Bool(flag) => Value::Flag(*flag),
            Meta::Int32(n) => Value::Integer((*n).into()),
            Meta::Int64(n) => Value::Integer(*n),
            Meta::Float(x) => Value::Number((*x).into()),
            Meta::Double(x) => Value::Number(*x),
            Meta::Vec2i(v) => Value::Integers(v.to_vec()),
            Meta::Vec2s(v) => Value::Numbers(v.map(f64::from).to_vec()),
            Meta::Vec2d(v) => Value::Numbers(v.to_vec()),
            Meta::Vec3i(v) => Value::Integers(v.to_vec()),
            Meta::Vec3s(v) => Value::Numbers(v.map(f64::from).to_vec()),
            Meta::Vec3d(v) => Value::Numbers(v.to_vec()),
            Meta::Vec4i(v) => Value::Integers(v.to_vec()),
            Meta::Vec4s(v) => Value::Numbers(v.map(f64::from).to_vec()),
            Meta::Vec4d(v) => Value::Numbers(v.to_vec()),
            Meta::Mat4s(rows) => Value::Matrix(rows.map(|row| row.map(f64::from)).to_vec()),
            Meta::Mat4d(rows) => Value::Matrix(rows.to_vec()),
            Meta::Other { type_name, bytes } => {
                Value::Other { r#type: type_name.clone(), bytes: bytes.len() }
            }
        }
    }
}

impl Value {
    fn human(&self) -> String {
        match self {
            Value::Text(text) => text::tidy(text),
            Value::Flag(flag) => flag.to_string(),
            Value::Integer(n) => n.to_string(),
            Value::Number(x) => x.to_string(),
            Value::Integers(numbers) => list(numbers, i32::to_string),
            Value::Numbers(numbers) => list(numbers, f64::to_string),
            Value::Matrix(rows) => list(rows, |row| list(row, f64::to_string)),
            Value::Other { r#type, bytes } => format!("{bytes} bytes of type {}", text::tidy(r#type)),
        }
    }
}

fn list<T>(items: &[T], text: impl Fn(&T) -> String) -> String {
    let items: Vec<String> = items.iter().map(text).collect();
    format!("({})", items.join(", "))
}

/// Reads the file's headers; of a file that breaks off, those before that, and the failure.
pub(super) fn read(path: &Path) -> Result<(Report, Option<Failure>), Failure> {
    let name = path.display().to_string();
    let file =
        File::open(path).map_err(|error| Failure::input(format!("cannot read {name}")).because(error))?;
    let metadata =
        file.metadata().map_err(|error| Failure::input(format!("cannot read {name}")).because(error))?;
    let bytes = metadata.len();
    if metadata.is_file() && bytes == 0 {
        return Err(Failure::input(format!("{name} is empty")));
    }
    // A file without offsets is read through, which takes memory for one grid's nodes after the other.
    let listing = list_grids(file, Amount::installed().bytes())
        .map_err(|error| Failure::input(format!("cannot read {name}")).because(error))?;
    let info = &listing.info;
    let error = listing.error.as_ref().map(ToString::to_string);
    let failure =
        listing.error.map(|error| Failure::input(format!("cannot read {name} to its end")).because(error));
    let report = Report {
        kind: "vdb",
        file: name,
        bytes,
        version: info.version,
        library: format!("{}.{}", info.library[0], info.library[1]),
        uuid: info.uuid.clone(),
        metadata: values(&info.metadata),
        grids: (0..).zip(&info.grids).map(|(number, info)| grid(info, number < listing.whole)).collect(),
        out_of_reach: info.out_of_reach,
        error,
        view: None,
        recipe: listing.info.metadata,
    };
    Ok((report, failure))
}

/// The view of the scene that the file was baked from, at its time; other files that it names are looked for beside this
/// one. Of files that carry none, that of an empty scene, framed to the density.
pub(super) fn view(report: &Report, path: &Path, size: Size) -> Result<View, Failure> {
    let time = match report.metadata.get("vdbake_settings") {
        Some(Value::Text(settings)) => embedded::time(settings),
        _ => 0.0,
    };
    let scene = match embedded::scene(&report.recipe, path, None, Amount::installed())? {
        Some(scene) => scene.at(time)?,
        None => Scene::parse("", "no scene")?,
    };
    let named = report.grids.iter().find(|grid| grid.name == "density");
    Ok(view::view(&scene, named.or(report.grids.first()).and_then(bounds), size))
}

/// Corners in metres of the box of a grid's active voxels, as its metadata tell it.
fn bounds(grid: &Grid) -> Option<[DVec3; 2]> {
    let (rows, ends) = (grid.matrix?, grid.bbox?);
    let corner = |number: usize| {
        let index = DVec3::from([0, 1, 2].map(|axis| f64::from(ends[number >> axis & 1][axis])));
        DVec3::from(rows.map(|[x, y, z, w]| DVec3::new(x, y, z).dot(index) + w))
    };
    let corners = (0..8).map(corner);
    let [low, high] = corners.fold([DVec3::INFINITY, DVec3::NEG_INFINITY], |[low, high], corner| {
        [low.min(corner), high.max(corner)]
    });
    (low.is_finite() && high.is_finite()).then_some([low, high])
}

fn values(metadata: &Metadata) -> BTreeMap<String, Value> {
    metadata.iter().map(|(name, meta)| (name.clone(), meta.into())).collect()
}

fn grid(info: &GridInfo, whole: bool) -> Grid {
    let entry = |name| info.metadata.get(name);
    let corner = |name| match entry(name) {
        Some(Meta::Vec3i(corner)) => Some(*corner),
        _ => None,
    };
    Grid {
        name: info.name.clone(),
        whole,
        type_name: info.type_name.clone(),
        half: info.half,
        class: match entry("class") {
            Some(Meta::String(class)) => Some(class.clone()),
            _ => None,
        },
        instance_of: (!info.instance_of.is_empty()).then(|| info.instance_of.clone()),
        compression: info.compression.clone(),
        map: info.map.type_name.clone(),
        voxel_size: info.map.matrix.map(|rows| [0, 1, 2].map(|column| length(rows.map(|row| row[column])))),
        translation: info.map.matrix.map(|rows| rows.map(|row| row[3])),
        matrix: info.map.matrix,
        active_voxels: match entry("file_voxel_count") {
            Some(Meta::Int64(count)) => Some(*count),
            _ => None,
        },
        // An empty grid has its bounds inside out.
        bbox: corner("file_bbox_min")
            .zip(corner("file_bbox_max"))
            .map(<[_; 2]>::from)
            .filter(|[low, high]| low.iter().zip(high).all(|(low, high)| low <= high)),
        bytes: info.bytes,
        metadata: values(&info.metadata),
    }
}

fn length([x, y, z]: [f64; 3]) -> f64 {
    (x * x + y * y + z * z).sqrt()
}

/// Whether a map scales and moves only, so that the size of a voxel and the place of the first tell all.
fn is_plain(rows: &[[f64; 4]; 3]) -> bool {
    (0..3).all(|row| {
        (0..3).all(|column| if row == column { rows[row][row] > 0.0 } else { rows[row][column] == 0.0 })
    })
}

/// For people.
pub(super) fn human(report: &Report) -> String {
    let mut table = text::Table::default();
    table.heading(format!("{}: an OpenVDB file of {}", report.file, text::bytes(report.bytes)));
    table.row("version", format!("{} (library {})", report.version, report.library));
    table.row("uuid", text::tidy(&report.uuid));
    for (name, value) in &report.metadata {
        table.row(&text::tidy(name), value.human());
    }
    for grid in &report.grids {
        describe(grid, &mut table);
    }
    if report.out_of_reach > 0 {
        let grids = text::number(report.out_of_reach as u64, "grid");
        let why = match report.error {
            Some(_) => "where the file cannot be read",
            None => "behind one that is not supported, in a file without offsets",
        };
        table.heading(format!("out of reach: {grids}, {why}"));
    }
    table.finish()
}

/// Metadata that is told already, in other words.
const TOLD: [&str; 7] = [
    "class",
    "file_bbox_max",
    "file_bbox_min",
    "file_compression",
    "file_voxel_count",
    "is_saved_as_half_float",
    "name",
];

fn describe(grid: &Grid, table: &mut text::Table) {
    let or_unknown = |text: Option<String>| text.unwrap_or_else(|| "unknown".to_owned());
    let half = if grid.half { ", stored as 16-bit floats" } else { "" };
    let cut = if grid.whole { "" } else { ", cut short" };
    table.heading(format!("grid \"{}\"{cut}", text::tidy(&grid.name)));
    table.row("type", format!("{}{half}", text::tidy(&grid.type_name)));
    table.row("class", or_unknown(grid.class.as_deref().map(text::tidy)));
    if let Some(other) = &grid.instance_of {
        table.row("shares", text::tidy(other));
    }
    table.row("compression", text::tidy(&grid.compression));
    let size = grid.voxel_size.map(|[x, y, z]| {
        if x == y && y == z {
            format!("{} m", text::short(x))
        } else {
            format!("{} m", text::vector([x, y, z]))
        }
    });
    table.row("voxel size", size.unwrap_or_else(|| format!("none, by a {}", text::tidy(&grid.map))));
    table.row("translation", or_unknown(grid.translation.map(|at| format!("{} m", text::vector(at)))));
    if let Some(rows) = grid.matrix.filter(|rows| !is_plain(rows)) {
        table.rows("matrix", &rows.map(|row| list(&row, |number| text::short(*number))), "none");
    }
    let active = grid.active_voxels.map(|n| u64::try_from(n).map_or_else(|_| n.to_string(), text::count));
    table.row("active voxels", or_unknown(active));
    let corner = |[x, y, z]: [i32; 3]| format!("({x}, {y}, {z})");
    let bbox = grid.bbox.map(|[low, high]| format!("{} to {}", corner(low), corner(high)));
    table.row("index bounds", bbox.unwrap_or_else(|| "none".to_owned()));
    table.row("size", text::bytes(grid.bytes));
    for (name, value) in grid.metadata.iter().filter(|(name, _)| !TOLD.contains(&name.as_str())) {
        table.row(&text::tidy(name), value.human());
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::formats::vdb::Map;

    fn shown(matrix: Option<[[f64; 4]; 3]>) -> (serde_json::Value, String) {
        let info = GridInfo {
            name: "a".to_owned(),
            type_name: "Tree_float_5_4_3".to_owned(),
            half: false,
            instance_of: String::new(),
            compression: "none".to_owned(),
            metadata: Metadata::new(),
            map: Map { type_name: "AffineMap".to_owned(), matrix },
            bytes: 0,
        };
        let grid = grid(&info, true);
        let mut table = text::Table::default();
        describe(&grid, &mut table);
        (serde_json::to_value(&grid).expect("JSON"), table.finish())
    }

    #[test]
    fn a_map_that_turns_or_mirrors_is_shown_as_a_matrix() {
        let plain = [[0.5, 0.0, 0.0, 1.0], [0.0, 0.25, 0.0, -2.0], [0.0, 0.0, 2.0, 0.0]];
        let (json, human) = shown(Some(plain));
        assert_eq!(json["matrix"], serde_json::json!(plain));
        assert!(!human.contains("matrix"), "{human}");

        // A quarter turn about z, then a step.
        let turned = [[0.0, -0.5, 0.0, 1.0], [0.5, 0.0, 0.0, 2.0], [0.0, 0.0, 0.5, 3.0]];
        let (json, human) = shown(Some(turned));
        assert_eq!(json["matrix"], serde_json::json!(turned));
        assert_eq!(json["voxel_size"], serde_json::json!([0.5, 0.5, 0.5]));
        let lines: Vec<&str> = human.lines().skip_while(|line| !line.contains("matrix")).take(3).collect();
        let lines = lines.join("\n").split_whitespace().collect::<Vec<_>>().join(" ");
        assert_eq!(lines, "matrix (0, -0.5, 0, 1) (0.5, 0, 0, 2) (0, 0, 0.5, 3)");

        let mirrored = [[-0.5, 0.0, 0.0, 0.0], [0.0, 0.5, 0.0, 0.0], [0.0, 0.0, 0.5, 0.0]];
        assert!(shown(Some(mirrored)).1.contains("matrix"));
        assert_eq!(shown(None).0["matrix"], serde_json::Value::Null);
    }
}
