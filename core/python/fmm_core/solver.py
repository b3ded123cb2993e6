# SPDX-License-Identifier: GPL-3.0-or-later
"""From a scene to its solution: particles, visibility, iteration."""

import numpy as np
from numpy.typing import NDArray

from .accuracy import measure
from .direct import DirectSpace
from .errors import Error, memory_errors
from .multipole import MultipoleSpace
from .particles import Particles, make_particles
from .progress import Progress, Tick, ticker
from .report import Report
from .scene import Scene
from .settings import Settings
from .solution import Solution
from .transport import Operator, Sums
from .visibility import Occlusion

#: Quadrature points that a scene of few triangles is cut into when the user leaves the number open.
AUTOMATIC_PARTICLES = 1200


def solve(scene: Scene, settings: Settings | None = None, progress: Progress | None = None) -> Solution:
    """Solves the radiosity equation B = E + albedo * irradiance(B) (eq 1) for a scene.

    progress(fraction, text) is called now and then; a false answer other than None cancels, which raises `Cancelled`.
    Raises `Error` on bad input or when memory does not suffice.
    """
    settings = Settings() if settings is None else settings
    if not isinstance(scene, Scene) or not isinstance(settings, Settings):
        raise Error(f"solve: expected a Scene and Settings, got {type(scene).__name__} and {type(settings).__name__}")
    with memory_errors():
        return _solve(scene, settings, progress)


def _solve(scene: Scene, settings: Settings, progress: Progress | None) -> Solution:
    report = Report(settings, scene)
    if settings.target_error is not None:
        report.warnings.append(f"target_error {settings.target_error:g} is not used yet")
    with report.time("tree"):
        count = settings.particles or AUTOMATIC_PARTICLES
        degree = settings.quadrature or (2 if len(scene.triangles) < count else 1)
        particles = make_particles(scene, count, degree)
    report.counts.update(triangles=len(scene.triangles), particles=len(particles))
    with report.time("visibility"):
        occlusion = Occlusion(scene) if settings.visibility == "rays" else None
    sums = Sums(particles, occlusion, settings.near_reach or (12.0 if degree == 1 else 4.0))
    with report.time("lists" if settings.method == "fmm" else "visibility"):
        space = MultipoleSpace(sums, settings) if settings.method == "fmm" else DirectSpace(sums)
        exchange = space.exchange(ticker(progress, 0.0, 0.8, "Preparing the exchange"))
    with report.time("transport"):
        radiosity = shoot(exchange, scene, particles, settings, report, ticker(progress, 0.8, 1.0, "Exchanging light"))
    if isinstance(space, MultipoleSpace):
        report.counts.update({name: space.counts[name] for name in ("boxes", "leaves")})
        report.counts["pairs_valid"] = space.counts["interactions"]
        if settings.probes:
            with report.time("accuracy"):
                report.error = measure(exchange, sums, radiosity, settings)
    report.counts["rays"] = sums.rays
    return Solution(scene, settings, space, radiosity, report)


def shoot(
    exchange: Operator, scene: Scene, particles: Particles, settings: Settings, report: Report, tick: Tick
) -> NDArray[np.float64]:
    """Radiosity (N, 3) by shooting: in each step all particles pass on what they received in the step before.

    Ends when no particle has more than the tolerance's share of its light still to come in any colour, judged from the
    last two steps, so that a dim corner or colour counts like a bright one; or at the cap, with a warning.
    """
    albedo = scene.albedo[particles.triangle]
    unshot = scene.emission[particles.triangle]
    radiosity = unshot.copy()
    for step in range(1, settings.max_iterations + 1):
        unshot = albedo * exchange.apply(unshot)
        radiosity += unshot
        lit = radiosity > 0
        report.residuals.append(float((unshot[lit] / radiosity[lit]).max(initial=0.0)))
        remaining = _remaining(report.residuals)
        if remaining <= settings.tolerance:
            return radiosity
        tick(min(0.99, step / (step + 10)))
    report.warnings.append(f"iteration stopped after {step} steps with {remaining:.2g} of the light still to come")
    return radiosity


def _remaining(residuals: list[float]) -> float:
    """Share of the light that all further steps together would add, from the last two: a geometric series."""
    last = residuals[-1]
    if last == 0.0:
        return 0.0
    ratio = last / residuals[-2] if len(residuals) > 1 else 1.0
    return last * ratio / (1 - ratio) if ratio < 1 else float("inf")
