// SPDX-License-Identifier: GPL-3.0-or-later
//! Near patches, where quadrature points are too coarse: the exact form factor takes the place of the point kernel.

use crate::error::{Error, same_length};
use crate::form_factor::{Clipped, faces};
use crate::kernel;
use crate::medium::{Medium, kept};
use crate::portions::Portions;
use glam::DVec3;
use rayon::prelude::*;
use rstar::RTree;
use rstar::primitives::{GeomWithData, Rectangle};
use std::borrow::Cow;

/// A patch that faces a receiver and fills so much of its view is so close that which portion is seen is chance, which
/// does not average out over the receivers of a portion: there all that are in front count by their areas.
const FILLED: f64 = 0.1;
/// Cosine of the angle between both normals from which on they face each other.
const OPPOSED: f64 = -0.5;

/// Patches near each receiver, as compressed rows: the entries of receiver i are `starts[i]..starts[i + 1]`.
#[derive(Debug, Clone, Default)]
pub struct NearField {
    /// (M + 1) first entry of each receiver.
    pub starts: Vec<usize>,
    /// (K) patch of each entry.
    pub patches: Vec<u32>,
    /// (K * points_per_patch) exact form factor from the receiver to what each point of the patch stands for, without
    /// occlusion.
    pub form_factors: Vec<f64>,
    /// (K) whether the patch is so close that all portions in front count by their areas.
    pub close: Vec<bool>,
    /// (K * points_per_patch, 3) a place there in front of the receiver's horizon, where a ray tells whether it is seen.
    pub targets: Vec<[f64; 3]>,
}

/// A patch near a receiver, whether it is close, and the form factor to each of its portions with a place in it.
type Entry = (u32, bool, Vec<(f64, [f64; 3])>);

/// The triangles that carry the sources, `points_per_patch` consecutive ones each.
pub struct Patches<'a> {
    /// (P, 3, 3) corners, counter-clockwise from the front.
    pub triangles: &'a [[[f64; 3]; 3]],
    /// (P) how far from its centroid a patch is near.
    pub reach: &'a [f64],
    /// What the points of a patch stand for.
    pub portions: &'a Portions,
}

impl NearField {
    /// Finds the patches within reach of each receiver (M, 3), with their exact form factors.
    pub fn new(points: &[[f64; 3]], normals: &[[f64; 3]], patches: &Patches) -> Result<Self, Error> {
        Self::of_some(points, normals, patches, |_, _| true)
    }

    /// The same for the pairs of a receiver and a patch that are wanted.
    pub fn of_some(
        points: &[[f64; 3]],
        normals: &[[f64; 3]],
        patches: &Patches,
        wanted: impl Fn(usize, u32) -> bool + Sync,
    ) -> Result<Self, Error> {
        same_length("receiver normals", points.len(), normals.len())?;
        same_length("patch reach", patches.triangles.len(), patches.reach.len())?;
        let triangles: Vec<[DVec3; 3]> = patches.triangles.iter().map(|t| t.map(DVec3::from)).collect();
        let reaches = triangles.iter().zip(patches.reach).zip(0..).filter(|((_, reach), _)| **reach > 0.0);
        let reaches = reaches.map(|((t, &reach), q)| within(t, reach, q)).collect();
        let reaches = RTree::bulk_load(reaches);
        let rows: Vec<Vec<Entry>> = points
            .par_iter()
            .zip(normals)
            .enumerate()
            .map(|(i, (&x, &n_x))| {
                let mut near: Vec<u32> = reaches.locate_all_at_point(&x).map(|reach| reach.data).collect();
                near.sort_unstable();
                let (x, n_x) = (DVec3::from(x), DVec3::from(n_x));
                let is_near = |q: &u32| centroid(&triangles[*q as usize]).distance(x) < patches.reach[*q as usize];
                near.into_iter()
                    .filter(is_near)
                    .filter(|&q| wanted(i, q))
                    .filter_map(|q| entry(x, n_x, q, &triangles[q as usize], patches.portions))
                    .collect()
            })
            .collect();
        Ok(Self::from_rows(&rows))
    }

    fn from_rows(rows: &[Vec<Entry>]) -> Self {
        let mut near = NearField { starts: vec![0], ..Default::default() };
        for row in rows {
            for (patch, close, portions) in row {
                near.patches.push(*patch);
                near.close.push(*close);
                near.form_factors.extend(portions.iter().map(|portion| portion.0));
                near.targets.extend(portions.iter().map(|portion| portion.1));
            }
            near.starts.push(near.patches.len());
        }
        near
    }
}

/// The box around all points within reach of a patch.
fn within(triangle: &[DVec3; 3], reach: f64, patch: u32) -> GeomWithData<Rectangle<[f64; 3]>, u32> {
    let centre = centroid(triangle);
    GeomWithData::new(Rectangle::from_corners((centre - reach).into(), (centre + reach).into()), patch)
}

fn centroid([a, b, c]: &[DVec3; 3]) -> DVec3 {
    (a + b + c) / 3.0
}

fn entry(x: DVec3, n_x: DVec3, q: u32, triangle: &[DVec3; 3], portions: &Portions) -> Option<Entry> {
    if !faces(x, triangle) {
        return None;
    }
    let portion = |corners| {
        let clipped = Clipped::new(x, n_x, corners);
        (clipped.form_factor(n_x), (x + clipped.centre()).into())
    };
    let found: Vec<(f64, [f64; 3])> = portions.of(triangle).map(portion).collect();
    let whole: f64 = found.iter().map(|portion| portion.0).sum();
    let [a, b, c] = *triangle;
    let close = whole > FILLED && (b - a).cross(c - a).normalize_or_zero().dot(n_x) < OPPOSED;
    (whole > 0.0).then_some((q, close, found))
}

/// Form factors to the portions of a close patch: of that to the whole each in front has its share by area. Those behind the
/// horizon have no place that a ray could ask about.
fn by_area(exact: &[f64], shares: &[f64]) -> Vec<f64> {
    let in_front = || exact.iter().zip(shares).map(|(&f, &share)| if f > 0.0 { share } else { 0.0 });
    let (whole, area): (f64, f64) = (exact.iter().sum(), in_front().sum());
    in_front().map(|share| share / area * whole).collect()
}

/// What has to be added to the direct sum so that near patches count with their exact form factors: a sparse matrix
/// over the same strengths q = weight * radiosity.
#[derive(Debug, Clone)]
pub struct Correction {
    starts: Vec<usize>,
    sources: Vec<u32>,
    values: Vec<f64>,
    /// What is left of the light of each value; none where the medium is clear.
    left: Vec<[f32; 3]>,
    count: usize,
}

/// The point sources as the correction sees them.
pub struct PointSources<'a> {
    pub positions: &'a [[f64; 3]],
    pub normals: &'a [[f64; 3]],
    pub softening: &'a [f64],
    /// (points_per_patch) share of its patch's area that each of the consecutive sources on it stands for.
    pub shares: &'a [f64],
    /// (P) area of each patch.
    pub areas: &'a [f64],
    pub medium: &'a Medium,
}

/// Which pairs of points the sum over the sources counts.
#[derive(Clone, Copy)]
pub enum Seen<'a> {
    All,
    /// The direct sum's bits.
    Bits(&'a [u64]),
    /// (K * points_per_patch) each, as [`crate::driver_visibility::NearSeen`] has them: whether the sum has a source of a
    /// near entry, and whether that is known; what is known not to be in it is hidden, or gathered by rays.
    Entries(&'a [bool], &'a [bool]),
}

impl Correction {
    /// Exact minus point kernel for each near entry; `fractions` (K * points_per_patch) is how much is seen of what each
    /// point of each entry's patch stands for, and `visible` the pairs that the sum has.
    pub fn new(
        near: &NearField,
        points: &[[f64; 3]],
        normals: &[[f64; 3]],
        sources: &PointSources,
        fractions: &[f64],
        visible: Seen,
    ) -> Result<Self, Error> {
        let (count, per_patch) = (sources.positions.len(), sources.shares.len());
        same_length("near fractions", near.patches.len() * per_patch, fractions.len())?;
        same_length("near form factors", near.patches.len() * per_patch, near.form_factors.len())?;
        same_length("near rows", near.starts.len(), points.len() + 1)?;
        same_length("patch areas", count, sources.areas.len() * per_patch)?;
        match visible {
            Seen::All => {}
            Seen::Bits(bits) => same_length("visibility words", points.len() * count.div_ceil(64), bits.len())?,
            Seen::Entries(counted, known) => {
                same_length("near entries", near.patches.len() * per_patch, counted.len())?;
                same_length("near entries", near.patches.len() * per_patch, known.len())?;
            }
        }
        if let Some(&patch) = near.patches.iter().find(|&&q| q as usize >= sources.areas.len()) {
            return Err(Error::Index { what: "near patch", index: patch as usize, count: sources.areas.len() });
        }
        let seen = |i: usize, j: usize, e: usize| match visible {
            Seen::All => true,
            Seen::Bits(bits) => bits[i * count.div_ceil(64) + j / 64] >> (j % 64) & 1 == 1,
            Seen::Entries(counted, _) => counted[e * per_patch + j % per_patch],
        };
        // Rays that gather meet portions one by one, by their form factors.
        let gathered =
            |portion: usize| matches!(visible, Seen::Entries(counted, known) if known[portion] && !counted[portion]);
        let rows: Vec<Vec<f64>> = (0..points.len())
            .into_par_iter()
            .map(|i| {
                let mut row = Vec::new();
                for e in near.starts[i]..near.starts[i + 1] {
                    let q = near.patches[e] as usize;
                    let portions = e * per_patch..(e + 1) * per_patch;
                    let mut form_factors = Cow::from(&near.form_factors[portions.clone()]);
                    if near.close[e] && !portions.into_iter().any(gathered) {
                        form_factors = by_area(&form_factors, sources.shares).into();
                    }
                    for (k, share) in sources.shares.iter().enumerate() {
                        let (j, portion) = (q * per_patch + k, e * per_patch + k);
                        let exact = fractions[portion] * form_factors[k] / (share * sources.areas[q]);
                        let (y, n_y) = (sources.positions[j], sources.normals[j]);
                        let softening = sources.softening[j];
                        let point = if seen(i, j, e) { kernel(points[i], normals[i], y, n_y, softening) } else { 0.0 };
                        row.push(exact - point);
                    }
                }
                row
            })
            .collect();
        let left = |i: usize| {
            let of_entries = near.patches[near.starts[i]..near.starts[i + 1]].iter();
            let points_of = move |&q: &u32| q as usize * per_patch..(q as usize + 1) * per_patch;
            let left = move |j: usize| sources.medium.left(points[i], sources.positions[j]);
            of_entries.flat_map(points_of).map(move |j| left(j).map(|left: f64| left as f32))
        };
        let absorbing = if sources.medium.is_clear() { 0 } else { points.len() };
        let of_patch = |&q: &u32| (0..per_patch as u32).map(move |k| q * per_patch as u32 + k);
        Ok(Correction {
            starts: near.starts.iter().map(|s| s * per_patch).collect(),
            sources: near.patches.iter().flat_map(of_patch).collect(),
            values: rows.concat(),
            left: (0..absorbing).into_par_iter().flat_map_iter(left).collect(),
            count,
        })
    }

    /// Adds the correction's irradiance for strengths (N, C) to `irradiance` (M, C); `clear` as if nothing were absorbed.
    pub fn add<const C: usize>(
        &self,
        strengths: &[[f64; C]],
        clear: bool,
        irradiance: &mut [[f64; C]],
    ) -> Result<(), Error> {
        same_length("strengths", self.count, strengths.len())?;
        same_length("irradiance", self.starts.len(), irradiance.len() + 1)?;
        let left: &[[f32; 3]] = if clear { &[] } else { &self.left };
        irradiance.par_iter_mut().enumerate().for_each(|(i, out)| {
            for e in self.starts[i]..self.starts[i + 1] {
                let q = strengths[self.sources[e] as usize];
                let left = kept::<C>(left, e);
                for colour in 0..C {
                    out[colour] += self.values[e] * left[colour] * q[colour];
                }
            }
        });
        Ok(())
    }

    /// What each source (N,) sends by the correction for one unit of strength, from the areas (M,) of the receivers.
    pub fn sent(&self, areas: &[f64]) -> Result<Vec<f64>, Error> {
        same_length("receiver areas", self.starts.len(), areas.len() + 1)?;
        let mut sent = vec![0.0; self.count];
        for (i, area) in areas.iter().enumerate() {
            for e in self.starts[i]..self.starts[i + 1] {
                sent[self.sources[e] as usize] += self.values[e] * area;
            }
        }
        Ok(sent)
    }

    /// Entries of the sparse matrix.
    pub fn len(&self) -> usize {
        self.values.len()
    }

    pub fn is_empty(&self) -> bool {
        self.values.is_empty()
    }
}
