// SPDX-License-Identifier: GPL-3.0-or-later
//! A small matrix product for tall stacks of right-hand sides.

use multiversion::multiversion;
use multiversion::target::target_cfg_f;

/// Rows of the matrix handled together.
const ROWS: usize = 4;
/// Columns handled together: they fill 24 registers of AVX-512.
const TILE: usize = 48;

type Tile = [f64; TILE];

/// c += a b, with a `[rows][depth]`, b `[depth][width]` and c `[rows][width]`, all row-major.
pub fn multiply(depth: usize, a: &[f64], width: usize, b: &[f64], c: &mut [f64]) {
    let mut panel = Vec::with_capacity(depth);
    for start in (0..width).step_by(TILE) {
        let columns = TILE.min(width - start);
        panel.clear();
        panel.extend(b.chunks_exact(width).map(|row| {
            let mut tile = [0.0; TILE];
            tile[..columns].copy_from_slice(&row[start..start + columns]);
            tile
        }));
        for (i, rows) in a.chunks(depth * ROWS).enumerate() {
            let mut product = [[0.0; TILE]; ROWS];
            multiply_panel(rows, &panel, &mut product);
            for (r, product) in product.iter().enumerate().take(rows.len() / depth) {
                let out = &mut c[(i * ROWS + r) * width + start..][..columns];
                out.iter_mut().zip(product).for_each(|(c, p)| *c += p);
            }
        }
    }
}

/// Four rows times one panel.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx2+fma", "x86_64+avx2+fma"))]
fn multiply_panel(rows: &[f64], panel: &[Tile], product: &mut [Tile; ROWS]) {
    let (wide, fused) = (target_cfg_f!(target_feature = "avx512f"), target_cfg_f!(target_feature = "fma"));
    match (wide, fused) {
        (true, _) => multiply_tile::<48, true>(rows, panel, product),
        (_, true) => multiply_tile::<12, true>(rows, panel, product),
        _ => multiply_tile::<4, false>(rows, panel, product),
    }
}

/// The product of at most [`ROWS`] rows with one panel, `PART` columns in registers at a time.
#[inline(always)]
fn multiply_tile<const PART: usize, const FUSED: bool>(rows: &[f64], panel: &[Tile], product: &mut [Tile; ROWS]) {
    let depth = panel.len();
    let row = |r: usize| rows.get(r * depth..(r + 1) * depth).unwrap_or(&rows[..depth]);
    let (a, b, c, d) = (row(0), row(1), row(2), row(3));
    for part in (0..TILE).step_by(PART) {
        let mut sums = [[0.0; PART]; ROWS];
        for ((((tile, &a), &b), &c), &d) in panel.iter().zip(a).zip(b).zip(c).zip(d) {
            let tile = &tile[part..part + PART];
            for l in 0..PART {
                for (sum, factor) in sums.iter_mut().zip([a, b, c, d]) {
                    sum[l] = match FUSED {
                        true => factor.mul_add(tile[l], sum[l]),
                        false => factor * tile[l] + sum[l],
                    };
                }
            }
        }
        for (product, sum) in product.iter_mut().zip(&sums) {
            product[part..part + PART].copy_from_slice(sum);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Entry (i, k) of a matrix with nothing special about it.
    fn entry(i: usize, k: usize) -> f64 {
        ((i * 7 + k * 13) % 11) as f64 - 5.0
    }

    /// Whatever the machine, all kernels that another one may choose.
    #[test]
    fn kernels_agree() {
        let rows: Vec<f64> = (0..3 * 7).map(|n| entry(n, 2)).collect();
        let panel: Vec<Tile> = (0..7).map(|k| std::array::from_fn(|j| entry(j, k))).collect();
        let mut products = [[[0.0; TILE]; ROWS]; 3];
        multiply_tile::<48, true>(&rows, &panel, &mut products[0]);
        multiply_tile::<12, true>(&rows, &panel, &mut products[1]);
        multiply_tile::<4, false>(&rows, &panel, &mut products[2]);
        assert_eq!(products[0], products[1]);
        assert_eq!(products[0], products[2]);
    }

    proptest! {
        #[test]
        fn products_of_small_integers_are_exact(
            rows in 1usize..12, depth in 1usize..9, width in 1usize..120,
        ) {
            let a: Vec<f64> = (0..rows * depth).map(|n| entry(n / depth, n % depth)).collect();
            let b: Vec<f64> = (0..depth * width).map(|n| entry(n % width, n / width)).collect();
            let mut c = vec![1.0; rows * width];
            multiply(depth, &a, width, &b, &mut c);
            for (n, &c) in c.iter().enumerate() {
                let (i, j) = (n / width, n % width);
                let sum: f64 = (0..depth).map(|k| entry(i, k) * entry(j, k)).sum();
                prop_assert_eq!(c, 1.0 + sum);
            }
        }
    }
}
