// SPDX-License-Identifier: GPL-3.0-or-later
//! Things that move among those that stay: the octrees, the lists and the rays of what stays are kept, and only rays that
//! pass where something has moved to are traced again. What moves is a guest: no list has it, and rays over the
//! hemispheres find it.

use crate::driver::Fmm;
use crate::error::Error;
use crate::gather::{GatherRays, Met};
use crate::rays::Frame;
use crate::shaft::{End, is_passed_by};
use crate::surface::Surface;
use crate::visibility::{Rays, View};
use rayon::prelude::*;
use std::ops::Range;

/// Lowest and highest corner of a box, scene units.
pub type Bounds = [[f64; 3]; 2];

/// Rays that miss a box by less pass it, in units of the frame of rays: more than their ends are lifted and rounded.
const MARGIN: f64 = 2e-5;

/// Where things are that have moved.
#[derive(Debug, Default)]
pub struct Moved {
    /// Sources that follow those of the octree.
    pub guests: usize,
    boxes: Vec<Bounds>,
    /// The same in the frame of rays, somewhat larger.
    in_frame: Vec<[[f32; 3]; 2]>,
    /// What the points of each run are in.
    runs: Vec<End>,
}

impl Moved {
    /// Whether a ray passes one of the boxes within so many of its lengths.
    fn meets(&self, origin: [f32; 3], direction: [f32; 3], length: f32) -> bool {
        self.in_frame.iter().any(|[low, high]| {
            let (mut first, mut last) = (0.0_f32, length);
            for i in 0..3 {
                let inverse = 1.0 / direction[i];
                let (a, b) = ((low[i] - origin[i]) * inverse, (high[i] - origin[i]) * inverse);
                // A ray along a face gives NaN there, which these leave out.
                first = first.max(a.min(b));
                last = last.min(a.max(b));
            }
            first <= last
        })
    }
}

impl Fmm {
    /// From now on things are in `boxes`, within those that [`Fmm::occlude`] was told, and guests that stand for such areas
    /// are among them: those rays are to be traced again that pass there.
    pub fn move_to(&mut self, boxes: &[Bounds], areas: &[f64]) {
        self.links.restore();
        self.gather.welcome(self.sources.n_points(), areas);
        let Some(rounds) = &self.rounds else { return };
        let in_frame = |bounds: &Bounds| larger(&rounds.view.frame, bounds);
        let end = |run: &crate::links::Run| {
            End::around(&self.sources.positions[run.points.start as usize..run.points.end as usize])
        };
        let runs = self.links.runs.runs.par_iter().map(end).collect();
        let in_frame = boxes.iter().map(in_frame).collect();
        self.moved = Moved { guests: areas.len(), boxes: boxes.to_vec(), in_frame, runs };
    }

    /// The rays of [`Fmm::link_rays`] that pass where things are, once they are there; their bits are set.
    pub fn moved_link_rays(&self, leaves: Range<usize>) -> Rays {
        let mut rays = Rays::default();
        let Some(view) = self.rounds.as_ref().map(|rounds| &rounds.view) else { return rays };
        for leaf in &self.links.leaves[leaves.start..leaves.end.min(self.links.leaves.len())] {
            let end = &view.ends[0][leaf.leaf as usize];
            for (place, &run) in leaf.runs.iter().enumerate() {
                if self.moved.boxes.iter().all(|&bounds| is_passed_by(end, &self.moved.runs[run as usize], bounds)) {
                    continue;
                }
                for (row, i) in view.targets.points_of(leaf.leaf as usize).enumerate() {
                    let slot = self.links.slot_at(leaf, row, place);
                    self.push_moved(view, (i, run), slot, &mut rays);
                }
            }
        }
        rays
    }

    fn push_moved(&self, view: &View, (i, run): (usize, u32), slot: u64, rays: &mut Rays) {
        let run = &self.links.runs.runs[run as usize];
        let count = rays.slots.len();
        if !view.push_to_run(&self.links, i, run, slot, rays) {
            return;
        }
        if self.moved.meets(rays.origins[count], rays.directions[count], 1.0) {
            self.links.set(slot);
        } else {
            rays.truncate(count);
        }
    }

    /// The rays of [`Fmm::gather_rays`] that pass where things are.
    pub fn moved_gather_rays(&self, leaves: Range<usize>) -> GatherRays {
        let leaves = leaves.start..leaves.end.min(self.gather.leaves.len());
        let wanted = |origin, direction| self.moved.meets(origin, direction, f32::INFINITY);
        let Some(rounds) = &self.rounds else { return GatherRays::default() };
        self.gather.rays(&self.targets, &rounds.view.frame, leaves, wanted)
    }

    /// Takes what the rays of [`Fmm::moved_gather_rays`] met.
    pub fn take_moved_hits(&self, surface: &Surface, leaves: Range<usize>, met: &Met) -> Result<(), Error> {
        let leaves = leaves.start..leaves.end.min(self.gather.leaves.len());
        self.gather.take_moved((&self.targets, &self.sources), surface, leaves, met)
    }
}

fn larger(frame: &Frame, bounds: &Bounds) -> [[f32; 3]; 2] {
    let grown = |k: usize, margin: f64| frame.inside(bounds[k]).map(|x| (x + margin) as f32);
    [grown(0, -MARGIN), grown(1, MARGIN)]
}
