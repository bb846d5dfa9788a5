//! Metadata maps, of a file and of a grid.

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
    /// `vec3i`.
    Vec3i([i32; 3]),
    /// `vec3s`.
    Vec3s([f32; 3]),
    /// `vec3d`.
    Vec3d([f64; 3]),
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
            Self::Vec3i(_) => "vec3i",
            Self::Vec3s(_) => "vec3s",
            Self::Vec3d(_) => "vec3d",
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
            Self::Vec3i(value) => value.iter().flat_map(|c| c.to_le_bytes()).collect(),
            Self::Vec3s(value) => value.iter().flat_map(|c| c.to_le_bytes()).collect(),
            Self::Vec3d(value) => value.iter().flat_map(|c| c.to_le_bytes()).collect(),
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
            "vec3i" => Self::Vec3i(array(bytes, i32::from_le_bytes)?),
            "vec3s" => Self::Vec3s(array(bytes, f32::from_le_bytes)?),
            "vec3d" => Self::Vec3d(array(bytes, f64::from_le_bytes)?),
            _ => Self::Other { type_name: type_name.to_owned(), bytes: bytes.to_vec() },
        })
    }
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
