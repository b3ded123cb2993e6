// SPDX-License-Identifier: GPL-3.0-or-later
//! Gathering: what the points of a target leaf receive from source boxes that they see in part.
//!
//! Such pairs stay open in the visible lists. Each point of the leaf sends rays over its hemisphere, evenly by cosine, so
//! that each ray stands for the same share of the irradiance; it counts with the radiosity of the source that it meets,
//! but not at all where the pair is valid, or a link, and was summed already. Only directions in which open boxes lie get
//! a ray, and those along the surface, where a smooth normal sees facets that face away by all that boxes know.

use crate::directions::{Cube, Mask, cell, cosine_direction, tangents};
use crate::error::{Error, same_length};
use crate::hits::{Hits, NOTHING, Ray, Told};
use crate::medium::Medium;
use crate::moving::Bounds;
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
    /// What all of its rays met, where some of them may meet other things later.
    told: OnceLock<Told>,
    /// In place of `hits` where some did.
    moved: OnceLock<Hits>,
}

/// The open leaves, and the rays that they want.
#[derive(Debug, Default)]
pub struct Gather {
    pub leaves: Vec<OpenLeaf>,
    /// Rays that a point sends if all of its hemisphere is open.
    density: usize,
    /// Place in `leaves` of each target box, or none.
    places: Vec<Option<u32>>,
    /// (N,) area that each source stands for, tree order; those of guests follow.
    weights: Vec<f64>,
    /// What rays met is told apart, as something may get into their way later.
    moving: bool,
}

/// Rays of some open leaves.
#[derive(Debug, Default)]
pub struct GatherRays {
    /// (R) target point in tree order, ascending.
    pub points: Vec<u32>,
    /// (R) place among the rays of their leaf.
    pub places: Vec<u32>,
    pub origins: Vec<[f32; 3]>,
    pub directions: Vec<[f32; 3]>,
}

/// What rays met: triangles, -1 for none, and where on them.
pub struct Met<'a> {
    pub points: &'a [u32],
    pub places: &'a [u32],
    pub directions: &'a [[f32; 3]],
    pub triangles: &'a [i32],
    pub u: &'a [f32],
    pub v: &'a [f32],
}

impl Gather {
    /// From open pairs of a target leaf and a source box, the boxes that are summed for each leaf otherwise, and whether a
    /// triangle stands between its points; `weights` (N,) in tree order. `margin` (B,) is how far the surface that the
    /// points of a source box stand for goes beyond them. Where things move in `boxes`, all leaves send rays into these.
    #[allow(clippy::too_many_arguments)]
    pub fn new(
        (targets, sources): (&Octree, &Octree),
        margin: &[f64],
        boxes: &[Bounds],
        mut pairs: Vec<(u32, u32)>,
        summed: impl Fn(u32) -> Vec<u32> + Sync,
        parted: impl Fn(u32) -> bool + Sync,
        weights: Vec<f64>,
        density: usize,
    ) -> Self {
        pairs.par_sort_unstable_by_key(|&(leaf, s)| (targets.points[leaf as usize][0], s));
        let mut places = vec![None; targets.n_boxes()];
        let cube = Cube::new();
        let mut rows: Vec<(u32, &[(u32, u32)])> =
            pairs.chunk_by(|a, b| a.0 == b.0).map(|row| (row[0].0, row)).collect();
        if !boxes.is_empty() {
            let known: Vec<u32> = rows.iter().map(|row| row.0).collect();
            let missing = targets.leaves().map(|leaf| leaf as u32).filter(|leaf| !known.contains(leaf));
            rows.extend(missing.map(|leaf| (leaf, &[] as &[_])));
            rows.sort_unstable_by_key(|row| targets.points[row.0 as usize][0]);
        }
        for (row, place) in rows.iter().zip(0..) {
            places[row.0 as usize] = Some(place);
        }
        let open_leaf = |&(leaf, row): &(u32, &[(u32, u32)])| OpenLeaf {
            leaf,
            closed: ranges(sources, &summed(leaf)),
            directions: directions(targets, (sources, margin), (leaf, row), boxes, &cube),
            parted: parted(leaf),
            hits: OnceLock::new(),
            told: OnceLock::new(),
            moved: OnceLock::new(),
        };
        let leaves = rows.par_iter().map(open_leaf).collect();
        Self { leaves, density, places, weights, moving: !boxes.is_empty() }
    }

    /// From now on guests, which stand for such areas, may be met; what rays met before they came is still known.
    pub fn welcome(&mut self, sources: usize, areas: &[f64]) {
        self.weights.truncate(sources);
        self.weights.extend(areas);
        self.leaves.iter_mut().for_each(|open| open.moved = OnceLock::new());
    }

    /// Whether a target leaf gets source j, in tree order, by rays over the hemispheres.
    pub fn has(&self, leaf: u32, j: u32) -> bool {
        self.of(leaf as usize).is_some_and(|open| open.counts(j))
    }

    fn of(&self, leaf: usize) -> Option<&OpenLeaf> {
        self.places.get(leaf).copied().flatten().map(|place| &self.leaves[place as usize])
    }

    /// Rays of some of the leaves, those of them that are wanted by their origins and directions.
    pub fn rays(
        &self,
        targets: &Octree,
        frame: &Frame,
        leaves: Range<usize>,
        wanted: impl Fn([f32; 3], [f32; 3]) -> bool,
    ) -> GatherRays {
        let mut rays = GatherRays::default();
        for open in &self.leaves[leaves] {
            let mut place = 0;
            for i in targets.points_of(open.leaf as usize) {
                let (x, n) = (targets.positions[i], targets.normals[i]);
                let (s, t) = tangents(n);
                let origin = frame.start(x, n);
                // Points next to each other have spirals of their own, so that their errors differ.
                let [shift, turn] = R2.map(|r| (r * (i as f64 + 0.5)).fract());
                for k in 0..self.density {
                    let at = [(k as f64 + shift) / self.density as f64, GOLDEN * k as f64 + turn];
                    let d = cosine_direction(n, s, t, at);
                    if !open.directions.has(cell(d)) && dot(d, n) >= ALONG {
                        continue;
                    }
                    let direction = d.map(|c| c as f32);
                    if wanted(origin, direction) {
                        rays.points.push(i as u32);
                        rays.places.push(place);
                        rays.origins.push(origin);
                        rays.directions.push(direction);
                    }
                    place += 1;
                }
            }
        }
        rays
    }

    /// Takes what the rays of the same leaves met in a medium.
    pub fn take(
        &self,
        (targets, sources): (&Octree, &Octree),
        medium: &Medium,
        surface: &Surface,
        leaves: Range<usize>,
        met: &Met,
    ) -> Result<(), Error> {
        met.check()?;
        let mut ray = 0;
        for open in &self.leaves[leaves] {
            let points = targets.points_of(open.leaf as usize);
            let (mut told, mut left) = (Told::default(), Vec::new());
            for i in points.clone() {
                while ray < met.points.len() && met.points[ray] as usize == i {
                    let x = targets.positions[i];
                    let answer = self.answer(open, (x, sources), surface, met, ray);
                    if answer.0 != NOTHING && !medium.is_clear() {
                        let place = met.place(ray, surface);
                        left.extend(place.map(|y| medium.left(x, y).map(|left: f64| left as f32)));
                    }
                    told.push(answer);
                    ray += 1;
                }
                told.end_point();
            }
            // A leaf that was traced before keeps its answers.
            let _ = open.hits.set(self.hits(targets, open, &told, left));
            if self.moving {
                let _ = open.told.set(told);
            }
        }
        Ok(())
    }

    /// Takes what some rays of leaves meet since something moved, in place of what they met before.
    pub fn take_moved(
        &self,
        (targets, sources): (&Octree, &Octree),
        surface: &Surface,
        leaves: Range<usize>,
        met: &Met,
    ) -> Result<(), Error> {
        met.check()?;
        same_length("places of rays", met.points.len(), met.places.len())?;
        let mut ray = 0;
        for open in &self.leaves[leaves] {
            let points = targets.points_of(open.leaf as usize);
            let of_leaf = met.points[ray..].iter().take_while(|&&i| points.contains(&(i as usize))).count();
            let (rays, known) = (ray..ray + of_leaf, open.told.get());
            ray += of_leaf;
            let (Some(known), false) = (known, rays.is_empty()) else { continue };
            let mut told = known.clone();
            for ray in rays {
                let x = targets.positions[met.points[ray] as usize];
                told.replace(met.places[ray] as usize, self.answer(open, (x, sources), surface, met, ray))?;
            }
            let _ = open.moved.set(self.hits(targets, open, &told, Vec::new()));
        }
        Ok(())
    }

    /// What a ray from x met.
    fn answer(
        &self,
        open: &OpenLeaf,
        (x, sources): ([f64; 3], &Octree),
        surface: &Surface,
        met: &Met,
        ray: usize,
    ) -> Ray {
        let length = met.place(ray, surface).map_or(f64::INFINITY, |y| norm(sub(y, x)));
        let source = met.source(ray, surface, sources, self.weights.len()).filter(|&j| open.counts(j));
        (source.unwrap_or(NOTHING), length as f32)
    }

    fn hits(&self, targets: &Octree, open: &OpenLeaf, told: &Told, left: Vec<[f32; 3]>) -> Hits {
        let points = targets.points_of(open.leaf as usize);
        let at: (&[_], &[_]) = (&targets.positions[points.clone()], &targets.normals[points]);
        Hits::new(told, left, at, (!open.parted).then_some(self.density))
    }

    /// Radiosity (N, C) of the sources from their strengths, both in tree order.
    pub fn radiosity<const C: usize>(&self, q: &[[f64; C]]) -> Vec<[f64; C]> {
        q.iter().zip(&self.weights).map(|(q, w)| q.map(|q| q / w)).collect()
    }

    /// Adds what arrives at the points of a target leaf from the radiosity of the sources; `clear` as if nothing were
    /// absorbed.
    pub fn add<const C: usize>(&self, leaf: usize, radiosity: &[[f64; C]], clear: bool, irradiance: &mut [[f64; C]]) {
        let Some(hits) = self.of(leaf).and_then(OpenLeaf::hits) else { return };
        hits.add(radiosity, 1.0 / self.density as f64, clear, irradiance);
    }

    /// Adds to what each source (N,) sends for one unit of strength, what it sends to points of areas (M,), tree order.
    pub fn sent(&self, targets: &Octree, areas: &[[f64; 1]], sent: &mut [[f64; 1]]) {
        let share = 1.0 / self.density as f64;
        for open in &self.leaves {
            let Some(hits) = open.hits() else { continue };
            let areas = &areas[targets.points_of(open.leaf as usize)];
            hits.sent(areas, |j, area| sent[j][0] += share * area / self.weights[j]);
        }
    }

    /// Sources met from all points together.
    pub fn count(&self) -> usize {
        self.leaves.iter().filter_map(OpenLeaf::hits).map(Hits::count).sum()
    }
}

impl OpenLeaf {
    /// What its rays meet now.
    fn hits(&self) -> Option<&Hits> {
        self.moved.get().or_else(|| self.hits.get())
    }

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

/// The directions in which the source boxes of a leaf's open pairs lie, and other boxes.
fn directions(
    targets: &Octree,
    (sources, margin): (&Octree, &[f64]),
    (leaf, row): (u32, &[(u32, u32)]),
    boxes: &[Bounds],
    cube: &Cube,
) -> Mask {
    let mut mask = Mask::default();
    let (middle, radius) = sphere([targets.low[leaf as usize], targets.high[leaf as usize]]);
    for &(_, s) in row {
        let (centre, reach) = sphere([sources.low[s as usize], sources.high[s as usize]]);
        cube.mark(sub(centre, middle), radius + reach + margin[s as usize], &mut mask);
    }
    for &bounds in boxes {
        let (centre, reach) = sphere(bounds);
        cube.mark(sub(centre, middle), radius + reach, &mut mask);
    }
    mask
}

impl Met<'_> {
    fn check(&self) -> Result<(), Error> {
        same_length("ray directions", self.points.len(), self.directions.len())?;
        same_length("triangles met", self.points.len(), self.triangles.len())?;
        same_length("places met", self.points.len(), self.u.len())?;
        same_length("places met", self.points.len(), self.v.len())
    }

    /// The source that a ray met, tree order, or a guest, of so many of both; none behind a surface that has only a front.
    fn source(&self, ray: usize, surface: &Surface, sources: &Octree, count: usize) -> Option<u32> {
        let j = surface.met(self.triangles[ray], (self.u[ray], self.v[ray]), self.directions[ray])?;
        sources.to_tree.get(j as usize).copied().or(Some(j).filter(|&j| (j as usize) < count))
    }

    /// Where a ray ended, if it met anything.
    fn place(&self, ray: usize, surface: &Surface) -> Option<[f64; 3]> {
        surface.place(self.triangles[ray], (self.u[ray], self.v[ray]))
    }
}

/// Middle of a box, and half its diagonal.
fn sphere([low, high]: Bounds) -> ([f64; 3], f64) {
    (scale(add(low, high), 0.5), 0.5 * norm(sub(high, low)))
}
