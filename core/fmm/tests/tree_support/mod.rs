// SPDX-License-Identifier: GPL-3.0-or-later
//! Point sets of awkward shapes, and a count of what the passes of the method deliver.
#![allow(dead_code, reason = "each test file uses its own part")]

use fmm::lists::Lists;
use fmm::octree::{Grid, Grouping, Octree, OctreeOptions};
use proptest::prelude::*;

/// Positions and unit normals.
#[derive(Debug, Clone, Default)]
pub struct Cloud {
    pub positions: Vec<[f64; 3]>,
    pub normals: Vec<[f64; 3]>,
}

#[derive(Debug, Clone, Copy)]
pub enum Shape {
    Random,
    Clustered,
    Planar,
    Duplicates,
    Collinear,
    Single,
    Room,
    TurnedRoom,
    Sphere,
    Ball,
}

pub const SHAPES: [Shape; 10] = [
    Shape::Random,
    Shape::Clustered,
    Shape::Planar,
    Shape::Duplicates,
    Shape::Collinear,
    Shape::Single,
    Shape::Room,
    Shape::TurnedRoom,
    Shape::Sphere,
    Shape::Ball,
];

/// A small generator of equally distributed numbers.
pub struct Numbers(pub u64);

impl Numbers {
    pub fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ z >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ z >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ z >> 31
    }

    /// In [0, 1).
    pub fn unit(&mut self) -> f64 {
        (self.bits() >> 11) as f64 / (1_u64 << 53) as f64
    }

    pub fn point(&mut self) -> [f64; 3] {
        [self.unit(), self.unit(), self.unit()]
    }

    pub fn direction(&mut self) -> [f64; 3] {
        loop {
            let d = self.point().map(|x| 2.0 * x - 1.0);
            let square = dot(d, d);
            if square > 0.01 && square < 1.0 {
                return d.map(|x| x / square.sqrt());
            }
        }
    }
}

pub fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// Turned about two axes by angles of no special value.
pub fn turned(p: [f64; 3]) -> [f64; 3] {
    let ((s, c), (t, d)) = (0.6_f64.sin_cos(), 0.35_f64.sin_cos());
    let [x, y, z] = [c * p[0] - s * p[1], s * p[0] + c * p[1], p[2]];
    [x, d * y - t * z, t * y + d * z]
}

/// A point of the inner faces of the unit cube.
fn wall(numbers: &mut Numbers) -> ([f64; 3], [f64; 3]) {
    let (axis, side) = ((numbers.bits() % 3) as usize, (numbers.bits() % 2) as f64);
    let mut position = numbers.point();
    position[axis] = side;
    let mut normal = [0.0; 3];
    normal[axis] = 1.0 - 2.0 * side;
    (position, normal)
}

pub fn cloud(shape: Shape, n: usize, seed: u64) -> Cloud {
    let mut numbers = Numbers(seed);
    let numbers = &mut numbers;
    let point = |numbers: &mut Numbers| match shape {
        Shape::Random => (numbers.point(), numbers.direction()),
        Shape::Clustered => {
            let scale = 10_f64.powi(-((numbers.bits() % 8) as i32));
            (numbers.point().map(|x| 0.3 + scale * x), numbers.direction())
        }
        Shape::Planar => {
            let [x, y, _] = numbers.point();
            (turned([x, y, 0.25]), turned([0.0, 0.0, 1.0]))
        }
        Shape::Duplicates => {
            let x = (numbers.bits() % 3) as f64;
            ([x, 0.1 * x, 1.0], numbers.direction())
        }
        Shape::Collinear => (turned([numbers.unit(), 0.0, 0.0]), numbers.direction()),
        Shape::Single => ([0.3, -0.2, 7.0], [0.0, 0.6, 0.8]),
        Shape::Room => wall(numbers),
        Shape::TurnedRoom => {
            let (position, normal) = wall(numbers);
            (turned(position), turned(normal))
        }
        Shape::Sphere | Shape::Ball => {
            let d = numbers.direction();
            let inward = if matches!(shape, Shape::Sphere) { -1.0 } else { 1.0 };
            (d.map(|x| 2.0 + 0.5 * x), d.map(|x| inward * x))
        }
    };
    let n = if matches!(shape, Shape::Single) { 1 } else { n };
    let (positions, normals) = (0..n).map(|_| point(numbers)).unzip();
    Cloud { positions, normals }
}

impl Cloud {
    pub fn tree(&self, grid: Grid, options: OctreeOptions) -> Octree {
        let tree = Octree::new(&self.positions, Some(&self.normals), grid, options).expect("a good cloud");
        tree.assert_well_formed();
        for (i, &scene) in tree.to_scene.iter().enumerate() {
            assert_eq!(tree.positions[i], self.positions[scene as usize]);
            assert!(dot(tree.normals[i], self.normals[scene as usize]) > 1.0 - 1e-12);
        }
        tree
    }
}

pub fn grid(clouds: &[&Cloud]) -> Grid {
    let sets: Vec<&[[f64; 3]]> = clouds.iter().map(|cloud| cloud.positions.as_slice()).collect();
    Grid::around(&sets).expect("good clouds")
}

pub fn shapes() -> impl Strategy<Value = Shape> {
    proptest::sample::select(SHAPES.to_vec())
}

pub fn octree_options() -> impl Strategy<Value = OctreeOptions> {
    let grouping = prop_oneof![
        (1..40_usize).prop_map(|points| Grouping::Adaptive { points }),
        (0..5_u8).prop_map(|level| Grouping::Uniform { level }),
    ];
    (grouping, any::<bool>()).prop_map(|(grouping, by_normal)| OctreeOptions { grouping, by_normal })
}

/// The passes with the constant 1 for the kernel, so that a multipole is a sum of sources and a local expansion a number.
/// weights: (sources in tree order); returns what each target received, in tree order. Sums wrap around.
pub fn constant_kernel(targets: &Octree, sources: &Octree, lists: &Lists, weights: &[u64]) -> Vec<u64> {
    let multipole: Vec<u64> = upward(sources, weights);
    let mut local = vec![0_u64; targets.n_boxes()];
    let mut received = vec![0_u64; targets.n_points()];
    for t in 0..targets.n_boxes() {
        let v = lists.interaction_list.row(t).iter().map(|&s| multipole[s as usize]);
        let x = lists.local_interaction_list.row(t).iter().map(|&s| sum(&weights[sources.points_of(s as usize)]));
        let parent = if t < targets.roots().end { 0 } else { local[targets.parent[t] as usize] };
        local[t] = v.chain(x).fold(parent, u64::wrapping_add);

        let u = lists.near_neighbours.row(t).iter().map(|&s| sum(&weights[sources.points_of(s as usize)]));
        let w = lists.multipole_interaction_list.row(t).iter().map(|&s| multipole[s as usize]);
        let inherited = if targets.is_leaf(t) { local[t] } else { 0 };
        let direct = u.chain(w).fold(inherited, u64::wrapping_add);
        for i in targets.points_of(t) {
            received[i] = received[i].wrapping_add(direct);
        }
    }
    received
}

fn upward(sources: &Octree, weights: &[u64]) -> Vec<u64> {
    let mut multipole = vec![0_u64; sources.n_boxes()];
    for s in (0..sources.n_boxes()).rev() {
        multipole[s] = if sources.is_leaf(s) {
            sum(&weights[sources.points_of(s)])
        } else {
            sources.children(s).fold(0, |all, c| all.wrapping_add(multipole[c]))
        };
    }
    multipole
}

fn sum(weights: &[u64]) -> u64 {
    weights.iter().fold(0, |all, &w| all.wrapping_add(w))
}

/// For every pair of points in tree order how often it is met in (near neighbours, expansions).
pub fn meetings(targets: &Octree, sources: &Octree, lists: &Lists) -> Vec<Vec<[u8; 2]>> {
    let mut met = vec![vec![[0_u8; 2]; sources.n_points()]; targets.n_points()];
    for (list, rows) in lists.all().into_iter().enumerate() {
        for (t, s) in rows.pairs() {
            for row in &mut met[targets.points_of(t)] {
                for pair in &mut row[sources.points_of(s)] {
                    pair[usize::from(list > 0)] += 1;
                }
            }
        }
    }
    met
}
