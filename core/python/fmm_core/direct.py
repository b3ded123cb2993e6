# SPDX-License-Identifier: GPL-3.0-or-later
"""The direct method: every receiver sums over every particle, the reference that judges everything else."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from . import _binding
from .errors import Cancelled, Error
from .particles import Particles
from .visibility import Occlusion

#: Bytes of visibility bits that one block of receivers may take when they are not kept.
BLOCK_BYTES = 1 << 26


class DirectOperator:
    """Irradiance at fixed receivers as a linear function of the particles' radiosity, occlusion included."""

    def __init__(
        self,
        space: "DirectSpace",
        points: NDArray[np.float64],
        normals: NDArray[np.float64],
        symmetric: bool,
        tick: Callable[[float], bool] | None = None,
    ) -> None:
        self._space, self._points, self._normals = space, points, normals
        occlusion, particles = space.occlusion, space.particles
        self._visible = occlusion.visible_pairs(points, normals, space.sources, symmetric, tick)
        near = _binding.NearField(points, normals, particles.patches, space.reach)
        rows = np.repeat(np.arange(len(points)), np.diff(near.starts()).astype(np.int64))
        patch_normals = particles.normals[near.patches() * particles.per_patch]
        seen = occlusion.visible_targets(points[rows], normals[rows], near.targets(), patch_normals)
        fractions = seen.astype(np.float64)
        self._correction = _binding.Correction(near, points, normals, space.sources, fractions, self._visible)

    def apply(self, radiosity: NDArray[np.float64]) -> NDArray[np.float64]:
        """Irradiance (M, 3) at the receivers for the particles' radiosity (N, 3), both W/m^2."""
        strengths = self._space.particles.weights[:, None] * radiosity
        irradiance = self._space.sources.irradiance(self._points, self._normals, strengths, self._visible)
        self._correction.add(strengths, irradiance)
        # The correction subtracts what the sum has added; rounding must not leave a negative rest.
        return np.maximum(irradiance, 0.0)


class DirectSpace:
    """Particles and occlusion of one scene, from which operators for any receivers are made."""

    def __init__(self, particles: Particles, occlusion: Occlusion, near_reach: float) -> None:
        self.particles, self.occlusion = particles, occlusion
        self.reach = near_reach * particles.radii
        self.sources = _binding.Sources(
            particles.positions, particles.normals, particles.softening, particles.areas, particles.per_patch
        )

    def exchange(self, tick: Callable[[float], bool] | None = None) -> DirectOperator:
        """The operator from the particles to themselves."""
        try:
            return DirectOperator(self, self.particles.positions, self.particles.normals, True, tick)
        except MemoryError:
            raise Error(f"particles: no memory for the direct method with {len(self.particles)} of them") from None

    def gather(
        self,
        points: NDArray[np.float64],
        normals: NDArray[np.float64],
        radiosity: NDArray[np.float64],
        tick: Callable[[float], bool] | None = None,
    ) -> NDArray[np.float64]:
        """Irradiance (M, 3) at any points, block by block, so that memory stays bounded."""
        size = max(1, BLOCK_BYTES // (8 * self.sources.words))
        irradiance = np.zeros((len(points), 3))
        for start in range(0, len(points), size):
            rows = slice(start, start + size)
            irradiance[rows] = DirectOperator(self, points[rows], normals[rows], False).apply(radiosity)
            if tick is not None and tick(min(1.0, (start + size) / len(points))) is False:
                raise Cancelled
        return irradiance
