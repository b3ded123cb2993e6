// SPDX-License-Identifier: GPL-3.0-or-later
//! A shaft that is clear must be clear for every pair of points.

#![allow(clippy::unwrap_used)]

use fmm::octree::{Grid, Grouping, Octree, OctreeOptions};
use fmm::shaft::{Blockers, End, pass};
use proptest::prelude::*;

type Vector = [f64; 3];

fn vector(range: std::ops::Range<f64>) -> impl Strategy<Value = Vector> {
    [range.clone(), range.clone(), range]
}

/// Points in a small box at some place, in one plane when `flat`, with normals towards +z or spread.
fn cloud() -> impl Strategy<Value = (Vec<Vector>, Vec<Vector>)> {
    (vector(-2.0..2.0), vector(0.1..1.0), prop::collection::vec(vector(-0.5..0.5), 1..12), any::<bool>()).prop_map(
        |(centre, size, points, flat)| {
            let place = |p: Vector| [0, 1, 2].map(|i| centre[i] + size[i] * if flat && i == 2 { 0.0 } else { p[i] });
            let normal = |p: &Vector| {
                let n = glam::DVec3::new(p[0], p[1], 1.0).normalize();
                if flat { [0.0, 0.0, 1.0] } else { n.into() }
            };
            (points.iter().map(|&p| place(p)).collect(), points.iter().map(normal).collect())
        },
    )
}

fn one_box(points: &[Vector], normals: &[Vector]) -> Octree {
    let grid = Grid::around(&[points]).unwrap();
    let options = OctreeOptions { grouping: Grouping::Uniform { level: 0 }, by_normal: false };
    Octree::new(points, Some(normals), grid, options).unwrap()
}

/// Möller and Trumbore, "Fast, minimum storage ray-triangle intersection", 1997.
fn crosses(x: Vector, y: Vector, triangle: &[Vector; 3]) -> bool {
    let [a, b, c] = triangle.map(glam::DVec3::from);
    let (origin, d) = (glam::DVec3::from(x), glam::DVec3::from(y) - glam::DVec3::from(x));
    let (e1, e2) = (b - a, c - a);
    let p = d.cross(e2);
    let det = e1.dot(p);
    let t = origin - a;
    let (u, q) = (t.dot(p) / det, t.cross(e1));
    let (v, s) = (d.dot(q) / det, e2.dot(q) / det);
    let inside = |x: f64| (1e-6..1.0 - 1e-6).contains(&x);
    inside(u) && inside(v) && inside(u + v) && inside(s)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(4000))]
    #[test]
    fn no_segment_of_a_clear_shaft_meets_a_triangle(
        a in cloud(),
        b in cloud(),
        triangles in prop::collection::vec([vector(-2.5..2.5), vector(-2.5..2.5), vector(-2.5..2.5)], 1..9),
    ) {
        let (from, to) = (one_box(&a.0, &a.1), one_box(&b.0, &b.1));
        let blockers = Blockers::new(&triangles, [&from, &to]);
        let clear = blockers.are_clear(&End::new(&from, 0), &End::new(&to, 0));
        for (x, n_x) in a.0.iter().zip(&a.1) {
            for (y, n_y) in b.0.iter().zip(&b.1) {
                let d = glam::DVec3::from(*y) - glam::DVec3::from(*x);
                let faces = d.dot(glam::DVec3::from(*n_x)) > 1e-6 && d.dot(glam::DVec3::from(*n_y)) < -1e-6;
                let met = triangles.iter().any(|triangle| crosses(*x, *y, triangle));
                prop_assert!(!(clear && faces && met), "{x:?} {y:?}");
            }
        }
    }
}

#[test]
fn walls_around_a_room_block_nothing_and_a_block_in_it_does() {
    let (floor, ceiling) = ([[0.1, 0.2, 0.0], [0.9, 0.8, 0.0]], [[0.1, 0.1, 1.0], [0.9, 0.9, 1.0]]);
    let (up, down) = ([[0.0, 0.0, 1.0]; 2], [[0.0, 0.0, -1.0]; 2]);
    let (a, b) = (one_box(&floor, &up), one_box(&ceiling, &down));
    let wall = [[0.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 1.0, 1.0]];
    assert!(Blockers::new(&[wall], [&a, &b]).is_empty());
    let block = [[0.4, 0.4, 0.5], [0.6, 0.4, 0.5], [0.5, 0.6, 0.5]];
    let blockers = Blockers::new(&[wall, block], [&a, &b]);
    assert_eq!(blockers.len(), 1);
    assert!(!blockers.are_clear(&End::new(&a, 0), &End::new(&b, 0)));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(4000))]
    #[test]
    fn no_segment_passes_a_box_that_its_shaft_misses(
        a in cloud(),
        b in cloud(),
        around in any::<bool>(),
        (centre, size) in (vector(-2.0..2.0), vector(0.01..1.0)),
    ) {
        let (from, to) = (one_box(&a.0, &a.1), one_box(&b.0, &b.1));
        let bounds = [-1.0, 1.0].map(|side| [0, 1, 2].map(|i| centre[i] + side * size[i]));
        let target = End::new(&from, 0);
        let source = if around { End::around(&b.0, 0.2) } else { End::new(&to, 0) };
        if !pass(&target, &source, &[bounds]) {
            for &x in &a.0 {
                for &y in &b.0 {
                    for k in 0..=100 {
                        let place = [0, 1, 2].map(|i| x[i] + f64::from(k) / 100.0 * (y[i] - x[i]));
                        let inside = (0..3).all(|i| bounds[0][i] + 1e-9 < place[i] && place[i] < bounds[1][i] - 1e-9);
                        let flat = |end: &End| end.plane.is_none_or(|(n, o)| (0..3).map(|i| n[i] * place[i]).sum::<f64>() > o + 1e-9);
                        prop_assert!(!inside || !flat(&target) || !flat(&source));
                    }
                }
            }
        }
    }
}
