//! Listing what a file holds, from headers alone.

use std::io::{self, BufReader, Read, Seek, SeekFrom};

use super::codec::flags_text;
use super::meta::{Meta, Metadata};
use super::{HALF_SUFFIX, MAGIC, NAME_SUFFIX};

/// Versions whose grid records are laid out as read here: flags per grid, scale maps with five vectors.
const VERSIONS: std::ops::RangeInclusive<u32> = 222..=225;

/// Why a file could not be listed.
#[derive(Debug, thiserror::Error)]
pub enum VdbReadError {
    /// The input failed.
    #[error(transparent)]
    Io(#[from] io::Error),
    /// The first bytes are not those of a VDB file.
    #[error("not a VDB file")]
    Magic,
    /// The file's version is not among those understood.
    #[error("VDB file version {0} is not supported (versions 222 to 225 are)")]
    Version(u32),
    /// The file has no offsets, so that grids cannot be skipped.
    #[error("VDB file without grid offsets is not supported")]
    NoOffsets,
    /// The file ends inside something it announces.
    #[error("truncated VDB file: {length} bytes at byte {offset} reach beyond the end")]
    Truncated {
        /// Where reading was.
        offset: u64,
        /// How many bytes were to follow.
        length: u64,
    },
    /// A number makes no sense.
    #[error("invalid VDB file: {what} at byte {offset}")]
    Invalid {
        /// What is wrong.
        what: &'static str,
        /// Where reading was.
        offset: u64,
    },
}

/// What a file holds.
#[derive(Debug, Clone, PartialEq)]
pub struct FileInfo {
    /// File format version.
    pub version: u32,
    /// Version of the library that wrote the file, major and minor.
    pub library: [u32; 2],
    /// The file's UUID as it stands there.
    pub uuid: String,
    /// File-level metadata.
    pub metadata: Metadata,
    /// The grids, in file order.
    pub grids: Vec<GridInfo>,
}

/// What a file says of one of its grids.
#[derive(Debug, Clone, PartialEq)]
pub struct GridInfo {
    /// The grid's name.
    pub name: String,
    /// The type of its tree, such as `Tree_float_5_4_3`.
    pub type_name: String,
    /// Whether its values are stored as binary16.
    pub half: bool,
    /// The grid whose tree it shares; empty for none.
    pub instance_of: String,
    /// Its compression in OpenVDB's words, such as `blosc + active values`.
    pub compression: String,
    /// Its metadata.
    pub metadata: Metadata,
    /// From index to world.
    pub map: Map,
    /// Bytes of its record without the descriptor.
    pub bytes: u64,
}

/// A grid's transform.
#[derive(Debug, Clone, PartialEq)]
pub struct Map {
    /// The map's type in the file.
    pub type_name: String,
    /// Rows of A in `world = A (i, j, k, 1)`; `None` for maps that are not affine, and unknown ones.
    pub matrix: Option<[[f64; 4]; 3]>,
}

/// Lists a file's grids, by jumping from one to the next.
///
/// Any input gives a result or an error: nothing is allocated beyond the file's length, nothing is read twice. Entries
/// of types that begin with `__`, which only serve loading, are left out.
///
/// # Errors
/// See [`VdbReadError`].
pub fn read_info(input: &mut (impl Read + Seek)) -> Result<FileInfo, VdbReadError> {
    let mut cursor = Cursor::new(input)?;
    if cursor.length < 8 || cursor.number(i64::from_le_bytes)? != MAGIC {
        return Err(VdbReadError::Magic);
    }
    let version = cursor.number(u32::from_le_bytes)?;
    if !VERSIONS.contains(&version) {
        return Err(VdbReadError::Version(version));
    }
    let library = [cursor.number(u32::from_le_bytes)?, cursor.number(u32::from_le_bytes)?];
    if cursor.number(u8::from_le_bytes)? == 0 {
        return Err(VdbReadError::NoOffsets);
    }
    let uuid = String::from_utf8_lossy(&cursor.bytes(36)?).into_owned();
    let metadata = cursor.metadata()?;
    let count = cursor.number(i32::from_le_bytes)?;
    if count < 0 {
        return Err(cursor.invalid("negative number of grids"));
    }
    let mut grids = vec![];
    for _ in 0..count {
        grids.push(cursor.grid()?);
    }
    Ok(FileInfo { version, library, uuid, metadata, grids })
}

/// A position in a file of known length.
struct Cursor<R> {
    input: BufReader<R>,
    position: u64,
    length: u64,
}

impl<R: Read + Seek> Cursor<R> {
    fn new(mut input: R) -> io::Result<Self> {
        let length = input.seek(SeekFrom::End(0))?;
        input.seek(SeekFrom::Start(0))?;
        Ok(Self { input: BufReader::new(input), position: 0, length })
    }

    fn invalid(&self, what: &'static str) -> VdbReadError {
        VdbReadError::Invalid { what, offset: self.position }
    }

    /// Checks that the file goes on for this many bytes.
    fn require(&self, length: u64) -> Result<(), VdbReadError> {
        if length > self.length.saturating_sub(self.position) {
            return Err(VdbReadError::Truncated { offset: self.position, length });
        }
        Ok(())
    }

    /// Moves forward to an absolute offset, never backward: that is why every loop here ends.
    fn jump(&mut self, offset: i64) -> Result<(), VdbReadError> {
        let ahead = u64::try_from(offset).ok().and_then(|offset| offset.checked_sub(self.position));
        let length = ahead.ok_or_else(|| self.invalid("offset that points backward"))?;
        self.require(length)?;
        self.input.seek_relative(i64::try_from(length).map_err(|_| self.invalid("offset"))?)?;
        self.position += length;
        Ok(())
    }

    fn bytes(&mut self, length: u32) -> Result<Vec<u8>, VdbReadError> {
        self.require(length.into())?;
        let mut bytes = vec![0; usize::try_from(length).map_err(|_| self.invalid("length"))?];
        self.input.read_exact(&mut bytes)?;
        self.position += u64::from(length);
        Ok(bytes)
    }

    fn number<T, const N: usize>(&mut self, from: impl Fn([u8; N]) -> T) -> Result<T, VdbReadError> {
        self.require(N as u64)?;
        let mut bytes = [0; N];
        self.input.read_exact(&mut bytes)?;
        self.position += N as u64;
        Ok(from(bytes))
    }

    fn text(&mut self) -> Result<String, VdbReadError> {
        let length = self.number(u32::from_le_bytes)?;
        Ok(String::from_utf8_lossy(&self.bytes(length)?).into_owned())
    }

    fn metadata(&mut self) -> Result<Metadata, VdbReadError> {
        let mut metadata = Metadata::new();
        for _ in 0..self.number(u32::from_le_bytes)? {
            let name = self.text()?;
            let type_name = self.text()?;
            let length = self.number(u32::from_le_bytes)?;
            let bytes = self.bytes(length)?;
            if !type_name.starts_with("__") {
                let value = Meta::from_bytes(&type_name, &bytes);
                metadata.insert(name, value.ok_or_else(|| self.invalid("metadata value of wrong size"))?);
            }
        }
        Ok(metadata)
    }

    fn grid(&mut self) -> Result<GridInfo, VdbReadError> {
        let unique_name = self.text()?;
        let type_name = self.text()?;
        let instance_of = self.text()?;
        let [data, _, end] = [(); 3].map(|()| self.number(i64::from_le_bytes));
        self.jump(data?)?;
        let start = self.position;
        let flags = self.number(u32::from_le_bytes)?;
        let metadata = self.metadata()?;
        let map = self.map()?;
        self.jump(end?)?;
        let name = match metadata.get("name") {
            Some(Meta::String(name)) => name.clone(),
            _ => unique_name.split(NAME_SUFFIX).next().unwrap_or_default().to_owned(),
        };
        Ok(GridInfo {
            name,
            type_name: type_name.strip_suffix(HALF_SUFFIX).unwrap_or(&type_name).to_owned(),
            half: type_name.ends_with(HALF_SUFFIX),
            instance_of,
            compression: flags_text(flags),
            metadata,
            map,
            bytes: self.position - start,
        })
    }

    fn map(&mut self) -> Result<Map, VdbReadError> {
        let type_name = self.text()?;
        let matrix = match type_name.as_str() {
            "UniformScaleMap" | "ScaleMap" => {
                let scale = self.doubles()?;
                self.bytes(96)?;
                Some(scale_translate(scale, [0.0; 3]))
            }
            "UniformScaleTranslateMap" | "ScaleTranslateMap" => {
                let translation = self.doubles()?;
                let scale = self.doubles()?;
                self.bytes(96)?;
                Some(scale_translate(scale, translation))
            }
            "TranslationMap" => Some(scale_translate([1.0; 3], self.doubles()?)),
            "AffineMap" | "UnitaryMap" => {
                // The file's vectors are rows: its translation is the last row, ours the last column.
                let stored: [f64; 16] = self.doubles()?;
                Some([0, 1, 2].map(|row| [0, 1, 2, 3].map(|column| stored[4 * column + row])))
            }
            _ => None,
        };
        Ok(Map { type_name, matrix })
    }

    fn doubles<const N: usize>(&mut self) -> Result<[f64; N], VdbReadError> {
        let mut numbers = [0.0; N];
        for number in &mut numbers {
            *number = self.number(f64::from_le_bytes)?;
        }
        Ok(numbers)
    }
}

fn scale_translate([x, y, z]: [f64; 3], [tx, ty, tz]: [f64; 3]) -> [[f64; 4]; 3] {
    [[x, 0.0, 0.0, tx], [0.0, y, 0.0, ty], [0.0, 0.0, z, tz]]
}
