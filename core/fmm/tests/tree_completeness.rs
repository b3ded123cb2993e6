// SPDX-License-Identifier: GPL-3.0-or-later
#![allow(clippy::expect_used, clippy::unwrap_used)]
//! Every target meets every source exactly once.

mod tree_support;

use fmm::lists::{Lists, ListsOptions};
use fmm::octree::{Grouping, OctreeOptions};
use proptest::prelude::*;
use tree_support::*;

fn lists_options(facing: bool) -> impl Strategy<Value = ListsOptions> {
    let direct = prop_oneof![Just(0), 0..200_usize];
    let grazing = prop_oneof![Just(0.0), 0.0..0.5_f64];
    (1..4_u32, direct.clone(), direct, grazing).prop_map(move |(separation, direct_pairs, direct_points, grazing)| {
        ListsOptions { separation, facing, grazing, direct_pairs, direct_points }
    })
}

/// Weights that hardly any other combination of sources can sum up to.
fn weights(n: usize) -> Vec<u64> {
    let mut numbers = Numbers(7);
    (0..n).map(|_| numbers.bits()).collect()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]

    #[test]
    fn two_trees(
        shapes in (shapes(), shapes()),
        counts in (1..600_usize, 1..600_usize),
        seed: u64,
        target_options in octree_options(),
        source_options in octree_options(),
        options in lists_options(false),
    ) {
        let (a, b) = (cloud(shapes.0, counts.0, seed), cloud(shapes.1, counts.1, !seed));
        let grid = grid(&[&a, &b]);
        let (targets, sources) = (a.tree(grid, target_options), b.tree(grid, source_options));
        let lists = Lists::new(&targets, &sources, options).expect("lists");
        lists.assert_well_formed(&targets, &sources);
        for weights in [vec![1; sources.n_points()], weights(sources.n_points())] {
            let all = weights.iter().fold(0, |all: u64, &w| all.wrapping_add(w));
            prop_assert!(constant_kernel(&targets, &sources, &lists, &weights).iter().all(|&got| got == all));
        }
    }

    #[test]
    fn one_tree(
        shape in shapes(),
        count in 1..1500_usize,
        seed: u64,
        tree_options in octree_options(),
        options in lists_options(false),
    ) {
        let a = cloud(shape, count, seed);
        let tree = a.tree(grid(&[&a]), tree_options);
        let lists = Lists::new(&tree, &tree, options).expect("lists");
        lists.assert_well_formed(&tree, &tree);
        let weights = weights(tree.n_points());
        let all = weights.iter().fold(0, |all: u64, &w| all.wrapping_add(w));
        prop_assert!(constant_kernel(&tree, &tree, &lists, &weights).iter().all(|&got| got == all));
    }

    /// Pairs that face each other are met once, others at most once; and whatever is expanded faces each other.
    #[test]
    fn facing_pairs(
        shapes in (shapes(), shapes()),
        counts in (1..150_usize, 1..150_usize),
        seed: u64,
        one_tree: bool,
        target_options in octree_options(),
        source_options in octree_options(),
        options in lists_options(true),
    ) {
        let a = cloud(shapes.0, counts.0, seed);
        let b = if one_tree { a.clone() } else { cloud(shapes.1, counts.1, !seed) };
        let grid = grid(&[&a, &b]);
        let targets = a.tree(grid, target_options);
        let sources = if one_tree { targets.clone() } else { b.tree(grid, source_options) };
        let lists = if one_tree { Lists::new(&targets, &targets, options) } else { Lists::new(&targets, &sources, options) };
        let lists = lists.expect("lists");
        lists.assert_well_formed(&targets, &sources);
        let rounding = 1e-5 * grid.half + 2e-7 * grid.magnitude();
        for (i, row) in meetings(&targets, &sources, &lists).iter().enumerate() {
            for (j, &[near, expanded]) in row.iter().enumerate() {
                let d = [0, 1, 2].map(|c| targets.positions[i][c] - sources.positions[j][c]);
                let tolerance = rounding + options.grazing * dot(d, d).sqrt();
                let least = dot(sources.normals[j], d).min(-dot(targets.normals[i], d));
                prop_assert!(near + expanded <= 1, "met {} times", near + expanded);
                prop_assert!(least <= tolerance || near + expanded == 1, "a pair with n.d = {least} is missing");
                prop_assert!(expanded == 0 || least >= -tolerance, "a pair with n.d = {least} is expanded");
            }
        }
    }

    /// Batches are the interaction list in another order.
    #[test]
    fn batches_are_the_interaction_list(
        shape in shapes(),
        count in 1..1500_usize,
        seed: u64,
        tree_options in octree_options(),
        options in lists_options(false),
        width in 1..300_usize,
    ) {
        let a = cloud(shape, count, seed);
        let tree = a.tree(grid(&[&a]), tree_options);
        let lists = Lists::new(&tree, &tree, options).expect("lists");
        let batches = lists.batches(&tree, &tree, width);
        let mut expected: Vec<(u32, u32)> = lists.interaction_list.pairs().map(|(t, s)| (t as u32, s as u32)).collect();
        let mut got: Vec<(u32, u32)> = batches.targets.iter().copied().zip(batches.sources.iter().copied()).collect();
        expected.sort_unstable();
        got.sort_unstable();
        prop_assert_eq!(expected, got);
        let mut end = 0;
        for slab in &batches.slabs {
            prop_assert!(slab.targets.start >= end && slab.targets.len() <= width);
            end = slab.targets.end;
            for batch in &batches.batches[slab.batches.clone()] {
                for pair in batch.pairs.clone() {
                    let (t, s) = (batches.targets[pair] as usize, batches.sources[pair] as usize);
                    prop_assert!(slab.targets.contains(&t) && tree.level[t] == batch.level);
                    let offset = [0, 1, 2].map(|i| tree.cell[s][i] - tree.cell[t][i]);
                    prop_assert_eq!(offset, batch.offset);
                }
                prop_assert!(batches.targets[batch.pairs.clone()].is_sorted());
            }
        }
        prop_assert_eq!(batches.batches.iter().map(|batch| batch.pairs.len()).sum::<usize>(), batches.targets.len());
    }
}

/// With k = 1 and a full grid the lists are those of the textbook.
#[test]
fn full_grid_has_27_neighbours_and_189_interactions() {
    let n = 16;
    let positions =
        (0..n * n * n).map(|i| [i % n, i / n % n, i / n / n].map(|x| (x as f64 + 0.5) / n as f64)).collect();
    let a = Cloud { positions, normals: vec![[0.0, 0.0, 1.0]; n * n * n] };
    let grid = fmm::octree::Grid { centre: [0.5; 3], half: 0.5 };
    let tree = a.tree(grid, OctreeOptions { grouping: Grouping::Adaptive { points: 1 }, by_normal: false });
    assert_eq!((tree.n_levels(), tree.leaves().count()), (5, n * n * n));
    let lists = Lists::new(&tree, &tree, ListsOptions::new(1, false)).expect("lists");
    let longest = |rows: &fmm::lists::Rows| (0..tree.n_boxes()).map(|b| rows.row(b).len()).max();
    assert_eq!(longest(&lists.near_neighbours), Some(27));
    assert_eq!(longest(&lists.interaction_list), Some(189));
    assert_eq!(longest(&lists.local_interaction_list), Some(0));
    assert_eq!(longest(&lists.multipole_interaction_list), Some(0));
}

/// Of one tree with itself the local interaction list is the inverse of the multipole interaction list.
#[test]
fn lists_w_and_x_are_inverse() {
    let a = cloud(Shape::Clustered, 3000, 5);
    let tree = a.tree(grid(&[&a]), OctreeOptions { grouping: Grouping::Adaptive { points: 9 }, by_normal: false });
    let lists = Lists::new(&tree, &tree, ListsOptions::new(1, false)).expect("lists");
    let mut turned: Vec<_> = lists.multipole_interaction_list.pairs().map(|(t, s)| (s, t)).collect();
    turned.sort_unstable();
    let mut local: Vec<_> = lists.local_interaction_list.pairs().collect();
    local.sort_unstable();
    assert!(!local.is_empty());
    assert_eq!(turned, local);
}
