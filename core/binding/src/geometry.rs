// SPDX-License-Identifier: GPL-3.0-or-later
//! What triangles tell without a ray.

use crate::arrays::{table, triangles, triples, vector};
use numpy::{PyArray1, PyArray2, PyReadonlyArray2, PyReadonlyArray3};
use pyo3::prelude::*;

type PlaneArrays<'py> = (Bound<'py, PyArray2<f64>>, Bound<'py, PyArray1<bool>>, Bound<'py, PyArray1<bool>>);

/// Whether all triangles (T, 3, 3) are inside a mesh without openings.
#[pyfunction]
pub fn is_sealed(py: Python, scene: PyReadonlyArray3<f64>) -> PyResult<bool> {
    let triangles = triangles(&scene)?;
    Ok(py.detach(|| ::fmm::meshes::is_sealed(triangles)))
}

/// What is inside triangles (T, 3, 3), below 0 where they face inwards.
#[pyfunction]
pub fn volume(py: Python, scene: PyReadonlyArray3<f64>) -> PyResult<f64> {
    let triangles = triangles(&scene)?;
    Ok(py.detach(|| ::fmm::meshes::volume(triangles.iter())))
}

/// Each different plane of triangles (T, 3, 3) in a scene of this size, as normal and minus its offset (P, 4), and whether
/// some point (M, 3) is more than `margin` below and above it (P,); None where they are more than `most`.
#[pyfunction]
pub fn planes<'py>(
    py: Python<'py>,
    scene: PyReadonlyArray3<f64>,
    points: PyReadonlyArray2<f64>,
    size: f64,
    margin: f64,
    most: usize,
) -> PyResult<Option<PlaneArrays<'py>>> {
    let (triangles, points) = (triangles(&scene)?, triples(&points, "points")?);
    let Some(found) = py.detach(|| ::fmm::planes::planes(triangles, points, size, margin, most)) else {
        return Ok(None);
    };
    let rows = found.iter().map(|plane| [plane.normal[0], plane.normal[1], plane.normal[2], -plane.offset]);
    let rows = table(py, rows.collect())?;
    let (below, above) = found.iter().map(|plane| (plane.below, plane.above)).unzip();
    Ok(Some((rows, vector(py, below), vector(py, above))))
}
