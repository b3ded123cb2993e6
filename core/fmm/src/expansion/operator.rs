// SPDX-License-Identifier: GPL-3.0-or-later
//! One multipole-to-local translation, applied to many boxes at once.

use super::gemm::{multiply, multiply_single};
use super::sparse::Sparse;

/// The translation between boxes a fixed offset apart: a dense matrix over the basis, and for
/// expansions with several entries a basis function, a small matrix over those entries.
///
/// As one matrix it is the Kronecker product of the two, `[basis][entry]` in, `[basis][entry]` out.
#[derive(Clone, Debug)]
pub struct Operator {
    rows: usize,
    columns: usize,
    matrix: Matrix,
    mixing: Option<Sparse>,
}

#[derive(Clone, Debug)]
enum Matrix {
    Double(Vec<f64>),
    Single(Vec<f32>),
}

impl Operator {
    /// An operator from a dense row-major matrix, `[rows][columns]`.
    pub fn dense(rows: usize, columns: usize, matrix: Vec<f64>) -> Self {
        debug_assert_eq!(matrix.len(), rows * columns);
        Self { rows, columns, matrix: Matrix::Double(matrix), mixing: None }
    }

    /// The Kronecker product of a dense matrix with a square `mixing` of the entries.
    pub(crate) fn mixed(rows: usize, columns: usize, matrix: Vec<f64>, mixing: Sparse) -> Self {
        Self { mixing: Some(mixing), ..Self::dense(rows, columns, matrix) }
    }

    /// The same operator with its products in single precision: half the memory, about twice the
    /// speed, and relative errors of some 1e-7.
    pub fn in_single_precision(self) -> Self {
        let matrix = match self.matrix {
            Matrix::Double(matrix) => matrix.into_iter().map(|x| x as f32).collect(),
            Matrix::Single(matrix) => matrix,
        };
        Self { matrix: Matrix::Single(matrix), ..self }
    }

    /// Entries that go with one basis function.
    fn entries(&self) -> usize {
        self.mixing.as_ref().map_or(1, Sparse::rows)
    }

    /// Multiplications and additions for one right-hand side.
    pub fn flops(&self) -> usize {
        let mixed = self.mixing.as_ref().map_or(0, Sparse::nonzeros);
        2 * (self.rows * self.columns * self.entries() + self.columns * mixed)
    }

    /// Bytes that the operator keeps.
    pub fn bytes(&self) -> usize {
        match &self.matrix {
            Matrix::Double(matrix) => size_of_val(matrix.as_slice()),
            Matrix::Single(matrix) => size_of_val(matrix.as_slice()),
        }
    }

    /// locals += self multipoles, for `width` right-hand sides (three colours a pair of boxes).
    ///
    /// `multipoles` is `[multipole coefficient][width]`, `locals` is `[local coefficient][width]`,
    /// both in box coordinates for boxes of half side 1. Widths that are a multiple of 48
    /// (16 pairs), or 96 in single precision, are the fastest.
    pub fn apply(&self, width: usize, multipoles: &[f64], locals: &mut [f64]) {
        let Some(mixing) = &self.mixing else {
            return self.multiply(width, multipoles, locals);
        };
        let row = mixing.rows() * width;
        let mut mixed = vec![0.0; self.columns * row];
        for (from, to) in multipoles.chunks_exact(row).zip(mixed.chunks_exact_mut(row)) {
            mixing.apply(width, from, to);
        }
        self.multiply(row, &mixed, locals);
    }

    fn multiply(&self, width: usize, from: &[f64], to: &mut [f64]) {
        match &self.matrix {
            Matrix::Double(matrix) => multiply(self.columns, matrix, width, from, to),
            Matrix::Single(matrix) => multiply_single(self.columns, matrix, width, from, to),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn mixing_acts_within_each_row() {
        let swap = Sparse::from_rows([[(1, 1.0)], [(0, 2.0)]]);
        let operator = Operator::mixed(1, 2, vec![1.0, 10.0], swap);
        assert_eq!((operator.flops(), operator.bytes()), (2 * (4 + 4), 16));
        let mut out = vec![0.0; 2];
        operator.apply(1, &[1.0, 2.0, 3.0, 4.0], &mut out);
        assert_eq!(out, [42.0, 62.0]);
        let single = operator.in_single_precision();
        single.apply(1, &[1.0, 2.0, 3.0, 4.0], &mut out);
        assert_eq!(out, [84.0, 124.0]);
        assert_eq!(single.bytes(), 8);
    }
}
