// SPDX-License-Identifier: GPL-3.0-or-later
//! The multipole-to-local operators that a set of lists needs, one for each distance vector up to reflection.

use crate::expansion::{Expansion, Operator, reflect};
use crate::lists::Batches;
use rayon::prelude::*;
use std::collections::HashMap;

/// Operators by offset with its signs removed; the kernel does not change under reflections, which only flip the signs
/// of some coefficients.
pub struct Translations {
    operators: HashMap<[i32; 3], Operator>,
    parities: Vec<u8>,
}

impl Translations {
    /// The operators for all offsets that occur in the batches.
    pub fn new(expansion: &dyn Expansion, batches: &Batches) -> Self {
        let mut offsets: Vec<[i32; 3]> = batches.batches.iter().map(|batch| batch.offset.map(i32::abs)).collect();
        offsets.sort_unstable();
        offsets.dedup();
        let operators = offsets.into_par_iter().map(|offset| (offset, expansion.m2l_operator(offset))).collect();
        Self { operators, parities: expansion.parities().to_vec() }
    }

    /// Local coefficients [coefficient][width] from multipole coefficients [coefficient][width] of boxes `offset` away,
    /// overwriting `locals`; `multipoles` is left reflected.
    pub fn apply(&self, offset: [i32; 3], width: usize, multipoles: &mut [f64], locals: &mut [f64]) {
        let mask = (0..3).fold(0, |mask, axis| mask | u8::from(offset[axis] < 0) << axis);
        reflect(&self.parities, mask, width, multipoles);
        locals.fill(0.0);
        if let Some(operator) = self.operators.get(&offset.map(i32::abs)) {
            operator.apply(width, multipoles, locals);
        }
        reflect(&self.parities, mask, width, locals);
    }
}
