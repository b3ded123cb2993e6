// SPDX-License-Identifier: GPL-3.0-or-later
//! Small sparse matrices that act on rows of several columns at once.

use multiversion::multiversion;

/// A sparse matrix in compressed rows.
///
/// It multiplies dense row-major arrays of shape `[rows][width]`; the width (colours, or the
/// entries of a source matrix times colours) is given at each product.
#[derive(Clone, Debug, Default)]
pub struct Sparse {
    starts: Vec<usize>,
    entries: Vec<(usize, f64)>,
}

impl Sparse {
    /// A matrix from its rows, each a list of (column, value). Zeros are dropped.
    pub fn from_rows<R>(rows: R) -> Self
    where
        R: IntoIterator,
        R::Item: IntoIterator<Item = (usize, f64)>,
    {
        let mut sparse = Self { starts: vec![0], entries: Vec::new() };
        for row in rows {
            sparse.entries.extend(row.into_iter().filter(|&(_, value)| value != 0.0));
            sparse.starts.push(sparse.entries.len());
        }
        sparse
    }

    pub fn rows(&self) -> usize {
        self.starts.len() - 1
    }

    /// The (column, value) pairs of one row.
    pub fn row(&self, row: usize) -> &[(usize, f64)] {
        &self.entries[self.starts[row]..self.starts[row + 1]]
    }

    /// output += self input; `input` is `[columns][width]`, `output` is `[rows][width]`.
    pub fn apply(&self, width: usize, input: &[f64], output: &mut [f64]) {
        apply(self, width, input, output);
    }

    /// output += self^T input; `input` is `[rows][width]`, `output` is `[columns][width]`.
    pub fn apply_transposed(&self, width: usize, input: &[f64], output: &mut [f64]) {
        apply_transposed(self, width, input, output);
    }
}

/// [`Sparse::apply`] for the widths that matter, one or three colours and a source matrix in as many, with the sums in
/// registers.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx2+fma", "x86_64+avx2+fma"))]
fn apply(sparse: &Sparse, width: usize, input: &[f64], output: &mut [f64]) {
    match width {
        1 => apply_fixed::<1>(sparse, input, output),
        3 => apply_fixed::<3>(sparse, input, output),
        16 => apply_fixed::<16>(sparse, input, output),
        48 => apply_fixed::<48>(sparse, input, output),
        _ => {
            for (row, out) in output.chunks_exact_mut(width).enumerate() {
                for &(column, value) in sparse.row(row) {
                    add_scaled(value, &input[column * width..][..width], out);
                }
            }
        }
    }
}

#[inline(always)]
fn apply_fixed<const WIDTH: usize>(sparse: &Sparse, input: &[f64], output: &mut [f64]) {
    let (input, output) = (input.as_chunks::<WIDTH>().0, output.as_chunks_mut::<WIDTH>().0);
    for (row, out) in output.iter_mut().enumerate() {
        let mut sum = *out;
        for &(column, value) in sparse.row(row) {
            let from = &input[column];
            for k in 0..WIDTH {
                sum[k] += value * from[k];
            }
        }
        *out = sum;
    }
}

#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx2+fma", "x86_64+avx2+fma"))]
fn apply_transposed(sparse: &Sparse, width: usize, input: &[f64], output: &mut [f64]) {
    match width {
        1 => apply_transposed_fixed::<1>(sparse, input, output),
        3 => apply_transposed_fixed::<3>(sparse, input, output),
        16 => apply_transposed_fixed::<16>(sparse, input, output),
        48 => apply_transposed_fixed::<48>(sparse, input, output),
        _ => {
            for (row, from) in input.chunks_exact(width).enumerate() {
                for &(column, value) in sparse.row(row) {
                    add_scaled(value, from, &mut output[column * width..][..width]);
                }
            }
        }
    }
}

#[inline(always)]
fn apply_transposed_fixed<const WIDTH: usize>(sparse: &Sparse, input: &[f64], output: &mut [f64]) {
    let (input, output) = (input.as_chunks::<WIDTH>().0, output.as_chunks_mut::<WIDTH>().0);
    for (row, from) in input.iter().enumerate() {
        for &(column, value) in sparse.row(row) {
            let out = &mut output[column];
            for k in 0..WIDTH {
                out[k] += value * from[k];
            }
        }
    }
}

/// output += value * input.
#[inline(always)]
pub fn add_scaled(value: f64, input: &[f64], output: &mut [f64]) {
    for (out, x) in output.iter_mut().zip(input) {
        *out += value * x;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn products_and_transposed_products() {
        let sparse = Sparse::from_rows([vec![(0, 2.0), (2, -1.0)], vec![(1, 3.0), (0, 0.0)]]);
        let mut out = vec![0.0; 4];
        sparse.apply(2, &[1.0, 2.0, 3.0, 4.0, 5.0, 6.0], &mut out);
        assert_eq!(out, [-3.0, -2.0, 9.0, 12.0]);
        let mut back = vec![0.0; 6];
        sparse.apply_transposed(2, &[1.0, 2.0, 3.0, 4.0], &mut back);
        assert_eq!(back, [2.0, 4.0, 9.0, 12.0, -1.0, -2.0]);
        assert_eq!((sparse.rows(), sparse.row(0).len(), sparse.row(1).len()), (2, 2, 1));
    }
}
