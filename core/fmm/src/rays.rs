// SPDX-License-Identifier: GPL-3.0-or-later
//! Which pairs need a ray, the rays themselves, and the bits that their answers become.

use crate::error::{Error, same_length};
use glam::DVec3;
use rayon::prelude::*;

/// Both cosines' product below this counts as not facing: the pair exchanges nothing that could be seen.
const GRAZING: f64 = 1e-12;
/// Rays end so far beside their target along its surface, in units of the box: between points of regular meshes they would
/// meet corners exactly, where embree lets some through.
const ASIDE: f64 = 1e-5;
/// So many in a unit of the box tell places apart.
const STEPS: f64 = 1e6;
/// What the way aside is square to, besides the normal.
const ASKEW: DVec3 = DVec3::new(0.4159, 0.6328, 0.6532);

/// Origin and unnormalised direction of a ray that ends where both add up.
pub type Ends = ([f32; 3], [f32; 3]);

/// Maps scene coordinates into the box [-1, 1]^3 that rays are traced in, and lifts their ends off the surfaces.
#[derive(Debug, Clone, Copy)]
pub struct Frame {
    pub centre: [f64; 3],
    /// Scene length of one unit of the box.
    pub scale: f64,
    /// Distance along the normal, in units of the box, between a surface and the end of a ray.
    pub offset: f64,
}

impl Frame {
    fn map(&self, x: [f64; 3], n: [f64; 3]) -> DVec3 {
        (DVec3::from(x) - DVec3::from(self.centre)) / self.scale + DVec3::from(n) * self.offset
    }

    /// A number of a place, the same whatever else there is, and however far away and large the scene is.
    pub fn number(&self, x: [f64; 3]) -> u64 {
        let steps = (self.map(x, [0.0; 3]) * STEPS).round().as_i64vec3().to_array();
        steps.into_iter().fold(0, |number, step| (number << 21) ^ step as u64)
    }

    /// A place in the box that rays are traced in.
    pub fn inside(&self, x: [f64; 3]) -> [f64; 3] {
        self.map(x, [0.0; 3]).into()
    }

    /// Where rays from a surface point with a unit normal start.
    pub fn start(&self, x: [f64; 3], n_x: [f64; 3]) -> [f32; 3] {
        self.map(x, n_x).as_vec3().into()
    }

    /// Rays from points to as many targets.
    pub fn rays(&self, from: Oriented, to: Oriented) -> Result<Vec<Ends>, Error> {
        same_length("normals", from.points.len(), from.normals.len())?;
        same_length("targets", from.points.len(), to.points.len())?;
        same_length("target normals", from.points.len(), to.normals.len())?;
        let ends = from.points.iter().zip(from.normals).zip(to.points.iter().zip(to.normals));
        Ok(ends.map(|((&x, &n_x), (&y, &n_y))| self.ray(x, n_x, y, n_y)).collect())
    }

    /// The ray from one lifted end to the other, or just beside it.
    pub fn ray(&self, x: [f64; 3], n_x: [f64; 3], y: [f64; 3], n_y: [f64; 3]) -> Ends {
        self.ends(self.map(x, n_x), self.map(y, n_y) + ASIDE * ASKEW.cross(DVec3::from(n_y)))
    }

    /// The ray from one lifted end to the very other, which is no corner.
    pub fn ray_to(&self, x: [f64; 3], n_x: [f64; 3], y: [f64; 3], n_y: [f64; 3]) -> Ends {
        self.ends(self.map(x, n_x), self.map(y, n_y))
    }

    fn ends(&self, start: DVec3, end: DVec3) -> Ends {
        let origin = start.as_vec3();
        // Subtracting the rounded origin makes the ray end where it should.
        (origin.into(), (end - origin.as_dvec3()).as_vec3().into())
    }
}

/// Rays, each with the slot that its answer goes to.
#[derive(Debug, Default)]
pub struct Rays {
    pub slots: Vec<u64>,
    pub origins: Vec<[f32; 3]>,
    pub directions: Vec<[f32; 3]>,
}

impl Rays {
    pub(crate) fn push(&mut self, slot: u64, (origin, direction): Ends) {
        self.slots.push(slot);
        self.origins.push(origin);
        self.directions.push(direction);
    }

    /// The first ones only.
    pub(crate) fn truncate(&mut self, count: usize) {
        self.slots.truncate(count);
        self.origins.truncate(count);
        self.directions.truncate(count);
    }
}

/// The facing pairs of a block of receivers with all sources, and a ray for each.
#[derive(Debug, Default)]
pub struct FacingRays {
    /// (R) receiver row within the block times the number of sources, plus the source.
    pub pairs: Vec<u64>,
    pub origins: Vec<[f32; 3]>,
    pub directions: Vec<[f32; 3]>,
}

/// Points and unit normals, (N, 3) each.
#[derive(Clone, Copy)]
pub struct Oriented<'a> {
    pub points: &'a [[f64; 3]],
    pub normals: &'a [[f64; 3]],
}

impl FacingRays {
    /// Rays from each receiver to each source that faces it; `after`, when given, is the source that stands for the
    /// first receiver, and only sources that come after a receiver's own are taken (the matrix is symmetric).
    pub fn new(receivers: Oriented, sources: Oriented, after: Option<usize>, frame: &Frame) -> Result<Self, Error> {
        same_length("receiver normals", receivers.points.len(), receivers.normals.len())?;
        same_length("source normals", sources.points.len(), sources.normals.len())?;
        let count = sources.points.len();
        let mut rays = FacingRays::default();
        for (i, (&x, &n_x)) in receivers.points.iter().zip(receivers.normals).enumerate() {
            for j in after.map_or(0, |first| first + i + 1)..count {
                if facing(x, n_x, sources.points[j], sources.normals[j]) {
                    let (origin, direction) = frame.ray(x, n_x, sources.points[j], sources.normals[j]);
                    rays.pairs.push((i * count + j) as u64);
                    rays.origins.push(origin);
                    rays.directions.push(direction);
                }
            }
        }
        Ok(rays)
    }
}

pub(crate) fn facing(x: [f64; 3], n_x: [f64; 3], y: [f64; 3], n_y: [f64; 3]) -> bool {
    let d = DVec3::from(x) - DVec3::from(y);
    let (cos_y, cos_x) = (DVec3::from(n_y).dot(d), -DVec3::from(n_x).dot(d));
    cos_y > 0.0 && cos_x > 0.0 && cos_y * cos_x > GRAZING * d.length_squared()
}

/// Sets the bit of every pair that is not occluded; `bits` has `words` words a receiver.
pub fn mark_visible(bits: &mut [u64], count: usize, pairs: &[u64], occluded: &[bool]) -> Result<(), Error> {
    same_length("answers", pairs.len(), occluded.len())?;
    let words = count.div_ceil(64);
    for (&pair, _) in pairs.iter().zip(occluded).filter(|(_, occluded)| !**occluded) {
        let (i, j) = (pair as usize / count, pair as usize % count);
        let word = i * words + j / 64;
        if word >= bits.len() {
            return Err(Error::Index { what: "visibility word", index: word, count: bits.len() });
        }
        bits[word] |= 1 << (j % 64);
    }
    Ok(())
}

/// Copies the upper triangle of a square bit matrix (`count` rows) to the lower one.
pub fn symmetrise(bits: &mut [u64], count: usize) -> Result<(), Error> {
    let words = count.div_ceil(64);
    same_length("visibility words", count * words, bits.len())?;
    let upper = bits.to_vec();
    bits.par_chunks_mut(words.max(1)).enumerate().for_each(|(i, row)| {
        for j in 0..i {
            row[j / 64] |= (upper[j * words + i / 64] >> (i % 64) & 1) << (j % 64);
        }
    });
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn symmetrise_mirrors_every_bit() {
        let count = 130;
        let words = 3;
        let on = |i: usize, j: usize| i < j && (i * 7 + j * 13).is_multiple_of(3);
        let mut bits = vec![0u64; count * words];
        for i in 0..count {
            for j in (0..count).filter(|&j| on(i, j)) {
                bits[i * words + j / 64] |= 1 << (j % 64);
            }
        }
        symmetrise(&mut bits, count).unwrap();
        for i in 0..count {
            for j in 0..count {
                let bit = bits[i * words + j / 64] >> (j % 64) & 1 == 1;
                assert_eq!(bit, on(i, j) || on(j, i), "{i} {j}");
            }
        }
    }

    #[test]
    fn a_ray_ends_just_above_its_target() {
        let frame = Frame { centre: [1e6, 0.0, 0.0], scale: 2.0, offset: 1e-3 };
        let (o, d) = frame.ray([1e6, 0.0, 0.0], [0., 0., 1.], [1e6 + 2.0, 0.0, 2.0], [0., 0., -1.]);
        assert_eq!(o, [0.0, 0.0, 1e-3]);
        let aside = (o[0] + d[0] - 1.0).hypot(o[1] + d[1]);
        assert!((1e-6..=1.01e-5).contains(&aside) && (o[2] + d[2] - 0.999).abs() < 1e-6);
    }

    #[test]
    fn wrong_pair_is_refused() {
        assert!(mark_visible(&mut [0], 10, &[1000], &[false]).is_err());
    }
}
