// SPDX-License-Identifier: GPL-3.0-or-later
//! Normals of an octree: the common ones, the six classes that split the particles, and the cone of a box.

use crate::octree_error::OctreeError;
use crate::vector::{add, cross, dot, find, norm, scale, sub};

/// Normals looked at in search of the common ones.
const SAMPLES: usize = 4096;
/// Different normals remembered in that search.
const REMEMBERED: usize = 256;
/// Most common normals kept.
const KEPT: usize = 8;
/// Share of the samples that makes a normal a common one.
const COMMON: f64 = 0.01;
/// Two normals nearer than this are one: well above the rounding of single precision meshes.
const SAME: f64 = 1e-4;
/// Relative lead by which a later axis must win, so that rounding does not decide between equal ones.
const LEAD: f64 = 1e-6;

/// All unit vectors within one angle of an axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cone {
    /// Unit vector.
    pub axis: [f64; 3],
    /// Cosine of the half angle; -1 when the normals point everywhere.
    pub cos: f64,
    /// Sine of the half angle, kept beside the cosine as it is exact for small angles.
    pub sin: f64,
}

impl Cone {
    pub const EVERYWHERE: Self = Self { axis: [0.0, 0.0, 1.0], cos: -1.0, sin: 0.0 };

    /// The cone about the mean of these normals.
    pub(crate) fn around(normals: &[[f64; 3]]) -> Self {
        let sum = normals.iter().fold([0.0; 3], |sum, &n| add(sum, n));
        let length = norm(sum);
        if length <= 1e-6 * normals.len() as f64 {
            return Self::EVERYWHERE;
        }
        let axis = scale(sum, 1.0 / length);
        let square = normals.iter().map(|&n| sub(n, axis)).fold(0.0, |most, e| dot(e, e).max(most));
        // Equal normals: their mean differs from them by rounding alone.
        let square = if square < 1e-26 { 0.0 } else { square.min(4.0) };
        Self { axis, cos: 1.0 - 0.5 * square, sin: (square * (1.0 - 0.25 * square)).sqrt() }
    }

    /// Whether both cones are one and the same vector, but for rounding.
    pub(crate) fn same_line(&self, other: &Self) -> bool {
        let narrow = self.sin == 0.0 && other.sin == 0.0 && self.cos > 0.0 && other.cos > 0.0;
        narrow && norm(sub(self.axis, other.axis)) < 1e-13
    }

    /// Largest |n - axis| of any unit vector n of the cone.
    pub(crate) fn chord(&self) -> f64 {
        if self.cos > 0.0 { self.sin / (0.5 * (1.0 + self.cos)).sqrt() } else { (2.0 - 2.0 * self.cos).sqrt() }
    }

    /// Least and largest n.d of any unit vector n of the cone.
    pub(crate) fn range(&self, d: [f64; 3]) -> [f64; 2] {
        let along = dot(self.axis, d);
        if self.sin == 0.0 && self.cos > 0.0 {
            return [along, along];
        }
        let square = dot(d, d);
        let length = square.sqrt();
        let across = (square - along * along).max(0.0).sqrt();
        let least = if along <= -length * self.cos { -length } else { self.cos * along - self.sin * across };
        let most = if along >= length * self.cos { length } else { self.cos * along + self.sin * across };
        [least, most]
    }
}

/// The first normal that is far from unit length is an error.
pub(crate) fn check_normals(normals: &[[f64; 3]]) -> Result<(), OctreeError> {
    // NaN is not within the bounds either.
    match find(normals, |n| !(0.999..1.001).contains(&norm(n))) {
        Some(index) => Err(OctreeError::BadNormal { index, value: normals[index] }),
        None => Ok(()),
    }
}

/// The vector, made exactly unit.
pub(crate) fn unit(a: [f64; 3]) -> [f64; 3] {
    scale(a, 1.0 / norm(a))
}

/// The most common normals of a scene, either sign counted as one, most common first; at most `KEPT`.
/// They are the planes of walls, floors and boxes, along which bounds are worth keeping exactly.
pub(crate) fn common_normals(normals: &[[f64; 3]]) -> Vec<[f64; 3]> {
    let samples = normals.len().min(SAMPLES);
    let mut found: Vec<([f64; 3], usize)> = Vec::new();
    for i in 0..samples {
        // A stride of about the golden ratio visits an ordered scene evenly.
        let normal = unit(normals[(i as u64 * 2_654_435_761 % normals.len() as u64) as usize]);
        match found.iter().position(|&(known, _)| parallel(known, normal)) {
            Some(known) => found[known].1 += 1,
            None if found.len() < REMEMBERED => found.push((normal, 1)),
            None => {}
        }
    }
    found.retain(|&(_, count)| count as f64 >= COMMON * samples as f64);
    found.sort_by_key(|&(_, count)| std::cmp::Reverse(count));
    found.into_iter().take(KEPT).map(|(normal, _)| normal).collect()
}

pub(crate) fn parallel(a: [f64; 3], b: [f64; 3]) -> bool {
    norm(sub(a, b)) < SAME || norm(add(a, b)) < SAME
}

/// Three orthonormal axes along the common normals, so that the walls of a turned room fall into different classes.
pub(crate) fn frame(common: &[[f64; 3]]) -> [[f64; 3]; 3] {
    let first = common.first().copied().unwrap_or([1.0, 0.0, 0.0]);
    let square_to_first = |n: &[f64; 3]| dot(*n, first).abs() < SAME;
    let guess = common.iter().copied().find(square_to_first).unwrap_or_else(|| least_aligned(first));
    let second = unit(sub(guess, scale(first, dot(guess, first))));
    [first, second, cross(first, second)]
}

/// The coordinate axis furthest from a unit vector.
fn least_aligned(a: [f64; 3]) -> [f64; 3] {
    let mut axis = [0.0; 3];
    let least = (0..3).fold(0, |least, i| if a[i].abs() < a[least].abs() { i } else { least });
    axis[least] = 1.0;
    axis
}

/// Number of the axis that a normal is nearest to: 0 to 5 for +first, -first, +second, -second, +third, -third.
pub(crate) fn dominant_axis(frame: &[[f64; 3]; 3], normal: [f64; 3]) -> u8 {
    let along = frame.map(|axis| dot(axis, normal));
    let first = if along[1].abs() > along[0].abs() * (1.0 + LEAD) { 1 } else { 0 };
    let best = if along[2].abs() > along[first].abs() * (1.0 + LEAD) { 2 } else { first };
    2 * best as u8 + u8::from(along[best] < 0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cone_of_one_normal_is_a_line() {
        let n = scale([1.0, 2.0, 3.0], 1.0 / 14_f64.sqrt());
        let cone = Cone::around(&[n; 7]);
        assert_eq!((cone.cos, cone.sin, cone.chord()), (1.0, 0.0, 0.0));
    }

    #[test]
    fn opposite_normals_point_everywhere() {
        assert_eq!(Cone::around(&[[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]]), Cone::EVERYWHERE);
        assert_eq!(Cone::EVERYWHERE.range([3.0, 0.0, 4.0]), [-5.0, 5.0]);
        assert_eq!(Cone::EVERYWHERE.chord(), 2.0);
    }

    #[test]
    fn range_of_a_cone() {
        let half_angle = 0.5_f64;
        let cone = Cone { axis: [0.0, 0.0, 1.0], cos: half_angle.cos(), sin: half_angle.sin() };
        let at = |angle: f64| cone.range([angle.sin(), 0.0, angle.cos()]);
        let near = |a: f64, b: f64| assert!((a - b).abs() < 1e-14, "{a} {b}");
        near(at(1.0)[0], 1.5_f64.cos());
        near(at(1.0)[1], 0.5_f64.cos());
        near(at(0.2)[1], 1.0);
        near(at(3.0)[0], -1.0);
        near(cone.chord(), 2.0 * 0.25_f64.sin());
    }

    #[test]
    fn frame_of_a_turned_room() {
        let (s, c) = 0.3_f64.sin_cos();
        let walls = [[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0], [-c, -s, 0.0], [c, s, 0.0]];
        let frame = frame(&common_normals(&walls));
        assert!(parallel(frame[0], walls[0]));
        let classes = walls.map(|n| dominant_axis(&frame, n));
        assert_eq!(classes[0], classes[4]);
        assert_eq!(classes[3], classes[0] + 1);
        assert!(classes[0] != classes[1] && classes[1] != classes[2] && classes[2] != classes[0]);
    }

    #[test]
    fn rounding_does_not_choose_the_axis() {
        let axes = frame(&[]);
        let h = 0.5_f64.sqrt();
        for noise in [-1e-9, 0.0, 1e-9] {
            assert_eq!(dominant_axis(&axes, [h + noise, -h, 0.0]), 0);
        }
    }

    #[test]
    fn normals_that_cannot_be_used() {
        for bad in [[0.0; 3], [f64::NAN, 0.0, 1.0], [0.0, 2.0, 0.0]] {
            let error = check_normals(&[[1.0, 0.0, 0.0], bad]);
            assert!(matches!(error, Err(OctreeError::BadNormal { index: 1, .. })));
        }
    }
}
