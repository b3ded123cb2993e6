# SPDX-License-Identifier: GPL-3.0-or-later
"""Closed meshes: what they hold, and which way they face."""

import numpy as np
from numpy.typing import NDArray

from . import _binding

Points = NDArray[np.float64]


def signed_volume(triangles: Points) -> float:
    """What is inside a closed mesh (T, 3, 3), m^3; below 0 where its triangles face inwards."""
    return _binding.volume(np.ascontiguousarray(triangles, np.float64))


def inward(vertices: Points, corners: NDArray[np.integer]) -> tuple[Points, Points, bool]:
    """The least and the greatest coordinates (P, 3), m, of those parts of a closed mesh that face inwards: of vertices
    (V, 3) in triangles (T, 3) of their numbers. The inner sides of walls are none. And whether any part that faces
    outwards lies in another one, which may be a room.
    """
    return _binding.inward(np.ascontiguousarray(corners, np.uint32), np.ascontiguousarray(vertices[corners]))
