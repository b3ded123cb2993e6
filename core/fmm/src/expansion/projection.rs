// SPDX-License-Identifier: GPL-3.0-or-later
//! The kernel between two boxes, projected on the functions of an expansion.
//!
//! A multipole coefficient is the moment of a function phi_a(y, n), linear in the normal and
//! polynomial in the position. The functions are made orthonormal on the box, and
//!
//! ```text
//! K_ab = int int psi_a(x) K(x, y) psi_b(y)
//! ```
//!
//! over normals along the axes is the best operator that they allow, in the least-squares sense.
//! Integrals are Gauss-Legendre sums, p + 1 nodes an axis, which are exact for psi psi.

use super::dense::{dot, products_of_rows, sandwiched, transposed};
use super::quadrature::{Node, box_rule};
use super::sparse::add_scaled;
use super::{Expansion, displacement, reflect};
use rayon::prelude::*;
use std::f64::consts::PI;

/// The six orders of three axes.
const ORDERS: [[usize; 3]; 6] = [[0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]];

/// An expansion's space with an orthonormal basis psi, and the kernel of many offsets in it.
pub struct Projection {
    /// Number of functions.
    pub len: usize,
    pub parities: Vec<u8>,
    /// psi from phi, `[psi][phi]`.
    pub from_functions: Vec<f64>,
    /// Components of phi along psi, `[phi][psi]`.
    pub to_functions: Vec<f64>,
    /// psi at the nodes for a normal along each axis, times the roots of the weights:
    /// `[psi][node][axis]`.
    samples: Vec<f64>,
    nodes: Vec<Node>,
    /// psi with the axes exchanged in terms of psi, one matrix for each of [`ORDERS`].
    exchanges: Vec<Vec<f64>>,
    kinds: Vec<Kind>,
}

/// The kernel of one offset x >= y >= z >= 0, of which the others are mirror images.
struct Kind {
    offset: [i32; 3],
    kernel: Vec<f64>,
}

/// What the sum over all offsets of the interaction lists amounts to.
pub struct Energy {
    /// sum K^T K, `[psi][psi]`
    pub seen: Vec<f64>,
    /// What the functions do not see of the kernels' squared norms.
    pub lost: f64,
}

impl Projection {
    pub fn new(expansion: &dyn Expansion) -> Self {
        let per_axis = expansion.truncation() + 1;
        let nodes = box_rule(per_axis);
        let (len, width) = (expansion.local_len(), 3 * nodes.len());
        let functions = sampled(expansion, &nodes);
        let (samples, from_functions) = orthonormal(functions.clone(), expansion.parities());
        let exchange = |order| products_of_rows(&samples, &exchanged(&samples, per_axis, order), width);
        Self {
            len,
            parities: expansion.parities().to_vec(),
            from_functions,
            to_functions: products_of_rows(&functions, &samples, width),
            exchanges: ORDERS.map(exchange).into(),
            samples,
            nodes,
            kinds: Vec::new(),
        }
    }

    /// The energy of all offsets at distances from `separation` + 1 to 2 `separation` + 1, whose
    /// kernels are kept.
    pub fn energy(&mut self, separation: i32) -> Energy {
        let len = self.len;
        let projected = |offset| {
            let sampled = sampled_kernel(&self.nodes, offset);
            let kernel = sandwiched(&self.samples, &sampled, self.width());
            (Kind { offset, kernel }, dot(&sampled, &sampled))
        };
        let kinds: Vec<_> = offset_kinds(separation).collect();
        let kinds: Vec<_> = kinds.into_par_iter().map(projected).collect();
        let mut total = 0.0;
        let mut one_order = vec![0.0; len * len];
        for (kind, squared) in kinds {
            let columns = transposed(len, &kind.kernel);
            total += orbit(kind.offset) * squared;
            add_scaled(orbit(kind.offset), &products_of_rows(&columns, &columns, len), &mut one_order);
            self.kinds.push(kind);
        }
        let mut seen = vec![0.0; len * len];
        for exchange in &self.exchanges {
            let turned = sandwiched(exchange, &one_order, len);
            add_scaled(1.0 / ORDERS.len() as f64, &turned, &mut seen);
        }
        let trace: f64 = (0..len).map(|a| one_order[a * len + a]).sum();
        Energy { seen, lost: (total - trace).max(0.0) }
    }

    /// The kernel between boxes an offset apart, `[target psi][source psi]`, for the offsets of [`Self::energy`].
    pub fn kernel(&self, offset: [i32; 3]) -> Option<Vec<f64>> {
        let (kind, order, mask) = canonical(offset);
        let Kind { kernel, .. } = self.kinds.iter().find(|known| known.offset == kind)?;
        let mut turned = sandwiched(&self.exchanges[order], kernel, self.len);
        reflect(&self.parities, mask, self.len, &mut turned);
        for row in turned.chunks_exact_mut(self.len) {
            reflect(&self.parities, mask, 1, row);
        }
        Some(turned)
    }

    fn width(&self) -> usize {
        3 * self.nodes.len()
    }
}

/// One offset of each kind under reflections and exchanges of axes.
fn offset_kinds(separation: i32) -> impl Iterator<Item = [i32; 3]> {
    (separation + 1..=2 * separation + 1).flat_map(|x| (0..=x).flat_map(move |y| (0..=y).map(move |z| [x, y, z])))
}

/// An offset's kind, the order of axes that leads to it, and the axes to reflect.
fn canonical(offset: [i32; 3]) -> ([i32; 3], usize, u8) {
    let mask = (0..3).map(|axis| u8::from(offset[axis] < 0) << axis).sum();
    let size = offset.map(i32::abs);
    let kind = |order: &[usize; 3]| order.map(|axis| size[axis]);
    let sorted = |order: &[usize; 3]| kind(order).is_sorted_by(|a, b| a >= b);
    let order = ORDERS.iter().position(sorted).unwrap_or(0);
    (kind(&ORDERS[order]), order, mask)
}

/// Number of offsets that reflections and exchanges of axes make of one kind.
fn orbit([x, y, z]: [i32; 3]) -> f64 {
    let signs: f64 = [x, y, z].iter().map(|&x| if x == 0 { 1.0 } else { 2.0 }).product();
    let orders = match (x == y, y == z) {
        (true, true) => 1.0,
        (false, false) => 6.0,
        _ => 3.0,
    };
    signs * orders
}

/// Gram and Schmidt, twice for safety, within each parity: orthonormal rows, and how they are
/// made of those given.
fn orthonormal(mut rows: Vec<f64>, parities: &[u8]) -> (Vec<f64>, Vec<f64>) {
    let len = parities.len();
    let width = rows.len() / len;
    let mut made_of = vec![0.0; len * len];
    for a in 0..len {
        made_of[a * len + a] = 1.0;
        for _ in 0..2 {
            for b in (0..a).filter(|&b| parities[b] == parities[a]) {
                let overlap = dot(&rows[b * width..][..width], &rows[a * width..][..width]);
                subtract_row(&mut rows, width, a, b, overlap);
                subtract_row(&mut made_of, len, a, b, overlap);
            }
            let row = &rows[a * width..][..width];
            let norm = dot(row, row).sqrt();
            rows[a * width..][..width].iter_mut().for_each(|x| *x /= norm);
            made_of[a * len..][..len].iter_mut().for_each(|x| *x /= norm);
        }
    }
    (rows, made_of)
}

/// row a -= factor row b, for b < a.
fn subtract_row(rows: &mut [f64], width: usize, a: usize, b: usize, factor: f64) {
    let (low, high) = rows.split_at_mut(a * width);
    add_scaled(-factor, &low[b * width..][..width], &mut high[..width]);
}

/// The expansion's functions at the nodes, times the roots of the weights: `[phi][node][axis]`.
fn sampled(expansion: &dyn Expansion, nodes: &[Node]) -> Vec<f64> {
    let len = expansion.local_len();
    let axes: [[f64; 3]; 3] = std::array::from_fn(|i| std::array::from_fn(|j| f64::from(i == j)));
    let positions: Vec<_> = nodes.iter().flat_map(|node| [node.position; 3]).collect();
    let weighted = |node: &Node| axes.map(|axis| axis.map(|x| x * node.weight.sqrt()));
    let normals: Vec<_> = nodes.iter().flat_map(weighted).collect();
    let mut rows = vec![0.0; len * positions.len()];
    for (a, row) in rows.chunks_exact_mut(positions.len()).enumerate() {
        let mut unit = vec![[0.0; 1]; len];
        unit[a] = [1.0];
        expansion.l2p(&unit, &positions, &normals, row.as_chunks_mut().0);
    }
    rows
}

/// The kernel between nodes an offset apart for normals along the axes, times the roots of the
/// weights: `[target node][axis][source node][axis]`.
fn sampled_kernel(nodes: &[Node], offset: [i32; 3]) -> Vec<f64> {
    let between = displacement(offset);
    let mut kernel = Vec::with_capacity((3 * nodes.len()).pow(2));
    for x in nodes {
        for i in 0..3 {
            for y in nodes {
                let d: [f64; 3] = std::array::from_fn(|k| between[k] + x.position[k] - y.position[k]);
                let weight = (x.weight * y.weight).sqrt() / (PI * dot(&d, &d).powi(2));
                kernel.extend(d.map(|d_j| -weight * d[i] * d_j));
            }
        }
    }
    kernel
}

/// The same rows with the axes exchanged, of positions and of normals.
fn exchanged(rows: &[f64], per_axis: usize, order: [usize; 3]) -> Vec<f64> {
    let place = |sample: usize| {
        let (node, axis) = (sample / 3, sample % 3);
        let old = [node / (per_axis * per_axis), node / per_axis % per_axis, node % per_axis];
        let [i, j, k] = order.map(|axis| old[axis]);
        let axis = order.iter().position(|&old| old == axis).unwrap_or(axis);
        ((i * per_axis + j) * per_axis + k) * 3 + axis
    };
    let width = 3 * per_axis.pow(3);
    let places: Vec<usize> = (0..width).map(place).collect();
    rows.chunks_exact(width).flat_map(|row| places.iter().map(|&place| row[place])).collect()
}

#[cfg(test)]
mod tests {
    use super::super::Whole;
    use super::*;

    /// Mirror images of kept kernels are the kernels projected afresh.
    #[test]
    fn offsets_of_one_kind_are_mirror_images() {
        let mut kept = Projection::new(&Whole::new(2));
        let energy = kept.energy(1);
        assert_eq!(kept.kinds.len(), 16);
        assert!(energy.lost > 0.0);
        let offsets = (2..=3).map(|x| [[x, 1, 0], [1, -x, 2], [0, 1, -x], [-1, 0, x], [2, x, 3]]);
        for offset in offsets.flatten() {
            let fresh = sandwiched(&kept.samples, &sampled_kernel(&kept.nodes, offset), kept.width());
            for (a, b) in kept.kernel(offset).unwrap_or_default().iter().zip(fresh) {
                assert!((a - b).abs() < 1e-14, "{offset:?} {a} {b}");
            }
        }
    }

    #[test]
    fn orbits_count_the_interaction_offsets() {
        assert_eq!(offset_kinds(1).map(orbit).sum::<f64>(), 7f64.powi(3) - 27.0);
        assert_eq!(offset_kinds(2).map(orbit).sum::<f64>(), 11f64.powi(3) - 125.0);
    }
}
