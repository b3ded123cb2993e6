# SPDX-License-Identifier: GPL-3.0-or-later
"""The fast multipole method: octrees, interaction lists and expansions in place of the sum over all pairs."""

import time
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from . import _binding
from .balance import Shares, is_watertight, looks_closed
from .cost import choose_grouping
from .progress import Tick, silent
from .settings import RAYS, Settings
from .transport import Near, Operator, Sums

Points = NDArray[np.float64]
#: Lowest and highest corner (2, 3) of each.
Boxes = Sequence[NDArray[np.float64]]

#: Points in a leaf for so many particles: with shadows leaves cost more than pairs of points.
LEAF_POINTS, LEAF_PARTICLES = 64, 20_000
#: An output point gets this many times the rays that one of so many particles gets: single ones of more matter less,
#: those of fewer more.
EXCHANGE_SHARE, MANY = 4, 20_000
#: For each ray of the settings a point has so many for emitters that shine all over its hemisphere, of which it mostly
#: needs a quarter, and so many over its hemisphere, which it shares with its neighbours.
AIMED, HEMISPHERE = 1.5, 1.5
#: Of fewer rays than usual more are for emitters, by this power: shadows of lamps are most of the error then.
TO_EMITTERS = 0.25
#: Up to so many particles sources are balanced one by one: of more, what single ones send too much or too little
#: averages out, and their few rays tell it less well than it is without.
SINGLE = 30_000
#: Nothing has fewer rays than these.
LEAST_RAYS = 10.0


class MultipoleSpace:
    """Operators by the fast multipole method; see `transport.Space`.

    settings   with nothing left open
    grouping   the s in use, chosen by the cost model where the settings leave it open
    counts     how much work the exchange does, by pass
    pairs      pairs of boxes that see each other as a whole, that were postponed because they may not, and that do not
    order      (T,) the triangles of the scene in the order of the particles, None where that is its own
    open       whether nothing is in the way of anything
    occlusion_seconds   seconds that visibility took in the sum made last
    """

    def __init__(self, sums: Sums, settings: Settings, boxes: Boxes = ()) -> None:
        """boxes: what things may move in later."""
        self.sums, self.settings, self._boxes = sums, settings, list(boxes)
        particles = sums.particles
        self.grouping = settings.grouping or LEAF_POINTS * max(1, round(len(particles) / LEAF_PARTICLES))
        if settings.grouping is None and settings.level is None and not sums.keeps_energy:
            self.grouping = choose_grouping(particles.positions, particles.normals, settings)
        self.counts: dict[str, int] = {}
        self.pairs = (0, 0, 0)
        self.occlusion_seconds, self.open = 0.0, True
        self.order: NDArray[np.int64] | None = None
        self._gathered: tuple[Points, Points, float, Operator] | None = None
        self._lit, self._closed = np.ones((len(particles), 1), bool), False

    @property
    def asked(self) -> tuple[Points, Points] | None:
        """The points (M, 3) that were asked for last, with their normals (M, 3)."""
        return None if self._gathered is None else self._gathered[:2]

    def use(self, settings: Settings) -> None:
        """Gathers with other settings from now on."""
        self.settings, self._gathered = settings, None

    def exchange(self, tick: Tick = silent) -> Operator:
        tick(0.0)
        points, normals = self.sums.particles.positions, self.sums.particles.normals
        fmm, correction = self._fmm(None, points, normals, particle_rays(self.settings, len(self.sums.particles)), tick)
        self.counts, self.pairs = fmm.counts(), fmm.outcomes()

        def mirrored(areas: NDArray[np.float64]) -> NDArray[np.float64]:
            return fmm.sent(areas[:, 0])[:, None]

        operator = Operator(self.sums.particles, lambda q, clear: fmm.apply(q, clear)[0], correction, mirrored)
        if self.sums.keeps_energy:
            self._closed, shares = self._seen()
            self._lit = operator.balanced(self._closed, shares, self._single)
        return operator

    @property
    def _single(self) -> bool:
        """Whether sources are balanced one by one."""
        return len(self.sums.particles) <= SINGLE

    def _seen(self) -> tuple[bool, Shares | None]:
        """Whether light cannot leave the scene, and what the particles see, as far as rays are to tell."""
        occlusion = self.sums.occlusion
        if occlusion is None:
            return self.sums.closed, None
        if self.open:
            return occlusion.whole and is_watertight(occlusion.triangles), None
        if self.settings.visibility == "cells":
            return False, None
        if not self._single:
            return looks_closed(occlusion, self.sums.particles), None
        return self.sums.closed, self.sums.shares

    def gather(
        self, points: Points, normals: Points, radiosity: Points, tick: Tick = silent, effort: float = 1.0
    ) -> Points:
        if len(points) == 0:
            return np.zeros((0, radiosity.shape[1]))
        rays = least_rays(effort * self.settings.rays)
        if not self._has(points, normals, rays):
            fmm, correction = self._fmm((points, normals), points, normals, rays, tick)
            operator = Operator(self.sums.particles, lambda q, clear: fmm.apply(q, clear)[0], correction)
            if self.sums.keeps_energy:
                operator.received_balanced(self._closed, self._lit)
            self._gathered = points.copy(), normals.copy(), rays, operator
        return self._gathered[3].apply(radiosity)

    def _fmm(
        self, targets: tuple[Points, Points] | None, points: Points, normals: Points, rays: float, tick: Tick
    ) -> tuple[_binding.Fmm, _binding.Correction]:
        """As `traced`, and what corrects the sum near patches."""
        fmm, near = self.traced(targets, points, normals, rays, tick)
        return fmm, near.correction(self.sums.sources)

    def _has(self, points: Points, normals: Points, rays: float) -> bool:
        """Whether these were asked for last."""
        if self._gathered is None:
            return False
        known, of_known, of_rays, _ = self._gathered
        return np.array_equal(known, points) and np.array_equal(of_known, normals) and of_rays == rays

    def traced(
        self, targets: tuple[Points, Points] | None, points: Points, normals: Points, rays: float, tick: Tick
    ) -> tuple[_binding.Fmm, Near]:
        """The sum at the targets, None for the particles themselves, by about so many rays each, and the patches that
        are near them.
        """
        particles, settings, occlusion = self.sums.particles, self.settings, self.sums.occlusion
        fmm = _binding.Fmm(
            (particles.positions, particles.normals),
            particles.softening,
            targets,
            settings.truncation,
            self.grouping,
            settings.level,
            settings.separation,
            settings.expansion_in_use,
            emitters=particles.emits,
            scene=occlusion.triangles if occlusion and settings.visibility == "rays" else None,
            medium=self.sums.medium,
        )
        tick(0.1)
        start = time.perf_counter()
        occluded = self._occlude(fmm, len(points), rays, tick)
        self.occlusion_seconds = time.perf_counter() - start
        self.open = self.open and not occluded
        return fmm, self.sums.near(points, normals, fmm, open_space=not occluded)

    def _occlude(self, fmm: _binding.Fmm, points: int, rays: float, tick: Tick) -> bool:
        """Reduces the lists of a sum to visible ones; false where nothing can be in the way."""
        particles, occlusion = self.sums.particles, self.sums.occlusion
        if occlusion is not None and self.settings.visibility == "cells":
            occlusion.find_cells(fmm, tick)
            return True
        # A group of triangles has no exact form factor: what is near is found by rays.
        clear = fmm.n_blockers() == 0 and self.sums.medium.is_clear and not self._boxes
        if clear and particles.whole.all():
            return False
        tick(0.2)
        weights, radii = particles.visibility_weights, particles.of_points(particles.radii)
        effort, known = _effort(rays), (particles.weights, weights, self.sums.reach, self.sums.coarse, radii)
        occlusion.occlude(fmm, known, (particles.patches, particles.rule), effort, self._boxes)
        occlusion.trace(fmm, self.sums.surface, points, effort[-1], tick)
        return True


def particle_rays(settings: Settings, count: int) -> float:
    """Rays of each of so many particles: what single ones of many get wrong averages out in what they send."""
    return least_rays(min(1.0, (MANY / count) ** 0.5 / EXCHANGE_SHARE) * settings.rays)


def least_rays(rays: float) -> float:
    """So many, or as many as anything gets."""
    return max(LEAST_RAYS, rays)


def _effort(rays: float) -> tuple[float, float, float, float, int]:
    """Effort for visibility, as `VisibilityOptions` of the core has it."""
    aimed = AIMED * rays * max(1.0, RAYS / rays) ** TO_EMITTERS
    runs = min(1.0, (200 / aimed) ** 0.5)
    return 0.8 / aimed, 0.4, 0.8 * runs, 0.1 * runs, round(HEMISPHERE * rays)
