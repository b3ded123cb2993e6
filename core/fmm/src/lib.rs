// SPDX-License-Identifier: GPL-3.0-or-later
//! Diffuse light transport between particles: the direct sum, exact form factors for near triangles, and their
//! corrections. Positions and normals are `&[[f64; 3]]`, colours are `[red, green, blue]`, lengths are in the
//! caller's unit throughout.

pub mod direct;
pub mod error;
pub mod form_factor;
pub mod near_field;
pub mod rays;

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
