// SPDX-License-Identifier: GPL-3.0-or-later
//! The kernel expanded as a whole: three-vectors as sources, the light vector as field.
//!
//! pi K = -n_x^T T n_y with T = d d^T / |d|^4, T_ij = 1/2 (delta_ij Laplacian - d_i d_j) log|d|.
//! A source is the vector s = q n_y, and what arrives is F(x) = -1/pi sum T(x - y) s, H = n_x . F.
//! Taylor series about the two centres give
//!
//! ```text
//! M[alpha, j] = sum s_j y^alpha,            |alpha| <= p
//! F_i(x)      = sum_beta L[beta, i] x^beta, |beta| <= p
//! ```
//!
//! T is divergence-free, d_j T_ij = 0. So a third of these numbers is redundant: `F_z[beta]` with
//! beta_z > 0 follows from F_x and F_y, and M[alpha, z] with alpha_z > 0 can be moved into the x
//! and y moments without any change of the field. That leaves (n + 1)(n + 3) of the
//! 3 (n + 1)(n + 2) / 2 numbers of degree n, and no error.

use super::derivatives::{Derivatives, Radial};
use super::particles::{Functions, gather, scatter, table_len};
use super::shift::Shift;
use super::simplex::{Exponent, Pascal, degree, exponents, index, lowered, raised, sum};
use super::sparse::Sparse;
use super::{Expansion, InColours, Operator, displacement, sign};
use std::f64::consts::PI;

const X: usize = 0;
const Z: usize = 2;

/// The whole kernel, each side truncated at degree p.
#[derive(Clone, Debug)]
pub struct Whole {
    truncation: usize,
    /// The coefficients that are kept: (alpha, axis).
    kept: Vec<(Exponent, usize)>,
    parities: Vec<u8>,
    /// All vector moments to those kept.
    reduce: Sparse,
    /// Sums over derivatives of log|d| to kept local coefficients; its transpose takes
    /// multipoles to factors of these derivatives.
    far: Sparse,
    shift: Shift,
    monomials: Functions,
    logarithm: Functions,
    /// Derivatives of log|d| of order 2p + 2, for the multipole-to-local translation.
    derivatives: Derivatives,
    pascal: Pascal,
}

impl Whole {
    pub fn new(truncation: usize) -> Self {
        let kept = kept(truncation);
        Self {
            truncation,
            parities: kept.iter().map(|&(alpha, axis)| parity(alpha, axis)).collect(),
            reduce: Sparse::from_rows(kept.iter().map(|&(alpha, axis)| reduction(alpha, axis))),
            far: Sparse::from_rows(kept.iter().map(|&(alpha, axis)| far_row(alpha, axis))),
            shift: Shift::new(truncation),
            monomials: Functions::monomials(truncation),
            logarithm: Functions::logarithm(truncation + 2),
            derivatives: Derivatives::new(Radial::Logarithm, 2 * truncation + 2),
            pascal: Pascal::new(2 * truncation),
            kept,
        }
    }

    /// Kept coefficients among all vector moments, the others zero.
    fn embed<const C: usize>(&self, coefficients: &[[f64; C]]) -> Vec<[f64; C]> {
        let mut moments = vec![[0.0; C]; table_len(self.truncation)];
        for (&(alpha, axis), &row) in self.kept.iter().zip(coefficients) {
            moments[place(alpha, axis)] = row;
        }
        moments
    }

    /// All coefficients of a divergence-free field from those kept.
    fn expand<const C: usize>(&self, local: &[[f64; C]]) -> Vec<[f64; C]> {
        let mut field = vec![[0.0; C]; table_len(self.truncation)];
        self.reduce.apply_transposed(C, local.as_flattened(), field.as_flattened_mut());
        field
    }
}

impl Expansion for Whole {
    fn truncation(&self) -> usize {
        self.truncation
    }

    fn multipole_len(&self) -> usize {
        self.kept.len()
    }

    fn local_len(&self) -> usize {
        self.kept.len()
    }

    fn parities(&self) -> &[u8] {
        &self.parities
    }

    fn m2l_operator(&self, offset: [i32; 3]) -> Operator {
        let t = tensors(&self.derivatives, 2 * self.truncation, displacement(offset));
        let entry = |(beta, i): (Exponent, usize), (alpha, j): (Exponent, usize)| {
            let ways = self.pascal.ways(alpha, beta);
            -sign(degree(alpha)) / PI * ways * t[index(sum(alpha, beta))][i][j]
        };
        let row = |&target| self.kept.iter().map(move |&source| entry(target, source));
        let matrix = self.kept.iter().flat_map(row).collect();
        Operator::dense(self.kept.len(), self.kept.len(), matrix)
    }
}

impl<const C: usize> InColours<C> for Whole {
    fn p2m(&self, positions: &[[f64; 3]], normals: &[[f64; 3]], strengths: &[[f64; C]], multipole: &mut [[f64; C]]) {
        let mut moments = vec![[0.0; C]; table_len(self.truncation)];
        gather(&self.monomials, positions, normals, strengths, &mut moments);
        self.reduce.apply(C, moments.as_flattened(), multipole.as_flattened_mut());
    }

    fn m2m(&self, octant: usize, child: &[[f64; C]], parent: &mut [[f64; C]]) {
        let mut moments = self.embed(child);
        self.shift.up(octant, 3 * C, moments.as_flattened_mut());
        self.reduce.apply(C, moments.as_flattened(), parent.as_flattened_mut());
    }

    fn l2l(&self, octant: usize, parent: &[[f64; C]], child: &mut [[f64; C]]) {
        let mut field = self.expand(parent);
        self.shift.down(octant, 3 * C, field.as_flattened_mut());
        for (&(alpha, axis), row) in self.kept.iter().zip(child) {
            row.iter_mut().zip(field[place(alpha, axis)]).for_each(|(out, x)| *out += x);
        }
    }

    fn l2p(&self, local: &[[f64; C]], positions: &[[f64; 3]], normals: &[[f64; 3]], irradiance: &mut [[f64; C]]) {
        scatter(&self.monomials, &self.expand(local), positions, normals, irradiance);
    }

    fn m2p(&self, multipole: &[[f64; C]], positions: &[[f64; 3]], normals: &[[f64; 3]], irradiance: &mut [[f64; C]]) {
        let mut table = vec![[0.0; C]; table_len(self.truncation + 2)];
        self.far.apply_transposed(C, multipole.as_flattened(), table.as_flattened_mut());
        scatter(&self.logarithm, &table, positions, normals, irradiance);
    }

    fn p2l(&self, positions: &[[f64; 3]], normals: &[[f64; 3]], strengths: &[[f64; C]], local: &mut [[f64; C]]) {
        let mut sums = vec![[0.0; C]; table_len(self.truncation + 2)];
        gather(&self.logarithm, positions, normals, strengths, &mut sums);
        self.far.apply(C, sums.as_flattened(), local.as_flattened_mut());
    }
}

/// Row of a vector coefficient in a table `[exponent][axis]`.
fn place(alpha: Exponent, axis: usize) -> usize {
    index(alpha) * 3 + axis
}

/// All x and y coefficients, and those of z that have no factor z.
fn kept(truncation: usize) -> Vec<(Exponent, usize)> {
    let all = exponents(truncation).into_iter().flat_map(|alpha| (0..3).map(move |i| (alpha, i)));
    all.filter(|&(alpha, axis)| axis != Z || alpha[Z] == 0).collect()
}

/// A vector component flips with its own axis, a monomial with its odd powers.
fn parity(alpha: Exponent, axis: usize) -> u8 {
    let odd = (0..3).map(|i| ((alpha[i] % 2) as u8) << i).sum::<u8>();
    odd ^ (1 << axis)
}

/// What a kept moment takes up: itself, and for x and y their share of a z moment,
/// M[alpha, axis] -= alpha_axis / (alpha_z + 1) M[alpha - e_axis + e_z, z].
fn reduction(alpha: Exponent, axis: usize) -> Vec<(usize, f64)> {
    let mut row = vec![(place(alpha, axis), 1.0)];
    if let (X..Z, Some(lower)) = (axis, lowered(alpha, axis)) {
        let share = alpha[axis] as f64 / (alpha[Z] + 1) as f64;
        row.push((place(raised(lower, Z), Z), -share));
    }
    row
}

/// The normalised derivative of T_ij at alpha, as (exponent, factor) of those of log|d|.
fn tensor_terms(alpha: Exponent, i: usize, j: usize) -> Vec<(Exponent, f64)> {
    let second = |i: usize, j: usize, scale: f64| {
        let lower = raised(alpha, i);
        let upper = raised(lower, j);
        (upper, scale * (lower[i] * upper[j]) as f64)
    };
    match i == j {
        true => (0..3).filter(|&k| k != i).map(|k| second(k, k, 0.5)).collect(),
        false => vec![second(i, j, -0.5)],
    }
}

/// -(-1)^|alpha| / pi times the normalised derivative of T_ij at alpha, in terms of log|d|.
fn far_row(alpha: Exponent, axis: usize) -> Vec<(usize, f64)> {
    let factor = -sign(degree(alpha)) / PI;
    let terms = |i| tensor_terms(alpha, i, axis).into_iter().map(move |(g, f)| (place(g, i), f));
    (0..3).flat_map(terms).map(|(place, f)| (place, factor * f)).collect()
}

/// Normalised derivatives of T at d up to `order`, one matrix an exponent.
fn tensors(derivatives: &Derivatives, order: usize, d: [f64; 3]) -> Vec<[[f64; 3]; 3]> {
    let b = derivatives.at(d);
    let entry = |gamma: Exponent, i: usize, j: usize| -> f64 {
        tensor_terms(gamma, i, j).into_iter().map(|(upper, factor)| factor * b[index(upper)]).sum()
    };
    let matrix = |gamma| std::array::from_fn(|i| std::array::from_fn(|j| entry(gamma, i, j)));
    exponents(order).into_iter().map(matrix).collect()
}
