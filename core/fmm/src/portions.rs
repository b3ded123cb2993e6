// SPDX-License-Identifier: GPL-3.0-or-later
//! The part of a patch that each of its points stands for: what is nearer to it than to any other of them.

use crate::samples::inside;
use glam::DVec3;

/// How many corners a part may have.
pub(crate) const MOST_CORNERS: usize = 12;

/// Polygons in barycentric coordinates, counter-clockwise, which make up a patch.
#[derive(Debug, Default)]
pub struct Portions {
    polygons: Vec<Vec<[f64; 3]>>,
}

impl Portions {
    /// From the barycentric coordinates (points_per_patch, 3) of the points of every patch.
    pub fn new(rule: &[[f64; 3]]) -> Self {
        let polygon = |k: usize| {
            let others = (0..rule.len()).filter(|&other| other != k);
            let whole = Vec::from([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]);
            others.fold(whole, |polygon, other| nearer(&polygon, rule[k], rule[other]))
        };
        Self { polygons: (0..rule.len()).map(polygon).collect() }
    }

    /// How many there are of each patch.
    pub fn len(&self) -> usize {
        self.polygons.len()
    }

    pub fn is_empty(&self) -> bool {
        self.polygons.is_empty()
    }

    /// A place, in barycentric coordinates, in the part of one point, even over its area for two numbers even in [0, 1).
    pub fn place(&self, part: usize, [u, v]: [f64; 2]) -> [f64; 3] {
        let polygon = &self.polygons[part];
        let fan = || polygon[1..].windows(2).map(|side| [polygon[0], side[0], side[1]]);
        let mut left = u * fan().map(size).sum::<f64>();
        let last = polygon.len() - 3;
        for (k, triangle) in fan().enumerate() {
            let own = size(triangle);
            if left < own || k == last {
                return inside(triangle, [(left / own).min(1.0), v]).into();
            }
            left -= own;
        }
        polygon[0]
    }

    /// The corners of what the points of one patch stand for.
    pub fn of<'a>(&'a self, &[a, b, c]: &'a [DVec3; 3]) -> impl Iterator<Item = impl Iterator<Item = DVec3> + 'a> + 'a {
        self.polygons.iter().map(move |polygon| polygon.iter().map(move |&[u, v, w]| u * a + v * b + w * c))
    }
}

/// The area of a triangle in barycentric coordinates, as a share of the patch.
fn size([a, b, c]: [[f64; 3]; 3]) -> f64 {
    let [ab, ac] = [b, c].map(|p| [p[0] - a[0], p[1] - a[1]]);
    ab[0] * ac[1] - ab[1] * ac[0]
}

/// What of a convex polygon is nearer to one point than to another, in the equilateral triangle.
fn nearer(polygon: &[[f64; 3]], to: [f64; 3], than: [f64; 3]) -> Vec<[f64; 3]> {
    let square = |p: [f64; 3]| p.iter().map(|x| x * x).sum::<f64>();
    let side = |p: [f64; 3]| (0..3).map(|i| 2.0 * (to[i] - than[i]) * p[i]).sum::<f64>() + square(than) - square(to);
    let mut found = Vec::new();
    for (i, &p) in polygon.iter().enumerate() {
        let q = polygon[(i + 1) % polygon.len()];
        let (here, there) = (side(p), side(q));
        if here >= 0.0 {
            found.push(p);
        }
        if here * there < 0.0 {
            let t = here / (here - there);
            found.push([0, 1, 2].map(|axis| p[axis] + t * (q[axis] - p[axis])));
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    const RULE: [[f64; 3]; 3] = [[2. / 3., 1. / 6., 1. / 6.], [1. / 6., 2. / 3., 1. / 6.], [1. / 6., 1. / 6., 2. / 3.]];
    const CORNERS: [DVec3; 3] = [DVec3::ZERO, DVec3::new(3.0, 0.0, 0.0), DVec3::new(1.0, 2.0, 0.0)];

    fn areas(portions: &Portions) -> Vec<f64> {
        let area = |corners: Vec<DVec3>| {
            let next = |i: usize| corners[(i + 1) % corners.len()];
            (0..corners.len()).map(|i| corners[i].cross(next(i)).z / 2.0).sum()
        };
        portions.of(&CORNERS).map(|corners| area(corners.collect())).collect()
    }

    #[test]
    fn one_point_stands_for_the_whole_patch() {
        assert_eq!(areas(&Portions::new(&[[1. / 3.; 3]])), [3.0]);
    }

    #[test]
    fn three_points_stand_for_a_third_each() {
        let portions = Portions::new(&RULE);
        let areas = areas(&portions);
        assert!(areas.iter().all(|area| (area - 1.0).abs() < 1e-12), "{areas:?}");
    }

    #[test]
    fn places_are_even_over_the_part_of_their_point() {
        let portions = Portions::new(&RULE);
        let count = 200;
        for (part, corners) in portions.of(&CORNERS).enumerate() {
            let corners: Vec<_> = corners.collect();
            let numbers =
                (0..count * count).map(|i| [i / count, i % count].map(|k| (f64::from(k) + 0.5) / f64::from(count)));
            let places: Vec<_> = numbers.map(|numbers| portions.place(part, numbers)).collect();
            let square = |p: &[f64; 3], q: &[f64; 3]| (0..3).map(|i| (p[i] - q[i]).powi(2)).sum::<f64>();
            for place in &places {
                let nearest = (0..3).min_by(|&i, &j| square(place, &RULE[i]).total_cmp(&square(place, &RULE[j])));
                assert_eq!(nearest, Some(part));
            }
            let [a, b, c] = CORNERS;
            let mean =
                places.iter().map(|[u, v, w]| *u * a + *v * b + *w * c).sum::<DVec3>() / f64::from(count * count);
            // The centroid of a polygon by its fan.
            let fan = corners[1..].windows(2).map(|side| (corners[0], side[0], side[1]));
            let weighed = fan.map(|(p, q, r)| ((q - p).cross(r - p).z, (p + q + r) / 3.0));
            let (area, sum) = weighed.fold((0.0, DVec3::ZERO), |(area, sum), (own, at)| (area + own, sum + own * at));
            assert!((mean - sum / area).length() < 1e-3);
        }
        assert_eq!(Portions::new(&[[1. / 3.; 3]]).place(0, [0.0, 0.3]), [1.0, 0.0, 0.0]);
    }

    #[test]
    fn portions_make_up_the_patch_and_have_few_corners() {
        let (a, b) = (0.470_142_064_105_115, 0.101_286_507_323_456);
        let orbit = |x: f64| [[x, x, 1.0 - 2.0 * x], [x, 1.0 - 2.0 * x, x], [1.0 - 2.0 * x, x, x]];
        let rule = [[[1. / 3.; 3]].as_slice(), &orbit(a), &orbit(b)].concat();
        let portions = Portions::new(&rule);
        assert_eq!(portions.len(), 7);
        assert!((areas(&portions).iter().sum::<f64>() - 3.0).abs() < 1e-12);
        // Clipping by a horizon adds one.
        assert!(portions.of(&CORNERS).all(|corners| corners.count() < MOST_CORNERS));
    }
}
