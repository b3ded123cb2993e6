// SPDX-License-Identifier: GPL-3.0-or-later
//! Directions about axes, and random points of patches as the ends of rays.

use crate::error::{Error, same_length};
use glam::DVec3;

/// From which component along x on an axis is taken to lie along it.
const ALONG: f64 = 0.6;

/// Unit vectors about unit axes, of a cosine with them and an angle about them; as many for each axis.
pub fn around(axes: &[[f64; 3]], cosines: &[f64], angles: &[f64]) -> Result<Vec<[f64; 3]>, Error> {
    same_length("angles", cosines.len(), angles.len())?;
    let each = cosines.len() / axes.len().max(1);
    same_length("cosines", axes.len() * each, cosines.len())?;
    let mut found = Vec::with_capacity(cosines.len());
    for (i, &axis) in axes.iter().enumerate() {
        let axis = DVec3::from(axis);
        let other = if axis.x.abs() > ALONG { DVec3::Y } else { DVec3::X };
        let s = axis.cross(other).normalize();
        let t = axis.cross(s);
        for k in i * each..(i + 1) * each {
            let sine = (1.0 - cosines[k] * cosines[k]).max(0.0).sqrt();
            let (y, x) = angles[k].sin_cos();
            found.push((sine * x * s + sine * y * t + cosines[k] * axis).into());
        }
    }
    Ok(found)
}

/// Triangles with the unit normals of the sides that count.
#[derive(Clone, Copy)]
pub struct Targets<'a> {
    pub triangles: &'a [[[f64; 3]; 3]],
    pub normals: &'a [[f64; 3]],
}

/// Points with unit normals, each of which aims at one of the targets, chosen with a density per area there.
#[derive(Clone, Copy)]
pub struct Aiming<'a> {
    pub points: &'a [[f64; 3]],
    pub normals: &'a [[f64; 3]],
    pub targets: &'a [u32],
    pub densities: &'a [f64],
}

/// For each of those that aim, a point of its target by two numbers even in [0, 1), and what share of its light arrives
/// by the sample where rays even by cosine go there too: both are weighted by the power heuristic.
pub fn aim(at: Targets, from: Aiming, numbers: &[[f64; 2]]) -> Result<Vec<([f64; 3], f64)>, Error> {
    let count = from.points.len();
    same_length("target normals", at.triangles.len(), at.normals.len())?;
    same_length("normals", count, from.normals.len())?;
    same_length("targets", count, from.targets.len())?;
    same_length("densities", count, from.densities.len())?;
    same_length("numbers", count, numbers.len())?;
    if let Some(&index) = from.targets.iter().find(|&&target| target as usize >= at.triangles.len()) {
        return Err(Error::Index { what: "target", index: index as usize, count: at.triangles.len() });
    }
    let one = |i: usize| {
        let target = from.targets[i] as usize;
        let end = inside(at.triangles[target], numbers[i]);
        let between = end - DVec3::from(from.points[i]);
        let squared = between.length_squared().max(f64::MIN_POSITIVE);
        let here = between.dot(from.normals[i].into()).max(0.0);
        let there = (-between.dot(at.normals[target].into())).max(0.0);
        let by_ray = here * there / (std::f64::consts::PI * squared);
        let over = by_ray / (from.densities[i] * squared).max(f64::MIN_POSITIVE);
        (end.into(), 1.0 / (over + over.recip()))
    };
    Ok((0..count).map(one).collect())
}

/// The point of a triangle for two numbers even in [0, 1), even over its area.
fn inside(triangle: [[f64; 3]; 3], numbers: [f64; 2]) -> DVec3 {
    let [a, b, c] = triangle.map(DVec3::from);
    let (root, other) = (numbers[0].sqrt(), numbers[1]);
    (1.0 - root) * a + root * ((1.0 - other) * b + other * c)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn directions_have_the_cosine_and_are_square_to_each_other_at_right_angles() {
        for axis in [[1.0, 0.0, 0.0], [0.0, 0.6, -0.8]] {
            let found = around(&[axis], &[0.0, 0.0, 0.5], &[0.3, 0.3 + std::f64::consts::FRAC_PI_2, 2.0]).unwrap();
            let [a, b, c] = [0, 1, 2].map(|i| DVec3::from(found[i]));
            assert!(a.dot(b).abs() < 1e-15 && a.dot(axis.into()).abs() < 1e-15);
            assert!((c.dot(axis.into()) - 0.5).abs() < 1e-15 && (c.length() - 1.0).abs() < 1e-15);
        }
        assert!(around(&[[1.0, 0.0, 0.0]; 2], &[0.0; 3], &[0.0; 3]).is_err());
    }

    #[test]
    fn a_target_that_is_as_likely_by_either_counts_half() {
        let triangle = [[1.0, 0.0, 2.0], [1.0, 0.0, 2.0], [1.0, 0.0, 2.0]];
        let at = Targets { triangles: &[triangle], normals: &[[0.0, 0.0, -1.0]] };
        // By cosine: 2 * 2 / (pi * 5^2) per area.
        let even = 4.0 / (std::f64::consts::PI * 25.0);
        let (points, normals) = ([[0.0; 3]; 3], [[0.0, 0.0, 1.0], [0.0, 0.0, 1.0], [0.0, 0.0, -1.0]]);
        let from =
            Aiming { points: &points, normals: &normals, targets: &[0; 3], densities: &[even, 2.0 * even, even] };
        let found = aim(at, from, &[[0.3, 0.7]; 3]).unwrap();
        assert!((found[0].1 - 0.5).abs() < 1e-15 && (found[1].1 - 0.4).abs() < 1e-15 && found[2].1 == 0.0);
        assert_eq!(found[0].0, [1.0, 0.0, 2.0]);
        assert!(aim(at, Aiming { targets: &[0, 0, 1], ..from }, &[[0.0; 2]; 3]).is_err());
    }

    #[test]
    fn points_are_even_over_a_triangle() {
        let triangle = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
        let steps = (0..10_000).map(|i| [f64::from(i / 100) / 100.0 + 0.005, f64::from(i % 100) / 100.0 + 0.005]);
        let mean = steps.map(|numbers| inside(triangle, numbers)).sum::<DVec3>() / 1e4;
        assert!((mean - DVec3::new(1.0, 1.0, 0.0) / 3.0).length() < 1e-4);
    }
}
