// SPDX-License-Identifier: GPL-3.0-or-later
//! Dual traversal of a target tree and a source tree.
//!
//! As in procedures Generate and Modify of the paper's Figure 7 the targets are visited level by level; each looks at the
//! children of the source boxes that its parent postponed, keeps those that can be settled at this level, and
//! postpones the others to its own children. Targets of one level are independent of each other and visited in parallel.

use std::ops::Range;

use rayon::prelude::*;

use crate::facing::{Facing, FacingTest};
use crate::lists::{FacingCounts, Lists, ListsOptions, Rows, cells_between};
use crate::octree::Octree;

/// Targets visited by one task: small enough to balance, large enough to be worth a task.
const TASK: usize = 64;

struct Traversal<'a> {
    targets: &'a Octree,
    sources: &'a Octree,
    options: ListsOptions,
    facing: Option<&'a FacingTest>,
}

/// Rows of a run of consecutive targets.
struct Part {
    near: Rows,
    interaction: Rows,
    local: Rows,
    multipole: Rows,
    /// Source boxes of the same level that are left to the children of both.
    postponed: Rows,
    /// Source leaves of this level or above that are left to the children of the target.
    leaves: Rows,
    counts: FacingCounts,
}

pub(crate) fn traverse(
    targets: &Octree,
    sources: &Octree,
    options: ListsOptions,
    facing: Option<&FacingTest>,
) -> Lists {
    let traversal = Traversal { targets, sources, options, facing };
    let mut whole = Part::new();
    for level in 0..targets.n_levels() {
        for part in traversal.visit_level(targets.boxes_of_level(level), &whole) {
            whole.append(part);
        }
    }
    Lists {
        options,
        near_neighbours: whole.near,
        interaction_list: whole.interaction,
        local_interaction_list: whole.local,
        multipole_interaction_list: whole.multipole,
        facing_counts: whole.counts,
    }
}

impl Traversal<'_> {
    /// Rows of the targets of one level, from those of the levels above.
    fn visit_level(&self, level: Range<usize>, above: &Part) -> Vec<Part> {
        let visit_task = |start: usize| {
            let mut part = Part::new();
            for t in start..level.end.min(start + TASK) {
                self.visit(t, above, &mut part);
                part.end_row();
            }
            part
        };
        level.clone().into_par_iter().step_by(TASK).map(visit_task).collect()
    }

    fn visit(&self, t: usize, above: &Part, part: &mut Part) {
        if self.targets.level[t] == 0 {
            self.sources.roots().for_each(|s| self.same_level(t, s, part));
            return;
        }
        let parent = self.targets.parent[t] as usize;
        for &s in above.postponed.row(parent) {
            self.sources.children(s as usize).for_each(|c| self.same_level(t, c, part));
        }
        for &s in above.leaves.row(parent) {
            self.source_leaf(t, s as usize, part);
        }
    }

    /// Two boxes of one level.
    fn same_level(&self, t: usize, s: usize, part: &mut Part) {
        let facing = self.classify(t, s, part);
        if facing == Facing::None {
            return;
        }
        let separated = self.well_separated(t, s);
        let leaves = (self.targets.is_leaf(t), self.sources.is_leaf(s));
        let few = self.options.few_pairs(self.targets, t, self.sources, s);
        if separated && facing == Facing::All && !few {
            part.interaction.push(s);
            return;
        }
        part.counts.postponed += u64::from(separated && facing == Facing::Some);
        match leaves {
            (true, true) => part.near.push(s),
            (true, false) => self.target_leaf(t, s, part),
            (false, true) => part.leaves.push(s),
            (false, false) => part.postponed.push(s),
        }
    }

    /// Whether a point of a leaf is summed with so many points of another box sooner than with its expansion.
    fn few(&self, points: usize) -> bool {
        points <= self.options.direct_points
    }

    /// A target leaf and the children of a source box: they are settled with the leaf, however deep.
    fn target_leaf(&self, t: usize, s: usize, part: &mut Part) {
        for c in self.sources.children(s) {
            let facing = self.classify(t, c, part);
            if facing == Facing::None {
                continue;
            } else if facing == Facing::All && self.well_separated(t, c) && !self.few(self.sources.count(c)) {
                part.multipole.push(c);
            } else if self.sources.is_leaf(c) {
                part.near.push(c);
            } else {
                self.target_leaf(t, c, part);
            }
        }
    }

    /// A target box and a larger source leaf.
    fn source_leaf(&self, t: usize, s: usize, part: &mut Part) {
        let facing = self.classify(t, s, part);
        if facing == Facing::None {
        } else if facing == Facing::All && self.well_separated(t, s) && !self.few(self.targets.count(t)) {
            part.local.push(s);
        } else if self.targets.is_leaf(t) {
            part.near.push(s);
        } else {
            part.leaves.push(s);
        }
    }

    fn classify(&self, t: usize, s: usize, part: &mut Part) -> Facing {
        let Some(test) = self.facing else { return Facing::All };
        let facing = test.classify(t, s);
        part.counts.count(facing);
        facing
    }

    fn well_separated(&self, t: usize, s: usize) -> bool {
        cells_between(self.targets, t, self.sources, s) > i64::from(self.options.separation)
    }
}

impl Part {
    fn new() -> Self {
        let rows = || Rows { starts: vec![0], boxes: Vec::new() };
        Self {
            near: rows(),
            interaction: rows(),
            local: rows(),
            multipole: rows(),
            postponed: rows(),
            leaves: rows(),
            counts: FacingCounts::default(),
        }
    }

    fn rows(&mut self) -> [&mut Rows; 6] {
        let Self { near, interaction, local, multipole, postponed, leaves, .. } = self;
        [near, interaction, local, multipole, postponed, leaves]
    }

    fn end_row(&mut self) {
        for rows in self.rows() {
            let start = rows.starts.last().copied().unwrap_or(0);
            rows.boxes[start..].sort_unstable();
            rows.starts.push(rows.boxes.len());
        }
    }

    fn append(&mut self, mut part: Part) {
        for (all, rows) in self.rows().into_iter().zip(part.rows()) {
            let before = all.boxes.len();
            all.starts.extend(rows.starts[1..].iter().map(|start| before + start));
            all.boxes.append(&mut rows.boxes);
        }
        self.counts.all += part.counts.all;
        self.counts.none += part.counts.none;
        self.counts.some += part.counts.some;
        self.counts.postponed += part.counts.postponed;
    }
}

impl Rows {
    fn push(&mut self, b: usize) {
        self.boxes.push(b as u32);
    }
}
