// SPDX-License-Identifier: GPL-3.0-or-later
//! The direct sum, near patches and rays.

use crate::arrays::{Channels, channels, flat, table, triangles, triples, value_error, vector};
use crate::medium::Medium;
use fmm::near_field::{Patches, PointSources, Seen};
use fmm::portions::Portions;
use fmm::rays::{FacingRays, Frame, Oriented};
use numpy::{PyArray1, PyArray2, PyReadonlyArray1, PyReadonlyArray2, PyReadonlyArray3, PyReadwriteArray1};
use pyo3::prelude::*;

type Points<'py> = PyReadonlyArray2<'py, f64>;
type EndArrays<'py> = (Bound<'py, PyArray2<f32>>, Bound<'py, PyArray2<f32>>);
type Rays<'py> = (Bound<'py, PyArray1<u64>>, Bound<'py, PyArray2<f32>>, Bound<'py, PyArray2<f32>>);

/// Point sources of the direct sum.
#[pyclass(frozen)]
pub struct Sources {
    sources: fmm::direct::Sources,
    positions: Vec<[f64; 3]>,
    normals: Vec<[f64; 3]>,
    softening: Vec<f64>,
    areas: Vec<f64>,
    shares: Vec<f64>,
    medium: fmm::medium::Medium,
}

#[pymethods]
impl Sources {
    #[new]
    #[pyo3(signature = (positions, normals, softening, areas, shares, medium=None))]
    fn new(
        positions: Points,
        normals: Points,
        softening: PyReadonlyArray1<f64>,
        areas: PyReadonlyArray1<f64>,
        shares: PyReadonlyArray1<f64>,
        medium: Option<&Medium>,
    ) -> PyResult<Self> {
        let medium = medium.map_or_else(fmm::medium::Medium::default, |medium| medium.medium.clone());
        let (positions, normals) = (triples(&positions, "positions")?, triples(&normals, "normals")?);
        let softening = flat(&softening)?;
        Ok(Sources {
            sources: fmm::direct::Sources::new(positions, normals, softening)
                .map_err(value_error)?
                .within(medium.clone()),
            positions: positions.to_vec(),
            normals: normals.to_vec(),
            softening: softening.to_vec(),
            areas: flat(&areas)?.to_vec(),
            shares: flat(&shares)?.to_vec(),
            medium,
        })
    }

    fn __len__(&self) -> usize {
        self.sources.len()
    }

    /// 64-bit words in a receiver's row of visibility bits.
    #[getter]
    fn words(&self) -> usize {
        self.sources.words()
    }

    /// Irradiance (M, C) from strengths (N, C), C being 1 or 3; `clear` as if nothing were absorbed.
    #[pyo3(signature = (points, normals, strengths, visible=None, clear=false))]
    fn irradiance<'py>(
        &self,
        py: Python<'py>,
        points: Points,
        normals: Points,
        strengths: Points,
        visible: Option<PyReadonlyArray1<u64>>,
        clear: bool,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let receivers = (triples(&points, "points")?, triples(&normals, "normals")?);
        let bits = visible.as_ref().map(flat).transpose()?;
        match channels(&strengths)? {
            Channels::One(q) => self.sum(py, receivers, q, bits, clear),
            Channels::Three(q) => self.sum(py, receivers, q, bits, clear),
        }
    }
}

impl Sources {
    fn sum<'py, const C: usize>(
        &self,
        py: Python<'py>,
        (points, normals): (&[[f64; 3]], &[[f64; 3]]),
        strengths: &[[f64; C]],
        visible: Option<&[u64]>,
        clear: bool,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let cleared =
            (clear && !self.medium.is_clear()).then(|| self.sources.clone().within(fmm::medium::Medium::default()));
        let sources = cleared.as_ref().unwrap_or(&self.sources);
        table(py, py.detach(|| sources.irradiance(points, normals, strengths, visible)).map_err(value_error)?)
    }

    fn oriented(&self) -> Oriented<'_> {
        Oriented { points: &self.positions, normals: &self.normals }
    }
}

/// Patches near each receiver, with exact form factors.
#[pyclass(frozen)]
pub struct NearField {
    pub(crate) near: fmm::near_field::NearField,
}

#[pymethods]
impl NearField {
    #[new]
    fn new(
        py: Python,
        points: Points,
        normals: Points,
        patches: PyReadonlyArray3<f64>,
        reach: PyReadonlyArray1<f64>,
        rule: Points,
    ) -> PyResult<Self> {
        let (points, normals) = (triples(&points, "points")?, triples(&normals, "normals")?);
        let portions = Portions::new(triples(&rule, "rule")?);
        let patches = Patches { triangles: triangles(&patches)?, reach: flat(&reach)?, portions: &portions };
        let near = py.detach(|| fmm::near_field::NearField::new(points, normals, &patches)).map_err(value_error)?;
        Ok(NearField { near })
    }

    fn __len__(&self) -> usize {
        self.near.patches.len()
    }

    /// (M + 1) first entry of each receiver.
    fn starts<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<usize>> {
        vector(py, self.near.starts.clone())
    }

    /// (K) patch of each entry.
    fn patches<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<u32>> {
        vector(py, self.near.patches.clone())
    }

    /// (K * points_per_patch) exact form factor to what each point stands for, without occlusion.
    fn form_factors<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        vector(py, self.near.form_factors.clone())
    }

    /// (K * points_per_patch, 3) where rays from the receiver should end.
    fn targets<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        table(py, self.near.targets.clone())
    }
}

/// Sparse matrix that turns the point kernel of near patches into exact form factors.
#[pyclass(frozen)]
pub struct Correction {
    correction: fmm::near_field::Correction,
}

#[pymethods]
impl Correction {
    #[new]
    #[pyo3(signature = (near, points, normals, sources, fractions, visible=None, counted=None))]
    #[allow(clippy::too_many_arguments)]
    fn new(
        py: Python,
        near: &NearField,
        points: Points,
        normals: Points,
        sources: &Sources,
        fractions: PyReadonlyArray1<f64>,
        visible: Option<PyReadonlyArray1<u64>>,
        counted: Option<(PyReadonlyArray1<bool>, PyReadonlyArray1<bool>)>,
    ) -> PyResult<Self> {
        let (points, normals) = (triples(&points, "points")?, triples(&normals, "normals")?);
        let fractions = flat(&fractions)?;
        let seen = match (&visible, &counted) {
            (Some(bits), _) => Seen::Bits(flat(bits)?),
            (None, Some((counted, known))) => Seen::Entries(flat(counted)?, flat(known)?),
            (None, None) => Seen::All,
        };
        let of = PointSources {
            positions: &sources.positions,
            normals: &sources.normals,
            softening: &sources.softening,
            shares: &sources.shares,
            areas: &sources.areas,
            medium: &sources.medium,
        };
        let build = || fmm::near_field::Correction::new(&near.near, points, normals, &of, fractions, seen);
        Ok(Correction { correction: py.detach(build).map_err(value_error)? })
    }

    fn __len__(&self) -> usize {
        self.correction.len()
    }

    /// Adds the correction for strengths (N, C) to irradiance (M, C) in place, C being 1 or 3; `clear` as if nothing were
    /// absorbed.
    #[pyo3(signature = (strengths, irradiance, clear=false))]
    fn add(
        &self,
        py: Python,
        strengths: Points,
        mut irradiance: numpy::PyReadwriteArray2<f64>,
        clear: bool,
    ) -> PyResult<()> {
        let out = irradiance.as_slice_mut().map_err(value_error)?;
        let added = match channels(&strengths)? {
            Channels::One(q) => py.detach(|| self.correction.add(q, clear, out.as_chunks_mut().0)),
            Channels::Three(q) => py.detach(|| self.correction.add(q, clear, out.as_chunks_mut().0)),
        };
        added.map_err(value_error)
    }

    /// What each source (N,) sends by the correction for one unit of strength to receivers of areas (M,).
    fn sent<'py>(&self, py: Python<'py>, areas: PyReadonlyArray1<f64>) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let areas = flat(&areas)?;
        Ok(vector(py, py.detach(|| self.correction.sent(areas)).map_err(value_error)?))
    }
}

/// Rays from a block of receivers to every source that faces them: pairs, origins, directions.
#[pyfunction]
#[pyo3(signature = (points, normals, sources, after, centre, scale, offset))]
#[allow(clippy::too_many_arguments)]
pub fn facing_rays<'py>(
    py: Python<'py>,
    points: Points,
    normals: Points,
    sources: &Sources,
    after: Option<usize>,
    centre: [f64; 3],
    scale: f64,
    offset: f64,
) -> PyResult<Rays<'py>> {
    let receivers = Oriented { points: triples(&points, "points")?, normals: triples(&normals, "normals")? };
    let frame = Frame { centre, scale, offset };
    let rays = py.detach(|| FacingRays::new(receivers, sources.oriented(), after, &frame)).map_err(value_error)?;
    Ok((vector(py, rays.pairs), table(py, rays.origins)?, table(py, rays.directions)?))
}

/// Origins and directions (K, 3) of rays from points with unit normals to as many targets with theirs, (K, 3) each, in a
/// frame of centre, scale and offset.
#[pyfunction]
pub fn rays_between<'py>(
    py: Python<'py>,
    from: (Points, Points),
    to: (Points, Points),
    frame: ([f64; 3], f64, f64),
) -> PyResult<EndArrays<'py>> {
    let (centre, scale, offset) = frame;
    let frame = Frame { centre, scale, offset };
    let from = Oriented { points: triples(&from.0, "points")?, normals: triples(&from.1, "normals")? };
    let to = Oriented { points: triples(&to.0, "targets")?, normals: triples(&to.1, "target normals")? };
    let (origins, directions) = py.detach(|| frame.rays(from, to)).map_err(value_error)?.into_iter().unzip();
    Ok((table(py, origins)?, table(py, directions)?))
}

/// Sets the bits of the pairs that are not occluded, in place.
#[pyfunction]
pub fn mark_visible(
    py: Python,
    mut bits: PyReadwriteArray1<u64>,
    count: usize,
    pairs: PyReadonlyArray1<u64>,
    occluded: PyReadonlyArray1<bool>,
) -> PyResult<()> {
    let bits = bits.as_slice_mut().map_err(value_error)?;
    let (pairs, occluded) = (flat(&pairs)?, flat(&occluded)?);
    py.detach(|| fmm::rays::mark_visible(bits, count, pairs, occluded)).map_err(value_error)
}

/// Copies the upper triangle of a square bit matrix to the lower one, in place.
#[pyfunction]
pub fn symmetrise(py: Python, mut bits: PyReadwriteArray1<u64>, count: usize) -> PyResult<()> {
    let bits = bits.as_slice_mut().map_err(value_error)?;
    py.detach(|| fmm::rays::symmetrise(bits, count)).map_err(value_error)
}
