# SPDX-License-Identifier: GPL-3.0-or-later
"""Bright spots of lamps: patches that their rims divide are cut, so that light near by comes from the right side."""

import numpy as np
from numpy.typing import NDArray

from .cutting import bisected
from .direct_light import Receivers
from .particles import Particles
from .patch_lamps import PatchLamps
from .scene import Scene
from .visibility import Occlusion

Rows = NDArray[np.int64]

#: Patches are cut that would reflect more of a lamp's light than this many times the mean light of all.
BRIGHT = 2.5
#: So many times at most, and until there are so many more particles: a share of all, or a number.
CUTS, MORE, FEW_MORE = 10, 0.5, 4000
#: Rays of each particle that tell the mean light of all.
MEAN_RAYS = 16


def cut_by_spots(scene: Scene, particles: Particles, occlusion: Occlusion, rays: float) -> tuple[Particles, list[Rows]]:
    """Particles whose patches are cut in two again and again where the rim of a bright spot divides them; and which of
    the patches were cut, one time after the other. rays: of each particle, in the settings.
    """
    cuts: list[Rows] = []
    if not any(light.shadows for light in scene.lights) or not scene.albedo.any():
        return particles, cuts
    # What is asked here is not asked again where the cuts are known.
    apart = occlusion.apart()
    least = BRIGHT * _mean_light(scene, particles, apart)
    rows, most = np.arange(len(particles.areas)), len(particles) + max(MORE * len(particles), FEW_MORE)
    for _ in range(CUTS):
        rows = _divided(scene, particles, rows, PatchLamps(particles, apart, rays), least)
        count = len(particles.areas)
        if len(rows) == 0 or particles.per_patch * (count + len(rows)) > most:
            break
        particles = bisected(particles, rows)
        cuts.append(rows)
        rows = np.concatenate([rows, count + np.arange(len(rows))])
    occlusion.rays += apart.rays
    return particles, cuts


def _mean_light(scene: Scene, particles: Particles, occlusion: Occlusion) -> float:
    """W/m^2 that surfaces emit, and reflect of the light of lamps, all colours alike."""
    lit = Receivers(particles.positions, particles.normals, occlusion, MEAN_RAYS, particles).irradiance(scene)
    own = particles.of_triangles(scene.emission) + particles.of_triangles(scene.albedo) * lit
    return float((own.mean(axis=1) * particles.weights).sum() / particles.weights.sum())


def _divided(scene: Scene, particles: Particles, rows: Rows, patches: PatchLamps, least: float) -> Rows:
    """Those of some patches (K,) that reflect so much of a lamp's light in one part and less in another."""
    first, chosen = rows * particles.per_patch, np.zeros(len(rows), bool)
    triangles = particles.triangle[first]
    whole = particles.whole[rows] & ~scene.two_sided[triangles]
    for light in scene.lights:
        if not light.shadows or not light.colour.any():
            continue
        sent = light.without_cone.unshadowed(particles.positions[first], particles.normals[first])
        reflected = (sent[:, None] * light.colour * scene.albedo[triangles]).mean(axis=1)
        at = np.flatnonzero(whole & ~chosen & (reflected > least))
        chosen[at] = patches.divided(light, rows[at])
    return rows[chosen]
