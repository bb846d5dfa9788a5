//! What a file says of itself and of its grids, before any voxel.

use std::io::{Read, Seek};

use super::super::codec::flags_text;
use super::super::meta::{Meta, Metadata};
use super::super::{HALF_SUFFIX, MAGIC, NAME_SUFFIX};
use super::cursor::Cursor;
use super::error::VdbReadError;

/// Versions whose grid records are laid out as read here: flags per grid, a code per node, scale maps with five vectors.
const VERSIONS: std::ops::RangeInclusive<u32> = 222..=225;

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
    /// Grids that the file has besides: without offsets nothing behind a grid of an unknown type can be found, and nothing
    /// where the file breaks off.
    pub out_of_reach: usize,
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

/// What a file says before its grids, and how many they are.
pub(super) fn file_header<R: Read + Seek>(
    cursor: &mut Cursor<R>,
) -> Result<(FileInfo, bool, i32), VdbReadError> {
    if cursor.remaining() < 8 || cursor.number(i64::from_le_bytes)? != MAGIC {
        return Err(VdbReadError::Magic);
    }
    let version = cursor.number(u32::from_le_bytes)?;
    if !VERSIONS.contains(&version) {
        return Err(VdbReadError::Version(version));
    }
    let library = [cursor.number(u32::from_le_bytes)?, cursor.number(u32::from_le_bytes)?];
    let has_offsets = cursor.number(u8::from_le_bytes)? != 0;
    let uuid = String::from_utf8_lossy(&cursor.bytes(36)?).into_owned();
    let metadata = metadata(cursor)?;
    let count = cursor.number(i32::from_le_bytes)?;
    if count < 0 {
        return Err(cursor.invalid("negative number of grids"));
    }
    Ok((FileInfo { version, library, uuid, metadata, grids: vec![], out_of_reach: 0 }, has_offsets, count))
}

/// What loading a grid takes, besides what there is to say of it.
#[derive(Debug, Clone)]
pub(super) struct Record {
    pub(super) unique_name: String,
    /// Compression flags.
    pub(super) flags: u32,
    /// Whether values are stored as binary16: the metadata's word, as in OpenVDB, not that of the type's name.
    pub(super) half: bool,
    /// Whether the type of its map is known, so that its topology can be found.
    pub(super) known_map: bool,
    /// Where its topology begins.
    pub(super) topology: u64,
    /// One past its last byte; 0 while that is not known.
    pub(super) end: u64,
}

/// Reads a grid's descriptor, metadata and transform: what comes before its topology. Whether the file goes on until its end is
/// the caller's to check.
pub(super) fn grid_header<R: Read + Seek>(
    cursor: &mut Cursor<R>,
    has_offsets: bool,
) -> Result<(GridInfo, Record), VdbReadError> {
    let unique_name = cursor.text()?;
    let type_name = cursor.text()?;
    let instance_of = cursor.text()?;
    let [data, _, end] = [(); 3].map(|()| cursor.number(i64::from_le_bytes));
    let (data, end) = (data?, end?);
    if has_offsets {
        cursor.jump(data)?;
    }
    let start = cursor.position();
    let flags = cursor.number(u32::from_le_bytes)?;
    let metadata = metadata(cursor)?;
    let (map, known_map) = map(cursor)?;
    let topology = cursor.position();
    // Without offsets the caller finds the end.
    let end = if has_offsets {
        let end = u64::try_from(end).ok().filter(|end| *end >= topology);
        end.ok_or_else(|| cursor.invalid("offset that points backward"))?
    } else {
        0
    };
    let name = match metadata.get("name") {
        Some(Meta::String(name)) => name.clone(),
        _ => unique_name.split(NAME_SUFFIX).next().unwrap_or_default().to_owned(),
    };
    let suffix = type_name.ends_with(HALF_SUFFIX);
    let half = match metadata.get("is_saved_as_half_float") {
        Some(Meta::Bool(half)) => *half,
        _ => suffix,
    };
    let info = GridInfo {
        name,
        type_name: type_name.strip_suffix(HALF_SUFFIX).unwrap_or(&type_name).to_owned(),
        half: suffix,
        instance_of,
        compression: flags_text(flags),
        metadata,
        map,
        bytes: if has_offsets { end.saturating_sub(start) } else { start },
    };
    Ok((info, Record { unique_name, flags, half, known_map, topology, end }))
}

fn metadata<R: Read + Seek>(cursor: &mut Cursor<R>) -> Result<Metadata, VdbReadError> {
    let mut metadata = Metadata::new();
    for _ in 0..cursor.number(u32::from_le_bytes)? {
        let name = cursor.text()?;
        let type_name = cursor.text()?;
        let length = cursor.number(u32::from_le_bytes)?;
        let bytes = cursor.bytes(length)?;
        if !type_name.starts_with("__") {
            let value = Meta::from_bytes(&type_name, &bytes);
            metadata.insert(name, value.ok_or_else(|| cursor.invalid("metadata value of wrong size"))?);
        }
    }
    Ok(metadata)
}

/// A map, and whether its type is known.
fn map<R: Read + Seek>(cursor: &mut Cursor<R>) -> Result<(Map, bool), VdbReadError> {
    let type_name = cursor.text()?;
    let mut known = true;
    let matrix = match type_name.as_str() {
        "UniformScaleMap" | "ScaleMap" => {
            let scale = cursor.doubles()?;
            cursor.skip(96)?;
            Some(scale_translate(scale, [0.0; 3]))
        }
        "UniformScaleTranslateMap" | "ScaleTranslateMap" => {
            let translation = cursor.doubles()?;
            let scale = cursor.doubles()?;
            cursor.skip(96)?;
            Some(scale_translate(scale, translation))
        }
        "TranslationMap" => Some(scale_translate([1.0; 3], cursor.doubles()?)),
        "AffineMap" | "UnitaryMap" => {
            // The file's vectors are rows: its translation is the last row, ours the last column.
            let [x, y, z, t] = [(); 4].map(|()| cursor.doubles());
            let columns = [x?, y?, z?, t?].map(|[x, y, z, _]: [f64; 4]| [x, y, z]);
            Some(from_columns(columns))
        }
        "NonlinearFrustumMap" => {
            // Box, taper and depth, then the linear map behind the frustum. Not affine, but what follows can be read.
            cursor.skip(8 * 8)?;
            known = cursor.text()? == "AffineMap";
            if known {
                cursor.skip(16 * 8)?;
            }
            None
        }
        _ => {
            known = false;
            None
        }
    };
    Ok((Map { type_name, matrix }, known))
}

fn scale_translate([x, y, z]: [f64; 3], translation: [f64; 3]) -> [[f64; 4]; 3] {
    from_columns([[x, 0.0, 0.0], [0.0, y, 0.0], [0.0, 0.0, z], translation])
}

fn from_columns([x, y, z, t]: [[f64; 3]; 4]) -> [[f64; 4]; 3] {
    let ([xx, xy, xz], [yx, yy, yz], [zx, zy, zz], [tx, ty, tz]) = (x, y, z, t);
    [[xx, yx, zx, tx], [xy, yy, zy, ty], [xz, yz, zz, tz]]
}

#[cfg(test)]
mod tests {
    use super::super::super::tests::{ALL, bricks, build, file, file_header, grid_header, random};
    use super::super::super::{Compression, FileHeader, VdbGridBuilder, write};
    use std::io;

    use super::super::{Listing, list_grids, read_info};
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
            ("j".into(), Meta::Vec2i([1, -2])),
            ("k".into(), Meta::Vec2s([0.1, -0.2])),
            ("l".into(), Meta::Vec2d([0.1, -0.2])),
            ("m".into(), Meta::Vec4i([1, -2, 3, i32::MIN])),
            ("n".into(), Meta::Vec4s([0.1, 0.2, 0.3, -0.4])),
            ("o".into(), Meta::Vec4d([0.1, 0.2, 0.3, -0.4])),
            ("p".into(), Meta::Mat4s([[1.0, 2.0, 3.0, 4.0], [0.1; 4], [0.2; 4], [-0.3; 4]])),
            ("q".into(), Meta::Mat4d([[1.0, 2.0, 3.0, 4.0], [0.1; 4], [0.2; 4], [-0.3; 4]])),
            ("r".into(), Meta::Other { type_name: "half".into(), bytes: vec![7; 2] }),
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
        assert!(matches!(patched(60, 0xff), Some(VdbReadError::Truncated { .. })));
        for end in 8..bytes.len() {
            assert!(matches!(read(&bytes[..end]).err(), Some(VdbReadError::Truncated { .. })), "{end}");
        }
    }

    #[test]
    fn a_file_that_breaks_off_lists_what_comes_before() {
        let [first, second] = [0, 4].map(|at| build(Compression::Zip, &bricks()[at..at + 4]));
        let mut bytes = file(&[(&grid_header("first"), &first), (&grid_header("second"), &second)]);
        let at =
            |name: &[u8]| bytes.windows(name.len()).position(|found| found == name).expect("it is there");
        let (maps, middle) = (at(b"UniformScaleTranslateMap"), at(b"second") - 4);
        let trees: Vec<usize> = (0..bytes.len()).filter(|at| bytes[*at..].starts_with(b"Tree_")).collect();
        for offsets in [true, false] {
            if !offsets {
                bytes[20] = 0;
                for tree in &trees {
                    bytes[tree + 20..tree + 44].fill(0);
                }
            }
            let whole = read(&bytes).expect("valid");
            for end in (maps + 200..bytes.len()).step_by(7) {
                let Listing { info, whole: count, error } =
                    list_grids(io::Cursor::new(&bytes[..end]), u64::MAX).expect("a whole header");
                assert!(matches!(error, Some(VdbReadError::Truncated { .. })), "{end}: {error:?}");
                assert_eq!(count, usize::from(end >= middle), "{end}");
                assert_eq!(info.grids[..count], whole.grids[..count]);
                assert_eq!(info.grids.len() + info.out_of_reach, 2);
                // Enough of the second grid for its map.
                assert!(end < middle + 1000 || info.grids[1].map == whole.grids[1].map);
            }
        }
        let listing = list_grids(io::Cursor::new(&bytes), u64::MAX).expect("valid");
        assert!((listing.whole, listing.info.out_of_reach) == (2, 0) && listing.error.is_none());
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
