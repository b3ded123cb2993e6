// SPDX-License-Identifier: GPL-3.0-or-later
//! Occlusion in the fast multipole method: its lists become visible lists in rounds of rays, which the caller traces.

use crate::driver::{Fmm, TARGETS_PER_SLAB};
use crate::error::{Error, same_length};
use crate::facing::FacingTest;
use crate::gather::{Gather, GatherRays, Met};
use crate::links::{Links, Weights};
use crate::moving::Bounds;
use crate::near_field::{NearField, Patches};
use crate::octree::Octree;
use crate::places::Places;
use crate::rays::{Frame, Rays};
use crate::shaft::{Blockers, End};
use crate::surface::Surface;
use crate::visibility::{Outcomes, View, Visibility, VisibilityOptions};
use rayon::prelude::*;
use std::ops::Range;
use std::sync::OnceLock;

/// What visibility depends on besides the points.
pub struct Occluded<'a> {
    pub frame: Frame,
    /// (N,) area that each source stands for, scene order.
    pub areas: &'a [f64],
    /// (N,) what each source sends, as a share of what a point in the open receives, in units of area; scene order.
    pub weights: &'a [f64],
    /// (N,) distance within which a source counts by itself, scene order.
    pub reach: &'a [f64],
    /// (N,) distance within which a source stands for too much surface to be summed at all, scene order.
    pub coarse: &'a [f64],
    /// (N,) how far from it the surface that a source stands for goes, scene order.
    pub radii: &'a [f64],
    /// (P, 3, 3) patches, and the barycentric coordinates of the sources on each.
    pub patches: &'a [[[f64; 3]; 3]],
    pub rule: &'a [[f64; 3]],
    /// What things may move in later, which no pair is valid through.
    pub moving: &'a [Bounds],
}

/// What the rays of links are made from.
pub struct Rounds {
    pub(crate) view: View,
    visibility: Visibility,
}

/// For the sources of near entries, in their order.
pub struct NearSeen {
    /// (K * points_per_patch) whether the sum has the pair.
    pub counted: Vec<bool>,
    /// (K * points_per_patch) whether no ray is needed to tell whether what it stands for is seen: it is if it is counted,
    /// and else rays over the hemisphere find it.
    pub known: Vec<bool>,
}

impl Fmm {
    /// Triangles that can be between points of the octrees: where there are none, all pairs are valid.
    pub fn n_blockers(&self) -> usize {
        self.blockers.len()
    }

    /// Makes visible lists of the pairs that are proved to see each other as a whole. Others are left to links,
    /// and to rays over the hemispheres of the points of open leaves.
    pub fn occlude(&mut self, scene: &Occluded, options: VisibilityOptions) -> Result<(), Error> {
        for values in [scene.areas, scene.weights, scene.reach, scene.coarse, scene.radii] {
            same_length("what is known of the sources", self.sources.n_points(), values.len())?;
        }
        same_length("sources of patches", scene.patches.len() * scene.rule.len(), self.sources.n_points())?;
        let in_tree = |values: &[f64]| self.sources.to_scene.iter().map(|&j| values[j as usize]).collect::<Vec<f64>>();
        let largest = |values: &[f64]| -> Vec<f64> {
            let values = in_tree(values);
            let of = |b: usize| values[self.sources.points_of(b)].iter().copied().fold(0.0, f64::max);
            (0..self.sources.n_boxes()).into_par_iter().map(of).collect()
        };
        // Only of whole patches it matters which place is opposite to a target: groups are coarse anyway.
        let whole = |(&radius, &reach): (&f64, &f64)| if reach > 0.0 { radius } else { 0.0 };
        let patches: Vec<f64> = scene.radii.iter().zip(scene.reach).map(whole).collect();
        let facing =
            FacingTest::new(&self.targets, &self.sources, self.lists.options.grazing)?.beyond(largest(&patches));
        let ends = |tree: &Octree| (0..tree.n_boxes()).into_par_iter().map(|b| End::new(tree, b)).collect();
        let view = View {
            targets: self.targets.clone(),
            sources: self.sources.clone(),
            facing,
            frame: scene.frame,
            lists: self.lists.options,
            weights: Weights::new(&in_tree(scene.weights)),
            softening: self.softening.clone(),
            reach: largest(scene.reach),
            coarse: largest(scene.coarse),
            margin: largest(scene.radii),
            places: Places::new(&self.sources, scene.patches, scene.rule, scene.coarse),
            blockers: std::mem::take(&mut self.blockers),
            moving: scene.moving.to_vec(),
            medium: self.medium.clone(),
            absorbing: Blockers::new(&self.medium.bounds(), [&self.targets, &self.sources]),
            ends: [ends(&self.targets), ends(&self.sources)],
        };
        let mut visibility = Visibility::generate(&view, options);
        self.gather = visibility.gather(&view, in_tree(scene.areas));
        visibility.list(&view, &mut self.lists);
        self.batches = self.lists.batches(&self.targets, &self.sources, TARGETS_PER_SLAB);
        self.translations = OnceLock::new();
        self.links = visibility.link(&view);
        self.rounds = Some(Rounds { view, visibility });
        Ok(())
    }

    /// The patches near the targets (M, 3), scene order, as far as the sum counts some of their points one by one.
    pub fn near_field(&self, points: &[[f64; 3]], normals: &[[f64; 3]], patches: &Patches) -> Result<NearField, Error> {
        let points_per_patch = patches.portions.len();
        same_length("targets", self.targets.n_points(), points.len())?;
        same_length("sources", self.sources.n_points(), patches.triangles.len() * points_per_patch)?;
        let mut counted = vec![false; patches.triangles.len()];
        let mut mark = |j: usize| counted[self.sources.to_scene[j] as usize / points_per_patch] = true;
        for &s in &self.lists.near_neighbours.boxes {
            self.sources.points_of(s as usize).for_each(&mut mark);
        }
        self.links.single_points(mark);
        let reach: Vec<f64> =
            patches.reach.iter().zip(counted).map(|(r, counted)| if counted { *r } else { 0.0 }).collect();
        let patches = Patches { reach: &reach, ..*patches };
        let leaves = leaves_of_points(&self.targets);
        NearField::of_some(points, normals, &patches, |target, q| {
            let leaf = leaves[self.targets.to_tree[target] as usize];
            let first = q as usize * points_per_patch;
            !(first..first + points_per_patch).all(|j| self.gather.has(leaf, self.sources.to_tree[j]))
        })
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

    /// Rays that fill the bits of the links of some leaves, in two rounds as in [`Visibility::link_rays`].
    pub fn link_rays(&self, leaves: Range<usize>, second: bool) -> Rays {
        let leaves = leaves.start..leaves.end.min(self.links.leaves.len());
        let rays = |rounds: &Rounds| rounds.visibility.link_rays(&rounds.view, &self.links, leaves, second);
        self.rounds.as_ref().map_or_else(Rays::default, rays)
    }

    /// Open leaves, which want rays over the hemispheres of their points.
    pub fn gather(&self) -> &Gather {
        &self.gather
    }

    /// Rays over the hemispheres of the points of some open leaves.
    pub fn gather_rays(&self, leaves: Range<usize>) -> GatherRays {
        let leaves = leaves.start..leaves.end.min(self.gather.leaves.len());
        let rays = |rounds: &Rounds| self.gather.rays(&self.targets, &rounds.view.frame, leaves, |_, _| true);
        self.rounds.as_ref().map_or_else(GatherRays::default, rays)
    }

    /// Takes what the rays of [`Fmm::gather_rays`] met.
    pub fn take_hits(&self, surface: &Surface, leaves: Range<usize>, met: &Met) -> Result<(), Error> {
        let leaves = leaves.start..leaves.end.min(self.gather.leaves.len());
        self.gather.take((&self.targets, &self.sources), &self.medium, surface, leaves, met)
    }

    /// Which sources of near patches the sum has; `near` is of the targets of this sum, in scene order.
    pub fn near_seen(&self, near: &NearField, points_per_patch: usize) -> NearSeen {
        if let Some(cells) = &self.cells {
            return self.near_seen_by_cells(cells, near, points_per_patch);
        }
        let open_space = self.rounds.is_none();
        let leaves = (leaves_of_points(&self.targets), leaves_of_points(&self.sources));
        let rows: Vec<Vec<Counted>> = (0..self.targets.n_points())
            .into_par_iter()
            .map(|target| {
                let i = self.targets.to_tree[target] as usize;
                let row = &near.patches[near.starts[target]..near.starts[target + 1]];
                let points =
                    row.iter().flat_map(|&q| (0..points_per_patch).map(move |k| q as usize * points_per_patch + k));
                points
                    .map(|source| {
                        let j = self.sources.to_tree[source] as usize;
                        if open_space {
                            let met = self.lists.have(&self.targets, leaves.0[i], &self.sources, leaves.1[j]);
                            return if met { Counted::Whole } else { Counted::Not };
                        }
                        self.seen(i, j, (&leaves.0, &leaves.1))
                    })
                    .collect()
            })
            .collect();
        let rows = rows.concat();
        NearSeen {
            counted: rows.iter().map(|&point| matches!(point, Counted::Whole | Counted::Seen)).collect(),
            known: rows.iter().map(|&point| matches!(point, Counted::Whole | Counted::Gathered)).collect(),
        }
    }

    /// How the sum counts a pair of points, tree order.
    fn seen(&self, i: usize, j: usize, leaves: (&[u32], &[u32])) -> Counted {
        let (t, s) = (leaves.0[i], leaves.1[j]);
        if self.lists.near_neighbours.row(t as usize).binary_search(&s).is_ok() {
            return Counted::Whole;
        }
        let row = i - self.targets.points_of(t as usize).start;
        match self.links.sees(t, row, j) {
            Some(true) => Counted::Seen,
            None if self.gather.has(t, j as u32) => Counted::Gathered,
            _ => Counted::Not,
        }
    }
}

/// How a sum counts a pair of points.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Counted {
    /// Their leaves see each other as a whole.
    Whole,
    /// By a link.
    Seen,
    /// By rays over the hemisphere.
    Gathered,
    Not,
}

/// The leaf of each point of a tree, tree order.
pub(crate) fn leaves_of_points(tree: &Octree) -> Vec<u32> {
    let mut leaves = vec![0; tree.n_points()];
    for b in tree.leaves() {
        leaves[tree.points_of(b)].fill(b as u32);
    }
    leaves
}
