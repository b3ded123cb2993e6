// SPDX-License-Identifier: GPL-3.0-or-later
//! The few operations on `[f64; 3]` that the octree and the facing test need.

use rayon::prelude::*;

pub(crate) fn add(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

pub(crate) fn sub(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

pub(crate) fn scale(a: [f64; 3], s: f64) -> [f64; 3] {
    [a[0] * s, a[1] * s, a[2] * s]
}

pub(crate) fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

pub(crate) fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

pub(crate) fn norm(a: [f64; 3]) -> f64 {
    dot(a, a).sqrt()
}

/// The first vector for which the test holds.
pub(crate) fn find(vectors: &[[f64; 3]], test: impl Fn([f64; 3]) -> bool + Sync) -> Option<usize> {
    const CHUNK: usize = 1 << 14;
    let in_chunk = |(i, chunk): (usize, &[[f64; 3]])| chunk.iter().position(|&v| test(v)).map(|j| i * CHUNK + j);
    vectors.par_chunks(CHUNK).enumerate().find_map_first(in_chunk)
}

/// Componentwise minimum.
pub(crate) fn low(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[0].min(b[0]), a[1].min(b[1]), a[2].min(b[2])]
}

/// Componentwise maximum.
pub(crate) fn high(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[0].max(b[0]), a[1].max(b[1]), a[2].max(b[2])]
}
