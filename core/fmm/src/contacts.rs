// SPDX-License-Identifier: GPL-3.0-or-later
//! Where something stands on a triangle, goes through it or ends just above it, the light changes from one side to the
//! other: the triangle is cut along that line, so that no part of it stands for both sides.

use crate::cuts::{Cuts, Point, between, clip, clipped, distance, left_of, merged};
use crate::meshes::{PARALLEL, corners, meshes, rims, triangle_tree};
use crate::vector::{add, cross, dot, high, low, norm, scale, sub};
use rayon::prelude::*;
use rstar::AABB;

/// Distances below this share of the scene and of the triangle are rounding.
const ROUNDING: [f64; 2] = [1e-6, 1e-5];
/// What ends this share of the scene above a triangle stands on it as far as light is concerned.
const TOUCHING: f64 = 2e-4;
/// Lines whose lengths and places differ by less than this share of the triangle are alike.
const PLACE: f64 = 1e-6;
/// What its own mesh shares with a triangle along less than this share of it is a corner.
const CORNER: f64 = 0.01;
/// A triangle with more lines on it lies in a thicket, whose light is even: it is left whole.
const MOST_LINES: usize = 1000;
/// So many times as many pieces of lines are not even put together.
const MANY: usize = 4;

type Vector = [f64; 3];

/// Bisections of triangles, as [`crate::surface::Surface`] has them: the first T nodes are the triangles.
#[derive(Debug, Default, PartialEq)]
pub struct Contacts {
    /// (K,) edge at which a node is cut, -1 for a leaf.
    pub edges: Vec<i8>,
    /// (K,) where on that edge, as a share of it.
    pub fractions: Vec<f64>,
    /// (K, 2) the halves of a node, 0 for a leaf.
    pub parts: Vec<[u32; 2]>,
    /// (T,) whether something touches the triangle, be it at its rim, that is not a neighbour in its mesh.
    pub touched: Vec<bool>,
}

/// Cuts each triangle where others meet it that are no neighbours at an edge. Those of its mesh, which are joined by corners at
/// the same places, do where they are no farther away than rounding.
pub fn contacts(triangles: &[[Vector; 3]]) -> Contacts {
    let corners = corners(triangles);
    let meshes = meshes(&corners);
    let size = size(triangles);
    let (tree, rims) = (triangle_tree(triangles), rims(triangles, size));
    let cut = |i: usize| {
        let plane = Plane::new(&triangles[i])?;
        let slack = ROUNDING[0] * size + ROUNDING[1] * plane.longest();
        let touching = slack.max(TOUCHING * size);
        let envelope = AABB::from_corners(
            triangles[i].into_iter().reduce(low)?.map(|x| x - touching),
            triangles[i].into_iter().reduce(high)?.map(|x| x + touching),
        );
        let others = tree.locate_in_envelope_intersecting(&envelope).map(|other| other.data);
        let met: Vec<([Point; 2], bool)> = others
            .flat_map(|other| {
                if meshes[other] != meshes[i] {
                    return plane.lines(&triangles[other], rims[other], [touching, slack]);
                }
                let shared = corners[other].iter().filter(|corner| corners[i].contains(corner)).count();
                if shared > 1 { Vec::new() } else { plane.lines_of_own(&triangles[other], rims[other], slack) }
            })
            .collect();
        if met.len() > MANY * MOST_LINES {
            return Some(Cuts::default());
        }
        let in_order = |mut lines: Vec<[Point; 2]>| {
            lines.sort_by_cached_key(|&line| plane.place(line));
            lines
        };
        let lines = in_order(met.iter().filter(|(_, cuts)| *cuts).map(|(line, _)| *line).collect());
        let lines = in_order(merged(lines, slack));
        (!met.is_empty())
            .then(|| if lines.len() > MOST_LINES { Cuts::default() } else { Cuts::along(&lines, plane.corners, slack) })
    };
    collect((0..triangles.len()).into_par_iter().map(cut).collect())
}

/// Side of the cube whose corners are as far from its middle as the farthest corner is from the mean of all: unlike a bounding
/// box it does not change with a turn.
fn size(triangles: &[[Vector; 3]]) -> f64 {
    let corners = || triangles.iter().flatten();
    let mean = scale(corners().fold([0.0; 3], |sum, &x| add(sum, x)), 1.0 / (3 * triangles.len()).max(1) as f64);
    2.0 / 3f64.sqrt() * corners().map(|&x| norm(sub(x, mean))).fold(0.0, f64::max)
}

/// The trees of single triangles as one.
fn collect(cuts: Vec<Option<Cuts>>) -> Contacts {
    let count = cuts.len();
    let mut all = Contacts {
        edges: vec![-1; count],
        fractions: vec![0.5; count],
        parts: vec![[0; 2]; count],
        touched: cuts.iter().map(Option::is_some).collect(),
    };
    for (i, cut) in cuts.iter().enumerate() {
        let Some(Cuts { nodes }) = cut else { continue };
        // Node 0 is the triangle itself, the others follow all triangles.
        let first = all.edges.len() as u32;
        for (j, node) in nodes.iter().enumerate() {
            let parts = node.parts.map(|part| if part == 0 { 0 } else { first + part - 1 });
            if j == 0 {
                (all.edges[i], all.fractions[i], all.parts[i]) = (node.edge, node.fraction, parts);
            } else {
                all.edges.push(node.edge);
                all.fractions.push(node.fraction);
                all.parts.push(parts);
            }
        }
    }
    all
}

/// A triangle in its own plane: corners counter-clockwise in the coordinates of two axes from the first corner.
struct Plane {
    origin: Vector,
    axes: [Vector; 3],
    corners: [Point; 3],
}

impl Plane {
    fn new(&[a, b, c]: &[Vector; 3]) -> Option<Self> {
        let (along, normal) = (sub(b, a), cross(sub(b, a), sub(c, a)));
        let (length, area) = (norm(along), norm(normal));
        if !(length > 0.0 && area > 0.0) {
            return None;
        }
        let (x, z) = (scale(along, 1.0 / length), scale(normal, 1.0 / area));
        let axes = [x, cross(z, x), z];
        let corners = [a, b, c].map(|p| [dot(sub(p, a), axes[0]), dot(sub(p, a), axes[1])]);
        Some(Self { origin: a, axes, corners })
    }

    fn longest(&self) -> f64 {
        let [a, b, c] = self.corners;
        distance(a, b).max(distance(b, c)).max(distance(c, a))
    }

    /// What lines are cut along in the order of, the longest first: it depends neither on the order of the triangles nor on
    /// their place.
    fn place(&self, [p, q]: [Point; 2]) -> [i64; 4] {
        let steps = |length: f64| (length / self.longest() / PLACE).round() as i64;
        let middle = between(p, q, 0.5);
        let [a, b, c] = self.corners.map(|corner| steps(distance(middle, corner)));
        [-steps(distance(p, q)), a, b, c]
    }

    /// Where another triangle meets this one, and whether it is to be cut there: the line where it stands on it or goes
    /// through it, or what of its `rims` is over this one, if it lies on it. What is nearer than the first slack is on it, and
    /// within the second at an edge.
    fn lines(&self, other: &[Vector; 3], rims: [bool; 3], [touching, slack]: [f64; 2]) -> Vec<([Point; 2], bool)> {
        let local = other.map(|p| sub(p, self.origin));
        let over = local.map(|p| [dot(p, self.axes[0]), dot(p, self.axes[1])]);
        let cuts = |line| (line, true);
        let meets = |line: &[Point; 2]| clip(*line, &self.corners, -slack).is_some();
        if !local.iter().all(|&p| dot(p, self.axes[2]).abs() <= touching) {
            return self.line(other, touching).filter(meets).map(cuts).into_iter().collect();
        }
        let edges = (0..3).map(|i| [over[i], over[(i + 1) % 3]]);
        if !self.is_along(other) {
            let longest = edges.max_by(|a, b| distance(a[0], a[1]).total_cmp(&distance(b[0], b[1])));
            return longest.filter(meets).map(cuts).into_iter().collect();
        }
        // A strip along an edge is not worth a cut.
        let is_strip =
            |line| clipped(line, &self.corners, slack).is_some() && clipped(line, &self.corners, touching).is_none();
        let rim = |(i, line): (usize, [Point; 2])| {
            let over_this = rims[i] && self.is_beside(line, over[(i + 2) % 3], slack);
            over_this.then(|| (line, !is_strip(line)))
        };
        edges.enumerate().filter_map(rim).collect()
    }

    /// The same for a triangle of the same mesh: what both have in common is more than a corner.
    fn lines_of_own(&self, other: &[Vector; 3], rims: [bool; 3], slack: f64) -> Vec<([Point; 2], bool)> {
        let mut lines = self.lines(other, rims, [slack; 2]);
        lines.retain(|&(line, _)| {
            let along =
                clip(line, &self.corners, -slack).is_some_and(|[p, q]| distance(p, q) > CORNER * self.longest());
            along || clip(line, &self.corners, slack).is_some()
        });
        lines
    }

    /// Whether another triangle is turned by less than 60 degrees against this one.
    fn is_along(&self, other: &[Vector; 3]) -> bool {
        let normal = cross(sub(other[1], other[0]), sub(other[2], other[0]));
        dot(normal, self.axes[2]).abs() > 0.5 * norm(normal)
    }

    /// Whether the triangle is, within more than `slack` of a line, on the side where another point is.
    fn is_beside(&self, line: [Point; 2], point: Point, slack: f64) -> bool {
        let Some([p, q]) = clip(line, &self.corners, -slack) else { return false };
        let (middle, side) = (between(p, q, 0.5), left_of(line, point).signum());
        let [x, y] = [0, 1].map(|i| (line[1][i] - line[0][i]) / distance(line[0], line[1]));
        let inwards = [middle[0] - 3.0 * slack * side * y, middle[1] + 3.0 * slack * side * x];
        (0..3).all(|i| left_of([self.corners[i], self.corners[(i + 1) % 3]], inwards) > slack)
    }

    /// Where another triangle meets this plane, if that is a line; what is nearer than `slack` is on it.
    fn line(&self, other: &[Vector; 3], slack: f64) -> Option<[Point; 2]> {
        let local = other.map(|p| sub(p, self.origin));
        let mut heights = local.map(|p| dot(p, self.axes[2]));
        let misses = heights.iter().all(|&h| h > slack) || heights.iter().all(|&h| h < -slack);
        if misses {
            return None;
        }
        let normal = cross(sub(other[1], other[0]), sub(other[2], other[0]));
        if norm(cross(normal, self.axes[2])) < PARALLEL * norm(normal) {
            return None;
        }
        for height in heights.iter_mut().filter(|h| h.abs() <= slack) {
            *height = 0.0;
        }
        let mut ends = Vec::with_capacity(3);
        for i in 0..3 {
            let j = (i + 1) % 3;
            if heights[i] == 0.0 {
                ends.push(local[i]);
            } else if heights[i] * heights[j] < 0.0 {
                let t = heights[i] / (heights[i] - heights[j]);
                ends.push(add(scale(local[i], 1.0 - t), scale(local[j], t)));
            }
        }
        let mut flat = ends.into_iter().map(|p| [dot(p, self.axes[0]), dot(p, self.axes[1])]);
        let line = [flat.next()?, flat.next()?];
        (distance(line[0], line[1]) > slack).then_some(line)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const FLOOR: [Vector; 3] = [[0., 0., 0.], [4., 0., 0.], [0., 4., 0.]];

    fn leaves(contacts: &Contacts, triangle: usize, corners: [Vector; 3]) -> Vec<[Vector; 3]> {
        let Ok(edge) = usize::try_from(contacts.edges[triangle]) else { return vec![corners] };
        let [a, b, c] = [0, 1, 2].map(|i| corners[(edge + i) % 3]);
        let m = add(a, scale(sub(b, a), contacts.fractions[triangle]));
        let [first, second] = contacts.parts[triangle];
        let mut found = leaves(contacts, first as usize, [a, m, c]);
        found.extend(leaves(contacts, second as usize, [m, b, c]));
        found
    }

    fn area([a, b, c]: [Vector; 3]) -> f64 {
        0.5 * norm(cross(sub(b, a), sub(c, a)))
    }

    #[test]
    fn a_wall_on_a_floor_cuts_it() {
        let wall = [[1., -1., 0.], [1., 9., 0.], [1., 2., 3.]];
        let contacts = contacts(&[FLOOR, wall]);
        assert_eq!(contacts.touched, [true, true]);
        let parts = leaves(&contacts, 0, FLOOR);
        assert_eq!(parts.len(), 3);
        for part in parts {
            assert!(part.iter().all(|p| p[0] <= 1.0 + 1e-9) || part.iter().all(|p| p[0] >= 1.0 - 1e-9), "{part:?}");
        }
        assert_eq!(contacts.edges[1], -1, "the floor meets the wall at its rim only");
    }

    #[test]
    fn walls_close_to_each_other_cut_a_floor_alike_in_any_order() {
        let wall = |y: f64| [[1., y, 0.], [3., y, 0.], [2., y, 3.]];
        let cut = |walls: [f64; 2]| leaves(&contacts(&[FLOOR, wall(walls[0]), wall(walls[1])]), 0, FLOOR);
        let parts = cut([1e-4, 3e-4]);
        assert!(parts.len() > 3);
        assert_eq!(parts, cut([3e-4, 1e-4]));
    }

    #[test]
    fn what_touches_at_a_rim_or_not_at_all_cuts_nothing() {
        let at_the_rim = [[0., 0., 0.], [4., 0., 0.], [2., 0., 3.]].map(|p| add(p, [1e-9, 0.0, 0.0]));
        let above = [[1., -1., 0.1], [1., 9., 0.1], [1., 2., 3.]];
        let at_a_point = [[1., 1., 0.], [1., 2., 3.], [1., 1., 3.]];
        for other in [at_the_rim, above, at_a_point] {
            assert_eq!(contacts(&[FLOOR, other]).edges, [-1, -1]);
        }
        assert_eq!(contacts(&[FLOOR, at_the_rim]).touched, [true, true]);
        assert_eq!(contacts(&[FLOOR, above]).touched, [false, false]);
    }

    #[test]
    fn a_wall_in_the_mesh_of_its_floor_cuts_it_unless_they_share_an_edge() {
        let touched = |other: [Vector; 3]| {
            let contacts = contacts(&[FLOOR, other]);
            assert_eq!(contacts.edges[1], -1, "the floor meets the wall at its rim only");
            (contacts.edges[0] >= 0, contacts.touched)
        };
        let (origin, up) = ([0.; 3], [0., 0., 3.]);
        assert_eq!(touched([origin, [1., 1., 0.], up]), (true, vec![true; 2]));
        // Over a part of an edge, over all of it, and at a corner.
        assert_eq!(touched([origin, [3., 0., 0.], up]), (false, vec![true; 2]));
        assert_eq!(touched([origin, [4., 0., 0.], up]), (false, vec![false; 2]));
        assert_eq!(touched([origin, [-1., -2., 0.], up]), (false, vec![false; 2]));
        assert_eq!(touched([origin, [-1., -2., 1.], [-2., -1., -1.]]), (false, vec![false; 2]));
    }

    #[test]
    fn neighbours_in_a_mesh_do_not_touch() {
        let (n, cell) = (12, |i: usize| 1.0 + i as f64 / 12.0);
        let bent = |i: usize, j: usize| [cell(i), cell(j), 0.3 * (cell(i) * cell(j)).sin()];
        let mesh: Vec<[Vector; 3]> = (0..n * n)
            .flat_map(|k| {
                let (i, j) = (k / n, k % n);
                let [a, b, c, d] = [(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)].map(|(i, j)| bent(i, j));
                [[a, b, c], [a, c, d]]
            })
            .collect();
        assert_eq!(contacts(&mesh).touched, vec![false; mesh.len()]);
    }

    #[test]
    fn what_stands_just_above_a_floor_cuts_it_too() {
        let wall = [[1., -1., 4e-4], [1., 9., 4e-4], [1., 2., 3.]];
        assert_ne!(contacts(&[FLOOR, wall]).edges[0], -1);
    }

    /// A rug of n x n cells from 1 to 2, of heights by a function of both places.
    fn rug(n: usize, height: impl Fn(usize, usize) -> f64) -> Vec<[Vector; 3]> {
        let corner = |i: usize, j: usize| [1.0 + i as f64 / n as f64, 0.5 + j as f64 / n as f64, height(i, j)];
        let cell = |i: usize, j: usize| {
            let [a, b, c, d] = [corner(i, j), corner(i + 1, j), corner(i + 1, j + 1), corner(i, j + 1)];
            [[a, b, c], [a, c, d]]
        };
        (0..n * n).flat_map(|k| cell(k / n, k % n)).collect()
    }

    /// Parts of the floor that are under the rug and beside it at once.
    fn mixed(rug: &[[Vector; 3]]) -> usize {
        let contacts = contacts(&[&[FLOOR], rug].concat());
        let depth = |p: &Vector| (p[0] - 1.0).min(2.0 - p[0]).min(p[1] - 0.5).min(1.5 - p[1]);
        let places = || (0..=20).flat_map(|i| (0..=20 - i).map(move |j| [i as f64 / 20.0, j as f64 / 20.0]));
        let at = |&[a, b, c]: &[Vector; 3], [u, v]: [f64; 2]| add(scale(a, 1.0 - u - v), add(scale(b, u), scale(c, v)));
        let is_mixed = |part: &[Vector; 3]| {
            let depths = || places().map(|place| depth(&at(part, place)));
            depths().any(|d| d > 1e-3) && depths().any(|d| d < -1e-3)
        };
        leaves(&contacts, 0, FLOOR).iter().filter(|part| is_mixed(part)).count()
    }

    #[test]
    fn rugs_of_all_kinds_cut_the_floor() {
        let flat = rug(1, |_, _| 4e-4);
        assert_eq!(mixed(&rug(1, |_, _| 1e-2)), 1);
        assert_eq!(mixed(&flat), 0);
        assert_eq!(mixed(&rug(300, |_, _| 4e-4)), 0, "of many cells");
        assert_eq!(mixed(&rug(20, |i, j| 3e-4 + 2e-4 * ((i * 7 + j * 3) % 5) as f64 / 5.0)), 0, "uneven");
        let back: Vec<[Vector; 3]> = flat.iter().map(|&[a, b, c]| [a, c, b]).collect();
        assert_eq!(mixed(&[flat.clone(), back.clone()].concat()), 0, "of two faces back to back");
        let low: Vec<[Vector; 3]> = back.iter().map(|t| t.map(|p| [p[0], p[1], 1e-4])).collect();
        let rim = [[1.0, 0.5], [2.0, 0.5], [2.0, 1.5], [1.0, 1.5]];
        let sides = (0..4).flat_map(|i| {
            let ([a, b], [c, d]) = (rim[i], rim[(i + 1) % 4]);
            [[[a, b, 1e-4], [c, d, 1e-4], [c, d, 4e-4]], [[a, b, 1e-4], [c, d, 4e-4], [a, b, 4e-4]]]
        });
        assert_eq!(mixed(&[flat, low, sides.collect()].concat()), 0, "closed");
    }

    #[test]
    fn tiles_side_by_side_do_not_touch() {
        let beside = [[4., 0., 0.], [4., 4., 0.], [0., 4., 1e-9]];
        assert_eq!(contacts(&[FLOOR, beside]).touched, [false, false]);
        let under = FLOOR.map(|p| add(p, [0.0, 0.0, -1e-5]));
        assert_eq!(contacts(&[FLOOR, under]).touched, [true, true]);
        let shifted = under.map(|p| add(p, [1e-4, 1e-4, 0.0]));
        assert_eq!(contacts(&[FLOOR, shifted]).edges, [-1, -1]);
        assert_eq!(contacts(&[FLOOR, shifted]).touched, [true, true]);
    }

    #[test]
    fn neighbours_in_one_mesh_do_not_touch() {
        let folded = [[0., 0., 0.], [4., 0., 0.], [2., 0., 3.]];
        assert_eq!(contacts(&[FLOOR, folded]).touched, [false, false]);
    }

    #[test]
    fn degenerate_triangles_do_no_harm() {
        let point = [[1.0; 3]; 3];
        let needle = [[1., 1., -1.], [1., 1., 1.], [1., 1., 0.]];
        assert_eq!(contacts(&[FLOOR, point, needle]).edges, [-1; 3]);
        assert_eq!(contacts(&[]), Contacts::default());
    }

    proptest! {
        #[test]
        fn parts_make_up_the_triangle_and_no_line_is_inside_one(
            walls in proptest::collection::vec([-1.0..5.0f64, -1.0..5.0, -1.0..5.0, -1.0..5.0], 1..8)
        ) {
            let mut triangles = vec![FLOOR];
            triangles.extend(walls.iter().map(|&[a, b, c, d]| [[a, b, -1.0], [c, d, -1.0], [(a + c) / 2.0, (b + d) / 2.0, 1.0]]));
            let contacts = contacts(&triangles);
            let parts = leaves(&contacts, 0, FLOOR);
            let sum: f64 = parts.iter().map(|&part| area(part)).sum();
            prop_assert!((sum - 8.0).abs() < 1e-9);
            for part in parts {
                prop_assert!(cross(sub(part[1], part[0]), sub(part[2], part[0]))[2] >= -1e-9);
                for &[a, b, c, d] in &walls {
                    let (p, q) = ([(3.0 * a + c) / 4.0, (3.0 * b + d) / 4.0], [(3.0 * c + a) / 4.0, (3.0 * d + b) / 4.0]);
                    let flat = part.map(|corner| [corner[0], corner[1]]);
                    prop_assert!(area(part) < 1e-4 || clip([p, q], &flat, 1e-3).is_none(), "{part:?} {p:?} {q:?}");
                }
            }
        }
    }
}
