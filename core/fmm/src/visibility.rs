// SPDX-License-Identifier: GPL-3.0-or-later
//! From interaction lists to visible interaction lists (section 5 of the paper).
//!
//! As in procedure Modify of the paper's Figure 7 valid pairs stay where they are and other pairs are postponed to the
//! children. Unlike there a pair is valid where a shaft proves it, and not both sides are postponed to the leaves: a
//! source box that looks small is kept, and only the receivers are told apart, down to single points, by rays: aimed at
//! the sources where these are emitters ([`crate::links`]), and over the hemisphere elsewhere ([`crate::gather`]).

use crate::facing::{Facing, FacingTest};
use crate::kernel;
use crate::links::{Links, Run, Weights};
use crate::lists::{ListsOptions, cells_between};
use crate::medium::Medium;
use crate::moving::Bounds;
use crate::octree::{NO_BOX, Octree};
use crate::octree_build::EMITTERS;
use crate::places::Places;
use crate::rays::{Frame, Rays, facing};
use crate::samples::{hash, unit};
use crate::shaft::{Blockers, End, pass};
use crate::vector::{norm, sub};
use crate::visible_lists::Linked;
use rayon::prelude::*;
use std::f64::consts::PI;
use std::ops::Range;
use std::sync::Arc;

/// Whether a pair sees each other as a whole is worth no test where it decides about fewer rays.
const FEW_RAYS: f64 = 500.0;

/// Runs of a leaf from which on not all are asked at first, and which share of them is.
const MANY_RUNS: usize = 32;
const STRIDE: u64 = 4;

/// A place of a patch from which less than this share comes of what its source sends says nothing about that: it may
/// be next to the horizon, and seen through a gap.
const AS_MUCH: f64 = 0.5;

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
    /// Rays over the hemisphere of a point, where all of it is open.
    pub density: usize,
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

/// Two boxes whose visibility is looked for.
#[derive(Debug, Clone, Copy)]
struct Pending {
    target: u32,
    source: u32,
    /// Whether the source box is kept while the target is split.
    kept: bool,
}

/// What becomes of two boxes.
enum Settled {
    Invalid,
    Valid(Kind),
    Partial,
    Postponed(Vec<Pending>),
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
    /// (B,): nearer than that a source box is never summed, because its points stand for too much surface.
    pub coarse: Vec<f64>,
    /// (B,): how far the surface that points of a source box stand for goes beyond them.
    pub margin: Vec<f64>,
    pub places: Places,
    pub blockers: Blockers,
    /// What things may move in.
    pub moving: Vec<Bounds>,
    pub medium: Medium,
    /// What ends the volumes that absorb.
    pub absorbing: Blockers,
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
    /// Pairs of a target box and a source box that points of it may see in part.
    pub(crate) partial: Vec<(u32, u32)>,
    /// Those that get rays of their own.
    pub(crate) linked: Vec<Linked>,
    pub outcomes: Outcomes,
}

impl Visibility {
    /// Procedure Generate of the paper's Figure 7, from the roots on.
    pub fn generate(view: &View, options: VisibilityOptions) -> Self {
        let mut all =
            Self { options, valid: Vec::new(), partial: Vec::new(), linked: Vec::new(), outcomes: Outcomes::default() };
        let roots =
            |t: usize| view.sources.roots().map(move |s| Pending { target: t as u32, source: s as u32, kept: false });
        let mut pending: Vec<Pending> = view.targets.roots().flat_map(roots).collect();
        while !pending.is_empty() {
            pending = all.modify(view, pending);
        }
        all.outcomes.valid = all.valid.len();
        all
    }

    /// Procedure Modify: keeps the valid ones of these pairs, and returns what the others are postponed to.
    fn modify(&mut self, view: &View, pairs: Vec<Pending>) -> Vec<Pending> {
        let settled: Vec<Settled> = pairs.par_iter().map(|&pair| self.settle(view, pair)).collect();
        let mut pending = Vec::new();
        for (Pending { target, source, .. }, settled) in pairs.into_iter().zip(settled) {
            match settled {
                Settled::Invalid => self.outcomes.invalid += 1,
                Settled::Valid(kind) => self.valid.push(Pair { target, source, kind }),
                Settled::Partial => {
                    self.outcomes.partial += 1;
                    self.partial.push((target, source));
                }
                Settled::Postponed(children) => {
                    self.outcomes.partial += 1;
                    pending.extend(children);
                }
            }
        }
        pending
    }

    fn settle(&self, view: &View, pair: Pending) -> Settled {
        let (t, s) = (pair.target as usize, pair.source as usize);
        let facing = view.facing.classify(t, s);
        if facing == Facing::None {
            return Settled::Invalid;
        }
        let kind = if pair.kept { Some(Kind::Link) } else { view.kind(t, s, facing) };
        if let Some(kind) = kind.filter(|_| view.is_clear(t, s)) {
            return Settled::Valid(kind);
        }
        if !view.emits(s) && self.rays_between(view, t, s) < FEW_RAYS {
            return Settled::Partial;
        }
        let small = kind.is_some() && (view.sources.is_leaf(s) || view.angle(t, s) <= self.options.angle);
        let leaves = (view.targets.is_leaf(t), view.sources.is_leaf(s));
        if leaves.0 && (leaves.1 || pair.kept || small) {
            return Settled::Partial;
        }
        Settled::Postponed(view.children(t, s, pair.kept || small))
    }

    /// About how many rays over the hemispheres of the points of a target box go to a source box.
    fn rays_between(&self, view: &View, t: usize, s: usize) -> f64 {
        view.share(t, s) * (view.targets.count(t) * self.options.density) as f64
    }

    /// Rays that fill the bits of some leaves' links, whose slots they have. They come in two rounds: where a leaf has many
    /// runs, the first asks a few of them, and the second the others for points that saw some of these only.
    pub fn link_rays(&self, view: &View, links: &Links, leaves: Range<usize>, second: bool) -> Rays {
        let mut rays = Rays::default();
        for leaf in &links.leaves[leaves] {
            let stride = if leaf.runs.len() < MANY_RUNS { 1 } else { STRIDE };
            if second && stride == 1 {
                continue;
            }
            for (row, i) in view.targets.points_of(leaf.leaf as usize).enumerate() {
                let turn = hash(i as u64);
                let first = |place: &usize| (*place as u64 ^ turn).is_multiple_of(stride);
                let draw = |place: usize| view.draw(links, links.run(leaf, place), i);
                let mut ask = |place: usize| {
                    let slot = links.slot_at(leaf, row, place);
                    if !view.push_to_run(links, i, links.run(leaf, place), slot, &mut rays) {
                        links.clear(slot);
                    }
                };
                if !second {
                    (0..leaf.runs.len()).filter(first).for_each(ask);
                    continue;
                }
                let known = (0..leaf.runs.len()).filter(first).filter(|&place| view.face(i, draw(place)));
                let mut seen = known.map(|place| links.is_seen(leaf, row, place));
                let one = seen.next();
                let rest = (0..leaf.runs.len()).filter(|place| !first(place));
                if one.is_none_or(|one| seen.any(|other| other != one)) {
                    rest.for_each(&mut ask);
                } else if one == Some(false) {
                    rest.for_each(|place| links.clear(links.slot_at(leaf, row, place)));
                }
            }
        }
        rays
    }
}

impl View {
    fn is_clear(&self, t: usize, s: usize) -> bool {
        let (target, source) = (&self.ends[0][t], &self.ends[1][s]);
        !self.is_coarse(t, s)
            && self.blockers.are_clear(target, source)
            && !pass(target, source, &self.moving)
            && self.is_unabsorbed(t, s)
    }

    /// Whether no light is absorbed between two boxes: expansions know no medium, and what goes through one is left to rays.
    fn is_unabsorbed(&self, t: usize, s: usize) -> bool {
        let ends = || {
            let [x, y] =
                [(&self.targets, t), (&self.sources, s)].map(|(tree, b)| tree.positions[tree.points_of(b).start]);
            // Nothing ends a volume between them, so that all of the ways are inside of it or none.
            self.absorbing.are_clear(&self.ends[0][t], &self.ends[1][s]) && self.medium.left(x, y) == [1.0; 3]
        };
        self.medium.is_clear() || self.medium.is_bounded() && ends()
    }

    /// Whether points of a source box stand for too much surface to be summed at a target box.
    pub(crate) fn is_coarse(&self, t: usize, s: usize) -> bool {
        self.distance(t, s) < self.coarse[s]
    }

    /// Whether a source box holds emitters, which have boxes of their own.
    pub(crate) fn emits(&self, s: usize) -> bool {
        self.sources.axis[s] >= EMITTERS
    }

    /// Whether the box above a source box holds emitters as well.
    pub(crate) fn emits_above(&self, s: usize) -> bool {
        let above = self.sources.parent[s];
        above != NO_BOX && self.emits(above as usize)
    }

    /// The list that a pair of boxes belongs to, as in [`crate::lists`]; None where only children can be told apart.
    fn kind(&self, t: usize, s: usize, facing: Facing) -> Option<Kind> {
        let leaves = (self.targets.is_leaf(t), self.sources.is_leaf(s));
        let levels = (self.targets.level[t], self.sources.level[s]);
        let separated = cells_between(&self.targets, t, &self.sources, s) > i64::from(self.lists.separation)
            && self.distance(t, s) >= self.reach[s];
        let expanded = separated && facing == Facing::All;
        if expanded && levels.0 == levels.1 && !self.lists.few_pairs(&self.targets, t, &self.sources, s) {
            Some(Kind::Interaction)
        } else if expanded && leaves.0 && levels.0 < levels.1 && self.sources.count(s) > self.lists.direct_points {
            Some(Kind::Multipole)
        } else if expanded && leaves.1 && levels.0 > levels.1 && self.targets.count(t) > self.lists.direct_points {
            Some(Kind::Local)
        } else {
            (leaves == (true, true)).then_some(Kind::Near)
        }
    }

    /// The pairs of children that stand for a pair; those of the target alone where the source box is kept.
    fn children(&self, t: usize, s: usize, kept: bool) -> Vec<Pending> {
        let or_itself = |tree: &Octree, b: usize, split: bool| {
            if split && !tree.is_leaf(b) { tree.children(b) } else { b..b + 1 }
        };
        // The larger box is split first, so that both stay on one level.
        let levels = (self.targets.level[t], self.sources.level[s]);
        let leaves = (self.targets.is_leaf(t), self.sources.is_leaf(s));
        let of_target = or_itself(&self.targets, t, kept || levels.0 <= levels.1 || leaves.1);
        let of_source = or_itself(&self.sources, s, !kept && (levels.1 <= levels.0 || leaves.0));
        let pending = |t: usize, s: usize| Pending { target: t as u32, source: s as u32, kept };
        of_target.flat_map(|t| of_source.clone().map(move |s| pending(t, s))).collect()
    }

    /// The pairs of the lists that stand for a pair, below it.
    pub(crate) fn postpone(&self, t: usize, s: usize, pairs: &mut Vec<Pair>) {
        for child in self.children(t, s, false) {
            let (t, s) = (child.target as usize, child.source as usize);
            let facing = self.facing.classify(t, s);
            match self.kind(t, s, facing).filter(|_| facing != Facing::None) {
                Some(kind) => pairs.push(Pair { target: child.target, source: child.source, kind }),
                None if facing == Facing::None => {}
                None => self.postpone(t, s, pairs),
            }
        }
    }

    /// The source of a run that a point is asked to see, drawn by what it gets from there.
    fn draw(&self, links: &Links, run: &Run, i: usize) -> usize {
        let random = unit(hash(hash(i as u64) ^ u64::from(run.points.start) << 32));
        links.runs.point(self.targets.positions[i], self.targets.normals[i], run, &self.weights, random)
    }

    fn face(&self, i: usize, j: usize) -> bool {
        let (targets, sources) = (&self.targets, &self.sources);
        facing(targets.positions[i], targets.normals[i], sources.positions[j], sources.normals[j])
    }

    /// Adds the ray from a point to what it is asked to see of a run; false where they do not face each other.
    pub(crate) fn push_to_run(&self, links: &Links, i: usize, run: &Run, slot: u64, rays: &mut Rays) -> bool {
        let pair = (i, self.draw(links, run, i));
        // Of several sources another one is drawn for each point anyway.
        let face = if run.points.len() == 1 { Self::push_within } else { Self::push };
        face(self, pair, slot, rays)
    }

    /// Adds the ray between two points; false where they do not face each other.
    pub(crate) fn push(&self, (i, j): (usize, usize), slot: u64, rays: &mut Rays) -> bool {
        let face = self.face(i, j);
        if face {
            let (x, n_x) = (self.targets.positions[i], self.targets.normals[i]);
            rays.push(slot, self.frame.ray(x, n_x, self.sources.positions[j], self.sources.normals[j]));
        }
        face
    }

    /// The same to a random place of what the source stands for, if as much comes from there as the source sends.
    fn push_within(&self, (i, j): (usize, usize), slot: u64, rays: &mut Rays) -> bool {
        let [own, other] = [self.targets.positions[i], self.sources.positions[j]].map(|x| self.frame.number(x));
        let random = hash(hash(own) ^ other);
        let Some(place) = self.places.at(&self.sources, j, random) else { return self.push((i, j), slot, rays) };
        let (x, n_x, n_y) = (self.targets.positions[i], self.targets.normals[i], self.sources.normals[j]);
        let [there, here] = [place, self.sources.positions[j]].map(|y| kernel(x, n_x, y, n_y, self.softening[j]));
        if there <= AS_MUCH * here || !self.face(i, j) {
            return self.push((i, j), slot, rays);
        }
        rays.push(slot, self.frame.ray_to(x, n_x, place, n_y));
        true
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
