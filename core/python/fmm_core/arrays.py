# SPDX-License-Identifier: GPL-3.0-or-later
"""Callers' arrays, checked."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .errors import Error

#: Lengths closer than this share of themselves count as equal: grids have many such, and rounding must not choose.
ROUNDING = 1e-9
#: Beyond this the squares and products of coordinates overflow.
LARGEST = 1e60


def numbers(name: str, values: ArrayLike) -> NDArray[np.float64]:
    """A C-contiguous float64 copy, subnormal numbers being 0; raises `Error` on anything that is not real numbers."""
    try:
        array = np.array(values)
        if array.dtype.kind not in "biuf":
            raise TypeError(f"got {array.dtype}")
    except (TypeError, ValueError) as error:
        raise Error(f"{name}: expected numbers, {error}") from None
    found = np.array(array, dtype=np.float64, order="C")
    # One divided by what is even smaller is infinite.
    found[np.abs(found) < np.finfo(float).tiny] = 0.0
    return found


def finite_rows(name: str, values: ArrayLike) -> NDArray[np.float64]:
    """(N, 3) finite numbers."""
    array = numbers(name, values)
    if array.size == 0 and array.ndim < 2:
        array = array.reshape(0, 3)
    if array.ndim != 2 or array.shape[1] != 3:
        raise Error(f"{name}: expected shape (N, 3), got {array.shape}")
    # Short rows are slow to look at one by one.
    if not np.isfinite(array).all():
        wrong = np.flatnonzero(~np.isfinite(array).all(axis=1))
        raise Error(f"{name}: row {wrong[0]} is {array[wrong[0]].tolist()}")
    return array


def unit_rows(name: str, values: ArrayLike) -> NDArray[np.float64]:
    """(N, 3) directions, made unit length."""
    array = finite_rows(name, values)
    # Scaling first keeps the squares of very large and very small components in range.
    scale = largest(np.abs(array))
    zero = np.flatnonzero(scale == 0)
    if len(zero):
        raise Error(f"{name}: row {zero[0]} has no direction")
    array /= scale[:, None]
    return array / lengths(array)[:, None]


def lengths(vectors: NDArray[np.floating]) -> NDArray[np.floating]:
    """(...) of vectors (..., 3)."""
    return np.sqrt(np.einsum("...i,...i", vectors, vectors))


def weighed(weights: NDArray[np.floating], rows: NDArray[np.floating]) -> NDArray[np.floating]:
    """(...) the sum of rows (K, ...) times their weights (K,), and not by BLAS: its threads go on turning for a while,
    and keep the cores from others.
    """
    return np.einsum("k,k...->...", weights, rows)


def largest(values: NDArray[np.floating]) -> NDArray[np.floating]:
    """(N,) of each row (N, K) of few numbers, one by one of which numpy is slow."""
    return np.maximum.reduce(list(values.T))


def centroids(triangles: NDArray[np.floating]) -> NDArray[np.floating]:
    """(T, 3) of triangles (T, 3, 3)."""
    return (triangles[:, 0] + triangles[:, 1] + triangles[:, 2]) / 3


def bounds(triangles: NDArray[np.floating]) -> tuple[NDArray[np.floating], NDArray[np.floating]]:
    """(3,) each: the lowest and the highest coordinates of triangles (T, 3, 3)."""
    rows = triangles.reshape(-1, 9)
    return rows.min(axis=0).reshape(3, 3).min(axis=0), rows.max(axis=0).reshape(3, 3).max(axis=0)
