// SPDX-License-Identifier: GPL-3.0-or-later
//! What absorbs light on its way.

use crate::arrays::{flat, table, triangles, triples, value_error};
use numpy::{PyArray2, PyReadonlyArray1, PyReadonlyArray2, PyReadonlyArray3};
use pyo3::prelude::*;

/// Absorption of each colour that is everywhere, and inside of closed meshes.
#[pyclass(frozen, module = "fmm_core._binding")]
pub struct Medium {
    pub medium: fmm::medium::Medium,
}

#[pymethods]
impl Medium {
    /// volumes: closed meshes (T, 3, 3), counter-clockwise from outside, each with its absorption.
    #[new]
    fn new(absorption: [f64; 3], volumes: Vec<(PyReadonlyArray3<f64>, [f64; 3])>) -> PyResult<Self> {
        let volumes =
            volumes.iter().map(|(mesh, sigma)| Ok((triangles(mesh)?, *sigma))).collect::<PyResult<Vec<_>>>()?;
        let medium = fmm::medium::Medium::new(absorption).and_then(|medium| medium.with(&volumes));
        Ok(Self { medium: medium.map_err(value_error)? })
    }

    /// Whether it lets all light through.
    #[getter]
    fn is_clear(&self) -> bool {
        self.medium.is_clear()
    }

    /// Shares (K, 3) that are left of light from points (K, 3) along unit directions (K, 3), so far (K,).
    fn left<'py>(
        &self,
        py: Python<'py>,
        points: PyReadonlyArray2<f64>,
        directions: PyReadonlyArray2<f64>,
        distances: PyReadonlyArray1<f64>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let (points, directions) = (triples(&points, "points")?, triples(&directions, "directions")?);
        let distances = flat(&distances)?;
        let ways = points.iter().zip(directions).zip(distances);
        let left = ways.map(|((&x, &d), &distance)| self.medium.left_along::<3>(x, d, distance));
        table(py, py.detach(|| left.collect()))
    }
}
