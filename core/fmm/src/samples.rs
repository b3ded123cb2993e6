// SPDX-License-Identifier: GPL-3.0-or-later
//! Directions about axes, points of triangles, and what looks random.

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

/// The point of a triangle for two numbers even in [0, 1), even over its area.
pub(crate) fn inside(triangle: [[f64; 3]; 3], numbers: [f64; 2]) -> DVec3 {
    let [a, b, c] = triangle.map(DVec3::from);
    let (root, other) = (numbers[0].sqrt(), numbers[1]);
    (1.0 - root) * a + root * ((1.0 - other) * b + other * c)
}

/// From 0 to 1.
pub(crate) fn unit(random: u64) -> f64 {
    (random >> 11) as f64 / (1u64 << 53) as f64
}

/// A number that looks random: splitmix64, Steele, Lea and Flood, "Fast splittable pseudorandom number generators", 2014.
pub(crate) fn hash(x: u64) -> u64 {
    let x = x.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let x = (x ^ x >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let x = (x ^ x >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
    x ^ x >> 31
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
    fn points_are_even_over_a_triangle() {
        let triangle = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
        let steps = (0..10_000).map(|i| [f64::from(i / 100) / 100.0 + 0.005, f64::from(i % 100) / 100.0 + 0.005]);
        let mean = steps.map(|numbers| inside(triangle, numbers)).sum::<DVec3>() / 1e4;
        assert!((mean - DVec3::new(1.0, 1.0, 0.0) / 3.0).length() < 1e-4);
    }
}
