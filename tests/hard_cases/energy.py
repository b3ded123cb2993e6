# SPDX-License-Identifier: GPL-3.0-or-later
"""Where the light of a solved scene goes, and what must hold however ugly its mesh is."""

from dataclasses import dataclass

import embreex.mesh_construction
import embreex.rtcore_scene
import fmm_core
import numpy as np

#: Rays over the hemisphere of each particle, even by cosine: at least and at most, and about how many together.
LEAST, MOST, RAYS = 64, 512, 400_000
SMALL = fmm_core.Settings(particles=300, probes=0)


@dataclass(frozen=True)
class Audit:
    """Watts, the brightest colour's; irradiance (N, 3) that the particles receive."""

    solution: fmm_core.Solution
    irradiance: np.ndarray
    emitted: float
    absorbed: float
    escaped: float

    @property
    def created(self):
        """Share of the emitted light that came from nowhere; less than 0 where backs swallow some."""
        if self.emitted == 0:
            return float(self.absorbed + self.escaped > 0)
        return (self.absorbed + self.escaped) / self.emitted - 1


def audit(scene, settings=SMALL):
    """Solves a scene and follows its light; asserts that all of it is finite and none negative."""
    solution = fmm_core.solve(scene, settings)
    particles = solution.particles
    irradiance = solution.received
    some = np.random.default_rng(1).permutation(len(particles))[:100]
    asked = solution.irradiance(particles.positions[some], particles.normals[some])
    for light in (irradiance, solution.radiosity, asked):
        assert np.isfinite(light).all()
        assert light.min() >= 0
    weights, triangle = particles.weights[:, None], particles.triangle
    # What lamps and the sky send to surfaces is new light, too.
    direct = solution._exchange.lit.irradiance(solution._planned)
    emitted = (weights * (scene.emission[triangle] + direct)).sum(axis=0)
    colour = emitted.argmax()
    absorbed = (weights * (1 - scene.albedo[triangle]) * irradiance).sum(axis=0)
    leaving = weights * (scene.emission[triangle] + scene.albedo[triangle] * irradiance)
    escaped = escaping(scene, particles, leaving[:, colour])
    return Audit(solution, irradiance, emitted[colour], absorbed[colour], escaped)


def escaping(scene, particles, leaving):
    """Of the watts (N,) that leave the particles, those that meet no triangle."""
    rng = np.random.default_rng(0)
    rays = max(LEAST, min(MOST, RAYS // len(particles)))
    centre, scale = scene.centre, scene.size / 2
    embree = embreex.rtcore_scene.EmbreeScene()
    _ = embreex.mesh_construction.TriangleMesh(embree, ((scene.triangles - centre) / scale).astype(np.float32))
    normals = particles.normals
    ring = np.arange(rays)
    radius = np.sqrt((ring + rng.random((len(particles), 1))) / rays)
    angle = 2 * np.pi * (0.5 * (np.sqrt(5) - 1) * ring + rng.random((len(particles), 1)))
    across = np.cross(normals, np.where(np.abs(normals[:, :1]) > 0.6, [[0.0, 1, 0]], [[1.0, 0, 0]]))
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    other = np.cross(normals, across)
    plane = (radius * np.cos(angle))[..., None] * across[:, None] + (radius * np.sin(angle))[..., None] * other[:, None]
    directions = plane + np.sqrt(1 - radius**2)[..., None] * normals[:, None]
    origins = np.repeat((particles.positions - centre) / scale + 2e-6 * normals, rays, axis=0)
    missed = embree.run(origins.astype(np.float32), directions.reshape(-1, 3).astype(np.float32), query="OCCLUDED") != 0
    return float((leaving * missed.reshape(-1, rays).mean(axis=1)).sum())
