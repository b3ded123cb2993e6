# SPDX-License-Identifier: GPL-3.0-or-later
"""Output points: where a mesh's colours are evaluated (end of section 4 of the paper)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

#: How far an output point is stepped from its vertex towards the middle of its faces, as a share of the way.
STEP = 1e-3
#: Normals closer than this (in each component) count as one.
SAME_NORMAL = 1e-4


@dataclass(frozen=True)
class OutputPoints:
    """points, normals (M, 3); inverse (C,) the output point of each mesh corner."""

    points: NDArray[np.float64]
    normals: NDArray[np.float64]
    inverse: NDArray[np.int64]


def output_points(
    positions: ArrayLike, normals: ArrayLike, vertices: ArrayLike, face_centres: ArrayLike
) -> OutputPoints:
    """One output point for all corners with the same vertex and normal.

    positions, normals (C, 3) of each corner; vertices (C,) an integer for each vertex of the scene; face_centres
    (C, 3) of the corner's face. At a crease, a rim or a contact the vertex itself lies on several surfaces, so a
    point is stepped a little from it: along its tangent plane towards the mean of its faces' centres, and along its
    normal as far as the highest of those centres, so that its own faces never cover it.
    """
    positions, normals = np.asarray(positions, np.float64), np.asarray(normals, np.float64)
    vertices, face_centres = np.asarray(vertices, np.int64), np.asarray(face_centres, np.float64)
    keys = np.column_stack([vertices, np.rint(normals / SAME_NORMAL).astype(np.int64)])
    _, inverse = np.unique(keys, axis=0, return_inverse=True)
    inverse = inverse.reshape(-1)
    counts = np.bincount(inverse)[:, None]

    def mean(values: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.stack([np.bincount(inverse, values[:, axis]) for axis in range(3)], axis=1) / counts

    points, directions = mean(positions), mean(normals)
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    inward = mean(face_centres) - points
    inward -= directions * (inward * directions).sum(axis=1, keepdims=True)
    height = np.zeros(len(points))
    np.maximum.at(height, inverse, ((face_centres - positions) * directions[inverse]).sum(axis=1))
    points += STEP * (inward + directions * height[:, None])
    return OutputPoints(points, directions, inverse)
