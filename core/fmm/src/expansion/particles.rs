// SPDX-License-Identifier: GPL-3.0-or-later
//! The work per particle: sums of functions over particles, and sums of functions at particles.
//!
//! Both expansions reduce to two loops over a set of scalar functions f_alpha (monomials, or the
//! derivatives of log|d|), with n the normal and q the strength in C colours:
//!
//! ```text
//! gather   V[alpha][i][c] += sum_y f_alpha(y) n_i q_c
//! scatter  H_c(x)         += sum_(alpha, i) n_i f_alpha(x) G[alpha][i][c]
//! ```
//!
//! Particles go in blocks of [`LANES`], one particle a lane.

use super::derivatives::{Derivatives, Radial};
use super::simplex::{Exponent, exponents, index, lowered, monomials};
use multiversion::multiversion;

/// Particles in a block: two registers of AVX-512, four of AVX2.
const LANES: usize = 16;
type Lanes = [f64; LANES];

/// The scalar functions f_alpha, alpha in the order of [`index`].
#[derive(Clone, Debug)]
pub enum Functions {
    /// x^alpha, each from a lower one: (its place, axis).
    Monomials(Vec<(usize, usize)>),
    /// D^alpha log|x| / alpha!
    Logarithm(Derivatives),
}

impl Functions {
    /// All monomials of degree at most `degree`.
    pub fn monomials(degree: usize) -> Self {
        let parent = |alpha: Exponent| (0..3).find_map(|axis| lowered(alpha, axis).map(|lower| (index(lower), axis)));
        Functions::Monomials(exponents(degree).into_iter().filter_map(parent).collect())
    }

    /// All derivatives of log|x| of order at most `order`.
    pub fn logarithm(order: usize) -> Self {
        Functions::Logarithm(Derivatives::new(Radial::Logarithm, order))
    }

    /// Values of all functions at a block of points, `x[axis][lane]`.
    #[inline(always)]
    fn evaluate(&self, x: &[Lanes; 3], values: &mut Vec<Lanes>) {
        match self {
            Functions::Logarithm(derivatives) => derivatives.evaluate(x, values),
            Functions::Monomials(parents) => {
                values.clear();
                values.push([1.0; LANES]);
                for &(parent, axis) in parents {
                    let lower = values[parent];
                    values.push(std::array::from_fn(|l| lower[l] * x[axis][l]));
                }
            }
        }
    }
}

/// Number of functions up to a degree, times three axes.
pub const fn table_len(degree: usize) -> usize {
    monomials(degree) * 3
}

/// `V[alpha][i][c]` += sum over particles of f_alpha(position) normal_i strength_c.
///
/// `positions`, `normals` and `strengths` are one row a particle, `sums` is `[function][axis][colour]`.
pub fn gather<const C: usize>(
    functions: &Functions,
    positions: &[[f64; 3]],
    normals: &[[f64; 3]],
    strengths: &[[f64; C]],
    sums: &mut [[f64; C]],
) {
    let mut values = Vec::new();
    for start in (0..positions.len()).step_by(LANES) {
        let block = start..positions.len().min(start + LANES);
        let (x, n, q) = (&positions[block.clone()], &normals[block.clone()], &strengths[block]);
        gather_block(functions, x, n, q, &mut values, sums);
    }
}

/// H_c += sum over functions of normal_i f_alpha(position) `G[alpha][i][c]`.
///
/// `table` is `[function][axis][colour]`; `irradiance` has one row of colours a particle.
pub fn scatter<const C: usize>(
    functions: &Functions,
    table: &[[f64; C]],
    positions: &[[f64; 3]],
    normals: &[[f64; 3]],
    irradiance: &mut [[f64; C]],
) {
    let mut values = Vec::new();
    for start in (0..positions.len()).step_by(LANES) {
        let block = start..positions.len().min(start + LANES);
        let (x, n) = (&positions[block.clone()], &normals[block.clone()]);
        scatter_block(functions, table, x, n, &mut values, &mut irradiance[block]);
    }
}

#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx2+fma", "x86_64+avx2+fma"))]
fn gather_block<const C: usize>(
    functions: &Functions,
    positions: &[[f64; 3]],
    normals: &[[f64; 3]],
    strengths: &[[f64; C]],
    values: &mut Vec<Lanes>,
    sums: &mut [[f64; C]],
) {
    let n = transposed(positions.len(), normals);
    let q = transposed(positions.len(), strengths);
    let s: [[Lanes; C]; 3] = n.map(|n| q.map(|q| std::array::from_fn(|l| n[l] * q[l])));
    functions.evaluate(&padded(positions), values);
    for (value, row) in values.iter().zip(sums.as_chunks_mut::<3>().0) {
        for (sum, s) in row.as_flattened_mut().iter_mut().zip(s.as_flattened()) {
            *sum += dot(value, s);
        }
    }
}

#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx2+fma", "x86_64+avx2+fma"))]
fn scatter_block<const C: usize>(
    functions: &Functions,
    table: &[[f64; C]],
    positions: &[[f64; 3]],
    normals: &[[f64; 3]],
    values: &mut Vec<Lanes>,
    irradiance: &mut [[f64; C]],
) {
    functions.evaluate(&padded(positions), values);
    let mut field = [[[0.0; LANES]; C]; 3];
    for (value, row) in values.iter().zip(table.as_chunks::<3>().0) {
        for (field, &g) in field.as_flattened_mut().iter_mut().zip(row.as_flattened()) {
            for l in 0..LANES {
                field[l] += value[l] * g;
            }
        }
    }
    for (l, (h, n)) in irradiance.iter_mut().zip(normals).enumerate() {
        for (c, h) in h.iter_mut().enumerate() {
            *h += n[0] * field[0][c][l] + n[1] * field[1][c][l] + n[2] * field[2][c][l];
        }
    }
}

/// Rows of at most [`LANES`] particles as columns, zero beyond them.
#[inline(always)]
fn transposed<const C: usize>(count: usize, rows: &[[f64; C]]) -> [Lanes; C] {
    let mut columns = [[0.0; LANES]; C];
    for (l, row) in rows[..count].iter().enumerate() {
        for (column, &x) in columns.iter_mut().zip(row) {
            column[l] = x;
        }
    }
    columns
}

/// Positions as columns; lanes beyond the last particle repeat the first, so that every lane is a
/// point at which the functions are finite.
#[inline(always)]
fn padded(positions: &[[f64; 3]]) -> [Lanes; 3] {
    let mut columns: [Lanes; 3] = std::array::from_fn(|axis| [positions[0][axis]; LANES]);
    for (l, row) in positions.iter().enumerate() {
        for (column, &x) in columns.iter_mut().zip(row) {
            column[l] = x;
        }
    }
    columns
}

/// Sum of products, halved lane by lane so that it vectorises.
#[inline(always)]
fn dot(a: &Lanes, b: &Lanes) -> f64 {
    let eight: [f64; 8] = std::array::from_fn(|l| a[l] * b[l] + a[l + 8] * b[l + 8]);
    let four: [f64; 4] = std::array::from_fn(|l| eight[l] + eight[l + 4]);
    (four[0] + four[2]) + (four[1] + four[3])
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn rows(count: usize) -> impl Strategy<Value = Vec<[f64; 3]>> {
        proptest::collection::vec(proptest::array::uniform3(-1.0..1.0), count)
    }

    proptest! {
        #[test]
        fn scatter_is_the_transpose_of_gather(
            (x, n, q, table) in (1usize..40).prop_flat_map(|count| {
                (rows(count), rows(count), rows(count), rows(table_len(3)))
            })
        ) {
            let functions = Functions::monomials(3);
            let mut sums = vec![[0.0; 3]; table_len(3)];
            gather(&functions, &x, &n, &q, &mut sums);
            let mut h = vec![[0.0; 3]; x.len()];
            scatter(&functions, &table, &x, &n, &mut h);
            for c in 0..3 {
                let dot: f64 = sums.iter().zip(&table).map(|(a, b)| a[c] * b[c]).sum();
                let expected: f64 = h.iter().zip(&q).map(|(h, q)| h[c] * q[c]).sum();
                prop_assert!((dot - expected).abs() < 1e-11);
            }
        }
    }
}
