// SPDX-License-Identifier: GPL-3.0-or-later
//! Eigenvectors of small symmetric matrices by Jacobi rotations.

/// Sweeps after which the iteration stops in any case; six to ten are usual.
const SWEEPS: usize = 40;

/// Eigenvalues with their unit eigenvectors, greatest first. `matrix` is symmetric, `[n][n]`.
pub fn eigenpairs(n: usize, mut matrix: Vec<f64>) -> Vec<(f64, Vec<f64>)> {
    let mut vectors = vec![0.0; n * n];
    (0..n).for_each(|i| vectors[i * n + i] = 1.0);
    for _ in 0..SWEEPS {
        if !sweep(n, &mut matrix, &mut vectors) {
            break;
        }
    }
    let mut pairs: Vec<_> =
        vectors.chunks_exact(n.max(1)).enumerate().map(|(i, vector)| (matrix[i * n + i], vector.to_vec())).collect();
    pairs.sort_by(|a, b| b.0.total_cmp(&a.0));
    pairs
}

/// One rotation for every pair of rows; says whether any was needed.
fn sweep(n: usize, matrix: &mut [f64], vectors: &mut [f64]) -> bool {
    let mut changed = false;
    for p in 0..n {
        for q in p + 1..n {
            let (a_pp, a_qq, a_pq) = (matrix[p * n + p], matrix[q * n + q], matrix[p * n + q]);
            if a_pq.abs() <= f64::EPSILON * (a_pp * a_qq).abs().sqrt() {
                continue;
            }
            let theta = (a_qq - a_pp) / (2.0 * a_pq);
            let t = 1f64.copysign(theta) / (theta.abs() + theta.hypot(1.0));
            let c = 1.0 / t.hypot(1.0);
            let s = t * c;
            rotate_columns(n, matrix, p, q, c, s);
            rotate_rows(n, matrix, p, q, c, s);
            rotate_rows(n, vectors, p, q, c, s);
            changed = true;
        }
    }
    changed
}

fn rotate_columns(n: usize, matrix: &mut [f64], p: usize, q: usize, c: f64, s: f64) {
    for row in matrix.chunks_exact_mut(n) {
        (row[p], row[q]) = (c * row[p] - s * row[q], s * row[p] + c * row[q]);
    }
}

fn rotate_rows(n: usize, matrix: &mut [f64], p: usize, q: usize, c: f64, s: f64) {
    let (low, high) = matrix.split_at_mut(q * n);
    for (x, y) in low[p * n..p * n + n].iter_mut().zip(&mut high[..n]) {
        (*x, *y) = (c * *x - s * *y, s * *x + c * *y);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn vectors_diagonalise(n in 0usize..12, seed in proptest::collection::vec(-1.0..1.0, 144)) {
            let entry = |i: usize, j: usize| seed[i.min(j) * 12 + i.max(j)];
            let matrix = (0..n * n).map(|k| entry(k / n, k % n)).collect();
            let pairs = eigenpairs(n, matrix);
            for (value, vector) in &pairs {
                for i in 0..n {
                    let product: f64 = (0..n).map(|j| entry(i, j) * vector[j]).sum();
                    prop_assert!((product - value * vector[i]).abs() < 1e-12);
                }
            }
            prop_assert!(pairs.windows(2).all(|pair| pair[0].0 >= pair[1].0));
        }
    }
}
