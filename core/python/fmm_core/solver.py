# SPDX-License-Identifier: GPL-3.0-or-later
"""From a scene to its solution: particles, visibility, iteration."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from .direct import DirectOperator, DirectSpace
from .errors import Cancelled
from .particles import Particles, make_particles
from .report import Report
from .scene import Scene
from .settings import Settings
from .solution import Solution
from .visibility import Occlusion

Progress = Callable[[float, str], bool | None]

#: Quadrature points that a scene of few triangles is cut into when the user leaves the number open.
AUTOMATIC_PARTICLES = 2000


def solve(scene: Scene, settings: Settings | None = None, progress: Progress | None = None) -> Solution:
    """Solves the radiosity equation B = E + albedo * irradiance(B) (eq 1) for a scene.

    progress(fraction, text) is called now and then; returning False cancels, which raises `Cancelled`.
    Raises `Error` on bad input or when memory does not suffice.
    """
    settings = settings or Settings()
    report = Report(settings, scene)
    with report.time("tree"):
        count = settings.particles or AUTOMATIC_PARTICLES
        degree = settings.quadrature or (2 if len(scene.triangles) < count else 1)
        particles = make_particles(scene, count, degree)
    report.counts.update(triangles=len(scene.triangles), particles=len(particles))
    with report.time("visibility"):
        occlusion = Occlusion(scene)
        space = DirectSpace(particles, occlusion, settings.near_reach)
        exchange = space.exchange(_tick(progress, 0.0, 0.8, "Tracing visibility"))
    with report.time("transport"):
        radiosity = shoot(exchange, scene, particles, settings, report, _tick(progress, 0.8, 1.0, "Exchanging light"))
    report.counts["rays"] = occlusion.rays
    return Solution(scene, settings, space, radiosity, report)


def shoot(
    exchange: DirectOperator,
    scene: Scene,
    particles: Particles,
    settings: Settings,
    report: Report,
    tick: Callable[[float], bool] | None,
) -> NDArray[np.float64]:
    """Radiosity (N, 3) by shooting: in each step all particles pass on what they received in the step before.

    Ends when the unshot part is below the tolerance's share of the light on its way, or at the cap, with a warning.
    """
    albedo = scene.albedo[particles.triangle]
    weights = particles.weights[:, None]
    unshot = scene.emission[particles.triangle]
    radiosity = unshot.copy()
    target = settings.tolerance
    for step in range(1, settings.max_iterations + 1):
        unshot = albedo * exchange.apply(unshot)
        radiosity += unshot
        report.residuals.append(float((weights * unshot).sum() / (weights * radiosity).sum()))
        remaining = _remaining(report.residuals)
        if remaining <= target:
            return radiosity
        if tick is not None and tick(min(0.99, step / (step + 10))) is False:
            raise Cancelled
    report.warnings.append(f"iteration stopped after {step} steps with {remaining:.2g} of the light still unshot")
    return radiosity


def _tick(progress: Progress | None, start: float, end: float, text: str) -> Callable[[float], bool] | None:
    """Progress of one phase, which is the part from `start` to `end` of the whole."""
    if progress is None:
        return None
    return lambda fraction: progress(start + (end - start) * fraction, text) is not False


def _remaining(residuals: list[float]) -> float:
    """Share of the light that all further steps together would add, from the last two: a geometric series."""
    last = residuals[-1]
    if last == 0.0 or len(residuals) == 1:
        return last
    ratio = last / residuals[-2]
    return last * ratio / (1 - ratio) if ratio < 1 else float("inf")
