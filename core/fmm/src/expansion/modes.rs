// SPDX-License-Identifier: GPL-3.0-or-later
//! The directions in an expansion's space that carry the most of the kernel.

use super::Expansion;
use super::dense::{product, products_of_rows, sandwiched};
use super::eigen::eigenpairs;
use super::projection::Projection;

/// The strongest eigenvectors of sum K^T K over all offsets of the interaction lists: of all
/// bases of their number, the one that leaves out the least.
pub struct Modes {
    projection: Projection,
    /// Modes over the orthonormal functions, `[mode][psi]`.
    rows: Vec<f64>,
    pub parities: Vec<u8>,
}

impl Modes {
    /// The modes that an expansion's truncation can resolve, for interaction lists with
    /// `separation` boxes between.
    ///
    /// The expansion's functions leave out part of the kernel; modes are dropped as long as they
    /// carry, all together, no more than `share` of that part.
    pub fn new(expansion: &dyn Expansion, separation: i32, share: f64) -> Self {
        let mut projection = Projection::new(expansion);
        let energy = projection.energy(separation);
        let mut modes = eigenmodes(projection.len, &energy.seen, &projection.parities);
        drop_weakest(&mut modes, share * energy.lost);
        let parities = modes.iter().map(|mode| mode.parity).collect();
        let rows = modes.into_iter().flat_map(|mode| mode.vector).collect();
        Self { projection, rows, parities }
    }

    /// Number of modes.
    pub fn len(&self) -> usize {
        self.parities.len()
    }

    /// The kernel between boxes an offset apart, `[target mode][source mode]`, for offsets of the interaction lists.
    pub fn kernel(&self, offset: [i32; 3]) -> Option<Vec<f64>> {
        Some(sandwiched(&self.rows, &self.projection.kernel(offset)?, self.projection.len))
    }

    /// Modes in terms of the expansion's functions, `[mode][function]`.
    pub fn compression(&self) -> Vec<f64> {
        product(&self.rows, &self.projection.from_functions, self.projection.len)
    }

    /// Components of the expansion's functions along the modes, `[function][mode]`.
    pub fn restoration(&self) -> Vec<f64> {
        products_of_rows(&self.projection.to_functions, &self.rows, self.projection.len)
    }
}

struct Mode {
    energy: f64,
    parity: u8,
    vector: Vec<f64>,
}

/// All eigenvectors, parity by parity, sorted by energy, the strongest first.
fn eigenmodes(len: usize, energy: &[f64], parities: &[u8]) -> Vec<Mode> {
    let mut modes = Vec::new();
    for parity in 0..8 {
        let members: Vec<usize> = (0..len).filter(|&a| parities[a] == parity).collect();
        let row = |&a: &usize| members.iter().map(move |&b| energy[a * len + b]);
        for (energy, components) in eigenpairs(members.len(), members.iter().flat_map(row).collect()) {
            let mut vector = vec![0.0; len];
            members.iter().zip(components).for_each(|(&a, x)| vector[a] = x);
            modes.push(Mode { energy, parity, vector });
        }
    }
    modes.sort_by(|a, b| b.energy.total_cmp(&a.energy));
    modes
}

/// Drops modes from the end while they carry no more than `energy` together; the first stays.
fn drop_weakest(modes: &mut Vec<Mode>, energy: f64) {
    let mut left = energy;
    while let [_, .., last] = modes.as_slice() {
        left -= last.energy;
        if left < 0.0 {
            return;
        }
        modes.pop();
    }
}
