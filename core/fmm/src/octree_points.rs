// SPDX-License-Identifier: GPL-3.0-or-later
//! Points of an octree as its passes want them: in tree order, in box coordinates, leaf by leaf.

use std::ops::Range;

use rayon::prelude::*;

use crate::octree::Octree;

impl Octree {
    /// Which child of its parent a box is: bits 0, 1 and 2 are the upper halves of x, y and z.
    pub fn octant(&self, b: usize) -> usize {
        (0..3).map(|axis| (self.cell[b][axis] as usize & 1) << axis).sum()
    }

    /// Points in coordinates in which the box has its centre at 0 and its half side is 1.
    pub fn in_box_coordinates(&self, points: &[[f64; 3]], b: usize) -> Vec<[f64; 3]> {
        let (centre, scale) = (self.centre(b), 1.0 / self.half_side(b));
        points.iter().map(|x| [0, 1, 2].map(|axis| (x[axis] - centre[axis]) * scale)).collect()
    }

    /// Rows (N, C) in scene order to tree order.
    pub fn in_tree_order<const C: usize>(&self, rows: &[[f64; C]]) -> Vec<[f64; C]> {
        self.to_scene.par_iter().map(|&i| rows[i as usize]).collect()
    }

    /// Rows (N, C) in tree order to scene order.
    pub fn in_scene_order<const C: usize>(&self, rows: &[[f64; C]]) -> Vec<[f64; C]> {
        self.to_tree.par_iter().map(|&i| rows[i as usize]).collect()
    }

    /// The leaves in order of their points, so that their ranges follow each other.
    pub fn leaves_by_points(&self) -> Vec<usize> {
        let mut leaves: Vec<usize> = self.leaves().collect();
        leaves.sort_unstable_by_key(|&b| self.points[b][0]);
        leaves
    }

    /// (B,) the points of each leaf in tree order; empty for inner boxes.
    pub fn points_of_leaves(&self) -> Vec<Range<usize>> {
        (0..self.n_boxes()).map(|b| if self.is_leaf(b) { self.points_of(b) } else { 0..0 }).collect()
    }
}
