// SPDX-License-Identifier: GPL-3.0-or-later
//! Source and receiver matrices of section 2.1, and how they change with the origin.
//!
//! The sixteen entries of SM(y), in this order:
//!
//! ```text
//! A_ij = n_i y_j   at 3 i + j        (the paper's n r')
//! n_i              at 9 + i          (n)
//! b_j = (y.n) y_j  at 12 + j         (r' n r')
//! c = y.n          at 15             (r' n)
//! ```
//!
//! and (eq 2) is the bilinear form
//!
//! ```text
//! (n_y.d)(-n_x.d) = sum_ij x_i n_xj A_ij - sum_i (x.n_x) x_i n_i - sum_j n_xj b_j + (x.n_x) c
//! ```
//!
//! in which the factors at x are again entries of SM, at x: RM = P SM with the signed permutation
//! P of [`receiver`]. So sources and receivers share one set of operators.

use super::simplex::{Exponent, exponents, index, raised};
use super::sparse::Sparse;

/// Entries of a source matrix.
pub const ENTRIES: usize = 16;
const N: usize = 9;
const B: usize = 12;
const C: usize = 15;

/// The entries by the power of r that y adds to them: n has none, A and c one, b two.
pub const POWERS: [&[usize]; 3] = [&[9, 10, 11], &[0, 1, 2, 3, 4, 5, 6, 7, 8, 15], &[12, 13, 14]];

/// RM_k(x) = sign SM_k'(x): (k', sign), the rows of P. P is symmetric.
pub fn receiver(k: usize) -> (usize, f64) {
    match k {
        0..N => (3 * (k % 3) + k / 3, 1.0),
        N..B => (k + 3, -1.0),
        B..C => (k - 3, -1.0),
        _ => (k, 1.0),
    }
}

/// P alone, as a matrix.
pub fn receivers() -> Sparse {
    Sparse::from_rows((0..ENTRIES).map(|k| [receiver(k)]))
}

/// SM about another origin and in another scale: row k of the matrix that takes SM(y) to
/// SM(scale (y + o)).
pub fn translated(k: usize, o: [f64; 3], scale: f64) -> Vec<(usize, f64)> {
    let axes = 0..3;
    match k {
        0..N => {
            let (i, j) = (k / 3, k % 3);
            vec![(k, scale), (N + i, scale * o[j])]
        }
        N..B => vec![(k, 1.0)],
        B..C => {
            let (j, scale) = (k - B, scale * scale);
            let inner = axes.clone().map(|i| (3 * i + j, scale * o[i]));
            let outer = axes.map(|i| (N + i, scale * o[j] * o[i]));
            [(k, scale), (C, scale * o[j])].into_iter().chain(inner).chain(outer).collect()
        }
        _ => {
            let shift = axes.map(|i| (N + i, scale * o[i]));
            [(C, scale)].into_iter().chain(shift).collect()
        }
    }
}

/// TM: SM(y) to SM(scale (y + o)).
pub fn translation(o: [f64; 3], scale: f64) -> Sparse {
    Sparse::from_rows((0..ENTRIES).map(|k| translated(k, o, scale)))
}

/// P TM: source matrices about one origin to factors of the SM(x) about another,
/// that lies at -o in the coordinates of the first.
pub fn paired_translation(o: [f64; 3]) -> Sparse {
    Sparse::from_rows((0..ENTRIES).map(|k| {
        let (from, sign) = receiver(k);
        translated(from, o, 1.0).into_iter().map(move |(column, value)| (column, sign * value))
    }))
}

/// x^alpha SM_k in terms of vector moments x^gamma n_i: rows (alpha, k) for |alpha| <= `degree`,
/// columns (gamma, i) for |gamma| <= degree + 2. Rows of entries not in `entries` are empty.
pub fn assembly(degree: usize, entries: &[usize]) -> Sparse {
    let row = |alpha: Exponent, k: usize| match entries.contains(&k) {
        true => vector_moments(alpha, k),
        false => Vec::new(),
    };
    let rows = exponents(degree).into_iter().flat_map(|a| (0..ENTRIES).map(move |k| (a, k)));
    Sparse::from_rows(rows.map(|(alpha, k)| row(alpha, k)))
}

fn vector_moments(alpha: Exponent, k: usize) -> Vec<(usize, f64)> {
    let place = |gamma: Exponent, i: usize| (index(gamma) * 3 + i, 1.0);
    let dotted = |gamma: Exponent| (0..3).map(|i| place(raised(gamma, i), i)).collect();
    match k {
        0..N => vec![place(raised(alpha, k % 3), k / 3)],
        N..B => vec![place(alpha, k - N)],
        B..C => dotted(raised(alpha, k - B)),
        _ => dotted(alpha),
    }
}

/// Reflections that change the sign of an entry: bit `axis` for each axis of which it is odd.
pub fn parity(k: usize) -> u8 {
    match k {
        0..N => (1 << (k / 3)) ^ (1 << (k % 3)),
        N..B => 1 << (k - N),
        B..C => 1 << (k - B),
        _ => 0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::array::uniform3;
    use proptest::prelude::*;

    fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
        a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
    }

    fn source_matrix(y: [f64; 3], n: [f64; 3]) -> Vec<f64> {
        let a = (0..9).map(|k| n[k / 3] * y[k % 3]);
        a.chain(n).chain(y.map(|y_j| dot(y, n) * y_j)).chain([dot(y, n)]).collect()
    }

    proptest! {
        #[test]
        fn pairing_gives_the_numerator(
            x in uniform3(-2.0..2.0), y in uniform3(-2.0..2.0),
            n_x in uniform3(-1.0..1.0), n_y in uniform3(-1.0..1.0),
        ) {
            let (receivers, sources) = (source_matrix(x, n_x), source_matrix(y, n_y));
            let pair = |k: usize| { let (to, sign) = receiver(k); sign * receivers[to] };
            let sum: f64 = (0..ENTRIES).map(|k| pair(k) * sources[k]).sum();
            let d = std::array::from_fn(|i| x[i] - y[i]);
            prop_assert!((sum + dot(n_y, d) * dot(n_x, d)).abs() < 1e-12);
        }

        #[test]
        fn translation_moves_the_origin(
            y in uniform3(-2.0..2.0), n in uniform3(-1.0..1.0), o in uniform3(-2.0..2.0),
            scale in 0.1..2.0,
        ) {
            let moved = std::array::from_fn(|i| scale * (y[i] + o[i]));
            let mut translated = vec![0.0; ENTRIES];
            translation(o, scale).apply(1, &source_matrix(y, n), &mut translated);
            for (a, b) in translated.iter().zip(source_matrix(moved, n)) {
                prop_assert!((a - b).abs() < 1e-12);
            }
        }
    }
}
