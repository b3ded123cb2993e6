// SPDX-License-Identifier: GPL-3.0-or-later
//! What settled visibility becomes: lists of valid pairs, and links.

use crate::facing::Facing;
use crate::gather::Gather;
use crate::links::{Links, Runs};
use crate::lists::{Lists, Rows};
use crate::octree::{NO_BOX, Octree};
use crate::vector::dot;
use crate::visibility::{Kind, Pair, View, Visibility};
use rayon::prelude::*;

/// Normals of a flat surface differ by less, in one minus cosine.
const FLAT: f64 = 1e-9;

/// How many runs, and how many parts each of them.
pub(crate) type Cut = (u32, u32);
/// A target leaf and a source box that gets rays of its own.
pub(crate) type Linked = ((u32, u32), Cut);

impl Visibility {
    /// Puts the valid pairs into the lists.
    pub fn list(&mut self, view: &View, lists: &mut Lists) {
        let (kept, listed): (Vec<Pair>, Vec<Pair>) =
            std::mem::take(&mut self.valid).into_iter().partition(|pair| pair.kind == Kind::Link);
        let points = lists.options.direct_points;
        let mut valid: Vec<Pair> = kept.par_iter().flat_map_iter(|&pair| view.whole(pair, points)).collect();
        valid.extend(listed);
        let rows = |kind| rows(&view.targets, valid.iter().filter(|pair| pair.kind == kind));
        lists.near_neighbours = rows(Kind::Near);
        lists.interaction_list = rows(Kind::Interaction);
        lists.local_interaction_list = rows(Kind::Local);
        lists.multipole_interaction_list = rows(Kind::Multipole);
    }

    /// Links of the pairs that get rays of their own, with all bits set.
    pub fn link(&mut self, view: &View) -> Links {
        let (mut runs, mut links) = (Runs::default(), Vec::new());
        for ((leaf, source), cut) in std::mem::take(&mut self.linked) {
            links.extend(runs.of(&view.sources, source, cut, &view.weights, &view.softening).map(|run| (leaf, run)));
        }
        Links::new(&view.targets, links, runs)
    }

    /// Tells the pairs that are seen in part apart: those with emitters get rays of their own and are kept for
    /// [`Visibility::link`]; the rest are left to rays over the hemispheres, and to be gathered. `areas` (N,) of the sources
    /// in tree order. To be called before [`Visibility::list`].
    pub fn gather(&mut self, view: &View, areas: Vec<f64>) -> Gather {
        let partial = std::mem::take(&mut self.partial);
        let below =
            |&(t, s): &(u32, u32)| leaves_below(&view.targets, t as usize).into_iter().map(move |t| (t as u32, s));
        let mut pairs: Vec<(u32, u32)> = partial.par_iter().flat_map_iter(below).collect();
        pairs.par_sort_unstable();
        let (shining, open): (Vec<_>, Vec<_>) = pairs.into_iter().partition(|pair| view.emits(pair.1 as usize));
        let leaves: Vec<&[(u32, u32)]> = shining.chunk_by(|a, b| a.0 == b.0).collect();
        let cuts_of = |leaf: &&[(u32, u32)]| -> Vec<Linked> {
            // Emitters seldom shine all at once: a leaf that sees many of them gives each one less.
            let total: f64 = leaf.iter().map(|&(t, s)| view.share(t as usize, s as usize)).sum();
            leaf.iter().map(|&pair| (pair, self.cut(view, pair, 1.0 / total.max(1.0)))).collect()
        };
        self.linked = leaves.par_iter().flat_map_iter(cuts_of).collect();
        let mut valid = vec![Vec::new(); view.targets.n_boxes()];
        self.valid.iter().for_each(|pair| valid[pair.target as usize].push(pair.source));
        // Emitters are summed wherever their points are in front of a leaf: a ray that meets a rim of one would add specks.
        let topmost = |&s: &u32| view.emits(s as usize) && !view.emits_above(s as usize);
        let emitters: Vec<u32> = (0..view.sources.n_boxes() as u32).filter(topmost).collect();
        let summed = |leaf: u32| {
            let mut boxes = emitters.clone();
            let above =
                std::iter::successors(Some(leaf), |&t| Some(view.targets.parent[t as usize]).filter(|&t| t != NO_BOX));
            above.for_each(|t| boxes.extend(&valid[t as usize]));
            boxes
        };
        let parted = |leaf: u32| view.is_parted(leaf as usize);
        let trees = (view.targets.as_ref(), view.sources.as_ref());
        Gather::new(trees, &view.margin, &view.moving, open, summed, parted, areas, self.options.density)
    }

    /// Into how many runs the source box of a link is cut, and each of these into how many parts; `scale` of its share.
    fn cut(&self, view: &View, pair: (u32, u32), scale: f64) -> Cut {
        let (t, s) = (pair.0 as usize, pair.1 as usize);
        let points = f64::from(view.sources.count(s) as u32);
        if view.distance(t, s) < view.reach[s] {
            return (points as u32, 1);
        }
        let (angle, share) = (view.angle(t, s), scale * view.share(t, s));
        let count = (angle / self.options.run_angle).powi(2).max(share / self.options.share).clamp(1.0, points);
        let runs = (count as u32).next_power_of_two();
        let parts = (angle / self.options.part_angle).powi(2) / f64::from(runs);
        (runs, (parts.clamp(1.0, points) as u32).next_power_of_two())
    }
}

impl View {
    /// Whether a triangle stands between points of a flat target leaf; the chords of a bent one go through its own.
    fn is_parted(&self, leaf: usize) -> bool {
        let (end, normals) = (&self.ends[0][leaf], &self.targets.normals[self.targets.points_of(leaf)]);
        normals.iter().all(|&n| dot(n, normals[0]) > 1.0 - FLAT) && !self.blockers.are_clear(end, end)
    }

    /// What the leaves of the target receive from a source box that all of them see: its expansion where it has more than
    /// so many points and converges, its points elsewhere.
    fn whole(&self, pair: Pair, points: usize) -> Vec<Pair> {
        let s = pair.source as usize;
        let mut pairs = Vec::new();
        for target in leaves_below(&self.targets, pair.target as usize) {
            let expanded = self.sources.count(s) > points
                && self.facing.classify(target, s) == Facing::All
                && self.far(target, s)
                && self.distance(target, s) >= self.reach[s];
            let target = target as u32;
            if expanded {
                pairs.push(Pair { target, source: pair.source, kind: Kind::Multipole });
            } else {
                let near = |leaf: usize| Pair { target, source: leaf as u32, kind: Kind::Near };
                pairs.extend(leaves_below(&self.sources, s).into_iter().map(near));
            }
        }
        pairs
    }

    /// Whether all points of a target box are more than k cells of the source box away from its cell.
    fn far(&self, t: usize, s: usize) -> bool {
        let (centre, half) = (self.sources.centre(s), self.sources.half_side(s));
        let gap = |i: usize| (self.targets.low[t][i] - centre[i]).max(centre[i] - self.targets.high[t][i]);
        (0..3).any(|i| gap(i) > half * f64::from(2 * self.lists.separation + 1))
    }
}

/// The leaves at or below a box.
fn leaves_below(tree: &Octree, b: usize) -> Vec<usize> {
    let (mut leaves, mut boxes) = (Vec::new(), vec![b]);
    while let Some(b) = boxes.pop() {
        if tree.is_leaf(b) {
            leaves.push(b);
        }
        boxes.extend(tree.children(b));
    }
    leaves
}

/// Pairs as rows by target, sorted.
pub(crate) fn rows<'a>(targets: &Octree, pairs: impl Iterator<Item = &'a Pair>) -> Rows {
    let mut pairs: Vec<(u32, u32)> = pairs.map(|pair| (pair.target, pair.source)).collect();
    pairs.par_sort_unstable();
    let mut rows = Rows { starts: vec![0; targets.n_boxes() + 1], boxes: Vec::with_capacity(pairs.len()) };
    for (t, s) in pairs {
        rows.starts[t as usize + 1] += 1;
        rows.boxes.push(s);
    }
    for b in 0..targets.n_boxes() {
        rows.starts[b + 1] += rows.starts[b];
    }
    rows
}
