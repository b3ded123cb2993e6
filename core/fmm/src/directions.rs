// SPDX-License-Identifier: GPL-3.0-or-later
//! Directions: over a hemisphere, and sorted into the cells of a cube map.

use crate::vector::{cross, dot, norm, scale};
use std::f64::consts::TAU;

/// Cells along one side of a face of the cube that directions are sorted into.
const SIDE: usize = 8;
const CELLS: usize = 6 * SIDE * SIDE;

/// Two unit vectors at right angles to a unit normal and to each other.
pub(crate) fn tangents(n: [f64; 3]) -> ([f64; 3], [f64; 3]) {
    let axis = if n[0].abs() > 0.6 { [0.0, 1.0, 0.0] } else { [1.0, 0.0, 0.0] };
    let s = cross(n, axis);
    let s = scale(s, 1.0 / norm(s));
    (s, cross(n, s))
}

/// A direction about a normal from two numbers in [0, 1), even by cosine.
pub(crate) fn cosine_direction(n: [f64; 3], s: [f64; 3], t: [f64; 3], at: [f64; 2]) -> [f64; 3] {
    let (radius, (sin, cos)) = (at[0].sqrt(), (TAU * at[1]).sin_cos());
    let height = (1.0 - at[0]).sqrt();
    [0, 1, 2].map(|i| height * n[i] + radius * (cos * s[i] + sin * t[i]))
}

/// The cell of the cube map that a direction lies in.
pub(crate) fn cell(d: [f64; 3]) -> usize {
    let axis = (0..3).fold(0, |best, i| if d[i].abs() > d[best].abs() { i } else { best });
    let at = |i: usize| {
        let place = (d[(axis + i) % 3] / d[axis].abs() + 1.0) * 0.5 * SIDE as f64;
        (place as usize).min(SIDE - 1)
    };
    ((2 * axis + usize::from(d[axis] < 0.0)) * SIDE + at(1)) * SIDE + at(2)
}

/// Which cells of the cube map are taken.
#[derive(Debug, Default, Clone)]
pub(crate) struct Mask([u64; CELLS / 64]);

impl Mask {
    pub fn has(&self, cell: usize) -> bool {
        self.0[cell / 64] >> (cell % 64) & 1 == 1
    }
}

/// A cell of directions: its middle, unit, and the angle within which all of it lies, as cosine and sine.
#[derive(Clone, Copy)]
struct Cone {
    middle: [f64; 3],
    cos: f64,
    sin: f64,
}

impl Cone {
    /// The cell from (a, b) on of a face of the cube, of a side in parts of the face's half side.
    fn new(face: usize, [a, b]: [f64; 2], side: f64) -> Self {
        let direction = |i: f64, j: f64| {
            let mut d = [0.0; 3];
            d[face / 2] = if face.is_multiple_of(2) { 1.0 } else { -1.0 };
            (d[(face / 2 + 1) % 3], d[(face / 2 + 2) % 3]) = (a + i * side, b + j * side);
            scale(d, 1.0 / norm(d))
        };
        let middle = direction(0.5, 0.5);
        let corners = [(0., 0.), (0., 1.), (1., 0.), (1., 1.)];
        let cos = corners.map(|(i, j)| dot(middle, direction(i, j))).into_iter().fold(1.0, f64::min);
        Self { middle, cos, sin: (1.0 - cos * cos).sqrt() }
    }

    /// Whether any of its directions may be within an angle, given by cosine and sine, of a unit vector.
    fn meets(&self, d: [f64; 3], cos: f64, sin: f64) -> bool {
        // Both angles are at most a right one, so that their sum is at most a straight one.
        dot(self.middle, d) >= self.cos * cos - self.sin * sin
    }
}

/// Cells along one side of a quarter of a face.
const FINE: usize = SIDE / 2;

/// The quarters of all faces of the cube map, and their cells.
pub(crate) struct Cube {
    quarters: Vec<Cone>,
    /// (24, FINE * FINE) cells, each with its number.
    cells: Vec<[(usize, Cone); FINE * FINE]>,
}

impl Cube {
    pub fn new() -> Self {
        let (mut quarters, mut cells) = (Vec::new(), Vec::new());
        for quarter in 0..24 {
            let (face, i, j) = (quarter / 4, quarter / 2 % 2, quarter % 2);
            let low = [i as f64 - 1.0, j as f64 - 1.0];
            quarters.push(Cone::new(face, low, 1.0));
            cells.push(std::array::from_fn(|k| {
                let (a, b) = (k / FINE, k % FINE);
                let side = 1.0 / FINE as f64;
                let number = (face * SIDE + i * FINE + a) * SIDE + j * FINE + b;
                (number, Cone::new(face, [low[0] + a as f64 * side, low[1] + b as f64 * side], side))
            }));
        }
        Self { quarters, cells }
    }

    /// Marks all directions from within a ball to within another one; d joins their middles, `radius` is that of both.
    pub fn mark(&self, d: [f64; 3], radius: f64, mask: &mut Mask) {
        let distance = norm(d);
        if distance <= radius {
            mask.0 = [u64::MAX; CELLS / 64];
            return;
        }
        let (d, sin) = (scale(d, 1.0 / distance), radius / distance);
        let cos = (1.0 - sin * sin).sqrt();
        for (_, cells) in self.quarters.iter().zip(&self.cells).filter(|(quarter, _)| quarter.meets(d, cos, sin)) {
            for (number, _) in cells.iter().filter(|(_, cell)| cell.meets(d, cos, sin)) {
                mask.0[number / 64] |= 1 << (number % 64);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vector::{add, sub};
    use proptest::prelude::*;

    fn vector() -> impl Strategy<Value = [f64; 3]> {
        [-1.0..1.0, -1.0..1.0, -1.0..1.0].prop_filter("has a direction", |&v| norm(v) > 1e-3)
    }

    proptest! {
        #[test]
        fn all_directions_between_two_balls_are_marked(d in vector(), radius in 0.0..0.5f64, a in vector(), b in vector()) {
            let mut mask = Mask::default();
            Cube::new().mark(d, radius, &mut mask);
            // A point in the ball at the origin and one in the ball at d, of radii that sum to `radius`.
            let inside = |v: [f64; 3], r: f64| scale(v, r / norm(v).max(1.0));
            let between = sub(add(d, inside(a, 0.3 * radius)), inside(b, 0.7 * radius));
            prop_assume!(norm(between) > 1e-9);
            prop_assert!(mask.has(cell(between)));
        }

        #[test]
        fn directions_are_unit_and_in_front(n in vector(), u in 0.0..1.0f64, v in 0.0..1.0f64) {
            let n = scale(n, 1.0 / norm(n));
            let (s, t) = tangents(n);
            let d = cosine_direction(n, s, t, [u, v]);
            prop_assert!((norm(d) - 1.0).abs() < 1e-12 && dot(d, n) >= 0.0);
        }
    }

    #[test]
    fn few_cells_are_marked_for_a_small_box_far_away() {
        let mut mask = Mask::default();
        Cube::new().mark([0.0, 0.0, 10.0], 0.1, &mut mask);
        let marked = mask.0.iter().map(|word| word.count_ones()).sum::<u32>();
        assert!((1..=16).contains(&marked), "{marked}");
    }
}
