// SPDX-License-Identifier: GPL-3.0-or-later
//! One multipole-to-local translation, applied to many boxes at once.

use super::gemm::multiply;
use super::sparse::Sparse;

/// The translation between boxes a fixed offset apart: a dense matrix over the basis, and for
/// expansions with several entries a basis function, a small matrix over those entries.
///
/// As one matrix it is the Kronecker product of the two, `[basis][entry]` in, `[basis][entry]` out.
#[derive(Clone, Debug)]
pub struct Operator {
    columns: usize,
    matrix: Vec<f64>,
    mixing: Option<Sparse>,
}

impl Operator {
    /// An operator from a dense row-major matrix, `[rows][columns]`.
    pub fn dense(rows: usize, columns: usize, matrix: Vec<f64>) -> Self {
        debug_assert_eq!(matrix.len(), rows * columns);
        Self { columns, matrix, mixing: None }
    }

    /// The Kronecker product of a dense matrix with a square `mixing` of the entries.
    pub(crate) fn mixed(rows: usize, columns: usize, matrix: Vec<f64>, mixing: Sparse) -> Self {
        Self { mixing: Some(mixing), ..Self::dense(rows, columns, matrix) }
    }

    /// locals += self multipoles, for `width` right-hand sides (the colours of each pair of boxes).
    ///
    /// `multipoles` is `[multipole coefficient][width]`, `locals` is `[local coefficient][width]`,
    /// both in box coordinates for boxes of half side 1. Widths that are a multiple of 48
    /// are the fastest.
    pub fn apply(&self, width: usize, multipoles: &[f64], locals: &mut [f64]) {
        let Some(mixing) = &self.mixing else {
            return multiply(self.columns, &self.matrix, width, multipoles, locals);
        };
        let row = mixing.rows() * width;
        let mut mixed = vec![0.0; self.columns * row];
        for (from, to) in multipoles.chunks_exact(row).zip(mixed.chunks_exact_mut(row)) {
            mixing.apply(width, from, to);
        }
        multiply(self.columns, &self.matrix, row, &mixed, locals);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn mixing_acts_within_each_row() {
        let swap = Sparse::from_rows([[(1, 1.0)], [(0, 2.0)]]);
        let operator = Operator::mixed(1, 2, vec![1.0, 10.0], swap);
        let mut out = vec![0.0; 2];
        operator.apply(1, &[1.0, 2.0, 3.0, 4.0], &mut out);
        assert_eq!(out, [42.0, 62.0]);
    }
}
