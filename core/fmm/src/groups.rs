// SPDX-License-Identifier: GPL-3.0-or-later
//! Triangles that are finer than the light needs, as groups that one particle can stand for.

use crate::error::{Error, same_length};
use crate::meshes::{PARALLEL, Sets, corners, meshes};
use crate::samples::hash;
use crate::vector::{add, cross, dot, high, low, norm, scale, sub};
use rayon::prelude::*;
use std::collections::HashMap;

/// Components of normals are rounded to a multiple of one over this: normals of one group differ by 30 degrees or less.
const NORMAL_STEPS: f64 = 3.0;
/// A group is at most this share of its mesh across: light changes on the scale of the objects that it falls on.
const CELLS_PER_MESH: f64 = 10.0;
/// Triangles that meet in an edge: of more none are joined there.
const MANY: usize = 16;
/// Halvings of the range of sizes within which the wanted number of groups is looked for.
const STEPS: usize = 12;

/// The group of each triangle, numbered from 0 in order of first appearance: in one cell of a grid, of similar normals, of one
/// kind (T,), and joined by edges from which nothing rises: the floors on both sides of a wall are apart. The grid is about
/// the finest that makes no more than `count` groups, but never coarser than a share of each mesh; what is not joined makes a
/// few groups more.
pub fn group(triangles: &[[[f64; 3]; 3]], kinds: &[u32], count: usize) -> Result<Vec<u32>, Error> {
    same_length("kinds", triangles.len(), kinds.len())?;
    let corners = corners(triangles);
    let (meshes, pairs) = (meshes(&corners), neighbours(triangles, &corners));
    let largest: Vec<f64> = extents(triangles, &meshes).iter().map(|extent| extent / CELLS_PER_MESH).collect();
    let normals: Vec<[f64; 3]> = triangles.iter().map(|t| cross(sub(t[1], t[0]), sub(t[2], t[0]))).collect();
    let origin = triangles.iter().flatten().copied().fold([f64::INFINITY; 3], low);
    let keys = |size: f64| -> Vec<u64> {
        (0..triangles.len())
            .into_par_iter()
            .map(|i| {
                let [a, b, c] = triangles[i];
                let size = size.min(largest[i]).max(f64::MIN_POSITIVE);
                let place = sub(scale(add(a, add(b, c)), 1.0 / 3.0), origin).map(|x| (x / size).floor());
                let normal = scale(normals[i], NORMAL_STEPS / norm(normals[i]).max(f64::MIN_POSITIVE)).map(f64::round);
                let parts = place.into_iter().chain(normal).map(|x| x as i64 as u64);
                parts.chain([u64::from(meshes[i]), u64::from(kinds[i])]).fold(0, |before, x| hash(before ^ x))
            })
            .collect()
    };
    let area = 0.5 * normals.iter().map(|&n| norm(n)).sum::<f64>();
    let size = (area / count.max(1) as f64).sqrt().max(f64::MIN_POSITIVE);
    let (mut fine, mut coarse) = (-8.0, 8.0);
    for _ in 0..STEPS {
        let middle = 0.5 * (fine + coarse);
        if distinct(keys(size * f64::exp2(middle))) > count { fine = middle } else { coarse = middle }
    }
    let keys = keys(size * f64::exp2(coarse));
    let mut sets = Sets::new(triangles.len());
    pairs.into_iter().filter(|&(a, b)| keys[a as usize] == keys[b as usize]).for_each(|(a, b)| sets.join(a, b));
    let mut known = HashMap::new();
    let mut number = |first| {
        let next = known.len() as u32;
        *known.entry(first).or_insert(next)
    };
    Ok(sets.firsts().into_iter().map(&mut number).collect())
}

/// A triangle at an edge between two corners, by its number and that of its third corner.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Side {
    edge: [u32; 2],
    triangle: u32,
    third: u32,
}

/// Triangles that share an edge from which no other one rises.
fn neighbours(triangles: &[[[f64; 3]; 3]], corners: &[[u32; 3]]) -> Vec<(u32, u32)> {
    let side = |(&[a, b, c], i): (&[u32; 3], u32)| {
        [(a, b, c), (b, c, a), (c, a, b)].map(|(a, b, c)| Side { edge: [a.min(b), a.max(b)], triangle: i, third: c })
    };
    let mut sides: Vec<Side> = corners.iter().zip(0..).flat_map(side).collect();
    sides.par_sort_unstable();
    let at = |side: &Side| {
        let number = corners[side.triangle as usize].iter().position(|&corner| corner == side.third);
        triangles[side.triangle as usize][number.unwrap_or_default()]
    };
    // How far the third corner of one triangle is from the plane of another, as a share of how far it is away.
    let off = |side: &Side, other: &Side| {
        let [a, b, c] = triangles[other.triangle as usize];
        let (normal, to) = (cross(sub(b, a), sub(c, a)), sub(at(side), at(other)));
        dot(normal, to).abs() > PARALLEL * norm(normal) * norm(to)
    };
    let mut pairs = Vec::new();
    for edge in sides.chunk_by(|a, b| a.edge == b.edge).filter(|edge| edge.len() <= MANY) {
        for (k, a) in edge.iter().enumerate() {
            for b in &edge[k + 1..] {
                let rises = |c: &Side| c.third != a.third && c.third != b.third && off(c, a) && off(c, b);
                if !edge.iter().any(rises) {
                    pairs.push((a.triangle, b.triangle));
                }
            }
        }
    }
    pairs
}

fn distinct(mut keys: Vec<u64>) -> usize {
    keys.par_sort_unstable();
    keys.chunk_by(|a, b| a == b).count()
}

/// The longest side of the bounding box of each triangle's mesh.
fn extents(triangles: &[[[f64; 3]; 3]], meshes: &[u32]) -> Vec<f64> {
    let mut boxes: HashMap<u32, ([f64; 3], [f64; 3])> = HashMap::new();
    for (triangle, &mesh) in triangles.iter().zip(meshes) {
        let (least, most) = boxes.entry(mesh).or_insert(([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]));
        for &corner in triangle {
            (*least, *most) = (low(*least, corner), high(*most, corner));
        }
    }
    let extent = |(least, most): &([f64; 3], [f64; 3])| sub(*most, *least).into_iter().fold(0.0, f64::max);
    meshes.iter().map(|mesh| boxes.get(mesh).map_or(0.0, extent)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A square of 2 n^2 triangles at a height.
    fn grid(n: usize, height: f64) -> Vec<[[f64; 3]; 3]> {
        let at = |i: usize, j: usize| [i as f64 / n as f64, j as f64 / n as f64, height];
        let cells = (0..n).flat_map(|i| (0..n).map(move |j| (i, j)));
        cells
            .flat_map(|(i, j)| {
                let (a, b, c, d) = (at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1));
                [[a, b, c], [a, c, d]]
            })
            .collect()
    }

    fn count(groups: &[u32]) -> usize {
        groups.iter().max().map_or(0, |&most| most as usize + 1)
    }

    #[test]
    fn about_as_many_groups_as_wanted_come_out() {
        let groups = group(&grid(60, 0.0), &[0; 7200], 400).unwrap();
        assert!((200..=400).contains(&count(&groups)), "{}", count(&groups));
    }

    #[test]
    fn meshes_and_kinds_are_never_mixed() {
        let mut triangles = grid(8, 0.0);
        triangles.extend(grid(8, 1e-9));
        let kinds: Vec<u32> = (0..256).map(|i| u32::from(i % 128 < 20)).collect();
        let groups = group(&triangles, &kinds, 4).unwrap();
        let of = |range: std::ops::Range<usize>| groups[range].to_vec();
        let apart = |a: Vec<u32>, b: Vec<u32>| a.iter().all(|g| !b.contains(g));
        assert!(apart(of(0..128), of(128..256)), "two sheets share a group");
        assert!(apart(of(0..20), of(20..128)), "two kinds share a group");
    }

    #[test]
    fn surfaces_that_look_away_from_each_other_are_apart() {
        let [a, b, c] = [[0., 0., 0.], [1., 0., 0.], [0., 1., 0.]];
        let groups = group(&[[a, b, c], [a, c, b]], &[0, 0], 1).unwrap();
        assert_eq!(groups, [0, 1]);
    }

    #[test]
    fn floors_on_both_sides_of_a_wall_are_apart() {
        let (floor, wall_at) = (grid(24, 0.0), 1.0 / 3.0);
        let left = |i: &usize| floor[*i].iter().all(|corner| corner[0] < wall_at + 1e-9);
        let (left, right): (Vec<usize>, Vec<usize>) = (0..floor.len()).partition(left);
        let mixed = |groups: &[u32]| left.iter().any(|&i| right.iter().any(|&j| groups[i] == groups[j]));
        assert!(mixed(&group(&floor, &vec![0; floor.len()], 1).unwrap()));

        let wall = grid(24, 0.0).into_iter().map(|t| t.map(|[x, y, _]| [8.0 / 24.0, x, y]));
        // The backs of the wall are cut along the other diagonals.
        let backs = wall.clone().map(|t| t.map(|[x, y, z]| [x, 1.0 - y, z]));
        let triangles: Vec<_> = floor.iter().copied().chain(wall).chain(backs).collect();
        let groups = group(&triangles, &vec![0; triangles.len()], 1).unwrap();
        assert!(!mixed(&groups));
        assert!(count(&groups) < triangles.len() / 4, "the wall falls to pieces: {}", count(&groups));
    }

    #[test]
    fn no_triangles_make_no_groups() {
        assert_eq!(group(&[], &[], 10).unwrap(), Vec::<u32>::new());
        assert!(group(&[], &[1], 10).is_err());
    }
}
