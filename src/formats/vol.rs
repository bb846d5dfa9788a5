//! Dense grids for Mitsuba's `gridvolume`: `.vol` files of version 3.
//!
//! Little-endian: the bytes `VOL` and 3; as `i32` 1 (32-bit floats), the numbers of cells along x, y and z, and of channels;
//! as `f32` the box's low corner and its high one; then the values as `f32`, channels next to each other, x fastest, then y,
//! then z. A value belongs to the centre of its cell, and the cells share the box evenly.

use std::io::{self, Write};

/// What a file says of its values.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct VolHeader {
    /// Cells along x, y and z, at least 1.
    pub size: [usize; 3],
    /// Numbers in a cell: 1, 3 or 6.
    pub channels: usize,
    /// Two corners of the box of all cells, in metres.
    pub bounds: [[f64; 3]; 2],
}

/// Why there is no file.
#[derive(Debug, thiserror::Error)]
pub enum VolError {
    /// More cells along an axis than the format can count, or none.
    #[error("{0} x {1} x {2} cells are none or more than a .vol file can count")]
    Size(usize, usize, usize),
    /// A number of channels that the format does not know.
    #[error("a .vol file has 1, 3 or 6 channels, not {0}")]
    Channels(usize),
    /// Corners that no `f32` tells apart or can hold.
    #[error("the box {0:?} to {1:?} m cannot be told in a .vol file")]
    Bounds([f64; 3], [f64; 3]),
    /// A plane that is not of the size that the header tells, or one too many or too few.
    #[error("the values are not as many as the header says")]
    Count,
    /// The output's.
    #[error(transparent)]
    Io(#[from] io::Error),
}

impl VolHeader {
    /// Bytes of the file; saturating.
    pub fn bytes(&self) -> u64 {
        let factors = self.size.into_iter().chain([self.channels, 4]);
        factors.fold(1_u64, |bytes, factor| bytes.saturating_mul(factor as u64)).saturating_add(HEADER as u64)
    }

    /// Values of a plane across z.
    pub fn plane(&self) -> usize {
        self.size[0].saturating_mul(self.size[1]).saturating_mul(self.channels)
    }

    fn encode(&self) -> Result<Vec<u8>, VolError> {
        let [x, y, z] = self.size;
        let mut bytes = b"VOL\x03".to_vec();
        bytes.extend(1_i32.to_le_bytes());
        for side in self.size {
            let side = i32::try_from(side).ok().filter(|side| *side > 0).ok_or(VolError::Size(x, y, z))?;
            bytes.extend(side.to_le_bytes());
        }
        let channels: i32 = match self.channels {
            1 => 1,
            3 => 3,
            6 => 6,
            other => return Err(VolError::Channels(other)),
        };
        bytes.extend(channels.to_le_bytes());
        #[allow(
            clippy::cast_possible_truncation,
            reason = "to the nearest, which is all that the format has"
        )]
        let corners = self.bounds.map(|corner| corner.map(|c| c as f32));
        let has_room =
            |i: usize| corners[0][i] < corners[1][i] && (corners[1][i] - corners[0][i]).is_finite();
        if !(0..3).all(has_room) {
            return Err(VolError::Bounds(self.bounds[0], self.bounds[1]));
        }
        bytes.extend(corners.as_flattened().iter().flat_map(|c| c.to_le_bytes()));
        debug_assert_eq!(bytes.len(), HEADER);
        Ok(bytes)
    }
}

/// Bytes before the first value.
const HEADER: usize = 48;

/// Writes a file plane by plane.
#[derive(Debug)]
pub struct VolWriter<W> {
    out: W,
    header: VolHeader,
    planes: usize,
}

impl<W: Write> VolWriter<W> {
    /// Writes the header.
    ///
    /// # Errors
    ///
    /// [`VolError`].
    pub fn new(mut out: W, header: VolHeader) -> Result<VolWriter<W>, VolError> {
        out.write_all(&header.encode()?)?;
        Ok(VolWriter { out, header, planes: 0 })
    }

    /// Writes the next plane across z, from the lowest: channels next to each other, then x, then y.
    ///
    /// # Errors
    ///
    /// [`VolError`].
    pub fn plane(&mut self, values: &[f32]) -> Result<(), VolError> {
        if values.len() != self.header.plane() || self.planes == self.header.size[2] {
            return Err(VolError::Count);
        }
        let mut bytes = [0; 4096];
        for values in values.chunks(bytes.len() / 4) {
            for (word, value) in bytes.as_chunks_mut::<4>().0.iter_mut().zip(values) {
                *word = value.to_le_bytes();
            }
            self.out.write_all(&bytes[..4 * values.len()])?;
        }
        self.planes += 1;
        Ok(())
    }

    /// What was written to, once all planes are.
    ///
    /// # Errors
    ///
    /// [`VolError`].
    pub fn finish(mut self) -> Result<W, VolError> {
        if self.planes < self.header.size[2] {
            return Err(VolError::Count);
        }
        self.out.flush()?;
        Ok(self.out)
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "what is not there fails the test")]

    use super::*;

    const HEADER_OF: VolHeader =
        VolHeader { size: [3, 2, 2], channels: 1, bounds: [[-1.0, 0.0, 0.5], [2.0, 2.0, 2.5]] };

    #[test]
    fn a_file_is_the_bytes_that_the_format_says() {
        let mut writer = VolWriter::new(Vec::new(), HEADER_OF).unwrap();
        writer.plane(&[0.0, 1.0, 2.0, 3.0, 4.0, 5.0]).unwrap();
        writer.plane(&[6.0, 7.0, 8.0, 9.0, 10.0, 11.0]).unwrap();
        let bytes = writer.finish().unwrap();
        assert_eq!(bytes.len() as u64, HEADER_OF.bytes());
        assert_eq!(bytes[..4], *b"VOL\x03");
        let integers: Vec<_> = bytes[4..24].as_chunks().0.iter().map(|b| i32::from_le_bytes(*b)).collect();
        assert_eq!(integers, [1, 3, 2, 2, 1]);
        let floats: Vec<_> = bytes[24..].as_chunks().0.iter().map(|b| f32::from_le_bytes(*b)).collect();
        assert_eq!(floats[..6], [-1.0, 0.0, 0.5, 2.0, 2.0, 2.5]);
        assert!((0..12_u8).all(|i| floats[6 + usize::from(i)] == f32::from(i)));
    }

    #[test]
    fn long_planes_are_written_whole() {
        let header = VolHeader { size: [100, 41, 1], channels: 3, ..HEADER_OF };
        let values: Vec<f32> = (0..12_300_u16).map(f32::from).collect();
        let mut writer = VolWriter::new(Vec::new(), header).unwrap();
        writer.plane(&values).unwrap();
        let bytes = writer.finish().unwrap();
        let found: Vec<_> = bytes[48..].as_chunks().0.iter().map(|b| f32::from_le_bytes(*b)).collect();
        assert_eq!(found, values);
    }

    #[test]
    fn what_the_format_cannot_hold_is_refused() {
        let refused = |header: VolHeader| VolWriter::new(Vec::new(), header).err();
        let vast = VolHeader { size: [1 << 31, 1, 1], ..HEADER_OF };
        assert!(matches!(refused(vast), Some(VolError::Size(..))));
        assert!(matches!(refused(VolHeader { size: [0, 1, 1], ..HEADER_OF }), Some(VolError::Size(..))));
        assert!(matches!(refused(VolHeader { channels: 2, ..HEADER_OF }), Some(VolError::Channels(2))));
        for corner in [[f64::NAN, 1.0, 1.0], [1e300, 1.0, 1.0], [-1.0, 3.0, 3.0]] {
            let header = VolHeader { bounds: [HEADER_OF.bounds[0], corner], ..HEADER_OF };
            assert!(matches!(refused(header), Some(VolError::Bounds(..))), "{corner:?}");
        }
        let mut writer = VolWriter::new(Vec::new(), HEADER_OF).unwrap();
        assert!(matches!(writer.plane(&[0.0; 5]), Err(VolError::Count)));
        assert!(matches!(writer.finish(), Err(VolError::Count)));
    }
}
