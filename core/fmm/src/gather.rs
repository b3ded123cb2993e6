// SPDX-License-Identifier: GPL-3.0-or-later
//! Gathering: what the points of a target leaf receive from source boxes that they see in part.
//!
//! Such pairs stay open in the visible lists. Each point of the leaf sends rays over its hemisphere, evenly by cosine, so
//! that each ray stands for the same share of the irradiance; it counts with the radiosity of the source that it meets,
//! but not at all where the pair is valid, or a link, and was summed already. Only directions in which open boxes lie get
//! a ray, and those along the surface, where a smooth normal sees facets that face away by all that boxes know.

use crate::blend::{self, Blend};
use crate::directions::{Cube, Mask, cell, cosine_direction, tangents};
use crate::error::{Error, same_length};
use crate::medium::{Medium, kept};
use crate::octree::Octree;
use crate::rays::Frame;
use crate::surface::Surface;
use crate::vector::{add, dot, norm, scale, sub};
use rayon::prelude::*;
use std::ops::Range;
use std::sync::OnceLock;

/// Turn from one ray to the next, of a whole one: Vogel's spiral, which covers a disk most evenly (Vogel, "A better way to
/// construct the sunflower head", Mathematical Biosciences 44, 1979).
const GOLDEN: f64 = 0.618_033_988_749_894_8;
/// The generators of the R2 sequence: Roberts, "The unreasonable effectiveness of quasirandom sequences", 2018.
const R2: [f64; 2] = [0.754_877_666_246_692_8, 0.569_840_290_998_053_2];

/// Cosine up to which a direction lies along the surface.
const ALONG: f64 = 0.2;

/// A target leaf that sees sources in part.
#[derive(Debug)]
pub struct OpenLeaf {
    pub leaf: u32,
    /// Sources that are summed otherwise, in tree order, ascending and apart.
    closed: Vec<Range<u32>>,
    directions: Mask,
    /// Whether a triangle stands between its points.
    parted: bool,
    hits: OnceLock<Hits>,
}

/// The sources met from each point of a leaf.
#[derive(Debug, Default)]
struct Hits {
    /// (points + 1)
    starts: Vec<u32>,
    /// Tree order.
    sources: Vec<u32>,
    /// What is left of the light of each; none where the medium is clear.
    left: Vec<[f32; 3]>,
    blend: Blend,
}

/// The open leaves, and the rays that they want.
#[derive(Debug, Default)]
pub struct Gather {
    pub leaves: Vec<OpenLeaf>,
    /// Rays that a point sends if all of its hemisphere is open.
    density: usize,
    /// Place in `leaves` of each target box, or none.
    places: Vec<Option<u32>>,
    /// (N,) area that each source stands for, tree order.
    weights: Vec<f64>,
}

/// Rays of some open leaves.
#[derive(Debug, Default)]
pub struct GatherRays {
    /// (R) target point in tree order, ascending.
    pub points: Vec<u32>,
    pub origins: Vec<[f32; 3]>,
    pub directions: Vec<[f32; 3]>,
}

/// What rays met: triangles, -1 for none, and where on them.
pub struct Met<'a> {
    pub points: &'a [u32],
    pub directions: &'a [[f32; 3]],
    pub triangles: &'a [i32],
    pub u: &'a [f32],
    pub v: &'a [f32],
}

impl Gather {
    /// From open pairs of a target leaf and a source box, the boxes that are summed for each leaf otherwise, and whether a
    /// triangle stands between its points; `weights` (N,) in tree order. `margin` (B,) is how far the surface that the
    /// points of a source box stand for goes beyond them.
    pub fn new(
        (targets, sources): (&Octree, &Octree),
        margin: &[f64],
        mut pairs: Vec<(u32, u32)>,
        summed: impl Fn(u32) -> Vec<u32> + Sync,
        parted: impl Fn(u32) -> bool + Sync,
        weights: Vec<f64>,
        density: usize,
    ) -> Self {
        pairs.par_sort_unstable_by_key(|&(leaf, s)| (targets.points[leaf as usize][0], s));
        let mut places = vec![None; targets.n_boxes()];
        let cube = Cube::new();
        let rows: Vec<&[(u32, u32)]> = pairs.chunk_by(|a, b| a.0 == b.0).collect();
        for (row, place) in rows.iter().zip(0..) {
            places[row[0].0 as usize] = Some(place);
        }
        let open_leaf = |row: &&[(u32, u32)]| OpenLeaf {
            leaf: row[0].0,
            closed: ranges(sources, &summed(row[0].0)),
            directions: directions(targets, sources, margin, row, &cube),
            parted: parted(row[0].0),
            hits: OnceLock::new(),
        };
        let leaves = rows.par_iter().map(open_leaf).collect();
        Self { leaves, density, places, weights }
    }

    /// Whether a target leaf gets source j, in tree order, by rays over the hemispheres.
    pub fn has(&self, leaf: u32, j: u32) -> bool {
        self.of(leaf as usize).is_some_and(|open| open.counts(j))
    }

    fn of(&self, leaf: usize) -> Option<&OpenLeaf> {
        self.places.get(leaf).copied().flatten().map(|place| &self.leaves[place as usize])
    }

    /// Rays of some of the leaves.
    pub fn rays(&self, targets: &Octree, frame: &Frame, leaves: Range<usize>) -> GatherRays {
        let mut rays = GatherRays::default();
        for open in &self.leaves[leaves] {
            for i in targets.points_of(open.leaf as usize) {
                let (x, n) = (targets.positions[i], targets.normals[i]);
                let (s, t) = tangents(n);
                let origin = frame.start(x, n);
                // Points next to each other have spirals of their own, so that their errors differ.
                let [shift, turn] = R2.map(|r| (r * (i as f64 + 0.5)).fract());
                for k in 0..self.density {
                    let at = [(k as f64 + shift) / self.density as f64, GOLDEN * k as f64 + turn];
                    let d = cosine_direction(n, s, t, at);
                    if open.directions.has(cell(d)) || dot(d, n) < ALONG {
                        rays.points.push(i as u32);
                        rays.origins.push(origin);
                        rays.directions.push(d.map(|c| c as f32));
                    }
                }
            }
        }
        rays
    }

    /// Takes what the rays of the same leaves met in a medium.
    pub fn take(
        &self,
        trees: (&Octree, &Octree),
        medium: &Medium,
        surface: &Surface,
        leaves: Range<usize>,
        met: &Met,
    ) -> Result<(), Error> {
        same_length("ray directions", met.points.len(), met.directions.len())?;
        same_length("triangles met", met.points.len(), met.triangles.len())?;
        same_length("places met", met.points.len(), met.u.len())?;
        same_length("places met", met.points.len(), met.v.len())?;
        let (targets, sources) = trees;
        let (mut ray, mut lengths) = (0, Vec::new());
        for open in &self.leaves[leaves] {
            let points = targets.points_of(open.leaf as usize);
            let (mut hits, mut reaches) = (Hits { starts: vec![0], ..Hits::default() }, Vec::new());
            for i in points.clone() {
                lengths.clear();
                while ray < met.points.len() && met.points[ray] as usize == i {
                    let (x, place) = (targets.positions[i], met.place(ray, surface));
                    lengths.push(place.map_or(f64::INFINITY, |y| norm(sub(y, x))));
                    if let Some(j) = met.source(ray, surface, sources).filter(|&j| open.counts(j)) {
                        hits.sources.push(j);
                        let place = place.filter(|_| !medium.is_clear());
                        hits.left.extend(place.map(|y| medium.left(x, y).map(|left: f64| left as f32)));
                    }
                    ray += 1;
                }
                reaches.push(blend::distance(&mut lengths));
                hits.starts.push(hits.sources.len() as u32);
            }
            hits.blend = match open.parted {
                true => Blend::none(points.len()),
                false => {
                    Blend::new(&targets.positions[points.clone()], &targets.normals[points], &reaches, self.density)
                }
            };
            // A leaf that was traced before keeps its answers.
            let _ = open.hits.set(hits);
        }
        Ok(())
    }

    /// Radiosity (N, C) of the sources from their strengths, both in tree order.
    pub fn radiosity<const C: usize>(&self, q: &[[f64; C]]) -> Vec<[f64; C]> {
        q.iter().zip(&self.weights).map(|(q, w)| q.map(|q| q / w)).collect()
    }

    /// Adds what arrives at the points of a target leaf from the radiosity of the sources; `clear` as if nothing were
    /// absorbed.
    pub fn add<const C: usize>(&self, leaf: usize, radiosity: &[[f64; C]], clear: bool, irradiance: &mut [[f64; C]]) {
        let Some(hits) = self.of(leaf).and_then(|open| open.hits.get()) else { return };
        let share = 1.0 / self.density as f64;
        let left: &[[f32; 3]] = if clear { &[] } else { &hits.left };
        let own = |ends: &[u32]| {
            let mut sum = [0.0; C];
            for ray in ends[0] as usize..ends[1] as usize {
                let (b, left) = (radiosity[hits.sources[ray] as usize], kept::<C>(left, ray));
                (0..C).for_each(|c| sum[c] += left[c] * b[c]);
            }
            sum.map(|sum| share * sum)
        };
        let own: Vec<[f64; C]> = hits.starts.windows(2).map(own).collect();
        hits.blend.add(&own, irradiance);
    }

    /// Adds to what each source (N,) sends for one unit of strength, what it sends to points of areas (M,), tree order.
    pub fn sent(&self, targets: &Octree, areas: &[[f64; 1]], sent: &mut [[f64; 1]]) {
        let share = 1.0 / self.density as f64;
        for open in &self.leaves {
            let Some(hits) = open.hits.get() else { continue };
            let areas = hits.blend.transposed(&areas[targets.points_of(open.leaf as usize)]);
            for (ends, area) in hits.starts.windows(2).zip(areas) {
                for &j in &hits.sources[ends[0] as usize..ends[1] as usize] {
                    sent[j as usize][0] += share * area / self.weights[j as usize];
                }
            }
        }
    }

    /// Sources met from all points together.
    pub fn count(&self) -> usize {
        self.leaves.iter().filter_map(|open| open.hits.get()).map(|hits| hits.sources.len()).sum()
    }
}

impl OpenLeaf {
    fn counts(&self, j: u32) -> bool {
        let after = self.closed.partition_point(|range| range.start <= j);
        after == 0 || j >= self.closed[after - 1].end
    }
}

/// The points of boxes, in ranges that are ascending and apart.
fn ranges(sources: &Octree, boxes: &[u32]) -> Vec<Range<u32>> {
    let mut points: Vec<[u32; 2]> = boxes.iter().map(|&s| sources.points[s as usize]).collect();
    points.sort_unstable();
    let mut ranges: Vec<Range<u32>> = Vec::new();
    for [start, end] in points {
        match ranges.last_mut() {
            Some(last) if last.end >= start => last.end = last.end.max(end),
            _ => ranges.push(start..end),
        }
    }
    ranges
}

/// The directions in which the source boxes of a leaf's open pairs lie.
fn directions(targets: &Octree, sources: &Octree, margin: &[f64], row: &[(u32, u32)], cube: &Cube) -> Mask {
    let mut mask = Mask::default();
    let (middle, radius) = sphere(targets, row[0].0 as usize);
    for &(_, s) in row {
        let (centre, reach) = sphere(sources, s as usize);
        cube.mark(sub(centre, middle), radius + reach + margin[s as usize], &mut mask);
    }
    mask
}

impl Met<'_> {
    /// The source that a ray met, tree order; none behind a surface that has only a front.
    fn source(&self, ray: usize, surface: &Surface, sources: &Octree) -> Option<u32> {
        let j = surface.met(self.triangles[ray], (self.u[ray], self.v[ray]), self.directions[ray])?;
        sources.to_tree.get(j as usize).copied()
    }

    /// Where a ray ended, if it met anything.
    fn place(&self, ray: usize, surface: &Surface) -> Option<[f64; 3]> {
        surface.place(self.triangles[ray], (self.u[ray], self.v[ray]))
    }
}

/// Middle of the bounding box of the points of a box, and half its diagonal.
fn sphere(tree: &Octree, b: usize) -> ([f64; 3], f64) {
    (scale(add(tree.low[b], tree.high[b]), 0.5), 0.5 * norm(sub(tree.high[b], tree.low[b])))
}
