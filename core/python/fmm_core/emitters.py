# SPDX-License-Identifier: GPL-3.0-or-later
"""Strong emitters as the ends of rays that are aimed at them, more of them where more light comes from."""

import numpy as np
from numpy.typing import NDArray

from . import _binding
from .particles import Particles
from .scene import Scene

Points = NDArray[np.float64]


class Emitters:
    """The patches that emit strongly, to be chosen by their power; by_place: neighbours follow each other, so that what
    is even over all power is even over the surfaces. That tells few rays more of irradiance, less of a narrow gloss.

    patches      (E,) rows of the particles' patches; cumulative (E,): the share of all power up to each of them
    density      (N + 1,) per area, with which a chosen point is on a particle's patch; the last one is for no particle
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
        density = np.zeros(len(of_patches))
        density[self.patches] = power / power.sum() / particles.areas[self.patches]
        self.density: Points = np.append(particles.of_points(density), 0.0)

    def __len__(self) -> int:
        return len(self.patches)
