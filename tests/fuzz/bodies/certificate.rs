//! Certificates: what is read is written and read again, the same.

use vdbake::report::Certificate;

use super::within;

pub(crate) fn run(data: &[u8]) -> bool {
    let most = (1 << 20) + 200 * data.len() as u64;
    let Ok(certificate) = within(most, || serde_json::from_slice::<Certificate>(data)) else { return false };
    let text = serde_json::to_string(&certificate).expect("a certificate");
    let again: Certificate = serde_json::from_str(&text).expect("what was written");
    assert_eq!(again, certificate);
    true
}
