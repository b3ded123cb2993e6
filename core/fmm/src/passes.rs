// SPDX-License-Identifier: GPL-3.0-or-later
//! The passes of the fast multipole method over all boxes, in parallel. Points and strengths are in tree order.

use crate::direct::Sources;
use crate::error::Error;
use crate::expansion::{Expansion, InColours};
use crate::gather::Gather;
use crate::links::Links;
use crate::lists::{Batch, Batches, Lists, Rows};
use crate::medium::Medium;
use crate::octree::Octree;
use crate::translations::Translations;
use rayon::prelude::*;
use std::ops::Range;

/// Columns of one matrix product: pairs of boxes times colours.
const COLUMNS_PER_PRODUCT: usize = 192;

/// What every pass needs, in C colours.
pub struct Passes<'a, const C: usize> {
    pub expansion: &'a (dyn Expansion + 'static),
    pub targets: &'a Octree,
    pub sources: &'a Octree,
    pub lists: &'a Lists,
    pub batches: &'a Batches,
    pub translations: &'a Translations,
    pub points: &'a Sources,
    pub links: &'a Links,
    pub gather: &'a Gather,
    /// None where nothing is absorbed.
    pub medium: Option<&'a Medium>,
}

type Colours<const C: usize> = [[f64; C]];

impl<const C: usize> Passes<'_, C>
where
    dyn Expansion: InColours<C>,
{
    /// Multipole coefficients of every source box, [box][coefficient][colour].
    pub fn zero_multipoles(&self) -> Result<Vec<[f64; C]>, Error> {
        zeros(self.sources.n_boxes() * self.expansion.multipole_len())
    }

    /// Local coefficients of every target box, [box][coefficient][colour].
    pub fn zero_locals(&self) -> Result<Vec<[f64; C]>, Error> {
        zeros(self.targets.n_boxes() * self.expansion.local_len())
    }

    /// Particles to multipoles of the leaves (eq 12).
    pub fn p2m(&self, q: &Colours<C>, multipoles: &mut Colours<C>) {
        let tree = self.sources;
        multipoles
            .par_chunks_mut(self.expansion.multipole_len())
            .enumerate()
            .filter(|(b, _)| tree.is_leaf(*b))
            .for_each(|(b, multipole)| {
                let points = tree.points_of(b);
                let positions = tree.in_box_coordinates(&tree.positions[points.clone()], b);
                self.expansion.p2m(&positions, &tree.normals[points.clone()], &q[points], multipole);
            });
    }

    /// Multipoles of children to those of their parents, level by level upwards (section 2.4).
    pub fn m2m(&self, multipoles: &mut Colours<C>) {
        let (tree, len) = (self.sources, self.expansion.multipole_len());
        for level in (1..tree.n_levels()).rev() {
            let (above, below) = multipoles.split_at_mut(tree.boxes_of_level(level).start * len);
            let (first_child, parents) = (tree.boxes_of_level(level).start, tree.boxes_of_level(level - 1));
            above[parents.start * len..].par_chunks_mut(len).zip(parents).for_each(|(parent, b)| {
                for child in tree.children(b) {
                    let at = (child - first_child) * len;
                    self.expansion.m2m(tree.octant(child), &below[at..at + len], parent);
                }
            });
        }
    }

    /// Multipoles of the interaction list to locals (eq 11), all pairs of one offset in one matrix product.
    pub fn m2l(&self, multipoles: &Colours<C>, locals: &mut Colours<C>) {
        let len = self.expansion.local_len();
        let mut slabs = Vec::with_capacity(self.batches.slabs.len());
        let (mut rest, mut done) = (locals, 0);
        for slab in &self.batches.slabs {
            let (_, tail) = rest.split_at_mut((slab.targets.start - done) * len);
            let (own, tail) = tail.split_at_mut(slab.targets.len() * len);
            slabs.push((slab, own));
            (rest, done) = (tail, slab.targets.end);
        }
        slabs.into_par_iter().for_each(|(slab, locals)| {
            for batch in &self.batches.batches[slab.batches.clone()] {
                for start in batch.pairs.clone().step_by(COLUMNS_PER_PRODUCT / C) {
                    let pairs = start..batch.pairs.end.min(start + COLUMNS_PER_PRODUCT / C);
                    self.translate(batch, pairs, slab.targets.start, multipoles, locals);
                }
            }
        });
    }

    fn translate(
        &self,
        batch: &Batch,
        pairs: Range<usize>,
        first: usize,
        multipoles: &Colours<C>,
        locals: &mut Colours<C>,
    ) {
        let (sent, received, width) = (self.expansion.multipole_len(), self.expansion.local_len(), pairs.len() * C);
        let mut from = vec![0.0; sent * width];
        for (column, &source) in self.batches.sources[pairs.clone()].iter().enumerate() {
            let multipole = &multipoles[source as usize * sent..][..sent];
            for (row, colours) in from.chunks_exact_mut(width).zip(multipole) {
                row[column * C..][..C].copy_from_slice(colours);
            }
        }
        let mut to = vec![0.0; received * width];
        self.translations.apply(self.expansion, batch.offset, width, &mut from, &mut to);
        for (column, &target) in self.batches.targets[pairs].iter().enumerate() {
            let scale = self.targets.half_side(target as usize).powi(-2);
            let local = &mut locals[(target as usize - first) * received..][..received];
            for (row, colours) in to.chunks_exact(width).zip(local) {
                for colour in 0..C {
                    colours[colour] += scale * row[column * C + colour];
                }
            }
        }
    }

    /// Particles of the local interaction list to locals (eq 10).
    pub fn p2l(&self, q: &Colours<C>, locals: &mut Colours<C>) {
        let list = &self.lists.local_interaction_list;
        self.each_row(list, locals, |b, local| {
            let scale = self.targets.half_side(b).powi(-2);
            for &source in list.row(b) {
                let points = self.sources.points_of(source as usize);
                let positions = self.targets.in_box_coordinates(&self.sources.positions[points.clone()], b);
                let strengths: Vec<_> = q[points.clone()].iter().map(|q| q.map(|q| q * scale)).collect();
                self.expansion.p2l(&positions, &self.sources.normals[points], &strengths, local);
            }
        });
    }

    fn each_row(&self, list: &Rows, locals: &mut Colours<C>, work: impl Fn(usize, &mut Colours<C>) + Sync) {
        if !list.boxes.is_empty() {
            locals.par_chunks_mut(self.expansion.local_len()).enumerate().for_each(|(b, local)| work(b, local));
        }
    }

    /// Locals of parents to those of their children, level by level downwards (section 2.5).
    pub fn l2l(&self, locals: &mut Colours<C>) {
        let (tree, len) = (self.targets, self.expansion.local_len());
        for level in 1..tree.n_levels() {
            let boxes = tree.boxes_of_level(level);
            let (above, below) = locals.split_at_mut(boxes.start * len);
            below[..boxes.len() * len].par_chunks_mut(len).zip(boxes).for_each(|(child, b)| {
                let parent = tree.parent[b] as usize * len;
                self.expansion.l2l(tree.octant(b), &above[parent..parent + len], child);
            });
        }
    }

    /// Locals to the particles of the leaves (eq 8).
    pub fn l2p(&self, locals: &Colours<C>, irradiance: &mut Colours<C>) {
        let (tree, len) = (self.targets, self.expansion.local_len());
        self.each_leaf(irradiance, |b, out| {
            let positions = tree.in_box_coordinates(&tree.positions[tree.points_of(b)], b);
            self.expansion.l2p(&locals[b * len..(b + 1) * len], &positions, &tree.normals[tree.points_of(b)], out);
        });
    }

    /// Multipoles of the multipole interaction list to particles (eq 5).
    pub fn m2p(&self, multipoles: &Colours<C>, irradiance: &mut Colours<C>) {
        let (list, tree, len) = (&self.lists.multipole_interaction_list, self.targets, self.expansion.multipole_len());
        if list.boxes.is_empty() {
            return;
        }
        self.each_leaf(irradiance, |b, out| {
            for source in list.row(b).iter().map(|&source| source as usize) {
                let scale = self.sources.half_side(source).powi(-2);
                let multipole: Vec<[f64; C]> =
                    multipoles[source * len..(source + 1) * len].iter().map(|m| m.map(|m| m * scale)).collect();
                let positions = self.sources.in_box_coordinates(&tree.positions[tree.points_of(b)], source);
                self.expansion.m2p(&multipole, &positions, &tree.normals[tree.points_of(b)], out);
            }
        });
    }

    /// Near neighbours, directly.
    pub fn p2p(&self, q: &Colours<C>, irradiance: &mut Colours<C>) {
        let tree = self.targets;
        let strengths = self.points.strengths(q);
        self.each_leaf(irradiance, |b, out| {
            let points = tree.points_of(b);
            let near = self.lists.near_neighbours.row(b);
            self.points.add_groups(&tree.positions[points.clone()], &tree.normals[points], near, &strengths, out);
        });
    }

    /// Runs of points of source boxes that are seen in part, directly and each as one source (section 5).
    pub fn links(&self, q: &Colours<C>, irradiance: &mut Colours<C>) {
        if self.links.leaves.is_empty() {
            return;
        }
        let strengths = self.links.strengths(q);
        self.each_leaf(irradiance, |b, out| self.links.add(self.targets, b, &strengths, self.medium, out));
    }

    /// Sources of other boxes that are seen in part, as rays over the hemispheres have met them (section 5).
    pub fn gather(&self, q: &Colours<C>, irradiance: &mut Colours<C>) {
        if self.gather.leaves.is_empty() {
            return;
        }
        let radiosity = self.gather.radiosity(q);
        self.each_leaf(irradiance, |b, out| self.gather.add(b, &radiosity, self.medium.is_none(), out));
    }

    /// Work on every leaf of the targets together with its part of the irradiance.
    fn each_leaf(&self, irradiance: &mut Colours<C>, work: impl Fn(usize, &mut Colours<C>) + Sync) {
        let mut leaves = Vec::new();
        let mut rest = irradiance;
        for b in self.targets.leaves_by_points() {
            let (own, tail) = rest.split_at_mut(self.targets.count(b));
            leaves.push((b, own));
            rest = tail;
        }
        leaves.into_par_iter().for_each(|(b, own)| work(b, own));
    }
}

/// Zeros, or an error where there is no memory for them.
fn zeros<const C: usize>(count: usize) -> Result<Vec<[f64; C]>, Error> {
    let mut zeros = Vec::new();
    zeros.try_reserve_exact(count).map_err(|_| Error::Memory { bytes: count.saturating_mul(8 * C) })?;
    zeros.resize(count, [0.0; C]);
    Ok(zeros)
}
