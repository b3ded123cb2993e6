// SPDX-License-Identifier: GPL-3.0-or-later
//! Exact form factors from a point to a triangle.

use crate::portions::MOST_CORNERS;
use glam::DVec3;
use std::f64::consts::PI;

/// The part of a convex polygon in front of a receiver's horizon.
#[derive(Debug, Clone, Copy)]
pub struct Clipped {
    corners: [DVec3; MOST_CORNERS],
    count: usize,
}

impl Clipped {
    /// Clips a polygon by the plane through `x` with normal `n_x`; corners are kept relative to `x`.
    pub fn new(x: DVec3, n_x: DVec3, polygon: impl Iterator<Item = DVec3>) -> Self {
        let mut clipped = Clipped { corners: [DVec3::ZERO; MOST_CORNERS], count: 0 };
        let (mut first, mut last) = (None, None);
        for corner in polygon.map(|v| v - x) {
            let here = (corner, n_x.dot(corner));
            if let Some(last) = last.replace(here) {
                clipped.push_crossing(last, here);
            }
            first.get_or_insert(here);
            if here.1 >= 0.0 {
                clipped.push(corner);
            }
        }
        if let (Some(last), Some(first)) = (last, first) {
            clipped.push_crossing(last, first);
        }
        clipped
    }

    /// Where an edge goes through the horizon, from corners and their heights.
    fn push_crossing(&mut self, (a, above): (DVec3, f64), (b, below): (DVec3, f64)) {
        if above * below < 0.0 {
            self.push(a.lerp(b, above / (above - below)));
        }
    }

    fn push(&mut self, corner: DVec3) {
        if self.count < MOST_CORNERS {
            self.corners[self.count] = corner;
            self.count += 1;
        }
    }

    fn corners(&self) -> &[DVec3] {
        &self.corners[..self.count]
    }

    /// Form factor from the point to the clipped polygon, in [0, 1]: Lambert's contour sum
    /// F = 1/(2 pi) sum over edges of angle * n_x . unit(a x b). Baum, Rushmeier and Winget, "Improving radiosity
    /// solutions through the use of analytically determined form-factors", SIGGRAPH 1989, eq 5.
    pub fn form_factor(&self, n_x: DVec3) -> f64 {
        let corners = self.corners();
        let mut sum = 0.0;
        for (i, &a) in corners.iter().enumerate() {
            let b = corners[(i + 1) % corners.len()];
            let cross = a.cross(b);
            let length = cross.length();
            // An edge on a line through the receiver spans no angle seen from it.
            if length > 0.0 {
                sum += length.atan2(a.dot(b)) * n_x.dot(cross) / length;
            }
        }
        (sum.abs() / (2.0 * PI)).min(1.0)
    }

    /// A point inside the clipped polygon, relative to the receiver: the mean of its corners.
    pub fn centre(&self) -> DVec3 {
        self.corners().iter().sum::<DVec3>() / self.count.max(1) as f64
    }
}

/// Form factor from a point to the front of a triangle: the share of a cosine-weighted hemisphere that the triangle
/// covers. Zero when the point is behind or in the plane of the triangle.
pub fn point_to_triangle(x: [f64; 3], n_x: [f64; 3], triangle: &[[f64; 3]; 3]) -> f64 {
    let (x, n_x) = (DVec3::from(x), DVec3::from(n_x));
    let triangle = triangle.map(DVec3::from);
    if !faces(x, &triangle) {
        return 0.0;
    }
    Clipped::new(x, n_x, triangle.into_iter()).form_factor(n_x)
}

/// Whether `x` is strictly in front of the triangle, whose front is the side from which it is counter-clockwise.
pub fn faces(x: DVec3, triangle: &[DVec3; 3]) -> bool {
    let [a, b, c] = *triangle;
    let normal = (b - a).cross(c - a);
    let relative = x - a;
    let edge = (b - a).abs().max_element().max((c - a).abs().max_element());
    let corner = a.abs().max_element().max(x.abs().max_element());
    // Each corner, and the point, may be off by that much: corners that are means of means, say. It tilts a sliver's plane.
    let off = 4.0 * f64::EPSILON * corner.max(edge);
    // A point in the plane up to rounding sees nothing of the triangle.
    let rounding = (1e-12 * normal.length() + off * edge) * relative.length() + off * normal.length();
    normal.dot(relative) > rounding
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// A triangle with corners in the unit cube from a place on.
    fn triangle(z: f64) -> impl Strategy<Value = [[f64; 3]; 3]> {
        let corner = || [0.0..1.0, 0.0..1.0, z..z + 1.0];
        [corner(), corner(), corner()].prop_filter("has an area", |t| area_and_normal(t).0 > 0.01)
    }

    fn area_and_normal(t: &[[f64; 3]; 3]) -> (f64, DVec3) {
        let [a, b, c] = t.map(DVec3::from);
        let cross = (b - a).cross(c - a);
        (cross.length() / 2.0, cross.normalize())
    }

    /// Area times mean form factor to another triangle, from the middles of 32 * 32 parts.
    fn exchange(from: &[[f64; 3]; 3], to: &[[f64; 3]; 3]) -> f64 {
        const STEPS: usize = 32;
        let ([a, b, c], (area, normal)) = (from.map(DVec3::from), area_and_normal(from));
        let (u, v) = ((b - a) / STEPS as f64, (c - a) / STEPS as f64);
        let seen = |s: f64, t: f64| point_to_triangle((a + s * u + t * v).into(), normal.into(), to);
        let mut sum = 0.0;
        for i in 0..STEPS {
            for j in 0..STEPS - i {
                sum += seen(i as f64 + 1.0 / 3.0, j as f64 + 1.0 / 3.0);
                if i + j + 1 < STEPS {
                    sum += seen(i as f64 + 2.0 / 3.0, j as f64 + 2.0 / 3.0);
                }
            }
        }
        area * sum / (STEPS * STEPS) as f64
    }

    proptest! {
        #[test]
        fn form_factors_times_areas_are_the_same_both_ways(a in triangle(0.0), b in triangle(1.2)) {
            let (there, back) = (exchange(&a, &b), exchange(&b, &a));
            prop_assert!((0.0..=area_and_normal(&a).0).contains(&there));
            // A ten-thousandth of the smaller area for those that see each other across a horizon.
            let least = area_and_normal(&a).0.min(area_and_normal(&b).0);
            prop_assert!((there - back).abs() <= 2e-3 * there.max(back) + 1e-4 * least, "{there} {back}");
        }
    }

    fn square(corners: [[f64; 3]; 4], x: [f64; 3], n_x: [f64; 3]) -> f64 {
        let [a, b, c, d] = corners;
        point_to_triangle(x, n_x, &[a, b, c]) + point_to_triangle(x, n_x, &[a, c, d])
    }

    /// Howell, A Catalog of Radiation Heat Transfer Configuration Factors, B-3: a point opposite a corner of a
    /// parallel rectangle.
    #[test]
    fn parallel_rectangle_seen_from_below_its_corner() {
        let f = square([[0., 0., 1.], [0., 1., 1.], [1., 1., 1.], [1., 0., 1.]], [0.; 3], [0., 0., 1.]);
        let s = 2f64.sqrt();
        let exact = (1.0 / (2.0 * PI)) * 2.0 * (1.0 / s) * (1.0 / s).atan();
        assert!((f - exact).abs() < 1e-14, "{f} {exact}");
    }

    /// Half of an infinite wall that starts at the receiver's plane covers half of the hemisphere.
    #[test]
    fn huge_wall_is_clipped_at_the_horizon() {
        let h = 1e6;
        let wall = [[1e-3, -h, -h], [1e-3, h, -h], [1e-3, h, h], [1e-3, -h, h]].map(|v: [f64; 3]| v);
        let flipped = [wall[0], wall[3], wall[2], wall[1]];
        let f = square(flipped, [0.; 3], [0., 0., 1.]);
        assert!((f - 0.5).abs() < 1e-6, "{f}");
        assert_eq!(square(wall, [0.; 3], [0., 0., 1.]), 0.0);
    }

    #[test]
    fn nothing_is_seen_of_a_triangle_in_the_receivers_plane_or_through_it() {
        let flat = [[0., 0., 0.], [1., 0., 0.], [0., 1., 0.]];
        assert_eq!(point_to_triangle([0.2, 0.2, 0.0], [0., 0., 1.], &flat), 0.0);
        assert_eq!(point_to_triangle([0.0, 0.0, 0.0], [0., 0., -1.], &flat), 0.0);
    }

    /// The part of a triangle that is left when its longest edge is halved over and over.
    fn part(mut triangle: [DVec3; 3], halves: &[bool]) -> [DVec3; 3] {
        for &first in halves {
            let length = |i: usize| triangle[i].distance_squared(triangle[(i + 1) % 3]);
            let longest = (0..3).max_by(|&i, &j| length(i).total_cmp(&length(j))).unwrap();
            let [a, b, c] = [0, 1, 2].map(|i| triangle[(longest + i) % 3]);
            triangle = if first { [a, (a + b) / 2.0, c] } else { [(a + b) / 2.0, b, c] };
        }
        triangle
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(5000))]
        #[test]
        fn parts_of_a_sliver_see_nothing_of_each_other(
            [a, b, apart] in triangle(0.0),
            shift in -5.0..5.0,
            halves in prop::collection::vec(any::<bool>(), 0..12),
            [across, along] in [0.0..1.0, 0.0..1.0],
            digits in -12.0..0.0,
        ) {
            let [a, b, apart] = [a, b, apart].map(|v| DVec3::from(v) + shift);
            let sliver: [DVec3; 3] = [a, b, (a + b) / 2.0 + 1e-6 * (apart - shift)];
            let normal = (sliver[1] - sliver[0]).cross(sliver[2] - sliver[0]).normalize();
            let seen = part(sliver, &halves);
            // From far to close to one of its corners.
            let x: DVec3 = seen[0] + 10f64.powf(digits) * (along * (sliver[1] - sliver[0]) + across * (sliver[2] - sliver[0]));
            let seen = seen.map(Into::into);
            for side in [normal, -normal] {
                prop_assert_eq!(point_to_triangle(x.into(), side.into(), &seen), 0.0);
            }
        }
    }
}
