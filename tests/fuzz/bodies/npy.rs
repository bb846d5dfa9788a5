//! Arrays: what is read is written and read again, the same.

use std::io::Cursor;

use vdbake::formats::npy::{self, Values};

use super::within;

pub(crate) fn run(data: &[u8]) -> bool {
    // A list of numbers grows by doubling, from single precision too.
    let most = (1 << 18) + 4 * data.len() as u64;
    let Ok(array) = within(most, || npy::read(&mut Cursor::new(data))) else { return false };
    let count = match &array.values {
        Values::F32(values) => values.len(),
        Values::F64(values) => values.len(),
    };
    assert_eq!(array.shape.iter().product::<usize>(), count);
    let mut bytes = vec![];
    // More axes than a header of version 1 can hold are not written.
    if npy::write(&mut bytes, &array).is_ok() {
        let again = npy::read(&mut Cursor::new(&bytes)).expect("what was written");
        assert_eq!(again.shape, array.shape);
        let mut same = vec![];
        npy::write(&mut same, &again).expect("it was written before");
        // As bytes, because NaN is not equal to itself.
        assert_eq!(same, bytes);
    }
    true
}
