// SPDX-License-Identifier: GPL-3.0-or-later
//! Gathering: what the points of a target leaf receive from source boxes that they see in part.
//!
//! Such pairs stay open in the visible lists. Each point of the leaf sends rays over its hemisphere, evenly by cosine, so
//! that each ray stands for the same share of the irradiance; it counts with the radiosity of the source that it meets,
//! but not at all where the pair is valid, or a link, and was summed already. Only directions in which open boxes lie get
//! a ray, and those along the surface, where a smooth normal sees facets that face away by all that boxes know.

use crate::blend::{self, Blend};
use crate::error::{Error, same_length};
use crate::octree::Octree;
use crate::rays::Frame;
use crate::surface::Surface;
use crate::vector::{add, cross, dot, norm, scale, sub};
use rayon::prelude::*;
use std::f64::consts::TAU;
use std::ops::Range;
use std::sync::OnceLock;

/// Cells along one side of a face of the cube that directions are sorted into.
const SIDE: usize = 8;
const CELLS: usize = 6 * SIDE * SIDE;
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
#[derive(Debug)]
struct Hits {
    /// (points + 1)
    starts: Vec<u32>,
    /// Tree order.
    sources: Vec<u32>,
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
    /// From open pairs of a target leaf and a source box, the boxes that are summed for each leaf otherwise, and
    /// whether a triangle stands between its points; `weights`
    /// (N,) in tree order. `margin` (B,) is how far the surface that the points of a source box stand for goes beyond them.
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

    /// Takes what the rays of the same leaves met.
    pub fn take(
        &self,
        trees: (&Octree, &Octree),
        surface: &Surface,
        leaves: Range<usize>,
        met: &Met,
    ) -> Result<(), Error> {
        same_length("ray directions", met.points.len(), met.directions.len())?;
        same_length("triangles met", met.points.len(), met.triangles.len())?;
        same_length("places met", met.points.len(), met.u.len())?;
        same_length("places met", met.points.len(), met.v.len())?;
        let (targets, sources) = trees;
        let mut ray = 0;
        for open in &self.leaves[leaves] {
            let points = targets.points_of(open.leaf as usize);
            let (mut starts, mut hits, mut distances) = (vec![0], Vec::new(), Vec::new());
            for i in points.clone() {
                let mut lengths = Vec::new();
                while ray < met.points.len() && met.points[ray] as usize == i {
                    hits.extend(met.source(ray, surface, sources).filter(|&j| open.counts(j)));
                    let length = |y| norm(sub(y, targets.positions[i]));
                    lengths.push(met.place(ray, surface).map_or(f64::INFINITY, length));
                    ray += 1;
                }
                distances.push(blend::distance(&mut lengths));
                starts.push(hits.len() as u32);
            }
            let blend = match open.parted {
                true => Blend::none(points.len()),
                false => Blend::new(&targets.positions[points.clone()], &targets.normals[points], &distances),
            };
            let hits = Hits { starts, sources: hits, blend };
            // A leaf that was traced before keeps its answers.
            let _ = open.hits.set(hits);
        }
        Ok(())
    }

    /// Radiosity (N, C) of the sources from their strengths, both in tree order.
    pub fn radiosity<const C: usize>(&self, q: &[[f64; C]]) -> Vec<[f64; C]> {
        q.iter().zip(&self.weights).map(|(q, w)| q.map(|q| q / w)).collect()
    }

    /// Adds what arrives at the points of a target leaf, from the radiosity of the sources.
    pub fn add<const C: usize>(&self, leaf: usize, radiosity: &[[f64; C]], irradiance: &mut [[f64; C]]) {
        let Some(hits) = self.of(leaf).and_then(|open| open.hits.get()) else { return };
        let share = 1.0 / self.density as f64;
        let own = |ends: &[u32]| {
            let mut sum = [0.0; C];
            for &j in &hits.sources[ends[0] as usize..ends[1] as usize] {
                sum.iter_mut().zip(radiosity[j as usize]).for_each(|(sum, b)| *sum += b);
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

/// Two unit vectors at right angles to a unit normal and to each other.
pub(crate) fn tangents(n: [f64; 3]) -> ([f64; 3], [f64; 3]) {
    let axis = if n[0].abs() > 0.6 { [0.0, 1.0, 0.0] } else { [1.0, 0.0, 0.0] };
    let s = cross(n, axis);
    let s = scale(s, 1.0 / norm(s));
    (s, cross(n, s))
}

/// A direction about a normal from two numbers in [0, 1), even by cosine.
fn cosine_direction(n: [f64; 3], s: [f64; 3], t: [f64; 3], at: [f64; 2]) -> [f64; 3] {
    let (radius, (sin, cos)) = (at[0].sqrt(), (TAU * at[1]).sin_cos());
    let height = (1.0 - at[0]).sqrt();
    [0, 1, 2].map(|i| height * n[i] + radius * (cos * s[i] + sin * t[i]))
}

/// The cell of the cube map that a direction lies in.
fn cell(d: [f64; 3]) -> usize {
    let axis = (0..3).fold(0, |best, i| if d[i].abs() > d[best].abs() { i } else { best });
    let at = |i: usize| {
        let place = (d[(axis + i) % 3] / d[axis].abs() + 1.0) * 0.5 * SIDE as f64;
        (place as usize).min(SIDE - 1)
    };
    ((2 * axis + usize::from(d[axis] < 0.0)) * SIDE + at(1)) * SIDE + at(2)
}

/// Which cells of the cube map are taken.
#[derive(Debug, Default, Clone)]
struct Mask([u64; CELLS / 64]);

impl Mask {
    fn has(&self, cell: usize) -> bool {
        self.0[cell / 64] >> (cell % 64) & 1 == 1
    }
}

/// A cell of directions: its middle, unit, and the angle within which all of it lies, as cosine and sine.
#[derive(Clone, Copy)]
struct Cone {
    middle: [f64; 3],
    cos: f64,
    sin: f64,
}

impl Cone {
    /// The cell from (a, b) on of a face of the cube, of a side in parts of the face's half side.
    fn new(face: usize, [a, b]: [f64; 2], side: f64) -> Self {
        let direction = |i: f64, j: f64| {
            let mut d = [0.0; 3];
            d[face / 2] = if face.is_multiple_of(2) { 1.0 } else { -1.0 };
            (d[(face / 2 + 1) % 3], d[(face / 2 + 2) % 3]) = (a + i * side, b + j * side);
            scale(d, 1.0 / norm(d))
        };
        let middle = direction(0.5, 0.5);
        let corners = [(0., 0.), (0., 1.), (1., 0.), (1., 1.)];
        let cos = corners.map(|(i, j)| dot(middle, direction(i, j))).into_iter().fold(1.0, f64::min);
        Self { middle, cos, sin: (1.0 - cos * cos).sqrt() }
    }

    /// Whether any of its directions may be within an angle, given by cosine and sine, of a unit vector.
    fn meets(&self, d: [f64; 3], cos: f64, sin: f64) -> bool {
        // Both angles are at most a right one, so that their sum is at most a straight one.
        dot(self.middle, d) >= self.cos * cos - self.sin * sin
    }
}

/// Cells along one side of a quarter of a face.
const FINE: usize = SIDE / 2;

/// The quarters of all faces of the cube map, and their cells.
struct Cube {
    quarters: Vec<Cone>,
    /// (24, FINE * FINE) cells, each with its number.
    cells: Vec<[(usize, Cone); FINE * FINE]>,
}

impl Cube {
    fn new() -> Self {
        let (mut quarters, mut cells) = (Vec::new(), Vec::new());
        for quarter in 0..24 {
            let (face, i, j) = (quarter / 4, quarter / 2 % 2, quarter % 2);
            let low = [i as f64 - 1.0, j as f64 - 1.0];
            quarters.push(Cone::new(face, low, 1.0));
            cells.push(std::array::from_fn(|k| {
                let (a, b) = (k / FINE, k % FINE);
                let side = 1.0 / FINE as f64;
                let number = (face * SIDE + i * FINE + a) * SIDE + j * FINE + b;
                (number, Cone::new(face, [low[0] + a as f64 * side, low[1] + b as f64 * side], side))
            }));
        }
        Self { quarters, cells }
    }

    /// Marks all directions from within a ball to within another one; d joins their middles, `radius` is that of both.
    fn mark(&self, d: [f64; 3], radius: f64, mask: &mut Mask) {
        let distance = norm(d);
        if distance <= radius {
            mask.0 = [u64::MAX; CELLS / 64];
            return;
        }
        let (d, sin) = (scale(d, 1.0 / distance), radius / distance);
        let cos = (1.0 - sin * sin).sqrt();
        for (_, cells) in self.quarters.iter().zip(&self.cells).filter(|(quarter, _)| quarter.meets(d, cos, sin)) {
            for (number, _) in cells.iter().filter(|(_, cell)| cell.meets(d, cos, sin)) {
                mask.0[number / 64] |= 1 << (number % 64);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn vector() -> impl Strategy<Value = [f64; 3]> {
        [-1.0..1.0, -1.0..1.0, -1.0..1.0].prop_filter("has a direction", |&v| norm(v) > 1e-3)
    }

    proptest! {
        #[test]
        fn all_directions_between_two_balls_are_marked(d in vector(), radius in 0.0..0.5f64, a in vector(), b in vector()) {
            let mut mask = Mask::default();
            Cube::new().mark(d, radius, &mut mask);
            // A point in the ball at the origin and one in the ball at d, of radii that sum to `radius`.
            let inside = |v: [f64; 3], r: f64| scale(v, r / norm(v).max(1.0));
            let between = sub(add(d, inside(a, 0.3 * radius)), inside(b, 0.7 * radius));
            prop_assume!(norm(between) > 1e-9);
            prop_assert!(mask.has(cell(between)));
        }

        #[test]
        fn directions_are_unit_and_in_front(n in vector(), u in 0.0..1.0f64, v in 0.0..1.0f64) {
            let n = scale(n, 1.0 / norm(n));
            let (s, t) = tangents(n);
            let d = cosine_direction(n, s, t, [u, v]);
            prop_assert!((norm(d) - 1.0).abs() < 1e-12 && dot(d, n) >= 0.0);
        }
    }

    #[test]
    fn few_cells_are_marked_for_a_small_box_far_away() {
        let mut mask = Mask::default();
        Cube::new().mark([0.0, 0.0, 10.0], 0.1, &mut mask);
        let marked = mask.0.iter().map(|word| word.count_ones()).sum::<u32>();
        assert!((1..=16).contains(&marked), "{marked}");
    }
}
