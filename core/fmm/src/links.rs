// SPDX-License-Identifier: GPL-3.0-or-later
//! Links: what a target leaf receives from source boxes that it sees in part. The receivers' side is postponed to its
//! points, the sources' side is cut into runs of neighbouring points, and each point of the leaf has a bit for each run
//! that says whether it sees it.

use crate::direct::Sources;
use crate::error::{Error, same_length};
use crate::kernel;
use crate::medium::Medium;
use crate::octree::Octree;
use rayon::prelude::*;
use std::collections::HashMap;
use std::ops::Range;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicU64, Ordering};

/// Neighbouring source points that one ray decides about.
#[derive(Debug, Clone)]
pub struct Run {
    /// In tree order.
    pub points: Range<u32>,
    /// What stands for them.
    parts: Range<u32>,
}

/// Runs, and the parts that they are made of: each part counts as one source.
#[derive(Debug, Default)]
pub struct Runs {
    pub runs: Vec<Run>,
    parts: Vec<Range<u32>>,
    positions: Vec<[f64; 3]>,
    /// Means, not made unit: a bent part sends less.
    normals: Vec<[f64; 3]>,
    softening: Vec<f64>,
    /// Runs of a source box cut in so many runs of so many parts.
    known: HashMap<(u32, (u32, u32)), Range<u32>>,
}

/// Sums of the weights of the source points, tree order: those of points i..j are `sums[j] - sums[i]`.
#[derive(Debug, Clone)]
pub struct Weights {
    sums: Vec<f64>,
}

impl Weights {
    pub fn new(weights: &[f64]) -> Self {
        let mut sums = vec![0.0];
        sums.extend(weights.iter().scan(0.0, |sum, w| {
            *sum += w;
            Some(*sum)
        }));
        Self { sums }
    }

    pub fn of(&self, points: &Range<usize>) -> f64 {
        self.sums[points.end] - self.sums[points.start]
    }

    /// The point of a range at which its weight reaches a share, 0 to 1.
    pub fn at(&self, points: &Range<usize>, share: f64) -> usize {
        let goal = self.sums[points.start] + share * self.of(points);
        let passed = self.sums[points.start + 1..points.end].partition_point(|&sum| sum <= goal);
        points.start + passed
    }
}

impl Runs {
    /// The runs of source box s cut into at most so many runs of so many parts, all of equal weight; `softening` (N,) in
    /// tree order.
    pub fn of(&mut self, tree: &Octree, s: u32, cut: (u32, u32), weights: &Weights, softening: &[f64]) -> Range<u32> {
        if let Some(known) = self.known.get(&(s, cut)) {
            return known.clone();
        }
        let first = self.runs.len() as u32;
        let points = tree.points_of(s as usize);
        for run in pieces(weights, &points, cut.0) {
            let first_part = self.parts.len() as u32;
            for part in pieces(weights, &run, cut.1) {
                self.push(tree, part, weights, softening);
            }
            let parts = first_part..self.parts.len() as u32;
            self.runs.push(Run { points: run.start as u32..run.end as u32, parts });
        }
        let runs = first..self.runs.len() as u32;
        self.known.insert((s, cut), runs.clone());
        runs
    }

    fn push(&mut self, tree: &Octree, points: Range<usize>, weights: &Weights, softening: &[f64]) {
        let total = weights.of(&points);
        let mean = |rows: &[[f64; 3]]| {
            let mut sum = [0.0; 3];
            for j in points.clone() {
                let share = weights.of(&(j..j + 1)) / total;
                (0..3).for_each(|axis| sum[axis] += share * rows[j][axis]);
            }
            sum
        };
        self.positions.push(mean(&tree.positions));
        self.normals.push(mean(&tree.normals));
        self.softening.push(softening[points.start]);
        self.parts.push(points.start as u32..points.end as u32);
    }

    /// A point of a run as a share, 0 to 1, of what a receiver gets from it: what is near counts for more than what is far,
    /// and is seen more often.
    pub fn point(&self, x: [f64; 3], n_x: [f64; 3], run: &Run, weights: &Weights, share: f64) -> usize {
        let sent = |part: u32| {
            let (part, points) = (part as usize, to_usize(&self.parts[part as usize]));
            kernel(x, n_x, self.positions[part], self.normals[part], self.softening[part]) * weights.of(&points)
        };
        let total: f64 = run.parts.clone().map(sent).sum();
        let mut left = share * total;
        for part in run.parts.clone() {
            let own = sent(part);
            if left < own {
                return weights.at(&to_usize(&self.parts[part as usize]), left / own);
            }
            left -= own;
        }
        // Nothing arrives, or rounding.
        weights.at(&to_usize(&run.points), share)
    }

    fn strengths<const C: usize>(&self, q: &[[f64; C]]) -> Vec<[f64; C]> {
        let sum = |part: &Range<u32>| {
            let q = &q[part.start as usize..part.end as usize];
            std::array::from_fn(|c| q.iter().map(|q| q[c]).sum())
        };
        self.parts.par_iter().map(sum).collect()
    }
}

fn to_usize(points: &Range<u32>) -> Range<usize> {
    points.start as usize..points.end as usize
}

/// At most `count` pieces of equal weight of a range of points, none of them empty; single points from there on.
fn pieces(weights: &Weights, points: &Range<usize>, count: u32) -> Vec<Range<usize>> {
    let count = count as usize;
    if count >= points.len() {
        return points.clone().map(|j| j..j + 1).collect();
    }
    let cut = |piece: usize| match piece {
        0 => points.start,
        _ if piece == count => points.end,
        _ => weights.at(points, piece as f64 / count as f64),
    };
    (0..count).map(|piece| cut(piece)..cut(piece + 1)).filter(|piece| !piece.is_empty()).collect()
}

/// The runs that a leaf sees in part, and where its points' rows of bits start.
#[derive(Debug)]
pub struct LeafLinks {
    pub leaf: u32,
    /// In order of their points, which no two of them share.
    pub runs: Vec<u32>,
    /// First bit of each run in a row: one for each of its parts.
    pub columns: Vec<u32>,
    /// Bits in a row.
    width: usize,
    first_word: usize,
    /// (points, width) what is left of the light of parts that are seen, none of others; found when it is first needed.
    left: OnceLock<Vec<[f32; 3]>>,
}

/// The links of all leaves, with their bits.
#[derive(Debug, Default)]
pub struct Links {
    pub leaves: Vec<LeafLinks>,
    pub runs: Runs,
    /// Place in `leaves` of each target box that has links.
    places: HashMap<u32, usize>,
    bits: Vec<AtomicU64>,
    /// The bits as they were before anything moved.
    still: Vec<u64>,
}

/// Bits of a slot that hold the number of its first bit; the rest hold how many follow it.
const SLOT_BITS: u32 = 40;

impl Links {
    /// Links with all bits set, from pairs of a target leaf and a run.
    pub fn new(targets: &Octree, mut pairs: Vec<(u32, u32)>, runs: Runs) -> Self {
        let start = |run: u32| runs.runs[run as usize].points.start;
        pairs.par_sort_unstable_by_key(|&(leaf, run)| (targets.points[leaf as usize][0], start(run)));
        let (mut leaves, mut places, mut words) = (Vec::new(), HashMap::new(), 0);
        for row in pairs.chunk_by(|a, b| a.0 == b.0) {
            let leaf = row[0].0;
            places.insert(leaf, leaves.len());
            let (mut columns, mut width) = (Vec::with_capacity(row.len()), 0);
            for &(_, run) in row {
                columns.push(width as u32);
                width += runs.runs[run as usize].parts.len();
            }
            let runs = row.iter().map(|pair| pair.1).collect();
            leaves.push(LeafLinks { leaf, runs, columns, width, first_word: words, left: OnceLock::new() });
            words += targets.count(leaf as usize) * width.div_ceil(64);
        }
        let bits = (0..words).map(|_| AtomicU64::new(u64::MAX)).collect();
        Self { leaves, runs, places, bits, still: Vec::new() }
    }

    /// Pairs of a point and what counts as one source for it.
    pub fn count(&self, targets: &Octree) -> usize {
        self.leaves.iter().map(|links| targets.count(links.leaf as usize) * links.width).sum()
    }

    fn bit(&self, links: &LeafLinks, row: usize, column: u32) -> u64 {
        ((links.first_word + row * links.width.div_ceil(64)) * 64) as u64 + u64::from(column)
    }

    /// The run at a place in a leaf's row.
    pub fn run(&self, links: &LeafLinks, place: usize) -> &Run {
        &self.runs.runs[links.runs[place] as usize]
    }

    /// Where the answer for the row-th point of a leaf and the run at a place goes: its bits.
    pub fn slot_at(&self, links: &LeafLinks, row: usize, place: usize) -> u64 {
        let parts = self.run(links, place).parts.len() as u64;
        self.bit(links, row, links.columns[place]) | (parts - 1) << SLOT_BITS
    }

    /// Whether the row-th point of a leaf sees the run at a place, as far as is known.
    pub fn is_seen(&self, links: &LeafLinks, row: usize, place: usize) -> bool {
        self.is_set(self.bit(links, row, links.columns[place]))
    }

    fn is_set(&self, bit: u64) -> bool {
        self.bits[bit as usize / 64].load(Ordering::Relaxed) >> (bit % 64) & 1 == 1
    }

    /// Calls `mark` with the points of every run that is a single point: those that exact form factors can stand for.
    pub fn single_points(&self, mut mark: impl FnMut(usize)) {
        let single = self.runs.runs.iter().filter(|run| run.points.len() == 1);
        single.for_each(|run| mark(run.points.start as usize));
    }

    /// Whether the row-th point of a target leaf sees source point j through a link that has j as a run of its own;
    /// None where there is no such link.
    pub fn sees(&self, leaf: u32, row: usize, j: usize) -> Option<bool> {
        let links = &self.leaves[*self.places.get(&leaf)?];
        let points = |run: u32| &self.runs.runs[run as usize].points;
        let place = links.runs.partition_point(|&run| points(run).start as usize <= j).checked_sub(1)?;
        (j < points(links.runs[place]).end as usize).then(|| self.is_set(self.bit(links, row, links.columns[place])))
    }

    /// Clears the bits of the rays that did not arrive, from the slots of all rays.
    pub fn block(&self, slots: &[u64], occluded: &[bool]) -> Result<(), Error> {
        same_length("answers", slots.len(), occluded.len())?;
        let count = 64 * self.bits.len();
        for (&slot, _) in slots.iter().zip(occluded).filter(|(_, occluded)| **occluded) {
            let last = (slot & ((1 << SLOT_BITS) - 1)) + (slot >> SLOT_BITS);
            if last as usize >= count {
                return Err(Error::Index { what: "visibility bit", index: last as usize, count });
            }
            self.clear(slot);
        }
        Ok(())
    }

    /// All bits as they were when this was called first.
    pub fn restore(&mut self) {
        if self.still.is_empty() {
            self.still = self.bits.iter().map(|word| word.load(Ordering::Relaxed)).collect();
        }
        self.bits.iter_mut().zip(&self.still).for_each(|(word, &still)| *word.get_mut() = still);
    }

    /// Sets the bits of a slot.
    pub(crate) fn set(&self, slot: u64) {
        let first = slot & ((1 << SLOT_BITS) - 1);
        for bit in first..=first + (slot >> SLOT_BITS) {
            self.bits[bit as usize / 64].fetch_or(1 << (bit % 64), Ordering::Relaxed);
        }
    }

    /// Clears the bits of a slot.
    pub(crate) fn clear(&self, slot: u64) {
        let first = slot & ((1 << SLOT_BITS) - 1);
        for bit in first..=first + (slot >> SLOT_BITS) {
            self.bits[bit as usize / 64].fetch_and(!(1 << (bit % 64)), Ordering::Relaxed);
        }
    }

    /// Strengths (R, C) of all parts from those of the sources (N, C) in tree order.
    pub fn strengths<const C: usize>(&self, q: &[[f64; C]]) -> Vec<[f64; C]> {
        self.runs.strengths(q)
    }

    /// Adds what arrives at the points of one target leaf from the strengths of the parts, through a medium if any absorbs.
    pub fn add<const C: usize>(
        &self,
        targets: &Octree,
        leaf: usize,
        strengths: &[[f64; C]],
        medium: Option<&Medium>,
        irradiance: &mut [[f64; C]],
    ) {
        let Some(&place) = self.places.get(&(leaf as u32)) else { return };
        let links = &self.leaves[place];
        if let Some(medium) = medium {
            return self.add_absorbed(targets, links, strengths, medium, irradiance);
        }
        let parts = || links.runs.iter().flat_map(|&run| self.runs.runs[run as usize].parts.clone());
        let softening: Vec<f64> = parts().map(|part| self.runs.softening[part as usize]).collect();
        let vectors = |rows: &[[f64; 3]]| parts().map(|part| rows[part as usize]).collect::<Vec<_>>();
        let (positions, normals) = (vectors(&self.runs.positions), vectors(&self.runs.normals));
        let strengths: Vec<[f64; C]> = parts().map(|part| strengths[part as usize]).collect();
        let Ok(sources) = Sources::new(&positions, &normals, &softening) else { return };
        let points = targets.points_of(leaf);
        let words = links.first_word..links.first_word + points.len() * sources.words();
        let bits: Vec<u64> = self.bits[words].iter().map(|word| word.load(Ordering::Relaxed)).collect();
        let (x, n_x) = (&targets.positions[points.clone()], &targets.normals[points]);
        sources.add_visible(x, n_x, &sources.strengths(&strengths), &bits, irradiance);
    }

    fn add_absorbed<const C: usize>(
        &self,
        targets: &Octree,
        links: &LeafLinks,
        strengths: &[[f64; C]],
        medium: &Medium,
        irradiance: &mut [[f64; C]],
    ) {
        let runs = &self.runs;
        let parts: Vec<usize> = links.runs.iter().flat_map(|&run| to_usize(&runs.runs[run as usize].parts)).collect();
        let points = targets.points_of(links.leaf as usize);
        let left = links.left.get_or_init(|| {
            let left = |row: usize, column: usize| {
                let seen = self.is_set(self.bit(links, row, column as u32));
                let left = || medium.left(targets.positions[points.start + row], runs.positions[parts[column]]);
                if seen { left().map(|left: f64| left as f32) } else { [0.0; 3] }
            };
            (0..points.len())
                .flat_map(|row| (0..parts.len()).map(move |column| (row, column)))
                .map(|(row, column)| left(row, column))
                .collect()
        });
        for ((i, left), out) in points.zip(left.chunks(links.width)).zip(irradiance) {
            let (x, n_x) = (targets.positions[i], targets.normals[i]);
            for (&part, left) in parts.iter().zip(left).filter(|(_, left)| **left != [0.0; 3]) {
                let k = kernel(x, n_x, runs.positions[part], runs.normals[part], runs.softening[part]);
                (0..C).for_each(|c| out[c] += k * f64::from(left[c]) * strengths[part][c]);
            }
        }
    }

    /// Adds to what each source (N,) sends for one unit of strength, what it sends to points of areas (M,), tree order.
    pub fn sent(&self, targets: &Octree, areas: &[[f64; 1]], sent: &mut [[f64; 1]]) {
        let runs = &self.runs;
        let of_leaf = |links: &LeafLinks| -> Vec<(u32, f64)> {
            let parts: Vec<u32> = links.runs.iter().flat_map(|&run| runs.runs[run as usize].parts.clone()).collect();
            let mut of_parts = vec![0.0; parts.len()];
            for (row, i) in targets.points_of(links.leaf as usize).enumerate() {
                let (x, n_x) = (targets.positions[i], targets.normals[i]);
                for (column, &part) in (0..).zip(&parts) {
                    if self.is_set(self.bit(links, row, column)) {
                        let part = part as usize;
                        let (y, n_y, softening) = (runs.positions[part], runs.normals[part], runs.softening[part]);
                        of_parts[column as usize] += areas[i][0] * kernel(x, n_x, y, n_y, softening);
                    }
                }
            }
            parts.into_iter().zip(of_parts).collect()
        };
        let of_leaves: Vec<Vec<(u32, f64)>> = self.leaves.par_iter().map(of_leaf).collect();
        for (part, value) in of_leaves.into_iter().flatten() {
            to_usize(&runs.parts[part as usize]).for_each(|j| sent[j][0] += value);
        }
    }
}
