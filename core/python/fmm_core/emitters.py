# SPDX-License-Identifier: GPL-3.0-or-later
"""Strong emitters as the ends of rays that are aimed at them, more of them where more light comes from."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from . import _binding
from .particles import Particles
from .scene import Scene

Points = NDArray[np.float64]

#: Share of the rays of a point that choose emitters by their power alone, wherever these are.
BLIND = 0.25


class Choice(NamedTuple):
    """How likely each emitter (E,) is chosen from each of some points (M,), or (1,) where all choose alike.

    density   (M, E) per area of the emitter
    ends      (M * E,) of the shares of the emitters, added up, and the number of the point
    """

    density: Points
    ends: Points

    @classmethod
    def of(cls, chances: Points, areas: Points) -> "Choice":
        """By chances (M, E) that add up to anything but 0."""
        ends = np.cumsum(chances, axis=1)
        total = ends[:, -1:].copy()
        ends /= total
        return cls(chances / total / areas, (ends + np.arange(len(ends))[:, None]).ravel())

    def emitters(self, rows: NDArray[np.int64], at: Points) -> NDArray[np.int64]:
        """(K,) which are chosen from points (K,) by numbers (K,) even in [0, 1)."""
        count = self.density.shape[1]
        return np.clip(np.searchsorted(self.ends, rows + at, side="right") - rows * count, 0, count - 1)


class Emitters:
    """The patches that emit strongly, to be chosen by their power; by_place: neighbours follow each other, so that what
    is even over all power is even over the surfaces. That tells few rays more of irradiance, less of a narrow gloss.

    patches      (E,) rows of the particles' patches; corners (E, 3, 3) and normals (E, 3) of these; cumulative (E,):
                 the share of all power up to each of them
    density      (N + 1,) per area, with which a chosen point is on a particle's patch; the last one is for no particle
    number       (N + 1,) of the patch of each particle among `patches`, for those that have one
    """

    def __init__(self, scene: Scene, particles: Particles, by_place: bool = False) -> None:
        of_patches = particles.triangle[:: particles.per_patch]
        power = particles.areas * scene.emission[of_patches].mean(axis=1) * particles.emits[:: particles.per_patch]
        patches = np.flatnonzero(power)
        if by_place and len(patches):
            centres = particles.patches[patches].mean(axis=1)
            patches = patches[_binding.tree_order(centres, particles.normals[patches * particles.per_patch])]
        self.patches = patches
        power = power[self.patches]
        self.cumulative: Points = np.cumsum(power / power.sum())
        self._power, self._areas, self._radii = power, particles.areas[patches], particles.radii[patches]
        self.corners = np.ascontiguousarray(particles.patches[patches])
        self.normals = np.ascontiguousarray(particles.normals[patches * particles.per_patch])
        self._centres = self.corners.mean(axis=1)
        density = np.zeros(len(of_patches))
        density[self.patches] = power / power.sum() / particles.areas[self.patches]
        self.density: Points = np.append(particles.of_points(density), 0.0)
        number = np.zeros(len(of_patches), np.int64)
        number[self.patches] = np.arange(len(self.patches))
        self.number: NDArray[np.int64] = np.append(particles.of_points(number), 0)

    def __len__(self) -> int:
        return len(self.patches)

    def anywhere(self) -> Choice:
        """Chosen by their power, from all points alike."""
        return Choice.of(self._power[None], self._areas)

    def around(self, points: Points, normals: Points) -> tuple[Choice, Choice]:
        """Chosen by what they would send to points with normals (M, 3) if nothing were in the way, and to places near
        these, wherever they face.
        """
        between = self._centres - points[:, None]
        distances = np.maximum(np.linalg.norm(between, axis=2), self._radii)
        # Those whose centres lie behind the horizon may reach above it.
        there = np.maximum(self._radii - np.einsum("mex,ex->me", between, self.normals), 0.0)
        here = np.maximum(self._radii + np.einsum("mex,mx->me", between, normals), 0.0)
        near = self._power * there / distances**3
        return self._mostly(near * here / distances), self._mostly(near)

    def _mostly(self, chances: Points) -> Choice:
        most = np.maximum(chances.sum(axis=1, keepdims=True), np.finfo(float).tiny)
        return Choice.of(BLIND * self._power / self._power.sum() + (1 - BLIND) * chances / most, self._areas)
