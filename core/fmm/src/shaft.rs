// SPDX-License-Identifier: GPL-3.0-or-later
//! Proof without rays that two boxes see each other as a whole: no triangle reaches into the shaft between them.
//! Haines and Wallace, "Shaft culling for efficient ray-cast radiosity", Eurographics Workshop on Rendering 1991.

use crate::moving::Bounds;
use crate::octree::Octree;
use crate::vector::{cross, dot, high, low, norm, scale, sub};
use rayon::prelude::*;

/// Rounding of coordinates, as a share of the largest.
const ROUNDING: f64 = 1e-9;
/// Triangles in a leaf of the hierarchy.
const LEAF: usize = 4;
/// Halves of so many triangles are made at the same time.
const MANY: usize = 4096;

type Vector = [f64; 3];

/// The triangles that can stand between two points, in a hierarchy of bounding boxes.
#[derive(Debug, Default)]
pub struct Blockers {
    triangles: Vec<Triangle>,
    nodes: Vec<Node>,
    /// Lengths below this are rounding, scene units.
    rounding: f64,
}

#[derive(Debug, Clone, Copy)]
struct Triangle {
    corners: [Vector; 3],
    normal: Vector,
    offset: f64,
}

#[derive(Debug, Clone, Copy)]
struct Node {
    low: Vector,
    high: Vector,
    /// Range of triangles; children follow their parent: the first at once, the second `second` nodes on, 0 for a leaf.
    start: u32,
    end: u32,
    second: u32,
}

/// A box of points as a shaft sees it.
#[derive(Debug, Clone, Copy)]
pub struct End {
    pub low: Vector,
    pub high: Vector,
    /// Normal and offset of the plane in which all points lie, where there is one: nothing behind it is seen from them.
    pub plane: Option<(Vector, f64)>,
}

impl Blockers {
    /// The triangles whose planes have points of the octrees on both sides; no other one can be between two points.
    pub fn new(triangles: &[[Vector; 3]], trees: [&Octree; 2]) -> Self {
        let largest = trees.iter().map(|tree| tree.grid.magnitude()).fold(0.0, f64::max);
        let rounding = ROUNDING * largest;
        let all: Vec<Triangle> = triangles.par_iter().filter_map(Triangle::new).collect();
        // Triangles of one wall share their plane, which is tested once.
        let mut keyed: Vec<([i64; 4], usize)> =
            all.par_iter().enumerate().map(|(i, triangle)| (triangle.plane_key(1e3 * rounding), i)).collect();
        keyed.par_sort_unstable();
        let planes: Vec<&[([i64; 4], usize)]> = keyed.chunk_by(|a, b| a.0 == b.0).collect();
        let parts = |plane: &[([i64; 4], usize)]| {
            let first = all[plane[0].1];
            let ahead = |sign: f64| {
                trees.iter().any(|tree| reaches(tree, scale(first.normal, sign), sign * first.offset, 1e3 * rounding))
            };
            ahead(1.0) && ahead(-1.0)
        };
        let mut kept: Vec<usize> = planes
            .par_iter()
            .filter(|plane| parts(plane))
            .flat_map_iter(|plane| plane.iter().map(|one| one.1))
            .collect();
        kept.par_sort_unstable();
        let mut triangles: Vec<Triangle> = kept.into_iter().map(|i| all[i]).collect();
        let mut nodes = Vec::new();
        if !triangles.is_empty() {
            add_nodes(&mut nodes, &mut triangles, 0);
        }
        Self { triangles, nodes, rounding }
    }

    pub fn len(&self) -> usize {
        self.triangles.len()
    }

    pub fn is_empty(&self) -> bool {
        self.triangles.is_empty()
    }

    /// Whether no triangle is in the way between any point of the one box and any of the other.
    pub fn are_clear(&self, a: &End, b: &End) -> bool {
        if self.nodes.is_empty() {
            return true;
        }
        let shaft = Shaft::new(a, b);
        let mut open = vec![0];
        while let Some(n) = open.pop() {
            let node = &self.nodes[n];
            if shaft.misses_box(node.low, node.high, self.rounding) {
                continue;
            }
            if node.second != 0 {
                open.extend([n + node.second as usize, n + 1]);
            } else {
                let triangles = &self.triangles[node.start as usize..node.end as usize];
                if triangles.iter().any(|triangle| shaft.may_hit(triangle, self.rounding)) {
                    return false;
                }
            }
        }
        true
    }
}

impl Triangle {
    /// None for a triangle without area.
    fn new(&corners: &[Vector; 3]) -> Option<Self> {
        let normal = cross(sub(corners[1], corners[0]), sub(corners[2], corners[0]));
        let length = norm(normal);
        let normal = scale(normal, 1.0 / length);
        (length > 0.0).then(|| Self { corners, normal, offset: dot(normal, corners[0]) })
    }

    /// The same for triangles of one plane, whichever way they face, up to rounding.
    fn plane_key(&self, rounding: f64) -> [i64; 4] {
        let leading = self.normal.into_iter().find(|x| x.abs() > 1e-6).unwrap_or(1.0).signum();
        let [x, y, z] = self.normal.map(|x| (leading * x * 1e6).round() as i64);
        [x, y, z, (leading * self.offset / rounding.max(f64::MIN_POSITIVE)).round() as i64]
    }
}

/// Adds the nodes of some triangles, the first of which is number `start`, and brings them into their order.
fn add_nodes(nodes: &mut Vec<Node>, part: &mut [Triangle], start: usize) {
    let corners = part.iter().flat_map(|triangle| triangle.corners);
    let (low, high) = corners.fold(([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]), |b, p| (low(b.0, p), high(b.1, p)));
    let (at, count) = (nodes.len(), part.len());
    nodes.push(Node { low, high, start: start as u32, end: (start + count) as u32, second: 0 });
    if count <= LEAF {
        return;
    }
    let size = sub(high, low);
    let axis = (0..3).fold(0, |best, i| if size[i] > size[best] { i } else { best });
    let key = |t: &Triangle| t.corners[0][axis] + t.corners[1][axis] + t.corners[2][axis];
    part.select_nth_unstable_by(count / 2, |a, b| key(a).total_cmp(&key(b)));
    let (first, second) = part.split_at_mut(count / 2);
    let mut behind = Vec::new();
    if count > MANY {
        rayon::join(|| add_nodes(nodes, first, start), || add_nodes(&mut behind, second, start + count / 2));
        nodes[at].second = (nodes.len() - at) as u32;
        nodes.append(&mut behind);
    } else {
        add_nodes(nodes, first, start);
        nodes[at].second = (nodes.len() - at) as u32;
        add_nodes(nodes, second, start + count / 2);
    }
}

/// Whether some point of a tree is more than `margin` beyond the plane.
fn reaches(tree: &Octree, normal: Vector, offset: f64, margin: f64) -> bool {
    let mut open: Vec<usize> = tree.roots().collect();
    while let Some(b) = open.pop() {
        let most: f64 = (0..3).map(|i| (normal[i] * tree.low[b][i]).max(normal[i] * tree.high[b][i])).sum();
        if most <= offset + margin {
            continue;
        }
        if tree.is_leaf(b) && tree.positions[tree.points_of(b)].iter().any(|&x| dot(normal, x) > offset + margin) {
            return true;
        }
        open.extend(tree.children(b));
    }
    false
}

/// The convex hull of two boxes, as the half spaces normal.x <= offset, besides the bounding box of both.
struct Shaft<'a> {
    a: &'a End,
    b: &'a End,
    low: Vector,
    high: Vector,
    sides: Vec<(Vector, f64)>,
}

impl<'a> Shaft<'a> {
    fn new(a: &'a End, b: &'a End) -> Self {
        let mut sides = Vec::with_capacity(12);
        for (u, v) in [(0, 1), (1, 2), (2, 0)] {
            for corner in 0..4 {
                // Projected along the third axis, the hull has an edge from a corner of the one to the same corner of the
                // other wherever its normal points to that corner.
                let up = (corner & 1 == 1, corner & 2 == 2);
                let of = |end: &End| {
                    let side = |axis: usize, up: bool| if up { end.high[axis] } else { end.low[axis] };
                    (side(u, up.0), side(v, up.1))
                };
                let (from, to) = (of(a), of(b));
                let along = (to.0 - from.0, to.1 - from.1);
                let signs = (if up.0 { 1.0 } else { -1.0 }, if up.1 { 1.0 } else { -1.0 });
                for n in [(along.1, -along.0), (-along.1, along.0)] {
                    if n.0 * signs.0 > 0.0 && n.1 * signs.1 > 0.0 {
                        let length = (n.0 * n.0 + n.1 * n.1).sqrt();
                        let mut normal = [0.0; 3];
                        (normal[u], normal[v]) = (n.0 / length, n.1 / length);
                        sides.push((normal, normal[u] * from.0 + normal[v] * from.1));
                    }
                }
            }
        }
        Self { a, b, low: low(a.low, b.low), high: high(a.high, b.high), sides }
    }

    fn misses_box(&self, low: Vector, high: Vector, rounding: f64) -> bool {
        (0..3).any(|i| low[i] > self.high[i] + rounding || high[i] < self.low[i] - rounding)
            || self.sides.iter().any(|&(n, offset)| {
                (0..3).map(|i| (n[i] * low[i]).min(n[i] * high[i])).sum::<f64>() > offset + rounding
            })
            || [self.a, self.b].into_iter().filter_map(|end| end.plane).any(|(n, offset)| {
                (0..3).map(|i| (n[i] * low[i]).max(n[i] * high[i])).sum::<f64>() <= offset + rounding
            })
    }

    /// Whether a triangle may be between the two boxes; false is certain.
    fn may_hit(&self, triangle: &Triangle, rounding: f64) -> bool {
        let corners = &triangle.corners;
        let all = |test: &dyn Fn(Vector) -> bool| corners.iter().all(|&x| test(x));
        let behind = |end: &End| end.plane.is_some_and(|(n, offset)| all(&|x| dot(n, x) <= offset + rounding));
        let beside =
            (0..3).any(|i| all(&|x| x[i] > self.high[i] + rounding) || all(&|x| x[i] < self.low[i] - rounding));
        let outside = || self.sides.iter().any(|&(n, offset)| all(&|x| dot(n, x) > offset + rounding));
        !beside && !behind(self.a) && !behind(self.b) && self.parted_by(triangle, rounding) && !outside()
    }

    /// Whether the plane of a triangle has points of the one box before it and points of the other behind it.
    fn parted_by(&self, triangle: &Triangle, rounding: f64) -> bool {
        let range = |end: &End| {
            let (n, mut least, mut most) = (triangle.normal, -triangle.offset, -triangle.offset);
            for i in 0..3 {
                least += (n[i] * end.low[i]).min(n[i] * end.high[i]);
                most += (n[i] * end.low[i]).max(n[i] * end.high[i]);
            }
            (least, most)
        };
        let (a, b) = (range(self.a), range(self.b));
        (a.1 > rounding && b.0 < -rounding) || (a.0 < -rounding && b.1 > rounding)
    }
}

/// Whether a way between some point of the one box and some of the other may pass through one of others.
pub fn pass(a: &End, b: &End, boxes: &[Bounds]) -> bool {
    !boxes.is_empty() && {
        let shaft = Shaft::new(a, b);
        boxes.iter().any(|&[low, high]| !shaft.misses_box(low, high, 0.0))
    }
}

impl End {
    /// What points are in, with so much around them, whichever way they look.
    pub fn around(points: &[Vector], margin: f64) -> Self {
        let start = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
        let (low, high) = points.iter().fold(start, |b, &x| (low(b.0, x), high(b.1, x)));
        Self { low: low.map(|x| x - margin), high: high.map(|x| x + margin), plane: None }
    }

    /// A box of an octree with normals.
    pub fn new(tree: &Octree, b: usize) -> Self {
        let cone = tree.cone[b];
        let flat = cone.sin == 0.0 && cone.cos > 0.0;
        // The plane of the lowest point: what is behind it is behind all of them.
        let offsets = tree.positions[tree.points_of(b)].iter().map(|&x| dot(cone.axis, x));
        let plane = flat.then(|| (cone.axis, offsets.fold(f64::INFINITY, f64::min)));
        Self { low: tree.low[b], high: tree.high[b], plane }
    }
}
