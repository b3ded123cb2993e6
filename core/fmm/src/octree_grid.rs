// SPDX-License-Identifier: GPL-3.0-or-later
//! The root cube, its cells, and the Morton keys of points.
//!
//! A key is 63 bits: three for the normal axis of the particle, then one octal digit a level from level 1 down to
//! `MAX_LEVEL`. In a digit bit 0 is x, bit 1 is y, bit 2 is z, set for the upper half.

use crate::octree_error::OctreeError;
use crate::vector::{find, high, low};

/// Deepest level of any octree; the root is at level 0.
pub const MAX_LEVEL: u8 = 20;

/// Beyond this |d|^4 overflows.
const LARGEST: f64 = 1e75;

/// Least half side, relative to the coordinates: the cells of the deepest level are then still wider than rounding.
const RELATIVE_HALF: f64 = 1e-8;

/// A root cube, shared by every octree whose boxes are to be paired.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Grid {
    /// Centre of the cube, scene units.
    pub centre: [f64; 3],
    /// Half its side, scene units.
    pub half: f64,
}

impl Grid {
    /// The smallest cube around all points of all sets.
    pub fn around(sets: &[&[[f64; 3]]]) -> Result<Self, OctreeError> {
        let mut least = [f64::INFINITY; 3];
        let mut most = [f64::NEG_INFINITY; 3];
        for set in sets {
            check_positions(set)?;
            for &point in *set {
                least = low(least, point);
                most = high(most, point);
            }
        }
        if least[0] > most[0] {
            return Err(OctreeError::Empty);
        }
        let centre = [0, 1, 2].map(|i| 0.5 * (least[i] + most[i]));
        let extent = (0..3).map(|i| 0.5 * (most[i] - least[i])).fold(0.0, f64::max);
        let half = extent.max(RELATIVE_HALF * largest(centre));
        // Coincident points at the origin have no size of their own, and below 1/LARGEST the kernel overflows.
        let half = if half > 1.0 / LARGEST { half } else { 1.0 };
        Ok(Self { centre, half })
    }

    pub(crate) fn check(&self) -> Result<(), OctreeError> {
        // NaN fails every comparison, and so does not fit.
        let fits = in_range(self.centre) && self.half > 0.0 && self.half <= LARGEST;
        if fits { Ok(()) } else { Err(OctreeError::BadGrid { centre: self.centre, half: self.half }) }
    }

    /// Whether the point lies in the cube, rounding forgiven.
    pub(crate) fn holds(&self, point: [f64; 3]) -> bool {
        let reach = self.half * (1.0 + 1e-9) + 1e-15 * largest(self.centre);
        (0..3).all(|i| (point[i] - self.centre[i]).abs() <= reach)
    }

    /// Half the side of a box at this level.
    pub fn half_side(&self, level: u8) -> f64 {
        self.half / f64::from(1_u32 << level)
    }

    /// Centre of the box with these integer coordinates at this level.
    pub fn cell_centre(&self, level: u8, cell: [i32; 3]) -> [f64; 3] {
        let half = self.half_side(level);
        [0, 1, 2].map(|i| self.centre[i] - self.half + half * f64::from(2 * cell[i] + 1))
    }

    /// Largest distance of any point of the cube from the origin along one axis: what rounding is relative to.
    pub fn magnitude(&self) -> f64 {
        largest(self.centre) + self.half
    }

    /// Morton key of a point of the cube, behind the number of its normal axis (0 to 5, or 0 when not split by normal).
    pub(crate) fn key(&self, point: [f64; 3], axis: u8) -> u64 {
        let cells = f64::from(1_u32 << MAX_LEVEL);
        let per_unit = 0.5 * cells / self.half;
        let bits = [0, 1, 2].map(|i| {
            let steps = (point[i] - (self.centre[i] - self.half)) * per_unit;
            // The upper face of the cube belongs to its last cells.
            spread_bits(steps.clamp(0.0, cells - 1.0) as u64)
        });
        u64::from(axis) << (3 * MAX_LEVEL) | bits[0] | bits[1] << 1 | bits[2] << 2
    }
}

/// The first position that cannot be used is an error.
pub(crate) fn check_positions(positions: &[[f64; 3]]) -> Result<(), OctreeError> {
    match find(positions, |p| !in_range(p)) {
        Some(index) => Err(OctreeError::BadPosition { index, value: positions[index] }),
        None => Ok(()),
    }
}

fn in_range(p: [f64; 3]) -> bool {
    p.iter().all(|x| x.abs() <= LARGEST)
}

fn largest(a: [f64; 3]) -> f64 {
    a.iter().fold(0.0, |most, x| x.abs().max(most))
}

/// Moves bit i of a number below 2^21 to bit 3 i.
fn spread_bits(x: u64) -> u64 {
    let x = (x | x << 32) & 0x001f_0000_0000_ffff;
    let x = (x | x << 16) & 0x001f_0000_ff00_00ff;
    let x = (x | x << 8) & 0x100f_00f0_0f00_f00f;
    let x = (x | x << 4) & 0x10c3_0c30_c30c_30c3;
    (x | x << 2) & 0x1249_2492_4924_9249
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn digits_of_a_key_are_octants() {
        let grid = Grid { centre: [0.5; 3], half: 0.5 };
        let key = grid.key([0.9, 0.1, 0.1], 5);
        assert_eq!(key >> 60, 5);
        assert_eq!(key >> 57 & 7, 1);
        assert_eq!(grid.key([0.1, 0.1, 0.9], 0) >> 57, 4);
        assert_eq!(grid.key([1.0; 3], 0), (1 << 60) - 1);
    }

    #[test]
    fn bits_are_spread() {
        for i in 0..21 {
            assert_eq!(spread_bits(1 << i), 1 << (3 * i));
        }
    }

    #[test]
    fn cube_around_two_sets() -> Result<(), OctreeError> {
        let grid = Grid::around(&[&[[0.0, 0.0, 0.0]], &[[4.0, 1.0, -1.0]]])?;
        assert_eq!(grid, Grid { centre: [2.0, 0.5, -0.5], half: 2.0 });
        Ok(())
    }

    #[test]
    fn cube_around_one_place() -> Result<(), OctreeError> {
        assert_eq!(Grid::around(&[&[[0.0; 3]; 4]])?.half, 1.0);
        let far = Grid::around(&[&[[1e12, 0.0, 0.0]]])?;
        assert!(far.half > 0.0 && far.holds([1e12, 0.0, 0.0]));
        Ok(())
    }

    #[test]
    fn positions_that_cannot_be_used() {
        assert_eq!(Grid::around(&[]), Err(OctreeError::Empty));
        for bad in [f64::NAN, f64::INFINITY, -1e80] {
            let error = Grid::around(&[&[[0.0; 3], [1.0, bad, 0.0]]]);
            assert!(matches!(error, Err(OctreeError::BadPosition { index: 1, .. })));
        }
        assert!(Grid { centre: [0.0, f64::NAN, 1.0], half: 1.0 }.check().is_err());
    }
}
