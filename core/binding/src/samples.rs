// SPDX-License-Identifier: GPL-3.0-or-later
//! Directions and ends of random rays.

use crate::arrays::{flat, table, triangles, triples, value_error, vector};
use ::fmm::emitters::{Choosing, Met, Patches};
use ::fmm::rays::Frame;
use numpy::{PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2, PyReadonlyArray3};
use pyo3::prelude::*;

type Points<'py> = PyReadonlyArray2<'py, f64>;
/// Points (R,), origins, directions and light (R, 3).
type AimedArrays<'py> =
    (Bound<'py, PyArray1<u32>>, Bound<'py, PyArray2<f32>>, Bound<'py, PyArray2<f32>>, Bound<'py, PyArray2<f64>>);

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

/// The points (K, 3) with unit normals (K, 3) that choose emitters, their rows (K,) of the choice, and that (M, E).
type ChoosingArrays<'py> = (Points<'py>, Points<'py>, PyReadonlyArray1<'py, u32>, Points<'py>);

fn choosing<'a>(arrays: &'a ChoosingArrays) -> PyResult<Choosing<'a>> {
    let (points, normals, rows, ends) = arrays;
    Ok(Choosing {
        points: triples(points, "points")?,
        normals: triples(normals, "normals")?,
        rows: flat(rows)?,
        ends: ends.as_slice().map_err(value_error)?,
    })
}

/// Patches that emit strongly: triangles (E, 3, 3), unit normals (E, 3), areas and radii (E,); emission (E, 3) and opacity
/// (E,), and which of them each source (N,) is on, 2^32 - 1 for none.
///
/// How points choose among them is told by the ends of their shares, added up (M, E).
#[pyclass(frozen)]
pub struct Emitters {
    emitters: ::fmm::emitters::Emitters,
    count: usize,
}

#[pymethods]
impl Emitters {
    #[new]
    fn new(
        patches: (PyReadonlyArray3<f64>, Points, PyReadonlyArray1<f64>, PyReadonlyArray1<f64>),
        emission: Points,
        opacity: PyReadonlyArray1<f64>,
        numbers: PyReadonlyArray1<u32>,
    ) -> PyResult<Self> {
        let (corners, normals, areas, radii) = patches;
        let patches = Patches {
            triangles: triangles(&corners)?.to_vec(),
            normals: triples(&normals, "normals")?.to_vec(),
            areas: flat(&areas)?.to_vec(),
            radii: flat(&radii)?.to_vec(),
        };
        let count = patches.triangles.len();
        let (emission, opacity) = (triples(&emission, "emission")?.to_vec(), flat(&opacity)?.to_vec());
        let emitters = ::fmm::emitters::Emitters::new(patches, emission, opacity, flat(&numbers)?.to_vec());
        Ok(Self { emitters: emitters.map_err(value_error)?, count })
    }

    fn __len__(&self) -> usize {
        self.count
    }

    /// The choice (1, E) by power, of all points alike.
    fn anywhere<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        PyArray1::from_vec(py, self.emitters.anywhere()).reshape([1, self.count])
    }

    /// The choice (M, E) by what arrives at points with unit normals (M, 3) where nothing is in the way; without normals,
    /// at places near them.
    fn around<'py>(
        &self,
        py: Python<'py>,
        points: Points<'py>,
        normals: Option<Points<'py>>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let points = triples(&points, "points")?;
        let normals = normals.as_ref().map(|normals| triples(normals, "normals")).transpose()?;
        let ends = py.detach(|| self.emitters.around(points, normals)).map_err(value_error)?;
        PyArray1::from_vec(py, ends).reshape([points.len(), self.count])
    }

    /// Radiosity (K, C) that rays even by cosine from the points find, by that (N, C) of the sources, without the share
    /// of what aimed rays find in the first three columns: they have met sources (K,), -1 for none, at places (K, 3)
    /// of sides with unit normals (K, 3).
    fn met<'py>(
        &self,
        py: Python<'py>,
        start: ChoosingArrays<'py>,
        met: (PyReadonlyArray1<'py, i64>, Points<'py>, Points<'py>),
        radiosity: PyReadonlyArray2<'py, f64>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let from = choosing(&start)?;
        let (places, normals) = (triples(&met.1, "places")?, triples(&met.2, "sides")?);
        let met = Met { sources: flat(&met.0)?, places, normals };
        let width = radiosity.as_array().ncols();
        let radiosity = radiosity.as_slice().map_err(value_error)?;
        let found = py.detach(|| self.emitters.met(from, met, radiosity, width)).map_err(value_error)?;
        PyArray1::from_vec(py, found).reshape([from.points.len(), width])
    }

    /// Rays from the points to places chosen by numbers (K, 3) even in [0, 1), where they can bring light: the points
    /// (R,), origins and directions (R, 3) in a frame of centre, scale and offset, and the light (R, 3).
    fn aim<'py>(
        &self,
        py: Python<'py>,
        start: ChoosingArrays<'py>,
        numbers: Points<'py>,
        frame: ([f64; 3], f64, f64),
    ) -> PyResult<AimedArrays<'py>> {
        let from = choosing(&start)?;
        let numbers = triples(&numbers, "numbers")?;
        let (centre, scale, offset) = frame;
        let frame = Frame { centre, scale, offset };
        let found = py.detach(|| self.emitters.aim(from, numbers, &frame)).map_err(value_error)?;
        let points = vector(py, found.iter().map(|aimed| aimed.point).collect());
        let (origins, directions) = found.iter().map(|aimed| aimed.ends).unzip();
        let light = table(py, found.iter().map(|aimed| aimed.light).collect())?;
        Ok((points, table(py, origins)?, table(py, directions)?, light))
    }
}
