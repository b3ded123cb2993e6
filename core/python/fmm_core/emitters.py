# SPDX-License-Identifier: GPL-3.0-or-later
"""Strong emitters as the ends of rays that are aimed at them."""

import numpy as np
from numpy.typing import NDArray

from . import _binding
from .particles import Particles
from .scene import Scene

Points = NDArray[np.float64]

#: Patches that reflect more light of lamps than this many times the mean are aimed at, the most powerful of them.
BRIGHT, MOST_BRIGHT = 5.0, 1000
#: The number of the emitter of a particle that is on none.
NONE = np.uint32(2**32 - 1)


class Emitters:
    """The patches that emit strongly, to be chosen by their power.

    patches      (E,) rows of the particles' patches; cumulative (E,): the share of all power up to each of them
    density      (N + 1,) per area, with which a chosen point is on a particle's patch; the last one is for no particle
    """

    def __init__(self, scene: Scene, particles: Particles) -> None:
        power = _powers(scene, particles)
        self.patches = np.flatnonzero(power)
        total = power.sum()
        self.cumulative: Points = np.cumsum(power[self.patches] / total)
        density = np.zeros(len(power))
        density[self.patches] = power[self.patches] / total / particles.areas[self.patches]
        self.density: Points = np.append(particles.of_points(density), 0.0)

    def __len__(self) -> int:
        return len(self.patches)


def choosable(scene: Scene, particles: Particles, direct: Points) -> _binding.Emitters:
    """The same, and patches that stand out by what they reflect of their irradiance `direct` (N, 3) from lamps, to be
    chosen by what they send to each point. Neighbours follow each other, so that what is even over all power is even
    over the surfaces: that tells few rays more of irradiance, less of a narrow gloss.
    """
    reflected = _reflected(scene, particles, direct)
    patches = np.flatnonzero((_powers(scene, particles) > 0) | reflected.any(axis=1))
    if len(patches):
        centres = particles.patches[patches].mean(axis=1)
        patches = patches[_binding.tree_order(centres, particles.normals[patches * particles.per_patch])]
    points = patches * particles.per_patch
    triangles = particles.triangle[points]
    opacity = np.ones(len(patches)) if scene.opacity is None else scene.opacity.mean[triangles]
    number = np.full(len(particles.patches), NONE)
    number[patches] = np.arange(len(patches))
    shapes = particles.patches[patches], particles.normals[points], particles.areas[patches], particles.radii[patches]
    sent = scene.emission[triangles] + reflected[patches]
    return _binding.Emitters(shapes, sent, opacity, particles.of_points(number))


def _reflected(scene: Scene, particles: Particles, direct: Points) -> Points:
    """(P, 3) W/m^2 that patches reflect of light from lamps, where that is much more than the mean over all; else 0."""
    of_points = particles.of_triangles(scene.albedo) * direct
    reflected = of_points.reshape(-1, particles.per_patch, 3).mean(axis=1)
    brightness = reflected.mean(axis=1)
    mean = (brightness * particles.areas).sum() / particles.areas.sum()
    power = np.where(brightness > BRIGHT * mean, brightness * particles.areas, 0.0)
    few = np.argsort(power, kind="stable")[:-MOST_BRIGHT]
    reflected[(power == 0) | np.isin(np.arange(len(power)), few)] = 0.0
    return reflected


def _powers(scene: Scene, particles: Particles) -> Points:
    """(P,) W of each patch, all colours alike; 0 for those that do not emit strongly."""
    emission = scene.emission[particles.triangle[:: particles.per_patch]].mean(axis=1)
    return particles.areas * emission * particles.emits[:: particles.per_patch]
