# SPDX-License-Identifier: GPL-3.0-or-later
"""Output points: where a mesh's colours are evaluated (end of section 4 of the paper)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .arrays import finite_rows, unit_rows
from .errors import Error

#: How far an output point is stepped from its vertex towards the middle of a triangle, as a share of the way.
STEP = 1e-3
#: Normals closer than this (in each component) count as one.
SAME_NORMAL = 1e-4
#: Triangles whose centres lie closer than this to the tangent plane, as a share of their distance, count as flat.
FLAT = 1e-3


@dataclass(frozen=True)
class OutputPoints:
    """points, normals (M, 3); inverse (C,) the output point of each mesh corner."""

    points: NDArray[np.float64]
    normals: NDArray[np.float64]
    inverse: NDArray[np.int64]


def output_points(
    positions: ArrayLike, normals: ArrayLike, vertices: ArrayLike, triangle_centres: ArrayLike
) -> OutputPoints:
    """One output point for all corners with the same vertex and normal.

    positions, normals (C, 3) of each corner; vertices (C,) an integer for each vertex of the scene; triangle_centres
    (C, 3) centroid of a triangle of the corner's face that has the corner. At a crease, a rim or a contact the vertex
    itself lies on several surfaces, so a point is stepped a little from it: into one of its triangles where they are
    flat, which keeps it out of a block that stands in a corner of them; where they are curved towards the mean of the
    centres and as high as the highest, so that its own faces never cover it.
    Raises `Error` naming the array on wrong shapes, and the row where a value is not finite or a normal is zero.
    """
    positions, normals = finite_rows("positions", positions), unit_rows("normals", normals)
    triangle_centres = finite_rows("triangle_centres", triangle_centres)
    vertices = np.asarray(vertices, np.int64)
    if len({len(positions), len(normals), len(triangle_centres), *vertices.shape}) != 1:
        raise Error("output_points: positions, normals, vertices and triangle_centres differ in length")
    if len(positions) == 0:
        return OutputPoints(positions, normals, np.zeros(0, np.int64))
    keys = np.column_stack([vertices, np.rint(normals / SAME_NORMAL).astype(np.int64)])
    inverse = _groups(keys)

    steps = triangle_centres - positions
    reach = np.linalg.norm(steps, axis=1)
    # The corner whose triangle reaches farthest stands for its group: the least likely to be a sliver.
    # Rounding must not choose between equal ones.
    by_reach = np.argsort(reach.astype(np.float32), kind="stable")
    corner = np.zeros(inverse.max() + 1, np.int64)
    corner[inverse[by_reach]] = by_reach
    directions = normals[corner]
    heights = (steps * directions[inverse]).sum(axis=1)
    height, bend = np.zeros(len(corner)), np.zeros(len(corner))
    np.maximum.at(height, inverse, heights)
    np.maximum.at(bend, inverse, np.abs(heights))

    mean = np.stack([np.bincount(inverse, steps[:, axis]) for axis in range(3)], axis=1)
    mean /= np.bincount(inverse)[:, None]
    flat = bend < FLAT * reach[corner]
    step = np.where(flat[:, None], steps[corner], mean)
    step -= directions * (step * directions).sum(axis=1, keepdims=True)
    return OutputPoints(positions[corner] + STEP * (step + directions * height[:, None]), directions, inverse)


def _groups(keys: NDArray[np.int64]) -> NDArray[np.int64]:
    """(C,) the same number, from 0 on, for rows (C, K) that are the same.

    As `np.unique` has it, which compares rows under the interpreter's lock and lets nothing else run meanwhile.
    """
    order = np.lexsort(keys.T[::-1])
    ordered = keys[order]
    found = np.zeros(len(keys), np.int64)
    found[order] = np.concatenate([[0], np.cumsum((ordered[1:] != ordered[:-1]).any(axis=1))])
    return found
