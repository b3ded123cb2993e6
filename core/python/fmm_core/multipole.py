# SPDX-License-Identifier: GPL-3.0-or-later
"""The fast multipole method: octrees, interaction lists and expansions in place of the sum over all pairs."""

import numpy as np
from numpy.typing import NDArray

from . import _binding
from .cost import choose_grouping
from .progress import Tick, silent
from .settings import Settings
from .transport import Operator, Sums


class MultipoleSpace:
    """Operators by the fast multipole method; see `transport.Space`.

    grouping   the s in use, chosen by the cost model where the settings leave it open
    counts     how much work the exchange does, by pass
    """

    def __init__(self, sums: Sums, settings: Settings) -> None:
        self.sums, self._settings = sums, settings
        particles = sums.particles
        self.grouping = settings.grouping or 1
        if settings.grouping is None and settings.level is None:
            self.grouping = choose_grouping(particles.positions, particles.normals, settings)
        self.counts: dict[str, int] = {}

    def exchange(self, tick: Tick = silent) -> Operator:
        tick(0.0)
        points, normals = self.sums.particles.positions, self.sums.particles.normals
        fmm = self._fmm(None, tick)
        self.counts = fmm.counts()
        correction = self.sums.correction(points, normals, fmm=fmm)
        return Operator(self.sums.particles, lambda q: fmm.apply(q)[0], correction)

    def gather(
        self,
        points: NDArray[np.float64],
        normals: NDArray[np.float64],
        radiosity: NDArray[np.float64],
        tick: Tick = silent,
    ) -> NDArray[np.float64]:
        if len(points) == 0:
            return np.zeros((0, 3))
        fmm = self._fmm((points, normals), tick)
        correction = self.sums.correction(points, normals, fmm=fmm)
        return Operator(self.sums.particles, lambda q: fmm.apply(q)[0], correction).apply(radiosity)

    def _fmm(self, targets: tuple[NDArray[np.float64], NDArray[np.float64]] | None, tick: Tick) -> _binding.Fmm:
        particles, settings = self.sums.particles, self._settings
        fmm = _binding.Fmm(
            (particles.positions, particles.normals, particles.emits),
            particles.softening,
            targets,
            settings.truncation,
            self.grouping,
            settings.level,
            settings.separation,
            settings.expansion_in_use,
        )
        if self.sums.occlusion is not None:
            self.sums.occlusion.occlude(fmm, particles.visibility_weights, self.sums.reach, self._effort, tick)
        return fmm

    @property
    def _effort(self) -> tuple[float, float, float]:
        import os
        q = os.environ.get("EFFORT")
        return eval(q)
