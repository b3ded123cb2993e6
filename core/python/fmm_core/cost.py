# SPDX-License-Identifier: GPL-3.0-or-later
"""What a fast multipole sum costs: seconds as a function of p, s and N, from unit costs measured on this machine."""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from . import _binding
from .settings import Settings

#: Grouping factors that an automatic choice is made from.
GROUPINGS = (16, 32, 64, 128, 256, 512)
#: Work is counted on about this many of the points, with s reduced in proportion: the tree keeps its shape.
SAMPLE = 100_000
#: The least such s: fewer points in a leaf say nothing of the leaves of the whole tree.
LEAST_REDUCED = 4
#: Points of the calibration.
CALIBRATION = 20_000
#: For each pass what it goes through, by the names of `Fmm.counts`.
WORK = {
    "p2m": "points",
    "m2m": "boxes",
    "m2l": "interactions",
    "p2l": "p2l_points",
    "l2l": "boxes",
    "l2p": "points",
    "m2p": "m2p_points",
    "p2p": "point_pairs",
}

Points = NDArray[np.float64]


def seconds(counts: dict[str, int], truncation: int, expansion: str, separation: int) -> float:
    """Predicted seconds of one application of an operator with these counts (those of `Fmm.counts`, and `points`)."""
    unit = unit_costs(truncation, expansion, separation)
    return sum(unit[work] * counts[what] for work, what in WORK.items())


@lru_cache(maxsize=64)
def unit_costs(truncation: int, expansion: str, separation: int) -> dict[str, float]:
    """Seconds of each pass for one unit of its work, measured on random points of a room in a fraction of a second."""
    points, normals = _room(CALIBRATION)
    unit: dict[str, float] = {}
    # Both trees together give every pass something to do: few large leaves, then many small ones.
    for grouping in (256, 24):
        fmm = _make(points, normals, grouping, truncation, expansion, separation)
        strengths = np.ones_like(points)
        fmm.apply(strengths)
        passes = dict(fmm.apply(strengths)[1])
        counts = fmm.counts() | {"points": len(points)}
        for work, what in WORK.items():
            if counts[what] > 0:
                unit.setdefault(work, passes[work] / counts[what])
    return {work: unit.get(work, 0.0) for work in WORK}


def predicted_counts(
    points: Points, normals: Points, grouping: int, truncation: int, expansion: str, separation: int
) -> dict[str, int]:
    """Counts of the tree and the lists of all points, from a sample of them."""
    share = _share(points)
    chosen = np.random.default_rng(0).random(len(points)) < share
    if not chosen.any():
        chosen[:] = True
    reduced = max(1, round(grouping * share))
    fmm = _make(points[chosen], normals[chosen], reduced, truncation, expansion, separation)
    counts = fmm.counts() | {"points": int(chosen.sum())}
    # Counts of boxes stay; counts of points grow with the points, those of pairs with their square.
    powers = {"points": 1, "p2l_points": 1, "m2p_points": 1, "point_pairs": 2}
    return {name: round(count / share ** powers.get(name, 0)) for name, count in counts.items()}


def choose_grouping(points: Points, normals: Points, settings: Settings) -> int:
    """The s of `GROUPINGS` that makes one application cheapest, of those that the sample can tell about."""
    chosen = settings.truncation, settings.expansion_in_use, settings.separation

    def cost(grouping: int) -> float:
        return seconds(predicted_counts(points, normals, grouping, *chosen), *chosen)

    countable = [s for s in GROUPINGS if s * _share(points) >= LEAST_REDUCED]
    return min(countable or GROUPINGS[-1:], key=cost)


def _share(points: Points) -> float:
    return min(1.0, SAMPLE / len(points))


def _make(
    points: Points, normals: Points, grouping: int, truncation: int, expansion: str, separation: int
) -> _binding.Fmm:
    softening = np.full(len(points), 1e-12)
    return _binding.Fmm((points, normals), softening, None, truncation, grouping, None, separation, expansion)


def _room(count: int) -> tuple[Points, Points]:
    """Random points on the inside of the unit cube, with their normals."""
    rng = np.random.default_rng(0)
    points, face = rng.random((count, 3)), rng.integers(0, 6, count)
    points[np.arange(count), face % 3] = face // 3
    return points, np.eye(3)[face % 3] * (1.0 - 2.0 * (face // 3))[:, None]
