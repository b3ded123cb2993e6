// SPDX-License-Identifier: GPL-3.0-or-later
//! What triangles tell without a ray.

use crate::arrays::{flat, table, triangles, triples, value_error, vector};
use ::fmm::coincident::Sheets;
use numpy::{PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2, PyReadonlyArray3};
use pyo3::prelude::*;

type ContactArrays<'py> =
    (Bound<'py, PyArray1<i8>>, Bound<'py, PyArray1<f64>>, Bound<'py, PyArray2<u32>>, Bound<'py, PyArray1<bool>>);
type BoxArrays<'py> = (Bound<'py, PyArray2<f64>>, Bound<'py, PyArray2<f64>>, bool);
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

/// Of closed parts of triangles (T, 3, 3) the least and the greatest coordinates (P, 3) of those that face inwards and are no
/// inner sides of others, and whether any that faces outwards lies in another, by the numbers of their corners (T, 3).
#[pyfunction]
pub fn inward<'py>(
    py: Python<'py>,
    corners: PyReadonlyArray2<u32>,
    scene: PyReadonlyArray3<f64>,
) -> PyResult<BoxArrays<'py>> {
    let (corners, triangles) = (triples(&corners, "corners")?, triangles(&scene)?);
    if corners.len() != triangles.len() {
        return Err(value_error("corners and triangles differ in number"));
    }
    let (boxes, nested) = py.detach(|| ::fmm::meshes::inward(corners, triangles));
    let (least, most) = boxes.into_iter().unzip();
    Ok((table(py, least)?, table(py, most)?, nested))
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

/// The group (T,) of each triangle (T, 3, 3) of so many kinds (T,), at most about `count` of them.
#[pyfunction]
pub fn group<'py>(
    py: Python<'py>,
    scene: PyReadonlyArray3<f64>,
    kinds: PyReadonlyArray1<u32>,
    count: usize,
) -> PyResult<Bound<'py, PyArray1<u32>>> {
    let (triangles, kinds) = (triangles(&scene)?, flat(&kinds)?);
    Ok(vector(py, py.detach(|| ::fmm::groups::group(triangles, kinds, count)).map_err(value_error)?))
}

/// Bisections of triangles (T, 3, 3) where other meshes meet them, as `Surface` takes them: edges (K,), fractions (K,),
/// parts (K, 2); and touched (T,), which ones another mesh touches at all.
#[pyfunction]
pub fn contacts<'py>(py: Python<'py>, scene: PyReadonlyArray3<f64>) -> PyResult<ContactArrays<'py>> {
    let triangles = triangles(&scene)?;
    let found = py.detach(|| ::fmm::contacts::contacts(triangles));
    let count = found.parts.len();
    let parts = PyArray1::from_vec(py, found.parts.into_flattened()).reshape([count, 2])?;
    Ok((vector(py, found.edges), vector(py, found.fractions), parts, vector(py, found.touched)))
}

/// The share of its place that each point (N, 3) has among triangles (T, 3, 3), their sides (T,) and whether they emit
/// (T,), as `coincident` of the core has them; emits (N,).
#[pyfunction]
pub fn coincident<'py>(
    py: Python<'py>,
    points: (PyReadonlyArray2<f64>, PyReadonlyArray2<f64>, PyReadonlyArray1<bool>),
    sheets: (PyReadonlyArray3<f64>, PyReadonlyArray1<bool>, PyReadonlyArray1<bool>),
    slack: f64,
) -> PyResult<Bound<'py, PyArray1<f64>>> {
    let (positions, normals) = (triples(&points.0, "points")?, triples(&points.1, "normals")?);
    let emits = flat(&points.2)?;
    let sheets = Sheets { triangles: triangles(&sheets.0)?, two_sided: flat(&sheets.1)?, emits: flat(&sheets.2)? };
    let found = py.detach(|| ::fmm::coincident::coincident(positions, normals, emits, sheets, slack));
    Ok(vector(py, found.map_err(value_error)?))
}
