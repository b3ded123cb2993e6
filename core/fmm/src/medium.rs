// SPDX-License-Identifier: GPL-3.0-or-later
//! What absorbs light on its way: a medium that is everywhere the same, and closed meshes that are filled with one.

use crate::error::Error;
use crate::vector::{add, cross, dot, high, low, norm, scale, sub};
use rstar::primitives::{GeomWithData, Rectangle};
use rstar::{AABB, RTree, SelectionFunction};
use std::sync::Arc;

type Vector = [f64; 3];

/// Meshes are put so much to the side, as a share of their size, that no way goes exactly through a corner.
const ASIDE: Vector = [0.41e-9, -0.73e-9, 0.55e-9];
/// A way meets a box that it passes by so little, as a share of its distance.
const ROUNDING: f64 = 1e-12;

/// Absorption of each colour, per scene unit, of what is everywhere, and of what is inside of closed meshes.
#[derive(Debug, Clone, Default)]
pub struct Medium {
    sigma: [f64; 3],
    volumes: Arc<Vec<Volume>>,
}

/// A closed mesh, and how much what is inside absorbs besides.
#[derive(Debug)]
struct Volume {
    sigma: [f64; 3],
    faces: RTree<GeomWithData<Rectangle<Vector>, Face>>,
}

/// A triangle, counter-clockwise from outside.
#[derive(Debug, Clone, Copy)]
struct Face([Vector; 3]);

impl Medium {
    /// From the absorption that is everywhere; an error where one is negative or not finite.
    pub fn new(sigma: [f64; 3]) -> Result<Self, Error> {
        Ok(Self { sigma: checked(sigma)?, volumes: Arc::default() })
    }

    /// With closed meshes (T, 3, 3), counter-clockwise from outside, each with the absorption inside.
    pub fn with(self, volumes: &[(&[[Vector; 3]], [f64; 3])]) -> Result<Self, Error> {
        let volume = |&(triangles, sigma): &(&[[Vector; 3]], [f64; 3])| {
            let corners = || triangles.iter().flatten().copied();
            let (low_end, high_end) =
                (corners().fold([f64::INFINITY; 3], low), corners().fold([f64::NEG_INFINITY; 3], high));
            let aside = scale(ASIDE, norm(sub(high_end, low_end)));
            let faces = triangles.iter().map(|triangle| {
                let [a, b, c] = triangle.map(|corner| add(corner, aside));
                let bounds = Rectangle::from_corners(low(low(a, b), c), high(high(a, b), c));
                GeomWithData::new(bounds, Face([a, b, c]))
            });
            Ok(Volume { sigma: checked(sigma)?, faces: RTree::bulk_load(faces.collect()) })
        };
        let volumes: Result<Vec<Volume>, Error> = volumes.iter().map(volume).collect();
        Ok(Self { volumes: Arc::new(volumes?), ..self })
    }

    /// Whether it lets all light through.
    pub fn is_clear(&self) -> bool {
        self.sigma == [0.0; 3] && self.volumes.is_empty()
    }

    /// Whether nothing is absorbed but inside of meshes.
    pub fn is_bounded(&self) -> bool {
        self.sigma == [0.0; 3]
    }

    /// The triangles that what absorbs ends at.
    pub fn bounds(&self) -> Vec<[Vector; 3]> {
        self.volumes.iter().flat_map(|volume| volume.faces.iter().map(|face| face.data.0)).collect()
    }

    /// The share of light of the first C colours that is left on the way between two points (Beer and Lambert).
    pub fn left<const C: usize>(&self, from: Vector, to: Vector) -> [f64; C] {
        let way = sub(to, from);
        let length = norm(way);
        self.left_along(from, scale(way, 1.0 / length.max(f64::MIN_POSITIVE)), length)
    }

    /// The same from a point along a unit direction, which may be infinitely far.
    pub fn left_along<const C: usize>(&self, from: Vector, direction: Vector, length: f64) -> [f64; C] {
        let mut depth: [f64; C] =
            std::array::from_fn(|c| if self.sigma[c] > 0.0 { self.sigma[c] * length } else { 0.0 });
        for volume in self.volumes.iter() {
            let inside = volume.inside(from, direction, length);
            (0..C).for_each(|c| depth[c] += volume.sigma[c] * inside);
        }
        depth.map(|depth| (-depth).exp())
    }
}

/// A share of the first C colours that was kept; all of it where none was.
pub(crate) fn kept<const C: usize>(shares: &[[f32; 3]], at: usize) -> [f64; C] {
    shares.get(at).map_or([1.0; C], |share| std::array::from_fn(|c| f64::from(share[c])))
}

fn checked(sigma: [f64; 3]) -> Result<[f64; 3], Error> {
    match sigma.iter().find(|sigma| !(sigma.is_finite() && **sigma >= 0.0)) {
        Some(&wrong) => Err(Error::Absorption(wrong)),
        None => Ok(sigma),
    }
}

impl Volume {
    /// How much of a way is inside. Each face that the way, made infinite, leaves by adds how far it is, and each that it
    /// comes in by takes it off, so that it does not matter where the way starts.
    fn inside(&self, from: Vector, direction: Vector, length: f64) -> f64 {
        let along = Along { from, inverse: direction.map(|d| 1.0 / d) };
        let met = self.faces.locate_with_selection_function(along).filter_map(|face| face.data.met(from, direction));
        met.map(|(distance, sign)| sign * distance.min(length)).sum::<f64>().clamp(0.0, length)
    }
}

impl Face {
    /// How far away a way meets it, and 1 where it goes out there or -1 where it comes in.
    fn met(&self, from: Vector, direction: Vector) -> Option<(f64, f64)> {
        let [a, b, c] = self.0.map(|corner| sub(corner, from));
        let normal = cross(sub(b, a), sub(c, a));
        let slope = dot(normal, direction);
        let (distance, out) = (dot(normal, a) / slope, slope > 0.0);
        let through = [(a, b), (b, c), (c, a)].iter().all(|&(p, q)| passes(p, q, direction) == out);
        (through && slope != 0.0 && distance > 0.0).then_some((distance, slope.signum()))
    }
}

/// On which side of an edge a direction from the origin goes by: of two faces that share it, exactly one has it inside.
fn passes(p: Vector, q: Vector, direction: Vector) -> bool {
    if p < q { dot(direction, cross(p, q)) >= 0.0 } else { dot(direction, cross(q, p)) < 0.0 }
}

/// Selects what may be met along a direction.
struct Along {
    from: Vector,
    inverse: Vector,
}

impl Along {
    fn meets(&self, low: Vector, high: Vector) -> bool {
        let (mut start, mut end) = (0.0f64, f64::INFINITY);
        for axis in 0..3 {
            let [a, b] = [low, high].map(|side| (side[axis] - self.from[axis]) * self.inverse[axis]);
            // Not a number is where the way runs in a side of the box.
            if !(a.is_nan() || b.is_nan()) {
                start = start.max(a.min(b));
                end = end.min(a.max(b));
            }
        }
        start <= end * (1.0 + ROUNDING)
    }
}

impl SelectionFunction<GeomWithData<Rectangle<Vector>, Face>> for Along {
    fn should_unpack_parent(&self, envelope: &AABB<Vector>) -> bool {
        self.meets(envelope.lower(), envelope.upper())
    }

    fn should_unpack_leaf(&self, leaf: &GeomWithData<Rectangle<Vector>, Face>) -> bool {
        self.meets(leaf.geom().lower(), leaf.geom().upper())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// A cuboid from the origin, counter-clockwise from outside.
    fn cuboid(size: Vector) -> Vec<[Vector; 3]> {
        let corner = |k: usize| std::array::from_fn(|axis| if k >> axis & 1 == 1 { size[axis] } else { 0.0 });
        let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
        quads.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]].map(|t| t.map(corner))).collect()
    }

    fn filled(size: Vector, sigma: [f64; 3]) -> Medium {
        Medium::default().with(&[(&cuboid(size), sigma)]).unwrap()
    }

    #[test]
    fn what_is_left_of_light_multiplies_along_its_way() {
        let medium = Medium::new([0.0, 0.5, 2.0]).unwrap();
        let [a, b, both]: [[f64; 3]; 3] = [0.3, 1.1, 1.4].map(|x| medium.left([0.0; 3], [0.0, x, 0.0]));
        assert!((0..3).all(|c| (a[c] * b[c] - both[c]).abs() < 1e-15));
        assert_eq!(medium.left::<1>([0.0; 3], [1.0, 0.0, 0.0]), [1.0]);
        assert!((both[2] - (-2.8f64).exp()).abs() < 1e-15);
        assert_eq!(medium.left_along::<3>([0.0; 3], [0.0, 0.0, 1.0], f64::INFINITY), [1.0, 0.0, 0.0]);
    }

    #[test]
    fn light_does_not_grow() {
        assert!(Medium::new([0.0, -1.0, 0.0]).is_err());
        assert!(Medium::new([0.0, f64::NAN, 0.0]).is_err());
        assert!(Medium::default().with(&[(&cuboid([1.0; 3]), [0.0, 0.0, -1.0])]).is_err());
        assert!(Medium::default().is_clear() && !Medium::new([0.0, 0.0, 1e-9]).unwrap().is_clear());
        assert!(!filled([1.0; 3], [1.0; 3]).is_clear() && filled([1.0; 3], [1.0; 3]).is_bounded());
    }

    #[test]
    fn ways_along_edges_and_diagonals_and_through_corners_are_as_long_as_others() {
        let medium = filled([1.0; 3], [1.0; 3]);
        for (from, to, inside) in [
            ([-1.0, -1.0, -1.0], [2.0, 2.0, 2.0], 3f64.sqrt()),
            ([-1.0, 0.5, 0.5], [2.0, 0.5, 0.5], 1.0),
            ([0.5, 0.5, 0.5], [0.5, 0.5, 9.0], 0.5),
            ([0.25, 0.25, -1.0], [0.25, 0.25, 0.75], 0.75),
            ([-1.0, 0.0, 0.5], [0.5, 1.5, 0.5], 0.0),
            ([-1.0, -2.0, 0.5], [1.0, 2.0, 0.5], 1.25f64.sqrt()),
        ] {
            let [left] = medium.left::<1>(from, to);
            assert!((left - (-inside).exp()).abs() < 1e-8, "{from:?} {to:?}: {left}");
            assert!((medium.left::<1>(to, from)[0] - left).abs() < 1e-8, "{to:?} {from:?}");
        }
    }

    fn vector(most: f64) -> impl Strategy<Value = Vector> {
        [-most..most, -most..most, -most..most]
    }

    proptest! {
        #[test]
        fn only_what_is_inside_absorbs(from in vector(3.0), to in vector(3.0), size in [0.1..2.0f64, 0.1..2.0, 0.1..2.0]) {
            // The part of a segment in a cuboid, by clipping.
            let way = sub(to, from);
            let (mut start, mut end) = (0.0f64, 1.0f64);
            for axis in 0..3 {
                let [a, b] = [0.0, size[axis]].map(|side| (side - from[axis]) / way[axis]);
                (start, end) = (start.max(a.min(b)), end.min(a.max(b)));
            }
            let inside = (end - start).max(0.0) * norm(way);
            // Faces are put aside, and where a way grazes them its ends move by so much.
            let steepest = way.into_iter().map(f64::abs).fold(f64::INFINITY, f64::min) / norm(way);
            let slack = 2.0 * norm(ASIDE) * norm(size) / steepest;
            let left = filled(size, [0.0, 0.7, 2.0]).left::<3>(from, to);
            for (left, sigma) in left.into_iter().zip([0.0, 0.7, 2.0]) {
                prop_assert!((left - (-sigma * inside).exp()).abs() <= sigma * slack + 1e-12);
            }
        }

        #[test]
        fn parts_of_a_way_multiply(from in vector(2.0), way in vector(2.0), share in 0.0..1.0f64) {
            let medium = filled([1.0; 3], [0.3, 1.0, 4.0]);
            let (middle, to) = (add(from, scale(way, share)), add(from, way));
            let [first, second, both]: [[f64; 3]; 3] =
                [(from, middle), (middle, to), (from, to)].map(|(a, b)| medium.left(a, b));
            for c in 0..3 {
                prop_assert!((first[c] * second[c] - both[c]).abs() < 1e-8);
            }
        }
    }
}
