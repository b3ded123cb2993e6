// SPDX-License-Identifier: GPL-3.0-or-later
//! The paper's own visibility algorithm (section 5): two boxes see each other as their cells do. Cells are the leaves of the
//! octrees, and each pair of them that faces each other is asked by rays whether it is visible as a whole.
//!
//! It takes O(n^2) rays for n cells, however many points they hold, and shadows come out as coarse as the cells.

use crate::bits::Bits;
use crate::error::{Error, same_length};
use crate::facing::{Facing, FacingTest};
use crate::links::Weights;
use crate::lists::{Lists, ListsOptions};
use crate::medium::Medium;
use crate::octree::Octree;
use crate::places::Places;
use crate::rays::{Frame, Rays};
use crate::shaft::Blockers;
use crate::visibility::{Kind, Pair, View};
use rayon::prelude::*;
use std::ops::Range;
use std::sync::Arc;

/// Rays of a pair of cells, as many as representatives of each; odd, so that their majority is clear.
pub const REPRESENTATIVES: usize = 5;

/// The state of visibility of a pair of boxes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum State {
    /// All pairs of cells that face each other are visible.
    Valid,
    /// Some are.
    Partial,
    /// None is.
    Invalid,
}

/// What is known of a pair of cells, R target cells by C source cells.
pub struct Cells {
    view: View,
    rows: Order,
    columns: Order,
    /// (R, C) has a pair of points that face each other.
    faces: Bits,
    /// (R, C) and is visible.
    seen: Bits,
}

/// The pairs of all lists, told apart.
#[derive(Debug, Default)]
pub struct VisibleLists {
    pub(crate) valid: Vec<Pair>,
    pub(crate) invalid: Vec<Pair>,
    /// Partial pairs, in whose place their children are.
    pub postponed: usize,
}

/// The cells of an octree in the order of their points, so that those of any box are one range.
struct Order {
    /// (n,) leaves.
    cells: Vec<usize>,
    /// (n,) first point of each, tree order.
    starts: Vec<usize>,
}

impl Cells {
    /// The cells of two octrees, of which no pair is known to see each other yet.
    pub fn new(targets: Arc<Octree>, sources: Arc<Octree>, frame: Frame, lists: ListsOptions) -> Result<Self, Error> {
        let (rows, columns) = (Order::new(&targets), Order::new(&sources));
        let bits = || Bits::new(rows.cells.len(), columns.cells.len());
        let (faces, seen) = (bits()?, bits()?);
        let view = View {
            facing: FacingTest::new(&targets, &sources, lists.grazing)?,
            frame,
            lists,
            weights: Weights::new(&[]),
            softening: Vec::new(),
            // Cells decide about all pairs, however near.
            reach: vec![0.0; sources.n_boxes()],
            coarse: Vec::new(),
            margin: Vec::new(),
            places: Places::default(),
            blockers: Blockers::default(),
            moving: Vec::new(),
            medium: Medium::default(),
            absorbing: Blockers::default(),
            ends: [Vec::new(), Vec::new()],
            targets,
            sources,
        };
        Ok(Self { view, rows, columns, faces, seen })
    }

    /// Number of target cells.
    pub fn len(&self) -> usize {
        self.rows.cells.len()
    }

    pub fn is_empty(&self) -> bool {
        self.rows.cells.is_empty()
    }

    /// Shoots from some target cells: rays to all source cells that face them, which `detect` wants the answers of. Within
    /// one octree each pair is asked once.
    pub fn shoot(&self, rows: Range<usize>) -> Rays {
        let mut rays = Rays::default();
        for row in rows.start..rows.end.min(self.len()) {
            for column in if self.mirrored() { row } else { 0 }..self.columns.cells.len() {
                let (a, b) = (self.rows.cells[row], self.columns.cells[column]);
                let slot = (row * self.columns.cells.len() + column) as u64;
                if self.view.facing.classify(a, b) != Facing::None && self.shoot_pair(a, b, slot, &mut rays) {
                    self.set(&self.faces, row, column);
                }
            }
        }
        rays
    }

    /// Rays between the representatives of cells a and b, or between the first points that face each other where no
    /// representatives do; false where no points do.
    fn shoot_pair(&self, a: usize, b: usize, slot: u64, rays: &mut Rays) -> bool {
        let (from, to) = (self.view.targets.points_of(a), self.view.sources.points_of(b));
        let count = REPRESENTATIVES.min(from.len().max(to.len()));
        // Points follow each other along a curve: the middles of its equal parts are spread evenly.
        let representative = |points: &Range<usize>, k: usize| points.start + (2 * k + 1) * points.len() / (2 * count);
        let before = rays.slots.len();
        for k in 0..count {
            self.view.push((representative(&from, k), representative(&to, k)), slot, rays);
        }
        rays.slots.len() > before || from.clone().any(|i| to.clone().any(|j| self.view.push((i, j), slot, rays)))
    }

    /// Detects which pairs of cells are visible: those of which most rays arrive. The slots of one pair follow each other.
    pub fn detect(&self, slots: &[u64], occluded: &[bool]) -> Result<(), Error> {
        same_length("answers", slots.len(), occluded.len())?;
        let (columns, mut answers) = (self.columns.cells.len(), occluded);
        for pair in slots.chunk_by(|a, b| a == b) {
            let (slot, count) = (pair[0] as usize, self.len() * columns);
            if slot >= count {
                return Err(Error::Index { what: "pair of cells", index: slot, count });
            }
            let (own, rest) = answers.split_at(pair.len());
            answers = rest;
            if 2 * own.iter().filter(|&&occluded| occluded).count() < own.len() {
                self.set(&self.seen, slot / columns, slot % columns);
            }
        }
        Ok(())
    }

    /// The state of visibility of target box a and source box b, from their cells upward (Figure 8). A pair of which no
    /// cells face each other exchanges nothing and is invalid.
    pub fn visibility(&self, a: usize, b: usize) -> State {
        let columns = self.columns.of(&self.view.sources, b);
        let (mut visible, mut hidden) = (false, false);
        for row in self.rows.of(&self.view.targets, a) {
            for (faces, seen) in self.faces.words_of(row, &columns).zip(self.seen.words_of(row, &columns)) {
                visible |= seen != 0;
                hidden |= faces & !seen != 0;
                if visible && hidden {
                    return State::Partial;
                }
            }
        }
        if visible { State::Valid } else { State::Invalid }
    }

    /// Procedure Generate (Figure 7), on all lists, level by level.
    pub fn generate(&self, lists: &Lists) -> VisibleLists {
        let kinds = [Kind::Near, Kind::Interaction, Kind::Local, Kind::Multipole];
        let mut pending: Vec<Pair> = lists
            .all()
            .into_iter()
            .zip(kinds)
            .flat_map(|(rows, kind)| rows.pairs().map(move |(t, s)| Pair { target: t as u32, source: s as u32, kind }))
            .collect();
        let mut all = VisibleLists::default();
        while !pending.is_empty() {
            pending = self.modify(pending, &mut all);
        }
        all
    }

    /// Procedure Modify: keeps the valid ones of these pairs, drops the invalid ones, and returns what the others are
    /// postponed to.
    fn modify(&self, pairs: Vec<Pair>, all: &mut VisibleLists) -> Vec<Pair> {
        let state = |pair: &Pair| self.visibility(pair.target as usize, pair.source as usize);
        let states: Vec<State> = pairs.par_iter().map(state).collect();
        let mut postponed = Vec::new();
        for (pair, state) in pairs.into_iter().zip(states) {
            match state {
                State::Valid => all.valid.push(pair),
                State::Invalid => all.invalid.push(pair),
                State::Partial => {
                    all.postponed += 1;
                    self.view.postpone(pair.target as usize, pair.source as usize, &mut postponed);
                }
            }
        }
        postponed
    }

    /// Whether the cells of two points are visible to each other, tree order; None where they do not face each other.
    pub fn sees(&self, i: usize, j: usize) -> Option<bool> {
        let (row, column) = (self.rows.cell_of(i), self.columns.cell_of(j));
        self.faces.get(row, column).then(|| self.seen.get(row, column))
    }

    /// Whether targets and sources are one octree, so that both sides of a pair see the same.
    fn mirrored(&self) -> bool {
        Arc::ptr_eq(&self.view.targets, &self.view.sources)
    }

    fn set(&self, bits: &Bits, row: usize, column: usize) {
        bits.set(row, column);
        if self.mirrored() {
            bits.set(column, row);
        }
    }
}

impl Order {
    fn new(tree: &Octree) -> Self {
        let cells = tree.leaves_by_points();
        let starts = cells.iter().map(|&cell| tree.points_of(cell).start).collect();
        Self { cells, starts }
    }

    /// The cells at or below a box.
    fn of(&self, tree: &Octree, b: usize) -> Range<usize> {
        let points = tree.points_of(b);
        let first = self.starts.partition_point(|&start| start < points.start);
        first..first + self.starts[first..].partition_point(|&start| start < points.end)
    }

    fn cell_of(&self, point: usize) -> usize {
        self.starts.partition_point(|&start| start <= point) - 1
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::lists::Rows;
    use crate::octree::{Grid, Grouping, OctreeOptions};

    /// Points on the inside of the unit cube and on the outside of a smaller one in it.
    fn points(count: usize, seed: u64) -> (Vec<[f64; 3]>, Vec<[f64; 3]>) {
        let mut state = seed;
        let mut random = move || {
            state ^= state << 13;
            state ^= state >> 7;
            state ^= state << 17;
            (state >> 11) as f64 / (1_u64 << 53) as f64
        };
        let point = |i: usize| {
            let (face, inner) = (i % 6, i.is_multiple_of(5));
            let mut x = [random(), random(), random()];
            x[face % 3] = (face / 3) as f64;
            let mut n = [0.0; 3];
            n[face % 3] = if (face < 3) != inner { 1.0 } else { -1.0 };
            (if inner { x.map(|x| 0.3 + 0.4 * x) } else { x }, n)
        };
        (0..count).map(point).unzip()
    }

    /// Cells of one octree, or of two, with answers that follow no geometry: runs of neighbours see each other or not.
    fn cells(grouping: Grouping, two: bool) -> (Cells, Lists) {
        let options = OctreeOptions { grouping, by_normal: true };
        let (y, x) = (points(3000, 5), points(1000, 9));
        let grid = Grid::around(&[&y.0, &x.0]).unwrap();
        let sources = Arc::new(Octree::new(&y.0, Some(&y.1), grid, options).unwrap());
        let targets = if two { Octree::new(&x.0, Some(&x.1), grid, options).unwrap().into() } else { sources.clone() };
        let options = ListsOptions { direct_pairs: 100, direct_points: 10, ..ListsOptions::new(1, true) };
        let lists = Lists::new(&targets, &sources, options).unwrap();
        let frame = Frame { centre: [0.5; 3], scale: 0.5, offset: 1e-6 };
        let cells = Cells::new(targets, sources, frame, options).unwrap();
        let rays = cells.shoot(0..cells.len());
        let occluded: Vec<bool> = rays.slots.iter().map(|slot| slot / 40 % 7 > 4).collect();
        cells.detect(&rays.slots, &occluded).unwrap();
        (cells, lists)
    }

    fn cases() -> impl Iterator<Item = (Cells, Lists)> {
        [Grouping::Uniform { level: 3 }, Grouping::Adaptive { points: 12 }]
            .into_iter()
            .flat_map(|grouping| [false, true].map(|two| cells(grouping, two)))
    }

    fn leaves(tree: &Octree, b: usize) -> Vec<usize> {
        if tree.is_leaf(b) { vec![b] } else { tree.children(b).flat_map(|c| leaves(tree, c)).collect() }
    }

    /// Facing and visible, as found for two leaves.
    fn found(cells: &Cells, a: usize, b: usize) -> Option<bool> {
        cells.sees(cells.view.targets.points_of(a).start, cells.view.sources.points_of(b).start)
    }

    #[test]
    fn boxes_see_each_other_as_their_cells_do() {
        for (cells, lists) in cases() {
            let (targets, sources) = (&cells.view.targets, &cells.view.sources);
            let mut states = [0; 3];
            let pairs = lists.all().into_iter().flat_map(Rows::pairs);
            let roots = targets.roots().flat_map(|a| sources.roots().map(move |b| (a, b)));
            for (a, b) in pairs.chain(roots) {
                let pairs =
                    leaves(targets, a).into_iter().flat_map(|a| leaves(sources, b).into_iter().map(move |b| (a, b)));
                let seen: Vec<bool> = pairs.filter_map(|(a, b)| found(&cells, a, b)).collect();
                let expected = match (seen.contains(&true), seen.contains(&false)) {
                    (true, false) => State::Valid,
                    (true, true) => State::Partial,
                    (false, _) => State::Invalid,
                };
                assert_eq!(cells.visibility(a, b), expected, "{a} {b}");
                states[expected as usize] += 1;
            }
            assert!(states.iter().all(|&count| count > 10), "{states:?}");
        }
    }

    #[test]
    fn lists_and_invalid_pairs_share_out_all_pairs_of_cells() {
        for (cells, lists) in cases() {
            let (targets, sources) = (&cells.view.targets, &cells.view.sources);
            let visible = cells.generate(&lists);
            assert!(visible.postponed > 10);
            let mut times = vec![0; targets.n_boxes() * sources.n_boxes()];
            for (pairs, valid) in [(&visible.valid, true), (&visible.invalid, false)] {
                for pair in pairs {
                    for a in leaves(targets, pair.target as usize) {
                        for b in leaves(sources, pair.source as usize) {
                            times[a * sources.n_boxes() + b] += 1;
                            assert_ne!(found(&cells, a, b), Some(!valid), "{a} {b}");
                        }
                    }
                }
            }
            for a in targets.leaves() {
                for b in sources.leaves() {
                    let count = times[a * sources.n_boxes() + b];
                    assert!(count <= 1, "{a} {b} counted {count} times");
                    assert_eq!(count.max(u8::from(found(&cells, a, b).is_none())), 1, "{a} {b} is lost");
                }
            }
        }
    }

    #[test]
    fn one_octree_asks_each_pair_once_and_finds_it_both_ways() {
        let (cells, _) = cells(Grouping::Uniform { level: 2 }, false);
        let slots = cells.shoot(0..cells.len()).slots;
        let count = cells.len() as u64;
        assert!(slots.iter().all(|slot| slot / count <= slot % count));
        for (row, column) in (0..cells.len()).flat_map(|row| (0..row).map(move |column| (row, column))) {
            assert_eq!(cells.seen.get(row, column), cells.seen.get(column, row));
            assert_eq!(cells.faces.get(row, column), cells.faces.get(column, row));
        }
    }

    #[test]
    fn most_rays_decide_and_wrong_slots_are_refused() {
        let (mut cells, _) = cells(Grouping::Uniform { level: 1 }, true);
        let slot = 3;
        cells.seen = Bits::new(cells.rows.cells.len(), cells.columns.cells.len()).unwrap();
        cells.detect(&[slot; 5], &[true, true, false, true, false]).unwrap();
        assert!(!cells.seen.get(0, 3));
        cells.detect(&[slot; 5], &[true, true, false, false, false]).unwrap();
        assert!(cells.seen.get(0, 3));
        assert!(cells.detect(&[u64::MAX], &[false]).is_err());
        assert!(cells.detect(&[slot], &[]).is_err());
    }
}
