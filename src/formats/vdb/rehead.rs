//! Another header for a file that is written already.

use std::io::{self, Read, Seek, SeekFrom, Write};

use super::VdbWriteError;
use super::file::{FileHeader, head};

/// Bytes that are moved at once.
const PIECE: usize = 1 << 20;

/// Gives a file of `grids` grids that has the header `old` another that is no shorter, in place: the bytes are then those that
/// [`write`](super::write) would have written with it. Returns the file's length in bytes.
///
/// # Errors
///
/// [`VdbWriteError::Io`], also where the new header is shorter, or the file is not as it was written;
/// [`VdbWriteError::Metadata`], [`VdbWriteError::TooLarge`]. After an error the file is of no use, unless nothing was to be
/// moved.
pub fn rehead(
    mut file: impl Read + Write + Seek,
    old: &FileHeader,
    new: &FileHeader,
    grids: usize,
) -> Result<u64, VdbWriteError> {
    let (before, head) = (head(old, grids)?.len() as u64, head(new, grids)?);
    let shift = (head.len() as u64).checked_sub(before).ok_or_else(|| broken("its new header is shorter"))?;
    let end = file.seek(SeekFrom::End(0))?;
    // From the end on, so that nothing is overwritten that is still to be moved.
    let mut piece = Vec::new();
    let mut rest = end.checked_sub(before).ok_or_else(|| broken("it is shorter than its header"))?;
    while rest > 0 && shift > 0 {
        piece.resize(usize::try_from(rest).unwrap_or(PIECE).min(PIECE), 0);
        rest -= piece.len() as u64;
        file.seek(SeekFrom::Start(before + rest))?;
        file.read_exact(&mut piece)?;
        file.seek(SeekFrom::Start(before + rest + shift))?;
        file.write_all(&piece)?;
    }
    file.seek(SeekFrom::Start(0))?;
    file.write_all(&head)?;
    let mut descriptor = head.len() as u64;
    for _ in 0..grids {
        descriptor = move_offsets(&mut file, descriptor, shift)?;
    }
    file.flush()?;
    Ok(end + shift)
}

/// Moves the offsets of the grid whose descriptor begins here; returns where the next begins.
fn move_offsets(
    file: &mut (impl Read + Write + Seek),
    descriptor: u64,
    shift: u64,
) -> Result<u64, VdbWriteError> {
    let mut at = descriptor;
    // Name, type, and the grid that it shares a tree with.
    for _ in 0..3 {
        let mut length = [0; 4];
        file.seek(SeekFrom::Start(at))?;
        file.read_exact(&mut length)?;
        at += 4 + u64::from(u32::from_le_bytes(length));
    }
    file.seek(SeekFrom::Start(at))?;
    let mut offsets = [[0; 8]; 3];
    file.read_exact(offsets.as_flattened_mut())?;
    let mut end = descriptor;
    for offset in &mut offsets {
        let shift = i64::try_from(shift).ok();
        let moved = shift.and_then(|shift| i64::from_le_bytes(*offset).checked_add(shift));
        let moved = moved.ok_or(VdbWriteError::TooLarge("the file"))?;
        *offset = moved.to_le_bytes();
        end = u64::try_from(moved).map_err(|_| broken("an offset is negative"))?;
    }
    file.seek(SeekFrom::Start(at))?;
    file.write_all(offsets.as_flattened())?;
    Ok(end)
}

fn broken(what: &'static str) -> VdbWriteError {
    io::Error::new(io::ErrorKind::InvalidData, what).into()
}

#[cfg(test)]
mod tests {
    use std::io::Cursor;

    use super::super::tests::{bricks, build, file_header, grid_header};
    use super::super::{Compression, Meta, write};
    use super::*;

    #[test]
    fn files_get_the_bytes_that_they_would_have_been_written_with() {
        let old = file_header();
        let grid = build(Compression::Blosc, &bricks());
        let (a, b) = (grid_header("a"), grid_header("b"));
        // Less than a piece, and some of them.
        for length in [0, 1, 6000, 3 << 20] {
            let mut new = old.clone();
            if length > 0 {
                new.metadata.insert("more".to_owned(), Meta::from(&*"x".repeat(length)));
            }
            for grids in [&[][..], &[(&a, &grid as _)], &[(&a, &grid as _), (&b, &grid as _)]] {
                let file = |header: &FileHeader| {
                    let mut bytes = vec![];
                    write(&mut bytes, header, grids).expect("memory");
                    bytes
                };
                let (mut found, expected) = (Cursor::new(file(&old)), file(&new));
                let bytes = rehead(&mut found, &old, &new, grids.len()).expect("memory");
                assert_eq!(bytes, expected.len() as u64);
                assert!(found.into_inner() == expected, "{length} bytes more, {} grids", grids.len());
            }
        }
    }

    #[test]
    fn shorter_headers_are_refused() {
        let mut old = file_header();
        let new = old.clone();
        old.metadata.insert("more".to_owned(), Meta::Bool(true));
        let mut bytes = vec![];
        write(&mut bytes, &old, &[]).expect("memory");
        let mut found = Cursor::new(bytes.clone());
        assert!(rehead(&mut found, &old, &new, 0).is_err());
        assert!(found.into_inner() == bytes);
    }
}
