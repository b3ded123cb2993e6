// SPDX-License-Identifier: GPL-3.0-or-later
//! Things that move among those that stay: the octrees, the lists and the rays of what stays are kept, and only rays that
//! pass where something has moved to are traced again. What moves is a guest: no list has it, and rays over the
//! hemispheres find it.

use crate::driver::Fmm;
use crate::driver_visibility::leaves_of_points;
use crate::error::Error;
use crate::gather::{GatherRays, Met};
use crate::links::Run;
use crate::rays::{Frame, Rays};
use crate::shaft::{End, pass};
use crate::surface::Surface;
use crate::visibility::View;
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
                if direction[i] == 0.0 {
                    if !(low[i]..=high[i]).contains(&origin[i]) {
                        return false;
                    }
                    continue;
                }
                let (a, b) = ((low[i] - origin[i]) / direction[i], (high[i] - origin[i]) / direction[i]);
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
        let leaves = leaves_of_points(&self.sources);
        let end = |run: &Run| {
            let points = run.points.start as usize..run.points.end as usize;
            // Rays end anywhere on what the points stand for.
            let margins = leaves[points.clone()].iter().map(|&leaf| rounds.view.margin[leaf as usize]);
            End::around(&self.sources.positions[points], margins.fold(0.0, f64::max))
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
                if !pass(end, &self.moved.runs[run as usize], &self.moved.boxes) {
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

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Few values, so that rays often start on faces and run along them.
    fn coordinate() -> impl Strategy<Value = f32> {
        prop_oneof![(-4..=4i32).prop_map(|k| k as f32 / 4.0), -1.0..1.0f32]
    }

    fn vector() -> impl Strategy<Value = [f32; 3]> {
        [coordinate(), coordinate(), coordinate()]
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(4000))]
        #[test]
        fn rays_meet_boxes_that_they_have_points_in(
            one in vector(),
            other in vector(),
            origin in vector(),
            direction in vector(),
            length in prop_oneof![Just(1.0f32), 0.1..3.0f32],
        ) {
            let low = [0, 1, 2].map(|i| one[i].min(other[i]));
            let high = [0, 1, 2].map(|i| one[i].max(other[i]));
            let moved = |margin: f32| Moved {
                in_frame: vec![[[9.0; 3]; 2], [low.map(|x| x - margin), high.map(|x| x + margin)]],
                ..Moved::default()
            };
            let steps = 500u16;
            let place = |k: u16| [0, 1, 2].map(|i| origin[i] + f32::from(k) / f32::from(steps) * length * direction[i]);
            let inside = |x: [f32; 3], margin: f32| (0..3).all(|i| low[i] - margin <= x[i] && x[i] <= high[i] + margin);
            if (0..=steps).any(|k| inside(place(k), 0.0)) {
                prop_assert!(moved(1e-6).meets(origin, direction, length));
                prop_assert!(moved(1e-6).meets(origin, direction, f32::INFINITY));
            }
            let step = length * direction.iter().map(|d| d.abs()).fold(0.0, f32::max) / f32::from(steps);
            if moved(0.0).meets(origin, direction, length) {
                prop_assert!((0..=steps).any(|k| inside(place(k), step + 1e-5)));
            }
        }
    }

    #[test]
    fn a_ray_along_a_face_meets_its_box() {
        let moved = Moved { in_frame: vec![[[0.0; 3], [1.0; 3]]], ..Moved::default() };
        for (origin, direction) in [([0.0, 0.5, -1.0], [0.0, 0.0, 1.0]), ([1.0, 1.0, 2.0], [0.0, -0.0, -1.0])] {
            assert!(moved.meets(origin, direction, f32::INFINITY));
            assert!(!moved.meets(origin, direction, 0.5));
            assert!(!moved.meets(origin, direction.map(|d| -d), f32::INFINITY));
        }
    }
}
