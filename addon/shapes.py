# SPDX-License-Identifier: GPL-3.0-or-later
"""Rooms and solids: which meshes are seen from both sides."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from fmm_core import inward

from .meshes import Mesh, is_closed


@dataclass(frozen=True)
class Shape:
    """What tells a room from a solid: a mesh, position (V,3) m of its vertices, whether that is a mirror image of it,
    and its number of triangles.
    """

    mesh: Mesh
    position: np.ndarray
    mirrored: bool
    triangles: int


def two_sided(shapes: Sequence[Shape]) -> np.ndarray:
    """(T,) bool for the triangles of all shapes: open ones, and closed ones whose backs something else sees.

    A closed mesh with something in its bounding box may be a room, whose normals can point either way; one that faces
    inwards and does not hold all there is shows its back to what is outside.
    """
    low = np.array([shape.position.min(axis=0) for shape in shapes])
    high = np.array([shape.position.max(axis=0) for shape in shapes])
    # Contact is no overlap, whatever the rounding.
    margin = 1e-5 * (high - low).max(axis=1, keepdims=True)
    inner_low, inner_high = low + margin, high - margin
    least, most = low.min(axis=0), high.max(axis=0)
    closed = [is_closed(shape.mesh) for shape in shapes]
    flags = [not each for each in closed]
    for i in np.flatnonzero(closed):
        near = ((low < inner_high[i]) & (high > inner_low[i])).all(axis=1)
        near[i] = False
        flags[i] = any(_any_inside(shapes[j].position, inner_low[i], inner_high[i]) for j in np.flatnonzero(near))
        flags[i] = flags[i] or _any_outside(shapes[i], least + margin[i], most - margin[i])
    return np.repeat(flags, [shape.triangles for shape in shapes])


def _any_inside(points: np.ndarray, low: np.ndarray, high: np.ndarray) -> bool:
    return bool(((points > low) & (points < high)).all(axis=1).any())


def _any_outside(shape: Shape, least: np.ndarray, most: np.ndarray) -> bool:
    """Whether a part of a closed shape faces inwards and does not reach around all that is between these corners, or
    one that faces outwards lies in another.
    """
    corners = shape.mesh.corner_vertex[shape.mesh.triangle_corners]
    low, high, nested = inward(shape.position, corners[:, ::-1] if shape.mirrored else corners)
    return nested or bool(((low > least) | (high < most)).any())
