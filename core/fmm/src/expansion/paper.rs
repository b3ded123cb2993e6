// SPDX-License-Identifier: GPL-3.0-or-later
//! The paper's expansion: 1/|d|^4 in spherical harmonics, the numerator kept apart (eq 4 to 11).
//!
//! The coefficients are M[a, k] = sum_y q Q_a(y) SM_k(y) (eq 7, 12) and L[a, k], with
//! H(x) = sum_(a, k) Q_a(x) SM_k(x) L[a, k] (eq 8, 9), where a = (n, j, m), n <= p, and k is one
//! of the sixteen entries of a source matrix. Q_a is r^n Y_(n-2j)^m, real and rescaled
//! ([`Harmonics`]). The e_n^j and the 1/pi are part of L, and the signed permutation that makes
//! RM(x) from SM(x) as well.
//!
//! Sums over particles first run over monomials times normals, which are fewer; sparse matrices
//! take them to M. All translations between expansions are exact for polynomials of degree n <= p.

use super::derivatives::{Derivatives, Radial};
use super::harmonics::Harmonics;
use super::particles::{Functions, gather, scatter, table_len};
use super::shift::{Shift, side};
use super::simplex::{Pascal, degree, exponents, index, sum};
use super::source_matrix::{ENTRIES, POWERS, assembly, paired_translation, parity, receivers, translation};
use super::sparse::Sparse;
use super::{Expansion, InColours, Operator, displacement, sign};
use std::f64::consts::PI;

/// Powers of r in front of the entries that have 0, 1 and 2 factors y, at an inverted point.
const INVERTED: [i32; 3] = [-4, -2, 0];

/// The paper's expansion, its outer sum truncated at n = p.
#[derive(Clone, Debug)]
pub struct Paper {
    truncation: usize,
    harmonics: Harmonics,
    parities: Vec<u8>,
    /// Monomials times normals to monomials times source matrices: all entries together, and
    /// those with 0, 1 and 2 factors y apart.
    assembly: Sparse,
    assembly_by_power: [Sparse; 3],
    shift: Shift,
    /// TM between child and parent, one an octant.
    translations: Vec<Sparse>,
    receivers: Sparse,
    monomials: Functions,
    /// Derivatives of |d|^-4 of order 2p, for the multipole-to-local translation.
    derivatives: Derivatives,
    pascal: Pascal,
}

impl Paper {
    pub fn new(truncation: usize) -> Self {
        let harmonics = Harmonics::new(truncation);
        let entries: Vec<usize> = (0..ENTRIES).collect();
        let octant = |octant| translation(std::array::from_fn(|axis| side(octant, axis)), 0.5);
        let parities = |a| entries.iter().map(move |&k| (a, k));
        Self {
            truncation,
            parities: (0..harmonics.len()).flat_map(parities).map(|(a, k)| harmonics.parity(a) ^ parity(k)).collect(),
            assembly: assembly(truncation, &entries),
            assembly_by_power: POWERS.map(|entries| assembly(truncation, entries)),
            shift: Shift::new(truncation),
            translations: (0..8).map(octant).collect(),
            receivers: receivers(),
            monomials: Functions::monomials(truncation + 2),
            derivatives: Derivatives::new(Radial::InverseFourth, 2 * truncation),
            pascal: Pascal::new(2 * truncation),
            harmonics,
        }
    }

    /// An array [Q or monomial]`[entry][colour]` of zeros.
    fn zeros(&self, colours: usize) -> Vec<f64> {
        vec![0.0; self.multipole_len() * colours]
    }

    /// Multiplies by P and by what eq 4 puts in front of each term, in place of (x, y) inside.
    fn weighted(&self, colours: usize, coefficients: &[f64]) -> Vec<f64> {
        let (mut weighted, width) = (self.zeros(colours), ENTRIES * colours);
        let rows = coefficients.chunks_exact(width).zip(weighted.chunks_exact_mut(width));
        for (a, (from, to)) in rows.enumerate() {
            self.receivers.apply(colours, from, to);
            let factor = self.harmonics.coefficient(a) / PI;
            to.iter_mut().for_each(|x| *x *= factor);
        }
        weighted
    }

    /// D^(alpha + beta) |d|^-4 (-1)^|alpha| / (alpha! beta!): the series in x^beta y^alpha.
    fn taylor(&self, d: [f64; 3]) -> Vec<f64> {
        let c = self.derivatives.at(d);
        let all = exponents(self.truncation);
        let entry = |beta: [usize; 3], alpha: [usize; 3]| {
            sign(degree(alpha)) * self.pascal.ways(alpha, beta) * c[index(sum(alpha, beta))]
        };
        all.iter().flat_map(|&beta| all.iter().map(move |&alpha| entry(beta, alpha))).collect()
    }
}

impl Expansion for Paper {
    fn truncation(&self) -> usize {
        self.truncation
    }

    fn multipole_len(&self) -> usize {
        self.harmonics.len() * ENTRIES
    }

    fn local_len(&self) -> usize {
        self.multipole_len()
    }

    fn parities(&self) -> &[u8] {
        &self.parities
    }

    fn m2l_operator(&self, offset: [i32; 3]) -> Operator {
        let d = displacement(offset);
        let len = self.harmonics.len();
        let (mut half, mut matrix) = (vec![0.0; len * len], vec![0.0; len * len]);
        self.harmonics.inverse.apply_transposed(len, &self.taylor(d), &mut half);
        for (from, to) in half.chunks_exact(len).zip(matrix.chunks_exact_mut(len)) {
            self.harmonics.inverse.apply_transposed(1, from, to);
        }
        matrix.iter_mut().for_each(|x| *x /= PI);
        Operator::mixed(len, len, matrix, paired_translation(d.map(|x| -x)))
    }
}

impl<const C: usize> InColours<C> for Paper {
    fn p2m(&self, positions: &[[f64; 3]], normals: &[[f64; 3]], strengths: &[[f64; C]], multipole: &mut [[f64; C]]) {
        let mut sums = vec![[0.0; C]; table_len(self.truncation + 2)];
        gather(&self.monomials, positions, normals, strengths, &mut sums);
        let mut moments = self.zeros(C);
        self.assembly.apply(C, sums.as_flattened(), &mut moments);
        self.harmonics.forward.apply(ENTRIES * C, &moments, multipole.as_flattened_mut());
    }

    fn m2m(&self, octant: usize, child: &[[f64; C]], parent: &mut [[f64; C]]) {
        let mut moments = self.zeros(C);
        self.harmonics.inverse.apply(ENTRIES * C, child.as_flattened(), &mut moments);
        self.shift.up(octant, ENTRIES * C, &mut moments);
        let mut moved = self.zeros(C);
        self.harmonics.forward.apply(ENTRIES * C, &moments, &mut moved);
        for (from, to) in moved.chunks_exact(ENTRIES * C).zip(parent.chunks_exact_mut(ENTRIES)) {
            self.translations[octant].apply(C, from, to.as_flattened_mut());
        }
    }

    fn l2l(&self, octant: usize, parent: &[[f64; C]], child: &mut [[f64; C]]) {
        let mut moved = self.zeros(C);
        for (from, to) in parent.chunks_exact(ENTRIES).zip(moved.chunks_exact_mut(ENTRIES * C)) {
            self.translations[octant].apply_transposed(C, from.as_flattened(), to);
        }
        let mut field = self.zeros(C);
        self.harmonics.forward.apply_transposed(ENTRIES * C, &moved, &mut field);
        self.shift.down(octant, ENTRIES * C, &mut field);
        self.harmonics.inverse.apply_transposed(ENTRIES * C, &field, child.as_flattened_mut());
    }

    fn l2p(&self, local: &[[f64; C]], positions: &[[f64; 3]], normals: &[[f64; 3]], irradiance: &mut [[f64; C]]) {
        let mut field = self.zeros(C);
        self.harmonics.forward.apply_transposed(ENTRIES * C, local.as_flattened(), &mut field);
        let mut table = vec![[0.0; C]; table_len(self.truncation + 2)];
        self.assembly.apply_transposed(C, &field, table.as_flattened_mut());
        scatter(&self.monomials, &table, positions, normals, irradiance);
    }

    /// r^(-2n) Q_a(x) is Q_a at the inverted point x / r^2, where all is polynomial again.
    fn m2p(&self, multipole: &[[f64; C]], positions: &[[f64; 3]], normals: &[[f64; 3]], irradiance: &mut [[f64; C]]) {
        let weighted = self.weighted(C, multipole.as_flattened());
        let mut field = self.zeros(C);
        self.harmonics.forward.apply_transposed(ENTRIES * C, &weighted, &mut field);
        for (assembly, power) in self.assembly_by_power.iter().zip(INVERTED) {
            let mut table = vec![[0.0; C]; table_len(self.truncation + 2)];
            assembly.apply_transposed(C, &field, table.as_flattened_mut());
            let (x, n) = inverted(positions, normals, power);
            scatter(&self.monomials, &table, &x, &n, irradiance);
        }
    }

    fn p2l(&self, positions: &[[f64; 3]], normals: &[[f64; 3]], strengths: &[[f64; C]], local: &mut [[f64; C]]) {
        let mut moments = self.zeros(C);
        for (assembly, power) in self.assembly_by_power.iter().zip(INVERTED) {
            let mut sums = vec![[0.0; C]; table_len(self.truncation + 2)];
            let (y, n) = inverted(positions, normals, power);
            gather(&self.monomials, &y, &n, strengths, &mut sums);
            assembly.apply(C, sums.as_flattened(), &mut moments);
        }
        let mut coefficients = self.zeros(C);
        self.harmonics.forward.apply(ENTRIES * C, &moments, &mut coefficients);
        let weighted = self.weighted(C, &coefficients);
        local.as_flattened_mut().iter_mut().zip(weighted).for_each(|(out, x)| *out += x);
    }
}

/// Points x / r^2, and normals times r^power.
fn inverted(positions: &[[f64; 3]], normals: &[[f64; 3]], power: i32) -> (Vec<[f64; 3]>, Vec<[f64; 3]>) {
    let square = |x: &[f64; 3]| x.iter().map(|x| x * x).sum::<f64>();
    let points = positions.iter().map(|x| x.map(|x_i| x_i / square(x)));
    let scaled = positions.iter().zip(normals).map(|(x, n)| {
        let factor = square(x).powi(power / 2);
        n.map(|n_i| n_i * factor)
    });
    (points.collect(), scaled.collect())
}
