// SPDX-License-Identifier: GPL-3.0-or-later
//! What can be wrong with the input of an octree.

use std::fmt;

#[derive(Debug, Clone, PartialEq)]
pub enum OctreeError {
    /// There is no point to build from.
    Empty,
    /// More points than a box range of u32 can hold.
    TooManyPoints { count: usize },
    /// A coordinate is NaN, infinite, or so large that |d|^4 overflows.
    BadPosition { index: usize, value: [f64; 3] },
    /// A normal is not finite or not of unit length.
    BadNormal { index: usize, value: [f64; 3] },
    /// The root cube is not finite or has no volume.
    BadGrid { centre: [f64; 3], half: f64 },
    /// A point lies outside the root cube.
    OutsideGrid { index: usize, value: [f64; 3] },
    /// Positions and normals are not of the same number.
    NormalCount { positions: usize, normals: usize },
    /// Positions and emitters are not of the same number.
    EmitterCount { positions: usize, emitters: usize },
    /// Splitting by normal was asked for, but no normals were given.
    NormalsMissing,
    /// A leaf must be allowed to hold at least one point.
    NoPointsPerLeaf,
    /// The fixed level is deeper than the deepest level of the grid.
    LevelTooDeep { level: u8, deepest: u8 },
}

impl fmt::Display for OctreeError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Empty => write!(f, "an octree needs at least one point"),
            Self::TooManyPoints { count } => {
                write!(f, "{count} points are more than an octree can index ({})", u32::MAX - 1)
            }
            Self::BadPosition { index, value } => {
                write!(f, "point {index} has a coordinate that is not finite or too large: {value:?}")
            }
            Self::BadNormal { index, value } => {
                write!(f, "normal {index} is not a unit vector: {value:?}")
            }
            Self::BadGrid { centre, half } => {
                write!(f, "the root cube with centre {centre:?} and half side {half} has no finite volume")
            }
            Self::OutsideGrid { index, value } => {
                write!(f, "point {index} lies outside the root cube: {value:?}")
            }
            Self::NormalCount { positions, normals } => {
                write!(f, "{positions} positions but {normals} normals")
            }
            Self::EmitterCount { positions, emitters } => {
                write!(f, "{positions} positions but {emitters} emitter flags")
            }
            Self::NormalsMissing => write!(f, "an octree split by normal needs normals"),
            Self::NoPointsPerLeaf => write!(f, "a leaf must be allowed at least one point, not 0"),
            Self::LevelTooDeep { level, deepest } => {
                write!(f, "level {level} is deeper than the deepest level, {deepest}")
            }
        }
    }
}

impl std::error::Error for OctreeError {}
