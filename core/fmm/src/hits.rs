// SPDX-License-Identifier: GPL-3.0-or-later
//! What the rays over the hemispheres of a leaf's points met, and what arrives by them.

use crate::blend::{self, Blend};
use crate::error::Error;
use crate::medium::kept;

/// What a ray met: a source that counts, in tree order, or [`NOTHING`], and how far away.
pub type Ray = (u32, f32);

/// In place of a source.
pub const NOTHING: u32 = u32::MAX;

/// What the rays of each point of a leaf met, told apart: something else may get into their way later.
#[derive(Debug, Clone)]
pub struct Told {
    /// (points + 1)
    starts: Vec<u32>,
    rays: Vec<Ray>,
}

/// The sources met from each point of a leaf.
#[derive(Debug)]
pub struct Hits {
    /// (points + 1)
    starts: Vec<u32>,
    /// Tree order.
    sources: Vec<u32>,
    /// What is left of the light of each; none where the medium is clear.
    left: Vec<[f32; 3]>,
    blend: Blend,
}

impl Default for Told {
    fn default() -> Self {
        Self { starts: vec![0], rays: Vec::new() }
    }
}

impl Told {
    /// Adds a ray of the point whose rays are being told.
    pub fn push(&mut self, ray: Ray) {
        self.rays.push(ray);
    }

    /// Those that follow are of the next point.
    pub fn end_point(&mut self) {
        self.starts.push(self.rays.len() as u32);
    }

    /// Tells what the ray at a place meets now.
    pub fn replace(&mut self, place: usize, ray: Ray) -> Result<(), Error> {
        let count = self.rays.len();
        let wrong = Error::Index { what: "place of a ray", index: place, count };
        *self.rays.get_mut(place).ok_or(wrong)? = ray;
        Ok(())
    }
}

impl Hits {
    /// Of points with unit normals, whose values are blended where they have so many rays over an open hemisphere, and else
    /// stay their own; `left` is of each source met, in their order.
    pub fn new(
        told: &Told,
        left: Vec<[f32; 3]>,
        (positions, normals): (&[[f64; 3]], &[[f64; 3]]),
        density: Option<usize>,
    ) -> Self {
        let (mut starts, mut sources) = (vec![0], Vec::new());
        let (mut reaches, mut lengths) = (Vec::new(), Vec::new());
        for ends in told.starts.windows(2) {
            let rays = &told.rays[ends[0] as usize..ends[1] as usize];
            sources.extend(rays.iter().map(|ray| ray.0).filter(|&j| j != NOTHING));
            starts.push(sources.len() as u32);
            lengths.clear();
            lengths.extend(rays.iter().map(|ray| f64::from(ray.1)));
            reaches.push(blend::distance(&mut lengths));
        }
        let blend = match density {
            Some(density) => Blend::new(positions, normals, &reaches, density),
            None => Blend::none(positions.len()),
        };
        Self { starts, sources, left, blend }
    }

    /// Adds what arrives from the radiosity of the sources, of which each ray brings a share; `clear` as if nothing were
    /// absorbed.
    pub fn add<const C: usize>(&self, radiosity: &[[f64; C]], share: f64, clear: bool, irradiance: &mut [[f64; C]]) {
        let left: &[[f32; 3]] = if clear { &[] } else { &self.left };
        let own = |ends: &[u32]| {
            let mut sum = [0.0; C];
            for ray in ends[0] as usize..ends[1] as usize {
                let (b, left) = (radiosity[self.sources[ray] as usize], kept::<C>(left, ray));
                (0..C).for_each(|c| sum[c] += left[c] * b[c]);
            }
            sum.map(|sum| share * sum)
        };
        let own: Vec<[f64; C]> = self.starts.windows(2).map(own).collect();
        self.blend.add(&own, irradiance);
    }

    /// Calls `send` with each source met and the part of the areas of the points that it sends a ray's share to.
    pub fn sent(&self, areas: &[[f64; 1]], mut send: impl FnMut(usize, f64)) {
        let areas = self.blend.transposed(areas);
        for (ends, area) in self.starts.windows(2).zip(areas) {
            self.sources[ends[0] as usize..ends[1] as usize].iter().for_each(|&j| send(j as usize, area));
        }
    }

    /// Sources met from all points together.
    pub fn count(&self) -> usize {
        self.sources.len()
    }
}
