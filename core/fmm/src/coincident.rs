// SPDX-License-Identifier: GPL-3.0-or-later
//! Surfaces in the same place, which share what light arrives there; a lamp in a ceiling takes all of it.

use crate::error::{Error, same_length};
use crate::meshes::{PARALLEL, triangle_tree};
use crate::vector::{cross, dot, norm, scale, sub};
use rayon::prelude::*;
use rstar::AABB;

type Vector = [f64; 3];

/// Triangles (T, 3, 3), and for each whether both of its sides count, and whether it emits.
#[derive(Clone, Copy)]
pub struct Sheets<'a> {
    pub triangles: &'a [[Vector; 3]],
    pub two_sided: &'a [bool],
    pub emits: &'a [bool],
}

/// The share of its place that each point (N, 3) has of those sides of sheets that face as its unit normal does; what is
/// not farther than `slack` is in the same place. Those that emit, as `emits` (N,) says of the points, leave nothing to others.
pub fn coincident(
    points: &[Vector],
    normals: &[Vector],
    emits: &[bool],
    sheets: Sheets,
    slack: f64,
) -> Result<Vec<f64>, Error> {
    same_length("normals", points.len(), normals.len())?;
    same_length("emitting points", points.len(), emits.len())?;
    same_length("sides", sheets.triangles.len(), sheets.two_sided.len())?;
    same_length("emitting sheets", sheets.triangles.len(), sheets.emits.len())?;
    let tree = triangle_tree(sheets.triangles);
    let share = |((&x, &n), &shines): ((&Vector, &Vector), &bool)| {
        let around = AABB::from_corners(x.map(|c| c - slack), x.map(|c| c + slack));
        let near = tree.locate_in_envelope_intersecting(&around).map(|found| found.data);
        let mut here = [0usize; 2];
        for i in near.filter(|&i| is_same(x, n, &sheets.triangles[i], sheets.two_sided[i], [slack; 2])) {
            here[usize::from(sheets.emits[i])] += 1;
        }
        if here[1] > 0 && !shines { 0.0 } else { 1.0 / here[usize::from(shines)].max(1) as f64 }
    };
    Ok(points.par_iter().zip(normals).zip(emits).map(share).collect())
}

fn normal(&[a, b, c]: &[Vector; 3]) -> Vector {
    let n = cross(sub(b, a), sub(c, a));
    scale(n, 1.0 / norm(n).max(f64::MIN_POSITIVE))
}

/// Whether a side of a triangle faces as a unit normal does, and is no farther from a point than this across and along.
pub(crate) fn is_same(
    x: Vector,
    n: Vector,
    triangle: &[Vector; 3],
    two_sided: bool,
    [across, along]: [f64; 2],
) -> bool {
    let other = normal(triangle);
    let inside = |i: usize| {
        let edge = sub(triangle[(i + 1) % 3], triangle[i]);
        dot(cross(other, edge), sub(x, triangle[i])) >= -along * norm(edge)
    };
    let faces = norm(cross(n, other)) < PARALLEL && (two_sided || dot(n, other) > 0.0);
    faces && dot(other, sub(x, triangle[0])).abs() <= across && (0..3).all(inside)
}

#[cfg(test)]
mod tests {
    use super::*;

    const FLOOR: [[Vector; 3]; 2] =
        [[[0., 0., 0.], [1., 0., 0.], [1., 1., 0.]], [[0., 0., 0.], [1., 1., 0.], [0., 1., 0.]]];
    const UP: Vector = [0., 0., 1.];

    fn share(other: [Vector; 3], two_sided: bool, emits: [bool; 2], x: Vector) -> f64 {
        let sheets = Sheets {
            triangles: &[FLOOR[0], FLOOR[1], other],
            two_sided: &[false, false, two_sided],
            emits: &[emits[0], emits[0], emits[1]],
        };
        coincident(&[x], &[UP], &[emits[0]], sheets, 1e-6).unwrap_or_default()[0]
    }

    const OVER: [Vector; 3] = [[0.2, 0.2, 1e-7], [0.9, 0.2, 1e-7], [0.2, 0.9, 1e-7]];

    #[test]
    fn sides_count_that_face_the_same_way_in_the_same_place() {
        let (x, beside, [a, b, c]) = ([0.5, 0.3, 0.0], [0.95, 0.1, 0.0], OVER);
        let share = |other, two_sided, x| share(other, two_sided, [false; 2], x);
        assert_eq!(share(OVER, false, x), 0.5);
        assert_eq!(share(OVER, false, beside), 1.0);
        assert_eq!(share(OVER.map(|p| [p[0], p[1], 2e-5]), false, x), 1.0);
        assert_eq!(share([a, c, b], false, x), 1.0);
        assert_eq!(share([a, c, b], true, x), 0.5);
        assert_eq!(share([[0.2, 0.3, -0.5], [0.9, 0.3, -0.5], [0.5, 0.3, 0.9]], true, x), 1.0);
    }

    #[test]
    fn what_emits_hides_what_does_not() {
        let x = [0.5, 0.3, 0.0];
        assert_eq!(share(OVER, false, [false, true], x), 0.0);
        assert_eq!(share(OVER, false, [true, false], x), 1.0);
        assert_eq!(share(OVER, false, [true, true], x), 0.5);
    }
}
