// SPDX-License-Identifier: GPL-3.0-or-later
//! Everything that must hold for an octree, for tests.

use crate::octree::{Grouping, MAX_LEVEL, NO_BOX, Octree};
use crate::octree_build::EMITTERS;
use crate::octree_normals::dominant_axis;
use crate::vector::{dot, high, low};

impl Octree {
    /// Panics with the offending box where the octree contradicts its own description.
    pub fn assert_well_formed(&self) {
        self.assert_permutations();
        self.assert_levels();
        self.assert_roots();
        for b in 0..self.n_boxes() {
            self.assert_children(b);
            self.assert_leaf(b);
            self.assert_bounds(b);
            if self.has_normals() {
                self.assert_normals(b);
            }
        }
    }

    fn assert_permutations(&self) {
        let n = self.positions.len();
        assert_eq!([self.to_scene.len(), self.to_tree.len()], [n, n], "permutations of the wrong length");
        for (tree, &scene) in self.to_scene.iter().enumerate() {
            assert_eq!(self.to_tree[scene as usize] as usize, tree, "permutations are not inverse to each other");
        }
    }

    fn assert_levels(&self) {
        let n = self.n_boxes();
        let lengths =
            [self.axis.len(), self.parent.len(), self.points.len(), self.cell.len(), self.low.len(), self.high.len()];
        assert_eq!(lengths, [n; 6], "arrays of boxes of different lengths");
        assert_eq!(self.cone.len(), if self.has_normals() { n } else { 0 }, "cones");
        assert_eq!(self.child_starts.len(), n + 1, "child_starts");
        assert_eq!((self.levels[0], self.levels[self.n_levels()] as usize), (0, n), "levels do not cover the boxes");
        for level in 0..self.n_levels() {
            let boxes = self.boxes_of_level(level);
            assert!(!boxes.is_empty(), "level {level} is empty");
            assert!(boxes.clone().all(|b| usize::from(self.level[b]) == level), "level {level} holds other boxes");
        }
        assert_eq!(self.child_starts[0] as usize, self.roots().end, "children come before the roots end");
        assert_eq!(self.child_starts[n] as usize, n, "some box is nobody's child");
    }

    fn assert_roots(&self) {
        assert!(self.roots().len() <= if self.options.by_normal { 12 } else { 2 }, "too many roots");
        let mut end = 0;
        for b in self.roots() {
            assert_eq!((self.parent[b], self.cell[b], self.points_of(b).start), (NO_BOX, [0; 3], end), "root {b}");
            end = self.points_of(b).end;
        }
        assert_eq!(end, self.n_points(), "roots do not cover the points");
    }

    fn assert_children(&self, b: usize) {
        assert!(self.count(b) > 0, "box {b} is empty");
        let mut end = self.points_of(b).start;
        for c in self.children(b) {
            assert_eq!(self.parent[c] as usize, b, "parent of box {c}");
            assert_eq!((self.level[c], self.axis[c]), (self.level[b] + 1, self.axis[b]), "child {c} of box {b}");
            assert_eq!(self.cell[c].map(|i| i >> 1), self.cell[b], "cell of child {c} of box {b}");
            assert_eq!(self.points_of(c).start, end, "points of child {c} of box {b}");
            end = self.points_of(c).end;
        }
        assert!(self.is_leaf(b) || end == self.points_of(b).end, "children of box {b} do not cover its points");
    }

    fn assert_leaf(&self, b: usize) {
        let stops = match self.options.grouping {
            Grouping::Adaptive { points } => self.count(b) <= points || self.level[b] == MAX_LEVEL,
            Grouping::Uniform { level } => self.level[b] == level,
        };
        assert_eq!(self.is_leaf(b), stops, "box {b} with {} points at level {}", self.count(b), self.level[b]);
    }

    fn assert_bounds(&self, b: usize) {
        let (centre, half) = (self.centre(b), self.half_side(b));
        let reach = half * (1.0 + 1e-9) + 1e-9 * self.grid.half + 1e-15 * self.grid.magnitude();
        let points = &self.positions[self.points_of(b)];
        for p in points {
            assert!((0..3).all(|i| (p[i] - centre[i]).abs() <= reach), "point {p:?} is outside the cell of box {b}");
        }
        let (l, h) = points.iter().fold((points[0], points[0]), |(l, h), &p| (low(l, p), high(h, p)));
        assert_eq!((l, h), (self.low[b], self.high[b]), "bounding box of box {b}");
    }

    fn assert_normals(&self, b: usize) {
        let cone = &self.cone[b];
        for &n in &self.normals[self.points_of(b)] {
            assert!((dot(n, n) - 1.0).abs() < 1e-14, "normal {n:?} is not unit");
            assert!(dot(n, cone.axis) >= cone.cos - 1e-12, "normal {n:?} is outside the cone of box {b}");
            let class = self.axis[b] % EMITTERS;
            assert!(!self.options.by_normal || dominant_axis(&self.frame, n) == class, "class of box {b}");
        }
    }
}
