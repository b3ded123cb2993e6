// SPDX-License-Identifier: GPL-3.0-or-later
//! Directions and ends of random rays.

use crate::arrays::{flat, table, triangles, triples, value_error, vector};
use ::fmm::samples::{Aiming, Targets};
use numpy::{PyArray1, PyArray2, PyReadonlyArray1, PyReadonlyArray2, PyReadonlyArray3};
use pyo3::prelude::*;

type Points<'py> = PyReadonlyArray2<'py, f64>;
/// Points (K, 3), and the share (K,) that each counts with.
type Ends<'py> = (Bound<'py, PyArray2<f64>>, Bound<'py, PyArray1<f64>>);

/// Unit vectors (K, 3) about unit axes (M, 3), of cosines with them and angles about them (K,), as many for each axis.
#[pyfunction]
pub fn around<'py>(
    py: Python<'py>,
    axes: Points,
    cosines: PyReadonlyArray1<f64>,
    angles: PyReadonlyArray1<f64>,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let (axes, cosines, angles) = (triples(&axes, "axes")?, flat(&cosines)?, flat(&angles)?);
    table(py, py.detach(|| ::fmm::samples::around(axes, cosines, angles)).map_err(value_error)?)
}

/// Random points (K, 3) of targets (K,) among triangles (E, 3, 3) with unit normals (E, 3), and the share (K,) that each
/// counts with, as `aim` of the core has it: from points with unit normals (K, 3), by densities (K,), numbers (K, 2).
#[pyfunction]
pub fn aim<'py>(
    py: Python<'py>,
    at: (PyReadonlyArray3<f64>, Points),
    from: (Points, Points, PyReadonlyArray1<u32>, PyReadonlyArray1<f64>),
    numbers: PyReadonlyArray2<f64>,
) -> PyResult<Ends<'py>> {
    let at = Targets { triangles: triangles(&at.0)?, normals: triples(&at.1, "target normals")? };
    let (points, normals) = (triples(&from.0, "points")?, triples(&from.1, "normals")?);
    let from = Aiming { points, normals, targets: flat(&from.2)?, densities: flat(&from.3)? };
    if numbers.as_array().ncols() != 2 {
        return Err(value_error("numbers: expected shape (K, 2)"));
    }
    let numbers = numbers.as_slice().map_err(value_error)?.as_chunks::<2>().0;
    let found = py.detach(|| ::fmm::samples::aim(at, from, numbers)).map_err(value_error)?;
    let (ends, shares): (Vec<_>, Vec<_>) = found.into_iter().unzip();
    Ok((table(py, ends)?, vector(py, shares)))
}
