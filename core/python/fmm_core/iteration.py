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

#: Functions of the exchange, the particles, their albedo and own light, the settings, the report and a tick, by name.
ITERATIONS = {"krylov": gmres, "shooting": shoot}


def iterate(
    exchange: Operator,
    scene: Scene,
    particles: Particles,
    direct: NDArray[np.float64],
    settings: Settings,
    report: Report,
    tick: Tick,
) -> NDArray[np.float64]:
    """Radiosity (N, 3) of the particles, which get irradiance `direct` (N, 3) from lamps and sky."""
    albedo, emission = particles.of_triangles(scene.albedo), particles.of_triangles(scene.emission)
    own = emission + albedo * direct
    return ITERATIONS[settings.iteration](exchange, particles, albedo, own, settings, report, tick)
