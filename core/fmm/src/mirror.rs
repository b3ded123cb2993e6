// SPDX-License-Identifier: GPL-3.0-or-later
//! The sum the other way round: what each source sends to all targets together. The kernel is the same both ways, so
//! that mirrored lists serve; links and gathered rays belong to one end, and are summed from the other.

use crate::direct::Sources;
use crate::driver::{Fmm, TARGETS_PER_SLAB, run};
use crate::error::{Error, same_length};
use crate::gather::Gather;
use crate::links::Links;
use crate::lists::{Lists, Rows};
use crate::passes::Passes;

impl Fmm {
    /// What each source (N,) sends for one unit of strength to points of areas (N,), scene order, in a sum of points over
    /// themselves, if nothing were absorbed; what guests send there follows.
    pub fn sent(&self, areas: &[f64]) -> Result<Vec<f64>, Error> {
        let tree = self.sources.as_ref();
        same_length("areas", self.targets.n_points(), areas.len())?;
        same_length("targets", tree.n_points(), self.targets.n_points())?;
        let lists = self.lists.mirrored();
        let batches = lists.batches(tree, tree, TARGETS_PER_SLAB);
        let points = Sources::grouped(&tree.positions, &tree.normals, &self.softening, tree.points_of_leaves())?;
        let (links, gather) = (Links::default(), Gather::default());
        let passes = Passes {
            expansion: self.expansion.as_ref(),
            targets: tree,
            sources: tree,
            lists: &lists,
            batches: &batches,
            translations: self.translations(),
            points: &points,
            links: &links,
            gather: &gather,
            medium: None,
        };
        let areas: Vec<[f64; 1]> = areas.iter().map(|&area| [area]).collect();
        let areas = tree.in_tree_order(&areas);
        let mut sent = run(&passes, &areas)?.0;
        self.links.sent(tree, &areas, &mut sent);
        sent.resize(tree.n_points() + self.moved.guests, [0.0]);
        self.gather.sent(tree, &areas, &mut sent);
        let (own, guests) = sent.split_at(tree.n_points());
        let mut found = tree.in_scene_order(own);
        found.extend(guests);
        Ok(found.into_flattened())
    }
}

impl Lists {
    /// The same pairs with targets and sources exchanged, which are of one octree.
    fn mirrored(&self) -> Self {
        Self {
            options: self.options,
            near_neighbours: self.near_neighbours.mirrored(),
            interaction_list: self.interaction_list.mirrored(),
            local_interaction_list: self.multipole_interaction_list.mirrored(),
            multipole_interaction_list: self.local_interaction_list.mirrored(),
            facing_counts: self.facing_counts,
        }
    }
}

impl Rows {
    fn mirrored(&self) -> Self {
        let count = self.starts.len() - 1;
        let mut starts = vec![0; count + 1];
        for &source in &self.boxes {
            starts[source as usize + 1] += 1;
        }
        for b in 0..count {
            starts[b + 1] += starts[b];
        }
        let (mut next, mut boxes) = (starts.clone(), vec![0; self.boxes.len()]);
        for (target, source) in self.pairs() {
            boxes[next[source]] = target as u32;
            next[source] += 1;
        }
        Self { starts, boxes }
    }
}
