// SPDX-License-Identifier: GPL-3.0-or-later
//! The interaction list sorted for matrix-matrix products.
//!
//! The targets of each level are cut into slabs of consecutive boxes. The pairs of one slab are sorted by offset: a batch is
//! all pairs of one slab with one offset, and so with one m2l operator. Slabs share no target, so that threads which take one slab
//! each never write to the same box. Within a batch targets ascend; in octrees split by normal a target can occur up to
//! six times in a row, once for each source box of the same cell.

use std::ops::Range;

use rayon::prelude::*;

use crate::lists::Rows;
use crate::octree::Octree;

/// Pairs with one operator.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Batch {
    /// Level of the targets and sources.
    pub level: u8,
    /// Source cell minus target cell, in cells of this level.
    pub offset: [i32; 3],
    /// Its pairs in `Batches::targets` and `Batches::sources`.
    pub pairs: Range<usize>,
}

/// P pairs in S slabs, slabs in order of their targets.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Batches {
    /// (P,) u32: target box of each pair.
    pub targets: Vec<u32>,
    /// (P,) u32: source box of each pair.
    pub sources: Vec<u32>,
    /// All batches, slab after slab.
    pub batches: Vec<Batch>,
    /// (S,): batches of each slab, and the target boxes that it alone writes to.
    pub slabs: Vec<Slab>,
}

/// Work of one thread.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Slab {
    pub batches: Range<usize>,
    pub targets: Range<usize>,
}

/// A pair with its offset in front, to sort by.
type Pair = ([i32; 3], u32, u32);

impl Batches {
    pub(crate) fn new(rows: &Rows, targets: &Octree, sources: &Octree, targets_per_slab: usize) -> Self {
        let width = targets_per_slab.max(1);
        let cut = |level: usize| {
            let boxes = targets.boxes_of_level(level);
            boxes.clone().step_by(width).map(move |start| start..boxes.end.min(start.saturating_add(width)))
        };
        let slabs: Vec<Range<usize>> = (0..targets.n_levels()).flat_map(cut).collect();
        let sorted: Vec<Vec<Pair>> = slabs.par_iter().map(|slab| sorted_pairs(rows, targets, sources, slab)).collect();

        let n_pairs = rows.boxes.len();
        let (targets_of_pairs, sources_of_pairs) = (Vec::with_capacity(n_pairs), Vec::with_capacity(n_pairs));
        let mut all =
            Self { targets: targets_of_pairs, sources: sources_of_pairs, batches: Vec::new(), slabs: Vec::new() };
        for (slab, pairs) in slabs.into_iter().zip(sorted) {
            all.push_slab(targets.level[slab.start], slab, &pairs);
        }
        all
    }

    fn push_slab(&mut self, level: u8, targets: Range<usize>, pairs: &[Pair]) {
        if pairs.is_empty() {
            return;
        }
        let first = self.batches.len();
        for batch in pairs.chunk_by(|a, b| a.0 == b.0) {
            let start = self.targets.len();
            self.targets.extend(batch.iter().map(|pair| pair.1));
            self.sources.extend(batch.iter().map(|pair| pair.2));
            self.batches.push(Batch { level, offset: batch[0].0, pairs: start..self.targets.len() });
        }
        self.slabs.push(Slab { batches: first..self.batches.len(), targets });
    }
}

fn sorted_pairs(rows: &Rows, targets: &Octree, sources: &Octree, slab: &Range<usize>) -> Vec<Pair> {
    let offset = |t: usize, s: u32| [0, 1, 2].map(|i| sources.cell[s as usize][i] - targets.cell[t][i]);
    let pairs = slab.clone().flat_map(|t| rows.row(t).iter().map(move |&s| (offset(t, s), t as u32, s)));
    let mut pairs: Vec<Pair> = pairs.collect();
    pairs.sort_unstable();
    pairs
}
