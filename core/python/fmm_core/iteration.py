# SPDX-License-Identifier: GPL-3.0-or-later
"""The iteration that the settings choose."""

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

#: Functions of the exchange, the particles, their albedo and own light, the settings, the report, a tick and a start,
#: by name.
ITERATIONS = {"krylov": gmres, "shooting": shoot}


def iterate(
    exchange: Operator,
    scene: Scene,
    particles: Particles,
    direct: NDArray[np.float64],
    settings: Settings,
    report: Report,
    tick: Tick,
    start: NDArray[np.float64] | None = None,
) -> NDArray[np.float64]:
    """Radiosity (N, C) of the particles, which get irradiance `direct` (N, 3) from lamps and sky: in one channel where
    all albedo and light is grey, else in three. start: radiosity (N, 3) under other lights.
    """
    albedo, emission = particles.of_triangles(scene.albedo), particles.of_triangles(scene.emission)
    own = emission + albedo * direct
    channels = 1 if _is_grey(albedo) and _is_grey(own) and scene.absorbs_grey else 3
    report.counts["channels"] = channels
    parts = albedo[:, :channels], own[:, :channels]
    begun = None if start is None else start[:, :channels]
    return ITERATIONS[settings.iteration](exchange, particles, *parts, settings, report, tick, begun)


def _is_grey(colours: NDArray[np.float64]) -> bool:
    return bool((colours == colours[:, :1]).all())
