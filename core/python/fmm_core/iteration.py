# SPDX-License-Identifier: GPL-3.0-or-later
"""The iteration that the settings choose."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .krylov import gmres
from .particles import Particles
from .progress import Tick
from .report import Report
from .scene import Scene
from .settings import Settings
from .shooting import shoot
from .transport import Operator

#: Functions of the exchange, the particles, their albedo and own light, the settings, the report and a tick, by name.
ITERATIONS = {"krylov": gmres, "shooting": shoot}

#: Light that is the same up to this share of itself leaves radiosity that is, everywhere.
SAME = 1e-6


class Solved(NamedTuple):
    """Albedo, own light and radiosity (N, C) of the particles as they were solved, and whether that came to its end."""

    albedo: NDArray[np.float64]
    own: NDArray[np.float64]
    radiosity: NDArray[np.float64]
    ended: bool

    def brighter(self, albedo: NDArray[np.float64], own: NDArray[np.float64]) -> "Solved | None":
        """The same for light that has become brighter or darker as a whole, in each colour; None where it is not."""
        if not self.ended or self.own.shape[1] > own.shape[1] or not (self.albedo == albedo).all():
            return None
        most, brightest = self.own.max(axis=0), self.own.argmax(axis=0)
        factor = own[brightest, np.arange(own.shape[1])] / np.where(most > 0, most, 1.0)
        same = (np.abs(own - factor * self.own) <= SAME * factor * self.own).all()
        return Solved(albedo, factor * self.own, factor * self.radiosity, True) if same else None


def iterate(
    exchange: Operator,
    scene: Scene,
    particles: Particles,
    direct: NDArray[np.float64],
    settings: Settings,
    report: Report,
    tick: Tick,
    last: Solved | None = None,
) -> Solved:
    """Radiosity (N, C) of the particles, which get irradiance `direct` (N, 3) from lamps and sky: in one channel where
    all albedo and light is grey, else in three. last: what the same exchange was solved for before.
    """
    albedo, emission = particles.of_triangles(scene.albedo), particles.of_triangles(scene.emission)
    own = emission + albedo * direct
    channels = 1 if _is_grey(albedo) and _is_grey(own) and scene.absorbs_grey else 3
    report.counts["channels"] = channels
    parts = albedo[:, :channels], own[:, :channels]
    found = None if last is None else last.brighter(*parts)
    if found is not None:
        return found
    before = len(report.warnings)
    radiosity = ITERATIONS[settings.iteration](exchange, particles, *parts, settings, report, tick)
    return Solved(*parts, radiosity, len(report.warnings) == before)


def _is_grey(colours: NDArray[np.float64]) -> bool:
    return bool((colours == colours[:, :1]).all())
