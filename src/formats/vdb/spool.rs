//! Encoded leaves until the file is put together: in memory, and what has no room there in a spool.

use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom, Write};

use crc32fast::Hasher;
use memmap2::MmapMut;

use super::file::VdbWriteError;

/// Encoded bytes are kept in pieces of this size, so that growing never copies what is there: that of a huge page of most
/// systems.
pub(super) const PIECE: usize = 2 << 20;

/// Bytes that are read of a spool at once.
const READ: usize = 128 << 10;

/// Where encoded leaves wait that have no room in memory: a file, as a rule.
pub trait Spool: Send {
    /// Keeps bytes behind the first `at`.
    ///
    /// # Errors
    /// When they cannot be kept: the disk is full, for instance.
    fn put(&mut self, at: u64, bytes: &[u8]) -> io::Result<()>;

    /// The bytes that were put, from the first on.
    ///
    /// # Errors
    /// When they cannot be read.
    fn read(&self) -> io::Result<Box<dyn Read + '_>>;
}

impl Spool for File {
    fn put(&mut self, at: u64, bytes: &[u8]) -> io::Result<()> {
        self.seek(SeekFrom::Start(at))?;
        self.write_all(bytes)
    }

    fn read(&self) -> io::Result<Box<dyn Read + '_>> {
        let mut file = self;
        file.seek(SeekFrom::Start(0))?;
        Ok(Box::new(file))
    }
}

/// Bytes in sequence: the first in memory, those behind them in a spool if there is one, the last few in memory again.
#[derive(Default)]
pub(super) struct Buffers {
    pieces: Vec<Piece>,
    spool: Option<Spooled>,
}

struct Spooled {
    spool: Box<dyn Spool>,
    /// Pieces in memory before the spool is used: what comes then goes through the last of them.
    pieces: usize,
    bytes: u64,
    /// Checksum of them.
    sum: Hasher,
}

impl Buffers {
    /// At most `memory` bytes stay in memory, rounded down to whole pieces; but one piece does in any case.
    pub(super) fn with_spool(memory: u64, spool: Box<dyn Spool>) -> Buffers {
        let pieces = usize::try_from(memory / PIECE as u64).unwrap_or(usize::MAX).max(1);
        let spool = Some(Spooled { spool, pieces, bytes: 0, sum: Hasher::new() });
        Buffers { spool, ..Buffers::default() }
    }

    pub(super) fn push(&mut self, mut bytes: &[u8]) -> Result<(), VdbWriteError> {
        while !bytes.is_empty() {
            match self.pieces.last_mut() {
                Some(piece) if piece.used < PIECE => bytes = piece.fill(bytes),
                _ => self.make_room()?,
            }
        }
        Ok(())
    }

    /// Lets the last piece have room.
    fn make_room(&mut self) -> Result<(), VdbWriteError> {
        let held = self.pieces.len();
        match (&mut self.spool, self.pieces.last_mut()) {
            (Some(spooled), Some(last)) if held >= spooled.pieces => {
                spooled.spool.put(spooled.bytes, last.bytes()).map_err(VdbWriteError::Spool)?;
                spooled.bytes += last.used as u64;
                spooled.sum.update(last.bytes());
                last.used = 0;
            }
            _ => {
                let held = (held * PIECE) as u64;
                self.pieces.push(Piece::new().map_err(|_| VdbWriteError::Memory { bytes: held })?);
            }
        }
        Ok(())
    }

    /// Bytes in the spool.
    pub(super) fn spooled(&self) -> u64 {
        self.spool.as_ref().map_or(0, |spooled| spooled.bytes)
    }

    /// All bytes.
    pub(super) fn len(&self) -> u64 {
        self.spooled() + self.pieces.iter().map(|piece| piece.used as u64).sum::<u64>()
    }

    /// Writes all bytes in sequence.
    pub(super) fn write(&self, out: &mut dyn Write) -> Result<(), VdbWriteError> {
        let Some(Spooled { spool, bytes: spooled @ 1.., sum, .. }) = &self.spool else {
            return Ok(self.pieces.iter().try_for_each(|piece| out.write_all(piece.bytes()))?);
        };
        let (last, pieces) = self.pieces.split_last().expect("the spool is used once there are pieces");
        pieces.iter().try_for_each(|piece| out.write_all(piece.bytes()))?;
        let mut reader = spool.read().map_err(VdbWriteError::Spool)?.take(*spooled);
        let (mut buffer, mut found, mut check) = (vec![0; READ], 0, Hasher::new());
        loop {
            let count = match reader.read(&mut buffer) {
                Ok(0) => break,
                Ok(count) => count,
                Err(error) if error.kind() == io::ErrorKind::Interrupted => continue,
                Err(error) => return Err(VdbWriteError::Spool(error)),
            };
            out.write_all(&buffer[..count])?;
            check.update(&buffer[..count]);
            found += count as u64;
        }
        if found < *spooled {
            let text = format!("{found} of its {spooled} bytes are left");
            return Err(VdbWriteError::Spool(io::Error::new(io::ErrorKind::UnexpectedEof, text)));
        }
        if check.finalize() != sum.clone().finalize() {
            let text = "what it gives back is not what was put there";
            return Err(VdbWriteError::Spool(io::Error::new(io::ErrorKind::InvalidData, text)));
        }
        Ok(out.write_all(last.bytes())?)
    }
}

/// Memory for bytes, of which the first are used.
///
/// It comes from the system and not from the allocator, for the sake of huge pages: giving out memory page by page of 4 KiB
/// takes the system several times as long as copying a leaf there does.
struct Piece {
    memory: MmapMut,
    used: usize,
}

impl Piece {
    fn new() -> io::Result<Piece> {
        let memory = MmapMut::map_anon(PIECE)?;
        // A system that has none of them gives others.
        #[cfg(target_os = "linux")]
        let _ = memory.advise(memmap2::Advice::HugePage);
        Ok(Piece { memory, used: 0 })
    }

    /// Takes in as many of the bytes as there is room for; returns the rest.
    fn fill<'a>(&mut self, bytes: &'a [u8]) -> &'a [u8] {
        let room = &mut self.memory[self.used..];
        let (head, tail) = bytes.split_at(bytes.len().min(room.len()));
        room[..head.len()].copy_from_slice(head);
        self.used += head.len();
        tail
    }

    fn bytes(&self) -> &[u8] {
        &self.memory[..self.used]
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::random;
    use super::*;

    /// A spool in memory with room for so many bytes, of which the reader finds so many.
    struct Small {
        bytes: Vec<u8>,
        room: usize,
        left: usize,
    }

    impl Spool for Small {
        fn put(&mut self, at: u64, bytes: &[u8]) -> io::Result<()> {
            assert_eq!(at, self.bytes.len() as u64);
            if self.bytes.len() + bytes.len() > self.room {
                return Err(io::ErrorKind::StorageFull.into());
            }
            self.bytes.extend(bytes);
            Ok(())
        }

        fn read(&self) -> io::Result<Box<dyn Read + '_>> {
            Ok(Box::new(&self.bytes[..self.left.min(self.bytes.len())]))
        }
    }

    /// Runs of odd lengths, and all of them in one.
    fn runs(total: usize) -> (Vec<Vec<u8>>, Vec<u8>) {
        let mut state = 5;
        let (mut runs, mut all) = (vec![], vec![]);
        while all.len() < total {
            let length = usize::try_from(random(&mut state) % 300_000).expect("small");
            let byte = random(&mut state).to_le_bytes()[0];
            runs.push((0..length).zip((0..251).cycle()).map(|(_, n)| byte ^ n).collect::<Vec<u8>>());
            all.extend(runs.last().expect("just pushed"));
        }
        (runs, all)
    }

    #[test]
    fn all_bytes_come_back_in_order_and_memory_is_bounded() {
        let (runs, all) = runs(7 * PIECE);
        for memory in [0, PIECE, 3 * PIECE - 1, 3 * PIECE, 100 * PIECE] {
            let file = Box::new(tempfile::tempfile().expect("a temporary file"));
            let mut buffers = Buffers::with_spool(memory as u64, file);
            for run in &runs {
                buffers.push(run).expect("room");
                assert!(buffers.len() - buffers.spooled() <= memory.max(PIECE) as u64);
            }
            assert_eq!(buffers.spooled() > 0, memory < all.len());
            assert_eq!(buffers.len(), all.len() as u64);
            // Twice: reading begins anew.
            for _ in 0..2 {
                let mut out = vec![];
                buffers.write(&mut out).expect("all of it");
                assert!(out == all, "{memory}");
            }
        }
    }

    /// As of a file that is cut short and then grows again, so that there are zeros where the first bytes were.
    #[test]
    fn a_spool_with_other_bytes_is_an_error() {
        let (runs, _) = runs(4 * PIECE);
        let file = tempfile::tempfile().expect("a temporary file");
        let other = file.try_clone().expect("another handle");
        let mut buffers = Buffers::with_spool(0, Box::new(file));
        let (first, rest) = runs.split_at(runs.len() / 2);
        first.iter().try_for_each(|run| buffers.push(run)).expect("room");
        other.set_len(0).expect("cut");
        rest.iter().try_for_each(|run| buffers.push(run)).expect("room");
        let error = buffers.write(&mut io::sink()).expect_err("cut");
        assert!(matches!(error, VdbWriteError::Spool(error) if error.kind() == io::ErrorKind::InvalidData));
    }

    #[test]
    fn a_full_spool_and_a_short_one_are_errors() {
        let (runs, _) = runs(4 * PIECE);
        let spool = |room, left| Buffers::with_spool(0, Box::new(Small { bytes: vec![], room, left }));
        let mut full = spool(2 * PIECE, usize::MAX);
        let error = runs.iter().try_for_each(|run| full.push(run)).expect_err("full");
        assert!(matches!(error, VdbWriteError::Spool(error) if error.kind() == io::ErrorKind::StorageFull));

        for left in [0, PIECE, 3 * PIECE - 1] {
            let mut short = spool(usize::MAX, left);
            runs.iter().try_for_each(|run| short.push(run)).expect("room");
            let error = short.write(&mut io::sink()).expect_err("short");
            assert!(
                matches!(error, VdbWriteError::Spool(error) if error.kind() == io::ErrorKind::UnexpectedEof)
            );
        }
    }
}
