// SPDX-License-Identifier: GPL-3.0-or-later
//! Octree from points: Morton keys, a parallel sort, and then level after level of splits by binary search in the keys.

use rayon::prelude::*;

use crate::octree::{Grid, Grouping, MAX_LEVEL, NO_BOX, Octree, OctreeError, OctreeOptions};
use crate::octree_grid::check_positions;
use crate::octree_normals::{Cone, check_normals, common_normals, dominant_axis, frame, unit};
use crate::vector::{find, high, low};

/// A key and the scene number of its point.
type Keyed = (u64, u32);

/// Keys are put into buckets by their digits down to this level.
const BUCKET_LEVEL: u8 = 4;

/// Added to the class of the normal of an emitter.
pub(crate) const EMITTERS: u8 = 6;

/// A bucket that is worth more than one thread.
const LARGE_BUCKET: usize = 1 << 15;

impl Octree {
    /// positions: (N, 3) in the grid; normals: (N, 3) unit, wanted by `by_normal` and by the facing test.
    pub fn new(
        positions: &[[f64; 3]],
        normals: Option<&[[f64; 3]]>,
        grid: Grid,
        options: OctreeOptions,
    ) -> Result<Self, OctreeError> {
        Self::with_emitters(positions, normals, &[], grid, options)
    }

    /// The same with the emitters (N,), where there are any, in boxes of their own: what they send is another matter than
    /// what the wall beside them reflects.
    pub fn with_emitters(
        positions: &[[f64; 3]],
        normals: Option<&[[f64; 3]]>,
        emitters: &[bool],
        grid: Grid,
        options: OctreeOptions,
    ) -> Result<Self, OctreeError> {
        check(positions, normals, grid, options)?;
        if !emitters.is_empty() && emitters.len() != positions.len() {
            return Err(OctreeError::EmitterCount { positions: positions.len(), emitters: emitters.len() });
        }
        let normals = normals.unwrap_or_default();
        let common_normals = common_normals(normals);
        let frame = frame(&common_normals);
        let axis = |i: usize| if options.by_normal { dominant_axis(&frame, unit(normals[i])) } else { 0 };
        let class = |i: usize| axis(i) + if emitters.get(i) == Some(&true) { EMITTERS } else { 0 };
        let keyed = |i: usize| (grid.key(positions[i], class(i)), i as u32);
        let keys = sorted((0..positions.len()).into_par_iter().map(keyed).collect());

        let to_scene: Vec<u32> = keys.par_iter().map(|&(_, scene)| scene).collect();
        let mut tree = Self {
            grid,
            options,
            levels: vec![0],
            level: Vec::new(),
            axis: Vec::new(),
            parent: Vec::new(),
            child_starts: Vec::new(),
            points: Vec::new(),
            cell: Vec::new(),
            low: Vec::new(),
            high: Vec::new(),
            cone: Vec::new(),
            positions: to_scene.par_iter().map(|&i| positions[i as usize]).collect(),
            normals: if normals.is_empty() { Vec::new() } else { gather_unit(normals, &to_scene) },
            to_tree: inverse(&to_scene),
            to_scene,
            common_normals,
            frame,
        };
        tree.add_roots(&keys);
        while tree.add_level(&keys) {}
        tree.summarise();
        Ok(tree)
    }

    /// One root for each class that has points.
    fn add_roots(&mut self, keys: &[Keyed]) {
        let mut start = 0;
        while start < keys.len() {
            let class = digit(keys[start].0, 0);
            let end = start + keys[start..].partition_point(|&(key, _)| digit(key, 0) == class);
            self.push_box(0, class, NO_BOX, [start, end], [0; 3]);
            start = end;
        }
        self.levels.push(self.level.len() as u32);
    }

    /// Splits the boxes of the deepest level so far; false when all of them are leaves.
    fn add_level(&mut self, keys: &[Keyed]) -> bool {
        let level = self.n_levels() - 1;
        let boxes = self.boxes_of_level(level);
        let splits: Vec<Option<[usize; 9]>> = boxes
            .clone()
            .into_par_iter()
            .map(|b| {
                self.must_split(b)
                    .then(|| octants(keys, self.points_of(b).start, self.points_of(b).end, level as u8 + 1))
            })
            .collect();
        for (b, split) in boxes.zip(splits) {
            self.child_starts.push(self.level.len() as u32);
            let Some(bounds) = split else { continue };
            for octant in (0..8).filter(|&o| bounds[o] < bounds[o + 1]) {
                let cell = [0, 1, 2].map(|i| 2 * self.cell[b][i] + (octant >> i & 1) as i32);
                self.push_box(level as u8 + 1, self.axis[b], b as u32, [bounds[octant], bounds[octant + 1]], cell);
            }
        }
        let grown = self.level.len() as u32;
        if self.levels.last() == Some(&grown) {
            // One past the children of the last box.
            self.child_starts.push(grown);
            return false;
        }
        self.levels.push(grown);
        true
    }

    fn must_split(&self, b: usize) -> bool {
        match self.options.grouping {
            Grouping::Adaptive { points } => self.count(b) > points && self.level[b] < MAX_LEVEL,
            Grouping::Uniform { level } => self.level[b] < level,
        }
    }

    fn push_box(&mut self, level: u8, axis: u8, parent: u32, points: [usize; 2], cell: [i32; 3]) {
        self.level.push(level);
        self.axis.push(axis);
        self.parent.push(parent);
        self.points.push(points.map(|i| i as u32));
        self.cell.push(cell);
    }

    /// Bounding box and cone of the normals of every box, from the leaves up.
    fn summarise(&mut self) {
        let points = |b| self.positions[if self.is_leaf(b) { self.points_of(b) } else { 0..0 }].iter();
        let nothing = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
        let bounds = |b| points(b).fold(nothing, |(l, h), &p| (low(l, p), high(h, p)));
        (self.low, self.high) = (0..self.n_boxes()).into_par_iter().map(bounds).unzip();
        for b in (self.roots().end..self.n_boxes()).rev() {
            let parent = self.parent[b] as usize;
            self.low[parent] = low(self.low[parent], self.low[b]);
            self.high[parent] = high(self.high[parent], self.high[b]);
        }
        if self.has_normals() {
            self.cone = vec![Cone::EVERYWHERE; self.n_boxes()];
            for level in (0..self.n_levels()).rev() {
                let boxes = self.boxes_of_level(level);
                let cones: Vec<Cone> = boxes.clone().into_par_iter().map(|b| self.cone_of(b)).collect();
                self.cone[boxes].copy_from_slice(&cones);
            }
        }
    }

    /// Children of one plane have the cone of their parent; otherwise only the points give the narrowest cone.
    fn cone_of(&self, b: usize) -> Cone {
        match &self.cone[self.children(b)] {
            [first, others @ ..] if others.iter().all(|other| first.same_line(other)) => *first,
            _ => Cone::around(&self.normals[self.points_of(b)]),
        }
    }
}

fn check(
    positions: &[[f64; 3]],
    normals: Option<&[[f64; 3]]>,
    grid: Grid,
    options: OctreeOptions,
) -> Result<(), OctreeError> {
    let count = positions.len();
    if count == 0 {
        return Err(OctreeError::Empty);
    }
    if count >= u32::MAX as usize {
        return Err(OctreeError::TooManyPoints { count });
    }
    match options.grouping {
        Grouping::Adaptive { points: 0 } => return Err(OctreeError::NoPointsPerLeaf),
        Grouping::Uniform { level } if level > MAX_LEVEL => {
            return Err(OctreeError::LevelTooDeep { level, deepest: MAX_LEVEL });
        }
        _ => {}
    }
    match normals {
        None if options.by_normal => return Err(OctreeError::NormalsMissing),
        Some(normals) if normals.len() != count => {
            return Err(OctreeError::NormalCount { positions: count, normals: normals.len() });
        }
        _ => {}
    }
    grid.check()?;
    check_positions(positions)?;
    check_normals(normals.unwrap_or_default())?;
    match find(positions, |p| !grid.holds(p)) {
        Some(index) => Err(OctreeError::OutsideGrid { index, value: positions[index] }),
        None => Ok(()),
    }
}

/// Keys in ascending order; equal keys stay in scene order, so that the tree does not depend on the threads.
/// One pass puts them into buckets by their leading bits, and then the buckets, which fit into a cache, are sorted.
fn sorted(keys: Vec<Keyed>) -> Vec<Keyed> {
    let bucket = |key: u64| (key >> (3 * (MAX_LEVEL - BUCKET_LEVEL))) as usize;
    let mut starts = vec![0_u32; (16 << (3 * BUCKET_LEVEL)) + 1];
    for &(key, _) in &keys {
        starts[bucket(key) + 1] += 1;
    }
    for i in 1..starts.len() {
        starts[i] += starts[i - 1];
    }
    let mut next = starts.clone();
    let mut sorted = vec![(0, 0); keys.len()];
    for &(key, scene) in &keys {
        let place = &mut next[bucket(key)];
        sorted[*place as usize] = (key, scene);
        *place += 1;
    }
    let buckets: Vec<&mut [Keyed]> = sorted.chunk_by_mut(|a, b| bucket(a.0) == bucket(b.0)).collect();
    buckets.into_par_iter().for_each(|bucket| {
        if bucket.len() > LARGE_BUCKET { bucket.par_sort_unstable() } else { bucket.sort_unstable() }
    });
    sorted
}

/// Octal digit of a key: 0 is the class of the point, l the octant at level l.
fn digit(key: u64, level: u8) -> u8 {
    (key >> (3 * (MAX_LEVEL - level)) & if level == 0 { 15 } else { 7 }) as u8
}

/// Bounds of the points of the eight octants at `level` among the sorted keys `start..end` of one box.
fn octants(keys: &[Keyed], start: usize, end: usize, level: u8) -> [usize; 9] {
    let mut bounds = [start; 9];
    for octant in 0..8 {
        let from = bounds[octant];
        bounds[octant + 1] = from + keys[from..end].partition_point(|&(key, _)| digit(key, level) == octant as u8);
    }
    bounds
}

fn gather_unit(normals: &[[f64; 3]], to_scene: &[u32]) -> Vec<[f64; 3]> {
    to_scene.par_iter().map(|&i| unit(normals[i as usize])).collect()
}

fn inverse(permutation: &[u32]) -> Vec<u32> {
    let mut inverse = vec![0; permutation.len()];
    for (i, &j) in permutation.iter().enumerate() {
        inverse[j as usize] = i as u32;
    }
    inverse
}
