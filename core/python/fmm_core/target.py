# SPDX-License-Identifier: GPL-3.0-or-later
"""A wanted error: what is raised where the measured error says that it is not met."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .kept import KeptVisibility
from .progress import Progress, part, ticker
from .scene import Scene
from .settings import MOST_RAYS, POWER, RAYS, USUAL_ERROR, Settings
from .solution import Solution
from .solver import solve, solve_with

#: The error that is aimed at once more is needed, as a share of the target, for the gather and for the radiosity.
AIM, AIM_RADIOSITY = 0.8, 0.5
#: How far above the target the measured error may lie in 95 of 100 cases, and not be measured once more.
SURE = 1.2
#: Least and largest factors by which rays and particles are raised at a time.
LEAST, LARGEST = 1.3, 6.0
#: Up to so many times the usual error of so many rays the gather's is taken to be theirs.
GRAIN = 2.0
#: The error of the gather falls below this share of what it was where more rays help.
STUCK = 0.75
#: What is tried at most.
MOST_PARTICLES, MOST_TRUNCATION, MOST_ROUNDS = 300_000, 8, 6


def solve_at(
    scene: Scene,
    settings: Settings,
    points: ArrayLike,
    normals: ArrayLike,
    progress: Progress | None = None,
    kept: KeptVisibility | None = None,
    effort: float = 1.0,
    before: Solution | None = None,
) -> tuple[Solution, NDArray[np.float64]]:
    """`solve` and the irradiance (M, 3) at points with normals (M, 3), as `Solution.irradiance` finds it.

    Where the settings have a target error, what they leave open is raised until the measured error meets it; what was
    solved is kept where only the light at the points has to be found anew. `rounds` of the report tells what was tried,
    and a warning tells where the target is not met, and why.
    """
    target = settings.target_error
    several = target is not None
    solution = solve(scene, settings, _part(progress, 0, several, 0.0, 0.8), kept, before)
    irradiance = solution.irradiance(points, normals, _part(progress, 0, several, 0.8, 1.0), effort)
    rounds, earlier = solution.report["rounds"], None
    if not rounds:
        return solution, irradiance
    while not _met(rounds, target) and len(rounds) < MOST_ROUNDS:
        used, last = solution.used, rounds[-1]
        finer = better(settings, used, last, earlier)
        if finer == used:
            break
        if finer.particles == used.particles:
            earlier = last
            solution.use(finer)
        else:
            # Two solutions at a time may be too much for the memory.
            earlier, report, solution = None, solution.report, None
            solution = solve_with(scene, settings, finer, _part(progress, len(rounds), True, 0.0, 0.8), kept)
            solution.follow(report)
        irradiance = solution.irradiance(points, normals, _part(progress, len(rounds), True, 0.8, 1.0), effort)
        rounds = solution.report["rounds"]
    if rounds[-1]["measured_rms"] > target:
        why = f"after {len(rounds)} rounds" if len(rounds) == MOST_ROUNDS else "and nothing is left to raise"
        solution.warn(f"target_error {target:g} is not met: measured {rounds[-1]['measured_rms']:.2g} {why}")
    ticker(progress, 0.0, 1.0, "Measuring the error")(1.0)
    return solution, irradiance


def _met(rounds: list[dict[str, Any]], target: float) -> bool:
    """Whether the last of the rounds meets the target, and either surely or not for the first time."""
    meets = [tried["measured_rms"] <= target for tried in rounds[-2:]]
    return meets[-1] and (rounds[-1]["high"] <= SURE * target or (all(meets[:-1]) and len(meets) > 1))


def better(asked: Settings, used: Settings, last: dict[str, Any], before: dict[str, Any] | None) -> Settings:
    """Settings with which the measured error comes nearer to the target; the same where nothing is left to raise.

    asked   what is given there stays
    last    the last of the rounds, as the report has it
    before  the round before if that had the same particles
    """
    target, gathered, particles = asked.target_error, last["gathered"], used.particles or last["particles"]
    # Where it is met, but not surely, it is the error that there may be which has to come down.
    error = last["high"] if last["measured_rms"] <= target else last["measured_rms"]
    of_radiosity = max(0.0, error**2 - gathered**2) ** 0.5
    gather, radiosity = gathered / (AIM * target), of_radiosity / (AIM_RADIOSITY * target)
    # Where neither rays nor a larger p help the gather its sources are too coarse, and so many rays are not needed.
    stuck = before is not None and gathered > STUCK * before["gathered"]
    wanted = {"rays": before["rays"] if stuck else round(used.rays * _factor(gather))}
    if last["method"] == "direct":
        # Rays only go to lamps and the sky there.
        wanted["particles"] = round(particles * _factor(error / (AIM * target)))
    else:
        wanted["truncation"] = used.truncation + 1
        # Few rays that are given leave so much, and more sources for each of them would leave more.
        grain = GRAIN * USUAL_ERROR * (RAYS / used.rays) ** POWER
        grainy = asked.rays is not None and gathered < grain
        if radiosity > 1 or (stuck and not grainy):
            wanted["particles"] = round(particles * _factor(radiosity if grainy else max(radiosity, gather)))
    most = {
        "particles": MOST_PARTICLES,
        "rays": max(MOST_RAYS, used.rays),
        "truncation": max(MOST_TRUNCATION, used.truncation),
    }
    wanted = {name: min(value, most[name]) for name, value in wanted.items() if getattr(asked, name) is None}
    if wanted.get("particles", math.inf) <= particles:
        del wanted["particles"]
    return used if stuck and "particles" not in wanted else replace(used, **wanted)


def _factor(over: float) -> float:
    return min(LARGEST, max(LEAST, over ** (1 / POWER)))


def _part(progress: Progress | None, number: int, rounds: bool, start: float, end: float) -> Progress | None:
    """Progress of one step; where there may be several rounds each is half of what is left."""
    left = 0.5**number
    share = left / 2 if rounds else left
    return part(progress, 1 - left + share * start, 1 - left + share * end)
