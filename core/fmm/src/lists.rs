// SPDX-License-Identifier: GPL-3.0-or-later
//! The four lists of boxes that the passes of the fast multipole method go through.
//!
//! | list | paper's set | letter | row | entries | pass |
//! |---|---|---|---|---|---|
//! | near neighbours | near neighbors | U | target leaf | source leaves | p2p, direct |
//! | interaction list | interaction list | V | target box | source boxes of the same level | m2l |
//! | local interaction list | local interaction list | X | target box | larger source leaves | p2l |
//! | multipole interaction list | multipole interaction list | W | target leaf | smaller source boxes | m2p |
//!
//! Two boxes of one level are well separated when their cells are more than k cells apart (k = 1: they share no boundary point).
//! In the lists X and W only one side is expanded; that smaller box is well separated when its cell is more than k of
//! its own sides away from the cell of the leaf.
//! Through its own rows and those of its ancestors every target meets every source exactly once, except for pairs of
//! points which do not face each other where the facing test is on.

use std::fmt;

use crate::facing::{Facing, FacingTest};
pub use crate::lists_batches::{Batch, Batches};
use crate::lists_traversal::traverse;
use crate::octree::{Grid, NO_BOX, Octree, OctreeError};

/// An operator for an offset beyond the classical interaction list serves a few pairs only, and making it takes as long as
/// this many translations.
const RARE_OFFSET: usize = 300;

/// Rows of box numbers, one for each target box, compressed. B target boxes, E entries.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Rows {
    /// (B + 1) usize: row b is `boxes[starts[b]..starts[b + 1]]`.
    pub starts: Vec<usize>,
    /// (E,) u32: source boxes, row after row.
    pub boxes: Vec<u32>,
}

/// How the lists are made.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ListsOptions {
    /// Cells up to k apart are near; at least 1.
    pub separation: u32,
    /// Leave out pairs of boxes that do not face each other, and expand only pairs that do so as a whole.
    pub facing: bool,
    /// Cosine up to which a pair of points may pass for one at the horizon in the facing test: it may then be left out, or
    /// be expanded with a cosine that is negative by as much. 0 for exact horizons; e costs about e^2 of the irradiance.
    pub grazing: f64,
    /// A pair of well separated leaves of one level with at most this many pairs of points goes to the near neighbours,
    /// and so do many more where a postponed pair is farther apart than classical ones are; 0 keeps the classical lists.
    pub direct_pairs: usize,
    /// Where only one side of a pair would be expanded and the other is a leaf, a box of at most this many points is summed
    /// directly; 0 keeps the classical lists.
    pub direct_points: usize,
}

impl ListsOptions {
    /// The classical lists.
    pub fn new(separation: u32, facing: bool) -> Self {
        Self { separation, facing, grazing: 0.0, direct_pairs: 0, direct_points: 0 }
    }

    /// Whether two well separated boxes of one level have so few pairs of points that they are not expanded.
    pub(crate) fn few_pairs(&self, targets: &Octree, t: usize, sources: &Octree, s: usize) -> bool {
        let classical = cells_between(targets, t, sources, s) <= 2 * i64::from(self.separation) + 1;
        let most = match (classical, targets.is_leaf(t) && sources.is_leaf(s)) {
            (true, true) => self.direct_pairs,
            (true, false) => 0,
            (false, _) => RARE_OFFSET * self.direct_pairs,
        };
        targets.count(t) * sources.count(s) <= most
    }
}

/// How many pairs of boxes the facing test settled in which way.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct FacingCounts {
    pub all: u64,
    pub none: u64,
    pub some: u64,
    /// Well separated pairs of one level that had to be handed down to the children because they face each other in part.
    pub postponed: u64,
}

/// See the head of this file. All rows are numbered by target box, all entries by source box.
#[derive(Debug, Clone)]
pub struct Lists {
    pub options: ListsOptions,
    /// U
    pub near_neighbours: Rows,
    /// V
    pub interaction_list: Rows,
    /// X
    pub local_interaction_list: Rows,
    /// W
    pub multipole_interaction_list: Rows,
    /// All zero without the facing test.
    pub facing_counts: FacingCounts,
}

#[derive(Debug, Clone, PartialEq)]
pub enum ListsError {
    /// Boxes of different grids cannot be paired.
    GridsDiffer { targets: Grid, sources: Grid },
    /// Boxes that touch can never be well separated.
    NoSeparation,
    /// A cosine is at least 0 and below 1.
    BadGrazing { grazing: f64 },
    /// The facing test cannot be made from these octrees.
    Facing(OctreeError),
}

impl Lists {
    /// No pairs at all.
    pub fn empty(targets: &Octree, options: ListsOptions) -> Self {
        let rows = || Rows { starts: vec![0; targets.n_boxes() + 1], boxes: Vec::new() };
        Self {
            options,
            near_neighbours: rows(),
            interaction_list: rows(),
            local_interaction_list: rows(),
            multipole_interaction_list: rows(),
            facing_counts: FacingCounts::default(),
        }
    }

    /// Lists of two octrees on one grid, which may be one and the same.
    pub fn new(targets: &Octree, sources: &Octree, options: ListsOptions) -> Result<Self, ListsError> {
        if targets.grid != sources.grid {
            return Err(ListsError::GridsDiffer { targets: targets.grid, sources: sources.grid });
        }
        if options.separation == 0 {
            return Err(ListsError::NoSeparation);
        }
        if !(0.0..1.0).contains(&options.grazing) {
            return Err(ListsError::BadGrazing { grazing: options.grazing });
        }
        let facing = if options.facing { Some(FacingTest::new(targets, sources, options.grazing)?) } else { None };
        Ok(traverse(targets, sources, options, facing.as_ref()))
    }

    /// The pairs of the interaction list, sorted for matrix-matrix products; see `Batches`.
    pub fn batches(&self, targets: &Octree, sources: &Octree, targets_per_slab: usize) -> Batches {
        Batches::new(&self.interaction_list, targets, sources, targets_per_slab)
    }

    /// Panics with the offending pair where the lists contradict their description; for tests.
    pub fn assert_well_formed(&self, targets: &Octree, sources: &Octree) {
        let k = i64::from(self.options.separation);
        for (t, s) in self.near_neighbours.pairs() {
            assert!(targets.is_leaf(t) && sources.is_leaf(s), "near neighbours {t}, {s} are not leaves");
        }
        for (t, s) in self.interaction_list.pairs() {
            assert_eq!(targets.level[t], sources.level[s], "levels of the interaction {t}, {s}");
            assert!(cells_between(targets, t, sources, s) > k, "interaction {t}, {s} is not well separated");
        }
        for (t, s) in self.local_interaction_list.pairs() {
            assert!(sources.is_leaf(s) && targets.level[t] > sources.level[s], "local interaction {t}, {s}");
            assert!(cells_between(targets, t, sources, s) > k, "local interaction {t}, {s} is not well separated");
        }
        for (t, s) in self.multipole_interaction_list.pairs() {
            assert!(targets.is_leaf(t) && sources.level[s] > targets.level[t], "multipole interaction {t}, {s}");
            assert!(cells_between(targets, t, sources, s) > k, "multipole interaction {t}, {s} is not well separated");
        }
        for rows in self.all() {
            assert_eq!(rows.starts.len(), targets.n_boxes() + 1, "rows");
            assert_eq!(rows.starts[targets.n_boxes()], rows.boxes.len(), "entries");
        }
    }

    /// Whether the points of a target leaf meet those of a source leaf, through the rows of any boxes above them.
    pub fn have(&self, targets: &Octree, leaf: u32, sources: &Octree, source: u32) -> bool {
        let above = |tree: &Octree, leaf: u32| -> Vec<u32> {
            std::iter::successors(Some(leaf), |&b| Some(tree.parent[b as usize]).filter(|&b| b != NO_BOX)).collect()
        };
        let (over_target, over_source) = (above(targets, leaf), above(sources, source));
        let meets = |rows: &Rows, t: u32, boxes: &[u32]| {
            let row = rows.row(t as usize);
            boxes.iter().any(|s| row.binary_search(s).is_ok())
        };
        meets(&self.near_neighbours, leaf, &[source])
            || meets(&self.multipole_interaction_list, leaf, &over_source)
            || over_target.iter().any(|&t| {
                meets(&self.interaction_list, t, &over_source) || meets(&self.local_interaction_list, t, &[source])
            })
    }

    /// The four lists.
    pub fn all(&self) -> [&Rows; 4] {
        [&self.near_neighbours, &self.interaction_list, &self.local_interaction_list, &self.multipole_interaction_list]
    }
}

impl Rows {
    /// Source boxes of target box b.
    pub fn row(&self, b: usize) -> &[u32] {
        &self.boxes[self.starts[b]..self.starts[b + 1]]
    }

    /// All pairs of a target box and a source box.
    pub fn pairs(&self) -> impl Iterator<Item = (usize, usize)> + '_ {
        (0..self.starts.len() - 1).flat_map(|t| self.row(t).iter().map(move |&s| (t, s as usize)))
    }
}

/// Distance of two cells in cells of the smaller one: 0 where it lies inside, 1 where they touch.
pub(crate) fn cells_between(targets: &Octree, t: usize, sources: &Octree, s: usize) -> i64 {
    let (target_level, source_level) = (targets.level[t], sources.level[s]);
    if target_level >= source_level {
        gap(targets.cell[t], sources.cell[s], target_level - source_level)
    } else {
        gap(sources.cell[s], targets.cell[t], source_level - target_level)
    }
}

/// Distance of a small cell from a cell `levels` above it, in small cells, along the axis where it is largest.
fn gap(small: [i32; 3], large: [i32; 3], levels: u8) -> i64 {
    let along = |i: usize| {
        let first = i64::from(large[i]) << levels;
        let last = first + (1_i64 << levels) - 1;
        let x = i64::from(small[i]);
        (first - x).max(x - last).max(0)
    };
    along(0).max(along(1)).max(along(2))
}

impl From<OctreeError> for ListsError {
    fn from(error: OctreeError) -> Self {
        Self::Facing(error)
    }
}

impl fmt::Display for ListsError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::GridsDiffer { targets, sources } => {
                write!(f, "targets and sources are on different grids: {targets:?} and {sources:?}")
            }
            Self::NoSeparation => write!(f, "the separation must be at least 1, not 0"),
            Self::BadGrazing { grazing } => {
                write!(f, "the grazing cosine must be at least 0 and below 1, not {grazing}")
            }
            Self::Facing(error) => write!(f, "the facing test needs normals: {error}"),
        }
    }
}

impl std::error::Error for ListsError {}

impl FacingCounts {
    pub(crate) fn count(&mut self, facing: Facing) {
        match facing {
            Facing::All => self.all += 1,
            Facing::None => self.none += 1,
            Facing::Some => self.some += 1,
        }
    }
}
