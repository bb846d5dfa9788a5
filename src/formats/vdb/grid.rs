//! What stands before a grid's tree: its type, metadata and transform.

use super::HALF_SUFFIX;
use super::codec::{Encoder, flags_text};
use super::file::VdbWriteError;
use super::meta::{Meta, Metadata, put_metadata, put_str};
use super::voxel::Voxel;
use crate::volume::{Precision, Stats};

/// What a grid says of itself.
#[derive(Debug, Clone, PartialEq)]
pub struct GridHeader {
    /// Unique in the file.
    pub name: String,
    /// What its values are.
    pub class: GridClass,
    /// How its values change when the grid is moved or turned. Only vectors have this.
    pub vector_type: VectorType,
    /// Edge of a voxel in metres, above 0.
    pub voxel_size: f64,
    /// World position in metres of the voxel with index (0, 0, 0): of its sample, which is its centre.
    pub translation: [f64; 3],
    /// Entries besides those the writer adds: `name`, `class`, `vector_type`, `is_saved_as_half_float` and all that begin
    /// with `file_`.
    pub metadata: Metadata,
}

/// What the values of a grid are.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum GridClass {
    /// None of the others.
    #[default]
    Unknown,
    /// Density, or another number that is 0 outside.
    FogVolume,
    /// Distance to a surface, negative inside.
    LevelSet,
    /// Vectors whose components belong to the faces of voxels.
    Staggered,
}

impl GridClass {
    fn name(self) -> &'static str {
        match self {
            Self::Unknown => "unknown",
            Self::FogVolume => "fog volume",
            Self::LevelSet => "level set",
            Self::Staggered => "staggered",
        }
    }
}

/// How vectors change when their grid is moved or turned.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum VectorType {
    /// Not at all: colours, texture coordinates.
    #[default]
    Invariant,
    /// As gradients do.
    Covariant,
    /// As normals do: as gradients, and with their length kept.
    CovariantNormalize,
    /// As differences of positions do: velocities, displacements.
    ContravariantRelative,
    /// As positions do.
    ContravariantAbsolute,
}

impl VectorType {
    fn name(self) -> &'static str {
        match self {
            Self::Invariant => "invariant",
            Self::Covariant => "covariant",
            Self::CovariantNormalize => "covariant normalize",
            Self::ContravariantRelative => "contravariant relative",
            Self::ContravariantAbsolute => "contravariant absolute",
        }
    }
}

/// The type of a grid in its descriptor.
pub(super) fn type_name<T: Voxel>(encoder: Encoder) -> String {
    let suffix = if encoder.precision() == Precision::F16 { HALF_SUFFIX } else { "" };
    format!("Tree_{}_5_4_3{suffix}", T::NAME)
}

/// Compression flags, metadata and transform.
pub(super) fn grid_head<T: Voxel>(
    header: &GridHeader,
    encoder: Encoder,
    stats: &Stats,
) -> Result<Vec<u8>, VdbWriteError> {
    let too_large = |_| VdbWriteError::TooLarge("the grid");
    // OpenVDB writes an empty grid's bounds inside out, too.
    let [low, high] = stats.bounds.unwrap_or([[i32::MAX; 3], [i32::MIN; 3]]);
    let flags = encoder.compression().flags();
    let mut own = vec![
        ("name", Meta::String(header.name.clone())),
        ("class", Meta::from(header.class.name())),
        ("is_saved_as_half_float", Meta::Bool(encoder.precision() == Precision::F16)),
        ("file_bbox_min", Meta::Vec3i(low)),
        ("file_bbox_max", Meta::Vec3i(high)),
        ("file_compression", Meta::String(flags_text(flags))),
        ("file_mem_bytes", Meta::Int64(i64::try_from(stats.memory_bytes).map_err(too_large)?)),
        ("file_voxel_count", Meta::Int64(i64::try_from(stats.active_voxels).map_err(too_large)?)),
    ];
    if T::NUMBERS > 1 {
        own.push(("vector_type", Meta::from(header.vector_type.name())));
    }
    let mut metadata = header.metadata.clone();
    let reserved = |name: &&String| name.starts_with("file_") || *name == "vector_type";
    if let Some(name) = metadata.keys().find(reserved) {
        return Err(VdbWriteError::Metadata(name.clone()));
    }
    for (name, value) in own {
        if metadata.insert(name.to_owned(), value).is_some() {
            return Err(VdbWriteError::Metadata(name.to_owned()));
        }
    }
    let mut head = flags.to_le_bytes().to_vec();
    put_metadata(&mut head, &metadata)?;
    put_transform(&mut head, header.voxel_size, header.translation)?;
    Ok(head)
}

/// Appends the map `world = voxel_size * index + translation` with the derived vectors that readers take as they are.
fn put_transform(out: &mut Vec<u8>, voxel_size: f64, translation: [f64; 3]) -> Result<(), VdbWriteError> {
    let inverse = 1.0 / voxel_size;
    let derived = [voxel_size, voxel_size.abs(), inverse, inverse * inverse, inverse / 2.0];
    // A normal inverse square excludes sizes whose map could not be inverted: 0, subnormal, infinite, NaN.
    let usable = voxel_size > 0.0 && derived.iter().all(|value| value.is_normal());
    if !usable || translation.iter().any(|c| !c.is_finite()) {
        return Err(VdbWriteError::Transform { voxel_size, translation });
    }
    put_str(out, "UniformScaleTranslateMap")?;
    out.extend(translation.iter().flat_map(|c| c.to_le_bytes()));
    for value in derived {
        out.extend([value; 3].iter().flat_map(|c| c.to_le_bytes()));
    }
    Ok(())
}
