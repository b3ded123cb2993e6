// SPDX-License-Identifier: GPL-3.0-or-later
//! Planes of triangles, and whether points lie on both sides of them: a triangle that has none is in nobody's way.

use crate::vector::{add, cross, dot, high, low, norm, scale, sub};
use rayon::prelude::*;
use rustc_hash::FxHashSet;

/// Points that are passed over together where their box says on which side they are, and boxes that are.
const BOX: usize = 16;
/// Planes that differ by less, in unit normals and in sizes of the scene, are the same.
const SAME: f64 = 1e-9;

type Vector = [f64; 3];
/// Centre and half of the sides.
type Bounds = (Vector, Vector);

/// The plane normal.x = offset, and whether some point is more than a margin below and above it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Plane {
    pub normal: Vector,
    pub offset: f64,
    pub below: bool,
    pub above: bool,
}

/// Each different plane of triangles in a scene of this size, in their order, with `margin` in the same unit; None where
/// they are more than `most`.
pub fn planes(triangles: &[[Vector; 3]], points: &[Vector], size: f64, margin: f64, most: usize) -> Option<Vec<Plane>> {
    let mut planes = different(triangles, size, most)?;
    let boxed = |part| Boxed { bounds: bounds(part), parts: part.chunks(BOX).map(|few| (bounds(few), few)).collect() };
    let boxes: Vec<Boxed> = points.par_chunks(BOX * BOX).map(boxed).collect();
    planes.par_iter_mut().for_each(|plane| plane.find_sides(&boxes, margin));
    Some(planes)
}

fn different(triangles: &[[Vector; 3]], size: f64, most: usize) -> Option<Vec<Plane>> {
    let (mut planes, mut known) = (Vec::new(), FxHashSet::default());
    for &[a, b, c] in triangles {
        let normal = cross(sub(b, a), sub(c, a));
        let normal = scale(normal, 1.0 / norm(normal));
        let offset = dot(normal, a);
        let [x, y, z] = normal.map(|x| (x / SAME).round() as i64);
        if known.insert([x, y, z, (offset / (SAME * size)).round() as i64]) {
            planes.push(Plane { normal, offset, below: false, above: false });
        }
        if planes.len() > most {
            return None;
        }
    }
    Some(planes)
}

/// Points in boxes in a box.
struct Boxed<'a> {
    bounds: Bounds,
    parts: Vec<(Bounds, &'a [Vector])>,
}

impl Plane {
    fn find_sides(&mut self, boxes: &[Boxed], margin: f64) {
        for boxed in boxes {
            if !self.may_change(boxed.bounds, margin) {
                continue;
            }
            for (bounds, points) in &boxed.parts {
                if self.may_change(*bounds, margin) {
                    for &x in *points {
                        let height = dot(self.normal, x) - self.offset;
                        (self.below, self.above) = (self.below || height < -margin, self.above || height > margin);
                    }
                }
            }
            if self.below && self.above {
                return;
            }
        }
    }

    /// Whether points in a box may lie on a side where none were found so far.
    fn may_change(&self, (centre, half): Bounds, margin: f64) -> bool {
        let (middle, reach) = (dot(self.normal, centre) - self.offset, dot(self.normal.map(f64::abs), half));
        (!self.below && middle - reach < -margin) || (!self.above && middle + reach > margin)
    }
}

fn bounds(points: &[Vector]) -> Bounds {
    let none = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
    let (least, most) = points.iter().fold(none, |(least, most), &x| (low(least, x), high(most, x)));
    (scale(add(least, most), 0.5), scale(sub(most, least), 0.5))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn corner() -> impl Strategy<Value = Vector> {
        prop::array::uniform3(-1.0..1.0)
    }

    proptest! {
        #[test]
        fn sides_are_those_of_all_points(
            triangle in prop::array::uniform3(corner()),
            points in prop::collection::vec(corner(), 1..300),
            margin in 0.0..1.0,
        ) {
            let [a, b, c] = triangle;
            prop_assume!(norm(cross(sub(b, a), sub(c, a))) > 1e-3);
            let found = planes(&[triangle, triangle], &points, 1.0, margin, 1).unwrap_or_default();
            prop_assert_eq!(found.len(), 1);
            let heights = || points.iter().map(|&x| dot(found[0].normal, x) - found[0].offset);
            prop_assert_eq!(found[0].below, heights().any(|h| h < -margin));
            prop_assert_eq!(found[0].above, heights().any(|h| h > margin));
        }
    }

    #[test]
    fn both_sides_of_a_triangle_are_two_planes_and_more_are_not_asked() {
        let [a, b, c] = [[0., 0., 0.], [1., 0., 0.], [0., 1., 0.]];
        assert_eq!(planes(&[[a, b, c], [a, c, b]], &[a], 1.0, 0.0, 2).map(|planes| planes.len()), Some(2));
        assert_eq!(planes(&[[a, b, c], [a, c, b]], &[a], 1.0, 0.0, 1), None);
    }
}
