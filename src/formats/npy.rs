//! Arrays of numbers in the `.npy` format of NumPy (NEP 1; `numpy.lib.format`).
//!
//! Read: versions 1.0 to 3.0, `f4` and `f8` of either byte order, in C order. Written: version 1.0, little-endian.

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

use std::io::{self, Read, Write};

use thiserror::Error;

/// First bytes of every file.
pub const MAGIC: [u8; 6] = *b"\x93NUMPY";
/// Headers of arrays of numbers are shorter by far.
const LONGEST_HEADER: u32 = 1 << 16;
/// Bytes that are read at once.
const CHUNK: usize = 1 << 16;
/// Written data begin at a multiple of this.
const ALIGNMENT: usize = 64;

/// An array in C order: the last index is the fastest.
#[derive(Debug, Clone, PartialEq)]
pub struct Array {
    /// Elements along each axis; their product is the number of values.
    pub shape: Vec<usize>,
    /// The elements.
    pub values: Values,
}

/// Numbers of either precision.
#[derive(Debug, Clone, PartialEq)]
pub enum Values {
    /// `f4`.
    F32(Vec<f32>),
    /// `f8`.
    F64(Vec<f64>),
}

/// Why an array could not be read.
#[derive(Debug, Error)]
pub enum NpyError {
    /// The input failed.
    #[error(transparent)]
    Io(#[from] io::Error),
    /// The first bytes are not those of the format.
    #[error("not an .npy file")]
    Magic,
    /// A version of the format that is not known.
    #[error("version {0}.{1} of .npy is not supported (1.0 to 3.0 are)")]
    Version(u8, u8),
    /// The header makes no sense.
    #[error("invalid .npy header: {0}")]
    Header(&'static str),
    /// A type of elements that is not read.
    #[error("elements of type {0:?} are not supported (f4 and f8 are)")]
    Type(String),
    /// An array in Fortran's order.
    #[error("arrays in Fortran order are not supported: save numpy.ascontiguousarray(...)")]
    FortranOrder,
    /// There are more elements than are allowed.
    #[error("{count} elements are too many")]
    TooMany {
        /// As the header has it.
        count: u64,
    },
    /// The input ends before the last element.
    #[error("truncated .npy file: {found} of {expected} bytes of elements")]
    Truncated {
        /// Bytes there are.
        found: u64,
        /// Bytes there should be.
        expected: u64,
    },
}

/// Reads an array. What follows it is left alone, as NumPy does.
///
/// Memory follows what the input holds, not what its header claims.
///
/// # Errors
/// See [`NpyError`].
pub fn read(input: &mut impl Read) -> Result<Array, NpyError> {
    read_within(input, u64::MAX)
}

/// The same of no more than so many elements.
///
/// # Errors
/// See [`NpyError`].
pub fn read_within(input: &mut impl Read, most: u64) -> Result<Array, NpyError> {
    let mut start = [0; 8];
    fill(input, &mut start, NpyError::Magic)?;
    let [magic @ .., major, minor] = start;
    if magic != MAGIC {
        return Err(NpyError::Magic);
    }
    let short = || NpyError::Header("it is cut off");
    let length = match (major, minor) {
        (1, 0) => {
            let mut length = [0; 2];
            fill(input, &mut length, short())?;
            u32::from(u16::from_le_bytes(length))
        }
        (2 | 3, 0) => {
            let mut length = [0; 4];
            fill(input, &mut length, short())?;
            u32::from_le_bytes(length)
        }
        _ => return Err(NpyError::Version(major, minor)),
    };
    if length > LONGEST_HEADER {
        return Err(NpyError::Header("it is too long"));
    }
    let mut header = vec![0; length as usize];
    fill(input, &mut header, short())?;
    let header = Header::parse(&String::from_utf8_lossy(&header))?;
    if header.fortran_order {
        return Err(NpyError::FortranOrder);
    }
    let count = header.shape.iter().try_fold(1_u64, |count, n| count.checked_mul(*n as u64));
    let count = count.ok_or(NpyError::Header("the shape has too many elements"))?;
    if count > most {
        return Err(NpyError::TooMany { count });
    }
    let values = match header.descr.as_str() {
        "<f4" => Values::F32(elements(input, count, f32::from_le_bytes)?),
        ">f4" => Values::F32(elements(input, count, f32::from_be_bytes)?),
        "<f8" => Values::F64(elements(input, count, f64::from_le_bytes)?),
        ">f8" => Values::F64(elements(input, count, f64::from_be_bytes)?),
        other => return Err(NpyError::Type(other.chars().take(32).collect())),
    };
    Ok(Array { shape: header.shape, values })
}

/// Writes an array.
///
/// # Errors
/// Those of `out`; of the kind `InvalidInput` where shape and values do not fit, or there are too many axes.
pub fn write(out: &mut impl Write, array: &Array) -> io::Result<()> {
    let (descr, count) = match &array.values {
        Values::F32(values) => ("<f4", values.len()),
        Values::F64(values) => ("<f8", values.len()),
    };
    let product = array.shape.iter().try_fold(1_usize, |product, n| product.checked_mul(*n));
    if product != Some(count) {
        return Err(io::Error::new(io::ErrorKind::InvalidInput, "the shape is not that of the values"));
    }
    let shape: String = array.shape.iter().map(|n| format!("{n}, ")).collect();
    // A tuple of one needs its comma, and others do not have it.
    let shape = if array.shape.len() == 1 { shape.trim_end() } else { shape.trim_end_matches(", ") };
    let mut header = format!("{{'descr': '{descr}', 'fortran_order': False, 'shape': ({shape}), }}");
    // What comes before the header, and its own last byte.
    let beside = MAGIC.len().saturating_add(5);
    let whole = header.len().saturating_add(beside).next_multiple_of(ALIGNMENT);
    let width = whole.saturating_sub(beside);
    header.extend(std::iter::repeat_n(' ', width.saturating_sub(header.len())));
    header.push('\n');
    let length = u16::try_from(header.len())
        .map_err(|_| io::Error::new(io::ErrorKind::InvalidInput, "the shape has too many axes"))?;
    out.write_all(&MAGIC)?;
    out.write_all(&[1, 0])?;
    out.write_all(&length.to_le_bytes())?;
    out.write_all(header.as_bytes())?;
    match &array.values {
        Values::F32(values) => values.iter().try_for_each(|value| out.write_all(&value.to_le_bytes())),
        Values::F64(values) => values.iter().try_for_each(|value| out.write_all(&value.to_le_bytes())),
    }
}

/// Fills a buffer, or fails with `short` where the input ends before.
fn fill(input: &mut impl Read, buffer: &mut [u8], short: NpyError) -> Result<(), NpyError> {
    input.read_exact(buffer).map_err(|error| match error.kind() {
        io::ErrorKind::UnexpectedEof => short,
        _ => error.into(),
    })
}

fn elements<T, const N: usize>(
    input: &mut impl Read,
    count: u64,
    decode: impl Fn([u8; N]) -> T,
) -> Result<Vec<T>, NpyError> {
    let bytes = count.checked_mul(N as u64).ok_or(NpyError::Header("the shape has too many elements"))?;
    let mut values = Vec::new();
    let mut found = 0_u64;
    let mut chunk = Vec::with_capacity(CHUNK);
    while found < bytes {
        chunk.clear();
        // Whole elements, because a chunk's size is a multiple of theirs.
        let read = input.take(bytes.saturating_sub(found).min(CHUNK as u64)).read_to_end(&mut chunk)? as u64;
        found = found.saturating_add(read);
        if read < CHUNK as u64 && found < bytes {
            return Err(NpyError::Truncated { found, expected: bytes });
        }
        let (numbers, _) = chunk.as_chunks();
        values.try_reserve(numbers.len()).map_err(|_| io::Error::from(io::ErrorKind::OutOfMemory))?;
        values.extend(numbers.iter().map(|bytes| decode(*bytes)));
    }
    Ok(values)
}

/// What a header says: a Python dictionary of three entries.
#[derive(Debug, PartialEq)]
struct Header {
    descr: String,
    fortran_order: bool,
    shape: Vec<usize>,
}

impl Header {
    fn parse(text: &str) -> Result<Header, NpyError> {
        let mut text = Text(text);
        let (mut descr, mut order, mut shape) = (None, None, None);
        text.expect('{')?;
        while !text.skip('}') {
            let key = text.string()?;
            text.expect(':')?;
            let repeated = match key {
                "descr" => descr.replace(text.descr()?).is_some(),
                "fortran_order" => order.replace(text.truth()?).is_some(),
                "shape" => shape.replace(text.shape()?).is_some(),
                _ => return Err(NpyError::Header("an unknown key")),
            };
            if repeated {
                return Err(NpyError::Header("a key is there twice"));
            }
            if !text.skip(',') {
                text.expect('}')?;
                break;
            }
        }
        if !text.0.trim().is_empty() {
            return Err(NpyError::Header("something follows the dictionary"));
        }
        let missing = || NpyError::Header("descr, fortran_order or shape is missing");
        Ok(Header {
            descr: descr.ok_or_else(missing)?,
            fortran_order: order.ok_or_else(missing)?,
            shape: shape.ok_or_else(missing)?,
        })
    }
}

/// What is left of a header.
struct Text<'a>(&'a str);

impl<'a> Text<'a> {
    /// Whether this mark comes next; it is then passed.
    fn skip(&mut self, mark: char) -> bool {
        self.0 = self.0.trim_start();
        let rest = self.0.strip_prefix(mark);
        self.0 = rest.unwrap_or(self.0);
        rest.is_some()
    }

    fn expect(&mut self, mark: char) -> Result<(), NpyError> {
        if self.skip(mark) { Ok(()) } else { Err(NpyError::Header("not the dictionary that it should be")) }
    }

    fn string(&mut self) -> Result<&'a str, NpyError> {
        let quote = if self.skip('"') { '"' } else { '\'' };
        if quote == '\'' {
            self.expect(quote)?;
        }
        let (string, rest) = self.0.split_once(quote).ok_or(NpyError::Header("a string has no end"))?;
        self.0 = rest;
        Ok(string)
    }

    /// A type; that of records is a list and named as one.
    fn descr(&mut self) -> Result<String, NpyError> {
        if self.skip('[') {
            return Err(NpyError::Type("record".to_owned()));
        }
        Ok(self.string()?.to_owned())
    }

    fn truth(&mut self) -> Result<bool, NpyError> {
        self.0 = self.0.trim_start();
        for (word, value) in [("False", false), ("True", true)] {
            if let Some(rest) = self.0.strip_prefix(word) {
                self.0 = rest;
                return Ok(value);
            }
        }
        Err(NpyError::Header("fortran_order is neither True nor False"))
    }

    fn shape(&mut self) -> Result<Vec<usize>, NpyError> {
        let mut shape = Vec::new();
        self.expect('(')?;
        while !self.skip(')') {
            self.0 = self.0.trim_start();
            let digits = self.0.find(|c: char| !c.is_ascii_digit()).unwrap_or(self.0.len());
            let (number, rest) = self.0.split_at(digits);
            shape.push(
                number.parse().map_err(|_| NpyError::Header("the shape is no tuple of whole numbers"))?,
            );
            // Python 2 wrote its long integers so.
            self.0 = rest.strip_prefix('L').unwrap_or(rest);
            if !self.skip(',') {
                self.expect(')')?;
                break;
            }
        }
        Ok(shape)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn bytes(array: &Array) -> Vec<u8> {
        let mut bytes = Vec::new();
        write(&mut bytes, array).expect("memory takes it");
        bytes
    }

    fn file(version: u8, header: &str, data: &[u8]) -> Vec<u8> {
        let mut bytes = MAGIC.to_vec();
        bytes.extend([version, 0]);
        let length = u32::try_from(header.len()).expect("short");
        bytes.extend(&length.to_le_bytes()[..if version == 1 { 2 } else { 4 }]);
        bytes.extend(header.as_bytes());
        bytes.extend(data);
        bytes
    }

    #[test]
    fn arrays_survive_writing_and_reading() {
        let singles = [0.1, -0.0, f32::INFINITY, f32::MIN_POSITIVE / 4.0, 5.0, 6.0];
        for shape in [vec![6], vec![2, 3], vec![1, 1, 6], vec![3, 2, 1]] {
            let array = Array { shape, values: Values::F32(singles.to_vec()) };
            let written = bytes(&array);
            assert_eq!(written.iter().position(|byte| *byte == b'\n').map(|at| (at + 1) % 64), Some(0));
            assert_eq!(read(&mut written.as_slice()).expect("an array"), array);
            let array = Array { values: Values::F64(singles.map(|x| f64::from(x) / 3.0).to_vec()), ..array };
            assert_eq!(read(&mut bytes(&array).as_slice()).expect("an array"), array);
        }
        for (shape, values) in [(vec![], vec![2.5]), (vec![0], vec![]), (vec![0, 3], vec![])] {
            let array = Array { shape, values: Values::F64(values) };
            assert_eq!(read(&mut bytes(&array).as_slice()).expect("an array"), array);
        }
        let long = Array { shape: vec![40_000, 3], values: Values::F32(vec![1.5; 120_000]) };
        assert_eq!(read(&mut bytes(&long).as_slice()).expect("an array"), long);
        let wrong = Array { shape: vec![2], values: Values::F32(vec![1.0]) };
        assert!(write(&mut Vec::new(), &wrong).is_err());
    }

    #[test]
    fn headers_of_all_versions_and_spellings() {
        let ones = [1.0_f32.to_le_bytes(), 2.0_f32.to_le_bytes()].concat();
        let expected = Array { shape: vec![2], values: Values::F32(vec![1.0, 2.0]) };
        for header in [
            "{'descr': '<f4', 'fortran_order': False, 'shape': (2,), }\n",
            "{\"shape\":(2,),\"descr\":\"<f4\",\"fortran_order\":False}",
            " { 'shape' : ( 2L , ) , 'descr' : '<f4' , 'fortran_order' : False , }   \n",
        ] {
            for version in [1, 2, 3] {
                assert_eq!(read(&mut file(version, header, &ones).as_slice()).expect("an array"), expected);
            }
        }
        let big = [1.0_f64.to_be_bytes(), 2.0_f64.to_be_bytes()].concat();
        let header = "{'descr': '>f8', 'fortran_order': False, 'shape': (2,)}";
        let found = read(&mut file(1, header, &big).as_slice()).expect("an array");
        assert_eq!(found.values, Values::F64(vec![1.0, 2.0]));
    }

    #[test]
    fn what_is_wrong_is_named() {
        let with = |descr: &str, order: &str, shape: &str| {
            format!("{{'descr': {descr}, 'fortran_order': {order}, 'shape': {shape}}}")
        };
        for (header, part) in [
            (with("'<f4'", "True", "(2,)"), "Fortran"),
            (with("'<i4'", "False", "(2,)"), "\"<i4\""),
            (with("[('x', '<f4')]", "False", "(2,)"), "record"),
            (with("'<f4'", "False", "(2,) "), "0 of 8 bytes"),
            (with("'<f8'", "False", "(1000000000000000, 3)"), "0 of 24000000000000000 bytes"),
            (with("'<f4'", "False", "(4294967296, 4294967296)"), "too many"),
            (with("'<f4'", "False", "(9223372036854775807,)"), "too many"),
            (with("'<f4'", "False", "(99999999999999999999,)"), "whole numbers"),
            (with("'<f4'", "False", "(-1,)"), "whole numbers"),
            (with("'<f4'", "False", "2"), "dictionary"),
            (with("'<f4'", "Maybe", "(2,)"), "neither"),
            (with("'<f4", "False", "(2,)"), "header"),
            ("{'descr': '<f4', 'shape': (2,)}".to_owned(), "missing"),
            ("{'descr': '<f4', 'descr': '<f4'}".to_owned(), "twice"),
            ("{'size': 2}".to_owned(), "unknown"),
            ("{} {}".to_owned(), "follows"),
            (String::new(), "dictionary"),
        ] {
            for version in [1, 2] {
                let error = read(&mut file(version, &header, &[]).as_slice()).expect_err("wrong").to_string();
                assert!(error.contains(part), "{header}: {error}");
            }
        }
        let version = read(&mut file(4, "", &[]).as_slice()).expect_err("unknown").to_string();
        assert!(version.contains("4.0"), "{version}");
        let mut long = MAGIC.to_vec();
        long.extend([2, 0, 255, 255, 255, 255]);
        assert!(matches!(read(&mut long.as_slice()), Err(NpyError::Header("it is too long"))));
        assert!(matches!(read(&mut &b"PK\x03\x04 and more"[..]), Err(NpyError::Magic)));
    }

    #[test]
    fn every_cut_and_every_changed_byte_is_survived() {
        let whole = bytes(&Array { shape: vec![2, 3], values: Values::F32(vec![1.0; 6]) });
        for length in 0..whole.len() {
            assert!(read(&mut &whole[..length]).is_err());
        }
        for at in 0..whole.len() {
            for change in [1, 0x20, 0x80] {
                let mut bytes = whole.clone();
                bytes[at] ^= change;
                // An error or another array, but no panic.
                let _ = read(&mut bytes.as_slice());
            }
        }
    }
}
