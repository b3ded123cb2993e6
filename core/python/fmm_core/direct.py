# SPDX-License-Identifier: GPL-3.0-or-later
"""The direct method: every receiver sums over every particle, the reference that judges everything else."""

import os

import numpy as np
from numpy.typing import NDArray

from .errors import Error
from .progress import Tick, silent
from .transport import Operator, Sums

#: Pairs of a receiver and a particle in one block of a gather: bounds memory, and the time between two ticks.
BLOCK_PAIRS = 16_000_000
#: Pairs up to which the visibility of a gather is kept for other lights, a bit each.
KEPT_PAIRS = 8_000_000_000


class DirectSpace:
    """Operators by the direct sum; see `transport.Space`."""

    def __init__(self, sums: Sums) -> None:
        self.sums, self.order = sums, None
        self._lit, self._closed = np.ones((len(sums.particles), 1), bool), False
        self._gathered: tuple[NDArray[np.float64], NDArray[np.float64], list[Operator]] | None = None

    def exchange(self, tick: Tick = silent) -> Operator:
        particles = self.sums.particles
        if self.sums.occlusion is not None:
            _check_memory(len(particles), 16 * len(particles) * self.sums.sources.words)
        operator = self.sums.direct_operator(particles.positions, particles.normals, True, tick)
        if self.sums.keeps_energy:
            self._closed = self.sums.closed
            self._lit = operator.balanced(self._closed, self.sums.shares)
        return operator

    def gather(
        self,
        points: NDArray[np.float64],
        normals: NDArray[np.float64],
        radiosity: NDArray[np.float64],
        tick: Tick = silent,
        effort: float = 1.0,
    ) -> NDArray[np.float64]:
        size = max(64, BLOCK_PAIRS // len(self.sums.particles))
        if self._gathered is not None:
            kept_points, kept_normals, kept = self._gathered
            if np.array_equal(kept_points, points) and np.array_equal(kept_normals, normals):
                return np.concatenate([operator.apply(radiosity) for operator in kept])
        keep = len(points) * len(self.sums.particles) <= KEPT_PAIRS
        irradiance, operators = np.zeros((len(points), radiosity.shape[1])), []
        for start in range(0, len(points), size):
            rows = slice(start, start + size)
            operator = self.sums.direct_operator(points[rows], normals[rows])
            if self.sums.keeps_energy:
                operator.received_balanced(self._closed, self._lit)
            irradiance[rows] = operator.apply(radiosity)
            if keep:
                operators.append(operator)
            tick((start + size) / len(points))
        self._gathered = (points.copy(), normals.copy(), operators) if operators else None
        return irradiance


def _check_memory(particles: int, size: int) -> None:
    """Refuses what could never fit: Linux hands out memory that it does not have, and kills the process later."""
    if not hasattr(os, "sysconf"):
        return
    memory = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    if size > memory:
        raise Error(
            f"particles: the direct method with {particles} of them takes {size / 2**30:.0f} GiB, "
            f"this machine has {memory / 2**30:.0f}"
        )
