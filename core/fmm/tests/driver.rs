// SPDX-License-Identifier: GPL-3.0-or-later
#![allow(clippy::expect_used, clippy::unwrap_used)]
//! The whole method against the direct sum: one tree, two trees, every expansion, every list.

use fmm::direct::Sources;
use fmm::driver::Fmm;
use fmm::expansion::{Compressed, Expansion, Paper, Whole};
use fmm::lists::ListsOptions;
use fmm::octree::{Grid, Grouping, Octree, OctreeOptions};
use std::sync::Arc;

type Rows = Vec<[f64; 3]>;

/// Numbers in [0, 1) from a fixed seed (xorshift64).
fn numbers() -> impl FnMut() -> f64 {
    let mut state = 0x2545_f491_4f6c_dd1d_u64;
    move || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state >> 11) as f64 / (1_u64 << 53) as f64
    }
}

/// Random points on the inside of the unit cube, denser towards one corner so that leaves differ in level.
fn room(count: usize, power: i32, random: &mut impl FnMut() -> f64) -> (Rows, Rows) {
    (0..count)
        .map(|i| {
            let (face, mut x) = (i % 6, [random(), random(), random()].map(|u| u.powi(power)));
            x[face % 3] = (face / 3) as f64;
            let mut n = [0.0; 3];
            n[face % 3] = if face < 3 { 1.0 } else { -1.0 };
            (x, n)
        })
        .unzip()
}

struct Case {
    sources: (Rows, Rows),
    targets: (Rows, Rows),
    strengths: Rows,
    exact: Rows,
}

fn case(power: i32) -> Case {
    let mut random = numbers();
    let (sources, targets) = (room(3000, power, &mut random), room(1000, 1, &mut random));
    let strengths: Rows = (0..3000).map(|_| [random(), 0.5, random()]).collect();
    let direct = Sources::new(&sources.0, &sources.1, &[1e-9; 3000]).unwrap();
    let exact = direct.irradiance(&targets.0, &targets.1, &strengths, None).unwrap();
    Case { sources, targets, strengths, exact }
}

impl Case {
    fn error(&self, expansion: Box<dyn Expansion>, grouping: Grouping, separation: u32) -> f64 {
        let options = OctreeOptions { grouping, by_normal: true };
        let grid = Grid::around(&[&self.sources.0, &self.targets.0]).unwrap();
        let sources = Octree::new(&self.sources.0, Some(&self.sources.1), grid, options).unwrap();
        let targets = Octree::new(&self.targets.0, Some(&self.targets.1), grid, options).unwrap();
        let lists = ListsOptions::new(separation, true);
        let fmm = Fmm::new(expansion.into(), targets, sources, &[1e-9; 3000], lists).unwrap();
        let found = fmm.apply(&self.strengths).unwrap();
        let squared = |rows: &mut dyn Iterator<Item = f64>| rows.map(|x| x * x).sum::<f64>();
        let pairs = || found.as_flattened().iter().zip(self.exact.as_flattened());
        (squared(&mut pairs().map(|(a, b)| a - b)) / squared(&mut pairs().map(|(_, b)| *b))).sqrt()
    }
}

#[test]
fn two_trees_agree_with_the_direct_sum_for_every_expansion() {
    for case in [case(1), case(3)] {
        let grouping = Grouping::Adaptive { points: 20 };
        for (p, bound) in [(2, 0.02), (4, 0.005), (8, 2e-4)] {
            assert!(case.error(Box::new(Whole::new(p)), grouping, 1) < bound, "whole {p}");
        }
        assert!(case.error(Box::new(Compressed::new(4, 1)), grouping, 1) < 0.005);
        assert!(case.error(Box::new(Paper::new(8)), grouping, 1) < 0.005);
    }
}

#[test]
fn separation_two_and_fixed_levels_agree_with_the_direct_sum() {
    let case = case(2);
    assert!(case.error(Box::new(Whole::new(4)), Grouping::Adaptive { points: 5 }, 2) < 5e-4);
    assert!(case.error(Box::new(Compressed::new(4, 2)), Grouping::Adaptive { points: 5 }, 2) < 5e-4);
    for level in 0..4 {
        assert!(case.error(Box::new(Whole::new(6)), Grouping::Uniform { level }, 1) < 2e-3, "level {level}");
    }
}

#[test]
fn uneven_trees_use_all_four_lists() {
    let case = case(4);
    let options = OctreeOptions { grouping: Grouping::Adaptive { points: 10 }, by_normal: true };
    let grid = Grid::around(&[&case.sources.0, &case.targets.0]).unwrap();
    let sources = Octree::new(&case.sources.0, Some(&case.sources.1), grid, options).unwrap();
    let targets = Octree::new(&case.targets.0, Some(&case.targets.1), grid, options).unwrap();
    let fmm = Fmm::new(Arc::new(Whole::new(2)), targets, sources, &[1e-9; 3000], ListsOptions::new(1, true)).unwrap();
    for (name, rows) in ["U", "V", "X", "W"].iter().zip(fmm.lists().all()) {
        assert!(!rows.boxes.is_empty(), "{name} is empty");
    }
}

#[test]
fn wrong_lengths_are_refused() {
    let case = case(1);
    let grid = Grid::around(&[&case.sources.0]).unwrap();
    let options = OctreeOptions { grouping: Grouping::Adaptive { points: 20 }, by_normal: true };
    let tree = Octree::new(&case.sources.0, Some(&case.sources.1), grid, options).unwrap();
    let lists = ListsOptions::new(1, true);
    let error = Fmm::new(Arc::new(Whole::new(2)), tree.clone(), tree.clone(), &[1.0], lists).err().unwrap();
    assert_eq!(error.to_string(), "source softening: expected 3000 rows, found 1");
    let fmm = Fmm::new(Arc::new(Whole::new(2)), tree.clone(), tree, &[1e-9; 3000], lists).unwrap();
    assert!(fmm.apply(&[[1.0; 3]]).is_err());
}

/// A grey sum in one channel is each of three.
#[test]
fn one_channel_equals_three() {
    let case = case(3);
    let options = OctreeOptions { grouping: Grouping::Adaptive { points: 10 }, by_normal: true };
    let grid = Grid::around(&[&case.sources.0, &case.targets.0]).unwrap();
    let sources = Octree::new(&case.sources.0, Some(&case.sources.1), grid, options).unwrap();
    let targets = Octree::new(&case.targets.0, Some(&case.targets.1), grid, options).unwrap();
    let expansions: [Arc<dyn Expansion>; 3] =
        [Arc::new(Whole::new(3)), Arc::new(Paper::new(3)), Arc::new(Compressed::new(3, 1))];
    for expansion in expansions {
        let lists = ListsOptions::new(1, true);
        let fmm = Fmm::new(expansion, targets.clone(), sources.clone(), &[1e-9; 3000], lists).unwrap();
        let three = fmm.apply(&case.strengths).unwrap();
        for c in 0..3 {
            let one = fmm.apply(&case.strengths.iter().map(|q| [q[c]]).collect::<Vec<_>>()).unwrap();
            for (one, three) in one.iter().zip(&three) {
                assert!((one[0] - three[c]).abs() <= 1e-12 * three[c].abs(), "{} {}", one[0], three[c]);
            }
        }
    }
}

#[test]
fn what_sources_send_is_the_transposed_sum() {
    let mut random = numbers();
    let (x, n) = room(3000, 2, &mut random);
    let options = OctreeOptions { grouping: Grouping::Adaptive { points: 30 }, by_normal: true };
    let tree = Arc::new(Octree::new(&x, Some(&n), Grid::around(&[&x]).unwrap(), options).unwrap());
    let lists = ListsOptions::new(1, true);
    let fmm = Fmm::new(Arc::new(Whole::new(8)), tree.clone(), tree, &[1e-9; 3000], lists).unwrap();
    let areas: Vec<f64> = (0..3000).map(|_| random()).collect();
    let strengths: Vec<[f64; 1]> = (0..3000).map(|_| [random()]).collect();
    let received: f64 = fmm.apply(&strengths).unwrap().iter().zip(&areas).map(|(h, area)| h[0] * area).sum();
    let sent: f64 = fmm.sent(&areas).unwrap().iter().zip(&strengths).map(|(sent, q)| sent * q[0]).sum();
    assert!((received / sent - 1.0).abs() < 1e-3, "{received} arrives of {sent}");
    assert!(fmm.sent(&areas[1..]).is_err());
}
