// SPDX-License-Identifier: GPL-3.0-or-later
//! From a point on an input triangle to the source that stands for it.

use crate::coincident::is_same;
use crate::error::{Error, same_length};
use crate::meshes::{PARALLEL, TriangleTree, triangle_tree};
use crate::vector::{cross, dot, high, low, norm, scale, sub};
use rstar::AABB;
use std::sync::OnceLock;

/// What a patch is followed by where there is nothing on its other side.
pub const NO_PATCH: u32 = u32::MAX;

/// How far before its place on a triangle a ray is taken to be, as a share of the edges: so much above single precision that
/// rays almost along what divides the triangle stay on their side.
const ROUNDED: f64 = 4e-5;
/// Sine of the angle to the normal below which a ray comes from no side: that of a direction in single precision is rounding.
const UPRIGHT: f64 = 1e-6;

/// The undivided triangles, each the root of a tree of bisections whose leaves are patches.
#[derive(Debug)]
pub struct Surface {
    /// (T, 3, 3)
    triangles: Vec<[[f64; 3]; 3]>,
    /// (T, 3) not unit.
    normals: Vec<[f64; 3]>,
    /// Finds triangles, made when it is first needed.
    tree: OnceLock<TriangleTree>,
    /// (T,) whether nothing in its place faces those who see its back, found when it is first needed.
    alone: Vec<OnceLock<bool>>,
    /// Surfaces no farther apart are in one place: which of them a ray meets is chance.
    slack: f64,
    /// (K,) edge at which a node is cut, from that corner to the next; -1 for a leaf. The first T nodes are the triangles.
    edges: Vec<i8>,
    /// (K,) where on that edge, as a share of it.
    fractions: Vec<f64>,
    /// (K,) the halves of a node; for a leaf the patches at its front and at its back, or [`NO_PATCH`].
    parts: Vec<[u32; 2]>,
    /// (points_per_patch, 3) barycentric coordinates of the sources on a patch.
    rule: Vec<[f64; 3]>,
    /// (N,) which sources something that emits hides, in the same place.
    hidden: Vec<bool>,
}

impl Surface {
    /// See the fields.
    pub fn new(
        triangles: &[[[f64; 3]; 3]],
        edges: &[i8],
        fractions: &[f64],
        parts: &[[u32; 2]],
        rule: &[[f64; 3]],
        hidden: &[bool],
        slack: f64,
    ) -> Result<Self, Error> {
        let patches = hidden.len() / rule.len().max(1);
        same_length("hidden sources", patches * rule.len(), hidden.len())?;
        same_length("bisection parts", edges.len(), parts.len())?;
        same_length("bisection fractions", edges.len(), fractions.len())?;
        if edges.len() < triangles.len() {
            return Err(Error::Length { what: "bisection", expected: triangles.len(), found: edges.len() });
        }
        for (node, (&edge, part)) in edges.iter().zip(parts).enumerate() {
            // Halves come after their whole, so that every descent ends.
            let bad = |&&p: &&u32| match edge {
                0..=2 => p as usize <= node || p as usize >= edges.len(),
                _ => p != NO_PATCH && p as usize >= patches,
            };
            if let Some(&wrong) = part.iter().find(bad) {
                let count = if edge < 0 { patches } else { edges.len() };
                return Err(Error::Index { what: "bisection part", index: wrong as usize, count });
            }
        }
        let normals = triangles.iter().map(|t| cross(sub(t[1], t[0]), sub(t[2], t[0]))).collect();
        let (edges, fractions) = (edges.to_vec(), fractions.to_vec());
        Ok(Self {
            triangles: triangles.to_vec(),
            normals,
            tree: OnceLock::new(),
            alone: vec![OnceLock::new(); triangles.len()],
            slack,
            edges,
            fractions,
            parts: parts.to_vec(),
            rule: rule.to_vec(),
            hidden: hidden.to_vec(),
        })
    }

    /// The source (scene order) that a ray meets on a triangle, -1 for none; none behind a surface that has only a front.
    pub fn met(&self, triangle: i32, (u, v): (f32, f32), direction: [f32; 3]) -> Option<u32> {
        let triangle = u32::try_from(triangle).ok()?;
        let direction = direction.map(f64::from);
        let front = dot(*self.normals.get(triangle as usize)?, direction) < 0.0;
        let place = self.before(triangle as usize, (f64::from(u), f64::from(v)), direction);
        let met = self.source(triangle, place, front);
        match met {
            Some(source) if !self.hidden[source as usize] => met,
            None if front || self.is_alone(triangle as usize) => None,
            _ => self.in_front(triangle, place, front).or(met),
        }
    }

    /// Whether nothing in the place of a triangle faces those who see its back.
    fn is_alone(&self, triangle: usize) -> bool {
        *self.alone[triangle].get_or_init(|| {
            let ([a, b, c], n) = (self.triangles[triangle], self.normals[triangle]);
            let slack = self.slack_of(triangle);
            let around =
                AABB::from_corners(low(low(a, b), c).map(|x| x - slack), high(high(a, b), c).map(|x| x + slack));
            let faces = |i: usize| {
                let parallel = norm(cross(n, self.normals[i])) <= PARALLEL * norm(n) * norm(self.normals[i]);
                parallel && (dot(n, self.normals[i]) <= 0.0 || self.is_two_sided(i))
            };
            let mut near = self.tree().locate_in_envelope_intersecting(&around);
            !near.any(|found| found.data != triangle && faces(found.data))
        })
    }

    /// The source that faces a ray in the same place as a side of a triangle that has none, or a hidden one.
    fn in_front(&self, triangle: u32, place: (f64, f64), front: bool) -> Option<u32> {
        let (x, n) = (self.point(triangle as usize, place), self.normals[triangle as usize]);
        let towards = scale(n, if front { 1.0 } else { -1.0 } / norm(n));
        let slack = self.slack_of(triangle as usize);
        let around = AABB::from_corners(x.map(|c| c - slack), x.map(|c| c + slack));
        let source = |i: usize| {
            let (corners, n) = (&self.triangles[i], self.normals[i]);
            let [a, b, c] = *corners;
            let to = sub(x, a);
            let [u, v] = [cross(to, sub(c, a)), cross(sub(b, a), to)].map(|part| dot(part, n) / dot(n, n));
            let here = is_same(x, towards, corners, true, [self.slack, slack]);
            let found = if here { self.source(i as u32, (u, v), dot(n, towards) > 0.0) } else { None };
            found.filter(|&source| !self.hidden[source as usize])
        };
        self.tree().locate_in_envelope_intersecting(&around).find_map(|found| source(found.data))
    }

    fn tree(&self) -> &TriangleTree {
        self.tree.get_or_init(|| triangle_tree(&self.triangles))
    }

    /// What is no farther from where a ray meets a triangle is in one place with it, by all that is known of that.
    fn slack_of(&self, triangle: usize) -> f64 {
        let [a, b, c] = self.triangles[triangle];
        self.slack + ROUNDED * norm(sub(b, a)).max(norm(sub(c, a)))
    }

    /// Whether a triangle has patches at its back: its parts have, or none.
    fn is_two_sided(&self, triangle: usize) -> bool {
        let mut node = triangle;
        while self.edges[node] >= 0 {
            node = self.parts[node][0] as usize;
        }
        self.parts[node][1] != NO_PATCH
    }

    fn point(&self, triangle: usize, (u, v): (f64, f64)) -> [f64; 3] {
        let [a, b, c] = self.triangles[triangle];
        [0, 1, 2].map(|i| (1.0 - u - v) * a[i] + u * b[i] + v * c[i])
    }

    /// The place on a divided triangle that a ray came over just before it met it: places are rounded, and where another
    /// surface divides the triangle rounding must not put it on the far side.
    fn before(&self, triangle: usize, (u, v): (f64, f64), direction: [f64; 3]) -> (f64, f64) {
        let n = self.normals[triangle];
        if self.edges[triangle] < 0 || norm(cross(n, direction)) < UPRIGHT * norm(n) * norm(direction) {
            return (u, v);
        }
        let [a, b, c] = self.triangles[triangle];
        let (e, f) = (sub(b, a), sub(c, a));
        let (ee, ef, ff) = (dot(e, e), dot(e, f), dot(f, f));
        let (de, df) = (dot(direction, e), dot(direction, f));
        let along = [ff * de - ef * df, ee * df - ef * de];
        let step = ROUNDED / along[0].abs().max(along[1].abs());
        if !step.is_finite() {
            return (u, v);
        }
        let (u, v) = ((u - step * along[0]).max(0.0), (v - step * along[1]).max(0.0));
        let beyond = (u + v).max(1.0);
        (u / beyond, v / beyond)
    }

    /// The point of a triangle, none for -1.
    pub fn place(&self, triangle: i32, (u, v): (f32, f32)) -> Option<[f64; 3]> {
        let triangle = usize::try_from(triangle).ok().filter(|&i| i < self.triangles.len())?;
        Some(self.point(triangle, (f64::from(u), f64::from(v))))
    }

    /// The unit normal of the side of a triangle that a ray comes to, none for -1.
    pub fn side(&self, triangle: i32, direction: [f32; 3]) -> Option<[f64; 3]> {
        let normal = *self.normals.get(usize::try_from(triangle).ok()?)?;
        let length = dot(normal, normal).sqrt();
        let towards = if dot(normal, direction.map(f64::from)) > 0.0 { -length } else { length };
        Some(normal.map(|x| x / towards))
    }

    /// The source (scene order) nearest to a point of a triangle, at its front or at its back; u and v weigh its second and
    /// third corner.
    pub fn source(&self, triangle: u32, (u, v): (f64, f64), front: bool) -> Option<u32> {
        let mut weights = [1.0 - u - v, u, v];
        let mut node = triangle as usize;
        while let Ok(edge) = usize::try_from(self.edges[node]) {
            let [a, b, c] = [0, 1, 2].map(|i| weights[(edge + i) % 3]);
            let (t, rest) = (self.fractions[node], 1.0 - self.fractions[node]);
            let second = b * rest > a * t;
            // With m = rest a + t b the halves are (a, m, c) and (m, b, c).
            weights = if second { [a / rest, b - a * t / rest, c] } else { [a - b * rest / t, b / t, c] };
            node = self.parts[node][usize::from(second)] as usize;
        }
        let patch = self.parts[node][usize::from(!front)];
        if !front {
            // Patches at the back have their second and third corner exchanged.
            weights.swap(1, 2);
        }
        let distance = |rule: &[f64; 3]| -> f64 { rule.iter().zip(weights).map(|(r, w)| (r - w).powi(2)).sum() };
        let nearest =
            (0..self.rule.len()).min_by(|&i, &j| distance(&self.rule[i]).total_cmp(&distance(&self.rule[j])))?;
        (patch != NO_PATCH).then(|| patch * self.rule.len() as u32 + nearest as u32)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const CORNERS: [[f64; 3]; 3] = [[0., 0., 0.], [1., 0., 0.], [0., 1., 0.]];

    fn point(corners: [[f64; 3]; 3], weights: [f64; 3]) -> [f64; 3] {
        [0, 1, 2].map(|i| (0..3).map(|k| weights[k] * corners[k][i]).sum())
    }

    type Bisected = (Vec<i8>, Vec<[u32; 2]>, Vec<[[f64; 3]; 3]>);

    /// Cuts the triangle at edges 1, 0, 2, ...: every node of one level at the same edge.
    fn cut(depth: usize) -> Bisected {
        let (mut edges, mut parts, mut patches) = (Vec::new(), Vec::new(), Vec::new());
        let mut level = vec![CORNERS];
        let mut node = 0;
        for step in 0..=depth {
            let mut below = Vec::new();
            for &corners in &level {
                if step == depth {
                    edges.push(-1);
                    parts.push([patches.len() as u32, NO_PATCH]);
                    patches.push(corners);
                    continue;
                }
                let edge = (2 * step + 1) % 3;
                let [a, b, c] = [0, 1, 2].map(|i| corners[(edge + i) % 3]);
                let m = point([a, b, c], [0.5, 0.5, 0.0]);
                edges.push(edge as i8);
                let first = (node + level.len() + below.len()) as u32;
                parts.push([first, first + 1]);
                below.extend([[a, m, c], [m, b, c]]);
            }
            node += level.len();
            level = below;
        }
        (edges, parts, patches)
    }

    proptest! {
        #[test]
        fn a_point_is_in_the_patch_that_is_found(depth in 0usize..6, u in 0.0..1.0f64, v in 0.0..1.0f64) {
            let (u, v) = if u + v > 1.0 { (1.0 - u, 1.0 - v) } else { (u, v) };
            let (edges, parts, patches) = cut(depth);
            let third = [[1.0 / 3.0; 3]];
            let (fractions, hidden) = (vec![0.5; edges.len()], vec![false; patches.len()]);
            let surface = Surface::new(&[CORNERS], &edges, &fractions, &parts, &third, &hidden, 1e-6).unwrap();
            let [a, b, c] = patches[surface.source(0, (u, v), true).unwrap() as usize];
            let x = point(CORNERS, [1.0 - u - v, u, v]);
            let area = |p: [f64; 3], q: [f64; 3], r: [f64; 3]| cross(sub(q, p), sub(r, p))[2];
            let inside = [area(a, b, x), area(b, c, x), area(c, a, x)];
            prop_assert!(inside.iter().all(|&part| part >= -1e-9 * area(a, b, c)), "{inside:?}");
            prop_assert_eq!(surface.source(0, (u, v), false), None);
        }
    }

    #[test]
    fn the_nearest_quadrature_point_stands_for_a_point_on_either_side() {
        let rule = [[2. / 3., 1. / 6., 1. / 6.], [1. / 6., 2. / 3., 1. / 6.], [1. / 6., 1. / 6., 2. / 3.]];
        let surface = Surface::new(&[CORNERS], &[-1], &[0.5], &[[0, 1]], &rule, &[false; 6], 1e-6).unwrap();
        assert_eq!(surface.source(0, (0.1, 0.1), true), Some(0));
        assert_eq!(surface.source(0, (0.8, 0.1), true), Some(1));
        assert_eq!(surface.source(0, (0.8, 0.1), false), Some(5));
    }

    proptest! {
        #[test]
        fn nothing_is_in_the_place_of_what_is_alone(
            corners in proptest::collection::vec(prop::array::uniform3(prop::array::uniform3(0..3u8)), 2..8),
            sides in prop::array::uniform8(any::<bool>()), lift in 0.0..2e-6f64, u in 0.0..1.0f64, v in 0.0..1.0f64,
        ) {
            // On a small lattice many are in one plane, and some in one place but for a lift.
            let triangles: Vec<_> = corners
                .iter()
                .zip(0..)
                .map(|(t, i)| t.map(|p| [p[0].into(), p[1].into(), f64::from(p[2] / 2) + lift * f64::from(i)]))
                .collect();
            let count = triangles.len() as u32;
            let parts: Vec<_> = (0..count).zip(sides).map(|(i, two)| [i, if two { count + i } else { NO_PATCH }]).collect();
            let (edges, fractions, hidden) = (vec![-1; parts.len()], vec![0.5; parts.len()], vec![false; 2 * parts.len()]);
            let surface = Surface::new(&triangles, &edges, &fractions, &parts, &[[1. / 3.; 3]], &hidden, 1e-6).unwrap();
            let place = if u + v > 1.0 { (1.0 - u, 1.0 - v) } else { (u, v) };
            for i in (0..count).filter(|&i| !sides[i as usize] && norm(surface.normals[i as usize]) > 0.0) {
                if surface.is_alone(i as usize) {
                    prop_assert_eq!(surface.in_front(i, place, false), None);
                }
            }
        }
    }

    #[test]
    fn a_triangle_of_a_closed_mesh_is_alone_unless_another_looks_at_its_back() {
        let [a, b, c] = CORNERS;
        let faces = [[a, c, b], [a, b, [0., 0., 1.]], [b, c, [0., 0., 1.]], [c, a, [0., 0., 1.]]];
        let alone = |triangles: &[[[f64; 3]; 3]]| {
            let n = triangles.len();
            let parts: Vec<_> = (0..n as u32).map(|i| [i, NO_PATCH]).collect();
            let (edges, fractions, hidden) = (vec![-1; n], vec![0.5; n], vec![false; n]);
            let surface = Surface::new(triangles, &edges, &fractions, &parts, &[[1. / 3.; 3]], &hidden, 1e-6).unwrap();
            (0..n).map(|i| surface.is_alone(i)).collect::<Vec<_>>()
        };
        assert_eq!(alone(&faces), [true; 4]);
        assert_eq!(alone(&[&faces[..], &[[a, b, c]]].concat()), [false, true, true, true, false]);
    }

    #[test]
    fn of_two_triangles_at_one_place_the_one_that_faces_the_ray_is_met() {
        let [a, b, c] = CORNERS;
        let rule = [[2. / 3., 1. / 6., 1. / 6.], [1. / 6., 2. / 3., 1. / 6.], [1. / 6., 1. / 6., 2. / 3.]];
        let surface = Surface::new(
            &[[a, b, c], [c, b, a]],
            &[-1, -1],
            &[0.5; 2],
            &[[0, NO_PATCH], [1, NO_PATCH]],
            &rule,
            &[false; 6],
            1e-6,
        )
        .unwrap();
        let down = [0.0, 0.0, -1.0];
        // Near corner b, from above: on the front of the first, whichever of the two is hit.
        assert_eq!(surface.met(0, (0.9, 0.05), down), Some(1));
        assert_eq!(surface.met(1, (0.9, 0.05), down), Some(1));
        assert_eq!(surface.met(0, (0.05, 0.9), down.map(|x| -x)), Some(3));
    }

    #[test]
    fn a_ray_meets_what_hides_another_in_the_same_place_from_whichever_side_it_faces() {
        let ([a, b, c], down) = (CORNERS, [0.0, 0.0, -1.0]);
        let (rule, hidden) = ([[1. / 3.; 3]], [true, false, false]);
        for (lamp, parts) in [([a, b, c], [1, NO_PATCH]), ([a, c, b], [2, 1])] {
            let surface =
                Surface::new(&[[a, b, c], lamp], &[-1, -1], &[0.5; 2], &[[0, NO_PATCH], parts], &rule, &hidden, 1e-6)
                    .unwrap();
            assert_eq!(surface.met(0, (0.2, 0.3), down), Some(1));
            assert_eq!(surface.met(1, (0.2, 0.3), down), Some(1));
        }
        let far = CORNERS.map(|p| [p[0], p[1], 1.0]);
        let surface = Surface::new(
            &[[a, b, c], far],
            &[-1, -1],
            &[0.5; 2],
            &[[0, NO_PATCH], [1, NO_PATCH]],
            &rule,
            &hidden[..2],
            1e-6,
        )
        .unwrap();
        assert_eq!(surface.met(0, (0.2, 0.3), down), Some(0));
    }

    #[test]
    fn a_ray_comes_to_the_side_that_looks_at_it() {
        let surface = Surface::new(&[CORNERS], &[-1], &[0.5], &[[0, 1]], &[[1. / 3.; 3]], &[false; 2], 1e-6).unwrap();
        assert_eq!(surface.side(0, [0.1, 0.0, -2.0]), Some([0.0, 0.0, 1.0]));
        assert_eq!(surface.side(0, [0.1, 0.0, 2.0]).map(|side| side[2]), Some(-1.0));
        assert_eq!(surface.side(-1, [0.0, 0.0, 1.0]), None);
    }

    #[test]
    fn a_cycle_and_a_patch_that_is_not_there_are_refused() {
        let rule = [[1. / 3.; 3]];
        assert!(Surface::new(&[CORNERS], &[0], &[0.5], &[[0, 0]], &rule, &[false], 1e-6).is_err());
        assert!(Surface::new(&[CORNERS], &[-1], &[0.5], &[[1, NO_PATCH]], &rule, &[false], 1e-6).is_err());
    }
}
