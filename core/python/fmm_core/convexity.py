# SPDX-License-Identifier: GPL-3.0-or-later
"""Proof, without a ray, that no triangle is between others, or between them and a lamp."""

from collections.abc import Callable
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from . import _binding

Points = NDArray[np.float64]
Mask = NDArray[np.bool_]

#: Triangles and points that are tried before all of them: most scenes are known by a few.
FEW = 512
#: Different planes that are worth the proof, or planes times points.
PLANES, PRODUCTS = 64, 100_000_000
#: Distance that counts as lying on a plane, in sizes of the scene: less than rays are lifted by.
ON_PLANE = 5e-7


class Planes:
    """The planes of triangles (T, 3, 3), and whether points (M, 3) lie on both sides of them.

    size: the longest side of the box around the triangles.
    What would take long to prove is taken not to be so.
    """

    def __init__(self, triangles: Points, size: float, points: Points) -> None:
        self._triangles, self._size, self._points = triangles, size, points

    def some_stand_between(self) -> bool:
        """Whether a triangle may be between two points: its plane has some on both sides."""
        return self._some(lambda _, below, above: below & above)

    def some_face(self) -> bool:
        """Whether a triangle may face a point: it lies before it."""
        return self._some(lambda _, below, above: above)

    def nothing_between(self, lamp: Points, radius: float) -> bool:
        """Whether no triangle can be between the points and a lamp: for none is the plane between them.

        lamp (K, 4) homogeneous points, the lamp being within `radius` of their convex hull; the last number is 1, or 0
        for a direction, of which `radius` is the sine of the angle about it.
        """
        margin = ON_PLANE * self._size

        def parts(planes: Points, below: Mask, above: Mask) -> Mask:
            heights = planes @ lamp.T
            on_top = ~below & (heights.min(axis=1) >= radius - margin)
            return ~(on_top | (~above & (heights.max(axis=1) <= margin - radius)))

        return not self._some(parts)

    def _some(self, test: Callable[[Points, Mask, Mask], Mask]) -> bool:
        """Whether a test holds for some plane, as `_binding.planes` gives them."""
        if len(self._triangles) == 0 or len(self._points) == 0:
            return False
        return bool(test(*self._few).any()) or self._all is None or bool(test(*self._all).any())

    @cached_property
    def _few(self) -> tuple[Points, Mask, Mask]:
        triangles, points = (rows[:: max(1, len(rows) // FEW)] for rows in (self._triangles, self._points))
        return self._planes(triangles, points, len(triangles))

    @cached_property
    def _all(self) -> tuple[Points, Mask, Mask] | None:
        return self._planes(self._triangles, self._points, max(PLANES, PRODUCTS // len(self._points)))

    def _planes(self, triangles: Points, points: Points, most: int) -> tuple[Points, Mask, Mask] | None:
        arrays = np.ascontiguousarray(triangles), np.ascontiguousarray(points)
        return _binding.planes(*arrays, self._size, ON_PLANE * self._size, most)
