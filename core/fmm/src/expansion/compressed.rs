// SPDX-License-Identifier: GPL-3.0-or-later
//! The whole kernel in the fewest numbers: [`Whole`] rotated to the modes that matter.
//!
//! Polynomials of degree p stay what they are; of their space only the strongest modes are kept
//! ([`Modes`]), and the multipole-to-local translation is the kernel projected on them, in the
//! least-squares sense over the box, in place of its Taylor series. Both sides share one basis,
//!
//! ```text
//! K(x, y) = sum_(r, s) u_r(x) K_rs u_s(y)
//! ```
//!
//! and where a translation leads out of the basis it is again projected on it.

use super::dense::{add_product, transposed};
use super::modes::Modes;
use super::sparse::Sparse;
use super::{Expansion, InColours, Operator, Whole, reflect};

/// Of the kernel that degree p leaves out, this much more may go with the dropped modes.
const SHARE: f64 = 0.25;

/// The whole kernel in modes of degree p.
///
/// Setting up takes some p^9 steps, so that it is meant for the errors that p <= 8 can reach.
pub struct Compressed {
    whole: Whole,
    modes: Modes,
    /// Coefficients of `whole` to those of the modes, `[mode][coefficient]`.
    compress: Sparse,
    /// Modes to coefficients of `whole`, `[coefficient][mode]`.
    restore: Sparse,
    /// From child 7, the upper half of every axis, to its parent: `[child mode][parent mode]`, and
    /// its transpose. Other children are its mirror images.
    up: Vec<f64>,
    down: Vec<f64>,
}

impl Compressed {
    /// Boxes up to `separation` apart are near neighbours: 1 when only boxes that touch are.
    pub fn new(truncation: usize, separation: u8) -> Self {
        let whole = Whole::new(truncation);
        let modes = Modes::new(&whole, i32::from(separation), SHARE);
        let compress = same_parity(&modes.compression(), &modes.parities, whole.parities());
        let restore = same_parity(&modes.restoration(), whole.parities(), &modes.parities);
        let up = between_levels(&whole, &compress, &restore, modes.len());
        Self { down: transposed(modes.len(), &up), up, compress, restore, modes, whole }
    }

    fn whole_multipole<const C: usize>(&self, multipole: &[[f64; C]]) -> Vec<[f64; C]> {
        let mut whole = vec![[0.0; C]; self.whole.multipole_len()];
        self.restore.apply(C, multipole.as_flattened(), whole.as_flattened_mut());
        whole
    }

    fn whole_local<const C: usize>(&self, local: &[[f64; C]]) -> Vec<[f64; C]> {
        let mut whole = vec![[0.0; C]; self.whole.local_len()];
        self.compress.apply_transposed(C, local.as_flattened(), whole.as_flattened_mut());
        whole
    }

    /// The kernel between boxes further apart than the interaction lists reach, `[target mode][source mode]`, from its
    /// Taylor series: out there it is as good as the projection, and much less work.
    fn far_kernel(&self, offset: [i32; 3]) -> Vec<f64> {
        let (modes, functions) = (self.modes.len(), self.whole.multipole_len());
        let unit: Vec<f64> = (0..modes * modes).map(|i| if i % (modes + 1) == 0 { 1.0 } else { 0.0 }).collect();
        let [mut multipoles, mut locals] = [(); 2].map(|()| vec![0.0; functions * modes]);
        self.restore.apply(modes, &unit, &mut multipoles);
        self.whole.m2l_operator(offset).apply(modes, &multipoles, &mut locals);
        let mut kernel = vec![0.0; modes * modes];
        self.restore.apply_transposed(modes, &locals, &mut kernel);
        kernel
    }

    /// output += what `matrix` makes of input for child 7, mirrored for another child.
    fn change_level<const C: usize>(&self, matrix: &[f64], octant: usize, input: &[[f64; C]], output: &mut [[f64; C]]) {
        let mask = !(octant as u8) & 7;
        let mut mirrored = input.to_vec();
        reflect(&self.modes.parities, mask, C, mirrored.as_flattened_mut());
        let mut moved = vec![[0.0; C]; self.modes.len()];
        add_product(matrix, &mirrored, &mut moved);
        let moved = moved.as_flattened_mut();
        reflect(&self.modes.parities, mask, C, moved);
        output.as_flattened_mut().iter_mut().zip(moved).for_each(|(out, x)| *out += *x);
    }
}

/// The translation from child 7 to its parent, `[child mode][parent mode]`.
fn between_levels(whole: &Whole, compress: &Sparse, restore: &Sparse, len: usize) -> Vec<f64> {
    let mut rows = Vec::with_capacity(len * len);
    for mode in 0..len {
        let mut unit = vec![0.0; len];
        unit[mode] = 1.0;
        let [mut child, mut parent] = [(); 2].map(|()| vec![[0.0; 1]; whole.multipole_len()]);
        restore.apply(1, &unit, child.as_flattened_mut());
        whole.m2m(7, &child, &mut parent);
        let mut moved = vec![0.0; len];
        compress.apply(1, parent.as_flattened(), &mut moved);
        rows.extend(moved);
    }
    rows
}

/// A dense matrix without the entries between different parities, which are rounding errors.
fn same_parity(matrix: &[f64], rows: &[u8], columns: &[u8]) -> Sparse {
    let row = |(row, &parity): (&[f64], &u8)| -> Vec<(usize, f64)> {
        let entries = row.iter().copied().enumerate();
        entries.filter(|&(column, _)| columns[column] == parity).collect()
    };
    Sparse::from_rows(matrix.chunks_exact(columns.len()).zip(rows).map(row))
}

impl Expansion for Compressed {
    fn truncation(&self) -> usize {
        self.whole.truncation()
    }

    fn multipole_len(&self) -> usize {
        self.modes.len()
    }

    fn local_len(&self) -> usize {
        self.modes.len()
    }

    fn parities(&self) -> &[u8] {
        &self.modes.parities
    }

    fn m2l_operator(&self, offset: [i32; 3]) -> Operator {
        let kernel = self.modes.kernel(offset).unwrap_or_else(|| self.far_kernel(offset));
        Operator::dense(self.modes.len(), self.modes.len(), kernel)
    }
}

impl<const C: usize> InColours<C> for Compressed {
    fn p2m(&self, positions: &[[f64; 3]], normals: &[[f64; 3]], strengths: &[[f64; C]], multipole: &mut [[f64; C]]) {
        let mut whole = vec![[0.0; C]; self.whole.multipole_len()];
        self.whole.p2m(positions, normals, strengths, &mut whole);
        self.compress.apply(C, whole.as_flattened(), multipole.as_flattened_mut());
    }

    fn m2m(&self, octant: usize, child: &[[f64; C]], parent: &mut [[f64; C]]) {
        self.change_level(&self.up, octant, child, parent);
    }

    fn l2l(&self, octant: usize, parent: &[[f64; C]], child: &mut [[f64; C]]) {
        self.change_level(&self.down, octant, parent, child);
    }

    fn l2p(&self, local: &[[f64; C]], positions: &[[f64; 3]], normals: &[[f64; 3]], irradiance: &mut [[f64; C]]) {
        self.whole.l2p(&self.whole_local(local), positions, normals, irradiance);
    }

    fn m2p(&self, multipole: &[[f64; C]], positions: &[[f64; 3]], normals: &[[f64; 3]], irradiance: &mut [[f64; C]]) {
        self.whole.m2p(&self.whole_multipole(multipole), positions, normals, irradiance);
    }

    fn p2l(&self, positions: &[[f64; 3]], normals: &[[f64; 3]], strengths: &[[f64; C]], local: &mut [[f64; C]]) {
        let mut whole = vec![[0.0; C]; self.whole.local_len()];
        self.whole.p2l(positions, normals, strengths, &mut whole);
        self.restore.apply_transposed(C, whole.as_flattened(), local.as_flattened_mut());
    }
}
