# SPDX-License-Identifier: GPL-3.0-or-later
"""Proof, without a ray, that no triangle is between others, or between them and a lamp."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Points = NDArray[np.float64]

#: Receivers that are asked first: most scenes fail with them.
FEW = 16
#: Planes and corners that are tried before all of them.
SOME = 512
#: Planes times receivers that are worth the proof.
MOST = 200_000_000
#: Planes times receivers at once: bounds memory.
BLOCK = 10_000_000
#: Distance that counts as lying on a plane, in sizes of the scene: less than rays are lifted by.
ON_PLANE = 5e-7
_SPREAD = np.random.default_rng(0).random(4)


def nothing_between(triangles: Points, size: float, points: Points, lamp: Points, radius: float) -> bool:
    """Whether no triangle (T, 3, 3) can be between points (M, 3) and a lamp: for none is the plane between them.

    size: the longest side of the box around the triangles.
    lamp (K, 4) homogeneous points, the lamp being within `radius` of their convex hull; the last number is 1, or 0 for
    a direction, of which `radius` is the sine of the angle about it.
    """
    if len(triangles) == 0:
        return True
    planes = _planes(triangles)
    return _on_one_side(planes, points[:: max(1, len(points) // FEW)], lamp, radius, ON_PLANE * size) and _on_one_side(
        _different(planes, size), points, lamp, radius, ON_PLANE * size
    )


def some_stand_between(triangles: Points, size: float) -> bool:
    """Whether a triangle (T, 3, 3) may be between two others: its plane has corners on both sides. size as above."""
    return _some(
        triangles,
        size,
        np.arange(len(triangles)),
        lambda lowest, highest, margin: (lowest < -margin) & (highest > margin),
    )


def some_face(triangles: Points, size: float, two_sided: NDArray[np.bool_]) -> bool:
    """Whether a triangle (T, 3, 3) may face another: a corner lies before it, or off its plane if it has two sides."""
    if _some(triangles, size, np.arange(len(triangles)), lambda _, highest, margin: highest > margin):
        return True
    return _some(triangles, size, np.flatnonzero(two_sided), lambda lowest, _, margin: lowest < -margin)


def _some(
    triangles: Points, size: float, rows: NDArray[np.int64], test: Callable[[Points, Points, float], Points]
) -> bool:
    """Whether a test holds for the lowest and the highest corner above some plane of these rows; True if too many."""
    if len(rows) == 0:
        return False
    corners, margin = triangles.reshape(-1, 3), ON_PLANE * size
    # Most scenes are known by a few planes and corners.
    some, few = rows[:: max(1, len(rows) // SOME)], corners[:: max(1, len(corners) // SOME)]
    if test(*_heights(_planes(triangles[some]), few), margin).any():
        return True
    planes = _different(_planes(triangles[rows]), size)
    if len(planes) * len(corners) > MOST:
        return True
    block = max(1, BLOCK // len(corners))
    parts = (planes[start : start + block] for start in range(0, len(planes), block))
    return any(test(*_heights(part, corners), margin).any() for part in parts)


def _heights(planes: Points, points: Points) -> tuple[Points, Points]:
    """Lowest and highest of points (M, 3) above each plane (P, 4)."""
    heights = planes[:, :3] @ points.T + planes[:, 3:]
    return heights.min(axis=1), heights.max(axis=1)


def _on_one_side(planes: Points, points: Points, lamp: Points, radius: float, margin: float) -> bool:
    if len(planes) * len(points) > MOST:
        return False
    block = max(1, BLOCK // max(1, len(points)))
    for start in range(0, len(planes), block):
        some = planes[start : start + block]
        heights = some[:, :3] @ points.T + some[:, 3:]
        lamp_heights = some @ lamp.T
        above = (heights.min(axis=1) >= -margin) & (lamp_heights.min(axis=1) >= radius - margin)
        below = (heights.max(axis=1) <= margin) & (lamp_heights.max(axis=1) <= margin - radius)
        if not (above | below).all():
            return False
    return True


def _planes(triangles: Points) -> Points:
    """(T, 4) unit normal and minus the distance from the origin along it."""
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    # Sums over three are slow in numpy but for this one.
    normals /= np.sqrt(np.einsum("tx,tx->t", normals, normals))[:, None]
    return np.column_stack([normals, -np.einsum("tx,tx->t", normals, triangles[:, 0])])


def _different(planes: Points, size: float) -> Points:
    """One of all planes that are the same up to rounding."""
    # A number for each plane, by which they are told apart faster than by four.
    keys = np.rint(planes / [1e-9, 1e-9, 1e-9, 1e-9 * size]) @ _SPREAD
    return planes[np.unique(keys, return_index=True)[1]]
