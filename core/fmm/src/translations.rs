// SPDX-License-Identifier: GPL-3.0-or-later
//! The multipole-to-local operators that a set of lists needs, one for each distance vector up to reflection.

use crate::expansion::{Expansion, Operator, reflect};
use crate::lists::Batches;
use rayon::prelude::*;
use std::collections::HashMap;

/// Operators by offset with its signs removed; the kernel does not change under reflections, which only flip the signs
/// of some coefficients.
///
/// Only offsets of the classical interaction list are kept. Pairs that were postponed can be farther apart for their
/// size, in too many ways to keep an operator for each: theirs are made when they are used.
pub struct Translations {
    operators: HashMap<[i32; 3], Operator>,
    parities: Vec<u8>,
}

impl Translations {
    /// The operators for the classical offsets that occur in the batches, with boxes up to `separation` apart near.
    pub fn new(expansion: &dyn Expansion, batches: &Batches, separation: u32) -> Self {
        let farthest = 2 * separation as i32 + 1;
        let mut offsets: Vec<[i32; 3]> = batches.batches.iter().map(|batch| batch.offset.map(i32::abs)).collect();
        offsets.retain(|offset| offset.iter().all(|&o| o <= farthest));
        offsets.sort_unstable();
        offsets.dedup();
        let operators = offsets.into_par_iter().map(|offset| (offset, expansion.m2l_operator(offset))).collect();
        Self { operators, parities: expansion.parities().to_vec() }
    }

    /// Local coefficients [coefficient][width] from multipole coefficients [coefficient][width] of boxes `offset` away,
    /// overwriting `locals`; `multipoles` is left reflected.
    pub fn apply(
        &self,
        expansion: &dyn Expansion,
        offset: [i32; 3],
        width: usize,
        multipoles: &mut [f64],
        locals: &mut [f64],
    ) {
        let mask = (0..3).fold(0, |mask, axis| mask | u8::from(offset[axis] < 0) << axis);
        reflect(&self.parities, mask, width, multipoles);
        locals.fill(0.0);
        match self.operators.get(&offset.map(i32::abs)) {
            Some(operator) => operator.apply(width, multipoles, locals),
            None => expansion.m2l_operator(offset.map(i32::abs)).apply(width, multipoles, locals),
        }
        reflect(&self.parities, mask, width, locals);
    }
}
