// SPDX-License-Identifier: GPL-3.0-or-later
//! Triangles that make up one mesh, and whether it is a room without openings.

use crate::vector::{cross, dot, high, low, norm, sub};
use rstar::primitives::{GeomWithData, Rectangle};
use rstar::{AABB, RTree};
use rustc_hash::{FxBuildHasher, FxHashMap, FxHashSet};
use std::f64::consts::PI;

/// Normals whose cross product is shorter lie in one plane.
pub(crate) const PARALLEL: f64 = 1e-3;

type Vector = [f64; 3];
type Place = [i64; 3];

/// Boxes that differ by less than this share of the scene are the same.
const ROUNDING: f64 = 1e-6;
/// Corners that differ by less than this share of the scene are one: their places are rounded.
const ONE_CORNER: f64 = 1e-10;
/// Corners that differ by less are the same at a rim.
const SAME_CORNER: f64 = 1e-9;
/// Places of a part that tell whether it lies in others.
const PROBES: usize = 9;
/// Meshes that hold less than this share of a cube around them have no inside.
const FLAT: f64 = 1e-6;

/// The mesh that each triangle belongs to, by its first triangle, from the numbers of their corners: those of one mesh are joined
/// by corners at the same places.
pub(crate) fn meshes(corners: &[[u32; 3]]) -> Vec<u32> {
    let mut sets = Sets::new(corners.len());
    let mut first = vec![u32::MAX; corners.as_flattened().iter().max().map_or(0, |&most| most as usize + 1)];
    for (triangle, i) in corners.iter().zip(0..) {
        for &corner in triangle {
            let other = std::mem::replace(&mut first[corner as usize], i).min(i);
            sets.join(i, other);
        }
    }
    sets.firsts()
}

/// Numbers of the corners of triangles: the same where the place is.
pub(crate) fn corners(triangles: &[[Vector; 3]]) -> Vec<[u32; 3]> {
    let (least, most) = bounds(triangles.iter());
    numbered(triangles, ONE_CORNER * sub(most, least).into_iter().fold(0.0, f64::max))
}

/// The same, where places are multiples of a length.
fn numbered(triangles: &[[Vector; 3]], step: f64) -> Vec<[u32; 3]> {
    let step = step.max(f64::MIN_POSITIVE);
    let place = |corner: &Vector| -> Place { corner.map(|x| (x / step).round() as i64) };
    let mut known = FxHashMap::with_capacity_and_hasher(triangles.len(), FxBuildHasher);
    let mut number = |corner: &Vector| {
        let next = known.len() as u32;
        *known.entry(place(corner)).or_insert(next)
    };
    triangles.iter().map(|[a, b, c]| [number(a), number(b), number(c)]).collect()
}

/// Which edges of triangles, from the first corner to the second and so on, belong to no other, but for those of the same
/// corners, in a scene of this size; corners that differ by rounding are in the same place.
pub(crate) fn rims(triangles: &[[Vector; 3]], size: f64) -> Vec<[bool; 3]> {
    let corners = numbered(triangles, SAME_CORNER * size);
    let edges =
        |&[a, b, c]: &[u32; 3]| [(a, b, c), (b, c, a), (c, a, b)].map(|(p, q, third)| ((p.min(q), p.max(q)), third));
    // The third corner of all triangles there, or none where these differ.
    let mut thirds = FxHashMap::with_capacity_and_hasher(3 * corners.len() / 2, FxBuildHasher);
    for (edge, third) in corners.iter().flat_map(edges) {
        let known = thirds.entry(edge).or_insert(Some(third));
        *known = known.filter(|&known| known == third);
    }
    corners.iter().map(|triangle| edges(triangle).map(|(edge, _)| thirds[&edge].is_some())).collect()
}

/// Numbers in sets that are joined bit by bit.
pub(crate) struct Sets(Vec<u32>);

impl Sets {
    /// Each number in a set of its own.
    pub fn new(count: usize) -> Self {
        Self((0..count as u32).collect())
    }

    pub fn join(&mut self, a: u32, b: u32) {
        let (a, b) = (self.first(a), self.first(b));
        self.0[a.max(b) as usize] = a.min(b);
    }

    /// The first number of the set of each one.
    pub fn firsts(mut self) -> Vec<u32> {
        (0..self.0.len() as u32).map(|i| self.first(i)).collect()
    }

    fn first(&mut self, mut i: u32) -> u32 {
        while self.0[i as usize] != i {
            self.0[i as usize] = self.0[self.0[i as usize] as usize];
            i = self.0[i as usize];
        }
        i
    }
}

/// Finds triangles by their bounding boxes.
pub(crate) type TriangleTree = RTree<GeomWithData<Rectangle<Vector>, usize>>;

pub(crate) fn triangle_tree(triangles: &[[Vector; 3]]) -> TriangleTree {
    let boxed = |(t, i): (&[Vector; 3], usize)| GeomWithData::new(Rectangle::from_aabb(AABB::from_points(t)), i);
    RTree::bulk_load(triangles.iter().zip(0..).map(boxed).collect())
}

/// Whether everything is inside a mesh that has no opening and faces inwards, so that nothing comes in from outside.
pub fn is_sealed(triangles: &[[Vector; 3]]) -> bool {
    let all = bounds(triangles.iter());
    let slack = ROUNDING * sub(all.1, all.0).into_iter().fold(0.0, f64::max);
    let corners = corners(triangles);
    parts(&corners).values().any(|mesh| {
        let part = || mesh.iter().map(|&i| &triangles[i]);
        let (least, most) = bounds(part());
        let holds_all = (0..3).all(|i| least[i] <= all.0[i] + slack && most[i] >= all.1[i] - slack);
        holds_all && is_closed(mesh.iter().map(|&i| corners[i])) && volume(part()) < 0.0
    })
}

/// Of closed parts of a mesh, the boxes around those that face inwards, but for the inner sides of others, as in a wall with
/// two sides; and whether any that faces outwards lies in another; from the numbers of their corners.
pub fn inward(corners: &[[u32; 3]], triangles: &[[Vector; 3]]) -> (Vec<(Vector, Vector)>, bool) {
    let parts: Vec<Vec<[Vector; 3]>> =
        parts(corners).into_values().map(|part| part.into_iter().map(|i| triangles[i]).collect()).collect();
    let boxes: Vec<(Vector, Vector)> = parts.iter().map(|part| bounds(part.iter())).collect();
    let boxed = |(&(least, most), i)| GeomWithData::new(Rectangle::from_corners(least, most), i);
    let tree: TriangleTree = RTree::bulk_load(boxes.iter().zip(0..).map(boxed).collect());
    let is_inside = |i: usize| {
        let step = parts[i].len().div_ceil(PROBES);
        let within = |triangle: &[Vector; 3]| {
            let place = [0, 1, 2].map(|axis| triangle.iter().map(|corner| corner[axis]).sum::<f64>() / 3.0);
            let others = tree.locate_all_at_point(&place).filter(|other| other.data != i);
            others.map(|other| winding(place, &parts[other.data])).sum::<f64>() > 0.5
        };
        let probes = || parts[i].iter().step_by(step);
        2 * probes().filter(|triangle| within(triangle)).count() > probes().count()
    };
    let (mut inward, mut nested) = (Vec::new(), false);
    for (i, &(least, most)) in boxes.iter().enumerate() {
        let cube = sub(most, least).into_iter().fold(0.0, f64::max).powi(3);
        match (volume(parts[i].iter()) < -FLAT * cube, is_inside(i)) {
            (true, false) => inward.push((least, most)),
            (false, inside) => nested |= inside,
            (true, true) => {}
        }
    }
    (inward, nested)
}

/// How many times closed triangles go around a place: 1 inside of what faces outwards. Van Oosterom and Strackee, IEEE
/// Trans. Biomed. Eng. 30 (1983), eq 8.
fn winding(place: Vector, triangles: &[[Vector; 3]]) -> f64 {
    let solid_angle = |triangle: &[Vector; 3]| {
        let [a, b, c] = triangle.map(|corner| sub(corner, place));
        let [x, y, z] = [a, b, c].map(norm);
        let below = x * y * z + dot(a, b) * z + dot(b, c) * x + dot(c, a) * y;
        2.0 * dot(a, cross(b, c)).atan2(below)
    };
    triangles.iter().map(solid_angle).sum::<f64>() / (4.0 * PI)
}

/// The triangles of each mesh, from the numbers of their corners.
fn parts(corners: &[[u32; 3]]) -> FxHashMap<u32, Vec<usize>> {
    let mut parts: FxHashMap<u32, Vec<usize>> = FxHashMap::default();
    for (mesh, i) in meshes(corners).into_iter().zip(0..) {
        parts.entry(mesh).or_default().push(i);
    }
    parts
}

fn bounds<'a>(triangles: impl Iterator<Item = &'a [Vector; 3]>) -> (Vector, Vector) {
    let none = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
    triangles.flatten().fold(none, |(least, most), &corner| (low(least, corner), high(most, corner)))
}

/// Whether each edge is shared by two triangles that run along it in opposite directions; by the numbers of their corners.
fn is_closed(mesh: impl ExactSizeIterator<Item = [u32; 3]> + Clone) -> bool {
    let mut edges = FxHashSet::with_capacity_and_hasher(3 * mesh.len(), FxBuildHasher);
    let mut ends = mesh.flat_map(|[a, b, c]| [(a, b), (b, c), (c, a)]);
    ends.clone().all(|edge| edges.insert(edge)) && ends.all(|(a, b)| edges.contains(&(b, a)))
}

/// What is inside triangles, cubic scene units; below 0 where they face inwards.
pub fn volume<'a>(mesh: impl Iterator<Item = &'a [Vector; 3]> + Clone) -> f64 {
    // Far away from the origin it would be lost in rounding.
    let Some([origin, ..]) = mesh.clone().next() else { return 0.0 };
    let six = |t: &[Vector; 3]| {
        let [a, b, c] = t.map(|corner| sub(corner, *origin));
        dot(a, cross(b, c))
    };
    mesh.map(six).sum::<f64>() / 6.0
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A tetrahedron that faces inwards.
    fn room() -> Vec<[Vector; 3]> {
        let [o, x, y, z] = [[0., 0., 0.], [1., 0., 0.], [0., 1., 0.], [0., 0., 1.]];
        vec![[o, x, y], [o, z, x], [o, y, z], [x, z, y]]
    }

    #[test]
    fn a_room_without_openings_is_sealed() {
        let mut scene = room();
        scene.push([[0.1, 0.1, 0.1], [0.2, 0.1, 0.1], [0.1, 0.2, 0.1]]);
        assert!(is_sealed(&scene));
        assert!(!is_sealed(&[]));
    }

    #[test]
    fn an_opening_an_outside_and_a_body_are_not() {
        assert!(!is_sealed(&room()[..3]));
        let mut outside = room();
        outside.push([[2., 0., 0.], [3., 0., 0.], [2., 1., 0.]]);
        assert!(!is_sealed(&outside));
        let body: Vec<_> = room().into_iter().map(|[a, b, c]| [a, c, b]).collect();
        assert!(!is_sealed(&body));
    }

    #[test]
    fn corners_that_differ_by_rounding_are_one() {
        let turned = |x: f64| [[x, 0.1, 0.2], [0.3, x, 0.7], [-0.0, 0.9, x]];
        let third = 1.0 / 3.0;
        let close = turned(third * (1.0 + f64::EPSILON));
        assert_ne!(turned(third), close);
        let found = corners(&[turned(third), close, turned(0.4)]);
        assert_eq!(found[0], found[1]);
        assert_eq!(meshes(&found), [0, 0, 2]);
    }

    #[test]
    fn rooms_face_inwards_but_for_those_in_a_thick_wall() {
        let at = |from: &[[Vector; 3]], x: f64, size: f64| -> Vec<_> {
            from.iter().map(|t| t.map(|[a, b, c]| [x + size * a, size * b, size * c])).collect()
        };
        let body: Vec<_> = room().into_iter().map(|[a, b, c]| [a, c, b]).collect();
        let inward = |parts: &[Vec<[Vector; 3]>]| {
            let triangles = parts.concat();
            inward(&corners(&triangles), &triangles)
        };
        let box_at = |x: f64, size: f64| ([x, 0.0, 0.0], [x + size, size, size]);
        assert_eq!(inward(&[at(&body, 0.0, 1.0), at(&room(), 2.0, 0.5)]), (vec![box_at(2.0, 0.5)], false));
        let inner = at(&room(), 0.0, 1.0).iter().map(|t| t.map(|c| c.map(|x| x + 0.1))).collect();
        let wall = [at(&body, 0.0, 2.0), inner];
        assert_eq!(inward(&wall), (vec![], false));
        let things = |from: &[[Vector; 3]]| at(from, 0.0, 0.2).iter().map(|t| t.map(|c| c.map(|x| x + 0.2))).collect();
        let [wall, inner] = wall;
        let found = inward(&[wall.clone(), inner.clone(), things(&room())]);
        assert_eq!(found.0.len(), 1, "turned over in a room with thick walls");
        assert_eq!(inward(&[wall.clone(), inner, things(&body)]), (vec![], false), "in a room with thick walls");
        assert_eq!(inward(&[wall, things(&body)]), (vec![], true), "in a room that faces outwards");
        let sheet: Vec<_> =
            [room(), body].concat().into_iter().filter(|t| t.iter().all(|corner| corner[2] == 0.0)).collect();
        assert_eq!(inward(&[sheet]), (vec![], false));
    }
}
