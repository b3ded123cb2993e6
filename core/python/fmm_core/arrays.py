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
    """A C-contiguous float64 copy; raises `Error` on anything that is not real numbers."""
    try:
        array = np.array(values)
        if array.dtype.kind not in "biuf":
            raise TypeError(f"got {array.dtype}")
    except (TypeError, ValueError) as error:
        raise Error(f"{name}: expected numbers, {error}") from None
    return np.array(array, dtype=np.float64, order="C")


def finite_rows(name: str, values: ArrayLike) -> NDArray[np.float64]:
    """(N, 3) finite numbers."""
    array = numbers(name, values)
    if array.size == 0 and array.ndim < 2:
        array = array.reshape(0, 3)
    if array.ndim != 2 or array.shape[1] != 3:
        raise Error(f"{name}: expected shape (N, 3), got {array.shape}")
    wrong = np.flatnonzero(~np.isfinite(array).all(axis=1))
    if len(wrong):
        raise Error(f"{name}: row {wrong[0]} is {array[wrong[0]].tolist()}")
    return array


def unit_rows(name: str, values: ArrayLike) -> NDArray[np.float64]:
    """(N, 3) directions, made unit length."""
    array = finite_rows(name, values)
    # Scaling first keeps the squares of very large and very small components in range.
    largest = np.abs(array).max(axis=1, keepdims=True, initial=0.0)
    zero = np.flatnonzero(largest[:, 0] == 0)
    if len(zero):
        raise Error(f"{name}: row {zero[0]} has no direction")
    array /= largest
    return array / np.linalg.norm(array, axis=1, keepdims=True)
