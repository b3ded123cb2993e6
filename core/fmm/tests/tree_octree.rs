// SPDX-License-Identifier: GPL-3.0-or-later
#![allow(clippy::expect_used, clippy::unwrap_used)]
//! Octrees of ordinary and of awkward input.

mod tree_support;

use fmm::lists::{Lists, ListsError, ListsOptions};
use fmm::octree::{Grid, Grouping, MAX_LEVEL, Octree, OctreeError, OctreeOptions};
use proptest::prelude::*;
use tree_support::*;

const ADAPTIVE: OctreeOptions = OctreeOptions { grouping: Grouping::Adaptive { points: 8 }, by_normal: false };
const UNIT: Grid = Grid { centre: [0.5; 3], half: 0.5 };

fn build(positions: &[[f64; 3]], options: OctreeOptions) -> Result<Octree, OctreeError> {
    Octree::new(positions, None, UNIT, options)
}

proptest! {
    #[test]
    fn well_formed(shape in shapes(), count in 1..5000_usize, seed: u64, options in octree_options()) {
        let a = cloud(shape, count, seed);
        a.tree(grid(&[&a]), options);
    }

    #[test]
    fn well_formed_far_from_the_origin(count in 1..500_usize, seed: u64, shift in -1e15..1e15_f64, size in -30..30_i32) {
        let mut a = cloud(Shape::Random, count, seed);
        let size = 10_f64.powi(size);
        a.positions.iter_mut().for_each(|p| *p = p.map(|x| shift + size * x));
        a.tree(grid(&[&a]), ADAPTIVE);
    }
}

#[test]
fn duplicates_end_at_the_deepest_level() {
    let tree = build(&[[0.3; 3]; 100], ADAPTIVE).expect("good points");
    tree.assert_well_formed();
    assert_eq!(tree.n_levels(), usize::from(MAX_LEVEL) + 1);
    assert_eq!(tree.leaves().map(|b| tree.count(b)).collect::<Vec<_>>(), [100]);
    // Equal keys keep the order of the scene.
    assert!(tree.to_scene.is_sorted());
}

#[test]
fn one_point_is_one_leaf() {
    let tree = build(&[[0.3; 3]], ADAPTIVE).expect("a good point");
    tree.assert_well_formed();
    assert_eq!((tree.n_boxes(), tree.is_leaf(0), tree.points_of(0)), (1, true, 0..1));
}

#[test]
fn points_on_every_face_of_the_grid() {
    let corner = |i: usize| [0, 1, 2].map(|c| (i >> c & 1) as f64);
    let positions: Vec<[f64; 3]> = (0..8).map(corner).collect();
    let tree = build(&positions, OctreeOptions { grouping: Grouping::Uniform { level: 3 }, by_normal: false });
    let tree = tree.expect("good points");
    tree.assert_well_formed();
    assert_eq!(tree.leaves().count(), 8);
}

#[test]
fn many_points_are_the_same_tree_on_any_threads() {
    let a = cloud(Shape::Room, 200_000, 3);
    let grid = grid(&[&a]);
    let options = OctreeOptions { grouping: Grouping::Adaptive { points: 64 }, by_normal: true };
    let one = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a pool");
    let (alone, together) = (one.install(|| a.tree(grid, options)), a.tree(grid, options));
    assert_eq!(alone.to_scene, together.to_scene);
    let options = ListsOptions::new(1, true);
    let lists = Lists::new(&together, &together, options).expect("lists");
    let again = one.install(|| Lists::new(&together, &together, options)).expect("lists");
    assert_eq!(lists.all(), again.all());
}

#[test]
fn input_that_cannot_be_used() {
    let good = [[0.1; 3], [0.9; 3]];
    assert_eq!(build(&[], ADAPTIVE).err(), Some(OctreeError::Empty));
    assert!(matches!(
        build(&[[0.1; 3], [0.1, f64::NAN, 0.1]], ADAPTIVE),
        Err(OctreeError::BadPosition { index: 1, value }) if value[1].is_nan()
    ));
    assert_eq!(
        build(&[[0.1, 1.1, 0.1]], ADAPTIVE).err(),
        Some(OctreeError::OutsideGrid { index: 0, value: [0.1, 1.1, 0.1] })
    );
    let no_points = OctreeOptions { grouping: Grouping::Adaptive { points: 0 }, by_normal: false };
    assert_eq!(build(&good, no_points).err(), Some(OctreeError::NoPointsPerLeaf));
    let deep = OctreeOptions { grouping: Grouping::Uniform { level: 21 }, by_normal: false };
    assert_eq!(build(&good, deep).err(), Some(OctreeError::LevelTooDeep { level: 21, deepest: 20 }));
    let split = OctreeOptions { by_normal: true, ..ADAPTIVE };
    assert_eq!(build(&good, split).err(), Some(OctreeError::NormalsMissing));
    let flat = Grid { half: 0.0, ..UNIT };
    assert!(matches!(Octree::new(&good, None, flat, ADAPTIVE), Err(OctreeError::BadGrid { half: 0.0, .. })));
    let normals = [[0.0, 0.0, 1.0]];
    assert_eq!(
        Octree::new(&good, Some(&normals), UNIT, ADAPTIVE).err(),
        Some(OctreeError::NormalCount { positions: 2, normals: 1 })
    );
    let normals = [[0.0, 0.0, 1.0], [0.0; 3]];
    assert_eq!(
        Octree::new(&good, Some(&normals), UNIT, ADAPTIVE).err(),
        Some(OctreeError::BadNormal { index: 1, value: [0.0; 3] })
    );
}

#[test]
fn trees_that_cannot_be_paired() {
    let a = build(&[[0.1; 3], [0.9; 3]], ADAPTIVE).expect("good points");
    let other = Grid { centre: [0.5; 3], half: 1.0 };
    let b = Octree::new(&[[0.1; 3]], None, other, ADAPTIVE).expect("a good point");
    let error = Lists::new(&a, &b, ListsOptions::new(1, false)).err();
    assert_eq!(error, Some(ListsError::GridsDiffer { targets: UNIT, sources: other }));
    assert_eq!(Lists::new(&a, &a, ListsOptions::new(0, false)).err(), Some(ListsError::NoSeparation));
    let grazing = ListsOptions { grazing: 1.0, ..ListsOptions::new(1, false) };
    assert_eq!(Lists::new(&a, &a, grazing).err(), Some(ListsError::BadGrazing { grazing: 1.0 }));
    let error = Lists::new(&a, &a, ListsOptions::new(1, true)).err();
    assert_eq!(error, Some(ListsError::Facing(OctreeError::NormalsMissing)));
}
