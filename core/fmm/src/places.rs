// SPDX-License-Identifier: GPL-3.0-or-later
//! Where rays end on what a source stands for: one for the whole of it would tell no penumbra finer than the patches.

use crate::octree::Octree;
use crate::octree_build::EMITTERS;
use crate::portions::Portions;
use crate::samples::{hash, unit};

/// How far towards its rim places go: beyond that may be another room.
const WITHIN: f64 = 0.99;

/// Patches of the sources that emit: what comes from them is the same all over.
#[derive(Debug, Default)]
pub struct Places {
    /// (N,) of each source in tree order; None where rays go to it alone.
    of: Vec<Option<Part>>,
    /// (P, 3, 3)
    patches: Vec<[[f64; 3]; 3]>,
    portions: Portions,
}

/// What a source stands for.
#[derive(Debug, Clone, Copy)]
struct Part {
    patch: u32,
    /// Which of the sources there it is.
    number: u32,
}

impl Places {
    /// For patches (P, 3, 3) with sources as `rule` has them; groups of triangles are those that have a distance `coarse`
    /// (N,), scene order.
    pub fn new(sources: &Octree, patches: &[[[f64; 3]; 3]], rule: &[[f64; 3]], coarse: &[f64]) -> Self {
        let mut of = vec![None; sources.n_points()];
        let each = rule.len().max(1) as u32;
        let emitting = sources.leaves().filter(|&b| sources.axis[b] >= EMITTERS);
        for j in emitting.flat_map(|b| sources.points_of(b)) {
            let source = sources.to_scene[j];
            let part = Part { patch: source / each, number: source % each };
            of[j] = (coarse[source as usize] == 0.0).then_some(part);
        }
        Self { of, patches: patches.to_vec(), portions: Portions::new(rule) }
    }

    /// A place of what source j of the tree stands for, another one for each random number.
    pub fn at(&self, sources: &Octree, j: usize, first: u64) -> Option<[f64; 3]> {
        let part = self.of[j]?;
        let [a, b, c] = self.patches[part.patch as usize];
        let [u, v, w] = self.portions.place(part.number as usize, [unit(first), unit(hash(first))]);
        let (place, source) = ([0, 1, 2].map(|i| u * a[i] + v * b[i] + w * c[i]), sources.positions[j]);
        Some([0, 1, 2].map(|i| source[i] + WITHIN * (place[i] - source[i])))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::octree::{Grouping, OctreeOptions};
    use crate::octree_grid::Grid;

    #[test]
    fn only_emitters_that_are_no_groups_have_places_beside_their_sources() {
        let patch = [[0.0, 0.0, 0.0], [3.0, 0.0, 0.0], [0.0, 3.0, 0.0]];
        let apart = |x: f64| patch.map(|[y, z, w]| [x + y, z, w]);
        let patches = [apart(0.0), apart(10.0), apart(20.0)];
        let points = [[1.0, 1.0, 0.0], [11.0, 1.0, 0.0], [21.0, 1.0, 0.0]];
        let options = OctreeOptions { grouping: Grouping::Adaptive { points: 8 }, by_normal: true };
        let grid = Grid::around(&[&points]).unwrap();
        let tree =
            Octree::with_emitters(&points, Some(&[[0.0, 0.0, 1.0]; 3]), &[true, false, true], grid, options).unwrap();
        let places = Places::new(&tree, &patches, &[[1.0 / 3.0; 3]], &[0.0, 0.0, 5.0]);
        let at = |source: usize, turn| places.at(&tree, tree.to_tree[source] as usize, hash(turn));
        let found: Vec<_> = (0..1000).filter_map(|turn| at(0, turn)).collect();
        assert!(found.len() == 1000 && found.iter().all(|&[x, y, z]| x > 0.0 && y > 0.0 && x + y < 3.0 && z == 0.0));
        let mean = |axis: usize| found.iter().map(|place| place[axis]).sum::<f64>() / 1000.0;
        assert!((mean(0) - 1.0).abs() < 0.1 && (mean(1) - 1.0).abs() < 0.1);
        assert!((0..9).all(|turn| at(1, turn).is_none() && at(2, turn).is_none()));
    }
}
