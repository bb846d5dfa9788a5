//! What is stored: half precision's range, single voxels, threads, caps.

use std::io::Cursor;

use uuid::Uuid;

use super::{BENT, NOISE, quadratic};
use crate::check::case::{Case, Verdict, probe};
use crate::formats::vdb::{
    self, AnyTree, Compression, Encoder, FileHeader, GridClass, GridHeader, Metadata, Precision, VdbFile,
    VdbGridBuilder, VectorType,
};
use crate::num::Level;
use crate::volume::{LARGEST_F16, Tally, Tree, bake};

const GROUP: &str = "storage";

pub(super) fn cases() -> Vec<Case> {
    let noisy = || quadratic(&BENT, &format!("radius = 0.25\n{NOISE}"));
    let dense = |value: &str| {
        quadratic(&BENT, &format!("radius = 0.25\n[[tube.layer]]\nnoise = \"constant\"\nvalue = {value}"))
    };
    vec![
        Case::new(
            GROUP,
            "a density of 1e6 in half precision",
            "clamped to 65504 and counted, never infinite",
            move || {
                let text = dense("1e6");
                stored(&text, Precision::F16).map_or_else(Verdict::failed, |(tally, tree)| {
                    let most = tree.active_voxels().map(|(_, value)| value).fold(0.0, f32::max);
                    Verdict::is(
                        most == LARGEST_F16 && tally.clamped_voxels > 0,
                        format!("{most}, {} clamped", tally.clamped_voxels),
                    )
                })
            },
        ),
        Case::new(GROUP, "a density of 1e-9 in half precision", "0, and counted", move || {
            stored(&dense("1e-9"), Precision::F16).map_or_else(Verdict::failed, |(tally, tree)| {
                let most = tree.active_voxels().map(|(_, value)| value).fold(0.0, f32::max);
                Verdict::is(
                    most == 0.0 && tally.vanished_voxels == tally.active_voxels,
                    format!("{most}, {} of {} vanished", tally.vanished_voxels, tally.active_voxels),
                )
            })
        }),
        Case::new(GROUP, "a density of 1e-40", "a denormal number, read as it was written", move || {
            stored(&dense("1e-40"), Precision::F32).map_or_else(Verdict::failed, |(_, tree)| {
                let most = tree.active_voxels().map(|(_, value)| value).fold(0.0, f32::max);
                Verdict::is(most > 0.0 && most <= 1.01e-40, format!("{most:e}"))
            })
        }),
        Case::new(GROUP, "one active voxel", "one, read as it was written", || {
            let points = [[0.01, 0.01, 0.0], [0.01, 0.01, 0.01], [0.01, 0.01, 0.02]];
            let text = format!(
                "[bake]\nwiden = false\nantialias = \"off\"\n{}",
                quadratic(&points, "radius = 0.009\ncaps = \"flat\"\nenvelope = { radial = \"hard\" }")
            );
            stored(&text, Precision::F32).map_or_else(Verdict::failed, |(tally, tree)| {
                let voxels: Vec<_> = tree.active_voxels().collect();
                Verdict::is(voxels == [([0; 3], 1.0)] && tally.active_voxels == 1, format!("{voxels:?}"))
            })
        }),
        Case::new(GROUP, "no active voxel", "an empty grid of background 0, read as it was written", || {
            stored("name = \"empty\"\n", Precision::F32).map_or_else(Verdict::failed, |(tally, tree)| {
                let is_empty = tree.leaf_count() == 0 && tree.background() == 0.0 && tally.active_voxels == 0;
                Verdict::is(is_empty, format!("{} leaves", tree.leaf_count()))
            })
        }),
        Case::new(GROUP, "1, 2 and 64 threads", "the same file to the byte", move || {
            let text = noisy();
            let files = [1, 2, 64].map(|threads| {
                let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
                let pool = pool.map_err(|error| error.to_string())?;
                pool.install(|| file(&text, Encoder::new(Compression::Blosc), None).map(|(_, bytes)| bytes))
            });
            same(&files)
        }),
        Case::new(
            GROUP,
            "the least memory for encoded values",
            "the same file to the byte, through a temporary file",
            move || {
                // More than the piece of memory that is always taken.
                let text = quadratic(&BENT, &format!("radius = 0.8\n{NOISE}"));
                let encoder = Encoder::new(Compression::None);
                let files = [None, Some(0)].map(|cap| file(&text, encoder, cap).map(|(_, bytes)| bytes));
                same(&files)
            },
        ),
    ]
}

fn same(files: &[Result<Vec<u8>, String>]) -> Verdict {
    match files {
        [Ok(first), rest @ ..] if rest.iter().all(|file| file.as_ref() == Ok(first)) => {
            Verdict::is(true, format!("{} bytes each", first.len()))
        }
        files => match files.iter().find_map(|file| file.as_ref().err()) {
            Some(error) => Verdict::failed(error),
            None => Verdict::is(false, "they differ"),
        },
    }
}

/// A file in memory; with `cap` bytes for encoded leaves, the others in a temporary file.
fn file(text: &str, encoder: Encoder, cap: Option<u64>) -> Result<(Tally, Vec<u8>), String> {
    let probe = probe(text, 0.02)?;
    let mut grid = VdbGridBuilder::with_encoder(encoder);
    if let Some(memory) = cap {
        grid = grid.with_spool(memory, tempfile::tempfile().map_err(|error| error.to_string())?);
    }
    let (tally, _) = bake(&probe.field, &probe.plan, 0.0, Level::best(), &mut grid, |_| ())
        .map_err(|error| error.to_string())?;
    if cap.is_some() && grid.spooled_bytes() == 0 {
        return Err("everything fitted into memory".to_owned());
    }
    let header = GridHeader {
        name: "density".to_owned(),
        class: GridClass::FogVolume,
        vector_type: VectorType::Invariant,
        voxel_size: 0.02,
        translation: [0.01; 3],
        metadata: Metadata::new(),
    };
    let around = FileHeader { uuid: Uuid::nil(), metadata: Metadata::new() };
    let mut bytes = Vec::new();
    vdb::write(&mut bytes, &around, &[(&header, &grid)]).map_err(|error| error.to_string())?;
    Ok((tally, bytes))
}

/// What a reader finds in the file.
fn stored(text: &str, precision: Precision) -> Result<(Tally, Tree<f32>), String> {
    let (tally, bytes) = file(text, Encoder::new(Compression::Blosc).with_precision(precision), None)?;
    let grid = VdbFile::open(Cursor::new(bytes)).and_then(|mut file| file.grid("density"));
    match grid.map_err(|error| error.to_string())?.tree {
        AnyTree::Float(tree) => Ok((tally, tree)),
        _ => Err("another type of grid".to_owned()),
    }
}
