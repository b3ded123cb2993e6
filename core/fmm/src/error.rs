// SPDX-License-Identifier: GPL-3.0-or-later
//! What can be wrong with the input, said with the offending values.

use crate::lists::ListsError;
use crate::octree::OctreeError;
use std::fmt;

#[derive(Debug, Clone, PartialEq)]
pub enum Error {
    /// Two arrays that describe the same things differ in length.
    Length {
        what: &'static str,
        expected: usize,
        found: usize,
    },
    /// An index points past the end of what it indexes.
    Index {
        what: &'static str,
        index: usize,
        count: usize,
    },
    /// The coefficients of all boxes do not fit.
    Memory {
        bytes: usize,
    },
    /// A medium that gives light, or none that is a number.
    Absorption(f64),
    Octree(OctreeError),
    Lists(ListsError),
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Error::Length { what, expected, found } => write!(f, "{what}: expected {expected} rows, found {found}"),
            Error::Index { what, index, count } => write!(f, "{what}: index {index} is out of range for {count}"),
            Error::Memory { bytes } => write!(f, "no memory for {} MiB of coefficients", bytes >> 20),
            Error::Absorption(sigma) => write!(f, "absorption {sigma}, expected a number of at least 0"),
            Error::Octree(error) => error.fmt(f),
            Error::Lists(error) => error.fmt(f),
        }
    }
}

impl std::error::Error for Error {}

impl From<OctreeError> for Error {
    fn from(error: OctreeError) -> Self {
        Error::Octree(error)
    }
}

impl From<ListsError> for Error {
    fn from(error: ListsError) -> Self {
        Error::Lists(error)
    }
}

/// Fails unless `found` rows of `what` are as many as `expected`.
pub fn same_length(what: &'static str, expected: usize, found: usize) -> Result<(), Error> {
    if expected == found { Ok(()) } else { Err(Error::Length { what, expected, found }) }
}
