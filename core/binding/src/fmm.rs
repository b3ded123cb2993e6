// SPDX-License-Identifier: GPL-3.0-or-later
//! The fast multipole method.

use crate::arrays::{Channels, channels, flat, table, triangles, triples, value_error, vector};
use crate::direct::NearField;
use crate::medium::Medium;
use ::fmm::cells::Cells;
use ::fmm::driver;
use ::fmm::driver_visibility::Occluded;
use ::fmm::expansion::{Compressed, Expansion, Paper, Whole};
use ::fmm::gather::Met;
use ::fmm::lists::ListsOptions;
use ::fmm::near_field::Patches;
use ::fmm::octree::{Grid, Grouping, Octree, OctreeOptions};
use ::fmm::portions::Portions;
use ::fmm::rays::{Frame, Rays};
use ::fmm::visibility::VisibilityOptions;
use numpy::{PyArray1, PyArray2, PyReadonlyArray1, PyReadonlyArray2, PyReadonlyArray3};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, PoisonError};

type Points<'py> = PyReadonlyArray2<'py, f64>;
/// Slots (R,), origins and directions (R, 3).
type RayArrays<'py> = (Bound<'py, PyArray1<u64>>, Bound<'py, PyArray2<f32>>, Bound<'py, PyArray2<f32>>);
/// Points (R,), origins and directions (R, 3).
type HemisphereArrays<'py> = (Bound<'py, PyArray1<u32>>, Bound<'py, PyArray2<f32>>, Bound<'py, PyArray2<f32>>);
/// The same with their places among the rays of their leaf (R,).
type MovedArrays<'py> =
    (Bound<'py, PyArray1<u32>>, Bound<'py, PyArray1<u32>>, Bound<'py, PyArray2<f32>>, Bound<'py, PyArray2<f32>>);
/// Lowest and highest corner of each box.
type Boxes = Vec<[[f64; 3]; 2]>;
type SeenArrays<'py> = (Bound<'py, PyArray1<bool>>, Bound<'py, PyArray1<bool>>);
/// Sources (R,), places and normals (R, 3).
type MetArrays<'py> = (Bound<'py, PyArray1<i64>>, Bound<'py, PyArray2<f64>>, Bound<'py, PyArray2<f64>>);
/// Irradiance, and the seconds of each pass.
type Timed<'py> = (Bound<'py, PyArray2<f64>>, driver::Seconds);

/// Octrees, lists and translations for fixed receivers and sources. Where these are a sample, `share` of the points,
/// the lists are those of the whole: the grouping is for the caller to reduce. `emitters` (N,) are in boxes of their own,
/// `scene` (T, 3, 3) are the triangles that may be in the way.
#[pyclass]
pub struct Fmm {
    driver: driver::Fmm,
}

#[pymethods]
impl Fmm {
    #[new]
    #[pyo3(signature = (
        sources, softening, targets, truncation, grouping, level, separation, expansion, share=1.0, emitters=None,
        scene=None, medium=None
    ))]
    #[allow(clippy::too_many_arguments)]
    fn new(
        py: Python,
        sources: (Points, Points),
        softening: PyReadonlyArray1<f64>,
        targets: Option<(Points, Points)>,
        truncation: usize,
        grouping: usize,
        level: Option<u8>,
        separation: u8,
        expansion: &str,
        share: f64,
        emitters: Option<PyReadonlyArray1<bool>>,
        scene: Option<PyReadonlyArray3<f64>>,
        medium: Option<&Medium>,
    ) -> PyResult<Self> {
        let medium = medium.map_or_else(::fmm::medium::Medium::default, |medium| medium.medium.clone());
        let grouping = level.map_or(Grouping::Adaptive { points: grouping }, |level| Grouping::Uniform { level });
        let options = OctreeOptions { grouping, by_normal: true };
        let (y, n_y) = (triples(&sources.0, "source points")?, triples(&sources.1, "source normals")?);
        let x = match &targets {
            Some((points, normals)) => Some((triples(points, "points")?, triples(normals, "normals")?)),
            None => None,
        };
        let softening = flat(&softening)?;
        let emitters = emitters.as_ref().map(flat).transpose()?.unwrap_or_default();
        let among = scene.as_ref().map(triangles).transpose()?.unwrap_or_default();
        let build = || -> Result<driver::Fmm, ::fmm::Error> {
            let grid = Grid::around(&[y, x.map_or(&[], |(points, _)| points)])?;
            let source_tree = Arc::new(Octree::with_emitters(y, Some(n_y), emitters, grid, options)?);
            let target_tree = match x {
                Some((points, normals)) => Arc::new(Octree::new(points, Some(normals), grid, options)?),
                None => source_tree.clone(),
            };
            let expansion = shared(expansion, truncation, separation);
            let lists = ListsOptions {
                separation: u32::from(separation),
                facing: true,
                grazing: driver::grazing(truncation),
                direct_points: (share * driver::direct_points(expansion.multipole_len()) as f64) as usize,
                direct_pairs: (share * share * driver::direct_pairs(expansion.multipole_len()) as f64) as usize,
            };
            driver::Fmm::among(expansion, target_tree, source_tree, softening, lists, (among, &medium))
        };
        Ok(Fmm { driver: py.detach(build).map_err(value_error)? })
    }

    /// Irradiance (M, C) at the targets from strengths (N, C), C being 1 or 3, and the seconds of each pass; `clear` as if
    /// nothing were absorbed.
    #[pyo3(signature = (strengths, clear=false))]
    fn apply<'py>(&self, py: Python<'py>, strengths: Points, clear: bool) -> PyResult<Timed<'py>> {
        match channels(&strengths)? {
            Channels::One(q) => {
                let (irradiance, seconds) = py.detach(|| self.driver.apply_through(q, clear)).map_err(value_error)?;
                Ok((table(py, irradiance)?, seconds))
            }
            Channels::Three(q) => {
                let (irradiance, seconds) = py.detach(|| self.driver.apply_through(q, clear)).map_err(value_error)?;
                Ok((table(py, irradiance)?, seconds))
            }
        }
    }

    /// What each source (N,) sends for one unit of strength to points of areas (N,), in a sum of points over themselves.
    fn sent<'py>(&self, py: Python<'py>, areas: PyReadonlyArray1<f64>) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let areas = flat(&areas)?;
        Ok(vector(py, py.detach(|| self.driver.sent(areas)).map_err(value_error)?))
    }

    /// How many of the triangles can be between points of the octrees: where any can, `occlude` makes the lists.
    fn n_blockers(&self) -> usize {
        self.driver.n_blockers()
    }

    /// Makes visible lists: areas, weights, reach, coarse and radii (N,) of the sources, their patches (P, 3, 3) with the
    /// rule (points_per_patch, 3), frame as (centre, scale, offset), effort as (share, angle, run_angle, part_angle, density),
    /// and the boxes that things may move in later.
    #[pyo3(signature = (sources, patches, frame, effort, moving=vec![]))]
    fn occlude(
        &mut self,
        py: Python,
        sources: [PyReadonlyArray1<f64>; 5],
        patches: (PyReadonlyArray3<f64>, Points),
        frame: ([f64; 3], f64, f64),
        effort: (f64, f64, f64, f64, usize),
        moving: Boxes,
    ) -> PyResult<()> {
        let (centre, scale, offset) = frame;
        let (share, angle, run_angle, part_angle, density) = effort;
        let options = VisibilityOptions { share, angle, run_angle, part_angle, density };
        let frame = Frame { centre, scale, offset };
        let [areas, weights, reach, coarse, radii] = &sources;
        let scene = Occluded {
            frame,
            areas: flat(areas)?,
            weights: flat(weights)?,
            reach: flat(reach)?,
            coarse: flat(coarse)?,
            radii: flat(radii)?,
            patches: triangles(&patches.0)?,
            rule: triples(&patches.1, "rule")?,
            moving: &moving,
        };
        py.detach(|| self.driver.occlude(&scene, options)).map_err(value_error)
    }

    /// The near patches of the targets, but for those that rays over hemispheres find.
    fn near_field(
        &self,
        py: Python,
        points: Points,
        normals: Points,
        patches: PyReadonlyArray3<f64>,
        reach: PyReadonlyArray1<f64>,
        rule: Points,
    ) -> PyResult<NearField> {
        let (points, normals) = (triples(&points, "points")?, triples(&normals, "normals")?);
        let portions = Portions::new(triples(&rule, "rule")?);
        let patches = Patches { triangles: triangles(&patches)?, reach: flat(&reach)?, portions: &portions };
        let near = py.detach(|| self.driver.near_field(points, normals, &patches));
        Ok(NearField { near: near.map_err(value_error)? })
    }

    /// Target leaves that want rays over the hemispheres of their points.
    fn open_leaves(&self) -> usize {
        self.driver.gather().leaves.len()
    }

    /// Rays over the hemispheres of the points of open leaves: points, origins, directions.
    fn gather_rays<'py>(&self, py: Python<'py>, start: usize, stop: usize) -> PyResult<HemisphereArrays<'py>> {
        let rays = py.detach(|| self.driver.gather_rays(start..stop));
        Ok((vector(py, rays.points), table(py, rays.origins)?, table(py, rays.directions)?))
    }

    /// Takes what these rays met: triangles (R,), -1 for none, and where on them, u and v (R,).
    #[allow(clippy::too_many_arguments)]
    fn take_hits(
        &self,
        py: Python,
        surface: &Surface,
        leaves: (usize, usize),
        points: PyReadonlyArray1<u32>,
        directions: PyReadonlyArray2<f32>,
        triangles: PyReadonlyArray1<i32>,
        u: PyReadonlyArray1<f32>,
        v: PyReadonlyArray1<f32>,
    ) -> PyResult<()> {
        let met = Met {
            points: flat(&points)?,
            places: &[],
            directions: triples(&directions, "directions")?,
            triangles: flat(&triangles)?,
            u: flat(&u)?,
            v: flat(&v)?,
        };
        py.detach(|| self.driver.take_hits(&surface.surface, leaves.0..leaves.1, &met)).map_err(value_error)
    }

    /// From now on things are in these boxes, and sources that stand for such areas (G,) follow those of the octree: the
    /// rays that pass there are to be traced again.
    fn move_to(&mut self, py: Python, boxes: Boxes, areas: PyReadonlyArray1<f64>) -> PyResult<()> {
        let areas = flat(&areas)?;
        py.detach(|| self.driver.move_to(&boxes, areas));
        Ok(())
    }

    /// The rays of links that pass where things have moved to; `block` takes their answers.
    fn moved_link_rays<'py>(&self, py: Python<'py>, start: usize, stop: usize) -> PyResult<RayArrays<'py>> {
        let rays = py.detach(|| self.driver.moved_link_rays(start..stop));
        Ok((vector(py, rays.slots), table(py, rays.origins)?, table(py, rays.directions)?))
    }

    /// Those of the rays over hemispheres: points, places, origins, directions.
    fn moved_gather_rays<'py>(&self, py: Python<'py>, start: usize, stop: usize) -> PyResult<MovedArrays<'py>> {
        let rays = py.detach(|| self.driver.moved_gather_rays(start..stop));
        let (points, places) = (vector(py, rays.points), vector(py, rays.places));
        Ok((points, places, table(py, rays.origins)?, table(py, rays.directions)?))
    }

    /// Takes what these met, as `take_hits`; which (points, places, directions) they are as `moved_gather_rays` has them.
    #[allow(clippy::too_many_arguments)]
    fn take_moved_hits(
        &self,
        py: Python,
        surface: &Surface,
        leaves: (usize, usize),
        rays: (PyReadonlyArray1<u32>, PyReadonlyArray1<u32>, PyReadonlyArray2<f32>),
        triangles: PyReadonlyArray1<i32>,
        u: PyReadonlyArray1<f32>,
        v: PyReadonlyArray1<f32>,
    ) -> PyResult<()> {
        let (points, places, directions) = &rays;
        let met = Met {
            points: flat(points)?,
            places: flat(places)?,
            directions: triples(directions, "directions")?,
            triangles: flat(&triangles)?,
            u: flat(&u)?,
            v: flat(&v)?,
        };
        py.detach(|| self.driver.take_moved_hits(&surface.surface, leaves.0..leaves.1, &met)).map_err(value_error)
    }

    /// Target leaves whose links want rays.
    fn linked_leaves(&self) -> usize {
        self.driver.links().leaves.len()
    }

    /// Pairs found valid, partial and invalid.
    fn outcomes(&self) -> (usize, usize, usize) {
        let outcomes = self.driver.outcomes();
        (outcomes.valid, outcomes.partial, outcomes.invalid)
    }

    /// Rays that fill the bits of links, in two rounds: the second wants the answers of the first.
    fn link_rays<'py>(&self, py: Python<'py>, start: usize, stop: usize, second: bool) -> PyResult<RayArrays<'py>> {
        let rays = py.detach(|| self.driver.link_rays(start..stop, second));
        Ok((vector(py, rays.slots), table(py, rays.origins)?, table(py, rays.directions)?))
    }

    /// Clears the bits of the link rays that did not arrive.
    fn block(&self, py: Python, slots: PyReadonlyArray1<u64>, occluded: PyReadonlyArray1<bool>) -> PyResult<()> {
        let (slots, occluded) = (flat(&slots)?, flat(&occluded)?);
        py.detach(|| self.driver.links().block(slots, occluded)).map_err(value_error)
    }

    /// Pairs the cells of the octrees, and returns the number of target cells; frame as (centre, scale, offset).
    fn find_cells(&mut self, py: Python, frame: ([f64; 3], f64, f64)) -> PyResult<usize> {
        let (centre, scale, offset) = frame;
        let frame = Frame { centre, scale, offset };
        py.detach(|| self.driver.find_cells(frame)).map_err(value_error)?;
        Ok(self.driver.cells().map_or(0, Cells::len))
    }

    /// Rays from some target cells.
    fn shoot<'py>(&self, py: Python<'py>, start: usize, stop: usize) -> PyResult<RayArrays<'py>> {
        let shoot = |cells: &Cells| cells.shoot(start..stop);
        let rays = py.detach(|| self.driver.cells().map_or_else(Rays::default, shoot));
        Ok((vector(py, rays.slots), table(py, rays.origins)?, table(py, rays.directions)?))
    }

    /// Which pairs of cells are visible, from the answers to all rays of a `shoot`.
    fn detect(&self, py: Python, slots: PyReadonlyArray1<u64>, occluded: PyReadonlyArray1<bool>) -> PyResult<()> {
        let (slots, occluded) = (flat(&slots)?, flat(&occluded)?);
        let detect = |cells: &Cells| cells.detect(slots, occluded);
        py.detach(|| self.driver.cells().map_or(Ok(()), detect)).map_err(value_error)
    }

    /// Reduces the lists to visible ones, once all pairs of cells are told.
    fn generate(&mut self, py: Python) {
        py.detach(|| self.driver.generate());
    }

    /// For each source of each near entry whether the sum has it, and whether no ray is needed to tell that what it stands
    /// for is seen.
    fn near_seen<'py>(&self, py: Python<'py>, near: &NearField, points_per_patch: usize) -> SeenArrays<'py> {
        let seen = py.detach(|| self.driver.near_seen(&near.near, points_per_patch));
        (vector(py, seen.counted), vector(py, seen.known))
    }

    /// Boxes, leaves, coefficients, and how much each pass has to do.
    fn counts<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let counts = PyDict::new(py);
        for (name, count) in self.driver.counts() {
            counts.set_item(name, count)?;
        }
        Ok(counts)
    }
}

/// The input triangles (T, 3, 3) with the tree of their bisections: edges (K,), fractions (K,), parts (K, 2), the barycentric
/// coordinates (points_per_patch, 3) of the sources on a patch, which sources (N,) something hides in their place, and
/// how far apart (scene units) surfaces in one place are at most.
#[pyclass(frozen)]
pub struct Surface {
    surface: ::fmm::surface::Surface,
}

#[pymethods]
impl Surface {
    #[new]
    fn new(
        py: Python,
        scene: PyReadonlyArray3<f64>,
        bisections: (PyReadonlyArray1<i8>, PyReadonlyArray1<f64>, PyReadonlyArray2<u32>),
        rule: Points,
        hidden: PyReadonlyArray1<bool>,
        slack: f64,
    ) -> PyResult<Self> {
        let (edges, fractions, parts) = bisections;
        let (halves, rest) = parts.as_slice().map_err(value_error)?.as_chunks::<2>();
        if parts.as_array().ncols() != 2 || !rest.is_empty() {
            return Err(value_error("parts: expected shape (K, 2)"));
        }
        let (scene, rule) = (triangles(&scene)?, triples(&rule, "rule")?);
        let (edges, fractions, hidden) = (flat(&edges)?, flat(&fractions)?, flat(&hidden)?);
        let build = || ::fmm::surface::Surface::new(scene, edges, fractions, halves, rule, hidden, slack);
        Ok(Surface { surface: py.detach(build).map_err(value_error)? })
    }

    /// The source (R,) that each ray meets, or -1, where (R, 3), and the unit normal (R, 3) of the side that it comes to:
    /// triangles (R,), -1 for none, where on them, and directions (R, 3).
    fn met<'py>(
        &self,
        py: Python<'py>,
        triangles: PyReadonlyArray1<i32>,
        u: PyReadonlyArray1<f32>,
        v: PyReadonlyArray1<f32>,
        directions: PyReadonlyArray2<f32>,
    ) -> PyResult<MetArrays<'py>> {
        let (triangles, u, v) = (flat(&triangles)?, flat(&u)?, flat(&v)?);
        let directions = triples(&directions, "directions")?;
        if [u.len(), v.len(), directions.len()] != [triangles.len(); 3] {
            return Err(value_error("met: triangles, u, v and directions differ in length"));
        }
        let (sources, (places, sides)): (Vec<_>, (Vec<_>, Vec<_>)) = py.detach(|| {
            let ray = |i: usize| {
                let (triangle, at) = (triangles[i], (u[i], v[i]));
                let source = self.surface.met(triangle, at, directions[i]).map_or(-1, i64::from);
                let side = self.surface.side(triangle, directions[i]).unwrap_or_default();
                (source, (self.surface.place(triangle, at).unwrap_or_default(), side))
            };
            (0..triangles.len()).map(ray).unzip()
        });
        Ok((vector(py, sources), table(py, places)?, table(py, sides)?))
    }
}

/// Scene numbers (N,) of points in the order of an octree: any run of them lies close together.
#[pyfunction]
pub fn tree_order<'py>(py: Python<'py>, points: Points, normals: Points) -> PyResult<Bound<'py, PyArray1<u32>>> {
    let (points, normals) = (triples(&points, "points")?, triples(&normals, "normals")?);
    let options = OctreeOptions { grouping: Grouping::Uniform { level: 0 }, by_normal: true };
    let build = || Octree::new(points, Some(normals), Grid::around(&[points])?, options);
    Ok(vector(py, py.detach(build).map_err(value_error)?.to_scene))
}

/// Expansions by name, truncation and separation.
type Known = BTreeMap<(String, usize, u8), Arc<dyn Expansion>>;

/// Expansions depend on nothing but these three, so that each is set up once a process.
fn shared(expansion: &str, truncation: usize, separation: u8) -> Arc<dyn Expansion> {
    static KNOWN: Mutex<Known> = Mutex::new(BTreeMap::new());
    let mut known = KNOWN.lock().unwrap_or_else(PoisonError::into_inner);
    let make = || -> Arc<dyn Expansion> {
        match expansion {
            "paper" => Arc::new(Paper::new(truncation)),
            "compressed" => Arc::new(Compressed::new(truncation, separation)),
            _ => Arc::new(Whole::new(truncation)),
        }
    };
    known.entry((expansion.to_owned(), truncation, separation)).or_insert_with(make).clone()
}

/// The paper's bound on the error of one multipole expansion (section 2.2).
#[pyfunction]
pub fn error_bound(truncation: usize, strength: f64, source_radius: f64, receiver_distance: f64) -> f64 {
    ::fmm::expansion::error_bound(truncation, strength, source_radius, receiver_distance)
}

/// Uses at most so many threads; false where it comes too late.
#[pyfunction]
pub fn limit_threads(count: usize) -> bool {
    ::fmm::threads::limit(count)
}
