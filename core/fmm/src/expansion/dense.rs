// SPDX-License-Identifier: GPL-3.0-or-later
//! Products of small dense matrices, all row-major.

use super::gemm::multiply;
use multiversion::multiversion;

/// a b, with b of `depth` rows.
pub fn product(a: &[f64], b: &[f64], depth: usize) -> Vec<f64> {
    let (rows, width) = (a.len() / depth, b.len() / depth);
    let mut out = vec![0.0; rows * width];
    multiply(depth, a, width, b, &mut out);
    out
}

/// a b^T, both of rows of `width`.
pub fn products_of_rows(a: &[f64], b: &[f64], width: usize) -> Vec<f64> {
    product(a, &transposed(width, b), width)
}

/// outer inner outer^T, with outer `[rows][width]` and inner `[width][width]`.
pub fn sandwiched(outer: &[f64], inner: &[f64], width: usize) -> Vec<f64> {
    let half = products_of_rows(inner, outer, width);
    product(outer, &half, width)
}

pub fn transposed(width: usize, matrix: &[f64]) -> Vec<f64> {
    let rows = matrix.len() / width;
    (0..width).flat_map(|j| (0..rows).map(move |i| matrix[i * width + j])).collect()
}

pub fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// output += matrix^T input, for C colours; `matrix` is `[len][len]`, the others `[len][colour]`.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx2+fma", "x86_64+avx2+fma"))]
pub fn add_product<const C: usize>(matrix: &[f64], input: &[[f64; C]], output: &mut [[f64; C]]) {
    /// Outputs handled together.
    const LANES: usize = 16;
    let len = input.len();
    for (block, out) in output.chunks_mut(LANES).enumerate() {
        let mut sums = [[0.0; LANES]; C];
        for (row, from) in matrix.chunks_exact(len).zip(input) {
            let row = &row[block * LANES..][..out.len()];
            let mut lanes = [0.0; LANES];
            match <&[f64; LANES]>::try_from(row) {
                Ok(full) => lanes = *full,
                Err(_) => lanes[..row.len()].copy_from_slice(row),
            }
            for (sum, x) in sums.iter_mut().zip(from) {
                for l in 0..LANES {
                    sum[l] += lanes[l] * x;
                }
            }
        }
        for (l, out) in out.iter_mut().enumerate() {
            (0..C).for_each(|c| out[c] += sums[c][l]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn products_agree() {
        let (a, b) = ([1.0, 2.0, 3.0, 4.0], [5.0, 6.0, 7.0, 8.0]);
        assert_eq!(product(&a, &b, 2), [19.0, 22.0, 43.0, 50.0]);
        assert_eq!(products_of_rows(&a, &transposed(2, &b), 2), product(&a, &b, 2));
        let expected = products_of_rows(&product(&a, &b, 2), &a, 2);
        assert_eq!(sandwiched(&a, &b, 2), expected);
    }

    #[test]
    fn transposed_product_of_three_colours() {
        for len in [1, 15, 16, 17, 40] {
            let matrix: Vec<f64> = (0..len * len).map(|k| (k % 7) as f64 - 3.0).collect();
            let input: Vec<[f64; 3]> = (0..len).map(|k| [k as f64, 1.0, -(k as f64)]).collect();
            let mut output = vec![[1.0; 3]; len];
            add_product(&matrix, &input, &mut output);
            for (j, out) in output.iter().enumerate() {
                for c in 0..3 {
                    let sum: f64 = (0..len).map(|i| matrix[i * len + j] * input[i][c]).sum();
                    assert_eq!(out[c], 1.0 + sum);
                }
            }
        }
    }
}
