# SPDX-License-Identifier: GPL-3.0-or-later
"""Rooms and solids: which meshes are seen from both sides."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Shape:
    """What tells a room from a solid: position (V,3) m of the vertices, the number of triangles, whether closed."""

    position: np.ndarray
    triangles: int
    closed: bool


def two_sided(shapes: Sequence[Shape]) -> np.ndarray:
    """(T,) bool for the triangles of all shapes: open ones, and closed ones that something else lies inside of.

    A closed mesh with something in its bounding box may be a room, whose normals can point either way.
    """
    low = np.array([shape.position.min(axis=0) for shape in shapes])
    high = np.array([shape.position.max(axis=0) for shape in shapes])
    # Contact is no overlap, whatever the rounding.
    margin = 1e-5 * (high - low).max(axis=1, keepdims=True)
    inner_low, inner_high = low + margin, high - margin
    flags = [not shape.closed for shape in shapes]
    for i in np.flatnonzero([shape.closed for shape in shapes]):
        near = ((low < inner_high[i]) & (high > inner_low[i])).all(axis=1)
        near[i] = False
        flags[i] = any(_any_inside(shapes[j].position, inner_low[i], inner_high[i]) for j in np.flatnonzero(near))
    return np.repeat(flags, [shape.triangles for shape in shapes])


def _any_inside(points: np.ndarray, low: np.ndarray, high: np.ndarray) -> bool:
    return bool(((points > low) & (points < high)).all(axis=1).any())
