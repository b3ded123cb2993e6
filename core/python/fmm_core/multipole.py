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
        fmm = self._fmm(None)
        self.counts = fmm.counts()
        tick(0.5)
        return Operator(self.sums.particles, lambda q: fmm.apply(q)[0], self.sums.correction(points, normals, None))

    def gather(
        self,
        points: NDArray[np.float64],
        normals: NDArray[np.float64],
        radiosity: NDArray[np.float64],
        tick: Tick = silent,
    ) -> NDArray[np.float64]:
        if len(points) == 0:
            return np.zeros((0, 3))
        fmm = self._fmm((points, normals))
        tick(0.5)
        correction = self.sums.correction(points, normals, None)
        return Operator(self.sums.particles, lambda q: fmm.apply(q)[0], correction).apply(radiosity)

    def _fmm(self, targets: tuple[NDArray[np.float64], NDArray[np.float64]] | None) -> _binding.Fmm:
        particles, settings = self.sums.particles, self._settings
        return _binding.Fmm(
            (particles.positions, particles.normals),
            particles.softening,
            targets,
            settings.truncation,
            self.grouping,
            settings.level,
            settings.separation,
            settings.expansion_in_use,
        )
