# SPDX-License-Identifier: GPL-3.0-or-later
"""The solved scene: irradiance anywhere, and the report."""

from contextlib import AbstractContextManager
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .direct import DirectSpace
from .errors import Error
from .particles import Particles
from .report import Report
from .scene import Scene
from .settings import Settings


class Solution:
    """Solved radiosity of a scene.

    scene, settings   what was solved and how
    radiosity         (N, 3) at the particles, W/m^2
    """

    def __init__(
        self, scene: Scene, settings: Settings, space: DirectSpace, radiosity: NDArray[np.float64], report: Report
    ) -> None:
        self.scene, self.settings = scene, settings
        self.radiosity = radiosity
        self._space, self._report = space, report

    def irradiance(self, points: ArrayLike, normals: ArrayLike, progress: Any = None) -> NDArray[np.float64]:
        """Irradiance (M, 3) in W/m^2 at points (M, 3) with normals (M, 3), which are made unit length.

        progress(fraction, text) as in `solve`. Raises `Error` naming the row on a shape or value that is wrong.
        """
        points, normals = _oriented(points, normals)
        tick = None if progress is None else lambda fraction: progress(fraction, "Gathering light")
        with self._report.time("evaluate"):
            irradiance = self._space.gather(points, normals, self.radiosity, tick)
        self._report.counts["output_points"] = len(points)
        self._report.counts["rays"] = self._space.occlusion.rays
        return irradiance

    def time(self, phase: str) -> AbstractContextManager[None]:
        """Adds the seconds spent inside to the report's `seconds[phase]`."""
        return self._report.time(phase)

    @property
    def particles(self) -> Particles:
        """The quadrature points that carry the radiosity."""
        return self._space.particles

    @property
    def report(self) -> dict[str, Any]:
        """The report of this solve, version 1, as plain values that json can write."""
        return self._report.as_dict()


def _oriented(points: ArrayLike, normals: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    arrays = []
    for name, values in (("points", points), ("normals", normals)):
        array = np.ascontiguousarray(values, dtype=np.float64)
        if array.ndim != 2 or array.shape[1] != 3:
            raise Error(f"{name}: expected shape (M, 3), got {array.shape}")
        if not np.isfinite(array).all():
            row = int(np.flatnonzero(~np.isfinite(array).all(axis=1))[0])
            raise Error(f"{name}: row {row} is {array[row].tolist()}")
        arrays.append(array)
    if len(arrays[0]) != len(arrays[1]):
        raise Error(f"normals: expected {len(arrays[0])} rows like points, got {len(arrays[1])}")
    lengths = np.linalg.norm(arrays[1], axis=1, keepdims=True)
    if not lengths.all():
        raise Error(f"normals: row {int(np.flatnonzero(lengths[:, 0] == 0)[0])} has no direction")
    return arrays[0], arrays[1] / lengths
