# SPDX-License-Identifier: GPL-3.0-or-later
"""The measured error of a solve: a few random probes, each summed directly."""

import numpy as np
from numpy.typing import NDArray

from . import _binding
from .settings import Settings
from .transport import Operator, Sums


def measure(
    exchange: Operator, sums: Sums, radiosity: NDArray[np.float64], settings: Settings
) -> dict[str, float | int | None]:
    """Relative error of the irradiance at random particles, by area, against the direct sum at the same ones.

    measured_rms   relative L2 error over the probes; measured_max   largest error of a probe, relative to their RMS
    irradiance; bound   the paper's bound (section 2.2) for the two nearest boxes that exchange light by expansions,
    relative to the largest irradiance that the source box can send there
    """
    particles = sums.particles
    rng = np.random.default_rng(0)
    share = particles.weights / particles.weights.sum()
    chosen = rng.choice(len(particles), size=settings.probes, p=share)
    found = exchange.apply(radiosity)[chosen]
    exact = sums.direct_operator(particles.positions[chosen], particles.normals[chosen]).apply(radiosity)
    errors, scale = np.linalg.norm(found - exact, axis=1), np.sqrt((exact**2).sum(axis=1).mean())
    relative = errors / scale if scale > 0 else errors
    return {
        "measured_rms": float(np.sqrt((relative**2).mean())),
        "measured_max": float(relative.max()),
        "probes": settings.probes,
        "bound": nearest_bound(settings.truncation, settings.separation),
    }


def nearest_bound(truncation: int, separation: int) -> float:
    """The bound of section 2.2 for boxes `separation` + 1 sides apart, relative to strength / (pi r_x^2)."""
    # In half sides: sources reach the corners of their box, receivers start at the near face of theirs.
    source_radius, receiver_distance = np.sqrt(3.0), 2.0 * separation + 1.0
    bound = _binding.error_bound(truncation, 1.0, source_radius, receiver_distance)
    return float(bound * np.pi * receiver_distance**2)
