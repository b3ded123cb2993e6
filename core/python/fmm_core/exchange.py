# SPDX-License-Identifier: GPL-3.0-or-later
"""What the particles of a scene send to each other: found once, used for any lights."""

import numpy as np
from numpy.typing import NDArray

from .direct_light import LIGHTING, Receivers
from .iteration import Solved, iterate
from .kept import KeptVisibility
from .multipole import MultipoleSpace, particle_rays
from .progress import Progress, Tick, silent, ticker
from .report import Report
from .scene import Scene
from .settings import Settings
from .transport import Operator, Space
from .visibility import Occlusion


class Exchange:
    """The operators of a scene's particles, each made when a light first calls for it.

    space      makes sums over the particles
    operator   what they send to each other, once it was needed
    lit        the particles, as lamps and sky shine on them
    """

    def __init__(self, space: Space, settings: Settings) -> None:
        self.space, self._settings = space, settings
        self.operator: Operator | None = None
        self._last: Solved | None = None
        self.lit = self._receivers()

    def use(self, settings: Settings) -> None:
        """Gathers with other settings from now on; what the particles send to each other stays."""
        self._settings = settings
        if isinstance(self.space, MultipoleSpace):
            self.space.use(settings)

    def block(self, scene: Scene, kept: KeptVisibility | None) -> bool:
        """Gives lamps and sky shadows where the scene had been solved without any; whether that was so."""
        if self.space.sums.occlusion is not None:
            return False
        self.space.sums.occlusion = Occlusion(scene, kept)
        self.lit = self._receivers()
        return True

    def radiosity(self, scene: Scene, report: Report, progress: Progress | None) -> NDArray[np.float64]:
        """Radiosity (N, 3) of the particles, W/m^2."""
        particles = self.space.sums.particles
        if not scene.albedo.any():
            report.counts["channels"] = 3
            return particles.of_triangles(scene.emission)
        if self.operator is None:
            self._make(report, progress)
        with report.time("visibility"):
            direct = self.direct(scene, ticker(progress, 0.7, 0.8, LIGHTING))
        with report.time("transport"):
            tick = ticker(progress, 0.8, 1.0, "Exchanging light")
            parts = self.operator, scene, particles, direct, self._settings
            self._last = iterate(*parts, report, tick, self._last)
        return self._last.radiosity.copy()

    def received(self, scene: Scene, radiosity: NDArray[np.float64], report: Report) -> NDArray[np.float64]:
        """Irradiance (N, 3) of the particles for their radiosity (N, C), lamps and sky, W/m^2."""
        if self.operator is None:
            self._make(report, None)
        return np.maximum(self.operator.apply(radiosity), 0.0) + self.lit.irradiance(scene)

    def direct(self, scene: Scene, tick: Tick = silent) -> NDArray[np.float64]:
        """Irradiance (N, 3) of the particles from lamps and sky, as far as they reflect it."""
        if not scene.albedo.any():
            return np.zeros((len(self.space.sums.particles), 3))
        return self.lit.irradiance(scene, tick)

    def _make(self, report: Report, progress: Progress | None) -> None:
        space, tick = self.space, ticker(progress, 0.0, 0.7, "Preparing the exchange")
        if not isinstance(space, MultipoleSpace):
            with report.time("visibility"):
                self.operator = space.exchange(tick)
            return
        with report.time("lists"):
            self.operator = space.exchange(tick)
        report.seconds["lists"] -= space.occlusion_seconds
        report.seconds["visibility"] += space.occlusion_seconds
        report.counts.update({name: space.counts[name] for name in ("boxes", "leaves")})
        report.counts.update(zip(("pairs_valid", "pairs_partial", "pairs_invalid"), space.pairs, strict=True))
        report.postponement = space.pairs[1] / max(1, sum(space.pairs))

    def _receivers(self) -> Receivers:
        sums = self.space.sums
        rays = particle_rays(self._settings, len(sums.particles))
        return Receivers(sums.particles.positions, sums.particles.normals, sums.occlusion, rays, sums.particles)
