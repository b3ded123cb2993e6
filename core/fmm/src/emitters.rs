// SPDX-License-Identifier: GPL-3.0-or-later
//! Strong emitters as the ends of rays that are aimed at them, more of them where more light comes from.

use crate::error::{Error, same_length};
use crate::rays::{Ends, Frame};
use crate::samples::inside;
use glam::DVec3;

/// The number of the emitter of a source that is on none.
pub const NONE: u32 = u32::MAX;
/// Share of the rays of a point that choose emitters by their power alone, wherever these are.
const BLIND: f64 = 0.25;

/// Patches that emit strongly.
#[derive(Debug)]
pub struct Emitters {
    patches: Patches,
    /// W/m^2.
    emission: Vec<[f64; 3]>,
    /// (E,) how much of it leaves a place of each on average.
    opacity: Vec<f64>,
    /// (N,) which of them each source is on, or [`NONE`].
    numbers: Vec<u32>,
    /// W, all colours alike.
    powers: Vec<f64>,
}

/// (E,) of each.
#[derive(Debug)]
pub struct Patches {
    pub triangles: Vec<[[f64; 3]; 3]>,
    /// Unit, of the sides that emit.
    pub normals: Vec<[f64; 3]>,
    pub areas: Vec<f64>,
    /// From the centre to the farthest corner.
    pub radii: Vec<f64>,
}

/// Points with unit normals, and how those of each row choose one of the emitters.
#[derive(Clone, Copy)]
pub struct Choosing<'a> {
    pub points: &'a [[f64; 3]],
    pub normals: &'a [[f64; 3]],
    /// (K,) the row of each point.
    pub rows: &'a [u32],
    /// (M * E,) the shares of the emitters, added up to 1 in each row.
    pub ends: &'a [f64],
}

/// What rays from the points meet: sources, -1 for none, where, and the unit normals of the sides they come to.
#[derive(Clone, Copy)]
pub struct Met<'a> {
    pub sources: &'a [i64],
    pub places: &'a [[f64; 3]],
    pub normals: &'a [[f64; 3]],
}

/// A ray from one of the points to a place on an emitter, and the light (W/m^2) that it stands for.
#[derive(Debug, Clone, Copy)]
pub struct Aimed {
    pub point: u32,
    pub ends: Ends,
    pub light: [f64; 3],
}

impl Emitters {
    /// See the fields.
    pub fn new(patches: Patches, emission: Vec<[f64; 3]>, opacity: Vec<f64>, numbers: Vec<u32>) -> Result<Self, Error> {
        let count = patches.triangles.len();
        same_length("emitter normals", count, patches.normals.len())?;
        same_length("emitter areas", count, patches.areas.len())?;
        same_length("emitter radii", count, patches.radii.len())?;
        same_length("emission", count, emission.len())?;
        same_length("opacity", count, opacity.len())?;
        let powers = emission.iter().zip(&patches.areas).map(|(e, area)| area * e.iter().sum::<f64>() / 3.0).collect();
        match numbers.iter().find(|&&number| number != NONE && number as usize >= count) {
            Some(&wrong) => Err(Error::Index { what: "emitter", index: wrong as usize, count }),
            None => Ok(Self { patches, emission, opacity, numbers, powers }),
        }
    }

    /// (E,) ends of shares by power.
    pub fn anywhere(&self) -> Vec<f64> {
        added_up(self.powers.iter().copied())
    }

    /// (M * E,) ends of shares by what the emitters would send to points with unit normals if nothing were in the way;
    /// without normals, to places near the points wherever these face.
    pub fn around(&self, points: &[[f64; 3]], normals: Option<&[[f64; 3]]>) -> Result<Vec<f64>, Error> {
        if let Some(normals) = normals {
            same_length("normals", points.len(), normals.len())?;
        }
        let centre = |[a, b, c]: [DVec3; 3]| (a + b + c) / 3.0;
        let centres: Vec<_> = self.patches.triangles.iter().map(|t| centre(t.map(DVec3::from))).collect();
        let all: f64 = self.powers.iter().sum();
        let mut ends = Vec::with_capacity(points.len() * centres.len());
        let mut chances = vec![0.0; centres.len()];
        for (i, &x) in points.iter().enumerate() {
            for (e, chance) in chances.iter_mut().enumerate() {
                let (between, radius) = (centres[e] - DVec3::from(x), self.patches.radii[e]);
                let distance = between.length().max(radius);
                // What has its centre behind the horizon may reach above it.
                let there = (radius - between.dot(self.patches.normals[e].into())).max(0.0);
                let here = normals.map_or(distance, |n| (radius + between.dot(n[i].into())).max(0.0));
                *chance = self.powers[e] * there * here / distance.powi(4);
            }
            let most = chances.iter().sum::<f64>().max(f64::MIN_POSITIVE);
            let mixed = chances.iter().zip(&self.powers);
            ends.extend(added_up(mixed.map(|(chance, power)| BLIND * power / all + (1.0 - BLIND) * chance / most)));
        }
        Ok(ends)
    }

    /// Radiosity (K, width) of what rays even by cosine have met, by that (N, width) of the sources. In the first three
    /// columns what aimed rays find too is less by their share: both are weighted by the power heuristic.
    pub fn met(&self, from: Choosing, met: Met, radiosity: &[f64], width: usize) -> Result<Vec<f64>, Error> {
        self.check(from)?;
        let count = from.points.len();
        same_length("sources", count, met.sources.len())?;
        same_length("places", count, met.places.len())?;
        same_length("sides", count, met.normals.len())?;
        same_length("radiosity", self.numbers.len() * width, radiosity.len())?;
        let mut found = vec![0.0; count * width];
        for (i, here) in found.chunks_mut(width.max(1)).enumerate() {
            let Ok(source) = usize::try_from(met.sources[i]) else { continue };
            let Some(&number) = self.numbers.get(source) else {
                return Err(Error::Index { what: "source", index: source, count: self.numbers.len() });
            };
            here.copy_from_slice(&radiosity[source * width..][..width]);
            if number != NONE {
                let over = self.over(from, i, number as usize, met.places[i], met.normals[i]);
                let less = 1.0 / (1.0 + over * over);
                here.iter_mut().zip(self.emission[number as usize]).for_each(|(b, e)| *b -= less * e);
            }
        }
        Ok(found)
    }

    /// A ray from each point to a place that three numbers even in [0, 1) choose, if it can bring any light; `frame` is
    /// that of rays.
    pub fn aim(&self, from: Choosing, numbers: &[[f64; 3]], frame: &Frame) -> Result<Vec<Aimed>, Error> {
        self.check(from)?;
        same_length("numbers", from.points.len(), numbers.len())?;
        let Some(last) = self.powers.len().checked_sub(1) else { return Ok(Vec::new()) };
        let one = |(i, &[at, u, v]): (usize, &[f64; 3])| {
            let ends = &from.ends[from.rows[i] as usize * (last + 1)..][..=last];
            let number = ends.partition_point(|&end| end <= at).min(last);
            let (y, n_y) = (inside(self.patches.triangles[number], [u, v]).into(), self.patches.normals[number]);
            let over = self.over(from, i, number, y, n_y);
            let share = self.opacity[number] / (over + over.recip());
            (share > 0.0).then(|| Aimed {
                point: i as u32,
                ends: frame.ray(from.points[i], from.normals[i], y, n_y),
                light: self.emission[number].map(|e| share * e),
            })
        };
        Ok(numbers.iter().enumerate().filter_map(one).collect())
    }

    /// How much likelier a ray of a point even by cosine is to find a place on an emitter than one that is aimed.
    fn over(&self, from: Choosing, point: usize, number: usize, y: [f64; 3], n_y: [f64; 3]) -> f64 {
        let ends = &from.ends[from.rows[point] as usize * self.powers.len()..];
        let share = ends[number] - if number > 0 { ends[number - 1] } else { 0.0 };
        let between = DVec3::from(y) - DVec3::from(from.points[point]);
        let squared = between.length_squared().max(f64::MIN_POSITIVE);
        let here = between.dot(from.normals[point].into()).max(0.0);
        let there = (-between.dot(n_y.into())).max(0.0);
        let by_ray = here * there / (std::f64::consts::PI * squared);
        by_ray * self.patches.areas[number] / (share * squared).max(f64::MIN_POSITIVE)
    }

    fn check(&self, from: Choosing) -> Result<(), Error> {
        let (count, rows) = (self.powers.len(), from.ends.len() / self.powers.len().max(1));
        same_length("normals", from.points.len(), from.normals.len())?;
        same_length("rows", from.points.len(), from.rows.len())?;
        same_length("ends", rows * count, from.ends.len())?;
        match from.rows.iter().find(|&&row| count > 0 && row as usize >= rows) {
            Some(&row) => Err(Error::Index { what: "row", index: row as usize, count: rows }),
            None => Ok(()),
        }
    }
}

/// Sums of chances from the first to each, as shares of them all.
fn added_up(chances: impl Iterator<Item = f64>) -> Vec<f64> {
    let mut sum = 0.0;
    let mut ends: Vec<_> = chances.map(|chance| (sum += chance, sum).1).collect();
    ends.iter_mut().for_each(|end| *end /= sum);
    ends
}

#[cfg(test)]
mod tests {
    use super::*;

    const DOWN: [f64; 3] = [0.0, 0.0, -1.0];
    const UP: [f64; 3] = [0.0, 0.0, 1.0];

    /// Small patches at such places that face down, one for each source but the first.
    fn emitters(places: &[[f64; 3]], emission: [f64; 3]) -> Emitters {
        let count = places.len();
        let patches = Patches {
            triangles: places.iter().map(|&place| [place; 3]).collect(),
            normals: vec![DOWN; count],
            areas: vec![0.25; count],
            radii: vec![1e-3; count],
        };
        let numbers = std::iter::once(NONE).chain(0..count as u32).collect();
        Emitters::new(patches, vec![emission; count], vec![0.5; count], numbers).unwrap()
    }

    #[test]
    fn what_both_kinds_of_rays_find_is_shared_by_the_power_heuristic() {
        let frame = Frame { centre: [0.0; 3], scale: 2.0, offset: 0.0 };
        let one = emitters(&[[1.0, 0.0, 2.0]], [10.0, 20.0, 0.0]);
        let (points, normals) = ([[0.0; 3]; 2], [UP, DOWN]);
        let from = Choosing { points: &points, normals: &normals, rows: &[0; 2], ends: &[1.0] };
        // By cosine: 2 * 2 / (pi * 5^2) per area; by aiming: 1 / 0.25.
        let over = 0.25 * 4.0 / (std::f64::consts::PI * 25.0);
        let found = one.aim(from, &[[0.5, 0.3, 0.7]; 2], &frame).unwrap();
        assert_eq!(found.iter().map(|aimed| aimed.point).collect::<Vec<_>>(), [0]);
        assert!((found[0].light[0] - 0.5 * 10.0 * over / (1.0 + over * over)).abs() < 1e-14);
        assert!((found[0].ends.1[2] - 1.0).abs() < 1e-4);
        let radiosity = [3.0, 3.0, 3.0, 7.0, 12.0, 24.0, 1.0, 8.0];
        let met = Met { sources: &[1, 0], places: &[[1.0, 0.0, 2.0]; 2], normals: &[DOWN; 2] };
        let found = one.met(from, met, &radiosity, 4).unwrap();
        let less = 1.0 / (1.0 + over * over);
        assert!((found[0] - (12.0 - 10.0 * less)).abs() < 1e-14 && (found[1] - (24.0 - 20.0 * less)).abs() < 1e-14);
        assert_eq!(found[2..], [1.0, 8.0, 3.0, 3.0, 3.0, 7.0]);
        assert!(one.met(from, Met { sources: &[2; 2], ..met }, &radiosity, 4).is_err());
        assert!(one.aim(Choosing { rows: &[2; 2], ..from }, &[[0.5; 3]; 2], &frame).is_err());
    }

    #[test]
    fn emitters_are_chosen_by_their_shares_and_none_by_none() {
        let frame = Frame { centre: [0.0; 3], scale: 1.0, offset: 0.0 };
        let two = emitters(&[[0.0, 0.0, 1.0], [0.0, 0.0, 2.0]], [1.0; 3]);
        let from = Choosing { points: &[[0.0; 3]; 3], normals: &[UP; 3], rows: &[0; 3], ends: &[0.3, 1.0] };
        let found = two.aim(from, &[[0.2, 0.5, 0.5], [0.4, 0.5, 0.5], [1.0, 0.5, 0.5]], &frame).unwrap();
        let heights: Vec<_> = found.iter().map(|aimed| aimed.ends.1[2].round()).collect();
        assert_eq!(heights, [1.0, 2.0, 2.0]);
        let none = emitters(&[], [1.0; 3]);
        assert!(none.aim(Choosing { ends: &[], ..from }, &[[0.5; 3]; 3], &frame).unwrap().is_empty());
        assert!(none.anywhere().is_empty() && none.around(from.points, None).unwrap().is_empty());
    }

    #[test]
    fn those_that_send_more_are_chosen_more_often_and_all_by_some() {
        let two = emitters(&[[0.0, 0.0, 1.0], [0.0, 0.0, 2.0]], [1.0; 3]);
        assert_eq!(two.anywhere(), [0.5, 1.0]);
        let found = two.around(&[[0.0; 3]; 2], Some(&[UP, DOWN])).unwrap();
        // Four fifths of the light come from the one at half the distance; what faces away gets next to none of either.
        assert!((found[0] - (0.25 * 0.5 + 0.75 * 0.8)).abs() < 1e-3);
        assert!(found[1] == 1.0 && (found[2] - 0.5).abs() < 1e-3 && found[3] == 1.0);
        assert!((two.around(&[[0.0; 3]], None).unwrap()[0] - (0.25 * 0.5 + 0.75 * 0.8)).abs() < 1e-3);
        assert!(two.around(&[[0.0; 3]], Some(&[])).is_err());
    }
}
