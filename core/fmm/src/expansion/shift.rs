// SPDX-License-Identifier: GPL-3.0-or-later
//! Exact change of origin and scale for monomials, one axis at a time.

use super::simplex::{binomial, exponents, index};
use multiversion::multiversion;

/// How the moments of a child box become those of its parent.
///
/// In box coordinates y_parent = (y_child + o) / 2, o = +-1 on each axis, and
///
/// ```text
/// y_parent^k = 2^-k sum_i C(k, i) o^(k - i) y_child^i
/// ```
///
/// on each axis by itself, so that three sparse sweeps do the work of one dense matrix.
#[derive(Clone, Debug)]
pub struct Shift {
    /// (target, source, C(k, i) 2^-k, k - i odd) for each axis, with targets in an order in which
    /// every source is still unchanged
    sweeps: [Vec<(usize, usize, f64, bool)>; 3],
}

/// The sign of axis `axis` in the place of child `octant`: bit 0 is x, 1 is y, 2 is z.
pub const fn side(octant: usize, axis: usize) -> f64 {
    if octant >> axis & 1 == 1 { 1.0 } else { -1.0 }
}

impl Shift {
    /// Shifts for the monomials of degree at most `degree`.
    pub fn new(degree: usize) -> Self {
        Self { sweeps: std::array::from_fn(|axis| sweep(degree, axis)) }
    }

    /// Child moments to parent moments, in place; `moments` is `[exponent][width]`.
    pub fn up(&self, octant: usize, width: usize, moments: &mut [f64]) {
        up(self, octant, width, moments);
    }

    /// Parent polynomial to child polynomial, in place: the transpose of [`Shift::up`].
    pub fn down(&self, octant: usize, width: usize, coefficients: &mut [f64]) {
        down(self, octant, width, coefficients);
    }
}

#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx2+fma", "x86_64+avx2+fma"))]
fn up(shift: &Shift, octant: usize, width: usize, moments: &mut [f64]) {
    for (axis, sweep) in shift.sweeps.iter().enumerate() {
        for &(target, source, value, odd) in sweep {
            let value = if odd { value * side(octant, axis) } else { value };
            combine(width, moments, target, source, value);
        }
    }
}

#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx2+fma", "x86_64+avx2+fma"))]
fn down(shift: &Shift, octant: usize, width: usize, coefficients: &mut [f64]) {
    for (axis, sweep) in shift.sweeps.iter().enumerate() {
        for &(target, source, value, odd) in sweep.iter().rev() {
            let value = if odd { value * side(octant, axis) } else { value };
            combine(width, coefficients, source, target, value);
        }
    }
}

/// Scales a row where target and source agree, adds one row to another elsewhere.
#[inline(always)]
fn combine(width: usize, rows: &mut [f64], target: usize, source: usize, value: f64) {
    let (a, b) = (target * width, source * width);
    if a == b {
        rows[a..a + width].iter_mut().for_each(|x| *x *= value);
        return;
    }
    let (low, high) = rows.split_at_mut(a.max(b));
    let (out, from) =
        if a < b { (&mut low[a..a + width], &high[..width]) } else { (&mut high[..width], &low[b..b + width]) };
    super::sparse::add_scaled(value, from, out);
}

fn sweep(degree: usize, axis: usize) -> Vec<(usize, usize, f64, bool)> {
    let mut sweep = Vec::new();
    for alpha in exponents(degree).into_iter().rev() {
        let k = alpha[axis];
        let scale = 0.5f64.powi(k as i32);
        sweep.push((index(alpha), index(alpha), scale, false));
        for i in 0..k {
            let mut source = alpha;
            source[axis] = i;
            sweep.push((index(alpha), index(source), scale * binomial(k, i), (k - i) % 2 == 1));
        }
    }
    sweep
}

#[cfg(test)]
mod tests {
    use super::*;

    fn powers(degree: usize, y: [f64; 3]) -> Vec<f64> {
        let power = |a: [usize; 3]| (0..3).map(|axis| y[axis].powi(a[axis] as i32)).product();
        exponents(degree).into_iter().map(power).collect()
    }

    #[test]
    fn up_moves_monomials_to_the_parent() {
        let child = [0.3, -0.8, 0.5];
        for octant in 0..8 {
            let parent = std::array::from_fn(|axis| 0.5 * (child[axis] + side(octant, axis)));
            let mut moved = powers(20, child);
            Shift::new(20).up(octant, 1, &mut moved);
            for (a, b) in moved.iter().zip(powers(20, parent)) {
                assert!((a - b).abs() < 1e-15, "{a} {b}");
            }
        }
    }

    #[test]
    fn down_is_the_transpose_of_up() {
        let shift = Shift::new(6);
        let (m, mut l) = (powers(6, [0.3, -0.8, 0.5]), powers(6, [-0.4, 0.1, 0.9]));
        let mut up = m.clone();
        shift.up(5, 1, &mut up);
        let dot = |a: &[f64], b: &[f64]| -> f64 { a.iter().zip(b).map(|(a, b)| a * b).sum() };
        let expected = dot(&up, &l);
        shift.down(5, 1, &mut l);
        assert!((dot(&m, &l) - expected).abs() < 1e-14);
    }
}
