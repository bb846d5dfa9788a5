//! A position in a file of known length, that never reads or allocates beyond it.

use std::io::{self, BufReader, Read, Seek, SeekFrom};

use super::error::{VdbReadError, no_memory};

/// Bytes that are asked for at once.
const BUFFER: usize = 64 << 10;

/// A position in a file of known length.
pub(super) struct Cursor<R> {
    input: BufReader<R>,
    position: u64,
    end: u64,
}

impl<R: Read + Seek> Cursor<R> {
    pub(super) fn new(mut input: R) -> io::Result<Self> {
        let end = input.seek(SeekFrom::End(0))?;
        input.seek(SeekFrom::Start(0))?;
        Ok(Self { input: BufReader::with_capacity(BUFFER, input), position: 0, end })
    }

    pub(super) fn position(&self) -> u64 {
        self.position
    }

    /// Where what is read has to end: the file's end, unless set.
    pub(super) fn end(&self) -> u64 {
        self.end
    }

    pub(super) fn set_end(&mut self, end: u64) {
        self.end = end;
    }

    pub(super) fn remaining(&self) -> u64 {
        self.end.saturating_sub(self.position)
    }

    pub(super) fn invalid(&self, what: &'static str) -> VdbReadError {
        VdbReadError::Invalid { what, offset: self.position }
    }

    /// Checks that the file goes on for this many bytes.
    pub(super) fn require(&self, length: u64) -> Result<(), VdbReadError> {
        if length > self.remaining() {
            return Err(VdbReadError::Truncated { offset: self.position, length });
        }
        Ok(())
    }

    /// Checks that the file goes on for `count` times `length` bytes.
    pub(super) fn require_all(&self, count: usize, length: usize) -> Result<(), VdbReadError> {
        self.require((count as u64).saturating_mul(length as u64))
    }

    /// Moves forward to an absolute offset, never backward: that is why every loop over grids ends.
    pub(super) fn jump(&mut self, offset: i64) -> Result<(), VdbReadError> {
        let ahead = u64::try_from(offset).ok().and_then(|offset| offset.checked_sub(self.position));
        let length = ahead.ok_or_else(|| self.invalid("offset that points backward"))?;
        self.skip(length)
    }

    pub(super) fn skip(&mut self, length: u64) -> Result<(), VdbReadError> {
        self.require(length)?;
        self.input.seek_relative(i64::try_from(length).map_err(|_| self.invalid("offset"))?)?;
        self.advance(length);
        Ok(())
    }

    /// Moves to an offset where this cursor has been.
    pub(super) fn back_to(&mut self, offset: u64) -> Result<(), VdbReadError> {
        self.input.seek(SeekFrom::Start(offset))?;
        self.position = offset;
        Ok(())
    }

    /// Appends bytes to those in `out`.
    pub(super) fn append(&mut self, length: usize, out: &mut Vec<u8>) -> Result<(), VdbReadError> {
        self.require(length as u64)?;
        let start = out.len();
        out.try_reserve(length).map_err(|_| no_memory())?;
        out.resize(start.saturating_add(length), 0);
        if let Some(added) = out.get_mut(start..) {
            self.input.read_exact(added)?;
        }
        self.advance(length as u64);
        Ok(())
    }

    /// Notes what was read; it was required before.
    fn advance(&mut self, length: u64) {
        self.position = self.position.saturating_add(length);
    }

    pub(super) fn bytes(&mut self, length: u32) -> Result<Vec<u8>, VdbReadError> {
        let mut bytes = vec![];
        self.append(usize::try_from(length).map_err(|_| self.invalid("length"))?, &mut bytes)?;
        Ok(bytes)
    }

    pub(super) fn number<T, const N: usize>(
        &mut self,
        from: impl Fn([u8; N]) -> T,
    ) -> Result<T, VdbReadError> {
        self.require(N as u64)?;
        let mut bytes = [0; N];
        self.input.read_exact(&mut bytes)?;
        self.advance(N as u64);
        Ok(from(bytes))
    }

    pub(super) fn text(&mut self) -> Result<String, VdbReadError> {
        let length = self.number(u32::from_le_bytes)?;
        Ok(String::from_utf8_lossy(&self.bytes(length)?).into_owned())
    }

    pub(super) fn doubles<const N: usize>(&mut self) -> Result<[f64; N], VdbReadError> {
        let mut numbers = [0.0; N];
        for number in &mut numbers {
            *number = self.number(f64::from_le_bytes)?;
        }
        Ok(numbers)
    }

    /// An index of three signed coordinates.
    pub(super) fn index(&mut self) -> Result<[i32; 3], VdbReadError> {
        let [x, y, z] = [(); 3].map(|()| self.number(i32::from_le_bytes));
        Ok([x?, y?, z?])
    }

    /// Replaces `words` by a mask of this many words.
    pub(super) fn mask(&mut self, words: &mut [u64]) -> Result<(), VdbReadError> {
        self.require_all(words.len(), 8)?;
        for word in words {
            *word = self.number(u64::from_le_bytes)?;
        }
        Ok(())
    }
}
