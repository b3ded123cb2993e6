// SPDX-License-Identifier: GPL-3.0-or-later
//! The direct sum over all sources: H(x) = sum over y of K(x, y) q(y), with q = weight * radiosity.

use crate::error::{Error, same_length};
use pulp::{Arch, Simd, WithSimd};
use rayon::prelude::*;
use std::f64::consts::PI;

/// Arrays are padded to this many sources, the widest register; padding sources have no strength.
const LANES: usize = 8;
/// Receivers that share one pass over the sources.
const ROWS: usize = 4;

/// The point sources of a direct sum, one array a component.
#[derive(Debug, Clone)]
pub struct Sources {
    count: usize,
    y: [Vec<f64>; 3],
    n_y: [Vec<f64>; 3],
    softening: Vec<f64>,
}

impl Sources {
    /// Sources at `positions` with unit `normals`; `softening` is the squared distance below which each one's
    /// kernel stops growing (see [`crate::kernel`]).
    pub fn new(positions: &[[f64; 3]], normals: &[[f64; 3]], softening: &[f64]) -> Result<Self, Error> {
        same_length("source normals", positions.len(), normals.len())?;
        same_length("source softening", positions.len(), softening.len())?;
        // Padding has softening 1: its kernel is finite, and its strength is zero.
        let mut padded = softening.to_vec();
        padded.resize(softening.len().next_multiple_of(LANES), 1.0);
        Ok(Sources { count: positions.len(), y: columns(positions), n_y: columns(normals), softening: padded })
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
        let (q, words, arch) = (columns(strengths), self.words(), Arch::new());
        let mut irradiance = vec![[0.0; 3]; points.len()];
        irradiance.par_chunks_mut(ROWS).enumerate().for_each(|(chunk, out)| {
            let first = chunk * ROWS;
            if let (None, Some(x), Some(n_x)) = (visible, four(points, first), four(normals, first)) {
                out.copy_from_slice(&arch.dispatch(Sum { x, n_x, sources: self, q: &q, bits: None }));
                return;
            }
            for (row, out) in (first..).zip(out) {
                let bits = visible.map(|bits| &bits[row * words..(row + 1) * words]);
                [*out] = arch.dispatch(Sum { x: [points[row]], n_x: [normals[row]], sources: self, q: &q, bits });
            }
        });
        Ok(irradiance)
    }
}

/// One padded array a component.
fn columns(rows: &[[f64; 3]]) -> [Vec<f64>; 3] {
    [0, 1, 2].map(|axis| {
        let mut column: Vec<f64> = rows.iter().map(|row| row[axis]).collect();
        column.resize(rows.len().next_multiple_of(LANES), 0.0);
        column
    })
}

fn four(rows: &[[f64; 3]], first: usize) -> Option<[[f64; 3]; ROWS]> {
    rows.get(first..first + ROWS)?.try_into().ok()
}

/// For each byte of visibility bits its eight factors, 0 or 1.
static FACTORS: [[f64; LANES]; 256] = {
    let mut table = [[0.0; LANES]; 256];
    let mut byte = 0;
    while byte < 256 {
        let mut lane = 0;
        while lane < LANES {
            table[byte][lane] = (byte >> lane & 1) as f64;
            lane += 1;
        }
        byte += 1;
    }
    table
};

/// The sum over all sources for R receivers at once.
struct Sum<'a, const R: usize> {
    x: [[f64; 3]; R],
    n_x: [[f64; 3]; R],
    sources: &'a Sources,
    q: &'a [Vec<f64>; 3],
    bits: Option<&'a [u64]>,
}

impl<const R: usize> WithSimd for Sum<'_, R> {
    type Output = [[f64; 3]; R];

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Self::Output {
        let Sources { y, n_y, softening, .. } = self.sources;
        let y = y.each_ref().map(|column| S::as_simd_f64s(column).0);
        let n_y = n_y.each_ref().map(|column| S::as_simd_f64s(column).0);
        let q = self.q.each_ref().map(|column| S::as_simd_f64s(column).0);
        let softening = S::as_simd_f64s(softening).0;
        let x = self.x.map(|x| x.map(|c| simd.splat_f64s(c)));
        let n_x = self.n_x.map(|n| n.map(|c| simd.splat_f64s(c)));
        let zero = simd.splat_f64s(0.0);
        let per_byte = LANES / S::F64_LANES.min(LANES);
        let mut sums = [[zero; 3]; R];
        for v in 0..softening.len() {
            let mut seen = None;
            if let Some(bits) = self.bits {
                let byte = v / per_byte;
                let factors = &FACTORS[(bits[byte / 8] >> (byte % 8 * 8) & 0xff) as usize];
                seen = Some(S::as_simd_f64s(factors).0[v % per_byte]);
            }
            for i in 0..R {
                // (eq 1) without its 1 / pi.
                let d = [0, 1, 2].map(|axis| simd.sub_f64s(x[i][axis], y[axis][v]));
                let r2 = simd.max_f64s(dot(simd, d, d), softening[v]);
                let cos_y = simd.max_f64s(dot(simd, d, n_y.map(|n| n[v])), zero);
                let cos_x = simd.min_f64s(dot(simd, d, n_x[i]), zero);
                let mut k = simd.div_f64s(simd.mul_f64s(cos_y, cos_x), simd.mul_f64s(r2, r2));
                if let Some(seen) = seen {
                    k = simd.mul_f64s(k, seen);
                }
                for colour in 0..3 {
                    sums[i][colour] = simd.mul_add_e_f64s(k, q[colour][v], sums[i][colour]);
                }
            }
        }
        sums.map(|sum| sum.map(|lanes| simd.reduce_sum_f64s(lanes) / -PI))
    }
}

#[inline(always)]
fn dot<S: Simd>(simd: S, a: [S::f64s; 3], b: [S::f64s; 3]) -> S::f64s {
    simd.mul_add_e_f64s(a[2], b[2], simd.mul_add_e_f64s(a[1], b[1], simd.mul_f64s(a[0], b[0])))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn vector() -> impl Strategy<Value = [f64; 3]> {
        [-1.0..1.0, -1.0..1.0, -1.0..1.0]
    }

    fn unit() -> impl Strategy<Value = [f64; 3]> {
        vector().prop_filter_map("has a direction", |v| glam::DVec3::from(v).try_normalize().map(Into::into))
    }

    proptest! {
        #[test]
        fn sum_equals_the_kernel_summed_one_by_one(
            sources in prop::collection::vec((vector(), unit(), [0.0..1.0, 0.0..1.0, 0.0..1.0], any::<bool>()), 1..150),
            receivers in prop::collection::vec((vector(), unit()), 1..11),
        ) {
            let softening = vec![1e-4; sources.len()];
            let y: Vec<_> = sources.iter().map(|s| s.0).collect();
            let n_y: Vec<_> = sources.iter().map(|s| s.1).collect();
            let q: Vec<_> = sources.iter().map(|s| s.2).collect();
            let (x, n_x): (Vec<_>, Vec<_>) = receivers.iter().copied().unzip();
            let direct = Sources::new(&y, &n_y, &softening).unwrap();
            let mut row = vec![0u64; direct.words()];
            for (j, s) in sources.iter().enumerate() {
                row[j / 64] |= (s.3 as u64) << (j % 64);
            }
            let all = direct.irradiance(&x, &n_x, &q, None).unwrap();
            let seen = direct.irradiance(&x, &n_x, &q, Some(&row.repeat(x.len()))).unwrap();
            for i in 0..x.len() {
                for colour in 0..3 {
                    let term = |j: usize| crate::kernel(x[i], n_x[i], y[j], n_y[j], softening[j]) * q[j][colour];
                    let whole: f64 = (0..y.len()).map(term).sum();
                    let part: f64 = (0..y.len()).filter(|&j| sources[j].3).map(term).sum();
                    prop_assert!((all[i][colour] - whole).abs() <= 1e-12 * whole.abs().max(1e-12));
                    prop_assert!((seen[i][colour] - part).abs() <= 1e-12 * whole.abs().max(1e-12));
                }
            }
        }
    }

    #[test]
    fn wrong_lengths_are_refused() {
        let direct = Sources::new(&[[0.0; 3]], &[[0.0, 0.0, 1.0]], &[1.0]).unwrap();
        let error = direct.irradiance(&[[0.0; 3]], &[], &[[1.0; 3]], None).unwrap_err();
        assert_eq!(error.to_string(), "receiver normals: expected 1 rows, found 0");
        assert!(direct.irradiance(&[[0.0; 3]], &[[0.0; 3]], &[[1.0; 3]], Some(&[0, 0])).is_err());
    }
}
