# SPDX-License-Identifier: GPL-3.0-or-later
"""The measured error of a solve: a few random probes, each found once more with very many rays."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from . import _binding
from .multipole import MultipoleSpace
from .settings import Settings
from .transport import Sums

Points = NDArray[np.float64]

#: Rays over the hemisphere of a probe: their own error is a fifth of that of a bake with a few hundred.
PROBE_RAYS = 4096
#: Probes traced at once: bounds memory.
PROBES_PER_BLOCK = 64
#: From one ray to the next, of a whole turn (Vogel's spiral).
GOLDEN = 0.5 * (np.sqrt(5.0) - 1.0)


def measure(
    found: Points,
    space: MultipoleSpace,
    radiosity: Points,
    points: Points,
    normals: Points,
    settings: Settings,
    direct: Callable[[Points, Points], Points],
) -> dict[str, float | int | None]:
    """Relative error of irradiance (M, 3) at random ones of the points (M, 3), against `by_rays` there, or against the
    direct sum where nothing is in the way; with what lamps and sky send, which `direct` finds once more.

    measured_rms   relative L2 error over the probes; measured_max   largest error of a probe, relative to their RMS
    irradiance; bound   the paper's bound (section 2.2) for the two nearest boxes that exchange light by expansions,
    relative to the largest irradiance that the source box can send there
    """
    rng = np.random.default_rng(0)
    chosen = rng.choice(len(points), size=min(settings.probes, len(points)), replace=False)
    sums, judged = space.sums, (points[chosen], normals[chosen])
    if space.open:
        judge = Sums(sums.particles, None, sums.near_reach).direct_operator(*judged)
        if space.lit is not None:
            judge.balanced(space.closed, space.lit)
        exact = judge.apply(radiosity)
    else:
        exact = by_rays(sums, radiosity, *judged)
    exact = exact + direct(*judged)
    errors, scale = np.linalg.norm(found[chosen] - exact, axis=1), np.sqrt((exact**2).sum(axis=1).mean())
    relative = errors / scale if scale > 0 else errors
    return {
        "measured_rms": float(np.sqrt((relative**2).mean())),
        "measured_max": float(relative.max()),
        "probes": len(chosen),
        "bound": nearest_bound(settings.truncation, settings.separation),
    }


def by_rays(sums: Sums, radiosity: Points, points: Points, normals: Points, rays: int = PROBE_RAYS) -> Points:
    """Irradiance (M, 3) from the particles' radiosity (N, 3) without any boxes, expansions or lists.

    Strong emitters count by the direct sum with a ray each; everything else by rays over the hemisphere, evenly by
    cosine, each of which counts with the radiosity of what it meets.
    """
    emits = sums.particles.emits
    irradiance = np.zeros((len(points), 3))
    if emits.any():
        emitters = Sums(sums.particles.only(emits), sums.occlusion, sums.near_reach)
        irradiance += emitters.direct_operator(points, normals).apply(radiosity[emits])
    reflected = np.vstack([np.where(emits[:, None], 0.0, radiosity), np.zeros((1, 3))])
    for start in range(0, len(points), PROBES_PER_BLOCK):
        rows = slice(start, start + PROBES_PER_BLOCK)
        met = sums.occlusion.met_over_hemispheres(
            points[rows], _spiral(normals[rows], rays), normals[rows], sums.surface
        )
        irradiance[rows] += reflected[met].mean(axis=1)
    return irradiance


def _spiral(normals: Points, count: int) -> Points:
    """(M, count, 3) directions about unit normals (M, 3), even by cosine, turned for each at random."""
    rng = np.random.default_rng(1)
    shift, turn = rng.random((2, len(normals), 1))
    k = np.arange(count)
    radius, angle = np.sqrt((k + shift) / count), 2 * np.pi * (GOLDEN * k + turn)
    axis = np.where(np.abs(normals[:, :1]) > 0.6, [[0.0, 1.0, 0.0]], [[1.0, 0.0, 0.0]])
    s = np.cross(normals, axis)
    s /= np.linalg.norm(s, axis=1, keepdims=True)
    x, y, z = radius * np.cos(angle), radius * np.sin(angle), np.sqrt(1 - radius**2)
    return x[..., None] * s[:, None] + y[..., None] * np.cross(normals, s)[:, None] + z[..., None] * normals[:, None]


def nearest_bound(truncation: int, separation: int) -> float:
    """The bound of section 2.2 for boxes `separation` + 1 sides apart, relative to strength / (pi r_x^2)."""
    # In half sides: sources reach the corners of their box, receivers start at the near face of theirs.
    source_radius, receiver_distance = np.sqrt(3.0), 2.0 * separation + 1.0
    bound = _binding.error_bound(truncation, 1.0, source_radius, receiver_distance)
    return float(bound * np.pi * receiver_distance**2)
