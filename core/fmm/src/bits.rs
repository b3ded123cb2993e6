// SPDX-License-Identifier: GPL-3.0-or-later
//! A table of bits that several threads set at once.

use crate::error::Error;
use std::ops::Range;
use std::sync::atomic::{AtomicU64, Ordering};

/// A matrix of bits that several threads fill.
pub struct Bits {
    words: usize,
    bits: Vec<AtomicU64>,
}

impl Bits {
    pub fn new(rows: usize, columns: usize) -> Result<Self, Error> {
        let words = columns.div_ceil(64);
        let mut bits = Vec::new();
        bits.try_reserve_exact(rows * words).map_err(|_| Error::Memory { bytes: rows * words * 8 })?;
        bits.resize_with(rows * words, AtomicU64::default);
        Ok(Self { words, bits })
    }

    pub fn set(&self, row: usize, column: usize) {
        self.bits[row * self.words + column / 64].fetch_or(1 << (column % 64), Ordering::Relaxed);
    }

    pub fn get(&self, row: usize, column: usize) -> bool {
        self.bits[row * self.words + column / 64].load(Ordering::Relaxed) >> (column % 64) & 1 == 1
    }

    /// The bits of some columns of a row, in words; those of other columns are 0.
    pub fn words_of(&self, row: usize, columns: &Range<usize>) -> impl Iterator<Item = u64> {
        let (start, end) = (columns.start, columns.end);
        (start / 64..end.div_ceil(64)).map(move |word| {
            let below = if word == start / 64 { u64::MAX << (start % 64) } else { u64::MAX };
            let above = if word == end / 64 { !(u64::MAX << (end % 64)) } else { u64::MAX };
            self.bits[row * self.words + word].load(Ordering::Relaxed) & below & above
        })
    }
}
