# SPDX-License-Identifier: GPL-3.0-or-later
"""What accuracy costs in one scene: error against time over rays, p and s, and the settings to recommend."""

import math
import time
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .progress import Progress, part, ticker
from .scene import Scene
from .settings import Settings
from .solver import solve

Points = NDArray[np.float64]

#: What is tried: rays first, then p with the best of them, then s with the best of both.
ALL_RAYS, ALL_TRUNCATIONS, ALL_GROUPINGS = (
    (25, 50, 100, 200, 400, 800, 1600),
    (0, 1, 2, 3, 4, 6),
    (16, 32, 64, 128, 256),
)
#: The paper's settings, and the rays that they are tried with.
PAPER, PAPER_RAYS = {"truncation": 2, "expansion": "paper", "method": "fmm"}, (50, 200, 800)
#: Triangles from which on brute force takes too long.
MOST_DIRECT = 20_000
#: Points that are judged; rays of each kind that find what is true at each of them, and from all particles together.
JUDGED, TRUTH_RAYS, TRUTH_PARTICLE_RAYS = 1000, 2048, 2_000_000
#: The solution that they begin from.
TRUTH = {"method": "fmm", "truncation": 8, "rays": 1600, "probes": 0, "target_error": None}
#: The error that is good enough where the settings name none.
TARGET = 0.01
#: Errors are alike up to this factor.
ALIKE = 1.1
#: A bake that is done sooner is repeated, so many times at most; the fastest counts.
ENOUGH_SECONDS, MOST_REPEATS = 2.0, 3
#: Truth and brute force count for so many bakes in the progress.
LONG = 4


@dataclass(frozen=True)
class Bake:
    """One bake of a study.

    series    "rays", "p", "s", "paper", "brute force", or that of another program
    seconds   of the whole bake; error: relative L2 over the points that were judged
    the rest  the settings in use, as far as the series has them; samples: of each point, of a path tracer
    """

    series: str
    seconds: float
    error: float
    truncation: int | None = None
    grouping: int | None = None
    particles: int | None = None
    rays: int | None = None
    samples: int | None = None


@dataclass(frozen=True)
class Study:
    """bakes: all of them; best: the one to recommend, and why, in a sentence; target: the error that was wanted;
    skipped: what was left out, and why.
    """

    bakes: tuple[Bake, ...]
    best: Bake
    why: str
    target: float
    skipped: tuple[str, ...] = ()


@dataclass(frozen=True)
class Judge:
    """What is true at some of the points: their rows (J,), and two independent estimates (2, J, 3), W/m^2."""

    rows: NDArray[np.int64]
    truth: Points

    def error(self, found: Points) -> float:
        """Relative L2 error of irradiance (J, 3) at those points; the noise of the estimates drops out."""
        one, other = self.truth
        scale, squared = (one * other).sum(), ((found - one) * (found - other)).sum()
        return float(np.sqrt(max(0.0, squared) / scale)) if scale > 0 else 0.0


def judge(
    scene: Scene,
    settings: Settings,
    points: ArrayLike,
    normals: ArrayLike,
    rows: ArrayLike,
    progress: Progress | None = None,
) -> Judge:
    """What very many rays find at some of the points with normals (M, 3), of which `rows` may be chosen.

    progress as in `solve`; raises `Error` as `solve` does.
    """
    rows = np.asarray(rows, np.int64)
    rows = np.sort(np.random.default_rng(0).choice(rows, min(JUDGED, len(rows)), replace=False))
    solution = solve(scene, replace(settings, **TRUTH), part(progress, 0.0, 0.5))
    at, tick = (np.asarray(points)[rows], np.asarray(normals)[rows]), ticker(progress, 0.5, 1.0, "Finding the truth")
    return Judge(rows, solution.estimates(*at, TRUTH_RAYS, TRUTH_PARTICLE_RAYS, tick))


def study(
    scene: Scene,
    settings: Settings,
    points: ArrayLike,
    normals: ArrayLike,
    judge: Judge,
    progress: Progress | None = None,
) -> Study:
    """Bakes the scene at points with normals (M, 3) again and again, with other rays, then p, then s.

    What the settings say of anything else holds for all bakes. progress as in `solve`; raises `Error` as `solve` does.
    """
    points, normals = np.asarray(points, float), np.asarray(normals, float)
    target, few = settings.target_error or TARGET, len(scene.triangles) <= MOST_DIRECT
    base = replace(settings, method="fmm", rays=None, truncation=None, grouping=None, target_error=None, probes=0)
    base = replace(base.begin(), particles=settings.particles)
    steps = len(ALL_RAYS) + len(ALL_TRUNCATIONS) + len(ALL_GROUPINGS) + len(PAPER_RAYS) + LONG * few
    bakes: list[Bake] = []

    def bake(series: str, **options: object) -> Bake:
        used, done = replace(base, **options), len(bakes)
        share = LONG if used.method == "direct" else 1
        step = part(progress, done / steps, (done + share) / steps)
        bakes.append(_bake(series, scene, used, points, normals, judge, step))
        return bakes[-1]

    best = _fewest([bake("rays", rays=rays) for rays in ALL_RAYS], target)
    chosen = {"rays": best.rays}
    best = _fewest([bake("p", truncation=p, **chosen) for p in ALL_TRUNCATIONS], target)
    chosen["truncation"] = best.truncation
    best = _fastest([bake("s", grouping=s, **chosen) for s in ALL_GROUPINGS], target)
    for rays in PAPER_RAYS:
        bake("paper", rays=rays, **PAPER)
    skipped = ()
    if few:
        best = _fastest([best, bake("brute force", method="direct")], target)
    else:
        skipped = (f"brute force: {len(scene.triangles):,} triangles are too many, the most is {MOST_DIRECT:,}",)
    return Study(tuple(bakes), best, _why(best, target), target, skipped)


def _bake(
    series: str,
    scene: Scene,
    used: Settings,
    points: Points,
    normals: Points,
    judge: Judge,
    progress: Progress | None,
) -> Bake:
    """One bake. By brute force light is gathered at the judged points only, and its seconds counted as for all."""
    direct, least, began, steps = used.method == "direct", math.inf, time.perf_counter(), MOST_REPEATS
    rows = judge.rows if direct else slice(None)
    for done in range(steps):
        start = time.perf_counter()
        solution = solve(scene, used, part(progress, done / steps, (done + 0.5) / steps))
        gathering = time.perf_counter()
        found = solution.irradiance(
            points[rows], normals[rows], part(progress, (done + 0.5) / steps, (done + 1) / steps)
        )
        end = time.perf_counter()
        least = min(least, gathering - start + (end - gathering) * len(points) / len(found))
        if end - began > ENOUGH_SECONDS:
            break
    error = judge.error(found if direct else found[judge.rows])
    own = {} if direct else {"truncation": used.truncation, "grouping": solution.grouping, "rays": used.rays}
    return Bake(series, least, error, particles=solution.report["counts"]["particles"], **own)


def _enough(bakes: list[Bake], target: float) -> list[Bake]:
    """Those that meet the target; where none does, those that are about as exact as the most exact one."""
    least = min(bake.error for bake in bakes)
    return [bake for bake in bakes if bake.error <= max(target, ALIKE * least)]


def _fewest(bakes: list[Bake], target: float) -> Bake:
    """The first that will do, of a series in which each takes more than the one before."""
    return _enough(bakes, target)[0]


def _fastest(bakes: list[Bake], target: float) -> Bake:
    return min(_enough(bakes, target), key=lambda bake: bake.seconds)


def _why(best: Bake, target: float) -> str:
    """Why a bake is recommended."""
    wanted = f"{100 * target:g} %"
    if best.error > target:
        why = f"nothing meets {wanted}, more rays or a larger p are hardly better"
    elif best.series == "brute force":
        why = f"the scene is so small that brute force is the fastest way to {wanted}"
    else:
        why = f"the fewest rays that meet {wanted}, then the least p and the fastest s"
    return f"{settings_text(best)}: error {100 * best.error:.2g} % in {best.seconds:.2g} s; {why}"


def settings_text(bake: Bake) -> str:
    """The settings of a bake in words."""
    if bake.series == "brute force":
        return "method direct"
    if bake.rays is None:
        return f"{bake.samples} samples"
    return f"p = {bake.truncation}, s = {bake.grouping}, {bake.rays} rays"
