// SPDX-License-Identifier: GPL-3.0-or-later
//! Neighbours' rays: what points of one leaf gather over their hemispheres changes little from one to the next, so that
//! each takes the value at its place of a plane through those around it, and needs fewer rays of its own.

use crate::directions::tangents;
use crate::vector::{dot, norm, sub};

/// Neighbours are at most this share of the distance to what the rays meet away, and look at most so many radians another
/// way: the two terms by which irradiance changes (Ward, Rubinstein and Clear, "A ray tracing solution for diffuse
/// interreflection", SIGGRAPH 1988, eq 3).
const REACH: f64 = 0.6;
const BEND: f64 = 0.3;
/// That is for so many rays over an open hemisphere, those of usual settings. Both are larger for fewer and smaller for
/// more, by this power: the square of what a plane over a radius r misses grows as r^4, that of noise falls as one over rays
/// and r^2.
const RAYS: f64 = 300.0;
const POWER: f64 = 1.0 / 6.0;
/// How far neighbours are above or below a point's plane, as a share of how far they may be away.
const STEP: f64 = 0.25;
/// A plane has to rest on this share of what the weights would give it if they were spread out evenly.
const SPREAD: f64 = 1e-3;

/// Among so many rays the shortest is the distance to what is near: an edge seen from its side is met by few.
const NEAR: usize = 50;
/// Where it is shorter by so much than the mean, it counts in its place.
const NEARER: f64 = 2.5;

/// The harmonic mean of the lengths of a point's rays, or less where something is near; 0 for none.
pub fn distance(lengths: &mut [f64]) -> f64 {
    let place = lengths.len() / NEAR;
    if lengths.is_empty() {
        return 0.0;
    }
    let mean = lengths.len() as f64 / lengths.iter().map(|length| 1.0 / length).sum::<f64>();
    let near = *lengths.select_nth_unstable_by(place, f64::total_cmp).1;
    mean.min(NEARER * near)
}

/// How much of each point's value comes from which points of its leaf.
#[derive(Debug, Default)]
pub struct Blend {
    /// (points + 1)
    starts: Vec<u32>,
    rows: Vec<u32>,
    shares: Vec<f32>,
}

impl Blend {
    /// For points with unit normals and the harmonic mean of the distances that their rays went, so many over an open
    /// hemisphere.
    pub fn new(positions: &[[f64; 3]], normals: &[[f64; 3]], distances: &[f64], rays: usize) -> Self {
        let wider = (RAYS / rays as f64).powf(POWER);
        let place = |((&x, &n), distance): ((&_, &_), f64)| {
            let (s, t) = tangents(n);
            Place { x, n, axes: [s, t], reach: wider * REACH * distance, bend: wider * BEND }
        };
        let distances = clamped(positions, distances);
        let places: Vec<Place> = positions.iter().zip(normals).zip(distances).map(place).collect();
        let mut blend = Self { starts: vec![0], ..Self::default() };
        for (own, i) in places.iter().zip(0..) {
            let near = places.iter().zip(0..).filter_map(|(&other, j)| Some((j, own.neighbour(other)?)));
            let (rows, near): (Vec<u32>, Vec<Neighbour>) = near.unzip();
            let (rows, shares) = of_plane(&near).map_or_else(|| (vec![i], vec![1.0]), |shares| (rows, shares));
            blend.rows.extend(rows);
            blend.shares.extend(shares);
            blend.starts.push(blend.rows.len() as u32);
        }
        blend
    }

    /// Each point by itself.
    pub fn none(points: usize) -> Self {
        Self { starts: (0..=points as u32).collect(), rows: (0..points as u32).collect(), shares: vec![1.0; points] }
    }

    /// For each point, whose values its own comes from, and how much of it.
    fn shares(&self) -> impl Iterator<Item = impl Iterator<Item = (usize, f64)>> {
        self.starts.windows(2).map(|ends| {
            let range = ends[0] as usize..ends[1] as usize;
            self.rows[range.clone()].iter().zip(&self.shares[range]).map(|(&j, &share)| (j as usize, f64::from(share)))
        })
    }

    /// Adds to (points, C) the blend of the points' own values.
    pub fn add<const C: usize>(&self, own: &[[f64; C]], out: &mut [[f64; C]]) {
        for (shares, out) in self.shares().zip(out) {
            for (j, share) in shares {
                out.iter_mut().zip(own[j]).for_each(|(out, own)| *out += share * own);
            }
        }
    }

    /// How much of all blended values, each weighed by what is given for its point, comes from each point's own one.
    pub fn transposed(&self, weights: &[[f64; 1]]) -> Vec<f64> {
        let mut found = vec![0.0; weights.len()];
        for (shares, [weight]) in self.shares().zip(weights) {
            shares.for_each(|(j, share)| found[j] += share * weight);
        }
        found
    }
}

/// Distances as short as those of neighbours say, which see the same things: few rays may miss all that is near (Křivánek,
/// Bouatouch, Pattanaik and Žára, "Making radiance and irradiance caching practical", EGSR 2006, section 4).
fn clamped(positions: &[[f64; 3]], distances: &[f64]) -> Vec<f64> {
    let known = |&x| {
        let others = positions.iter().zip(distances);
        others.map(|(&y, distance)| distance + norm(sub(x, y))).fold(f64::INFINITY, f64::min)
    };
    positions.iter().map(known).collect()
}

/// A point around another one: its weight, and where it is along two axes.
#[derive(Clone, Copy)]
struct Neighbour {
    weight: f64,
    at: [f64; 2],
}

/// A point of a leaf with its normal and how far its neighbours may be away.
#[derive(Clone, Copy)]
struct Place {
    x: [f64; 3],
    n: [f64; 3],
    /// Along the surface.
    axes: [[f64; 3]; 2],
    reach: f64,
    /// How many radians they may look another way.
    bend: f64,
}

impl Place {
    fn neighbour(self, other: Self) -> Option<Neighbour> {
        let (d, reach) = (sub(other.x, self.x), self.reach.min(other.reach));
        let height = dot(d, self.n) / STEP;
        let bend = (2.0 - 2.0 * dot(self.n, other.n)).max(0.0) / (self.bend * self.bend);
        let weight = 1.0 - bend - (dot(d, d) + height * height) / (reach * reach).max(f64::MIN_POSITIVE);
        (weight > 0.0).then(|| Neighbour { weight: weight * weight, at: self.axes.map(|axis| dot(d, axis)) })
    }
}

/// What each value counts for in that of the plane, fitted by weighted least squares, at the origin.
fn of_plane(near: &[Neighbour]) -> Option<Vec<f32>> {
    let sum = |f: &dyn Fn(&Neighbour) -> f64| near.iter().map(|p| p.weight * f(p)).sum::<f64>();
    let total = sum(&|_| 1.0);
    let mean = [0, 1].map(|k| sum(&|p| p.at[k]) / total);
    let moment = |k: usize, l: usize| sum(&|p| (p.at[k] - mean[k]) * (p.at[l] - mean[l]));
    let (a, b, c) = (moment(0, 0), moment(0, 1), moment(1, 1));
    let determinant = a * c - b * b;
    if near.len() < 4 || determinant <= SPREAD * (a + c) * (a + c) {
        return None;
    }
    // The slope along the way back to the origin.
    let back = [(b * mean[1] - c * mean[0]) / determinant, (b * mean[0] - a * mean[1]) / determinant];
    let share =
        |p: &Neighbour| p.weight * (1.0 / total + back[0] * (p.at[0] - mean[0]) + back[1] * (p.at[1] - mean[1]));
    let found: Vec<f32> = near.iter().map(|p| share(p) as f32).collect();
    // At the rim of a leaf a plane may be worse than the point alone.
    (found.iter().map(|share| share * share).sum::<f32>() < 1.0).then_some(found)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const UP: [f64; 3] = [0.0, 0.0, 1.0];

    fn floor(n: usize) -> Vec<[f64; 3]> {
        (0..n * n).map(|k| [(k / n) as f64 / n as f64, (k % n) as f64 / n as f64, 0.0]).collect()
    }

    fn blended(blend: &Blend, own: &[f64]) -> Vec<f64> {
        let own: Vec<[f64; 1]> = own.iter().map(|&v| [v]).collect();
        let mut out = vec![[0.0]; own.len()];
        blend.add(&own, &mut out);
        out.into_iter().map(|[v]| v).collect()
    }

    proptest! {
        #[test]
        fn planes_stay_as_they_are(
            a in -1.0..1.0f64, b in -1.0..1.0f64, c in -1.0..1.0f64, distance in 0.01..10.0f64, rays in 1usize..5000,
        ) {
            let points = floor(8);
            let own: Vec<f64> = points.iter().map(|x| a + b * x[0] + c * x[1]).collect();
            let blend = Blend::new(&points, &vec![UP; 64], &[distance; 64], rays);
            for (found, own) in blended(&blend, &own).into_iter().zip(own) {
                prop_assert!((found - own).abs() < 1e-5);
            }
        }

        #[test]
        fn noise_never_grows(distance in 0.01..10.0f64, n in 1usize..9, rays in 1usize..5000) {
            let points = floor(n);
            let blend = Blend::new(&points, &vec![UP; n * n], &vec![distance; n * n], rays);
            for shares in blend.shares() {
                prop_assert!(shares.map(|(_, share)| share * share).sum::<f64>() <= 1.0);
            }
        }
    }

    #[test]
    fn the_transposed_blend_has_the_same_sum() {
        let (points, own) = (floor(8), (0..64).map(f64::from).collect::<Vec<_>>());
        let weights: Vec<[f64; 1]> = (0..64).map(|i| [f64::from(i * i % 7)]).collect();
        let blend = Blend::new(&points, &[UP; 64], &[1.0; 64], 300);
        let sum: f64 = blended(&blend, &own).iter().zip(&weights).map(|(v, [w])| v * w).sum();
        let other: f64 = blend.transposed(&weights).iter().zip(&own).map(|(v, w)| v * w).sum();
        assert!((sum - other).abs() < 1e-9 * sum.abs());
    }

    #[test]
    fn noise_falls_where_what_is_met_is_far() {
        let blend = Blend::new(&floor(8), &[UP; 64], &[2.0; 64], 300);
        let squares = blend.shares().nth(27).map(|shares| shares.map(|(_, share)| share * share).sum::<f64>());
        assert!(squares.is_some_and(|squares| squares < 0.1));
    }

    #[test]
    fn neighbours_are_farther_away_for_fewer_rays() {
        let points: Vec<_> = (0..1681).map(|i| [f64::from(i / 41) / 20.0, f64::from(i % 41) / 20.0, 0.0]).collect();
        let reach = |rays: usize| {
            let blend = Blend::new(&points, &[UP; 1681], &[1.0; 1681], rays);
            let rows: Vec<usize> = blend.shares().nth(840).into_iter().flatten().map(|(j, _)| j).collect();
            rows.into_iter().map(|j| norm(sub(points[j], points[840]))).fold(0.0, f64::max)
        };
        for (rays, expected) in [(300, 0.6), (75, 0.756), (4800, 0.378)] {
            assert!((expected - 0.02..expected).contains(&reach(rays)), "{rays}: {}", reach(rays));
        }
    }

    #[test]
    fn what_is_far_or_turned_or_above_or_near_something_is_no_neighbour() {
        let at = |y: [f64; 3], m: [f64; 3], distance: f64| {
            let around = [[0.01, 0.0, 0.0], [0.0, 0.01, 0.0], [-0.01, 0.0, 0.0], [0.0, -0.01, 0.0], [0.0; 3], y];
            let blend = Blend::new(&around, &[UP, UP, UP, UP, UP, m], &[1.0, 1.0, 1.0, 1.0, 1.0, distance], 300);
            blend.shares().nth(4).is_some_and(|mut shares| shares.any(|(j, _)| j == 5))
        };
        assert!(at([0.1, 0.0, 0.0], UP, 1.0));
        assert!(!at([0.7, 0.0, 0.0], UP, 1.0), "far");
        assert!(!at([0.1, 0.0, 0.0], [0.6, 0.0, 0.8], 1.0), "turned");
        assert!(!at([0.1, 0.0, 0.2], UP, 1.0), "above");
        assert!(!at([0.1, 0.0, 0.0], UP, 0.1), "near something");
        assert_eq!(
            clamped(&[[0.0; 3], [0.1, 0.0, 0.0], [3.0, 0.0, 0.0]], &[1.0, 0.2, 9.0]),
            [0.2 + 0.1, 0.2, 0.2 + 2.9]
        );
    }

    #[test]
    fn points_at_one_place_and_points_without_rays_do_no_harm() {
        let blend = Blend::new(&[[0.0; 3]; 5], &[UP; 5], &[0.0; 5], 300);
        assert_eq!(blended(&blend, &[1.0, 2.0, 3.0, 4.0, 5.0]), [1.0, 2.0, 3.0, 4.0, 5.0]);
    }
}
