// SPDX-License-Identifier: GPL-3.0-or-later
//! Python binding: checks arrays, releases the interpreter lock, turns errors into `ValueError`.

mod arrays;
mod direct;
mod fmm;
mod geometry;
mod medium;
mod samples;

use pyo3::prelude::*;

#[pymodule]
fn _binding(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<direct::Sources>()?;
    module.add_class::<direct::NearField>()?;
    module.add_class::<direct::Correction>()?;
    module.add_class::<medium::Medium>()?;
    module.add_class::<fmm::Fmm>()?;
    module.add_class::<fmm::Surface>()?;
    module.add_class::<samples::Emitters>()?;
    module.add_function(wrap_pyfunction!(fmm::error_bound, module)?)?;
    module.add_function(wrap_pyfunction!(fmm::tree_order, module)?)?;
    module.add_function(wrap_pyfunction!(geometry::group, module)?)?;
    module.add_function(wrap_pyfunction!(geometry::coincident, module)?)?;
    module.add_function(wrap_pyfunction!(geometry::contacts, module)?)?;
    module.add_function(wrap_pyfunction!(fmm::limit_threads, module)?)?;
    module.add_function(wrap_pyfunction!(geometry::is_sealed, module)?)?;
    module.add_function(wrap_pyfunction!(geometry::inward, module)?)?;
    module.add_function(wrap_pyfunction!(geometry::planes, module)?)?;
    module.add_function(wrap_pyfunction!(geometry::volume, module)?)?;
    module.add_function(wrap_pyfunction!(direct::facing_rays, module)?)?;
    module.add_function(wrap_pyfunction!(direct::rays_between, module)?)?;
    module.add_function(wrap_pyfunction!(direct::mark_visible, module)?)?;
    module.add_function(wrap_pyfunction!(direct::symmetrise, module)?)?;
    module.add_function(wrap_pyfunction!(samples::around, module)?)?;
    Ok(())
}
