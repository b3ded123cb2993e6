// SPDX-License-Identifier: GPL-3.0-or-later
//! numpy arrays as Rust slices and back.

use numpy::{Element, PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2, PyReadonlyArray3};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

/// Any error of the core as Python's `ValueError`.
pub fn value_error(error: impl ToString) -> PyErr {
    PyValueError::new_err(error.to_string())
}

pub fn flat<'a, T: Element>(array: &'a PyReadonlyArray1<'_, T>) -> PyResult<&'a [T]> {
    array.as_slice().map_err(value_error)
}

/// A C-contiguous (N, 3) array as N triples.
pub fn triples<'a, T: Element>(array: &'a PyReadonlyArray2<'_, T>, what: &str) -> PyResult<&'a [[T; 3]]> {
    let (rows, rest) = array.as_slice().map_err(value_error)?.as_chunks::<3>();
    if array.as_array().ncols() != 3 || !rest.is_empty() {
        return Err(value_error(format!("{what}: expected shape (N, 3)")));
    }
    Ok(rows)
}

/// What is summed in one channel, where all of it is grey, or in three.
pub enum Channels<'a> {
    One(&'a [[f64; 1]]),
    Three(&'a [[f64; 3]]),
}

/// C-contiguous strengths (N, 1) or (N, 3).
pub fn channels<'a>(strengths: &'a PyReadonlyArray2<'_, f64>) -> PyResult<Channels<'a>> {
    let values = strengths.as_slice().map_err(value_error)?;
    match strengths.as_array().ncols() {
        1 => Ok(Channels::One(values.as_chunks().0)),
        3 => Ok(Channels::Three(values.as_chunks().0)),
        _ => Err(value_error("strengths: expected shape (N, 1) or (N, 3)")),
    }
}

/// A C-contiguous (N, 3, 3) array as N triangles.
pub fn triangles<'a>(array: &'a PyReadonlyArray3<'_, f64>) -> PyResult<&'a [[[f64; 3]; 3]]> {
    if array.as_array().shape()[1..] != [3, 3] {
        return Err(value_error("triangles: expected shape (N, 3, 3)"));
    }
    let (corners, _) = array.as_slice().map_err(value_error)?.as_chunks::<3>();
    Ok(corners.as_chunks::<3>().0)
}

pub fn vector<'py, T: Element>(py: Python<'py>, values: Vec<T>) -> Bound<'py, PyArray1<T>> {
    PyArray1::from_vec(py, values)
}

/// N rows as an (N, C) array.
pub fn table<'py, T: Element, const C: usize>(py: Python<'py>, rows: Vec<[T; C]>) -> PyResult<Bound<'py, PyArray2<T>>> {
    let count = rows.len();
    PyArray1::from_vec(py, rows.into_flattened()).reshape([count, C])
}
