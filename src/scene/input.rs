//! Files that a scene names: read by whoever reads the scene, so that this module touches no disk.

#![cfg_attr(not(test), deny(clippy::arithmetic_side_effects))]

use std::cell::RefCell;
use std::fmt;
use std::io;
use std::sync::Arc;

use sha2::{Digest, Sha256};

use super::error::Fault;
use super::reader::Item;

/// Bytes that all files of a scene may have together.
pub const MOST_INPUT: u64 = 256 << 20;
/// Characters of a path.
const LONGEST_PATH: usize = 4096;

/// A file that a scene was read with.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Input {
    /// Its path as the scene has it.
    pub path: String,
    /// SHA-256 of its bytes.
    pub sha256: [u8; 32],
    pub(crate) bytes: Arc<[u8]>,
}

/// Gives the bytes of the file at a path as the scene has it, and no more than [`MOST_INPUT`] and one.
pub type Load<'a> = dyn Fn(&str) -> io::Result<Vec<u8>> + 'a;

/// The files that have been read so far.
pub(super) struct Inputs<'a> {
    load: &'a Load<'a>,
    files: RefCell<Vec<Input>>,
}

impl fmt::Debug for Inputs<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_list().entries(self.files.borrow().iter()).finish()
    }
}

impl<'a> Inputs<'a> {
    pub(super) fn new(load: &'a Load<'a>) -> Inputs<'a> {
        Inputs { load, files: RefCell::default() }
    }

    /// The path that is the item's value, and the bytes of the file there.
    pub(super) fn read<'t>(&self, item: &Item<'t>) -> Option<(&'t str, Arc<[u8]>)> {
        let path = item.text()?;
        let refuse = |label: String| item.report(Fault::at(item.span(), "unreadable `file`").label(label));
        if path.is_empty() || path.chars().count() > LONGEST_PATH || path.contains(char::is_control) {
            refuse("expected a path, of at most 4096 characters and no control characters".to_owned());
            return None;
        }
        let mut files = self.files.borrow_mut();
        if let Some(input) = files.iter().find(|input| input.path == path) {
            return Some((path, input.bytes.clone()));
        }
        let bytes = (self.load)(path).map_err(|error| refuse(error.to_string())).ok()?;
        let total: u64 = files.iter().map(|input| input.bytes.len() as u64).sum();
        if total.saturating_add(bytes.len() as u64) > MOST_INPUT {
            refuse(format!("a scene's files may have {} MiB together", MOST_INPUT >> 20));
            return None;
        }
        let bytes: Arc<[u8]> = bytes.into();
        let sha256 = Sha256::digest(&bytes).into();
        files.push(Input { path: path.to_owned(), sha256, bytes: bytes.clone() });
        Some((path, bytes))
    }

    /// Those files, in the order in which the scene names them.
    pub(super) fn into_list(self) -> Vec<Input> {
        self.files.into_inner().into_iter().collect()
    }
}
