// SPDX-License-Identifier: GPL-3.0-or-later
//! Octree over points, adaptive (grouping factor s) or of one fixed level.
//!
//! Boxes are kept as a structure of arrays in level order: all of level 0, then all of level 1, and so on; within a level in
//! Morton order, so that the children of consecutive boxes are consecutive. Boxes without points do not exist.
//! Points are numbered twice: in scene order, as they were given, and in tree order, where the points of any box, leaf or not,
//! are one range. An octree split by normal is up to six octrees on one grid, one for each class of normals, and as many
//! again for emitters: boxes of different classes are different boxes even where their cells are the same.

use std::ops::Range;

pub use crate::octree_error::OctreeError;
pub use crate::octree_grid::{Grid, MAX_LEVEL};
pub use crate::octree_normals::Cone;

/// Parent of a root.
pub const NO_BOX: u32 = u32::MAX;

/// Where boxes stop being split.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Grouping {
    /// No leaf holds more points than the grouping factor s, except at `MAX_LEVEL`.
    Adaptive { points: usize },
    /// Every leaf is at this level.
    Uniform { level: u8 },
}

/// How an octree is built.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct OctreeOptions {
    pub grouping: Grouping,
    /// Points of the six classes of normals go into boxes of their own.
    pub by_normal: bool,
}

/// See the head of this file. B boxes, N points, L levels.
#[derive(Debug, Clone)]
pub struct Octree {
    pub grid: Grid,
    pub options: OctreeOptions,
    /// (L + 1) u32: the boxes of level l are `levels[l]..levels[l + 1]`; those of level 0 are the roots.
    pub levels: Vec<u32>,
    /// (B,) u8: 0 for a root.
    pub level: Vec<u8>,
    /// (B,) u8: class of the normals, 0 to 5, 0 when not split by them; 6 more for emitters.
    pub axis: Vec<u8>,
    /// (B,) u32: `NO_BOX` for a root.
    pub parent: Vec<u32>,
    /// (B + 1) u32: the children of box b are `child_starts[b]..child_starts[b + 1]`; a leaf has none.
    pub child_starts: Vec<u32>,
    /// (B, 2) u32: first point and one past the last, in tree order.
    pub points: Vec<[u32; 2]>,
    /// (B, 3) i32: integer coordinates of the cell, in cells of the level of the box, from 0 at the low corner of the grid.
    pub cell: Vec<[i32; 3]>,
    /// (B, 3) f64, scene units: low corner of the bounding box of the points.
    pub low: Vec<[f64; 3]>,
    /// (B, 3) f64, scene units: high corner of the bounding box of the points.
    pub high: Vec<[f64; 3]>,
    /// (B,): cone of the normals of the points; empty without normals.
    pub cone: Vec<Cone>,
    /// (N,) u32: scene number of each point, in tree order.
    pub to_scene: Vec<u32>,
    /// (N,) u32: tree number of each point, in scene order.
    pub to_tree: Vec<u32>,
    /// (N, 3) f64, scene units, tree order.
    pub positions: Vec<[f64; 3]>,
    /// (N, 3) f64, unit, tree order; empty without normals.
    pub normals: Vec<[f64; 3]>,
    /// (up to 8, 3) f64, unit: the normals that many points share, either sign; none without normals.
    pub common_normals: Vec<[f64; 3]>,
    /// (3, 3) f64: the orthonormal axes that the classes of normals refer to, one a row.
    pub frame: [[f64; 3]; 3],
}

impl Octree {
    pub fn n_boxes(&self) -> usize {
        self.level.len()
    }

    pub fn n_points(&self) -> usize {
        self.to_scene.len()
    }

    pub fn n_levels(&self) -> usize {
        self.levels.len() - 1
    }

    /// The boxes of one level; none below the deepest.
    pub fn boxes_of_level(&self, level: usize) -> Range<usize> {
        if level < self.n_levels() { self.levels[level] as usize..self.levels[level + 1] as usize } else { 0..0 }
    }

    pub fn roots(&self) -> Range<usize> {
        self.boxes_of_level(0)
    }

    pub fn children(&self, b: usize) -> Range<usize> {
        self.child_starts[b] as usize..self.child_starts[b + 1] as usize
    }

    pub fn is_leaf(&self, b: usize) -> bool {
        self.child_starts[b] == self.child_starts[b + 1]
    }

    /// The leaves, in level order.
    pub fn leaves(&self) -> impl Iterator<Item = usize> + '_ {
        (0..self.n_boxes()).filter(|&b| self.is_leaf(b))
    }

    /// Points of a box, in tree order.
    pub fn points_of(&self, b: usize) -> Range<usize> {
        let [start, end] = self.points[b];
        start as usize..end as usize
    }

    /// Number of points of a box.
    pub fn count(&self, b: usize) -> usize {
        self.points_of(b).len()
    }

    /// Centre of the cell of a box, scene units.
    pub fn centre(&self, b: usize) -> [f64; 3] {
        self.grid.cell_centre(self.level[b], self.cell[b])
    }

    /// Half the side of the cell of a box, scene units.
    pub fn half_side(&self, b: usize) -> f64 {
        self.grid.half_side(self.level[b])
    }

    pub fn has_normals(&self) -> bool {
        !self.normals.is_empty()
    }
}
