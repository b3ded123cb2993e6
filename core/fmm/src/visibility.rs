// SPDX-License-Identifier: GPL-3.0-or-later
//! From interaction lists to visible interaction lists (section 5 of the paper).
//!
//! As in procedure Modify of the paper's Figure 7 valid pairs stay where they are and other pairs are postponed to the
//! children. Unlike there a pair is valid where a shaft proves it, and not both sides are postponed to the leaves: a
//! source box that looks small is kept, and only the receivers are told apart, down to single points, by rays; see
//! [`crate::links`].

use crate::facing::{Facing, FacingTest};
use crate::links::{Links, Weights};
use crate::lists::{Lists, ListsOptions, cells_between};
use crate::octree::Octree;
use crate::rays::{Frame, facing};
use crate::shaft::{Blockers, End};
use crate::vector::{norm, sub};
use rayon::prelude::*;
use std::f64::consts::PI;
use std::ops::Range;
use std::sync::Arc;

/// How much is spent on visibility.
#[derive(Debug, Clone, Copy)]
pub struct VisibilityOptions {
    /// Share of the irradiance in the open that one ray from a receiver stands for.
    pub share: f64,
    /// Size over distance up to which a source box that may be seen in part is not split.
    pub angle: f64,
    /// Size over distance of the runs that it is then cut into, one for each ray.
    pub run_angle: f64,
    /// Size over distance of what counts as one source.
    pub part_angle: f64,
}

/// Which list a pair belongs to where it is valid.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Kind {
    Near,
    Interaction,
    Local,
    Multipole,
    /// Between any two boxes: the source box is kept although the target is smaller.
    Link,
}

#[derive(Debug, Clone, Copy)]
pub(crate) struct Pair {
    pub target: u32,
    pub source: u32,
    pub kind: Kind,
}

/// Rays, each with the slot that its answer goes to.
#[derive(Debug, Default)]
pub struct Rays {
    pub slots: Vec<u64>,
    pub origins: Vec<[f32; 3]>,
    pub directions: Vec<[f32; 3]>,
}

/// The octrees and what is known of their points.
pub struct View {
    pub targets: Arc<Octree>,
    pub sources: Arc<Octree>,
    pub facing: FacingTest,
    pub frame: Frame,
    pub lists: ListsOptions,
    /// What each source sends, as a share of what a point in the open receives, in units of area.
    pub weights: Weights,
    /// (N,) in tree order.
    pub softening: Vec<f64>,
    /// (B,): nearer than that the points of a source box count one by one.
    pub reach: Vec<f64>,
    pub blockers: Blockers,
    /// The boxes of the targets and of the sources as ends of shafts.
    pub ends: [Vec<End>; 2],
}

/// Pairs by outcome.
#[derive(Debug, Clone, Copy, Default)]
pub struct Outcomes {
    pub valid: usize,
    pub partial: usize,
    pub invalid: usize,
}

/// The pairs of all lists, told apart.
#[derive(Debug)]
pub struct Visibility {
    pub(crate) options: VisibilityOptions,
    pub(crate) valid: Vec<Pair>,
    /// Pairs of a target leaf and a source box that it may see in part.
    pub(crate) links: Vec<Pair>,
    pub outcomes: Outcomes,
}

impl Visibility {
    /// Procedure Generate of the paper's Figure 7; pairs within reach of each other are not expanded.
    pub fn generate(view: &View, lists: &Lists, options: VisibilityOptions) -> Self {
        let kinds = [Kind::Near, Kind::Interaction, Kind::Local, Kind::Multipole];
        let pairs: Vec<Pair> = lists
            .all()
            .into_iter()
            .zip(kinds)
            .flat_map(|(rows, kind)| rows.pairs().map(move |(t, s)| Pair { target: t as u32, source: s as u32, kind }))
            .collect();
        let apart = |&pair: &Pair| {
            let (t, s) = (pair.target as usize, pair.source as usize);
            if pair.kind == Kind::Near || view.distance(t, s) >= view.reach[s] {
                return vec![pair];
            }
            let mut pairs = Vec::new();
            view.split(t, s, &mut pairs);
            pairs
        };
        let mut pending: Vec<Pair> = pairs.par_iter().flat_map_iter(apart).collect();
        let mut all = Self { options, valid: Vec::new(), links: Vec::new(), outcomes: Outcomes::default() };
        while !pending.is_empty() {
            pending = all.modify(view, pending);
        }
        all
    }

    /// Procedure Modify: keeps the valid ones of these pairs, and returns what the others are postponed to.
    fn modify(&mut self, view: &View, pairs: Vec<Pair>) -> Vec<Pair> {
        let clear: Vec<bool> = pairs.par_iter().map(|pair| view.is_clear(pair)).collect();
        let (mut partial, mut pending) = (Vec::new(), Vec::new());
        for (pair, clear) in pairs.into_iter().zip(clear) {
            if clear { self.valid.push(pair) } else { partial.push(pair) }
        }
        let postponed: Vec<Vec<Pair>> = partial.par_iter().map(|&pair| self.postpone(view, pair)).collect();
        for (pair, children) in partial.into_iter().zip(postponed) {
            if children.is_empty() {
                self.links.push(pair);
            }
            self.outcomes.partial += 1;
            pending.extend(children);
        }
        self.outcomes.valid = self.valid.len();
        pending
    }

    /// Pairs of children that stand for a partial pair; none where it becomes a link.
    fn postpone(&self, view: &View, pair: Pair) -> Vec<Pair> {
        let (t, s) = (pair.target as usize, pair.source as usize);
        let leaves = (view.targets.is_leaf(t), view.sources.is_leaf(s));
        let mut pairs = Vec::new();
        if pair.kind == Kind::Link || leaves.1 || view.angle(t, s) <= self.options.angle {
            let below = |c: usize| Pair { target: c as u32, source: pair.source, kind: Kind::Link };
            pairs.extend(view.targets.children(t).map(below));
        } else if leaves.0 || view.targets.level[t] > view.sources.level[s] {
            view.sources.children(s).for_each(|s| view.sort(t, s, &mut pairs));
        } else {
            view.split(t, s, &mut pairs);
        }
        pairs
    }

    /// Rays that fill the bits of some leaves' links, whose slots they have.
    pub fn link_rays(&self, view: &View, links: &Links, leaves: Range<usize>) -> Rays {
        let mut rays = Rays::default();
        for leaf in &links.leaves[leaves] {
            for (row, i) in view.targets.points_of(leaf.leaf as usize).enumerate() {
                let turn = hash(i as u64);
                for (run, &column) in leaf.runs.iter().zip(&leaf.columns) {
                    let run = &links.runs.runs[*run as usize];
                    let random = unit(hash(turn ^ u64::from(run.points.start) << 32));
                    let (x, n_x) = (view.targets.positions[i], view.targets.normals[i]);
                    let j = links.runs.point(x, n_x, run, &view.weights, random);
                    let slot = links.slot(leaf, row, column, run);
                    if !view.push((i, j), slot, &mut rays) {
                        links.clear(slot);
                    }
                }
            }
        }
        rays
    }
}

impl View {
    fn is_clear(&self, pair: &Pair) -> bool {
        let (t, s) = (pair.target as usize, pair.source as usize);
        self.blockers.are_clear(&self.ends[0][t], &self.ends[1][s])
    }

    /// Sorts a pair of boxes into the lists, or those of its children where it can be expanded only there.
    fn sort(&self, t: usize, s: usize, pairs: &mut Vec<Pair>) {
        let facing = self.facing.classify(t, s);
        if facing == Facing::None {
            return;
        }
        let pair = |kind| Pair { target: t as u32, source: s as u32, kind };
        let leaves = (self.targets.is_leaf(t), self.sources.is_leaf(s));
        let levels = (self.targets.level[t], self.sources.level[s]);
        let separated = cells_between(&self.targets, t, &self.sources, s) > i64::from(self.lists.separation)
            && self.distance(t, s) >= self.reach[s];
        let expanded = separated && facing == Facing::All;
        if expanded && levels.0 == levels.1 && !self.lists.few_pairs(&self.targets, t, &self.sources, s) {
            pairs.push(pair(Kind::Interaction));
        } else if expanded && leaves.0 && levels.0 < levels.1 {
            pairs.push(pair(Kind::Multipole));
        } else if expanded && leaves.1 && levels.0 > levels.1 {
            pairs.push(pair(Kind::Local));
        } else {
            self.split(t, s, pairs);
        }
    }

    /// The children of both in place of a pair, as far as there are any.
    pub(crate) fn split(&self, t: usize, s: usize, pairs: &mut Vec<Pair>) {
        match (self.targets.is_leaf(t), self.sources.is_leaf(s)) {
            (true, true) => pairs.push(Pair { target: t as u32, source: s as u32, kind: Kind::Near }),
            (false, true) => self.targets.children(t).for_each(|t| self.sort(t, s, pairs)),
            (true, false) => self.sources.children(s).for_each(|s| self.sort(t, s, pairs)),
            (false, false) => {
                for t in self.targets.children(t) {
                    self.sources.children(s).for_each(|s| self.sort(t, s, pairs));
                }
            }
        }
    }

    /// The ray between two points; false where they do not face each other.
    pub(crate) fn push(&self, (i, j): (usize, usize), slot: u64, rays: &mut Rays) -> bool {
        let (x, n_x) = (self.targets.positions[i], self.targets.normals[i]);
        let (y, n_y) = (self.sources.positions[j], self.sources.normals[j]);
        let face = facing(x, n_x, y, n_y);
        if face {
            let (origin, direction) = self.frame.ray(x, n_x, y, n_y);
            rays.slots.push(slot);
            rays.origins.push(origin);
            rays.directions.push(direction);
        }
        face
    }

    /// Distance between the bounding boxes of two boxes, scene units.
    pub(crate) fn distance(&self, t: usize, s: usize) -> f64 {
        let (a, b) = (&self.targets, &self.sources);
        let gap = |i: usize| (a.low[t][i] - b.high[s][i]).max(b.low[s][i] - a.high[t][i]).max(0.0);
        norm([gap(0), gap(1), gap(2)])
    }

    /// Size of a source box over its distance from a target box.
    pub(crate) fn angle(&self, t: usize, s: usize) -> f64 {
        let size = self.size(s);
        size / self.distance(t, s).max(1e-9 * size + f64::MIN_POSITIVE)
    }

    /// About which share of the irradiance at the target comes from the source box.
    pub(crate) fn share(&self, t: usize, s: usize) -> f64 {
        let (between, size) = (self.distance(t, s), self.size(s));
        let weight = self.weights.of(&self.sources.points_of(s));
        (weight / (size * size + PI * between * between).max(f64::MIN_POSITIVE)).min(1.0)
    }

    /// Longest side of the bounding box of a source box, scene units.
    fn size(&self, s: usize) -> f64 {
        sub(self.sources.high[s], self.sources.low[s]).into_iter().fold(0.0, f64::max)
    }
}

/// From 0 to 1.
fn unit(random: u64) -> f64 {
    (random >> 11) as f64 / (1u64 << 53) as f64
}

/// A number that looks random: splitmix64, Steele, Lea and Flood, "Fast splittable pseudorandom number generators", 2014.
fn hash(x: u64) -> u64 {
    let x = x.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let x = (x ^ x >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let x = (x ^ x >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
    x ^ x >> 31
}
