// SPDX-License-Identifier: GPL-3.0-or-later
//! Surfaces in the same place, which share what light arrives there.

use crate::error::{Error, same_length};
use crate::meshes::{PARALLEL, triangle_tree};
use crate::vector::{cross, dot, norm, scale, sub};
use rayon::prelude::*;
use rstar::AABB;

type Vector = [f64; 3];

/// How many sides of triangles (T, 3, 3) each point (N, 3) of them lies on that face as its unit normal does, at least 1;
/// what is not farther than `slack` is in the same place.
pub fn coincident(
    points: &[Vector],
    normals: &[Vector],
    triangles: &[[Vector; 3]],
    two_sided: &[bool],
    slack: f64,
) -> Result<Vec<u32>, Error> {
    same_length("normals", points.len(), normals.len())?;
    same_length("sides", triangles.len(), two_sided.len())?;
    let tree = triangle_tree(triangles);
    let count = |(&x, &n): (&Vector, &Vector)| {
        let around = AABB::from_corners(x.map(|c| c - slack), x.map(|c| c + slack));
        let here = tree.locate_in_envelope_intersecting(&around).map(|found| found.data);
        here.filter(|&i| is_same(x, n, &triangles[i], two_sided[i], slack)).count().max(1) as u32
    };
    Ok(points.par_iter().zip(normals).map(count).collect())
}

fn normal(&[a, b, c]: &[Vector; 3]) -> Vector {
    let n = cross(sub(b, a), sub(c, a));
    scale(n, 1.0 / norm(n).max(f64::MIN_POSITIVE))
}

/// Whether a side of a triangle faces as a unit normal does, and is no farther from a point than `slack`, across or along.
fn is_same(x: Vector, n: Vector, triangle: &[Vector; 3], two_sided: bool, slack: f64) -> bool {
    let other = normal(triangle);
    let inside = |i: usize| {
        let edge = sub(triangle[(i + 1) % 3], triangle[i]);
        dot(cross(other, edge), sub(x, triangle[i])) >= -slack * norm(edge)
    };
    let faces = norm(cross(n, other)) < PARALLEL && (two_sided || dot(n, other) > 0.0);
    faces && dot(other, sub(x, triangle[0])).abs() <= slack && (0..3).all(inside)
}

#[cfg(test)]
mod tests {
    use super::*;

    const FLOOR: [[Vector; 3]; 2] =
        [[[0., 0., 0.], [1., 0., 0.], [1., 1., 0.]], [[0., 0., 0.], [1., 1., 0.], [0., 1., 0.]]];
    const UP: Vector = [0., 0., 1.];

    fn count(other: [Vector; 3], two_sided: bool, x: Vector) -> u32 {
        let triangles = [FLOOR[0], FLOOR[1], other];
        coincident(&[x], &[UP], &triangles, &[false, false, two_sided], 1e-6).unwrap_or_default()[0]
    }

    #[test]
    fn sides_count_that_face_the_same_way_in_the_same_place() {
        let (x, beside) = ([0.5, 0.3, 0.0], [0.95, 0.1, 0.0]);
        let over = [[0.2, 0.2, 1e-7], [0.9, 0.2, 1e-7], [0.2, 0.9, 1e-7]];
        assert_eq!(count(over, false, x), 2);
        assert_eq!(count(over, false, beside), 1);
        assert_eq!(count(over.map(|p| [p[0], p[1], 2e-5]), false, x), 1);
        assert_eq!(count([over[0], over[2], over[1]], false, x), 1);
        assert_eq!(count([over[0], over[2], over[1]], true, x), 2);
        assert_eq!(count([[0.2, 0.3, -0.5], [0.9, 0.3, -0.5], [0.5, 0.3, 0.9]], true, x), 1);
    }
}
