# SPDX-License-Identifier: GPL-3.0-or-later
"""Output points: where a mesh's colours are evaluated (end of section 4 of the paper)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .arrays import finite_rows, lengths, unit_rows
from .errors import Error

#: How far an output point is stepped from its vertex towards the middle of a triangle, as a share of the way.
STEP = 1e-3
#: Normals closer than this (in each component) count as one.
SAME_NORMAL = 1e-4
#: Triangles whose centres lie closer than this to the tangent plane, as a share of their distance, count as flat.
FLAT = 1e-3
#: Odd numbers at random: whole numbers times these, added up, are one number for each row.
_FACTORS = np.random.default_rng(0).integers(1 << 61, 1 << 62, 4) * 2 + 1


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
    groups = _Groups([vertices, *np.rint(normals / SAME_NORMAL).astype(np.int64).T])
    inverse = groups.number

    steps = triangle_centres - positions
    reach = lengths(steps)
    # The corner whose triangle reaches farthest stands for its group: the least likely to be a sliver.
    # Rounding must not choose between equal ones.
    rounded = reach.astype(np.float32)
    farthest = rounded == groups.of(np.maximum, rounded)[inverse]
    corner = groups.of(np.maximum, np.where(farthest, np.arange(len(reach)), -1))
    directions = normals[corner]
    heights = np.einsum("ci,ci->c", steps, directions[inverse])
    height, bend = np.maximum(groups.of(np.maximum, heights), 0.0), groups.of(np.maximum, np.abs(heights))

    mean = groups.of(np.add, steps) / np.bincount(inverse)[:, None]
    flat = bend < FLAT * reach[corner]
    step = np.where(flat[:, None], steps[corner], mean)
    step -= directions * (step * directions).sum(axis=1, keepdims=True)
    return OutputPoints(positions[corner] + STEP * (step + directions * height[:, None]), directions, inverse)


class _Groups:
    """Rows whose whole numbers are all the same, given by columns (C,).

    number (C,) that of each row's group, from 0 on, in the order of their first rows
    """

    def __init__(self, columns: list[NDArray[np.int64]]) -> None:
        # One number tells rows apart and sorts faster: that two share one by chance is as good as impossible.
        keys = sum(factor * column for factor, column in zip(_FACTORS, columns, strict=True))
        self._order = np.argsort(keys)
        ordered = keys[self._order]
        new = np.concatenate([[True], ordered[1:] != ordered[:-1]])
        self._starts = np.flatnonzero(new)
        first = np.minimum.reduceat(self._order, self._starts)
        leads = np.zeros(len(keys), bool)
        leads[first] = True
        self._number = (np.cumsum(leads) - 1)[first]
        self.number = np.empty(len(keys), np.int64)
        self.number[self._order] = np.repeat(self._number, np.diff(self._starts, append=len(keys)))

    def of(self, reduce: np.ufunc, values: NDArray) -> NDArray:
        """(G, ...) what is left of the values (C, ...) of each group."""
        found = reduce.reduceat(values[self._order], self._starts)
        left = np.empty_like(found)
        left[self._number] = found
        return left
