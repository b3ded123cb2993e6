// SPDX-License-Identifier: GPL-3.0-or-later
//! Horizon: which pairs of boxes face each other as a whole.
//!
//! With d = x - y the kernel (n_y.d)(-n_x.d) has a sign; a source y and a target x exchange energy where both factors are
//! positive. Each factor is bounded over a pair of boxes from what a box knows of its points: the bounding box, the cone of
//! the normals, the range of n.(x - middle) with each point's own normal n, and the range of the position along the box's
//! own cone axis and along the common normals of the scene. For flat walls, tilted or not, the bounds are exact.
//!
//! Curved surfaces have a horizon: the pairs of boxes across it can be settled only leaf by leaf, which is more than linear work.
//! What arrives from within a cosine e of the horizon is about e^2 of what arrives from a whole hemisphere; cosines up to a
//! chosen e may therefore pass for zero, and boxes that look smaller than e are settled far above the leaves.

use rayon::prelude::*;

use crate::octree::{Cone, Octree, OctreeError};
use crate::octree_normals::parallel;
use crate::vector::{add, dot, norm, scale, sub};

/// A cosine below this counts as zero, taken relative to the size of the pair of boxes.
const TOLERANCE: f64 = 1e-6;

/// Positions are trusted to this fraction of the largest coordinate: meshes are stored in single precision.
const PRECISION: f64 = f32::EPSILON as f64;

/// How the points of two boxes face each other.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Facing {
    /// Both cosines are at least zero for every pair of points.
    All,
    /// At least one cosine is at most zero for every pair of points: nothing is exchanged.
    None,
    /// Neither could be shown.
    Some,
}

/// Classifies pairs of a target box and a source box.
pub struct FacingTest {
    /// (M, 3) f64, unit: common normals of both octrees; those along x, y or z are left to the bounding boxes.
    walls: Vec<[f64; 3]>,
    targets: Extents,
    /// None when the source tree is the target tree.
    sources: Option<Extents>,
    /// Cosine up to which a pair of points may pass for one at the horizon.
    grazing: f64,
    /// Precision of positions, scene units.
    precision: f64,
    /// (B,) how far surfaces go beyond the source points that stand for them; none where points are all there is.
    margin: Vec<f64>,
}

/// What an octree of B boxes knows of its points.
struct Extents {
    /// (B,)
    boxes: Vec<Extent>,
    /// (B, M, 2) f64, scene units: range of w.(x - middle) of each box along each wall normal w.
    slabs: Vec<[f64; 2]>,
}

/// Shape of the points x of one box and of their normals n. Lengths in scene units.
struct Extent {
    /// Middle of the bounding box of the points.
    middle: [f64; 3],
    /// Half the sides of the bounding box.
    half: [f64; 3],
    /// Half its diagonal.
    radius: f64,
    cone: Cone,
    /// Largest |n - axis of the cone|.
    chord: f64,
    /// Range of n.(x - middle), each point with its own normal.
    offset: [f64; 2],
    /// Range of a.(x - middle) along the axis a of the cone.
    span: [f64; 2],
    /// Number of the wall normal along the axis of the cone, if there is one.
    wall: Option<usize>,
}

/// Cosine up to which rounding of the positions may decide, and difference up to which normals count as the same.
const ROUNDED_COSINE: f64 = 1e-3;

/// Distances from the horizon that count as zero, scene units.
struct Tolerance {
    /// Where a pair is left out.
    none: f64,
    /// Where a pair is expanded, a little behind the horizon.
    all: f64,
}

impl FacingTest {
    /// Both octrees must have normals; they may be the same one. grazing: cosine that may pass for zero, 0 for none.
    pub fn new(targets: &Octree, sources: &Octree, grazing: f64) -> Result<Self, OctreeError> {
        if !(targets.has_normals() && sources.has_normals()) {
            return Err(OctreeError::NormalsMissing);
        }
        let walls = walls(&targets.common_normals, &sources.common_normals);
        let same = std::ptr::eq(targets, sources);
        let precision = PRECISION * targets.grid.magnitude().max(sources.grid.magnitude());
        let sources = if same { None } else { Some(Extents::new(sources, &walls)) };
        Ok(Self { targets: Extents::new(targets, &walls), sources, walls, grazing, precision, margin: Vec::new() })
    }

    /// The same for source boxes whose surfaces go so far (B,) beyond their points: those may be opposite to a target where
    /// the points are at the horizon.
    pub fn beyond(self, margin: Vec<f64>) -> Self {
        Self { margin, ..self }
    }

    /// How target box t and source box s face each other.
    pub fn classify(&self, t: usize, s: usize) -> Facing {
        let sources = self.sources.as_ref().unwrap_or(&self.targets);
        let (a, b) = (&sources.boxes[s], &self.targets.boxes[t]);
        let d = sub(b.middle, a.middle);
        let tolerance = self.tolerance(a, b, d, self.margin.get(s).copied().unwrap_or(0.0));
        let settled = |range: [f64; 2]| range[0] >= -tolerance.all || range[1] <= tolerance.none;
        let refined = |from: (&Extents, usize), to: (&Extents, usize), d| {
            let rough = rough_range(&from.0.boxes[from.1], &to.0.boxes[to.1], d);
            if settled(rough) { rough } else { self.fine_range(from, to, d) }
        };

        let sent = refined((sources, s), (&self.targets, t), d);
        if sent[1] <= tolerance.none {
            return Facing::None;
        }
        let received = refined((&self.targets, t), (sources, s), scale(d, -1.0));
        if received[1] <= tolerance.none {
            Facing::None
        } else if sent[0] >= -tolerance.all && received[0] >= -tolerance.all {
            Facing::All
        } else {
            Facing::Some
        }
    }

    /// |n.d| up to which a pair of points may pass for lying at the horizon; d joins the middles of their boxes.
    fn tolerance(&self, a: &Extent, b: &Extent, d: [f64; 3], margin: f64) -> Tolerance {
        let size = a.radius + b.radius;
        let rounding = TOLERANCE * (norm(d) + size) + self.precision;
        // No pair of points is nearer than the bounding boxes: the cosine stays below `grazing` also for the nearest.
        let between = norm([0, 1, 2].map(|i| (d[i].abs() - a.half[i] - b.half[i]).max(0.0)));
        // Rounding may leave out a pair by itself only where nothing is lost: between walls that look the same way.
        let same_way = dot(a.cone.axis, b.cone.axis) > 1.0 - ROUNDED_COSINE && a.chord + b.chord < ROUNDED_COSINE;
        let dropped = if same_way { rounding } else { rounding.min(ROUNDED_COSINE * between) };
        let kept = rounding.min(ROUNDED_COSINE * (between + size));
        let grazing = self.grazing * (between - margin).max(0.0);
        Tolerance { none: dropped.max(grazing), all: kept.max(grazing) }
    }

    /// Bounds of n_y.(x - y) for y in box `from` and x in box `to`, from everything that is known; d joins their middles.
    fn fine_range(&self, from: (&Extents, usize), to: (&Extents, usize), d: [f64; 3]) -> [f64; 2] {
        let (a, b) = (&from.0.boxes[from.1], &to.0.boxes[to.1]);
        let mut range = corner_range(a, b, d);
        let base = a.cone.range(d);
        // n.(x - middle of a) = n.d + e.(x - middle of b) + (n - e).(x - middle of b) for any vector e.
        let mut narrow = |e: [f64; 3], [least, most]: [f64; 2]| {
            let slack = (norm(sub(a.cone.axis, e)) + a.chord) * b.radius;
            range = [range[0].max(base[0] + least - slack), range[1].min(base[1] + most + slack)];
        };
        narrow_along(a, b.cone.axis, b.span, &mut narrow);
        if let Some(wall) = a.wall {
            narrow_along(a, self.walls[wall], to.0.slabs[to.1 * self.walls.len() + wall], &mut narrow);
        }
        [range[0] - a.offset[1], range[1] - a.offset[0]]
    }
}

/// Offers e or -e, whichever is nearer to the axis of box a, with the range along it.
fn narrow_along(a: &Extent, e: [f64; 3], range: [f64; 2], narrow: &mut impl FnMut([f64; 3], [f64; 2])) {
    if dot(a.cone.axis, e) < 0.0 {
        narrow(scale(e, -1.0), [-range[1], -range[0]]);
    } else {
        narrow(e, range);
    }
}

/// Bounds of n_y.(x - y) from the sphere about the points x: cheap, and enough for most pairs.
fn rough_range(a: &Extent, b: &Extent, d: [f64; 3]) -> [f64; 2] {
    let [least, most] = a.cone.range(d);
    [least - b.radius - a.offset[1], most + b.radius - a.offset[0]]
}

/// Bounds of n.(x - middle of a) for n in the cone of box a and x in the bounding box of box b.
/// The least is a concave and the most a convex function of x, so that both are reached at corners.
fn corner_range(a: &Extent, b: &Extent, d: [f64; 3]) -> [f64; 2] {
    if a.cone.sin == 0.0 && a.cone.cos > 0.0 {
        let along = dot(a.cone.axis, d);
        let reach = (0..3).map(|i| a.cone.axis[i].abs() * b.half[i]).sum::<f64>();
        return [along - reach, along + reach];
    }
    let mut range = [f64::INFINITY, f64::NEG_INFINITY];
    for corner in 0..8 {
        let signed = |i: usize| if corner >> i & 1 == 0 { -b.half[i] } else { b.half[i] };
        let [least, most] = a.cone.range(add(d, [signed(0), signed(1), signed(2)]));
        range = [range[0].min(least), range[1].max(most)];
    }
    range
}

/// The common normals of both octrees, each once, without those that bounding boxes already resolve.
fn walls(targets: &[[f64; 3]], sources: &[[f64; 3]]) -> Vec<[f64; 3]> {
    let mut walls: Vec<[f64; 3]> = Vec::new();
    for &normal in targets.iter().chain(sources) {
        let along_axis = normal.iter().any(|x| x.abs() > 1.0 - 1e-15);
        if !along_axis && !walls.iter().any(|&wall| parallel(wall, normal)) {
            walls.push(normal);
        }
    }
    walls
}

impl Extents {
    fn new(tree: &Octree, walls: &[[f64; 3]]) -> Self {
        let boxes: Vec<Extent> = (0..tree.n_boxes()).into_par_iter().map(|b| Extent::new(tree, b, walls)).collect();
        let slabs = slabs(tree, &boxes, walls);
        Self { boxes, slabs }
    }
}

impl Extent {
    fn new(tree: &Octree, b: usize, walls: &[[f64; 3]]) -> Self {
        let middle = scale(add(tree.low[b], tree.high[b]), 0.5);
        let half = scale(sub(tree.high[b], tree.low[b]), 0.5);
        let cone = tree.cone[b];
        let mut offset = NOTHING;
        let mut span = NOTHING;
        for i in tree.points_of(b) {
            let x = sub(tree.positions[i], middle);
            offset = extended(offset, dot(tree.normals[i], x));
            span = extended(span, dot(cone.axis, x));
        }
        let wall = walls.iter().position(|&wall| parallel(wall, cone.axis));
        Self { middle, half, radius: norm(half), cone, chord: cone.chord(), offset, span, wall }
    }
}

/// Ranges along the wall normals: leaves from their points, the other boxes from their children.
fn slabs(tree: &Octree, boxes: &[Extent], walls: &[[f64; 3]]) -> Vec<[f64; 2]> {
    let centre = tree.grid.centre;
    let of_points = |(b, wall): (usize, [f64; 3])| {
        let points = if tree.is_leaf(b) { tree.points_of(b) } else { 0..0 };
        tree.positions[points].iter().fold(NOTHING, |range, &x| extended(range, dot(wall, sub(x, centre))))
    };
    let m = walls.len();
    let mut slabs: Vec<[f64; 2]> =
        (0..tree.n_boxes() * m).into_par_iter().map(|i| of_points((i / m, walls[i % m]))).collect();
    for b in (tree.roots().end..tree.n_boxes()).rev() {
        for wall in 0..m {
            let [least, most] = slabs[b * m + wall];
            let parent = &mut slabs[tree.parent[b] as usize * m + wall];
            *parent = [parent[0].min(least), parent[1].max(most)];
        }
    }
    for (i, slab) in slabs.iter_mut().enumerate() {
        let middle = dot(walls[i % m], sub(boxes[i / m].middle, centre));
        *slab = slab.map(|x| x - middle);
    }
    slabs
}

const NOTHING: [f64; 2] = [f64::INFINITY, f64::NEG_INFINITY];

fn extended(range: [f64; 2], x: f64) -> [f64; 2] {
    [range[0].min(x), range[1].max(x)]
}
