// SPDX-License-Identifier: GPL-3.0-or-later
//! Expansions of the radiosity kernel, and the operators that move them.
//!
//! With d = x - y the kernel of (eq 1), signed and without visibility, is
//!
//! ```text
//! K(x, y) = (n_y . d) (-n_x . d) / (pi |d|^4)
//! ```
//!
//! and every operator here serves the sum H(x) = sum_y q_y K(x, y), q = w B in one colour or three.
//!
//! Three expansions share one trait: [`Paper`], which expands 1/|d|^4 and keeps the numerator apart
//! in source and receiver matrices (eq 4 to 11), [`Whole`], which expands the kernel as one tensor,
//! and [`Compressed`], the whole kernel in the fewest numbers. Derivations are in
//! docs/expansions.md.
//!
//! **Units.** Positions are box coordinates: the centre of the box is 0, its half side 1. The
//! kernel is homogeneous of degree -2, so that for boxes of half side h the results of `m2l`,
//! `m2p` and `p2l` are to be divided by h^2; local coefficients are then irradiance, and `l2l` and
//! `l2p` have no such factor. Multipole coefficients never have one.
//!
//! **Layout.** A box has `multipole_len()` coefficients a colour, row-major `[coefficient][colour]`;
//! the same with `local_len()`. All operators add to their output.

mod bound;
mod compressed;
mod dense;
mod derivatives;
mod eigen;
mod gemm;
mod harmonics;
mod modes;
mod operator;
mod paper;
mod particles;
mod projection;
mod quadrature;
mod shift;
mod simplex;
mod source_matrix;
mod sparse;
mod whole;

pub use bound::error_bound;
pub use compressed::Compressed;
pub use operator::Operator;
pub use paper::Paper;
pub use whole::Whole;

/// An expansion truncated at some p, with its translations, which work in one colour or three.
pub trait Expansion: InColours<1> + InColours<3> + Send + Sync {
    /// The truncation p.
    fn truncation(&self) -> usize;

    /// Multipole coefficients a colour.
    fn multipole_len(&self) -> usize;

    /// Local coefficients a colour.
    fn local_len(&self) -> usize;

    /// Under which reflections a coefficient changes sign: bit `axis` set, when it does under
    /// x_axis -> -x_axis. Multipole and local coefficients have the same parities.
    ///
    /// The operator of a reflected offset is the operator of the offset between reflected
    /// coefficients, so that offsets in one octant serve all eight.
    fn parities(&self) -> &[u8];

    /// Multipole to local (section 2.6) between boxes of one size: the centre of the source box
    /// is that of the target box + `offset` box sides.
    fn m2l_operator(&self, offset: [i32; 3]) -> Operator;
}

/// What an expansion does with strengths, coefficients and irradiance of C colours.
pub trait InColours<const C: usize> {
    /// Particles to multipole: sources in box coordinates, one row each (eq 12).
    fn p2m(&self, positions: &[[f64; 3]], normals: &[[f64; 3]], strengths: &[[f64; C]], multipole: &mut [[f64; C]]);

    /// Multipole of child `octant` to multipole of its parent (section 2.4), exactly but for
    /// [`Compressed`], which projects it on its modes. Bits 0, 1 and 2 of the octant are the upper
    /// halves of x, y and z.
    fn m2m(&self, octant: usize, child: &[[f64; C]], parent: &mut [[f64; C]]);

    /// Local of a parent to local of its child `octant` (section 2.5); exact where `m2m` is.
    fn l2l(&self, octant: usize, parent: &[[f64; C]], child: &mut [[f64; C]]);

    /// Local to particles (eq 8), receivers in box coordinates, one row of colours each.
    fn l2p(&self, local: &[[f64; C]], positions: &[[f64; 3]], normals: &[[f64; 3]], irradiance: &mut [[f64; C]]);

    /// Multipole to particles outside the box (eq 5), receivers in the source box's coordinates.
    fn m2p(&self, multipole: &[[f64; C]], positions: &[[f64; 3]], normals: &[[f64; 3]], irradiance: &mut [[f64; C]]);

    /// Particles outside the box to local (eq 10), sources in the target box's coordinates.
    fn p2l(&self, positions: &[[f64; 3]], normals: &[[f64; 3]], strengths: &[[f64; C]], local: &mut [[f64; C]]);
}

/// Multiplies by -1 the coefficients that change sign under a reflection of the axes in `mask`.
///
/// `coefficients` is `[coefficient][width]`.
pub fn reflect(parities: &[u8], mask: u8, width: usize, coefficients: &mut [f64]) {
    for (parity, row) in parities.iter().zip(coefficients.chunks_exact_mut(width)) {
        if (parity & mask).count_ones() % 2 == 1 {
            row.iter_mut().for_each(|x| *x = -*x);
        }
    }
}

/// (-1)^n.
pub(crate) fn sign(n: usize) -> f64 {
    if n.is_multiple_of(2) { 1.0 } else { -1.0 }
}

/// From the source box's centre to the target box's, in box coordinates (half side 1).
pub(crate) fn displacement(offset: [i32; 3]) -> [f64; 3] {
    offset.map(|o| -2.0 * f64::from(o))
}
