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
/// Any input gives a result or an error: nothing is allocated beyond a small factor of the file's length, nothing is
/// read twice. Entries of types that begin with `__`, which only serve loading, are left out.
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

#[cfg(test)]
mod tests {
    use super::super::tests::{ALL, bricks, build, file, file_header, grid_header, random};
    use super::super::{Compression, FileHeader, VdbGridBuilder, write};
    use super::*;

    fn read(bytes: &[u8]) -> Result<FileInfo, VdbReadError> {
        read_info(&mut io::Cursor::new(bytes))
    }

    #[test]
    fn info_is_what_was_written() {
        for compression in ALL {
            let grid = build(compression, &bricks());
            let empty = VdbGridBuilder::new(compression);
            let bytes = file(&[(&grid_header("density"), &grid), (&grid_header("heat"), &empty)]);
            let info = read(&bytes).expect("valid");
            assert_eq!((info.version, info.library), (224, [10, 0]));
            assert_eq!(info.uuid, file_header().uuid.to_string());
            assert_eq!(info.metadata, file_header().metadata);
            let [density, heat] = &info.grids[..] else { panic!("two grids") };
            assert_eq!((&density.name[..], &heat.name[..]), ("density", "heat"));
            assert_eq!((&density.type_name[..], density.half), ("Tree_float_5_4_3", false));
            assert_eq!(density.map.type_name, "UniformScaleTranslateMap");
            let matrix = [[0.1, 0.0, 0.0, 1.0], [0.0, 0.1, 0.0, -2.0], [0.0, 0.0, 0.1, 0.05]];
            assert_eq!(density.map.matrix, Some(matrix));
            let stats = grid.stats();
            let [low, high] = stats.bounds.expect("not empty");
            let voxels = i64::try_from(stats.active_voxels).expect("fits");
            assert_eq!(density.metadata["file_bbox_min"], Meta::Vec3i(low));
            assert_eq!(density.metadata["file_bbox_max"], Meta::Vec3i(high));
            assert_eq!(density.metadata["file_voxel_count"], Meta::Int64(voxels));
            assert_eq!(density.metadata["class"], "fog volume".into());
            assert_eq!(density.metadata["content_hash"], "abc".into());
            assert_eq!(density.metadata["file_compression"], density.compression[..].into());
            assert!(density.bytes > grid.encoded_bytes() && heat.bytes < 1000);
        }
    }

    #[test]
    fn every_metadata_type_survives() {
        let metadata = Metadata::from([
            ("a".into(), "\u{e9}".into()),
            ("b".into(), Meta::Bool(true)),
            ("c".into(), Meta::Int32(-1)),
            ("d".into(), Meta::Int64(i64::MIN)),
            ("e".into(), Meta::Float(0.1)),
            ("f".into(), Meta::Double(-0.1)),
            ("g".into(), Meta::Vec3i([1, -2, 3])),
            ("h".into(), Meta::Vec3s([0.1, 0.2, 0.3])),
            ("i".into(), Meta::Vec3d([0.1, 0.2, 0.3])),
            ("j".into(), Meta::Other { type_name: "mat4d".into(), bytes: vec![7; 128] }),
        ]);
        let mut bytes = vec![];
        let header = FileHeader { metadata: metadata.clone(), ..file_header() };
        write(&mut bytes, &header, &[]).expect("valid");
        assert_eq!(read(&bytes).expect("valid").metadata, metadata);
    }

    /// The file with one grid's map replaced.
    fn with_map(type_name: &str, numbers: &[f64]) -> Vec<u8> {
        let bytes = file(&[(&grid_header("a"), &VdbGridBuilder::new(Compression::None))]);
        let text = b"UniformScaleTranslateMap";
        let at = bytes.windows(text.len()).position(|w| w == text).expect("the map") - 4;
        let mut map = vec![u8::try_from(type_name.len()).expect("short"), 0, 0, 0];
        map.extend(type_name.as_bytes());
        map.extend(numbers.iter().flat_map(|n| n.to_le_bytes()));
        map.resize(172, 0);
        [&bytes[..at], &map, &bytes[at + 172..]].concat()
    }

    #[test]
    fn maps_become_matrices_of_columns() {
        let map = |name, numbers: &[f64]| read(&with_map(name, numbers)).expect("valid").grids[0].map.matrix;
        let scale = [[2.0, 0.0, 0.0, 0.0], [0.0, 3.0, 0.0, 0.0], [0.0, 0.0, 4.0, 0.0]];
        assert_eq!(map("ScaleMap", &[2.0, 3.0, 4.0]), Some(scale));
        let moved = [[1.0, 0.0, 0.0, 2.0], [0.0, 1.0, 0.0, 3.0], [0.0, 0.0, 1.0, 4.0]];
        assert_eq!(map("TranslationMap", &[2.0, 3.0, 4.0]), Some(moved));
        // Rows as stored: image of x, of y, of z, translation.
        let stored = [1.0, 2.0, 3.0, 0.0, 4.0, 5.0, 6.0, 0.0, 7.0, 8.0, 9.0, 0.0, 10.0, 11.0, 12.0, 1.0];
        let matrix = [[1.0, 4.0, 7.0, 10.0], [2.0, 5.0, 8.0, 11.0], [3.0, 6.0, 9.0, 12.0]];
        assert_eq!(map("AffineMap", &stored), Some(matrix));
        assert_eq!(map("NonlinearFrustumMap", &[]), None);
    }

    #[test]
    fn errors_say_what_is_wrong() {
        let bytes = file(&[(&grid_header("a"), &VdbGridBuilder::new(Compression::None))]);
        let patched = |at: usize, value: u8| {
            let mut bytes = bytes.clone();
            bytes[at] = value;
            read(&bytes).err()
        };
        assert!(matches!(read(b"").err(), Some(VdbReadError::Magic)));
        assert!(matches!(read(b"#EXODUS II format").err(), Some(VdbReadError::Magic)));
        assert!(matches!(patched(8, 219), Some(VdbReadError::Version(219))));
        assert!(matches!(patched(20, 0), Some(VdbReadError::NoOffsets)));
        assert!(matches!(patched(60, 0xff), Some(VdbReadError::Truncated { .. })));
        for end in 8..bytes.len() {
            assert!(matches!(read(&bytes[..end]).err(), Some(VdbReadError::Truncated { .. })), "{end}");
        }
    }

    #[test]
    fn mutations_never_panic() {
        let mut state = 5;
        let grids = ALL.map(|compression| build(compression, &bricks()[900..904]));
        let names = ["a", "b", "c"].map(grid_header);
        let original = file(&[(&names[0], &grids[0]), (&names[1], &grids[1]), (&names[2], &grids[2])]);
        assert!(read(&original).is_ok());
        let headers: Vec<usize> =
            (0..original.len()).filter(|at| original[*at..].starts_with(b"Tree_")).collect();
        let mut below = |bound: usize| usize::try_from(random(&mut state) % bound as u64).expect("in range");
        let mut failures = 0;
        for _ in 0..2000 {
            let mut bytes = original.clone();
            for _ in 0..=below(4) {
                // Mostly where structure is: the file's header and the grids' descriptors and metadata.
                let start =
                    [0, 0, headers[0] - 20, headers[1] - 20, headers[2] - 20, below(bytes.len())][below(6)];
                let at = (start + below(600)).min(bytes.len() - 1);
                bytes[at] = [0, 1, 0x7f, 0x80, 0xff, bytes[at] ^ (1 << below(8))][below(6)];
            }
            if below(4) == 0 {
                bytes.truncate(below(bytes.len()));
            }
            failures += usize::from(read(&bytes).is_err());
        }
        assert!(failures > 500, "only {failures} mutations were noticed");
    }
}
