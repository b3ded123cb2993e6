# SPDX-License-Identifier: GPL-3.0-or-later
"""What of a lamp's light gets to patches as a whole: a window or a cone makes spots that are smaller than they are."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from . import patterns
from .lights import Light
from .particles import Particles
from .places import Places
from .progress import Tick, silent
from .visibility import BATCH, Occlusion

Points = NDArray[np.float64]

#: Rays to a lamp from random places of a patch that tell whether all of it gets the same share, at least and at most,
#: and from all patches together.
FEWEST_FIRST, MOST_FIRST, FIRST = 4, 256, 200_000
#: The same, where it matters whether a patch has a spot anywhere.
TO_FIND = 512
#: Rays from a patch that gets its light in part, at most, and from all of these together for each of the settings.
MOST, ALL_RAYS = 4096, 10_000
#: Shares that differ by less are the same.
SAME = 1e-3


class PatchLamps:
    """Shares of lamps' light that get to the patches of particles, through what is in the way."""

    def __init__(self, particles: Particles, occlusion: Occlusion | None, rays: float) -> None:
        """rays: of each particle, in the settings."""
        triangles = particles.patches if occlusion is None else occlusion.triangles
        self._places, self._occlusion, self._rays = Places.of(triangles, particles), occlusion, rays

    def shares(self, light: Light, shadows: bool, tick: Tick) -> tuple[Points, NDArray[np.bool_]]:
        """(P,) of what would get to each patch with nothing in the way, and without a cone; and whether it differs from
        one of its places to the next.
        """
        count = len(self._places.triangles)
        shares, again, every = np.empty(count), np.zeros(count, bool), np.arange(count)
        few = int(np.clip(FIRST // count, FEWEST_FIRST, MOST_FIRST))

        def first(block: slice) -> int:
            shares[block], again[block], asked = self._asked(light, every[block], few, shadows)
            return asked

        run_rows(self._occlusion, first, count, few, tick)
        partly = np.flatnonzero(again)
        rays = int(np.clip(ALL_RAYS * self._rays / max(1, len(partly)), 2 * few, MOST))

        def second(block: slice) -> int:
            shares[partly[block]], _, asked = self._asked(light, partly[block], rays, shadows)
            return asked

        run_rows(self._occlusion, second, len(partly), rays, tick)
        return shares, again

    def divided(self, light: Light, rows: NDArray[np.int64]) -> NDArray[np.bool_]:
        """(R,) whether some patches get their light in part."""
        found = np.zeros(len(rows), bool)

        def ask(block: slice) -> int:
            _, found[block], asked = self._asked(light, rows[block], TO_FIND, True)
            return asked

        run_rows(self._occlusion, ask, len(rows), TO_FIND)
        return found

    def _asked(
        self, light: Light, rows: NDArray[np.int64], rays: int, shadows: bool
    ) -> tuple[Points, NDArray[np.bool_], int]:
        """(R,) the shares of some patches by so many rays of each, whether these differ, and how many were traced."""
        rng = np.random.default_rng([rays, rows[0]])
        _, points, normals = self._places.random(rows, rays, rng)
        weights, passed, asked = sent(light, points, normals, rng, self._occlusion if shadows else None)
        weights = (weights * light.scale(points)).reshape(len(rows), -1)
        passed = passed.reshape(len(rows), -1)
        sums = weights.sum(axis=1)
        shares = (weights * passed).sum(axis=1) / np.where(sums > 0, sums, 1.0)
        most, least = (np.where(weights > 0, passed, side) for side in (0.0, 1.0))
        return shares, most.max(axis=1) - least.min(axis=1) > SAME, asked


def run_rows(
    occlusion: Occlusion | None, work: Callable[[slice], int], count: int, each: int, tick: Tick = silent
) -> None:
    """Runs `work` on all of so many rows, where each takes so many rays."""
    size = max(1, BATCH // each)
    if occlusion is not None:
        occlusion.run_blocks(work, count, size, tick)
        return
    for start in range(0, count, size):
        work(slice(start, min(start + size, count)))
        tick(min(1.0, (start + size) / count))


def sent(
    light: Light, points: Points, normals: Points, rng: np.random.Generator, occlusion: Occlusion | None
) -> tuple[Points, Points, int]:
    """For a random point of a lamp for each receiver (M, 3) with normals (M, 3), of what it brings without any cone
    (M,), which share arrives (M,) through what is in the way; and how many rays were traced, to be called by what
    `run_blocks` runs.
    """
    numbers = patterns.sequence(len(points), rng.random(2), patterns.R2)[:, None]
    if light.is_round:
        numbers = numbers * [1.0, 2 * np.pi]
    samples = light.samples(points, normals, numbers)
    weights, passed = samples.weights[:, 0], samples.cones[:, 0].copy()
    if occlusion is None:
        return weights, passed, 0
    asked = np.flatnonzero((weights > 0) & (passed > 0))
    ends = points[asked], normals[asked], samples.directions[asked, 0], samples.distances[asked, 0]
    passed[asked] *= occlusion.transmitted(*ends)
    return weights, passed, len(asked)
