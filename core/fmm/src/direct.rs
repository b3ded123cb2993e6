// SPDX-License-Identifier: GPL-3.0-or-later
//! The direct sum over all sources: H(x) = sum over y of K(x, y) q(y), with q = weight * radiosity.

use crate::error::{Error, same_length};
use crate::kernel;
use crate::medium::Medium;
use pulp::{Arch, Simd, WithSimd};
use rayon::prelude::*;
use std::f64::consts::PI;
use std::ops::Range;

/// Arrays are padded to this many sources, the widest register; padding sources have no strength.
const LANES: usize = 8;
/// Receivers that share each load of a source.
const ROWS: usize = 4;
/// Receivers and sources are taken in tiles that stay in the nearest cache.
const TILE_ROWS: usize = 64;
const TILE_SOURCES: usize = 512;

/// The point sources of a direct sum, one array a component, in groups that start on a register's boundary.
#[derive(Debug, Clone)]
pub struct Sources {
    count: usize,
    /// Sources of each group, as the caller numbers them.
    groups: Vec<Range<usize>>,
    /// The same groups in the padded arrays.
    parts: Vec<Range<usize>>,
    y: Columns<3>,
    n_y: Columns<3>,
    softening: Vec<f64>,
    medium: Medium,
}

/// Components, padded.
type Columns<const C: usize> = [Vec<f64>; C];

/// Strengths of sources in C colours, in their padded places.
pub struct Strengths<const C: usize>(Columns<C>);

impl Sources {
    /// Sources at `positions` with unit `normals`, in one group; `softening` is the squared distance below which each
    /// one's kernel stops growing (see [`crate::kernel`]).
    pub fn new(positions: &[[f64; 3]], normals: &[[f64; 3]], softening: &[f64]) -> Result<Self, Error> {
        let all = 0..positions.len();
        Self::grouped(positions, normals, softening, Vec::from([all]))
    }

    /// The same in several groups, each a range of sources; groups may be empty.
    pub fn grouped(
        positions: &[[f64; 3]],
        normals: &[[f64; 3]],
        softening: &[f64],
        groups: Vec<Range<usize>>,
    ) -> Result<Self, Error> {
        same_length("source normals", positions.len(), normals.len())?;
        same_length("source softening", positions.len(), softening.len())?;
        let mut parts = Vec::with_capacity(groups.len());
        let mut end = 0;
        for group in &groups {
            if group.end > positions.len() {
                return Err(Error::Index { what: "source group", index: group.end, count: positions.len() });
            }
            parts.push(end..end + group.len().next_multiple_of(LANES));
            end += group.len().next_multiple_of(LANES);
        }
        // Padding has softening 1: its kernel is finite, and its strength is zero.
        Ok(Sources {
            count: positions.len(),
            y: columns(positions, &groups),
            n_y: columns(normals, &groups),
            softening: padded(&groups, 1.0, |j| softening[j]),
            groups,
            parts,
            medium: Medium::default(),
        })
    }

    /// The same sources in a medium.
    pub fn within(self, medium: Medium) -> Self {
        Self { medium, ..self }
    }

    /// Strengths (N, C) in their padded places.
    pub fn strengths<const C: usize>(&self, strengths: &[[f64; C]]) -> Strengths<C> {
        Strengths(columns(strengths, &self.groups))
    }

    /// Adds to `irradiance` what all sources send to a few receivers; `visible` as in [`Sources::irradiance`].
    pub fn add_visible<const C: usize>(
        &self,
        points: &[[f64; 3]],
        normals: &[[f64; 3]],
        strengths: &Strengths<C>,
        visible: &[u64],
        irradiance: &mut [[f64; C]],
    ) {
        let all = 0..self.softening.len();
        self.add_parts(points, normals, std::slice::from_ref(&all), strengths, Some(visible), irradiance);
    }

    /// Adds to `irradiance` what the sources of some groups send to a few receivers.
    pub fn add_groups<const C: usize>(
        &self,
        points: &[[f64; 3]],
        normals: &[[f64; 3]],
        groups: &[u32],
        strengths: &Strengths<C>,
        irradiance: &mut [[f64; C]],
    ) {
        let parts: Vec<Range<usize>> = groups.iter().map(|&group| self.parts[group as usize].clone()).collect();
        self.add_parts(points, normals, &parts, strengths, None, irradiance);
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

    /// Irradiance (M, C) at the receivers from sources of the given strengths (N, C), in C colours.
    ///
    /// `visible` holds, when given, one row of [`Sources::words`] words a receiver: bit j % 64 of word j / 64 says
    /// that source j is seen. Without it every source in front of the horizon is.
    pub fn irradiance<const C: usize>(
        &self,
        points: &[[f64; 3]],
        normals: &[[f64; 3]],
        strengths: &[[f64; C]],
        visible: Option<&[u64]>,
    ) -> Result<Vec<[f64; C]>, Error> {
        same_length("receiver normals", points.len(), normals.len())?;
        same_length("strengths", self.count, strengths.len())?;
        if let Some(bits) = visible {
            same_length("visibility words", points.len() * self.words(), bits.len())?;
        }
        let (strengths, words) = (self.strengths(strengths), self.words());
        let mut irradiance = vec![[0.0; C]; points.len()];
        irradiance.par_chunks_mut(TILE_ROWS).enumerate().for_each(|(tile, out)| {
            let rows = tile * TILE_ROWS..tile * TILE_ROWS + out.len();
            for first in (0..self.softening.len()).step_by(TILE_SOURCES) {
                let part = first..(first + TILE_SOURCES).min(self.softening.len());
                let bits = visible.map(|bits| &bits[rows.start * words..rows.end * words]);
                let (points, normals) = (&points[rows.clone()], &normals[rows.clone()]);
                self.add_parts(points, normals, std::slice::from_ref(&part), &strengths, bits, out);
            }
        });
        Ok(irradiance)
    }

    fn add_parts<const C: usize>(
        &self,
        points: &[[f64; 3]],
        normals: &[[f64; 3]],
        parts: &[Range<usize>],
        strengths: &Strengths<C>,
        visible: Option<&[u64]>,
        irradiance: &mut [[f64; C]],
    ) {
        if !self.medium.is_clear() {
            return self.add_absorbed(points, normals, parts, strengths, visible, irradiance);
        }
        let (arch, words) = (Arch::new(), self.words());
        for (group, out) in irradiance.chunks_mut(ROWS).enumerate() {
            // A short last group repeats its last receiver, whose sum is then not taken.
            let rows = [0, 1, 2, 3].map(|i: usize| group * ROWS + i.min(out.len() - 1));
            let sums = arch.dispatch(Sum {
                x: rows.map(|row| points[row]),
                n_x: rows.map(|row| normals[row]),
                sources: self,
                q: &strengths.0,
                parts,
                bits: visible.map(|bits| rows.map(|row| &bits[row * words..(row + 1) * words])),
            });
            for (out, sum) in out.iter_mut().zip(sums) {
                out.iter_mut().zip(sum).for_each(|(out, sum)| *out += sum);
            }
        }
    }

    /// As `add_parts`, through a medium.
    fn add_absorbed<const C: usize>(
        &self,
        points: &[[f64; 3]],
        normals: &[[f64; 3]],
        parts: &[Range<usize>],
        strengths: &Strengths<C>,
        visible: Option<&[u64]>,
        irradiance: &mut [[f64; C]],
    ) {
        let words = self.words();
        for (row, out) in irradiance.iter_mut().enumerate() {
            let bits = visible.map(|bits| &bits[row * words..(row + 1) * words]);
            for j in parts.iter().cloned().flatten() {
                if bits.is_some_and(|bits| byte(bits, j / LANES) >> (j % LANES) & 1 == 0) {
                    continue;
                }
                let (y, n_y) = (self.y.each_ref().map(|y| y[j]), self.n_y.each_ref().map(|n| n[j]));
                let k = kernel(points[row], normals[row], y, n_y, self.softening[j]);
                if k > 0.0 {
                    let left = self.medium.left::<C>(points[row], y);
                    (0..C).for_each(|c| out[c] += k * left[c] * strengths.0[c][j]);
                }
            }
        }
    }
}

/// One padded array a component.
fn columns<const C: usize>(rows: &[[f64; C]], groups: &[Range<usize>]) -> Columns<C> {
    std::array::from_fn(|c| padded(groups, 0.0, |j| rows[j][c]))
}

/// The values of all groups, each padded to whole registers.
fn padded(groups: &[Range<usize>], padding: f64, value: impl Fn(usize) -> f64) -> Vec<f64> {
    let mut column = Vec::new();
    for group in groups {
        column.extend(group.clone().map(&value));
        column.resize(column.len().next_multiple_of(LANES), padding);
    }
    column
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

/// The sum over some parts of the sources for a few receivers at once.
struct Sum<'a, const C: usize> {
    x: [[f64; 3]; ROWS],
    n_x: [[f64; 3]; ROWS],
    sources: &'a Sources,
    q: &'a Columns<C>,
    parts: &'a [Range<usize>],
    bits: Option<[&'a [u64]; ROWS]>,
}

impl<const C: usize> WithSimd for Sum<'_, C> {
    type Output = [[f64; C]; ROWS];

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Self::Output {
        let y = self.sources.y.each_ref().map(|column| S::as_simd_f64s(column).0);
        let n_y = self.sources.n_y.each_ref().map(|column| S::as_simd_f64s(column).0);
        let q = self.q.each_ref().map(|column| S::as_simd_f64s(column).0);
        let softening = S::as_simd_f64s(&self.sources.softening).0;
        let x = self.x.map(|x| x.map(|c| simd.splat_f64s(c)));
        let n_x = self.n_x.map(|n| n.map(|c| simd.splat_f64s(c)));
        let zero = simd.splat_f64s(0.0);
        let per_byte = LANES / S::F64_LANES.min(LANES);
        let mut sums = [[zero; C]; ROWS];
        let vectors = |part: &Range<usize>| part.start / LANES * per_byte..part.end / LANES * per_byte;
        for v in self.parts.iter().flat_map(vectors) {
            let seen = self.bits.map(|rows| rows.map(|row| byte(row, v / per_byte)));
            if seen == Some([0; ROWS]) {
                continue;
            }
            for i in 0..ROWS {
                // (eq 1) without its -1 / pi.
                let d = [0, 1, 2].map(|axis| simd.sub_f64s(x[i][axis], y[axis][v]));
                let r2 = simd.max_f64s(dot(simd, d, d), softening[v]);
                let cos_y = simd.max_f64s(dot(simd, d, n_y.map(|n| n[v])), zero);
                let cos_x = simd.min_f64s(dot(simd, d, n_x[i]), zero);
                let mut k = simd.div_f64s(simd.mul_f64s(cos_y, cos_x), simd.mul_f64s(r2, r2));
                if let Some(seen) = seen {
                    k = simd.mul_f64s(k, S::as_simd_f64s(&FACTORS[seen[i]]).0[v % per_byte]);
                }
                for colour in 0..C {
                    sums[i][colour] = simd.mul_add_e_f64s(k, q[colour][v], sums[i][colour]);
                }
            }
        }
        sums.map(|sum| sum.map(|lanes| simd.reduce_sum_f64s(lanes) / -PI))
    }
}

/// Byte `index` of a row of visibility bits.
#[inline(always)]
fn byte(row: &[u64], index: usize) -> usize {
    (row[index / 8] >> (index % 8 * 8) & 0xff) as usize
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
                    let term = |j: usize| kernel(x[i], n_x[i], y[j], n_y[j], softening[j]) * q[j][colour];
                    let whole: f64 = (0..y.len()).map(term).sum();
                    let part: f64 = (0..y.len()).filter(|&j| sources[j].3).map(term).sum();
                    prop_assert!((all[i][colour] - whole).abs() <= 1e-12 * whole.abs().max(1e-12));
                    prop_assert!((seen[i][colour] - part).abs() <= 1e-12 * whole.abs().max(1e-12));
                }
            }
        }
    }

    #[test]
    fn a_medium_takes_its_share_of_each_pair() {
        let (x, n_x) = ([0.1, 0.2, 0.0], [0.0, 0.0, 1.0]);
        let y: Vec<[f64; 3]> = (0..20).map(|i| [0.1 * i as f64, 0.3, 1.0 + 0.05 * i as f64]).collect();
        let (n_y, softening, q) = (vec![[0.0, 0.0, -1.0]; 20], vec![1e-9; 20], vec![[1.0, 2.0, 3.0]; 20]);
        let medium = Medium::new([0.0, 0.7, 3.0]).unwrap();
        let direct = Sources::new(&y, &n_y, &softening).unwrap().within(medium.clone());
        let found = direct.irradiance(&[x], &[n_x], &q, Some(&[0b1011])).unwrap()[0];
        for c in 0..3 {
            let term = |j: usize| {
                let left: [f64; 3] = medium.left(x, y[j]);
                kernel(x, n_x, y[j], n_y[j], 1e-9) * q[j][c] * left[c]
            };
            let exact = term(0) + term(1) + term(3);
            assert!((found[c] - exact).abs() < 1e-14 * exact);
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
