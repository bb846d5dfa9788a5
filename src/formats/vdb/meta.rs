//! Metadata maps, of a file and of a grid.

#![cfg_attr(
    not(test),
    deny(
        clippy::arithmetic_side_effects,
        clippy::expect_used,
        clippy::indexing_slicing,
        clippy::panic,
        clippy::string_slice,
        clippy::unreachable,
        clippy::unwrap_used
    )
)]

use std::collections::BTreeMap;

use super::file::VdbWriteError;

/// Entries by name; written in byte order of the names.
pub type Metadata = BTreeMap<String, Meta>;

/// A typed metadata value.
#[derive(Debug, Clone, PartialEq)]
pub enum Meta {
    /// `string`. The format has no encoding; bytes that are not UTF-8 are replaced on reading.
    String(String),
    /// `bool`.
    Bool(bool),
    /// `int32`.
    Int32(i32),
    /// `int64`.
    Int64(i64),
    /// `float`.
    Float(f32),
    /// `double`.
    Double(f64),
    /// `vec2i`.
    Vec2i([i32; 2]),
    /// `vec2s`.
    Vec2s([f32; 2]),
    /// `vec2d`.
    Vec2d([f64; 2]),
    /// `vec3i`.
    Vec3i([i32; 3]),
    /// `vec3s`.
    Vec3s([f32; 3]),
    /// `vec3d`.
    Vec3d([f64; 3]),
    /// `vec4i`.
    Vec4i([i32; 4]),
    /// `vec4s`.
    Vec4s([f32; 4]),
    /// `vec4d`.
    Vec4d([f64; 4]),
    /// `mat4s`, by rows, which OpenVDB multiplies row vectors with.
    Mat4s([[f32; 4]; 4]),
    /// `mat4d`, likewise.
    Mat4d([[f64; 4]; 4]),
    /// Any other type: its name and its bytes as stored.
    Other {
        /// The type's name in the file.
        type_name: String,
        /// The value's bytes, little-endian.
        bytes: Vec<u8>,
    },
}

impl From<&str> for Meta {
    fn from(text: &str) -> Self {
        Self::String(text.to_owned())
    }
}

impl From<String> for Meta {
    fn from(text: String) -> Self {
        Self::String(text)
    }
}

impl Meta {
    /// The type's name in a file.
    pub fn type_name(&self) -> &str {
        match self {
            Self::String(_) => "string",
            Self::Bool(_) => "bool",
            Self::Int32(_) => "int32",
            Self::Int64(_) => "int64",
            Self::Float(_) => "float",
            Self::Double(_) => "double",
            Self::Vec2i(_) => "vec2i",
            Self::Vec2s(_) => "vec2s",
            Self::Vec2d(_) => "vec2d",
            Self::Vec3i(_) => "vec3i",
            Self::Vec3s(_) => "vec3s",
            Self::Vec3d(_) => "vec3d",
            Self::Vec4i(_) => "vec4i",
            Self::Vec4s(_) => "vec4s",
            Self::Vec4d(_) => "vec4d",
            Self::Mat4s(_) => "mat4s",
            Self::Mat4d(_) => "mat4d",
            Self::Other { type_name, .. } => type_name,
        }
    }

    fn bytes(&self) -> Vec<u8> {
        match self {
            Self::String(text) => text.as_bytes().to_vec(),
            Self::Bool(value) => vec![u8::from(*value)],
            Self::Int32(value) => value.to_le_bytes().to_vec(),
            Self::Int64(value) => value.to_le_bytes().to_vec(),
            Self::Float(value) => value.to_le_bytes().to_vec(),
            Self::Double(value) => value.to_le_bytes().to_vec(),
            Self::Vec2i(value) => joined(value, i32::to_le_bytes),
            Self::Vec2s(value) => joined(value, f32::to_le_bytes),
            Self::Vec2d(value) => joined(value, f64::to_le_bytes),
            Self::Vec3i(value) => joined(value, i32::to_le_bytes),
            Self::Vec3s(value) => joined(value, f32::to_le_bytes),
            Self::Vec3d(value) => joined(value, f64::to_le_bytes),
            Self::Vec4i(value) => joined(value, i32::to_le_bytes),
            Self::Vec4s(value) => joined(value, f32::to_le_bytes),
            Self::Vec4d(value) => joined(value, f64::to_le_bytes),
            Self::Mat4s(value) => joined(value.as_flattened(), f32::to_le_bytes),
            Self::Mat4d(value) => joined(value.as_flattened(), f64::to_le_bytes),
            Self::Other { bytes, .. } => bytes.clone(),
        }
    }

    /// The value of a type from its bytes in a file; `None` where their number does not fit the type.
    pub(super) fn from_bytes(type_name: &str, bytes: &[u8]) -> Option<Self> {
        Some(match type_name {
            "string" => Self::String(String::from_utf8_lossy(bytes).into_owned()),
            "bool" => Self::Bool(<[u8; 1]>::try_from(bytes).ok()? != [0]),
            "int32" => Self::Int32(i32::from_le_bytes(bytes.try_into().ok()?)),
            "int64" => Self::Int64(i64::from_le_bytes(bytes.try_into().ok()?)),
            "float" => Self::Float(f32::from_le_bytes(bytes.try_into().ok()?)),
            "double" => Self::Double(f64::from_le_bytes(bytes.try_into().ok()?)),
            "vec2i" => Self::Vec2i(array(bytes, i32::from_le_bytes)?),
            "vec2s" => Self::Vec2s(array(bytes, f32::from_le_bytes)?),
            "vec2d" => Self::Vec2d(array(bytes, f64::from_le_bytes)?),
            "vec3i" => Self::Vec3i(array(bytes, i32::from_le_bytes)?),
            "vec3s" => Self::Vec3s(array(bytes, f32::from_le_bytes)?),
            "vec3d" => Self::Vec3d(array(bytes, f64::from_le_bytes)?),
            "vec4i" => Self::Vec4i(array(bytes, i32::from_le_bytes)?),
            "vec4s" => Self::Vec4s(array(bytes, f32::from_le_bytes)?),
            "vec4d" => Self::Vec4d(array(bytes, f64::from_le_bytes)?),
            "mat4s" => Self::Mat4s(rows(array(bytes, f32::from_le_bytes)?)?),
            "mat4d" => Self::Mat4d(rows(array(bytes, f64::from_le_bytes)?)?),
            _ => Self::Other { type_name: type_name.to_owned(), bytes: bytes.to_vec() },
        })
    }
}

fn joined<T: Copy, const B: usize>(numbers: &[T], bytes: impl Fn(T) -> [u8; B]) -> Vec<u8> {
    numbers.iter().flat_map(|number| bytes(*number)).collect()
}

fn rows<T: Copy>(numbers: [T; 16]) -> Option<[[T; 4]; 4]> {
    numbers.as_chunks().0.try_into().ok()
}

/// `N` little-endian numbers of `B` bytes that fill `bytes` exactly.
fn array<T, const B: usize, const N: usize>(bytes: &[u8], from: impl Fn([u8; B]) -> T) -> Option<[T; N]> {
    let (items, rest) = bytes.as_chunks::<B>();
    let items: &[[u8; B]; N] = items.try_into().ok()?;
    rest.is_empty().then(|| items.map(from))
}

/// Appends a length and the text.
pub(super) fn put_str(out: &mut Vec<u8>, text: &str) -> Result<(), VdbWriteError> {
    put_bytes(out, text.as_bytes())
}

fn put_bytes(out: &mut Vec<u8>, bytes: &[u8]) -> Result<(), VdbWriteError> {
    let len =
        u32::try_from(bytes.len()).map_err(|_| VdbWriteError::TooLarge("a name or a metadata value"))?;
    out.extend(len.to_le_bytes());
    out.extend(bytes);
    Ok(())
}

/// Appends a metadata map.
pub(super) fn put_metadata(out: &mut Vec<u8>, entries: &Metadata) -> Result<(), VdbWriteError> {
    let count = u32::try_from(entries.len()).map_err(|_| VdbWriteError::TooLarge("a metadata map"))?;
    out.extend(count.to_le_bytes());
    for (name, value) in entries {
        if name.is_empty() {
            return Err(VdbWriteError::Metadata(name.clone()));
        }
        put_str(out, name)?;
        put_str(out, value.type_name())?;
        put_bytes(out, &value.bytes())?;
    }
    Ok(())
}
