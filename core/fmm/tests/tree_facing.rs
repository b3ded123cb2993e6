// SPDX-License-Identifier: GPL-3.0-or-later
#![allow(clippy::expect_used, clippy::unwrap_used)]
//! Which pairs of boxes face each other, on shapes where the answer is known.

mod tree_support;

use fmm::facing::{Facing, FacingTest};
use fmm::lists::{Lists, ListsOptions};
use fmm::octree::{Grid, Grouping, Octree, OctreeError, OctreeOptions};
use tree_support::*;

const ONE_BOX: OctreeOptions = OctreeOptions { grouping: Grouping::Uniform { level: 0 }, by_normal: false };

fn adaptive(points: usize) -> OctreeOptions {
    OctreeOptions { grouping: Grouping::Adaptive { points }, by_normal: true }
}

/// n x n points of the square origin + [0, 1] u + [0, 1] v, edges included.
fn quad(origin: [f64; 3], u: [f64; 3], v: [f64; 3], normal: [f64; 3], n: usize) -> Cloud {
    let along = |i: usize| i as f64 / (n - 1) as f64;
    let point = |i: usize| [0, 1, 2].map(|c| origin[c] + along(i % n) * u[c] + along(i / n) * v[c]);
    Cloud { positions: (0..n * n).map(point).collect(), normals: vec![normal; n * n] }
}

/// How the points of one cloud, taken as one box, face those of another.
fn facing(a: &Cloud, b: &Cloud) -> Facing {
    let grid = grid(&[a, b]);
    let (targets, sources) = (a.tree(grid, ONE_BOX), b.tree(grid, ONE_BOX));
    let test = FacingTest::new(&targets, &sources, 0.0).expect("normals");
    let back = FacingTest::new(&sources, &targets, 0.0).expect("normals");
    assert_eq!(test.classify(0, 0), back.classify(0, 0), "facing is symmetric");
    test.classify(0, 0)
}

fn moved(cloud: &Cloud, change: impl Fn([f64; 3]) -> [f64; 3], turn: impl Fn([f64; 3]) -> [f64; 3]) -> Cloud {
    Cloud {
        positions: cloud.positions.iter().map(|&p| change(p)).collect(),
        normals: cloud.normals.iter().map(|&n| turn(n)).collect(),
    }
}

const X: [f64; 3] = [1.0, 0.0, 0.0];
const Y: [f64; 3] = [0.0, 1.0, 0.0];
const Z: [f64; 3] = [0.0, 0.0, 1.0];
const ORIGIN: [f64; 3] = [0.0; 3];

/// Floor, ceiling and one wall of a room, which meet along edges.
fn room_parts() -> [Cloud; 3] {
    [quad(ORIGIN, X, Y, Z, 9), quad(Z, X, Y, [0.0, 0.0, -1.0], 9), quad(ORIGIN, Y, Z, X, 9)]
}

#[test]
fn walls_of_a_room_face_each_other_but_not_themselves() {
    let straight = |p: [f64; 3]| p;
    let far_off = |p: [f64; 3]| turned(p).map(|x| 1e4 + 3.0 * x);
    for parts in [
        room_parts(),
        room_parts().map(|part| moved(&part, turned, turned)),
        room_parts().map(|part| moved(&part, far_off, turned)),
        room_parts().map(|part| moved(&part, |p| p.map(|x| 1e-9 * x), straight)),
    ] {
        let [floor, ceiling, wall] = &parts;
        for part in &parts {
            assert_eq!(facing(part, part), Facing::None);
        }
        assert_eq!(facing(floor, ceiling), Facing::All);
        assert_eq!(facing(floor, wall), Facing::All);
        assert_eq!(facing(wall, ceiling), Facing::All);
    }
}

#[test]
fn positions_in_single_precision_stay_coplanar() {
    let single = |p: [f64; 3]| turned(p.map(|x| 5.0 * x)).map(|x| f64::from(x as f32));
    let single_normal = |n: [f64; 3]| turned(n).map(|x| f64::from(x as f32));
    let parts = room_parts().map(|part| moved(&part, single, single_normal));
    for (i, a) in parts.iter().enumerate() {
        for (j, b) in parts.iter().enumerate() {
            assert_eq!(facing(a, b), if i == j { Facing::None } else { Facing::All }, "{i} {j}");
        }
    }
}

#[test]
fn backs_never_face() {
    let [floor, ceiling, wall] = room_parts();
    let outward = |cloud: &Cloud| moved(cloud, |p| p, |n| n.map(|x| -x));
    assert_eq!(facing(&outward(&floor), &outward(&ceiling)), Facing::None);
    assert_eq!(facing(&floor, &outward(&ceiling)), Facing::None);
    assert_eq!(facing(&wall, &outward(&floor)), Facing::None);
}

#[test]
fn parallel_planes_face_the_same_way() {
    let shelf = moved(&quad(ORIGIN, X, Y, Z, 9), turned, turned);
    let higher = moved(&quad(Z, X, Y, Z, 9), turned, turned);
    assert_eq!(facing(&shelf, &higher), Facing::None);
}

#[test]
fn a_wall_that_reaches_below_the_floor_faces_it_in_part() {
    let [floor, _, _] = room_parts();
    let wall = quad([0.0, 0.0, -0.5], Y, Z, X, 9);
    assert_eq!(facing(&floor, &wall), Facing::Some);
}

#[test]
fn a_small_dip_is_seen() {
    let [floor, _, _] = room_parts();
    let wall = quad([0.0, 0.0, -1e-3], Y, Z, X, 9);
    assert_eq!(facing(&floor, &wall), Facing::Some);
}

#[test]
fn a_sphere_faces_itself_inside_and_not_outside() {
    let (inside, outside) = (cloud(Shape::Sphere, 4000, 1), cloud(Shape::Ball, 4000, 1));
    for (cloud, other) in [(inside, Facing::None), (outside, Facing::All)] {
        let tree = cloud.tree(grid(&[&cloud]), adaptive(16));
        let test = FacingTest::new(&tree, &tree, 0.0).expect("normals");
        let leaves: Vec<usize> = tree.leaves().collect();
        // A leaf of one point does not face itself.
        let pairs = leaves.iter().flat_map(|&t| leaves.iter().map(move |&s| (t, s))).filter(|(t, s)| t != s);
        let classes: Vec<Facing> = pairs.map(|(t, s)| test.classify(t, s)).collect();
        assert!(!classes.contains(&other));
        let open = classes.iter().filter(|&&facing| facing == Facing::Some).count();
        assert!(open * 10 < classes.len(), "{open} of {} pairs are left open", classes.len());
    }
}

#[test]
fn octrees_without_normals_are_refused() {
    let [floor, _, _] = room_parts();
    let tree = Octree::new(&floor.positions, None, grid(&[&floor]), ONE_BOX).expect("good points");
    assert_eq!(FacingTest::new(&tree, &tree, 0.0).err(), Some(OctreeError::NormalsMissing));
}

/// Inner faces of a cube of 6 n^2 cell centres.
fn room(n: usize) -> Cloud {
    let mut all = Cloud::default();
    for axis in 0..3 {
        for side in [0.0, 1.0] {
            for i in 0..n * n {
                let mut position = [side; 3];
                position[(axis + 1) % 3] = ((i % n) as f64 + 0.5) / n as f64;
                position[(axis + 2) % 3] = ((i / n) as f64 + 0.5) / n as f64;
                let mut normal = [0.0; 3];
                normal[axis] = 1.0 - 2.0 * side;
                all.positions.push(position);
                all.normals.push(normal);
            }
        }
    }
    all
}

fn assert_room_is_settled(room: &Cloud, grid: Grid, separation: u32) {
    let tree = room.tree(grid, adaptive(20));
    assert_eq!(tree.roots().len(), 6, "one root a wall");
    let lists = Lists::new(&tree, &tree, ListsOptions::new(separation, true)).expect("lists");
    lists.assert_well_formed(&tree, &tree);
    assert_eq!((lists.facing_counts.some, lists.facing_counts.postponed), (0, 0));
    assert!(!lists.interaction_list.boxes.is_empty());
    for rows in lists.all() {
        assert!(rows.pairs().all(|(t, s)| tree.axis[t] != tree.axis[s]), "a wall does not exchange with itself");
    }
}

#[test]
fn a_room_leaves_nothing_open() {
    let turn = |angle: f64| {
        let (s, c) = angle.sin_cos();
        move |p: [f64; 3]| [c * p[0] - s * p[1], s * p[0] + c * p[1], p[2]]
    };
    let eighth = turn(std::f64::consts::FRAC_PI_4);
    let straight = room(40);
    for room in [straight.clone(), moved(&straight, turned, turned), moved(&straight, eighth, eighth)] {
        for separation in 1..4 {
            assert_room_is_settled(&room, grid(&[&room]), separation);
        }
    }
}

/// The kernel (eq 1) times pi without its clamp.
fn signed_kernel(targets: &Octree, i: usize, sources: &Octree, j: usize) -> [f64; 2] {
    let d = [0, 1, 2].map(|c| targets.positions[i][c] - sources.positions[j][c]);
    let square = dot(d, d).max(1e-12);
    [dot(sources.normals[j], d) / square, -dot(targets.normals[i], d) / square]
}

/// Relative L2 error of the irradiance when near neighbours are clamped, expanded pairs are not, and others are left out.
fn horizon_error(cloud: &Cloud, grazing: f64) -> f64 {
    let tree = cloud.tree(grid(&[cloud]), adaptive(2));
    let lists = Lists::new(&tree, &tree, ListsOptions { grazing, ..ListsOptions::new(1, true) }).expect("lists");
    let mut error = 0.0;
    let mut whole = 0.0;
    for (i, row) in meetings(&tree, &tree, &lists).iter().enumerate() {
        let (mut exact, mut got) = (0.0, 0.0);
        for (j, &[near, expanded]) in row.iter().enumerate() {
            let [sent, received] = signed_kernel(&tree, i, &tree, j);
            let clamped = sent.max(0.0) * received.max(0.0);
            exact += clamped;
            got += f64::from(near) * clamped + f64::from(expanded) * sent * received;
        }
        error += (got - exact).powi(2);
        whole += exact * exact;
    }
    (error / whole).sqrt()
}

#[test]
fn a_grazing_cosine_costs_its_square() {
    let ball = moved(&cloud(Shape::Ball, 2000, 3), |p| p.map(|x| 0.5 + 0.5 * (x - 2.0)), |n| n);
    let mut scene = room(18);
    scene.positions.extend(ball.positions);
    scene.normals.extend(ball.normals);
    assert!(horizon_error(&scene, 0.0) < 1e-6);
    for grazing in [0.05, 0.1, 0.2] {
        let error = horizon_error(&scene, grazing);
        assert!(error < grazing * grazing, "{grazing} costs {error}");
    }
}

#[test]
fn a_grazing_cosine_saves_postponed_pairs() {
    let sphere = cloud(Shape::Sphere, 20_000, 2);
    let tree = sphere.tree(grid(&[&sphere]), adaptive(16));
    let postponed = [0.0, 0.05, 0.1].map(|grazing| {
        let lists = Lists::new(&tree, &tree, ListsOptions { grazing, ..ListsOptions::new(1, true) }).expect("lists");
        lists.facing_counts.postponed
    });
    assert!(postponed[1] * 2 < postponed[0] && postponed[2] < postponed[1], "{postponed:?}");
}

/// Two square plates of side `size` that look at each other over a gap, `shift` away from the origin.
fn plates(size: f64, gap: f64, shift: f64) -> (Vec<[f64; 3]>, Vec<[f64; 3]>) {
    let grid = |k: usize| (k as f64 + 0.5) * size / 16.0 + shift;
    let plate = |up: bool| {
        let z = if up { shift } else { shift + gap };
        (0..256).map(move |i| ([grid(i % 16), grid(i / 16), z], [0.0, 0.0, if up { 1.0 } else { -1.0 }]))
    };
    plate(true).chain(plate(false)).unzip()
}

#[test]
fn plates_that_almost_touch_or_lie_far_away_still_see_each_other() {
    for (size, gap, shift) in [(20.0, 1e-5, 0.0), (1.0, 1e-6, 0.0), (1.0, 1e-2, 1e5), (1.0, 0.1, 1e6)] {
        let (points, normals) = plates(size, gap, shift);
        let grid = Grid::around(&[&points]).expect("a good cloud");
        let options = OctreeOptions { grouping: Grouping::Adaptive { points: 8 }, by_normal: true };
        let tree = Octree::new(&points, Some(&normals), grid, options).expect("a good cloud");
        let lists = Lists::new(&tree, &tree, ListsOptions::new(1, true)).expect("one tree");
        let met: usize = lists.near_neighbours.pairs().map(|(t, s)| tree.count(t) * tree.count(s)).sum();
        let expanded = lists.interaction_list.boxes.len();
        assert!(met > 0 || expanded > 0, "size {size}, gap {gap}, {shift} from the origin");
        let opposite = |(t, s): (usize, usize)| tree.axis[t] != tree.axis[s];
        assert!(lists.near_neighbours.pairs().any(opposite), "each point sees the one above it");
    }
}
