// SPDX-License-Identifier: GPL-3.0-or-later
//! Triangles that make up one mesh, and whether it is a room without openings.

use crate::vector::{cross, dot, high, low, sub};
use rstar::primitives::{GeomWithData, Rectangle};
use rstar::{AABB, RTree};
use rustc_hash::{FxBuildHasher, FxHashMap, FxHashSet};

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

/// The boxes around closed meshes that face inwards, but for those within the box of one that faces outwards, as in a wall
/// with two sides; from the numbers of their corners.
pub fn inward(corners: &[[u32; 3]], triangles: &[[Vector; 3]]) -> Vec<(Vector, Vector)> {
    let (mut inward, mut outward) = (Vec::new(), Vec::new());
    for mesh in parts(corners).values() {
        let part = || mesh.iter().map(|&i| &triangles[i]);
        let (least, most) = bounds(part());
        let cube = sub(most, least).into_iter().fold(0.0, f64::max).powi(3);
        if volume(part()) < -FLAT * cube { &mut inward } else { &mut outward }.push((least, most));
    }
    let within = |(least, most): (Vector, Vector), (low, high): (Vector, Vector)| {
        (0..3).all(|i| low[i] <= least[i] && high[i] >= most[i])
    };
    inward.retain(|&own| !outward.iter().any(|&other| within(own, other)));
    inward
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
        assert_eq!(inward(&[at(&body, 0.0, 1.0), at(&room(), 2.0, 0.5)]), [([2.0, 0.0, 0.0], [2.5, 0.5, 0.5])]);
        assert!(inward(&[at(&body, -0.1, 2.0), at(&room(), 0.0, 1.0)]).is_empty());
        let sheet: Vec<_> =
            [room(), body].concat().into_iter().filter(|t| t.iter().all(|corner| corner[2] == 0.0)).collect();
        assert!(inward(&[sheet]).is_empty());
    }
}
