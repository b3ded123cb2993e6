// SPDX-License-Identifier: GPL-3.0-or-later
//! Links: what a target leaf receives from source boxes that it sees in part. The receivers' side is postponed to its
//! points, the sources' side is cut into runs of neighbouring points, and each point of the leaf has a bit for each run
//! that says whether it sees it.

use crate::direct::Sources;
use crate::error::{Error, same_length};
use crate::octree::Octree;
use rayon::prelude::*;
use std::collections::HashMap;
use std::ops::Range;
use std::sync::atomic::{AtomicU64, Ordering};

/// Runs of source points, in tree order, each of which stands for one source.
#[derive(Debug, Default)]
pub struct Runs {
    pub points: Vec<Range<u32>>,
    positions: Vec<[f64; 3]>,
    /// Means, not made unit: a bent run sends less.
    normals: Vec<[f64; 3]>,
    softening: Vec<f64>,
    /// Runs of a source box cut into so many.
    known: HashMap<(u32, u32), Range<u32>>,
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
    /// The runs of source box s cut into at most `count` of equal weight; `softening` (N,) in tree order.
    pub fn of(&mut self, tree: &Octree, s: u32, count: u32, weights: &Weights, softening: &[f64]) -> Range<u32> {
        if let Some(known) = self.known.get(&(s, count)) {
            return known.clone();
        }
        let first = self.points.len() as u32;
        let points = tree.points_of(s as usize);
        let all = count as usize >= points.len();
        let count = (count as usize).min(points.len());
        let cut = |run: usize| match run {
            0 => points.start,
            _ if run == count => points.end,
            _ if all => points.start + run,
            _ => weights.at(&points, run as f64 / count as f64),
        };
        for run in (0..count).map(|run| cut(run)..cut(run + 1)).filter(|run| !run.is_empty()) {
            self.push(tree, run, weights, softening);
        }
        let runs = first..self.points.len() as u32;
        self.known.insert((s, count as u32), runs.clone());
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
        self.points.push(points.start as u32..points.end as u32);
    }

    fn strengths(&self, q: &[[f64; 3]]) -> Vec<[f64; 3]> {
        let sum = |run: &Range<u32>| {
            q[run.start as usize..run.end as usize]
                .iter()
                .fold([0.0; 3], |sum: [f64; 3], q| [sum[0] + q[0], sum[1] + q[1], sum[2] + q[2]])
        };
        self.points.par_iter().map(sum).collect()
    }
}

/// The runs that a leaf sees in part, and where its points' rows of bits start.
#[derive(Debug)]
pub struct LeafLinks {
    pub leaf: u32,
    /// In order of their points, which no two of them share.
    pub runs: Vec<u32>,
    first_word: usize,
}

/// The links of all leaves, with their bits.
#[derive(Debug, Default)]
pub struct Links {
    pub leaves: Vec<LeafLinks>,
    pub runs: Runs,
    /// (B,) place of each target box in `leaves`, where it has links.
    places: HashMap<u32, usize>,
    bits: Vec<AtomicU64>,
}

impl Links {
    /// Links with all bits set, from pairs of a target leaf and a run.
    pub fn new(targets: &Octree, mut pairs: Vec<(u32, u32)>, runs: Runs) -> Self {
        pairs.par_sort_unstable_by_key(|&(leaf, run)| (targets.points[leaf as usize][0], runs.points[run as usize].start));
        let (mut leaves, mut places, mut words) = (Vec::new(), HashMap::new(), 0);
        for row in pairs.chunk_by(|a, b| a.0 == b.0) {
            let leaf = row[0].0;
            places.insert(leaf, leaves.len());
            leaves.push(LeafLinks { leaf, runs: row.iter().map(|pair| pair.1).collect(), first_word: words });
            words += targets.count(leaf as usize) * row.len().div_ceil(64);
        }
        let bits = (0..words).map(|_| AtomicU64::new(u64::MAX)).collect();
        Self { leaves, runs, places, bits }
    }

    /// Pairs of a point and a run.
    pub fn count(&self, targets: &Octree) -> usize {
        self.leaves.iter().map(|links| targets.count(links.leaf as usize) * links.runs.len()).sum()
    }

    /// Number of the bit of a leaf's point and run, by their places.
    pub fn bit(&self, links: &LeafLinks, row: usize, column: usize) -> u64 {
        ((links.first_word + row * links.runs.len().div_ceil(64)) * 64 + column) as u64
    }

    fn is_set(&self, bit: u64) -> bool {
        self.bits[bit as usize / 64].load(Ordering::Relaxed) >> (bit % 64) & 1 == 1
    }

    /// Whether the row-th point of a target leaf sees source point j through a link that has j as a run of its own;
    /// None where there is no such link.
    pub fn sees(&self, leaf: u32, row: usize, j: usize) -> Option<bool> {
        let links = &self.leaves[*self.places.get(&leaf)?];
        let end = links.runs.partition_point(|&run| self.runs.points[run as usize].start as usize <= j);
        let column = end.checked_sub(1)?;
        let run = &self.runs.points[links.runs[column] as usize];
        (j < run.end as usize).then(|| self.is_set(self.bit(links, row, column)))
    }

    /// Clears the bits of the rays that did not arrive.
    pub fn block(&self, bits: &[u64], occluded: &[bool]) -> Result<(), Error> {
        same_length("answers", bits.len(), occluded.len())?;
        for (&bit, _) in bits.iter().zip(occluded).filter(|(_, occluded)| **occluded) {
            let word = self.bits.get(bit as usize / 64).ok_or(Error::Index {
                what: "visibility bit",
                index: bit as usize,
                count: 64 * self.bits.len(),
            })?;
            word.fetch_and(!(1 << (bit % 64)), Ordering::Relaxed);
        }
        Ok(())
    }

    /// Strengths (R, 3) of all runs from those of the sources (N, 3) in tree order.
    pub fn strengths(&self, q: &[[f64; 3]]) -> Vec<[f64; 3]> {
        self.runs.strengths(q)
    }

    /// Adds what arrives at the points of one target leaf, from the strengths of the runs.
    pub fn add(&self, targets: &Octree, leaf: usize, strengths: &[[f64; 3]], irradiance: &mut [[f64; 3]]) {
        let Some(&place) = self.places.get(&(leaf as u32)) else { return };
        let links = &self.leaves[place];
        let of_runs = |rows: &[[f64; 3]]| links.runs.iter().map(|&run| rows[run as usize]).collect::<Vec<_>>();
        let softening: Vec<f64> = links.runs.iter().map(|&run| self.runs.softening[run as usize]).collect();
        let (positions, normals) = (of_runs(&self.runs.positions), of_runs(&self.runs.normals));
        let Ok(sources) = Sources::new(&positions, &normals, &softening) else { return };
        let points = targets.points_of(leaf);
        let words = links.first_word..links.first_word + points.len() * sources.words();
        let bits: Vec<u64> = self.bits[words].iter().map(|word| word.load(Ordering::Relaxed)).collect();
        let (x, n_x) = (&targets.positions[points.clone()], &targets.normals[points]);
        sources.add_visible(x, n_x, &sources.strengths(&of_runs(strengths)), &bits, irradiance);
    }
}
