// SPDX-License-Identifier: GPL-3.0-or-later
//! The direct sum over all sources: H(x) = sum over y of K(x, y) q(y), with q = weight * radiosity.

use crate::error::{Error, same_length};
use multiversion::multiversion;
use rayon::prelude::*;
use std::f64::consts::PI;

/// Sources a vector register wide; padding sources have no strength.
const LANES: usize = 8;
/// Receivers that share one pass over the sources.
const ROWS: usize = 4;

/// The point sources of a direct sum, one array a component, padded to whole blocks.
#[derive(Debug, Clone)]
pub struct Sources {
    count: usize,
    blocks: Vec<Block>,
}

#[derive(Debug, Clone, Copy)]
struct Block {
    y: [[f64; LANES]; 3],
    n_y: [[f64; LANES]; 3],
    softening: [f64; LANES],
}

/// Strengths q = weight * radiosity / pi in the blocks of `Sources`.
type Strengths = Vec<[[f64; LANES]; 3]>;

impl Sources {
    /// Sources at `positions` with unit `normals`; `softening` is the squared distance below which each one's
    /// kernel stops growing (see [`crate::kernel`]).
    pub fn new(positions: &[[f64; 3]], normals: &[[f64; 3]], softening: &[f64]) -> Result<Self, Error> {
        same_length("source normals", positions.len(), normals.len())?;
        same_length("source softening", positions.len(), softening.len())?;
        // Padding sits at the origin with softening 1: finite kernel, no normal, no strength.
        let empty = Block { y: [[0.0; LANES]; 3], n_y: [[0.0; LANES]; 3], softening: [1.0; LANES] };
        let mut blocks = vec![empty; positions.len().div_ceil(LANES)];
        for j in 0..positions.len() {
            let (block, lane) = (&mut blocks[j / LANES], j % LANES);
            for axis in 0..3 {
                block.y[axis][lane] = positions[j][axis];
                block.n_y[axis][lane] = normals[j][axis];
            }
            block.softening[lane] = softening[j];
        }
        Ok(Sources { count: positions.len(), blocks })
    }

    pub fn len(&self) -> usize {
        self.count
    }

    pub fn is_empty(&self) -> bool {
        self.count == 0
    }

    /// 64-bit words in one receiver's row of visibility bits.
    pub fn words(&self) -> usize {
        self.count.div_ceil(64)
    }

    fn strengths(&self, strengths: &[[f64; 3]]) -> Strengths {
        let mut blocks = vec![[[0.0; LANES]; 3]; self.blocks.len()];
        for (j, q) in strengths.iter().enumerate() {
            for colour in 0..3 {
                blocks[j / LANES][colour][j % LANES] = q[colour] / PI;
            }
        }
        blocks
    }

    /// Irradiance (M, 3) at the receivers from sources of the given strengths (N, 3).
    ///
    /// `visible` holds, when given, one row of [`Sources::words`] words a receiver: bit j % 64 of word j / 64 says
    /// that source j is seen. Without it every source in front of the horizon is.
    pub fn irradiance(
        &self,
        points: &[[f64; 3]],
        normals: &[[f64; 3]],
        strengths: &[[f64; 3]],
        visible: Option<&[u64]>,
    ) -> Result<Vec<[f64; 3]>, Error> {
        same_length("receiver normals", points.len(), normals.len())?;
        same_length("strengths", self.count, strengths.len())?;
        if let Some(bits) = visible {
            same_length("visibility words", points.len() * self.words(), bits.len())?;
        }
        let q = self.strengths(strengths);
        let words = self.words();
        let mut irradiance = vec![[0.0; 3]; points.len()];
        irradiance.par_chunks_mut(ROWS).enumerate().for_each(|(chunk, out)| {
            let rows = chunk * ROWS..chunk * ROWS + out.len();
            match visible {
                None => sum_all(&points[rows.clone()], &normals[rows], &self.blocks, &q, out),
                Some(bits) => {
                    let bits = &bits[rows.start * words..rows.end * words];
                    for (i, row) in rows.enumerate() {
                        let bits = &bits[i * words..(i + 1) * words];
                        sum_visible(points[row], normals[row], &self.blocks, &q, bits, &mut out[i]);
                    }
                }
            }
        });
        Ok(irradiance)
    }
}

/// The kernel times pi between one receiver and a block of sources (eq 1).
#[inline(always)]
fn block_kernel(x: [f64; 3], n_x: [f64; 3], block: &Block) -> [f64; LANES] {
    let mut k = [0.0; LANES];
    for l in 0..LANES {
        let d = [x[0] - block.y[0][l], x[1] - block.y[1][l], x[2] - block.y[2][l]];
        let r2 = d[2].mul_add(d[2], d[1].mul_add(d[1], d[0] * d[0]));
        let cos_y = d[2].mul_add(block.n_y[2][l], d[1].mul_add(block.n_y[1][l], d[0] * block.n_y[0][l]));
        let cos_x = -d[2].mul_add(n_x[2], d[1].mul_add(n_x[1], d[0] * n_x[0]));
        let r2 = if r2 > block.softening[l] { r2 } else { block.softening[l] };
        let cos_y = if cos_y > 0.0 { cos_y } else { 0.0 };
        let cos_x = if cos_x > 0.0 { cos_x } else { 0.0 };
        k[l] = cos_y * cos_x / (r2 * r2);
    }
    k
}

#[multiversion(targets("x86_64+avx512f+avx512dq+avx512vl+fma", "x86_64+avx2+fma", "aarch64+neon"))]
fn sum_all(x: &[[f64; 3]], n_x: &[[f64; 3]], blocks: &[Block], q: &Strengths, out: &mut [[f64; 3]]) {
    let mut sums = [[[0.0; LANES]; 3]; ROWS];
    for (block, q) in blocks.iter().zip(q) {
        for (row, sum) in sums.iter_mut().enumerate().take(x.len()) {
            let k = block_kernel(x[row], n_x[row], block);
            for colour in 0..3 {
                for l in 0..LANES {
                    sum[colour][l] = k[l].mul_add(q[colour][l], sum[colour][l]);
                }
            }
        }
    }
    for (out, sum) in out.iter_mut().zip(&sums) {
        *out = sum.map(|lanes| lanes.iter().sum());
    }
}

#[multiversion(targets("x86_64+avx512f+avx512dq+avx512vl+fma", "x86_64+avx2+fma", "aarch64+neon"))]
fn sum_visible(x: [f64; 3], n_x: [f64; 3], blocks: &[Block], q: &Strengths, bits: &[u64], out: &mut [f64; 3]) {
    let mut sums = [[0.0; LANES]; 3];
    for (b, (block, q)) in blocks.iter().zip(q).enumerate() {
        let byte = bits[b * LANES / 64] >> (b * LANES % 64) & 0xff;
        if byte == 0 {
            continue;
        }
        let mut k = block_kernel(x, n_x, block);
        for (l, k) in k.iter_mut().enumerate() {
            *k *= (byte >> l & 1) as f64;
        }
        for colour in 0..3 {
            for l in 0..LANES {
                sums[colour][l] = k[l].mul_add(q[colour][l], sums[colour][l]);
            }
        }
    }
    *out = sums.map(|lanes| lanes.iter().sum());
}
