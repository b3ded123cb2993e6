# SPDX-License-Identifier: GPL-3.0-or-later
"""What a fast multipole sum costs: seconds as a function of p, s and N, from unit costs measured on this machine."""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from . import _binding
from .settings import Settings

#: Grouping factors that an automatic choice is made from.
GROUPINGS = (16, 32, 64, 128, 256, 512, 1024)
#: Work is counted on about this many of the points, with s reduced in proportion: the tree keeps its shape.
SAMPLE = 100_000
#: The least such s: fewer points in a leaf say nothing of the leaves of the whole tree.
LEAST_REDUCED = 4
#: Smaller leaves are not tried once they cost this many times the least.
GIVE_UP = 1.5
#: Points of the calibration, and the grouping factors of its trees: few large leaves, and many small ones.
CALIBRATION, CALIBRATED = 20_000, (512, 96, 16)
#: What each pass goes through, by the names of `Fmm.counts`, each at a cost of its own.
WORK = {
    "p2m": ("leaves", "points"),
    "m2m": ("boxes",),
    "m2l": ("batches", "interactions"),
    "p2l": ("p2l_pairs", "p2l_points"),
    "l2l": ("boxes",),
    "l2p": ("leaves", "points"),
    "m2p": ("m2p_pairs", "m2p_points"),
    "p2p": ("near_pairs", "point_pairs"),
}
#: How counts grow with the points where the boxes stay the same; the others do not.
POWERS = {"points": 1, "p2l_points": 1, "m2p_points": 1, "point_pairs": 2}

Points = NDArray[np.float64]
Units = dict[str, tuple[float, ...]]


def seconds(counts: dict[str, int], truncation: int, expansion: str, separation: int) -> float:
    """Predicted seconds of one application of an operator with these counts (those of `Fmm.counts`, and `points`)."""
    unit = unit_costs(truncation, expansion, separation)
    return sum(
        cost * counts[what] for work, names in WORK.items() for what, cost in zip(names, unit[work], strict=True)
    )


@lru_cache(maxsize=64)
def unit_costs(truncation: int, expansion: str, separation: int) -> Units:
    """Seconds of each pass for one unit of each of its works, measured on random points of a room in a moment."""
    points, normals = _room(CALIBRATION)
    strengths = np.ones_like(points)
    runs = []
    for grouping in CALIBRATED:
        fmm = _make(points, normals, grouping, truncation, expansion, separation)
        fmm.apply(strengths)
        timed = [dict(fmm.apply(strengths)[1]) for _ in range(2)]
        counts = fmm.counts() | {"points": len(points)}
        runs.append((counts, {work: min(passes[work] for passes in timed) for work in WORK}))
    return {work: _fitted(names, [(counts, passes[work]) for counts, passes in runs]) for work, names in WORK.items()}


def _fitted(names: tuple[str, ...], runs: list[tuple[dict[str, int], float]]) -> tuple[float, ...]:
    """Costs of the named counts that explain the seconds best, each relative to itself, and none of them negative."""
    rows = np.array([[counts[name] / took for name in names] for counts, took in runs if counts[names[0]] > 0])
    if len(rows) == 0:
        return (0.0,) * len(names)
    costs = np.linalg.lstsq(rows, np.ones(len(rows)), rcond=None)[0]
    if len(names) > 1 and costs.min() <= 0:
        kept = int(costs.argmax())
        costs = np.zeros(len(names))
        costs[kept] = np.linalg.lstsq(rows[:, [kept]], np.ones(len(rows)), rcond=None)[0][0]
    return tuple(float(cost) for cost in costs)


def predicted_counts(
    points: Points, normals: Points, grouping: int, truncation: int, expansion: str, separation: int
) -> dict[str, int]:
    """Counts of the tree and the lists of all points, from those of an even sample."""
    (sample, directions), share = even_sample(points, normals)
    return _counts(sample, directions, share, grouping, truncation, expansion, separation)


def even_sample(points: Points, normals: Points) -> tuple[tuple[Points, Points], float]:
    """Every k-th point in the order of an octree, so that each box keeps its share; and that share."""
    step = max(1, round(len(points) / SAMPLE))
    if step == 1:
        return (points, normals), 1.0
    chosen = _binding.tree_order(points, normals)[step // 2 :: step]
    return (points[chosen], normals[chosen]), len(chosen) / len(points)


def _counts(
    points: Points, normals: Points, share: float, grouping: int, truncation: int, expansion: str, separation: int
) -> dict[str, int]:
    reduced = max(1, round(grouping * share))
    fmm = _make(points, normals, reduced, truncation, expansion, separation, share)
    counts = fmm.counts() | {"points": len(points)}
    return {name: round(count / share ** POWERS.get(name, 0)) for name, count in counts.items()}


def choose_grouping(points: Points, normals: Points, settings: Settings) -> int:
    """The s of `GROUPINGS` that makes one application cheapest, of those that the sample can tell about."""
    chosen = settings.truncation, settings.expansion_in_use, settings.separation
    sample, share = even_sample(points, normals)

    best, least = GROUPINGS[-1], np.inf
    # From few large leaves down: where no box can be expanded, small leaves take ever longer to count.
    for grouping in (s for s in reversed(GROUPINGS) if s * share >= LEAST_REDUCED):
        cost = seconds(_counts(*sample, share, grouping, *chosen), *chosen)
        if cost > GIVE_UP * least:
            break
        if cost < least:
            best, least = grouping, cost
    return best


def _make(
    points: Points,
    normals: Points,
    grouping: int,
    truncation: int,
    expansion: str,
    separation: int,
    share: float = 1.0,
) -> _binding.Fmm:
    softening = np.full(len(points), 1e-12)
    return _binding.Fmm((points, normals), softening, None, truncation, grouping, None, separation, expansion, share)


def _room(count: int) -> tuple[Points, Points]:
    """Random points on the inside of the unit cube, with their normals."""
    rng = np.random.default_rng(0)
    points, face = rng.random((count, 3)), rng.integers(0, 6, count)
    points[np.arange(count), face % 3] = face // 3
    return points, np.eye(3)[face % 3] * (1.0 - 2.0 * (face // 3))[:, None]
