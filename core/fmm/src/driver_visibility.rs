// SPDX-License-Identifier: GPL-3.0-or-later
//! Occlusion in the fast multipole method: its lists become visible lists in rounds of rays, which the caller traces.

use crate::driver::{Fmm, TARGETS_PER_SLAB};
use crate::error::{Error, same_length};
use crate::facing::FacingTest;
use crate::links::{Links, Weights};
use crate::near_field::NearField;
use crate::octree::Octree;
use crate::rays::Frame;
use crate::shaft::{Blockers, End};
use crate::visibility::{Outcomes, Rays, View, Visibility, VisibilityOptions};
use rayon::prelude::*;
use std::ops::Range;
use std::sync::OnceLock;

/// What visibility depends on besides the points.
pub struct Occluded<'a> {
    pub frame: Frame,
    /// (N,) what each source sends, as a share of what a point in the open receives, in units of area; scene order.
    pub weights: &'a [f64],
    /// (N,) distance within which a source counts by itself, scene order.
    pub reach: &'a [f64],
}

/// What the rays of links are made from.
pub struct Rounds {
    view: View,
    visibility: Visibility,
}

/// For the sources of near entries, in their order.
pub struct NearSeen {
    /// (K * points_per_patch) whether the sum has the pair.
    pub counted: Vec<bool>,
    /// (K) whether the whole patch is known to be seen, so that no ray is needed.
    pub whole: Vec<bool>,
}

impl Fmm {
    /// Finds which of the triangles (T, 3, 3) can be between points of the octrees, and returns their number: where there
    /// are none, all pairs are valid.
    pub fn find_blockers(&mut self, triangles: &[[[f64; 3]; 3]]) -> usize {
        self.blockers = Blockers::new(triangles, [&self.targets, &self.sources]);
        self.blockers.len()
    }

    /// Reduces the lists to the pairs that are proved to see each other as a whole, and makes links of the others, which
    /// want rays.
    pub fn occlude(&mut self, scene: &Occluded, options: VisibilityOptions) -> Result<(), Error> {
        same_length("source weights", self.sources.n_points(), scene.weights.len())?;
        same_length("source reach", self.sources.n_points(), scene.reach.len())?;
        let in_tree = |values: &[f64]| self.sources.to_scene.iter().map(|&j| values[j as usize]).collect::<Vec<f64>>();
        let reach = in_tree(scene.reach);
        let farthest = |b: usize| reach[self.sources.points_of(b)].iter().copied().fold(0.0, f64::max);
        let ends = |tree: &Octree| (0..tree.n_boxes()).into_par_iter().map(|b| End::new(tree, b)).collect();
        let view = View {
            targets: self.targets.clone(),
            sources: self.sources.clone(),
            facing: FacingTest::new(&self.targets, &self.sources, self.lists.options.grazing)?,
            frame: scene.frame,
            lists: self.lists.options,
            weights: Weights::new(&in_tree(scene.weights)),
            softening: self.softening.clone(),
            reach: (0..self.sources.n_boxes()).into_par_iter().map(farthest).collect(),
            blockers: std::mem::take(&mut self.blockers),
            ends: [ends(&self.targets), ends(&self.sources)],
        };
        let mut visibility = Visibility::generate(&view, &self.lists, options);
        self.links = visibility.finish(&view, &mut self.lists);
        self.batches = self.lists.batches(&self.targets, &self.sources, TARGETS_PER_SLAB);
        self.translations = OnceLock::new();
        self.rounds = Some(Rounds { view, visibility });
        Ok(())
    }

    /// Pairs of boxes by outcome; without occlusion all of them are valid.
    pub fn outcomes(&self) -> Outcomes {
        let valid = self.lists.all().iter().map(|rows| rows.boxes.len()).sum();
        let of_rounds = self.rounds.as_ref().map(|rounds| rounds.visibility.outcomes);
        self.outcomes.or(of_rounds).unwrap_or(Outcomes { valid, ..Outcomes::default() })
    }

    /// Links between target leaves and what they see in part.
    pub fn links(&self) -> &Links {
        &self.links
    }

    /// Rays that fill the bits of the links of some leaves.
    pub fn link_rays(&self, leaves: Range<usize>) -> Rays {
        let leaves = leaves.start..leaves.end.min(self.links.leaves.len());
        let rays = |rounds: &Rounds| rounds.visibility.link_rays(&rounds.view, &self.links, leaves);
        self.rounds.as_ref().map_or_else(Rays::default, rays)
    }

    /// Which sources of near patches the sum has; `near` is of the targets of this sum, in scene order.
    pub fn near_seen(&self, near: &NearField, points_per_patch: usize) -> NearSeen {
        if let Some(cells) = &self.cells {
            return self.near_seen_by_cells(cells, near, points_per_patch);
        }
        let leaves = (leaves_of_points(&self.targets), leaves_of_points(&self.sources));
        let rows: Vec<Vec<Option<bool>>> = (0..self.targets.n_points())
            .into_par_iter()
            .map(|target| {
                let i = self.targets.to_tree[target] as usize;
                let row = &near.patches[near.starts[target]..near.starts[target + 1]];
                let points =
                    row.iter().flat_map(|&q| (0..points_per_patch).map(move |k| q as usize * points_per_patch + k));
                points
                    .map(|source| self.seen(i, self.sources.to_tree[source] as usize, (&leaves.0, &leaves.1)))
                    .collect()
            })
            .collect();
        let rows = rows.concat();
        NearSeen {
            counted: rows.iter().map(|seen| seen.unwrap_or(true)).collect(),
            whole: rows.chunks(points_per_patch).map(|patch| patch.iter().all(Option::is_none)).collect(),
        }
    }

    /// Whether the sum has a pair of points, tree order; None where their leaves see each other as a whole.
    fn seen(&self, i: usize, j: usize, leaves: (&[u32], &[u32])) -> Option<bool> {
        let (t, s) = (leaves.0[i], leaves.1[j]);
        if self.lists.near_neighbours.row(t as usize).binary_search(&s).is_ok() {
            return None;
        }
        let row = i - self.targets.points_of(t as usize).start;
        Some(self.links.sees(t, row, j).unwrap_or(false))
    }
}

/// The leaf of each point of a tree, tree order.
fn leaves_of_points(tree: &Octree) -> Vec<u32> {
    let mut leaves = vec![0; tree.n_points()];
    for b in tree.leaves() {
        leaves[tree.points_of(b)].fill(b as u32);
    }
    leaves
}
