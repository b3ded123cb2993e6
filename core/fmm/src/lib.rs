// SPDX-License-Identifier: GPL-3.0-or-later
//! Diffuse light transport between particles: the fast multipole method, the direct sum that judges it, and exact form
//! factors for near triangles. Positions and normals are `&[[f64; 3]]`, colours are `[red, green, blue]`, or one number
//! where all is grey, lengths are in the caller's unit throughout.

mod bits;
mod blend;
pub mod cells;
pub mod coincident;
pub mod contacts;
mod cuts;
pub mod direct;
mod directions;
pub mod driver;
mod driver_cells;
pub mod driver_visibility;
pub mod emitters;
pub mod error;
pub mod expansion;
pub mod facing;
pub mod form_factor;
pub mod gather;
pub mod groups;
mod hits;
pub mod links;
pub mod lists;
mod lists_batches;
mod lists_traversal;
pub mod medium;
pub mod meshes;
mod mirror;
pub mod moving;
pub mod near_field;
pub mod octree;
mod octree_build;
mod octree_check;
mod octree_error;
mod octree_grid;
mod octree_normals;
mod octree_points;
mod passes;
mod places;
pub mod planes;
pub mod portions;
pub mod rays;
pub mod samples;
pub mod shaft;
pub mod surface;
pub mod threads;
mod translations;
mod vector;
pub mod visibility;
mod visible_lists;

pub use error::Error;

/// The radiosity kernel between two points, clamped at both horizons (eq 1).
///
/// `softening` is the square of the distance below which the kernel stops growing, so that it stays bounded where
/// an exact form factor replaces it.
pub fn kernel(x: [f64; 3], n_x: [f64; 3], y: [f64; 3], n_y: [f64; 3], softening: f64) -> f64 {
    let (n_x, n_y) = (glam::DVec3::from(n_x), glam::DVec3::from(n_y));
    let d = glam::DVec3::from(x) - glam::DVec3::from(y);
    let r2 = d.length_squared().max(softening);
    (n_y.dot(d)).max(0.0) * (-n_x.dot(d)).max(0.0) / (std::f64::consts::PI * r2 * r2)
}
