//! The file around the trees: header, and grid descriptors with exact offsets.

use std::io::{self, BufWriter, Write};

use uuid::Uuid;

use super::codec::Encoder;
use super::grid::{GridHeader, grid_head, type_name};
use super::meta::{Metadata, put_metadata, put_str};
use super::topology::Topology;
use super::voxel::Voxel;
use super::{LIBRARY, MAGIC, NAME_SUFFIX, VERSION};

/// Masks of leaves, of 64 bytes each, are written so many bytes at a time: in pieces of 8 KiB a file system may take five times
/// as long.
const BUFFER: usize = 128 << 10;

/// Why a file could not be written.
#[derive(Debug, thiserror::Error)]
pub enum VdbWriteError {
    /// The output failed.
    #[error(transparent)]
    Io(#[from] io::Error),
    /// The spool failed: it took no more, or did not give back what was put there.
    #[error("cannot use the spool for encoded leaves")]
    Spool(#[source] io::Error),
    /// The system has no more memory for the grid.
    #[error("the system has no more memory for it beyond the {bytes} bytes that one of its lists holds")]
    Memory {
        /// Bytes of the list that had no room.
        bytes: u64,
    },
    /// A brick's origin is not a multiple of 8.
    #[error("brick at {origin:?}: origins are multiples of 8")]
    Misaligned {
        /// The brick's origin.
        origin: [i32; 3],
    },
    /// A brick does not come after the one before it in the order of a file.
    #[error("brick at {origin:?} is out of file order, or there twice")]
    Order {
        /// The brick's origin.
        origin: [i32; 3],
    },
    /// Bricks were encoded with another compression or precision than that of the grid they were to be added to.
    #[error("bricks are encoded with another compression or precision than the grid's")]
    Encoder,
    /// A grid's name is empty, taken by another grid of the file, or holds the byte 0x1E.
    #[error("grid name {0:?} is empty, taken, or holds a control character")]
    GridName(String),
    /// A metadata name is empty or one that the writer sets itself.
    #[error("metadata name {0:?} is empty or reserved")]
    Metadata(String),
    /// The voxel size is not positive, or it or the translation is beyond what the format can hold.
    #[error("voxel size {voxel_size} with translation {translation:?} is no valid transform")]
    Transform {
        /// Edge of a voxel.
        voxel_size: f64,
        /// World position of index (0, 0, 0).
        translation: [f64; 3],
    },
    /// The file was finished with another number of grids than announced, or a further grid was added.
    #[error("the number of grids is not the one announced")]
    GridCount,
    /// The leaf buffers did not have the announced length. What was written is not a valid file.
    #[error("leaf buffers of {found} bytes where {expected} were announced")]
    BufferLength {
        /// Announced bytes.
        expected: u64,
        /// Bytes that came.
        found: u64,
    },
    /// Something exceeds the format's integers.
    #[error("{0} is too large for the file format")]
    TooLarge(&'static str),
}

/// What a file says of itself.
#[derive(Debug, Clone, PartialEq)]
pub struct FileHeader {
    /// Identity of the file's content.
    pub uuid: Uuid,
    /// File-level metadata.
    pub metadata: Metadata,
}

/// Writes a file from front to back; offsets are known before the bytes they point over.
pub struct FileWriter<W: Write> {
    out: Counted<BufWriter<W>>,
    names: Vec<String>,
    announced: usize,
}

impl<W: Write> FileWriter<W> {
    /// Writes the header of a file that will hold this number of grids.
    ///
    /// # Errors
    /// [`VdbWriteError::Io`], [`VdbWriteError::Metadata`], [`VdbWriteError::TooLarge`].
    pub fn new(out: W, header: &FileHeader, grids: usize) -> Result<Self, VdbWriteError> {
        let head = head(header, grids)?;
        let mut out = Counted { inner: BufWriter::with_capacity(BUFFER, out), bytes: 0 };
        out.write_all(&head)?;
        Ok(Self { out, names: vec![], announced: grids })
    }

    /// Writes a grid. `buffers` are slices that in sequence give the `buffer_bytes` bytes of all leaves as the encoder
    /// made them, in the topology's order; slices need not end where leaves do.
    ///
    /// # Errors
    /// All but the two about bricks. After an error the file is of no use.
    pub fn grid<T: Voxel, B: AsRef<[u8]>>(
        &mut self,
        header: &GridHeader,
        topology: &Topology<T>,
        encoder: Encoder,
        buffer_bytes: u64,
        buffers: impl IntoIterator<Item = B>,
    ) -> Result<(), VdbWriteError> {
        self.grid_with(header, topology, encoder, buffer_bytes, |out| {
            Ok(buffers.into_iter().try_for_each(|buffer| out.write_all(buffer.as_ref()))?)
        })
    }

    /// The same for leaves that `buffers` writes.
    pub(super) fn grid_with<T: Voxel>(
        &mut self,
        header: &GridHeader,
        topology: &Topology<T>,
        encoder: Encoder,
        buffer_bytes: u64,
        buffers: impl FnOnce(&mut dyn Write) -> Result<(), VdbWriteError>,
    ) -> Result<(), VdbWriteError> {
        if self.names.len() == self.announced {
            return Err(VdbWriteError::GridCount);
        }
        let name = &header.name;
        if name.is_empty() || name.contains(NAME_SUFFIX) || self.names.contains(name) {
            return Err(VdbWriteError::GridName(name.clone()));
        }
        self.names.push(name.clone());

        let nodes = topology.nodes();
        let head = grid_head::<T>(header, encoder, &nodes.stats())?;
        let above = nodes.file_bytes(encoder)?;

        let mut descriptor = vec![];
        put_str(&mut descriptor, name)?;
        put_str(&mut descriptor, &type_name::<T>(encoder))?;
        put_str(&mut descriptor, "")?;
        let mut position = self.out.bytes + descriptor.len() as u64 + 3 * 8;
        for length in [0, head.len() as u64 + above, buffer_bytes] {
            position = position.checked_add(length).ok_or(VdbWriteError::TooLarge("the file"))?;
            let offset = i64::try_from(position).map_err(|_| VdbWriteError::TooLarge("the file"))?;
            descriptor.extend(offset.to_le_bytes());
        }

        self.out.write_all(&descriptor)?;
        self.out.write_all(&head)?;
        nodes.write(encoder, &mut self.out)?;
        buffers(&mut self.out)?;
        if self.out.bytes != position {
            let start = position - buffer_bytes;
            return Err(VdbWriteError::BufferLength {
                expected: buffer_bytes,
                found: self.out.bytes - start,
            });
        }
        Ok(())
    }

    /// Flushes the output; returns the file's length in bytes.
    ///
    /// # Errors
    /// [`VdbWriteError::GridCount`] where grids are missing, [`VdbWriteError::Io`].
    pub fn finish(mut self) -> Result<u64, VdbWriteError> {
        if self.names.len() != self.announced {
            return Err(VdbWriteError::GridCount);
        }
        self.out.flush()?;
        Ok(self.out.bytes)
    }
}

/// The header of a file with so many grids.
pub(super) fn head(header: &FileHeader, grids: usize) -> Result<Vec<u8>, VdbWriteError> {
    let count = i32::try_from(grids).map_err(|_| VdbWriteError::TooLarge("the number of grids"))?;
    let mut head = vec![];
    head.extend(MAGIC.to_le_bytes());
    for number in [VERSION, LIBRARY[0], LIBRARY[1]] {
        head.extend(number.to_le_bytes());
    }
    head.push(1);
    head.extend(header.uuid.hyphenated().to_string().as_bytes());
    put_metadata(&mut head, &header.metadata)?;
    head.extend(count.to_le_bytes());
    Ok(head)
}

/// Counts what passes through.
pub(super) struct Counted<W> {
    pub(super) inner: W,
    pub(super) bytes: u64,
}

impl<W: Write> Write for Counted<W> {
    fn write(&mut self, buf: &[u8]) -> io::Result<usize> {
        let written = self.inner.write(buf)?;
        self.bytes += written as u64;
        Ok(written)
    }
    fn flush(&mut self) -> io::Result<()> {
        self.inner.flush()
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::{ALL, bricks, build, file, file_header, grid_header};
    use super::super::{Compression, Meta, VdbGridBuilder, WriteGrid, write};
    use super::*;

    fn i64_at(bytes: &[u8], at: usize) -> usize {
        i64::from_le_bytes(bytes[at..at + 8].try_into().expect("8")).try_into().expect("an offset")
    }

    #[test]
    fn header_is_laid_out_byte_by_byte() {
        let mut expected = b"\x20BDV\0\0\0\0\xe0\0\0\0\x0a\0\0\0\0\0\0\0\x01".to_vec();
        expected.extend(b"01234567-89ab-cdef-0011-223344556677");
        expected.extend(b"\x02\0\0\0");
        expected.extend(b"\x06\0\0\0answer\x05\0\0\0int32\x04\0\0\0\x2a\0\0\0");
        expected.extend(b"\x07\0\0\0creator\x06\0\0\0string\x04\0\0\0test");
        expected.extend(b"\0\0\0\0");
        assert_eq!(file(&[]), expected);
    }

    #[test]
    fn empty_grid_is_laid_out_byte_by_byte() {
        let bytes = file(&[(&grid_header("density"), &VdbGridBuilder::new(Compression::Blosc))]);
        let start = file(&[]).len();
        let mut descriptor = b"\x07\0\0\0density\x10\0\0\0Tree_float_5_4_3\0\0\0\0".to_vec();
        let data = start + descriptor.len() + 24;
        for offset in [data, bytes.len(), bytes.len()] {
            descriptor.extend((offset as u64).to_le_bytes());
        }
        assert_eq!(bytes[start..data], descriptor);
        assert_eq!(bytes[data..data + 8], [6, 0, 0, 0, 9, 0, 0, 0]);

        // Transform: t, s, |s|, 1/s, 1/s^2, 1/(2s); then one buffer, background 0, no tile, no child.
        let mut tail = b"\x18\0\0\0UniformScaleTranslateMap".to_vec();
        let inverse = 1.0 / 0.1;
        for value in [0.1, 0.1, inverse, inverse * inverse, inverse / 2.0] {
            tail.extend([value; 3].iter().flat_map(|c: &f64| c.to_le_bytes()));
        }
        tail.splice(28..28, [1.0_f64, -2.0, 0.05].iter().flat_map(|c| c.to_le_bytes()));
        tail.extend([1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0]);
        assert_eq!(bytes[bytes.len() - tail.len()..], tail);
    }

    #[test]
    fn offsets_point_at_buffers_and_the_next_grid() {
        for compression in ALL {
            let grid = build(compression, &bricks());
            let bytes = file(&[(&grid_header("a"), &grid), (&grid_header("b"), &grid)]);
            let first = file(&[]).len();
            let offsets = first + 5 + 20 + 4;
            let [data, buffers, end] = [0, 8, 16].map(|at| i64_at(&bytes, offsets + at));
            assert_eq!(data, offsets + 24);
            assert_eq!((end - buffers) as u64, grid.encoded_bytes());
            assert_eq!(bytes[end..end + 5], *b"\x01\0\0\0b");
            assert_eq!(i64_at(&bytes, end + offsets - first + 16), bytes.len());
        }
    }

    #[test]
    fn invalid_requests_are_errors() {
        let grid = VdbGridBuilder::new(Compression::None);
        let fails = |header: GridHeader| write(io::sink(), &file_header(), &[(&header, &grid)]).err();
        for voxel_size in [0.0, -1.0, f64::NAN, f64::INFINITY, 1e-200, 1e200] {
            let header = GridHeader { voxel_size, ..grid_header("a") };
            assert!(matches!(fails(header), Some(VdbWriteError::Transform { .. })), "{voxel_size}");
        }
        let header = GridHeader { translation: [0.0, f64::NAN, 0.0], ..grid_header("a") };
        assert!(matches!(fails(header), Some(VdbWriteError::Transform { .. })));
        for name in [
            "",
            "class",
            "name",
            "vector_type",
            "is_saved_as_half_float",
            "file_voxel_count",
            "file_delayed_load",
        ] {
            let mut header = grid_header("a");
            header.metadata.insert(name.to_owned(), Meta::Bool(true));
            assert!(matches!(fails(header), Some(VdbWriteError::Metadata(n)) if n == name));
        }
        assert!(matches!(fails(grid_header("")), Some(VdbWriteError::GridName(_))));
        assert!(matches!(fails(grid_header("a\u{1e}0")), Some(VdbWriteError::GridName(_))));
        let twice: [(&GridHeader, &dyn WriteGrid); 2] =
            [(&grid_header("a"), &grid), (&grid_header("a"), &grid)];
        assert!(matches!(write(io::sink(), &file_header(), &twice), Err(VdbWriteError::GridName(_))));
    }

    #[test]
    fn announcements_are_held() {
        let encoder = Encoder::new(Compression::None);
        let start = || FileWriter::new(io::sink(), &file_header(), 1).expect("header");
        assert!(matches!(start().finish(), Err(VdbWriteError::GridCount)));
        let mut writer = start();
        let short = writer.grid(&grid_header("a"), &Topology::<f32>::default(), encoder, 5, [[1, 2], [3, 4]]);
        assert!(matches!(short, Err(VdbWriteError::BufferLength { expected: 5, found: 4 })));
        let more = writer.grid(&grid_header("b"), &Topology::<f32>::default(), encoder, 0, [[]; 0]);
        assert!(matches!(more, Err(VdbWriteError::GridCount)));
    }

    #[test]
    fn offsets_are_64_bits_wide() {
        /// Keeps the beginning of what is written.
        struct Beginning(Vec<u8>);
        impl Write for Beginning {
            fn write(&mut self, buf: &[u8]) -> io::Result<usize> {
                let room = 4096_usize.saturating_sub(self.0.len()).min(buf.len());
                self.0.extend(&buf[..room]);
                Ok(buf.len())
            }
            fn flush(&mut self) -> io::Result<()> {
                Ok(())
            }
        }
        let (piece, pieces) = (vec![0; 1 << 24], 300);
        let length = (piece.len() * pieces) as u64;
        let encoder = Encoder::new(Compression::None);
        let mut beginning = Beginning(vec![]);
        let mut writer = FileWriter::new(&mut beginning, &file_header(), 1).expect("header");
        let buffers = std::iter::repeat_n(&piece, pieces);
        writer.grid(&grid_header("a"), &Topology::<f32>::default(), encoder, length, buffers).expect("grid");
        let total = writer.finish().expect("complete");
        let offsets = file(&[]).len() + 5 + 20 + 4;
        let [buffers, end] = [8, 16].map(|at| i64_at(&beginning.0, offsets + at) as u64);
        assert!(end == total && end - buffers == length && length > u64::from(u32::MAX));
    }
}
