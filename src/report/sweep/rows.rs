//! What a sweep finds.

use serde::Serialize;

use super::OrderOf;
use super::pictures::{ImageParts, PaysAfter};
use crate::report::{Errors, ImageIntervals, Intervals, Part, Parts};

/// All that a sweep found, as JSON holds it.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Report {
    /// Of this form.
    pub version: u32,
    /// The scene's name.
    pub scene: String,
    /// Seconds after its start frame.
    pub time: f64,
    /// Its own voxel size, metres.
    pub voxel_size: f64,
    /// What measured.
    pub machine: Machine,
    /// What errors are against.
    pub truth: Truth,
    /// The error of a bake at the scene's own voxel size taken apart: by trilinear values in single precision.
    pub parts: Parts,
    /// The same in half precision.
    pub parts_f16: Parts,
    /// The error of its picture taken apart; null where there was no time.
    pub image_parts: Option<ImageParts>,
    /// With which powers of the voxel size errors fall.
    pub orders: Vec<OrderOf>,
    /// After how many frames a bake pays; null where there was no time.
    pub pays_after: Option<PaysAfter>,
    /// That all took.
    pub seconds: f64,
    /// After which nothing was begun.
    pub time_limit: f64,
    /// For which there was no time, or what else is said behind a colon.
    pub left_out: Vec<String>,
    /// One for each setting.
    pub rows: Vec<Row>,
}

/// What measured.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Machine {
    /// That worked.
    pub threads: usize,
    /// The instruction set of the kernel.
    pub simd: String,
    /// As the system names it; null where it does not.
    pub processor: Option<String>,
}

/// What errors are against, and how well it is known.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Truth {
    /// Points at which values are compared.
    pub points: u64,
    /// Rays along which optical depths are.
    pub rays: u64,
    /// How far the kernel, which rays and pictures rest on, is from the reference in double precision.
    pub kernel: Part,
}

/// What a row is of.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Kind {
    /// A file.
    Bake,
    /// A picture.
    Picture,
}

/// A setting and what it costs.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Row {
    /// What is changed in its group of rows.
    pub group: &'static str,
    /// To what.
    pub label: String,
    /// What it is of.
    pub kind: Kind,
    /// Whether it is of the scene's own density, by its own light. Others are of one that is altered, or of a picture without
    /// shadows, against which they are measured: they are held against each other alone, and stand on no front.
    pub is_own: bool,
    /// All that can be set.
    pub settings: Settings,
    /// The command that does the same, where there is one.
    pub command: Option<String>,
    /// Of a bake's values.
    pub field: Option<FieldError>,
    /// Of a picture.
    pub image: Option<ImageError>,
    /// What it takes.
    pub cost: Cost,
    /// Whether no other row of its kind is both faster and more exact, of those that a command makes.
    pub on_front: bool,
}

/// All that can be set.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Settings {
    /// Metres.
    pub voxel_size: f64,
    /// How values between voxels are found; null where there are none.
    pub filter: Option<&'static str>,
    /// How they are stored.
    pub precision: Option<&'static str>,
    /// How they are compressed.
    pub compression: Option<&'static str>,
    /// Octaves of each layer, at most; null where they are the scene's.
    pub octaves: Option<u32>,
    /// Of pictures: voxels between steps; null for voxels, through which rays go from face to face.
    pub step: Option<f64>,
    /// Of pictures.
    pub method: Option<&'static str>,
}

/// How far a bake is off. Relative figures are null where the density is 0.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct FieldError {
    /// At points.
    pub errors: Errors,
    /// Bootstrap intervals of 95 %.
    pub intervals: Option<Intervals>,
    /// Relative L2 along rays.
    pub optical_depth: Option<f64>,
    /// The bake's mass over the scene's.
    pub mass_ratio: Option<f64>,
}

/// How far a picture is off, over red, green and blue.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct ImageError {
    /// Root mean square of the difference.
    pub rmse: f64,
    /// That over the root mean square of the picture that it is held against; null where that is black.
    pub relative: Option<f64>,
    /// Decibels of that picture's largest value; null where nothing differs.
    pub psnr: Option<f64>,
    /// What an observer sees: the mean of FLIP; null where there is no colour.
    pub flip: Option<f64>,
    /// Root mean square of the difference in transmittance.
    pub transmittance: f64,
    /// Bootstrap intervals of 95 %; null for a single pixel.
    pub intervals: Option<ImageIntervals>,
}

/// What a setting takes.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct Cost {
    /// Seconds by the clock until the bricks are known.
    pub plan: Option<Spread>,
    /// Processor seconds of all threads.
    pub evaluate: Option<Spread>,
    /// Likewise.
    pub encode: Option<Spread>,
    /// Seconds by the clock to put the file together, in memory.
    pub write: Option<Spread>,
    /// To read it from there.
    pub read: Option<Spread>,
    /// To march through it, one ray a pixel.
    pub march: Option<Spread>,
    /// Of a bake: plan, evaluation, encoding and writing; of a picture: marching.
    pub total: Option<Spread>,
    /// Of the file.
    pub bytes: Option<u64>,
    /// Bytes of the plan and of the file, which a bake in memory holds.
    pub memory: Option<u64>,
    /// Voxels of the file.
    pub active_voxels: Option<u64>,
    /// Processor nanoseconds of evaluation for each.
    pub ns_per_voxel: Option<f64>,
    /// Places where the density was evaluated.
    pub evaluated_places: Option<u64>,
}

/// Of repeated times.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Spread {
    /// The one in the middle.
    pub median: f64,
    /// The least.
    pub least: f64,
    /// The most.
    pub most: f64,
    /// How many there are.
    pub count: usize,
}

impl Spread {
    /// `None` of none.
    pub fn of(mut seconds: Vec<f64>) -> Option<Spread> {
        seconds.sort_unstable_by(f64::total_cmp);
        let (least, most) = (*seconds.first()?, *seconds.last()?);
        let (half, odd) = (seconds.len() / 2, seconds.len() % 2 == 1);
        let median = if odd { seconds[half] } else { 0.5 * (seconds[half - 1] + seconds[half]) };
        Some(Spread { median, least, most, count: seconds.len() })
    }
}

/// Where a row stands on the axes of a front.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LevelOf {
    /// Seconds.
    pub seconds: f64,
    /// Relative error.
    pub error: f64,
}

impl Row {
    /// Whether a command makes this of the scene as it is.
    pub fn can_be_chosen(&self) -> bool {
        self.is_own && self.command.is_some()
    }

    /// Time and error; `None` where either is not known.
    pub fn level(&self) -> Option<LevelOf> {
        let seconds = self.cost.total?.median;
        let error = match self.kind {
            Kind::Bake => self.field.as_ref()?.errors.l2.of_rms?,
            Kind::Picture => self.image?.relative?,
        };
        Some(LevelOf { seconds, error })
    }
}

/// Marks the rows that no other row of their kind beats in both. What is off by all of it shows nothing, however soon; and
/// what no command makes is no setting that one could choose.
pub(super) fn mark_fronts(rows: &mut [Row]) {
    let level = |row: &Row| row.level().filter(|level| row.can_be_chosen() && level.error < 1.0);
    let levels: Vec<(Kind, Option<LevelOf>)> = rows.iter().map(|row| (row.kind, level(row))).collect();
    for (row, (kind, level)) in rows.iter_mut().zip(&levels) {
        let Some(level) = level else { continue };
        let beaten = levels
            .iter()
            .filter(|(other, _)| other == kind)
            .filter_map(|(_, other)| *other)
            .any(|other| other.seconds <= level.seconds && other.error <= level.error && other != *level);
        row.on_front = !beaten;
    }
}

/// Of a line for each row: the figures that plots need.
const COLUMNS: [&str; 48] = [
    "group",
    "label",
    "kind",
    "voxel_size",
    "filter",
    "precision",
    "compression",
    "octaves",
    "step",
    "method",
    "relative_l1",
    "relative_l2",
    "l2_low",
    "l2_high",
    "max_of_peak",
    "p999_of_peak",
    "relative_bias",
    "mass_ratio",
    "optical_depth",
    "image_rmse",
    "image_rmse_low",
    "image_rmse_high",
    "image_relative",
    "image_relative_low",
    "image_relative_high",
    "image_psnr",
    "image_psnr_low",
    "image_psnr_high",
    "image_flip",
    "image_flip_low",
    "image_flip_high",
    "transmittance_rmse",
    "plan",
    "evaluate",
    "encode",
    "write",
    "read",
    "march",
    "total",
    "total_least",
    "total_most",
    "bytes",
    "memory",
    "active_voxels",
    "ns_per_voxel",
    "evaluated_places",
    "is_own",
    "on_front",
];

impl Report {
    /// As CSV, with a header.
    ///
    /// # Errors
    ///
    /// None but those of a writer that holds all in memory.
    pub fn to_csv(&self) -> Result<Vec<u8>, csv::Error> {
        let mut lines = csv::Writer::from_writer(Vec::new());
        lines.write_record(COLUMNS)?;
        for row in &self.rows {
            let (set, cost) = (&row.settings, &row.cost);
            let number = |x: Option<f64>| x.map_or_else(String::new, |x| format!("{x:?}"));
            let count = |x: Option<u64>| x.map_or_else(String::new, |x| x.to_string());
            let word = |x: Option<&'static str>| x.unwrap_or_default().to_owned();
            let middle = |x: Option<Spread>| number(x.map(|x| x.median));
            let errors = row.field.as_ref().map(|field| &field.errors);
            let held = row.field.as_ref().and_then(|field| field.intervals?.relative_l2);
            let seen = row.image.and_then(|image| image.intervals);
            let kind = match row.kind {
                Kind::Bake => "bake",
                Kind::Picture => "picture",
            };
            let cells: [String; COLUMNS.len()] = [
                row.group.to_owned(),
                row.label.clone(),
                kind.to_owned(),
                number(Some(set.voxel_size)),
                word(set.filter),
                word(set.precision),
                word(set.compression),
                count(set.octaves.map(u64::from)),
                number(set.step),
                word(set.method),
                number(errors.and_then(|errors| errors.l1.of_rms)),
                number(errors.and_then(|errors| errors.l2.of_rms)),
                number(held.map(|held| held[0])),
                number(held.map(|held| held[1])),
                number(errors.and_then(|errors| errors.max.of_peak)),
                number(errors.and_then(|errors| errors.p999.of_peak)),
                number(errors.and_then(|errors| errors.bias.of_rms)),
                number(row.field.as_ref().and_then(|field| field.mass_ratio)),
                number(row.field.as_ref().and_then(|field| field.optical_depth)),
                number(row.image.map(|image| image.rmse)),
                number(seen.map(|seen| seen.rmse[0])),
                number(seen.map(|seen| seen.rmse[1])),
                number(row.image.and_then(|image| image.relative)),
                number(seen.and_then(|seen| seen.relative).map(|ends| ends[0])),
                number(seen.and_then(|seen| seen.relative).map(|ends| ends[1])),
                number(row.image.and_then(|image| image.psnr)),
                number(seen.and_then(|seen| seen.psnr).map(|ends| ends[0])),
                number(seen.and_then(|seen| seen.psnr).map(|ends| ends[1])),
                number(row.image.and_then(|image| image.flip)),
                number(seen.and_then(|seen| seen.flip).map(|ends| ends[0])),
                number(seen.and_then(|seen| seen.flip).map(|ends| ends[1])),
                number(row.image.map(|image| image.transmittance)),
                middle(cost.plan),
                middle(cost.evaluate),
                middle(cost.encode),
                middle(cost.write),
                middle(cost.read),
                middle(cost.march),
                middle(cost.total),
                number(cost.total.map(|total| total.least)),
                number(cost.total.map(|total| total.most)),
                count(cost.bytes),
                count(cost.memory),
                count(cost.active_voxels),
                number(cost.ns_per_voxel),
                count(cost.evaluated_places),
                row.is_own.to_string(),
                row.on_front.to_string(),
            ];
            lines.write_record(cells)?;
        }
        lines.into_inner().map_err(|error| error.into_error().into())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(kind: Kind, seconds: f64, error: f64) -> Row {
        let image = ImageError {
            rmse: error,
            relative: Some(error),
            psnr: None,
            flip: None,
            transmittance: 0.0,
            intervals: None,
        };
        let errors = Errors::new([(1.0, 1.0 + error)].into_iter(), None);
        let field = FieldError { errors, intervals: None, optical_depth: None, mass_ratio: None };
        let settings = Settings {
            voxel_size: 1.0,
            filter: None,
            precision: None,
            compression: None,
            octaves: None,
            step: None,
            method: None,
        };
        Row {
            group: "group",
            label: "a \"label\", and more".to_owned(),
            kind,
            is_own: true,
            settings,
            command: Some("vdbake".to_owned()),
            field: (kind == Kind::Bake).then_some(field),
            image: (kind == Kind::Picture).then_some(image),
            cost: Cost { total: Spread::of(vec![seconds]), ..Cost::default() },
            on_front: false,
        }
    }

    #[test]
    fn fronts_are_what_nothing_beats() {
        let mut rows = vec![
            row(Kind::Bake, 1.0, 0.5),
            row(Kind::Bake, 2.0, 0.25),
            row(Kind::Bake, 3.0, 0.375),
            row(Kind::Bake, 4.0, 0.125),
            row(Kind::Picture, 10.0, 0.75),
            // Of another density: better, and no matter.
            Row { is_own: false, ..row(Kind::Bake, 0.5, 0.0625) },
            // Of no command: likewise.
            Row { command: None, ..row(Kind::Bake, 0.25, 0.0625) },
        ];
        mark_fronts(&mut rows);
        let front: Vec<bool> = rows.iter().map(|row| row.on_front).collect();
        assert_eq!(front, [true, true, false, true, true, false, false]);
    }

    #[test]
    fn times_have_a_median_and_a_range() {
        let spread = Spread::of(vec![3.0, 1.0, 2.0]).expect("three");
        assert_eq!((spread.least, spread.median, spread.most, spread.count), (1.0, 2.0, 3.0, 3));
        assert_eq!(Spread::of(vec![]), None);
    }
}
